//! What a simulation's curves depend on, and what a further test would say.
//!
//! Sobol's indices through an emulator: the share of a curve's variance over the prior that a parameter makes alone
//! (first order) and with all its interactions (total). Several readings together have the shares of their summed
//! variances. All of it follows from products of the scores, so that the emulator is asked once for all outputs.

use anyhow::{Context, Result, ensure};
use gl_inference::samples::Samples;
use gl_inference::weights::Weights;
use gl_numeric::sequence::{self, Method};
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use crate::Emulator;
use crate::posterior::space::Space;

/// Sobol sequences, each scrambled by itself, whose differences say how far the indices can be trusted.
pub const REPLICATES: u64 = 8;

/// Points of each.
pub const POINTS: usize = 1024;

/// Products of the outputs of a function over one sequence, each of shape (outputs, outputs).
#[derive(Clone, Debug)]
pub struct Products {
    /// Covariance.
    total: DMatrix<f64>,
    /// Covariance of what each parameter makes alone, shape (parameters,).
    first: Vec<DMatrix<f64>>,
    /// Covariance of what each makes with all others, shape (parameters,).
    all: Vec<DMatrix<f64>>,
}

/// Indices of one parameter, each with the standard error over the replicates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Index {
    /// Share of the variance that the parameter makes alone.
    pub first: f64,
    /// Its standard error.
    pub first_error: f64,
    /// Share that it makes alone and with others.
    pub total: f64,
    /// Its standard error.
    pub total_error: f64,
}

/// Products for [`indices`]: `f` takes a point of the unit cube of so many dimensions to its outputs, any number of them.
///
/// First-order terms by mean f(B)(f(A_B) − f(A)), total ones by half the mean square of f(A) − f(A_B): A and B are the
/// two halves of a Sobol sequence of twice the dimensions, A_B is A with one column of B.
///
/// # Errors
/// If there are more dimensions than a sequence has.
///
/// # Source
/// Saltelli et al. (2010), Comput. Phys. Commun. 181:259; Jansen (1999), Comput. Phys. Commun. 117:35.
pub fn products(
    dimensions: usize,
    points: usize,
    seed: u64,
    f: impl Fn(&[f64]) -> Vec<f64> + Sync,
) -> Result<Products> {
    let cube = sequence::points(Method::Sobol, points, 2 * dimensions, Some(seed))?;
    let outputs: Vec<Vec<Vec<f64>>> = cube
        .par_iter()
        .map(|u| {
            let (a, b) = u.split_at(dimensions);
            let mixed = |j: usize| {
                let mut x = a.to_vec();
                x[j] = b[j];
                f(&x)
            };
            [f(a), f(b)].into_iter().chain((0..dimensions).map(mixed)).collect()
        })
        .collect();
    let k = outputs[0][0].len();
    let of = |place: usize| DMatrix::from_fn(points, k, |i, c| outputs[i][place][c]);
    let (mut a, mut b) = (of(0), of(1));
    let centre = DVector::from_fn(k, |c, _| 0.5 * (a.column(c).mean() + b.column(c).mean()));
    let n = points as f64;
    let centred = |matrix: &mut DMatrix<f64>| {
        for mut row in matrix.row_iter_mut() {
            row -= centre.transpose();
        }
    };
    centred(&mut a);
    centred(&mut b);
    let total = (a.tr_mul(&a) + b.tr_mul(&b)) / (2.0 * n);
    let (mut first, mut all) = (Vec::new(), Vec::new());
    for j in 0..dimensions {
        let mut mixed = of(2 + j);
        centred(&mut mixed);
        let apart = &mixed - &a;
        first.push(b.tr_mul(&apart) / n);
        all.push(apart.tr_mul(&apart) / (2.0 * n));
    }
    Ok(Products { total, first, all })
}

