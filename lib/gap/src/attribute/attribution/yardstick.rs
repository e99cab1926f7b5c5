//! A gap in units of noise and scatter.
//!
//! What a packing does it does to many readings at once, and may do it by several times the noise. By the spread of readings,
//! each for itself, that hides whatever is smaller, though it has another shape. By the shape of the scatter it is one unit,
//! however many readings show it, and what has another shape is measured by the noise; beside that, an effect which does what
//! packings do, too, is hardly seen. So there is one yardstick for either.

use std::borrow::Cow;

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::attribute::problem::Problem;

/// The covariance of noise and scatter, in which gaps are measured: white noise, of one size an observable, and what packings
/// scatter by, either as so much more of it or in its own shape.
pub struct Yardstick<'a> {
    problem: &'a Problem<'a>,
    /// One over the variance of the noise, shape (readings,); 0 where a reading does not count.
    precision: Vec<f64>,
    /// Patterns of the scatter, shape (readings, components).
    scatter: Cow<'a, DMatrix<f64>>,
    /// The Cholesky factor of 1 + Aᵀ N⁻¹ A, A the scatter and N the noise.
    factor: Cholesky<f64, Dyn>,
}

impl<'a> Yardstick<'a> {
    /// Each reading by its spread.
    ///
    /// * `scales` — of the noise, in its units, shape (observables,).
    /// * `skipped` — readings that do not count.
    ///
    /// # Errors
    /// If the spread is not finite.
    pub fn of_readings(problem: &'a Problem<'a>, scales: &[f64], skipped: &[usize]) -> Result<Self> {
        let variance = |j: usize| problem.spread(j, scales).powi(2);
        let none = DMatrix::zeros(problem.observed.len(), 0);
        Self::new(problem, variance, Cow::Owned(none), skipped)
    }

    /// What has the shape of the scatter by that, and all else by the noise. See [`Self::of_readings`].
    ///
    /// # Errors
    /// If the scatter is not finite.
    pub fn of_shapes(problem: &'a Problem<'a>, scales: &[f64], skipped: &[usize]) -> Result<Self> {
        let variance = |j: usize| problem.noise_variance(j, scales[j]);
        Self::new(problem, variance, Cow::Borrowed(problem.scatter_patterns()), skipped)
    }

    fn new(
        problem: &'a Problem<'a>,
        variance: impl Fn(usize) -> f64,
        scatter: Cow<'a, DMatrix<f64>>,
        skipped: &[usize],
    ) -> Result<Self> {
        let precisions: Vec<f64> = (0..problem.ranges.len()).map(|j| 1.0 / variance(j)).collect();
        let of_reading =
            |i: usize| if skipped.contains(&i) { 0.0 } else { precisions[problem.observable_of(i)] };
        let precision: Vec<f64> = (0..problem.observed.len()).map(of_reading).collect();
        let mut weighed = scatter.as_ref().clone();
        weighed.row_iter_mut().zip(&precision).for_each(|(mut row, precision)| row *= *precision);
        let inner = DMatrix::identity(scatter.ncols(), scatter.ncols()) + weighed.tr_mul(scatter.as_ref());
        let factor = Cholesky::new(inner).context("the scatter of the simulation is not finite")?;
        Ok(Self { problem, precision, scatter, factor })
    }

    /// Mean square of what is left of the readings, shape (readings,): 1 for noise and scatter. Each observable counts alike,
    /// however many readings it has.
    pub fn mean_square(&self, left: &[f64]) -> f64 {
        let counted = |(i, left): (usize, &f64)| left * self.problem.counts(i).sqrt();
        let left = DVector::from_iterator(left.len(), left.iter().enumerate().map(counted));
        let weighed =
            DVector::from_iterator(left.len(), left.iter().zip(&self.precision).map(|(x, p)| x * p));
        // (N + A Aᵀ)⁻¹ = N⁻¹ − N⁻¹ A (1 + Aᵀ N⁻¹ A)⁻¹ Aᵀ N⁻¹.
        let along = self.scatter.tr_mul(&weighed);
        let explained = along.dot(&self.factor.solve(&along));
        let count = self.precision.iter().filter(|precision| **precision > 0.0).count();
        (left.dot(&weighed) - explained).max(0.0) / count as f64
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    #[test]
    fn without_scatter_it_is_the_mean_square_over_the_noise_of_what_counts() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let left: Vec<f64> = (0..STEPS).map(|t| 0.001 * t as f64).collect();
        let square =
            |skipped: &[usize]| Yardstick::of_shapes(&problem, &[2.0], skipped).unwrap().mean_square(&left);
        let expected =
            |count: usize| (0..count).map(|t| (0.05 * t as f64).powi(2)).sum::<f64>() / count as f64;
        assert!((square(&[]) - expected(STEPS)).abs() < 1e-12);
        assert!((square(&[STEPS - 1]) - expected(STEPS - 1)).abs() < 1e-12);
    }

    #[test]
    fn what_packings_do_to_all_readings_at_once_counts_once() {
        let (predictor, prior) = (Straight::scattering(0.04), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let yardstick = Yardstick::of_shapes(&problem, &[1.0], &[]).unwrap();
        // Two standard deviations of the scatter, 0.2, in all readings: of n with noise 0.01 s = n 0.2² / 0.01², and 2² s / (1 + s).
        let s = STEPS as f64 * 0.04 / 1e-4;
        let expected = 4.0 * s / (1.0 + s) / STEPS as f64;
        assert!((yardstick.mean_square(&[0.4; STEPS]) - expected).abs() < 1e-9);
        // Noise and scatter are one in the mean.
        let errors = problem.measurement_errors(&[1.0]);
        let all = errors.column_iter().map(|error| yardstick.mean_square(error.into_owned().as_slice()));
        assert!((all.sum::<f64>() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_packings_scatter_by_does_not_hide_an_effect_of_another_shape() {
        // What lies beyond the bound of a, which is 5, is scatter, of 0.2, beside which the wave is small.
        let (predictor, (prior, _)) = (Straight::scattering(0.04), Straight::beyond(0.0, 2.0));
        let problem = predictor.problem(&prior, &Straight::measured(5.3, 0.6, 0.15, 0.01));
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let closes = |name: &str| explanations.iter().find(|of| of.name == name).unwrap().closes;
        assert!(
            closes("wave") > 0.9 && closes("offset(y)") < 0.5,
            "{} {}",
            closes("wave"),
            closes("offset(y)")
        );
        assert_eq!(explanations[0].name, "wave");
    }
}
