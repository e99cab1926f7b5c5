//! The normal density of a curve whose covariance is an autoregressive noise and a few patterns.

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// The noise of one observable: how many times its unit, and the correlation from one step to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Variance in units.
    pub variance: f64,
    /// Correlation of neighbours, in [0, 1).
    pub phi: f64,
}

/// What is fixed of a covariance Σ = N + U diag(c)^½ R diag(c)^½ Uᵀ of the readings of a few observables.
///
/// N is the noise: for each observable a unit at each step, times a level, correlated from step to step as
/// an autoregressive process of first order. Levels and the variances c of the patterns U change with the
/// parameters; units, patterns and the correlation R of the first of them do not. N⁻¹ is tridiagonal, so
/// that Uᵀ N⁻¹ U is a combination of three matrices an observable that are computed once.
#[derive(Clone, Debug)]
pub struct Patterns {
    /// Reciprocal of the unit of each reading, shape (readings,).
    reciprocal: DVector<f64>,
    /// U in units, shape (readings, patterns).
    patterns: DMatrix<f64>,
    /// Lower factor of the correlation of the first patterns; the others are independent.
    correlation: DMatrix<f64>,
    grams: Vec<Gram>,
    steps: usize,
    ln_units: f64,
}

/// Products of the patterns of one observable, each of shape (patterns, patterns).
#[derive(Clone, Debug)]
struct Gram {
    /// Σ uₜ uₜᵀ over all steps.
    all: DMatrix<f64>,
    /// The same over the first and the last step.
    ends: DMatrix<f64>,
    /// Σ uₜ uₜ₊₁ᵀ and its transpose.
    neighbours: DMatrix<f64>,
}

/// A covariance with its levels and variances filled in.
#[derive(Clone, Debug)]
pub struct Filled<'a> {
    of: &'a Patterns,
    levels: Vec<Level>,
    /// diag(c)^½, shape (patterns,).
    roots: DVector<f64>,
    /// Factor of I + rootᵀ Uᵀ N⁻¹ U root, root = diag(c)^½ times the factor of R.
    factor: Cholesky<f64, Dyn>,
}

impl Patterns {
    /// * `units` — of the noise of each reading, observable by observable, shape (readings,), all positive.
    /// * `steps` — readings of an observable.
    /// * `patterns` — U, shape (readings, patterns).
    /// * `correlation` — lower factor of the correlation R of the first patterns; the others are
    ///   independent of them and of each other.
    pub fn new(units: &[f64], steps: usize, patterns: &DMatrix<f64>, correlation: &DMatrix<f64>) -> Self {
        let reciprocal = DVector::from_iterator(units.len(), units.iter().map(|unit| unit.recip()));
        let mut patterns = patterns.clone();
        for mut column in patterns.column_iter_mut() {
            column.component_mul_assign(&reciprocal);
        }
        let gram = |start: usize| {
            let own = patterns.rows(start, steps);
            let (first, last) = (own.row(0), own.row(steps - 1));
            let (before, after) = (own.rows(0, steps - 1), own.rows(1, steps - 1));
            let next = before.tr_mul(&after);
            Gram {
                all: own.tr_mul(&own),
                ends: first.tr_mul(&first) + last.tr_mul(&last),
                neighbours: &next + next.transpose(),
            }
        };
        let grams = (0..units.len()).step_by(steps).map(gram).collect();
        let ln_units = units.iter().map(|unit| 2.0 * unit.ln()).sum();
        Self { reciprocal, patterns, correlation: correlation.clone(), grams, steps, ln_units }
    }

