//! Decide whether a calibration is done.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::note;
use gl_inference::stop::{Previous, Tolerances, criteria, doubts};
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
    let met: Vec<&str> = criteria.iter().filter(|c| c.is_met).map(|c| c.name).collect();
    if met.is_empty() {
        return Ok(false);
    }
    note("gl-check-stop", format_args!("stop, by {}", met.join(" and ")));
    for doubt in doubts(&summary, &criteria)? {
        note("gl-check-stop", doubt);
    }
    Ok(true)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-check-stop", run(&gl_cli::parse()))
}
