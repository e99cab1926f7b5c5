//! A fast stand-in for the simulator: Gaussian processes on the principal components of its curves.
//!
//! The ensemble's curves are scaled by observable, put behind each other and reduced to principal
//! components; the score of each component is a Gaussian process over the parameters. What an
//! emulator does not know (its ignorance, less near the runs) is kept apart from what the simulator
//! itself scatters (the nugget: the same parameters with another packing). What the components leave
//! over has a variance of its own.
//!
//! Higdon, Gattiker, Williams & Rightley (2008), JASA 103:570.

pub mod cholesky;
mod components;
pub mod gp;
mod inputs;
mod kernel;
mod minimise;
pub mod odds;
mod points;
pub mod posterior;
pub mod sensitivity;
pub mod table;
#[cfg(test)]
mod tests;
mod train;
pub mod warp;

use anyhow::{Result, ensure};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use components::{Components, Enough};
use gl_inference::ensemble::Ensemble;
use gl_inference::prior::{Prior, normal_quantile};
use gl_inference::samples::Samples;
use gl_progress::stage;
use gp::{Gp, Hyperparameters, Kernel, Mean, Points};
use inputs::Inputs;
pub use inputs::Reach;
use train::{SHORT_LENGTH, Search, train};

/// What may be chosen about an emulator.
#[derive(Clone, Debug)]
pub struct Options {
    /// Standard deviation of the measurement's noise, shape (observables, steps).
    pub noise: Option<Vec<Vec<f64>>>,
    /// Components at most.
    pub max_components: usize,
    /// Variance that the components may leave over, as a share of the noise's, or of the runs' where there is
    /// no noise; 0.01 and 1e-6 if absent.
    pub leftover: Option<f64>,
    /// Mean function; linear if absent and there are at least three runs for each of its terms, else
    /// constant.
    pub mean: Option<Mean>,
    /// Correlation of the processes.
    pub kernel: Kernel,
    /// Lengths, in ranges of the runs, below which there must be good reason to believe in them.
    pub short_length: f64,
    /// Whether a component may be nothing but scatter, where there are enough runs to tell.
    pub may_be_scatter: bool,
    /// Number of places that the search for the lengths starts from.
    pub starts: usize,
    /// Hyperparameters to start from, too, one a component; without any other start they are taken as they are.
    pub known: Vec<Hyperparameters>,
    /// Seed of those places.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            noise: None,
            max_components: 15,
            leftover: None,
            mean: None,
            kernel: Kernel::default(),
            short_length: SHORT_LENGTH,
            may_be_scatter: false,
            starts: 4,
            known: Vec::new(),
            seed: 0,
        }
    }
}

impl Options {
    /// What the curves of the runs, shape (runs, outputs), are measured in, shape (outputs,), and how many components are
    /// enough for them; `starts` is where the outputs of each observable begin.
    fn components(&self, curves: &DMatrix<f64>, starts: &[usize]) -> Result<(Vec<f64>, Enough)> {
        let most = self.max_components;
        if let Some(noise) = &self.noise {
            let scale = noise.concat();
            ensure!(
                scale.len() == curves.ncols() && scale.iter().all(|&sd| sd > 0.0),
                "the noise of an emulator is not positive, or not that of {} observables and {} readings",
                starts.len() - 1,
                curves.ncols()
            );
            return Ok((scale, Enough { leftover: self.leftover.unwrap_or(0.01), share: 1e-12, most }));
        }
        let of_observable = |ends: &[usize]| {
            let range = range_of(curves, ends[0]..ends[1]);
            vec![if range > 0.0 { range } else { 1.0 }; ends[1] - ends[0]]
        };
        let scale = starts.windows(2).flat_map(of_observable).collect();
        Ok((scale, Enough { leftover: 0.0, share: self.leftover.unwrap_or(1e-6), most }))
    }

    /// A process of each component.
    ///
    /// * `rows` — inputs of the runs, shape (runs, inputs).
    /// * `scores` — shape (runs, components).
    fn train(&self, rows: &[Vec<f64>], scores: &DMatrix<f64>) -> Result<Vec<Gp>> {
        let (n, d) = (rows.len(), rows[0].len());
        let default_mean = if n >= 3 * (d + 1) { Mean::Linear } else { Mean::Constant };
        let search = Search {
            mean: self.mean.unwrap_or(default_mean),
            starts: self.starts,
            short_length: self.short_length,
            may_be_scatter: self.may_be_scatter,
        };
        let points = Points::new(rows, search.mean)?.with_kernel(self.kernel);
        let stage = stage("training the emulator", scores.ncols());
        (0..scores.ncols())
            .into_par_iter()
            .map(|c| {
                let mut generator = ChaCha8Rng::seed_from_u64(self.seed);
                generator.set_stream(c as u64);
                let known = self.known.get(c);
                train(rows, &points, scores.column(c).as_slice(), search, known, &mut generator)
            })
            .inspect(|_| stage.advance())
            .collect()
    }
}

