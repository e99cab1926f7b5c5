//! The posterior of the parameters through an emulator.
//!
//! A run of the simulator is dear and one of its emulator cheap, so the posterior is sampled through the
//! emulator, with what this does not know as a part of the covariance; see [`likelihood`]. [`infer`] trains
//! the emulator where it matters, holds the noise against what was stated, samples by [`smc`] and says how
//! far all this can be trusted; [`Inference::next_runs`] says which runs would tell most.

mod asked;
mod batch;
mod curves;
mod first_look;
mod held_out;
pub mod likelihood;
pub mod mixture;
mod modes;
pub mod noise;
mod proof;
pub mod scatter;
mod settle;
pub mod smc;
pub mod space;
mod start;
pub mod summary;
pub mod surrogate;
mod widening;

use std::collections::HashSet;

use anyhow::{Result, ensure};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_progress::stage;

use asked::Asked;
use first_look::{first_look, nuisances, of_whole_prior};
use likelihood::{Likelihood, Measured, NoiseAt, Nuisances};
use noise::ChiSquare;
pub use proof::Proof;
use space::Space;
use surrogate::{PLAIN, Ranked, Surrogate};

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    /// The parameters and their prior.
    pub prior: &'a Prior,
    /// Samples of the runs.
    pub samples: &'a Samples,
    /// The runs.
    pub ensemble: &'a Ensemble,
    /// The measurement.
    pub observations: &'a Observations,
    /// Standard deviation of its noise, shape (observables, steps), if it is known.
    pub noise: Option<&'a [Vec<f64>]>,
    /// Where it is not known: what the noise is a share of, shape (observables, steps); the largest size of a value of each
    /// observable if absent.
    pub scale: Option<&'a [Vec<f64>]>,
    /// Steps that are compared.
    pub steps: std::ops::Range<usize>,
    /// Names of the samples of the newest batch, which the runs before are asked to predict; none for the
    /// first batch.
    pub newest: &'a [String],
}

/// What may be chosen.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Share of the variance of the simulation's scatter that the measurement has too; estimated with the
    /// fit if absent.
    pub scatter: Option<f64>,
    /// Whether the noise is taken as stated, whatever the residuals say.
    pub noise_as_stated: bool,
    /// Whether the noise is taken for white, however correlated the residuals are.
    pub white: bool,
    /// Number of draws.
    pub draws: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { scatter: None, noise_as_stated: false, white: false, draws: 1000, seed: 0 }
    }
}

/// A posterior and what it rests on.
#[derive(Clone, Debug)]
pub struct Inference {
    /// The space that was sampled.
    pub space: Space,
    /// Draws of equal weight in its coordinates, nuisances behind the parameters, shape (draws, dimensions).
    pub points: Vec<Vec<f64>>,
    /// Values of all parameters, shape (draws, parameters).
    pub values: Vec<Vec<f64>>,
    /// Misfit of each draw, rᵀΣ⁻¹r, shape (draws,).
    pub misfit: Vec<f64>,
    /// Mean over observables and steps of |r| over the observable's range, shape (draws,).
    pub error: Vec<f64>,
    /// ln of the evidence.
    pub ln_evidence: f64,
    /// The emulator.
    pub surrogate: Surrogate,
    /// What is not known of the noise.
    pub nuisances: Nuisances,
    /// Noise and scatter at each draw.
    pub noise: Vec<NoiseAt>,
    /// How the best fit compares with the noise as stated, with its scatter and correlation; absent where
    /// the noise was not stated.
    pub chi_square: Option<ChiSquare>,
    /// What the best fit leaves, tested without what the emulator or the simulation's scatter make of it, of which neither
    /// alternates.
    pub left: gl_inference::fit::Fit,
    /// Independent readings among the residuals of the best fit.
    pub independent_readings: f64,
    /// Standard deviation of ln likelihood within the posterior by what the emulator does not know, the root of
    /// its mean square; see [`Likelihood::ignorance`].
    pub ignorance: f64,
    /// Relative error of the posterior's standard deviations for the number of runs that the patterns of the
    /// simulation's scatter are known by.
    pub scatter_error: f64,
    /// Largest change of a mean, in standard deviations, if the emulator were exact.
    pub shift_if_known: f64,
    /// Smallest ratio of a standard deviation if the emulator were exact.
    pub ratio_if_known: f64,
    /// How the newest batch came out against what was predicted of it.
    pub proof: Option<Proof>,
    /// The runs, from the best.
    pub runs: Vec<Run>,
    /// Names of the observables.
    pub observables: Vec<String>,
    /// Whether the residuals of each are correlated from step to step.
    pub correlated: Vec<bool>,
    /// Where they stand, in the same order, shape (runs, parameters that vary).
    pub places: Vec<Vec<f64>>,
    /// Where samples stand that have no run, shape (samples, parameters that vary).
    pub failed: Vec<Vec<f64>>,
    /// Whether all runs have the same curves.
    pub are_alike: bool,
    measured: Measured,
}

