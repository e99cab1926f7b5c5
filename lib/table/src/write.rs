use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, bail, ensure};
use csv::{QuoteStyle, WriterBuilder};
use rustix::fs::{AtFlags, CWD, Mode, OFlags};
use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};
use tempfile::{Builder, NamedTempFile};

use super::pipe::mark_stdout;
use super::row::columns_of;

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
/// A file is written beside its destination under a name of its own, made for it alone, and renamed by
/// [`Sink::finish`]; one that is never finished is removed. Of a table on standard output that is never finished
/// nothing comes out, or, where much of it has gone already, a last line that no table has; and a pipe is left with a mark
/// ([`crate::pipe`]), however this program ends.
#[derive(Debug)]
pub struct Sink {
    name: String,
    inner: Inner,
}

#[derive(Debug)]
enum Inner {
    Stdout {
        writer: BufWriter<io::Stdout>,
        /// Bytes so far.
        count: usize,
    },
    /// A device or a pipe, which cannot be renamed onto.
    Special(BufWriter<File>),
    File {
        writer: BufWriter<Part>,
        destination: PathBuf,
    },
    Finished,
}

const BUFFER: usize = 1 << 18;

/// How the line begins that ends a table which could not be finished.
pub(crate) const INCOMPLETE: &str = "!incomplete";

/// Whether a table at `path` appears whole or not at all. What goes to standard output (`path` absent or
/// `-`), a pipe or a device cannot be taken back.
pub fn appears_whole(path: Option<&Path>) -> bool {
    path.filter(|path| *path != Path::new("-"))
        .is_some_and(|path| fs::metadata(path).map_or(true, |metadata| metadata.is_file()))
}

/// Whether standard output was closed before this program began, so that Rust has put a null device there,
/// open for reading, too. Others put one like that there on purpose: who means it for a table says so.
fn stdout_is_closed() -> bool {
    const READ_WRITE: u32 = 2;
    let flags = || {
        let info = fs::read_to_string("/proc/self/fdinfo/1").ok()?;
        let flags = info.lines().find_map(|line| line.strip_prefix("flags:"))?;
        u32::from_str_radix(flags.trim(), 8).ok()
    };
    fs::read_link("/proc/self/fd/1").is_ok_and(|path| path == Path::new("/dev/null"))
        && flags().is_some_and(|flags| flags & 3 == READ_WRITE)
}

/// Write to standard output what is no table. Nothing is lost by it that is not in a file, or in the exit code: a null device is as
/// good as any.
///
/// # Errors
/// If it cannot be written.
pub fn print(text: &str) -> Result<()> {
    let mut stdout = io::stdout();
    stdout.write_all(text.as_bytes())?;
    Ok(stdout.flush()?)
}

/// What is said where a table would go nowhere.
const CLOSED: &str = "stdout is closed (or a null device that is open for reading, too); give -o FILE, or -o /dev/null for no table";

impl Sink {
    /// Standard output if `path` is absent or `-`, else the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be created, or standard output is closed.
    pub fn create(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            ensure!(!stdout_is_closed(), CLOSED);
            mark_stdout(true);
            let writer = BufWriter::with_capacity(BUFFER, io::stdout());
            return Ok(Self { name: "stdout".to_owned(), inner: Inner::Stdout { writer, count: 0 } });
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
                ensure!(destination.file_name().is_some(), "{name}: is not the name of a file");
                let part = Part::beside(&destination).with_context(cannot)?;
                Inner::File { writer: BufWriter::with_capacity(BUFFER, part), destination }
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
        match std::mem::replace(&mut self.inner, Inner::Finished) {
            Inner::Stdout { mut writer, .. } => {
                writer.flush().context(cannot)?;
                mark_stdout(false);
                Ok(())
            }
            Inner::Special(mut writer) => writer.flush().context(cannot),
            Inner::File { writer, destination } => {
                let part = writer.into_inner().map_err(io::IntoInnerError::into_error);
                part.and_then(|part| part.put(&destination)).context(cannot)
            }
            Inner::Finished => Ok(()),
        }
    }
}

/// What is to become a file, where nobody else sees or writes it.
#[derive(Debug)]
enum Part {
    /// Without a name, so that nothing of it is left when this program is killed.
    Unnamed(File),
    /// `.NAME.XXXXXX.part` beside its destination, on file systems that want a name.
    Named(NamedTempFile),
}

/// What the user's mask leaves of it.
const MODE: u32 = 0o666;

