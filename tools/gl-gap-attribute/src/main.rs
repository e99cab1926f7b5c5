//! Say which effect, if any, explains the gap between a simulation and a measurement.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags)]

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail, ensure};
use clap::Parser;
use gl_cli::measured::{Measured, Measurement};
use gl_gap::attribute::attribution::draws::{Drawn, draws};
use gl_gap::attribute::attribution::marginals::{Marginal, errors_of_the_rig, marginals};
use gl_gap::attribute::attribution::rest::{GoesWith, goes_with};
use gl_gap::attribute::attribution::{Attribution, Explanation, RuledOut};
use gl_gap::attribute::diagnosis::{self, Diagnosis, candidates, diagnose};
use gl_gap::attribute::next_runs::next_runs;
use gl_gap::attribute::problem::Problem;
use gl_gap::attribute::problem::simulation::Simulation;
use gl_gap::attribute::problem::test::Test;
use gl_gap::attribute::self_check::{Design, self_check, summary};
use gl_gap::attribute::verdict::noise::found as found_noise;
use gl_gap::attribute::verdict::verdict;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::{Observations, Steps};
use gl_inference::path::Path as Control;
use gl_inference::prior::Prior;
use gl_inference::rig::Kind;
use gl_inference::samples::{Samples, sample_names};
use gl_inference::units::Units;
use gl_table::TableWriter;

/// Say which effect, if any, explains the gap between a simulation and a measurement.
///
/// The runs of a design in which effects are switched on and off (gl-sample --effects pairs) train an
/// emulator. Every set of up to --max-effects effects is weighed against the measurement, and so is
/// that something else is at work (unexplained).
#[derive(Parser)]
#[command(name = "gl-gap-attribute", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters, with the columns effect and off
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Table of parameters as it was believed, where the bounds of --params are wider: what lies beyond it is less likely, and said first
    #[arg(long, value_name = "FILE")]
    prior: Option<PathBuf>,
    /// Samples of the design
    #[arg(short, long, value_name = "FILE")]
    samples: PathBuf,
    #[command(flatten)]
    measured: Measured,
    /// Steps to look at, from A up to but not including B; the rest is kept back, to foretell
    #[arg(long, value_name = "A:B")]
    steps: Option<Steps>,
    /// Effects of the measurement to consider, each in one test: offset, gain, drift, compliance (which takes the
    /// first observable for the load), lag
    #[arg(long, value_name = "KIND,…", value_delimiter = ',')]
    measurement: Vec<Kind>,
    /// Effects that may be at work together
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = gl_cli::few)]
    max_effects: usize,
    /// Share of the simulation's own scatter that the measurement has: towards 0 for a specimen of
    /// many more grains
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = gl_cli::scatter, allow_negative_numbers = true)]
    scatter: f64,
    /// Units of the controls, for the sentences, as in u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Also write the probability of each effect to be in: effect, probability
    #[arg(long, value_name = "FILE")]
    effects_out: Option<PathBuf>,
    /// Also write how far the gap should shrink with each likely hypothesis:
    /// hypothesis, shrink, shrink_low, shrink_high
    #[arg(long, value_name = "FILE")]
    predict_shrink: Option<PathBuf>,
    /// Also write what each hypothesis that is not out of the question says of the parameters:
    /// hypothesis, parameter, mean, sd, q05, q95, lean (-1, 1: on the lower, the upper bound; -2, 2: the
    /// measurement pulls it beyond)
    #[arg(long, value_name = "FILE")]
    posterior_out: Option<PathBuf>,
    /// Also write what the rest goes with, where the first hypothesis leaves one: observable, goes_with, share, z,
    /// like
    #[arg(long, value_name = "FILE")]
    rest_out: Option<PathBuf>,
    /// Also write the errors of the rig in the first hypothesis, as gl-collect --rig takes them: error, size, sd
    #[arg(long, value_name = "FILE")]
    rig_out: Option<PathBuf>,
    /// Also write the readings that look like outliers under the first hypothesis, for gl-gap-locate and gl-gap-shrink:
    /// observable, step
    #[arg(long, value_name = "FILE")]
    outliers_out: Option<PathBuf>,
    /// Also write how many times the stated noise readings scatter under the first hypothesis, where otherwise than stated, for
    /// gl-gap-locate: observable, scale
    #[arg(long, value_name = "FILE")]
    noise_out: Option<PathBuf>,
    /// Also write the mean curve of the base model, of each likely hypothesis and of the three likeliest with effects:
    /// hypothesis, probability, step, control, observables; with --test instead
    /// hypothesis, probability, test, observable, step, control, predicted
    #[arg(long, value_name = "FILE")]
    curves_out: Option<PathBuf>,
    /// Also write draws of the parameters under each likely set of effects, for gl-sensitivity --hypotheses: hypothesis,
    /// probability, parameters
    #[arg(long, value_name = "FILE")]
    draws_out: Option<PathBuf>,
    /// Also write what is concluded: code, value, text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Also write the samples to run next, which would teach the emulator most about this measurement:
    /// from the posteriors of all hypotheses that are not out of the question
    #[arg(long, value_name = "FILE")]
    next_out: Option<PathBuf>,
    /// Number of samples to run next; 10 for each parameter when absent
    #[arg(long, value_name = "N", requires = "next_out", value_parser = gl_cli::few)]
    next: Option<usize>,
    /// First part of the names of the samples to run next, <NAME>_Iter<i>_Sample<j>
    #[arg(long, default_value = "next", requires = "next_out")]
    name: String,
    /// Iteration number in those names
    #[arg(long, value_name = "I", default_value_t = 1, requires = "next_out")]
    iteration: usize,
    /// Threads a run, written as !OMP_NUM_THREADS for yade-batch
    #[arg(long, value_name = "T", requires = "next_out")]
    threads: Option<NonZeroUsize>,
    /// Call N runs of the design the measurement in turn, and say how often what is in them is found
    #[arg(long, value_name = "N", value_parser = gl_cli::few)]
    self_check: Option<usize>,
    /// Seed of the search and the sampling
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Where the table goes; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensembles of the design's runs, `-` for stdin; NAME=ENSEMBLE for each --test
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
}

