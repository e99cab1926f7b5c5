//! Cholesky factors of dense matrices, row by row with dot products along the rows.
//!
//! At the few hundred rows of an emulator this is several times faster than a general routine.

use anyhow::{Result, bail};

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
        let n = self.lower.n();
        let mut upper = Square::zeros(n);
        for i in 0..n {
            let row = self.lower.row(i);
            let pivot = 1.0 / row[i];
            let mut j = 0;
            while j + 4 <= i {
                // The entries of rows j + 1 to j + 3 before their diagonal are zero.
                let sums = dot4(&row[j..i], [0, 1, 2, 3].map(|l| &upper.row(j + l)[j..i]));
                for (l, sum) in sums.into_iter().enumerate() {
                    upper.row_mut(j + l)[i] = -sum * pivot;
                }
                j += 4;
            }
            for j in j..i {
                let sum = dot(&row[j..i], &upper.row(j)[j..i]);
                upper.row_mut(j)[i] = -sum * pivot;
            }
            upper.row_mut(i)[i] = pivot;
        }
        upper
    }
}

/// The lower half of U Uᵀ for an upper triangle U: of A⁻¹, if U is [`Cholesky::upper_inverse`].
pub fn upper_times_transpose(upper: &Square) -> Square {
    let n = upper.n();
    let mut product = Square::zeros(n);
    for i in 0..n {
        let row = &upper.row(i)[i..];
        let mut j = 0;
        while j + 4 <= i + 1 {
            let sums = dot4(row, [0, 1, 2, 3].map(|l| &upper.row(j + l)[i..]));
            product.row_mut(i)[j..j + 4].copy_from_slice(&sums);
            j += 4;
        }
        for j in j..=i {
            product.row_mut(i)[j] = dot(row, &upper.row(j)[i..]);
        }
    }
    product
}

fn factor(a: &Square, jitter: f64) -> Option<Square> {
    let n = a.n();
    let mut lower = Square::zeros(n);
    for i in 0..n {
        let source = a.row(i);
        let (before, row) = lower.rows_before(i);
        let earlier = |j: usize| &before[j * n..j * n + n];
        let mut j = 0;
        while j + 4 <= i {
            let sums = dot4(&row[..j], [0, 1, 2, 3].map(|l| &earlier(j + l)[..j]));
            for (l, mut sum) in sums.into_iter().enumerate() {
                let other = earlier(j + l);
                for m in j..j + l {
                    sum += row[m] * other[m];
                }
                row[j + l] = (source[j + l] - sum) / other[j + l];
            }
            j += 4;
        }
        for j in j..i {
            let other = earlier(j);
            row[j] = (source[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let square = source[i] + jitter - dot(&row[..i], &row[..i]);
        // Below this the pivot is rounding error.
        if !(square > 4.0 * f64::EPSILON * (source[i] + jitter)) {
            return None;
        }
        row[i] = square.sqrt();
    }
    Some(lower)
}

/// Σ aᵢ bᵢ, in eight partial sums so that it runs at the width of the machine.
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

/// The products of one row with four, which loads the one only once.
fn dot4(a: &[f64], b: [&[f64]; 4]) -> [f64; 4] {
    let (a, a_rest) = a.as_chunks::<4>();
    let chunks = b.map(|b| b.as_chunks::<4>());
    let mut sums = [[0.0; 4]; 4];
    let rows = chunks[0].0.iter().zip(chunks[1].0).zip(chunks[2].0).zip(chunks[3].0);
    for (a, (((b0, b1), b2), b3)) in a.iter().zip(rows) {
        for l in 0..4 {
            sums[0][l] += a[l] * b0[l];
            sums[1][l] += a[l] * b1[l];
            sums[2][l] += a[l] * b2[l];
            sums[3][l] += a[l] * b3[l];
        }
    }
    [0, 1, 2, 3].map(|r| {
        let rest: f64 = a_rest.iter().zip(chunks[r].1).map(|(a, b)| a * b).sum();
        (sums[r][0] + sums[r][1]) + (sums[r][2] + sums[r][3]) + rest
    })
}
