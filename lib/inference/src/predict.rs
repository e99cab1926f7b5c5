//! What a weighted ensemble says of the observables: mean, spread and quantiles at every step.

use anyhow::{Result, ensure};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::ensemble::Ensemble;
use crate::prior::normal_cdf;
use gl_numeric::statistics::{Quantiles, mean, sd};

/// One reading as the draws of a posterior have it, without noise and scatter, in units of its observable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predicted {
    /// Its observable, `test.observable` where its test has a name.
    pub observable: String,
    /// Its step.
    pub step: usize,
    /// Its control.
    pub control: f64,
    /// Mean of the draws.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Quantile of 5 %.
    pub q05: f64,
    /// Median.
    pub q50: f64,
    /// Quantile of 95 %.
    pub q95: f64,
}

/// Weighted mean, standard deviation and quantiles of one observable at one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Quantiles at 5, 50 and 95 %.
    pub quantiles: [f64; 3],
}

/// The posterior prediction of every observable at every step, shape (observables, steps).
///
/// * `weights` — shape (runs,), summing to one.
///
/// Each run of an ensemble with `_sd` columns counts as a normal distribution, and the result is
/// that of their mixture.
///
/// # Errors
/// If the ensemble has no runs.
pub fn predict(ensemble: &Ensemble, weights: &[f64]) -> Result<Vec<Vec<Moments>>> {
    ensure!(!ensemble.is_empty(), "{}: no runs to predict from", ensemble.source);
    let runs: Vec<usize> = (0..ensemble.len()).filter(|&run| weights[run] > 0.0).collect();
    let weights: Vec<f64> = runs.iter().map(|&run| weights[run]).collect();
    let at_step = |j: usize, step: usize| {
        let values: Vec<f64> = runs.iter().map(|&run| ensemble.curve(run, j)[step]).collect();
        let sds: Option<Vec<f64>> =
            runs.iter().map(|&run| ensemble.curve_sd(run, j).map(|sd| sd[step])).collect();
        moments(&values, sds.as_deref(), &weights)
    };
    // All at once: a table may have a hundred thousand columns of few steps each.
    let (observables, steps) = (ensemble.observables.len(), ensemble.steps());
    let all: Vec<Moments> =
        (0..observables * steps).into_par_iter().map(|i| at_step(i / steps, i % steps)).collect();
    Ok((0..observables).map(|j| all[j * steps..(j + 1) * steps].to_vec()).collect())
}

fn moments(values: &[f64], sds: Option<&[f64]>, weights: &[f64]) -> Moments {
    const LEVELS: [f64; 3] = [0.05, 0.5, 0.95];
    let centre = mean(values, weights);
    let between = sd(values, weights);
    match sds.filter(|sds| sds.iter().any(|&sd| sd > 0.0)) {
        None => {
            let quantiles = Quantiles::new(values, weights);
            Moments { mean: centre, sd: between, quantiles: LEVELS.map(|p| quantiles.among(p)) }
        }
        Some(sds) => {
            let within: f64 = sds.iter().zip(weights).map(|(sd, w)| w * sd * sd).sum();
            let quantiles = LEVELS.map(|p| mixture_quantile(values, sds, weights, p));
            Moments { mean: centre, sd: between.hypot(within.sqrt()), quantiles }
        }
    }
}

/// The quantile of a mixture of normal distributions, by bisection to 1e-12 of its extent.
pub(crate) fn mixture_quantile(means: &[f64], sds: &[f64], weights: &[f64], p: f64) -> f64 {
    const REACH: f64 = 9.0;
    let below = |x: f64| -> f64 {
        let share = |((&mean, &sd), &weight): ((&f64, &f64), &f64)| {
            let distance = x - mean;
            if distance >= REACH * sd {
                weight
            } else if distance <= -REACH * sd {
                0.0
            } else {
                weight * normal_cdf(distance / sd)
            }
        };
        means.iter().zip(sds).zip(weights).map(share).sum()
    };
    let ends = |sign: f64| means.iter().zip(sds).map(move |(mean, sd)| mean + sign * REACH * sd);
    let mut low = ends(-1.0).fold(f64::INFINITY, f64::min);
    let mut high = ends(1.0).fold(f64::NEG_INFINITY, f64::max);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if below(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_normal_has_its_own_quantiles() {
        // Python, statistics.NormalDist(3, 2).inv_cdf of 0.05, 0.5, 0.95
        let expected = [-0.289_707_253_902_945_6, 3.0, 6.289_707_253_902_945];
        let moments = moments(&[3.0], Some(&[2.0]), &[1.0]);
        for (found, expected) in moments.quantiles.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found}");
        }
        assert_eq!((moments.mean, moments.sd), (3.0, 2.0));
    }

    #[test]
    fn a_mixture_adds_the_variance_within_to_that_between() {
        // Means 0 and 4, weights 3/4 and 1/4: variance between 3; within 0.75·1 + 0.25·4 = 1.75.
        let moments = moments(&[0.0, 4.0], Some(&[1.0, 2.0]), &[0.75, 0.25]);
        assert!((moments.sd - 4.75_f64.sqrt()).abs() < 1e-14);
        // Bisection in Python (statistics.NormalDist) of 0.75 Φ(x) + 0.25 Φ((x − 4)/2) − p
        let expected = [-1.508_709_382_556_845, 0.398_081_949_426_044, 5.683_242_608_769_989];
        for (found, expected) in moments.quantiles.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found}");
        }
    }

    #[test]
    fn runs_without_weight_count_for_nothing() {
        let rows = b"sample step e q\na 0 0 1\nb 0 0 3\nc 0 0 1e9\n";
        let ensemble = Ensemble::parse("runs", rows, "e", &["q".to_owned()]).unwrap();
        let moments = predict(&ensemble, &[0.5, 0.5, 0.0]).unwrap()[0][0];
        assert_eq!(moments, Moments { mean: 2.0, sd: 1.0, quantiles: [1.0, 2.0, 3.0] });
    }
}
