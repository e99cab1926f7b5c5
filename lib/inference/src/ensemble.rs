//! What the runs gave, at the control values of the measurement.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use anyhow::{Result, bail, ensure};
use rayon::prelude::*;

use crate::observations::{Observations, check_names};
use gl_table::{Cursor, Format, LARGEST, Rows, TableWriter, push_number, read_bytes};

/// Simulated observables of every run, at the steps of the measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Ensemble {
    /// Where it was read from, for messages.
    pub source: String,
    /// Name of the control column.
    pub control_name: String,
    /// Control value of each step, shape (steps,).
    pub control: Vec<f64>,
    /// Names of the observables.
    pub observables: Vec<String>,
    /// Names of the samples, shape (runs,).
    pub samples: Vec<String>,
    /// Simulated values, run by run, observable by observable, step by step.
    values: Vec<f64>,
    /// Standard deviations in the same order, where an emulator gave them.
    sd: Option<Vec<f64>>,
    /// Steps of each observable where they are of tests of their own; empty where all have all steps.
    lengths: Vec<usize>,
}

impl Ensemble {
    /// An ensemble without runs at the steps of a measurement.
    pub fn new(observations: &Observations, with_sd: bool) -> Self {
        Self {
            source: "ensemble".to_owned(),
            control_name: observations.control_name.clone(),
            control: observations.control.clone(),
            observables: observations.names.clone(),
            samples: Vec::new(),
            values: Vec::new(),
            sd: with_sd.then(Vec::new),
            lengths: observations.lengths(),
        }
    }

    /// Read an ensemble table: `sample step <control> <observables…>` and `<observable>_sd` where
    /// they are there. The rows of a sample stand together, with its steps from 0 upwards.
    ///
    /// # Errors
    /// If the table cannot be read, lacks a column, or a sample does not have all steps once, in
    /// order, at the control values of the first.
    pub fn read(path: &Path, control: &str, observables: &[String]) -> Result<Self> {
        let name = gl_table::source_name(path);
        Self::parse(&name, &read_bytes(path)?, control, observables)
    }

    /// Read an ensemble table as [`Ensemble::read`] does, with what is not named taken from its header: of
    /// the columns of numbers beside `sample` and `step`, the first is the control, and the others are the
    /// observables, but for the `_sd` of another.
    ///
    /// # Errors
    /// See [`Ensemble::read`]; also if the header leaves no control or observable to take.
    pub fn read_by_header(path: &Path, control: Option<&str>, observables: &[String]) -> Result<Self> {
        let source = gl_table::source_name(path);
        let bytes = read_bytes(path)?;
        if let (Some(control), false) = (control, observables.is_empty()) {
            return Self::parse(&source, &bytes, control, observables);
        }
        let mut rows = Rows::new(&source, &bytes)?;
        let format = rows.format().clone();
        let mut words: Vec<bool> = vec![false; format.columns().len()];
        if let Some((_, fields)) = rows.next_row()? {
            words = fields.iter().map(|field| field.parse::<f64>().is_err()).collect();
        }
        // A word among numbers is no word but a slip, which reading the column says.
        while words.iter().any(|is_word| *is_word)
            && let Some((_, fields)) = rows.next_row()?
        {
            words
                .iter_mut()
                .zip(fields)
                .for_each(|(is_word, field)| *is_word &= field.parse::<f64>().is_err());
        }
        let (control, others) = header_columns(&format, &words, control, observables)?;
        Self::parse(&source, &bytes, &control, &others)
    }

