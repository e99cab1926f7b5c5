//! From tables to a diagnosis: the candidates of a design, an emulator of its runs, and what follows
//! from them for one measurement.

use anyhow::{Result, ensure};

use crate::attribute::attribution::closure::{self, Fitted, Foretold};
use crate::attribute::attribution::confounding::confounded;
use crate::attribute::attribution::lean::{Lean, leans};
use crate::attribute::attribution::untried::{Untried, ignorance, unproven, untried};
use crate::attribute::attribution::{Attribution, Explanation, RuledOut, attribute};
use crate::attribute::evidence::model::Model;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use crate::attribute::problem::test::Test;
use gl_inference::ensemble::Ensemble;
use gl_inference::prior::Prior;
use gl_inference::rig::Kind;
use gl_inference::samples::Samples;

/// What may explain a gap: the effects of the prior, which act in all tests, and those of the measurement, each in its
/// own.
///
/// # Errors
/// If there are none, a run is no sample, an effect is on in no run, or in every one, or an observable is the same in every
/// run.
pub fn candidates(
    prior: &Prior,
    samples: &Samples,
    ensemble: &Ensemble,
    kinds: &[Kind],
    tests: &[Test],
) -> Result<Vec<Candidate>> {
    let runs = samples.of_runs(&prior.names(), ensemble)?;
    let effects = prior.effects();
    for effect in &effects {
        let on = runs.iter().filter(|run| prior.is_on(effect, run)).count();
        let design = format!(
            "make the design with `gl-sample -p params.txt -n {} --effects pairs` and run it",
            25 * prior.parameters().len()
        );
        ensure!(on > 0, "{}: the effect {} is on in no run; {design}", ensemble.source, effect.name);
        ensure!(
            on < ensemble.len(),
            "{}: the effect {} is on in every run, so that the base model is not among them; {design}",
            ensemble.source,
            effect.name
        );
    }
    let mut all: Vec<Candidate> = effects.into_iter().map(Candidate::Simulated).collect();
    let measured = MeasurementEffect::of_tests(kinds, &ensemble.observables, tests);
    all.extend(measured.into_iter().map(Candidate::Measured));
    let names = ensemble.observables.iter().enumerate().filter(|_| !ensemble.is_empty());
    for (j, name) in names {
        let first = ensemble.curve(0, j);
        ensure!(
            (1..ensemble.len()).any(|run| ensemble.curve(run, j) != first),
            "{}: {name} is the same in every run, so that no parameter can explain it; leave it out",
            ensemble.source
        );
    }
    ensure!(
        !all.is_empty(),
        "no candidate effect; name some in the column effect of the parameters, each with its value off, \
         or give --measurement"
    );
    Ok(all)
}

/// One row of a diagnosis.
#[derive(Clone, Debug)]
pub struct Row {
    /// The hypothesis.
    pub name: String,
    /// Its probability.
    pub probability: f64,
    /// ln evidence.
    pub ln_evidence: f64,
    /// Standard error of it from the sampling.
    pub error: f64,
    /// Root mean square of (measured − mean curve) / range.
    pub gap: f64,
    /// Share of the base model's gap that is left, above what noise and scatter alone would give.
    pub left: f64,
    /// Share of the base model's gap that its effects close by themselves.
    pub closes: f64,
    /// Names of the hypotheses that the measurement cannot tell it from.
    pub confounded: Vec<String>,
    /// Why it has no probability, if so.
    pub ruled_out: Option<RuledOut>,
}

/// What follows from a measurement.
pub struct Diagnosis {
    /// All hypotheses, most probable first, in the order of the explanations.
    pub rows: Vec<Row>,
    /// Probability of each candidate to be in, in their order, with a rest or without.
    pub effects: Vec<(String, f64)>,
    /// Probabilities, evidences and posteriors.
    pub attribution: Attribution,
    /// The gap that noise and scatter alone would leave of the most probable explanation.
    pub floor: f64,
    /// Parameters that the measurement pulls beyond their bounds under hypotheses that matter.
    pub leans: Vec<Lean>,
    /// What the emulator does not know where the first explanation fits best, in units of noise and scatter.
    pub ignorance: f64,
    /// Effects that are not to be ruled out yet, or not to be called the cause where they come first, since the emulator knows too
    /// little of them.
    pub untried: Vec<Untried>,
}

