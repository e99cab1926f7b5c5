//! Which runs to make next: where the hypotheses that are in question put the parameters.

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::gap::attribute::attribution::Explanation;
use crate::gap::attribute::hypothesis::ln_prior_odds;
use crate::gap::attribute::model::Model;
use crate::gap::attribute::problem::Problem;
use crate::prior::{normal_cdf, normal_quantile};
use crate::sequence::{self, Method};
use crate::statistics::moments;

/// What the odds of a hypothesis are raised to: those that a better emulator may yet favour get runs, too.
const FLATTENED: f64 = 0.5;

/// Hypotheses that would get a smaller share of the runs than this get none.
const LEAST_SHARE: f64 = 0.02;

/// Runs are drawn from a normal distribution this many times as wide as the posterior: the runs so far may
/// have misplaced it.
const WIDER: f64 = 1.5;

/// Largest normal score of a parameter: 0.6 % of the prior lie beyond on either side.
const FURTHEST: f64 = 2.5;

/// Parameters of `count` runs that would teach an emulator most about this measurement, shape (count,
/// parameters): from the posteriors of all hypotheses that are not out of the question, widened.
///
/// # Errors
/// If a posterior has no covariance.
pub fn next_runs(
    problem: &Problem<'_>,
    explanations: &[Explanation],
    count: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>> {
    let mut runs = Vec::with_capacity(count);
    for (place, share) in shares(problem, explanations, count).into_iter().enumerate() {
        if share > 0 {
            runs.extend(draw(problem, &explanations[place], share, seed + place as u64)?);
        }
    }
    Ok(runs)
}

/// How many runs each explanation gets.
fn shares(problem: &Problem<'_>, explanations: &[Explanation], count: usize) -> Vec<usize> {
    let ln_odds = |of: &Explanation| of.evidence.ln + ln_prior_odds(&of.hypothesis, problem.candidates.len());
    let highest = explanations.iter().map(ln_odds).fold(f64::NEG_INFINITY, f64::max);
    let mut weights: Vec<f64> =
        explanations.iter().map(|of| (FLATTENED * (ln_odds(of) - highest)).exp()).collect();
    let whole: f64 = weights.iter().sum();
    weights.iter_mut().filter(|weight| **weight < LEAST_SHARE * whole).for_each(|weight| *weight = 0.0);
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

/// Draw runs from the widened posterior of one explanation.
fn draw(problem: &Problem<'_>, of: &Explanation, count: usize, seed: u64) -> Result<Vec<Vec<f64>>> {
    let free = Model::new(problem, &of.hypothesis, false).simulated_parameters().to_vec();
    let dimensions = free.len();
    let scores: Vec<DVector<f64>> =
        of.evidence.samples.iter().map(|w| DVector::from_column_slice(&w[..dimensions])).collect();
    let (mean, covariance) = moments(&scores, &of.evidence.weights);
    let wider = covariance * (WIDER * WIDER) + DMatrix::identity(dimensions, dimensions) * 1e-8;
    let factor = Cholesky::new(wider).context("a posterior without a covariance")?.unpack();
    let parameters = problem.prior.parameters();
    let run = |point: &Vec<f64>| {
        let normal = DVector::from_iterator(dimensions, point.iter().map(|&u| normal_quantile(u)));
        let w = &mean + &factor * normal;
        let mut values = problem.prior.with_effects_off();
        for (&j, w) in free.iter().zip(w.iter()) {
            values[j] = parameters[j].quantile(normal_cdf(w.clamp(-FURTHEST, FURTHEST)));
        }
        values
    };
    Ok(sequence::points(Method::Halton, count, dimensions, Some(seed))?.iter().map(run).collect())
}
