//! Tables as a page shows them.

use std::path::Path;

use anyhow::Result;
use gl_figure::number::significant;
use gl_table::{Table, parse_number};
use serde::Serialize;

/// A table of text, with what is needed to set it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Grid {
    /// Heads of the columns.
    pub columns: Vec<Column>,
    /// Cells, shape (rows, columns).
    pub rows: Vec<Vec<String>>,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Column {
    /// Its head.
    pub name: String,
    /// Whether it holds numbers, which are set to the right.
    pub is_number: bool,
    /// Whether it holds sentences, which may take several lines.
    pub is_prose: bool,
}

/// Cells longer than this may be broken.
const LONG: usize = 24;

impl Grid {
    /// From the heads of the columns and the rows.
    pub fn new<S: Into<String>>(names: impl IntoIterator<Item = S>, rows: Vec<Vec<String>>) -> Self {
        let is_empty = |cell: &str| matches!(cell, "-" | "" | "off");
        let column = |(j, name): (usize, S)| {
            let cells = || rows.iter().map(|row| row[j].as_str()).filter(|cell| !is_empty(cell));
            Column {
                name: name.into(),
                is_number: cells().next().is_some() && cells().all(starts_as_number),
                is_prose: cells().any(|cell| cell.chars().count() > LONG && cell.contains(' ')),
            }
        };
        let columns = names.into_iter().enumerate().map(column).collect();
        Self { columns, rows }
    }

    /// At most so many rows of a table, its numbers to four digits, without the columns that hold nothing.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: &Path, most: usize) -> Result<Self> {
        Ok(Self::of_table(&Table::read(path)?, most))
    }

    /// See [`Grid::read`].
    pub fn of_table(table: &Table, most: usize) -> Self {
        let rows = table.len().min(most);
        let is_empty = |j: usize| (0..rows).all(|row| matches!(table.field(row, j), "-" | ""));
        let columns = table.format().columns();
        let kept: Vec<usize> = (0..columns.len()).filter(|&j| rows == 0 || !is_empty(j)).collect();
        let cells =
            (0..rows).map(|row| kept.iter().map(|&j| rounded(table.field(row, j))).collect()).collect();
        Self::new(kept.iter().map(|&j| columns[j].as_str()), cells)
    }

    /// Only the rows of which this column says this.
    pub fn only(mut self, column: &str, value: &str) -> Self {
        if let Some(j) = self.columns.iter().position(|known| known.name == column) {
            self.rows.retain(|row| row[j] == value);
        }
        self
    }

    /// Without a column, if it is there.
    pub fn without(mut self, column: &str) -> Self {
        if let Some(j) = self.columns.iter().position(|known| known.name == column) {
            self.columns.remove(j);
            self.rows.iter_mut().for_each(|row| drop(row.remove(j)));
        }
        self
    }
}

/// A number to four digits; anything else as it is.
fn rounded(field: &str) -> String {
    parse_number(field).map_or_else(|_| field.to_owned(), |number| significant(number, 4))
}

fn starts_as_number(cell: &str) -> bool {
    cell.trim_start_matches(['(', '<', '>', ' ', '−']).starts_with(|c: char| c.is_ascii_digit())
        && !cell.contains(':')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_and_empty_columns_left_out() {
        let table = Table::parse("t", b"name\tz\tnone\na\t-12.34567\t-\nb\t1e-9\t-\n".to_vec()).unwrap();
        let grid = Grid::of_table(&table, 5);
        assert_eq!(grid.rows, [["a", "−12.35"], ["b", "1·10⁻⁹"]]);
        assert_eq!(grid.columns.iter().map(|column| column.is_number).collect::<Vec<_>>(), [false, true]);
        assert_eq!(Grid::of_table(&table, 1).only("name", "b").rows, Vec::<Vec<String>>::new());
    }
}
