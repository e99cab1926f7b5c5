//! Whether a case can be run, asked before the first run: its tables, the names in it, its model, the engine.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow, bail, ensure};
use gl_case::{Case, Engine, Posterior, Test, suggestion};
use gl_cli::measured::far_off;
use gl_engine::batch_table::BatchTable;
use gl_engine::embedded::simulator;
use gl_engine::model::{Model, find_program, split_words, yade_script};
use gl_inference::misfit::{Covariance, Scaling};
use gl_inference::observations::{Observations, Steps};
use gl_inference::prior::{Effect, Prior};
use gl_inference::samples::{check_parameter_name, sample_names};
use gl_table::verdict::Verdicts;

use crate::arguments::{Request, Results};
use crate::columns::within;
use crate::forecast::Plan;
use crate::step::time;

/// Check a case, and say what a calibration and a diagnosis of it would take.
///
/// # Errors
/// With all that is wrong.
pub fn check_case(request: &Request) -> Result<Verdicts> {
    let case = request.load()?;
    let (engine, model) = case.engine(request.engine)?;
    let (prior, observations) = check(&case, engine, model)?;
    let plan = Plan { case: &case, prior: &prior, observations: &observations };
    let mut verdicts = Verdicts::default();
    let told = case.tests.iter().zip(&observations).map(|(test, observations)| {
        let noise = observations.noise(&test.noise)?;
        let of = if test.name.is_empty() { String::new() } else { format!(" in {}", test.name) };
        Ok(format!(
            "{} of {} on {}{of}; the noise is {}",
            counted(observations.steps(), "reading"),
            test.observable_names().join(", "),
            test.control.measured,
            if noise.is_some() { "known" } else { "estimated" }
        ))
    });
    let told = told.collect::<Result<Vec<_>>>()?.join("; ");
    let parameters = counted(prior.names().len(), "parameter");
    verdicts.add("case", &case.name, format!("{}: {parameters} against {told}", case.folder.display()));
    verdicts.add("parameters", prior.names().len(), roles(&prior, &case));
    verdicts.add("engine", engine, format!("the engine {engine} runs: {model}"));
    if let Some((readings, text)) = untold_noise(&case, &prior, &observations)? {
        verdicts.add("noise-untold", readings, text);
    }
    let (readings, base) = (number_of_readings(&observations), prior.base().len());
    if readings < base {
        verdicts.add("few-readings", readings, format!(
            "{} against {} of the base model: together they stay as open as they were beforehand along what no reading tells",
            counted(readings, "reading"),
            counted(base, "parameter")
        ));
    }
    let commands = commands(&case, engine)?;
    if commands.iter().any(|command| !command.is_told_its_name()) {
        verdicts.add(
            "unnamed",
            "-",
            "no run has {description} in its command, which says what its results are to be called, {description}_sim.txt",
        );
    }
    for name in unused(&commands, &prior) {
        verdicts.add(
            "unused",
            &name,
            format!("no run has {{{name}}} in its command, so that it changes nothing"),
        );
    }
    let out = request.folder(Results::Calibration)?;
    plan.forecast(&out, &request.folder(Results::Diagnosis)?, &mut verdicts)?;
    let runs = if prior.effects().is_empty() { plan.calibration() } else { plan.diagnosis() };
    let (needed, free) = plan.room(runs, &out)?;
    let text = format!("they take about {needed} MB at the most, on a disk that has {free} MB free");
    verdicts.add("megabytes", needed, text);
    Ok(verdicts)
}

/// The parameters of the base model, and the candidate effects with theirs.
fn roles(prior: &Prior, case: &Case) -> String {
    let names: Vec<String> = prior.base().into_iter().map(|of| prior.parameters()[of].name.clone()).collect();
    let base = format!("parameters of the base model: {}", names.join(", "));
    let of_effect = |effect: Effect| {
        let own: Vec<&str> =
            effect.parameters.iter().map(|&of| prior.parameters()[of].name.as_str()).collect();
        format!("{} ({})", effect.name, own.join(", "))
    };
    let mut effects: Vec<String> = prior.effects().into_iter().map(of_effect).collect();
    effects.extend(case.measurement.iter().map(|kind| format!("{kind} of the rig")));
    if effects.is_empty() { base } else { format!("{base}; candidate effects: {}", effects.join(", ")) }
}

fn number_of_readings(observations: &[Observations]) -> usize {
    observations.iter().flat_map(|of| &of.values).map(Vec::len).sum()
}

