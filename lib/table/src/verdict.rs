//! What a tool concludes, a row a conclusion: for people a sentence, for programs a code and a value.

use std::path::Path;

use anyhow::Result;

use crate::{Table, TableWriter};

/// One conclusion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// What kind of conclusion it is, such as `leans`; the same for ever.
    pub code: String,
    /// The number or name that it is about; `-` where there is none.
    pub value: String,
    /// The sentence for a reader, without a name before it.
    pub text: String,
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
    /// Add a conclusion. Tabs and line ends in it become blanks.
    pub fn add(&mut self, code: &str, value: impl ToString, text: impl Into<String>) {
        let flat = |text: String| text.replace(['\t', '\n', '\r'], " ");
        let value = Some(flat(value.to_string())).filter(|value| !value.is_empty());
        self.rows.push(Verdict {
            code: code.to_owned(),
            value: value.unwrap_or_else(|| "-".to_owned()),
            text: flat(text.into()),
        });
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
        let table = Table::read(path)?;
        let [code, value, text] =
            [table.format().column("code")?, table.format().column("value")?, table.format().column("text")?];
        let row = |row| Verdict {
            code: table.field(row, code).to_owned(),
            value: table.field(row, value).to_owned(),
            text: table.field(row, text).to_owned(),
        };
        Ok(Self { rows: (0..table.len()).map(row).collect() })
    }

    /// Write the table `code value text`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        let mut table = TableWriter::create(path, &["code", "value", "text"])?;
        for verdict in &self.rows {
            table.text(&verdict.code).text(&verdict.value).text(&verdict.text).end_row()?;
        }
        table.finish()
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
        assert_eq!(back, verdicts);
        assert_eq!(back.rows[0].text, "adhesion, in it (0.93), closes 96 % of the gap");
        assert_eq!(back.find("settled").unwrap().value, "-");
    }
}
