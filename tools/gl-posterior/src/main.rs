//! Draw from the posterior through an emulator, and say where to run next.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail, ensure};
use clap::Parser;
use gl_cli::measured::{Measured, Measurement, Outliers};
use gl_emulator::posterior::{Inference, Options, Question, infer};
use gl_inference::loo::{self, LeftOut, Reading};
use gl_inference::misfit::{Covariance, Scaling};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_inference::prior::Prior;
use gl_inference::samples::{Samples, sample_names};
use gl_table::write_rows;

/// Draw from the posterior through an emulator, and say where to run next
///
/// An emulator learns from the runs, and the posterior is sampled through it, with what it does not know
/// counted as a part of the noise. The table holds draws of equal weight.
#[derive(Parser)]
#[command(name = "gl-posterior", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Samples of the runs; repeat for several batches, the newest last: it is held against what the others
    /// predict of it
    #[arg(short, long, value_name = "FILE", required = true)]
    samples: Vec<PathBuf>,
    #[command(flatten)]
    measured: Measured,
    #[command(flatten)]
    outliers: Outliers,
    /// What an unknown noise is a share of: max, value, range or none
    #[arg(long, value_name = "SCALE", default_value = "max")]
    scale: Scaling,
    /// How much an observable counts where the noise is not known, as an inverse weight; one of several tests is
    /// called TEST.OBSERVABLE
    #[arg(long, value_name = "NAME=W,…")]
    weights: Option<ByName>,
    /// Share of the variance of the simulation's scatter that the measurement has too; by default estimated
    /// with the fit, between 0 and 1
    #[arg(long, value_name = "F", value_parser = gl_cli::scatter, allow_negative_numbers = true)]
    scatter: Option<f64>,
    /// Take the noise as it is stated, however correlated or large the residuals are
    #[arg(long)]
    noise_as_stated: bool,
    /// Take the noise for white, however correlated the residuals are, and larger than stated where they are: the fit of
    /// least squares, which comes closest to the measurement
    #[arg(long, conflicts_with = "noise_as_stated")]
    white: bool,
    /// Steps to compare, from A up to but not including B
    #[arg(long, value_name = "A:B")]
    steps: Option<Steps>,
    /// Seed of the draws
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Number of draws
    #[arg(short = 'n', long, value_name = "DRAWS", default_value_t = 1000, value_parser = gl_cli::few)]
    num: usize,
    /// Where the samples to run next go
    #[arg(long, value_name = "FILE", requires = "next")]
    next_out: Option<PathBuf>,
    /// Number of samples to run next
    #[arg(long, value_name = "N", requires = "next_out", value_parser = gl_cli::few)]
    next: Option<usize>,
    /// Name of the samples to run next
    #[arg(long, value_name = "NAME", default_value = "gl")]
    name: String,
    /// Iteration of the samples to run next; by default the number of batches so far
    #[arg(long, value_name = "I")]
    iteration: Option<usize>,
    /// Threads a run, for Yade
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Where the summary goes: quantity value
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    /// Where the conclusions go: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the real runs go, with the share of the posterior that each stands for
    #[arg(long, value_name = "FILE")]
    run_weights: Option<PathBuf>,
    /// Where the summary of the real runs by these weights goes
    #[arg(long, value_name = "FILE")]
    run_summary: Option<PathBuf>,
    /// Where each reading goes, predicted from the others: observable step control measured q05 … q95 pit k
    #[arg(long, value_name = "FILE")]
    loo_out: Option<PathBuf>,
    /// Where what the draws predict of each reading goes: observable step control mean sd q05 q50 q95
    #[arg(long, value_name = "FILE")]
    curves_out: Option<PathBuf>,
    /// Where the draws go; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensembles of the runs; NAME=ENSEMBLE for each --test
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-posterior -p params.txt -s samples.txt -b obs.txt -c u -v f \\
    --noise f=0.02 --summary posterior.txt --next 4 --next-out next.txt \\
    ensemble.txt -o draws.txt
Example (several tests of the same samples):
  gl-posterior -p params.txt -s samples.txt \\
    --test first:obs.txt:u:f:f=0.02 --test second:obs.txt:u:f:f=0.02 \\
    first=ensemble.txt second=ensemble.txt -o draws.txt";

/// The most samples to run next: their covariances are held.
const MOST_NEXT: usize = 1000;

