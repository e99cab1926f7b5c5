//! From a scratch folder to the files that others read: whole or not at all, the simulation last.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tempfile::TempDir;

use crate::call::file;
use crate::pack;

/// Move the files of a run, those that begin with its name, from its scratch folder to `dir`, with its
/// `status` as the last but one and the simulation as the last: where that is, nothing is missing.
///
/// Across file systems they go first to `dir/.run`, and from there by renaming, so that nobody reads half a
/// file.
///
/// # Errors
/// If a file cannot be moved; the simulation is then not there.
pub fn publish(scratch: &Path, dir: &Path, name: &str, status: &str) -> Result<()> {
    let simulation = OsString::from(format!("{name}_sim.txt"));
    let (last, first): (Vec<_>, Vec<_>) =
        files_of(scratch, name)?.into_iter().partition(|file| *file == simulation);
    let stage = Stage::new(dir)?;
    stage.bring(scratch, &first)?;
    stage.bring(scratch, &last)?;
    stage.put(dir, &first)?;
    put_status(dir, name, status)?;
    stage.put(dir, &last)
}

/// A folder on the file system of the runs, from where files appear by renaming.
struct Stage(TempDir);

impl Stage {
    fn new(dir: &Path) -> Result<Self> {
        let work = dir.join(".run");
        let stage = tempfile::Builder::new().prefix("done.").tempdir_in(&work);
        Ok(Self(stage.with_context(|| format!("{}: cannot be written", work.display()))?))
    }

    fn bring(&self, scratch: &Path, files: &[OsString]) -> Result<()> {
        files.iter().try_for_each(|file| bring(&scratch.join(file), &self.0.path().join(file)))
    }

    fn put(&self, dir: &Path, files: &[OsString]) -> Result<()> {
        files.iter().try_for_each(|file| put(&self.0.path().join(file), &dir.join(file)))
    }
}

/// Note how a run ended, in one step.
///
/// # Errors
/// If it cannot be written.
pub fn put_status(dir: &Path, name: &str, status: &str) -> Result<()> {
    let part = dir.join(".run").join(format!("{name}.status"));
    fs::write(&part, format!("{status}\n"))
        .with_context(|| format!("{}: cannot be written", part.display()))?;
    put(&part, &file(dir, name, ".status"))
}

/// A packed file that grows by a run at a time. It begins with the first; no later call adds to it, since it
/// may end in the middle of a run.
#[derive(Debug)]
pub struct Packer {
    dir: PathBuf,
    file: Option<(PathBuf, File)>,
}

impl Packer {
    /// One that has no file yet.
    pub fn new(dir: &Path) -> Self {
        Self { dir: dir.to_owned(), file: None }
    }

    /// Add the tables of a run, and move its other files to the folder.
    ///
    /// # Errors
    /// If something cannot be written; what was added of the run is taken back, if that is possible.
    pub fn add(&mut self, scratch: &Path, name: &str) -> Result<()> {
        let mut bytes = Vec::new();
        let tables = [format!("{name}_param.txt"), format!("{name}_sim.txt")];
        for table in &tables {
            let path = scratch.join(table);
            let text = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
            pack::push(&mut bytes, table, &text);
        }
        let mut others = files_of(scratch, name)?;
        others.retain(|file| tables.iter().all(|table| file != table.as_str()));
        if !others.is_empty() {
            let stage = Stage::new(&self.dir)?;
            stage.bring(scratch, &others)?;
            stage.put(&self.dir, &others)?;
        }
        let (path, file) = match &mut self.file {
            Some(file) => file,
            none => none.insert(pack::create(&self.dir, name)?),
        };
        let before = file.metadata().map(|metadata| metadata.len());
        let written = file.write_all(&bytes).and_then(|()| file.sync_data());
        if written.is_err()
            && let Ok(length) = before
        {
            let _ = file.set_len(length);
        }
        written.with_context(|| format!("{}: cannot be written", path.display()))
    }
}

