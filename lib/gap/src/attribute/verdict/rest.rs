//! Something unknown, beside effects or alone: where it is, and what it goes with.

use anyhow::Result;
use gl_table::verdict::Verdicts;

use super::noise::all_of;
use super::percent;
use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::rest::{GoesWith, Jump, goes_with, jumps, rest};
use crate::attribute::problem::Problem;
use gl_inference::path::short;

/// What a rest goes with, if it clearly goes with something, and what else it goes with nearly as well.
pub(super) fn add(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) -> Result<()> {
    /// Share of its square from which something is worth naming.
    const CLEARLY: f64 = 0.4;
    /// From this share of the largest on, two cannot be told apart.
    const NEARLY: f64 = 0.85;
    if !first.has_rest {
        return Ok(());
    }
    add_observables(verdicts, problem, first);
    let all = goes_with(problem, first)?;
    if let Some(most) = all.first().filter(|most| most.share >= CLEARLY) {
        let name = &problem.observables[most.observable];
        let mut text = format!(
            "what is left of {name} goes with {} ({} % of it), as {} would",
            most.what,
            percent(most.share),
            most.like
        );
        let is_near = |other: &&GoesWith| {
            other.observable == most.observable
                && other.share > NEARLY * most.share
                && other.like != most.like
        };
        for other in all[1..].iter().filter(is_near) {
            text += &format!(
                "; and nearly as well with {} ({} %), as {} would",
                other.what,
                percent(other.share),
                other.like
            );
        }
        verdicts.add("rest-goes-with", &most.what, text);
    }
    add_jumps(verdicts, problem, first);
    Ok(())
}

/// In which of several observables a rest is, and which are fitted to noise; of something unknown alone also on which stretch.
fn add_observables(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) {
    let Some(rest) = rest(problem, first).filter(|_| problem.observables.len() > 1) else { return };
    let (observable, stretch) = rest.place(problem);
    let mostly = first.is_unknown().then(|| problem.told(observable, &stretch));
    if let Some(text) = heights_told(&problem.observables, &rest.heights(problem), mostly) {
        verdicts.add("rest-in", &problem.observables[observable], text);
    }
}

/// How high a rest is in each observable, in standard deviations of noise and scatter, the highest first; none where nothing is
/// left to speak of.
fn heights_told(observables: &[String], heights: &[f64], mostly: Option<String>) -> Option<String> {
    /// Below it an observable is fitted.
    const FITTED: f64 = 0.5;
    let mut all: Vec<(&String, f64)> = observables.iter().zip(heights.iter().copied()).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (left, fitted) = all.split_at(all.partition_point(|(_, height)| *height >= FITTED));
    if left.is_empty() {
        return None;
    }
    let told = |(place, (name, height)): (usize, &(&String, f64))| {
        let what = if place == 0 { "times noise and scatter" } else { "times" };
        format!("{height:.1} {what} in {name}")
    };
    let mut text =
        format!("what is left is {}", all_of(&left.iter().enumerate().map(told).collect::<Vec<_>>()));
    if let Some(mostly) = mostly {
        text += &format!(", most of it in {mostly}");
    }
    let fitted: Vec<String> = fitted.iter().map(|(name, _)| (*name).clone()).collect();
    match fitted.len() {
        0 => (),
        1 => text += &format!("; {} is fitted", fitted[0]),
        _ => text += &format!("; {} are fitted", all_of(&fitted)),
    }
    Some(text)
}

