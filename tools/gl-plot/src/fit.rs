//! The measurement, what the calibrated runs make of it, and what is left over.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;
use gl_cli::measured::{Measurement, Part, Tables};
use gl_inference::ensemble::Ensemble;
use gl_inference::predict::{Predicted, predict};
use gl_inference::stack::named;
use gl_inference::weights::Weights;
use gl_table::Table;

use crate::Style;
use crate::input::check_panels;
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Paint, Rect, Scene, color};
use gl_inference::units::Units;

/// Measurement, mean and 90 % band of runs or of a posterior, the best runs, and the residuals
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Fit {
    /// Column of the control; by default the one after `step`
    #[arg(short, long, value_name = "NAME")]
    control: Option<String>,
    /// Columns of the observables; by default all after the control
    #[arg(short = 'v', long, value_name = "NAME,…", value_delimiter = ',')]
    observables: Vec<String>,
    #[command(flatten)]
    tables: Tables,
    /// Weights of the runs; without them every run counts alike
    #[arg(short, long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// What the posterior predicts, by gl-posterior --curves-out: mean and band are of its draws, not of the runs
    #[arg(long, value_name = "FILE")]
    posterior: Option<PathBuf>,
    /// Unit of columns, as in q=MPa,u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// How many of the best runs to show
    #[arg(long, value_name = "N", default_value_t = 3)]
    best: usize,
    /// Ensemble table; NAME=ENSEMBLE for each --test
    #[arg(value_name = "ENSEMBLE", default_value = "-")]
    ensembles: Vec<PathBuf>,
}

const EXAMPLE: &str = "\
Example:
  printf 'u f f_sd\\n0 0 .1\\n1 1.1 .1\\n' > obs.txt
  printf 'sample step u f\\na 0 0 0\\na 1 1 .9\\nb 0 0 0\\nb 1 1 1.2\\n' > runs.txt
  printf 'sample k misfit weight\\na .9 2 .4\\nb 1.2 1 .6\\n' > weights.txt
  gl-plot fit -b obs.txt -c u -v f -w weights.txt --units u=mm,f=kN \\
    runs.txt -o fit.svg";

/// One observable: what was measured, what the runs say, all of shape (steps,).
struct Curves<'a> {
    name: String,
    /// Its own name, without that of a test, which has the unit.
    observable: &'a str,
    control: &'a [f64],
    control_name: &'a str,
    measured: &'a [f64],
    noise: Option<&'a [f64]>,
    mean: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    best: Vec<&'a [f64]>,
}

const BEST: [gl_figure::scene::Color; 3] = [color::VERMILION, color::ORANGE, color::GREEN];
/// More readings than this have their noise drawn as a band.
const MOST_BARS: usize = 60;

