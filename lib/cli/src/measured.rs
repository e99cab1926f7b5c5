//! What was measured, on the command line: one test, or several.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_inference::ensemble::Ensemble;
use gl_inference::misfit::Incomplete;
use gl_inference::observations::{ByName, Observations, Steps};
use gl_inference::stack::{OfTest, Stack, Test, TestTables, named};
use gl_table::Table;

/// The tables of the measurement and its noise; beside them stand a `control` and `observables`.
#[derive(Args, Clone, Debug)]
pub struct Tables {
    /// Table of the measurement
    #[arg(short = 'b', long, value_name = "FILE", required_unless_present = "test", display_order = 0)]
    observations: Option<PathBuf>,
    /// Standard deviation of each observable's noise, as in f=0.02,q=1; by default the _sd columns, else it is not
    /// known, and estimated where it is needed
    #[arg(long, value_name = "NAME=SD,…")]
    noise: Option<ByName>,
    /// A test, instead of -b -c -v --noise; repeat for several. Its ensemble is then given as NAME=ENSEMBLE, and
    /// its observables are called NAME.OBSERVABLE
    #[arg(
        long,
        value_name = "NAME:OBS:CONTROL:OBSERVABLES[:NOISE[:STEPS]]",
        conflicts_with_all = ["observations", "control", "observables", "noise"]
    )]
    test: Vec<TestTables>,
}

/// The measurement of one test, or of several tests of the same samples.
#[derive(Args, Clone, Debug)]
pub struct Measured {
    /// Column of the control
    #[arg(short, long, value_name = "NAME", required_unless_present = "test")]
    control: Option<String>,
    /// Columns of the observables
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',', required_unless_present = "test")]
    observables: Vec<String>,
    #[command(flatten)]
    tables: Tables,
}

/// What [`Measured`] names, read.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// The measurement; that of all tests behind each other where there are several.
    pub observations: Observations,
    /// Standard deviation of its noise, shape (observables, steps), where it is known.
    pub noise: Option<Vec<Vec<f64>>>,
    /// The tests, where they are given as such.
    pub stack: Option<Stack>,
}

/// One test with its runs.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its name; empty where there is only one.
    pub name: String,
    /// The first of its compared steps in the table of its measurement.
    pub first: usize,
    /// Its measurement at the compared steps.
    pub observations: Observations,
    /// Standard deviation of its noise, shape (observables, compared steps), where it is known.
    pub noise: Option<Vec<Vec<f64>>>,
    /// Its runs at the compared steps.
    pub ensemble: Ensemble,
}

impl Part {
    /// What its observables are called: `test.observable` where it has a name.
    fn observables(&self) -> impl Iterator<Item = String> {
        self.observations.names.iter().map(|name| named(&self.name, name))
    }
}

/// The readings that count for nothing.
#[derive(Args, Clone, Debug)]
pub struct Outliers {
    /// Readings that are far off, and count for nothing: observable, step (gl-gap-attribute --outliers-out)
    #[arg(long, value_name = "FILE")]
    outliers: Option<PathBuf>,
}

impl Outliers {
    /// The tests with these readings marked, if some are named.
    ///
    /// # Errors
    /// If the table cannot be read, one is of an observable or a step that there is not, or nothing else is left of it.
    pub fn marked_in(&self, mut parts: Vec<Part>) -> Result<Vec<Part>> {
        let Some(table) = &self.outliers else { return Ok(parts) };
        let compared = |part: &Part| part.first..part.first + part.observations.steps();
        let of = |part| Part::observables(part).map(move |name| (name, compared(part)));
        let mut found = far_off(table, &parts.iter().flat_map(of).collect::<Vec<_>>())?.into_iter();
        for part in &mut parts {
            part.observations.far_off = found.by_ref().take(part.observations.names.len()).collect();
        }
        Ok(parts)
    }

