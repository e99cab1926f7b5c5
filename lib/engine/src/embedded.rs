//! Runs by a simulator that takes the whole table, such as `gl-contact`.

use std::num::NonZeroUsize;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Error, Result, ensure};

use crate::Say;
use crate::folder::RunFolder;
use crate::model::{find_program, path_with_own, split_words};

/// Become `MODEL -s SAMPLES DIR`, which makes the two files of each row and leaves out runs that are complete.
///
/// Returns only where that cannot be: with the reason.
pub fn become_model(samples: &Path, model: &str, dir: &Path, jobs: Option<NonZeroUsize>, say: Say) -> Error {
    match prepare(samples, model, dir, jobs, say) {
        // The lock stays with the model until it ends.
        Ok((_folder, mut command)) => {
            let error = command.exec();
            Error::new(error).context(format!("MODEL: {model}: cannot be started"))
        }
        Err(error) => error,
    }
}

fn prepare(
    samples: &Path,
    model: &str,
    dir: &Path,
    jobs: Option<NonZeroUsize>,
    say: Say,
) -> Result<(RunFolder, Command)> {
    let words = split_words(model)?;
    let (program, arguments) =
        words.split_first().context("MODEL is empty; give a simulator such as gl-contact")?;
    let path = if program.contains('/') { Some(program.into()) } else { find_program(program) };
    let path = path.with_context(|| format!("MODEL: no program {program} in PATH"))?;
    ensure!(
        samples.is_file() || samples == Path::new("-"),
        "{}: no such samples table; gl-sample writes one",
        samples.display()
    );
    let mut folder = RunFolder::create(dir)?;
    folder.lock(say)?;
    let mut command = Command::new(path);
    command.args(arguments).arg("-s").arg(samples).arg(dir).env("PATH", path_with_own());
    if let Some(jobs) = jobs {
        command.env("RAYON_NUM_THREADS", jobs.to_string());
    }
    Ok((folder, command))
}
