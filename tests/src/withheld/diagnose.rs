//! Diagnose every case from what a user would have.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use gl_gap::attribute::attribution::closure::Foretold;
use gl_gap::attribute::attribution::marginals::{Marginal, marginals};
use gl_gap::attribute::diagnosis;
use gl_gap::attribute::diagnosis::{Diagnosis, shrink};
use gl_gap::attribute::next_runs::next_runs;
use gl_gap::attribute::problem::Problem;
use gl_gap::attribute::problem::hypothesis::Candidate;
use gl_gap::attribute::problem::measurement::MeasurementEffect;
use gl_gap::attribute::problem::predictor::Predictor;
use gl_gap::attribute::problem::simulation::Simulation;
use gl_gap::attribute::rounds::{Course, Rounds, Standing, Step};
use gl_gap::attribute::settled::{is_settled, may_be_noise};
use gl_gap::attribute::winner::cause;
use gl_gap::design_box::{self, Limit, Pull, widen};
use gl_inference::design::{self, Effects};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::{ByName, Observations};
use gl_inference::prior::Prior;
use gl_inference::rig::Kind;
use gl_inference::samples::Samples;
use gl_numeric::sequence::Method;
use gl_table::{Table, TableWriter};
use rayon::prelude::*;

use super::bench::Bench;
use super::exact::Exact;
use super::generate::KINDS;
use super::weigh;

/// How every case is diagnosed.
#[derive(Clone, Copy, Debug)]
pub struct How {
    /// Runs of the design, an input of the emulator.
    pub runs: usize,
    /// Whether they are made in rounds, until one says what the one before did, as `gl-diagnose` does.
    pub in_rounds: bool,
    /// Whether the world itself predicts, not an emulator: the best that any emulator could do.
    pub exact: bool,
    /// Seed of the design.
    pub seed: u64,
}

impl How {
    /// Runs of the first round, an input of the emulator.
    fn first(self) -> usize {
        if self.in_rounds { Rounds { all: self.runs }.first() } else { self.runs }
    }
}

/// A switch design, whose first round cases with the same candidates of the simulation and the same specimens share.
struct Design {
    prior: Prior,
    samples: Samples,
    ensemble: Ensemble,
    is_scattered: bool,
}

impl Design {
    /// These runs and further ones as iteration `round`, with a prior that may be wider.
    fn with_runs(
        &self,
        bench: &Bench,
        (prior, values): (Prior, Vec<Vec<f64>>),
        (round, specimens): (usize, u64),
    ) -> Result<Self> {
        let (samples, more) = bench.run(&prior, values, self.is_scattered, round, specimens)?;
        let samples = Samples::concatenate(vec![self.samples.clone(), samples])?;
        let mut ensemble = self.ensemble.clone();
        for (run, name) in more.samples.iter().enumerate() {
            ensemble.push(name, &more.curves(run), None);
        }
        Ok(Self { prior, samples, ensemble, is_scattered: self.is_scattered })
    }
}

/// A measurement, and the effects of the measurement that may be behind it.
struct Case {
    observations: Observations,
    kinds: Vec<Kind>,
    /// Seed of the specimens that are run for it.
    specimens: u64,
}

