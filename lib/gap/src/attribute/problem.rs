//! The question that every hypothesis answers: a measurement, and a simulation to explain it by.

use anyhow::{Context, Result, ensure};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::attribute::discrepancy::Smooth;
use crate::attribute::gaussian::Covariance;
use crate::attribute::hypothesis::Candidate;
use crate::attribute::path::Path;
use crate::attribute::predictor::Predictor;
use gl_inference::observations::Observations;
use gl_inference::prior::Prior;

/// What all hypotheses share.
pub struct Problem<'a> {
    /// The simulation at any parameters; its points are coordinates of all parameters of the prior.
    pub predictor: &'a dyn Predictor,
    /// The parameters and their prior.
    pub prior: &'a Prior,
    /// What may explain the gap.
    pub candidates: Vec<Candidate>,
    /// What was measured, shape (observables · steps).
    pub observed: Vec<f64>,
    /// Range of each observable, shape (observables,).
    pub ranges: Vec<f64>,
    /// Names of the observables.
    pub observables: Vec<String>,
    /// Name of the control.
    pub control_name: String,
    /// The control.
    pub path: Path,
    /// Standard deviation of the noise of every reading, shape (observables · steps); estimated
    /// with the fit if absent.
    pub noise: Option<Vec<f64>>,
    /// Share of the simulation's own scatter that the measurement has too.
    pub scatter: f64,
    /// Smooth patterns of a discrepancy of one observable.
    pub smooth: Smooth,
    /// Variance of each component by the simulation's scatter.
    component_scatter: Vec<f64>,
    /// Lower factor of the correlation of the components' errors.
    correlation: DMatrix<f64>,
    /// All patterns of the covariance: the predictor's, and the smooth ones of each observable.
    patterns: DMatrix<f64>,
    /// The covariance without the variances of the patterns, where the noise is known.
    covariance: Option<Covariance>,
    /// Mean variance of an observable from the simulation's scatter, times its share.
    scatter_variance: Vec<f64>,
}

/// The smooth discrepancy that every hypothesis is granted, as a share of noise and scatter: no
/// model is exact.
const SMALL: f64 = 0.15;

/// What the emulator's variance is multiplied by: its errors, left one out, have heavier tails than
/// the normal distribution.
const HEAVY_TAILS: f64 = 2.0;

impl<'a> Problem<'a> {
    /// * `noise` — standard deviations, shape (observables, steps), or nothing to estimate them.
    /// * `scatter` — share of the simulation's scatter that the measurement has, not negative.
    ///
    /// # Errors
    /// If the predictor has curves of another length, an observable is constant, or a noise is not
    /// positive.
    pub fn new(
        predictor: &'a dyn Predictor,
        prior: &'a Prior,
        candidates: Vec<Candidate>,
        observations: &Observations,
        noise: Option<Vec<Vec<f64>>>,
        scatter: f64,
    ) -> Result<Self> {
        let (observables, steps) = (observations.names.len(), observations.steps());
        ensure!(
            predictor.centre().len() == observables * steps,
            "{}: {} readings, but the simulation gives {}",
            observations.source,
            observables * steps,
            predictor.centre().len()
        );
        ensure!(scatter >= 0.0, "--scatter {scatter}: give a share of at least 0");
        let ranges = observations.ranges();
        for (name, &range) in observations.names.iter().zip(&ranges) {
            ensure!(range > 0.0, "{}: {name} is the same at every step; leave it out", observations.source);
        }
        let noise: Option<Vec<f64>> = noise.map(|noise| noise.concat());
        ensure!(
            noise.iter().flatten().all(|&sd| sd > 0.0),
            "{}: a noise of zero; give its standard deviation with --noise",
            observations.source
        );
        let path = Path::new(&observations.control);
        let smooth = Smooth::new(&path.places());
        let component_scatter = predictor.scatter();
        let components = component_scatter.len();
        let correlation = Cholesky::new(predictor.correlation())
            .context("the correlation of the components' errors is not positive definite")?
            .unpack();
        let mut patterns = DMatrix::zeros(observables * steps, components + observables * smooth.len());
        patterns.columns_mut(0, components).copy_from(predictor.basis());
        for j in 0..observables {
            patterns
                .view_mut((j * steps, components + j * smooth.len()), (steps, smooth.len()))
                .copy_from(&smooth.patterns);
        }
        let roots = DVector::from_iterator(components, component_scatter.iter().map(|tau| tau.sqrt()));
        let scattered = predictor.basis() * DMatrix::from_diagonal(&roots) * &correlation;
        let scatter_variance = (0..observables)
            .map(|j| scatter * scattered.rows(j * steps, steps).norm_squared() / steps as f64)
            .collect();
        let covariance = noise.as_ref().map(|noise| {
            let diagonal: Vec<f64> = noise
                .iter()
                .zip(predictor.left_over())
                .map(|(sd, rest)| sd * sd + HEAVY_TAILS * rest)
                .collect();
            Covariance::new(&diagonal, &patterns, &correlation)
        });
        Ok(Self {
            predictor,
            prior,
            candidates,
            observed: observations.values.concat(),
            ranges,
            observables: observations.names.clone(),
            control_name: observations.control_name.clone(),
            path,
            noise,
            scatter,
            smooth,
            component_scatter,
            correlation,
            patterns,
            covariance,
            scatter_variance,
        })
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.path.control().len()
    }

