//! y = a x + b, measured and simulated in closed form, in files as the tools read them.

use std::fmt::Write;

use gl_inference::prior::normal_quantile;
use gl_inference::samples::Samples;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::folder::Folder;

/// `params.txt` of a and b.
pub const PARAMS: &str = "name lower upper\na 0.1 1\nb 0.1 10\n";

/// Write `params.txt` and `obs.txt`, at x = 0, 1 … 19, of a and b with normal noise.
pub fn measure(folder: &Folder, (a, b): (f64, f64), noise: f64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut obs = "x y\n".to_owned();
    for x in 0..20 {
        let y = a * f64::from(x) + b + noise * normal_quantile(rng.random());
        let _ = writeln!(obs, "{x} {y}");
    }
    folder.write("params.txt", PARAMS).write("obs.txt", obs);
}

/// One run of a and b at the given x, as the file of a simulation.
pub fn run(x: impl IntoIterator<Item = f64>, a: f64, b: f64) -> String {
    let mut text = "x y\n".to_owned();
    for x in x {
        let _ = writeln!(text, "{x} {}", a * x + b);
    }
    text
}

/// Run every sample of a table: its two files in the folder `runs`.
///
/// # Panics
/// If the table cannot be read.
pub fn simulate(folder: &Folder, samples: &str, runs: &str) {
    for (name, a, b) in samples_of(folder, samples) {
        folder.write(&format!("{runs}/{name}_sim.txt"), run((0..20).map(f64::from), a, b));
        folder.write(&format!("{runs}/{name}_param.txt"), format!("a b\n{a} {b}\n"));
    }
}

/// Write the ensemble of all samples of a table, at the control values of `obs.txt`.
///
/// # Panics
/// If a table cannot be read.
pub fn ensemble(folder: &Folder, samples: &str, obs: &str, ensemble: &str) {
    let control = folder.column(obs, "x");
    let mut text = "sample step x y\n".to_owned();
    for (name, a, b) in samples_of(folder, samples) {
        for (step, x) in control.iter().enumerate() {
            let _ = writeln!(text, "{name} {step} {x} {}", a * x + b);
        }
    }
    folder.write(ensemble, text);
}

/// Name, a and b of each sample.
///
/// # Panics
/// If the table cannot be read.
pub fn samples_of(folder: &Folder, samples: &str) -> Vec<(String, f64, f64)> {
    let samples = Samples::read(&folder.path(samples)).unwrap_or_else(|error| panic!("{error:#}"));
    let columns = samples.columns(&["a".to_owned(), "b".to_owned()]).unwrap_or_default();
    samples.names.into_iter().zip(columns).map(|(name, row)| (name, row[0], row[1])).collect()
}
