//! Whether a posterior through an emulator is settled, and proven by runs that were predicted.

use gl_numeric::statistics::{mean, sd};

use super::Inference;

/// What is asked of a posterior before a calibration stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Of [`Inference::ignorance`].
    pub ignorance: f64,
    /// Of the change of a mean since the batch before, in standard deviations.
    pub shift: f64,
    /// Of the change of a standard deviation since the batch before, as |ln ratio|.
    pub spread: f64,
    /// Of the errors of the newest batch in standard deviations of what was predicted.
    pub z: f64,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self { ignorance: 0.5, shift: 0.3, spread: 0.2, z: 1.6 }
    }
}

/// Probability below which the newest batch is not as it was predicted.
const UNLIKELY: f64 = 0.01;

/// One thing that is asked, and what the answer is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Criterion {
    /// Its name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// What it has to come down to.
    pub tolerance: f64,
    /// Whether it has.
    pub is_met: bool,
}

/// The moments of a posterior, by parameter that varies.
#[derive(Clone, Debug, PartialEq)]
pub struct Moments {
    /// Means in coordinates.
    pub mean: Vec<f64>,
    /// Standard deviations in coordinates.
    pub sd: Vec<f64>,
}

impl Moments {
    /// Those of the draws.
    pub fn new(inference: &Inference) -> Self {
        let weights = vec![1.0 / inference.points.len() as f64; inference.points.len()];
        let columns: Vec<Vec<f64>> = (0..inference.space.len())
            .map(|j| inference.points.iter().map(|x| x[j]).collect())
            .collect();
        Self {
            mean: columns.iter().map(|column| mean(column, &weights)).collect(),
            sd: columns.iter().map(|column| sd(column, &weights)).collect(),
        }
    }
}

/// What is asked before a calibration stops; it may stop where all are met.
///
/// * `before` — moments after the batch before; nothing after the first.
pub fn criteria(inference: &Inference, before: Option<&Moments>, tolerances: &Tolerances) -> Vec<Criterion> {
    let below = |name, value: f64, tolerance| Criterion { name, value, tolerance, is_met: value <= tolerance };
    let mut criteria = vec![below("ignorance", inference.ignorance, tolerances.ignorance)];
    let now = Moments::new(inference);
    let (mut shift, mut spread) = (f64::INFINITY, f64::INFINITY);
    if let Some(before) = before {
        (shift, spread) = (0.0, 0.0);
        for j in 0..now.mean.len() {
            let wider = now.sd[j].max(before.sd[j]).max(f64::MIN_POSITIVE);
            shift = f64::max(shift, (now.mean[j] - before.mean[j]).abs() / wider);
            spread = f64::max(spread, (now.sd[j] / before.sd[j].max(f64::MIN_POSITIVE)).ln().abs());
        }
    }
    criteria.push(below("shift", shift, tolerances.shift));
    criteria.push(below("spread", spread, tolerances.spread));
    let (z, is_proven) = match inference.proof {
        None => (f64::INFINITY, false),
        Some(proof) => (proof.z, proof.z <= tolerances.z || proof.p >= UNLIKELY),
    };
    criteria.push(Criterion { name: "proof", value: z, tolerance: tolerances.z, is_met: is_proven });
    criteria
}

/// Runs of the first design, for so many parameters.
pub fn first_design(parameters: usize) -> usize {
    (5 * parameters).max(8)
}

/// Runs of a batch, for so many parameters.
pub fn batch_size(parameters: usize) -> usize {
    match parameters {
        0..=2 => 4,
        3..=4 => 6,
        5..=6 => 8,
        _ => 12,
    }
}
