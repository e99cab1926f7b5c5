//! What is said of a calibration or diagnosis.

use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::Result;
use gl_case::folders::BASE;
use gl_engine::scheduler::Job;
use gl_engine::standing::{Runs, roughly};
use gl_inference::samples::Samples;

use crate::name;

/// Characters of the bar.
const WIDTH: usize = 40;
/// Lines of the log of a controlling job that are shown.
const LINES: usize = 3;

/// Whether everything that is made of an iteration's or a round's runs is there.
fn is_complete(stage: &Path) -> bool {
    stage.join("stop.code").exists() || stage.join("attribution.txt").exists()
}

/// The line of an iteration or round that is complete; nothing of another.
pub fn finished_stage(out: &Path, stage: &Path) -> Result<String> {
    if !is_complete(stage) {
        return Ok(String::new());
    }
    let name = name(out, stage);
    let number = name.rsplit(' ').next().and_then(|number| number.parse().ok()).unwrap_or(0);
    if stage.join("posterior.txt").exists() && stage.join("summary.txt").exists() {
        let line = gl_drive::words::iteration(number, stage)?;
        let folder = name.rsplit_once(": ").map_or(String::new(), |(folder, _)| format!("{folder}: "));
        return Ok(format!("{folder}{line}\n"));
    }
    Ok(format!("{name}: {} runs\n", Samples::read(&stage.join("samples.txt"))?.len()))
}

/// Whether what it ends with is there, and made of what is there.
pub fn is_finished(out: &Path, stages: &[PathBuf]) -> bool {
    let Some(last) = stages.last().filter(|last| is_complete(last)) else { return false };
    let time = |path: PathBuf| fs::metadata(path).and_then(|found| found.modified()).ok();
    if out.join(BASE).is_dir() {
        return time(out.join("shrink.txt"))
            .is_some_and(|shrink| Some(shrink) >= time(last.join("samples.txt")));
    }
    let read = |folder: &Path| fs::read(folder.join("posterior.txt")).ok();
    read(out).is_some() && read(out) == read(last)
}

/// The runs of the iteration at hand, by what is in the queue where that is known; and on a terminal a bar.
pub fn runs(out: &Path, stages: &[PathBuf], queue: Option<&[Job]>) -> Result<String> {
    let Some(stage) = stages.last().filter(|stage| !is_complete(stage)) else { return Ok(String::new()) };
    let mut tests = Runs::of_tests(stage)?;
    // What the scheduler has killed could not say so.
    let is_idle = queue.is_some_and(|jobs| !jobs.iter().any(is_running));
    if is_idle {
        tests.iter_mut().for_each(|(_, runs)| runs.running = 0);
    }
    let runs = tests.iter().map(|(_, runs)| runs.clone()).sum::<Runs>();
    let mut line = counted(&name(out, stage), &runs);
    if let Some(time) = runs.forecast(SystemTime::now()).filter(|_| !is_idle) {
        line.push_str(&format!("; {} left", roughly(time)));
    }
    line.push('\n');
    for (test, runs) in tests.iter().filter(|_| tests.len() > 1) {
        line.push_str(&format!("    {}\n", counted(test, runs)));
    }
    if io::stdout().is_terminal() {
        let ended = runs.done + runs.failed;
        let full = (ended * WIDTH).checked_div(runs.rows).unwrap_or(0);
        line.push_str(&format!(
            "[{}{}] {ended} of {}\n",
            "#".repeat(full),
            ".".repeat(WIDTH - full),
            runs.rows
        ));
    }
    for job in queue.unwrap_or_default().iter().filter(|job| !is_running(job)) {
        line.push_str(&format!("runs, job {}\n", job.to_string().to_lowercase()));
    }
    Ok(line)
}

/// How many runs of an iteration or a test there are, and how many have come to what.
fn counted(name: &str, runs: &Runs) -> String {
    format!(
        "{name}: {} runs: {} done, {} running, {} failed, {} to come",
        runs.rows,
        runs.done,
        runs.running,
        runs.failed,
        runs.to_come()
    )
}

/// The controlling job, or that there is none and what the last one said.
pub fn controlling_job(out: &Path, job: Option<&Job>) -> String {
    if let Some(job) = job {
        return format!("controlling job {}\n", job.to_string().to_lowercase());
    }
    let mut said = "no controlling job is in the queue; gl-submit goes on from here\n".to_owned();
    let log = out.join("control.log");
    let text = fs::read(&log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<&str> = text.lines().collect();
    if !lines.is_empty() {
        said.push_str(&format!("{} ends with:\n", log.display()));
        lines[lines.len().saturating_sub(LINES)..]
            .iter()
            .for_each(|line| said.push_str(&format!("    {line}\n")));
    }
    said
}

/// Whether tasks of it run; PBS calls an array begun then.
fn is_running(job: &Job) -> bool {
    matches!(job.state.as_str(), "running" | "begun" | "completing" | "exiting")
}
