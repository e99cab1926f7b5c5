//! One hypothesis as a statistical model: parameters that are standard normal beforehand, and the
//! density of the measurement given them.

use anyhow::Result;
use nalgebra::{DMatrix, DVector};

use crate::attribute::hypothesis::Candidate;
use crate::attribute::measurement::MeasurementEffect;
use crate::attribute::predictor::Prediction;
use crate::attribute::problem::Problem;
use gl_inference::prior::normal_cdf;

/// A hypothesis: the base model, the candidates that are in, and perhaps a discrepancy.
///
/// Its parameters `w` are the normal scores of the prior: parameters of the simulation, sizes of
/// effects of the measurement, then noises where they are estimated, then amplitudes of the
/// discrepancy. The last two, the nuisances, change the covariance only.
pub struct Model<'a> {
    problem: &'a Problem<'a>,
    /// Parameters of the prior that vary.
    free: Vec<usize>,
    measured: Vec<&'a MeasurementEffect>,
    /// The point in coordinates, with every effect that is out at `off`.
    rest: Vec<f64>,
    discrepancy: bool,
}

/// What a curve parameter stands for: a parameter of the prior, or an effect of the measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum Meaning<'a> {
    /// Its position in the prior.
    Parameter(usize),
    /// The effect whose size it is.
    Size(&'a MeasurementEffect),
}

/// The expensive half of a likelihood: what the simulation gives.
#[derive(Clone, Debug)]
pub struct Curve {
    /// The predicted measurement, shape (observables · steps).
    pub mean: Vec<f64>,
    /// Variance of each component.
    pub variance: Vec<f64>,
}

/// Natural logarithms of the smallest and the largest noise, as shares of the range, when it is
/// estimated: even in the logarithm between them (Jeffreys).
const LN_NOISE: (f64, f64) = (-9.21, -0.69);

/// Smallest amplitude of a discrepancy in noise and scatter; the largest is the range.
const SMALLEST_AMPLITUDE: f64 = 0.1;

impl<'a> Model<'a> {
    /// The model of a hypothesis, with a discrepancy or without.
    pub fn new(problem: &'a Problem<'a>, hypothesis: &[usize], discrepancy: bool) -> Self {
        let parameters = problem.prior.parameters();
        let mut free = problem.prior.base();
        let mut measured = Vec::new();
        for &candidate in hypothesis {
            match &problem.candidates[candidate] {
                Candidate::Simulated(effect) => free.extend(&effect.parameters),
                Candidate::Measured(effect) => measured.push(effect),
            }
        }
        // The control is moved first, readings last: that is the order in the rig.
        measured.sort_by_key(|effect| match effect.kind {
            crate::attribute::measurement::Kind::Compliance => 0,
            crate::attribute::measurement::Kind::Lag => 1,
            crate::attribute::measurement::Kind::Gain => 2,
            _ => 3,
        });
        let rest = parameters.iter().map(|p| p.off.map_or(0.5, |off| p.coordinate(off))).collect();
        Self { problem, free, measured, rest, discrepancy }
    }

    /// Positions in the prior of the simulation's parameters that vary; they come first.
    pub fn simulated_parameters(&self) -> &[usize] {
        &self.free
    }

    /// Number of parameters that move the curve.
    pub fn curve_parameters(&self) -> usize {
        self.free.len() + self.measured.len()
    }

    /// Number of all parameters.
    pub fn len(&self) -> usize {
        self.curve_parameters() + self.noises() + if self.discrepancy { self.problem.ranges.len() } else { 0 }
    }

