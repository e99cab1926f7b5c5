use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::SystemTime;

use anyhow::{Context, Error, Result, anyhow, bail};
use gl_case::shell::quoted;
use gl_table::{Table, TableWriter, write_whole};

/// Tools that write their conclusions as a table.
const WITH_VERDICT: [&str; 4] = ["gl-check-stop", "gl-gap-attribute", "gl-gap-locate", "gl-gap-shrink"];

/// A call of one of the tools.
#[derive(Clone, Debug)]
pub(crate) struct Call {
    tool: &'static str,
    arguments: Vec<OsString>,
}

impl Call {
    pub(crate) fn new(tool: &'static str) -> Self {
        Self { tool, arguments: Vec::new() }
    }

    pub(crate) fn arg(mut self, argument: impl AsRef<OsStr>) -> Self {
        self.arguments.push(argument.as_ref().to_owned());
        self
    }

    pub(crate) fn args<S: AsRef<OsStr>>(mut self, arguments: impl IntoIterator<Item = S>) -> Self {
        self.arguments.extend(arguments.into_iter().map(|argument| argument.as_ref().to_owned()));
        self
    }

    /// A flag with its value.
    pub(crate) fn flag(self, flag: &str, value: impl AsRef<OsStr>) -> Self {
        self.arg(flag).arg(value)
    }

    /// A flag with its value, if there is one.
    pub(crate) fn option(self, flag: &str, value: Option<impl ToString>) -> Self {
        match value {
            Some(value) => self.flag(flag, value.to_string()),
            None => self,
        }
    }

    /// A flag with a file, if there is one.
    pub(crate) fn file(self, flag: &str, file: Option<&Path>) -> Self {
        match file {
            Some(file) => self.flag(flag, file),
            None => self,
        }
    }

    /// Where the conclusions go as a table.
    pub(crate) fn verdict(self, file: &Path) -> Self {
        if !WITH_VERDICT.contains(&self.tool) {
            return self;
        }
        self.flag("--verdict", file)
    }

    /// The call as it would be typed.
    fn line(&self) -> String {
        let words = self.arguments.iter().map(|argument| quoted(&argument.to_string_lossy()));
        std::iter::once(self.tool.to_owned()).chain(words).collect::<Vec<_>>().join(" ")
    }
}

