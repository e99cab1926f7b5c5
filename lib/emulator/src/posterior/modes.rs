//! Modes of a posterior, found by climbing from the runs that fit best.
//!
//! Where the prior is a million times wider than the posterior, particles that come from the prior settle where the
//! emulator knows nothing, for anything may be there, and pass by the place at which runs were made and fit. So the
//! density that a posterior is sampled from has a part at each maximum that can be reached from these runs:
//! Gauss–Newton steps with Marquardt's damping (1963, J. SIAM 11:431), and the normal of the curvature there.

use rand::Rng;
use rand::distr::Open01;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use gl_inference::prior::normal_quantile;
use gl_numeric::sequence::{self, Method};

use super::likelihood::Posterior;
use super::smc::Density;
use crate::cholesky::Cholesky;

/// Step of a difference quotient, as a share of the prior's width.
const STEP: f64 = 1e-5;

/// Steps at most.
const STEPS: usize = 40;

/// A gain below which a climb ends, in ln.
const GAIN: f64 = 1e-3;

/// Nuisances that are tried.
const NUISANCES: usize = 48;

/// Maxima that lie closer than this are one, in standard deviations of the first.
const APART: f64 = 2.0;

/// A maximum this far below the best, in ln, has no share of the posterior.
const LOWER: f64 = 50.0;

/// A maximum of the posterior.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Where it is, parameters alone, shape (parameters,).
    at: Vec<f64>,
    /// Lower factor of the curvature: the inverse of the covariance of the parameters about it.
    curvature: Cholesky,
    /// ln of the posterior's density there.
    pub ln: f64,
}

/// The maxima that are reached from some places, parameters alone, the highest first.
pub fn modes(posterior: &Posterior<'_>, places: &[Vec<f64>]) -> Vec<Mode> {
    let mut found: Vec<Mode> = places.par_iter().filter_map(|place| climb(posterior, place)).collect();
    found.sort_by(|a, b| b.ln.total_cmp(&a.ln));
    let mut apart: Vec<Mode> = Vec::new();
    for mode in found {
        let is_new = apart.iter().all(|other| other.distance(&mode.at) > APART);
        if is_new && apart.first().is_none_or(|best| mode.ln > best.ln - LOWER) {
            apart.push(mode);
        }
    }
    apart
}

/// The maximum above a place; none where the density is zero.
fn climb(posterior: &Posterior<'_>, place: &[f64]) -> Option<Mode> {
    let d = place.len();
    let mut x = place.to_vec();
    x.extend(best_nuisances(posterior, place)?);
    let mut ln = posterior.ln_density(&x);
    let mut damping = 1e-2;
    for _ in 0..STEPS {
        let slope = gradient(posterior, &x, d);
        let curvature = posterior.curvature(&x);
        let mut gain = 0.0;
        while damping < 1e8 {
            let mut damped = curvature.clone();
            (0..d).for_each(|i| damped.row_mut(i)[i] *= 1.0 + damping);
            let mut step = slope.clone();
            Cholesky::new(&damped).ok()?.solve(&mut step);
            let mut next = x.clone();
            next.iter_mut().zip(&step).for_each(|(x, step)| *x = (*x + step).clamp(0.0, 1.0));
            let higher = posterior.ln_density(&next);
            if higher > ln {
                gain = higher - ln;
                (x, ln) = (next, higher);
                damping = (0.2 * damping).max(1e-9);
                break;
            }
            damping *= 5.0;
        }
        if gain < GAIN {
            break;
        }
    }
    x.truncate(d);
    x.extend(best_nuisances(posterior, &x)?);
    let (ln, curvature) = (posterior.ln_density(&x), posterior.curvature(&x));
    x.truncate(d);
    Some(Mode { at: x, curvature: Cholesky::new(&curvature).ok()?, ln })
}

/// The nuisances of the highest density at a place, of some that are spread evenly.
fn best_nuisances(posterior: &Posterior<'_>, place: &[f64]) -> Option<Vec<f64>> {
    let count = posterior.0.nuisances().len();
    let tried = match count {
        0 => vec![Vec::new()],
        _ => sequence::points(Method::Halton, NUISANCES, count, None).ok()?,
    };
    let density = |nuisances: &Vec<f64>| {
        let mut x = place.to_vec();
        x.extend(nuisances);
        posterior.ln_density(&x)
    };
    let densities: Vec<f64> = tried.iter().map(density).collect();
    let best = (0..tried.len()).max_by(|&a, &b| densities[a].total_cmp(&densities[b]))?;
    (densities[best] > f64::NEG_INFINITY).then(|| tried[best].clone())
}

/// Difference quotients of ln of the density by the parameters, one-sided at a bound.
fn gradient(posterior: &Posterior<'_>, x: &[f64], parameters: usize) -> Vec<f64> {
    let quotient = |j: usize| {
        let (low, high) = ((x[j] - STEP).max(0.0), (x[j] + STEP).min(1.0));
        let at = |value: f64| {
            let mut x = x.to_vec();
            x[j] = value;
            posterior.ln_density(&x)
        };
        (at(high) - at(low)) / (high - low)
    };
    (0..parameters).map(quotient).collect()
}

impl Mode {
    /// Distance of a place in standard deviations.
    fn distance(&self, place: &[f64]) -> f64 {
        let away: Vec<f64> = place.iter().zip(&self.at).map(|(a, b)| a - b).collect();
        let lower = self.curvature.lower();
        let d = away.len();
        let of = |j: usize| -> f64 { (j..d).map(|i| lower.row(i)[j] * away[i]).sum() };
        (0..d).map(|j| of(j).powi(2)).sum::<f64>().sqrt()
    }

    /// Where it is, parameters alone, shape (parameters,).
    pub fn at(&self) -> &[f64] {
        &self.at
    }

    /// Points about it, inside the cube, so many times as wide as the curvature says, shape (count, parameters).
    pub fn draws(&self, count: usize, width: f64, generator: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let draw = |generator: &mut ChaCha8Rng| {
            let mut step: Vec<f64> =
                self.at.iter().map(|_| normal_quantile(generator.sample(Open01))).collect();
            self.curvature.solve_upper(&mut step);
            // What leaves the cube is turned back at its wall.
            let inside = |(x, step): (&f64, &f64)| {
                let x = (x + width * step).rem_euclid(2.0);
                if x > 1.0 { 2.0 - x } else { x }
            };
            self.at.iter().zip(&step).map(inside).collect()
        };
        (0..count).map(|_| draw(generator)).collect()
    }
}
