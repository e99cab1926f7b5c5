//! Cholesky factors of dense matrices, row by row with dot products along the rows.
//!
//! At the few hundred rows of an emulator this is several times faster than a general routine. It runs at the width of the
//! machine's vectors; sums are made in the same order at every width, so that the digits are those of every machine.

use anyhow::{Result, bail};
use pulp::{Arch, Simd, with_simd};

/// A lower triangle, row after row up to the diagonal: half of what a square takes, of memory and of its caches.
#[derive(Clone, Debug, PartialEq)]
pub struct Triangle {
    n: usize,
    values: Vec<f64>,
}

impl Triangle {
    /// The triangle of zeros of so many rows.
    pub fn zeros(n: usize) -> Self {
        Self { n, values: vec![0.0; n * (n + 1) / 2] }
    }

    /// One without rows, which are to be added.
    fn with_capacity(n: usize) -> Self {
        Self { n: 0, values: Vec::with_capacity(n * (n + 1) / 2) }
    }

    /// Number of rows.
    pub fn n(&self) -> usize {
        self.n
    }

    /// A row up to the diagonal, shape (i + 1,).
    pub fn row(&self, i: usize) -> &[f64] {
        let first = i * (i + 1) / 2;
        &self.values[first..=first + i]
    }

    /// A row up to the diagonal, shape (i + 1,).
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        let first = i * (i + 1) / 2;
        &mut self.values[first..=first + i]
    }

    /// Take Eᵀ E away, for E of shape (rows, n).
    pub fn subtract_products(&mut self, rows: &[Vec<f64>]) {
        subtract_products(self, rows);
    }

    /// Add the next row, shape (rows so far + 1,).
    fn push(&mut self, row: &[f64]) {
        self.values.extend_from_slice(row);
        self.n += 1;
    }
}

/// An upper triangle, row after row from the diagonal on.
#[derive(Clone, Debug)]
pub struct UpperTriangle {
    n: usize,
    values: Vec<f64>,
}

impl UpperTriangle {
    /// A row from the diagonal on, shape (n − i,).
    pub fn row(&self, i: usize) -> &[f64] {
        let first = i * (2 * self.n + 1 - i) / 2;
        &self.values[first..first + self.n - i]
    }

    /// Its transpose.
    pub fn transposed(&self) -> Triangle {
        let mut lower = Triangle::zeros(self.n);
        for j in 0..self.n {
            for (i, value) in (j..).zip(self.row(j)) {
                lower.row_mut(i)[j] = *value;
            }
        }
        lower
    }
}

/// The lower factor L of a symmetric positive definite matrix, A = L Lᵀ.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Triangle,
    jitter: f64,
}

impl Cholesky {
    /// Factor a matrix of which the lower half is given.
    ///
    /// A matrix that is singular to rounding gets a jitter on its diagonal, from 1e-12 of the mean
    /// of the diagonal upwards in steps of ten until there is a factor.
    ///
    /// # Errors
    /// If there is none with a jitter of 1e-2 of the diagonal either.
    pub fn new(a: &Triangle) -> Result<Self> {
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
    pub fn lower(&self) -> &Triangle {
        &self.lower
    }

    /// ln |A|.
    pub fn ln_determinant(&self) -> f64 {
        2.0 * (0..self.lower.n()).map(|i| self.lower.row(i)[i].ln()).sum::<f64>()
    }

    /// L⁻¹ b in place of b.
    pub fn solve_lower(&self, b: &mut [f64]) {
        solve_lower(&self.lower, b);
    }

    /// L⁻ᵀ b in place of b.
    pub fn solve_upper(&self, b: &mut [f64]) {
        solve_upper(&self.lower, b);
    }

    /// A⁻¹ b in place of b.
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_lower(b);
        self.solve_upper(b);
    }

    /// L⁻ᵀ, the upper triangle of which row j is column j of L⁻¹.
    pub fn upper_inverse(&self) -> UpperTriangle {
        upper_inverse(&self.lower)
    }
}

