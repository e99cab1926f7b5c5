use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// Append the shortest decimal that reads back to the same `f64`.
pub fn push_number(text: &mut Vec<u8>, value: f64) {
    let mut buffer = zmij::Buffer::new();
    let digits = buffer.format(value);
    if value.abs() >= 1e16 {
        // 1e16, not 1e+16.
        text.extend(digits.bytes().filter(|byte| *byte != b'+'));
    } else {
        text.extend_from_slice(digits.strip_suffix(".0").unwrap_or(digits).as_bytes());
    }
}

/// Where a table goes: standard output, or a file that appears whole or not at all.
///
/// A file is written beside its destination as `.NAME.part` and renamed by [`Sink::finish`]; one that
/// is never finished is removed.
#[derive(Debug)]
pub struct Sink {
    name: String,
    inner: Inner,
}

#[derive(Debug)]
enum Inner {
    Stdout(BufWriter<io::Stdout>),
    /// A device or a pipe, which cannot be renamed onto.
    Special(BufWriter<File>),
    File {
        writer: Option<BufWriter<File>>,
        part: PathBuf,
        destination: PathBuf,
    },
}

const BUFFER: usize = 1 << 18;

/// Whether a table at `path` appears whole or not at all. What goes to standard output (`path` absent or
/// `-`), a pipe or a device cannot be taken back.
pub fn appears_whole(path: Option<&Path>) -> bool {
    path.filter(|path| *path != Path::new("-"))
        .is_some_and(|path| fs::metadata(path).map_or(true, |metadata| metadata.is_file()))
}

impl Sink {
    /// Standard output if `path` is absent or `-`, else the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            let stdout = BufWriter::with_capacity(BUFFER, io::stdout());
            return Ok(Self { name: "stdout".to_owned(), inner: Inner::Stdout(stdout) });
        };
        let name = path.display().to_string();
        let cannot = || format!("{name}: cannot be written");
        let inner = match fs::metadata(path) {
            Ok(metadata) if !metadata.is_file() => {
                ensure!(!metadata.is_dir(), "{name}: is a directory; name a file");
                let file = File::options().write(true).open(path).with_context(cannot)?;
                Inner::Special(BufWriter::with_capacity(BUFFER, file))
            }
            _ => {
                // A link is followed, so that what it points at is replaced and not the link.
                let destination = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
                let file_name =
                    destination.file_name().with_context(|| format!("{name}: is not the name of a file"))?;
                let mut part = std::ffi::OsString::from(".");
                part.push(file_name);
                part.push(".part");
                let part = destination.with_file_name(part);
                let file = File::create(&part).with_context(cannot)?;
                let writer = Some(BufWriter::with_capacity(BUFFER, file));
                Inner::File { writer, part, destination }
            }
        };
        Ok(Self { name, inner })
    }

    /// Flush, check that everything was written, and put a file in its place.
    ///
    /// # Errors
    /// If the disk is full, the pipe is closed, or the file cannot be renamed.
    pub fn finish(mut self) -> Result<()> {
        let cannot = format!("{}: cannot be written", self.name);
        match &mut self.inner {
            Inner::Stdout(writer) => writer.flush().context(cannot),
            Inner::Special(writer) => writer.flush().context(cannot),
            Inner::File { writer, part, destination } => {
                let Some(writer) = writer.take() else { return Ok(()) };
                let file = writer.into_inner().map_err(io::IntoInnerError::into_error);
                file.and_then(|file| file.sync_all())
                    .and_then(|()| fs::rename(part, destination))
                    .context(cannot)
            }
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.inner {
            Inner::Stdout(writer) => writer.write(bytes),
            Inner::Special(writer) | Inner::File { writer: Some(writer), .. } => writer.write(bytes),
            Inner::File { writer: None, .. } => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.inner {
            Inner::Stdout(writer) => writer.flush(),
            Inner::Special(writer) | Inner::File { writer: Some(writer), .. } => writer.flush(),
            Inner::File { writer: None, .. } => Ok(()),
        }
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        if let Inner::File { part, .. } = &self.inner {
            // Gone already after a rename; otherwise half a table that nobody should find.
            let _ = fs::remove_file(part);
        }
    }
}

/// Writes a table row by row: tab-separated, a bare header, a newline after the last row.
#[derive(Debug)]
pub struct TableWriter {
    sink: Sink,
    row: Vec<u8>,
}

impl TableWriter {
    /// Begin a table at `path` (standard output if absent or `-`) with its column names.
    ///
    /// # Errors
    /// If the destination cannot be created or written.
    pub fn create<S: AsRef<str>>(path: Option<&Path>, columns: &[S]) -> Result<Self> {
        let mut writer = Self { sink: Sink::create(path)?, row: Vec::new() };
        for column in columns {
            writer.text(column.as_ref());
        }
        writer.end_row()?;
        Ok(writer)
    }

    /// Add a text field to the row: `-` if it is empty, blanks in place of tabs and line ends.
    pub fn text(&mut self, field: &str) -> &mut Self {
        self.separate();
        let field = if field.is_empty() { "-" } else { field };
        let start = self.row.len();
        self.row.extend_from_slice(field.as_bytes());
        for byte in &mut self.row[start..] {
            if matches!(byte, b'\t' | b'\n' | b'\r') {
                *byte = b' ';
            }
        }
        self
    }

    /// Add a number to the row.
    pub fn number(&mut self, value: f64) -> &mut Self {
        self.separate();
        push_number(&mut self.row, value);
        self
    }

    /// Add several numbers to the row.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        for &value in values {
            self.number(value);
        }
        self
    }

    fn separate(&mut self) {
        if !self.row.is_empty() {
            self.row.push(b'\t');
        }
    }

    /// End the row.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn end_row(&mut self) -> Result<()> {
        self.row.push(b'\n');
        let written = self.sink.write_all(&self.row);
        self.row.clear();
        written.with_context(|| format!("{}: cannot be written", self.sink.name))
    }

    /// Write rows that are text already, each with its line end.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn rows(&mut self, rows: &[u8]) -> Result<()> {
        self.sink.write_all(rows).with_context(|| format!("{}: cannot be written", self.sink.name))
    }

    /// End the table and put it in its place.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<()> {
        self.sink.finish()
    }
}
