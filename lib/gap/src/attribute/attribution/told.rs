//! Which of several tests tell the cause from its nearest rival.

use std::ops::Range;

use crate::attribute::attribution::Explanation;
use crate::attribute::problem::Problem;
use crate::attribute::problem::hypothesis::is_part;
use crate::attribute::problem::test::Test;

/// What two hypotheses, each fitted to all tests, leave of one of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// Name of the test.
    pub test: String,
    /// Readings in it.
    pub readings: usize,
    /// Root mean square of what the first leaves, in standard deviations of noise and scatter.
    pub first: f64,
    /// The same of its rival.
    pub rival: f64,
}

impl Told {
    /// By how much the test is for the first: the difference of the sums of squares.
    pub fn gain(&self) -> f64 {
        self.readings as f64 * (self.rival.powi(2) - self.first.powi(2))
    }
}

/// The likeliest hypothesis of as many effects that is neither a part of the first nor has it, of those that are not ruled out
/// if there are any, and what both leave of each test, that which tells them apart best first; none where there is one test,
/// or no rival. Rests are left out of it: they would fit whatever an effect does not.
pub fn told<'a>(
    problem: &Problem<'_>,
    explanations: &'a [Explanation],
    first: &Explanation,
) -> Option<(&'a Explanation, Vec<Told>)> {
    if problem.tests.len() < 2 || !first.is_cause() {
        return None;
    }
    let plain = |of: &&Explanation| !of.has_rest;
    let own = explanations.iter().filter(plain).find(|of| of.hypothesis == first.hypothesis)?;
    let is_rival = |of: &&Explanation| {
        of.hypothesis.len() == own.hypothesis.len() && !is_part(&of.hypothesis, &own.hypothesis)
    };
    let before = |a: &&Explanation, b: &&Explanation| {
        let is_alive = |of: &Explanation| of.ruled_out.is_none();
        is_alive(a).cmp(&is_alive(b)).then(a.evidence.ln.total_cmp(&b.evidence.ln))
    };
    let rival = explanations.iter().filter(plain).filter(is_rival).max_by(before)?;
    let scales = own.model(problem).nuisances(own.best()).scales;
    let left = |of: &Explanation, readings: Range<usize>| -> f64 {
        let square = |i: usize| {
            let left = problem.observed[i] - of.evidence.mean[i];
            (left / problem.spread(problem.observable_of(i), &scales)).powi(2)
        };
        let count = readings.len() as f64;
        (readings.map(square).sum::<f64>() / count).sqrt()
    };
    let of_test = |test: &Test| Told {
        test: test.name.clone(),
        readings: test.readings.len(),
        first: left(own, test.readings.clone()),
        rival: left(rival, test.readings.clone()),
    };
    let mut told: Vec<Told> = problem.tests.iter().map(of_test).collect();
    told.sort_by(|a, b| b.gain().total_cmp(&a.gain()));
    Some((rival, told))
}
