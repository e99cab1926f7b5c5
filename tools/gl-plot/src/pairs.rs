//! Samples of every iteration, and what the posterior makes of each pair of parameters.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use gl_inference::observations::ByName;
use gl_inference::samples::Samples;
use gl_inference::summary::Summary;
use gl_numeric::density::{joint, levels, marginal};

use crate::Style;
use crate::input::{
    Estimate, Parameters, check_panels, check_truth, column, moving, place_within, read_weights, stem, within,
};
use gl_figure::axis::{Label, Span};
use gl_figure::contour;
use gl_figure::figure::{Figure, Key, star_paint};
use gl_figure::matrix::Matrix;
use gl_figure::panel::{Dot, Panel};
use gl_figure::scene::{Color, Paint, Scene, color, star};

/// Samples of every iteration, and the posterior density of each pair of parameters
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Pairs {
    /// Table of weights: the posterior
    #[arg(short, long, value_name = "FILE")]
    weights: PathBuf,
    /// Samples table; may be repeated, one an iteration. Without it the weighed samples are shown
    #[arg(short, long, value_name = "FILE")]
    samples: Vec<PathBuf>,
    /// Table of parameters: their bounds, scales and units
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// True values where they are known, as in a=0.2,b=5
    #[arg(long, value_name = "NAME=VALUE,…")]
    truth: Option<ByName>,
    /// Summary of the weights: means and intervals, which allow for few runs
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    /// Axes as wide as the posterior, not as the bounds
    #[arg(long)]
    close_up: bool,
}

const EXAMPLE: &str = "\
Example:
  printf 'sample E mu weight\\na 1e9 .3 .1\\nb 2e9 .4 .9\\n' > weights.txt
  printf 'description E mu\\na 1e9 .3\\nb 2e9 .4\\n' > samples.txt
  printf 'name lower upper unit\\nE 1e9 4e9 Pa\\nmu .2 .5 -\\n' > params.txt
  gl-plot pairs -w weights.txt -s samples.txt -p params.txt \\
    --truth E=2e9,mu=.4 -o pairs.svg";

const CELLS: usize = 48;
/// Iterations that the legend names; more only blur together.
const MOST_NAMED: usize = 6;
const CELLS_OF_ONE: usize = 120;
/// Dots of all panels together, and of one.
const MOST_DOTS: usize = 12_000;
const MOST_IN_A_PANEL: usize = 1500;

/// Samples that are drawn alike.
struct Cloud {
    label: String,
    /// Shape (parameters, samples).
    values: Vec<Vec<f64>>,
    color: Color,
    /// One in how many is drawn: all would hide the density, and those that the eye could tell apart
    /// would look evenly spread.
    stride: usize,
}

impl Cloud {
    fn new(label: String, values: Vec<Vec<f64>>, color: Color, most: usize) -> Self {
        let stride = values[0].len().div_ceil(most.max(1)).max(1);
        let label = if stride > 1 { format!("{label} (1 in {stride})") } else { label };
        Self { label, values, color, stride }
    }

    /// The values of a parameter that are drawn.
    fn drawn(&self, parameter: usize) -> impl Iterator<Item = f64> {
        self.values[parameter].iter().copied().step_by(self.stride)
    }
}

/// Everything that the panels show, of parameters in the order of `names`.
struct Data {
    names: Vec<String>,
    labels: Vec<Label>,
    /// Weighed samples, shape (parameters, samples).
    values: Vec<Vec<f64>>,
    weight: Vec<f64>,
    clouds: Vec<Cloud>,
    /// The clouds that the legend names.
    named: Vec<usize>,
    truth: ByName,
    spans: Vec<Span>,
    /// Where samples can be.
    supports: Vec<Span>,
    /// Density of the posterior, shape (parameters, cells).
    marginals: Vec<Vec<f64>>,
    /// Densities of the samples of each named cloud, shape (parameters, clouds, cells).
    searched: Vec<Vec<Vec<f64>>>,
    /// Mean and interval.
    estimates: Vec<Estimate>,
}

