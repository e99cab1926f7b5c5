//! Simulate a drained triaxial compression test, at every sample of a table.

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use gl_cli::world::{FAILED_RUNS, Shell};
use gl_world::Triaxial;

const EXAMPLES: &str = "\
Examples:
  printf 'description key G0 phi_c\\ntrial 0 100 32\\n' | gl-triaxial -s - runs
  gl-triaxial --curve phi_c=32,c=10 --noise q=2,e_v=0.0005 --seed 1 -o obs.txt
  gl-triaxial --inputs";

/// Simulate a drained triaxial compression test on sand, at every sample of a table: a
/// critical-state model, and effects that it lacks.
///
/// Control e_a: axial strain. Observables q: deviatoric stress in kPa, e_v: volumetric strain.
/// Strains are fractions, positive in compression.
#[derive(Parser)]
#[command(name = "gl-triaxial", version, after_help = format!("{EXAMPLES}\n\n{FAILED_RUNS}"))]
struct Args {
    #[command(flatten)]
    shell: Shell,
    /// Cell pressure, kPa
    #[arg(long, default_value_t = Triaxial::CELL)]
    cell: f64,
    /// Nominal void ratio at the start
    #[arg(long, default_value_t = Triaxial::VOID_RATIO)]
    void_ratio: f64,
    /// Diameter of the specimen, m
    #[arg(long, default_value_t = Triaxial::DIAMETER)]
    diameter: f64,
    /// Largest axial strain
    #[arg(long, default_value_t = Triaxial::STRAIN, conflicts_with = "observations")]
    strain: f64,
    /// Number of steps
    #[arg(long, default_value_t = Triaxial::STEPS, value_parser = gl_cli::count, conflicts_with = "observations")]
    steps: usize,
}

fn run(args: &Args) -> Result<()> {
    let path = match args.shell.follow("e_a")? {
        Some(strains) => strains,
        None => Triaxial::load(args.strain, args.steps),
    };
    let world = Triaxial { cell: args.cell, void_ratio: args.void_ratio, diameter: args.diameter, path };
    world.check().with_context(|| args.shell.origin("--strain, --cell, --diameter"))?;
    args.shell.run("gl-triaxial", &world)
}

fn main() -> ExitCode {
    gl_cli::finish("gl-triaxial", run(&gl_cli::parse()))
}
