//! Draw, diagnose and score the withheld check.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};
use gl::table::TableWriter;
use pipelines::withheld::bench::Bench;
use pipelines::withheld::score::{
    Scored, Share, calibration_error, of_effects, of_first_rows, read, reliability, shrink_coverage,
};
use pipelines::withheld::{diagnose, generate};

/// How often the diagnosis is right, on measurements whose effect it is not told
#[derive(Parser)]
#[command(name = "withheld", version)]
struct Args {
    #[command(subcommand)]
    step: Step,
}

#[derive(Subcommand)]
enum Step {
    /// Draw cases: measurements into DIR/cases, answers into DIR/sealed
    Generate {
        /// World that they come from
        world: String,
        /// Where they go
        dir: PathBuf,
        /// Number of cases
        #[arg(short, long, default_value_t = 200)]
        num: usize,
        /// Seed of the cases
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Diagnose DIR/cases into DIR/verdicts.tsv
    Diagnose {
        /// World that they come from
        world: String,
        /// Where the cases are
        dir: PathBuf,
        /// Runs of the design, an input
        #[arg(long, default_value_t = 25)]
        runs: usize,
        /// Seed of the design
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Hold DIR/verdicts.tsv against DIR/sealed/answers.tsv
    Score {
        /// Where they are
        dir: PathBuf,
    },
}

fn run(args: &Args) -> Result<()> {
    match &args.step {
        Step::Generate { world, dir, num, seed } => {
            generate::generate(&Bench::named(world)?, *num, *seed, dir)
        }
        Step::Diagnose { world, dir, runs, seed } => {
            diagnose::diagnose(&Bench::named(world)?, *runs, *seed, dir)
        }
        Step::Score { dir } => score(&read(dir)?),
    }
}

fn score(cases: &[Scored]) -> Result<()> {
    let mut table = TableWriter::create(
        None,
        &["what", "cases", "right", "wrong_effect", "withheld_judgement", "wrong_above_0.9"],
    )?;
    let single = |case: &Scored| !case.withheld && case.truth != "none" && !case.truth.contains('+');
    type Choice<'a> = (String, Box<dyn Fn(&Scored) -> bool + 'a>);
    let mut choices: Vec<Choice<'_>> = vec![
        ("none".to_owned(), Box::new(|case: &Scored| case.truth == "none")),
        ("one, visibility >= 1".to_owned(), Box::new(move |c: &Scored| single(c) && c.visibility >= 1.0)),
        (
            "one, 0.5 to 1".to_owned(),
            Box::new(move |c: &Scored| single(c) && (0.5..1.0).contains(&c.visibility)),
        ),
        ("one, below 0.5".to_owned(), Box::new(move |c: &Scored| single(c) && c.visibility < 0.5)),
        ("two, both >= 1".to_owned(), Box::new(|c: &Scored| c.truth.contains('+') && c.least >= 1.0)),
        (
            "two, both 0.5 to 1".to_owned(),
            Box::new(|c: &Scored| c.truth.contains('+') && (0.5..1.0).contains(&c.least)),
        ),
        ("two, one below 0.5".to_owned(), Box::new(|c: &Scored| c.truth.contains('+') && c.least < 0.5)),
        ("no candidate, >= 2".to_owned(), Box::new(|c: &Scored| c.withheld && c.visibility >= 2.0)),
        (
            "no candidate, 1 to 2".to_owned(),
            Box::new(|c: &Scored| c.withheld && (1.0..2.0).contains(&c.visibility)),
        ),
        ("no candidate, below 1".to_owned(), Box::new(|c: &Scored| c.withheld && c.visibility < 1.0)),
    ];
    let mut names: Vec<String> =
        cases.iter().filter(|c| single(c) || c.withheld).map(|c| c.truth.clone()).collect();
    names.sort();
    names.dedup();
    for name in names {
        let own = name.clone();
        choices.push((
            format!("{name}, >= 1"),
            Box::new(move |c: &Scored| single(c) && c.truth == own && c.visibility >= 1.0),
        ));
        let own = name.clone();
        choices.push((
            format!("{name} no candidate, >= 2"),
            Box::new(move |c: &Scored| c.withheld && c.truth == own && c.visibility >= 2.0),
        ));
    }
    for (name, choose) in &choices {
        let chosen: Vec<&Scored> = cases.iter().filter(|case| choose(case)).collect();
        let share = |so: &dyn Fn(&Scored) -> bool| Share::count(chosen.iter().copied(), so).of as f64;
        table.text(name).number(chosen.len() as f64).number(share(&Scored::is_right));
        table.number(share(&Scored::names_wrong));
        table.number(share(&|case| !case.is_right() && !case.names_wrong()));
        table.number(share(&|case| case.names_wrong() && case.probability > 0.9)).end_row()?;
    }
    let so = shrink_coverage(cases);
    table.text("predicted shrink holds").number(so.all as f64).number(so.of as f64);
    table.text("-").text("-").text("-").end_row()?;
    let is_seen = |case: &&Scored| {
        case.truth == "none" || if case.truth.contains('+') { case.least } else { case.visibility } >= 0.5
    };
    let statements = [
        ("first rows", of_first_rows(cases.iter())),
        ("first rows, none or all effects visible from 0.5", of_first_rows(cases.iter().filter(is_seen))),
        ("every candidate effect", of_effects(cases)),
    ];
    for (name, statements) in &statements {
        table.text(&format!("{name}: calibration error {:.3}", calibration_error(statements)));
        table.number(statements.len() as f64).text("-").text("-").text("-").text("-").end_row()?;
        for (stated, came) in reliability(statements) {
            table.text(&format!("{name}: stated {stated:.2}")).number(came.all as f64).number(came.of as f64);
            table.text("-").text("-").text("-").end_row()?;
        }
    }
    table.finish()
}

fn main() -> ExitCode {
    gl::cli::finish("withheld", run(&Args::parse()))
}
