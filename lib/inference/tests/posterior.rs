//! The posterior that a calibration ends with, against the truth it was made from: simulation-based
//! calibration on y = a x + b (Talts et al. 2018, arXiv:1804.06788).

#![allow(clippy::unwrap_used)]

use gl_inference::design::{Effects, draw};
use gl_inference::filter::{NoiseModel, Runs, Target, weigh};
use gl_inference::misfit::{Comparison, Covariance, Scaling};
use gl_inference::mixture::CovarianceType;
use gl_inference::observations::{ByName, Observations, Steps};
use gl_inference::prior::{Parameter, Prior, normal_quantile};
use gl_inference::proposal::{Proposal, ln_balance_heuristic};
use gl_inference::resample::{Resampled, Resampling, Sampling, resample};
use gl_inference::samples::Samples;
use gl_inference::summary::{Marginals, Range};
use gl_inference::weights::Weights;
use gl_numeric::sequence::Method;
use gl_table::Table;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

const STEPS: usize = 20;
const NOISE: f64 = 1.5;

#[derive(Clone, Copy)]
struct Setting {
    iterations: usize,
    samples: usize,
    sampling: Sampling,
    is_noise_known: bool,
}

fn prior() -> Prior {
    let table = "name lower upper\na 0.1 1\nb 0.1 10\n";
    Prior::from_table(&Table::parse("params.txt", table.as_bytes().to_vec()).unwrap()).unwrap()
}

fn line(a: f64, b: f64) -> Vec<f64> {
    (0..STEPS).map(|x| a * x as f64 + b).collect()
}

/// What is measured of a truth.
fn measurement(truth: &[f64], rng: &mut ChaCha8Rng) -> Observations {
    let measured =
        line(truth[0], truth[1]).into_iter().map(|y| y + NOISE * normal_quantile(rng.random())).collect();
    Observations {
        source: "obs".into(),
        control_name: "x".into(),
        control: (0..STEPS).map(|x| x as f64).collect(),
        names: vec!["y".into()],
        values: vec![measured],
        far_off: Vec::new(),
        sd: vec![None],
    }
}

impl Setting {
    fn comparison(self, observations: &Observations) -> Comparison<'_> {
        let covariance = if self.is_noise_known {
            Covariance::of_noise(&[vec![NOISE; STEPS]])
        } else {
            Covariance::scaled(observations, Scaling::Max, &ByName::default()).unwrap()
        };
        Comparison::new(observations, covariance, Steps::ALL).unwrap()
    }

    /// Where to run next, by weights of all samples so far.
    fn next(self, prior: &Prior, samples: &Samples, runs: &Runs, noise: NoiseModel, seed: u64) -> Resampled {
        let effective = f64::max(8.0, 0.3 * self.samples as f64) / samples.len() as f64;
        let tempered = weigh(runs, Target::Ess(effective.min(0.9)), Some(Target::Noise), noise).unwrap();
        let weights = Weights {
            source: "weights".into(),
            samples: samples.names.clone(),
            parameters: prior.names(),
            values: samples.values.clone(),
            misfit: None,
            error: None,
            weight: tempered.weights().unwrap(),
        };
        let how = Resampling {
            count: self.samples,
            components: 3,
            covariance: CovarianceType::Full,
            concentration: None,
            sampling: self.sampling,
            seed,
        };
        resample(&weights, prior, &how).unwrap()
    }
}

/// For each parameter the probability below the truth, and whether the 90 % interval holds it.
fn held(prior: &Prior, truth: &[f64], samples: &Samples, runs: &Runs, noise: NoiseModel) -> Vec<(f64, bool)> {
    let posterior = weigh(runs, Target::Noise, None, noise).unwrap();
    let weights = posterior.weights().unwrap();
    let marginals = Marginals::new(runs, &posterior, 2).unwrap();
    let of = |(j, p): (usize, &Parameter)| {
        let column: Vec<f64> = samples.values.iter().map(|v| v[j]).collect();
        let below = column.iter().zip(&weights).filter(|(x, _)| **x < truth[j]).map(|(_, w)| w).sum();
        let marginal = marginals.of(&column, Range { lower: p.lower, upper: p.upper, scale: p.scale });
        (below, (marginal.q05..=marginal.q95).contains(&truth[j]))
    };
    prior.parameters().iter().enumerate().map(of).collect()
}