impl Fit {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let parts = self.parts()?;
        let panels = parts.iter().map(|part| part.observations.names.len()).sum();
        check_panels(&parts[0].ensemble.source, panels)?;
        let weights = self.weights.as_deref().map(Weights::read).transpose()?;
        let first = &parts[0].ensemble;
        ensure!(!first.is_empty(), "{}: no runs; there is nothing to draw", first.source);
        let (weight, best) = match &weights {
            Some(weights) => (weights.of_runs(first)?, best(first, weights, self.best)),
            None => (vec![1.0 / first.len() as f64; first.len()], Vec::new()),
        };
        let of_draws = self.posterior.as_deref().map(Draws::read).transpose()?;
        let mut curves = Vec::new();
        for Part { name, first, observations, noise, ensemble } in &parts {
            let of_runs = predict(ensemble, &weight)?;
            for (j, observable) in observations.names.iter().enumerate() {
                let name = named(name, observable);
                let [mean, low, high] = match &of_draws {
                    Some(draws) => draws.of(&name, *first..*first + observations.steps())?,
                    None => [
                        of_runs[j].iter().map(|moments| moments.mean).collect(),
                        of_runs[j].iter().map(|moments| moments.quantiles[0]).collect(),
                        of_runs[j].iter().map(|moments| moments.quantiles[2]).collect(),
                    ],
                };
                curves.push(Curves {
                    name,
                    observable,
                    control: &observations.control,
                    control_name: &observations.control_name,
                    measured: &observations.values[j],
                    noise: noise.as_ref().map(|noise| noise[j].as_slice()),
                    mean,
                    low,
                    high,
                    best: best.iter().map(|&run| ensemble.curve(run, j)).collect(),
                });
            }
        }
        let best_names: Vec<&str> = best.iter().map(|&run| first.samples[run].as_str()).collect();
        Ok(self.figure(style, &curves, &best_names, weights.is_some()))
    }

    /// The tests with their runs; one without a name where no tests are given.
    fn parts(&self) -> Result<Vec<Part>> {
        if self.tables.is_stack() {
            return self.tables.read("", &[])?.parts("gl-plot", &self.ensembles);
        }
        let [ensemble] = self.ensembles.as_slice() else {
            bail!("give one ensemble, or tests with --test and NAME=ENSEMBLE for each");
        };
        let ensemble = Ensemble::read_by_header(ensemble, self.control.as_deref(), &self.observables)?;
        let Measurement { observations, noise, .. } =
            self.tables.read(&ensemble.control_name, &ensemble.observables)?;
        ensure!(!ensemble.is_empty(), "{}: no runs; there is nothing to draw", ensemble.source);
        ensemble.check_steps(&observations)?;
        Ok(vec![Part { name: String::new(), first: 0, observations, noise, ensemble }])
    }

    fn figure(&self, style: &Style, curves: &[Curves], best: &[&str], weighted: bool) -> Scene {
        let names: Vec<&str> = curves.iter().map(|curves| curves.name.as_str()).collect();
        let mut controls: Vec<&str> = curves.iter().map(|curves| curves.control_name).collect();
        controls.dedup();
        let title = format!("Fit of {} against {}", names.join(", "), controls.join(", "));
        let mut figure = Figure::new(title, style.width);
        let most = curves.iter().map(|curves| curves.control.len()).max().unwrap_or(0);
        let paint = Paints::new(most);
        let mean = match (&self.posterior, weighted) {
            (Some(_), _) => "posterior's mean",
            (None, true) => "weighted mean",
            (None, false) => "mean of all runs",
        };
        let mut legend = vec![(Key::Dot(paint.dot), "measured".to_owned())];
        if curves.iter().any(|curves| curves.noise.is_some()) {
            let noise = "noise, ± 1 sd".to_owned();
            legend.push(if most > MOST_BARS {
                (Key::Area(paint.noise_band), noise)
            } else {
                (Key::Line(paint.noise_bar), noise)
            });
        }
        legend.push((Key::Line(paint.mean), mean.to_owned()));
        legend.push((Key::Band(paint.band, paint.edge), "90 % band".to_owned()));
        for (rank, name) in best.iter().enumerate() {
            legend.push((Key::Line(paint.best(rank)), format!("{}: {name}", rank + 1)));
        }
        figure.legend(&legend);

        let columns = figure.columns(curves.len(), 130.0);
        for row in curves.chunks(columns) {
            let (left, right) = figure.cell(0, columns);
            let height = (0.72 * (right - left)).clamp(90.0, 190.0);
            let (top, middle) = (figure.y + 4.0, figure.y + 4.0 + height);
            let (residual_top, bottom) = (middle + 8.0, middle + 8.0 + 0.48 * height);
            let mut foot = bottom;
            for (column, curves) in row.iter().enumerate() {
                let (left, right) = figure.cell(column, columns);
                let Curves { control, control_name, observable, .. } = *curves;
                let paint = Paints::new(control.len());
                let label = |name: &str, of: &str| Label {
                    name: name.to_owned(),
                    unit: self.units.get(of).map(str::to_owned),
                };
                let all = curves.everything().padded(0.05);
                let rest = curves.residuals().padded(0.05);
                let y = Axis::vertical(all, label(&curves.name, observable), height);
                let residual = Label {
                    name: "residual".to_owned(),
                    unit: self.units.get(observable).map(str::to_owned),
                };
                let residual_y = Axis::vertical(rest, residual, bottom - residual_top);
                let beside = room_beside(&y, height).max(room_beside(&residual_y, bottom - residual_top));
                let left = left + beside;
                let right = right - 7.0;
                let span = Span::of(control.iter().copied()).padded(0.03);
                let x = Axis::horizontal(span, label(control_name, control_name), right - left);
                let place = Rect::new(left, top, right, middle);
                let name = format!("{} against {control_name}", curves.name);
                let mut panel = Panel::new(name, place, x.clone(), y).beside(beside).without_x_labels();
                curves.draw(&mut panel, control, &paint);
                figure.add(panel.finish());
                let place = Rect::new(left, residual_top, right, bottom);
                let name = format!("residual of {}", curves.name);
                let mut panel = Panel::new(name, place, x, residual_y).beside(beside);
                curves.draw_residuals(&mut panel, control, &paint);
                foot = foot.max(panel.foot());
                figure.add(panel.finish());
            }
            figure.y = foot;
        }
        figure.finish()
    }
}

