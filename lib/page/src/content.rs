//! What a page says, gathered from the tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_case::Winner;
use gl_case::folders::{self, SHRINK_BETWEEN, SHRINK_UNSEEN};
use gl_case::shell::quoted;
use gl_figure::number::{short, significant};
use gl_gap::attribute::attribution::UNEXPLAINED;
use gl_gap::attribute::rounds::SHARP;
use gl_gap::attribute::winner::MostProbable;
use gl_inference::collect::RunStatus;
use gl_inference::times::{TIMES, Took};
use gl_table::Table;
use gl_table::verdict::is_doubt;
use serde::Serialize;

use crate::calibration::{Calibration, Standing, side_by_side};
use crate::case::Case;
use crate::grid::Grid;
use crate::pictures::{self, Picture};
use crate::verdict::{self, Sentence};
use crate::{rows, text};

/// Everything on a page, in its order.
#[derive(Debug, Serialize)]
pub struct Content {
    name: String,
    /// Where the tables are.
    folder: String,
    is_diagnosis: bool,
    /// What answers the question of a diagnosis.
    answer: Option<Answer>,
    /// What was concluded, in the order of the tools.
    conclusions: Vec<String>,
    /// What speaks against trusting it.
    doubts: Vec<String>,
    /// Runs by what they were made for.
    runs: Vec<Runs>,
    case: About,
    base: Stage,
    gap: Option<Gap>,
    cause: Option<Cause>,
    closed: Option<Closed>,
    failed: Failed,
    again: Again,
}

/// What comes first, and what speaks against it.
#[derive(Debug, Serialize)]
struct Answer {
    /// See [`Sentence`].
    code: String,
    /// The effects, joined by `+`, or `unexplained` or `none`, where they are named.
    value: String,
    /// Whether no run shows that it closes anything.
    is_unproven: bool,
    /// Whether noise alone may make what something unknown does.
    may_be_noise: bool,
    /// Whether runs with it in the simulation leave it open that the gap closes at all.
    is_refuted: bool,
    /// How much of the gap closed with it in the simulation, in per cent, where that is less than half.
    closed: Option<String>,
    /// Whether the calibration with it in fits badly, for no noise or outliers that were told of.
    misfits: bool,
    /// Its probability, with two digits, where that leaves room for doubt.
    probability: Option<String>,
}

/// What a page says already, so that it is no doubt of a calibration by itself.
#[derive(Clone, Copy, Default)]
struct Said {
    /// That the model misses the measurement, which is what is to be explained.
    of_gap: bool,
    /// How the readings scatter.
    of_noise: bool,
    /// What the bounds are worth: the model with the effect in has others.
    of_bounds: bool,
}

/// How many runs something took.
#[derive(Debug, Serialize)]
struct Runs {
    what: String,
    /// Those that were made for it.
    made: usize,
    /// Those that had been made before and serve here, too.
    reused: usize,
    failed: usize,
    /// How long they took, where that is known.
    time: Option<String>,
}

/// What was calibrated.
#[derive(Debug, Serialize)]
struct About {
    /// The first paragraph of its README.
    about: Option<String>,
    control: String,
    observables: Vec<String>,
    steps: usize,
    noise: String,
    /// Each test, where there are several.
    tests: Vec<OneTest>,
    params: Grid,
    /// Parameters of effects that were off.
    off: Vec<String>,
    file: String,
    text: String,
    checksums: Grid,
}

/// One of several tests.
#[derive(Debug, Serialize)]
struct OneTest {
    name: String,
    control: String,
    observables: Vec<String>,
    steps: usize,
    noise: String,
    /// What is known of it, `NAME = VALUE`.
    given: Vec<String>,
}

/// A calibration: of the base model, or with an effect in.
#[derive(Debug, Serialize)]
struct Stage {
    folder: String,
    standing: Standing,
    verdict: Vec<Sentence>,
    course: Grid,
    criteria: Grid,
    posterior: Grid,
    fit: Picture,
    /// Each reading, predicted from the others; none where the posterior is one of weights.
    predictive: Option<Picture>,
    pictures: Vec<Picture>,
}

