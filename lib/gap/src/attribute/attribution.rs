//! Which effect explains the gap: the probability of every hypothesis.

use anyhow::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::attribute::adequacy::{INADEQUATE, predictive_probability};
use crate::attribute::evidence::{COARSE, Evidence, FINE, evidence};
use crate::attribute::hypothesis::{Hypothesis, hypotheses, is_part, ln_prior_odds, name};
use crate::attribute::mode::{Mode, find};
use crate::attribute::model::Model;
use crate::attribute::problem::Problem;
use gl_numeric::statistics::ln_sum_exp;
use gl_progress::stage;

/// One hypothesis after the measurement.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The candidates that are in.
    pub hypothesis: Hypothesis,
    /// `none`, or the names of the effects joined by `+`.
    pub name: String,
    /// Probability given the measurement; what does not fit has none.
    pub probability: f64,
    /// Whether it is out of the question, so that its evidence is coarse.
    pub is_hopeless: bool,
    /// Its evidence and posterior.
    pub evidence: Evidence,
    /// Evidence with a further smooth discrepancy, where it was worth a look.
    pub with_discrepancy: Option<f64>,
    /// Predictive probability of a measurement as odd as this one, where it was worth a look.
    pub fits: Option<f64>,
}

/// Every hypothesis after the measurement.
#[derive(Clone, Debug)]
pub struct Attribution {
    /// All hypotheses, most probable first.
    pub explanations: Vec<Explanation>,
    /// Probability that something is at work which is no candidate.
    pub unexplained: f64,
    /// ln evidence of that: over all hypotheses that a smooth discrepancy was added to, by their
    /// prior odds.
    pub ln_unexplained: f64,
    /// The most probable hypothesis before it was asked whether it fits, and whether something
    /// further is at work.
    pub nearest: String,
}

/// Prior odds that something further is at work which is no candidate: as likely as not.
const UNEXPLAINED_ODDS: f64 = 1.0;

/// Hypotheses within this of the most probable one (natural logarithm) are looked at more closely.
const CLOSE: f64 = 5.0;
const MOST_CLOSE: usize = 4;

/// Hypotheses further below the most probable one (natural logarithm, to second order about their
/// modes) are out of the question, and their evidence is estimated coarsely.
const HOPELESS: f64 = 15.0;

