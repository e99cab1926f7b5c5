//! The tables of the page on accuracy, as Markdown, from the folders of `make withheld`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::bench;
use super::condition::Condition;
use super::score::{
    Scored, Share, calibration_error, calibration_error_by_chance, of_effects, of_first_rows,
    parameter_coverage, read, shrink_coverage,
};

/// The cases of a world under a condition.
struct Lot {
    world: &'static str,
    condition: &'static str,
    cases: Vec<Scored>,
}

impl Lot {
    /// Those of a folder whose name begins as `WORLD-CONDITION-`.
    fn read(dir: &Path) -> Result<Self> {
        let name = dir.file_name().context("a folder without a name")?.to_string_lossy();
        let pairs =
            bench::NAMES.iter().flat_map(|world| Condition::NAMES.iter().map(move |of| (*world, *of)));
        let found =
            pairs.into_iter().find(|(world, condition)| name.starts_with(&format!("{world}-{condition}-")));
        let (world, condition) =
            found.with_context(|| format!("{name}: its name does not begin with WORLD-CONDITION-"))?;
        Ok(Self { world, condition, cases: read(dir)? })
    }
}

fn is_single(case: &Scored) -> bool {
    case.is_of_one() && case.visibility >= 1.0
}

/// `12 of 14`, with the share where there are enough of them for one; `-` of none.
fn told(share: Share) -> String {
    match share {
        Share { all: 0, .. } => "-".to_owned(),
        Share { of, all } if all >= 30 => format!("{of} of {all}, {:.0} %", 100.0 * share.value()),
        Share { of, all } => format!("{of} of {all}"),
    }
}

/// How many of the chosen are so.
fn share<'a>(
    cases: impl IntoIterator<Item = &'a Scored>,
    choose: impl Fn(&Scored) -> bool,
    so: impl Fn(&Scored) -> bool,
) -> Share {
    Share::count(cases.into_iter().filter(|case| choose(case)), so)
}

/// Everything, for each world and all of them; by condition; and the single effects, the measurements without one and those of no
/// candidate that are lost, and what is wrong above 0.9.
///
/// # Errors
/// If a folder has another name, or lacks a table.
pub fn page(dirs: &[PathBuf]) -> Result<String> {
    let lots = dirs.iter().map(|dir| Lot::read(dir)).collect::<Result<Vec<_>>>()?;
    let mut page = String::new();
    in_short(&lots, &mut page)?;
    by_condition(&lots, &mut page)?;
    intervals(&lots, &mut page)?;
    lost(&lots, &mut page)?;
    Ok(page)
}

fn in_short(lots: &[Lot], page: &mut String) -> Result<()> {
    let worlds: Vec<&str> =
        bench::NAMES.into_iter().filter(|world| lots.iter().any(|lot| lot.world == *world)).collect();
    let of = |world: Option<&str>| -> Vec<&Scored> {
        let meant = lots.iter().filter(|lot| world.is_none_or(|world| lot.world == world));
        meant.flat_map(|lot| &lot.cases).collect()
    };
    let columns: Vec<Vec<&Scored>> = worlds.iter().map(|world| of(Some(world))).chain([of(None)]).collect();
    writeln!(page, "| | {} | all |\n| --- |{}", worlds.join(" | "), " --- |".repeat(columns.len()))?;
    let mut row = |name: &str, cell: &dyn Fn(&[&Scored]) -> String| {
        let cells: Vec<String> = columns.iter().map(|cases| cell(cases)).collect();
        writeln!(page, "| {name} | {} |", cells.join(" | "))
    };
    let right = |choose: fn(&Scored) -> bool| {
        move |cases: &[&Scored]| told(share(cases.iter().copied(), choose, Scored::is_right))
    };
    row("one effect, visibility ≥ 1: right", &right(is_single))?;
    let closes_half = |case: &Scored| is_single(case) && case.is_within() && case.shrink >= 0.5;
    row(
        "the same where the gap closes by half or more with it, and all is within bounds",
        &right(closes_half),
    )?;
    row("a base parameter outside its prior: right", &right(|case| is_single(case) && case.is_outside))?;
    row("no candidate, ≥ 2: `unexplained`, or closes less than half", &right(Scored::is_seen_without))?;
    row("none: right", &right(Scored::is_of_none))?;
    row("a wrong effect above 0.9", &|cases| {
        let Share { of, all } = share(cases.iter().copied(), |_| true, Scored::is_confidently_wrong);
        format!("{of} of {all}")
    })?;
    row("settled, and of these right", &right(|case| case.is_settled))?;
    row("predicted shrink: the 90 % interval held", &|cases| told(shrink_coverage(cases.iter().copied())))?;
    row("the same where the gap does not close by all but a hundredth", &|cases| {
        told(shrink_coverage(cases.iter().copied().filter(|case| !case.closes_all())))
    })?;
    row("calibration error of the first row (by chance)", &|cases| {
        let statements = of_first_rows(cases.iter().copied());
        format!("{:.3} ({:.3})", calibration_error(&statements), calibration_error_by_chance(&statements))
    })?;
    row("of every candidate effect (by chance)", &|of| {
        let statements = of_effects(of.iter().copied());
        format!("{:.3} ({:.3})", calibration_error(&statements), calibration_error_by_chance(&statements))
    })?;
    row("runs of a case, in the mean", &|cases| {
        format!("{:.0}", cases.iter().map(|case| case.runs).sum::<f64>() / cases.len() as f64)
    })?;
    row("the box was made wider", &|cases| {
        told(share(cases.iter().copied(), |_| true, |case| case.is_widened))
    })?;
    writeln!(page)?;
    Ok(())
}

