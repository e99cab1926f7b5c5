//! What every tool does alike: its arguments, exit codes and the last message.

mod line;
pub mod measured;
pub mod world;

use std::env;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{self, ExitCode};

use anyhow::{Context, Error, Result, bail, ensure};
use clap::{Command, Parser};
use clap_complete::Shell;
use gl_table::verdict::Verdicts;

/// A tool's arguments.
///
/// Ends the program, as [`Parser::parse`] does, for arguments that are wrong and for `--help`; and for
/// `TOOL --generate man|bash|zsh|fish`, which writes the manual page or the completions. `--generate kinds` names
/// the subcommands, a line each, and `--generate man KIND` writes the page of one. From here on long computations
/// show their progress, where stderr is a terminal.
#[allow(clippy::exit)]
pub fn parse<A: Parser>() -> A {
    let arguments: Vec<_> = env::args_os().skip(1).collect();
    if let [flag, what @ ..] = arguments.as_slice()
        && flag == "--generate"
    {
        let mut command = A::command();
        let name = command.get_name().to_owned();
        let what: Vec<_> = what.iter().map(|word| word.to_string_lossy()).collect();
        let what: Vec<&str> = what.iter().map(|word| &**word).collect();
        let outcome = finish(&name, generate(&mut command, &what));
        process::exit(i32::from(outcome != ExitCode::SUCCESS) * 2);
    }
    let arguments = A::parse();
    follow_driver();
    if let Some(line) = line::Line::on_terminal(A::command().get_name()) {
        gl_progress::watch(Box::new(line));
    }
    arguments
}

/// Set for the tools that a driver calls.
pub const DRIVEN: &str = "GL_DRIVEN";

/// A tool that a driver called ends with it: whoever stops a calibration does not want its runs to go on.
fn follow_driver() {
    #[cfg(target_os = "linux")]
    if env::var_os(DRIVEN).is_some() {
        use rustix::process::{Signal, set_parent_process_death_signal};
        // Where the system refuses, the tool goes on to its end, as it does by itself.
        let _ = set_parent_process_death_signal(Some(Signal::TERM));
    }
}

/// Write a manual page, completions or the names of the subcommands to standard output.
fn generate(command: &mut Command, what: &[&str]) -> Result<()> {
    let name = command.get_name().to_owned();
    let shell = match what {
        ["bash"] => Shell::Bash,
        ["zsh"] => Shell::Zsh,
        ["fish"] => Shell::Fish,
        ["man"] => return man(command),
        ["man", kind] => {
            command.build();
            let found = command.find_subcommand(kind);
            let kind =
                found.with_context(|| format!("--generate man {kind}: {name} has no such subcommand"))?;
            return man(kind);
        }
        ["kinds"] => {
            let kinds = command.get_subcommands().filter(|kind| !kind.is_hide_set());
            return gl_table::print(&kinds.map(|kind| kind.get_name().to_owned() + "\n").collect::<String>());
        }
        _ => bail!("--generate {}: give man, bash, zsh or fish", what.join(" ")),
    };
    let mut text = Vec::new();
    clap_complete::generate(shell, command, name.as_str(), &mut text);
    // clap_complete 4.6 takes the hyphen of a name for the start of a subcommand, where it says what one completes.
    let text = String::from_utf8_lossy(&text).replace(
        &format!("{}__subcmd__", name.replace('-', "__subcmd__")),
        &format!("{}__subcmd__", name.replace('-', "__")),
    );
    gl_table::print(&text)
}

fn man(command: &Command) -> Result<()> {
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut text)?;
    gl_table::print(&String::from_utf8_lossy(&text))
}

/// An argument that is a number and not negative.
///
/// # Errors
/// If it is not.
pub fn not_negative(text: &str) -> Result<f64> {
    let number = gl_table::parse_number(text)?;
    ensure!(number >= 0.0, "give a number that is not negative");
    Ok(number)
}

/// The largest number of anything that is made at once: samples, steps, draws.
pub const MOST: usize = 10_000_000;

/// An argument that counts what is to be made: from 1 to [`MOST`].
///
/// # Errors
/// If it is no such number.
pub fn count(text: &str) -> Result<usize> {
    let count = text.parse().ok().filter(|count| (1..=MOST).contains(count));
    count.with_context(|| format!("{text:?} is not a number from 1 to {MOST}"))
}

/// The largest number of what is dear to make: draws, runs to come.
const MOST_OF_THE_DEAR: usize = 100_000;

