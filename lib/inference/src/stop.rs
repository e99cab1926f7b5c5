//! Whether a calibration is done, and what to think of it.

use anyhow::{Context, Result, bail};
use gl_table::verdict::Verdicts;
use gl_table::{number, yes_no};
use serde::{Deserialize, Serialize};

use crate::fit::{alternation, of_misfit, said};
use crate::summary::{ParameterSummary, Summary};

/// Tolerances that end a calibration; any one that is met does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerances {
    /// Of σ.
    pub sigma: Option<f64>,
    /// Of the mean error of the weighted runs.
    pub ensemble_error: Option<f64>,
    /// Of the error of the best run.
    pub error: Option<f64>,
    /// Of σ over what the best run leaves of the measurement, as a share of what noise alone would.
    pub misfit: Option<f64>,
    /// Number of iterations.
    pub iterations: Option<usize>,
}

/// One reason to stop, and whether it holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Criterion {
    /// What it looks at.
    #[serde(rename = "criterion")]
    pub name: String,
    /// The value there.
    #[serde(serialize_with = "number")]
    pub value: f64,
    /// What it is to come down to, or up to for the number of iterations.
    #[serde(serialize_with = "number")]
    pub tolerance: f64,
    /// Whether it has.
    #[serde(rename = "met", serialize_with = "yes_no")]
    pub is_met: bool,
    /// Whether it is no reason by itself: only where all of these are met is there one, `settled`.
    #[serde(rename = "part", serialize_with = "yes_no")]
    pub is_part: bool,
}

impl Criterion {
    fn new(name: &str, value: f64, tolerance: f64, is_met: bool) -> Self {
        Self { name: name.to_owned(), value, tolerance, is_met, is_part: false }
    }
}

/// What is known of the iteration before.
#[derive(Clone, Debug, PartialEq)]
pub enum Previous {
    /// It is not to be taken into account.
    NotAsked,
    /// There is none.
    First,
    /// What it said.
    Iteration(Box<Summary>),
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
    let known = |name: &str, value: Option<f64>| {
        value.with_context(|| format!("the summary has no quantity {name}; is it one of gl-filter?"))
    };
    let mut criteria = Vec::new();
    let mut below = |name: &str, value: Option<f64>, tolerance: Option<f64>| -> Result<()> {
        if let Some(tolerance) = tolerance {
            let value = known(name, value)?;
            criteria.push(Criterion::new(name, value, tolerance, value <= tolerance));
        }
        Ok(())
    };
    below("sigma", summary.sigma, tolerances.sigma.or(summary.sigma_tol))?;
    below("ensemble_error", summary.ensemble_error, tolerances.ensemble_error)?;
    below("best_error", summary.best_error, tolerances.error)?;
    if summary.draws.is_some() {
        criteria.extend(settled(summary, previous));
    } else if let Some(tolerance) = summary.sigma_min.or(summary.sigma_noise) {
        let value = known("sigma", summary.sigma)?;
        // Tempering that went below the noise, for want of a floor, has not come to rest on it.
        let is_met = (value - tolerance).abs() <= 1e-9 * tolerance && noise_is_settled(summary, previous);
        criteria.push(Criterion::new("sigma_noise", value, tolerance, is_met));
    }
    if let Some(tolerance) = tolerances.misfit {
        let value = known("sigma", summary.sigma)?
            / known("best_misfit_over_noise", summary.best_misfit_over_noise)?.max(f64::MIN_POSITIVE);
        let is_met = value <= tolerance && is_at_rest(summary, previous);
        criteria.push(Criterion::new("sigma_misfit", value, tolerance, is_met));
    }
    if let Some(most) = tolerances.iterations {
        let Some(iteration) = iteration else {
            bail!("--max-iterations needs --iteration, the number of this one")
        };
        let (value, tolerance) = (iteration as f64 + 1.0, most as f64);
        criteria.push(Criterion::new("iterations", value, tolerance, value >= tolerance));
    }
    Ok(criteria)
}

/// Of the standard deviation of ln likelihood within the posterior by what the emulator does not know.
const IGNORANCE: f64 = 0.5;

/// The same where runs scatter, up to so many of them a parameter: what is not known falls by the root of their number,
/// and a batch changes little. Beyond, it grows by that root: a variance c / n of ln likelihood is left open by n runs,
/// and it and their price together are least where it is in proportion to n.
const SCATTERED_IGNORANCE: (f64, f64) = (0.35, 25.0);

