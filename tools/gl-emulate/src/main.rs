//! Draw parameter samples from the prior, one row a sample.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl::prior::Prior;

/// Draw parameter samples from the prior, one row a sample.
#[derive(Parser)]
#[command(name = "gl-emulate", version)]
struct Args {
    /// Table of parameters
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
}

fn run(args: &Args) -> Result<()> {
    let _prior = Prior::read(&args.params)?;
    Ok(())
}

fn main() -> ExitCode {
    gl::cli::finish("gl-emulate", run(&Args::parse()))
}