/// The lower half of U Uᵀ for an upper triangle U: of A⁻¹, if U is [`Cholesky::upper_inverse`].
pub fn upper_times_transpose(upper: &UpperTriangle) -> Triangle {
    times_transpose(upper)
}

/// L x for a lower triangle L and vectors, each of shape (n,): the triangle is fetched once for all of them.
pub fn lower_times(lower: &Triangle, vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    triangle_times(lower, vectors)
}

#[with_simd(triangle_times = Arch::new())]
#[inline(always)]
fn triangle_times_wide<S: Simd>(simd: S, lower: &Triangle, vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = lower.n();
    let mut products = vec![vec![0.0; n]; vectors.len()];
    for i in (0..n).step_by(4) {
        let end = (i + 4).min(n);
        // Beyond the last row it stands in, and is left away.
        let rows = [0, 1, 2, 3].map(|k| lower.row((i + k).min(n - 1)));
        for (product, x) in products.iter_mut().zip(vectors) {
            product[i..end].copy_from_slice(&four_dots(simd, x, rows)[..end - i]);
        }
    }
    products
}

#[with_simd(times_transpose = Arch::new())]
#[inline(always)]
fn times_transpose_wide<S: Simd>(simd: S, upper: &UpperTriangle) -> Triangle {
    let n = upper.n;
    let mut product = Triangle::zeros(n);
    for i in 0..n {
        let row = upper.row(i);
        for j in (0..=i).step_by(4) {
            // Beyond the diagonal its own row stands in, and is left away.
            let others = [0, 1, 2, 3].map(|k| (j + k).min(i)).map(|j| &upper.row(j)[i - j..]);
            let sums = four_dots(simd, row, others);
            let last = (j + 4).min(i + 1);
            product.row_mut(i)[j..last].copy_from_slice(&sums[..last - j]);
        }
    }
    product
}

#[with_simd(subtract_products = Arch::new())]
#[inline(always)]
fn subtract_products_wide<S: Simd>(_width: S, from: &mut Triangle, rows: &[Vec<f64>]) {
    for i in 0..from.n {
        let target = from.row_mut(i);
        for row in rows {
            let at = row[i];
            target.iter_mut().zip(row).for_each(|(p, e)| *p -= at * e);
        }
    }
}

#[with_simd(solve_lower = Arch::new())]
#[inline(always)]
fn solve_lower_wide<S: Simd>(_width: S, lower: &Triangle, b: &mut [f64]) {
    for i in 0..b.len() {
        let row = lower.row(i);
        b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
    }
}

#[with_simd(solve_upper = Arch::new())]
#[inline(always)]
fn solve_upper_wide<S: Simd>(_width: S, lower: &Triangle, b: &mut [f64]) {
    for i in (0..b.len()).rev() {
        let row = lower.row(i);
        b[i] /= row[i];
        let x = b[i];
        b[..i].iter_mut().zip(row).for_each(|(b, l)| *b -= l * x);
    }
}

/// Each row is made [`SUMS`] elements at a time, which have the same whole parts of their sums.
#[with_simd(upper_inverse = Arch::new())]
#[inline(always)]
fn upper_inverse_wide<S: Simd>(simd: S, lower: &Triangle) -> UpperTriangle {
    let n = lower.n();
    let mut values = Vec::with_capacity(n * (n + 1) / 2);
    let mut made = vec![0.0; n];
    for j in 0..n {
        let made = &mut made[..n - j];
        for first in (0..made.len()).step_by(SUMS) {
            let end = (first + SUMS).min(made.len());
            for four in (first..end).step_by(4) {
                let rows = [0, 1, 2, 3].map(|k| &lower.row((j + four + k).min(n - 1))[j..]);
                let whole = whole_parts(simd, &made[..first], rows);
                for (i, whole) in (four..end.min(four + 4)).zip(whole) {
                    let row = &lower.row(j + i)[j..];
                    let sum = whole + rest(&row[first..i], &made[first..i]);
                    let pivot = 1.0 / row[i];
                    made[i] = if i == 0 { pivot } else { -sum * pivot };
                }
            }
        }
        values.extend_from_slice(made);
    }
    UpperTriangle { n, values }
}

