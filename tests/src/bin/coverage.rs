//! How well the loop through an emulator is calibrated, and how many runs it takes.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use gl_table::TableWriter;
use pipelines::coverage::looped::{Outcome, export, repeated, replicate};
use pipelines::coverage::problem::{PROBLEMS, Problem};
use rayon::prelude::*;

/// Calibrate truths drawn from the prior until the loop stops, and compare with the true posterior
#[derive(Parser)]
#[command(name = "coverage", version)]
struct Args {
    /// Problems; all by default
    problems: Vec<String>,
    /// Replicates of each
    #[arg(short, long, default_value_t = 30)]
    num: u64,
    /// Seed of the first replicate
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Compare the true posterior with itself by other seeds instead
    #[arg(long)]
    repeat: bool,
    /// Write the measurements and the true posteriors to this folder instead, for other programs
    #[arg(long)]
    export: Option<PathBuf>,
    /// Say what happens at every batch
    #[arg(long)]
    verbose: bool,
}

fn run(args: &Args) -> Result<()> {
    let problems = if args.problems.is_empty() {
        PROBLEMS.to_vec()
    } else {
        args.problems.iter().map(|name| Problem::named(name)).collect::<Result<_>>()?
    };
    if let Some(folder) = &args.export {
        std::fs::create_dir_all(folder)?;
        for problem in &problems {
            for i in 0..args.num {
                export(problem, 1_000_003 * (args.seed + i), &folder.join(format!("{}-{i}", problem.name)))?;
            }
        }
        return Ok(());
    }
    if args.repeat {
        return repeat(&problems, args);
    }
    let columns = [
        "problem",
        "replicates",
        "runs",
        "runs_most",
        "unsettled",
        "unfit",
        "coverage90",
        "coverage90_exact",
        "sd_ratio",
        "sd_ratio_10",
        "sd_ratio_90",
        "sd_ratio_least",
        "shift",
        "shift_90",
        "correlated",
        "inflated",
        "mode_kept",
    ];
    let mut table = TableWriter::create(None, &columns)?;
    for problem in &problems {
        let outcomes: Vec<Outcome> = (0..args.num)
            .into_par_iter()
            .map(|i| replicate(problem, 1_000_003 * (args.seed + i), args.verbose))
            .collect::<Result<_>>()?;
        let of = |values: Vec<f64>, p: f64| {
            let mut values = values;
            values.sort_by(f64::total_cmp);
            values[((values.len() - 1) as f64 * p).round() as usize]
        };
        let share = |is: &dyn Fn(&Outcome) -> bool| {
            outcomes.iter().filter(|outcome| is(outcome)).count() as f64 / outcomes.len() as f64
        };
        let runs = || outcomes.iter().map(|o| o.runs as f64).collect::<Vec<_>>();
        let ratios = || outcomes.iter().flat_map(|o| o.ratio.clone()).collect::<Vec<_>>();
        let shifts = || outcomes.iter().flat_map(|o| o.shift.iter().map(|s| s.abs())).collect::<Vec<_>>();
        let held = |of: &dyn Fn(&Outcome) -> &Vec<bool>| {
            let holds: Vec<bool> = outcomes.iter().flat_map(|o| of(o).clone()).collect();
            holds.iter().filter(|h| **h).count() as f64 / holds.len() as f64
        };
        let modes: Vec<&Outcome> = outcomes.iter().filter(|o| o.lesser.1 > 0.1).collect();
        let kept = modes.iter().filter(|o| o.lesser.0 > 0.3 * o.lesser.1).count() as f64;
        table.text(problem.name).number(args.num as f64);
        table.numbers(&[
            of(runs(), 0.5),
            of(runs(), 1.0),
            share(&|o| !o.is_settled),
            share(&|o| o.is_unfit),
            held(&|o| &o.holds),
            held(&|o| &o.holds_exact),
        ]);
        table.numbers(&[of(ratios(), 0.5), of(ratios(), 0.1), of(ratios(), 0.9), of(ratios(), 0.0)]);
        table.numbers(&[of(shifts(), 0.5), of(shifts(), 0.9)]);
        table.numbers(&[share(&|o| o.is_correlated), share(&|o| o.is_inflated)]);
        table.number(if modes.is_empty() { 1.0 } else { kept / modes.len() as f64 });
        table.end_row()?;
    }
    table.finish()
}

/// Largest shift of a mean and smallest and largest ratio of a standard deviation from one seed to another.
fn repeat(problems: &[Problem], args: &Args) -> Result<()> {
    let mut table =
        TableWriter::create(None, &["problem", "replicate", "shift", "ratio_least", "ratio_most"])?;
    for problem in problems {
        for i in 0..args.num {
            let (shift, least, most) = repeated(problem, 1_000_003 * (args.seed + i))?;
            table.text(problem.name).number(i as f64).numbers(&[shift, least, most]).end_row()?;
        }
    }
    table.finish()
}

fn main() -> ExitCode {
    gl_cli::finish("coverage", run(&gl_cli::parse()))
}