/// Weigh every set of up to `largest` candidates against the measurement.
///
/// # Errors
/// If no hypothesis can be evaluated.
pub fn attribute(problem: &Problem<'_>, largest: usize, seed: u64) -> Result<Attribution> {
    let count = problem.candidates.len();
    let sets = hypotheses(count, largest);
    let random = |place: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(place as u64);
        random
    };
    let fitting = stage("fitting hypotheses", sets.len());
    let mut modes: Vec<Vec<Mode>> = Vec::with_capacity(sets.len());
    for size in 0..=largest.min(count) {
        let more: Vec<Vec<Mode>> = sets
            .par_iter()
            .enumerate()
            .filter(|(_, set)| set.len() == size)
            .map(|(place, set)| {
                let model = Model::new(problem, set, false);
                let smaller = sets
                    .iter()
                    .zip(&modes)
                    .filter(|(other, _)| other.len() + 1 == size && is_part(other, set));
                let starts: Vec<Vec<f64>> = smaller
                    .filter_map(|(other, modes)| {
                        let theirs = Model::new(problem, other, false);
                        Some(model.start_from(&theirs, modes.first()?.w.as_slice()))
                    })
                    .collect();
                find(&model, &starts, &mut random(place))
            })
            .inspect(|_| fitting.advance())
            .collect();
        modes.extend(more);
    }
    drop(fitting);
    let rough: Vec<f64> = modes
        .iter()
        .zip(&sets)
        .map(|(modes, set)| {
            let parts: Vec<f64> = modes.iter().map(Mode::ln_evidence).collect();
            ln_sum_exp(&parts) + ln_prior_odds(set, count)
        })
        .collect();
    let highest = rough.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weighing = stage("weighing hypotheses", sets.len());
    let found: Vec<Evidence> = modes
        .into_par_iter()
        .enumerate()
        .map(|(place, modes)| {
            let aim = if highest - rough[place] < HOPELESS { FINE } else { COARSE };
            let model = Model::new(problem, &sets[place], false);
            evidence(&model, modes, aim, &mut random(sets.len() + place))
        })
        .inspect(|_| weighing.advance())
        .collect::<Result<_>>()?;
    drop(weighing);
    let weight = |place: usize, found: &[Evidence]| found[place].ln + ln_prior_odds(&sets[place], count);
    let mut order: Vec<usize> = (0..sets.len()).collect();
    order.sort_by(|&a, &b| weight(b, &found).total_cmp(&weight(a, &found)));
    let nearest = order[0];
    let high = weight(nearest, &found);
    let mut close: Vec<usize> = order
        .iter()
        .copied()
        .filter(|&place| high - weight(place, &found) < CLOSE)
        .take(MOST_CLOSE)
        .collect();
    if !close.contains(&0) {
        close.push(0);
    }
    // Fit, and evidence with something further at work.
    let looking = stage("looking for something else", close.len());
    let looked: Vec<(usize, f64, f64)> = close
        .into_par_iter()
        .map(|place| {
            let model = Model::new(problem, &sets[place], false);
            let wider = Model::new(problem, &sets[place], true);
            let modes = &found[place].modes;
            let fits = predictive_probability(&model, &modes[0], seed)?;
            let starts: Vec<Vec<f64>> =
                modes.iter().map(|mode| wider.start_from(&model, mode.w.as_slice())).collect();
            let mut random = random(2 * sets.len() + place);
            let modes = find(&wider, &starts, &mut random);
            Ok((place, fits, evidence(&wider, modes, FINE, &mut random)?.ln))
        })
        .inspect(|_| looking.advance())
        .collect::<Result<_>>()?;
    drop(looking);

    let ln_unexplained = ln_sum_exp(
        &looked.iter().map(|&(place, _, ln)| ln + ln_prior_odds(&sets[place], count)).collect::<Vec<_>>(),
    );
    let whole = ln_sum_exp(
        &(0..sets.len())
            .map(|place| weight(place, &found))
            .chain([ln_unexplained + UNEXPLAINED_ODDS.ln()])
            .collect::<Vec<_>>(),
    );
    let mut explanations: Vec<Explanation> = sets
        .iter()
        .enumerate()
        .map(|(place, set)| {
            let look = looked.iter().find(|(other, _, _)| *other == place);
            Explanation {
                hypothesis: set.clone(),
                name: name(set, &problem.candidates),
                probability: (weight(place, &found) - whole).exp(),
                is_hopeless: highest - rough[place] >= HOPELESS,
                evidence: found[place].clone(),
                with_discrepancy: look.map(|&(_, _, ln)| ln),
                fits: look.map(|&(_, fits, _)| fits),
            }
        })
        .collect();
    let mut unexplained = (ln_unexplained + UNEXPLAINED_ODDS.ln() - whole).exp();
    for explanation in &mut explanations {
        if explanation.fits.is_some_and(|fits| fits < INADEQUATE) {
            unexplained += std::mem::take(&mut explanation.probability);
        }
    }
    explanations.sort_by(|a, b| {
        b.probability.total_cmp(&a.probability).then(b.evidence.ln.total_cmp(&a.evidence.ln))
    });
    Ok(Attribution {
        explanations,
        unexplained,
        ln_unexplained,
        nearest: name(&sets[nearest], &problem.candidates),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    #[test]
    fn something_unknown_is_as_likely_beforehand_as_not() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.8));
        let noise = Some(vec![vec![0.01; STEPS]]);
        let problem =
            Problem::new(&predictor, &prior, Straight::candidates(), &observations, noise, 1.0).unwrap();
        let found = attribute(&problem, 1, 1).unwrap();
        // One of two candidates is as likely beforehand as none, and the other hypotheses are out of the question.
        let wave = &found.explanations[0];
        let odds = (found.ln_unexplained - wave.evidence.ln).exp();
        assert_eq!(wave.name, "wave");
        assert!((found.unexplained / wave.probability / odds - 1.0).abs() < 1e-6, "{found:?}");
    }
}
