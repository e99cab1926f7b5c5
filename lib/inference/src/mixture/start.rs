//! Where a fit begins.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// The nearest of weighted k-means centres to each sample, shape (n,).
///
/// # Source
/// Arthur & Vassilvitskii (2007), SODA, 1027.
pub(super) fn nearest_centres(
    samples: &[Vec<f64>],
    weights: &[f64],
    count: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<usize> {
    let mut centres = vec![samples[draw(weights, rng)].clone()];
    let mut distances = vec![f64::INFINITY; samples.len()];
    while let Some(last) = centres.last().filter(|_| centres.len() < count) {
        for (distance, x) in distances.iter_mut().zip(samples) {
            *distance = squared(x, last).min(*distance);
        }
        let chances: Vec<f64> = distances.iter().zip(weights).map(|(d, w)| d * w).collect();
        centres.push(samples[draw(&chances, rng)].clone());
    }
    let mut nearest = vec![0; samples.len()];
    for _ in 0..10 {
        let mut sums = vec![vec![0.0; samples[0].len()]; count];
        let mut totals = vec![0.0; count];
        for ((place, x), weight) in nearest.iter_mut().zip(samples).zip(weights) {
            *place = closest(&centres, x);
            totals[*place] += weight;
            sums[*place].iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
        }
        for ((centre, sum), total) in centres.iter_mut().zip(sums).zip(totals).filter(|(_, t)| *t > 0.0) {
            *centre = sum.iter().map(|sum| sum / total).collect();
        }
    }
    nearest
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn closest(centres: &[Vec<f64>], x: &[f64]) -> usize {
    let mut best = (0, f64::INFINITY);
    for (k, centre) in centres.iter().enumerate() {
        let distance = squared(x, centre);
        if distance < best.1 {
            best = (k, distance);
        }
    }
    best.0
}

/// A place drawn by its chance.
fn draw(chances: &[f64], rng: &mut ChaCha8Rng) -> usize {
    let mut left = rng.random::<f64>() * chances.iter().sum::<f64>();
    let chosen = chances.iter().position(|chance| {
        left -= chance;
        left < 0.0
    });
    chosen.unwrap_or(0)
}
