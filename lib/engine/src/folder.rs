//! The folder of the runs: one engine at a time, and what lives in it as long as the runs do.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gl_table::remove;
use rustix::fs::{FlockOperation, flock};
use rustix::io::{Errno, FdFlags, fcntl_setfd};

use crate::Say;
use crate::batch_table::BatchTable;
use crate::times;

/// What Yade scripts import.
const GL_YADE: &str = include_str!("../../../scripts/gl_yade.py");

/// A folder of runs.
///
/// In its folder `.run` is what lives as long as the runs do:
///
/// | file | |
/// | --- | --- |
/// | `samples.txt` | the checked table |
/// | `job.json` | [`crate::job::Job`], how a row is run |
/// | `gl_yade.py` | what Yade scripts import |
/// | `NAME.running` | which process or task a run is in; left behind by one that was killed |
/// | `times.HOST` | how long runs took on a machine |
/// | `jobs`, `engine` | of an engine with a queue: what was submitted, and by which engine |
#[derive(Debug)]
pub struct RunFolder {
    dir: PathBuf,
    lock: Option<File>,
}

impl RunFolder {
    /// The folder at `dir`, which is made if need be.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn create(dir: &Path) -> Result<Self> {
        fs::create_dir_all(dir).with_context(|| format!("{}: cannot be made", dir.display()))?;
        let dir = fs::canonicalize(dir).with_context(|| dir.display().to_string())?;
        Ok(Self { dir, lock: None })
    }

    /// Its absolute path.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Its folder `.run`.
    pub fn work(&self) -> PathBuf {
        self.dir.join(".run")
    }

    /// Hold the folder until the last process that is started from now on has ended: a model that outlives
    /// a killed engine inherits the lock, so that nothing is run a second time beside it. Waits where
    /// another process holds it.
    ///
    /// # Errors
    /// If the folder cannot be opened.
    pub fn lock(&mut self, say: Say) -> Result<()> {
        let dir = self.dir.display();
        let file = File::open(&self.dir).with_context(|| format!("{dir}: cannot be opened"))?;
        let mut locked = flock(&file, FlockOperation::NonBlockingLockExclusive);
        if locked == Err(Errno::WOULDBLOCK) {
            say(&format!("{dir}: waiting for the runs that another process has started there"));
            locked = loop {
                match flock(&file, FlockOperation::LockExclusive) {
                    Err(Errno::INTR) => {}
                    other => break other,
                }
            };
        }
        match locked {
            Ok(()) => fcntl_setfd(&file, FdFlags::empty()).with_context(|| dir.to_string())?,
            Err(_) => {
                say(&format!("{dir}: this file system has no locks; start one engine at a time here"));
            }
        }
        self.lock = Some(file);
        Ok(())
    }

    /// Whether another process holds the folder, which it does as long as runs of its are alive.
    pub fn is_held(dir: &Path) -> bool {
        let Ok(file) = File::open(dir) else { return false };
        flock(&file, FlockOperation::NonBlockingLockShared) == Err(Errno::WOULDBLOCK)
    }

    /// Begin anew: what is left in `.run` belongs to runs that were killed. Call it after
    /// [`RunFolder::lock`].
    ///
    /// # Errors
    /// If another engine has runs in a queue, or `.run` cannot be written.
    pub fn begin(&self, table: &BatchTable) -> Result<()> {
        let work = self.work();
        if work.join("jobs").exists() {
            let engine = fs::read_to_string(work.join("engine")).unwrap_or_default();
            bail!(
                "{}: {} has runs in the queue; call it again to wait for them",
                self.dir.display(),
                engine.trim()
            );
        }
        self.end()?;
        fs::create_dir(&work).with_context(|| format!("{}: cannot be made", work.display()))?;
        gl_table::write_whole(&work.join("samples.txt"), table.text().as_bytes())?;
        gl_table::write_whole(&work.join("gl_yade.py"), GL_YADE.as_bytes())
    }

    /// The table that [`RunFolder::begin`] has left in a folder `.run`.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn table(work: &Path) -> Result<BatchTable> {
        BatchTable::read(&work.join("samples.txt"))
    }

    /// Remove how these rows ended in an earlier call: from then on a row with a status is one that was tried.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn forget(&self, table: &BatchTable, rows: &[usize]) -> Result<()> {
        rows.iter().try_for_each(|&row| remove(&self.dir.join(format!("{}.status", table.name(row)))))
    }

    /// Remove `.run`, and keep how long the runs took.
    ///
    /// # Errors
    /// If it cannot be removed, or the table of times not be written.
    pub fn end(&self) -> Result<()> {
        let work = self.work();
        times::keep(&work)?;
        match fs::remove_dir_all(&work) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(error).with_context(|| format!("{}: cannot be removed", work.display()))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> BatchTable {
        BatchTable::parse("samples.txt", b"description a\nr0 1\n".to_vec()).unwrap()
    }

    #[test]
    fn a_folder_is_held_by_one_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/runs");
        let mut folder = RunFolder::create(&path).unwrap();
        assert!(!RunFolder::is_held(&path));
        folder.lock(&|message| panic!("{message}")).unwrap();
        assert!(RunFolder::is_held(&path));
        drop(folder);
        // A program that another test of this process started meanwhile has inherited the lock until it ends.
        let is_free = |_| {
            std::thread::sleep(std::time::Duration::from_millis(10));
            !RunFolder::is_held(&path)
        };
        assert!((0..3000).any(is_free));
    }

    #[test]
    fn what_a_killed_call_left_is_gone_when_the_next_begins() {
        let dir = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(dir.path()).unwrap();
        fs::create_dir(folder.work()).unwrap();
        fs::write(folder.work().join("r0.running"), "1").unwrap();
        folder.begin(&table()).unwrap();
        assert!(!folder.work().join("r0.running").exists());
        assert_eq!(RunFolder::table(&folder.work()).unwrap().text(), table().text());
        folder.end().unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn runs_in_a_queue_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(dir.path()).unwrap();
        folder.begin(&table()).unwrap();
        fs::write(folder.work().join("jobs"), "gl-1 7\n").unwrap();
        fs::write(folder.work().join("engine"), "gl-run slurm\n").unwrap();
        let error = folder.begin(&table()).unwrap_err().to_string();
        assert!(error.contains("gl-run slurm has runs in the queue"), "{error}");
    }

    #[test]
    fn a_row_that_is_to_run_again_has_no_status() {
        let dir = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(dir.path()).unwrap();
        fs::write(dir.path().join("r0.status"), "3\n").unwrap();
        folder.forget(&table(), &[0]).unwrap();
        folder.forget(&table(), &[0]).unwrap();
        assert!(!dir.path().join("r0.status").exists());
    }
}
