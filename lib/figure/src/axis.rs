//! Axes: where values stand, which of them are marked, and how the marks are written.

use gl_inference::prior::{Parameter, Scale};

use crate::font;
use crate::number::{superscript, written};
use crate::scene::fitted;

/// Size of tick labels and of legends, in points.
pub const SMALL: f64 = 7.0;
/// How far a number below the frame may reach past its end, where there are neighbours.
pub const OVERHANG: f64 = 1.5;
/// Between two tick labels side by side, in points.
const BETWEEN_LABELS: f64 = 4.0;
/// Size of axis labels, in points.
pub const LARGE: f64 = 8.0;

/// What an axis shows: the name of a column, and its unit where one is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Label {
    /// What is drawn along it.
    pub name: String,
    /// Its unit, if it has one.
    pub unit: Option<String>,
}

impl Label {
    /// A quantity without a unit.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), unit: None }
    }
}

/// ln of the smallest value that a logarithmic axis shows, and less the sign that of the largest.
const LN_LEAST: f64 = -700.0;

/// What is smaller is nothing to a picture: powers of ten below it are no normal numbers.
const LEAST: f64 = 1e-290;

/// How far outside an axis a value stands at the most, in lengths of the axis.
const FAR: f64 = 1e4;

/// The largest value that an axis shows: its range must be a number.
const LARGEST: f64 = 1e300;

/// The values that an axis spans, and whether evenly in their logarithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Whether it is even in the logarithm.
    pub log: bool,
}

impl Span {
    /// From the smallest to the largest of some values; 0 to 1 if there are none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let empty = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, log: false };
        let span = values
            .into_iter()
            .filter(|value| value.abs() <= LARGEST)
            .fold(empty, |span, value| Self { low: span.low.min(value), high: span.high.max(value), ..span });
        if span.low > span.high { Self { low: 0.0, high: 1.0, log: false } } else { span }
    }

    /// The bounds of a parameter, on its scale.
    pub fn of_bounds(parameter: &Parameter) -> Self {
        Self { low: parameter.lower, high: parameter.upper, log: parameter.scale == Scale::Log }
    }

    /// The same values, evenly in their logarithm; unchanged where one is not positive.
    pub fn logarithmic(self) -> Self {
        Self { log: self.low.ln() > LN_LEAST, ..self }
    }

    /// A little wider on both sides, so that nothing lies on the frame; a single value gets room.
    pub fn padded(self, share: f64) -> Self {
        if self.log {
            let room = share * self.ln_range();
            let room = if room > 0.0 { room } else { 0.5 };
            let (low, high) = (self.low.ln() - room, self.high.ln() + room);
            return Self { low: low.max(LN_LEAST).exp(), high: high.min(-LN_LEAST).exp(), log: true };
        }
        let room = share * (self.high - self.low);
        // Rounding noise on a constant is no range to look at.
        let magnitude = self.low.abs().max(self.high.abs());
        let constant = self.high - self.low <= (1e-12 * magnitude).max(LEAST);
        let room = if !constant && room > 0.0 {
            room
        } else if magnitude > LEAST {
            0.1 * magnitude
        } else {
            0.5
        };
        Self { low: self.low - room, high: self.high + room, log: false }
    }

    /// ln of the upper end over the lower one.
    fn ln_range(&self) -> f64 {
        self.high.ln() - self.low.ln()
    }

    /// Wide enough for a value too.
    pub fn with(self, value: f64) -> Self {
        Self { low: self.low.min(value), high: self.high.max(value), ..self }
    }

    /// Place of a value: 0 at the lower end, 1 at the upper one; within ten thousand lengths of them.
    pub fn place(&self, value: f64) -> f64 {
        let place = if self.log {
            (value.ln() - self.low.ln()) / self.ln_range()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        // Where the ends are one, everything is in the middle.
        if place.is_nan() { 0.5 } else { place.clamp(-FAR, FAR) }
    }

    /// The value at a place; see [`Span::place`].
    pub fn value(&self, place: f64) -> f64 {
        if self.log {
            (self.low.ln() + place * self.ln_range()).exp()
        } else {
            self.low + place * (self.high - self.low)
        }
    }
}

