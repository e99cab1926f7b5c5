//! Sequential Monte Carlo weights of the runs, and the σ that goes with them.
//!
//! ln wᵢ = −ln qᵢ − Mᵢ/(2σ): Mᵢ is the misfit of run i summed over the steps, qᵢ the density that
//! proposed its sample, relative to the prior. Because σ only scales the misfit, the weights at every
//! σ follow from the sums.

use anyhow::{Result, ensure};
use rayon::prelude::*;

use gl_numeric::statistics::{ln_sum_exp, normalised};

/// What the weights are made from.
#[derive(Clone, Debug, PartialEq)]
pub struct Runs {
    /// Summed misfit Mᵢ of each run, shape (runs,), not negative.
    pub misfit: Vec<f64>,
    /// ln qᵢ of each run, shape (runs,); 0 for samples from the prior.
    pub ln_proposal: Vec<f64>,
}

/// What sets the weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// This σ.
    Sigma(f64),
    /// The σ of this effective sample size, as a fraction of the runs.
    Ess(f64),
    /// The noise: the one given, or the one estimated with the fit.
    Noise,
}

/// Weights of the runs and the σ that they belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct Weighting {
    /// Natural logarithms of the weights, shape (runs,), not normalised.
    pub ln_weight: Vec<f64>,
    /// Their σ.
    pub sigma: f64,
    /// ln of the mean weight, the evidence up to the normalisation of the likelihood.
    pub ln_evidence: f64,
    /// Whether σ is the noise, so that the weights are the posterior itself.
    pub is_noise: bool,
}

impl Weighting {
    /// Weights that sum to one, shape (runs,).
    ///
    /// # Errors
    /// If they are no weights; see [`normalised`].
    pub fn weights(&self) -> Result<Vec<f64>> {
        normalised(&self.ln_weight)
    }
}

impl Runs {
    /// Check the misfits of at least one run.
    ///
    /// # Errors
    /// If there is no run.
    pub fn new(misfit: Vec<f64>, ln_proposal: Vec<f64>) -> Result<Self> {
        ensure!(!misfit.is_empty(), "no runs to weigh");
        Ok(Self { misfit, ln_proposal })
    }

    fn ln_weights(&self, sigma: f64) -> Vec<f64> {
        self.tempered(|misfit| misfit / (2.0 * sigma))
    }

    /// ln weights with a penalty for the misfit above the smallest one, which keeps the numbers small.
    fn tempered(&self, penalty: impl Fn(f64) -> f64) -> Vec<f64> {
        let best = self.best_misfit();
        self.misfit.iter().zip(&self.ln_proposal).map(|(m, q)| -q - penalty(m - best)).collect()
    }

