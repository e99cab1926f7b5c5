//! Which rows of a table are still to run.
//!
//! When a run is complete is decided in [`gl_inference::collect`], so that no run that an engine takes for
//! complete is left out by `gl-collect` as missing, cut off or of other parameters, and none that it would
//! leave out so is kept.

use std::path::Path;

use anyhow::Result;
use gl_inference::collect::{Failure, completeness, completeness_in};

use crate::batch_table::BatchTable;
use crate::pack;

/// What became of the run of each row in `dir`.
///
/// # Errors
/// If the folder cannot be read.
pub fn status(table: &BatchTable, dir: &Path) -> Result<Vec<Result<(), Failure>>> {
    completeness(table.samples(), dir)
}

/// Whether the run of this name goes on now: an engine has begun it and is alive. `is_held` is what
/// [`RunFolder::is_held`](crate::folder::RunFolder::is_held) says; a queue's engine is taken to be alive
/// as long as it has jobs there.
pub fn is_running(dir: &Path, name: &str, is_held: bool) -> bool {
    let work = dir.join(".run");
    (is_held || work.join("jobs").exists()) && work.join(format!("{name}.running")).exists()
}

/// The rows whose run is not complete in `dir`, in order.
///
/// # Errors
/// If the folder cannot be read.
pub fn missing(table: &BatchTable, dir: &Path) -> Result<Vec<usize>> {
    let status = status(table, dir)?;
    Ok((0..table.len()).filter(|&row| status[row].is_err()).collect())
}

/// Those of some rows whose run is not complete in `dir`. Of the packed files only those that begin with one
/// of these rows are looked into, as is enough for a task, which packs its own rows: so a thousand tasks
/// do not all read the files of all others.
///
/// # Errors
/// If a packed file cannot be read.
pub fn missing_of(table: &BatchTable, rows: &[usize], dir: &Path) -> Result<Vec<usize>> {
    let packed = rows.iter().flat_map(|&row| pack::files_of(dir, table.name(row))).collect();
    let status = completeness_in(table.select(rows).samples(), dir, packed)?;
    Ok(rows.iter().zip(status).filter(|(_, status)| status.is_err()).map(|(&row, _)| row).collect())
}