/// What the draws of a posterior predict.
struct Draws<'a> {
    source: &'a Path,
    rows: Vec<Predicted>,
}

impl<'a> Draws<'a> {
    fn read(source: &'a Path) -> Result<Self> {
        Ok(Self { source, rows: Table::read(source)?.rows()? })
    }

    /// Mean and the ends of the band of an observable at these steps, each of shape (steps,); where a reading was left out
    /// as one that is far off, on a line between its neighbours.
    fn of(&self, observable: &str, steps: Range<usize>) -> Result<[Vec<f64>; 3]> {
        let rows: Vec<&Predicted> = self.rows.iter().filter(|row| row.observable == observable).collect();
        let is_within = rows.iter().all(|row| steps.contains(&row.step));
        let is_in_order = rows.windows(2).all(|pair| pair[0].step < pair[1].step);
        ensure!(
            is_within && is_in_order && 2 * rows.len() > steps.len(),
            "{}: {} steps of {observable} where the measurement has {}",
            self.source.display(),
            rows.len(),
            steps.len()
        );
        let at = |step: usize, of: fn(&Predicted) -> f64| {
            let after = rows.partition_point(|row| row.step < step).min(rows.len() - 1);
            let before = if rows[after].step > step { after.saturating_sub(1) } else { after };
            let (a, b) = (rows[before], rows[after]);
            let share = (step.max(a.step) - a.step) as f64 / (b.step - a.step).max(1) as f64;
            of(a) + share.min(1.0) * (of(b) - of(a))
        };
        let column = |of: fn(&Predicted) -> f64| steps.clone().map(|step| at(step, of)).collect();
        Ok([column(|row| row.mean), column(|row| row.q05), column(|row| row.q95)])
    }
}

/// The runs with the lowest misfit, or with the highest weight where the table has no misfit.
fn best(ensemble: &Ensemble, weights: &Weights, count: usize) -> Vec<usize> {
    let runs = ensemble.index();
    let cost = |i: usize| weights.misfit.as_ref().map_or(-weights.weight[i], |misfit| misfit[i]);
    let mut ranked: Vec<(f64, usize)> =
        (0..weights.len()).filter_map(|i| Some((cost(i), *runs.get(weights.samples[i].as_str())?))).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked.into_iter().take(count).map(|(_, run)| run).collect()
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn pairs<'a>(x: &'a [f64], y: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + 'a {
    x.iter().copied().zip(y.iter().copied())
}

