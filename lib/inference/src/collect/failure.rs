use std::fmt;
use std::path::Path;

use anyhow::Result;
use gl_table::{Table, text};
use serde::{Deserialize, Serialize};

/// Why a run cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// One of its files is not there.
    Missing(String),
    /// The file has no rows.
    Empty,
    /// It ends before the measurement does, or in the middle of a line.
    Truncated(String),
    /// It holds NaN or an infinity.
    NonFinite(String),
    /// It ran with other parameters than the table's.
    Parameters(String),
    /// Its loading path is not the measurement's.
    Control(String),
    /// The file is no table of numbers with the columns asked for.
    Malformed(String),
}

impl Failure {
    /// The reason in one word, as the status table has it.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Missing(_) => "missing",
            Self::Empty => "empty",
            Self::Truncated(_) => "truncated",
            Self::NonFinite(_) => "non-finite",
            Self::Parameters(_) => "parameters",
            Self::Control(_) => "control",
            Self::Malformed(_) => "malformed",
        }
    }

    /// The reason as the status of a run has it, after the exit code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Missing(_) => "MISSING",
            Self::Empty => "EMPTY",
            Self::Truncated(_) => "TRUNCATED",
            Self::NonFinite(_) => "NON_FINITE",
            Self::Parameters(_) => "PARAMETERS",
            Self::Control(_) => "CONTROL",
            Self::Malformed(_) => "MALFORMED",
        }
    }

    /// What exactly was found.
    pub fn detail(&self) -> &str {
        match self {
            Self::Empty => "no rows",
            Self::Missing(detail)
            | Self::Truncated(detail)
            | Self::NonFinite(detail)
            | Self::Parameters(detail)
            | Self::Control(detail)
            | Self::Malformed(detail) => detail,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.reason(), self.detail())
    }
}

/// One row of a status table: whether a run can be used, and why not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunStatus {
    /// Name of the sample.
    pub sample: String,
    /// `ok`, or the reason in one word.
    pub status: String,
    /// What exactly was found.
    #[serde(serialize_with = "text")]
    pub detail: String,
}

impl RunStatus {
    /// The status of a sample whose run was read.
    pub fn new(sample: &str, status: &std::result::Result<(), Failure>) -> Self {
        let (status, detail) = match status {
            Ok(()) => ("ok", "-"),
            Err(failure) => (failure.reason(), failure.detail()),
        };
        Self { sample: sample.to_owned(), status: status.to_owned(), detail: detail.to_owned() }
    }

    /// Whether the run can be used.
    pub fn is_ok(&self) -> bool {
        self.status == "ok"
    }

    /// The rows of a status table whose runs cannot be used.
    ///
    /// # Errors
    /// If it cannot be read or is no such table.
    pub fn failed(path: &Path) -> Result<Vec<Self>> {
        let mut rows: Vec<Self> = Table::read(path)?.rows()?;
        rows.retain(|row| !row.is_ok());
        Ok(rows)
    }
}
