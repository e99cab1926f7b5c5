//! Emulated samples between two iterations, so that the next real ones are drawn from many that are nearly right and
//! not from the few that have run.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gl_case::Test;
use gl_inference::summary::Summary;
use gl_inference::weights::Weights;

use super::iteration::Setting;
use crate::columns::{comparison, varied_in};
use crate::step::{Call, Messages, Wanted, is_current, join, make_folder};
use crate::words::known;

/// Rounds at the most; each is drawn where the rounds before say.
const ROUNDS: usize = 6;

/// The emulator learns from so many runs a parameter that fit best.
const RUNS_A_PARAMETER: usize = 25;

/// The weights to draw the samples after iteration `last` by: `emulated-weights.txt` of its folder. Where the
/// emulator can say less than the runs themselves, these keep their weights.
pub(crate) fn weights(setting: &Setting<'_>, last: usize) -> Result<PathBuf> {
    let here = setting.out.join(format!("iter{last}"));
    let target = here.join("emulated-weights.txt");
    if is_current(&target, &[here.join("stop.code")])? {
        return Ok(target);
    }
    let part = here.join(".emulated.part");
    remove(&part)?;
    make_folder(&part)?;
    let log = here.join("emulated.log");
    gl_table::remove(&log)?;
    let emulation = Emulation { setting, here: &here, part: &part, log: &log, last };
    let (chosen, why) = emulation.run()?;
    note(&log, &why)?;
    let weights = fs::read(&chosen).with_context(|| format!("{}: cannot be read", chosen.display()))?;
    // The weights come last, so that nothing is left behind them.
    remove(&part)?;
    gl_table::write_whole(&target, &weights)?;
    Ok(target)
}

struct Emulation<'a> {
    setting: &'a Setting<'a>,
    here: &'a Path,
    part: &'a Path,
    log: &'a Path,
    last: usize,
}

