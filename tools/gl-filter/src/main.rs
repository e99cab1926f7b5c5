//! Weigh the runs by sequential Monte Carlo.

mod course;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use gl_cli::{conclude, note};
use gl_inference::collect::RunStatus;
use gl_inference::filter::{NoiseModel, Runs, Target, Weighting, weigh, weigh_emulated};
use gl_inference::misfit::{Incomplete, Misfits, Partial};
use gl_inference::prior::{Parameter, Prior, Scale};
use gl_inference::proposal::{Proposal, ln_balance_heuristic};
use gl_inference::samples::Samples;
use gl_inference::stop::weights_verdicts;
use gl_inference::summary::{Range, Summary, Weighed};
use gl_inference::weights::Weights;

use course::Course;

/// Weigh the runs by sequential Monte Carlo
///
/// Several iterations are weighed together when -s and --proposal are repeated, one of each an
/// iteration: then no run is thrown away. Tables of misfits of the same samples are those of several
/// tests, and are added.
#[derive(Parser)]
#[command(name = "gl-filter", version, after_help = EXAMPLE)]
struct Args {
    /// Table of the samples; repeat for several iterations
    #[arg(short, long, value_name = "FILE", required = true)]
    samples: Vec<PathBuf>,
    /// What the samples were drawn from: prior, or the table of gl-gmm-resample --proposal-out; one for
    /// each -s
    #[arg(long, value_name = "prior|FILE")]
    proposal: Vec<PathBuf>,
    /// Table of parameters; says where the bounds are, which are else taken from the samples
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Effective sample size to reach, as a share of the runs
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, conflicts_with = "sigma")]
    ess: f64,
    /// Effective sample size to reach, as a number of runs; nine in ten runs at the most
    #[arg(long, value_name = "RUNS", conflicts_with_all = ["ess", "sigma"], value_parser = gl_cli::not_negative)]
    ess_runs: Option<f64>,
    /// Weigh at this sigma; noise is the posterior itself
    #[arg(long, value_name = "S|noise")]
    sigma: Option<Sigma>,
    /// Never go below this sigma; noise takes what an emulator does not know into account
    #[arg(long, value_name = "S|noise", conflicts_with = "sigma")]
    sigma_min: Option<Sigma>,
    /// Sigma below which gl-check-stop is to stop; put into the summary
    #[arg(long, value_name = "S", value_parser = gl_cli::not_negative)]
    sigma_tol: Option<f64>,
    /// Where the course of the filter goes: step sigma ess mean(NAME)… cv(NAME)…
    #[arg(long, value_name = "FILE")]
    history: Option<PathBuf>,
    /// Where the weights at six steps go, each from the readings up to it: sample step NAME… weight
    #[arg(long, value_name = "FILE")]
    step_weights: Option<PathBuf>,
    /// Where the summary goes: quantity value
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    /// Where the conclusions go, besides stderr: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
    /// What became of the runs (gl-collect --status): a sample without a misfit that did not fail is then an error, as
    /// where the writer of the misfits was killed; may be repeated
    #[arg(long, value_name = "FILE")]
    status: Vec<PathBuf>,
    /// Count a sample that failed in one test by its others: this assumes that it would have fitted that one as
    /// well as them, reading for reading. Without it such samples are left out
    #[arg(long)]
    failed_as_others: bool,
    /// Tables of misfits, of one test or of several; stdin when absent
    #[arg(value_name = "MISFIT", default_value = "-")]
    misfits: Vec<PathBuf>,
    /// Where the weights go; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-filter -s samples.txt --ess 0.3 --summary summary.txt misfit.txt \\
    -o weights.txt";

#[derive(Clone, Copy)]
struct Sigma(Target);

impl FromStr for Sigma {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "noise" {
            return Ok(Self(Target::Noise));
        }
        let sigma = gl_table::parse_number(text).context("give a positive number, or noise")?;
        ensure!(sigma > 0.0, "{text} is not positive");
        Ok(Self(Target::Sigma(sigma)))
    }
}

