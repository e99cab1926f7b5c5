use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use csv::{ReaderBuilder, StringRecord};
use serde::de::DeserializeOwned;

use super::read::{Format, Rows, read_bytes, source_name};
use super::row::{Fields, missing_column};

/// What separates the fields that the csv reader gets: nothing that a table could hold otherwise.
const SEPARATOR: u8 = b'\x1f';

/// A whole table in memory, its rows as csv records.
#[derive(Clone, Debug)]
pub struct Table {
    format: Format,
    records: Vec<StringRecord>,
    lines: Vec<usize>,
    ends_with_newline: bool,
}

impl Table {
    /// Read a table from a file, or from standard input if `path` is `-`.
    ///
    /// # Errors
    /// If it cannot be read, or is not a table.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&source_name(path), read_bytes(path)?)
    }

    /// Parse a table from its bytes; `source` names it in messages.
    ///
    /// # Errors
    /// If there is no header, the text is not UTF-8, or a row has another length than the header.
    pub fn parse(source: &str, bytes: Vec<u8>) -> Result<Self> {
        let mut rows = Rows::new(source, &bytes)?;
        // What csv does not know: a header behind `#`, runs of blanks, comments, padded fields.
        let (mut normal, mut lines) = (Vec::with_capacity(bytes.len()), Vec::new());
        while let Some((line, fields)) = rows.next_row()? {
            lines.push(line);
            for (j, field) in fields.iter().enumerate() {
                if j > 0 {
                    normal.push(SEPARATOR);
                }
                normal.extend_from_slice(field.as_bytes());
            }
            normal.push(b'\n');
        }
        let format = rows.format().clone();
        let reader = ReaderBuilder::new()
            .has_headers(false)
            .delimiter(SEPARATOR)
            .quoting(false)
            .from_reader(&normal[..]);
        let records =
            reader.into_records().collect::<csv::Result<Vec<_>>>().with_context(|| source.to_owned())?;
        if records.len() != lines.len() {
            // A table of one column may hold what csv takes for an empty line.
            bail!("{source}: a row is empty; give each row as many fields as the header names");
        }
        Ok(Self { format, records, lines, ends_with_newline: bytes.ends_with(b"\n") })
    }

    /// Layout of the fields: source and column names.
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether the table has no rows.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Refuse a table whose last line has no end: a number that was cut off is still a number.
    ///
    /// # Errors
    /// If there is none.
    pub fn check_end(&self) -> Result<()> {
        let line = self.lines.last().copied().unwrap_or(1);
        ensure!(
            self.ends_with_newline,
            "{}:{line}: the last line has no end, so its last number may be cut off; end it with a newline",
            self.format.source()
        );
        Ok(())
    }

    /// Line number of a row, for messages.
    pub fn line(&self, row: usize) -> usize {
        self.lines[row]
    }

    /// The field at a row and column.
    pub fn field(&self, row: usize, column: usize) -> &str {
        &self.records[row][column]
    }

    /// The field at a row and column, as a finite number.
    ///
    /// # Errors
    /// If it is not one.
    pub fn number(&self, row: usize, column: usize) -> Result<f64> {
        self.format.number(self.lines[row], column, self.field(row, column))
    }

    /// The field at a row and column, as a number up to [`LARGEST`](crate::LARGEST).
    ///
    /// # Errors
    /// If it is not one.
    pub fn moderate(&self, row: usize, column: usize) -> Result<f64> {
        self.format.moderate(self.lines[row], column, self.field(row, column))
    }

    /// A column of numbers up to [`LARGEST`](crate::LARGEST), by name.
    ///
    /// # Errors
    /// See [`Table::numbers`]; also if a number is larger.
    pub fn moderates(&self, name: &str) -> Result<Vec<f64>> {
        let column = self.format.column(name)?;
        (0..self.len()).map(|row| self.moderate(row, column)).collect()
    }

    /// Whether a column holds words and no number in any row; not one without rows.
    pub fn holds_words(&self, column: usize) -> bool {
        let is_word = |row| {
            !matches!(self.field(row, column), "" | "-") && self.field(row, column).parse::<f64>().is_err()
        };
        !self.is_empty() && (0..self.len()).all(is_word)
    }

    /// A column of finite numbers, by name.
    ///
    /// # Errors
    /// If the column is missing or repeated, or a field is not a finite number.
    pub fn numbers(&self, name: &str) -> Result<Vec<f64>> {
        let column = self.format.column(name)?;
        (0..self.len()).map(|row| self.number(row, column)).collect()
    }

    /// All rows as a serde type with the names of the columns. Columns that it does not name are left
    /// aside; `-` is `None`; numbers are finite.
    ///
    /// ```
    /// #[derive(serde::Deserialize)]
    /// struct Reading { u: f64, f: Option<f64> }
    ///
    /// let table = gl_table::Table::parse("obs.txt", b"# u f\n0 1.5\n1 -\n".to_vec())?;
    /// let readings: Vec<Reading> = table.rows()?;
    /// assert_eq!((readings[0].f, readings[1].f), (Some(1.5), None));
    /// let table = gl_table::Table::parse("obs.txt", b"u f\n0 abc\n".to_vec())?;
    /// let error = table.rows::<Reading>().err().unwrap();
    /// assert_eq!(error.to_string(), "obs.txt:2: column f: \"abc\" is not a number");
    /// # Ok::<(), gl_table::Error>(())
    /// ```
    ///
    /// # Errors
    /// If a column that it needs is missing or repeated, or a field is not what it should be.
    pub fn rows<T: DeserializeOwned>(&self) -> Result<Vec<T>> {
        if let Some(name) = missing_column::<T>(|name| self.format.find(name).ok().flatten().is_some()) {
            // Says which there are, or that it is repeated.
            self.format.column(&name)?;
        }
        let row = |(record, line): (&StringRecord, &usize)| {
            T::deserialize(Fields::new(self.format.columns(), record))
                .map_err(|problem| anyhow!("{}:{line}: {problem}", self.format.source()))
        };
        self.records.iter().zip(&self.lines).map(row).collect()
    }

    /// Fail with a message that points at a row and column of this table.
    ///
    /// # Errors
    /// Always: the error is what is wanted.
    pub fn fail<T>(&self, row: usize, column: &str, problem: impl std::fmt::Display) -> Result<T> {
        bail!("{}:{}: column {column}: {problem}", self.format.source(), self.lines[row])
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use proptest::prelude::*;
    use serde::{Deserialize, Serialize};

    use super::super::{Rows, number, optional_number, write_rows, yes_no};
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Reading {
        #[serde(serialize_with = "number")]
        u: f64,
        name: String,
        #[serde(serialize_with = "optional_number")]
        f: Option<f64>,
        #[serde(serialize_with = "yes_no")]
        met: bool,
    }

    fn refused(text: &str) -> String {
        Table::parse("obs.txt", text.into()).unwrap().rows::<Reading>().unwrap_err().to_string()
    }

    #[test]
    fn rows_of_a_type_say_what_is_wrong_and_where() {
        assert_eq!(refused("u name f\n1 a 2\n"), "obs.txt:1: no column met; the columns are u, name, f");
        assert_eq!(refused("u name f\n"), "obs.txt:1: no column met; the columns are u, name, f");
        assert_eq!(
            refused("# u,name,f,met\r\n1,a,inf,yes\r\n"),
            "obs.txt:2: column f: inf where a finite number is needed"
        );
        assert_eq!(
            refused("u name f met\n\n1 a - maybe\n"),
            "obs.txt:3: column met: \"maybe\" is neither yes nor no"
        );
    }

    #[test]
    fn rows_of_a_type_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.txt");
        let rows = vec![
            Reading { u: 1e300, name: "a b".to_owned(), f: None, met: true },
            Reading { u: -0.1, name: "c".to_owned(), f: Some(3.0), met: false },
        ];
        write_rows(Some(&path), &rows).unwrap();
        assert_eq!(
            std::fs::read_to_string(&path).unwrap(),
            "u\tname\tf\tmet\n1e300\ta b\t-\tyes\n-0.1\tc\t3\tno\n"
        );
        write_rows::<Reading>(Some(&path), &[]).unwrap();
        assert_eq!(Table::read(&path).unwrap().rows::<Reading>().unwrap(), []);
    }

    /// A table as someone might write it, or nearly.
    fn tables() -> impl Strategy<Value = String> {
        let field =
            prop_oneof![Just("1"), Just("-2.5e3"), Just("abc"), Just("NaN"), Just("-"), Just("\"q\"")];
        let row = prop::collection::vec(field, 2..5);
        let separator = prop_oneof![Just("\t"), Just(","), Just(" "), Just("  "), Just(" , ")];
        let end = prop_oneof![Just("\n"), Just("\r\n")];
        let start = prop_oneof![Just(""), Just("\u{feff}"), Just("# "), Just("\n#")];
        let between = prop_oneof![4 => Just(""), 1 => Just("\n"), 1 => Just("# note\n")];
        (start, separator, end, prop::collection::vec((between, row), 0..6)).prop_map(
            |(start, separator, end, rows)| {
                let mut text = format!("{start}{}{end}", ["a", "b", "c"].join(separator));
                for (between, row) in rows {
                    text += &format!("{between}{}{end}", row.join(separator));
                }
                text
            },
        )
    }

    proptest! {
        #[test]
        fn both_ways_give_the_same_rows_and_the_same_errors(text in tables()) {
            let whole = Table::parse("t", text.clone().into_bytes()).map(|table| {
                (0..table.len())
                    .map(|row| (table.line(row), (0..3).map(|j| table.field(row, j).to_owned()).collect()))
                    .collect::<Vec<(usize, Vec<String>)>>()
            });
            let piecewise = (|| {
                let mut rows = Rows::new("t", text.as_bytes())?;
                let mut all = Vec::new();
                while let Some((line, fields)) = rows.next_row()? {
                    all.push((line, fields.iter().map(|&field| field.to_owned()).collect()));
                }
                anyhow::Ok(all)
            })();
            prop_assert_eq!(whole.map_err(|e| e.to_string()), piecewise.map_err(|e| e.to_string()));
        }
    }
}
