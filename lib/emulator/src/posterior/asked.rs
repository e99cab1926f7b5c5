//! The posterior through one emulator of several.

use std::collections::HashSet;

use anyhow::Result;
use gl_inference::ensemble::Ensemble;
use gl_inference::samples::Samples;
use gl_numeric::statistics::{mean, sd};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::likelihood::{Fit, Likelihood, Measured, NoiseAt, Nuisances};
use super::settle::{Outcome, Sampler};
use super::smc::Population;
use super::space::Space;
use super::surrogate::{MOST_CALIBRATION, PLAIN, Ranked, Recipe, Surrogate};
use super::{Inference, Options, Proof, Run, noise, proof};

/// Probability below which a batch is not as it was predicted.
const DISPROVEN: f64 = 0.01;

/// Draws whose likelihoods are compared in pairs.
const PAIRED: usize = 400;

/// What all emulators of one question have in common.
pub(super) struct Asked<'a> {
    pub(super) samples: &'a Samples,
    pub(super) options: Options,
    pub(super) space: &'a Space,
    pub(super) measured: &'a Measured,
    /// The runs as an emulator sees them.
    pub(super) ensemble: &'a Ensemble,
    pub(super) ranked: Ranked<'a>,
    /// Where the runs that fit best stand, shape (runs, parameters).
    pub(super) near: Vec<Vec<f64>>,
    pub(super) newest: HashSet<&'a str>,
    /// What the runs before the newest say: these are held against it, and the search for lengths starts there, too.
    pub(super) before: Option<Surrogate>,
    pub(super) nuisances: Nuisances,
    /// Draws of a first look.
    pub(super) population: Population,
}

impl Asked<'_> {
    /// An emulator of the runs before the newest, as this recipe has it.
    fn before(&self, recipe: Recipe) -> Option<Surrogate> {
        let before = self.before.as_ref()?;
        if recipe == PLAIN {
            return Some(before.clone());
        }
        let earlier = self.ranked.without(&self.newest);
        Some(earlier.by(recipe, self.measured, self.options.seed).unwrap_or_else(|_| before.clone()))
    }

    /// The posterior through an emulator.
    pub(super) fn through(&self, mut surrogate: Surrogate) -> Result<Inference> {
        let Self { space, measured, options, .. } = *self;
        let before = self.before(Recipe { is_kept: false, ..surrogate.recipe });
        let prove = |variance: f64, reach: f64| match &before {
            Some(before) => {
                let measured = (measured, variance, reach);
                proof::prove(before, &self.ranked, &self.newest, measured, space, self.samples)
            }
            None => Ok(None),
        };
        let proof = prove(1.0, 0.0)?;
        if let Some(proof) = proof.filter(|proof| proof.p < DISPROVEN) {
            // What was predicted too boldly may well be so again: of both widths the larger.
            surrogate.calibration = surrogate.calibration.max(proof.z * proof.z).min(MOST_CALIBRATION);
        }
        if let Some(proof) = proof.filter(|proof| options.white && proof.has_less_scatter()) {
            // A fit of least squares is to come as close as it can; a posterior had better be wide where in doubt.
            surrogate.scatter = surrogate.scatter.times((proof.error / proof.scatter).powi(2));
        }
        let sampler =
            Sampler { surrogate: &surrogate, space, measured, options, near: &self.near, is_exact: false };
        let outcome = sampler.settle(&self.nuisances, &self.population)?;
        // What counts depends on how large the noise turned out to be, and on where the posterior lies.
        let reach = proof::reach(&surrogate, &outcome.population.points, measured, space);
        let proof = prove(outcome.variance(space), reach)?;
        self.finish(surrogate, outcome, proof)
    }

    /// What the draws come to.
    fn finish(&self, surrogate: Surrogate, outcome: Outcome, proof: Option<Proof>) -> Result<Inference> {
        let Self { samples, options, space, measured, ensemble, .. } = *self;
        let Outcome { population, nuisances, correlated, chi_square } = outcome;
        let likelihood = Likelihood::new(&surrogate, space, measured, nuisances.clone());
        // What is concluded does not depend on how few draws are asked for.
        let enough = options.draws.max(Options::default().draws);
        let mut points = thinned(&population.points, enough, options.seed);
        let residual = |x: &Vec<f64>| measured.residual(surrogate.curve(space, x).as_slice());
        let mut residuals: Vec<Vec<f64>> = points.par_iter().map(residual).collect();
        let mut fits: Vec<Fit> = points.par_iter().map(|x| likelihood.fit(x)).collect();
        let mut noise: Vec<NoiseAt> = points.iter().map(|x| likelihood.noise_at(x)).collect();
        let best = (0..fits.len()).max_by(|&a, &b| fits[a].ln.total_cmp(&fits[b].ln)).unwrap_or(0);
        let pairs: Pairs<'_> = points.chunks_exact(2).take(PAIRED / 2).zip(noise.iter().step_by(2)).collect();
        let ignorance = ignorance(&likelihood, &pairs);
        let degrees = surrogate.emulator.runs().len().saturating_sub(space.len() + 1).max(1) as f64;
        // The variance of n runs is known to √(2/n).
        let scatter_error = taken(&likelihood, &pairs) * (0.5 / degrees).sqrt();
        let (shift_if_known, ratio_if_known) = if_known(&likelihood, &points, &fits, space.len());
        let left = noise::test(&residuals[best], measured, space.len());
        let independent_readings = noise::independent(&residuals[best], measured).iter().sum();
        points.truncate(options.draws);
        residuals.truncate(options.draws);
        fits.truncate(options.draws);
        noise.truncate(options.draws);
        let (runs, places) = real_runs(&self.ranked, space, measured, (samples, ensemble))?;
        let failed = failed(space, samples, ensemble)?;
        Ok(Inference {
            values: points.iter().map(|x| space.values(x)).collect(),
            misfit: fits.iter().map(|fit| fit.square).collect(),
            error: residuals.iter().map(|residual| measured.error(residual)).collect(),
            ln_evidence: population.ln_evidence,
            left,
            independent_readings,
            chi_square,
            ignorance,
            scatter_error,
            shift_if_known,
            ratio_if_known,
            proof,
            runs,
            observables: ensemble.observables.clone(),
            correlated,
            places,
            failed,
            are_alike: ensemble.len() > 1
                && (1..ensemble.len()).all(|run| ensemble.curves(run) == ensemble.curves(0)),
            noise,
            nuisances,
            points,
            measured: measured.clone(),
            surrogate,
            space: space.clone(),
        })
    }
}

