//! Say how far the gap closes from one calibrated simulation to another.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};
use clap::Parser;
use gl_cli::measured::{Measured, Measurement, Outliers, Part, ensembles_and_weights};
use gl_gap::shrink::{COLUMNS, Calibrated, Compared, Shrink, add_foretold, shrink, verdict};
use gl_inference::observations::Steps;
use gl_inference::stack::named;
use gl_inference::weights::Weights;
use gl_table::{Table, TableWriter};
use serde::Deserialize;

/// Say how far the gap closes from one calibrated simulation to another.
///
/// The gap is the root mean square of measurement minus posterior mean over the range of the
/// measurement; `floor` is what noise and scatter alone would give after, `floor_before` before. One row an observable and a last
/// one for all, each with a 90 % interval.
#[derive(Parser)]
#[command(name = "gl-gap-shrink", version, after_help = EXAMPLE)]
struct Args {
    #[command(flatten)]
    measured: Measured,
    /// Runs without the effect, and their weights; NAME=ENSEMBLE for each --test, then the weights
    #[arg(long, value_name = "ENSEMBLE,WEIGHTS", allow_hyphen_values = true)]
    before: Tables,
    /// Runs with the effect, and their weights
    #[arg(long, value_name = "ENSEMBLE,WEIGHTS", allow_hyphen_values = true)]
    after: Tables,
    /// Steps that calibration did not see, from A up to but not including B; without it all, which it did
    #[arg(long, value_name = "A:B", conflicts_with = "test")]
    steps: Option<Steps>,
    /// Steps that calibration did see, as gl-likelihood --steps was told: the gap is measured on all others. With --test
    /// NAME=A:B,… for each test that has steps which it did not see; the others are left out
    #[arg(long, value_name = "A:B", conflicts_with = "steps")]
    calibrated: Option<Seen>,
    #[command(flatten)]
    outliers: Outliers,
    /// Share of the simulation's own scatter that the measurement has: towards 0 for a specimen of
    /// many more grains
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = gl_cli::scatter, allow_negative_numbers = true)]
    scatter: f64,
    /// What gl-gap-attribute --predict-shrink foretold, its first row: it is said where the gap closes otherwise
    #[arg(long, value_name = "FILE", conflicts_with_all = ["steps", "calibrated"])]
    foretold: Option<PathBuf>,
    /// Seed of the interval's replicates; the same seed gives the same interval on every machine
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also write what is concluded: code, value, text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the table goes; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "\
Example (the measurement is a wave; the run before is flat, the one after has half of it):
  awk 'BEGIN { print \"e q\"
    for (i = 0; i < 40; i++) print i, sin(i / 4) }' > obs.txt
  awk 'BEGIN { print \"sample step e q\"
    for (i = 0; i < 40; i++) print \"a\", i, i, 0 }' > before.tsv
  awk 'BEGIN { print \"sample step e q\"
    for (i = 0; i < 40; i++) print \"a\", i, i, sin(i / 4) / 2 }' > after.tsv
  printf 'sample weight\\na 1\\n' > weights.tsv
  gl-gap-shrink -b obs.txt -c e -v q --noise q=0.05 \\
    --before before.tsv,weights.tsv --after after.tsv,weights.tsv";

/// Steps that calibration did see: of the one test, or of each test that is named.
#[derive(Clone, Debug)]
enum Seen {
    OfOne(Steps),
    OfTests(Vec<(String, Steps)>),
}

impl FromStr for Seen {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if !text.contains('=') {
            return Ok(Self::OfOne(text.parse()?));
        }
        let of_test = |part: &str| {
            let (test, steps) = part.split_once('=').with_context(|| format!("{part:?} is not NAME=A:B"))?;
            Ok((test.to_owned(), steps.parse().with_context(|| format!("the test {test}"))?))
        };
        Ok(Self::OfTests(text.split(',').map(of_test).collect::<Result<_>>()?))
    }
}

/// The tables of a calibration: runs, one table or one for each test, and their weights.
#[derive(Clone, Debug)]
struct Tables {
    ensembles: Vec<PathBuf>,
    weights: PathBuf,
}

impl FromStr for Tables {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (ensembles, weights) = ensembles_and_weights(text)?;
        Ok(Self { ensembles, weights })
    }
}

impl Tables {
    /// The tests, and the calibration of each.
    fn read(&self, measurement: &Measurement) -> Result<(Vec<Part>, Vec<Calibrated>)> {
        let parts = measurement.parts("gl-gap-shrink", &self.ensembles)?;
        let weights = Weights::read(&self.weights)?;
        let of = |part: &Part| Calibrated { ensemble: part.ensemble.clone(), weights: weights.clone() };
        let calibrated = parts.iter().map(of).collect();
        Ok((parts, calibrated))
    }
}