fn run(args: &Args) -> Result<()> {
    let of_runs = [&args.run_weights, &args.run_summary, &args.next_out];
    let outputs = [&args.output, &args.summary, &args.verdict, &args.loo_out, &args.curves_out]
        .into_iter()
        .chain(of_runs);
    gl_cli::distinct(outputs.map(Option::as_ref))?;
    let prior = Prior::read(&args.params)?;
    let tables = args.samples.iter().map(|path| Samples::read(path)).collect::<Result<Vec<_>>>()?;
    let newest = if tables.len() > 1 { tables[tables.len() - 1].names.clone() } else { Vec::new() };
    let samples = Samples::concatenate(tables)?;
    let measurement = args.outliers.marked_in_all(args.measured.read()?)?;
    let ensemble = measurement.ensemble("gl-posterior", &args.ensembles)?;
    ensure!(args.num >= 2, "-n {}: give at least 2 draws", args.num);
    if let Some(next) = args.next.filter(|next| *next > MOST_NEXT) {
        bail!("--next {next}: give at most {MOST_NEXT}, which are chosen by what they tell together");
    }
    ensure!(args.next != Some(0), "--next 0: give at least 1 sample to run next");
    sample_names(&args.name, 0, 1)?;

    let steps = measurement.steps(args.steps)?;
    let places = measurement.places(&steps);
    let Measurement { observations, noise, .. } = measurement;
    let scale = match noise {
        Some(_) => None,
        None => Some(scale(args, &observations)?),
    };
    let question = Question {
        prior: &prior,
        samples: &samples,
        ensemble: &ensemble,
        observations: &observations,
        noise: noise.as_deref(),
        scale: scale.as_deref(),
        steps,
        newest: &newest,
    };
    let options = Options {
        scatter: args.scatter,
        noise_as_stated: args.noise_as_stated,
        white: args.white,
        draws: args.num,
        seed: args.seed,
    };
    let inference = infer(&question, options)?;
    if let (Some(path), Some(count)) = (&args.next_out, args.next) {
        let iteration = args.iteration.unwrap_or(args.samples.len());
        next(args, &inference, count, iteration)?.write(Some(path), args.threads)?;
    }
    if let Some(path) = &args.run_weights {
        inference.weights_of_runs(&samples)?.write(Some(path))?;
    }
    if let Some(path) = &args.run_summary {
        inference.summary_of_runs(&samples)?.write(Some(path))?;
    }
    if let Some(path) = &args.summary {
        inference.summary(&samples)?.write(Some(path))?;
    }
    if let Some(path) = &args.curves_out {
        write_rows(Some(path), &inference.curves(&places))?;
    }
    let mut verdicts = inference.verdicts(options);
    if let Some(path) = &args.loo_out {
        let readings = readings(&inference, &places)?;
        write_rows(Some(path), &readings)?;
        // What an emulator does not know covers every reading: that says nothing of the measurement.
        if ["emulator-ignorant", "emulator-unfit"].iter().all(|code| verdicts.find(code).is_none()) {
            verdicts.rows.extend(loo::verdicts(&readings, inference.is_noise_restated()).rows);
        }
    }
    gl_cli::conclude("gl-posterior", &verdicts, args.verdict.as_deref(), || {
        inference.weights().write(args.output.as_deref())
    })
}

/// What an unknown noise is a share of, as gl-likelihood has it, shape (observables, steps).
fn scale(args: &Args, observations: &Observations) -> Result<Vec<Vec<f64>>> {
    let weights = args.weights.clone().unwrap_or_default();
    let covariance = Covariance::scaled(observations, args.scale, &weights)?;
    Ok(covariance.variance.iter().map(|row| row.iter().map(|v| v.sqrt()).collect()).collect())
}

/// Each reading, at its place, predicted from the others.
fn readings(inference: &Inference, places: &[(String, usize, f64)]) -> Result<Vec<Reading>> {
    let found = inference.held_out()?;
    let rows = places.iter().zip(&inference.measured().readings).zip(&found);
    let row =
        |(((observable, step, control), measured), found): ((&(String, usize, f64), &f64), &LeftOut)| {
            Reading::new(observable, (*step, *control, *measured), found)
        };
    Ok(rows.map(row).collect())
}

/// The samples to run next.
fn next(args: &Args, inference: &Inference, count: usize, iteration: usize) -> Result<Samples> {
    Ok(Samples {
        source: "next".to_owned(),
        names: sample_names(&args.name, iteration, count)?,
        parameters: inference.space.prior().names(),
        values: inference.next_runs(count, args.seed)?,
    })
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-posterior",
        gl_cli::about(
            run(&args),
            args.ensembles.iter().chain(&args.samples).chain([&args.params]).chain(args.measured.tables()),
        ),
    )
}
