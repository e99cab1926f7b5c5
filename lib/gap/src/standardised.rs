//! The gap of each reading in units of how uncertain it is.

use anyhow::Result;

use super::noise::{Noise, check_steps, scale};
use super::residual::gap;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::predict::predict;

/// Measurement minus posterior mean over the standard deviation of noise and prediction together,
/// shape (observables, steps). Where the model is right, nine in ten lie between ±1.64.
///
/// * `weights` — shape (runs,), summing to one.
/// * `noise_sd` — shape (observables, steps), where it is known; else it is estimated from how the gap
///   changes from step to step.
///
/// # Errors
/// If the ensemble has no runs or other steps than the measurement, or there are too few steps to
/// estimate the noise.
pub fn standardised(
    observations: &Observations,
    ensemble: &Ensemble,
    weights: &[f64],
    noise_sd: Option<&[Vec<f64>]>,
) -> Result<Vec<Vec<f64>>> {
    let gap = gap(observations, ensemble, weights)?;
    check_steps(observations, noise_sd)?;
    let scales: Vec<f64> = observations.values.iter().map(|values| scale(values)).collect();
    let noises = Noise::estimate(&gap, noise_sd, &scales);
    let prediction = predict(ensemble, weights)?;
    let of_observable =
        |((gap, noise), prediction): ((&Vec<f64>, &Noise), &Vec<gl_inference::predict::Moments>)| {
            let sds = noise.sd.iter().zip(prediction).map(|(noise, moments)| noise.hypot(moments.sd));
            gap.iter().zip(sds).map(|(gap, sd)| gap / sd).collect()
        };
    Ok(gap.iter().zip(&noises).zip(&prediction).map(of_observable).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gl_table::Table;

    #[test]
    fn a_gap_is_measured_by_noise_and_spread_together() {
        let table = Table::parse("obs", b"e q\n0 5\n1 2\n".to_vec()).unwrap();
        let observations = Observations::from_table(&table, "e", &["q".to_owned()]).unwrap();
        let rows = b"sample step e q\na 0 0 -4\na 1 1 2\nb 0 0 4\nb 1 1 2\n";
        let ensemble = Ensemble::parse("runs", rows, "e", &["q".to_owned()]).unwrap();
        // Mean 0, sd 4 at the first step: 5 / √(3² + 4²) = 1.
        let noise = vec![vec![3.0, 3.0]];
        let found = standardised(&observations, &ensemble, &[0.5, 0.5], Some(&noise)).unwrap();
        assert_eq!(found, [[1.0, 0.0]]);
        assert!(standardised(&observations, &ensemble, &[0.5, 0.5], None).is_err());
    }
}
