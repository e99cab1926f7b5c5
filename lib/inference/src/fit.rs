//! Whether what a fit leaves of a measurement is noise: one test for all who ask.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Below this probability a fit is bad.
pub const BAD: f64 = 0.01;

/// Neighbours this far on the same side of each other are correlated, and on the other one alternate.
pub const CORRELATED: f64 = 0.25;

/// What alternates, in words, for who says of what.
pub const ALTERNATES: &str = "changes its sign from reading to reading more than noise does";

/// What to do about it.
pub const ON_ALTERNATING: &str =
    "look at how the readings were taken, or at an oscillation that the model lacks";

/// What a test of a fit says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Probability of a misfit at least as odd as this one, were the rest noise.
    pub probability: f64,
    /// Root mean square of what is left, in standard deviations, for the degrees of freedom that are.
    pub scatter: f64,
    /// Correlation of neighbours in what is left: near −1 it alternates, near 1 it is smooth.
    pub correlation: f64,
    /// Probability of a correlation at least as far from that of noise.
    pub correlation_p: f64,
}

impl Fit {
    /// Whether the fit is bad.
    pub fn is_bad(&self) -> bool {
        self.probability < BAD
    }

    /// Whether what is left alternates: neither an emulator's error, nor scatter, nor a noise that is correlated does.
    pub fn alternates(&self) -> bool {
        self.correlation < -CORRELATED && one_of_two(self.correlation_p) < BAD
    }
}

/// Test what a fit leaves of each observable, in standard deviations, shape (observables, steps), of which the
/// fit has taken so many degrees of freedom.
///
/// Two tests, of which the smaller probability counts, raised for having been chosen (Šidák): the sum of squares
/// against χ² with the degrees of freedom that are left, which sees a misfit of any shape that is large enough; and
/// the correlation r of neighbours over n pairs against normal(0, 1/n), from both sides, which sees one that is
/// smooth, or alternates, much earlier. What a fit takes makes neighbours differ by up to its degrees of freedom
/// over n: that is allowed for.
///
/// # Source
/// Ljung & Box (1978), Biometrika 65:297, for one lag.
pub fn test(left: &[Vec<f64>], taken: usize) -> Fit {
    let readings: usize = left.iter().map(Vec::len).sum();
    let square: f64 = left.iter().flatten().map(|z| z * z).sum();
    let freedom = readings.saturating_sub(taken).max(1) as f64;
    let of_square = of_misfit(square, freedom);
    let pairs: usize = left.iter().map(|z| z.len().saturating_sub(1)).sum();
    let products: f64 = left.iter().flat_map(|z| z.windows(2).map(|pair| pair[0] * pair[1])).sum();
    let correlation = if square > 0.0 && pairs > 0 { products / square } else { 0.0 };
    let allowed = taken as f64 / readings.max(1) as f64;
    let beyond = if correlation < 0.0 { (correlation + allowed).min(0.0) } else { correlation };
    let correlation_p = Normal::new(0.0, 1.0)
        .map_or(1.0, |normal| 2.0 * normal.sf(beyond.abs() * (pairs as f64).sqrt()))
        .min(1.0);
    let probability = one_of_two(of_square.min(correlation_p));
    Fit { probability, scatter: (square / freedom).sqrt(), correlation, correlation_p }
}

/// The probability of two tests together whose smaller one this is.
fn one_of_two(p: f64) -> f64 {
    p * (2.0 - p)
}

/// That what is left alternates with this correlation of neighbours, and what to do about it, for who says of what.
pub fn alternation(correlation: f64) -> String {
    format!("{ALTERNATES} (correlation {correlation:.2}): {ON_ALTERNATING}")
}

/// Probability of a misfit at least as large as this sum of squares of so many independent readings.
pub fn of_misfit(square: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(f64::NAN, |chi| chi.sf(square.max(0.0)))
}

/// A probability as it is said in a sentence: one that is zero by rounding is not.
pub fn said(p: f64) -> String {
    if p < 1e-300 { "less than 1e-300".to_owned() } else { format!("{p:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_probability_is_said_to_be_zero() {
        assert_eq!((said(0.0).as_str(), said(0.00123).as_str()), ("less than 1e-300", "1.2e-3"));
    }

    /// Noise of variance 1, the same on every machine.
    fn noise(seed: usize, n: usize) -> Vec<f64> {
        let uniform = |i: usize| (((i + 1) * (2 * seed + 1)) as f64 * 0.618_033_988_749_895).fract();
        (0..n).map(|t| 12f64.sqrt() * (uniform(t * t + 7 * t + seed) - 0.5)).collect()
    }

    #[test]
    fn noise_is_a_good_fit_in_ninety_nine_of_a_hundred() {
        let bad =
            (0..200).filter(|&seed| test(&[noise(seed, 60), noise(seed + 300, 60)], 3).is_bad()).count();
        assert!(bad <= 5, "{bad}");
    }

    #[test]
    fn what_alternates_is_a_bad_fit_though_its_size_is_that_of_noise() {
        let alternating = |t: usize| if t.is_multiple_of(2) { 1.0 } else { -1.0 };
        let left = vec![(0..40).map(alternating).collect::<Vec<_>>()];
        let fit = test(&left, 3);
        assert!(
            fit.is_bad() && fit.alternates() && fit.correlation < -0.9 && (fit.scatter - 1.0).abs() < 0.1,
            "{fit:?}"
        );
        let smooth = vec![(0..40).map(|t| (0.3 * f64::from(t)).sin()).collect::<Vec<_>>()];
        assert!(test(&smooth, 3).is_bad() && !test(&smooth, 3).alternates());
        let few = vec![(0..7).map(alternating).collect::<Vec<_>>()];
        assert!(!test(&few, 3).alternates());
    }

    #[test]
    fn a_misfit_is_judged_by_its_degrees_of_freedom() {
        // scipy.stats.chi2.sf(30, 20) = 0.06985366069
        assert!((of_misfit(30.0, 20.0) - 0.069_853_660_69).abs() < 1e-9);
        assert!(of_misfit(120.0, 80.0) < BAD && of_misfit(100.0, 80.0) > BAD);
        // scipy.stats.chi2.sf(488, 76) = 1.9855550686e-61
        assert!((of_misfit(488.0, 76.0) / 1.985_555_068_6e-61 - 1.0).abs() < 1e-9);
    }
}
