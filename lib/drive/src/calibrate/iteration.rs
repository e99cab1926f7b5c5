//! One iteration: propose samples, run them, weigh all runs so far, and see whether to stop.

use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context, Result, bail, ensure};
use gl_case::{Case, Engine, Posterior, Test};
use gl_inference::collect::RunStatus;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_inference::summary::enough_runs;
use gl_inference::times::TIMES;

use super::emulated;
use crate::columns::{comparison, list, of_test, simulated, varied_in, within};
use crate::step::{Call, Messages, Runner, is_current, make_folder, show};

/// What all iterations of a calibration have in common.
pub(crate) struct Setting<'a> {
    pub(crate) case: &'a Case,
    /// The engine and its model; none where the runs are made elsewhere.
    pub(crate) runs: Option<(Engine, &'a str)>,
    pub(crate) prior: &'a Prior,
    /// What was given for the call, where it is kept.
    pub(crate) settings: Option<PathBuf>,
    /// Runs that were there before the first iteration.
    pub(crate) known: Option<Known>,
    /// Whether to wait for runs in a queue.
    pub(crate) wait: bool,
    pub(crate) runner: &'a Runner,
    pub(crate) out: &'a Path,
}

/// Runs that were made for something else, and are of the same model.
pub(crate) struct Known {
    pub(crate) samples: PathBuf,
    /// One of each test.
    pub(crate) ensembles: Vec<PathBuf>,
    pub(crate) runs: usize,
}

impl Known {
    /// # Errors
    /// If the case has no emulator, or a table is missing or cannot be read.
    pub(crate) fn new(case: &Case, folder: &Path) -> Result<Self> {
        ensure!(
            case.posterior == Posterior::Emulator,
            "--with {}: an emulator learns from runs that are there already; leave it out with posterior=weights",
            folder.display()
        );
        let of = |test| folder.join(emulated::of_test_or_none("ensemble", test, ""));
        let ensembles: Vec<PathBuf> = case.tests.iter().map(of).collect();
        for table in &ensembles {
            ensure!(
                table.is_file(),
                "{}: not there; --with takes a folder with samples.txt and the ensemble of each test",
                table.display()
            );
        }
        let samples = folder.join("samples.txt");
        Ok(Self { runs: Samples::read(&samples)?.len(), samples, ensembles })
    }

    /// The ensembles as tools take them.
    pub(crate) fn tables(&self, case: &Case) -> Vec<std::ffi::OsString> {
        case.tests.iter().zip(&self.ensembles).map(|(test, table)| of_test(test, table)).collect()
    }
}

impl Setting<'_> {
    /// What the settings are.
    pub(crate) fn given(&self) -> Vec<PathBuf> {
        [self.case.file()]
            .into_iter()
            .chain(self.settings.clone())
            .chain(self.case.outliers.clone())
            .collect()
    }

    pub(crate) fn folder(&self, i: usize) -> PathBuf {
        self.out.join(format!("iter{i}"))
    }

    /// Where the folder of an iteration is set aside that a later call did not come to.
    pub(crate) fn aside(&self, i: usize) -> PathBuf {
        self.out.join(format!("iter{i}.aside"))
    }

    /// The folder of a test in that of an iteration; the same where the case is one test.
    pub(crate) fn folder_of(&self, i: usize, test: &Test) -> PathBuf {
        within(&self.folder(i), test)
    }
}

/// One iteration of a calibration.
pub(crate) struct Iteration<'a> {
    pub(crate) setting: &'a Setting<'a>,
    pub(crate) number: usize,
    pub(crate) folder: PathBuf,
    /// The iteration before.
    pub(crate) previous: Option<PathBuf>,
}

impl<'a> Iteration<'a> {
    pub(crate) fn new(setting: &'a Setting<'a>, number: usize) -> Self {
        let previous = number.checked_sub(1).map(|i| setting.folder(i));
        Self { setting, number, folder: setting.folder(number), previous }
    }

