//! A diagnosis in a few sentences that a user can act on, each with a code that a program can.

use anyhow::Result;

use crate::attribute::attribution::confounding::difference;
use crate::attribute::attribution::forecast::{Effort, effort};
use crate::attribute::attribution::lean::Lean;
use crate::attribute::attribution::marginals::{Marginal, marginals};
use crate::attribute::attribution::rest::{GoesWith, goes_with};
use crate::attribute::attribution::told::{Told, told};
use crate::attribute::attribution::untried::Untried;
use crate::attribute::attribution::{Attribution, Explanation, RuledOut, UNEXPLAINED};
use crate::attribute::diagnosis::{Diagnosis, shrink};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Candidate, is_part, name};
use crate::attribute::problem::path::short;
use crate::attribute::settled::{SETTLED, base_fits, is_clear_of_unknown, is_settled, may_close};
use crate::noise::OTHER_NOISE;
use gl_inference::prior::Prior;
use gl_table::verdict::Verdicts;

/// An effect that closes less of the gap than this is not worth naming where something unknown comes first.
const LITTLE: f64 = 0.05;

/// Shares of the gap that differ by more are two, and their units are said.
const ANOTHER: f64 = 0.05;

/// Above this share of noise and scatter what the emulator does not know widens a verdict.
const IGNORANT: f64 = 0.5;

/// Above this correlation from one reading to the next the noise is said to be correlated.
const CORRELATED: f64 = 0.35;

fn percent(share: f64) -> f64 {
    (100.0 * share).round()
}

/// The verdict: what it rests on if that is doubtful, then the cause, then what else there is to know.
///
/// * `bounds` — where the bounds of the parameters were read, for whoever is to widen them.
/// * `believed` — the prior beforehand and where it was read, if the bounds were made wider since.
///
/// # Errors
/// If the predicted shrink cannot be computed.
pub fn verdict(
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    bounds: &str,
    believed: Option<(&Prior, &str)>,
    seed: u64,
) -> Result<Verdicts> {
    let mut verdicts = Verdicts::default();
    if let Some(believed) = believed {
        add_beyond(&mut verdicts, problem, diagnosis.first(), believed);
    }
    for lean in &diagnosis.leans {
        add_lean(&mut verdicts, lean, diagnosis, bounds);
    }
    let base = diagnosis.attribution.base();
    let gap = crate::attribute::attribution::closure::gap(problem, &base.evidence.mean);
    verdicts.add(
        "gap",
        gap,
        format!(
            "the calibrated base model misses the measurement by {:.2} % of its range; noise and scatter alone would give {:.2} %",
            100.0 * gap,
            100.0 * diagnosis.floor
        ),
    );
    add_cause(&mut verdicts, problem, diagnosis, seed)?;
    add_rest(&mut verdicts, problem, diagnosis.first())?;
    add_noise(&mut verdicts, problem, diagnosis.first());
    let ignorance = diagnosis.ignorance;
    if ignorance > IGNORANT && !diagnosis.is_unproven() {
        verdicts.add("emulator", ignorance, format!(
            "at the best fit the emulator is uncertain by {ignorance:.1} times noise and scatter: further runs there, --next-out, would make the verdict sharper"
        ));
    }
    add_untried(&mut verdicts, problem, diagnosis);
    add_told(&mut verdicts, problem, diagnosis);
    add_rivals(&mut verdicts, problem, diagnosis)?;
    add_hidden(&mut verdicts, problem, diagnosis);
    for of in &diagnosis.attribution.explanations {
        if of.ruled_out == Some(RuledOut::Invisible) && !of.has_rest {
            verdicts.add("invisible", &of.name, format!(
                "{} cannot show in this measurement: within its bounds it stays below noise and scatter, or the base parameters absorb it; it is no candidate here",
                of.name
            ));
        }
    }
    Ok(verdicts)
}