fn run(args: &Args) -> Result<()> {
    gl_cli::distinct([
        args.output.as_ref(),
        args.history.as_ref(),
        args.step_weights.as_ref(),
        args.summary.as_ref(),
        args.verdict.as_ref(),
    ])?;
    let tables = args.samples.iter().map(|path| Samples::read(path)).collect::<Result<Vec<_>>>()?;
    let counts: Vec<usize> = tables.iter().map(Samples::len).collect();
    let samples = Samples::concatenate(tables)?;
    let partial = if args.failed_as_others { Partial::AsOthers } else { Partial::LeftOut };
    let by_step = args.history.is_some() || args.step_weights.is_some();
    let (misfits, incomplete) = Misfits::read_tests(&args.misfits, by_step, partial)?;
    incomplete.iter().for_each(|lacking| note("gl-filter", lacks(lacking, partial)));
    let all_tests = if incomplete.is_empty() { "" } else { " that ran in all tests" };
    ensure!(!misfits.is_empty(), "{}: no runs{all_tests} to weigh", misfits.source);

    check_status(args, &samples, &misfits, &incomplete)?;
    let places = samples.places(&misfits.samples, &misfits.source)?;
    let mut used = vec![false; samples.len()];
    places.iter().for_each(|&i| used[i] = true);
    if let Some(first) = used.iter().position(|used| !used).filter(|_| incomplete.is_empty()) {
        let (lacking, all) = (samples.len() - misfits.len(), samples.len());
        let first = &samples.names[first];
        note("gl-filter", format!("{lacking} of {all} samples have no misfit, {first} first: left out"));
    }
    let ln_proposal = ln_balance_heuristic(&samples, &counts, &proposals(args)?, &used)?;
    let runs = Runs::new(misfits.total.clone(), places.iter().map(|&i| ln_proposal[i]).collect())?;
    let values: Vec<Vec<f64>> = places.iter().map(|&i| samples.values[i].clone()).collect();
    let noise = noise(&runs, &misfits, &values);
    let weighting = weighting(args, &runs, &misfits, noise)?;

    let prior = args.params.as_deref().map(Prior::read).transpose()?;
    let (ranges, prior_sd) = ranges(prior.as_ref(), &samples);
    let evidence = Weighed {
        runs: &runs,
        weighting: &weighting,
        noise,
        samples: &misfits.samples,
        errors: &misfits.mean_error,
        parameters: &samples.parameters,
        values: &values,
        ranges: &ranges,
        prior_sd: prior_sd.as_deref(),
        failed: samples.len() - misfits.len(),
        expected: &misfits.expected,
    };
    let mut summary = evidence.summary()?;
    if let Some(Sigma(Target::Sigma(sigma))) = args.sigma_min {
        summary.sigma_min = Some(sigma);
    }
    summary.sigma_tol = args.sigma_tol;
    let course = Course {
        misfits: &misfits,
        runs: &runs,
        last: &weighting,
        noise,
        parameters: &samples.parameters,
        values: &values,
    };
    conclude("gl-filter", &weights_verdicts(&summary), args.verdict.as_deref(), || {
        write(args, &course, &summary)
    })
}

/// See to it that what has no misfit has failed, where it is known what has.
fn check_status(args: &Args, samples: &Samples, misfits: &Misfits, incomplete: &[Incomplete]) -> Result<()> {
    let Some(first) = args.status.first() else { return Ok(()) };
    let mut failed = HashSet::new();
    for path in &args.status {
        failed.extend(RunStatus::failed(path)?.into_iter().map(|run| run.sample));
    }
    let known: HashSet<&String> = misfits.samples.iter().collect();
    let in_no_test = samples.names.iter().filter(|name| !known.contains(name));
    let mut lacking = in_no_test.chain(incomplete.iter().flat_map(|test| &test.samples));
    if let Some(name) = lacking.find(|name| !failed.contains(*name)) {
        bail!(
            "{}: no misfit of {name}, which did not fail by {}; was the table cut off?",
            misfits.source,
            first.display()
        );
    }
    Ok(())
}

/// The weights that were asked for: at a sigma, or at the one of an effective sample size.
fn weighting(args: &Args, runs: &Runs, misfits: &Misfits, noise: NoiseModel) -> Result<Weighting> {
    let ess = args.ess_runs.map_or(args.ess, |wanted| (wanted / misfits.len() as f64).min(0.9));
    let target = args.sigma.map_or(Target::Ess(ess), |sigma| sigma.0);
    let floor = args.sigma_min.map(|sigma| sigma.0);
    let is_emulated = misfits.ignorance.iter().any(|ignorance| *ignorance > 0.0);
    match (floor, noise) {
        (Some(Target::Noise), NoiseModel::Known) if is_emulated => {
            weigh_emulated(runs, target, &misfits.ignorance)
        }
        _ => weigh(runs, target, floor, noise),
    }
}

