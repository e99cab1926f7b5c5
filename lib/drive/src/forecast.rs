//! What a calibration and a diagnosis take: runs, time by the first of them, disk.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, Result, bail};
use gl_case::folders::BASE;
use gl_case::{Case, Posterior};
use gl_gap::attribute::rounds::Rounds;
use gl_inference::observations::Observations;
use gl_inference::prior::Prior;
use gl_table::verdict::Verdicts;

use crate::check::counted;
use crate::columns::{runs_of_design, runs_of_iteration};
use crate::diagnose::closest;

/// What there is to do.
pub(crate) struct Plan<'a> {
    pub(crate) case: &'a Case,
    pub(crate) prior: &'a Prior,
    /// The measurement of each test.
    pub(crate) observations: &'a [Observations],
}

/// Bytes of a number in a table, and of the files around a run, where no run says more.
const NUMBER: u64 = 20;
const FILES: u64 = 8192;

/// What the runs that are there took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Measured {
    runs: u32,
    /// From the samples to the last run, all iterations together.
    seconds: f64,
    bytes: u64,
}

impl Plan<'_> {
    /// Runs of a calibration at the most.
    pub(crate) fn calibration(&self) -> usize {
        let of = |number| runs_of_iteration(self.case, self.prior, number);
        of(0) + (self.case.iterations - 1) * of(1)
    }

    /// Runs of a diagnosis that goes as it mostly does, at the most: two calibrations and the design.
    fn likely_diagnosis(&self) -> usize {
        2 * self.calibration() + self.rounds().all
    }

    /// Runs of a diagnosis at the most: in wider boxes, a calibration beyond the prior, and further rounds, too.
    pub(crate) fn diagnosis(&self) -> usize {
        let rounds = self.rounds();
        let further = if self.case.design_num.is_none() { rounds.most_further() } else { 0 };
        self.likely_diagnosis() + rounds.most_wider() + self.calibration() + self.closest() + further
    }

    /// Runs of the closest fits at the most.
    fn closest(&self) -> usize {
        let is_made = self.case.posterior == Posterior::Emulator;
        if is_made {
            2 * closest::iterations(self.case) * runs_of_iteration(self.case, self.prior, 1)
        } else {
            0
        }
    }

    fn rounds(&self) -> Rounds {
        Rounds { all: runs_of_design(self.case, self.prior) }
    }

    fn tests(&self) -> Vec<&str> {
        self.case.tests.iter().map(|test| test.name.as_str()).collect()
    }

    /// How many runs it will be, and how long they take by those that are there.
    ///
    /// # Errors
    /// If a folder of results cannot be read.
    pub(crate) fn forecast(&self, out: &Path, diagnosis: &Path, verdicts: &mut Verdicts) -> Result<()> {
        let [first, num] = [0, 1].map(|number| runs_of_iteration(self.case, self.prior, number));
        let begins = if first == num { String::new() } else { format!("{first} and then ") };
        let (most, all) = (self.calibration(), self.likely_diagnosis());
        verdicts.add(
            "runs",
            most,
            format!(
                "a calibration takes {begins}{} an iteration, {} at the most: {} at the most{}",
                counted(num, "run"),
                counted(self.case.iterations, "iteration"),
                counted(most, "run"),
                in_tests(self.case)
            ),
        );
        let has_effects = !self.prior.effects().is_empty();
        if has_effects {
            let design = self.rounds();
            let further = match self.case.design_num {
                None => {
                    format!(", and {} more where too little is known of effects then", design.most_further())
                }
                Some(_) => String::new(),
            };
            let closest = match self.closest() {
                0 => String::new(),
                most => format!(", and up to {most} more where something unknown is beside the cause"),
            };
            let text = format!(
                "a diagnosis takes two calibrations and {} runs more: up to {all}{}, and {} more where the prior proves too narrow, with another calibration{further}{closest}: {} at the most",
                design.all,
                in_tests(self.case),
                design.most_wider(),
                self.diagnosis()
            );
            verdicts.add("runs-diagnosis", all, text);
        }
        if let Some(measured) =
            measured(out, &self.tests())?.or(measured(&diagnosis.join(BASE), &self.tests())?)
        {
            let each = measured.seconds / f64::from(measured.runs);
            let of_all = if has_effects {
                format!(", {} for {all}", duration(each * all as f64))
            } else {
                String::new()
            };
            verdicts.add(
                "seconds-a-run",
                gl_table::rounded(each, 3),
                format!(
                    "by the {} that are there: {} each, with those beside it; {} for {most}{of_all}",
                    counted(measured.runs as usize, "run"),
                    duration(each),
                    duration(each * most as f64)
                ),
            );
        }
        Ok(())
    }

    /// Whether the disk has room for so many runs: megabytes that they take, and that are free.
    ///
    /// # Errors
    /// If it has not.
    pub(crate) fn room(&self, runs: usize, out: &Path) -> Result<(u64, u64)> {
        let of = |observations: &Observations| observations.steps() * (1 + observations.names.len());
        let readings = self.observations.iter().map(of).sum::<usize>() as u64;
        // In its own file, in the ensemble, and in what is made of it.
        let guessed = FILES * self.observations.len() as u64 + 4 * NUMBER * readings;
        let each = measured(out, &self.tests())?.map_or(guessed, |measured| {
            (measured.bytes / u64::from(measured.runs)).max(FILES) + 3 * NUMBER * readings
        });
        let needed = each * runs as u64;
        let folder = std::path::absolute(out)?;
        let folder = folder.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("/"));
        let disk = rustix::fs::statvfs(folder).with_context(|| folder.display().to_string())?;
        let free = disk.f_bavail * disk.f_frsize;
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        if needed > free {
            bail!(
                "{}: {} MB are free, but {} take about {} MB; give another --out",
                folder.display(),
                megabytes(free),
                counted(runs, "run"),
                megabytes(needed)
            );
        }
        Ok((megabytes(needed), megabytes(free)))
    }
}