    /// The same of the measurement of all tests behind each other.
    ///
    /// # Errors
    /// As [`Outliers::marked_in`].
    pub fn marked_in_all(&self, mut measurement: Measurement) -> Result<Measurement> {
        if let Some(table) = &self.outliers {
            measurement.observations.far_off = far_off(table, &measurement.observables())?;
        }
        Ok(measurement)
    }
}

/// A noise that was found to be another one than was stated.
#[derive(Args, Clone, Debug)]
pub struct FoundNoise {
    /// How many times the stated noise readings scatter: observable, scale (gl-gap-attribute --noise-out); as stated by
    /// default
    #[arg(long, value_name = "FILE")]
    noise_found: Option<PathBuf>,
}

impl FoundNoise {
    /// How many times the stated noise the readings of each test scatter, shape (tests, observables): 1 where nothing is known.
    ///
    /// # Errors
    /// If the table cannot be read, one is of an observable that there is not, or no noise is stated, or none of a sensible size.
    pub fn scales(&self, parts: &[Part]) -> Result<Vec<Vec<f64>>> {
        #[derive(serde::Deserialize)]
        struct Found {
            observable: String,
            scale: f64,
        }
        let mut scales: Vec<Vec<f64>> =
            parts.iter().map(|part| vec![1.0; part.observations.names.len()]).collect();
        let Some(table) = &self.noise_found else { return Ok(scales) };
        let source = table.display();
        for Found { observable, scale } in Table::read(table)?.rows::<Found>()? {
            let place = |part: &Part| part.observables().position(|name| name == observable);
            let found = parts.iter().enumerate().find_map(|(test, part)| Some((test, place(part)?)));
            let (test, place) = found.with_context(|| format!("{source}: no observable {observable}"))?;
            ensure!(parts[test].noise.is_some(), "{source}: no noise of {observable} is stated");
            ensure!(
                scale.is_normal() && scale > 0.0,
                "{source}: {scale} of {observable} is no size of a noise"
            );
            scales[test][place] = scale;
        }
        Ok(scales)
    }
}

/// Which readings a table, `observable step`, says are far off, of observables with these names and compared steps,
/// ascending; steps are counted in the table of the measurement there, and from the first compared one here.
///
/// # Errors
/// If the table cannot be read, one is of an observable or a step that there is not, or nothing else is left of it.
pub fn far_off(table: &Path, observables: &[(String, Range<usize>)]) -> Result<Vec<Vec<usize>>> {
    #[derive(serde::Deserialize)]
    struct Reading {
        observable: String,
        step: usize,
    }
    let source = table.display();
    let mut far_off = vec![Vec::new(); observables.len()];
    for Reading { observable, step } in Table::read(table)?.rows::<Reading>()? {
        let place = observables.iter().position(|(name, _)| *name == observable);
        let place = place.with_context(|| format!("{source}: no observable {observable}"))?;
        let Range { start, end } = observables[place].1;
        ensure!(
            (start..end).contains(&step),
            "{source}: step {step} of {observable} is none of {start}:{end}"
        );
        far_off[place].push(step - start);
    }
    for (of, (name, steps)) in far_off.iter_mut().zip(observables) {
        of.sort_unstable();
        of.dedup();
        ensure!(of.len() < steps.len(), "{source}: no reading of {name} is left");
    }
    Ok(far_off)
}

/// Which samples the tests lack.
fn say(tool: &str, incomplete: &[Incomplete]) {
    for Incomplete { test, samples } in incomplete {
        let (count, first) = (samples.len(), &samples[0]);
        let named = if count == 1 { first.clone() } else { format!("{count} samples, {first} first,") };
        crate::note(tool, format_args!("{named} failed in the test {test}: left out"));
    }
}

/// `NAME=FILE` of each table.
fn of_tests(tables: &[PathBuf]) -> Result<Vec<OfTest>> {
    let parse = |path: &PathBuf| {
        let text = path.to_str().with_context(|| format!("{}: no UTF-8", path.display()))?;
        text.parse::<OfTest>()
    };
    tables.iter().map(parse).collect()
}

