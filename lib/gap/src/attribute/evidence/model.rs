//! One hypothesis as a statistical model: parameters that are standard normal beforehand, and the
//! density of the measurement given them.

use std::sync::Arc;

use anyhow::Result;
use nalgebra::{DMatrix, DVector};

use crate::attribute::evidence::jumps;
use crate::attribute::problem::discrepancy::{LONGEST, SHORTEST};
use crate::attribute::problem::gaussian::{Filled, Patterns};
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use crate::attribute::problem::predictor::Predicted;
use crate::attribute::problem::{Nuisances, Problem, Unknown};
use gl_inference::prior::{normal_cdf, normal_quantile};

/// A hypothesis: the base model, the candidates that are in, and perhaps something unknown: a rest.
///
/// Its parameters `w` are the normal scores of the prior: parameters of the simulation, sizes of
/// effects of the measurement, then for each observable the scale of its noise and the correlation of it,
/// then, with a rest, its amplitude for each observable, its length, and the size of the errors of the effects' form.
/// All but the first two, the nuisances, change the covariance only.
#[derive(Clone)]
pub struct Model<'a> {
    problem: &'a Problem<'a>,
    /// Parameters of the prior that vary.
    free: Vec<usize>,
    measured: Vec<&'a MeasurementEffect>,
    /// The point in coordinates, with every effect that is out at `off`.
    off: Vec<f64>,
    has_rest: bool,
    /// Whether the form of the effects may be another.
    has_form: bool,
    /// What stands out of its noise and its rest.
    singular: Singular,
    /// Patterns that only this model has in its covariance.
    own: Option<Arc<Patterns>>,
    /// Whether the emulator's mean is taken for the simulation.
    is_sure: bool,
}

/// What neither an even noise nor a smooth rest has, in readings, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Singular {
    /// Those that are far off by themselves.
    pub outliers: Vec<usize>,
    /// Those from which on a rest has jumped in their observable.
    pub jumps: Vec<usize>,
}

impl Singular {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.outliers.is_empty() && self.jumps.is_empty()
    }
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

/// Standard deviation of the logarithm of a noise about the one that is stated: repeatability was measured once,
/// on another day, or is a maker's word.
pub const SD_OF_LN_NOISE: f64 = 0.5;

/// Largest correlation of the noise from one step to the next.
const HIGHEST_PHI: f64 = 0.95;

/// Where there is no correlation to speak of.
const WHITE: f64 = -8.0;

/// Smallest amplitude of a rest in noise and scatter; the largest is the range.
const SMALLEST_AMPLITUDE: f64 = 0.1;

/// Smallest and largest error of an effect's form, as shares of what it adds to the curve.
const FORM: (f64, f64) = (0.02, 0.5);

/// How many standard deviations off a reading must be to be tried as one that is far off.
const OUTLYING: f64 = 3.5;

/// Probability beforehand of a reading to be far off.
const OUTLIER: f64 = 0.01;

impl<'a> Model<'a> {
    /// The model of a hypothesis, with a rest or without.
    pub fn new(problem: &'a Problem<'a>, hypothesis: &[usize], has_rest: bool) -> Self {
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
        measured.sort_by_key(|effect: &&MeasurementEffect| effect.kind);
        let off = parameters.iter().map(|p| p.off.map_or(0.5, |off| p.coordinate(off))).collect();
        let has_form = has_rest && !hypothesis.is_empty();
        let mut model = Self {
            problem,
            free,
            measured,
            off,
            has_rest,
            has_form,
            singular: Singular::default(),
            own: None,
            is_sure: false,
        };
        if has_form {
            model.set_form(&vec![0.0; problem.observed.len()], Singular::default());
        }
        model
    }

    /// Take the form of the effects to err in proportion to what they add to the curve, shape (observables ·
    /// steps), where there is a rest; and readings to be far off, or to begin a jump.
    pub fn set_form(&mut self, added: &[f64], singular: Singular) {
        let added = self.has_form.then_some(added);
        let is_plain = added.is_none() && singular.is_empty();
        self.own = (!is_plain).then(|| Arc::new(self.problem.patterns_with(added, &singular)));
        self.singular = singular;
    }

