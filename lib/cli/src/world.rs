//! What the embedded simulators have in common on the command line.

use std::env;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use gl_inference::observations::ByName;
use gl_inference::samples::Samples;
use gl_inference::times::RunTime;
use gl_table::Table;
use gl_world::{self as world, World};

/// What becomes of runs that fail, for the end of `--help`.
pub const FAILED_RUNS: &str = "\
A parameter that the table lacks has its default; those of the effects are 0, and the effects then
absent. A run fails alone if its parameters make no sense: it is named on stderr, and has no files.
The exit code is 2 only if every run failed, or nothing could be run.";

/// What to run, and where it goes.
// A help text is no Markdown.
#[allow(rustdoc::invalid_html_tags)]
#[derive(Args)]
pub struct Shell {
    /// Table of samples: run each, unless its files are complete already
    #[arg(short, long, value_name = "FILE", requires = "dir")]
    #[arg(required_unless_present_any = ["curve", "inputs"])]
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
    /// Write the table of known parameters instead
    #[arg(long, conflicts_with = "samples")]
    inputs: bool,
    /// Where the curve or the table of parameters goes; stdout if absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Follow the control of this measurement
    #[arg(short = 'b', long, value_name = "FILE")]
    observations: Option<PathBuf>,
    /// Name of its control column, if not the simulator's own
    #[arg(short, long, value_name = "NAME", requires = "observations")]
    control: Option<String>,
}

impl Shell {
    /// The control values of the measurement to follow, shape (steps,), if there is one.
    ///
    /// * `control` — the simulator's own name of the control.
    ///
    /// # Errors
    /// If the measurement cannot be read or lacks the column.
    pub fn follow(&self, control: &str) -> Result<Option<Vec<f64>>> {
        let Some(file) = &self.observations else { return Ok(None) };
        let column = self.control.as_deref().unwrap_or(control);
        Ok(Some(Table::read(file)?.numbers(column)?))
    }

    /// What the steps come from, for messages: the measurement to follow, or the flag that says how far they go.
    pub fn origin(&self, flag: &str) -> String {
        self.observations.as_ref().map_or(flag.to_owned(), |path| gl_table::source_name(path))
    }

    /// Do what was asked for in this world; `tool` is named in messages.
    ///
    /// # Errors
    /// If the input is no good, or nothing could be run or written.
    pub fn run(&self, tool: &str, world: &dyn World) -> Result<()> {
        let output = self.output.as_deref();
        if self.inputs {
            return world::write_inputs(world, output);
        }
        if let Some(values) = &self.curve {
            let noise = self.noise.clone().unwrap_or_default();
            let written = world::write_curve(world, values, &noise, self.seed, output);
            return crate::about(written, [&PathBuf::from("--curve")]);
        }
        let (Some(samples), Some(dir)) = (&self.samples, &self.dir) else {
            bail!("name a table of samples with -s, and a folder for the runs");
        };
        let report = world::run_samples(world, &Samples::from_table(&Table::read(samples)?)?, dir)?;
        for message in report.messages() {
            crate::note(tool, message);
        }
        if let Some(times) = env::var_os("GL_TIMES").filter(|path| !path.is_empty()) {
            RunTime::add(Path::new(&times), report.times)?;
        }
        Ok(())
    }
}
