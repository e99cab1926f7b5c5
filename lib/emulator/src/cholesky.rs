//! Cholesky factors of dense matrices, row by row with dot products along the rows.
//!
//! At the few hundred rows of an emulator this is several times faster than a general routine. It runs at the width of the
//! machine's vectors; sums are made in the same order at every width, so that the digits are those of every machine.

use anyhow::{Result, bail};
use pulp::{Arch, Simd, with_simd};

/// A square matrix, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Square {
    n: usize,
    values: Vec<f64>,
}

impl Square {
    /// The matrix of zeros, shape (n, n).
    pub fn zeros(n: usize) -> Self {
        Self { n, values: vec![0.0; n * n] }
    }

    /// Number of rows.
    pub fn n(&self) -> usize {
        self.n
    }

    /// A row, shape (n,).
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }

    /// A row, shape (n,).
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[i * self.n..(i + 1) * self.n]
    }

    /// All rows before a row, and that row.
    fn rows_before(&mut self, i: usize) -> (&[f64], &mut [f64]) {
        let (before, rest) = self.values.split_at_mut(i * self.n);
        (before, &mut rest[..self.n])
    }
}

/// The lower factor L of a symmetric positive definite matrix, A = L Lᵀ.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Square,
    jitter: f64,
}

impl Cholesky {
    /// Factor a matrix of which only the lower half is read.
    ///
    /// A matrix that is singular to rounding gets a jitter on its diagonal, from 1e-12 of the mean
    /// of the diagonal upwards in steps of ten until there is a factor.
    ///
    /// # Errors
    /// If there is none with a jitter of 1e-2 of the diagonal either.
    pub fn new(a: &Square) -> Result<Self> {
        let n = a.n();
        let scale = (0..n).map(|i| a.row(i)[i]).sum::<f64>() / n.max(1) as f64;
        let mut jitter = 0.0;
        while jitter <= 1e-2 {
            if let Some(lower) = factor(a, jitter * scale) {
                return Ok(Self { lower, jitter: jitter * scale });
            }
            jitter = if jitter == 0.0 { 1e-12 } else { 10.0 * jitter };
        }
        bail!("a matrix of {n} rows is not positive definite")
    }

    /// What was added to the diagonal; zero for most matrices.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// L.
    pub fn lower(&self) -> &Square {
        &self.lower
    }

    /// ln |A|.
    pub fn ln_determinant(&self) -> f64 {
        2.0 * (0..self.lower.n()).map(|i| self.lower.row(i)[i].ln()).sum::<f64>()
    }

    /// L⁻¹ b in place of b.
    pub fn solve_lower(&self, b: &mut [f64]) {
        for i in 0..b.len() {
            let row = self.lower.row(i);
            b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
        }
    }

    /// L⁻ᵀ b in place of b.
    pub fn solve_upper(&self, b: &mut [f64]) {
        for i in (0..b.len()).rev() {
            let row = self.lower.row(i);
            b[i] /= row[i];
            let x = b[i];
            b[..i].iter_mut().zip(row).for_each(|(b, l)| *b -= l * x);
        }
    }

    /// A⁻¹ b in place of b.
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_lower(b);
        self.solve_upper(b);
    }

    /// L⁻ᵀ, the upper triangle of which row j is column j of L⁻¹.
    pub fn upper_inverse(&self) -> Square {
        upper_inverse(&self.lower)
    }
}

/// The lower half of U Uᵀ for an upper triangle U: of A⁻¹, if U is [`Cholesky::upper_inverse`].
pub fn upper_times_transpose(upper: &Square) -> Square {
    times_transpose(upper)
}

/// L x for a lower triangle L, of which only the lower half is read, and vectors, each of shape (n,): the triangle is
/// fetched once for all of them.
pub fn lower_times(lower: &Square, vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    triangle_times(lower, vectors)
}

#[with_simd(triangle_times = Arch::new())]
#[inline(always)]
fn triangle_times_wide<S: Simd>(simd: S, lower: &Square, vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = lower.n();
    let mut products = vec![vec![0.0; n]; vectors.len()];
    for i in (0..n).step_by(4) {
        let end = (i + 4).min(n);
        // Beyond the last row it stands in, and is left away.
        let rows = [0, 1, 2, 3].map(|k| (i + k).min(n - 1)).map(|row| &lower.row(row)[..=row]);
        for (product, x) in products.iter_mut().zip(vectors) {
            product[i..end].copy_from_slice(&four_dots(simd, x, rows)[..end - i]);
        }
    }
    products
}

#[with_simd(times_transpose = Arch::new())]
#[inline(always)]
fn times_transpose_wide<S: Simd>(simd: S, upper: &Square) -> Square {
    let n = upper.n();
    let mut product = Square::zeros(n);
    for i in 0..n {
        let row = &upper.row(i)[i..];
        for j in (0..=i).step_by(4) {
            // Beyond the diagonal its own row stands in, and is left away.
            let sums = four_dots(simd, row, [0, 1, 2, 3].map(|k| &upper.row((j + k).min(i))[i..]));
            let last = (j + 4).min(i + 1);
            product.row_mut(i)[j..last].copy_from_slice(&sums[..last - j]);
        }
    }
    product
}

#[with_simd(upper_inverse = Arch::new())]
#[inline(always)]
fn upper_inverse_wide<S: Simd>(_width: S, lower: &Square) -> Square {
    let n = lower.n();
    let mut upper = Square::zeros(n);
    for i in 0..n {
        let row = lower.row(i);
        let pivot = 1.0 / row[i];
        for j in 0..i {
            let sum = dot(&row[j..i], &upper.row(j)[j..i]);
            upper.row_mut(j)[i] = -sum * pivot;
        }
        upper.row_mut(i)[i] = pivot;
    }
    upper
}

