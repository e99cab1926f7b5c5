//! Simulate two spheres in contact, at every sample of a table.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::{Parser, ValueEnum};
use gl::observations::ByName;
use gl::samples::Samples;
use gl::table::Table;
use gl::world::{self, Contact, Step};

const EXAMPLES: &str = "\
Examples:
  printf 'description key E_m nu\\ntrial 0 9.3 0.2\\n' | gl-contact -s - runs
  gl-contact --curve E_m=9.3,nu=0.2,w=0.2 --noise f=0.005 --seed 1 -o obs.txt
  gl-contact --inputs

A run fails alone if its parameters make no sense: it is named on stderr, and has no files. The exit
code is 2 only if every run failed, or nothing could be run.";

/// Simulate two spheres in contact, at every sample of a table: Hertz and Mindlin's laws with
/// friction, and effects that these lack.
///
/// Control u: displacement in m. Observables f, t: normal and tangential force in N. A parameter that
/// the table lacks has its default; those of the effects are 0, and the effects then absent.
#[derive(Parser)]
#[command(name = "gl-contact", version, after_help = EXAMPLES)]
struct Args {
    /// Table of samples: run each, unless its files are complete already
    #[arg(short, long, value_name = "FILE", requires = "dir", required_unless_present_any = ["curve", "inputs"])]
    samples: Option<PathBuf>,
    /// Folder for <description>_param.txt and <description>_sim.txt
    dir: Option<PathBuf>,
    /// Write the curve at these parameters instead, NAME=VALUE,…
    #[arg(long, value_name = "VALUES", conflicts_with_all = ["samples", "inputs"])]
    curve: Option<ByName>,
    /// Standard deviation of noise on the curve, in units of the observable, NAME=SD,…
    #[arg(long, value_name = "SD", requires = "curve")]
    noise: Option<ByName>,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Write the table of parameters that are known instead
    #[arg(long, conflicts_with = "samples")]
    inputs: bool,
    /// Where the curve or the table of parameters goes; stdout if absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// What to do: load once, or unload and reload at two speeds
    #[arg(long, value_enum, default_value_t = Programme::Load)]
    programme: Programme,
    /// Follow the displacements of this measurement, at --speed, instead of a programme
    #[arg(short = 'b', long, value_name = "FILE", conflicts_with = "programme")]
    observations: Option<PathBuf>,
    /// Its column of displacements
    #[arg(short, long, value_name = "NAME", default_value = "u")]
    control: String,
    /// Radius of both spheres, m
    #[arg(long, default_value_t = Contact::RADIUS)]
    radius: f64,
    /// Tangential over normal displacement at the deepest step
    #[arg(long, default_value_t = Contact::SHEAR)]
    shear: f64,
    /// Deepest overlap, m
    #[arg(long, default_value_t = Contact::OVERLAP)]
    overlap: f64,
    /// Number of steps
    #[arg(long, default_value_t = Contact::STEPS)]
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

fn contact(args: &Args) -> Result<Contact> {
    let path = match (&args.observations, args.programme) {
        (Some(file), _) => Step::follow(&Table::read(file)?.numbers(&args.control)?, args.speed),
        (None, Programme::Load) => Step::load(args.overlap, args.steps, args.speed),
        (None, Programme::Cycles) => Step::cycles(args.overlap, args.steps, args.speed, args.fast),
    };
    let contact = Contact { radius: args.radius, shear: args.shear, path };
    contact.check()?;
    Ok(contact)
}

fn run(args: &Args) -> Result<()> {
    let world = contact(args)?;
    let output = args.output.as_deref();
    if args.inputs {
        return world::write_inputs(&world, output);
    }
    if let Some(values) = &args.curve {
        let noise = args.noise.clone().unwrap_or_default();
        return world::write_curve(&world, values, &noise, args.seed, output);
    }
    let (Some(samples), Some(dir)) = (&args.samples, &args.dir) else {
        bail!("name a table of samples with -s, and a folder for the runs");
    };
    let report = world::run_samples(&world, &Samples::read(samples)?, dir)?;
    for message in report.messages() {
        gl::cli::note("gl-contact", message);
    }
    Ok(())
}

fn main() -> ExitCode {
    gl::cli::finish("gl-contact", run(&Args::parse()))
}