/// Some of the points, evenly from a random order; all of them and some again where more are wanted.
fn thinned(points: &[Vec<f64>], count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0xd4a3);
    let order = rand::seq::index::sample(&mut generator, points.len(), points.len()).into_vec();
    order.iter().cycle().take(count).map(|&i| points[i].clone()).collect()
}

/// Draws in pairs, with the noise at the first of each.
type Pairs<'a> = Vec<(&'a [Vec<f64>], &'a NoiseAt)>;

/// See [`Inference::ignorance`].
fn ignorance(likelihood: &Likelihood<'_>, pairs: &Pairs<'_>) -> f64 {
    let squares: Vec<f64> =
        pairs.par_iter().map(|(pair, noise)| likelihood.ignorance(&pair[0], &pair[1], noise)).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).max(0.0).sqrt()
}

/// Share of what the measurement says that the simulation's scatter takes away.
fn taken(likelihood: &Likelihood<'_>, pairs: &Pairs<'_>) -> f64 {
    let information: Vec<(f64, f64)> =
        pairs.par_iter().map(|(pair, noise)| likelihood.information(&pair[0], &pair[1], noise)).collect();
    let (without, with) =
        information.into_iter().fold((0.0, 0.0), |(a, b), (without, with)| (a + without, b + with));
    if without > 0.0 { (1.0 - with / without).clamp(0.0, 1.0) } else { 0.0 }
}

/// The runs from the best, and where they stand, shape (runs, parameters that vary).
fn real_runs(
    ranked: &Ranked<'_>,
    space: &Space,
    measured: &Measured,
    (samples, ensemble): (&Samples, &Ensemble),
) -> Result<(Vec<Run>, Vec<Vec<f64>>)> {
    let values = samples.columns(&space.prior().names())?;
    let index = samples.index();
    let of = |&run: &usize| {
        let residual = measured.residual(&ensemble.curves(run).concat());
        let name = ensemble.samples[run].clone();
        let place = index.get(name.as_str()).map_or(Vec::new(), |&i| space.place(&values[i]));
        let misfit = residual.iter().zip(&measured.noise).map(|(r, sd)| (r / sd).powi(2)).sum();
        (Run { name, misfit, error: measured.error(&residual) }, place)
    };
    let mut runs: Vec<(Run, Vec<f64>)> = ranked.order.iter().map(of).collect();
    runs.sort_by(|(a, _), (b, _)| a.misfit.total_cmp(&b.misfit).then_with(|| a.name.cmp(&b.name)));
    Ok(runs.into_iter().unzip())
}

/// Where samples stand that have no run, shape (samples, parameters that vary).
fn failed(space: &Space, samples: &Samples, ensemble: &Ensemble) -> Result<Vec<Vec<f64>>> {
    let done: HashSet<&String> = ensemble.samples.iter().collect();
    let values = samples.columns(&space.prior().names())?;
    let failed = samples.names.iter().zip(&values).filter(|(name, _)| !done.contains(name));
    Ok(failed.map(|(_, values)| space.place(values)).collect())
}

/// How mean and standard deviation would change if the emulator's mean were exact: the largest shift in
/// standard deviations, and the smallest ratio.
fn if_known(likelihood: &Likelihood<'_>, points: &[Vec<f64>], fits: &[Fit], parameters: usize) -> (f64, f64) {
    let ln_weight: Vec<f64> =
        points.par_iter().zip(fits).map(|(x, fit)| likelihood.fit_if_known(x).ln - fit.ln).collect();
    let Ok(weights) = gl_numeric::statistics::normalised(&ln_weight) else { return (f64::INFINITY, 0.0) };
    let even = vec![1.0 / points.len() as f64; points.len()];
    let (mut shift, mut ratio) = (0.0_f64, f64::INFINITY);
    for j in 0..parameters {
        let column: Vec<f64> = points.iter().map(|x| x[j]).collect();
        let spread = sd(&column, &even).max(f64::MIN_POSITIVE);
        shift = shift.max((mean(&column, &weights) - mean(&column, &even)).abs() / spread);
        ratio = ratio.min(sd(&column, &weights) / spread);
    }
    (shift, ratio)
}