/// Where what a tool says goes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Messages<'a> {
    /// To the user at once.
    Shown,
    /// Into a file; to the user only if the tool fails.
    Kept(&'a Path),
    /// To the end of a file; to the user only if the tool fails.
    Added(&'a Path),
}

/// Calls tools, and notes each call.
#[derive(Clone, Debug)]
pub(crate) struct Runner {
    log: PathBuf,
}

impl Runner {
    /// One that notes the calls in `commands.log` of a folder, which is made.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub(crate) fn new(out: &Path) -> Result<Self> {
        make_folder(out)?;
        Ok(Self { log: out.join("commands.log") })
    }

    /// Call a tool: its exit code, 0 or 1.
    ///
    /// # Errors
    /// If it ends with another code.
    pub(crate) fn call(&self, call: &Call, messages: Messages<'_>) -> Result<i32> {
        self.note(&call.line())?;
        self.spawn(called(call), call.tool, messages)
    }

    /// Call a tool for what it says, and for nothing that stays.
    pub(crate) fn ask(&self, call: &Call) -> Result<()> {
        let mut command = called(call);
        command.stdout(Stdio::null());
        self.spawn(command, call.tool, Messages::Shown).map(|_| ())
    }

    /// [`Runner::call`] for a tool that has only one good end.
    pub(crate) fn must(&self, call: &Call, messages: Messages<'_>) -> Result<()> {
        match self.call(call, messages)? {
            0 => Ok(()),
            code => {
                bail!("{} ended with {code}; its call is the last one in {}", call.tool, self.log.display())
            }
        }
    }

    /// Call a tool that may find nothing in what it is given: whether it ended well. What it says is added to a file.
    ///
    /// # Errors
    /// If it was killed, or stopped by the system, as by a full disk: that says nothing of what it was given.
    pub(crate) fn attempt(&self, call: &Call, log: &Path) -> Result<bool> {
        self.note(&call.line())?;
        let cannot = || format!("{}: cannot be written", log.display());
        let file = File::options().create(true).append(true).open(log).with_context(cannot)?;
        let before = file.metadata().with_context(cannot)?.len();
        let status = called(call).stdin(Stdio::null()).stderr(file).status();
        let status = status.with_context(|| format!("{}: cannot be started", call.tool))?;
        match status.code() {
            Some(0) => Ok(true),
            Some(_) if is_of_the_system(&said(log, before)) => {
                show(log, before);
                Err(self.failed(call.tool, status))
            }
            Some(_) => Ok(false),
            None => bail!("{} was killed ({status})", call.tool),
        }
    }

    fn spawn(&self, mut command: Command, tool: &str, messages: Messages<'_>) -> Result<i32> {
        command.stdin(Stdio::null());
        let cannot = |path: &Path| format!("{}: cannot be written", path.display());
        let kept = match messages {
            Messages::Shown => None,
            Messages::Kept(path) => {
                command.stderr(File::create(path).with_context(|| cannot(path))?);
                Some((path, 0))
            }
            Messages::Added(path) => {
                let file = File::options().create(true).append(true).open(path);
                let file = file.with_context(|| cannot(path))?;
                let before = file.metadata().with_context(|| cannot(path))?.len();
                command.stderr(file);
                Some((path, before))
            }
        };
        let status = command.status().with_context(|| format!("{tool}: cannot be started"))?;
        match status.code() {
            Some(code @ (0 | 1)) => Ok(code),
            _ => {
                if let Some((path, before)) = kept {
                    show(path, before);
                }
                Err(self.failed(tool, status))
            }
        }
    }

    /// That a tool failed, and where to look.
    fn failed(&self, tool: &str, status: ExitStatus) -> Error {
        anyhow!("{tool} failed ({status}); its call is the last one in {}", self.log.display())
    }

    /// Add a line to the log.
    fn note(&self, line: &str) -> Result<()> {
        let file = File::options().create(true).append(true).open(&self.log);
        // In one piece, so that no line is cut by another.
        file.and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()))
            .with_context(|| format!("{}: cannot be written", self.log.display()))
    }
}

/// A tool that ends with its driver.
fn called(call: &Call) -> Command {
    let mut command = Command::new(gl_cli::sibling(call.tool));
    command.args(&call.arguments).env(gl_cli::DRIVEN, "1");
    command
}

/// Show what a file of messages holds from a byte on.
pub(crate) fn show(path: &Path, from: u64) {
    // A closed stderr is no reason to die.
    let _ = std::io::stderr().write_all(&said(path, from));
}

/// What a file has from a byte on.
fn said(path: &Path, from: u64) -> Vec<u8> {
    let mut bytes = fs::read(path).unwrap_or_default();
    let from = usize::try_from(from).unwrap_or(0).min(bytes.len());
    bytes.split_off(from)
}

/// Whether what a tool says is an error of the operating system, as [`std::io::Error`] words it. One whose last words found
/// no room, either, has said nothing.
fn is_of_the_system(said: &[u8]) -> bool {
    said.is_empty() || String::from_utf8_lossy(said).contains("(os error ")
}

/// Make a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("{}: cannot be made", path.display()))
}

/// When a file was changed; nothing if it is not there.
///
/// # Errors
/// If that cannot be read.
pub(crate) fn time(path: &Path) -> Result<Option<SystemTime>> {
    match fs::metadata(path).and_then(|metadata| metadata.modified()) {
        Ok(time) => Ok(Some(time)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("{}: cannot be read", path.display())),
    }
}

/// Whether a file is there and not older than what it is made from.
///
/// # Errors
/// If something that it is made from is not there.
pub(crate) fn is_current<P: AsRef<Path>>(target: &Path, inputs: &[P]) -> Result<bool> {
    let made = time(target)?;
    let mut is_newest = made.is_some();
    for input in inputs {
        let input = input.as_ref();
        let Some(changed) = time(input)? else { bail!("{}: not there", input.display()) };
        is_newest &= made.is_some_and(|made| made >= changed);
    }
    Ok(is_newest)
}