impl Part {
    fn beside(destination: &Path) -> io::Result<Self> {
        let can_be_named_later = Path::new("/proc/self/fd").exists();
        if can_be_named_later
            && let Ok(file) = rustix::fs::open(
                folder_of(destination),
                OFlags::TMPFILE | OFlags::WRONLY | OFlags::CLOEXEC,
                Mode::from_raw_mode(MODE),
            )
        {
            return Ok(Self::Unnamed(File::from(file)));
        }
        let permissions = fs::Permissions::from_mode(MODE);
        let name = prefix(destination);
        let mut builder = Builder::new();
        builder.prefix(&name).suffix(".part").permissions(permissions);
        builder.tempfile_in(folder_of(destination)).map(Self::Named)
    }

    /// Put it into the place of `destination`, once all of it is on the disk.
    fn put(self, destination: &Path) -> io::Result<()> {
        let named = match self {
            Self::Named(file) => {
                file.as_file().sync_all()?;
                file
            }
            Self::Unnamed(file) => {
                file.sync_all()?;
                let own = format!("/proc/self/fd/{}", file.as_raw_fd());
                let link = |path: &Path| {
                    rustix::fs::linkat(CWD, own.as_str(), CWD, path, AtFlags::SYMLINK_FOLLOW)?;
                    file.try_clone()
                };
                // What is not there yet gets its name at once; who is killed between two names leaves the first.
                if link(destination).is_ok() {
                    return Ok(());
                }
                Builder::new()
                    .prefix(&prefix(destination))
                    .suffix(".part")
                    .make_in(folder_of(destination), link)?
            }
        };
        named.persist(destination)?;
        Ok(())
    }
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Unnamed(file) => file.write(bytes),
            Self::Named(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn folder_of(destination: &Path) -> &Path {
    destination.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// How the name of a part begins.
fn prefix(destination: &Path) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(destination.file_name().unwrap_or_default());
    prefix.push(".");
    prefix
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.inner {
            Inner::Stdout { writer, count } => {
                let written = writer.write(bytes)?;
                *count += written;
                Ok(written)
            }
            Inner::Special(writer) => writer.write(bytes),
            Inner::File { writer, .. } => writer.write(bytes),
            Inner::Finished => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.inner {
            Inner::Stdout { writer, .. } => writer.flush(),
            Inner::Special(writer) => writer.flush(),
            Inner::File { writer, .. } => writer.flush(),
            Inner::Finished => Ok(()),
        }
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        match std::mem::replace(&mut self.inner, Inner::Finished) {
            // Nothing has gone out yet, and nothing will.
            Inner::Stdout { writer, count } if writer.buffer().len() == count => {
                let _ = writer.into_parts();
            }
            // Whoever reads on is not to take it for complete.
            Inner::Stdout { mut writer, .. } => {
                let _ = writeln!(writer, "{INCOMPLETE}");
            }
            // A part goes with its writer: half a table that nobody should find.
            Inner::File { .. } | Inner::Special(_) | Inner::Finished => {}
        }
    }
}

/// Write a file that appears whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut sink = Sink::create(Some(path))?;
    sink.write_all(bytes).with_context(|| format!("{}: cannot be written", path.display()))?;
    sink.finish()
}

/// Remove a file that need not be there.
///
/// # Errors
/// If it is there and stays.
pub fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
        }
        _ => Ok(()),
    }
}

/// Writes a table row by row: tab-separated, a bare header, a newline after the last row.
#[derive(Debug)]
pub struct TableWriter {
    sink: Sink,
    row: Vec<u8>,
    columns: Vec<String>,
    /// Fields of the row so far.
    fields: usize,
    /// The first number of the row that is none: NaN or an infinity.
    flaw: Option<(usize, f64)>,
}