    /// Parse an ensemble table from its bytes; see [`Ensemble::read`].
    ///
    /// # Errors
    /// See [`Ensemble::read`].
    pub fn parse(source: &str, bytes: &[u8], control: &str, observables: &[String]) -> Result<Self> {
        ensure!(
            bytes.is_empty() || bytes.ends_with(b"\n"),
            "{source}: the last line has no end: the table is cut off"
        );
        let mut rows = Rows::new(source, bytes)?;
        let format = rows.format().clone();
        check_names(source, control, observables)?;
        let columns = Columns::find(&format, control, observables)?;
        let mut ensemble = Self {
            source: source.to_owned(),
            control_name: control.to_owned(),
            control: Vec::new(),
            observables: observables.to_vec(),
            samples: Vec::new(),
            values: Vec::new(),
            sd: columns.sd.as_ref().map(|_| Vec::new()),
            lengths: Vec::new(),
        };
        let mut seen: HashMap<String, ()> = HashMap::new();
        // Values of the sample being read, step by step, until it is complete.
        let (mut steps, mut values, mut sd) = (0, Vec::new(), Vec::new());
        let mut last_line = 1;
        let mut plain: Option<PlainRows> = None;
        loop {
            if let (Some(plain), Some(sample)) = (&plain, ensemble.samples.last())
                && rows.plain(|row| plain.read(row, sample, &mut values, &mut sd)).is_some()
            {
                (steps, last_line) = (steps + 1, last_line + 1);
                continue;
            }
            let Some((line, fields)) = rows.next_row()? else { break };
            let sample = fields[columns.sample];
            if ensemble.samples.last().is_none_or(|last| last != sample) {
                ensemble.close_run(last_line, steps, &mut values, &mut sd)?;
                if seen.insert(sample.to_owned(), ()).is_some() {
                    bail!("{source}:{line}: sample {sample} again; the rows of a sample stand together");
                }
                if ensemble.samples.len() == 1 {
                    plain = PlainRows::new(&ensemble.control, &columns, &format);
                }
                ensemble.samples.push(sample.to_owned());
                steps = 0;
            }
            let step = format.number(line, columns.step, fields[columns.step])?;
            ensure!(
                step == steps as f64,
                "{source}:{line}: column step: {step} where step {steps} of {sample} should follow"
            );
            let at = format.moderate(line, columns.control, fields[columns.control])?;
            if ensemble.samples.len() == 1 {
                ensemble.control.push(at);
            } else {
                let expected = ensemble.control.get(steps).copied();
                ensure!(
                    expected == Some(at),
                    "{source}:{line}: column {control}: {at} where the first sample has {}",
                    expected.map_or("no such step".to_owned(), |value| value.to_string())
                );
            }
            for &column in &columns.observables {
                values.push(format.moderate(line, column, fields[column])?);
            }
            for &column in columns.sd.iter().flatten() {
                let value = format.moderate(line, column, fields[column])?;
                ensure!(
                    value >= 0.0,
                    "{source}:{line}: column {}: a standard deviation cannot be negative",
                    format.columns()[column]
                );
                sd.push(value);
            }
            steps += 1;
            last_line = line;
        }
        ensemble.close_run(last_line, steps, &mut values, &mut sd)?;
        Ok(ensemble)
    }

    /// Take over the rows of a complete run, transposed to observable by observable.
    fn close_run(
        &mut self,
        line: usize,
        steps: usize,
        values: &mut Vec<f64>,
        sd: &mut Vec<f64>,
    ) -> Result<()> {
        let Some(sample) = self.samples.last() else { return Ok(()) };
        ensure!(
            steps == self.control.len(),
            "{}:{line}: sample {sample} ends after {steps} steps of {}; is the table cut off?",
            self.source,
            self.control.len()
        );
        let m = self.observables.len();
        let transposed = |rows: &[f64]| {
            (0..m).flat_map(|j| (0..steps).map(move |t| t * m + j)).map(|i| rows[i]).collect::<Vec<_>>()
        };
        self.values.extend(transposed(values));
        if let Some(all) = &mut self.sd {
            all.extend(transposed(sd));
        }
        values.clear();
        sd.clear();
        Ok(())
    }

    /// Add a run: its curves, and their standard deviations if the ensemble has them, each of shape
    /// (observables, steps).
    pub fn push(&mut self, sample: &str, curves: &[Vec<f64>], sd: Option<&[Vec<f64>]>) {
        self.samples.push(sample.to_owned());
        self.values.extend(curves.iter().flatten());
        if let (Some(all), Some(sd)) = (&mut self.sd, sd) {
            all.extend(sd.iter().flatten());
        }
    }

    /// Some of the runs, at the steps of a range.
    ///
    /// * `runs` — their places.
    pub fn part(&self, runs: &[usize], steps: std::ops::Range<usize>) -> Self {
        let mut part = Self {
            source: self.source.clone(),
            control_name: self.control_name.clone(),
            control: self.control[steps.clone()].to_vec(),
            observables: self.observables.clone(),
            samples: Vec::with_capacity(runs.len()),
            values: Vec::new(),
            sd: None,
            lengths: self.lengths.iter().map(|length| clipped(&steps, *length).len()).collect(),
        };
        for &run in runs {
            let cut = |curve: &[f64]| curve[clipped(&steps, curve.len())].to_vec();
            let curves: Vec<Vec<f64>> =
                (0..self.observables.len()).map(|j| cut(self.curve(run, j))).collect();
            part.push(&self.samples[run], &curves, None);
        }
        part
    }

