//! The measurement as an emulator sees it, and a first emulator, of few runs.

use anyhow::Result;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;

use super::likelihood::{Likelihood, Measured, NoiseAt, Nuisances, Posterior};
use super::settle::from_prior;
use super::smc::{Effort, Population, sample};
use super::space::Space;
use super::surrogate::{Ranked, Surrogate};
use super::{Options, Question};
use crate::warp::{self, FAR, FAR_OF_SCATTER, scatters};

/// Particles for a first look.
const FIRST_PARTICLES: usize = 600;

/// Below this share of the noise's variance, the simulation's scatter makes no difference.
const SCATTER_COUNTS: f64 = 0.02;

/// The measurement and the runs as an emulator sees them, and one of few runs.
pub(super) fn first_look(
    question: &Question<'_>,
    space: &Space,
    seed: u64,
) -> Result<(Measured, Ensemble, Surrogate)> {
    let observations = question.observations.part(question.steps.clone());
    let all: Vec<usize> = (0..question.ensemble.len()).collect();
    let runs = question.ensemble.part(&all, question.steps.clone()).without_far_off(&observations);
    let look = |far: f64| -> Result<(Measured, Ensemble, Surrogate)> {
        let measured = measured(question, &observations, &runs, far);
        let ensemble = warp::seen(&runs, &measured.warps);
        let first = Ranked::new(space, question.samples, &ensemble, &measured).first_look(&measured, seed)?;
        Ok((measured, ensemble, first))
    };
    let (measured, ensemble, first) = look(FAR)?;
    if measured.warps.iter().any(|warp| warp.is_some()) && scatters(&first.emulator) {
        return look(FAR_OF_SCATTER);
    }
    Ok((measured, ensemble, first))
}

/// Draws through a first emulator, from the whole prior on.
pub(super) fn of_whole_prior(likelihood: &Likelihood<'_>, space: &Space, seed: u64) -> Result<Population> {
    let start = from_prior(space, likelihood.nuisances().len(), FIRST_PARTICLES, seed)?;
    let effort = Effort { moves: 2.0, last_moves: 3.0, sweeps: 8, seed };
    sample(&Posterior(likelihood), None, start, effort)
}

/// What is compared of the steps of a measurement: its readings but for those that are far off. Runs that reach so many
/// times beyond them are warped.
fn measured(question: &Question<'_>, whole: &Observations, runs: &Ensemble, far: f64) -> Measured {
    let observations = whole.without_far_off();
    let lengths = observations.values.iter().map(Vec::len);
    let starts: Vec<usize> = std::iter::once(0)
        .chain(lengths.scan(0, |end, length| {
            *end += length;
            Some(*end)
        }))
        .collect();
    let ranges = observations.sizes();
    let base = match question.noise.or(question.scale) {
        Some(noise) => {
            let of = |(j, noise): (usize, &Vec<f64>)| whole.near(j, cut(noise, &question.steps));
            noise.iter().enumerate().flat_map(of).collect()
        }
        None => {
            let sizes = observations.values.iter().zip(&ranges).map(|(values, range)| {
                let largest = values.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
                if largest > 0.0 { largest } else { *range }
            });
            sizes.zip(&observations.values).flat_map(|(size, values)| vec![size; values.len()]).collect()
        }
    };
    let base: Vec<f64> = base;
    let warps = warp::warps(&observations.values, runs, far);
    let readings = observations.values.concat();
    let observable_of = |o: usize| starts.partition_point(|start| *start <= o) - 1;
    let of = |o: usize| (warps[observable_of(o)], readings[o]);
    Measured {
        values: (0..readings.len()).map(|o| of(o).0.there(of(o).1)).collect(),
        base: base.iter().enumerate().map(|(o, sd)| sd * of(o).0.slope(of(o).1)).collect(),
        noise: base,
        readings,
        warps,
        is_known: question.noise.is_some(),
        starts,
        ranges,
    }
}

/// The part of an observable at the steps that are compared; one of a shorter test has fewer.
fn cut<'a>(values: &'a [f64], steps: &std::ops::Range<usize>) -> &'a [f64] {
    &values[steps.start.min(values.len())..steps.end.min(values.len())]
}

/// What is not known of the noise, before the residuals have been looked at.
pub(super) fn nuisances(
    first: &Surrogate,
    space: &Space,
    measured: &Measured,
    options: Options,
) -> Nuisances {
    let mut nuisances = Nuisances {
        scatter: Some(options.scatter.unwrap_or(1.0)),
        ln_noise: None,
        inflation: false,
        correlation: vec![false; measured.observables()],
    };
    if !measured.is_known {
        let share = |j: usize| measured.ranges[j] / measured.noise[measured.own(j).start];
        let shares: Vec<f64> = (0..measured.observables()).map(share).collect();
        let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
        let most = shares.iter().copied().fold(0.0, f64::max);
        nuisances.ln_noise = Some(((1e-5 * least).ln(), (2.0 * most).ln()));
    }
    if options.scatter.is_none() && scatter_counts(first, space, measured, &nuisances) {
        nuisances.scatter = None;
    }
    nuisances
}

/// Whether the simulation's scatter is large enough to make a difference.
fn scatter_counts(surrogate: &Surrogate, space: &Space, measured: &Measured, nuisances: &Nuisances) -> bool {
    let exact = NoiseAt { scatter: 0.0, variance: 1.0, correlation: vec![0.0; measured.observables()] };
    let likelihood = Likelihood::new(surrogate, space, measured, nuisances.clone());
    let importance = likelihood.importance(&exact);
    let counts = (surrogate.scatter.of_scores(&surrogate.emulator, measured) * importance).trace();
    // Where the noise is not known, what counts is not either.
    !measured.is_known || counts > SCATTER_COUNTS * space.len() as f64
}
