//! How far each run is from the measurement, step by step.

use std::str::FromStr;

use anyhow::{Error, Result, bail, ensure};

use crate::observations::{ByName, Observations, Steps, range};

mod stream;
mod table;

pub use stream::MisfitRows;
pub use table::{Incomplete, Misfits, Partial};

/// What a misfit is measured against when no noise is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaling {
    /// The largest observation over all steps.
    Max,
    /// The observation itself.
    Value,
    /// The range of the observations over all steps.
    Range,
    /// One.
    None,
}

/// Variance of each reading, shape (observables, steps), and whether it is that of a known noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance {
    /// Diagonal of C for each observable and step.
    pub variance: Vec<Vec<f64>>,
    /// Whether the variance is a noise that was given, so that σ = 1 is the posterior.
    pub is_noise: bool,
}

impl Covariance {
    /// C from the weights and scales of the observables: wⱼ (∏w)^(−1/m) sⱼ².
    ///
    /// `weights` are inverse observation weights by name, 1 where none is given.
    ///
    /// # Errors
    /// If a scale is zero, or a weight is not positive or names no observable.
    pub fn scaled(observations: &Observations, scale: Scaling, weights: &ByName) -> Result<Self> {
        weights.check_names(&observations.names, "--weights")?;
        let weights: Vec<f64> =
            observations.names.iter().map(|name| weights.get(name).unwrap_or(1.0)).collect();
        ensure!(weights.iter().all(|w| *w > 0.0), "--weights must be positive");
        let mean_ln = weights.iter().map(|w| w.ln()).sum::<f64>() / weights.len() as f64;
        let mut variance = Vec::new();
        for ((name, values), weight) in observations.names.iter().zip(&observations.values).zip(weights) {
            let scales: Vec<f64> = match scale {
                Scaling::Max => vec![values.iter().copied().fold(f64::NEG_INFINITY, f64::max); values.len()],
                Scaling::Value => values.clone(),
                Scaling::Range => vec![range(values); values.len()],
                Scaling::None => vec![1.0; values.len()],
            };
            if let Some(step) = scales.iter().position(|s| *s == 0.0) {
                let (what, other) = match scale {
                    Scaling::Max => ("the largest value", "range"),
                    Scaling::Value => ("the value", "max"),
                    _ => ("the range", "max"),
                };
                bail!(
                    "{}: column {name}: {what} is zero (step {step}) and cannot be a scale; use --scale {other}",
                    observations.source
                );
            }
            let factor = (weight.ln() - mean_ln).exp();
            variance.push(scales.iter().map(|s| factor * s * s).collect());
        }
        Ok(Self { variance, is_noise: false })
    }

    /// C from the standard deviation of a known noise, shape (observables, steps).
    pub fn of_noise(noise: &[Vec<f64>]) -> Self {
        let variance = noise.iter().map(|sd| sd.iter().map(|sd| sd * sd).collect()).collect();
        Self { variance, is_noise: true }
    }

    /// C times σ as the variance of the noise: what is posterior at this σ is so at 1.
    ///
    /// # Errors
    /// If σ is not positive.
    pub fn at_sigma(mut self, sigma: f64) -> Result<Self> {
        ensure!(sigma > 0.0 && sigma.is_finite(), "--sigma {sigma} is not positive");
        self.variance.iter_mut().flatten().for_each(|variance| *variance *= sigma);
        Ok(Self { is_noise: true, ..self })
    }
}

/// Compares runs with a measurement.
#[derive(Debug)]
pub struct Comparison<'a> {
    observations: &'a Observations,
    covariance: Covariance,
    steps: std::ops::Range<usize>,
    /// What the error is a share of, shape (observables,).
    ranges: Vec<f64>,
}

