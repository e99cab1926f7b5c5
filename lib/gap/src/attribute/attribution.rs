//! Which effect explains the gap: the probability of every hypothesis.
//!
//! * Before: [`visible`](mod@visible), which candidates the measurement can show at all.
//! * What evidence alone does not settle: [`closure`], how far effects close the gap; [`untried`], those that the emulator
//!   knows too little of; [`lean`], whether the truth may lie beyond the bounds.
//! * After: [`confounding`], which hypotheses the measurement cannot tell apart, [`told`], which of several tests does, and
//!   [`forecast`], what it would take to; [`rest`], what else there is and what that goes with; [`marginals`] and [`draws`],
//!   what is known of the parameters then.

pub mod closure;
pub mod confounding;
pub mod draws;
pub mod forecast;
pub mod lean;
pub mod marginals;
pub mod rest;
pub mod told;
pub mod untried;
pub mod visible;

use std::cmp::Reverse;

use anyhow::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::attribute::attribution::closure::closes;
use crate::attribute::attribution::untried::is_too_vague;
use crate::attribute::attribution::visible::visible;
use crate::attribute::evidence::adequacy::{FITS, INADEQUATE, predictive_probability};
use crate::attribute::evidence::mode::{Mode, find};
use crate::attribute::evidence::model::{Model, SD_OF_LN_NOISE};
use crate::attribute::evidence::{COARSE, Evidence, FINE, evidence};
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::{Hypothesis, hypotheses, is_part, ln_prior_odds, name};
use crate::noise::OTHER_NOISE;
use gl_numeric::statistics::ln_sum_exp;
use gl_progress::stage;

/// What stands for something that is no candidate, alone or behind the effects that are in beside it.
pub const UNEXPLAINED: &str = "unexplained";

/// Share of the gap that a cause closes at the least: what closes less is a part of what is behind it.
pub const MOST: f64 = 0.5;

/// One hypothesis after the measurement.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The candidates that are in.
    pub hypothesis: Hypothesis,
    /// Whether something is at work, too, which is no candidate: a rest.
    pub has_rest: bool,
    /// `none`, or the names of the effects joined by `+`; with a rest `unexplained` comes last.
    pub name: String,
    /// Probability given the measurement.
    pub probability: f64,
    /// Natural logarithm of the probability before what does not fit, or closes little, was ruled out.
    pub ln_weight: f64,
    /// Why it has no probability, if so.
    pub ruled_out: Option<RuledOut>,
    /// Whether it is so far behind that its evidence is coarse.
    pub is_behind: bool,
    /// Its evidence and posterior.
    pub evidence: Evidence,
    /// Readings that are far off under it, ascending.
    pub outliers: Vec<usize>,
    /// What its effects add to the curve, shape (observables · steps).
    pub added: Vec<f64>,
    /// Predictive probability of a measurement as odd as this one, where it was worth a look.
    pub fits: Option<f64>,
    /// Share of the base model's gap that its effects close by themselves.
    pub closes: f64,
    /// By how many times the readings of some observable scatter more than was stated; 1 where nothing was.
    pub noise_scale: f64,
    /// Whether the emulator knows too little where it fits best to say how much it closes.
    pub is_vague: bool,
}

/// Why a hypothesis has no probability.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RuledOut {
    /// It does not fit; what it was worth beforehand goes to the same effects with a rest.
    Misfit,
    /// Its effects close too little of the gap to be its cause; that goes to `unexplained`.
    ClosesLittle,
    /// Nothing that an effect of it can do would be seen.
    Invisible,
}

impl RuledOut {
    /// In a word, for a table.
    pub fn word(self) -> &'static str {
        match self {
            Self::Misfit => "misfit",
            Self::ClosesLittle => "closes-little",
            Self::Invisible => "invisible",
        }
    }
}

impl Explanation {
    /// Its model.
    pub fn model<'a>(&self, problem: &'a Problem<'a>) -> Model<'a> {
        let mut model = Model::new(problem, &self.hypothesis, self.has_rest);
        model.set_form(&self.added, &self.outliers);
        model
    }

    /// Its most probable parameters.
    pub fn best(&self) -> &[f64] {
        self.evidence.modes[0].w.as_slice()
    }

    /// What is kept of its probability beside something else, by the share of the gap that it closes.
    fn kept(&self) -> f64 {
        along(if self.hypothesis.len() > 1 { &CLOSE_TOGETHER } else { &CLOSES }, self.closes)
    }