#[derive(Debug, Serialize)]
struct Gap {
    verdict: Vec<Sentence>,
    pictures: Vec<Picture>,
    stretches: Grid,
}

#[derive(Debug, Serialize)]
struct Cause {
    verdict: Vec<Sentence>,
    #[serde(skip)]
    most_probable: MostProbable,
    /// Parameters as they are known beside a rest, if the most probable cause is beside one: `NAME LOW to HIGH`.
    #[serde(skip)]
    beside_a_rest: Vec<String>,
    picture: Picture,
    /// The curves of the most probable hypotheses; none where a diagnosis left none.
    curves: Option<Picture>,
    design_runs: usize,
    hypotheses: usize,
    first: Grid,
    effects: Grid,
    emulators: Vec<Picture>,
}

#[derive(Debug, Serialize)]
struct Closed {
    /// What was put in; empty if nothing explains the gap.
    with: String,
    /// The errors of the rig in it, with their sizes; empty if there are none.
    rig: String,
    measured: Option<Measured>,
}

#[derive(Debug, Serialize)]
struct Measured {
    verdict: Vec<Sentence>,
    /// The folders of the fits that it was measured between, where these are the closest ones and not the calibrations.
    closest: Vec<String>,
    shrink: Grid,
    unseen: Option<Unseen>,
    side_by_side: Grid,
    stage: Stage,
}

/// The gap on steps that calibration did not see.
#[derive(Debug, Serialize)]
struct Unseen {
    seen: String,
    verdict: Vec<Sentence>,
    shrink: Grid,
}

#[derive(Debug, Serialize)]
struct Failed {
    count: usize,
    /// How many for each reason, the most frequent first.
    reasons: Vec<(usize, String)>,
    first: Grid,
}

#[derive(Debug, Serialize)]
struct Again {
    command: String,
    engine: String,
    seed: String,
    version: &'static str,
}

/// Hypotheses and failed runs that a page lists.
const MOST_HYPOTHESES: usize = 8;
const MOST_FAILED: usize = 50;

/// Where the gap lies, if none stands out of what the base model's calibration leaves open, and yet there is one.
const NOWHERE: &str = "Where the gap lies cannot be said: no stretch of it stands out of the noise and of the spread that the calibration of the base model has, which takes what it misses for noise.";

/// The code of how many times the stated noise readings scatter.
const NOISE_SCALE: &str = "noise-scale";

impl Content {
    /// Read what there is.
    ///
    /// # Errors
    /// If a table cannot be read, or a picture cannot be drawn.
    pub fn gather(case: &Case, out: &Path, base: &Path) -> Result<Self> {
        let is_diagnosis = out != base;
        let base = Calibration::read(base)?;
        let winner = Winner::read(out)?;
        let after = match &winner {
            Some(winner) if !winner.is_nothing() => Some(Calibration::read(&winner.folder(out))?),
            _ => None,
        };
        let gap = Gap::gather(case, out, &base, after.as_ref())?;
        let cause = Cause::gather(case, out)?;
        let closed = Closed::gather(case, out, &base, winner.as_ref(), after.as_ref())?;
        let base_stage = Stage::gather(
            case,
            &base,
            "The measurement, the posterior’s mean and 90 % band, and what is left over.",
        )?;
        let failed = Failed::gather(case, &base, after.as_ref(), out)?;
        let mut content = Self {
            name: case.name(),
            folder: out.display().to_string(),
            is_diagnosis,
            answer: None,
            conclusions: Vec::new(),
            doubts: Vec::new(),
            runs: runs(case, (&base, &base_stage), closed.as_ref(), after.as_ref(), out)?,
            case: About::gather(case, &base)?,
            gap,
            cause,
            closed,
            failed,
            again: Again::gather(case, out, is_diagnosis, &base),
            base: base_stage,
        };
        content.conclude();
        Ok(content)
    }

