//! Hold the verdicts against the answers.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use gl_gap::attribute::attribution::UNEXPLAINED;
use gl_table::Table;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::generate::SEEN_WITHOUT;

/// An effect that closes less of the gap than this is no cause of it.
const LITTLE: f64 = 0.5;

/// A verdict beside its answer.
#[derive(Clone, Debug)]
pub struct Scored {
    /// The case.
    pub case: String,
    /// What sets its group apart.
    pub family: String,
    /// What is behind it: `none` or effects joined by `+`.
    pub truth: String,
    /// Whether that is no candidate.
    pub withheld: bool,
    /// What the base parameters cannot absorb, in noise.
    pub visibility: f64,
    /// What the base parameters and any one candidate cannot absorb of what is no candidate, in noise.
    pub imitated: f64,
    /// What nothing that the diagnosis considers can absorb of it: the base parameters and any two candidates, as far
    /// beyond the prior as its box goes.
    pub considered: f64,
    /// Whether there is something in it that is no effect of the world's: a remainder.
    pub has_rest: bool,
    /// Whether a base parameter lies outside the prior that was told.
    pub is_outside: bool,
    /// Whether an effect is stronger than its upper bound.
    pub is_beyond: bool,
    /// Parameters that are said, before all else, to be pulled beyond a bound.
    pub leans: String,
    /// Whether the prior was made wider, which is said before all else, too.
    pub is_widened: bool,
    /// The least visible of two effects.
    pub least: f64,
    /// The most probable cause, with a rest or without.
    pub first: String,
    /// Its probability.
    pub probability: f64,
    /// Whether it is said without reserve.
    pub is_settled: bool,
    /// Share of the gap that it closes by itself.
    pub closes: f64,
    /// Hypotheses that it is said to be confounded with.
    pub confounded: Vec<String>,
    /// Predicted shrink of the gap, 5 and 95 %, if the first row is an effect.
    pub predicted: (f64, f64),
    /// Measured shrink, by recalibrating the world with what is behind the measurement.
    pub shrink: f64,
    /// Candidates, and their stated probability to be in.
    pub effects: Vec<(String, f64)>,
    /// Whether what comes first has a rest beside it.
    pub is_beside_a_rest: bool,
    /// Parameters of the simulation in what comes first.
    pub parameters: Vec<Known>,
    /// Runs of the design.
    pub runs: f64,
}

/// What is known of a parameter, and what it is.
#[derive(Clone, Debug)]
pub struct Known {
    /// 5 and 95 % quantile of its posterior.
    pub interval: (f64, f64),
    /// Its value behind the measurement.
    pub truth: f64,
}

impl Known {
    fn holds(&self) -> bool {
        self.interval.0 <= self.truth && self.truth <= self.interval.1
    }
}

impl Scored {
    /// The row that should come first.
    pub fn right(&self) -> &str {
        if self.withheld || (self.has_rest && self.is_of_none()) { "unexplained" } else { &self.truth }
    }

    /// Whether it does.
    pub fn is_right(&self) -> bool {
        // Without a wider prior something else is at work indeed.
        let is_told = self.is_outside && self.is_of_none() && self.first == "unexplained";
        self.first == self.right() || is_told || (self.right() == "unexplained" && self.closes_little())
    }

    /// Whether nothing is behind it.
    pub fn is_of_none(&self) -> bool {
        self.truth == "none"
    }

    /// Whether one candidate is behind it.
    pub fn is_of_one(&self) -> bool {
        !self.withheld && !self.is_of_none() && !self.truth.contains('+')
    }

    /// Whether several candidates are.
    pub fn is_of_several(&self) -> bool {
        !self.withheld && self.truth.contains('+')
    }

    /// Whether an effect is that is no candidate and can be seen.
    pub fn is_seen_without(&self) -> bool {
        self.withheld && self.visibility >= SEEN_WITHOUT
    }

    /// Whether an effect is named with confidence that is not at work.
    pub fn is_confidently_wrong(&self) -> bool {
        self.names_wrong() && self.probability > 0.9
    }

    /// Whether that is an effect.
    fn is_right_cause(&self) -> bool {
        self.is_right() && !self.withheld && !self.is_of_none()
    }

    /// Whether what is behind it lies within the bounds that were told.
    pub fn is_within(&self) -> bool {
        !self.is_outside && !self.is_beyond
    }

