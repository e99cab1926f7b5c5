//! Point sets that fill the unit cube evenly.

use anyhow::{Result, bail, ensure};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sobol::params::JoeKuoD6;
use sobol::{Sobol, SobolParams};

/// A way to fill the unit cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Halton sequence; Halton (1960), Numer. Math. 2:84.
    Halton,
    /// Sobol sequence, directions of Joe & Kuo (2008), SIAM J. Sci. Comput. 30:2635.
    Sobol,
    /// Latin hypercube; McKay, Beckman & Conover (1979), Technometrics 21:239.
    Lhs,
}

/// `n` points in the unit cube of `dimensions`, shape (n, dimensions), in [0, 1).
///
/// A `seed` scrambles them: Halton digits by a random permutation at each place (Owen 2017,
/// arXiv:1706.02808), Sobol points by a random digital shift. Without one they are the plain
/// sequence, which begins with the origin; a Latin hypercube is random always.
///
/// # Errors
/// If the method has no plain form, or not that many dimensions.
pub fn points(method: Method, n: usize, dimensions: usize, seed: Option<u64>) -> Result<Vec<Vec<f64>>> {
    match method {
        Method::Halton => {
            let halton = Halton::new(dimensions, seed);
            Ok((0..n).map(|i| halton.point(i as u64)).collect())
        }
        Method::Sobol => sobol_points(n, dimensions, seed),
        Method::Lhs => match seed {
            Some(seed) => Ok(latin_hypercube(n, dimensions, seed)),
            None => bail!("a Latin hypercube is random; only halton and sobol have an unscrambled form"),
        },
    }
}

/// The Halton sequence: in each dimension the digits of the index, in a prime base, mirrored at the
/// point.
///
/// # Examples
/// ```
/// use gl_numeric::sequence::Halton;
///
/// // 6 is 110 in base 2 and 20 in base 3.
/// let point = Halton::new(2, None).point(6);
/// assert!((point[0] - 3.0 / 8.0).abs() < 1e-15 && (point[1] - 2.0 / 9.0).abs() < 1e-15);
/// ```
#[derive(Clone, Debug)]
pub struct Halton {
    bases: Vec<u64>,
    /// For each dimension and digit place, what each digit becomes; absent for the plain sequence.
    permutations: Option<Vec<Vec<Vec<u64>>>>,
}

impl Halton {
    /// The sequence in `dimensions`, scrambled if there is a `seed`.
    pub fn new(dimensions: usize, seed: Option<u64>) -> Self {
        let bases = primes(dimensions);
        let permutations = seed.map(|seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            bases
                .iter()
                .map(|&base| (0..places(base)).map(|_| permutation(base, &mut rng)).collect())
                .collect()
        });
        Self { bases, permutations }
    }

    /// The point at an index from 0 upwards, shape (dimensions,).
    pub fn point(&self, index: u64) -> Vec<f64> {
        (0..self.bases.len()).map(|j| self.coordinate(j, index)).collect()
    }

    fn coordinate(&self, dimension: usize, index: u64) -> f64 {
        let base = self.bases[dimension];
        let (mut rest, mut mirrored, mut unit) = (index, 0.0, 1.0);
        match &self.permutations {
            None => {
                while rest > 0 {
                    unit /= base as f64;
                    mirrored += unit * (rest % base) as f64;
                    rest /= base;
                }
            }
            Some(permutations) => {
                for permutation in &permutations[dimension] {
                    unit /= base as f64;
                    mirrored += unit * permutation[(rest % base) as usize] as f64;
                    rest /= base;
                }
            }
        }
        f64::min(mirrored, 1.0 - f64::EPSILON)
    }
}

/// Digit places in a base until a unit of the last is below the resolution of `f64`.
fn places(base: u64) -> usize {
    (53.0 / (base as f64).log2()).ceil() as usize
}

fn permutation(n: u64, rng: &mut ChaCha8Rng) -> Vec<u64> {
    let mut all: Vec<u64> = (0..n).collect();
    all.shuffle(rng);
    all
}

fn primes(count: usize) -> Vec<u64> {
    let mut primes: Vec<u64> = Vec::with_capacity(count);
    let mut candidate = 2;
    while primes.len() < count {
        if primes.iter().all(|prime| candidate % prime != 0) {
            primes.push(candidate);
        }
        candidate += 1;
    }
    primes
}

fn sobol_points(n: usize, dimensions: usize, seed: Option<u64>) -> Result<Vec<Vec<f64>>> {
    const RESOLUTION: f64 = (1u64 << 53) as f64;
    let params = JoeKuoD6::minimal();
    let most = params.max_dims();
    ensure!(
        dimensions <= most,
        "sobol has {most} dimensions at the most, {dimensions} are needed; use halton"
    );
    let mut rng = ChaCha8Rng::seed_from_u64(seed.unwrap_or(0));
    let shift: Vec<u64> =
        (0..dimensions).map(|_| if seed.is_some() { rng.random::<u64>() >> 11 } else { 0 }).collect();
    let shifted = |x: f64, shift: u64| ((x * RESOLUTION) as u64 ^ shift) as f64 / RESOLUTION;
    Ok(Sobol::<f64>::new(dimensions, &params)
        .take(n)
        .map(|point| point.iter().zip(&shift).map(|(&x, &shift)| shifted(x, shift)).collect())
        .collect())
}

fn latin_hypercube(n: usize, dimensions: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut points = vec![vec![0.0; dimensions]; n];
    for j in 0..dimensions {
        for (point, stratum) in points.iter_mut().zip(permutation(n as u64, &mut rng)) {
            point[j] = (stratum as f64 + rng.random::<f64>()) / n as f64;
        }
    }
    points
}