    /// Make all of it that is not there yet: whether a criterion says stop. None where runs are in a queue.
    pub(crate) fn make(&self) -> Result<Option<bool>> {
        self.propose()?;
        if !self.run()? {
            return Ok(None);
        }
        self.judge().map(Some)
    }

    /// Collect and weigh runs that are there: whether a criterion says stop.
    pub(crate) fn weigh_all(&self) -> Result<bool> {
        self.run()?;
        self.judge()
    }

    fn judge(&self) -> Result<bool> {
        if self.is_drawn()? && self.draw()? {
            return self.stop();
        }
        self.propose_backwards()?;
        self.compare()?;
        self.weigh()?;
        self.stop()
    }

    /// The samples to run: from the prior, then from the weights of the iteration before.
    pub(crate) fn propose(&self) -> Result<()> {
        let case = self.setting.case;
        let samples = self.file("samples.txt");
        let named = |call: Call, seed: u64| {
            call.option("--threads", case.threads)
                .option("--seed", Some(seed))
                .flag("--name", case.name_of_runs())
                .option("--iteration", Some(self.number))
        };
        let aside = self.setting.aside(self.number);
        if !self.folder.exists() && aside.exists() {
            std::fs::rename(&aside, &self.folder).with_context(|| aside.display().to_string())?;
        }
        make_folder(&self.folder)?;
        let Some(previous) = &self.previous else {
            let mut inputs = self.setting.given();
            inputs.push(case.params());
            if is_current(&samples, &inputs)? || self.take_known(&samples)? {
                return Ok(());
            }
            let call = Call::new("gl-sample").flag("-p", case.params()).option("-n", Some(self.runs()));
            let call = named(call.option("--effects", list(&case.effects)), case.seed);
            let is_drawn = case.posterior == Posterior::Emulator;
            let call = call.option("--method", is_drawn.then_some("sobol"));
            return self.setting.runner.must(&call.flag("-o", &samples), Messages::Shown);
        };
        if self.is_drawn()? {
            return self.take_next(previous);
        }
        let weights = match case.emulated {
            _ if case.posterior == Posterior::Emulator => previous.join("weights.txt"),
            0 => previous.join("weights.txt"),
            _ => emulated::weights(self.setting, self.number - 1)?,
        };
        if is_current(&samples, &[previous.join("stop.code"), weights.clone()])? {
            return Ok(());
        }
        let call = Call::new("gl-gmm-resample")
            .flag("-p", case.params())
            .option("-n", Some(self.runs()))
            .option("--components", case.components)
            .option("--covariance", case.covariance.as_ref())
            .flag("--sampling", &case.sampling);
        let call = named(call, case.seed + self.number as u64)
            .flag("--proposal-out", self.file("proposal.txt"))
            .flag("-o", &samples)
            .arg(&weights);
        self.setting.runner.must(&call, Messages::Kept(&self.file("resample.log")))
    }

    /// Run the samples in each test and collect the runs: false where they are in a queue.
    fn run(&self) -> Result<bool> {
        let Setting { case, runs, wait, .. } = *self.setting;
        case.tests.iter().try_for_each(|test| self.give(test))?;
        in_each_test(case, runs.map(|(engine, _)| engine), wait, |test| self.run_test(test))
    }

    fn run_test(&self, test: &Test) -> Result<bool> {
        let Setting { case, runner, .. } = *self.setting;
        let folder = self.setting.folder_of(self.number, test);
        let (samples, ensemble) = (folder.join("samples.txt"), folder.join("ensemble.txt"));
        let mut inputs = self.setting.given();
        inputs.extend([samples.clone(), test.obs.clone()]);
        if is_current(&ensemble, &inputs)? {
            return Ok(true);
        }
        let runs = folder.join("runs");
        if let Some((engine, model)) = self.setting.runs {
            let own = if test.name.is_empty() { model.to_owned() } else { case.model_of(test, engine)? };
            if !run(runner, case, (engine, &own), &samples, &runs, self.setting.wait)? {
                return Ok(false);
            }
        }
        let earlier: Vec<PathBuf> = (0..self.number).map(|i| self.setting.folder_of(i, test)).collect();
        let log = folder.join("collect.log");
        let known = self.setting.known.as_ref().map_or(0, |known| known.runs);
        let before = Before { folders: &earlier, known };
        collect(runner, case, test, &folder, &before, Messages::Kept(&log))?;
        show(&log, 0);
        Ok(true)
    }