    /// The smallest misfit.
    pub fn best_misfit(&self) -> f64 {
        self.misfit.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Weights at a given σ.
    ///
    /// # Errors
    /// If σ is not positive, or nothing has weight.
    pub fn at_sigma(&self, sigma: f64) -> Result<Weighting> {
        ensure!(sigma > 0.0 && sigma.is_finite(), "sigma {sigma} is not positive");
        let ln_weight = self.ln_weights(sigma);
        let ln_evidence = ln_mean(&ln_weight) - self.best_misfit() / (2.0 * sigma);
        Ok(Weighting { ln_weight, sigma, ln_evidence, is_noise: false })
    }

    /// The σ at which the effective sample size is `target`, as a fraction of the runs, found in ln σ
    /// to the resolution of `f64`.
    ///
    /// Without proposals the effective sample size grows with σ; with them it may have a maximum and
    /// fall off again, and the σ below the maximum is meant. Where it never reaches the target, the σ
    /// of the maximum is given.
    ///
    /// # Errors
    /// If the target is not in (0, 1), or all runs or too many of the best have the same misfit.
    pub fn sigma_of_ess(&self, target: f64) -> Result<f64> {
        ensure!(target > 0.0 && target < 1.0, "--ess {target} is not between 0 and 1");
        ensure!(
            target * self.misfit.len() as f64 > 1.0 || self.misfit.len() == 1,
            "--ess {target} of {} runs is less than one run; make it larger than {}",
            self.misfit.len(),
            1.0 / self.misfit.len() as f64
        );
        let best = self.best_misfit();
        let excess = || self.misfit.iter().map(|m| m - best).filter(|excess| *excess > 0.0);
        let (least, most) =
            excess().fold((f64::INFINITY, 0.0), |(low, high), m| (f64::min(low, m), f64::max(high, m)));
        ensure!(
            self.misfit.len() > 1,
            "one run alone, and nothing to weigh it against; --sigma weighs it all the same"
        );
        ensure!(
            most > 0.0,
            "all {} runs have the same misfit, so no sigma weighs them differently; \
             do the parameters change the observables?",
            self.misfit.len()
        );
        let short_of = |ln_sigma: f64| self.ess(best, ln_sigma.exp()).map(|ess| target - ess);
        // Below `low` only the best have weight, above `high` the misfit makes no difference.
        let (low, high) = ((least / 1e3).ln(), most.ln() + 1e12_f64.ln());
        let at_low = short_of(low)?;
        ensure!(
            at_low >= 0.0,
            "--ess {target} cannot be reached: the best runs have the same misfit, and they alone are {}",
            target - at_low
        );
        let (mut below, mut at_best) = ((low, at_low), (low, at_low));
        loop {
            let above = (below.0 + 1.0).min(high);
            let here = short_of(above)?;
            if here <= 0.0 {
                return Ok(crossing(below, (above, here), short_of)?.exp());
            }
            if here < at_best.1 {
                at_best = (above, here);
            }
            below = (above, here);
            if above >= high {
                return Ok(at_best.0.exp());
            }
        }
    }

    /// Effective sample size at a σ, as a fraction of the runs, in (0, 1]; see [`ess_fraction`].
    ///
    /// * `best` — the smallest misfit.
    fn ess(&self, best: f64, sigma: f64) -> Result<f64> {
        let parts: Vec<(f64, f64, f64)> = self
            .misfit
            .par_chunks(RUNS_A_PIECE)
            .zip(self.ln_proposal.par_chunks(RUNS_A_PIECE))
            .map(|(misfit, ln_proposal)| {
                let ln_weight =
                    || misfit.iter().zip(ln_proposal).map(|(m, q)| -q - (m - best) / (2.0 * sigma));
                let high = ln_weight().fold(f64::NEG_INFINITY, f64::max);
                let (mut sum, mut squares) = (0.0, 0.0);
                for weight in ln_weight().map(|ln_weight| (ln_weight - high).exp()) {
                    sum += weight;
                    squares += weight * weight;
                }
                (high, sum, squares)
            })
            .collect();
        let high = parts.iter().map(|part| part.0).fold(f64::NEG_INFINITY, f64::max);
        let (mut sum, mut squares) = (0.0, 0.0);
        for (part, part_sum, part_squares) in parts.iter().filter(|part| part.0 > f64::NEG_INFINITY) {
            let scale = (part - high).exp();
            sum += scale * part_sum;
            squares += scale * scale * part_squares;
        }
        ensure!(sum > 0.0 && sum.is_finite(), "a weight is NaN or infinite, or every weight is zero");
        Ok(sum * sum / (squares * self.misfit.len() as f64))
    }

    /// The posterior under noise of unknown size, σ marginalised under a Jeffreys prior:
    /// ln wᵢ = −ln qᵢ − (n/2) ln Mᵢ with `readings` n. Its σ is the posterior mean of M over n.
    ///
    /// # Errors
    /// If nothing has weight.
    ///
    /// # Source
    /// Gelman et al. (2013), Bayesian Data Analysis, §3.2.
    pub fn at_unknown_noise(&self, readings: f64) -> Result<Weighting> {
        // A run that fits exactly would have an infinite weight, and the others none.
        let most = self.misfit.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let floor = |m: f64| m.max(most * 1e-24);
        let best = floor(self.best_misfit());
        let ln_weight: Vec<f64> = self
            .misfit
            .iter()
            .zip(&self.ln_proposal)
            .map(|(m, q)| -q - 0.5 * readings * (floor(*m) / best).ln())
            .collect();
        let weights = normalised(&ln_weight)?;
        let sigma = weights.iter().zip(&self.misfit).map(|(w, m)| w * floor(*m)).sum::<f64>() / readings;
        let ln_evidence = ln_mean(&ln_weight) - 0.5 * readings * best.ln();
        Ok(Weighting { ln_weight, sigma, ln_evidence, is_noise: true })
    }
}

/// Runs whose weights are summed on end; the sums do not depend on the number of threads.
const RUNS_A_PIECE: usize = 1 << 14;

/// Where a function falls to zero or below, to the resolution of `f64`: the least x at which it has,
/// between a point `below` at which it is positive and a point `above` at which it is not.
///
/// The Illinois form of false position, with a bisection after every third step, so that it is never
/// much slower than bisection alone.
///
/// # Source
/// Dowell & Jarratt (1971), BIT 11:168.
fn crossing(
    mut below: (f64, f64),
    mut above: (f64, f64),
    function: impl Fn(f64) -> Result<f64>,
) -> Result<f64> {
    let mut side = 0;
    for step in 0_u32.. {
        let middle = 0.5 * (below.0 + above.0);
        if middle <= below.0 || middle >= above.0 {
            break;
        }
        let secant = below.0 + (above.0 - below.0) * below.1 / (below.1 - above.1);
        let use_secant = step % 4 != 3 && below.0 < secant && secant < above.0;
        let x = if use_secant { secant } else { middle };
        let value = function(x)?;
        if value > 0.0 {
            below = (x, value);
            above.1 *= if side == -1 { 0.5 } else { 1.0 };
            side = -1;
        } else {
            above = (x, value);
            below.1 *= if side == 1 { 0.5 } else { 1.0 };
            side = 1;
        }
    }
    Ok(above.0)
}

/// What is known of the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoiseModel {
    /// The misfits are measured against it: σ = 1 is the posterior.
    Known,
    /// It is estimated from this many independent readings.
    Estimated {
        /// Number of independent readings.
        readings: f64,
    },
}

