//! The box of base parameters that most runs of a design are drawn from.
//!
//! A prior that is wide beside what the measurement allows makes curves of which an emulator knows the details
//! only roughly. So the design keeps to a box about what fits; it goes beyond the prior where a hypothesis leans on that.

use std::collections::BTreeSet;

use std::path::Path;

use anyhow::{Context, Result};

use crate::attribute::attribution::lean;
use crate::attribute::winner::cause;
use gl_inference::prior::{Parameter, Prior};
use gl_inference::weights::Weights;
use gl_table::Table;

/// The box holds runs whose root-mean-square misfit is up to so many times the smallest.
const REACH: f64 = 3.0;
/// It is wider than what they span by this factor.
const WIDER: f64 = 1.5;
/// It has at least this share of the prior's width: an effect moves the base parameters that fit.
const SHARE: f64 = 0.25;

/// The prior with base parameters between the runs that fit about as well as the best, half as wide again, and at
/// least a quarter of its width. Parameters of effects stay as they are.
///
/// * `weights` — runs with their misfits.
///
/// # Errors
/// If the weights have no misfits, or lack a parameter.
pub fn narrow(prior: &Prior, weights: &Weights) -> Result<Prior> {
    let misfit = weights.misfit.as_ref();
    let misfit = misfit.with_context(|| format!("{}:1: no column misfit", weights.source))?;
    let least = misfit.iter().copied().fold(f64::INFINITY, f64::min);
    let is_near = |i: &usize| misfit[*i] <= REACH * REACH * least;
    let near: Vec<usize> = (0..misfit.len()).filter(is_near).collect();
    let narrowed = |parameter: &Parameter| {
        if parameter.effect.is_some() || near.is_empty() {
            return Ok(parameter.clone());
        }
        let column = weights.parameters.iter().position(|name| *name == parameter.name);
        let column = column.with_context(|| format!("{}:1: no column {}", weights.source, parameter.name))?;
        let places = near.iter().map(|&i| parameter.scale.forward(weights.values[i][column]));
        let (low, high) =
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
        let (lower, upper) = parameter.scaled_bounds();
        let width = (WIDER * (high - low)).max(SHARE * (upper - lower));
        let lacking = width - (high - low);
        Ok(between(parameter, low - lacking / 2.0, high + lacking / 2.0))
    };
    Ok(Prior::new(prior.parameters().iter().map(narrowed).collect::<Result<_>>()?))
}

/// What a hypothesis that is not ruled out says of a parameter: the bound that it leans on.
#[derive(Clone, Debug, PartialEq)]
pub struct Pull {
    /// The parameter.
    pub parameter: String,
    /// −1 the lower bound, 1 the upper, 0 none; −2 and 2 where the measurement pulls it beyond.
    pub side: f64,
    /// Whether the hypothesis is what comes first, with a rest or without.
    pub is_of_first: bool,
}

impl Pull {
    /// What the measurement pulls beyond a bound, where `first` comes first.
    pub fn beyond(found: &lean::Lean, first: &str) -> Self {
        Self {
            parameter: found.parameter.clone(),
            side: if found.is_upper { PULLED } else { -PULLED },
            is_of_first: cause(&found.hypothesis) == cause(first),
        }
    }
}

/// What hypotheses lean on: the table of `gl-gap-attribute --posterior-out`, whose first row is of what comes first. Without a
/// column `hypothesis` all of it is.
///
/// # Errors
/// If it cannot be read, or lacks the columns `parameter lean`.
pub fn read_leans(path: &Path) -> Result<Vec<Pull>> {
    let table = Table::read(path)?;
    let parameter = table.format().column("parameter")?;
    let hypothesis = table.format().column("hypothesis").ok();
    let sides = table.numbers("lean")?;
    let cause_of = |row: usize| hypothesis.map(|column| cause(table.field(row, column)));
    let lean = |(row, side)| Pull {
        parameter: table.field(row, parameter).to_owned(),
        side,
        is_of_first: cause_of(row) == cause_of(0),
    };
    Ok(sides.into_iter().enumerate().map(lean).collect())
}

/// The size of a side to which the measurement pulls a parameter beyond its bound.
pub const PULLED: f64 = 2.0;

/// How far a box may grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// To the bounds of the prior.
    Prior,
    /// Beyond them, where the measurement pulls a parameter there, by half the prior's width a time and its whole width
    /// at the most: what was believed beforehand is in doubt then. What is not negative stays so. Where it lies beyond
    /// already it goes on only for what comes first: a base model that may do ever more imitates ever more.
    Beyond,
}

/// Share of the prior's width by which a box grows beyond it at a time.
const STEP_BEYOND: f64 = 0.5;

/// What is left of a bound by less than this has come to zero, but for rounding.
const ROUNDING: f64 = 1e-9;