/// Rows are made four at a time, so that the rows before are read once for all of them, and [`SUMS`] columns at a time,
/// which have the same whole parts of their sums.
#[with_simd(factor = Arch::new())]
#[inline(always)]
fn factor_wide<S: Simd>(simd: S, a: &Triangle, jitter: f64) -> Option<Triangle> {
    let n = a.n();
    let mut lower = Triangle::with_capacity(n);
    let mut made = vec![0.0; 4 * n];
    for i in (0..n).step_by(4) {
        let count = 4.min(n - i);
        // Beyond the last row it stands in, and is left away.
        let source = [0, 1, 2, 3].map(|k| a.row(i + k.min(count - 1)));
        for first in (0..i).step_by(SUMS) {
            let end = (first + SUMS).min(i);
            let mut columns = [[0.0; 4]; SUMS];
            for (column, j) in columns.iter_mut().zip(first..end) {
                let before = [0, 1, 2, 3].map(|k| &made[k * n..k * n + first]);
                *column = whole_parts(simd, &lower.row(j)[..first], before);
            }
            for c in 0..end - first {
                let other = &lower.row(first + c)[first..];
                let mut rest = [0.0; 4];
                for (column, l) in columns[..c].iter().zip(other) {
                    (0..4).for_each(|k| rest[k] += l * column[k]);
                }
                let column = &mut columns[c];
                (0..4).for_each(|k| column[k] = (source[k][first + c] - (column[k] + rest[k])) / other[c]);
            }
            for (column, j) in columns.iter().zip(first..end) {
                (0..4).for_each(|k| made[k * n + j] = column[k]);
            }
        }
        for k in 0..count {
            let row = &mut made[k * n..(k + 1) * n];
            for j in i..i + k {
                let other = lower.row(j);
                row[j] = (source[k][j] - dot(&row[..j], &other[..j])) / other[j];
            }
            let diagonal = i + k;
            let square = source[k][diagonal] + jitter - dot(&row[..diagonal], &row[..diagonal]);
            // Below this the pivot is rounding error.
            if square.is_nan() || square <= 4.0 * f64::EPSILON * (source[k][diagonal] + jitter) {
                return None;
            }
            row[diagonal] = square.sqrt();
            lower.push(&row[..=diagonal]);
        }
    }
    Some(lower)
}

/// Partial sums of a dot product: the elements at every eighth place, so that it runs at the width of the machine.
const SUMS: usize = 8;

/// Σ aᵢ bᵢ: its whole part, which is the partial sums of as many eights as there are, and the rest.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<SUMS>();
    let (b, b_rest) = b.as_chunks::<SUMS>();
    let mut sums = [0.0; SUMS];
    for (a, b) in a.iter().zip(b) {
        for l in 0..SUMS {
            sums[l] += a[l] * b[l];
        }
    }
    sums.iter().sum::<f64>() + rest(a_rest, b_rest)
}

/// Σ aᵢ bᵢ, one after the other.
#[inline(always)]
fn rest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// [`dot`] of four with as much of `a` as each is long, the first no longer than the others, to the same digits.
#[inline(always)]
fn four_dots<S: Simd>(simd: S, a: &[f64], b: [&[f64]; 4]) -> [f64; 4] {
    let whole = b[0].len() / SUMS * SUMS;
    let mut sums = partial_sums(simd, &a[..whole], b);
    std::array::from_fn(|k| {
        let (y, y_rest) = b[k][whole..].as_chunks::<SUMS>();
        let (x, x_rest) = a[whole..b[k].len()].as_chunks::<SUMS>();
        for (x, y) in x.iter().zip(y) {
            for l in 0..SUMS {
                sums[k][l] += x[l] * y[l];
            }
        }
        sums[k].iter().sum::<f64>() + rest(x_rest, y_rest)
    })
}

