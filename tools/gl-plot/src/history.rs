//! How the calibration came to its end: along the steps of the measurement, and along the iterations.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_inference::summary::Summary;
use gl_table::Table;

use crate::Style;
use crate::input::{Parameters, check_panels};
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Color, Paint, Rect, Scene, color};

/// Mean and spread of the parameters along the steps; sigma, ess (of an emulator: ignorance) and errors along the iterations
#[derive(Args)]
#[command(after_help = EXAMPLE)]
#[command(group(clap::ArgGroup::new("tables").args(["history", "summary"]).required(true).multiple(true)))]
pub struct History {
    /// Table of parameters: their scales and units
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Summary table; one an iteration, in order
    #[arg(long, value_name = "FILE")]
    summary: Vec<PathBuf>,
    /// History table: `step sigma ess mean(NAME) cv(NAME)`
    #[arg(value_name = "HISTORY")]
    history: Option<PathBuf>,
}

const EXAMPLE: &str = "\
Example:
  printf 'step sigma ess mean(E) cv(E)\\n' > history.txt
  printf '0 .1 .9 2e9 .3\\n1 .1 .5 2.2e9 .2\\n' >> history.txt
  gl-plot history history.txt -o history.svg";

/// One quantity along steps or iterations.
struct Trend {
    span: Span,
    label: Label,
    points: Vec<(f64, f64)>,
    /// A band around it, shape (points,).
    band: Option<(Vec<f64>, Vec<f64>)>,
    color: Color,
    name: String,
}

impl Trend {
    fn new(x: &[f64], values: Vec<f64>, label: Label, name: &str, color: Color) -> Self {
        let span = Span::of(values.iter().copied());
        let points = x.iter().copied().zip(values).collect();
        Self { span, label, points, band: None, color, name: name.to_owned() }
    }

    fn with_band(mut self, low: Vec<f64>, high: Vec<f64>) -> Self {
        self.span = Span::of(low.iter().chain(&high).copied().chain([self.span.low, self.span.high]));
        self.band = Some((low, high));
        self
    }

    fn moves(&self) -> bool {
        self.span.low < self.span.high
    }

    /// On a logarithmic axis where the values span more than a decade.
    fn wide(mut self) -> Self {
        if self.span.low > 0.0 && self.span.high > 10.0 * self.span.low {
            self.span = self.span.logarithmic();
        }
        self
    }

    fn with_zero(mut self) -> Self {
        self.span = self.span.with(0.0);
        self
    }
}

impl History {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let mut figure = Figure::new("History of the calibration", style.width);
        if let Some(path) = &self.history {
            let rows = along_steps(&Table::read(path)?, &parameters)?;
            figure.legend(&[
                (Key::Line(Paint::line(color::BLUE, 1.2)), "mean".to_owned()),
                (Key::Area(band_paint(color::BLUE)), "± 1 standard deviation".to_owned()),
                (Key::Line(Paint::line(color::VERMILION, 1.2)), "coefficient of variation (cv)".to_owned()),
            ]);
            rows.into_iter().for_each(|row| draw_rows(&mut figure, row, "step"));
        }
        if !self.summary.is_empty() {
            let tables = self
                .summary
                .iter()
                .map(|path| Ok((path, Summary::read(path)?)))
                .collect::<Result<Vec<_>>>()?;
            let rows = along_iterations(&tables, &parameters)?;
            figure.legend(&[
                (Key::Line(Paint::line(color::BLUE, 1.2)), "mean".to_owned()),
                (Key::Area(band_paint(color::BLUE)), "90 % interval".to_owned()),
            ]);
            rows.into_iter().for_each(|row| draw_rows(&mut figure, row, "iteration"));
        }
        Ok(figure.finish())
    }
}

/// Stacks of panels that share their horizontal axis, to be set side by side.
type Stacks = Vec<Vec<Trend>>;

fn along_steps(table: &Table, parameters: &Parameters) -> Result<Vec<Stacks>> {
    let source = table.format().source();
    ensure!(!table.is_empty(), "{source}: no rows; there is nothing to draw");
    let step = table.numbers("step")?;
    let names: Vec<&str> = table
        .format()
        .columns()
        .iter()
        .filter_map(|column| column.strip_prefix("mean(")?.strip_suffix(')'))
        .collect();
    ensure!(!names.is_empty(), "{source}:1: no column mean(NAME); is it the history of gl-filter?");
    check_panels(source, names.len())?;
    let mut columns = Vec::new();
    for name in names {
        let means = table.numbers(&format!("mean({name})"))?;
        let cv = table.numbers(&format!("cv({name})"))?;
        let moves = cv.iter().any(|cv| *cv != 0.0) || means.iter().any(|mean| *mean != means[0]);
        columns.push((name, means, cv, moves));
    }
    // Parameters of effects that are off stand still.
    let some_move = columns.iter().any(|(.., moves)| *moves);
    let mut stacks = Vec::new();
    for (name, means, cv, _) in columns.into_iter().filter(|(.., moves)| *moves || !some_move) {
        let sd: Vec<f64> = means.iter().zip(&cv).map(|(mean, cv)| mean.abs() * cv).collect();
        let (low, high) = means
            .iter()
            .zip(&sd)
            .map(|(mean, sd)| (mean - sd, mean + sd))
            .unzip::<f64, f64, Vec<_>, Vec<_>>();
        let label = parameters.label(name);
        stacks.push(vec![
            Trend::new(&step, means, label, name, color::BLUE).with_band(low, high),
            Trend::new(&step, cv, Label::new("cv"), &format!("cv of {name}"), color::VERMILION).with_zero(),
        ]);
    }
    let mut filter = Vec::new();
    for name in ["sigma", "ess"] {
        let values = table.numbers(name)?;
        let trend = Trend::new(&step, values, Label::new(name), name, color::GREEN);
        filter.push(vec![if name == "ess" { trend.with_zero() } else { trend.wide() }]);
    }
    Ok(vec![stacks, filter])
}

