//! The samples table as Yade reads it, once every cell is known to be harmless.

use std::path::Path;

use anyhow::{Result, bail};
use gl_inference::samples::Samples;
use gl_table::{Table, read_bytes, source_name};

/// The column that tells how many threads a run has.
const THREADS: &str = "!OMP_NUM_THREADS";

/// A samples table whose cells may be handed to a program, to Yade, which evaluates them as Python, and to
/// the file system: a run is called by `description`, every other cell is a number.
///
/// Rows are counted from 0. Row `i` is line `i + 2` of [`BatchTable::text`].
#[derive(Clone, Debug, PartialEq)]
pub struct BatchTable {
    samples: Samples,
    columns: Vec<String>,
    /// Shape (rows, columns).
    cells: Vec<Vec<String>>,
}

impl BatchTable {
    /// Read and check a table from a file, or from standard input if `path` is `-`.
    ///
    /// # Errors
    /// If it cannot be read or a name or cell could do harm; the message names file, line and column.
    pub fn read(path: &Path) -> Result<Self> {
        let source = source_name(path);
        if path.is_dir() || (source != "stdin" && !path.exists()) {
            bail!("{source}: no such samples table; gl-sample writes one");
        }
        Self::parse(&source, read_bytes(path)?)
    }

    /// Check a table that is in memory; `source` names it in messages.
    ///
    /// # Errors
    /// See [`BatchTable::read`].
    pub fn parse(source: &str, bytes: Vec<u8>) -> Result<Self> {
        if bytes.iter().all(u8::is_ascii_whitespace) {
            bail!("{source}:1: no header; the first line must name the columns");
        }
        let table = Table::parse(source, bytes)?;
        let columns = table.format().columns().to_vec();
        for name in &columns {
            // Yade has other such columns: !EXEC and !SCRIPT choose what is run.
            if name.starts_with('!') && name != THREADS {
                bail!(
                    "{source}:1: {name:?} cannot be a column name; of those with a ! there is only {THREADS}"
                );
            }
            table.format().column(name)?;
        }
        if table.format().find("description")?.is_none() {
            bail!("{source}:1: no column description; gl-sample writes one");
        }
        let samples = Samples::from_table(&table)?;
        let mut cells = Vec::with_capacity(table.len());
        for row in 0..table.len() {
            let mut checked = Vec::with_capacity(columns.len());
            for (j, name) in columns.iter().enumerate() {
                let cell = table.field(row, j);
                checked.push(match name.as_str() {
                    "description" => cell.to_owned(),
                    THREADS if !cell.parse::<u32>().is_ok_and(|threads| threads > 0) => {
                        return table.fail(row, name, format_args!("{cell:?} is no number of threads"));
                    }
                    _ => {
                        table.number(row, j)?;
                        as_python_reads(cell)
                    }
                });
            }
            cells.push(checked);
        }
        Ok(Self { samples, columns, cells })
    }

    /// Names and parameters of the runs, in the order of the rows.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Column names: `description`, the parameters, and if they are there `key` and `!OMP_NUM_THREADS`.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// What the run of a row is called: its `description`.
    pub fn name(&self, row: usize) -> &str {
        &self.samples.names[row]
    }

    /// The cell of a row in the column called `column`, as text.
    pub fn cell(&self, row: usize, column: &str) -> Option<&str> {
        let place = self.columns.iter().position(|name| name == column)?;
        self.cells.get(row)?.get(place).map(String::as_str)
    }

    /// How many threads a run has, where the table says so.
    pub fn threads(&self, row: usize) -> Option<&str> {
        self.cell(row, THREADS)
    }

    /// Some of the rows, in the order given.
    pub fn select(&self, rows: &[usize]) -> Self {
        let samples = &self.samples;
        Self {
            samples: Samples {
                source: samples.source.clone(),
                names: rows.iter().map(|&row| samples.names[row].clone()).collect(),
                parameters: samples.parameters.clone(),
                values: rows.iter().map(|&row| samples.values[row].clone()).collect(),
            },
            columns: self.columns.clone(),
            cells: rows.iter().map(|&row| self.cells[row].clone()).collect(),
        }
    }

