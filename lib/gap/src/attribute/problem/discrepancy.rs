//! What no hypothesis explains: a smooth curve along the control.

use nalgebra::{DMatrix, SymmetricEigen};

/// Smooth patterns of one observable along the control, and how much of a discrepancy's variance
/// each carries.
#[derive(Clone, Debug)]
pub struct Smooth {
    /// Orthonormal patterns, shape (steps, patterns), smoothest first.
    pub patterns: DMatrix<f64>,
    /// Variance of each for a discrepancy of variance 1 at every step, shape (patterns,).
    pub variances: Vec<f64>,
}

/// Correlation lengths as shares of the control: a discrepancy may be of any of them.
const LENGTHS: [f64; 3] = [0.1, 0.3, 1.0];

/// Share of a discrepancy that the patterns kept must carry.
const KEPT: f64 = 0.995;

/// The same for the errors of the form of an effect, which are of its own shape, stretched and bent.
const LENGTHS_OF_FORM: [f64; 2] = [0.3, 1.0];
const KEPT_OF_FORM: f64 = 0.98;

impl Smooth {
    /// Patterns of a Gaussian process with an even mixture of squared-exponential correlations of
    /// lengths 0.1, 0.3 and 1, at places in [0, 1] along the control, shape (steps,).
    pub fn new(places: &[f64]) -> Self {
        Self::of_lengths(places, &LENGTHS, KEPT)
    }

    /// The same with lengths 0.3 and 1, for what an effect of another form would be multiplied by.
    pub fn of_form(places: &[f64]) -> Self {
        Self::of_lengths(places, &LENGTHS_OF_FORM, KEPT_OF_FORM)
    }

    fn of_lengths(places: &[f64], lengths: &[f64], share: f64) -> Self {
        let steps = places.len();
        let kernel = DMatrix::from_fn(steps, steps, |s, t| {
            let apart = places[s] - places[t];
            let correlation = |length: &f64| (-0.5 * (apart / length).powi(2)).exp();
            lengths.iter().map(correlation).sum::<f64>() / lengths.len() as f64
        });
        let eigen = SymmetricEigen::new(kernel);
        let mut order: Vec<usize> = (0..steps).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let (mut kept, mut carried) = (0, 0.0);
        while kept < steps && carried < share * steps as f64 {
            carried += eigen.eigenvalues[order[kept]];
            kept += 1;
        }
        let patterns = DMatrix::from_fn(steps, kept, |t, i| eigen.eigenvectors[(t, order[i])]);
        let variances = order[..kept].iter().map(|&i| eigen.eigenvalues[i].max(0.0)).collect();
        Self { patterns, variances }
    }

    /// Number of patterns.
    pub fn len(&self) -> usize {
        self.variances.len()
    }

    /// Whether there are no patterns.
    pub fn is_empty(&self) -> bool {
        self.variances.is_empty()
    }
}
