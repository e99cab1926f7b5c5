//! The evidence of a hypothesis: adaptive multiple importance sampling from its modes.
//!
//! A [`model`] is the parameters of one hypothesis and the density of the measurement given them; [`mode`] climbs to the most
//! probable ones, from where this module integrates, with what the emulator does not know there by [`ignorance`].
//! [`adequacy`] says whether the hypothesis fits at all, and [`descent`] calibrates its parameters again, within other bounds or
//! by another covariance.

pub mod adequacy;
pub mod descent;
pub mod ignorance;
pub mod jumps;
pub mod mode;
pub mod model;

use anyhow::{Result, ensure};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::attribute::evidence::ignorance::Ignorance;
use crate::attribute::evidence::mode::{Mode, standard_normal};
use crate::attribute::evidence::model::{Curve, Model, ln_prior};
use gl_numeric::statistics::{effective_size, ln_sum_exp, moments, normalised};

/// The evidence of a hypothesis and its posterior.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// ln ∫ likelihood × prior.
    pub ln: f64,
    /// Standard error of it from the sampling.
    pub error: f64,
    /// Its modes, best first.
    pub modes: Vec<Mode>,
    /// Posterior samples of the parameters, and their weights, which sum to one.
    pub samples: Vec<Vec<f64>>,
    /// Weights of the samples.
    pub weights: Vec<f64>,
    /// Mean of the predicted measurement under the posterior, shape (observables · steps).
    pub mean: Vec<f64>,
}

/// Standard error of ln evidence to aim at where it decides.
pub const FINE: f64 = 0.07;
/// Standard error of ln evidence to aim at where a hypothesis is out of the question.
pub const COARSE: f64 = 0.3;
/// Degrees of freedom of the proposal's Student t components.
const FREEDOM: usize = 6;
/// Share of the proposal that is the prior itself.
const DEFENSIVE: f64 = 0.05;
const ROUNDS: usize = 12;
/// Samples of the one round there is where a hypothesis is out of the question.
const COARSE_SAMPLES: usize = 40;

/// Estimate the evidence of a model from its modes, to a standard error that is aimed at.
///
/// A mixture of Student t densities about the modes, and the prior, is drawn from and fitted to the
/// weighted samples in turn; all samples of all rounds count, weighted by the mixture of all their
/// proposals.
///
/// # Errors
/// If the likelihood is zero throughout.
///
/// # Source
/// Cornuet, Marin, Mira & Robert (2012), Scand. J. Stat. 39:798; Cappé et al. (2008), Stat. Comput.
/// 18:447.
pub fn evidence(model: &Model<'_>, modes: Vec<Mode>, aim: f64, random: &mut ChaCha8Rng) -> Result<Evidence> {
    let dimensions = model.len();
    let mut proposals = vec![Mixture::about(&modes)];
    let ignorance = Ignorance::about(model, &modes);
    let per_round = if aim < COARSE { 60 + 15 * dimensions } else { COARSE_SAMPLES };
    let (mut samples, mut curves): (Vec<DVector<f64>>, Vec<Curve>) = (Vec::new(), Vec::new());
    let mut ln_target = Vec::new();
    // ln Σ_rounds of the proposals' densities, sample by sample.
    let mut ln_proposed: Vec<f64> = Vec::new();
    let (mut ln, mut error) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut ln_weights = Vec::new();
    for round in 0..if aim < COARSE { ROUNDS } else { 1 } {
        let Some(latest) = proposals.last() else { break };
        for (sample, ln_q) in samples.iter().zip(&mut ln_proposed) {
            if round > 0 {
                *ln_q = ln_sum_exp(&[*ln_q, latest.ln_density(sample)]);
            }
        }
        for _ in 0..per_round {
            let w = latest.draw(random);
            let curve = ignorance.curve(model, w.as_slice());
            ln_target.push(model.ln_likelihood(w.as_slice(), &curve) + ln_prior(w.as_slice()));
            let densities: Vec<f64> = proposals.iter().map(|proposal| proposal.ln_density(&w)).collect();
            ln_proposed.push(ln_sum_exp(&densities));
            samples.push(w);
            curves.push(curve);
        }
        let rounds = (round + 1) as f64;
        ln_weights =
            ln_target.iter().zip(&ln_proposed).map(|(target, q)| target - (q - rounds.ln())).collect();
        let count = ln_weights.len() as f64;
        ln = ln_sum_exp(&ln_weights) - count.ln();
        ensure!(ln.is_finite(), "no parameters at which the measurement has a chance");
        let variance =
            ln_weights.iter().map(|weight| ((weight - ln).exp() - 1.0).powi(2)).sum::<f64>() / count;
        error = (variance / count).sqrt();
        if error < aim && (round > 0 || aim >= COARSE) {
            break;
        }
        let adapted = latest.fitted(&samples, &ln_weights)?;
        proposals.push(adapted);
    }
    let weights = normalised(&ln_weights)?;
    let mean = mean_of(curves.iter().map(|curve| curve.mean.as_slice()), &weights);
    let samples = samples.iter().map(|sample| sample.as_slice().to_vec()).collect();
    Ok(Evidence { ln, error, modes, samples, weights, mean })
}

