//! Runs by a simulator that takes the whole table, such as `gl-contact`.

use std::num::NonZeroUsize;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Error, Result, bail, ensure};

use crate::Say;
use crate::batch_table::BatchTable;
use crate::call::Call;
use crate::folder::RunFolder;
use crate::model::{command_words, find_program, path_with_own, placeholders, split_words};

/// Become `MODEL -s SAMPLES DIR`, which makes the two files of each row and leaves out runs that are complete. It alone
/// knows how long a run takes, and adds that to the table that is named in `GL_TIMES`, if it likes.
///
/// Returns only where that cannot be: with the reason.
pub fn become_model(call: &Call, jobs: Option<NonZeroUsize>, say: Say) -> Error {
    match prepare(call, jobs, say) {
        // The lock stays with the model until that ends.
        Ok((_folder, mut command)) => {
            let error = command.exec();
            Error::new(error).context(format!("MODEL: {}: cannot be started", call.model))
        }
        Err(error) => error,
    }
}

/// The program of an embedded simulator, and the arguments that it is given first.
///
/// # Errors
/// If there is none, a quote is not closed, or a word has a placeholder, which nothing would fill in.
pub fn simulator(model: &str, case: &Path) -> Result<(PathBuf, Vec<String>)> {
    if let Some(name) =
        split_words(model)?.iter().flat_map(|word| placeholders(word)).find(|name| *name != "case")
    {
        bail!(
            "{{{name}}} is filled in for a run at a time (gl-run local); an embedded simulator finds the column {name} in the samples table"
        );
    }
    let mut words = command_words(model, case)?.into_iter();
    let program = words.next().context("is empty; give a simulator such as gl-contact")?;
    let path = if program.contains('/') { Some(PathBuf::from(&program)) } else { find_program(&program) };
    let path = path.with_context(|| format!("no program {program} in PATH"))?;
    ensure!(path.is_file(), "no program {program}");
    Ok((path, words.collect()))
}

fn prepare(call: &Call, jobs: Option<NonZeroUsize>, say: Say) -> Result<(RunFolder, Command)> {
    let (path, arguments) = simulator(&call.model, &call.case).context("MODEL")?;
    // What is on standard input can be read only once, by the model.
    if call.samples != Path::new("-") {
        BatchTable::read(&call.samples)?;
    }
    let mut folder = RunFolder::create(&call.dir)?;
    folder.lock(say)?;
    let mut command = Command::new(path);
    command.args(arguments).arg("-s").arg(&call.samples).arg(&call.dir).env("PATH", path_with_own());
    if let Some(times) = &call.times {
        command.env("GL_TIMES", std::path::absolute(times).context("--times")?);
    }
    if let Some(jobs) = jobs {
        command.env("RAYON_NUM_THREADS", jobs.to_string());
    }
    Ok((folder, command))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_placeholder_that_nothing_would_fill_in_is_refused() {
        let of = |model: &str| simulator(model, Path::new("/bin"));
        let error = of("true --diameter {Do}").unwrap_err().to_string();
        assert!(error.contains("{Do} is filled in for a run at a time"), "{error}");
        assert_eq!(of("{case}/true --fast").unwrap().1, ["--fast"]);
    }
}
