//! Calibrate a case.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use gl_drive::calibrate::{Limits, calibrate};
use gl_drive::{Progress, Request};

/// Calibrate a case: samples, runs, weights, again and again until a criterion is met
///
/// DIR gets iter0, iter1, … with the tables of each iteration, and at the end ensemble.txt (all runs),
/// posterior-weights.txt and posterior.txt (their weights, and what these say). Interrupted at any moment and
/// called again, it goes on where it was; called with other settings it computes anew what they change.
/// commands.log has each call that was made. The model of a case is a program: it runs with your rights.
///
/// Exit code: 0 done, by a criterion or the number of iterations; 1 runs are in the queue (--no-wait); 2 error.
#[derive(Parser)]
#[command(name = "gl-calibrate", version, after_help = EXAMPLE)]
struct Args {
    #[command(flatten)]
    request: Request,
    #[command(flatten)]
    limits: Limits,
    /// Runs of the same model that are there already, samples.txt and ensemble.txt in DIR (ensemble-TEST.txt of each
    /// test): with an emulator they count from the start
    #[arg(long, value_name = "DIR")]
    with: Option<PathBuf>,
}

const EXAMPLE: &str = "\
Example:
  gl-init my-case --from collision
  gl-calibrate my-case num=20 seed=5 --out out/my-case";

fn run(args: &Args) -> anyhow::Result<Progress> {
    calibrate(&args.request, args.limits, args.with.as_deref())
}

fn main() -> ExitCode {
    gl_cli::finish("gl-calibrate", run(&gl_cli::parse()))
}
