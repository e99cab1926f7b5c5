use rand::Rng;
use rand::seq::SliceRandom;

use super::*;
use gl_inference::observations::Observations;
use gl_table::Table;

/// A standard normal number.
fn normal(generator: &mut ChaCha8Rng) -> f64 {
    normal_quantile(generator.random_range(1e-12..1.0))
}

const STEPS: usize = 40;

/// Two base parameters, an effect that is off on its lower bound, one that is off outside its bounds.
fn prior() -> Prior {
    let text = "name lower upper scale effect off\n\
                E 1 100 log - -\n\
                nu 0.1 0.4 linear - -\n\
                rolling 0 0.5 linear rolling 0\n\
                cohesion 1 1000 log cohesion 0\n";
    Prior::from_table(&Table::parse("params.txt", text.into()).unwrap()).unwrap()
}

/// Two smooth observables of coordinates; cohesion jumps on by 0.3.
fn curve(z: &[f64], observable: usize, step: usize) -> f64 {
    let t = (step as f64 + 1.0) / STEPS as f64;
    let cohesion = if z[3] < -0.5 { 0.0 } else { 0.3 + 0.5 * z[3] };
    match observable {
        0 => {
            100.0
                * ((2.0 * z[0]).exp() * t
                    + z[1] * t * t
                    + 0.7 * z[2] * (3.0 * t).sin()
                    + cohesion * (1.0 - t))
        }
        _ => 1e-3 * (z[1] * (4.0 * t).cos() - z[0] * z[2] * t + cohesion * t * t),
    }
}

fn without_runs() -> Ensemble {
    let observations = Observations {
        source: "obs.txt".to_owned(),
        control_name: "u".to_owned(),
        control: (0..STEPS).map(|step| step as f64).collect(),
        names: vec!["f".to_owned(), "e".to_owned()],
        values: vec![vec![0.0; STEPS]; 2],
        far_off: Vec::new(),
        sd: vec![None; 2],
    };
    Ensemble::new(&observations, false)
}

/// Runs of that world with a scatter, which is a random slope of each observable.
fn world(runs: usize, scatter: f64, seed: u64) -> (Prior, Samples, Ensemble) {
    let prior = prior();
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut ensemble = without_runs();
    let names = gl_inference::samples::sample_names("test", 0, runs).unwrap();
    let mut values = Vec::new();
    for name in &names {
        let row: Vec<f64> = prior
            .parameters()
            .iter()
            .map(|parameter| {
                let value = parameter.quantile(generator.random());
                parameter.off.filter(|_| generator.random_bool(0.5)).unwrap_or(value)
            })
            .collect();
        let z = coordinates_of(&prior, &row);
        let curves: Vec<Vec<f64>> = [0, 1]
            .map(|j| {
                let size = [100.0, 1e-3][j] * scatter * normal(&mut generator);
                (0..STEPS).map(|t| curve(&z, j, t) + size * (t as f64 + 1.0) / STEPS as f64).collect()
            })
            .to_vec();
        ensemble.push(name, &curves, None);
        values.push(row);
    }
    let samples = Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
    (prior, samples, ensemble)
}

fn fit(runs: usize, scatter: f64, seed: u64) -> Emulator {
    let (prior, samples, ensemble) = world(runs, scatter, seed);
    Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap()
}

/// True curves at coordinates, shape (outputs,).
fn truth(z: &[f64]) -> DVector<f64> {
    DVector::from_fn(2 * STEPS, |o, _| curve(z, o / STEPS, o % STEPS))
}

/// Largest error of predicted curves in ranges of their observables, which are about 800 and 2e-3.
fn error(emulator: &Emulator, z: &[f64]) -> f64 {
    let rest = emulator.predict(z).mean - truth(z);
    (0..2 * STEPS).map(|o| rest[o].abs() / [800.0, 2e-3][o / STEPS]).fold(0.0, f64::max)
}

#[test]
fn a_deterministic_simulator_is_met_between_its_runs() {
    let emulator = fit(120, 0.0, 1);
    for z in [[0.3, 0.5, 0.7, 0.2], [0.9, 0.1, 0.4, 0.8], [0.55, 0.62, 0.0, 0.5]] {
        assert!(error(&emulator, &z) < 1e-3, "{}", error(&emulator, &z));
    }
}

#[test]
fn the_jump_from_off_to_on_is_followed() {
    let emulator = fit(120, 0.0, 2);
    let off = emulator.coordinates(&[10.0, 0.2, 0.0, 0.0]);
    assert_eq!(off[3], -1.0);
    let on = emulator.coordinates(&[10.0, 0.2, 0.0, 1.0]);
    assert!(error(&emulator, &off) < 1e-3 && error(&emulator, &on) < 3e-3);
    assert_eq!(emulator.reach(&off), Reach::Inside);
}

