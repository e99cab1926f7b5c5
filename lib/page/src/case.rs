//! A case as a page needs it: how its columns, noise and units are given to the tools.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gl_case::folders::BASE;
use gl_case::{Case as Settled, Column, Engine, Settings, Test};
use gl_inference::prior::Prior;

use crate::tools::Call;

/// A case and how it was run.
#[derive(Debug)]
pub struct Case {
    /// Its folder, as it was given.
    pub folder: PathBuf,
    /// The file that describes it.
    pub file: PathBuf,
    /// The table of parameters, and where it is.
    pub prior: Prior,
    pub params: PathBuf,
    /// The measurement; the first of several tests.
    pub obs: PathBuf,
    /// Name of the control in the measurement.
    pub control: String,
    /// Names of the observables in the measurement.
    pub observables: Vec<String>,
    /// The tests, where the case has several; else none.
    pub tests: Vec<Test>,
    /// `NAME=SD,…`, or nothing where it is estimated.
    pub noise: String,
    /// `NAME=UNIT,…`
    pub units: String,
    /// `NAME=VALUE,…`
    pub truth: String,
    /// Steps that calibration saw, `A:B`, of several tests `NAME A:B, …`; nothing for all.
    pub steps: String,
    pub seed: u64,
    /// What made the runs.
    pub engine: Engine,
    /// What was set in the call, each `KEY=VALUE`.
    pub given: Vec<String>,
}

/// One measurement.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Name of its test; empty where there is no other.
    pub name: String,
    /// Its table.
    pub obs: PathBuf,
    /// Name of its control.
    pub control: String,
    /// Names of its observables, with commas.
    pub observables: String,
    /// `NAME=SD,…`, or nothing where it is estimated.
    pub noise: String,
}

impl Measured {
    /// The runs of it in a folder.
    pub fn ensemble(&self, folder: &Path) -> PathBuf {
        folder.join(match self.name.as_str() {
            "" => "ensemble.txt".to_owned(),
            name => format!("ensemble-{name}.txt"),
        })
    }

    /// A caption that names the test, if there are others.
    pub fn captioned(&self, caption: &str) -> String {
        if self.name.is_empty() { caption.to_owned() } else { format!("In {}. {caption}", self.name) }
    }
}

impl Case {
    /// Read the case, with the settings that `out` was made with, and those in `given`.
    ///
    /// # Errors
    /// If one of its files cannot be read or is of no use, or it has no measurement.
    pub fn read(folder: &Path, engine: Option<Engine>, out: &Path, given: &[String]) -> Result<Self> {
        let settings = match Settings::read(out)? {
            None => Settings::read(&out.join(BASE))?,
            settings => settings,
        };
        let mut kept = settings.as_ref().map(|settings| settings.given.clone()).unwrap_or_default();
        kept.extend(given.iter().filter(|setting| !kept.contains(setting)).cloned().collect::<Vec<_>>());
        let given = kept;
        let case = Settled::load(folder, &given)?;
        let engine = match engine.or(settings.map(|settings| settings.engine)) {
            Some(engine) => engine,
            None => case.engine(None)?.0,
        };
        let test =
            case.tests.first().with_context(|| format!("{}: no measurement", case.file().display()))?;
        Ok(Self {
            folder: folder.to_owned(),
            file: case.file(),
            prior: Prior::read(&case.params())?,
            params: case.params(),
            obs: test.obs.clone(),
            control: test.control.measured.clone(),
            observables: test.observables.iter().map(|Column { measured, .. }| measured.clone()).collect(),
            noise: test.noise.to_string(),
            tests: if case.has_tests() { case.tests.clone() } else { Vec::new() },
            units: by_name(&case.units),
            truth: case.truth.to_string(),
            steps: seen(&case.tests),
            seed: case.seed,
            engine,
            given,
        })
    }

    /// Name of its folder.
    pub fn name(&self) -> String {
        let folder = fs::canonicalize(&self.folder).unwrap_or_else(|_| self.folder.clone());
        folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// A call with the measurement, its control and the noise.
    pub fn control_and_noise(&self, call: Call) -> Call {
        call.file("-b", &self.obs).option("-c", &self.control).option("--noise", &self.noise)
    }

    /// Tables of measurements.
    pub fn measurements(&self) -> Vec<PathBuf> {
        if self.tests.is_empty() {
            return vec![self.obs.clone()];
        }
        self.tests.iter().map(|test| test.obs.clone()).collect()
    }

    /// The measurement of each test; the one that there is where the case has no several.
    pub fn measured(&self) -> Vec<Measured> {
        let one = || Measured {
            name: String::new(),
            obs: self.obs.clone(),
            control: self.control.clone(),
            observables: self.observables.join(","),
            noise: self.noise.clone(),
        };
        if self.tests.is_empty() {
            return vec![one()];
        }
        let of = |test: &Test| Measured {
            name: test.name.clone(),
            obs: test.obs.clone(),
            control: test.control.measured.clone(),
            observables: test.observable_names().join(","),
            noise: test.noise.to_string(),
        };
        self.tests.iter().map(of).collect()
    }

    /// A call with the runs in a folder: one ensemble, or that of each test.
    pub fn ensembles(&self, call: Call, folder: &Path) -> Call {
        if self.tests.is_empty() {
            return call.with([folder.join("ensemble.txt").display().to_string()]);
        }
        call.with(self.tests.iter().map(|test| {
            let file = folder.join(format!("ensemble-{}.txt", test.name));
            format!("{}={}", test.name, file.display())
        }))
    }

    /// A call with the measurement, all its columns and the noise.
    pub fn columns(&self, call: Call) -> Call {
        if !self.tests.is_empty() {
            return self.tests.iter().fold(call, |call, test| {
                let observables: Vec<&str> = test.observables.iter().map(|of| of.measured.as_str()).collect();
                let (obs, control) = (test.obs.display(), &test.control.measured);
                let noise = test.noise.to_string();
                let word = format!("{}:{obs}:{control}:{}:{noise}", test.name, observables.join(","));
                call.option("--test", &word)
            });
        }
        self.control_and_noise(call).option("-v", &self.observables.join(","))
    }
}

/// The steps that calibration saw, with the names of the tests that have some.
fn seen(tests: &[Test]) -> String {
    let of =
        |test: &Test| test.steps.as_ref().map(|steps| format!("{} {steps}", test.name).trim().to_owned());
    tests.iter().filter_map(of).collect::<Vec<_>>().join(", ")
}

/// `NAME=VALUE,…`
fn by_name(pairs: &[(String, String)]) -> String {
    pairs.iter().map(|(name, value)| format!("{name}={value}")).collect::<Vec<_>>().join(",")
}
