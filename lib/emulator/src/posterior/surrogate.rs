//! The emulator behind a posterior: which runs it learns from, and how good it is where it matters.

use std::collections::HashSet;

use anyhow::{Context, Result};
use gl_inference::ensemble::Ensemble;
use gl_inference::samples::Samples;
use nalgebra::{DMatrix, DVector};

use super::likelihood::Measured;
use super::scatter::Scatter;
use super::space::Space;
use crate::gp::{Gp, Hyperparameters, Kernel};
use crate::{Emulator, Options};

/// Runs that an emulator learns from at most; its cost grows with their cube.
const MOST_RUNS: usize = 220;

/// Runs that the first look learns from at most.
const MOST_FIRST: usize = 150;

/// Components at most.
const COMPONENTS: usize = 24;

/// Variance that the components may leave over, summed over the readings, in that of the noise: it may be the
/// same error at all of them. A share of the runs' variance where the noise is not known.
const LEFTOVER: f64 = 0.02;
const LEFTOVER_SHARE: f64 = 1e-8;

/// Share of another emulator's error below which one is better, not by chance.
const BETTER: f64 = 0.9;

/// The same for one of half of the runs, which knows nothing of where the others stand.
const MUCH_BETTER: f64 = 0.5;

/// Starts of the search for lengths.
const STARTS: usize = 5;

/// With few runs, short lengths are more often chance than not.
const SHORT_LENGTH: f64 = 0.3;

/// Largest factor on the emulator's variance.
pub(super) const MOST_CALIBRATION: f64 = 9.0;

/// An emulator, and what its leave-one-out errors on the runs near the posterior are.
#[derive(Clone, Debug)]
pub struct Surrogate {
    /// The emulator.
    pub emulator: Emulator,
    /// What the runs differ by about its mean.
    pub scatter: Scatter,
    /// What its variance is multiplied by, so that its errors are as large as it says.
    pub calibration: f64,
    /// Root mean square of the leave-one-out errors near the posterior, in standard deviations of the noise.
    pub rmse: f64,
    /// Kurtosis of the standardised errors near the posterior; 3 for normal ones.
    pub kurtosis: f64,
    /// How it was trained.
    pub recipe: Recipe,
}

impl Surrogate {
    /// The mean curve at a point, whose parameters come first, as the emulator sees readings, shape (observables · steps,).
    pub fn curve(&self, space: &Space, x: &[f64]) -> DVector<f64> {
        self.emulator.curve(&self.emulator.mean_scores(&space.coordinates(x)))
    }
}

/// How an emulator is trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Correlation of the processes.
    pub kernel: Kernel,
    /// Whether half of the runs, those that fit badly, are left out but for some.
    pub is_local: bool,
    /// Whether the lengths are those that an emulator of fewer runs had.
    pub is_kept: bool,
}

/// Of all runs, by less smooth processes.
pub const PLAIN: Recipe = Recipe { kernel: Kernel::Matern, is_local: false, is_kept: false };

/// The runs, from the one that fits best to the one that fits worst.
#[derive(Clone, Debug)]
pub struct Ranked<'a> {
    space: &'a Space,
    samples: &'a Samples,
    ensemble: &'a Ensemble,
    /// Places in the ensemble.
    pub order: Vec<usize>,
    /// Summed misfit of each run, in the order of the ensemble.
    pub misfit: Vec<f64>,
    /// What an emulator of some of the runs found, one a component, where the search for lengths starts, too.
    known: Vec<Hyperparameters>,
}

impl<'a> Ranked<'a> {
    /// Rank all runs of an ensemble.
    pub fn new(space: &'a Space, samples: &'a Samples, ensemble: &'a Ensemble, measured: &Measured) -> Self {
        let misfit: Vec<f64> =
            (0..ensemble.len()).map(|run| measured.misfit(&ensemble.curves(run).concat())).collect();
        let mut order: Vec<usize> = (0..ensemble.len()).collect();
        order.sort_by(|&a, &b| {
            misfit[a].total_cmp(&misfit[b]).then_with(|| ensemble.samples[a].cmp(&ensemble.samples[b]))
        });
        Self { space, samples, ensemble, order, misfit, known: Vec::new() }
    }

    /// The same runs, ranked by what an emulator predicts at their parameters: where the simulator scatters,
    /// those that fit best by themselves are those that scatter towards the measurement.
    ///
    /// # Errors
    /// If a sample lacks a parameter.
    pub fn by_prediction(&self, emulator: &Emulator, measured: &Measured) -> Result<Self> {
        let values = self.samples.columns(&self.space.prior().names())?;
        let index = self.samples.index();
        let predicted: Vec<f64> = self
            .ensemble
            .samples
            .iter()
            .zip(&self.misfit)
            .map(|(name, misfit)| {
                let Some(&place) = index.get(name.as_str()) else { return *misfit };
                let scores = emulator.mean_scores(&emulator.coordinates(&values[place]));
                let curve = emulator.curve(&scores);
                measured.misfit(curve.as_slice())
            })
            .collect();
        let mut order = self.order.clone();
        order.sort_by(|&a, &b| {
            let names = || self.ensemble.samples[a].cmp(&self.ensemble.samples[b]);
            predicted[a].total_cmp(&predicted[b]).then_with(names)
        });
        Ok(Self { order, ..self.clone() })
    }