#[test]
fn ninety_percent_intervals_hold_in_about_ninety_percent() {
    let mut covered = [0.0; 2];
    let seeds = 12;
    for seed in 0..seeds {
        for (sum, check) in covered.iter_mut().zip(fit(60, 0.02, seed).check()) {
            *sum += check.coverage90 / seeds as f64;
        }
    }
    assert!(covered.iter().all(|share| (0.86..0.95).contains(share)), "{covered:?}");
}

#[test]
fn intervals_hold_for_runs_that_it_was_not_trained_on() {
    let emulator = fit(80, 0.02, 3);
    let (prior, samples, ensemble) = world(200, 0.02, 4);
    let mut covered = 0.0;
    for (i, values) in samples.values.iter().enumerate() {
        let prediction = emulator.predict(&coordinates_of(&prior, values));
        for o in 0..2 * STEPS {
            let error = ensemble.curve(i, o / STEPS)[o % STEPS] - prediction.mean[o];
            let sd = (prediction.variance[o] + prediction.scatter[o]).sqrt();
            covered += f64::from(u8::from(error.abs() < normal_quantile(0.95) * sd));
        }
    }
    let share = covered / (200 * 2 * STEPS) as f64;
    assert!((0.84..0.96).contains(&share), "{share}");
}

#[test]
fn the_scatter_of_the_simulation_is_recovered() {
    for (seed, scatter) in [(5, 0.02), (6, 0.2)] {
        let emulator = fit(240, scatter, seed);
        for (o, size) in [(STEPS - 1, 100.0), (STEPS / 2, 100.0), (2 * STEPS - 1, 1e-3)] {
            let expected = scatter * size * ((o % STEPS) as f64 + 1.0) / STEPS as f64;
            // 240 runs give a standard deviation to 5 %.
            let ratio = emulator.scatter()[o].sqrt() / expected;
            assert!((ratio - 1.0).abs() < 0.15, "{o}: {ratio}");
        }
    }
    assert!(fit(120, 0.0, 7).scatter().amax().sqrt() < 0.05);
}

#[test]
fn neither_threads_nor_the_order_of_runs_matter() {
    let (prior, samples, ensemble) = world(130, 0.02, 8);
    let z = [0.3, 0.5, 0.7, 0.2];
    let predict = |ensemble: &Ensemble, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Emulator::fit(&prior, &samples, ensemble, &Options::default()).unwrap().predict(&z))
    };
    let expected = predict(&ensemble, 1);
    assert_eq!(predict(&ensemble, 3), expected);

    let mut order: Vec<usize> = (0..ensemble.len()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
    let mut shuffled = without_runs();
    for run in order {
        let curves = [0, 1].map(|j| ensemble.curve(run, j).to_vec());
        shuffled.push(&ensemble.samples[run], &curves, None);
    }
    assert_eq!(predict(&shuffled, 2), expected);
}

#[test]
fn derivatives_of_the_scores_are_their_difference_quotients() {
    let emulator = fit(60, 0.02, 9);
    let z = vec![0.3, 0.5, 0.7, 0.2];
    let (mean, gradients) = emulator.score_gradients(&z);
    assert_eq!(mean, emulator.mean_scores(&z));
    assert_eq!(mean, emulator.predict_scores(&z).0);
    for j in 0..4 {
        let shifted = |step: f64| {
            let mut z = z.clone();
            z[j] += step;
            emulator.mean_scores(&z)
        };
        let (after, before) = (shifted(1e-5), shifted(-1e-5));
        for c in 0..mean.len() {
            let expected = (after[c] - before[c]) / 2e-5;
            // The quotient is rounded at about 1e-11 / 1e-5.
            let error = (gradients[c][j] - expected).abs();
            assert!(error < 2e-6 * expected.abs().max(1.0), "{} {expected}", gradients[c][j]);
        }
    }
}

#[test]
fn an_input_that_does_nothing_gets_a_long_length() {
    let mut generator = ChaCha8Rng::seed_from_u64(10);
    let rows: Vec<Vec<f64>> = (0..80).map(|_| (0..6).map(|_| generator.random()).collect()).collect();
    let y: Vec<f64> =
        rows.iter().map(|x| (6.0 * x[0]).sin() + (4.0 * x[1]).cos() + 0.1 * normal(&mut generator)).collect();
    let points = Points::new(&rows, Mean::Constant).unwrap();
    let search =
        Search { mean: Mean::Constant, starts: 4, short_length: SHORT_LENGTH, may_be_scatter: false };
    let gp = train(&rows, &points, &y, search, None, &mut generator).unwrap();
    let hyper = gp.hyperparameters();
    assert!(hyper.lengths[..2].iter().all(|&length| length < 2.0), "{hyper:?}");
    assert!(hyper.lengths[2..].iter().all(|&length| length > 4.0), "{hyper:?}");
    assert!((gp.nugget().sqrt() / 0.1 - 1.0).abs() < 0.25, "{}", gp.nugget().sqrt());
    // What was found is where a search goes on, and without another start it is taken as it is.
    let found = gp.hyperparameters();
    let known = Search { starts: 0, ..search };
    let kept = train(&rows, &points, &y, known, Some(&found), &mut generator).unwrap().hyperparameters();
    assert_eq!((&kept.lengths, kept.nugget_ratio), (&found.lengths, found.nugget_ratio));
}

