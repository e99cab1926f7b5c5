//! The steps of a diagnosis: calibrate the base model, locate the gap, find its cause, calibrate again with the
//! cause in, and see how far the gap closes.

mod design;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use gl_case::{Case, Engine, Posterior};
use gl_gap::attribute::winner::winning_effects;
use gl_inference::prior::Prior;
use gl_table::{Table, TableWriter};

use crate::Progress;
use crate::arguments::Request;
use crate::calibrate::alone;
use crate::check;
use crate::columns::measurement;
use crate::step::{Call, Messages, Runner, is_current, put, show, touch, write};

/// What all steps of a diagnosis have in common.
pub(crate) struct Diagnosis<'a> {
    pub(crate) case: &'a Case,
    pub(crate) engine: Engine,
    pub(crate) model: &'a str,
    pub(crate) request: &'a Request,
    pub(crate) wait: bool,
    pub(crate) runner: &'a Runner,
    pub(crate) out: &'a Path,
    pub(crate) settings: PathBuf,
}

/// Diagnose a case. The folder gets `base`, `locate.txt`, `design`, `attribution.txt`, `after-EFFECT`, `shrink.txt`
/// and a report.
///
/// # Errors
/// If the case is wrong, or a step fails.
pub fn diagnose(request: &Request, wait: bool) -> Result<Progress> {
    let case = request.load()?;
    ensure!(
        !case.has_tests(),
        "{}: a diagnosis takes one measurement, and this case has [[test]]; gl-calibrate takes all tests, gl-gap-locate \
         says where they miss, and a case of each test by itself can be diagnosed",
        case.places.of_setting("test")
    );
    let (engine, model) = case.engine(request.engine)?;
    let out = request.folder("-diagnosis")?;
    check::ready(&case, (engine, model), &out, |plan| plan.diagnosis())?;
    let _lock = alone(&out, "gl-diagnose")?;
    let runner = Runner::new(&out)?;
    let settings = request.keep(engine, &out)?;
    let diagnosis =
        Diagnosis { case: &case, engine, model, request, wait, runner: &runner, out: &out, settings };
    if diagnosis.base()? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    diagnosis.locate()?;
    if diagnosis.attribute()? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    let effects = diagnosis.winner()?;
    if diagnosis.shrink(&effects)? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    diagnosis.report()?;
    Ok(Progress::Finished)
}

