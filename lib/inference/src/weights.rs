//! The weights table: samples with what a filter made of them.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use anyhow::{Result, bail, ensure};

use crate::ensemble::Ensemble;
use crate::samples::Samples;
use gl_table::{Table, TableWriter};

/// Weighted samples: their parameters, how well each fits, and the weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Where they were read from, for messages.
    pub source: String,
    /// Name of each sample, without repetition.
    pub samples: Vec<String>,
    /// Parameter names.
    pub parameters: Vec<String>,
    /// Parameter values, one row a sample.
    pub values: Vec<Vec<f64>>,
    /// Misfit summed over the steps, shape (samples,), where the table has it.
    pub misfit: Option<Vec<f64>>,
    /// Mean relative error, shape (samples,), where the table has it.
    pub error: Option<Vec<f64>>,
    /// Weights, shape (samples,), not negative; those that were read sum to one.
    pub weight: Vec<f64>,
}

impl Weights {
    /// Read a weights table: `sample weight`, `misfit` and `error` if they are there; all other
    /// columns of numbers are parameters. The weights are made to sum to one.
    ///
    /// # Errors
    /// If the table cannot be read, a sample is repeated, a weight is negative or all are zero.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        table.check_end()?;
        Self::from_table(&table)
    }

    /// The samples of a samples table, or those of a table of weights, such as the draws of `gl-posterior`.
    ///
    /// # Errors
    /// See [`Samples::read`] and [`Weights::read`].
    pub fn read_samples(path: &Path) -> Result<Samples> {
        let table = Table::read(path)?;
        if table.format().find("description")?.is_some() || table.format().find("weight")?.is_none() {
            return Samples::of_columns(&table, |column| !table.holds_words(column));
        }
        table.check_end()?;
        let Self { source, samples, parameters, values, .. } = Self::from_table(&table)?;
        Ok(Samples { source, names: samples, parameters, values })
    }

    /// Read the weights at several steps, from a table with a column `step`, as [`Weights::read`] does
    /// each; without that column there is one set of weights and no step.
    ///
    /// # Errors
    /// See [`Weights::read`].
    pub fn read_steps(path: &Path) -> Result<Vec<(Option<f64>, Self)>> {
        let table = Table::read(path)?;
        if table.format().find("step")?.is_none() || table.is_empty() {
            return Ok(vec![(None, Self::from_table(&table)?)]);
        }
        let step = table.numbers("step")?;
        let mut steps = step.clone();
        steps.sort_by(f64::total_cmp);
        steps.dedup();
        let rows_of = |at: f64| (0..table.len()).filter(|&row| step[row] == at).collect::<Vec<_>>();
        steps.iter().map(|&at| Ok((Some(at), Self::from_rows(&table, &rows_of(at))?))).collect()
    }

    /// The weights from a table that was read already; see [`Weights::read`].
    ///
    /// # Errors
    /// See [`Weights::read`].
    pub fn from_table(table: &Table) -> Result<Self> {
        Self::from_rows(table, &(0..table.len()).collect::<Vec<_>>())
    }

    fn from_rows(table: &Table, rows: &[usize]) -> Result<Self> {
        let format = table.format();
        let source = format.source().to_owned();
        let sample_column = format.column("sample")?;
        let numbers = |name: &str| {
            let column = format.column(name)?;
            rows.iter().map(|&row| table.number(row, column)).collect::<Result<Vec<f64>>>()
        };
        let mut weight = numbers("weight")?;
        if let Some(place) = weight.iter().position(|&weight| weight < 0.0) {
            return table.fail(
                rows[place],
                "weight",
                format_args!("{}, but a weight cannot be negative", weight[place]),
            );
        }
        let mut first_lines = HashMap::new();
        for &row in rows {
            let name = table.field(row, sample_column);
            if let Some(line) = first_lines.insert(name, table.line(row)) {
                return table.fail(row, "sample", format_args!("{name} is on line {line} already"));
            }
        }
        let highest = weight.iter().copied().fold(0.0, f64::max);
        ensure!(highest > 0.0, "{source}: no sample has a weight above zero; at least one must");
        // Scaled first, so that the sum cannot overflow.
        let sum: f64 = weight.iter().map(|weight| weight / highest).sum();
        weight.iter_mut().for_each(|weight| *weight = *weight / highest / sum);

        let parameters: Vec<String> = format
            .columns()
            .iter()
            .enumerate()
            .filter(|(_, name)| !matches!(name.as_str(), "sample" | "step" | "misfit" | "error" | "weight"))
            .filter(|(column, _)| !table.holds_words(*column))
            .map(|(_, name)| name.clone())
            .collect();
        let moderates = |name: &String| {
            let column = format.column(name)?;
            rows.iter().map(|&row| table.moderate(row, column)).collect::<Result<Vec<f64>>>()
        };
        let columns = parameters.iter().map(moderates).collect::<Result<Vec<_>>>()?;
        let optional = |name: &str| format.find(name)?.map(|_| numbers(name)).transpose();
        Ok(Self {
            samples: rows.iter().map(|&row| table.field(row, sample_column).to_owned()).collect(),
            values: (0..rows.len()).map(|row| columns.iter().map(|column| column[row]).collect()).collect(),
            misfit: optional("misfit")?,
            error: optional("error")?,
            parameters,
            source,
            weight,
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Position of each sample by its name.
    pub fn index(&self) -> HashMap<&str, usize> {
        self.samples.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect()
    }

    /// How many of the parameters vary from sample to sample.
    pub fn varying(&self) -> usize {
        let varies = |j: &usize| self.values.iter().any(|row| row[*j] != self.values[0][*j]);
        (0..self.parameters.len()).filter(varies).count()
    }

    /// The weight of every run of an ensemble, shape (runs,), found by the name of its sample.
    ///
    /// # Errors
    /// If a run has no weight here, or a sample with a weight above zero has no run.
    pub fn of_runs(&self, ensemble: &Ensemble) -> Result<Vec<f64>> {
        let known = self.index();
        let mut weights = Vec::with_capacity(ensemble.len());
        for sample in &ensemble.samples {
            let Some(&row) = known.get(sample.as_str()) else {
                bail!(
                    "{}: no sample {sample}, which {} has; weigh these very runs",
                    self.source,
                    ensemble.source
                );
            };
            weights.push(self.weight[row]);
        }
        let runs: HashSet<&str> = ensemble.samples.iter().map(String::as_str).collect();
        for (sample, &weight) in self.samples.iter().zip(&self.weight) {
            ensure!(
                weight == 0.0 || runs.contains(sample.as_str()),
                "{}: no sample {sample}, which has the weight {weight} in {}; give the runs that were weighed",
                ensemble.source,
                self.source
            );
        }
        Ok(weights)
    }

    /// Write the weights table: `sample <parameters…> misfit error weight`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        let optional: Vec<(&str, &[f64])> = [("misfit", &self.misfit), ("error", &self.error)]
            .into_iter()
            .filter_map(|(name, column)| Some((name, column.as_deref()?)))
            .collect();
        let mut columns = vec!["sample"];
        columns.extend(self.parameters.iter().map(String::as_str));
        columns.extend(optional.iter().map(|(name, _)| name));
        columns.push("weight");
        let mut table = TableWriter::create(path, &columns)?;
        for (row, sample) in self.samples.iter().enumerate() {
            table.text(sample).numbers(&self.values[row]);
            for (_, column) in &optional {
                table.number(column[row]);
            }
            table.number(self.weight[row]).end_row()?;
        }
        table.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Weights> {
        Weights::from_table(&Table::parse("weights.tsv", text.as_bytes().to_vec())?)
    }

    fn message(text: &str) -> String {
        format!("{:#}", parse(text).unwrap_err())
    }

    #[test]
    fn weights_are_made_to_sum_to_one() {
        let weights = parse("sample E misfit error weight\na 2 3 .1 1.5e308\nb 4 5 .2 0.5e308\n").unwrap();
        assert_eq!(weights.weight, [0.75, 0.25]);
        assert_eq!(weights.values, [[2.0], [4.0]]);
        assert_eq!(weights.misfit, Some(vec![3.0, 5.0]));
    }

    #[test]
    fn a_bare_table_of_weights_is_enough() {
        let weights = parse("sample weight\na 1\nb 0\n").unwrap();
        assert_eq!((weights.weight, weights.misfit, weights.parameters), (vec![1.0, 0.0], None, vec![]));
    }

    #[test]
    fn weights_at_several_steps_sum_to_one_each() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("steps.tsv");
        std::fs::write(&path, "sample step E weight\na 3 2 1\nb 3 4 3\na 9 2 1\nb 9 4 0\n").unwrap();
        let steps = Weights::read_steps(&path).unwrap();
        let of = |place: usize| (steps[place].0, steps[place].1.weight.clone());
        assert_eq!([of(0), of(1)], [(Some(3.0), vec![0.25, 0.75]), (Some(9.0), vec![1.0, 0.0])]);
        assert_eq!(steps[1].1.parameters, ["E"]);
        assert!(format!("{:#}", Weights::read(&path).unwrap_err()).contains("a is on line 2 already"));
    }

    #[test]
    fn what_is_written_reads_back_the_same() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("weights.tsv");
        let mut weights = parse("sample E nu misfit error weight\na 2 .1 3 .1 1\nb 4 .3 5 .2 3\n").unwrap();
        weights.write(Some(&path)).unwrap();
        weights.source = path.display().to_string();
        assert_eq!(Weights::read(&path).unwrap(), weights);
    }

    #[test]
    fn bad_weights_are_refused_with_their_place() {
        assert!(message("sample weight\na 1\nb -1\n").starts_with("weights.tsv:3: column weight: -1"));
        assert!(
            message("sample weight\na 1\na 1\n").contains("weights.tsv:3: column sample: a is on line 2")
        );
        assert!(message("sample weight\na 0\n").contains("above zero"));
        assert!(message("sample weight\n").contains("above zero"));
        assert!(message("sample weight\na NaN\n").contains("weights.tsv:2: column weight: NaN"));
        assert!(message("sample E\na 1\n").contains("no column weight"));
    }

    #[test]
    fn runs_and_weights_are_joined_by_name() {
        let rows = b"sample step e q\nb 0 0 1\na 0 0 2\n";
        let ensemble = Ensemble::parse("runs.tsv", rows, "e", &["q".to_owned()]).unwrap();
        let weights = parse("sample weight\na 1\nb 3\nfailed 0\n").unwrap();
        assert_eq!(weights.of_runs(&ensemble).unwrap(), [0.75, 0.25]);
        let lacking = parse("sample weight\na 1\n").unwrap();
        assert!(lacking.of_runs(&ensemble).unwrap_err().to_string().contains("weights.tsv: no sample b"));
        let surplus = parse("sample weight\na 1\nb 3\nc 1\n").unwrap();
        assert!(surplus.of_runs(&ensemble).unwrap_err().to_string().contains("runs.tsv: no sample c"));
    }
}
