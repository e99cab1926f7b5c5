//! Sequential Monte Carlo over temperatures, in the unit cube.
//!
//! Particles go from a density that can be drawn from to the target along
//! π_β ∝ start^(1 − β) · target^β. Each β is as far from the one before as the effective sample size
//! allows; then the particles are resampled and moved by Metropolis–Hastings steps that leave π_β as it
//! is. Proposals are made from the particles themselves, as they stood before a sweep: differences of two
//! of them (ter Braak & Vrugt 2008), near ones as often as far ones, and mixtures of normals about some of
//! them with the covariance of their neighbours, so that ridges which curve and modes which lie apart are
//! kept.
//!
//! Del Moral, Doucet & Jasra (2006), J. R. Stat. Soc. B 68:411.

use anyhow::{Result, ensure};
use rand::Rng;
use rand::SeedableRng;
use rand::distr::Open01;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::mixture::LocalMixture;
use super::start::Start;
use gl_inference::prior::normal_quantile;
use gl_numeric::statistics::{ln_sum_exp, sd};

/// A density on the unit cube: a prior, normalised, times a likelihood.
pub trait Density: Sync {
    /// ln of the prior; −∞ outside the cube.
    fn ln_prior(&self, x: &[f64]) -> f64;
    /// ln of the likelihood at a point of the cube.
    fn ln_likelihood(&self, x: &[f64]) -> f64;
    /// ln of prior times likelihood; −∞ outside the cube.
    fn ln_density(&self, x: &[f64]) -> f64 {
        let ln_prior = self.ln_prior(x);
        if ln_prior == f64::NEG_INFINITY { ln_prior } else { ln_prior + self.ln_likelihood(x) }
    }
}

/// How much is done.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Accepted moves a particle has at each temperature, on average.
    pub moves: f64,
    /// The same at the last one.
    pub last_moves: f64,
    /// Sweeps at most at each temperature.
    pub sweeps: usize,
    /// Seed.
    pub seed: u64,
}

/// Particles of equal weight.
#[derive(Clone, Debug)]
pub struct Population {
    /// Coordinates, shape (particles, dimensions).
    pub points: Vec<Vec<f64>>,
    /// ln of the start density of each, kept up below the last temperature alone: there it counts no more.
    ln_start: Vec<f64>,
    /// ln of the target density of each.
    pub ln_target: Vec<f64>,
    /// ln of the evidence: of the integral of prior times likelihood.
    pub ln_evidence: f64,
    /// Temperatures that it took.
    pub stages: usize,
    /// Share of proposals that were accepted at the last temperature.
    pub acceptance: f64,
}

/// Share of the particles that keeps weight from one temperature to the next.
const KEPT: f64 = 0.6;

/// Temperatures at most.
const MOST_STAGES: usize = 200;

/// Normals about the draws of a density, and how many times as wide as smooths them best, from which it is sampled again.
const WIDER: [(usize, f64); 2] = [(300, 2.0), (100, 4.0)];

/// So many times at most.
const PASSES: u64 = 10;

/// Until ln of its evidence changes by less, and no standard deviation grows by a larger factor.
const SETTLED: f64 = 0.1;
const WIDENED: f64 = 1.05;

