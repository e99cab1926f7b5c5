//! Runs of the same parameters differ, by the packing or a seed. What the runs leave over about the processes of
//! the mean, each left out in turn, has a covariance S; that of few runs is drawn towards a white one W of the same
//! size in each observable, and is too small in the directions that it has by chance: c (α S + (1 − α) W), with the
//! α and c by which the residual of each run, measured with the noise, is most probable given those of the others.
//! White scatter, of which no number of components holds more than a part, then comes out white and counted once,
//! smooth scatter as the few patterns that it is. What the parameters are told too narrowly by a covariance that is
//! estimated, is added ([`super::widening`]).
//!
//! Hoffbeck & Landgrebe (1996), IEEE Trans. Pattern Anal. Mach. Intell. 18:763.

use nalgebra::{DMatrix, DVector};

use super::likelihood::Measured;
use super::widening::Estimated;
use crate::Emulator;

/// Covariance of the scatter, in variances of the base of a measurement's noise.
#[derive(Clone, Debug)]
pub struct Scatter {
    /// Of the scores, shape (components, components).
    pub scores: DMatrix<f64>,
    /// The white share of each observable, shape (observables,).
    pub white: Vec<f64>,
    /// What the components leave over of each observable and no scatter explains, shape (observables,).
    pub truncated: Vec<f64>,
}

/// Shares of the residuals' own covariance that are tried.
const SHARES: [f64; 16] =
    [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 0.9999];

/// Factors on both that are tried.
const FACTORS: [f64; 9] = [1.0, 1.1, 1.2, 1.3, 1.45, 1.6, 1.8, 2.1, 2.5];

/// Residuals that these are found by, at most.
const MOST_RESIDUALS: usize = 80;

/// A variance that makes no difference, in that of the noise, all readings together.
const NOTHING: f64 = 0.02;

impl Scatter {
    /// The scatter that an emulator's runs show.
    ///
    /// * `slopes` — derivatives of the scores by the coordinates near the posterior, shape (components, parameters).
    pub fn new(emulator: &Emulator, measured: &Measured, slopes: &DMatrix<f64>) -> Self {
        let (outputs, k) = emulator.basis().shape();
        let n = emulator.runs().len();
        let base = &measured.base;
        let (mut left, mut own) = (DMatrix::zeros(n, k), DMatrix::zeros(n, k));
        for (c, process) in emulator.processes().iter().enumerate() {
            let (left_out, nugget) = (process.leave_one_out(), process.nugget());
            for i in 0..n {
                left[(i, c)] = emulator.scores()[(i, c)] - left_out.mean[i];
                // With e/(1 − h) of the run left out and e of the fit, e²/(1 − h) is the nugget in the mean.
                let variance = left_out.variance[i].max(f64::MIN_POSITIVE);
                own[(i, c)] = left[(i, c)] * (nugget / variance).min(1.0).sqrt();
            }
        }
        let pattern = measured.patterns(emulator);
        // Where the last components are nothing but scatter, so is what they leave over.
        let last = emulator.nugget().into_iter().skip(k - k.div_ceil(4));
        let last_share = (last.sum::<f64>() / k.div_ceil(4).max(1) as f64).clamp(0.0, 1.0);
        let curves = emulator.curves_of_runs();
        let fitted = emulator.scores() * pattern.transpose();
        let rest = DMatrix::from_fn(n, outputs, |i, o| {
            (curves[(i, o)] - emulator.centre()[o]) / base[o] - fitted[(i, o)]
        });
        let residuals = &left * pattern.transpose() + &rest * last_share.sqrt();

        let of_observables = |square: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let observables = 0..measured.observables();
            let of = |j| measured.own(j).map(square).sum::<f64>();
            observables.map(|j| of(j) / measured.own(j).len() as f64).collect()
        };
        let sizes = of_observables(&|o| residuals.column(o).norm_squared() / n as f64);
        let truncated = of_observables(&|o| (1.0 - last_share) * emulator.leftover()[o] / base[o].powi(2));
        let of_residuals = Residuals::new(&residuals, &sizes, measured);
        let (share, factor) = of_residuals.best();
        let mut scores = own.tr_mul(&own) * (factor * share / n as f64);
        if of_residuals.is_scatter() {
            let white = of_residuals.white(share, factor);
            let estimated = Estimated {
                residuals: &(&own * pattern.transpose() + &rest * last_share.sqrt()),
                share: factor * share,
                white: &(0..outputs).map(|o| white[measured.observable_of(o)]).collect::<Vec<_>>(),
                noise: of_residuals.noise,
            };
            if let Some(excess) = estimated.excess(&(&pattern * slopes)) {
                scores += slopes * excess * slopes.transpose();
            }
        }
        Self { scores, white: sizes.iter().map(|size| factor * (1.0 - share) * size).collect(), truncated }
    }

    /// The same, of so many times the variance.
    pub fn times(&self, variance: f64) -> Self {
        let white = self.white.iter().map(|white| white * variance).collect();
        Self { scores: &self.scores * variance, white, truncated: self.truncated.clone() }
    }

    /// Covariance of the scores of a run by all of its scatter, shape (components, components): the white share
    /// shows in them, too.
    pub fn of_scores(&self, emulator: &Emulator, measured: &Measured) -> DMatrix<f64> {
        let (outputs, k) = emulator.basis().shape();
        let pattern = measured.patterns(emulator);
        let weight: DVector<f64> =
            DVector::from_fn(k, |c, _| pattern.column(c).norm_squared().max(f64::MIN_POSITIVE));
        // Scores are patternᵀ y / |pattern|², whose patterns are orthogonal.
        let projector = DMatrix::from_fn(outputs, k, |o, c| pattern[(o, c)] / weight[c]);
        let white =
            DMatrix::from_fn(outputs, k, |o, c| self.white[measured.observable_of(o)] * projector[(o, c)]);
        &self.scores + projector.tr_mul(&white)
    }
}

