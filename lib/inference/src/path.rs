//! The control as a path, with turning points where the loading is cyclic.

use std::ops::Range;

use crate::alignment::{Branch, branches};
use crate::observations::range;

/// Control values of a measurement in the order in which they were imposed.
#[derive(Clone, Debug)]
pub struct Path {
    control: Vec<f64>,
    /// The same without jitter: along a branch it goes one way, or stands still.
    steady: Vec<f64>,
    /// Way travelled along the control, as a share of the whole, from 0 to 1.
    travelled: Vec<f64>,
    branches: Vec<Branch>,
}

impl Path {
    /// The path of control values, shape (steps,), cut where a run is, too, when it is brought onto their steps.
    pub fn new(control: &[f64]) -> Self {
        let steps = control.len();
        let branches = branches(control);
        let mut steady = control.to_vec();
        for branch in &branches {
            for t in branch.from + 1..=branch.to {
                let before = steady[t - 1];
                steady[t] = if branch.rises { steady[t].max(before) } else { steady[t].min(before) };
            }
        }
        let way: Vec<f64> = (0..steps)
            .scan(0.0, |sum, t| {
                *sum += if t == 0 { 0.0 } else { (steady[t] - steady[t - 1]).abs() };
                Some(*sum)
            })
            .collect();
        let whole = way.last().copied().unwrap_or(0.0);
        let travelled = (0..steps)
            .map(|t| if whole > 0.0 { way[t] / whole } else { t as f64 / (steps.max(2) - 1) as f64 })
            .collect();
        Self { control: control.to_vec(), steady, travelled, branches }
    }

    /// Control values, shape (steps,).
    pub fn control(&self) -> &[f64] {
        &self.control
    }

    /// Control values without jitter, shape (steps,): along a branch they go one way, or stand still.
    pub fn steady(&self) -> &[f64] {
        &self.steady
    }

    /// Steps at which the control turns, ascending.
    pub fn turns(&self) -> Vec<usize> {
        self.branches.iter().skip(1).map(|branch| branch.from).collect()
    }

    /// Whether the control rises from the step before to each step, shape (steps,); at the first one, to the next.
    pub fn rises(&self) -> Vec<bool> {
        let of =
            |t: usize| self.branches.iter().find(|branch| t <= branch.to).is_none_or(|branch| branch.rises);
        (0..self.control.len()).map(of).collect()
    }

    /// Largest minus smallest control value.
    pub fn range(&self) -> f64 {
        range(&self.control)
    }

    /// Way travelled up to each step, as a share of the whole, shape (steps,).
    pub fn travelled(&self) -> &[f64] {
        &self.travelled
    }

    /// Where each step stands, from 0 to 1: midway between its share of the way and its share of the
    /// steps, which are set closer together where more happens, shape (steps,).
    pub fn places(&self) -> Vec<f64> {
        let last = (self.travelled.len().max(2) - 1) as f64;
        self.travelled.iter().enumerate().map(|(t, way)| 0.5 * (way + t as f64 / last)).collect()
    }

    /// A curve as it was a way `lag` earlier, in units of the control, across turning points, at which it may have kinks. What
    /// was there before the test began is what it began with.
    pub fn delayed(&self, curve: &[f64], lag: f64) -> Vec<f64> {
        let whole: f64 = self.steady.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let share = if whole > 0.0 { lag / whole } else { 0.0 };
        let branches = self.branches();
        let seen = |then: f64| {
            let is_before = |branch: &&Range<usize>| self.travelled[branch.end - 1] >= then;
            let of = branches.iter().find(is_before).cloned().unwrap_or(0..curve.len());
            interpolate(&self.travelled[of.clone()], &curve[of], then)
        };
        let at = |(now, y): (&f64, &f64)| seen((now - share).max(0.0)) + y - seen(*now);
        self.travelled.iter().zip(curve).map(at).collect()
    }

    /// The branches in their order: the last step of one, where the control turns, is the first one of the next.
    pub fn branches(&self) -> Vec<Range<usize>> {
        self.branches.iter().map(|branch| branch.from..branch.to + 1).collect()
    }

