//! Runs as job arrays of a scheduler.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use gl_case::{Case, Cluster, Engine};
use gl_engine::Say;
use gl_engine::cluster::{Array, Outcome};
use gl_engine::job::Limit;
use gl_engine::report::Report;
use gl_engine::scheduler::{Noted, Patience, of_engine};

use crate::call::Shared;

#[derive(Args)]
pub struct Queue {
    #[command(flatten)]
    pub shared: Shared,
    /// Print a line a submitted array, NAME ID, and return with exit code 1, as long as runs are in the queue;
    /// called when they have ended, submit again what failed or was lost
    #[arg(long)]
    no_wait: bool,
    /// What the site wants, instead of the table [cluster] in case.toml of the case
    #[arg(long, value_name = "FILE")]
    cluster: Option<PathBuf>,
    /// A setting of case.toml for this call, such as cluster.partition=short; may be repeated
    #[arg(long, value_name = "KEY=VALUE", conflicts_with = "cluster")]
    set: Vec<String>,
}

/// The settings of a site.
pub const SETTINGS: &str = "\
The table [cluster] of case.toml, or a FILE with these keys at its top:
  partition account qos time mem modules
                  as the scheduler and module know them (none); time in minutes;
                  to PBS, partition is the queue, and there is no qos
  threads         processors of a run (1)
  rows_per_task   rows that a task runs one after another (1)
  max_concurrent  tasks at a time (no limit); Torque has none
  run_timeout     time limit of a run, such as 90, \"10m\", \"2h\" (none)
  retries         times that a failed run is submitted again (0)
  packed          true: a file a task instead of the files of each run (false)
  scratch         the node's own disk (SLURM_TMPDIR, TMPDIR or /tmp)
  poll            seconds between questions to the scheduler (2, growing to 30)

A run that the scheduler killed has its reason in <description>.status (137
TIMEOUT, OUT_OF_MEMORY, NODE_FAIL, …). Nothing is lost when this is killed: the
same call waits for what is in the queue, and submits what is missing. So it
does with runs that no task came to; one that is lost three times in a row has
137 LOST. The scheduler's own messages are in DIR/slurm.log, or with PBS in
DIR/.run as long as the tasks live.

Exit code: 0 all rows were tried, failed or not; 1 some were not, or with
--no-wait runs are in the queue; 2 the input is wrong, nothing ran.";

impl Queue {
    /// Run the rows, or what became of them; nothing as long as they are in the queue.
    pub fn run(&self, engine: Engine, say: Say) -> Result<Option<Report>> {
        let call = self.shared.call()?;
        let path = call.case.join(Case::FILE);
        let (cluster, packed) = match &self.cluster {
            Some(file) => (Cluster::read(file)?, None),
            None if path.exists() => {
                let case = Case::load(&call.case, &self.set)?;
                (case.cluster, case.packed)
            }
            None => (Cluster::default(), None),
        };
        let limit = cluster.run_timeout.as_deref().map(str::parse::<Limit>).transpose();
        let limit = limit.context("run_timeout of the cluster")?.unwrap_or_default();
        let mut batch = call.check()?;
        batch.job.threads = cluster.threads;
        batch.job.limit = batch.job.limit.or(limit.0);
        batch.job.packed |= cluster.packed.or(packed).unwrap_or(false);
        let scheduler = of_engine(engine, &cluster, Patience::here())?;
        let array = Array { batch, cluster: &cluster, scheduler: scheduler.as_ref(), say };
        match if self.no_wait { array.advance()? } else { array.run()? } {
            Outcome::Ended(report) => Ok(Some(report)),
            Outcome::Queued(jobs) => print(&jobs).map(|()| None),
        }
    }
}

fn print(jobs: &[Noted]) -> Result<()> {
    let text: String = jobs.iter().map(|job| format!("{job}\n")).collect();
    gl_table::print(&text)
}
