//! What a calibration takes out of the noise: the hat matrix of its parameters.

use nalgebra::{DMatrix, SymmetricEigen};

use super::noise::Noise;

/// The hat matrix Σ h u uᵀ of a calibration, in units of the noise.
#[derive(Clone, Debug, Default)]
pub(super) struct Hat {
    /// Directions u of unit length, each of shape (observables · steps), with the share h in [0, 1] of
    /// the noise along them that the fit follows.
    directions: Vec<(f64, Vec<f64>)>,
}

impl Hat {
    /// From what the posterior spread of the parameters does to the readings: directions as rows,
    /// shape (parameters, observables · steps), in units of the noise, whose outer products sum to
    /// its covariance. A fit follows all the noise along a direction in which that is at least the
    /// noise itself, as it is wherever the data and not the prior determine the fit.
    pub fn new(spread: &DMatrix<f64>) -> Self {
        if spread.nrows() == 0 {
            return Self::default();
        }
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(spread * spread.transpose());
        let direction = |k: usize| {
            let along = spread.tr_mul(&eigenvectors.column(k)) / eigenvalues[k].sqrt();
            (eigenvalues[k].min(1.0), along.iter().copied().collect())
        };
        let highest = eigenvalues.iter().copied().fold(0.0, f64::max);
        let kept = (0..eigenvalues.len()).filter(|&k| eigenvalues[k] > 1e-12 * highest);
        Self { directions: kept.map(direction).collect() }
    }

    /// Take out of an error, shape (observables, steps), what the fit would follow.
    pub fn take_out(&self, error: &mut [Vec<f64>], noises: &[Noise]) {
        let sd: Vec<f64> = noises.iter().flat_map(|noise| noise.sd.iter().copied()).collect();
        let along: Vec<f64> = self
            .directions
            .iter()
            .map(|(_, u)| error.iter().flatten().zip(&sd).zip(u).map(|((e, sd), u)| e / sd * u).sum())
            .collect();
        for ((share, u), along) in self.directions.iter().zip(along) {
            for ((e, sd), u) in error.iter_mut().flatten().zip(&sd).zip(u) {
                *e -= share * along * u * sd;
            }
        }
    }

    /// Variance that the fit leaves of every reading's noise, shape (observables, steps): the diagonal
    /// of (I − H) R (I − H)ᵀ for the noise covariance R.
    pub fn left(&self, noises: &[Noise]) -> Vec<Vec<f64>> {
        let correlated: Vec<Vec<f64>> = self.directions.iter().map(|(_, u)| correlate(u, noises)).collect();
        let product = |k: usize, l: usize| -> f64 {
            correlated[k].iter().zip(&self.directions[l].1).map(|(a, b)| a * b).sum()
        };
        let count = self.directions.len();
        let inner = DMatrix::from_fn(count, count, product);
        let steps = noises[0].sd.len();
        let at = |i: usize| {
            let mut left = 1.0;
            for (k, (share, u)) in self.directions.iter().enumerate() {
                left -= 2.0 * share * u[i] * correlated[k][i];
                for (l, (other_share, other)) in self.directions.iter().enumerate() {
                    left += share * other_share * u[i] * other[i] * inner[(k, l)];
                }
            }
            left.max(0.0) * noises[i / steps].sd[i % steps].powi(2)
        };
        (0..noises.len()).map(|j| (0..steps).map(|step| at(j * steps + step)).collect()).collect()
    }
}

/// The correlation matrix of the noise times a vector, by running sums from both ends.
fn correlate(x: &[f64], noises: &[Noise]) -> Vec<f64> {
    let steps = noises[0].sd.len();
    let mut product: Vec<f64> = x.iter().map(|x| -x).collect();
    for (noise, (x, product)) in noises.iter().zip(x.chunks(steps).zip(product.chunks_mut(steps))) {
        let (mut forwards, mut backwards) = (0.0, 0.0);
        for step in 0..steps {
            forwards = noise.phi * forwards + x[step];
            product[step] += forwards;
            backwards = noise.phi * backwards + x[steps - 1 - step];
            product[steps - 1 - step] += backwards;
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_the_residual_covariance_written_out() {
        let noises =
            [Noise { sd: vec![1.0, 2.0, 0.5], phi: 0.6 }, Noise { sd: vec![0.3, 0.1, 0.2], phi: 0.2 }];
        let spread =
            DMatrix::from_row_slice(2, 6, &[2.0, 1.0, 0.5, 1.0, -1.0, 3.0, 0.1, 0.3, -0.2, 0.1, 0.4, 0.0]);
        let hat = Hat::new(&spread);
        let correlation = DMatrix::from_fn(6, 6, |a, b| {
            if a / 3 == b / 3 { noises[a / 3].phi.powi(a.abs_diff(b) as i32) } else { 0.0 }
        });
        let mut matrix = DMatrix::<f64>::identity(6, 6);
        for (share, u) in &hat.directions {
            let u = nalgebra::DVector::from_column_slice(u);
            assert!((u.norm() - 1.0).abs() < 1e-12 && *share > 0.0 && *share <= 1.0);
            matrix -= *share * &u * u.transpose();
        }
        let expected = &matrix * correlation * matrix.transpose();
        let left = hat.left(&noises);
        for i in 0..6 {
            let variance = noises[i / 3].sd[i % 3].powi(2);
            assert!((left[i / 3][i % 3] - variance * expected[(i, i)]).abs() < 1e-12, "reading {i}");
        }
    }

    #[test]
    fn without_parameters_nothing_is_taken_out() {
        let noises = [Noise { sd: vec![1.0, 2.0], phi: 0.5 }];
        let left = Hat::new(&DMatrix::zeros(0, 2)).left(&noises);
        assert_eq!(left, [[1.0, 4.0]]);
    }

    #[test]
    fn a_fit_leaves_nothing_along_what_it_determines() {
        let noises = [Noise { sd: vec![1.0, 2.0], phi: 0.0 }];
        let hat = Hat::new(&DMatrix::from_row_slice(1, 2, &[30.0, 40.0]));
        let mut error = vec![vec![3.0, 8.0]];
        hat.take_out(&mut error, &noises);
        assert!(error[0].iter().all(|e| e.abs() < 1e-12), "{error:?}");
    }
}