    /// A curve, shape (steps,), at a control value on a branch; where the control stands still, or goes back by as little as
    /// jitter, what it has at the last step there.
    pub fn on(&self, branch: &Range<usize>, curve: &[f64], at: f64) -> f64 {
        interpolate(&self.steady[branch.clone()], &curve[branch.clone()], at)
    }
}

impl Path {
    /// Steps of the control in words: one value, between two, or where the control turns somewhere, as a path.
    pub fn told(&self, control: &str, unit: Option<&str>, steps: &Range<usize>) -> String {
        let values = &self.control;
        let is_one = steps.len() == 1;
        let unit = unit.map(|unit| format!(" {unit}")).unwrap_or_default();
        let (from, to) = apart(values[steps.start], values[steps.end - 1]);
        let turns = self.turns();
        if turns.is_empty() {
            return if is_one {
                format!("at {control} {from}{unit}")
            } else {
                format!("between {control} {from} and {to}{unit}")
            };
        }
        let next = (steps.start + 1).min(values.len() - 1);
        let way = if self.rises()[next] { "rising" } else { "falling" };
        let inside: Vec<usize> =
            turns.into_iter().filter(|&t| steps.start < t && t + 1 < steps.end).collect();
        match inside.as_slice() {
            [] if is_one => format!("with {control} {way} at {from}{unit}"),
            [] => format!("with {control} {way} from {from} to {to}{unit}"),
            [turn] => {
                format!(
                    "with {control} {way} from {from}{unit}, over the turn at {}{unit}, back to {to}{unit}",
                    short(values[*turn])
                )
            }
            turns => {
                format!("with {control} {way} from {from}{unit}, over {} turns, to {to}{unit}", turns.len())
            }
        }
    }
}

/// A number to three digits.
pub fn short(value: f64) -> String {
    rounded(value, 3)
}

/// Two numbers to three digits, or to as many as tell them apart.
fn apart(one: f64, other: f64) -> (String, String) {
    let told = |digits: usize| (rounded(one, digits), rounded(other, digits));
    (3..=9).map(told).find(|(one, other)| one != other).unwrap_or_else(|| told(3))
}

fn rounded(value: f64, digits: usize) -> String {
    let mut text = Vec::new();
    gl_table::push_number(&mut text, format!("{value:.*e}", digits - 1).parse().unwrap_or(value));
    String::from_utf8_lossy(&text).into_owned()
}

