use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};

use crate::table::{Flaw, Format, RunTable, open, parse_number, piece_rows, source_name};

/// The misfits and errors of all runs, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Misfits {
    /// Where they were read from, for messages.
    pub source: String,
    /// Name of the sample of each run.
    pub samples: Vec<String>,
    /// The steps, the same for each run.
    pub steps: Vec<usize>,
    /// rᵀC⁻¹r at each step, run by run, shape (runs · steps,).
    misfit: Vec<f64>,
    /// Error at each step, run by run, shape (runs · steps,).
    error: Vec<f64>,
    /// Independent readings of each run to estimate the noise from; 0 where the noise is known.
    pub readings: Vec<f64>,
    /// Misfit of each run that the noise alone would make, shape (runs,); 0 where it is not known.
    pub expected: Vec<f64>,
}

/// What one piece of the table holds.
#[derive(Default)]
struct Piece {
    samples: Vec<String>,
    /// Rows of each run, one after the other.
    lengths: Vec<usize>,
    steps: Vec<usize>,
    misfit: Vec<f64>,
    error: Vec<f64>,
    readings: Vec<f64>,
    expected: Vec<f64>,
}

impl Misfits {
    /// Read misfit tables, `sample step misfit error` and optionally `readings` and `expected`, as
    /// one.
    ///
    /// Without a column `readings` each step counts as one reading.
    ///
    /// # Errors
    /// If a table cannot be read, holds a sample twice, or a run has other steps than the first.
    pub fn read(paths: &[PathBuf]) -> Result<Self> {
        let mut all = Self::default();
        let mut seen = HashSet::new();
        for path in paths {
            all.read_one(path, &mut seen)?;
        }
        Ok(all)
    }

    fn read_one(&mut self, path: &Path, seen: &mut HashSet<String>) -> Result<()> {
        let source = source_name(path);
        self.source = source.clone();
        let mut input = open(path)?;
        let table = RunTable::new(&source, &mut input, "sample")?;
        let format = table.format();
        let columns = [
            format.column("sample")?,
            format.column("step")?,
            format.column("misfit")?,
            format.column("error")?,
        ];
        let optional = [format.find("readings")?, format.find("expected")?];
        table.for_each(
            |piece, format| read_piece(piece, format, columns, optional),
            |piece| {
                let mut from = 0;
                for (i, (sample, length)) in piece.samples.into_iter().zip(piece.lengths).enumerate() {
                    let steps = &piece.steps[from..from + length];
                    if self.samples.is_empty() {
                        self.steps = steps.to_vec();
                    }
                    ensure!(
                        steps == self.steps,
                        "{source}: sample {sample} has {length} steps and not the {} of {}; is the table cut off?",
                        self.steps.len(),
                        self.samples.first().map_or("others", String::as_str)
                    );
                    if !seen.insert(sample.clone()) {
                        bail!("{source}: sample {sample} is there twice");
                    }
                    self.samples.push(sample);
                    self.readings.push(piece.readings[i]);
                    self.expected.push(piece.expected[i]);
                    from += length;
                }
                self.misfit.extend(piece.misfit);
                self.error.extend(piece.error);
                Ok(())
            },
        )
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are no runs.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Misfit of each run summed over the steps up to and with the one at place `last`, shape (runs,).
    pub fn total_up_to(&self, last: usize) -> Vec<f64> {
        self.misfit.chunks_exact(self.steps.len().max(1)).map(|run| run[..=last].iter().sum()).collect()
    }

    /// Misfit of each run summed over all steps, shape (runs,).
    pub fn total(&self) -> Vec<f64> {
        self.total_up_to(self.steps.len().saturating_sub(1))
    }

    /// Mean error of each run over all steps, shape (runs,).
    pub fn mean_error(&self) -> Vec<f64> {
        let steps = self.steps.len().max(1);
        self.error.chunks_exact(steps).map(|run| run.iter().sum::<f64>() / steps as f64).collect()
    }
}

fn read_piece(
    piece: &str,
    format: &Format,
    columns: [usize; 4],
    [readings, expected]: [Option<usize>; 2],
) -> Result<Piece, Flaw> {
    let [sample, step, misfit, error] = columns;
    let mut rows = Piece::default();
    let mut fields = Vec::new();
    for (line, row) in piece_rows(piece) {
        let flaw = |problem: String| Flaw { line, problem };
        format.split_fields(row, &mut fields).map_err(flaw)?;
        let value = |column: usize| {
            parse_number(fields[column])
                .map_err(|problem| flaw(format!("column {}: {problem}", format.columns()[column])))
        };
        let place =
            fields[step].parse().map_err(|_| flaw(format!("column step: {:?} is no step", fields[step])))?;
        rows.steps.push(place);
        rows.misfit.push(value(misfit)?);
        rows.error.push(value(error)?);
        let share = readings.map_or(Ok(1.0), value)?;
        let noise = expected.map_or(Ok(0.0), value)?;
        if rows.samples.last().is_none_or(|last| last != fields[sample]) {
            rows.samples.push(fields[sample].to_owned());
            rows.lengths.push(0);
            rows.readings.push(0.0);
            rows.expected.push(0.0);
        }
        let last = rows.lengths.len() - 1;
        rows.lengths[last] += 1;
        rows.readings[last] += share;
        rows.expected[last] += noise;
    }
    Ok(rows)
}
