//! What is left of a measurement beside the effects that are in: the rest, and what it goes with.

use std::collections::HashSet;
use std::ops::Range;

use anyhow::Result;
use nalgebra::DMatrix;

use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::closure::absorb;
use crate::attribute::evidence::jumps::products_with_steps;
use crate::attribute::problem::Problem;
use crate::attribute::problem::test::Test;
use gl_numeric::statistics::{mean, sd};

/// What is left over, as smooth as the rest is taken to be.
#[derive(Clone, Debug)]
pub struct Rest {
    /// Measured minus predicted, without what is noise and without what the parameters would absorb, shape (readings,).
    pub curve: Vec<f64>,
    /// Standard deviation of noise and scatter of each observable.
    pub spread: Vec<f64>,
}

/// The rest of an explanation that has one.
pub fn rest(problem: &Problem<'_>, of: &Explanation) -> Option<Rest> {
    if !of.has_rest {
        return None;
    }
    let model = of.model(problem);
    let w = of.best();
    let residual = model.residual(&of.evidence.mean);
    let scales = model.nuisances(w).scales;
    let spread = (0..problem.ranges.len()).map(|j| problem.spread(j, &scales)).collect();
    // E[rest | measurement] = residual less what noise, scatter and the emulator make of it.
    let plain = model.plain();
    let variance = model.curve(w).variance;
    let column = DMatrix::from_column_slice(residual.len(), 1, &residual);
    let solved = model.with_covariance(w, &variance, |covariance| covariance.solve(&column)).ok()?;
    let own = &w[..plain.len()];
    let errors = problem.emulator_errors(&variance);
    let nuisances = plain.nuisances(own);
    let others = problem.measurement_errors(&nuisances.scales);
    let made = &errors * errors.tr_mul(&solved) + &others * others.tr_mul(&solved);
    let mut rest = column - made;
    // Beside a rest parameters need not come as close as they could.
    absorb(&plain, own, &plain.gradient(own).1, &mut rest).ok()?;
    Some(Rest { curve: rest.as_slice().to_vec(), spread })
}

impl Rest {
    /// Its root mean square in each observable, in standard deviations of noise and scatter, shape (observables,).
    pub fn heights(&self, problem: &Problem<'_>) -> Vec<f64> {
        let height = |(j, spread): (usize, &f64)| {
            let own = &self.curve[problem.own(j)];
            (own.iter().map(|y| (y / spread).powi(2)).sum::<f64>() / own.len() as f64).sqrt()
        };
        self.spread.iter().enumerate().map(height).collect()
    }

    /// The observable and the steps where most of it is, for the noise there: the shortest stretch that holds
    /// four fifths of its square in the observable with the most.
    pub fn place(&self, problem: &Problem<'_>) -> (usize, Range<usize>) {
        let square = |j: usize, t: usize| (self.curve[problem.own(j).start + t] / self.spread[j]).powi(2);
        let sum = |j: usize| (0..problem.own(j).len()).map(|t| square(j, t)).sum::<f64>();
        let most = (0..self.spread.len()).max_by(|&a, &b| sum(a).total_cmp(&sum(b))).unwrap_or(0);
        let (wanted, steps) = (0.8 * sum(most), problem.own(most).len());
        let mut best = 0..steps;
        let (mut start, mut held) = (0, 0.0);
        for end in 0..steps {
            held += square(most, end);
            while start < end && held - square(most, start) >= wanted {
                held -= square(most, start);
                start += 1;
            }
            if held >= wanted && end + 1 - start < best.len() {
                best = start..end + 1;
            }
        }
        (most, best)
    }
}

/// A jump of a rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// The reading from which on the measurement has it.
    pub reading: usize,
    /// Mean of how far it goes, in the unit of its observable.
    pub size: f64,
}

/// The jumps of the rest of an explanation, in the order of their readings.
pub fn jumps(problem: &Problem<'_>, of: &Explanation) -> Vec<Jump> {
    let model = of.model(problem);
    let w = of.best();
    let residual = DMatrix::from_vec(problem.observed.len(), 1, model.residual(&of.evidence.mean));
    let variance = model.curve(w).variance;
    let Ok(solved) = model.with_covariance(w, &variance, |covariance| covariance.solve(&residual)) else {
        return Vec::new();
    };
    let scales = model.nuisances(w).scales;
    let cross = products_with_steps(problem, solved.as_slice());
    let jump = |&reading: &usize| {
        let observable = problem.observable_of(reading);
        let size =
            problem.units[reading] * problem.variance_of_singular(observable, &scales) * cross[reading];
        Jump { reading, size }
    };
    of.singular.jumps.iter().map(jump).collect()
}

