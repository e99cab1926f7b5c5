//! The density of a measurement given the parameters, through an emulator.
//!
//! y = f(θ) + noise, with f(θ) normal about the emulator's mean: y ~ N(c + B μ(θ), D + B C(θ) Bᵀ). B are the
//! principal components, μ the mean of their scores, C(θ) the covariance of the scores: what the emulator
//! does not know of them, and the share of the simulation's scatter that the measurement has too. Both are
//! errors along the whole control and so correlated along it. D is the noise, independent from reading to
//! reading or a first-order autoregression. By the identity of Woodbury a likelihood needs matrices of
//! the components' number only.
//!
//! Where the runs reach far beyond the measurement the emulator sees them warped; see [`warp`](crate::warp). Residuals are
//! those of the readings all the same, and B is then the derivative at the measurement.

mod held_out;

use nalgebra::{DMatrix, DVector};

use super::smc::Density;
use super::space::Space;
use super::surrogate::Surrogate;
use crate::Emulator;
use crate::cholesky::{Cholesky, Triangle, dot};
use crate::warp::Warp;

/// What was measured; all observables behind each other, each at all steps.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Readings as the emulator sees them, warped, shape (observables · steps).
    pub values: Vec<f64>,
    /// Standard deviation of their noise; where it is not known, what it is a share of.
    pub base: Vec<f64>,
    /// The readings themselves.
    pub readings: Vec<f64>,
    /// Standard deviation of their own noise, or what that is a share of.
    pub noise: Vec<f64>,
    /// What the emulator sees of each observable, shape (observables,).
    pub warps: Vec<Warp>,
    /// Whether it is known.
    pub is_known: bool,
    /// Where the readings of each observable begin, and the number of all, shape (observables + 1,).
    pub starts: Vec<usize>,
    /// Range of each observable, shape (observables,).
    pub ranges: Vec<f64>,
}

impl Measured {
    /// The components of an emulator in standard deviations of the noise, shape (readings, components).
    pub fn patterns(&self, emulator: &Emulator) -> DMatrix<f64> {
        let (outputs, k) = emulator.basis().shape();
        DMatrix::from_fn(outputs, k, |o, c| emulator.basis()[(o, c)] / self.base[o])
    }

    /// What the readings have more than a curve that the emulator gives, in their own units, shape
    /// (observables · steps).
    pub fn residual(&self, curve: &[f64]) -> Vec<f64> {
        let mut residual = self.readings.clone();
        for (j, warp) in self.warps.iter().enumerate() {
            let own = self.own(j);
            residual[own.clone()].iter_mut().zip(&curve[own]).for_each(|(left, y)| *left -= warp.back(*y));
        }
        residual
    }

    /// Σ (r / base)² for simulated readings, shape (observables · steps).
    pub fn misfit(&self, simulated: &[f64]) -> f64 {
        let pairs = self.values.iter().zip(simulated).zip(&self.base);
        pairs.map(|((seen, simulated), base)| ((seen - simulated) / base).powi(2)).sum()
    }

    /// Number of observables.
    pub fn observables(&self) -> usize {
        self.ranges.len()
    }

    /// Places of the readings of an observable.
    pub fn own(&self, observable: usize) -> std::ops::Range<usize> {
        self.starts[observable]..self.starts[observable + 1]
    }

    /// Mean over observables and steps of |r| over the observable's range, of a residual of shape (observables · steps).
    pub fn error(&self, residual: &[f64]) -> f64 {
        let shares = residual.iter().enumerate().map(|(o, r)| r.abs() / self.ranges[self.observable_of(o)]);
        shares.sum::<f64>() / residual.len() as f64
    }

    /// The observable of a reading.
    pub fn observable_of(&self, reading: usize) -> usize {
        self.starts.partition_point(|start| *start <= reading) - 1
    }
}

/// What is not known of the noise and has a coordinate of its own, behind those of the parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Nuisances {
    /// Share of the simulation's scatter in the measurement; a coordinate if absent.
    pub scatter: Option<f64>,
    /// ln of the noise over its base, lowest and highest, where the noise is not known.
    pub ln_noise: Option<(f64, f64)>,
    /// Whether the noise may be larger than stated.
    pub inflation: bool,
    /// Whether each observable's noise may be correlated from step to step.
    pub correlation: Vec<bool>,
}

