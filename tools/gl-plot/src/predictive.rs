//! Whether the measurement looks like a draw from the posterior predictive distribution.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Paint, Rect, Scene, color};
use gl_inference::loo::{Count, Histogram, Reading};
use gl_table::Table;

use crate::Style;
use crate::branches::{ABOVE, Branches};
use crate::input::check_panels;
use gl_inference::units::Units;

/// Each reading against what the others predict of it, and how even their places in it are
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Predictive {
    /// Name of the control
    #[arg(short, long, value_name = "NAME", default_value = "control")]
    control: String,
    /// Unit of columns, as in q=MPa,u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Table of gl-posterior --loo-out
    #[arg(value_name = "LOO", default_value = "-")]
    readings: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'observable step control measured q05 q25 q50 q75 q95 pit k\\n' > loo.txt
  printf 'f 0 0 1.1 .8 .9 1 1.1 1.2 .75 .1\\n' >> loo.txt
  printf 'f 1 1 2.3 1.8 1.9 2 2.1 2.2 .98 .2\\n' >> loo.txt
  gl-plot predictive -c u --units u=mm,f=kN loo.txt -o predictive.svg";

/// The readings of one observable.
struct Own<'a> {
    name: &'a str,
    readings: Vec<&'a Reading>,
    /// Value of the control, or number of the step where the control turns back.
    x: Vec<f64>,
    along: Label,
    /// Where the control turns back, and the number of the first step.
    branches: (Branches, usize),
    unit: Option<String>,
}

