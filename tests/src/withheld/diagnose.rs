//! Diagnose every case from what a user would have.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use gl::emulator::Emulator;
use gl::ensemble::Ensemble;
use gl::gap::attribute::closure::Shrink;
use gl::gap::attribute::diagnosis;
use gl::gap::attribute::diagnosis::{emulate, shrink};
use gl::gap::attribute::hypothesis::Candidate;
use gl::gap::attribute::measurement::{Kind, MeasurementEffect};
use gl::gap::attribute::next_runs::next_runs;
use gl::gap::attribute::predictor::Predictor;
use gl::gap::attribute::problem::Problem;
use gl::observations::{ByName, Observations};
use gl::prior::Prior;
use gl::samples::Samples;
use gl::table::{Table, TableWriter};
use rayon::prelude::*;

use super::bench::Bench;
use super::exact::Exact;
use super::generate::KINDS;

/// What cases with the same candidates of the simulation, and the same specimens, share.
struct Design {
    prior: Prior,
    samples: Samples,
    ensemble: Ensemble,
    emulator: Emulator,
}

/// How every case is diagnosed.
#[derive(Clone, Copy, Debug)]
pub struct How {
    /// Runs of the design, an input of the emulator.
    pub runs: usize,
    /// Whether two fifths of them are made in a second round, where the first one asks for them, as
    /// `scripts/attribute` does.
    pub in_two_rounds: bool,
    /// Whether the world itself predicts, not an emulator: the best that any emulator could do.
    pub exact: bool,
    /// Seed of the design.
    pub seed: u64,
}

/// Read `DIR/cases` and write `DIR/verdicts.tsv`. The emulator of a design is trained once for all
/// cases with the same candidates.
///
/// # Errors
/// If a case cannot be read or diagnosed.
pub fn diagnose(bench: &Bench, how: How, dir: &Path) -> Result<()> {
    let How { runs, in_two_rounds, exact, seed } = how;
    let first = if in_two_rounds { (3 * runs).div_ceil(5) } else { runs };
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
    let mut designs: BTreeMap<(String, String), Design> = BTreeMap::new();
    let design_of = |row: usize| (list.field(row, 1).to_owned(), list.field(row, 2).to_owned());
    for design in (0..list.len()).map(design_of) {
        if designs.contains_key(&design) {
            continue;
        }
        let left_out: Vec<&str> = design.0.split(',').collect();
        let (samples, ensemble) = bench.design(&left_out, design.1 == "yes", first, seed)?;
        let prior = bench.prior_without(&left_out);
        let emulator = emulate(&prior, &samples, &ensemble, Some(&finest), seed)?;
        designs.insert(design, Design { prior, samples, ensemble, emulator });
    }
    let verdicts = (0..list.len())
        .into_par_iter()
        .map(|row| {
            let Design { prior, samples, ensemble, emulator } = &designs[&design_of(row)];
            let observations = &measurements[row];
            let simulated = prior.effects().into_iter().map(Candidate::Simulated);
            let named = |name: &str| KINDS.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind);
            let kinds: Vec<Kind> = list.field(row, 3).split(',').filter_map(named).collect();
            let measured = MeasurementEffect::all(&kinds, &observables).into_iter().map(Candidate::Measured);
            let candidates: Vec<Candidate> = simulated.chain(measured).collect();
            let noise = observations.noise(&ByName::default())?;
            let problem = |predictor| {
                Problem::new(predictor, prior, candidates.clone(), observations, noise.clone(), 1.0)
            };
            let refined = if in_two_rounds {
                let problem = problem(emulator)?;
                let rough = diagnosis::diagnose(&problem, 2, seed)?;
                let count = (runs - first) * prior.parameters().len();
                let values = next_runs(&problem, &rough.attribution.explanations, count, seed)?;
                let specimens = seed + 1 + row as u64;
                let next = bench.run(prior, values, list.field(row, 2) == "yes", 1, specimens)?;
                let samples = Samples::concatenate(vec![samples.clone(), next.0])?;
                let mut ensemble = ensemble.clone();
                for run in 0..next.1.len() {
                    let curves: Vec<Vec<f64>> =
                        (0..observables.len()).map(|j| next.1.curve(run, j).to_vec()).collect();
                    ensemble.push(&next.1.samples[run], &curves, None);
                }
                Some(emulate(prior, &samples, &ensemble, noise.as_ref(), seed)?)
            } else {
                None
            };
            let emulator = refined.as_ref().unwrap_or(emulator);
            let world = exact.then(|| Exact::new(bench, prior, emulator, &finest));
            let problem = problem(world.as_ref().map_or(emulator as &dyn Predictor, |world| world))?;
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
