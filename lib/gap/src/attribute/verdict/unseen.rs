//! Effects that may be there all the same: the emulator knows too little of them, the measurement hides them, or could never show them.

use gl_table::verdict::Verdicts;

use super::{LITTLE, percent};
use crate::attribute::attribution::marginals::{Marginal, marginals};
use crate::attribute::attribution::{Explanation, RuledOut};
use crate::attribute::diagnosis::Diagnosis;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Candidate, name};
use gl_inference::path::short;

/// Effects that nothing can be said of yet, where something unknown comes first, or other effects.
pub(super) fn add_untried(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    let (untried, explanations) = (&diagnosis.untried, &diagnosis.attribution.explanations);
    let rivals = || untried.iter().filter(|of| of.place > 0 || !diagnosis.first().is_cause());
    let most = rivals().map(|of| of.ignorance).fold(0.0, f64::max);
    let mut names: Vec<String> =
        rivals().map(|of| name(&explanations[of.place].hypothesis, &problem.candidates)).collect();
    names.sort();
    if names.is_empty() {
        return;
    }
    let (code, other) = if diagnosis.first().is_cause() {
        ("rival-untried", "to say that none of them would do as well")
    } else {
        ("untried", "to rule them out")
    };
    verdicts.add(code, most, format!(
        "the emulator knows too little of {} {other}: where they fit best it is uncertain by up to {most:.1} times noise and scatter; further runs there (gl-gap-attribute --next-out) would tell",
        names.join(", ")
    ));
}

/// How large each effect may be where none is needed, or something unknown comes first that it may lie beside.
pub(super) fn add_hidden(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
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
            let parameter = problem.prior.parameter(&name);
            let off = parameter.and_then(|of| of.off).unwrap_or(0.0);
            let (times, unit) = match &problem.candidates[of.hypothesis[0]] {
                Candidate::Measured(error) => problem.told_in(error),
                _ => (
                    1.0,
                    parameter
                        .and_then(|of| of.unit.as_ref())
                        .map_or_else(String::new, |unit| format!(" {unit}")),
                ),
            };
            // From one side of its value off to the other: whatever is between shows no more.
            let from = match parameter {
                Some(of) if off <= of.lower => String::new(),
                _ => format!(" from {}", short(times * low.min(off))),
            };
            format!("{name}{from} up to {}{unit}", short(times * high.max(off)))
        };
        let within: Vec<String> = of_effect.map(within).collect();
        let effect = name(&of.hypothesis, &problem.candidates);
        let text = if first.has_rest {
            format!(
                "{effect} may be in it, too, beside what is unknown: {} (90 % interval), which closes {} % of the gap",
                within.join(", "),
                percent(of.closes)
            )
        } else {
            format!("{effect} may be there and not show: {} (90 % interval)", within.join(", "))
        };
        verdicts.add("may-hide", &effect, text);
    }
}

/// Effects that cannot show in the measurement, and are no candidates.
pub(super) fn add_invisible(verdicts: &mut Verdicts, diagnosis: &Diagnosis) {
    for of in &diagnosis.attribution.explanations {
        if of.ruled_out == Some(RuledOut::Invisible) && !of.has_rest {
            verdicts.add("invisible", &of.name, format!(
                "{} cannot show in this measurement: within its bounds it stays below noise and scatter, or the base parameters absorb it; it is no candidate here",
                of.name
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

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
        assert!(text.ends_with("(90 % interval), which closes 30 % of the gap"), "{text}");
        assert!(said_where(-3.0, 0.3).is_none() && said_where(-1.0, 0.04).is_none());
        said_where(-1.0, 0.6);
        diagnosis.rows[0].confounded = vec!["wave+unexplained".to_owned()];
        assert!(said(&diagnosis).is_none(), "it is said there, and more");
    }

    #[test]
    fn the_size_of_an_error_of_the_rig_that_may_hide_is_in_the_units_of_what_it_acts_on() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations).in_units(&"y=kN".parse().unwrap());
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
        diagnosis.rows[0].confounded = Vec::new();
        let unknown = diagnosis.first().evidence.ln;
        let is_offset = |of: &&mut Explanation| of.name == "offset(y)+unexplained";
        let offset = diagnosis.attribution.explanations.iter_mut().find(is_offset).unwrap();
        (offset.evidence.ln, offset.closes, offset.is_behind, offset.ruled_out) = (unknown, 0.3, false, None);
        // As a share of the range, by its samples.
        let effect = problem.candidates.iter().find_map(|candidate| match candidate {
            Candidate::Measured(effect) => Some(effect),
            Candidate::Simulated(_) => None,
        });
        let place = problem.prior.base().len();
        let shares: Vec<f64> =
            offset.evidence.samples.iter().map(|sample| effect.unwrap().size(sample[place])).collect();
        let weights = &offset.evidence.weights;
        let high = gl_numeric::statistics::Quantiles::new(&shares, weights).at(0.95);
        let mut verdicts = Verdicts::default();
        add_hidden(&mut verdicts, &problem, &diagnosis);
        let text = &verdicts.rows.iter().find(|row| row.value == "offset(y)").unwrap().text;
        let expected = format!(" up to {} kN (90 % interval)", short((high * problem.ranges[0]).max(0.0)));
        assert!(text.contains(&expected), "{text}, {expected}");
    }
}