/// Some of the residuals, and how probable each is given the others.
struct Residuals {
    /// Products of the residuals with each other in each observable, shape (runs, runs).
    products: Vec<DMatrix<f64>>,
    /// Their mean squares.
    sizes: Vec<f64>,
    /// Readings of each observable.
    steps: Vec<f64>,
    /// Variance of the noise that they are measured with.
    noise: f64,
}

impl Residuals {
    /// * `residuals` — in standard deviations of the noise, shape (runs, outputs).
    /// * `sizes` — their mean square in each observable, shape (observables,).
    fn new(residuals: &DMatrix<f64>, sizes: &[f64], measured: &Measured) -> Self {
        let n = residuals.nrows();
        let count = n.min(MOST_RESIDUALS);
        let some: Vec<usize> = (0..count).map(|i| i * n / count).collect();
        let residuals = residuals.select_rows(&some);
        let product = |j: usize| {
            let own = measured.own(j);
            let block = residuals.columns(own.start, own.len());
            block * block.transpose()
        };
        Self {
            products: (0..sizes.len()).map(product).collect(),
            sizes: sizes.to_vec(),
            steps: (0..sizes.len()).map(|j| measured.own(j).len() as f64).collect(),
            noise: if measured.is_known { 1.0 } else { 0.0 },
        }
    }

    /// Whether there are enough of them, and large enough, to make a difference.
    fn is_scatter(&self) -> bool {
        let whole = self.steps.iter().zip(&self.sizes).map(|(steps, size)| steps * size).sum::<f64>();
        self.products[0].nrows() >= 3 && whole > NOTHING * self.noise && whole > 0.0
    }

    /// The share of the residuals' own covariance, and the factor on it and on the white rest.
    fn best(&self) -> (f64, f64) {
        if !self.is_scatter() {
            return (1.0, 1.0);
        }
        let highest = |tried: &mut dyn Iterator<Item = (f64, f64)>| {
            let mut best = (f64::NEG_INFINITY, (1.0, 1.0));
            for (share, factor) in tried {
                let ln_density = self.ln_density(share, factor).unwrap_or(f64::NEG_INFINITY);
                if ln_density > best.0 {
                    best = (ln_density, (share, factor));
                }
            }
            best.1
        };
        let (share, _) = highest(&mut SHARES.iter().map(|share| (*share, 1.0)));
        if self.noise == 0.0 {
            return (share, 1.0);
        }
        let (_, factor) = highest(&mut FACTORS.iter().map(|factor| (share, *factor)));
        let (share, _) = highest(&mut SHARES.iter().map(|share| (*share, factor)));
        highest(&mut FACTORS.iter().map(|factor| (share, *factor)))
    }

    /// The noise with the white part of the scatter, shape (observables,).
    fn white(&self, share: f64, factor: f64) -> Vec<f64> {
        let largest = self.sizes.iter().copied().fold(0.0, f64::max);
        let of = |size: &f64| self.noise + factor * (1.0 - share) * size.max(1e-12 * largest);
        self.sizes.iter().map(of).collect()
    }

