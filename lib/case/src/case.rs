use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};
use gl_inference::observations::ByName;
use gl_inference::rig::Rig;
use gl_inference::stack::{self, is_test_name};
use toml::de::DeTable;

use crate::cluster::Cluster;
use crate::engine::Engine;
use crate::fields::fields_of;
pub use crate::file::Tolerances;
use crate::file::{File, TestEntry};
use crate::model::Model;
use crate::overrides::Override;
use crate::places::{Places, place, suggestion};

/// A column of a measurement, and what the runs call it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name in `obs.txt`.
    pub measured: String,
    /// Its name in the files of the runs.
    pub simulated: String,
}

impl Column {
    /// As `gl-collect` takes it: `e_a`, or `e_a=e_z`.
    pub fn renamed(&self) -> String {
        if self.measured == self.simulated {
            self.measured.clone()
        } else {
            format!("{}={}", self.measured, self.simulated)
        }
    }
}

impl FromStr for Column {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (measured, simulated) = text.split_once('=').unwrap_or((text, text));
        let (measured, simulated) = (measured.trim(), simulated.trim());
        let is_name = |name: &str| !name.is_empty() && !name.contains([',', '=', ' ', '\t', '#']);
        ensure!(
            is_name(measured) && is_name(simulated),
            "{text:?} is no column; give its name, or MEASURED=SIMULATED where the runs call it otherwise"
        );
        Ok(Self { measured: measured.to_owned(), simulated: simulated.to_owned() })
    }
}

/// One test: what was measured, and how runs are compared with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Test {
    /// Its name; empty in a case of one measurement, `obs.txt`.
    pub name: String,
    /// What is known of this test, by name: columns of its table of samples, and `{NAME}` in the model.
    pub given: Vec<(String, f64)>,
    /// Its own model, by engine.
    pub model: BTreeMap<Engine, String>,
    /// The table of the measurement.
    pub obs: PathBuf,
    /// What the experiment imposes.
    pub control: Column,
    /// What is compared.
    pub observables: Vec<Column>,
    /// Standard deviation of the noise, by measured observable; empty where it is not given.
    pub noise: ByName,
    /// How much an observable counts where the noise is not known; empty for all alike.
    pub weights: ByName,
    /// What misfits are measured against where the noise is not known: `max`, `value`, `range` or `none`.
    pub scale: Option<String>,
    /// The steps that calibration sees, `A:B`; all if absent.
    pub steps: Option<String>,
    /// Errors of the rig that are known, by their names in this test.
    pub rig: Rig,
}

impl Test {
    /// Names of the observables in the measurement.
    pub fn observable_names(&self) -> Vec<String> {
        self.observables.iter().map(|column| column.measured.clone()).collect()
    }

    /// What an observable is called beside those of other tests: `test.observable`.
    pub fn named(&self, observable: &str) -> String {
        stack::named(&self.name, observable)
    }
}

/// What the posterior is read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Posterior {
    /// Draws through an emulator of the runs.
    Emulator,
    /// The weights of real runs, with emulated samples between the iterations to draw the next ones from.
    Weights,
    /// The weights of the real runs alone.
    Runs,
}

/// A case: `case.toml`, and what was given for this call.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its folder.
    pub folder: PathBuf,
    /// The settings of this call, KEY=VALUE as they were given.
    pub given: Vec<String>,
    /// First part of the name of each run.
    pub name: String,
    /// Its table of parameters, from the folder.
    pub params: String,
    /// What was measured: one test, or several of the same samples.
    pub tests: Vec<Test>,
    /// A table of readings that are far off, `observable step`, by which no posterior is drawn.
    pub outliers: Option<PathBuf>,
    /// Units of columns and parameters, for axes.
    pub units: Vec<(String, String)>,
    /// Values of parameters that are known to be true: drawn, never used.
    pub truth: ByName,
    /// Errors of the rig that are known: every run is taken as the rig would have recorded it.
    pub rig: ByName,
    /// Runs an iteration; by the number of parameters where it is not given.
    pub num: Option<usize>,
    /// Iterations at the most.
    pub iterations: usize,
    /// The same seed gives the same samples on every machine.
    pub seed: u64,
    /// Stop criteria beside the noise.
    pub tolerances: Tolerances,
    /// Share of runs that may fail.
    pub max_failed: f64,
    /// Threads a run.
    pub threads: Option<usize>,
    /// Whether the files of many runs are packed into one; as the environment says where it is not given.
    pub packed: Option<bool>,
    /// A packed file of runs that were made before.
    pub kept: Option<PathBuf>,
    /// Share of an iteration's runs that keep weight when the next samples are drawn.
    pub ess: f64,
    /// What the posterior is read from.
    pub posterior: Posterior,
    /// Emulated samples a round, between the iterations.
    pub emulated: usize,
    /// How the next samples are drawn: `mixture` or `slice`.
    pub sampling: String,
    /// Components of the mixture that they are drawn from.
    pub components: Option<usize>,
    /// Kind of its covariances: `full`, `tied`, `diag` or `spherical`.
    pub covariance: Option<String>,
    /// Effects that are in.
    pub effects: Vec<String>,
    /// Runs of the design of a diagnosis; by the number of parameters where it is not given.
    pub design_num: Option<usize>,
    /// Effects of the measurement that are candidates.
    pub measurement: Vec<String>,
    /// Effects that may be at work together.
    pub max_effects: Option<usize>,
    /// Share of the simulation's own scatter that the measurement has.
    pub scatter: Option<f64>,
    /// Whether the noise is taken for white, however correlated the residuals are.
    pub white: bool,
    /// The simulator.
    pub model: Model,
    /// What the site wants of a job in the queue.
    pub cluster: Cluster,
    /// Where each setting was given, for messages.
    pub places: Places,
}

