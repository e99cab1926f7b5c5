//! A simulation in closed form, for tests: straight in its parameters.

use nalgebra::{DMatrix, DVector};

use crate::attribute::attribution::{Explanation, attribute};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use crate::attribute::problem::predictor::{Predicted, Predictor};
use gl_inference::observations::Observations;
use gl_inference::prior::{Parameter, Prior, Scale};
use gl_inference::rig::Kind;

/// Curves a + b x, and an effect c sin(6x), x from 0 to 1: as components, exactly.
pub struct Straight {
    basis: DMatrix<f64>,
    left_over: Vec<f64>,
    variance: f64,
    /// From this b on; below it all is known.
    unsure_from: f64,
    scatter: Vec<f64>,
}

pub const STEPS: usize = 30;

fn x(step: usize) -> f64 {
    step as f64 / (STEPS - 1) as f64
}

impl Straight {
    pub fn new() -> Self {
        Self::unsure(0.0)
    }

    /// Known to this variance of each component.
    pub fn unsure(variance: f64) -> Self {
        let basis = DMatrix::from_fn(STEPS, 3, |t, i| [1.0, x(t), (6.0 * x(t)).sin()][i]);
        let unsure_from = f64::NEG_INFINITY;
        Self { basis, left_over: vec![0.0; STEPS], variance, unsure_from, scatter: vec![0.0; 3] }
    }

    /// Known to this variance of each component from this b on, and exactly below it.
    pub fn unsure_from(b: f64, variance: f64) -> Self {
        Self { unsure_from: b, ..Self::unsure(variance) }
    }

    /// Of which a scatters with this variance from run to run.
    pub fn scattering(variance: f64) -> Self {
        Self { scatter: vec![variance, 0.0, 0.0], ..Self::new() }
    }

    /// Parameters a, b and the effect's c, normal with mean 1 and sd 0.5 (c: mean 0, sd 1).
    pub fn prior() -> Prior {
        let parameter = |name: &str, mean: f64, sd: f64, effect: Option<&str>| Parameter {
            name: name.to_owned(),
            lower: mean - 8.0 * sd,
            upper: mean + 8.0 * sd,
            scale: Scale::Linear,
            normal: Some((mean, sd)),
            effect: effect.map(str::to_owned),
            off: effect.map(|_| 0.0),
            unit: None,
        };
        Prior::new(vec![
            parameter("a", 1.0, 0.5, None),
            parameter("b", 1.0, 0.5, None),
            parameter("c", 0.0, 1.0, Some("wave")),
        ])
    }

    /// The same, a between -3 and 5 (a normal prior has no bounds that were believed), and where it was believed
    /// to be: between `low` and `high`.
    pub fn beyond(low: f64, high: f64) -> (Prior, Prior) {
        let mut wide = Self::prior().parameters().to_vec();
        wide[0].normal = None;
        let mut believed = wide.clone();
        (believed[0].lower, believed[0].upper) = (low, high);
        (Prior::new(wide), Prior::new(believed))
    }

    pub fn curve(a: f64, b: f64, c: f64) -> Vec<f64> {
        (0..STEPS).map(|t| a + b * x(t) + c * (6.0 * x(t)).sin()).collect()
    }

    /// The curve with errors of this standard deviation that are the same at every call.
    pub fn measured(a: f64, b: f64, c: f64, sd: f64) -> Observations {
        // 13 values that are evenly apart, in an order in which none tells of the next ones.
        const WHITE: [f64; 13] = [2.0, -2.0, 6.0, 0.0, 3.0, 1.0, -5.0, 4.0, 5.0, -3.0, -6.0, -1.0, -4.0];
        let error = |t: usize| sd * WHITE[t % 13] / 14.0_f64.sqrt();
        Self::observations(Self::curve(a, b, c).into_iter().enumerate().map(|(t, y)| y + error(t)).collect())
    }

    /// The effect, and an offset of the sensor.
    pub fn candidates() -> Vec<Candidate> {
        let offset = MeasurementEffect::all(&[Kind::Offset], &["y".to_owned()]).remove(0);
        vec![Candidate::Simulated(Self::prior().effects().remove(0)), Candidate::Measured(offset)]
    }

    /// What a measurement asks of it, with both candidates and a noise of 0.01.
    pub fn problem<'a>(&'a self, prior: &'a Prior, observations: &Observations) -> Problem<'a> {
        let noise = Some(vec![vec![0.01; STEPS]]);
        Problem::new(self, prior, Self::candidates(), observations, noise, 1.0).unwrap()
    }

    pub fn observations(values: Vec<f64>) -> Observations {
        Observations {
            source: "obs.txt".to_owned(),
            control_name: "x".to_owned(),
            control: (0..STEPS).map(x).collect(),
            names: vec!["y".to_owned()],
            values: vec![values],
            far_off: Vec::new(),
            sd: vec![None],
        }
    }
}

impl Predictor for Straight {
    fn readings(&self) -> usize {
        STEPS
    }

    fn curve(&self, components: &[f64]) -> Vec<f64> {
        (&self.basis * DVector::from_column_slice(components)).as_slice().to_vec()
    }

    fn basis(&self) -> &DMatrix<f64> {
        &self.basis
    }

    fn left_over(&self) -> &[f64] {
        &self.left_over
    }

    fn scatter(&self) -> Vec<f64> {
        self.scatter.clone()
    }

    fn predict(&self, point: &[f64]) -> Predicted {
        let value = |i: usize, mean: f64, sd: f64| mean + sd * (16.0 * point[i] - 8.0);
        let mean = vec![value(0, 1.0, 0.5), value(1, 1.0, 0.5), value(2, 0.0, 1.0)];
        let variance = if mean[1] < self.unsure_from { 0.0 } else { self.variance };
        Predicted { mean, variance: vec![variance; 3] }
    }
}

/// What is found of a measurement with this noise.
pub fn found(values: Vec<f64>, noise: f64) -> Vec<Explanation> {
    let (predictor, prior) = (Straight::new(), Straight::prior());
    let observations = Straight::observations(values);
    let noise = Some(vec![vec![noise; STEPS]]);
    let problem =
        Problem::new(&predictor, &prior, Straight::candidates(), &observations, noise, 1.0).unwrap();
    attribute(&problem, 1, 1).unwrap().explanations
}

/// Hypotheses by name as likely as that, of which nothing else is known yet.
pub fn as_likely<const N: usize>(likely: [(&str, f64); N]) -> [Explanation; N] {
    let all = found(Straight::curve(1.3, 0.6, 0.8), 0.01);
    likely.map(|(name, probability)| {
        let of = all.iter().find(|of| of.name == name).unwrap().clone();
        let ln_weight = probability.max(1e-4).ln();
        Explanation { probability, ln_weight, fits: None, closes: 0.0, is_vague: false, ..of }
    })
}
