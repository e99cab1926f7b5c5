//! What gl-run calls itself for: processes between an engine and its runs.

use std::env;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Subcommand;
use gl_engine::batch_table::BatchTable;
use gl_engine::cluster::run_task;
use gl_engine::job::Job;
use gl_engine::process::{DISK_UNUSABLE, Ending, Termination, is_disk_unusable, start, supervise, tie};
use gl_engine::row::{Log, Outcome, run_rows};
use rustix::process::Signal;

use crate::NAME;

#[derive(Subcommand)]
pub enum Inner {
    /// Run the rows of the table on stdin, as WORK says; a line on stdout for each that has ended
    #[command(hide = true)]
    Row { work: PathBuf, parent: u32 },
    /// Run the row that yade-batch names by YADE_BATCH, in the folder of that table
    #[command(hide = true)]
    BatchRow,
    /// Run a command, and end it with the parent
    #[command(hide = true)]
    Guard {
        parent: u32,
        #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<OsString>,
    },
    /// Become a command that is killed with the parent
    #[command(hide = true)]
    Start {
        parent: u32,
        #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<OsString>,
    },
    /// Run the rows of a task of an array whose first task is FIRST, as WORK says
    #[command(hide = true)]
    Task { work: PathBuf, first: usize },
}

/// The exit code of a process that was told to end.
const TERMINATED: u8 = 143;

impl Inner {
    pub fn run(&self) -> ExitCode {
        let code = match self {
            Self::Row { work, parent } => row(work, *parent),
            Self::BatchRow => batch_row(),
            Self::Guard { parent, words } => guard(*parent, words),
            Self::Start { parent, words } => {
                let (code, error) = start(*parent, words);
                gl_cli::note(NAME, format_args!("{error:#}"));
                Ok(code)
            }
            Self::Task { work, first } => task(work, *first),
        };
        code.map_or_else(
            |error| {
                gl_cli::note(NAME, format_args!("{error:#}"));
                ExitCode::from(if is_disk_unusable(&error) { DISK_UNUSABLE } else { 1 })
            },
            ExitCode::from,
        )
    }
}

fn row(work: &Path, parent: u32) -> Result<u8> {
    let termination = Termination::on_signals()?;
    tie(Signal::TERM, parent)?;
    let table = BatchTable::read(Path::new("-"))?;
    let rows: Vec<usize> = (0..table.len()).collect();
    let ended = |row: usize, status: &str| {
        // Who would hear it is gone: the end is near.
        let _ = writeln!(std::io::stdout(), "{}\t{status}", table.name(row));
    };
    let process = std::process::id().to_string();
    Ok(code(run_rows(&Job::load(work)?, &table, &rows, &process, Log::File, &termination, ended)?, false))
}

fn batch_row() -> Result<u8> {
    let termination = Termination::on_signals()?;
    let batch = env::var("YADE_BATCH").context("YADE_BATCH is not set")?;
    let (path, line) =
        batch.rsplit_once(':').with_context(|| format!("YADE_BATCH={batch}: no TABLE:LINE"))?;
    let row = line.parse::<usize>().ok().and_then(|line| line.checked_sub(2));
    let row = row.with_context(|| format!("YADE_BATCH={batch}: no row is on that line"))?;
    let table = BatchTable::read(Path::new(path))?.select(&[row]);
    let job = Job::load(&env::current_dir().context("the current folder is gone")?)?;
    let process = std::process::id().to_string();
    Ok(code(run_rows(&job, &table, &[0], &process, Log::Stdout, &termination, |_, _| {})?, true))
}

fn task(work: &Path, first: usize) -> Result<u8> {
    Ok(code(run_task(work, first, &Termination::on_signals()?)?, false))
}

fn guard(parent: u32, words: &[OsString]) -> Result<u8> {
    let termination = Termination::on_signals()?;
    tie(Signal::TERM, parent)?;
    let (program, arguments) = words.split_first().context("no command to guard")?;
    let ending = supervise(Command::new(program).args(arguments), None, &termination)
        .with_context(|| program.display().to_string())?;
    Ok(match ending {
        Ending::Exited(code) => u8::try_from(code).unwrap_or(1),
        Ending::TimedOut | Ending::Terminated => TERMINATED,
    })
}

/// The exit code; to most engines a failed run is no failure of theirs, but yade-batch wants to know.
fn code(outcome: Outcome, is_told: bool) -> u8 {
    match outcome {
        Outcome::Terminated => TERMINATED,
        Outcome::Tried(code) if is_told => u8::try_from(code).unwrap_or(1),
        Outcome::Tried(_) => 0,
    }
}