impl Tables {
    /// Read the measurement of one test, or of all that are given as such.
    ///
    /// # Errors
    /// If there is neither. See [`Observations::read`] and [`Stack::read`].
    pub fn read(&self, control: &str, observables: &[String]) -> Result<Measurement> {
        if self.is_stack() {
            let stack = Stack::read(&self.test)?;
            let (observations, noise) = (stack.observations.clone(), stack.noise.clone());
            return Ok(Measurement { observations, noise, stack: Some(stack) });
        }
        let file = self.observations.as_ref().context("name a measurement with -b, or tests with --test")?;
        let observations = Observations::read(file, control, observables)?;
        let noise = observations.noise(&self.noise.clone().unwrap_or_default())?;
        Ok(Measurement { observations, noise, stack: None })
    }

    /// Whether tests are given as such.
    pub fn is_stack(&self) -> bool {
        !self.test.is_empty()
    }
}

impl Measured {
    /// Read the tables of the measurement.
    ///
    /// # Errors
    /// See [`Tables::read`].
    pub fn read(&self) -> Result<Measurement> {
        self.tables.read(self.control.as_deref().unwrap_or_default(), &self.observables)
    }

    /// The tables of the measurement.
    pub fn tables(&self) -> impl Iterator<Item = &PathBuf> {
        let Tables { observations, test, .. } = &self.tables;
        observations.iter().chain(test.iter().map(|test| &test.observations))
    }

    /// Whether several tests are given.
    pub fn is_stack(&self) -> bool {
        self.tables.is_stack()
    }
}

impl Measurement {
    /// Read the runs: tables of one test behind each other, or `NAME=FILE` where there are tests; `tool` says which
    /// samples a test lacks.
    ///
    /// # Errors
    /// See [`Ensemble::read`], [`Stack::read_ensembles`] and [`Stack::ensemble`].
    pub fn ensemble(&self, tool: &str, tables: &[PathBuf]) -> Result<Ensemble> {
        let Some(stack) = &self.stack else {
            let Observations { control_name, names, .. } = &self.observations;
            let ensembles = tables.iter().map(|path| Ensemble::read(path, control_name, names));
            let ensemble = Ensemble::concatenate(ensembles.collect::<Result<Vec<_>>>()?)?;
            ensemble.check_steps(&self.observations)?;
            return Ok(ensemble);
        };
        let (ensemble, incomplete) = stack.ensemble(&stack.read_ensembles(&of_tests(tables)?)?)?;
        say(tool, &incomplete);
        ensure!(!ensemble.is_empty(), "no sample has a run in all of {} tests", stack.tests.len());
        Ok(ensemble)
    }

    /// The tests, each with its compared steps and its runs of the samples that ran in all of them; one without a
    /// name where `--test` was not given.
    ///
    /// # Errors
    /// As [`Measurement::ensemble`].
    pub fn parts(&self, tool: &str, tables: &[PathBuf]) -> Result<Vec<Part>> {
        let Some(stack) = &self.stack else {
            let (observations, noise) = (self.observations.clone(), self.noise.clone());
            let ensemble = self.ensemble(tool, tables)?;
            return Ok(vec![Part { name: String::new(), first: 0, observations, noise, ensemble }]);
        };
        let (ensembles, incomplete) = stack.common(&stack.read_ensembles(&of_tests(tables)?)?);
        say(tool, &incomplete);
        ensure!(!ensembles[0].is_empty(), "no sample has a run in all of {} tests", stack.tests.len());
        let part = |(test, ensemble): (&Test, Ensemble)| {
            let cut = |noise: &Vec<f64>| noise[test.steps.clone()].to_vec();
            Part {
                name: test.name.clone(),
                first: test.steps.start,
                observations: test.observations.part(test.steps.clone()),
                noise: test.noise.as_ref().map(|noise| noise.iter().map(cut).collect()),
                ensemble,
            }
        };
        Ok(stack.tests.iter().zip(ensembles).map(part).collect())
    }

