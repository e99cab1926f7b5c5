//! What a site wants of the jobs: the table `[cluster]` of `case.toml`, or a file of its own with the same
//! keys at top level.
//!
//! The values reach job scripts and the options of schedulers, so that only plain characters are let in.

use std::fmt;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use serde::Deserialize;
use serde::de::{self, Deserializer, SeqAccess, Visitor};

/// Settings of a site for its job arrays and controlling jobs.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(default, deny_unknown_fields)]
pub struct Cluster {
    /// Partition (SLURM) or queue (PBS).
    #[serde(deserialize_with = "word")]
    pub partition: Option<String>,
    /// Account that pays.
    #[serde(deserialize_with = "word")]
    pub account: Option<String>,
    /// Quality of service; PBS has no counterpart.
    #[serde(deserialize_with = "word")]
    pub qos: Option<String>,
    /// Time limit of a task: minutes, or as the scheduler writes times.
    #[serde(deserialize_with = "word")]
    pub time: Option<String>,
    /// Memory of a task, as the scheduler writes it.
    #[serde(deserialize_with = "word")]
    pub mem: Option<String>,
    /// Modules to load before a task, in this order.
    #[serde(deserialize_with = "words")]
    pub modules: Vec<String>,
    /// Processors of a run.
    #[serde(deserialize_with = "count")]
    pub threads: usize,
    /// Rows that a task runs one after another.
    #[serde(deserialize_with = "count")]
    pub rows_per_task: usize,
    /// Tasks at a time.
    #[serde(deserialize_with = "limit")]
    pub max_concurrent: Option<usize>,
    /// Time limit of a run, such as `90`, `10m`, `2h`.
    #[serde(deserialize_with = "word")]
    pub run_timeout: Option<String>,
    /// Times that a failed run is submitted again.
    #[serde(deserialize_with = "retries")]
    pub retries: usize,
    /// One file a task instead of the files of each run; as the environment has it when absent.
    pub packed: Option<bool>,
    /// Folder on the node's own disk.
    #[serde(deserialize_with = "word")]
    pub scratch: Option<String>,
    /// Seconds between questions to the scheduler; 2, growing to 30, when absent.
    #[serde(deserialize_with = "seconds")]
    pub poll: Option<f64>,
}

impl Default for Cluster {
    fn default() -> Self {
        Self {
            partition: None,
            account: None,
            qos: None,
            time: None,
            mem: None,
            modules: Vec::new(),
            threads: 1,
            rows_per_task: 1,
            max_concurrent: None,
            run_timeout: None,
            retries: 0,
            packed: None,
            scratch: None,
            poll: None,
        }
    }
}

impl Cluster {
    /// Read a file with these settings at top level.
    ///
    /// # Errors
    /// If it cannot be read, or has a setting that does not exist or a value of another kind, with its line.
    pub fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
        Self::parse(&text, &path.display().to_string())
    }

    /// The settings in `text`, which messages call `source`; see [`Cluster::read`].
    ///
    /// # Errors
    /// See [`Cluster::read`].
    pub fn parse(text: &str, source: &str) -> Result<Self> {
        toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = text[..start].matches('\n').count() + 1;
            let key =
                text.lines().nth(line - 1).and_then(|it| it.split_once('=')).map_or("", |it| it.0.trim());
            let at = if error.message().contains(key) { String::new() } else { format!("{key}: ") };
            anyhow!("{source}:{line}: {at}{}", error.message())
        })
    }
}

/// Whether job scripts and options may hold this text as it is.
fn is_plain(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "_.,:/+@%=-".contains(c))
}

fn plain<E: de::Error>(text: &str) -> Result<String, E> {
    if is_plain(text) && !text.starts_with('-') {
        return Ok(text.to_owned());
    }
    Err(E::custom(format!("{text:?}: use letters, digits and _ . , : / + @ % = - (no leading -)")))
}

/// A word, or a number that stands for one, such as `time = 60`.
struct Word;

impl Visitor<'_> for Word {
    type Value = Option<String>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a text or a whole number")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
        // An empty one is none, so that a case can undo a default.
        if text.is_empty() { Ok(None) } else { plain(text).map(Some) }
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Self::Value, E> {
        if number < 1 {
            return Err(E::custom(format!("{number}: give a number above 0")));
        }
        Ok(Some(number.to_string()))
    }
}

fn word<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    deserializer.deserialize_any(Word)
}

/// Words in a list, or in one text with blanks between them.
struct Words;

impl<'de> Visitor<'de> for Words {
    type Value = Vec<String>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of texts, or one text")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
        text.split_whitespace().map(plain).collect()
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut words = Vec::new();
        while let Some(text) = list.next_element::<String>()? {
            words.push(plain(&text)?);
        }
        Ok(words)
    }
}

