//! The pages of the project as a site.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Parser;

/// Write README, docs and the pages of the examples as a site that needs no network, and check every link in it
#[derive(Parser)]
#[command(name = "site", version)]
struct Args {
    /// The project
    #[arg(long, default_value = ".")]
    root: PathBuf,
    /// Where the site goes
    out: PathBuf,
}

fn run(args: &Args) -> Result<()> {
    let dead = pipelines::site::build(&args.root, &args.out)?;
    ensure!(dead.is_empty(), "links that lead nowhere:\n{}", dead.join("\n"));
    Ok(())
}

fn main() -> ExitCode {
    gl_cli::finish("site", run(&gl_cli::parse()))
}
