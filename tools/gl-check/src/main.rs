//! Check a case before its first run.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_cli::conclude;
use gl_drive::Request;
use gl_drive::check::check_case;

/// Check a case before its first run, and say what it will take
///
/// Checked are the tables, the names in case.toml, the noise, the model with its placeholders, its program, what the
/// engine needs and the free disk. Said is how many runs there will be at the most, and, once some are there, how
/// long they take. gl-calibrate and gl-diagnose check the same.
///
/// Exit code: 0 all is well; 2 something is wrong, and all of it is said.
#[derive(Parser)]
#[command(name = "gl-check", version, after_help = EXAMPLE)]
struct Args {
    #[command(flatten)]
    request: Request,
    /// Where the same goes as a table: code value text
    #[arg(long, value_name = "FILE")]
    verdict: Option<PathBuf>,
}

const EXAMPLE: &str = "\
Example:
  gl-init my-case --from collision
  gl-check my-case num=50";

fn run(args: &Args) -> Result<()> {
    conclude("gl-check", &check_case(&args.request)?, args.verdict.as_deref(), || Ok(()))
}

fn main() -> ExitCode {
    gl_cli::finish("gl-check", run(&gl_cli::parse()))
}