impl Diagnosis<'_> {
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }

    /// What the settings are made from.
    pub(crate) fn inputs(&self) -> Vec<PathBuf> {
        vec![self.case.params(), self.case.tests[0].obs.clone(), self.case.file(), self.settings.clone()]
    }

    /// Calibrate into a folder, with other effects in if some are named.
    fn calibrate(&self, out: &Path, effects: Option<&str>) -> Result<Progress> {
        let posterior = out.join("posterior.txt");
        if is_current(&posterior, &self.inputs())? {
            return Ok(Progress::Finished);
        }
        let mut call = Call::new("gl-calibrate").arg(&self.case.folder);
        call = call.flag("--engine", self.engine.name()).flag("--out", out);
        if !self.wait {
            call = call.arg("--no-wait");
        }
        if self.case.posterior == Posterior::Emulator {
            // What comes after weighs curves of real runs, scatter and all.
            call = call.arg("posterior=weights");
        }
        call = call.args(&self.request.given);
        if let Some(effects) = effects {
            call = call.arg(format!("effects={effects}"));
        }
        if self.runner.call(&call, Messages::Shown)? == 1 {
            return Ok(Progress::InQueue);
        }
        // It may have found everything as it was.
        touch(&posterior)?;
        Ok(Progress::Finished)
    }

    fn base(&self) -> Result<Progress> {
        self.calibrate(&self.file("base"), None)
    }

    /// Where the calibrated model misses the measurement.
    fn locate(&self) -> Result<()> {
        let table = self.file("locate.txt");
        if is_current(&table, &[self.file("base/posterior.txt")])? {
            return Ok(());
        }
        let call = measurement(Call::new("gl-gap-locate"), &self.case.tests[0])
            .flag("-w", self.file("base/posterior-weights.txt"))
            .verdict(&self.file("locate-verdict.txt"))
            .flag("-o", &table)
            .arg(self.file("base/ensemble.txt"));
        self.must(&call, "locate.log")
    }

    /// Those of the winner's effects that are the simulator's; what the measurement does needs no runs.
    fn winner(&self) -> Result<Vec<String>> {
        let attribution = Table::read(&self.file("attribution.txt"))?;
        let effects = winning_effects(&Prior::read(&self.case.params())?, &attribution)?;
        put(&self.file("winner.txt"), format!("{}\n", effects.join(",")).as_bytes())?;
        Ok(effects)
    }

    /// How far the gap closes once the effects are in the simulation.
    fn shrink(&self, effects: &[String]) -> Result<Progress> {
        let table = self.file("shrink.txt");
        if effects.is_empty() {
            return self.no_shrink(&table);
        }
        let effects = effects.join(",");
        let after = self.file(&format!("after-{effects}"));
        if self.calibrate(&after, Some(&effects))? == Progress::InQueue {
            return Ok(Progress::InQueue);
        }
        let inputs = [self.file("winner.txt"), self.file("base/posterior.txt"), after.join("posterior.txt")];
        if is_current(&table, &inputs)? {
            return Ok(Progress::Finished);
        }
        let both = |folder: &Path| {
            format!(
                "{},{}",
                folder.join("ensemble.txt").display(),
                folder.join("posterior-weights.txt").display()
            )
        };
        let call = measurement(Call::new("gl-gap-shrink"), &self.case.tests[0])
            .option("--scatter", self.case.scatter)
            .flag("--before", both(&self.file("base")))
            .flag("--after", both(&after));
        if let Some(steps) = &self.case.tests[0].steps {
            let unseen = call
                .clone()
                .flag("--calibrated", steps)
                .verdict(&self.file("shrink-unseen-verdict.txt"))
                .flag("-o", self.file("shrink-unseen.txt"));
            self.must(&unseen, "shrink-unseen.log")?;
        }
        self.must(&call.verdict(&self.file("shrink-verdict.txt")).flag("-o", &table), "shrink.log")?;
        Ok(Progress::Finished)
    }

    /// A table of no rows: nothing was put in.
    fn no_shrink(&self, table: &Path) -> Result<Progress> {
        if is_current(table, &[self.file("winner.txt")])? {
            return Ok(Progress::Finished);
        }
        gl_cli::note("gl-diagnose", "no effect of the simulator explains the gap, so none is put in");
        for file in ["shrink-unseen.txt", "shrink-unseen-verdict.txt", "shrink-verdict.txt"] {
            let _ = std::fs::remove_file(self.file(file));
        }
        let columns =
            ["observable", "gap_before", "gap_after", "floor", "shrink", "shrink_low", "shrink_high"];
        TableWriter::create(Some(table), &columns)?.finish()?;
        Ok(Progress::Finished)
    }

    fn report(&self) -> Result<()> {
        let tables = ["locate.txt", "attribution.txt", "shrink.txt"].map(|name| self.file(name));
        if !gl_cli::sibling("gl-report").is_file() || is_current(&self.file("report.md"), &tables)? {
            return Ok(());
        }
        let call = Call::new("gl-report").arg(&self.case.folder).flag("--engine", self.engine.name());
        let call = call.flag("--out", self.out).args(&self.request.given);
        self.runner.must(&call, Messages::Shown)
    }

    /// Call a tool whose words are kept in a file and shown, too.
    fn must(&self, call: &Call, log: &str) -> Result<()> {
        let log = self.file(log);
        self.runner.must(call, Messages::Kept(&log))?;
        show(&log, 0);
        Ok(())
    }
}

/// Put a text into a file so that what depends on it is made again.
pub(crate) fn renew(from: &Path, to: &Path) -> Result<()> {
    write(to, &std::fs::read(from)?)
}
