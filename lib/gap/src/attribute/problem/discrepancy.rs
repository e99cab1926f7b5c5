//! What no hypothesis explains: a smooth curve along the control.

use nalgebra::{DMatrix, SymmetricEigen};

/// Smooth patterns of one observable along the control, and how much of a discrepancy's variance
/// each carries.
#[derive(Clone, Debug)]
pub struct Smooth {
    /// Orthonormal patterns, shape (steps, patterns), smoothest first.
    pub patterns: DMatrix<f64>,
    /// Variance of each for a discrepancy of variance 1 at every step, of which no length is known, shape (patterns,).
    pub variances: Vec<f64>,
    /// ln of these for a discrepancy of one length, shape ([`LENGTHS_BETWEEN`], patterns); empty for errors of a form, whose
    /// length is not asked.
    ln_of_length: Vec<Vec<f64>>,
}

/// Correlation lengths as shares of the control: a discrepancy may be of any of them.
const LENGTHS: [f64; 3] = [0.1, 0.3, 1.0];

/// Share of a discrepancy that the patterns kept must carry.
const KEPT: f64 = 0.995;

/// The same for the errors of the form of an effect, which are of its own shape, stretched and bent.
const LENGTHS_OF_FORM: [f64; 2] = [0.3, 1.0];
const KEPT_OF_FORM: f64 = 0.98;

/// The shortest and the longest length that a rest may have, as shares of the control. What is rougher is an error of single
/// readings or a noise that is correlated, what is smoother looks the same over the whole control.
pub const SHORTEST: f64 = 0.06;
/// See [`SHORTEST`].
pub const LONGEST: f64 = 1.0;

/// Number of lengths for which variances are computed, evenly apart in their logarithms.
const LENGTHS_BETWEEN: usize = 17;

/// The smallest variance of a pattern: what is less is rounding.
const SMALLEST: f64 = 1e-9;

impl Smooth {
    /// Patterns of a Gaussian process with an even mixture of squared-exponential correlations of
    /// lengths 0.1, 0.3 and 1, at places in [0, 1] along the control, shape (steps,).
    pub fn new(places: &[f64]) -> Self {
        let smooth = Self::of_lengths(places, &LENGTHS, KEPT);
        let ln_of_length = (0..LENGTHS_BETWEEN).map(|k| {
            let length = SHORTEST * (LONGEST / SHORTEST).powf(k as f64 / (LENGTHS_BETWEEN - 1) as f64);
            let correlated = correlation(places, &[length]) * &smooth.patterns;
            let variance = |i: usize| correlated.column(i).dot(&smooth.patterns.column(i));
            (0..smooth.len()).map(|i| variance(i).max(SMALLEST).ln()).collect()
        });
        Self { ln_of_length: ln_of_length.collect(), ..smooth }
    }

    /// The same with lengths 0.3 and 1, for what an effect of another form would be multiplied by.
    pub fn of_form(places: &[f64]) -> Self {
        Self::of_lengths(places, &LENGTHS_OF_FORM, KEPT_OF_FORM)
    }

    fn of_lengths(places: &[f64], lengths: &[f64], share: f64) -> Self {
        let steps = places.len();
        let eigen = SymmetricEigen::new(correlation(places, lengths));
        let mut order: Vec<usize> = (0..steps).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let (mut kept, mut carried) = (0, 0.0);
        while kept < steps && carried < share * steps as f64 {
            carried += eigen.eigenvalues[order[kept]];
            kept += 1;
        }
        let patterns = DMatrix::from_fn(steps, kept, |t, i| eigen.eigenvectors[(t, order[i])]);
        let variances = order[..kept].iter().map(|&i| eigen.eigenvalues[i].max(0.0)).collect();
        Self { patterns, variances, ln_of_length: Vec::new() }
    }

    /// The variance of each pattern for a discrepancy of variance 1 at every step whose squared-exponential correlation has
    /// this length, between [`SHORTEST`] and [`LONGEST`]: patterns are taken to be independent at every length, as waves are.
    pub fn variances_of(&self, length: f64) -> impl Iterator<Item = f64> {
        let last = LENGTHS_BETWEEN - 1;
        let place = (length / SHORTEST).ln() / (LONGEST / SHORTEST).ln() * last as f64;
        let below = (place as usize).min(last - 1);
        let share = place - below as f64;
        let between = move |(a, b): (&f64, &f64)| (a + share * (b - a)).exp();
        self.ln_of_length[below].iter().zip(&self.ln_of_length[below + 1]).map(between)
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

/// Even mixture of squared-exponential correlations of these lengths, shape (steps, steps).
fn correlation(places: &[f64], lengths: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(places.len(), places.len(), |s, t| {
        let apart = places[s] - places[t];
        let correlation = |length: &f64| (-0.5 * (apart / length).powi(2)).exp();
        lengths.iter().map(correlation).sum::<f64>() / lengths.len() as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_discrepancy_of_one_length_is_that_of_its_correlation_but_for_what_its_patterns_leave_out() {
        let places: Vec<f64> = (0..40).map(|t| f64::from(t) / 39.0).collect();
        let smooth = Smooth::new(&places);
        for length in [0.1, 0.2, 0.37, 1.0] {
            let roots: Vec<f64> = smooth.variances_of(length).map(f64::sqrt).collect();
            let factor = &smooth.patterns * DMatrix::from_diagonal(&roots.into());
            let off = &factor * factor.transpose() - correlation(&places, &[length]);
            let mean_square = off.norm_squared() / (40.0 * 40.0);
            assert!(mean_square.sqrt() < 0.1, "{length}: {}", mean_square.sqrt());
            let variance = factor.norm_squared() / 40.0;
            assert!((variance - 1.0).abs() < 0.05, "{length}: {variance}");
        }
    }
}