/// A file is as new as if it had just been made.
pub(crate) fn touch(path: &Path) -> Result<()> {
    let file = File::options().append(true).open(path);
    file.and_then(|file| file.set_modified(SystemTime::now()))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Put something into a file, whole or not at all; a file that holds it already keeps its time.
pub(crate) fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    write_whole(path, bytes)
}

/// [`put`] what another file holds.
pub(crate) fn copy(from: &Path, to: &Path) -> Result<()> {
    put(to, &fs::read(from).with_context(|| format!("{}: cannot be read", from.display()))?)
}

/// Put the rows of tables behind each other, those that `is_wanted` by their text in the first column called
/// `key`; the columns are those of the first table, by name.
///
/// # Errors
/// If a table cannot be read, or lacks a column of the first.
pub(crate) fn join(tables: &[PathBuf], to: &Path, wanted: Option<&Wanted<'_>>) -> Result<()> {
    let mut writer: Option<(TableWriter, Vec<String>)> = None;
    for path in tables {
        let table = Table::read(path)?;
        let (writer, columns) = match &mut writer {
            Some(writer) => writer,
            none => {
                let columns = table.format().columns().to_vec();
                none.insert((TableWriter::create(Some(to), &columns)?, columns))
            }
        };
        let places = columns.iter().map(|name| table.format().column(name)).collect::<Result<Vec<_>>>()?;
        let key = wanted.map(|wanted| table.format().column(wanted.column)).transpose()?;
        for row in 0..table.len() {
            if let (Some(wanted), Some(key)) = (wanted, key)
                && !(wanted.is_wanted)(table.field(row, key))
            {
                continue;
            }
            for &place in &places {
                writer.text(table.field(row, place));
            }
            writer.end_row()?;
        }
    }
    writer.map_or(Ok(()), |(writer, _)| writer.finish())
}

/// Rows to keep: by the text of a column.
pub(crate) struct Wanted<'a> {
    pub(crate) column: &'static str,
    pub(crate) is_wanted: &'a dyn Fn(&str) -> bool,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_step_is_done_when_its_output_is_not_older_than_its_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let [input, output] = ["in", "out"].map(|name| folder.path().join(name));
        assert!(is_current(&output, &[&input]).is_err());
        put(&input, b"1").unwrap();
        assert!(!is_current(&output, &[&input]).unwrap());
        put(&output, b"2").unwrap();
        assert!(is_current(&output, &[&input]).unwrap());
        let past = SystemTime::UNIX_EPOCH;
        File::options().append(true).open(&output).unwrap().set_modified(past).unwrap();
        assert!(!is_current(&output, &[&input]).unwrap());
        put(&output, b"2").unwrap();
        assert!(!is_current(&output, &[&input]).unwrap(), "the same text keeps its time");
        touch(&output).unwrap();
        assert!(is_current(&output, &[&input]).unwrap());
    }

    #[test]
    fn a_call_is_noted_as_it_would_be_typed() {
        let call = Call::new("gl-sample")
            .flag("-p", "a b/params.txt")
            .option("-n", Some(3))
            .option("-x", None::<u8>);
        assert_eq!(call.arg("it's").line(), r"gl-sample -p 'a b/params.txt' -n 3 'it'\''s'");
    }

    #[test]
    fn tables_of_any_form_are_joined_by_column() {
        let folder = tempfile::tempdir().unwrap();
        let [one, two, all] = ["1", "2", "3"].map(|name| folder.path().join(name));
        put(&one, b"a\tb\n1\t2\n").unwrap();
        put(&two, b"\xef\xbb\xbf# b,a\r\n4,3\r\n6,5\r\n").unwrap();
        join(&[one, two], &all, None).unwrap();
        assert_eq!(fs::read_to_string(&all).unwrap(), "a\tb\n1\t2\n3\t4\n5\t6\n");
        let wanted = Wanted { column: "a", is_wanted: &|a| a != "3" };
        join(std::slice::from_ref(&all), &all.with_file_name("4"), Some(&wanted)).unwrap();
        assert_eq!(fs::read_to_string(all.with_file_name("4")).unwrap(), "a\tb\n1\t2\n5\t6\n");
    }
}
