//! Processes that end when they should: at their time limit, or with whoever started them.
//!
//! Each command runs in a process group of its own, led by it. Three things hold together:
//!
//! - [`tie`]: a process asks the kernel for a signal when its parent dies, however that dies.
//! - [`supervise`]: a process that is told to end, ends the group of the command it waits for.
//! - The folder's lock is inherited by all of them ([`crate::folder::RunFolder::lock`]), so that what
//!   outlives even this keeps the next engine waiting.

use std::ffi::OsString;
use std::io::{self, PipeReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result};
use rustix::io::Errno;
use rustix::process::{
    Pid, Signal, WaitId, WaitIdOptions, WaitOptions, getpid, getppid, kill_process_group,
    set_child_subreaper, set_parent_process_death_signal, test_kill_process_group, waitid, waitpgid,
};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// What a command that was told to end is given before it is killed.
const GRACE: Duration = Duration::from_secs(10);

/// What lies at the most between the ends of processes that are told to end together.
const TOGETHER: Duration = Duration::from_millis(500);

/// What a log has at the most, in bytes. A warning at every contact and step makes gigabytes, and a disk that
/// is full fails the runs of all.
pub const LONGEST_LOG: usize = 1_000_000;

/// Exit code of a process that could not run its rows since the disk takes no more: others cannot either.
pub const DISK_UNUSABLE: u8 = 2;

/// Whether an error says that the disk takes no more.
pub fn is_disk_unusable(error: &Error) -> bool {
    let kinds = error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
    kinds.into_iter().any(|kind| {
        matches!(
            kind,
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::ReadOnlyFilesystem
        )
    })
}

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// By itself, with an exit code; 128 and the signal's number where a signal ended it.
    Exited(i32),
    /// At its time limit.
    TimedOut,
    /// Since this process was told to end.
    Terminated,
}

impl Ending {
    /// The exit code that the status of a run has.
    pub fn code(self) -> i32 {
        match self {
            Self::Exited(code) => code,
            Self::TimedOut => 124,
            Self::Terminated => 143,
        }
    }
}

enum Event {
    Ended,
    Terminate,
}

/// Whether this process was told to end. A process has one of these at the most.
#[derive(Debug)]
pub struct Termination {
    sender: Sender<Event>,
    receiver: Receiver<Event>,
}

impl std::fmt::Debug for Event {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if matches!(self, Self::Ended) { "Ended" } else { "Terminate" })
    }
}

impl Termination {
    /// From now on SIGTERM, SIGINT and SIGHUP do not end this process, but what it [`supervise`]s; and what
    /// loses its parent below this process becomes its child, so that nothing is left as a zombie where
    /// there is no init, as in a container.
    ///
    /// # Errors
    /// If the signals cannot be had.
    pub fn on_signals() -> Result<Self> {
        let termination = Self::never();
        // Where the kernel cannot, init does that.
        let _ = set_child_subreaper(Some(getpid()));
        let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).context("signals cannot be handled")?;
        let sender = termination.sender.clone();
        thread::spawn(move || {
            for _ in signals.forever() {
                if sender.send(Event::Terminate).is_err() {
                    return;
                }
            }
        });
        Ok(termination)
    }

    /// One that does not come.
    pub fn never() -> Self {
        let (sender, receiver) = channel();
        Self { sender, receiver }
    }
}

/// Let the kernel send this process a signal when its parent dies, which must be `parent`, unless it has
/// died already.
///
/// # Errors
/// If the parent is gone, or the kernel cannot.
pub fn tie(signal: Signal, parent: u32) -> Result<()> {
    set_parent_process_death_signal(Some(signal)).context("the end of the parent cannot be watched")?;
    let now = getppid().map(|pid| pid.as_raw_nonzero().get());
    anyhow::ensure!(now == i32::try_from(parent).ok(), "whoever started this is gone already");
    Ok(())
}

/// A command that is killed when the process that starts it dies; it goes through `gl-run start`, which asks
/// the kernel for that and then becomes the command.
pub fn tied(gl_run: &Path) -> Command {
    let mut command = Command::new(gl_run);
    command.arg("start").arg(std::process::id().to_string());
    command
}

