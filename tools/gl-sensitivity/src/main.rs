//! Say what curves depend on, what a posterior leaves open, and what a further test would say.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};
use clap::Parser;
use gl_emulator::odds::{Hypothesis, expected_odds};
use gl_emulator::posterior::space::Space;
use gl_emulator::sensitivity::{Told, information, sobol};
use gl_emulator::{Emulator, Options};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::ByName;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_inference::stack::{OfTest, named};
use gl_inference::weights::Weights;
use gl_table::TableWriter;
use gl_table::verdict::Verdicts;

/// Say what curves depend on, what a posterior leaves open, and what a further test would say
///
/// Through an emulator of the runs: for each stretch of the control the share of an observable's variance over
/// the prior that each parameter makes by itself (first) and with all others (total), with the standard
/// errors of these indices. With the draws of a posterior: how far it has narrowed each parameter, and
/// which directions stay free. With runs of tests that are planned: which of them would narrow most.
///
/// With --hypotheses it asks something else of planned tests: how far each would tell the hypotheses of gl-gap-attribute apart.
/// The samples and runs are then those of a design in which effects are on and off, and the table says what is to
/// be expected for each planned test and each hypothesis, if it is true: its mean probability then, and the mean ln odds
/// against the rival that it is told from worst.
#[derive(Parser)]
#[command(name = "gl-sensitivity", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Samples of the runs; repeat for several tables
    #[arg(short, long, value_name = "FILE", required = true)]
    samples: Vec<PathBuf>,
    /// Column of the control; by default the one after `step`
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Columns of the observables; by default all after the control
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',')]
    observables: Vec<String>,
    /// Stretches of the control, of as many steps each
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = gl_cli::count)]
    stretches: usize,
    /// Draws under each hypothesis, of gl-gap-attribute --draws-out: hypothesis probability PARAMETER…
    #[arg(long, value_name = "FILE", requires = "plan", conflicts_with_all = ["weights", "plan_out", "control", "observables", "ensembles"])]
    hypotheses: Option<PathBuf>,
    /// Draws of the posterior, or weights of runs; without it what is planned is held against the prior
    #[arg(short, long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Where what is left of each parameter goes: parameter prior_sd posterior_sd narrowing
    #[arg(long, value_name = "FILE", requires = "weights")]
    narrowing_out: Option<PathBuf>,
    /// Where the directions go, from the freest: direction left NAME…, in standard deviations of the prior
    #[arg(long, value_name = "FILE", requires = "weights")]
    directions_out: Option<PathBuf>,
    /// A planned test, with the noise that it will have and an ensemble of runs of it; repeat for several
    #[arg(long, value_name = "NAME:NAME=SD,…:ENSEMBLE")]
    plan: Vec<Plan>,
    /// Where what each planned test would leave goes: test parameter left_now left_then narrowing nats
    #[arg(long, value_name = "FILE", requires = "plan")]
    plan_out: Option<PathBuf>,
    /// Seed of the sequences and the training
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Where the conclusions go, besides stderr: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// Where the indices go, or with --hypotheses the odds: test hypothesis probability_now probability_then rival
    /// ln_odds_now ln_odds_then; stdout by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Ensembles of the runs, `-` for stdin; TEST=ENSEMBLE for several tests, whose observables are then called
    /// TEST.OBSERVABLE
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
}

const EXAMPLE: &str = "\
Example (y = a + b does not tell a from b; z = a - b would):
  printf 'name lower upper\\na 0 1\\nb 0 1\\n' > params.txt
  gl-sample -p params.txt -n 20 --method sobol -o samples.txt
  awk 'BEGIN { print \"sample step x y\" }
    NR > 1 { print $1, 0, 0, $3 + $4 }' samples.txt > sum.tsv
  awk 'BEGIN { print \"sample step x z\" }
    NR > 1 { print $1, 0, 0, $3 - $4 }' samples.txt > difference.tsv
  printf 'x y\\n0 1\\n' > obs.txt
  gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y \\
    --noise y=0.01 sum.tsv -o draws.txt
  gl-sensitivity -p params.txt -s samples.txt -w draws.txt \\
    --directions-out directions.txt --plan again:y=0.01:sum.tsv \\
    --plan other:z=0.01:difference.tsv --plan-out plan.txt sum.tsv";