    /// Whether the gap closes, but for a hundredth: the interval of a shrink may end there, and cannot miss then.
    pub fn closes_all(&self) -> bool {
        self.shrink >= 0.99
    }

    /// Whether the effect that is named closes little of the gap, which is said: something else makes most of it.
    pub fn closes_little(&self) -> bool {
        self.has_effect() && self.closes < LITTLE
    }

    fn has_effect(&self) -> bool {
        !matches!(self.first.as_str(), "none" | "unexplained")
    }

    /// Whether what should come first is said to be confounded with what does.
    pub fn is_near(&self) -> bool {
        !self.is_right() && self.confounded.iter().any(|name| name == self.right())
    }

    /// Whether a bound was said to be too narrow before all else.
    pub fn is_warned(&self) -> bool {
        self.is_widened || !matches!(self.leans.as_str(), "" | "-")
    }

    /// Whether an effect is named that is not at work.
    pub fn names_wrong(&self) -> bool {
        !self.is_right()
            && self.has_effect()
            && (self.withheld || self.first.split('+').any(|name| !self.truth.split('+').any(|t| t == name)))
    }
}

/// Read `DIR/verdicts.tsv`, `DIR/parameters.tsv` and `DIR/sealed/answers.tsv`.
///
/// # Errors
/// If they cannot be read, or do not belong together.
pub fn read(dir: &Path) -> Result<Vec<Scored>> {
    let answers = Table::read(&dir.join("sealed/answers.tsv"))?;
    let verdicts = Table::read(&dir.join("verdicts.tsv"))?;
    let parameters = Table::read(&dir.join("parameters.tsv"))?;
    ensure!(answers.len() == verdicts.len(), "{} answers, {} verdicts", answers.len(), verdicts.len());
    let mut scored = Vec::new();
    for row in 0..answers.len() {
        let text = |table: &Table, column: &str| -> Result<String> {
            Ok(table.field(row, table.format().column(column)?).to_owned())
        };
        let number = |table: &Table, column: &str| -> Result<f64> {
            table.number(row, table.format().column(column)?)
        };
        let case = text(&answers, "case")?;
        ensure!(case == text(&verdicts, "case")?, "row {row}: not the same case");
        let is_beside_a_rest = text(&verdicts, "with_rest")? == "yes";
        let first = text(&verdicts, "first")?;
        let beside =
            if is_beside_a_rest && first != UNEXPLAINED { format!("+{UNEXPLAINED}") } else { String::new() };
        let hypothesis = format!("{first}{beside}");
        scored.push(Scored {
            parameters: known(&parameters, (&case, &hypothesis), &text(&answers, "values")?)?,
            case,
            family: text(&answers, "family")?,
            truth: text(&answers, "effects")?,
            withheld: text(&answers, "withheld")? != "-",
            has_rest: text(&answers, "rest")? == "yes",
            is_outside: text(&answers, "rest")? == "outside",
            is_beyond: text(&answers, "rest")? == "beyond",
            leans: text(&verdicts, "leans")?,
            is_widened: text(&verdicts, "widened")? == "yes",
            visibility: number(&answers, "visibility")?,
            imitated: number(&answers, "imitated")?,
            considered: number(&answers, "considered")?,
            least: number(&answers, "least")?,
            first,
            probability: number(&verdicts, "probability")?,
            is_settled: text(&verdicts, "settled")? == "yes",
            is_beside_a_rest,
            closes: number(&verdicts, "closes")?,
            confounded: text(&verdicts, "confounded")?.split(',').map(str::to_owned).collect(),
            predicted: (number(&verdicts, "shrink_low")?, number(&verdicts, "shrink_high")?),
            shrink: number(&answers, "shrink")?,
            runs: number(&verdicts, "runs")?,
            effects: text(&verdicts, "effects")?
                .split(',')
                .map(|pair| {
                    let (name, probability) =
                        pair.split_once('=').context("an effect without probability")?;
                    Ok((name.to_owned(), probability.parse()?))
                })
                .collect::<Result<_>>()?,
        });
    }
    Ok(scored)
}

