use std::fmt;

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
