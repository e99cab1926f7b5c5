//! The cause, or why there is none, and how much of the gap it closes.

use anyhow::Result;
use gl_inference::fit::{CORRELATED, Fit, alternation};
use gl_table::verdict::Verdicts;

use super::{LITTLE, noise, percent, rest};
use crate::attribute::attribution::marginals::{Marginal, errors_of_the_rig, marginals};
use crate::attribute::attribution::untried::Untried;
use crate::attribute::attribution::{Explanation, MOST, UNEXPLAINED};
use crate::attribute::diagnosis::{Diagnosis, shrink};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Candidate, name};
use crate::attribute::settled::{
    SETTLED, alternation_left, base_fits, base_misfit, is_clear_of_unknown, is_settled, may_be_noise,
    may_close,
};
use gl_inference::path::short;

/// Shares of the gap that differ by more are two, and their units are said.
const ANOTHER: f64 = 0.05;

/// An effect beside a rest that closes less than this may be what imitates it.
const NEARLY_ALL: f64 = 0.9;
const IMITATED: &str = "; what is no candidate and looks like it would be named so, too";

/// The cause, or why there is none.
pub(super) fn add(
    verdicts: &mut Verdicts,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    seed: u64,
) -> Result<()> {
    let first = diagnosis.first();
    let is_settled = is_settled(problem, diagnosis);
    if diagnosis.is_unproven() {
        add_unproven(verdicts, problem, diagnosis);
    } else if first.is_cause() {
        add_effects(verdicts, problem, diagnosis, is_settled, seed)?;
    } else if first.has_rest {
        add_unknown(verdicts, problem, diagnosis, is_settled);
    } else {
        add_none(verdicts, problem, diagnosis, is_settled);
    }
    Ok(())
}

/// That the base model comes first: settled unless it takes a noise that was not believed, or leaves what is no noise as
/// it was stated.
fn add_none(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, is_settled: bool) {
    let first = diagnosis.first();
    let (probability, is_doubted) = (first.probability, first.doubted() > 0.0);
    let misfit = base_misfit(problem, diagnosis);
    let is_doubtful = probability < SETTLED || is_doubted || misfit.is_some();
    let needed = if is_doubtful { "seems to be needed" } else { "is needed" };
    let mut text =
        format!("no effect {needed}: the base model explains the measurement, probability {probability:.2}");
    let other = "or something as rough as noise is at work, which is no candidate";
    text += &match misfit {
        _ if is_doubted => format!(
            ", if readings scatter {} times what was stated: their noise is larger, {other}",
            short(first.noise_scale)
        ),
        Some(Fit { alternation: Some(of), .. }) => format!(", but what it leaves {}", alternation(of)),
        Some(Fit { correlation, .. }) if correlation > CORRELATED => format!(
            ", if the noise is correlated: what it leaves is smoother than noise as it was stated (correlation {correlation:.2}), {other}"
        ),
        Some(Fit { scatter, .. }) => format!(
            ", if readings scatter {} times what was stated: their noise is larger, {other}",
            short(scatter)
        ),
        None => String::new(),
    };
    verdicts.add(if is_settled { "none" } else { "unsettled" }, "none", text);
}

