//! Whether what a fit leaves of a measurement is noise: one test for all who ask.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Below this probability a fit is bad.
pub const BAD: f64 = 0.01;

/// Neighbours this far on the same side of each other are correlated, and on the other one alternate.
pub const CORRELATED: f64 = 0.25;

/// What alternates, in words, for who says of what.
pub const ALTERNATES: &str = "changes its sign with every reading or two more than noise does";

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
    /// Correlation of neighbours in what is left: near 1 it is smooth.
    pub correlation: f64,
    /// Where what is left alternates, the correlation of neighbours, or of every second reading, whichever says it more
    /// clearly: near −1 it does nothing else. Neither an emulator's error, nor scatter, nor a noise that is correlated does.
    pub alternation: Option<f64>,
}

impl Fit {
    /// Whether the fit is bad.
    pub fn is_bad(&self) -> bool {
        self.probability < BAD
    }
}

/// Test what a fit leaves of each observable, in standard deviations, shape (observables, steps), of which the
/// fit has taken so many degrees of freedom.
///
/// Three tests, of which the smallest probability counts, raised for having been chosen (Šidák): the sum of squares
/// against χ² with the degrees of freedom that are left, which sees a misfit of any shape that is large enough; and
/// the correlations of neighbours and of every second reading, over n pairs against normal(0, 1/n), from both sides, which
/// see one that is smooth, or turns within five readings, much earlier. What a fit takes makes readings differ by up to
/// its degrees of freedom over n: that is allowed for.
///
/// # Source
/// Ljung & Box (1978), Biometrika 65:297, lag by lag.
pub fn test(left: &[Vec<f64>], taken: usize) -> Fit {
    let readings: usize = left.iter().map(Vec::len).sum();
    let square: f64 = left.iter().flatten().map(|z| z * z).sum();
    let freedom = readings.saturating_sub(taken).max(1) as f64;
    let allowed = taken as f64 / readings.max(1) as f64;
    let correlated = |lag: usize| {
        let pairs: usize = left.iter().map(|z| z.len().saturating_sub(lag)).sum();
        let products = left.iter().flat_map(|z| z.iter().zip(z.iter().skip(lag))).map(|(a, b)| a * b);
        let correlation = if square > 0.0 { products.sum::<f64>() / square } else { 0.0 };
        let beyond = if correlation < 0.0 { (correlation + allowed).min(0.0) } else { correlation };
        (correlation, two_sided(beyond * (pairs as f64).sqrt()))
    };
    let (neighbours, seconds) = (correlated(1), correlated(2));
    let (least, least_p) = if seconds.1 < neighbours.1 && seconds.0 < 0.0 { seconds } else { neighbours };
    let alternates = least < -CORRELATED && neighbours.0 < CORRELATED && smallest_of(2, least_p) < BAD;
    let p = of_misfit(square, freedom).min(neighbours.1).min(seconds.1);
    Fit {
        probability: smallest_of(3, p),
        scatter: (square / freedom).sqrt(),
        correlation: neighbours.0,
        alternation: alternates.then_some(least),
    }
}

/// The probability of a standard normal at least as far from zero.
fn two_sided(z: f64) -> f64 {
    Normal::new(0.0, 1.0).map_or(1.0, |normal| 2.0 * normal.sf(z.abs())).min(1.0)
}

/// The probability of so many tests together whose smallest one this is (Šidák 1967).
pub fn smallest_of(tests: usize, p: f64) -> f64 {
    // To the last digit where it is small.
    -(tests as f64 * (-p).ln_1p()).exp_m1()
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
    use gl_numeric::normal::normal_quantile;
    use rand::distr::Open01;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn no_probability_is_said_to_be_zero() {
        assert_eq!((said(0.0).as_str(), said(0.00123).as_str()), ("less than 1e-300", "1.2e-3"));
    }

    /// Standard normal noise, the same on every machine.
    fn noise(seed: u64, n: usize) -> Vec<f64> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| normal_quantile(generator.sample(Open01))).collect()
    }

    #[test]
    fn noise_is_a_good_fit_in_ninety_nine_of_a_hundred() {
        let of = |seed: u64| test(&[noise(seed, 60), noise(seed + 2000, 60)], 0);
        let below = |p: f64| (0..1000).filter(|&seed| of(seed).probability < p).count();
        // As often as its probability says: three tests of the same readings together are alike, so rather less.
        assert!((60..=115).contains(&below(0.1)), "{}", below(0.1));
        assert!((3..=16).contains(&below(0.01)), "{}", below(0.01));
    }

    #[test]
    fn what_alternates_is_a_bad_fit_though_its_size_is_that_of_noise() {
        let alternating = |t: usize| if t.is_multiple_of(2) { 1.0 } else { -1.0 };
        let left = vec![(0..40).map(alternating).collect::<Vec<_>>()];
        let fit = test(&left, 3);
        assert!(
            fit.is_bad() && fit.alternation.is_some_and(|of| of < -0.9) && (fit.scatter - 1.0).abs() < 0.1,
            "{fit:?}"
        );
        let smooth = vec![(0..40).map(|t| (0.3 * f64::from(t)).sin()).collect::<Vec<_>>()];
        assert!(test(&smooth, 3).is_bad() && test(&smooth, 3).alternation.is_none());
        let few = vec![(0..7).map(alternating).collect::<Vec<_>>()];
        assert!(test(&few, 3).alternation.is_none());
    }

    #[test]
    fn a_wave_of_any_few_readings_alternates_though_neighbours_do_not_differ() {
        for turn in [2.2, 3.0, 4.0, 4.5] {
            let wave = |t: usize| (std::f64::consts::TAU * t as f64 / turn).sin();
            let left: Vec<f64> = (0..90).zip(noise(5, 90)).map(|(t, e)| 1.2 * wave(t) + 0.3 * e).collect();
            let fit = test(&[left], 3);
            assert!(fit.is_bad() && fit.alternation.is_some_and(|of| of < -0.4), "{turn}: {fit:?}");
        }
        let slow = (0..90).map(|t| (std::f64::consts::TAU * f64::from(t) / 8.0).sin()).collect();
        let fit = test(&[slow], 3);
        assert!(fit.is_bad() && fit.alternation.is_none() && fit.correlation > 0.5, "{fit:?}");
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
