//! What it would take to tell two explanations apart.

use anyhow::Result;

use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::confounding::{Curve, curve, square_distance};
use crate::attribute::evidence::model::Model;
use crate::attribute::problem::Problem;

/// Odds at which two explanations are told apart: nineteen to one.
const TOLD: f64 = 19.0;

/// Runs and measurements that are tried at most; what takes more is told by something else.
const MOST_RUNS: usize = 1000;
const MOST_MEASUREMENTS: usize = 100;

/// Runs go up in steps of so many: the figure is a rough one.
const STEP: usize = 10;

/// The least that would tell two explanations apart, if the one with the effects is true and as large as it fits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Further runs near the two.
    pub runs: usize,
    /// Measurements like this one in all, each of another specimen.
    pub measurements: usize,
}

/// What is compared with what, and by how much it is to become clearer.
struct Pair<'a> {
    /// The truth without a rest, and its most probable parameters.
    truth: (Model<'a>, &'a [f64]),
    curves: (Curve, Curve),
    /// Variance of each component as it is, shape (components,).
    variance: Vec<f64>,
    /// Parameters that the truth has more.
    more: f64,
}

/// The fewest further runs that would tell `truth` from `rival`, or, where no number of them would, the fewest
/// measurements with such runs; nothing where neither would. `ln_odds` is what `truth` has over `rival` now.
///
/// Expected ln odds grow as half the square of the distance of the two curves, the parameters of the rival free, in
/// the metric of noise, scatter and what the emulator does not know, and fall by Occam's factor for each parameter that
/// the truth has more. A run near the truth teaches about the mean curve what one observation does: its variance is
/// the simulation's scatter, or what is not known yet where that is larger, and a plane in all parameters is fitted to them.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn effort(
    problem: &Problem<'_>,
    truth: &Explanation,
    rival: &Explanation,
    ln_odds: f64,
) -> Result<Option<Effort>> {
    let (model, other) = (truth.model(problem), rival.model(problem));
    let (known, known_of_rival) = (model.curve(truth.best()).variance, other.curve(rival.best()).variance);
    let pair = Pair {
        curves: (curve(problem, truth), curve(problem, rival)),
        variance: known.into_iter().zip(known_of_rival).map(|(a, b)| a.max(b)).collect(),
        more: model.curve_parameters().saturating_sub(other.curve_parameters()) as f64,
        truth: (model.plain(), truth.best()),
    };
    let now = pair.square(0, 1)?;
    let is_told = |runs: usize, measurements: usize| -> Result<bool> {
        let then = pair.square(runs, measurements)?;
        let occam = pair.more * ((1.0 + then) / (1.0 + now)).ln();
        Ok(ln_odds + 0.5 * (then - now - occam) >= TOLD.ln())
    };
    for measurements in 1..=MOST_MEASUREMENTS {
        if is_told(MOST_RUNS, measurements)? {
            // The more runs the better: the first number that tells them apart is found by halving.
            let mut open = (0, MOST_RUNS / STEP);
            while open.0 < open.1 {
                let middle = (open.0 + open.1) / 2;
                open = if is_told(STEP * middle, measurements)? {
                    (open.0, middle)
                } else {
                    (middle + 1, open.1)
                };
            }
            return Ok(Some(Effort { runs: STEP * open.0, measurements }));
        }
    }
    Ok(None)
}

impl Pair<'_> {
    /// The square of their distance after further runs, with so many measurements.
    fn square(&self, runs: usize, measurements: usize) -> Result<f64> {
        let (model, best) = &self.truth;
        let fitted = runs as f64 / (1 + model.simulated_parameters().len()) as f64;
        let known = |(variance, scatter): (&f64, f64)| {
            let variance = variance.max(0.0);
            let of_a_run = scatter.max(variance);
            if variance == 0.0 { 0.0 } else { 1.0 / (1.0 / variance + fitted / of_a_run) }
        };
        let variance: Vec<f64> =
            self.variance.iter().zip(model.problem().predictor.scatter()).map(known).collect();
        let (truth, rival) = &self.curves;
        square_distance((model, best), (truth, rival), &variance, measurements as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    /// ln odds of the wave over none, and what would tell them apart, by a measurement of noise 0.1 that was made so
    /// often, and a simulation that is known to a variance.
    fn asked(measurements: usize, variance: f64) -> (f64, Option<Effort>) {
        let (predictor, prior) = (Straight::unsure(variance), Straight::prior());
        let sd = 0.1 / (measurements as f64).sqrt();
        // Neighbours of this noise differ. By white noise what is foretold is on the short side: five of 13 orders hold it as near.
        let error = |t: usize| sd * (((7 * t) % 13) as f64 - 6.0) / 14.0_f64.sqrt();
        let curve = Straight::curve(1.3, 0.6, 0.1).into_iter().enumerate();
        let observations = Straight::observations(curve.map(|(t, y)| y + error(t)).collect());
        let noise = Some(vec![vec![sd; STEPS]]);
        let candidates = vec![Straight::candidates().remove(0)];
        let problem = Problem::new(&predictor, &prior, candidates, &observations, noise, 1.0).unwrap();
        let all = attribute(&problem, 1, 1).unwrap().explanations;
        let of = |name: &str| all.iter().find(|of| of.name == name).unwrap();
        let ln_odds = (of("wave").probability / of("none").probability).ln();
        (ln_odds, effort(&problem, of("wave"), of("none"), ln_odds).unwrap())
    }

    #[test]
    fn as_many_measurements_as_are_foretold_tell_a_weak_effect() {
        let (now, effort) = asked(1, 0.0);
        let Effort { runs, measurements } = effort.unwrap();
        assert!(now < TOLD.ln() - 1.0 && runs == 0 && measurements > 1, "{now} {effort:?}");
        let (then, _) = asked(measurements, 0.0);
        assert!((then - TOLD.ln()).abs() < 0.3 * (TOLD.ln() - now), "{now} {then} {effort:?}");
    }

    #[test]
    fn where_the_simulation_is_what_is_not_known_runs_are_foretold() {
        let sure = asked(8, 0.0).0;
        let (now, effort) = asked(8, 0.01);
        assert!(now < TOLD.ln() && TOLD.ln() < sure, "{now} {sure}");
        let Effort { runs, measurements } = effort.unwrap();
        assert_eq!(measurements, 1);
        // A plane in three parameters, by runs that are as uncertain as what is not known.
        let (then, _) = asked(8, 0.01 / (1.0 + runs as f64 / 4.0));
        assert!(then > TOLD.ln() - 0.3 * (TOLD.ln() - now), "{now} {then} {effort:?}");
        assert!(asked(8, 0.01 / (1.0 + (runs / 4) as f64 / 4.0)).0 < TOLD.ln());
    }
}
