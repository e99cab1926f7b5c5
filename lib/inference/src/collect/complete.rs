//! When a run is complete: the one answer to that question, for whoever starts runs and whoever reads them.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_table::Rows;

use super::packed::Packs;
use super::{Failure, judge_runs};
use crate::samples::Samples;

/// Relative difference up to which a run's parameters are the table's. Both are rounded, perhaps
/// differently, by whoever wrote them.
pub const RTOL: f64 = 1e-5;

/// What became of the run of each sample in a folder, in the order of the samples: complete, or why not.
///
/// A run is complete where its simulation has a header, a row and a line end after the last row, and its
/// parameters are those of the table up to [`RTOL`]. It may be packed or loose. Whether it is of use for a
/// measurement, [`Collection::collect`](super::Collection::collect) says, which takes complete runs only.
///
/// # Errors
/// If the folder cannot be read.
pub fn completeness(samples: &Samples, folder: &Path) -> Result<Vec<Result<(), Failure>>> {
    judge_in(samples, folder, &Packs::find(folder, samples)?)
}

/// [`completeness`], with no other packed files than those at `packed`.
///
/// # Errors
/// If one of them cannot be read.
pub fn completeness_in(
    samples: &Samples,
    folder: &Path,
    packed: Vec<PathBuf>,
) -> Result<Vec<Result<(), Failure>>> {
    judge_in(samples, folder, &Packs::of(packed, samples)?)
}

fn judge_in(samples: &Samples, folder: &Path, packs: &Packs) -> Result<Vec<Result<(), Failure>>> {
    let mut status = Vec::with_capacity(samples.len());
    let judge = |i: usize, parameters: Option<&[u8]>, simulation: &[u8]| {
        check_complete(samples, i, parameters, simulation, RTOL)
    };
    judge_runs("looking for runs", &[(folder, packs)], samples, judge, |_, runs| {
        status.extend(runs);
        Ok(())
    })?;
    Ok(status)
}

/// Whether the run of sample `i` is complete, from what is in its two files.
pub(super) fn check_complete(
    samples: &Samples,
    i: usize,
    parameters: Option<&[u8]>,
    simulation: &[u8],
    rtol: f64,
) -> Result<(), Failure> {
    let name = &samples.names[i];
    if simulation.iter().all(u8::is_ascii_whitespace) {
        return Err(Failure::Empty);
    }
    let Some(parameters) = parameters else {
        return Err(Failure::Missing(format!("no {name}_param.txt")));
    };
    check_parameters(&format!("{name}_param.txt"), parameters, samples, i, rtol)?;
    let mut rows = Rows::new(&format!("{name}_sim.txt"), simulation).map_err(malformed)?;
    // A number that was cut off is still a number: only the missing line end tells.
    if !simulation.ends_with(b"\n") {
        return Err(Failure::Truncated("no line end after the last row, which may be cut off".to_owned()));
    }
    match rows.next_row() {
        Ok(Some(_)) => Ok(()),
        Ok(None) => Err(Failure::Empty),
        Err(error) => Err(malformed(error)),
    }
}

/// Compare the parameters that the run wrote down with the table's.
fn check_parameters(file: &str, bytes: &[u8], samples: &Samples, i: usize, rtol: f64) -> Result<(), Failure> {
    if samples.parameters.is_empty() {
        return Ok(());
    }
    let mut rows = Rows::new(file, bytes).map_err(malformed)?;
    let format = rows.format().clone();
    let Some((_, fields)) = rows.next_row().map_err(malformed)? else {
        return Err(Failure::Parameters(format!("{file} has no row")));
    };
    for (name, &expected) in samples.parameters.iter().zip(&samples.values[i]) {
        let Some(column) = format.find(name).map_err(malformed)? else {
            return Err(Failure::Parameters(format!("{file} has no column {name}")));
        };
        let close = |value: f64| (value - expected).abs() <= rtol * value.abs().max(expected.abs());
        if !fields[column].parse::<f64>().is_ok_and(close) {
            let problem = format!("{name} is {}, not {expected} as in the table", fields[column]);
            return Err(Failure::Parameters(problem));
        }
    }
    Ok(())
}

pub(super) fn malformed(error: anyhow::Error) -> Failure {
    Failure::Malformed(format!("{error:#}"))
}
