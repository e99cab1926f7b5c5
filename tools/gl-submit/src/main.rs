//! Calibrate or diagnose a case in the queue of a cluster.

use std::env;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use gl_case::Engine;
use gl_drive::calibrate::{done, from_one};
use gl_drive::{Request, Results};
use gl_engine::control::{Control, Record, forgive, is_begun};
use gl_engine::lock::OutLock;
use gl_engine::scheduler::{Patience, Scheduler, of_engine};

/// Calibrate or diagnose a case in the queue of SLURM or PBS: nothing has to stay connected
///
/// Each iteration is a job array, and a controlling job that starts when it has ended: it calls gl-calibrate, or
/// gl-diagnose, which goes on until runs are in the queue again, and then leaves the next controlling job behind.
/// DIR/control.log has the words of the last one.
///
/// Called again it does no harm: what is in the queue is left alone, and what has come to a halt (its controlling
/// job was killed, the scheduler forgot it, it was cancelled) goes on where it was, with new attempts at the runs
/// that failed. What was given once holds for later calls, until it is given again.
#[derive(Parser)]
#[command(name = "gl-submit", version, after_help = EXAMPLE)]
struct Args {
    #[command(flatten)]
    request: Request,
    /// Diagnose: calibrate, locate the gap, find its cause, see how far it closes
    #[arg(long, conflicts_with_all = ["iterations", "more"])]
    diagnose: bool,
    /// Iterations at the most; iterations=N of the case when absent
    #[arg(short = 'i', long, value_name = "N", value_parser = from_one, conflicts_with = "more")]
    iterations: Option<usize>,
    /// So many iterations beyond those that are there, whatever the criteria say
    #[arg(short = 'm', long, value_name = "N", value_parser = from_one)]
    more: Option<usize>,
    /// What a controlling job does
    #[arg(long, hide = true)]
    control: bool,
}

const EXAMPLE: &str = "\
The engine is slurm, if none was given. The table [cluster] of case.toml says
what the site wants; gl-run slurm --help lists its keys. The controlling jobs
take the same partition, account, time, memory and threads as a task.

Exit code: 0 it is in the queue, or done; 2 error.

Example:
  gl-init line --from linear
  gl-submit line --engine pbs --out out/line num=12 iterations=1
  gl-status out/line
  gl-cancel out/line";

fn say(text: &str) {
    gl_cli::note("gl-submit", text);
}

fn run(args: &Args) -> Result<()> {
    let out =
        args.request.own_folder(if args.diagnose { Results::Diagnosis } else { Results::Calibration })?;
    let earlier = Record::read(&out)?;
    let mut record = Record {
        engine: args.request.engine.or(earlier.as_ref().map(|it| it.engine)).unwrap_or(Engine::Slurm),
        diagnose: args.diagnose,
        case: args.request.case.clone(),
        folder: env::current_dir().context("the current folder is gone")?,
        given: args.request.given.clone(),
        iterations: args.iterations,
        until: args.more.map(|more| done(&out) + more),
    };
    let engine = record.engine;
    ensure!(engine.is_queue(), "--engine {engine}: has no queue; slurm and pbs have");
    if let Some(earlier) = &earlier {
        record.recall(earlier);
    }
    let cluster = Request { given: record.given.clone(), ..args.request.clone() }.load()?.cluster;
    if let Some(earlier) = earlier.filter(|it| it.engine != engine) {
        let other = of_engine(earlier.engine, &cluster, Patience::here())?;
        let other = Control::of(&out, other.as_ref())?;
        let is_idle = other.job()?.is_none() && other.arrays()?.is_empty();
        ensure!(is_idle, "{}: is in the queue of {}; gl-cancel it first", out.display(), earlier.engine);
    }
    let scheduler = of_engine(engine, &cluster, Patience::here())?;
    scheduler.check()?;
    submit(&record, &out, scheduler.as_ref(), args.control)
}

fn submit(record: &Record, out: &Path, scheduler: &dyn Scheduler, is_control: bool) -> Result<()> {
    if !is_control
        && out.exists()
        && let Some(job) = Control::of(out, scheduler)?.job()?
    {
        say(&format!("{}: is in the queue already, as job {job}", out.display()));
        return Ok(());
    }
    // Whoever has left this job behind may still be about to end.
    let lock = OutLock::take_within(
        out,
        "gl-submit",
        if is_control { Patience::LOCK } else { Duration::ZERO },
        &say,
    )?;
    let control = Control::of(out, scheduler)?;
    if !is_control {
        forgive(out)?;
        record.write(out, &gl_cli::sibling("gl-submit"))?;
        // The first time errors are seen at once; later there may be much to compute, which is not for a login node.
        if is_begun(out)? {
            return control.leave_job(&say);
        }
    }
    if record.advance(out, &gl_cli::sibling(record.driver()), &lock)? {
        return Ok(());
    }
    control.leave_job(&say)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-submit", run(&gl_cli::parse()))
}
