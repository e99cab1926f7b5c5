use std::collections::{HashMap, HashSet};
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

/// What becomes of a sample that failed in one test and not in the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Partial {
    /// It is left out.
    LeftOut,
    /// It is taken to fit the test in which it failed as well as the others, reading for reading.
    AsOthers,
}

/// Samples that a test lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Incomplete {
    /// Table of the test.
    pub test: String,
    /// Names of the samples.
    pub samples: Vec<String>,
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

    /// Read misfit tables of one test or several. Tables without a common sample are iterations of one test, as
    /// for [`Misfits::read`]; a table that has samples of one before it is another test of the same samples.
    /// Misfits, readings and ignorance of the tests are added; their steps stand behind each other.
    ///
    /// Samples that some test lacks are left out, or counted by their other tests where `partial` says so.
    ///
    /// # Errors
    /// See [`Misfits::read`]; also if the noise is known in one test and not in another.
    pub fn read_tests(paths: &[PathBuf], by_step: bool, partial: Partial) -> Result<(Self, Vec<Incomplete>)> {
        let [path] = paths else {
            let tests = Self::by_test(paths, by_step)?;
            return Self::sum(tests, partial);
        };
        Ok((Self::read(std::slice::from_ref(path), by_step)?, Vec::new()))
    }

    /// The tables of each test, put behind each other.
    fn by_test(paths: &[PathBuf], by_step: bool) -> Result<Vec<(Self, HashSet<String>)>> {
        let mut tests: Vec<(Self, HashSet<String>)> = Vec::new();
        for path in paths {
            let mut own = HashSet::new();
            let mut table = Self { by_step: by_step.then(Vec::new), ..Self::default() };
            table.read_one(path, &mut own)?;
            let Some((test, seen)) = tests.iter_mut().find(|(_, seen)| seen.is_disjoint(&own)) else {
                tests.push((table, own));
                continue;
            };
            if test.is_empty() {
                test.steps.clone_from(&table.steps);
            }
            ensure!(
                table.is_empty() || table.steps == test.steps,
                "{}: {} steps and not the {} of {}; tables of one test have the same steps, and those of another \
                 test the same samples",
                table.source,
                table.steps.len(),
                test.steps.len(),
                test.source
            );
            seen.extend(own);
            test.append(table);
        }
        Ok(tests)
    }

    /// Put the runs of another table of the same test behind.
    fn append(&mut self, other: Self) {
        self.samples.extend(other.samples);
        self.total.extend(other.total);
        self.mean_error.extend(other.mean_error);
        self.readings.extend(other.readings);
        self.expected.extend(other.expected);
        self.ignorance.extend(other.ignorance);
        if let (Some(all), Some(more)) = (&mut self.by_step, other.by_step) {
            all.extend(more);
        }
    }

    /// Add the misfits of tests, sample by sample.
    fn sum(mut tests: Vec<(Self, HashSet<String>)>, partial: Partial) -> Result<(Self, Vec<Incomplete>)> {
        if tests.len() < 2 {
            return Ok((tests.pop().map(|(test, _)| test).unwrap_or_default(), Vec::new()));
        }
        let is_known = |test: &Self| test.readings.iter().all(|readings| *readings == 0.0);
        if let Some((other, _)) = tests.iter().find(|(test, _)| is_known(test) != is_known(&tests[0].0)) {
            let (known, not) = if is_known(other) { (other, &tests[0].0) } else { (&tests[0].0, other) };
            bail!(
                "{}: the noise is known, but not in {}; misfits of tests can be added where gl-likelihood was \
                 given the noise of all of them, or of none",
                known.source,
                not.source
            );
        }
        let places: Vec<HashMap<&str, usize>> = tests
            .iter()
            .map(|(test, _)| test.samples.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect())
            .collect();
        let mut names: Vec<&String> = Vec::new();
        let mut seen = HashSet::new();
        for (test, _) in &tests {
            names.extend(test.samples.iter().filter(|name| seen.insert(name.as_str())));
        }
        let mut incomplete: Vec<Incomplete> = tests
            .iter()
            .map(|(test, _)| Incomplete { test: test.source.clone(), samples: Vec::new() })
            .collect();
        let sizes: Vec<f64> = tests.iter().map(|(test, _)| test.size()).collect();
        let whole: f64 = sizes.iter().sum();
        let by_step = tests.iter().all(|(test, _)| test.by_step.is_some());
        let mut all = Self {
            source: tests.iter().map(|(test, _)| test.source.as_str()).collect::<Vec<_>>().join(" and "),
            steps: (0..tests.iter().map(|(test, _)| test.steps.len()).sum()).collect(),
            by_step: by_step.then(Vec::new),
            ..Self::default()
        };
        for name in names {
            let found: Vec<Option<usize>> =
                places.iter().map(|places| places.get(name.as_str()).copied()).collect();
            let lacks = found.iter().zip(&mut incomplete).filter(|(found, _)| found.is_none());
            let is_partial = lacks.map(|(_, of)| of.samples.push(name.clone())).count() > 0;
            if is_partial && partial == Partial::LeftOut {
                continue;
            }
            let has = || tests.iter().zip(&found).filter_map(|((test, _), at)| Some((test, (*at)?)));
            let seen: f64 = found.iter().zip(&sizes).filter(|(at, _)| at.is_some()).map(|(_, n)| n).sum();
            let factor = whole / seen;
            let sum = |of: fn(&Self) -> &[f64]| has().map(|(test, i)| of(test)[i]).sum::<f64>();
            let count = has().count() as f64;
            all.samples.push(name.clone());
            all.total.push(factor * sum(|test| &test.total));
            all.readings.push(factor * sum(|test| &test.readings));
            all.expected.push(factor * sum(|test| &test.expected));
            all.ignorance.push(factor * sum(|test| &test.ignorance));
            all.mean_error.push(sum(|test| &test.mean_error) / count);
            if let Some(by_step) = &mut all.by_step {
                let share = factor * sum(|test| &test.total) / whole;
                for (((test, _), at), size) in tests.iter().zip(&found).zip(&sizes) {
                    let steps = test.steps.len();
                    match (at, &test.by_step) {
                        (Some(i), Some(own)) => by_step.extend(&own[i * steps..(i + 1) * steps]),
                        _ => by_step.extend(std::iter::repeat_n(share * size / steps as f64, steps)),
                    }
                }
            }
        }
        incomplete.retain(|of| !of.samples.is_empty());
        Ok((all, incomplete))
    }

    /// How many readings a run of this test has: the misfit that its noise alone makes, else those that tell the noise, else
    /// its steps.
    fn size(&self) -> f64 {
        let mean = |of: &[f64]| of.iter().sum::<f64>() / self.len().max(1) as f64;
        let sizes = [mean(&self.expected), mean(&self.readings), self.steps.len() as f64];
        sizes.into_iter().find(|size| *size > 0.0).unwrap_or(0.0)
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
