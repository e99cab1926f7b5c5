//! One driver at a time on a folder.
//!
//! The lock is that of the file `.lock` in the folder (flock), in which its holder writes who it is. All
//! processes that the holder starts inherit it, so that a step that outlives a driver that was killed keeps others out until
//! it has ended. A driver that ends by itself has waited for its steps, and frees the folder whatever they have left behind. A driver that another one starts on the same folder is told so by [`OutLock::share`].

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{self, Command};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use std::{env, io};

use anyhow::{Context, Result, bail};
use rustix::fs::FlockOperation;
use rustix::io::{Errno, FdFlags};

use crate::Say;

/// Name of the file in the folder.
const FILE: &str = ".lock";
/// Where a driver that this one starts finds who holds the folder for it.
const SHARED: &str = "GL_LOCKED_BY";

/// The right to write into a folder; given back when it is dropped.
#[derive(Debug)]
pub struct OutLock {
    /// The holder as the file says it; empty where the file system has no locks.
    holder: String,
    /// Nothing where another process holds it for this one.
    file: Option<File>,
}

impl OutLock {
    /// Take the folder, which is made where it does not exist, for `tool`.
    ///
    /// On a file system without locks this succeeds, and says so.
    ///
    /// # Errors
    /// If another driver has it: with its process, its host and since when. If the folder or the file in it
    /// cannot be made.
    pub fn take(out: &Path, tool: &str, say: Say) -> Result<Self> {
        Self::take_within(out, tool, Duration::ZERO, say)
    }

    /// As [`OutLock::take`], but wait so long for the other one to end.
    ///
    /// # Errors
    /// See [`OutLock::take`].
    pub fn take_within(out: &Path, tool: &str, patience: Duration, say: Say) -> Result<Self> {
        fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
        let path = out.join(FILE);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .with_context(|| format!("{}: cannot be opened", path.display()))?;
        let end = Instant::now() + patience;
        loop {
            match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => break,
                Err(Errno::WOULDBLOCK) => {
                    let holder = read_holder(&mut file)?;
                    if !holder.is_empty() && env::var(SHARED).is_ok_and(|it| it == token(out, &holder)) {
                        return Ok(Self { holder, file: None });
                    }
                    if Instant::now() >= end {
                        let who = if holder.is_empty() { "another process" } else { &holder };
                        bail!(
                            "{}: {who} works here; wait until it has ended, or end it there",
                            out.display()
                        );
                    }
                    thread::sleep(Duration::from_millis(100));
                }
                Err(Errno::NOTSUP | Errno::NOLCK | Errno::NOSYS) => {
                    say(&format!(
                        "{}: this file system has no locks; start one driver at a time here",
                        out.display()
                    ));
                    return Ok(Self { holder: String::new(), file: None });
                }
                Err(error) => {
                    return Err(io::Error::from(error))
                        .with_context(|| format!("{}: cannot be locked", path.display()));
                }
            }
        }
        let holder = describe(tool);
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| writeln!(file, "{holder}"))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        // Inherited by all that is started from here on.
        rustix::io::fcntl_setfd(&file, FdFlags::empty()).map_err(io::Error::from)?;
        Ok(Self { holder, file: Some(file) })
    }

    /// Let `command`, a driver for the same folder, work in it while this one holds it.
    pub fn share<'a>(&self, command: &'a mut Command, out: &Path) -> &'a mut Command {
        if self.holder.is_empty() { command } else { command.env(SHARED, token(out, &self.holder)) }
    }

    /// Take from `command` what [`OutLock::share`] has said: for jobs, which live longer than their driver.
    pub fn forget(command: &mut Command) -> &mut Command {
        command.env_remove(SHARED)
    }

    /// Who drives a folder at this moment, if anybody does; nothing is changed.
    pub fn holder(out: &Path) -> Option<String> {
        let mut file = File::open(out.join(FILE)).ok()?;
        match rustix::fs::flock(&file, FlockOperation::NonBlockingLockShared) {
            Err(Errno::WOULDBLOCK) => read_holder(&mut file).ok(),
            _ => None,
        }
    }
}