/// Probability that the measurement has all of the simulation's scatter.
const LIKE_SIMULATED: f64 = 0.8;

/// The largest factor on a stated noise.
const LARGEST_INFLATION: f64 = 10.0;

/// A variance of a score that makes no difference, so that a matrix of none has a factor.
const NO_VARIANCE: f64 = 1e-20;

/// The largest correlation from step to step.
const LARGEST_CORRELATION: f64 = 0.98;

/// Where the nuisances of a point stand.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseAt {
    /// Share of the scatter.
    pub scatter: f64,
    /// Variance of the noise over that of its base.
    pub variance: f64,
    /// Correlation of each observable's noise from step to step.
    pub correlation: Vec<f64>,
}

impl Nuisances {
    /// Number of coordinates.
    pub fn len(&self) -> usize {
        usize::from(self.scatter.is_none())
            + usize::from(self.ln_noise.is_some())
            + usize::from(self.inflation)
            + self.correlation.iter().filter(|is_free| **is_free).count()
    }

    /// Whether everything is known.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What coordinates, shape (len,), stand for. The share of the scatter is 1 with probability 0.8, a specimen like
    /// the simulated one, and else even between 0 and 1; noise and inflation are even in the logarithm (Jeffreys), correlations even.
    pub fn at(&self, coordinates: &[f64]) -> NoiseAt {
        let mut rest = coordinates.iter().copied();
        let mut next = || rest.next().unwrap_or(0.0);
        let scatter = self.scatter.unwrap_or_else(|| (next() / (1.0 - LIKE_SIMULATED)).min(1.0));
        let mut ln_sd = 0.0;
        if let Some((low, high)) = self.ln_noise {
            ln_sd += low + (high - low) * next();
        }
        if self.inflation {
            ln_sd += LARGEST_INFLATION.ln() * next();
        }
        let correlation =
            self.correlation.iter().map(|is_free| if *is_free { LARGEST_CORRELATION * next() } else { 0.0 });
        NoiseAt { scatter, correlation: correlation.collect(), variance: (2.0 * ln_sd).exp() }
    }

    /// The coordinate of a correlation.
    pub fn of_correlation(correlation: f64) -> f64 {
        correlation / LARGEST_CORRELATION
    }
}

/// A quadratic form of the residual in the scores: c − 2 aᵀμ + μᵀGμ.
#[derive(Clone, Debug, Default)]
struct Quadratic {
    g: Vec<f64>,
    a: Vec<f64>,
    c: f64,
}

impl Quadratic {
    fn zeros(k: usize) -> Self {
        Self { g: vec![0.0; k * k], a: vec![0.0; k], c: 0.0 }
    }

    fn add(&mut self, factor: f64, other: &Self) {
        self.g.iter_mut().zip(&other.g).for_each(|(x, y)| *x += factor * y);
        self.a.iter_mut().zip(&other.a).for_each(|(x, y)| *x += factor * y);
        self.c += factor * other.c;
    }

    /// Add the product of two readings' patterns and residuals, made symmetric.
    fn add_product(&mut self, (w, e): (&[f64], f64), (v, f): (&[f64], f64)) {
        let k = self.a.len();
        for i in 0..k {
            for j in 0..k {
                self.g[i * k + j] += 0.5 * (w[i] * v[j] + v[i] * w[j]);
            }
            self.a[i] += 0.5 * (w[i] * f + v[i] * e);
        }
        self.c += e * f;
    }
}

/// One observable. The inverse correlation of a first-order autoregression is
/// (I − φ S + φ² E)/(1 − φ²): S has ones beside the diagonal, E is I without its first and last entry.
#[derive(Clone, Debug)]
struct Block {
    steps: f64,
    ln_base: f64,
    identity: Quadratic,
    beside: Quadratic,
    inner: Quadratic,
    /// The patterns in units of the base, shape (steps, components), where the observable is warped.
    patterns: Vec<Vec<f64>>,
    /// Variance that is white, relative to the base: what the components leave over, and scatter.
    white: (f64, f64),
}