const EXAMPLE: &str = "\
Example (a line with a bend that the base model lacks):
  printf 'name lower upper effect off\\na 0 2 - -\\n' > params.txt
  printf 'bend 0.1 2 bending 0\\n' >> params.txt
  gl-sample -p params.txt -n 60 --effects pairs -o samples.txt
  awk 'BEGIN { print \"sample step x y\" }
    NR > 1 { for (i = 0; i < 20; i++)
      print $1, i, i, $3 * i + $4 * i * i / 20 }' samples.txt > runs.tsv
  awk 'BEGIN { print \"x y\"
    for (i = 0; i < 20; i++)
      print i, i + 0.05 * i * i + 0.1 * sin(9 * i) }' > obs.txt
  gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y \\
    --noise y=0.1 runs.tsv";

/// Hypotheses less probable than this are not worth a prediction.
const LIKELY: f64 = 0.01;

/// Draws of each hypothesis that are written.
const DRAWS: usize = 200;

/// Sets of effects whose curves are written however improbable they are, so that one sees what speaks against them.
const NEAREST: usize = 3;

/// What was measured at the compared steps, and the runs there.
struct Seen {
    observations: Observations,
    tests: Vec<Test>,
    /// Number of the first compared step of each test, shape (tests,).
    first: Vec<usize>,
    /// The control of each test, all steps.
    whole: Vec<Control>,
    noise: Option<Vec<Vec<f64>>>,
    ensemble: Ensemble,
}

impl Seen {
    fn read(args: &Args) -> Result<Self> {
        let measurement = args.measured.read()?;
        let steps = measurement.steps(args.steps)?;
        let ensemble = measurement.ensemble("gl-gap-attribute", &args.ensembles)?;
        let Measurement { observations, noise, stack } = measurement;
        let path = |observations: &Observations| Control::new(&observations.control);
        if let Some(stack) = stack {
            let first = stack.tests.iter().map(|test| test.steps.start).collect();
            let whole = stack.tests.iter().map(|test| path(&test.observations)).collect();
            return Ok(Self { observations, tests: Test::of_stack(&stack), first, whole, noise, ensemble });
        }
        let whole = vec![path(&observations)];
        let all: Vec<usize> = (0..ensemble.len()).collect();
        let first = vec![steps.start];
        let observations = observations.part(steps.clone());
        let noise = noise.map(|noise| noise.iter().map(|noise| noise[steps.clone()].to_vec()).collect());
        let (tests, ensemble) = (Test::of(&observations), ensemble.part(&all, steps));
        Ok(Self { tests, first, whole, ensemble, observations, noise })
    }
}