/// A real run beside the posterior.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Name of its sample.
    pub name: String,
    /// Its misfit with the noise alone, summed.
    pub misfit: f64,
    /// Mean over observables and steps of |r| over the observable's range.
    pub error: f64,
}

/// From so many runs a parameter, and so many more, an emulator must follow the simulator.
const ENOUGH_RUNS: (usize, usize) = (15, 10);

/// Errors of the newest batch, in standard deviations of what was predicted, and of the runs near the posterior,
/// in those of the noise and by their kurtosis, from which a simulator is too rough for an emulator.
const UNFIT_Z: f64 = 3.0;
const UNFIT_ERROR: f64 = 1.0;
const UNFIT_KURTOSIS: f64 = 9.0;

/// From so many runs a parameter it must know enough, too: ln likelihood to this.
const MANY_RUNS: usize = 30;
const UNFIT_IGNORANCE: f64 = 2.0;

/// An emulator of the best runs alone that leaves more of ln likelihood open than this may know less than one of all
/// runs.
const BLIND: f64 = 1.0;

/// The posterior of the parameters that vary from sample to sample.
///
/// The result depends on neither the number of threads nor the order of the runs.
///
/// # Errors
/// If no emulator can be trained, or nothing in the prior has a density above zero.
pub fn infer(question: &Question<'_>, options: Options) -> Result<Inference> {
    ensure!(
        question.ensemble.is_empty() || question.ensemble.curve_sd(0, 0).is_none(),
        "{}: has _sd columns; an emulator is trained on runs, not on what an emulator predicted",
        question.ensemble.source
    );
    let stage = stage("sampling the posterior", 3);
    let space = Space::new(question.prior, question.samples)?;
    let (measured, ensemble, first) = first_look(question, &space, options.seed)?;
    let nuisances = nuisances(&first, &space, &measured, options);
    let likelihood = Likelihood::new(&first, &space, &measured, nuisances.clone());
    let population = of_whole_prior(&likelihood, &space, options.seed)?;
    stage.advance();

    let ranked = Ranked::new(&space, question.samples, &ensemble, &measured);
    let mut ranked = ranked.by_prediction(&first.emulator, &measured)?;
    stage.advance();
    let newest: HashSet<&str> = question.newest.iter().map(String::as_str).collect();
    let plain = || ranked.without(&newest).by(PLAIN, &measured, options.seed).ok();
    let before = if newest.is_empty() { None } else { plain() };
    if let Some(before) = &before {
        ranked = ranked.starting_from(before);
    }
    let near: Vec<Vec<f64>> = ranked.places()?.into_iter().take(ranked.near()).collect();
    let samples = question.samples;
    let asked = Asked {
        samples,
        options,
        space: &space,
        measured: &measured,
        ensemble: &ensemble,
        ranked,
        near,
        newest,
        before,
        nuisances,
        population,
    };
    let inference = asked.through(asked.ranked.best(&measured, options.seed, true)?)?;
    stage.advance();
    if !inference.surrogate.recipe.is_local || inference.ignorance <= BLIND {
        return Ok(inference);
    }
    // An emulator of the best runs alone knows nothing of where the others have shown that nothing fits.
    let of_all = asked.through(asked.ranked.best(&measured, options.seed, false)?)?;
    Ok(if of_all.ignorance < inference.ignorance { of_all } else { inference })
}