/// That something unknown comes first, and which effects come nearest.
fn add_unknown(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, is_settled: bool) {
    let first = diagnosis.stated();
    if let Some((of, Untried { ignorance, closes, .. })) = may_close(diagnosis) {
        let does = if *closes < MOST {
            "the measurement is as likely".to_owned()
        } else {
            format!("{} % of the gap would close", percent(*closes))
        };
        verdicts.add("unsettled", UNEXPLAINED, format!(
            "something else seems to be at work, probability {first:.2}; but {does} with {} where it fits best, and there the emulator is uncertain by {ignorance:.1} times noise and scatter: neither is settled before runs are made there (gl-gap-attribute --next-out)",
            name(&of.hypothesis, &problem.candidates)
        ));
        return;
    }
    if let Some(of) = diagnosis.confounded() {
        add_as_likely(verdicts, problem, diagnosis, of);
        return;
    }
    if may_be_noise(diagnosis) {
        add_or_noise(verdicts, problem, diagnosis);
        return;
    }
    let text = match diagnosis.attribution.nearest() {
        None if is_settled => {
            format!("something else than the base model is at work, probability {first:.2}")
        }
        Some(of) if is_settled => {
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
        Some(of) if diagnosis.attribution.probability_of(of) >= LITTLE => format!(
            "something else seems to be at work, probability {first:.2}, or {}, probability {:.2}, which closes {} % of the gap",
            name(&of.hypothesis, &problem.candidates),
            diagnosis.attribution.probability_of(of),
            percent(of.closes)
        ),
        _ => format!("something else than the base model seems to be at work, probability {first:.2}"),
    };
    if is_settled {
        verdicts.add("unexplained", first, text);
    } else {
        verdicts.add("unsettled", UNEXPLAINED, text);
    }
}

/// That something unknown comes first, though the measurement is nearly as likely with noise alone.
fn add_or_noise(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    let (first, base) = (diagnosis.first(), diagnosis.attribution.base());
    let times = (first.evidence.ln - base.evidence.ln).exp();
    let likely = if times < 1.5 {
        "as likely".to_owned()
    } else {
        format!("only {} times as likely as", short(times))
    };
    verdicts.add("unsettled", UNEXPLAINED, format!(
        "something else than the base model seems to be at work, probability {:.2}; but the measurement is {likely} with the base model and {}",
        diagnosis.stated(),
        noise::told(problem, base)
    ));
    verdicts.add(
        "measure-again",
        times,
        "a second measurement would tell: noise would be another one, and all else the same",
    );
}

/// That something unknown comes first, though the measurement is as likely with an effect.
fn add_as_likely(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis, of: &Explanation) {
    let first = diagnosis.stated();
    let effect = name(&of.hypothesis, &problem.candidates);
    let beside = if of.has_rest { " beside something smaller" } else { "" };
    let odds = (of.evidence.ln - diagnosis.first().evidence.ln).exp();
    let times = match odds {
        ..0.67 => "nearly ".to_owned(),
        0.67..1.5 => String::new(),
        1e3.. => "more than 1000 times ".to_owned(),
        _ => format!("{} times ", short(odds)),
    };
    // Why it does not come first all the same.
    let why = match odds {
        ..1.5 => "",
        _ if of.is_of_the_rig => "; so plain an error is a part of much that is unknown",
        _ if of.closes < NEARLY_ALL => {
            "; but an effect that leaves so much is rarely the cause, so that this counts for little"
        }
        _ => "",
    };
    verdicts.add("unsettled", UNEXPLAINED, format!(
        "something else seems to be at work, probability {first:.2}; but with {effect}{beside} the measurement is {times}as likely, and {effect} closes {} % of the gap{why}",
        percent(of.closes)
    ));
    let base = problem.prior.base().len();
    let errors = errors_of_the_rig(problem, of);
    let size = |of: &Marginal| match errors.iter().find(|(error, _)| error.name == of.name) {
        Some((error, _)) => problem.told_size(error, (of.mean, of.sd)),
        None => format!("{} = {} ± {}", of.name, short(of.mean), short(of.sd)),
    };
    let sizes = marginals(problem, of).iter().skip(base).map(size).collect::<Vec<_>>().join(", ");
    let told = match of.hypothesis.first().map(|&candidate| &problem.candidates[candidate]) {
        Some(Candidate::Measured(_)) => format!("a check of the rig would: {sizes} has to show"),
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
        "where {effects} fits best the emulator is uncertain by {:.1} times noise and scatter: further runs there (gl-gap-attribute --next-out) would tell",
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
    let closes = shrink(problem, base, first, seed)?;
    // An observable that is noisy over its range counts for less in units of its noise.
    let is_another = (closes.median - first.closes).abs() > ANOTHER;
    let [in_ranges, in_noise] = [percent(closes.median), percent(first.closes)];
    let share = if is_another { &in_noise } else { &in_ranges };
    let like_a_rest = noise::like_a_rest(problem, first);
    let imitated = if first.closes < NEARLY_ALL { IMITATED } else { "" };
    let code = match (is_settled, first.has_rest || like_a_rest.is_some()) {
        (false, _) => "unsettled",
        (true, _) if is_part => "part",
        (true, false) => "cause",
        (true, true) => "cause-with-rest",
    };
    let (is_in, explains) = if is_settled { ("is", "explains") } else { ("may be", "may explain") };
    let text = if is_part {
        format!(
            "{effects} {is_in} in it ({probability:.2}), but closes {} of the gap{}: something else, which is no candidate, makes most of it{}{imitated}",
            if first.closes < LITTLE {
                "hardly anything".to_owned()
            } else {
                format!("no more than {} %", percent(first.closes))
            },
            if is_another { " in units of the noise" } else { "" },
            rest::places(problem, first)
        )
    } else if first.has_rest {
        format!(
            "{effects} {is_in} in it ({probability:.2}) and closes {} % of the gap; something else makes the rest{}{}{}{}",
            share,
            if is_clear_of_unknown(diagnosis) { "" } else { ", or all of it" },
            rest::places(problem, first),
            imitated,
            beyond_belief(diagnosis)
        )
    } else if let Some((observable, scale)) = like_a_rest {
        format!(
            "{effects} {is_in} in it ({probability:.2}) and closes {} % of the gap; what it leaves of {observable} is {} times the noise that was stated, and alike from reading to reading: something else makes it, or a noise that is otherwise than stated{imitated}{}{}",
            share,
            short(scale),
            by_noise(diagnosis),
            beyond_belief(diagnosis)
        )
    } else {
        format!(
            "{effects} {explains} it: probability {probability:.2}{}{}{}{}{}",
            beside_a_rest(probability - first.probability),
            with_others(diagnosis, probability),
            one_of_them(diagnosis, probability),
            by_noise(diagnosis),
            beyond_belief(diagnosis)
        )
    };
    verdicts.add(code, &effects, text);
    let (low, high) = (percent(closes.low), percent(closes.high));
    let interval = if low == high { String::new() } else { format!(" ({low} to {high} %)") };
    let outliers = if first.singular.outliers.is_empty() { "" } else { ", without what looks like outliers" };
    let how_far = if is_another {
        format!(
            "{in_noise} % of the gap with each observable in units of its noise, and {in_ranges} %{interval} of it as shares of their ranges{outliers}"
        )
    } else {
        format!("{in_ranges} %{interval} of the gap")
    };
    verdicts.add("closes", closes.median, format!("{} should close {how_far}", adding(problem, first)));
    add_errors_of_the_rig(verdicts, problem, first, is_settled);
    if base_fits(problem, diagnosis) {
        verdicts.add("base-fits", &effects, format!(
            "but the base model fits as well as noise and scatter allow: {effects} is more probable than not to be there, and nothing has to be explained by it"
        ));
    }
    if let Some(correlation) = alternation_left(problem, first) {
        let text = format!("what {effects} leaves {}", alternation(correlation));
        verdicts.add("alternates", correlation, text);
    }
    Ok(())
}

/// What it takes for the gap to close: effects are put into the simulation, and its runs have the errors of the rig.
fn adding(problem: &Problem<'_>, of: &Explanation) -> String {
    let (errors, effects): (Vec<usize>, Vec<usize>) =
        of.hypothesis.iter().copied().partition(|&candidate| problem.candidates[candidate].is_measured());
    let named = |of: &[usize]| name(of, &problem.candidates);
    match (effects.is_empty(), errors.is_empty()) {
        (_, true) => "adding it".to_owned(),
        (true, false) => "runs that have it".to_owned(),
        (false, false) => {
            format!("adding {}, and {} to what runs would record,", named(&effects), named(&errors))
        }
    }
}

/// How much of the probability of effects is that they are not alone.
fn beside_a_rest(probability: f64) -> String {
    /// Less is not worth a word.
    const MUCH: f64 = 0.2;
    if probability < MUCH {
        return String::new();
    }
    format!(", {probability:.2} of it beside something unknown")
}

/// That what comes first is in it with a clearly larger probability than that of being all there is: others may be there, too.
fn with_others(diagnosis: &Diagnosis, probability: f64) -> String {
    /// Less is not worth a word.
    const MUCH: f64 = 0.05;
    let in_all = diagnosis.attribution.probability_of_effects(&diagnosis.first().hypothesis);
    if in_all - probability < MUCH {
        return String::new();
    }
    format!("; in it, with other effects or without: {in_all:.2}")
}

/// The one of several effects that is in it with a clearly larger probability than all of them together.
fn one_of_them(diagnosis: &Diagnosis, probability: f64) -> String {
    /// Less is not worth a word.
    const MUCH: f64 = 0.2;
    let hypothesis = &diagnosis.first().hypothesis;
    let all = hypothesis.iter().map(|&candidate| &diagnosis.effects[candidate]);
    match all.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|_| hypothesis.len() > 1) {
        Some((name, alone)) if alone - probability >= MUCH => {
            format!("; of these {name} is in it, with whichever other: {alone:.2}")
        }
        _ => String::new(),
    }
}

/// That what comes first needs a noise which something unknown does without.
fn by_noise(diagnosis: &Diagnosis) -> String {
    let first = diagnosis.first();
    match diagnosis.attribution.unknown().filter(|unknown| first.has_noise_for_a_rest(unknown)) {
        Some(unknown) => format!(
            "; but with a noise {} times what was stated, where something unknown needs {} times: some of that may be no noise",
            short(first.noise_scale),
            short(unknown.noise_scale)
        ),
        None => String::new(),
    }
}

/// That what comes first needs a base model that was not believed, and is not well ahead by it.
fn beyond_belief(diagnosis: &Diagnosis) -> &'static str {
    let first = diagnosis.first();
    let is_near = diagnosis.attribution.unknown().is_some_and(|unknown| first.is_near_beyond_belief(unknown));
    if is_near {
        "; but with a base model beyond what was believed of it, and something unknown is not far behind"
    } else {
        ""
    }
}

