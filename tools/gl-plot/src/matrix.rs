//! Every parameter against every other one: a triangle of panels.

use crate::axis::{Axis, Label, Span};
use crate::figure::{Figure, MARGIN};
use crate::panel::{BELOW, Panel, room_beside};
use crate::scene::Rect;

/// Between neighbouring panels.
const GAP: f64 = 5.0;

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
    // Room for labels hardly depends on the height that they are made for.
    let beside = (1..n)
        .map(|row| room_beside(&Axis::vertical(spans[row], labels[row].clone(), 60.0)))
        .fold(room_beside(&Axis::bare(Span::of([]), Label::new("density"))), f64::max);
    let room = figure.width - 2.0 * MARGIN - beside - 4.0;
    let width = (room / n as f64 - GAP).min(190.0);
    let height = (0.85 * width).max(46.0);
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
            let mut panel = Panel::new(name, rect, x, y).beside(beside);
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
    figure.y = top + (height + GAP) * n as f64 - GAP + BELOW;
}
