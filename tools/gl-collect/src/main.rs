//! Bring the runs onto the steps of the measurement, leaving out those that failed.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use gl_cli::{not_negative, note};
use gl_inference::collect::{Collection, Failure, RTOL, RunStatus};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::rig::Rig;
use gl_inference::samples::Samples;
use gl_table::{appears_whole, write_rows};

/// Bring the runs onto the steps of the measurement, leaving out those that failed
#[derive(Parser)]
#[command(name = "gl-collect", version, after_help = EXAMPLE)]
struct Args {
    /// Table of the samples that were run
    #[arg(short, long, value_name = "FILE")]
    samples: PathBuf,
    /// Table of the measurement
    #[arg(short = 'b', long, value_name = "FILE")]
    observations: PathBuf,
    /// Control column; NAME=OTHER where the runs call it otherwise
    #[arg(short, long, value_name = "NAME[=OTHER]")]
    control: Column,
    /// Observables, comma-separated; NAME=OTHER where the runs call one otherwise
    #[arg(short = 'v', long, value_name = "NAME[=OTHER],…", value_delimiter = ',', required = true)]
    observables: Vec<Column>,
    /// Folders that hold <description>_sim.txt and <description>_param.txt, or packed files *_packed.txt
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// Where the state of every run goes: sample status detail
    #[arg(long, value_name = "FILE")]
    status: Option<PathBuf>,
    /// Share of the runs that may have failed
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, value_parser = not_negative)]
    max_failed: f64,
    /// Write a table of no runs where all have failed
    #[arg(long)]
    allow_empty: bool,
    /// Relative difference up to which a run's parameters are the table's
    #[arg(long, value_name = "R", default_value_t = RTOL, value_parser = not_negative)]
    rtol: f64,
    /// Share of the control's range by which a run may fall short of the measurement
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = not_negative)]
    end_tolerance: f64,
    /// Errors of the rig, which are added to every run, so that it is what the rig would have recorded: offset(OBSERVABLE), drift
    /// (at the end) in units of the observable, gain as a share, lag in units of the control, compliance in those by load
    #[arg(long, value_name = "ERROR=SIZE,…", default_value = "", hide_default_value = true)]
    rig: Rig,
    /// Where the ensemble goes; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-collect -s samples.txt -b obs.txt -c u -v f sims -o ensemble.txt";

/// What the measurement calls a column, and what the runs call it.
#[derive(Clone)]
struct Column {
    measured: String,
    simulated: String,
}

impl FromStr for Column {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (measured, simulated) = text.split_once('=').unwrap_or((text, text));
        ensure!(!measured.is_empty() && !simulated.is_empty(), "{text:?} is not NAME or NAME=OTHER");
        Ok(Self { measured: measured.to_owned(), simulated: simulated.to_owned() })
    }
}

fn run(args: &Args) -> Result<()> {
    gl_cli::distinct([args.output.as_ref(), args.status.as_ref()])?;
    let samples = Samples::read(&args.samples)?;
    let measured: Vec<String> = args.observables.iter().map(|column| column.measured.clone()).collect();
    let observations = Observations::read(&args.observations, &args.control.measured, &measured)?;
    let collection = Collection {
        observations: &observations,
        control: args.control.simulated.clone(),
        observables: args.observables.iter().map(|column| column.simulated.clone()).collect(),
        folders: args.folders.clone(),
        rtol: args.rtol,
        end_tolerance: args.end_tolerance,
        rig: args.rig.at(&observations).context("--rig")?,
    };
    let output = args.output.as_deref();
    let begin = || Ensemble::new(&observations, false).begin(output);
    if appears_whole(output) {
        let mut table = begin()?;
        let status = collection.collect(&samples, |runs| runs.write_rows(&mut table))?;
        report(args, &samples, &status)?;
        return table.finish();
    }
    // What is on stdout stays there: too many failed runs must be known before. Runs that are too many
    // to be held until then are read twice.
    let mut held = Held::default();
    let status = collection.collect(&samples, |runs| {
        held.push(runs);
        Ok(())
    })?;
    report(args, &samples, &status)?;
    let mut table = begin()?;
    match held.runs() {
        Some(runs) => runs.iter().try_for_each(|runs| runs.write_rows(&mut table))?,
        None => drop(collection.collect(&samples, |runs| runs.write_rows(&mut table))?),
    }
    table.finish()
}

/// Runs that are held in memory, unless they are too many.
#[derive(Default)]
struct Held {
    runs: Vec<Ensemble>,
    values: usize,
}

impl Held {
    const MOST: usize = 10_000_000;

    fn push(&mut self, runs: Ensemble) {
        self.values += runs.len() * runs.observables.len() * runs.steps();
        if self.values <= Self::MOST {
            self.runs.push(runs);
        } else {
            self.runs.clear();
        }
    }

    fn runs(&self) -> Option<&[Ensemble]> {
        (self.values <= Self::MOST).then_some(&self.runs)
    }
}

/// What became of each sample.
type Status = [Result<(), Failure>];

/// Write the status table, then count the failed runs on stderr, with the first as an example; too many are
/// an error.
fn report(args: &Args, samples: &Samples, status: &Status) -> Result<()> {
    if let Some(path) = &args.status {
        write_status(path, samples, status)?;
    }
    let total = samples.len();
    let mut failures =
        samples.names.iter().zip(status).filter_map(|(name, s)| Some((name, s.as_ref().err()?)));
    let Some((name, failure)) = failures.next() else { return Ok(()) };
    let failed = 1 + failures.count();
    let reasons = args
        .status
        .as_ref()
        .map_or_else(|| "--status FILE lists".to_owned(), |path| format!("{} has", path.display()));
    note("gl-collect", format_args!("{failed} of {total} runs failed; the first, {name}: {failure}"));
    ensure!(failed < total || args.allow_empty, "all {total} runs failed; {reasons} the reason of each");
    ensure!(
        failed as f64 <= args.max_failed * total as f64,
        "{failed} of {total} runs failed, more than --max-failed {} allows; \
         {reasons} the reason of each",
        args.max_failed
    );
    Ok(())
}

fn write_status(path: &Path, samples: &Samples, status: &Status) -> Result<()> {
    let rows: Vec<_> =
        samples.names.iter().zip(status).map(|(name, status)| RunStatus::new(name, status)).collect();
    write_rows(Some(path), &rows)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-collect", run(&gl_cli::parse()))
}