/// Widths of the prior that a box may lie beyond it at the most.
const MOST_BEYOND: f64 = 1.0;

/// The box, its width added on each side that a hypothesis leans on, as far as the limit allows; `None` where no
/// hypothesis leans on a bound that can be moved.
///
/// # Errors
/// If a parameter of the box is not in the prior.
pub fn widen(prior: &Prior, narrowed: &Prior, leans: &[Pull], limit: Limit) -> Result<Option<Prior>> {
    let leaning = |is_of: fn(f64) -> bool| -> BTreeSet<&str> {
        leans.iter().filter(|lean| is_of(lean.side)).map(|lean| lean.parameter.as_str()).collect()
    };
    let (to_lower, to_upper) = (leaning(|side| side < 0.0), leaning(|side| side > 0.0));
    let mut is_wider = false;
    let mut parameters = Vec::new();
    for parameter in narrowed.parameters() {
        let name = parameter.name.as_str();
        let whole = prior.parameter(name);
        let whole =
            whole.with_context(|| format!("the box has a parameter {name}, which the prior has not"))?;
        let (low, high) = parameter.scaled_bounds();
        let mut wider = parameter.clone();
        let limit_of = |side: f64, is_beyond: bool| {
            let is_pulled = leans.iter().any(|lean| {
                lean.parameter == name && lean.side * side >= PULLED && (lean.is_of_first || !is_beyond)
            });
            if is_pulled { limit } else { Limit::Prior }
        };
        if to_lower.contains(name) {
            wider.lower = if parameter.lower > whole.lower {
                between(whole, low - (high - low), high).lower
            } else {
                beyond(parameter.lower, whole, limit_of(-1.0, parameter.lower < whole.lower), -1.0)
            };
        }
        if to_upper.contains(name) {
            wider.upper = if parameter.upper < whole.upper {
                between(whole, low, high + (high - low)).upper
            } else {
                beyond(parameter.upper, whole, limit_of(1.0, parameter.upper > whole.upper), 1.0)
            };
        }
        is_wider |= (wider.lower, wider.upper) != (parameter.lower, parameter.upper);
        parameters.push(wider);
    }
    Ok(is_wider.then(|| Prior::new(parameters)))
}

/// A bound of the box at or beyond that of the whole prior on one side, −1 the lower and 1 the upper, moved on.
fn beyond(bound: f64, whole: &Parameter, limit: Limit, side: f64) -> f64 {
    if limit == Limit::Prior {
        return bound;
    }
    let (low, high) = whole.scaled_bounds();
    let (width, edge) = (high - low, if side < 0.0 { low } else { high });
    let already = side * (whole.scale.forward(bound) - edge) / width;
    let further = (already + STEP_BEYOND).min(MOST_BEYOND);
    if further <= already {
        return bound;
    }
    let moved = whole.scale.back(edge + side * further * width);
    // A length, a stiffness, a share keeps its sign.
    let (is_positive, is_negative) = (whole.lower >= 0.0, whole.upper <= 0.0);
    let rounding = ROUNDING * bound.abs();
    if (is_positive && moved <= rounding) || (is_negative && moved >= -rounding) {
        bound / 2.0
    } else {
        moved
    }
}

/// A box that ends beyond the prior where runs do: most of the runs made out there have failed, so that the bound is one
/// of the simulation.
///
/// * `made`, `done` — values of the runs that were made, and of those of them that were done, shape (runs, parameters of
///   the box).
///
/// # Errors
/// If a parameter of the box is not in the prior.
pub fn within_runs(prior: &Prior, wider: &Prior, made: &[Vec<f64>], done: &[Vec<f64>]) -> Result<Prior> {
    let trimmed = |(j, own): (usize, &Parameter)| {
        let whole = prior.parameter(&own.name);
        let whole = whole
            .with_context(|| format!("the box has a parameter {}, which the prior has not", own.name))?;
        let count = |runs: &[Vec<f64>], is_out: &dyn Fn(f64) -> bool| {
            runs.iter().filter(|run| is_out(run[j])).count()
        };
        let fail = |is_out: &dyn Fn(f64) -> bool| 2 * count(done, is_out) < count(made, is_out);
        let mut trimmed = own.clone();
        let places = done.iter().map(|run| run[j]);
        if own.upper > whole.upper && fail(&|value| value > whole.upper) {
            trimmed.upper = places.clone().fold(whole.upper, f64::max);
        }
        if own.lower < whole.lower && fail(&|value| value < whole.lower) {
            trimmed.lower = places.fold(whole.lower, f64::min);
        }
        Ok(trimmed)
    };
    Ok(Prior::new(wider.parameters().iter().enumerate().map(trimmed).collect::<Result<_>>()?))
}

