//! Which effect explains the gap: the probability of every hypothesis.
//!
//! * Before: [`visible`](mod@visible), which candidates the measurement can show at all.
//! * What evidence alone does not settle: [`closure`], how far effects close the gap; [`rules`], what that and a bad fit take
//!   from a hypothesis; [`untried`], those that the emulator knows too little of; [`mod@passenger`], effects that come with another one and do
//!   nothing; [`lean`], whether the truth may lie beyond
//!   the bounds.
//! * After: [`confounding`], which hypotheses the measurement cannot tell apart, [`told`], which of several tests does, and
//!   [`forecast`], what it would take to; [`rest`], what else there is and what that goes with; [`marginals`] and [`draws`],
//!   what is known of the parameters then.

pub mod closure;
pub mod confounding;
pub mod draws;
pub mod forecast;
pub mod lean;
pub mod marginals;
pub mod passenger;
pub mod rest;
pub mod rig;
pub mod rules;
pub mod told;
pub mod untried;
pub mod visible;
pub mod yardstick;

use std::iter;

use anyhow::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::attribute::attribution::closure::closes;
use crate::attribute::attribution::passenger::passenger;
use crate::attribute::attribution::rig::of_the_rig;
use crate::attribute::attribution::rules::rule_out;
use crate::attribute::attribution::untried::is_too_vague;
use crate::attribute::attribution::visible::visible;
use crate::attribute::evidence::adequacy::{FITS, predictive_probability};
use crate::attribute::evidence::mode::{Mode, climb_from, find, try_jumps};
use crate::attribute::evidence::model::{Model, Singular};
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

/// The same of what closes nearly all of it.
const NEARLY_ALL: f64 = 0.8;

/// ln odds by which a measurement may be less likely with one explanation than with another, and nearly as likely.
pub const NEARLY_AS_LIKELY: f64 = 3.0;

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
    /// Readings that are far off under it, and those from which on its rest has jumped.
    pub singular: Singular,
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
    /// Of several effects the one of which it is not known that it does anything.
    pub passenger: Option<usize>,
    /// Whether one of its effects is an error of the measurement, or does what such an error does.
    pub is_of_the_rig: bool,
    /// Probability under it that some parameter of the base model is beyond what was believed.
    pub beyond: f64,
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
    /// It is not known of one of its effects that it does anything; that goes to the others.
    Passenger,
}

impl RuledOut {
    /// In a word, for a table.
    pub fn word(self) -> &'static str {
        match self {
            Self::Misfit => "misfit",
            Self::ClosesLittle => "closes-little",
            Self::Invisible => "invisible",
            Self::Passenger => "passenger",
        }
    }
}

impl Explanation {
    /// Its model.
    pub fn model<'a>(&self, problem: &'a Problem<'a>) -> Model<'a> {
        let mut model = Model::new(problem, &self.hypothesis, self.has_rest);
        model.set_form(&self.added, self.singular.clone());
        model
    }