/// Effects that nothing can be said of yet, though something unknown comes first.
fn add_untried(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    let (untried, explanations) = (&diagnosis.untried, &diagnosis.attribution.explanations);
    let most = untried.iter().map(|of| of.ignorance).fold(0.0, f64::max);
    let mut names: Vec<String> =
        untried.iter().map(|of| name(&explanations[of.place].hypothesis, &problem.candidates)).collect();
    names.sort();
    if !names.is_empty() && !diagnosis.is_unproven() {
        verdicts.add("untried", most, format!(
            "the emulator knows too little of {} to rule them out: where they fit best it is uncertain by up to {most:.1} times noise and scatter; further runs there, --next-out, would tell",
            names.join(", ")
        ));
    }
}

/// Parameters that are beyond what was believed of them: with a probability of 0.95.
fn add_beyond(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation, believed: (&Prior, &str)) {
    let (prior, source) = believed;
    for Marginal { name, mean, sd, low, high, .. } in marginals(problem, first) {
        let Some(parameter) = prior.parameters().iter().find(|parameter| parameter.name == name) else {
            continue;
        };
        let (side, bound) = if low > parameter.upper {
            ("upper", parameter.upper)
        } else if high < parameter.lower {
            ("lower", parameter.lower)
        } else {
            continue;
        };
        verdicts.add("beyond-prior", &name, format!(
            "under {} {name} is {} ± {}, beyond its {side} bound, {bound} in {source}: what was believed of it was wrong, or something imitates it; what follows holds with the wider bound",
            first.name, short(mean), short(sd)
        ));
    }
}

fn add_lean(verdicts: &mut Verdicts, lean: &Lean, diagnosis: &Diagnosis, bounds: &str) {
    /// Below this probability within the bounds it is said how small it is.
    const SMALL: f64 = 0.05;
    let of = diagnosis.rows.iter().find(|row| row.name == lean.hypothesis);
    let within = match of.map(|of| of.probability).filter(|probability| *probability < SMALL) {
        Some(probability) => format!(", whose probability within its bounds is {},", short(probability)),
        None => String::new(),
    };
    let (side, relation) = if lean.is_upper { ("upper", "larger") } else { ("lower", "smaller") };
    // One that was made wider has digits of rounding.
    let bound = format!("{:.5e}", lean.bound).parse().unwrap_or(lean.bound);
    verdicts.add("leans", &lean.parameter, format!(
        "under {}{within} the measurement wants {} to be {relation} than its {side} bound, {bound} in {bounds}: the truth may lie outside, and no cause is settled before the bound is wider and runs are made there",
        lean.hypothesis, lean.parameter
    ));
}

/// The cause, or why there is none.
fn add_cause(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, seed: u64) -> Result<()> {
    let first = diagnosis.first();
    let is_settled = is_settled(problem, diagnosis);
    if diagnosis.is_unproven() {
        add_unproven(verdicts, problem, diagnosis);
    } else if first.is_cause() {
        add_effects(verdicts, problem, diagnosis, is_settled, seed)?;
    } else if first.has_rest {
        add_unknown(verdicts, problem, diagnosis, is_settled);
    } else {
        add_none(verdicts, first, is_settled);
    }
    Ok(())
}

/// That the base model comes first: settled unless it takes a noise that was not believed.
fn add_none(verdicts: &mut Verdicts, first: &Explanation, is_settled: bool) {
    let (probability, is_doubted) = (first.probability, first.doubted() > 0.0);
    let needed = if probability < SETTLED || is_doubted { "seems to be needed" } else { "is needed" };
    let mut text =
        format!("no effect {needed}: the base model explains the measurement, probability {probability:.2}");
    if is_doubted {
        text += &format!(
            ", if readings scatter {} times what was stated: their noise is larger, or something as rough as noise is at work, which is no candidate",
            short(first.noise_scale)
        );
    }
    verdicts.add(if is_settled { "none" } else { "unsettled" }, "none", text);
}

