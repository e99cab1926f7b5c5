//! Predict the observables from a weighted ensemble: mean, spread and 90 % band at every step.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_inference::ensemble::Ensemble;
use gl_inference::predict::predict;
use gl_inference::weights::Weights;
use gl_table::TableWriter;

/// Predict the observables from a weighted ensemble: mean, spread and 90 % band at every step.
#[derive(Parser)]
#[command(name = "gl-predict", version, after_help = EXAMPLE)]
struct Args {
    /// Table of weights; without it all runs weigh the same
    #[arg(short, long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Column of the control; by default the one after `step`
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Columns of the observables; by default all after the control
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',')]
    observables: Vec<String>,
    /// Where the prediction goes; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensemble of runs, `-` for stdin
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensemble: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'sample step e q\\na 0 0.1 1\\nb 0 0.1 3\\n' > runs.tsv
  printf 'sample weight\\na 1\\nb 3\\n' > weights.tsv
  gl-predict -w weights.tsv runs.tsv";

fn run(args: &Args) -> Result<()> {
    let ensemble = Ensemble::read_by_header(&args.ensemble, args.control.as_deref(), &args.observables)?;
    let weights = match &args.weights {
        Some(path) => Weights::read(path)?.of_runs(&ensemble)?,
        None => vec![1.0 / ensemble.len() as f64; ensemble.len()],
    };
    let prediction = predict(&ensemble, &weights)?;

    let mut columns = vec!["step".to_owned(), ensemble.control_name.clone()];
    for name in &ensemble.observables {
        columns.extend(["mean", "sd", "q05", "q50", "q95"].map(|what| format!("{name}_{what}")));
    }
    let mut table = TableWriter::create(args.output.as_deref(), &columns)?;
    for (step, &control) in ensemble.control.iter().enumerate() {
        table.number(step as f64).number(control);
        for observable in &prediction {
            let moments = &observable[step];
            table.numbers(&[moments.mean, moments.sd]).numbers(&moments.quantiles);
        }
        table.end_row()?;
    }
    table.finish()
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish("gl-predict", gl_cli::about(run(&args), [&args.ensemble].into_iter().chain(&args.weights)))
}
