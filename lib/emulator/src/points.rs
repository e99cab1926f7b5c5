//! Points with the mean function at them.

use anyhow::{Result, ensure};

use super::cholesky::dot;
pub use super::kernel::Kernel;

/// The mean function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mean {
    /// Zero.
    Zero,
    /// A constant.
    Constant,
    /// A constant and a slope along each input.
    Linear,
}

/// Points with the mean function at them, shared by all outputs over the same points.
#[derive(Clone, Debug)]
pub struct Points {
    /// Input-major, shape (inputs, points).
    pub(super) inputs: Vec<Vec<f64>>,
    /// Inputs that the mean function has a slope along.
    pub(super) sloped: Vec<usize>,
    pub(super) has_constant: bool,
    /// The mean function's terms at the points, shape (terms, points).
    pub(super) terms: Vec<Vec<f64>>,
    pub(super) n: usize,
    pub(super) kernel: Kernel,
}

impl Points {
    /// Points from rows of inputs, shape (points, inputs).
    ///
    /// A slope along an input that the inputs before it determine at every point is left out.
    ///
    /// # Errors
    /// If there are not at least two points more than terms in the mean function.
    pub fn new(rows: &[Vec<f64>], mean: Mean) -> Result<Self> {
        let n = rows.len();
        let d = rows.first().map_or(0, Vec::len);
        let inputs: Vec<Vec<f64>> = (0..d).map(|q| rows.iter().map(|row| row[q]).collect()).collect();
        let has_constant = mean != Mean::Zero;
        let mut terms: Vec<Vec<f64>> = Vec::new();
        let mut sloped = Vec::new();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        if has_constant {
            terms.push(vec![1.0; n]);
            basis.push(vec![1.0 / (n as f64).sqrt(); n]);
        }
        for q in (0..d).filter(|_| mean == Mean::Linear) {
            let mut rest = inputs[q].clone();
            for _ in 0..2 {
                for known in &basis {
                    let along = dot(known, &rest);
                    rest.iter_mut().zip(known).for_each(|(x, k)| *x -= along * k);
                }
            }
            let length = dot(&rest, &rest).sqrt();
            if length > 1e-6 * dot(&inputs[q], &inputs[q]).sqrt() {
                rest.iter_mut().for_each(|x| *x /= length);
                basis.push(rest);
                terms.push(inputs[q].clone());
                sloped.push(q);
            }
        }
        ensure!(
            n >= terms.len() + 2,
            "{n} points for a mean function of {} terms; at least {} are needed",
            terms.len(),
            terms.len() + 2
        );
        Ok(Self { inputs, sloped, has_constant, terms, n, kernel: Kernel::default() })
    }

    /// The same points, correlated by this kernel; Matérn-5/2 where none is chosen.
    pub fn with_kernel(self, kernel: Kernel) -> Self {
        Self { kernel, ..self }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Number of inputs.
    pub fn dimension(&self) -> usize {
        self.inputs.len()
    }

    /// The points of one input, shape (points,).
    pub fn input(&self, q: usize) -> &[f64] {
        &self.inputs[q]
    }

    /// The mean function's terms at another point, shape (terms,).
    pub(super) fn terms_at(&self, x: &[f64]) -> Vec<f64> {
        let constant = self.has_constant.then_some(1.0);
        constant.into_iter().chain(self.sloped.iter().map(|&q| x[q])).collect()
    }
}
