//! Whether the measurement pulls a hypothesis that matters beyond the bounds of its parameters.

use anyhow::Result;

use crate::attribute::attribution::marginals::{Marginal, marginals};
use crate::attribute::attribution::{Explanation, RuledOut};
use crate::attribute::evidence::descent::{Descent, Reach, Within, descend};
use crate::attribute::evidence::model::Meaning;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::is_part;
use gl_inference::prior::Parameter;

/// A parameter that the measurement pulls beyond a bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Lean {
    /// Name of the parameter.
    pub parameter: String,
    /// The bound, in units of the parameter.
    pub bound: f64,
    /// Whether it is the upper one.
    pub is_upper: bool,
    /// The hypothesis.
    pub hypothesis: String,
}

/// ln of the density that must be gained beyond the bounds: two standard deviations.
const GAIN: f64 = 2.0;

/// A hypothesis matters where it would be within this of the first (natural logarithm), had it what it would
/// gain, and this share of what it is behind, since beyond the runs the gain is a guess.
const MATTERS: (f64, f64) = (3.0, 0.3);

/// Several effects that hold what comes first and more leave it in: they matter where they would be this far ahead of it.
const AHEAD: f64 = 2.0;

/// Shares of the prior's width that a fit may go beyond it, and must for it to be said.
const FURTHEST: f64 = 0.6;
const LEAST: f64 = 0.02;

/// Beyond the runs a fit is a guess: few steps, and none along what the measurement hardly tells.
const REACH: Reach = Reach { steps: 4, inertia: 1.0 };

/// The parameters that the measurement pulls beyond their bounds under hypotheses that matter, those of the most
/// probable hypothesis first, each once.
///
/// Beyond the bounds the simulation is extrapolated; that an effect would rather be weaker than its bound is none
/// of them where it is off on that side, since the hypothesis without it says so. Nor does an effect count that closes
/// little: what it is without is asked by itself, `none` and `unexplained`. A bound of zero counts under what comes first
/// alone: a length, a stiffness, a share keeps its sign, so that no box goes there; what needs it otherwise is no rival, and
/// no answer either.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn leans(problem: &Problem<'_>, explanations: &[Explanation]) -> Result<Vec<Lean>> {
    let weight = |of: &Explanation| of.probability.max(of.ln_weight.exp());
    let first = explanations.iter().map(weight).fold(0.0, f64::max).max(f64::MIN_POSITIVE).ln();
    let is_asked =
        |of: &&Explanation| of.ln_weight.is_finite() && of.ruled_out != Some(RuledOut::ClosesLittle);
    let mut order: Vec<&Explanation> = explanations.iter().filter(is_asked).collect();
    let is_first = |of: &Explanation| of.says_as(&explanations[0]);
    order.sort_by(|a, b| is_first(b).cmp(&is_first(a)).then(b.ln_weight.total_cmp(&a.ln_weight)));
    let mut found: Vec<Lean> = Vec::new();
    for of in order {
        let (gain, more) = beyond(problem, of)?;
        let behind = (first - of.ln_weight).max(0.0);
        let enough =
            if adds(of, &explanations[0]) { behind + AHEAD } else { (1.0 - MATTERS.1) * behind - MATTERS.0 };
        if gain > GAIN && gain > enough {
            found.extend(more.into_iter().filter(|lean| is_first(of) || lean.bound != 0.0));
        }
    }
    // What a bound cuts off of an effect a rest makes up for, so that the fit within the bounds gains little beyond them.
    found.extend(cut_off(problem, &explanations[0]));
    let mut leans: Vec<Lean> = Vec::new();
    for lean in found {
        if !leans.iter().any(|other| (&other.parameter, other.is_upper) == (&lean.parameter, lean.is_upper)) {
            leans.push(lean);
        }
    }
    Ok(leans)
}

/// Parameters whose posterior leans on a bound, of effects beside a rest and of the base model there.
fn cut_off(problem: &Problem<'_>, of: &Explanation) -> Vec<Lean> {
    if !of.has_rest || !of.is_cause() {
        return Vec::new();
    }
    let lean = |marginal: Marginal| {
        let parameter = problem.prior.parameter(&marginal.name)?;
        let is_upper = marginal.lean > 0;
        let is_said = marginal.lean != 0 && !is_towards_off(parameter, is_upper);
        is_said.then(|| Lean {
            parameter: marginal.name,
            bound: if is_upper { parameter.upper } else { parameter.lower },
            is_upper,
            hypothesis: of.name.clone(),
        })
    };
    marginals(problem, of).into_iter().filter_map(lean).collect()
}

/// Whether an effect is off on this side of its bounds.
fn is_towards_off(parameter: &Parameter, is_upper: bool) -> bool {
    let off = parameter.off.map(|off| parameter.coordinate(off));
    off.is_some_and(|off| if is_upper { off >= 1.0 } else { off <= 0.0 })
}

/// Whether a hypothesis is of several effects that hold all of another one, which is nothing unknown, and more.
fn adds(of: &Explanation, to: &Explanation) -> bool {
    let is_more = of.hypothesis.len() > to.hypothesis.len().max(1);
    is_more && !to.is_unknown() && is_part(&to.hypothesis, &of.hypothesis)
}

