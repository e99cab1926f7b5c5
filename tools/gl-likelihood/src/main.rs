//! How far each run is from the measurement, step by step.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::note;
use gl_inference::misfit::{Comparison, Covariance, MisfitRows, Scaling};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_table::{Sink, open, source_name};

/// How far each run is from the measurement, step by step
#[derive(Parser)]
#[command(name = "gl-likelihood", version, after_help = EXAMPLE)]
struct Args {
    /// Table of the measurement
    #[arg(short = 'b', long, value_name = "FILE")]
    observations: PathBuf,
    /// Control column
    #[arg(short, long, value_name = "NAME")]
    control: String,
    /// Observables, comma-separated
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',', required = true)]
    observables: Vec<String>,
    /// What misfits are measured against: max (largest observation), value (each observation), range, none
    #[arg(long, value_name = "max|value|range|none")]
    scale: Option<Scaling>,
    /// Inverse observation weights, as n=0.01,q=1; a smaller one makes an observable count for more
    #[arg(long, value_name = "NAME=W,…")]
    weights: Option<ByName>,
    /// Standard deviation of the measurement noise, as f=0.02; instead of --scale and --weights
    #[arg(long, value_name = "NAME=SD,…")]
    noise: Option<ByName>,
    /// Take this sigma for that of the noise, for example sigma_noise of a summary
    #[arg(long, value_name = "S")]
    sigma: Option<f64>,
    /// Steps to compare, from A up to but not including B
    #[arg(long, value_name = "A:B")]
    steps: Option<Steps>,
    /// Write one row a run and not one a step: smaller, but without a history for gl-filter
    #[arg(long)]
    total: bool,
    /// Table of the ensemble; stdin when absent
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensemble: PathBuf,
    /// Where the misfits go; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-likelihood -b obs.txt -c u -v f --noise f=0.02 ensemble.txt -o misfit.txt";

fn run(args: &Args) -> Result<()> {
    let observations = Observations::read(&args.observations, &args.control, &args.observables)?;
    let mut covariance = covariance(args, &observations)?;
    if let Some(sigma) = args.sigma {
        covariance = covariance.at_sigma(sigma)?;
    }
    let comparison = Comparison::new(&observations, covariance, args.steps.unwrap_or(Steps::ALL))?;
    let mut input = open(&args.ensemble)?;
    let mut output = Sink::create(args.output.as_deref())?;
    let rows = if args.total { MisfitRows::Runs } else { MisfitRows::Steps };
    let left_out = comparison.stream(&source_name(&args.ensemble), &mut input, &mut output, rows)?;
    if let Some(first) = left_out.first() {
        let count = left_out.len();
        note(
            "gl-likelihood",
            format_args!(
                "{count} runs left out, {first} first: their misfit is beyond what a number can say"
            ),
        );
    }
    output.finish()
}

/// The noise where one is known, else the scale and weights.
fn covariance(args: &Args, observations: &Observations) -> Result<Covariance> {
    let weights = args.weights.clone().unwrap_or_default();
    match observations.noise(&args.noise.clone().unwrap_or_default())? {
        Some(noise) => {
            if args.scale.is_some() || args.weights.is_some() {
                note("gl-likelihood", "the noise is known, so --scale and --weights are not used");
            }
            Ok(Covariance::of_noise(&noise))
        }
        None => Covariance::scaled(observations, args.scale.unwrap_or(Scaling::Max), &weights),
    }
}

fn main() -> ExitCode {
    gl_cli::finish("gl-likelihood", run(&gl_cli::parse()))
}
