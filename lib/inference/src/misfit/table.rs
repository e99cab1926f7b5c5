use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use gl_table::{Cursor, Flaw, Format, PieceRows, RunTable, open, parse_number, source_name};

/// The misfits and errors of all runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Misfits {
    /// Where they were read from, for messages.
    pub source: String,
    /// Name of the sample of each run.
    pub samples: Vec<String>,
    /// The steps, the same for each run.
    pub steps: Vec<usize>,
    /// Misfit of each run summed over the steps, shape (runs,).
    pub total: Vec<f64>,
    /// Mean error of each run over the steps, shape (runs,).
    pub mean_error: Vec<f64>,
    /// rᵀC⁻¹r at each step, run by run, shape (runs · steps,), where it was to be kept.
    by_step: Option<Vec<f64>>,
    /// Independent readings of each run to estimate the noise from; 0 where the noise is known.
    pub readings: Vec<f64>,
    /// Misfit of each run that the noise alone would make, shape (runs,); 0 where it is not known.
    pub expected: Vec<f64>,
    /// An emulator's share of the variance of each run's readings, summed over them, shape (runs,); 0
    /// for runs of the simulator.
    pub ignorance: Vec<f64>,
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
    ignorance: Vec<f64>,
}

/// What every row of a run ends with: its text, and its shares of the readings, the expected misfit and
/// the ignorance.
#[derive(Clone, Copy, Default)]
struct Tail<'a> {
    text: &'a str,
    readings: f64,
    expected: f64,
    ignorance: f64,
}

impl Misfits {
    /// Read misfit tables, `sample step misfit error` and optionally `readings`, `expected`
    /// and `ignorance`, as one.
    ///
    /// Without a column `readings` each step counts as one reading. The misfits of the single steps are
    /// kept only for [`Misfits::total_up_to`], where `by_step` asks for it.
    ///
    /// # Errors
    /// If a table cannot be read, holds a sample twice, or a run has other steps than the first.
    pub fn read(paths: &[PathBuf], by_step: bool) -> Result<Self> {
        let mut all = Self { by_step: by_step.then(Vec::new), ..Self::default() };
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
        let optional = [format.find("readings")?, format.find("expected")?, format.find("ignorance")?];
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
                        bail!("{source}: duplicate sample {sample}");
                    }
                    self.samples.push(sample);
                    self.readings.push(piece.readings[i]);
                    self.expected.push(piece.expected[i]);
                    self.ignorance.push(piece.ignorance[i]);
                    self.total.push(piece.misfit[from..from + length].iter().sum());
                    let error: f64 = piece.error[from..from + length].iter().sum();
                    self.mean_error.push(error / length as f64);
                    from += length;
                }
                if let Some(by_step) = &mut self.by_step {
                    by_step.extend(piece.misfit);
                }
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
    ///
    /// # Errors
    /// If the misfits of the single steps were not kept.
    pub fn total_up_to(&self, last: usize) -> Result<Vec<f64>> {
        let by_step = self.by_step.as_ref().context("the misfits of the single steps were not kept")?;
        Ok(by_step.chunks_exact(self.steps.len().max(1)).map(|run| run[..=last].iter().sum()).collect())
    }
}

fn read_piece(
    piece: &str,
    format: &Format,
    columns: [usize; 4],
    [readings, expected, ignorance]: [Option<usize>; 3],
) -> Result<Piece, Flaw> {
    let [sample, step, misfit, error] = columns;
    let is_plain = format.is_tabbed() && format.columns().len() == 6;
    let is_plain = is_plain && columns == [0, 1, 2, 3] && (readings, expected) == (Some(4), Some(5));
    let mut runs = Piece::default();
    let mut fields = Vec::new();
    let (mut name, mut tail) = ("", Tail::default());
    let mut rows = PieceRows::new(piece);
    loop {
        if is_plain && !runs.samples.is_empty() && rows.plain(|row| runs.plain_row(row, name, tail)).is_some()
        {
            continue;
        }
        let Some((line, row)) = rows.next() else { return Ok(runs) };
        let flaw = |problem: String| Flaw { line, problem };
        format.split_fields(row, &mut fields).map_err(flaw)?;
        let value = |column: usize| {
            parse_number(fields[column])
                .map_err(|problem| flaw(format!("column {}: {problem}", format.columns()[column])))
        };
        let place =
            fields[step].parse().map_err(|_| flaw(format!("column step: {:?} is no step", fields[step])))?;
        if runs.samples.is_empty() || name != fields[sample] {
            name = fields[sample];
            runs.begin(name);
        }
        let (misfit, error) = (value(misfit)?, value(error)?);
        tail.readings = readings.map_or(Ok(1.0), value)?;
        tail.expected = expected.map_or(Ok(0.0), value)?;
        tail.ignorance = ignorance.map_or(Ok(0.0), value)?;
        if is_plain {
            tail.text = row.splitn(5, '\t').nth(4).unwrap_or("");
        }
        runs.push(place, misfit, error, tail);
    }
}

impl Piece {
    fn begin(&mut self, sample: &str) {
        self.samples.push(sample.to_owned());
        self.lengths.push(0);
        self.readings.push(0.0);
        self.expected.push(0.0);
        self.ignorance.push(0.0);
    }

    /// Add a step to the last run.
    fn push(&mut self, step: usize, misfit: f64, error: f64, tail: Tail<'_>) {
        self.steps.push(step);
        self.misfit.push(misfit);
        self.error.push(error);
        let last = self.lengths.len() - 1;
        self.lengths[last] += 1;
        self.readings[last] += tail.readings;
        self.expected[last] += tail.expected;
        self.ignorance[last] += tail.ignorance;
    }

    /// Add a row that is written as the one before it: the same sample and the same tail.
    fn plain_row(&mut self, row: &mut Cursor<'_>, sample: &str, tail: Tail<'_>) -> Option<()> {
        row.skip(sample.as_bytes())?;
        row.skip(b"\t")?;
        let (step, misfit, error) = (row.count(b'\t')?, row.number(b'\t')?, row.number(b'\t')?);
        row.skip(tail.text.as_bytes())?;
        row.skip(b"\n")?;
        self.push(step, misfit, error, tail);
        Some(())
    }
}
