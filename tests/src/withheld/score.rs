//! Hold the verdicts against the answers.

use std::path::Path;

use anyhow::{Result, ensure};
use gl::table::Table;

/// A verdict beside its answer.
#[derive(Clone, Debug)]
pub struct Scored {
    /// The case.
    pub case: String,
    /// What is behind it: `none` or effects joined by `+`.
    pub truth: String,
    /// Whether that is no candidate.
    pub withheld: bool,
    /// What the base parameters cannot absorb, in noise.
    pub visibility: f64,
    /// The least visible of two effects.
    pub least: f64,
    /// The most probable row.
    pub first: String,
    /// Its probability.
    pub probability: f64,
}

impl Scored {
    /// The row that should come first.
    pub fn right(&self) -> &str {
        if self.withheld { "unexplained" } else { &self.truth }
    }

    /// Whether it does.
    pub fn is_right(&self) -> bool {
        self.first == self.right()
    }

    /// Whether an effect is named that is not at work.
    pub fn names_wrong(&self) -> bool {
        !matches!(self.first.as_str(), "none" | "unexplained")
            && (self.withheld || self.first.split('+').any(|name| !self.truth.split('+').any(|t| t == name)))
    }
}

/// Read `DIR/verdicts.tsv` and `DIR/sealed/answers.tsv`.
///
/// # Errors
/// If they cannot be read, or do not belong together.
pub fn read(dir: &Path) -> Result<Vec<Scored>> {
    let answers = Table::read(&dir.join("sealed/answers.tsv"))?;
    let verdicts = Table::read(&dir.join("verdicts.tsv"))?;
    ensure!(answers.len() == verdicts.len(), "{} answers, {} verdicts", answers.len(), verdicts.len());
    let mut scored = Vec::new();
    for row in 0..answers.len() {
        let text = |table: &Table, column: &str| -> Result<String> {
            Ok(table.field(row, table.format().column(column)?).to_owned())
        };
        let number = |table: &Table, column: &str| -> Result<f64> {
            table.number(row, table.format().column(column)?)
        };
        ensure!(text(&answers, "case")? == text(&verdicts, "case")?, "row {row}: not the same case");
        scored.push(Scored {
            case: text(&answers, "case")?,
            truth: text(&answers, "effects")?,
            withheld: text(&answers, "withheld")? != "-",
            visibility: number(&answers, "visibility")?,
            least: number(&answers, "least")?,
            first: text(&verdicts, "first")?,
            probability: number(&verdicts, "probability")?,
        });
    }
    Ok(scored)
}

/// A share of cases: how many of how many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    /// Cases in which it is so.
    pub of: usize,
    /// All cases.
    pub all: usize,
}

impl Share {
    /// Count the cases among those chosen.
    pub fn count<'a>(cases: impl Iterator<Item = &'a Scored>, so: impl Fn(&Scored) -> bool) -> Self {
        cases.fold(Self::default(), |share, case| Self {
            of: share.of + usize::from(so(case)),
            all: share.all + 1,
        })
    }

    /// As a number in [0, 1]; NaN of no cases.
    pub fn value(self) -> f64 {
        self.of as f64 / self.all as f64
    }
}

/// Stated probability of the first row, and how often it is right, in ten bins: (mean stated, right).
pub fn reliability(cases: &[Scored]) -> Vec<(f64, Share)> {
    (0..10)
        .filter_map(|bin| {
            let inside = |case: &&Scored| ((case.probability * 10.0) as usize).min(9) == bin;
            let members: Vec<&Scored> = cases.iter().filter(inside).collect();
            let stated = members.iter().map(|case| case.probability).sum::<f64>() / members.len() as f64;
            (!members.is_empty()).then(|| (stated, Share::count(members.iter().copied(), Scored::is_right)))
        })
        .collect()
}

/// Expected calibration error: mean over cases of |stated − right| by bin.
pub fn calibration_error(cases: &[Scored]) -> f64 {
    reliability(cases)
        .iter()
        .map(|(stated, right)| (stated - right.value()).abs() * right.all as f64 / cases.len() as f64)
        .sum()
}