/// The prior, with its bounds where a box lies beyond them; `None` where it does nowhere.
///
/// # Errors
/// If a parameter of the prior is not in the box.
pub fn with_beyond(prior: &Prior, wider: &Prior) -> Result<Option<Prior>> {
    let joined = |whole: &Parameter| {
        let own = wider.parameter(&whole.name);
        let own = own.with_context(|| format!("the box has no parameter {}", whole.name))?;
        let mut joined = whole.clone();
        (joined.lower, joined.upper) = (whole.lower.min(own.lower), whole.upper.max(own.upper));
        Ok(joined)
    };
    let joined: Vec<Parameter> = prior.parameters().iter().map(joined).collect::<Result<_>>()?;
    let is_beyond = joined.iter().zip(prior.parameters()).any(|(joined, whole)| joined != whole);
    Ok(is_beyond.then(|| Prior::new(joined)))
}

/// A box that goes as far beyond a prior as a wider one does, on the sides where that does.
///
/// # Errors
/// If a parameter of the box is not in one of them.
pub fn reaching(narrow: &Prior, prior: &Prior, wider: &Prior) -> Result<Prior> {
    let of = |prior: &Prior, name: &str| {
        let found = prior.parameter(name).cloned();
        found.with_context(|| format!("the box has a parameter {name}, which the prior has not"))
    };
    let reaching = |own: &Parameter| {
        let (whole, wider) = (of(prior, &own.name)?, of(wider, &own.name)?);
        let lower = if wider.lower < whole.lower { wider.lower } else { own.lower };
        let upper = if wider.upper > whole.upper { wider.upper } else { own.upper };
        Ok(Parameter { lower, upper, ..own.clone() })
    };
    Ok(Prior::new(narrow.parameters().iter().map(reaching).collect::<Result<_>>()?))
}

