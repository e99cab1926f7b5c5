//! Drawing the next samples where the weight lies.

use anyhow::{Result, ensure};

use crate::mixture::{self, CovarianceType, Mixture, Options};
use crate::prior::{Parameter, Prior, normal_quantile};
use crate::proposal::{Proposal, Support};
use crate::weights::Weights;
use gl_numeric::sequence::Halton;
use gl_numeric::statistics::{effective_size, mean, sd};

/// How samples are drawn from the fitted mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sampling {
    /// By its density.
    Mixture,
    /// Evenly where its density is above a threshold: the mean of the scores (ln densities at the
    /// weighted samples) less `deviation` times their standard deviation.
    Slice {
        /// Standard deviations of the scores below their mean.
        deviation: f64,
    },
}

/// How the next samples are drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Resampling {
    /// Number of samples.
    pub count: usize,
    /// Components at the most.
    pub components: usize,
    /// Shape of the covariances.
    pub covariance: CovarianceType,
    /// Concentration of the components' weights; see [`Options::concentration`].
    pub concentration: Option<f64>,
    /// How to draw from the mixture.
    pub sampling: Sampling,
    /// Seed of the fit and the draws.
    pub seed: u64,
}

/// New samples, and what they were drawn from.
#[derive(Clone, Debug)]
pub struct Resampled {
    /// Parameter values, shape (count, parameters); parameters of effects that are off stand at `off`.
    pub values: Vec<Vec<f64>>,
    /// The density that they were drawn from.
    pub proposal: Proposal,
    /// Whether so few samples had weight that their neighbours had to be taken in.
    pub was_widened: bool,
    /// Whether a slice was asked for, but so little of it lies inside the bounds that the samples were drawn
    /// by density.
    pub was_by_density: bool,
}

/// Beginnings of the mixture's fit.
const STARTS: usize = 5;

/// Draws that the size of the support is measured with.
const TRIALS: usize = 1 << 12;

/// Fit a mixture to weighted samples and draw the next ones from it, inside the prior's support.
///
/// Effects whose parameter stands at `off` in every sample with weight are off in the new ones too.
///
/// # Errors
/// If a parameter has no column in the weights, or no sample lies inside the prior's support.
pub fn resample(weights: &Weights, prior: &Prior, how: &Resampling) -> Result<Resampled> {
    ensure!(!weights.is_empty(), "{}: no samples to draw new ones from", weights.source);
    let all = columns(weights, prior)?;
    let varied: Vec<usize> = (0..prior.parameters().len())
        .filter(|&j| all.iter().any(|row| !prior.parameters()[j].is_off(row[j])))
        .collect();
    let parameters: Vec<Parameter> = varied.iter().map(|&j| prior.parameters()[j].clone()).collect();
    ensure!(!parameters.is_empty(), "{}: every effect is off; nothing varies", weights.source);
    let mut points: Vec<Vec<f64>> = all
        .iter()
        .map(|row| {
            varied.iter().zip(&parameters).map(|(&j, p)| p.coordinate(row[j]).clamp(0.0, 1.0)).collect()
        })
        .collect();

    let mut shares = inside(weights, &all, &varied, &parameters)?;
    // Places spread evenly stand in for the neighbours that a handful of samples does not have.
    let evenly = Halton::new(parameters.len(), Some(how.seed));
    for i in points.len()..least_samples(parameters.len()) {
        points.push(evenly.point(i as u64));
        shares.push(0.0);
    }
    let (shares, was_widened) = enough_samples(&points, &shares);
    let mut proposal = fit(&points, &shares, parameters, how)?;
    let mut was_by_density = false;
    let drawn = match how.sampling {
        Sampling::Mixture => draw_mixture(&mut proposal, how),
        // In many dimensions nearly all of the ellipsoids may lie below the threshold or beyond the bounds.
        Sampling::Slice { deviation } => {
            draw_slice(&mut proposal, &points, &shares, deviation, how).or_else(|_| {
                was_by_density = true;
                draw_mixture(&mut proposal, how)
            })
        }
    }?;
    let values = drawn
        .iter()
        .map(|z| {
            let mut row = prior.with_effects_off();
            for ((&j, p), &z) in varied.iter().zip(proposal.parameters()).zip(z) {
                row[j] = p.at_coordinate(z);
            }
            row
        })
        .collect();
    Ok(Resampled { values, proposal, was_widened, was_by_density })
}

fn columns(weights: &Weights, prior: &Prior) -> Result<Vec<Vec<f64>>> {
    let mut places = Vec::new();
    for name in prior.names() {
        let place = weights.parameters.iter().position(|other| *other == name);
        ensure!(place.is_some(), "{}:1: no column {name}, which the table of parameters has", weights.source);
        places.extend(place);
    }
    Ok(weights.values.iter().map(|row| places.iter().map(|&j| row[j]).collect()).collect())
}