    /// The samples of a test that has a name: those of the iteration, with what is given of the test.
    pub(crate) fn give(&self, test: &Test) -> Result<()> {
        if test.name.is_empty() {
            return Ok(());
        }
        let folder = self.setting.folder_of(self.number, test);
        make_folder(&folder)?;
        let (all, own) = (self.file("samples.txt"), folder.join("samples.txt"));
        let mut inputs = self.setting.given();
        inputs.push(all.clone());
        if is_current(&own, &inputs)? {
            return Ok(());
        }
        give(&all, test, self.setting.runs.map(|(engine, _)| engine), self.setting.case.threads, &own)
    }

    /// How far each run is from the measurement.
    fn compare(&self) -> Result<()> {
        for test in &self.setting.case.tests {
            for i in 0..=self.number {
                let folder = self.setting.folder_of(i, test);
                let (ensemble, misfit) = (folder.join("ensemble.txt"), folder.join("misfit.txt"));
                if !is_current(&misfit, &[&ensemble])? {
                    let call = comparison(Call::new("gl-likelihood"), test);
                    self.setting.runner.must(&call.flag("-o", &misfit).arg(&ensemble), Messages::Shown)?;
                }
            }
        }
        Ok(())
    }

    /// Weigh all runs so far: tempered, so that enough of them keep weight to draw the next samples from; and as the
    /// posterior itself. Of what gl-filter writes the weights come last, so that they stand for all of it.
    fn weigh(&self) -> Result<()> {
        let misfits = self.tables_of_tests("misfit.txt");
        let runner = self.setting.runner;
        let weights = self.file("weights.txt");
        if !is_current(&weights, &misfits)? {
            let (runs, parameters) = varied_in(&self.file("samples.txt"))?;
            let kept = (self.setting.case.ess * runs as f64).max(enough_runs(parameters) as f64);
            let call = self
                .filter()
                .option("--ess-runs", Some(kept))
                .flag("--sigma-min", "noise")
                .flag("--history", self.file("history.txt"))
                .flag("--summary", self.file("summary.txt"))
                .flag("-o", &weights);
            runner.must(&call.args(&misfits), Messages::Kept(&self.file("filter.log")))?;
        }
        let weights = self.file("posterior-weights.txt");
        if !is_current(&weights, &misfits)? {
            let call = self.filter().flag("--sigma", "noise").flag("--summary", self.file("posterior.txt"));
            let call = call.flag("-o", &weights).args(&misfits);
            runner.must(&call, Messages::Kept(&self.file("posterior.log")))?;
        }
        Ok(())
    }

    /// `gl-filter` with all samples so far and what they were drawn from.
    fn filter(&self) -> Call {
        let mut call = Call::new("gl-filter").flag("-p", self.setting.case.params());
        for samples in self.files_so_far("samples.txt") {
            call = call.flag("-s", samples);
        }
        call = call.flag("--proposal", "prior");
        for proposal in &self.files_so_far("proposal.txt")[1..] {
            call = call.flag("--proposal", proposal);
        }
        call
    }

