//! A mixture of normals about some of many points, each with the covariance of the points around it.

use nalgebra::DMatrix;
use rand::Rng;
use rand::distr::Open01;
use rand_chacha::ChaCha8Rng;

use crate::cholesky::{Cholesky, Triangle, dot};
use gl_inference::prior::normal_quantile;
use gl_numeric::statistics::ln_sum_exp;

/// Share of the points that are the neighbours of one.
const NEIGHBOURS: f64 = 0.1;

/// What is lower than the highest of many densities by this (natural logarithm) adds nothing to their sum.
const NOTHING: f64 = 45.0;

/// A mixture with equal weights.
#[derive(Clone, Debug)]
pub struct LocalMixture {
    centres: Vec<Centre>,
    /// Smoothing factor of a normal, on its neighbours' covariance.
    width: f64,
    /// L⁻¹ of the covariance of all points, in whose units points are near or far.
    metric: Triangle,
    /// The centres in these units.
    measured: Vec<Vec<f64>>,
}

#[derive(Clone, Debug)]
struct Centre {
    at: Vec<f64>,
    /// Lower factor of the neighbours' covariance, times the width.
    factor: Triangle,
    /// Its inverse.
    inverse: Triangle,
    ln_norm: f64,
    /// The points around it.
    neighbours: Vec<Vec<f64>>,
}

impl LocalMixture {
    /// A mixture about at most `most` of the points, shape (points, dimensions), as wide as `width` times
    /// what smooths a normal best.
    pub fn new(points: &[Vec<f64>], most: usize, width: f64, generator: &mut ChaCha8Rng) -> Self {
        let (n, d) = (points.len(), points[0].len());
        let metric = inverse_of(&factor_of(&covariance(points.iter(), n)));
        let measure = |x: &[f64]| (0..d).map(|i| dot(&metric.row(i)[..=i], &x[..=i])).collect::<Vec<f64>>();
        let measured: Vec<Vec<f64>> = points.iter().map(|x| measure(x)).collect();
        let near = ((NEIGHBOURS * n as f64) as usize).max(4 * d).max(8).min(n);
        // What smooths a normal best (Silverman 1986, §4.3).
        let count = most.min(n) as f64;
        let bandwidth = (4.0 / ((d as f64 + 2.0) * count)).powf(1.0 / (d as f64 + 4.0));
        let width = width * bandwidth.max(0.5);
        let chosen = rand::seq::index::sample(generator, n, most.min(n)).into_vec();
        let centre = |&i: &usize| {
            let mut order: Vec<(f64, usize)> = measured
                .iter()
                .enumerate()
                .map(|(j, x)| (x.iter().zip(&measured[i]).map(|(a, b)| (a - b) * (a - b)).sum(), j))
                .collect();
            order.select_nth_unstable_by(near - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            order.truncate(near);
            order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let around = || order.iter().map(|&(_, j)| &points[j]);
            let mut factor = factor_of(&covariance(around(), near));
            (0..d).for_each(|i| factor.row_mut(i).iter_mut().for_each(|l| *l *= width));
            let inverse = inverse_of(&factor);
            let ln_norm = (0..d).map(|i| inverse.row(i)[i].ln()).sum();
            let neighbours = around().take(32).cloned().collect();
            Centre { at: points[i].clone(), factor, inverse, ln_norm, neighbours }
        };
        let centres: Vec<Centre> = chosen.iter().map(centre).collect();
        let measured = chosen.iter().map(|&i| measured[i].clone()).collect();
        Self { centres, width, metric, measured }
    }

    /// A draw, which may lie outside the cube.
    pub fn draw(&self, generator: &mut ChaCha8Rng) -> Vec<f64> {
        let centre = &self.centres[generator.random_range(0..self.centres.len())];
        centre.step(&centre.at, 1.0, generator)
    }

    /// ln of the density, over the whole space.
    pub fn ln_density(&self, x: &[f64]) -> f64 {
        let mut away = vec![0.0; x.len()];
        let mut terms: Vec<f64> =
            self.centres.iter().map(|centre| centre.ln_density(&centre.at, x, 1.0, &mut away)).collect();
        let highest = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        terms.retain(|term| *term > highest - NOTHING);
        let constant = 0.5 * x.len() as f64 * std::f64::consts::TAU.ln() + (self.centres.len() as f64).ln();
        ln_sum_exp(&terms) - constant
    }

    /// A step from a point by the covariance of the centre next to it, and ln of the density of the way
    /// back over that of the way there.
    pub fn walk(&self, x: &[f64], generator: &mut ChaCha8Rng) -> (Vec<f64>, f64) {
        let here = &self.centres[self.nearest(x)];
        let scale = 1.7 / (x.len() as f64).sqrt() / self.width;
        let next = here.step(x, scale, generator);
        let there = &self.centres[self.nearest(&next)];
        let mut away = vec![0.0; x.len()];
        let ln_q = there.ln_density(&next, x, scale, &mut away) - here.ln_density(x, &next, scale, &mut away);
        (next, ln_q)
    }

    /// Two points that lie near each other, in either order.
    pub fn neighbours(&self, generator: &mut ChaCha8Rng) -> (&[f64], &[f64]) {
        let neighbours = &self.centres[generator.random_range(0..self.centres.len())].neighbours;
        let mut any = || neighbours[generator.random_range(0..neighbours.len())].as_slice();
        (any(), any())
    }

    fn nearest(&self, x: &[f64]) -> usize {
        let at: Vec<f64> = (0..x.len()).map(|i| dot(&self.metric.row(i)[..=i], &x[..=i])).collect();
        let distance =
            |centre: &[f64]| -> f64 { centre.iter().zip(&at).map(|(a, b)| (a - b) * (a - b)).sum() };
        let mut best = (f64::INFINITY, 0);
        for (place, centre) in self.measured.iter().enumerate() {
            let distance = distance(centre);
            if distance < best.0 {
                best = (distance, place);
            }
        }
        best.1
    }
}

impl Centre {
    fn step(&self, from: &[f64], scale: f64, generator: &mut ChaCha8Rng) -> Vec<f64> {
        let normal: Vec<f64> = from.iter().map(|_| normal_quantile(generator.sample(Open01))).collect();
        (0..from.len()).map(|i| from[i] + scale * dot(&self.factor.row(i)[..=i], &normal[..=i])).collect()
    }

