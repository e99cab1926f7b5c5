//! What is left of a measurement once the posterior mean is taken from it, and how far the posterior
//! could have moved that.

use std::f64::consts::PI;

use anyhow::{Result, ensure};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_numeric::statistics::{effective_size, mean};

/// How far the truth may lie from the posterior mean, as a covariance of all readings.
#[derive(Clone, Debug)]
pub struct Spread {
    /// Directions, each of shape (observables · steps), whose outer products sum to the covariance.
    pub directions: Vec<Vec<f64>>,
    /// Variance of every reading that the directions leave out, shape (observables · steps).
    pub rest: Vec<f64>,
}

/// Most runs that the posterior covariance is computed from; more are thinned systematically.
const MOST_RUNS: usize = 300;

/// Most directions that are kept as such.
const MOST_DIRECTIONS: usize = 20;

/// Directions with less than this, in units of the noise variance and summed over all readings, say
/// nothing.
const NEGLIGIBLE: f64 = 1e-3;

/// Measurement minus posterior mean, shape (observables, steps). Of a reading that is far off no gap is made: it is taken to
/// miss by what its neighbours do.
///
/// # Errors
/// If the ensemble has no runs, or other steps than the measurement.
pub fn gap(observations: &Observations, ensemble: &Ensemble, weights: &[f64]) -> Result<Vec<Vec<f64>>> {
    ensure!(!ensemble.is_empty(), "{}: no runs to compare with the measurement", ensemble.source);
    ensemble.check_steps(observations)?;
    let mut gap = observations.values.clone();
    for (run, &weight) in weights.iter().enumerate().filter(|&(_, &weight)| weight > 0.0) {
        for (j, gap) in gap.iter_mut().enumerate() {
            gap.iter_mut().zip(ensemble.curve(run, j)).for_each(|(gap, y)| *gap -= weight * y);
        }
    }
    gap.iter_mut().zip(&observations.far_off).for_each(|(gap, far_off)| as_neighbours(gap, far_off));
    Ok(gap)
}

/// Make values that are far off, at these ascending places, the mean of the nearest ones to either side that are not.
pub fn as_neighbours(values: &mut [f64], far_off: &[usize]) {
    let is_good = |place: &usize| far_off.binary_search(place).is_err();
    for &place in far_off {
        let before = (0..place).rev().find(is_good);
        let after = (place + 1..values.len()).find(is_good);
        let near: Vec<f64> = before.into_iter().chain(after).map(|place| values[place]).collect();
        values[place] = near.iter().sum::<f64>() / near.len().max(1) as f64;
    }
}

/// The spread of the posterior, with the simulation's scatter and the emulator's ignorance in it.
///
/// * `weights` — shape (runs,), summing to one.
/// * `parameters` — number of calibrated parameters. A posterior that rests on fewer than two runs
///   for each (and two more) has not resolved where its best fit is; it is tempered to that many,
///   so that what another run would have fitted is not taken for a gap.
/// * `noise_sd` — shape (observables, steps), all above zero; what is far below it is left out.
pub fn spread(ensemble: &Ensemble, weights: &[f64], parameters: usize, noise_sd: &[Vec<f64>]) -> Spread {
    let resting_on = effective_size(weights);
    let (runs, shares) = thinned(&tempered(weights, (2 * parameters + 2) as f64));
    let steps = ensemble.steps();
    let n = steps * ensemble.observables.len();
    let noise: Vec<f64> = noise_sd.iter().flatten().copied().collect();

    // In units of the noise, so that its directions can be told from negligible ones; the mean
    // itself rests on a finite number of runs.
    let inflation = 1.0 + 1.0 / resting_on;
    let mut deviations = DMatrix::zeros(n, runs.len());
    for (place, (&run, &share)) in runs.iter().zip(&shares).enumerate() {
        let curves = (0..ensemble.observables.len()).flat_map(|j| ensemble.curve(run, j).iter());
        for (i, y) in curves.enumerate() {
            deviations[(i, place)] = y * (share * inflation).sqrt() / noise[i];
        }
    }
    for mut row in deviations.row_iter_mut() {
        let roots = shares.iter().map(|share| share.sqrt());
        let centre: f64 = row.iter().zip(roots.clone()).map(|(y, root)| y * root).sum();
        row.iter_mut().zip(roots).for_each(|(y, root)| *y -= centre * root);
    }
    let total = deviations.row_iter().map(|row| row.norm_squared());
    let mut rest: Vec<f64> = total.zip(&noise).map(|(total, noise)| total * noise * noise).collect();
    let mut directions: Vec<Vec<f64>> = Vec::new();
    for direction in principal_directions(&deviations) {
        let direction: Vec<f64> = direction.iter().zip(&noise).map(|(x, noise)| x * noise).collect();
        rest.iter_mut().zip(&direction).for_each(|(rest, d)| *rest = (*rest - d * d).max(0.0));
        directions.push(direction);
    }
    directions.extend(ignorance(ensemble, &runs, &shares));
    Spread { directions, rest }
}

