//! Decide whether a calibration is done.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::conclude;
use gl_inference::stop::{Previous, Tolerances, criteria, verdict};
use gl_inference::summary::Summary;
use gl_table::TableWriter;

/// Decide whether a calibration is done: exit 0 to stop, 1 to go on
///
/// Any tolerance that is met stops it, and so does a sigma that has come down to the noise.
#[derive(Parser)]
#[command(name = "gl-check-stop", version, after_help = EXAMPLE)]
struct Args {
    /// Stop when sigma is at most this
    #[arg(long, value_name = "S", value_parser = gl_cli::not_negative)]
    sigma_tol: Option<f64>,
    /// Stop when the mean error of the weighted runs is at most this share of the range
    #[arg(long, value_name = "SHARE", value_parser = gl_cli::not_negative)]
    ensemble_error_tol: Option<f64>,
    /// Stop when the error of the best run is at most this share of the range
    #[arg(long, value_name = "SHARE", value_parser = gl_cli::not_negative)]
    error_tol: Option<f64>,
    /// Stop after so many iterations
    #[arg(long, value_name = "N")]
    max_iterations: Option<usize>,
    /// Number of this iteration, from 0
    #[arg(long, value_name = "I")]
    iteration: Option<usize>,
    /// Summary of the iteration before, none for the first: go on while an estimated noise still falls
    #[arg(long, value_name = "FILE|none")]
    previous: Option<PathBuf>,
    /// Summary of gl-filter; stdin when absent
    #[arg(value_name = "SUMMARY", default_value = "-")]
    summary: PathBuf,
    /// Where what it concludes goes, and what is to be doubted: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the criteria go; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-check-stop --error-tol 0.01 --iteration 2 --max-iterations 10 summary.txt";

fn run(args: &Args) -> Result<bool> {
    let summary = Summary::read(&args.summary)?;
    let tolerances = Tolerances {
        sigma: args.sigma_tol,
        ensemble_error: args.ensemble_error_tol,
        error: args.error_tol,
        iterations: args.max_iterations,
    };
    let previous = match args.previous.as_deref() {
        None => Previous::NotAsked,
        Some(path) if path == Path::new("none") => Previous::First,
        Some(path) => Previous::Iteration(Summary::read(path)?),
    };
    let criteria = criteria(&summary, &tolerances, args.iteration, &previous)?;
    let mut table = TableWriter::create(args.output.as_deref(), &["criterion", "value", "tolerance", "met"])?;
    for criterion in &criteria {
        let met = if criterion.is_met { "yes" } else { "no" };
        table.text(criterion.name).number(criterion.value).number(criterion.tolerance).text(met).end_row()?;
    }
    table.finish()?;
    let verdict = verdict(&summary, &criteria)?;
    let is_done = criteria.iter().any(|criterion| criterion.is_met);
    if is_done {
        conclude("gl-check-stop", &verdict, args.verdict.as_deref())?;
    } else if let Some(path) = &args.verdict {
        verdict.write(Some(path))?;
    }
    Ok(is_done)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-check-stop", run(&gl_cli::parse()))
}