/// Bring particles from the prior, or from another start, to the density that is wanted.
///
/// * `points` — draws from the prior, shape (particles, dimensions).
///
/// # Errors
/// If no particle has a density above zero, or the temperatures do not end.
pub fn sample(
    density: &impl Density,
    start: Option<&Start>,
    mut points: Vec<Vec<f64>>,
    effort: Effort,
) -> Result<Population> {
    let n = points.len();
    ensure!(n > 1, "{n} particles; sequential Monte Carlo needs at least two");
    let mut generator = ChaCha8Rng::seed_from_u64(effort.seed);
    let inside = start.map_or(1.0, |start| start.replace(&mut points, &mut generator));
    let target = Tempered { density, start };
    let densities: Vec<(f64, f64)> =
        points.par_iter().map(|x| (target.ln_start(x), density.ln_density(x))).collect();
    let (ln_start, ln_target) = densities.into_iter().unzip();
    let ln_evidence = inside.ln();
    let mut population = Population { points, ln_start, ln_target, ln_evidence, stages: 0, acceptance: 0.0 };
    let mut beta = 0.0;
    let mut sweeps = 0;
    while beta < 1.0 {
        ensure!(population.stages < MOST_STAGES, "no end after {MOST_STAGES} temperatures");
        let next = next_temperature(&population, beta)?;
        let ln_weight: Vec<f64> = population.ln_ratio().map(|ratio| (next - beta) * ratio).collect();
        population.ln_evidence += ln_sum_exp(&ln_weight) - (n as f64).ln();
        population.resample(&ln_weight, &mut generator);
        beta = next;
        population.stages += 1;
        let wanted = if beta < 1.0 { effort.moves } else { effort.last_moves };
        let most = if beta < 1.0 { effort.sweeps } else { 3 * effort.sweeps };
        let mut moved = 0.0;
        for _ in 0..most {
            sweeps += 1;
            population.acceptance = population.sweep(&target, beta, effort.seed, sweeps, &mut generator);
            moved += population.acceptance;
            if moved >= wanted {
                break;
            }
        }
    }
    Ok(population)
}

/// The same density from mixtures about its own draws, wider than these, until the evidence stays as it is.
///
/// A tail of which a start knows too little all but dies out at the temperatures between, and few moves lead back into
/// it; from a start that is the density itself, but wider, each draw counts as it should.
///
/// * `prior` — draws from the prior by a seed, as many as particles are wanted, shape (particles, dimensions).
///
/// # Errors
/// As of [`sample`].
pub fn refined(
    density: &impl Density,
    mut population: Population,
    prior: impl Fn(u64) -> Result<Vec<Vec<f64>>>,
    seed: u64,
) -> Result<Population> {
    for pass in 1..=PASSES {
        let seed = seed ^ (pass << 20);
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let about = |(most, width)| LocalMixture::new(&population.points, most, width, &mut generator);
        let start = Start { mixtures: WIDER.map(about).into(), dimensions: population.points[0].len() };
        let effort = Effort { moves: 1.0, last_moves: 2.0, sweeps: 8, seed };
        let next = sample(density, Some(&start), prior(seed)?, effort)?;
        let [spread, before] = [&next, &population].map(|of| spreads(&of.points));
        let is_wider = spread.iter().zip(&before).any(|(next, before)| next / before > WIDENED);
        let is_settled = (next.ln_evidence - population.ln_evidence).abs() < SETTLED && !is_wider;
        population = next;
        if is_settled {
            break;
        }
    }
    Ok(population)
}

/// Standard deviation of each coordinate of points, shape (points, dimensions).
pub(super) fn spreads(points: &[Vec<f64>]) -> Vec<f64> {
    let even = vec![1.0 / points.len() as f64; points.len()];
    (0..points[0].len()).map(|j| sd(&points.iter().map(|x| x[j]).collect::<Vec<_>>(), &even)).collect()
}

/// What lies between a start, the prior if there is no other, and the density that is wanted.
struct Tempered<'a, D> {
    density: &'a D,
    start: Option<&'a Start>,
}

impl<D: Density> Tempered<'_, D> {
    fn ln_start(&self, x: &[f64]) -> f64 {
        let ln_prior = self.density.ln_prior(x);
        self.start.map_or(ln_prior, |start| start.ln_density(x, ln_prior))
    }
}

/// The next temperature: as far as the effective sample size allows.
fn next_temperature(population: &Population, beta: f64) -> Result<f64> {
    let ratio: Vec<f64> = population.ln_ratio().collect();
    let ess = |next: f64| {
        let ln_weight: Vec<f64> = ratio.iter().map(|ratio| (next - beta) * ratio).collect();
        let doubled: Vec<f64> = ln_weight.iter().map(|w| 2.0 * w).collect();
        (2.0 * ln_sum_exp(&ln_weight) - ln_sum_exp(&doubled)).exp() / ratio.len() as f64
    };
    let possible = ratio.iter().filter(|ratio| **ratio > f64::NEG_INFINITY).count() as f64;
    ensure!(possible > 0.0, "nowhere in the prior is there a density above zero");
    let kept = KEPT * possible / ratio.len() as f64;
    if ess(1.0) >= kept {
        return Ok(1.0);
    }
    let (mut low, mut high) = ((1e-12_f64).ln(), (1.0 - beta).ln());
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if ess(beta + middle.exp()) >= kept { low = middle } else { high = middle }
    }
    Ok((beta + low.exp()).min(1.0))
}

