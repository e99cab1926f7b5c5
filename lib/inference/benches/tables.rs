//! Reading an ensemble, and what gl-likelihood makes of it: `cargo bench -p gl-inference`.

#![allow(clippy::unwrap_used, missing_docs)]

use std::io;

use divan::Bencher;
use divan::counter::BytesCount;
use gl_inference::ensemble::Ensemble;
use gl_inference::misfit::{Comparison, Covariance, MisfitRows, Scaling};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_table::Table;

const RUNS: usize = 2000;
const STEPS: usize = 100;

fn main() {
    divan::main();
}

/// An ensemble of curves u / (1 + i), with this between its fields.
fn ensemble(separator: &str) -> Vec<u8> {
    let mut text = ["sample", "step", "u", "f"].join(separator) + "\n";
    for i in 0..RUNS {
        for step in 0..STEPS {
            let value = step as f64 / (1.0 + i as f64);
            let fields = [format!("Sample{i:05}"), step.to_string(), step.to_string(), value.to_string()];
            text += &(fields.join(separator) + "\n");
        }
    }
    text.into_bytes()
}

fn observations() -> Observations {
    let rows: String = (0..STEPS).map(|u| format!("{u} {}\n", 0.1 * u as f64)).collect();
    let table = Table::parse("obs.txt", format!("u f\n{rows}").into_bytes()).unwrap();
    Observations::from_table(&table, "u", &["f".to_owned()]).unwrap()
}

/// As it is written here, and as others write it.
#[divan::bench(args = ["\t", " "])]
fn read_ensemble(bencher: Bencher<'_, '_>, separator: &str) {
    let text = ensemble(separator);
    bencher
        .counter(BytesCount::new(text.len()))
        .bench(|| Ensemble::parse("runs.txt", &text, "u", &["f".to_owned()]).unwrap());
}

#[divan::bench]
fn misfit(bencher: Bencher<'_, '_>) {
    let (text, observations) = (ensemble("\t"), observations());
    let covariance = Covariance::scaled(&observations, Scaling::Max, &ByName::default()).unwrap();
    let comparison = Comparison::new(&observations, covariance, Steps::ALL).unwrap();
    bencher
        .counter(BytesCount::new(text.len()))
        .bench(|| comparison.stream("runs.txt", &mut &text[..], &mut io::sink(), MisfitRows::Steps).unwrap());
}