/// That something unknown comes first, and which effects come nearest.
fn add_unknown(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, is_settled: bool) {
    let first = diagnosis.stated();
    if let Some((of, Untried { ignorance, closes, .. })) = may_close(diagnosis) {
        verdicts.add("unsettled", UNEXPLAINED, format!(
            "something else seems to be at work, probability {first:.2}; but {} would close {} % of the gap where it fits best, and there the emulator is uncertain by {ignorance:.1} times noise and scatter: neither is settled before runs are made there, --next-out",
            name(&of.hypothesis, &problem.candidates), percent(*closes)
        ));
        return;
    }
    if let Some(of) = diagnosis.confounded() {
        add_as_likely(verdicts, problem, diagnosis, of);
        return;
    }
    let text = match diagnosis.attribution.nearest() {
        None => format!("something else than the base model is at work, probability {first:.2}"),
        Some(of) if first < SETTLED && diagnosis.attribution.probability_of(of) < LITTLE => {
            format!("something else than the base model seems to be at work, probability {first:.2}")
        }
        Some(of) if first < SETTLED => format!(
            "something else seems to be at work, probability {first:.2}, or {}, probability {:.2}, which closes {} % of the gap",
            name(&of.hypothesis, &problem.candidates),
            diagnosis.attribution.probability_of(of),
            percent(of.closes)
        ),
        Some(of) => {
            let none = format!(
                "none of the candidates explains the measurement: something else is at work, probability {first:.2}"
            );
            if of.closes < LITTLE {
                format!("{none}; the likeliest of them closes nothing of the gap")
            } else {
                format!(
                    "{none}; the nearest candidate is {}, which closes {} % of the gap and is no answer",
                    name(&of.hypothesis, &problem.candidates),
                    percent(of.closes)
                )
            }
        }
    };
    if is_settled {
        verdicts.add("unexplained", first, text);
    } else {
        verdicts.add("unsettled", UNEXPLAINED, text);
    }
}

/// That something unknown comes first, though the measurement is as likely with an effect.
fn add_as_likely(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, of: &Explanation) {
    let first = diagnosis.stated();
    let effect = name(&of.hypothesis, &problem.candidates);
    let beside = if of.has_rest { " beside something smaller" } else { "" };
    let odds = (of.evidence.ln - diagnosis.first().evidence.ln).exp();
    let times = match odds {
        ..1.5 => String::new(),
        1e3.. => "more than 1000 times ".to_owned(),
        _ => format!("{} times ", short(odds)),
    };
    verdicts.add("unsettled", UNEXPLAINED, format!(
        "something else seems to be at work, probability {first:.2}; but with {effect}{beside} the measurement is {times}as likely, and {effect} closes {} % of the gap",
        percent(of.closes)
    ));
    let base = problem.prior.base().len();
    let sizes: Vec<String> = marginals(problem, of)
        .into_iter()
        .skip(base)
        .map(|Marginal { name, mean, sd, .. }| format!("{name} = {} ± {}", short(mean), short(sd)))
        .collect();
    let sizes = sizes.join(", ");
    let told = match of.hypothesis.first().map(|&candidate| &problem.candidates[candidate]) {
        Some(Candidate::Measured(_)) => format!("a check of the rig would: {sizes} of the range has to show"),
        _ => format!("a test under other conditions would, where {effect} has to show with {sizes}"),
    };
    let names = diagnosis.rows[0].confounded.join(",");
    let text = format!("this measurement cannot tell {effect} from something unknown; {told}");
    verdicts.add("confounded", names, text);
}

/// That effects come first, of which too little is known to call them the cause.
fn add_unproven(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    let effects = name(&diagnosis.first().hypothesis, &problem.candidates);
    let (probability, left) = (diagnosis.stated(), percent(diagnosis.rows[0].left));
    verdicts.add("unsettled", &effects, format!(
        "{effects} comes first, probability {probability:.2}, but no run shows it: by what is known of it {left} % of the gap would be left"
    ));
    verdicts.add("untried", diagnosis.ignorance, format!(
        "where {effects} fits best the emulator is uncertain by {:.1} times noise and scatter: further runs there, --next-out, would tell",
        diagnosis.ignorance
    ));
}