/// Something that a rest may go with.
#[derive(Clone, Debug, PartialEq)]
pub struct GoesWith {
    /// The observable whose rest it is.
    pub observable: usize,
    /// What it goes with.
    pub what: String,
    /// Share of its square, in the metric of noise and scatter.
    pub share: f64,
    /// Its size in standard deviations of noise and scatter, with its sign.
    pub z: f64,
    /// Physical effects that behave so.
    pub like: &'static str,
}

/// How fast what belongs to a turning point, the start or the end of a test fades, as a share of the way.
const FADES: f64 = 0.1;

/// What is left of each observable beside an explanation, against what it may go with, each for itself, the
/// largest share first. What the parameters can absorb is taken out of both.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn goes_with(problem: &Problem<'_>, of: &Explanation) -> Result<Vec<GoesWith>> {
    let model = of.model(problem).plain();
    let w = &of.best()[..model.len()];
    let (mean, slopes) = model.gradient(w);
    let residual = model.residual(&mean);
    let readings = residual.len();
    let none = vec![0.0; problem.predictor.basis().ncols()];
    let mut all = Vec::new();
    for j in 0..problem.ranges.len() {
        let shapes = shapes(problem, &mean, j);
        let own = problem.own(j);
        let mut columns = DMatrix::zeros(readings, 1 + shapes.len());
        for i in own.clone().filter(|i| !of.singular.outliers.contains(i)) {
            columns[(i, 0)] = residual[i];
            for (k, shape) in shapes.iter().enumerate() {
                columns[(i, k + 1)] = shape.curve[i - own.start];
            }
        }
        absorb(&model, w, &slopes, &mut columns)?;
        let solved = model.with_covariance(w, &none, |covariance| covariance.solve(&columns))?;
        let products = columns.tr_mul(&solved);
        for (k, Shape { what, like, .. }) in shapes.into_iter().enumerate() {
            let (own, cross) = (products[(k + 1, k + 1)], products[(0, k + 1)]);
            let size: f64 = columns.column(k + 1).norm_squared();
            if size > 1e-12 && own > 0.0 && products[(0, 0)] > 0.0 {
                let share = cross * cross / (own * products[(0, 0)]);
                all.push(GoesWith { observable: j, what, share, z: cross / own.sqrt(), like });
            }
        }
    }
    all.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut said = HashSet::new();
    all.retain(|of| said.insert((of.observable, of.what.clone())));
    Ok(all)
}

/// One shape by either branch that a turn may be counted to.
const BRANCH: &str = "the branch (rising or falling)";

/// Its own change by either measure of time: the way of the control, or the readings.
const OWN_RATE: &str = "the rate of its own change";

/// What tells by how fast the control went, where readings are evenly apart in time.
const CONTROL_RATE: &str = "the rate of the control, with readings evenly apart in time";

/// A control that is the time itself has no bedding, no branch and no rate.
const TIMES: [&str; 9] = ["s", "sec", "ms", "us", "µs", "min", "h", "d", "a"];

/// A shape along the control, of root mean square 1.
struct Shape {
    what: String,
    curve: Vec<f64>,
    like: &'static str,
}