/// A trained emulator. Outputs are all observables behind each other, each at all steps.
#[derive(Clone, Debug)]
pub struct Emulator {
    prior: Prior,
    observables: Vec<String>,
    /// Where the outputs of each observable begin, and the number of all, shape (observables + 1,).
    starts: Vec<usize>,
    runs: Vec<String>,
    missing: usize,
    inputs: Inputs,
    components: Components,
    processes: Vec<Gp>,
    /// Correlation of the scores' errors, shape (components, components).
    correlation: DMatrix<f64>,
    /// Variance of the scatter, shape (outputs,).
    scatter: DVector<f64>,
    curves: DMatrix<f64>,
}

/// The curves of a sample, each of shape (outputs,).
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Mean.
    pub mean: DVector<f64>,
    /// Variance of the emulator's ignorance, with what the components leave over.
    pub variance: DVector<f64>,
    /// Variance of the simulation's own scatter.
    pub scatter: DVector<f64>,
}

/// How well each run of an observable is predicted from all the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Name of the observable.
    pub observable: String,
    /// Root mean square of predicted minus simulated, over runs and steps.
    pub rmse: f64,
    /// The same over the observable's range in the ensemble; 0 if that is 0.
    pub rmse_range: f64,
    /// Share of simulated values in the predicted 90 % interval.
    pub coverage90: f64,
    /// Root mean square of the scatter's standard deviation over steps.
    pub scatter_sd: f64,
}

impl Emulator {
    /// Train an emulator on the runs of an ensemble.
    ///
    /// Samples that have no run (it failed) are left out. The result depends on neither the number of
    /// threads nor the order of the runs.
    ///
    /// # Errors
    /// If a run is no sample, a parameter is no column, the ensemble is an emulator's, there are fewer
    /// runs than inputs + 2, or no parameter varies.
    pub fn fit(prior: &Prior, samples: &Samples, ensemble: &Ensemble, options: &Options) -> Result<Self> {
        ensure!(
            ensemble.is_empty() || ensemble.curve_sd(0, 0).is_none(),
            "{}: has _sd columns; an emulator is trained on runs, not on what an emulator predicted",
            ensemble.source
        );
        let mut order: Vec<usize> = (0..ensemble.len()).collect();
        order.sort_by(|&a, &b| ensemble.samples[a].cmp(&ensemble.samples[b]));
        let coordinates = coordinates_of_runs(prior, samples, ensemble, &order)?;
        let inputs = Inputs::new(prior, &coordinates);
        let (n, d) = (order.len(), inputs.len());
        ensure!(
            n >= d + 2,
            "{}: {n} runs for {d} inputs; an emulator needs at least {} and is good with {}",
            ensemble.source,
            d + 2,
            10 * d.max(1)
        );
        ensure!(d > 0, "{}: all runs have the same parameters", ensemble.source);

        let (starts, curves) = curves_of(ensemble, &order);
        let (scale, enough) = options.components(&curves, &starts)?;
        let components = Components::new(&curves, &scale, enough)?;
        let rows: Vec<Vec<f64>> = coordinates.iter().map(|run| inputs.at(run)).collect();
        let processes = options.train(&rows, &components.scores)?;
        let correlation = error_correlation(&processes, &components.scores);
        let mut emulator = Self {
            prior: prior.clone(),
            observables: ensemble.observables.clone(),
            starts,
            runs: order.iter().map(|&run| ensemble.samples[run].clone()).collect(),
            missing: samples.len() - n,
            inputs,
            components,
            processes,
            correlation,
            scatter: DVector::zeros(curves.ncols()),
            curves,
        };
        emulator.scatter = emulator.spread(&emulator.nugget());
        Ok(emulator)
    }

    /// Names of the runs that it was trained on, in their own order.
    pub fn runs(&self) -> &[String] {
        &self.runs
    }

    /// Number of samples that had no run.
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// Variance of the simulation's own scatter, shape (outputs,).
    pub fn scatter(&self) -> &DVector<f64> {
        &self.scatter
    }

    /// The outputs of an observable.
    pub fn outputs_of(&self, observable: usize) -> std::ops::Range<usize> {
        self.starts[observable]..self.starts[observable + 1]
    }

    /// Names of the observables.
    pub fn observables(&self) -> &[String] {
        &self.observables
    }

    /// Mean curve of the runs, shape (outputs,).
    pub fn centre(&self) -> &DVector<f64> {
        &self.components.centre
    }

    /// The components, shape (outputs, components): a curve is centre + basis · scores.
    pub fn basis(&self) -> &DMatrix<f64> {
        &self.components.basis
    }

