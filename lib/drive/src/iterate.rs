//! One iteration of runs that were made elsewhere, and the next samples.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::arguments::{Request, Results};
use crate::calibrate::iteration::{Iteration, Setting};
use crate::calibrate::{alone, say};
use crate::check;
use crate::step::{Runner, copy, make_folder, show};
use crate::words;
use gl_inference::prior::Prior;

/// Take runs through one iteration of a calibration, and draw the next samples: whether a criterion says stop.
///
/// * `samples` — the table of the samples that were run.
/// * `runs` — the folder with their files.
/// * `number` — of the iteration, from 0; those before must have been done.
///
/// # Errors
/// If the case is wrong, or a step fails.
pub fn iterate(request: &Request, samples: &Path, runs: &Path, number: usize) -> Result<bool> {
    let case = request.load()?;
    check::check_tables(&case)?;
    ensure!(samples.is_file(), "{}: no such samples table", samples.display());
    ensure!(runs.is_dir(), "{}: no such folder of runs", runs.display());
    let out = request.own_folder(Results::Calibration)?;
    let folder = out.join(format!("iter{number}"));
    let before = number.checked_sub(1).map(|before| (before, out.join(format!("iter{before}/stop.code"))));
    if let Some((before, done)) = before {
        ensure!(done.exists(), "{}: not there; do iteration {before} first", done.display());
    }
    let runner = Runner::new(&out)?;
    let _lock = alone(&out, "gl-iterate")?;
    make_folder(&folder)?;
    place(samples, &folder.join("samples.txt"))?;
    for test in &case.tests {
        let (runs, within) = match test.name.as_str() {
            "" => (runs.to_owned(), folder.clone()),
            name => (runs.join(name), folder.join(name)),
        };
        ensure!(runs.is_dir(), "{}: no such folder of runs of the test {}", runs.display(), test.name);
        make_folder(&within)?;
        link(&runs, &within.join("runs"))?;
        // The runs may be others than before.
        gl_table::remove(&within.join("ensemble.txt"))?;
    }
    let prior = Prior::read(&case.params())?;
    let setting = Setting {
        case: &case,
        runs: None,
        prior: &prior,
        settings: None,
        known: None,
        wait: true,
        runner: &runner,
        out: &out,
    };
    let stops = Iteration::new(&setting, number).weigh_all()?;
    say(words::iteration(number, &folder)?)?;
    show(&folder.join("stop.log"), 0);
    let next = Iteration::new(&setting, number + 1);
    next.propose()?;
    say(format!("next samples: {}", next.file("samples.txt").display()))?;
    Ok(stops)
}

/// The samples table, unless it stands in its place already.
fn place(samples: &Path, target: &Path) -> Result<()> {
    if is_same(samples, target) { Ok(()) } else { copy(samples, target) }
}

/// The folder of the runs as a link, unless it stands in its place already.
fn link(runs: &Path, target: &Path) -> Result<()> {
    if is_same(runs, target) {
        return Ok(());
    }
    gl_table::remove(target)?;
    let whole = fs::canonicalize(runs).with_context(|| format!("{}: cannot be read", runs.display()))?;
    std::os::unix::fs::symlink(whole, target).with_context(|| format!("{}: cannot be made", target.display()))
}

fn is_same(one: &Path, other: &Path) -> bool {
    let whole = |path: &Path| -> Option<PathBuf> { fs::canonicalize(path).ok() };
    whole(one).is_some_and(|one| whole(other) == Some(one))
}