/// Read `DIR/cases` and write `DIR/verdicts.tsv` and `DIR/hypotheses.tsv`. The first round of runs is made once for all
/// cases with the same candidates.
///
/// # Errors
/// If a case cannot be read or diagnosed.
pub fn diagnose(bench: &Bench, how: How, dir: &Path) -> Result<()> {
    let cases = dir.join("cases");
    let list = Table::read(&cases.join("cases.tsv"))?;
    let observables = bench.observables();
    let read = |row: usize| -> Result<Case> {
        let path = cases.join(format!("{}_obs.txt", list.field(row, 0)));
        let observations = Observations::read(&path, bench.world.control(), &observables)?;
        let named = |name: &str| KINDS.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind);
        let kinds = list.field(row, 3).split(',').filter_map(named).collect();
        Ok(Case { observations, kinds, specimens: how.seed + 1 + row as u64 })
    };
    let measured: Vec<Case> = (0..list.len()).map(read).collect::<Result<_>>()?;
    let mut designs: BTreeMap<(String, String), Design> = BTreeMap::new();
    let design_of = |row: usize| (list.field(row, 1).to_owned(), list.field(row, 2).to_owned());
    for key in (0..list.len()).map(design_of) {
        if designs.contains_key(&key) {
            continue;
        }
        let left_out: Vec<&str> = key.0.split(',').collect();
        let is_scattered = key.1 == "yes";
        let (samples, ensemble) = bench.design(&left_out, is_scattered, how.first(), how.seed)?;
        let prior = bench.prior_without(&left_out);
        designs.insert(key, Design { prior, samples, ensemble, is_scattered });
    }
    let verdicts = measured
        .par_iter()
        .enumerate()
        .map(|(row, case)| verdict(bench, how, &designs[&design_of(row)], case))
        .collect::<Result<Vec<_>>>()?;
    write(&list, &verdicts, &dir.join("verdicts.tsv"))?;
    write_parameters(&list, &verdicts, &dir.join("parameters.tsv"))?;
    let cases = (0..list.len()).map(|row| list.field(row, 0));
    let explanations = verdicts.iter().map(|of| of.diagnosis.attribution.explanations.as_slice());
    weigh::write(cases.zip(explanations), dir)
}

/// What a case comes down to.
struct Verdict {
    diagnosis: Diagnosis,
    is_settled: bool,
    /// How far the gap should close, if an effect comes first.
    closes: Option<Foretold>,
    /// What is known of the parameters under what comes first.
    parameters: Vec<Marginal>,
    /// Whether the prior was made wider.
    is_wider: bool,
    /// Runs of the design.
    runs: usize,
}

fn verdict(bench: &Bench, how: How, shared: &Design, case: &Case) -> Result<Verdict> {
    let Case { observations, kinds, specimens } = case;
    let simulated = shared.prior.effects().into_iter().map(Candidate::Simulated);
    let measured = MeasurementEffect::of_tests(kinds, &observations.names, &bench.tests());
    let candidates: Vec<Candidate> = simulated.chain(measured.into_iter().map(Candidate::Measured)).collect();
    let noise = observations.noise(&ByName::default())?;
    let all = how.runs * shared.prior.parameters().len();
    let rounds = Rounds { all };
    let mut own = None::<Design>;
    let mut course = Course::new(rounds, None);
    let simulation = |design: &Design| {
        let runs = (&design.samples, &design.ensemble);
        Simulation::new(&design.prior, runs, &observations.values, noise.as_ref(), how.seed)
    };
    let diagnosed = |design: &Design, simulation: &Simulation| -> Result<(Verdict, Standing)> {
        let world =
            how.exact.then(|| Exact::new(bench, &design.prior, simulation, observations)).transpose()?;
        let predictor = world.as_ref().map_or(simulation as &dyn Predictor, |world| world);
        let problem =
            problem(bench, predictor, &design.prior, &candidates, observations)?.believing(&shared.prior);
        let diagnosis = diagnosis::diagnose(&problem, 2, how.seed)?;
        let named = Some(diagnosis.first()).filter(|first| first.is_cause());
        let base = diagnosis.attribution.base();
        let closes = named.map(|named| shrink(&problem, base, named, how.seed)).transpose()?;
        let parameters = marginals(&problem, diagnosis.first());
        let is_settled = is_settled(&problem, &diagnosis);
        let standing = Standing {
            cause: cause(&diagnosis.first().name).to_owned(),
            probability: diagnosis.stated(),
            is_beside_a_rest: diagnosis.first().has_rest,
            ignorance: diagnosis.least_known(),
            is_untried: !diagnosis.untried.is_empty(),
            is_unsettled: !is_settled && !may_be_noise(&diagnosis),
        };
        let is_wider = design_box::with_beyond(&shared.prior, &design.prior)?.is_some();
        let runs = design.ensemble.len();
        Ok((Verdict { diagnosis, is_settled, closes, parameters, is_wider, runs }, standing))
    };
    let mut round = 1;
    loop {
        let design = own.as_ref().unwrap_or(shared);
        let simulation = simulation(design)?;
        let (found, now) = diagnosed(design, &simulation)?;
        if !how.in_rounds {
            return Ok(found);
        }
        let first = &found.diagnosis.first().name;
        let leans: Vec<Pull> = found.diagnosis.leans.iter().map(|lean| Pull::beyond(lean, first)).collect();
        let wider = if course.may_widen() {
            widen(&shared.prior, &design.prior, &leans, Limit::Beyond)?
        } else {
            None
        };
        let count = course.pointed();
        let (prior, values) = match (course.next(now, wider.is_some()), wider) {
            (Step::Widen, Some(wider)) => {
                let seed = how.seed + round as u64;
                let values =
                    design::draw(&wider, &Effects::Pairs, Method::Halton, rounds.wider(), seed, true)?;
                (wider, values)
            }
            (Step::Point | Step::Further, _) => {
                let problem = problem(bench, &simulation, &design.prior, &candidates, observations)?
                    .believing(&shared.prior);
                let diagnosis = &found.diagnosis;
                let explanations = &diagnosis.attribution.explanations;
                let made = design.samples.columns(&design.prior.names())?;
                let runs = next_runs(&problem, explanations, &diagnosis.untried, &made, (count, how.seed))?;
                (design.prior.clone(), runs)
            }
            (Step::Widen | Step::End, _) => return Ok(found),
        };
        let specimens = specimens + 10_000 * (round as u64 - 1);
        own = Some(design.with_runs(bench, (prior, values), (round, specimens))?);
        round += 1;
    }
}

