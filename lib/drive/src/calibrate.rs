//! The loop of a calibration: iterations of samples, runs, weights, until a criterion is met.

pub(crate) mod draws;
pub(crate) mod emulated;
pub(crate) mod iteration;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_case::folders::CURVES;
use gl_engine::lock::OutLock;
use gl_table::Table;
use gl_table::verdict::{Verdicts, is_doubt};

use crate::arguments::{Request, Results};
use crate::check;
use crate::step::{Call, Runner, copy, join, show};
use crate::{Progress, words};
use iteration::{Iteration, Known, Setting};

/// How long a calibration goes on, and whether it waits.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct Limits {
    /// Iterations at the most; iterations=N of the case when absent
    #[arg(short = 'i', long, value_name = "N", value_parser = from_one, conflicts_with_all = ["more", "until"])]
    pub iterations: Option<usize>,
    /// So many iterations beyond those that are there, whatever the criteria say
    #[arg(short = 'm', long, value_name = "N", value_parser = from_one, conflicts_with = "until")]
    pub more: Option<usize>,
    /// So many iterations in all, whatever the criteria say
    #[arg(long, value_name = "N")]
    pub until: Option<usize>,
    /// With slurm and pbs: exit with 1 where runs are in the queue, and do not wait for them
    #[arg(long)]
    pub no_wait: bool,
}

/// An argument that is a number of iterations.
///
/// # Errors
/// If it is not.
pub fn from_one(text: &str) -> Result<usize> {
    let number = text.parse::<usize>().unwrap_or(0);
    ensure!(number > 0, "give a number of iterations from 1");
    Ok(number)
}

/// Calibrate a case. The folder gets `iter0`, `iter1`, … with the tables of each iteration, and at the end
/// `ensemble.txt` with all runs, `posterior-weights.txt` with draws through an emulator or the weights of the runs,
/// `posterior.txt` with what these say, and `posterior-runs-weights.txt` and `posterior-runs.txt` with the same of
/// the real runs alone.
///
/// * `known` — a folder with `samples.txt` and the ensemble of each test of runs that are there already.
///
/// # Errors
/// If the case is wrong, or a step fails.
pub fn calibrate(request: &Request, limits: Limits, known: Option<&Path>) -> Result<Progress> {
    let case = request.load()?;
    let known = known.map(|folder| Known::new(&case, folder)).transpose()?;
    let (engine, model) = case.engine(request.engine)?;
    let out = request.own_folder(Results::Calibration)?;
    let (prior, observations) = check::ready(&case, (engine, model), &out, |plan| plan.calibration())?;
    if let Some((_, text)) = check::untold_noise(&case, &prior, &observations)? {
        gl_cli::note("gl-calibrate", text);
    }
    let _lock = alone(&out, "gl-calibrate")?;
    if let Some(file) = check::changed_since_runs(&case, engine, &out)? {
        gl_cli::note(
            "gl-calibrate",
            format_args!(
                "{} was changed after the runs in {}, which are kept as they are; for runs of the model as it is now give another --out, or remove that folder",
                file.display(),
                out.display()
            ),
        );
    }
    let runner = Runner::new(&out)?;
    let settings = request.keep(&case, engine, &out)?;
    let setting = Setting {
        case: &case,
        runs: Some((engine, model)),
        prior: &prior,
        settings: Some(settings),
        known,
        wait: !limits.no_wait,
        runner: &runner,
        out: &out,
    };

    let until = limits.more.map(|more| done(&out) + more).or(limits.until).unwrap_or(0);
    let most = if until > 0 { until } else { limits.iterations.unwrap_or(case.iterations) };
    let (mut last, mut is_over) = (0, false);
    for i in 0..most {
        last = i;
        let iteration = Iteration::new(&setting, i);
        let Some(stops) = iteration.make()? else { return Ok(Progress::InQueue) };
        say(words::iteration(i, &iteration.folder)?)?;
        // By weights it would be another fit, and take hundreds of runs.
        is_over = stops && i + 1 >= until || case.white && draws::falls_back(&iteration.folder);
        if is_over {
            break;
        }
    }
    let folder = out.join(format!("iter{last}"));
    if is_over {
        show(&folder.join("stop.log"), 0);
    } else {
        let call = Call::new("gl-check-stop")
            .option("--max-iterations", Some(most))
            .option("--iteration", Some(last))
            .flag("--previous", Iteration::new(&setting, last).summary_before())
            .arg(folder.join("summary.txt"));
        runner.ask(&call)?;
    }
    show_doubts(&folder)?;
    set_aside(&setting, last + 1)?;
    finish(&setting, last)?;
    say(format!("\n{}", words::posterior(&out.join("posterior.txt"))?.trim_end()))?;
    Ok(Progress::Finished)
}