impl Inference {
    /// Parameters of `count` runs that would tell most, shape (count, parameters), the most useful first.
    ///
    /// # Errors
    /// If there are more parameters than a sequence has dimensions.
    pub fn next_runs(&self, count: usize, seed: u64) -> Result<Vec<Vec<f64>>> {
        let likelihood =
            Likelihood::new(&self.surrogate, &self.space, &self.measured, self.nuisances.clone());
        let importance = likelihood.importance(&self.noise[0]).diagonal().iter().copied().collect();
        let draws: Vec<Vec<f64>> = self.points.iter().map(|x| x[..self.space.len()].to_vec()).collect();
        let choice = batch::Choice {
            emulator: &self.surrogate.emulator,
            space: &self.space,
            draws: &draws,
            runs: &self.places,
            failed: &self.failed,
            importance,
            calibration: self.surrogate.calibration,
        };
        Ok(choice.next(count, seed)?.iter().map(|x| self.space.values(x)).collect())
    }

    /// Whether no emulator follows the simulator, with runs enough to: the newest batch is far from what was
    /// predicted of it, errors are large now and then that are small otherwise, or it still knows too little.
    pub fn is_unfit(&self) -> bool {
        let is_enough = self.runs.len() >= ENOUGH_RUNS.0 * self.space.len() + ENOUGH_RUNS.1;
        let is_far = self.proof.is_some_and(|proof| proof.z > UNFIT_Z && proof.error > UNFIT_ERROR);
        let is_rough = self.surrogate.kurtosis > UNFIT_KURTOSIS && self.surrogate.rmse > UNFIT_ERROR;
        let is_many = self.runs.len() >= MANY_RUNS * self.space.len() + ENOUGH_RUNS.1;
        is_enough && (is_far || is_rough) || is_many && self.ignorance > UNFIT_IGNORANCE
    }

    /// The measurement as it was compared.
    pub fn measured(&self) -> &Measured {
        &self.measured
    }
}

#[cfg(test)]
mod tests {
    use gl_inference::prior::normal_quantile;
    use gl_numeric::statistics::{mean, sd};
    use gl_table::Table;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const STEPS: usize = 20;

    /// y = a u, a over two decades, with a scatter in proportion to it, and a measurement in the middle.
    fn seen_by_logarithm(scatter: f64, reach: f64) -> bool {
        let table = format!("name lower upper scale effect off\na {} {reach} log - -\n", 1.0 / reach);
        let prior = Prior::from_table(&Table::parse("params.txt", table.into()).unwrap()).unwrap();
        let observations = Observations {
            source: "obs.txt".to_owned(),
            control_name: "u".to_owned(),
            control: (0..STEPS).map(|step| step as f64).collect(),
            names: vec!["f".to_owned()],
            values: vec![(0..STEPS).map(|step| (step as f64 + 1.0) / STEPS as f64).collect()],
            far_off: Vec::new(),
            sd: vec![None],
        };
        let mut generator = ChaCha8Rng::seed_from_u64(4);
        let mut ensemble = Ensemble::new(&observations, false);
        let names = gl_inference::samples::sample_names("test", 0, 30).unwrap();
        let values: Vec<Vec<f64>> =
            (0..30).map(|i| vec![prior.parameters()[0].quantile((i as f64 + 0.5) / 30.0)]).collect();
        for (name, value) in names.iter().zip(&values) {
            let size = value[0] * (1.0 + scatter * normal_quantile(generator.random::<f64>()));
            ensemble.push(name, &[observations.values[0].iter().map(|y| size * y).collect()], None);
        }
        let samples = Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
        let noise = vec![vec![0.02; STEPS]];
        let question = Question {
            prior: &prior,
            samples: &samples,
            ensemble: &ensemble,
            observations: &observations,
            noise: Some(&noise),
            scale: None,
            steps: 0..STEPS,
            newest: &[],
        };
        let inference = infer(&question, Options { scatter: Some(1.0), ..Options::default() }).unwrap();
        inference.measured.warps[0].is_some()
    }

