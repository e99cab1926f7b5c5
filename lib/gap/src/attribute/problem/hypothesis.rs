//! What may explain a gap: candidate effects, and every set of a few of them.

use crate::attribute::problem::measurement::MeasurementEffect;
use gl_inference::prior::Effect;

/// An effect that may be missing from the base model.
#[derive(Clone, Debug, PartialEq)]
pub enum Candidate {
    /// One that the simulator has, and the design switches on and off.
    Simulated(Effect),
    /// One of the measurement.
    Measured(MeasurementEffect),
}

impl Candidate {
    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            Self::Simulated(effect) => &effect.name,
            Self::Measured(effect) => &effect.name,
        }
    }

    /// Whether it is an error of the measurement, and not an effect of the simulation.
    pub fn is_measured(&self) -> bool {
        matches!(self, Self::Measured(_))
    }
}

/// A set of candidates that are in, as ascending positions in the list of candidates.
pub type Hypothesis = Vec<usize>;

/// Every set of up to `largest` of `candidates`, smaller ones first, in the order of the list.
pub fn hypotheses(candidates: usize, largest: usize) -> Vec<Hypothesis> {
    let mut all: Vec<Hypothesis> = vec![Vec::new()];
    let mut start = 0;
    for _ in 0..largest.min(candidates) {
        let end = all.len();
        for i in start..end {
            let next = all[i].last().map_or(0, |last| last + 1);
            for candidate in next..candidates {
                let mut set = all[i].clone();
                set.push(candidate);
                all.push(set);
            }
        }
        start = end;
    }
    all
}

/// Whether everything in the one hypothesis is in the other, too.
pub fn is_part(one: &[usize], other: &[usize]) -> bool {
    one.iter().all(|candidate| other.contains(candidate))
}

/// `none`, or the names of the effects joined by `+`.
pub fn name(hypothesis: &[usize], candidates: &[Candidate]) -> String {
    if hypothesis.is_empty() {
        return "none".to_owned();
    }
    hypothesis.iter().map(|&i| candidates[i].name()).collect::<Vec<_>>().join("+")
}

/// Odds beforehand that something is at work which is no candidate, and nothing else, against `none`. What is really
/// at work is rarely as jagged, and never as large, as all that a rest may be, so that a rest alone comes off worse than
/// it should.
const UNKNOWN: f64 = 5.0;

/// One candidate more is in with odds of one to this many times the number of candidates: two at a time imitate what is
/// none of them.
const FURTHER: f64 = 4.0;

/// The same, beside a rest, this many times less often: three at a time imitate nearly everything.
const FURTHER_BESIDE_A_REST: f64 = 4.0;

/// Natural logarithm of the prior odds of a hypothesis, with a rest or without, against `none`.
///
/// Who asks has seen a gap: that one of the candidates is at work is twice as likely beforehand as that none
/// is, each as likely as the others, and with a rest as likely as without. A lone candidate is as likely as each of two.
pub fn ln_prior_odds(hypothesis: &[usize], has_rest: bool, candidates: usize) -> f64 {
    let count = candidates.max(2) as f64;
    match (hypothesis.len(), has_rest) {
        (0, false) => 0.0,
        (0, true) => UNKNOWN.ln(),
        (effects, has_rest) => {
            let rarer = FURTHER * if has_rest { FURTHER_BESIDE_A_REST } else { 1.0 };
            std::f64::consts::LN_2 - count.ln() - (effects - 1) as f64 * (rarer * count).ln()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_come_in_the_order_of_their_size_and_of_the_list() {
        let sets = hypotheses(3, 2);
        assert_eq!(sets, [vec![], vec![0], vec![1], vec![2], vec![0, 1], vec![0, 2], vec![1, 2]]);
        assert_eq!(hypotheses(5, 5).len(), 32);
        assert_eq!(hypotheses(1, 2).len(), 2);
    }

    #[test]
    fn one_of_the_candidates_is_twice_as_likely_as_none_and_two_less_than_one() {
        for count in [2, 5, 12] {
            let odds_of = |size: usize, has_rest: bool| {
                let sets = hypotheses(count, 2);
                let own = sets.iter().filter(|set| set.len() == size);
                own.map(|set| ln_prior_odds(set, has_rest, count).exp()).sum::<f64>()
            };
            assert!((odds_of(0, false) - 1.0).abs() < 1e-12);
            assert!([false, true].iter().all(|&has_rest| (odds_of(1, has_rest) - 2.0).abs() < 1e-12));
            assert!(odds_of(2, false) < odds_of(1, false) / 4.0, "{count}");
            assert!((odds_of(2, true) - odds_of(2, false) / 4.0).abs() < 1e-12, "{count}");
            assert!((odds_of(0, true) - 5.0).abs() < 1e-12);
        }
    }
}
