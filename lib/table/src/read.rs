use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::str;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::cursor::Cursor;
use super::pipe::Stdin;
use super::runs::PieceRows;
use super::write::INCOMPLETE;

/// The largest number that is calculated with: its square, divided by a small variance and summed, is a number still.
pub const LARGEST: f64 = 1e100;

/// How the fields of one table are laid out: its column names and what separates them.
#[derive(Clone, Debug)]
pub struct Format {
    source: String,
    /// Line of the header.
    line: usize,
    columns: Vec<String>,
    /// Where each name stands first, and whether it stands there alone.
    places: HashMap<String, (usize, bool)>,
    separator: Separator,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    Tab,
    Comma,
    Blanks,
}

impl Separator {
    fn byte(self) -> u8 {
        match self {
            Self::Tab => b'\t',
            Self::Comma => b',',
            Self::Blanks => b' ',
        }
    }
}

impl Format {
    /// Read the column names from a header line, with or without a leading `#`.
    ///
    /// `source` names the table in messages, `line` is the header's line number.
    ///
    /// # Errors
    /// If the line holds no names, or nothing but numbers, or semicolons between its fields.
    pub fn from_header(source: &str, line: usize, header: &str) -> Result<Self> {
        let header = header.trim_start().trim_start_matches('#').trim();
        let separator = if header.contains('\t') {
            Separator::Tab
        } else if header.contains(',') {
            Separator::Comma
        } else {
            Separator::Blanks
        };
        let mut fields = Vec::new();
        split(header, separator, &mut fields);
        ensure!(
            !header.is_empty(),
            "{source}:{line}: the header is empty; the first line must name the columns"
        );
        ensure!(
            !(header.contains(';') && fields.iter().rev().skip(1).all(|field| field.ends_with(';'))),
            "{source}:{line}: fields separated by semicolons, in {header:?}: tables have tabs, blanks or commas between fields, and points in decimal numbers"
        );
        ensure!(
            !fields.iter().all(|field| field.parse::<f64>().is_ok()),
            "{source}:{line}: no header: the first line must name the columns, found {header:?}"
        );
        let columns: Vec<String> = fields.into_iter().map(str::to_owned).collect();
        let mut places = HashMap::new();
        for (j, name) in columns.iter().enumerate() {
            places.entry(name.clone()).and_modify(|(_, is_alone)| *is_alone = false).or_insert((j, true));
        }
        Ok(Self { source: source.to_owned(), line, columns, places, separator })
    }

    /// Name of the table in messages.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Column names, in order.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Whether fields are separated by tabs, as they are written here.
    pub fn is_tabbed(&self) -> bool {
        self.separator == Separator::Tab
    }

    /// Position of the column called `name`.
    ///
    /// # Errors
    /// If no column, or more than one, has that name.
    pub fn column(&self, name: &str) -> Result<usize> {
        self.find(name)?.with_context(|| {
            let columns = self.columns.join(", ");
            format!("{}:{}: no column {name}; the columns are {columns}", self.source, self.line)
        })
    }

    /// Position of the column called `name`, if there is one.
    ///
    /// # Errors
    /// If more than one column has that name.
    pub fn find(&self, name: &str) -> Result<Option<usize>> {
        match self.places.get(name) {
            Some((_, false)) => bail!("{}:{}: duplicate column {name}", self.source, self.line),
            place => Ok(place.map(|&(j, _)| j)),
        }
    }

    /// Split a line into as many fields as there are columns.
    ///
    /// # Errors
    /// If the line has another number of fields.
    pub fn split<'a>(&self, number: usize, line: &'a str, fields: &mut Vec<&'a str>) -> Result<()> {
        self.split_fields(line, fields).map_err(|problem| anyhow!("{}:{number}: {problem}", self.source))
    }

    /// [`Format::split`] for a line whose number is not known yet.
    ///
    /// # Errors
    /// If the line has another number of fields.
    pub fn split_fields<'a>(&self, line: &'a str, fields: &mut Vec<&'a str>) -> Result<(), String> {
        split(line, self.separator, fields);
        if fields.len() != self.columns.len() && self.separator != Separator::Blanks {
            // A header written with tabs above rows written with blanks.
            split(line, Separator::Blanks, fields);
        }
        if fields.len() != self.columns.len() {
            if line.starts_with(INCOMPLETE) {
                return Err("the table ends here: what wrote it could not finish it".to_owned());
            }
            let fields = match fields.len() {
                1 => "1 field".to_owned(),
                many => format!("{many} fields"),
            };
            let hint = if self.separator == Separator::Blanks && line.contains(';') {
                "; a table is separated by tabs, commas or blanks, with a point in its numbers"
            } else {
                ""
            };
            return Err(format!("{fields} where the header names {}{hint}", self.columns.len()));
        }
        Ok(())
    }

    /// A field as a number that can be calculated with, up to [`LARGEST`].
    ///
    /// # Errors
    /// If it is no such number; the message names file, line and column.
    pub fn moderate(&self, line: usize, column: usize, field: &str) -> Result<f64> {
        let value = self.number(line, column, field)?;
        ensure!(
            value.abs() <= LARGEST,
            "{}:{line}: column {}: {value:e}, but the square of what exceeds {LARGEST:e} is soon beyond what a \
             number can say; did a run blow up, or is the unit not a sensible one?",
            self.source,
            self.columns[column]
        );
        Ok(value)
    }

    /// A field as a finite number.
    ///
    /// # Errors
    /// If it is no number, or not a finite one; the message names file, line and column.
    pub fn number(&self, line: usize, column: usize, field: &str) -> Result<f64> {
        parse_number(field)
            .map_err(|problem| anyhow!("{}:{line}: column {}: {problem}", self.source, self.columns[column]))
    }
}

