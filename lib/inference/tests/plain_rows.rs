//! Tables as the tools write them are read without splitting their rows into fields; the same tables
//! with blanks around the fields are not. Both must say the same.

#![allow(clippy::unwrap_used)]

use std::fs;

use gl_inference::ensemble::Ensemble;
use gl_inference::misfit::{Comparison, Covariance, MisfitRows, Misfits, Scaling};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_table::{Table, push_number};
use proptest::prelude::*;

const STEPS: usize = 4;

fn observations() -> Observations {
    let table = b"e q p\n0 1 2\n0.1 3 4\n0.2 5 6\n1e-7 7 8\n".to_vec();
    let names = ["q".to_owned(), "p".to_owned()];
    Observations::from_table(&Table::parse("obs.txt", table).unwrap(), "e", &names).unwrap()
}

/// An ensemble table of runs of four steps, with standard deviations if `with_sd`.
fn ensemble(values: &[f64], with_sd: bool) -> String {
    let mut text = b"sample\tstep\te\tq\tp".to_vec();
    text.extend_from_slice(if with_sd { b"\tq_sd\tp_sd\n" } else { b"\n" });
    for (row, values) in values.chunks_exact(4).enumerate() {
        let step = row % STEPS;
        text.extend_from_slice(format!("run{}\t{step}", row / STEPS).as_bytes());
        let control = observations().control[step];
        let sd = [values[2].abs(), values[3].abs()];
        for value in [control, values[0], values[1]].into_iter().chain(sd.into_iter().filter(|_| with_sd)) {
            text.push(b'\t');
            push_number(&mut text, value);
        }
        text.push(b'\n');
    }
    String::from_utf8(text).unwrap()
}

/// The same table with a blank before every tab, which no tool writes.
fn padded(table: &str) -> String {
    table.replace('\t', " \t")
}

fn misfits(table: &str) -> Result<String, String> {
    let observations = observations();
    let covariance = Covariance::scaled(&observations, Scaling::Max, &ByName::default()).unwrap();
    let comparison = Comparison::new(&observations, covariance, Steps::ALL).unwrap();
    let mut output = Vec::new();
    let result = comparison.stream("runs.txt", &mut table.as_bytes(), &mut output, MisfitRows::Steps);
    result.map(|_| String::from_utf8(output).unwrap()).map_err(|error| format!("{error:#}"))
}

fn parsed(table: &str) -> Result<Ensemble, String> {
    Ensemble::parse("runs.txt", table.as_bytes(), "e", &observations().names)
        .map_err(|error| format!("{error:#}"))
}

fn filtered(table: &str) -> Result<Misfits, String> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("misfits.txt");
    fs::write(&path, table).unwrap();
    let strip = |text: String| text.replace(&path.display().to_string(), "misfits.txt");
    let mut misfits =
        Misfits::read(std::slice::from_ref(&path), true).map_err(|error| strip(format!("{error:#}")))?;
    misfits.source.clear();
    Ok(misfits)
}

fn rows(runs: std::ops::Range<usize>) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(prop::num::f64::NORMAL.prop_map(|x| x % 1e6), runs)
        .prop_map(|values| values[..values.len() / (4 * STEPS) * 4 * STEPS].to_vec())
}

proptest! {
    #[test]
    fn a_table_says_the_same_with_blanks_in_it(values in rows(0..160), with_sd in any::<bool>()) {
        let table = ensemble(&values, with_sd);
        prop_assert_eq!(parsed(&table), parsed(&padded(&table)));
        let plain = misfits(&table).unwrap();
        prop_assert_eq!(&plain, &misfits(&padded(&table)).unwrap());
        prop_assert_eq!(filtered(&plain), filtered(&padded(&plain)));
    }

    #[test]
    fn a_flaw_is_found_alike(values in rows(64..160), at in any::<prop::sample::Index>(), flaw in 0..7_usize) {
        let flaw = ["NaN", "x", "\t", "\n", "", "-1", "\n#\n\n"][flaw];
        let table = ensemble(&values, true);
        let body = table.find('\n').unwrap() + 1;
        let place = body + at.index(table.len() - body);
        let spoilt = format!("{}{flaw}{}", &table[..place], &table[place + 1..]);
        // A tab or a line end may have gone, and with it the blank before it.
        let wide = padded(&spoilt);
        prop_assert_eq!(parsed(&spoilt), parsed(&wide));
        prop_assert_eq!(misfits(&spoilt), misfits(&wide));
        let plain = misfits(&table).unwrap();
        let body = plain.find('\n').unwrap() + 1;
        let place = body + at.index(plain.len() - body);
        let spoilt = format!("{}{flaw}{}", &plain[..place], &plain[place + 1..]);
        prop_assert_eq!(filtered(&spoilt), filtered(&padded(&spoilt)));
    }
}