/// A mixture of Student t densities and the standard normal prior.
struct Mixture {
    parts: Vec<Part>,
}

struct Part {
    weight: f64,
    centre: DVector<f64>,
    /// Lower factor of the scale matrix.
    factor: DMatrix<f64>,
    ln_norm: f64,
}

impl Part {
    fn new(weight: f64, centre: DVector<f64>, scale: DMatrix<f64>) -> Option<Self> {
        let factor = Cholesky::new(scale)?.unpack();
        let (d, freedom) = (centre.len() as f64, FREEDOM as f64);
        let ln_norm = statrs::function::gamma::ln_gamma(0.5 * (freedom + d))
            - statrs::function::gamma::ln_gamma(0.5 * freedom)
            - 0.5 * d * (freedom * std::f64::consts::PI).ln()
            - factor.diagonal().iter().map(|value| value.ln()).sum::<f64>();
        Some(Self { weight, centre, factor, ln_norm })
    }

    fn ln_density(&self, w: &DVector<f64>) -> f64 {
        let mut away = w - &self.centre;
        self.factor.solve_lower_triangular_mut(&mut away);
        let freedom = FREEDOM as f64;
        self.ln_norm - 0.5 * (freedom + w.len() as f64) * (away.norm_squared() / freedom).ln_1p()
    }
}

impl Mixture {
    fn about(modes: &[Mode]) -> Self {
        let heights: Vec<f64> = modes.iter().map(Mode::ln_evidence).collect();
        let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // A mode that looks small may be wide: none begins below a twentieth.
        let weights: Vec<f64> = heights.iter().map(|height| (height - high).exp().max(0.05)).collect();
        let sum: f64 = weights.iter().sum();
        let parts = modes
            .iter()
            .zip(&weights)
            .filter_map(|(mode, weight)| Part::new(weight / sum, mode.w.clone(), &mode.covariance * 1.3))
            .collect();
        Self { parts }
    }

    fn defensive(&self) -> f64 {
        if self.parts.is_empty() { 1.0 } else { DEFENSIVE }
    }

    fn draw(&self, random: &mut ChaCha8Rng) -> DVector<f64> {
        let u: f64 = random.random();
        let dimensions = self.parts.first().map_or(0, |part| part.centre.len());
        let normal = DVector::from_fn(dimensions, |_, _| standard_normal(random));
        let freedom: f64 = (0..FREEDOM).map(|_| standard_normal(random).powi(2)).sum();
        let mut below = self.defensive();
        if u < below {
            return normal;
        }
        let stretch = (FREEDOM as f64 / freedom).sqrt();
        let mut chosen = self.parts.last();
        for part in &self.parts {
            below += part.weight * (1.0 - self.defensive());
            if u < below {
                chosen = Some(part);
                break;
            }
        }
        match chosen {
            Some(part) => &part.centre + &part.factor * normal * stretch,
            None => normal,
        }
    }