/// What a rest of an observable may go with.
fn shapes(problem: &Problem<'_>, mean: &[f64], observable: usize) -> Vec<Shape> {
    let test = problem.test_of(observable);
    let (steps, path) = (test.steps(), &test.path);
    let control = path.steady();
    let last = steps.saturating_sub(1);
    let travelled = path.travelled();
    let turns = path.turns();
    let mut shapes: Vec<Shape> = Vec::new();
    let mut add = |what: &str, like: &'static str, curve: Vec<f64>| {
        let rms = (curve.iter().map(|y| y * y).sum::<f64>() / steps as f64).sqrt();
        if rms > 0.0 && rms.is_finite() {
            let curve = curve.iter().map(|y| y / rms).collect();
            shapes.push(Shape { what: what.to_owned(), curve, like });
        }
    };
    add("a constant", "an offset of the sensor", vec![1.0; steps]);
    let is_time = test.control_unit.as_deref().is_some_and(|unit| TIMES.contains(&unit));
    let of_kind = |of_way: &'static str, of_time: &'static str| if is_time { of_time } else { of_way };
    let since_start = |t: usize| (-travelled[t] / FADES).exp();
    let like = of_kind("bedding, uneven ends or a late zero", "a late start or a late zero");
    add("the start", like, (0..steps).map(since_start).collect());
    let to_end = |t: usize| (-(1.0 - travelled[t]) / FADES).exp();
    let like = of_kind("breakage of grains, a membrane or a drift", "what sets in late, or a drift");
    add("the end", like, (0..steps).map(to_end).collect());
    let way = of_kind("the way so far", "the time so far");
    add(way, "a drift of the sensor or creep", travelled.to_vec());
    if !turns.is_empty() {
        for branch in branches(test, &mean[problem.own(observable)]) {
            add(BRANCH, "plasticity of contacts, or friction of walls or piston", branch);
        }
        let since_turn = |t: usize| {
            let turn = turns.iter().rev().find(|turn| **turn <= t).copied().unwrap_or(0);
            (-(travelled[t] - travelled[turn]) / FADES).exp()
        };
        add(
            "the way since the last turn",
            "friction that reverses, play of the rig or rolling resistance",
            (0..steps).map(since_turn).collect(),
        );
    }
    let own = &mean[problem.own(observable)];
    let about = |t: usize| (t.saturating_sub(1), (t + 1).min(last));
    let change = |of: &[f64], t: usize| of[about(t).1] - of[about(t).0];
    let by_way = |t: usize| {
        let way = change(travelled, t);
        if way > 0.0 { change(own, t) / way } else { 0.0 }
    };
    let by_reading = |of: &[f64], t: usize| change(of, t) / (about(t).1 - about(t).0).max(1) as f64;
    for rate in [(0..steps).map(by_way).collect(), (0..steps).map(|t| by_reading(own, t)).collect()] {
        add(OWN_RATE, "a lag of the recording or viscous damping", rate);
    }
    if !is_time && is_uneven(travelled) {
        let rate = (0..steps).map(|t| by_reading(control, t)).collect();
        add(CONTROL_RATE, "viscous damping, or a lag of the recording", rate);
    }
    for k in test.observables.clone() {
        let (name, level) = (&problem.observables[k], &mean[problem.own(k)]);
        let like = if k == observable {
            "a gain of the sensor, a compliance or adhesion"
        } else {
            "a compliance or adhesion"
        };
        add(&format!("the level of {name}"), like, level.to_vec());
        let most = level.iter().scan(f64::NEG_INFINITY, |most, y| {
            *most = most.max(*y);
            Some(*most)
        });
        add(
            &format!("the maximum of {name} so far"),
            "plasticity of contacts or breakage of grains",
            most.collect(),
        );
    }
    shapes
}

/// Which way the control goes, -1 to 1, at each reading of an observable whose curve is `own`: at once, or only once the
/// control has gone some way, as friction that first has to be mobilised; and each in proportion to what is measured, as friction is
/// to a load. The reading at a turn may still be of the branch that ends there.
fn branches(test: &Test, own: &[f64]) -> Vec<Vec<f64>> {
    /// The way over which friction turns, as a share of all.
    const MOBILISED: f64 = 0.05;
    let (travelled, rises) = (test.path.travelled(), test.path.rises());
    let before: Vec<f64> = rises.iter().map(|rises| if *rises { 1.0 } else { -1.0 }).collect();
    let after = before[1..].iter().chain(before.last()).copied().collect();
    let mut of = 0.0;
    let gradual = before.iter().enumerate().map(|(t, to)| {
        let way = travelled[t] - travelled[t.saturating_sub(1)];
        of = to + (of - to) * (-way / MOBILISED).exp();
        of
    });
    let alone = [gradual.collect(), before, after];
    let in_proportion = |branch: &Vec<f64>| branch.iter().zip(own).map(|(b, y)| b * y).collect();
    alone.into_iter().flat_map(|branch| [in_proportion(&branch), branch]).collect()
}