    /// What is kept of its probability where it is alone: all of it where the emulator cannot say how much it closes.
    fn kept_alone(&self) -> f64 {
        let is_asked = self.is_cause() && !self.may_have_rest() && !self.is_vague;
        if is_asked { along(&CLOSES, self.closes) } else { 1.0 }
    }

    /// Whether it is a single effect beside a rest that is so far ahead of something unknown alone that it is in it, whatever else
    /// is: what is no candidate is not imitated like that by what closes anything.
    fn is_far_ahead(&self, unknown: &Self) -> bool {
        let is_single = self.has_rest && self.hypothesis.len() == 1;
        is_single && self.kept() > 0.0 && self.ahead_of(unknown) > FAR_AHEAD
    }

    /// Whether something unknown alone is no rival to it: it has no rest, closes nearly all beside one, or is well ahead.
    pub fn is_clear_of(&self, unknown: &Self) -> bool {
        !self.has_rest || along(&CLOSES, self.closes) >= 1.0 || self.ahead_of(unknown) > BEHIND
    }

    /// ln odds by which it is ahead of something unknown alone, after what it loses.
    fn ahead_of(&self, unknown: &Self) -> f64 {
        self.ln_weight - unknown.ln_weight - self.lost()
    }

    /// ln odds that it loses, since its effects leave as much to something else as they do.
    fn lost(&self) -> f64 {
        if self.is_cause() && self.may_have_rest() && !self.is_vague {
            along(&LEAVES_MUCH, self.closes)
        } else {
            0.0
        }
    }

    /// Whether something else is at work, too: a rest, or more noise than was stated, which may be one by another name.
    fn may_have_rest(&self) -> bool {
        self.has_rest || self.has_more_noise()
    }

    /// Whether its effects close half of the gap or more, as a cause does.
    pub fn closes_most(&self) -> bool {
        self.closes >= MOST
    }

    /// Whether the measurement is at least as likely under it as under another one: only what was believed beforehand, and
    /// what effects lose that leave much, can put that first then.
    pub fn is_as_likely_as(&self, other: &Self) -> bool {
        self.evidence.ln >= other.evidence.ln
    }

    /// Whether it fits with the noise that was stated.
    pub fn fits_well(&self) -> bool {
        !self.has_more_noise() && self.fits.is_some_and(|fits| fits > FITS)
    }

    /// Whether it takes a noise that is clearly larger than stated, which may be a rest by another name.
    pub fn has_more_noise(&self) -> bool {
        self.noise_scale > OTHER_NOISE
    }

    /// Share of its probability that is doubted, since it takes a noise that was not believed.
    pub fn doubted(&self) -> f64 {
        along(&DOUBTED, self.noise_scale.ln() / SD_OF_LN_NOISE)
    }

    /// Whether it names effects as the cause.
    pub fn is_cause(&self) -> bool {
        !self.hypothesis.is_empty()
    }

    /// Whether it is the base model and nothing else.
    pub fn is_base(&self) -> bool {
        !self.is_cause() && !self.has_rest
    }

    /// Whether it is something unknown and nothing else.
    pub fn is_unknown(&self) -> bool {
        !self.is_cause() && self.has_rest
    }

    /// Whether another one says the same: the same effects with a rest and without are one cause.
    pub fn says_as(&self, other: &Self) -> bool {
        self.hypothesis == other.hypothesis && self.is_unknown() == other.is_unknown()
    }
}

/// Every hypothesis after the measurement.
#[derive(Clone, Debug)]
pub struct Attribution {
    /// All hypotheses, the most probable cause first, with a rest and without next to each other.
    pub explanations: Vec<Explanation>,
}

impl Attribution {
    /// The most probable explanation.
    pub fn first(&self) -> &Explanation {
        &self.explanations[0]
    }

    /// The base model, and nothing else.
    pub fn base(&self) -> &Explanation {
        self.explanations.iter().find(|of| of.is_base()).unwrap_or(self.first())
    }

    /// The base model and a rest.
    pub fn unknown(&self) -> Option<&Explanation> {
        self.explanations.iter().find(|of| of.is_unknown())
    }

    /// Probability of what an explanation says, of its effects with a rest and without: at most 1, which a sum of shares may
    /// exceed by rounding.
    pub fn probability_of(&self, what: &Explanation) -> f64 {
        let same = self.explanations.iter().filter(|of| of.says_as(what));
        same.map(|of| of.probability).sum::<f64>().min(1.0)
    }

