use std::fmt;
use std::str::FromStr;

use anyhow::{Error, bail};
use serde::de::{Deserialize, Deserializer, Error as _};
use serde::ser::{Serialize, Serializer};

use crate::places::suggestion;

/// How runs are started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Engine {
    /// By a simulator that is one of the tools.
    Embedded,
    /// By a command a run, several at a time, on this machine.
    Local,
    /// By `yade-batch`.
    YadeBatch,
    /// By a job array of SLURM.
    Slurm,
    /// By a job array of PBS.
    Pbs,
}

impl Engine {
    /// All engines, those first that a case is run by when none is asked for.
    pub const ALL: [Self; 5] = [Self::Embedded, Self::Local, Self::YadeBatch, Self::Slurm, Self::Pbs];

    /// Its name, as in `--engine` and `[model]`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Embedded => "embedded",
            Self::Local => "local",
            Self::YadeBatch => "yade-batch",
            Self::Slurm => "slurm",
            Self::Pbs => "pbs",
        }
    }

    /// Whether runs wait in the queue of a scheduler.
    pub fn is_queue(self) -> bool {
        matches!(self, Self::Slurm | Self::Pbs)
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Engine {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        if let Some(engine) = Self::ALL.into_iter().find(|engine| engine.name() == text) {
            return Ok(engine);
        }
        let names = Self::ALL.map(Self::name);
        bail!("no engine {text}: {}", suggestion(text, &names, "there are"))
    }
}

impl<'de> Deserialize<'de> for Engine {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

impl Serialize for Engine {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}
