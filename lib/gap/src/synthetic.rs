//! Calibrations with a known answer, for tests.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::noise::{Noise, standard_normal};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;

/// The model a + b x + c x² of two observables on x in [0, 1], calibrated against a measurement.
pub struct Case {
    pub observations: Observations,
    pub ensemble: Ensemble,
    pub weights: Vec<f64>,
    pub noise_sd: Vec<Vec<f64>>,
    /// Parameters, one row a run.
    pub values: Vec<Vec<f64>>,
}

pub const TRUTH: [f64; 3] = [1.0, 10.0, 4.0];
pub const PARAMETERS: usize = 3;

pub fn model(theta: &[f64], steps: usize) -> Vec<Vec<f64>> {
    let x = |step: usize| step as f64 / (steps - 1).max(1) as f64;
    let curve =
        |sign: f64| (0..steps).map(|t| theta[0] + sign * theta[1] * x(t) + theta[2] * x(t) * x(t)).collect();
    vec![curve(1.0), curve(-0.5)]
}

/// `gap` is added to the model, noise of unit variance to that; `runs` runs over a prior `width` wide
/// around the truth are weighed by their likelihood under white noise.
pub fn case(seed: u64, gap: &[Vec<f64>], phi: f64, runs: usize, width: f64) -> Case {
    build(seed, gap, 1.0, phi, runs, width)
}

/// The same without noise, though the likelihood believes in it.
pub fn noiseless_case(seed: u64, gap: &[Vec<f64>], runs: usize, width: f64) -> Case {
    build(seed, gap, 0.0, 0.0, runs, width)
}

fn build(seed: u64, gap: &[Vec<f64>], size: f64, phi: f64, runs: usize, width: f64) -> Case {
    let steps = gap[0].len();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let noise = Noise { sd: vec![size; steps], phi };
    let mut values = model(&TRUTH, steps);
    for (values, gap) in values.iter_mut().zip(gap) {
        let draw = noise.draw(&mut rng);
        values.iter_mut().zip(gap).zip(draw).for_each(|((y, gap), noise)| *y += gap + noise);
    }
    let observations = Observations {
        source: "obs".to_owned(),
        control_name: "x".to_owned(),
        control: (0..steps).map(|step| step as f64).collect(),
        names: vec!["q".to_owned(), "n".to_owned()],
        values,
        far_off: Vec::new(),
        sd: vec![None, None],
    };
    let mut ensemble = Ensemble::new(&observations, false);
    let (mut ln_weights, mut parameters) = (Vec::new(), Vec::new());
    for run in 0..runs {
        let theta: Vec<f64> = TRUTH.iter().map(|t| t + width * (rng.random::<f64>() - 0.5)).collect();
        let curves = model(&theta, steps);
        let misfit: f64 = observations
            .values
            .iter()
            .flatten()
            .zip(curves.iter().flatten())
            .map(|(y, f)| (y - f).powi(2))
            .sum();
        ln_weights.push(-0.5 * misfit);
        ensemble.push(&run.to_string(), &curves, None);
        parameters.push(theta);
    }
    let weights = gl_numeric::statistics::normalised(&ln_weights).unwrap();
    let noise_sd = vec![vec![1.0; steps]; 2];
    Case { observations, ensemble, weights, noise_sd, values: parameters }
}

/// A calibration of Σ θₖ patternₖ to values of two observables with white noise of unit variance: runs drawn from its
/// very posterior, under a prior that is flat.
///
/// * `patterns` — each of shape (observables, steps).
pub fn linear(observed: &[Vec<f64>], patterns: &[Vec<Vec<f64>>], runs: usize, seed: u64) -> Drawn {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let seen = DVector::from_vec(observed.concat());
    let design = DMatrix::from_fn(seen.len(), patterns.len(), |i, k| {
        patterns[k][i / observed[0].len()][i % observed[0].len()]
    });
    let factor = Cholesky::new(design.tr_mul(&design)).unwrap();
    let best = factor.solve(&design.tr_mul(&seen));
    let draw = |_| {
        let unit = DVector::from_fn(patterns.len(), |_, _| standard_normal(&mut rng));
        let theta = &best + factor.l().tr_solve_lower_triangular(&unit).unwrap();
        let curve = &design * &theta;
        let curves = curve.as_slice().chunks(observed[0].len()).map(<[f64]>::to_vec).collect();
        (theta.as_slice().to_vec(), curves)
    };
    let (values, curves) = (0..runs).map(draw).unzip();
    Drawn { best: (&design * best).as_slice().to_vec(), values, curves }
}

/// Runs from a posterior.
pub struct Drawn {
    /// The best fit, shape (observables · steps).
    pub best: Vec<f64>,
    /// Parameters, one row a run.
    pub values: Vec<Vec<f64>>,
    /// Shape (runs, observables, steps).
    pub curves: Vec<Vec<Vec<f64>>>,
}