    /// Whether nothing varies.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What each curve parameter stands for.
    pub fn meanings(&self) -> Vec<Meaning<'a>> {
        let parameters = self.free.iter().map(|&j| Meaning::Parameter(j));
        parameters.chain(self.measured.iter().map(|effect| Meaning::Size(effect))).collect()
    }

    /// Curve parameters to start from: those of another model where they mean the same, 0 elsewhere.
    pub fn start_from(&self, other: &Self, w: &[f64]) -> Vec<f64> {
        let theirs = other.meanings();
        let same = |meaning: &Meaning<'a>| theirs.iter().position(|other| other == meaning);
        self.meanings().iter().map(|meaning| same(meaning).map_or(0.0, |i| w[i])).collect()
    }

    /// The problem that it belongs to.
    pub fn problem(&self) -> &'a Problem<'a> {
        self.problem
    }

    fn noises(&self) -> usize {
        if self.problem.noise.is_none() { self.problem.ranges.len() } else { 0 }
    }

    /// The point in coordinates of the simulation.
    pub fn point(&self, w: &[f64]) -> Vec<f64> {
        let mut point = self.rest.clone();
        for (&j, &w) in self.free.iter().zip(w) {
            let parameter = &self.problem.prior.parameters()[j];
            point[j] = match parameter.normal {
                None => normal_cdf(w),
                Some(_) => parameter.coordinate(parameter.quantile(normal_cdf(w))),
            };
        }
        point
    }

    /// What the simulation and the measurement make of the parameters.
    pub fn curve(&self, w: &[f64]) -> Curve {
        let Prediction { mean, variance } = self.problem.predictor.predict(&self.point(w));
        Curve { mean: self.measure(self.simulated(&mean), w), variance }
    }

    /// The predicted measurement without its variance, shape (observables · steps).
    pub fn mean(&self, w: &[f64]) -> Vec<f64> {
        self.measure(self.simulated(&self.problem.predictor.mean(&self.point(w))), w)
    }

    fn simulated(&self, components: &[f64]) -> Vec<f64> {
        let predictor = self.problem.predictor;
        let mut curve = predictor.centre().to_vec();
        for (pattern, &component) in predictor.basis().column_iter().zip(components) {
            for (y, p) in curve.iter_mut().zip(pattern.iter()) {
                *y += component * p;
            }
        }
        curve
    }

    fn measure(&self, mut curve: Vec<f64>, w: &[f64]) -> Vec<f64> {
        for (effect, &w) in self.measured.iter().zip(&w[self.free.len()..]) {
            effect.apply(effect.size(w), &self.problem.path, &self.problem.ranges, &mut curve);
        }
        curve
    }

    /// Derivative of the curve by the parameters that move it, shape (readings, curve parameters),
    /// and the curve itself.
    pub fn gradient(&self, w: &[f64]) -> (Vec<f64>, DMatrix<f64>) {
        const STEP: f64 = 1e-4;
        let predictor = self.problem.predictor;
        let point = self.point(w);
        let simulated = self.simulated(&predictor.mean(&point));
        let by_coordinate = predictor.basis() * predictor.gradient(&point);
        let mut gradient = DMatrix::zeros(simulated.len(), self.curve_parameters());
        let mut moved = w.to_vec();
        for (column, &j) in self.free.iter().enumerate() {
            moved[column] = w[column] + STEP;
            let above = self.point(&moved)[j];
            moved[column] = w[column] - STEP;
            let below = self.point(&moved)[j];
            moved[column] = w[column];
            let slope = by_coordinate.column(j) * ((above - below) / (2.0 * STEP));
            if self.measured.is_empty() {
                gradient.set_column(column, &slope);
                continue;
            }
            let shifted = |sign: f64| {
                let curve = simulated.iter().zip(slope.iter()).map(|(y, s)| y + sign * STEP * s).collect();
                DVector::from_vec(self.measure(curve, w))
            };
            gradient.set_column(column, &((shifted(1.0) - shifted(-1.0)) / (2.0 * STEP)));
        }
        for column in self.free.len()..self.curve_parameters() {
            moved[column] = w[column] + STEP;
            let above = DVector::from_vec(self.measure(simulated.clone(), &moved));
            moved[column] = w[column] - STEP;
            let below = DVector::from_vec(self.measure(simulated.clone(), &moved));
            moved[column] = w[column];
            gradient.set_column(column, &((above - below) / (2.0 * STEP)));
        }
        (self.measure(simulated, w), gradient)
    }

    /// Noises as shares of the ranges where they are estimated, and amplitudes of the discrepancy in
    /// noise and scatter.
    pub fn nuisances(&self, w: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let between = |(low, high): (f64, f64), w: f64| (low + (high - low) * normal_cdf(w)).exp();
        let (noise, amplitude) = w[self.curve_parameters()..].split_at(self.noises());
        let noise: Vec<f64> = noise.iter().map(|&w| between(LN_NOISE, w)).collect();
        let amplitudes = amplitude
            .iter()
            .enumerate()
            .map(|(j, &w)| {
                let largest = (self.problem.ranges[j] / self.problem.spread(j, &noise)).max(20.0);
                between((SMALLEST_AMPLITUDE.ln(), largest.ln()), w)
            })
            .collect();
        (noise, amplitudes)
    }

    /// Use the covariance of the measurement about a curve.
    ///
    /// # Errors
    /// If it is not finite.
    pub fn with_covariance<T>(
        &self,
        w: &[f64],
        component_variance: &[f64],
        visit: impl FnOnce(&crate::attribute::gaussian::Filled<'_>) -> T,
    ) -> Result<T> {
        let (noise, amplitudes) = self.nuisances(w);
        self.problem.with_covariance(&noise, &amplitudes, component_variance, visit)
    }

    /// What the measurement has more than a curve, shape (readings,).
    pub fn residual(&self, curve: &[f64]) -> Vec<f64> {
        self.problem.observed.iter().zip(curve).map(|(seen, y)| seen - y).collect()
    }

    /// ln N(measurement; curve, Σ); −∞ where the covariance is not finite.
    pub fn ln_likelihood(&self, w: &[f64], curve: &Curve) -> f64 {
        let residual = self.residual(&curve.mean);
        self.with_covariance(w, &curve.variance, |covariance| covariance.ln_density(&residual))
            .ok()
            .filter(|value| value.is_finite())
            .unwrap_or(f64::NEG_INFINITY)
    }
}

/// ln of the standard normal density, shape (parameters,).
pub fn ln_prior(w: &[f64]) -> f64 {
    -0.5 * w.iter().map(|w| w * w + std::f64::consts::TAU.ln()).sum::<f64>()
}
