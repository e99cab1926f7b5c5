//! How a row is run: what every row of a call has in common.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, Error, Result, ensure};
use gl_table::Sink;
use serde::{Deserialize, Serialize};

use crate::model::Model;

/// What every row of a call has in common.
///
/// All paths are absolute, so that a row may be run from any folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Job {
    /// What is run.
    pub model: Model,
    /// The folder of the case.
    pub case: PathBuf,
    /// Where the runs' files go.
    pub dir: PathBuf,
    /// Where the runs have their scratch folders; `dir/.run` if absent.
    pub scratch: Option<PathBuf>,
    /// Time limit of a run.
    pub limit: Option<Duration>,
    /// Whether the runs are packed, as many into a file as [`crate::row::run_rows`] is called with.
    pub packed: bool,
    /// Threads of a Yade run where the table does not say.
    pub threads: usize,
    /// The program `gl-run`.
    pub gl_run: PathBuf,
    /// The table that gets how long each run took.
    pub times: Option<PathBuf>,
}

const FILE: &str = "job.json";

impl Job {
    /// The folder of what lives as long as the runs do.
    pub fn work(&self) -> PathBuf {
        self.dir.join(".run")
    }

    /// Leave it in `dir/.run`, for processes that run rows.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self) -> Result<()> {
        let path = self.work().join(FILE);
        let mut sink = Sink::create(Some(&path))?;
        serde_json::to_writer(&mut sink, self).with_context(|| path.display().to_string())?;
        sink.finish()
    }

    /// Read what [`Job::save`] left in a folder `.run`.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn load(work: &Path) -> Result<Self> {
        let path = work.join(FILE);
        let text = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        serde_json::from_slice(&text).with_context(|| path.display().to_string())
    }
}

/// A time limit as a user gives it: seconds, or with a unit `s`, `m`, `h` or `d`; nothing and 0 are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limit(pub Option<Duration>);

impl FromStr for Limit {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (number, unit) = match text.char_indices().next_back() {
            None => return Ok(Self(None)),
            Some((end, 's')) => (&text[..end], 1.0),
            Some((end, 'm')) => (&text[..end], 60.0),
            Some((end, 'h')) => (&text[..end], 3600.0),
            Some((end, 'd')) => (&text[..end], 86400.0),
            Some(_) => (text, 1.0),
        };
        let seconds = number.parse::<f64>().ok().map(|number| number * unit);
        let limit = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        ensure!(limit.is_some(), "{text:?} is no time limit; give seconds, or such as 10m or 2h");
        Ok(Self(limit.filter(|limit| !limit.is_zero())))
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.unwrap_or_default().as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_limits_have_units() {
        let limit = |text: &str| text.parse::<Limit>().map(|limit| limit.0.map(|limit| limit.as_secs_f64()));
        for (text, seconds) in [
            ("90", Some(90.0)),
            ("10m", Some(600.0)),
            ("2h", Some(7200.0)),
            ("1.5d", Some(129_600.0)),
            ("0", None),
            ("", None),
            ("0.5s", Some(0.5)),
        ] {
            assert_eq!(limit(text).unwrap(), seconds, "{text}");
        }
        for text in ["m", "1w", "-1", "inf", "nan", "1e300", "ten"] {
            assert!(limit(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_job_that_was_saved_is_loaded_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let job = Job {
            model: Model::Command(vec!["a b".to_owned(), "{x}".to_owned()]),
            case: "/a case".into(),
            dir: dir.path().to_owned(),
            scratch: None,
            limit: Some(Duration::from_millis(1500)),
            packed: true,
            threads: 3,
            gl_run: "/bin/gl-run".into(),
            times: None,
        };
        fs::create_dir(job.work()).unwrap();
        job.save().unwrap();
        assert_eq!(Job::load(&job.work()).unwrap(), job);
    }
}
