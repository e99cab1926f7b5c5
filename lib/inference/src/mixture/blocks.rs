//! The samples of a fit, and the sums over them that a step of it needs.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::gaussian::Gaussian;

/// Samples of a block, which go through the arithmetic side by side.
const LANES: usize = 64;

/// Blocks that one thread works through on end; the sums do not depend on the number of threads.
const BLOCKS: usize = 8;

/// Terms of a sum that are added side by side.
const WIDTH: usize = 8;

type Lanes = [f64; LANES];

/// Weighted samples in blocks, dimension by dimension.
pub(super) struct Blocks {
    dimensions: usize,
    blocks: Vec<Block>,
}

struct Block {
    /// Places of its samples among all.
    samples: std::ops::Range<usize>,
    /// Coordinates, shape (dimensions,) of lanes; zero beyond the last sample.
    coordinates: Vec<Lanes>,
    /// Weight of each sample times the number of samples; zero beyond the last sample.
    counts: Lanes,
}

/// Sums over the samples, each counted as often as its weight and a component's share in it say.
#[derive(Clone)]
pub(super) struct Sums {
    /// −Σ share ln share over all components.
    pub entropy: f64,
    /// Sums of each component.
    pub components: Vec<Moments>,
}

/// Sums of the samples' distances from a reference point.
#[derive(Clone)]
pub(super) struct Moments {
    /// Σ 1.
    pub size: f64,
    /// Σ a, shape (dimensions,).
    first: Vec<f64>,
    /// Σ a aᵀ, lower triangle row by row.
    second: Vec<f64>,
}

impl Moments {
    fn new(dimensions: usize) -> Self {
        let triangle = dimensions * (dimensions + 1) / 2;
        Self { size: 0.0, first: vec![0.0; dimensions], second: vec![0.0; triangle] }
    }

    fn add(&mut self, other: &Self) {
        self.size += other.size;
        self.first.iter_mut().zip(&other.first).for_each(|(a, b)| *a += b);
        self.second.iter_mut().zip(&other.second).for_each(|(a, b)| *a += b);
    }

    /// Mean of the samples, when the reference was at `reference`.
    pub fn centre(&self, reference: &[f64]) -> Vec<f64> {
        reference.iter().zip(self.offset()).map(|(reference, offset)| reference + offset).collect()
    }

    fn offset(&self) -> Vec<f64> {
        self.first.iter().map(|sum| sum / (self.size + 10.0 * f64::EPSILON)).collect()
    }

    /// Σ (x − centre)(x − centre)ᵀ, shape (dimensions, dimensions).
    pub fn scatter(&self) -> DMatrix<f64> {
        let offset = self.offset();
        let d = offset.len();
        DMatrix::from_fn(d, d, |i, j| {
            let second = self.second[if i < j { triangle(j, i) } else { triangle(i, j) }];
            second - offset[i] * self.first[j] - self.first[i] * offset[j] + self.size * offset[i] * offset[j]
        })
    }
}