/// The same where runs scatter and the model does not fit, whatever its parameters: a bad fit is what there is to know, and
/// the runs that would sharpen it are better spent on what it lacks.
const UNFIT_IGNORANCE: f64 = 1.0;

/// Where runs scatter and there are so many of them a parameter, it is enough that what is not known makes the standard
/// deviations no wider than so: a share of them would be left without it.
const KNOWN: (f64, f64) = (0.85, 40.0);

/// Error of the emulator on runs left out, in standard deviations of the noise, from which they do.
const SCATTERS: f64 = 0.3;

/// Of the change of a mean since the batch before, in standard deviations.
const SHIFT: f64 = 0.3;

/// Of the change of a standard deviation since the batch before, as |ln ratio|.
const SPREAD: f64 = 0.2;

/// Of the errors of the newest batch, in standard deviations of what was predicted.
const PROOF: f64 = 2.0;

/// Of the standard deviations' relative error for the runs that the simulator's scatter is known by.
const SCATTER: f64 = 0.08;

/// What stands for the value of something that there is not yet.
const UNKNOWN: f64 = 1e6;

/// Probability from which errors of the newest batch are chance, however large.
const CHANCE: f64 = 0.01;

/// Whether a posterior through an emulator is settled and proven: what the emulator does not know hardly
/// changes the likelihood, mean and standard deviation have moved little since the batch before, and the
/// newest batch is as it was predicted.
fn settled(summary: &Summary, previous: &Previous) -> Vec<Criterion> {
    let (mut shift, mut spread) = (f64::INFINITY, f64::INFINITY);
    if let Previous::Iteration(before) = previous {
        (shift, spread) = (0.0, 0.0);
        for now in summary.varied() {
            let then = before.parameter(&now.name);
            let of = |parameter: Option<&ParameterSummary>| {
                parameter.and_then(|p| Some((p.mean?, p.sd?))).unwrap_or((f64::NAN, f64::NAN))
            };
            let ((mean, sd), (mean_then, sd_then)) = (of(Some(now)), of(then));
            // A width by logarithms rests on more draws than the standard deviation of values over decades.
            let widths = now.width.zip(then.and_then(|then| then.width));
            let (width, width_then) = widths.unwrap_or((sd, sd_then));
            let moved = (mean - mean_then).abs() / sd.max(sd_then).max(f64::MIN_POSITIVE);
            let widened = (width.max(f64::MIN_POSITIVE) / width_then.max(f64::MIN_POSITIVE)).ln().abs();
            // NaN, of a parameter that was not there, is no small change.
            shift = if moved <= shift { shift } else { moved };
            spread = if widened <= spread { spread } else { widened };
        }
    }
    let part = |name: &str, value: f64, tolerance: f64, is_met: bool| Criterion {
        is_part: true,
        ..Criterion::new(name, value.min(UNKNOWN), tolerance, is_met)
    };
    let below = |name, value: f64, tolerance| part(name, value, tolerance, value <= tolerance);
    let z = summary.proof_z.unwrap_or(f64::INFINITY);
    let is_chance = summary.proof_p.is_some_and(|p| p >= CHANCE);
    let scatters = summary.rmse.is_some_and(|rmse| rmse > SCATTERS);
    let tolerance = if scatters { scattered_ignorance(summary) } else { IGNORANCE };
    let ignorance = summary.ignorance.unwrap_or(f64::INFINITY);
    let mut parts = vec![
        part("ignorance", ignorance, tolerance, ignorance <= tolerance || scatters && is_known(summary)),
        below("shift", shift, SHIFT),
        below("spread", spread, SPREAD),
        part("proof", z, PROOF, z <= PROOF || is_chance),
    ];
    if let Some(error) = summary.scatter_error {
        parts.push(below("scatter", error, SCATTER));
    }
    let open = parts.iter().filter(|part| !part.is_met).count();
    parts.push(Criterion::new("settled", open as f64, 0.0, open == 0));
    parts
}

fn runs_a_parameter(summary: &Summary) -> f64 {
    summary.runs.unwrap_or(0.0) / summary.varied().count().max(1) as f64
}

