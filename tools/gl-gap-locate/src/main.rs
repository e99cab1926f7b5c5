//! Say where a calibrated simulation and the measurement disagree.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_gap::locate::{Stretch, fits, locate, verdict};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::{ByName, Observations};
use gl_inference::weights::Weights;
use gl_table::TableWriter;

/// Say where a calibrated simulation and the measurement disagree.
///
/// The control axis is cut into stretches, one row each: the gap there, its standard deviation, and
/// the stretch's share of the total squared gap. Where there is no gap, any stretch is called
/// significant in fewer than 5 % of all measurements.
#[derive(Parser)]
#[command(name = "gl-gap-locate", version, after_help = EXAMPLE)]
struct Args {
    /// Measurement
    #[arg(short = 'b', long, value_name = "FILE")]
    observations: PathBuf,
    /// Column of the control
    #[arg(short, long, value_name = "NAME")]
    control: String,
    /// Columns of the observables
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',', required = true)]
    observables: Vec<String>,
    /// Table of weights
    #[arg(short, long, value_name = "FILE")]
    weights: PathBuf,
    /// Standard deviation of the noise; by default the `_sd` columns of the measurement, or estimated
    #[arg(long, value_name = "NAME=SD,…")]
    noise: Option<ByName>,
    /// Seed of the replicates that say what stands out
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also write what is concluded: code, value, text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the table goes; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensemble of runs, `-` for stdin
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensemble: PathBuf,
}

const EXAMPLE: &str = "\
Example (the measurement rises by 1 halfway, the one run does not):
  awk 'BEGIN { print \"e q\"
    for (i = 0; i < 40; i++) print i, (i > 19) + 0.1 * sin(i * i) }' > obs.txt
  awk 'BEGIN { print \"sample step e q\"
    for (i = 0; i < 40; i++) print \"a\", i, i, 0 }' > runs.tsv
  printf 'sample weight\\na 1\\n' > weights.tsv
  gl-gap-locate -b obs.txt -c e -v q -w weights.tsv --noise q=0.1 runs.tsv";

fn run(args: &Args) -> Result<()> {
    let observations = Observations::read(&args.observations, &args.control, &args.observables)?;
    let noise = observations.noise(&args.noise.clone().unwrap_or_default())?;
    let weights = Weights::read(&args.weights)?;
    let ensemble = Ensemble::read(&args.ensemble, &args.control, &args.observables)?;
    let of_runs = weights.of_runs(&ensemble)?;
    let stretches =
        locate(&observations, &ensemble, &of_runs, weights.varying(), noise.as_deref(), args.seed)?;
    write(args.output.as_deref(), &stretches, &observations)?;
    let fit = fits(&observations, &ensemble, &of_runs, weights.varying(), noise.as_deref())?;
    gl_cli::conclude("gl-gap-locate", &verdict(&stretches, &fit, &observations), args.verdict.as_deref())
}

fn write(path: Option<&Path>, stretches: &[Stretch], observations: &Observations) -> Result<()> {
    let columns = ["observable", "from", "to", "gap", "gap_sd", "z", "share", "significant", "steps"];
    let mut table = TableWriter::create(path, &columns)?;
    for stretch in stretches {
        let (first, end) = (stretch.steps.start, stretch.steps.end);
        table
            .text(&observations.names[stretch.observable])
            .numbers(&[observations.control[first], observations.control[end - 1]])
            .numbers(&[stretch.gap, stretch.gap_sd, stretch.z, stretch.share])
            .text(if stretch.significant { "yes" } else { "no" })
            .text(&format!("{first}:{end}"))
            .end_row()?;
    }
    table.finish()
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-gap-locate",
        gl_cli::about(run(&args), [&args.ensemble, &args.weights, &args.observations]),
    )
}
