//! A figure: legend above, panels in rows below it, as high as what is in it.

use crate::axis::SMALL;
use crate::font;
use crate::panel::Dot;
use crate::scene::{Anchor, Color, Item, MM, Paint, Rect, Scene, area, color, line, star, text};

/// Room around everything.
pub const MARGIN: f64 = 4.0;

/// A picture that grows downwards.
#[derive(Debug)]
pub struct Figure {
    /// Width, in millimetres.
    pub width: f64,
    /// Where the next thing goes.
    pub y: f64,
    title: String,
    items: Vec<Item>,
}

/// What stands for a series in a legend.
#[derive(Clone, Copy, Debug)]
pub enum Key {
    /// A line.
    Line(Paint),
    /// A filled area.
    Area(Paint),
    /// An area with lines along its ends.
    Band(Paint, Paint),
    /// A dot.
    Dot(Dot),
    /// A star, for what fits best or is true.
    Star(Color),
}

/// Between panels that share their labels.
const GAP: f64 = 9.0;
const KEY_WIDTH: f64 = 14.0;
const BETWEEN: f64 = 12.0;
const LINE_HEIGHT: f64 = 11.0;

impl Figure {
    /// An empty figure, `width_mm` wide; the title is for those who cannot see it.
    pub fn new(title: impl Into<String>, width_mm: f64) -> Self {
        Self { width: width_mm * MM, y: MARGIN, title: title.into(), items: Vec::new() }
    }

    /// Put something into the scene, above what is there.
    pub fn add(&mut self, item: Item) {
        self.items.push(item);
    }

    /// A legend across the figure, in as many lines as it needs.
    pub fn legend(&mut self, entries: &[(Key, String)]) {
        let mut x = 2.0 * MARGIN;
        let mut items = Vec::new();
        for (key, label) in entries {
            let needed = KEY_WIDTH + 3.0 + font::width(label, SMALL);
            if x > 2.0 * MARGIN && x + needed > self.width - MARGIN {
                x = 2.0 * MARGIN;
                self.y += LINE_HEIGHT;
            }
            let middle = self.y + LINE_HEIGHT / 2.0;
            items.push(symbol(*key, x, middle));
            items.push(text((x + KEY_WIDTH + 3.0, middle + 0.36 * SMALL), label, SMALL, Anchor::Start));
            x += needed + BETWEEN;
        }
        self.y += LINE_HEIGHT + 3.0;
        self.add(Item::Group { class: "legend", title: String::new(), clip: None, items });
    }

    /// How many cells of at least `least` points fit side by side, for `count` cells in even rows.
    pub fn columns(&self, count: usize, least: f64) -> usize {
        let most = ((self.width - 2.0 * MARGIN) / least).floor().max(1.0) as usize;
        let rows = count.div_ceil(most).max(1);
        count.div_ceil(rows).max(1)
    }

    /// Left and right end of a cell.
    pub fn cell(&self, column: usize, columns: usize) -> (f64, f64) {
        let width = (self.width - 2.0 * MARGIN) / columns as f64;
        (MARGIN + width * column as f64, MARGIN + width * (column + 1) as f64)
    }

    /// Panels side by side that share the labels on their left, which take `beside` points.
    pub fn shared_cell(&self, column: usize, columns: usize, beside: f64) -> (f64, f64) {
        let left = MARGIN + beside;
        let width = (self.width - MARGIN - 5.0 - left + GAP) / columns as f64;
        let start = left + width * column as f64;
        (start, start + width - GAP)
    }

    /// The scene, with its legend.
    pub fn finish(self) -> Scene {
        Scene { width: self.width, height: self.y + MARGIN, title: self.title, items: self.items }
    }
}

fn symbol(key: Key, x: f64, y: f64) -> Item {
    let middle = (x + KEY_WIDTH / 2.0, y);
    match key {
        Key::Line(paint) => line(vec![(x, y), (x + KEY_WIDTH, y)], paint),
        Key::Area(paint) => area(Rect::new(x, y - 3.0, x + KEY_WIDTH, y + 3.0), paint),
        Key::Band(inside, edge) => {
            let band = Rect::new(x, y - 3.0, x + KEY_WIDTH, y + 3.0);
            let lines = vec![
                vec![(x, y - 3.0), (x + KEY_WIDTH, y - 3.0)],
                vec![(x, y + 3.0), (x + KEY_WIDTH, y + 3.0)],
            ];
            let items = vec![area(band, inside), Item::Path { lines, closed: false, paint: edge }];
            Item::Group { class: "key", title: String::new(), clip: None, items }
        }
        Key::Dot(Dot { diameter, color, opacity }) => {
            Item::Dots { points: vec![middle], diameter: diameter.max(2.4), color, opacity }
        }
        Key::Star(fill) => star(middle, 5.0, star_paint(fill)),
    }
}

/// A star that stands out of whatever is behind it.
pub fn star_paint(fill: Color) -> Paint {
    Paint { stroke: Some((color::WHITE, 0.7)), ..Paint::area(fill) }
}