/// The whole parts of the dot products of `a`, whose length is a multiple of [`SUMS`], with as much of each of four.
#[inline(always)]
fn whole_parts<S: Simd>(simd: S, a: &[f64], b: [&[f64]; 4]) -> [f64; 4] {
    partial_sums(simd, a, b).map(|sums| sums.iter().sum())
}

/// Their partial sums: as many vectors as these need at this width.
#[inline(always)]
fn partial_sums<S: Simd>(simd: S, a: &[f64], b: [&[f64]; 4]) -> [[f64; SUMS]; 4] {
    let parts = SUMS / S::F64_LANES;
    let (x, _) = S::as_simd_f64s(a);
    let y = b.map(|b| &S::as_simd_f64s(&b[..a.len()]).0[..x.len()]);
    let mut sums = [[simd.splat_f64s(0.0); SUMS]; 4];
    for first in (0..x.len()).step_by(parts) {
        for part in 0..parts {
            let x = x[first + part];
            for (sums, y) in sums.iter_mut().zip(y) {
                sums[part] = simd.add_f64s(sums[part], simd.mul_f64s(x, y[first + part]));
            }
        }
    }
    sums.map(|sums| {
        let mut eight = [0.0; SUMS];
        S::as_mut_simd_f64s(&mut eight).0.copy_from_slice(&sums[..parts]);
        eight
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use pulp::Scalar;

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
            let (mut a, mut twice) = (Triangle::zeros(n), Triangle::zeros(n));
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

    /// exp(−|i − j| / n) with a nugget on the diagonal.
    fn correlation(n: usize) -> Triangle {
        let mut matrix = Triangle::zeros(n);
        for i in 0..n {
            for (j, value) in matrix.row_mut(i).iter_mut().enumerate() {
                *value = (-((i - j) as f64) / n as f64).exp() + if i == j { 1e-3 } else { 0.0 };
            }
        }
        matrix
    }

    #[test]
    fn digits_are_the_same_at_every_width() {
        let narrow = Scalar::new();
        for n in [1, 3, 4, 7, 8, 9, 15, 16, 17, 30, 61] {
            let a = correlation(n);
            let lower = factor(&a, 0.0).unwrap();
            assert_eq!(lower, factor_wide(narrow, &a, 0.0).unwrap(), "{n}");
            let upper = upper_inverse(&lower);
            assert_eq!(upper.values, upper_inverse_wide(narrow, &lower).values, "{n}");
            assert_eq!(times_transpose(&upper), times_transpose_wide(narrow, &upper), "{n}");
            let vectors: Vec<Vec<f64>> = (1..4).map(|k| (0..n).map(|i| (k * i) as f64).collect()).collect();
            assert_eq!(
                triangle_times(&lower, &vectors),
                triangle_times_wide(narrow, &lower, &vectors),
                "{n}"
            );
            // An element is what a dot product along its rows makes of it.
            let (i, j) = (n - 1, n / 2);
            let sum = dot(&lower.row(i)[..j], &lower.row(j)[..j]);
            let element = (a.row(i)[j] - sum) / lower.row(j)[j];
            assert!(i == j || lower.row(i)[j] == element, "{n}");
        }
    }

    #[test]
    fn a_singular_covariance_gets_a_jitter() {
        let mut a = Triangle::zeros(3);
        (0..3).for_each(|i| a.row_mut(i).fill(1.0));
        let cholesky = Cholesky::new(&a).unwrap();
        assert!(cholesky.jitter() > 0.0 && cholesky.jitter() < 1e-9);
        let mut not_definite = Triangle::zeros(2);
        not_definite.row_mut(0)[0] = 1.0;
        not_definite.row_mut(1)[1] = -1.0;
        assert!(Cholesky::new(&not_definite).is_err());
    }
}
