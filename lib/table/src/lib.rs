//! The one reader and the one writer of plain text tables.
//!
//! A table is a header line that names the columns and one row a line. Fields are separated by
//! tabs, commas or runs of blanks; the header may begin with `#`; blank lines and later lines
//! beginning with `#` are skipped; CRLF and a UTF-8 byte-order mark are accepted. Tables are written
//! tab-separated with a bare header.
//!
//! A [`Table`] is held whole, as csv records: its rows are read into serde types by [`Table::rows`] and
//! written from them by [`write_rows`]; columns whose names are the user's (parameters, observables)
//! stand beside those, and are asked for by name. Ensembles and misfits, of gigabytes perhaps, go the
//! fast way instead: [`Rows`] and [`RunTable`]. Both ways give the same rows and the same errors.

mod cursor;
mod pipe;
mod read;
mod row;
mod runs;
pub mod verdict;
mod whole;
mod write;

pub use cursor::Cursor;
pub use read::source_name;
pub use read::{Format, LARGEST, Rows, open, parse_number, read_bytes};
pub use runs::{Flaw, PieceRows, RunTable};
pub use whole::Table;
pub use write::{
    Sink, TableWriter, appears_whole, number, optional_number, print, push_number, remove, rounded, text,
    write_rows, write_whole, yes_no,
};

pub use anyhow::{Error, Result};