/// Where a rest jumps, and how far: a row an observable. Jumps of a sign at neighbouring readings are one: a slope that is too
/// steep for a smooth rest.
fn add_jumps(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) {
    let all = jumps(problem, first);
    let is_one = |a: &Jump, b: &Jump| {
        let is_near = problem.observable_of(a.reading) == problem.observable_of(b.reading);
        is_near && b.reading == a.reading + 1 && a.size * b.size > 0.0
    };
    let whole: Vec<&[Jump]> = all.chunk_by(is_one).collect();
    let observable_of = |of: &[Jump]| problem.observable_of(of[0].reading);
    for of in whole.chunk_by(|a, b| observable_of(a) == observable_of(b)) {
        let observable = observable_of(of[0]);
        let told = |jump: &&[Jump]| {
            let size = jump.iter().map(|jump| jump.size).sum();
            let first = jump[0].reading - problem.own(observable).start;
            let steps = first - 1..first + jump.len();
            format!(
                "by {}{} {}",
                short(size),
                problem.told_unit(observable),
                problem.told_steps(observable, &steps)
            )
        };
        let name = &problem.observables[observable];
        let where_to = all_of(&of.iter().map(told).collect::<Vec<_>>());
        verdicts.add("rest-jumps", name, format!("what is left of {name} jumps {where_to}"));
    }
}

/// Where most of a rest is: the observable and the stretch of the control, with a comma before.
pub(super) fn places(problem: &Problem<'_>, of: &Explanation) -> String {
    rest(problem, of).map_or_else(String::new, |rest| {
        let (observable, stretch) = rest.place(problem);
        format!(", in {}", problem.told(observable, &stretch))
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn where_a_rest_is_is_told_of_several_observables_the_largest_first() {
        let names = ["low.z", "high.a", "push.F"].map(str::to_owned);
        let told = |heights: [f64; 3], mostly: Option<&str>| {
            heights_told(&names, &heights, mostly.map(str::to_owned))
        };
        let text = "what is left is 14.2 times noise and scatter in high.a, most of it in high.a at t 0 s; push.F and low.z are fitted";
        assert_eq!(told([0.1, 14.2, 0.4], Some("high.a at t 0 s")).unwrap(), text);
        let text = "what is left is 2.0 times noise and scatter in push.F, 1.5 times in low.z and 0.6 times in high.a";
        assert_eq!(told([1.5, 0.6, 2.0], None).unwrap(), text);
        let text =
            "what is left is 2.0 times noise and scatter in low.z and 1.0 times in high.a; push.F is fitted";
        assert_eq!(told([2.0, 1.0, 0.0], None).unwrap(), text);
        assert_eq!(told([0.1, 0.2, 0.3], None), None);
    }

    #[test]
    fn a_rest_is_as_high_as_what_is_left_in_units_of_the_noise() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
        observations.values[0].iter_mut().skip(17).for_each(|y| *y += 0.2);
        let problem = predictor.problem(&prior, &observations);
        let diagnosis = diagnose(&problem, 1, 1).unwrap();
        let rest = rest(&problem, diagnosis.first()).unwrap();
        let square: f64 = rest.curve.iter().map(|y| (y / rest.spread[0]).powi(2)).sum();
        let [height] = rest.heights(&problem)[..] else { panic!("one observable") };
        assert!((height - (square / 30.0).sqrt()).abs() < 1e-12 && height > 3.0, "{height}");
    }

    #[test]
    fn a_jump_of_what_is_left_is_told_where_it_is_and_how_far_it_goes() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
        observations.values[0].iter_mut().skip(17).for_each(|y| *y += 0.2);
        let units = "x=mm,y=N".parse().unwrap();
        let problem = predictor.problem(&prior, &observations).in_units(&units);
        let diagnosis = diagnose(&problem, 1, 1).unwrap();
        let mut verdicts = Verdicts::default();
        add(&mut verdicts, &problem, diagnosis.first()).unwrap();
        let told = verdicts.rows.iter().find(|row| row.code == "rest-jumps").unwrap();
        assert_eq!(told.value, "y");
        let before = "what is left of y jumps by 0.";
        let (by, at) = told.text.strip_prefix(before).and_then(|by| by.split_once(" N ")).unwrap();
        assert!(["1", "2"].contains(&&by[..1]), "{}", told.text);
        assert_eq!(at, "between x 0.552 and 0.586 mm");
    }
}