    /// Variance of what the components leave over, shape (outputs,).
    pub fn leftover(&self) -> &DVector<f64> {
        &self.components.leftover
    }

    /// Variance of each score by the simulation's own scatter, shape (components,).
    pub fn nugget(&self) -> Vec<f64> {
        self.processes.iter().map(Gp::nugget).collect()
    }

    /// The Gaussian process of each score.
    pub fn processes(&self) -> &[Gp] {
        &self.processes
    }

    /// Coordinates of parameter values, both in the order of the prior; see
    /// [`Parameter::coordinate`](gl_inference::prior::Parameter::coordinate).
    pub fn coordinates(&self, parameters: &[f64]) -> Vec<f64> {
        coordinates_of(&self.prior, parameters)
    }

    /// How coordinates, shape (parameters,), lie to the runs.
    pub fn reach(&self, coordinates: &[f64]) -> Reach {
        self.inputs.reach(coordinates)
    }

    /// Mean of each score at coordinates, shape (components,).
    pub fn mean_scores(&self, coordinates: &[f64]) -> Vec<f64> {
        let x = self.inputs.at(coordinates);
        self.processes.iter().map(|process| process.mean(&x)).collect()
    }

    /// The curve that has these scores, shape (observables · steps,).
    pub fn curve(&self, scores: &[f64]) -> DVector<f64> {
        self.centre() + self.basis() * DVector::from_column_slice(scores)
    }

    /// Mean of each score and variance of the emulator's ignorance about it at coordinates, each of
    /// shape (components,).
    pub fn predict_scores(&self, coordinates: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let x = self.inputs.at(coordinates);
        self.processes.iter().map(|process| process.predict(&x)).unzip()
    }

    /// [`Emulator::predict_scores`] at several coordinates, shape (points, parameters), which costs less than one after
    /// the other.
    pub fn predict_all_scores(&self, coordinates: &[Vec<f64>]) -> Vec<(Vec<f64>, Vec<f64>)> {
        let points: Vec<Vec<f64>> =
            coordinates.iter().map(|coordinates| self.inputs.at(coordinates)).collect();
        let all: Vec<Vec<(f64, f64)>> =
            self.processes.iter().map(|process| process.predict_all(&points)).collect();
        (0..points.len()).map(|point| all.iter().map(|scores| scores[point]).unzip()).collect()
    }

    /// What covariances of the scores at coordinates, shape (parameters,), with those at others need, one
    /// place a component; see [`Gp::place`].
    pub fn places(&self, coordinates: &[f64]) -> Vec<gp::Place> {
        let x = self.inputs.at(coordinates);
        self.processes.iter().map(|process| process.place(&x)).collect()
    }

    /// Correlation of the scores' errors, shape (components, components).
    pub fn correlation(&self) -> &DMatrix<f64> {
        &self.correlation
    }

    /// Scores of the runs, shape (runs, components), in the order of [`Emulator::runs`].
    pub fn scores(&self) -> &DMatrix<f64> {
        &self.components.scores
    }

    /// The runs' curves, shape (runs, outputs), in the order of [`Emulator::runs`].
    pub fn curves_of_runs(&self) -> &DMatrix<f64> {
        &self.curves
    }

    /// Mean of each score, shape (components,), and its derivatives by the coordinates, shape
    /// (components, parameters).
    pub fn score_gradients(&self, coordinates: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let x = self.inputs.at(coordinates);
        let derivatives = |process: &Gp| {
            let (mean, gradient) = process.mean_gradient(&x);
            (mean, self.inputs.by_coordinates(&gradient))
        };
        self.processes.iter().map(derivatives).unzip()
    }

    /// The curves at coordinates, shape (parameters,).
    pub fn predict(&self, coordinates: &[f64]) -> Prediction {
        let (mean, variance) = self.predict_scores(coordinates);
        self.curves(&mean, &variance, &self.scatter)
    }

    /// Covariance of the scores' errors from their variances, shape (components, components).
    ///
    /// One packing that is stiffer than another moves many scores at once: the scatter of the scores
    /// is correlated, and so is what the emulator learns from it. The correlation is that of the
    /// leave-one-out errors.
    pub fn score_covariance(&self, variance: &[f64]) -> DMatrix<f64> {
        let sd = DVector::from_iterator(variance.len(), variance.iter().map(|v| v.sqrt()));
        self.correlation.component_mul(&(&sd * sd.transpose()))
    }

    /// The variance of outputs from that of scores, shape (outputs,).
    fn spread(&self, variance: &[f64]) -> DVector<f64> {
        let basis = &self.components.basis;
        let weighted = basis * self.score_covariance(variance);
        let products = weighted.component_mul(basis);
        DVector::from_iterator(products.nrows(), products.row_iter().map(|row| row.sum().max(0.0)))
    }