impl Pairs {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let data = self.data()?;
        let mut figure = Figure::new(format!("Pairs of {}", data.names.join(", ")), style.width);
        figure.legend(&data.legend());
        let matrix = data.matrix(figure.width);
        matrix.draw(
            &mut figure,
            |panel, j| data.draw_single(panel, j, matrix.highest[j]),
            |panel, i, j| data.draw_pair(panel, i, j),
        );
        Ok(figure.finish())
    }

    fn data(&self) -> Result<Data> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let summary = self.summary.as_deref().map(Summary::read).transpose()?;
        let all = read_weights(&self.weights)?;
        let truth = self.truth.clone().unwrap_or_default();
        check_truth(&truth, &all.parameters)?;
        let weights = moving(all);
        let names = weights.parameters.clone();
        let n = names.len();
        check_panels(&weights.source, n * (n + 1) / 2)?;
        let values: Vec<Vec<f64>> = (0..n).map(|j| column(&weights, j)).collect();
        let clouds = self.clouds(&names, &values)?;
        let span = |j: usize| {
            if self.close_up {
                return parameters.close_span(&names[j], &values[j], &weights.weight);
            }
            let clouds = clouds.iter().flat_map(|cloud| cloud.values[j].iter().copied());
            let all: Vec<f64> = values[j].iter().copied().chain(clouds).chain(truth.get(&names[j])).collect();
            parameters.span(&names[j], &all)
        };
        let spans: Vec<Span> = (0..n).map(span).collect();
        let supports: Vec<Span> =
            (0..n).map(|j| parameters.support(&names[j], spans[j], &values[j])).collect();
        let density = |j: usize, values: &[f64], weights: &[f64]| {
            let (places, weights) = within(supports[j], values, weights);
            marginal(&places, &weights, CELLS_OF_ONE)
        };
        let named = named(clouds.len());
        // Where each iteration searched; without tables of samples there is nothing to tell.
        let has_searched = !self.samples.is_empty() && !self.close_up;
        let searched = |j: usize| {
            let of = |&cloud: &usize| {
                let values = &clouds[cloud].values[j];
                density(j, values, &vec![1.0 / values.len() as f64; values.len()])
            };
            named.iter().filter(|_| has_searched).map(of).collect()
        };
        let estimate = |j: usize| {
            let parameter = (names[j].as_str(), parameters.is_log(&names[j]));
            Estimate::of(summary.as_ref(), parameter, &values[j], &weights.weight)
        };
        Ok(Data {
            labels: names.iter().map(|name| parameters.label(name)).collect(),
            marginals: (0..n).map(|j| density(j, &values[j], &weights.weight)).collect(),
            searched: (0..n).map(searched).collect(),
            estimates: (0..n).map(estimate).collect::<Result<_>>()?,
            names,
            weight: weights.weight,
            values,
            clouds,
            named,
            truth,
            spans,
            supports,
        })
    }

    fn clouds(&self, names: &[String], weighed: &[Vec<f64>]) -> Result<Vec<Cloud>> {
        let panels = (names.len() * (names.len() - 1) / 2).max(1);
        let most = (MOST_DOTS / (panels * self.samples.len().max(1))).min(MOST_IN_A_PANEL);
        if self.samples.is_empty() {
            let label = "samples".to_owned();
            return Ok(vec![Cloud::new(label, weighed.to_vec(), color::GREY, most)]);
        }
        let last = (self.samples.len() - 1).max(1) as f64;
        let cloud = |(i, path): (usize, &PathBuf)| -> Result<Cloud> {
            let rows = Samples::read(path)?.columns(names)?;
            let values = (0..names.len()).map(|j| rows.iter().map(|row| row[j]).collect()).collect();
            Ok(Cloud::new(self.label(i, path), values, shade(i as f64 / last), most))
        };
        self.samples.iter().enumerate().map(cloud).collect()
    }

    /// What tells this file from the others: its name, or its folder's; else its place among them.
    fn label(&self, i: usize, path: &Path) -> String {
        let own = |name: fn(&Path) -> String| {
            let label = name(path);
            let shared = self.samples.iter().filter(|other| name(other) == label).count() > 1;
            (!shared && !label.is_empty()).then_some(label)
        };
        let folder = |path: &Path| path.parent().map(stem).unwrap_or_default();
        own(stem).or_else(|| own(folder)).unwrap_or_else(|| format!("iteration {i}"))
    }
}

/// The clouds that a legend names, of so many: all, or a few from the first to the last.
fn named(clouds: usize) -> Vec<usize> {
    if clouds <= MOST_NAMED {
        return (0..clouds).collect();
    }
    (0..MOST_NAMED).map(|i| i * (clouds - 1) / (MOST_NAMED - 1)).collect()
}

impl Data {
    fn legend(&self) -> Vec<(Key, String)> {
        let cloud =
            |&i: &usize| (Key::Dot(Dot::among(1, self.clouds[i].color)), self.clouds[i].label.clone());
        let mut legend: Vec<(Key, String)> = self.named.iter().map(cloud).collect();
        legend.push((Key::Line(posterior_paint()), "posterior".to_owned()));
        if self.names.len() > 1 {
            legend.push((Key::Area(inner_paint()), "50 % of it".to_owned()));
            legend.push((Key::Area(outer_paint()), "90 % of it".to_owned()));
        }
        if !self.truth.is_empty() {
            legend.push((Key::Star(color::BLACK), "truth".to_owned()));
        }
        legend
    }

