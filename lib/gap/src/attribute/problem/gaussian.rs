//! The normal density of a curve whose covariance is an autoregressive noise and a few patterns.

use std::ops::Range;

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};
use pulp::{Arch, Simd, with_simd};

use gl_emulator::cholesky::{Cholesky, Triangle};

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
    /// Inverse of the correlation of the first patterns, and ln of its determinant; the others are independent.
    independence: DMatrix<f64>,
    ln_correlation: f64,
    grams: Vec<Gram>,
    /// Readings of each observable.
    blocks: Vec<Range<usize>>,
    ln_units: f64,
}

/// Products of the patterns that an observable has a share in, each of shape (those patterns, those patterns).
#[derive(Clone, Debug)]
struct Gram {
    /// Which these are among all patterns: stretches of them that lie behind each other.
    stretches: Vec<Range<usize>>,
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
    /// Factor of R⁻¹ + diag(c)^½ Uᵀ N⁻¹ U diag(c)^½.
    factor: Cholesky,
}

impl Patterns {
    /// * `units` — of the noise of each reading, observable by observable, shape (readings,), all positive.
    /// * `blocks` — readings of each observable, behind each other.
    /// * `patterns` — U, shape (readings, patterns).
    /// * `correlation` — lower factor of the correlation R of the first patterns; the others are
    ///   independent of them and of each other.
    pub fn new(
        units: &[f64],
        blocks: &[Range<usize>],
        patterns: &DMatrix<f64>,
        correlation: &DMatrix<f64>,
    ) -> Self {
        let reciprocal = DVector::from_iterator(units.len(), units.iter().map(|unit| unit.recip()));
        let mut patterns = patterns.clone();
        for mut column in patterns.column_iter_mut() {
            column.component_mul_assign(&reciprocal);
        }
        let gram = |block: &Range<usize>| {
            let steps = block.len();
            let own = patterns.rows(block.start, steps);
            let has_share = |place: &usize| own.column(*place).iter().any(|y| *y != 0.0);
            let places: Vec<usize> = (0..own.ncols()).filter(has_share).collect();
            let own = own.select_columns(&places);
            let (first, last) = (own.row(0), own.row(steps - 1));
            let (before, after) = (own.rows(0, steps - 1), own.rows(1, steps - 1));
            let next = before.tr_mul(&after);
            let stretches = places.chunk_by(|a, b| a + 1 == *b).map(|own| own[0]..own[own.len() - 1] + 1);
            Gram {
                stretches: stretches.collect(),
                all: own.tr_mul(&own),
                ends: first.tr_mul(&first) + last.tr_mul(&last),
                neighbours: &next + next.transpose(),
            }
        };
        let grams = blocks.iter().map(gram).collect();
        let ln_units = units.iter().map(|unit| 2.0 * unit.ln()).sum();
        let identity = DMatrix::identity(correlation.nrows(), correlation.nrows());
        let whitened = correlation.solve_lower_triangular(&identity).unwrap_or(identity);
        let ln_correlation = correlation.diagonal().iter().map(|value| 2.0 * value.ln()).sum();
        let independence = whitened.tr_mul(&whitened);
        let blocks = blocks.to_vec();
        Self { reciprocal, patterns, independence, ln_correlation, grams, blocks, ln_units }
    }

    /// Fill in the level of each observable, shape (observables,), and the variance of each pattern, shape
    /// (patterns,), none negative.
    ///
    /// # Errors
    /// If they are not finite.
    pub fn fill(&self, levels: &[Level], variances: &[f64]) -> Result<Filled<'_>> {
        let roots = DVector::from_iterator(variances.len(), variances.iter().map(|variance| variance.sqrt()));
        let inner = inner(self, levels, roots.as_slice());
        let factor = Cholesky::new(&inner).context("the covariance of the readings is not finite")?;
        Ok(Filled { of: self, levels: levels.to_vec(), roots, factor })
    }
}

