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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_run_is_missing_until_it_is_whole_packed_or_loose() {
        let table = BatchTable::parse("s", b"description key x\na 0 0.3333333333\nb 1 2\n".to_vec()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
        let is_missing = || missing(&table, dir.path()).unwrap().contains(&0);
        assert_eq!(missing(&table, dir.path()).unwrap(), [0, 1]);
        for (parameters, simulation, expected) in [
            ("x\n0.3333333333\n", "u f\n0 1\n", false),
            ("# key, x\r\n9, 3.33333e-1\r\n", "# u,f\r\n0,1\r\n", false),
            ("x\n0.33334\n", "u f\n0 1\n", true),
            ("x\n0.33333\n", "u f\n0 1", true),
            ("x\n0.33333\n", "u f\n", true),
            ("x\n0.33333\n", "u f\n# 0 1\n", true),
            ("x\n0.33333\n", "", true),
            ("x\n", "u f\n0 1\n", true),
            ("y\n0.33333\n", "u f\n0 1\n", true),
            ("", "u f\n0 1\n", true),
        ] {
            write("a_param.txt", parameters);
            write("a_sim.txt", simulation);
            assert_eq!(is_missing(), expected, "{parameters:?} {simulation:?}");
            fs::remove_file(dir.path().join("a_sim.txt")).unwrap();
            assert!(is_missing());
            let mut packed = Vec::new();
            pack::push(&mut packed, "a_param.txt", parameters.as_bytes());
            pack::push(&mut packed, "a_sim.txt", simulation.as_bytes());
            fs::write(dir.path().join("a_packed.txt"), &packed).unwrap();
            assert_eq!(is_missing(), expected, "packed {parameters:?} {simulation:?}");
            assert_eq!(missing_of(&table, &[0, 1], dir.path()).unwrap().contains(&0), expected);
            // One byte less, and it may be half a run.
            fs::write(dir.path().join("a_packed.txt"), &packed[..packed.len() - 1]).unwrap();
            assert!(is_missing());
            fs::remove_file(dir.path().join("a_packed.txt")).unwrap();
        }
    }

    #[test]
    fn a_run_goes_on_only_as_long_as_its_engine_lives() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join(".run")).unwrap();
        fs::write(dir.path().join(".run/a.running"), "1\n").unwrap();
        assert!(is_running(dir.path(), "a", true) && !is_running(dir.path(), "b", true));
        assert!(!is_running(dir.path(), "a", false));
        fs::write(dir.path().join(".run/jobs"), "gl-1 1\n").unwrap();
        assert!(is_running(dir.path(), "a", false));
    }
}
