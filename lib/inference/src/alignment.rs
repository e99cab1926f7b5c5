//! Bringing a run onto the steps of the measurement.
//!
//! A run is compared with the measurement at the same control values and on the same branch of the
//! loading path, never merely at the same row.

use crate::collect::Failure;
use crate::ensemble::CONTROL_TOLERANCE;
use crate::observations::range;

/// A reversal of the control smaller than this share of its range is jitter and no turning point.
const JITTER: f64 = 1e-3;

/// Simulated observables at the control values of the measurement, shape (observables, steps).
///
/// * `measured` — control values of the measurement, shape (steps,).
/// * `control` — control values of the run, shape (rows,).
/// * `curves` — observables of the run, shape (observables, rows).
/// * `end_tolerance` — the share of the control's range by which a run may fall short at an end of a
///   branch; the value there is carried over.
///
/// Rows that stand at the same control values are taken as they are. Otherwise both paths are cut at
/// their turning points, and each branch is interpolated linearly.
///
/// # Errors
/// If the run ends early, or its branches are not those of the measurement.
pub fn align(
    measured: &[f64],
    control: &[f64],
    curves: &[Vec<f64>],
    end_tolerance: f64,
) -> Result<Vec<Vec<f64>>, Failure> {
    let span = range(measured);
    let same = |(here, there): (&f64, &f64)| (here - there).abs() <= CONTROL_TOLERANCE * span;
    if measured.len() == control.len() && measured.iter().zip(control).all(same) {
        return Ok(curves.to_vec());
    }
    let jitter = JITTER * span;
    let wanted = branches_beyond(measured, jitter);
    let given = branches_beyond(control, jitter);
    if given.len() < wanted.len() {
        return Err(Failure::Truncated(format!("ends on branch {} of {}", given.len(), wanted.len())));
    }
    if given.len() > wanted.len() {
        return Err(Failure::Control(format!(
            "{} branches of loading where the measurement has {}",
            given.len(),
            wanted.len()
        )));
    }
    let mut aligned = vec![Vec::with_capacity(measured.len()); curves.len()];
    let is_cyclic = wanted.len() > 1;
    for (k, (wanted, given)) in wanted.iter().zip(&given).enumerate() {
        // A monotone run may be written from its end; a path of several branches may not.
        if is_cyclic && wanted.rises != given.rises {
            return Err(Failure::Control(format!("branch {} goes the other way", k + 1)));
        }
        let branch = Interpolation::new(control, given);
        // Where two branches meet, the turning point belongs to the first.
        for &at in &measured[wanted.from + usize::from(k > 0)..=wanted.to] {
            let place = branch
                .place(at, end_tolerance * span)
                .ok_or_else(|| branch.ends_before(&measured[wanted.from..=wanted.to]))?;
            for (aligned, curve) in aligned.iter_mut().zip(curves) {
                aligned.push(branch.at(curve, place));
            }
        }
    }
    Ok(aligned)
}

/// Rows `from..=to` along which the control goes one way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Branch {
    /// First row.
    pub from: usize,
    /// Last row, where the next branch begins.
    pub to: usize,
    /// Whether the control grows along it.
    pub rises: bool,
}

impl Branch {
    fn len(self) -> usize {
        self.to - self.from + 1
    }
}

/// Cut a path at its turning points; reversals smaller than a thousandth of its range are none.
pub fn branches(control: &[f64]) -> Vec<Branch> {
    branches_beyond(control, JITTER * range(control))
}

/// Cut a path at its turning points, leaving out reversals smaller than `jitter`.
fn branches_beyond(control: &[f64], jitter: f64) -> Vec<Branch> {
    let Some(last) = control.len().checked_sub(1) else { return Vec::new() };
    let mut branches = Vec::new();
    let (mut from, mut low, mut high) = (0, 0, 0);
    let mut rises = None;
    for (row, &at) in control.iter().enumerate() {
        if at > control[high] {
            high = row;
        }
        if at < control[low] {
            low = row;
        }
        let fell = control[high] - at > jitter;
        let rose = at - control[low] > jitter;
        match rises {
            None if rose => (rises, high) = (Some(true), row),
            None if fell => (rises, low) = (Some(false), row),
            Some(true) if fell => {
                branches.push(Branch { from, to: high, rises: true });
                (from, low, rises) = (high, row, Some(false));
            }
            Some(false) if rose => {
                branches.push(Branch { from, to: low, rises: false });
                (from, high, rises) = (low, row, Some(true));
            }
            _ => {}
        }
    }
    branches.push(Branch { from, to: last, rises: rises.unwrap_or(true) });
    branches
}

/// One branch of a run, ready to be read off at any control value.
struct Interpolation {
    /// Control value and row, with rising control; a later row at the same value replaces an earlier.
    points: Vec<(f64, usize)>,
}

/// Between which two points a control value lies, and how far along.
#[derive(Clone, Copy)]
struct Place {
    below: usize,
    above: usize,
    share: f64,
}

impl Interpolation {
    fn new(control: &[f64], branch: &Branch) -> Self {
        let mut points: Vec<(f64, usize)> = Vec::with_capacity(branch.len());
        for (row, &at) in control.iter().enumerate().take(branch.to + 1).skip(branch.from) {
            match points.last_mut() {
                Some(last) if last.0 == at => last.1 = row,
                Some(last) if (at > last.0) != branch.rises => {}
                _ => points.push((at, row)),
            }
        }
        if !branch.rises {
            points.reverse();
        }
        Self { points }
    }

