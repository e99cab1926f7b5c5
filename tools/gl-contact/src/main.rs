//! Simulate two spheres in contact, at every sample of a table.

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};
use gl_cli::world::{FAILED_RUNS, Shell};
use gl_world::{Contact, Step};

const EXAMPLES: &str = "\
Examples:
  printf 'description key E_m nu\\ntrial 0 9.3 0.2\\n' | gl-contact -s - runs
  gl-contact --curve E_m=9.3,nu=0.2,w=1 --noise f=0.005,t=0.002 --seed 1 \\
    -o obs.txt
  gl-contact --inputs";

/// Simulate two spheres in contact, at every sample of a table: Hertz's and Mindlin's laws with
/// friction, and effects that these lack.
///
/// Control u: displacement in m. Observables f, t: normal and tangential force in N.
#[derive(Parser)]
#[command(name = "gl-contact", version, after_help = format!("{EXAMPLES}\n\n{FAILED_RUNS}"))]
struct Args {
    #[command(flatten)]
    shell: Shell,
    /// What to do: load once, or unload and reload at two speeds
    #[arg(long, value_enum, default_value_t = Programme::Load, conflicts_with = "observations")]
    programme: Programme,
    /// Radius of both spheres, m
    #[arg(long, default_value_t = Contact::RADIUS)]
    radius: f64,
    /// Tangential over normal displacement at the deepest step
    #[arg(long, default_value_t = Contact::SHEAR, allow_negative_numbers = true)]
    shear: f64,
    /// Deepest overlap, m
    #[arg(long, default_value_t = Contact::OVERLAP, conflicts_with = "observations")]
    overlap: f64,
    /// Number of steps
    #[arg(long, default_value_t = Contact::STEPS, value_parser = gl_cli::count, conflicts_with = "observations")]
    steps: usize,
    /// Speed, m/s
    #[arg(long, default_value_t = Contact::SPEED)]
    speed: f64,
    /// Speed of the second cycle, m/s
    #[arg(long, default_value_t = Contact::FAST)]
    fast: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Programme {
    Load,
    Cycles,
}

fn run(args: &Args) -> Result<()> {
    let path = match (args.shell.follow("u")?, args.programme) {
        (Some(displacements), _) => Step::follow(&displacements, args.speed),
        (None, Programme::Load) => Step::load(args.overlap, args.steps, args.speed),
        (None, Programme::Cycles) => Step::cycles(args.overlap, args.steps, args.speed, args.fast),
    };
    let world = Contact { radius: args.radius, shear: args.shear, path };
    world.check().with_context(|| args.shell.origin("--overlap, --radius, --shear, --speed"))?;
    args.shell.run("gl-contact", &world)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-contact", run(&gl_cli::parse()))
}
