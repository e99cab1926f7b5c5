//! The world itself in place of its emulator: what the diagnosis would reach if it knew the simulation
//! exactly.

use anyhow::{Error, Result};
use gl_emulator::Emulator;
use gl_gap::attribute::predictor::{Prediction, Predictor};
use gl_inference::prior::{Parameter, Prior};
use nalgebra::{DMatrix, DVector};

use super::bench::Bench;

/// A world, in the components of an emulator and with its scatter.
pub struct Exact<'a> {
    bench: &'a Bench,
    prior: &'a Prior,
    emulator: &'a Emulator,
    /// Components of a curve about the centre, shape (components, readings).
    inverse: DMatrix<f64>,
}

impl<'a> Exact<'a> {
    /// The world behind an emulator of some of its parameters; its curves are projected on the components
    /// in units of a noise, shape (observables, steps).
    ///
    /// # Errors
    /// If the components have no inverse.
    pub fn new(
        bench: &'a Bench,
        prior: &'a Prior,
        emulator: &'a Emulator,
        noise: &[Vec<f64>],
    ) -> Result<Self> {
        let basis = Predictor::basis(emulator);
        let unit = DVector::from_vec(noise.concat()).map(f64::recip);
        let white = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| basis[(i, k)] * unit[i]);
        let mut inverse = white.pseudo_inverse(1e-14).map_err(Error::msg)?;
        for (mut column, unit) in inverse.column_iter_mut().zip(unit.iter()) {
            column *= *unit;
        }
        Ok(Self { bench, prior, emulator, inverse })
    }
}

impl Predictor for Exact<'_> {
    fn centre(&self) -> &[f64] {
        Predictor::centre(self.emulator)
    }

    fn basis(&self) -> &DMatrix<f64> {
        Predictor::basis(self.emulator)
    }

    fn left_over(&self) -> &[f64] {
        Predictor::left_over(self.emulator)
    }

    fn scatter(&self) -> Vec<f64> {
        Predictor::scatter(self.emulator)
    }

    fn correlation(&self) -> DMatrix<f64> {
        Predictor::correlation(self.emulator)
    }

    fn predict(&self, point: &[f64]) -> Prediction {
        let value = |(parameter, &at): (&Parameter, &f64)| {
            let is_off = |off: &f64| (parameter.coordinate(*off) - at).abs() < 1e-12;
            parameter.off.filter(is_off).unwrap_or_else(|| parameter.at_coordinate(at))
        };
        let values: Vec<f64> = self.prior.parameters().iter().zip(point).map(value).collect();
        let components = self.inverse.nrows();
        let Ok(curves) = self.bench.simulate(&self.bench.with_rest_off(self.prior, &values)) else {
            return Prediction { mean: vec![f64::NAN; components], variance: vec![0.0; components] };
        };
        let away: Vec<f64> = curves.concat().iter().zip(self.centre()).map(|(y, c)| y - c).collect();
        let mean = &self.inverse * DVector::from_vec(away);
        Prediction { mean: mean.as_slice().to_vec(), variance: vec![0.0; components] }
    }
}