    /// The most probable cause of those that name effects, whether it is likely or not, with a rest or without, whichever is
    /// more probable; of several that are out of the question the one that closes most.
    pub fn nearest(&self) -> Option<&Explanation> {
        let causes = self.explanations.iter().filter(|of| of.is_cause());
        causes.max_by(|a, b| {
            let by_probability = self.probability_of(a).total_cmp(&self.probability_of(b));
            let by_probability = by_probability.then(a.probability.total_cmp(&b.probability));
            by_probability.then(a.closes.total_cmp(&b.closes))
        })
    }
}

/// Hypotheses within this of the most probable one (natural logarithm) are asked whether they fit.
const CLOSE: f64 = 5.0;

/// Hypotheses further below the most probable one (natural logarithm, to second order about their
/// modes) are out of the question, and their evidence is estimated coarsely.
const BEHIND: f64 = 10.0;

/// What is kept of the probability of effects by the share of the gap that they close by themselves; in between in
/// proportion. What closes little is no part of the cause, and explains nothing where it is alone. What closes half beside
/// something else, a rest or more noise than was stated, may be one, or may imitate something that is no candidate, and is not
/// settled. On which seeds these numbers were chosen is in docs/diagnosis-accuracy.md.
const CLOSES: [(f64, f64); 3] = [(0.15, 0.0), (0.35, 0.6), (0.9, 1.0)];

/// The same of several effects together, which imitate more.
const CLOSE_TOGETHER: [(f64, f64); 3] = [(0.35, 0.0), (0.7, 0.5), (1.0, 1.0)];

/// ln odds that effects lose beside something else that is at work, too, by the share of the gap that they close by
/// themselves: what leaves more than it closes is likelier a part of something unknown that it imitates. One that closes seven
/// tenths is what a right one is beside a remainder nearly as large as itself, and loses nothing. What nothing smooth imitates is ahead
/// of a rest alone by tens, and hardly notices.
const LEAVES_MUCH: [(f64, f64); 2] = [(0.5, 6.0), (0.7, 0.0)];

/// Beyond so many ln odds something unknown alone is out of the question, after all that an effect beside a rest loses.
const FAR_AHEAD: f64 = 20.0;

/// What is kept of the probability of something unknown where the base model fits, and there is no sign of it.
const WITHOUT_A_SIGN: f64 = 0.4;

/// Share of the probability of the base model that goes to something unknown, by how much larger its noise is than what was
/// stated, in standard deviations of what is believed of the logarithm: what is as rough as noise looks like it.
const DOUBTED: [(f64, f64); 2] = [(2.0, 0.0), (3.0, 0.5)];

/// The second coordinate on a line through points in ascending order, level beyond its ends.
fn along(points: &[(f64, f64)], x: f64) -> f64 {
    let rises = points.windows(2).map(|ends| {
        let [(x0, y0), (x1, y1)] = [ends[0], ends[1]];
        (y1 - y0) * ((x - x0) / (x1 - x0)).clamp(0.0, 1.0)
    });
    points[0].1 + rises.sum::<f64>()
}

/// A hypothesis with what a search found.
struct Found<'a> {
    place: usize,
    model: Model<'a>,
    modes: Vec<Mode>,
}