/// The files in a scratch folder that are a run's; of its log and status there are others.
fn files_of(scratch: &Path, name: &str) -> Result<Vec<OsString>> {
    let cannot = || format!("{}: cannot be read", scratch.display());
    let mut files = Vec::new();
    for entry in fs::read_dir(scratch).with_context(cannot)? {
        let entry = entry.with_context(cannot)?;
        let file = entry.file_name();
        let bytes = file.as_bytes();
        let is_own =
            bytes.starts_with(name.as_bytes()) && !bytes.ends_with(b".log") && !bytes.ends_with(b".status");
        if is_own && entry.path().is_file() {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}

/// Move a file, and see to it that it is on disk. Of a link what it points at is copied, which may be gone
/// with the scratch folder.
fn bring(from: &Path, to: &Path) -> Result<()> {
    let copy = || fs::copy(from, to).map(|_| ());
    let is_link = fs::symlink_metadata(from).is_ok_and(|found| found.file_type().is_symlink());
    let moved = if is_link { copy() } else { fs::rename(from, to) };
    moved
        .or_else(|error| if error.kind() == ErrorKind::CrossesDevices { copy() } else { Err(error) })
        .and_then(|()| File::open(to)?.sync_all())
        .with_context(|| format!("{}: cannot be written", to.display()))
}

fn put(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).with_context(|| format!("{}: cannot be written", to.display()))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// A folder of runs with its `.run`, and a scratch folder elsewhere.
    fn folders() -> (TempDir, TempDir) {
        let (dir, scratch) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::create_dir(dir.path().join(".run")).unwrap();
        (dir, scratch)
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_a_run_left_is_published_and_its_links_are_followed() {
        let (dir, scratch) = folders();
        for name in ["r_sim.txt", "r_param.txt", "r.log", "r.status", "other", "grains"] {
            fs::write(scratch.path().join(name), name).unwrap();
        }
        fs::create_dir(scratch.path().join("r_folder")).unwrap();
        symlink(scratch.path().join("grains"), scratch.path().join("r_grains")).unwrap();
        symlink("/nowhere", scratch.path().join("r_lost")).unwrap();
        publish(scratch.path(), dir.path(), "r", "0").unwrap();
        drop(scratch);
        assert_eq!(names(dir.path()), [".run", "r.status", "r_grains", "r_param.txt", "r_sim.txt"]);
        assert_eq!(fs::read_to_string(dir.path().join("r.status")).unwrap(), "0\n");
        assert_eq!(fs::read_to_string(dir.path().join("r_grains")).unwrap(), "grains");
        assert_eq!(names(&dir.path().join(".run")), [""; 0]);
    }

    #[test]
    fn a_run_that_cannot_be_published_has_no_simulation() {
        let (dir, scratch) = folders();
        fs::write(scratch.path().join("r_sim.txt"), "u\n1\n").unwrap();
        fs::write(scratch.path().join("r_param.txt"), "a\n1\n").unwrap();
        // A folder stands in the way.
        fs::create_dir(dir.path().join("r_param.txt")).unwrap();
        assert!(publish(scratch.path(), dir.path(), "r", "0").is_err());
        assert!(!dir.path().join("r_sim.txt").exists());
    }

    #[test]
    fn packed_runs_stand_one_behind_the_other() {
        let (dir, scratch) = folders();
        let mut packer = Packer::new(dir.path());
        for name in ["a", "b"] {
            fs::write(scratch.path().join(format!("{name}_param.txt")), "x\n1\n").unwrap();
            fs::write(scratch.path().join(format!("{name}_sim.txt")), "u\n1\n").unwrap();
            packer.add(scratch.path(), name).unwrap();
        }
        assert!(packer.add(scratch.path(), "c").is_err());
        assert_eq!(names(dir.path()), [".run", "a_packed.txt"]);
        let run =
            |name: &str| format!("# file {name}_param.txt 4\nx\n1\n\n# file {name}_sim.txt 4\nu\n1\n\n");
        assert_eq!(fs::read_to_string(dir.path().join("a_packed.txt")).unwrap(), run("a") + &run("b"));
    }
}
