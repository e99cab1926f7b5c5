//! Effects that an emulator knows too little of to say that they are not the cause.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::attribute::attribution::closure::left;
use crate::attribute::attribution::{Explanation, MOST, RuledOut};
use crate::attribute::evidence::mode::{Mode, find, likeliest};
use crate::attribute::evidence::model::{Curve, Model, ln_prior};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Candidate, is_part};

/// An effect of the simulation, where it fits best.
#[derive(Clone, Debug)]
pub struct Untried {
    /// Its explanation, with a rest or without, whichever is the better one.
    pub place: usize,
    /// What the emulator does not know there, in units of noise and scatter.
    pub ignorance: f64,
    /// Share of the gap that it closes there.
    pub closes: f64,
    /// Where that is, if it is not where the explanation fits best.
    pub elsewhere: Option<Mode>,
}

/// What an emulator may not know, in units of noise and scatter.
pub const KNOWN: f64 = 1.0;

/// The same as a share of what the effect leaves of the gap: what is far more than the emulator's error is left in runs, too.
const OF_WHAT_IS_LEFT: f64 = 0.25;

/// Share of the noise within which two effects do the same: their curves, fitted to one measurement.
const SAME: f64 = 0.5;

/// ln odds to do the same as the first, by what the emulator knows and does not know, below which an effect is ruled out
/// even where it is not known. That one would is less improbable than that: effects are alike.
const COINCIDENCE: f64 = 75.0;

/// Places at which an effect that is known where it most likely does the same is asked once more, and how many times as wide as what
/// the emulator says of them they are drawn. Along what its parameters trade there may be no runs.
const ALONG: usize = 64;
const WIDER: f64 = 2.0;

/// Single effects of which the emulator knows too little, in the order of the explanations. Where something unknown comes first,
/// none of the candidates explains a measurement only if all have been tried; where effects do, no other is ruled out
/// that has not been tried. A vague emulator makes
/// a measurement improbable under the very effect that is in it, and what is improbable gets no runs.
pub fn untried(problem: &Problem<'_>, explanations: &[Explanation]) -> Vec<Untried> {
    let Some(first) = explanations.first().filter(|first| !first.is_base()) else {
        return Vec::new();
    };
    let is_single = |of: &Explanation| match of.hypothesis.as_slice() {
        [candidate] => matches!(problem.candidates[*candidate], Candidate::Simulated(_)),
        _ => false,
    };
    let is_better = |of: &Explanation| {
        let twin = explanations.iter().find(|o| o.hypothesis == of.hypothesis && o.has_rest != of.has_rest);
        twin.is_none_or(|twin| (of.ln_weight, of.has_rest) > (twin.ln_weight, twin.has_rest))
    };
    let is_rival = |of: &Explanation| !is_part(&of.hypothesis, &first.hypothesis);
    let is_asked = |of: &Explanation| {
        is_single(of) && is_better(of) && is_rival(of) && of.ruled_out != Some(RuledOut::Invisible)
    };
    let asked: Vec<(usize, &Explanation)> =
        explanations.iter().enumerate().filter(|(_, of)| is_asked(of)).collect();
    let is_asked_elsewhere = |of: &Explanation| !of.is_vague && (first.is_cause() || !of.closes_most());
    let is_base_needed = asked.iter().any(|(_, of)| is_asked_elsewhere(of));
    let base = if is_base_needed { nearest(problem, &[]) } else { None };
    let imitated = (is_base_needed && first.is_cause()).then(|| Imitated::of(first, problem));
    let untried = |(place, of): (usize, &Explanation)| {
        if of.is_vague {
            let ignorance = ignorance(problem, of);
            return Some(Untried { place, ignorance, closes: of.closes, elsewhere: None });
        }
        let base = base.as_ref().filter(|_| is_asked_elsewhere(of))?;
        let unknown_to = |known: f64| move |mode: Mode| there(problem, place, (of, mode), (base, known));
        match &imitated {
            Some(imitated) => imitated.by(&of.hypothesis, unknown_to(SAME)),
            None => nearest(problem, &of.hypothesis).and_then(unknown_to(KNOWN)),
        }
    };
    asked.into_par_iter().filter_map(untried).collect()
}

/// Where the emulator's mean would fit best, whatever it does not know: where it is vague an effect may even fit worse than
/// elsewhere, as a weak one that closes little.
fn nearest(problem: &Problem<'_>, hypothesis: &[usize]) -> Option<Mode> {
    let mut model = Model::new(problem, hypothesis, false).sure();
    find(&mut model, &[], &mut ChaCha8Rng::seed_from_u64(1)).into_iter().next()
}

