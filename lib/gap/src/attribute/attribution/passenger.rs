//! Of which of several effects it is not known that it does anything.
//!
//! Of a parameter that does nothing an emulator makes something, too, within what it does not know. Where that is more than
//! the noise, such an effect turns what is left of the measurement a little its way, and comes with the one that is in it.

use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::untried::{in_units_of_noise, uncertainty};
use crate::attribute::evidence::model::Model;
use crate::attribute::problem::Problem;

/// The effect of the simulation, of several, that adds less where they fit best than the emulator does not know of what it
/// adds, both as the root mean square over the readings in units of noise and scatter; of more than one that which adds least.
pub fn passenger(problem: &Problem<'_>, of: &Explanation) -> Option<usize> {
    if of.hypothesis.len() < 2 {
        return None;
    }
    let known = of.hypothesis.iter().filter_map(|&effect| Some((effect, known(problem, of, effect)?)));
    known.filter(|(_, known)| *known < 1.0).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(effect, _)| effect)
}

/// What an effect adds over what is not known of that; none for an error of the measurement, whose form is known.
fn known(problem: &Problem<'_>, of: &Explanation, effect: usize) -> Option<f64> {
    let model = of.model(problem);
    let others: Vec<usize> = of.hypothesis.iter().copied().filter(|&other| other != effect).collect();
    let without = Model::new(problem, &others, of.has_rest);
    let (on, off) = (model.point(of.best()), without.point(&without.start_from(&model, of.best())));
    if on == off {
        return None;
    }
    let added = problem.predictor.difference(&on, &off);
    let readings = problem.predictor.basis() * nalgebra::DVector::from_vec(added.mean);
    let size = in_units_of_noise(problem, of, |i| readings[i] * readings[i]);
    Some(size / uncertainty(problem, of, &added.variance))
}