/// Emulated samples a round where nothing else is said.
const EMULATED: u64 = 1000;

/// Iterations at the most where nothing else is said: of batches through an emulator, and of others.
const BATCHES: usize = 30;
const ITERATIONS: usize = 10;

impl Case {
    /// Name of the file.
    pub const FILE: &str = "case.toml";

    /// First part of the name of each run of a calibration: with effects in another one, with errors of the rig that are given
    /// for the call, and with a white noise, so that the runs of a calibration without them can stand beside it.
    pub fn name_of_runs(&self) -> String {
        let white = if self.white { "-white" } else { "" };
        // One more for those that a diagnosis has found beside what it was called with.
        let rig = "-rig".repeat(self.given.iter().filter(|text| text.starts_with("rig=")).count());
        let effects = if self.effects.is_empty() { "" } else { "-effects" };
        format!("{}{white}{rig}{effects}", self.name)
    }

    /// Read the case in a folder; settings in `given`, each `KEY=VALUE`, win over those of its `case.toml`.
    ///
    /// # Errors
    /// If there is no case, or a setting is unknown or of no use; the message names file and line.
    pub fn load<S: AsRef<str>>(folder: &Path, given: &[S]) -> Result<Self> {
        let path = folder.join(Self::FILE);
        let source = path.display().to_string();
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                bail!("{source}: no such case; gl-init makes one")
            }
            text => text.with_context(|| format!("{source}: cannot be read"))?,
        };
        Self::parse(folder, &source, &text, given)
    }

    /// A case from the text of its `case.toml`; `source` names it in messages.
    ///
    /// # Errors
    /// See [`Case::load`].
    pub fn parse<S: AsRef<str>>(folder: &Path, source: &str, text: &str, given: &[S]) -> Result<Self> {
        let failed = |error: &toml::de::Error, key: &str| {
            let at = error.span().map_or(source.to_owned(), |span| place(source, text, span.start));
            anyhow::anyhow!("{at}: {key}{}", error.message())
        };
        let document = DeTable::parse(text).map_err(|error| failed(&error, ""))?;
        check_names(source, text, document.get_ref())?;
        let mut places = Places::of(source, text, document.get_ref());
        let at_its_key = |error: toml::de::Error| failed(&error, &key_at(document.get_ref(), error.span()));
        let mut table: toml::Table = toml::from_str(text).map_err(at_its_key)?;
        toml::from_str::<File>(text).map_err(at_its_key)?;
        let mut command = None;
        for text in given {
            let Override { path, value } = Override::parse(text.as_ref())?;
            ensure!(
                !table.contains_key("test")
                    || !["noise", "weights", "steps"].contains(&path.split('.').next().unwrap_or("")),
                "{}: with [[test]] each test has its own; change it in {source}",
                text.as_ref()
            );
            places.replace(&path, text.as_ref());
            match path.as_str() {
                "model" => command = value.as_str().map(str::to_owned),
                path => set(&mut table, path, value),
            }
        }
        let file: File = table.try_into().with_context(|| source.to_owned())?;
        let case = Self::from_file(folder, source, file, command, places)?;
        Ok(Self { given: given.iter().map(|text| text.as_ref().to_owned()).collect(), ..case })
    }

    fn from_file(
        folder: &Path,
        source: &str,
        file: File,
        command: Option<String>,
        places: Places,
    ) -> Result<Self> {
        let mut tests = tests(folder, source, &file, &places)?;
        let rig: ByName = file.rig.into_iter().flatten().collect();
        for (error, size) in rig.iter() {
            let place = || places.of_setting(&format!("rig.{error}")).to_string();
            add_to_rig(&mut tests, error, size).with_context(place)?;
        }
        let name =
            file.name.with_context(|| lacks(source, "name", "the first part of the names of the runs"))?;
        let emulated = file.emulated.unwrap_or(EMULATED);
        let posterior = match (file.posterior.as_deref(), file.emulated) {
            (Some("runs"), _) | (_, Some(0)) => Posterior::Runs,
            (Some("weights"), _) | (None, Some(_)) => Posterior::Weights,
            _ => Posterior::Emulator,
        };
        let iterations = if posterior == Posterior::Emulator { BATCHES } else { ITERATIONS };
        Ok(Self {
            given: Vec::new(),
            folder: folder.to_owned(),
            name,
            params: file.params.unwrap_or_else(|| "params.txt".to_owned()),
            tests,
            outliers: file.outliers.map(|outliers| folder.join(outliers)),
            units: file.units.unwrap_or_default(),
            truth: file.truth.into_iter().flatten().collect(),
            rig,
            num: file.num.map(usize::from),
            iterations: file.iterations.map_or(iterations, usize::from),
            seed: file.seed.unwrap_or(0),
            tolerances: file.tolerances,
            max_failed: file.max_failed.unwrap_or(0.5),
            threads: file.threads.map(usize::from),
            packed: file.packed,
            kept: file.kept.map(|kept| folder.join(kept)),
            ess: file.ess.unwrap_or(0.2),
            posterior,
            emulated: if posterior == Posterior::Runs { 0 } else { usize::try_from(emulated)? },
            sampling: file.sampling.unwrap_or_else(|| "mixture".to_owned()),
            components: file.components.map(usize::from),
            covariance: file.covariance,
            effects: file.effects.unwrap_or_default(),
            design_num: file.design_num.map(usize::from),
            measurement: file.measurement.unwrap_or_default(),
            max_effects: file.max_effects.map(usize::from),
            scatter: file.scatter,
            white: file.white.unwrap_or(false),
            model: Model { by_engine: file.model, given: command },
            cluster: file.cluster,
            places,
        })
    }

    /// Names of all settings.
    pub fn settings() -> Vec<&'static str> {
        fields_of::<File>()
    }

    /// The table of parameters.
    pub fn params(&self) -> PathBuf {
        self.folder.join(&self.params)
    }

    /// `case.toml` itself.
    pub fn file(&self) -> PathBuf {
        self.folder.join(Self::FILE)
    }

    /// The engine that was asked for, else the first that the case has, and what it runs.
    ///
    /// # Errors
    /// If the case has no model for it.
    pub fn engine(&self, asked: Option<Engine>) -> Result<(Engine, &str)> {
        let place = self.places.of_setting("model");
        let first = asked.or_else(|| self.default_engine());
        let first = first.or(self.model.given.is_some().then_some(Engine::Local));
        let Some(engine) = first else {
            bail!("{place}: no model; give one by engine under [model], such as local = \"COMMAND\"")
        };
        let of_test = self.tests[0].model.get(&engine).map(String::as_str);
        let Some(model) = of_test.or_else(|| self.model.of(engine)) else {
            let has: Vec<&str> = self.model.by_engine.keys().map(|engine| engine.name()).collect();
            bail!(
                "{place}: no model for the engine {engine}; {}",
                if has.is_empty() {
                    "give one under [model]".to_owned()
                } else {
                    format!("there is one for {}", has.join(", "))
                }
            )
        };
        Ok((engine, model))
    }

    /// Whether there are several tests, or one that has a name.
    pub fn has_tests(&self) -> bool {
        !self.tests[0].name.is_empty()
    }

    /// The first of embedded, local and yade-batch that all tests have a model for.
    fn default_engine(&self) -> Option<Engine> {
        let has = |engine: &Engine| {
            let own =
                |test: &Test| test.model.contains_key(engine) || self.model.by_engine.contains_key(engine);
            self.tests.iter().all(own)
        };
        Engine::ALL.into_iter().find(|engine| has(engine) && !engine.is_queue())
    }

    /// What an engine runs for a test. A simulator that takes a whole table gets what is given of the test in the
    /// place of `{NAME}`; for others it is a column of the table.
    ///
    /// # Errors
    /// If the test has no model for it.
    pub fn model_of(&self, test: &Test, engine: Engine) -> Result<String> {
        let own = Model { by_engine: test.model.clone(), given: self.model.given.clone() };
        let Some(model) = own.of(engine).or_else(|| self.model.of(engine)) else {
            bail!(
                "{}: the test {} has no model for the engine {engine}; give one under [model], or as model of the test",
                self.places.of_setting("model"),
                test.name
            )
        };
        let mut model = model.to_owned();
        if engine == Engine::Embedded {
            for (name, value) in &test.given {
                model = model.replace(&format!("{{{name}}}"), &format!("{value:?}"));
            }
        }
        Ok(model)
    }
}

