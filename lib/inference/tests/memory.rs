//! Memory of a stream does not grow with its length.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used)]

use std::fs;
use std::io::{self, Read, Write};

use gl_inference::misfit::{Comparison, Covariance, MisfitRows, Scaling};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_table::Table;

const STEPS: usize = 100;
const RUNS: usize = 100_000;

/// An ensemble table that is made while it is read.
struct Runs {
    next: usize,
    text: Vec<u8>,
    used: usize,
}

impl Read for Runs {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.used == self.text.len() && self.next < RUNS {
            self.text.clear();
            self.used = 0;
            for step in 0..STEPS {
                let value = 1.0 / (1.0 + self.next as f64 + step as f64);
                writeln!(self.text, "Sample{:06}\t{step}\t{step}\t{value}", self.next)?;
            }
            self.next += 1;
        }
        let read = (&self.text[self.used..]).read(buffer)?;
        self.used += read;
        Ok(read)
    }
}

/// Counts lines.
struct Lines(usize);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += memchr::memchr_iter(b'\n', bytes).count();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The most memory that this process has had, in MB.
fn peak_memory() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1024.0
}

#[test]
fn ten_million_rows_of_misfits_take_less_than_100_megabytes() {
    let rows: String = (0..STEPS).map(|step| format!("{step} 1\n")).collect();
    let table = Table::parse("obs.txt", format!("e q\n{rows}").into_bytes()).unwrap();
    let observations = Observations::from_table(&table, "e", &["q".to_owned()]).unwrap();
    let covariance = Covariance::scaled(&observations, Scaling::Max, &ByName::default()).unwrap();
    let comparison = Comparison::new(&observations, covariance, Steps::ALL).unwrap();
    let header = &b"sample\tstep\te\tq\n"[..];
    let mut lines = Lines(0);
    let mut runs = header.chain(Runs { next: 0, text: Vec::new(), used: 0 });
    comparison.stream("runs", &mut runs, &mut lines, MisfitRows::Steps).unwrap();
    assert_eq!(lines.0, 1 + STEPS * RUNS);
    let peak = peak_memory();
    assert!(peak < 100.0, "{peak} MB");
}
