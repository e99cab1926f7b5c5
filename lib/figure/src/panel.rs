//! A panel: a frame with two axes, and what is drawn between them.

use crate::axis::{Axis, LARGE, OVERHANG, SMALL};
use crate::scene::{Anchor, Color, Item, Paint, Point, Rect, area, color, line, text, turned_text};
use crate::{font, thin};

/// From the frame to a tick label.
const TICK: f64 = 2.5;
/// Below the frame: tick labels and the title of the axis.
const BELOW: f64 = TICK + SMALL + LARGE + 5.0;

/// What is shaded is as wide as this at the least.
const NARROWEST: f64 = 2.5;

/// How far the title of an axis may reach past the ends of its frame, on both sides together.
const PAST_THE_ENDS: f64 = 5.0;
const SECOND_LINE: f64 = LARGE + 1.5;

/// Room that a vertical axis, `length` points high, takes left of the frame: tick labels and title.
pub fn room_beside(axis: &Axis, length: f64) -> f64 {
    let lines = axis.title(length + PAST_THE_ENDS).len() as f64;
    TICK + axis.tick_width() + 4.0 + LARGE + 2.0 + SECOND_LINE * (lines - 1.0)
}

/// Room that a horizontal axis, `length` points long, takes below the frame.
pub fn room_below(axis: &Axis, length: f64) -> f64 {
    let lines = axis.title(length + PAST_THE_ENDS).len() as f64;
    BELOW + SECOND_LINE * (lines - 1.0)
}

/// A frame with two axes.
#[derive(Debug)]
pub struct Panel {
    /// Where it is, in millimetres.
    pub rect: Rect,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What the panel shows, for those who cannot see it.
    name: String,
    heading: Option<String>,
    /// From the left edge of the room for labels to the frame.
    beside: f64,
    /// How far a number below the frame may reach past its end.
    overhang: f64,
    with_x_labels: bool,
    with_y_labels: bool,
    /// What the frame cuts off.
    items: Vec<Item>,
    /// What it does not.
    notes: Vec<Item>,
}

