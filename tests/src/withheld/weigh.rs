//! Weigh the hypotheses of diagnosed cases once more, by other rules than they were diagnosed with.
//!
//! What rules choose by is kept of every hypothesis, so that the verdicts of thousands of cases by other rules take seconds.
//! Only what comes first, and how likely each effect is, are anew: further runs that other rules would have asked for are
//! not made, and bounds, rivals and the predicted shrink are those of the diagnosis.

use std::path::Path;

use anyhow::{Context, Result};
use gl_gap::attribute::attribution::{Attribution, Explanation, RuledOut};
use gl_gap::attribute::evidence::Evidence;
use gl_gap::attribute::winner::cause;
use gl_table::{Table, TableWriter, number, optional_number, write_rows, yes_no};
use serde::{Deserialize, Serialize};

use super::diagnose::effects;

/// A hypothesis as it stands before the rules.
#[derive(Serialize, Deserialize)]
struct Weighed {
    case: String,
    hypothesis: String,
    /// Positions of its effects among the candidates, joined by `+`.
    effects: String,
    #[serde(serialize_with = "yes_no")]
    with_rest: bool,
    #[serde(serialize_with = "number")]
    ln_weight: f64,
    #[serde(serialize_with = "number")]
    ln_evidence: f64,
    #[serde(serialize_with = "number")]
    closes: f64,
    #[serde(serialize_with = "optional_number")]
    fits: Option<f64>,
    #[serde(serialize_with = "number")]
    noise_scale: f64,
    #[serde(serialize_with = "yes_no")]
    vague: bool,
    #[serde(serialize_with = "yes_no")]
    invisible: bool,
    #[serde(serialize_with = "yes_no")]
    of_the_rig: bool,
    /// Position of the candidate that is one, or `-`.
    passenger: String,
    #[serde(serialize_with = "number")]
    beyond: f64,
    /// What was said of it.
    #[serde(serialize_with = "number")]
    probability: f64,
}

impl Weighed {
    fn new(case: &str, of: &Explanation) -> Self {
        let effects: Vec<String> = of.hypothesis.iter().map(usize::to_string).collect();
        Self {
            case: case.to_owned(),
            hypothesis: of.name.clone(),
            effects: effects.join("+"),
            with_rest: of.has_rest,
            ln_weight: of.ln_weight,
            ln_evidence: of.evidence.ln,
            closes: of.closes,
            fits: of.fits,
            noise_scale: of.noise_scale,
            vague: of.is_vague,
            invisible: of.ruled_out == Some(RuledOut::Invisible),
            of_the_rig: of.is_of_the_rig,
            passenger: of.passenger.map_or_else(|| "-".to_owned(), |candidate| candidate.to_string()),
            beyond: of.beyond,
            probability: of.probability,
        }
    }

    /// As the rules see it: without parameters and curves.
    fn explanation(&self) -> Result<Explanation> {
        let effects = self.effects.split('+').filter(|place| !matches!(*place, "" | "-"));
        Ok(Explanation {
            hypothesis: effects
                .map(str::parse)
                .collect::<Result<_, _>>()
                .with_context(|| format!("{}: effects {} are no positions", self.case, self.effects))?,
            has_rest: self.with_rest,
            name: self.hypothesis.clone(),
            probability: 0.0,
            ln_weight: self.ln_weight,
            ruled_out: self.invisible.then_some(RuledOut::Invisible),
            is_behind: false,
            evidence: Evidence {
                ln: self.ln_evidence,
                error: 0.0,
                modes: Vec::new(),
                samples: Vec::new(),
                weights: Vec::new(),
                mean: Vec::new(),
            },
            singular: Default::default(),
            added: Vec::new(),
            fits: self.fits,
            closes: self.closes,
            noise_scale: self.noise_scale,
            is_vague: self.vague,
            passenger: self.passenger.parse().ok(),
            is_of_the_rig: self.of_the_rig,
            beyond: self.beyond,
        })
    }
}

/// Write `DIR/hypotheses.tsv`: those that may have any probability.
///
/// # Errors
/// If it cannot be written.
pub fn write<'a>(cases: impl Iterator<Item = (&'a str, &'a [Explanation])>, dir: &Path) -> Result<()> {
    let rows: Vec<Weighed> = cases
        .flat_map(|(case, of)| of.iter().map(move |of| Weighed::new(case, of)))
        .filter(|row| row.ln_weight.is_finite())
        .collect();
    write_rows(Some(&dir.join("hypotheses.tsv")), &rows)
}

/// Read `DIR/hypotheses.tsv` and write what comes first by the present rules into `DIR/verdicts.tsv`.
///
/// # Errors
/// If a table cannot be read or written.
pub fn weigh(dir: &Path) -> Result<()> {
    let rows: Vec<Weighed> = Table::read(&dir.join("hypotheses.tsv"))?.rows()?;
    let path = dir.join("verdicts.tsv");
    let verdicts = Table::read(&path)?;
    let mut table = TableWriter::create(Some(&path), verdicts.format().columns())?;
    for row in 0..verdicts.len() {
        let case = verdicts.field(row, verdicts.format().column("case")?);
        let own = rows.iter().filter(|of| of.case == case).map(Weighed::explanation);
        let attribution = Attribution::by_rules(own.collect::<Result<_>>()?);
        let first = attribution.first();
        let same = cause(&first.name) == verdicts.field(row, verdicts.format().column("first")?);
        for (column, name) in verdicts.format().columns().iter().enumerate() {
            match name.as_str() {
                "first" => table.text(cause(&first.name)),
                "probability" => table.number(attribution.probability_of(first)),
                "with_rest" => table.yes_no(first.has_rest),
                "closes" => table.number(first.closes),
                "nearest" => table.text(attribution.nearest().map_or("none", |of| cause(&of.name))),
                "effects" => table.text(&effects(&probabilities(&attribution))),
                "settled" | "confounded" if !same => table.text("-"),
                _ => table.text(verdicts.field(row, column)),
            };
        }
        table.end_row()?;
    }
    table.finish()
}

/// Candidates by name, each with its probability to be in.
fn probabilities(attribution: &Attribution) -> Vec<(String, f64)> {
    let mut single: Vec<&Explanation> =
        attribution.explanations.iter().filter(|of| of.hypothesis.len() == 1 && !of.has_rest).collect();
    single.sort_by_key(|of| of.hypothesis[0]);
    let probability = |of: &Explanation| attribution.probability_of_effects(&of.hypothesis);
    single.into_iter().map(|of| (of.name.clone(), probability(of))).collect()
}