    /// Fill in the level of each observable, shape (observables,), and the variance of each pattern, shape
    /// (patterns,), none negative.
    ///
    /// # Errors
    /// If they are not finite.
    pub fn fill(&self, levels: &[Level], variances: &[f64]) -> Result<Filled<'_>> {
        let count = variances.len();
        let roots = DVector::from_iterator(count, variances.iter().map(|variance| variance.sqrt()));
        let mut inner = DMatrix::zeros(count, count);
        for (gram, level) in self.grams.iter().zip(levels) {
            let (diagonal, ends, next) = level.tridiagonal();
            inner.zip_zip_apply(&gram.all, &gram.neighbours, |sum, all, neighbours| {
                *sum += diagonal * all + next * neighbours;
            });
            if ends != 0.0 {
                inner.zip_apply(&gram.ends, |sum, value| *sum += ends * value);
            }
        }
        for (j, mut column) in inner.column_iter_mut().enumerate() {
            column.component_mul_assign(&roots);
            column *= roots[j];
        }
        let correlated = self.correlation.nrows();
        if correlated > 0 {
            let right = inner.columns(0, correlated) * &self.correlation;
            inner.columns_mut(0, correlated).copy_from(&right);
            let below = self.correlation.tr_mul(&inner.rows(0, correlated));
            inner.rows_mut(0, correlated).copy_from(&below);
        }
        for i in 0..count {
            inner[(i, i)] += 1.0;
        }
        let factor = Cholesky::new(inner).context("the covariance of the readings is not finite")?;
        Ok(Filled { of: self, levels: levels.to_vec(), roots, factor })
    }
}

impl Level {
    /// The inverse of the noise's covariance in units: its diagonal, what the first and the last of the
    /// diagonal have more, and the first off-diagonal.
    fn tridiagonal(self) -> (f64, f64, f64) {
        let scale = 1.0 / (self.variance * (1.0 - self.phi * self.phi));
        (scale * (1.0 + self.phi * self.phi), -scale * self.phi * self.phi, -scale * self.phi)
    }
}

