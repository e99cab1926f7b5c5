//! How the readings scatter, where it is otherwise than stated, and which are far off.

use gl_table::verdict::Verdicts;

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;
use crate::noise::{OTHER_NOISE, add_scales};
use gl_inference::path::short;

/// Above this correlation from one reading to the next the noise is said to be correlated.
const CORRELATED: f64 = 0.35;

/// The observables whose readings scatter otherwise than stated under an explanation, and how many times that.
pub fn found<'a>(problem: &'a Problem<'_>, of: &Explanation) -> Vec<(&'a str, f64)> {
    let scales = of.model(problem).nuisances(of.best()).scales;
    let is_another = |(_, scale): &(&str, f64)| {
        problem.is_noise_stated && !(1.0 / OTHER_NOISE..OTHER_NOISE).contains(scale)
    };
    problem.observables.iter().map(String::as_str).zip(scales).filter(is_another).collect()
}

/// The observable whose noise under an explanation is most like a rest, and how many times what was stated it is: larger than
/// that, and alike from reading to reading. A noise that is stated at half is white, and one that is correlated as large as it
/// was stated; both at once are oftener something smooth that the explanation leaves.
pub(super) fn like_a_rest<'a>(problem: &'a Problem<'_>, of: &Explanation) -> Option<(&'a str, f64)> {
    if !problem.is_noise_stated || of.has_rest {
        return None;
    }
    let nuisances = of.model(problem).nuisances(of.best());
    let both = nuisances.scales.into_iter().zip(nuisances.phi);
    let like = problem
        .observables
        .iter()
        .zip(both)
        .filter(|(_, (scale, phi))| *scale > OTHER_NOISE && *phi > CORRELATED);
    let most = like.max_by(|a, b| a.1.0.total_cmp(&b.1.0));
    most.map(|(name, (scale, _))| (name.as_str(), scale))
}

/// What is said of the noise of an observable: how many times what was stated it is, and how neighbours correlate, where either
/// is worth a word. One that is correlated looks smaller than it is in so few readings.
struct Said<'a> {
    name: &'a str,
    scale: Option<f64>,
    correlation: Option<f64>,
}

fn said<'a>(problem: &'a Problem<'_>, of: &Explanation) -> Vec<Said<'a>> {
    let found = found(problem, of);
    let phi = of.model(problem).nuisances(of.best()).phi;
    let said = |(name, phi): (&'a String, f64)| {
        let correlation = Some(phi).filter(|phi| *phi > CORRELATED);
        let scale = found.iter().find(|(found, _)| found == name).map(|(_, scale)| *scale);
        let scale = scale.filter(|scale| *scale > 1.0 || correlation.is_none());
        Said { name, scale, correlation }
    };
    problem.observables.iter().zip(phi).map(said).collect()
}

/// The noise under an explanation, where it is otherwise than stated or correlated.
pub(super) fn told(problem: &Problem<'_>, of: &Explanation) -> String {
    let of_observable = |Said { name, scale, correlation }: Said<'_>| {
        let scale = scale.map(|scale| format!("{} times what was stated", short(scale)));
        let correlated =
            correlation.map(|phi| format!("correlated from one reading to the next by about {phi:.1}"));
        let both: Vec<String> = scale.into_iter().chain(correlated).collect();
        (!both.is_empty()).then(|| format!("of {name} {}", both.join(", and ")))
    };
    let all: Vec<String> = said(problem, of).into_iter().filter_map(of_observable).collect();
    if all.is_empty() { "noise alone".to_owned() } else { format!("a noise {}", all.join(", ")) }
}

/// How the readings scatter, if otherwise than stated, and which are far off.
pub(super) fn add(verdicts: &mut Verdicts, problem: &Problem<'_>, first: &Explanation) {
    let said = said(problem, first);
    let scales: Vec<(&str, f64)> = said.iter().filter_map(|of| Some((of.name, of.scale?))).collect();
    add_scales(verdicts, &scales, "the verdict is by what they do");
    for Said { name, correlation, .. } in &said {
        if let Some(phi) = correlation {
            verdicts.add("noise-correlation", phi, format!(
                "what is left of {name} is correlated from one reading to the next by about {phi:.1}, and counts as noise"
            ));
        }
    }
    let outliers = problem.by_observable(&first.singular.outliers);
    for (j, (name, steps)) in problem.observables.iter().zip(outliers).enumerate() {
        let test = problem.test_of(j);
        let (readings, at): (Vec<String>, Vec<String>) =
            steps.iter().map(|&step| (step.to_string(), short(test.path.control()[step]))).unzip();
        let (which, are) = match readings.len() {
            0 => continue,
            1 => ("reading", "looks like an outlier, and counts"),
            _ => ("readings", "look like outliers, and count"),
        };
        let unit = test.control_unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
        let text = format!(
            "{which} {} of {name}, at {} {}{unit}, {are} for little (counted from 0)",
            all_of(&readings),
            test.control_name,
            all_of(&at)
        );
        verdicts.add("outliers", readings.join(","), text);
    }
}

/// A list in words.
pub(super) fn all_of(list: &[String]) -> String {
    match list {
        [others @ .., last] if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => list.concat(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_list_is_told_with_and_before_the_last() {
        let told = |list: &[&str]| all_of(&list.iter().map(|&of| of.to_owned()).collect::<Vec<_>>());
        assert_eq!(
            [told(&["8"]), told(&["8", "19"]), told(&["0", "4", "36"])],
            ["8", "8 and 19", "0, 4 and 36"]
        );
    }
}
