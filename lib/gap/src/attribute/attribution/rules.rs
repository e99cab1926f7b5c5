//! What evidence alone does not settle: the probability of hypotheses that do not fit, close little of the gap, leave much to
//! something else, or take a noise or parameters that were not believed.
//!
//! A rule is a function that moves probability, in the order of [`rule_out`] and of the table in docs/design.md.

use std::cmp::Reverse;

use crate::attribute::attribution::{BEHIND, Explanation, NEARLY_ALL, RuledOut};
use crate::attribute::evidence::adequacy::INADEQUATE;
use crate::attribute::evidence::model::SD_OF_LN_NOISE;
use crate::attribute::problem::hypothesis::is_part;
use crate::noise::OTHER_NOISE;

/// What is kept of the probability of effects by the share of the gap that they close by themselves; in between in
/// proportion. What closes little is no part of the cause, and explains nothing where it is alone. What closes half beside
/// something else, a rest or more noise than was stated, may be one, or may imitate something that is no candidate, and is not
/// settled. On which seeds these numbers were chosen is in docs/diagnosis-accuracy.md.
const CLOSES: [(f64, f64); 3] = [(0.15, 0.0), (0.35, 0.6), (0.9, 1.0)];

/// The same of several effects together, which imitate more.
const CLOSE_TOGETHER: [(f64, f64); 3] = [(0.35, 0.0), (0.7, 0.5), (1.0, 1.0)];

/// The same of an error of the measurement, and of several. Its form is known to the last digit, and so plain, a constant or a
/// proportion, that nearly anything unknown has a part of it: an adhesion that is no candidate is an offset and a rest, of which
/// the offset closes two thirds to nine tenths. So does a right one beside a remainder as large as itself: that it is one is
/// nearly as likely then, and only a check of the rig tells.
const CLOSES_OF_THE_RIG: [(f64, f64); 4] = [(0.6, 0.0), (0.65, 0.4), (0.84, 0.4), (0.9, 1.0)];
const CLOSE_TOGETHER_OF_THE_RIG: [(f64, f64); 2] = [(0.85, 0.0), (1.0, 1.0)];

/// ln odds that effects lose beside something else that is at work, too, by the share of the gap that they close by
/// themselves: what leaves as much as it closes is likelier a part of something unknown that it imitates. One that closes seven
/// tenths is what a right one is beside a remainder nearly as large as itself, and loses nothing. What closes less than half is no
/// answer alone, since something else is said to make most of it, and loses less. What nothing smooth imitates is ahead of a
/// rest alone by tens, and hardly notices.
const LEAVES_MUCH: [(f64, f64); 3] = [(0.35, 1.0), (0.5, 3.0), (0.7, 0.0)];

/// ln odds over something unknown alone that a single effect beside a rest gains, by the share of the gap that it closes. A
/// smooth effect is hardly likelier than a rest of its own, which may be of any smooth form, and evidence does not see that what
/// is no candidate seldom has nearly the form of one.
const CLOSES_NEARLY_ALL: [(f64, f64); 2] = [(0.7, 0.0), (NEARLY_ALL, 2.0)];

/// The share of both that it has by that at the most: likelier than not, and not settled.
const LIKELY: f64 = 0.75;

/// What is kept of the probability of a single effect beside a rest at least, however little of the gap it closes, by the ln odds
/// that it is ahead of something unknown alone after all that it loses: a form that no rest has is in the measurement. Not all,
/// however far ahead: a rest is smooth but for its jumps, and what is no candidate may have a kink or a turn where one has it.
const FAR_AHEAD: [(f64, f64); 3] = [(6.0, 0.0), (8.0, LIKELY), (12.0, 0.9)];

/// The same of a single error of the measurement, whose form is so plain that much that is no candidate has a part of it: by up
/// to twenty an offset, and a compliance with it, were ahead of a rest where an adhesion that is no candidate was at work.
const FAR_AHEAD_OF_THE_RIG: [(f64, f64); 2] = [(20.0, 0.0), (30.0, 0.9)];