/// A direction along which more than this share of the prior's variance is left is free.
const FREE: f64 = 0.5;

/// Parts of a direction below this are not told.
const TOLD: f64 = 0.3;

/// A test that is planned.
#[derive(Clone, Debug)]
struct Plan {
    name: String,
    noise: ByName,
    ensemble: PathBuf,
}

impl FromStr for Plan {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let mut parts = text.splitn(3, ':');
        let (Some(name), Some(noise), Some(ensemble)) = (parts.next(), parts.next(), parts.next()) else {
            bail!("{text:?} is not NAME:NOISE:ENSEMBLE, such as oedometer:s=2e3:oedometer.txt");
        };
        ensure!(!name.is_empty(), "{text:?} has no name before the first colon");
        let noise = noise.parse().with_context(|| format!("noise of {name}"))?;
        Ok(Self { name: name.to_owned(), noise, ensemble: ensemble.into() })
    }
}

/// A test that ran.
struct Test {
    name: String,
    ensemble: Ensemble,
}

fn run(args: &Args) -> Result<()> {
    gl_cli::distinct(
        [&args.output, &args.narrowing_out, &args.directions_out, &args.plan_out, &args.verdict]
            .map(Option::as_ref),
    )?;
    let prior = Prior::read(&args.params)?;
    let tables = args.samples.iter().map(|path| Samples::read(path)).collect::<Result<Vec<_>>>()?;
    let samples = Samples::concatenate(tables)?;
    let options = Options { seed: args.seed, ..Options::default() };
    let emulate = |ensemble: &Ensemble| Emulator::fit(&prior, &samples, ensemble, &options);
    if let Some(path) = &args.hypotheses {
        return odds(args, &Hypothesis::read_all(path, &prior)?, &emulate);
    }
    let space = Space::new(&prior, &samples)?;

    let mut table = TableWriter::create(args.output.as_deref(), &COLUMNS)?;
    for Test { name, ensemble } in tests(args)? {
        write_indices(&mut table, &name, &ensemble, &emulate(&ensemble)?, &space, args)?;
    }
    let told = match &args.weights {
        Some(path) => Told::new(&space, &Weights::read(path)?)?,
        None => Told::prior(&space, args.seed)?,
    };
    let mut verdicts = Verdicts::default();
    if args.weights.is_some() {
        say_free(&mut verdicts, &told);
        if let Some(path) = &args.narrowing_out {
            write_narrowing(path, &told)?;
        }
        if let Some(path) = &args.directions_out {
            write_directions(path, &told)?;
        }
    }
    if !args.plan.is_empty() {
        plan(args, &told, &space, &emulate, &mut verdicts)?;
    }
    gl_cli::conclude("gl-sensitivity", &verdicts, args.verdict.as_deref(), || table.finish())
}

/// The runs of each test; of one without a name where none is given.
fn tests(args: &Args) -> Result<Vec<Test>> {
    let of_test: Vec<Option<OfTest>> =
        args.ensembles.iter().map(|path| path.to_str().and_then(|text| text.parse().ok())).collect();
    let is_named = of_test.iter().all(Option::is_some);
    ensure!(
        is_named || of_test.iter().all(Option::is_none),
        "some ensembles are named, as TEST=ENSEMBLE, and others are not; name all or none"
    );
    let mut tests: Vec<(String, Vec<PathBuf>)> = Vec::new();
    for (path, of_test) in args.ensembles.iter().zip(of_test) {
        let OfTest { test, path } = of_test.unwrap_or(OfTest { test: String::new(), path: path.clone() });
        match tests.iter_mut().find(|(name, _)| *name == test) {
            Some((_, paths)) => paths.push(path),
            None => tests.push((test, vec![path])),
        }
    }
    ensure!(
        tests.len() < 2 || (args.control.is_none() && args.observables.is_empty()),
        "-c and -v are those of one test; with several each ensemble has its own columns"
    );
    let read = |path: &PathBuf| Ensemble::read_by_header(path, args.control.as_deref(), &args.observables);
    let of = |(name, paths): (String, Vec<PathBuf>)| {
        let ensembles = paths.iter().map(read).collect::<Result<Vec<_>>>()?;
        Ok(Test { name, ensemble: Ensemble::concatenate(ensembles)? })
    };
    tests.into_iter().map(of).collect()
}