/// The parameters of a case under a hypothesis, if it was diagnosed with that, with their values from `NAME=VALUE,…`; errors of
/// the rig have none.
fn known(parameters: &Table, (case, hypothesis): (&str, &str), values: &str) -> Result<Vec<Known>> {
    let column = |name| parameters.format().column(name);
    let (of, under, name) = (column("case")?, column("hypothesis")?, column("parameter")?);
    let (low, high) = (column("q05")?, column("q95")?);
    let values = values.split(',').filter_map(|value| value.split_once('='));
    let values: Vec<(&str, f64)> =
        values.map(|(name, value)| Ok((name, value.parse()?))).collect::<Result<_>>()?;
    let mut known = Vec::new();
    let is_meant =
        |row: &usize| parameters.field(*row, of) == case && parameters.field(*row, under) == hypothesis;
    for row in (0..parameters.len()).filter(is_meant) {
        if let Some((_, truth)) = values.iter().find(|(known, _)| *known == parameters.field(row, name)) {
            let interval = (parameters.number(row, low)?, parameters.number(row, high)?);
            known.push(Known { interval, truth: *truth });
        }
    }
    Ok(known)
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
    pub fn count<'a, T: 'a>(cases: impl Iterator<Item = &'a T>, so: impl Fn(&T) -> bool) -> Self {
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

/// A stated probability, and whether it came true.
pub type Statement = (f64, bool);

/// What the first rows state.
pub fn of_first_rows<'a>(cases: impl Iterator<Item = &'a Scored>) -> Vec<Statement> {
    cases.map(|case| (case.probability, case.is_right())).collect()
}

/// What is stated about every candidate effect.
pub fn of_effects<'a>(cases: impl Iterator<Item = &'a Scored>) -> Vec<Statement> {
    let is_in =
        |case: &Scored, name: &str| !case.withheld && case.truth.split('+').any(|truth| truth == name);
    cases
        .flat_map(|case| case.effects.iter().map(move |(name, stated)| (*stated, is_in(case, name))))
        .collect()
}

/// Mean of what was stated, and how often it came true, in ten bins.
pub fn reliability(statements: &[Statement]) -> Vec<(f64, Share)> {
    (0..10)
        .filter_map(|bin| {
            let members: Vec<&Statement> =
                statements.iter().filter(|(stated, _)| ((stated * 10.0) as usize).min(9) == bin).collect();
            let stated = members.iter().map(|(stated, _)| stated).sum::<f64>() / members.len() as f64;
            let of = members.iter().filter(|(_, came)| *came).count();
            (!members.is_empty()).then_some((stated, Share { of, all: members.len() }))
        })
        .collect()
}

/// Expected calibration error: mean over statements of |stated − came true| by bin.
pub fn calibration_error(statements: &[Statement]) -> f64 {
    reliability(statements)
        .iter()
        .map(|(stated, came)| (stated - came.value()).abs() * came.all as f64 / statements.len() as f64)
        .sum()
}

/// The calibration error that as many statements would have by chance alone if every one of them came true
/// with exactly the probability stated: mean over draws.
pub fn calibration_error_by_chance(statements: &[Statement]) -> f64 {
    const DRAWS: usize = 1000;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let drawn = |_| {
        let came: Vec<Statement> =
            statements.iter().map(|&(stated, _)| (stated, random.random::<f64>() < stated)).collect();
        calibration_error(&came)
    };
    (0..DRAWS).map(drawn).sum::<f64>() / DRAWS as f64
}

/// How often the predicted interval of the shrink holds, where the right effects come first.
pub fn shrink_coverage<'a>(cases: impl Iterator<Item = &'a Scored>) -> Share {
    // The answer's shrink is of fits within the bounds.
    let named = cases.filter(|case| case.is_within() && case.is_right_cause());
    // To the digits of a report: an interval may end at 1 exactly.
    Share::count(named, |case| {
        case.predicted.0 - 1e-3 <= case.shrink && case.shrink <= case.predicted.1 + 1e-3
    })
}

/// How often the interval of a parameter holds, where the right effects come first, beside a rest or without.
pub fn parameter_coverage<'a>(cases: impl Iterator<Item = &'a Scored>, beside_a_rest: bool) -> Share {
    let named = cases.filter(|case| case.is_within() && case.is_right_cause());
    let parameters =
        named.filter(|case| case.is_beside_a_rest == beside_a_rest).flat_map(|of| &of.parameters);
    Share::count(parameters, Known::holds)
}