impl Filled<'_> {
    /// N⁻¹ x, both in units, shape (readings,).
    fn precise(&self, x: &[f64]) -> DVector<f64> {
        let steps = self.of.steps;
        let mut y = DVector::zeros(x.len());
        for (j, level) in self.levels.iter().enumerate() {
            let (diagonal, ends, next) = level.tridiagonal();
            let x = &x[j * steps..(j + 1) * steps];
            let y = &mut y.as_mut_slice()[j * steps..(j + 1) * steps];
            for t in 0..steps {
                let mut value = diagonal * x[t];
                if t == 0 {
                    value += ends * x[t];
                } else {
                    value += next * x[t - 1];
                }
                if t + 1 == steps {
                    value += ends * x[t];
                } else {
                    value += next * x[t + 1];
                }
                y[t] = value;
            }
        }
        y
    }

    /// rootᵀ x, shape (patterns,).
    fn root_transposed(&self, mut x: DVector<f64>) -> DVector<f64> {
        x.component_mul_assign(&self.roots);
        let correlated = self.of.correlation.nrows();
        if correlated > 0 {
            let turned = self.of.correlation.tr_mul(&x.rows(0, correlated));
            x.rows_mut(0, correlated).copy_from(&turned);
        }
        x
    }

    /// root x, shape (patterns,).
    fn root(&self, mut x: DVector<f64>) -> DVector<f64> {
        let correlated = self.of.correlation.nrows();
        if correlated > 0 {
            let turned = &self.of.correlation * x.rows(0, correlated);
            x.rows_mut(0, correlated).copy_from(&turned);
        }
        x.component_mul_assign(&self.roots);
        x
    }

    /// ln N(residual; 0, Σ), the residual of shape (readings,). Woodbury and the determinant lemma.
    pub fn ln_density(&self, residual: &[f64]) -> f64 {
        let unit = DVector::from_column_slice(residual).component_mul(&self.of.reciprocal);
        let precise = self.precise(unit.as_slice());
        let mut projected = self.root_transposed(self.of.patterns.tr_mul(&precise));
        self.factor.l_dirty().solve_lower_triangular_mut(&mut projected);
        let steps = self.of.steps as f64;
        let of_level =
            |level: &Level| steps * level.variance.ln() + (steps - 1.0) * (1.0 - level.phi * level.phi).ln();
        let ln_det = self.of.ln_units
            + self.levels.iter().map(of_level).sum::<f64>()
            + 2.0 * self.factor.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>();
        let n = residual.len() as f64;
        -0.5 * (unit.dot(&precise) - projected.norm_squared() + ln_det + n * std::f64::consts::TAU.ln())
    }

    /// Σ⁻¹ X, for X of shape (readings, columns).
    pub fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut solved = columns.clone();
        for mut column in solved.column_iter_mut() {
            column.component_mul_assign(&self.of.reciprocal);
            let precise = self.precise(column.as_slice());
            let projected = self.root_transposed(self.of.patterns.tr_mul(&precise));
            let back = &self.of.patterns * self.root(self.factor.solve(&projected));
            column.copy_from(&(precise - self.precise(back.as_slice())));
            column.component_mul_assign(&self.of.reciprocal);
        }
        solved
    }

    /// The diagonal of Σ⁻¹, shape (readings,).
    pub fn precisions(&self) -> Vec<f64> {
        let readings = self.of.reciprocal.len();
        // Rows of N⁻¹ U root L⁻ᵀ: what is taken off the noise's precision is the squares of them.
        let mut columns = DMatrix::zeros(self.roots.len(), readings);
        let mut weighted = self.of.patterns.clone();
        for mut column in weighted.column_iter_mut() {
            let precise = self.precise(column.as_slice());
            column.copy_from(&precise);
        }
        for (i, mut column) in columns.column_iter_mut().enumerate() {
            let mut projected = self.root_transposed(weighted.row(i).transpose());
            self.factor.l_dirty().solve_lower_triangular_mut(&mut projected);
            column.copy_from(&projected);
        }
        let steps = self.of.steps;
        (0..readings)
            .map(|i| {
                let (diagonal, ends, _) = self.levels[i / steps].tridiagonal();
                let t = i % steps;
                let of_noise =
                    diagonal + if t == 0 { ends } else { 0.0 } + if t + 1 == steps { ends } else { 0.0 };
                (of_noise - columns.column(i).norm_squared()) * self.of.reciprocal[i].powi(2)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_low_rank_density_is_that_of_the_whole_covariance() {
        let patterns = DMatrix::from_fn(6, 3, |i, j| ((i * (j + 2)) as f64).sin());
        let units = [0.3, 0.2, 0.5, 1.0, 0.1, 0.7];
        let levels = [Level { variance: 1.7, phi: 0.6 }, Level { variance: 0.4, phi: 0.0 }];
        let variances = [2.0, 0.3, 0.5];
        let correlation = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.6, 0.8]);
        let residual = [0.1, -0.4, 0.8, 0.3, -1.0, 0.2];
        let shared = 0.6 * (2.0f64 * 0.3).sqrt();
        let within = [2.0, shared, 0.0, shared, 0.3, 0.0, 0.0, 0.0, 0.5];
        let noise = DMatrix::from_fn(6, 6, |i, k| {
            let level = levels[i / 3];
            let correlation = if i / 3 == k / 3 { level.phi.powi(i.abs_diff(k) as i32) } else { 0.0 };
            level.variance * units[i] * units[k] * correlation
        });
        let whole = noise + &patterns * DMatrix::from_row_slice(3, 3, &within) * patterns.transpose();
        let r = DVector::from_row_slice(&residual);
        let factor = Cholesky::new(whole).unwrap();
        let expected =
            -0.5 * (r.dot(&factor.solve(&r)) + factor.determinant().ln() + 6.0 * std::f64::consts::TAU.ln());
        let covariance = Patterns::new(&units, 3, &patterns, &correlation);
        let filled = covariance.fill(&levels, &variances).unwrap();
        assert!((filled.ln_density(&residual) - expected).abs() < 1e-12);
        let column = DMatrix::from_column_slice(6, 1, &residual);
        assert!((filled.solve(&column) - factor.solve(&column)).norm() < 1e-12);
        let inverse = factor.inverse();
        for (i, precision) in filled.precisions().iter().enumerate() {
            assert!((precision - inverse[(i, i)]).abs() < 1e-12 * inverse[(i, i)]);
        }
    }

    #[test]
    fn one_step_has_no_neighbour() {
        let covariance = Patterns::new(&[2.0], 1, &DMatrix::zeros(1, 0), &DMatrix::zeros(0, 0));
        let filled = covariance.fill(&[Level { variance: 1.0, phi: 0.0 }], &[]).unwrap();
        let expected = -0.5 * (0.25 + 4f64.ln() + std::f64::consts::TAU.ln());
        assert!((filled.ln_density(&[1.0]) - expected).abs() < 1e-12);
    }
}
