//! Draw, diagnose and score the withheld check.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};
use gl_table::TableWriter;
use pipelines::withheld::bench::Bench;
use pipelines::withheld::condition::Condition;
use pipelines::withheld::diagnose::How;
use pipelines::withheld::generate::Which;
use pipelines::withheld::page::page;
use pipelines::withheld::score::{
    Scored, Share, calibration_error, calibration_error_by_chance, of_effects, of_first_rows,
    parameter_coverage, read, reliability, shrink_coverage,
};
use pipelines::withheld::{diagnose, generate, weigh};

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
        /// What is otherwise than assumed
        #[arg(long, default_value = "as-stated")]
        condition: String,
        /// Of so many cases those alone in which an effect is at work that is no candidate
        #[arg(long)]
        no_candidate: bool,
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
        /// What is otherwise than assumed, as far as it concerns the design
        #[arg(long, default_value = "as-stated")]
        condition: String,
        /// Runs of the design, an input
        #[arg(long, default_value_t = 25)]
        runs: usize,
        /// Make them all at once, and none where the first ones ask for them
        #[arg(long)]
        one_round: bool,
        /// Predict with the world itself, not with an emulator: the best that any emulator could do
        #[arg(long)]
        exact: bool,
        /// Seed of the design
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Weigh DIR/hypotheses.tsv by the present rules into DIR/verdicts.tsv, without runs: what comes first, and the effects
    Weigh {
        /// Where they are
        #[arg(required = true)]
        dirs: Vec<PathBuf>,
    },
    /// The tables of the page on accuracy, from folders named WORLD-CONDITION-…, as make withheld names them
    Page {
        /// Where they are
        #[arg(required = true)]
        dirs: Vec<PathBuf>,
    },
    /// Hold DIR/verdicts.tsv against DIR/sealed/answers.tsv, those of several folders together
    Score {
        /// Where they are
        #[arg(required = true)]
        dirs: Vec<PathBuf>,
    },
}

fn run(args: &Args) -> Result<()> {
    match &args.step {
        Step::Generate { world, dir, num, condition, no_candidate, seed } => {
            let condition = Condition::named(condition)?;
            let which = Which { count: *num, no_candidate: *no_candidate, seed: *seed };
            generate::generate(&Bench::under(world, condition)?, condition, which, dir)
        }
        Step::Diagnose { world, dir, condition, runs, one_round, exact, seed } => {
            let how = How { runs: *runs, in_rounds: !one_round, exact: *exact, seed: *seed };
            diagnose::diagnose(&Bench::under(world, Condition::named(condition)?)?, how, dir)
        }
        Step::Page { dirs } => Ok(std::io::stdout().write_all(page(dirs)?.as_bytes())?),
        Step::Weigh { dirs } => dirs.iter().try_for_each(|dir| weigh::weigh(dir)),
        Step::Score { dirs } => {
            let cases = dirs.iter().map(|dir| read(dir)).collect::<Result<Vec<_>>>()?;
            score(&cases.concat())
        }
    }
}