    /// The table as Yade reads it: tabs, a bare header, a newline after the last row.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for line in std::iter::once(&self.columns).chain(&self.cells) {
            text.push_str(&line.join("\t"));
            text.push('\n');
        }
        text
    }
}

/// A number without the leading zeros with which it would be none to Python: `007`.
fn as_python_reads(cell: &str) -> String {
    let (sign, digits) = match cell.strip_prefix(['+', '-']) {
        Some(digits) => (&cell[..1], digits),
        None => ("", cell),
    };
    let rest = digits.trim_start_matches('0');
    let zero = if rest.starts_with(|c: char| c.is_ascii_digit()) { "" } else { "0" };
    if digits.len() > rest.len() { format!("{sign}{zero}{rest}") } else { cell.to_owned() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn parse(text: &str) -> Result<BatchTable> {
        BatchTable::parse("samples.txt", text.as_bytes().to_vec())
    }

    fn refused(text: &str) -> String {
        parse(text).map(|table| table.text()).expect_err(text).to_string()
    }

    #[test]
    fn every_form_of_a_table_comes_out_as_yade_reads_it() {
        for text in [
            "description\tkey\ta\nr0\t0\t1.5\n",
            "description,key,a\nr0,0,1.5",
            "  description key  a\n\n  r0 0   1.5 \n# end\n",
            "\u{feff}# description key a\r\n# note\r\nr0 00 1.5\r\n",
        ] {
            assert_eq!(parse(text).unwrap().text(), "description\tkey\ta\nr0\t0\t1.5\n", "{text:?}");
        }
    }

    #[test]
    fn numbers_keep_their_value_and_python_can_read_them() {
        for (cell, expected) in [
            ("007", "7"),
            ("-00.5", "-0.5"),
            ("+010", "+10"),
            ("0", "0"),
            ("000", "0"),
            ("00e5", "0e5"),
            ("1e05", "1e05"),
        ] {
            assert_eq!(as_python_reads(cell), expected);
        }
    }

    #[test]
    fn cells_that_are_no_numbers_are_refused_by_line_and_column() {
        for cell in
            ["x", "nan", "inf", "1;2", "`id`", "0x10", "__import__('os')", "1e", "--1", "{b}", "=", "1_0"]
        {
            let message = refused(&format!("description\ta\ngood\t1\nbad\t{cell}\n"));
            assert!(message.starts_with("samples.txt:3: column a: "), "{message}");
        }
        assert!(refused("description a\nr 1e999\n").contains("samples.txt:2: column a"));
        assert!(refused("description key\nr x\n").contains("samples.txt:2: column key"));
        for threads in ["0", "-1", "1.5", "x"] {
            let message = refused(&format!("!OMP_NUM_THREADS description\n{threads} r\n"));
            assert!(message.contains("is no number of threads"), "{message}");
        }
    }

    #[test]
    fn columns_that_choose_what_is_run_are_refused() {
        for column in ["!EXEC", "!SCRIPT", "dir", "case", "a;b", "-x", "a\u{301}b"] {
            let message = refused(&format!("description {column}\nr 1\n"));
            assert!(message.starts_with("samples.txt:1: "), "{message}");
        }
        assert_eq!(refused(" \n\n"), "samples.txt:1: no header; the first line must name the columns");
    }

    proptest! {
        #[test]
        fn whatever_is_accepted_reads_back_the_same(cells in prop::collection::vec("[-+]?[0-9]{1,4}(\\.[0-9]{0,3})?(e[-+]?[0-8]?[0-9])?", 1..5)) {
            let rows: String = cells.iter().enumerate().map(|(i, cell)| format!("r{i}\t{cell}\n")).collect();
            let table = parse(&format!("description\ta\n{rows}")).unwrap();
            prop_assert_eq!(&parse(&table.text()).unwrap(), &table);
            for (cell, values) in cells.iter().zip(&table.samples().values) {
                prop_assert_eq!(cell.parse::<f64>().unwrap(), values[0]);
            }
        }
    }
}
