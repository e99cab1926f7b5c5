//! Measurement noise along the control axis: how large, and how correlated from step to step.

use anyhow::{Result, ensure};
use rand::Rng;
use rand::distr::Open01;

use gl_inference::observations::{Observations, range};
use gl_inference::path::short;
use gl_inference::prior::normal_quantile;
use gl_table::verdict::Verdicts;

/// Noise of one observable: a standard deviation at each step times a first-order autoregressive
/// process of unit variance.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation, shape (steps,), all above zero.
    pub sd: Vec<f64>,
    /// Correlation from one step to the next, in [0, 0.95].
    pub phi: f64,
}

/// A noise that is so many times the stated one, or the stated one so many times it, is another one.
pub const OTHER_NOISE: f64 = 1.4;

/// Add how many times the stated noise readings scatter, where that is another one, by observable, and what follows from it:
/// a row each for one or two of them, and one for more, whose value is that of the furthest.
pub fn add_scales(verdicts: &mut Verdicts, scales: &[(&str, f64)], follows: &str) {
    if scales.len() <= 2 {
        for (name, scale) in scales {
            let text =
                format!("the readings of {name} scatter {} times what was stated; {follows}", short(*scale));
            verdicts.add("noise-scale", scale, text);
        }
        return;
    }
    let each: Vec<String> =
        scales.iter().map(|(name, scale)| format!("{name} {} times", short(*scale))).collect();
    let furthest =
        scales.iter().map(|(_, scale)| *scale).max_by(|a, b| a.ln().abs().total_cmp(&b.ln().abs()));
    let text = format!("the readings scatter otherwise than stated: {}; {follows}", each.join(", "));
    verdicts.add("noise-scale", furthest.unwrap_or(1.0), text);
}

/// Fewest steps from which a noise can be estimated.
const FEWEST_STEPS: usize = 8;

/// Whether the noise is known, shape (observables, steps), or can be estimated.
///
/// # Errors
/// If it is not known and there are too few steps.
pub fn check_steps(observations: &Observations, known_sd: Option<&[Vec<f64>]>) -> Result<()> {
    ensure!(
        known_sd.is_some() || observations.steps() >= FEWEST_STEPS,
        "{}: {} steps are too few to estimate the noise from (it takes {FEWEST_STEPS}); give it with --noise",
        observations.source,
        observations.steps()
    );
    Ok(())
}

/// Above this correlation, noise and a smooth gap are the same thing.
const HIGHEST_PHI: f64 = 0.95;

/// Smallest noise, as a share of the observable's range: below it, rounding is all there is.
const SMALLEST: f64 = 1e-9;

impl Noise {
    /// The noise of the residuals of all observables, shape (observables, steps), of which the
    /// standard deviation may be known, or else is estimated as well.
    ///
    /// Only differences are looked at, without their largest tenth, so that neither a gap that changes
    /// slowly nor one that jumps a few times counts as noise. Where the standard deviation σ is
    /// known, second differences give the correlation φ: their expected square is
    /// 2σ²(1 − φ)(3 − φ). Else differences over one and two steps give both, with 2σ²(1 − φ) and
    /// 2σ²(1 − φ²); φ is then taken to be the same for all observables, since one alone tells little. `scales` are the sizes of the observables, for the smallest noise that
    /// makes sense.
    ///
    /// # Source
    /// After Chakar, Lebarbier, Lévy-Leduc & Robin (2017), Bernoulli 23:1408, with trimmed means in
    /// place of medians.
    pub fn estimate(residuals: &[Vec<f64>], known_sd: Option<&[Vec<f64>]>, scales: &[f64]) -> Vec<Self> {
        if let Some(sd) = known_sd {
            return residuals.iter().zip(sd).map(|(residual, sd)| Self::with_sd(residual, sd)).collect();
        }
        let squares: Vec<(f64, f64)> = residuals
            .iter()
            .map(|r| {
                (mean_square_difference(r, 1).unwrap_or(0.0), mean_square_difference(r, 2).unwrap_or(0.0))
            })
            .collect();
        let ratios: Vec<f64> =
            squares.iter().filter(|(one, _)| *one > 0.0).map(|(one, two)| two / one).collect();
        let phi = (ratios.iter().sum::<f64>() / ratios.len().max(1) as f64 - 1.0).clamp(0.0, HIGHEST_PHI);
        let sized = |((one, _), scale): (&(f64, f64), &f64)| {
            let smallest = (SMALLEST * scale).max(f64::MIN_POSITIVE.sqrt());
            (one / (2.0 * (1.0 - phi))).sqrt().max(smallest)
        };
        let sizes = squares.iter().zip(scales).map(sized);
        sizes.zip(residuals).map(|(sd, residual)| Self { sd: vec![sd; residual.len()], phi }).collect()
    }

    /// The noise of one residual whose standard deviation is known.
    fn with_sd(residual: &[f64], sd: &[f64]) -> Self {
        let standardised: Vec<f64> = residual.iter().zip(sd).map(|(r, sd)| r / sd).collect();
        let phi = mean_square_second_difference(&standardised)
            .map_or(0.0, |square| 2.0 - (1.0 + square / 2.0).sqrt());
        Self { sd: sd.to_vec(), phi: phi.clamp(0.0, HIGHEST_PHI) }
    }