fn problem<'a>(
    bench: &Bench,
    predictor: &'a dyn Predictor,
    prior: &'a Prior,
    candidates: &[Candidate],
    observations: &Observations,
) -> Result<Problem<'a>> {
    let noise = observations.noise(&ByName::default())?;
    Problem::of_tests(predictor, prior, candidates.to_vec(), (observations, bench.tests()), noise, 1.0)
}

fn write(list: &Table, verdicts: &[Verdict], path: &Path) -> Result<()> {
    let columns = [
        "case",
        "first",
        "probability",
        "settled",
        "with_rest",
        "closes",
        "unproven",
        "leans",
        "widened",
        "nearest",
        "confounded",
        "shrink",
        "shrink_low",
        "shrink_high",
        "effects",
        "runs",
    ];
    let mut table = TableWriter::create(Some(path), &columns)?;
    for (row, Verdict { diagnosis, is_settled, closes, is_wider, runs, .. }) in verdicts.iter().enumerate() {
        let (first, attribution) = (diagnosis.first(), &diagnosis.attribution);
        table.text(list.field(row, 0)).text(cause(&first.name));
        table.numbers(&[diagnosis.stated()]).yes_no(*is_settled);
        table.yes_no(first.has_rest).number(first.closes);
        table.yes_no(diagnosis.is_unproven());
        let leans: Vec<&str> = diagnosis.leans.iter().map(|lean| lean.parameter.as_str()).collect();
        table.text(&leans.join(",")).yes_no(*is_wider);
        let nearest = attribution.nearest().map_or("none", |of| cause(&of.name));
        let confounded: Vec<&str> = diagnosis.rows[0].confounded.iter().map(|name| cause(name)).collect();
        table.text(nearest).text(&confounded.join(","));
        let closes = closes.unwrap_or(Foretold { median: 0.0, low: 0.0, high: 0.0 });
        table.numbers(&[closes.median, closes.low, closes.high]);
        table.text(&effects(&diagnosis.effects)).number(*runs as f64).end_row()?;
    }
    table.finish()
}

fn write_parameters(list: &Table, verdicts: &[Verdict], path: &Path) -> Result<()> {
    let mut table =
        TableWriter::create(Some(path), &["case", "hypothesis", "parameter", "mean", "sd", "q05", "q95"])?;
    for (row, verdict) in verdicts.iter().enumerate() {
        for Marginal { name, mean, sd, low, high, .. } in &verdict.parameters {
            table.text(list.field(row, 0)).text(&verdict.diagnosis.first().name);
            table.text(name).numbers(&[*mean, *sd, *low, *high]).end_row()?;
        }
    }
    table.finish()
}

/// Candidates and their probabilities, in a word.
pub fn effects(effects: &[(String, f64)]) -> String {
    let one = |(name, probability): &(String, f64)| format!("{name}={probability:.4}");
    effects.iter().map(one).collect::<Vec<_>>().join(",")
}