    /// Whether a criterion says stop; kept as 0 or, to go on, 1 in `stop.code`.
    fn stop(&self) -> Result<bool> {
        let code = self.file("stop.code");
        let mut inputs = self.setting.given();
        inputs.push(self.file("posterior-weights.txt"));
        if is_current(&code, &inputs)? {
            return Ok(std::fs::read_to_string(&code)?.trim() == "0");
        }
        let tolerances = self.setting.case.tolerances;
        let call = Call::new("gl-check-stop")
            .option("--sigma-tol", tolerances.sigma)
            .option("--error-tol", tolerances.error)
            .option("--ensemble-error-tol", tolerances.ensemble_error)
            .option("--misfit-tol", tolerances.misfit)
            .flag("--previous", self.summary_before())
            .verdict(&self.file("stop-verdict.txt"))
            .flag("-o", self.file("stop.txt"))
            .arg(self.file("summary.txt"));
        let answer = self.setting.runner.call(&call, Messages::Kept(&self.file("stop.log")))?;
        gl_table::write_whole(&code, format!("{answer}\n").as_bytes())?;
        Ok(answer == 0)
    }

    /// The summary that this one is compared with; `none` for the first.
    pub(crate) fn summary_before(&self) -> PathBuf {
        self.previous.as_ref().map_or("none".into(), |previous| previous.join("summary.txt"))
    }

    /// A file of this iteration.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A file of each test and iteration up to this one, test by test.
    pub(crate) fn tables_of_tests(&self, name: &str) -> Vec<PathBuf> {
        let of = |test| (0..=self.number).map(move |i| self.setting.folder_of(i, test).join(name));
        self.setting.case.tests.iter().flat_map(of).collect()
    }

    /// A file of each iteration up to this one.
    pub(crate) fn files_so_far(&self, name: &str) -> Vec<PathBuf> {
        (0..=self.number).map(|i| self.setting.folder(i).join(name)).collect()
    }
}

/// Run each test: whether the runs of all have ended. In a queue they are at the same time; but where the site limits how
/// many tasks run, which it does array by array, one test comes after the other.
///
/// # Errors
/// The first of a test.
pub(crate) fn in_each_test(
    case: &Case,
    engine: Option<Engine>,
    wait: bool,
    run: impl Fn(&Test) -> Result<bool> + Sync,
) -> Result<bool> {
    let is_at_once = engine.is_some_and(Engine::is_queue) && case.cluster.max_concurrent.is_none();
    if is_at_once && wait {
        return thread::scope(|scope| {
            let running: Vec<_> = case.tests.iter().map(|test| scope.spawn(|| run(test))).collect();
            running.into_iter().try_fold(true, |all, one| {
                let has_ended = one.join().unwrap_or_else(|panic| resume_unwind(panic))?;
                Ok(all && has_ended)
            })
        });
    }
    let mut all = true;
    for test in &case.tests {
        all &= run(test)?;
        if !all && !is_at_once {
            break;
        }
    }
    Ok(all)
}

/// Write the samples of a test: those of a table, with what is given of the test.
///
/// # Errors
/// If the table cannot be read, or the other one not written.
pub(crate) fn give(
    all: &Path,
    test: &Test,
    engine: Option<Engine>,
    threads: Option<usize>,
    own: &Path,
) -> Result<()> {
    let mut samples = Samples::read(all)?;
    // A simulator that takes the whole table has it in its command.
    if engine != Some(Engine::Embedded) {
        samples.parameters.extend(test.given.iter().map(|(name, _)| name.clone()));
        let values: Vec<f64> = test.given.iter().map(|(_, value)| *value).collect();
        samples.values.iter_mut().for_each(|row| row.extend(&values));
    }
    samples.write(Some(own), threads)
}

