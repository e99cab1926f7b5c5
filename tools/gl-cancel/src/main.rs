//! Take a calibration or diagnosis out of the queue.

use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Parser;
use gl_case::Cluster;
use gl_engine::control::{Control, Record};
use gl_engine::scheduler::{Patience, of_engine};

/// Take a calibration or diagnosis out of the queue
///
/// What has been computed stays, and gl-submit goes on from there.
#[derive(Parser)]
#[command(name = "gl-cancel", version, after_help = EXAMPLE)]
struct Args {
    /// Folder of its results
    #[arg(value_name = "OUT")]
    out: PathBuf,
}

const EXAMPLE: &str = "\
Exit code: 0 nothing of it is in the queue; 2 error.

Example:
  gl-init line --from linear
  gl-submit line --engine pbs --out out/line num=12 iterations=1
  gl-cancel out/line";

fn run(args: &Args) -> Result<()> {
    let out = args.out.display();
    let record =
        Record::read(&args.out)?.with_context(|| format!("{out}: was not submitted; gl-submit does that"))?;
    let scheduler = of_engine(record.engine, &Cluster::default(), Patience::medium())?;
    let say = |text: &str| gl_cli::note("gl-cancel", text);
    let pause = || thread::sleep(Duration::from_millis(500));
    let count = Control::of(&args.out, scheduler.as_ref())?.cancel(&say, &pause)?;
    say(&format!("{out}: {count} jobs cancelled"));
    Ok(())
}

fn main() -> ExitCode {
    gl_cli::finish("gl-cancel", run(&gl_cli::parse()))
}
