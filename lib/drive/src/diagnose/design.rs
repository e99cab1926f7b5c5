//! Runs in which every effect is on and off, and what they say of the gap.
//!
//! The design draws the base parameters from a box about what fits best in `base`. Where a hypothesis that is not ruled
//! out leans on the box, it is made wider on that side and further runs are made, twice at the most, beyond the prior,
//! too: a truth that the prior excludes would else be explained by whatever imitates it. The last runs are
//! made where the hypotheses that are not ruled out put the parameters, since there the emulator has to be right.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_gap::design_box::{with_beyond, within_runs};
use gl_inference::prior::{Parameter, Prior};
use gl_inference::samples::Samples;
use gl_table::Table;

use super::{Diagnosis, RUNS_WEIGHTS, WIDER_PRIOR, renew};
use crate::Progress;
use crate::calibrate::iteration::{collect, run};
use crate::columns::{list, measurement, runs_of_design};
use crate::step::{Call, Messages, Wanted, copy, is_current, join, make_folder, show, touch};

/// The box is made wider so often at the most.
const WIDEST: usize = 2;

impl Diagnosis<'_> {
    /// Run the design round by round, and attribute the gap by all of it.
    pub(super) fn attribute(&self) -> Result<Progress> {
        let attribution = self.file("attribution.txt");
        if is_current(&attribution, &[self.file("base/posterior.txt")])? {
            return Ok(Progress::Finished);
        }
        let (mut widened, mut is_pointed) = (0, false);
        for number in 0.. {
            let round = Round { diagnosis: self, number, folder: self.round(number) };
            if round.make()? == Progress::InQueue {
                return Ok(Progress::InQueue);
            }
            if widened < WIDEST && self.widen(&round.folder, number)? {
                widened += 1;
            } else if is_pointed {
                return self.conclude(&round.folder);
            } else {
                is_pointed = true;
                self.point(&round.folder, number + 1)?;
            }
        }
        unreachable!("rounds end by themselves")
    }

    /// The samples of the next round are those that this one asks for.
    fn point(&self, round: &Path, number: usize) -> Result<()> {
        let next = self.round(number);
        make_folder(&next)?;
        copy(&round.join("params.txt"), &next.join("params.txt"))?;
        let samples = next.join("samples.txt");
        copy(&round.join("next.txt"), &samples)?;
        if !is_current(&samples, &[next.join("params.txt")])? {
            touch(&samples)?;
        }
        Ok(())
    }

    fn round(&self, number: usize) -> PathBuf {
        self.file(&format!("design/round{number}"))
    }

    /// Make the box of the next round wider, where a hypothesis leans on it: whether one does.
    fn widen(&self, round: &Path, number: usize) -> Result<bool> {
        let wider = round.join("wider.txt");
        let call = Call::new("gl-box")
            .arg("widen")
            .flag("-p", self.case.params())
            .flag("--box", round.join("params.txt"))
            .arg("--beyond")
            .flag("-o", &wider)
            .arg(round.join("posterior.txt"));
        if self.runner.call(&call, Messages::Shown)? == 1 {
            return Ok(false);
        }
        gl_cli::note(
            "gl-diagnose",
            "a hypothesis leans on the box of the base parameters, which is made wider",
        );
        let next = self.round(number + 1);
        make_folder(&next)?;
        copy(&wider, &next.join("params.txt"))?;
        Ok(true)
    }

    /// What the last round says is the attribution; its words come last, so that they stand for all of it.
    fn conclude(&self, round: &Path) -> Result<Progress> {
        for table in ["samples", "ensemble", "status"] {
            copy(&round.join(format!("all-{table}.txt")), &self.file(&format!("design/{table}.txt")))?;
        }
        copy(&round.join("params.txt"), &self.file("design/params.txt"))?;
        for table in [
            "effects.txt",
            "predicted-shrink.txt",
            "posterior.txt",
            "rest.txt",
            "curves.txt",
            "attribution-verdict.txt",
            "attribution.log",
        ] {
            if round.join(table).exists() {
                copy(&round.join(table), &self.file(table))?;
            }
        }
        self.keep_wider_prior(&round.join("params.txt"))?;
        renew(&round.join("attribution.txt"), &self.file("attribution.txt"))?;
        show(&self.file("attribution.log"), 0);
        Ok(Progress::Finished)
    }
}

