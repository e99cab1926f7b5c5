//! How many runs a design has, and when it has enough of them.
//!
//! Where one cause stands out, a third of the runs show it as well as all of them do; where two are close, each run
//! counts. So a design is made in rounds, each of the later ones where the hypotheses put the parameters, until two
//! rounds say the same. These are small, since each of them tells where the next has to be.

use anyhow::Result;
use gl_table::Table;

use crate::attribute::attribution::UNEXPLAINED;
use crate::attribute::attribution::untried::KNOWN;
use crate::attribute::winner::MostProbable;

/// The sizes of rounds, as shares of all runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rounds {
    /// Runs in all, at the most.
    pub all: usize,
}

/// Rounds that are made where the hypotheses put the parameters.
const POINTED: usize = 6;

/// Rounds that follow where effects are left of which the emulator knows too little, and the case does not say how many runs
/// the design may have.
const FURTHER: usize = 6;

/// Runs go beyond the prior so often at the most, each time further.
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
        WIDEST * self.wider()
    }

    /// Runs of all further rounds, at the most.
    pub fn most_further(self) -> usize {
        FURTHER * self.tenth()
    }

    /// Runs of a pointed round, from 0: a tenth, in the last of them what is left; a tenth in further ones.
    pub fn pointed(self, number: usize) -> usize {
        let before = self.first() + (POINTED - 1) * self.tenth();
        if number + 1 == POINTED { self.all.saturating_sub(before).max(1) } else { self.tenth() }
    }

    fn tenth(self) -> usize {
        self.all.div_ceil(10)
    }
}

/// What a round says.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// What comes first: effects, with a rest and without, `none`, or `unexplained`.
    pub cause: String,
    /// Its probability.
    pub probability: f64,
    /// Whether it is likelier beside a rest than alone.
    pub is_beside_a_rest: bool,
    /// See [`Diagnosis::least_known`](crate::attribute::diagnosis::Diagnosis::least_known).
    pub ignorance: f64,
    /// Whether effects are left of which the emulator knows too little to rule them out.
    pub is_untried: bool,
    /// Whether what comes first is said with reserve, and not with one that only another measurement takes away.
    pub is_unsettled: bool,
}

/// From this probability on a cause stands out.
pub const SHARP: f64 = 0.95;

/// A probability that changes by less from one round to the next stands still: what keeps it from standing out is what is
/// believed, and no further run.
const STILL: f64 = 0.02;

/// Rounds in a row, this one the last, in which it has to.
const STILL_ROUNDS: usize = 3;

impl Standing {
    /// By the tables of `gl-gap-attribute`: its rows, and its verdict.
    ///
    /// # Errors
    /// If a column is missing, or there are no rows.
    pub fn of_tables(attribution: &Table, verdict: &Table) -> Result<Self> {
        let MostProbable { cause, probability, is_beside_a_rest } = MostProbable::of(attribution)?;
        let (code, value) = (verdict.format().column("code")?, verdict.format().column("value")?);
        let said = |wanted: &'static str| {
            let rows = (0..verdict.len()).filter(move |row| verdict.field(*row, code) == wanted);
            rows.filter_map(|row| verdict.field(row, value).parse().ok()).reduce(f64::max)
        };
        let (emulator, untried) = (said("emulator"), said("untried").or(said("rival-untried")));
        let ignorance = emulator.into_iter().chain(untried).fold(0.0, f64::max);
        let is_said = |wanted: &str| (0..verdict.len()).any(|row| verdict.field(row, code) == wanted);
        let is_unsettled = is_said("unsettled") && !is_said("measure-again");
        Ok(Self {
            cause,
            probability,
            is_beside_a_rest,
            ignorance,
            is_untried: untried.is_some(),
            is_unsettled,
        })
    }

    /// Whether further runs are to be made after so many pointed rounds, where all runs are made that a design has by
    /// itself.
    fn asks_for_further(&self, pointed: usize) -> bool {
        self.is_untried && pointed < POINTED + FURTHER
    }

    /// Whether it is what the round before said, something else beside it or not, and stands out in both. That something unknown is at work is said without
    /// reserve, too: further runs may show what it is.
    fn is_settled_since(&self, before: &Self) -> bool {
        self.cause == before.cause
            && self.is_beside_a_rest == before.is_beside_a_rest
            && self.probability >= SHARP
            && before.probability >= SHARP
            && self.is_known()
    }

    /// Whether further runs can be left: the emulator knows what it is asked for.
    fn is_known(&self) -> bool {
        self.ignorance <= KNOWN && !self.is_untried && !(self.is_unsettled && self.cause == UNEXPLAINED)
    }

    /// Whether it says as much of the same as the round before.
    fn stands_still_since(&self, before: &Self) -> bool {
        self.cause == before.cause && (self.probability - before.probability).abs() <= STILL
    }
}

/// What follows a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// A round in the wider box.
    Widen,
    /// A round where the hypotheses put the parameters.
    Point,
    /// The same beyond the runs that a design has by itself, since too little is known of some effects.
    Further,
    /// Nothing: this round has said it.
    End,
}