fn triangle(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

/// The shares of the components in the samples of a block, shape (components,) of lanes.
type Shares = Vec<Lanes>;

impl Blocks {
    /// Lay out samples of shape (n, dimensions), counted `counts` times each.
    pub fn new(samples: &[Vec<f64>], counts: &[f64]) -> Self {
        let dimensions = samples.first().map_or(0, Vec::len);
        let block = |(place, (samples, counts)): (usize, (&[Vec<f64>], &[f64]))| {
            let first = place * LANES;
            let mut block = Block {
                samples: first..first + samples.len(),
                coordinates: vec![[0.0; LANES]; dimensions],
                counts: [0.0; LANES],
            };
            block.counts[..counts.len()].copy_from_slice(counts);
            for (lane, sample) in samples.iter().enumerate() {
                block.coordinates.iter_mut().zip(sample).for_each(|(lanes, x)| lanes[lane] = *x);
            }
            block
        };
        let blocks = samples.chunks(LANES).zip(counts.chunks(LANES)).enumerate().map(block).collect();
        Self { dimensions, blocks }
    }

    /// Sums with the shares of the components given by `share(sample, component)`.
    pub fn sums_of_shares(&self, references: &[&[f64]], share: impl Fn(usize, usize) -> f64 + Sync) -> Sums {
        self.sums(references, |block, shares| {
            for (k, lanes) in shares.iter_mut().enumerate() {
                lanes.iter_mut().zip(block.samples.clone()).for_each(|(lane, i)| *lane = share(i, k));
            }
            0.0
        })
    }

    /// Sums with the shares that each component has by its density: ln of it is the Gaussian's, about
    /// its own mean, plus the shift beside it.
    pub fn sums_by_density(&self, components: &[(Gaussian, f64)]) -> Sums {
        let references: Vec<&[f64]> = components.iter().map(|(gaussian, _)| gaussian.mean()).collect();
        self.sums(&references, |block, shares| block.shares(components, shares))
    }

    /// Sums about the reference points of the components, with the shares that `share` writes for a
    /// block; it returns their entropy.
    fn sums(&self, references: &[&[f64]], share: impl Fn(&Block, &mut Shares) -> f64 + Sync) -> Sums {
        let empty = Sums { entropy: 0.0, components: vec![Moments::new(self.dimensions); references.len()] };
        let parts: Vec<Sums> = self
            .blocks
            .par_chunks(BLOCKS)
            .map(|blocks| {
                let mut sums = empty.clone();
                let mut shares = vec![[0.0; LANES]; references.len()];
                let mut away = vec![[0.0; LANES]; self.dimensions];
                for block in blocks {
                    sums.entropy += share(block, &mut shares);
                    for ((moments, reference), shares) in
                        sums.components.iter_mut().zip(references).zip(&shares)
                    {
                        block.add_moments(reference, shares, &mut away, moments);
                    }
                }
                sums
            })
            .collect();
        parts.into_iter().fold(empty, |mut sums, part| {
            sums.entropy += part.entropy;
            sums.components.iter_mut().zip(&part.components).for_each(|(a, b)| a.add(b));
            sums
        })
    }
}

impl Block {
    fn shares(&self, components: &[(Gaussian, f64)], shares: &mut Shares) -> f64 {
        let mut high = [f64::NEG_INFINITY; LANES];
        let mut standard = vec![[0.0; LANES]; self.coordinates.len()];
        for ((gaussian, shift), ln_share) in components.iter().zip(shares.iter_mut()) {
            gaussian.standardise(&self.coordinates, &mut standard);
            let mut squared = [0.0; LANES];
            for z in &standard {
                for lane in 0..LANES {
                    squared[lane] += z[lane] * z[lane];
                }
            }
            let peak = gaussian.ln_peak() + shift;
            for lane in 0..LANES {
                ln_share[lane] = peak - 0.5 * squared[lane];
                high[lane] = high[lane].max(ln_share[lane]);
            }
        }
        let mut total = [0.0; LANES];
        // Σ e ln e, from which the entropy of the shares follows without their logarithms.
        let mut product = [0.0; LANES];
        for lanes in shares.iter_mut() {
            for lane in 0..LANES {
                let ln = lanes[lane] - high[lane];
                let share = ln.exp();
                product[lane] += share * ln;
                total[lane] += share;
                lanes[lane] = share;
            }
        }
        let mut entropy = 0.0;
        for lane in 0..LANES {
            entropy += self.counts[lane] * (total[lane].ln() - product[lane] / total[lane]);
            total[lane] = 1.0 / total[lane];
        }
        for lanes in shares.iter_mut() {
            for lane in 0..LANES {
                lanes[lane] *= total[lane];
            }
        }
        entropy
    }

    fn add_moments(&self, reference: &[f64], shares: &Lanes, away: &mut [Lanes], moments: &mut Moments) {
        let mut counts = *shares;
        counts.iter_mut().zip(&self.counts).for_each(|(share, count)| *share *= count);
        moments.size += sum(&counts);
        for (i, reference) in reference.iter().enumerate() {
            let mut counted = [0.0; LANES];
            for lane in 0..LANES {
                away[i][lane] = self.coordinates[i][lane] - reference;
                counted[lane] = counts[lane] * away[i][lane];
            }
            moments.first[i] += sum(&counted);
            for (second, away) in moments.second[triangle(i, 0)..].iter_mut().zip(&away[..=i]) {
                *second += dot(&counted, away);
            }
        }
    }
}

fn sum(a: &Lanes) -> f64 {
    let mut sums = [0.0; WIDTH];
    for a in a.chunks_exact(WIDTH) {
        for i in 0..WIDTH {
            sums[i] += a[i];
        }
    }
    sums.iter().sum()
}

fn dot(a: &Lanes, b: &Lanes) -> f64 {
    let mut sums = [0.0; WIDTH];
    for (a, b) in a.chunks_exact(WIDTH).zip(b.chunks_exact(WIDTH)) {
        for i in 0..WIDTH {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum()
}
