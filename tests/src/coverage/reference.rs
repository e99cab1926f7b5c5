//! The posterior by the function itself.

use anyhow::Result;
use gl_emulator::cholesky::{Cholesky, Triangle};
use gl_emulator::posterior::smc::{Density, Effort, sample};
use gl_inference::observations::Observations;
use gl_numeric::sequence::{Method, points};

use super::problem::Problem;

/// The density of a measurement under the truth's own covariance.
struct Exact<'a> {
    problem: &'a Problem,
    observations: &'a Observations,
    /// Of one observable.
    covariance: Cholesky,
}

impl<'a> Exact<'a> {
    fn new(problem: &'a Problem, observations: &'a Observations) -> Result<Self> {
        let n = problem.steps;
        let mut covariance = Triangle::zeros(n);
        for s in 0..n {
            for t in 0..=s {
                let scatter = if problem.is_measured { problem.scatter_covariance(s, t) } else { 0.0 };
                let noise = problem.noise * problem.noise * problem.phi.powi((s - t) as i32);
                covariance.row_mut(s)[t] = scatter + if s == t || problem.phi > 0.0 { noise } else { 0.0 };
            }
        }
        Ok(Self { problem, observations, covariance: Cholesky::new(&covariance)? })
    }
}

impl Density for Exact<'_> {
    fn ln_prior(&self, x: &[f64]) -> f64 {
        if x.iter().all(|x| (0.0..=1.0).contains(x)) { 0.0 } else { f64::NEG_INFINITY }
    }

    fn ln_likelihood(&self, x: &[f64]) -> f64 {
        let mut square = 0.0;
        for (seen, curve) in self.observations.values.iter().zip(self.problem.mean(x)) {
            let mut residual: Vec<f64> = seen.iter().zip(&curve).map(|(seen, y)| seen - y).collect();
            self.covariance.solve_lower(&mut residual);
            square += residual.iter().map(|r| r * r).sum::<f64>();
        }
        let readings = (self.problem.steps * self.problem.observables) as f64;
        // Of unknown size: marginalised under a Jeffreys prior.
        if self.problem.is_told { -0.5 * square } else { -0.5 * readings * square.ln() }
    }
}

/// Draws of the posterior, shape (draws, parameters).
///
/// # Errors
/// If the covariance has no factor.
pub fn posterior(problem: &Problem, observations: &Observations, seed: u64) -> Result<Vec<Vec<f64>>> {
    let start = points(Method::Halton, 3000, problem.parameters, Some(seed))?;
    let effort = Effort { moves: 2.5, last_moves: 8.0, sweeps: 12, seed };
    Ok(sample(&Exact::new(problem, observations)?, None, start, effort)?.points)
}
