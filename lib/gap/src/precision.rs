//! Generalised least squares for gaps that are constant over a stretch of the control axis.

use std::ops::Range;

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix};

use super::noise::Noise;

/// Steps of one observable over which a gap is taken to be constant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Interval {
    pub observable: usize,
    pub steps: Range<usize>,
}

/// The size of a gap over an interval, and the standard deviation of that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Height {
    pub gap: f64,
    pub sd: f64,
}

/// The inverse of the covariance N + L Lᵀ of all readings: tridiagonal for the autoregressive noise
/// N, less G Gᵀ for the directions L (Woodbury), all with prefix sums, so that an interval costs no
/// more than the number of directions.
#[derive(Clone, Debug)]
pub(super) struct Precision {
    steps: usize,
    /// Diagonal and first off-diagonal of N⁻¹, shape (observables · steps); the last off-diagonal of
    /// each observable is zero.
    diagonal: Vec<f64>,
    off_diagonal: Vec<f64>,
    /// Prefix sums of both, observable by observable, shape (observables, steps + 1).
    diagonal_sums: Vec<f64>,
    off_diagonal_sums: Vec<f64>,
    /// Columns of G, each of shape (observables · steps).
    columns: Vec<Vec<f64>>,
    /// Their prefix sums, observable by observable, shape (observables, steps + 1).
    column_sums: Vec<Vec<f64>>,
}

/// An interval of which less than this share of its information is left is explained by others.
const LEFT: f64 = 1e-6;

impl Precision {
    pub fn new(noises: &[Noise], directions: &[Vec<f64>]) -> Result<Self> {
        let steps = noises[0].sd.len();
        let (mut diagonal, mut off_diagonal) = (Vec::new(), Vec::new());
        for noise in noises {
            let phi = if steps > 1 { noise.phi } else { 0.0 };
            let innovation = 1.0 - phi * phi;
            for (step, sd) in noise.sd.iter().enumerate() {
                let inner = step > 0 && step + 1 < steps;
                diagonal.push((1.0 + if inner { phi * phi } else { 0.0 }) / (innovation * sd * sd));
                let next = noise.sd.get(step + 1);
                off_diagonal.push(next.map_or(0.0, |next| -phi / (innovation * sd * next)));
            }
        }
        let mut precision = Self {
            steps,
            diagonal_sums: prefix_sums(&diagonal, steps),
            off_diagonal_sums: prefix_sums(&off_diagonal, steps),
            diagonal,
            off_diagonal,
            columns: Vec::new(),
            column_sums: Vec::new(),
        };
        if !directions.is_empty() {
            let (n, k) = (directions[0].len(), directions.len());
            let l = DMatrix::from_iterator(n, k, directions.iter().flatten().copied());
            let solved = directions.iter().flat_map(|direction| precision.apply(direction));
            let solved = DMatrix::from_iterator(n, k, solved);
            let inner = DMatrix::identity(k, k) + l.transpose() * &solved;
            let factor = Cholesky::new(inner).context("the posterior covariance is not finite")?;
            let columns = factor
                .l()
                .solve_lower_triangular(&solved.transpose())
                .context("the posterior covariance is singular")?;
            for column in columns.row_iter() {
                precision.push(column.iter().copied().collect());
            }
        }
        Ok(precision)
    }

    fn push(&mut self, column: Vec<f64>) {
        self.column_sums.push(prefix_sums(&column, self.steps));
        self.columns.push(column);
    }