impl Population {
    fn ln_ratio(&self) -> impl Iterator<Item = f64> {
        self.ln_target.iter().zip(&self.ln_start).map(|(target, start)| {
            let ratio = target - start;
            if ratio.is_nan() { f64::NEG_INFINITY } else { ratio }
        })
    }

    /// Systematic resampling: each particle as often as its weight says, give or take one.
    fn resample(&mut self, ln_weight: &[f64], generator: &mut ChaCha8Rng) {
        let n = ln_weight.len();
        let total = ln_sum_exp(ln_weight);
        let mut place = generator.random::<f64>() / n as f64;
        let mut below = 0.0;
        let mut chosen = Vec::with_capacity(n);
        for (i, ln_weight) in ln_weight.iter().enumerate() {
            below += (ln_weight - total).exp();
            while place < below && chosen.len() < n {
                chosen.push(i);
                place += 1.0 / n as f64;
            }
        }
        while chosen.len() < n {
            let last = chosen.last().copied().unwrap_or(0);
            chosen.push(last);
        }
        self.points = chosen.iter().map(|&i| self.points[i].clone()).collect();
        self.ln_start = chosen.iter().map(|&i| self.ln_start[i]).collect();
        self.ln_target = chosen.iter().map(|&i| self.ln_target[i]).collect();
    }

    /// Propose a move to each particle; the share that was accepted.
    fn sweep(
        &mut self,
        target: &Tempered<'_, impl Density>,
        beta: f64,
        seed: u64,
        sweep: u64,
        generator: &mut ChaCha8Rng,
    ) -> f64 {
        let mixture = LocalMixture::new(&self.points, CENTRES, 1.0, generator);
        let archive = &self.points;
        let moves: Vec<Option<(Vec<f64>, f64, f64)>> = (0..archive.len())
            .into_par_iter()
            .map(|i| {
                let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
                generator.set_stream((sweep << 32) | i as u64);
                let (next, ln_q) = propose(&archive[i], archive, &mixture, &mut generator)?;
                let here = mixed(beta, self.ln_start[i], self.ln_target[i]);
                let start = if beta < 1.0 { target.ln_start(&next) } else { 0.0 };
                let end = target.density.ln_density(&next);
                let there = mixed(beta, start, end);
                let threshold: f64 = generator.sample(Open01);
                (threshold.ln() < there - here + ln_q).then_some((next, start, end))
            })
            .collect();
        let mut accepted = 0;
        for (i, step) in moves.into_iter().enumerate() {
            let Some((point, start, end)) = step else { continue };
            (self.points[i], self.ln_start[i], self.ln_target[i]) = (point, start, end);
            accepted += 1;
        }
        f64::from(accepted) / self.points.len() as f64
    }
}

/// ln π_β; at the end the start density counts no more, wherever it is zero.
fn mixed(beta: f64, start: f64, target: f64) -> f64 {
    let value = if beta >= 1.0 { target } else { (1.0 - beta) * start + beta * target };
    if value.is_nan() { f64::NEG_INFINITY } else { value }
}

/// Normals in the mixture that proposals are drawn from.
const CENTRES: usize = 150;

