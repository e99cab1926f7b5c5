//! The steps of a diagnosis: calibrate the base model, locate the gap, find its cause, calibrate again with the
//! cause in, and see how far the gap closes.

pub(crate) mod closest;
mod design;

/// The prior with the bounds that the design has gone beyond, in the folder of the diagnosis.
const WIDER_PRIOR: &str = "wider-params.txt";

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use gl_case::folders::{BASE, BASE_WIDER, SHRINK_BETWEEN, SHRINK_UNSEEN};
use gl_case::{Case, Engine, Posterior, Test, Winner};
use gl_gap::attribute::winner::{MostProbable, cause, winning_effects};
use gl_gap::shrink::COLUMNS;
use gl_inference::observations::ByName;
use gl_inference::prior::Prior;
use gl_table::verdict::Verdicts;
use gl_table::{Table, TableWriter};

use crate::Progress;
use crate::arguments::{Request, Results};
use crate::calibrate::{RUNS_WEIGHTS, alone};
use crate::check;
use crate::columns::{Which, ensembles, measured, units};
use crate::step::{Call, Messages, Runner, is_current, make_folder, put, show, touch};

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
/// and a report; beside a rest `closest-base` and `closest-after-EFFECT`, too.
///
/// # Errors
/// If the case is wrong, or a step fails.
pub fn diagnose(request: &Request, wait: bool) -> Result<Progress> {
    let case = request.load()?;
    let (engine, model) = case.engine(request.engine)?;
    let out = request.own_folder(Results::Diagnosis)?;
    ensure!(
        !out.as_os_str().as_encoded_bytes().contains(&b','),
        "{}: commas part the tables that gl-gap-shrink takes; choose a folder without",
        out.display()
    );
    let (prior, observations) = check::ready(&case, (engine, model), &out, |plan| plan.diagnosis())?;
    check::varies(&observations)?;
    ensure!(
        !(prior.effects().is_empty() && case.measurement.is_empty()),
        "{}: there is no candidate to explain a gap with; name the effect of a parameter in the column effect, with its value in off, or errors of the rig in measurement of {}",
        case.params().display(),
        case.file().display()
    );
    let _lock = alone(&out, "gl-diagnose")?;
    let runner = Runner::new(&out)?;
    let settings = request.keep(&case, engine, &out)?;
    let diagnosis =
        Diagnosis { case: &case, engine, model, request, wait, runner: &runner, out: &out, settings };
    let base = diagnosis.file(BASE);
    if diagnosis.calibrate(&base, None)? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    diagnosis.locate(&base)?;
    if diagnosis.attribute()? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    // What the prior excluded is no gap of the model, and neither are readings that are far off.
    let base = diagnosis.base();
    if diagnosis.calibrate(&base, None)? == Progress::InQueue {
        return Ok(Progress::InQueue);
    }
    diagnosis.locate(&base)?;
    let winner = diagnosis.winner()?;
    if diagnosis.shrink(&winner)? == Progress::InQueue {
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
        let mut inputs = vec![self.case.params()];
        inputs.extend(self.case.tests.iter().map(|test| test.obs.clone()));
        inputs.extend([self.case.file(), self.settings.clone()]);
        inputs
    }

    /// Calibrate into a folder, with a winner in if there is one; the runs of the design are known then.
    fn calibrate(&self, out: &Path, with: Option<&Winner>) -> Result<Progress> {
        let known = || match with {
            Some(winner) if !self.is_weighed() => self.known(winner, out).map(Some),
            _ => Ok(None),
        };
        self.calibrated(out, with, known, &self.inputs(), &[])
    }

    /// Whether the posterior of this case is that of weights, and no emulator's.
    fn is_weighed(&self) -> bool {
        self.case.posterior != Posterior::Emulator
    }

    /// Calibrate into a folder from runs that are known, where it is older than what it is made from; `given` are settings
    /// behind those that were asked for.
    fn calibrated(
        &self,
        out: &Path,
        with: Option<&Winner>,
        known: impl FnOnce() -> Result<Option<PathBuf>>,
        inputs: &[PathBuf],
        given: &[String],
    ) -> Result<Progress> {
        let posterior = out.join("posterior.txt");
        let mut inputs = inputs.to_vec();
        let outliers = self.outliers_for(out)?;
        inputs.extend(outliers.clone());
        // The folder is called by its effects; how large errors of the rig are changes with the runs of the design.
        if with.is_some_and(|winner| !winner.rig.is_empty()) {
            inputs.push(self.file(Winner::FILE));
        }
        if is_current(&posterior, &inputs)? {
            return Ok(Progress::Finished);
        }
        let mut call = Call::new("gl-calibrate").arg(&self.case.folder);
        call = call.flag("--engine", self.engine.name()).flag("--out", out);
        if !self.wait {
            call = call.arg("--no-wait");
        }
        if self.is_weighed() && self.case.tolerances.misfit.is_none() {
            call = call.arg("misfit_tol=1");
        }
        if let Some(known) = known()? {
            call = call.flag("--with", known);
        }
        call = call.args(&self.request.given).args(given);
        if let Some(wider) = self.wider_prior().filter(|_| out != self.file(BASE)) {
            call = call.arg(format!("params={}", std::path::absolute(wider)?.display()));
        }
        if let Some(outliers) = outliers {
            call = call.arg(format!("outliers={}", std::path::absolute(outliers)?.display()));
        }
        if let Some(winner) = with {
            if !winner.effects.is_empty() {
                call = call.arg(format!("effects={}", winner.effects.join(",")));
            }
            if !winner.rig.is_empty() {
                call = call.arg(format!("rig={}", self.whole_rig(winner).rig));
            }
        }
        if self.runner.call(&call, Messages::Shown)? == 1 {
            return Ok(Progress::InQueue);
        }
        // It may have found everything as it was.
        touch(&posterior)?;
        Ok(Progress::Finished)
    }

    /// The runs of the design that belong to the calibration with a winner, as its rig would have recorded them.
    fn known(&self, winner: &Winner, out: &Path) -> Result<PathBuf> {
        let prior = Prior::read(&self.wider_prior().unwrap_or_else(|| self.case.params()))?;
        let folder = out.join("known");
        self.runs_with(winner, &prior, &folder)?;
        Ok(folder)
    }

    /// A winner with the errors of the rig that the case knows, too, which the runs of its design have already.
    fn whole_rig(&self, winner: &Winner) -> Winner {
        let mut rig = self.case.rig.clone();
        winner.rig.iter().for_each(|(name, size)| rig.add(name, size));
        Winner { rig, ..winner.clone() }
    }

    /// The prior with its bounds moved to where the design has gone, if it went beyond them.
    fn wider_prior(&self) -> Option<PathBuf> {
        Some(self.file(WIDER_PRIOR)).filter(|wider| wider.is_file())
    }

    /// The calibration of the base model that the gap is measured from: with the wider prior, if there is one.
    fn base(&self) -> PathBuf {
        self.file(if self.wider_prior().is_some() { BASE_WIDER } else { BASE })
    }

    /// Readings that look like outliers, as soon as some are known.
    fn outliers(&self) -> Result<Option<PathBuf>> {
        let table = self.file(OUTLIERS);
        Ok(if table.is_file() && !Table::read(&table)?.is_empty() { Some(table) } else { None })
    }

    /// The same as a calibration takes them, in its folder: all do but that of the base model, which is there before them.
    fn outliers_for(&self, calibration: &Path) -> Result<Option<PathBuf>> {
        let table = calibration.join(OUTLIERS);
        let known = self.outliers()?.filter(|_| !self.is_weighed() && calibration != self.file(BASE));
        let Some(known) = known else {
            let _ = std::fs::remove_file(table);
            return Ok(None);
        };
        make_folder(calibration)?;
        put(&table, &std::fs::read(known)?)?;
        Ok(Some(table))
    }

    /// Where the calibrated model misses the measurement.
    fn locate(&self, base: &Path) -> Result<()> {
        let table = self.file("locate.txt");
        let found = self.found().into_iter();
        if is_current(&table, &found.chain([base.join("posterior.txt")]).collect::<Vec<_>>())? {
            return Ok(());
        }
        if table.is_file() {
            let text = "the gap is located once more, by what is known by now of the calibration and of how the readings scatter";
            gl_cli::note("gl-diagnose", text);
        }
        let call = self.locating(base, &table)?;
        self.must(&call.verdict(&self.file("locate-verdict.txt")), "locate.log")
    }

    /// What the attribution has found of the readings.
    fn found(&self) -> Vec<PathBuf> {
        [OUTLIERS, NOISE].iter().map(|name| self.file(name)).filter(|table| table.is_file()).collect()
    }

    /// The call that locates the gap of a calibration into a table, by what is known of the readings.
    fn locating(&self, of: &Path, table: &Path) -> Result<Call> {
        let noise = Some(self.file(NOISE)).filter(|table| table.is_file());
        Ok(measured(Call::new("gl-gap-locate"), self.case, Which::All)
            .file("--outliers", self.outliers()?.as_deref())
            .file("--noise-found", noise.as_deref())
            .flag("-w", of.join(RUNS_WEIGHTS))
            .option("--units", units(self.case))
            .flag("-o", table)
            .args(ensembles(self.case, of)))
    }

    /// What is put in: the effects of what comes first, and its errors of the rig, if there are runs that show it.
    fn winner(&self) -> Result<Winner> {
        let (attribution, verdict) = self.attributed()?;
        let effects = winning_effects(&Prior::read(&self.case.params())?, &attribution, &verdict)?;
        let is_shown = verdict.find("untried").is_none();
        let rig = if is_shown { self.errors_of_the_rig()? } else { ByName::default() };
        let winner = Winner { effects, rig };
        put(&self.file(Winner::FILE), winner.text().as_bytes())?;
        Ok(winner)
    }

    /// To four digits: none of them knows its size better.
    fn errors_of_the_rig(&self) -> Result<ByName> {
        let table = Table::read(&self.file(RIG))?;
        let error = table.format().column("error")?;
        let sizes = table.numbers("size")?.into_iter().enumerate();
        let rounded = |size: f64| format!("{size:.3e}").parse().unwrap_or(size);
        let named = |(row, size): (usize, f64)| (table.field(row, error).to_owned(), rounded(size));
        Ok(sizes.map(named).collect())
    }

    /// The table of the attribution and its verdict.
    fn attributed(&self) -> Result<(Table, Verdicts)> {
        let table = Table::read(&self.file("attribution.txt"))?;
        Ok((table, Verdicts::read(&self.file("attribution-verdict.txt"))?))
    }

    /// How far the gap closes once the winner is in.
    fn shrink(&self, winner: &Winner) -> Result<Progress> {
        let table = self.file("shrink.txt");
        if winner.is_nothing() {
            return self.no_shrink(&table);
        }
        let after = winner.folder(self.out);
        if self.calibrate(&after, Some(winner))? == Progress::InQueue {
            return Ok(Progress::InQueue);
        }
        // For the picture of the page.
        let located = self.file("locate-after.txt");
        let mut inputs = vec![self.file(Winner::FILE), after.join("posterior.txt")];
        inputs.extend(self.found());
        if !is_current(&located, &inputs)? {
            let call = self.locating(&after, &located)?;
            self.runner.must(&call, Messages::Kept(&self.file("locate-after.log")))?;
        }
        let Some((base, after)) = self.between(self.base(), after, winner)? else {
            return Ok(Progress::InQueue);
        };
        let between = self.file(SHRINK_BETWEEN);
        let name = |folder: &Path| folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let rows = format!("part\tfolder\nbefore\t{}\nafter\t{}\n", name(&base), name(&after));
        put(&between, rows.as_bytes())?;
        let mut inputs = vec![between, base.join("posterior.txt"), after.join("posterior.txt")];
        inputs.extend(self.found());
        if is_current(&table, &inputs)? {
            return Ok(Progress::Finished);
        }
        let tables = |folder: &Path| {
            let mut tables = ensembles(self.case, folder);
            tables.push(folder.join(RUNS_WEIGHTS).into());
            tables.join(OsStr::new(","))
        };
        let call = measured(Call::new("gl-gap-shrink"), self.case, Which::All)
            .option("--scatter", self.case.scatter)
            .file("--outliers", self.outliers()?.as_deref())
            .flag("--before", tables(&base))
            .flag("--after", tables(&after));
        if let Some(seen) = seen(self.case) {
            let [table, verdict, log] = SHRINK_UNSEEN;
            let unseen = call.clone().flag("--calibrated", seen);
            self.must(&unseen.verdict(&self.file(verdict)).flag("-o", self.file(table)), log)?;
        } else {
            self.remove(&SHRINK_UNSEEN)?;
        }
        if !winner.rig.is_empty() {
            let rig = &winner.rig;
            let text =
                format!("the gap after is that of runs as the rig would have recorded them, with {rig}");
            gl_cli::note("gl-diagnose", text);
        }
        let first = MostProbable::of(&self.attributed()?.0)?.cause;
        let foretold = Some(self.file(FORETOLD)).filter(|table| is_of(table, &first).unwrap_or(false));
        let call = call.file("--foretold", foretold.as_deref());
        self.must(&call.verdict(&self.file("shrink-verdict.txt")).flag("-o", &table), "shrink.log")?;
        Ok(Progress::Finished)
    }

    /// A table of no rows: nothing was put in.
    fn no_shrink(&self, table: &Path) -> Result<Progress> {
        if is_current(table, &[self.file(Winner::FILE)])? {
            return Ok(Progress::Finished);
        }
        gl_cli::note("gl-diagnose", "nothing is known to be the cause, so nothing is put in");
        self.remove(&["locate-after.txt", SHRINK_BETWEEN, "shrink-verdict.txt", "shrink.log"])?;
        self.remove(&SHRINK_UNSEEN)?;
        TableWriter::create(Some(table), &COLUMNS)?.finish()?;
        Ok(Progress::Finished)
    }

    /// Remove what no longer holds of an earlier call.
    fn remove(&self, files: &[&str]) -> Result<()> {
        files.iter().try_for_each(|file| gl_table::remove(&self.file(file)))
    }

    fn report(&self) -> Result<()> {
        let tables = ["locate.txt", "attribution.txt", "shrink.txt"].map(|name| self.file(name));
        if is_current(&self.file("report.md"), &tables)? {
            return self.say_again();
        }
        if !gl_cli::sibling("gl-report").is_file() {
            return Ok(());
        }
        let call = Call::new("gl-report").arg(&self.case.folder).flag("--engine", self.engine.name());
        let call = call.flag("--out", self.out).args(&self.request.given);
        self.runner.must(&call, Messages::Shown)
    }

    /// What it all came to, for who calls where nothing is left to be done.
    fn say_again(&self) -> Result<()> {
        for log in ["locate.log", "attribution.log", SHRINK_UNSEEN[2], "shrink.log"] {
            show(&self.file(log), 0);
        }
        for page in ["report.html", "report.md"] {
            gl_table::print(&format!("{}\n", self.file(page).display()))?;
        }
        Ok(())
    }

    /// Call a tool whose words are kept in a file and shown, too.
    fn must(&self, call: &Call, log: &str) -> Result<()> {
        let log = self.file(log);
        self.runner.must(call, Messages::Kept(&log))?;
        show(&log, 0);
        Ok(())
    }
}