/// Number of readings and what is wrong with it, where a fit by as many parameters leaves nothing that an estimate of the noise
/// could rest on.
pub(crate) fn untold_noise(
    case: &Case,
    prior: &Prior,
    observations: &[Observations],
) -> Result<Option<(usize, String)>> {
    let is_given = |(test, of): (&Test, &Observations)| Ok(of.noise(&test.noise)?.is_some());
    if case.tests.iter().zip(observations).map(is_given).collect::<Result<Vec<_>>>()?.contains(&true) {
        return Ok(None);
    }
    let (readings, parameters) = (number_of_readings(observations), prior.base().len());
    Ok((readings <= parameters).then(|| {
        let text = format!(
            "{} against {} and no noise: a fit that leaves nothing says nothing of the noise, and the posterior follows from a guess; \
             give it, as noise = {{ {} = … }} in {}",
            counted(readings, "reading"),
            counted(parameters, "parameter"),
            case.tests[0].observable_names()[0],
            case.folder.join("case.toml").display()
        );
        (readings, text)
    }))
}

/// What runs in each test, but for engines that take a whole table.
fn commands(case: &Case, engine: Engine) -> Result<Vec<Model>> {
    if matches!(engine, Engine::Embedded | Engine::YadeBatch) {
        return Ok(Vec::new());
    }
    let command = |test: &Test| {
        let model = case.model_of(test, engine)?;
        Ok(match yade_script(&model, &case.folder) {
            Some(script) => Model::Yade(script.into()),
            None => Model::Command(split_words(&model)?),
        })
    };
    case.tests.iter().map(command).collect()
}

/// A file of the model that was changed since the first runs in a folder were made, which are kept.
///
/// # Errors
/// If the command of a test, or when a file was changed, cannot be read.
pub(crate) fn changed_since_runs(case: &Case, engine: Engine, out: &Path) -> Result<Option<PathBuf>> {
    let Some(made) = first_runs_made(case, &out.join("iter0"))? else { return Ok(None) };
    let models = match engine {
        Engine::YadeBatch => vec![Model::Yade(case.engine(Some(engine))?.1.into())],
        _ => commands(case, engine)?,
    };
    for file in models.iter().flat_map(|model| model.files(&case.folder)) {
        if time(&file)?.is_some_and(|changed| changed > made) {
            return Ok(Some(file));
        }
    }
    Ok(None)
}

/// When the runs of an iteration were made: their tables, or the first of them where none could be collected.
fn first_runs_made(case: &Case, iteration: &Path) -> Result<Option<SystemTime>> {
    let mut made = Vec::new();
    for folder in case.tests.iter().map(|test| within(iteration, test)) {
        let collected = time(&folder.join("ensemble.txt"))?;
        let first_run = || {
            let runs = fs::read_dir(folder.join("runs")).into_iter().flatten().flatten();
            let is_result = |run: &fs::DirEntry| run.file_name().as_encoded_bytes().ends_with(b"_sim.txt");
            runs.filter(is_result).filter_map(|run| run.metadata().ok()?.modified().ok()).min()
        };
        made.extend(collected.or_else(first_run));
    }
    Ok(made.into_iter().min())
}

/// Parameters that no command is given.
fn unused(commands: &[Model], prior: &Prior) -> Vec<String> {
    let all = prior.names();
    let unused: Vec<Vec<&str>> = commands.iter().map(|command| command.unused(&all)).collect();
    let is_unused =
        |name: &&String| !unused.is_empty() && unused.iter().all(|own| own.contains(&name.as_str()));
    all.iter().filter(is_unused).cloned().collect()
}

