//! What an emulator has to say, as tables.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use rayon::prelude::*;

use super::{Check, Emulator, Prediction, Reach};
use gl_inference::ensemble::Ensemble;
use gl_inference::samples::Samples;
use gl_table::TableWriter;

/// Samples that are predicted together, so that memory does not grow with their number.
const BATCH: usize = 256;

/// Write the ensemble that an emulator, trained on `ensemble`, predicts at samples. Its `_sd` columns
/// hold √(emulator's ignorance + left over by the components + `scatter` · simulation's scatter),
/// where `scatter` is the share of the scatter's variance that the measurement has too. Returns the
/// number of samples outside the range of the runs.
///
/// # Errors
/// If a parameter is no column of the samples, `scatter` is negative, a sample asks for a parameter
/// that was the same in every run at another value, or the table cannot be written.
pub fn write_predictions(
    emulator: &Emulator,
    ensemble: &Ensemble,
    at: &Samples,
    scatter: f64,
    path: Option<&Path>,
) -> Result<usize> {
    let parameters = emulator.prior.names();
    let values = at.columns(&parameters)?;
    let coordinates: Vec<_> = values.iter().map(|values| emulator.coordinates(values)).collect();
    let mut outside = 0;
    for ((name, values), point) in at.names.iter().zip(&values).zip(&coordinates) {
        match emulator.reach(point) {
            Reach::Inside => {}
            Reach::Outside(_) => outside += 1,
            Reach::Unknown(j) => bail!(
                "{}: sample {name} has {} {}, but in {} nothing is seen to change with it; add runs in which it varies, or keep it at theirs",
                at.source,
                parameters[j],
                values[j],
                ensemble.source
            ),
        }
    }

    let mut rows = PredictionWriter::new(emulator, ensemble, scatter, path)?;
    for (names, points) in at.names.chunks(BATCH).zip(coordinates.chunks(BATCH)) {
        let predictions: Vec<_> = points.par_iter().map(|point| emulator.predict(point)).collect();
        rows.write(names, &predictions)?;
    }
    rows.table.finish()?;
    Ok(outside)
}

/// Write the ensemble of the runs that an emulator was trained on, each predicted from all the others,
/// with `_sd` columns as [`write_predictions`] has them.
///
/// # Errors
/// If `scatter` is negative, or the table cannot be written.
pub fn write_left_out(
    emulator: &Emulator,
    ensemble: &Ensemble,
    scatter: f64,
    path: Option<&Path>,
) -> Result<()> {
    let mut rows = PredictionWriter::new(emulator, ensemble, scatter, path)?;
    rows.write(emulator.runs(), &emulator.leave_one_out())?;
    rows.table.finish()
}

/// Writes predictions as an ensemble.
struct PredictionWriter<'a> {
    control: &'a [f64],
    observables: usize,
    scatter: f64,
    table: TableWriter,
}

impl<'a> PredictionWriter<'a> {
    fn new(emulator: &Emulator, ensemble: &'a Ensemble, scatter: f64, path: Option<&Path>) -> Result<Self> {
        ensure!(scatter >= 0.0 && scatter.is_finite(), "--scatter {scatter}: give a share of 0 or more");
        let mut columns = vec!["sample".to_owned(), "step".to_owned(), ensemble.control_name.clone()];
        columns.extend(emulator.observables().iter().cloned());
        columns.extend(emulator.observables().iter().map(|name| format!("{name}_sd")));
        let table = TableWriter::create(path, &columns)?;
        Ok(Self { control: &ensemble.control, observables: emulator.observables().len(), scatter, table })
    }

    fn write(&mut self, names: &[String], predictions: &[Prediction]) -> Result<()> {
        let steps = self.control.len();
        for (name, prediction) in names.iter().zip(predictions) {
            for (step, &control) in self.control.iter().enumerate() {
                let outputs = (0..self.observables).map(|j| j * steps + step);
                self.table.text(name).number(step as f64).number(control);
                for o in outputs.clone() {
                    self.table.number(prediction.mean[o]);
                }
                for o in outputs {
                    let variance = prediction.variance[o] + self.scatter * prediction.scatter[o];
                    self.table.number(variance.sqrt());
                }
                self.table.end_row()?;
            }
        }
        Ok(())
    }
}

/// Write `observable rmse rmse_range coverage90 scatter_sd`.
///
/// # Errors
/// If the table cannot be written.
pub fn write_check(checks: &[Check], path: Option<&Path>) -> Result<()> {
    let mut table =
        TableWriter::create(path, &["observable", "rmse", "rmse_range", "coverage90", "scatter_sd"])?;
    for check in checks {
        table.text(&check.observable);
        table.numbers(&[check.rmse, check.rmse_range, check.coverage90, check.scatter_sd]);
        table.end_row()?;
    }
    table.finish()
}