fn scattered_ignorance(summary: &Summary) -> f64 {
    let (least, runs) = SCATTERED_IGNORANCE;
    let tolerance = least * (runs_a_parameter(summary) / runs).max(1.0).sqrt();
    if is_unfit(summary) { tolerance.max(UNFIT_IGNORANCE) } else { tolerance }
}

/// Whether the best fit is worse than chance.
fn is_unfit(summary: &Summary) -> bool {
    chi_square(summary).is_some_and(|(_, _, p)| p < UNLIKELY)
}

/// Whether what tens of further runs could take from the standard deviations is little.
fn is_known(summary: &Summary) -> bool {
    let (share, runs) = KNOWN;
    runs_a_parameter(summary) >= runs && summary.known_sd.is_some_and(|known| known >= share)
}

/// Share of its value before, below which an estimated noise is still falling.
const SETTLED: f64 = 0.8;

/// Whether the noise is known, or its estimate has not fallen since the iteration before.
fn noise_is_settled(summary: &Summary, previous: &Previous) -> bool {
    match previous {
        _ if summary.best_misfit_over_noise.is_some() => true,
        Previous::NotAsked => true,
        Previous::First => false,
        Previous::Iteration(before) => {
            summary.sigma_noise.zip(before.sigma_noise).is_some_and(|(now, then)| now >= SETTLED * then)
        }
    }
}

/// The best run has come to rest where its misfit has fallen by no more than this share since the iteration before.
const RESTING: f64 = 0.1;

/// Whether the best run fits hardly better than that of the iteration before.
fn is_at_rest(summary: &Summary, previous: &Previous) -> bool {
    match previous {
        Previous::NotAsked => true,
        Previous::First => false,
        Previous::Iteration(before) => summary
            .best_misfit
            .zip(before.best_misfit)
            .is_some_and(|(now, then)| now >= (1.0 - RESTING) * then),
    }
}

/// The best run misses by more than this share of the observables' range: the fit is bad.
const BAD_ERROR: f64 = 0.1;

/// A posterior that has shrunk by less than this has learned little; of a dozen effective runs the standard
/// deviation is known to a fifth.
const BLIND: f64 = 0.5;

/// Probability below which a χ² is too large or too small to be chance.
const UNLIKELY: f64 = 0.002;

/// What a calibration that stops by `criteria` concludes, a row a conclusion: `stop`, and then what speaks
/// against trusting it: `single-sample`, `unsettled`, `sigma-above-noise`, `bad-fit`, `noise-too-large`, `few-runs`, `blind` and
/// `leans`.
/// Nothing where no criterion is met.
pub fn verdicts(summary: &Summary, criteria: &[Criterion]) -> Verdicts {
    let mut verdicts = Verdicts::default();
    let met: Vec<&str> =
        criteria.iter().filter(|c| c.is_met && !c.is_part).map(|c| c.name.as_str()).collect();
    if met.is_empty() {
        return verdicts;
    }
    verdicts.add("stop", met.join(","), format!("stop, by {}", met.join(" and ")));
    if met == ["best_error"] {
        let best = summary.best_sample.as_deref().unwrap_or("the best");
        let rest = summary.ensemble_error.unwrap_or(f64::NAN);
        verdicts.add(
            "single-sample",
            best,
            format!(
                "the stop is by a single sample, {best}; the weighted runs together miss by {:.2} % of the range",
                100.0 * rest
            ),
        );
    }
    if criteria.iter().any(|c| c.name == "settled" && !c.is_met) {
        let open: Vec<String> = criteria
            .iter()
            .filter(|c| c.is_part && !c.is_met && c.value < UNKNOWN)
            .map(|c| format!("{} is {:.2} where {} is asked", c.name, c.value, c.tolerance))
            .collect();
        let why =
            if open.is_empty() { "no batch has been held against it".to_owned() } else { open.join(", ") };
        verdicts.add(
            "unsettled",
            open.len(),
            format!("the posterior is not settled: {why}; more iterations may change it"),
        );
    }
    let noise = criteria.iter().find(|c| c.name == "sigma_noise");
    let times = noise.map(|noise| noise.value / noise.tolerance);
    if let Some(times) = times.filter(|times| *times > 1.0 + 1e-9 && times.is_finite()) {
        verdicts.add(
            "sigma-above-noise",
            times,
            format!("sigma is still {times:.3} times that of the noise: the posterior may change with more iterations"),
        );
    }
    fit_verdicts(summary, &mut verdicts);
    few_runs_verdict(summary, &mut verdicts);
    parameter_verdicts(summary, &mut verdicts);
    verdicts
}