/// A row of what was foretold.
#[derive(Deserialize)]
struct Foretold {
    shrink_low: f64,
    shrink_high: f64,
}

fn run(args: &Args) -> Result<()> {
    gl_cli::distinct([args.output.as_ref(), args.verdict.as_ref()])?;
    let measurement = args.measured.read()?;
    let (parts, before) = args.before.read(&measurement)?;
    let parts = args.outliers.marked_in(parts)?;
    let (_, after) = args.after.read(&measurement)?;
    let unseen = match &measurement.stack {
        Some(_) => unseen_of_tests(args, &parts)?,
        None => vec![unseen(args, parts[0].observations.steps())?],
    };
    // A test of which calibration saw everything says nothing of what it did not see.
    let measured: Vec<usize> =
        (0..parts.len()).filter(|&place| args.calibrated.is_none() || unseen[place].is_some()).collect();
    let names: Vec<String> = measured
        .iter()
        .map(|&place| &parts[place])
        .flat_map(|part| part.observations.names.iter().map(|of| named(&part.name, of)))
        .collect();
    let compared: Vec<Compared> = measured
        .iter()
        .map(|&place| Compared {
            observations: &parts[place].observations,
            noise_sd: parts[place].noise.as_deref(),
            unseen: unseen[place].as_deref(),
            before: &before[place],
            after: &after[place],
        })
        .collect();
    let shrinks = shrink(&compared, args.scatter, args.seed)?;
    let mut verdicts = verdict(&shrinks, &names, args.calibrated.is_some());
    let foretold = args.foretold.as_ref().map(|table| Table::read(table)?.rows::<Foretold>()).transpose()?;
    if let (Some(all), Some(foretold)) = (shrinks.rows.last(), foretold.iter().flatten().next()) {
        add_foretold(&mut verdicts, all, (foretold.shrink_low, foretold.shrink_high));
    }
    gl_cli::conclude("gl-gap-shrink", &verdicts, args.verdict.as_deref(), || {
        write(args.output.as_deref(), &shrinks.rows, &names)
    })
}

fn unseen(args: &Args, steps: usize) -> Result<Option<Vec<usize>>> {
    match &args.calibrated {
        None => Ok(args.steps.map(|unseen| unseen.within(steps)).transpose()?.map(Iterator::collect)),
        Some(Seen::OfOne(seen)) => {
            let unseen = beside(*seen, steps)?;
            ensure!(
                !unseen.is_empty(),
                "--calibrated: the measurement has {steps} steps, and calibration saw them all"
            );
            Ok(Some(unseen))
        }
        Some(Seen::OfTests(_)) => bail!("--calibrated: NAME=A:B is for --test; give A:B"),
    }
}

/// The steps of each test that calibration did not see; none where it saw all of them, or nothing is said.
fn unseen_of_tests(args: &Args, parts: &[Part]) -> Result<Vec<Option<Vec<usize>>>> {
    let mut unseen = vec![None; parts.len()];
    match &args.calibrated {
        None => return Ok(unseen),
        Some(Seen::OfOne(_)) => bail!("--calibrated: with --test give NAME=A:B,…, the steps of each test"),
        Some(Seen::OfTests(seen)) => {
            for (name, seen) in seen {
                let Some(place) = parts.iter().position(|part| part.name == *name) else {
                    let known: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
                    bail!("--calibrated: no test {name}; they are {}", known.join(", "));
                };
                let steps = beside(*seen, parts[place].observations.steps())?;
                unseen[place] = Some(steps).filter(|steps| !steps.is_empty());
            }
        }
    }
    ensure!(unseen.iter().any(Option::is_some), "--calibrated: calibration saw all steps of each test");
    Ok(unseen)
}

/// All steps but those that calibration saw.
fn beside(seen: Steps, steps: usize) -> Result<Vec<usize>> {
    ensure!(
        seen.to == usize::MAX || seen.to <= steps,
        "--calibrated {}:{}: the measurement has {steps} steps; end at {steps} or leave the end out",
        seen.from,
        seen.to
    );
    Ok((0..steps).filter(|&step| !seen.contains(step)).collect())
}

fn write(path: Option<&Path>, shrinks: &[Shrink], observables: &[String]) -> Result<()> {
    let mut table = TableWriter::create(path, &COLUMNS)?;
    let names = observables.iter().map(String::as_str).chain(["all"]);
    for (name, row) in names.zip(shrinks) {
        table.text(name).numbers(&[
            row.before,
            row.after,
            row.floor,
            row.shrink,
            row.low,
            row.high,
            row.floor_before,
        ]);
        table.end_row()?;
    }
    table.finish()
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    let inputs = [&args.after, &args.before]
        .into_iter()
        .flat_map(|tables| tables.ensembles.iter().chain([&tables.weights]));
    gl_cli::finish("gl-gap-shrink", gl_cli::about(run(&args), inputs.chain(args.measured.tables())))
}
