//! Whether a calibration is done, and what to think of it.

use anyhow::{Result, bail};

use crate::fit::{BAD, of_misfit};
use crate::summary::Summary;

/// Tolerances that end a calibration; any one that is met does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerances {
    /// Of σ.
    pub sigma: Option<f64>,
    /// Of the mean error of the weighted runs.
    pub ensemble_error: Option<f64>,
    /// Of the error of the best run.
    pub error: Option<f64>,
    /// Number of iterations.
    pub iterations: Option<usize>,
}

/// One reason to stop, and whether it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Criterion {
    /// What it looks at.
    pub name: &'static str,
    /// The value there.
    pub value: f64,
    /// What it is to come down to, or up to for the number of iterations.
    pub tolerance: f64,
    /// Whether it has.
    pub is_met: bool,
}

/// What is known of the iteration before.
#[derive(Clone, Debug, PartialEq)]
pub enum Previous {
    /// It is not to be taken into account.
    NotAsked,
    /// There is none.
    First,
    /// What it said.
    Iteration(Summary),
}

/// Check a summary against the tolerances. σ having come down to the noise is a reason of its own.
///
/// * `iteration` — number of the present iteration, from 0.
/// * `previous` — the iteration before. A noise that is estimated comes down as better runs are found:
///   while it still falls, σ having come down to it is no reason to stop.
///
/// # Errors
/// If the summary lacks a quantity that a tolerance is for.
pub fn criteria(
    summary: &Summary,
    tolerances: &Tolerances,
    iteration: Option<usize>,
    previous: &Previous,
) -> Result<Vec<Criterion>> {
    let quantity = |name: &str| -> Result<f64> {
        match summary.find_number(name)? {
            Some(value) => Ok(value),
            None => bail!("the summary has no quantity {name}"),
        }
    };
    let mut criteria = Vec::new();
    let mut below = |name: &'static str, tolerance: Option<f64>| -> Result<()> {
        if let Some(tolerance) = tolerance {
            let value = quantity(name)?;
            criteria.push(Criterion { name, value, tolerance, is_met: value <= tolerance });
        }
        Ok(())
    };
    below("sigma", tolerances.sigma.or(summary.find_number("sigma_tol")?))?;
    below("ensemble_error", tolerances.ensemble_error)?;
    below("best_error", tolerances.error)?;
    let floor = summary.find_number("sigma_min")?.or(summary.find_number("sigma_noise")?);
    if let Some(tolerance) = floor {
        let value = quantity("sigma")?;
        // Tempering that went below the noise, for want of a floor, has not come to rest on it.
        let is_met = (value - tolerance).abs() <= 1e-9 * tolerance && noise_is_settled(summary, previous)?;
        criteria.push(Criterion { name: "sigma_noise", value, tolerance, is_met });
    }
    if let Some(most) = tolerances.iterations {
        let Some(iteration) = iteration else {
            bail!("--max-iterations needs --iteration, the number of this one")
        };
        let (value, tolerance) = ((iteration + 1) as f64, most as f64);
        criteria.push(Criterion { name: "iterations", value, tolerance, is_met: value >= tolerance });
    }
    Ok(criteria)
}

/// Share of its value before, below which an estimated noise is still falling.
const SETTLED: f64 = 0.8;

/// Whether the noise is known, or its estimate has not fallen since the iteration before.
fn noise_is_settled(summary: &Summary, previous: &Previous) -> Result<bool> {
    let is_known = summary.get("best_misfit_over_noise").is_some();
    let noise = |summary: &Summary| summary.find_number("sigma_noise");
    match previous {
        _ if is_known => Ok(true),
        Previous::NotAsked => Ok(true),
        Previous::First => Ok(false),
        Previous::Iteration(before) => {
            Ok(noise(summary)?.zip(noise(before)?).is_some_and(|(now, then)| now >= SETTLED * then))
        }
    }
}

/// The best run misses by more than this share of the observables' range: the fit is bad.
const BAD_ERROR: f64 = 0.1;

/// A posterior that has shrunk by less than this has learned little; of a dozen effective runs the standard
/// deviation is known to a fifth.
const BLIND: f64 = 0.5;

/// What speaks against trusting a calibration that `criteria` stop, one sentence each.
///
/// # Errors
/// If a quantity in the summary is no number.
pub fn doubts(summary: &Summary, criteria: &[Criterion]) -> Result<Vec<String>> {
    let mut doubts = Vec::new();
    let met: Vec<&str> = criteria.iter().filter(|c| c.is_met).map(|c| c.name).collect();
    if met == ["best_error"] {
        let rest = summary.find_number("ensemble_error")?.unwrap_or(f64::NAN);
        doubts.push(format!(
            "the stop is by a single sample, {}; the weighted runs together miss by {:.2} % of the range",
            summary.get("best_sample").unwrap_or("the best"),
            100.0 * rest
        ));
    }
    if let Some(noise) =
        criteria.iter().find(|c| c.name == "sigma_noise" && c.value > c.tolerance * (1.0 + 1e-9))
    {
        doubts.push(format!(
            "sigma is still {:.3} times that of the noise: the posterior may change with more iterations",
            noise.value / noise.tolerance
        ));
    }
    if let Some(error) = summary.find_number("best_error")?.filter(|error| *error > BAD_ERROR) {
        doubts.push(format!("the fit is bad: the best run misses by {:.0} % of the range", 100.0 * error));
    }
    if let (Some(times), Some(misfit)) =
        (summary.find_number("best_misfit_over_noise")?, summary.find_number("best_misfit")?)
    {
        // What the noise alone would make is one for each independent reading.
        if of_misfit(misfit, misfit / times.max(f64::MIN_POSITIVE)) < BAD {
            doubts.push(format!(
                "the fit is bad: the best run misfits by {times:.1} times what the noise explains"
            ));
        }
    }
    if let Some(runs) = summary.find_number("ess_runs")?.filter(|runs| *runs < 3.0) {
        doubts.push(format!("the posterior rests on {runs:.1} runs: more samples may well change it"));
    }
    for name in summary.names_of("shrinkage") {
        let shrinkage = summary.find_number(&format!("shrinkage({name})"))?;
        if let Some(shrinkage) = shrinkage.filter(|shrinkage| *shrinkage < BLIND) {
            doubts.push(format!(
                "the measurement says little of {name}: its standard deviation is {:.2} times what it was before",
                (1.0 - shrinkage).sqrt()
            ));
        }
    }
    for name in summary.names_of("lean") {
        let lean = summary.find_number(&format!("lean({name})"))?.unwrap_or(0.0);
        if lean != 0.0 {
            let side = if lean < 0.0 { "lower" } else { "upper" };
            doubts.push(format!("{name} leans on its {side} bound: the truth may lie outside"));
        }
    }
    Ok(doubts)
}