fn along_iterations(tables: &[(&PathBuf, Summary)], parameters: &Parameters) -> Result<Vec<Stacks>> {
    let iteration: Vec<f64> = (0..tables.len()).map(|i| i as f64).collect();
    let quantities =
        |name: &str| tables.iter().map(|table| quantity(table, name)).collect::<Result<Vec<_>>>();
    // Draws through an emulator have weights that are all the same; what moves is what the emulator leaves open.
    let is_emulated = tables.iter().all(|(_, summary)| summary.quantity("ignorance").is_some());
    let of_posterior = if is_emulated { "ignorance" } else { "ess" };
    let mut numbers = Vec::new();
    for name in ["sigma", of_posterior, "ensemble_error", "best_error"] {
        let label = Label::new(name.replace('_', " "));
        let trend = Trend::new(&iteration, quantities(name)?, label, name, color::GREEN);
        let is_wide = matches!(name, "sigma" | "ignorance");
        numbers.push(vec![if is_wide { trend.wide() } else { trend.with_zero() }]);
    }
    check_panels(&tables[0].0.display().to_string(), tables[0].1.parameters.len())?;
    let mut means = Vec::new();
    for parameter in &tables[0].1.parameters {
        let name = &parameter.name;
        let of = |kind: &str| quantities(&format!("{kind}({name})"));
        let trend = Trend::new(&iteration, of("mean")?, parameters.label(name), name, color::BLUE);
        means.push(vec![trend.with_band(of("q05")?, of("q95")?)]);
    }
    // Parameters of effects that are off stand still.
    if means.iter().any(|stack| stack[0].moves()) {
        means.retain(|stack| stack[0].moves());
    }
    Ok(vec![numbers, means])
}

/// The value of a quantity in the summary at `path`.
fn quantity((path, summary): &(&PathBuf, Summary), name: &str) -> Result<f64> {
    summary
        .quantity(name)
        .with_context(|| format!("{}: no quantity {name}; is it a summary of gl-filter?", path.display()))
}

fn draw_rows(figure: &mut Figure, stacks: Stacks, along: &str) {
    let columns = figure.columns(stacks.len(), 115.0);
    for row in stacks.chunks(columns) {
        let heights = [78.0, 44.0];
        let top = figure.y + 3.0;
        let mut bottom = top;
        for (place, stack) in row.iter().enumerate() {
            let (left, right) = figure.cell(place, columns);
            let axes: Vec<Axis> = stack
                .iter()
                .zip(heights)
                .map(|(trend, height)| Axis::vertical(trend.span.padded(0.06), trend.label.clone(), height))
                .collect();
            let beside =
                axes.iter().zip(heights).map(|(axis, height)| room_beside(axis, height)).fold(0.0, f64::max);
            let (left, right) = (left + beside, right - 7.0);
            let mut y = top;
            for (i, (trend, axis)) in stack.iter().zip(axes).enumerate() {
                let rect = Rect::new(left, y, right, y + heights[i]);
                let span = Span::of(trend.points.iter().map(|point| point.0));
                let x = Axis::counting(span.padded(0.04), Label::new(along), right - left);
                let name = format!("{} along the {along}s", trend.name);
                let mut panel = Panel::new(name, rect, x, axis).beside(beside);
                if i + 1 < stack.len() {
                    panel = panel.without_x_labels();
                }
                trend.draw(&mut panel);
                bottom = bottom.max(panel.foot());
                figure.add(panel.finish());
                y += heights[i] + 7.0;
            }
        }
        figure.y = bottom + 4.0;
    }
}

impl Trend {
    fn draw(&self, panel: &mut Panel) {
        if let Some((low, high)) = &self.band {
            let x: Vec<f64> = self.points.iter().map(|point| point.0).collect();
            if x.len() == 1 {
                panel.bars("spread", [(x[0], low[0], high[0])], Paint::line(self.color, 3.0).opacity(0.3));
            } else {
                panel.band("spread", &x, low, high, band_paint(self.color));
            }
        }
        panel.line(&self.name, self.points.iter().copied(), Paint::line(self.color, 1.2));
        if self.points.len() <= 25 {
            let dot = Dot { diameter: 2.8, color: self.color, opacity: 1.0 };
            panel.dots(&self.name, self.points.iter().copied(), dot, 25);
        }
    }
}

fn band_paint(color: Color) -> Paint {
    Paint::area(color).opacity(0.2)
}