/// Weigh every set of up to `largest` candidates against the measurement, alone and with a rest.
///
/// # Errors
/// If no hypothesis can be evaluated.
pub fn attribute(problem: &Problem<'_>, largest: usize, seed: u64) -> Result<Attribution> {
    let visible = visible(problem, seed)?;
    let is_visible = |set: &Hypothesis| set.iter().all(|&candidate| visible[candidate]);
    let count = visible.iter().filter(|visible| **visible).count();
    let mut sets = hypotheses(problem.candidates.len(), largest);
    sets.retain(|set| set.len() < 2 || is_visible(set));
    let random = |place: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(place as u64);
        random
    };
    let plain = search(problem, &sets, None, &random);
    let with_rest = search(problem, &sets, Some(&plain), &|place| random(sets.len() + place));
    let found: Vec<Found<'_>> = plain.into_iter().chain(with_rest).collect();
    let ln_odds = |found: &Found<'_>| {
        let set = &sets[found.place];
        if is_visible(set) { ln_prior_odds(set, found.model.has_rest(), count) } else { f64::NEG_INFINITY }
    };
    let rough: Vec<f64> = found
        .iter()
        .map(|found| {
            let parts: Vec<f64> = found.modes.iter().map(Mode::ln_evidence).collect();
            ln_sum_exp(&parts) + ln_odds(found)
        })
        .collect();
    let highest = rough.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weighing = stage("weighing hypotheses", found.len());
    let mut explanations: Vec<Explanation> = found
        .into_par_iter()
        .enumerate()
        .map(|(place, found)| {
            let is_behind = highest - rough[place] >= BEHIND;
            let aim = if is_behind { COARSE } else { FINE };
            let set = sets[found.place].clone();
            let ln_odds = ln_odds(&found);
            let Found { model, modes, .. } = found;
            let evidence = evidence(&model, modes, aim, &mut random(2 * sets.len() + place))?;
            Ok(Explanation {
                name: full_name(problem, &set, model.has_rest()),
                has_rest: model.has_rest(),
                probability: 0.0,
                ln_weight: evidence.ln + ln_odds,
                ruled_out: (!is_visible(&set)).then_some(RuledOut::Invisible),
                is_behind,
                outliers: model.outliers().to_vec(),
                added: model.added(evidence.modes[0].w.as_slice()),
                evidence,
                fits: None,
                closes: 0.0,
                noise_scale: 1.0,
                is_vague: false,
                hypothesis: set,
            })
        })
        .inspect(|_| weighing.advance())
        .collect::<Result<_>>()?;
    drop(weighing);
    let whole = ln_sum_exp(&explanations.iter().map(|of| of.ln_weight).collect::<Vec<_>>());
    for of in &mut explanations {
        of.ln_weight -= whole;
        of.probability = of.ln_weight.exp();
    }
    look_closer(problem, &mut explanations)?;
    rule_out(&mut explanations);
    sort(&mut explanations);
    Ok(Attribution { explanations })
}

/// The most probable cause first: the same effects with a rest and without are one cause, and stand together.
fn sort(explanations: &mut [Explanation]) {
    let causes: Vec<(Hypothesis, bool, f64)> =
        explanations.iter().map(|of| (of.hypothesis.clone(), of.is_unknown(), of.probability)).collect();
    let of_cause = |of: &Explanation| -> f64 {
        let own =
            causes.iter().filter(|(set, unknown, _)| *set == of.hypothesis && *unknown == of.is_unknown());
        own.map(|(_, _, probability)| probability).sum()
    };
    let key = |of: &Explanation| (of_cause(of), of.probability, of.evidence.ln);
    explanations.sort_by(|a, b| {
        let (a_key, b_key) = (key(a), key(b));
        let by_cause = b_key.0.total_cmp(&a_key.0).then(a.hypothesis.cmp(&b.hypothesis));
        by_cause.then(b_key.1.total_cmp(&a_key.1)).then(b_key.2.total_cmp(&a_key.2))
    });
}

/// `none`, the names of the effects, `unexplained`, or effects and `unexplained`.
fn full_name(problem: &Problem<'_>, set: &[usize], has_rest: bool) -> String {
    match (set, has_rest) {
        ([], true) => UNEXPLAINED.to_owned(),
        (set, true) => format!("{}+{UNEXPLAINED}", name(set, &problem.candidates)),
        (set, false) => name(set, &problem.candidates),
    }
}

/// The modes of every set, smaller ones first, so that larger ones start from them; with a rest, which is where
/// `plain` is given, from those of the same set without one, too.
fn search<'a>(
    problem: &'a Problem<'a>,
    sets: &[Hypothesis],
    plain: Option<&[Found<'a>]>,
    random: &(impl Fn(usize) -> ChaCha8Rng + Sync),
) -> Vec<Found<'a>> {
    let fitting = stage("fitting hypotheses", sets.len());
    let mut all: Vec<Found<'a>> = Vec::with_capacity(sets.len());
    let largest = sets.iter().map(Vec::len).max().unwrap_or(0);
    for size in 0..=largest {
        let more: Vec<Found<'a>> = (0..sets.len())
            .into_par_iter()
            .filter(|&place| sets[place].len() == size)
            .map(|place| {
                let mut model = Model::new(problem, &sets[place], plain.is_some());
                let own = plain.into_iter().map(|plain| &plain[place]);
                let mut smaller: Vec<&Found<'a>> = all
                    .iter()
                    .filter(|found| {
                        sets[found.place].len() + 1 == size && is_part(&sets[found.place], &sets[place])
                    })
                    .collect();
                if plain.is_some() {
                    // The modes without the rest are near already; of the others the best will do.
                    let height = |found: &Found<'_>| found.modes.first().map_or(f64::MIN, |m| m.ln_posterior);
                    smaller.sort_by(|a, b| height(b).total_cmp(&height(a)));
                    smaller.truncate(1);
                }
                let starts: Vec<Vec<f64>> = own
                    .chain(smaller)
                    .filter_map(|found| {
                        Some(model.start_from(&found.model, found.modes.first()?.w.as_slice()))
                    })
                    .collect();
                let modes = find(&mut model, &starts, &mut random(place));
                Found { place, model, modes }
            })
            .inspect(|_| fitting.advance())
            .collect();
        all.extend(more);
    }
    all
}

