//! Which candidates do what an error of the measurement does.

use nalgebra::DVector;

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use gl_inference::rig::Kind;

/// What an effect adds is that of an error of the measurement where the square of the cosine between them is above this.
const PARALLEL: f64 = 0.99;

/// A constant and a proportion: forms so plain that nearly anything unknown has a part of one.
const PLAIN: [Kind; 2] = [Kind::Offset, Kind::Gain];

/// An error's size, as a share of a range: what it adds is in proportion to it, nearly.
const SIZE: f64 = 0.01;

/// Whether each candidate is an error of the measurement, or a parameter of the simulator that adds what an offset or a gain
/// does, where it fits best: the zero of a load cell.
///
/// * `explanations` — among them every candidate alone.
pub(super) fn of_the_rig(problem: &Problem<'_>, explanations: &[Explanation]) -> Vec<bool> {
    let is_one = |(place, candidate): (usize, &Candidate)| {
        let alone = explanations.iter().find(|of| of.hypothesis == [place] && !of.has_rest);
        candidate.is_measured() || alone.is_some_and(|alone| adds_as_an_error_does(problem, alone))
    };
    problem.candidates.iter().enumerate().map(is_one).collect()
}

fn adds_as_an_error_does(problem: &Problem<'_>, of: &Explanation) -> bool {
    let weighed = |curve: &[f64]| -> DVector<f64> {
        DVector::from_iterator(curve.len(), curve.iter().zip(&problem.units).map(|(y, unit)| y / unit))
    };
    let without: Vec<f64> = of.evidence.mean.iter().zip(&of.added).map(|(on, added)| on - added).collect();
    let (added, base) = (weighed(&of.added), weighed(&without));
    MeasurementEffect::of_tests(&PLAIN, &problem.observables, &problem.tests).iter().any(|effect| {
        let mut curve = without.clone();
        problem.apply(effect, SIZE, &mut curve);
        square_of_cosine(&added, &(weighed(&curve) - &base)) > PARALLEL
    })
}

/// Of the angle between two vectors; zero where one of them is.
fn square_of_cosine(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    let lengths = a.norm_squared() * b.norm_squared();
    if lengths > 0.0 { a.dot(b).powi(2) / lengths } else { 0.0 }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::{STEPS, Straight};
    use gl_inference::prior::Prior;

    #[test]
    fn a_parameter_of_the_simulator_that_adds_a_constant_does_what_an_offset_does() {
        // y = a + b x + c sin(6x), where a and c are effects.
        let mut parameters = Straight::prior().parameters().to_vec();
        (parameters[0].effect, parameters[0].off) = (Some("zero".to_owned()), Some(0.0));
        let (predictor, prior) = (Straight::new(), Prior::new(parameters));
        let candidates = prior.effects().into_iter().map(Candidate::Simulated).collect();
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let noise = Some(vec![vec![0.01; STEPS]]);
        let problem = Problem::new(&predictor, &prior, candidates, &observations, noise, 1.0).unwrap();
        let explanations = attribute(&problem, 2, 1).unwrap().explanations;
        assert_eq!(of_the_rig(&problem, &explanations), [true, false]);
        let is_of_the_rig =
            |name: &str| explanations.iter().find(|of| of.name == name).unwrap().is_of_the_rig;
        assert_eq!(["none", "zero", "wave", "zero+wave"].map(is_of_the_rig), [false, true, false, true]);
    }

    #[test]
    fn what_is_in_proportion_is_parallel_and_what_is_nothing_is_not() {
        let of = |b: [f64; 3]| {
            square_of_cosine(&DVector::from_vec(vec![1.0, 2.0, -2.0]), &DVector::from(b.to_vec()))
        };
        assert!((of([-0.5, -1.0, 1.0]) - 1.0).abs() < 1e-12);
        assert!((of([3.0, 0.0, 0.0]) - 1.0 / 9.0).abs() < 1e-12);
        assert_eq!(of([0.0; 3]), 0.0);
    }
}
