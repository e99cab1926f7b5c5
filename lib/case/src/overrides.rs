use anyhow::{Context, Result, bail, ensure};
use toml::Value;

use crate::fields::fields_of;
use crate::file::File;
use crate::places::suggestion;

/// A setting given for one call, `KEY=VALUE`.
#[derive(Debug)]
pub(crate) struct Override {
    /// The setting, such as `noise` or `tolerances.sigma`.
    pub(crate) path: String,
    /// What it is set to.
    pub(crate) value: Value,
}

/// Names that settings have had, and those that they have.
const FORMER: [(&str, &str); 4] = [
    ("sigma_tol", "tolerances.sigma"),
    ("error_tol", "tolerances.error"),
    ("ensemble_error_tol", "tolerances.ensemble_error"),
    ("misfit_tol", "tolerances.misfit"),
];

/// What names the runs and the columns is the case itself, and not a setting.
const FIXED: [&str; 4] = ["name", "control", "observables", "test"];

impl Override {
    /// From `KEY=VALUE`: the key in any case; the value as in `case.toml`, or in short: a list `a,b`, numbers by
    /// name `f=0.005,t=0.001`, a text without quotes.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let (key, value) = text.split_once('=').with_context(|| format!("{text}: is not KEY=VALUE"))?;
        let key = key.trim().to_lowercase();
        let former = FORMER.iter().find(|(former, _)| *former == key);
        let path = former.map_or(key.clone(), |(_, path)| (*path).to_owned());
        let top = path.split('.').next().unwrap_or_default();
        let known = fields_of::<File>();
        ensure!(
            known.contains(&top),
            "{text}: {key}: {}",
            suggestion(&key, &known, "no such setting; they are")
        );
        ensure!(
            !FIXED.contains(&top),
            "{text}: {top} belongs to the case and is not changed for a call; change it in case.toml"
        );
        if path == "model" {
            ensure!(!value.trim().is_empty(), "{text}: the command is empty");
            return Ok(Self { path, value: Value::String(value.to_owned()) });
        }
        let mut problem = None;
        for value in readings(value.trim()) {
            match toml::from_str::<File>(&document(&path, &value)) {
                Ok(_) => return Ok(Self { path, value }),
                Err(error) => problem = Some(error.message().to_owned()),
            }
        }
        bail!("{text}: {}", problem.unwrap_or_default())
    }
}

/// All that a text can mean: the value in the words of TOML, a list, numbers by name, a text.
fn readings(text: &str) -> Vec<Value> {
    let scalar = |text: &str| match toml::from_str::<toml::Table>(&format!("x = {text}")) {
        Ok(mut table) => table.remove("x"),
        Err(_) => None,
    };
    let as_written = scalar(text);
    let parts: Vec<&str> = text.split(',').map(str::trim).filter(|part| !part.is_empty()).collect();
    let list = parts.iter().map(|part| Value::String((*part).to_owned())).collect();
    let row = |part: &&str| {
        let (name, value) = part.split_once('=')?;
        Some((name.trim().to_owned(), scalar(value.trim())?))
    };
    let by_name = parts.iter().map(row).collect::<Option<toml::Table>>();
    // What the message is about if nothing does comes last.
    let as_text = Value::String(text.to_owned());
    let mut readings = vec![Value::Array(list)];
    readings.extend(by_name.map(Value::Table));
    if as_written.is_some() {
        readings.insert(0, as_text);
        readings.extend(as_written);
    } else {
        readings.push(as_text);
    }
    readings
}

/// A document of nothing but one setting.
fn document(path: &str, value: &Value) -> String {
    let parts = path.rsplit('.');
    let mut value = value.clone();
    let mut table = toml::Table::new();
    for part in parts {
        table = toml::Table::from_iter([(part.to_owned(), value)]);
        value = Value::Table(table.clone());
    }
    table.to_string()
}