/// Ask the hypotheses that are close to the first whether they fit, and all how much they close.
fn look_closer(problem: &Problem<'_>, explanations: &mut [Explanation]) -> Result<()> {
    let high = explanations.iter().map(|of| of.probability).fold(0.0, f64::max);
    let base = explanations[0].clone();
    let looking = stage("looking for something else", explanations.len());
    explanations
        .par_iter_mut()
        .map(|of| {
            let is_close = of.probability > high * (-CLOSE).exp();
            if is_close || of.is_base() {
                of.fits = Some(predictive_probability(&of.model(problem), &of.evidence.modes[0])?);
            }
            of.closes = closes(problem, &base, of)?;
            let scales = of.model(problem).nuisances(of.best()).scales;
            of.is_vague = is_too_vague(problem, of);
            if problem.is_noise_stated {
                of.noise_scale = scales.into_iter().fold(0.0, f64::max);
            }
            Ok(())
        })
        .inspect(|_| looking.advance())
        .collect()
}

/// What is taken from effects with a rest, since they close little beside it, goes to something unknown, unless the same
/// effects do without the rest, by their ln weights: this share goes to them.
fn of_alone(alone: f64, with_rest: f64, unknown: f64) -> f64 {
    /// Odds from which on a rest is needed.
    const NEEDED: f64 = 20.0;
    let hardly_needed = 1.0 / (1.0 + (with_rest - alone).exp() / NEEDED);
    hardly_needed / (1.0 + (unknown - alone).exp())
}

/// The likeliest of several effects that is [far ahead](Explanation::is_far_ahead) of something unknown: what they do not keep
/// together is its.
fn heir(explanations: &[Explanation], several: &Explanation, unknown: &Explanation) -> Option<usize> {
    let is_one =
        |of: &Explanation| several.hypothesis.len() > 1 && is_part(&of.hypothesis, &several.hypothesis);
    let ahead = explanations.iter().enumerate().filter(|(_, of)| is_one(of) && of.is_far_ahead(unknown));
    ahead.max_by(|a, b| a.1.ln_weight.total_cmp(&b.1.ln_weight)).map(|(place, _)| place)
}

