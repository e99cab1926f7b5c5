//! Say where a calibration or diagnosis stands.

mod text;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Parser;
use gl_case::Case;
use gl_engine::control::{Control, Record, batches, stages};
use gl_engine::folder::RunFolder;
use gl_engine::lock::OutLock;
use gl_engine::scheduler::{NoAnswer, Patience, of_engine};
use gl_table::print;

/// Say where a calibration or diagnosis stands: a line an iteration, the runs of the last one, what is in the queue
///
/// The time left is that of the runs of this iteration, by those that have ended since it was started. On a
/// terminal there is a bar. Where the scheduler does not answer within a few seconds, it says what the files say,
/// and that.
#[derive(Parser)]
#[command(name = "gl-status", version, after_help = EXAMPLE)]
struct Args {
    /// Folder of the results
    #[arg(value_name = "OUT")]
    out: PathBuf,
}

const EXAMPLE: &str = "\
Exit code: 0 finished or under way; 1 it has come to a halt; 2 error.

Example:
  gl-init line --from linear
  gl-submit line --engine pbs --out out/line num=12 iterations=1
  gl-status out/line";

/// Whether it has finished, or is under way.
fn run(args: &Args) -> Result<bool> {
    let out = &args.out;
    let stages = if out.is_dir() { stages(out)? } else { Vec::new() };
    ensure!(
        !stages.is_empty(),
        "{}: no calibration there; gl-calibrate or gl-submit make one",
        out.display()
    );
    let mut said = String::new();
    for stage in &stages {
        said.push_str(&text::finished_stage(out, stage)?);
    }
    if text::is_finished(out, &stages) {
        return print(&(said + "finished\n")).map(|()| true);
    }
    let Some(record) = Record::read(out)? else {
        said.push_str(&text::runs(out, &stages, None)?);
        let holder = OutLock::holder(out);
        let batches = stages.iter().map(|stage| batches(stage)).collect::<Result<Vec<_>>>()?.concat();
        let is_driven =
            holder.is_some() || batches.iter().any(|batch| RunFolder::is_held(&batch.join("runs")));
        said.push_str(&match holder {
            Some(holder) => format!("{holder} works here\n"),
            None if is_driven => String::new(),
            None => "nothing works here; the same call goes on from here\n".to_owned(),
        });
        return print(&said).map(|()| is_driven);
    };
    let cluster = Case::load(&record.folder.join(&record.case), &record.given).map(|case| case.cluster);
    let scheduler = of_engine(record.engine, &cluster.unwrap_or_default(), Patience::short())?;
    let control = Control::of(out, scheduler.as_ref())?;
    let queue = control.arrays().and_then(|arrays| Ok((arrays, control.job()?)));
    let (arrays, job) = match queue {
        Ok(queue) => queue,
        Err(error) if error.is::<NoAnswer>() => {
            print(&(said + &text::runs(out, &stages, None)?))?;
            return Err(error.context("the above is what the files say"));
        }
        Err(error) => return Err(error),
    };
    said.push_str(&text::runs(out, &stages, Some(&arrays))?);
    let all: Vec<_> = arrays.into_iter().chain(job.clone()).collect();
    for line in scheduler.held_up(&all) {
        said.push_str(&format!("{line}\n"));
    }
    said.push_str(&text::controlling_job(out, job.as_ref()));
    print(&said).map(|()| job.is_some())
}

/// The name of a stage as people say it: `base: iteration 2`.
fn name(out: &Path, stage: &Path) -> String {
    let within = stage.strip_prefix(out).unwrap_or(stage);
    let last = within.file_name().unwrap_or_default().to_string_lossy();
    let last = last.replace("iter", "iteration ").replace("round", "round ");
    match within.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        Some(parent) => format!("{}: {last}", parent.display()),
        None => last,
    }
}

fn main() -> ExitCode {
    gl_cli::finish("gl-status", run(&gl_cli::parse()))
}