/// The way of a design from round to round.
#[derive(Clone, Debug)]
pub struct Course {
    rounds: Rounds,
    /// What the round before said, if what this one says can be held against it.
    before: Option<Standing>,
    /// Rounds that have said as much of the same, up to that one.
    still: usize,
    /// Pointed rounds so far.
    pointed: usize,
    /// How often runs have gone beyond the prior.
    widened: usize,
    is_wider: bool,
    /// Runs that are left of those that were asked for, in wider boxes not counted; nothing where their number is not given.
    left: Option<usize>,
}

impl Course {
    /// The way of a design of these rounds; `asked` is the number of its runs where that is given, and not to be exceeded
    /// but in wider boxes.
    pub fn new(rounds: Rounds, asked: Option<usize>) -> Self {
        Self { rounds, before: None, still: 0, pointed: 0, widened: 0, is_wider: false, left: asked }
    }

    /// A round of so many runs is made.
    pub fn made(&mut self, runs: usize) {
        if !self.is_wider {
            self.left = self.left.map(|left| left.saturating_sub(runs));
        }
    }

    /// Number of runs of the next round, should it be a pointed one: what is left of a larger number than a design had
    /// that was ended comes at once.
    pub fn pointed(&self) -> usize {
        match self.left {
            Some(left) if left > 0 && self.pointed >= POINTED => left,
            Some(left) if left > 0 => left.min(self.rounds.pointed(self.pointed)),
            _ => self.rounds.pointed(self.pointed),
        }
    }

    /// Runs of those that were asked for which are not made yet.
    pub fn unused(&self) -> usize {
        self.left.unwrap_or(0)
    }

    /// Whether runs may still go beyond the prior.
    pub fn may_widen(&self) -> bool {
        self.widened < WIDEST
    }

    /// What follows a round that says this, after which a hypothesis leans on the prior or none does.
    ///
    /// A round in a wider box shows the cause anew, but has no runs where the hypotheses put the parameters: it settles
    /// nothing before a pointed round was made.
    pub fn next(&mut self, now: Standing, leans: bool) -> Step {
        self.is_wider = leans && self.may_widen();
        if self.is_wider {
            self.widened += 1;
            self.before = self.before.take().and(Some(now));
            self.still = 0;
            return Step::Widen;
        }
        let is_all = self.left.map_or(self.pointed >= POINTED, |left| left == 0);
        let goes_on = is_all && self.left.is_none() && now.asks_for_further(self.pointed);
        let is_still = self.before.as_ref().is_some_and(|before| now.stands_still_since(before));
        self.still = if is_still { self.still + 1 } else { 1 };
        let is_settled = self.before.as_ref().is_some_and(|before| now.is_settled_since(before));
        let says_no_more = self.left.is_none() && self.still >= STILL_ROUNDS && now.is_known();
        if is_all && !goes_on || is_settled || says_no_more {
            return Step::End;
        }
        self.pointed += 1;
        self.before = Some(now);
        if goes_on { Step::Further } else { Step::Point }
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
            assert_eq!(rounds.most_further(), FURTHER * rounds.pointed(POINTED));
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
        let rival = of("emulator\t0.7\tuncertain\nrival-untried\t1.4\ttoo little\n");
        assert_eq!([known.ignorance, unknown.ignorance, rival.ignorance], [0.7, 1.6, 1.4]);
        assert!(rival.is_untried);
        let noise = of("unsettled\tunexplained\tsomething\nmeasure-again\t6\tonce more\n");
        assert!(of("unsettled\tunexplained\tsomething\n").is_unsettled && !noise.is_unsettled);
        assert!(!known.asks_for_further(POINTED));
        let asked: Vec<usize> = (POINTED..20).filter(|pointed| unknown.asks_for_further(*pointed)).collect();
        assert_eq!(asked, Vec::from_iter(POINTED..POINTED + FURTHER));
    }

    fn of(cause: &str, probability: f64, ignorance: f64) -> Standing {
        Standing {
            cause: cause.into(),
            probability,
            is_beside_a_rest: false,
            ignorance,
            is_untried: false,
            is_unsettled: false,
        }
    }

    /// What follows rounds that say this, the box leant on in the first of them.
    fn steps(asked: Option<usize>, said: &[(Standing, bool)]) -> Vec<Step> {
        let mut course = Course::new(Rounds { all: 100 }, asked);
        let mut runs = 40;
        let step = |(now, leans): &(Standing, bool)| {
            course.made(runs);
            runs = course.pointed();
            course.next(now.clone(), *leans)
        };
        said.iter().map(step).collect()
    }

    #[test]
    fn a_wider_box_settles_what_was_said_where_the_hypotheses_point_and_not_before() {
        let (sharp, other) = (of("adhesion", 0.97, 0.6), of("damping", 0.97, 0.6));
        let leant = |now: &Standing| (now.clone(), true);
        let plain = |now: &Standing| (now.clone(), false);
        let (widen, point, end) = (Step::Widen, Step::Point, Step::End);
        // No run was made where the hypotheses point.
        assert_eq!(steps(None, &[leant(&sharp), plain(&sharp), plain(&sharp)]), [widen, point, end]);
        let said = [plain(&sharp), leant(&sharp), plain(&sharp)];
        assert_eq!(steps(None, &said), [point, widen, end]);
        let said = [plain(&sharp), leant(&other), plain(&sharp)];
        assert_eq!(steps(None, &said), [point, widen, point], "the last one said something else");
    }

