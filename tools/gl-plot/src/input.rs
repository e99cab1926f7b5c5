//! The tables that pictures are made of, as far as the library does not read them.

use std::path::Path;

use anyhow::{Result, ensure};
use gl::observations::ByName;
use gl::prior::{Parameter, Prior, Scale};
use gl::weights::Weights;

use crate::axis::{Label, Span};

/// Read a weights table that a picture can be made of: samples with their parameters.
///
/// # Errors
/// If it cannot be read, or has no parameters.
pub fn read_weights(path: &Path) -> Result<Weights> {
    let weights = Weights::read(path)?;
    ensure!(
        !weights.parameters.is_empty(),
        "{}:1: no parameters; a column for each is needed beside sample and weight",
        weights.source
    );
    Ok(weights)
}

/// The values of a parameter, shape (samples,).
pub fn column(weights: &Weights, parameter: usize) -> Vec<f64> {
    weights.values.iter().map(|row| row[parameter]).collect()
}

/// The samples from the lightest to the heaviest, so that those that count are drawn last.
pub fn lightest_first(weight: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..weight.len()).collect();
    order.sort_by(|&a, &b| weight[a].total_cmp(&weight[b]));
    order
}

/// The name of a table without its folder and ending.
pub fn stem(path: &Path) -> String {
    if path == Path::new("-") {
        return "stdin".to_owned();
    }
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
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

    /// Whether a table of parameters was given.
    pub fn known(&self) -> bool {
        !self.0.is_empty()
    }

    pub fn label(&self, name: &str) -> Label {
        Label { name: name.to_owned(), unit: self.get(name).and_then(|parameter| parameter.unit.clone()) }
    }

    /// Where samples of this parameter can be: between its bounds, or anywhere on the axis where
    /// there are none or some values lie beyond them.
    pub fn support(&self, name: &str, span: Span, values: &[f64]) -> Span {
        match self.get(name) {
            Some(known) if values.iter().all(|value| (known.lower..=known.upper).contains(value)) => {
                Span { low: known.lower, high: known.upper, ..span }
            }
            _ => span,
        }
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
