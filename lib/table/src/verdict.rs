//! What a tool concludes, a row a conclusion: for people a sentence, for programs a code and a value.

use std::path::Path;

use anyhow::Result;

use serde::{Deserialize, Serialize};

use crate::{Table, text, write_rows};

/// One conclusion.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// What kind of conclusion it is, such as `leans`; the same for ever.
    pub code: String,
    /// The number or name that it is about; `-` where there is none.
    #[serde(serialize_with = "text")]
    pub value: String,
    /// The sentence for a reader, without a name before it.
    #[serde(serialize_with = "text")]
    pub text: String,
}

/// Codes of what a reader should know before trusting the rest.
const DOUBTS: &[&str] = &[
    // of gl-check-stop and gl-filter
    "single-sample",
    "sigma-above-noise",
    "bad-fit",
    "few-runs",
    "blind",
    "leans",
    "beyond-prior",
    // of gl-posterior
    "emulator-unfit",
    "emulator-ignorant",
    "noise-alternates",
    "noise-correlated",
    "noise-too-small",
    "noise-too-large",
    "scatter-too-large",
    "too-few-inside",
    // of gl-gap-attribute
    "base-fits",
    "next",
    "confounded",
    "emulator",
    "untried",
    "rival-untried",
    // of all that ask for the noise
    "noise-scale",
    "outliers",
    // of gl-gap-locate and gl-gap-shrink
    "alternates",
    "smooth",
    "grows",
    "may-not-close",
    "too-small",
    "not-as-foretold",
];

/// Whether a code says that something is to be doubted.
pub fn is_doubt(code: &str) -> bool {
    DOUBTS.contains(&code)
}

/// All that a tool concludes, the most important first.
///
/// ```
/// let mut verdicts = gl_table::verdict::Verdicts::default();
/// verdicts.add("cause", "adhesion", "adhesion explains the gap");
/// assert_eq!(verdicts.find("cause").unwrap().value, "adhesion");
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verdicts {
    /// In the order in which they were added.
    pub rows: Vec<Verdict>,
}

impl Verdicts {
    /// Add a conclusion.
    pub fn add(&mut self, code: &str, value: impl ToString, text: impl Into<String>) {
        self.rows.push(Verdict { code: code.to_owned(), value: value.to_string(), text: text.into() });
    }

    /// The first conclusion of this kind.
    pub fn find(&self, code: &str) -> Option<&Verdict> {
        self.rows.iter().find(|verdict| verdict.code == code)
    }

    /// Read a table `code value text`.
    ///
    /// # Errors
    /// If it cannot be read, or lacks one of these columns.
    pub fn read(path: &Path) -> Result<Self> {
        Ok(Self { rows: Table::read(path)?.rows()? })
    }

    /// Write the table `code value text`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        write_rows(path, &self.rows)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn verdicts_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("verdict.txt");
        let mut verdicts = Verdicts::default();
        verdicts.add("cause", 0.93, "adhesion, in it (0.93), closes\t96 % of the gap");
        verdicts.add("settled", "", "# it is settled");
        verdicts.write(Some(&path)).unwrap();
        let back = Verdicts::read(&path).unwrap();
        assert_eq!(back.rows[0].text, "adhesion, in it (0.93), closes 96 % of the gap");
        assert_eq!(back.find("settled").unwrap().value, "-");
    }
}
