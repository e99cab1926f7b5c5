//! The report of a calibration or a diagnosis as one page.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_case::Engine;

/// The report of a calibration or of a diagnosis, as one HTML file with its pictures in it
///
/// Writes report.html into the folder of the results, and for a diagnosis report.md. The page needs no other
/// file and no network.
#[derive(Parser)]
#[command(name = "gl-report", version, after_help = EXAMPLE)]
struct Args {
    /// Folder of the case: params.txt, obs.txt and case.toml
    #[arg(value_name = "CASE")]
    case: PathBuf,
    /// What made the runs; by default what the results say
    #[arg(short, long, value_name = "ENGINE")]
    engine: Option<Engine>,
    /// Folder of the results; by default out/CASE-diagnosis if it is there, else out/CASE
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Settings of the call that made the results, where these do not say them
    #[arg(value_name = "KEY=VALUE")]
    given: Vec<String>,
}

const EXAMPLE: &str = "\
Example:
  gl-init spheres --from collision
  gl-calibrate spheres num=10 iterations=1 --out out/spheres
  gl-report spheres --out out/spheres";

fn run(args: &Args) -> Result<()> {
    let out = args.out.clone().unwrap_or_else(|| default_out(&args.case));
    for path in gl_page::write(&args.case, args.engine, &out, &args.given)? {
        gl_table::print(&format!("{}\n", path.display()))?;
    }
    Ok(())
}

fn default_out(case: &Path) -> PathBuf {
    let folder = case.canonicalize().unwrap_or_else(|_| case.to_owned());
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let diagnosis = Path::new("out").join(format!("{name}-diagnosis"));
    if diagnosis.is_dir() { diagnosis } else { Path::new("out").join(&*name) }
}

fn main() -> ExitCode {
    gl_cli::finish("gl-report", run(&gl_cli::parse()))
}