/// What the parser cannot tell of the options.
fn check(args: &Args) -> Result<()> {
    for (i, kind) in args.measurement.iter().enumerate() {
        let is_new = !args.measurement[..i].contains(kind);
        let name = format!("{kind:?}").to_lowercase();
        ensure!(is_new, "--measurement: {name} is given twice; give each effect of the measurement once");
    }
    let outputs =
        [&args.output, &args.effects_out, &args.predict_shrink, &args.posterior_out, &args.rest_out];
    let more = [
        &args.rig_out,
        &args.outliers_out,
        &args.noise_out,
        &args.curves_out,
        &args.draws_out,
        &args.next_out,
        &args.verdict,
    ];
    gl_cli::distinct(outputs.into_iter().chain(more).map(Option::as_ref))?;
    ensure!(args.max_effects > 0, "--max-effects 0: consider at least one effect");
    ensure!(args.next != Some(0), "--next 0: run at least one sample next");
    sample_names(&args.name, args.iteration, 1).map(|_| ())
}

/// The prior as it was believed, and where it was read.
fn believed(path: &Path, prior: &Prior, args: &Args) -> Result<(Prior, String)> {
    let believed = Prior::read(path)?;
    let known = believed.names();
    if let Some(name) = prior.names().into_iter().find(|name| !known.contains(name)) {
        bail!(
            "{}: no row {name}, which {} has; --prior is the same parameters with the bounds that were believed",
            path.display(),
            args.params.display()
        );
    }
    Ok((believed, path.display().to_string()))
}

fn run(args: &Args) -> Result<()> {
    check(args)?;
    let prior = Prior::read(&args.params)?;
    let samples = Samples::read(&args.samples)?;
    let Seen { observations, tests, first, whole, noise, ensemble } = Seen::read(args)?;
    let believed = args.prior.as_ref().map(|path| believed(path, &prior, args)).transpose()?;
    let candidates = candidates(&prior, &samples, &ensemble, &args.measurement, &tests)?;
    let design = Design {
        prior: &prior,
        samples: &samples,
        ensemble: &ensemble,
        candidates: &candidates,
        scatter: args.scatter,
    };
    if let Some(count) = args.self_check {
        design.runs_to_check(args.max_effects, count)?;
    }
    let runs = (&samples, &ensemble);
    let simulation = Simulation::new(&prior, runs, &observations.values, noise.as_ref(), args.seed)?;
    if simulation.missing() > 0 {
        note(format_args!(
            "{} of {} samples have no run and are left out",
            simulation.missing(),
            samples.len()
        ));
    }
    if noise.is_none() {
        note("no noise is given: it is estimated with the fit; --noise makes the verdict sharper");
    }
    let measured = (&observations, tests.clone());
    let mut problem =
        Problem::of_tests(&simulation, &prior, candidates.clone(), measured, noise, args.scatter)?
            .in_units(&args.units);
    if let Some((believed, _)) = &believed {
        problem = problem.believing(believed);
    }
    let diagnosis = diagnose(&problem, args.max_effects, args.seed)?;
    let tested: Vec<(&Test, usize)> = tests.iter().zip(first).collect();
    write_beside(args, &problem, &diagnosis, (&observations, &tested, &samples))?;
    if let Some(path) = &args.rig_out {
        write_rig(path, &problem, &diagnosis, (&whole, &tested))?;
    }
    let believed = believed.as_ref().map(|(prior, path)| (prior, path.as_str()));
    let verdicts = verdict(&problem, &diagnosis, &args.params.display().to_string(), believed, args.seed)?;
    gl_cli::conclude("gl-gap-attribute", &verdicts, args.verdict.as_deref(), || {
        write(args.output.as_deref(), &diagnosis)
    })?;
    if let Some(count) = args.self_check {
        let noise = diagnosis::noise(&problem, &diagnosis);
        let measured = (&observations, tests.as_slice());
        let checked = self_check(&design, measured, &noise, args.max_effects, count, args.seed)?;
        summary(&checked).iter().for_each(note);
    }
    Ok(())
}

/// The tables that are asked for beside that of the hypotheses.
fn write_beside(
    args: &Args,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    (observations, tests, samples): (&Observations, &[(&Test, usize)], &Samples),
) -> Result<()> {
    if let Some(path) = &args.effects_out {
        write_effects(path, diagnosis)?;
    }
    if let Some(path) = &args.predict_shrink {
        write_shrink(path, problem, diagnosis, args.seed)?;
    }
    if let Some(path) = &args.posterior_out {
        write_posteriors(path, problem, diagnosis)?;
    }
    if let Some(path) = &args.rest_out {
        write_rest(path, problem, diagnosis)?;
    }
    if let Some(path) = &args.outliers_out {
        write_outliers(path, problem, diagnosis, tests)?;
    }
    if let Some(path) = &args.noise_out {
        write_noise(path, problem, diagnosis)?;
    }
    if let Some(path) = &args.curves_out {
        write_curves(path, tests, observations, diagnosis)?;
    }
    if let Some(path) = &args.draws_out {
        write_draws(path, problem, diagnosis)?;
    }
    if let Some(path) = &args.next_out {
        let count = args.next.unwrap_or(10 * problem.prior.parameters().len());
        write_next(path, count, args, (problem, diagnosis), samples)?;
    }
    Ok(())
}