/// The likelihood of a measurement through an emulator.
#[derive(Clone, Debug)]
pub struct Likelihood<'a> {
    emulator: &'a Emulator,
    space: &'a Space,
    measured: &'a Measured,
    /// Whether an observable is.
    is_warped: bool,
    blocks: Vec<Block>,
    /// Correlation of the scores' errors, lower half.
    correlation: Triangle,
    /// Covariance of the scores by the simulation's scatter, lower half.
    scatter: Triangle,
    /// What the emulator's variance is multiplied by.
    calibration: f64,
    nuisances: Nuisances,
}

/// A likelihood with what it is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// ln of the density.
    pub ln: f64,
    /// rᵀ Σ⁻¹ r.
    pub square: f64,
}

/// The forms of all observables at one noise, put together.
struct Joint {
    quadratic: Quadratic,
    ln_determinant: f64,
}

impl<'a> Likelihood<'a> {
    /// The likelihood through a surrogate.
    pub fn new(
        surrogate: &'a Surrogate,
        space: &'a Space,
        measured: &'a Measured,
        nuisances: Nuisances,
    ) -> Self {
        let Surrogate { emulator, scatter, calibration, .. } = surrogate;
        let k = emulator.basis().ncols();
        let is_warped = measured.warps.iter().any(|warp| warp.is_some());
        let block = |j: usize| {
            let outputs = measured.own(j);
            let rows: Vec<(Vec<f64>, f64)> = outputs
                .clone()
                .map(|o| {
                    let base = measured.base[o];
                    let pattern = emulator.basis().row(o).iter().map(|b| b / base).collect();
                    (pattern, (measured.values[o] - emulator.centre()[o]) / base)
                })
                .collect();
            let mut block = Block {
                steps: outputs.len() as f64,
                ln_base: outputs.clone().map(|o| 2.0 * measured.noise[o].ln()).sum(),
                identity: Quadratic::zeros(k),
                beside: Quadratic::zeros(k),
                inner: Quadratic::zeros(k),
                patterns: Vec::new(),
                white: (scatter.truncated[j], scatter.white[j]),
            };
            for (t, (row, e)) in rows.iter().enumerate() {
                block.identity.add_product((row, *e), (row, *e));
                if t > 0 && t + 1 < rows.len() {
                    block.inner.add_product((row, *e), (row, *e));
                }
                if let Some((next, f)) = rows.get(t + 1) {
                    block.beside.add_product((row, *e), (next, *f));
                    block.beside.add_product((next, *f), (row, *e));
                }
            }
            if is_warped {
                block.patterns = rows.into_iter().map(|(pattern, _)| pattern).collect();
            }
            block
        };
        let lower = |matrix: &DMatrix<f64>| {
            let mut lower = Triangle::zeros(k);
            for i in 0..k {
                (0..=i).for_each(|j| lower.row_mut(i)[j] = matrix[(i, j)]);
            }
            lower
        };
        let (correlation, of_scatter) = (lower(emulator.correlation()), lower(&scatter.scores));
        let blocks = (0..measured.observables()).map(block).collect();
        Self {
            emulator,
            space,
            measured,
            is_warped,
            blocks,
            correlation,
            scatter: of_scatter,
            calibration: *calibration,
            nuisances,
        }
    }

    /// The same if the emulator's mean were exact.
    pub fn of_exact_emulator(&self) -> Self {
        Self { calibration: 0.0, ..self.clone() }
    }

    /// Number of coordinates: parameters, then nuisances.
    pub fn dimensions(&self) -> usize {
        self.space.len() + self.nuisances.len()
    }

    /// What is not known of the noise.
    pub fn nuisances(&self) -> &Nuisances {
        &self.nuisances
    }

    /// Noise and scatter at a point.
    pub fn noise_at(&self, x: &[f64]) -> NoiseAt {
        self.nuisances.at(&x[self.space.len()..])
    }

    /// Where the observable's own correlation stands among the coordinates, if it has one.
    pub fn place_of_correlation(&self, observable: usize) -> Option<usize> {
        if !self.nuisances.correlation[observable] {
            return None;
        }
        let after = self.nuisances.correlation[observable..].iter().filter(|is_free| **is_free).count();
        Some(self.dimensions() - after)
    }

