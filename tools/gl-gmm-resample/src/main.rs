//! Draw the next samples where the weight lies.

// A help text is no Markdown.
#![allow(rustdoc::invalid_html_tags)]

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::{Parser, ValueEnum};
use gl_cli::note;
use gl_inference::mixture::CovarianceType;
use gl_inference::prior::Prior;
use gl_inference::resample::{Resampling, Sampling, resample};
use gl_inference::samples::{Samples, sample_names};
use gl_inference::weights::Weights;
use gl_numeric::statistics::effective_size;

/// Draw the next samples where the weight lies
///
/// Fits a variational Bayesian Gaussian mixture to the weighted samples and draws from it, inside the
/// prior's support.
#[derive(Parser)]
#[command(name = "gl-gmm-resample", version, after_help = EXAMPLE)]
struct Args {
    /// Table of parameters
    #[arg(short, long, value_name = "FILE")]
    params: PathBuf,
    /// Number of samples
    #[arg(short, long, value_name = "N", value_parser = gl_cli::count)]
    num: usize,
    /// Components of the mixture at the most; when absent, as many as the effective samples can show, up to 10
    #[arg(long, value_name = "K", value_parser = gl_cli::few)]
    components: Option<usize>,
    /// Shape of the components
    #[arg(long, value_enum, default_value = "full")]
    covariance: Shape,
    /// Concentration of the components' weights; small means few components; 1/K when absent
    #[arg(long, value_name = "C")]
    concentration: Option<f64>,
    /// Draw evenly where the density is high (slice), or by the density (mixture)
    #[arg(long, value_enum, default_value = "slice")]
    sampling: SamplingName,
    /// How far below the mean score a slice reaches, in standard deviations of the scores
    #[arg(long, value_name = "D", default_value_t = 3.0, value_parser = gl_cli::not_negative)]
    deviation: f64,
    /// Seed; the same seed gives the same samples on every machine
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// First part of each sample's name, <NAME>_Iter<i>_Sample<j>
    #[arg(long, default_value = "run")]
    name: String,
    /// Iteration number in the samples' names
    #[arg(long, value_name = "I", default_value_t = 1)]
    iteration: usize,
    /// Threads a run, written as !OMP_NUM_THREADS for yade-batch
    #[arg(long, value_name = "T")]
    threads: Option<NonZeroUsize>,
    /// Where the density that they were drawn from goes, for gl-filter --proposal
    #[arg(long, value_name = "FILE")]
    proposal_out: Option<PathBuf>,
    /// Table of weights; stdin when absent
    #[arg(value_name = "WEIGHTS", default_value = "-")]
    weights: PathBuf,
    /// Where the samples go; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const EXAMPLE: &str = "Example:
  gl-gmm-resample -p params.txt -n 20 --iteration 1 weights.txt -o samples.txt";

#[derive(Clone, Copy, ValueEnum)]
enum Shape {
    Full,
    Tied,
    #[value(alias = "diagonal")]
    Diag,
    Spherical,
}

#[derive(Clone, Copy, ValueEnum)]
enum SamplingName {
    Slice,
    Mixture,
}

fn run(args: &Args) -> Result<()> {
    gl_cli::distinct([args.output.as_ref(), args.proposal_out.as_ref()])?;
    ensure!(args.num > 0, "draw at least one sample");
    ensure!(args.components != Some(0), "--components: a mixture has at least one");
    ensure!(
        args.concentration.is_none_or(|c| c > 0.0 && c <= 1e6),
        "--concentration must be positive, and at most 1e6"
    );
    let prior = Prior::read(&args.params)?;
    let weights = Weights::read(&args.weights)?;
    let how = Resampling {
        count: args.num,
        components: args.components.unwrap_or_else(|| default_components(&weights)),
        covariance: match args.covariance {
            Shape::Full => CovarianceType::Full,
            Shape::Tied => CovarianceType::Tied,
            Shape::Diag => CovarianceType::Diagonal,
            Shape::Spherical => CovarianceType::Spherical,
        },
        concentration: args.concentration,
        sampling: match args.sampling {
            SamplingName::Mixture => Sampling::Mixture,
            SamplingName::Slice => Sampling::Slice { deviation: args.deviation },
        },
        seed: args.seed,
    };
    let names = sample_names(&args.name, args.iteration, args.num)?;
    let resampled = resample(&weights, &prior, &how)?;
    if resampled.was_widened {
        note("gl-gmm-resample", "the weight rests on very few samples; their neighbours were taken in");
    }
    if resampled.was_by_density {
        note(
            "gl-gmm-resample",
            "hardly any of the slice lies inside the bounds, so the samples were drawn by the mixture's density",
        );
    }
    if let Some(path) = &args.proposal_out {
        resampled.proposal.write(path)?;
    }
    Samples { source: "samples".to_owned(), names, parameters: prior.names(), values: resampled.values }
        .write(args.output.as_deref(), args.threads.map(NonZeroUsize::get))
}

/// As many components as the runs that hold the weight can show: three times d + 1 for each, with d
/// parameters, up to ten components.
fn default_components(weights: &Weights) -> usize {
    let ess_runs = effective_size(&weights.weight);
    let shown = ess_runs / (3 * (weights.varying() + 1)) as f64;
    (shown as usize).clamp(1, 10)
}

fn main() -> ExitCode {
    let args: Args = gl_cli::parse();
    gl_cli::finish("gl-gmm-resample", gl_cli::about(run(&args), [&args.weights, &args.params]))
}
