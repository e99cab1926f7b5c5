//! Memory of collecting runs does not grow with their number.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used)]

use std::fs::{self, File};
use std::io::{BufWriter, Write};

use gl_inference::collect::Collection;
use gl_inference::observations::Observations;
use gl_inference::rig::Rig;
use gl_inference::samples::Samples;
use gl_table::Table;

const STEPS: usize = 100;
const RUNS: usize = 50_000;

/// The most memory that this process has had, in MB.
fn peak_memory() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1024.0
}

/// Their curves alone would take 80 MB.
#[test]
fn fifty_thousand_packed_runs_are_collected_in_less_than_60_megabytes() {
    let folder = tempfile::tempdir().unwrap();
    let mut packed = BufWriter::new(File::create(folder.path().join("all_packed.txt")).unwrap());
    let mut samples =
        Samples { source: "samples.txt".to_owned(), parameters: vec!["a".to_owned()], ..Samples::default() };
    let curve: String = (0..STEPS).map(|step| format!("{step} 0.5 -1e-3\n")).collect();
    for i in 0..RUNS {
        let name = format!("run{i}");
        let parameters = format!("a\n{i}\n");
        let simulation = format!("e q p\n{curve}");
        for (ending, text) in [("param", parameters), ("sim", simulation)] {
            writeln!(packed, "# file {name}_{ending}.txt {}\n{text}", text.len()).unwrap();
        }
        samples.names.push(name);
        samples.values.push(vec![i as f64]);
    }
    packed.into_inner().unwrap();
    let rows: String = (0..STEPS).map(|step| format!("{step} 1 2\n")).collect();
    let table = Table::parse("obs.txt", format!("e q p\n{rows}").into_bytes()).unwrap();
    let observables = ["q".to_owned(), "p".to_owned()];
    let observations = Observations::from_table(&table, "e", &observables).unwrap();
    let collection = Collection {
        observations: &observations,
        control: "e".to_owned(),
        observables: observables.to_vec(),
        folders: vec![folder.path().to_owned()],
        rtol: 1e-5,
        end_tolerance: 0.01,
        rig: Rig::default().at(&observations).unwrap(),
    };
    let mut good = 0;
    let status = collection
        .collect(&samples, |runs| {
            assert_eq!(runs.curve(0, 1), [-1e-3; STEPS]);
            good += runs.len();
            Ok(())
        })
        .unwrap();
    assert!(good == RUNS && status.iter().all(Result::is_ok));
    let peak = peak_memory();
    assert!(peak < 60.0, "{peak} MB");
}
