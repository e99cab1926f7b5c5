//! What is known of each parameter under a hypothesis.

use crate::attribute::attribution::Explanation;
use crate::attribute::model::Meaning;
use crate::attribute::problem::Problem;
use gl_inference::prior::normal_cdf;
use gl_inference::summary::leaning;
use gl_numeric::statistics::{Quantiles, mean, sd};

/// The posterior of one parameter, or of the size of an effect of the measurement as a share of the range.
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
    let marginal = |(place, meaning): (usize, Meaning<'_>)| {
        let scores = evidence.samples.iter().map(|sample| sample[place]);
        let (name, values, lean) = match meaning {
            Meaning::Parameter(j) => {
                let parameter = &problem.prior.parameters()[j];
                let values: Vec<f64> = scores.map(|w| parameter.quantile(normal_cdf(w))).collect();
                let places: Vec<f64> = values.iter().map(|&value| parameter.coordinate(value)).collect();
                let (centre, spread) = (mean(&places, &evidence.weights), sd(&places, &evidence.weights));
                (parameter.name.clone(), values, leaning(centre, spread, (0.0, 1.0)))
            }
            Meaning::Size(effect) => (effect.name.clone(), scores.map(|w| effect.size(w)).collect(), 0),
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
