//! Variational Bayesian Gaussian mixture of weighted samples.
//!
//! Bishop (2006), Pattern Recognition and Machine Learning, §10.2; stick-breaking weights of Blei &
//! Jordan (2006), Bayesian Analysis 1:121. Each responsibility is multiplied by the weight of its
//! sample times the number of samples, so that equal weights are the unweighted fit.

use anyhow::{Context, Result, ensure};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use statrs::function::beta::ln_beta;
use statrs::function::gamma::{digamma, ln_gamma};

mod blocks;
mod gaussian;
mod start;

use blocks::{Blocks, Moments, Sums};
pub use gaussian::Gaussian;
use gaussian::{factor, ln_determinant};
use start::nearest_centres;

/// Shape of the components' covariances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CovarianceType {
    /// Each component has its own.
    Full,
    /// All components share one.
    Tied,
    /// Each has its own, with axes along the parameters.
    Diagonal,
    /// Each has its own, the same in all directions.
    Spherical,
}

/// Prior of the components' weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightPrior {
    /// Stick-breaking construction of a Dirichlet process, cut off at the number of components.
    DirichletProcess,
    /// Dirichlet distribution.
    Dirichlet,
}

/// How a mixture is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Number of components at the most.
    pub components: usize,
    /// Shape of the covariances.
    pub covariance: CovarianceType,
    /// Prior of the weights.
    pub weight_prior: WeightPrior,
    /// Concentration of the weights' prior; 1/components if absent. Small means few components.
    pub concentration: Option<f64>,
    /// Added to the diagonal of every covariance.
    pub regularisation: f64,
    /// Gain in the lower bound at which the fit ends.
    pub tolerance: f64,
    /// Iterations at the most.
    pub max_iterations: usize,
}

impl Options {
    /// The usual fit with so many components.
    pub fn new(components: usize, covariance: CovarianceType) -> Self {
        Self {
            components,
            covariance,
            weight_prior: WeightPrior::DirichletProcess,
            concentration: None,
            regularisation: 1e-6,
            tolerance: 1e-3,
            max_iterations: 200,
        }
    }
}

/// A fitted mixture, with the parameters of its variational posterior.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// Expected weights, shape (components,), which sum to one.
    pub weights: Vec<f64>,
    /// Means, shape (components, dimensions).
    pub means: Vec<Vec<f64>>,
    /// Expected covariances, each of shape (dimensions, dimensions), whatever the covariance type.
    pub covariances: Vec<DMatrix<f64>>,
    /// Precision of each mean, shape (components,).
    pub mean_precision: Vec<f64>,
    /// Degrees of freedom of each precision matrix, shape (components,).
    pub degrees_of_freedom: Vec<f64>,
    /// Both concentrations of each stick, or the concentration of each weight and 0, shape (components,).
    pub concentration: Vec<(f64, f64)>,
    /// Lower bound of the evidence, up to a constant.
    pub lower_bound: f64,
    /// Iterations that were needed.
    pub iterations: usize,
    /// Whether the lower bound came to rest.
    pub converged: bool,
}

/// Fit a mixture, going on from that of several random beginnings which has the highest lower bound
/// after a few iterations (Biernacki, Celeux & Govaert 2003, Comput. Stat. Data Anal. 41:561).
///
/// * `samples` — shape (n, dimensions).
/// * `weights` — weights of the samples, shape (n,), which sum to one.
///
/// # Errors
/// If there are no samples, or a covariance is not positive definite in spite of the regularisation.
pub fn fit(
    samples: &[Vec<f64>],
    weights: &[f64],
    options: &Options,
    starts: usize,
    seed: u64,
) -> Result<Mixture> {
    let fit = Fit::new(samples, weights, options)?;
    let begin = |start: usize| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(start as u64);
        let nearest = nearest_centres(samples, weights, options.components, &mut rng);
        let mixture = fit.begin(|i, k| f64::from(u8::from(nearest[i] == k)))?;
        fit.climb(mixture, SHORT_RUN)
    };
    let begun: Vec<Mixture> = (0..starts.max(1)).into_par_iter().map(begin).collect::<Result<_>>()?;
    let best =
        begun.into_iter().reduce(|best, next| if next.lower_bound > best.lower_bound { next } else { best });
    fit.climb(best.context("no start")?, options.max_iterations)
}

/// Fit a mixture from given responsibilities, shape (n, components), whose rows sum to one.
///
/// # Errors
/// See [`fit`].
pub fn fit_from(
    samples: &[Vec<f64>],
    weights: &[f64],
    responsibilities: &[Vec<f64>],
    options: &Options,
) -> Result<Mixture> {
    let fit = Fit::new(samples, weights, options)?;
    fit.climb(fit.begin(|i, k| responsibilities[i][k])?, options.max_iterations)
}

/// The samples with their prior, which stay as they are while the mixture changes.
struct Fit<'a> {
    samples: Blocks,
    dimensions: usize,
    options: &'a Options,
    concentration: f64,
    mean_prior: Vec<f64>,
    covariance_prior: DMatrix<f64>,
}

