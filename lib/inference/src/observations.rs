//! What was measured: a control, what it imposes on, and the observables at its values.

use std::collections::HashSet;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};

use gl_table::Table;

/// A measurement: observables at the values of a control.
#[derive(Clone, Debug, PartialEq)]
pub struct Observations {
    /// Where it was read from, for messages.
    pub source: String,
    /// Name of the control column.
    pub control_name: String,
    /// Control values, shape (steps,).
    pub control: Vec<f64>,
    /// Names of the observables.
    pub names: Vec<String>,
    /// Measured values, shape (observables, steps).
    pub values: Vec<Vec<f64>>,
    /// Standard deviation of the measurement noise, shape (observables, steps), where a column
    /// `<observable>_sd` gives it.
    pub sd: Vec<Option<Vec<f64>>>,
    /// Steps of each observable whose readings are far off, ascending, which count for nothing; empty where none are known.
    pub far_off: Vec<Vec<usize>>,
}

impl Observations {
    /// Read the control and the named observables, with their `_sd` columns where there are any.
    ///
    /// # Errors
    /// If the table cannot be read or is cut off, has no rows, lacks a column, or holds a negative noise.
    pub fn read(path: &Path, control: &str, observables: &[String]) -> Result<Self> {
        let table = Table::read(path)?;
        table.check_end()?;
        Self::from_table(&table, control, observables)
    }

    /// The observations from a table that was read already; see [`Observations::read`].
    ///
    /// # Errors
    /// See [`Observations::read`].
    pub fn from_table(table: &Table, control: &str, observables: &[String]) -> Result<Self> {
        let source = table.format().source();
        check_names(source, control, observables)?;
        ensure!(!table.is_empty(), "{source}: no rows; a measurement has at least one");
        let mut values = Vec::new();
        let mut sd = Vec::new();
        for name in observables {
            values.push(table.moderates(name)?);
            let column = format!("{name}_sd");
            let noise = match table.format().find(&column)? {
                Some(_) => Some(table.moderates(&column)?),
                None => None,
            };
            if let Some(row) = noise.iter().flatten().position(|&sd| sd < 0.0) {
                return table.fail(row, &column, "a standard deviation cannot be negative");
            }
            sd.push(noise);
        }
        Ok(Self {
            source: source.to_owned(),
            control_name: control.to_owned(),
            control: table.moderates(control)?,
            names: observables.to_vec(),
            values,
            sd,
            far_off: Vec::new(),
        })
    }

    /// Number of steps; of the longest test where there are several, see [`Stack`](crate::stack::Stack).
    pub fn steps(&self) -> usize {
        self.control.len()
    }

    /// Steps of each observable where they are of tests of their own; empty where all have all steps.
    pub(crate) fn lengths(&self) -> Vec<usize> {
        let is_stacked = self.values.iter().any(|values| values.len() != self.control.len());
        if is_stacked { self.values.iter().map(Vec::len).collect() } else { Vec::new() }
    }

    /// The measurement at the steps of a range.
    pub fn part(&self, steps: std::ops::Range<usize>) -> Self {
        let cut =
            |values: &Vec<f64>| values[steps.start.min(values.len())..steps.end.min(values.len())].to_vec();
        let within = |far: &Vec<usize>| {
            far.iter().filter(|step| steps.contains(step)).map(|step| step - steps.start).collect()
        };
        Self {
            control: cut(&self.control),
            values: self.values.iter().map(cut).collect(),
            sd: self.sd.iter().map(|sd| sd.as_ref().map(cut)).collect(),
            far_off: self.far_off.iter().map(within).collect(),
            ..self.clone()
        }
    }

    /// What is said of each reading of an observable, shape (steps,), but of those that are far off.
    pub fn near<T: Copy>(&self, observable: usize, of_readings: &[T]) -> Vec<T> {
        let far_off = self.far_off.get(observable).map_or(&[] as &[usize], Vec::as_slice);
        let is_near = |step: &usize| far_off.binary_search(step).is_err();
        (0..of_readings.len()).filter(is_near).map(|step| of_readings[step]).collect()
    }

    /// The measurement without the readings that are far off: observables may have fewer of them than there are steps.
    pub fn without_far_off(&self) -> Self {
        let near = |(j, values): (usize, &Vec<f64>)| self.near(j, values);
        Self {
            values: self.values.iter().enumerate().map(near).collect(),
            sd: self.sd.iter().enumerate().map(|(j, sd)| sd.as_ref().map(|sd| self.near(j, sd))).collect(),
            far_off: Vec::new(),
            ..self.clone()
        }
    }

    /// Range of each observable over all steps, shape (observables,).
    pub fn ranges(&self) -> Vec<f64> {
        self.values.iter().map(|values| range(values)).collect()
    }

    /// What an error of each observable is a share of, shape (observables,): its range; its largest absolute value
    /// where it is constant, and 1 where it is zero throughout.
    pub fn sizes(&self) -> Vec<f64> {
        let of = |values: &Vec<f64>| {
            let largest = values.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            [range(values), largest, 1.0].into_iter().find(|size| *size > 0.0).unwrap_or(1.0)
        };
        self.values.iter().map(of).collect()
    }