    /// Sort the verdicts into what is concluded and what is doubtful.
    fn conclude(&mut self) {
        let answer =
            self.cause.iter().flat_map(|cause| &cause.verdict).find(|of| verdict::is_answer(&of.code));
        let has_gap = answer.is_some_and(|answer| answer.value != "none");
        let of_gap = self.gap.iter_mut().flat_map(|gap| &mut gap.verdict);
        for nowhere in of_gap.filter(|sentence| has_gap && sentence.code == "no-gap") {
            NOWHERE.clone_into(&mut nowhere.text);
        }
        let measured = self.closed.as_ref().and_then(|closed| closed.measured.as_ref());
        let of_gap = self.gap.iter().flat_map(|gap| &gap.verdict);
        let of_cause = self.cause.iter().flat_map(|cause| &cause.verdict);
        let of_shrink = measured.iter().flat_map(|measured| &measured.verdict);
        let of_unseen = measured
            .iter()
            .filter_map(|measured| measured.unseen.as_ref())
            .flat_map(|unseen| &unseen.verdict);
        // How the readings scatter is said once, by who knows most.
        let is_told = of_cause.clone().any(|sentence| sentence.code == NOISE_SCALE);
        let is_new = |sentence: &&Sentence| !is_told || sentence.code != NOISE_SCALE;
        let of_others = of_shrink.chain(of_unseen).chain(of_gap).filter(is_new);
        let all: Vec<&Sentence> = of_cause.chain(of_others).collect();
        // That a gap is spread is no doubt where its cause is known.
        let has_cause =
            answer.is_some_and(|of| matches!(of.code.as_str(), "cause" | "cause-with-rest" | "part"));
        let is_doubt =
            |sentence: &&&Sentence| is_doubt(&sentence.code) && !(has_cause && sentence.code == "smooth");
        let say = |sentence: &&Sentence| sentence.text.clone();
        let named = answer.zip(self.cause.as_ref()).and_then(|(answer, of)| of.named(&answer.value));
        self.answer = answer.map(|answer| Answer {
            code: answer.code.clone(),
            value: answer.value.clone(),
            is_unproven: all.iter().any(|sentence| sentence.code == "untried"),
            may_be_noise: all.iter().any(|sentence| sentence.code == "measure-again"),
            is_refuted: measured.is_some_and(|of| verdict::closes_nothing(&of.verdict)),
            closed: measured.and_then(|of| verdict::closes_little(&of.verdict)),
            misfits: !all.iter().any(|sentence| matches!(sentence.code.as_str(), NOISE_SCALE | "outliers"))
                && measured.is_some_and(|of| of.stage.verdict.iter().any(|row| row.code == "bad-fit")),
            probability: named.filter(|of| of.probability < SHARP).map(|of| format!("{:.2}", of.probability)),
        });
        self.conclusions = all.iter().filter(|sentence| !is_doubt(sentence)).map(say).collect();
        self.doubts = all.iter().filter(is_doubt).map(say).collect();
        // What the base model lacks pulls at its parameters.
        let said = Said { of_gap: has_gap, of_noise: is_told, of_bounds: has_gap && measured.is_some() };
        self.doubts.extend(self.base.doubts(self.is_diagnosis.then_some("the base model"), said));
        if let (Some(measured), Some(closed)) = (measured, &self.closed) {
            let whose = format!("the model with {}", closed.with);
            let said = Said { of_noise: is_told, ..Said::default() };
            self.doubts.extend(measured.stage.doubts(Some(&whose), said));
            if named.is_some_and(|of| of.is_beside_a_rest) {
                let known = self.cause.iter().flat_map(|of| &of.beside_a_rest).map(String::as_str);
                self.doubts.push(format!(
                    "Something else is at work beside {}, and pulls at the parameters of {whose}: their intervals do not know of it, and may well be too narrow. gl-gap-attribute counts with it, and has (90 % intervals) {}.",
                    closed.with,
                    known.collect::<Vec<_>>().join(", ")
                ));
            }
        }
    }
}

