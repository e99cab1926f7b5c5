//! What a page needs of a case.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gl_inference::prior::Prior;

use crate::tools::Call;

/// A case and how it was run.
#[derive(Debug)]
pub struct Case {
    /// Its folder, as it was given.
    pub folder: PathBuf,
    /// Name of the control in the measurement.
    pub control: String,
    /// Names of the observables in the measurement.
    pub observables: Vec<String>,
    /// `NAME=SD,…`, or nothing where it is estimated.
    pub noise: String,
    /// `NAME=UNIT,…`
    pub units: String,
    /// `NAME=VALUE,…`
    pub truth: String,
    /// Steps that calibration saw, `A:B`, or nothing for all.
    pub steps: String,
    pub seed: String,
    /// What made the runs.
    pub engine: String,
    /// What was set in the call: `NUM=20 …`, as it would be typed.
    pub overrides: Vec<String>,
    /// The file that says all this.
    pub file: PathBuf,
    pub prior: Prior,
}

impl Case {
    pub fn read(folder: &Path, engine: Option<&str>, out: &Path) -> Result<Self> {
        let file = folder.join("case.env");
        let text = fs::read_to_string(&file).with_context(|| format!("{}: no such case", file.display()))?;
        let mut given = String::new();
        for own in [out.join("settings.env"), out.join("base/settings.env")] {
            given += &fs::read_to_string(own).unwrap_or_default();
        }
        let all = format!("{text}\n{given}");
        let get = |key: &str| {
            all.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('=')).next_back().unwrap_or("").to_owned()
        };
        let measured = |name: &str| name.split('=').next().unwrap_or(name).to_owned();
        Ok(Self {
            folder: folder.to_owned(),
            control: measured(&get("CONTROL")),
            observables: get("OBSERVABLES").split(',').map(measured).collect(),
            noise: get("NOISE"),
            units: get("UNITS"),
            truth: get("TRUTH"),
            steps: get("STEPS"),
            seed: Some(get("SEED")).filter(|seed| !seed.is_empty()).unwrap_or_else(|| "0".to_owned()),
            engine: engine.unwrap_or("embedded").to_owned(),
            overrides: Vec::new(),
            prior: Prior::read(&folder.join("params.txt"))?,
            file,
        })
    }

    /// Name of its folder.
    pub fn name(&self) -> String {
        let folder = fs::canonicalize(&self.folder).unwrap_or_else(|_| self.folder.clone());
        folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    pub fn params(&self) -> PathBuf {
        self.folder.join("params.txt")
    }

    pub fn obs(&self) -> PathBuf {
        self.folder.join("obs.txt")
    }

    /// A call with the measurement, its control and the noise.
    pub fn control_and_noise(&self, call: Call) -> Call {
        call.file("-b", &self.obs()).option("-c", &self.control).option("--noise", &self.noise)
    }

    /// A call with the measurement, all its columns and the noise.
    pub fn columns(&self, call: Call) -> Call {
        self.control_and_noise(call).option("-v", &self.observables.join(","))
    }
}
