use anyhow::Result;
use nalgebra::{Cholesky, DMatrix, Dyn};

pub(super) fn factor(covariance: &DMatrix<f64>) -> Result<Cholesky<f64, Dyn>> {
    Cholesky::new(covariance.clone())
        .ok_or_else(|| anyhow::anyhow!("a covariance of the mixture is not positive definite"))
}

pub(super) fn ln_determinant(factor: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>()
}

/// A normal distribution, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Gaussian {
    mean: Vec<f64>,
    /// Lower Cholesky factor of the covariance, row by row.
    lower: Vec<Vec<f64>>,
    ln_norm: f64,
}

impl Gaussian {
    /// The normal distribution with this mean and covariance.
    ///
    /// # Errors
    /// If the covariance is not positive definite.
    pub fn new(mean: &[f64], covariance: &DMatrix<f64>) -> Result<Self> {
        let factor = factor(covariance)?;
        let d = mean.len();
        let lower = (0..d).map(|i| (0..=i).map(|j| factor.l_dirty()[(i, j)]).collect()).collect();
        let ln_norm = -0.5 * (d as f64 * std::f64::consts::TAU.ln() + ln_determinant(&factor));
        Ok(Self { mean: mean.to_vec(), lower, ln_norm })
    }

    /// The mean, shape (dimensions,).
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Points in the coordinates in which this is the standard normal distribution, several side by
    /// side; both of shape (dimensions, points).
    pub(super) fn standardise<const N: usize>(&self, points: &[[f64; N]], standard: &mut [[f64; N]]) {
        for (i, row) in self.lower.iter().enumerate() {
            let (before, rest) = standard.split_at_mut(i);
            let z = &mut rest[0];
            for (z, x) in z.iter_mut().zip(&points[i]) {
                *z = x - self.mean[i];
            }
            for (l, before) in row.iter().zip(before) {
                for (z, before) in z.iter_mut().zip(before.iter()) {
                    *z -= l * before;
                }
            }
            for z in z {
                *z /= row[i];
            }
        }
    }

    /// Squared Mahalanobis distance of a point from the mean; `scratch` has its length.
    pub fn squared_distance(&self, x: &[f64], scratch: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        for (i, row) in self.lower.iter().enumerate() {
            let mut rest = x[i] - self.mean[i];
            for (l, y) in row[..i].iter().zip(scratch.iter()) {
                rest -= l * y;
            }
            scratch[i] = rest / row[i];
            sum += scratch[i] * scratch[i];
        }
        sum
    }

    /// Natural logarithm of the density at a point; `scratch` has its length.
    pub fn ln_density(&self, x: &[f64], scratch: &mut [f64]) -> f64 {
        self.ln_norm - 0.5 * self.squared_distance(x, scratch)
    }

    /// ln of the density at the mean.
    pub fn ln_peak(&self) -> f64 {
        self.ln_norm
    }

    /// The point at `standard` normal coordinates: mean + L z.
    pub fn point(&self, standard: &[f64]) -> Vec<f64> {
        let along = |row: &Vec<f64>| row.iter().zip(standard).map(|(l, z)| l * z).sum::<f64>();
        self.lower.iter().zip(&self.mean).map(|(row, mean)| mean + along(row)).collect()
    }
}
