//! Parameters that are beyond what was believed of them, and bounds that the measurement leans on.

use std::collections::HashSet;

use gl_inference::prior::Prior;
use gl_table::verdict::Verdicts;

use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::lean::Lean;
use crate::attribute::attribution::marginals::{Marginal, marginals};
use crate::attribute::diagnosis::Diagnosis;
use crate::attribute::problem::Problem;
use gl_inference::path::short;

/// Parameters that are beyond what was believed of them with a probability of 0.95, under what comes first, or under the
/// same effects with a rest or without: a rest makes up for an effect that a bound cuts off. Where something unknown comes first,
/// under any other that is alive: it may come first since they are beyond.
pub(super) fn add_beyond(
    verdicts: &mut Verdicts,
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    believed: (&Prior, &str),
) {
    /// From this probability on another explanation is no outsider.
    const ALIVE: f64 = 0.1;
    let explanations = &diagnosis.attribution.explanations;
    let first = diagnosis.first();
    let is_asked = |of: &&Explanation| {
        (of.hypothesis == first.hypothesis || first.is_unknown()) && of.probability >= ALIVE
    };
    let others = explanations.iter().filter(|of| of.name != first.name).filter(is_asked);
    let (prior, source) = believed;
    let mut said = HashSet::new();
    for of in [first].into_iter().chain(others) {
        for Marginal { name, mean, sd, low, high, .. } in marginals(problem, of) {
            let Some(parameter) = prior.parameter(&name) else {
                continue;
            };
            let (side, bound) = if low > parameter.upper {
                ("upper", parameter.upper)
            } else if high < parameter.lower {
                ("lower", parameter.lower)
            } else {
                continue;
            };
            if !said.insert(name.clone()) {
                continue;
            }
            verdicts.add("beyond-prior", &name, format!(
                "under {} {name} is {} ± {}, beyond its {side} bound, {bound} in {source}: what was believed of it was wrong, or something imitates it; what follows holds with the wider bound",
                of.name, short(mean), short(sd)
            ));
        }
    }
}

pub(super) fn add_lean(verdicts: &mut Verdicts, lean: &Lean, diagnosis: &Diagnosis, bounds: &str) {
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

    /// Under which hypothesis something is beyond what was believed, where this one comes first and lies within it, and `wave`
    /// alone has this probability and does not.
    fn beyond(first: &str, alone: f64) -> Option<String> {
        let predictor = Straight::new();
        let (prior, believed) = Straight::beyond(0.5, 1.1);
        // 1.3 is in it.
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations).believing(&believed);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        let explanations = &mut diagnosis.attribution.explanations;
        explanations.sort_by_key(|of| (of.name != first, of.name != "wave"));
        // a = -3 + 8 of it.
        explanations[0].evidence.samples.iter_mut().for_each(|sample| sample[0] = 0.5);
        explanations[1].probability = alone;
        let mut verdicts = Verdicts::default();
        add_beyond(&mut verdicts, &problem, &diagnosis, (&believed, "params.txt"));
        verdicts.find("beyond-prior").map(|said| said.text.clone())
    }

    #[test]
    fn a_rest_that_makes_up_for_a_parameter_beyond_its_bound_is_looked_behind() {
        let said = beyond("wave+unexplained", 0.2).unwrap();
        assert!(said.starts_with("under wave a is 1.3 ± 0.0"), "{said}");
        assert!(said.contains("beyond its upper bound, 1.1 in params.txt"), "{said}");
        assert_eq!(beyond("wave+unexplained", 0.05), None);
    }

    #[test]
    fn behind_something_unknown_any_other_that_is_alive_is_looked_at() {
        assert!(beyond("unexplained", 0.2).is_some_and(|said| said.starts_with("under wave a is")));
        assert_eq!(beyond("unexplained", 0.05), None);
        assert_eq!(beyond("none", 0.2), None);
    }
}