    /// Its most probable parameters.
    pub fn best(&self) -> &[f64] {
        self.evidence.modes[0].w.as_slice()
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

    /// The same of one that closes nearly all of the gap, where the measurement is nearly as likely. A rest that jumps where
    /// this one does not may have the very form that the effect has nearly.
    pub fn is_nearly_as_likely_as(&self, other: &Self) -> bool {
        let jumps = other.singular.jumps.len().saturating_sub(self.singular.jumps.len());
        let less = NEARLY_AS_LIKELY * (1 + jumps) as f64;
        self.closes >= NEARLY_ALL && self.evidence.ln >= other.evidence.ln - less
    }

    /// Whether it fits with the noise that was stated.
    pub fn fits_well(&self) -> bool {
        !self.has_more_noise() && self.fits.is_some_and(|fits| fits > FITS)
    }

    /// Whether it takes a noise that is clearly larger than stated, which may be a rest by another name.
    pub fn has_more_noise(&self) -> bool {
        self.noise_scale > OTHER_NOISE
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
    /// What follows from how likely hypotheses are (`ln_weight`), and from what is known of each by itself.
    pub fn by_rules(mut explanations: Vec<Explanation>) -> Self {
        explanations.iter_mut().for_each(|of| of.probability = of.ln_weight.exp());
        rule_out(&mut explanations);
        sort(&mut explanations);
        Self { explanations }
    }

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

    /// Probability of what an explanation says, of its effects with a rest and without.
    pub fn probability_of(&self, what: &Explanation) -> f64 {
        together(self.explanations.iter().filter(|of| of.says_as(what)))
    }

    /// Probability of candidates, by their places, to be in it all: alone, with others, with a rest or without.
    pub fn probability_of_effects(&self, candidates: &[usize]) -> f64 {
        let has_all = |of: &&Explanation| candidates.iter().all(|effect| of.hypothesis.contains(effect));
        together(self.explanations.iter().filter(has_all))
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

/// Probability of explanations that exclude each other: at most 1, which a sum of shares may exceed by rounding.
fn together<'a>(explanations: impl Iterator<Item = &'a Explanation>) -> f64 {
    explanations.map(|of| of.probability).sum::<f64>().min(1.0)
}

/// Hypotheses within this of the most probable one (natural logarithm) are asked whether they fit.
const CLOSE: f64 = 5.0;

/// Hypotheses further below the most probable one (natural logarithm, to second order about their
/// modes) are out of the question, and their evidence is estimated coarsely.
const BEHIND: f64 = 10.0;

/// A hypothesis with what a search found.
struct Found<'a> {
    place: usize,
    model: Model<'a>,
    modes: Vec<Mode>,
}

impl Found<'_> {
    /// ln of the largest posterior density that was found.
    fn height(&self) -> f64 {
        self.modes.first().map_or(f64::MIN, |mode| mode.ln_posterior)
    }

    /// ln evidence to second order about the modes.
    fn rough_evidence(&self) -> f64 {
        ln_sum_exp(&self.modes.iter().map(Mode::ln_evidence).collect::<Vec<_>>())
    }
}

/// Weigh every set of up to `largest` candidates against the measurement, alone and with a rest.
///
/// # Errors
/// If no hypothesis can be evaluated.
pub fn attribute(problem: &Problem<'_>, largest: usize, seed: u64) -> Result<Attribution> {
    let random = |place: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(place as u64);
        random
    };
    let mut visible = visible(problem, seed)?;
    add_shown(problem, &mut visible, &random);
    let is_visible = |set: &Hypothesis| set.iter().all(|&candidate| visible[candidate]);
    let count = visible.iter().filter(|visible| **visible).count();
    let mut sets = hypotheses(problem.candidates.len(), largest);
    sets.retain(|set| set.len() < 2 || is_visible(set));
    let plain = search(problem, &sets, None, &random);
    let with_rest = search(problem, &sets, Some(&plain), &|place| random(sets.len() + place));
    let mut found: Vec<Found<'_>> = plain.into_iter().chain(with_rest).collect();
    share_jumps(&mut found);
    let ln_odds = |found: &Found<'_>| {
        let set = &sets[found.place];
        if is_visible(set) { ln_prior_odds(set, found.model.has_rest(), count) } else { f64::NEG_INFINITY }
    };
    let rough: Vec<f64> = found.iter().map(|found| found.rough_evidence() + ln_odds(found)).collect();
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
                singular: model.singular().clone(),
                added: model.added(evidence.modes[0].w.as_slice()),
                beyond: beyond(problem, &model, &evidence),
                evidence,
                fits: None,
                closes: 0.0,
                noise_scale: 1.0,
                is_vague: false,
                passenger: None,
                is_of_the_rig: false,
                hypothesis: set,
            })
        })
        .inspect(|_| weighing.advance())
        .collect::<Result<_>>()?;
    drop(weighing);
    let whole = ln_sum_exp(&explanations.iter().map(|of| of.ln_weight).collect::<Vec<_>>());
    explanations.iter_mut().for_each(|of| of.ln_weight -= whole);
    look_closer(problem, &mut explanations)?;
    let of_the_rig = of_the_rig(problem, &explanations);
    for of in &mut explanations {
        of.is_of_the_rig = of.hypothesis.iter().any(|&candidate| of_the_rig[candidate]);
    }
    Ok(Attribution::by_rules(explanations))
}

