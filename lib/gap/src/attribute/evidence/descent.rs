//! Parameters of the simulation calibrated again within bounds, in the metric of a covariance that stays as it is.

use nalgebra::{Cholesky, DMatrix};

use crate::attribute::evidence::model::Model;
use crate::attribute::problem::gaussian::Filled;

/// A parameter of the prior, and the coordinates between which it stays.
pub type Within = (usize, f64, f64);

/// How far to go.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Steps at most.
    pub steps: usize,
    /// What a change of a coordinate costs, as the inverse of its square: steps along what the measurement hardly tells stay short.
    pub inertia: f64,
}

/// Where a descent ends.
#[derive(Clone, Debug)]
pub struct Descent {
    /// Coordinates of all parameters of the prior.
    pub point: Vec<f64>,
    /// What is left of the measurement, shape (readings, 1).
    pub residual: DMatrix<f64>,
    /// How far rᵀ Σ⁻¹ r fell.
    pub fallen: f64,
}

/// Dampings of a step (Marquardt's), the least that helps is taken: a long step beyond the runs is a guess, and what a bound cuts
/// off may leave of it one that leads uphill.
const DAMPINGS: [f64; 8] = [0.0, 0.1, 0.5, 2.0, 10.0, 50.0, 500.0, 5000.0];

/// A fall of rᵀ Σ⁻¹ r below which there is nothing to gain.
const LITTLE: f64 = 0.01;

/// Levenberg–Marquardt steps of the parameters that no bound holds, from where a model's parameters `w` are.
pub fn descend(
    covariance: &Filled<'_>,
    model: &Model<'_>,
    w: &[f64],
    within: &[Within],
    reach: Reach,
) -> Descent {
    let measured = |point: &[f64]| -> (DMatrix<f64>, f64) {
        let residual = model.residual(&model.measured_at(point, w));
        let residual = DMatrix::from_vec(residual.len(), 1, residual);
        let square = covariance.solve(&residual).dot(&residual);
        (residual, square)
    };
    let mut point = model.point(w);
    within.iter().for_each(|&(j, low, high)| point[j] = point[j].clamp(low, high));
    let (mut residual, before) = measured(&point);
    let mut square = before;
    for _ in 0..reach.steps {
        let by_coordinate = model.problem().predictor.gradient(&point);
        let slopes = by_coordinate.select_columns(within.iter().map(|(j, ..)| j));
        let solved = covariance.solve(&slopes);
        let uphill = solved.tr_mul(&residual);
        let is_free = |&k: &usize| {
            let (j, low, high) = within[k];
            if uphill[k] < 0.0 { point[j] > low } else { point[j] < high }
        };
        let free: Vec<usize> = (0..within.len()).filter(is_free).collect();
        if free.is_empty() {
            break;
        }
        let uphill = uphill.select_rows(&free);
        let information = slopes.tr_mul(&solved).select_columns(&free).select_rows(&free);
        let least = f64::MIN_POSITIVE.max(1e-9 * information.diagonal().max()).max(reach.inertia);
        let damped = |damping: &f64| {
            let more = information.diagonal().map(|of| least + damping * of);
            let step = Cholesky::new(&information + DMatrix::from_diagonal(&more))?.solve(&uphill);
            let mut next = point.clone();
            for (&k, step) in free.iter().zip(step.iter()) {
                let (j, low, high) = within[k];
                next[j] = (next[j] + step).clamp(low, high);
            }
            let (there, value) = measured(&next);
            (value < square).then_some((next, there, value))
        };
        let Some((next, there, value)) = DAMPINGS.iter().find_map(damped) else { break };
        let fallen = square - value;
        (point, residual, square) = (next, there, value);
        if fallen < LITTLE {
            break;
        }
    }
    Descent { point, residual, fallen: before - square }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn a_step_that_a_bound_cuts_off_does_not_end_the_descent() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        // 0 + 2 x from 1 + x: with a held above 0 b has to fall, and the step without bounds makes it rise.
        let problem = predictor.problem(&prior, &Straight::observations(Straight::curve(0.0, 2.0, 0.0)));
        let model = Model::new(&problem, &[], false);
        let (w, none) = (vec![0.0; model.len()], vec![0.0; 3]);
        let low = 0.5 - 1e-4;
        let found = model.with_covariance(&w, &none, |covariance| {
            let reach = Reach { steps: 25, inertia: 0.0 };
            let both = descend(covariance, &model, &w, &[(0, low, 1.0), (1, 0.0, 1.0)], reach);
            let held = descend(covariance, &model, &w, &[(0, low, low), (1, 0.0, 1.0)], reach);
            (both.point, held.point)
        });
        let (both, held) = found.unwrap();
        assert!(both[0] == low && (both[1] - held[1]).abs() < 1e-3 && both[1] < 0.49, "{both:?}: {held:?}");
    }
}
