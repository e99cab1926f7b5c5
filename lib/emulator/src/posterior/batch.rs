//! Which runs to make next.

use anyhow::Result;
use gl_numeric::sequence::{self, Method};
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::mixture::LocalMixture;
use super::space::Space;
use crate::Emulator;

/// Places that a run may be made at.
const CANDIDATES: usize = 400;

/// Draws of the posterior at which the emulator is to become better.
const REFERENCES: usize = 250;

/// One run in so many is for the prior at large.
const AT_LARGE: usize = 8;

/// A run tells of others whether they fail as far as this, as a share of the prior's width, in each parameter.
const ALIKE: f64 = 0.15;

/// Runs that have not failed about every place, beforehand.
const BEFOREHAND: f64 = 0.2;

/// What a batch is chosen by.
pub struct Choice<'a> {
    /// The emulator.
    pub emulator: &'a Emulator,
    /// The space of its parameters.
    pub space: &'a Space,
    /// Draws of the posterior in that space.
    pub draws: &'a [Vec<f64>],
    /// Where the runs so far stand.
    pub runs: &'a [Vec<f64>],
    /// Where samples stand that have no run: it failed.
    pub failed: &'a [Vec<f64>],
    /// What an error of each score counts for, shape (components,).
    pub importance: Vec<f64>,
    /// What the emulator's variance is multiplied by.
    pub calibration: f64,
}

impl Choice<'_> {
    /// `count` points in the space, the most useful first: where a run lowers the emulator's share of the
    /// variance of ln likelihood most, on average over the posterior, with the points before it taken as
    /// known, times the chance that it does not fail. One in eight is far from all runs.
    ///
    /// # Errors
    /// If there are more parameters than a sequence has dimensions.
    pub fn next(&self, count: usize, seed: u64) -> Result<Vec<Vec<f64>>> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let large = sequence::points(Method::Sobol, 256, self.space.len(), Some(seed))?;
        let large: Vec<Vec<f64>> = large.iter().map(|u| self.space.quantile(u)).collect();
        let (mut candidates, references) = self.places(count, &mut generator);
        if !self.failed.is_empty() {
            // All draws may lie where runs fail.
            candidates.extend(large.iter().cloned());
        }
        let mut ledger = Ledger::new(self, &candidates, &references);
        let mut chances: Vec<f64> =
            candidates.iter().map(|point| chance(point, self.runs, self.failed)).collect();
        let mut chosen: Vec<Vec<f64>> = Vec::with_capacity(count);
        let phase = seed as usize % AT_LARGE;
        for place in 0..count {
            // With small batches, every so many batches.
            let is_at_large = if count >= AT_LARGE {
                place % AT_LARGE == AT_LARGE - 1
            } else {
                place == count - 1 && (phase * count) % AT_LARGE < count
            };
            if is_at_large {
                chosen.push(self.furthest(&large, &chosen));
                continue;
            }
            let best = ledger.best(&chances);
            ledger.take(best);
            // Of equal parameters some simulators give the equal run, and draws may be equal.
            let taken = candidates.iter().zip(&mut chances).filter(|(point, _)| **point == candidates[best]);
            taken.for_each(|(_, chance)| *chance = 0.0);
            chosen.push(candidates[best].clone());
        }
        Ok(chosen)
    }

    /// Candidates, among the draws and around them, and draws to be good at.
    fn places(&self, count: usize, generator: &mut ChaCha8Rng) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let some = |most: usize, generator: &mut ChaCha8Rng| -> Vec<Vec<f64>> {
            let chosen = index::sample(generator, self.draws.len(), most.min(self.draws.len()));
            chosen.into_iter().map(|i| self.draws[i].clone()).collect()
        };
        let wanted = CANDIDATES.max(4 * count);
        let mut candidates = some(wanted / 2, generator);
        let wide = LocalMixture::new(self.draws, 100, 3.0, generator);
        for _ in 0..20 * wanted {
            if candidates.len() >= wanted {
                break;
            }
            let point = wide.draw(generator);
            if point.iter().all(|x| (0.0..=1.0).contains(x)) {
                candidates.push(point);
            }
        }
        (candidates, some(REFERENCES, generator))
    }

    /// The point that lies furthest from all runs, failed or not, and from those chosen.
    fn furthest(&self, points: &[Vec<f64>], chosen: &[Vec<f64>]) -> Vec<f64> {
        let room = |point: &Vec<f64>| {
            let distance = |other: &Vec<f64>| square(point, other);
            self.runs.iter().chain(self.failed).chain(chosen).map(distance).fold(f64::INFINITY, f64::min)
        };
        let mut best = (f64::NEG_INFINITY, &points[0]);
        for point in points {
            let room = room(point);
            if room > best.0 {
                best = (room, point);
            }
        }
        best.1.clone()
    }
}