/// The weights of the samples inside the bounds, summing to one: outside, where the prior has nothing,
/// there is nothing to draw either.
fn inside(
    weights: &Weights,
    all: &[Vec<f64>],
    varied: &[usize],
    parameters: &[Parameter],
) -> Result<Vec<f64>> {
    let is_inside = |row: &Vec<f64>| {
        varied
            .iter()
            .zip(parameters)
            .all(|(&j, p)| p.is_off(row[j]) || (-1e-9..=1.0 + 1e-9).contains(&p.coordinate(row[j])))
    };
    let mut shares = weights.weight.clone();
    if all.iter().all(is_inside) {
        return Ok(shares);
    }
    for (share, _) in shares.iter_mut().zip(all).filter(|(_, row)| !is_inside(row)) {
        *share = 0.0;
    }
    let sum: f64 = shares.iter().sum();
    ensure!(
        sum > 0.0,
        "{}: no sample with weight lies within the bounds of the parameters; were they narrowed?",
        weights.source
    );
    shares.iter_mut().for_each(|share| *share /= sum);
    Ok(shares)
}

/// How many samples are to have weight, so that they show the shape of a place in so many dimensions.
fn least_samples(dimensions: usize) -> usize {
    dimensions + 2
}

/// Weights that rest on at least as many samples as [`least_samples`] says: where fewer have any, the
/// nearest to them are given the same weight.
fn enough_samples(points: &[Vec<f64>], weights: &[f64]) -> (Vec<f64>, bool) {
    let least = least_samples(points[0].len());
    let ess = effective_size(weights);
    if ess >= least as f64 - 1e-9 {
        return (weights.to_vec(), false);
    }
    let best = (0..points.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0);
    let distance = |i: usize| points[i].iter().zip(&points[best]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mut nearest: Vec<usize> = (0..points.len()).collect();
    nearest.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    // Half of the weight stays where it is, so that two places that fit both stay in the running.
    let mut shares: Vec<f64> = weights.iter().map(|w| 0.5 * w).collect();
    for &i in &nearest[..least] {
        shares[i] += 0.5 / least as f64;
    }
    (shares, true)
}

/// The mixture of the weighted points, fitted where their spread is one in each direction.
fn fit(
    points: &[Vec<f64>],
    shares: &[f64],
    parameters: Vec<Parameter>,
    how: &Resampling,
) -> Result<Proposal> {
    let d = parameters.len();
    let column = |j: usize| points.iter().map(|z| z[j]).collect::<Vec<f64>>();
    let centre: Vec<f64> = (0..d).map(|j| mean(&column(j), shares)).collect();
    // Samples that all stand at one place still leave the room between them and their neighbours.
    let room = 1e-6;
    let spread: Vec<f64> = (0..d).map(|j| sd(&column(j), shares).max(room)).collect();
    let (mut standard, mut kept) = (Vec::new(), Vec::new());
    for (z, &share) in points.iter().zip(shares).filter(|(_, share)| **share > 0.0) {
        standard
            .push(z.iter().zip(&centre).zip(&spread).map(|((z, c), s)| (z - c) / s).collect::<Vec<f64>>());
        kept.push(share);
    }
    let options = Options {
        concentration: how.concentration,
        ..Options::new(how.components.min(kept.len()), how.covariance)
    };
    let Mixture { weights, means, covariances, .. } =
        mixture::fit(&standard, &kept, &options, STARTS, how.seed)?;
    // Components that the fit has emptied would only cost time.
    let (mut kept_weights, mut kept_means, mut kept_covariances) = (Vec::new(), Vec::new(), Vec::new());
    for ((weight, mut mean), mut covariance) in weights.into_iter().zip(means).zip(covariances) {
        if weight < 1e-4 {
            continue;
        }
        for i in 0..d {
            mean[i] = centre[i] + spread[i] * mean[i];
            for j in 0..d {
                covariance[(i, j)] *= spread[i] * spread[j];
            }
        }
        kept_weights.push(weight);
        kept_means.push(mean);
        kept_covariances.push(covariance);
    }
    let total: f64 = kept_weights.iter().sum();
    kept_weights.iter_mut().for_each(|w| *w /= total);
    Proposal::new(parameters, kept_weights, kept_means, kept_covariances)
}

fn in_cube(z: &[f64]) -> bool {
    z.iter().all(|z| (0.0..=1.0).contains(z))
}

/// Try points of a sequence until there are `count`, and long enough to know what share of the tries
/// succeeds: the points, and ln of that share.
fn draw_until(
    count: usize,
    dimensions: usize,
    seed: u64,
    most_trials: usize,
    mut attempt: impl FnMut(&[f64]) -> Option<Vec<f64>>,
) -> Result<(Vec<Vec<f64>>, f64)> {
    let halton = Halton::new(dimensions, Some(seed));
    let mut drawn = Vec::with_capacity(count);
    let (mut successes, mut trials) = (0_usize, 0_usize);
    while drawn.len() < count || trials < TRIALS {
        ensure!(
            trials < most_trials,
            "of {most_trials} draws from the mixture only {} lie inside the bounds: it is too wide for them in so \
             many dimensions; give more samples, or --covariance diag",
            drawn.len()
        );
        if let Some(z) = attempt(&halton.point(trials as u64)) {
            successes += 1;
            if drawn.len() < count {
                drawn.push(z);
            }
        }
        trials += 1;
    }
    Ok((drawn, (successes as f64 / trials as f64).ln()))
}

/// The component that a number in [0, 1) stands for, by shares that sum to one.
fn pick(shares: &[f64], u: f64) -> usize {
    let mut left = u;
    shares
        .iter()
        .position(|share| {
            left -= share;
            left < 0.0
        })
        .unwrap_or(shares.len() - 1)
}

fn standard_normal(u: &[f64]) -> Vec<f64> {
    u.iter().map(|&u| normal_quantile(u.max(f64::EPSILON))).collect()
}

fn draw_mixture(proposal: &mut Proposal, how: &Resampling) -> Result<Vec<Vec<f64>>> {
    let d = proposal.parameters().len();
    let (shares, gaussians): (Vec<f64>, Vec<_>) = proposal.components().unzip();
    let (drawn, ln_mass) = draw_until(how.count, d + 1, how.seed, 1 << 24, |u| {
        let z = gaussians[pick(&shares, u[d])].point(&standard_normal(&u[..d]));
        in_cube(&z).then_some(z)
    })?;
    proposal.support = Support::Mixture { ln_mass };
    Ok(drawn)
}

/// Draw evenly where the density is above the threshold. That place lies within an ellipsoid around
/// each component, so the draws come from these, less where they overlap.
fn draw_slice(
    proposal: &mut Proposal,
    points: &[Vec<f64>],
    shares: &[f64],
    deviation: f64,
    how: &Resampling,
) -> Result<Vec<Vec<f64>>> {
    let d = proposal.parameters().len();
    let scores: Vec<f64> = points.iter().map(|z| proposal.ln_mixture(z)).collect();
    // The mean score of a Gaussian is d/2 below its peak. Samples that all stand at one place have no
    // other score than the peak, and the slice would be empty.
    let highest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let ln_threshold =
        (mean(&scores, shares) - deviation * sd(&scores, shares)).min(highest - 0.5 * d as f64);
    let count = proposal.components().count() as f64;
    let ellipsoids: Vec<_> = proposal
        .components()
        .filter_map(|(weight, gaussian)| {
            // Where the density is at the threshold one component has its share of it.
            let squared_radius = 2.0 * (weight.ln() + gaussian.ln_peak() - (ln_threshold - count.ln()));
            (squared_radius > 0.0).then_some((gaussian, squared_radius))
        })
        .collect();
    ensure!(!ellipsoids.is_empty(), "the mixture is nowhere above the threshold of the slice");
    let ln_ball =
        0.5 * d as f64 * std::f64::consts::PI.ln() - statrs::function::gamma::ln_gamma(0.5 * d as f64 + 1.0);
    let ln_volumes: Vec<f64> = ellipsoids
        .iter()
        .map(|(gaussian, squared_radius)| {
            let ln_root_determinant = -gaussian.ln_peak() - 0.5 * d as f64 * std::f64::consts::TAU.ln();
            ln_ball + 0.5 * d as f64 * squared_radius.ln() + ln_root_determinant
        })
        .collect();
    let ln_total = gl_numeric::statistics::ln_sum_exp(&ln_volumes);
    let volumes: Vec<f64> = ln_volumes.iter().map(|ln_volume| (ln_volume - ln_total).exp()).collect();
    let mut scratch = vec![0.0; d];
    let (drawn, ln_share) = draw_until(how.count, d + 3, how.seed, (1 << 18) + 100 * how.count, |u| {
        let (gaussian, squared_radius) = ellipsoids[pick(&volumes, u[d])];
        let direction = standard_normal(&u[..d]);
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        let radius = squared_radius.sqrt() * u[d + 1].powf(1.0 / d as f64);
        let z = gaussian.point(&direction.iter().map(|x| x * radius / length).collect::<Vec<f64>>());
        if !in_cube(&z) || proposal.ln_mixture(&z) < ln_threshold {
            return None;
        }
        let covering = ellipsoids.iter().filter(|(g, r)| g.squared_distance(&z, &mut scratch) <= *r).count();
        (u[d + 2] * covering as f64 <= 1.0).then_some(z)
    })?;
    proposal.support = Support::Slice { ln_threshold, ln_volume: ln_total + ln_share };
    Ok(drawn)
}