/// What a user should know of weights before trusting them: `few-runs`, and `leans` for each parameter that does.
pub fn weights_verdicts(summary: &Summary) -> Verdicts {
    let mut verdicts = Verdicts::default();
    few_runs_verdict(summary, &mut verdicts);
    leaning_verdicts(&summary.parameters, &mut verdicts);
    verdicts
}

fn few_runs_verdict(summary: &Summary, verdicts: &mut Verdicts) {
    if let Some(runs) = summary.few_runs() {
        let text =
            format!("the weight rests on {runs:.1} runs; take the means as rough, the intervals are widened");
        verdicts.add("few-runs", runs, text);
    }
}

/// Whether the fit is as good as the noise allows.
fn fit_verdicts(summary: &Summary, verdicts: &mut Verdicts) {
    let error = if summary.draws.is_some() { summary.ensemble_error } else { summary.best_error };
    let test = chi_square(summary);
    // Draws are held against their noise, whatever that makes of the range.
    let is_tested = summary.draws.is_some() && test.is_some();
    if let Some(error) = error.filter(|error| *error > BAD_ERROR && !is_tested) {
        let who = if summary.draws.is_some() { "the draws miss" } else { "the best run misses" };
        verdicts.add(
            "bad-fit",
            error,
            format!("the fit is bad: {who} by {:.0} % of the range", 100.0 * error),
        );
    }
    if let Some(correlation) = summary.alternation {
        let text = format!("the fit is bad: what it leaves {}", alternation(correlation));
        verdicts.add("bad-fit", correlation, text);
    }
    let Some((value, degrees, p)) = test else { return };
    let on = format!("χ² {value:.0} on {degrees:.0} degrees of freedom");
    if p < UNLIKELY {
        let text =
            format!("the fit is bad: {on}, which noise alone exceeds with a probability of {}", said(p));
        verdicts.add("bad-fit", value / degrees, text);
    } else if 1.0 - p < UNLIKELY && summary.draws.is_none() {
        // Who draws says it himself, and knows whether the noise is correlated.
        let text =
            format!("the fit is better than the noise explains: {on}; is the noise smaller than stated?");
        verdicts.add("noise-too-large", value / degrees, text);
    }
}

/// χ² of the best fit where the noise is known, its degrees of freedom, and the probability of a larger one:
/// readings, less as many as the parameters that the measurement decides, Σ shrinkage.
fn chi_square(summary: &Summary) -> Option<(f64, f64, f64)> {
    if let (Some(value), Some(degrees), Some(p)) =
        (summary.chi_square, summary.chi_square_degrees, summary.chi_square_p)
    {
        return Some((value, degrees, p));
    }
    let (value, times) = (summary.best_misfit?, summary.best_misfit_over_noise?);
    let decided: f64 = summary.varied().filter_map(|p| p.shrinkage).map(|s| s.clamp(0.0, 1.0)).sum();
    let degrees = (value / times - decided).max(1.0);
    (times > 0.0 && degrees.is_finite()).then(|| (value, degrees, of_misfit(value, degrees)))
}

/// What the measurement could not tell, and what leans on a bound.
fn parameter_verdicts(summary: &Summary, verdicts: &mut Verdicts) {
    for parameter in &summary.parameters {
        let name = &parameter.name;
        if let Some(shrinkage) = parameter.shrinkage.filter(|shrinkage| *shrinkage < BLIND) {
            let left = (1.0 - shrinkage).sqrt();
            verdicts.add(
                "blind",
                name,
                format!(
                    "the measurement says little of {name}: its standard deviation is {left:.2} times what it was before"
                ),
            );
        }
    }
    leaning_verdicts(&summary.parameters, verdicts);
}