    #[test]
    fn runs_go_beyond_the_prior_twice() {
        let now = of("adhesion", 0.5, 0.6);
        let (widen, point) = (Step::Widen, Step::Point);
        assert_eq!(steps(None, &vec![(now, true); 4]), [widen, widen, point, point]);
    }

    #[test]
    fn a_design_ends_with_its_rounds_and_goes_on_where_effects_are_untried_and_no_number_is_given() {
        let doubtful = (of("adhesion", 0.5, 3.0), false);
        let untried = (Standing { is_untried: true, ..doubtful.0.clone() }, false);
        // So many pointed rounds, further ones, and the end.
        let made = |asked, said: &(Standing, bool)| {
            let steps = steps(asked, &vec![said.clone(); 20]);
            let end = steps.iter().position(|step| *step == Step::End).unwrap();
            let further = steps[..end].iter().filter(|step| **step == Step::Further).count();
            (end - further, further)
        };
        assert_eq!(made(None, &doubtful), (POINTED, 0));
        assert_eq!(made(Some(100), &doubtful), (POINTED, 0));
        assert_eq!(made(None, &untried), (POINTED, FURTHER));
        assert_eq!(made(Some(100), &untried), (POINTED, 0));
        // A larger number than the rounds have is made at once.
        assert_eq!(made(Some(150), &untried), (POINTED + 1, 0));
    }

    #[test]
    fn a_design_ends_where_three_rounds_say_as_much_of_the_same_and_no_number_is_given() {
        let made = |asked: Option<usize>, probabilities: &[f64], ignorance: f64| {
            let said =
                probabilities.iter().map(|&p| (of("adhesion", p, ignorance), false)).collect::<Vec<_>>();
            1 + steps(asked, &said).iter().position(|step| *step == Step::End).unwrap()
        };
        let still = [0.84, 0.80, 0.81, 0.81, 0.81, 0.81, 0.81, 0.81];
        assert_eq!(made(None, &still, 0.6), 4);
        assert_eq!(made(None, &[0.81, 0.84, 0.81, 0.84, 0.81, 0.84, 0.81, 0.84], 0.6), POINTED + 1);
        // What the emulator does not know may change it, and runs that were asked for are made.
        assert_eq!(made(None, &still, 3.0), POINTED + 1);
        assert_eq!(made(Some(100), &still, 0.6), POINTED + 1);
    }

    #[test]
    fn runs_in_a_wider_box_are_not_counted() {
        let mut course = Course::new(Rounds { all: 100 }, Some(120));
        let doubtful = of("adhesion", 0.5, 0.6);
        course.made(40);
        assert_eq!(course.next(doubtful.clone(), true), Step::Widen);
        course.made(20);
        let made: Vec<usize> = (0..7)
            .map(|_| {
                let runs = course.pointed();
                course.next(doubtful.clone(), false);
                course.made(runs);
                runs
            })
            .collect();
        assert_eq!(made, [10, 10, 10, 10, 10, 10, 20]);
        assert_eq!(course.next(doubtful, false), Step::End);
    }

    #[test]
    fn no_more_runs_are_made_than_were_asked_for() {
        for asked in [13, 40, 51, 52, 225, 301] {
            let mut course = Course::new(Rounds { all: asked }, Some(asked));
            let (mut made, mut runs) = (0, Rounds { all: asked }.first());
            loop {
                course.made(runs);
                made += runs;
                runs = course.pointed();
                if course.next(of("adhesion", 0.5, 0.6), false) == Step::End {
                    break;
                }
            }
            assert_eq!(made, asked);
        }
    }

    #[test]
    fn a_round_settles_what_the_one_before_said_as_well() {
        let now = of("adhesion", 0.97, 0.6);
        assert!(now.is_settled_since(&of("adhesion", 0.96, 3.0)));
        assert!(!now.is_settled_since(&of("damping", 0.96, 0.6)));
        assert!(!now.is_settled_since(&of("adhesion", 0.9, 0.6)));
        assert!(!of("adhesion", 0.97, 1.6).is_settled_since(&now));
        assert!(!Standing { is_untried: true, ..now.clone() }.is_settled_since(&now));
        // What else is in it may be the emulator's error.
        assert!(!Standing { is_beside_a_rest: true, ..now.clone() }.is_settled_since(&now));
        let unsettled = |cause: &str| Standing { is_unsettled: true, ..of(cause, 0.97, 0.6) };
        assert!(unsettled("adhesion").is_settled_since(&now));
        let unknown = of("unexplained", 0.97, 0.6);
        assert!(unknown.is_settled_since(&unknown) && !unsettled("unexplained").is_settled_since(&unknown));
    }
}