fn words<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    deserializer.deserialize_any(Words)
}

fn at_least<'de, D: Deserializer<'de>>(deserializer: D, least: i64) -> Result<usize, D::Error> {
    let number = i64::deserialize(deserializer)?;
    usize::try_from(number)
        .ok()
        .filter(|_| number >= least)
        .ok_or_else(|| de::Error::custom(format!("{number}: give a whole number from {least}")))
}

fn count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    at_least(deserializer, 1)
}

fn limit<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<usize>, D::Error> {
    at_least(deserializer, 1).map(Some)
}

fn retries<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    at_least(deserializer, 0)
}

struct Seconds;

impl Visitor<'_> for Seconds {
    type Value = Option<f64>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number of seconds")
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Self::Value, E> {
        self.visit_f64(number as f64)
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Self::Value, E> {
        if !(number > 0.0 && number <= 86400.0) {
            return Err(E::custom(format!("{number}: give a number of seconds above 0, a day at the most")));
        }
        Ok(Some(number))
    }
}

fn seconds<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    deserializer.deserialize_any(Seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Cluster {
        Cluster::parse(text, "case.toml").unwrap()
    }

    fn refused(text: &str) -> String {
        Cluster::parse(text, "case.toml").unwrap_err().to_string()
    }

    #[test]
    fn what_is_not_given_has_its_default() {
        let cluster = parsed("");
        assert_eq!(cluster, Cluster::default());
        assert_eq!((cluster.threads, cluster.rows_per_task, cluster.retries), (1, 1, 0));
    }

    #[test]
    fn numbers_and_texts_stand_for_the_same() {
        assert_eq!(parsed("time = 60\nrun_timeout = 90"), parsed("time = '60'\nrun_timeout = '90'"));
        assert_eq!(parsed("time = '1-12:00:00'").time.as_deref(), Some("1-12:00:00"));
        assert_eq!(parsed("mem = '4G'\npartition = ''").partition, None);
        assert_eq!(parsed("poll = 2"), parsed("poll = 2.0"));
    }

    #[test]
    fn modules_are_a_list_or_one_text() {
        assert_eq!(parsed("modules = ['gcc/12', 'yade']"), parsed("modules = 'gcc/12 yade'"));
    }

    #[test]
    fn all_keys_are_known() {
        let cluster = parsed(
            "partition = 'long'\naccount = 'a'\nqos = 'q'\ntime = 60\nmem = '2G'\nmodules = 'yade'\nthreads = 2\n\
             rows_per_task = 4\nmax_concurrent = 8\nrun_timeout = '10m'\nretries = 1\npacked = true\n\
             scratch = '/scratch'\npoll = 0.3\n",
        );
        assert_eq!((cluster.threads, cluster.rows_per_task, cluster.max_concurrent), (2, 4, Some(8)));
        assert_eq!((cluster.retries, cluster.packed, cluster.poll), (1, Some(true), Some(0.3)));
    }

    #[test]
    fn a_setting_that_does_not_exist_is_refused_with_its_line_and_those_that_do() {
        let message = refused("time = 5\nPARTITON = 'x'\n");
        assert!(message.starts_with("case.toml:2: unknown field `PARTITON`"), "{message}");
        assert!(message.contains("`partition`"), "{message}");
    }

    #[test]
    fn wrong_values_are_refused_with_their_line_and_key() {
        for (setting, expected) in [
            ("account = '$(touch hit)'", "account: \"$(touch hit)\": use letters"),
            ("modules = 'a;b'", "modules: \"a;b\": use letters"),
            ("modules = ['a', 'b c']", "modules: \"b c\": use letters"),
            ("partition = '--wrap'", "partition: \"--wrap\""),
            ("rows_per_task = 0", "rows_per_task: 0: give a whole number from 1"),
            ("threads = 'two'", "threads: invalid type: string \"two\""),
            ("max_concurrent = -1", "max_concurrent: -1"),
            ("retries = -1", "retries: -1: give a whole number from 0"),
            ("packed = 'yes'", "packed: invalid type: string \"yes\", expected a boolean"),
            ("poll = 'often'", "poll: invalid type"),
            ("poll = nan", "poll: NaN: give a number of seconds"),
            ("time = -5", "time: -5: give a number above 0"),
            ("time = true", "time: invalid type: boolean `true`, expected a text or a whole number"),
        ] {
            let message = refused(&format!("# the site\n{setting}\n"));
            assert!(message.starts_with(&format!("case.toml:2: {expected}")), "{setting}: {message}");
        }
    }
}
