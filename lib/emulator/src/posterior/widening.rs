//! A covariance that is estimated from few runs says too much of the parameters.
//!
//! The parameters that fit best are told by the combination of readings that varies least from run to run. Where the covariance of the
//! scatter is estimated, that is the combination which varies least *by chance*, too: with as many readings as runs the
//! parameters come out a factor too narrow, although the covariance is right as a whole (Percival et al. 2014, Mon. Not. R.
//! Astron. Soc. 439:2531; Sellentin & Heavens 2016, 456:L132). No formula of theirs holds for a covariance that is drawn towards a white
//! one, for scatter that depends on the parameters, or is not normal; but the runs themselves tell. The residual of each is
//! taken for that of a measurement, fitted with the covariance of the others, and the parameters move by δ. Were the covariance
//! right, the mean of δᵀ V⁻¹ δ, V the covariance that the fit claims, would be the number of parameters. Where it is κ times as
//! much, (κ − 1) J V Jᵀ is added, J the derivatives of the curve: V becomes κ V, and what no parameter does stays as it is.

use nalgebra::{DMatrix, SymmetricEigen};

/// A direction that a measurement leaves wider than this, on the scale of the prior's width, is not told by it.
const TOLD: f64 = 0.3;

/// Widest that a covariance is made.
const MOST: f64 = 25.0;

/// Scatter as it is estimated, in standard deviations of the noise.
pub struct Estimated<'a> {
    /// Residuals of the runs, shape (runs, outputs).
    pub residuals: &'a DMatrix<f64>,
    /// What their mean product counts with, α c.
    pub share: f64,
    /// The white variance of each output, the noise among it, shape (outputs,).
    pub white: &'a [f64],
    /// Of that, the variance of the noise, which is the same at all outputs.
    pub noise: f64,
}

impl Estimated<'_> {
    /// (κ − 1) V of the parameters, shape (parameters, parameters); none where κ is not clearly above one.
    ///
    /// * `slopes` — J, shape (outputs, parameters), by coordinates that the prior spreads over a width of one.
    ///
    /// With all residuals as the rows of R, D = diag(white), β = αc/(n − 1) and A = I + β R D⁻¹ Rᵀ, in the space of the runs:
    /// C = D + β RᵀR has Jᵀ C⁻¹ Rᵀ = (R D⁻¹ J)ᵀ A⁻¹, and without the residual x it is C − β xxᵀ. In coordinates in which
    /// Jᵀ C⁻¹ J = I, with g = Jᵀ C⁻¹ x and a = (A⁻¹)ₓₓ, what the fit without x makes of x is δᵀ V⁻¹ δ = |g|² / (a (a + β |g|²)).
    pub fn excess(&self, slopes: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let n = self.residuals.nrows();
        if n < 3 {
            return None;
        }
        let beta = self.share / (n - 1) as f64;
        let mut divided = slopes.clone();
        divided.row_iter_mut().zip(self.white).for_each(|(mut row, white)| row /= *white);
        let of_runs = self.residuals * &divided;
        let mut over = self.residuals.clone();
        over.column_iter_mut().zip(self.white).for_each(|(mut column, white)| column /= *white);
        let a = DMatrix::identity(n, n) + &over * self.residuals.transpose() * beta;
        let inverse = a.cholesky()?.inverse();
        let solved = &inverse * &of_runs;
        let information = slopes.tr_mul(&divided) - of_runs.tr_mul(&solved) * beta;
        let eigen = SymmetricEigen::new((&information + information.transpose()) / 2.0);
        let told: Vec<usize> =
            (0..slopes.ncols()).filter(|&k| eigen.eigenvalues[k] > 1.0 / (TOLD * TOLD)).collect();
        if told.is_empty() {
            return None;
        }
        let axes = DMatrix::from_fn(slopes.ncols(), told.len(), |row, k| {
            eigen.eigenvectors[(row, told[k])] / eigen.eigenvalues[told[k]].sqrt()
        });
        let g = &solved * &axes;
        let of_run = |i: usize| {
            let (square, a) = (g.row(i).norm_squared(), inverse[(i, i)].clamp(1e-12, 1.0));
            square / (a * (a + beta * square))
        };
        // What the measurement's noise moves them by, too: C⁻¹ J of all runs.
        let moved = (&divided - over.tr_mul(&solved) * beta) * &axes;
        let all = (0..n).map(of_run).sum::<f64>() / n as f64 + self.noise * moved.norm_squared();
        let kappa = (all / told.len() as f64).min(MOST);
        let by_chance = (2.0 / (n * told.len()) as f64).sqrt();
        (kappa > 1.0 + 2.0 * by_chance).then(|| &axes * axes.transpose() * (kappa - 1.0))
    }
}