#[test]
fn what_is_left_over_is_below_the_noise() {
    let (prior, samples, ensemble) = world(80, 0.02, 11);
    let noise = vec![vec![1.0; STEPS], vec![1e-6; STEPS]];
    let options = Options { noise: Some(noise.clone()), ..Options::default() };
    let emulator = Emulator::fit(&prior, &samples, &ensemble, &options).unwrap();
    let shares = (0..2 * STEPS).map(|o| emulator.leftover()[o] / noise[o / STEPS][0].powi(2));
    assert!(shares.sum::<f64>() / (2.0 * STEPS as f64) <= 0.01);
    let loud = Options { noise: Some(vec![vec![1e3; STEPS], vec![1.0; STEPS]]), ..Options::default() };
    let few = Emulator::fit(&prior, &samples, &ensemble, &loud).unwrap();
    assert!(few.basis().ncols() < emulator.basis().ncols());
}

#[test]
fn a_constant_observable_is_predicted_as_it_is() {
    let (prior, samples, ensemble) = world(40, 0.0, 12);
    let runs: Vec<_> = (0..40).map(|run| vec![ensemble.curve(run, 0).to_vec(), vec![0.7; STEPS]]).collect();
    let mut ensemble = without_runs();
    for (name, curves) in samples.names.iter().zip(&runs) {
        ensemble.push(name, curves, None);
    }
    let emulator = Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap();
    let check = &emulator.check()[1];
    assert!(check.rmse < 1e-12 && check.rmse_range == 0.0 && check.scatter_sd < 1e-9, "{check:?}");
    assert_eq!(check.coverage90, 1.0);
    assert!((emulator.predict(&[0.5; 4]).mean[STEPS + 3] - 0.7).abs() < 1e-12);

    // Nothing varies at all.
    let mut ensemble = without_runs();
    for name in &samples.names {
        ensemble.push(name, &[vec![0.2; STEPS], vec![0.7; STEPS]], None);
    }
    let emulator = Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap();
    let prediction = emulator.predict(&[0.5; 4]);
    assert!((prediction.mean[0] - 0.2).abs() < 1e-12 && prediction.variance[0] < 1e-24);
}

#[test]
fn what_was_never_varied_is_unknown_elsewhere() {
    let (prior, mut samples, ensemble) = world(60, 0.02, 13);
    for row in &mut samples.values {
        row[1] = 0.2;
        row[3] = 0.0;
    }
    let emulator = Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap();
    let reach = |values: [f64; 4]| emulator.reach(&emulator.coordinates(&values));
    assert_eq!(reach([10.0, 0.2, 0.1, 0.0]), Reach::Inside);
    assert_eq!(reach([10.0, 0.3, 0.1, 0.0]), Reach::Unknown(1));
    assert_eq!(reach([10.0, 0.2, 0.1, 5.0]), Reach::Unknown(3));
    assert_eq!(reach([1e4, 0.2, 0.1, 0.0]), Reach::Outside(0));
    assert_eq!(emulator.score_gradients(&emulator.coordinates(&[10.0, 0.2, 0.1, 0.0])).1[0][1], 0.0);
}

#[test]
fn failed_runs_are_left_out_and_too_few_are_an_error() {
    let (prior, samples, ensemble) = world(40, 0.02, 14);
    let some = |count: usize| {
        let mut some = without_runs();
        for run in 0..count {
            some.push(&ensemble.samples[run], &[0, 1].map(|j| ensemble.curve(run, j).to_vec()), None);
        }
        Emulator::fit(&prior, &samples, &some, &Options::default())
    };
    assert_eq!(some(33).unwrap().missing(), 7);
    assert_eq!(some(33).unwrap().runs().len(), 33);
    for count in [0, 1, 2, 6] {
        let error = some(count).unwrap_err().to_string();
        assert!(error.contains("runs"), "{error}");
    }
    // Just enough: one more than the five inputs (a switch among them) and the constant.
    some(7).unwrap();

    let mut other = samples.clone();
    other.names[3] = "other".to_owned();
    let error = Emulator::fit(&prior, &other, &ensemble, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("is not in samples.txt"), "{error}");
}
