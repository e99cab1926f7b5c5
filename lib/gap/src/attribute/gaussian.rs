//! The normal density of a curve whose covariance is a diagonal and a few patterns.

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A covariance Σ = D + U diag(c)^½ R diag(c)^½ Uᵀ of many readings, where D, U and R are fixed and c
/// is not: the variance of every principal component changes with the parameters, the noise and the
/// correlation R do not.
#[derive(Clone, Debug)]
pub struct Covariance {
    /// D^(−1/2), shape (readings,).
    root_precision: DVector<f64>,
    /// D^(−1/2) U, shape (readings, patterns).
    patterns: DMatrix<f64>,
    /// Uᵀ D⁻¹ U, shape (patterns, patterns).
    gram: DMatrix<f64>,
    /// Lower factor of the correlation of the first patterns; the others are independent.
    correlation: DMatrix<f64>,
    ln_det: f64,
}

/// A covariance with its pattern variances filled in.
#[derive(Clone, Debug)]
pub struct Filled<'a> {
    covariance: &'a Covariance,
    /// diag(c)^½ times the factor of R, shape (patterns, patterns).
    root: DMatrix<f64>,
    /// Factor of I + rootᵀ Uᵀ D⁻¹ U root.
    factor: Cholesky<f64, Dyn>,
}

impl Covariance {
    /// * `diagonal` — the variances D, shape (readings,), all positive.
    /// * `patterns` — U, shape (readings, patterns).
    /// * `correlation` — lower factor of the correlation R of the first patterns; the others are
    ///   independent of them and of each other.
    pub fn new(diagonal: &[f64], patterns: &DMatrix<f64>, correlation: &DMatrix<f64>) -> Self {
        let root_precision = DVector::from_iterator(diagonal.len(), diagonal.iter().map(|d| 1.0 / d.sqrt()));
        let mut patterns = patterns.clone();
        for mut column in patterns.column_iter_mut() {
            column.component_mul_assign(&root_precision);
        }
        let gram = patterns.tr_mul(&patterns);
        let ln_det = diagonal.iter().map(|d| d.ln()).sum();
        Self { root_precision, patterns, gram, correlation: correlation.clone(), ln_det }
    }

    /// Fill in the variances of the patterns, shape (patterns,), none negative.
    ///
    /// # Errors
    /// If they are not finite.
    pub fn fill(&self, variances: &[f64]) -> Result<Filled<'_>> {
        let correlated = self.correlation.nrows();
        let root = DMatrix::from_fn(variances.len(), variances.len(), |i, j| {
            if i < correlated && j <= i {
                variances[i].sqrt() * self.correlation[(i, j)]
            } else if i == j {
                variances[i].sqrt()
            } else {
                0.0
            }
        });
        let mut inner = root.tr_mul(&(&self.gram * &root));
        for i in 0..inner.nrows() {
            inner[(i, i)] += 1.0;
        }
        let factor = Cholesky::new(inner).context("the covariance of the readings is not finite")?;
        Ok(Filled { covariance: self, root, factor })
    }
}

impl Filled<'_> {
    /// ln N(residual; 0, Σ), the residual of shape (readings,). Woodbury and the determinant lemma.
    pub fn ln_density(&self, residual: &[f64]) -> f64 {
        let covariance = self.covariance;
        let n = residual.len();
        let white = DVector::from_column_slice(residual).component_mul(&covariance.root_precision);
        let projected = self.root.tr_mul(&covariance.patterns.tr_mul(&white));
        let explained = projected.dot(&self.factor.solve(&projected));
        let ln_det = covariance.ln_det
            + 2.0 * self.factor.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>();
        -0.5 * (white.norm_squared() - explained + ln_det + n as f64 * std::f64::consts::TAU.ln())
    }

    /// Σ⁻¹ X, for X of shape (readings, columns).
    pub fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let covariance = self.covariance;
        let mut white = columns.clone();
        for mut column in white.column_iter_mut() {
            column.component_mul_assign(&covariance.root_precision);
        }
        let projected = self.root.tr_mul(&covariance.patterns.tr_mul(&white));
        let solved = &self.root * self.factor.solve(&projected);
        white -= &covariance.patterns * solved;
        for mut column in white.column_iter_mut() {
            column.component_mul_assign(&covariance.root_precision);
        }
        white
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_low_rank_density_is_that_of_the_whole_covariance() {
        let patterns = DMatrix::from_fn(6, 3, |i, j| ((i * (j + 2)) as f64).sin());
        let diagonal = [0.3, 0.2, 0.5, 1.0, 0.1, 0.7];
        let variances = [2.0, 0.3, 0.5];
        let correlation = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.6, 0.8]);
        let residual = [0.1, -0.4, 0.8, 0.3, -1.0, 0.2];
        let shared = 0.6 * (2.0f64 * 0.3).sqrt();
        let within = [2.0, shared, 0.0, shared, 0.3, 0.0, 0.0, 0.0, 0.5];
        let whole = DMatrix::from_diagonal(&DVector::from_row_slice(&diagonal))
            + &patterns * DMatrix::from_row_slice(3, 3, &within) * patterns.transpose();
        let r = DVector::from_row_slice(&residual);
        let factor = Cholesky::new(whole).unwrap();
        let expected =
            -0.5 * (r.dot(&factor.solve(&r)) + factor.determinant().ln() + 6.0 * std::f64::consts::TAU.ln());
        let covariance = Covariance::new(&diagonal, &patterns, &correlation);
        let filled = covariance.fill(&variances).unwrap();
        assert!((filled.ln_density(&residual) - expected).abs() < 1e-12);
        let column = DMatrix::from_column_slice(6, 1, &residual);
        assert!((filled.solve(&column) - factor.solve(&column)).norm() < 1e-12);
    }
}
