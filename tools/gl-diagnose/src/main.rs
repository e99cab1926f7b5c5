//! Find what a calibrated case lacks.

use std::process::ExitCode;

use clap::Parser;
use gl_drive::diagnose::diagnose;
use gl_drive::{Progress, Request};

/// Diagnose a case: calibrate it, locate the gap, find its cause, put that in and see how far the gap closes
///
/// DIR gets base (the calibration), locate.txt, design (runs with effects on and off), attribution.txt, winner.txt,
/// after-EFFECT (the calibration with it; after-rig, after-EFFECT+rig where errors of the rig are in it), closest-base and closest-after-EFFECT (where something unknown is beside it, the
/// fits of least squares), shrink.txt and the report. Interrupted at any moment and called again, it goes on where it was.
/// The model of a case is a program: it runs with your rights.
///
/// Exit code: 0 done; 1 runs are in the queue (--no-wait); 2 error.
#[derive(Parser)]
#[command(name = "gl-diagnose", version, after_help = EXAMPLE)]
struct Args {
    #[command(flatten)]
    request: Request,
    /// With slurm and pbs: exit with 1 where runs are in the queue, and do not wait for them
    #[arg(long)]
    no_wait: bool,
}

const EXAMPLE: &str = "\
Example:
  gl-init sticky --from contact-effects
  gl-diagnose sticky num=20 iterations=2 design_num=60 --out out/sticky";

fn run(args: &Args) -> anyhow::Result<Progress> {
    diagnose(&args.request, !args.no_wait)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-diagnose", run(&gl_cli::parse()))
}
