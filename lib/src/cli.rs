//! What every tool does alike: exit codes and the last message.

use std::io::{self, Write};
use std::process::ExitCode;

use anyhow::{Error, Result};

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

/// A message for the user on stderr, with the tool's name before it.
pub fn note(tool: &str, message: impl std::fmt::Display) {
    // A closed stderr is no reason to die.
    let _ = writeln!(io::stderr(), "{tool}: {message}");
}

fn is_closed_pipe(error: &Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
}
