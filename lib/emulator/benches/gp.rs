//! The Cholesky factor and the training of an emulator: `cargo bench -p gl-emulator`.

#![allow(clippy::unwrap_used, missing_docs)]

use divan::Bencher;
use gl_emulator::cholesky::{Cholesky, Triangle};
use gl_emulator::{Emulator, Options};
use gl_inference::ensemble::Ensemble;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_table::Table;

fn main() {
    divan::main();
}

/// exp(−|i − j| / n) and a nugget on the diagonal.
#[divan::bench(args = [50, 200, 500])]
fn cholesky(bencher: Bencher<'_, '_>, n: usize) {
    let mut matrix = Triangle::zeros(n);
    for i in 0..n {
        for (j, element) in matrix.row_mut(i).iter_mut().enumerate() {
            *element = (-(i.abs_diff(j) as f64) / n as f64).exp() + if i == j { 1e-3 } else { 0.0 };
        }
    }
    bencher.bench(|| Cholesky::new(&matrix).unwrap());
}

/// Runs of f = a u + b sin u in a lattice of a and b.
#[divan::bench(args = [30, 100], sample_count = 10)]
fn fit(bencher: Bencher<'_, '_>, runs: usize) {
    let (mut samples, mut rows) = ("description a b\n".to_owned(), "sample step u f\n".to_owned());
    for i in 0..runs {
        let a = i as f64 / runs as f64;
        let b = (i as f64 * 0.618_034).fract();
        samples += &format!("s{i} {a} {b}\n");
        for u in 0..20 {
            let u = f64::from(u);
            rows += &format!("s{i} {u} {u} {}\n", a * u + b * u.sin());
        }
    }
    let table = |name: &str, text: &str| Table::parse(name, text.as_bytes().to_vec()).unwrap();
    let prior = Prior::from_table(&table("params.txt", "name lower upper\na 0 1\nb 0 1\n")).unwrap();
    let samples = Samples::from_table(&table("samples.txt", &samples)).unwrap();
    let ensemble = Ensemble::parse("runs.txt", rows.as_bytes(), "u", &["f".to_owned()]).unwrap();
    bencher.bench(|| Emulator::fit(&prior, &samples, &ensemble, &Options::default()).unwrap());
}
