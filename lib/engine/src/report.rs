//! How a call went.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::batch_table::BatchTable;
use crate::call::file;
use crate::complete::missing;

/// Failed runs that are named.
const NAMED: usize = 5;

/// Lines of a log that are shown.
const LINES: usize = 8;

/// Bytes at the end of a log that those lines are looked for in.
const TAIL: u64 = 4000;

/// How a call went.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Rows of the table.
    pub rows: usize,
    /// Runs that were complete before.
    pub before: usize,
    /// Runs that were made, and are complete.
    pub run: usize,
    /// Runs that failed: name and status, an exit code and perhaps a word.
    pub failed: Vec<(String, String)>,
    /// Names of the rows that were not tried.
    pub untried: Vec<String>,
    /// Where not one run is complete: a log that is not empty, of the first run that has one.
    pub log: Option<Log>,
}

/// The log of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Log {
    /// Where it is.
    pub path: PathBuf,
    /// Its last lines.
    pub end: Vec<String>,
}

/// Look at how it went.
///
/// * `tried` — the rows that were missing before, in order, whose old statuses were removed then
///   ([`crate::folder::RunFolder::forget`]).
///
/// # Errors
/// If the folder cannot be read.
pub fn report(table: &BatchTable, dir: &Path, tried: &[usize]) -> Result<Report> {
    let own = table.select(tried);
    let mut report = Report { rows: table.len(), before: table.len() - tried.len(), ..Report::default() };
    let left = if tried.is_empty() { Vec::new() } else { missing(&own, dir)? };
    for &row in &left {
        let name = own.name(row).to_owned();
        match fs::read_to_string(file(dir, &name, ".status")) {
            Ok(status) => report.failed.push((name, status.trim().to_owned())),
            Err(_) => report.untried.push(name),
        }
    }
    report.run = tried.len() - left.len();
    if report.before + report.run == 0 {
        report.log = report.failed.iter().find_map(|(name, _)| Log::read(&file(dir, name, ".log")));
    }
    Ok(report)
}

impl Report {
    /// Whether every row was tried, whatever came of it.
    pub fn all_were_tried(&self) -> bool {
        self.untried.is_empty()
    }

    /// Lines that tell a user of it.
    pub fn messages(&self) -> Vec<String> {
        let mut line = format!(
            "{} rows: {} complete before, {} run, {} failed",
            self.rows,
            self.before,
            self.run,
            self.failed.len()
        );
        for (i, (name, status)) in self.failed.iter().take(NAMED).enumerate() {
            line.push_str(if i == 0 { ": " } else { " " });
            line.push_str(&format!("{name} ({status})"));
        }
        if self.failed.len() > NAMED {
            line.push_str(" …");
        }
        let mut lines = vec![line];
        if let Some(log) = &self.log {
            lines.push(format!("no run is complete; {} ends with:", log.path.display()));
            lines.extend(log.end.iter().map(|line| format!("    {line}")));
        }
        if !self.untried.is_empty() {
            lines.push(format!("{} rows were not tried; call again to go on", self.untried.len()));
        }
        lines
    }
}

impl Log {
    /// The end of a log, unless it is empty.
    fn read(path: &Path) -> Option<Self> {
        use std::os::unix::fs::FileExt;
        let file = fs::File::open(path).ok()?;
        let length = file.metadata().ok()?.len();
        let start = length.saturating_sub(TAIL);
        let mut bytes = vec![0; usize::try_from(length - start).ok()?];
        file.read_exact_at(&mut bytes, start).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        // What a terminal would obey is no text.
        let lines: Vec<String> = text
            .lines()
            .map(|line| line.chars().filter(|c| !c.is_control() || *c == '\t').collect::<String>())
            .filter(|line| !line.trim().is_empty())
            .collect();
        let end = lines[lines.len().saturating_sub(LINES)..].to_vec();
        (!end.is_empty()).then(|| Self { path: path.to_owned(), end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with runs a (complete), b (failed), c (not tried).
    fn runs() -> (BatchTable, tempfile::TempDir) {
        let table = BatchTable::parse("s", b"description x\na 1\nb 2\nc 3\n".to_vec()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
        write("a_sim.txt", "u f\n0 1\n");
        write("a_param.txt", "x\n1\n");
        write("b.status", "3\n");
        write("b.log", "one\n\x1b[31mtwo\n\n");
        (table, dir)
    }

    #[test]
    fn rows_are_complete_before_run_failed_or_not_tried() {
        let (table, dir) = runs();
        let told = report(&table, dir.path(), &[0, 1, 2]).unwrap();
        assert_eq!((told.before, told.run, told.untried.len()), (0, 1, 1));
        assert!(!told.all_were_tried());
        assert_eq!(
            told.messages(),
            [
                "3 rows: 0 complete before, 1 run, 1 failed: b (3)",
                "1 rows were not tried; call again to go on"
            ]
        );
        let told = report(&table, dir.path(), &[1]).unwrap();
        assert_eq!(told.messages(), ["3 rows: 2 complete before, 0 run, 1 failed: b (3)"]);
        assert!(report(&table, dir.path(), &[]).unwrap().all_were_tried());
    }

    #[test]
    fn where_no_run_is_complete_the_first_log_is_shown() {
        let (table, dir) = runs();
        fs::remove_file(dir.path().join("a_sim.txt")).unwrap();
        fs::write(dir.path().join("a.status"), "127\n").unwrap();
        let told = report(&table, dir.path(), &[0, 1, 2]).unwrap();
        let log = format!("no run is complete; {} ends with:", dir.path().join("b.log").display());
        assert_eq!(told.messages()[1..4], [log.as_str(), "    one", "    [31mtwo"]);
    }

    #[test]
    fn five_failed_runs_are_named() {
        let names = |count: usize| (0..count).map(|i| (format!("r{i}"), "1".to_owned())).collect();
        let report = Report { rows: 9, failed: names(6), ..Report::default() };
        assert!(report.messages()[0].ends_with("6 failed: r0 (1) r1 (1) r2 (1) r3 (1) r4 (1) …"));
        let report = Report { failed: names(5), ..report };
        assert!(report.messages()[0].ends_with("5 failed: r0 (1) r1 (1) r2 (1) r3 (1) r4 (1)"));
    }
}
