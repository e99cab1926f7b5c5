//! Leave out what no eye can see, so that a picture of many points stays small.

use std::collections::HashSet;

use crate::scene::Point;

/// The most points that one line is drawn through.
const MOST_ON_A_LINE: usize = 1500;
/// Points of a line nearer than this, in points of print, look like one.
const NEAR: f64 = 0.1;

/// A line with those of its points left out that hardly move on from the last one.
pub fn line(points: &[Point]) -> Vec<Point> {
    let mut near = NEAR;
    loop {
        let mut kept: Vec<Point> = Vec::new();
        for (i, &point) in points.iter().enumerate() {
            let far = kept.last().is_none_or(|last| (point.0 - last.0).hypot(point.1 - last.1) > near);
            if far || i + 1 == points.len() {
                kept.push(point);
            }
        }
        if kept.len() <= MOST_ON_A_LINE {
            return kept;
        }
        near *= 1.5;
    }
}

/// Dots without those that stand where another one does, in cells as small as keeps at most `most`.
/// Of a cell the first is kept.
pub fn dots(points: &[Point], most: usize) -> Vec<Point> {
    let mut cell = 0.1;
    loop {
        let mut taken = HashSet::new();
        let kept: Vec<Point> = points
            .iter()
            .copied()
            .filter(|&(x, y)| taken.insert(((x / cell).round() as i64, (y / cell).round() as i64)))
            .collect();
        if kept.len() <= most.max(1) {
            return kept;
        }
        cell *= 1.3;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_on_one_place_become_one_and_the_outermost_stay() {
        let points: Vec<Point> = (0..10_000).map(|i| (f64::from(i % 100), f64::from(i / 100))).collect();
        assert_eq!(dots(&[(1.0, 1.0), (1.01, 1.0), (2.0, 1.0)], 10).len(), 2);
        let kept = dots(&points, 1000);
        assert!((300..=1000).contains(&kept.len()), "{}", kept.len());
    }

    #[test]
    fn a_line_keeps_its_ends_and_its_spikes() {
        let points: Vec<Point> =
            (0..100_000).map(|i| (f64::from(i) * 1e-3, if i == 50_000 { 40.0 } else { 0.0 })).collect();
        let kept = line(&points);
        assert!(kept.len() <= MOST_ON_A_LINE);
        assert_eq!((kept[0], kept[kept.len() - 1]), (points[0], points[points.len() - 1]));
        assert!(kept.contains(&(50.0, 40.0)));
    }
}