/// What is kept by either at the most, by the share of the gap that it closes: what closes hardly anything is likelier than not,
/// and not settled. In a Couette cell a drag at the ends, linear in the speed, was 36 ahead where one of its square was at work,
/// which is no candidate.
const AHEAD_AND_CLOSES: [(f64, f64); 2] = [(0.15, LIKELY), (0.35, 0.9)];

/// ln odds that answers lose to something unknown where they hold only beyond what was believed of the base model: one that may
/// do what nobody believes it does takes up most of what is no candidate, and an effect the rest of it.
const NOT_BELIEVED: f64 = 3.0;

/// What is kept of the probability of something unknown where the base model fits as it was believed to be, and there is no sign
/// of it.
const WITHOUT_A_SIGN: f64 = 0.4;

/// Share of the probability of what has no rest that goes to something unknown, by how much larger its noise is than what was
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

impl Explanation {
    /// What is kept of its probability beside something else, by the share of the gap that it closes.
    fn kept(&self) -> f64 {
        let (of_any, of_the_rig): (&[_], &[_]) = match self.hypothesis.len() {
            0 | 1 => (&CLOSES, &CLOSES_OF_THE_RIG),
            _ => (&CLOSE_TOGETHER, &CLOSE_TOGETHER_OF_THE_RIG),
        };
        let of_the_rig = if self.is_of_the_rig { along(of_the_rig, self.closes) } else { 1.0 };
        along(of_any, self.closes).min(of_the_rig)
    }

    /// What is kept of its probability where it is alone: all of it where the emulator cannot say how much it closes.
    fn kept_alone(&self) -> f64 {
        let is_asked = self.is_cause() && !self.may_have_rest() && !self.is_vague;
        if is_asked { along(&CLOSES, self.closes) } else { 1.0 }
    }

    /// What is kept of the probability of a single effect beside a rest at least, since it is far ahead of something unknown alone.
    /// What is no candidate is seldom imitated like that.
    fn kept_ahead_of(&self, unknown: &Self) -> f64 {
        if !self.is_single_beside_a_rest() {
            return 0.0;
        }
        along(self.far_ahead(), self.ahead_of(unknown)).min(along(&AHEAD_AND_CLOSES, self.closes))
    }

    /// What is kept of it by how far it is ahead.
    fn far_ahead(&self) -> &'static [(f64, f64)] {
        if self.is_of_the_rig { &FAR_AHEAD_OF_THE_RIG } else { &FAR_AHEAD }
    }

    /// Whether it is so far ahead of something unknown alone that it is in it, whatever else is.
    fn is_far_ahead(&self, unknown: &Self) -> bool {
        let far = self.far_ahead();
        self.is_single_beside_a_rest() && self.ahead_of(unknown) >= far[far.len() - 1].0
    }

    /// Whether something unknown alone is no rival to it: it needs no rest, closes nearly all beside one, or is well ahead. An
    /// error of the measurement may be well ahead and a part of something unknown. What holds only with a base model that was not
    /// believed has to be well ahead.
    pub fn is_clear_of(&self, unknown: &Self) -> bool {
        let is_well_ahead = || !self.is_of_the_rig && self.ahead_of(unknown) > BEHIND;
        let leaves_nothing = if self.has_rest {
            along(&CLOSES, self.closes) >= 1.0
        } else {
            !self.has_noise_for_a_rest(unknown)
        };
        !self.is_near_beyond_belief(unknown) && (leaves_nothing || is_well_ahead())
    }

    /// Whether it holds only with a base model beyond what was believed of it, and something unknown is not far behind.
    pub fn is_near_beyond_belief(&self, unknown: &Self) -> bool {
        self.beyond >= 0.5 && self.ln_weight - unknown.ln_weight <= BEHIND
    }

    /// Whether it does without a rest by more noise than was stated, and than something unknown needs: such a noise may be a
    /// rest by another name.
    pub fn has_noise_for_a_rest(&self, unknown: &Self) -> bool {
        !self.has_rest && self.has_more_noise() && self.noise_scale > OTHER_NOISE * unknown.noise_scale
    }

    /// ln odds by which it is ahead of something unknown alone, after what it loses.
    fn ahead_of(&self, unknown: &Self) -> f64 {
        self.ln_believed() - unknown.ln_weight - self.lost()
    }

    /// ln odds that it loses, since its effects leave as much to something else as they do.
    pub fn lost(&self) -> f64 {
        if self.is_cause() && self.may_have_rest() && !self.is_vague {
            along(&LEAVES_MUCH, self.closes)
        } else {
            0.0
        }
    }

    /// ln odds that it loses to something unknown, since it holds beyond what was believed, as far as it does.
    fn not_believed(&self) -> f64 {
        -(self.beyond * (-NOT_BELIEVED).exp_m1()).ln_1p()
    }

    /// ln of its weight against something unknown, after what it loses to it.
    fn ln_believed(&self) -> f64 {
        self.ln_weight - self.not_believed()
    }

    /// ln odds that it gains over something unknown alone, since it leaves hardly anything to it.
    fn gained(&self) -> f64 {
        let gains = self.is_single_beside_a_rest() && !self.is_vague;
        if gains { along(&CLOSES_NEARLY_ALL, self.closes) } else { 0.0 }
    }

    fn is_single_beside_a_rest(&self) -> bool {
        self.has_rest && self.hypothesis.len() == 1
    }

    /// Share of its probability that is doubted, since it takes a noise that was not believed.
    pub fn doubted(&self) -> f64 {
        along(&DOUBTED, self.noise_scale.ln() / SD_OF_LN_NOISE)
    }
}