    fn joint(&self, noise: &NoiseAt) -> Joint {
        let k = self.scatter.n();
        let mut joint = Joint { quadratic: Quadratic::zeros(k), ln_determinant: 0.0 };
        for (block, &phi) in self.blocks.iter().zip(&noise.correlation) {
            let variance = noise.variance + block.white.0 + noise.scatter * block.white.1;
            let factor = 1.0 / (variance * (1.0 - phi * phi));
            joint.quadratic.add(factor, &block.identity);
            joint.ln_determinant += block.ln_base + block.steps * variance.ln();
            if phi > 0.0 {
                joint.quadratic.add(-phi * factor, &block.beside);
                joint.quadratic.add(phi * phi * factor, &block.inner);
                joint.ln_determinant += (block.steps - 1.0) * (1.0 - phi * phi).ln();
            }
        }
        joint
    }

    /// ln of the density of the measurement at a point, shape (dimensions,).
    pub fn fit(&self, x: &[f64]) -> Fit {
        let (mean, variance) = self.emulator.predict_scores(&self.space.coordinates(x));
        self.of_scores(&mean, &variance, &self.noise_at(x), self.calibration)
    }

    /// The same if the emulator were exact.
    pub fn fit_if_known(&self, x: &[f64]) -> Fit {
        let mean = self.emulator.mean_scores(&self.space.coordinates(x));
        self.of_scores(&mean, &vec![0.0; mean.len()], &self.noise_at(x), 1.0)
    }

    fn of_scores(&self, mean: &[f64], variance: &[f64], noise: &NoiseAt, calibration: f64) -> Fit {
        let k = mean.len();
        let Joint { quadratic, ln_determinant } = self.joint(noise);
        let (square, gap) = if self.is_warped {
            self.warped_gap(mean, noise)
        } else {
            let g_mean: Vec<f64> = (0..k).map(|i| dot(&quadratic.g[i * k..(i + 1) * k], mean)).collect();
            let square = quadratic.c - 2.0 * dot(&quadratic.a, mean) + dot(&g_mean, mean);
            (square, quadratic.a.iter().zip(&g_mean).map(|(a, g)| a - g).collect())
        };
        let variance: Vec<f64> = variance.iter().map(|v| calibration * v.max(0.0)).collect();
        let Some((factor, cholesky)) = self.capacitance(&quadratic.g, &variance, noise.scatter) else {
            return Fit { ln: f64::NEG_INFINITY, square: f64::INFINITY };
        };
        let mut q: Vec<f64> = (0..k).map(|i| (i..k).map(|l| factor.row(l)[i] * gap[l]).sum()).collect();
        cholesky.solve_lower(&mut q);
        let square = (square - dot(&q, &q)).max(0.0);
        let readings: f64 = self.blocks.iter().map(|block| block.steps).sum();
        let ln_determinant = ln_determinant + cholesky.ln_determinant();
        Fit { ln: -0.5 * (square + ln_determinant + readings * std::f64::consts::TAU.ln()), square }
    }

    /// rᵀD⁻¹r and BᵀD⁻¹r of the residual itself, where the mean scores do not give it by a linear form.
    fn warped_gap(&self, mean: &[f64], noise: &NoiseAt) -> (f64, Vec<f64>) {
        let curve = self.emulator.curve(mean);
        let residual = self.measured.residual(curve.as_slice());
        let e: Vec<f64> = residual.iter().zip(&self.measured.noise).map(|(r, sd)| r / sd).collect();
        let (mut square, mut gap) = (0.0, vec![0.0; mean.len()]);
        for (j, (block, &phi)) in self.blocks.iter().zip(&noise.correlation).enumerate() {
            let e = &e[self.measured.own(j)];
            let variance = noise.variance + block.white.0 + noise.scatter * block.white.1;
            let factor = 1.0 / (variance * (1.0 - phi * phi));
            let last = e.len() - 1;
            for (t, pattern) in block.patterns.iter().enumerate() {
                let is_inner = t > 0 && t < last;
                let mut z = e[t] * if is_inner { 1.0 + phi * phi } else { 1.0 };
                z -= if t > 0 { phi * e[t - 1] } else { 0.0 };
                z -= if t < last { phi * e[t + 1] } else { 0.0 };
                z *= factor;
                square += e[t] * z;
                gap.iter_mut().zip(pattern).for_each(|(gap, w)| *gap += w * z);
            }
        }
        (square, gap)
    }