/// The largest vectors, largest first, whose outer products make up D Dᵀ.
fn principal_directions(deviations: &DMatrix<f64>) -> Vec<DVector<f64>> {
    // The smaller of the two products has the same eigenvalues.
    let wide = deviations.nrows() <= deviations.ncols();
    let product = if wide { deviations * deviations.transpose() } else { deviations.tr_mul(deviations) };
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(product);
    let mut order: Vec<usize> = (0..eigenvalues.len()).filter(|&k| eigenvalues[k] > NEGLIGIBLE).collect();
    order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
    order.truncate(MOST_DIRECTIONS);
    let direction = |k: usize| {
        let vector = eigenvectors.column(k);
        if wide { vector * eigenvalues[k].sqrt() } else { deviations * vector }
    };
    order.into_iter().map(direction).collect()
}

/// Directions for an emulator's own error: as large as its standard deviations say, and smooth over a
/// quarter of the control axis.
fn ignorance(ensemble: &Ensemble, runs: &[usize], shares: &[f64]) -> Vec<Vec<f64>> {
    const LENGTH: f64 = 0.25;
    let steps = ensemble.steps();
    let amplitudes: Vec<f64> = (0..3)
        .map(|q| (-0.5 * (PI * f64::from(q) * LENGTH).powi(2)).exp() / if q == 0 { 2.0 } else { 1.0 })
        .collect();
    let total: f64 = amplitudes.iter().sum();
    let mut directions = Vec::new();
    for j in 0..ensemble.observables.len() {
        let variance_at = |step: usize| -> Option<f64> {
            let squares: Option<Vec<f64>> =
                runs.iter().map(|&run| Some(ensemble.curve_sd(run, j)?[step].powi(2))).collect();
            Some(mean(&squares?, shares))
        };
        let Some(variance) = (0..steps).map(variance_at).collect::<Option<Vec<f64>>>() else { continue };
        if variance.iter().all(|&variance| variance == 0.0) {
            continue;
        }
        for (q, amplitude) in amplitudes.iter().enumerate() {
            for shift in [0.0, 0.5].iter().take(if q == 0 { 1 } else { 2 }) {
                let mut direction = vec![0.0; steps * ensemble.observables.len()];
                for (step, variance) in variance.iter().enumerate() {
                    let wave = (PI * (q as f64 * step as f64 / steps as f64 - shift)).cos();
                    direction[j * steps + step] = (amplitude / total * variance).sqrt() * wave;
                }
                directions.push(direction);
            }
        }
    }
    directions
}

