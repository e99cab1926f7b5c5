//! Runs as job arrays: the missing rows are cut into tasks, and asked for again until each was tried.
//!
//! Beside what [`crate::folder::RunFolder`] names, `DIR/.run` holds
//!
//! | file | |
//! | --- | --- |
//! | `task.json` | [`Task`], what a task of the array knows beside [`crate::job::Job`] |
//! | `task.sh`, `task-N.sh` | what the scheduler starts: the latter is an array whose first task is N |
//! | `jobs` | `NAME ID`, an array or job a line; the name is there before anything is submitted |
//! | `started` | since when runs end |
//! | `failures` | row, a line each time that it failed |
//! | `idle` | how many of the last rounds came to no row at all |
//!
//! A round is what is submitted at once. When nothing of it is in the queue any more, the rows that no task came to,
//! since it was killed before or the scheduler lost it, go into the next round, and so do those that failed, as often
//! as the site's `retries` allows.

use std::collections::HashMap;
use std::env;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use gl_case::Cluster;
use gl_table::Sink;
use serde::{Deserialize, Serialize};

use crate::Say;
use crate::call::Batch;
use crate::complete::{missing, missing_of};
use crate::control::noted_in;
use crate::folder::RunFolder;
use crate::job::Job;
use crate::process::Termination;
use crate::publish::put_status;
use crate::report::{Report, report};
use crate::row::{Log as RunLog, Outcome as RowOutcome, run_rows};
use crate::scheduler::{Log, NoAnswer, Noted, Request, Scheduler, Tasks};
use gl_case::shell::quoted;
use gl_table::{remove, write_whole};

/// Rounds in a row that may come to no row at all.
const IDLE_ROUNDS: usize = 3;
/// Longest time between questions to the scheduler, which others share; they begin at two seconds.
const LONGEST_PAUSE: f64 = 30.0;

/// Status of a run whose task was told to end.
const TERMINATED: &str = "143 TERMINATED";

/// What a task of the array knows.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Task {
    /// The rows to run, one task's behind the other's.
    pub rows: Vec<usize>,
    /// How many of them a task runs.
    pub rows_per_task: usize,
    /// Folder on the node's own disk, where the site names one.
    pub scratch: Option<PathBuf>,
}

impl Task {
    const FILE: &str = "task.json";

    /// The one that was left in a folder `.run`.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn load(work: &Path) -> Result<Self> {
        let path = work.join(Self::FILE);
        let text = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        serde_json::from_slice(&text).with_context(|| path.display().to_string())
    }

    fn save(&self, work: &Path) -> Result<()> {
        let path = work.join(Self::FILE);
        let mut sink = Sink::create(Some(&path))?;
        serde_json::to_writer(&mut sink, self).with_context(|| path.display().to_string())?;
        sink.finish()
    }

    /// The rows of a task.
    fn share(&self, number: usize) -> &[usize] {
        let first = (number * self.rows_per_task).min(self.rows.len());
        &self.rows[first..(first + self.rows_per_task).min(self.rows.len())]
    }
}

/// What became of a call.
#[derive(Debug)]
pub enum Outcome {
    /// Nothing is in the queue any more.
    Ended(Report),
    /// These are in the queue.
    Queued(Vec<Noted>),
}

/// The runs of a table as arrays of a scheduler.
pub struct Array<'a> {
    /// What to run.
    pub batch: Batch,
    /// What the site wants.
    pub cluster: &'a Cluster,
    /// Where it is run.
    pub scheduler: &'a dyn Scheduler,
    /// Who hears how it goes on.
    pub say: Say<'a>,
}

