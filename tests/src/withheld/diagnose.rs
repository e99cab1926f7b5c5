//! Diagnose every case from what a user would have.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use gl::emulator::Emulator;
use gl::gap::attribute::closure::Shrink;
use gl::gap::attribute::diagnosis;
use gl::gap::attribute::diagnosis::{emulate, shrink};
use gl::gap::attribute::hypothesis::Candidate;
use gl::gap::attribute::measurement::{Kind, MeasurementEffect};
use gl::observations::{ByName, Observations};
use gl::prior::Prior;
use gl::table::{Table, TableWriter};
use rayon::prelude::*;

use super::bench::Bench;
use super::generate::KINDS;

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
    // Cases with the same candidates of the simulation, and the same specimens, share a design.
    let mut emulators: BTreeMap<(String, String), (Prior, Emulator)> = BTreeMap::new();
    let design_of = |row: usize| (list.field(row, 1).to_owned(), list.field(row, 2).to_owned());
    for design in (0..list.len()).map(design_of) {
        if emulators.contains_key(&design) {
            continue;
        }
        let left_out: Vec<&str> = design.0.split(',').collect();
        let (samples, ensemble) = bench.design(&left_out, design.1 == "yes", runs_an_input, seed)?;
        let prior = bench.prior_without(&left_out);
        let emulator = emulate(&prior, &samples, &ensemble, Some(&finest), seed)?;
        emulators.insert(design, (prior, emulator));
    }
    let verdicts = (0..list.len())
        .into_par_iter()
        .map(|row| {
            let (prior, emulator) = &emulators[&design_of(row)];
            let observations = &measurements[row];
            let simulated = prior.effects().into_iter().map(Candidate::Simulated);
            let named = |name: &str| KINDS.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind);
            let kinds: Vec<Kind> = list.field(row, 3).split(',').filter_map(named).collect();
            let measured = MeasurementEffect::all(&kinds, &observables).into_iter().map(Candidate::Measured);
            let candidates = simulated.chain(measured).collect();
            let noise = observations.noise(&ByName::default())?;
            let problem = diagnosis::problem(emulator, prior, candidates, observations, noise, 1.0)?;
            let diagnosis = diagnosis::diagnose(&problem, 2, seed)?;
            let explanations = &diagnosis.attribution.explanations;
            let first = diagnosis.rows[0].explanation.map(|place| &explanations[place]);
            let named = first.filter(|first| !first.hypothesis.is_empty());
            let closes = named.map(|named| shrink(&problem, explanations, named, seed)).transpose()?;
            Ok((diagnosis, closes))
        })
        .collect::<Result<Vec<_>>>()?;
    let columns = [
        "case",
        "first",
        "probability",
        "unexplained",
        "nearest",
        "confounded",
        "shrink",
        "shrink_low",
        "shrink_high",
        "effects",
        "closer_look",
    ];
    let mut table = TableWriter::create(Some(&dir.join("verdicts.tsv")), &columns)?;
    for (row, (diagnosis, closes)) in verdicts.iter().enumerate() {
        let (first, attribution) = (&diagnosis.rows[0], &diagnosis.attribution);
        table
            .text(list.field(row, 0))
            .text(&first.name)
            .numbers(&[first.probability, attribution.unexplained]);
        table.text(&attribution.nearest).text(&first.confounded.join(","));
        let closes = closes.unwrap_or(Shrink { median: 0.0, low: 0.0, high: 0.0 });
        table.numbers(&[closes.median, closes.low, closes.high]);
        let effects: Vec<String> =
            diagnosis.effects.iter().map(|(name, probability)| format!("{name}={probability:.4}")).collect();
        let looks: Vec<String> = attribution
            .explanations
            .iter()
            .filter_map(|e| {
                let (ln, fits) = (e.with_discrepancy?, e.fits?);
                let found = &e.evidence;
                Some(format!(
                    "{}: {:.1} ± {:.2}, {:+.1}, fits {fits:.4}",
                    e.name,
                    found.ln,
                    found.error,
                    ln - found.ln
                ))
            })
            .collect();
        table.text(&effects.join(",")).text(&looks.join("; ")).end_row()?;
    }
    table.finish()
}
