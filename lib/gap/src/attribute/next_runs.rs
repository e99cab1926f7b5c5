//! Which runs to make next: where the hypotheses that are in question put the parameters.

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::attribute::attribution::untried::Untried;
use crate::attribute::attribution::{Explanation, RuledOut};
use crate::attribute::evidence::mode::Mode;
use crate::attribute::full_strength::{at_full_strength, furthest};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{is_part, ln_prior_odds};
use gl_inference::prior::normal_quantile;
use gl_numeric::sequence::{self, Method};
use gl_numeric::statistics::moments;

/// What the odds of a hypothesis are raised to: those that a better emulator may yet favour get runs, too.
const FLATTENED: f64 = 0.25;

/// Hypotheses that would get a smaller share of the runs than this get none, unless the first contains them.
const LEAST_SHARE: f64 = 0.02;

/// Weight at least, beside that of all others together, of what the first hypothesis contains, `none` among
/// it: what is simpler must not lose by an emulator that nobody has tried there.
const SIMPLER: f64 = 0.2;

/// Weight of all effects that the emulator knows too little of together, beside that of all others.
const UNTRIED: f64 = 4.0;

/// Runs are drawn from a normal distribution this many times as wide as the posterior: the runs so far may
/// have misplaced it.
const WIDER: f64 = 1.5;

/// Share of the runs at most that show effects at full strength.
const AT_FULL_STRENGTH: usize = 3;

/// Parameters of `count` runs that would teach an emulator most about this measurement, shape (count,
/// parameters): what effects do at full strength, and from the posteriors, widened, of all hypotheses that are not out of the
/// question, that the first one contains, or of whose effect the emulator knows too little.
///
/// * `made` — parameters of the runs so far, shape (runs, parameters).
///
/// # Errors
/// If a posterior has no covariance.
pub fn next_runs(
    problem: &Problem<'_>,
    explanations: &[Explanation],
    untried: &[Untried],
    made: &[Vec<f64>],
    (count, seed): (usize, u64),
) -> Result<Vec<Vec<f64>>> {
    let mut runs = at_full_strength(problem, explanations, made);
    runs.truncate(count / AT_FULL_STRENGTH);
    let left = count - runs.len();
    for (place, share) in shares(explanations, untried, left).into_iter().enumerate() {
        if share > 0 {
            let of = &explanations[place];
            let untried = untried.iter().find(|untried| untried.place == place);
            let elsewhere = untried.and_then(|untried| untried.elsewhere.as_ref());
            let where_at = elsewhere.map_or_else(|| posterior(problem, of), |mode| about(problem, of, mode));
            runs.extend(draw(problem, of, where_at, share, seed + place as u64)?);
        }
    }
    Ok(runs)
}

/// How many runs each explanation gets.
fn shares(explanations: &[Explanation], untried: &[Untried], count: usize) -> Vec<usize> {
    let is_visible = |of: &&Explanation| of.ruled_out != Some(RuledOut::Invisible);
    let singles = explanations.iter().filter(|of| of.hypothesis.len() == 1 && !of.has_rest);
    let visible = singles.filter(is_visible).count();
    let ln_odds: Vec<f64> = explanations
        .iter()
        .map(|of| match of.ruled_out {
            Some(RuledOut::Invisible) => f64::NEG_INFINITY,
            _ => of.evidence.ln + ln_prior_odds(&of.hypothesis, of.has_rest, visible),
        })
        .collect();
    let Some(first) = (0..ln_odds.len()).max_by(|&a, &b| ln_odds[a].total_cmp(&ln_odds[b])) else {
        return Vec::new();
    };
    // With a rest and without, a set of effects asks for the same runs, but for what the rest does to it.
    let is_better_twin = |place: usize| {
        let of = &explanations[place];
        (0..ln_odds.len()).all(|other| {
            explanations[other].hypothesis != of.hypothesis
                || other == place
                || (ln_odds[place], other) > (ln_odds[other], place)
        })
    };
    let is_better_twin: Vec<bool> = (0..ln_odds.len()).map(is_better_twin).collect();
    let flatten = |(ln, is_better): (&f64, &bool)| {
        if *is_better { (FLATTENED * (ln - ln_odds[first])).exp() } else { 0.0 }
    };
    let flattened: Vec<f64> = ln_odds.iter().zip(&is_better_twin).map(flatten).collect();
    let whole: f64 = flattened.iter().sum();
    let weight = |(of, &weight): (&Explanation, &f64)| {
        if weight == 0.0 {
            0.0
        } else if is_part(&of.hypothesis, &explanations[first].hypothesis) {
            weight.max(SIMPLER * whole)
        } else if weight < LEAST_SHARE * whole {
            0.0
        } else {
            weight
        }
    };
    let mut weights: Vec<f64> = explanations.iter().zip(&flattened).map(weight).collect();
    let whole: f64 = weights.iter().sum();
    for of in untried {
        weights[of.place] += UNTRIED * whole / untried.len() as f64;
    }
    let whole: f64 = weights.iter().sum();
    // Systematic: the sums up to each explanation, rounded, so that none is more than one off its share.
    let mut sum = 0.0;
    let mut given = 0;
    weights
        .iter()
        .map(|weight| {
            sum += weight / whole;
            let until = (count as f64 * sum).round() as usize;
            let share = until - given;
            given = until;
            share
        })
        .collect()
}