impl Stage {
    fn gather(case: &Case, calibration: &Calibration, caption: &str) -> Result<Self> {
        Ok(Self {
            folder: calibration.folder.display().to_string(),
            standing: calibration.standing()?,
            verdict: calibration.verdict.clone(),
            course: calibration.course()?,
            criteria: calibration.criteria()?,
            posterior: calibration.posterior(&case.prior)?,
            fit: calibration.fit(case, caption)?,
            predictive: calibration.predictive(case)?,
            pictures: calibration.pictures(case)?,
        })
    }

    /// What speaks against trusting this calibration, that of `whose` model where there are several, but for what is said already.
    fn doubts(&self, whose: Option<&str>, said: Said) -> Vec<String> {
        let of = whose.map(|whose| format!(" of {whose}")).unwrap_or_default();
        let mut doubts = Vec::new();
        if let Some(times) = &self.standing.tempering {
            doubts.push(format!(
                "The calibration{of} is not at its end: sigma is still {times} times that of the noise."
            ));
        }
        if self.standing.rests_on_few {
            doubts.push(format!(
                "The posterior{of} rests on {} runs, which is few: the means are rough, the intervals widened.",
                self.standing.ess_runs
            ));
        }
        let is_said = |code: &str| match code {
            // These two are said above.
            "sigma-above-noise" | "few-runs" => true,
            "bad-fit" | "too-few-inside" => said.of_gap,
            "noise-too-small" | "noise-correlated" => said.of_gap || said.of_noise,
            "noise-too-large" => said.of_noise,
            "leans" => said.of_bounds,
            _ => false,
        };
        let own = self.verdict.iter().filter(|row| is_doubt(&row.code) && !is_said(&row.code));
        doubts.extend(own.map(|row| match whose {
            Some(whose) => format!("In {whose}: {}", row.text),
            None => row.text.clone(),
        }));
        doubts
    }
}

impl About {
    fn gather(case: &Case, base: &Calibration) -> Result<Self> {
        let checksum = |path: &Path| {
            let bytes = gl_table::read_bytes(path)?;
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Ok(vec![name, bytes.len().to_string(), cksum(&bytes).to_string()])
        };
        let files = [case.file.clone(), case.params.clone()].into_iter().chain(case.measurements());
        let checksums = files.map(|path| checksum(&path)).collect::<Result<Vec<_>>>()?;
        Ok(Self {
            about: text(&case.folder.join("README.md")).ok().and_then(|readme| first_paragraph(&readme)),
            control: case.control.clone(),
            observables: case.observables.clone(),
            steps: rows(&case.obs)?,
            noise: case.noise.replace(',', ", "),
            tests: case.tests.iter().map(OneTest::gather).collect::<Result<_>>()?,
            params: Grid::read(&case.params, usize::MAX)?,
            off: base.still(),
            file: case.file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            text: text(&case.file)?,
            checksums: Grid::new(["file", "bytes", "checksum (cksum)"], checksums),
        })
    }
}

impl OneTest {
    fn gather(test: &gl_case::Test) -> Result<Self> {
        Ok(Self {
            name: test.name.clone(),
            control: test.control.measured.clone(),
            observables: test.observable_names(),
            steps: rows(&test.obs)?,
            noise: test.noise.to_string().replace(',', ", "),
            given: test.given.iter().map(|(name, value)| format!("{name} = {value}")).collect(),
        })
    }
}

impl Gap {
    fn gather(
        case: &Case,
        out: &Path,
        base: &Calibration,
        after: Option<&Calibration>,
    ) -> Result<Option<Self>> {
        let table = out.join("locate.txt");
        if !table.exists() {
            return Ok(None);
        }
        let located = out.join("locate-after.txt");
        let after = after.filter(|_| located.exists());
        Ok(Some(Self {
            verdict: verdict::read(&out.join("locate-verdict.txt"))?,
            pictures: pictures::gaps(case, &table, base, after.map(|after| (located.as_path(), after)))?,
            stretches: Grid::read(&table, usize::MAX)?.only("significant", "yes").without("significant"),
        }))
    }
}

