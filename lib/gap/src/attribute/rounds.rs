//! How many runs a design has, and when it has enough of them.
//!
//! Where one cause stands out, a third of the runs show it as well as all of them do; where two are close, each run
//! counts. So a design is made in rounds, each of the later ones where the hypotheses put the parameters, until two
//! rounds say the same.

use anyhow::Result;
use gl_table::Table;

use crate::attribute::untried::KNOWN;
use crate::attribute::winner::most_probable;

/// The sizes of rounds, as shares of all runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rounds {
    /// Runs in all, at the most.
    pub all: usize,
}

/// Rounds that are made where the hypotheses put the parameters.
pub const POINTED: usize = 3;

/// Rounds that follow where effects are left of which the emulator knows too little, and the case does not say how many runs
/// the design may have.
const FURTHER: usize = 2;

/// The box is made wider so often at the most: within the prior, and beyond it.
pub const WIDEST: usize = 2;

impl Rounds {
    /// Runs of the first round, all over the box: two fifths.
    pub fn first(self) -> usize {
        (2 * self.all).div_ceil(5)
    }

    /// Runs of a round in a wider box: a fifth.
    pub fn wider(self) -> usize {
        self.all.div_ceil(5)
    }

    /// Runs of all rounds in wider boxes, at the most.
    pub fn most_wider(self) -> usize {
        2 * WIDEST * self.wider()
    }

    /// Runs of all further rounds, at the most.
    pub fn most_further(self) -> usize {
        FURTHER * self.pointed(POINTED)
    }

    /// Runs of a pointed round, from 0: a tenth, twice as many, and what is left; as many as that in further ones.
    pub fn pointed(self, number: usize) -> usize {
        let tenth = self.all.div_ceil(10);
        match number {
            0 => tenth,
            1 => 2 * tenth,
            _ => self.all.saturating_sub(self.first() + 3 * tenth).max(1),
        }
    }
}

/// What a round says.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// What comes first: effects, with a rest and without, `none`, or `unexplained`.
    pub cause: String,
    /// Its probability.
    pub probability: f64,
    /// See [`Diagnosis::least_known`](crate::attribute::diagnosis::Diagnosis::least_known).
    pub ignorance: f64,
    /// Whether effects are left of which the emulator knows too little to rule them out.
    pub is_untried: bool,
}

/// From this probability on a cause stands out.
const SHARP: f64 = 0.95;

impl Standing {
    /// By the tables of `gl-gap-attribute`: its rows, and its verdict.
    ///
    /// # Errors
    /// If a column is missing, or there are no rows.
    pub fn of_tables(attribution: &Table, verdict: &Table) -> Result<Self> {
        let (cause, probability) = most_probable(attribution)?;
        let (code, value) = (verdict.format().column("code")?, verdict.format().column("value")?);
        let said = |wanted: &'static str| {
            let rows = (0..verdict.len()).filter(move |row| verdict.field(*row, code) == wanted);
            rows.filter_map(|row| verdict.field(row, value).parse().ok()).reduce(f64::max)
        };
        let (emulator, untried) = (said("emulator"), said("untried"));
        let ignorance = emulator.into_iter().chain(untried).fold(0.0, f64::max);
        Ok(Self { cause, probability, ignorance, is_untried: untried.is_some() })
    }

    /// Whether further runs are to be made after so many pointed rounds, where all runs are made that a design has by
    /// itself.
    pub fn asks_for_further(&self, pointed: usize) -> bool {
        self.is_untried && pointed < POINTED + FURTHER
    }

    /// Whether it is what the round before said, and stands out in both.
    fn is_settled_since(&self, before: &Self) -> bool {
        self.cause == before.cause
            && self.probability >= SHARP
            && before.probability >= SHARP
            && self.ignorance <= KNOWN
    }
}

/// What the round before said, if what this one says can be held against it.
#[derive(Clone, Debug, Default)]
pub struct Before(Option<Standing>);

impl Before {
    /// Whether further runs are unlikely to change what is said.
    pub fn settles(&self, now: &Standing) -> bool {
        self.0.as_ref().is_some_and(|before| now.is_settled_since(before))
    }

    /// A pointed round follows.
    pub fn point(&mut self, now: Standing) {
        self.0 = Some(now);
    }

    /// A round in a wider box follows. It shows the cause anew, but has no runs where the hypotheses put the parameters: it
    /// settles nothing before a pointed round was made.
    pub fn widen(&mut self, now: Standing) {
        self.0 = self.0.take().and(Some(now));
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn rounds_add_up_to_all_runs() {
        for all in [50, 75, 150, 225, 301] {
            let rounds = Rounds { all };
            let pointed: usize = (0..POINTED).map(|number| rounds.pointed(number)).sum();
            assert_eq!(rounds.first() + pointed, all);
            assert_eq!(rounds.most_further(), 2 * rounds.pointed(POINTED - 1));
        }
    }

    #[test]
    fn what_is_untried_asks_for_further_rounds_that_are_in_the_tables() {
        let table = |text: &str| Table::parse("table", text.as_bytes().to_vec()).unwrap();
        let attribution = table("hypothesis\tprobability\nunexplained\t0.97\n");
        let of = |rows: &str| {
            Standing::of_tables(&attribution, &table(&format!("code\tvalue\ttext\n{rows}"))).unwrap()
        };
        let known = of("emulator\t0.7\tuncertain\n");
        let unknown = of("emulator\t0.7\tuncertain\nuntried\t1.6\ttoo little\n");
        assert_eq!([known.ignorance, unknown.ignorance], [0.7, 1.6]);
        assert!(!known.asks_for_further(POINTED));
        let asked: Vec<usize> = (POINTED..9).filter(|pointed| unknown.asks_for_further(*pointed)).collect();
        assert_eq!(asked, [POINTED, POINTED + 1]);
    }

    fn of(cause: &str, probability: f64, ignorance: f64) -> Standing {
        Standing { cause: cause.into(), probability, ignorance, is_untried: false }
    }

    #[test]
    fn a_wider_box_settles_what_was_said_where_the_hypotheses_point_and_not_before() {
        let sharp = of("adhesion", 0.97, 0.6);
        let mut before = Before::default();
        before.widen(sharp.clone());
        assert!(!before.settles(&sharp), "no run was made where the hypotheses point");
        before.point(sharp.clone());
        assert!(before.settles(&sharp));
        before.widen(sharp.clone());
        assert!(before.settles(&sharp));
        before.widen(of("damping", 0.97, 0.6));
        assert!(!before.settles(&sharp), "the last one said something else");
    }

    #[test]
    fn a_round_settles_what_the_one_before_said_as_well() {
        let now = of("adhesion", 0.97, 0.6);
        assert!(now.is_settled_since(&of("adhesion", 0.96, 3.0)));
        assert!(!now.is_settled_since(&of("damping", 0.96, 0.6)));
        assert!(!now.is_settled_since(&of("adhesion", 0.9, 0.6)));
        assert!(!of("adhesion", 0.97, 1.6).is_settled_since(&now));
    }
}
