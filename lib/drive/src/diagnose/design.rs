//! Runs in which every effect is on and off, and what they say of the gap.
//!
//! The design draws the base parameters from a box about what fits best in `base`. Where a hypothesis that is not ruled
//! out leans on the box, it is made wider on that side and further runs are made, twice at the most. The last runs are
//! made where the hypotheses that are not ruled out put the parameters, since there the emulator has to be right.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_inference::prior::Prior;

use super::{Diagnosis, renew};
use crate::Progress;
use crate::calibrate::iteration::{collect, run};
use crate::columns::{list, measurement, runs_of_design};
use crate::step::{Call, Messages, copy, is_current, join, make_folder, show, touch};

/// The box is made wider so often at the most.
const WIDEST: usize = 2;

impl Diagnosis<'_> {
    /// Run the design round by round, and attribute the gap by all of it.
    pub(super) fn attribute(&self) -> Result<Progress> {
        let attribution = self.file("attribution.txt");
        if is_current(&attribution, &[self.file("base/posterior.txt")])? {
            return Ok(Progress::Finished);
        }
        let (mut number, mut is_last) = (0, false);
        loop {
            let round = Round { diagnosis: self, number, folder: self.round(number) };
            if round.make()? == Progress::InQueue {
                return Ok(Progress::InQueue);
            }
            if is_last {
                return self.conclude(&round.folder);
            }
            is_last = !(number < WIDEST && self.widen(&round.folder, number)?);
            if is_last {
                let next = self.round(number + 1);
                make_folder(&next)?;
                copy(&round.folder.join("params.txt"), &next.join("params.txt"))?;
                let samples = next.join("samples.txt");
                copy(&round.folder.join("next.txt"), &samples)?;
                if !is_current(&samples, &[next.join("params.txt")])? {
                    touch(&samples)?;
                }
            }
            number += 1;
        }
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
            "attribution-verdict.txt",
            "attribution.log",
        ] {
            if round.join(table).exists() {
                copy(&round.join(table), &self.file(table))?;
            }
        }
        renew(&round.join("attribution.txt"), &self.file("attribution.txt"))?;
        show(&self.file("attribution.log"), 0);
        Ok(Progress::Finished)
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
        self.attribute()?;
        Ok(Progress::Finished)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The first box; those of later rounds are there already.
    fn narrow(&self) -> Result<()> {
        let (target, weights) = (self.file("params.txt"), self.diagnosis.file("base/posterior-weights.txt"));
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
        collect(runner, case, &self.folder, Messages::Shown)?;
        Ok(true)
    }

    /// The tables of all rounds so far.
    fn gather(&self) -> Result<()> {
        let of_all = |name: &str| -> Vec<PathBuf> {
            (0..=self.number).map(|r| self.diagnosis.round(r).join(name)).collect()
        };
        let target = self.file("all-ensemble.txt");
        if is_current(&target, &of_all("ensemble.txt"))? {
            return Ok(());
        }
        for table in ["samples", "status", "ensemble"] {
            join(&of_all(&format!("{table}.txt")), &self.file(&format!("all-{table}.txt")), None)?;
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
        let call = measurement(call.flag("-s", self.file("all-samples.txt")), &case.tests[0])
            .option("--steps", case.tests[0].steps.as_ref())
            .option("--measurement", list(&case.measurement))
            .option("--max-effects", case.max_effects)
            .option("--scatter", case.scatter)
            .flag("--effects-out", self.file("effects.txt"))
            .flag("--predict-shrink", self.file("predicted-shrink.txt"))
            .flag("--posterior-out", self.file("posterior.txt"))
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
    /// Runs of the design in all.
    fn runs(&self) -> Result<usize> {
        Ok(runs_of_design(self.case, &Prior::read(&self.case.params())?))
    }
}

/// Of so many runs, those that are made where the first ones point.
fn last_runs(all: usize) -> usize {
    all * 2 / 5
}
