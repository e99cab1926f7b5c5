//! The mixture that new samples are drawn from, over the samples that it was fitted to or that were
//! drawn from it.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl::samples::Samples;
use gl::table::Table;

use crate::Style;
use crate::axis::Span;
use crate::figure::{Figure, Key};
use crate::input::Parameters;
use crate::matrix;
use crate::panel::{Dot, Panel};
use crate::scene::{Color, Paint, Scene, color};

/// Ellipses of the mixture that new samples are drawn from, over the samples
#[derive(Args)]
pub struct Proposal {
    /// Samples table, such as those drawn from the proposal
    #[arg(short, long, value_name = "FILE")]
    samples: Option<PathBuf>,
    /// Table of parameters: their units
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Proposal table: `weight mean(NAME) cov(NAME,NAME) lower(NAME) upper(NAME) log(NAME)`
    #[arg(value_name = "PROPOSAL", default_value = "-")]
    proposal: PathBuf,
}

/// Normal distributions in coordinates between the bounds, and their weights.
struct Mixture {
    names: Vec<String>,
    bounds: Vec<Span>,
    weight: Vec<f64>,
    /// Shape (components, parameters).
    mean: Vec<Vec<f64>>,
    /// Shape (components, parameters, parameters).
    covariance: Vec<Vec<Vec<f64>>>,
}

const MOST_DOTS: usize = 40_000;
const CELLS: usize = 150;
const CORNERS: usize = 72;

impl Mixture {
    fn from_table(table: &Table) -> Result<Self> {
        let source = table.format().source();
        ensure!(!table.is_empty(), "{source}: no rows; a mixture has a component in each");
        let inside = |column: &str| column.strip_prefix("mean(")?.strip_suffix(')').map(str::to_owned);
        let names: Vec<String> =
            table.format().columns().iter().filter_map(|column| inside(column)).collect();
        ensure!(!names.is_empty(), "{source}:1: no column mean(NAME); is it a proposal of gl-gmm-resample?");
        let column = |what: &str, name: &str| table.numbers(&format!("{what}({name})"));
        let mut bounds = Vec::new();
        for name in &names {
            let (low, high, log) =
                (column("lower", name)?[0], column("upper", name)?[0], column("log", name)?[0]);
            ensure!(
                low < high,
                "{source}:{}: column upper({name}): {high} is not above {low}",
                table.line(0)
            );
            let span = Span { low, high, log: false };
            bounds.push(if log == 1.0 { span.logarithmic() } else { span });
        }
        let means = names.iter().map(|name| column("mean", name)).collect::<Result<Vec<_>>>()?;
        let pair = |a: &str, b: &str| -> Result<Vec<f64>> {
            // A symmetric matrix need not be written twice.
            let there = table.format().find(&format!("cov({a},{b})"))?.is_some();
            if there { column("cov", &format!("{a},{b}")) } else { column("cov", &format!("{b},{a}")) }
        };
        let covariances = names
            .iter()
            .map(|a| names.iter().map(|b| pair(a, b)).collect::<Result<Vec<_>>>())
            .collect::<Result<Vec<_>>>()?;
        let n = 0..names.len();
        Ok(Self {
            weight: table.numbers("weight")?,
            mean: (0..table.len()).map(|k| n.clone().map(|j| means[j][k]).collect()).collect(),
            covariance: (0..table.len())
                .map(|k| n.clone().map(|i| n.clone().map(|j| covariances[i][j][k]).collect()).collect())
                .collect(),
            bounds,
            names,
        })
    }

    /// Density of each component along a parameter, times its weight, at evenly spaced coordinates;
    /// shape (components, cells).
    fn along(&self, j: usize) -> Vec<Vec<f64>> {
        let component = |k: usize| -> Vec<f64> {
            let sd = self.covariance[k][j][j].max(0.0).sqrt().max(1e-9);
            let height = self.weight[k] / (sd * std::f64::consts::TAU.sqrt());
            (0..=CELLS)
                .map(|i| (i as f64 / CELLS as f64 - self.mean[k][j]) / sd)
                .map(|z| height * (-0.5 * z * z).exp())
                .collect()
        };
        (0..self.weight.len()).map(component).collect()
    }

