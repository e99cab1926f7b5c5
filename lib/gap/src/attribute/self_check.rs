//! How good the diagnosis is on this very problem: runs of the design as measurements.

use anyhow::{Result, ensure};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::attribute::attribution::{UNEXPLAINED, attribute};
use crate::attribute::evidence::mode::standard_normal;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Candidate, Hypothesis, name};
use crate::attribute::problem::simulation::Simulation;
use crate::attribute::problem::test::Test;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_progress::stage;

/// A run that was called the measurement.
#[derive(Clone, Debug)]
pub struct Checked {
    /// The run.
    pub sample: String,
    /// What was in it: `none`, or effects joined by `+`.
    pub truth: String,
    /// What came first, with a rest or without.
    pub first: String,
    /// Its probability.
    pub probability: f64,
}

/// Share of the runs that is taken out of the design at once, at most.
const AT_ONCE: usize = 10;

/// What the diagnosis needs besides the measurement.
pub struct Design<'a> {
    /// The parameters.
    pub prior: &'a Prior,
    /// The samples.
    pub samples: &'a Samples,
    /// Their runs.
    pub ensemble: &'a Ensemble,
    /// Candidates of the measurement and of the simulator.
    pub candidates: &'a [Candidate],
    /// Share of the simulation's scatter that a measurement has.
    pub scatter: f64,
}

impl Design<'_> {
    /// The candidates that are on in each run.
    fn truths(&self) -> Result<Vec<Hypothesis>> {
        let values = self.samples.of_runs(&self.prior.names(), self.ensemble)?;
        let is_on = |candidate: &Candidate, values: &[f64]| match candidate {
            Candidate::Measured(_) => false,
            Candidate::Simulated(effect) => self.prior.is_on(effect, values),
        };
        let truth = |values: &Vec<f64>| {
            (0..self.candidates.len()).filter(|&i| is_on(&self.candidates[i], values)).collect()
        };
        Ok(values.iter().map(truth).collect())
    }

    /// The runs that have up to `largest` effects on, and what is on in each run.
    ///
    /// # Errors
    /// If there are fewer than `count`.
    pub fn runs_to_check(&self, largest: usize, count: usize) -> Result<(Vec<usize>, Vec<Hypothesis>)> {
        let truths = self.truths()?;
        let runs: Vec<usize> = (0..truths.len()).filter(|&run| truths[run].len() <= largest).collect();
        ensure!(
            count <= runs.len(),
            "--self-check {count}: {} of {} runs have up to {largest} effects on and can be called the measurement; give at most {}",
            runs.len(),
            truths.len(),
            runs.len()
        );
        Ok((runs, truths))
    }
}

/// Take `count` runs out of the design, up to a tenth of it at a time, add noise to each, and diagnose
/// it by an emulator of the runs that are left. Only runs with up to `largest` effects are taken.
///
/// * `noise` — standard deviations, shape (observables, steps).
///
/// # Errors
/// If there are not so many runs, or the rest is too few for an emulator.
pub fn self_check(
    design: &Design<'_>,
    (observations, tests): (&Observations, &[Test]),
    noise: &[Vec<f64>],
    largest: usize,
    count: usize,
    seed: u64,
) -> Result<Vec<Checked>> {
    let (mut runs, truths) = design.runs_to_check(largest, count)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    runs.shuffle(&mut random);
    runs.truncate(count);
    let group = (design.ensemble.len() / AT_ONCE).max(1);
    let stage = stage("checking itself", count);
    let mut checked = Vec::new();
    for taken in runs.chunks(group) {
        let mut rest = Ensemble::new(observations, false);
        rest.source.clone_from(&design.ensemble.source);
        for run in (0..design.ensemble.len()).filter(|run| !taken.contains(run)) {
            rest.push(&design.ensemble.samples[run], &design.ensemble.curves(run), None);
        }
        let noise_of_all = noise.to_vec();
        let runs = (design.samples, &rest);
        let simulation =
            Simulation::new(design.prior, runs, &observations.values, Some(&noise_of_all), seed)?;
        for &run in taken {
            let mut measured = observations.clone();
            for (j, values) in measured.values.iter_mut().enumerate() {
                for (t, value) in values.iter_mut().enumerate() {
                    *value = design.ensemble.curve(run, j)[t] + noise[j][t] * standard_normal(&mut random);
                }
            }
            let candidates = design.candidates.to_vec();
            let simulation = simulation.seen_from(&measured.values);
            let problem = Problem::of_tests(
                &simulation,
                design.prior,
                candidates,
                (&measured, tests.to_vec()),
                Some(noise.to_vec()),
                design.scatter,
            )?;
            let attribution = attribute(&problem, largest, seed)?;
            let best = attribution.first();
            let cause = if best.is_unknown() {
                UNEXPLAINED.to_owned()
            } else {
                name(&best.hypothesis, design.candidates)
            };
            checked.push(Checked {
                sample: design.ensemble.samples[run].clone(),
                truth: name(&truths[run], design.candidates),
                first: cause,
                probability: attribution.probability_of(best),
            });
            stage.advance();
        }
    }
    Ok(checked)
}

/// What the checks say, by what was in the runs, one sentence an item.
pub fn summary(checked: &[Checked]) -> Vec<String> {
    let right = |of: &[&Checked]| of.iter().filter(|check| check.first == check.truth).count();
    let all: Vec<&Checked> = checked.iter().collect();
    let confidently_wrong: Vec<&Checked> = checked
        .iter()
        .filter(|check| {
            check.first != check.truth
                && check.probability > 0.9
                && !matches!(check.first.as_str(), "none" | UNEXPLAINED)
        })
        .collect();
    let mut lines = vec![format!(
        "self-check: in {} of {} runs what was in them came first; in {} something else did with probability above 0.9",
        right(&all),
        all.len(),
        confidently_wrong.len()
    )];
    let mut truths: Vec<&str> = checked.iter().map(|check| check.truth.as_str()).collect();
    truths.sort_unstable();
    truths.dedup();
    for truth in truths {
        let own: Vec<&Checked> = checked.iter().filter(|check| check.truth == truth).collect();
        lines.push(format!("self-check: {truth}: {} of {}", right(&own), own.len()));
    }
    lines
}
