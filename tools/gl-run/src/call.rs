//! The call that the engines share.

use std::env;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;
use std::thread;

use anyhow::{Context, Result, bail};
use clap::Args;
use gl_engine::Say;
use gl_engine::batch_table::BatchTable;
use gl_engine::call::{Batch, Call};
use gl_engine::complete::missing;
use gl_engine::job::Limit;
use gl_engine::kept;
use gl_engine::model::find_program;

/// What to run, and where it goes.
#[derive(Args)]
pub struct Shared {
    /// Table of the samples, as gl-sample writes it, or any batch table of Yade's that has a description
    pub samples: PathBuf,
    /// Yade script (a word that ends in .py, looked for in CASE, then here), or a command: {NAME} stands for
    /// a column of SAMPLES, {description} for the run's name, {dir} for its scratch folder, {case} for CASE.
    /// Quotes group words; no shell reads it
    pub model: String,
    /// Folder for the runs
    pub dir: PathBuf,
    /// Folder of the case [env: CASE] [default: .]
    #[arg(long, value_name = "DIR")]
    case: Option<PathBuf>,
    /// Runs at a time; with yade-batch, threads [env: JOBS] [default: all processors]
    #[arg(short, long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Time limit of a run, such as 90, 10m, 2h [env: RUN_TIMEOUT] [default: none]
    #[arg(long, value_name = "T")]
    run_timeout: Option<Limit>,
    /// Put many runs into one file *_packed.txt, with a log and a status only of those that failed
    /// [env: PACKED=1]
    #[arg(long)]
    packed: bool,
    /// Take runs of the same parameters from this packed file, compressed if it ends in .gz, instead of making them
    #[arg(long, value_name = "FILE")]
    kept: Option<PathBuf>,
    /// Where the runs have their scratch folders, such as a fast disk [env: GL_SCRATCH] [default: in DIR]
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Add how long each run took to this table: sample seconds processor_seconds exit. With embedded, MODEL is told of
    /// it by GL_TIMES, and may do so
    #[arg(long, value_name = "FILE")]
    times: Option<PathBuf>,
}

impl Shared {
    /// The call, checked (see [`Call::check`]), and how many runs at a time.
    pub fn check(&self) -> Result<(Batch, NonZeroUsize)> {
        let all = || thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let jobs = self.jobs()?.unwrap_or_else(all);
        Ok((self.call()?.check()?, jobs))
    }

    /// The call, with what the environment says where the options do not.
    pub fn call(&self) -> Result<Call> {
        let packed = match given("PACKED").as_deref() {
            _ if self.packed => true,
            None | Some("0") => false,
            Some("1") => true,
            Some(other) => bail!("PACKED={other}: give 1 for packed runs, or 0"),
        };
        Ok(Call {
            samples: self.samples.clone(),
            model: self.model.clone(),
            dir: self.dir.clone(),
            case: self.case(),
            limit: self
                .run_timeout
                .map_or_else(|| setting("RUN_TIMEOUT"), |limit| Ok(Some(limit)))?
                .unwrap_or_default(),
            packed,
            scratch: self.scratch.clone().or_else(|| given("GL_SCRATCH").map(PathBuf::from)),
            times: self.times.clone(),
        })
    }

    /// Take over the runs that are kept, before the model is looked at: whether there is nothing left to be made. Where
    /// Yade is not there to make them, runs that are not among the kept ones are left out.
    pub fn take_kept(&self, say: Say) -> Result<bool> {
        let Some(kept) = &self.kept else { return Ok(false) };
        let table = BatchTable::read(&self.samples)?;
        let taken = kept::take(kept, &table, &self.dir, say)?;
        let (rows, kept) = (table.len(), kept.display());
        if taken > 0 {
            say(&format!(
                "{taken} of {rows} runs are not made but taken from {kept}, with the same parameters"
            ));
        }
        let left = missing(&table, &self.dir)?.len();
        let is_yade = self.model.trim().ends_with(".py");
        if left == 0 || left == rows || !is_yade || find_program("yade").is_some() {
            return Ok(left == 0);
        }
        say(&format!(
            "{left} of {rows} runs are not in {kept}, and are left out: Yade, which makes them, is not installed"
        ));
        Ok(true)
    }

    /// The folder of the case.
    pub fn case(&self) -> PathBuf {
        let given = || given("CASE").map(PathBuf::from);
        self.case.clone().or_else(given).unwrap_or_else(|| PathBuf::from("."))
    }

    /// Runs at a time, where it was said.
    pub fn jobs(&self) -> Result<Option<NonZeroUsize>> {
        self.jobs.map_or_else(|| setting("JOBS"), |jobs| Ok(Some(jobs)))
    }
}

/// A variable of the environment that is not empty.
fn given(name: &str) -> Option<String> {
    env::var_os(name).map(|value| value.to_string_lossy().into_owned()).filter(|value| !value.is_empty())
}

fn setting<T: FromStr<Err: Into<anyhow::Error>>>(name: &str) -> Result<Option<T>> {
    given(name)
        .map(|value| value.parse().map_err(Into::into).with_context(|| format!("{name}={value}")))
        .transpose()
}
