//! A diagnosis in a few sentences that a user can act on.

use anyhow::Result;

use crate::attribute::attribution::Explanation;
use crate::attribute::confounding::difference;
use crate::attribute::diagnosis::{Diagnosis, shrink};
use crate::attribute::marginals::marginals;
use crate::attribute::model::Model;
use crate::attribute::problem::Problem;

/// Below this probability a hypothesis is not settled.
const SETTLED: f64 = 0.8;

/// Above this share of noise and scatter what the emulator does not know widens a verdict.
const IGNORANT: f64 = 0.5;

/// Root mean square over all readings of what the emulator does not know where an explanation fits best, in
/// units of noise and scatter.
fn ignorance(problem: &Problem<'_>, explanation: &Explanation) -> f64 {
    let model = Model::new(problem, &explanation.hypothesis, false);
    let w = explanation.evidence.modes[0].w.as_slice();
    let (noise, _) = model.nuisances(w);
    let errors = problem.emulator_errors(&model.curve(w).variance);
    let square =
        |i: usize| errors.row(i).norm_squared() / problem.spread(i / problem.steps(), &noise).powi(2);
    ((0..errors.nrows()).map(square).sum::<f64>() / errors.nrows() as f64).sqrt()
}

/// The verdict, one sentence or two an item.
///
/// # Errors
/// If the predicted shrink cannot be computed.
pub fn verdict(problem: &Problem<'_>, diagnosis: &Diagnosis, seed: u64) -> Result<Vec<String>> {
    let percent = |share: f64| (100.0 * share).round();
    let explanations = &diagnosis.attribution.explanations;
    let first = &diagnosis.rows[0];
    let mut lines = Vec::new();
    if let Some(base) = diagnosis.rows.iter().find(|row| row.name == "none") {
        lines.push(format!(
            "the calibrated base model misses the measurement by {:.2} % of its range; noise and scatter alone would give {:.2} %",
            100.0 * base.gap,
            100.0 * diagnosis.floor
        ));
    }
    match (first.name.as_str(), first.explanation) {
        ("none", _) => lines.push(format!(
            "no effect is needed: the base model explains the measurement, probability {:.2}",
            first.probability
        )),
        (_, None) => lines.push(format!(
            "none of the candidates explains the measurement: something else is at work, probability {:.2}; the nearest candidate is {}, which is no answer",
            first.probability, diagnosis.attribution.nearest
        )),
        (name, Some(place)) => {
            let closes = shrink(problem, explanations, &explanations[place], seed)?;
            lines.push(format!("{name} explains it: probability {:.2}", first.probability));
            let (low, high) = (percent(closes.low), percent(closes.high));
            let interval = if low == high { String::new() } else { format!(" ({low} to {high} %)") };
            lines.push(format!("adding it should close {} %{interval} of the gap", percent(closes.median)));
        }
    }
    if let Some(place) = first.explanation {
        for marginal in marginals(problem, &explanations[place]).iter().filter(|marginal| marginal.lean != 0)
        {
            let side = if marginal.lean < 0 { "lower" } else { "upper" };
            lines.push(format!("{} leans on its {side} bound: the truth may lie outside", marginal.name));
        }
    }
    let ignorance = ignorance(problem, &explanations[first.explanation.unwrap_or(0)]);
    if ignorance > IGNORANT {
        lines.push(format!(
            "at the best fit the emulator is uncertain by {ignorance:.1} times noise and scatter: further runs there, --next-out, would make the verdict sharper"
        ));
    }
    let second = &diagnosis.rows[1];
    if first.probability < SETTLED {
        lines.push(format!(
            "not settled: next comes {} with probability {:.2}",
            second.name, second.probability
        ));
    }
    // The rival that a further measurement should tell from the first: one that it is confounded
    // with, else the next in line.
    let rival = first.confounded.first().or((first.probability < SETTLED).then_some(&second.name));
    let explanation = |name: &String| explanations.iter().find(|explanation| explanation.name == *name);
    if let (Some(one), Some(other)) =
        (first.explanation.map(|place| &explanations[place]), rival.and_then(explanation))
    {
        if !first.confounded.is_empty() {
            lines.push(format!(
                "this measurement cannot tell {} from {}",
                first.name,
                first.confounded.join(", ")
            ));
        }
        if let Some(at) = difference(problem, one, other) {
            lines.push(format!(
                "{} and {} differ most in {} at {} from {:.3} to {:.3}, by {:.1} standard deviations of a reading: measure there again, or beyond",
                one.name,
                other.name,
                at.observable,
                problem.control_name,
                at.from,
                at.to,
                at.height
            ));
        }
    }
    Ok(lines)
}
