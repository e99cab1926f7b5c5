//! The most probable parameters of a hypothesis, by Levenberg–Marquardt from several starts.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::attribute::model::{Curve, Model, ln_prior};
use gl_inference::prior::normal_quantile;

/// A maximum of the posterior density.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Where it is, shape (parameters,).
    pub w: DVector<f64>,
    /// Covariance of the posterior about it, to second order, shape (parameters, parameters).
    pub covariance: DMatrix<f64>,
    /// ln of likelihood times prior there.
    pub ln_posterior: f64,
}

/// Points of the prior from which the best are climbed.
const SCREENED: usize = 64;
/// How many of them are climbed.
const CLIMBED: usize = 2;
/// Modes that lie further below the best are left to the wide part of the proposal.
const NEGLIGIBLE: f64 = 12.0;
const ITERATIONS: usize = 30;

/// The modes found from the given starts (curve parameters) and from the prior, best first.
pub fn find(model: &Model<'_>, starts: &[Vec<f64>], random: &mut ChaCha8Rng) -> Vec<Mode> {
    let dimensions = model.curve_parameters();
    let nuisances = vec![0.0; model.len() - dimensions];
    let unknown = vec![0.0; model.problem().predictor.scatter().len()];
    let mut screened: Vec<(f64, Vec<f64>)> = (0..SCREENED)
        .map(|_| {
            let mut w: Vec<f64> = (0..dimensions).map(|_| standard_normal(random)).collect();
            w.extend(&nuisances);
            let mean = model.mean(&w);
            (model.ln_likelihood(&w, &Curve { mean, variance: unknown.clone() }), w)
        })
        .collect();
    screened.sort_by(|a, b| b.0.total_cmp(&a.0));
    let climbed = screened.into_iter().take(CLIMBED).map(|(_, w)| w);
    let given = starts.iter().map(|start| [start.as_slice(), &nuisances].concat());
    let mut modes: Vec<Mode> = given.chain(climbed).map(|start| climb(model, start)).collect();
    modes.sort_by(|a, b| b.ln_posterior.total_cmp(&a.ln_posterior));
    let mut distinct: Vec<Mode> = Vec::new();
    for mode in modes {
        if distinct
            .iter()
            .all(|other| other.ln_posterior - mode.ln_posterior < NEGLIGIBLE && apart(other, &mode))
        {
            distinct.push(mode);
        }
    }
    distinct
}

/// Whether a mode lies more than two standard deviations from another.
fn apart(one: &Mode, other: &Mode) -> bool {
    let away = &other.w - &one.w;
    Cholesky::new(one.covariance.clone()).is_none_or(|factor| away.dot(&factor.solve(&away)) > 4.0)
}

fn climb(model: &Model<'_>, start: Vec<f64>) -> Mode {
    let dimensions = model.curve_parameters();
    let objective = |w: &[f64], curve: &Curve| model.ln_likelihood(w, curve) + ln_prior(w);
    let mut w = start;
    let mut curve = model.curve(&w);
    settle_nuisances(model, &mut w, &curve);
    let mut value = objective(&w, &curve);
    let mut damping = 1e-2;
    for iteration in 1..=ITERATIONS {
        let Some((slope, information)) = normal_equations(model, &w, &curve) else { break };
        let mut gained = 0.0;
        while damping < 1e6 {
            let mut damped = information.clone();
            for i in 0..dimensions {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(factor) = Cholesky::new(damped) else { break };
            let mut step = factor.solve(&slope);
            // Normal scores: a step of many is out of the prior, and of the linear range.
            let length = step.amax();
            if length > 2.0 {
                step *= 2.0 / length;
            }
            let mut next = w.clone();
            for (w, step) in next.iter_mut().zip(step.iter()) {
                *w += step;
            }
            // The variance costs more than the curve and changes slowly: it is brought up to date
            // now and then.
            let there = Curve { mean: model.mean(&next), variance: curve.variance.clone() };
            let better = objective(&next, &there);
            if better > value {
                gained = better - value;
                (w, curve, value) = (next, there, better);
                damping = (damping * 0.2).max(1e-9);
                break;
            }
            damping *= 8.0;
        }
        let is_done = gained < 0.01;
        if is_done || iteration % 3 == 0 {
            curve = model.curve(&w);
            settle_nuisances(model, &mut w, &curve);
            let settled = objective(&w, &curve);
            if is_done && settled - value < 0.1 {
                value = settled;
                break;
            }
            value = settled;
        }
    }
    let mut covariance = DMatrix::identity(w.len(), w.len());
    if let Some(factor) =
        normal_equations(model, &w, &curve).and_then(|(_, curvature)| Cholesky::new(curvature))
    {
        covariance.view_mut((0, 0), (dimensions, dimensions)).copy_from(&factor.inverse());
    }
    for i in dimensions..w.len() {
        const STEP: f64 = 0.05;
        let mut moved = w.clone();
        moved[i] += STEP;
        let above = objective(&moved, &curve);
        moved[i] -= 2.0 * STEP;
        let below = objective(&moved, &curve);
        let bend = (2.0 * value - above - below) / (STEP * STEP);
        covariance[(i, i)] = if bend > 1.0 { 1.0 / bend } else { 1.0 };
    }
    Mode { w: DVector::from_vec(w), covariance, ln_posterior: value }
}

impl Mode {
    /// ln evidence as if the posterior were normal about this mode (Laplace).
    pub fn ln_evidence(&self) -> f64 {
        let ln_det = self.covariance.determinant().max(1e-300).ln();
        self.ln_posterior + 0.5 * (ln_det + self.w.len() as f64 * std::f64::consts::TAU.ln())
    }
}

/// Slope of ln likelihood + ln prior by the curve parameters, and its curvature to second order, at a
/// fixed covariance.
fn normal_equations(model: &Model<'_>, w: &[f64], curve: &Curve) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let dimensions = model.curve_parameters();
    let (_, gradient) = model.gradient(w);
    let solved = model.with_covariance(w, &curve.variance, |covariance| covariance.solve(&gradient)).ok()?;
    let residual = DVector::from_vec(model.residual(&curve.mean));
    let slope = solved.tr_mul(&residual) - DVector::from_column_slice(&w[..dimensions]);
    let mut curvature = gradient.tr_mul(&solved);
    for i in 0..dimensions {
        curvature[(i, i)] += 1.0;
    }
    curvature.iter().all(|value| value.is_finite()).then_some((slope, curvature))
}

/// Put each nuisance where it is most probable, the curve as it is.
fn settle_nuisances(model: &Model<'_>, w: &mut [f64], curve: &Curve) {
    for i in model.curve_parameters()..w.len() {
        let mut at = |value: f64| {
            w[i] = value;
            model.ln_likelihood(w, curve) - 0.5 * value * value
        };
        let (mut best, mut highest) = (0.0, f64::NEG_INFINITY);
        for step in -6..=6 {
            let value = 0.5 * f64::from(step);
            let height = at(value);
            if height > highest {
                (best, highest) = (value, height);
            }
        }
        for step in [0.25, 0.12, 0.06, 0.03] {
            for value in [best - step, best + step] {
                let height = at(value);
                if height > highest {
                    (best, highest) = (value, height);
                }
            }
        }
        w[i] = best;
    }
}

/// A standard normal number.
pub fn standard_normal(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = random.random();
    normal_quantile(u.clamp(1e-16, 1.0 - 1e-16))
}
