//! A calibration or diagnosis that lives in a queue: its controlling job, its arrays, what was asked for.
//!
//! Once it was submitted, its folder holds `control.toml` ([`Record`]), `control.sh` (what a controlling job runs),
//! `control.log` (the words of the last one) and `control.id` (its id).

use std::collections::HashSet;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use gl_case::Engine;
use gl_case::shell::quoted;
use gl_inference::stack::is_test_name;
use serde::{Deserialize, Serialize};

use crate::Say;
use crate::cluster;
use crate::lock::OutLock;
use crate::scheduler::{Job, Log, NoAnswer, Noted, Request, Scheduler};

/// How deep below the folder its iterations and rounds may be: `after-EFFECT/iterN`.
const DEPTH: usize = 3;
/// Submissions of a controlling job behind the same runs.
const ATTEMPTS: usize = 3;

/// What was asked for when it was submitted, kept as `control.toml`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Record {
    /// The scheduler in whose queue it is.
    pub engine: Engine,
    /// Whether the whole diagnosis is wanted.
    #[serde(default)]
    pub diagnose: bool,
    /// The case, from `folder`.
    pub case: PathBuf,
    /// The folder that it was submitted from.
    pub folder: PathBuf,
    /// Settings of the case, each `KEY=VALUE`.
    #[serde(default)]
    pub given: Vec<String>,
    /// Iterations at the most.
    pub iterations: Option<usize>,
    /// So many iterations in all, whatever the criteria say.
    pub until: Option<usize>,
}

impl Record {
    const FILE: &str = "control.toml";

    /// The one in a folder, if it has one.
    ///
    /// # Errors
    /// If the file cannot be read, or holds something else.
    pub fn read(out: &Path) -> Result<Option<Self>> {
        let path = out.join(Self::FILE);
        match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error).with_context(|| format!("{}: cannot be read", path.display())),
            Ok(text) => {
                let record = toml::from_str(&text);
                record.map(Some).with_context(|| format!("{}: no record of a submission", path.display()))
            }
        }
    }

    /// What an earlier call asked for is still wanted, unless this one says otherwise.
    pub fn recall(&mut self, earlier: &Self) {
        let key = |setting: &str| setting.split('=').next().unwrap_or_default().to_lowercase();
        let given: HashSet<String> = self.given.iter().map(|setting| key(setting)).collect();
        let mut kept: Vec<String> =
            earlier.given.iter().filter(|setting| !given.contains(&key(setting))).cloned().collect();
        kept.append(&mut self.given);
        self.given = kept;
        if self.iterations.is_none() && self.until.is_none() {
            (self.iterations, self.until) = (earlier.iterations, earlier.until);
        }
    }

    /// The tool that goes on from the files in the folder.
    pub fn driver(&self) -> &'static str {
        if self.diagnose { "gl-diagnose" } else { "gl-calibrate" }
    }

    /// Its arguments, as far as `gl-submit` takes them too.
    fn arguments(&self, out: &Path) -> Vec<OsString> {
        let mut words: Vec<OsString> =
            vec![self.case.clone().into(), "--engine".into(), self.engine.name().into()];
        words.extend(["--out".into(), out.into()]);
        words.extend(self.given.iter().map(OsString::from));
        words
    }

    /// Leave it in a folder, with the script of its controlling jobs, which calls `gl_submit --control`, wherever
    /// and whenever it starts.
    ///
    /// # Errors
    /// If the files cannot be written.
    pub fn write(&self, out: &Path, gl_submit: &Path) -> Result<()> {
        gl_table::write_whole(&out.join(Self::FILE), toml::to_string(self)?.as_bytes())?;
        let mut script = "#!/bin/bash\n".to_owned();
        for name in ["PATH", "RUN_TIMEOUT", "PACKED"] {
            if let Some(value) = env::var_os(name) {
                script.push_str(&format!("export {name}={}\n", quoted(&value.to_string_lossy())));
            }
        }
        let mut call = vec![gl_submit.as_os_str().to_owned(), "--control".into()];
        call.extend(self.diagnose.then(|| "--diagnose".into()));
        call.extend(self.arguments(out));
        let call: Vec<String> = call.iter().map(|word| quoted(&word.to_string_lossy())).collect();
        // A folder that is missing on a node does not fail a job by itself.
        let folder = quoted(&self.folder.display().to_string());
        script.push_str(&format!("cd {folder} && exec {}\n", call.join(" ")));
        gl_table::write_whole(&script_of(out), script.as_bytes())
    }

    /// Call the driver: as far as it goes without waiting.
    ///
    /// * `lock` — the lock on `out`, which the driver shares.
    ///
    /// # Returns
    /// Whether it has finished; if not, runs are in the queue.
    ///
    /// # Errors
    /// If it failed.
    pub fn advance(&self, out: &Path, driver: &Path, lock: &OutLock) -> Result<bool> {
        let mut command = Command::new(driver);
        command.args(self.arguments(out)).arg("--no-wait").stdin(Stdio::null());
        if let Some(iterations) = self.iterations {
            command.args(["--iterations", &iterations.to_string()]);
        }
        if let Some(until) = self.until {
            command.args(["--until", &until.to_string()]);
        }
        let status = lock.share(&mut command, out).status();
        let status = status.with_context(|| format!("{}: cannot be started", driver.display()))?;
        match status.code() {
            Some(0) => Ok(true),
            Some(1) => Ok(false),
            _ => bail!("{}: {} failed ({status})", out.display(), self.driver()),
        }
    }
}

