//! Running rows of a table, one after another.
//!
//! Each run has a scratch folder of its own, so that one that is killed leaves nothing under a final name.
//! When it ends well its files, those that begin with its name, are moved to the folder of the runs.

use std::env;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result};
use gl_inference::collect::completeness_in;
use tempfile::TempDir;

use crate::batch_table::BatchTable;
use crate::call::file;
use crate::job::Job;
use crate::model::{Model, path_with_own};
use crate::process::{Ending, Termination, keep_log, supervise, tied};
use crate::publish::{Packer, publish, put_status};
use crate::times::Clock;

/// Where the log of a run goes, and who runs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Log {
    /// Into `NAME.log`, up to [`crate::process::LONGEST_LOG`].
    File,
    /// To standard output, as far, where it is yade-batch that keeps it.
    Stdout,
}

/// How running some rows came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All rows were tried; the exit code of the last one.
    Tried(i32),
    /// This process was told to end.
    Terminated,
}

/// Run rows of a table one after another. `ended` hears of each row as it ends, with its status.
///
/// * `task` — what `NAME.running` says as long as the run goes on, by which a task of a cluster is found
///   again.
///
/// # Errors
/// If a scratch folder, a log or a result cannot be written, as where the disk is full: this row and those
/// after it were not tried. A run that fails is no error.
pub fn run_rows(
    job: &Job,
    table: &BatchTable,
    rows: &[usize],
    task: &str,
    log: Log,
    termination: &Termination,
    mut ended: impl FnMut(usize, &str),
) -> Result<Outcome> {
    let mut packer = job.packed.then(|| Packer::new(&job.dir));
    let mut code = 0;
    for &row in rows {
        let mut run = Run { job, table, row, name: table.name(row), log };
        let status = run.run(task, &mut packer, termination).with_context(|| run.name.to_owned())?;
        ended(row, &status.text());
        if status.ending == Ending::Terminated {
            return Ok(Outcome::Terminated);
        }
        code = status.code();
    }
    Ok(Outcome::Tried(code))
}

/// How a run ended.
struct Status {
    ending: Ending,
    /// What is wrong with its result, if it ended well.
    flaw: Option<&'static str>,
}

impl Status {
    fn code(&self) -> i32 {
        self.ending.code()
    }

    /// An exit code, and a word where it was not the model that ended it, or it left no complete run.
    fn text(&self) -> String {
        let word = match self.ending {
            Ending::TimedOut => Some("TIMEOUT"),
            Ending::Terminated => Some("TERMINATED"),
            Ending::Exited(_) => self.flaw,
        };
        word.map_or_else(|| self.code().to_string(), |word| format!("{} {word}", self.code()))
    }
}

/// A row that is run.
struct Run<'a> {
    job: &'a Job,
    table: &'a BatchTable,
    row: usize,
    name: &'a str,
    log: Log,
}