const COLUMNS: [&str; 10] = [
    "observable",
    "from",
    "to",
    "parameter",
    "first",
    "first_error",
    "total",
    "total_error",
    "sd",
    "ignorance",
];

fn write_indices(
    table: &mut TableWriter,
    test: &str,
    ensemble: &Ensemble,
    emulator: &Emulator,
    space: &Space,
    args: &Args,
) -> Result<()> {
    for stretch in sobol(emulator, space, args.stretches, args.seed)? {
        let name = named(test, &ensemble.observables[stretch.observable]);
        for (&parameter, index) in space.varied().iter().zip(&stretch.indices) {
            let ends = [ensemble.control[stretch.steps.start], ensemble.control[stretch.steps.end - 1]];
            table
                .text(&name)
                .numbers(&ends)
                .text(&space.prior().parameters()[parameter].name)
                .numbers(&[index.first, index.first_error, index.total, index.total_error])
                .numbers(&[stretch.sd, stretch.ignorance])
                .end_row()?;
        }
    }
    Ok(())
}

fn write_narrowing(path: &Path, told: &Told) -> Result<()> {
    let mut table = TableWriter::create(Some(path), &["parameter", "prior_sd", "posterior_sd", "narrowing"])?;
    for ((name, prior_sd), left) in told.names.iter().zip(&told.prior_sd).zip(told.left()) {
        table.text(name).numbers(&[*prior_sd, prior_sd * left.sqrt(), 1.0 - left]).end_row()?;
    }
    table.finish()
}

fn write_directions(path: &Path, told: &Told) -> Result<()> {
    let columns = ["direction", "left"].into_iter().chain(told.names.iter().map(String::as_str));
    let mut table = TableWriter::create(Some(path), &columns.collect::<Vec<_>>())?;
    for (number, direction) in told.directions().into_iter().enumerate() {
        table.number((number + 1) as f64).number(direction.left).numbers(&direction.parts).end_row()?;
    }
    table.finish()
}

/// Which directions the measurement leaves free.
fn say_free(verdicts: &mut Verdicts, told: &Told) {
    for direction in told.directions().into_iter().filter(|direction| direction.left > FREE) {
        let mut parts: Vec<(f64, &String)> = direction.parts.iter().copied().zip(&told.names).collect();
        parts.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let told: Vec<String> = parts
            .iter()
            .filter(|(part, _)| part.abs() >= TOLD)
            .map(|(part, name)| format!("{part:+.2} {name}"))
            .collect();
        let along = told.join(" ");
        let text = format!(
            "{:.0} % of what was open is open still along {along} (in standard deviations of the prior).",
            100.0 * direction.left.min(1.0)
        );
        verdicts.add("free", along, text);
    }
}

/// The planned tests with their runs and the noise of each reading, shape (readings,).
fn planned(args: &Args) -> Result<Vec<(&Plan, Ensemble, Vec<f64>)>> {
    let of = |(i, plan): (usize, &'_ Plan)| {
        ensure!(
            args.plan[..i].iter().all(|other| other.name != plan.name),
            "--plan {}: given twice",
            plan.name
        );
        for (name, sd) in plan.noise.iter() {
            ensure!(
                sd > 0.0,
                "--plan {}: the noise of {name} is {sd}; give its standard deviation",
                plan.name
            );
        }
        let names: Vec<String> = plan.noise.names().map(str::to_owned).collect();
        let ensemble = Ensemble::read_by_header(&plan.ensemble, None, &names)?;
        let noise = plan.noise.iter().flat_map(|(_, sd)| vec![sd; ensemble.steps()]).collect();
        Ok((ensemble, noise))
    };
    let with = |(i, plan)| of((i, plan)).map(|(ensemble, noise)| (plan, ensemble, noise));
    args.plan.iter().enumerate().map(with).collect()
}