impl Predictive {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let table = Table::read(&self.readings)?;
        let readings: Vec<Reading> = table.rows()?;
        let source = table.format().source();
        ensure!(!readings.is_empty(), "{source}: no rows; there is nothing to draw");
        let mut names: Vec<&str> = Vec::new();
        for reading in &readings {
            if !names.contains(&reading.observable.as_str()) {
                names.push(&reading.observable);
                check_panels(source, names.len())?;
            }
        }
        let mut figure = Figure::new("Each reading against what the others predict of it", style.width);
        figure.legend(&[
            (Key::Dot(inside(50)), "measured".to_owned()),
            (Key::Dot(outside(50)), "beyond the 90 % band".to_owned()),
            (Key::Area(wide()), "90 % band of the others".to_owned()),
            (Key::Area(narrow()), "50 % band".to_owned()),
            (Key::Area(even()), "as many as chance leaves".to_owned()),
        ]);
        // Wide enough for the counts above the bars.
        let columns = figure.columns(names.len(), 215.0);
        for row in names.chunks(columns) {
            let mut foot = figure.y;
            for (place, name) in row.iter().enumerate() {
                foot = foot.max(self.own(name, &readings).draw(&mut figure, place, columns));
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    fn own<'a>(&self, name: &'a str, readings: &'a [Reading]) -> Own<'a> {
        let readings: Vec<&Reading> = readings.iter().filter(|reading| reading.observable == name).collect();
        let control: Vec<f64> = readings.iter().map(|reading| reading.control).collect();
        let branches = Branches::of(&control);
        // An observable of one of several tests is called test.observable, and has the unit of the observable.
        let unit = self
            .units
            .get(name)
            .or_else(|| self.units.get(name.split_once('.').map_or(name, |(_, own)| own)))
            .map(str::to_owned);
        let (x, along) = if branches.turns() {
            (readings.iter().map(|reading| reading.step as f64).collect(), Label::new("step"))
        } else {
            (
                control,
                Label { name: self.control.clone(), unit: self.units.get(&self.control).map(str::to_owned) },
            )
        };
        let first = readings.first().map_or(0, |reading| reading.step as usize);
        Own { name, readings, x, along, branches: (branches, first), unit }
    }
}

impl Own<'_> {
    /// Draw the readings less the median, with the bands, and below them the histogram; where it ends.
    fn draw(&self, figure: &mut Figure, place: usize, columns: usize) -> f64 {
        let (left, right) = figure.cell(place, columns);
        let height = (0.55 * (right - left)).clamp(85.0, 150.0);
        let low = 0.62 * height;
        let less = |of: fn(&Reading) -> f64| -> Vec<f64> {
            self.readings.iter().map(|reading| of(reading) - reading.q50).collect()
        };
        let measured = less(|reading| reading.measured);
        let ends: [Vec<f64>; 4] = [
            less(|reading| reading.q05),
            less(|reading| reading.q95),
            less(|reading| reading.q25),
            less(|reading| reading.q75),
        ];
        let span = Span::of(ends.iter().chain([&measured]).flatten().copied()).with(0.0).padded(0.06);
        let label = Label { name: format!("{} less the median", self.name), unit: self.unit.clone() };
        let y = Axis::vertical(span, label, height);
        let whole: Vec<Reading> = self.readings.iter().map(|reading| (*reading).clone()).collect();
        let histogram = Histogram::new(&whole);
        let most = histogram.counts.iter().copied().max().unwrap_or(0).max(histogram.expected.1);
        let tall = Span { low: 0.0, high: 1.08 * most as f64, ..Span::of([0.0, 1.0]) };
        let count = Axis::vertical(tall, Label::new("readings"), low);
        let beside = room_beside(&y, height).max(room_beside(&count, low));
        let (left, right) = (left + beside, right - 7.0);

        let x = Span::of(self.x.iter().copied()).padded(0.03);
        let x = Axis::horizontal(x, self.along.clone(), right - left);
        let (branches, first) = &self.branches;
        let top = figure.y + 4.0 + if branches.turns() { ABOVE } else { 0.0 };
        let rect = Rect::new(left, top, right, top + height);
        let name = format!("readings of {} against what the others predict", self.name);
        let mut panel = Panel::new(name, rect, x, y).beside(beside);
        panel.band("90 % band", &self.x, &ends[0], &ends[1], wide());
        panel.band("50 % band", &self.x, &ends[2], &ends[3], narrow());
        branches.mark(&mut panel, *first);
        panel.horizontal("median", 0.0, Paint::line(color::BLUE, 0.6));
        for (is_inside, dot) in [(true, inside(measured.len())), (false, outside(measured.len()))] {
            let points = self.x.iter().zip(&measured).zip(&self.readings);
            let points = points.filter(|(_, reading)| reading.is_inside(0.9) == is_inside);
            panel.dots("measured", points.map(|((x, y), _)| (*x, *y)), dot, 4000);
        }
        let foot = panel.foot();
        figure.add(panel.finish());
        self.draw_histogram(
            figure,
            &histogram,
            &whole,
            (Rect::new(left, foot + 13.0, right, foot + 13.0 + low), beside, count),
        )
    }

    fn draw_histogram(
        &self,
        figure: &mut Figure,
        histogram: &Histogram,
        readings: &[Reading],
        (rect, beside, count): (Rect, f64, Axis),
    ) -> f64 {
        let label = Label::new("probability of a lower reading (PIT)");
        let x = Axis::horizontal(Span::of([0.0, 1.0]), label, rect.width());
        let [wide, narrow] = [0.9, 0.5].map(|share| Count::new(readings, share).inside);
        let heading = format!("{wide} of {} in the 90 % band, {narrow} in the 50 % band", readings.len());
        let name = format!("histogram of the PIT of {}", self.name);
        let mut panel = Panel::new(name, rect, x, count).beside(beside).heading(heading);
        let (least, most) = (histogram.expected.0 as f64, histogram.expected.1 as f64);
        let parts = histogram.counts.len() as f64;
        for (part, count) in histogram.counts.iter().enumerate() {
            let (from, to) = (part as f64 / parts, (part + 1) as f64 / parts);
            let gap = 0.06 / parts;
            let outline =
                [(from + gap, 0.0), (to - gap, 0.0), (to - gap, *count as f64), (from + gap, *count as f64)];
            panel.outlines("readings", &[outline.to_vec()], bar());
        }
        panel.band("even, but for chance", &[0.0, 1.0], &[least; 2], &[most; 2], even());
        panel.horizontal(
            "even",
            readings.len() as f64 / parts,
            Paint::line(color::INK, 0.6).dashed(3.0, 2.0),
        );
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }
}

fn inside(count: usize) -> Dot {
    Dot::among(count, color::BLACK)
}

fn outside(count: usize) -> Dot {
    Dot::among(count, color::VERMILION)
}

fn wide() -> Paint {
    Paint::area(color::SKY).opacity(0.35)
}

fn narrow() -> Paint {
    Paint::area(color::BLUE).opacity(0.45)
}

fn bar() -> Paint {
    Paint::area(color::GREEN).opacity(0.6)
}

fn even() -> Paint {
    Paint::area(color::GREY).opacity(0.35)
}
