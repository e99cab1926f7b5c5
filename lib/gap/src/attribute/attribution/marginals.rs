//! What is known of each parameter under a hypothesis.

use crate::attribute::attribution::Explanation;
use crate::attribute::evidence::model::Meaning;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use gl_inference::summary::leaning;
use gl_numeric::statistics::{Quantiles, mean, sd};

/// The posterior of one parameter, or of the size of an error of the measurement in the units of its kind, as a
/// [`Rig`](gl_inference::rig::Rig) has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Marginal {
    /// Its name; an effect of the measurement is its own parameter.
    pub name: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// 5 % quantile.
    pub low: f64,
    /// 95 % quantile.
    pub high: f64,
    /// The bound that it leans on, beyond which the truth may lie: −1 the lower, 1 the upper, 0 none.
    pub lean: i8,
}

/// The marginal posteriors of all parameters that a hypothesis varies.
pub fn marginals(problem: &Problem<'_>, explanation: &Explanation) -> Vec<Marginal> {
    let model = explanation.model(problem);
    let evidence = &explanation.evidence;
    let simulated: Vec<Vec<f64>> = evidence.samples.iter().map(|sample| model.values(sample)).collect();
    let marginal = |(place, meaning): (usize, Meaning<'_>)| {
        let (name, values, lean) = match meaning {
            Meaning::Parameter(j) => {
                let parameter = &problem.prior.parameters()[j];
                let values: Vec<f64> = simulated.iter().map(|values| values[j]).collect();
                let places: Vec<f64> = values.iter().map(|&value| parameter.coordinate(value)).collect();
                let (centre, spread) = (mean(&places, &evidence.weights), sd(&places, &evidence.weights));
                let lean = leaning(centre, spread, (0.0, 1.0));
                (parameter.name.clone(), values, lean)
            }
            Meaning::Size(effect) => {
                let unit = problem.unit_of(effect);
                let sizes = evidence.samples.iter().map(|sample| unit * effect.size(sample[place])).collect();
                (effect.name.clone(), sizes, 0)
            }
        };
        let quantiles = Quantiles::new(&values, &evidence.weights);
        Marginal {
            name,
            mean: mean(&values, &evidence.weights),
            sd: sd(&values, &evidence.weights),
            low: quantiles.at(0.05),
            high: quantiles.at(0.95),
            lean,
        }
    };
    model.meanings().into_iter().enumerate().map(marginal).collect()
}

/// The errors of the rig among the effects of a hypothesis, with what is known of the size of each.
pub fn errors_of_the_rig<'p>(
    problem: &'p Problem<'_>,
    explanation: &Explanation,
) -> Vec<(&'p MeasurementEffect, Marginal)> {
    let error = |of: &Marginal| {
        problem.candidates.iter().find_map(|candidate| match candidate {
            Candidate::Measured(error) if error.name == of.name => Some(error),
            _ => None,
        })
    };
    marginals(problem, explanation).into_iter().filter_map(|of| Some((error(&of)?, of))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn a_parameter_beyond_what_was_believed_is_where_the_truth_is() {
        let predictor = Straight::new();
        let (prior, believed) = Straight::beyond(0.5, 1.1);
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations).believing(&believed);
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let wave = explanations.iter().find(|of| of.name == "wave").unwrap();
        let a = &marginals(&problem, wave)[0];
        assert_eq!((a.name.as_str(), a.lean), ("a", 0));
        assert!((a.mean - 1.3).abs() < 0.02 && (0.001..0.02).contains(&a.sd), "{a:?}");
        assert!(1.1 < a.low && a.low < a.mean && a.mean < a.high && a.high < 1.4, "{a:?}");
    }
}
