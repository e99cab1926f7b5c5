//! Run-to-run scatter: every run, and the measurement, is of another specimen.

use gl_gap::attribute::evidence::mode::standard_normal;
use gl_inference::path::Path;
use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;

/// Root mean square of what one specimen differs by from the mean one, as a share of the range.
pub const SCATTER: f64 = 0.015;

/// Smooth patterns: the first of a random walk that starts at no difference.
const PATTERNS: usize = 4;
/// Correlation of what one specimen differs by in two observables.
const SHARED: f64 = 0.36;

/// A factor of the covariance of the scatter of one observable in shares of its range, shape (steps,
/// patterns).
pub fn factor(control: &[f64]) -> DMatrix<f64> {
    let places = Path::new(control).travelled().to_vec();
    let pattern = |k: usize| std::f64::consts::PI * (k as f64 + 0.5);
    let factor = DMatrix::from_fn(places.len(), PATTERNS, |t, k| (pattern(k) * places[t]).sin() / pattern(k));
    let rms = (factor.norm_squared() / places.len() as f64).sqrt();
    factor * (SCATTER / rms)
}

/// The curves of another specimen, shape (observables, steps).
pub fn scattered(curves: &[Vec<f64>], factor: &DMatrix<f64>, random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let shared: Vec<f64> = (0..PATTERNS).map(|_| standard_normal(random)).collect();
    let scattered = curves.iter().map(|curve| {
        let range = gl_inference::observations::range(curve);
        let along: Vec<f64> = shared
            .iter()
            .map(|shared| SHARED.sqrt() * shared + (1.0 - SHARED).sqrt() * standard_normal(random))
            .collect();
        let differs = |t: usize| (0..PATTERNS).map(|k| factor[(t, k)] * along[k]).sum::<f64>();
        curve.iter().enumerate().map(|(t, y)| y + range * differs(t)).collect()
    });
    scattered.collect()
}
