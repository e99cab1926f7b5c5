//! Sums of squares of normal numbers, each with a weight of its own.

/// Shares below this one of the largest add nothing.
const NOTHING: f64 = 1e-12;

/// Probability that Σ sharesᵢ zᵢ² exceeds a value, the zᵢ independent and standard normal.
///
/// * `shares` — weights, shape (squares,); those below zero, which rounding leaves, count as zero.
///
/// The sum's moment generating function M(s) = Π (1 − 2 sharesᵢ s)^−½ is integrated as M(s) exp(−s value) / s over a parabola through the
/// saddle point, which bends away from the cut: there the integrand falls like a normal density, and even steps give
/// it to ten digits or more. The path is that of Rice (1980), SIAM J. Sci. Stat. Comput. 1:438.
///
/// # Examples
/// ```
/// use gl_numeric::quadratic::exceedance;
///
/// // Two equal shares are an exponential distribution.
/// assert!((exceedance(3.0, &[0.5, 0.5]) - (-3.0_f64).exp()).abs() < 1e-12);
/// // Imhof (1961), Biometrika 48:419, table 1.
/// assert!((exceedance(2.0, &[0.6, 0.3, 0.1]) - 0.1240).abs() < 5e-5);
/// ```
pub fn exceedance(value: f64, shares: &[f64]) -> f64 {
    /// Steps, in widths of the saddle, and how many at most.
    const STEP: f64 = 0.2;
    const MOST: usize = 100_000;
    let largest = shares.iter().copied().fold(0.0, f64::max);
    if value <= 0.0 {
        return 1.0;
    }
    if largest == 0.0 {
        return 0.0;
    }
    // In units of the largest, whose cut begins at a half.
    let shares: Vec<f64> =
        shares.iter().filter(|share| **share > NOTHING * largest).map(|share| share / largest).collect();
    let value = value / largest;
    let sum = |of: &dyn Fn(f64) -> f64| shares.iter().map(|&share| of(share)).sum::<f64>();

    // Where ln of the integrand is lowest along the real axis: its slope rises from −∞ to ∞.
    let (mut low, mut high) = (0.0, 0.5);
    for _ in 0..100 {
        let c = 0.5 * (low + high);
        let slope = sum(&|share| share / (1.0 - 2.0 * share * c)) - value - 1.0 / c;
        if slope < 0.0 { low = c } else { high = c }
    }
    let saddle = 0.5 * (low + high);
    let second = sum(&|share| 2.0 * (share / (1.0 - 2.0 * share * saddle)).powi(2)) + saddle.powi(-2);
    let third = sum(&|share| 8.0 * (share / (1.0 - 2.0 * share * saddle)).powi(3)) - 2.0 * saddle.powi(-3);
    let bend = (third / (6.0 * second)).max(0.5);
    let step = STEP / second.sqrt();

    // ln M(s) − s value − ln s, modulus and angle.
    let integrand = |re: f64, im: f64| {
        let (mut ln, mut angle) = (-re * value - 0.5 * (re * re + im * im).ln(), -im * value - im.atan2(re));
        for share in &shares {
            let (x, y) = (1.0 - 2.0 * share * re, -2.0 * share * im);
            ln -= 0.25 * (x * x + y * y).ln();
            angle -= 0.5 * y.atan2(x);
        }
        (ln, angle)
    };
    let (highest, _) = integrand(saddle, 0.0);
    let mut total = 0.5;
    for n in 1..MOST {
        let t = n as f64 * step;
        let (ln, angle) = integrand(saddle + bend * t * t, t);
        let size = (ln - highest).exp();
        // times (1 − 2i bend t), by which the path moves.
        total += size * (angle.cos() + 2.0 * bend * t * angle.sin());
        if size * (1.0 + 2.0 * bend * t) < 1e-17 {
            break;
        }
    }
    (highest.exp() * total * step / std::f64::consts::PI).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use statrs::distribution::{ChiSquared, ContinuousCDF};

    use super::*;

    #[test]
    fn equal_shares_are_chi_squared() {
        for k in [1, 2, 3, 7, 40] {
            let of = ChiSquared::new(f64::from(k)).unwrap();
            for times in [0.001, 0.1, 0.5, 1.0, 2.0, 6.0, 15.0] {
                let value = times * f64::from(k);
                let found = exceedance(3.0 * value, &vec![3.0; k as usize]);
                let expected = of.sf(value);
                assert!((found / expected - 1.0).abs() < 1e-8, "{k} {times}: {found} {expected}");
            }
        }
    }

    /// Pairs of equal shares are exponential, and their sum is a mixture of exponentials.
    #[test]
    fn pairs_are_sums_of_exponentials() {
        let rates = [1.0, 4.0, 70.0, 9000.0];
        let shares: Vec<f64> = rates.iter().flat_map(|rate| [0.5 / rate; 2]).collect();
        for value in [1e-3, 0.05, 0.4, 1.0, 5.0, 30.0] {
            let term = |i: usize| {
                let weight: f64 =
                    (0..4).filter(|&j| j != i).map(|j| rates[j] / (rates[j] - rates[i])).product();
                weight * (-rates[i] * value).exp()
            };
            let expected: f64 = (0..4).map(term).sum();
            let found = exceedance(value, &shares);
            assert!((found / expected - 1.0).abs() < 1e-9, "{value}: {found} {expected}");
        }
    }

    #[test]
    fn three_shares_are_those_of_imhof() {
        for (value, expected) in [(0.1, 0.9458), (0.7, 0.5064), (2.0, 0.1240)] {
            assert!((exceedance(value, &[0.6, 0.3, 0.1]) - expected).abs() < 6e-5, "{value}");
        }
    }

    #[test]
    fn nothing_exceeds_where_nothing_varies() {
        assert_eq!(exceedance(1.0, &[]), 0.0);
        assert_eq!(exceedance(1.0, &[0.0, -1e-20]), 0.0);
        assert_eq!(exceedance(0.0, &[1.0]), 1.0);
    }
}