impl Diagnosis {
    /// The most probable explanation.
    pub fn first(&self) -> &Explanation {
        self.attribution.first()
    }

    /// Probability of what comes first: of its effects, with a rest and without.
    pub fn stated(&self) -> f64 {
        self.attribution.probability_of(self.first())
    }

    /// The one of the others that the measurement can least tell from the first.
    pub fn confounded(&self) -> Option<&Explanation> {
        let name = self.rows[0].confounded.first()?;
        self.attribution.explanations.iter().find(|of| of.name == *name)
    }

    /// Whether effects come first of which the emulator knows too little to call them the cause.
    pub fn is_unproven(&self) -> bool {
        self.first().is_cause() && self.untried.iter().any(|of| of.place == 0)
    }

    /// The most that the emulator does not know where the first explanation fits best, or an untried effect, in units of
    /// noise and scatter.
    pub fn least_known(&self) -> f64 {
        self.untried.iter().fold(self.ignorance, |most, of| most.max(of.ignorance))
    }
}

/// Weigh every set of up to `largest` candidates against the measurement.
///
/// # Errors
/// If no hypothesis can be evaluated.
pub fn diagnose(problem: &Problem<'_>, largest: usize, seed: u64) -> Result<Diagnosis> {
    let attribution = attribute(problem, largest, seed)?;
    let explanations = &attribution.explanations;
    let confounded = confounded(problem, explanations)?;
    let floor = floor(problem, attribution.first())?;
    let before = closure::gap(problem, &attribution.base().evidence.mean);
    let row = |(explanation, confounded): (&Explanation, &Vec<usize>)| {
        let gap = closure::gap(problem, &explanation.evidence.mean);
        Row {
            name: explanation.name.clone(),
            probability: explanation.probability,
            ln_evidence: explanation.evidence.ln,
            error: explanation.evidence.error,
            gap,
            left: closure::left(before, gap, floor),
            closes: explanation.closes,
            confounded: confounded.iter().map(|&other| explanations[other].name.clone()).collect(),
            ruled_out: explanation.ruled_out,
        }
    };
    let rows: Vec<Row> = explanations.iter().zip(&confounded).map(row).collect();
    let effects = problem
        .candidates
        .iter()
        .enumerate()
        .map(|(i, candidate)| (candidate.name().to_owned(), attribution.probability_of_effects(&[i])))
        .collect();
    let leans = leans(problem, explanations)?;
    let ignorance = ignorance(problem, attribution.first());
    let mut untried = untried(problem, explanations);
    untried.extend(unproven(attribution.first(), rows[0].left, ignorance));
    Ok(Diagnosis { rows, effects, attribution, floor, leans, ignorance, untried })
}

fn floor(problem: &Problem<'_>, explanation: &Explanation) -> Result<f64> {
    let model = explanation.model(problem).plain();
    closure::floor(&model, &explanation.best()[..model.len()])
}

/// Predict how far the gap of the base model shrinks once the effects of an explanation are in the simulation.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn shrink(problem: &Problem<'_>, base: &Explanation, of: &Explanation, seed: u64) -> Result<Foretold> {
    let (before, after) = (base.model(problem), of.model(problem));
    closure::predicted_shrink(&fitted(&before, base), &fitted(&after, of), seed)
}

/// The gap that an explanation leaves where it comes closest to the measurement, by the noise as it is stated.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn closest_gap(problem: &Problem<'_>, of: &Explanation) -> Result<f64> {
    closure::closest_gap(&fitted(&of.model(problem), of))
}

fn fitted<'a>(model: &'a Model<'a>, of: &'a Explanation) -> Fitted<'a> {
    Fitted { model, mode: &of.evidence.modes[0], mean: &of.evidence.mean }
}

/// The noise as standard deviations, shape (observables, steps), as estimated with the most probable
/// explanation.
pub fn noise(problem: &Problem<'_>, diagnosis: &Diagnosis) -> Vec<Vec<f64>> {
    let first = diagnosis.first();
    let scales = first.model(problem).nuisances(first.best()).scales;
    let sd = |(block, scale): (std::ops::Range<usize>, &f64)| {
        problem.units[block].iter().map(|unit| scale * unit).collect()
    };
    problem.blocks().into_iter().zip(&scales).map(sd).collect()
}
