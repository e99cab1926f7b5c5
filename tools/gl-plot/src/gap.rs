//! Where the calibrated model and the measurement disagree.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl::table::Table;

use crate::axis::{Axis, Label, Span};
use crate::figure::{Figure, Key};
use crate::panel::{BELOW, Panel, room_beside};
use crate::scene::{Anchor, Color, Paint, Rect, Scene, color, text};
use crate::{Style, Units};

/// The standardised gap along the control, significant stretches shaded
#[derive(Args)]
pub struct Gap {
    /// Table of the gap after the simulation got the effect that it lacked
    #[arg(long, value_name = "FILE")]
    after: Option<PathBuf>,
    /// Name of the control, for the axis
    #[arg(short, long, value_name = "NAME", default_value = "control")]
    control: String,
    /// Unit of columns, as in u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Gap table: `observable from to gap gap_sd z share significant`
    #[arg(value_name = "GAP", default_value = "-")]
    gap: PathBuf,
}

/// A stretch of the control along which the gap is of one kind.
#[derive(Clone, Debug)]
struct Stretch {
    observable: String,
    from: f64,
    to: f64,
    z: f64,
    share: f64,
    significant: bool,
}

fn read(path: &std::path::Path) -> Result<Vec<Stretch>> {
    let table = Table::read(path)?;
    ensure!(!table.is_empty(), "{}: no rows; there is nothing to draw", table.format().source());
    let observable = table.format().column("observable")?;
    let significant = table.format().column("significant")?;
    let (from, to) = (table.numbers("from")?, table.numbers("to")?);
    let (z, share) = (table.numbers("z")?, table.numbers("share")?);
    (0..table.len())
        .map(|row| {
            let significant = match table.field(row, significant) {
                "yes" | "true" | "1" => true,
                "no" | "false" | "0" => false,
                other => {
                    return table.fail(row, "significant", format_args!("{other:?} is neither yes nor no"));
                }
            };
            let observable = table.field(row, observable).to_owned();
            let (from, to, z, share) = (from[row], to[row], z[row], share[row]);
            Ok(Stretch { observable, from, to, z, share, significant })
        })
        .collect()
}

const BEFORE: Color = color::BLUE;
const AFTER: Color = color::GREEN;

impl Gap {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let before = read(&self.gap)?;
        let after = self.after.as_deref().map(read).transpose()?;
        let mut names: Vec<String> = Vec::new();
        for stretch in before.iter().chain(after.iter().flatten()) {
            if !names.contains(&stretch.observable) {
                names.push(stretch.observable.clone());
            }
        }

        let mut figure = Figure::new("Gap between measurement and simulation", style.width);
        let mut legend = vec![
            (
                Key::Line(Paint::line(BEFORE, 1.8)),
                if after.is_some() { "before" } else { "gap of a stretch" }.to_owned(),
            ),
            (Key::Area(significant_paint(BEFORE)), "significant, with its share of the gap".to_owned()),
        ];
        if after.is_some() {
            legend.push((Key::Line(Paint::line(AFTER, 1.8)), "after".to_owned()));
            legend.push((Key::Area(significant_paint(AFTER)), "significant".to_owned()));
        }
        legend.push((Key::Line(limit_paint()), "± 2 sd".to_owned()));
        figure.legend(&legend);

        let columns = figure.columns(names.len(), 150.0);
        let tables: Vec<(&[Stretch], Color)> = match &after {
            Some(after) => vec![(&before, BEFORE), (after, AFTER)],
            None => vec![(&before, BEFORE)],
        };
        for row in names.chunks(columns) {
            let (left, right) = figure.cell(0, columns);
            let height = (0.6 * (right - left)).clamp(80.0, 150.0);
            let top = figure.y + 4.0;
            for (place, name) in row.iter().enumerate() {
                let (left, right) = figure.cell(place, columns);
                let own = |table: &[Stretch]| -> Vec<Stretch> {
                    table.iter().filter(|stretch| stretch.observable == *name).cloned().collect()
                };
                let tables: Vec<(Vec<Stretch>, Color)> =
                    tables.iter().map(|(table, color)| (own(table), *color)).collect();
                let all = || tables.iter().flat_map(|(table, _)| table);
                let z = Span::of(all().map(|stretch| stretch.z)).with(-3.0).with(3.0).padded(0.16);
                let y = Axis::vertical(z, Label::new(format!("gap of {name} / sd")), height);
                let beside = room_beside(&y);
                let (left, right) = (left + beside, right - 7.0);
                let span = Span::of(all().flat_map(|stretch| [stretch.from, stretch.to])).padded(0.03);
                let label = Label { name: self.control.clone(), unit: self.units.get(&self.control) };
                let x = Axis::horizontal(span, label, right - left);
                let rect = Rect::new(left, top, right, top + height);
                let mut panel = Panel::new(format!("gap of {name}"), rect, x, y);
                tables.iter().for_each(|(table, color)| shade(&mut panel, table, *color));
                panel.horizontal("zero", 0.0, Paint::line(color::INK, 0.5));
                panel.horizontal("2 sd", 2.0, limit_paint());
                panel.horizontal("−2 sd", -2.0, limit_paint());
                tables.iter().for_each(|(table, color)| draw(&mut panel, table, *color));
                tables.iter().take(1).for_each(|(table, _)| write_shares(&mut panel, table));
                figure.add(panel.finish());
            }
            figure.y = top + height + BELOW + 4.0;
        }
        Ok(figure.finish())
    }
}

fn shade(panel: &mut Panel, table: &[Stretch], color: Color) {
    for stretch in table.iter().filter(|stretch| stretch.significant) {
        panel.stripe("significant", stretch.from, stretch.to, significant_paint(color));
    }
}

/// A level line a stretch, joined by thin ones where one follows on the other.
fn draw(panel: &mut Panel, table: &[Stretch], color: Color) {
    let points = table.iter().flat_map(|stretch| [(stretch.from, stretch.z), (stretch.to, stretch.z)]);
    panel.line("steps", points, Paint::line(color, 0.6).opacity(0.6));
    for stretch in table {
        let ends = [(stretch.from, stretch.z), (stretch.to, stretch.z)];
        panel.line("stretch", ends, Paint::line(color, 1.8));
    }
}

/// The share of the gap in each significant stretch that is wide enough for the number.
fn write_shares(panel: &mut Panel, table: &[Stretch]) {
    use crate::axis::SMALL;
    for stretch in table.iter().filter(|stretch| stretch.significant) {
        let label = format!("{:.0} %", 100.0 * stretch.share);
        let ((x0, y), (x1, _)) = (panel.at((stretch.from, stretch.z)), panel.at((stretch.to, stretch.z)));
        let width = crate::font::width(&label, SMALL);
        if width > (x1 - x0).abs() {
            continue;
        }
        let y = if stretch.z >= 0.0 { y - 3.0 } else { y + SMALL + 1.5 };
        panel.note(text(((x0 + x1) / 2.0, y), label, SMALL, Anchor::Middle));
    }
}

fn significant_paint(color: Color) -> Paint {
    Paint::area(color).opacity(0.15)
}

fn limit_paint() -> Paint {
    Paint::line(color::GREY, 0.7).dashed(3.0, 2.0)
}