/// A parameter between two places on its own scale, inside its bounds.
fn between(parameter: &Parameter, low: f64, high: f64) -> Parameter {
    let (lower, upper) = parameter.scaled_bounds();
    let mut inside = parameter.clone();
    // A bound that stays is not taken through a logarithm.
    if low > lower {
        inside.lower = parameter.scale.back(low).max(parameter.lower);
    }
    if high < upper {
        inside.upper = parameter.scale.back(high).min(parameter.upper);
    }
    inside
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const PARAMS: &str =
        "name lower upper scale effect off\na 0 10 - - -\nb 1 10000 log - -\nc 0 1 - extra 0\n";

    fn prior(text: &str) -> Prior {
        Prior::from_table(&Table::parse("params.txt", text.as_bytes().to_vec()).unwrap()).unwrap()
    }

    fn weights(text: &str) -> Weights {
        Weights::from_table(&Table::parse("weights.txt", text.as_bytes().to_vec()).unwrap()).unwrap()
    }

    fn pull(parameter: &str, side: f64, is_of_first: bool) -> Pull {
        Pull { parameter: parameter.to_owned(), side, is_of_first }
    }

    fn has_bounds(prior: &Prior, expected: [(f64, f64); 3]) {
        for (parameter, (lower, upper)) in prior.parameters().iter().zip(expected) {
            assert!((parameter.lower - lower).abs() <= 1e-12 * lower.abs(), "{parameter:?}");
            assert!((parameter.upper - upper).abs() <= 1e-12 * upper.abs(), "{parameter:?}");
        }
    }

    #[test]
    fn a_design_lies_between_the_runs_that_fit_about_as_well_as_the_best() {
        // 9.1 times the least misfit is more than three times its root.
        let weights = weights(
            "sample a b c misfit weight\nr0 4 10 0 10 0\nr1 7 100 0 1 1\nr2 4 1000 0 9 0\nr3 1 1 0 9.1 0\n",
        );
        let narrowed = narrow(&prior(PARAMS), &weights).unwrap();
        // From 4 to 7 on, and from 2 to 3 in the decimal logarithm, half as wide again.
        has_bounds(&narrowed, [(3.25, 7.75), (f64::powf(10.0, 1.75), f64::powf(10.0, 3.25)), (0.0, 1.0)]);
    }

    #[test]
    fn a_design_keeps_a_quarter_of_the_prior_and_stays_inside_it() {
        let weights = weights("sample a b c misfit weight\nr0 9.5 100 0 1 1\nr1 1 9000 0 1000 0\n");
        let narrowed = narrow(&prior(PARAMS), &weights).unwrap();
        has_bounds(&narrowed, [(8.25, 10.0), (f64::powf(10.0, 1.5), f64::powf(10.0, 2.5)), (0.0, 1.0)]);
    }

    #[test]
    fn bounds_that_differ_in_the_seventh_digit_stay_inside_the_prior() {
        let prior = prior("name lower upper\na 100000.1 100000.9\n");
        let weights = weights("sample a misfit weight\nr0 100000.5 1 1\n");
        let narrowed = narrow(&prior, &weights).unwrap();
        let parameter = &narrowed.parameters()[0];
        assert!((parameter.lower - 100_000.4).abs() < 1e-9 && (parameter.upper - 100_000.6).abs() < 1e-9);
    }

    #[test]
    fn a_box_grows_where_a_hypothesis_leans_on_it_and_nowhere_else() {
        let narrowed =
            prior("name lower upper scale effect off\na 3 7 - - -\nb 10 100 log - -\nc 0 1 - extra 0\n");
        let lean = |parameter: &str, side: f64| pull(parameter, side, true);
        let leans = [lean("a", -1.0), lean("b", 1.0), lean("c", -1.0), lean("b", 0.0)];
        let wider = widen(&prior(PARAMS), &narrowed, &leans, Limit::Prior).unwrap().unwrap();
        has_bounds(&wider, [(0.0, 7.0), (10.0, 1000.0), (0.0, 1.0)]);
        let none = [lean("a", 0.0), lean("c", 1.0)];
        assert_eq!(widen(&prior(PARAMS), &narrowed, &none, Limit::Prior).unwrap(), None);
    }

    #[test]
    fn a_box_grows_beyond_the_prior_twice_by_half_its_width_and_keeps_its_sign() {
        let lean = |parameter: &str, side: f64| pull(parameter, side, true);
        let leans = [lean("a", -2.0), lean("b", 2.0), lean("c", 2.0)];
        let whole =
            prior("name lower upper scale effect off\na 2 10 - - -\nb 1 10000 log - -\nc 0.5 1 - extra 0\n");
        let once = widen(&whole, &whole, &leans, Limit::Beyond).unwrap().unwrap();
        has_bounds(&once, [(1.0, 10.0), (1.0, 1e6), (0.5, 1.25)]);
        let twice = widen(&whole, &once, &leans, Limit::Beyond).unwrap().unwrap();
        has_bounds(&twice, [(0.5, 10.0), (1.0, 1e8), (0.5, 1.5)]);
        let more = widen(&whole, &twice, &leans[1..], Limit::Beyond).unwrap();
        assert_eq!(more, None);
        // What does not come first is followed beyond what was believed, and no further.
        let of_others: Vec<Pull> = leans.iter().map(|lean| pull(&lean.parameter, lean.side, false)).collect();
        assert_eq!(widen(&whole, &whole, &of_others, Limit::Beyond).unwrap(), Some(once.clone()));
        assert_eq!(widen(&whole, &once, &of_others, Limit::Beyond).unwrap(), None);
        // Half of 0.8 below 0.4 is zero, but for rounding.
        let share = prior("name lower upper\na 0.4 1.2\n");
        let half = widen(&share, &share, &leans[..1], Limit::Beyond).unwrap().unwrap();
        assert!((half.parameters()[0].lower - 0.2).abs() < 1e-12, "{half:?}");
        let leans_only = [lean("a", -1.0), lean("b", 1.0)];
        assert_eq!(widen(&whole, &whole, &leans_only, Limit::Beyond).unwrap(), None);
        let narrow =
            prior("name lower upper scale effect off\na 3 7 - - -\nb 1 1e6 log - -\nc 0.5 1 - extra 0\n");
        has_bounds(&with_beyond(&whole, &narrow).unwrap().unwrap(), [(2.0, 10.0), (1.0, 1e6), (0.5, 1.0)]);
        assert_eq!(with_beyond(&whole, &whole).unwrap(), None);
        // Beyond 2 for a runs are done, beyond 1e4 for b most fail.
        let done = [vec![1.5, 10.0, 1.1], vec![3.0, 2e4, 1.2]];
        let made = [&done[..], &[vec![3.0, 5e4, 1.0], vec![3.0, 6e4, 1.0]]].concat();
        let trimmed = within_runs(&whole, &once, &made, &done).unwrap();
        has_bounds(&trimmed, [(1.0, 10.0), (1.0, 2e4), (0.5, 1.25)]);
    }

    #[test]
    fn a_box_reaches_as_far_beyond_the_prior_as_a_wider_one_and_stays_narrow_elsewhere() {
        let of = |a: (f64, f64), b: (f64, f64)| {
            prior(&format!("name lower upper\na {} {}\nb {} {}\n", a.0, a.1, b.0, b.1))
        };
        let (whole, own, wider) =
            (of((0.0, 4.0), (0.0, 4.0)), of((1.0, 2.0), (1.0, 2.0)), of((0.0, 6.0), (0.0, 4.0)));
        let bounds =
            |prior: &Prior| prior.parameters().iter().map(|p| (p.lower, p.upper)).collect::<Vec<_>>();
        assert_eq!(bounds(&reaching(&own, &whole, &wider).unwrap()), [(1.0, 6.0), (1.0, 2.0)]);
        assert!(reaching(&own, &whole, &prior("name lower upper\na 0 6\n")).is_err());
    }
}
