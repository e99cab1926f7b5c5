//! Every parameter against every other one: a triangle of panels.

use crate::axis::{Axis, Label, Span};
use crate::figure::{Figure, MARGIN};
use crate::panel::{Panel, room_below, room_beside};
use crate::scene::Rect;

/// Between neighbouring panels.
const GAP: f64 = 6.5;

/// Draw a panel for every pair of parameters below the diagonal, and one for each on it.
///
/// `single` and `pair` draw into the panels, which have the spans on their axes; `single` says how
/// high its panel reaches.
pub fn draw(
    figure: &mut Figure,
    spans: &[Span],
    labels: &[Label],
    highest: &[f64],
    single: impl Fn(&mut Panel, usize),
    pair: impl Fn(&mut Panel, usize, usize),
) {
    let n = spans.len();
    let widest = if n == 1 { 300.0 } else { 190.0 };
    let sizes = |beside: f64| {
        let room = figure.width - 2.0 * MARGIN - beside - 4.0;
        let width = (room / n as f64 - GAP).min(widest);
        (width, if n == 1 { 0.5 * width } else { 0.85 * width })
    };
    // The room for labels depends on the height of the panels, and that a little on the room.
    let (_, guess) = sizes(30.0);
    let beside = (1..n)
        .map(|row| room_beside(&Axis::vertical(spans[row], labels[row].clone(), guess), 0.9 * guess))
        .fold(room_beside(&Axis::bare(Span::of([]), Label::new("density")), guess), f64::max);
    let (width, height) = sizes(beside);
    let top = figure.y + 4.0;
    for row in 0..n {
        for column in 0..=row {
            let left = MARGIN + beside + (width + GAP) * column as f64;
            let upper = top + (height + GAP) * row as f64;
            let rect = Rect::new(left, upper, left + width, upper + height);
            let x = Axis::horizontal(spans[column], labels[column].clone(), width);
            let (name, y) = if row == column {
                let span = Span { low: 0.0, high: 1.1 * highest[row], log: false };
                (labels[row].name.clone(), Axis::bare(span, Label::new("density")))
            } else {
                let name = format!("{} against {}", labels[row].name, labels[column].name);
                (name, Axis::vertical(spans[row], labels[row].clone(), height))
            };
            let mut panel = Panel::new(name, rect, x, y).beside(beside).among_neighbours();
            if row + 1 < n {
                panel = panel.without_x_labels();
            }
            if column > 0 {
                panel = panel.without_y_labels();
            }
            if row == column {
                single(&mut panel, row);
            } else {
                pair(&mut panel, column, row);
            }
            figure.add(panel.finish());
        }
    }
    let below = (0..n)
        .map(|column| room_below(&Axis::horizontal(spans[column], labels[column].clone(), width), width))
        .fold(0.0, f64::max);
    figure.y = top + (height + GAP) * n as f64 - GAP + below;
}
