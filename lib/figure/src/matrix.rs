//! Every parameter against every other one: a triangle of panels.

use crate::axis::{Axis, Label, SMALL, Span};
use crate::figure::{Figure, MARGIN};
use crate::panel::{Panel, room_below, room_beside};
use crate::scene::Rect;

/// Between neighbouring panels.
const GAP: f64 = 9.0;

/// What a triangle of panels has on its axes, one of each a parameter.
#[derive(Debug)]
pub struct Matrix {
    /// What its axes span.
    pub spans: Vec<Span>,
    /// What they are called.
    pub labels: Vec<Label>,
    /// How high its panel on the diagonal reaches.
    pub highest: Vec<f64>,
    /// What stands above that panel; may be empty.
    pub headings: Vec<String>,
}

/// Where the panels stand.
struct Layout {
    top: f64,
    beside: f64,
    width: f64,
    height: f64,
}

impl Matrix {
    /// How wide a panel is, and how high, where labels take so much room beside it.
    fn size(&self, figure: &Figure, beside: f64) -> (f64, f64) {
        let n = self.spans.len();
        let room = figure.width - 2.0 * MARGIN - beside - 4.0;
        let width = (room / n as f64 - GAP).min(if n == 1 { 300.0 } else { 190.0 });
        (width, if n == 1 { 0.5 * width } else { 0.85 * width })
    }

    fn layout(&self, figure: &Figure) -> Layout {
        // The room for labels depends on the height of the panels, and that a little on the room.
        let (_, guess) = self.size(figure, 30.0);
        let beside = (1..self.spans.len())
            .map(|row| room_beside(&self.up(row, guess), 0.9 * guess))
            .fold(room_beside(&Axis::bare(Span::of([]), Label::new("density")), guess), f64::max);
        let (width, height) = self.size(figure, beside);
        let heading = if self.headings.iter().all(String::is_empty) { 0.0 } else { SMALL + 1.0 };
        Layout { top: figure.y + 4.0 + heading, beside, width, height }
    }

    fn up(&self, row: usize, height: f64) -> Axis {
        Axis::vertical(self.spans[row], self.labels[row].clone(), height)
    }

    fn along(&self, column: usize, width: f64) -> Axis {
        Axis::horizontal(self.spans[column], self.labels[column].clone(), width)
    }

    /// The panel of two parameters, or of one.
    fn panel(&self, layout: &Layout, column: usize, row: usize) -> Panel {
        let left = MARGIN + layout.beside + (layout.width + GAP) * column as f64;
        let upper = layout.top + (layout.height + GAP) * row as f64;
        let rect = Rect::new(left, upper, left + layout.width, upper + layout.height);
        let (name, y) = if row == column {
            let span = Span { low: 0.0, high: 1.1 * self.highest[row], log: false };
            (self.labels[row].name.clone(), Axis::bare(span, Label::new("density")))
        } else {
            let name = format!("{} against {}", self.labels[row].name, self.labels[column].name);
            (name, self.up(row, layout.height))
        };
        let mut panel = Panel::new(name, rect, self.along(column, layout.width), y);
        panel = panel.beside(layout.beside).among_neighbours();
        if row == column && !self.headings[row].is_empty() {
            panel = panel.heading(self.headings[row].clone());
        }
        if row + 1 < self.spans.len() {
            panel = panel.without_x_labels();
        }
        if column > 0 { panel.without_y_labels() } else { panel }
    }

    /// Draw a panel for every pair of parameters below the diagonal, and one for each on it.
    ///
    /// `single` and `pair` draw into the panels.
    pub fn draw(
        &self,
        figure: &mut Figure,
        single: impl Fn(&mut Panel, usize),
        pair: impl Fn(&mut Panel, usize, usize),
    ) {
        let n = self.spans.len();
        let layout = self.layout(figure);
        for row in 0..n {
            for column in 0..=row {
                let mut panel = self.panel(&layout, column, row);
                if row == column {
                    single(&mut panel, row);
                } else {
                    pair(&mut panel, column, row);
                }
                figure.add(panel.finish());
            }
        }
        let below = (0..n)
            .map(|column| room_below(&self.along(column, layout.width), layout.width))
            .fold(0.0, f64::max);
        figure.y = layout.top + (layout.height + GAP) * n as f64 - GAP + below;
    }

    /// How wide a heading may be: the panels above the diagonal are empty, but the figure ends.
    pub fn heading_width(n: usize, figure_width: f64) -> f64 {
        let width = (figure_width - 2.0 * MARGIN - 40.0) / n as f64 - GAP;
        width + if n > 1 { GAP } else { 0.0 }
    }
}
