//! Runs in which effects are on and off, and what they say of the gap.
//!
//! The first round draws the base parameters from a box about what fits best in `base`, some from the whole prior, and of the
//! whole prior its runs are asked: an effect moves the base parameters that fit, out of the box, too. Where a hypothesis that is not ruled out
//! leans on the prior, the box goes beyond it on that side and further runs are made, twice at the most: a truth that the
//! prior excludes would else be explained by whatever imitates it. The rounds after that are
//! made where the hypotheses that are not ruled out put the parameters, since there the emulator has to be right; the
//! first of them that says what the one before did is the last, and so is the third that says as much of the same. Where `design_num` is absent, a design that would end with effects
//! of which too little is known goes on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_case::folders::BASE;
use gl_case::{Test, Winner};
use gl_gap::attribute::rounds::{Course, Rounds, Standing, Step};
use gl_gap::design_box::{reaching, with_beyond, within_runs};
use gl_inference::collect::RunStatus;
use gl_inference::design::least_switched;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::path::short;
use gl_inference::prior::{Parameter, Prior};
use gl_inference::rig::Rig;
use gl_inference::samples::Samples;
use gl_table::Table;
use gl_table::verdict::Verdicts;

use super::{Diagnosis, FORETOLD, NOISE, OUTLIERS, RIG, WIDER_PRIOR, renew};
use crate::Progress;
use crate::calibrate::RUNS_WEIGHTS;
use crate::calibrate::emulated::of_test_or_none;
use crate::calibrate::iteration::{Before, collect, give, in_each_test, run};
use crate::columns::{Which, list, measured, of_test, runs_of_design, units, within};
use crate::step::{Call, Messages, Wanted, copy, is_current, join, make_folder, show, touch};

/// What the runs of a round are asked of: the prior, with the bounds of the box where it lies beyond them.
const PRIOR: &str = "prior.txt";

/// The same, wider, where a hypothesis leans on it.
const WIDER: &str = "wider.txt";

/// One in so many runs of the first round is drawn from the whole prior, where those are enough for all effects.
const WIDE: usize = 3;