    /// Variance of the mean over some steps.
    pub fn mean_variance(&self, steps: std::ops::Range<usize>) -> f64 {
        let count = steps.len() as f64;
        // Σᵢⱼ sdᵢ sdⱼ φ^|i−j|, with the sum over i < j carried along.
        let (mut total, mut before) = (0.0, 0.0);
        for sd in &self.sd[steps] {
            before *= self.phi;
            total += sd * sd + 2.0 * sd * before;
            before += sd;
        }
        total / (count * count)
    }

    /// A draw of the noise, shape (steps,).
    pub fn draw(&self, rng: &mut impl Rng) -> Vec<f64> {
        let innovation = (1.0 - self.phi * self.phi).sqrt();
        let mut state = standard_normal(rng);
        let mut draw = Vec::with_capacity(self.sd.len());
        for sd in &self.sd {
            draw.push(sd * state);
            state = self.phi * state + innovation * standard_normal(rng);
        }
        draw
    }
}

/// A draw from the standard normal distribution.
pub(super) fn standard_normal(rng: &mut impl Rng) -> f64 {
    normal_quantile(rng.sample(Open01))
}

/// What an observable's noise is measured against: its range, or its size if it is constant.
pub fn scale(values: &[f64]) -> f64 {
    let spread = range(values);
    if spread > 0.0 { spread } else { values.iter().fold(0.0, |high, value| value.abs().max(high)) }
}

/// Mean square of the differences over `lag` steps without their largest tenth.
fn mean_square_difference(x: &[f64], lag: usize) -> Option<f64> {
    trimmed_mean_square(x.windows(lag + 1).map(|w| w[lag] - w[0]))
}

/// The variance of white noise about a smooth curve, from second differences without their largest tenth: 6σ² is expected
/// of their squares. None where there are too few steps to say.
pub fn white_variance(x: &[f64]) -> Option<f64> {
    mean_square_second_difference(x).map(|square| square / 6.0)
}

/// How many times a stated noise readings may scatter, both of shape (steps,), from 0.1 to 1: as little as a curve that is smooth
/// from step to step leaves of them. Who states a noise that is too large knows less than the readings show.
pub fn least_scale(readings: &[f64], stated: &[f64]) -> f64 {
    let in_stated: Vec<f64> = readings.iter().zip(stated).map(|(y, sd)| y / sd).collect();
    white_variance(&in_stated).map_or(1.0, |variance| variance.sqrt().clamp(0.1, 1.0))
}

/// Mean square of the second differences without their largest tenth; none of too few steps.
fn mean_square_second_difference(x: &[f64]) -> Option<f64> {
    let seconds = x.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
    trimmed_mean_square(seconds).filter(|_| x.len() >= FEWEST_STEPS)
}

/// Mean square without the largest tenth, made consistent for normal values.
fn trimmed_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    // For |x| below its 90 % quantile q: E[x²] = 1 − 2 q φ(q) / 0.9, with q = 1.6449.
    const CONSISTENT: f64 = 0.623_015;
    let mut squares: Vec<f64> = values.map(|x| x * x).collect();
    squares.sort_by(f64::total_cmp);
    let kept = (0.9 * squares.len() as f64).round() as usize;
    (kept > 0).then(|| squares[..kept].iter().sum::<f64>() / kept as f64 / CONSISTENT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn drawn(phi: f64, sd: f64, steps: usize) -> Vec<f64> {
        Noise { sd: vec![sd; steps], phi }.draw(&mut ChaCha8Rng::seed_from_u64(7))
    }

    #[test]
    fn size_and_correlation_are_found_in_a_long_series() {
        for phi in [0.0, 0.3, 0.7] {
            let residuals = [drawn(phi, 2.0, 40_000)];
            let noise = &Noise::estimate(&residuals, None, &[1.0])[0];
            assert!((noise.phi - phi).abs() < 0.03, "{phi}: {}", noise.phi);
            assert!((noise.sd[0] / 2.0 - 1.0).abs() < 0.05, "{phi}: {}", noise.sd[0]);
            let noise = &Noise::estimate(&residuals, Some(&[vec![2.0; 40_000]]), &[1.0])[0];
            assert!((noise.phi - phi).abs() < 0.02, "{phi}: {}", noise.phi);
        }
    }

    #[test]
    fn a_noise_that_is_stated_too_large_is_seen_in_the_readings() {
        let smooth = |t: usize| 3.0 * (t as f64 / 40.0).sin();
        let noise = drawn(0.0, 0.4, 80);
        let readings: Vec<f64> = noise.iter().enumerate().map(|(t, e)| smooth(t) + e).collect();
        for (stated, expected) in [(2.0, 0.2), (0.8, 0.5), (0.2, 1.0), (80.0, 0.1)] {
            let found = least_scale(&readings, &[stated; 80]);
            assert!((found / expected - 1.0).abs() < 0.2, "{stated}: {found}");
        }
        assert_eq!(least_scale(&readings[..2], &[2.0; 2]), 1.0);
    }

    #[test]
    fn a_jump_is_not_noise() {
        let mut residual = drawn(0.0, 1.0, 400);
        residual[100..200].iter_mut().for_each(|r| *r += 20.0);
        let noise = &Noise::estimate(&[residual], None, &[1.0])[0];
        assert!(noise.sd[0] < 1.3 && noise.phi < 0.3, "{} {}", noise.sd[0], noise.phi);
    }

    #[test]
    fn no_noise_at_all_still_has_a_size() {
        let noise = &Noise::estimate(&[vec![0.0; 20]], None, &[3.0])[0];
        assert!((noise.sd[0] / 3e-9 - 1.0).abs() < 1e-12 && noise.phi == 0.0);
    }
}
