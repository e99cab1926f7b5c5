use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use gl_inference::rig::Kind;
use serde::de::{Deserialize, Deserializer, Error};

use crate::cluster::Cluster;
use crate::engine::Engine;
use crate::values::{
    count, not_negative, numbers_by_name, positive_by_name, share, texts_by_name, whole, word,
};

/// What `case.toml` may hold.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(crate) struct File {
    pub(crate) name: Option<String>,
    pub(crate) control: Option<String>,
    pub(crate) observables: Option<Vec<String>>,
    pub(crate) params: Option<String>,
    #[serde(deserialize_with = "positive_by_name")]
    pub(crate) noise: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "positive_by_name")]
    pub(crate) weights: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "scale")]
    pub(crate) scale: Option<String>,
    #[serde(deserialize_with = "steps")]
    pub(crate) steps: Option<String>,
    pub(crate) outliers: Option<String>,
    #[serde(deserialize_with = "texts_by_name")]
    pub(crate) units: Option<Vec<(String, String)>>,
    #[serde(deserialize_with = "numbers_by_name")]
    pub(crate) truth: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "numbers_by_name")]
    pub(crate) rig: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "count")]
    pub(crate) num: Option<NonZeroUsize>,
    #[serde(deserialize_with = "count")]
    pub(crate) iterations: Option<NonZeroUsize>,
    #[serde(deserialize_with = "whole")]
    pub(crate) seed: Option<u64>,
    pub(crate) tolerances: Tolerances,
    #[serde(deserialize_with = "share")]
    pub(crate) max_failed: Option<f64>,
    #[serde(deserialize_with = "count")]
    pub(crate) threads: Option<NonZeroUsize>,
    #[serde(deserialize_with = "flag")]
    pub(crate) packed: Option<bool>,
    pub(crate) kept: Option<String>,
    #[serde(deserialize_with = "share")]
    pub(crate) ess: Option<f64>,
    #[serde(deserialize_with = "posterior")]
    pub(crate) posterior: Option<String>,
    #[serde(deserialize_with = "whole")]
    pub(crate) emulated: Option<u64>,
    #[serde(deserialize_with = "sampling")]
    pub(crate) sampling: Option<String>,
    #[serde(deserialize_with = "count")]
    pub(crate) components: Option<NonZeroUsize>,
    #[serde(deserialize_with = "covariance")]
    pub(crate) covariance: Option<String>,
    pub(crate) effects: Option<Vec<String>>,
    #[serde(deserialize_with = "count")]
    pub(crate) design_num: Option<NonZeroUsize>,
    #[serde(deserialize_with = "measurement")]
    pub(crate) measurement: Option<Vec<String>>,
    #[serde(deserialize_with = "count")]
    pub(crate) max_effects: Option<NonZeroUsize>,
    #[serde(deserialize_with = "not_negative")]
    pub(crate) scatter: Option<f64>,
    #[serde(deserialize_with = "flag")]
    pub(crate) white: Option<bool>,
    pub(crate) model: BTreeMap<Engine, String>,
    pub(crate) cluster: Cluster,
    pub(crate) test: Option<Vec<TestEntry>>,
}

/// What a `[[test]]` may hold; what it lacks of these is taken from the case itself.
#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(crate) struct TestEntry {
    pub(crate) name: Option<String>,
    pub(crate) obs: Option<String>,
    pub(crate) control: Option<String>,
    pub(crate) observables: Option<Vec<String>>,
    #[serde(deserialize_with = "positive_by_name")]
    pub(crate) noise: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "positive_by_name")]
    pub(crate) weights: Option<Vec<(String, f64)>>,
    #[serde(deserialize_with = "steps")]
    pub(crate) steps: Option<String>,
    #[serde(deserialize_with = "numbers_by_name")]
    pub(crate) given: Option<Vec<(String, f64)>>,
    pub(crate) model: BTreeMap<Engine, String>,
}

/// Stop criteria beside the noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(default)]
pub struct Tolerances {
    /// Of σ.
    #[serde(deserialize_with = "not_negative")]
    pub sigma: Option<f64>,
    /// Of the error of the best run, as a share of the range.
    #[serde(deserialize_with = "not_negative")]
    pub error: Option<f64>,
    /// Of sigma over what the best run leaves, in what noise alone would.
    #[serde(deserialize_with = "not_negative")]
    pub misfit: Option<f64>,
    /// Of the mean error of the weighted runs, as a share of the range.
    #[serde(deserialize_with = "not_negative")]
    pub ensemble_error: Option<f64>,
}

fn scale<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    word(deserializer, &["max", "value", "range", "none"])
}

fn sampling<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    word(deserializer, &["mixture", "slice"])
}

fn covariance<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    word(deserializer, &["full", "tied", "diag", "spherical"])
}

fn posterior<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    word(deserializer, &["emulator", "weights", "runs"])
}

fn measurement<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<String>>, D::Error> {
    let value = toml::Value::deserialize(deserializer)?;
    let given = value.as_array().cloned().unwrap_or_else(|| vec![value.clone()]);
    let is_kind = |value: &toml::Value| value.as_str().is_some_and(|kind| kind.parse::<Kind>().is_ok());
    match given.iter().find(|value| !is_kind(value)) {
        Some(other) => Err(D::Error::custom(format!(
            "{other} where one of {} is needed",
            Kind::ALL.map(Kind::word).join(", ")
        ))),
        None if value.is_array() => {
            Ok(Some(given.iter().filter_map(toml::Value::as_str).map(str::to_owned).collect()))
        }
        None => Err(D::Error::custom(format!("{value} where a list is needed, such as [{value}]"))),
    }
}

/// True or false; 1 or 0 as it was typed before there was a `case.toml`.
fn flag<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<bool>, D::Error> {
    match toml::Value::deserialize(deserializer)? {
        toml::Value::Boolean(flag) => Ok(Some(flag)),
        toml::Value::Integer(flag @ (0 | 1)) => Ok(Some(flag == 1)),
        other => Err(D::Error::custom(format!("{other} where true or false is needed"))),
    }
}

/// `A:B`, from step A up to but not including step B; either may be left out.
fn steps<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    let value = toml::Value::deserialize(deserializer)?;
    let range = value.as_str().filter(|text| {
        let end = |text: &str, absent: usize| if text.is_empty() { Some(absent) } else { text.parse().ok() };
        let ends = text.split_once(':').map(|(from, to)| (end(from, 0), end(to, usize::MAX)));
        matches!(ends, Some((Some(from), Some(to))) if from < to)
    });
    match range {
        Some(range) => Ok(Some(range.to_owned())),
        None => Err(D::Error::custom(format!(
            "{value} where \"A:B\" is needed, from step A up to but not including step B"
        ))),
    }
}