/// Run the samples of a table: false where they are in a queue, and `wait` is not set.
///
/// # Errors
/// If the engine refuses them, or some were not tried.
pub(crate) fn run(
    runner: &Runner,
    case: &Case,
    (engine, model): (Engine, &str),
    samples: &Path,
    runs: &Path,
    wait: bool,
) -> Result<bool> {
    let mut call = Call::new("gl-run").arg(engine.name()).flag("--case", &case.folder);
    if case.packed == Some(true) {
        call = call.arg("--packed");
    }
    call = call.option("--kept", case.kept.as_ref().map(|kept| kept.display()));
    call = call.flag("--times", runs.join(TIMES));
    if engine.is_queue() {
        // It reads [cluster] of case.toml itself.
        let is_site = |text: &&String| {
            let key = text.split(['=', '.']).next().unwrap_or_default().trim().to_lowercase();
            matches!(key.as_str(), "cluster" | "packed")
        };
        call = case.given.iter().filter(is_site).fold(call, |call, text| call.flag("--set", text));
    }
    let leaves = !wait && engine.is_queue();
    if leaves {
        call = call.arg("--no-wait");
    }
    // Behind the options, since a model may begin with anything.
    let call = call.arg("--").arg(samples).arg(model).arg(runs);
    match runner.call(&call, Messages::Shown)? {
        0 => Ok(true),
        _ if leaves => Ok(false),
        code if engine == Engine::Embedded => bail!(
            "{model} ended with status {code} before all runs of {} were made; see what it says above, and call again to go on",
            samples.display()
        ),
        _ => bail!("some runs of {} were not tried; call again to go on", samples.display()),
    }
}

/// What has run before a batch.
pub(crate) struct Before<'a> {
    /// Folders of earlier batches.
    pub(crate) folders: &'a [PathBuf],
    /// Runs that were there before the first of them.
    pub(crate) known: usize,
}

impl Before<'_> {
    fn is_nothing(&self) -> bool {
        self.folders.is_empty() && self.known == 0
    }
}

/// Collect the runs of `samples.txt` of a folder into its `ensemble.txt`; beside those of before, all of them may have
/// failed.
pub(crate) fn collect(
    runner: &Runner,
    case: &Case,
    test: &Test,
    folder: &Path,
    before: &Before<'_>,
    messages: Messages<'_>,
) -> Result<()> {
    let mut call = Call::new("gl-collect").flag("-s", folder.join("samples.txt"));
    if !before.is_nothing() {
        call = call.arg("--allow-empty");
    }
    let call = simulated(call, test)
        .option("--max-failed", Some(if before.is_nothing() { case.max_failed } else { 1.0 }))
        .flag("--status", folder.join("status.txt"))
        .flag("-o", folder.join("ensemble.txt"))
        .arg(folder.join("runs"));
    runner.must(&call, messages)?;
    if !before.is_nothing() {
        not_too_many_failed(case.max_failed, before, folder)?;
    }
    Ok(())
}

/// See to it that of all runs so far no more failed than the case allows: those that are asked for one by one may all lie
/// where the simulation does not run, which the next ones keep away from.
fn not_too_many_failed(max_failed: f64, before: &Before<'_>, newest: &Path) -> Result<()> {
    let (mut all, mut failed) = (before.known, 0);
    for folder in before.folders.iter().map(PathBuf::as_path).chain([newest]) {
        all += Samples::read(&folder.join("samples.txt"))?.len();
        failed += RunStatus::failed(&folder.join("status.txt"))?.len();
    }
    ensure!(
        failed as f64 <= max_failed * all as f64,
        "{failed} of {all} runs so far failed, more than max_failed = {max_failed} allows; {} has the reason of each: narrow the bounds to \
         where the simulation runs, or begin with more runs, num=…",
        newest.join("status.txt").display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn runs_that_were_there_before_count_among_those_of_which_some_may_fail() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("samples.txt"), "description\ta\ns0\t1\ns1\t2\ns2\t3\n").unwrap();
        let status = "sample\tstatus\tdetail\ns0\tmissing\t-\ns1\tmissing\t-\ns2\tok\t-\n";
        std::fs::write(folder.path().join("status.txt"), status).unwrap();
        let judged = |known| not_too_many_failed(0.5, &Before { folders: &[], known }, folder.path());
        judged(1).unwrap();
        let said = judged(0).unwrap_err().to_string();
        assert!(said.starts_with("2 of 3 runs so far failed, more than max_failed = 0.5 allows"), "{said}");
    }
}