impl Cause {
    fn gather(case: &Case, out: &Path) -> Result<Option<Self>> {
        let hypotheses = out.join("attribution.txt");
        if !hypotheses.exists() {
            return Ok(None);
        }
        let design = out.join("design");
        let most_probable = MostProbable::of(&Table::read(&hypotheses)?)?;
        Ok(Some(Self {
            verdict: verdict::read(&out.join("attribution-verdict.txt"))?,
            beside_a_rest: beside_a_rest(&most_probable, &out.join("posterior.txt"))?,
            most_probable,
            picture: pictures::attribution(&out.join("effects.txt"), &hypotheses)?,
            curves: pictures::hypotheses(case, &out.join("curves.txt"))?,
            design_runs: rows(&design.join("samples.txt"))?,
            hypotheses: rows(&hypotheses)?,
            first: Grid::read(&hypotheses, MOST_HYPOTHESES)?,
            effects: Grid::read(&out.join("effects.txt"), usize::MAX)?,
            emulators: case
                .measured()
                .iter()
                .map(|of| pictures::emulator(case, of, &design))
                .collect::<Result<_>>()?,
        }))
    }

    /// What is most probable, where that is what the page names.
    fn named(&self, effects: &str) -> Option<&MostProbable> {
        Some(&self.most_probable).filter(|of| of.cause == effects)
    }
}

/// See [`Cause::beside_a_rest`], from what `gl-gap-attribute` wrote with `--posterior-out`.
fn beside_a_rest(most_probable: &MostProbable, posterior: &Path) -> Result<Vec<String>> {
    if !most_probable.is_beside_a_rest {
        return Ok(Vec::new());
    }
    let table = Table::read(posterior)?;
    let column = |name| table.format().column(name);
    let (hypothesis, parameter, low, high) =
        (column("hypothesis")?, column("parameter")?, column("q05")?, column("q95")?);
    let name = format!("{}+{UNEXPLAINED}", most_probable.cause);
    (0..table.len())
        .filter(|&row| table.field(row, hypothesis) == name)
        .map(|row| {
            let [low, high] = [low, high].map(|column| table.number(row, column).map(short));
            Ok(format!("{} {} to {}", table.field(row, parameter), low?, high?))
        })
        .collect()
}

impl Closed {
    fn gather(
        case: &Case,
        out: &Path,
        base: &Calibration,
        winner: Option<&Winner>,
        after: Option<&Calibration>,
    ) -> Result<Option<Self>> {
        let table = out.join("shrink.txt");
        let (Some(winner), true) = (winner, table.exists()) else { return Ok(None) };
        let (with, rig) = (winner.names().join(" and "), winner.rig.to_string());
        let Some(after) = after else { return Ok(Some(Self { with, rig, measured: None })) };
        let [unseen, unseen_verdict, _] = SHRINK_UNSEEN.map(|file| out.join(file));
        let unseen = if unseen.exists() {
            Some(Unseen {
                seen: case.steps.clone(),
                verdict: verdict::read(&unseen_verdict)?,
                shrink: Grid::read(&unseen, usize::MAX)?,
            })
        } else {
            None
        };
        let between = Table::read(&out.join(SHRINK_BETWEEN))?;
        let folders = between.format().column("folder")?;
        let closest = (0..between.len()).map(|row| out.join(between.field(row, folders)));
        let closest = closest.filter(|folder| *folder != base.folder && *folder != after.folder);
        let measured = Measured {
            closest: closest.map(|folder| folder.display().to_string()).collect(),
            verdict: verdict::read(&out.join("shrink-verdict.txt"))?,
            shrink: Grid::read(&table, usize::MAX)?,
            unseen,
            side_by_side: side_by_side(base, after, &case.prior, &with)?,
            stage: Stage::gather(case, after, &format!("The fit with {with} in."))?,
        };
        Ok(Some(Self { with, rig, measured: Some(measured) }))
    }
}

