//! Turn a folder of GrainLearning runs into tables.

mod folder;
mod npy;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Parser;
use gl_cli::note;

/// Turn a folder of GrainLearning runs into tables of gl-collect and gl-filter
///
/// A run that cannot be read is named and left out; gl-collect then counts it as missing. The parameter file
/// of a run comes from the run, not from the table, so that gl-collect still sees runs that belong to another
/// table. Runs in .npy need python3 with numpy.
#[derive(Parser)]
#[command(name = "gl-import", version, after_help = EXAMPLE)]
struct Args {
    /// GrainLearning's sim_data_dir: iter0, iter1, …, each with its runs as text or as .npy, and the table
    /// NAME_Iter0_Samples.txt there or beside the folder; without a table the parameters are those of the runs
    #[arg(value_name = "DIR")]
    from: PathBuf,
    /// Gets iter0/samples.txt and iter0/runs, and so on
    #[arg(value_name = "OUT")]
    to: PathBuf,
}

const EXAMPLE: &str = "Example:
  mkdir -p old/iter0
  printf '# x y\\n0 5\\n1 5.2\\n' > old/iter0/line_Iter0_Sample0_sim.txt
  printf '# a b\\n.2 5\\n' > old/iter0/line_Iter0_Sample0_param.txt
  gl-import old new";

fn run(args: &Args) -> Result<()> {
    let iterations = folder::iterations(&args.from)?;
    ensure!(!iterations.is_empty(), "{}: no folder iter0 in it", args.from.display());
    for number in iterations {
        let iteration = folder::Iteration::read(&args.from, number)?;
        let written = iteration.write(&args.to.join(format!("iter{number}")))?;
        note("gl-import", format_args!("iter{number}: {} samples, {written} runs", iteration.samples()));
    }
    Ok(())
}

fn main() -> ExitCode {
    gl_cli::finish("gl-import", run(&gl_cli::parse()))
}