fn script_of(out: &Path) -> PathBuf {
    out.join("control.sh")
}

/// Folders of the iterations and rounds in `out`, those with runs below them, in the order in which they were begun.
///
/// # Errors
/// If a folder cannot be read.
pub fn stages(out: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    search(out, DEPTH, &mut found)?;
    found.sort();
    Ok(found.into_iter().map(|(_, folder)| folder).collect())
}

fn search(folder: &Path, depth: usize, found: &mut Vec<(std::time::SystemTime, PathBuf)>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry?;
        // What the runs leave, which may be very much, is none of this.
        if !entry.file_type()?.is_dir() || entry.file_name() == "runs" {
            continue;
        }
        let path = entry.path();
        if let Ok(samples) = fs::metadata(path.join("samples.txt"))
            && samples.len() > 0
            && is_numbered(&path)
        {
            found.push((samples.modified()?, path));
        } else if depth > 1 {
            search(&path, depth - 1, found)?;
        }
    }
    Ok(())
}

/// Whether a folder is called `iterN` or `roundN`.
fn is_numbered(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_prefix("iter").or_else(|| name.strip_prefix("round"));
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The folders of an iteration or round with samples and their runs: itself, or one a test, sorted by name.
///
/// # Errors
/// If a folder cannot be read.
pub fn batches(stage: &Path) -> Result<Vec<PathBuf>> {
    let mut tests = Vec::new();
    for entry in fs::read_dir(stage).with_context(|| stage.display().to_string())? {
        let entry = entry?;
        let is_test = is_test_name(&entry.file_name().to_string_lossy());
        if is_test && entry.path().join("samples.txt").is_file() {
            tests.push(entry.path());
        }
    }
    tests.sort();
    Ok(if tests.is_empty() { vec![stage.to_owned()] } else { tests })
}

/// [`batches`] of all [`stages`].
fn all_batches(out: &Path) -> Result<Vec<PathBuf>> {
    let batches = stages(out)?.iter().map(|stage| batches(stage)).collect::<Result<Vec<_>>>()?;
    Ok(batches.concat())
}

/// Whether runs were ever started in `out`.
///
/// # Errors
/// If a folder cannot be read.
pub fn is_begun(out: &Path) -> Result<bool> {
    Ok(all_batches(out)?.iter().any(|batch| batch.join("runs").is_dir()))
}

/// Forget the attempts at runs in `out`, so that those that failed are tried anew.
///
/// # Errors
/// If a file cannot be removed.
pub fn forgive(out: &Path) -> Result<()> {
    all_batches(out)?.iter().try_for_each(|batch| cluster::forgive(batch))
}

/// What the runs in `out` have in the queue, or had last, as noted.
///
/// # Errors
/// If a folder or file cannot be read.
pub fn noted(out: &Path) -> Result<Vec<Noted>> {
    let mut all = Vec::new();
    for batch in all_batches(out)? {
        all.extend(noted_in(&batch.join("runs/.run/jobs"))?);
    }
    Ok(all)
}

/// The lines `NAME ID` of a file that need not be there.
pub(crate) fn noted_in(path: &Path) -> Result<Vec<Noted>> {
    match fs::read_to_string(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        text => {
            let text = text.with_context(|| format!("{}: cannot be read", path.display()))?;
            Ok(text.lines().filter_map(Noted::parse).collect())
        }
    }
}

/// What a folder has in the queue of a scheduler.
pub struct Control<'a> {
    /// As it was given, for messages.
    shown: String,
    out: PathBuf,
    scheduler: &'a dyn Scheduler,
}

