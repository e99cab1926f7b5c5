//! The world itself in place of its emulator: what the diagnosis would reach if it knew the simulation
//! exactly.

use gl::emulator::Emulator;
use gl::gap::attribute::predictor::{Prediction, Predictor};
use gl::prior::Prior;
use nalgebra::{DMatrix, DVector};

use super::bench::Bench;

/// A world, in the components of an emulator and with its scatter.
pub struct Exact<'a> {
    bench: &'a Bench,
    prior: &'a Prior,
    emulator: &'a Emulator,
    /// Components of a curve about the centre, shape (components, readings).
    inverse: DMatrix<f64>,
    left_over: Vec<f64>,
}

impl<'a> Exact<'a> {
    /// The world behind an emulator of some of its parameters; its curves are projected on the components
    /// in units of a noise, shape (observables, steps).
    pub fn new(bench: &'a Bench, prior: &'a Prior, emulator: &'a Emulator, noise: &[Vec<f64>]) -> Self {
        let basis = Predictor::basis(emulator);
        let left_over = Predictor::left_over(emulator).to_vec();
        let unit = DVector::from_vec(noise.concat()).map(f64::recip);
        let white = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| basis[(i, k)] * unit[i]);
        let mut inverse = white.clone().pseudo_inverse(1e-14).unwrap_or_else(|_| white.transpose());
        for (mut column, unit) in inverse.column_iter_mut().zip(unit.iter()) {
            column *= *unit;
        }
        Self { bench, prior, emulator, inverse, left_over }
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
        &self.left_over
    }

    fn scatter(&self) -> Vec<f64> {
        Predictor::scatter(self.emulator)
    }

    fn correlation(&self) -> DMatrix<f64> {
        Predictor::correlation(self.emulator)
    }

    fn predict(&self, point: &[f64]) -> Prediction {
        let full: Vec<f64> = self
            .bench
            .prior
            .parameters()
            .iter()
            .map(|parameter| {
                let place = self.prior.parameters().iter().position(|other| other.name == parameter.name);
                place.map_or(parameter.off.unwrap_or(0.0), |place| {
                    let is_off = |off: &f64| (parameter.coordinate(*off) - point[place]).abs() < 1e-12;
                    parameter.off.filter(is_off).unwrap_or_else(|| parameter.at_coordinate(point[place]))
                })
            })
            .collect();
        let components = self.inverse.nrows();
        let Ok(curves) = self.bench.simulate(&full) else {
            return Prediction { mean: vec![f64::NAN; components], variance: vec![0.0; components] };
        };
        let away: Vec<f64> = curves.concat().iter().zip(self.centre()).map(|(y, c)| y - c).collect();
        let mean = &self.inverse * DVector::from_vec(away);
        Prediction { mean: mean.as_slice().to_vec(), variance: vec![0.0; components] }
    }
}
