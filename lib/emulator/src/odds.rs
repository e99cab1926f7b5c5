//! How far a planned test would tell hypotheses apart.
//!
//! Under a hypothesis the readings of the test are normal: their mean and covariance are those of its draws through the
//! emulator, with the emulator's ignorance, the simulation's scatter and the noise. All that tells hypotheses apart is
//! then in as many numbers as there are components.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use gl_inference::prior::Prior;
use gl_numeric::normal::normal_quantile;
use gl_numeric::statistics::ln_sum_exp;
use gl_table::Table;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::Emulator;

/// Measurements that are imagined under each hypothesis.
const IMAGINED: usize = 4096;

/// A hypothesis and what is known of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Its name.
    pub name: String,
    /// Its probability; those of all sum to one.
    pub probability: f64,
    /// Draws of its posterior: values of all parameters of the prior, shape (draws, parameters).
    pub draws: Vec<Vec<f64>>,
}

impl Hypothesis {
    /// Read `hypothesis probability <parameters…>`, a row a draw; the probabilities are made to sum to one.
    ///
    /// # Errors
    /// If the table cannot be read, lacks a parameter, holds fewer than two hypotheses or two draws of one, or a
    /// probability is not positive, or not the same in all rows of a hypothesis.
    pub fn read_all(path: &Path, prior: &Prior) -> Result<Vec<Self>> {
        let table = Table::read(path)?;
        table.check_end()?;
        let name = table.format().column("hypothesis")?;
        let probability = table.numbers("probability")?;
        let columns =
            prior.names().iter().map(|name| table.format().column(name)).collect::<Result<Vec<_>>>()?;
        let mut all: Vec<Self> = Vec::new();
        for (row, &probability) in probability.iter().enumerate() {
            let draw =
                columns.iter().map(|&column| table.number(row, column)).collect::<Result<Vec<f64>>>()?;
            if probability <= 0.0 {
                return table.fail(
                    row,
                    "probability",
                    format_args!("{probability}; leave out what is ruled out"),
                );
            }
            let name = table.field(row, name);
            match all.iter_mut().find(|of| of.name == name) {
                Some(of) if of.probability != probability => {
                    return table.fail(
                        row,
                        "probability",
                        format_args!("{probability}, but {name} has {} above", of.probability),
                    );
                }
                Some(of) => of.draws.push(draw),
                None => all.push(Self { name: name.to_owned(), probability, draws: vec![draw] }),
            }
        }
        let source = table.format().source();
        ensure!(
            all.len() > 1,
            "{source}: {} hypotheses; to tell hypotheses apart there must be two at least",
            all.len()
        );
        if let Some(of) = all.iter().find(|of| of.draws.len() < 2) {
            ensure!(false, "{source}: one draw of {}; a posterior takes many, such as 200", of.name);
        }
        let whole: f64 = all.iter().map(|of| of.probability).sum();
        all.iter_mut().for_each(|of| of.probability /= whole);
        Ok(all)
    }
}

/// What is to be expected of a planned test where one hypothesis is true.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Mean probability of the hypothesis once the test is measured.
    pub probability: f64,
    /// The hypothesis that it is told from worst.
    pub rival: usize,
    /// ln of the odds against that one as they are.
    pub ln_odds_now: f64,
    /// Their mean once the test is measured: more by the Kullback–Leibler divergence of the two predictions.
    pub ln_odds_then: f64,
}

/// What a planned test would say, for each hypothesis that may be true.
///
/// * `emulator` — of runs of the planned test.
/// * `noise` — standard deviation of its readings, shape (outputs,).
///
/// # Errors
/// If there are fewer than two hypotheses, or a covariance is not finite.
///
/// # Source
/// Lindley (1956), Ann. Math. Stat. 27:986; Box & Hill (1967), Technometrics 9:57.
pub fn expected_odds(
    emulator: &Emulator,
    hypotheses: &[Hypothesis],
    noise: &[f64],
    seed: u64,
) -> Result<Vec<Expected>> {
    ensure!(
        noise.len() == emulator.centre().len(),
        "a noise of {} readings, not {}",
        noise.len(),
        emulator.centre().len()
    );
    // L s with LᵀL = Bᵀ N⁻¹ B, and a unit of noise on each, is as good as the readings themselves.
    let mut scaled = emulator.basis().clone();
    for (i, mut row) in scaled.row_iter_mut().enumerate() {
        row /= (noise[i].powi(2) + emulator.leftover()[i]).sqrt();
    }
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(scaled.tr_mul(&scaled));
    let whiten =
        DMatrix::from_diagonal(&eigenvalues.map(|value| value.max(0.0).sqrt())) * eigenvectors.transpose();
    let predictions = hypotheses
        .iter()
        .map(|of| {
            let scores: Vec<(Vec<f64>, Vec<f64>)> =
                of.draws.par_iter().map(|x| emulator.predict_scores(&emulator.coordinates(x))).collect();
            let (n, k) = (scores.len() as f64, emulator.basis().ncols());
            let rows = DMatrix::from_fn(scores.len(), k, |i, c| scores[i].0[c]);
            let mean = rows.row_mean();
            let apart = DMatrix::from_fn(scores.len(), k, |i, c| rows[(i, c)] - mean[c]);
            let unknown: Vec<f64> = emulator
                .nugget()
                .iter()
                .enumerate()
                .map(|(c, nugget)| nugget + scores.iter().map(|(_, v)| v[c].max(0.0)).sum::<f64>() / n)
                .collect();
            let covariance = apart.tr_mul(&apart) / (n - 1.0) + emulator.score_covariance(&unknown);
            let covariance = &whiten * covariance * whiten.transpose() + DMatrix::identity(k, k);
            Prediction::new(of.probability, &whiten * mean.transpose(), covariance)
                .with_context(|| format!("the prediction of {} is not finite", of.name))
        })
        .collect::<Result<Vec<_>>>()?;
    expected(&predictions, seed)
}