/// The steps that calibration sees where it does not see all: of several tests those of each that has some, as `NAME=A:B,…`.
fn seen(case: &Case) -> Option<String> {
    let of = |test: &Test| {
        let steps = test.steps.as_ref()?;
        Some(if test.name.is_empty() { steps.clone() } else { format!("{}={steps}", test.name) })
    };
    let all: Vec<String> = case.tests.iter().filter_map(of).collect();
    (!all.is_empty()).then(|| all.join(","))
}

/// Put a text into a file so that what depends on it is made again.
pub(crate) fn renew(from: &Path, to: &Path) -> Result<()> {
    gl_table::write_whole(to, &std::fs::read(from)?)
}

/// How far the gap is foretold to close by each cause, the likeliest first.
const FORETOLD: &str = "predicted-shrink.txt";

/// The errors of the rig in what comes first.
const RIG: &str = "rig.txt";

/// The readings that look like outliers beside it, and how many times the stated noise they scatter.
const OUTLIERS: &str = "outliers.txt";
const NOISE: &str = "noise.txt";

/// Whether what is foretold first is of this cause.
fn is_of(foretold: &Path, first: &str) -> Result<bool> {
    let table = Table::read(foretold)?;
    if table.is_empty() {
        return Ok(false);
    }
    let hypothesis = table.field(0, table.format().column("hypothesis")?);
    Ok(cause(hypothesis) == first)
}