impl Array<'_> {
    /// Submit what is missing and wait until every row was tried. Where runs are in the queue already, since an
    /// earlier call was killed, it waits for those first.
    ///
    /// # Errors
    /// If a file cannot be read or written, or the scheduler refuses.
    pub fn run(mut self) -> Result<Outcome> {
        self.batch.folder.lock(self.say)?;
        if self.jobs_file().exists() && self.is_own()? {
            (self.say)(&format!(
                "{}: waiting for the runs that are in the queue already",
                self.dir().display()
            ));
            self.wait()?;
            self.settle()?;
        }
        let before = self.begin()?;
        let mut rows = before.clone();
        while !rows.is_empty() {
            self.submit(&rows)?;
            self.wait()?;
            self.settle()?;
            rows = self.next_round()?;
        }
        self.end(&before)
    }

    /// Submit what is missing, unless runs are in the queue already, and do not wait. Called again when they have
    /// ended, it goes on with those that failed or were lost.
    ///
    /// # Errors
    /// See [`Array::run`]; and [`NoAnswer`].
    pub fn advance(mut self) -> Result<Outcome> {
        self.batch.folder.lock(self.say)?;
        let mut goes_on = false;
        if self.jobs_file().exists() && self.is_own()? {
            let noted = self.jobs()?;
            if !self.scheduler.queued(&noted)?.is_empty() {
                (self.say)(&format!("{}: runs are in the queue already", self.dir().display()));
                return Ok(Outcome::Queued(noted));
            }
            self.settle()?;
            let is_same =
                || RunFolder::table(&self.work()).is_ok_and(|table| table.text() == self.batch.table.text());
            goes_on = self.idle_file().exists() && is_same();
        }
        let (before, rows) = if goes_on {
            (missing(&self.batch.table, self.dir())?, self.next_round()?)
        } else {
            let before = self.begin()?;
            (before.clone(), before)
        };
        if rows.is_empty() {
            return self.end(&before);
        }
        Ok(Outcome::Queued(self.submit(&rows)?))
    }

    fn dir(&self) -> &Path {
        self.batch.folder.dir()
    }

    fn work(&self) -> PathBuf {
        self.batch.folder.work()
    }

    fn jobs_file(&self) -> PathBuf {
        self.work().join("jobs")
    }

    fn idle_file(&self) -> PathBuf {
        self.work().join("idle")
    }

    fn jobs(&self) -> Result<Vec<Noted>> {
        noted_in(&self.jobs_file())
    }

    /// Whether the runs in the queue are those of this engine.
    fn is_own(&self) -> Result<bool> {
        let path = self.work().join("engine");
        let engine = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        Ok(engine.trim() == self.engine())
    }

    fn engine(&self) -> String {
        format!("gl-run {}", self.scheduler.engine())
    }

    /// The rows that are missing, in a folder that begins anew.
    fn begin(&self) -> Result<Vec<usize>> {
        self.batch.folder.begin(&self.batch.table)?;
        write_whole(&self.idle_file(), b"0\n")?;
        missing(&self.batch.table, self.dir())
    }

    fn end(&self, before: &[usize]) -> Result<Outcome> {
        let report = report(&self.batch.table, self.dir(), before)?;
        self.batch.folder.end()?;
        Ok(Outcome::Ended(report))
    }

    /// Submit rows, as many arrays as the site's limit makes of them.
    fn submit(&self, rows: &[usize]) -> Result<Vec<Noted>> {
        self.scheduler.check()?;
        let work = self.work();
        // From here on a row with a status is one that was tried.
        self.batch.folder.forget(&self.batch.table, rows)?;
        let per_task = self.cluster.rows_per_task;
        let scratch = self.cluster.scratch.as_ref().map(PathBuf::from);
        Task { rows: rows.to_vec(), rows_per_task: per_task, scratch }.save(&work)?;
        self.batch.job.save()?;
        write_whole(&work.join("engine"), format!("{}\n", self.engine()).as_bytes())?;
        write_whole(&work.join("task.sh"), self.task_script().as_bytes())?;

        let count = rows.len().div_ceil(per_task);
        let largest = self.scheduler.largest_array();
        let mut jobs = Vec::new();
        let mut first = 0;
        while first < count {
            let size = (count - first).min(largest.unwrap_or(1));
            let tasks = largest.map(|_| Tasks { count: size, at_once: self.cluster.max_concurrent });
            if let Err(error) = self.submit_array(&mut jobs, first, tasks) {
                if jobs.is_empty() || error.is::<NoAnswer>() {
                    return Err(error);
                }
                // A site may limit how much one has in the queue; the rest are rows that no task came to.
                (self.say)(&format!("{error:#}"));
                (self.say)("the rest is submitted when those before have ended");
                break;
            }
            first += size;
        }
        Ok(jobs)
    }

    /// Submit the tasks from `first` on, and note it: the name before, the id after.
    fn submit_array(&self, jobs: &mut Vec<Noted>, first: usize, tasks: Option<Tasks>) -> Result<()> {
        let script = self.work().join(format!("task-{first}.sh"));
        let task = quoted(&self.work().join("task.sh").display().to_string());
        write_whole(&script, format!("#!/bin/bash\nexec /bin/bash -l {task} {first}\n").as_bytes())?;
        let is_behind = tasks.is_some_and(|tasks| tasks.at_once.is_some()) && self.scheduler.follows_arrays();
        let last = jobs.last().and_then(|job| job.id.clone()).filter(|_| is_behind);
        let name = self.scheduler.array_name(first);
        let after: Vec<String> = last.into_iter().collect();
        jobs.push(Noted { name: name.clone(), id: None });
        self.note(jobs)?;
        let request = Request {
            name: &name,
            script: &script,
            tasks,
            after: &after,
            folder: self.dir(),
            log: Log::Tasks {
                file: &self.dir().join(format!("{}.log", self.scheduler.engine())),
                folder: &self.work(),
            },
        };
        match self.scheduler.submit(&request, self.say) {
            Ok(id) => {
                jobs.last_mut().into_iter().for_each(|job| job.id = Some(id.clone()));
                self.note(jobs)
            }
            // It may have been taken, and is found by its name then.
            Err(error) if error.is::<NoAnswer>() => Err(error),
            Err(error) => {
                jobs.pop();
                self.note(jobs)?;
                Err(error)
            }
        }
    }

    fn note(&self, jobs: &[Noted]) -> Result<()> {
        if jobs.is_empty() {
            return remove(&self.jobs_file());
        }
        let lines: String = jobs.iter().map(|job| format!("{job}\n")).collect();
        write_whole(&self.jobs_file(), lines.as_bytes())
    }

    /// What a task runs, in a login shell, since that is what knows `module`; with the programs that the submission
    /// had, behind those of the modules.
    fn task_script(&self) -> String {
        let path = env::var("PATH").unwrap_or_default();
        let mut script = format!("export PATH={}\n", quoted(&path));
        if !self.cluster.modules.is_empty() {
            script.push_str(&format!("module load {} || exit 2\n", self.cluster.modules.join(" ")));
        }
        let program = quoted(&self.batch.job.gl_run.display().to_string());
        script.push_str(&format!(
            "exec {program} task {} \"$1\"\n",
            quoted(&self.work().display().to_string())
        ));
        script
    }

    /// Wait until nothing is in the queue. No answer is no reason to go on.
    fn wait(&self) -> Result<()> {
        let noted = self.jobs()?;
        let mut pause = 2.0;
        let mut told = Vec::new();
        loop {
            match self.scheduler.queued(&noted) {
                Ok(jobs) if jobs.is_empty() => return Ok(()),
                Ok(jobs) => {
                    let lines = self.scheduler.held_up(&jobs);
                    if lines != told {
                        lines.iter().for_each(|line| (self.say)(line));
                        told = lines;
                    }
                }
                Err(error) if error.is::<NoAnswer>() => {
                    let line = format!("{error}; waiting until it does");
                    if told != [line.clone()] {
                        (self.say)(&line);
                        told = vec![line];
                    }
                }
                Err(error) => return Err(error),
            }
            std::thread::sleep(Duration::from_secs_f64(self.cluster.poll.unwrap_or(pause)));
            pause = (pause * 1.5).min(LONGEST_PAUSE);
        }
    }

    /// Runs that were killed with their task, or told to end, get a status with the scheduler's reason.
    fn settle(&self) -> Result<()> {
        let work = self.work();
        for entry in fs::read_dir(&work).with_context(|| work.display().to_string())? {
            let path = entry?.path();
            let Some(name) = path.file_name().and_then(|name| name.to_str()?.strip_suffix(".running")) else {
                continue;
            };
            let task = fs::read_to_string(&path).unwrap_or_default();
            let reason = self.scheduler.ending(task.trim());
            if !self.dir().join(format!("{name}.status")).exists() {
                put_status(self.dir(), name, &format!("137 {}", reason.as_deref().unwrap_or("KILLED")))?;
            } else if let Some(reason) =
                reason.filter(|reason| !matches!(reason.as_str(), "FAILED" | "COMPLETED"))
            {
                put_status(self.dir(), name, &format!("137 {reason}"))?;
            }
            remove(&path)?;
        }
        remove(&self.jobs_file())
    }

    /// The rows to submit again: those that failed, as often as `retries` allows; and those that no task came to. A
    /// row that the scheduler loses whatever we do is one that failed, too.
    fn next_round(&self) -> Result<Vec<usize>> {
        let missing = missing(&self.batch.table, self.dir())?;
        let is_tried = |row: usize| self.batch.file(row, ".status").exists();
        let (failed, mut lost): (Vec<usize>, Vec<usize>) =
            missing.into_iter().partition(|&row| is_tried(row));
        let submitted = Task::load(&self.work())?.rows.len();
        let idle = if lost.len() < submitted { 0 } else { number_in(&self.idle_file()) + 1 };
        write_whole(&self.idle_file(), format!("{idle}\n").as_bytes())?;
        if idle >= IDLE_ROUNDS {
            for row in lost.drain(..) {
                put_status(self.dir(), self.batch.table.name(row), "137 LOST")?;
            }
        }
        let times = self.note_failures(&failed)?;
        let mut rows: Vec<usize> =
            failed.into_iter().filter(|row| times[row] <= self.cluster.retries).chain(lost).collect();
        rows.sort_unstable();
        Ok(rows)
    }

    /// Note that these rows have failed once more; how often each has.
    fn note_failures(&self, failed: &[usize]) -> Result<HashMap<usize, usize>> {
        let path = self.work().join("failures");
        let cannot = || format!("{}: cannot be written", path.display());
        let mut file = OpenOptions::new().create(true).append(true).open(&path).with_context(cannot)?;
        let lines: String = failed.iter().map(|row| format!("{row}\n")).collect();
        file.write_all(lines.as_bytes()).with_context(cannot)?;
        let mut times = HashMap::new();
        for row in
            fs::read_to_string(&path).with_context(cannot)?.lines().filter_map(|line| line.parse().ok())
        {
            *times.entry(row).or_insert(0) += 1;
        }
        Ok(times)
    }
}

