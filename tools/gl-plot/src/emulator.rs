//! What the emulator says against what the runs gave.

use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use clap::Args;
use gl_inference::ensemble::Ensemble;

use crate::Style;
use crate::input::check_panels;
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Paint, Rect, Scene, color};
use gl_inference::units::Units;

/// Emulated against simulated observables, run by run
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Emulator {
    /// Ensemble table of the runs themselves
    #[arg(short, long, value_name = "FILE")]
    ensemble: PathBuf,
    /// Column of the control; by default the one after `step`
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Columns of the observables; by default all after the control
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',')]
    observables: Vec<String>,
    /// Unit of columns, as in q=MPa,u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// Ensemble table of predictions for the same samples, each left out of its own
    #[arg(value_name = "PREDICTED", default_value = "-")]
    predicted: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'sample step u f\\na 0 0 1\\nb 0 0 2\\n' > runs.txt
  printf 'sample step u f f_sd\\na 0 0 1.1 .1\\nb 0 0 2 .1\\n' > left-out.txt
  gl-plot emulator -e runs.txt left-out.txt -o emulator.svg";

const MOST_DOTS: usize = 30_000;
/// 90 % of a normal distribution lies within this many standard deviations.
const NINETY_PERCENT: f64 = 1.645;

/// Simulated value, predicted value and its standard deviation.
type Triple = (f64, f64, Option<f64>);

impl Emulator {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let runs = Ensemble::read_by_header(&self.ensemble, self.control.as_deref(), &self.observables)?;
        check_panels(&runs.source, runs.observables.len())?;
        let predicted = Ensemble::read(&self.predicted, &runs.control_name, &runs.observables)?;
        ensure!(!predicted.is_empty(), "{}: no runs; there is nothing to draw", predicted.source);
        let index = runs.index();
        let mut pairs = Vec::new();
        for (i, sample) in predicted.samples.iter().enumerate() {
            let Some(&run) = index.get(sample.as_str()) else {
                bail!("{}: no sample {sample}, which {} has", runs.source, predicted.source);
            };
            pairs.push((run, i));
        }
        ensure!(
            runs.steps() == predicted.steps(),
            "{}: {} steps a sample, but {} in {}",
            predicted.source,
            predicted.steps(),
            runs.steps(),
            runs.source
        );

        let title = format!("Emulator of {}", runs.observables.join(", "));
        let mut figure = Figure::new(title, style.width);
        figure.legend(&[
            (Key::Dot(Dot::among(1, color::BLUE)), "a step of a run".to_owned()),
            (Key::Line(equal_paint()), "predicted = simulated".to_owned()),
            (Key::Area(expected_paint()), "90 % if the stated sd is right".to_owned()),
        ]);
        let columns = figure.columns(runs.observables.len(), 130.0);
        for (block, names) in runs.observables.chunks(columns).enumerate() {
            let (left, right) = figure.cell(0, columns);
            let size = (0.8 * (right - left)).clamp(90.0, 200.0);
            let top = figure.y + 12.0;
            let mut bottom = top;
            for (place, name) in names.iter().enumerate() {
                let observable = block * columns + place;
                let triples: Vec<Triple> = pairs
                    .iter()
                    .flat_map(|&(run, i)| {
                        let sd = predicted.curve_sd(i, observable);
                        let both = runs.curve(run, observable).iter().zip(predicted.curve(i, observable));
                        both.enumerate().map(move |(step, (&x, &y))| (x, y, sd.map(|sd| sd[step])))
                    })
                    .collect();
                bottom = bottom.max(self.draw_observable(
                    &mut figure,
                    name,
                    &triples,
                    (place, columns),
                    top,
                    size,
                ));
            }
            figure.y = bottom + 4.0;
        }
        Ok(figure.finish())
    }

    /// Predicted against simulated, and the errors below; where it ends.
    fn draw_observable(
        &self,
        figure: &mut Figure,
        name: &str,
        triples: &[Triple],
        (place, columns): (usize, usize),
        top: f64,
        size: f64,
    ) -> f64 {
        let label = |what: &str| Label {
            name: format!("{what} {name}"),
            unit: self.units.get(name).map(str::to_owned),
        };
        let (left, right) = figure.cell(place, columns);
        let span = Span::of(triples.iter().flat_map(|&(x, y, _)| [x, y])).padded(0.04);
        let y = Axis::vertical(span, label("predicted"), size);
        let error = |&(x, y, sd): &Triple| match sd {
            Some(sd) if sd > 0.0 => (x, (y - x) / sd),
            _ => (x, y - x),
        };
        let stated = triples.iter().any(|triple| triple.2.is_some_and(|sd| sd > 0.0));
        let errors: Vec<(f64, f64)> = triples.iter().map(error).collect();
        let reach = errors.iter().fold(0.0_f64, |reach, error| reach.max(error.1.abs()));
        let reach = if stated { reach.max(2.0 * NINETY_PERCENT) } else { reach };
        let error_label = if stated { Label::new("error / sd") } else { label("error of") };
        let errors_y = Axis::vertical(Span::of([-reach, reach]).padded(0.05), error_label, 0.4 * size);
        let beside = room_beside(&y, size).max(room_beside(&errors_y, 0.4 * size));
        let (left, right) = (left + beside, right - 7.0);
        let x = Axis::horizontal(span, label("simulated"), right - left);
        let most = MOST_DOTS / (2 * columns);
        let dot = Dot::among(triples.len(), color::BLUE);

        let rect = Rect::new(left, top, right, top + size);
        let rms =
            (triples.iter().map(|&(x, y, _)| (x - y).powi(2)).sum::<f64>() / triples.len() as f64).sqrt();
        let unit = self.units.get(name).map(|unit| format!(" {unit}")).unwrap_or_default();
        let heading = format!("root mean square error {}{unit}", gl_figure::number::short(rms));
        let mut panel = Panel::new(format!("predicted against simulated {name}"), rect, x.clone(), y)
            .heading(heading)
            .beside(beside)
            .without_x_labels();
        panel.dots("steps of runs", triples.iter().map(|&(x, y, _)| (x, y)), dot, most);
        panel.line("equal", [(span.low, span.low), (span.high, span.high)], equal_paint());
        figure.add(panel.finish());

        let rect = Rect::new(left, rect.y1 + 7.0, right, rect.y1 + 7.0 + 0.4 * size);
        let mut panel = Panel::new(format!("errors of {name}"), rect, x, errors_y).beside(beside);
        if stated {
            let ends = [span.low, span.high];
            panel.band("90 %", &ends, &[-NINETY_PERCENT; 2], &[NINETY_PERCENT; 2], expected_paint());
        }
        panel.dots("errors", errors, dot, most);
        panel.horizontal("equal", 0.0, equal_paint());
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }
}

fn equal_paint() -> Paint {
    Paint::line(color::VERMILION, 0.9)
}

fn expected_paint() -> Paint {
    Paint::area(color::SKY).opacity(0.35)
}
