//! Decide whether a calibration is done.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::conclude;
use gl_inference::stop::{Previous, Tolerances, criteria, verdicts};
use gl_inference::summary::Summary;
use gl_table::write_rows;

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
    /// Stop when sigma is at most so many times what the best run leaves over what noise alone would, and that run has
    /// come to rest: a model that cannot fit needs no sharper weights
    #[arg(long, value_name = "F", value_parser = gl_cli::not_negative)]
    misfit_tol: Option<f64>,
    /// Stop after so many iterations
    #[arg(long, value_name = "N")]
    max_iterations: Option<usize>,
    /// Number of this iteration, from 0
    #[arg(long, value_name = "I")]
    iteration: Option<usize>,
    /// Summary of the iteration before, none for the first: go on while an estimated noise still falls
    #[arg(long, value_name = "FILE|none")]
    previous: Option<PathBuf>,
    /// Where the conclusions go, besides stderr: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
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
    gl_cli::distinct([args.output.as_ref(), args.verdict.as_ref()])?;
    let summary = Summary::read(&args.summary)?;
    let tolerances = Tolerances {
        sigma: args.sigma_tol,
        ensemble_error: args.ensemble_error_tol,
        error: args.error_tol,
        misfit: args.misfit_tol,
        iterations: args.max_iterations,
    };
    let previous = match args.previous.as_deref() {
        None => Previous::NotAsked,
        Some(path) if path == Path::new("none") => Previous::First,
        Some(path) => Previous::Iteration(Box::new(Summary::read(path)?)),
    };
    let criteria = criteria(&summary, &tolerances, args.iteration, &previous)?;
    let verdicts = verdicts(&summary, &criteria);
    conclude("gl-check-stop", &verdicts, args.verdict.as_deref(), || {
        write_rows(args.output.as_deref(), &criteria)
    })?;
    Ok(verdicts.find("stop").is_some())
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-check-stop",
        gl_cli::about(run(&args), [&args.summary].into_iter().chain(&args.previous)),
    )
}