    fn matrix(&self, figure_width: f64) -> Matrix {
        let highest_of = |curves: &[Vec<f64>]| curves.iter().flatten().copied().fold(0.0, f64::max);
        let highest = |j: usize| {
            let own = highest_of(&self.marginals[j..=j]);
            // A sharp proposal may leave the panel, but must not press the posterior flat.
            own.max(highest_of(&self.searched[j]).min(1.5 * own))
        };
        let headings = |room: f64| -> Vec<String> {
            self.estimates.iter().map(|estimate| estimate.heading(room)).collect()
        };
        let widest = headings(Matrix::heading_width(self.names.len(), figure_width));
        // With their intervals all of them or none.
        let is_alike = widest.iter().all(|heading| heading.contains('–'));
        Matrix {
            spans: self.spans.clone(),
            labels: self.labels.clone(),
            highest: (0..self.names.len()).map(highest).collect(),
            headings: if is_alike { widest } else { headings(0.0) },
        }
    }

    fn draw_single(&self, panel: &mut Panel, j: usize, highest: f64) {
        let at = |i: usize| self.supports[j].value((i as f64 + 0.5) / CELLS_OF_ONE as f64);
        let x: Vec<f64> = (0..CELLS_OF_ONE).map(at).collect();
        let curve =
            |density: &[f64]| -> Vec<(f64, f64)> { x.iter().copied().zip(density.iter().copied()).collect() };
        panel.band("posterior", &x, &vec![0.0; x.len()], &self.marginals[j], outer_paint());
        for (cloud, density) in self.named.iter().map(|&i| &self.clouds[i]).zip(&self.searched[j]) {
            let title = format!("density of {}", cloud.label);
            panel.line(&title, curve(density), Paint::line(cloud.color, 0.8));
        }
        panel.line("posterior", curve(&self.marginals[j]), posterior_paint());
        for cloud in self.clouds.iter().filter(|_| self.names.len() == 1) {
            let foot = cloud.drawn(j).map(|x| (x, 0.015 * highest));
            let dot = Dot::among(cloud.drawn(j).count(), cloud.color);
            panel.dots(&cloud.label, foot, dot, MOST_IN_A_PANEL);
        }
        if let Some(value) = self.truth.get(&self.names[j]) {
            let (x, y) = panel.at((value, 0.0));
            panel.add("truth", vec![star((x, y - 5.0), 4.5, star_paint(color::BLACK))]);
        }
    }

    fn draw_pair(&self, panel: &mut Panel, i: usize, j: usize) {
        let density = self.joint(i, j);
        let heights = levels(&density, &[0.5, 0.9]);
        for (height, paint, title) in
            [(heights[1], outer_paint(), "90 %"), (heights[0], inner_paint(), "50 %")]
        {
            let value = |(x, y)| (self.supports[i].value(x), self.supports[j].value(y));
            let outlines: Vec<Vec<(f64, f64)>> = contour::above(&density, CELLS, height)
                .into_iter()
                .map(|line| line.into_iter().map(value).collect())
                .collect();
            panel.outlines(&format!("{title} of the posterior"), &outlines, paint);
        }
        for cloud in &self.clouds {
            let points = cloud.drawn(i).zip(cloud.drawn(j));
            let dot = Dot::among(cloud.drawn(i).count() * self.names.len(), cloud.color);
            panel.dots(&cloud.label, points, dot, MOST_IN_A_PANEL);
        }
        if let (Some(x), Some(y)) = (self.truth.get(&self.names[i]), self.truth.get(&self.names[j])) {
            let at = panel.at((x, y));
            panel.add("truth", vec![star(at, 4.5, star_paint(color::BLACK))]);
        }
    }

    /// Density of the posterior of two parameters, of the samples that the panel shows; shape (cells, cells).
    fn joint(&self, i: usize, j: usize) -> Vec<f64> {
        let (mut x, mut y, mut shown) = (Vec::new(), Vec::new(), Vec::new());
        for (row, &weight) in self.weight.iter().enumerate() {
            let place = |j: usize| place_within(self.supports[j], self.values[j][row]);
            if let (Some(across), Some(up)) = (place(i), place(j)) {
                x.push(across);
                y.push(up);
                shown.push(weight);
            }
        }
        joint(&x, &y, &shown, CELLS)
    }
}

/// From grey for the first iteration over orange to vermilion for the last.
fn shade(share: f64) -> Color {
    let light = color::GREY.towards(color::WHITE, 0.3);
    if share < 0.5 {
        light.towards(color::ORANGE, 2.0 * share)
    } else {
        color::ORANGE.towards(color::VERMILION, 2.0 * share - 1.0)
    }
}

fn posterior_paint() -> Paint {
    Paint::line(color::BLUE, 1.2)
}

fn outer_paint() -> Paint {
    Paint::area(color::SKY).opacity(0.35)
}

fn inner_paint() -> Paint {
    Paint::area(color::BLUE).opacity(0.45)
}
