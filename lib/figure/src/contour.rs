//! Where a density on a grid is above a level.

use crate::scene::Point;

/// Outlines of where a density is at least `level`, to be filled together, with coordinates in [0, 1].
///
/// * `density` — at the middles of `cells` × `cells` cells, row by row from the bottom.
///
/// The density is carried on evenly from the outermost middles to the edge.
pub fn above(density: &[f64], cells: usize, level: f64) -> Vec<Vec<Point>> {
    // Nodes: the middles, and the edge on both sides.
    let nodes = cells + 2;
    let place = |i: usize| ((i as f64 - 0.5) / cells as f64).clamp(0.0, 1.0);
    let value = |column: usize, row: usize| {
        let inner = |i: usize| i.clamp(1, cells) - 1;
        density[inner(row) * cells + inner(column)]
    };
    let mut outlines = Vec::new();
    for row in 0..nodes - 1 {
        // Squares that are wholly above the level, side by side, become one.
        let mut full: Option<usize> = None;
        for column in 0..nodes - 1 {
            let corners = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)];
            let heights = corners.map(|(column, row)| value(column, row) - level);
            let is_full = heights.iter().all(|height| *height >= 0.0);
            if is_full {
                full.get_or_insert(column);
            }
            if let Some(start) = full.filter(|_| !is_full || column + 2 == nodes) {
                let end = if is_full { column + 1 } else { column };
                let (x0, x1, y0, y1) = (place(start), place(end), place(row), place(row + 1));
                outlines.push(vec![(x0, y0), (x1, y0), (x1, y1), (x0, y1)]);
                full = None;
            }
            if is_full || heights.iter().all(|height| *height < 0.0) {
                continue;
            }
            let mut outline = Vec::new();
            for i in 0..4 {
                let next = (i + 1) % 4;
                let (here, there) = (corners[i], corners[next]);
                let (here, there) = ((place(here.0), place(here.1)), (place(there.0), place(there.1)));
                if heights[i] >= 0.0 {
                    outline.push(here);
                }
                if (heights[i] >= 0.0) != (heights[next] >= 0.0) {
                    let share = heights[i] / (heights[i] - heights[next]);
                    outline.push((here.0 + share * (there.0 - here.0), here.1 + share * (there.1 - here.1)));
                }
            }
            outlines.push(outline);
        }
    }
    outlines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(outlines: &[Vec<Point>]) -> f64 {
        let twice = |line: &Vec<Point>| -> f64 {
            (0..line.len())
                .map(|i| (line[i], line[(i + 1) % line.len()]))
                .map(|(a, b)| a.0 * b.1 - b.0 * a.1)
                .sum()
        };
        outlines.iter().map(|line| twice(line) / 2.0).sum()
    }

    #[test]
    fn everything_is_above_nothing() {
        assert!((area(&above(&[1.0; 25], 5, 0.0)) - 1.0).abs() < 1e-12);
        assert!(above(&[1.0; 25], 5, 2.0).is_empty());
    }

    #[test]
    fn a_cone_is_cut_in_a_circle() {
        // Height 1 − r/0.4 above the middle of the square; above 0.5 it is a circle of radius 0.2.
        let cells = 80;
        let middle = |i: usize| (i as f64 + 0.5) / cells as f64 - 0.5;
        let density: Vec<f64> =
            (0..cells * cells).map(|i| 1.0 - middle(i % cells).hypot(middle(i / cells)) / 0.4).collect();
        let circle = std::f64::consts::PI * 0.04;
        assert!((area(&above(&density, cells, 0.5)) - circle).abs() < 0.01 * circle);
    }
}