/// Precision of the prior mean.
const MEAN_PRECISION_PRIOR: f64 = 1.0;

/// Iterations after which the beginnings are compared.
const SHORT_RUN: usize = 20;

impl<'a> Fit<'a> {
    fn new(samples: &[Vec<f64>], weights: &[f64], options: &'a Options) -> Result<Self> {
        ensure!(!samples.is_empty(), "no samples to fit a mixture to");
        ensure!(options.components > 0, "a mixture has at least one component");
        let n = samples.len() as f64;
        let dimensions = samples[0].len();
        let counts: Vec<f64> = weights.iter().map(|w| w * n).collect();
        let mean_prior: Vec<f64> = (0..dimensions)
            .map(|j| samples.iter().zip(&counts).map(|(x, c)| c * x[j]).sum::<f64>() / n)
            .collect();
        let samples = Blocks::new(samples, &counts);
        let moments = samples.sums_of_shares(&[&mean_prior], |_, _| 1.0);
        let full = moments.components[0].scatter() / (n - 1.0).max(1.0);
        let covariance_prior = match options.covariance {
            CovarianceType::Full | CovarianceType::Tied => full,
            CovarianceType::Diagonal => DMatrix::from_diagonal(&full.diagonal()),
            CovarianceType::Spherical => {
                DMatrix::identity(dimensions, dimensions) * (full.trace() / dimensions as f64)
            }
        };
        let concentration = options.concentration.unwrap_or(1.0 / options.components as f64);
        Ok(Self { samples, dimensions, options, concentration, mean_prior, covariance_prior })
    }

    /// The first mixture, from the share of each sample in each component.
    fn begin(&self, share: impl Fn(usize, usize) -> f64 + Sync) -> Result<Mixture> {
        let references = vec![self.mean_prior.as_slice(); self.options.components];
        self.maximise(&references, &self.samples.sums_of_shares(&references, share))
    }

    /// Go on with a mixture until its lower bound comes to rest, or it has had so many iterations.
    fn climb(&self, mut mixture: Mixture, iterations: usize) -> Result<Mixture> {
        while mixture.iterations < iterations && !mixture.converged {
            let sums = self.samples.sums_by_density(&self.expected_densities(&mixture)?);
            let references: Vec<&[f64]> = mixture.means.iter().map(Vec::as_slice).collect();
            let mut next = self.maximise(&references, &sums)?;
            next.lower_bound = self.lower_bound(&next, sums.entropy)?;
            next.iterations = mixture.iterations + 1;
            next.converged = (next.lower_bound - mixture.lower_bound).abs() < self.options.tolerance;
            mixture = next;
        }
        Ok(mixture)
    }

    /// The variational posterior of the components' parameters, given sums over the samples about
    /// reference points.
    fn maximise(&self, references: &[&[f64]], sums: &Sums) -> Result<Mixture> {
        let (d, k_max) = (self.dimensions, self.options.components);
        let sizes: Vec<f64> = sums.components.iter().map(|c| c.size + 10.0 * f64::EPSILON).collect();
        let centres: Vec<Vec<f64>> = sums
            .components
            .iter()
            .zip(references)
            .map(|(moments, reference)| moments.centre(reference))
            .collect();
        let mut scatters: Vec<DMatrix<f64>> = sums.components.iter().map(Moments::scatter).collect();
        let mean_precision: Vec<f64> = sizes.iter().map(|size| MEAN_PRECISION_PRIOR + size).collect();
        let means: Vec<Vec<f64>> = (0..k_max)
            .map(|k| {
                let pull = |j: usize| MEAN_PRECISION_PRIOR * self.mean_prior[j] + sizes[k] * centres[k][j];
                (0..d).map(|j| pull(j) / mean_precision[k]).collect()
            })
            .collect();
        // Between-component part: how far a component's centre is from the prior mean.
        let between = |k: usize| {
            let away = DVector::from_fn(d, |j, _| centres[k][j] - self.mean_prior[j]);
            &away * away.transpose() * (sizes[k] * MEAN_PRECISION_PRIOR / mean_precision[k])
        };
        let ridge = DMatrix::identity(d, d) * self.options.regularisation;
        let mut degrees_of_freedom: Vec<f64> = sizes.iter().map(|size| d as f64 + size).collect();
        let covariances = match self.options.covariance {
            CovarianceType::Tied => {
                let total: f64 = sizes.iter().sum();
                let share = total / k_max as f64;
                degrees_of_freedom = vec![d as f64 + share; k_max];
                let within = scatters.iter().fold(DMatrix::zeros(d, d), |sum, s| sum + s) / total + ridge;
                let between = (0..k_max).fold(DMatrix::zeros(d, d), |sum, k| sum + between(k)) / k_max as f64;
                let one = (&self.covariance_prior + within * share + between) / degrees_of_freedom[0];
                vec![one; k_max]
            }
            kind => {
                for (k, scatter) in scatters.iter_mut().enumerate() {
                    *scatter += &ridge * sizes[k];
                    *scatter += between(k);
                    match kind {
                        CovarianceType::Diagonal => *scatter = DMatrix::from_diagonal(&scatter.diagonal()),
                        CovarianceType::Spherical => {
                            *scatter = DMatrix::identity(d, d) * (scatter.trace() / d as f64)
                        }
                        _ => {}
                    }
                    *scatter += &self.covariance_prior;
                    *scatter /= degrees_of_freedom[k];
                }
                scatters
            }
        };
        let concentration = self.stick_concentrations(&sizes);
        let weights = expected_weights(self.options.weight_prior, &concentration);
        Ok(Mixture {
            weights,
            means,
            covariances,
            mean_precision,
            degrees_of_freedom,
            concentration,
            lower_bound: f64::NEG_INFINITY,
            iterations: 0,
            converged: false,
        })
    }