/// The lower half of R⁻¹ + diag(c)^½ Uᵀ N⁻¹ U diag(c)^½, at the width of the machine's vectors.
#[with_simd(inner = Arch::new())]
#[inline(always)]
fn inner_wide<S: Simd>(_width: S, of: &Patterns, levels: &[Level], roots: &[f64]) -> Triangle {
    let mut inner = Triangle::zeros(roots.len());
    for (gram, level) in of.grams.iter().zip(levels) {
        let (diagonal, ends, next) = level.tridiagonal();
        // The products are symmetric: their columns are read as rows, up to the diagonal.
        for (own, place) in gram.stretches.iter().cloned().flatten().enumerate() {
            let sums = inner.row_mut(place);
            let row = own * gram.all.nrows()..own * gram.all.nrows() + own + 1;
            let [mut all, mut next_to, mut at_ends] =
                [&gram.all, &gram.neighbours, &gram.ends].map(|products| &products.as_slice()[row.clone()]);
            for stretch in gram.stretches.iter().take_while(|stretch| stretch.start <= place) {
                let sums = &mut sums[stretch.start..stretch.end.min(place + 1)];
                let here = sums.len();
                for (((sum, all), next_to), at_ends) in sums.iter_mut().zip(all).zip(next_to).zip(at_ends) {
                    *sum += diagonal * all + next * next_to + ends * at_ends;
                }
                [all, next_to, at_ends] = [&all[here..], &next_to[here..], &at_ends[here..]];
            }
        }
    }
    for (i, root) in roots.iter().enumerate() {
        let row = inner.row_mut(i);
        row.iter_mut().zip(roots).for_each(|(value, other)| *value *= root * other);
        match of.independence.as_slice().chunks(of.independence.nrows().max(1)).nth(i) {
            Some(own) => row.iter_mut().zip(own).for_each(|(value, own)| *value += own),
            None => row[i] += 1.0,
        }
    }
    inner
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
        let mut y = DVector::zeros(x.len());
        for (block, level) in self.of.blocks.iter().zip(&self.levels) {
            let (diagonal, ends, next) = level.tridiagonal();
            let steps = block.len();
            let x = &x[block.clone()];
            let y = &mut y.as_mut_slice()[block.clone()];
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

    /// diag(c)^½ Uᵀ x, shape (patterns,).
    fn projected(&self, x: &DVector<f64>) -> DVector<f64> {
        self.of.patterns.tr_mul(x).component_mul(&self.roots)
    }

    /// ln N(residual; 0, Σ), the residual of shape (readings,). Woodbury and the determinant lemma.
    pub fn ln_density(&self, residual: &[f64]) -> f64 {
        let unit = DVector::from_column_slice(residual).component_mul(&self.of.reciprocal);
        let precise = self.precise(unit.as_slice());
        let mut projected = self.projected(&precise);
        self.factor.solve_lower(projected.as_mut_slice());
        let of_level = |(level, block): (&Level, &Range<usize>)| {
            let steps = block.len() as f64;
            steps * level.variance.ln() + (steps - 1.0) * (1.0 - level.phi * level.phi).ln()
        };
        let ln_det = self.of.ln_units
            + self.levels.iter().zip(&self.of.blocks).map(of_level).sum::<f64>()
            + self.of.ln_correlation
            + self.factor.ln_determinant();
        let n = residual.len() as f64;
        -0.5 * (unit.dot(&precise) - projected.norm_squared() + ln_det + n * std::f64::consts::TAU.ln())
    }

    /// Σ⁻¹ X, for X of shape (readings, columns).
    pub fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut solved = columns.clone();
        for mut column in solved.column_iter_mut() {
            column.component_mul_assign(&self.of.reciprocal);
            let precise = self.precise(column.as_slice());
            let mut projected = self.projected(&precise);
            self.factor.solve(projected.as_mut_slice());
            let back = &self.of.patterns * projected.component_mul(&self.roots);
            column.copy_from(&(precise - self.precise(back.as_slice())));
            column.component_mul_assign(&self.of.reciprocal);
        }
        solved
    }

    /// The diagonal of Σ⁻¹, shape (readings,).
    pub fn precisions(&self) -> Vec<f64> {
        let taken = self.taken_by_patterns();
        let of_block = |(level, block): (&Level, &Range<usize>)| {
            let (diagonal, ends, _) = level.tridiagonal();
            let is_end = |i: usize, end: usize| if i == end { ends } else { 0.0 };
            let taken = &taken;
            let of_reading = move |i: usize| {
                let of_noise = diagonal + is_end(i, block.start) + is_end(i + 1, block.end);
                (of_noise - taken.column(i).norm_squared()) * self.of.reciprocal[i].powi(2)
            };
            block.clone().map(of_reading).collect::<Vec<f64>>()
        };
        self.levels.iter().zip(&self.of.blocks).flat_map(of_block).collect()
    }

    /// sᵀ Σ⁻¹ s of a step s of one unit from each reading on to the last of its observable, shape (readings,).
    pub fn precisions_of_steps(&self) -> Vec<f64> {
        let taken = self.taken_by_patterns();
        let mut precisions = vec![0.0; self.of.reciprocal.len()];
        for (level, block) in self.levels.iter().zip(&self.of.blocks) {
            let (diagonal, ends, next) = level.tridiagonal();
            let mut of_noise = ends - 2.0 * next;
            let mut of_patterns = DVector::zeros(self.roots.len());
            for i in block.clone().rev() {
                of_noise += diagonal + 2.0 * next;
                of_patterns += taken.column(i);
                let at_start = if i == block.start { ends } else { 0.0 };
                precisions[i] = of_noise + at_start - of_patterns.norm_squared();
            }
        }
        precisions
    }

    /// L⁻¹ diag(c)^½ Uᵀ N⁻¹ in units, the square of which is what the patterns take off the noise's precision,
    /// shape (patterns, readings).
    fn taken_by_patterns(&self) -> DMatrix<f64> {
        let mut weighted = self.of.patterns.clone();
        for (mut column, root) in weighted.column_iter_mut().zip(self.roots.iter()) {
            let precise = self.precise(column.as_slice());
            column.copy_from(&(precise * *root));
        }
        let mut taken = weighted.transpose();
        for mut column in taken.column_iter_mut() {
            self.factor.solve_lower(column.as_mut_slice());
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_low_rank_density_is_that_of_the_whole_covariance() {
        let mut patterns = DMatrix::from_fn(6, 3, |i, j| ((i * (j + 2)) as f64).sin());
        patterns.view_mut((0, 2), (4, 1)).fill(0.0);
        let units = [0.3, 0.2, 0.5, 1.0, 0.1, 0.7];
        // Four readings of the first observable, which has no share in the last pattern, and two of the second.
        let block = |i: usize| usize::from(i >= 4);
        let levels = [Level { variance: 1.7, phi: 0.6 }, Level { variance: 0.4, phi: 0.0 }];
        let variances = [2.0, 0.3, 0.5];
        let correlation = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.6, 0.8]);
        let residual = [0.1, -0.4, 0.8, 0.3, -1.0, 0.2];
        let shared = 0.6 * (2.0f64 * 0.3).sqrt();
        let within = [2.0, shared, 0.0, shared, 0.3, 0.0, 0.0, 0.0, 0.5];
        let noise = DMatrix::from_fn(6, 6, |i, k| {
            let level = levels[block(i)];
            let correlation = if block(i) == block(k) { level.phi.powi(i.abs_diff(k) as i32) } else { 0.0 };
            level.variance * units[i] * units[k] * correlation
        });
        let whole = noise + &patterns * DMatrix::from_row_slice(3, 3, &within) * patterns.transpose();
        let r = DVector::from_row_slice(&residual);
        let factor = nalgebra::Cholesky::new(whole).unwrap();
        let expected =
            -0.5 * (r.dot(&factor.solve(&r)) + factor.determinant().ln() + 6.0 * std::f64::consts::TAU.ln());
        let covariance = Patterns::new(&units, &[0..4, 4..6], &patterns, &correlation);
        let filled = covariance.fill(&levels, &variances).unwrap();
        assert!((filled.ln_density(&residual) - expected).abs() < 1e-12);
        let column = DMatrix::from_column_slice(6, 1, &residual);
        assert!((filled.solve(&column) - factor.solve(&column)).norm() < 1e-12);
        let inverse = factor.inverse();
        for (i, precision) in filled.precisions().iter().enumerate() {
            assert!((precision - inverse[(i, i)]).abs() < 1e-12 * inverse[(i, i)]);
        }
        for (i, precision) in filled.precisions_of_steps().iter().enumerate() {
            let on = |k: usize| k >= i && block(k) == block(i);
            let step = DVector::from_fn(6, |k, _| if on(k) { units[k] } else { 0.0 });
            let expected = step.dot(&(&inverse * &step));
            assert!((precision - expected).abs() < 1e-11 * expected, "{precision} {expected}");
        }
    }

    #[test]
    fn one_step_has_no_neighbour() {
        let covariance = Patterns::new(
            &[2.0],
            std::slice::from_ref(&(0..1)),
            &DMatrix::zeros(1, 0),
            &DMatrix::zeros(0, 0),
        );
        let filled = covariance.fill(&[Level { variance: 1.0, phi: 0.0 }], &[]).unwrap();
        let expected = -0.5 * (0.25 + 4f64.ln() + std::f64::consts::TAU.ln());
        assert!((filled.ln_density(&[1.0]) - expected).abs() < 1e-12);
    }
}