/// What one run gives: a misfit and an error a step, and how many independent readings it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RunMisfit {
    /// rᵀC⁻¹r at each step, shape (steps,).
    pub misfit: Vec<f64>,
    /// Mean over the observables of |r| / range, shape (steps,).
    pub error: Vec<f64>,
    /// Independent readings among the residuals, over all steps and observables.
    pub readings: f64,
    /// The misfit that noise alone would make, over all steps and observables.
    pub expected: f64,
    /// The emulator's share of the variance of each reading, summed over all steps and observables;
    /// 0 for a run of the simulator.
    pub ignorance: f64,
}

impl RunMisfit {
    /// Whether all of it is finite, in sum too.
    fn is_finite(&self) -> bool {
        let sums =
            [self.misfit.iter().sum(), self.error.iter().sum(), self.readings, self.expected, self.ignorance];
        sums.iter().all(|sum: &f64| sum.is_finite())
    }
}

impl<'a> Comparison<'a> {
    /// Compare at some of the steps of a measurement.
    ///
    /// # Errors
    /// If the measurement has none of these steps, or a variance is beyond what a number can say.
    pub fn new(observations: &'a Observations, covariance: Covariance, steps: Steps) -> Result<Self> {
        let steps = steps.within(observations.steps())?;
        for (name, variance) in observations.names.iter().zip(&covariance.variance) {
            ensure!(
                variance.iter().all(|variance| variance.is_normal() && *variance > 0.0),
                "{}: the variance of {name} is beyond what a number can say; are its values, the noise and \
                 --sigma of a sensible size?",
                observations.source
            );
        }
        let ranges = observations.sizes();
        Ok(Self { observations, covariance, steps, ranges })
    }

    /// Misfit of one run.
    ///
    /// * `curves` — simulated observables, step by step: `curves[t * m + j]`, shape (steps · m,).
    /// * `sd` — their standard deviations in the same order, if an emulator gave them.
    pub fn run(&self, curves: &[f64], sd: Option<&[f64]>) -> RunMisfit {
        let m = self.observations.names.len();
        let n = self.steps.len();
        let mut result = RunMisfit {
            misfit: vec![0.0; n],
            error: vec![0.0; n],
            readings: 0.0,
            expected: (n * m) as f64,
            ignorance: 0.0,
        };
        let mut residuals = vec![0.0; n];
        for j in 0..m {
            let (observed, variances) = (&self.observations.values[j], &self.covariance.variance[j]);
            for (i, t) in self.steps.clone().enumerate() {
                let residual = observed[t] - curves[t * m + j];
                let variance = variances[t];
                result.misfit[i] += match sd.map(|sd| sd[t * m + j] * sd[t * m + j]) {
                    Some(own) => {
                        let ln_widening = (own / variance).ln_1p();
                        result.expected += ln_widening;
                        result.ignorance += own / (variance + own);
                        residual * residual / (variance + own) + ln_widening
                    }
                    None => residual * residual / variance,
                };
                result.error[i] += residual.abs() / (self.ranges[j] * m as f64);
                residuals[i] = residual / variance.sqrt();
            }
            result.readings += independent_readings(&residuals);
        }
        result
    }
}

/// Number of independent readings among residuals along the steps: n (1 − ρ)/(1 + ρ), with ρ their
/// correlation from one step to the next.
///
/// A correlation that white noise would show too (below 1.64/√n) counts as none, and the residuals
/// are not centred: an offset left over is not noise.
///
/// # Source
/// Bayley & Hammersley (1946), J. R. Stat. Soc. Suppl. 8:184, for a first-order autoregression.
pub fn independent_readings(residuals: &[f64]) -> f64 {
    let n = residuals.len() as f64;
    let power: f64 = residuals.iter().map(|r| r * r).sum();
    let product: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let correlation = if power > 0.0 { product / power } else { 0.0 };
    if correlation < 1.64 / n.sqrt() {
        return n;
    }
    (n * (1.0 - correlation) / (1.0 + correlation)).max(1.0)
}

impl FromStr for Scaling {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Ok(match text {
            "max" => Self::Max,
            "value" => Self::Value,
            "range" => Self::Range,
            "none" => Self::None,
            _ => bail!("{text:?} is none of max, value, range, none"),
        })
    }
}