    /// The runs without the readings that are far off in a measurement of the same steps.
    pub fn without_far_off(&self, observations: &Observations) -> Self {
        let mut near = Self::new(&observations.without_far_off(), self.sd.is_some());
        near.source.clone_from(&self.source);
        for run in 0..self.len() {
            let of = 0..self.observables.len();
            let curves: Vec<_> = of.clone().map(|j| observations.near(j, self.curve(run, j))).collect();
            let sd: Option<Vec<_>> =
                of.map(|j| self.curve_sd(run, j).map(|sd| observations.near(j, sd))).collect();
            near.push(&self.samples[run], &curves, sd.as_deref());
        }
        near
    }

    /// The runs at these places, at the steps of a range, with what an emulator said of them.
    pub fn with_runs(&self, runs: &[usize], steps: std::ops::Range<usize>) -> Self {
        let mut chosen = self.part(&[], steps.clone());
        chosen.sd = self.sd.is_some().then(Vec::new);
        let cut = |curve: &[f64]| curve[clipped(&steps, curve.len())].to_vec();
        for &run in runs {
            let of = 0..self.observables.len();
            let curves: Vec<Vec<f64>> = of.clone().map(|j| cut(self.curve(run, j))).collect();
            let sd: Option<Vec<Vec<f64>>> = of.map(|j| self.curve_sd(run, j).map(cut)).collect();
            chosen.push(&self.samples[run], &curves, sd.as_deref());
        }
        chosen
    }

    /// Put the runs of several ensembles behind each other.
    ///
    /// # Errors
    /// If they have other steps or observables than the first, or share a run.
    pub fn concatenate(ensembles: Vec<Self>) -> Result<Self> {
        let mut ensembles = ensembles.into_iter();
        let Some(mut all) = ensembles.next() else { bail!("no ensemble") };
        for other in ensembles {
            if other.is_empty() {
                continue;
            }
            if all.is_empty() {
                all = other;
                continue;
            }
            ensure!(
                other.control == all.control
                    && other.observables == all.observables
                    && other.lengths == all.lengths,
                "{}: other steps or observables than {}; collect the runs with the same measurement",
                other.source,
                all.source
            );
            let known = all.index();
            if let Some(name) = other.samples.iter().find(|name| known.contains_key(name.as_str())) {
                bail!("{}: the run {name} is in {} already", other.source, all.source);
            }
            all.samples.extend(other.samples);
            all.values.extend(other.values);
            if let (Some(sd), Some(more)) = (&mut all.sd, other.sd) {
                sd.extend(more);
            }
        }
        Ok(all)
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are no runs.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of steps; of the longest test where there are several.
    pub fn steps(&self) -> usize {
        self.control.len()
    }

    /// Steps of an observable.
    pub fn steps_of(&self, observable: usize) -> usize {
        self.lengths.get(observable).copied().unwrap_or(self.control.len())
    }

    /// Whether the observables are of several tests, each with steps of its own.
    pub fn is_stacked(&self) -> bool {
        !self.lengths.is_empty()
    }

    /// An observable of a run, shape (steps,).
    pub fn curve(&self, run: usize, observable: usize) -> &[f64] {
        &self.values[self.place(run, observable)]
    }

    /// The curves of a run, shape (observables, steps).
    pub fn curves(&self, run: usize) -> Vec<Vec<f64>> {
        (0..self.observables.len()).map(|observable| self.curve(run, observable).to_vec()).collect()
    }

    /// The standard deviation of an observable of a run, shape (steps,), if an emulator gave it.
    pub fn curve_sd(&self, run: usize, observable: usize) -> Option<&[f64]> {
        self.sd.as_ref().map(|sd| &sd[self.place(run, observable)])
    }

    fn place(&self, run: usize, observable: usize) -> std::ops::Range<usize> {
        if self.lengths.is_empty() {
            let start = (run * self.observables.len() + observable) * self.steps();
            return start..start + self.steps();
        }
        let before: usize = self.lengths[..observable].iter().sum();
        let start = run * self.lengths.iter().sum::<usize>() + before;
        start..start + self.lengths[observable]
    }

    /// Position of each run by the name of its sample.
    pub fn index(&self) -> HashMap<&str, usize> {
        self.samples.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect()
    }

    /// Check that the steps are those of a measurement.
    ///
    /// # Errors
    /// If their number or a control value differs.
    pub fn check_steps(&self, observations: &Observations) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        ensure!(
            self.steps() == observations.steps() && self.lengths == observations.lengths(),
            "{}: {} steps a sample, but {} has {} rows; collect the runs again with this measurement",
            self.source,
            self.steps(),
            observations.source,
            observations.steps()
        );
        let tolerance = CONTROL_TOLERANCE * crate::observations::range(&observations.control);
        for (step, (here, there)) in self.control.iter().zip(&observations.control).enumerate() {
            ensure!(
                (here - there).abs() <= tolerance,
                "{}: step {step} is at {} {here}, but at {there} in {}; collect the runs again with this measurement",
                self.source,
                self.control_name,
                observations.source
            );
        }
        Ok(())
    }