/// Probability that some parameter of the base model is beyond what was believed.
fn beyond(problem: &Problem<'_>, model: &Model<'_>, evidence: &Evidence) -> f64 {
    let base = problem.prior.base().into_iter();
    let believed: Vec<_> = base.filter_map(|j| Some((j, problem.beliefs[j]?))).collect();
    if believed.is_empty() {
        return 0.0;
    }
    let is_beyond = |w: &[f64]| {
        let point = model.point(w);
        believed.iter().any(|&(j, belief)| !belief.holds(point[j]))
    };
    let samples = evidence.samples.iter().zip(&evidence.weights);
    let beyond: f64 = samples.filter(|(w, _)| is_beyond(w)).map(|(_, weight)| weight).sum();
    beyond.clamp(0.0, 1.0)
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
                    smaller.sort_by(|a, b| b.height().total_cmp(&a.height()));
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
    for size in (0..largest).rev() {
        let better: Vec<Found<'a>> = all
            .par_iter()
            .filter(|found| sets[found.place].len() == size)
            .filter_map(|found| better(found, &all, sets, random))
            .collect();
        for found in better {
            let place = found.place;
            if let Some(own) = all.iter_mut().find(|own| own.place == place) {
                *own = found;
            }
        }
    }
    all
}

/// A set of effects fitted again where one of more effects has found a better place for it: the search for a few may end
/// elsewhere, and an effect is not less likely than with others that do nothing.
fn better<'a>(
    of: &Found<'a>,
    all: &[Found<'a>],
    sets: &[Hypothesis],
    random: &(impl Fn(usize) -> ChaCha8Rng + Sync),
) -> Option<Found<'a>> {
    /// ln density that has to be gained.
    const BETTER: f64 = 1.0;
    let set = &sets[of.place];
    let is_larger = |other: &&Found<'_>| {
        let larger = &sets[other.place];
        larger.len() == set.len() + 1 && is_part(set, larger)
    };
    let larger = all.iter().filter(is_larger).max_by(|a, b| a.height().total_cmp(&b.height()))?;
    if larger.height() <= of.height() {
        return None;
    }
    let start = of.model.start_from(&larger.model, larger.modes.first()?.w.as_slice());
    let reached = climb_from(&of.model, &start)?;
    if reached.ln_posterior < of.height() + BETTER {
        return None;
    }
    let mut model = Model::new(of.model.problem(), set, of.model.has_rest());
    let modes = find(&mut model, &[reached.w.as_slice().to_vec()], &mut random(of.place));
    let found = Found { place: of.place, model, modes };
    (found.height() > of.height()).then_some(found)
}

/// ln evidence that a candidate gains in this measurement, with a rest or without, from which on it shows.
const SHOWN: f64 = 2.0;

/// Of the candidates that hardly any measurement could show, those that this one shows are visible.
fn add_shown(problem: &Problem<'_>, visible: &mut [bool], random: &(impl Fn(usize) -> ChaCha8Rng + Sync)) {
    let hidden: Vec<usize> = (0..visible.len()).filter(|&candidate| !visible[candidate]).collect();
    if hidden.is_empty() {
        return;
    }
    let sets: Vec<Hypothesis> =
        iter::once(Vec::new()).chain(hidden.iter().map(|&candidate| vec![candidate])).collect();
    let plain = search(problem, &sets, None, random);
    let with_rest = search(problem, &sets, Some(&plain), random);
    let mut best = vec![f64::NEG_INFINITY; sets.len()];
    for found in plain.iter().chain(&with_rest) {
        best[found.place] = best[found.place].max(found.rough_evidence());
    }
    for (candidate, own) in hidden.into_iter().zip(&best[1..]) {
        visible[candidate] = own - best[0] > SHOWN;
    }
}