    /// The precision times a vector of shape (observables · steps).
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut product: Vec<f64> = x.iter().zip(&self.diagonal).map(|(x, q)| x * q).collect();
        for i in 0..x.len().saturating_sub(1) {
            product[i] += self.off_diagonal[i] * x[i + 1];
            product[i + 1] += self.off_diagonal[i] * x[i];
        }
        for column in &self.columns {
            let along: f64 = column.iter().zip(x).map(|(g, x)| g * x).sum();
            product.iter_mut().zip(column).for_each(|(product, g)| *product -= along * g);
        }
        product
    }

    /// Information on the height of a gap over an interval: its precision, or `None` if nothing is
    /// left that others do not explain.
    fn information(&self, observable: usize, steps: &Range<usize>) -> Option<f64> {
        let base = observable * (self.steps + 1);
        let (start, end) = (base + steps.start, base + steps.end);
        let noise = self.diagonal_sums[end] - self.diagonal_sums[start]
            + 2.0 * (self.off_diagonal_sums[end - 1] - self.off_diagonal_sums[start]);
        let explained: f64 = self.column_sums.iter().map(|sums| (sums[end] - sums[start]).powi(2)).sum();
        Some(noise - explained).filter(|&left| left > LEFT * noise)
    }

    /// The height of a gap over an interval, given the gap at every step.
    pub fn height(&self, interval: &Interval, gap: &[f64]) -> Option<Height> {
        let information = self.information(interval.observable, &interval.steps)?;
        let applied = self.apply(gap);
        let start = interval.observable * self.steps;
        let sum: f64 = applied[start + interval.steps.start..start + interval.steps.end].iter().sum();
        Some(Height { gap: sum / information, sd: information.sqrt().recip() })
    }

    /// Leave the height of a gap over an interval free from here on.
    pub fn set_free(&mut self, interval: &Interval) {
        let Some(information) = self.information(interval.observable, &interval.steps) else { return };
        let mut indicator = vec![0.0; self.diagonal.len()];
        let start = interval.observable * self.steps;
        indicator[start + interval.steps.start..start + interval.steps.end].fill(1.0);
        let scale = information.sqrt().recip();
        self.push(self.apply(&indicator).into_iter().map(|x| x * scale).collect());
    }

    /// The interval between two of `cuts` whose height is most standard deviations from zero, and how
    /// many.
    pub fn most_deviant(&self, gap: &[f64], cuts: &[usize]) -> Option<(Interval, f64)> {
        let sums = prefix_sums(&self.apply(gap), self.steps);
        let mut most: Option<(Interval, f64)> = None;
        for observable in 0..self.diagonal.len() / self.steps {
            let base = observable * (self.steps + 1);
            for (place, &from) in cuts.iter().enumerate() {
                for &to in &cuts[place + 1..] {
                    let Some(information) = self.information(observable, &(from..to)) else { continue };
                    let z = (sums[base + to] - sums[base + from]).abs() / information.sqrt();
                    if most.as_ref().is_none_or(|(_, highest)| z > *highest) {
                        most = Some((Interval { observable, steps: from..to }, z));
                    }
                }
            }
        }
        most
    }
}

/// Sums of all values before each step and of all, observable by observable.
fn prefix_sums(values: &[f64], steps: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + values.len() / steps);
    for block in values.chunks(steps) {
        let mut sum = 0.0;
        sums.push(sum);
        for value in block {
            sum += value;
            sums.push(sum);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    /// The covariance written out.
    fn covariance(noises: &[Noise], directions: &[Vec<f64>]) -> DMatrix<f64> {
        let steps = noises[0].sd.len();
        let n = noises.len() * steps;
        let mut all = DMatrix::from_fn(n, n, |a, b| {
            let (noise, s, t) = (&noises[a / steps], a % steps, b % steps);
            let same = a / steps == b / steps;
            if same { noise.sd[s] * noise.sd[t] * noise.phi.powi(s.abs_diff(t) as i32) } else { 0.0 }
        });
        for direction in directions {
            let direction = DVector::from_column_slice(direction);
            all += &direction * direction.transpose();
        }
        all
    }

    fn example() -> (Vec<Noise>, Vec<Vec<f64>>, Vec<f64>) {
        let noises = vec![
            Noise { sd: vec![1.0, 1.1, 0.9, 1.2], phi: 0.6 },
            Noise { sd: vec![0.2, 0.3, 0.2, 0.1], phi: 0.0 },
        ];
        let directions =
            vec![vec![1.0, 1.0, 1.0, 1.0, 0.0, 0.1, 0.2, 0.3], vec![0.0, 0.5, -0.5, 1.0, 0.3, 0.0, 0.0, 0.1]];
        (noises, directions, vec![0.3, -1.0, 2.0, 0.7, 0.1, 0.0, 0.4, -0.2])
    }

    #[test]
    fn it_is_the_inverse_of_the_covariance() {
        let (noises, directions, gap) = example();
        let precision = Precision::new(&noises, &directions).unwrap();
        let expected =
            covariance(&noises, &directions).try_inverse().unwrap() * DVector::from_vec(gap.clone());
        for (found, expected) in precision.apply(&gap).iter().zip(expected.iter()) {
            assert!((found - expected).abs() < 1e-10, "{found} {expected}");
        }
    }

    #[test]
    fn heights_are_those_of_generalised_least_squares() {
        let (noises, directions, gap) = example();
        let intervals = [Interval { observable: 0, steps: 1..3 }, Interval { observable: 1, steps: 2..4 }];
        let mut precision = Precision::new(&noises, &directions).unwrap();
        precision.set_free(&intervals[1]);
        let height = precision.height(&intervals[0], &gap).unwrap();

        let inverse = covariance(&noises, &directions).try_inverse().unwrap();
        let design = DMatrix::from_column_slice(
            8,
            2,
            &[0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0],
        );
        let normal = (design.transpose() * &inverse * &design).try_inverse().unwrap();
        let estimate = &normal * design.transpose() * inverse * DVector::from_vec(gap.clone());
        assert!((height.gap - estimate[0]).abs() < 1e-10);
        assert!((height.sd - normal[(0, 0)].sqrt()).abs() < 1e-10);
        precision.set_free(&intervals[0]);
        assert!(precision.height(&intervals[0], &gap).is_none(), "nothing is left to explain");
    }
}