/// `, each in 3 tests`, if there are several.
fn in_tests(case: &Case) -> String {
    match case.tests.len() {
        1 => String::new(),
        tests => format!(", each in {tests} tests"),
    }
}

/// What the complete iterations of a calibration took, if there are any: a sample in all tests, of these names, is a run.
fn measured(out: &Path, tests: &[&str]) -> Result<Option<Measured>> {
    let mut measured = Measured::default();
    for i in 0.. {
        let folder = out.join(format!("iter{i}"));
        let Ok(begun) = fs::metadata(folder.join("samples.txt")).and_then(|file| file.modified()) else {
            break;
        };
        let runs = tests.iter().map(|test| fs::read_dir(folder.join(test).join("runs")));
        let Ok(runs) = runs.collect::<std::io::Result<Vec<_>>>() else { break };
        let mut last = begun;
        for entry in runs.into_iter().flatten() {
            let entry = entry?;
            let file = entry.metadata()?;
            measured.bytes += file.len();
            if entry.file_name().to_string_lossy().ends_with("_sim.txt") {
                measured.runs += 1;
                last = last.max(file.modified().unwrap_or(SystemTime::UNIX_EPOCH));
            }
        }
        measured.seconds += last.duration_since(begun).map_or(0.0, |time| time.as_secs_f64());
    }
    measured.runs /= tests.len() as u32;
    Ok((measured.runs > 0).then_some(measured))
}

/// A time for a reader.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1.0 => format!("{} ms", (1000.0 * s).ceil()),
        s if s < 100.0 => format!("{} s", s.ceil()),
        s if s < 6000.0 => format!("{} min", (s / 60.0).ceil()),
        s => format!("{} h", (s / 3600.0).ceil()),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn times_are_told_in_the_unit_that_fits() {
        let told = [0.0123, 59.2, 100.0, 5999.0, 7200.0].map(duration);
        assert_eq!(told, ["13 ms", "60 s", "2 min", "100 min", "2 h"]);
    }

    #[test]
    fn the_time_of_a_run_is_measured_from_its_samples_on() {
        let out = tempfile::tempdir().unwrap();
        assert_eq!(measured(out.path(), &[""]).unwrap(), None);
        let folder = out.path().join("iter0");
        fs::create_dir_all(folder.join("runs")).unwrap();
        let begun = SystemTime::UNIX_EPOCH;
        let write = |name: &str, seconds: u64| {
            fs::write(folder.join(name), "1234").unwrap();
            let file = fs::File::options().append(true).open(folder.join(name)).unwrap();
            file.set_modified(begun + std::time::Duration::from_secs(seconds)).unwrap();
        };
        write("samples.txt", 10);
        write("runs/a_sim.txt", 14);
        write("runs/a_param.txt", 13);
        write("runs/b_sim.txt", 16);
        let found = measured(out.path(), &[""]).unwrap().unwrap();
        assert_eq!(found, Measured { runs: 2, seconds: 6.0, bytes: 12 });
        // Each sample once more, in a test of its own.
        for test in ["one", "two"] {
            fs::create_dir_all(folder.join(test)).unwrap();
            fs::rename(folder.join("runs"), folder.join(test).join("runs")).unwrap();
            fs::create_dir_all(folder.join("runs")).unwrap();
            write("runs/a_sim.txt", 24);
            write("runs/b_sim.txt", 26);
        }
        let found = measured(out.path(), &["one", "two"]).unwrap().unwrap();
        assert_eq!(found, Measured { runs: 2, seconds: 16.0, bytes: 20 });
    }
}