/// An argument that counts what is dear to make, up to a hundred thousand.
///
/// # Errors
/// If it is no such number.
pub fn few(text: &str) -> Result<usize> {
    let count = text.parse().ok().filter(|count| *count <= MOST_OF_THE_DEAR);
    count.with_context(|| format!("{text:?} is not a number up to {MOST_OF_THE_DEAR}"))
}

/// What a tool's `run` returns: done, or an answer yes or no.
pub trait Outcome {
    /// The exit code: 0 done or yes, 1 no.
    fn code(self) -> u8;
}

impl Outcome for () {
    fn code(self) -> u8 {
        0
    }
}

impl Outcome for bool {
    fn code(self) -> u8 {
        u8::from(!self)
    }
}

/// Turn a tool's result into its exit code, and say on stderr what went wrong.
///
/// Exit code 0 done or yes, 1 no, 2 error. A closed pipe is a quiet success: the reader has all that
/// it wanted.
pub fn finish<T: Outcome>(tool: &str, result: Result<T>) -> ExitCode {
    match result {
        Ok(outcome) => ExitCode::from(outcome.code()),
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            note(tool, format_args!("{error:#}"));
            ExitCode::from(2)
        }
    }
}

/// Name the input in an error that names neither a file nor a flag: the first of `inputs`, where what is wrong most
/// often is.
///
/// # Errors
/// The same.
pub fn about<'a, T>(result: Result<T>, inputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<T> {
    result.map_err(|error| {
        let text = format!("{error:#}");
        let names: Vec<String> = inputs.into_iter().map(|path| gl_table::source_name(path)).collect();
        let is_clear = text.starts_with('-') || text.contains("cannot be written") || is_closed_pipe(&error);
        match names.first() {
            Some(first) if !is_clear && !names.iter().any(|name| text.contains(name.as_str())) => {
                error.context(first.clone())
            }
            _ => error,
        }
    })
}

/// The largest share of the simulation's scatter that a measurement can have: that of a specimen of far fewer grains.
const MOST_SCATTER: f64 = 1e3;

/// An argument that is a share of the simulation's scatter: from 0 to a thousand.
///
/// # Errors
/// If it is not.
pub fn scatter(text: &str) -> Result<f64> {
    let share = not_negative(text)?;
    ensure!(share <= MOST_SCATTER, "give a share from 0 to {MOST_SCATTER}");
    Ok(share)
}

/// A message for the user on stderr, with the tool's name before it.
pub fn note(tool: &str, message: impl std::fmt::Display) {
    // A closed stderr is no reason to die.
    let _ = writeln!(io::stderr(), "{tool}: {message}");
}

/// Write the table of the conclusions where it is wanted, then the tool's own, which is read above them, and say each on
/// stderr. A tool's own table is the last of its files, so that who finds it finds all of them.
///
/// # Errors
/// If a table cannot be written.
pub fn conclude(
    tool: &str,
    verdicts: &Verdicts,
    path: Option<&Path>,
    own: impl FnOnce() -> Result<()>,
) -> Result<()> {
    path.map_or(Ok(()), |path| verdicts.write(Some(path)))?;
    own()?;
    verdicts.rows.iter().for_each(|verdict| note(tool, &verdict.text));
    Ok(())
}

/// Refuse two outputs to one file, which would lose a table.
///
/// # Errors
/// If two of the paths are the same file.
pub fn distinct<'a>(outputs: impl IntoIterator<Item = Option<&'a PathBuf>>) -> Result<()> {
    let mut taken = Vec::new();
    for path in outputs.into_iter().flatten().filter(|path| path.as_os_str() != "-") {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new(".")).canonicalize().unwrap_or_default();
        let file = path.canonicalize().unwrap_or(folder.join(path.file_name().unwrap_or_default()));
        // A device takes what it gets.
        let is_file = file.metadata().map_or(true, |metadata| metadata.is_file());
        ensure!(
            !is_file || !taken.contains(&file),
            "{}: two outputs are to go there; give each a file of its own",
            path.display()
        );
        taken.push(file);
    }
    Ok(())
}

/// Where another of the tools is: beside this one, where it was built or installed with it, else on PATH.
pub fn sibling(tool: &str) -> PathBuf {
    let beside = env::current_exe().ok().and_then(|own| Some(own.parent()?.join(tool)));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from(tool))
}

/// Whether something could not be written since nobody reads it any more.
pub fn is_closed_pipe(error: &Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
}
