//! Smooth densities of weighted samples on a bounded range, for pictures.

use crate::statistics::{Quantiles, effective_size, sd};

/// The narrowest kernel, as a share of the range: a single sample is a peak that can still be seen.
const NARROWEST: f64 = 0.006;

/// Density of weighted samples on the range 0 to 1, at the middles of `cells` equal cells; it
/// integrates to one.
///
/// * `places` — shape (samples,), in [0, 1].
/// * `weights` — shape (samples,), summing to one.
///
/// Gaussian kernels of Silverman's width 0.9 min(sd, IQR/1.34) n^(−1/5) with n the effective number of
/// samples 1/Σw². What a kernel puts beyond an end of the range is reflected back into it, so that a
/// density that leans on a bound does not seem to fall off there.
///
/// # Source
/// Silverman (1986), Density Estimation, §2.10 and §3.4.2.
pub fn marginal(places: &[f64], weights: &[f64], cells: usize) -> Vec<f64> {
    let width = bandwidth(places, weights, 0.9, 1.0 / 5.0);
    let kernels = kernels(places, weights, width, cells);
    let mut density = vec![0.0; cells];
    for (weight, kernel) in kernels {
        for (cell, share) in kernel {
            density[cell] += weight * share * cells as f64;
        }
    }
    density
}

/// Density of pairs on the unit square, at the middles of `cells` × `cells` equal cells, row by row of
/// `y`; it integrates to one. See [`marginal`]; the widths are Scott's, sd n^(−1/6).
///
/// # Source
/// Scott (1992), Multivariate Density Estimation, §6.3.
pub fn joint(x: &[f64], y: &[f64], weights: &[f64], cells: usize) -> Vec<f64> {
    let across = kernels(x, weights, bandwidth(x, weights, 1.0, 1.0 / 6.0), cells);
    let up = kernels(y, weights, bandwidth(y, weights, 1.0, 1.0 / 6.0), cells);
    let mut density = vec![0.0; cells * cells];
    for ((weight, kernel_x), (_, kernel_y)) in across.into_iter().zip(up) {
        for &(row, share_y) in &kernel_y {
            for &(column, share_x) in &kernel_x {
                density[row * cells + column] += weight * share_x * share_y * (cells * cells) as f64;
            }
        }
    }
    density
}

/// The heights above which a density holds each of `shares` of its probability.
///
/// * `density` — in cells of equal size; its sum is taken as one.
pub fn levels(density: &[f64], shares: &[f64]) -> Vec<f64> {
    let mut heights = density.to_vec();
    heights.sort_by(|a, b| b.total_cmp(a));
    let total: f64 = heights.iter().sum();
    let level = |share: &f64| {
        let mut held = 0.0;
        heights
            .iter()
            .copied()
            .find(|height| {
                held += height;
                held >= share * total
            })
            .unwrap_or(0.0)
    };
    shares.iter().map(level).collect()
}

fn bandwidth(places: &[f64], weights: &[f64], factor: f64, power: f64) -> f64 {
    let quantiles = Quantiles::new(places, weights);
    let middle_half = (quantiles.at(0.75) - quantiles.at(0.25)) / 1.34;
    let spread = sd(places, weights);
    let spread = if middle_half > 0.0 { spread.min(middle_half) } else { spread };
    let effective = effective_size(weights);
    (factor * spread * effective.powf(-power)).max(NARROWEST)
}

/// For each sample with a weight that can be seen, that weight and the share of its kernel in every
/// cell, which sum to one.
fn kernels(places: &[f64], weights: &[f64], width: f64, cells: usize) -> Vec<(f64, Vec<(usize, f64)>)> {
    const REACH: f64 = 4.0;
    let kernel = |place: f64| {
        let reach = (REACH * width * cells as f64).ceil() as i64;
        let centre = (place * cells as f64).floor() as i64;
        let last = cells as i64 - 1;
        let mut shares = vec![0.0; cells];
        for cell in centre - reach..=centre + reach {
            let distance = ((cell as f64 + 0.5) / cells as f64 - place) / width;
            // Mirrored at both ends, as often as it takes.
            let period = cell.rem_euclid(2 * cells as i64);
            let inside = if period > last { 2 * cells as i64 - 1 - period } else { period };
            shares[inside as usize] += (-0.5 * distance * distance).exp();
        }
        let sum: f64 = shares.iter().sum();
        shares
            .into_iter()
            .enumerate()
            .filter(|&(_, share)| share > 0.0)
            .map(|(cell, share)| (cell, share / sum))
            .collect()
    };
    let invisible = 1e-6 * weights.iter().copied().fold(0.0, f64::max);
    places.iter().zip(weights).filter(|&(_, &w)| w > invisible).map(|(&x, &w)| (w, kernel(x))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_density_integrates_to_one_even_at_a_bound() {
        for places in [vec![0.0, 0.01, 0.02], vec![0.5], vec![0.2, 0.9, 1.0, 1.0]] {
            let weights = vec![1.0 / places.len() as f64; places.len()];
            let sum: f64 = marginal(&places, &weights, 100).iter().sum::<f64>() / 100.0;
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
            let sum: f64 = joint(&places, &places, &weights, 40).iter().sum::<f64>() / 1600.0;
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        }
    }

    #[test]
    fn evenly_spread_samples_have_an_even_density_up_to_the_bounds() {
        let places: Vec<f64> = (0..1000).map(|i| (f64::from(i) + 0.5) / 1000.0).collect();
        let density = marginal(&places, &[1e-3; 1000], 50);
        assert!(density.iter().all(|height| (height - 1.0).abs() < 0.01), "{density:?}");
    }

    #[test]
    fn a_normal_density_is_found_again() {
        // Quantiles of a normal distribution with mean 0.5 and sd 0.1, whose density peaks at 3.989;
        // the kernel widens it to √(0.1² + h²), h = 0.9 · 0.1 · 2000^(−1/5).
        let n = 2000;
        let places: Vec<f64> = (0..n)
            .map(|i| 0.5 + 0.1 * crate::normal::normal_quantile((f64::from(i) + 0.5) / f64::from(n)))
            .collect();
        let density = marginal(&places, &vec![1.0 / f64::from(n); n as usize], 201);
        let width = 0.09 * f64::from(n).powf(-0.2);
        let expected = 1.0 / (std::f64::consts::TAU * (0.01 + width * width)).sqrt();
        assert!((density[100] - expected).abs() < 0.01 * expected, "{} {expected}", density[100]);
    }

    #[test]
    fn the_highest_cells_hold_their_share() {
        assert_eq!(levels(&[4.0, 3.0, 2.0, 1.0], &[0.4, 0.7, 0.95]), [4.0, 3.0, 1.0]);
    }
}