/// A row of the table, and which cases it counts.
type Group = (&'static str, fn(&Scored) -> bool);

/// Groups of cases by what is behind them and how visible it is.
const GROUPS: [Group; 13] = [
    ("none", Scored::is_of_none),
    ("one, visibility >= 1", |case| case.is_of_one() && case.visibility >= 1.0),
    ("one, 0.5 to 1", |case| case.is_of_one() && (0.5..1.0).contains(&case.visibility)),
    ("one, below 0.5", |case| case.is_of_one() && case.visibility < 0.5),
    ("two, both >= 1", |case| case.is_of_several() && case.least >= 1.0),
    ("two, both 0.5 to 1", |case| case.is_of_several() && (0.5..1.0).contains(&case.least)),
    ("two, one below 0.5", |case| case.is_of_several() && case.least < 0.5),
    ("no candidate, >= 2", Scored::is_seen_without),
    ("no candidate, >= 2, beside any other >= 1", |case| case.is_seen_without() && case.imitated >= 1.0),
    ("no candidate, >= 2, imitated by another", |case| case.is_seen_without() && case.imitated < 1.0),
    ("no candidate, >= 2, beside two others and beyond the prior >= 1", |case| {
        case.is_seen_without() && case.considered >= 1.0
    }),
    ("no candidate, 1 to 2", |case| case.withheld && (1.0..2.0).contains(&case.visibility)),
    ("no candidate, below 1", |case| case.withheld && case.visibility < 1.0),
];

fn score(cases: &[Scored]) -> Result<()> {
    let columns =
        ["what", "cases", "right", "confounded", "wrong_effect", "withheld_judgement", "wrong_above_0.9"];
    let mut table = TableWriter::create(None, &columns)?;
    let mut row = |name: &str, choose: &dyn Fn(&Scored) -> bool| -> Result<()> {
        let chosen: Vec<&Scored> = cases.iter().filter(|case| choose(case)).collect();
        if chosen.is_empty() {
            return Ok(());
        }
        let share = |so: &dyn Fn(&Scored) -> bool| Share::count(chosen.iter().copied(), so).of as f64;
        let is_wrong = |case: &Scored| case.names_wrong() && !case.is_near();
        table.text(name).number(chosen.len() as f64).number(share(&Scored::is_right));
        table.number(share(&Scored::is_near)).number(share(&is_wrong));
        table.number(share(&|case| !case.is_right() && !case.is_near() && !case.names_wrong()));
        table.number(share(&Scored::is_confidently_wrong)).end_row()
    };
    for family in ["Plain", "Scatter", "Rig"] {
        for (group, choose) in GROUPS {
            row(&format!("{}: {group}", family.to_lowercase()), &|case| {
                case.family == family && choose(case)
            })?;
        }
    }
    for (group, choose) in GROUPS {
        row(&format!("all: {group}"), &choose)?;
    }
    let mut names: Vec<&str> =
        cases.iter().filter(|c| c.is_of_one() || c.withheld).map(|c| c.truth.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        row(&format!("{name}, >= 1"), &|c| c.is_of_one() && c.truth == name && c.visibility >= 1.0)?;
        row(&format!("{name} no candidate, >= 2"), &|c| c.is_seen_without() && c.truth == name)?;
    }
    let mut count = |name: &str, share: Share| -> Result<()> {
        table.text(name).number(share.all as f64).number(share.of as f64);
        table.text("-").text("-").text("-").text("-").end_row()
    };
    let none = cases.iter().filter(|case| case.is_of_none());
    count(
        "none: a wrong effect above 0.5",
        Share::count(none, |case| case.names_wrong() && case.probability > 0.5),
    )?;
    let wrong = |case: &&Scored| case.is_confidently_wrong();
    count(
        "all: wrong above 0.9, of them without a warning",
        Share {
            all: cases.iter().filter(wrong).count(),
            of: cases.iter().filter(wrong).filter(|case| !case.is_warned()).count(),
        },
    )?;
    let is_settled = |case: &&Scored| case.is_settled;
    let settled = || cases.iter().filter(is_settled);
    count("all: settled, of them right", Share::count(settled(), Scored::is_right))?;
    count("all: settled, of them a wrong effect", Share::count(settled(), Scored::names_wrong))?;
    count("all: said to lean on a bound", Share::count(cases.iter(), Scored::is_warned))?;
    for family in ["Plain", "Scatter", "Rig"] {
        let of = cases.iter().filter(|case| case.family == family);
        count(&format!("{}: predicted shrink holds", family.to_lowercase()), shrink_coverage(of))?;
    }
    count("all: predicted shrink holds", shrink_coverage(cases.iter()))?;
    let may_miss = cases.iter().filter(|case| !case.closes_all());
    count("all: predicted shrink holds, more than a hundredth left", shrink_coverage(may_miss))?;
    count("all: interval of a parameter holds", parameter_coverage(cases.iter(), false))?;
    count("all: interval of a parameter holds, beside a rest", parameter_coverage(cases.iter(), true))?;
    let is_seen = |case: &&Scored| {
        case.is_of_none() || if case.truth.contains('+') { case.least } else { case.visibility } >= 0.5
    };
    let statements = [
        ("first rows", of_first_rows(cases.iter())),
        ("first rows, none or all effects visible from 0.5", of_first_rows(cases.iter().filter(is_seen))),
        ("every candidate effect", of_effects(cases.iter())),
    ];
    for (name, statements) in &statements {
        let error = calibration_error(statements);
        let chance = calibration_error_by_chance(statements);
        let title = format!("{name}: calibration error {error:.3}, by chance {chance:.3}");
        count(&title, Share { of: 0, all: statements.len() })?;
        for (stated, came) in reliability(statements) {
            count(&format!("{name}: stated {stated:.2}"), came)?;
        }
    }
    table.finish()
}

fn main() -> ExitCode {
    gl_cli::finish("withheld", run(&Args::parse()))
}