/// Take the probability of what does not fit, or closes little: a bad fit says that something remains, and takes
/// nothing from the effects that are in. It goes to what is likelier then, and is one in all as before.
pub(super) fn rule_out(all: &mut [Explanation]) {
    close_as_beside_a_rest(all);
    let_passengers_off(all);
    give_misfits_a_rest(all);
    let Some(unknown) = place_of(all, &[], true) else { return };
    doubt_the_noise(all, unknown);
    // Where the base model fits there is nothing to close, and an effect may be in and not show.
    if let Some(base) = all.iter().find(|of| of.is_base() && of.fits_well()) {
        all[unknown].probability *= base.beyond + (1.0 - base.beyond) * WITHOUT_A_SIGN;
    } else {
        take_from_what_explains_nothing(all);
    }
    take_from_what_leaves_much(all);
    doubt_what_is_beyond(all, unknown);
    normalise(all);
    give_to_what_closes_nearly_all(all, unknown);
    give_what_is_not_closed_to_something_unknown(all, unknown);
    // A sum of shares is one by rounding only.
    all.iter_mut().for_each(|of| of.probability = of.probability.min(1.0));
}

/// The place of these effects, with a rest or without.
fn place_of(all: &[Explanation], hypothesis: &[usize], has_rest: bool) -> Option<usize> {
    all.iter().position(|of| of.has_rest == has_rest && of.hypothesis == hypothesis)
}

/// Effects that need more noise than was stated close no more than beside a rest: such a noise may be one by another name, and
/// what it is taken for is not closed by them.
fn close_as_beside_a_rest(all: &mut [Explanation]) {
    for place in 0..all.len() {
        let of = &all[place];
        if of.has_rest || !of.is_cause() || !of.has_more_noise() {
            continue;
        }
        if let Some(beside) = place_of(all, &of.hypothesis, true) {
            all[place].closes = of.closes.min(all[beside].closes);
        }
    }
}

/// Several effects, of which one is not known to do anything, are the others.
fn let_passengers_off(all: &mut [Explanation]) {
    // The others may have a passenger, too.
    let mut places: Vec<usize> = (0..all.len()).collect();
    places.sort_by_key(|&place| Reverse(all[place].hypothesis.len()));
    for place in places {
        let Some(passenger) = all[place].passenger else { continue };
        let others: Vec<usize> =
            all[place].hypothesis.iter().copied().filter(|&other| other != passenger).collect();
        let Some(heir) = place_of(all, &others, all[place].has_rest) else { continue };
        all[place].ruled_out.get_or_insert(RuledOut::Passenger);
        all[heir].probability += std::mem::take(&mut all[place].probability);
    }
}

