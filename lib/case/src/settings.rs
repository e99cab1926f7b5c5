use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::engine::Engine;

/// What a calibration or diagnosis was called with, kept in its folder as `settings.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Settings {
    /// The name of the case.
    pub case: String,
    /// The engine that makes the runs.
    pub engine: Engine,
    /// Settings of the case that were given for the call, each `KEY=VALUE`.
    #[serde(default)]
    pub given: Vec<String>,
}

impl Settings {
    /// Name of the file.
    pub const FILE: &str = "settings.toml";

    /// Those that the folder has, if it has any.
    ///
    /// # Errors
    /// If the file cannot be read, or holds something else.
    pub fn read(out: &Path) -> Result<Option<Self>> {
        let path = out.join(Self::FILE);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            text => text.with_context(|| format!("{}: cannot be read", path.display()))?,
        };
        let settings = toml::from_str(&text).with_context(|| format!("{}: no settings", path.display()))?;
        Ok(Some(settings))
    }

    /// The text of the file.
    ///
    /// # Errors
    /// Never, in practice: if it cannot be said in TOML.
    pub fn text(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
    }
}
