//! Correlations with a length an input: Matérn-5/2, or Gaussian for what is smoother.

use pulp::{Arch, Simd, with_simd};

/// How a process correlates with itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// k = (1 + √5 r + 5/3 r²) exp(−√5 r): two derivatives.
    #[default]
    Matern,
    /// k = exp(−r²/2): all derivatives.
    Gaussian,
}

/// Points in input-major order, each input divided by its length: shape (inputs, points).
#[derive(Clone, Debug, Default)]
pub struct ScaledPoints {
    kernel: Kernel,
    inputs: Vec<Vec<f64>>,
}

impl ScaledPoints {
    /// Divide each input, shape (inputs, points), by its length, shape (inputs,).
    pub fn new(kernel: Kernel, inputs: &[Vec<f64>], lengths: &[f64]) -> Self {
        let scaled = |(input, length): (&Vec<f64>, &f64)| input.iter().map(|x| x / length).collect();
        Self { kernel, inputs: inputs.iter().zip(lengths).map(scaled).collect() }
    }

    /// Correlation of two points that are scaled alike, each of shape (inputs,).
    pub fn correlation(&self, a: &[f64], b: &[f64]) -> f64 {
        let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
        match self.kernel {
            Kernel::Matern => {
                let r = (5.0 * square).sqrt();
                (1.0 + r + r * r / 3.0) * exp_below_zero(-r)
            }
            Kernel::Gaussian => exp_below_zero(-0.5 * square),
        }
    }

    /// A point, shape (inputs,).
    pub fn point(&self, i: usize) -> Vec<f64> {
        self.inputs.iter().map(|input| input[i]).collect()
    }

    /// Number of inputs.
    pub fn dimension(&self) -> usize {
        self.inputs.len()
    }

    /// The points of one input, shape (points,).
    pub fn input(&self, q: usize) -> &[f64] {
        &self.inputs[q]
    }

    /// Correlations of the first points with a point that is scaled alike, and where `slope` is
    /// given, −2 times their derivatives by the squared distance r².
    ///
    /// These are 5/3 (1 + √5 r) exp(−√5 r) for Matérn-5/2 and exp(−r²/2) for the Gaussian.
    pub fn correlate(&self, at: &[f64], k: &mut [f64], slope: Option<&mut [f64]>) {
        correlate(self, at, k, slope);
    }
}

#[with_simd(correlate = Arch::new())]
#[inline(always)]
fn correlate_wide<'a, S: Simd>(
    _width: S,
    points: &'a ScaledPoints,
    at: &'a [f64],
    k: &'a mut [f64],
    slope: Option<&'a mut [f64]>,
) {
    k.fill(0.0);
    for (input, &at) in points.inputs.iter().zip(at) {
        for (sum, x) in k.iter_mut().zip(input) {
            let difference = x - at;
            *sum += difference * difference;
        }
    }
    match (points.kernel, slope) {
        (Kernel::Gaussian, slope) => {
            k.iter_mut().for_each(|k| *k = exp_below_zero(-0.5 * *k));
            if let Some(slope) = slope {
                slope.copy_from_slice(&k[..slope.len()]);
            }
        }
        (Kernel::Matern, None) => {
            for k in k {
                let r = (5.0 * *k).sqrt();
                *k = (1.0 + r + r * r / 3.0) * exp_below_zero(-r);
            }
        }
        (Kernel::Matern, Some(slope)) => {
            for (k, slope) in k.iter_mut().zip(slope) {
                let r = (5.0 * *k).sqrt();
                let decay = exp_below_zero(-r);
                *k = (1.0 + r + r * r / 3.0) * decay;
                *slope = 5.0 / 3.0 * (1.0 + r) * decay;
            }
        }
    }
}

/// eˣ for x ≤ 0, to 2e-16 relative down to e⁻⁷⁰⁸, where it stays.
///
/// Without branches or calls, so that a loop over it is vectorised, and the same on every machine,
/// which the exp of a mathematical library need not be.
#[inline(always)]
fn exp_below_zero(x: f64) -> f64 {
    // 1.5 · 2⁵²: adding it leaves the nearest integer in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    // ln 2 in two parts, the first with enough zeros at its end for exact multiples.
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let x = if x > -708.0 { x } else { -708.0 };
    let rounded = x * std::f64::consts::LOG2_E + ROUND;
    let power = rounded - ROUND;
    let r = (x - power * LN_2_HIGH) - power * LN_2_LOW;
    let mut sum = 1.0 / 6_227_020_800.0;
    for coefficient in [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        sum = sum * r + coefficient;
    }
    f64::from_bits(sum.to_bits().wrapping_add(rounded.to_bits() << 52))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_the_standard_library() {
        for i in 0..100_000 {
            let x = -0.007_08 * f64::from(i);
            let (here, there) = (exp_below_zero(x), x.exp());
            assert!((here - there).abs() <= 4e-16 * there, "{x}: {here} {there}");
        }
        assert!(exp_below_zero(-1e300) > 0.0 && exp_below_zero(-1e300) < 1e-300);
    }
}