    /// Names of the observables, with the steps of each that are compared.
    fn observables(&self) -> Vec<(String, Range<usize>)> {
        let Observations { names, .. } = &self.observations;
        let Some(stack) = &self.stack else {
            return names.iter().map(|name| (name.clone(), 0..self.observations.steps())).collect();
        };
        let of = |test: &Test| {
            let steps = test.steps.clone();
            test.observables.clone().map(move |j| (names[j].clone(), steps.clone()))
        };
        stack.tests.iter().flat_map(of).collect()
    }

    /// Observable, step and control of each reading that is compared, all observables behind each other, but for those that
    /// are far off; `steps` are those of one test alone.
    pub fn places(&self, steps: &Range<usize>) -> Vec<(String, usize, f64)> {
        let control_of = |j: usize| match &self.stack {
            Some(stack) => {
                let is_of = |test: &&Test| test.observables.contains(&j);
                stack.tests.iter().find(is_of).map_or(&[] as &[f64], |test| &test.observations.control)
            }
            None => &self.observations.control,
        };
        let of = |(j, (name, compared)): (usize, (String, Range<usize>))| {
            let control = control_of(j);
            let near = self.observations.near(j, &compared.collect::<Vec<_>>()).into_iter();
            let is_seen = |step: &usize| self.stack.is_some() || steps.contains(step);
            near.filter(is_seen).map(|step| (name.clone(), step, control[step])).collect::<Vec<_>>()
        };
        self.observables().into_iter().enumerate().flat_map(of).collect()
    }

    /// Refuse steps that are given for all tests at once.
    ///
    /// # Errors
    /// If there are tests, and steps beside them.
    pub fn steps(&self, steps: Option<Steps>) -> Result<Range<usize>> {
        ensure!(
            steps.is_none() || self.stack.is_none(),
            "--steps: with --test each test has its own; give NAME:OBS:CONTROL:OBSERVABLES:NOISE:A:B"
        );
        steps.unwrap_or(Steps::ALL).within(self.observations.steps())
    }
}

/// `ENSEMBLE,WEIGHTS`, or with tests `NAME=ENSEMBLE,NAME=ENSEMBLE,…,WEIGHTS`.
///
/// # Errors
/// If there is no comma.
pub fn ensembles_and_weights(text: &str) -> Result<(Vec<PathBuf>, PathBuf)> {
    let (ensembles, weights) = text.rsplit_once(',').with_context(|| {
        format!("{text:?} is not ENSEMBLE,WEIGHTS, or NAME=ENSEMBLE,…,WEIGHTS with --test")
    })?;
    // A file may have a comma in its name; that of a test begins with the name of the test.
    let mut files: Vec<String> = Vec::new();
    for part in ensembles.split(',') {
        match files.last_mut() {
            Some(file) if part.parse::<OfTest>().is_err() => *file += &format!(",{part}"),
            _ => files.push(part.to_owned()),
        }
    }
    if files[0].parse::<OfTest>().is_err() {
        files = vec![ensembles.to_owned()];
    }
    Ok((files.into_iter().map(PathBuf::from).collect(), weights.into()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_comma_in_the_name_of_a_file_ends_it_only_before_another_test() {
        for (text, files) in [
            ("runs.txt,w.txt", vec!["runs.txt"]),
            ("a,b.txt,w.txt", vec!["a,b.txt"]),
            ("one=a.txt,two=b.txt,w.txt", vec!["one=a.txt", "two=b.txt"]),
            ("one=a,b/c.txt,two=a,b/d.txt,w.txt", vec!["one=a,b/c.txt", "two=a,b/d.txt"]),
        ] {
            let (ensembles, weights) = ensembles_and_weights(text).unwrap();
            assert_eq!(ensembles, files.into_iter().map(PathBuf::from).collect::<Vec<_>>(), "{text}");
            assert_eq!(weights, PathBuf::from("w.txt"));
        }
        assert!(ensembles_and_weights("runs.txt").is_err());
    }
}
