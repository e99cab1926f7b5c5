//! Variational Bayesian Gaussian mixture of weighted samples.
//!
//! Bishop (2006), Pattern Recognition and Machine Learning, §10.2; stick-breaking weights of Blei &
//! Jordan (2006), Bayesian Analysis 1:121. Each responsibility is multiplied by the weight of its
//! sample times the number of samples, so that equal weights are the unweighted fit.

use anyhow::{Result, ensure};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::function::beta::ln_beta;
use statrs::function::gamma::{digamma, ln_gamma};

use crate::statistics::ln_sum_exp;

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

/// Fit a mixture from random beginnings and keep the one with the highest lower bound.
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
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut best: Option<Mixture> = None;
    for _ in 0..starts.max(1) {
        let responsibilities = nearest_centres(samples, weights, options.components, &mut rng);
        let mixture = fit_from(samples, weights, &responsibilities, options)?;
        if best.as_ref().is_none_or(|best| mixture.lower_bound > best.lower_bound) {
            best = Some(mixture);
        }
    }
    best.ok_or_else(|| anyhow::anyhow!("no samples to fit a mixture to"))
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
    let mut mixture = fit.maximise(responsibilities)?;
    let mut bound = f64::NEG_INFINITY;
    for iteration in 1..=options.max_iterations {
        let (responsibilities, entropy) = fit.expect(&mixture)?;
        mixture = fit.maximise(&responsibilities)?;
        mixture.lower_bound = fit.lower_bound(&mixture, entropy)?;
        mixture.iterations = iteration;
        if (mixture.lower_bound - bound).abs() < options.tolerance {
            mixture.converged = true;
            break;
        }
        bound = mixture.lower_bound;
    }
    Ok(mixture)
}

/// Responsibilities of weighted k-means++ centres, each sample wholly its nearest centre's.
///
/// # Source
/// Arthur & Vassilvitskii (2007), SODA, 1027.
fn nearest_centres(
    samples: &[Vec<f64>],
    weights: &[f64],
    count: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let squared = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let draw = |chances: &[f64], rng: &mut ChaCha8Rng| {
        let mut left = rng.random::<f64>() * chances.iter().sum::<f64>();
        chances
            .iter()
            .position(|chance| {
                left -= chance;
                left < 0.0
            })
            .unwrap_or(0)
    };
    let mut centres = vec![samples[draw(weights, rng)].clone()];
    let mut nearest = vec![0; samples.len()];
    while centres.len() < count {
        let distances = |x: &Vec<f64>| centres.iter().map(|c| squared(x, c)).fold(f64::INFINITY, f64::min);
        let chances: Vec<f64> = samples.iter().zip(weights).map(|(x, w)| w * distances(x)).collect();
        centres.push(samples[draw(&chances, rng)].clone());
    }
    for _ in 0..10 {
        for (place, x) in nearest.iter_mut().zip(samples) {
            *place = (0..count)
                .min_by(|&a, &b| squared(x, &centres[a]).total_cmp(&squared(x, &centres[b])))
                .unwrap_or(0);
        }
        for (k, centre) in centres.iter_mut().enumerate() {
            let members = || (0..samples.len()).filter(|&i| nearest[i] == k);
            let total: f64 = members().map(|i| weights[i]).sum();
            if total > 0.0 {
                for (j, x) in centre.iter_mut().enumerate() {
                    *x = members().map(|i| weights[i] * samples[i][j]).sum::<f64>() / total;
                }
            }
        }
    }
    nearest.iter().map(|&place| (0..count).map(|k| f64::from(u8::from(k == place))).collect()).collect()
}

/// The samples with their prior, which stay as they are while the mixture changes.
struct Fit<'a> {
    samples: &'a [Vec<f64>],
    /// Weight of each sample times the number of samples.
    counts: Vec<f64>,
    dimensions: usize,
    options: &'a Options,
    concentration: f64,
    mean_prior: Vec<f64>,
    covariance_prior: DMatrix<f64>,
}

/// Precision of the prior mean.
const MEAN_PRECISION_PRIOR: f64 = 1.0;

impl<'a> Fit<'a> {
    fn new(samples: &'a [Vec<f64>], weights: &[f64], options: &'a Options) -> Result<Self> {
        ensure!(!samples.is_empty(), "no samples to fit a mixture to");
        ensure!(options.components > 0, "a mixture has at least one component");
        let n = samples.len() as f64;
        let dimensions = samples[0].len();
        let counts: Vec<f64> = weights.iter().map(|w| w * n).collect();
        let mean_prior: Vec<f64> = (0..dimensions)
            .map(|j| samples.iter().zip(&counts).map(|(x, c)| c * x[j]).sum::<f64>() / n)
            .collect();
        let full = scatter(samples, &counts, &mean_prior) / (n - 1.0).max(1.0);
        let covariance_prior = match options.covariance {
            CovarianceType::Full | CovarianceType::Tied => full,
            CovarianceType::Diagonal => DMatrix::from_diagonal(&full.diagonal()),
            CovarianceType::Spherical => {
                DMatrix::identity(dimensions, dimensions) * (full.trace() / dimensions as f64)
            }
        };
        let concentration = options.concentration.unwrap_or(1.0 / options.components as f64);
        Ok(Self { samples, counts, dimensions, options, concentration, mean_prior, covariance_prior })
    }

