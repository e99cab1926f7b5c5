//! The one reader and the one writer of plain text tables.
//!
//! A table is a header line that names the columns and one row a line. Fields are separated by
//! tabs, commas or runs of blanks; the header may begin with `#`; blank lines and later lines
//! beginning with `#` are skipped; CRLF and a UTF-8 byte-order mark are accepted. Tables are written
//! tab-separated with a bare header.

mod cursor;
mod read;
mod runs;
pub mod verdict;
mod write;

pub use cursor::Cursor;
pub use read::source_name;
pub use read::{Format, Rows, Table, open, parse_number, read_bytes};
pub use runs::{Flaw, PieceRows, RunTable};
pub use write::{Sink, TableWriter, appears_whole, push_number};