/// The indices of each parameter, for outputs whose variances count as `weight`, shape (outputs, outputs): those of
/// one output have a one on the diagonal, those of readings B s of scores s have Σ b bᵀ over the rows of B.
///
/// All are 0 where nothing varies. The mean and its standard error over the replicates.
pub fn indices(replicates: &[Products], weight: &DMatrix<f64>) -> Vec<Index> {
    let dimensions = replicates.first().map_or(0, |products| products.first.len());
    let of = |matrix: &DMatrix<f64>| matrix.dot(weight);
    let share = |of_parameter: &dyn Fn(&Products) -> f64| {
        let shares: Vec<f64> = replicates
            .iter()
            .map(|products| {
                let variance = of(&products.total);
                if variance > 0.0 { of_parameter(products) / variance } else { 0.0 }
            })
            .collect();
        let n = shares.len() as f64;
        let mean = shares.iter().sum::<f64>() / n;
        let square = shares.iter().map(|share| (share - mean).powi(2)).sum::<f64>();
        (mean, (square / (n * (n - 1.0).max(1.0))).sqrt())
    };
    (0..dimensions)
        .map(|j| {
            let (first, first_error) = share(&|products| of(&products.first[j]));
            let (total, total_error) = share(&|products| of(&products.all[j]));
            Index { first, first_error, total, total_error }
        })
        .collect()
}

/// A stretch of the control of one observable: what its readings depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Place of the observable.
    pub observable: usize,
    /// Its steps.
    pub steps: std::ops::Range<usize>,
    /// Standard deviation over the prior, the root of its mean square over the steps.
    pub sd: f64,
    /// Share of the variance that the emulator does not know: with it, the indices are of the rest.
    pub ignorance: f64,
    /// Indices of the parameters that vary.
    pub indices: Vec<Index>,
}

/// Sobol indices of each observable of an emulator by so many stretches of the control.
///
/// # Errors
/// If there are more parameters than a sequence has dimensions for.
pub fn sobol(emulator: &Emulator, space: &Space, stretches: usize, seed: u64) -> Result<Vec<Stretch>> {
    let scores = |u: &[f64]| emulator.mean_scores(&space.coordinates(&space.quantile(u)));
    let replicates = (0..REPLICATES)
        .map(|replicate| products(space.len(), POINTS, REPLICATES * seed + replicate, scores))
        .collect::<Result<Vec<_>>>()?;
    let some = sequence::points(Method::Sobol, POINTS / 4, space.len(), Some(seed))?;
    let variance: Vec<DVector<f64>> =
        some.par_iter().map(|u| emulator.predict(&space.coordinates(&space.quantile(u))).variance).collect();
    let variance = variance.iter().sum::<DVector<f64>>() / variance.len() as f64;
    let mut all = Vec::new();
    for observable in 0..emulator.observables().len() {
        let outputs = emulator.outputs_of(observable);
        let count = stretches.clamp(1, outputs.len());
        for stretch in 0..count {
            let steps = stretch * outputs.len() / count..(stretch + 1) * outputs.len() / count;
            let own = emulator.basis().rows(outputs.start + steps.start, steps.len());
            let weight = own.tr_mul(&own);
            let known = replicates.iter().map(|products| products.total.dot(&weight)).sum::<f64>()
                / REPLICATES as f64;
            let unknown = variance.rows(outputs.start + steps.start, steps.len()).sum();
            let whole = known + unknown;
            all.push(Stretch {
                observable,
                sd: (known / steps.len() as f64).sqrt(),
                ignorance: if whole > 0.0 { unknown / whole } else { 0.0 },
                indices: indices(&replicates, &weight),
                steps,
            });
        }
    }
    Ok(all)
}

/// Draws of the parameters in units of their prior: each between its bounds, in standard deviations of the prior.
#[derive(Clone, Debug)]
pub struct Told {
    /// Names of the parameters that vary.
    pub names: Vec<String>,
    /// Standard deviation of the prior, in coordinates of 0 to 1 between the bounds, shape (parameters,).
    pub prior_sd: Vec<f64>,
    /// Covariance of the posterior, in units of the prior's standard deviations, shape (parameters, parameters).
    pub covariance: DMatrix<f64>,
    /// The draws in coordinates, shape (draws, parameters), and their weights.
    draws: Vec<Vec<f64>>,
    weights: Vec<f64>,
}

