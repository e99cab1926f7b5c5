//! Draws of the simulation's parameters under the hypotheses that are in question.

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::name;
use crate::residual::systematic;

/// A set of effects, and what is known of the parameters where it is the cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// `none`, or the names of its effects.
    pub name: String,
    /// Its probability, with a rest and without.
    pub probability: f64,
    /// Draws of equal weight: values of all parameters of the prior, shape (draws, parameters).
    pub draws: Vec<Vec<f64>>,
}

/// `count` draws of each set of effects with a probability of at least `least`, the most probable first.
///
/// Those with a rest and without are one, with the draws of the more probable. The base model with a rest is none of them: it
/// does not say what it would do in another test.
pub fn draws(problem: &Problem<'_>, explanations: &[Explanation], least: f64, count: usize) -> Vec<Drawn> {
    let mut all: Vec<(&Explanation, f64)> = Vec::new();
    for of in explanations.iter().filter(|of| !of.is_unknown()) {
        match all.iter_mut().find(|(other, _)| other.hypothesis == of.hypothesis) {
            Some((better, sum)) => {
                *sum += of.probability;
                if of.probability > better.probability {
                    *better = of;
                }
            }
            None => all.push((of, of.probability)),
        }
    }
    all.retain(|(_, probability)| *probability >= least);
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let drawn = |(of, probability): (&Explanation, f64)| {
        let model = of.model(problem);
        let chosen = systematic(&of.evidence.weights, count).into_iter();
        Drawn {
            name: name(&of.hypothesis, &problem.candidates),
            probability,
            draws: chosen.map(|i| model.values(&of.evidence.samples[i])).collect(),
        }
    };
    all.into_iter().map(drawn).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn the_draws_of_the_truth_lie_about_it_and_effects_that_are_not_in_are_off() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.8));
        let problem = predictor.problem(&prior, &observations);
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let drawn = draws(&problem, &explanations, 0.0, 100);
        assert_eq!(drawn[0].name, "wave");
        assert!(drawn.iter().all(|of| of.draws.len() == 100));
        let mut names: Vec<&str> = drawn.iter().map(|of| of.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), drawn.len(), "a set of effects comes once");
        let with_rest: f64 =
            explanations.iter().filter(|of| of.name.starts_with("wave")).map(|of| of.probability).sum();
        assert!((drawn[0].probability - with_rest).abs() < 1e-12);
        let none = drawn.iter().find(|of| of.name == "none").unwrap();
        let off = prior.with_effects_off();
        for (j, parameter) in prior.parameters().iter().enumerate() {
            if parameter.effect.is_some() {
                assert!(none.draws.iter().all(|draw| draw[j] == off[j]));
            }
        }
    }

    #[test]
    fn where_bounds_are_wider_than_was_believed_the_draws_lie_about_the_truth_too() {
        let predictor = Straight::new();
        let (prior, believed) = Straight::beyond(-0.6, 4.2);
        let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.8));
        let problem = predictor.problem(&prior, &observations).believing(&believed);
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let drawn = draws(&problem, &explanations, 0.0, 100);
        assert_eq!(drawn[0].name, "wave");
        let mean = drawn[0].draws.iter().map(|draw| draw[0]).sum::<f64>() / 100.0;
        assert!((mean - 1.3).abs() < 0.03, "{mean}");
    }
}
