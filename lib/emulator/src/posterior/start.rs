//! What a posterior is sampled from, where something near it is known.

use gl_numeric::statistics::ln_sum_exp;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::mixture::LocalMixture;

/// Share of the prior.
const PRIOR_SHARE: f64 = 0.1;

/// Mixtures with a share of the prior.
pub struct Start {
    /// The mixtures, each with the same share.
    pub mixtures: Vec<LocalMixture>,
    /// Number of coordinates, the first ones, that they are over; the prior of those behind them is even.
    pub dimensions: usize,
}

impl Start {
    /// Make draws of the prior, shape (draws, dimensions), draws of this; the share of all draws that lay in the cube, which is
    /// the integral of [`Start::ln_density`] over it.
    pub fn replace(&self, points: &mut [Vec<f64>], generator: &mut ChaCha8Rng) -> f64 {
        let mut drawn = 0.0;
        for point in points.iter_mut() {
            // Both shares are drawn again where the mixture falls outside the cube.
            let near = loop {
                drawn += 1.0;
                if generator.random_bool(PRIOR_SHARE) {
                    break None;
                }
                let near = self.mixtures[generator.random_range(0..self.mixtures.len())].draw(generator);
                if near.iter().all(|x| (0.0..=1.0).contains(x)) {
                    break Some(near);
                }
            };
            if let Some(near) = near {
                point[..self.dimensions].copy_from_slice(&near);
            }
        }
        points.len() as f64 / drawn
    }

    /// ln of the density at a point, where that of the prior is known; −∞ outside the cube.
    pub fn ln_density(&self, x: &[f64], ln_prior: f64) -> f64 {
        if ln_prior == f64::NEG_INFINITY {
            return ln_prior;
        }
        let near: Vec<f64> =
            self.mixtures.iter().map(|mixture| mixture.ln_density(&x[..self.dimensions])).collect();
        let near = ln_sum_exp(&near) - (near.len() as f64).ln();
        ln_sum_exp(&[PRIOR_SHARE.ln() + ln_prior, (1.0 - PRIOR_SHARE).ln() + near])
    }
}