    /// A factor of the covariance of the emulator's error at the variances of its components, with
    /// what the components leave out, shape (readings, components + readings).
    pub fn emulator_errors(&self, component_variance: &[f64]) -> DMatrix<f64> {
        let variance: Vec<f64> =
            component_variance.iter().map(|variance| HEAVY_TAILS * variance.max(0.0)).collect();
        let rest: Vec<f64> =
            self.predictor.left_over().iter().map(|rest| (HEAVY_TAILS * rest).sqrt()).collect();
        self.factor(&variance, &rest)
    }

    /// A factor of the covariance of noise and scatter, in the same shape; `noise` as shares of the
    /// ranges where it is estimated.
    pub fn measurement_errors(&self, noise: &[f64]) -> DMatrix<f64> {
        let steps = self.steps();
        let estimated = |i: usize| noise[i / steps] * self.ranges[i / steps];
        let sd: Vec<f64> = (0..self.observed.len())
            .map(|i| self.noise.as_ref().map_or_else(|| estimated(i), |sd| sd[i]))
            .collect();
        let variance: Vec<f64> = self.component_scatter.iter().map(|tau| self.scatter * tau).collect();
        self.factor(&variance, &sd)
    }

    /// Correlated components of these variances, and independent readings of these deviations.
    fn factor(&self, variance: &[f64], sd: &[f64]) -> DMatrix<f64> {
        let roots = DVector::from_iterator(variance.len(), variance.iter().map(|v| v.sqrt()));
        let mut factor = DMatrix::zeros(sd.len(), variance.len() + sd.len());
        factor
            .columns_mut(0, variance.len())
            .copy_from(&(self.predictor.basis() * DMatrix::from_diagonal(&roots) * &self.correlation));
        for (i, sd) in sd.iter().enumerate() {
            factor[(i, variance.len() + i)] = *sd;
        }
        factor
    }

    /// Use the covariance at a noise (a share of each range, where it is estimated), an amplitude of
    /// the discrepancy (in noise and scatter) of each observable, and the variances of the components.
    ///
    /// # Errors
    /// If the covariance is not finite.
    pub fn with_covariance<T>(
        &self,
        noise: &[f64],
        amplitudes: &[f64],
        component_variance: &[f64],
        visit: impl FnOnce(&crate::attribute::gaussian::Filled<'_>) -> T,
    ) -> Result<T> {
        let steps = self.steps();
        let estimated;
        let covariance = match &self.covariance {
            Some(covariance) => covariance,
            None => {
                let diagonal: Vec<f64> = self
                    .predictor
                    .left_over()
                    .iter()
                    .enumerate()
                    .map(|(i, rest)| HEAVY_TAILS * rest + (noise[i / steps] * self.ranges[i / steps]).powi(2))
                    .collect();
                estimated = Covariance::new(&diagonal, &self.patterns, &self.correlation);
                &estimated
            }
        };
        let mut variances: Vec<f64> = component_variance
            .iter()
            .zip(&self.component_scatter)
            .map(|(variance, scatter)| HEAVY_TAILS * variance.max(0.0) + self.scatter * scatter)
            .collect();
        for j in 0..self.ranges.len() {
            let unit = self.spread(j, noise).powi(2);
            let amplitude = amplitudes.get(j).copied().unwrap_or(0.0);
            let share = (SMALL * SMALL + amplitude * amplitude) * unit;
            variances.extend(self.smooth.variances.iter().map(|variance| share * variance));
        }
        Ok(visit(&covariance.fill(&variances)?))
    }

    /// Root-mean-square of noise and scatter of an observable; `noise` as shares of the ranges where
    /// it is estimated.
    pub fn spread(&self, observable: usize, noise: &[f64]) -> f64 {
        let steps = self.steps();
        let own = match &self.noise {
            Some(sd) => {
                let own = &sd[observable * steps..(observable + 1) * steps];
                own.iter().map(|sd| sd * sd).sum::<f64>() / steps as f64
            }
            None => (noise[observable] * self.ranges[observable]).powi(2),
        };
        (own + self.scatter_variance[observable]).sqrt()
    }
}