/// Mean and covariance of normal scores.
type Normal = (DVector<f64>, DMatrix<f64>);

/// The posterior of the simulation's parameters under an explanation.
fn posterior(problem: &Problem<'_>, of: &Explanation) -> Normal {
    let dimensions = of.model(problem).simulated_parameters().len();
    let scores: Vec<DVector<f64>> =
        of.evidence.samples.iter().map(|w| DVector::from_column_slice(&w[..dimensions])).collect();
    moments(&scores, &of.evidence.weights)
}

/// The same about a mode.
fn about(problem: &Problem<'_>, of: &Explanation, mode: &Mode) -> Normal {
    let dimensions = of.model(problem).simulated_parameters().len();
    let covariance = mode.covariance.view((0, 0), (dimensions, dimensions)).into_owned();
    (mode.w.rows(0, dimensions).into_owned(), covariance)
}

/// Draw runs of one explanation from a normal distribution, widened.
fn draw(
    problem: &Problem<'_>,
    of: &Explanation,
    (mean, covariance): Normal,
    count: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>> {
    let model = of.model(problem);
    let free = model.simulated_parameters();
    let dimensions = free.len();
    let wider = covariance * (WIDER * WIDER) + DMatrix::identity(dimensions, dimensions) * 1e-8;
    let factor = Cholesky::new(wider).context("a posterior without a covariance")?.unpack();
    let run = |point: &Vec<f64>| {
        let normal = DVector::from_iterator(dimensions, point.iter().map(|&u| normal_quantile(u)));
        let mut values = model.values((&mean + &factor * normal).as_slice());
        for &j in free {
            let parameter = &problem.prior.parameters()[j];
            let [low, high] = furthest(parameter);
            values[j] = values[j].clamp(low, high);
        }
        values
    };
    Ok(sequence::points(Method::Halton, count, dimensions, Some(seed))?.iter().map(run).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn what_the_first_hypothesis_contains_gets_runs_even_where_it_is_out_of_the_question() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.8));
        let problem = predictor.problem(&prior, &observations);
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let shares = shares(&explanations, &[], 60);
        let of = |name: &str| shares[explanations.iter().position(|of| of.name == name).unwrap()];
        assert_eq!(explanations[0].name, "wave");
        assert!(explanations.iter().filter(|of| of.hypothesis.is_empty()).all(|of| of.probability < 1e-3));
        // With a rest or without, whichever is more probable.
        let without_effect = of("none") + of("unexplained");
        assert_eq!((of("wave") + of("wave+unexplained"), without_effect, of("offset(y)")), (50, 10, 0));
    }

    #[test]
    fn where_bounds_are_wider_than_was_believed_the_runs_go_to_the_truth_too() {
        let predictor = Straight::new();
        // The truth, 1.3, within what was believed and beyond it.
        for (low, high) in [(-0.6, 4.2), (0.5, 1.1)] {
            let (prior, believed) = Straight::beyond(low, high);
            let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.8));
            let problem = predictor.problem(&prior, &observations).believing(&believed);
            let explanations = attribute(&problem, 1, 1).unwrap().explanations;
            let of = explanations.iter().find(|of| of.name == "wave").unwrap();
            let runs = draw(&problem, of, posterior(&problem, of), 40, 1).unwrap();
            let mean = runs.iter().map(|run| run[0]).sum::<f64>() / 40.0;
            assert!((mean - 1.3).abs() < 0.03, "{mean}");
        }
    }
}