/// What does not fit without a rest is as likely with one.
fn give_misfits_a_rest(all: &mut [Explanation]) {
    for place in 0..all.len() {
        let of = &all[place];
        if of.has_rest || of.fits.is_none_or(|fits| fits >= INADEQUATE) {
            continue;
        }
        let with_rest = place_of(all, &of.hypothesis, true);
        all[place].ruled_out = Some(RuledOut::Misfit);
        let taken = std::mem::take(&mut all[place].probability);
        if let Some(with_rest) = with_rest {
            all[with_rest].probability += taken;
        }
    }
}

/// What has no rest but a noise that was not believed, the base model or effects, is as likely something unknown.
fn doubt_the_noise(all: &mut [Explanation], unknown: usize) {
    let mut doubted = 0.0;
    for of in all.iter_mut().filter(|of| !of.has_rest) {
        let taken = of.probability * of.doubted();
        of.probability -= taken;
        doubted += taken;
    }
    all[unknown].probability += doubted;
}

/// Effects that close little without a rest explain nothing.
fn take_from_what_explains_nothing(all: &mut [Explanation]) {
    for of in all {
        let kept = of.kept_alone();
        if kept == 0.0 {
            of.ruled_out.get_or_insert(RuledOut::ClosesLittle);
        }
        of.probability *= kept;
    }
}

/// Effects that leave as much to something else as they do are likelier a part of it.
fn take_from_what_leaves_much(all: &mut [Explanation]) {
    all.iter_mut().for_each(|of| of.probability *= (-of.lost()).exp());
}

/// What needs a base model that was not believed is likelier an imitation of something unknown. All that is known loses the
/// same, so that no other effect gains by it. A base model that fits by itself loses nothing where something unknown needs it
/// beyond what was believed, too: it leaves nothing that would have to be explained.
fn doubt_what_is_beyond(all: &mut [Explanation], unknown: usize) {
    let needed = all[unknown].beyond;
    let lost = |of: &Explanation| {
        let leaves_nothing = of.is_base() && of.fits_well();
        of.not_believed() * if leaves_nothing { 1.0 - needed } else { 1.0 }
    };
    let known = |of: &&Explanation| !of.is_unknown();
    let whole: f64 = all.iter().filter(known).map(|of| of.probability).sum();
    let left: f64 = all.iter().filter(known).map(|of| of.probability * (-lost(of)).exp()).sum();
    if left > 0.0 {
        all[unknown].probability *= whole / left;
    }
}

/// Something unknown loses to the effect beside a rest that is the likeliest by what it gains, and to it alone.
fn give_to_what_closes_nearly_all(all: &mut [Explanation], unknown: usize) {
    let with_gain = |of: &Explanation| of.probability * of.gained().exp();
    let gaining = (0..all.len()).filter(|&place| all[place].gained() > 0.0);
    let best = gaining.max_by(|&a, &b| with_gain(&all[a]).total_cmp(&with_gain(&all[b])));
    let Some(best) = best.filter(|&best| all[best].probability > 0.0) else { return };
    let both = all[best].probability + all[unknown].probability;
    let share = |of_effect: f64| of_effect / (of_effect + all[unknown].probability);
    let before = share(all[best].probability);
    let share = share(with_gain(&all[best])).min(before.max(LIKELY));
    all[best].probability = share * both;
    all[unknown].probability = (1.0 - share) * both;
}

fn normalise(all: &mut [Explanation]) {
    let whole: f64 = all.iter().map(|of| of.probability).sum();
    all.iter_mut().for_each(|of| of.probability /= whole);
}