/// What the effects that come first do, as a measurement of its own.
///
/// Whether another one does the same is not asked where that one fits best: what is known not to fit is far likelier to leave what
/// it leaves than anything unknown is to fit.
struct Imitated<'a> {
    /// The problem with their curve as the measurement.
    problem: Problem<'a>,
    /// The noise of it.
    nuisances: Vec<f64>,
    /// ln of their own density there, prior included.
    ln_density: f64,
}

impl<'a> Imitated<'a> {
    fn of(first: &Explanation, problem: &Problem<'a>) -> Self {
        let own = first.model(problem).plain();
        let best = own.with_noise(&first.best()[..own.len()], SAME);
        let aimed = problem.aimed_at(own.mean(&best));
        let model = Model::new(&aimed, &first.hypothesis, false);
        let ln_density = ln_density(&model, &best, &model.curve(&best));
        Self { ln_density, nuisances: best[own.curve_parameters()..].to_vec(), problem: aimed }
    }

    /// What is found first where another effect would do the same, by what the emulator knows and does not know: where it most
    /// likely does, then along what its parameters trade there, likeliest first. None of these is out of the question.
    fn by<T>(&self, hypothesis: &[usize], find: impl Fn(Mode) -> Option<T>) -> Option<T> {
        let model = Model::new(&self.problem, hypothesis, false);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let ahead = |mode: Mode| {
            let ln = ln_density(&model, mode.w.as_slice(), &mode.curve);
            (self.ln_density - ln < COINCIDENCE).then_some((ln, mode))
        };
        let (_, likeliest) = ahead(likeliest(&model, &self.nuisances, &mut random)?)?;
        let found = find(likeliest.clone());
        if found.is_some() {
            return found;
        }
        let along = likeliest.drawn_about(&model, ALONG, WIDER, &mut random);
        let mut along: Vec<(f64, Mode)> = along.into_iter().filter_map(ahead).collect();
        along.sort_by(|a, b| b.0.total_cmp(&a.0));
        along.into_iter().find_map(|(_, mode)| find(mode))
    }
}

/// ln density of a model's curve and parameters, but for what is believed of its noise.
fn ln_density(model: &Model<'_>, w: &[f64], curve: &Curve) -> f64 {
    model.ln_likelihood(w, curve) + ln_prior(&w[..model.curve_parameters()])
}

/// An effect at a place, if too little is known there to say what it leaves.
///
/// * `base` — where the base model's mean would fit best.
/// * `known` — what the emulator may not know.
fn there(
    problem: &Problem<'_>,
    place: usize,
    (of, mode): (&Explanation, Mode),
    (base, known): (&Mode, f64),
) -> Option<Untried> {
    let model = of.model(problem).plain();
    let before = left_at(problem, of, &Model::new(problem, &[], false), base.w.as_slice());
    let after = left_at(problem, of, &model, mode.w.as_slice());
    let ignorance = ignorance_at(problem, of, &model, mode.w.as_slice());
    let closes = 1.0 - left(before, after, 1.0);
    is_unknown(ignorance, after, known).then_some(Untried { place, ignorance, closes, elsewhere: Some(mode) })
}

/// What the emulator does not know where effects that come first fit best, if it is too much to call them the cause: its
/// mean leaves more than half of the gap there, and they come first only since so little is known of them.
///
/// * `left` — share of the gap that the mean curve of the first explanation leaves.
/// * `ignorance` — see [`ignorance`], of the same.
pub fn unproven(first: &Explanation, left: f64, ignorance: f64) -> Option<Untried> {
    let is_unproven = first.is_cause() && left > MOST && ignorance > KNOWN;
    is_unproven.then_some(Untried { place: 0, ignorance, closes: first.closes, elsewhere: None })
}

/// Whether the emulator knows too little where an explanation fits best to say what it leaves of the gap.
pub fn is_too_vague(problem: &Problem<'_>, of: &Explanation) -> bool {
    let left = left_at(problem, of, &of.model(problem), of.best());
    is_unknown(ignorance(problem, of), left, KNOWN)
}

/// Whether the emulator's error is too large to say what is left, both in units of noise and scatter, `known` being what it may be.
fn is_unknown(ignorance: f64, left: f64, known: f64) -> bool {
    ignorance > known.max(OF_WHAT_IS_LEFT * left)
}

/// Root mean square over all readings of what the emulator does not know where an explanation fits best, in
/// units of noise and scatter.
pub fn ignorance(problem: &Problem<'_>, of: &Explanation) -> f64 {
    ignorance_at(problem, of, &of.model(problem), of.best())
}

/// The same at parameters of a model, in units of an explanation's noise and scatter.
fn ignorance_at(problem: &Problem<'_>, of: &Explanation, model: &Model<'_>, w: &[f64]) -> f64 {
    uncertainty(problem, of, &model.curve(w).variance)
}