impl<'a> Control<'a> {
    /// Of what is in `out`.
    ///
    /// # Errors
    /// If there is no such folder.
    pub fn of(out: &Path, scheduler: &'a dyn Scheduler) -> Result<Self> {
        let shown = out.display().to_string();
        let out = fs::canonicalize(out).with_context(|| format!("{shown}: cannot be found"))?;
        Ok(Self { shown, out, scheduler })
    }

    /// The controlling job, if there is one in the queue beside the one that asks.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn job(&self) -> Result<Option<Job>> {
        let id = fs::read_to_string(self.id_file()).ok();
        let id = id.map(|text| text.trim().to_owned()).filter(|id| !id.is_empty());
        let noted = [Noted { name: self.scheduler.control_name(&self.out), id }];
        let own = self.scheduler.own_job();
        let jobs = self.scheduler.queued(&noted)?;
        Ok(jobs.into_iter().find(|job| own.as_ref() != Some(&job.id) && !job.is_ending()))
    }

    /// The arrays of its runs that are in the queue.
    ///
    /// # Errors
    /// [`NoAnswer`], or if a folder cannot be read.
    pub fn arrays(&self) -> Result<Vec<Job>> {
        self.scheduler.queued(&noted(&self.out)?)
    }

    /// Leave a controlling job behind the arrays that are in the queue, unless there is one.
    ///
    /// # Errors
    /// If it was refused three times behind the same arrays, or [`NoAnswer`].
    pub fn leave_job(&self, say: Say) -> Result<()> {
        if self.job()?.is_some() {
            return Ok(());
        }
        let log = self.out.join("control.log");
        let mut refused: Option<Vec<String>> = None;
        let mut attempts = 0;
        loop {
            // Jobs may end between the question and the submission, and PBS then knows them no more: as long as
            // there are fewer each time, it is tried again.
            let after = ids(&self.arrays()?);
            let request = Request {
                name: &self.scheduler.control_name(&self.out),
                script: &script_of(&self.out),
                tasks: None,
                after: &after,
                folder: &self.out,
                log: Log::File(&log),
            };
            let out = &self.shown;
            match self.scheduler.submit(&request, say) {
                Ok(id) => {
                    gl_table::write_whole(&self.id_file(), format!("{id}\n").as_bytes())?;
                    let when = if after.is_empty() { "" } else { " when the runs have ended" };
                    say(&format!("{out}: job {id} goes on{when}"));
                    return Ok(());
                }
                Err(error) if error.is::<NoAnswer>() => return Err(error),
                Err(error) => {
                    say(&format!("{error:#}"));
                    attempts = if refused.as_ref() == Some(&after) { attempts + 1 } else { 1 };
                    if attempts >= ATTEMPTS {
                        bail!("{out}: the controlling job was refused: see above");
                    }
                    refused = Some(after);
                }
            }
        }
    }

    /// Take all of it out of the queue, the controlling job first, since it submits; what is there is asked anew
    /// until nothing is.
    ///
    /// # Returns
    /// How many jobs and arrays there were.
    ///
    /// # Errors
    /// [`NoAnswer`], or if jobs stay in the queue.
    pub fn cancel(&self, say: Say, pause: &dyn Fn()) -> Result<usize> {
        let mut cancelled = HashSet::new();
        let mut jobs = Vec::new();
        for _ in 0..60 {
            jobs = self.job()?.into_iter().collect();
            jobs.extend(self.arrays()?);
            if jobs.is_empty() {
                return Ok(cancelled.len());
            }
            cancelled.extend(ids(&jobs));
            self.scheduler.cancel(&jobs, say);
            pause();
        }
        bail!("{}: still in the queue: {}", self.shown, ids(&jobs).join(" "))
    }

    fn id_file(&self) -> PathBuf {
        self.out.join("control.id")
    }
}

/// Ids of jobs, an array once.
fn ids(jobs: &[Job]) -> Vec<String> {
    let mut seen = HashSet::new();
    jobs.iter().map(|job| &job.id).filter(|id| seen.insert(id.as_str())).cloned().collect()
}