/// Whether the ways from reading to reading differ by more than a fifth of their mean (root mean square).
fn is_uneven(travelled: &[f64]) -> bool {
    let ways: Vec<f64> = travelled.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let even = vec![1.0 / ways.len().max(1) as f64; ways.len()];
    sd(&ways, &even) > 0.2 * mean(&ways, &even)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::diagnosis::diagnose;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    /// What comes first of what a rest of `y` goes with, which is added to a measurement at these places of the control.
    fn goes_first(
        control: impl Fn(usize) -> f64,
        unit: Option<&str>,
        more: impl Fn(usize) -> f64,
    ) -> GoesWith {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut observations = Straight::measured(1.3, 0.6, 0.0, 0.01);
        observations.control = (0..STEPS).map(control).collect();
        observations.values[0].iter_mut().enumerate().for_each(|(t, y)| *y += more(t));
        let units = unit.map_or(String::new(), |unit| format!("x={unit}")).parse().unwrap();
        let problem = predictor.problem(&prior, &observations).in_units(&units);
        let diagnosis = diagnose(&problem, 1, 1).unwrap();
        let unknown = diagnosis.attribution.explanations.iter().find(|of| of.is_unknown()).unwrap();
        goes_with(&problem, unknown).unwrap().remove(0)
    }

    #[test]
    fn what_goes_with_how_fast_the_control_went_is_told_by_its_rate() {
        // Fast in the second third.
        let pace = |t: usize| if (STEPS / 3..2 * STEPS / 3).contains(&t) { 5.0 } else { 1.0 };
        let control = |t: usize| (0..t).map(pace).sum::<f64>();
        let found = goes_first(control, None, |t| 0.03 * (pace(t.saturating_sub(1)) + pace(t)));
        assert_eq!((found.what.as_str(), found.share > 0.8), (CONTROL_RATE, true), "{found:?}");
    }

    #[test]
    fn of_a_control_that_is_the_time_no_bedding_is_said() {
        let late = |t: usize| 0.3 * (-((STEPS - 1 - t) as f64) / 2.6).exp();
        for (unit, like) in [
            (None, "breakage of grains, a membrane or a drift"),
            (Some("s"), "what sets in late, or a drift"),
        ] {
            let found = goes_first(|t| t as f64, unit, late);
            assert_eq!((found.what.as_str(), found.like), ("the end", like), "{found:?}");
        }
    }

    /// All that the rest goes with where the control goes back from step 13 and this is added to a measurement.
    fn over_a_turn(more: impl Fn(usize) -> f64) -> Vec<GoesWith> {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let mut observations = Straight::measured(0.3, 1.6, 0.0, 0.01);
        observations.control = (0..STEPS).map(|t| (t as f64 - 13.0).abs()).collect();
        observations.values[0].iter_mut().enumerate().for_each(|(t, y)| *y += more(t));
        let problem = predictor.problem(&prior, &observations);
        let diagnosis = diagnose(&problem, 1, 1).unwrap();
        let unknown = diagnosis.attribution.explanations.iter().find(|of| of.is_unknown()).unwrap();
        goes_with(&problem, unknown).unwrap()
    }

    #[test]
    fn a_hysteresis_is_told_by_its_branch_whichever_the_reading_at_a_turn_belongs_to() {
        for turn in [12, 13] {
            let all = over_a_turn(|t| if t <= turn { 0.1 } else { -0.1 });
            assert_eq!(all[0].what, BRANCH, "{all:?}");
            assert_eq!(all.iter().filter(|of| of.what == BRANCH).count(), 1);
        }
    }

    #[test]
    fn friction_in_proportion_to_a_load_or_mobilised_over_a_way_is_told_by_its_branch() {
        let load = |t: usize| 0.3 + 1.6 * t as f64 / (STEPS - 1) as f64;
        let in_proportion = |t: usize| 0.2 * load(t) * if t <= 13 { 1.0 } else { -1.0 };
        let mobilised = |t: usize| 0.2 * (1.0 - (t.saturating_sub(13)) as f64 / 2.0).max(-1.0);
        for (found, share) in [(over_a_turn(in_proportion), 0.95), (over_a_turn(mobilised), 0.7)] {
            assert_eq!((found[0].what.as_str(), found[0].share > share), (BRANCH, true), "{found:?}");
        }
    }
}