    fn stick_concentrations(&self, sizes: &[f64]) -> Vec<(f64, f64)> {
        let mut after: f64 = sizes.iter().sum();
        sizes
            .iter()
            .map(|size| match self.options.weight_prior {
                WeightPrior::DirichletProcess => {
                    after -= size;
                    (1.0 + size, self.concentration + after.max(0.0))
                }
                WeightPrior::Dirichlet => (self.concentration + size, 0.0),
            })
            .collect()
    }

    /// The expected ln density of each component, and what to add to it.
    fn expected_densities(&self, mixture: &Mixture) -> Result<Vec<(Gaussian, f64)>> {
        let d = self.dimensions as f64;
        let ln_weights = self.expected_ln_weights(mixture);
        let density = |(k, ln_weight): (usize, f64)| {
            let nu = mixture.degrees_of_freedom[k];
            let gaussian = Gaussian::new(&mixture.means[k], &mixture.covariances[k])?;
            let ln_lambda: f64 =
                d * 2f64.ln() + (0..self.dimensions).map(|j| digamma(0.5 * (nu - j as f64))).sum::<f64>();
            let shift = ln_weight - 0.5 * d * nu.ln() + 0.5 * (ln_lambda - d / mixture.mean_precision[k]);
            Ok((gaussian, shift))
        };
        ln_weights.into_iter().enumerate().map(density).collect()
    }

    fn expected_ln_weights(&self, mixture: &Mixture) -> Vec<f64> {
        match self.options.weight_prior {
            WeightPrior::DirichletProcess => {
                let mut before = 0.0;
                mixture
                    .concentration
                    .iter()
                    .map(|&(a, b)| {
                        let ln_weight = digamma(a) - digamma(a + b) + before;
                        before += digamma(b) - digamma(a + b);
                        ln_weight
                    })
                    .collect()
            }
            WeightPrior::Dirichlet => {
                let total: f64 = mixture.concentration.iter().map(|(a, _)| a).sum();
                mixture.concentration.iter().map(|&(a, _)| digamma(a) - digamma(total)).collect()
            }
        }
    }

    fn lower_bound(&self, mixture: &Mixture, entropy: f64) -> Result<f64> {
        let d = self.dimensions as f64;
        let mut ln_wishart = 0.0;
        for (covariance, &nu) in mixture.covariances.iter().zip(&mixture.degrees_of_freedom) {
            let ln_det_half = -0.5 * ln_determinant(&factor(covariance)?) - 0.5 * d * nu.ln();
            let gammas: f64 = (0..self.dimensions).map(|j| ln_gamma(0.5 * (nu - j as f64))).sum();
            ln_wishart -= nu * ln_det_half + nu * d * 0.5 * 2f64.ln() + gammas;
        }
        let ln_norm_weight = match self.options.weight_prior {
            WeightPrior::DirichletProcess => {
                -mixture.concentration.iter().map(|&(a, b)| ln_beta(a, b)).sum::<f64>()
            }
            WeightPrior::Dirichlet => {
                let total: f64 = mixture.concentration.iter().map(|(a, _)| a).sum();
                ln_gamma(total) - mixture.concentration.iter().map(|&(a, _)| ln_gamma(a)).sum::<f64>()
            }
        };
        let ln_precision: f64 = mixture.mean_precision.iter().map(|p| p.ln()).sum();
        Ok(entropy - ln_wishart - ln_norm_weight - 0.5 * d * ln_precision)
    }
}

fn expected_weights(prior: WeightPrior, concentration: &[(f64, f64)]) -> Vec<f64> {
    let mut left = 1.0;
    let mut weights: Vec<f64> = concentration
        .iter()
        .map(|&(a, b)| match prior {
            WeightPrior::DirichletProcess => {
                let weight = left * a / (a + b);
                left *= b / (a + b);
                weight
            }
            WeightPrior::Dirichlet => a,
        })
        .collect();
    let total: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= total);
    weights
}