/// An axis with its marks.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What the axis spans.
    pub span: Span,
    /// Marked values and what is written beside them.
    pub ticks: Vec<(f64, String)>,
    /// Marks without a label.
    pub minor: Vec<f64>,
    label: Label,
    exponent: i32,
}

impl Axis {
    /// An axis along the bottom, `length` points long: as many marks as their labels leave room for.
    pub fn horizontal(span: Span, label: Label, length: f64) -> Self {
        let fits = |axis: &Self| axis.labels_part(length);
        let most = (length / 20.0).clamp(2.0, 8.0) as usize;
        let tries = (2..=most).rev().map(|count| Self::with_ticks(span, label.clone(), count));
        let mut last = None;
        for axis in tries {
            if fits(&axis) {
                return axis;
            }
            last = Some(axis);
        }
        let mut axis = last.unwrap_or_else(|| Self::with_ticks(span, label, 2));
        while axis.ticks.len() > 2 && !fits(&axis) {
            let every_second = axis.ticks.iter().skip(1).step_by(2);
            axis.minor.extend(every_second.map(|(value, _)| *value));
            axis.ticks = axis.ticks.into_iter().step_by(2).collect();
        }
        if axis.ticks.len() == 2 && !fits(&axis) {
            axis.minor.extend(axis.ticks.pop().map(|(value, _)| value));
        }
        axis
    }

    /// Whether no two labels come near each other along `length` points. On a logarithmic axis marks are
    /// not evenly apart.
    fn labels_part(&self, length: f64) -> bool {
        let mut ends: Vec<(f64, f64)> = self
            .ticks
            .iter()
            .map(|(value, text)| (self.span.place(*value) * length, font::width(text, SMALL) / 2.0))
            .map(|(middle, half)| {
                // Those at the ends are kept off the neighbours.
                let middle = middle.min(length - half + OVERHANG).max(half - OVERHANG);
                (middle - half, middle + half)
            })
            .collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_narrow = self.ticks.iter().all(|(_, text)| font::width(text, SMALL) <= length);
        is_narrow && ends.windows(2).all(|pair| pair[0].1 + BETWEEN_LABELS <= pair[1].0)
    }

    /// An axis up the side, `length` points high.
    pub fn vertical(span: Span, label: Label, length: f64) -> Self {
        Self::with_ticks(span, label, (length / 11.0).clamp(2.0, 7.0) as usize)
    }

    /// An axis along the bottom that counts: marks at whole numbers only.
    pub fn counting(span: Span, label: Label, length: f64) -> Self {
        let whole = Span { low: span.low.ceil(), high: span.high.floor(), ..span };
        let widest = font::width(&whole.high.to_string(), SMALL) + 4.0;
        if (whole.high - whole.low + 1.0) * widest > length {
            return Self::horizontal(span, label, length);
        }
        let ticks = (whole.low as i64..=whole.high as i64).map(|i| (i as f64, i.to_string()));
        Self { ticks: ticks.collect(), ..Self::bare(span, label) }
    }

    /// An axis without numbers, for heights that mean nothing by themselves.
    pub fn bare(span: Span, label: Label) -> Self {
        Self { span, ticks: Vec::new(), minor: Vec::new(), label, exponent: 0 }
    }

    fn with_ticks(span: Span, label: Label, count: usize) -> Self {
        let decades = span.high.log10() - span.low.log10();
        if span.log && decades >= 2.0 {
            return Self::decades(span, label, count);
        }
        let mut ticks = if span.log { one_two_five(span, count) } else { Vec::new() };
        // Round numbers that are too far apart for two of them say nothing about the scale.
        for more in count..2 * count + 4 {
            if ticks.len() >= 2 {
                break;
            }
            ticks = multiples(span, more);
        }
        let largest = ticks.iter().fold(0.0_f64, |largest, tick| largest.max(tick.abs()));
        let magnitude = if largest > LEAST { (largest.log10() + 1e-9).floor() as i32 } else { 0 };
        let exponent = if (-2..4).contains(&magnitude) { 0 } else { magnitude.div_euclid(3) * 3 };
        let unit = 10.0_f64.powi(exponent);
        let decimals = decimals(&ticks, unit);
        let ticks = ticks.into_iter().map(|tick| (tick, written(tick / unit, decimals))).collect();
        Self { span, ticks, minor: Vec::new(), label, exponent }
    }