    /// Write the ensemble table.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        let mut table = self.begin(path)?;
        self.write_rows(&mut table)?;
        table.finish()
    }

    /// Begin an ensemble table with the columns of this ensemble.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn begin(&self, path: Option<&Path>) -> Result<TableWriter> {
        ensure!(!self.is_stacked(), "{}: runs of several tests are no one table", self.source);
        let mut columns = vec!["sample".to_owned(), "step".to_owned(), self.control_name.clone()];
        columns.extend(self.observables.iter().cloned());
        if self.sd.is_some() {
            columns.extend(self.observables.iter().map(|name| format!("{name}_sd")));
        }
        TableWriter::create(path, &columns)
    }

    /// Add the rows of all runs to a table that was begun with the columns of this ensemble.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_rows(&self, table: &mut TableWriter) -> Result<()> {
        let steps = step_texts(&self.control);
        let runs: Vec<usize> = (0..self.len()).collect();
        for several in runs.chunks(RUNS_A_PIECE * 4 * rayon::current_num_threads()) {
            let pieces: Vec<Vec<u8>> =
                several.par_chunks(RUNS_A_PIECE).map(|runs| self.rows(runs, &steps)).collect();
            for piece in pieces {
                table.rows(&piece)?;
            }
        }
        Ok(())
    }

    /// Rows of some runs, as text.
    fn rows(&self, runs: &[usize], steps: &[Vec<u8>]) -> Vec<u8> {
        let mut text = Vec::new();
        for &run in runs {
            let curves = (0..self.observables.len()).map(|j| self.curve(run, j));
            let sd = (0..self.observables.len()).filter_map(|j| self.curve_sd(run, j));
            let columns: Vec<&[f64]> = curves.chain(sd).collect();
            for (step, before) in steps.iter().enumerate() {
                text.extend_from_slice(self.samples[run].as_bytes());
                text.extend_from_slice(before);
                for column in &columns {
                    push_number(&mut text, column[step]);
                    text.push(b'\t');
                }
                text.pop();
                text.push(b'\n');
            }
        }
        text
    }
}

/// The part of a range of steps that so many steps have.
fn clipped(steps: &std::ops::Range<usize>, length: usize) -> std::ops::Range<usize> {
    steps.start.min(length)..steps.end.min(length)
}

/// Runs whose rows are made at a time.
const RUNS_A_PIECE: usize = 16;

/// The control and the observables of a table, of which some may be named.
///
/// * `words` — which columns hold nothing but words.
fn header_columns(
    format: &Format,
    words: &[bool],
    control: Option<&str>,
    observables: &[String],
) -> Result<(String, Vec<String>)> {
    let names = format.columns();
    let (known, named): (HashSet<&str>, HashSet<&str>) =
        (names.iter().map(String::as_str).collect(), observables.iter().map(String::as_str).collect());
    let is_sd = |name: &str| name.strip_suffix("_sd").is_some_and(|base| known.contains(base));
    let is_free = |j: &usize| {
        let name = names[*j].as_str();
        !matches!(name, "sample" | "step") && !is_sd(name) && !named.contains(name) && !words[*j]
    };
    let mut others: Vec<String> = (0..names.len()).filter(is_free).map(|j| names[j].clone()).collect();
    let control = match control {
        Some(control) => control.to_owned(),
        None if others.is_empty() => String::new(),
        None => others.remove(0),
    };
    others.retain(|name| *name != control);
    let observables = if observables.is_empty() { others } else { observables.to_vec() };
    ensure!(
        !observables.is_empty() && !control.is_empty(),
        "{}:1: an ensemble has the columns sample, step, a control and observables; found {}",
        format.source(),
        names.join(", ")
    );
    Ok((control, observables))
}

