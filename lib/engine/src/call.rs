//! The call that all engines share: SAMPLES MODEL DIR, checked before anything runs.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::batch_table::BatchTable;
use crate::folder::RunFolder;
use crate::job::{Job, Limit};
use crate::model::Model;

/// What a user asks for.
#[derive(Clone, Debug)]
pub struct Call {
    /// The samples table, `-` for standard input.
    pub samples: PathBuf,
    /// A Yade script or a command.
    pub model: String,
    /// Where the runs' files go.
    pub dir: PathBuf,
    /// The folder of the case.
    pub case: PathBuf,
    /// Time limit of a run.
    pub limit: Limit,
    /// Whether runs are packed.
    pub packed: bool,
    /// Where the runs have their scratch folders, which must be there; in `dir` if absent.
    pub scratch: Option<PathBuf>,
    /// The table that gets how long each run took ([`gl_inference::times`]).
    pub times: Option<PathBuf>,
}

/// A call that can be run: everything is checked, and the folder of the runs is there.
#[derive(Debug)]
pub struct Batch {
    /// The rows.
    pub table: BatchTable,
    /// How a row is run. An engine may still change `scratch`, `threads`, `limit` and `packed`.
    pub job: Job,
    /// Where the runs' files go; not locked yet.
    pub folder: RunFolder,
}

impl Call {
    /// Read and check everything, and then make the folder of the runs. Nothing is written before.
    ///
    /// # Errors
    /// If the table or a cell in it is no good, the model cannot run, or the folder cannot be made.
    pub fn check(&self) -> Result<Batch> {
        let case = folder_at(&self.case).context("CASE")?;
        let table = BatchTable::read(&self.samples)?;
        let model = Model::check(&self.model, &table, &case)?;
        let scratch = self.scratch.as_deref().map(folder_at).transpose()?;
        let gl_run = env::current_exe().context("where this program is cannot be found out")?;
        let dir = std::path::absolute(&self.dir).with_context(|| self.dir.display().to_string())?;
        ensure!(
            !matches!(model, Model::Yade(_)) || env::join_paths([&dir]).is_ok(),
            "{}: the path has a colon, with which Python finds no gl_yade there; use another name",
            dir.display()
        );
        let times = self.times.as_deref().map(std::path::absolute).transpose().context("--times")?;
        let folder = RunFolder::create(&dir)?;
        let job = Job {
            model,
            case,
            dir: folder.dir().to_owned(),
            scratch,
            limit: self.limit.0,
            packed: self.packed,
            threads: 1,
            gl_run,
            times,
        };
        Ok(Batch { table, job, folder })
    }
}

/// The absolute path of a folder that is there.
fn folder_at(path: &Path) -> Result<PathBuf> {
    ensure!(path.is_dir(), "{}: no such folder", path.display());
    fs::canonicalize(path).with_context(|| path.display().to_string())
}

impl Batch {
    /// The path of a file of a row's run, such as `NAME.log` for `.log`.
    pub fn file(&self, row: usize, ending: &str) -> PathBuf {
        file(self.folder.dir(), self.table.name(row), ending)
    }
}

pub(crate) fn file(dir: &Path, name: &str, ending: &str) -> PathBuf {
    dir.join(format!("{name}{ending}"))
}
