//! Whether the noise is as it was stated: correlation from step to step, and size.

use gl_inference::misfit::independent_readings;
use gl_numeric::statistics::mean;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::likelihood::{Fit, Likelihood, Measured, Nuisances};

/// Twice the gain in ln likelihood from which a correlation of a known noise is believed: p = 0.004 by
/// chance.
const KNOWN: f64 = 7.0;

/// The same where the noise is estimated anyway: p = 0.05, as where independent readings are counted.
const ESTIMATED: f64 = 2.7;

/// Probability below which a χ² is too large or too small to be chance.
const UNLIKELY: f64 = 0.005;

/// The observables whose residuals are correlated, given the points that fit best without a correlation.
///
/// * `likelihood` — with a coordinate for each observable's correlation.
/// * `points` — points of its space, with correlations of 0.
pub fn correlated(likelihood: &Likelihood<'_>, points: &[Vec<f64>], measured: &Measured) -> Vec<bool> {
    let highest =
        |points: &[Vec<f64>]| points.iter().map(|x| likelihood.fit(x).ln).fold(f64::NEG_INFINITY, f64::max);
    let threshold = if measured.is_known { KNOWN } else { ESTIMATED };
    let without = highest(points);
    let of = |j: usize| {
        let Some(place) = likelihood.place_of_correlation(j) else { return false };
        if measured.own(j).len() < FEWEST_STEPS {
            return false;
        }
        let gains = (1..=18).map(|i| {
            let with: Vec<Vec<f64>> = points
                .iter()
                .map(|x| {
                    let mut x = x.clone();
                    x[place] = Nuisances::of_correlation(0.05 * f64::from(i));
                    x
                })
                .collect();
            2.0 * (highest(&with) - without)
        });
        gains.fold(0.0, f64::max) > threshold
    };
    (0..measured.observables()).map(of).collect()
}

/// Fewest steps that show a correlation.
const FEWEST_STEPS: usize = 8;

/// How the best fit compares with the noise that was stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// rᵀ Σ⁻¹ r.
    pub value: f64,
    /// Readings less what the fit took.
    pub degrees: f64,
    /// Probability of a larger one.
    pub p: f64,
    /// Probability of a smaller one, to the last digit where it is small.
    pub p_of_less: f64,
}

impl ChiSquare {
    /// * `taken` — parameters that the measurement decides.
    pub fn new(fit: Fit, readings: usize, taken: f64) -> Self {
        let degrees = (readings as f64 - taken).max(1.0);
        let law = ChiSquared::new(degrees);
        let p = law.as_ref().map_or(1.0, |law| law.sf(fit.square));
        let p_of_less = law.map_or(1.0, |law| law.cdf(fit.square));
        Self { value: fit.square, degrees, p, p_of_less }
    }

    /// Whether the fit is worse than the noise allows.
    pub fn is_worse(self) -> bool {
        self.p < UNLIKELY
    }

    /// Whether it is better.
    pub fn is_better(self) -> bool {
        self.p_of_less < UNLIKELY
    }
}

/// Independent readings of each observable among residuals, observable by observable, by their
/// autocorrelation.
pub fn independent(residuals: &[f64], measured: &Measured) -> Vec<f64> {
    standardised(residuals, measured).iter().map(|z| independent_readings(z)).collect()
}

/// The test that all tools share, of residuals, observable by observable, of which a fit has `taken` so many degrees of freedom.
pub fn test(residuals: &[f64], measured: &Measured, taken: usize) -> gl_inference::fit::Fit {
    gl_inference::fit::test(&standardised(residuals, measured), taken)
}

/// Residuals in standard deviations of the noise, shape (observables, steps).
fn standardised(residuals: &[f64], measured: &Measured) -> Vec<Vec<f64>> {
    let of = |j: usize| measured.own(j).map(|o| residuals[o] / measured.noise[o]).collect();
    (0..measured.observables()).map(of).collect()
}

/// Parameters that a measurement decides: Σ 1 − (posterior sd / prior sd)².
pub fn decided(points: &[Vec<f64>], prior_sd: &[f64]) -> f64 {
    let weights = vec![1.0 / points.len() as f64; points.len()];
    let of = |(j, prior_sd): (usize, &f64)| {
        let column: Vec<f64> = points.iter().map(|x| x[j]).collect();
        let centre = mean(&column, &weights);
        let variance = column.iter().map(|x| (x - centre).powi(2)).sum::<f64>() / column.len() as f64;
        (1.0 - variance / (prior_sd * prior_sd)).clamp(0.0, 1.0)
    };
    prior_sd.iter().enumerate().map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_that_is_far_too_good_has_its_probability_to_the_last_digit() {
        // scipy.stats.chi2.cdf(42, 181)
        let good = ChiSquare::new(Fit { ln: 0.0, square: 42.0 }, 181, 0.0);
        assert!((good.p_of_less / 3.181439387332727e-29 - 1.0).abs() < 1e-9, "{}", good.p_of_less);
        assert!(good.is_better() && !good.is_worse());
    }
}
