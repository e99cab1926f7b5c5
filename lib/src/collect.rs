//! Reading what the runs wrote, and leaving out the runs that failed.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use rayon::prelude::*;

use crate::alignment::align;
use crate::ensemble::Ensemble;
use crate::observations::Observations;
use crate::progress::stage;
use crate::samples::Samples;
use crate::table::{Format, Rows, parse_number};

/// Why a run cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// One of its files is not there.
    Missing(String),
    /// The file has no rows.
    Empty,
    /// It ends before the measurement does, or in the middle of a line.
    Truncated(String),
    /// It holds NaN or an infinity.
    NonFinite(String),
    /// It ran with other parameters than the table's.
    Parameters(String),
    /// Its loading path is not the measurement's.
    Control(String),
    /// The file is no table of numbers with the columns asked for.
    Malformed(String),
}

impl Failure {
    /// The reason in one word, as the status table has it.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Missing(_) => "missing",
            Self::Empty => "empty",
            Self::Truncated(_) => "truncated",
            Self::NonFinite(_) => "non-finite",
            Self::Parameters(_) => "parameters",
            Self::Control(_) => "control",
            Self::Malformed(_) => "malformed",
        }
    }

    /// What exactly was found.
    pub fn detail(&self) -> &str {
        match self {
            Self::Empty => "no rows",
            Self::Missing(detail)
            | Self::Truncated(detail)
            | Self::NonFinite(detail)
            | Self::Parameters(detail)
            | Self::Control(detail)
            | Self::Malformed(detail) => detail,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.reason(), self.detail())
    }
}

/// How runs are read: where from, which columns, and what is let pass.
#[derive(Clone, Debug)]
pub struct Collection<'a> {
    /// The measurement whose steps the runs are brought onto.
    pub observations: &'a Observations,
    /// What the runs call the control.
    pub control: String,
    /// What the runs call the observables, in the order of the measurement's.
    pub observables: Vec<String>,
    /// Folders that hold the runs' files.
    pub folders: Vec<PathBuf>,
    /// Relative difference up to which a run's parameters are the table's.
    pub rtol: f64,
    /// Share of the control's range by which a run may fall short.
    pub end_tolerance: f64,
}

/// The runs that can be used, and for each sample why its run cannot, in the order of the samples.
#[derive(Clone, Debug)]
pub struct Collected {
    /// Curves of the good runs.
    pub ensemble: Ensemble,
    /// One entry a sample.
    pub status: Vec<Result<(), Failure>>,
}

impl Collected {
    /// Number of failed runs.
    pub fn failed(&self) -> usize {
        self.status.iter().filter(|status| status.is_err()).count()
    }
}

