//! Bring the runs onto the steps of the measurement, leaving out those that failed.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Result, ensure};
use clap::Parser;
use gl::cli::{not_negative, note};
use gl::collect::{Collected, Collection};
use gl::observations::Observations;
use gl::samples::Samples;
use gl::table::TableWriter;

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
    /// Folders that hold <description>_sim.txt and <description>_param.txt
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// Where the state of every run goes: sample status detail
    #[arg(long, value_name = "FILE")]
    status: Option<PathBuf>,
    /// Share of the runs that may have failed
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, value_parser = not_negative)]
    max_failed: f64,
    /// Relative difference up to which a run's parameters are the table's
    #[arg(long, value_name = "R", default_value_t = 1e-5, value_parser = not_negative)]
    rtol: f64,
    /// Share of the control's range by which a run may fall short of the measurement
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = not_negative)]
    end_tolerance: f64,
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
    let samples = Samples::read(&args.samples)?;
    let measured: Vec<String> = args.observables.iter().map(|column| column.measured.clone()).collect();
    let observations = Observations::read(&args.observations, &args.control.measured, &measured)?;
    let collected = Collection {
        observations: &observations,
        control: args.control.simulated.clone(),
        observables: args.observables.iter().map(|column| column.simulated.clone()).collect(),
        folders: args.folders.clone(),
        rtol: args.rtol,
        end_tolerance: args.end_tolerance,
    }
    .collect(&samples)?;
    if let Some(path) = &args.status {
        write_status(path, &samples, &collected)?;
    }
    report_failures(&samples, &collected, args.max_failed)?;
    collected.ensemble.write(args.output.as_deref())
}

fn write_status(path: &Path, samples: &Samples, collected: &Collected) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["sample", "status", "detail"])?;
    for (name, status) in samples.names.iter().zip(&collected.status) {
        match status {
            Ok(()) => table.text(name).text("ok").text(""),
            Err(failure) => table.text(name).text(failure.reason()).text(failure.detail()),
        };
        table.end_row()?;
    }
    table.finish()
}

/// Count the failed runs on stderr, with the first as an example; too many are an error.
fn report_failures(samples: &Samples, collected: &Collected, max_failed: f64) -> Result<()> {
    let (failed, total) = (collected.failed(), samples.len());
    let mut failures =
        samples.names.iter().zip(&collected.status).filter_map(|(name, s)| Some((name, s.as_ref().err()?)));
    let Some((name, failure)) = failures.next() else { return Ok(()) };
    note("gl-collect", format_args!("{failed} of {total} runs failed; the first, {name}: {failure}"));
    ensure!(failed < total, "all {total} runs failed; --status FILE lists the reason of each");
    ensure!(
        failed as f64 <= max_failed * total as f64,
        "{failed} of {total} runs failed, more than --max-failed {max_failed} allows; \
         --status FILE lists the reason of each"
    );
    Ok(())
}

fn main() -> ExitCode {
    gl::cli::finish("gl-collect", run(&gl::cli::parse()))
}