    fn ln_density(&self, w: &DVector<f64>) -> f64 {
        let mut densities = vec![self.defensive().ln() + ln_prior(w.as_slice())];
        let rest = (1.0 - self.defensive()).ln();
        densities.extend(self.parts.iter().map(|part| rest + part.weight.ln() + part.ln_density(w)));
        ln_sum_exp(&densities)
    }

    /// One step of expectation and maximisation on weighted samples. Weights that rest on a few
    /// samples are flattened first, so that the mixture does not collapse onto them.
    fn fitted(&self, samples: &[DVector<f64>], ln_weights: &[f64]) -> Result<Self> {
        let dimensions = self.parts.first().map_or(0, |part| part.centre.len());
        let weights = flattened(ln_weights, 4.0 * dimensions as f64 + 10.0)?;
        let shares: Vec<Vec<f64>> = samples
            .iter()
            .map(|w| {
                let densities: Vec<f64> =
                    self.parts.iter().map(|part| part.weight.ln() + part.ln_density(w)).collect();
                let whole = ln_sum_exp(&densities);
                densities.iter().map(|density| (density - whole).exp()).collect()
            })
            .collect();
        let mut parts = Vec::new();
        for (k, old) in self.parts.iter().enumerate() {
            let owned: Vec<f64> =
                weights.iter().zip(&shares).map(|(weight, share)| weight * share[k]).collect();
            let weight: f64 = owned.iter().sum();
            if weight < 1e-3 {
                continue;
            }
            let owned: Vec<f64> = owned.iter().map(|owned| owned / weight).collect();
            let (centre, scale) = moments(samples, &owned);
            let old_scale = &old.factor * old.factor.transpose();
            // The t density is wider than its scale; and a little of the old shape keeps it whole.
            let scale = scale * 0.95 + old_scale * 0.05;
            if let Some(part) = Part::new(weight, centre, scale) {
                parts.push(part);
            }
        }
        let sum: f64 = parts.iter().map(|part| part.weight).sum();
        parts.iter_mut().for_each(|part| part.weight /= sum);
        Ok(Self { parts })
    }
}

/// Normalised weights, raised to the largest power ≤ 1 that leaves an effective number of samples.
fn flattened(ln_weights: &[f64], wanted: f64) -> Result<Vec<f64>> {
    let effective = |power: f64| -> Result<(f64, Vec<f64>)> {
        let powered: Vec<f64> = ln_weights.iter().map(|weight| power * weight).collect();
        let weights = normalised(&powered)?;
        Ok((effective_size(&weights), weights))
    };
    let (size, weights) = effective(1.0)?;
    if size >= wanted {
        return Ok(weights);
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if effective(middle)?.0 >= wanted { low = middle } else { high = middle }
    }
    Ok(effective(low)?.1)
}

