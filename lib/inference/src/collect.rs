//! Reading what the runs wrote, and leaving out the runs that failed.

mod failure;
mod packed;
mod run;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use rayon::prelude::*;

pub use failure::Failure;
use packed::{OpenPacks, Packs};

use crate::ensemble::Ensemble;
use crate::observations::Observations;
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
}

/// The curves of a run at the steps of the measurement, shape (observables, steps), or why there are none.
type Run = Result<Vec<Vec<f64>>, Failure>;

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
        let stage = stage("reading runs", samples.len());
        for first in (0..samples.len()).step_by(RUNS_AT_A_TIME) {
            let some = first..samples.len().min(first + RUNS_AT_A_TIME);
            let folders = (self.folders.iter().zip(&packs))
                .map(|(path, packs)| Ok(Folder { path, packs, files: packs.open(some.clone())? }))
                .collect::<Result<Vec<_>>>()?;
            let runs: Vec<Run> = some
                .clone()
                .into_par_iter()
                .map(|i| self.run(&folders, samples, i))
                .inspect(|_| stage.advance())
                .collect::<Result<_>>()?;
            let mut ensemble = Ensemble::new(self.observations, false);
            for (name, run) in samples.names[some].iter().zip(runs) {
                status.push(run.map(|curves| ensemble.push(name, &curves, None)));
            }
            take(ensemble)?;
        }
        Ok(status)
    }

    /// The run of a sample, which is in one of the folders at the most.
    fn run(&self, folders: &[Folder<'_>], samples: &Samples, i: usize) -> Result<Run> {
        let name = &samples.names[i];
        let mut found: Option<Run> = None;
        for folder in folders {
            let run = self.packed(folder, samples, i);
            let run = if matches!(run, Some(Ok(_))) { run } else { self.loose(folder, samples, i).or(run) };
            if run.is_some() && found.is_some() {
                let folder = folder.path.display();
                bail!("{name}_sim.txt is in {folder} and in another folder; name only one of them")
            }
            found = found.or(run);
        }
        Ok(found.unwrap_or_else(|| Err(missing(folders, name))))
    }

    /// A run from its own two files, if the simulation is there.
    fn loose(&self, folder: &Folder<'_>, samples: &Samples, i: usize) -> Option<Run> {
        let name = &samples.names[i];
        let read = |file: String| match fs::read(folder.path.join(&file)) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Failure::Malformed(format!("{}: {error}", folder.path.join(&file).display()))),
        };
        let simulation = read(format!("{name}_sim.txt")).transpose()?;
        Some(simulation.and_then(|simulation| {
            let parameters = read(format!("{name}_param.txt"))?;
            self.run_of(samples, i, parameters.as_deref(), &simulation)
        }))
    }

    /// A run from a packed file, if it is in one: of several copies, the last one that is good.
    fn packed(&self, folder: &Folder<'_>, samples: &Samples, i: usize) -> Option<Run> {
        let mut best: Option<Run> = None;
        for copy in folder.packs.copies(i) {
            let run = folder
                .files
                .read(&samples.names[i], copy)
                .and_then(|bytes| self.run_of(samples, i, bytes.parameters.as_deref(), &bytes.simulation));
            if run.is_ok() {
                return Some(run);
            }
            best = best.or(Some(run));
        }
        best
    }
}

/// A folder of runs.
struct Folder<'a> {
    path: &'a Path,
    packs: &'a Packs,
    /// Those of the packed files that are needed now.
    files: OpenPacks<'a>,
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