    fn curves(&self, mean: &[f64], variance: &[f64], scatter: &DVector<f64>) -> Prediction {
        Prediction {
            mean: &self.components.centre + &self.components.basis * DVector::from_column_slice(mean),
            variance: self.spread(variance) + &self.components.leftover,
            scatter: scatter.clone(),
        }
    }

    /// Each run predicted from all the others, in the order of [`Emulator::runs`]: the components,
    /// lengths and nuggets are those of all runs.
    pub fn leave_one_out(&self) -> Vec<Prediction> {
        let nugget = self.nugget();
        (0..self.runs.len())
            .map(|i| {
                let left_out = self.processes.iter().map(Gp::leave_one_out);
                let mean: Vec<f64> = left_out.clone().map(|scores| scores.mean[i]).collect();
                let variance: Vec<f64> = left_out
                    .zip(&nugget)
                    .map(|(scores, nugget)| (scores.variance[i] - nugget).max(0.0))
                    .collect();
                self.curves(&mean, &variance, &self.scatter)
            })
            .collect()
    }

    /// Leave-one-out errors of each observable; see [`Emulator::leave_one_out`].
    pub fn check(&self) -> Vec<Check> {
        let predictions = self.leave_one_out();
        let half_width = normal_quantile(0.95);
        let check = |j: usize| {
            let outputs = self.outputs_of(j);
            let count = (self.runs.len() * outputs.len()) as f64;
            let (mut squares, mut covered) = (0.0, 0.0);
            for (i, prediction) in predictions.iter().enumerate() {
                for o in outputs.clone() {
                    let error = prediction.mean[o] - self.curves[(i, o)];
                    let sd = (prediction.variance[o] + prediction.scatter[o]).sqrt();
                    squares += error * error;
                    // A constant observable is predicted exactly, to rounding.
                    covered += f64::from(u8::from(
                        error.abs() <= half_width * sd + 1e-12 * self.curves[(i, o)].abs(),
                    ));
                }
            }
            let rmse = (squares / count).sqrt();
            let range = range_of(&self.curves, outputs.clone());
            let scatter = predictions[0].scatter.rows_range(outputs).mean();
            Check {
                observable: self.observables[j].clone(),
                rmse,
                rmse_range: if range > 0.0 { rmse / range } else { 0.0 },
                coverage90: covered / count,
                scatter_sd: scatter.sqrt(),
            }
        };
        (0..self.observables.len()).map(check).collect()
    }
}

/// Coordinates of the parameters of runs in this order, shape (runs, parameters).
fn coordinates_of_runs(
    prior: &Prior,
    samples: &Samples,
    ensemble: &Ensemble,
    order: &[usize],
) -> Result<Vec<Vec<f64>>> {
    let values = samples.of_runs(&prior.names(), ensemble)?;
    Ok(order.iter().map(|&run| coordinates_of(prior, &values[run])).collect())
}

/// Where the outputs of each observable begin, and the number of all, shape (observables + 1,); and the curves of runs in
/// this order, shape (runs, outputs).
fn curves_of(ensemble: &Ensemble, order: &[usize]) -> (Vec<usize>, DMatrix<f64>) {
    let mut starts = vec![0];
    for j in 0..ensemble.observables.len() {
        starts.push(starts[j] + ensemble.steps_of(j));
    }
    let mut curves = DMatrix::zeros(order.len(), starts[ensemble.observables.len()]);
    for (i, &run) in order.iter().enumerate() {
        for (j, start) in starts[..ensemble.observables.len()].iter().enumerate() {
            for (t, y) in ensemble.curve(run, j).iter().enumerate() {
                curves[(i, start + t)] = *y;
            }
        }
    }
    (starts, curves)
}

fn coordinates_of(prior: &Prior, parameters: &[f64]) -> Vec<f64> {
    prior.parameters().iter().zip(parameters).map(|(parameter, &value)| parameter.coordinate(value)).collect()
}

/// Correlation of the standardised leave-one-out errors of the scores, drawn towards none by as many
/// made-up runs as there are components.
fn error_correlation(processes: &[Gp], scores: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, k) = scores.shape();
    let mut errors = DMatrix::from_fn(n, k, |i, c| {
        let left_out = processes[c].leave_one_out();
        (scores[(i, c)] - left_out.mean[i]) / left_out.variance[i].sqrt()
    });
    for mut column in errors.column_iter_mut() {
        let size = column.norm();
        column /= if size > 0.0 { size } else { 1.0 };
    }
    let share = n as f64 / (n + k) as f64;
    DMatrix::from_fn(k, k, |c, d| if c == d { 1.0 } else { share * errors.column(c).dot(&errors.column(d)) })
}

/// Largest minus smallest value of an observable over all runs and steps.
fn range_of(curves: &DMatrix<f64>, outputs: std::ops::Range<usize>) -> f64 {
    let block = curves.columns(outputs.start, outputs.len());
    block.max() - block.min()
}
