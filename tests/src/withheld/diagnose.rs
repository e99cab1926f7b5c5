//! Diagnose every case from what a user would have.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use gl::emulator::{Emulator, Options};
use gl::gap::attribution::attribute;
use gl::gap::hypothesis::Candidate;
use gl::gap::problem::Problem;
use gl::observations::{ByName, Observations};
use gl::prior::Prior;
use gl::table::{Table, TableWriter};
use rayon::prelude::*;

use super::bench::Bench;

/// Read `DIR/cases` and write `DIR/verdicts.tsv`. The emulator of a design is trained once for all
/// cases with the same candidates.
///
/// # Errors
/// If a case cannot be read or diagnosed.
pub fn diagnose(bench: &Bench, runs_an_input: usize, seed: u64, dir: &Path) -> Result<()> {
    let cases = dir.join("cases");
    let list = Table::read(&cases.join("cases.tsv"))?;
    let observables: Vec<String> = bench.world.observables().iter().map(|&name| name.to_owned()).collect();
    let read = |row: usize| {
        let path = cases.join(format!("{}_obs.txt", list.field(row, 0)));
        Observations::read(&path, bench.world.control(), &observables)
    };
    let measurements: Vec<Observations> = (0..list.len()).map(read).collect::<Result<_>>()?;
    // The components must be good enough for the most accurate of the measurements.
    let mut finest: Vec<Vec<f64>> = measurements[0].values.clone();
    finest.iter_mut().flatten().for_each(|sd| *sd = f64::INFINITY);
    for measurement in &measurements {
        for (finest, noise) in
            finest.iter_mut().zip(measurement.noise(&ByName::default())?.into_iter().flatten())
        {
            finest.iter_mut().zip(noise).for_each(|(finest, sd)| *finest = finest.min(sd));
        }
    }
    let mut emulators: BTreeMap<String, (Prior, Emulator)> = BTreeMap::new();
    for row in 0..list.len() {
        let without = list.field(row, 1);
        if emulators.contains_key(without) {
            continue;
        }
        let left_out = (without != "-").then_some(without);
        let (samples, ensemble) = bench.design(left_out, runs_an_input, seed)?;
        let prior = bench.prior_without(left_out);
        let options = Options { noise: Some(finest.clone()), ..Options::default() };
        let emulator = Emulator::fit(&prior, &samples, &ensemble, &options)?;
        emulators.insert(without.to_owned(), (prior, emulator));
    }
    let verdicts = (0..list.len())
        .into_par_iter()
        .map(|row| {
            let (prior, emulator) = &emulators[list.field(row, 1)];
            let observations = &measurements[row];
            let candidates = prior.effects().into_iter().map(Candidate::Simulated).collect();
            let noise = observations.noise(&ByName::default())?;
            let problem = Problem::new(emulator, prior, candidates, observations, noise, 1.0)?;
            attribute(&problem, 2, seed)
        })
        .collect::<Result<Vec<_>>>()?;
    let columns = ["case", "first", "probability", "unexplained", "nearest", "all"];
    let mut table = TableWriter::create(Some(&dir.join("verdicts.tsv")), &columns)?;
    for (row, verdict) in verdicts.iter().enumerate() {
        let best = &verdict.explanations[0];
        let (first, probability) = if verdict.unexplained > best.probability {
            ("unexplained", verdict.unexplained)
        } else {
            (best.name.as_str(), best.probability)
        };
        let all: Vec<String> = verdict
            .explanations
            .iter()
            .filter(|e| e.fits.is_some())
            .map(|e| {
                format!(
                    "{}:p={:.3},lnZ={:.1}±{:.2},d={:+.1},fit={:.4}",
                    e.name,
                    e.probability,
                    e.evidence.ln,
                    e.evidence.error,
                    e.with_discrepancy.unwrap_or(f64::NAN) - e.evidence.ln,
                    e.fits.unwrap_or(f64::NAN)
                )
            })
            .collect();
        table.text(list.field(row, 0)).text(first).number(probability).number(verdict.unexplained);
        table.text(&verdict.nearest).text(&all.join(";")).end_row()?;
    }
    table.finish()
}