/// That effects come first, and how much of the gap they close.
fn add_effects(
    verdicts: &mut Verdicts,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    is_settled: bool,
    seed: u64,
) -> Result<()> {
    let first = diagnosis.first();
    let (effects, probability) = (name(&first.hypothesis, &problem.candidates), diagnosis.stated());
    let base = diagnosis.attribution.base();
    let is_part = first.has_rest && !first.closes_most();
    let code = match (is_settled, first.has_rest) {
        (false, _) => "unsettled",
        (true, _) if is_part => "part",
        (true, false) => "cause",
        (true, true) => "cause-with-rest",
    };
    let (is_in, explains) = if is_settled { ("is", "explains") } else { ("may be", "may explain") };
    let text = if is_part {
        format!(
            "{effects} {is_in} in it ({probability:.2}), but closes no more than {} % of the gap: something else, which is no candidate, makes most of it{}",
            percent(first.closes),
            rest_places(problem, first)
        )
    } else if first.has_rest {
        format!(
            "{effects} {is_in} in it ({probability:.2}) and closes {} % of the gap; something else makes the rest{}{}",
            percent(first.closes),
            if is_clear_of_unknown(diagnosis) { "" } else { ", or all of it" },
            rest_places(problem, first)
        )
    } else {
        format!("{effects} {explains} it: probability {probability:.2}")
    };
    verdicts.add(code, &effects, text);
    let closes = shrink(problem, base, first, seed)?;
    let (low, high) = (percent(closes.low), percent(closes.high));
    let interval = if low == high { String::new() } else { format!(" ({low} to {high} %)") };
    // An observable that is noisy over its range counts for less in units of its noise.
    let is_another = (closes.median - first.closes).abs() > ANOTHER;
    let units = match (is_another, first.has_rest) {
        (false, _) => String::new(),
        (true, true) => ", each observable as a share of its range; above, in units of its noise".to_owned(),
        (true, false) => format!(
            ", each observable as a share of its range; {} % in units of its noise",
            percent(first.closes)
        ),
    };
    verdicts.add(
        "closes",
        closes.median,
        format!("adding it should close {} %{interval} of the gap{units}", percent(closes.median)),
    );
    if base_fits(problem, diagnosis) {
        verdicts.add("base-fits", &effects, format!(
            "but the base model fits as well as noise and scatter allow: {effects} is more probable than not to be there, and nothing has to be explained by it"
        ));
    }
    Ok(())
}

/// What a rest goes with, if it clearly goes with something, and what else it goes with nearly as well.
fn add_rest(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) -> Result<()> {
    /// Share of its square from which something is worth naming.
    const CLEARLY: f64 = 0.4;
    /// From this share of the largest on, two cannot be told apart.
    const NEARLY: f64 = 0.85;
    if !first.has_rest {
        return Ok(());
    }
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
    Ok(())
}

/// Where most of a rest is: the observable and the stretch of the control, with a comma before.
fn rest_places(problem: &Problem<'_>, of: &Explanation) -> String {
    let rest = crate::attribute::attribution::rest::rest(problem, of);
    rest.map_or_else(String::new, |rest| {
        let (observable, stretch) = rest.place(problem);
        format!(", in {}", problem.told(observable, &stretch))
    })
}

/// How the readings scatter, if otherwise than stated, and which are far off.
fn add_noise(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) {
    let nuisances = first.model(problem).nuisances(first.best());
    for (j, name) in problem.observables.iter().enumerate() {
        let scale = nuisances.scales[j];
        if problem.is_noise_stated && !(1.0 / OTHER_NOISE..OTHER_NOISE).contains(&scale) {
            verdicts.add(
                "noise-scale",
                scale,
                format!(
                    "the readings of {name} scatter {} times what was stated; the verdict is by what they do",
                    short(scale)
                ),
            );
        }
        if nuisances.phi[j] > CORRELATED {
            verdicts.add(
                "noise-correlation",
                nuisances.phi[j],
                format!(
                    "the noise of {name} is correlated from one reading to the next by about {:.1}",
                    nuisances.phi[j]
                ),
            );
        }
    }
    for (j, name) in problem.observables.iter().enumerate() {
        let (own, test) = (problem.own(j), problem.test_of(j));
        let steps = first.outliers.iter().filter(|i| own.contains(i)).map(|i| i - own.start);
        let (readings, at): (Vec<String>, Vec<String>) =
            steps.map(|step| (step.to_string(), short(test.path.control()[step]))).unzip();
        let (which, are) = match readings.len() {
            0 => continue,
            1 => ("reading", "looks like an outlier, and counts"),
            _ => ("readings", "look like outliers, and count"),
        };
        let text = format!(
            "{which} {} of {name}, at {} {}, {are} for little (the first is 0)",
            all_of(&readings),
            test.control_name,
            all_of(&at)
        );
        verdicts.add("outliers", readings.join(","), text);
    }
}