/// Weights raised to the highest power, at most 1, at which as many runs as `at_least` are effective;
/// equal for all with any weight if there are no more.
pub(super) fn tempered(weights: &[f64], at_least: f64) -> Vec<f64> {
    let high = weights.iter().copied().fold(0.0, f64::max);
    let powered = |power: f64| -> Vec<f64> {
        let raised: Vec<f64> =
            weights.iter().map(|&w| if w > 0.0 { (power * (w / high).ln()).exp() } else { 0.0 }).collect();
        let sum: f64 = raised.iter().sum();
        raised.into_iter().map(|w| w / sum).collect()
    };
    let effective = effective_size;
    if effective(&powered(1.0)) >= at_least {
        return powered(1.0);
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if effective(&powered(middle)) >= at_least { low = middle } else { high = middle }
    }
    powered(low)
}

/// At most [`MOST_RUNS`] runs that stand for all, and their weights.
fn thinned(weights: &[f64]) -> (Vec<usize>, Vec<f64>) {
    let runs: Vec<usize> = (0..weights.len()).filter(|&run| weights[run] > 0.0).collect();
    if runs.len() <= MOST_RUNS {
        let shares = runs.iter().map(|&run| weights[run]).collect();
        return (runs, shares);
    }
    (systematic(weights, MOST_RUNS), vec![1.0 / MOST_RUNS as f64; MOST_RUNS])
}

/// Runs of equal weight in place of weighted ones: each stands in the list as often as its weight says.
pub(super) fn systematic(weights: &[f64], count: usize) -> Vec<usize> {
    let mut list = Vec::with_capacity(count);
    let mut below = 0.0;
    for (run, weight) in weights.iter().enumerate() {
        below += weight * count as f64;
        while list.len() < count && below > list.len() as f64 + 0.5 {
            list.push(run);
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tempering_keeps_as_many_runs_effective_as_asked() {
        let weights = tempered(&[1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0], 3.0);
        let effective = effective_size(&weights);
        assert!((effective - 3.0).abs() < 1e-9, "{effective}");
        assert_eq!(tempered(&[0.5, 0.5, 0.0], 3.0), [0.5, 0.5, 0.0]);
        assert_eq!(tempered(&[0.25; 4], 3.0), [0.25; 4]);
    }

    #[test]
    fn what_is_far_off_misses_by_what_its_neighbours_do() {
        let mut values = [9.0, 1.0, 3.0, 9.0, 9.0, 5.0, 9.0];
        as_neighbours(&mut values, &[0, 3, 4, 6]);
        assert_eq!(values, [1.0, 1.0, 3.0, 4.0, 4.0, 5.0, 5.0]);
        let mut nothing = [9.0];
        as_neighbours(&mut nothing, &[0]);
        assert_eq!(nothing, [0.0]);
    }

    #[test]
    fn the_directions_make_up_the_covariance_of_the_runs() {
        let rows = b"sample step e q\na 0 0 1\na 1 1 5\nb 0 0 3\nb 1 1 4\nc 0 0 2\nc 1 1 0\n";
        let names = ["q".to_owned()];
        let ensemble = Ensemble::parse("runs", rows, "e", &names).unwrap();
        let observations = Observations::from_table(
            &gl_table::Table::parse("obs", b"e q\n0 2\n1 3\n".to_vec()).unwrap(),
            "e",
            &names,
        )
        .unwrap();
        let third = 1.0 / 3.0;
        let gap = gap(&observations, &ensemble, &[third; 3]).unwrap();
        assert!(gap[0].iter().all(|gap| gap.abs() < 1e-12));
        let spread = spread(&ensemble, &[third; 3], 0, &[vec![0.1; 2]]);
        // Deviations (−1, 2), (1, 1), (0, −3), over 3 runs, and 1 + 1/3 for the mean's own spread.
        for (a, b, expected) in [(0, 0, 2.0 / 3.0), (0, 1, -1.0 / 3.0), (1, 1, 14.0 / 3.0)] {
            let found: f64 = spread.directions.iter().map(|d| d[a] * d[b]).sum();
            assert!((found - expected * 4.0 / 3.0).abs() < 1e-9, "{a} {b} {found}");
        }
    }
}
