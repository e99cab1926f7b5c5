use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;
use rustix::time::{ClockId, clock_gettime};

use super::{Curves, World, add_noise, inputs, places, simulate};
use gl_inference::collect::completeness;
use gl_inference::observations::ByName;
use gl_inference::samples::Samples;
use gl_inference::times::RunTime;
use gl_table::{Table, TableWriter};

/// What became of the runs of a samples table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Number of runs done now.
    pub done: usize,
    /// Number of runs that were there and complete already.
    pub kept: usize,
    /// Runs without a result, with the reason.
    pub failed: Vec<String>,
    /// How long each run took that was tried now.
    pub times: Vec<RunTime>,
}

impl Report {
    /// Lines that tell a user of it: the failed runs, and how many of each there are.
    pub fn messages(&self) -> Vec<String> {
        let mut lines = self.failed.clone();
        lines.push(format!("{} runs done, {} kept, {} failed", self.done, self.kept, self.failed.len()));
        lines
    }
}

/// Measures a run, which is one thread's.
struct Clock {
    begin: Instant,
    processor: f64,
}

impl Clock {
    fn start() -> Self {
        Self { begin: Instant::now(), processor: thread_seconds() }
    }

    fn stop(&self, sample: &str, has_failed: bool) -> RunTime {
        RunTime {
            sample: sample.to_owned(),
            seconds: self.begin.elapsed().as_secs_f64(),
            processor_seconds: (thread_seconds() - self.processor).max(0.0),
            exit: i64::from(has_failed),
        }
    }
}

/// Processor time of this thread so far, s.
fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

enum Fate {
    Done,
    Kept,
    Failed(String),
}

/// Run a world at every sample: `<description>_param.txt` and `<description>_sim.txt` in `dir`, which
/// is made if need be. A run whose two files are complete, with these parameters and settings, is
/// kept. A run whose parameters make no sense fails alone.
///
/// # Errors
/// If a parameter is unknown, a file cannot be written, or there are samples and every run failed.
pub fn run_samples(world: &dyn World, samples: &Samples, dir: &Path) -> Result<Report> {
    let places = places(world, &samples.parameters).with_context(|| format!("{}:1", samples.source))?;
    fs::create_dir_all(dir).with_context(|| format!("{}: cannot be made a folder", dir.display()))?;
    let there = completeness(samples, dir)?;
    let fates: Vec<(Fate, RunTime)> = (samples.names.par_iter(), samples.values.par_iter(), there.par_iter())
        .into_par_iter()
        .map(|(name, values, there)| {
            let mut inputs: Vec<f64> = world.inputs().iter().map(|input| input.default).collect();
            for (&place, &value) in places.iter().zip(values) {
                inputs[place] = value;
            }
            let clock = Clock::start();
            let fate = run_sample(world, name, &inputs, dir, there.is_ok())?;
            let time = clock.stop(name, matches!(fate, Fate::Failed(_)));
            Ok((fate, time))
        })
        .collect::<Result<_>>()?;
    let mut report = Report::default();
    for (fate, time) in fates {
        if !matches!(fate, Fate::Kept) {
            report.times.push(time);
        }
        match fate {
            Fate::Done => report.done += 1,
            Fate::Kept => report.kept += 1,
            Fate::Failed(reason) => report.failed.push(reason),
        }
    }
    ensure!(
        samples.is_empty() || report.failed.len() < samples.len(),
        "{}: every run failed; the first: {}",
        samples.source,
        report.failed.first().map_or("", String::as_str)
    );
    Ok(report)
}

/// Run a sample, unless its run is complete and of this very world.
fn run_sample(world: &dyn World, name: &str, inputs: &[f64], dir: &Path, is_complete: bool) -> Result<Fate> {
    let param = dir.join(format!("{name}_param.txt"));
    let sim = dir.join(format!("{name}_sim.txt"));
    let mut columns: Vec<&str> = world.inputs().iter().map(|input| input.name).collect();
    let mut values = inputs.to_vec();
    for (name, value) in world.settings() {
        columns.push(name);
        values.push(value);
    }
    if is_complete && is_own(world, &param, &sim, &columns, &values) {
        return Ok(Fate::Kept);
    }
    // A result of other parameters must not stand beside the new ones, not even for a moment.
    for old in [&sim, &param] {
        if old.exists() {
            fs::remove_file(old).with_context(|| format!("{}: cannot be replaced", old.display()))?;
        }
    }
    let curves = match simulate(world, inputs) {
        Ok(curves) => curves,
        Err(problem) => return Ok(Fate::Failed(format!("{name}: {problem:#}"))),
    };
    let mut table = TableWriter::create(Some(&param), &columns)?;
    table.numbers(&values).end_row()?;
    table.finish()?;
    write_curves(world, &curves, Some(&sim))?;
    Ok(Fate::Done)
}

/// Whether a run has these very parameters and settings, and every step of the path.
fn is_own(world: &dyn World, param: &Path, sim: &Path, columns: &[&str], values: &[f64]) -> bool {
    let same = |file: &Path, column: &str, expected: &[f64]| {
        Table::read(file).is_ok_and(|table| {
            table.check_end().is_ok() && table.numbers(column).is_ok_and(|found| found == expected)
        })
    };
    columns.iter().zip(values).all(|(column, value)| same(param, column, &[*value]))
        && same(sim, world.control(), &world.path())
}

/// Write the curve at the given parameters, as a measurement: control and observables, with normal
/// noise of standard deviation `noise` where it is given for an observable.
///
/// # Errors
/// If a name is unknown, a noise negative, the parameters make no sense, or it cannot be written.
pub fn write_curve(
    world: &dyn World,
    given: &ByName,
    noise: &ByName,
    seed: u64,
    path: Option<&Path>,
) -> Result<()> {
    let names: Vec<String> = world.observables().iter().map(|&name| name.to_owned()).collect();
    noise.check_names(&names, "--noise")?;
    if let Some((name, sd)) = noise.iter().find(|(_, sd)| *sd < 0.0) {
        bail!("--noise {name}={sd}: a standard deviation cannot be negative");
    }
    let mut curves = simulate(world, &inputs(world, given)?)?;
    let steps = curves.control.len();
    let sd: Vec<_> = names.iter().map(|name| vec![noise.get(name).unwrap_or(0.0); steps]).collect();
    add_noise(&mut curves.values, &sd, seed);
    write_curves(world, &curves, path)
}

fn write_curves(world: &dyn World, curves: &Curves, path: Option<&Path>) -> Result<()> {
    let mut columns = vec![world.control()];
    columns.extend(world.observables());
    let mut table = TableWriter::create(path, &columns)?;
    for (step, &control) in curves.control.iter().enumerate() {
        table.number(control);
        for values in &curves.values {
            table.number(values[step]);
        }
        table.end_row()?;
    }
    table.finish()
}

/// Write the table of a world's parameters: `name default lower upper unit effect meaning`.
///
/// # Errors
/// If it cannot be written.
pub fn write_inputs(world: &dyn World, path: Option<&Path>) -> Result<()> {
    let columns = ["name", "default", "lower", "upper", "unit", "effect", "meaning"];
    let mut table = TableWriter::create(path, &columns)?;
    for input in world.inputs() {
        table.text(input.name).numbers(&[input.default, input.range.0, input.range.1]);
        table.text(input.unit).text(input.effect.unwrap_or("-")).text(input.meaning).end_row()?;
    }
    table.finish()
}