/// A list in words.
fn all_of(list: &[String]) -> String {
    match list {
        [others @ .., last] if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => list.concat(),
    }
}

/// Which tests tell the cause from the nearest other one.
fn add_told(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    /// A test with this gain tells them at 19 to 1 by itself.
    const TELLS: f64 = 5.89;
    let Some((rival, tests)) = told(problem, &diagnosis.attribution.explanations, diagnosis.first()) else {
        return;
    };
    let effects = name(&diagnosis.first().hypothesis, &problem.candidates);
    let (by, others): (Vec<&Told>, Vec<&Told>) = tests.iter().partition(|told| told.gain() >= TELLS);
    if by.is_empty() {
        return;
    }
    let listed = |of: &[&Told]| {
        let each = of.iter().map(|told| format!("{} ({:.1} and {:.1})", told.test, told.first, told.rival));
        each.collect::<Vec<_>>().join(", ")
    };
    let mut text = format!(
        "{effects} is told from {} by {}: what either leaves there, fitted to all tests, in standard deviations of noise and scatter",
        rival.name,
        listed(&by)
    );
    if !others.is_empty() {
        text += &format!("; not by {}", listed(&others));
    }
    let names: Vec<&str> = by.iter().map(|told| told.test.as_str()).collect();
    verdicts.add("told-by", names.join(","), text);
}

/// What comes next, what cannot be told from the first, and what would tell them apart.
fn add_rivals(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let Attribution { explanations } = &diagnosis.attribution;
    let (first, of_first) = (&diagnosis.rows[0], diagnosis.first());
    let rival = explanations.iter().find(|of| !of.says_as(of_first));
    let is_open = diagnosis.stated() < SETTLED;
    if let (true, Some(rival)) = (is_open, rival) {
        let (rival, own) = (&rival.name, diagnosis.attribution.probability_of(rival));
        verdicts.add("next", rival, format!("not settled: next comes {rival} with probability {own:.2}"));
    }
    // The rival that a further measurement should tell from the first: one that it is confounded with, else
    // the next in line.
    let is_said = is_open || !of_first.is_cause();
    let rival = diagnosis.confounded().or(rival.filter(|of| is_said && !of.is_unknown()));
    let Some(rival) = rival.filter(|_| !of_first.is_unknown()) else { return Ok(()) };
    if !first.confounded.is_empty() {
        verdicts.add(
            "confounded",
            first.confounded.join(","),
            format!("this measurement cannot tell {} from {}", first.name, first.confounded.join(", ")),
        );
    }
    if let Some(at) = difference(problem, of_first, rival).filter(|_| is_open || !first.confounded.is_empty())
    {
        verdicts.add("measure-at", &problem.observables[at.observable], format!(
            "{} and {} differ most in {}, by {:.1} standard deviations of a reading: measure there again, or beyond",
            of_first.name,
            rival.name,
            problem.told(at.observable, &at.steps),
            at.height
        ));
    }
    add_effort(verdicts, problem, diagnosis, rival)
}