/// `1 run`, `2 runs`.
pub(crate) fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Check all of a case that runs depend on, for a driver: the parameters, and what was measured.
///
/// # Errors
/// With all that is wrong, a line each; or if the disk has no room for the runs that the plan says.
pub(crate) fn ready(
    case: &Case,
    (engine, model): (Engine, &str),
    out: &Path,
    runs: fn(&Plan<'_>) -> usize,
) -> Result<(Prior, Vec<Observations>)> {
    let (prior, observations) = check(case, engine, model)?;
    let plan = Plan { case, prior: &prior, observations: &observations };
    plan.room(runs(&plan), out)?;
    Ok((prior, observations))
}

/// See to it that something is measured of which a gap can be told, before the runs that are to explain it.
///
/// # Errors
/// If an observable is the same at every step: a gap is a share of what it varies by.
pub(crate) fn varies(observations: &[Observations]) -> Result<()> {
    for of in observations {
        let same = of.values.iter().position(|values| values.iter().all(|value| *value == values[0]));
        if let Some(same) = same {
            bail!(
                "{}: {} does not vary over its {}, so that no gap in it can be told; give more of it, or leave it out of observables",
                of.source,
                of.names[same],
                counted(of.steps(), "reading")
            );
        }
    }
    Ok(())
}

/// Check all of a case that runs depend on: the parameters and the measurement.
fn check(case: &Case, engine: Engine, model: &str) -> Result<(Prior, Vec<Observations>)> {
    let mut problems = Problems::default();
    let tables = tables(case, &mut problems);
    if let (Some(prior), _) = &tables {
        if case.has_tests() {
            problems.note(check_model_of_tests(case, engine, prior));
        } else {
            problems.note(check_model(case, engine, model, prior, &case.tests[0]));
        }
    }
    problems.finish()?;
    match tables {
        (Some(prior), observations) => Ok((prior, observations)),
        _ => bail!("{}: no tables", case.folder.display()),
    }
}

/// Check the tables of a case and the names in it, for runs that are made elsewhere.
///
/// # Errors
/// With all that is wrong, a line each.
pub(crate) fn check_tables(case: &Case) -> Result<()> {
    let mut problems = Problems::default();
    tables(case, &mut problems);
    problems.finish()
}

/// What is wrong, a line each.
#[derive(Default)]
struct Problems(Vec<String>);

impl Problems {
    fn note<T>(&mut self, result: Result<T>) -> Option<T> {
        result.map_err(|error| self.0.push(format!("{error:#}"))).ok()
    }

    fn finish(self) -> Result<()> {
        if self.0.is_empty() { Ok(()) } else { bail!("{}", self.0.join("\n    ")) }
    }
}

fn tables(case: &Case, problems: &mut Problems) -> (Option<Prior>, Vec<Observations>) {
    let prior = problems.note(Prior::read(&case.params()));
    let mut observations = Vec::new();
    for test in &case.tests {
        observations.extend(problems.note(check_test(test)));
    }
    if observations.len() == case.tests.len() {
        problems.note(check_noises(case, &observations));
        problems.note(check_outliers(case, &observations));
    }
    problems.note(check_kept(case));
    problems.note(check_names(case, prior.as_ref()));
    problems.note(sample_names(&case.name, 0, 1).with_context(|| place(case, "name")));
    (prior, observations)
}

/// The measurement: that it has the columns, and that runs can be weighed against it.
fn check_test(test: &Test) -> Result<Observations> {
    let observations = Observations::read(&test.obs, &test.control.measured, &test.observable_names())?;
    let noise = observations.noise(&test.noise)?;
    if let Some(steps) = &test.steps {
        steps.parse::<Steps>()?.within(observations.steps())?;
    }
    if noise.is_none() {
        let scale = match test.scale.as_deref() {
            Some("value") => Scaling::Value,
            Some("range") => Scaling::Range,
            Some("none") => Scaling::None,
            _ => Scaling::Max,
        };
        Covariance::scaled(&observations, scale, &test.weights)?;
    }
    Ok(observations)
}

/// That the noise is known in all tests, or in none.
fn check_noises(case: &Case, observations: &[Observations]) -> Result<()> {
    let mut first: Option<(bool, &str)> = None;
    for (test, observations) in case.tests.iter().zip(observations) {
        let is_known = observations.noise(&test.noise)?.is_some();
        match first {
            Some((other, name)) if other != is_known => {
                let (known, not) = if other { (name, test.name.as_str()) } else { (&*test.name, name) };
                bail!(
                    "{}: the noise of the test {known} is known and that of {not} is not; give it for each, or for none",
                    case.places.of_setting("test")
                );
            }
            _ => first = Some((is_known, &test.name)),
        }
    }
    Ok(())
}

/// That the packed file of runs that were made before is there.
fn check_kept(case: &Case) -> Result<()> {
    let Some(kept) = &case.kept else { return Ok(()) };
    File::open(kept).with_context(|| format!("{}: {}", place(case, "kept"), kept.display()))?;
    Ok(())
}

/// That readings which are far off are some of those that are compared, and count for nothing where a posterior is drawn.
fn check_outliers(case: &Case, observations: &[Observations]) -> Result<()> {
    let Some(table) = &case.outliers else { return Ok(()) };
    ensure!(
        case.posterior == Posterior::Emulator,
        "{}: weights of runs take every reading; leave it out, or draw the posterior through an emulator",
        place(case, "outliers")
    );
    let mut compared = Vec::new();
    for (test, of) in case.tests.iter().zip(observations) {
        let steps = match &test.steps {
            Some(steps) if case.has_tests() => steps.parse::<Steps>()?.within(of.steps())?,
            _ => 0..of.steps(),
        };
        compared.extend(test.observable_names().iter().map(|name| (test.named(name), steps.clone())));
    }
    far_off(table, &compared).with_context(|| place(case, "outliers"))?;
    Ok(())
}

fn place(case: &Case, setting: &str) -> String {
    format!("{}: {}", case.places.of_setting(setting), setting.split('.').next().unwrap_or_default())
}

/// Names that are in no table.
fn check_names(case: &Case, prior: Option<&Prior>) -> Result<()> {
    let Some(prior) = prior else { return Ok(()) };
    let refuse = |key: &str, name: &str, known: &[String], what: &str| -> Result<()> {
        if known.iter().any(|other| other == name) {
            return Ok(());
        }
        let others =
            if known.is_empty() { "there are none".to_owned() } else { suggestion(name, known, "they are") };
        bail!("{}: no {what} {name}; {others}", place(case, &format!("{key}.{name}")))
    };
    let parameters = prior.names();
    for name in case.truth.names() {
        refuse("truth", name, &parameters, "parameter")?;
    }
    let mut axes = parameters.clone();
    for (i, test) in case.tests.iter().enumerate() {
        for (name, _) in &test.given {
            let at = case.places.of_setting(&format!("test.{i}.given.{name}"));
            check_parameter_name(name).map_err(|problem| anyhow!("{at}: given: {problem}"))?;
            ensure!(
                !parameters.contains(name),
                "{at}: given: {name} is a parameter, which is not known beforehand"
            );
        }
        if !test.name.is_empty() && test.obs.to_string_lossy().contains(':') {
            bail!(
                "{}: {}: a colon in the path of a test; call the folder otherwise",
                case.places.of_setting(&format!("test.{i}.obs")),
                test.obs.display()
            );
        }
        axes.extend([test.control.measured.clone()]);
        axes.extend(test.observable_names());
    }
    for (name, _) in &case.units {
        refuse("units", name, &axes, "column or parameter")?;
    }
    let effects: Vec<String> = prior.effects().into_iter().map(|effect| effect.name).collect();
    for name in &case.effects {
        refuse("effects", name, &effects, "effect")?;
    }
    Ok(())
}

/// The model of each test.
fn check_model_of_tests(case: &Case, engine: Engine, prior: &Prior) -> Result<()> {
    // Kept runs are taken by their parameters, which are all that a table of samples says.
    let same = (0..case.tests.len()).find_map(|i| {
        let is_same = |other: &&Test| engine == Engine::Embedded || other.given == case.tests[i].given;
        let other = case.tests[..i].iter().find(is_same)?;
        Some((&other.name, &case.tests[i].name))
    });
    if let (Some(_), Some((one, other))) = (&case.kept, same) {
        bail!(
            "{}: kept runs of {one} and of {other} cannot be told apart; give each test a column of its own, such as \
             given = {{ test = 1 }}, and a model by local or yade-batch",
            place(case, "kept")
        );
    }
    case.tests.iter().try_for_each(|test| {
        let model = case.model_of(test, engine)?;
        check_model(case, engine, &model, prior, test).with_context(|| format!("test {}", test.name))
    })
}

/// The model, and the programs that the engine needs.
fn check_model(case: &Case, engine: Engine, model: &str, prior: &Prior, test: &Test) -> Result<()> {
    // Whether the kept runs are all that is wanted, the engine says.
    if case.kept.is_some() && yade_script(model, &case.folder).is_some() && find_program("yade").is_none() {
        return Ok(());
    }
    let needs = |program: &str, what: &str| match find_program(program) {
        Some(_) => Ok(()),
        None => bail!("{program} is not installed, which the engine {engine} needs: {what}"),
    };
    match engine {
        Engine::Embedded => {
            return simulator(model, &case.folder).map(|_| ()).with_context(|| place(case, "model.embedded"));
        }
        Engine::Local => {}
        Engine::YadeBatch => needs("yade-batch", "apt-get install yade")?,
        Engine::Slurm => needs("sbatch", "call this on a login node of the cluster")?,
        Engine::Pbs => needs("qsub", "call this on a login node of the cluster")?,
    }
    let mut columns = vec!["description".to_owned(), "key".to_owned()];
    columns.extend(case.threads.map(|_| "!OMP_NUM_THREADS".to_owned()));
    columns.extend(prior.names());
    columns.extend(test.given.iter().map(|(name, _)| name.clone()));
    let table = BatchTable::parse("the samples", (columns.join("\t") + "\n").into_bytes())?;
    let checked =
        Model::check(model, &table, &case.folder).with_context(|| place(case, &format!("model.{engine}")))?;
    // Runs that are kept need none of it.
    if let Some(file) = checked.missing(&case.folder).filter(|_| case.kept.is_none()) {
        bail!("{}: no file {}", place(case, &format!("model.{engine}")), file.display());
    }
    if engine == Engine::YadeBatch && yade_script(model, &case.folder).is_none() {
        bail!("{}: yade-batch runs Yade scripts, which end in .py", place(case, "model.yade-batch"));
    }
    Ok(())
}
