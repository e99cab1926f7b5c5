//! The mixture against scikit-learn's `BayesianGaussianMixture`; the fixtures and the script that made
//! them are in `tests/oracle`.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use gl_inference::mixture::{CovarianceType, Mixture, Options, WeightPrior, fit_from};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap().iter().map(numbers).collect()
}

fn assert_close(here: &[f64], there: &[f64], tolerance: f64, what: &str) {
    assert_eq!(here.len(), there.len(), "{what}");
    let size = there.iter().fold(0.0, |size: f64, x| size.max(x.abs()));
    for (a, b) in here.iter().zip(there) {
        assert!((a - b).abs() <= tolerance * size.max(1e-300), "{what}: {a} is not {b}");
    }
}

/// Covariances in the shape that scikit-learn gives them for the covariance type.
fn covariances(mixture: &Mixture, kind: CovarianceType) -> Vec<f64> {
    let all = &mixture.covariances;
    match kind {
        CovarianceType::Full => all.iter().flat_map(|c| c.iter().copied()).collect(),
        CovarianceType::Tied => all[0].iter().copied().collect(),
        CovarianceType::Diagonal => {
            all.iter().flat_map(|c| c.diagonal().iter().copied().collect::<Vec<_>>()).collect()
        }
        CovarianceType::Spherical => all.iter().map(|c| c[(0, 0)]).collect(),
    }
}

fn agrees(file: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/oracle").join(file);
    let oracle: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let (samples, responsibilities) = (rows(&oracle["x"]), rows(&oracle["resp"]));
    let counts = oracle.get("count").map_or(vec![1.0; samples.len()], numbers);
    let total: f64 = counts.iter().sum();
    if total != samples.len() as f64 {
        return;
    }
    let weights: Vec<f64> = counts.iter().map(|count| count / total).collect();
    for fit in oracle["fits"].as_array().unwrap() {
        let kind = match fit["covariance_type"].as_str().unwrap() {
            "full" => CovarianceType::Full,
            "tied" => CovarianceType::Tied,
            "diag" => CovarianceType::Diagonal,
            _ => CovarianceType::Spherical,
        };
        let is_dirichlet = fit["weight_concentration_prior_type"] == "dirichlet_distribution";
        let options = Options {
            weight_prior: if is_dirichlet { WeightPrior::Dirichlet } else { WeightPrior::DirichletProcess },
            tolerance: 0.0,
            max_iterations: fit["n_iter"].as_u64().unwrap() as usize,
            ..Options::new(numbers(&fit["weights"]).len(), kind)
        };
        let mixture = fit_from(&samples, &weights, &responsibilities, &options).unwrap();
        let what = format!("{file} {kind:?} dirichlet {is_dirichlet} after {}", options.max_iterations);
        let means: Vec<f64> = mixture.means.concat();
        assert_close(&mixture.weights, &numbers(&fit["weights"]), 1e-9, &format!("{what}: weights"));
        assert_close(&means, &numbers(&fit["means"]), 1e-9, &format!("{what}: means"));
        assert_close(
            &covariances(&mixture, kind),
            &numbers(&fit["covariances"]),
            1e-9,
            &format!("{what}: covariances"),
        );
        assert_close(
            &[mixture.lower_bound],
            &numbers(&fit["lower_bound"]),
            1e-9,
            &format!("{what}: lower bound"),
        );
    }
}

#[test]
fn one_dimension_agrees_with_scikit_learn() {
    agrees("bayesian_mixture_1d.json");
}

#[test]
fn two_dimensions_agree_with_scikit_learn() {
    agrees("bayesian_mixture_2d.json");
}

#[test]
fn four_dimensions_agree_with_scikit_learn() {
    agrees("bayesian_mixture_4d.json");
}

#[test]
fn weighted_samples_agree_with_scikit_learn_on_repeated_ones() {
    agrees("bayesian_mixture_weighted.json");
}
