//! Sampling through one emulator, with the noise as the residuals say it is.

use anyhow::Result;
use gl_numeric::sequence::{self, Method};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::Options;
use super::likelihood::{Fit, Likelihood, Measured, Nuisances, Posterior};
use super::mixture::LocalMixture;
use super::modes::{Mode, modes};
use super::noise::{self, ChiSquare};
use super::smc::{Effort, Population, refined, sample, spreads};
use super::space::Space;
use super::start::Start;
use super::surrogate::Surrogate;

/// Particles.
const PARTICLES: usize = 2000;

/// Runs that maxima are climbed to from, and points about each.
const CLIMBS: usize = 8;
const AROUND: usize = 200;

/// Points about a maximum are drawn so many times as wide as its curvature says, where particles start from.
const START_WIDTH: f64 = 1.5;

/// A point of a likelihood this much above all draws shows that these lie elsewhere, in ln.
const MISSED: f64 = 5.0;

/// Points of the highest likelihood among which a correlation is looked for.
const FITTEST: usize = 40;

/// Points of the prior, shape (count, dimensions).
pub(super) fn from_prior(space: &Space, nuisances: usize, count: usize, seed: u64) -> Result<Vec<Vec<f64>>> {
    let d = space.len();
    let points = sequence::points(Method::Halton, count, d + nuisances, Some(seed))?;
    let place = |u: Vec<f64>| {
        let mut point = space.quantile(&u[..d]);
        point.extend(&u[d..]);
        point
    };
    Ok(points.into_iter().map(place).collect())
}

/// What sampling gives.
pub(super) struct Outcome {
    /// Draws.
    pub(super) population: Population,
    /// What is not known of the noise.
    pub(super) nuisances: Nuisances,
    /// Whether the residuals of each observable are correlated from step to step.
    pub(super) correlated: Vec<bool>,
    /// The best fit against the noise as stated; absent where it was not.
    pub(super) chi_square: Option<ChiSquare>,
}

impl Outcome {
    /// Mean variance of the noise over that of its base.
    pub(super) fn variance(&self, space: &Space) -> f64 {
        let points = &self.population.points;
        let of = |x: &Vec<f64>| self.nuisances.at(&x[space.len()..]).variance;
        points.iter().map(of).sum::<f64>() / points.len() as f64
    }
}

/// Samples a posterior through one emulator.
pub(super) struct Sampler<'a> {
    pub(super) surrogate: &'a Surrogate,
    pub(super) space: &'a Space,
    pub(super) measured: &'a Measured,
    pub(super) options: Options,
    /// Where the runs that fit best stand, shape (runs, parameters).
    pub(super) near: &'a [Vec<f64>],
    /// Whether the emulator's mean is taken for the simulator.
    pub(super) is_exact: bool,
}

/// What the best fit says that can be reached from the runs.
struct Gap {
    correlated: Vec<bool>,
    test: ChiSquare,
}