    /// L with L Lᵀ = C for variances of the scores' errors and a share of the scatter, and the factor of I + Lᵀ G L.
    fn capacitance(&self, g: &[f64], variance: &[f64], scatter: f64) -> Option<(Triangle, Cholesky)> {
        let k = variance.len();
        let sd: Vec<f64> = variance.iter().map(|variance| variance.sqrt()).collect();
        let mut factor = Triangle::zeros(k);
        for i in 0..k {
            let (correlation, of_scatter) = (self.correlation.row(i), self.scatter.row(i));
            let row = factor.row_mut(i);
            for j in 0..=i {
                row[j] = correlation[j] * sd[i] * sd[j] + scatter * of_scatter[j];
            }
            row[i] += NO_VARIANCE;
        }
        let factor = Cholesky::new(&factor).ok()?.lower().clone();
        // G L, a row at a time, and Lᵀ G L, to which each row is added.
        let mut row = vec![0.0; k];
        let mut inner = Triangle::zeros(k);
        for i in 0..k {
            row.fill(0.0);
            for (l, g) in g[i * k..(i + 1) * k].iter().enumerate() {
                row.iter_mut().zip(factor.row(l)).for_each(|(sum, factor)| *sum += g * factor);
            }
            for (j, factor) in factor.row(i).iter().enumerate() {
                inner.row_mut(j).iter_mut().zip(&row).for_each(|(sum, product)| *sum += factor * product);
            }
        }
        (0..k).for_each(|i| inner.row_mut(i)[i] += 1.0);
        Cholesky::new(&inner).ok().map(|cholesky| (factor, cholesky))
    }

    /// BᵀΣ⁻¹B with Σ of noise and scatter alone, shape (components, components): what an error of the scores
    /// counts for.
    pub fn importance(&self, noise: &NoiseAt) -> DMatrix<f64> {
        let k = self.scatter.n();
        let importance = DMatrix::from_row_slice(k, k, &self.joint(noise).quadratic.g);
        if noise.scatter == 0.0 { importance } else { self.beside(importance, &vec![0.0; k], noise) }
    }

    /// What the parameters are known by about a point: JᵀBᵀΣ⁻¹BJ with J the derivative of the mean scores and Σ with
    /// what the emulator does not know there, lower half, shape (parameters, parameters).
    pub fn curvature(&self, x: &[f64]) -> Triangle {
        const STEP: f64 = 1e-5;
        let (d, noise) = (self.space.len(), self.noise_at(x));
        let slope = |j: usize| -> Vec<f64> {
            let at = |value: f64| {
                let mut x = x.to_vec();
                x[j] = value;
                self.emulator.mean_scores(&self.space.coordinates(&x))
            };
            let (low, high) = ((x[j] - STEP).max(0.0), (x[j] + STEP).min(1.0));
            at(high)
                .iter()
                .zip(at(low))
                .map(|(high_score, low_score)| (high_score - low_score) / (high - low))
                .collect()
        };
        let slopes: Vec<DVector<f64>> = (0..d).map(|j| DVector::from_vec(slope(j))).collect();
        let (_, variance) = self.emulator.predict_scores(&self.space.coordinates(x));
        let variance: Vec<f64> = variance.iter().map(|v| self.calibration * v.max(0.0)).collect();
        let g = DMatrix::from_row_slice(variance.len(), variance.len(), &self.joint(&noise).quadratic.g);
        let importance = self.beside(g, &variance, &noise);
        let mut curvature = Triangle::zeros(d);
        for i in 0..d {
            let along = &importance * &slopes[i];
            (0..=i).for_each(|j| curvature.row_mut(i)[j] = along.dot(&slopes[j]));
        }
        curvature
    }

