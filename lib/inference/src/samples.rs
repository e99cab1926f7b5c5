//! The samples table, which is also Yade's batch table: one row a run.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use gl_table::{Table, TableWriter};

use crate::ensemble::Ensemble;

/// Parameter samples: a name for each, which its run carries as `description`, and their values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Where they were read from, for messages.
    pub source: String,
    /// Name of each sample, without repetition.
    pub names: Vec<String>,
    /// Parameter names.
    pub parameters: Vec<String>,
    /// Parameter values, one row a sample.
    pub values: Vec<Vec<f64>>,
}

impl Samples {
    /// Read a samples table: `description`, `key` if it is there, and the parameters. Columns that
    /// begin with `!` are environment variables for Yade and no parameters, and a column that holds nothing but
    /// words is left aside.
    ///
    /// # Errors
    /// If the table cannot be read, a description is repeated or could do harm as a file name or in
    /// a shell, or a parameter is no number.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        Self::of_columns(&table, |column| !table.holds_words(column))
    }

    /// The samples of runs to be, from a table: as [`Samples::read`] has it, but a column of words is no parameter
    /// that a run could have, and refused.
    ///
    /// # Errors
    /// See [`Samples::read`].
    pub fn from_table(table: &Table) -> Result<Self> {
        Self::of_columns(table, |_| true)
    }

    pub(crate) fn of_columns(table: &Table, is_wanted: impl Fn(usize) -> bool) -> Result<Self> {
        let description = table.format().column("description")?;
        let columns: Vec<usize> = (0..table.format().columns().len())
            .filter(|&j| {
                let name = table.format().columns()[j].as_str();
                !matches!(name, "description" | "key") && !name.starts_with('!') && is_wanted(j)
            })
            .collect();
        let parameters: Vec<String> = columns.iter().map(|&j| table.format().columns()[j].clone()).collect();
        for name in &parameters {
            table.format().column(name)?;
            if let Err(problem) = check_parameter_name(name) {
                bail!("{}:1: column {name}: {problem}", table.format().source());
            }
        }
        let mut seen = HashMap::new();
        let mut names = Vec::with_capacity(table.len());
        let mut values = Vec::with_capacity(table.len());
        for row in 0..table.len() {
            let name = table.field(row, description);
            if let Err(problem) = check_description(name) {
                return table.fail(row, "description", problem);
            }
            if let Some(first) = seen.insert(name, table.line(row)) {
                return table.fail(row, "description", format_args!("{name} is on line {first} already"));
            }
            names.push(name.to_owned());
            values.push(columns.iter().map(|&j| table.moderate(row, j)).collect::<Result<_>>()?);
        }
        Ok(Self { source: table.format().source().to_owned(), names, parameters, values })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Position of each sample by its name.
    pub fn index(&self) -> HashMap<&str, usize> {
        self.names.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect()
    }

    /// Where the samples of these names stand, which come from `source`.
    ///
    /// # Errors
    /// If one of them is no sample.
    pub fn places(&self, names: &[String], source: &str) -> Result<Vec<usize>> {
        let index = self.index();
        let place = |name: &String| {
            let missing = || format!("{source}: sample {name} is not in {}", self.source);
            index.get(name.as_str()).copied().with_context(missing)
        };
        names.iter().map(place).collect()
    }

    /// The values of an ensemble's runs, shape (runs, parameters), in the order of `parameters`, which are found by name.
    ///
    /// # Errors
    /// If one of them is no column here, or a run is no sample.
    pub fn of_runs(&self, parameters: &[String], ensemble: &Ensemble) -> Result<Vec<Vec<f64>>> {
        let values = self.columns(parameters)?;
        let places = self.places(&ensemble.samples, &ensemble.source)?;
        Ok(places.into_iter().map(|place| values[place].clone()).collect())
    }

    /// The values in the order of `parameters`, which are found by name.
    ///
    /// # Errors
    /// If one of them is no column here.
    pub fn columns(&self, parameters: &[String]) -> Result<Vec<Vec<f64>>> {
        let known: HashMap<&String, usize> =
            self.parameters.iter().enumerate().map(|(j, name)| (name, j)).collect();
        let mut places = Vec::new();
        for name in parameters {
            let Some(&place) = known.get(name) else {
                bail!(
                    "{}:1: no column {name}; the parameters are {}",
                    self.source,
                    self.parameters.join(", ")
                );
            };
            places.push(place);
        }
        Ok(self.values.iter().map(|row| places.iter().map(|&j| row[j]).collect()).collect())
    }

    /// Put the samples of several tables behind each other.
    ///
    /// # Errors
    /// If they have other parameters than the first, or share a name.
    pub fn concatenate(tables: Vec<Self>) -> Result<Self> {
        let mut tables = tables.into_iter();
        let mut all = tables.next().unwrap_or_default();
        for table in tables {
            all.values.extend(table.columns(&all.parameters)?);
            ensure!(
                table.parameters.len() == all.parameters.len(),
                "{}:1: the parameters are {}, but those of {} are {}",
                table.source,
                table.parameters.join(", "),
                all.source,
                all.parameters.join(", ")
            );
            let known = all.index();
            if let Some(name) = table.names.iter().find(|name| known.contains_key(name.as_str())) {
                bail!("{}: {name} is in {} already", table.source, all.source);
            }
            all.names.extend(table.names);
        }
        Ok(all)
    }

    /// Write a samples table, `!OMP_NUM_THREADS` first when `threads` are given.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>, threads: Option<usize>) -> Result<()> {
        let mut columns: Vec<&str> = Vec::new();
        if threads.is_some() {
            columns.push("!OMP_NUM_THREADS");
        }
        columns.extend(["description", "key"]);
        columns.extend(self.parameters.iter().map(String::as_str));
        let mut table = TableWriter::create(path, &columns)?;
        for (i, (name, values)) in self.names.iter().zip(&self.values).enumerate() {
            if let Some(threads) = threads {
                table.text(&threads.to_string());
            }
            table.text(name).text(&i.to_string()).numbers(values).end_row()?;
        }
        table.finish()
    }
}