#[cfg(test)]
mod tests {
    use gl_inference::prior::normal_quantile;
    use rand::distr::Open01;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const OUTPUTS: usize = 30;

    /// Smooth scatter of many patterns, larger than the noise in all of them.
    fn residuals(runs: usize, seed: u64) -> DMatrix<f64> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let size = DMatrix::from_fn(runs, OUTPUTS, |_, k| {
            200.0 / (k + 1) as f64 * normal_quantile(generator.sample(Open01))
        });
        size * DMatrix::from_fn(OUTPUTS, OUTPUTS, |k, o| {
            (k as f64 * (o as f64 + 0.5) * std::f64::consts::PI / OUTPUTS as f64).cos()
        })
    }

    fn slopes() -> DMatrix<f64> {
        DMatrix::from_fn(OUTPUTS, 1, |o, _| 3000.0 * (o as f64 / OUTPUTS as f64).sqrt())
    }

    fn fitted(covariance: &DMatrix<f64>, x: &DMatrix<f64>) -> (f64, f64) {
        let inverse = covariance.clone().try_inverse().unwrap();
        let told = (slopes().transpose() * &inverse * slopes())[(0, 0)];
        ((slopes().transpose() * &inverse * x)[(0, 0)] / told, 1.0 / told)
    }

    fn covariance(residuals: &DMatrix<f64>, share: f64) -> DMatrix<f64> {
        DMatrix::identity(OUTPUTS, OUTPUTS) + residuals.tr_mul(residuals) * (share / residuals.nrows() as f64)
    }

    /// The formula, against the fit of each residual by the covariance of the others.
    #[test]
    fn the_excess_is_what_fits_of_the_runs_scatter_by() {
        let (rows, share) = (residuals(50, 3), 0.9);
        let white = vec![1.0; OUTPUTS];
        let here = Estimated { residuals: &rows, share, white: &white, noise: 1.0 };
        let excess = here.excess(&slopes()).unwrap()[(0, 0)];
        let (mut sum, n) = (0.0, rows.nrows());
        let beta = share / (n - 1) as f64;
        let whole = DMatrix::identity(OUTPUTS, OUTPUTS) + rows.tr_mul(&rows) * beta;
        for i in 0..n {
            let x = rows.row(i).transpose();
            let others = &whole - &x * x.transpose() * beta;
            let x = DMatrix::from_column_slice(OUTPUTS, 1, x.as_slice());
            let (moved, claimed) = fitted(&others, &x);
            sum += moved * moved / claimed / n as f64;
        }
        let (_, claimed) = fitted(&whole, &DMatrix::zeros(OUTPUTS, 1));
        let inverse = whole.try_inverse().unwrap();
        let of_noise = (slopes().transpose() * &inverse * &inverse * slopes())[(0, 0)] * claimed;
        let expected = (sum + of_noise - 1.0) * claimed;
        assert!((excess / expected - 1.0).abs() < 1e-5, "{excess} {expected}");
    }

    /// Measurements of the same scatter: how far fits of them are off, in what they claim, without the excess and with it.
    #[test]
    fn fits_are_off_by_as_much_as_they_claim() {
        let (mut before, mut after) = (0.0, 0.0);
        for seed in 0..20 {
            let rows = residuals(50, 100 + seed);
            let white = vec![1.0; OUTPUTS];
            let here = Estimated { residuals: &rows, share: 1.0, white: &white, noise: 1.0 };
            let excess = here.excess(&slopes()).map_or(0.0, |excess| excess[(0, 0)]);
            let others = residuals(40, 1000 + seed);
            let covariance = covariance(&rows, 1.0);
            for x in others.row_iter() {
                let x = DMatrix::from_column_slice(OUTPUTS, 1, x.transpose().as_slice());
                let (moved, claimed) = fitted(&covariance, &x);
                before += moved * moved / claimed / 800.0;
                after += moved * moved / (claimed + excess) / 800.0;
            }
        }
        assert!(before > 2.0, "{before}");
        assert!((0.6..1.4).contains(&after), "{after}");
    }

    #[test]
    fn scatter_of_few_patterns_that_many_runs_show_is_as_wide_as_it_is() {
        let mut generator = ChaCha8Rng::seed_from_u64(8);
        let size = DMatrix::from_fn(200, 2, |_, _| 3.0 * normal_quantile(generator.sample(Open01)));
        let rows = size * DMatrix::from_fn(2, OUTPUTS, |k, o| ((k + 1) as f64 * o as f64 * 0.05).sin());
        let white = vec![1.0; OUTPUTS];
        assert!(
            Estimated { residuals: &rows, share: 1.0, white: &white, noise: 1.0 }.excess(&slopes()).is_none()
        );
    }
}