/// Take the probability of what does not fit, or closes little: a bad fit says that something remains, and takes
/// nothing from the effects that are in.
fn rule_out(explanations: &mut [Explanation]) {
    let same = |explanations: &[Explanation], hypothesis: &Hypothesis, has_rest: bool| {
        explanations.iter().position(|of| of.has_rest == has_rest && of.hypothesis == *hypothesis)
    };
    for place in 0..explanations.len() {
        let of = &explanations[place];
        if !of.has_rest && of.fits.is_some_and(|fits| fits < INADEQUATE) {
            let with_rest = same(explanations, &of.hypothesis, true);
            explanations[place].ruled_out = Some(RuledOut::Misfit);
            let taken = std::mem::take(&mut explanations[place].probability);
            if let Some(with_rest) = with_rest {
                explanations[with_rest].probability += taken;
            }
        }
    }
    let Some(unexplained) = same(explanations, &Vec::new(), true) else { return };
    if let Some(base) = same(explanations, &Vec::new(), false) {
        let taken = explanations[base].probability * explanations[base].doubted();
        explanations[base].probability -= taken;
        explanations[unexplained].probability += taken;
    }
    // Where the base model fits there is nothing to close, and an effect may be in and not show.
    let is_gap = !explanations.iter().any(|of| of.is_base() && of.fits_well());
    if !is_gap {
        explanations[unexplained].probability *= WITHOUT_A_SIGN;
    }
    for of in explanations.iter_mut() {
        let kept = if is_gap { of.kept_alone() } else { 1.0 };
        if kept == 0.0 {
            of.ruled_out = of.ruled_out.or(Some(RuledOut::ClosesLittle));
        }
        of.probability *= kept * (-of.lost()).exp();
    }
    let whole: f64 = explanations.iter().map(|of| of.probability).sum();
    explanations.iter_mut().for_each(|of| of.probability /= whole);
    // Several effects first, since what they lose may go to one of them.
    let mut places: Vec<usize> = (0..explanations.len()).collect();
    places.sort_by_key(|&place| Reverse(explanations[place].hypothesis.len()));
    for place in places {
        let is_far_ahead = explanations[place].is_far_ahead(&explanations[unexplained]);
        let of = &mut explanations[place];
        if !of.is_cause() || !of.may_have_rest() || is_far_ahead {
            continue;
        }
        let kept = of.kept();
        if kept == 0.0 {
            of.ruled_out = of.ruled_out.or(Some(RuledOut::ClosesLittle));
        }
        let taken = of.probability * (1.0 - kept);
        of.probability -= taken;
        let of = &explanations[place];
        let fits = |&alone: &usize| of.has_rest && explanations[alone].probability > 0.0;
        let alone = same(explanations, &of.hypothesis, false).filter(fits);
        let share = alone.map_or(0.0, |alone| {
            let alone = &explanations[alone];
            alone.kept() * of_alone(alone.ln_weight, of.ln_weight, explanations[unexplained].ln_weight)
        });
        let heir = heir(explanations, of, &explanations[unexplained]).unwrap_or(unexplained);
        if let Some(alone) = alone {
            explanations[alone].probability += share * taken;
        }
        explanations[heir].probability += (1.0 - share) * taken;
    }
    // A sum of shares is one by rounding only.
    explanations.iter_mut().for_each(|of| of.probability = of.probability.min(1.0));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    fn found(values: Vec<f64>, noise: f64) -> Vec<Explanation> {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(values);
        let noise = Some(vec![vec![noise; STEPS]]);
        let problem =
            Problem::new(&predictor, &prior, Straight::candidates(), &observations, noise, 1.0).unwrap();
        attribute(&problem, 1, 1).unwrap().explanations
    }

    /// Hypotheses by name as likely as that, of which nothing else is known yet.
    fn as_likely<const N: usize>(likely: [(&str, f64); N]) -> [Explanation; N] {
        let all = found(Straight::curve(1.3, 0.6, 0.8), 0.01);
        likely.map(|(name, probability)| {
            let of = all.iter().find(|of| of.name == name).unwrap().clone();
            let ln_weight = probability.max(1e-6).ln();
            Explanation { probability, ln_weight, fits: None, closes: 0.0, is_vague: false, ..of }
        })
    }

    #[test]
    fn a_rest_is_as_likely_beside_an_effect_as_not_and_likelier_than_nothing() {
        let explanations = found(Straight::curve(1.3, 0.6, 0.8), 0.01);
        let of = |name: &str| explanations.iter().find(|of| of.name == name).unwrap();
        let (wave, more) = (of("wave"), of("wave+unexplained"));
        let odds = (more.evidence.ln - wave.evidence.ln).exp();
        assert_eq!(explanations[0].name, "wave");
        let lost = more.lost();
        assert!(
            (more.probability / wave.probability / odds / (-lost).exp() - 1.0).abs() < 1e-6,
            "{explanations:?}"
        );
        // Alone it is likelier than nothing.
        let (none, unknown) = (of("none"), of("unexplained"));
        let ln_odds = |of: &Explanation| of.ln_weight - of.evidence.ln;
        assert!((ln_odds(unknown) - ln_odds(none) - 5f64.ln()).abs() < 1e-9, "{explanations:?}");
    }

    #[test]
    fn an_effect_that_closes_half_is_likelier_than_not_and_not_settled() {
        let kept = [0.1, 0.15, 0.25, 0.35, 0.625, 0.9, 1.0].map(|closes| along(&CLOSES, closes));
        let expected = [0.0, 0.0, 0.3, 0.6, 0.8, 1.0, 1.0];
        assert!(kept.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{kept:?}");
    }

    #[test]
    fn several_effects_must_close_more_than_one() {
        let any = found(Straight::curve(1.3, 0.6, 0.8), 0.01).remove(0);
        let kept = |effects: usize, closes: f64| {
            Explanation { hypothesis: (0..effects).collect(), closes, ..any.clone() }.kept()
        };
        for closes in [0.0, 0.2, 0.35, 0.5, 0.7, 0.85, 0.95] {
            let (together, alone) = (kept(2, closes), kept(1, closes));
            assert!(together <= alone && (closes < 0.2 || together < alone), "{closes}");
        }
        assert_eq!(kept(2, 1.0), 1.0);
    }

    #[test]
    fn what_leaves_half_as_much_as_it_does_must_be_far_ahead_of_something_unknown() {
        // Ahead of something unknown by so much, and closing so much.
        let probability = |ahead: f64, closes: f64| {
            let effect = 1.0 / (1.0 + (-ahead).exp());
            let mut all =
                as_likely([("none", 0.0), ("wave+unexplained", effect), ("unexplained", 1.0 - effect)]);
            (all[1].closes, all[1].ln_weight) = (closes, all[2].ln_weight + ahead);
            rule_out(&mut all);
            assert!((all.iter().map(|of| of.probability).sum::<f64>() - 1.0).abs() < 1e-12);
            all[1].probability
        };
        let kept = |closes: f64| along(&CLOSES, closes);
        assert!((probability(5.0, 1.0) - 1.0 / (1.0 + (-5f64).exp())).abs() < 1e-12);
        // Six nats at a half and below, three at six tenths, none from seven on: four are too few at a half, and thirty are
        // enough.
        for (ahead, closes) in [(6.0, 0.5), (6.0, 0.4), (3.0, 0.6), (0.0, 0.7)] {
            assert!((probability(ahead, closes) - 0.5 * kept(closes)).abs() < 1e-12, "{closes}");
        }
        assert!(probability(4.0, 0.5) < 0.1);
        assert!((probability(25.0, 0.5) - kept(0.5)).abs() < 1e-6);
        // What is far ahead is in it, however much else is, if it closes anything.
        assert!((probability(30.0, 0.3) - 1.0).abs() < 1e-6 && probability(30.0, 0.1) == 0.0);
    }

    #[test]
    fn what_two_effects_do_not_keep_is_that_one_s_of_them_without_which_it_cannot_be() {
        // The pair closes seven tenths, of which it keeps a half; one of it is ahead of something unknown by so much.
        let probabilities = |ahead: f64| {
            let mut all =
                as_likely([("wave+unexplained", 0.0), ("unexplained", 0.0), ("wave+unexplained", 1.0)]);
            all[2].hypothesis.push(1);
            for (of, (closes, ln_weight)) in all.iter_mut().zip([(0.7, ahead), (0.0, 0.0), (0.7, ahead)]) {
                (of.closes, of.ln_weight) = (closes, ln_weight);
            }
            rule_out(&mut all);
            all.map(|of| of.probability)
        };
        assert_eq!(probabilities(19.0), [0.0, 0.5, 0.5]);
        assert_eq!(probabilities(21.0), [0.5, 0.0, 0.5]);
    }

    #[test]
    fn something_unknown_alone_is_no_rival_to_what_is_well_ahead_or_closes_nearly_all() {
        let is_clear = |name: &str, closes: f64, ahead: f64| {
            let [mut of, mut unknown] = as_likely([(name, 0.9), ("unexplained", 0.1)]);
            (of.closes, of.ln_weight, unknown.ln_weight) = (closes, ahead, 0.0);
            of.is_clear_of(&unknown)
        };
        assert!(is_clear("wave+unexplained", 0.8, 11.0) && !is_clear("wave+unexplained", 0.8, 9.0));
        assert!(!is_clear("wave+unexplained", 0.6, 11.0), "it loses three");
        assert!(is_clear("wave+unexplained", 0.9, 1.0) && is_clear("wave", 0.8, 1.0));
    }

    #[test]
    fn a_base_model_whose_noise_is_not_believed_is_as_likely_something_unknown() {
        let probabilities = |noise_scale: f64| {
            let mut all = as_likely([("none", 0.8), ("wave", 0.0), ("unexplained", 0.2)]);
            all.iter_mut().for_each(|of| of.noise_scale = noise_scale);
            rule_out(&mut all);
            [all[0].probability, all[2].probability]
        };
        assert_eq!(probabilities(2.0), [0.8, 0.2]);
        // Two and a half standard deviations of a half are a factor of 3.5; three, of 4.5.
        let [none, unexplained] = probabilities(1.25f64.exp());
        assert!((none - 0.6).abs() < 1e-12 && (unexplained - 0.4).abs() < 1e-12, "{none} {unexplained}");
        assert!((probabilities(6.0)[0] - 0.4).abs() < 1e-12);
    }

    #[test]
    fn what_leaves_the_gap_as_it_is_is_no_cause_unless_the_emulator_does_not_know_it() {
        // Nine times as likely as the base model, without a rest or beside one.
        let probability = |name: &str, closes: f64, is_vague: bool| {
            let mut all = as_likely([("none", 0.1), (name, 0.9), ("unexplained", 0.0)]);
            (all[1].closes, all[1].is_vague) = (closes, is_vague);
            rule_out(&mut all);
            assert!((all.iter().map(|of| of.probability).sum::<f64>() - 1.0).abs() < 1e-12);
            all[1].probability
        };
        assert_eq!(probability("wave", 0.1, false), 0.0);
        assert!((probability("wave", 0.35, false) - 0.54 / 0.64).abs() < 1e-12);
        for (closes, is_vague) in [(0.95, false), (0.1, true)] {
            assert!((probability("wave", closes, is_vague) - 0.9).abs() < 1e-12);
        }
        assert!(probability("wave+unexplained", 0.5, false) < 0.02);
        let kept = along(&CLOSES, 0.6);
        assert!((probability("wave+unexplained", 0.6, true) - 0.9 * kept).abs() < 1e-12);
    }

    #[test]
    fn where_there_is_no_gap_an_effect_may_be_in_and_close_nothing() {
        let probabilities = |fits: f64, has_more_noise: bool| {
            let mut all = as_likely([("none", 0.5), ("wave", 0.3), ("unexplained", 0.2)]);
            let noise_scale = if has_more_noise { 1.1 * OTHER_NOISE } else { 1.0 };
            all.iter_mut().for_each(|of| of.noise_scale = noise_scale);
            all[0].fits = Some(fits);
            rule_out(&mut all);
            all.map(|of| of.probability)
        };
        // Nor is there a sign of something unknown.
        let expected = [0.5, 0.3, 0.08].map(|weight| weight / 0.88);
        assert!(probabilities(0.5, false).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
        // The base model fits badly, or with more noise than was stated alone.
        let [none, wave, unexplained] = probabilities(0.02, false);
        assert!(wave == 0.0 && (unexplained / none - 0.4).abs() < 1e-12);
        assert_eq!(probabilities(0.5, true)[1], 0.0);
    }

    #[test]
    fn the_nearest_cause_is_told_by_what_is_more_probable_of_it() {
        let mut explanations =
            as_likely([("unexplained", 0.9), ("wave", 0.01), ("wave+unexplained", 0.05), ("none", 0.04)])
                .to_vec();
        explanations[1].closes = 0.9;
        let of = |explanations: &[Explanation]| {
            Attribution { explanations: explanations.to_vec() }.nearest().map(|of| of.name.clone())
        };
        assert_eq!(of(&explanations).as_deref(), Some("wave+unexplained"));
        // Of two that are out of the question the one that closes most.
        explanations.iter_mut().for_each(|of| of.probability = 0.0);
        assert_eq!(of(&explanations).as_deref(), Some("wave"));
    }

    #[test]
    fn what_hardly_needs_a_rest_loses_nothing_by_it() {
        // As likely as with a rest, and far likelier than something unknown alone.
        assert!((of_alone(0.0, 0.0, -60.0) - 20.0 / 21.0).abs() < 1e-12);
        assert!((of_alone(0.0, 0.0, 0.0) - 10.0 / 21.0).abs() < 1e-12);
        // A rest is needed: something unknown is at work, and the effect closes little of it.
        assert!(of_alone(-20.0, 0.0, -30.0) < 1e-6);
        assert!(of_alone(f64::NEG_INFINITY, 0.0, -30.0) == 0.0);
    }

    #[test]
    fn a_rest_takes_nothing_from_the_effect_that_is_in() {
        let mut values = Straight::curve(1.3, 0.6, 0.8);
        for (t, y) in values.iter_mut().enumerate() {
            *y += 0.05 * (0.7 * t as f64).cos() + 0.01 * ((t * t) as f64).sin();
        }
        let explanations = found(values, 0.01);
        assert_eq!(explanations[0].name, "wave+unexplained", "{explanations:?}");
        assert!(explanations[0].closes > 0.95, "{}", explanations[0].closes);
    }
}