/// All tables, the weights last.
fn write(args: &Args, course: &Course<'_>, summary: &Summary) -> Result<()> {
    if let Some(path) = &args.history {
        course.write_history(path)?;
    }
    if let Some(path) = &args.step_weights {
        course.write_weights(path)?;
    }
    if let Some(path) = &args.summary {
        summary.write(Some(path))?;
    }
    Weights {
        source: "weights".to_owned(),
        samples: course.misfits.samples.clone(),
        parameters: course.parameters.to_vec(),
        values: course.values.to_vec(),
        misfit: Some(course.runs.misfit.clone()),
        error: Some(course.misfits.mean_error.clone()),
        weight: course.last.weights()?,
    }
    .write(args.output.as_deref())
}

/// What becomes of the samples that a test lacks.
fn lacks(Incomplete { test, samples }: &Incomplete, partial: Partial) -> String {
    let (count, first) = (samples.len(), &samples[0]);
    let named = if count == 1 { first.clone() } else { format!("{count} samples, {first} first,") };
    let what = match partial {
        Partial::LeftOut => "left out; --failed-as-others counts by the other tests",
        Partial::AsOthers => "counted by the other tests, as if that one fitted as well",
    };
    format!("{named} failed in the test of {test}: {what}")
}

fn proposals(args: &Args) -> Result<Vec<Option<Proposal>>> {
    if args.proposal.is_empty() && args.samples.len() == 1 {
        return Ok(vec![None]);
    }
    if args.proposal.len() != args.samples.len() {
        bail!(
            "{} tables of samples but {} proposals; give one --proposal for each -s, prior for the first",
            args.samples.len(),
            args.proposal.len()
        );
    }
    let read =
        |path: &PathBuf| if path == Path::new("prior") { Ok(None) } else { Proposal::read(path).map(Some) };
    args.proposal.iter().map(read).collect()
}

/// The noise, estimated where none was given from the residuals of the best run.
fn noise(runs: &Runs, misfits: &Misfits, values: &[Vec<f64>]) -> NoiseModel {
    let best = (0..runs.misfit.len()).min_by(|&a, &b| runs.misfit[a].total_cmp(&runs.misfit[b])).unwrap_or(0);
    let varied = (0..values[0].len()).filter(|&j| values.iter().any(|row| row[j] != values[0][j])).count();
    NoiseModel::new(misfits.readings[best], varied)
}

/// Bounds of each parameter, those of its prior or a little more than the range of its samples, and
/// the standard deviations of the priors if they are known.
fn ranges(prior: Option<&Prior>, samples: &Samples) -> (Vec<Range>, Option<Vec<f64>>) {
    let known = |name: &String| prior.and_then(|prior| prior.parameter(name));
    let room = 1.0 / samples.len() as f64;
    let of = |(j, name): (usize, &String)| {
        if let Some(p) = known(name) {
            let off = |bound: f64| p.off.unwrap_or(bound);
            let (lower, upper) = (off(p.lower).min(p.lower), off(p.upper).max(p.upper));
            // An effect that is off at zero has no logarithm there.
            return Range { lower, upper, scale: if lower > 0.0 { p.scale } else { Scale::Linear } };
        }
        let low = samples.values.iter().map(|row| row[j]).fold(f64::INFINITY, f64::min);
        let high = samples.values.iter().map(|row| row[j]).fold(f64::NEG_INFINITY, f64::max);
        let room = room * (high - low);
        Range { lower: low - room, upper: high + room, scale: Scale::Linear }
    };
    let prior_sd = samples.parameters.iter().map(|name| known(name).map(Parameter::sd)).collect();
    (samples.parameters.iter().enumerate().map(of).collect(), prior_sd)
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish(
        "gl-filter",
        gl_cli::about(
            run(&args),
            args.misfits.iter().chain(&args.samples).chain(&args.params).chain(&args.status),
        ),
    )
}
