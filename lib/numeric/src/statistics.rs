//! Weighted samples: normalisation, effective sample size, moments and quantiles.

use anyhow::{Result, ensure};
use nalgebra::{DMatrix, DVector};

/// ln Σ exp(xᵢ), without overflow; −∞ for an empty slice.
pub fn ln_sum_exp(x: &[f64]) -> f64 {
    let high = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !high.is_finite() {
        return high;
    }
    high + x.iter().map(|x| (x - high).exp()).sum::<f64>().ln()
}

/// Weights that sum to one from their natural logarithms, shape (n_samples,).
///
/// # Errors
/// If `ln_w` is empty, holds NaN or +∞, or is −∞ throughout.
pub fn normalised(ln_w: &[f64]) -> Result<Vec<f64>> {
    ensure!(!ln_w.is_empty(), "no weights");
    ensure!(!ln_w.iter().any(|w| w.is_nan() || *w == f64::INFINITY), "a weight is NaN or infinite");
    let high = ln_w.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    ensure!(high > f64::NEG_INFINITY, "every weight is zero");
    let mut weights: Vec<f64> = ln_w.iter().map(|w| (w - high).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    Ok(weights)
}

/// Effective sample size as a fraction of the ensemble, in (0, 1]: (Σw)² / (N Σw²).
///
/// * `ln_w` — natural-log weights, shape (n_samples,), not normalised.
///
/// # Errors
/// If `ln_w` is empty, holds NaN or +∞, or is −∞ throughout.
///
/// # Source
/// Kong, Liu & Wong (1994), JASA 89:278.
///
/// # Examples
/// ```
/// use gl_numeric::statistics::ess_fraction;
///
/// // Four samples of which three weigh nothing; and the factor that all weights have in common makes no difference.
/// assert_eq!(ess_fraction(&[-1000.0, f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY])?, 0.25);
/// assert_eq!(ess_fraction(&[-1000.0; 4])?, 1.0);
/// # Ok::<(), anyhow::Error>(())
/// ```
pub fn ess_fraction(ln_w: &[f64]) -> Result<f64> {
    let weights = normalised(ln_w)?;
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    Ok(1.0 / (squares * weights.len() as f64))
}

/// Effective number of samples, 1/Σw², under weights that sum to one.
///
/// # Source
/// Kong, Liu & Wong (1994), JASA 89:278.
///
/// # Examples
/// ```
/// use gl_numeric::statistics::effective_size;
///
/// assert_eq!(effective_size(&[0.5, 0.5, 0.0]), 2.0);
/// assert!((effective_size(&[0.6, 0.2, 0.2]) - 1.0 / 0.44).abs() < 1e-12);
/// ```
pub fn effective_size(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

/// Mean under weights that sum to one.
pub fn mean(values: &[f64], weights: &[f64]) -> f64 {
    values.iter().zip(weights).map(|(x, w)| x * w).sum()
}

/// Standard deviation under weights that sum to one: √(Σ w (x − mean)²).
pub fn sd(values: &[f64], weights: &[f64]) -> f64 {
    let centre = mean(values, weights);
    values.iter().zip(weights).map(|(x, w)| w * (x - centre).powi(2)).sum::<f64>().sqrt()
}

/// Quantiles under weights that sum to one.
///
/// Samples of the same value are one sample with their weights together, so that the order of the rows
/// makes no difference. With equal weights these are Hazen's plotting positions, (i − ½)/n.
///
/// # Examples
/// ```
/// use gl_numeric::statistics::Quantiles;
///
/// let quantiles = Quantiles::new(&[3.0, 1.0], &[0.5, 0.5]);
/// assert_eq!([0.25, 0.5, 0.75, 1.0].map(|p| quantiles.at(p)), [1.0, 2.0, 3.0, 3.0]);
/// assert_eq!([0.25, 0.5, 0.75, 1.0].map(|p| quantiles.among(p)), [1.0, 2.0, 3.0, 3.0]);
/// // What hardly weighs anything moves the one, and not the other.
/// let quantiles = Quantiles::new(&[1.0, 2.0, 9.0], &[1e-9, 0.95, 0.05]);
/// assert!(quantiles.at(0.05) < 1.2);
/// assert_eq!(quantiles.among(0.05), 2.0);
/// ```
#[derive(Clone, Debug)]
pub struct Quantiles {
    /// Those with a weight above zero, in order.
    samples: Vec<Share>,
}

/// A sample's share of the probability.
#[derive(Clone, Copy, Debug)]
struct Share {
    value: f64,
    share: f64,
    /// Probability below it.
    below: f64,
}

impl Share {
    fn middle(self) -> f64 {
        self.below + self.share / 2.0
    }

    fn up_to(self) -> f64 {
        self.below + self.share
    }
}

impl Quantiles {
    /// Sort the samples once, for any number of quantiles.
    pub fn new(values: &[f64], weights: &[f64]) -> Self {
        let weighted = values.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
        let mut samples: Vec<Share> =
            weighted.map(|(&value, &share)| Share { value, share, below: 0.0 }).collect();
        samples.sort_by(|a, b| a.value.total_cmp(&b.value).then(a.share.total_cmp(&b.share)));
        samples.dedup_by(|next, kept| {
            let is_tie = next.value == kept.value;
            kept.share += if is_tie { next.share } else { 0.0 };
            is_tie
        });
        let mut below = 0.0;
        for sample in &mut samples {
            sample.below = below;
            below += sample.share;
        }
        Self { samples }
    }

    /// The value below which the probability is `p`, linear between the midpoints of the samples' shares: of the law that a
    /// few samples are drawn from, whose tails lie beyond them. NaN if there are no samples.
    pub fn at(&self, p: f64) -> f64 {
        let next = self.samples.partition_point(|sample| sample.middle() < p);
        match (next.checked_sub(1).map(|i| self.samples[i]), self.samples.get(next)) {
            (Some(one), Some(other)) => {
                let (p0, p1) = (one.middle(), other.middle());
                one.value + (other.value - one.value) * (p - p0) / (p1 - p0)
            }
            (Some(one), None) => one.value,
            (None, Some(other)) => other.value,
            (None, None) => f64::NAN,
        }
    }

    /// The same of the samples themselves, linear from one to the next over the smaller of their two shares, half of it on
    /// either side: one of hardly any weight moves none, however far off it is.
    pub fn among(&self, p: f64) -> f64 {
        let Some(last) = self.samples.len().checked_sub(1) else { return f64::NAN };
        let i = self.samples.partition_point(|sample| sample.up_to() < p).min(last);
        let here = self.samples[i];
        // Across the border between two samples, from the one below.
        let across = |one: Share, other: Share| {
            let passed = (p - other.below) / one.share.min(other.share);
            (passed.abs() < 0.5).then_some(one.value + (other.value - one.value) * (0.5 + passed))
        };
        let from_below = i.checked_sub(1).and_then(|i| across(self.samples[i], here));
        let to_above = || self.samples.get(i + 1).and_then(|above| across(here, *above));
        from_below.or_else(to_above).unwrap_or(here.value)
    }
}

/// The shortest interval that holds so much of the weight: of a density with one peak, where it is highest.
///
/// * `weights` — shape (samples,), summing to one.
/// * `mass` — between 0 and 1.
///
/// What lies between two samples is counted half with each of them, so that of n samples of equal weight n·`mass` steps
/// from one to the next are taken; NaN if there are none.
///
/// # Source
/// Chen & Shao (1999), J. Comput. Graph. Stat. 8:69.
pub fn shortest_interval(values: &[f64], weights: &[f64], mass: f64) -> (f64, f64) {
    // Each stands in the middle of its share.
    let samples = Quantiles::new(values, weights).samples;
    let points: Vec<(f64, f64)> = samples.iter().map(|sample| (sample.value, sample.middle())).collect();
    let (mut shortest, mut last) = ((f64::NAN, f64::NAN), 0);
    for &(low, below) in &points {
        // Weights that sum to one up to rounding.
        while last < points.len() && points[last].1 - below < mass - 1e-12 {
            last += 1;
        }
        let Some(&(high, _)) = points.get(last) else { break };
        let is_shorter = shortest.0.is_nan() || high - low < shortest.1 - shortest.0;
        shortest = if is_shorter { (low, high) } else { shortest };
    }
    match (points.first(), points.last()) {
        // One sample, or two heavy ones at the ends.
        (Some(first), Some(last)) if shortest.0.is_nan() => (first.0, last.0),
        _ => shortest,
    }
}

/// Mean, shape (dimensions,), and covariance, shape (dimensions, dimensions), of points whose weights sum to
/// one; without dimensions if there are no points.
pub fn moments(points: &[DVector<f64>], weights: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
    let dimensions = points.first().map_or(0, DVector::len);
    let mut mean = DVector::zeros(dimensions);
    for (point, &weight) in points.iter().zip(weights) {
        mean.axpy(weight, point, 1.0);
    }
    let mut covariance = DMatrix::zeros(dimensions, dimensions);
    for (point, &weight) in points.iter().zip(weights) {
        let away = point - &mean;
        covariance.ger(weight, &away, &away, 1.0);
    }
    (mean, covariance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_a_cross_of_four_weighted_points() {
        let points =
            [[3.0, 1.0], [-1.0, 1.0], [1.0, 2.0], [1.0, -2.0]].map(|p| DVector::from_column_slice(&p));
        let (mean, covariance) = moments(&points, &[0.25, 0.25, 0.375, 0.125]);
        assert_eq!(mean.as_slice(), [1.0, 1.0]);
        assert_eq!(covariance.as_slice(), [2.0, 0.0, 0.0, 1.5]);
    }

    #[test]
    fn equal_weights_are_fully_effective() {
        assert!((ess_fraction(&[-1e4; 7]).unwrap() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn weights_of_zero_throughout_are_an_error() {
        assert!(normalised(&[f64::NEG_INFINITY; 3]).is_err());
        assert!(normalised(&[]).is_err());
        assert!(normalised(&[0.0, f64::NAN]).is_err());
    }

    /// The shortest 90 % of a law, from its quantiles at n midpoints.
    fn shortest(quantile: impl Fn(f64) -> f64, n: usize) -> (f64, f64) {
        let values: Vec<f64> = (0..n).map(|i| quantile((i as f64 + 0.5) / n as f64)).collect();
        shortest_interval(&values, &vec![1.0 / n as f64; n], 0.9)
    }

    #[test]
    fn the_shortest_interval_lies_where_the_density_is_highest() {
        let near = |(low, high): (f64, f64), expected: (f64, f64)| {
            assert!((low - expected.0).abs() < 2e-3 && (high - expected.1).abs() < 2e-3, "{low} {high}");
        };
        // Exponential: from 0 to ln 10. Falling to zero: 1 − √(1 − u), from 0 to 1 − √0.1.
        near(shortest(|u| -(1.0 - u).ln(), 20_000), (0.0, 10.0_f64.ln()));
        near(shortest(|u| 1.0 - (1.0 - u).sqrt(), 20_000), (0.0, 1.0 - 0.1_f64.sqrt()));
        // Weights in the place of numbers: the exponential's density on a grid.
        let values: Vec<f64> = (0..200_000).map(|i| 1e-4 * (f64::from(i) + 0.5)).collect();
        let density: Vec<f64> = values.iter().map(|x| (-x).exp()).collect();
        let sum: f64 = density.iter().sum();
        let weights: Vec<f64> = density.iter().map(|p| p / sum).collect();
        near(shortest_interval(&values, &weights, 0.9), (0.0, 10.0_f64.ln()));
    }

    #[test]
    fn the_shortest_interval_of_few_samples() {
        assert_eq!(shortest_interval(&[3.0], &[1.0], 0.9), (3.0, 3.0));
        assert_eq!(shortest_interval(&[5.0, 1.0], &[0.5, 0.5], 0.9), (1.0, 5.0));
        assert!(shortest_interval(&[], &[], 0.9).0.is_nan());
    }

    #[test]
    fn quantiles_of_equal_weights_are_hazens() {
        let quantiles = Quantiles::new(&[3.0, 1.0, 2.0, 4.0], &[0.25; 4]);
        for (p, expected) in [(0.05, 1.0), (0.125, 1.0), (0.25, 1.5), (0.5, 2.5), (0.875, 4.0), (0.95, 4.0)] {
            assert!((quantiles.at(p) - expected).abs() < 1e-12, "{p}");
        }
    }
}
