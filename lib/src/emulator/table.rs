//! What an emulator has to say, as tables.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use rayon::prelude::*;

use super::{Check, Emulator, Reach};
use crate::ensemble::Ensemble;
use crate::samples::Samples;
use crate::table::TableWriter;

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
    ensure!(scatter >= 0.0 && scatter.is_finite(), "--scatter {scatter}: give a share of 0 or more");
    let parameters = emulator.prior.names();
    let values = at.columns(&parameters)?;
    let mut outside = 0;
    for (name, values) in at.names.iter().zip(&values) {
        match emulator.reach(&emulator.coordinates(values)) {
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

    let mut columns = vec!["sample".to_owned(), "step".to_owned(), ensemble.control_name.clone()];
    columns.extend(ensemble.observables.iter().cloned());
    columns.extend(ensemble.observables.iter().map(|name| format!("{name}_sd")));
    let mut table = TableWriter::create(path, &columns)?;
    let steps = emulator.steps();
    let places: Vec<_> = (0..ensemble.observables.len()).map(|j| j * steps).collect();
    for (names, values) in at.names.chunks(BATCH).zip(values.chunks(BATCH)) {
        let predictions: Vec<_> =
            values.par_iter().map(|values| emulator.predict(&emulator.coordinates(values))).collect();
        for (name, prediction) in names.iter().zip(predictions) {
            for (step, &control) in ensemble.control.iter().enumerate() {
                table.text(name).number(step as f64).number(control);
                for place in &places {
                    table.number(prediction.mean[place + step]);
                }
                for place in &places {
                    let o = place + step;
                    table.number((prediction.variance[o] + scatter * prediction.scatter[o]).sqrt());
                }
                table.end_row()?;
            }
        }
    }
    table.finish()?;
    Ok(outside)
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
