//! Runs that numpy saved. Only numpy reads its own format with certainty, so a small script does.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use gl_cli::note;

const SCRIPT: &str = include_str!("npy.py");
/// What the script ends with where numpy is missing.
const NO_NUMPY: i32 = 3;

/// Write the runs of these files as tables into a folder; those that cannot be read are named.
///
/// # Errors
/// If python3 or numpy is missing.
pub fn unpack(files: &[PathBuf], to: &Path) -> Result<()> {
    let Some(first) = files.first() else { return Ok(()) };
    let needs = || format!("{}: reading .npy needs python3 with numpy", first.display());
    let arguments = [OsStr::new("-c"), OsStr::new(SCRIPT), to.as_os_str()];
    let output = Command::new("python3")
        .args(arguments.into_iter().chain(files.iter().map(|file| file.as_os_str())))
        .output()
        .with_context(|| format!("{}; python3 cannot be started", needs()))?;
    let said = String::from_utf8_lossy(&output.stderr);
    match output.status.code() {
        Some(0) => said.lines().for_each(|line| note("gl-import", format_args!("left out: {line}"))),
        Some(NO_NUMPY) => bail!("{}; python3 is there, numpy is not", needs()),
        _ => bail!("{}; python3 failed: {}", needs(), said.lines().last().unwrap_or("it said nothing")),
    }
    Ok(())
}
