//! Predict what runs would give, without running them.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_emulator::table::{write_check, write_left_out, write_predictions};
use gl_emulator::{Emulator, Options};
use gl_inference::ensemble::Ensemble;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_inference::weights::Weights;

/// Predict what runs would give at other samples, without running them.
///
/// Trains Gaussian processes on an ensemble and writes the ensemble that the runs of the --at samples
/// would make. Its _sd columns hold what is not known of each of these runs: the emulator's ignorance,
/// and the simulation's own scatter.
#[derive(Parser)]
#[command(name = "gl-emulate", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Samples of the runs; repeat for several tables
    #[arg(short, long, value_name = "FILE", required = true)]
    samples: Vec<PathBuf>,
    /// Samples to predict: a samples table, or weights such as the draws of gl-posterior
    #[arg(long, value_name = "FILE", required_unless_present_any = ["check", "leave_one_out"])]
    at: Option<PathBuf>,
    /// Print the leave-one-out error of each observable instead
    #[arg(long, conflicts_with = "at")]
    check: bool,
    /// Write the runs themselves instead, each predicted from all the others
    #[arg(long, conflicts_with_all = ["at", "check"])]
    leave_one_out: bool,
    /// Column of the control; by default the one after `step`
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Columns of the observables; by default all after the control
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',')]
    observables: Vec<String>,
    /// Share of the variance of the simulation's scatter that is in the _sd columns
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = gl_cli::scatter, allow_negative_numbers = true)]
    scatter: f64,
    /// Seed of the places that the training starts from
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Where the table goes; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensembles of the runs, `-` for stdin
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
}

const EXAMPLE: &str = "\
Example: twelve runs of f = a u, and what a thirteenth would give

    printf 'name lower upper\\na 0 1\\n' > params.txt
    gl-sample -p params.txt -n 12 -o samples.txt
    awk 'BEGIN { print \"sample step u f\" }
         NR > 1 { for (u = 0; u < 5; u++) print $1, u, u, $3 * u }' \\
        samples.txt > ensemble.txt
    printf 'description a\\nnew 0.5\\n' > new.txt
    gl-emulate -p params.txt -s samples.txt --at new.txt ensemble.txt
    gl-emulate -p params.txt -s samples.txt --check ensemble.txt

--check prints, for each observable, when every run in turn is predicted from all the others:

    rmse        root mean square of predicted minus simulated
    rmse_range  the same over the observable's range
    coverage90  share of simulated values in their predicted 90 % interval
    scatter_sd  standard deviation of the simulation's own scatter";

fn run(args: &Args) -> Result<()> {
    let prior = Prior::read(&args.params)?;
    let tables = args.samples.iter().map(|path| Samples::read(path)).collect::<Result<Vec<_>>>()?;
    let samples = Samples::concatenate(tables)?;
    let at = args.at.as_deref().map(Weights::read_samples).transpose()?;
    let read = |path: &PathBuf| Ensemble::read_by_header(path, args.control.as_deref(), &args.observables);
    let ensemble = Ensemble::concatenate(args.ensembles.iter().map(read).collect::<Result<Vec<_>>>()?)?;
    let options = Options { seed: args.seed, ..Options::default() };
    let emulator = Emulator::fit(&prior, &samples, &ensemble, &options)?;
    if emulator.missing() > 0 {
        note(format_args!(
            "{} of {} samples have no run and are left out",
            emulator.missing(),
            samples.len()
        ));
    }
    let output = args.output.as_deref();
    match at {
        Some(at) => predict(&emulator, &ensemble, &at, args.scatter, output),
        None if args.leave_one_out => write_left_out(&emulator, &ensemble, args.scatter, output),
        None => write_check(&emulator.check(), output),
    }
}

fn predict(
    emulator: &Emulator,
    ensemble: &Ensemble,
    at: &Samples,
    scatter: f64,
    output: Option<&Path>,
) -> Result<()> {
    let outside = write_predictions(emulator, ensemble, at, scatter, output)?;
    if outside > 0 {
        note(format_args!("{outside} of {} samples lie outside the runs' range; extrapolated", at.len()));
    }
    Ok(())
}

fn note(message: impl std::fmt::Display) {
    gl_cli::note("gl-emulate", message);
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    let inputs = args.ensembles.iter().chain(&args.samples).chain([&args.params]);
    gl_cli::finish("gl-emulate", gl_cli::about(run(&args), inputs))
}