    /// What the effects add to the curve, shape (observables · steps).
    pub fn added(&self, w: &[f64]) -> Vec<f64> {
        let base = self.problem.prior.base();
        let mut without = self.point(w);
        for &j in self.free.iter().filter(|j| !base.contains(j)) {
            without[j] = self.off[j];
        }
        let off = self.simulated(&without);
        self.mean(w).iter().zip(&off).map(|(on, off)| on - off).collect()
    }

    /// Readings that are taken to be far off, and those from which on its rest has jumped.
    pub fn singular(&self) -> &Singular {
        &self.singular
    }

    /// Whether something unknown is at work, too.
    pub fn has_rest(&self) -> bool {
        self.has_rest
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
        let of_rest = if self.has_rest { self.problem.ranges.len() + 1 } else { 0 };
        self.without_rest() + of_rest + usize::from(self.has_form)
    }

    /// Number of parameters of the same hypothesis without a rest, which come first.
    pub fn without_rest(&self) -> usize {
        self.curve_parameters() + 2 * self.problem.ranges.len()
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

    /// Parameters to start from: those of another model where they mean the same, 0 elsewhere.
    pub fn start_from(&self, other: &Self, w: &[f64]) -> Vec<f64> {
        let theirs = other.meanings();
        let same = |meaning: &Meaning<'a>| theirs.iter().position(|other| other == meaning);
        let mut start: Vec<f64> =
            self.meanings().iter().map(|meaning| same(meaning).map_or(0.0, |i| w[i])).collect();
        start.extend(&w[other.curve_parameters()..other.without_rest()]);
        if self.has_rest && other.has_rest {
            start.extend(&w[other.without_rest()..]);
        }
        start.resize(self.len(), 0.0);
        start
    }

    /// The same hypothesis without a rest.
    pub fn plain(&self) -> Self {
        let mut plain = self.clone();
        (plain.has_rest, plain.has_form) = (false, false);
        plain.set_form(&[], Singular { outliers: self.singular.outliers.clone(), jumps: Vec::new() });
        plain
    }

    /// The same as if the emulator knew the simulation: its mean is taken for it.
    pub fn sure(&self) -> Self {
        Self { is_sure: true, ..self.clone() }
    }

    /// The problem that it belongs to.
    pub fn problem(&self) -> &'a Problem<'a> {
        self.problem
    }

    /// The point in coordinates of the simulation.
    pub fn point(&self, w: &[f64]) -> Vec<f64> {
        let mut point = self.off.clone();
        for (&j, &w) in self.free.iter().zip(w) {
            let parameter = &self.problem.prior.parameters()[j];
            point[j] = match (self.problem.beliefs[j], parameter.normal) {
                (Some(belief), _) => belief.coordinate(normal_cdf(w)),
                (None, None) => normal_cdf(w),
                (None, Some(_)) => parameter.coordinate(parameter.quantile(normal_cdf(w))),
            };
        }
        point
    }

    /// Values of all parameters of the simulation, shape (parameters of the prior,).
    pub fn values(&self, w: &[f64]) -> Vec<f64> {
        let mut values = self.problem.prior.with_effects_off();
        let point = self.point(w);
        for &j in &self.free {
            values[j] = self.problem.prior.parameters()[j].at_coordinate(point[j]);
        }
        values
    }

    /// What the simulation and the measurement make of the parameters.
    pub fn curve(&self, w: &[f64]) -> Curve {
        let predictor = self.problem.predictor;
        if self.is_sure {
            let variance = vec![0.0; predictor.basis().ncols()];
            return Curve { mean: self.mean(w), variance };
        }
        let Predicted { mean, variance } = predictor.predict(&self.point(w));
        Curve { mean: self.measure(predictor.curve(&mean), w), variance }
    }

    /// Variance of each component at several parameters, shape (points, components).
    pub fn variances(&self, points: &[Vec<f64>]) -> Vec<Vec<f64>> {
        if self.is_sure {
            return vec![vec![0.0; self.problem.predictor.basis().ncols()]; points.len()];
        }
        let points: Vec<Vec<f64>> = points.iter().map(|w| self.point(w)).collect();
        let all = self.problem.predictor.predict_all(&points);
        all.into_iter().map(|Predicted { variance, .. }| variance).collect()
    }

    /// The predicted measurement without its variance, shape (observables · steps).
    pub fn mean(&self, w: &[f64]) -> Vec<f64> {
        self.measured_at(&self.point(w), w)
    }

    /// The predicted measurement at a point of the simulation, with the effects of the measurement as at `w`,
    /// shape (observables · steps).
    pub fn measured_at(&self, point: &[f64], w: &[f64]) -> Vec<f64> {
        self.measure(self.simulated(point), w)
    }

    fn simulated(&self, point: &[f64]) -> Vec<f64> {
        self.problem.predictor.curve(&self.problem.predictor.mean(point))
    }

    fn measure(&self, mut curve: Vec<f64>, w: &[f64]) -> Vec<f64> {
        for (effect, &w) in self.measured.iter().zip(&w[self.free.len()..]) {
            self.problem.apply(effect, effect.size(w), &mut curve);
        }
        curve
    }

    /// Derivative of the curve by the parameters that move it, shape (readings, curve parameters),
    /// and the curve itself.
    pub fn gradient(&self, w: &[f64]) -> (Vec<f64>, DMatrix<f64>) {
        const STEP: f64 = 1e-4;
        let predictor = self.problem.predictor;
        let point = self.point(w);
        let simulated = predictor.curve(&predictor.mean(&point));
        let by_coordinate = predictor.gradient(&point);
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

    /// The parameters with the noise as it is stated, white, where it is; as they are where it is not.
    pub fn as_stated(&self, w: &[f64]) -> Vec<f64> {
        let mut stated = w.to_vec();
        if self.problem.is_noise_stated {
            let (scales, rest) = stated[self.curve_parameters()..].split_at_mut(self.problem.ranges.len());
            scales.fill(0.0);
            rest[..scales.len()].fill(WHITE);
        }
        stated
    }

    /// The parameters with a noise of this share of what it is.
    pub fn with_noise(&self, w: &[f64], share: f64) -> Vec<f64> {
        let mut scaled = w.to_vec();
        let first = self.curve_parameters();
        for w in &mut scaled[first..first + self.problem.ranges.len()] {
            *w = if self.problem.is_noise_stated {
                *w + share.ln() / SD_OF_LN_NOISE
            } else {
                let (low, high) = LN_NOISE;
                let place = normal_cdf(*w) + share.ln() / (high - low);
                normal_quantile(place.clamp(f64::EPSILON, 1.0 - f64::EPSILON))
            };
        }
        scaled
    }

    /// What changes the covariance.
    pub fn nuisances(&self, w: &[f64]) -> Nuisances {
        let between = |(low, high): (f64, f64), w: f64| (low + (high - low) * normal_cdf(w)).exp();
        let observables = self.problem.ranges.len();
        let (scales, rest) = w[self.curve_parameters()..].split_at(observables);
        let (phi, rest) = rest.split_at(observables);
        let scale = |w: &f64| {
            if self.problem.is_noise_stated { (SD_OF_LN_NOISE * w).exp() } else { between(LN_NOISE, *w) }
        };
        let scales: Vec<f64> = scales.iter().map(scale).collect();
        // Mostly small: above a half in one of ten cases.
        let phi = phi.iter().map(|w| HIGHEST_PHI * normal_cdf(1.2 * w - 1.5)).collect();
        let of_rest = || {
            let amplitude = |(j, &w): (usize, &f64)| {
                let largest = (self.problem.ranges[j] / self.problem.spread(j, &scales)).max(20.0);
                between((SMALLEST_AMPLITUDE.ln(), largest.ln()), w)
            };
            let amplitudes = rest[..observables].iter().enumerate().map(amplitude).collect();
            Unknown { amplitudes, length: between((SHORTEST.ln(), LONGEST.ln()), rest[observables]) }
        };
        let unknown = self.has_rest.then(of_rest);
        let form = self.has_form.then(|| between((FORM.0.ln(), FORM.1.ln()), rest[observables + 1]));
        Nuisances { scales, phi, rest: unknown, form }
    }

    /// Use the covariance of the measurement about a curve.
    ///
    /// # Errors
    /// If it is not finite.
    pub fn with_covariance<T>(
        &self,
        w: &[f64],
        component_variance: &[f64],
        visit: impl FnOnce(&Filled<'_>) -> T,
    ) -> Result<T> {
        let more = self.own.as_ref().map(|own| (own.as_ref(), &self.singular));
        self.problem.with_covariance(&self.nuisances(w), component_variance, more, visit)
    }

    /// What the measurement has more than a curve, shape (readings,).
    pub fn residual(&self, curve: &[f64]) -> Vec<f64> {
        self.problem.observed.iter().zip(curve).map(|(seen, y)| seen - y).collect()
    }

    /// ln N(measurement; curve, Σ), with the odds of the readings that are far off to be so, and of jumps; −∞ where
    /// the covariance is not finite.
    pub fn ln_likelihood(&self, w: &[f64], curve: &Curve) -> f64 {
        let residual = self.residual(&curve.mean);
        self.with_covariance(w, &curve.variance, |covariance| covariance.ln_density(&residual))
            .ok()
            .filter(|value| value.is_finite())
            .map_or(f64::NEG_INFINITY, |value| value + self.ln_singular_odds())
    }

    /// ln odds beforehand of all that is singular.
    fn ln_singular_odds(&self) -> f64 {
        let Singular { outliers, jumps } = &self.singular;
        outliers.len() as f64 * ln_odds(OUTLIER) + jumps::ln_odds_of(self.problem, jumps)
    }

    /// Readings that are further from what all others say of them than most are, furthest first: more than
    /// [`OUTLYING`] times as far as half of those of the observable are at the least, made consistent for normal
    /// noise. Two that are far off make the noise seem large, by which neither is; the median sees neither.
    pub fn far_off(&self, w: &[f64], curve: &Curve) -> Vec<usize> {
        let residual = DMatrix::from_vec(curve.mean.len(), 1, self.residual(&curve.mean));
        let scores = self.with_covariance(w, &curve.variance, |covariance| {
            let precise = covariance.solve(&residual);
            let score = |(z, precision): (&f64, f64)| z.abs() / precision.sqrt();
            precise.iter().zip(covariance.precisions()).map(score).collect::<Vec<f64>>()
        });
        let scores = scores.unwrap_or_default();
        let mut far: Vec<usize> = Vec::new();
        for block in self.problem.blocks().into_iter().filter(|_| !scores.is_empty()) {
            let own = &scores[block.clone()];
            let mut sorted = own.to_vec();
            sorted.sort_by(f64::total_cmp);
            let unit = 1.4826 * sorted[sorted.len() / 2];
            far.extend(block.filter(|&i| scores[i] > OUTLYING * unit));
        }
        far.retain(|i| !self.singular.outliers.contains(i));
        far.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]));
        far
    }

