//! The standard normal distribution, whole and between bounds, accurate far out in its tails.

use libm::erfc;
use statrs::function::erf::erfc_inv;

/// ln √(2π).
const LN_ROOT_TAU: f64 = 0.918_938_533_204_672_7;

/// Standard normal distribution function.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * erfc(-x / std::f64::consts::SQRT_2)
}

/// Inverse of the standard normal distribution function; −∞ at 0, +∞ at 1.
///
/// # Examples
/// ```
/// use gl_numeric::normal::{normal_cdf, normal_quantile};
///
/// assert!((normal_quantile(0.95) - 1.6448536269514722).abs() < 1e-12);
/// assert!((normal_cdf(normal_quantile(1e-9)) / 1e-9 - 1.0).abs() < 1e-9);
/// ```
pub fn normal_quantile(p: f64) -> f64 {
    if p > 0.5 { -quantile_of_ln((1.0 - p).ln()) } else { quantile_of_ln(p.ln()) }
}

/// Below this the tail is taken from its continued fraction.
const TAIL: f64 = -5.0;

/// ln Φ(x).
fn ln_cdf(x: f64) -> f64 {
    if x > 0.0 {
        (-normal_cdf(-x)).ln_1p()
    } else if x > TAIL {
        normal_cdf(x).ln()
    } else {
        -0.5 * x * x - LN_ROOT_TAU + mills(-x).ln()
    }
}

/// Φ(−x)/φ(x) for x ≥ 5, by Laplace's continued fraction (Abramowitz & Stegun 26.2.14).
fn mills(x: f64) -> f64 {
    1.0 / (1..=30).rev().fold(x, |rest, k| x + f64::from(k) / rest)
}

/// The x at which ln Φ(x) = `ln_p`, at most ln ½: Newton's method, which cannot miss on a concave
/// function, from statrs' ten digits.
fn quantile_of_ln(ln_p: f64) -> f64 {
    if ln_p == f64::NEG_INFINITY {
        return ln_p;
    }
    let mut x = if ln_p > -600.0 {
        -std::f64::consts::SQRT_2 * erfc_inv(2.0 * ln_p.exp())
    } else {
        -(-2.0 * ln_p).sqrt()
    };
    for _ in 0..20 {
        let value = ln_cdf(x);
        let slope = if x > TAIL { (-0.5 * x * x - LN_ROOT_TAU - value).exp() } else { 1.0 / mills(-x) };
        let step = (value - ln_p) / slope;
        x -= step;
        if step.abs() <= 1e-15 * (1.0 + x.abs()) {
            break;
        }
    }
    x
}

/// The standard normal distribution between two bounds.
///
/// # Examples
/// ```
/// use gl_numeric::normal::Truncated;
///
/// // Above the mean lies half of the probability, and half of that above 0.6745; far out it goes on as an exponential.
/// let above = Truncated::new(0.0, f64::INFINITY);
/// assert!((above.ln_mass() - 0.5_f64.ln()).abs() < 1e-12);
/// assert!((above.quantile(0.5) - 0.6744897501960817).abs() < 1e-9);
/// assert!((Truncated::new(30.0, 31.0).quantile(0.5) - 30.0 - 2_f64.ln() / 30.0).abs() < 1e-4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truncated {
    low: f64,
    high: f64,
    /// Whether the bounds are those of −x, so that the upper one is the nearer to the middle.
    is_mirrored: bool,
}

impl Truncated {
    /// Between `low` and `high`, in standard deviations from the mean.
    pub fn new(low: f64, high: f64) -> Self {
        let is_mirrored = low + high > 0.0;
        let (low, high) = if is_mirrored { (-high, -low) } else { (low, high) };
        Self { low, high, is_mirrored }
    }

    /// ln of the probability between the bounds.
    pub fn ln_mass(&self) -> f64 {
        if self.is_narrow() {
            return self.relative_mass(self.high - self.low).ln() - 0.5 * self.low * self.low - LN_ROOT_TAU;
        }
        let (ln_low, ln_high) = (ln_cdf(self.low), ln_cdf(self.high));
        ln_high + (-(ln_low - ln_high).exp()).ln_1p()
    }

    /// The value below which the share `u` in [0, 1] of the probability between the bounds lies.
    pub fn quantile(&self, u: f64) -> f64 {
        let x = if self.is_mirrored { -self.of_share(u, true) } else { self.of_share(u, false) };
        if self.is_mirrored { x.clamp(-self.high, -self.low) } else { x.clamp(self.low, self.high) }
    }

    /// The value with the share `u` below it, or above it.
    fn of_share(&self, u: f64, above: bool) -> f64 {
        let (below, above) = if above { (1.0 - u, u) } else { (u, 1.0 - u) };
        if self.is_narrow() {
            return self.of_share_if_narrow(below);
        }
        // From the side on which less lies, where it can be told from nothing.
        let ln_below = ln_mixture(above, ln_cdf(self.low), below, ln_cdf(self.high));
        let ln_above = ln_mixture(above, ln_cdf(-self.low), below, ln_cdf(-self.high));
        if ln_below <= ln_above { quantile_of_ln(ln_below) } else { -quantile_of_ln(ln_above) }
    }

    /// Whether the density changes by less than a factor of e, so that the difference of two
    /// probabilities would lose digits.
    fn is_narrow(&self) -> bool {
        let width = self.high - self.low;
        width * self.low.abs() + 0.5 * width * width < 1.0
    }

    fn of_share_if_narrow(&self, u: f64) -> f64 {
        let width = self.high - self.low;
        let wanted = u * self.relative_mass(width);
        let mut x = u * width;
        for _ in 0..8 {
            x -= (self.relative_mass(x) - wanted) * (self.low * x + 0.5 * x * x).exp();
        }
        self.low + x
    }

    /// Probability between the lower bound and `x` above it, over the density at the lower bound, by
    /// Gauss's quadrature.
    fn relative_mass(&self, x: f64) -> f64 {
        const NODES: [(f64, f64); 4] = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
            (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
        ];
        let density = |t: f64| (-self.low * t - 0.5 * t * t).exp();
        let pair = |node: f64| density(0.5 * x * (1.0 - node)) + density(0.5 * x * (1.0 + node));
        0.5 * x * NODES.iter().map(|&(node, weight)| weight * pair(node)).sum::<f64>()
    }
}

/// ln(a exp(x) + b exp(y)).
fn ln_mixture(a: f64, x: f64, b: f64, y: f64) -> f64 {
    crate::statistics::ln_sum_exp(&[a.ln() + x, b.ln() + y])
}
