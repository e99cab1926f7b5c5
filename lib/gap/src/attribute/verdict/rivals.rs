//! What comes next, what cannot be told from the first, and what would tell them apart.

use anyhow::Result;
use gl_table::verdict::Verdicts;

use crate::attribute::attribution::confounding::difference;
use crate::attribute::attribution::forecast::{Effort, effort};
use crate::attribute::attribution::told::{Told, told};
use crate::attribute::attribution::{Attribution, Explanation};
use crate::attribute::diagnosis::Diagnosis;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{is_part, name};
use crate::attribute::settled::SETTLED;
use gl_inference::path::short;

/// Which tests tell the cause from the nearest other one.
pub(super) fn add_told(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    /// A test with this gain tells them at 19 to 1 by itself.
    const TELLS: f64 = 5.89;
    let Some((rival, tests)) = told(problem, &diagnosis.attribution.explanations, diagnosis.first()) else {
        return;
    };
    let (by, others): (Vec<&Told>, Vec<&Told>) = tests.iter().partition(|told| told.gain() >= TELLS);
    if by.is_empty() {
        return;
    }
    let listed = |of: &[&Told]| {
        let each = of.iter().map(|told| format!("{} ({:.1} and {:.1})", told.test, told.first, told.rival));
        each.collect::<Vec<_>>().join(", ")
    };
    let mut text = format!(
        "it is told from {} by {}: what either leaves there, fitted to all tests, in standard deviations of noise and scatter",
        rival.name,
        listed(&by)
    );
    if !others.is_empty() {
        text += &format!("; not by {}", listed(&others));
    }
    let names: Vec<&str> = by.iter().map(|told| told.test.as_str()).collect();
    verdicts.add("told-by", names.join(","), text);
}

/// How much likelier effects are than the likeliest of the other candidates, and than something unknown alone: probabilities near one do not
/// show it, since the same effects with another one, or a rest, are what they leave room for.
pub(super) fn add_ahead(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) {
    let (first, explanations) = (diagnosis.first(), &diagnosis.attribution.explanations);
    let is_other = |of: &&Explanation| {
        of.is_cause() && of.hypothesis != first.hypothesis && !is_part(&first.hypothesis, &of.hypothesis)
    };
    let other = explanations.iter().filter(is_other).max_by(|a, b| a.evidence.ln.total_cmp(&b.evidence.ln));
    let than = |of: &Explanation, as_what: String| {
        let ln = first.evidence.ln - of.evidence.ln;
        match ln.exp() {
            ..1.5 => None,
            times @ ..1e3 => Some(format!("{} times as likely as {as_what}", short(times))),
            _ => Some(format!("e^{ln:.0} times as likely as {as_what}")),
        }
    };
    let effects = name(&first.hypothesis, &problem.candidates);
    let other = other.and_then(|of| {
        than(
            of,
            format!(
                "with {}, the likeliest of all other candidates",
                name(&of.hypothesis, &problem.candidates)
            ),
        )
    });
    let unknown =
        diagnosis.attribution.unknown().and_then(|of| than(of, "with something unknown alone".to_owned()));
    let than: Vec<String> = other.into_iter().chain(unknown).collect();
    if !than.is_empty() {
        let mut text = format!("with {effects} the measurement is {}", than.join(", and "));
        if first.has_rest && first.lost() > 0.0 {
            text += "; that it leaves so much of the gap counts against it all the same";
        }
        verdicts.add("ahead", &effects, text);
    }
}

/// What comes next, what cannot be told from the first, and what would tell them apart.
pub(super) fn add(verdicts: &mut Verdicts, problem: &Problem<'_>, diagnosis: &Diagnosis) -> Result<()> {
    let Attribution { explanations } = &diagnosis.attribution;
    let (first, of_first) = (&diagnosis.rows[0], diagnosis.first());
    let rival = explanations.iter().find(|of| !of.says_as(of_first));
    let is_open = diagnosis.stated() < SETTLED;
    if let (true, Some(rival)) = (is_open, rival) {
        let (rival, own) = (&rival.name, diagnosis.attribution.probability_of(rival));
        verdicts.add("next", rival, format!("not settled: next comes {rival} with probability {own:.2}"));
    }
    // The rival that a further measurement should tell from the first: one that it is confounded with, else
    // the next in line. Something unknown has no size that could be looked for: where nothing seems to be needed the
    // likeliest effect is what may be there.
    let is_said = is_open || !of_first.is_cause();
    let known = |of: &&Explanation| !of.is_unknown() && (!of_first.is_base() || of.is_cause());
    let likeliest =
        explanations.iter().find(|of| !of.says_as(of_first) && known(of) && of.ruled_out.is_none());
    let rival = if of_first.is_base() { likeliest } else { rival.filter(known) };
    let rival = diagnosis.confounded().or(rival.filter(|_| is_said));
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
            "neither further runs nor measurements like this one will tell {pair}, at the sizes that fit best: measure something else"
        ));
        return Ok(());
    };
    let (value, text) = match (measurements, runs) {
        (1, 0) => return Ok(()),
        (1, runs) => (
            format!("runs={runs}"),
            format!(
                "about {runs} further runs near the two (gl-gap-attribute --next-out) would tell {pair}, at the sizes that fit best"
            ),
        ),
        (many, 0) => (
            format!("measurements={many}"),
            format!(
                "the mean of about {many} measurements like this one would tell {pair}, at the sizes that fit best"
            ),
        ),
        (many, runs) => (
            format!("measurements={many},runs={runs}"),
            format!(
                "the mean of about {many} measurements like this one, with {runs} further runs near the two (gl-gap-attribute --next-out) would tell {pair}, at the sizes that fit best"
            ),
        ),
    };
    verdicts.add("effort", value, text);
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn where_nothing_is_needed_it_is_forecast_what_would_find_the_likeliest_effect() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.003, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        let order = |of: &Explanation| [!of.is_base(), !of.is_unknown(), of.name != "wave"];
        diagnosis.attribution.explanations.sort_by_key(order);
        let mut verdicts = Verdicts::default();
        add(&mut verdicts, &problem, &diagnosis).unwrap();
        let effort = verdicts.find("effort").unwrap();
        assert!(effort.text.contains("would tell wave from none"), "{}", effort.text);
    }

    #[test]
    fn how_much_likelier_than_the_nearest_other_cause_effects_are_is_said_however_near_one_their_probability_is()
     {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        let said = |ahead: [f64; 2], diagnosis: &mut Diagnosis| {
            let first = diagnosis.first().evidence.ln;
            for of in &mut diagnosis.attribution.explanations {
                match of.name.as_str() {
                    "offset(y)" => of.evidence.ln = first - ahead[0],
                    "unexplained" => of.evidence.ln = first - ahead[1],
                    _ if of.name.contains("offset(y)") => of.evidence.ln = first - 900.0,
                    _ => {}
                }
            }
            let mut verdicts = Verdicts::default();
            add_ahead(&mut verdicts, &problem, diagnosis);
            verdicts.rows.first().map(|row| row.text.clone())
        };
        assert_eq!(diagnosis.first().name, "wave");
        assert_eq!(
            said([170.0, 4f64.ln()], &mut diagnosis).unwrap(),
            "with wave the measurement is e^170 times as likely as with offset(y), the likeliest of all other candidates, and 4 times as likely as with something unknown alone"
        );
        assert_eq!(
            said([0.1, 4f64.ln()], &mut diagnosis).unwrap(),
            "with wave the measurement is 4 times as likely as with something unknown alone"
        );
        assert_eq!(said([0.1, -3.0], &mut diagnosis), None);
    }
}
