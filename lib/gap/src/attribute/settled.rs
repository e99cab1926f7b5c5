//! Whether a diagnosis is settled: what it would take to say it without reserve.

use crate::attribute::attribution::untried::{KNOWN, Untried, ignorance};
use crate::attribute::attribution::{Explanation, MOST, NEARLY_AS_LIKELY};
use crate::attribute::diagnosis::Diagnosis;
use crate::attribute::evidence::adequacy::FITS;
use crate::attribute::problem::Problem;
use crate::noise::OTHER_NOISE;
use gl_inference::fit::{Fit, test};

/// Below this probability a hypothesis is not settled.
pub const SETTLED: f64 = 0.8;

/// Uncertainty of the emulator where a cause fits best, in units of noise and scatter, from which it is not settled: what fits
/// there may be the emulator's error.
const UNSURE: f64 = 3.0;

/// Whether what comes first is settled: probable, shown by runs, within the bounds, and without a rival that is not ruled out.
pub fn is_settled(problem: &Problem<'_>, diagnosis: &Diagnosis) -> bool {
    let first = diagnosis.first();
    if diagnosis.stated() < SETTLED || !diagnosis.leans.is_empty() || diagnosis.is_unproven() {
        false
    } else if first.is_cause() {
        let is_tried = diagnosis.untried.is_empty();
        let has_rival = !is_tried || diagnosis.confounded().is_some() || !is_clear_of_unknown(diagnosis);
        !has_rival && !base_fits(problem, diagnosis) && diagnosis.ignorance < UNSURE
    } else if first.has_rest {
        !has_rival_of_unknown(diagnosis) && !may_be_noise(diagnosis)
    } else {
        first.doubted() == 0.0 && base_misfit(problem, diagnosis).is_none()
    }
}

/// Whether something unknown alone is no rival to what comes first.
pub fn is_clear_of_unknown(diagnosis: &Diagnosis) -> bool {
    diagnosis.attribution.unknown().is_none_or(|unknown| diagnosis.first().is_clear_of(unknown))
}

/// Whether the base model fits as well as what comes first, so that nothing has to be explained: not by a larger noise, nor by
/// calling more readings far off.
pub fn base_fits(problem: &Problem<'_>, diagnosis: &Diagnosis) -> bool {
    let (base, first) = (diagnosis.attribution.base(), diagnosis.first());
    base.fits.is_some_and(|fits| fits > FITS)
        && !needs_more_noise(problem, base, first)
        && base.singular.outliers.len() <= first.singular.outliers.len()
        && ignorance(problem, base) <= KNOWN
}

/// Whether an effect may do what something unknown does that comes first.
fn has_rival_of_unknown(diagnosis: &Diagnosis) -> bool {
    may_close(diagnosis).is_some() || diagnosis.confounded().is_some()
}

/// Whether something unknown comes first without an effect as its rival, and the measurement is nearly as likely with the base
/// model alone: only what was believed of the noise tells them apart, and no run would.
pub fn may_be_noise(diagnosis: &Diagnosis) -> bool {
    let (base, first) = (diagnosis.attribution.base(), diagnosis.first());
    let is_near = first.evidence.ln - base.evidence.ln < NEARLY_AS_LIKELY;
    first.is_unknown() && is_near && !has_rival_of_unknown(diagnosis)
}

/// What the base model leaves where that is no noise as it was stated, by the test that all tools share. Where the
/// simulation's scatter, or what the emulator does not know, is a part of what is left, only that it alternates is said.
pub fn base_misfit(problem: &Problem<'_>, diagnosis: &Diagnosis) -> Option<Fit> {
    /// So much more than the noise alone is not noise alone.
    const MORE: f64 = 1.1;
    /// What an emulator does not know is smooth: of less than this nothing is seen.
    const UNSEEN: f64 = 0.3;
    let base = diagnosis.attribution.base();
    let scales = scales(problem, base);
    let noise = |j: usize| problem.noise_variance(j, scales[j]).sqrt();
    let is_noise_alone = (0..problem.ranges.len()).all(|j| problem.spread(j, &scales) < MORE * noise(j));
    let fit = left(problem, base, &scales);
    let is_all_noise = is_noise_alone && ignorance(problem, base) <= UNSEEN;
    Some(fit).filter(|fit| fit.alternation.is_some() || is_all_noise && fit.is_bad())
}