/// How far, as a share of the control's range, the same step may lie apart in two tables.
pub(crate) const CONTROL_TOLERANCE: f64 = 1e-7;

/// Where the columns of an ensemble table stand.
pub(crate) struct Columns {
    pub sample: usize,
    pub step: usize,
    pub control: usize,
    pub observables: Vec<usize>,
    pub sd: Option<Vec<usize>>,
}

impl Columns {
    pub(crate) fn find(format: &Format, control: &str, observables: &[String]) -> Result<Self> {
        let sd = observables
            .iter()
            .map(|name| format.find(&format!("{name}_sd")))
            .collect::<Result<Vec<Option<usize>>>>()?;
        let first_with = sd.iter().position(Option::is_some);
        if let (Some(with), Some(without)) = (first_with, sd.iter().position(Option::is_none)) {
            bail!(
                "{}:1: {with} has a column {with}_sd, but {without} has none; give every observable one, \
                 with zeros where nothing is uncertain",
                format.source(),
                with = observables[with],
                without = observables[without]
            );
        }
        let sd = sd.into_iter().collect();
        Ok(Self {
            sample: format.column("sample")?,
            step: format.column("step")?,
            control: format.column(control)?,
            observables: observables.iter().map(|name| format.column(name)).collect::<Result<_>>()?,
            sd,
        })
    }
}

/// Rows that are written as [`Ensemble::write`] writes them: the columns of an ensemble and no others,
/// at known control values.
#[derive(Debug)]
pub(crate) struct PlainRows {
    /// What stands between the sample and its observables, for each step.
    steps: Vec<Vec<u8>>,
    observables: usize,
    has_sd: bool,
}

impl PlainRows {
    /// Rows at these control values, if the table has the columns in the order in which they are
    /// written.
    pub(crate) fn new(control: &[f64], columns: &Columns, format: &Format) -> Option<Self> {
        let order = [columns.sample, columns.step, columns.control]
            .into_iter()
            .chain(columns.observables.iter().copied())
            .chain(columns.sd.iter().flatten().copied());
        (format.is_tabbed() && order.eq(0..format.columns().len())).then(|| Self {
            steps: step_texts(control),
            observables: columns.observables.len(),
            has_sd: columns.sd.is_some(),
        })
    }

    /// Add the row that comes next to the values of a run, if it is its next step.
    #[inline]
    pub(crate) fn read(
        &self,
        row: &mut Cursor<'_>,
        sample: &str,
        values: &mut Vec<f64>,
        sd: &mut Vec<f64>,
    ) -> Option<()> {
        let (before, sd_before) = (values.len(), sd.len());
        row.skip(sample.as_bytes())?;
        row.skip(self.steps.get(before / self.observables)?)?;
        let read = self.read_values(row, values, sd);
        if read.is_none() {
            values.truncate(before);
            sd.truncate(sd_before);
        }
        read
    }

    fn read_values(&self, row: &mut Cursor<'_>, values: &mut Vec<f64>, sd: &mut Vec<f64>) -> Option<()> {
        for _ in 1..self.observables {
            values.push(moderate(row, b'\t')?);
        }
        values.push(moderate(row, if self.has_sd { b'\t' } else { b'\n' })?);
        if self.has_sd {
            for j in 1..=self.observables {
                let end = if j == self.observables { b'\n' } else { b'\t' };
                sd.push(moderate(row, end).filter(|sd| *sd >= 0.0)?);
            }
        }
        Some(())
    }
}

/// A number up to [`LARGEST`], which what is not plain is held to as well.
#[inline]
fn moderate(row: &mut Cursor<'_>, end: u8) -> Option<f64> {
    row.number(end).filter(|value| value.abs() <= LARGEST)
}

/// Step and control between tabs, for each step.
fn step_texts(control: &[f64]) -> Vec<Vec<u8>> {
    let text = |(step, &control): (usize, &f64)| {
        let mut text = format!("\t{step}\t").into_bytes();
        push_number(&mut text, control);
        text.push(b'\t');
        text
    };
    control.iter().enumerate().map(text).collect()
}