fn number_in(path: &Path) -> usize {
    fs::read_to_string(path).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0)
}

/// Forget the attempts at the runs below `stage`: when they are advanced again, each that has failed is tried anew.
///
/// # Errors
/// If a file cannot be removed.
pub fn forgive(stage: &Path) -> Result<()> {
    remove(&stage.join("runs/.run/idle"))
}

/// Run the rows of one task of an array, whose first task is `first`, in a process of that task.
///
/// # Errors
/// If what the engine left in `work` cannot be read, or a row cannot be run.
pub fn run_task(work: &Path, first: usize, termination: &Termination) -> Result<RowOutcome> {
    let task = Task::load(work)?;
    let mut job = Job::load(work)?;
    let table = RunFolder::table(work)?;
    let index =
        ["SLURM_ARRAY_TASK_ID", "PBS_ARRAY_INDEX", "PBS_ARRAYID"].iter().find_map(|name| env::var(name).ok());
    let index: usize = match &index {
        None => 0,
        Some(text) => text.parse().with_context(|| format!("{text:?} is no number of a task"))?,
    };
    let named = task.scratch.as_deref().or(job.scratch.as_deref());
    job.scratch = Some(scratch(named, work)?);
    started(work)?;
    // A task that the scheduler starts again after a node has failed goes on where it was.
    let rows = missing_of(&table, task.share(first + index), &job.dir)?;
    let name = task_name();
    let ended = |row: usize, status: &str| {
        if status == TERMINATED {
            // Whoever looks at how it went asks the scheduler why.
            let _ = fs::write(work.join(format!("{}.running", table.name(row))), format!("{name}\n"));
        }
    };
    run_rows(&job, &table, &rows, &name, RunLog::File, termination, ended)
}

