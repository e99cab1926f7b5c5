//! The base parameters that a design is drawn from.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};
use gl_cli::about;
use gl_gap::design_box::{Limit, narrow, read_leans, widen};
use gl_inference::prior::Prior;
use gl_inference::weights::Weights;

/// Make the table of parameters that a design is drawn from narrower than the prior, or wider again
#[derive(Parser)]
#[command(name = "gl-box", version, after_help = EXAMPLE)]
struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Base parameters between the runs that fit about as well as the best, half as wide again
    Narrow {
        /// Table of parameters
        #[arg(short, long, value_name = "FILE")]
        params: PathBuf,
        /// Where the table goes; stdout when absent
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        /// Runs with their misfits, as gl-filter writes them
        #[arg(value_name = "WEIGHTS")]
        weights: PathBuf,
    },
    /// The box wider on each side that a hypothesis leans on: exit 0 wider, 1 none does, and it stays as it is
    Widen {
        /// Table of parameters, beyond which the box does not grow without --beyond
        #[arg(short, long, value_name = "FILE")]
        params: PathBuf,
        /// The box
        #[arg(short, long = "box", value_name = "FILE")]
        narrowed: PathBuf,
        /// Where the prior itself is leaned on, beyond it, too: by half its width, and by its whole width for what comes first
        #[arg(long)]
        beyond: bool,
        /// Where the table goes; stdout when absent
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        /// What hypotheses say of the parameters, as gl-gap-attribute --posterior-out writes it
        #[arg(value_name = "POSTERIOR")]
        posterior: PathBuf,
    },
}

const EXAMPLE: &str = "\
Example:
  printf 'name lower upper\\na 0 10\\n' > params.txt
  printf 'sample a misfit weight\\nr1 4 1 0.5\\nr2 6 2 0.5\\n' > weights.txt
  gl-box narrow -p params.txt weights.txt";

fn run(args: &Args) -> Result<bool> {
    match &args.what {
        What::Narrow { params, output, weights } => {
            let narrowed = about(narrow(&Prior::read(params)?, &Weights::read(weights)?), [weights, params])?;
            narrowed.write(output.as_deref())?;
            Ok(true)
        }
        What::Widen { params, narrowed, beyond, output, posterior } => {
            let (prior, within) = (Prior::read(params)?, Prior::read(narrowed)?);
            let limit = if *beyond { Limit::Beyond } else { Limit::Prior };
            let wider = widen(&prior, &within, &read_leans(posterior)?, limit);
            let wider = about(wider, [narrowed, params, posterior])?;
            wider.as_ref().unwrap_or(&within).write(output.as_deref())?;
            Ok(wider.is_some())
        }
    }
}

fn main() -> ExitCode {
    gl_cli::finish("gl-box", run(&gl_cli::parse()))
}