/// What the density gains when a hypothesis may go beyond its bounds, and where it goes then.
fn beyond(problem: &Problem<'_>, of: &Explanation) -> Result<(f64, Vec<Lean>)> {
    let model = of.model(problem);
    let w = of.best();
    let variance = model.curve(w).variance;
    let within: Vec<Within> =
        model.simulated_parameters().iter().map(|&j| (j, -FURTHEST, 1.0 + FURTHEST)).collect();
    let Descent { point, fallen, .. } =
        model.with_covariance(w, &variance, |covariance| descend(covariance, &model, w, &within, REACH))?;
    let leans = model.meanings().into_iter().filter_map(|meaning| {
        let Meaning::Parameter(j) = meaning else { return None };
        let parameter = &problem.prior.parameters()[j];
        let (by, is_upper) = if point[j] > 0.5 { (point[j] - 1.0, true) } else { (-point[j], false) };
        let bound = if is_upper { parameter.upper } else { parameter.lower };
        (by > LEAST && !is_towards_off(parameter, is_upper)).then(|| Lean {
            parameter: parameter.name.clone(),
            bound,
            is_upper,
            hypothesis: of.name.clone(),
        })
    });
    Ok((0.5 * fallen, leans.collect()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::Straight;
    use gl_inference::prior::Prior;

    #[test]
    fn what_does_not_fit_within_the_bounds_is_asked_and_what_closes_little_is_not() {
        let (predictor, (prior, _)) = (Straight::new(), Straight::beyond(-3.0, 5.0));
        let observations = Straight::measured(5.5, 1.0, 0.0, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
        explanations.retain(|of| of.name == "none");
        explanations[0].ruled_out = Some(RuledOut::Misfit);
        let found = leans(&problem, &explanations).unwrap();
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].parameter.as_str(), found[0].bound, found[0].is_upper), ("a", 5.0, true));
        explanations[0].ruled_out = Some(RuledOut::ClosesLittle);
        assert_eq!(leans(&problem, &explanations).unwrap(), []);
    }

    #[test]
    fn an_effect_beside_a_rest_that_lies_against_its_bound_is_said() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut parameters = prior.parameters().to_vec();
        parameters[2] = Parameter { lower: 0.0, upper: 2.0, normal: None, ..parameters[2].clone() };
        let prior = Prior::new(parameters);
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        // With the effect at so many standard deviations of a standard normal, as whose quantiles the bounds count.
        let of = |name: &str, place: f64| {
            let mut of = explanations.iter().find(|of| of.name == name).unwrap().clone();
            of.evidence.samples.iter_mut().for_each(|sample| sample[2] = place);
            cut_off(&problem, &of)
        };
        let found = of("wave+unexplained", 3.0);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].parameter.as_str(), found[0].bound, found[0].is_upper), ("c", 2.0, true));
        assert_eq!(of("wave+unexplained", 0.5), []);
        // There it is off, and without a rest the fit itself would go beyond.
        assert_eq!(of("wave+unexplained", -3.0), []);
        assert_eq!(of("wave", 3.0), []);
    }

    #[test]
    fn a_base_model_that_lies_against_its_bound_beside_an_effect_and_a_rest_is_said() {
        let (predictor, (prior, _)) = (Straight::new(), Straight::beyond(-3.0, 5.0));
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let of = |name: &str, place: f64| {
            let mut of = explanations.iter().find(|of| of.name == name).unwrap().clone();
            of.evidence.samples.iter_mut().for_each(|sample| sample[0] = place);
            let leans = cut_off(&problem, &of).into_iter();
            leans.map(|lean| (lean.parameter, lean.is_upper)).collect::<Vec<_>>()
        };
        let against = |is_upper: bool| vec![("a".to_owned(), is_upper)];
        assert_eq!([of("wave+unexplained", 3.0), of("wave+unexplained", -3.0)], [true, false].map(against));
        assert_eq!(
            [of("wave+unexplained", 0.0), of("wave", 3.0), of("unexplained", 3.0)],
            [(); 3].map(|()| vec![])
        );
    }

    #[test]
    fn what_would_change_its_sign_is_no_rival_and_no_answer() {
        // The same point of the box, by whatever name, under what comes first and what does not.
        for (upper, is_first, found) in [(0.1, false, 1), (0.0, false, 0), (0.0, true, 1)] {
            let (predictor, (prior, _)) = (Straight::new(), Straight::beyond(-3.0, 5.0));
            let mut parameters = prior.parameters().to_vec();
            (parameters[0].lower, parameters[0].upper) = (upper - 8.0, upper);
            let prior = Prior::new(parameters);
            let observations = Straight::measured(5.5, 1.0, 0.0, 0.01);
            let problem = predictor.problem(&prior, &observations);
            let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
            explanations.retain(|of| of.name == "none" || of.is_unknown());
            explanations.sort_by_key(|of| of.is_base() != is_first);
            let none = if is_first { 0 } else { 1 };
            explanations[none].ruled_out = Some(RuledOut::Misfit);
            explanations[1 - none].ruled_out = Some(RuledOut::ClosesLittle);
            explanations[1 - none].ln_weight = explanations[none].ln_weight;
            explanations.iter_mut().for_each(|of| of.probability = 0.0);
            assert_eq!(leans(&problem, &explanations).unwrap().len(), found, "{upper} {is_first}");
        }
    }

    #[test]
    fn a_pair_adds_to_what_is_a_part_of_it_and_one_effect_to_nothing() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let all = attribute(&problem, 1, 1).unwrap().explanations;
        let of = |hypothesis: &[usize], is_unknown: bool| {
            let mut of = all.iter().find(|of| of.is_unknown() == is_unknown).unwrap().clone();
            of.hypothesis = hypothesis.to_vec();
            of
        };
        for (pair, first, is_unknown, expected) in [
            (&[0, 1][..], &[0][..], false, true),
            (&[0, 1], &[], false, true),
            (&[0, 1], &[], true, false),
            (&[0, 1], &[2], false, false),
            (&[0, 1], &[0, 1], false, false),
            (&[0], &[], false, false),
        ] {
            assert_eq!(adds(&of(pair, false), &of(first, is_unknown)), expected, "{pair:?} to {first:?}");
        }
    }
}