    /// Sum over the residuals of ln of the density of each, in the mean over the noise that it is measured with, under
    /// the covariance of the others.
    ///
    /// With G = D + β RᵀR of all, β = c α/(n − 1) and D the noise with the white share, that of the others is
    /// G − β xxᵀ. In the space of the runs, with K = R D⁻¹ Rᵀ and A = I + β K: β xᵀG⁻¹x = 1 − (A⁻¹)ᵢᵢ, |G| = |D| |A|.
    fn ln_density(&self, share: f64, factor: f64) -> Option<f64> {
        let n = self.products[0].nrows();
        let beta = factor * share / (n - 1) as f64;
        let (mut k, mut k_two) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        let (mut ln_d, mut trace) = (0.0, 0.0);
        for ((product, d), steps) in self.products.iter().zip(self.white(share, factor)).zip(&self.steps) {
            k += product / d;
            k_two += product / (d * d);
            ln_d += steps * d.ln();
            trace += steps / d;
        }
        let a = (DMatrix::identity(n, n) + &k * beta).cholesky()?;
        let ln_a = 2.0 * a.l_dirty().diagonal().map(f64::ln).sum();
        let inverse = a.inverse();
        let twice = &inverse * &k_two;
        trace -= beta * twice.trace();
        let of = |i: usize| {
            let q = inverse[(i, i)].clamp(1e-12, 1.0);
            let square = if beta > 0.0 { (1.0 - q) / (beta * q) } else { k[(i, i)] };
            let measured = trace + beta * (twice.row(i) * inverse.column(i))[(0, 0)] / q;
            -0.5 * (ln_d + ln_a + q.ln() + square + self.noise * measured)
        };
        Some((0..n).map(of).sum())
    }
}

#[cfg(test)]
mod tests {
    use gl_inference::prior::normal_quantile;
    use rand::distr::Open01;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn normal(generator: &mut ChaCha8Rng) -> f64 {
        normal_quantile(generator.sample(Open01))
    }

    fn residuals(rows: &DMatrix<f64>, noise: f64) -> Residuals {
        let size = rows.norm_squared() / rows.len() as f64;
        let steps = rows.ncols() as f64;
        Residuals { products: vec![rows * rows.transpose()], sizes: vec![size], steps: vec![steps], noise }
    }

    fn smooth(n: usize, outputs: usize) -> DMatrix<f64> {
        let mut generator = ChaCha8Rng::seed_from_u64(6);
        let sizes = DMatrix::from_fn(n, 2, |_, _| normal(&mut generator));
        let pattern = DMatrix::from_fn(2, outputs, |k, o| ((k + 1) as f64 * 0.1 * o as f64).sin());
        sizes * pattern
    }

    #[test]
    fn white_residuals_are_white_and_residuals_of_few_patterns_are_not() {
        let mut generator = ChaCha8Rng::seed_from_u64(5);
        let white = DMatrix::from_fn(40, 60, |_, _| normal(&mut generator));
        for noise in [0.0, 1.0] {
            assert!(residuals(&white, noise).best().0 <= 0.05);
            let patterns = smooth(40, 60) + 0.01 * &white;
            assert!(residuals(&patterns, noise).best().0 >= 0.98);
        }
    }

    /// The formula in the space of the runs, against the covariance without each run.
    #[test]
    fn the_density_of_a_residual_is_that_under_the_others() {
        let rows = smooth(5, 4);
        let (share, factor) = (0.6, 1.3);
        let here = residuals(&rows, 1.0);
        let mut sum = 0.0;
        for i in 0..5 {
            let mut covariance = DMatrix::identity(4, 4) * (1.0 + factor * (1.0 - share) * here.sizes[0]);
            for (j, x) in rows.row_iter().enumerate().filter(|(j, _)| *j != i) {
                assert_ne!(i, j);
                covariance += x.transpose() * x * (factor * share / 4.0);
            }
            let x = rows.row(i).transpose();
            let inverse = covariance.clone().try_inverse().unwrap();
            sum -= 0.5 * (covariance.determinant().ln() + x.dot(&(&inverse * &x)) + inverse.trace());
        }
        let density = here.ln_density(share, factor).unwrap();
        assert!((density - sum).abs() < 1e-9, "{density} {sum}");
    }
}