impl Emulation<'_> {
    /// The weights to draw by, and why.
    fn run(&self) -> Result<(PathBuf, String)> {
        self.gather()?;
        let real = Summary::read(&self.here.join("summary.txt"))?;
        let noise = known(Summary::read(&self.here.join("posterior.txt"))?.sigma_noise);
        let own = self.here.join("weights.txt");
        let wanted = self.setting.case.emulated / 3;
        let mut weights = own.clone();
        let tests = &self.setting.case.tests;
        let (mut drawn, mut misfits) = (Vec::new(), Vec::<Vec<PathBuf>>::new());
        let mut summary = Summary::default();
        for round in 1..=ROUNDS {
            let samples = self.part.join(format!("samples{round}.txt"));
            let proposal = self.part.join(format!("proposal{round}.txt"));
            let of_round: Vec<PathBuf> = tests
                .iter()
                .map(|test| self.part.join(of_test_or_none("misfit", test, &round.to_string())))
                .collect();
            if !self.emulate(round, &weights, (&samples, &proposal), (&of_round, noise))? {
                return Ok((own, "no emulator, so the runs keep their weights".to_owned()));
            }
            drawn.push((samples, proposal));
            misfits.push(of_round);
            weights = self.part.join(format!("weights{round}.txt"));
            // Test by test, each with all rounds.
            let by_test: Vec<PathBuf> = (0..tests.len())
                .flat_map(|t| misfits.iter().map(move |of: &Vec<PathBuf>| of[t].clone()))
                .collect();
            summary = self.weigh(&drawn, &by_test, wanted, &weights)?;
            // At the lowest sigma that the emulator allows, more are effective than were asked for.
            if known(summary.ess_runs) > 1.001 * wanted as f64 {
                break;
            }
        }
        let sigma = known(summary.sigma);
        if sigma <= 4.0 * known(real.sigma) / noise {
            return Ok((weights, format!("sigma {sigma}, where the noise is 1")));
        }
        Ok((
            own,
            format!("sigma {sigma}, where the noise is 1: the runs say more, so they keep their weights"),
        ))
    }

    /// All samples, and the runs that fit best.
    fn gather(&self) -> Result<()> {
        let of_all = |name: &str| -> Vec<PathBuf> {
            (0..=self.last).map(|i| self.setting.out.join(format!("iter{i}")).join(name)).collect()
        };
        let samples = self.part.join("samples.txt");
        join(&of_all("samples.txt"), &samples, None)?;
        let (_, parameters) = varied_in(&samples)?;
        let weights = Weights::read(&self.here.join("weights.txt"))?;
        let misfit = weights.misfit.context("weights without misfits")?;
        let mut order: Vec<usize> = (0..misfit.len()).collect();
        order.sort_by(|&a, &b| {
            misfit[a].total_cmp(&misfit[b]).then_with(|| weights.samples[a].cmp(&weights.samples[b]))
        });
        order.truncate(RUNS_A_PARAMETER * parameters.max(2));
        let best: HashSet<&str> = order.iter().map(|&i| weights.samples[i].as_str()).collect();
        let wanted = Wanted { column: "sample", is_wanted: &|name| best.contains(name) };
        for test in &self.setting.case.tests {
            let of_test: Vec<PathBuf> =
                (0..=self.last).map(|i| self.setting.folder_of(i, test).join("ensemble.txt")).collect();
            join(&of_test, &self.part.join(of_test_or_none("ensemble", test, "")), Some(&wanted))?;
        }
        Ok(())
    }

    /// Draw samples by some weights and compare them, emulated, with the measurement: false if nothing can be
    /// emulated.
    fn emulate(
        &self,
        round: usize,
        weights: &Path,
        (samples, proposal): (&Path, &Path),
        (misfits, noise): (&[PathBuf], f64),
    ) -> Result<bool> {
        let case = self.setting.case;
        let seed = 1000 * (case.seed + self.last as u64 + 1) + round as u64;
        let call = Call::new("gl-gmm-resample")
            .flag("-p", case.params())
            .option("-n", Some(case.emulated))
            .flag("--sampling", "mixture")
            .option("--seed", Some(seed))
            .flag("--name", "emulated")
            .option("--iteration", Some(round))
            .flag("--proposal-out", proposal)
            .flag("-o", samples)
            .arg(weights);
        self.must(&call)?;
        for (test, misfit) in case.tests.iter().zip(misfits) {
            let emulated = self.part.join("emulated.txt");
            let call = Call::new("gl-emulate")
                .flag("-p", case.params())
                .flag("-s", self.part.join("samples.txt"))
                .flag("--at", samples)
                .flag("--scatter", "0")
                .arg(self.part.join(of_test_or_none("ensemble", test, "")))
                .flag("-o", &emulated);
            if !self.setting.runner.attempt(&call, self.log)? {
                return Ok(false);
            }
            let call = comparison(Call::new("gl-likelihood"), test)
                .option("--sigma", Some(noise))
                .arg("--total")
                .arg(&emulated)
                .flag("-o", misfit);
            self.must(&call)?;
        }
        Ok(true)
    }

    /// Weigh all emulated samples so far.
    fn weigh(
        &self,
        drawn: &[(PathBuf, PathBuf)],
        misfits: &[PathBuf],
        wanted: usize,
        weights: &Path,
    ) -> Result<Summary> {
        let summary = self.part.join("summary.txt");
        let mut call = Call::new("gl-filter").flag("-p", self.setting.case.params());
        for (samples, proposal) in drawn {
            call = call.flag("-s", samples).flag("--proposal", proposal);
        }
        let call = call
            .option("--ess-runs", Some(wanted))
            .flag("--sigma-min", "noise")
            .flag("--summary", &summary)
            .flag("-o", weights)
            .args(misfits);
        self.must(&call)?;
        Summary::read(&summary)
    }

    fn must(&self, call: &Call) -> Result<()> {
        self.setting.runner.must(call, Messages::Added(self.log))
    }
}

/// The name of a table, with that of its test where it has one.
pub(crate) fn of_test_or_none(table: &str, test: &Test, number: &str) -> String {
    if test.name.is_empty() {
        format!("{table}{number}.txt")
    } else {
        format!("{table}{number}-{}.txt", test.name)
    }
}

fn remove(folder: &Path) -> Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", folder.display()))
        }
        _ => Ok(()),
    }
}

/// Add a line to the log.
fn note(log: &Path, line: &str) -> Result<()> {
    use std::io::Write;
    let file = fs::File::options().create(true).append(true).open(log);
    file.and_then(|mut file| writeln!(file, "gl-calibrate: {line}"))
        .with_context(|| format!("{}: cannot be written", log.display()))
}
