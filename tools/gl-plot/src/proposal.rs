//! The mixture that new samples are drawn from, over the samples that it was fitted to or that were
//! drawn from it.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_inference::mixture::Gaussian;
use gl_inference::proposal::Proposal as Mixture;
use gl_inference::samples::Samples;

use crate::Style;
use crate::input::Parameters;
use gl_figure::axis::{Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::matrix::Matrix;
use gl_figure::panel::{Dot, Panel};
use gl_figure::scene::{Color, Paint, Scene, color};

/// Ellipses of the mixture that new samples are drawn from, over the samples
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Proposal {
    /// Samples table, such as those drawn from the proposal
    #[arg(short, long, value_name = "FILE")]
    samples: Option<PathBuf>,
    /// Table of parameters: their units
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Proposal table, as gl-gmm-resample writes it
    #[arg(value_name = "PROPOSAL", default_value = "-")]
    proposal: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'name lower upper\\na 0 1\\nb 0 10\\n' > params.txt
  gl-sample -p params.txt -n 50 -o samples.txt
  awk 'NR == 1 { print \"sample a b weight\" }
    NR > 1 { print $1, $3, $4, exp(-20 * ($3 - .5)^2) }' \\
    samples.txt > weights.txt
  gl-gmm-resample -p params.txt -n 50 --iteration 1 \\
    --proposal-out proposal.txt weights.txt -o next.txt
  gl-plot proposal -s next.txt proposal.txt -o proposal.svg";

const MOST_DOTS: usize = 40_000;
const CELLS: usize = 150;
const CORNERS: usize = 72;
const LEAST_WEIGHT: f64 = 0.01;

/// Density of each component along a parameter, times its weight, at evenly spaced coordinates; shape
/// (components, cells + 1).
fn along(mixture: &Mixture, parameter: usize) -> Result<Vec<Vec<f64>>> {
    let curve = |(weight, gaussian): (f64, Gaussian)| -> Vec<f64> {
        let mut scratch = [0.0];
        (0..=CELLS)
            .map(|i| weight * gaussian.ln_density(&[i as f64 / CELLS as f64], &mut scratch).exp())
            .collect()
    };
    Ok(mixture.marginal(&[parameter])?.into_iter().map(curve).collect())
}

/// The ellipse `reach` standard deviations around a component, in coordinates.
fn ellipse(component: &Gaussian, reach: f64) -> Vec<(f64, f64)> {
    (0..CORNERS)
        .map(|corner| std::f64::consts::TAU * corner as f64 / CORNERS as f64)
        .map(|angle| component.point(&[reach * angle.cos(), reach * angle.sin()]))
        .map(|place| (place[0], place[1]))
        .collect()
}

/// Everything that the panels show.
struct Data {
    names: Vec<String>,
    labels: Vec<Label>,
    /// Where the mixture is.
    bounds: Vec<Span>,
    samples: Vec<Vec<f64>>,
    weight: Vec<f64>,
    /// See [`along`], shape (parameters, components, cells + 1); and their sums.
    along: Vec<Vec<Vec<f64>>>,
    sums: Vec<Vec<f64>>,
    /// The mixture of each pair, shape (parameters, those before, components).
    pairs: Vec<Vec<Vec<(f64, Gaussian)>>>,
}

impl Proposal {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let data = self.data()?;
        let mut figure = Figure::new(format!("Proposal for {}", data.names.join(", ")), style.width);
        figure.legend(&data.legend());
        data.matrix().draw(
            &mut figure,
            |panel, j| data.draw_single(panel, j),
            |panel, i, j| data.draw_pair(panel, i, j),
        );
        Ok(figure.finish())
    }

    fn data(&self) -> Result<Data> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let mixture = Mixture::read(&self.proposal)?;
        let names: Vec<String> = mixture.parameters().iter().map(|known| known.name.clone()).collect();
        let n = names.len();
        ensure!(n > 0, "{}: no column mean(NAME) in it; is it a proposal?", self.proposal.display());
        let along: Vec<Vec<Vec<f64>>> = (0..n).map(|j| along(&mixture, j)).collect::<Result<_>>()?;
        let sum = |components: &Vec<Vec<f64>>| {
            (0..=CELLS).map(|i| components.iter().map(|curve| curve[i]).sum()).collect()
        };
        Ok(Data {
            samples: match &self.samples {
                Some(path) => Samples::read(path)?.columns(&names)?,
                None => Vec::new(),
            },
            bounds: mixture.parameters().iter().map(Span::of_bounds).collect(),
            labels: names.iter().map(|name| parameters.label(name)).collect(),
            weight: mixture.components().map(|(weight, _)| weight).collect(),
            pairs: (0..n)
                .map(|j| (0..j).map(|i| mixture.marginal(&[i, j])).collect())
                .collect::<Result<_>>()?,
            sums: along.iter().map(sum).collect(),
            along,
            names,
        })
    }
}

