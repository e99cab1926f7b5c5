//! How long runs took, from the processes that made them to the table ([`gl_inference::times`]).

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use gl_inference::times::RunTime;
use gl_table::push_number;
use nix::sys::resource::{UsageWho, getrusage};

use crate::job::Job;
use crate::process::Ending;

/// How the files in `.run` are called, each with the name of a machine behind it.
const PREFIX: &str = "times.";

/// Measures the run that this process waits for. It must wait for one at a time.
pub struct Clock {
    begin: Instant,
    /// Processor time of what ended before, s.
    processor: f64,
}

impl Clock {
    pub fn start() -> Result<Self> {
        Ok(Self { begin: Instant::now(), processor: children_seconds()? })
    }

    /// Note how long the run took, if a table is asked for.
    ///
    /// Each machine has a file of its own, to which a run adds in one step: on a file system that machines share,
    /// what two of them add to one file may be lost.
    pub fn stop(&self, job: &Job, sample: &str, ending: &Ending) -> Result<()> {
        if job.times.is_none() {
            return Ok(());
        }
        let mut line = format!("{sample}\t").into_bytes();
        push_number(&mut line, to_microseconds(self.begin.elapsed().as_secs_f64()));
        line.push(b'\t');
        push_number(&mut line, to_microseconds(children_seconds()? - self.processor));
        line.extend_from_slice(format!("\t{}\n", ending.code()).as_bytes());
        let host = rustix::system::uname();
        let path = job.work().join(format!("{PREFIX}{}", host.nodename().to_string_lossy()));
        let file = File::options().create(true).append(true).open(&path);
        file.and_then(|mut file| file.write_all(&line))
            .with_context(|| format!("{}: cannot be written", path.display()))
    }
}

/// Processor time of all children that have ended, and of theirs, s.
fn children_seconds() -> Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).context("the time of runs cannot be measured")?;
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + 1e-6 * time.tv_usec() as f64;
    Ok(seconds(usage.user_time()) + seconds(usage.system_time()))
}

/// What the kernel counts in, without what is left over of a difference.
fn to_microseconds(seconds: f64) -> f64 {
    (1e6 * seconds).round() / 1e6
}

/// Add what runs left in a folder `.run` to the table that its job names.
///
/// # Errors
/// If the table cannot be written.
pub fn keep(work: &Path) -> Result<()> {
    // Where there is no job, no run was begun.
    let Some(times) = Job::load(work).ok().and_then(|job| job.times) else { return Ok(()) };
    let mut files: Vec<_> = fs::read_dir(work)
        .with_context(|| format!("{}: cannot be read", work.display()))?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(PREFIX)))
        .collect();
    files.sort();
    let mut rows = Vec::new();
    for path in files {
        let text =
            fs::read_to_string(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        rows.extend(text.lines().filter_map(row));
    }
    RunTime::add(&times, rows)
}

/// A line that [`Clock::stop`] has written; none where it was cut, as where the disk was full.
fn row(line: &str) -> Option<RunTime> {
    let mut fields = line.split('\t');
    let mut next = || fields.next();
    let (sample, seconds, processor, exit) = (next()?, next()?, next()?, next()?);
    Some(RunTime {
        sample: sample.to_owned(),
        seconds: seconds.parse().ok()?,
        processor_seconds: processor.parse().ok()?,
        exit: exit.parse().ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_was_cut_is_left_out() {
        let whole = row("a\t1.5\t0.25\t0").unwrap();
        assert_eq!((whole.sample.as_str(), whole.seconds, whole.exit), ("a", 1.5, 0));
        for line in ["", "a", "a\t1.5", "a\t1.5\t0.2\t", "a\tx\t0.2\t0"] {
            assert_eq!(row(line), None, "{line}");
        }
    }
}
