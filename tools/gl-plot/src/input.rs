//! The tables that pictures are made of, as far as the library does not read them.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Result, ensure};
use gl::observations::ByName;
use gl::prior::{Parameter, Prior, Scale};
use gl::table::Table;

use crate::axis::{Label, Span};

/// A weights table: `sample <parameters…> misfit error weight`.
#[derive(Clone, Debug)]
pub struct Weights {
    pub source: String,
    pub samples: Vec<String>,
    pub parameters: Vec<String>,
    /// Values of each parameter, shape (parameters, samples).
    pub values: Vec<Vec<f64>>,
    pub misfit: Vec<f64>,
    /// Weights that sum to one.
    pub weight: Vec<f64>,
}

impl Weights {
    /// Read it.
    ///
    /// # Errors
    /// If a column is missing, there are no rows, or the weights are not weights.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        let source = table.format().source().to_owned();
        let sample = table.format().column("sample")?;
        ensure!(!table.is_empty(), "{source}: no rows; there is nothing to draw");
        let parameters: Vec<String> = table
            .format()
            .columns()
            .iter()
            .filter(|name| !matches!(name.as_str(), "sample" | "misfit" | "error" | "weight" | "readings"))
            .cloned()
            .collect();
        let mut weight = table.numbers("weight")?;
        if let Some(row) = weight.iter().position(|weight| *weight < 0.0) {
            return table.fail(row, "weight", "a weight cannot be negative");
        }
        let sum: f64 = weight.iter().sum();
        ensure!(sum > 0.0, "{source}: column weight: every weight is zero");
        weight.iter_mut().for_each(|weight| *weight /= sum);
        Ok(Self {
            samples: (0..table.len()).map(|row| table.field(row, sample).to_owned()).collect(),
            values: parameters.iter().map(|name| table.numbers(name)).collect::<Result<_>>()?,
            misfit: table.numbers("misfit")?,
            weight,
            parameters,
            source,
        })
    }

    /// Position of each sample by its name.
    pub fn index(&self) -> HashMap<&str, usize> {
        self.samples.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect()
    }

    /// The samples from the lightest to the heaviest, so that those that count are drawn last.
    pub fn lightest_first(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.samples.len()).collect();
        order.sort_by(|&a, &b| self.weight[a].total_cmp(&self.weight[b]));
        order
    }
}

/// What is known about the parameters from `params.txt`: scales, bounds and units.
#[derive(Clone, Debug, Default)]
pub struct Parameters(Vec<Parameter>);

impl Parameters {
    /// Read the table, or know nothing where there is none.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: Option<&Path>) -> Result<Self> {
        Ok(Self(path.map(Prior::read).transpose()?.map_or(Vec::new(), |prior| prior.parameters().to_vec())))
    }

    pub fn get(&self, name: &str) -> Option<&Parameter> {
        self.0.iter().find(|parameter| parameter.name == name)
    }

    pub fn label(&self, name: &str) -> Label {
        Label { name: name.to_owned(), unit: self.get(name).and_then(|parameter| parameter.unit.clone()) }
    }

    /// What an axis of this parameter has to show: its values, and its bounds where they are known.
    pub fn span(&self, name: &str, values: &[f64]) -> Span {
        let span = Span::of(values.iter().copied());
        match self.get(name) {
            Some(parameter) => {
                let span = span.with(parameter.lower).with(parameter.upper);
                if parameter.scale == Scale::Log { span.logarithmic() } else { span }
            }
            None => span,
        }
        .padded(0.04)
    }
}

/// The truth where a picture can show it; every name must be a parameter.
///
/// # Errors
/// If one is not.
pub fn check_truth(truth: &ByName, parameters: &[String]) -> Result<()> {
    for (name, _) in &truth.0 {
        ensure!(
            parameters.contains(name),
            "--truth {name}: no such parameter; they are {}",
            parameters.join(", ")
        );
    }
    Ok(())
}