    /// What is left of G = BᵀD⁻¹B beside errors of the scores: their variances, and a share of the scatter.
    fn beside(&self, mut importance: DMatrix<f64>, variance: &[f64], noise: &NoiseAt) -> DMatrix<f64> {
        let k = variance.len();
        let g: Vec<f64> = importance.transpose().as_slice().to_vec();
        let Some((factor, cholesky)) = self.capacitance(&g, variance, noise.scatter) else {
            return importance;
        };
        // Columns of (chol)⁻¹ Lᵀ G.
        let columns: Vec<Vec<f64>> = (0..k)
            .map(|c| {
                let mut column: Vec<f64> =
                    (0..k).map(|i| (i..k).map(|l| factor.row(l)[i] * g[l * k + c]).sum()).collect();
                cholesky.solve_lower(&mut column);
                column
            })
            .collect();
        for i in 0..k {
            for j in 0..k {
                importance[(i, j)] -= dot(&columns[i], &columns[j]);
            }
        }
        importance
    }

    /// The share of what a measurement without patterns of scatter would say of the way from one point to another,
    /// δᵀGδ with δ the difference of the mean scores and G = BᵀD⁻¹B, that these patterns take: what it would say, and
    /// what it says.
    pub fn information(&self, one: &[f64], other: &[f64], noise: &NoiseAt) -> (f64, f64) {
        let [from, to] =
            [one, other].map(|x| DVector::from_vec(self.emulator.mean_scores(&self.space.coordinates(x))));
        let along = to - from;
        let k = along.len();
        let without = DMatrix::from_row_slice(k, k, &self.joint(noise).quadratic.g);
        (along.dot(&(without * &along)), along.dot(&(self.importance(noise) * &along)))
    }

    /// Half the variance that the difference of ln likelihood between two points has by what the emulator does
    /// not know: ½ (Δᵀ H V H Δ + tr H D), with Δ the difference of the mean scores, H of
    /// [`Likelihood::importance`], V the covariance of the scores' errors and D that of the errors' difference.
    /// An error that both points share counts only where it points from one to the other.
    pub fn ignorance(&self, one: &[f64], other: &[f64], noise: &NoiseAt) -> f64 {
        let coordinates = [one, other].map(|x| self.space.coordinates(x));
        let [a, b] = coordinates.each_ref().map(|x| self.emulator.places(x));
        let [mean, to] = coordinates.each_ref().map(|x| DVector::from_vec(self.emulator.mean_scores(x)));
        let (mut shared, mut apart) = (Vec::new(), Vec::new());
        for (process, (a, b)) in self.emulator.processes().iter().zip(a.iter().zip(&b)) {
            let both = process.covariance(a, b);
            let own = [process.covariance(a, a), process.covariance(b, b)];
            shared.push(self.calibration * (0.5 * (own[0] + own[1])).max(0.0));
            apart.push(self.calibration * (own[0] + own[1] - 2.0 * both).max(0.0));
        }
        let importance = self.importance(noise);
        let along = &importance * (to - mean);
        let shared = along.dot(&(self.emulator.score_covariance(&shared) * &along));
        0.5 * (shared + (importance * self.emulator.score_covariance(&apart)).trace())
    }
}

/// A posterior: a likelihood and the prior of its space.
pub struct Posterior<'a>(pub &'a Likelihood<'a>);

/// One over the variance of an even density between 0 and 1.
const OF_AN_EVEN_PRIOR: f64 = 12.0;

impl Density for Posterior<'_> {
    fn ln_prior(&self, x: &[f64]) -> f64 {
        let space = self.0.space;
        if x[space.len()..].iter().all(|x| (0.0..=1.0).contains(x)) {
            space.ln_prior(x)
        } else {
            f64::NEG_INFINITY
        }
    }

    fn ln_likelihood(&self, x: &[f64]) -> f64 {
        self.0.fit(x).ln
    }
}

impl Posterior<'_> {
    /// The curvature of ln of the density in the parameters, lower half: that of [`Likelihood::curvature`], and of the
    /// prior, of whose width the cube is.
    pub fn curvature(&self, x: &[f64]) -> Triangle {
        let mut curvature = self.0.curvature(x);
        (0..curvature.n()).for_each(|i| curvature.row_mut(i)[i] += OF_AN_EVEN_PRIOR);
        curvature
    }
}
