//! Take runs that were made elsewhere through one iteration of a calibration.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use gl_drive::Request;
use gl_drive::iterate::iterate;

/// Take runs that were made elsewhere through one iteration of a calibration, and draw the next samples
///
/// DIR gets the tables of the iteration in iter0, and the next samples in iter1/samples.txt. When those have run
/// too, the same call with --iteration 1 and them as SAMPLES goes on, weighing all runs together.
///
/// Exit code: 0 a criterion says stop, 1 go on with the next samples, 2 error.
#[derive(Parser)]
#[command(name = "gl-iterate", version, after_help = EXAMPLE)]
struct Args {
    /// Folder of the case, with params.txt, obs.txt and case.toml
    #[arg(value_name = "CASE")]
    case: PathBuf,
    /// The table of the samples that were run
    #[arg(value_name = "SAMPLES")]
    samples: PathBuf,
    /// Folder with their <description>_sim.txt and <description>_param.txt
    #[arg(value_name = "RUNS")]
    runs: PathBuf,
    /// Number of this iteration, from 0
    #[arg(short, long, value_name = "I", default_value_t = 0)]
    iteration: usize,
    /// Folder of the results; out/NAME-OF-CASE-FOLDER when absent
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Settings of case.toml for this call, such as num=40 or noise=f=0.01
    #[arg(value_name = "KEY=VALUE")]
    given: Vec<String>,
}

const EXAMPLE: &str = "\
Example:
  gl-init my-case --from collision
  gl-sample -p my-case/params.txt -n 30 --name collision -o samples.txt
  gl-contact -s samples.txt runs
  gl-iterate my-case samples.txt runs --out fit || [ $? -eq 1 ]";

fn run(args: &Args) -> anyhow::Result<bool> {
    let request =
        Request { case: args.case.clone(), engine: None, out: args.out.clone(), given: args.given.clone() };
    iterate(&request, &args.samples, &args.runs, args.iteration)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-iterate", run(&gl_cli::parse()))
}