/// What of the effects no simulation can have, and how large that is.
fn add_errors_of_the_rig(
    verdicts: &mut Verdicts,
    problem: &Problem<'_>,
    first: &Explanation,
    is_settled: bool,
) {
    let errors = errors_of_the_rig(problem, first);
    if errors.is_empty() {
        return;
    }
    let names: Vec<&str> = errors.iter().map(|(error, _)| error.name.as_str()).collect();
    let sizes: Vec<String> =
        errors.iter().map(|(error, of)| problem.told_size(error, (of.mean, of.sd))).collect();
    let is_one = names.len() == 1;
    let are = match (is_settled, is_one) {
        (true, true) => "is an error",
        (true, false) => "are errors",
        (false, true) => "would be an error",
        (false, false) => "would be errors",
    };
    let them = if is_one { "it" } else { "them" };
    // What reading there would have been at another control, nobody measured.
    let correct = if errors.iter().any(|(error, _)| error.kind.is_of_control()) {
        String::new()
    } else {
        format!("correct the measurement for {them}, or ")
    };
    verdicts.add("rig", names.join(","), format!(
        "{} {are} of the rig, which no simulation makes: look for {them} there, and {correct}calibrate with {them} as rig in case.toml (gl-collect --rig)",
        sizes.join(" and ")
    ));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::lean::Lean;
    use crate::attribute::attribution::untried::untried;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::problem::measurement::MeasurementEffect;
    use crate::attribute::synthetic_world::Straight;
    use gl_inference::rig::Kind;

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
        add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        verdicts.rows.remove(0).text
    }

    #[test]
    fn the_size_of_an_error_of_the_rig_is_told_in_the_units_of_what_it_acts_on() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations).in_units(&"y=kN,x=mm".parse().unwrap());
        let kinds = [Kind::Offset, Kind::Drift, Kind::Gain, Kind::Lag, Kind::Compliance];
        let told = MeasurementEffect::all(&kinds, &["y".to_owned()])
            .iter()
            .map(|error| {
                let unit = problem.unit_of(error);
                problem.told_size(error, (0.1 * unit, 0.02 * unit))
            })
            .collect::<Vec<_>>();
        // The control goes from 0 to 1.
        let range = problem.ranges[0];
        let [size, sd] = [0.1, 0.02].map(|of| short(of * range));
        let [way, sd_of_way] = [0.1, 0.02].map(|of| short(of / range));
        let expected = [
            format!("offset(y) = {size} ± {sd} kN"),
            format!("drift(y) = {size} ± {sd} kN at the end"),
            "gain(y) = 10 ± 2 %".to_owned(),
            "lag = 0.1 ± 0.02 mm of x".to_owned(),
            format!("compliance = {way} ± {sd_of_way} mm/kN"),
        ];
        assert_eq!(told, expected);
    }

    /// An error of the control, as a candidate.
    fn lag() -> impl Iterator<Item = Candidate> {
        MeasurementEffect::all(&[Kind::Lag], &["y".to_owned()]).into_iter().map(Candidate::Measured)
    }

    #[test]
    fn an_error_of_the_rig_is_had_by_runs_and_not_put_into_the_simulation() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut of = diagnose(&problem, 1, 1).unwrap().first().clone();
        let mut said = |hypothesis: &[usize]| {
            of.hypothesis = hypothesis.to_vec();
            adding(&problem, &of)
        };
        assert_eq!(said(&[0]), "adding it");
        assert_eq!(said(&[1]), "runs that have it");
        assert_eq!(said(&[0, 1]), "adding wave, and offset(y) to what runs would record,");
    }

    #[test]
    fn an_error_of_the_rig_is_told_with_its_size_to_be_corrected() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let mut problem = predictor.problem(&prior, &observations);
        problem.candidates.extend(lag());
        let said = |first: &str| {
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations.sort_by_key(|of| of.name != first);
            let mut verdicts = Verdicts::default();
            add_errors_of_the_rig(&mut verdicts, &problem, diagnosis.first(), true);
            verdicts.rows.pop().map(|said| (said.value, said.text))
        };
        assert_eq!(said("wave"), None);
        let (value, text) = said("offset(y)").unwrap();
        assert_eq!(value, "offset(y)");
        assert!(
            text.starts_with("offset(y) = ") && text.contains("for it, or calibrate with it as rig"),
            "{text}"
        );
        let (_, text) = said("lag").unwrap();
        assert!(
            text.contains(", which no simulation makes: look for it there, and calibrate with it as rig"),
            "{text}"
        );
    }

    #[test]
    fn a_noise_that_is_larger_than_stated_and_smooth_is_said_to_be_something_else_or_a_noise() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let told = |waves: f64, noise: f64| {
            let mut observations = Straight::measured(1.3, 0.6, 0.8, noise);
            let mut add_waves = |(t, y): (usize, &mut f64)| {
                *y += waves
                    * [0.6, 0.9, 1.2].map(|pace| (pace * t as f64 + 3.0 * pace).sin()).iter().sum::<f64>();
            };
            observations.values[0].iter_mut().enumerate().for_each(&mut add_waves);
            let problem = predictor.problem(&prior, &observations);
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations.sort_by_key(|of| of.name != "wave");
            let mut verdicts = Verdicts::default();
            super::add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            verdicts.rows.remove(0).text
        };
        let white = told(0.0, 0.02);
        assert!(white.starts_with("wave explains it"), "{white}");
        let smooth = told(0.025, 0.01);
        assert!(smooth.contains("and alike from reading to reading"), "{smooth}");
    }

    #[test]
    fn something_unknown_is_not_settled_beside_an_effect_that_would_close_most_and_is_not_known() {
        let said = said_of_something_unknown(0.99, 2.5e-3);
        assert!(
            said.contains("of the gap would close with wave") && said.contains("neither is settled"),
            "{said}"
        );
        let said = said_of_something_unknown(0.99, 1e-8);
        assert!(said.contains("none of the candidates explains the measurement"), "{said}");
        let said = said_of_something_unknown(0.6, 1e-8);
        assert!(said.contains("seems to be at work, probability 0.60, or wave, probability"), "{said}");
    }

    #[test]
    fn something_unknown_that_may_be_noise_is_not_settled_and_a_second_measurement_asked_for() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let codes = |ahead: f64| {
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
            let first = &mut diagnosis.attribution.explanations[0];
            first.probability = 0.99;
            let ln = first.evidence.ln;
            let base = diagnosis.attribution.explanations.iter_mut().find(|of| of.name == "none").unwrap();
            base.evidence.ln = ln - ahead;
            assert_eq!(is_settled(&problem, &diagnosis), ahead > 3.0);
            let mut verdicts = Verdicts::default();
            add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            verdicts.rows.into_iter().map(|said| (said.code, said.text)).collect::<Vec<_>>()
        };
        let [(answer, text), (again, _)] = &codes(2.0)[..] else { panic!() };
        assert_eq!((answer.as_str(), again.as_str()), ("unsettled", "measure-again"));
        assert!(
            text.contains("only 7.39 times as likely as with the base model and a noise of y "),
            "{text}"
        );
        assert_eq!(codes(4.0).len(), 1);
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
        add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
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
        add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
        assert!(
            verdicts.rows[1].text.contains("a check of the rig would: offset(y) = "),
            "{:?}",
            verdicts.rows
        );
    }

    /// The code and the value of the answer where this hypothesis comes first with this probability, a bound is leaned
    /// on or not, and the readings scatter so many times what was stated.
    fn answer(name: &str, probability: f64, leans: bool, noise_scale: f64) -> (String, String) {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let wave = if name == "none" { 0.0 } else { 0.8 };
        let observations = Straight::measured(1.3, 0.6, wave, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        let explanations = &mut diagnosis.attribution.explanations;
        explanations.sort_by_key(|of| of.name != name);
        explanations.iter_mut().for_each(|of| of.probability = 0.0);
        (explanations[0].probability, explanations[0].noise_scale) = (probability, noise_scale);
        if leans {
            let (parameter, hypothesis) = ("a".to_owned(), name.to_owned());
            diagnosis.leans.push(Lean { parameter, bound: 2.0, is_upper: true, hypothesis });
        }
        let mut verdicts = Verdicts::default();
        add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
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
            add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
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
    fn of_several_effects_the_one_that_is_in_it_whichever_other_is_is_said() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let said = |hypothesis: &[usize], alone: f64| {
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations[0].hypothesis = hypothesis.to_vec();
            diagnosis.effects = vec![("wave".to_owned(), alone), ("offset(y)".to_owned(), 0.35)];
            one_of_them(&diagnosis, 0.3)
        };
        assert_eq!(said(&[0, 1], 0.98), "; of these wave is in it, with whichever other: 0.98");
        assert_eq!([said(&[0, 1], 0.4), said(&[0], 0.98)], ["", ""]);
    }

    #[test]
    fn a_share_that_is_another_in_units_of_noise_says_its_units() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let said = |closes: f64| {
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations[0].closes = closes;
            let mut verdicts = Verdicts::default();
            add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            verdicts.find("closes").unwrap().text.clone()
        };
        assert_eq!(said(0.97), "adding it should close 100 % (99 to 100 %) of the gap");
        let expected = "adding it should close 60 % of the gap with each observable in units of its noise, and 100 % (99 to 100 %) of it as shares of their ranges";
        assert_eq!(said(0.6), expected);
    }

    #[test]
    fn that_no_effect_is_needed_is_not_settled_where_what_is_left_alternates() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let said = |amplitude: f64| {
            let mut observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
            for (t, y) in observations.values[0].iter_mut().enumerate() {
                *y += if t % 2 == 0 { amplitude } else { -amplitude };
            }
            let problem = predictor.problem(&prior, &observations);
            let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
            diagnosis.attribution.explanations.sort_by_key(|of| of.name != "none");
            diagnosis.attribution.explanations[0].probability = 0.95;
            let mut verdicts = Verdicts::default();
            add(&mut verdicts, &problem, &diagnosis, 1).unwrap();
            verdicts.rows.remove(0)
        };
        assert_eq!(said(0.0).code, "none");
        let alternating = said(0.012);
        assert_eq!(alternating.code, "unsettled");
        assert!(
            alternating.text.contains("changes its sign with every reading or two"),
            "{}",
            alternating.text
        );
    }

    #[test]
    fn a_cause_is_not_settled_where_the_emulator_is_unsure_of_it() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let problem = predictor.problem(&prior, &Straight::measured(1.3, 0.6, 0.8, 0.01));
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        assert!(is_settled(&problem, &diagnosis));
        diagnosis.ignorance = 3.1;
        assert!(!is_settled(&problem, &diagnosis));
    }

    #[test]
    fn that_no_effect_is_needed_is_not_settled_by_a_noise_that_was_not_believed() {
        assert_eq!(answer("none", 0.85, false, 2.0).0, "none");
        assert_eq!(answer("none", 0.85, false, 5.9), ("unsettled".to_owned(), "none".to_owned()));
    }
}
