//! The page of a calibration or of a diagnosis: one HTML file with its pictures in it, and the same in short
//! as Markdown.
//!
//! It is made from what the drivers left in a folder, tables and verdicts, and from templates; the pictures
//! are those of gl-plot.

mod calibration;
mod case;
mod content;
mod grid;
mod pictures;
mod render;
mod tools;
mod verdict;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gl_case::Engine;
use gl_case::folders::{BASE, BASE_WIDER};
use gl_case::shell::quoted;
use gl_table::write_whole;

/// Write OUT/report.html, and for a diagnosis OUT/report.md; what was written.
///
/// * `case` — the folder of the case.
/// * `engine` — what made the runs, where that is not what the folder says.
/// * `out` — what gl-calibrate or gl-diagnose wrote.
/// * `given` — settings of that call, each `KEY=VALUE`, where the folder does not say them.
///
/// # Errors
/// If there is no calibration in the folder, a table cannot be read, or a picture cannot be drawn.
pub fn write(case: &Path, engine: Option<Engine>, out: &Path, given: &[String]) -> Result<Vec<PathBuf>> {
    let case = case::Case::read(case, engine, out, given)?;
    let has_base = out.join(BASE).is_dir();
    let wider = Some(out.join(BASE_WIDER)).filter(|wider| wider.is_dir());
    let base = if has_base { wider.unwrap_or_else(|| out.join(BASE)) } else { out.to_owned() };
    let of = quoted(&out.display().to_string());
    ensure!(
        base.join("posterior.txt").exists() || !base.join("iter0").exists(),
        "{}: its calibration has no posterior yet; gl-status {of} says how far it is",
        out.display()
    );
    ensure!(
        base.join("posterior.txt").exists(),
        "{}: no calibration there; gl-calibrate {} --out {of} makes one",
        out.display(),
        quoted(&case.folder.display().to_string()),
    );
    let content = content::Content::gather(&case, out, &base)?;
    let mut written = vec![put(&out.join("report.html"), &render::html(&content)?)?];
    if has_base {
        written.push(put(&out.join("report.md"), &render::markdown(&content)?)?);
    }
    Ok(written)
}

fn put(path: &Path, text: &str) -> Result<PathBuf> {
    write_whole(path, text.as_bytes())?;
    Ok(path.to_owned())
}

/// How many rows a table has.
fn rows(path: &Path) -> Result<usize> {
    Ok(gl_table::Table::read(path)?.len())
}

/// The text of a file.
fn text(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))
}