impl Data {
    /// What hardly anything is drawn from would only be in the way.
    fn is_drawn(&self, component: usize) -> bool {
        self.weight[component] >= LEAST_WEIGHT
    }

    fn legend(&self) -> Vec<(Key, String)> {
        let all = 0..self.weight.len();
        let label = match all.clone().filter(|&k| !self.is_drawn(k)).count() {
            0 => "mixture".to_owned(),
            1 => "mixture (1 component below 1 % is not drawn)".to_owned(),
            few => format!("mixture ({few} components below 1 % are not drawn)"),
        };
        let mut legend = vec![(Key::Line(mixture_paint()), label)];
        let shown = self.weight.len().min(color::SERIES.len() - 1);
        for k in (0..shown).filter(|&k| self.is_drawn(k)) {
            let label = format!("component {}: {:.0} %", k + 1, 100.0 * self.weight[k]);
            legend.push((Key::Line(Paint::line(component_color(k), 1.0)), label));
        }
        let others = all.skip(shown).filter(|&k| self.is_drawn(k)).count();
        if others > 0 {
            let others = format!("{others} more");
            legend.push((Key::Line(Paint::line(component_color(shown), 1.0)), others));
        }
        if self.names.len() > 1 {
            let paint = Paint::line(color::INK, 0.8).dashed(3.0, 2.0);
            legend.push((Key::Line(paint), "2 sd (1 sd drawn through)".to_owned()));
        }
        if !self.samples.is_empty() {
            legend.push((Key::Dot(Dot::among(1, color::GREY)), "samples".to_owned()));
        }
        legend
    }

    fn matrix(&self) -> Matrix {
        Matrix {
            spans: self.bounds.iter().map(|bounds| bounds.padded(0.04)).collect(),
            labels: self.labels.clone(),
            highest: self.sums.iter().map(|sum| sum.iter().copied().fold(0.0, f64::max)).collect(),
            headings: vec![String::new(); self.names.len()],
        }
    }

    fn draw_single(&self, panel: &mut Panel, j: usize) {
        let at = |i: usize| self.bounds[j].value(i as f64 / CELLS as f64);
        let curve = |values: &[f64]| -> Vec<(f64, f64)> {
            values.iter().enumerate().map(|(i, &height)| (at(i), height)).collect()
        };
        let ticks = self.samples.iter().map(|row| (row[j], 0.0));
        let dot = Dot::among(self.samples.len(), color::GREY);
        panel.dots("samples", ticks, dot, MOST_DOTS / self.names.len());
        for (k, values) in self.along[j].iter().enumerate().filter(|(k, _)| self.is_drawn(*k)) {
            let paint = Paint::line(component_color(k), 0.9);
            panel.line(&format!("component {}", k + 1), curve(values), paint);
        }
        panel.line("mixture", curve(&self.sums[j]), mixture_paint());
    }

    fn draw_pair(&self, panel: &mut Panel, i: usize, j: usize) {
        let n = self.names.len();
        let points = self.samples.iter().map(|row| (row[i], row[j]));
        let dot = Dot::among(self.samples.len() * n, color::GREY);
        panel.dots("samples", points, dot, MOST_DOTS / (n * (n - 1) / 2).max(1));
        let value = |(x, y): (f64, f64)| (self.bounds[i].value(x), self.bounds[j].value(y));
        for (k, (_, component)) in self.pairs[j][i].iter().enumerate().filter(|(k, _)| self.is_drawn(*k)) {
            let outline = |reach: f64| [ellipse(component, reach).into_iter().map(value).collect::<Vec<_>>()];
            let paint = Paint::line(component_color(k), 1.0);
            let title = format!("component {}", k + 1);
            panel.outlines(&title, &outline(1.0), paint);
            panel.outlines(&title, &outline(2.0), paint.dashed(3.0, 2.0));
        }
    }
}

fn mixture_paint() -> Paint {
    Paint::line(color::BLUE, 1.4)
}

/// The palette without the mixture's own blue; the rest share the last colour.
fn component_color(k: usize) -> Color {
    let rest = &color::SERIES[1..];
    rest[k.min(rest.len() - 1)]
}
