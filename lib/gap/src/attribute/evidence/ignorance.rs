//! What an emulator does not know near the modes of a hypothesis, without asking it at every sample.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::attribute::evidence::mode::Mode;
use crate::attribute::evidence::model::{Curve, Model};

/// The variances of the components about the modes of a model: their logarithms to second order along the
/// principal directions of each mode.
///
/// The variance of a Gaussian process costs the square of its runs at every point, and changes little over a
/// posterior that is narrower than the prior.
pub struct Ignorance {
    modes: Vec<Near>,
}

struct Near {
    centre: DVector<f64>,
    /// Lower factor of the covariance of the curve parameters.
    factor: DMatrix<f64>,
    /// ln variance at the centre, shape (components,), and its slope and half its bend by the direction, each
    /// of shape (components, directions).
    ln: Vec<f64>,
    slope: DMatrix<f64>,
    bend: DMatrix<f64>,
}

/// Standard deviations between the points that are asked.
const APART: f64 = 1.5;

/// Standard deviations beyond which the variance is taken to be what it is there.
const FURTHEST: f64 = 3.0;

/// Modes that are asked; others are taken to be like the nearest of these.
const MODES: usize = 2;

/// Below this a variance is rounding.
const SMALLEST: f64 = 1e-300;

impl Ignorance {
    /// Ask the emulator about the modes of a model.
    pub fn about(model: &Model<'_>, modes: &[Mode]) -> Self {
        let near = |mode: &Mode| {
            let d = model.curve_parameters();
            let centre = mode.w.rows(0, d).into_owned();
            let covariance = mode.covariance.view((0, 0), (d, d)).into_owned();
            let factor = Cholesky::new(covariance).map_or_else(|| DMatrix::identity(d, d), |c| c.unpack());
            let at = |k: usize, by: f64| -> Vec<f64> {
                let mut w = mode.w.as_slice().to_vec();
                w.iter_mut().zip(factor.column(k).iter()).for_each(|(w, axis)| *w += by * axis);
                w
            };
            let ends = (0..d).flat_map(|k| [at(k, APART), at(k, -APART)]);
            let points: Vec<Vec<f64>> = [mode.w.as_slice().to_vec()].into_iter().chain(ends).collect();
            let mut all = model.variances(&points);
            all.iter_mut().flatten().for_each(|v| *v = v.max(SMALLEST).ln());
            let ln = all.remove(0);
            let (mut slope, mut bend) = (DMatrix::zeros(ln.len(), d), DMatrix::zeros(ln.len(), d));
            for (k, ends) in all.chunks_exact(2).enumerate() {
                let (above, below) = (&ends[0], &ends[1]);
                for c in 0..ln.len() {
                    slope[(c, k)] = (above[c] - below[c]) / (2.0 * APART);
                    bend[(c, k)] = (above[c] + below[c] - 2.0 * ln[c]) / (2.0 * APART * APART);
                }
            }
            Near { centre, factor, ln, slope, bend }
        };
        Self { modes: modes.iter().take(MODES).map(near).collect() }
    }

    /// The curve at parameters, with the variance of the nearest mode's surroundings.
    pub fn curve(&self, model: &Model<'_>, w: &[f64]) -> Curve {
        let away = |near: &Near| {
            let mut u = DVector::from_column_slice(&w[..near.centre.len()]) - &near.centre;
            near.factor.solve_lower_triangular_mut(&mut u);
            u
        };
        let nearest = self
            .modes
            .iter()
            .map(|near| (away(near), near))
            .min_by(|a, b| a.0.norm_squared().total_cmp(&b.0.norm_squared()));
        let Some((mut u, near)) = nearest else { return model.curve(w) };
        u.iter_mut().for_each(|u| *u = u.clamp(-FURTHEST, FURTHEST));
        let variance = (0..near.ln.len())
            .map(|c| {
                let more: f64 =
                    (0..u.len()).map(|k| u[k] * (near.slope[(c, k)] + near.bend[(c, k)] * u[k])).sum();
                // Never further from what was asked than what was asked differs.
                (near.ln[c] + more.clamp(-3.0, 3.0)).exp()
            })
            .collect();
        Curve { mean: model.mean(w), variance }
    }
}
