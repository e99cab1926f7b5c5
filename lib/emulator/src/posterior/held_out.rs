//! Each reading predicted by the posterior without it.

use anyhow::{Context, Result};
use gl_inference::loo::{Given, LeftOut, leave_out};
use rayon::prelude::*;

use super::Inference;
use super::likelihood::Likelihood;

impl Inference {
    /// Whether the draws count with a noise that is larger than stated, or correlated.
    pub fn is_noise_restated(&self) -> bool {
        self.nuisances.inflation || self.nuisances.correlation.contains(&true)
    }

    /// What the posterior without each reading says of it, shape (observables · steps); see [`gl_inference::loo`].
    ///
    /// # Errors
    /// If the covariance of the readings has no factor at a draw.
    pub fn held_out(&self) -> Result<Vec<LeftOut>> {
        let likelihood =
            Likelihood::new(&self.surrogate, &self.space, &self.measured, self.nuisances.clone());
        let of_draws: Option<Vec<Vec<Given>>> =
            self.points.par_iter().map(|x| likelihood.held_out(x)).collect();
        let of_draws =
            of_draws.context("the covariance of the readings has no factor at one of the draws")?;
        let of = |o: usize| {
            let given: Vec<Given> = of_draws.iter().map(|readings| readings[o]).collect();
            leave_out(self.measured.readings[o], &given)
        };
        (0..self.measured.readings.len()).into_par_iter().map(of).collect()
    }
}