    /// The variational posterior of the components' parameters, given the responsibilities.
    fn maximise(&self, responsibilities: &[Vec<f64>]) -> Result<Mixture> {
        let (d, k_max) = (self.dimensions, self.options.components);
        let mut sizes = vec![10.0 * f64::EPSILON; k_max];
        let mut centres = vec![vec![0.0; d]; k_max];
        for ((x, count), row) in self.samples.iter().zip(&self.counts).zip(responsibilities) {
            for (k, share) in row.iter().enumerate() {
                sizes[k] += count * share;
                for (centre, x) in centres[k].iter_mut().zip(x) {
                    *centre += count * share * x;
                }
            }
        }
        for (centre, size) in centres.iter_mut().zip(&sizes) {
            centre.iter_mut().for_each(|x| *x /= size);
        }
        let mut scatters: Vec<DMatrix<f64>> = (0..k_max)
            .map(|k| {
                let shares: Vec<f64> =
                    responsibilities.iter().zip(&self.counts).map(|(row, count)| row[k] * count).collect();
                scatter(self.samples, &shares, &centres[k])
            })
            .collect();
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

    /// Responsibilities of the components for the samples, and their weighted entropy.
    fn expect(&self, mixture: &Mixture) -> Result<(Vec<Vec<f64>>, f64)> {
        let d = self.dimensions as f64;
        let ln_weights = self.expected_ln_weights(mixture);
        let mut components = Vec::new();
        for (k, ln_weight) in ln_weights.iter().enumerate() {
            let nu = mixture.degrees_of_freedom[k];
            let gaussian = Gaussian::new(&mixture.means[k], &mixture.covariances[k])?;
            let ln_lambda: f64 =
                d * 2f64.ln() + (0..self.dimensions).map(|j| digamma(0.5 * (nu - j as f64))).sum::<f64>();
            let shift = ln_weight - 0.5 * d * nu.ln() + 0.5 * (ln_lambda - d / mixture.mean_precision[k]);
            components.push((gaussian, shift));
        }
        let mut entropy = 0.0;
        let mut scratch = vec![0.0; self.dimensions];
        let responsibilities = self
            .samples
            .iter()
            .zip(&self.counts)
            .map(|(x, count)| {
                let mut row: Vec<f64> =
                    components.iter().map(|(g, shift)| g.ln_density(x, &mut scratch) + shift).collect();
                let ln_total = ln_sum_exp(&row);
                for ln_share in &mut row {
                    *ln_share -= ln_total;
                    let share = ln_share.exp();
                    entropy -= if share > 0.0 { count * share * *ln_share } else { 0.0 };
                    *ln_share = share;
                }
                row
            })
            .collect();
        Ok((responsibilities, entropy))
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

/// Σ cᵢ (xᵢ − centre)(xᵢ − centre)ᵀ, shape (dimensions, dimensions).
fn scatter(samples: &[Vec<f64>], counts: &[f64], centre: &[f64]) -> DMatrix<f64> {
    let d = centre.len();
    let mut sum = DMatrix::zeros(d, d);
    let mut away = vec![0.0; d];
    for (x, &count) in samples.iter().zip(counts).filter(|(_, count)| **count > 0.0) {
        for ((away, x), c) in away.iter_mut().zip(x).zip(centre) {
            *away = x - c;
        }
        for i in 0..d {
            for j in 0..=i {
                sum[(i, j)] += count * away[i] * away[j];
            }
        }
    }
    sum.fill_upper_triangle_with_lower_triangle();
    sum
}

fn factor(covariance: &DMatrix<f64>) -> Result<Cholesky<f64, Dyn>> {
    Cholesky::new(covariance.clone())
        .ok_or_else(|| anyhow::anyhow!("a covariance of the mixture is not positive definite"))
}

fn ln_determinant(factor: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>()
}

/// A normal distribution, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Gaussian {
    mean: Vec<f64>,
    /// Lower Cholesky factor of the covariance, row by row.
    lower: Vec<Vec<f64>>,
    ln_norm: f64,
}

impl Gaussian {
    /// The normal distribution with this mean and covariance.
    ///
    /// # Errors
    /// If the covariance is not positive definite.
    pub fn new(mean: &[f64], covariance: &DMatrix<f64>) -> Result<Self> {
        let factor = factor(covariance)?;
        let d = mean.len();
        let lower = (0..d).map(|i| (0..=i).map(|j| factor.l_dirty()[(i, j)]).collect()).collect();
        let ln_norm = -0.5 * (d as f64 * std::f64::consts::TAU.ln() + ln_determinant(&factor));
        Ok(Self { mean: mean.to_vec(), lower, ln_norm })
    }

    /// Squared Mahalanobis distance of a point from the mean; `scratch` has its length.
    pub fn squared_distance(&self, x: &[f64], scratch: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        for (i, row) in self.lower.iter().enumerate() {
            let mut rest = x[i] - self.mean[i];
            for (l, y) in row[..i].iter().zip(scratch.iter()) {
                rest -= l * y;
            }
            scratch[i] = rest / row[i];
            sum += scratch[i] * scratch[i];
        }
        sum
    }

    /// Natural logarithm of the density at a point; `scratch` has its length.
    pub fn ln_density(&self, x: &[f64], scratch: &mut [f64]) -> f64 {
        self.ln_norm - 0.5 * self.squared_distance(x, scratch)
    }

    /// ln of the density at the mean.
    pub fn ln_peak(&self) -> f64 {
        self.ln_norm
    }

    /// The point at `standard` normal coordinates: mean + L z.
    pub fn point(&self, standard: &[f64]) -> Vec<f64> {
        let along = |row: &Vec<f64>| row.iter().zip(standard).map(|(l, z)| l * z).sum::<f64>();
        self.lower.iter().zip(&self.mean).map(|(row, mean)| mean + along(row)).collect()
    }
}