impl NoiseModel {
    /// The noise behind misfits whose best run holds `readings` independent readings (0 where the
    /// noise is known), when `parameters` vary.
    pub fn new(readings: f64, parameters: usize) -> Self {
        if readings == 0.0 {
            return Self::Known;
        }
        // With fewer readings than this the marginal posterior is no distribution.
        Self::Estimated { readings: readings.max(parameters as f64 + 1.0) }
    }

    /// The posterior under this noise.
    ///
    /// # Errors
    /// If nothing has weight.
    pub fn posterior(self, runs: &Runs) -> Result<Weighting> {
        match self {
            Self::Known => Ok(Weighting { is_noise: true, ..runs.at_sigma(1.0)? }),
            Self::Estimated { readings } => runs.at_unknown_noise(readings),
        }
    }

    /// The noise with only a share of the readings, as for the first steps.
    pub fn share(self, share: f64) -> Self {
        match self {
            Self::Known => Self::Known,
            Self::Estimated { readings } => Self::Estimated { readings: readings * share },
        }
    }
}

/// Weigh the runs: by `target`, but never at a σ below `floor`.
///
/// # Errors
/// See [`Runs::sigma_of_ess`] and [`Runs::at_sigma`].
pub fn weigh(runs: &Runs, target: Target, floor: Option<Target>, noise: NoiseModel) -> Result<Weighting> {
    let weighting = match target {
        Target::Noise => return noise.posterior(runs),
        Target::Sigma(sigma) => runs.at_sigma(sigma)?,
        Target::Ess(ess) => runs.at_sigma(runs.sigma_of_ess(ess)?)?,
    };
    let lowest = match floor {
        None => return Ok(weighting),
        Some(Target::Sigma(sigma)) => runs.at_sigma(sigma)?,
        Some(Target::Ess(ess)) => runs.at_sigma(runs.sigma_of_ess(ess)?)?,
        Some(Target::Noise) => noise.posterior(runs)?,
    };
    Ok(if weighting.sigma > lowest.sigma { weighting } else { lowest })
}

/// Weigh emulated runs: by `target`, but never at a σ below that at which what the emulator does not know
/// could be told from the noise.
///
/// The errors of an emulator at all readings of a run may be one and the same error. As independent ones
/// they would be known too well by the number of readings, and weights would follow a trend that only
/// the emulator sees. So σ stays above 1 + E[Σ v/(N + v)], with the variances v of the emulator and N of
/// the noise, and the sum over the readings.
///
/// * `ignorance` — Σ v/(N + v) of each run, shape (runs,).
///
/// # Errors
/// See [`weigh`].
pub fn weigh_emulated(runs: &Runs, target: Target, ignorance: &[f64]) -> Result<Weighting> {
    let mut floor = 1.0;
    let mut weighting = weigh(runs, target, Some(Target::Sigma(floor)), NoiseModel::Known)?;
    // The floor depends on which runs hold the weight; it settles at once, or moves up.
    for _ in 0..3 {
        let weights = weighting.weights()?;
        floor = f64::max(floor, 1.0 + gl_numeric::statistics::mean(ignorance, &weights));
        weighting = weigh(runs, target, Some(Target::Sigma(floor)), NoiseModel::Known)?;
    }
    Ok(weighting)
}

