//! Runs by yade-batch, whose overview (http://localhost:9080) shows how they come along.

use std::fs::{self, File, Permissions};
use std::num::NonZeroUsize;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use gl_progress::stage;

use crate::Say;
use crate::call::Batch;
use crate::complete::missing;
use crate::model::{Model, find_program, path_with_own};
use crate::report::{Report, report};

/// How often the statuses of the runs are looked at.
const LOOK: Duration = Duration::from_millis(100);

/// What yade-batch takes for Yade: it is called with Yade's arguments, and finds its row by `YADE_BATCH`.
const YADE: &str = "#!/bin/sh\nexec \"$GL_RUN\" batch-row\n";

/// Run the rows whose run is not complete by yade-batch, on `threads` threads at a time. It always ends with
/// 0; whether a run ended well is in its status.
///
/// # Errors
/// If the model is no Yade script, yade-batch is not there, or the folder cannot be written.
pub fn run(batch: &mut Batch, threads: NonZeroUsize, say: Say) -> Result<Report> {
    let Model::Yade(script) = batch.job.model.clone() else {
        bail!("MODEL: yade-batch runs Yade scripts, which end in .py; gl-run local runs any command");
    };
    ensure!(find_program("yade-batch").is_some(), "yade-batch is not installed: apt-get install yade");
    batch.folder.lock(say)?;
    batch.folder.begin(&batch.table)?;
    let rows = missing(&batch.table, batch.folder.dir())?;
    batch.folder.forget(&batch.table, &rows)?;
    batch.job.packed = false;
    batch.job.save()?;
    if !rows.is_empty() {
        let work = batch.folder.work();
        // Under names of our own, in the current folder: yade-batch hands them to a shell unquoted.
        gl_table::write_whole(&work.join("missing.txt"), batch.table.select(&rows).text().as_bytes())?;
        symlink(script, work.join("model.py")).context("no link to the script can be made")?;
        gl_table::write_whole(&work.join("yade"), YADE.as_bytes())?;
        fs::set_permissions(work.join("yade"), Permissions::from_mode(0o755))
            .context("yade cannot be made a program")?;
        run_batch(batch, &rows, threads)?;
    }
    let report = report(&batch.table, batch.folder.dir(), &rows)?;
    // What a model has left running may still write there; the next call removes it.
    batch.folder.end().unwrap_or_else(|error| say(&format!("{error:#}")));
    Ok(report)
}

fn run_batch(batch: &Batch, rows: &[usize], threads: NonZeroUsize) -> Result<()> {
    let stage = stage("runs", rows.len());
    let log = batch.folder.dir().join("yade-batch.log");
    let log = File::create(&log).with_context(|| format!("{}: cannot be written", log.display()))?;
    let errors = log.try_clone().context("yade-batch.log cannot be written")?;
    // It ends yade-batch, and the rows that this has started, when this process is gone.
    let mut child = Command::new(&batch.job.gl_run)
        .arg("guard")
        .arg(std::process::id().to_string())
        .arg("yade-batch")
        .arg(format!("--jobs={threads}"))
        .args(["--executable=./yade", "--log=../@.log", "--plot-update=0", "missing.txt", "model.py"])
        .env("GL_RUN", &batch.job.gl_run)
        .env("PATH", path_with_own())
        .current_dir(batch.folder.work())
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(errors)
        .spawn()
        .context("yade-batch cannot be started")?;
    let mut left = rows.to_vec();
    loop {
        let is_over = child.try_wait().context("yade-batch is lost")?.is_some();
        // Every run that ends leaves a status.
        left.retain(|&row| {
            let has_ended = batch.file(row, ".status").exists();
            if has_ended {
                stage.advance();
            }
            !has_ended
        });
        if is_over {
            return Ok(());
        }
        thread::sleep(LOOK);
    }
}