/// Become a command that is killed when the parent dies: what `gl-run start PARENT COMMAND` does.
///
/// Returns only if the command cannot be started, with the exit code that a shell has for it, and why.
pub fn start(parent: u32, words: &[OsString]) -> (u8, Error) {
    if let Err(error) = tie(Signal::KILL, parent) {
        return (126, error);
    }
    let Some((program, arguments)) = words.split_first() else {
        return (126, Error::msg("no command to start"));
    };
    let error = Command::new(program).args(arguments).exec();
    let code = if error.kind() == io::ErrorKind::NotFound { 127 } else { 126 };
    (code, Error::new(error).context(program.display().to_string()))
}

/// Run a command in a process group of its own until it ends, is past its time limit, or this process is
/// told to end. What it leaves running in its group is killed.
///
/// # Errors
/// If it cannot be started.
pub fn supervise(
    command: &mut Command,
    limit: Option<Duration>,
    termination: &Termination,
) -> io::Result<Ending> {
    let mut child = command.process_group(0).spawn()?;
    let group = Pid::from_child(&child);
    let sender = termination.sender.clone();
    thread::spawn(move || {
        // It stays a zombie, so that its number is no other process's when the group is killed.
        while let Err(Errno::INTR) = waitid(WaitId::Pid(group), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT)
        {
        }
        let _ = sender.send(Event::Ended);
    });
    let mut early = None;
    let mut deadline = limit.and_then(|limit| Instant::now().checked_add(limit));
    loop {
        let event = match deadline {
            Some(deadline) => {
                termination.receiver.recv_timeout(deadline.saturating_duration_since(Instant::now()))
            }
            None => termination.receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        match event {
            Ok(Event::Ended) | Err(RecvTimeoutError::Disconnected) => break,
            // Past the time that it was given to end by itself.
            Err(RecvTimeoutError::Timeout) if early.is_some() => {
                let _ = kill_process_group(group, Signal::KILL);
                deadline = None;
            }
            Err(RecvTimeoutError::Timeout) => {
                early = Some(Ending::TimedOut);
                let _ = kill_process_group(group, Signal::TERM);
                deadline = Some(Instant::now() + GRACE);
            }
            Ok(Event::Terminate) if early == Some(Ending::Terminated) => {}
            Ok(Event::Terminate) => {
                early = Some(Ending::Terminated);
                let _ = kill_process_group(group, Signal::TERM);
                deadline = Some(Instant::now() + GRACE);
            }
        }
    }
    if early.is_none() {
        let _ = kill_process_group(group, Signal::KILL);
    }
    let status = child.wait()?;
    end_group(group, deadline);
    // A scheduler that ends a task tells all its processes, in any order.
    let is_told = status.signal() == Some(SIGTERM)
        && early.is_none()
        && matches!(termination.receiver.recv_timeout(TOGETHER), Ok(Event::Terminate));
    if is_told {
        return Ok(Ending::Terminated);
    }
    Ok(early.unwrap_or(Ending::Exited(code(status))))
}

/// Wait until nothing is left of a process group whose leader has ended, and kill what is left at the deadline.
fn end_group(group: Pid, deadline: Option<Instant>) {
    let deadline = deadline.unwrap_or_else(Instant::now);
    let mut is_killed = false;
    loop {
        // Those whose parent has died are children of this process.
        while matches!(waitpgid(group, WaitOptions::NOHANG), Ok(Some(_))) {}
        if is_killed || test_kill_process_group(group).is_err() {
            return;
        }
        if Instant::now() >= deadline {
            let _ = kill_process_group(group, Signal::KILL);
            is_killed = true;
        } else {
            thread::sleep(Duration::from_millis(5));
        }
    }
}

/// The exit code as a shell has it.
pub fn code(status: ExitStatus) -> i32 {
    status.code().unwrap_or_else(|| 128 + status.signal().unwrap_or_default())
}

/// Wait for a child, which is killed first if `wait` fails.
pub(crate) fn reap(mut child: Child) -> io::Result<ExitStatus> {
    child.wait().inspect_err(|_| drop(child.kill()))
}

/// Copy what a command says into `log`, up to [`LONGEST_LOG`]; what comes after that, or after the disk is
/// full, is read and forgotten, so that the command does not wait.
pub fn keep_log(mut from: PipeReader, mut log: impl Write + Send + 'static) -> LogKeeper {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut left = LONGEST_LOG;
        let mut buffer = vec![0; 1 << 16];
        loop {
            match from.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => {
                    let kept = count.min(left);
                    left = if log.write_all(&buffer[..kept]).is_ok() { left - kept } else { 0 };
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => break,
            }
        }
        let _ = log.flush();
        let _ = sender.send(());
    });
    LogKeeper(receiver)
}

