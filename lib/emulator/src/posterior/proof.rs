//! The newest runs against what the runs before them say of them.

use std::collections::HashSet;

use anyhow::Result;
use gl_inference::samples::Samples;
use nalgebra::DVector;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::likelihood::Measured;
use super::space::Space;
use super::surrogate::{Ranked, Surrogate};

/// How a batch of runs came out against an emulator that did not know them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proof {
    /// Number of runs that count: those near the posterior, and those that were predicted to be.
    pub runs: usize,
    /// Root mean square of the errors in standard deviations of what was predicted.
    pub z: f64,
    /// Probability of errors at least as large, if the emulator is right.
    pub p: f64,
    /// Root mean square of the errors, over all readings, in standard deviations of the noise; the median of the runs
    /// that fit well, and zero where none does: far from the posterior anything may surprise.
    pub error: f64,
    /// What the scatter makes a run differ by from the mean of all like it, in the same unit.
    pub scatter: f64,
}

impl Proof {
    /// Whether runs that fit well lie so much nearer to the mean than the scatter would have them that there is less of it:
    /// what no emulator follows, a kink or a jump, is taken for scatter, too.
    pub fn has_less_scatter(&self) -> bool {
        self.scatter > 1.0 && self.error > 0.0 && self.error < 0.5 * self.scatter && 1.0 - self.p < LESS
    }
}

/// Probability below which runs that are so near to the mean by chance are out of the question.
const LESS: f64 = 1e-3;

/// Error that no likelihood feels, in standard deviations of the noise of all readings together.
const NEGLIGIBLE: f64 = 0.3;

/// Draws of a posterior that say how well a run near it fits, at most, and the share of them that fits as well: in the tail
/// it has no bound.
const DRAWS: usize = 200;
const SHARE: f64 = 0.95;

/// The misfit that nearly all draws of a posterior stay below, by the mean of its surrogate.
///
/// * `points` — the draws, shape (draws, dimensions), the parameters first.
pub fn reach(surrogate: &Surrogate, points: &[Vec<f64>], measured: &Measured, space: &Space) -> f64 {
    let of = |x: &Vec<f64>| measured.misfit(surrogate.curve(space, x).as_slice());
    let mut misfits: Vec<f64> = points.iter().step_by(points.len().div_ceil(DRAWS).max(1)).map(of).collect();
    misfits.sort_by(f64::total_cmp);
    misfits.get((SHARE * misfits.len() as f64) as usize).copied().unwrap_or(0.0)
}

/// Hold the newest runs against what a surrogate of the others predicts of them: those that fit as well as the runs near the
/// posterior or its own draws, and those that were predicted to. One that is as far off as it was predicted, and only not to
/// the digit, says nothing of it.
///
/// * `variance` — of the noise over that of its base: what errors are small beside.
/// * `reach` — the misfit of the posterior's draws, see [`reach`]; zero where it is not known yet.
///
/// # Errors
/// If a sample lacks a parameter.
pub fn prove(
    before: &Surrogate,
    ranked: &Ranked<'_>,
    newest: &HashSet<&str>,
    (measured, variance, reach): (&Measured, f64, f64),
    space: &Space,
    samples: &Samples,
) -> Result<Option<Proof>> {
    let values = samples.columns(&space.prior().names())?;
    let places = samples.index();
    let near = ranked.curves().take(ranked.near());
    let reach = near.map(|(_, curve)| measured.misfit(&curve)).fold(reach, f64::max);
    let (mut runs, mut errors) = (0, Vec::new());
    let (mut total, mut degrees) = (0.0, 0.0);
    for (name, curve) in ranked.curves().filter(|(name, _)| newest.contains(name)) {
        let Some(&place) = places.get(name) else { continue };
        let x = space.place(&values[place]);
        let Surprise { square, components, error, predicted } =
            surprise(before, space, (measured, variance), &x, &curve);
        let is_near = measured.misfit(&curve) <= reach;
        if !is_near && predicted > reach {
            continue;
        }
        total += square;
        degrees += components;
        runs += 1;
        errors.extend(Some(error).filter(|_| is_near));
    }
    if runs == 0 || degrees < 1.0 {
        return Ok(None);
    }
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    let p = ChiSquared::new(degrees).map_or(1.0, |law| law.sf(total));
    let scatter = size_of_scatter(before, measured);
    Ok(Some(Proof { runs, z: (total / degrees).sqrt(), p, error: median, scatter }))
}

/// Root mean square of the scatter over all readings, in standard deviations of the noise.
fn size_of_scatter(surrogate: &Surrogate, measured: &Measured) -> f64 {
    let emulator = &surrogate.emulator;
    let pattern = measured.patterns(emulator);
    let covariance = surrogate.scatter.of_scores(emulator, measured);
    ((&pattern * covariance).component_mul(&pattern).sum().max(0.0) / pattern.nrows() as f64).sqrt()
}

/// How a run came out.
struct Surprise {
    /// Square of its error in standard deviations of what was predicted.
    square: f64,
    /// Degrees of freedom of that.
    components: f64,
    /// Root mean square of the error over all readings, in standard deviations of the noise.
    error: f64,
    /// Misfit that was predicted of it.
    predicted: f64,
}

impl Surprise {
    /// Where what was predicted has no covariance.
    fn unknown(predicted: f64) -> Self {
        Self { square: 0.0, components: 0.0, error: f64::INFINITY, predicted }
    }
}

/// How a run came out against a surrogate that does not know it.
fn surprise(
    before: &Surrogate,
    space: &Space,
    (measured, noise): (&Measured, f64),
    x: &[f64],
    curve: &[f64],
) -> Surprise {
    let emulator = &before.emulator;
    let (mean, variance) = emulator.predict_scores(&space.coordinates(x));
    let (outputs, k) = emulator.basis().shape();
    let pattern = measured.patterns(emulator);
    let predicted = emulator.curve(&mean);
    let misfit = measured.misfit(predicted.as_slice());
    let residual = DVector::from_fn(outputs, |o, _| (curve[o] - predicted[o]) / measured.base[o]);
    let gram = pattern.tr_mul(&pattern);
    let variance: Vec<f64> = variance.iter().map(|v| before.calibration * v).collect();
    let covariance = emulator.score_covariance(&variance) + before.scatter.of_scores(emulator, measured);
    let Some(inverse) = gram.clone().try_inverse() else { return Surprise::unknown(misfit) };
    let scores = &inverse * pattern.tr_mul(&residual);
    let whole = covariance + inverse * (NEGLIGIBLE * NEGLIGIBLE * noise);
    let square = match whole.cholesky() {
        Some(cholesky) => scores.dot(&cholesky.solve(&scores)),
        None => return Surprise::unknown(misfit),
    };
    let error = (residual.norm_squared() / outputs as f64).sqrt();
    Surprise { square, components: k as f64, error, predicted: misfit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_that_are_nearer_to_the_mean_than_scatter_would_have_them_show_less_of_it() {
        let near = Proof { runs: 8, z: 0.2, p: 1.0, error: 0.1, scatter: 3.0 };
        assert!(near.has_less_scatter());
        for other in [
            Proof { error: 2.0, ..near },
            Proof { error: 0.0, ..near },
            Proof { scatter: 0.5, ..near },
            Proof { p: 0.99, ..near },
        ] {
            assert!(!other.has_less_scatter(), "{other:?}");
        }
    }
}