/// Names `<name>_Iter<i>_Sample<j>`, zero-padded to the same length.
///
/// # Errors
/// If `name` could do harm as a file name or in a shell.
pub fn sample_names(name: &str, iteration: usize, count: usize) -> Result<Vec<String>> {
    if let Err(problem) = check_description(name) {
        bail!("--name {problem}");
    }
    let width = count.saturating_sub(1).to_string().len();
    let names: Vec<_> = (0..count).map(|j| format!("{name}_Iter{iteration}_Sample{j:0width$}")).collect();
    // All are as long as each other.
    match names.first().map(|name| check_description(name)) {
        Some(Err(problem)) => bail!("--name {problem}"),
        _ => Ok(names),
    }
}

/// What a description has at the most, so that the names of a run's files are no longer than a file
/// system takes.
const LONGEST_DESCRIPTION: usize = 200;

/// Refuse a description that could leave its folder, or mean something to a shell or to Yade.
///
/// # Errors
/// With what is wrong, if it holds anything but at most 200 letters, digits and `_ - . , = + @ :`, begins
/// with `-` or `.`, holds `..`, or is a lone `=`, which tells Yade to repeat the row before.
pub fn check_description(name: &str) -> Result<(), String> {
    let harmless = |c: char| c.is_ascii_alphanumeric() || "_-.,=+@:".contains(c);
    let is_refused = name.is_empty()
        || name.len() > LONGEST_DESCRIPTION
        || name == "="
        || !name.chars().all(harmless)
        || name.starts_with(['-', '.'])
        || name.contains("..");
    if is_refused {
        return Err(format!(
            "{name:?} cannot name a run's files; use at most {LONGEST_DESCRIPTION} letters, digits and \
             _ - . , = + @ : (no leading - or ., no ..)"
        ));
    }
    Ok(())
}

/// Names that tables use for themselves, and `dir` and `case`, which stand for folders in a model.
const RESERVED: [&str; 14] = [
    "description",
    "key",
    "sample",
    "step",
    "misfit",
    "error",
    "weight",
    "readings",
    "quantity",
    "value",
    "sigma",
    "ess",
    "dir",
    "case",
];

/// Refuse a name that cannot be a parameter's: in `params.txt`, in a samples table, or in a model, where
/// `{NAME}` stands for its value.
///
/// # Errors
/// With what is wrong, if a table uses the name for itself, or if it is not a letter or `_` and then
/// letters, digits, `_`, `-` and `.`.
pub fn check_parameter_name(name: &str) -> Result<(), String> {
    if RESERVED.contains(&name) || name.starts_with('!') {
        return Err(format!("{name} is a name that tables and models use for themselves; choose another"));
    }
    if !is_word(name) {
        return Err(format!(
            "{name:?} cannot be a column name; use letters, digits, `_`, `-` and `.`, with a letter or `_` first"
        ));
    }
    Ok(())
}

/// Whether a text has the form of a parameter's name.
pub fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_do_harm_name_no_run_and_no_parameter() {
        for name in ["", "=", "-a", ".a", "a..b", "a/b", "a b", "é", &"a".repeat(201)] {
            assert!(check_description(name).is_err(), "{name}");
        }
        assert_eq!(check_description(&format!("a=b,c+1@d:e.{}", "f".repeat(188))), Ok(()));
        for name in ["", "-x", ".x", "1", "a b", "a;b", "!EXEC", "dir", "case", "key", "step"] {
            assert!(check_parameter_name(name).is_err(), "{name}");
        }
        for name in ["a", "_", "E_m", "k-n", "mu.0", "ν"] {
            assert_eq!(check_parameter_name(name), Ok(()), "{name}");
        }
    }

    #[test]
    fn names_that_would_be_too_long_are_refused_before_they_are_drawn() {
        assert!(sample_names(&"a".repeat(186), 0, 10).is_ok());
        assert!(sample_names(&"a".repeat(187), 0, 10).is_err());
    }
}