fn by_condition(lots: &[Lot], page: &mut String) -> Result<()> {
    writeln!(
        page,
        "| condition | one effect, ≥ 1: contact | triaxial | `unexplained` or `none` first | another first, or a passenger | \
         two, both ≥ 0.5 | none | no candidate, ≥ 2 | wrong above 0.9 | predicted shrink held |\n|{}",
        " --- |".repeat(10)
    )?;
    for condition in Condition::NAMES {
        let own: Vec<&Lot> = lots.iter().filter(|lot| lot.condition == condition).collect();
        if own.is_empty() {
            continue;
        }
        let all = || own.iter().flat_map(|lot| &lot.cases);
        let of =
            |world: &'static str| own.iter().filter(move |lot| lot.world == world).flat_map(|lot| &lot.cases);
        let says_none = |case: &Scored| matches!(case.first.as_str(), "none" | "unexplained");
        let cells = [
            told(share(of("contact"), is_single, Scored::is_right)),
            told(share(of("triaxial"), is_single, Scored::is_right)),
            share(all(), is_single, |case| !case.is_right() && says_none(case)).of.to_string(),
            share(all(), is_single, |case| !case.is_right() && !says_none(case)).of.to_string(),
            told(share(all(), |case| case.is_of_several() && case.least >= 0.5, Scored::is_right)),
            told(share(all(), Scored::is_of_none, Scored::is_right)),
            told(share(all(), Scored::is_seen_without, Scored::is_right)),
            share(all(), |_| true, Scored::is_confidently_wrong).of.to_string(),
            told(shrink_coverage(all())),
        ];
        writeln!(page, "| {} | {} |", Condition::named(condition)?.told(), cells.join(" | "))?;
    }
    writeln!(page)?;
    Ok(())
}

fn intervals(lots: &[Lot], page: &mut String) -> Result<()> {
    writeln!(page, "| 90 % intervals that held | without a rest | beside one |\n| --- | --- | --- |")?;
    let mut row = |name: &str, is_meant: &dyn Fn(&Lot) -> bool| {
        let all = || lots.iter().filter(|lot| is_meant(lot)).flat_map(|lot| &lot.cases);
        let [without, beside] = [false, true].map(|beside| told(parameter_coverage(all(), beside)));
        if (without.as_str(), beside.as_str()) == ("-", "-") {
            return Ok(());
        }
        writeln!(page, "| {name} | {without} | {beside} |")
    };
    for condition in Condition::NAMES {
        row(&Condition::named(condition)?.told(), &|lot| lot.condition == condition)?;
    }
    row("all", &|_| true)?;
    writeln!(page)?;
    Ok(())
}

fn lost(lots: &[Lot], page: &mut String) -> Result<()> {
    for Lot { world, condition, cases } in lots {
        let is_asked = |case: &&Scored| is_single(case) || case.is_of_none() || case.is_seen_without();
        let is_lost = |case: &&Scored| is_asked(case) && !case.is_right();
        for case in cases.iter().filter(|case| is_lost(case) || case.is_confidently_wrong()) {
            let withheld = if case.withheld { " (no candidate)" } else { "" };
            let settled = if case.is_settled { ", settled" } else { "" };
            let (truth, seen) = (&case.truth, case.visibility);
            let shrinks = if case.is_of_none() {
                String::new()
            } else {
                format!(", with which the gap closes by {:.2}", case.shrink)
            };
            writeln!(
                page,
                "- {world}, {condition}, {}: {truth}{withheld} of {seen:.1}{shrinks}; {} first ({:.2}{settled}){}",
                case.case,
                case.first,
                case.probability,
                if case.is_near() { ", named as one that cannot be told from it" } else { "" }
            )?;
        }
    }
    Ok(())
}