    /// Those of the readings that are taken to be far off which stand three or more in a row.
    pub fn outliers_in_a_row(&self) -> Vec<usize> {
        let blocks = self.problem.blocks();
        let in_a_row = blocks.iter().flat_map(|block| {
            let outliers = self.singular.outliers.iter().copied();
            let own: Vec<usize> = outliers.filter(|i| block.contains(i)).collect();
            let rows: Vec<Vec<usize>> = own.chunk_by(|a, b| a + 1 == *b).map(<[usize]>::to_vec).collect();
            rows.into_iter().filter(|row| row.len() >= ROW).flatten()
        });
        in_a_row.collect()
    }
}

/// As many readings in a row that are far off are a signal: of single ones so many seldom meet.
const ROW: usize = 3;

/// ln odds of a probability.
pub fn ln_odds(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// ln of the standard normal density, shape (parameters,).
pub fn ln_prior(w: &[f64]) -> f64 {
    -0.5 * w.iter().map(|w| w * w + std::f64::consts::TAU.ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    #[test]
    fn a_share_of_the_noise_is_taken_of_one_that_is_stated_and_of_one_that_is_not() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.0, 0.05);
        for noise in [None, Some(vec![vec![0.05; STEPS]])] {
            let problem =
                Problem::new(&predictor, &prior, Straight::candidates(), &observations, noise, 1.0).unwrap();
            let model = Model::new(&problem, &[], false);
            let w = vec![0.3; model.len()];
            let scale = |w: &[f64]| model.nuisances(w).scales[0];
            assert!((scale(&model.with_noise(&w, 0.5)) / scale(&w) - 0.5).abs() < 1e-6);
        }
    }
}
