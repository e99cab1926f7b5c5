//! How long runs took: a table beside the runs, which no result depends on.

use std::collections::HashMap;
use std::path::Path;

use anyhow::Result;
use gl_numeric::statistics::Quantiles;
use gl_table::{Table, number, write_rows};
use serde::{Deserialize, Serialize};

/// How long one attempt at a run took. A run that was tried again has a row for each attempt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunTime {
    /// Name of the sample.
    pub sample: String,
    /// From its start to its end, s.
    #[serde(serialize_with = "number")]
    pub seconds: f64,
    /// Of all processors that it was on, user and system, s.
    #[serde(serialize_with = "number")]
    pub processor_seconds: f64,
    /// Its exit code, as in its status.
    pub exit: i64,
}

/// The name of the table in a folder of runs.
pub const TIMES: &str = "times.txt";

impl RunTime {
    /// The rows of a table; none where there is no table.
    ///
    /// # Errors
    /// If it cannot be read or is no such table.
    pub fn read(path: &Path) -> Result<Vec<Self>> {
        if path.exists() { Table::read(path)?.rows() } else { Ok(Vec::new()) }
    }

    /// Add rows to a table, which appears whole. One that cannot be read is begun anew: times are worth no failure.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(path: &Path, rows: Vec<Self>) -> Result<()> {
        if rows.is_empty() {
            return Ok(());
        }
        let mut all = Self::read(path).unwrap_or_default();
        all.extend(rows);
        write_rows(Some(path), &all)
    }
}

/// What the runs of some tables took together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Took {
    /// Runs whose time is known.
    pub runs: usize,
    /// The median run, by the last attempt at each, s.
    pub median_seconds: f64,
    /// Processor time of all attempts, s.
    pub processor_seconds: f64,
}

impl Took {
    /// Of these tables, each of another folder of runs; `None` where they have no rows.
    ///
    /// # Errors
    /// See [`RunTime::read`].
    pub fn of<P: AsRef<Path>>(tables: impl IntoIterator<Item = P>) -> Result<Option<Self>> {
        let mut seconds = Vec::new();
        let mut processor_seconds = 0.0;
        for table in tables {
            let rows = RunTime::read(table.as_ref())?;
            processor_seconds += rows.iter().map(|row| row.processor_seconds).sum::<f64>();
            let last: HashMap<&str, f64> =
                rows.iter().map(|row| (row.sample.as_str(), row.seconds)).collect();
            seconds.extend(last.into_values());
        }
        let runs = seconds.len();
        let median_seconds = Quantiles::new(&seconds, &vec![1.0 / runs as f64; runs]).at(0.5);
        Ok((runs > 0).then_some(Self { runs, median_seconds, processor_seconds }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(sample: &str, seconds: f64, exit: i64) -> RunTime {
        RunTime { sample: sample.to_owned(), seconds, processor_seconds: 2.0 * seconds, exit }
    }

    #[test]
    fn a_run_that_was_tried_again_counts_once_and_its_processor_time_twice() {
        let dir = tempfile::tempdir().unwrap();
        let table = |name: &str| dir.path().join(name);
        assert_eq!(Took::of([table("none")]).unwrap(), None);
        RunTime::add(&table("a"), vec![row("x", 9.0, 124), row("y", 2.0, 0)]).unwrap();
        RunTime::add(&table("a"), vec![row("x", 1.0, 0)]).unwrap();
        // The same name in another folder is another run.
        RunTime::add(&table("b"), vec![row("x", 5.0, 0)]).unwrap();
        let took = Took::of([table("a"), table("b")]).unwrap().unwrap();
        assert_eq!(took, Took { runs: 3, median_seconds: 2.0, processor_seconds: 34.0 });
    }

    #[test]
    fn a_table_that_cannot_be_read_is_begun_anew() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(TIMES);
        std::fs::write(&path, "nonsense\n1\n").unwrap();
        assert!(Took::of([&path]).is_err());
        RunTime::add(&path, vec![row("x", 1.0, 0)]).unwrap();
        assert_eq!(RunTime::read(&path).unwrap(), [row("x", 1.0, 0)]);
    }
}
