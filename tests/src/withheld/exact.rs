//! The world itself in place of its emulator: what the diagnosis would reach if it knew the simulation
//! exactly.

use anyhow::{Error, Result};
use gl_gap::attribute::problem::predictor::{Predicted, Predictor};
use gl_gap::attribute::problem::simulation::Simulation;
use gl_inference::observations::{ByName, Observations};
use gl_inference::prior::{Parameter, Prior};
use nalgebra::{DMatrix, DVector};

use super::bench::Bench;

/// A world, in the components of an emulator about a measurement and with its scatter.
pub struct Exact<'a> {
    bench: &'a Bench,
    prior: &'a Prior,
    simulation: &'a Simulation,
    /// Inverse of the patterns, shape (components, readings).
    inverse: DMatrix<f64>,
}

impl<'a> Exact<'a> {
    /// The world behind an emulator of some of its parameters; its curves are projected on the components
    /// in units of the measurement's noise, or of its ranges where that is not stated.
    ///
    /// # Errors
    /// If the components have no inverse.
    pub fn new(
        bench: &'a Bench,
        prior: &'a Prior,
        simulation: &'a Simulation,
        observations: &Observations,
    ) -> Result<Self> {
        let basis = simulation.basis();
        let noise = observations.noise(&ByName::default())?;
        let of_ranges = || {
            let steps = |(values, range): (&Vec<f64>, f64)| vec![range; values.len()];
            observations.values.iter().zip(observations.ranges()).map(steps).collect()
        };
        let noise = noise.unwrap_or_else(of_ranges).concat();
        let white = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| basis[(i, k)] / noise[i]);
        let mut inverse = white.pseudo_inverse(1e-14).map_err(Error::msg)?;
        for (mut column, noise) in inverse.column_iter_mut().zip(noise) {
            column /= noise;
        }
        Ok(Self { bench, prior, simulation, inverse })
    }
}

impl Predictor for Exact<'_> {
    fn readings(&self) -> usize {
        self.simulation.readings()
    }

    fn basis(&self) -> &DMatrix<f64> {
        self.simulation.basis()
    }

    fn left_over(&self) -> &[f64] {
        self.simulation.left_over()
    }

    fn scatter(&self) -> Vec<f64> {
        self.simulation.scatter()
    }

    fn correlation(&self) -> DMatrix<f64> {
        self.simulation.correlation()
    }

    fn curve(&self, components: &[f64]) -> Vec<f64> {
        self.simulation.curve(components)
    }

    fn predict(&self, point: &[f64]) -> Predicted {
        let value = |(parameter, &at): (&Parameter, &f64)| {
            let is_off = |off: &f64| (parameter.coordinate(*off) - at).abs() < 1e-12;
            parameter.off.filter(is_off).unwrap_or_else(|| parameter.at_coordinate(at))
        };
        let values: Vec<f64> = self.prior.parameters().iter().zip(point).map(value).collect();
        let components = self.inverse.nrows();
        let Ok(curves) = self.bench.simulate(&self.bench.with_rest_off(self.prior, &values)) else {
            return Predicted { mean: vec![f64::NAN; components], variance: vec![0.0; components] };
        };
        let mean = &self.inverse * DVector::from_vec(self.simulation.away(&curves.concat()));
        Predicted { mean: mean.as_slice().to_vec(), variance: vec![0.0; components] }
    }
}