fn lacks(source: &str, key: &str, what: &str) -> String {
    format!("{source}: no {key}, {what}")
}

/// The tests of a case: those under `[[test]]`, or the one that the case itself is.
fn tests(folder: &Path, source: &str, file: &File, places: &Places) -> Result<Vec<Test>> {
    let Some(entries) = &file.test else {
        return Ok(vec![test(folder, source, file, &TestEntry::default(), ("", places))?]);
    };
    ensure!(
        !entries.is_empty(),
        "{}: test: there is none; leave it out, or write [[test]]",
        places.of_setting("test")
    );
    let mut tests: Vec<Test> = Vec::with_capacity(entries.len());
    for (i, entry) in entries.iter().enumerate() {
        let at = format!("test.{i}");
        let place = |key: &str| places.of_setting(&format!("{at}.{key}"));
        let name = entry
            .name
            .as_deref()
            .with_context(|| format!("{}: test: no name; such as tx100", place("name")))?;
        ensure!(
            is_test_name(name),
            "{}: name: {name:?} is no name of a test; give up to 60 letters, digits, _ and -, such as tx100",
            place("name")
        );
        ensure!(name != "runs", "{}: name: runs is the folder of the runs; take another", place("name"));
        ensure!(tests.iter().all(|test| test.name != name), "{}: name: duplicate test {name}", place("name"));
        ensure!(
            entry.obs.is_some(),
            "{}: obs: the test {name} has no table of its measurement",
            place("obs")
        );
        tests.push(test(folder, source, file, entry, (&format!("{at}."), places))?);
    }
    Ok(tests)
}