/// `leans`, for each parameter whose posterior leans on a bound.
pub fn leaning_verdicts(parameters: &[ParameterSummary], verdicts: &mut Verdicts) {
    for parameter in parameters {
        if let Some(side) = parameter.leaning_side() {
            let name = &parameter.name;
            verdicts.add(
                "leans",
                name,
                format!("{name} leans on its {side} bound; the truth may lie outside"),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::summary::ParameterSummary;

    #[test]
    fn sigma_need_not_fall_below_what_the_best_run_leaves_once_that_has_come_to_rest() {
        let summary = |sigma: f64, misfit: f64| Summary {
            sigma: Some(sigma),
            best_misfit: Some(misfit),
            best_misfit_over_noise: Some(misfit / 100.0),
            ..Summary::default()
        };
        let is_met = |now: Summary, previous: Previous| {
            let tolerances = Tolerances { misfit: Some(1.0), ..Tolerances::default() };
            let found = criteria(&now, &tolerances, None, &previous).unwrap();
            found.iter().find(|criterion| criterion.name == "sigma_misfit").unwrap().is_met
        };
        let before = |misfit: f64| Previous::Iteration(Box::new(summary(50.0, misfit)));
        assert!(is_met(summary(9.0, 1000.0), before(1050.0)));
        assert!(!is_met(summary(11.0, 1000.0), before(1050.0)), "sharper weights would still tell more");
        assert!(!is_met(summary(9.0, 1000.0), before(1200.0)), "the best run still gets better");
        assert!(!is_met(summary(9.0, 1000.0), Previous::First));
    }

    #[test]
    fn where_runs_scatter_a_bad_fit_need_not_be_sharp() {
        let is_met = |ignorance: f64, p: f64, rmse: f64| {
            let summary = Summary {
                runs: Some(50.0),
                ignorance: Some(ignorance),
                known_sd: Some(0.5),
                rmse: Some(rmse),
                chi_square: Some(300.0),
                chi_square_degrees: Some(100.0),
                chi_square_p: Some(p),
                parameters: vec![ParameterSummary { name: "a".into(), ..ParameterSummary::default() }],
                ..Summary::default()
            };
            settled(&summary, &Previous::NotAsked).iter().find(|of| of.name == "ignorance").unwrap().is_met
        };
        assert!(is_met(0.9, 1e-9, 0.8));
        assert!(!is_met(1.1, 1e-9, 0.8));
        assert!(!is_met(0.9, 0.1, 0.8), "it fits, and what is asked is how sharp it can be");
        assert!(!is_met(0.9, 1e-9, 0.1), "they do not scatter: a few more runs tell");
    }

    #[test]
    fn where_runs_scatter_many_of_them_need_only_leave_the_widths_nearly_known() {
        let is_met = |runs: f64, known: f64, rmse: f64| {
            let parameter = |name: &str| ParameterSummary {
                name: name.into(),
                mean: Some(0.0),
                shrinkage: Some(0.5),
                sd: Some(1.0),
                ..ParameterSummary::default()
            };
            let summary = Summary {
                runs: Some(runs),
                ignorance: Some(0.7),
                known_sd: Some(known),
                rmse: Some(rmse),
                parameters: vec![parameter("a"), parameter("b")],
                ..Summary::default()
            };
            settled(&summary, &Previous::NotAsked).iter().find(|of| of.name == "ignorance").unwrap().is_met
        };
        assert!(is_met(80.0, 0.86, 0.8));
        assert!(!is_met(78.0, 0.86, 0.8), "few runs may bring much yet");
        assert!(!is_met(80.0, 0.84, 0.8), "what is not known widens the posterior");
        assert!(!is_met(80.0, 0.86, 0.1), "they do not scatter");
    }

    #[test]
    fn a_spread_is_that_of_the_width_where_both_batches_have_one() {
        let summary = |sd: f64, width: Option<f64>| Summary {
            ignorance: Some(0.1),
            parameters: vec![ParameterSummary {
                name: "a".into(),
                mean: Some(1.0),
                sd: Some(sd),
                shrinkage: Some(0.5),
                width,
                ..ParameterSummary::default()
            }],
            ..Summary::default()
        };
        let is_met = |(sd, width): (f64, Option<f64>), (sd_then, width_then): (f64, Option<f64>)| {
            let before = Previous::Iteration(Box::new(summary(sd_then, width_then)));
            let criteria = settled(&summary(sd, width), &before);
            criteria.iter().find(|of| of.name == "spread").unwrap().is_met
        };
        assert!(
            is_met((2.0, Some(0.1)), (1.0, Some(0.1))),
            "over decades the standard deviation of values is a few draws'"
        );
        assert!(!is_met((1.0, Some(0.2)), (1.0, Some(0.1))));
        assert!(is_met((1.0, Some(0.2)), (1.0, None)), "a width is compared with a width alone");
        assert!(!is_met((2.0, None), (1.0, None)));
    }
}