/// Say what is doubtful about the posterior of an iteration, where it is one of draws.
fn show_doubts(iteration: &Path) -> Result<()> {
    let verdict = iteration.join("posterior-verdict.txt");
    if verdict.exists() {
        let doubts = Verdicts::read(&verdict)?.rows.into_iter().filter(|said| is_doubt(&said.code));
        doubts.for_each(|said| gl_cli::note("gl-posterior", said.text));
    }
    Ok(())
}

/// The folder for this driver alone. One that was killed leaves steps that end soon.
///
/// # Errors
/// If another driver works there.
pub(crate) fn alone(out: &Path, tool: &str) -> Result<OutLock> {
    OutLock::take_within(out, tool, Duration::from_secs(5), &|text| gl_cli::note(tool, text))
}

/// Weights of the real runs of a calibration: their curves are what is held against the measurement, scatter and all.
pub(crate) const RUNS_WEIGHTS: &str = "posterior-runs-weights.txt";

/// Set the folders of iterations from this one on aside, which a call with other settings has left: they are no part of what
/// this one ends with. An iteration that comes as far again takes up what is in them.
fn set_aside(setting: &Setting<'_>, first: usize) -> Result<()> {
    for i in (first..).take_while(|&i| setting.folder(i).exists()) {
        let (folder, aside) = (setting.folder(i), setting.aside(i));
        if aside.exists() {
            std::fs::remove_dir_all(&aside).with_context(|| aside.display().to_string())?;
        }
        std::fs::rename(&folder, &aside).with_context(|| folder.display().to_string())?;
        let text = format!(
            "{} was made by another call, which went further: it is {} now",
            folder.display(),
            aside.display()
        );
        gl_cli::note("gl-calibrate", text);
    }
    Ok(())
}

/// What a calibration ends with: all runs, their posterior weights, and what these say.
fn finish(setting: &Setting<'_>, last: usize) -> Result<()> {
    let Setting { case, out, .. } = *setting;
    let folder = out.join(format!("iter{last}"));
    // Runs that were there already have a weight by an emulator, which does not ask where they come from, and none by themselves.
    let known = setting.known.as_ref().filter(|_| folder.join(RUNS_WEIGHTS).exists());
    for (t, test) in case.tests.iter().enumerate() {
        let of = |i| setting.folder_of(i, test).join("ensemble.txt");
        let known = known.iter().map(|known| known.ensembles[t].clone());
        let ensembles: Vec<PathBuf> = known.chain((0..=last).map(of)).collect();
        let whole = out.join(".ensemble.txt");
        join(&ensembles, &whole, None)?;
        copy(&whole, &out.join(emulated::of_test_or_none("ensemble", test, "")))?;
        std::fs::remove_file(&whole)?;
    }
    for (table, of_runs) in [("posterior-weights.txt", RUNS_WEIGHTS), ("posterior.txt", "posterior-runs.txt")]
    {
        copy(&folder.join(table), &out.join(table))?;
        // Where the weights of the runs are the posterior, they are both.
        let beside = Some(folder.join(of_runs)).filter(|beside| beside.exists());
        copy(&beside.unwrap_or_else(|| folder.join(table)), &out.join(of_runs))?;
    }
    let (curves, target) = (folder.join(CURVES), out.join(CURVES));
    if curves.exists() {
        copy(&curves, &target)
    } else {
        let _ = std::fs::remove_file(target);
        Ok(())
    }
}

/// Whether a calibration ended by a criterion and not by the number of its iterations, through an emulator to the last.
///
/// # Errors
/// If its last iteration cannot be read.
pub(crate) fn is_settled(out: &Path) -> Result<bool> {
    let Some(last) = done(out).checked_sub(1).map(|last| out.join(format!("iter{last}"))) else {
        return Ok(false);
    };
    let stop = Table::read(&last.join("stop.txt"))?;
    let (criterion, met) = (stop.format().column("criterion")?, stop.format().column("met")?);
    let is_settled = |row| stop.field(row, criterion) == "settled" && stop.field(row, met) == "yes";
    Ok((0..stop.len()).any(is_settled) && !draws::falls_back(&last))
}

/// How many iterations are done.
pub fn done(out: &Path) -> usize {
    (0..).take_while(|i| out.join(format!("iter{i}/stop.code")).exists()).count()
}

/// A line on stdout; nobody has to read it for the work to go on.
pub(crate) fn say(line: String) -> Result<()> {
    match gl_table::print(&format!("{line}\n")) {
        Err(error) if gl_cli::is_closed_pipe(&error) => Ok(()),
        said => said,
    }
}
