//! Hide a truth in a measurement, to see whether a diagnosis finds it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail};
use clap::{Parser, Subcommand, value_parser};
use gl_gap::attribute::winner::MostProbable;
use gl_gap::blind::{Measurement, SEEDS, effects_of, hidden, strengths, truth};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::ByName;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_table::{Table, TableWriter};

/// Hide a truth in a measurement, to see whether a diagnosis finds it
///
/// Draw a truth, run it, measure it, diagnose the measurement, and only then look at the truth.
#[derive(Parser)]
#[command(name = "gl-blind", version, after_help = EXAMPLE)]
struct Args {
    #[command(subcommand)]
    step: Step,
}

#[derive(Subcommand)]
enum Step {
    /// Draw a truth with one effect in it, as a table of samples
    Truth {
        /// Table of parameters
        #[arg(short, long, value_name = "FILE")]
        params: PathBuf,
        /// Seed of the draw
        #[arg(long, default_value_t = 0, value_parser = value_parser!(u32).range(..i64::from(SEEDS)))]
        seed: u32,
        /// So many specimens, alike but for their packing, with a column `seed`
        #[arg(long, value_name = "N", value_parser = gl_cli::count)]
        specimens: Option<usize>,
        /// Where the samples go; stdout when absent
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Make a measurement of runs: their mean, with noise
    Measure {
        /// Control of the measurement
        #[arg(short, long, value_name = "NAME")]
        control: String,
        /// Observables, separated by commas
        #[arg(short = 'v', long, value_name = "NAMES", value_delimiter = ',')]
        observables: Vec<String>,
        /// Standard deviation of the noise of a reading, NAME=SD,…
        #[arg(long, value_name = "SD")]
        noise: Option<ByName>,
        /// Seed of the noise, above 0
        #[arg(long, default_value_t = 1, value_parser = value_parser!(u32).range(1..i64::from(SEEDS)))]
        seed: u32,
        /// Let what specimens differ by be the noise of a reading: columns NAME_sd
        #[arg(long)]
        scatter: bool,
        /// Ensemble of the runs, at the steps of the measurement to be; stdin when absent
        #[arg(value_name = "ENSEMBLE", default_value = "-")]
        ensemble: PathBuf,
        /// Where the measurement goes; stdout when absent
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Say whether the truth was found: exit 0 if it comes first, 1 if not
    Outcome {
        /// Table of parameters
        #[arg(short, long, value_name = "FILE")]
        params: PathBuf,
        /// Table of samples that was hidden
        #[arg(long, value_name = "FILE")]
        answer: PathBuf,
        /// What is right of an effect that is no candidate, such as slip=unexplained
        #[arg(long, value_name = "EFFECT=HYPOTHESIS,…", value_delimiter = ',')]
        right: Vec<Right>,
        /// Table of gl-gap-attribute
        #[arg(value_name = "ATTRIBUTION")]
        attribution: PathBuf,
        /// Where the outcome goes, truth strength first probability; stdout when absent
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

/// An effect that is no candidate of the diagnosis, and the hypothesis that is right of it.
#[derive(Clone, Debug)]
struct Right {
    effect: String,
    hypothesis: String,
}

impl FromStr for Right {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (effect, hypothesis) = text
            .split_once('=')
            .with_context(|| format!("{text:?} is not EFFECT=HYPOTHESIS, such as slip=unexplained"))?;
        Ok(Self { effect: effect.to_owned(), hypothesis: hypothesis.to_owned() })
    }
}

const EXAMPLE: &str = "Example:
  gl-blind measure -c u -v f --noise f=0.005 ensemble.txt -o measured.txt";

fn draw(params: &Path, seed: u32, specimens: Option<usize>) -> Result<Samples> {
    let prior = Prior::read(params)?;
    let truth = truth(&prior, seed).with_context(|| params.display().to_string())?;
    let mut parameters = prior.names();
    let (names, values) = match specimens {
        None => (vec!["truth".to_owned()], vec![truth]),
        Some(count) => {
            parameters.push("seed".to_owned());
            let packing = |i: usize| 100_000.0 + 100.0 * f64::from(seed) + i as f64;
            let row = |i: usize| truth.iter().copied().chain([packing(i)]).collect();
            ((1..=count).map(|i| format!("specimen{i}")).collect(), (1..=count).map(row).collect())
        }
    };
    Ok(Samples { source: "truth".to_owned(), names, parameters, values })
}

fn run(args: &Args) -> Result<bool> {
    match &args.step {
        Step::Truth { params, seed, specimens, output } => {
            draw(params, *seed, *specimens)?.write(output.as_deref(), None)?;
        }
        Step::Measure { control, observables, noise, seed, scatter, ensemble, output } => {
            let runs = Ensemble::read(ensemble, control, observables)?;
            let noise = noise.clone().unwrap_or_default();
            noise.check_names(observables, "--noise")?;
            Measurement::new(&runs, &noise, *seed, *scatter)?.write(
                output.as_deref(),
                control,
                observables,
            )?;
        }
        Step::Outcome { params, answer, right, attribution, output } => {
            let prior = Prior::read(params)?;
            let known = |name: &str| prior.parameters().iter().any(|p| p.effect.as_deref() == Some(name));
            if let Some(other) = right.iter().find(|right| !known(&right.effect)) {
                bail!("--right {}: no such effect in {}", other.effect, params.display());
            }
            let truth = hidden(&prior, &Samples::read(answer)?)?;
            let MostProbable { cause: first, probability, .. } =
                MostProbable::of(&Table::read(attribution)?)?;
            let effects = effects_of(&prior, &truth);
            let mut table =
                TableWriter::create(output.as_deref(), &["truth", "strength", "first", "probability"])?;
            let strength = strengths(&prior, &truth).first().copied().unwrap_or(0.0);
            table.text(&effects).number(strength).text(&first).number(probability).end_row()?;
            table.finish()?;
            let expected = right.iter().find(|right| right.effect == effects);
            let expected = expected.map_or(&effects, |right| &right.hypothesis);
            return Ok(first == *expected);
        }
    }
    Ok(true)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-blind", run(&gl_cli::parse()))
}