/// Add an error of the rig to the test that it is of.
fn add_to_rig(tests: &mut [Test], error: &str, size: f64) -> Result<()> {
    for test in tests.iter_mut() {
        if !test.rig.add_if_of(&test.name, error, size)? {
            continue;
        }
        let known = test.observable_names();
        if let Some(other) = test.rig.observables().find(|of| !known.iter().any(|name| name == of)) {
            bail!("{error}: no observable {other}: observables names {}", known.join(", "));
        }
        return Ok(());
    }
    let names: Vec<&str> = tests.iter().map(|test| test.name.as_str()).collect();
    bail!(
        "{error}: of which test? They are {}: give offset({}.OBSERVABLE), or lag({})",
        names.join(", "),
        names[0],
        names[0]
    )
}

/// One test; `prefix` is that of its settings among the places.
fn test(
    folder: &Path,
    source: &str,
    file: &File,
    entry: &TestEntry,
    (prefix, places): (&str, &Places),
) -> Result<Test> {
    let at = |own: bool, key: &str| if own { format!("{prefix}{key}") } else { key.to_owned() };
    let column = |path: &str, text: &str| {
        text.parse::<Column>().with_context(|| format!("{}: {path}", places.of_setting(path)))
    };
    let control = entry
        .control
        .as_deref()
        .or(file.control.as_deref())
        .with_context(|| lacks(source, "control", "the column that the experiment imposes"))?;
    let control = column(&at(entry.control.is_some(), "control"), control)?;
    let names = entry.observables.as_deref().or(file.observables.as_deref()).unwrap_or_default();
    ensure!(!names.is_empty(), lacks(source, "observables", "the columns to compare"));
    let place = |i: usize| at(entry.observables.is_some(), &format!("observables.{i}"));
    let observables = names.iter().enumerate().map(|(i, name)| column(&place(i), name));
    let observables = observables.collect::<Result<Vec<Column>>>()?;
    for (i, observable) in observables.iter().enumerate() {
        let name = &observable.measured;
        let at = places.of_setting(&place(i));
        ensure!(*name != control.measured, "{at}: {name} is the control; an observable is another column");
        ensure!(
            observables[..i].iter().all(|other| other.measured != *name),
            "{at}: duplicate observable {name}"
        );
    }
    let by_name = |own: &Option<Vec<(String, f64)>>, of_case: &Option<Vec<(String, f64)>>| {
        own.as_ref().or(of_case.as_ref()).into_iter().flatten().cloned().collect::<ByName>()
    };
    let test = Test {
        name: entry.name.clone().unwrap_or_default(),
        given: entry.given.clone().unwrap_or_default(),
        model: entry.model.clone(),
        obs: folder.join(entry.obs.as_deref().unwrap_or("obs.txt")),
        control,
        observables,
        noise: by_name(&entry.noise, &file.noise),
        weights: by_name(&entry.weights, &file.weights),
        scale: file.scale.clone(),
        steps: entry.steps.clone().or_else(|| file.steps.clone()),
        rig: Rig::default(),
    };
    let known = test.observable_names();
    for (key, rows, own) in
        [("noise", &test.noise, entry.noise.is_some()), ("weights", &test.weights, entry.weights.is_some())]
    {
        if let Some(name) = rows.not_among(&known) {
            bail!(
                "{}: {key}: no observable {name}: observables names {}",
                places.of_setting(&at(own, &format!("{key}.{name}"))),
                known.join(", ")
            );
        }
        ensure!(
            rows.is_empty() || rows.names().count() == known.len(),
            "{}: {key}: give it for each of {}, or for none",
            places.of_setting(&at(own, key)),
            known.join(", ")
        );
    }
    Ok(test)
}