impl Panel {
    /// An empty panel.
    pub fn new(name: impl Into<String>, rect: Rect, x: Axis, y: Axis) -> Self {
        Self {
            beside: room_beside(&y, rect.height()),
            rect,
            x,
            y,
            name: name.into(),
            heading: None,
            overhang: 8.0,
            with_x_labels: true,
            with_y_labels: true,
            items: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// A line of text above the frame.
    pub fn heading(mut self, heading: impl Into<String>) -> Self {
        self.heading = Some(heading.into());
        self
    }

    /// Room left of the frame, the same for panels above each other, so that their titles line up.
    pub fn beside(mut self, room: f64) -> Self {
        self.beside = room;
        self
    }

    /// Keep the numbers below the frame off those of the neighbours.
    pub fn among_neighbours(mut self) -> Self {
        self.overhang = OVERHANG;
        self
    }

    /// Leave the numbers and the title of the horizontal axis to a panel below.
    pub fn without_x_labels(mut self) -> Self {
        self.with_x_labels = false;
        self
    }

    /// Leave the numbers and the title of the vertical axis to a panel on the left.
    pub fn without_y_labels(mut self) -> Self {
        self.with_y_labels = false;
        self
    }

    /// Where the panel ends with its labels.
    pub fn foot(&self) -> f64 {
        self.rect.y1 + room_below(&self.x, self.rect.width())
    }

    /// Where a pair of values stands in the picture.
    pub fn at(&self, (x, y): Point) -> Point {
        (
            self.rect.x0 + self.x.span.place(x) * self.rect.width(),
            self.rect.y1 - self.y.span.place(y) * self.rect.height(),
        )
    }

    fn all_at(&self, points: impl IntoIterator<Item = Point>) -> Vec<Point> {
        points.into_iter().map(|point| self.at(point)).collect()
    }

    /// Add something that is in the picture's points already.
    pub fn add(&mut self, title: impl Into<String>, items: Vec<Item>) {
        self.items.push(Item::Group { class: "series", title: title.into(), clip: None, items });
    }

    /// Add something that may reach over the frame.
    pub fn note(&mut self, item: Item) {
        self.notes.push(item);
    }

    /// A line through pairs of values, in their order.
    pub fn line(&mut self, title: &str, points: impl IntoIterator<Item = Point>, paint: Paint) {
        let points = thin::line(&self.all_at(points));
        self.add(title, vec![line(points, paint)]);
    }

    /// Closed outlines.
    pub fn outlines(&mut self, title: &str, outlines: &[Vec<Point>], paint: Paint) {
        let lines = outlines.iter().map(|points| self.all_at(points.iter().copied())).collect();
        self.add(title, vec![Item::Path { lines, closed: true, paint }]);
    }

    /// The area between two curves over the same values of x, which may turn back.
    pub fn band(&mut self, title: &str, x: &[f64], low: &[f64], high: &[f64], paint: Paint) {
        let mut lines = Vec::new();
        for stretch in monotone_stretches(x) {
            let edge = |y: &[f64]| thin::line(&self.all_at(stretch.clone().map(|t| (x[t], y[t]))));
            let mut outline = edge(low);
            outline.extend(edge(high).into_iter().rev());
            // Stretches that overlap must turn the same way round, or they cut holes in each other.
            if x[stretch.end - 1] < x[stretch.start] {
                outline.reverse();
            }
            lines.push(outline);
        }
        self.add(title, vec![Item::Path { lines, closed: true, paint }]);
    }

    /// Dots at pairs of values, at most `most` of them: those that others hide are left out.
    pub fn dots(&mut self, title: &str, points: impl IntoIterator<Item = Point>, dot: Dot, most: usize) {
        let points = thin::dots(&self.all_at(points), most);
        let Dot { diameter, color, opacity } = dot;
        self.add(title, vec![Item::Dots { points, diameter, color, opacity }]);
    }

    /// Bars from `low` to `high` at each x.
    pub fn bars(&mut self, title: &str, bars: impl IntoIterator<Item = (f64, f64, f64)>, paint: Paint) {
        let lines =
            bars.into_iter().map(|(x, low, high)| vec![self.at((x, low)), self.at((x, high))]).collect();
        self.add(title, vec![Item::Path { lines, closed: false, paint }]);
    }

    /// A line across the panel at a value of x.
    pub fn vertical(&mut self, title: &str, x: f64, paint: Paint) {
        let (x, _) = self.at((x, self.y.span.low));
        self.add(title, vec![line(vec![(x, self.rect.y0), (x, self.rect.y1)], paint)]);
    }

    /// A line across the panel at a value of y.
    pub fn horizontal(&mut self, title: &str, y: f64, paint: Paint) {
        let (_, y) = self.at((self.x.span.low, y));
        self.add(title, vec![line(vec![(self.rect.x0, y), (self.rect.x1, y)], paint)]);
    }

    /// A stripe between two values of x, from the bottom up to a share of the height.
    pub fn stripe(&mut self, title: &str, (from, to): (f64, f64), share: f64, paint: Paint) {
        let ((x0, _), (x1, _)) = (self.at((from, self.y.span.low)), self.at((to, self.y.span.low)));
        let y0 = self.rect.y1 - share * self.rect.height();
        // One reading is seen, too.
        let more = (0.5 * (NARROWEST - (x1 - x0).abs())).max(0.0);
        let (left, right) = (x0.min(x1) - more, x0.max(x1) + more);
        let (x0, x1) = (left.max(self.rect.x0), right.min(self.rect.x1));
        self.add(title, vec![area(Rect { x0, x1, y0, ..self.rect }, paint)]);
    }

    /// The panel with its axes drawn.
    pub fn finish(self) -> Item {
        let Rect { x0, y0, x1, y1 } = self.rect;
        let frame = Paint::line(color::INK, 0.6);
        let mut axes = vec![Item::Path { lines: vec![self.rect.corners()], closed: true, paint: frame }];
        let x_at = |value: f64| x0 + self.x.span.place(value) * (x1 - x0);
        let y_at = |value: f64| y1 - self.y.span.place(value) * (y1 - y0);
        let mut marks = Vec::new();
        for (value, label) in &self.x.ticks {
            let x = x_at(*value);
            marks.push(vec![(x, y1), (x, y1 - 2.5)]);
            if self.with_x_labels {
                let reach = font::width(label, SMALL) / 2.0 - self.overhang;
                let x = x.min(x1 - reach).max(x0 + reach);
                axes.push(text((x, y1 + TICK + SMALL), label, SMALL, Anchor::Middle));
            }
        }
        for (value, label) in &self.y.ticks {
            let y = y_at(*value);
            marks.push(vec![(x0, y), (x0 + 2.5, y)]);
            if self.with_y_labels {
                axes.push(text((x0 - TICK, y + 0.36 * SMALL), label, SMALL, Anchor::End));
            }
        }
        marks.extend(self.x.minor.iter().map(|&value| vec![(x_at(value), y1), (x_at(value), y1 - 1.4)]));
        marks.extend(self.y.minor.iter().map(|&value| vec![(x0, y_at(value)), (x0 + 1.4, y_at(value))]));
        axes.push(Item::Path { lines: marks, closed: false, paint: frame });
        if self.with_x_labels {
            for (i, line) in self.x.title(x1 - x0 + PAST_THE_ENDS).into_iter().enumerate() {
                let y = y1 + BELOW - 3.5 + SECOND_LINE * i as f64;
                axes.push(text(((x0 + x1) / 2.0, y), line, LARGE, Anchor::Middle));
            }
        }
        if self.with_y_labels {
            for (i, line) in self.y.title(y1 - y0 + PAST_THE_ENDS).into_iter().enumerate() {
                let x = x0 - self.beside + LARGE + 1.0 + SECOND_LINE * i as f64;
                axes.push(turned_text((x, (y0 + y1) / 2.0), line, LARGE));
            }
        }
        if let Some(heading) = &self.heading {
            axes.push(text(((x0 + x1) / 2.0, y0 - 3.0), heading, SMALL, Anchor::Middle));
        }
        let inside =
            Item::Group { class: "data", title: String::new(), clip: Some(self.rect), items: self.items };
        axes.extend(self.notes);
        let axes = Item::Group { class: "axes", title: String::new(), clip: None, items: axes };
        Item::Group { class: "panel", title: self.name, clip: None, items: vec![inside, axes] }
    }
}

/// How a dot looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// Diameter, in millimetres.
    pub diameter: f64,
    /// Colour.
    pub color: Color,
    /// Opacity, from 0 to 1.
    pub opacity: f64,
}

impl Dot {
    /// Smaller and more transparent the more there are.
    pub fn among(count: usize, color: Color) -> Self {
        let diameter = match count {
            0..=50 => 3.2,
            51..=300 => 2.4,
            301..=2000 => 1.8,
            _ => 1.3,
        };
        Self { diameter, color, opacity: 0.85 }
    }
}

/// Ranges of steps within which a path never turns back; neighbours share their end.
fn monotone_stretches(x: &[f64]) -> Vec<std::ops::Range<usize>> {
    let mut stretches = Vec::new();
    let mut start = 0;
    let mut direction = 0.0;
    for t in 1..x.len() {
        let step = x[t] - x[t - 1];
        if step * direction < 0.0 {
            stretches.push(start..t);
            start = t - 1;
            direction = 0.0;
        }
        if step != 0.0 {
            direction = step;
        }
    }
    if x.len() > start {
        stretches.push(start..x.len());
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_cut_where_it_turns_back() {
        assert_eq!(monotone_stretches(&[0.0, 1.0, 2.0, 1.0, 0.0, 0.0, 3.0]), [0..3, 2..6, 5..7]);
        assert_eq!(monotone_stretches(&[1.0, 1.0, 2.0, 1.0]), [0..3, 2..4]);
        assert_eq!(monotone_stretches(&[]), []);
    }
}
