//! Where the calibrated model and the measurement disagree.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_gap::standardised::standardised;
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::{ByName, Observations, Steps};
use gl_inference::stack::named;
use gl_inference::weights::Weights;
use gl_table::Table;

use crate::Style;
use crate::branches::{ABOVE, Branches};
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Anchor, Color, Paint, Rect, Scene, color, text};
use gl_inference::units::Units;

/// The standardised gap along the control, significant stretches shaded
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Gap {
    /// Table of the gap after the simulation got the effect that it lacked
    #[arg(long, value_name = "FILE")]
    after: Option<PathBuf>,
    /// Measurement; with it, -e and -w the gap of each reading is shown too
    #[arg(short = 'b', long, value_name = "FILE", requires_all = ["ensemble", "weights"])]
    observations: Option<PathBuf>,
    /// Ensemble table of the runs
    #[arg(short, long, value_name = "FILE", requires = "observations")]
    ensemble: Option<PathBuf>,
    /// Weights of the runs
    #[arg(short, long, value_name = "FILE", requires = "observations")]
    weights: Option<PathBuf>,
    /// Ensemble table of the runs that have the effect
    #[arg(long, value_name = "FILE", requires_all = ["observations", "after_weights"])]
    after_ensemble: Option<PathBuf>,
    /// Weights of the runs that have the effect
    #[arg(long, value_name = "FILE", requires = "after_ensemble")]
    after_weights: Option<PathBuf>,
    /// Standard deviation of the measurement noise; by default the `_sd` columns, or estimated
    #[arg(long, value_name = "NAME=SD,…", requires = "observations")]
    noise: Option<ByName>,
    /// Name of the control
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Of tables of several tests, this one; runs that failed in another test have no weight, and are left out
    #[arg(long, value_name = "TEST")]
    of: Option<String>,
    /// Unit of columns, as in u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Gap table: `observable from to gap gap_sd z share significant`
    #[arg(value_name = "GAP", default_value = "-")]
    gap: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'observable from to gap gap_sd z share significant\\n' > gap.txt
  printf 'q 0 2 0 1 .1 0 no\\nq 2 9 3 .5 6 .9 yes\\n' >> gap.txt
  gl-plot gap -c strain gap.txt -o gap.svg";

/// A stretch of the control along which the gap is of one kind.
#[derive(Clone, Debug)]
struct Stretch {
    observable: String,
    from: f64,
    to: f64,
    /// First and last step, where the table has them.
    steps: Option<(f64, f64)>,
    z: f64,
    share: f64,
    significant: bool,
}

/// Whether the control turns back, so that stretches would lie on each other.
fn turns_back(table: &[Stretch]) -> bool {
    table.windows(2).filter(|pair| pair[0].observable == pair[1].observable).any(|pair| {
        let middles = pair[1].from + pair[1].to - pair[0].from - pair[0].to;
        [pair[0].to - pair[0].from, pair[1].to - pair[1].from].iter().any(|length| length * middles < 0.0)
    })
}

/// The stretches of a table; of one test, if it is named.
fn read(path: &Path, of: Option<&str>) -> Result<Vec<Stretch>> {
    let mut all = read_all(path)?;
    let Some(of) = of else { return Ok(all) };
    let prefix = named(of, "");
    all.retain_mut(|stretch| {
        let own = stretch.observable.strip_prefix(&prefix).map(str::to_owned);
        stretch.observable = own.unwrap_or_default();
        !stretch.observable.is_empty()
    });
    ensure!(!all.is_empty(), "--of {of}: {} has no observable {prefix}NAME", path.display());
    Ok(all)
}

fn read_all(path: &Path) -> Result<Vec<Stretch>> {
    let table = Table::read(path)?;
    ensure!(!table.is_empty(), "{}: no rows; there is nothing to draw", table.format().source());
    let observable = table.format().column("observable")?;
    let significant = table.format().column("significant")?;
    let (from, to) = (table.numbers("from")?, table.numbers("to")?);
    let (z, share) = (table.numbers("z")?, table.numbers("share")?);
    let steps = table.format().find("steps")?;
    (0..table.len())
        .map(|row| {
            let steps = steps.and_then(|column| Steps::from_str(table.field(row, column)).ok());
            let steps = steps.map(|steps| (steps.from as f64, (steps.to - 1) as f64));
            let significant = match table.field(row, significant) {
                "yes" | "true" | "1" => true,
                "no" | "false" | "0" => false,
                other => {
                    return table.fail(row, "significant", format_args!("{other:?} is neither yes nor no"));
                }
            };
            let observable = table.field(row, observable).to_owned();
            let (from, to, z, share) = (from[row], to[row], z[row], share[row]);
            Ok(Stretch { observable, from, to, steps, z, share, significant })
        })
        .collect()
}

const BEFORE: Color = color::BLUE;
const AFTER: Color = color::GREEN;

/// Everything that the panels show.
struct Data {
    /// Tables of stretches, before and perhaps after, in their colours.
    tables: Vec<(Vec<Stretch>, Color)>,
    /// The gap of each reading, as far as it is known.
    readings: Vec<(Readings, Color)>,
    /// Whether the control turns back, so that steps are counted instead.
    along_steps: bool,
    along: Label,
    /// Where the control turns back, as far as the measurement is known.
    branches: Branches,
    observables: Vec<String>,
}

impl Gap {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let data = self.data()?;
        let mut figure = Figure::new("Gap between measurement and simulation", style.width);
        figure.legend(&legend(data.tables.len() > 1));
        let columns = figure.columns(data.observables.len(), 150.0);
        for row in data.observables.chunks(columns) {
            let mut foot = figure.y;
            for (place, name) in row.iter().enumerate() {
                foot = foot.max(data.of(name).draw(&mut figure, place, columns));
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    fn data(&self) -> Result<Data> {
        let of = self.of.as_deref();
        let mut tables = vec![(read(&self.gap, of)?, BEFORE)];
        if let Some(after) = &self.after {
            tables.push((read(after, of)?, AFTER));
        }
        let along_steps = tables.iter().any(|(table, _)| turns_back(table));
        for stretch in tables.iter_mut().flat_map(|(table, _)| table).filter(|_| along_steps) {
            // Without them the control has to do.
            (stretch.from, stretch.to) = stretch.steps.unwrap_or((stretch.from, stretch.to));
        }
        let mut readings = Vec::new();
        let after = (&self.after_ensemble, &self.after_weights);
        for ((ensemble, weights), color) in [((&self.ensemble, &self.weights), BEFORE), (after, AFTER)] {
            if let (Some(ensemble), Some(weights)) = (ensemble, weights) {
                readings.push((self.readings(ensemble, weights)?, color));
            }
        }
        let known = readings.first().map(|(readings, _)| readings.control_name.clone());
        let name = self.control.clone().or(known).unwrap_or_else(|| "control".to_owned());
        let unit = self.units.get(&name).map(str::to_owned);
        let mut observables: Vec<String> = Vec::new();
        for stretch in tables.iter().flat_map(|(table, _)| table) {
            if !observables.contains(&stretch.observable) {
                observables.push(stretch.observable.clone());
            }
        }
        let along = if along_steps { Label::new("step") } else { Label { name, unit } };
        let branches = readings.first().filter(|_| along_steps);
        let branches = branches.map_or_else(Branches::default, |(known, _)| Branches::of(&known.control));
        Ok(Data { tables, readings, along_steps, along, branches, observables })
    }
}

fn legend(has_after: bool) -> Vec<(Key, String)> {
    let before = if has_after { "before" } else { "gap of a stretch" };
    let mut legend = vec![
        (Key::Line(Paint::line(BEFORE, 1.8)), before.to_owned()),
        (Key::Area(significant_paint(BEFORE)), "significant, with its share of the gap".to_owned()),
    ];
    if has_after {
        legend.push((Key::Line(Paint::line(AFTER, 1.8)), "after".to_owned()));
        legend.push((Key::Area(significant_paint(AFTER)), "significant after".to_owned()));
    }
    legend.push((Key::Line(limit_paint()), "± 2 sd".to_owned()));
    legend
}

/// The same of one observable.
struct OfObservable<'a> {
    name: &'a str,
    tables: Vec<(Vec<Stretch>, Color)>,
    /// Points along the control or the steps.
    readings: Vec<(Vec<(f64, f64)>, Color)>,
    along: &'a Label,
    branches: &'a Branches,
}

impl Data {
    fn of<'a>(&'a self, name: &'a str) -> OfObservable<'a> {
        let of = |(readings, color): &(Readings, Color)| Some((readings.of(name, self.along_steps)?, *color));
        OfObservable {
            name,
            tables: self.tables.iter().map(|(table, color)| (own(table, name), *color)).collect(),
            readings: self.readings.iter().filter_map(of).collect(),
            along: &self.along,
            branches: &self.branches,
        }
    }
}

impl OfObservable<'_> {
    fn stretches(&self) -> impl Iterator<Item = &Stretch> {
        self.tables.iter().flat_map(|(table, _)| table)
    }

    /// Draw the gap of each reading, where it is known, and that of the stretches below; where they end.
    fn draw(&self, figure: &mut Figure, place: usize, columns: usize) -> f64 {
        let (left, right) = figure.cell(place, columns);
        let height = (0.6 * (right - left)).clamp(80.0, 150.0);
        let z = Span::of(self.stretches().map(|stretch| stretch.z)).with(-3.0).with(3.0).padded(0.16);
        let y = Axis::vertical(z, Label::new(format!("gap of {} / sd", self.name)), height);
        let each = Span::of(self.readings.iter().flat_map(|(points, _)| points.iter().map(|point| point.1)));
        let each = each.with(-2.5).with(2.5).padded(0.08);
        let each_y = Axis::vertical(each, Label::new("each reading / sd"), height);
        let beside = room_beside(&y, height).max(room_beside(&each_y, height));
        let (left, right) = (left + beside, right - 7.0);
        let ends = self.stretches().flat_map(|stretch| [stretch.from, stretch.to]);
        let x = Axis::horizontal(Span::of(ends).padded(0.03), self.along.clone(), right - left);

        let mut top = figure.y + 4.0 + if self.branches.turns() { ABOVE } else { 0.0 };
        if !self.readings.is_empty() {
            let rect = Rect::new(left, top, right, top + height);
            let name = format!("gap of each reading of {}", self.name);
            let mut panel = Panel::new(name, rect, x.clone(), each_y).beside(beside).without_x_labels();
            self.tables.iter().for_each(|(table, color)| shade(&mut panel, table, *color));
            lines(&mut panel);
            self.branches.mark(&mut panel, 0);
            for (points, color) in &self.readings {
                let dot = Dot { opacity: 0.7, ..Dot::among(points.len(), *color) };
                panel.dots("readings", points.iter().copied(), dot, 3000);
            }
            figure.add(panel.finish());
            top += height + 8.0;
        }
        let rect = Rect::new(left, top, right, top + height);
        let mut panel = Panel::new(format!("gap of {}", self.name), rect, x, y).beside(beside);
        self.tables.iter().for_each(|(table, color)| shade(&mut panel, table, *color));
        lines(&mut panel);
        self.tables.iter().for_each(|(table, color)| draw(&mut panel, table, *color));
        self.tables.iter().take(1).for_each(|(table, _)| write_shares(&mut panel, table));
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }
}

/// The gap of each reading.
struct Readings {
    control_name: String,
    control: Vec<f64>,
    observables: Vec<String>,
    /// In standard deviations, shape (observables, steps).
    gap: Vec<Vec<f64>>,
}

impl Readings {
    /// Points along the control, or along the steps.
    fn of(&self, observable: &str, along_steps: bool) -> Option<Vec<(f64, f64)>> {
        let gap = &self.gap[self.observables.iter().position(|name| name == observable)?];
        let place = |step: usize| if along_steps { step as f64 } else { self.control[step] };
        Some(gap.iter().enumerate().map(|(step, &gap)| (place(step), gap)).collect())
    }
}

impl Gap {
    fn readings(&self, ensemble: &Path, weights: &Path) -> Result<Readings> {
        let ensemble = Ensemble::read_by_header(ensemble, self.control.as_deref(), &[])?;
        let observations = self.observations.as_deref().context("no measurement")?;
        let observations = Observations::read(observations, &ensemble.control_name, &ensemble.observables)?;
        let noise = observations.noise(&self.noise.clone().unwrap_or_default())?;
        let weights = Weights::read(weights)?;
        let ensemble = if self.of.is_some() {
            let weighed = weights.index();
            let runs: Vec<usize> = (0..ensemble.len())
                .filter(|&run| weighed.contains_key(ensemble.samples[run].as_str()))
                .collect();
            ensemble.part(&runs, 0..ensemble.steps())
        } else {
            ensemble
        };
        let weights = weights.of_runs(&ensemble)?;
        let gap = standardised(&observations, &ensemble, &weights, noise.as_deref())?;
        let Ensemble { control_name, observables, .. } = ensemble;
        Ok(Readings { control_name, control: observations.control, observables, gap })
    }
}

fn own(table: &[Stretch], observable: &str) -> Vec<Stretch> {
    table.iter().filter(|stretch| stretch.observable == observable).cloned().collect()
}

fn lines(panel: &mut Panel) {
    panel.horizontal("zero", 0.0, Paint::line(color::INK, 0.5));
    panel.horizontal("2 sd", 2.0, limit_paint());
    panel.horizontal("−2 sd", -2.0, limit_paint());
}

fn shade(panel: &mut Panel, table: &[Stretch], color: Color) {
    // What is left afterwards at the foot, so that both can be seen.
    let share = if color == AFTER { 0.05 } else { 1.0 };
    for stretch in table.iter().filter(|stretch| stretch.significant) {
        panel.stripe("significant", (stretch.from, stretch.to), share, significant_paint(color));
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

/// The share of the gap in each significant stretch, the largest first, where there is room for the number.
fn write_shares(panel: &mut Panel, table: &[Stretch]) {
    use gl_figure::axis::SMALL;
    let mut stretches: Vec<&Stretch> = table.iter().filter(|stretch| stretch.significant).collect();
    stretches.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut taken: Vec<(f64, f64)> = Vec::new();
    for stretch in stretches {
        let label = format!("{:.0} %", 100.0 * stretch.share);
        let ((x0, y), (x1, _)) = (panel.at((stretch.from, stretch.z)), panel.at((stretch.to, stretch.z)));
        let half = 0.5 * gl_figure::font::width(&label, SMALL) + 1.0;
        // Beside the frame a number stands within it.
        let Rect { x0: left, x1: right, .. } = panel.rect;
        let x = (0.5 * (x0 + x1)).clamp(left + half, right - half);
        if taken.iter().any(|&(from, to)| x - half < to && from < x + half) {
            continue;
        }
        taken.push((x - half, x + half));
        let y = if stretch.z >= 0.0 { y - 3.0 } else { y + SMALL + 1.5 };
        panel.note(text((x, y), label, SMALL, Anchor::Middle));
    }
}

fn significant_paint(color: Color) -> Paint {
    Paint::area(color).opacity(if color == AFTER { 0.5 } else { 0.15 })
}

fn limit_paint() -> Paint {
    Paint::line(color::GREY, 0.7).dashed(3.0, 2.0)
}
