//! Whether a candidate can show at all.

use std::ops::Range;

use anyhow::Result;
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::attribute::attribution::closure::absorb;
use crate::attribute::evidence::mode::standard_normal;
use crate::attribute::evidence::model::{Model, SD_OF_LN_NOISE};
use crate::attribute::problem::Problem;
use crate::noise::least_scale;

/// What a candidate adds to the curve and the base parameters cannot absorb must be so many standard deviations in all, of
/// noise, scatter and what the emulator does not know: at a few places of its prior, or so many more at one. Of a parameter
/// that does nothing an emulator makes something, too, by chance.
const SEEN: f64 = 2.0;
const SEEN_AT_ONE: f64 = 3.0;
const FEW: usize = 3;

/// Points of the prior that are tried.
const TRIED: usize = 40;

/// For each candidate whether there is a place in its prior at which the measurement could show it. What
/// cannot be seen is no candidate: it would take a share of the prior from those that can.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn visible(problem: &Problem<'_>, seed: u64) -> Result<Vec<bool>> {
    let base = problem.prior.base().len();
    // A measured noise may be half of the one that is stated, or what the readings show, an unknown one a hundredth of the range.
    let scale = |own: Range<usize>| {
        if !problem.is_noise_stated {
            return 0.1;
        }
        let shown = least_scale(&problem.observed[own.clone()], &problem.units[own]);
        shown.min(0.5).ln() / SD_OF_LN_NOISE
    };
    let scales: Vec<f64> = problem.blocks().into_iter().map(scale).collect();
    let see = |candidate: usize| -> Result<bool> {
        let model = Model::new(problem, &[candidate], false);
        let plain = Model::new(problem, &[], false);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut seen = 0;
        for _ in 0..TRIED {
            let mut w = vec![0.0; model.len()];
            w[..model.curve_parameters()].iter_mut().for_each(|w| *w = standard_normal(&mut random));
            w[model.curve_parameters()..][..scales.len()].copy_from_slice(&scales);
            w[model.curve_parameters() + problem.ranges.len()..].fill(-3.0);
            let mut of_base = w[..base].to_vec();
            of_base.extend(&w[model.curve_parameters()..]);
            let (_, slopes) = plain.gradient(&of_base);
            let mut added = DMatrix::from_vec(problem.observed.len(), 1, model.added(&w));
            absorb(&plain, &of_base, &slopes, &mut added)?;
            let (on, off) = (model.curve(&w).variance, plain.curve(&of_base).variance);
            let unknown: Vec<f64> = on.iter().zip(&off).map(|(on, off)| on + off).collect();
            let solved = plain.with_covariance(&of_base, &unknown, |covariance| covariance.solve(&added))?;
            let size = added.dot(&solved).sqrt();
            seen += usize::from(size > SEEN);
            if size > SEEN_AT_ONE || seen >= FEW {
                return Ok(true);
            }
        }
        Ok(false)
    };
    (0..problem.candidates.len()).map(see).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::attribute::synthetic_world::Straight;

    #[test]
    fn what_an_emulator_makes_of_a_parameter_is_seen_only_where_it_is_sure_of_it() {
        let seen = |predictor: Straight| {
            let (prior, observations) = (Straight::prior(), Straight::measured(1.3, 0.6, 0.0, 0.01));
            visible(&predictor.problem(&prior, &observations), 1).unwrap()
        };
        // The wave has an amplitude of 1; an offset is what `a` does, too.
        assert_eq!(seen(Straight::new()), [true, false]);
        assert!(seen(Straight::unsure(1e-3))[0] && !seen(Straight::unsure(4.0))[0]);
    }
}