/// The same of what is not known of each component, as a variance, shape (components,).
pub(super) fn uncertainty(problem: &Problem<'_>, of: &Explanation, variance: &[f64]) -> f64 {
    let errors = problem.emulator_errors(variance);
    in_units_of_noise(problem, of, |i| errors.row(i).norm_squared())
}

/// Root mean square over all readings of what a model leaves at parameters, in the same units.
fn left_at(problem: &Problem<'_>, of: &Explanation, model: &Model<'_>, w: &[f64]) -> f64 {
    let residual = model.residual(&model.mean(w));
    in_units_of_noise(problem, of, |i| residual[i] * residual[i])
}

/// Root mean square of squares by reading, in units of scatter and the noise of an explanation, which is no more than
/// what is stated: one that came out larger may have taken in what the emulator does not know.
pub(super) fn in_units_of_noise(
    problem: &Problem<'_>,
    of: &Explanation,
    square: impl Fn(usize) -> f64,
) -> f64 {
    let mut scales = of.model(problem).nuisances(of.best()).scales;
    if problem.is_noise_stated {
        scales.iter_mut().for_each(|scale| *scale = scale.min(1.0));
    }
    let readings = problem.observed.len();
    let in_units = |i: usize| square(i) / problem.spread(problem.observable_of(i), &scales).powi(2);
    ((0..readings).map(in_units).sum::<f64>() / readings as f64).sqrt()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::next_runs::next_runs;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    /// Names of what is untried, and how many of 50 further runs have the effect, where something unknown comes first
    /// or the most probable; the emulator's variance, and a remainder of this height.
    fn of(variance: f64, remainder: f64, is_unknown_first: bool) -> (Vec<String>, usize) {
        let (predictor, prior) = (Straight::unsure(variance), Straight::prior());
        let mut values = Straight::measured(1.3, 0.6, 0.8, 0.01).values.remove(0);
        (0..STEPS).for_each(|t| values[t] += remainder * if t % 2 == 0 { 1.0 } else { -1.0 });
        let observations = Straight::observations(values);
        let problem = predictor.problem(&prior, &observations);
        let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
        if is_unknown_first {
            explanations.sort_by_key(|of| of.is_cause() || !of.has_rest);
        }
        let untried = untried(&problem, &explanations);
        let names = untried.iter().map(|of| explanations[of.place].name.clone()).collect();
        let runs = next_runs(&problem, &explanations, &untried, &[], (50, 1)).unwrap();
        (names, runs.iter().filter(|run| run[2] != 0.0).count())
    }

    #[test]
    fn something_unknown_is_the_answer_only_where_the_emulator_knows_the_effects() {
        let (known, _) = of(1e-8, 0.0, true);
        assert!(known.is_empty(), "{known:?}");
        let (unknown, runs) = of(2.5e-3, 0.0, true);
        assert!(unknown.len() == 1 && unknown[0].starts_with("wave"), "{unknown:?}");
        assert!(runs >= 40, "{runs}");
        let (of_a_cause, _) = of(2.5e-3, 0.0, false);
        assert!(of_a_cause.is_empty(), "{of_a_cause:?}");
    }

    #[test]
    fn a_rival_is_tried_before_another_effect_is_called_the_cause() {
        let prior = Straight::prior();
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let found = |variance: f64, strength: f64| {
            let predictor = Straight::unsure(variance);
            let observations = Straight::measured(1.3, 0.6, strength, 0.01);
            let problem = predictor.problem(&prior, &observations);
            let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
            explanations.sort_by_key(|of| of.name != "offset(y)");
            let untried = untried(&problem, &explanations);
            untried.iter().map(|of| explanations[of.place].name.clone()).collect::<Vec<_>>()
        };
        let rivals = found(2.5e-3, 0.8);
        assert!(rivals.len() == 1 && rivals[0].starts_with("wave"), "{rivals:?}");
        assert_eq!(found(1e-8, 0.8), Vec::<String>::new(), "what is known is ruled out by what it leaves");
        let predictor = Straight::unsure(2.5e-3);
        let problem = predictor.problem(&prior, &observations);
        let mut diagnosis = diagnose(&problem, 1, 1).unwrap();
        diagnosis.attribution.explanations.sort_by_key(|of| of.name != "offset(y)");
        diagnosis.untried = untried(&problem, &diagnosis.attribution.explanations);
        assert!(!diagnosis.is_unproven(), "the rival is not what comes first");
    }

    #[test]
    fn a_rival_is_tried_where_it_would_do_what_the_first_does_and_not_where_it_fits() {
        let rms = |a: &[f64], b: &[f64]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            (squares / a.len() as f64).sqrt()
        };
        let (predictor, prior) = (Straight::unsure(2.5e-3), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
        explanations.sort_by_key(|of| of.name != "offset(y)");
        let first = explanations[0].model(&problem).mean(explanations[0].best());
        let rival = explanations.iter().find(|of| of.name == "wave").unwrap();
        let model = rival.model(&problem);
        let there = Imitated::of(&explanations[0], &problem).by(&rival.hypothesis, Some).unwrap();
        let in_place = rms(&model.mean(there.w.as_slice()), &first);
        let fitted = rms(&model.mean(rival.best()), &first);
        assert!(in_place < 0.3 * fitted, "{in_place} {fitted}");
        // What is known not to do the same is out of the question.
        let (predictor, prior) = (Straight::unsure(1e-8), Straight::prior());
        let problem = predictor.problem(&prior, &observations);
        let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
        explanations.sort_by_key(|of| of.name != "wave");
        let none = explanations.iter().find(|of| of.name == "none").unwrap();
        assert!(Imitated::of(&explanations[0], &problem).by(&none.hypothesis, Some).is_none());
    }

    #[test]
    fn a_rival_that_is_known_where_it_most_likely_does_the_same_is_asked_along_what_it_trades_too() {
        let prior = Straight::prior();
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        // Where it is asked, b being unknown from here on.
        let found = |from: f64| {
            let predictor = Straight::unsure_from(from, 0.01);
            let problem = predictor.problem(&prior, &observations);
            let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
            explanations.sort_by_key(|of| of.name != "offset(y)");
            // Where it fits best it is known, whatever b is there.
            explanations.iter_mut().for_each(|of| of.is_vague = false);
            let rival = explanations.iter().position(|of| of.name == "wave").unwrap();
            let imitated = Imitated::of(&explanations[0], &problem);
            let likeliest = imitated.by(&explanations[rival].hypothesis, Some).unwrap();
            let b = |mode: &Mode| 1.0 + 0.5 * mode.w[1];
            let untried = untried(&problem, &explanations);
            (b(&likeliest), untried.first().map(|of| b(of.elsewhere.as_ref().unwrap())))
        };
        let (likeliest, asked) = found(f64::INFINITY);
        assert!(asked.is_none());
        let from = likeliest + 0.05;
        let (known, asked) = found(from);
        assert!(known < from && asked.is_some_and(|b| b >= from), "{known} {asked:?}");
    }

    #[test]
    fn an_effect_that_fits_best_where_it_is_known_is_asked_where_the_emulator_s_mean_fits_best_too() {
        // Where it is known it closes so much of the gap; where the mean fits, the emulator has this variance.
        let found = |closes: f64, variance: f64, remainder: f64| {
            let (predictor, prior) = (Straight::unsure(variance), Straight::prior());
            let mut observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
            observations.values[0].iter_mut().step_by(2).for_each(|y| *y += remainder);
            let problem = predictor.problem(&prior, &observations);
            let mut explanations = attribute(&problem, 1, 1).unwrap().explanations;
            explanations.sort_by_key(|of| of.is_cause() || !of.has_rest);
            explanations.iter_mut().for_each(|of| (of.is_vague, of.closes) = (false, closes));
            let untried = untried(&problem, &explanations);
            let runs = next_runs(&problem, &explanations, &untried, &[], (50, 1)).unwrap();
            let [Untried { ignorance, closes, elsewhere: Some(_), .. }] = untried.as_slice() else {
                return None;
            };
            assert!(*ignorance > KNOWN && *closes > 0.9, "{ignorance} {closes}");
            let strengths: Vec<f64> = runs.iter().map(|run| run[2]).filter(|&c| c != 0.0).collect();
            Some(strengths.iter().sum::<f64>() / strengths.len() as f64)
        };
        let strength = found(0.3, 2.5e-3, 0.0).unwrap();
        assert!((strength - 0.8).abs() < 0.1, "{strength}");
        assert!(found(0.3, 1e-8, 0.0).is_none());
        assert!(found(0.6, 2.5e-3, 0.0).is_none());
        assert!(found(0.3, 2.5e-3, 2.0).is_none());
    }

    #[test]
    fn what_comes_first_only_since_little_is_known_of_it_is_not_called_the_cause() {
        let prior = Straight::prior();
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let is_unproven = |variance: f64, left: f64| {
            let predictor = Straight::unsure(variance);
            let problem = predictor.problem(&prior, &observations);
            let explanations = attribute(&problem, 1, 1).unwrap().explanations;
            let wave = explanations.iter().find(|of| of.name == "wave").unwrap();
            unproven(wave, left, ignorance(&problem, wave)).is_some()
        };
        assert!(is_unproven(2.5e-3, 0.6));
        assert!(!is_unproven(2.5e-3, 0.4));
        assert!(!is_unproven(1e-8, 0.6));
    }

    #[test]
    fn what_leaves_far_more_than_the_emulator_errs_is_no_answer() {
        let (names, _) = of(2.5e-3, 2.0, true);
        assert!(names.is_empty(), "{names:?}");
    }
}