fn write(path: Option<&Path>, diagnosis: &Diagnosis) -> Result<()> {
    let columns = [
        "hypothesis",
        "probability",
        "ln_evidence",
        "gap",
        "unexplained",
        "confounded_with",
        "ln_evidence_error",
        "closes",
        "ruled_out",
    ];
    let mut table = TableWriter::create(path, &columns)?;
    for row in &diagnosis.rows {
        table.text(&row.name).numbers(&[row.probability, row.ln_evidence, row.gap, row.left]);
        table.text(&row.confounded.join(",")).numbers(&[row.error, row.closes]);
        table.text(row.ruled_out.map_or("-", RuledOut::word)).end_row()?;
    }
    table.finish()
}

fn write_effects(path: &Path, diagnosis: &Diagnosis) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["effect", "probability"])?;
    for (name, probability) in &diagnosis.effects {
        table.text(name).number(*probability).end_row()?;
    }
    table.finish()
}

fn write_shrink(path: &Path, problem: &Problem<'_>, diagnosis: &Diagnosis, seed: u64) -> Result<()> {
    let columns = ["hypothesis", "shrink", "shrink_low", "shrink_high"];
    let mut table = TableWriter::create(Some(path), &columns)?;
    let Attribution { explanations } = &diagnosis.attribution;
    for of in explanations.iter().filter(|of| of.probability >= LIKELY && of.is_cause()) {
        let shrink = diagnosis::shrink(problem, diagnosis.attribution.base(), of, seed)?;
        table.text(&of.name).numbers(&[shrink.median, shrink.low, shrink.high]).end_row()?;
    }
    table.finish()
}

fn write_posteriors(path: &Path, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let columns = ["hypothesis", "parameter", "mean", "sd", "q05", "q95", "lean"];
    let mut table = TableWriter::create(Some(path), &columns)?;
    let leans = |of: &Explanation, parameter: &str| {
        let lean =
            diagnosis.leans.iter().find(|lean| lean.hypothesis == of.name && lean.parameter == parameter);
        lean.map(|lean| if lean.is_upper { 2.0 } else { -2.0 })
    };
    let is_said =
        |of: &&Explanation| !of.is_behind || diagnosis.leans.iter().any(|lean| lean.hypothesis == of.name);
    for of in diagnosis.attribution.explanations.iter().filter(is_said) {
        for Marginal { name, mean, sd, low, high, lean } in marginals(problem, of) {
            let lean = leans(of, &name).unwrap_or(f64::from(lean));
            table.text(&of.name).text(&name).numbers(&[mean, sd, low, high, lean]).end_row()?;
        }
    }
    table.finish()
}

fn write_outliers(
    path: &Path,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    tests: &[(&Test, usize)],
) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["observable", "step"])?;
    let steps = problem.by_observable(&diagnosis.first().singular.outliers);
    for (test, first) in tests {
        for j in test.observables.clone() {
            for step in &steps[j] {
                table.text(&problem.observables[j]).number((first + step) as f64).end_row()?;
            }
        }
    }
    table.finish()
}

fn write_noise(path: &Path, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["observable", "scale"])?;
    for (observable, scale) in found_noise(problem, diagnosis.first()) {
        table.text(observable).number(scale).end_row()?;
    }
    table.finish()
}

/// * `whole` — the control of each test at all steps, and the number of the first that was looked at.
fn write_rig(
    path: &Path,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    (whole, tests): (&[Control], &[(&Test, usize)]),
) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["error", "size", "sd"])?;
    for (error, Marginal { mean, sd, .. }) in errors_of_the_rig(problem, diagnosis.first()) {
        if error.kind != Kind::Drift {
            table.text(&error.name).numbers(&[mean, sd]).end_row()?;
            continue;
        }
        // What is known of a drift is what it made of the steps that were looked at.
        let (test, from) = tests[error.test];
        let travelled = whole[error.test].travelled();
        let (before, at_end) = (travelled[from], travelled[from + test.steps() - 1]);
        let unit = 1.0 / (at_end - before);
        table.text(&error.name).numbers(&[unit * mean, unit * sd]).end_row()?;
        if before > 0.0 {
            let since = -unit * before;
            let name = error.name.replacen(Kind::Drift.word(), Kind::Offset.word(), 1);
            table.text(&name).numbers(&[since * mean, -since * sd]).end_row()?;
        }
    }
    table.finish()
}

