//! Draw the tables of a calibration and of a diagnosis, as SVG, PDF or PNG.

mod attribution;
mod branches;
mod emulator;
mod fit;
mod gap;
mod history;
mod hypotheses;
mod input;
mod pairs;
mod posterior;
mod predictive;
mod proposal;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::{Parser, Subcommand};
use gl_figure::{pdf, raster, svg};
use gl_table::Sink;

/// Draw the tables of a calibration and of a diagnosis, as SVG, PDF or PNG
#[derive(Parser)]
#[command(name = "gl-plot", version, after_help = EXAMPLE)]
struct Args {
    #[command(subcommand)]
    picture: Picture,
    #[command(flatten)]
    style: Style,
}

const EXAMPLE: &str = "\
Example:
  printf 'sample a weight\\nx 1 .2\\ny 2 .5\\nz 3 .3\\n' |
    gl-plot posterior -w - -o posterior.svg

gl-plot KIND --help has an example for each kind.";

#[derive(Subcommand)]
enum Picture {
    Fit(fit::Fit),
    Posterior(posterior::Posterior),
    Predictive(predictive::Predictive),
    Pairs(pairs::Pairs),
    History(history::History),
    Proposal(proposal::Proposal),
    Emulator(emulator::Emulator),
    Gap(gap::Gap),
    Attribution(attribution::Attribution),
    Hypotheses(hypotheses::Hypotheses),
}

/// What every picture has.
#[derive(clap::Args)]
pub struct Style {
    /// Picture to write, .svg, .pdf or .png; SVG to standard output when absent
    #[arg(short, long, value_name = "FILE", global = true)]
    output: Option<PathBuf>,
    /// Width of the picture in millimetres
    #[arg(long, value_name = "MM", default_value_t = 170.0, global = true, value_parser = width)]
    width: f64,
    /// Dots an inch of a PNG
    #[arg(long, value_name = "N", default_value_t = 200.0, global = true, value_parser = dpi)]
    dpi: f64,
}

fn width(text: &str) -> Result<f64> {
    within(text, 80.0, 1000.0)
}

fn dpi(text: &str) -> Result<f64> {
    within(text, 50.0, 1200.0)
}

fn within(text: &str, low: f64, high: f64) -> Result<f64> {
    let value = gl_table::parse_number(text)?;
    ensure!((low..=high).contains(&value), "not between {low} and {high}");
    Ok(value)
}

/// What a picture is written as.
enum Kind {
    Svg,
    Pdf,
    Png,
}

impl Kind {
    /// By the end of the file's name; standard output gets SVG.
    fn of(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else { return Ok(Self::Svg) };
        match path.extension().map(|end| end.to_string_lossy().to_lowercase()).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("pdf") => Ok(Self::Pdf),
            Some("png") => Ok(Self::Png),
            _ => anyhow::bail!("-o {}: a picture is called NAME.svg, NAME.pdf or NAME.png", path.display()),
        }
    }
}

fn run(args: &Args) -> Result<()> {
    let output = args.style.output.as_deref();
    let kind = Kind::of(output)?;
    let scene = match &args.picture {
        Picture::Fit(fit) => fit.draw(&args.style)?,
        Picture::Posterior(posterior) => posterior.draw(&args.style)?,
        Picture::Predictive(predictive) => predictive.draw(&args.style)?,
        Picture::Pairs(pairs) => pairs.draw(&args.style)?,
        Picture::History(history) => history.draw(&args.style)?,
        Picture::Proposal(proposal) => proposal.draw(&args.style)?,
        Picture::Emulator(emulator) => emulator.draw(&args.style)?,
        Picture::Gap(gap) => gap.draw(&args.style)?,
        Picture::Attribution(attribution) => attribution.draw(&args.style)?,
        Picture::Hypotheses(hypotheses) => hypotheses.draw(&args.style)?,
    };
    let bytes = match kind {
        Kind::Svg => svg::render(&scene).into_bytes(),
        Kind::Pdf => pdf::render(&scene)?,
        Kind::Png => raster::render(&scene, args.style.dpi)?,
    };
    let mut sink = Sink::create(output)?;
    let name = output.map_or("stdout".to_owned(), |path| path.display().to_string());
    sink.write_all(&bytes).with_context(|| format!("{name}: cannot be written"))?;
    sink.finish()
}

fn main() -> ExitCode {
    gl_cli::finish("gl-plot", run(&gl_cli::parse()))
}