/// What it would take to tell the first from a rival.
fn add_effort(
    verdicts: &mut Verdicts,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    rival: &Explanation,
) -> Result<()> {
    let first = diagnosis.first();
    let probability = |of: &Explanation| diagnosis.attribution.probability_of(of).max(f64::MIN_POSITIVE);
    let ln_odds = |truth: &Explanation, other: &Explanation| (probability(truth) / probability(other)).ln();
    // The truth is one of them. That an effect is absent is what is left when it would have been seen.
    let ways = if is_part(&first.hypothesis, &rival.hypothesis) {
        vec![(rival, first)]
    } else if is_part(&rival.hypothesis, &first.hypothesis) {
        vec![(first, rival)]
    } else {
        vec![(first, rival), (rival, first)]
    };
    let efforts = ways.into_iter().map(|(truth, other)| effort(problem, truth, other, ln_odds(truth, other)));
    let efforts: Vec<Option<Effort>> = efforts.collect::<Result<_>>()?;
    let named = |of: &Explanation| name(&of.hypothesis, &problem.candidates);
    let (one, other) = if rival.is_cause() { (rival, first) } else { (first, rival) };
    let pair = format!("{} from {}", named(one), named(other));
    let hardest = efforts.into_iter().collect::<Option<Vec<Effort>>>();
    let Some(Effort { runs, measurements }) =
        hardest.and_then(|all| all.into_iter().max_by_key(|effort| (effort.measurements, effort.runs)))
    else {
        verdicts.add("effort", "none", format!(
            "neither further runs nor measurements like this one will tell {pair}, as large as they fit: measure something else"
        ));
        return Ok(());
    };
    let (value, text) = match (measurements, runs) {
        (1, 0) => return Ok(()),
        (1, runs) => (
            format!("runs={runs}"),
            format!(
                "about {runs} further runs near the two, --next-out, would tell {pair}, as large as they fit"
            ),
        ),
        (many, 0) => (
            format!("measurements={many}"),
            format!(
                "the mean of about {many} measurements like this one would tell {pair}, as large as they fit"
            ),
        ),
        (many, runs) => (
            format!("measurements={many},runs={runs}"),
            format!(
                "the mean of about {many} measurements like this one, with {runs} further runs near the two, --next-out, would tell {pair}, as large as they fit"
            ),
        ),
    };
    verdicts.add("effort", value, text);
    Ok(())
}

