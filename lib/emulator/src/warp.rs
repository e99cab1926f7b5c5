//! What an emulator sees of an observable: the readings, or nearly their logarithm.
//!
//! A stiffness that is known to a factor of thirty makes forces that are thirty times too large in most of the runs, and a
//! process that is as uncertain everywhere as it has to be among those hides what the few near the measurement say.

use gl_inference::ensemble::Ensemble;

use crate::Emulator;

/// Runs that reach so many times beyond the measurement are seen warped.
pub const FAR: f64 = 4.0;

/// The same where runs of the same parameters differ: scatter that is the same at every size is another one at each when seen
/// so, and has another mean. So only for the sake of runs that are much further off.
pub const FAR_OF_SCATTER: f64 = 30.0;

/// s, as a share of the largest reading.
const WARPED_FROM: f64 = 0.3;

/// The readings as they are, or s asinh(y/s), which is y near zero and grows as the logarithm beyond s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Warp {
    scale: Option<f64>,
}

impl Warp {
    /// For an observable with these readings and runs, each of shape (steps,): where a run reaches `far` times beyond
    /// the largest of them.
    pub fn new<'a>(measured: &[f64], runs: impl Iterator<Item = &'a [f64]>, far: f64) -> Self {
        let measured = size(measured);
        let simulated = runs.map(size).fold(0.0, f64::max);
        Self { scale: (measured > 0.0 && simulated > far * measured).then_some(WARPED_FROM * measured) }
    }

    /// Whether anything changes.
    pub fn is_some(self) -> bool {
        self.scale.is_some()
    }

    /// What the emulator sees.
    pub fn there(self, y: f64) -> f64 {
        self.scale.map_or(y, |s| s * (y / s).asinh())
    }

    /// The value of what the emulator gives.
    pub fn back(self, t: f64) -> f64 {
        self.scale.map_or(t, |s| s * (t / s).clamp(-100.0, 100.0).sinh())
    }

    /// The derivative of what it sees.
    pub fn slope(self, y: f64) -> f64 {
        self.scale.map_or(1.0, |s| 1.0 / (y / s).hypot(1.0))
    }
}

/// The largest of some values, without its sign.
fn size(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |size, value| size.max(value.abs()))
}

/// What an emulator sees of each observable, for readings of shape (observables, steps) and runs at the same steps.
pub fn warps(measured: &[Vec<f64>], runs: &Ensemble, far: f64) -> Vec<Warp> {
    let of = |j: usize| (0..runs.len()).map(move |run| runs.curve(run, j));
    measured.iter().enumerate().map(|(j, readings)| Warp::new(readings, of(j), far)).collect()
}

/// Runs as an emulator sees them, one warp an observable.
pub fn seen(ensemble: &Ensemble, warps: &[Warp]) -> Ensemble {
    let mut seen = ensemble.part(&[], 0..ensemble.steps());
    for (run, name) in ensemble.samples.iter().enumerate() {
        let of = |(j, warp): (usize, &Warp)| ensemble.curve(run, j).iter().map(|y| warp.there(*y)).collect();
        let curves: Vec<Vec<f64>> = warps.iter().enumerate().map(of).collect();
        seen.push(name, &curves, None);
    }
    seen
}

/// Whether runs of the same parameters differ: what an emulator takes for scatter in the pattern that most of their variance is in.
pub fn scatters(emulator: &Emulator) -> bool {
    /// The share of its variance from which it is no rounding.
    const SHARE: f64 = 1e-3;
    let scores = emulator.scores();
    emulator.nugget().first().is_some_and(|nugget| *nugget > SHARE * scores.column(0).variance())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warp_goes_there_and_back_and_its_slope_is_its_difference_quotient() {
        let (measured, far, near) = ([0.5, -2.0], [0.0, 1e4], [5.0, -1.0]);
        let warp = Warp::new(&measured, [&far[..], &near].into_iter(), 4.0);
        for y in [-700.0, -0.3, 0.0, 1.0, 2.0, 5e3] {
            let there = warp.there(y);
            assert!((warp.back(there) - y).abs() <= 1e-12 * y.abs().max(1.0), "{y}");
            let quotient = (warp.there(y + 1e-5) - warp.there(y - 1e-5)) / 2e-5;
            assert!((warp.slope(y) - quotient).abs() < 1e-6, "{y}");
        }
        let none = Warp::new(&measured, [&near[..]].into_iter(), 4.0);
        assert!(!none.is_some());
        assert_eq!((none.there(5.0), none.back(5.0), none.slope(5.0)), (5.0, 5.0, 1.0));
    }
}