impl Drop for OutLock {
    fn drop(&mut self) {
        if let Some(file) = &mut self.file {
            // For those who look into the file.
            let _ = file.set_len(0);
            // Of all who inherited it, too: a daemon that a simulator has left would keep it for ever.
            let _ = rustix::fs::flock(&*file, FlockOperation::Unlock);
        }
    }
}

/// What a shared lock is known by: the folder, whatever it is called, and its holder.
fn token(out: &Path, holder: &str) -> String {
    let folder = fs::canonicalize(out).unwrap_or_else(|_| PathBuf::from(out));
    format!("{}: {holder}", folder.display())
}

fn read_holder(file: &mut File) -> Result<String> {
    let mut text = String::new();
    file.rewind()?;
    file.read_to_string(&mut text)?;
    Ok(text.trim().to_owned())
}

/// `gl-calibrate (process 4711 on node3, since 2026-11-22 00:20:32 UTC)`.
fn describe(tool: &str) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    format!("{tool} (process {} on {host}, since {} UTC)", process::id(), date(now))
}

/// Seconds since 1970 as `YYYY-MM-DD HH:MM:SS`.
fn date(seconds: u64) -> String {
    let (days, rest) = (seconds / 86400, seconds % 86400);
    // Eras of 400 years that begin in March, so that the leap day is the last of its year.
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = 400 * era + year_of_era + next;
    format!("{year}-{month:02}-{day:02} {:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn silent(text: &str) {
        panic!("{text}");
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        // Oracle: date -u -d @SECONDS
        for (seconds, expected) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_399, "2000-02-28 23:59:59"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_735_689_599, "2024-12-31 23:59:59"),
            (4_107_542_400, "2100-03-01 00:00:00"),
        ] {
            assert_eq!(date(seconds), expected);
        }
    }

    #[test]
    fn the_second_driver_is_told_who_has_it() {
        let out = tempfile::tempdir().unwrap();
        let first = OutLock::take(out.path(), "gl-calibrate", &silent).unwrap();
        let message = OutLock::take(out.path(), "gl-diagnose", &silent).unwrap_err().to_string();
        let expected = format!("gl-calibrate (process {} on ", process::id());
        assert!(message.contains(&expected) && message.contains(" UTC) works here"), "{message}");
        assert!(OutLock::holder(out.path()).unwrap().starts_with(&expected));
        drop(first);
        assert_eq!(OutLock::holder(out.path()), None);
        OutLock::take(out.path(), "gl-diagnose", &silent).unwrap();
    }

    #[test]
    fn who_waits_gets_it_when_the_first_has_ended() {
        let out = tempfile::tempdir().unwrap();
        let first = OutLock::take(out.path(), "first", &silent).unwrap();
        thread::scope(|scope| {
            let second = scope.spawn(|| {
                OutLock::take_within(out.path(), "second", Duration::from_secs(20), &silent).is_ok()
            });
            thread::sleep(Duration::from_millis(200));
            drop(first);
            assert!(second.join().unwrap());
        });
    }

    #[test]
    fn a_driver_that_another_one_starts_shares_its_lock() {
        let out = tempfile::tempdir().unwrap();
        let lock = OutLock::take(out.path(), "first", &silent).unwrap();
        let mut command = Command::new("true");
        lock.share(&mut command, &out.path().join("."));
        let shared: Vec<_> = command.get_envs().collect();
        assert_eq!(shared.len(), 1);
        assert_eq!(shared[0].1.unwrap().to_string_lossy(), token(out.path(), &lock.holder));
        OutLock::forget(&mut command);
        assert_eq!(command.get_envs().next().unwrap().1, None);
    }

    #[test]
    fn what_the_driver_has_started_keeps_the_lock_when_it_is_gone() {
        let out = tempfile::tempdir().unwrap();
        let first = OutLock::take(out.path(), "first", &silent).unwrap();
        let mut step = Command::new("sleep").arg("60").spawn().unwrap();
        // As if the driver had been killed: nothing is given back.
        let mut first = first;
        drop(first.file.take());
        assert!(OutLock::take(out.path(), "second", &silent).is_err());
        step.kill().unwrap();
        step.wait().unwrap();
        OutLock::take(out.path(), "second", &silent).unwrap();
    }
}