/// Cubic through four neighbours (Hermite, slopes from finite differences), a straight line beyond
/// the ends. `x` goes one way, or stands still.
fn interpolate(x: &[f64], y: &[f64], at: f64) -> f64 {
    let n = x.len();
    if n < 2 {
        return y.first().copied().unwrap_or(f64::NAN);
    }
    let rising = x[n - 1] > x[0];
    let next = x.partition_point(|&value| if rising { value <= at } else { value >= at });
    let i = next.clamp(1, n - 1) - 1;
    let slope = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(n - 1));
        let width = x[after] - x[before];
        if width == 0.0 { 0.0 } else { (y[after] - y[before]) / width }
    };
    if next == 0 {
        return y[0] + slope(0) * (at - x[0]);
    }
    if next == n {
        return y[n - 1] + slope(n - 1) * (at - x[n - 1]);
    }
    let width = x[i + 1] - x[i];
    let t = (at - x[i]) / width;
    let (a, b) = (slope(i) * width, slope(i + 1) * width);
    let step = y[i + 1] - y[i];
    y[i] + t * (a + t * (3.0 * step - 2.0 * a - b + t * (a + b - 2.0 * step)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_read_between_its_steps_exactly() {
        let control: Vec<f64> = (0..11).map(f64::from).collect();
        let curve: Vec<f64> = control.iter().map(|u| u * u).collect();
        let path = Path::new(&control);
        assert_eq!(path.branches().len(), 1);
        for t in 2..10 {
            let at = control[t] - 0.3;
            assert!((path.on(&(0..11), &curve, at) - at * at).abs() < 1e-12, "{t}");
            assert_eq!(path.on(&(0..11), &curve, control[t]), curve[t]);
        }
    }

    #[test]
    fn a_lag_crosses_the_turning_point_and_a_branch_ends_there() {
        let control = [0.0, 1.0, 2.0, 1.0, 0.0];
        let path = Path::new(&control);
        let curve = [0.0, 1.0, 2.0, 3.0, 4.0];
        assert_eq!(path.branches(), [0..3, 2..5]);
        assert_eq!([path.on(&(0..3), &curve, 1.5), path.on(&(2..5), &curve, 1.5)], [1.5, 2.5]);
        let late = path.delayed(&curve, 0.5);
        for (t, value) in late.iter().enumerate() {
            assert!((value - (t as f64 - 0.5).max(0.0)).abs() < 1e-12, "{late:?}");
        }
    }

    #[test]
    fn jitter_and_a_control_that_stands_still_are_no_turns() {
        let control = [0.0, 1.0, 0.9995, 2.0, 2.0, 2.0, 1.0, 1.0004, 0.0];
        let path = Path::new(&control);
        assert_eq!(path.branches(), [0..4, 3..9]);
        assert_eq!(path.turns(), [3]);
        assert_eq!(path.rises(), [true, true, true, true, false, false, false, false, false]);
        assert_eq!(path.steady(), [0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0, 1.0, 0.0]);
        assert_eq!(path.control(), control);
        assert_eq!(path.travelled()[4], 0.5);
        let curve: Vec<f64> = control.iter().map(|u| 3.0 * u).collect();
        assert!(
            (0..9).all(|t| path.on(&path.branches()[usize::from(t > 3)], &curve, 0.3 * t as f64).is_finite())
        );
        assert!(path.delayed(&curve, 0.2).iter().all(|y| y.is_finite()));
        assert_eq!(path.told("u", None, &(1..4)), "with u rising from 1 to 2");
    }

    #[test]
    fn a_stretch_of_a_control_that_turns_is_told_as_a_path() {
        let path = Path::new(&[0.0, 1.0, 2.6, 1.5, 0.5, 1.0]);
        assert_eq!(path.turns(), [2, 4]);
        assert_eq!(path.told("u", None, &(0..2)), "with u rising from 0 to 1");
        assert_eq!(path.told("u", None, &(1..4)), "with u rising from 1, over the turn at 2.6, back to 1.5");
        assert_eq!(path.told("u", None, &(3..5)), "with u falling from 1.5 to 0.5");
        assert_eq!(
            path.told("u", Some("mm"), &(1..4)),
            "with u rising from 1 mm, over the turn at 2.6 mm, back to 1.5 mm"
        );
        assert_eq!(path.told("u", Some("mm"), &(3..5)), "with u falling from 1.5 to 0.5 mm");
        assert_eq!(path.told("u", None, &(0..6)), "with u rising from 0, over 2 turns, to 1");
        assert_eq!(Path::new(&[0.0, 1.0, 2.0]).told("e", None, &(0..3)), "between e 0 and 2");
        assert_eq!(path.told("u", None, &(3..4)), "with u falling at 1.5");
        assert_eq!(Path::new(&[0.0, 1.0, 2.0]).told("e", None, &(1..2)), "at e 1");
        // To as many digits as tell its ends apart, where three do not.
        assert_eq!(
            Path::new(&[2.7, 2.70012, 2.70034]).told("e", None, &(1..3)),
            "between e 2.7001 and 2.7003"
        );
    }

    #[test]
    fn a_lag_makes_nothing_up_from_before_the_test_began() {
        let control: Vec<f64> = (0..40).map(f64::from).collect();
        let curve: Vec<f64> = control.iter().map(|u| u.sqrt()).collect();
        let late = Path::new(&control).delayed(&curve, 3.0);
        assert!(late[..4].iter().all(|value| value.abs() < 1e-12), "{:?}", &late[..4]);
        assert!((late[20] - 17f64.sqrt()).abs() < 1e-6);
    }
}