/// The correlation of neighbours, or of every second reading, in what an explanation leaves, where that alternates.
pub fn alternation_left(problem: &Problem<'_>, of: &Explanation) -> Option<f64> {
    left(problem, of, &scales(problem, of)).alternation
}

/// The noise of each observable as it was stated, over what was stated, or as an explanation takes it.
fn scales(problem: &Problem<'_>, of: &Explanation) -> Vec<f64> {
    if problem.is_noise_stated {
        vec![1.0; problem.ranges.len()]
    } else {
        of.model(problem).nuisances(of.best()).scales
    }
}

/// The test of what an explanation leaves, in units of such a noise.
fn left(problem: &Problem<'_>, of: &Explanation, scales: &[f64]) -> Fit {
    let left = |j: usize| -> Vec<f64> {
        let left = |i: usize| {
            // One that is far off says nothing of the others.
            if of.singular.outliers.contains(&i) {
                0.0
            } else {
                (problem.observed[i] - of.evidence.mean[i]) / (scales[j] * problem.units[i])
            }
        };
        problem.own(j).map(left).collect()
    };
    let all: Vec<Vec<f64>> = (0..problem.ranges.len()).map(left).collect();
    test(&all, of.model(problem).curve_parameters())
}

/// Whether an explanation fits only by a noise that is larger than another one needs.
fn needs_more_noise(problem: &Problem<'_>, of: &Explanation, than: &Explanation) -> bool {
    let scales = |of: &Explanation| of.model(problem).nuisances(of.best()).scales;
    scales(of).iter().zip(scales(than)).any(|(of, than)| *of > OTHER_NOISE * than)
}

/// The effect that closes most of the gap of those that the emulator knows too little of, where something unknown comes
/// first, and what is not known of it; of those that close most of it, or with which the measurement is as likely.
pub fn may_close(diagnosis: &Diagnosis) -> Option<(&Explanation, &Untried)> {
    let explanations = &diagnosis.attribution.explanations;
    let untried = diagnosis.untried.iter().map(|of| (&explanations[of.place], of));
    let open =
        untried.filter(|(of, untried)| untried.closes >= MOST || of.is_as_likely_as(diagnosis.first()));
    open.max_by(|a, b| a.1.closes.total_cmp(&b.1.closes))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::untried::untried;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn an_effect_that_is_not_known_may_close_the_gap_if_it_closes_most_or_is_as_likely() {
        let (predictor, prior) = (Straight::unsure(2.5e-3), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| !of.is_unknown());
        diagnosis.untried = untried(&problem, &diagnosis.attribution.explanations);
        let unknown = diagnosis.first().evidence.ln;
        let place = diagnosis.untried[0].place;
        let mut may_close_by = |closes: f64, ahead: f64| {
            diagnosis.untried[0].closes = closes;
            diagnosis.attribution.explanations[place].evidence.ln = unknown + ahead;
            may_close(&diagnosis).is_some()
        };
        assert!(may_close_by(0.6, -1.0) && may_close_by(0.3, 1.0) && !may_close_by(0.3, -1.0));
    }

    #[test]
    fn what_alternates_is_seen_beside_an_effect() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let left = |size: f64| {
            let alternating = |t: usize| if t.is_multiple_of(2) { size } else { -size };
            let values = Straight::curve(1.3, 0.6, 0.8);
            let values = values.into_iter().enumerate().map(|(t, y)| y + alternating(t)).collect();
            let problem = predictor.problem(&prior, &Straight::observations(values));
            let diagnosis = diagnose(&problem, 1, 1).unwrap();
            assert_eq!(diagnosis.first().hypothesis, [0]);
            alternation_left(&problem, diagnosis.first())
        };
        assert!(left(0.015).is_some_and(|correlation| correlation < -0.5));
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        assert_eq!(alternation_left(&problem, diagnose(&problem, 1, 1).unwrap().first()), None);
    }

    #[test]
    fn a_cause_that_cannot_be_told_from_another_one_is_not_settled() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        assert!(diagnosis.first().name == "wave" && is_settled(&problem, &diagnosis));
        diagnosis.rows[0].confounded.push("offset(y)".to_owned());
        assert!(!is_settled(&problem, &diagnosis));
    }
}