    #[test]
    fn what_scatters_is_seen_by_its_logarithm_only_where_runs_are_much_further_off() {
        assert!(seen_by_logarithm(0.0, 10.0));
        assert!(!seen_by_logarithm(0.2, 10.0));
        assert!(seen_by_logarithm(0.2, 100.0));
        assert!(!seen_by_logarithm(0.0, 3.0));
    }

    /// How far measurements of one specimen each are off in the mean, in standard deviations, squared: y = a √u with a scatter
    /// of as many patterns as there are readings.
    fn square_of_what_is_off(measurements: u64) -> f64 {
        let prior = "name lower upper scale effect off\na 1 3 linear - -\n";
        let prior = Prior::from_table(&Table::parse("params.txt", prior.into()).unwrap()).unwrap();
        let of_seed = |seed: u64| {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            let mut curve = |a: f64| -> Vec<f64> {
                let sizes: Vec<f64> = (0..STEPS)
                    .map(|k| 0.2 / (k + 1) as f64 * normal_quantile(generator.random::<f64>()))
                    .collect();
                let wave = |k: usize, o: usize| {
                    (k as f64 * (o as f64 + 0.5) * std::f64::consts::PI / STEPS as f64).cos()
                };
                let of = |o: usize| {
                    a * ((o + 1) as f64 / STEPS as f64).sqrt()
                        + (0..STEPS).map(|k| sizes[k] * wave(k, o)).sum::<f64>()
                };
                (0..STEPS).map(of).collect()
            };
            let observations = Observations {
                source: "obs.txt".to_owned(),
                control_name: "u".to_owned(),
                control: (0..STEPS).map(|step| step as f64).collect(),
                names: vec!["f".to_owned()],
                values: vec![curve(2.0)],
                far_off: Vec::new(),
                sd: vec![None],
            };
            let names = gl_inference::samples::sample_names("test", 0, 32).unwrap();
            let values: Vec<Vec<f64>> = (0..32).map(|i| vec![1.0 + (i as f64 + 0.5) / 16.0]).collect();
            let mut ensemble = Ensemble::new(&observations, false);
            for (name, value) in names.iter().zip(&values) {
                ensemble.push(name, &[curve(value[0])], None);
            }
            let samples =
                Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
            let question = Question {
                prior: &prior,
                samples: &samples,
                ensemble: &ensemble,
                observations: &observations,
                noise: Some(&[vec![0.001; STEPS]]),
                scale: None,
                steps: 0..STEPS,
                newest: &[],
            };
            let options = Options { scatter: Some(1.0), ..Options::default() };
            let draws: Vec<f64> =
                infer(&question, options).unwrap().values.iter().map(|row| row[0]).collect();
            let even = vec![1.0 / draws.len() as f64; draws.len()];
            ((mean(&draws, &even) - 2.0) / sd(&draws, &even)).powi(2)
        };
        (0..measurements).map(of_seed).sum::<f64>() / measurements as f64
    }

    #[test]
    fn a_posterior_by_a_scatter_of_many_patterns_is_off_by_as_much_as_it_claims() {
        let square = square_of_what_is_off(24);
        assert!((0.4..1.8).contains(&square), "{square}");
    }
}
