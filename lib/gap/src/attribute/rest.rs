//! What is left of a measurement beside the effects that are in: the rest, and what it goes with.

use std::ops::Range;

use nalgebra::DMatrix;

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;

/// What is left over, as smooth as the rest is taken to be.
#[derive(Clone, Debug)]
pub struct Rest {
    /// Measured minus predicted, without what is noise, shape (observables · steps).
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
    let curve = residual.iter().zip(made.iter()).map(|(r, made)| r - made).collect();
    Some(Rest { curve, spread })
}

impl Rest {
    /// The observable and the steps where most of it is, for the noise there: the shortest stretch that holds
    /// four fifths of its square in the observable with the most.
    pub fn place(&self, problem: &Problem<'_>) -> (usize, Range<usize>) {
        let steps = problem.steps();
        let square = |j: usize, t: usize| (self.curve[j * steps + t] / self.spread[j]).powi(2);
        let sum = |j: usize| (0..steps).map(|t| square(j, t)).sum::<f64>();
        let most = (0..self.spread.len()).max_by(|&a, &b| sum(a).total_cmp(&sum(b))).unwrap_or(0);
        let wanted = 0.8 * sum(most);
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
