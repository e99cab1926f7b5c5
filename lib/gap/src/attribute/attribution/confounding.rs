//! Which hypotheses the measurement cannot tell apart, and where a further one could.

use std::collections::HashSet;

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::attribute::attribution::{Explanation, RuledOut};
use crate::attribute::evidence::model::Model;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::is_part;

/// What one hypothesis adds to the base model's curve is imitated by another when the cosine between
/// them is above this …
const PARALLEL: f64 = 0.9;
/// … and what it cannot imitate is below this many standard deviations in all.
const INDISTINCT: f64 = 3.0;
/// Hypotheses less probable than this are none that the measurement cannot tell from another.
const ALIVE: f64 = 0.005;
/// Names at most.
const MOST: usize = 4;

/// Where two hypotheses differ most.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The observable.
    pub observable: usize,
    /// The steps of its test.
    pub steps: std::ops::Range<usize>,
    /// Largest difference there, in standard deviations of noise and scatter.
    pub height: f64,
}

/// The fitted curve of a hypothesis, and what its parameters can still change about it.
pub(super) struct Curve {
    mean: DVector<f64>,
    slopes: DMatrix<f64>,
}

/// For each explanation, the places of those that it is confounded with, nearest first.
///
/// A hypothesis S, as fitted, adds something to the curve that the base model as fitted to the same
/// measurement cannot absorb. T imitates it when T's fitted curve, moved as far as its own parameters
/// allow, comes nearly as close: |c_S − c_T|² = (1 − cos²) |c_S − c_none|², all in the metric of the
/// measurement's precision. Hypotheses with more effects, parts of S, and what is out of the question are not
/// listed. Something unknown that comes first has no curve of its own: see [`as_likely`].
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn confounded(problem: &Problem<'_>, explanations: &[Explanation]) -> Result<Vec<Vec<usize>>> {
    let base =
        explanations.iter().position(Explanation::is_base).context("no hypothesis without an effect")?;
    let is_alive = |place: usize| explanations[place].probability >= ALIVE;
    let curves: Vec<Option<Curve>> = (0..explanations.len())
        .map(|place| (place == base || is_alive(place)).then(|| curve(problem, &explanations[place])))
        .collect();
    let near = |s: usize| -> Result<Vec<usize>> {
        let explanation = &explanations[s];
        if s == 0 && explanation.is_unknown() {
            return Ok(as_likely(explanations, explanation));
        }
        let (Some(own), Some(of_base)) = (&curves[s], &curves[base]) else { return Ok(Vec::new()) };
        if explanation.hypothesis.is_empty() || !is_alive(s) {
            return Ok(Vec::new());
        }
        let model = explanation.model(problem).plain();
        let metric = (&model, explanation.best());
        let whole = distance(metric, (own, of_base))?;
        if whole < 1.0 {
            return Ok(Vec::new());
        }
        let mut near = Vec::new();
        for (t, other) in explanations.iter().enumerate().filter(|(t, _)| is_alive(*t)) {
            let has_it = is_part(&other.hypothesis, &explanation.hypothesis);
            let is_larger = other.hypothesis.len() > explanation.hypothesis.len();
            if has_it || is_larger || other.has_rest != explanation.has_rest {
                continue;
            }
            let Some(theirs) = &curves[t] else { continue };
            let rest = distance(metric, (own, theirs))?;
            if rest < INDISTINCT && 1.0 - (rest / whole).powi(2) > PARALLEL * PARALLEL {
                near.push((rest, t));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(near.into_iter().take(MOST).map(|(_, t)| t).collect())
    };
    (0..explanations.len()).map(near).collect()
}

/// The single effects that close half of the gap or more, and with which, beside a rest or not, the measurement is as likely
/// as with something unknown alone, or nearly as likely where they close nearly all, likeliest first: only what was believed
/// beforehand tells them apart.
fn as_likely(explanations: &[Explanation], unknown: &Explanation) -> Vec<usize> {
    let is_as_likely = |of: &Explanation| {
        of.hypothesis.len() == 1
            && !matches!(of.ruled_out, Some(RuledOut::Misfit | RuledOut::Invisible))
            && of.closes_most()
            && (of.is_as_likely_as(unknown) || of.is_nearly_as_likely_as(unknown))
    };
    let mut places: Vec<usize> =
        (0..explanations.len()).filter(|&place| is_as_likely(&explanations[place])).collect();
    places.sort_by(|&a, &b| explanations[b].evidence.ln.total_cmp(&explanations[a].evidence.ln));
    // With a rest and without is one effect.
    let mut seen = HashSet::new();
    places.retain(|&place| seen.insert(explanations[place].hypothesis[0]));
    places.truncate(MOST);
    places
}

pub(super) fn curve(problem: &Problem<'_>, explanation: &Explanation) -> Curve {
    let (mean, slopes) = explanation.model(problem).gradient(explanation.best());
    Curve { mean: DVector::from_vec(mean), slopes }
}

/// What is left of the difference of two curves when the parameters of the second are moved to make it
/// small, in standard deviations of the measurement.
fn distance(metric: (&Model<'_>, &[f64]), curves: (&Curve, &Curve)) -> Result<f64> {
    let none = vec![0.0; metric.0.problem().predictor.basis().ncols()];
    Ok(square_distance(metric, curves, &none, 1.0)?.sqrt())
}

/// The square of it where there are so many such measurements, and the simulation's components are known to these
/// variances; the noise is that of a model without a rest at these parameters.
pub(super) fn square_distance(
    (model, w): (&Model<'_>, &[f64]),
    (one, other): (&Curve, &Curve),
    variance: &[f64],
    measurements: f64,
) -> Result<f64> {
    let w = &w[..model.len()];
    let columns = DMatrix::from_fn(one.mean.len(), 1 + other.slopes.ncols(), |i, k| {
        if k == 0 { one.mean[i] - other.mean[i] } else { other.slopes[(i, k - 1)] }
    });
    // (S / n + V)⁻¹ = n (S + n V)⁻¹, S of one measurement and V of the simulation.
    let variance: Vec<f64> = variance.iter().map(|variance| measurements * variance).collect();
    let solved = model.with_covariance(w, &variance, |covariance| covariance.solve(&columns))?;
    let product = measurements * columns.tr_mul(&solved);
    let moved = other.slopes.ncols();
    // Moving is held back by the prior, whose unit is one.
    let inner = product.view((1, 1), (moved, moved)) + DMatrix::identity(moved, moved);
    let cross = product.view((1, 0), (moved, 1)).into_owned();
    let factor = Cholesky::new(inner).context("the slopes of the curve are not finite")?;
    Ok((product[(0, 0)] - cross.dot(&factor.solve(&cross))).max(0.0))
}

/// Where the curves of two explanations differ most for their noise: the fifth of the steps of one
/// observable with the largest sum of squares.
pub fn difference(problem: &Problem<'_>, one: &Explanation, other: &Explanation) -> Option<Difference> {
    let scales = one.model(problem).nuisances(one.best()).scales;
    let apart: Vec<f64> = one
        .evidence
        .mean
        .iter()
        .zip(&other.evidence.mean)
        .enumerate()
        .map(|(i, (a, b))| (a - b) / problem.spread(problem.observable_of(i), &scales))
        .collect();
    let mut best: Option<(f64, usize, std::ops::Range<usize>)> = None;
    for (j, block) in problem.blocks().into_iter().enumerate() {
        let apart = &apart[block];
        let window = (apart.len() / 5).max(1);
        for start in 0..=apart.len() - window {
            let sum: f64 = apart[start..start + window].iter().map(|d| d * d).sum();
            if best.as_ref().is_none_or(|(most, _, _)| sum > *most) {
                best = Some((sum, j, start..start + window));
            }
        }
    }
    let (_, observable, steps) = best?;
    let first = problem.own(observable).start;
    let inside = &apart[first + steps.start..first + steps.end];
    Some(Difference {
        observable,
        steps: steps.clone(),
        height: inside.iter().map(|d| d.abs()).fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::evidence::Evidence;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn something_unknown_that_comes_first_is_confounded_with_an_effect_as_likely_that_closes_most() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
        explanations.sort_by_key(|of| !of.is_unknown());
        let place = explanations.iter().position(|of| of.name == "wave+unexplained").unwrap();
        let confounded_by = |ahead: f64, closes: f64, alone: f64, ruled_out: Option<RuledOut>| {
            let mut all = explanations.clone();
            let unknown = all[0].evidence.ln;
            all.iter_mut().skip(1).for_each(|of| of.evidence.ln = unknown - 50.0);
            for (of, ahead) in [("wave", alone), ("wave+unexplained", ahead)] {
                let of = all.iter_mut().find(|other| other.name == of).unwrap();
                (of.evidence.ln, of.closes, of.ruled_out) = (unknown + ahead, closes, ruled_out);
            }
            confounded(&problem, &all).unwrap().remove(0)
        };
        assert_eq!(confounded_by(0.5, 0.6, -9.0, None), [place]);
        // Of the effect with a rest and without the one that is likelier.
        let alone = explanations.iter().position(|of| of.name == "wave").unwrap();
        assert_eq!(confounded_by(0.5, 0.6, 1.0, None), [alone]);
        assert!(confounded_by(-0.5, 0.6, -9.0, None).is_empty());
        // One that closes nearly all need not be quite as likely.
        assert_eq!(confounded_by(-2.5, 0.85, -9.0, None), [place]);
        assert!(confounded_by(-3.5, 0.85, -9.0, None).is_empty());
        // Still less where a rest jumps that has to imitate it.
        let mut jumping = explanations.clone();
        jumping[0].singular.jumps = vec![3];
        let with = |of: &Explanation, ahead: f64| {
            let ln = jumping[0].evidence.ln + ahead;
            Explanation { closes: 0.85, evidence: Evidence { ln, ..of.evidence.clone() }, ..of.clone() }
        };
        assert!(with(&jumping[place], -3.5).is_nearly_as_likely_as(&jumping[0]));
        assert!(!with(&jumping[place], -6.5).is_nearly_as_likely_as(&jumping[0]));
        assert!(confounded_by(0.5, 0.4, -9.0, None).is_empty());
        assert!(confounded_by(0.5, 0.6, -9.0, Some(RuledOut::Misfit)).is_empty());
    }
}