/// The chance that a run does not fail at a point, by the places about it where runs are done and where they failed: 1 where
/// none has failed.
fn chance(point: &[f64], done: &[Vec<f64>], failed: &[Vec<f64>]) -> f64 {
    let about = |places: &[Vec<f64>]| -> f64 { places.iter().map(|place| likeness(point, place)).sum() };
    let done = BEFOREHAND + about(done);
    done / (done + about(failed))
}

/// Square of the distance of two points of the unit cube.
fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// How much a run tells of another whether it fails: 1 at the same place, and little beyond [`ALIKE`].
fn likeness(a: &[f64], b: &[f64]) -> f64 {
    (-0.5 * square(a, b) / (a.len() as f64 * ALIKE * ALIKE)).exp()
}

/// What is not known of each score at candidates and references, given the runs and what was chosen.
struct Ledger {
    components: Vec<Component>,
}

struct Component {
    importance: f64,
    nugget: f64,
    /// Covariance of references with candidates, shape (references, candidates).
    cross: DMatrix<f64>,
    /// Covariance among candidates, shape (candidates, candidates).
    own: DMatrix<f64>,
}

impl Ledger {
    fn new(choice: &Choice<'_>, candidates: &[Vec<f64>], references: &[Vec<f64>]) -> Self {
        let place = |x: &Vec<f64>| choice.emulator.places(&choice.space.coordinates(x));
        let of_candidates: Vec<_> = candidates.par_iter().map(place).collect();
        let of_references: Vec<_> = references.par_iter().map(place).collect();
        let nugget = choice.emulator.nugget();
        let whole: f64 = choice.importance.iter().sum();
        // What hardly counts need not be weighed.
        let counting: Vec<usize> =
            (0..nugget.len()).filter(|&c| choice.importance[c] > 1e-6 * whole).collect();
        let components = counting
            .into_par_iter()
            .map(|c| {
                let process = &choice.emulator.processes()[c];
                let covariance = |a: &[Vec<crate::gp::Place>], b: &[Vec<crate::gp::Place>]| {
                    DMatrix::from_fn(a.len(), b.len(), |i, j| {
                        choice.calibration * process.covariance(&a[i][c], &b[j][c])
                    })
                };
                Component {
                    importance: choice.importance[c],
                    nugget: nugget[c],
                    cross: covariance(&of_references, &of_candidates),
                    own: covariance(&of_candidates, &of_candidates),
                }
            })
            .collect();
        Self { components }
    }

    /// The candidate that lowers Σ importance · variance over the references most, times the chance of each, 0 if taken, shape
    /// (candidates,).
    fn best(&self, chances: &[f64]) -> usize {
        let candidates = self.components.first().map_or(0, |component| component.own.ncols());
        let gain = |c: usize| -> f64 {
            let of = |component: &Component| {
                let variance = component.own[(c, c)].max(0.0) + component.nugget;
                component.importance * component.cross.column(c).norm_squared() / variance.max(1e-300)
            };
            self.components.iter().map(of).sum()
        };
        // Not of those that are taken, also where nothing is gained anywhere.
        let open = (0..candidates).filter(|&c| chances[c] > 0.0);
        let gains = open.map(|c| (chances[c] * gain(c), c));
        gains.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))).map_or(0, |(_, c)| c)
    }

    /// Take a candidate as known.
    fn take(&mut self, chosen: usize) {
        for component in &mut self.components {
            let reading = component.own[(chosen, chosen)].max(0.0) + component.nugget;
            let scale = 1.0 / reading.max(1e-300);
            let own = component.own.column(chosen).into_owned();
            let cross = component.cross.column(chosen).into_owned();
            component.cross.ger(-scale, &cross, &own, 1.0);
            component.own.ger(-scale, &own, &own, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_not_wanted_where_those_about_a_place_fail() {
        let done = vec![vec![0.1, 0.5], vec![0.3, 0.2], vec![0.4, 0.8]];
        let failed = vec![vec![0.8, 0.4], vec![0.9, 0.7], vec![0.7, 0.6]];
        let chance = |point: [f64; 2], failed: &[Vec<f64>]| chance(&point, &done, failed);
        assert_eq!(chance([0.85, 0.5], &[]), 1.0);
        assert!(chance([0.85, 0.5], &failed) < 0.2);
        assert!(chance([0.15, 0.5], &failed) > 0.9);
        let halfway = chance([0.55, 0.5], &failed);
        assert!((0.3..0.7).contains(&halfway), "{halfway}");
        // One that failed among many that did not is an accident.
        let mut many = done.clone();
        many.extend(vec![vec![0.8, 0.5]; 9]);
        assert!(super::chance(&[0.8, 0.4], &many, &failed[..1]) > 0.8);
    }
}
