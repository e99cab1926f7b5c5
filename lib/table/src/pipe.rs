//! Whether a table in a pipe is whole, which its last line does not say.
//!
//! A program that is killed leaves a pipe that ends like any other. So a table that is written into a pipe marks it as
//! unfinished, and takes the mark away at its end. The mark is in the pipe's mode, which nothing else looks at, and
//! not in the table: other programs read that, too. Where there are no such modes, or another program stands in between
//! or writes, there is no mark, and a pipe is believed.

use std::fs;
use std::io::{self, Read};
use std::os::fd::{AsFd, AsRawFd};

use rustix::fs::{FileType, Mode, fchmod, fstat};

/// What a pipe has that nobody marked.
const PLAIN: Mode = Mode::RUSR.union(Mode::WUSR);

/// Added to it as long as a table is not finished.
const UNFINISHED: Mode = Mode::XUSR;

/// Mark the pipe that standard output is as unfinished, or take the mark away.
pub(crate) fn mark_stdout(is_unfinished: bool) {
    let stdout = io::stdout();
    if mode_of_pipe(&stdout).is_some() {
        // A pipe that takes no mark has none.
        let _ = fchmod(stdout, if is_unfinished { PLAIN | UNFINISHED } else { PLAIN });
    }
}

/// The mode of a pipe without a name; that of a file or a named pipe is its owner's.
fn mode_of_pipe(file: impl AsFd) -> Option<Mode> {
    let found = fstat(&file).ok()?;
    let is_pipe = FileType::from_raw_mode(found.st_mode) == FileType::Fifo;
    let link = || fs::read_link(format!("/proc/self/fd/{}", file.as_fd().as_raw_fd())).ok();
    let has_no_name = is_pipe && link()?.to_string_lossy().starts_with("pipe:");
    has_no_name.then(|| Mode::from_raw_mode(found.st_mode))
}

/// Standard input, at whose end an error stands where it is a pipe with an unfinished table.
pub(crate) struct Stdin(pub(crate) io::Stdin);

impl Read for Stdin {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.0.read(buffer)?;
        let is_end = count == 0 && !buffer.is_empty();
        if is_end && mode_of_pipe(&self.0).is_some_and(|mode| mode.contains(UNFINISHED)) {
            return Err(io::Error::other("it is cut off: what wrote it ended before its table did"));
        }
        Ok(count)
    }
}