    /// Standard deviation of the noise of every reading, shape (observables, steps): from `noise`,
    /// given by observable, else from the `_sd` columns; `None` if neither says anything.
    ///
    /// # Errors
    /// If some observables have a noise and others none, a noise is not positive, or `noise` names
    /// something that is no observable.
    pub fn noise(&self, noise: &ByName) -> Result<Option<Vec<Vec<f64>>>> {
        noise.check_names(&self.names, "--noise")?;
        let mut all = Vec::new();
        for (j, name) in self.names.iter().enumerate() {
            match (noise.get(name), &self.sd[j]) {
                (Some(sd), _) => all.push(vec![sd; self.values[j].len()]),
                (None, Some(sd)) => all.push(sd.clone()),
                (None, None) => continue,
            }
            let is_size = |sd: &f64| *sd > 0.0 && (sd * sd).is_normal();
            ensure!(
                all.iter().flatten().all(is_size),
                "{}: the noise of {name} is not positive, or its square beyond what a number can say; give \
                 its standard deviation",
                self.source
            );
        }
        if all.is_empty() {
            return Ok(None);
        }
        ensure!(
            all.len() == self.names.len(),
            "{}: some observables have a noise and others none; give --noise for each of {}",
            self.source,
            self.names.join(", ")
        );
        Ok(Some(all))
    }
}

/// Columns that a table of runs has beside those of the control and the observables.
const RESERVED: [&str; 2] = ["sample", "step"];

/// Refuse a control and observables that name a column twice, or none.
pub(crate) fn check_names(source: &str, control: &str, observables: &[String]) -> Result<()> {
    ensure!(!observables.is_empty(), "{source}: no observables (-v) named");
    let empty = observables.iter().any(String::is_empty);
    ensure!(!empty, "{source}: observables (-v): a name is empty; separate names by single commas");
    for name in observables.iter().map(String::as_str).chain([control]) {
        ensure!(
            !RESERVED.contains(&name),
            "{source}: {name} cannot be an observable (-v) or the control (-c): tables of runs have a column of that name; rename it"
        );
    }
    let mut seen = HashSet::new();
    for name in observables {
        ensure!(seen.insert(name), "{source}: observables (-v): {name} is named twice");
        ensure!(name != control, "{source}: {name} is named as control (-c) and as observable (-v)");
    }
    Ok(())
}

/// Largest minus smallest value.
pub fn range(values: &[f64]) -> f64 {
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    if values.is_empty() { 0.0 } else { high - low }
}

/// Numbers by name, as in `n=0.01,q=2`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByName(Vec<(String, f64)>);

impl ByName {
    /// The number given for `name`.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.iter().find(|(other, _)| *other == name).map(|(_, value)| value)
    }

    /// Names and numbers, in the order in which they were given.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_str(), *value))
    }

    /// Names, in that order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.iter().map(|(name, _)| name)
    }

    /// Make the number of `name` so much larger; it is 0 where none was given.
    pub fn add(&mut self, name: &str, value: f64) {
        match self.0.iter_mut().find(|(other, _)| other == name) {
            Some((_, known)) => *known += value,
            None => self.0.push((name.to_owned(), value)),
        }
    }

    /// Whether nothing was given.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The first name that is none of these.
    pub fn not_among(&self, known: &[String]) -> Option<&str> {
        self.names().find(|name| !known.iter().any(|known| known == name))
    }

    /// Check that every name is one of `names`.
    ///
    /// # Errors
    /// If one is not; `flag` says in the message where it was given.
    pub fn check_names(&self, names: &[String], flag: &str) -> Result<()> {
        if let Some(name) = self.not_among(names) {
            bail!("{flag} {name}: no such observable; they are {}", names.join(", "));
        }
        Ok(())
    }
}

impl FromIterator<(String, f64)> for ByName {
    fn from_iter<I: IntoIterator<Item = (String, f64)>>(pairs: I) -> Self {
        Self(pairs.into_iter().collect())
    }
}

impl fmt::Display for ByName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, (name, value)) in self.iter().enumerate() {
            let comma = if place > 0 { "," } else { "" };
            let is_plain = value == 0.0 || (1e-5..1e16).contains(&value.abs());
            let value = if is_plain { value.to_string() } else { format!("{value:e}") };
            write!(f, "{comma}{name}={value}")?;
        }
        Ok(())
    }
}

impl FromStr for ByName {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let mut pairs: Vec<(String, f64)> = Vec::new();
        for pair in text.split(',') {
            let (name, value) =
                pair.split_once('=').with_context(|| format!("{pair:?} is not NAME=NUMBER"))?;
            ensure!(!pairs.iter().any(|(other, _)| other == name), "{name} is given twice");
            pairs.push((name.trim().to_owned(), gl_table::parse_number(value.trim())?));
        }
        Ok(Self(pairs))
    }
}

/// A range of steps `A:B`, from A up to but not including B; either may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// First step.
    pub from: usize,
    /// One past the last step.
    pub to: usize,
}

impl Steps {
    /// Every step.
    pub const ALL: Self = Self { from: 0, to: usize::MAX };

    /// Whether a step is in the range.
    pub fn contains(self, step: usize) -> bool {
        (self.from..self.to).contains(&step)
    }

    /// The part of the range that `steps` steps have.
    ///
    /// # Errors
    /// If there is none, or the range names an end beyond them.
    pub fn within(self, steps: usize) -> Result<std::ops::Range<usize>> {
        ensure!(
            self.to == usize::MAX || self.to <= steps,
            "--steps {}:{}: the measurement has {steps} steps; end at {steps} or leave the end out",
            self.from,
            self.to
        );
        let range = self.from..self.to.min(steps);
        ensure!(
            !range.is_empty(),
            "--steps: the measurement has the steps 0 to {}, and none of those asked for",
            steps - 1
        );
        Ok(range)
    }
}

impl FromStr for Steps {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let problem = || format!("{text:?} is not A:B, from step A up to but not including step B");
        let (from, to) = text.split_once(':').with_context(problem)?;
        let number = |text: &str, absent: usize| {
            if text.is_empty() { Ok(absent) } else { text.parse::<usize>().with_context(problem) }
        };
        let steps = Self { from: number(from, 0)?, to: number(to, usize::MAX)? };
        ensure!(steps.from < steps.to, "{}", problem());
        Ok(steps)
    }
}
