//! The simulation's own scatter: what runs differ by that their parameters do not explain.

use nalgebra::{DMatrix, DVector};

use super::hat::Hat;
use super::residual::systematic;
use gl_inference::ensemble::Ensemble;
use gl_inference::weights::Weights;
use gl_numeric::statistics::effective_size;

/// How many runs stand for the posterior, repeated as their weights say.
const RUNS: usize = 300;

/// What the runs that carry a posterior say of themselves.
#[derive(Clone, Debug, Default)]
pub(super) struct Scatter {
    /// What a linear regression on the parameters leaves of each run, shape (runs, observables, steps),
    /// scaled up for the degrees of freedom that it took.
    pub runs: Vec<Vec<Vec<f64>>>,
    /// What calibrating the parameters takes out of the noise.
    pub hat: Hat,
}

/// The scatter of runs weighed by a posterior, and what their calibration absorbed.
///
/// * `of_runs` — weights of the runs, shape (runs,), summing to one.
/// * `noise_sd` — shape (observables, steps), all above zero.
///
/// Both are nothing where fewer than two runs a parameter (and two more) are effective, since the
/// regression would then explain everything. Where no parameter is known to vary, calibration has
/// absorbed nothing.
pub(super) fn scatter(
    ensemble: &Ensemble,
    weights: &Weights,
    of_runs: &[f64],
    noise_sd: &[Vec<f64>],
) -> Scatter {
    let (observables, steps) = (ensemble.observables.len(), ensemble.steps());
    let effective = effective_size(of_runs);
    let taken = (weights.varying() + 1) as f64;
    if effective < 2.0 * taken {
        return Scatter::default();
    }
    let runs = systematic(of_runs, RUNS);
    let rows = weights.index();
    let values: Vec<&[f64]> =
        runs.iter().map(|&run| weights.values[rows[ensemble.samples[run].as_str()]].as_slice()).collect();
    let basis = basis(&values);
    let curves = DMatrix::from_fn(runs.len(), observables * steps, |row, i| {
        ensemble.curve(runs[row], i / steps)[i % steps]
    });
    let loadings = basis.tr_mul(&curves);
    let left = (&curves - &basis * &loadings) * (effective / (effective - taken)).sqrt();

    // The constant, which comes first, is no parameter.
    let mut spread = loadings.rows(1, loadings.nrows() - 1) / (RUNS as f64).sqrt();
    for (mut column, noise) in spread.column_iter_mut().zip(noise_sd.iter().flatten()) {
        column /= *noise;
    }
    let run = |row: usize| {
        (0..observables).map(|j| (0..steps).map(|step| left[(row, j * steps + step)]).collect()).collect()
    };
    Scatter { runs: (0..runs.len()).map(run).collect(), hat: Hat::new(&spread) }
}

/// An orthonormal basis of what a constant and the parameters explain, one row a run.
fn basis(values: &[&[f64]]) -> DMatrix<f64> {
    let mut basis = vec![DVector::from_element(values.len(), 1.0).normalize()];
    for j in 0..values[0].len() {
        let mut column = DVector::from_iterator(values.len(), values.iter().map(|row| row[j]));
        let size = column.norm();
        // Twice, since once leaves rounding errors.
        for _ in 0..2 {
            for known in &basis {
                column -= known * known.dot(&column);
            }
        }
        if column.norm() > 1e-9 * size {
            basis.push(column.normalize());
        }
    }
    DMatrix::from_columns(&basis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{Noise, standard_normal};
    use gl_inference::observations::Observations;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Runs q = a + scatter of standard deviation 0.3, at two steps.
    fn example(runs: usize) -> (Ensemble, Weights) {
        let observations = Observations {
            source: "obs".to_owned(),
            control_name: "e".to_owned(),
            control: vec![0.0, 1.0],
            names: vec!["q".to_owned()],
            values: vec![vec![0.0; 2]],
            far_off: Vec::new(),
            sd: vec![None],
        };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut ensemble = Ensemble::new(&observations, false);
        let values: Vec<Vec<f64>> = (0..runs).map(|_| vec![rng.random::<f64>(), 7.0]).collect();
        for (run, value) in values.iter().enumerate() {
            let scattered = (0..2).map(|_| value[0] + 0.3 * standard_normal(&mut rng)).collect();
            ensemble.push(&run.to_string(), &[scattered], None);
        }
        let weights = Weights {
            source: "weights".to_owned(),
            samples: ensemble.samples.clone(),
            parameters: vec!["a".to_owned(), "fixed".to_owned()],
            values,
            misfit: None,
            error: None,
            weight: vec![1.0 / runs as f64; runs],
        };
        (ensemble, weights)
    }

    #[test]
    fn parameters_explain_what_they_can_and_scatter_is_the_rest() {
        let (ensemble, weights) = example(2000);
        let scatter = scatter(&ensemble, &weights, &weights.weight, &[vec![1e-3; 2]]);
        let variance = scatter.runs.iter().flatten().flatten().map(|s| s * s).sum::<f64>() / 600.0;
        assert!((variance.sqrt() - 0.3).abs() < 0.02, "{variance}");
        // One parameter takes one degree of freedom out of two readings.
        let left = scatter.hat.left(&[Noise { sd: vec![1e-3; 2], phi: 0.0 }]).concat();
        assert!((left.iter().sum::<f64>() / 1e-6 - 1.0).abs() < 1e-9, "{left:?}");
    }

    #[test]
    fn too_few_runs_say_nothing_of_scatter() {
        let (ensemble, weights) = example(3);
        assert!(scatter(&ensemble, &weights, &weights.weight, &[vec![1.0; 2]]).runs.is_empty());
    }
}