/// A direction in the space of the parameters, in units of their prior.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// Share of the prior's variance that is left along it.
    pub left: f64,
    /// Part of each parameter, shape (parameters,), of unit length; the largest is positive.
    pub parts: Vec<f64>,
}

impl Told {
    /// What weighted samples of a posterior say.
    ///
    /// # Errors
    /// If a parameter is no column of theirs.
    pub fn new(space: &Space, weights: &Weights) -> Result<Self> {
        let table = Samples {
            source: weights.source.clone(),
            names: weights.samples.clone(),
            parameters: weights.parameters.clone(),
            values: weights.values.clone(),
        };
        let values = table.columns(&space.prior().names())?;
        let draws = values.iter().map(|row| space.place(row)).collect();
        Self::of(space, draws, weights.weight.clone())
    }

    /// Draws of the prior, where nothing is measured yet.
    ///
    /// # Errors
    /// If there are more parameters than a sequence has dimensions.
    pub fn prior(space: &Space, seed: u64) -> Result<Self> {
        let points = sequence::points(Method::Sobol, POINTS, space.len(), Some(seed))?;
        let draws: Vec<Vec<f64>> = points.iter().map(|u| space.quantile(u)).collect();
        let even = vec![1.0 / draws.len() as f64; draws.len()];
        Self::of(space, draws, even)
    }

    fn of(space: &Space, draws: Vec<Vec<f64>>, weights: Vec<f64>) -> Result<Self> {
        let points = sequence::points(Method::Sobol, 4096, space.len(), None)?;
        let prior: Vec<Vec<f64>> = points.iter().map(|u| space.quantile(u)).collect();
        let even = vec![1.0 / prior.len() as f64; prior.len()];
        let of_prior = covariance(&prior, &even);
        let prior_sd: Vec<f64> = (0..space.len()).map(|j| of_prior[(j, j)].sqrt()).collect();
        let mut covariance = covariance(&draws, &weights);
        for i in 0..space.len() {
            for j in 0..space.len() {
                covariance[(i, j)] /= prior_sd[i] * prior_sd[j];
            }
        }
        let names = space.varied().iter().map(|&j| space.prior().parameters()[j].name.clone()).collect();
        Ok(Self { names, prior_sd, covariance, draws, weights })
    }

    /// Share of each parameter's prior variance that is left, shape (parameters,).
    pub fn left(&self) -> Vec<f64> {
        self.covariance.diagonal().iter().copied().collect()
    }