/// The mean of curves, shape (readings,), by weights that sum to one. One without weight need not be finite: far out a curve
/// that is seen through a logarithm goes beyond all numbers.
fn mean_of<'a>(curves: impl Iterator<Item = &'a [f64]>, weights: &[f64]) -> Vec<f64> {
    let mut mean = Vec::new();
    for (curve, weight) in curves.zip(weights).filter(|(_, weight)| **weight > 0.0) {
        mean.resize(curve.len(), 0.0);
        mean.iter_mut().zip(curve).for_each(|(mean, y)| *mean += weight * y);
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    use crate::attribute::problem::{Nuisances, Problem};
    use crate::attribute::synthetic_world::{STEPS, Straight};

    /// Patterns and their standard deviations.
    type Directions = Vec<(Vec<f64>, f64)>;

    #[test]
    fn a_curve_without_weight_is_in_no_mean_whatever_it_is() {
        let curves = [[1.0, 2.0], [f64::INFINITY, f64::NAN], [3.0, 6.0]];
        assert_eq!(mean_of(curves.iter().map(<[f64; 2]>::as_slice), &[0.5, 0.0, 0.5]), [2.0, 4.0]);
    }

    /// ln N(y; mean, N + small discrepancy + rest + Σ patternᵢ sdᵢ²), the closed form at nuisances: N is
    /// autoregressive.
    fn closed_form(problem: &Problem<'_>, at: &Nuisances, mean: &[f64], patterns: &Directions) -> f64 {
        let smooth = &problem.tests[0].smooth;
        let sd = at.scales[0] * problem.units[0];
        let mut covariance =
            DMatrix::from_fn(STEPS, STEPS, |s, t| sd * sd * at.phi[0].powi(s.abs_diff(t) as i32));
        let mut variances: Vec<f64> =
            smooth.variances.iter().map(|variance| 0.15 * 0.15 * variance).collect();
        if let Some(rest) = &at.rest {
            let of_rest = smooth.variances_of(rest.length);
            let added = variances.iter_mut().zip(of_rest);
            added.for_each(|(variance, own)| *variance += rest.amplitudes[0].powi(2) * own);
        }
        for (i, variance) in variances.iter().enumerate() {
            let pattern = smooth.patterns.column(i).into_owned();
            covariance.ger(sd * sd * variance, &pattern, &pattern, 1.0);
        }
        for (pattern, sd) in patterns {
            let pattern = DVector::from_column_slice(pattern);
            covariance.ger(sd * sd, &pattern, &pattern, 1.0);
        }
        let away = DVector::from_fn(STEPS, |t, _| problem.observed[t] - mean[t]);
        let factor = Cholesky::new(covariance).unwrap();
        let ln_det = 2.0 * factor.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        -0.5 * (away.dot(&factor.solve(&away)) + ln_det + STEPS as f64 * std::f64::consts::TAU.ln())
    }

    /// The closed form averaged over the nuisances, standard normal beforehand, by the trapezium rule.
    fn averaged(model: &Model<'_>, mean: &[f64], patterns: &Directions, step: f64) -> f64 {
        let curve = model.curve_parameters();
        let dimensions = (model.len() - curve) as u32;
        let half = (4.2 / step) as i32;
        let places: Vec<f64> = (-half..=half).map(|i| step * f64::from(i)).collect();
        let count = places.len();
        let terms: Vec<f64> = (0..count.pow(dimensions))
            .map(|mut number| {
                let mut w = vec![0.0; model.len()];
                for value in &mut w[curve..] {
                    *value = places[number % count];
                    number /= count;
                }
                let ln_density = closed_form(model.problem(), &model.nuisances(&w), mean, patterns);
                ln_density + ln_prior(&w[curve..]) + f64::from(dimensions) * step.ln()
            })
            .collect();
        ln_sum_exp(&terms)
    }

    fn base() -> Directions {
        vec![(Straight::curve(1.0, 0.0, 0.0), 0.5), (Straight::curve(0.0, 1.0, 0.0), 0.5)]
    }

    fn found(model: &mut Model<'_>, seed: u64) -> Evidence {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let starts: Vec<Vec<f64>> = if model.has_rest() { vec![vec![0.0; model.len()]] } else { Vec::new() };
        let modes = crate::attribute::evidence::mode::find(model, &starts, &mut random);
        evidence(model, modes, FINE, &mut random).unwrap()
    }

    fn noisy(effect: f64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        Straight::curve(1.3, 0.6, effect).iter().map(|y| y + 0.05 * standard_normal(&mut random)).collect()
    }

    #[test]
    fn evidence_is_the_closed_form_of_a_straight_model_within_its_error() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(noisy(0.2));
        let known = Some(vec![vec![0.05; STEPS]]);
        let problem =
            Problem::new(&predictor, &prior, Straight::candidates(), &observations, known, 1.0).unwrap();
        let wave = (Straight::curve(0.0, 0.0, 1.0), 1.0);
        let offset = (vec![problem.ranges[0]; STEPS], 0.1);
        let mean = Straight::curve(1.0, 1.0, 0.0);
        let sets: [(&[usize], Directions); 4] = [
            (&[], vec![]),
            (&[0], vec![wave.clone()]),
            (&[1], vec![offset.clone()]),
            (&[0, 1], vec![wave, offset]),
        ];
        for (hypothesis, more) in sets {
            let mut model = Model::new(&problem, hypothesis, false);
            let expected = averaged(&model, &mean, &[base(), more].concat(), 0.3);
            for seed in 0..5 {
                let found = found(&mut model, seed);
                assert!(found.error < 0.1, "{hypothesis:?}: {}", found.error);
                let off = (found.ln - expected).abs();
                let (ln, error) = (found.ln, found.error);
                assert!(off < 0.25 && off < 4.0 * error, "{hypothesis:?}: {ln} {expected} {error}");
            }
        }
    }

    #[test]
    fn an_unknown_noise_is_integrated_out() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(noisy(0.1));
        let problem = Problem::new(&predictor, &prior, Vec::new(), &observations, None, 1.0).unwrap();
        let mut model = Model::new(&problem, &[], false);
        let expected = averaged(&model, &Straight::curve(1.0, 1.0, 0.0), &base(), 0.04);
        let found = found(&mut model, 3);
        assert!((found.ln - expected).abs() < 4.0 * found.error, "{} {expected} {}", found.ln, found.error);
    }

    #[test]
    fn amplitude_and_length_of_a_rest_are_integrated_out() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(noisy(0.1));
        let known = Some(vec![vec![0.05; STEPS]]);
        let problem = Problem::new(&predictor, &prior, Vec::new(), &observations, known, 1.0).unwrap();
        let mut model = Model::new(&problem, &[], true);
        let expected = averaged(&model, &Straight::curve(1.0, 1.0, 0.0), &base(), 0.6);
        let found = found(&mut model, 3);
        assert!((found.ln - expected).abs() < 4.0 * found.error, "{} {expected} {}", found.ln, found.error);
    }

    /// ln evidence of the base model, and the readings that it takes to be far off.
    fn of_base(values: Vec<f64>) -> (f64, Vec<usize>) {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(values);
        let known = Some(vec![vec![0.05; STEPS]]);
        let problem = Problem::new(&predictor, &prior, Vec::new(), &observations, known, 1.0).unwrap();
        let mut model = Model::new(&problem, &[], false);
        let ln = found(&mut model, 3).ln;
        (ln, model.singular().outliers.clone())
    }

    fn off(readings: &[(usize, f64)]) -> Vec<f64> {
        let mut values = noisy(0.0);
        readings.iter().for_each(|(i, by)| values[*i] += by);
        values
    }

    #[test]
    fn a_reading_that_is_far_off_is_noticed_and_costs_little() {
        let (clean, none) = of_base(off(&[]));
        let (off, outliers) = of_base(off(&[(17, 0.4)]));
        assert_eq!((none, outliers), (vec![], vec![17]));
        // Odds of one to a hundred, a density spread over ten standard deviations; 32 nats if it were normal.
        assert!(clean - off > 4.0 && clean - off < 10.0, "{clean} {off}");
    }

    #[test]
    fn readings_that_are_far_off_in_a_row_are_a_signal() {
        let (two, outliers) = of_base(off(&[(17, 1.0), (18, 1.0)]));
        assert_eq!(outliers, vec![17, 18]);
        let (three, outliers) = of_base(off(&[(17, 1.0), (18, 1.0), (19, 1.0)]));
        assert_eq!(outliers, vec![]);
        assert!(two - three > 20.0, "{two} {three}");
        // A peak would be three outliers, each by itself.
        let (_, outliers) = of_base(off(&[(17, 0.4), (18, 0.8), (19, 0.4)]));
        assert_eq!(outliers, vec![]);
    }
}