    /// The same, with the search for lengths starting from what an emulator found, too.
    pub fn starting_from(&self, surrogate: &Surrogate) -> Self {
        let processes = surrogate.emulator.processes();
        Self { known: processes.iter().map(Gp::hyperparameters).collect(), ..self.clone() }
    }

    /// The same without some runs.
    pub fn without(&self, names: &HashSet<&str>) -> Self {
        let keep = |run: &usize| !names.contains(self.ensemble.samples[*run].as_str());
        Self { order: self.order.iter().copied().filter(keep).collect(), ..self.clone() }
    }

    /// Name and readings of each run, shape (observables · steps), from the best.
    pub fn curves(&self) -> impl Iterator<Item = (&str, Vec<f64>)> {
        self.order
            .iter()
            .map(|&run| (self.ensemble.samples[run].as_str(), self.ensemble.curves(run).concat()))
    }

    /// Where the runs stand, from the best.
    ///
    /// # Errors
    /// If a sample lacks a parameter.
    pub fn places(&self) -> Result<Vec<Vec<f64>>> {
        let values = self.samples.columns(&self.space.prior().names())?;
        let index = self.samples.index();
        let names = self.order.iter().map(|&run| self.ensemble.samples[run].as_str());
        Ok(names.filter_map(|name| index.get(name)).map(|&i| self.space.place(&values[i])).collect())
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Runs that count as near the posterior: the quarter that fits best, two a parameter at least.
    pub fn near(&self) -> usize {
        (self.len() / 4).max(2 * self.space.len() + 2).min(self.len())
    }

    /// `best` runs that fit best, and `others` of the rest, evenly from good to bad.
    fn some(&self, best: usize, others: usize) -> Ensemble {
        let best = best.min(self.len());
        let rest = &self.order[best..];
        let others = others.min(rest.len());
        let spread = (0..others).map(|i| rest[i * rest.len() / others]);
        let runs: Vec<usize> = self.order[..best].iter().copied().chain(spread).collect();
        self.ensemble.part(&runs, 0..self.ensemble.steps())
    }

    /// An emulator for a first look: of few enough runs that it is quick.
    ///
    /// # Errors
    /// See [`Emulator::fit`].
    pub fn first_look(&self, measured: &Measured, seed: u64) -> Result<Surrogate> {
        self.train(PLAIN, (MOST_FIRST * 3 / 4, MOST_FIRST / 4), measured, seed)
    }

    /// The emulator that predicts the runs near the posterior best, each left out in turn: of smooth or
    /// less smooth processes, of all runs or, where `may_be_local`, of those that fit best with some of the others.
    ///
    /// # Errors
    /// If none can be trained; see [`Emulator::fit`].
    pub fn best(&self, measured: &Measured, seed: u64, may_be_local: bool) -> Result<Surrogate> {
        let mut candidates = Vec::new();
        let is_local_possible = may_be_local && self.len() / 2 >= 5 * (self.space.len() + 1);
        for is_local in [false, true] {
            for kernel in [Kernel::Matern, Kernel::Gaussian] {
                if !is_local || is_local_possible {
                    candidates.push(Recipe { kernel, is_local, is_kept: false });
                }
            }
        }
        // More runs are not to make it worse: where the search went astray, what was found before serves.
        if !self.known.is_empty() {
            candidates.push(Recipe { is_kept: true, ..PLAIN });
        }
        let mut best: Option<Surrogate> = None;
        let mut failure = None;
        for recipe in candidates {
            let better = if recipe.is_local { MUCH_BETTER } else { BETTER };
            match self.by(recipe, measured, seed) {
                Ok(surrogate) => {
                    if best.as_ref().is_none_or(|best| surrogate.rmse < better * best.rmse) {
                        best = Some(surrogate);
                    }
                }
                Err(error) => failure = Some(error),
            }
        }
        match (best, failure) {
            (Some(best), _) => Ok(best),
            (None, Some(failure)) => Err(failure),
            (None, None) => Err(anyhow::anyhow!("no way to train an emulator")),
        }
    }

    /// An emulator trained in one way.
    ///
    /// # Errors
    /// See [`Emulator::fit`].
    pub fn by(&self, recipe: Recipe, measured: &Measured, seed: u64) -> Result<Surrogate> {
        let n = self.len();
        let counts = if recipe.is_local {
            ((n / 2).min(MOST_RUNS * 4 / 5), (n / 8).min(MOST_RUNS / 5))
        } else {
            (n.min(MOST_RUNS * 2 / 3), MOST_RUNS / 3)
        };
        self.train(recipe, counts, measured, seed)
    }

    /// Derivatives of the scores by the coordinates, in the mean over some runs, shape (components, parameters).
    fn slopes(&self, emulator: &Emulator, samples: &Samples, near: &HashSet<&str>) -> Result<DMatrix<f64>> {
        let parameters = self.space.prior().names();
        let values = samples.columns(&parameters)?;
        let places = samples.names.iter().zip(&values).filter(|(name, _)| near.contains(name.as_str()));
        let gradients: Vec<_> =
            places.map(|(_, values)| emulator.score_gradients(&emulator.coordinates(values)).1).collect();
        let count = gradients.len().max(1) as f64;
        Ok(DMatrix::from_fn(emulator.processes().len(), parameters.len(), |c, p| {
            gradients.iter().map(|of| of[c][p]).sum::<f64>() / count
        }))
    }

    fn train(
        &self,
        recipe: Recipe,
        (best, others): (usize, usize),
        measured: &Measured,
        seed: u64,
    ) -> Result<Surrogate> {
        let runs = self.some(best, others);
        let noise = measured
            .is_known
            .then(|| (0..measured.observables()).map(|j| measured.base[measured.own(j)].to_vec()).collect());
        let leftover =
            if measured.is_known { LEFTOVER / measured.values.len() as f64 } else { LEFTOVER_SHARE };
        let options = Options {
            noise,
            leftover: Some(leftover),
            max_components: COMPONENTS,
            kernel: recipe.kernel,
            starts: if recipe.is_kept { 0 } else { STARTS },
            known: self.known.clone(),
            short_length: SHORT_LENGTH,
            seed,
            ..Options::default()
        };
        let known: HashSet<&str> = runs.samples.iter().map(String::as_str).collect();
        let rows: Vec<usize> =
            (0..self.samples.len()).filter(|&i| known.contains(self.samples.names[i].as_str())).collect();
        let samples = Samples {
            source: self.samples.source.clone(),
            names: rows.iter().map(|&i| self.samples.names[i].clone()).collect(),
            parameters: self.samples.parameters.clone(),
            values: rows.iter().map(|&i| self.samples.values[i].clone()).collect(),
        };
        let emulator = Emulator::fit(self.space.prior(), &samples, &runs, &options)?;
        let near: HashSet<&str> =
            self.order[..self.near()].iter().map(|&run| self.ensemble.samples[run].as_str()).collect();
        let errors = LeftOut::new(&emulator, &near, measured).context("no run near the posterior")?;
        Ok(Surrogate {
            scatter: Scatter::new(&emulator, measured, &self.slopes(&emulator, &samples, &near)?),
            emulator,
            calibration: errors.calibration,
            rmse: errors.rmse,
            kurtosis: errors.kurtosis,
            recipe,
        })
    }
}

/// What leaving out the runs near the posterior says.
struct LeftOut {
    rmse: f64,
    calibration: f64,
    kurtosis: f64,
}

impl LeftOut {
    fn new(emulator: &Emulator, near: &HashSet<&str>, measured: &Measured) -> Option<Self> {
        let places: Vec<usize> =
            (0..emulator.runs().len()).filter(|&i| near.contains(emulator.runs()[i].as_str())).collect();
        if places.is_empty() {
            return None;
        }
        let outputs = measured.values.len();
        let weight: Vec<f64> = emulator
            .basis()
            .column_iter()
            .map(|column| column.iter().zip(&measured.base).map(|(b, base)| (b / base).powi(2)).sum())
            .collect();
        let left_out: Vec<_> = emulator.processes().iter().map(|process| process.leave_one_out()).collect();
        let nugget = emulator.nugget();
        let leftover: f64 =
            emulator.leftover().iter().zip(&measured.base).map(|(v, base)| v / (base * base)).sum();
        let (mut squares, mut errors, mut ignorance, mut scattered) = (0.0, 0.0, 0.0, 0.0);
        let (mut second, mut fourth, mut count, mut count_squares) = (0.0, 0.0, 0.0, 0.0);
        for &i in &places {
            let mut square = leftover;
            for (c, weight) in weight.iter().enumerate() {
                let error = (emulator.scores()[(i, c)] - left_out[c].mean[i]).powi(2);
                let variance = left_out[c].variance[i];
                square += weight * error;
                // Bounded, so that a single run does not decide.
                errors += weight * error.min(25.0 * variance);
                ignorance += weight * (variance - nugget[c]).max(0.0);
                scattered += weight * nugget[c].min(variance);
                let share = weight * variance;
                second += share * error / variance;
                fourth += share * (error / variance).powi(2);
                count += share;
                count_squares += share * share;
            }
            squares += (square / outputs as f64).max(1e-8).ln();
        }
        // Squares are known no better than their number says: drawn towards one by twice that.
        let known = count * count / count_squares.max(f64::MIN_POSITIVE);
        let chance = 2.0 * (scattered + ignorance) * (2.0 / known).sqrt();
        let calibration = ((errors - scattered + chance) / (ignorance + chance).max(f64::MIN_POSITIVE))
            .clamp(1.0, MOST_CALIBRATION);
        let kurtosis = (fourth / count) / (second / count).powi(2).max(f64::MIN_POSITIVE);
        Some(Self {
            rmse: (0.5 * squares / places.len() as f64).exp(),
            calibration: if calibration.is_finite() { calibration } else { 1.0 },
            kurtosis: if kurtosis.is_finite() { kurtosis } else { 3.0 },
        })
    }
}