/// One calibration of a truth drawn from the prior, as [`held`] says how it ends.
fn replicate(setting: Setting, seed: u64) -> Vec<(f64, bool)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let prior = prior();
    let truth: Vec<f64> = prior.parameters().iter().map(|p| p.quantile(rng.random())).collect();
    let observations = measurement(&truth, &mut rng);
    let comparison = setting.comparison(&observations);
    let mut samples = Samples { parameters: prior.names(), ..Samples::default() };
    let (mut counts, mut proposals): (Vec<usize>, Vec<Option<Proposal>>) = (Vec::new(), Vec::new());
    let mut values = draw(&prior, &Effects::None, Method::Halton, setting.samples, seed, true).unwrap();
    let mut next = None;
    loop {
        let iteration = counts.len();
        counts.push(values.len());
        proposals.push(next.take());
        samples.names.extend((0..values.len()).map(|i| format!("{iteration}_{i}")));
        samples.values.append(&mut values);
        let misfits: Vec<_> =
            samples.values.iter().map(|p| comparison.run(&line(p[0], p[1]), None)).collect();
        let used = vec![true; samples.len()];
        let ln_q = ln_balance_heuristic(&samples, &counts, &proposals, &used).unwrap();
        let totals: Vec<f64> = misfits.iter().map(|m| m.misfit.iter().sum()).collect();
        let best = (0..totals.len()).min_by(|&a, &b| totals[a].total_cmp(&totals[b])).unwrap();
        let runs = Runs::new(totals, ln_q).unwrap();
        let readings = if setting.is_noise_known { 0.0 } else { misfits[best].readings };
        let noise = NoiseModel::new(readings, 2);
        if counts.len() == setting.iterations {
            return held(&prior, &truth, &samples, &runs, noise);
        }
        let resampled = setting.next(&prior, &samples, &runs, noise, seed + counts.len() as u64);
        values = resampled.values;
        next = Some(resampled.proposal);
    }
}

/// Share of the 90 % intervals that hold the truth, and χ² of the ranks in ten equal bins (9 degrees of
/// freedom) for the worse of the two parameters.
fn calibration(setting: Setting, replicates: u64) -> (f64, f64) {
    let outcomes: Vec<Vec<(f64, bool)>> =
        (0..replicates).into_par_iter().map(|seed| replicate(setting, 1000 * seed)).collect();
    let held = outcomes.iter().flatten().filter(|(_, held)| *held).count() as f64;
    let chi_squared = |j: usize| {
        let mut bins = [0.0; 10];
        outcomes.iter().for_each(|outcome| bins[((outcome[j].0 * 10.0) as usize).min(9)] += 1.0);
        let expected = replicates as f64 / 10.0;
        bins.iter().map(|count| (count - expected).powi(2) / expected).sum::<f64>()
    };
    (held / (2 * replicates) as f64, chi_squared(0).max(chi_squared(1)))
}

/// 90 % intervals hold in 87 to 93 % of the replicates, and χ² is below its 99.9 % quantile.
fn assert_calibrated(setting: Setting) {
    let (held, chi_squared) = calibration(setting, 300);
    assert!((0.87..=0.93).contains(&held), "90 % intervals hold in {held}");
    assert!(chi_squared < 27.9, "ranks are not uniform: χ² {chi_squared}");
}

const SLICE: Sampling = Sampling::Slice { deviation: 3.0 };

#[test]
fn one_iteration_is_the_posterior() {
    assert_calibrated(Setting { iterations: 1, samples: 3000, sampling: SLICE, is_noise_known: true });
}

#[test]
fn three_iterations_by_slices_are_the_posterior() {
    assert_calibrated(Setting { iterations: 3, samples: 100, sampling: SLICE, is_noise_known: true });
}

#[test]
fn six_iterations_by_mixtures_are_the_posterior() {
    assert_calibrated(Setting {
        iterations: 6,
        samples: 60,
        sampling: Sampling::Mixture,
        is_noise_known: true,
    });
}

#[test]
fn noise_that_is_estimated_gives_the_posterior_too() {
    assert_calibrated(Setting { iterations: 4, samples: 100, sampling: SLICE, is_noise_known: false });
    assert_calibrated(Setting {
        iterations: 4,
        samples: 100,
        sampling: Sampling::Mixture,
        is_noise_known: false,
    });
}

#[test]
fn intervals_from_few_runs_still_cover() {
    for (iterations, samples) in [(1, 5), (3, 5), (4, 10), (3, 20)] {
        for sampling in [SLICE, Sampling::Mixture] {
            let (held, _) = calibration(Setting { iterations, samples, sampling, is_noise_known: true }, 200);
            assert!(held > 0.83, "{iterations} iterations of {samples}: 90 % intervals hold in {held}");
        }
    }
}