impl Run<'_> {
    fn run(&mut self, task: &str, packer: &mut Option<Packer>, termination: &Termination) -> Result<Status> {
        let (dir, work) = (&self.job.dir, self.job.work());
        fs::create_dir_all(&work).with_context(|| format!("{}: cannot be made", work.display()))?;
        // Stays behind when the run is killed, and tells which task it was in.
        let marker = work.join(format!("{}.running", self.name));
        fs::write(&marker, format!("{task}\n"))
            .with_context(|| format!("{}: cannot be written", marker.display()))?;
        let scratch = self.scratch(&work)?;
        // What is there belongs to other parameters, or is half a run.
        for ending in ["_sim.txt", "_param.txt", ".status"] {
            gl_table::remove(&file(dir, self.name, ending))?;
        }
        let clock = Clock::start()?;
        let ending = self.supervise(scratch.path(), termination)?;
        clock.stop(self.job, self.name, &ending)?;
        let mut status = Status { ending, flaw: None };
        if ending == Ending::Exited(0) {
            status.flaw = self.flaw(scratch.path())?;
        }
        if ending == Ending::Exited(0) && status.flaw != Some(NO_RESULT) {
            self.publish(scratch.path(), packer, &status)?;
        } else {
            put_status(dir, self.name, &status.text())?;
        }
        gl_table::remove(&marker)?;
        Ok(status)
    }

    fn scratch(&self, work: &Path) -> Result<TempDir> {
        let place = self.job.scratch.as_deref().unwrap_or(work);
        tempfile::Builder::new()
            .prefix(&format!("{}.", self.name))
            .tempdir_in(place)
            .with_context(|| format!("{}: no scratch folder can be made", place.display()))
    }

    fn supervise(&self, scratch: &Path, termination: &Termination) -> Result<Ending> {
        let mut command = self.command(scratch)?;
        let (reader, writer) = io::pipe().context("no pipe for the log")?;
        let log = match self.log {
            Log::File => {
                let path = file(&self.job.dir, self.name, ".log");
                let log =
                    File::create(&path).with_context(|| format!("{}: cannot be written", path.display()))?;
                keep_log(reader, log)
            }
            Log::Stdout => keep_log(reader, io::stdout()),
        };
        let copy = writer.try_clone().context("no pipe for the log")?;
        command.stdin(Stdio::null()).stdout(copy).stderr(writer);
        let ending = supervise(&mut command, self.job.limit, termination)
            .with_context(|| format!("{}: cannot be started", self.job.gl_run.display()))?;
        // It holds the pipe as well.
        drop(command);
        log.finish();
        Ok(ending)
    }

    /// The command for the row, in its scratch folder.
    fn command(&self, scratch: &Path) -> Result<Command> {
        let Self { job, table, row, .. } = self;
        let mut command = tied(&job.gl_run);
        match &job.model {
            Model::Yade(script) => {
                // A table of its own, since Yade reads all rows; a relative path, since Yade splits it at a
                // colon.
                let own = scratch.join("samples.txt");
                fs::write(&own, table.select(&[*row]).text())
                    .with_context(|| format!("{}: cannot be written", own.display()))?;
                let threads = table.threads(*row).map_or_else(|| job.threads.to_string(), str::to_owned);
                command.args(["yade", "-n", "-x", "-j", &threads]).arg(script);
                command.env("YADE_BATCH", "samples.txt:2");
            }
            Model::Command(words) => {
                command.args(Model::fill_in(words, table, *row, &job.case, scratch));
            }
        }
        if let Some(threads) = table.threads(*row) {
            command.env("OMP_NUM_THREADS", threads);
        }
        let given = env::var_os("PYTHONPATH").filter(|path| !path.is_empty());
        let folders = [job.work()].into_iter().chain(given.iter().flat_map(env::split_paths));
        // A path with a colon cannot be in it; Call::check has refused that for Yade scripts.
        if let Ok(path) = env::join_paths(folders) {
            command.env("PYTHONPATH", path);
        }
        command.env("PATH", path_with_own()).env("CASE", &job.case).current_dir(scratch);
        Ok(command)
    }

    /// What is wrong with the result of a model that has ended well. One that wrote no parameters gets those
    /// of its row: a command need not say what it was called with.
    fn flaw(&self, scratch: &Path) -> Result<Option<&'static str>> {
        let simulation = file(scratch, self.name, "_sim.txt");
        if !fs::metadata(&simulation).is_ok_and(|found| found.is_file() && found.len() > 0) {
            return Ok(Some(NO_RESULT));
        }
        let parameters = file(scratch, self.name, "_param.txt");
        if !parameters.exists() {
            fs::write(&parameters, self.parameters())
                .with_context(|| format!("{}: cannot be written", parameters.display()))?;
        }
        let own = self.table.select(&[self.row]);
        let status = completeness_in(own.samples(), scratch, Vec::new())?;
        Ok(status.first().and_then(|status| status.as_ref().err()).map(|failure| failure.code()))
    }

    /// The table of the row's parameters, as they stand in the samples table.
    fn parameters(&self) -> String {
        let names = &self.table.samples().parameters;
        let cells: Vec<&str> = names.iter().filter_map(|name| self.table.cell(self.row, name)).collect();
        format!("{}\n{}\n", names.join("\t"), cells.join("\t"))
    }

    fn publish(&self, scratch: &Path, packer: &mut Option<Packer>, status: &Status) -> Result<()> {
        let Some(packer) = packer else {
            return publish(scratch, &self.job.dir, self.name, &status.text());
        };
        if status.flaw.is_some() {
            put_status(&self.job.dir, self.name, &status.text())?;
        } else {
            // First, so that a run that is complete has none, whenever this is killed.
            gl_table::remove(&file(&self.job.dir, self.name, ".log"))?;
        }
        packer.add(scratch, self.name)
    }
}

/// The model ended well and left no simulation.
const NO_RESULT: &str = "NO_RESULT";