impl Failed {
    fn gather(case: &Case, base: &Calibration, after: Option<&Calibration>, out: &Path) -> Result<Self> {
        let iterations = base.iterations.iter().chain(after.iter().flat_map(|after| &after.iterations));
        let design = out.join("design");
        let mut failed = Vec::new();
        for folder in iterations.chain([&design]) {
            failed.extend(failed_runs(&folder.join("status.txt"))?);
            for test in &case.tests {
                let of_test = failed_runs(&folder.join(&test.name).join("status.txt"))?;
                let named =
                    |row: RunStatus| RunStatus { sample: format!("{} of {}", row.sample, test.name), ..row };
                failed.extend(of_test.into_iter().map(named));
            }
        }
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for row in &failed {
            *counts.entry(&row.status).or_default() += 1;
        }
        let mut reasons: Vec<(usize, String)> =
            counts.into_iter().map(|(reason, count)| (count, reason.to_owned())).collect();
        reasons.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        let count = failed.len();
        failed.truncate(MOST_FAILED);
        let cells = failed.into_iter().map(|row| vec![row.sample, row.status, row.detail]).collect();
        Ok(Self { count, reasons, first: Grid::new(["run", "status", "detail"], cells) })
    }
}

/// The runs that a status table leaves out; none where there is no table.
fn failed_runs(path: &Path) -> Result<Vec<RunStatus>> {
    if path.exists() { RunStatus::failed(path) } else { Ok(Vec::new()) }
}