    /// Of a step by so many times the factor, up to (2π)^(−d/2) times that scale to the power −d; `away` is room for d numbers.
    fn ln_density(&self, from: &[f64], to: &[f64], scale: f64, away: &mut [f64]) -> f64 {
        away.iter_mut().zip(to.iter().zip(from)).for_each(|(away, (to, from))| *away = to - from);
        let square: f64 = (0..away.len()).map(|i| dot(&self.inverse.row(i)[..=i], &away[..=i]).powi(2)).sum();
        self.ln_norm - 0.5 * square / (scale * scale)
    }
}

/// Covariance of points about their mean, with a ridge below which a coordinate is as good as fixed.
fn covariance<'a>(points: impl Iterator<Item = &'a Vec<f64>> + Clone, n: usize) -> DMatrix<f64> {
    const RIDGE: f64 = 1e-12;
    let d = points.clone().next().map_or(0, Vec::len);
    let mut mean = vec![0.0; d];
    for point in points.clone() {
        mean.iter_mut().zip(point).for_each(|(mean, x)| *mean += x / n as f64);
    }
    let mut covariance = DMatrix::zeros(d, d);
    for point in points {
        for i in 0..d {
            for j in 0..=i {
                covariance[(i, j)] += (point[i] - mean[i]) * (point[j] - mean[j]) / n as f64;
            }
        }
    }
    for i in 0..d {
        covariance[(i, i)] += RIDGE + 1e-6 * covariance[(i, i)];
    }
    covariance
}

/// Lower factor of a covariance of which the lower half is read.
fn factor_of(covariance: &DMatrix<f64>) -> Triangle {
    let d = covariance.nrows();
    let mut lower = Triangle::zeros(d);
    for i in 0..d {
        for j in 0..=i {
            lower.row_mut(i)[j] = covariance[(i, j)];
        }
    }
    // With its ridge the matrix always has a factor; if rounding takes it, the diagonal serves.
    match Cholesky::new(&lower) {
        Ok(cholesky) => cholesky.lower().clone(),
        Err(_) => {
            let mut diagonal = Triangle::zeros(d);
            (0..d).for_each(|i| diagonal.row_mut(i)[i] = covariance[(i, i)].sqrt());
            diagonal
        }
    }
}

/// L⁻¹ of a lower triangle L.
fn inverse_of(lower: &Triangle) -> Triangle {
    let d = lower.n();
    let mut inverse = Triangle::zeros(d);
    for column in 0..d {
        for i in column..d {
            let sum: f64 = (column..i).map(|k| lower.row(i)[k] * inverse.row(k)[column]).sum();
            let unit = f64::from(u8::from(i == column));
            inverse.row_mut(i)[column] = (unit - sum) / lower.row(i)[i];
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn a_mixture_is_a_density_and_its_draws_follow_it() {
        let mut generator = ChaCha8Rng::seed_from_u64(1);
        let points: Vec<Vec<f64>> = (0..400)
            .map(|_| {
                let x: f64 = generator.random();
                vec![x, x * x + 0.01 * generator.random::<f64>()]
            })
            .collect();
        let mixture = LocalMixture::new(&points, 50, 1.0, &mut generator);
        // Over a square that holds it, by midpoints.
        let mut mass = 0.0;
        let mut right = 0.0;
        for i in 0..400 {
            for j in 0..400 {
                let x = [-0.5 + 0.005 * (f64::from(i) + 0.5), -0.5 + 0.005 * (f64::from(j) + 0.5)];
                let share = mixture.ln_density(&x).exp() * 0.005 * 0.005;
                mass += share;
                right += if x[0] > 0.7 { share } else { 0.0 };
            }
        }
        assert!((mass - 1.0).abs() < 0.01, "{mass}");
        let drawn = (0..20_000).filter(|_| mixture.draw(&mut generator)[0] > 0.7).count() as f64 / 2e4;
        assert!((drawn - right).abs() < 0.015, "{drawn} {right}");
    }
}
