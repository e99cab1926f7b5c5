//! Run a simulator at every sample of a table.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags, rustdoc::broken_intra_doc_links)]

mod call;
mod inner;
mod queue;
mod tables;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};
use gl_case::Engine;
use gl_engine::{Say, embedded, local, yade_batch};

use call::Shared;

/// The name in front of messages.
const NAME: &str = "gl-run";

/// Run a simulator at every sample of a table, and keep what is complete.
///
/// A run leaves <description>_sim.txt and <description>_param.txt in DIR, its output in <description>.log and
/// its exit code in <description>.status (124 TIMEOUT, 0 NO_RESULT). Runs that are complete are not run
/// again, so that after an interruption the same call goes on.
#[derive(Parser)]
#[command(name = "gl-run", version, after_help = EXAMPLE)]
struct Args {
    #[command(subcommand)]
    task: Task,
}

const EXAMPLE: &str = "\
Exit code: 0 all rows were tried, failed or not; 1 some were not; 2 the input is
wrong, nothing ran.

Example:
  gl-run embedded samples.txt gl-contact runs
  gl-run status samples.txt runs";

const LOCAL: &str = "\
Example:
  gl-run local samples.txt \\
    'python3 {case}/model.py {description} {E_m} {nu}' runs --jobs 4";

#[derive(Subcommand)]
enum Task {
    /// Run the rows on this machine, several at a time
    #[command(after_help = LOCAL)]
    Local(Shared),
    /// Run the rows of a Yade script by yade-batch, with its overview at http://localhost:9080
    YadeBatch(Shared),
    /// Run a simulator that takes the whole table, called as MODEL -s SAMPLES DIR, such as gl-contact
    Embedded(Shared),
    /// Run the rows as job arrays of SLURM, and wait until they have ended
    #[command(after_help = queue::SETTINGS)]
    Slurm(queue::Queue),
    /// Run the rows as job arrays of PBS, or jobs of Torque, and wait until they have ended
    #[command(after_help = queue::SETTINGS)]
    Pbs(queue::Queue),
    /// What became of each run: a table, sample status detail
    Status(tables::Status),
    /// Pack the loose runs of a folder into few files
    Pack(tables::Pack),
    /// Take the files of runs out of packed files
    Unpack(tables::Unpack),
    #[command(flatten)]
    Inner(inner::Inner),
}

impl Task {
    /// [`Shared::take_kept`], of those that make runs.
    fn take_kept(&self, say: Say) -> Result<bool> {
        match self {
            Self::Local(shared) | Self::YadeBatch(shared) | Self::Embedded(shared) => shared.take_kept(say),
            Self::Slurm(queue) | Self::Pbs(queue) => queue.shared.take_kept(say),
            _ => Ok(false),
        }
    }
}

/// A message for the user.
fn say(message: &str) {
    gl_cli::note(NAME, message);
}

/// Whether all rows were tried.
fn run(task: &Task) -> Result<bool> {
    let say: Say = &say;
    if task.take_kept(say)? {
        return Ok(true);
    }
    let report = match task {
        Task::Local(shared) => {
            let (mut batch, jobs) = shared.check()?;
            local::run(&mut batch, jobs, say)?
        }
        Task::YadeBatch(shared) => {
            let (mut batch, threads) = shared.check()?;
            yade_batch::run(&mut batch, threads, say)?
        }
        Task::Embedded(shared) => {
            return Err(embedded::become_model(&shared.call()?, shared.jobs()?, say));
        }
        Task::Slurm(queue) => match queue.run(Engine::Slurm, say)? {
            Some(report) => report,
            None => return Ok(false),
        },
        Task::Pbs(queue) => match queue.run(Engine::Pbs, say)? {
            Some(report) => report,
            None => return Ok(false),
        },
        Task::Status(status) => return status.run(),
        Task::Pack(pack) => return pack.run(),
        Task::Unpack(unpack) => return unpack.run(),
        Task::Inner(_) => return Ok(false),
    };
    report.messages().iter().for_each(|message| say(message));
    Ok(report.all_were_tried())
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    match &args.task {
        Task::Inner(inner) => inner.run(),
        task => gl_cli::finish(NAME, run(task)),
    }
}
