//! Say where a calibrated simulation and the measurement disagree.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::measured::{FoundNoise, Measured, Outliers, Part};
use gl_gap::locate::{Located, Stretch, fits, locate_tests, noise_found, verdict_of_tests};
use gl_inference::stack::named;
use gl_inference::units::Units;
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
    #[command(flatten)]
    measured: Measured,
    /// Table of weights
    #[arg(short, long, value_name = "FILE")]
    weights: PathBuf,
    #[command(flatten)]
    outliers: Outliers,
    #[command(flatten)]
    noise: FoundNoise,
    /// Units of the controls, for the sentences, as in u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Seed of the replicates that say what stands out
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also write what is concluded: code, value, text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the table goes; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensemble of runs, `-` for stdin; NAME=ENSEMBLE for each --test
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
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
    gl_cli::distinct([args.output.as_ref(), args.verdict.as_ref()])?;
    let parts = args.measured.read()?.parts("gl-gap-locate", &args.ensembles)?;
    let mut parts = args.outliers.marked_in(parts)?;
    let weights = Weights::read(&args.weights)?;
    let of_runs = weights.of_runs(&parts[0].ensemble)?;
    let scales = args.noise.scales(&parts)?;
    for (Part { observations, noise, ensemble, .. }, scales) in parts.iter_mut().zip(&scales) {
        if let Some(stated) = noise {
            *noise = Some(noise_found(observations, ensemble, &of_runs, stated, scales)?);
        }
    }
    let tests: Vec<Located> = parts
        .iter()
        .map(|part| Located {
            observations: &part.observations,
            ensemble: &part.ensemble,
            noise_sd: part.noise.as_deref(),
            weights: &of_runs,
        })
        .collect();
    let located = locate_tests(&tests, weights.varying(), args.seed)?;
    let fit = fits(&tests, weights.varying())?;
    let told = parts.iter().zip(&located);
    let told: Vec<_> =
        told.map(|(part, found)| (part.name.as_str(), &part.observations, found.as_slice())).collect();
    let verdicts = verdict_of_tests(&told, &fit, &args.units);
    gl_cli::conclude("gl-gap-locate", &verdicts, args.verdict.as_deref(), || {
        write(args.output.as_deref(), &parts, &located)
    })
}

fn write(path: Option<&Path>, parts: &[Part], located: &[Vec<Stretch>]) -> Result<()> {
    let columns = ["observable", "from", "to", "gap", "gap_sd", "z", "share", "significant", "steps"];
    let mut table = TableWriter::create(path, &columns)?;
    for (part, stretches) in parts.iter().zip(located) {
        let observations = &part.observations;
        for stretch in stretches {
            let (first, end) = (stretch.steps.start, stretch.steps.end);
            table
                .text(&named(&part.name, &observations.names[stretch.observable]))
                .numbers(&[observations.control[first], observations.control[end - 1]])
                .numbers(&[stretch.gap, stretch.gap_sd, stretch.z, stretch.share])
                .yes_no(stretch.significant)
                .text(&format!("{}:{}", part.first + first, part.first + end))
                .end_row()?;
        }
    }
    table.finish()
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-gap-locate",
        gl_cli::about(run(&args), args.ensembles.iter().chain([&args.weights]).chain(args.measured.tables())),
    )
}
