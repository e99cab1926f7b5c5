//! Runs that show what each effect does at full strength, where the base model fits best.
//!
//! An effect with a threshold does nothing over most of its prior, and an emulator of runs that lie below the threshold is sure
//! that it does nothing anywhere. No place that a posterior puts runs at shows it otherwise.

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::Candidate;
use gl_inference::prior::{Effect, Parameter, Prior, normal_cdf};

/// A run is near another one where no parameter of an effect differs by more than the first, and none of the base model by more
/// than the second, as shares of their ranges.
const NEAR: (f64, f64) = (0.1, 0.2);

/// The least and the largest value of a run's parameter: 0.6 % of the prior lie beyond on either side.
pub fn furthest(parameter: &Parameter) -> [f64; 2] {
    [-2.5, 2.5].map(|w| parameter.quantile(normal_cdf(w)))
}

/// Runs of each effect of the simulation alone and as strong as its bounds allow, with the parameters of the base model where it
/// fits best, without those that have been made nearly; shape (runs, parameters).
///
/// * `made` — parameters of the runs so far, shape (runs, parameters).
pub fn at_full_strength(
    problem: &Problem<'_>,
    explanations: &[Explanation],
    made: &[Vec<f64>],
) -> Vec<Vec<f64>> {
    let without_effects = explanations.iter().filter(|of| of.hypothesis.is_empty());
    let Some(base) = without_effects.max_by(|a, b| a.ln_weight.total_cmp(&b.ln_weight)) else {
        return Vec::new();
    };
    let prior = problem.prior;
    let values = base.model(problem).values(base.best());
    let simulated = problem.candidates.iter().filter_map(|candidate| match candidate {
        Candidate::Simulated(effect) => Some(effect),
        Candidate::Measured(_) => None,
    });
    let strongest = simulated.flat_map(|effect| ends(prior, effect, &values));
    strongest.filter(|run| !made.iter().any(|made| is_near(prior, run, made))).collect()
}

/// Values with an effect at that of its bounds which is further from where it is off, or at both, if that lies between them.
fn ends(prior: &Prior, effect: &Effect, values: &[f64]) -> Vec<Vec<f64>> {
    let at = |end: usize| {
        let mut run = values.to_vec();
        for &j in &effect.parameters {
            run[j] = furthest(&prior.parameters()[j])[end];
        }
        run
    };
    // Of several parameters one that is off at an end, or below it, makes that the weak one.
    let off = |j: &usize| {
        let parameter = &prior.parameters()[*j];
        parameter.off.map_or(0.5, |off| parameter.coordinate(off))
    };
    let off: Vec<f64> = effect.parameters.iter().map(off).collect();
    match [off.iter().any(|off| *off <= 0.0), off.iter().any(|off| *off >= 1.0)] {
        [true, false] => vec![at(1)],
        [false, true] => vec![at(0)],
        _ => vec![at(0), at(1)],
    }
}

/// Whether two runs have the same effects on, and lie near each other.
fn is_near(prior: &Prior, one: &[f64], other: &[f64]) -> bool {
    let is_near = |(j, (one, other)): (usize, (&f64, &f64))| {
        let parameter = &prior.parameters()[j];
        let most = if parameter.effect.is_some() { NEAR.0 } else { NEAR.1 };
        let apart = (parameter.coordinate(*one) - parameter.coordinate(*other)).abs();
        parameter.is_off(*one) == parameter.is_off(*other) && (parameter.is_off(*one) || apart <= most)
    };
    one.iter().zip(other).enumerate().all(is_near)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use gl_table::Table;

    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn an_effect_is_strongest_at_the_bound_that_is_further_from_where_it_is_off() {
        let ends = |rows: &str| {
            let text = format!("name lower upper scale effect off\na 0 1 linear - -\n{rows}");
            let prior = Prior::from_table(&Table::parse("params.txt", text.into_bytes()).unwrap()).unwrap();
            let runs = super::ends(&prior, &prior.effects()[0], &prior.with_effects_off());
            runs.into_iter().map(|run| run[1..].to_vec()).collect::<Vec<_>>()
        };
        let near = |found: Vec<Vec<f64>>, expected: &[&[f64]]| {
            assert_eq!(found.len(), expected.len(), "{found:?}");
            let all = found.concat().into_iter().zip(expected.concat());
            all.for_each(|(found, expected)| assert!((found - expected).abs() < 0.03, "{found} {expected}"));
        };
        near(ends("c 0.3 2 linear slip 0\n"), &[&[2.0]]);
        near(ends("c -3 -1 linear slip 0\n"), &[&[-3.0]]);
        near(ends("c -3 1 linear slip 0\n"), &[&[-3.0], &[1.0]]);
        near(ends("c 0.3 2 linear slip 0\nd 1 5 linear slip 0\n"), &[&[2.0, 5.0]]);
    }

    #[test]
    fn what_has_been_run_nearly_is_not_asked_for_again() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let asked = at_full_strength(&problem, &explanations, &[]);
        let [weaker, run] = asked.as_slice() else { panic!("{asked:?}") };
        assert!((run[0] - 1.3).abs() < 0.05 && (run[1] - 0.6).abs() < 0.05, "{run:?}");
        assert!((run[2] - 2.5).abs() < 1e-9 && (weaker[2] + 2.5).abs() < 1e-9, "{asked:?}");
        let left = |made: [f64; 3]| at_full_strength(&problem, &explanations, &[made.to_vec()]).len();
        assert_eq!([left([run[0], run[1], 2.3]), left([run[0], run[1], 0.0])], [1, 2]);
        assert_eq!(left([run[0], prior.parameters()[1].upper, 2.3]), 2);
    }
}
