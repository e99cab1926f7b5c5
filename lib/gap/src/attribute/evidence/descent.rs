//! Parameters of the simulation calibrated again within bounds, in the metric of a covariance that stays as it is.

use anyhow::{Context, Result};
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

/// Shares of a step that are tried: as far as it helps, since a long step beyond the runs is a guess.
const SHARES: [f64; 4] = [1.0, 0.4, 0.15, 0.05];

/// A fall of rᵀ Σ⁻¹ r below which there is nothing to gain.
const LITTLE: f64 = 0.01;

/// Gauss–Newton steps of the parameters that no bound holds, from where a model's parameters `w` are.
///
/// # Errors
/// If the slopes of the curve are not finite.
pub fn descend(
    covariance: &Filled<'_>,
    model: &Model<'_>,
    w: &[f64],
    within: &[Within],
    reach: Reach,
) -> Result<Descent> {
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
        let mut information = slopes.tr_mul(&solved).select_columns(&free).select_rows(&free);
        let least = f64::MIN_POSITIVE.max(1e-9 * information.diagonal().max()).max(reach.inertia);
        for k in 0..free.len() {
            information[(k, k)] += least;
        }
        let factor = Cholesky::new(information).context("the slopes of the curve are not finite")?;
        let step = factor.solve(&uphill.select_rows(&free));
        let shorter = |share: f64| {
            let mut next = point.clone();
            for (&k, step) in free.iter().zip(step.iter()) {
                let (j, low, high) = within[k];
                next[j] = (next[j] + share * step).clamp(low, high);
            }
            let (there, value) = measured(&next);
            (value < square).then_some((next, there, value))
        };
        let Some((next, there, value)) = SHARES.into_iter().find_map(shorter) else { break };
        let fallen = square - value;
        (point, residual, square) = (next, there, value);
        if fallen < LITTLE {
            break;
        }
    }
    Ok(Descent { point, residual, fallen: before - square })
}