    /// Where a control value lies; nowhere beyond the ends.
    fn place(&self, at: f64, tolerance: f64) -> Option<Place> {
        let next = self.points.partition_point(|&(control, _)| control < at);
        let end = |i: usize| {
            let (control, row) = self.points[i];
            ((control - at).abs() <= tolerance).then_some(Place { below: row, above: row, share: 0.0 })
        };
        if next == self.points.len() {
            return end(next - 1);
        }
        let (high, above) = self.points[next];
        if high == at {
            return Some(Place { below: above, above, share: 0.0 });
        }
        if next == 0 {
            return end(0);
        }
        let (low, below) = self.points[next - 1];
        Some(Place { below, above, share: (at - low) / (high - low) })
    }

    /// That it does not reach as far as a path.
    fn ends_before(&self, measured: &[f64]) -> Failure {
        let ends = |values: &mut dyn Iterator<Item = f64>| {
            values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)))
        };
        let own = ends(&mut self.points.iter().map(|point| point.0));
        let wanted = ends(&mut measured.iter().copied());
        let is_short_above = wanted.1 - own.1 > own.0 - wanted.0;
        let (reaches, goes) = if is_short_above { (own.1, wanted.1) } else { (own.0, wanted.0) };
        Failure::Truncated(format!("reaches {reaches} where the measurement goes to {goes}"))
    }

    fn at(&self, curve: &[f64], place: Place) -> f64 {
        if place.below == place.above {
            return curve[place.below];
        }
        curve[place.below] + place.share * (curve[place.above] - curve[place.below])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(control: &[f64]) -> Vec<f64> {
        control.iter().map(|u| 3.0 * u + 1.0).collect()
    }

    #[test]
    fn a_run_on_another_grid_is_interpolated() {
        let control = [0.0, 0.3, 0.7, 1.0];
        let aligned = align(&[0.0, 0.5, 1.0], &control, &[square(&control)], 0.01).unwrap();
        assert_eq!(aligned, [[1.0, 2.5, 4.0]]);
    }

    #[test]
    fn a_run_in_reverse_order_is_turned_round() {
        let control = [1.0, 0.5, 0.0];
        let aligned = align(&[0.0, 0.25, 1.0], &control, &[square(&control)], 0.01).unwrap();
        assert_eq!(aligned, [[1.0, 1.75, 4.0]]);
    }

    #[test]
    fn a_run_that_ends_early_is_truncated_beyond_the_tolerance() {
        let control = [0.0, 0.995];
        let aligned = align(&[0.0, 1.0], &control, &[square(&control)], 0.01).unwrap();
        assert_eq!(aligned[0][1], 3.0 * 0.995 + 1.0);
        let control = [0.0, 0.98];
        assert!(matches!(
            align(&[0.0, 1.0], &control, &[square(&control)], 0.01),
            Err(Failure::Truncated(_))
        ));
        assert!(matches!(align(&[0.0, 1.0], &[0.5], &[vec![1.0]], 0.01), Err(Failure::Truncated(_))));
        assert!(matches!(
            align(&[0.0, 1.0], &[0.5, 1.0], &[vec![1.0, 2.0]], 0.01),
            Err(Failure::Truncated(_))
        ));
    }

    #[test]
    fn cyclic_loading_is_interpolated_branch_by_branch() {
        let measured = [0.0, 0.5, 1.0, 0.6, 0.2, 0.7, 1.2];
        let control = [0.0, 0.25, 1.0, 0.2, 0.4, 1.2];
        let curve = [0.0, 1.0, 4.0, 0.0, 10.0, 50.0];
        let aligned = align(&measured, &control, &[curve.to_vec()], 0.01).unwrap();
        let expected = [0.0, 2.0, 4.0, 2.0, 0.0, 25.0, 50.0];
        for (here, there) in aligned[0].iter().zip(expected) {
            assert!((here - there).abs() < 1e-12, "{:?}", aligned[0]);
        }
    }

    #[test]
    fn branches_that_do_not_match_fail() {
        let measured = [0.0, 1.0, 0.0];
        let run = |control: &[f64]| align(&measured, control, &[square(control)], 0.01);
        assert!(matches!(run(&[0.0, 0.5, 1.0]), Err(Failure::Truncated(_))));
        assert!(matches!(run(&[0.0, 1.0, 0.0, 1.0]), Err(Failure::Control(_))));
        assert!(matches!(run(&[1.0, 0.0, 0.4, 1.0]), Err(Failure::Control(_))));
        assert!(matches!(run(&[0.0, 1.0, 0.5, 0.4]), Err(Failure::Truncated(_))));
    }

    #[test]
    fn jitter_is_no_turning_point() {
        let control = [0.0, 0.4, 0.3999, 0.8, 0.7995, 1.0, 0.3, 0.3004, 0.0];
        let turns: Vec<_> = branches_beyond(&control, 1e-3).iter().map(|b| (b.from, b.to, b.rises)).collect();
        assert_eq!(turns, [(0, 5, true), (5, 8, false)]);
    }
}
