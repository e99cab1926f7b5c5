//! Draw parameter samples from the prior, one row a sample.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags)]

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Result, anyhow};
use clap::{Parser, ValueEnum};
use gl_inference::design::{self, Effects};
use gl_inference::prior::Prior;
use gl_inference::samples::{Samples, sample_names};
use gl_numeric::sequence::Method;

/// Draw parameter samples from the prior, one row a sample
#[derive(Parser)]
#[command(name = "gl-sample", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters: name lower upper, and optionally scale mean sd effect off
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Number of samples, or `auto` for 10 d ln d of the d parameters that vary
    #[arg(short, long, value_name = "N|auto")]
    num: SampleCount,
    /// How the samples fill the space
    #[arg(long, value_enum, default_value = "halton")]
    method: MethodName,
    /// Seed of the scrambling; the same seed gives the same samples on every machine
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The plain sequence, which begins at the lower bounds
    #[arg(long)]
    unscrambled: bool,
    /// First part of each sample's name, <NAME>_Iter<i>_Sample<j>
    #[arg(long, default_value = "run")]
    name: String,
    /// Iteration number in the samples' names
    #[arg(long, value_name = "I", default_value_t = 0)]
    iteration: usize,
    /// Threads a run, written as !OMP_NUM_THREADS for yade-batch
    #[arg(long, value_name = "T")]
    threads: Option<NonZeroUsize>,
    /// Effects in the runs: none, pairs (none, one or two of them, for gl-gap-attribute), switch (each in half of the runs), or names
    #[arg(long, value_name = "none|pairs|switch|NAME,…", default_value = "none")]
    effects: EffectsName,
    /// Where the samples go; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  printf 'name lower upper\\nE_m 7 11\\nnu 0 0.5\\n' | gl-sample -p - -n 8";

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    Halton,
    Sobol,
    Lhs,
}

#[derive(Clone, Copy)]
enum SampleCount {
    Auto,
    Exactly(usize),
}

impl FromStr for SampleCount {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        gl_cli::count(text).map(Self::Exactly).map_err(|problem| anyhow!("{problem}, nor is it auto"))
    }
}

#[derive(Clone)]
struct EffectsName(Effects);

impl From<&str> for EffectsName {
    fn from(text: &str) -> Self {
        Self(match text {
            "none" => Effects::None,
            "switch" => Effects::Switch,
            "pairs" => Effects::Pairs,
            names => Effects::On(names.split(',').map(str::to_owned).collect()),
        })
    }
}

fn run(args: &Args) -> Result<()> {
    let prior = Prior::read(&args.params)?;
    let effects = &args.effects.0;
    let count = match args.num {
        SampleCount::Exactly(count) => count,
        SampleCount::Auto => design::auto_count(design::varied(&prior, effects)?.len()),
    };
    let method = match args.method {
        MethodName::Halton => Method::Halton,
        MethodName::Sobol => Method::Sobol,
        MethodName::Lhs => Method::Lhs,
    };
    let samples = Samples {
        source: "samples".to_owned(),
        names: sample_names(&args.name, args.iteration, count)?,
        parameters: prior.names(),
        values: design::draw(&prior, effects, method, count, args.seed, !args.unscrambled)?,
    };
    samples.write(args.output.as_deref(), args.threads.map(NonZeroUsize::get))
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish("gl-sample", gl_cli::about(run(&args), [&args.params]))
}