fn ln_mean(ln_weight: &[f64]) -> f64 {
    ln_sum_exp(ln_weight) - (ln_weight.len() as f64).ln()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use gl_numeric::statistics::ess_fraction;

    fn prior_runs(misfit: Vec<f64>) -> Runs {
        let n = misfit.len();
        Runs::new(misfit, vec![0.0; n]).unwrap()
    }

    fn ess_at(runs: &Runs, sigma: f64) -> f64 {
        ess_fraction(&runs.ln_weights(sigma)).unwrap()
    }

    #[test]
    fn two_runs_have_the_sigma_of_the_closed_form() {
        // Weights 1 and x = exp(−Δ/2σ): ess = (1 + x)² / 2(1 + x²); x = 1/2 gives 0.9.
        let sigma = prior_runs(vec![3.0, 5.0]).sigma_of_ess(0.9).unwrap();
        assert!((sigma - 1.0 / 2f64.ln()).abs() < 1e-14, "{sigma}");
    }

    #[test]
    fn runs_alike_or_tied_at_the_best_are_an_error() {
        assert!(prior_runs(vec![2.0; 9]).sigma_of_ess(0.3).unwrap_err().to_string().contains("same misfit"));
        let tied = prior_runs([vec![1.0; 5], vec![2.0; 5]].concat());
        assert!(tied.sigma_of_ess(0.3).unwrap_err().to_string().contains("cannot be reached"));
    }

    #[test]
    fn a_target_beyond_the_most_effective_sigma_gives_that_sigma() {
        let runs = Runs::new(vec![1.0, 2.0, 3.0, 4.0], vec![3.0, 1.0, 0.0, -1.0]).unwrap();
        let sigma = runs.sigma_of_ess(0.999).unwrap();
        assert!(ess_at(&runs, sigma) < 0.999);
        assert!(ess_at(&runs, sigma) >= ess_at(&runs, sigma * 3.0).max(ess_at(&runs, sigma / 3.0)));
    }

    #[test]
    fn a_sigma_floor_holds() {
        let runs = prior_runs((0..50).map(f64::from).collect());
        let free = weigh(&runs, Target::Ess(0.1), None, NoiseModel::Known).unwrap();
        assert!(free.sigma > 1.0);
        let high = weigh(&runs, Target::Ess(0.1), Some(Target::Sigma(40.0)), NoiseModel::Known).unwrap();
        assert_eq!(high.sigma, 40.0);
        let noise = weigh(&runs, Target::Ess(0.03), Some(Target::Noise), NoiseModel::Known).unwrap();
        assert_eq!((noise.sigma, noise.is_noise), (1.0, true));
    }

    #[test]
    fn ignorance_of_an_emulator_is_a_floor_of_sigma() {
        let runs = prior_runs((0..50).map(f64::from).collect());
        let free = weigh_emulated(&runs, Target::Ess(0.04), &[0.0; 50]).unwrap();
        assert_eq!(free.sigma, 1.0);
        // Thirty readings whose variance is the emulator's by half.
        let held = weigh_emulated(&runs, Target::Ess(0.04), &[15.0; 50]).unwrap();
        assert_eq!(held.sigma, 16.0);
        let above = weigh_emulated(&runs, Target::Ess(0.9), &[15.0; 50]).unwrap();
        assert!(above.sigma > 16.0);
    }

    proptest! {
        #[test]
        fn the_ess_target_is_met_for_any_size_of_misfit(
            shape in prop::collection::vec(0.0..1.0f64, 20..80),
            ln_size in -20.0..20.0f64,
            target in 0.1..0.9f64,
        ) {
            let runs = prior_runs(shape.iter().map(|x| x * ln_size.exp()).collect());
            let sigma = runs.sigma_of_ess(target).unwrap();
            prop_assert!((ess_at(&runs, sigma) - target).abs() < 1e-9);
        }
    }
}
