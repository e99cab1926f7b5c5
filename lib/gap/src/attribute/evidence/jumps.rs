//! Where a rest jumps: from a reading on, in one observable.
//!
//! What is no candidate may set in all at once, where the test turns, goes faster or yields. A smooth rest cannot follow
//! that, and any effect that jumps there, too, would be far likelier than it, however little else the two have in common.

use nalgebra::DMatrix;

use crate::attribute::evidence::model::{Curve, Model, ln_odds};
use crate::attribute::problem::Problem;

/// Probability beforehand that a rest jumps at a step.
const JUMP: f64 = 0.003;

/// The same where the control turns, and where another observable of the test does.
const JUMP_AT_EVENT: f64 = 0.05;

/// The reading from which on a jump of the rest gains most over what it is less likely beforehand by; none where none does.
pub fn likeliest(model: &Model<'_>, w: &[f64], curve: &Curve) -> Option<usize> {
    let problem = model.problem();
    let jumps = &model.singular().jumps;
    let residual = DMatrix::from_vec(curve.mean.len(), 1, model.residual(&curve.mean));
    let (own, precise) = model
        .with_covariance(w, &curve.variance, |covariance| {
            (covariance.precisions_of_steps(), covariance.solve(&residual))
        })
        .ok()?;
    let cross = products_with_steps(problem, precise.as_slice());
    let scales = model.nuisances(w).scales;
    let already = ln_odds_of(problem, jumps);
    // What a pattern of a size that is not known gains, by its precision and its product with the residual.
    let gained = |i: usize| {
        let variance = problem.variance_of_singular(problem.observable_of(i), &scales);
        let share = 1.0 + variance * own[i];
        let with: Vec<usize> = jumps.iter().copied().chain([i]).collect();
        0.5 * (variance * cross[i] * cross[i] / share - share.ln()) + ln_odds_of(problem, &with) - already
    };
    let places = problem.blocks().into_iter().flat_map(|block| block.skip(1));
    places
        .filter(|i| !jumps.contains(i))
        .map(|i| (gained(i), i))
        .filter(|&(gained, _)| gained > 0.0)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, i)| i)
}

/// Products of a vector, shape (readings,), with a step of one unit of noise from each reading on to the last of its
/// observable.
pub fn products_with_steps(problem: &Problem<'_>, of: &[f64]) -> Vec<f64> {
    let mut products: Vec<f64> = problem.units.iter().zip(of).map(|(unit, value)| unit * value).collect();
    for block in problem.blocks() {
        let own = &mut products[block];
        (1..own.len()).rev().for_each(|i| own[i - 1] += own[i]);
    }
    products
}

/// ln odds beforehand of jumps, in readings: where the control turns, or another observable of the test jumps, one is likely.
pub fn ln_odds_of(problem: &Problem<'_>, jumps: &[usize]) -> f64 {
    let mut events: Vec<(usize, usize)> = Vec::new();
    let mut ln_odds_of_all = 0.0;
    for &reading in jumps {
        let observable = problem.observable_of(reading);
        let (test, step) = (problem.test_of(observable), reading - problem.own(observable).start);
        let event = (test.readings.start, step);
        let is_at_turn = test.path.turns().iter().any(|&turn| turn == step || turn + 1 == step);
        let is_likely = is_at_turn || events.contains(&event);
        ln_odds_of_all += ln_odds(if is_likely { JUMP_AT_EVENT } else { JUMP });
        events.push(event);
    }
    ln_odds_of_all
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::attribute::attribution::rest::jumps;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::evidence::mode::find;
    use crate::attribute::evidence::model::Singular;
    use crate::attribute::synthetic_world::{STEPS, Straight};
    use gl_inference::observations::Observations;

    const NOISE: f64 = 0.01;

    /// What is measured where something is added at each step.
    fn measured(more: impl Fn(usize) -> f64) -> Observations {
        let mut observations = Straight::measured(1.3, 0.6, 0.0, NOISE);
        observations.values[0].iter_mut().enumerate().for_each(|(t, y)| *y += more(t));
        observations
    }

    /// The readings at which a rest jumps beside the base model.
    fn found(more: impl Fn(usize) -> f64) -> Vec<usize> {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = measured(more);
        let problem = predictor.problem(&prior, &observations);
        let mut model = Model::new(&problem, &[], true);
        let start = vec![0.0; model.len()];
        find(&mut model, &[start], &mut ChaCha8Rng::seed_from_u64(1));
        model.singular().jumps.clone()
    }

    fn step(from: usize, size: f64) -> impl Fn(usize) -> f64 {
        move |t| if t >= from { size } else { 0.0 }
    }

    #[test]
    fn a_rest_jumps_where_the_measurement_does_and_nowhere_else() {
        assert_eq!(found(step(17, 15.0 * NOISE)), [17]);
        let (up, down) = (step(9, 15.0 * NOISE), step(21, -25.0 * NOISE));
        assert_eq!(found(|t| up(t) + down(t)), [9, 21]);
        assert_eq!(found(|_| 0.0), [0; 0]);
        let smooth = |t: usize| 15.0 * NOISE * (4.0 * t as f64 / STEPS as f64).sin();
        assert_eq!(found(smooth), [0; 0]);
        // One reading that is far off is no jump.
        assert_eq!(found(|t| if t == 17 { 15.0 * NOISE } else { 0.0 }), [0; 0]);
    }

    /// The gain of each place is that of the density with the pattern of a step in the covariance.
    #[test]
    fn what_a_jump_gains_is_what_the_density_does() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = measured(step(17, 15.0 * NOISE));
        let problem = predictor.problem(&prior, &observations);
        let model = Model::new(&problem, &[], true);
        let w = vec![0.2; model.len()];
        let curve = model.curve(&w);
        let ln = |jumps: Vec<usize>| {
            let mut model = model.clone();
            model.set_form(&[], Singular { outliers: Vec::new(), jumps });
            model.ln_likelihood(&w, &curve)
        };
        let best = (1..STEPS).max_by(|&a, &b| ln(vec![a]).total_cmp(&ln(vec![b]))).unwrap();
        assert!(ln(vec![best]) > ln(Vec::new()));
        assert_eq!(likeliest(&model, &w, &curve), Some(best));
    }

    #[test]
    fn two_at_a_step_are_likelier_than_two_apart() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut observations = measured(|_| 0.0);
        observations.control = (0..STEPS).map(|t| (t as f64 - 12.0).abs()).collect();
        let problem = predictor.problem(&prior, &observations);
        let one = ln_odds_of(&problem, &[5]);
        assert_eq!(one, ln_odds(JUMP));
        assert_eq!(ln_odds_of(&problem, &[5, 20]), 2.0 * one);
        // The reading at the turn may be the last before it or the first after it.
        for at_turn in [12, 13] {
            assert_eq!(ln_odds_of(&problem, &[at_turn]), ln_odds(JUMP_AT_EVENT));
        }
    }

    #[test]
    fn a_rest_that_jumps_is_said_where_and_how_far() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = measured(step(17, 15.0 * NOISE));
        let problem = predictor.problem(&prior, &observations);
        let diagnosis = diagnose(&problem, 1, 1).unwrap();
        let first = diagnosis.first();
        assert!(first.is_unknown(), "{}", first.name);
        let jumps = jumps(&problem, first);
        assert_eq!(jumps.len(), 1);
        assert_eq!(jumps[0].reading, 17);
        assert!((jumps[0].size - 15.0 * NOISE).abs() < 5.0 * NOISE, "{jumps:?}");
    }
}