/// How large each effect may be where none is needed, or something unknown comes first that it may lie beside.
fn add_hidden(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    /// ln odds that the measurement may speak against an effect which is not out of the question beside something unknown.
    const FAINT: f64 = 2.0;
    let first = diagnosis.first();
    if first.is_cause() {
        return;
    }
    let is_open = |of: &Explanation| {
        of.ruled_out != Some(RuledOut::Invisible) && !of.is_behind && of.has_rest == first.has_rest
    };
    let is_hidden = |of: &Explanation| {
        let is_near = of.closes >= LITTLE && of.evidence.ln > first.evidence.ln - FAINT;
        if first.has_rest {
            is_near && !diagnosis.rows[0].confounded.contains(&of.name)
        } else {
            of.ruled_out.is_none()
        }
    };
    let explanations = diagnosis.attribution.explanations.iter();
    for of in explanations.filter(|of| of.hypothesis.len() == 1 && is_open(of) && is_hidden(of)) {
        let base = problem.prior.base().len();
        let of_effect = marginals(problem, of).into_iter().skip(base);
        let within = |Marginal { name, low, high, .. }: Marginal| {
            let parameter = problem.prior.parameters().iter().find(|parameter| parameter.name == name);
            let off = parameter.and_then(|of| of.off).unwrap_or(0.0);
            // From one side of its value off to the other: whatever is between shows no more.
            let from = match parameter {
                Some(of) if off <= of.lower => String::new(),
                _ => format!(" from {}", short(low.min(off))),
            };
            format!("{name}{from} up to {}", short(high.max(off)))
        };
        let within: Vec<String> = of_effect.map(within).collect();
        let effect = name(&of.hypothesis, &problem.candidates);
        let text = if first.has_rest {
            format!(
                "{effect} may be in it, too, beside what is unknown: {} (0.9, if it is), which closes {} % of the gap",
                within.join(", "),
                percent(of.closes)
            )
        } else {
            format!("{effect} may be there and not show: {} (0.9, if it is)", within.join(", "))
        };
        verdicts.add("may-hide", &effect, text);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::untried::untried;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

    /// What is said of the cause where something unknown comes first with this probability, and the emulator has this variance.
    fn said_of_something_unknown(probability: f64, variance: f64) -> String {
        let (predictor, prior) = (Straight::unsure(variance), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
        diagnosis.attribution.explanations[0].probability = probability;
        diagnosis.untried = untried(&problem, &diagnosis.attribution.explanations);
        let mut verdicts = Verdicts::default();
        add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        verdicts.rows.remove(0).text
    }

    #[test]
    fn something_unknown_is_not_settled_beside_an_effect_that_would_close_most_and_is_not_known() {
        let said = said_of_something_unknown(0.99, 2.5e-3);
        assert!(said.contains("but wave would close") && said.contains("neither is settled"), "{said}");
        let said = said_of_something_unknown(0.99, 1e-8);
        assert!(said.contains("none of the candidates explains the measurement"), "{said}");
        let said = said_of_something_unknown(0.6, 1e-8);
        assert!(said.contains("seems to be at work, probability 0.60, or wave, probability"), "{said}");
    }

    #[test]
    fn something_unknown_is_not_settled_beside_an_effect_with_which_the_measurement_is_as_likely() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
        diagnosis.attribution.explanations[0].probability = 0.99;
        diagnosis.rows[0].confounded = vec!["wave+unexplained".to_owned(), "offset(y)".to_owned()];
        let mut verdicts = Verdicts::default();
        add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        let [answer, confounded] = &verdicts.rows[..] else { panic!("{:?}", verdicts.rows) };
        assert_eq!((answer.code.as_str(), answer.value.as_str()), ("unsettled", "unexplained"));
        assert!(
            answer.text.contains(
                "with wave beside something smaller the measurement is more than 1000 times as likely"
            ),
            "{}",
            answer.text
        );
        assert_eq!(
            (confounded.code.as_str(), confounded.value.as_str()),
            ("confounded", "wave+unexplained,offset(y)")
        );
        assert!(confounded.text.contains("where wave has to show with c = "), "{}", confounded.text);
        diagnosis.rows[0].confounded.remove(0);
        let mut verdicts = Verdicts::default();
        add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        assert!(
            verdicts.rows[1].text.contains("a check of the rig would: offset(y) = "),
            "{:?}",
            verdicts.rows
        );
    }

    #[test]
    fn an_effect_that_may_be_in_it_beside_something_unknown_is_said_with_its_size() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
        diagnosis.rows[0].confounded = Vec::new();
        let unknown = diagnosis.first().evidence.ln;
        let said = |diagnosis: &Diagnosis| {
            let mut verdicts = Verdicts::default();
            add_hidden(&mut verdicts, &problem, diagnosis);
            verdicts.rows.into_iter().find(|row| row.value == "wave").map(|row| row.text)
        };
        let is_wave = |of: &&mut Explanation| of.name == "wave+unexplained";
        let mut said_where = |ln: f64, closes: f64| {
            let wave = diagnosis.attribution.explanations.iter_mut().find(is_wave).unwrap();
            (wave.evidence.ln, wave.closes, wave.is_behind) = (unknown + ln, closes, false);
            said(&diagnosis)
        };
        let text = said_where(-1.0, 0.3).unwrap();
        assert!(
            text.starts_with("wave may be in it, too, beside what is unknown: c from 0 up to 0."),
            "{text}"
        );
        assert!(text.ends_with("(0.9, if it is), which closes 30 % of the gap"), "{text}");
        assert!(said_where(-3.0, 0.3).is_none() && said_where(-1.0, 0.04).is_none());
        said_where(-1.0, 0.6);
        diagnosis.rows[0].confounded = vec!["wave+unexplained".to_owned()];
        assert!(said(&diagnosis).is_none(), "it is said there, and more");
    }

    /// The code and the value of the answer where this hypothesis comes first with this probability, a bound is leaned
    /// on or not, and the readings scatter so many times what was stated.
    fn answer(name: &str, probability: f64, leans: bool, noise_scale: f64) -> (String, String) {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        let explanations = &mut diagnosis.attribution.explanations;
        explanations.sort_by_key(|of| of.name != name);
        explanations.iter_mut().for_each(|of| of.probability = 0.0);
        (explanations[0].probability, explanations[0].noise_scale) = (probability, noise_scale);
        if leans {
            let (parameter, hypothesis) = ("a".to_owned(), name.to_owned());
            diagnosis.leans.push(Lean { parameter, bound: 2.0, is_upper: true, by: 0.1, hypothesis });
        }
        let mut verdicts = Verdicts::default();
        add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        let first = verdicts.rows.remove(0);
        (first.code, first.value)
    }

    #[test]
    fn whatever_comes_first_is_not_settled_below_four_fifths_or_where_a_bound_is_leaned_on() {
        for (name, code, value) in
            [("none", "none", "none"), ("wave", "cause", "wave"), ("unexplained", "unexplained", "0.85")]
        {
            assert_eq!(answer(name, 0.85, false, 1.0), (code.to_owned(), value.to_owned()));
            for (probability, leans) in [(0.75, false), (0.85, true)] {
                assert_eq!(answer(name, probability, leans, 1.0), ("unsettled".to_owned(), name.to_owned()));
            }
        }
    }

    #[test]
    fn an_effect_beside_a_rest_is_settled_only_where_something_unknown_alone_is_no_rival() {
        let answer = |ahead: f64| {
            let (predictor, prior) = (Straight::new(), Straight::prior());
            let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
            let problem = predictor.problem(&prior, &observations);
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            let explanations = &mut diagnosis.attribution.explanations;
            explanations.sort_by_key(|of| of.name != "wave+unexplained");
            explanations.iter_mut().for_each(|of| of.probability = 0.0);
            let unknown = explanations.iter().find(|of| of.is_unknown()).unwrap().ln_weight;
            let first = &mut explanations[0];
            (first.probability, first.closes, first.ln_weight) = (0.85, 0.8, unknown + ahead);
            let mut verdicts = Verdicts::default();
            add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            let first = verdicts.rows.remove(0);
            (first.code, first.text)
        };
        let (code, text) = answer(11.0);
        assert!(code == "cause-with-rest" && text.contains("wave is in it (0.85) and closes 80 %"), "{text}");
        let (code, text) = answer(9.0);
        assert!(code == "unsettled" && text.contains("wave may be in it (0.85)"), "{text}");
        assert!(text.contains("something else makes the rest, or all of it"), "{text}");
    }

    #[test]
    fn a_share_that_is_another_in_units_of_noise_says_its_units() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let said = |closes: f64| {
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations[0].closes = closes;
            let mut verdicts = Verdicts::default();
            add_cause(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            verdicts.find("closes").unwrap().text.clone()
        };
        assert_eq!(said(0.97), "adding it should close 100 % (99 to 100 %) of the gap");
        let units = ", each observable as a share of its range; 60 % in units of its noise";
        assert_eq!(said(0.6), format!("adding it should close 100 % (99 to 100 %) of the gap{units}"));
    }

    #[test]
    fn a_list_is_told_with_and_before_the_last() {
        let told = |list: &[&str]| all_of(&list.iter().map(|&of| of.to_owned()).collect::<Vec<_>>());
        assert_eq!(
            [told(&["8"]), told(&["8", "19"]), told(&["0", "4", "36"])],
            ["8", "8 and 19", "0, 4 and 36"]
        );
    }

    #[test]
    fn that_no_effect_is_needed_is_not_settled_by_a_noise_that_was_not_believed() {
        assert_eq!(answer("none", 0.85, false, 2.0).0, "none");
        assert_eq!(answer("none", 0.85, false, 5.9), ("unsettled".to_owned(), "none".to_owned()));
    }
}