/// What the scheduler calls this task, by which it tells how it has ended.
fn task_name() -> String {
    let named = |name: &str| env::var(name).ok().filter(|value| !value.is_empty());
    match (named("SLURM_ARRAY_JOB_ID"), named("SLURM_ARRAY_TASK_ID")) {
        (Some(array), Some(index)) => format!("{array}_{index}"),
        _ => {
            named("SLURM_JOB_ID").or_else(|| named("PBS_JOBID")).unwrap_or_else(|| process::id().to_string())
        }
    }
}

/// A node's own disk spares the shared file system; what a site calls it differs.
fn scratch(site: Option<&Path>, work: &Path) -> Result<PathBuf> {
    let named = ["SLURM_TMPDIR", "TMPDIR"].iter().filter_map(|name| env::var_os(name).map(PathBuf::from));
    let mut folders =
        site.map(Path::to_owned).into_iter().chain(named).chain([PathBuf::from("/tmp"), work.to_owned()]);
    match folders.find(|folder| tempfile::tempfile_in(folder).is_ok()) {
        Some(folder) => Ok(folder),
        None => bail!("no folder for scratch files: neither a disk of the node nor {}", work.display()),
    }
}

/// Note since when runs end, unless another task did.
fn started(work: &Path) -> Result<()> {
    match OpenOptions::new().write(true).create_new(true).open(work.join("started")) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
            Err(error).with_context(|| format!("{}: cannot be written", work.display()))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::call::Call;
    use crate::job::Limit;
    use crate::scheduler::Job as Queued;

    /// What a scheduler does with an array: nothing, run it, or refuse it.
    #[derive(Clone, Copy, PartialEq)]
    enum Does {
        Lose,
        Fail,
        Refuse,
        NoAnswer,
    }

    /// A scheduler of arrays of two tasks, which does one thing after another.
    struct Fake {
        work: PathBuf,
        does: RefCell<Vec<Does>>,
        names: RefCell<Vec<String>>,
    }

    impl Scheduler for Fake {
        fn engine(&self) -> &'static str {
            "slurm"
        }
        fn check(&self) -> Result<()> {
            Ok(())
        }
        fn largest_array(&self) -> Option<usize> {
            Some(2)
        }
        fn follows_arrays(&self) -> bool {
            true
        }
        fn array_name(&self, first: usize) -> String {
            format!("gl-{first}-{}", self.names.borrow().len())
        }
        fn control_name(&self, _: &Path) -> String {
            String::new()
        }
        fn own_job(&self) -> Option<String> {
            None
        }
        fn submit(&self, request: &Request, _: Say) -> Result<String> {
            let noted = noted_in(&self.work.join("jobs"))?;
            let last = noted.last().expect("a name is noted before anything is submitted");
            assert_eq!((last.name.as_str(), &last.id), (request.name, &None));
            self.names.borrow_mut().push(request.name.to_owned());
            let does = self.does.borrow_mut().pop().unwrap_or(Does::Lose);
            match does {
                Does::Refuse => bail!("sbatch refused: too many jobs"),
                Does::NoAnswer => bail!(NoAnswer("timed out".to_owned())),
                Does::Lose => {}
                Does::Fail => {
                    let task = Task::load(&self.work)?;
                    for row in task.rows {
                        put_status(self.work.parent().unwrap(), &format!("r{row}"), "3")?;
                    }
                }
            }
            Ok("17".to_owned())
        }
        fn queued(&self, _: &[Noted]) -> Result<Vec<Queued>> {
            Ok(Vec::new())
        }
        fn ending(&self, _: &str) -> Option<String> {
            None
        }
        fn cancel(&self, _: &[Queued], _: Say) {}
        fn held_up(&self, _: &[Queued]) -> Vec<String> {
            Vec::new()
        }
    }

    /// Four rows, one a task, in a new folder.
    fn with<T>(does: &[Does], retries: usize, act: impl Fn(Array, &Fake) -> T) -> T {
        let folder = tempfile::tempdir().unwrap();
        let samples = folder.path().join("samples.txt");
        fs::write(&samples, "description\ta\nr0\t0\nr1\t1\nr2\t2\nr3\t3\n").unwrap();
        let call = Call {
            samples,
            model: "true".to_owned(),
            dir: folder.path().join("runs"),
            case: folder.path().to_owned(),
            limit: Limit::default(),
            packed: false,
            scratch: None,
            times: None,
        };
        let batch = call.check().unwrap();
        let does = does.iter().rev().copied().collect();
        let fake = Fake { work: batch.folder.work(), does: RefCell::new(does), names: RefCell::default() };
        let cluster = Cluster { retries, poll: Some(0.01), ..Cluster::default() };
        act(Array { batch, cluster: &cluster, scheduler: &fake, say: &|_| () }, &fake)
    }

    fn report(outcome: Result<Outcome>) -> Report {
        match outcome.unwrap() {
            Outcome::Ended(report) => report,
            Outcome::Queued(jobs) => panic!("{jobs:?}"),
        }
    }

    #[test]
    fn rows_that_are_lost_three_times_in_a_row_have_failed() {
        with(&[], 0, |array, fake| {
            let report = report(array.run());
            assert_eq!(report.failed.len(), 4);
            assert!(report.failed.iter().all(|(_, status)| status == "137 LOST"));
            // Three rounds of two arrays.
            assert_eq!(fake.names.borrow().len(), 6);
        });
    }

    #[test]
    fn rows_that_fail_are_submitted_again_as_often_as_the_site_allows() {
        for retries in [0, 2] {
            with(&[Does::Fail; 6], retries, |array, fake| {
                assert_eq!(report(array.run()).failed.len(), 4);
                assert_eq!(fake.names.borrow().len(), 2 * (retries + 1));
            });
        }
    }

    #[test]
    fn where_the_site_takes_no_more_the_rest_is_submitted_later() {
        with(&[Does::Fail, Does::Refuse], 0, |array, fake| {
            assert_eq!(report(array.run()).failed.len(), 4);
            assert_eq!(fake.names.borrow().len(), 2);
        });
    }

    #[test]
    fn what_is_refused_at_once_is_an_error_and_leaves_nothing_in_the_queue() {
        with(&[Does::Refuse], 0, |array, fake| {
            assert_eq!(array.run().unwrap_err().to_string(), "sbatch refused: too many jobs");
            assert!(!fake.work.join("jobs").exists());
        });
    }

    #[test]
    fn what_may_have_been_taken_stays_noted() {
        with(&[Does::NoAnswer], 0, |array, fake| {
            assert!(array.advance().unwrap_err().is::<NoAnswer>());
            assert_eq!(noted_in(&fake.work.join("jobs")).unwrap().len(), 1);
        });
    }

    #[test]
    fn tasks_share_the_rows() {
        let task = Task { rows: vec![1, 3, 5, 7, 9], rows_per_task: 2, scratch: None };
        assert_eq!(
            [0, 1, 2, 3].map(|number| task.share(number).to_vec()),
            [vec![1, 3], vec![5, 7], vec![9], vec![]]
        );
    }
}