impl TableWriter {
    /// Begin a table at `path` (standard output if absent or `-`) with its column names.
    ///
    /// # Errors
    /// If the destination cannot be created or written.
    pub fn create<S: AsRef<str>>(path: Option<&Path>, columns: &[S]) -> Result<Self> {
        let names = columns.iter().map(|name| name.as_ref().to_owned()).collect();
        let sink = Sink::create(path)?;
        let mut writer = Self { sink, row: Vec::new(), columns: names, fields: 0, flaw: None };
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

    /// Add `yes` or `no` to the row.
    pub fn yes_no(&mut self, value: bool) -> &mut Self {
        self.text(word(value))
    }

    /// Add a number to the row. [`TableWriter::end_row`] refuses one that is not finite.
    pub fn number(&mut self, value: f64) -> &mut Self {
        if !value.is_finite() && self.flaw.is_none() {
            self.flaw = Some((self.fields, value));
        }
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
        self.fields += 1;
        if !self.row.is_empty() {
            self.row.push(b'\t');
        }
    }

    /// End the row.
    ///
    /// # Errors
    /// If it cannot be written, or a number in it is NaN or an infinity.
    pub fn end_row(&mut self) -> Result<()> {
        self.fields = 0;
        if let Some((place, value)) = self.flaw.take() {
            let column = self.columns.get(place).map_or("", String::as_str);
            bail!(
                "{}: column {column}: the result is {value}, beyond what a number can say; are the numbers that it comes from of a sensible size?",
                self.sink.name
            );
        }
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

/// A number to so many significant digits, as `%g` of C prints it: without zeros at the end, with a power of ten
/// where it is very large or small.
///
/// ```
/// # use gl_table::rounded;
/// assert_eq!(rounded(1234.5678, 5), "1234.6");
/// assert_eq!(rounded(0.5, 3), "0.5");
/// assert_eq!(rounded(1234567.0, 3), "1.23e+06");
/// assert_eq!(rounded(0.0000123456, 3), "1.23e-05");
/// ```
pub fn rounded(value: f64, digits: usize) -> String {
    let digits = digits.max(1);
    if !value.is_finite() {
        return value.to_string().to_lowercase();
    }
    let scientific = format!("{value:.*e}", digits - 1);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trimmed = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    let places = i32::try_from(digits).unwrap_or(i32::MAX) - 1 - exponent;
    if exponent < -4 || places < 0 {
        let sign = if exponent < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trimmed(mantissa), exponent.abs());
    }
    trimmed(&format!("{value:.*}", usize::try_from(places).unwrap_or(0)))
}

/// Write rows of a serde type as a table at `path` (standard output if absent or `-`), with a header even
/// where there are none. Numbers go through [`number`] and [`optional_number`].
///
/// ```
/// #[derive(serde::Serialize, serde::Deserialize)]
/// struct Reading {
///     #[serde(serialize_with = "gl_table::number")]
///     u: f64,
///     #[serde(serialize_with = "gl_table::optional_number")]
///     f: Option<f64>,
/// }
/// gl_table::write_rows(None, &[Reading { u: 2.0, f: None }])?;
/// # Ok::<(), gl_table::Error>(())
/// ```
///
/// # Errors
/// If the table cannot be written.
pub fn write_rows<T: Serialize + DeserializeOwned>(path: Option<&Path>, rows: &[T]) -> Result<()> {
    let sink = Sink::create(path)?;
    let name = sink.name.clone();
    let cannot = |error: csv::Error| match error.into_kind() {
        // For the caller to see a closed pipe, which csv::Error has no source for.
        csv::ErrorKind::Io(error) => Error::new(error).context(format!("{name}: cannot be written")),
        csv::ErrorKind::Serialize(problem) => Error::msg(format!("{name}: {problem}")),
        other => Error::msg(format!("{name}: cannot be written: {other:?}")),
    };
    let mut writer = WriterBuilder::new()
        .has_headers(false)
        .delimiter(b'\t')
        .quote_style(QuoteStyle::Never)
        .from_writer(sink);
    writer.write_record(columns_of::<T>()).map_err(cannot)?;
    for row in rows {
        writer.serialize(row).map_err(cannot)?;
    }
    let sink = writer.into_inner().map_err(|error| cannot(error.into_error().into()))?;
    sink.finish()
}

/// For serde: a number as the shortest decimal that reads back to the same `f64`.
///
/// # Errors
/// If it is NaN or an infinity, and those of the serializer.
pub fn number<S: Serializer>(value: &f64, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    if !value.is_finite() {
        return Err(serde::ser::Error::custom(format_args!(
            "the result is {value}, beyond what a number can say; are the numbers that it comes from of a sensible size?"
        )));
    }
    let mut text = Vec::new();
    push_number(&mut text, *value);
    serializer.serialize_str(&String::from_utf8_lossy(&text))
}

/// For serde: a number as [`number`] writes it, or `-`.
///
/// # Errors
/// Those of the serializer.
pub fn optional_number<S: Serializer>(
    value: &Option<f64>,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    match value {
        Some(value) => number(value, serializer),
        None => serializer.serialize_str("-"),
    }
}

/// For serde: a text as a field: `-` if it is empty, blanks in place of tabs and line ends.
///
/// # Errors
/// Those of the serializer.
pub fn text<S: Serializer>(value: &str, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    let flat = value.replace(['\t', '\n', '\r'], " ");
    serializer.serialize_str(if flat.is_empty() { "-" } else { &flat })
}

/// For serde: `yes` or `no`.
///
/// # Errors
/// Those of the serializer.
pub fn yes_no<S: Serializer>(value: &bool, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.serialize_str(word(*value))
}

fn word(value: bool) -> &'static str {
    if value { "yes" } else { "no" }
}