/// The thread that keeps a log.
#[derive(Debug)]
pub struct LogKeeper(Receiver<()>);

impl LogKeeper {
    /// Wait until everything is in the log. Someone who has left the command's process group may hold the
    /// pipe for ever, and is not waited for.
    pub fn finish(self) {
        let _ = self.0.recv_timeout(Duration::from_secs(1));
    }
}

#[cfg(test)]
mod tests {
    use std::process::Stdio;

    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    fn run(script: &str, limit: Option<f64>) -> Ending {
        supervise(&mut shell(script), limit.map(Duration::from_secs_f64), &Termination::never()).unwrap()
    }

    #[test]
    fn a_command_ends_with_its_code_or_its_signal() {
        assert_eq!(run("exit 3", None), Ending::Exited(3));
        assert_eq!(run("kill -9 $$", Some(60.0)), Ending::Exited(137));
        let error = supervise(&mut Command::new("no-such-program"), None, &Termination::never()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_command_past_its_limit_is_ended_with_all_that_it_started() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path().display();
        let begin = Instant::now();
        assert_eq!(run(&format!("(sleep 2; echo >{path}) & sleep 60"), Some(0.1)), Ending::TimedOut);
        assert!(begin.elapsed() < Duration::from_secs(5));
        thread::sleep(Duration::from_millis(2200));
        assert_eq!(file.as_file().metadata().unwrap().len(), 0);
    }

    #[test]
    fn what_a_command_leaves_running_ends_with_it() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(run(&format!("(sleep 1; echo >{}) &", file.path().display()), None), Ending::Exited(0));
        thread::sleep(Duration::from_millis(1300));
        assert_eq!(file.as_file().metadata().unwrap().len(), 0);
    }

    #[test]
    fn who_is_told_to_end_ends_the_command() {
        let termination = Termination::never();
        let sender = termination.sender.clone();
        thread::spawn(move || {
            thread::sleep(Duration::from_millis(100));
            sender.send(Event::Terminate)
        });
        assert_eq!(supervise(&mut shell("sleep 60"), None, &termination).unwrap(), Ending::Terminated);
    }

    #[test]
    fn a_command_that_is_told_to_end_just_before_who_started_it_has_not_ended_by_itself() {
        let termination = Termination::never();
        let sender = termination.sender.clone();
        thread::spawn(move || {
            thread::sleep(Duration::from_millis(200));
            sender.send(Event::Terminate)
        });
        assert_eq!(supervise(&mut shell("kill $$"), None, &termination).unwrap(), Ending::Terminated);
        assert_eq!(
            supervise(&mut shell("kill $$"), None, &Termination::never()).unwrap(),
            Ending::Exited(143)
        );
    }

    #[test]
    fn a_log_is_cut_and_whoever_writes_it_does_not_wait() {
        let (reader, writer) = io::pipe().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", "head -c 3000000 /dev/zero"]).stdout(writer);
        let file = tempfile::NamedTempFile::new().unwrap();
        let log = keep_log(reader, file.reopen().unwrap());
        assert_eq!(supervise(&mut command, None, &Termination::never()).unwrap(), Ending::Exited(0));
        drop(command);
        log.finish();
        assert_eq!(file.as_file().metadata().unwrap().len(), LONGEST_LOG as u64);
    }
}