fn split<'a>(line: &'a str, separator: Separator, fields: &mut Vec<&'a str>) {
    fields.clear();
    match separator {
        Separator::Blanks => fields.extend(line.split_ascii_whitespace()),
        _ => {
            let mut start = 0;
            for end in memchr::memchr_iter(separator.byte(), line.as_bytes()) {
                fields.push(line[start..end].trim());
                start = end + 1;
            }
            fields.push(line[start..].trim());
        }
    }
}

/// A finite number, or what is wrong with the field.
///
/// # Errors
/// If the field is no number, NaN or infinite.
pub fn parse_number(field: &str) -> Result<f64> {
    match field.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(anyhow!("{field} where a finite number is needed")),
        Err(_) => Err(anyhow!("{field:?} is not a number")),
    }
}

/// The rows of a table one by one, for tables too large to keep field by field.
#[derive(Debug)]
pub struct Rows<'a> {
    format: Format,
    rows: PieceRows<'a>,
    fields: Vec<&'a str>,
}

impl<'a> Rows<'a> {
    /// Begin with the header of a table held in `bytes`; `source` names it in messages.
    ///
    /// # Errors
    /// If there is no header, or the text is not UTF-8.
    pub fn new(source: &str, bytes: &'a [u8]) -> Result<Self> {
        let text = str::from_utf8(bytes).map_err(|error| {
            let before = &bytes[..error.valid_up_to()];
            anyhow!("{source}:{}: not UTF-8 text", 1 + before.iter().filter(|&&byte| byte == b'\n').count())
        })?;
        let mut rest = text.strip_prefix('\u{feff}').unwrap_or(text);
        ensure!(
            rest.contains('\n') || !rest.contains('\r'),
            "{source}: its lines end with CR alone; let them end with LF (tr '\\r' '\\n')"
        );
        let mut line = 0;
        loop {
            let Some(header) = next_line(&mut rest) else {
                bail!("{source}: empty; a table begins with a line that names the columns");
            };
            line += 1;
            if !header.trim().is_empty() {
                let format = Format::from_header(source, line, header)?;
                return Ok(Self { format, rows: PieceRows::after(line, rest), fields: Vec::new() });
            }
        }
    }

    /// Layout of the fields: source and column names.
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// Take in the next row by `read`; see [`PieceRows::plain`].
    pub fn plain<T>(&mut self, read: impl FnOnce(&mut Cursor<'a>) -> Option<T>) -> Option<T> {
        self.rows.plain(read)
    }

    /// Add the next row to `numbers` if it is nothing but finite numbers, with one separator between
    /// two of them.
    pub fn next_numbers(&mut self, numbers: &mut Vec<f64>) -> Option<()> {
        let (start, separator) = (numbers.len(), self.format.separator.byte());
        let columns = self.format.columns.len();
        let read = self.rows.plain(|row| {
            for column in 1..=columns {
                numbers.push(row.number(if column == columns { b'\n' } else { separator })?);
            }
            Some(())
        });
        if read.is_none() {
            numbers.truncate(start);
        }
        read
    }

    /// The next row: its line number and its fields.
    ///
    /// # Errors
    /// If it has another length than the header.
    pub fn next_row(&mut self) -> Result<Option<(usize, &[&'a str])>> {
        let Some((number, line)) = self.rows.next() else { return Ok(None) };
        self.format.split(number, line, &mut self.fields)?;
        Ok(Some((number, &self.fields)))
    }
}

/// Cut the first line off, without its line end.
pub(crate) fn next_line<'a>(rest: &mut &'a str) -> Option<&'a str> {
    if rest.is_empty() {
        return None;
    }
    let (line, after) = match memchr::memchr(b'\n', rest.as_bytes()) {
        Some(end) => (&rest[..end], &rest[end + 1..]),
        None => (*rest, ""),
    };
    *rest = after;
    Some(line.strip_suffix('\r').unwrap_or(line))
}

/// The name of an input in messages: its path, or `stdin` for `-`.
pub fn source_name(path: &Path) -> String {
    if path == Path::new("-") { "stdin".to_owned() } else { path.display().to_string() }
}

/// All bytes of a file, or of standard input if `path` is `-`.
///
/// # Errors
/// If the file cannot be read, or standard input was asked for before.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let name = source_name(path);
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes).with_context(|| format!("{name}: cannot be read"))?;
    Ok(bytes)
}

/// Open a file, or standard input if `path` is `-`.
///
/// # Errors
/// If the file cannot be opened, or standard input was asked for before.
pub fn open(path: &Path) -> Result<Box<dyn Read + Send>> {
    static STDIN_TAKEN: AtomicBool = AtomicBool::new(false);
    if path == Path::new("-") {
        ensure!(
            !STDIN_TAKEN.swap(true, Ordering::Relaxed),
            "two inputs are to come from stdin; give one of them as a file"
        );
        return Ok(Box::new(Stdin(io::stdin())));
    }
    let file = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
    Ok(Box::new(file))
}