impl Sampler<'_> {
    fn likelihood(&self, nuisances: Nuisances) -> Likelihood<'_> {
        let Self { surrogate, space, measured, .. } = self;
        let likelihood = Likelihood::new(surrogate, space, measured, nuisances);
        if self.is_exact { likelihood.of_exact_emulator() } else { likelihood }
    }

    /// The posterior, from near that of the first look and from the maxima next to the runs.
    ///
    /// Where the runs show that even the best of what they lead to is worse than the noise allows, noise that is
    /// larger than stated and correlated is admitted first. Otherwise that fit would stand no chance beside places
    /// of which nothing is known, and one after the other of these would have to be run and refuted.
    pub(super) fn settle(&self, nuisances: &Nuisances, first: &Population) -> Result<Outcome> {
        let gap = self.gap(nuisances)?;
        // What is not known of a place may fit where nothing does that is known; the closest fit is among what is.
        let is_exact = self.options.white && gap.is_some();
        let sampler = Self { is_exact, ..*self };
        let found = sampler.look(nuisances, first, gap)?;
        Ok(Outcome { population: sampler.refined(&found.nuisances, found.population)?, ..found })
    }

    /// The nuisances that the residuals speak for, and draws that need not have the right share of every tail yet.
    fn look(&self, nuisances: &Nuisances, first: &Population, gap: Option<Gap>) -> Result<Outcome> {
        if let Some(gap) = gap {
            let mut nuisances = self.with_correlation(nuisances, &gap.correlated);
            nuisances.inflation = !self.options.noise_as_stated && gap.test.is_worse();
            let population = self.sample(&nuisances, &parameters_of(&first.points, self.space))?;
            return Ok(Outcome {
                population,
                nuisances,
                correlated: gap.correlated,
                chi_square: Some(gap.test),
            });
        }
        let mut seen = first.points.clone();
        for mode in self.modes(&self.likelihood(nuisances.clone())) {
            seen.extend(self.about(&mode, nuisances, START_WIDTH)?);
        }
        let mut correlated = self.correlated(nuisances, seen);
        let mut nuisances = self.with_correlation(nuisances, &correlated);
        let mut population = self.sample(&nuisances, &first.points)?;
        let mut best = self.best(&nuisances, &population);
        let mut test = self.test(best.1, &population.points)?;
        if test.is_some_and(ChiSquare::is_worse) || self.is_missed(&nuisances, &best) {
            // The first look may have seen the wrong place: again, from the whole prior.
            let plain = Nuisances { correlation: vec![false; correlated.len()], ..nuisances.clone() };
            let again = self.sample_whole_prior(&plain)?;
            if self.best(&plain, &again).1.ln > best.1.ln + MISSED {
                correlated = self.correlated(&plain, again.points.clone());
                nuisances = self.with_correlation(&plain, &correlated);
                population = if nuisances == plain { again } else { self.sample(&nuisances, &again.points)? };
                best = self.best(&nuisances, &population);
                test = self.test(best.1, &population.points)?;
            }
        }
        if test.is_some_and(ChiSquare::is_worse) && !self.options.noise_as_stated {
            nuisances.inflation = true;
            population = self.sample(&nuisances, &parameters_of(&population.points, self.space))?;
        }
        Ok(Outcome { population, nuisances, correlated, chi_square: test })
    }

    /// What the highest maximum says that the emulator's mean has next to the runs, if it is worse than a stated noise
    /// allows, with all that the emulator does not know there.
    fn gap(&self, nuisances: &Nuisances) -> Result<Option<Gap>> {
        if !self.measured.is_known {
            return Ok(None);
        }
        let plain = self.likelihood(nuisances.clone());
        let Some(mode) = self.modes(&plain.of_exact_emulator()).into_iter().next() else { return Ok(None) };
        let points = self.about(&mode, nuisances, 1.0)?;
        let test = |likelihood: &Likelihood<'_>, points: &[Vec<f64>]| {
            let best = fittest(likelihood, points.to_vec(), 1).swap_remove(0);
            self.test(likelihood.fit(&best), points)
        };
        if !test(&plain, &points)?.is_some_and(ChiSquare::is_worse) {
            return Ok(None);
        }
        // A noise that is larger than stated is no correlation.
        let larger = Nuisances { inflation: !self.options.noise_as_stated, ..nuisances.clone() };
        let correlated = self.correlated(&larger, self.about(&mode, &larger, 1.0)?);
        let with = self.with_correlation(nuisances, &correlated);
        let test = test(&self.likelihood(with.clone()), &self.about(&mode, &with, 1.0)?)?;
        Ok(test.map(|test| Gap { correlated, test }))
    }

    /// The maxima that are reached from the runs that fit best.
    fn modes(&self, likelihood: &Likelihood<'_>) -> Vec<Mode> {
        modes(&Posterior(likelihood), &self.near[..CLIMBS.min(self.near.len())])
    }

    /// The maximum and points about it, with nuisances spread evenly.
    fn about(&self, mode: &Mode, nuisances: &Nuisances, width: f64) -> Result<Vec<Vec<f64>>> {
        let mut generator = ChaCha8Rng::seed_from_u64(self.options.seed ^ 0x30de);
        let mut points = mode.draws(AROUND, width, &mut generator);
        if !nuisances.is_empty() {
            let even = sequence::points(Method::Halton, AROUND, nuisances.len(), Some(self.options.seed))?;
            // The maximum itself, with each of them, too.
            points.extend(vec![mode.at().to_vec(); AROUND]);
            points.iter_mut().zip(even.iter().cycle()).for_each(|(point, even)| point.extend(even));
        }
        Ok(points)
    }

    /// The observables whose residuals are correlated, given points whose nuisances have no correlation.
    fn correlated(&self, nuisances: &Nuisances, mut points: Vec<Vec<f64>>) -> Vec<bool> {
        let extra = self.measured.observables();
        let likelihood = self.likelihood(Nuisances { correlation: vec![true; extra], ..nuisances.clone() });
        points.iter_mut().for_each(|x| x.extend(vec![0.0; extra]));
        let points = fittest(&likelihood, points, FITTEST);
        let by_likelihood = noise::correlated(&likelihood, &points, self.measured);
        // A noise that is smaller than stated would pass for a correlated one.
        let emulator = &self.surrogate.emulator;
        let scores = emulator.mean_scores(&self.space.coordinates(&points[0]));
        let curve = emulator.curve(&scores);
        let seen = noise::independent(&self.measured.residual(curve.as_slice()), self.measured);
        let is_fewer = |(j, seen): (usize, f64)| seen < self.measured.own(j).len() as f64;
        by_likelihood
            .into_iter()
            .zip(seen.into_iter().enumerate().map(is_fewer))
            .map(|(a, b)| a && b)
            .collect()
    }

    fn with_correlation(&self, nuisances: &Nuisances, correlated: &[bool]) -> Nuisances {
        let is_fixed = self.options.white || self.options.noise_as_stated && self.measured.is_known;
        let correlation = correlated.iter().map(|is| *is && !is_fixed).collect();
        Nuisances { correlation, ..nuisances.clone() }
    }

    /// The draw that fits best, and how well.
    fn best(&self, nuisances: &Nuisances, population: &Population) -> (Vec<f64>, Fit) {
        let likelihood = self.likelihood(nuisances.clone());
        let best = fittest(&likelihood, population.points.clone(), 1).swap_remove(0);
        let fit = likelihood.fit(&best);
        (best, fit)
    }

    /// Whether a run that was made stands where the likelihood is far above that of all draws.
    fn is_missed(&self, nuisances: &Nuisances, (best, fit): &(Vec<f64>, Fit)) -> bool {
        let likelihood = self.likelihood(nuisances.clone());
        self.near.iter().any(|place| {
            let mut x = place.clone();
            x.extend(&best[self.space.len()..]);
            likelihood.fit(&x).ln > fit.ln + MISSED
        })
    }

    fn test(&self, fit: Fit, points: &[Vec<f64>]) -> Result<Option<ChiSquare>> {
        if !self.measured.is_known {
            return Ok(None);
        }
        let taken = noise::decided(points, &prior_sd(self.space)?);
        Ok(Some(ChiSquare::new(fit, self.measured.values.len(), taken)))
    }

    /// Sample from the whole prior on.
    fn sample_whole_prior(&self, nuisances: &Nuisances) -> Result<Population> {
        let likelihood = self.likelihood(nuisances.clone());
        let seed = self.options.seed ^ 0x411;
        let start = from_prior(self.space, nuisances.len(), PARTICLES, seed)?;
        sample(&Posterior(&likelihood), None, start, Effort { moves: 1.5, last_moves: 4.0, sweeps: 8, seed })
    }

    /// Sample from mixtures about points that are near the posterior, shape (points, first dimensions), and about the
    /// maxima next to the runs.
    fn sample(&self, nuisances: &Nuisances, near: &[Vec<f64>]) -> Result<Population> {
        let seed = self.options.seed;
        let likelihood = self.likelihood(nuisances.clone());
        let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0xba5e);
        let modes = self.modes(&likelihood);
        let known =
            if modes.is_empty() { near[0].len().min(likelihood.dimensions()) } else { self.space.len() };
        let near: Vec<Vec<f64>> = near.iter().map(|x| x[..known].to_vec()).collect();
        let mut mixtures = vec![LocalMixture::new(&near, 200, 2.0, &mut generator)];
        for mode in &modes {
            let points = mode.draws(AROUND, START_WIDTH, &mut generator);
            mixtures.push(LocalMixture::new(&points, 50, 2.0, &mut generator));
        }
        let start = Start { mixtures, dimensions: known };
        let prior = from_prior(self.space, likelihood.nuisances().len(), PARTICLES, seed)?;
        let effort = Effort { moves: 1.5, last_moves: 2.0, sweeps: 8, seed: seed ^ 0xf00d };
        sample(&Posterior(&likelihood), Some(&start), prior, effort)
    }

    /// Draws in which every tail has its share.
    fn refined(&self, nuisances: &Nuisances, population: Population) -> Result<Population> {
        let likelihood = self.likelihood(nuisances.clone());
        let prior = |seed| from_prior(self.space, likelihood.nuisances().len(), PARTICLES, seed);
        refined(&Posterior(&likelihood), population, prior, self.options.seed)
    }
}

fn parameters_of(points: &[Vec<f64>], space: &Space) -> Vec<Vec<f64>> {
    points.iter().map(|x| x[..space.len()].to_vec()).collect()
}

/// Standard deviation of the prior in each coordinate that varies.
fn prior_sd(space: &Space) -> Result<Vec<f64>> {
    Ok(spreads(&from_prior(space, 0, 500, 0)?))
}

/// The points of the highest likelihood.
fn fittest(likelihood: &Likelihood<'_>, points: Vec<Vec<f64>>, count: usize) -> Vec<Vec<f64>> {
    let mut fits: Vec<(f64, Vec<f64>)> = points.into_par_iter().map(|x| (likelihood.fit(&x).ln, x)).collect();
    fits.sort_by(|a, b| b.0.total_cmp(&a.0));
    fits.truncate(count);
    fits.into_iter().map(|(_, x)| x).collect()
}
