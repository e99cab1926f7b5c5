//! Samples of every iteration, and what the posterior makes of each pair of parameters.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use gl_inference::observations::ByName;
use gl_inference::samples::Samples;
use gl_numeric::density::{joint, levels, marginal};

use crate::Style;
use crate::input::{Parameters, check_truth, column, place_within, read_weights, stem, within};
use gl_figure::axis::Span;
use gl_figure::contour;
use gl_figure::figure::{Figure, Key, star_paint};
use gl_figure::matrix;
use gl_figure::panel::Dot;
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

impl Pairs {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let weights = read_weights(&self.weights)?;
        let names = &weights.parameters;
        let n = names.len();
        let truth = self.truth.clone().unwrap_or_default();
        check_truth(&truth, names)?;
        let values: Vec<Vec<f64>> = (0..n).map(|j| column(&weights, j)).collect();
        let clouds = self.clouds(names, &values)?;

        let spans: Vec<Span> = (0..n)
            .map(|j| {
                let clouds = clouds.iter().flat_map(|cloud| cloud.values[j].iter().copied());
                let all: Vec<f64> =
                    values[j].iter().copied().chain(clouds).chain(truth.get(&names[j])).collect();
                if self.close_up {
                    parameters.close_span(&names[j], &values[j], &weights.weight)
                } else {
                    parameters.span(&names[j], &all)
                }
            })
            .collect();
        let labels: Vec<_> = names.iter().map(|name| parameters.label(name)).collect();
        let supports: Vec<Span> =
            (0..n).map(|j| parameters.support(&names[j], spans[j], &values[j])).collect();
        let density = |j: usize, values: &[f64], weights: &[f64]| {
            let (places, weights) = within(supports[j], values, weights);
            marginal(&places, &weights, CELLS_OF_ONE)
        };
        let marginals: Vec<Vec<f64>> = (0..n).map(|j| density(j, &values[j], &weights.weight)).collect();
        // Where each iteration looked, as densities; without tables of samples there is nothing to tell.
        let named = self.named(clouds.len());
        let looked: Vec<Vec<Vec<f64>>> = (0..n)
            .map(|j| {
                let of = |&cloud: &usize| {
                    let values = &clouds[cloud].values[j];
                    density(j, values, &vec![1.0 / values.len() as f64; values.len()])
                };
                named.iter().filter(|_| !self.samples.is_empty() && !self.close_up).map(of).collect()
            })
            .collect();
        let highest_of = |curves: &[Vec<f64>]| curves.iter().flatten().copied().fold(0.0, f64::max);
        let highest: Vec<f64> = (0..n)
            .map(|j| {
                let own = highest_of(&marginals[j..=j]);
                // A sharp proposal may leave the panel, but must not press the posterior flat.
                own.max(highest_of(&looked[j]).min(1.5 * own))
            })
            .collect();

        let mut figure = Figure::new(format!("Pairs of {}", names.join(", ")), style.width);
        let mut legend: Vec<(Key, String)> = named
            .iter()
            .map(|&i| (Key::Dot(Dot::among(1, clouds[i].color)), clouds[i].label.clone()))
            .collect();
        legend.push((Key::Line(Paint::line(color::BLUE, 1.2)), "posterior".to_owned()));
        if n > 1 {
            legend.push((Key::Area(inner_paint()), "50 % of it".to_owned()));
            legend.push((Key::Area(outer_paint()), "90 % of it".to_owned()));
        }
        if !truth.is_empty() {
            legend.push((Key::Star(color::BLACK), "truth".to_owned()));
        }
        figure.legend(&legend);

        matrix::draw(
            &mut figure,
            &spans,
            &labels,
            &highest,
            |panel, j| {
                let at = |i: usize| supports[j].value((i as f64 + 0.5) / CELLS_OF_ONE as f64);
                let points: Vec<(f64, f64)> =
                    marginals[j].iter().enumerate().map(|(i, &density)| (at(i), density)).collect();
                let x: Vec<f64> = points.iter().map(|point| point.0).collect();
                panel.band("posterior", &x, &vec![0.0; x.len()], &marginals[j], outer_paint());
                for (cloud, density) in named.iter().map(|&i| &clouds[i]).zip(&looked[j]) {
                    let points = x.iter().copied().zip(density.iter().copied());
                    panel.line(&format!("density of {}", cloud.label), points, Paint::line(cloud.color, 0.8));
                }
                panel.line("posterior", points, Paint::line(color::BLUE, 1.2));
                for cloud in clouds.iter().filter(|_| n == 1) {
                    let foot = cloud.drawn(j).map(|x| (x, 0.015 * highest[j]));
                    panel.dots(
                        &cloud.label,
                        foot,
                        Dot::among(cloud.drawn(j).count(), cloud.color),
                        MOST_IN_A_PANEL,
                    );
                }
                if let Some(value) = truth.get(&names[j]) {
                    let (x, y) = panel.at((value, 0.0));
                    panel.add("truth", vec![star((x, y - 5.0), 4.5, star_paint(color::BLACK))]);
                }
            },
            |panel, i, j| {
                let (mut x, mut y, mut shown) = (Vec::new(), Vec::new(), Vec::new());
                for (row, &weight) in weights.weight.iter().enumerate() {
                    let place = |j: usize| place_within(supports[j], values[j][row]);
                    if let (Some(across), Some(up)) = (place(i), place(j)) {
                        x.push(across);
                        y.push(up);
                        shown.push(weight);
                    }
                }
                let density = joint(&x, &y, &shown, CELLS);
                let heights = levels(&density, &[0.5, 0.9]);
                for (height, paint, title) in
                    [(heights[1], outer_paint(), "90 %"), (heights[0], inner_paint(), "50 %")]
                {
                    let outlines: Vec<Vec<(f64, f64)>> = contour::above(&density, CELLS, height)
                        .into_iter()
                        .map(|line| {
                            line.into_iter()
                                .map(|(x, y)| (supports[i].value(x), supports[j].value(y)))
                                .collect()
                        })
                        .collect();
                    panel.outlines(&format!("{title} of the posterior"), &outlines, paint);
                }
                for cloud in &clouds {
                    let points = cloud.drawn(i).zip(cloud.drawn(j));
                    let dot = Dot::among(cloud.drawn(i).count() * n, cloud.color);
                    panel.dots(&cloud.label, points, dot, MOST_IN_A_PANEL);
                }
                if let (Some(x), Some(y)) = (truth.get(&names[i]), truth.get(&names[j])) {
                    let at = panel.at((x, y));
                    panel.add("truth", vec![star(at, 4.5, star_paint(color::BLACK))]);
                }
            },
        );
        Ok(figure.finish())
    }

    /// The clouds that the legend names, of so many: all, or a few from the first to the last.
    fn named(&self, clouds: usize) -> Vec<usize> {
        if clouds <= MOST_NAMED {
            return (0..clouds).collect();
        }
        (0..MOST_NAMED).map(|i| i * (clouds - 1) / (MOST_NAMED - 1)).collect()
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

/// From grey for the first iteration over orange to vermilion for the last.
fn shade(share: f64) -> Color {
    let light = color::GREY.towards(color::WHITE, 0.3);
    if share < 0.5 {
        light.towards(color::ORANGE, 2.0 * share)
    } else {
        color::ORANGE.towards(color::VERMILION, 2.0 * share - 1.0)
    }
}

fn outer_paint() -> Paint {
    Paint::area(color::SKY).opacity(0.35)
}

fn inner_paint() -> Paint {
    Paint::area(color::BLUE).opacity(0.45)
}
