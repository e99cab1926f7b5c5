//! The coordinates that a posterior is sampled in.

use anyhow::{Result, ensure};
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;

/// Coordinates closer than this are the same.
const SAME: f64 = 1e-9;

/// The parameters that vary, each between 0 and 1 at its bounds (of the logarithm, on a log scale); the
/// others stay at the value that they have in every sample.
#[derive(Clone, Debug)]
pub struct Space {
    prior: Prior,
    varied: Vec<usize>,
    /// A point to take the parameters that do not vary from: values and coordinates.
    values: Vec<f64>,
    coordinates: Vec<f64>,
}

impl Space {
    /// The space of the parameters that vary from sample to sample.
    ///
    /// # Errors
    /// If a parameter is no column of the samples, none varies, or one that varies lies outside its bounds.
    pub fn new(prior: &Prior, samples: &Samples) -> Result<Self> {
        let names = prior.names();
        let values = samples.columns(&names)?;
        ensure!(!values.is_empty(), "{}: no samples; a posterior needs runs", samples.source);
        let at = |row: &[f64], j: usize| prior.parameters()[j].coordinate(row[j]);
        let varies = |j: &usize| values.iter().any(|row| (at(row, *j) - at(&values[0], *j)).abs() > SAME);
        let varied: Vec<usize> = (0..names.len()).filter(varies).collect();
        ensure!(!varied.is_empty(), "{}: all samples have the same parameters", samples.source);
        for &j in &varied {
            for (name, row) in samples.names.iter().zip(&values) {
                ensure!(
                    (-1e-6..=1.0 + 1e-6).contains(&at(row, j)),
                    "{}: sample {name} has {} {}, outside its bounds, and others have it inside; a posterior \
                     is of one set of effects, gl-gap-attribute decides between several",
                    samples.source,
                    names[j],
                    row[j]
                );
            }
        }
        let coordinates = (0..names.len()).map(|j| at(&values[0], j)).collect();
        Ok(Self { prior: prior.clone(), varied, values: values[0].clone(), coordinates })
    }

    /// The prior of all parameters.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Positions in the prior of the parameters that vary.
    pub fn varied(&self) -> &[usize] {
        &self.varied
    }

    /// Number of parameters that vary.
    pub fn len(&self) -> usize {
        self.varied.len()
    }

    /// Whether none does.
    pub fn is_empty(&self) -> bool {
        self.varied.is_empty()
    }

    /// Coordinates of all parameters from those that vary, which come first in `x`.
    pub fn coordinates(&self, x: &[f64]) -> Vec<f64> {
        let mut coordinates = self.coordinates.clone();
        for (&j, x) in self.varied.iter().zip(x) {
            coordinates[j] = *x;
        }
        coordinates
    }

    /// Values of all parameters.
    pub fn values(&self, x: &[f64]) -> Vec<f64> {
        let mut values = self.values.clone();
        for (&j, &x) in self.varied.iter().zip(x) {
            values[j] = self.prior.parameters()[j].at_coordinate(x);
        }
        values
    }

    /// Where values of all parameters stand.
    pub fn place(&self, values: &[f64]) -> Vec<f64> {
        self.varied.iter().map(|&j| self.prior.parameters()[j].coordinate(values[j])).collect()
    }

    /// A draw of the prior from a point of the unit cube.
    pub fn quantile(&self, u: &[f64]) -> Vec<f64> {
        let draw = |(&j, &u): (&usize, &f64)| {
            let parameter = &self.prior.parameters()[j];
            if parameter.normal.is_none() {
                u
            } else {
                parameter.coordinate(parameter.quantile(u)).clamp(0.0, 1.0)
            }
        };
        self.varied.iter().zip(u).map(draw).collect()
    }

    /// ln of the prior's density; −∞ outside the bounds.
    pub fn ln_prior(&self, x: &[f64]) -> f64 {
        self.varied.iter().zip(x).map(|(&j, &x)| self.prior.parameters()[j].ln_density(x)).sum()
    }
}