impl Again {
    fn gather(case: &Case, out: &Path, is_diagnosis: bool, base: &Calibration) -> Self {
        let word = |path: &Path| quoted(&path.display().to_string());
        let mut command = vec![if is_diagnosis { "gl-diagnose" } else { "gl-calibrate" }.to_owned()];
        command.extend([
            word(&case.folder),
            "--engine".to_owned(),
            case.engine.to_string(),
            "--out".to_owned(),
            word(out),
        ]);
        command.extend(case.given.iter().map(|setting| quoted(setting)));
        // Where no criterion ended it, the number of iterations did.
        let is_given = case.given.iter().any(|setting| setting.to_lowercase().starts_with("iterations="));
        if !base.is_done && !is_given {
            command.push(format!("iterations={}", base.iterations.len()));
        }
        Self {
            command: command.join(" "),
            engine: case.engine.to_string(),
            seed: case.seed.to_string(),
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// How many runs each part took, and how long.
fn runs(
    case: &Case,
    (base, base_stage): (&Calibration, &Stage),
    closed: Option<&Closed>,
    after: Option<&Calibration>,
    out: &Path,
) -> Result<Vec<Runs>> {
    let of = |what: String, (used, failed): (usize, usize), folders: &[PathBuf]| -> Result<Runs> {
        let made = folders.iter().map(|folder| rows(&folder.join("samples.txt"))).sum::<Result<usize>>()?;
        Ok(Runs { what, made, reused: used.saturating_sub(made), failed, time: time(case, folders)? })
    };
    let of_calibration = |what: String, standing: &Standing, calibration: &Calibration| {
        of(what, (standing.runs, standing.failed), &calibration.iterations)
    };
    let mut runs = vec![of_calibration("calibration".to_owned(), &base_stage.standing, base)?];
    let design: PathBuf = out.join("design");
    if design.join("samples.txt").exists() {
        let failed = failed_runs(&design.join("status.txt"))?.len();
        let rounds: Vec<_> =
            (0..).map(|i| design.join(format!("round{i}"))).take_while(|round| round.exists()).collect();
        runs.push(of("design".to_owned(), (rows(&design.join("samples.txt"))?, failed), &rounds)?);
    }
    let measured = closed.and_then(|closed| Some((closed, closed.measured.as_ref()?)));
    if let (Some((closed, measured)), Some(after)) = (measured, after) {
        runs.push(of_calibration(format!("with {}", closed.with), &measured.stage.standing, after)?);
        // They are made whether or not the gap is measured between them.
        let made = [base, after].map(|of| folders::closest(&of.folder));
        for folder in made.iter().filter(|folder| folder.join("posterior.txt").exists()) {
            let closest = Calibration::read(folder)?;
            runs.push(of_calibration("closest fit".to_owned(), &closest.standing()?, &closest)?);
        }
    }
    Ok(runs)
}

/// How long the runs of some iterations or rounds took, where that is known.
fn time(case: &Case, folders: &[PathBuf]) -> Result<Option<String>> {
    let of = |folder: &PathBuf| {
        let names: Vec<&str> = match case.tests.as_slice() {
            [] => vec![""],
            tests => tests.iter().map(|test| test.name.as_str()).collect(),
        };
        names.into_iter().map(|name| folder.join(name).join("runs").join(TIMES)).collect::<Vec<_>>()
    };
    Ok(Took::of(folders.iter().flat_map(of))?.map(|took| {
        format!(
            "{} each by the clock (median of {}), {} of processor time in all",
            duration(took.median_seconds),
            took.runs,
            duration(took.processor_seconds)
        )
    }))
}

/// A time for a reader.
fn duration(seconds: f64) -> String {
    let (number, unit) = match seconds {
        s if s < 1e-3 => (1e6 * s, "µs"),
        s if s < 1.0 => (1e3 * s, "ms"),
        s if s < 100.0 => (s, "s"),
        s if s < 6000.0 => (s / 60.0, "min"),
        s => (s / 3600.0, "h"),
    };
    format!("{} {unit}", significant(number, 2))
}

/// The first paragraph of a Markdown text that is no heading, table or code.
fn first_paragraph(markdown: &str) -> Option<String> {
    let is_prose = |line: &&str| !line.starts_with(['#', '|']) && !line.starts_with("    ");
    let lines = markdown.lines().skip_while(|line| line.trim().is_empty() || !is_prose(line));
    let paragraph: Vec<&str> = lines.take_while(|line| !line.trim().is_empty() && is_prose(line)).collect();
    (!paragraph.is_empty()).then(|| without_links(&paragraph.join(" ").replace('`', "")))
}

/// The words of `[words](address)`; what is no link stays.
fn without_links(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('[') {
        plain += before;
        rest = match after.split_once("](").and_then(|(words, to)| Some((words, to.split_once(')')?.1))) {
            Some((words, behind)) if !words.contains(['[', ']']) => {
                plain += words;
                behind
            }
            _ => {
                plain.push('[');
                after
            }
        };
    }
    plain + rest
}

/// The checksum of POSIX `cksum`: the CRC of the bytes and then of their number, lowest byte first.
fn cksum(bytes: &[u8]) -> u32 {
    let length = bytes.len() as u64;
    let used = (8 - length.leading_zeros() as usize / 8).min(8);
    let each = bytes.iter().copied().chain(length.to_le_bytes().into_iter().take(used));
    let crc = each.fold(0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(byte) << 24, |crc, _| {
            if crc & 0x8000_0000 == 0 { crc << 1 } else { crc << 1 ^ 0x04c1_1db7 }
        })
    });
    !crc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_paragraph_is_neither_heading_nor_table() {
        let markdown = "# Title\n\n| a |\n\nTwo `spheres`\ncollide.\n\nMore.\n";
        assert_eq!(first_paragraph(markdown).unwrap(), "Two spheres collide.");
        assert_eq!(first_paragraph("# Title\n"), None);
        let markdown = "As [that](../that#a), [x] and [y](.) of a[1](b) [z](\n";
        assert_eq!(first_paragraph(markdown).unwrap(), "As that, [x] and y of a1 [z](");
    }

    #[test]
    fn times_are_told_in_the_unit_that_fits() {
        let told = [0.0, 2.13e-4, 0.0123, 59.2, 100.0, 5999.0, 7200.0].map(duration);
        assert_eq!(told, ["0 µs", "210 µs", "12 ms", "59 s", "1.7 min", "100 min", "2 h"]);
    }

    #[test]
    fn the_checksum_is_that_of_cksum() {
        // printf '' | cksum; printf 123456789 | cksum (coreutils 9.4)
        assert_eq!([cksum(b""), cksum(b"123456789")], [4_294_967_295, 930_766_865]);
    }
}