impl Collection<'_> {
    /// Read the run of every sample.
    ///
    /// # Errors
    /// If a run is in two folders, or a folder cannot be read. A run that failed is no error.
    pub fn collect(&self, samples: &Samples) -> Result<Collected> {
        for folder in &self.folders {
            fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
        }
        let stage = stage("reading runs", samples.len());
        let runs: Vec<Result<Vec<Vec<f64>>, Failure>> = (0..samples.len())
            .into_par_iter()
            .map(|i| self.run(samples, i))
            .inspect(|_| stage.advance())
            .collect::<Result<_>>()?;
        drop(stage);
        let mut ensemble = Ensemble::new(self.observations, false);
        let mut status = Vec::with_capacity(runs.len());
        for (name, run) in samples.names.iter().zip(runs) {
            status.push(run.map(|curves| ensemble.push(name, &curves, None)));
        }
        Ok(Collected { ensemble, status })
    }

    /// One run at the steps of the measurement, shape (observables, steps), or why there is none.
    fn run(&self, samples: &Samples, i: usize) -> Result<Result<Vec<Vec<f64>>, Failure>> {
        let name = &samples.names[i];
        let file = format!("{name}_sim.txt");
        let mut found: Option<(&Path, Vec<u8>)> = None;
        for folder in &self.folders {
            match fs::read(folder.join(&file)) {
                Ok(_) if found.is_some() => {
                    bail!("{file} is in {} and in another folder; name only one of them", folder.display())
                }
                Ok(bytes) => found = Some((folder, bytes)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => {
                    return Ok(Err(Failure::Malformed(format!("{}: {error}", folder.join(&file).display()))));
                }
            }
        }
        let Some((folder, bytes)) = found else {
            let ending = self.ending(name).map_or(String::new(), |ending| format!("; exit code {ending}"));
            return Ok(Err(Failure::Missing(format!("no {file}{ending}"))));
        };
        let curves = self.check_parameters(folder, samples, i).and_then(|()| self.curves(&file, &bytes));
        Ok(curves)
    }

    /// How a run ended, from the `<description>.status` that the engines leave: an exit code, and a word
    /// such as TIMEOUT where it was not the model that ended it.
    fn ending(&self, name: &str) -> Option<String> {
        let file = format!("{name}.status");
        let text = self.folders.iter().find_map(|folder| fs::read_to_string(folder.join(&file)).ok())?;
        let words: Vec<&str> = text.lines().next()?.split_whitespace().collect();
        (!words.is_empty()).then(|| words.join(" "))
    }

    /// Compare the parameters that the run wrote down with the table's.
    fn check_parameters(&self, folder: &Path, samples: &Samples, i: usize) -> Result<(), Failure> {
        let file = format!("{}_param.txt", samples.names[i]);
        let bytes = match fs::read(folder.join(&file)) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(Failure::Missing(format!("no {file}")));
            }
            Err(error) => return Err(Failure::Malformed(format!("{file}: {error}"))),
        };
        let malformed = |error: anyhow::Error| Failure::Malformed(format!("{error:#}"));
        let mut rows = Rows::new(&file, &bytes).map_err(malformed)?;
        let format = rows.format().clone();
        let Some((_, fields)) = rows.next_row().map_err(malformed)? else {
            return Err(Failure::Parameters(format!("{file} has no row")));
        };
        for (name, &expected) in samples.parameters.iter().zip(&samples.values[i]) {
            let column = format.find(name).map_err(malformed)?;
            let Some(column) = column else {
                return Err(Failure::Parameters(format!("{file} has no column {name}")));
            };
            let close = |value: f64| (value - expected).abs() <= self.rtol * value.abs().max(expected.abs());
            if !fields[column].parse::<f64>().is_ok_and(close) {
                let problem = format!("{name} is {}, not {expected} as in the table", fields[column]);
                return Err(Failure::Parameters(problem));
            }
        }
        Ok(())
    }

    fn curves(&self, file: &str, bytes: &[u8]) -> Result<Vec<Vec<f64>>, Failure> {
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return Err(Failure::Empty);
        }
        let malformed = |error: anyhow::Error| Failure::Malformed(format!("{error:#}"));
        let mut rows = Rows::new(file, bytes).map_err(malformed)?;
        let format = rows.format().clone();
        let find = |name: &str| format.column(name).map_err(malformed);
        let mut columns = vec![find(&self.control)?];
        for name in &self.observables {
            columns.push(find(name)?);
        }
        // A number that was cut off is still a number: only the missing line end tells.
        if !bytes.ends_with(b"\n") {
            return Err(Failure::Truncated(
                "no line end after the last row, which may be cut off".to_owned(),
            ));
        }
        let mut values = vec![Vec::new(); columns.len()];
        let mut row = Vec::new();
        loop {
            if rows.next_numbers(&mut row).is_some() {
                for (values, &column) in values.iter_mut().zip(&columns) {
                    values.push(row[column]);
                }
                row.clear();
                continue;
            }
            match rows.next_row() {
                Ok(None) => break,
                Ok(Some((line, fields))) => {
                    for (values, &column) in values.iter_mut().zip(&columns) {
                        values.push(number(&format, line, column, fields[column])?);
                    }
                }
                Err(error) => return Err(malformed(error)),
            }
        }
        let control = values.remove(0);
        if control.is_empty() {
            return Err(Failure::Empty);
        }
        align(&self.observations.control, &control, &values, self.end_tolerance)
    }
}

fn number(format: &Format, line: usize, column: usize, field: &str) -> Result<f64, Failure> {
    parse_number(field).map_err(|problem| {
        let detail = format!("{}:{line}: column {}: {problem}", format.source(), format.columns()[column]);
        if field.parse::<f64>().is_ok() { Failure::NonFinite(detail) } else { Failure::Malformed(detail) }
    })
}