/// Let every rest try the jumps of those with which the measurement is likeliest.
fn share_jumps(found: &mut [Found<'_>]) {
    /// Sets of jumps that are tried.
    const SETS: usize = 4;
    let with_rest = found.iter().filter(|found| found.model.has_rest());
    let mut jumping: Vec<(f64, Vec<usize>)> = with_rest
        .filter_map(|found| Some((found.modes.first()?.ln_evidence(), found.model.singular().jumps.clone())))
        .filter(|(_, jumps)| !jumps.is_empty())
        .collect();
    jumping.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut sets: Vec<Vec<usize>> = Vec::new();
    for (_, jumps) in jumping {
        if !sets.contains(&jumps) {
            sets.push(jumps);
        }
    }
    sets.truncate(SETS);
    found
        .par_iter_mut()
        .filter(|found| found.model.has_rest())
        .for_each(|Found { model, modes, .. }| try_jumps(model, modes, &sets));
}

/// Ask the hypotheses that are close to the first whether they fit, and all how much they close.
fn look_closer(problem: &Problem<'_>, explanations: &mut [Explanation]) -> Result<()> {
    let high = explanations.iter().map(|of| of.ln_weight).fold(f64::NEG_INFINITY, f64::max);
    let base = explanations[0].clone();
    let looking = stage("looking for something else", explanations.len());
    explanations
        .par_iter_mut()
        .map(|of| {
            let is_close = of.ln_weight > high - CLOSE;
            if is_close || of.is_base() {
                of.fits = Some(predictive_probability(&of.model(problem), &of.evidence.modes[0])?);
            }
            of.closes = closes(problem, &base, of)?;
            let scales = of.model(problem).nuisances(of.best()).scales;
            of.is_vague = is_too_vague(problem, of);
            of.passenger = if is_close { passenger(problem, of) } else { None };
            if problem.is_noise_stated {
                of.noise_scale = scales.into_iter().fold(0.0, f64::max);
            }
            Ok(())
        })
        .inspect(|_| looking.advance())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::synthetic_world::{Straight, as_likely, found};

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
    fn what_this_measurement_shows_is_visible_whatever_others_would_show() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let random = ChaCha8Rng::seed_from_u64;
        let shown = |strength: f64| {
            let observations = Straight::measured(1.3, 0.6, strength, 0.01);
            let problem = predictor.problem(&prior, &observations);
            let mut visible = [false; 2];
            add_shown(&problem, &mut visible, &|place| random(place as u64));
            visible
        };
        // The offset is what `a` does, too.
        assert_eq!((shown(0.8), shown(0.0)), ([true, false], [false, false]));
    }

    #[test]
    fn an_effect_whose_search_ended_elsewhere_is_found_from_where_it_is_with_another_one() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::measured(1.3, 0.6, 0.8, 0.01);
        let problem = predictor.problem(&prior, &observations);
        let random = |place: usize| ChaCha8Rng::seed_from_u64(place as u64);
        let sets = hypotheses(2, 2);
        let mut all = search(&problem, &sets, None, &random);
        let wave = all.iter().position(|found| sets[found.place] == [0]).unwrap();
        let height = all[wave].height();
        assert!(better(&all[wave], &all, &sets, &random).is_none());
        all[wave].modes[0].ln_posterior -= 20.0;
        let found = better(&all[wave], &all, &sets, &random).unwrap();
        assert!((found.height() - height).abs() < 0.01 && found.place == all[wave].place);
    }

    #[test]
    fn how_far_a_base_model_is_beyond_what_was_believed_is_known_of_each() {
        let predictor = Straight::new();
        let (prior, believed) = Straight::beyond(0.5, 1.1);
        let beyond = |a: f64| {
            let observations = Straight::measured(a, 0.6, 0.8, 0.01);
            let problem = predictor.problem(&prior, &observations).believing(&believed);
            let all = attribute(&problem, 1, 1).unwrap().explanations;
            all.iter().find(|of| of.name == "wave").unwrap().beyond
        };
        assert!(beyond(1.3) > 0.99 && beyond(0.8) < 0.01);
        assert!(found(Straight::curve(1.3, 0.6, 0.8), 0.01).iter().all(|of| of.beyond == 0.0));
    }

    #[test]
    fn what_rounding_makes_more_than_certain_is_certain() {
        let together = |a: f64, b: f64| together(as_likely([("wave", a), ("none", b)]).iter());
        assert_eq!(together(0.5, 0.25), 0.75);
        assert_eq!(together(1.0 - 1e-15, 2e-14), 1.0);
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
    fn the_length_of_a_rest_is_found() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let length = |waves: f64| {
            let mut observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
            for (y, x) in observations.values[0].iter_mut().zip(&observations.control) {
                *y += 0.1 * (std::f64::consts::TAU * waves * x).sin();
            }
            let problem = predictor.problem(&prior, &observations);
            let explanations = attribute(&problem, 1, 1).unwrap().explanations;
            let unknown = explanations.iter().find(|of| of.name == UNEXPLAINED).unwrap();
            unknown.model(&problem).nuisances(unknown.best()).rest.unwrap().length
        };
        // Of one wave the straight line takes up a part; from four on it would be noise that is correlated.
        let [one, two, three] = [1.0, 2.0, 3.0].map(length);
        assert!((0.2..0.6).contains(&one) && two < 0.6 * one && three < 0.7 * two, "{one} {two} {three}");
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
