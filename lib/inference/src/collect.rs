//! Reading what the runs wrote, and leaving out the runs that failed.

mod complete;
mod failure;
mod packed;
mod run;

use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use rayon::prelude::*;

pub use complete::{RTOL, completeness, completeness_in};
pub use failure::{Failure, RunStatus};
use packed::{OpenPacks, Packs};

use crate::ensemble::Ensemble;
use crate::observations::Observations;
use crate::rig::RigAt;
use crate::samples::Samples;
use gl_progress::stage;

/// How runs are read: where from, which columns, and what is let pass.
#[derive(Clone, Debug)]
pub struct Collection<'a> {
    /// The measurement whose steps the runs are brought onto.
    pub observations: &'a Observations,
    /// What the runs call the control.
    pub control: String,
    /// What the runs call the observables, in the order of the measurement's.
    pub observables: Vec<String>,
    /// Folders that hold the runs' files.
    pub folders: Vec<PathBuf>,
    /// Relative difference up to which a run's parameters are the table's.
    pub rtol: f64,
    /// Share of the control's range by which a run may fall short.
    pub end_tolerance: f64,
    /// What the rig makes of each run.
    pub rig: RigAt,
}

/// Runs that are read at a time, and held in memory until they are taken.
const RUNS_AT_A_TIME: usize = 512;

impl Collection<'_> {
    /// Read the run of every sample. `take` gets the good ones, some at a time, in the order of the
    /// samples; what became of each sample is returned.
    ///
    /// A run whose files are packed is read from there; see `docs/tables.md`.
    ///
    /// # Errors
    /// If a run is in two folders, or a folder cannot be read. A run that failed is no error.
    pub fn collect(
        &self,
        samples: &Samples,
        mut take: impl FnMut(Ensemble) -> Result<()>,
    ) -> Result<Vec<Result<(), Failure>>> {
        let packs =
            self.folders.iter().map(|folder| Packs::find(folder, samples)).collect::<Result<Vec<_>>>()?;
        let mut status = Vec::with_capacity(samples.len());
        let judge = |i: usize, parameters: Option<&[u8]>, simulation: &[u8]| {
            self.run_of(samples, i, parameters, simulation)
        };
        let places: Vec<_> = self.folders.iter().map(PathBuf::as_path).zip(&packs).collect();
        judge_runs("reading runs", &places, samples, judge, |some, runs| {
            let mut ensemble = Ensemble::new(self.observations, false);
            for (name, run) in samples.names[some].iter().zip(runs) {
                status.push(run.map(|curves: Vec<Vec<f64>>| ensemble.push(name, &curves, None)));
            }
            take(ensemble)
        })?;
        Ok(status)
    }
}

/// Find the run of every sample in folders, where it is in one of them at the most, and judge it by what is
/// in its two files. `take` gets what `judge` made of the runs, some at a time, in the order of the samples.
///
/// # Errors
/// If a run is in two folders, a folder cannot be read, or `take` fails.
fn judge_runs<T: Send>(
    what: &str,
    places: &[(&Path, &Packs)],
    samples: &Samples,
    judge: impl Fn(usize, Option<&[u8]>, &[u8]) -> Result<T, Failure> + Sync,
    mut take: impl FnMut(Range<usize>, Vec<Result<T, Failure>>) -> Result<()>,
) -> Result<()> {
    let stage = stage(what, samples.len());
    for first in (0..samples.len()).step_by(RUNS_AT_A_TIME) {
        let some = first..samples.len().min(first + RUNS_AT_A_TIME);
        let folders = places
            .iter()
            .map(|&(path, packs)| Ok(Folder { path, packs, files: packs.open(some.clone())? }))
            .collect::<Result<Vec<_>>>()?;
        let runs: Vec<Result<T, Failure>> = some
            .clone()
            .into_par_iter()
            .map(|i| {
                let name = &samples.names[i];
                run_in(&folders, name, i, |parameters, simulation| judge(i, parameters, simulation))
            })
            .inspect(|_| stage.advance())
            .collect::<Result<_>>()?;
        take(some, runs)?;
    }
    Ok(())
}

/// The run of a sample, which is in one of the folders at the most.
fn run_in<T>(
    folders: &[Folder<'_>],
    name: &str,
    i: usize,
    judge: impl Fn(Option<&[u8]>, &[u8]) -> Result<T, Failure>,
) -> Result<Result<T, Failure>> {
    let mut found = None;
    for folder in folders {
        let run = folder.packed(name, i, &judge);
        let run = if matches!(run, Some(Ok(_))) { run } else { folder.loose(name, &judge).or(run) };
        if run.is_some() && found.is_some() {
            let folder = folder.path.display();
            bail!("{name}_sim.txt is in {folder} and in another folder; name only one of them")
        }
        found = found.or(run);
    }
    Ok(found.unwrap_or_else(|| Err(missing(folders, name))))
}

/// A folder of runs.
struct Folder<'a> {
    path: &'a Path,
    packs: &'a Packs,
    /// Those of the packed files that are needed now.
    files: OpenPacks<'a>,
}

impl Folder<'_> {
    /// A run from its own two files, if the simulation is there.
    fn loose<T>(
        &self,
        name: &str,
        judge: &impl Fn(Option<&[u8]>, &[u8]) -> Result<T, Failure>,
    ) -> Option<Result<T, Failure>> {
        let read = |file: String| match fs::read(self.path.join(&file)) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Failure::Malformed(format!("{}: {error}", self.path.join(&file).display()))),
        };
        let simulation = read(format!("{name}_sim.txt")).transpose()?;
        Some(simulation.and_then(|simulation| {
            let parameters = read(format!("{name}_param.txt"))?;
            judge(parameters.as_deref(), &simulation)
        }))
    }

    /// A run from a packed file, if it is in one: of several copies, the last one that is good.
    fn packed<T>(
        &self,
        name: &str,
        i: usize,
        judge: &impl Fn(Option<&[u8]>, &[u8]) -> Result<T, Failure>,
    ) -> Option<Result<T, Failure>> {
        let mut best = None;
        for copy in self.packs.copies(i) {
            let run = (self.files.read(name, copy))
                .and_then(|bytes| judge(bytes.parameters.as_deref(), &bytes.simulation));
            if run.is_ok() {
                return Some(run);
            }
            best = best.or(Some(run));
        }
        best
    }
}

/// What is known of a run that left no file.
fn missing(folders: &[Folder<'_>], name: &str) -> Failure {
    let mut detail = format!("no {name}_sim.txt");
    if let Some(ending) = folders.iter().find_map(|folder| ending(folder.path, name)) {
        detail = format!("{detail}; exit code {ending}");
    }
    if let Some(damage) = folders.iter().find_map(|folder| folder.packs.damage()) {
        detail = format!("{detail}; {damage}");
    }
    Failure::Missing(detail)
}

/// How a run ended, from the `<description>.status` that the engines leave: an exit code, and a word such
/// as TIMEOUT where it was not the model that ended it.
fn ending(folder: &Path, name: &str) -> Option<String> {
    let text = fs::read_to_string(folder.join(format!("{name}.status"))).ok()?;
    let words: Vec<&str> = text.lines().next()?.split_whitespace().collect();
    (!words.is_empty()).then(|| words.join(" "))
}
