//! What a scheduler is asked, whichever it is.

use std::env;
use std::fmt;
use std::path::Path;
use std::time::Duration;

use anyhow::{Result, bail};
use gl_case::{Cluster, Engine};

use crate::Say;
use crate::pbs::Pbs;
use crate::slurm::Slurm;

/// How long a scheduler that does not answer is asked again.
#[derive(Clone, Debug, PartialEq)]
pub struct Patience {
    /// Seconds between attempts, one more attempt each.
    pub pauses: Vec<u64>,
    /// The longest that one question may take.
    pub limit: Duration,
}

impl Patience {
    /// Of somebody who looks on: an answer within a few seconds, or none.
    pub fn short() -> Self {
        Self { pauses: Vec::new(), limit: Duration::from_secs(3) }
    }

    /// Of somebody who waits at a terminal: a controller may be busy, or away for a moment.
    pub fn medium() -> Self {
        Self { pauses: vec![1, 2, 4], limit: Duration::from_secs(60) }
    }

    /// Of a job, which has time: five minutes.
    pub fn long() -> Self {
        Self { pauses: vec![1, 2, 4, 8, 15, 30, 60, 60, 60, 60], limit: Duration::from_secs(60) }
    }
}

impl Patience {
    /// How long a controlling job waits for whoever left it behind to end.
    pub const LOCK: Duration = Duration::from_secs(600);

    /// Of whoever asks from here: a job, or somebody at a terminal.
    pub fn here() -> Self {
        let is_job = ["SLURM_JOB_ID", "PBS_JOBID"].iter().any(|name| env::var_os(name).is_some());
        if is_job { Self::long() } else { Self::medium() }
    }
}

/// The scheduler of an engine, with what the site wants of a job.
///
/// # Errors
/// If the engine has no queue.
pub fn of_engine(engine: Engine, cluster: &Cluster, patience: Patience) -> Result<Box<dyn Scheduler>> {
    match engine {
        Engine::Slurm => Ok(Box::new(Slurm::new(cluster, patience))),
        Engine::Pbs => Ok(Box::new(Pbs::new(cluster, patience))),
        _ => bail!("{engine}: has no queue; slurm and pbs have"),
    }
}

/// The scheduler did not answer, which is not to say that nothing is in its queue.
#[derive(Debug)]
pub struct NoAnswer(pub String);

impl fmt::Display for NoAnswer {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "the scheduler does not answer")?;
        if self.0.is_empty() { Ok(()) } else { write!(f, ": {}", self.0) }
    }
}

impl std::error::Error for NoAnswer {}

/// A job or an array as it was noted: its name before it was submitted, its id after.
#[derive(Clone, Debug, PartialEq)]
pub struct Noted {
    /// The name that it was submitted under.
    pub name: String,
    /// What the scheduler called it, if its answer came.
    pub id: Option<String>,
}

impl Noted {
    /// From a line `NAME ID` or `NAME`.
    pub fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        Some(Self { name: words.next()?.to_owned(), id: words.next().map(str::to_owned) })
    }
}

impl fmt::Display for Noted {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", self.name)?;
        if let Some(id) = &self.id { write!(f, " {id}") } else { Ok(()) }
    }
}

/// A job or tasks of an array that the scheduler knows.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Id of the job, of the whole array where it is one.
    pub id: String,
    /// Id of the task or tasks of the array.
    pub task: String,
    /// Its name; empty where the scheduler does not say.
    pub name: String,
    /// Its state in lower case, such as `pending`.
    pub state: String,
    /// Why it is in that state; empty where there is nothing to say.
    pub reason: String,
}

impl Job {
    /// Whether it has ended but for what is tidied up after it.
    pub fn is_ending(&self) -> bool {
        self.state == "completing"
    }

    /// Whether somebody must release it, or it will never start.
    pub fn is_held(&self) -> bool {
        let reason = self.reason.to_lowercase();
        self.state.contains("hold") || reason.contains("held") || reason == "dependencyneversatisfied"
    }
}

impl fmt::Display for Job {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.task, self.state)?;
        if self.reason.is_empty() { Ok(()) } else { write!(f, " ({})", self.reason) }
    }
}

/// Tasks of an array, numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tasks {
    /// How many.
    pub count: usize,
    /// How many at a time.
    pub at_once: Option<usize>,
}

/// Where a job's own output goes.
#[derive(Clone, Copy, Debug)]
pub enum Log<'a> {
    /// Of the tasks of an array: all into `file`, or where the scheduler cannot do that each into a file in
    /// `folder`.
    Tasks {
        /// The file for all.
        file: &'a Path,
        /// The folder for a file a task.
        folder: &'a Path,
    },
    /// Into a file of its own, which it begins anew.
    File(&'a Path),
}

/// A job to be submitted.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// Its name.
    pub name: &'a str,
    /// The script that it runs.
    pub script: &'a Path,
    /// The tasks, where it is an array.
    pub tasks: Option<Tasks>,
    /// Ids of the jobs after whose end it starts, however they end.
    pub after: &'a [String],
    /// The folder that it starts in.
    pub folder: &'a Path,
    /// Where its output goes.
    pub log: Log<'a>,
}

/// A scheduler of jobs.
pub trait Scheduler {
    /// The engine of this scheduler, as it is called on the command line.
    fn engine(&self) -> &'static str;

    /// Refuse where its programs are not installed.
    ///
    /// # Errors
    /// If they are not.
    fn check(&self) -> Result<()>;

    /// Tasks that an array may have; nothing where there are no arrays.
    fn largest_array(&self) -> Option<usize>;

    /// Whether arrays with a limit of tasks at a time have to follow one another, as the limit is that of one.
    fn follows_arrays(&self) -> bool;

    /// The name of the array whose first task has this number.
    fn array_name(&self, first: usize) -> String;

    /// The name of the controlling job of what is in the folder `out`.
    fn control_name(&self, out: &Path) -> String;

    /// The job that this process is in, if it is in one.
    fn own_job(&self) -> Option<String>;

    /// Submit a job; what the scheduler says beside its id goes to `say`.
    ///
    /// # Returns
    /// Its id.
    ///
    /// # Errors
    /// If it was refused, or the scheduler does not answer ([`NoAnswer`]).
    fn submit(&self, request: &Request, say: Say) -> Result<String>;

    /// Those of the jobs that are in the queue.
    ///
    /// # Errors
    /// [`NoAnswer`].
    fn queued(&self, noted: &[Noted]) -> Result<Vec<Job>>;

    /// How the scheduler says that a task has ended, if it says.
    fn ending(&self, task: &str) -> Option<String>;

    /// Take jobs that are in the queue out of it; what the scheduler says to that goes to `say`.
    fn cancel(&self, jobs: &[Job], say: Say);

    /// What keeps jobs from starting, and what to type against it: a line each.
    fn held_up(&self, jobs: &[Job]) -> Vec<String>;
}