fn write_rest(path: &Path, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["observable", "goes_with", "share", "z", "like"])?;
    let first = diagnosis.first();
    let all = if first.has_rest { goes_with(problem, first)? } else { Vec::new() };
    for GoesWith { observable, what, share, z, like } in all {
        table.text(&problem.observables[observable]).text(&what).numbers(&[share, z]).text(like).end_row()?;
    }
    table.finish()
}

/// Explanations whose curves are written.
fn said(diagnosis: &Diagnosis) -> impl Iterator<Item = &Explanation> {
    let all = &diagnosis.attribution.explanations;
    let nearest = all.iter().filter(|of| of.is_cause() && !of.has_rest).take(NEAREST);
    let nearest: Vec<&str> =
        nearest.chain([diagnosis.attribution.base()]).map(|of| of.name.as_str()).collect();
    all.iter().filter(move |of| of.probability >= LIKELY || nearest.contains(&of.name.as_str()))
}

/// * `tests` — each with the number of the first of its compared steps; one without a name where there is no other.
fn write_curves(
    path: &Path,
    tests: &[(&Test, usize)],
    observations: &Observations,
    diagnosis: &Diagnosis,
) -> Result<()> {
    if let [(test, first)] = tests
        && test.name.is_empty()
    {
        return write_curves_of_one(path, *first, observations, diagnosis);
    }
    let columns = ["hypothesis", "probability", "test", "observable", "step", "control", "predicted"];
    let mut table = TableWriter::create(Some(path), &columns)?;
    for of in said(diagnosis) {
        for (test, first) in tests {
            for j in test.observables.clone() {
                let own = &observations.names[j][test.name.len() + 1..];
                let readings = test.path.control().iter().zip(&of.evidence.mean[test.own(j)]);
                for (step, (&control, &predicted)) in readings.enumerate() {
                    table.text(&of.name).number(of.probability).text(&test.name).text(own);
                    table.numbers(&[(first + step) as f64, control, predicted]).end_row()?;
                }
            }
        }
    }
    table.finish()
}

/// The first of the steps that were looked at is number `first` of the measurement.
fn write_curves_of_one(
    path: &Path,
    first: usize,
    observations: &Observations,
    diagnosis: &Diagnosis,
) -> Result<()> {
    let named = ["hypothesis", "probability", "step", &observations.control_name];
    let columns: Vec<&str> = named.into_iter().chain(observations.names.iter().map(String::as_str)).collect();
    let mut table = TableWriter::create(Some(path), &columns)?;
    for of in said(diagnosis) {
        for (step, &control) in observations.control.iter().enumerate() {
            let curves = of.evidence.mean.chunks_exact(observations.steps());
            table.text(&of.name).numbers(&[of.probability, (first + step) as f64, control]);
            table.numbers(&curves.map(|curve| curve[step]).collect::<Vec<_>>()).end_row()?;
        }
    }
    table.finish()
}

fn write_draws(path: &Path, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let columns: Vec<String> = ["hypothesis".to_owned(), "probability".to_owned()]
        .into_iter()
        .chain(problem.prior.names())
        .collect();
    let mut table = TableWriter::create(Some(path), &columns)?;
    let all = draws(problem, &diagnosis.attribution.explanations, LIKELY, DRAWS);
    for Drawn { name, probability, draws } in &all {
        for draw in draws {
            table.text(name).number(*probability).numbers(draw).end_row()?;
        }
    }
    table.finish()
}

fn write_next(
    path: &Path,
    count: usize,
    args: &Args,
    (problem, diagnosis): (&Problem<'_>, &Diagnosis),
    samples: &Samples,
) -> Result<()> {
    let names = sample_names(&args.name, args.iteration, count)?;
    let made = samples.columns(&problem.prior.names())?;
    let Diagnosis { attribution, untried, .. } = diagnosis;
    let values = next_runs(problem, &attribution.explanations, untried, &made, (count, args.seed))?;
    Samples { source: "samples".to_owned(), names, parameters: problem.prior.names(), values }
        .write(Some(path), args.threads.map(NonZeroUsize::get))
}

fn note(message: impl std::fmt::Display) {
    gl_cli::note("gl-gap-attribute", message);
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-gap-attribute",
        gl_cli::about(
            run(&args),
            args.ensembles.iter().chain([&args.samples, &args.params]).chain(args.measured.tables()),
        ),
    )
}