/// Rows are made four at a time, so that the rows before are read once for all of them.
#[with_simd(factor = Arch::new())]
#[inline(always)]
fn factor_wide<S: Simd>(simd: S, a: &Square, jitter: f64) -> Option<Square> {
    let n = a.n();
    let mut lower = Square::zeros(n);
    for i in 0..n {
        if i % 4 == 0 && i + 4 <= n {
            let (before, rows) = lower.values.split_at_mut(i * n);
            for (j, other) in before.chunks_exact(n).enumerate() {
                let sums = four_dots(simd, &other[..j], [0, 1, 2, 3].map(|k| &rows[k * n..k * n + j]));
                for (k, sum) in sums.into_iter().enumerate() {
                    rows[k * n + j] = (a.row(i + k)[j] - sum) / other[j];
                }
            }
        }
        // The rows of the same four that are before this one; all of them, where there are no four.
        let done = if i / 4 * 4 + 4 <= n { i / 4 * 4 } else { 0 };
        let source = a.row(i);
        let (before, row) = lower.rows_before(i);
        for (j, other) in before.chunks_exact(n).enumerate().skip(done) {
            row[j] = (source[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let square = source[i] + jitter - dot(&row[..i], &row[..i]);
        // Below this the pivot is rounding error.
        if square.is_nan() || square <= 4.0 * f64::EPSILON * (source[i] + jitter) {
            return None;
        }
        row[i] = square.sqrt();
    }
    Some(lower)
}

/// Σ aᵢ bᵢ, in eight partial sums so that it runs at the width of the machine.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for l in 0..8 {
            sums[l] += a[l] * b[l];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// [`dot`] of four with as much of `a` as each is long, the first no longer than the others, to the same digits: as many
/// vectors as eight partial sums need at this width.
#[inline(always)]
fn four_dots<S: Simd>(simd: S, a: &[f64], b: [&[f64]; 4]) -> [f64; 4] {
    let parts = 8 / S::F64_LANES;
    let whole = b[0].len() / 8 * 8;
    let (x, _) = S::as_simd_f64s(&a[..whole]);
    let y = b.map(|b| &S::as_simd_f64s(&b[..whole]).0[..x.len()]);
    let mut sums = [[simd.splat_f64s(0.0); 8]; 4];
    for first in (0..x.len()).step_by(parts) {
        for part in 0..parts {
            let x = x[first + part];
            for (sums, y) in sums.iter_mut().zip(y) {
                sums[part] = simd.add_f64s(sums[part], simd.mul_f64s(x, y[first + part]));
            }
        }
    }
    std::array::from_fn(|k| {
        let mut eight = [0.0; 8];
        S::as_mut_simd_f64s(&mut eight).0.copy_from_slice(&sums[k][..parts]);
        let (y, y_rest) = b[k][whole..].as_chunks::<8>();
        let (x, x_rest) = a[whole..b[k].len()].as_chunks::<8>();
        for (x, y) in x.iter().zip(y) {
            for l in 0..8 {
                eight[l] += x[l] * y[l];
            }
        }
        let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
        eight.iter().sum::<f64>() + rest
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_factor_inverts_and_its_determinant_scales(
            n in 1_usize..23, seed in prop::collection::vec(-1.0_f64..1.0, 23 * 23)
        ) {
            // B Bᵀ + I, of which only the lower half is given.
            let b = |i: usize, k: usize| seed[i * 23 + k];
            let entry = |i: usize, j: usize| {
                (0..n).map(|k| b(i, k) * b(j, k)).sum::<f64>() + f64::from(u8::from(i == j))
            };
            let (mut a, mut twice) = (Square::zeros(n), Square::zeros(n));
            for i in 0..n {
                for j in 0..=i {
                    a.row_mut(i)[j] = entry(i, j);
                    twice.row_mut(i)[j] = 2.0 * entry(i, j);
                }
            }
            let cholesky = Cholesky::new(&a).unwrap();
            prop_assert!(cholesky.jitter() == 0.0);
            let twice = Cholesky::new(&twice).unwrap().ln_determinant();
            prop_assert!((twice - cholesky.ln_determinant() - n as f64 * 2.0_f64.ln()).abs() < 1e-11);
            let inverse = upper_times_transpose(&cholesky.upper_inverse());
            let full = |i: usize, j: usize| inverse.row(i.max(j))[i.min(j)];
            for i in 0..n {
                let mut solved: Vec<f64> = (0..n).map(|j| entry(i, j)).collect();
                cholesky.solve(&mut solved);
                for (j, solved) in solved.into_iter().enumerate() {
                    let unit = f64::from(u8::from(i == j));
                    prop_assert!((solved - unit).abs() < 1e-10);
                    let product: f64 = (0..n).map(|k| entry(i, k) * full(k, j)).sum();
                    prop_assert!((product - unit).abs() < 1e-10);
                }
            }
        }
    }

    #[test]
    fn a_singular_covariance_gets_a_jitter() {
        let mut a = Square::zeros(3);
        (0..3).for_each(|i| a.row_mut(i).fill(1.0));
        let cholesky = Cholesky::new(&a).unwrap();
        assert!(cholesky.jitter() > 0.0 && cholesky.jitter() < 1e-9);
        let mut not_definite = Square::zeros(2);
        not_definite.row_mut(0)[0] = 1.0;
        not_definite.row_mut(1)[1] = -1.0;
        assert!(Cholesky::new(&not_definite).is_err());
    }
}