impl Curves<'_> {
    fn noise_ends(&self, centre: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
        let noise = self.noise?;
        let up = centre.iter().zip(noise).map(|(y, sd)| y + sd).collect();
        Some((minus(centre, noise), up))
    }

    /// All that the upper panel has to show.
    fn everything(&self) -> Span {
        let (low, high) = self.noise_ends(self.measured).unwrap_or_default();
        let best = self.best.iter().flat_map(|curve| curve.iter());
        Span::of(
            [self.measured, &self.mean, &self.low, &self.high, &low, &high]
                .into_iter()
                .flatten()
                .chain(best)
                .copied(),
        )
    }

    /// All that the lower panel has to show.
    fn residuals(&self) -> Span {
        let noise = self.noise.unwrap_or_default().iter().flat_map(|sd| [-sd, *sd]);
        let best = self.best.iter().flat_map(|curve| minus(self.measured, curve));
        let band = [&self.mean, &self.low, &self.high].into_iter().flat_map(|y| minus(self.measured, y));
        Span::of(noise.chain(best).chain(band)).with(0.0)
    }

    fn draw(&self, panel: &mut Panel, control: &[f64], paint: &Paints) {
        if let Some((low, high)) = self.noise_ends(self.measured) {
            paint.noise(panel, control, &low, &high);
        }
        for (rank, curve) in self.best.iter().enumerate().rev() {
            panel.line(&format!("best run {}", rank + 1), pairs(control, curve), paint.best(rank));
        }
        paint.prediction(panel, control, &self.low, &self.high, &self.mean);
        panel.dots("measured", pairs(control, self.measured), paint.dot, 4000);
    }

    fn draw_residuals(&self, panel: &mut Panel, control: &[f64], paint: &Paints) {
        if let Some((low, high)) = self.noise_ends(&vec![0.0; control.len()]) {
            panel.band("noise", control, &low, &high, paint.noise_band);
        }
        for (rank, curve) in self.best.iter().enumerate().rev() {
            let residual = minus(self.measured, curve);
            panel.line(&format!("best run {}", rank + 1), pairs(control, &residual), paint.best(rank));
        }
        let (low, high) = (minus(self.measured, &self.high), minus(self.measured, &self.low));
        panel.horizontal("zero", 0.0, Paint::line(color::INK, 0.5));
        paint.prediction(panel, control, &low, &high, &minus(self.measured, &self.mean));
    }
}

/// How each series looks.
struct Paints {
    dot: Dot,
    noise_bar: Paint,
    noise_band: Paint,
    mean: Paint,
    band: Paint,
    edge: Paint,
}

impl Paints {
    fn new(steps: usize) -> Self {
        Self {
            dot: Dot::among(steps, color::BLACK),
            noise_bar: Paint::line(color::GREY, 0.7),
            noise_band: Paint::area(color::GREY).opacity(0.3),
            mean: Paint::line(color::BLUE, 1.1),
            band: Paint::area(color::SKY).opacity(0.4),
            edge: Paint::line(color::BLUE, 0.4),
        }
    }

    fn best(&self, rank: usize) -> Paint {
        // Wide and pale, below the mean, which they mostly lie on.
        let paint = Paint::line(BEST[rank % BEST.len()], 2.6 - 0.5 * rank.min(3) as f64).opacity(0.5);
        if rank == 0 { paint } else { paint.dashed(4.0 / rank as f64, 2.5) }
    }

    /// Mean and band of the runs, over everything else.
    fn prediction(&self, panel: &mut Panel, control: &[f64], low: &[f64], high: &[f64], mean: &[f64]) {
        panel.band("90 % band", control, low, high, self.band);
        for edge in [low, high] {
            panel.line("end of the band", pairs(control, edge), self.edge);
        }
        panel.line("mean", pairs(control, mean), self.mean);
    }

    fn noise(&self, panel: &mut Panel, control: &[f64], low: &[f64], high: &[f64]) {
        if control.len() > MOST_BARS {
            panel.band("noise", control, low, high, self.noise_band);
        } else {
            let bars = control.iter().zip(low.iter().zip(high)).map(|(x, (low, high))| (*x, *low, *high));
            panel.bars("noise", bars, self.noise_bar);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_that_was_left_out_is_drawn_between_its_neighbours() {
        let row = |step: usize| Predicted {
            observable: "f".to_owned(),
            step,
            control: step as f64,
            mean: (step * step) as f64,
            sd: 0.0,
            q05: 0.0,
            q50: 0.0,
            q95: 1.0,
        };
        let draws = Draws { source: Path::new("curves.txt"), rows: [3, 4, 7, 8].map(row).into() };
        let [mean, ..] = draws.of("f", 2..10).unwrap_or_default();
        assert_eq!(mean, Vec::<f64>::new(), "of half of the readings nothing is drawn");
        let [mean, low, high] = draws.of("f", 2..9).unwrap_or_default();
        assert_eq!(mean, [9.0, 9.0, 16.0, 27.0, 38.0, 49.0, 64.0]);
        assert_eq!((low, high), (vec![0.0; 7], vec![1.0; 7]));
        assert!(draws.of("f", 4..9).is_err() && draws.of("g", 3..9).is_err());
    }
}
