//! Results in words: a line an iteration, a posterior to read.

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use gl_inference::summary::Summary;
use gl_table::rounded;

/// A quantity of a summary as a number; NaN where it is absent.
pub(crate) fn quantity(summary: &Summary, name: &str) -> Result<f64> {
    Ok(summary.find_number(name)?.unwrap_or(f64::NAN))
}

/// One line of an iteration, from the summary that it was resampled by and the posterior of all runs.
///
/// # Errors
/// If a summary cannot be read.
pub fn iteration(number: usize, folder: &Path) -> Result<String> {
    let tempered = Summary::read(&folder.join("summary.txt"))?;
    let posterior = Summary::read(&folder.join("posterior.txt"))?;
    let of = |name: &str| quantity(&tempered, name);
    let mut line = format!(
        "iteration {number}: {} runs, {} failed; sigma {} (noise {}), ess {} of the runs; error {}, best {};",
        of("runs")?,
        of("failed")?,
        rounded(of("sigma")?, 3),
        rounded(of("sigma_noise")?, 3),
        rounded(of("ess")?, 2),
        rounded(of("ensemble_error")?, 3),
        rounded(of("best_error")?, 3)
    );
    // A parameter of an effect that is off does not vary, and has no shrinkage.
    for (j, name) in posterior.names_of("shrinkage").iter().enumerate() {
        let mean = rounded(quantity(&posterior, &format!("mean({name})"))?, 5);
        let sd = rounded(quantity(&posterior, &format!("sd({name})"))?, 2);
        let _ = write!(line, "{} {name} {mean} ± {sd}", if j == 0 { "" } else { "," });
    }
    Ok(line)
}

/// The posterior as a table for reading, and which run fitted best.
///
/// # Errors
/// If the summary cannot be read.
pub fn posterior(file: &Path) -> Result<String> {
    let summary = Summary::read(file)?;
    let mut text = row("parameter", ["mean", "sd", "5 %", "95 %", "best run"].map(str::to_owned));
    for name in summary.names_of("shrinkage") {
        let mut cells: [String; 5] = Default::default();
        for (cell, kind) in cells.iter_mut().zip(["mean", "sd", "q05", "q95", "best"]) {
            *cell = rounded(quantity(&summary, &format!("{kind}({name})"))?, 5);
        }
        text += &row(&name, cells);
    }
    let of = |name: &str| quantity(&summary, name);
    let _ = writeln!(
        text,
        "\nbest run {}, error {} of the range; the posterior rests on {} of {} runs, {} failed",
        summary.get("best_sample").unwrap_or("-"),
        rounded(of("best_error")?, 3),
        rounded(of("ess_runs")?, 3),
        of("runs")?,
        of("failed")?
    );
    Ok(text)
}

fn row(name: &str, cells: [String; 5]) -> String {
    let cells: String = cells.iter().map(|cell| format!(" {cell:>12}")).collect();
    format!("{name:<12}{cells}\n")
}
