//! The best that a world without an effect can do: least squares on the world itself.

use anyhow::{Context, Result};
use gl_inference::prior::Parameter;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::bench::Bench;

/// What is left of a target curve when some parameters are fitted to it.
pub struct Fit {
    /// Fitted values of all parameters.
    pub values: Vec<f64>,
    /// Curves there, shape (observables, steps).
    pub curves: Vec<Vec<f64>>,
    /// Derivatives of the readings by the fitted parameters over the noise, shape (observables · steps,
    /// fitted parameters).
    pub slopes: DMatrix<f64>,
    /// Root mean square over all readings of (target − curve) / noise.
    pub rms: f64,
}

/// Fit the parameters at positions `free`, within these bounds, the others as in `start`, to a target
/// with a noise of each observable. Levenberg–Marquardt from a few places.
///
/// # Errors
/// If the world refuses every place to start from.
pub fn fit(
    bench: &Bench,
    parameters: &[Parameter],
    (start, free): (&[f64], &[usize]),
    target: &[Vec<f64>],
    noise: &[f64],
) -> Result<Fit> {
    let mut best: Option<Fit> = None;
    for place in [None, Some(0.5)] {
        let mut z: Vec<f64> = free
            .iter()
            .map(|&j| place.unwrap_or(parameters[j].coordinate(start[j])).clamp(0.0, 1.0))
            .collect();
        let values = |z: &[f64]| {
            let mut values = start.to_vec();
            for (&j, &z) in free.iter().zip(z) {
                values[j] = parameters[j].at_coordinate(z);
            }
            values
        };
        let residual = |z: &[f64]| -> Option<DVector<f64>> {
            let curves = bench.simulate(&values(z)).ok()?;
            let white =
                curves.iter().zip(target).zip(noise).flat_map(|((curve, target), sd)| {
                    curve.iter().zip(target).map(move |(y, t)| (t - y) / sd)
                });
            Some(DVector::from_iterator(target.iter().map(Vec::len).sum(), white))
        };
        let Some(mut r) = residual(&z) else { continue };
        let mut damping = 1e-3;
        let mut slopes = DMatrix::zeros(r.len(), free.len());
        'climb: for _ in 0..25 {
            for k in 0..free.len() {
                let inwards = if z[k] > 0.5 { -1e-5 } else { 1e-5 };
                let slope = [inwards, -inwards].into_iter().find_map(|step| {
                    let mut moved = z.clone();
                    moved[k] += step;
                    Some((&r - residual(&moved)?) / step)
                });
                slopes.set_column(k, &slope.unwrap_or_else(|| DVector::zeros(r.len())));
            }
            let (mut square, mut slope) = (slopes.tr_mul(&slopes), slopes.tr_mul(&r));
            // What a bound holds does not move, and does not hold up the others.
            for k in 0..free.len() {
                if if slope[k] < 0.0 { z[k] <= 0.0 } else { z[k] >= 1.0 } {
                    square.row_mut(k).fill(0.0);
                    square.column_mut(k).fill(0.0);
                    (square[(k, k)], slope[k]) = (1.0, 0.0);
                }
            }
            loop {
                let mut damped = square.clone();
                for k in 0..free.len() {
                    damped[(k, k)] += damping * (square[(k, k)] + 1e-9);
                }
                let step = Cholesky::new(damped).context("a curve that nothing changes")?.solve(&slope);
                let next: Vec<f64> =
                    z.iter().zip(step.iter()).map(|(z, s)| (z + s).clamp(0.0, 1.0)).collect();
                // No further than the world goes.
                let there = residual(&next).filter(|there| there.norm_squared() < r.norm_squared());
                if let Some(there) = there {
                    let gained = 1.0 - there.norm_squared() / r.norm_squared();
                    (z, r) = (next, there);
                    damping = (damping * 0.2).max(1e-12);
                    if gained < 1e-5 {
                        break 'climb;
                    }
                    break;
                }
                damping *= 5.0;
                if damping > 1e9 {
                    break 'climb;
                }
            }
        }
        let rms = (r.norm_squared() / r.len() as f64).sqrt();
        if best.as_ref().is_none_or(|best| rms < best.rms) {
            let values = values(&z);
            best = Some(Fit { curves: bench.simulate(&values)?, values, slopes, rms });
        }
    }
    best.context("the world refuses every place to start from")
}
