//! An iteration through an emulator: draws of the posterior, and the samples that would tell most.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gl_case::Posterior;
use gl_case::folders::CURVES;
use gl_table::verdict::Verdicts;

use super::iteration::Iteration;
use crate::calibrate::RUNS_WEIGHTS;
use crate::columns::{all_tests, of_test, runs_of_iteration, varied, weighed_runs};
use crate::step::{Call, Messages, copy, is_current};

/// Why an iteration and those after it are read from the weights of the runs, where they are.
const FALLBACK: &str = "fallback.txt";

/// Whether an iteration, by its folder, was left to the weights of the runs.
pub(crate) fn falls_back(iteration: &Path) -> bool {
    iteration.join(FALLBACK).exists()
}

impl Iteration<'_> {
    /// Whether the posterior is sampled through an emulator: the case says so, and no iteration before found that
    /// this does not do.
    pub(crate) fn is_drawn(&self) -> Result<bool> {
        let is_left = |i: usize| falls_back(&self.setting.folder(i));
        Ok(self.setting.case.posterior == Posterior::Emulator && !(0..self.number).any(is_left))
    }

    /// Runs of this iteration.
    pub(crate) fn runs(&self) -> usize {
        let (case, prior) = (self.setting.case, self.setting.prior);
        let is_left = (0..self.number).any(|i| falls_back(&self.setting.folder(i)));
        match case.num {
            None if is_left => weighed_runs(varied(prior, &case.effects)),
            // Runs that are there already stand for some of the first ones.
            None if self.number == 0 => {
                let known = self.setting.known.as_ref().map_or(0, |known| known.runs);
                runs_of_iteration(case, prior, 0).saturating_sub(known).max(runs_of_iteration(case, prior, 1))
            }
            _ => runs_of_iteration(case, prior, self.number),
        }
    }

    /// The first samples where an emulator of the runs that are there already asks for them: false if there are none, or
    /// too few for one.
    pub(crate) fn take_known(&self, samples: &Path) -> Result<bool> {
        let Some(known) = &self.setting.known else { return Ok(false) };
        let unused = self.file(".unused.txt");
        let call = self
            .posterior(std::slice::from_ref(&known.samples), self.runs(), 0)
            .flag("--next-out", samples)
            .flag("-o", &unused)
            .args(known.tables(self.setting.case));
        let is_made = self.setting.runner.attempt(&call, &self.file("known.log"))?;
        let _ = std::fs::remove_file(unused);
        Ok(is_made)
    }

    /// `gl-posterior` with these samples, which says what to run as iteration `next`.
    fn posterior(&self, samples: &[PathBuf], runs: usize, next: usize) -> Call {
        let case = self.setting.case;
        let call = Call::new("gl-posterior").flag("-p", case.params());
        let call = samples.iter().fold(call, |call, table| call.flag("-s", table));
        let call = if case.white { call.arg("--white") } else { call };
        all_tests(call, case)
            .file("--outliers", case.outliers.as_deref())
            .option("--scatter", case.scatter)
            .option("--seed", Some(case.seed + self.number as u64))
            .option("--next", Some(runs))
            .flag("--name", case.name_of_runs())
            .option("--iteration", Some(next))
            .option("--threads", case.threads)
    }

    /// Sample the posterior, and say what to run next: false where no emulator follows the simulator, so that the
    /// weights of the runs have to do.
    pub(crate) fn draw(&self) -> Result<bool> {
        let draws = self.file("posterior-weights.txt");
        let known = self.setting.known.as_ref();
        let mut samples: Vec<PathBuf> = known.iter().map(|known| known.samples.clone()).collect();
        samples.extend(self.files_so_far("samples.txt"));
        let mut ensembles: Vec<PathBuf> = known.iter().flat_map(|known| known.ensembles.clone()).collect();
        ensembles.extend(self.tables_of_tests("ensemble.txt"));
        let verdict = self.file("posterior-verdict.txt");
        if falls_back(&self.folder) && is_current(&self.file(FALLBACK), &ensembles)? {
            return Ok(false);
        }
        let mut inputs = self.setting.given();
        inputs.extend(ensembles.clone());
        if !is_current(&draws, &inputs)? {
            let _ = std::fs::remove_file(self.file(FALLBACK));
            let case = self.setting.case;
            let next = self.number + 1;
            let call = self
                .posterior(&samples, runs_of_iteration(case, self.setting.prior, next), next)
                .flag("--next-out", self.file("next.txt"))
                .flag("--summary", self.file("posterior.txt"))
                .flag("--run-weights", self.file(RUNS_WEIGHTS))
                .flag("--run-summary", self.file("posterior-runs.txt"))
                .flag("--loo-out", self.file("loo.txt"))
                .flag("--curves-out", self.file(CURVES))
                .flag("--verdict", &verdict)
                .flag("-o", &draws)
                .args(known.iter().flat_map(|known| known.tables(case)))
                .args(self.ensembles_of_tests());
            let log = self.file("emulator.log");
            let _ = std::fs::remove_file(&log);
            if !self.setting.runner.attempt(&call, &log)? {
                return self.fall_back("no emulator can be trained; emulator.log says why");
            }
        }
        let verdicts = Verdicts::read(&verdict)?;
        if let Some(alike) = verdicts.find("runs-alike") {
            bail!("{}: {}", self.folder.display(), alike.text);
        }
        if let Some(unfit) = verdicts.find("emulator-unfit") {
            return self.fall_back(&unfit.text);
        }
        copy(&self.file("posterior.txt"), &self.file("summary.txt"))?;
        Ok(true)
    }

    /// The runs so far, as gl-posterior takes them.
    fn ensembles_of_tests(&self) -> Vec<std::ffi::OsString> {
        let of = |test| {
            let file = move |i| self.setting.folder_of(i, test).join("ensemble.txt");
            (0..=self.number).map(move |i| of_test(test, &file(i)))
        };
        self.setting.case.tests.iter().flat_map(of).collect()
    }

    /// From here on the weights of the runs have to do.
    fn fall_back(&self, why: &str) -> Result<bool> {
        let all = if self.setting.case.outliers.is_some() { ", which take every reading" } else { "" };
        gl_cli::note("gl-calibrate", format_args!("{why}; from here on by the weights of the runs{all}"));
        for file in [RUNS_WEIGHTS, "posterior-runs.txt", "posterior-weights.txt", CURVES, "loo.txt"] {
            let _ = std::fs::remove_file(self.file(file));
        }
        gl_table::write_whole(&self.file(FALLBACK), format!("{why}\n").as_bytes())?;
        Ok(false)
    }

    /// The samples that the iteration before asked for.
    pub(crate) fn take_next(&self, previous: &Path) -> Result<()> {
        let (next, samples) = (previous.join("next.txt"), self.file("samples.txt"));
        if is_current(&samples, &[&previous.join("stop.code"), &next])? {
            return Ok(());
        }
        gl_table::write_whole(&samples, &std::fs::read(&next)?)
    }

    /// Batches that an emulator asked for were drawn from no density; weights take that of a mixture about the draws
    /// which they were chosen from.
    pub(crate) fn propose_backwards(&self) -> Result<()> {
        for i in 1..=self.number {
            let (folder, before) = (self.setting.folder(i), self.setting.folder(i - 1));
            let (proposal, draws) = (folder.join("proposal.txt"), before.join("posterior-weights.txt"));
            if proposal.exists() {
                continue;
            }
            let unused = folder.join(".unused.txt");
            let call = Call::new("gl-gmm-resample")
                .flag("-p", self.setting.case.params())
                .option("-n", Some(2))
                .flag("--sampling", "mixture")
                .flag("--proposal-out", &proposal)
                .flag("-o", &unused)
                .arg(&draws);
            self.setting.runner.must(&call, Messages::Kept(&folder.join("resample.log")))?;
            let _ = std::fs::remove_file(unused);
        }
        Ok(())
    }
}