    fn decades(span: Span, label: Label, count: usize) -> Self {
        let (first, last) =
            ((span.low.log10() - 1e-9).ceil() as i32, (span.high.log10() + 1e-9).floor() as i32);
        let stride = ((last - first + 1) as usize).div_ceil(count.max(1)).max(1);
        let ticks = (first..=last)
            .filter(|power| power.rem_euclid(stride as i32) == 0)
            .map(|power| (10.0_f64.powi(power), format!("10{}", superscript(power))))
            .collect();
        // Where each decade had one, many would be a thick line.
        let minor = if stride > MOST_STRIDE {
            Vec::new()
        } else if stride > 1 {
            (first..=last).map(|power| 10.0_f64.powi(power)).collect()
        } else {
            (first - 1..=last)
                .flat_map(|power| (2..10).map(move |digit| f64::from(digit) * 10.0_f64.powi(power)))
                .filter(|value| (span.low..=span.high).contains(value))
                .collect()
        };
        Self { span, ticks, minor, label, exponent: 0 }
    }

    /// What is written along the axis in at most `length` points: the name, the unit, and the power of
    /// ten that the marks leave out. Where that is too long, the name has a line for itself.
    pub fn title(&self, length: f64) -> Vec<String> {
        let power =
            if self.exponent == 0 { String::new() } else { format!("×10{}", superscript(self.exponent)) };
        let unit = self.label.unit.as_deref().unwrap_or("");
        let inside = format!("{power} {unit}");
        let suffix = match inside.trim() {
            "" => String::new(),
            inside => format!("({inside})"),
        };
        let whole = format!("{} {suffix}", self.label.name).trim_end().to_owned();
        if suffix.is_empty() || font::width(&whole, LARGE) <= length {
            return vec![fitted(&whole, LARGE, length)];
        }
        vec![fitted(&self.label.name, LARGE, length), fitted(&suffix, LARGE, length)]
    }

    /// Width of the widest tick label, in points.
    pub fn tick_width(&self) -> f64 {
        self.ticks.iter().map(|(_, text)| font::width(text, SMALL)).fold(0.0, f64::max)
    }
}

/// The most decades from one number on an axis to the next that still have marks between them.
const MOST_STRIDE: usize = 10;

/// Multiples of 1, 2 or 5 times a power of ten: as many as there may be, at most `most`.
fn multiples(span: Span, most: usize) -> Vec<f64> {
    let range = span.high - span.low;
    if !(range.is_finite() && range > LEAST) {
        return vec![if span.low.abs() > LEAST { span.low } else { 0.0 }];
    }
    let first = (range / most.max(1) as f64).log10().floor() as i32;
    (first..first + 3)
        .flat_map(|power| [1.0, 2.0, 5.0].map(|digit| (digit, power)))
        .map(|(digit, power)| multiples_of(digit, power, span))
        .find(|ticks| ticks.len() <= most)
        .unwrap_or_default()
}

fn multiples_of(digit: f64, power: i32, span: Span) -> Vec<f64> {
    // Whole numbers first, then the power of ten: 3 × 0.1 would be 0.30000000000000004.
    let unit = 10.0_f64.powi(power.abs());
    let value = |whole: f64| if power < 0 { whole * digit / unit } else { whole * digit * unit };
    let slack = 1e-9 * (span.high - span.low);
    let (first, last) = ((span.low - slack) / value(1.0), (span.high + slack) / value(1.0));
    (first.ceil() as i64..=last.floor() as i64).map(|whole| value(whole as f64)).collect()
}

