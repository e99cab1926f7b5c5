//! What a picture is made of, before it becomes SVG or PNG: paths, dots and text in points (1/72 inch),
//! y downwards.

use crate::font;

/// A place in the picture.
pub type Point = (f64, f64);

/// A colour, 0xRRGGBB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub u32);

impl Color {
    /// Between two colours: `self` at 0, `other` at 1.
    pub fn towards(self, other: Self, share: f64) -> Self {
        let mixed = self.0.to_be_bytes().into_iter().zip(other.0.to_be_bytes()).fold(0, |mixed, (a, b)| {
            let channel = f64::from(a) + share * (f64::from(b) - f64::from(a));
            (mixed << 8) | channel.round() as u32
        });
        Self(mixed)
    }
}

/// Okabe & Ito's palette, which colour-blind readers can tell apart, and greys.
pub mod color {
    use super::Color;

    /// Black.
    pub const BLACK: Color = Color(0x00_0000);
    /// Text and axes.
    pub const INK: Color = Color(0x26_2626);
    /// Grey.
    pub const GREY: Color = Color(0x8c_8c8c);
    /// White.
    pub const WHITE: Color = Color(0xff_ffff);
    /// Blue.
    pub const BLUE: Color = Color(0x00_72b2);
    /// Sky blue.
    pub const SKY: Color = Color(0x56_b4e9);
    /// Bluish green.
    pub const GREEN: Color = Color(0x00_9e73);
    /// Vermilion.
    pub const VERMILION: Color = Color(0xd5_5e00);
    /// Orange.
    pub const ORANGE: Color = Color(0xe6_9f00);
    /// Reddish purple.
    pub const PURPLE: Color = Color(0xcc_79a7);

    /// For any number of series, in order.
    pub const SERIES: [Color; 6] = [BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY];
}

/// How something is painted: a line, an area, or both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paint {
    /// Colour and width in millimetres of the line, if there is one.
    pub stroke: Option<(Color, f64)>,
    /// Colour of the area, if it is filled.
    pub fill: Option<Color>,
    /// Opacity, from 0 to 1.
    pub opacity: f64,
    /// Lengths of the dash and of the space after it.
    pub dash: Option<(f64, f64)>,
}

impl Paint {
    /// A line of this width, in millimetres.
    pub fn line(color: Color, width: f64) -> Self {
        Self { stroke: Some((color, width)), fill: None, opacity: 1.0, dash: None }
    }

    /// A filled area without an outline.
    pub fn area(color: Color) -> Self {
        Self { stroke: None, fill: Some(color), opacity: 1.0, dash: None }
    }

    /// The same, this opaque (0 to 1).
    pub fn opacity(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    /// The same with dashes and gaps of these lengths, in millimetres.
    pub fn dashed(self, on: f64, off: f64) -> Self {
        Self { dash: Some((on, off)), ..self }
    }
}

/// On which side of its place a text ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The text begins there.
    Start,
    /// The text is centred there.
    Middle,
    /// The text ends there.
    End,
}

/// A rectangle: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    /// Left.
    pub x0: f64,
    /// Top.
    pub y0: f64,
    /// Right.
    pub x1: f64,
    /// Bottom.
    pub y1: f64,
}

impl Rect {
    /// From its corners, in millimetres.
    pub fn new(x0: f64, y0: f64, x1: f64, y1: f64) -> Self {
        Self { x0, y0, x1, y1 }
    }

    /// Width, in millimetres.
    pub fn width(&self) -> f64 {
        self.x1 - self.x0
    }

    /// Height, in millimetres.
    pub fn height(&self) -> f64 {
        self.y1 - self.y0
    }

    /// The four corners, in order.
    pub fn corners(&self) -> Vec<Point> {
        vec![(self.x0, self.y0), (self.x1, self.y0), (self.x1, self.y1), (self.x0, self.y1)]
    }
}

/// One thing to paint.
#[derive(Clone, Debug)]
pub enum Item {
    /// Lines or areas.
    Path {
        /// The points of each line.
        lines: Vec<Vec<Point>>,
        /// Whether the last point is joined to the first.
        closed: bool,
        /// How it is painted.
        paint: Paint,
    },
    /// Round dots of one kind, in one stroke: where they overlap they do not add up.
    Dots {
        /// The centres.
        points: Vec<Point>,
        /// Diameter, in millimetres.
        diameter: f64,
        /// Colour.
        color: Color,
        /// Opacity, from 0 to 1.
        opacity: f64,
    },
    /// A line of text.
    Text {
        /// Where it is anchored.
        at: Point,
        /// What it says.
        text: String,
        /// Height of the letters, in millimetres.
        size: f64,
        /// Which part of it is at the anchor.
        anchor: Anchor,
        /// Upright along the y axis, read from below.
        turned: bool,
        /// Colour.
        color: Color,
    },
    /// Things that belong together; a clip cuts off what lies outside it.
    Group {
        /// What kind of group it is.
        class: &'static str,
        /// What a reader without eyes is told.
        title: String,
        /// What lies outside is not drawn.
        clip: Option<Rect>,
        /// What is in it, from the back to the front.
        items: Vec<Item>,
    },
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Width, in millimetres.
    pub width: f64,
    /// Height, in millimetres.
    pub height: f64,
    /// What a reader without eyes is told.
    pub title: String,
    /// What is in it, from the back to the front.
    pub items: Vec<Item>,
}

/// Points in a millimetre.
pub const MM: f64 = 72.0 / 25.4;

/// A line through points.
pub fn line(points: Vec<Point>, paint: Paint) -> Item {
    Item::Path { lines: vec![points], closed: false, paint }
}

/// A filled rectangle.
pub fn area(rect: Rect, paint: Paint) -> Item {
    Item::Path { lines: vec![rect.corners()], closed: true, paint }
}

/// Horizontal text.
pub fn text(at: Point, text: impl Into<String>, size: f64, anchor: Anchor) -> Item {
    Item::Text { at, text: text.into(), size, anchor, turned: false, color: color::INK }
}

/// Text read from below.
pub fn turned_text(at: Point, text: impl Into<String>, size: f64) -> Item {
    Item::Text { at, text: text.into(), size, anchor: Anchor::Middle, turned: true, color: color::INK }
}

/// A star of five points.
pub fn star((x, y): Point, radius: f64, paint: Paint) -> Item {
    let corner = |i: u32| {
        let angle = std::f64::consts::PI * (f64::from(i) / 5.0 - 0.5);
        let reach = if i.is_multiple_of(2) { radius } else { 0.4 * radius };
        (x + reach * angle.cos(), y + reach * angle.sin())
    };
    Item::Path { lines: vec![(0..10).map(corner).collect()], closed: true, paint }
}

/// The text, or as much of it as fits into `width` with an ellipsis.
pub fn fitted(text: &str, size: f64, width: f64) -> String {
    if font::width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept = text.to_owned();
    while kept.pop().is_some() {
        let shorter = format!("{}…", kept.trim_end());
        if font::width(&shorter, size) <= width {
            return shorter;
        }
    }
    "…".to_owned()
}