impl Diagnosis<'_> {
    /// Run the design round by round, and attribute the gap by all of it.
    pub(super) fn attribute(&self) -> Result<Progress> {
        let attribution = self.file("attribution.txt");
        if is_current(&attribution, &[self.file("base/posterior.txt")])? {
            return Ok(Progress::Finished);
        }
        // By a `design_num` that is larger than it was, a design that had ended goes on.
        let mut course = Course::new(self.rounds()?, self.case.design_num);
        let mut number = 0;
        loop {
            let round = Round { diagnosis: self, number, folder: self.round(number) };
            if round.make()? == Progress::InQueue {
                return Ok(Progress::InQueue);
            }
            course.made(round.len()?);
            round.attribute(course.pointed())?;
            let standing = round.standing()?;
            gl_cli::note("gl-diagnose", format!("design: {}", round.told(&standing)?));
            let leans = course.may_widen() && self.leans(&round.folder)?;
            match course.next(standing, leans) {
                Step::End => {
                    if course.unused() > 0 {
                        gl_cli::note(
                            "gl-diagnose",
                            format!(
                                "design: two rounds say the same, which ends it; {} of the runs that design_num allows are not needed",
                                course.unused()
                            ),
                        );
                    }
                    return self.conclude(&round.folder);
                }
                Step::Widen => {
                    let [own, next] = [PRIOR, WIDER].map(|of| Prior::read(&round.file(of)));
                    gl_cli::note(
                        "gl-diagnose",
                        format!(
                            "a hypothesis leans on the prior, which runs go beyond: {}",
                            moved(&own?, &next?)
                        ),
                    );
                    self.widen(&round.folder, number + 1)?;
                }
                step => {
                    if step == Step::Further {
                        gl_cli::note(
                            "gl-diagnose",
                            "too little is known of some effects to rule them out: further runs are made there",
                        );
                    }
                    self.point(&round.folder, number + 1)?;
                }
            }
            number += 1;
        }
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

    /// The box of the next round is that of this one, as far out as the wider prior goes. Where it has samples it stays.
    fn widen(&self, round: &Path, number: usize) -> Result<()> {
        let next = self.round(number);
        if next.join("samples.txt").exists() {
            return Ok(());
        }
        make_folder(&next)?;
        let [prior, own, wider] = [self.case.params(), round.join("params.txt"), round.join(WIDER)]
            .map(|table| Prior::read(&table));
        reaching(&own?, &prior?, &wider?)?.write(Some(&next.join("params.txt")))
    }

    /// Whether a hypothesis leans on the prior of a round; the wider one is beside it then.
    fn leans(&self, round: &Path) -> Result<bool> {
        let call = Call::new("gl-box")
            .arg("widen")
            .flag("-p", self.case.params())
            .flag("--box", round.join(PRIOR))
            .arg("--beyond")
            .flag("-o", round.join(WIDER))
            .arg(round.join("posterior.txt"));
        Ok(self.runner.call(&call, Messages::Shown)? != 1)
    }

    /// What the last round says is the attribution; its words come last, so that they stand for all of it.
    fn conclude(&self, round: &Path) -> Result<Progress> {
        let design = self.file("design");
        copy(&round.join("all-samples.txt"), &design.join("samples.txt"))?;
        for test in &self.case.tests {
            let own = within(&design, test);
            make_folder(&own)?;
            copy(&within(round, test).join("all-status.txt"), &own.join("status.txt"))?;
            let ensemble = of_test_or_none("ensemble", test, "");
            copy(&round.join(format!("all-{ensemble}")), &design.join(ensemble))?;
        }
        copy(&round.join(PRIOR), &self.file("design/params.txt"))?;
        for table in [
            "effects.txt",
            FORETOLD,
            "posterior.txt",
            "rest.txt",
            RIG,
            OUTLIERS,
            NOISE,
            "curves.txt",
            "attribution-verdict.txt",
            "attribution.log",
        ] {
            if round.join(table).exists() {
                copy(&round.join(table), &self.file(table))?;
            }
        }
        self.keep_wider_prior(&round.join(PRIOR))?;
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
        let verdict = Verdicts::read(&self.file("attribution-verdict.txt"))?;
        let is_beyond = verdict.find("beyond-prior").is_some();
        match with_beyond(&Prior::read(&self.case.params())?, &Prior::read(design)?)?.filter(|_| is_beyond) {
            Some(wider) => wider.write(Some(&target)),
            None => {
                let _ = std::fs::remove_file(target);
                Ok(())
            }
        }
    }
}