fn one_two_five(span: Span, count: usize) -> Vec<f64> {
    let (first, last) = (span.low.log10().floor() as i32, span.high.log10().ceil() as i32);
    let among = |digits: &[f64]| -> Vec<f64> {
        (first..=last)
            .flat_map(|power| digits.iter().map(move |digit| digit * 10.0_f64.powi(power)))
            .filter(|value| (span.low * (1.0 - 1e-9)..=span.high * (1.0 + 1e-9)).contains(value))
            .collect()
    };
    [&[1.0, 2.0, 3.0, 5.0][..], &[1.0, 2.0, 5.0], &[1.0, 3.0], &[1.0]]
        .into_iter()
        .map(among)
        .find(|ticks| ticks.len() <= count)
        .unwrap_or_default()
}

/// Decimals that tell every tick exactly, at most 9.
fn decimals(ticks: &[f64], unit: f64) -> usize {
    let gap = ticks.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(f64::INFINITY, f64::min);
    let tolerance =
        1e-3 * if gap.is_finite() { gap } else { ticks.first().map_or(1.0, |tick| tick.abs()) } / unit;
    (0..9)
        .find(|&decimals| {
            let power = 10.0_f64.powi(decimals);
            ticks.iter().all(|tick| {
                let value = tick / unit;
                ((value * power).round() / power - value).abs() <= tolerance
            })
        })
        .unwrap_or(9) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, log: bool) -> Vec<String> {
        let axis = Axis::horizontal(Span { low, high, log }, Label::new("x"), 150.0);
        axis.ticks.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(0.0, 1.0, false), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(-0.03, 0.21, false), ["0.00", "0.05", "0.10", "0.15", "0.20"]);
        assert_eq!(labels(-2.0, 2.0, false), ["−2", "−1", "0", "1", "2"]);
    }

    #[test]
    fn many_decades_have_no_marks_between_their_numbers() {
        let minor =
            |high: f64| Axis::horizontal(Span { low: 1.0, high, log: true }, Label::new("x"), 60.0).minor;
        assert_eq!(minor(1e10).len(), 11);
        assert!(minor(1e90).is_empty());
    }

    #[test]
    fn large_numbers_leave_their_power_to_the_title() {
        let label = Label { name: "E".to_owned(), unit: Some("Pa".to_owned()) };
        let axis = Axis::horizontal(Span { low: 1e11, high: 2e11, log: false }, label, 150.0);
        assert_eq!(axis.title(100.0), ["E (×10⁹ Pa)"]);
        assert_eq!(axis.title(45.0), ["E", "(×10⁹ Pa)"]);
        assert_eq!(axis.ticks[0], (1e11, "100".to_owned()));
    }

    #[test]
    fn small_numbers_leave_their_power_to_the_title() {
        let axis = Axis::vertical(Span { low: 0.0, high: 3.1e-5, log: false }, Label::new("gap"), 100.0);
        assert_eq!(axis.title(100.0), ["gap (×10⁻⁶)"]);
    }

    #[test]
    fn a_log_axis_marks_decades_or_what_lies_within_one() {
        assert_eq!(labels(1.0, 1e4, true), ["10⁰", "10¹", "10²", "10³", "10⁴"]);
        assert_eq!(labels(1.0, 10.0, true), ["1", "2", "3", "5", "10"]);
        assert!(labels(100.0, 120.0, true).len() >= 2);
    }

    #[test]
    fn labels_of_a_log_axis_do_not_touch() {
        // Within a decade 2000 and 3000 are nearer than 3000 and 5000.
        for length in [40.0, 60.0, 80.0, 110.0, 150.0] {
            for (low, high) in [(900.0, 6000.0), (1e3, 9e4), (0.3, 10.0), (1e-9, 1e7)] {
                let axis = Axis::horizontal(Span { low, high, log: true }, Label::new("x"), length);
                assert!(!axis.ticks.is_empty() && axis.labels_part(length));
            }
        }
    }

    #[test]
    fn no_two_ticks_read_alike_even_far_from_zero() {
        let texts = labels(0.391_05, 0.391_12, false);
        let mut unique = texts.clone();
        unique.dedup();
        assert_eq!(texts, unique);
        assert!(texts.len() >= 2);
    }

    #[test]
    fn a_constant_gets_an_axis_around_it() {
        for value in [0.0, 5.0, -1e11] {
            let span = Span::of([value, value]).padded(0.05);
            assert!(span.low < value && value < span.high);
        }
    }
}