/// A proposal from `x`, and ln of the density of the way back over that of the way there; nothing if it lies
/// outside the cube.
fn propose(
    x: &[f64],
    archive: &[Vec<f64>],
    mixture: &LocalMixture,
    generator: &mut ChaCha8Rng,
) -> Option<(Vec<f64>, f64)> {
    let is_inside = |x: &[f64]| x.iter().all(|x| (0.0..=1.0).contains(x));
    let kind: f64 = generator.random();
    if kind < 0.35 {
        let next = mixture.draw(generator);
        return is_inside(&next).then(|| {
            let ln_q = mixture.ln_density(x) - mixture.ln_density(&next);
            (next, ln_q)
        });
    }
    if kind < 0.6 {
        let (next, ln_q) = mixture.walk(x, generator);
        return is_inside(&next).then_some((next, ln_q));
    }
    let d = x.len() as f64;
    let (a, b) = if kind < 0.8 {
        mixture.neighbours(generator)
    } else {
        let mut any = || archive[generator.random_range(0..archive.len())].as_slice();
        (any(), any())
    };
    // Sometimes the whole difference, which goes from one mode to another.
    let scale = if generator.random_bool(0.1) {
        1.0
    } else {
        2.38 / (2.0 * d).sqrt() * (0.2_f64.ln() * generator.random::<f64>()).exp()
    };
    let next = x
        .iter()
        .zip(a.iter().zip(b))
        .map(|(x, (a, b))| {
            let jitter: f64 = generator.sample(Open01);
            reflected(x + scale * (a - b) + 1e-6 * normal_quantile(jitter))
        })
        .collect();
    Some((next, 0.0))
}