/// What a hypothesis predicts: a normal distribution.
struct Prediction {
    ln_probability: f64,
    mean: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    covariance: DMatrix<f64>,
    ln_determinant: f64,
}

impl Prediction {
    fn new(probability: f64, mean: DVector<f64>, covariance: DMatrix<f64>) -> Option<Self> {
        let factor = Cholesky::new(covariance.clone())?;
        let ln_determinant = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
        Some(Self { ln_probability: probability.ln(), mean, factor, covariance, ln_determinant })
    }

    /// ln of probability times density, but for a constant that all share.
    fn ln_joint(&self, z: &DVector<f64>) -> f64 {
        let mut away = z - &self.mean;
        self.factor.l_dirty().solve_lower_triangular_mut(&mut away);
        self.ln_probability - 0.5 * (away.norm_squared() + self.ln_determinant)
    }

    /// Mean of ln (own density / that of another) where this one is true.
    fn divergence(&self, other: &Self) -> f64 {
        let away = &other.mean - &self.mean;
        let trace = other.factor.solve(&self.covariance).trace();
        let square = away.dot(&other.factor.solve(&away));
        0.5 * (trace + square - away.len() as f64 + other.ln_determinant - self.ln_determinant)
    }
}

fn expected(predictions: &[Prediction], seed: u64) -> Result<Vec<Expected>> {
    ensure!(predictions.len() > 1, "two hypotheses at least, to tell them apart");
    let of = |(place, own): (usize, &Prediction)| {
        // The same numbers for each test, so that tests are compared by what they are.
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(place as u64);
        let factor = own.factor.l();
        let sum: f64 = (0..IMAGINED)
            .map(|_| {
                let normal = DVector::from_fn(own.mean.len(), |_, _| {
                    normal_quantile(random.random::<f64>().clamp(1e-16, 1.0 - 1e-16))
                });
                let z = &own.mean + &factor * normal;
                let joint: Vec<f64> = predictions.iter().map(|other| other.ln_joint(&z)).collect();
                (joint[place] - ln_sum_exp(&joint)).exp()
            })
            .sum();
        let odds = |rival: usize| {
            let other = &predictions[rival];
            let now = own.ln_probability - other.ln_probability;
            Expected {
                probability: sum / IMAGINED as f64,
                rival,
                ln_odds_now: now,
                ln_odds_then: now + own.divergence(other),
            }
        };
        let rivals = (0..predictions.len()).filter(|rival| *rival != place).map(odds);
        rivals.min_by(|a, b| a.ln_odds_then.total_cmp(&b.ln_odds_then)).context("no rival")
    };
    predictions.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(probability: f64, mean: f64, sd: f64) -> Prediction {
        let covariance = DMatrix::from_element(1, 1, sd * sd);
        Prediction::new(probability, DVector::from_element(1, mean), covariance).unwrap()
    }

    #[test]
    fn of_two_normal_predictions_the_odds_are_those_of_the_integral() {
        let table = Table::read(Path::new("../../tests/oracle/odds.tsv")).unwrap();
        let column = |name: &str| table.numbers(name).unwrap();
        let (prior, away, sd) = (column("prior"), column("away"), column("sd"));
        let (probability, ln_odds) = (column("probability"), column("ln_odds"));
        assert!(!prior.is_empty());
        for row in 0..prior.len() {
            let both = [one(prior[row], 0.0, 1.0), one(1.0 - prior[row], away[row], sd[row])];
            let found = expected(&both, 3).unwrap()[0];
            assert!((found.ln_odds_then - ln_odds[row]).abs() < 1e-8, "{row}: {found:?} {}", ln_odds[row]);
            assert!((found.probability - probability[row]).abs() < 0.01, "{row}: {found:?}");
            assert_eq!(found.rival, 1);
        }
    }

    #[test]
    fn the_divergence_of_two_normals_of_two_dimensions_is_that_of_the_closed_form() {
        // Diagonal in turned axes: the sum of those of one dimension.
        let turn = DMatrix::from_row_slice(2, 2, &[0.8, -0.6, 0.6, 0.8]);
        let normal = |mean: [f64; 2], sd: [f64; 2]| {
            let diagonal = DMatrix::from_diagonal(&DVector::from_row_slice(&sd.map(|sd| sd * sd)));
            let mean = &turn * DVector::from_row_slice(&mean);
            Prediction::new(0.5, mean, &turn * diagonal * turn.transpose()).unwrap()
        };
        let single = |away: f64, a: f64, b: f64| (b / a).ln() + (a * a + away * away) / (2.0 * b * b) - 0.5;
        let found = normal([0.0, 1.0], [0.5, 2.0]).divergence(&normal([0.7, -1.0], [1.5, 1.0]));
        assert!((found - single(0.7, 0.5, 1.5) - single(2.0, 2.0, 1.0)).abs() < 1e-12);
    }

    #[test]
    fn a_test_that_all_predict_alike_says_nothing_and_the_nearest_is_the_rival() {
        let three = [one(0.5, 0.0, 1.0), one(0.3, 0.0, 1.0), one(0.2, 9.0, 1.0)];
        let found = expected(&three, 0).unwrap();
        assert_eq!([found[0].rival, found[1].rival], [1, 0]);
        assert!((found[0].ln_odds_then - found[0].ln_odds_now).abs() < 1e-12);
        assert!((found[0].probability - 0.5 / 0.8).abs() < 1e-3, "{found:?}");
        assert!(found[2].probability > 0.999);
    }
}
