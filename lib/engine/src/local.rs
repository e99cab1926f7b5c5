//! Runs on this machine, several at a time.

use std::io::{BufRead, BufReader, Write};
use std::num::NonZeroUsize;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

use anyhow::{Context, Result};
use gl_progress::{Stage, stage};

use crate::Say;
use crate::call::Batch;
use crate::complete::missing;
use crate::process::{DISK_UNUSABLE, reap};
use crate::report::{Report, report};

/// Run the rows whose run is not complete, `jobs` at a time. When this process dies, so do the runs.
///
/// Each row, or where runs are packed several, is a process `gl-run row` of its own, which ends its run when
/// it is told to end, or when this process is gone.
///
/// # Errors
/// If the folder cannot be written. What becomes of the runs is in the report.
pub fn run(batch: &mut Batch, jobs: NonZeroUsize, say: Say) -> Result<Report> {
    batch.folder.lock(say)?;
    batch.folder.begin(&batch.table)?;
    let rows = missing(&batch.table, batch.folder.dir())?;
    batch.folder.forget(&batch.table, &rows)?;
    batch.job.save()?;
    run_all(batch, &rows, jobs.get(), say);
    let report = report(&batch.table, batch.folder.dir(), &rows)?;
    // What a model has left running may still write there; the next call removes it.
    batch.folder.end().unwrap_or_else(|error| say(&format!("{error:#}")));
    Ok(report)
}

fn run_all(batch: &Batch, rows: &[usize], jobs: usize, say: Say) {
    // Each process makes a packed file: few of them, but enough to keep all processors at work.
    let at_once = if batch.job.packed { rows.len() / (4 * jobs) + 1 } else { 1 };
    let stage = stage("runs", rows.len());
    let queue = Mutex::new(rows.chunks(at_once));
    // Where the disk is full, hours of the runs to come would be lost as well.
    let is_over = AtomicBool::new(false);
    let work = || {
        while !is_over.load(Ordering::Relaxed) {
            let Some(rows) = queue.lock().unwrap_or_else(PoisonError::into_inner).next() else { return };
            match run_process(batch, rows, &stage) {
                Ok(status) if status.code() == Some(DISK_UNUSABLE.into()) => {
                    is_over.store(true, Ordering::Relaxed);
                }
                // Those of its rows that it did not come to are told of at the end.
                Ok(_) => {}
                Err(error) => {
                    is_over.store(true, Ordering::Relaxed);
                    say(&format!("{error:#}"));
                }
            }
        }
    };
    // A thread stays until its processes have ended: the kernel ties them to the thread that started them.
    thread::scope(|scope| {
        for _ in 0..jobs.min(rows.len()) {
            scope.spawn(work);
        }
    });
}

/// Run rows in a process of their own, which tells a user itself why it could not try all of them.
fn run_process(batch: &Batch, rows: &[usize], stage: &Stage<'_>) -> Result<ExitStatus> {
    let mut child = Command::new(&batch.job.gl_run)
        .arg("row")
        .arg(batch.folder.work())
        .arg(std::process::id().to_string())
        .process_group(0)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("{}: cannot be started", batch.job.gl_run.display()))?;
    let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
    if let Some(mut stdin) = stdin {
        // One that has died already says so by its exit code.
        let _ = stdin.write_all(batch.table.select(rows).text().as_bytes());
    }
    for line in stdout.into_iter().flat_map(|stdout| BufReader::new(stdout).lines()) {
        if line.is_ok() {
            stage.advance();
        }
    }
    Ok(reap(child)?)
}
