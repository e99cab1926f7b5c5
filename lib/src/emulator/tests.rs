use rand::Rng;
use rand_distr_free::normal;

use super::*;
use crate::observations::Observations;
use crate::table::Table;

mod rand_distr_free {
    use rand::Rng;

    /// A standard normal number by inversion.
    pub fn normal(generator: &mut impl Rng) -> f64 {
        crate::prior::normal_quantile(generator.random_range(1e-12..1.0))
    }
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
        0 => 100.0 * ((2.0 * z[0]).exp() * t + z[1] * t * t + 0.7 * z[2] * (3.0 * t).sin() + cohesion * (1.0 - t)),
        _ => 1e-3 * (z[1] * (4.0 * t).cos() - z[0] * z[2] * t + cohesion * t * t),
    }
}

/// Runs of that world with a scatter, which is a random slope of each observable.
fn world(runs: usize, scatter: f64, seed: u64) -> (Prior, Samples, Ensemble) {
    let prior = prior();
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let observations = Observations {
        source: "obs.txt".to_owned(),
        control_name: "u".to_owned(),
        control: (0..STEPS).map(|step| step as f64).collect(),
        names: vec!["f".to_owned(), "e".to_owned()],
        values: vec![vec![0.0; STEPS]; 2],
        sd: vec![None; 2],
    };
    let mut ensemble = Ensemble::new(&observations, false);
    let names = crate::samples::sample_names("test", 0, runs).unwrap();
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
    let samples =
        Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
    (prior, samples, ensemble)
}

#[test]
fn speed() {
    for (n, scatter) in [(240, 0.02), (240, 0.0), (60, 0.02), (1000, 0.02)] {
        let (prior, samples, ensemble) = world(n, scatter, 1);
        let start = std::time::Instant::now();
        let emulator = Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap();
        println!("{n} {scatter}: {:?} k {}", start.elapsed(), emulator.basis().ncols());
        for gp in emulator.processes() {
            println!("{:?}", gp.hyperparameters());
        }
        println!("{:#?}", emulator.check());
        let z = vec![0.3, 0.4, 0.5, 0.6];
        let start = std::time::Instant::now();
        for _ in 0..1000 {
            std::hint::black_box(emulator.mean_scores(&z));
        }
        println!("mean {:?}", start.elapsed() / 1000);
        let start = std::time::Instant::now();
        for _ in 0..1000 {
            std::hint::black_box(emulator.predict_scores(&z));
        }
        println!("var {:?}", start.elapsed() / 1000);
        let start = std::time::Instant::now();
        for _ in 0..1000 {
            std::hint::black_box(emulator.score_gradients(&z));
        }
        println!("grad {:?}", start.elapsed() / 1000);
    }
}