/// The bounds of one box that are others in the next, with what they were.
fn moved(own: &Prior, next: &Prior) -> String {
    let bounds = own.parameters().iter().zip(next.parameters()).flat_map(|(own, next)| {
        [(&next.name, "from", own.lower, next.lower), (&next.name, "to", own.upper, next.upper)]
    });
    let told = bounds.filter(|(.., before, after)| before != after).map(|(name, side, before, after)| {
        format!("{name} {side} {} (it was {})", short(after), short(before))
    });
    told.collect::<Vec<_>>().join(", ")
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
        Ok(Progress::Finished)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Number of its runs.
    fn len(&self) -> Result<usize> {
        Ok(Samples::read(&self.file("samples.txt"))?.len())
    }

    /// Number of runs of the next round, if that is made already; runs that are made stay as
    /// they are where a design grows.
    fn made_next(&self) -> Result<Option<usize>> {
        let there = self.diagnosis.round(self.number + 1).join("samples.txt");
        there.exists().then(|| Ok(Samples::read(&there)?.len())).transpose()
    }

    /// What its runs are asked of: the prior, with the bounds of the box where it lies beyond them.
    fn prior(&self) -> Result<Prior> {
        let prior = Prior::read(&self.diagnosis.case.params())?;
        Ok(with_beyond(&prior, &Prior::read(&self.file("params.txt"))?)?.unwrap_or(prior))
    }

    /// What it says.
    fn standing(&self) -> Result<Standing> {
        let [attribution, verdict] =
            ["attribution.txt", "attribution-verdict.txt"].map(|name| self.file(name));
        Standing::of_tables(&Table::read(&attribution)?, &Table::read(&verdict)?)
    }

    /// The same for a reader, with the number of runs so far.
    fn told(&self, standing: &Standing) -> Result<String> {
        let runs = Samples::read(&self.file("all-samples.txt"))?.len();
        Ok(format!("{runs} runs, {} comes first, probability {:.2}", standing.cause, standing.probability))
    }

    /// The first box; those of later rounds are there already.
    fn narrow(&self) -> Result<()> {
        let (target, weights) = (self.file("params.txt"), self.diagnosis.file(BASE).join(RUNS_WEIGHTS));
        let params = self.diagnosis.case.params();
        if self.number > 0 || is_current(&target, &[&params, &weights])? {
            return Ok(());
        }
        make_folder(&self.folder)?;
        let call = Call::new("gl-box").arg("narrow").flag("-p", params).flag("-o", &target).arg(weights);
        self.diagnosis.runner.must(&call, Messages::Shown)
    }

    /// Switch effects on and off all over the box, and in some runs all over the prior. The samples of a round that the one before pointed to are there
    /// already.
    fn sample(&self) -> Result<()> {
        let (target, params) = (self.file("samples.txt"), self.file("params.txt"));
        if is_current(&target, &[&params])? {
            return Ok(());
        }
        let case = self.diagnosis.case;
        let rounds = self.diagnosis.rounds()?;
        let num = if self.number == 0 {
            rounds.first() - self.diagnosis.known_runs(rounds)?
        } else {
            rounds.wider()
        };
        let effects = Prior::read(&params)?.effects();
        let least = least_switched(effects.len());
        let num = num.max(least);
        let draw = |from: &Path, num: usize, name: &str, to: &Path| {
            let call = Call::new("gl-sample")
                .flag("-p", from)
                .option("-n", Some(num))
                // All candidates may be errors of the rig.
                .option("--effects", Some("pairs").filter(|_| !effects.is_empty()))
                .option("--threads", case.threads)
                .option("--seed", Some(case.seed + self.number as u64))
                .flag("--name", format!("{}-{name}", case.name))
                .option("--iteration", Some(self.number))
                .flag("-o", to);
            self.diagnosis.runner.must(&call, Messages::Shown)
        };
        let far = num / WIDE;
        if self.number > 0 || far < least {
            return draw(&params, num, "design", &target);
        }
        let parts = ["near.txt", "far.txt"].map(|part| self.file(part));
        draw(&params, num - far, "design", &parts[0])?;
        draw(&case.params(), far, "wide", &parts[1])?;
        join(&parts, &target, None)
    }

    fn run(&self) -> Result<bool> {
        let Diagnosis { case, engine, wait, .. } = *self.diagnosis;
        case.tests.iter().try_for_each(|test| self.give(test))?;
        in_each_test(case, Some(engine), wait, |test| self.run_test(test))
    }

    /// The samples of a test that has a name: those of the round, with what is given of the test.
    fn give(&self, test: &Test) -> Result<()> {
        let Diagnosis { case, engine, .. } = *self.diagnosis;
        let folder = within(&self.folder, test);
        let (all, samples) = (self.file("samples.txt"), folder.join("samples.txt"));
        if test.name.is_empty() || is_current(&samples, &[&all, &case.file()])? {
            return Ok(());
        }
        make_folder(&folder)?;
        give(&all, test, Some(engine), case.threads, &samples)
    }

    /// Run the samples in a test and collect the runs: false where they are in a queue.
    fn run_test(&self, test: &Test) -> Result<bool> {
        let Diagnosis { case, engine, model, runner, wait, .. } = *self.diagnosis;
        let folder = within(&self.folder, test);
        let (samples, ensemble) = (folder.join("samples.txt"), folder.join("ensemble.txt"));
        let own = if test.name.is_empty() { model.to_owned() } else { case.model_of(test, engine)? };
        if is_current(&ensemble, &[&samples, &test.obs])? {
            return Ok(true);
        }
        if !run(runner, case, (engine, &own), &samples, &folder.join("runs"), wait)? {
            return Ok(false);
        }
        let earlier: Vec<PathBuf> =
            (0..self.number).map(|number| within(&self.diagnosis.round(number), test)).collect();
        let before = Before { folders: &earlier, known: 0 };
        collect(runner, case, test, &folder, &before, Messages::Shown)?;
        Ok(true)
    }

    /// The tables of all rounds so far, and of the runs of the base model: there every effect is off.
    fn gather(&self) -> Result<()> {
        let tests = &self.diagnosis.case.tests;
        let folders = self.folders(true);
        let of = |test: Option<&Test>, table: &str| -> Vec<PathBuf> {
            let own = |folder: &PathBuf| test.map_or(folder.clone(), |test| within(folder, test));
            folders.iter().map(|folder| own(folder).join(table)).collect()
        };
        let mut is_done = true;
        for test in tests {
            is_done &= is_current(&self.all_of(test), &of(Some(test), "ensemble.txt"))?;
        }
        if is_done {
            return Ok(());
        }
        let wanted = self.within(&self.prior()?, &folders)?;
        let put = |tables: &[PathBuf], column: &'static str, to: &Path| {
            let wanted = Wanted { column, is_wanted: &|name| wanted.contains(name) };
            join(tables, to, Some(&wanted))
        };
        put(&of(None, "samples.txt"), "description", &self.file("all-samples.txt"))?;
        for test in tests {
            let status = within(&self.folder, test).join("all-status.txt");
            put(&of(Some(test), "status.txt"), "sample", &status)?;
        }
        tests.iter().try_for_each(|test| put(&of(Some(test), "ensemble.txt"), "sample", &self.all_of(test)))
    }

    /// All runs of a test so far.
    fn all_of(&self, test: &Test) -> PathBuf {
        self.file(&format!("all-{}", of_test_or_none("ensemble", test, "")))
    }

    /// The folders of the base calibration's iterations, and of the rounds so far.
    fn folders(&self, with_rounds: bool) -> Vec<PathBuf> {
        let (base, tests) = (self.diagnosis.file(BASE), &self.diagnosis.case.tests);
        let is_done =
            |folder: &PathBuf| tests.iter().all(|test| within(folder, test).join("ensemble.txt").exists());
        let iterations = (0..).map(|i| base.join(format!("iter{i}"))).take_while(is_done);
        let rounds = (0..=self.number).filter(|_| with_rounds).map(|r| self.diagnosis.round(r));
        iterations.chain(rounds).collect()
    }

    /// Names of the samples in these folders that are of the design, or of the base model and within these bounds.
    fn within(&self, own: &Prior, folders: &[PathBuf]) -> Result<BTreeSet<String>> {
        let design = self.diagnosis.file("design");
        let mut wanted = BTreeSet::new();
        for folder in folders {
            let samples = Samples::read(&folder.join("samples.txt"))?;
            let is_of_design = folder.starts_with(&design);
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
        let failed = self.failed()?;
        let values = made.columns(&own.names())?;
        let done: Vec<Vec<f64>> = made
            .names
            .iter()
            .zip(&values)
            .filter(|(name, _)| !failed.contains(*name))
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
            touch(&samples)?;
            for test in &self.diagnosis.case.tests {
                let own = within(&self.folder, test);
                touch(&own.join("samples.txt"))?;
                touch(&own.join("ensemble.txt"))?;
                touch(&self.all_of(test))?;
            }
        }
        Ok(())
    }

    /// Names of the samples of this round that failed in a test.
    fn failed(&self) -> Result<BTreeSet<String>> {
        let mut failed = BTreeSet::new();
        for test in &self.diagnosis.case.tests {
            let rows = RunStatus::failed(&within(&self.folder, test).join("status.txt"))?;
            failed.extend(rows.into_iter().map(|row| row.sample));
        }
        Ok(failed)
    }

    /// Which effect explains the gap, by all runs so far, and which runs would say more: so many, unless they are made.
    fn attribute(&self, next: usize) -> Result<()> {
        let target = self.file("attribution.txt");
        let case = self.diagnosis.case;
        let all: Vec<PathBuf> = case.tests.iter().map(|test| self.all_of(test)).collect();
        if is_current(&target, &all)? {
            return Ok(());
        }
        let prior = self.file(PRIOR);
        self.prior()?.write(Some(&prior))?;
        let call = Call::new("gl-gap-attribute").flag("-p", prior).flag("--prior", case.params());
        let call = measured(call.flag("-s", self.file("all-samples.txt")), case, Which::Compared)
            .option("--measurement", list(&case.measurement))
            .option("--max-effects", case.max_effects)
            .option("--scatter", case.scatter)
            .option("--units", units(case))
            .flag("--effects-out", self.file("effects.txt"))
            .flag("--predict-shrink", self.file(FORETOLD))
            .flag("--posterior-out", self.file("posterior.txt"))
            .flag("--rest-out", self.file("rest.txt"))
            .flag("--rig-out", self.file(RIG))
            .flag("--outliers-out", self.file(OUTLIERS))
            .flag("--noise-out", self.file(NOISE))
            .flag("--curves-out", self.file("curves.txt"))
            .flag("--next-out", self.file("next.txt"))
            .option("--next", Some(self.made_next()?.unwrap_or(next)))
            .flag("--name", format!("{}-design", case.name))
            .option("--iteration", Some(self.number + 1))
            .option("--threads", case.threads)
            .option("--seed", Some(case.seed))
            .verdict(&self.file("attribution-verdict.txt"))
            .flag("-o", &target)
            .args(case.tests.iter().zip(&all).map(|(test, all)| of_test(test, all)));
        self.diagnosis.runner.must(&call, Messages::Kept(&self.file("attribution.log")))
    }
}