    /// The directions that are told from each other, from the one that stays freest.
    pub fn directions(&self) -> Vec<Direction> {
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(self.covariance.clone());
        let mut order: Vec<usize> = (0..eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
        let direction = |&k: &usize| {
            let vector = eigenvectors.column(k);
            let sign = if vector[vector.icamax()] < 0.0 { -1.0 } else { 1.0 };
            Direction {
                left: eigenvalues[k].max(0.0),
                parts: vector.iter().map(|part| sign * part).collect(),
            }
        };
        order.iter().map(direction).collect()
    }

    /// The covariance that is to be expected once a further test is measured, as [`Told::covariance`]: of what its
    /// readings would say through the best linear estimate, which no posterior is wider than in the mean. Its readings
    /// have the noise, the emulator's ignorance and the simulation's scatter.
    ///
    /// * `emulator` — of runs of the planned test.
    /// * `noise` — standard deviation of its readings, shape (outputs,).
    ///
    /// # Errors
    /// If the covariances are not finite.
    pub fn after(&self, space: &Space, emulator: &Emulator, noise: &[f64]) -> Result<DMatrix<f64>> {
        ensure!(
            noise.len() == emulator.centre().len(),
            "a noise of {} readings, not {}",
            noise.len(),
            emulator.centre().len()
        );
        let predicted: Vec<(Vec<f64>, Vec<f64>)> =
            self.draws.par_iter().map(|x| emulator.predict_scores(&space.coordinates(x))).collect();
        let (d, k) = (space.len(), emulator.basis().ncols());
        let joint: Vec<Vec<f64>> = self
            .draws
            .iter()
            .zip(&predicted)
            .map(|(x, (scores, _))| {
                x.iter().zip(&self.prior_sd).map(|(x, sd)| x / sd).chain(scores.iter().copied()).collect()
            })
            .collect();
        let all = covariance(&joint, &self.weights);
        let of_scores = all.view((d, d), (k, k)).into_owned();
        let between = all.view((0, d), (d, k)).into_owned();
        let ignorance: Vec<f64> = (0..k)
            .map(|c| predicted.iter().zip(&self.weights).map(|((_, v), w)| w * v[c].max(0.0)).sum::<f64>())
            .zip(emulator.nugget())
            .map(|(ignorance, nugget)| ignorance + nugget)
            .collect();
        // H = Bᵀ N⁻¹ B: what the readings say of the scores. C − C (C + E + H⁻¹)⁻¹ Cᵀ without an inverse of H, which
        // may be singular.
        let mut scaled = emulator.basis().clone();
        for (i, mut row) in scaled.row_iter_mut().enumerate() {
            let variance = noise[i].powi(2) + emulator.leftover()[i];
            row /= variance.sqrt();
        }
        let information = scaled.tr_mul(&scaled);
        let within = of_scores + emulator.score_covariance(&ignorance);
        let inner = DMatrix::identity(k, k) + &information * &within;
        let gain = inner.lu().solve(&(&information * between.transpose()));
        let gain = gain.context("the covariance of the planned readings is not finite")?;
        let after = all.view((0, 0), (d, d)).into_owned() - between * gain;
        Ok(0.5 * (&after + after.transpose()))
    }
}

/// What a further test says in all: half the ln of the ratio of the determinants of the covariances before and after, in
/// nats.
pub fn information(before: &DMatrix<f64>, after: &DMatrix<f64>) -> f64 {
    let ln_determinant = |matrix: &DMatrix<f64>| {
        let floor = DMatrix::identity(matrix.nrows(), matrix.nrows()) * 1e-12;
        Cholesky::new(matrix + floor)
            .map_or(f64::NAN, |factor| 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>())
    };
    0.5 * (ln_determinant(before) - ln_determinant(after))
}

/// Covariance of weighted rows, shape (columns, columns).
fn covariance(rows: &[Vec<f64>], weights: &[f64]) -> DMatrix<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    let mean = |j: usize| rows.iter().zip(weights).map(|(row, weight)| weight * row[j]).sum::<f64>();
    let centre: Vec<f64> = (0..columns).map(mean).collect();
    let mut all = DMatrix::zeros(columns, columns);
    for (row, weight) in rows.iter().zip(weights) {
        for i in 0..columns {
            for j in 0..=i {
                all[(i, j)] += weight * (row[i] - centre[i]) * (row[j] - centre[j]);
            }
        }
    }
    for i in 0..columns {
        for j in 0..i {
            all[(j, i)] = all[(i, j)];
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn of(dimensions: usize, f: impl Fn(&[f64]) -> f64 + Sync) -> Vec<Index> {
        let replicates: Vec<Products> =
            (0..REPLICATES).map(|seed| products(dimensions, 4096, seed, |u| vec![f(u)]).unwrap()).collect();
        indices(&replicates, &DMatrix::identity(1, 1))
    }

    fn close(found: &[Index], first: &[f64], total: &[f64], tolerance: f64) {
        for (j, index) in found.iter().enumerate() {
            assert!((index.first - first[j]).abs() < tolerance, "first {j}: {index:?} {}", first[j]);
            assert!((index.total - total[j]).abs() < tolerance, "total {j}: {index:?} {}", total[j]);
            // The error that is told is about that which is made.
            assert!((index.first - first[j]).abs() < 5.0 * index.first_error + 1e-9, "{j}: {index:?}");
            assert!((index.total - total[j]).abs() < 5.0 * index.total_error + 1e-9, "{j}: {index:?}");
        }
    }

    #[test]
    fn the_indices_of_ishigami_are_those_of_the_closed_form() {
        // Ishigami & Homma (1990): sin x₁ + 7 sin² x₂ + 0.1 x₃⁴ sin x₁.
        let found = of(3, |u| {
            let x: Vec<f64> = u.iter().map(|u| PI * (2.0 * u - 1.0)).collect();
            x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
        });
        let (a, b) = (7.0, 0.1);
        let v1 = 0.5 * (1.0 + b * PI.powi(4) / 5.0).powi(2);
        let v2 = a * a / 8.0;
        let v13 = b * b * PI.powi(8) * (1.0 / 18.0 - 1.0 / 50.0);
        let v = v1 + v2 + v13;
        close(&found, &[v1 / v, v2 / v, 0.0], &[(v1 + v13) / v, v2 / v, v13 / v], 0.01);
    }

    #[test]
    fn the_indices_of_sobols_g_are_those_of_the_closed_form() {
        let a = [0.0, 1.0, 4.5, 9.0, 99.0];
        let found =
            of(5, |u| u.iter().zip(a).map(|(u, a)| ((4.0 * u - 2.0).abs() + a) / (1.0 + a)).product());
        let v: Vec<f64> = a.iter().map(|a| 1.0 / (3.0 * (1.0 + a) * (1.0 + a))).collect();
        let whole: f64 = v.iter().map(|v| 1.0 + v).product::<f64>() - 1.0;
        let first: Vec<f64> = v.iter().map(|v| v / whole).collect();
        let total: Vec<f64> = v.iter().map(|vj| vj * (whole + 1.0) / (1.0 + vj) / whole).collect();
        close(&found, &first, &total, 0.02);
    }

    #[test]
    fn readings_together_have_the_shares_of_their_summed_variances() {
        // Outputs 2x₀ and x₁: variances 4/12 and 1/12.
        let replicates: Vec<Products> = (0..REPLICATES)
            .map(|seed| products(2, 1024, seed, |u| vec![2.0 * u[0], u[1]]).unwrap())
            .collect();
        close(&indices(&replicates, &DMatrix::identity(2, 2)), &[0.8, 0.2], &[0.8, 0.2], 0.01);
        let nothing = indices(&replicates, &DMatrix::zeros(2, 2));
        assert_eq!(nothing, [Index::default(); 2]);
    }

    #[test]
    fn the_indices_are_those_of_salib() {
        let table =
            gl_table::Table::read(std::path::Path::new("../../tests/oracle/sensitivity.tsv")).unwrap();
        let column = |name: &str| table.numbers(name).unwrap();
        let (first, total) = (column("first"), column("total"));
        let (first_conf, total_conf) = (column("first_conf"), column("total_conf"));
        let ishigami = of(3, |u| {
            let x: Vec<f64> = u.iter().map(|u| PI * (2.0 * u - 1.0)).collect();
            x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
        });
        let a = [0.0, 1.0, 4.5, 9.0, 99.0];
        let g = of(5, |u| u.iter().zip(a).map(|(u, a)| ((4.0 * u - 2.0).abs() + a) / (1.0 + a)).product());
        let all: Vec<Index> = ishigami.into_iter().chain(g).collect();
        assert_eq!(all.len(), first.len());
        for (row, index) in all.iter().enumerate() {
            let near = |found: f64, theirs: f64, conf: f64| (found - theirs).abs() < conf.max(0.01);
            assert!(near(index.first, first[row], first_conf[row]), "{row}: {index:?} {}", first[row]);
            assert!(near(index.total, total[row], total_conf[row]), "{row}: {index:?} {}", total[row]);
        }
    }
}