/// How far each planned test would tell hypotheses apart.
fn odds(
    args: &Args,
    hypotheses: &[Hypothesis],
    emulate: &dyn Fn(&Ensemble) -> Result<Emulator>,
) -> Result<()> {
    let columns =
        ["test", "hypothesis", "probability_now", "probability_then", "rival", "ln_odds_now", "ln_odds_then"];
    let mut table = TableWriter::create(args.output.as_deref(), &columns)?;
    let mut best: Option<(f64, &Plan)> = None;
    for (plan, ensemble, noise) in planned(args)? {
        let expected = expected_odds(&emulate(&ensemble)?, hypotheses, &noise, args.seed)?;
        for (of, expected) in hypotheses.iter().zip(&expected) {
            table.text(&plan.name).text(&of.name).numbers(&[of.probability, expected.probability]);
            table.text(&hypotheses[expected.rival].name);
            table.numbers(&[expected.ln_odds_now, expected.ln_odds_then]).end_row()?;
        }
        let of_truth =
            hypotheses.iter().zip(&expected).map(|(of, then)| of.probability * then.probability).sum();
        if best.is_none_or(|(most, _)| of_truth > most) {
            best = Some((of_truth, plan));
        }
    }
    let mut verdicts = Verdicts::default();
    if let Some((then, plan)) = best {
        let now: f64 = hypotheses.iter().map(|of| of.probability.powi(2)).sum();
        let text = format!(
            "Of what is planned {} would tell the hypotheses apart best: the right one would have a probability of {then:.2} in \
             the mean, it has {now:.2} now.",
            plan.name
        );
        verdicts.add("tells-apart", &plan.name, text);
    }
    gl_cli::conclude("gl-sensitivity", &verdicts, args.verdict.as_deref(), || table.finish())
}

/// What each planned test would leave.
fn plan(
    args: &Args,
    told: &Told,
    space: &Space,
    emulate: &dyn Fn(&Ensemble) -> Result<Emulator>,
    verdicts: &mut Verdicts,
) -> Result<()> {
    let columns = ["test", "parameter", "left_now", "left_then", "narrowing", "nats"];
    let mut table =
        args.plan_out.as_deref().map(|path| TableWriter::create(Some(path), &columns)).transpose()?;
    let mut best: Option<(f64, &Plan, Vec<f64>)> = None;
    for (plan, ensemble, noise) in planned(args)? {
        let after = told.after(space, &emulate(&ensemble)?, &noise)?;
        let nats = information(&told.covariance, &after);
        let narrowing: Vec<f64> = told
            .left()
            .iter()
            .zip(after.diagonal().iter())
            .map(|(now, then)| if *now > 0.0 { (1.0 - then / now).clamp(0.0, 1.0) } else { 0.0 })
            .collect();
        if let Some(table) = &mut table {
            for (j, name) in told.names.iter().enumerate() {
                let then = after[(j, j)].max(0.0);
                table.text(&plan.name).text(name);
                table.numbers(&[told.left()[j], then, narrowing[j], nats]).end_row()?;
            }
        }
        if best.as_ref().is_none_or(|(most, ..)| nats > *most) {
            best = Some((nats, plan, narrowing));
        }
    }
    if let Some((_, plan, narrowing)) = best {
        let mut most: Vec<(f64, &String)> = narrowing.into_iter().zip(&told.names).collect();
        most.sort_by(|a, b| b.0.total_cmp(&a.0));
        let told: Vec<String> = most
            .iter()
            .take(3)
            .map(|(narrowing, name)| format!("{name} by {:.0} %", 100.0 * narrowing))
            .collect();
        let text = format!(
            "Of what is planned {} would say most: it takes of the variance of {}.",
            plan.name,
            told.join(", ")
        );
        verdicts.add("measure", &plan.name, text);
    }
    table.map_or(Ok(()), TableWriter::finish)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-sensitivity", run(&gl_cli::parse()))
}