    /// The ellipse `reach` standard deviations around a component's mean.
    fn ellipse(&self, k: usize, i: usize, j: usize, reach: f64) -> Vec<(f64, f64)> {
        let covariance = &self.covariance[k];
        // The lower Cholesky factor takes a circle to the ellipse.
        let a = covariance[i][i].max(0.0).sqrt();
        let b = if a > 0.0 { covariance[i][j] / a } else { 0.0 };
        let c = (covariance[j][j] - b * b).max(0.0).sqrt();
        (0..CORNERS)
            .map(|corner| std::f64::consts::TAU * corner as f64 / CORNERS as f64)
            .map(|angle| (reach * angle.cos(), reach * angle.sin()))
            .map(|(u, v)| (self.mean[k][i] + a * u, self.mean[k][j] + b * u + c * v))
            .map(|(x, y)| (self.bounds[i].value(x), self.bounds[j].value(y)))
            .collect()
    }
}

impl Proposal {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let mixture = Mixture::from_table(&Table::read(&self.proposal)?)?;
        let n = mixture.names.len();
        let samples = match &self.samples {
            Some(path) => Samples::read(path)?.columns(&mixture.names)?,
            None => Vec::new(),
        };
        let spans: Vec<Span> = mixture.bounds.iter().map(|bounds| bounds.padded(0.04)).collect();
        let labels: Vec<_> = mixture.names.iter().map(|name| parameters.label(name)).collect();
        let along: Vec<Vec<Vec<f64>>> = (0..n).map(|j| mixture.along(j)).collect();
        let sums: Vec<Vec<f64>> = along
            .iter()
            .map(|components| (0..=CELLS).map(|i| components.iter().map(|curve| curve[i]).sum()).collect())
            .collect();
        let highest: Vec<f64> =
            sums.iter().map(|sum: &Vec<f64>| sum.iter().copied().fold(0.0, f64::max)).collect();

        let mut figure = Figure::new(format!("Proposal for {}", mixture.names.join(", ")), style.width);
        let mut legend = vec![(Key::Line(Paint::line(color::BLUE, 1.4)), "mixture".to_owned())];
        let shown = mixture.weight.len().min(color::SERIES.len() - 1);
        for k in 0..shown {
            let label = format!("component {}: {:.0} %", k + 1, 100.0 * mixture.weight[k]);
            legend.push((Key::Line(Paint::line(component_color(k), 1.0)), label));
        }
        if mixture.weight.len() > shown {
            let others = format!("{} more", mixture.weight.len() - shown);
            legend.push((Key::Line(Paint::line(component_color(shown), 1.0)), others));
        }
        if n > 1 {
            legend.push((
                Key::Line(Paint::line(color::INK, 0.8).dashed(3.0, 2.0)),
                "2 sd (1 sd drawn through)".to_owned(),
            ));
        }
        if !samples.is_empty() {
            legend.push((Key::Dot(Dot::among(1, color::GREY)), "samples".to_owned()));
        }
        figure.legend(&legend);

        let most = MOST_DOTS / (n * (n - 1) / 2).max(1);
        matrix::draw(
            &mut figure,
            &spans,
            &labels,
            &highest,
            |panel, j| {
                let at = |i: usize| mixture.bounds[j].value(i as f64 / CELLS as f64);
                let curve = |values: &[f64]| -> Vec<(f64, f64)> {
                    values.iter().enumerate().map(|(i, &height)| (at(i), height)).collect()
                };
                let ticks = samples.iter().map(|row| (row[j], 0.0));
                panel.dots("samples", ticks, Dot::among(samples.len(), color::GREY), MOST_DOTS / n);
                for (k, values) in along[j].iter().enumerate() {
                    let paint = Paint::line(component_color(k), 0.9);
                    panel.line(&format!("component {}", k + 1), curve(values), paint);
                }
                panel.line("mixture", curve(&sums[j]), Paint::line(color::BLUE, 1.4));
            },
            |panel: &mut Panel, i, j| {
                let points = samples.iter().map(|row| (row[i], row[j]));
                panel.dots("samples", points, Dot::among(samples.len() * n / 2, color::GREY), most);
                for k in 0..mixture.weight.len() {
                    let paint = Paint::line(component_color(k), 1.0);
                    let title = format!("component {}", k + 1);
                    panel.outlines(&title, &[mixture.ellipse(k, i, j, 1.0)], paint);
                    panel.outlines(&title, &[mixture.ellipse(k, i, j, 2.0)], paint.dashed(3.0, 2.0));
                }
            },
        );
        Ok(figure.finish())
    }
}

/// The palette without the mixture's own blue; the rest share the last colour.
fn component_color(k: usize) -> Color {
    let rest = &color::SERIES[1..];
    rest[k.min(rest.len() - 1)]
}