/// A coordinate thrown back at the faces of the cube.
fn reflected(x: f64) -> f64 {
    let folded = x.rem_euclid(2.0);
    if folded > 1.0 { 2.0 - folded } else { folded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gl_numeric::sequence::{Method, points};
    use gl_numeric::statistics::{Quantiles, mean};

    struct Even<F>(F);

    impl<F: Fn(&[f64]) -> f64 + Sync> Density for Even<F> {
        fn ln_prior(&self, x: &[f64]) -> f64 {
            if x.iter().all(|x| (0.0..=1.0).contains(x)) { 0.0 } else { f64::NEG_INFINITY }
        }

        fn ln_likelihood(&self, x: &[f64]) -> f64 {
            (self.0)(x)
        }
    }

    const EFFORT: Effort = Effort { moves: 2.0, last_moves: 5.0, sweeps: 20, seed: 3 };

    fn even(d: usize, seed: u64) -> Vec<Vec<f64>> {
        points(Method::Halton, 2000, d, Some(seed)).unwrap()
    }

    fn draws(d: usize, ln: impl Fn(&[f64]) -> f64 + Sync) -> Population {
        sample(&Even(ln), None, even(d, 1), EFFORT).unwrap()
    }

    fn moments(population: &Population, value: impl Fn(&[f64]) -> f64) -> (f64, f64) {
        let values: Vec<f64> = population.points.iter().map(|x| value(x)).collect();
        let weights = vec![1.0 / values.len() as f64; values.len()];
        (mean(&values, &weights), sd(&values, &weights))
    }

    /// A normal in eight dimensions of standard deviation 0.01 to 0.08: closed form.
    #[test]
    fn a_narrow_normal_has_its_moments_and_its_evidence() {
        let sd = |j: usize| 0.01 * (j + 1) as f64;
        let population =
            draws(8, |x| -0.5 * x.iter().enumerate().map(|(j, x)| ((x - 0.5) / sd(j)).powi(2)).sum::<f64>());
        for j in 0..8 {
            let (mean, spread) = moments(&population, |x| x[j]);
            assert!((mean - 0.5).abs() < 0.15 * sd(j), "{j}: {mean}");
            assert!((spread / sd(j) - 1.0).abs() < 0.08, "{j}: {spread}");
        }
        let evidence: f64 = (0..8).map(|j| sd(j).ln() + 0.5 * std::f64::consts::TAU.ln()).sum();
        assert!((population.ln_evidence - evidence).abs() < 0.8, "{} {evidence}", population.ln_evidence);
    }

    /// x₀ x₁ known to 1 %: along the hyperbola the marginal of x₀ is 1/x₀ between 0.2 and 1.
    #[test]
    fn a_curved_ridge_is_filled_along_its_length() {
        let population = draws(4, |x| {
            let (a, b) = ((x[0] * x[1] - 0.2) / 0.002, (x[2] - x[3]) / 0.01);
            -0.5 * (a * a + b * b)
        });
        let x: Vec<f64> = population.points.iter().map(|x| x[0]).collect();
        let quantiles = Quantiles::new(&x, &vec![1.0 / x.len() as f64; x.len()]);
        for p in [0.1, 0.5, 0.9] {
            let exact = 0.2 * (5.0_f64.ln() * p).exp();
            assert!((quantiles.at(p) / exact - 1.0).abs() < 0.12, "{p}: {} {exact}", quantiles.at(p));
        }
    }

    #[test]
    fn modes_keep_their_shares() {
        let mode = |x: &[f64], at: f64| -0.5 * x.iter().map(|x| ((x - at) / 0.02).powi(2)).sum::<f64>();
        let population =
            draws(3, |x| ln_sum_exp(&[mode(x, 0.25) + 0.8_f64.ln(), mode(x, 0.75) + 0.2_f64.ln()]));
        let (share, _) = moments(&population, |x| f64::from(u8::from(x[0] > 0.5)));
        assert!((share - 0.2).abs() < 0.06, "{share}");
    }

    #[test]
    fn a_density_against_a_face_keeps_its_shape() {
        let population = draws(2, |x| -x[0] / 0.02);
        let (mean, spread) = moments(&population, |x| x[0]);
        assert!((mean - 0.02).abs() < 0.002 && (spread - 0.02).abs() < 0.003, "{mean} {spread}");
    }

    /// Three products with a factor e^(2x) known to 4 %: the density of x is 6 e^(−6x), but for the bounds. A start that has
    /// been at the wide end alone, as one about a maximum has, loses the narrow one on its way.
    #[test]
    fn a_tail_that_a_start_does_not_know_gets_its_share() {
        let density = Even(|x: &[f64]| {
            let factor = (2.0 * x[0]).exp();
            -0.5 * x[1..].iter().map(|x| ((x * factor - 0.5) / 0.02).powi(2)).sum::<f64>()
        });
        let below = |x: f64| (1.0 - (-6.0 * x).exp()) / (1.0 - (-6.0_f64).exp());
        let evidence =
            3.0 * (0.02 * std::f64::consts::TAU.sqrt()).ln() + ((1.0 - (-6.0_f64).exp()) / 6.0).ln();
        let share = |population: &Population| moments(population, |x| f64::from(u8::from(x[0] > 0.4))).0;
        let mut shares = [0.0, 0.0];
        for seed in 0..6 {
            let near =
                |u: Vec<f64>| vec![0.3 * u[0], 0.48 + 0.04 * u[1], 0.48 + 0.04 * u[2], 0.48 + 0.04 * u[3]];
            let near: Vec<Vec<f64>> = even(4, seed).into_iter().map(near).collect();
            let mixture = LocalMixture::new(&near, 200, 2.0, &mut ChaCha8Rng::seed_from_u64(seed));
            let start = Start { mixtures: vec![mixture], dimensions: 4 };
            let first = sample(&density, Some(&start), even(4, seed), EFFORT).unwrap();
            let last = refined(&density, first.clone(), |seed| Ok(even(4, seed)), seed).unwrap();
            shares = [shares[0] + share(&first) / 6.0, shares[1] + share(&last) / 6.0];
            assert!((last.ln_evidence - evidence).abs() < 0.15, "{seed}: {} {evidence}", last.ln_evidence);
        }
        let wanted = 1.0 - below(0.4);
        assert!(
            shares[0] < 0.4 * wanted,
            "a start that knows the tail tests nothing: {} {wanted}",
            shares[0]
        );
        assert!((shares[1] / wanted - 1.0).abs() < 0.45, "{} {wanted}", shares[1]);
    }

    #[test]
    fn a_density_of_zero_is_an_error() {
        assert!(sample(&Even(|_: &[f64]| f64::NEG_INFINITY), None, even(2, 1), EFFORT).is_err());
    }

    #[test]
    fn threads_make_no_difference() {
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| draws(2, |x| -0.5 * ((x[0] - x[1]) / 0.1).powi(2)).points)
        });
        assert_eq!(one, three);
    }
}
