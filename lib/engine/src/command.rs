//! Calls of a scheduler's programs, with an end: a controller that is away can keep them for minutes.

use std::io::{self, Read};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::lock::OutLock;

/// What a program said before it ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Said {
    /// Whether it ended with 0.
    pub is_success: bool,
    /// Its standard output.
    pub stdout: String,
    /// Its standard error.
    pub stderr: String,
}

/// How programs are called; tests answer from recordings.
pub trait Caller {
    /// Run a program, for so long at the most.
    ///
    /// # Errors
    /// If it cannot be started, or with [`io::ErrorKind::TimedOut`], after which it has been killed.
    fn call(&self, program: &str, arguments: &[String], limit: Duration) -> io::Result<Said>;

    /// Wait before the next attempt.
    fn pause(&self, time: Duration);
}

/// The programs that are in PATH.
#[derive(Clone, Copy, Debug)]
pub struct Programs;

impl Caller for Programs {
    fn call(&self, program: &str, arguments: &[String], limit: Duration) -> io::Result<Said> {
        let mut command = Command::new(program);
        // A job has the environment of its submission, and outlives who holds the folder now.
        OutLock::forget(&mut command);
        let mut child = command
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let stdout = child.stdout.take().map(|pipe| thread::spawn(move || read_all(pipe)));
        let stderr = child.stderr.take().map(|pipe| thread::spawn(move || read_all(pipe)));
        let end = Instant::now() + limit;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            if Instant::now() >= end {
                child.kill()?;
                child.wait()?;
                let text = format!("{program}: no answer in {} s", limit.as_secs());
                return Err(io::Error::new(io::ErrorKind::TimedOut, text));
            }
            thread::sleep(Duration::from_millis(10));
        };
        let text = |reader: Option<thread::JoinHandle<String>>| {
            reader.and_then(|it| it.join().ok()).unwrap_or_default()
        };
        Ok(Said { is_success: status.success(), stdout: text(stdout), stderr: text(stderr) })
    }

    fn pause(&self, time: Duration) {
        thread::sleep(time);
    }
}

fn read_all(mut pipe: impl Read) -> String {
    let mut bytes = Vec::new();
    let _ = pipe.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
pub mod recorded {
    //! Answers that were recorded, in the order in which they are asked for.

    use std::cell::RefCell;
    use std::collections::VecDeque;
    use std::rc::Rc;

    use super::*;

    /// What happens when a program is called.
    pub enum Answer {
        /// It ends with 0 and says this.
        Says(&'static str),
        /// It ends with 1 and complains so.
        Fails(&'static str),
        /// It is not there.
        Missing,
        /// It does not end.
        Hangs,
    }

    /// Recorded answers, and the calls that were made.
    #[derive(Clone, Default)]
    pub struct Recorded {
        answers: Rc<RefCell<VecDeque<Answer>>>,
        /// Each call as one line.
        pub calls: Rc<RefCell<Vec<String>>>,
        /// Seconds of each pause.
        pub pauses: Rc<RefCell<Vec<u64>>>,
    }

    impl Recorded {
        /// With these answers.
        pub fn new(answers: impl IntoIterator<Item = Answer>) -> Self {
            Self { answers: Rc::new(RefCell::new(answers.into_iter().collect())), ..Self::default() }
        }
    }

    impl Caller for Recorded {
        fn call(&self, program: &str, arguments: &[String], _: Duration) -> io::Result<Said> {
            self.calls.borrow_mut().push(format!("{program} {}", arguments.join(" ")));
            match self.answers.borrow_mut().pop_front().expect("one call more than recorded") {
                Answer::Says(text) => {
                    Ok(Said { is_success: true, stdout: text.to_owned(), ..Said::default() })
                }
                Answer::Fails(text) => Ok(Said { stderr: text.to_owned(), ..Said::default() }),
                Answer::Missing => Err(io::ErrorKind::NotFound.into()),
                Answer::Hangs => Err(io::ErrorKind::TimedOut.into()),
            }
        }

        fn pause(&self, time: Duration) {
            self.pauses.borrow_mut().push(time.as_secs());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_does_not_answer_is_ended() {
        let start = Instant::now();
        let error = Programs.call("sleep", &["60".to_owned()], Duration::from_millis(100)).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert!(start.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn what_a_program_says_is_kept_apart() {
        let arguments = ["-c", "echo out; echo err >&2; exit 3"].map(str::to_owned);
        let said = Programs.call("sh", &arguments, Duration::from_secs(60)).unwrap();
        assert_eq!((said.is_success, said.stdout.as_str(), said.stderr.as_str()), (false, "out\n", "err\n"));
    }
}