/// Refuse settings that there are not.
fn check_names(source: &str, text: &str, table: &DeTable<'_>) -> Result<()> {
    check_keys(source, text, table, &fields_of::<File>(), "")?;
    let sections = [
        ("tolerances", fields_of::<Tolerances>()),
        ("model", Engine::ALL.map(Engine::name).to_vec()),
        ("cluster", fields_of::<Cluster>()),
    ];
    for (name, known) in sections {
        if let Some(section) = table.get(name).and_then(|value| value.get_ref().as_table())
            && !known.is_empty()
        {
            check_keys(source, text, section, &known, &format!("{name}."))?;
        }
    }
    let tests = table.get("test").and_then(|value| value.get_ref().as_array());
    for test in tests.into_iter().flat_map(|tests| tests.iter()) {
        let Some(test) = test.get_ref().as_table() else { continue };
        check_keys(source, text, test, &fields_of::<TestEntry>(), "test.")?;
        if let Some(model) = test.get("model").and_then(|value| value.get_ref().as_table()) {
            check_keys(source, text, model, &Engine::ALL.map(Engine::name), "test.model.")?;
        }
    }
    Ok(())
}

fn check_keys(source: &str, text: &str, table: &DeTable<'_>, known: &[&str], prefix: &str) -> Result<()> {
    let is_engine = |name: &str| Engine::ALL.map(Engine::name).contains(&name);
    for key in table.keys() {
        let name = key.get_ref();
        if known.contains(&name.as_ref()) {
            continue;
        }
        let at = place(source, text, key.span().start);
        ensure!(
            !is_engine(name),
            "{at}: {prefix}{name}: an engine, which stands below a line [{}model]",
            if prefix == "test." { "test." } else { "" }
        );
        bail!("{at}: {prefix}{name}: {}", suggestion(name, known, "no such setting; they are"));
    }
    Ok(())
}

/// The setting that a place in the text belongs to, `noise: `.
fn key_at(table: &DeTable<'_>, span: Option<std::ops::Range<usize>>) -> String {
    let Some(span) = span else { return String::new() };
    for (key, value) in table {
        let whole = key.span().start..value.span().end.max(key.span().end);
        if !whole.contains(&span.start) {
            continue;
        }
        return match value.get_ref().as_table() {
            Some(below) if !key_at(below, Some(span.clone())).is_empty() => {
                format!("{}.{}", key.get_ref(), key_at(below, Some(span)))
            }
            _ => format!("{}: ", key.get_ref()),
        };
    }
    String::new()
}

/// Put a value at a path such as `tolerances.sigma`.
fn set(table: &mut toml::Table, path: &str, value: toml::Value) {
    match path.split_once('.') {
        None => {
            table.insert(path.to_owned(), value);
        }
        Some((section, rest)) => {
            let below = table.entry(section).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            if let Some(below) = below.as_table_mut() {
                set(below, rest, value);
            }
        }
    }
}
