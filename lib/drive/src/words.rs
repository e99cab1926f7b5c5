//! Results in words: a line an iteration, a posterior to read.

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use gl_inference::summary::Summary;
use gl_table::rounded;

/// A number that is known, or NaN.
pub(crate) fn known(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// One line of an iteration, from the summary that it was resampled by and the posterior of all runs.
///
/// # Errors
/// If a summary cannot be read.
pub fn iteration(number: usize, folder: &Path) -> Result<String> {
    let tempered = Summary::read(&folder.join("summary.txt"))?;
    let posterior = Summary::read(&folder.join("posterior.txt"))?;
    let counts =
        format!("iteration {number}: {} runs, {} failed", known(tempered.runs), known(tempered.failed));
    let mut line = match tempered.ignorance {
        Some(ignorance) => format!(
            "{counts}; the emulator leaves {} of ln likelihood open; error {}, best run {};",
            rounded(ignorance, 2),
            rounded(known(tempered.ensemble_error), 3),
            rounded(known(tempered.best_error), 3)
        ),
        None => format!(
            "{counts}; sigma {} (noise {}), ess {} of the runs; error {}, best {};",
            rounded(known(tempered.sigma), 3),
            rounded(known(tempered.sigma_noise), 3),
            rounded(known(tempered.ess), 2),
            rounded(known(tempered.ensemble_error), 3),
            rounded(known(tempered.best_error), 3)
        ),
    };
    // A parameter of an effect that is off does not vary.
    for (j, parameter) in posterior.varied().enumerate() {
        let (mean, sd) = (rounded(known(parameter.mean), 5), rounded(known(parameter.sd), 2));
        let _ = write!(line, "{} {} {mean} ± {sd}", if j == 0 { "" } else { "," }, parameter.name);
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
    for of in summary.varied() {
        let cells = [of.mean, of.sd, of.q05, of.q95, of.best].map(|value| rounded(known(value), 5));
        text += &row(&of.name, cells);
    }
    let runs = known(summary.runs);
    let rests = match summary.draws {
        Some(draws) => format!("the posterior is {draws} draws through an emulator of {runs} runs"),
        None => format!("the posterior rests on {} of {runs} runs", rounded(known(summary.ess_runs), 3)),
    };
    let _ = writeln!(
        text,
        "\nbest run {}, error {} of the range; {rests}, {} failed",
        summary.best_sample.as_deref().unwrap_or("-"),
        rounded(known(summary.best_error), 3),
        known(summary.failed)
    );
    Ok(text)
}

fn row(name: &str, cells: [String; 5]) -> String {
    let cells: String = cells.iter().map(|cell| format!(" {cell:>12}")).collect();
    format!("{name:<12}{cells}\n")
}
