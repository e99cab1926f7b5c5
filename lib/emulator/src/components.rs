//! Principal components of the runs' curves.

use anyhow::{Result, ensure};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Curves as a centre and a few components: y = centre + Σ score · basis + what is left over.
#[derive(Clone, Debug)]
pub struct Components {
    /// Mean curve, all observables behind each other, shape (outputs,).
    pub centre: DVector<f64>,
    /// Components in the units of the observables, shape (outputs, components).
    pub basis: DMatrix<f64>,
    /// Scores of mean 0 and variance 1, shape (runs, components).
    pub scores: DMatrix<f64>,
    /// Variance of what is left over, in the units of the observables squared, shape (outputs,).
    pub leftover: DVector<f64>,
}

/// How many components.
#[derive(Clone, Copy, Debug)]
pub struct Enough {
    /// Mean variance of a scaled output at which what is left over no longer matters.
    pub leftover: f64,
    /// The same as a share of the variance of all runs.
    pub share: f64,
    /// Components at most.
    pub most: usize,
}

/// Components smaller than this share of the variance are rounding errors.
const ROUNDING: f64 = 1e-13;

impl Components {
    /// Find the components of curves, shape (runs, outputs), in units of `scale`, shape (outputs,).
    ///
    /// # Errors
    /// If there are fewer than two runs.
    pub fn new(curves: &DMatrix<f64>, scale: &[f64], enough: Enough) -> Result<Self> {
        let (n, outputs) = curves.shape();
        ensure!(n >= 2, "{n} runs; principal components need at least two");
        let centre = DVector::from_fn(outputs, |o, _| curves.column(o).mean());
        let scaled = DMatrix::from_fn(n, outputs, |i, o| (curves[(i, o)] - centre[o]) / scale[o]);
        let is_wide = outputs > n;
        let gram = if is_wide { &scaled * scaled.transpose() } else { scaled.transpose() * &scaled };
        let degrees = (n - 1) as f64;
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(gram);
        let mut order: Vec<usize> = (0..eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
        let total: f64 = eigenvalues.iter().map(|value| value.max(0.0)).sum();
        let negligible = (enough.leftover * degrees * outputs as f64).max(enough.share * total);
        let mut left = total;
        let mut chosen = Vec::new();
        for &c in order.iter().take(enough.most.min(n - 1)) {
            if left <= negligible || eigenvalues[c] <= ROUNDING * total {
                break;
            }
            left -= eigenvalues[c];
            chosen.push(c);
        }
        let k = chosen.len();
        let mut scores = DMatrix::zeros(n, k);
        let mut basis = DMatrix::zeros(outputs, k);
        for (place, &c) in chosen.iter().enumerate() {
            let vector = eigenvectors.column(c);
            let sd = (eigenvalues[c] / degrees).sqrt();
            let mut direction =
                if is_wide { scaled.tr_mul(&vector) / eigenvalues[c].sqrt() } else { vector.into_owned() };
            // The sign of an eigenvector is anyone's choice: the largest entry is positive.
            if direction[direction.icamax()] < 0.0 {
                direction.neg_mut();
            }
            scores.set_column(place, &(&scaled * &direction / sd));
            basis.set_column(place, &(direction * sd));
        }
        let rest = &scaled - &scores * basis.transpose();
        let leftover =
            DVector::from_fn(outputs, |o, _| rest.column(o).norm_squared() / degrees * scale[o] * scale[o]);
        for (mut row, scale) in basis.row_iter_mut().zip(scale) {
            row *= *scale;
        }
        Ok(Self { centre, basis, scores, leftover })
    }
}