/// What effects do not close beside something else is something unknown; or one of them alone that is far ahead, or the same
/// effects without a rest where that is hardly needed.
fn give_what_is_not_closed_to_something_unknown(all: &mut [Explanation], unknown: usize) {
    // Several effects first, since what they lose may go to one of them; then those without a rest, since what the same
    // effects lose beside one may go to these.
    let mut places: Vec<usize> = (0..all.len()).collect();
    places.sort_by_key(|&place| (Reverse(all[place].hypothesis.len()), all[place].has_rest));
    for place in places {
        let of = &all[place];
        if !of.is_cause() || !of.may_have_rest() {
            continue;
        }
        let kept = of.kept().max(of.kept_ahead_of(&all[unknown]));
        let taken = of.probability * (1.0 - kept);
        let heir = heir(all, of, &all[unknown]).unwrap_or(unknown);
        let alone = place_of(all, &of.hypothesis, false);
        let alone = alone.filter(|&alone| of.has_rest && all[alone].probability > 0.0);
        let share = alone.map_or(0.0, |alone| {
            let alone = &all[alone];
            alone.kept() * of_alone(alone.ln_believed(), of.ln_believed(), all[unknown].ln_weight)
        });
        if kept == 0.0 {
            all[place].ruled_out.get_or_insert(RuledOut::ClosesLittle);
        }
        // All of it at once: what keeps nothing has nothing, to the last digit.
        all[place].probability -= taken;
        if let Some(alone) = alone {
            all[alone].probability += share * taken;
        }
        all[heir].probability += (1.0 - share) * taken;
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::synthetic_world::{Straight, as_likely, found};

    #[test]
    fn an_effect_that_closes_half_is_likelier_than_not_and_not_settled() {
        let kept = [0.1, 0.15, 0.25, 0.35, 0.625, 0.9, 1.0].map(|closes| along(&CLOSES, closes));
        let expected = [0.0, 0.0, 0.3, 0.6, 0.8, 1.0, 1.0];
        assert!(kept.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{kept:?}");
    }

    #[test]
    fn what_keeps_nothing_has_nothing_to_the_last_digit() {
        let mut start = as_likely([("wave", 0.1), ("wave+unexplained", 0.6), ("unexplained", 0.3)]);
        start[0].closes = 0.4;
        for more in 0..50 {
            let mut all = start.clone();
            all[1].probability += 0.007 * f64::from(more);
            rule_out(&mut all);
            assert_eq!(all[1].probability, 0.0, "{more}");
        }
    }

    #[test]
    fn a_noise_that_may_be_a_rest_by_another_name_closes_nothing() {
        let closes = |noise_scale: f64, beside: f64| {
            let mut all = as_likely([("wave", 0.9), ("wave+unexplained", 0.1), ("unexplained", 0.0)]);
            (all[0].closes, all[0].noise_scale, all[1].closes) = (0.7, noise_scale, beside);
            rule_out(&mut all);
            [all[0].closes, all[1].closes]
        };
        assert_eq!(closes(2.0, 0.4), [0.4, 0.4]);
        assert_eq!(closes(2.0, 0.9), [0.7, 0.9]);
        assert_eq!(closes(1.2, 0.4), [0.7, 0.4]);
    }

    #[test]
    fn a_base_model_that_fits_leaves_nothing_to_something_unknown_that_needs_it_beyond_belief_too() {
        let share = |fits: f64, needed: f64| {
            let mut all = as_likely([("none", 0.5), ("unexplained", 0.5)]);
            (all[0].noise_scale, all[0].beyond, all[1].beyond) = (1.0, 1.0, needed);
            all[0].fits = Some(fits);
            rule_out(&mut all);
            all[0].probability
        };
        assert!((share(0.5, 1.0) - 0.5).abs() < 1e-12);
        let less = 1.0 / (1.0 + NOT_BELIEVED.exp());
        assert!((share(0.5, 0.0) - less).abs() < 1e-12 && (share(0.02, 1.0) - less).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_known_to_do_anything_leaves_all_to_the_others() {
        let mut all = as_likely([("wave", 0.2), ("wave", 0.7), ("unexplained", 0.1)]);
        all[1].hypothesis.push(1);
        all[1].passenger = Some(1);
        let_passengers_off(&mut all);
        assert_eq!(all.each_ref().map(|of| of.probability), [0.2 + 0.7, 0.0, 0.1]);
        assert_eq!(all[1].ruled_out, Some(RuledOut::Passenger));
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
    fn an_error_of_the_measurement_must_close_more_than_an_effect() {
        let any = found(Straight::curve(1.3, 0.6, 0.8), 0.01).remove(0);
        let kept = |effects: usize, closes: f64| {
            let hypothesis = (0..effects).collect();
            Explanation { hypothesis, closes, is_of_the_rig: true, ..any.clone() }.kept()
        };
        assert_eq!([0.5, 0.6, 0.9].map(|closes| kept(1, closes)), [0.0, 0.0, 1.0]);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(kept(1, 0.65), 0.4) && near(kept(1, 0.84), 0.4) && near(kept(1, 0.87), 0.7));
        assert!(near(kept(2, 0.925), 0.5));
        assert_eq!([0.85, 1.0].map(|closes| kept(2, closes)), [0.0, 1.0]);
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
        // One nat up to 0.35, three at a half, one and a half at six tenths, none from seven on: one is too few at a half, and
        // eight are enough.
        for (ahead, closes) in [(1.0, 0.3), (2.0, 0.425), (3.0, 0.5), (1.5, 0.6), (0.0, 0.7)] {
            assert!((probability(ahead, closes) - 0.5 * kept(closes)).abs() < 1e-12, "{closes}");
        }
        assert!(probability(1.0, 0.5) < 0.1);
        assert!((probability(8.0, 0.5) - kept(0.5)).abs() < 0.01);
        // What is far ahead is in it, however much else is.
        assert!((probability(30.0, 0.35) - 0.9).abs() < 1e-6 && (probability(30.0, 0.9) - 1.0).abs() < 1e-6);
        // Somewhat ahead, or where it closes hardly anything, it is likelier than not.
        assert!(
            (probability(15.0, 0.25) - 0.825).abs() < 1e-5 && (probability(30.0, 0.0) - 0.75).abs() < 1e-6
        );
        assert!((probability(9.0, 0.0) - 0.75).abs() < 1e-3);
        assert_eq!(probability(7.0, 0.0), 0.0);
    }

    #[test]
    fn an_error_of_the_measurement_must_be_further_ahead_than_an_effect() {
        let probability = |is_of_the_rig: bool, ahead: f64| {
            let mut all = as_likely([("none", 0.0), ("wave+unexplained", 1.0), ("unexplained", 0.0)]);
            (all[1].closes, all[1].is_of_the_rig) = (0.75, is_of_the_rig);
            (all[1].ln_weight, all[2].ln_weight) = (0.0, -ahead);
            rule_out(&mut all);
            all[1].probability
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(probability(false, 20.0), 0.9));
        // What it closes counts up to here.
        assert!(near(probability(true, 20.0), 0.4));
        assert!(near(probability(true, 25.0), 0.45) && near(probability(true, 40.0), 0.9));
    }

    #[test]
    fn what_closes_nearly_all_beside_a_rest_gains_over_something_unknown_and_over_nothing_else() {
        let odds_of = |wave: f64, closes: [f64; 2]| {
            let mut all = as_likely([
                ("none", 0.1),
                ("wave+unexplained", wave),
                ("offset(y)+unexplained", 0.1),
                ("unexplained", 0.8 - wave),
            ]);
            all.iter_mut().skip(1).zip(closes).for_each(|(of, closes)| of.closes = closes);
            give_to_what_closes_nearly_all(&mut all, 3);
            assert!((all.iter().map(|of| of.probability).sum::<f64>() - 1.0).abs() < 1e-12);
            assert_eq!(all[0].probability, 0.1);
            [all[1].probability / all[3].probability, all[2].probability]
        };
        let odds = |closes: [f64; 2]| odds_of(0.2, closes);
        let e = std::f64::consts::E;
        let is = |found: [f64; 2], gain: f64| {
            (found[0] * 3.0 / gain - 1.0).abs() < 1e-12 && (found[1] - 0.1).abs() < 1e-12
        };
        assert!(is(odds([0.7, 0.0]), 1.0) && is(odds([0.75, 0.0]), e));
        // The likelier of two alone: nothing is counted twice.
        assert!(is(odds([0.75, 0.75]), e));
        // Three to one at the most, and not less than before: a gain settles nothing.
        let [gained, more] = [0.2, 0.7].map(|wave| odds_of(wave, [0.95, 0.0])[0]);
        assert!((gained - e * e / 3.0).abs() < 1e-12 && (more - 7.0).abs() < 1e-9, "{gained} {more}");
        assert!((odds_of(0.4, [0.95, 0.0])[0] - 3.0).abs() < 1e-12);
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
        assert_eq!(probabilities(11.0), [0.0, 0.5, 0.5]);
        let found = probabilities(13.0);
        let expected = [0.45, 0.05, 0.5];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn something_unknown_alone_is_no_rival_to_what_is_well_ahead_or_closes_nearly_all() {
        let is_clear_if = |is_of_the_rig: bool, name: &str, closes: f64, ahead: f64| {
            let [mut of, mut unknown] = as_likely([(name, 0.9), ("unexplained", 0.1)]);
            (of.closes, of.ln_weight, unknown.ln_weight) = (closes, ahead, 0.0);
            of.is_of_the_rig = is_of_the_rig;
            of.is_clear_of(&unknown)
        };
        let is_clear = |name: &str, closes: f64, ahead: f64| is_clear_if(false, name, closes, ahead);
        assert!(is_clear("wave+unexplained", 0.8, 11.0) && !is_clear("wave+unexplained", 0.8, 9.0));
        assert!(!is_clear("wave+unexplained", 0.6, 11.0), "it loses three");
        assert!(is_clear("wave+unexplained", 0.9, 1.0) && is_clear("wave", 0.8, 1.0));
        // An error of the measurement is a part of it, however far ahead.
        assert!(!is_clear_if(true, "wave+unexplained", 0.8, 11.0));
        assert!(is_clear_if(true, "wave+unexplained", 0.9, 1.0));
    }

    #[test]
    fn what_holds_only_beyond_what_was_believed_is_clear_of_something_unknown_where_it_is_well_ahead() {
        let is_clear = |beyond: f64, ahead: f64| {
            let [mut of, mut unknown] = as_likely([("wave", 0.9), ("unexplained", 0.1)]);
            (of.closes, of.ln_weight, unknown.ln_weight) = (1.0, ahead, 0.0);
            (of.beyond, of.noise_scale) = (beyond, 1.0);
            of.is_clear_of(&unknown)
        };
        assert!(is_clear(0.1, 1.0) && !is_clear(0.9, 9.0) && is_clear(0.9, 11.0));
    }

    #[test]
    fn what_does_without_a_rest_by_a_noise_that_nobody_stated_is_not_clear_of_one() {
        let is_clear = |noise: f64, of_unknown: f64, ahead: f64| {
            let [mut of, mut unknown] = as_likely([("wave", 0.9), ("unexplained", 0.1)]);
            (of.closes, of.ln_weight, unknown.ln_weight) = (1.0, ahead, 0.0);
            (of.noise_scale, unknown.noise_scale) = (noise, of_unknown);
            of.is_clear_of(&unknown)
        };
        assert!(!is_clear(2.0, 1.0, 9.0) && is_clear(2.0, 1.0, 11.0));
        // Where something unknown needs it, too, it is noise.
        assert!(is_clear(2.0, 1.9, 1.0) && is_clear(1.3, 0.5, 1.0));
    }

    #[test]
    fn what_has_no_rest_but_a_noise_that_is_not_believed_is_as_likely_something_unknown() {
        for first in ["none", "wave"] {
            let probabilities = |noise_scale: f64| {
                let of = |name: &str| if name == first { 0.8 } else { 0.0 };
                let mut all = as_likely([("none", of("none")), ("wave", of("wave")), ("unexplained", 0.2)]);
                for of in &mut all {
                    (of.noise_scale, of.closes) = (noise_scale, 1.0);
                }
                rule_out(&mut all);
                [all[0].probability + all[1].probability, all[2].probability]
            };
            let is_near = |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12;
            assert!(is_near(probabilities(2.0), [0.8, 0.2]), "{first}");
            // Two and a half standard deviations of a half are a factor of 3.5; three, of 4.5.
            assert!(is_near(probabilities(1.25f64.exp()), [0.6, 0.4]), "{first}");
            assert!(is_near(probabilities(6.0), [0.4, 0.6]), "{first}");
        }
    }

    #[test]
    fn what_holds_only_beyond_what_was_believed_is_likelier_something_unknown_that_it_imitates() {
        let odds = |beyond: [f64; 3]| {
            let mut all = as_likely([("none", 0.0), ("wave", 0.6), ("offset(y)", 0.2), ("unexplained", 0.2)]);
            all.iter_mut().skip(1).zip(beyond).for_each(|(of, beyond)| of.beyond = beyond);
            doubt_what_is_beyond(&mut all, 3);
            [all[1].probability / all[3].probability, all[2].probability / all[1].probability]
        };
        let e3 = (-3f64).exp();
        // Whether something unknown is beyond, too, is nothing to it; no effect gains over another.
        for (beyond, kept) in [
            ([0.0, 0.0, 1.0], 1.0),
            ([1.0, 1.0, 0.0], e3),
            ([0.5, 0.5, 0.0], 0.5 + 0.5 * e3),
            ([1.0, 0.0, 0.0], 0.25 + 0.75 * e3),
        ] {
            let [to_unknown, to_other] = odds(beyond);
            assert!((to_unknown - 3.0 * kept).abs() < 1e-12, "{beyond:?}");
            assert!((to_other - 1.0 / 3.0).abs() < 1e-12, "{beyond:?}");
        }
    }

    #[test]
    fn a_base_model_that_fits_only_beyond_what_was_believed_is_no_sign_that_nothing_is_unknown() {
        let odds = |beyond: f64| {
            let mut all = as_likely([("none", 0.5), ("unexplained", 0.5)]);
            (all[0].fits, all[0].beyond, all[0].noise_scale) = (Some(0.5), beyond, 1.0);
            rule_out(&mut all);
            all[1].probability / all[0].probability
        };
        assert!((odds(0.0) - 0.4).abs() < 1e-12 && (odds(1.0) - 3f64.exp()).abs() < 1e-9);
    }

    #[test]
    fn what_leaves_the_gap_as_it_is_is_no_cause_unless_the_emulator_does_not_know_it() {
        // Nine times as likely as the base model, without a rest or beside one.
        let probability = |name: &str, closes: f64, is_vague: bool| {
            let mut all = as_likely([("none", 0.1), (name, 0.9), ("unexplained", 0.0)]);
            (all[1].closes, all[1].is_vague, all[2].ln_weight) = (closes, is_vague, -5.0);
            rule_out(&mut all);
            assert!((all.iter().map(|of| of.probability).sum::<f64>() - 1.0).abs() < 1e-12);
            all[1].probability
        };
        assert_eq!(probability("wave", 0.1, false), 0.0);
        assert!((probability("wave", 0.35, false) - 0.54 / 0.64).abs() < 1e-12);
        for (closes, is_vague) in [(0.95, false), (0.1, true)] {
            assert!((probability("wave", closes, is_vague) - 0.9).abs() < 1e-12);
        }
        let odds = 9.0 * (-3f64).exp();
        let expected = along(&CLOSES, 0.5) * odds / (1.0 + odds);
        assert!((probability("wave+unexplained", 0.5, false) - expected).abs() < 1e-12);
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
    fn what_hardly_needs_a_rest_loses_nothing_by_it() {
        // As likely as with a rest, and far likelier than something unknown alone.
        assert!((of_alone(0.0, 0.0, -60.0) - 20.0 / 21.0).abs() < 1e-12);
        assert!((of_alone(0.0, 0.0, 0.0) - 10.0 / 21.0).abs() < 1e-12);
        // A rest is needed: something unknown is at work, and the effect closes little of it.
        assert!(of_alone(-20.0, 0.0, -30.0) < 1e-6);
        assert!(of_alone(f64::NEG_INFINITY, 0.0, -30.0) == 0.0);
    }
}