impl Diagnosis<'_> {
    /// `wider-params.txt`: the prior with its bounds where the design has gone beyond them; there only if it has, and the
    /// most probable explanation has a parameter there.
    fn keep_wider_prior(&self, design: &Path) -> Result<()> {
        let target = self.file(WIDER_PRIOR);
        let verdict = Table::read(&self.file("attribution-verdict.txt"))?;
        let code = verdict.format().column("code")?;
        let is_beyond = (0..verdict.len()).any(|row| verdict.field(row, code) == "beyond-prior");
        match with_beyond(&Prior::read(&self.case.params())?, &Prior::read(design)?)?.filter(|_| is_beyond) {
            Some(wider) => wider.write(Some(&target)),
            None => {
                let _ = std::fs::remove_file(target);
                Ok(())
            }
        }
    }
}

/// One round of a design.
struct Round<'a> {
    diagnosis: &'a Diagnosis<'a>,
    number: usize,
    folder: PathBuf,
}

impl Round<'_> {
    fn make(&self) -> Result<Progress> {
        self.narrow()?;
        self.sample()?;
        if !self.run()? {
            return Ok(Progress::InQueue);
        }
        self.gather()?;
        self.trim()?;
        self.attribute()?;
        Ok(Progress::Finished)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The first box; those of later rounds are there already.
    fn narrow(&self) -> Result<()> {
        let (target, weights) = (self.file("params.txt"), self.diagnosis.file("base").join(RUNS_WEIGHTS));
        let params = self.diagnosis.case.params();
        if self.number > 0 || is_current(&target, &[&params, &weights])? {
            return Ok(());
        }
        make_folder(&self.folder)?;
        let call = Call::new("gl-box").arg("narrow").flag("-p", params).flag("-o", &target).arg(weights);
        self.diagnosis.runner.must(&call, Messages::Shown)
    }

    /// Switch effects on and off all over the box: three fifths of the runs in the first round, half as many as there
    /// are in all in a round with a wider box. The samples of the last round are there already.
    fn sample(&self) -> Result<()> {
        let (target, params) = (self.file("samples.txt"), self.file("params.txt"));
        if is_current(&target, &[&params])? {
            return Ok(());
        }
        let all = self.diagnosis.runs()?;
        let case = self.diagnosis.case;
        let num = if self.number == 0 { all - last_runs(all) } else { all / 2 };
        let call = Call::new("gl-sample")
            .flag("-p", params)
            .option("-n", Some(num))
            .flag("--effects", "switch")
            .option("--threads", case.threads)
            .option("--seed", Some(case.seed + self.number as u64))
            .flag("--name", format!("{}-design", case.name))
            .option("--iteration", Some(self.number))
            .flag("-o", target);
        self.diagnosis.runner.must(&call, Messages::Shown)
    }

    fn run(&self) -> Result<bool> {
        let Diagnosis { case, engine, model, runner, wait, .. } = *self.diagnosis;
        let (samples, ensemble) = (self.file("samples.txt"), self.file("ensemble.txt"));
        if is_current(&ensemble, &[&samples, &case.tests[0].obs])? {
            return Ok(true);
        }
        if !run(runner, case, (engine, model), &samples, &self.file("runs"), wait)? {
            return Ok(false);
        }
        collect(runner, case, &case.tests[0], &self.folder, Messages::Shown)?;
        Ok(true)
    }

    /// The tables of all rounds so far, and of the runs of the base model that lie in the box: there every effect is off.
    fn gather(&self) -> Result<()> {
        let target = self.file("all-ensemble.txt");
        if is_current(&target, &self.tables("ensemble", true))? {
            return Ok(());
        }
        let wanted = self.in_box(&self.tables("samples", true))?;
        for (table, column) in [("samples", "description"), ("status", "sample"), ("ensemble", "sample")] {
            let wanted = Wanted { column, is_wanted: &|name| wanted.contains(name) };
            join(&self.tables(table, true), &self.file(&format!("all-{table}.txt")), Some(&wanted))?;
        }
        Ok(())
    }

    /// The tables of this name of the base calibration's iterations, and of the rounds so far.
    fn tables(&self, name: &str, with_rounds: bool) -> Vec<PathBuf> {
        let base = self.diagnosis.file("base");
        let iterations = (0..).map(|i| base.join(format!("iter{i}")));
        let iterations = iterations.take_while(|folder| folder.join("ensemble.txt").exists());
        let rounds = (0..=self.number).filter(|_| with_rounds).map(|r| self.diagnosis.round(r));
        iterations.chain(rounds).map(|folder| folder.join(format!("{name}.txt"))).collect()
    }

    /// Names of the samples of these tables that are of the design, or of the base model and in its box.
    fn in_box(&self, tables: &[PathBuf]) -> Result<BTreeSet<String>> {
        let own = Prior::read(&self.file("params.txt"))?;
        let design = self.diagnosis.file("design");
        let mut wanted = BTreeSet::new();
        for table in tables {
            let samples = Samples::read(table)?;
            let is_of_design = table.starts_with(&design);
            let values = samples.columns(&own.names())?;
            let is_in = |row: &Vec<f64>| {
                let inside = |(parameter, &value): (&Parameter, &f64)| {
                    parameter.effect.is_some() || (parameter.lower..=parameter.upper).contains(&value)
                };
                own.parameters().iter().zip(row).all(inside)
            };
            let names = samples.names.iter().zip(&values);
            wanted.extend(names.filter(|(_, row)| is_of_design || is_in(row)).map(|(name, _)| name.clone()));
        }
        Ok(wanted)
    }

    /// Beyond the prior the box ends where runs do.
    fn trim(&self) -> Result<()> {
        let (target, samples) = (self.file("params.txt"), self.file("samples.txt"));
        let own = Prior::read(&target)?;
        let prior = Prior::read(&self.diagnosis.case.params())?;
        let made = Samples::read(&samples)?;
        let status = Table::read(&self.file("status.txt"))?;
        let (name, outcome) = (status.format().column("sample")?, status.format().column("status")?);
        let is_done: BTreeSet<&str> = (0..status.len())
            .filter(|&row| status.field(row, outcome) == "ok")
            .map(|row| status.field(row, name))
            .collect();
        let values = made.columns(&own.names())?;
        let done: Vec<Vec<f64>> = made
            .names
            .iter()
            .zip(&values)
            .filter(|(name, _)| is_done.contains(name.as_str()))
            .map(|(_, values)| values.clone())
            .collect();
        let trimmed = within_runs(&prior, &own, &values, &done)?;
        if trimmed != own {
            gl_cli::note(
                "gl-diagnose",
                "most runs beyond a bound of the prior fail: the box ends where runs do",
            );
            trimmed.write(Some(&target))?;
            // The samples and runs are still those of this box.
            for file in [&samples, &self.file("ensemble.txt"), &self.file("all-ensemble.txt")] {
                touch(file)?;
            }
        }
        Ok(())
    }

    /// Which effect explains the gap, by all runs so far, and which runs would say more.
    fn attribute(&self) -> Result<()> {
        let (target, ensemble) = (self.file("attribution.txt"), self.file("all-ensemble.txt"));
        if is_current(&target, &[&ensemble])? {
            return Ok(());
        }
        let case = self.diagnosis.case;
        let call = Call::new("gl-gap-attribute").flag("-p", self.file("params.txt"));
        let call = call.flag("--prior", case.params());
        let call = measurement(call.flag("-s", self.file("all-samples.txt")), &case.tests[0])
            .option("--steps", case.tests[0].steps.as_ref())
            .option("--measurement", list(&case.measurement))
            .option("--max-effects", case.max_effects)
            .option("--scatter", case.scatter)
            .flag("--effects-out", self.file("effects.txt"))
            .flag("--predict-shrink", self.file("predicted-shrink.txt"))
            .flag("--posterior-out", self.file("posterior.txt"))
            .flag("--rest-out", self.file("rest.txt"))
            .flag("--curves-out", self.file("curves.txt"))
            .flag("--next-out", self.file("next.txt"))
            .option("--next", Some(last_runs(self.diagnosis.runs()?)))
            .flag("--name", format!("{}-design", case.name))
            .option("--iteration", Some(self.number + 1))
            .option("--threads", case.threads)
            .option("--seed", Some(case.seed))
            .verdict(&self.file("attribution-verdict.txt"))
            .flag("-o", &target)
            .arg(ensemble);
        self.diagnosis.runner.must(&call, Messages::Kept(&self.file("attribution.log")))
    }
}

impl Diagnosis<'_> {
    /// Runs of the design in all: where the case does not say, those of the base model that lie in the first box count
    /// for it, up to two fifths.
    fn runs(&self) -> Result<usize> {
        let all = runs_of_design(self.case, &Prior::read(&self.case.params())?);
        if self.case.design_num.is_some() {
            return Ok(all);
        }
        let first = Round { diagnosis: self, number: 0, folder: self.round(0) };
        let there = first.in_box(&first.tables("samples", false))?;
        Ok(all - there.len().min(all * 2 / 5))
    }
}

/// Of so many runs, those that are made where the first ones point.
fn last_runs(all: usize) -> usize {
    all * 2 / 5
}