impl Diagnosis<'_> {
    /// How many runs the rounds have.
    fn rounds(&self) -> Result<Rounds> {
        Ok(Rounds { all: runs_of_design(self.case, &Prior::read(&self.case.params())?) })
    }

    /// Runs of the base model that stand for some of the first round, where the case does not say how many there are:
    /// those that lie in its box, up to two fifths of it.
    fn known_runs(&self, rounds: Rounds) -> Result<usize> {
        if self.case.design_num.is_some() {
            return Ok(0);
        }
        let first = Round { diagnosis: self, number: 0, folder: self.round(0) };
        let there = first.within(&Prior::read(&first.file("params.txt"))?, &first.folders(false))?;
        Ok(there.len().min(rounds.first() * 2 / 5))
    }

    /// The runs of the design in which the effects of a winner are on and no others, within a prior, as its rig would have
    /// recorded them, as `samples.txt` and the ensemble of each test in a folder: those belong to the calibration with it, too.
    pub(super) fn runs_with(&self, winner: &Winner, prior: &Prior, folder: &Path) -> Result<()> {
        let design = self.file("design");
        let (all, target) = (design.join("samples.txt"), folder.join("samples.txt"));
        if is_current(&target, &[&all, &self.file(Winner::FILE)])? {
            return Ok(());
        }
        make_folder(folder)?;
        let samples = Samples::read(&all)?;
        let values = samples.columns(&prior.names())?;
        let is_of = |(parameter, &value): (&Parameter, &f64)| match &parameter.effect {
            Some(effect) if !winner.effects.contains(effect) => parameter.off == Some(value),
            _ => (parameter.lower..=parameter.upper).contains(&value),
        };
        let names = samples.names.iter().zip(&values);
        let wanted: BTreeSet<&str> = names
            .filter(|(_, row)| prior.parameters().iter().zip(*row).all(is_of))
            .map(|(name, _)| name.as_str())
            .collect();
        let put = |name: &str, column| {
            let wanted = Wanted { column, is_wanted: &|name| wanted.contains(name) };
            join(&[design.join(name)], &folder.join(name), Some(&wanted))
        };
        for test in &self.case.tests {
            let ensemble = of_test_or_none("ensemble", test, "");
            put(&ensemble, "sample")?;
            record(test, winner, &folder.join(ensemble))?;
        }
        put("samples.txt", "description")
    }
}

/// The runs of a test as the rig of a winner would have recorded them, in the place of those in a table.
fn record(test: &Test, winner: &Winner, table: &Path) -> Result<()> {
    let mut rig = Rig::default();
    for (error, size) in winner.rig.iter() {
        rig.add_if_of(&test.name, error, size)?;
    }
    if rig.is_empty() {
        return Ok(());
    }
    let observations = Observations::read(&test.obs, &test.control.measured, &test.observable_names())?;
    let runs = Ensemble::read(table, &test.control.measured, &test.observable_names())?;
    let recorded = rig.at(&observations)?.recorded_runs(&observations, &runs);
    let mut writer = recorded.begin(Some(table))?;
    recorded.write_rows(&mut writer)?;
    writer.finish()
}
