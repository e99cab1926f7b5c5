//! What the weights say about each parameter.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_inference::observations::ByName;
use gl_inference::summary::Summary;
use gl_inference::weights::Weights;
use gl_numeric::density::marginal;
use gl_numeric::statistics::{Quantiles, mean};

use crate::Style;
use crate::input::{Parameters, check_truth, column, lightest_first, read_step_weights, stem, within};
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key, star_paint};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Color, Paint, Rect, Scene, color, star};

/// Weights against each parameter, and the marginals with their 90 % intervals
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Posterior {
    /// Table of weights, or of weights at several steps (gl-filter --step-weights); may be repeated, for
    /// iterations from the first to the last
    #[arg(short, long, value_name = "FILE", required = true)]
    weights: Vec<PathBuf>,
    /// What each set of weights is called in the picture; by default its step or its file
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    labels: Vec<String>,
    /// Table of parameters: their bounds, scales and units
    #[arg(short, long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Summary of the last set of weights: its means and intervals, which allow for few runs
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
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
  printf 'name lower upper unit\\nE 1e9 4e9 Pa\\nmu .2 .5 -\\n' > params.txt
  gl-plot posterior -w weights.txt -p params.txt --truth E=2e9 \\
    -o posterior.svg";

const CELLS: usize = 160;
/// Dots of all panels together; more would make an SVG that no browser likes.
const MOST_DOTS: usize = 40_000;

/// One table of weights and how it looks.
struct Stage {
    label: String,
    weights: Weights,
    color: Color,
}

impl Posterior {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let stages = self.stages()?;
        let names = &stages[0].weights.parameters;
        let truth = self.truth.clone().unwrap_or_default();
        check_truth(&truth, names)?;

        let summary = self.summary.as_deref().map(Summary::read).transpose()?;
        let stated: Vec<Option<(f64, f64, f64)>> = names
            .iter()
            .map(|name| summary.as_ref().map(|summary| stated(summary, name)).transpose())
            .collect::<Result<_>>()?;

        let title = format!("Posterior of {}", names.join(", "));
        let mut figure = Figure::new(title, style.width);
        figure.legend(&legend(&stages, &parameters, !truth.is_empty()));

        let columns = figure.columns(names.len(), 100.0);
        let row_height = if stages.len() == 1 { 80.0 } else { 46.0 };
        let most = MOST_DOTS / (stages.len() * names.len());
        for block in 0..names.len().div_ceil(columns) {
            let block = block * columns..((block + 1) * columns).min(names.len());
            let tops: Vec<f64> =
                (0..=stages.len()).map(|row| figure.y + 9.0 + (row_height + 14.0) * row as f64).collect();
            let heights: Vec<Axis> = stages.iter().map(|stage| stage.axis(row_height)).collect();
            let beside = heights.iter().map(|axis| room_beside(axis, row_height)).fold(0.0, f64::max);
            let bottom = tops[stages.len()] + 62.0;
            let mut foot = bottom;
            for (place, j) in block.enumerate() {
                let (left, right) = figure.shared_cell(place, columns, beside);
                let values: Vec<Vec<f64>> = stages.iter().map(|stage| column(&stage.weights, j)).collect();
                let all: Vec<f64> = values.iter().flatten().copied().chain(truth.get(&names[j])).collect();
                let span = if self.close_up {
                    let last = &stages[stages.len() - 1].weights;
                    let span = parameters.close_span(&names[j], &column(last, j), &last.weight);
                    stated[j].map_or(span, |(_, low, high)| span.with(low).with(high))
                } else {
                    parameters.span(&names[j], &all)
                };
                let x = Axis::horizontal(span, parameters.label(&names[j]), right - left);
                for (row, stage) in stages.iter().enumerate() {
                    let rect = Rect::new(left, tops[row], right, tops[row] + row_height);
                    let name = format!("weight against {}, {}", names[j], stage.label);
                    let mut panel = Panel::new(name, rect, x.clone(), heights[row].clone())
                        .beside(beside)
                        .without_x_labels();
                    if stages.len() > 1 {
                        panel = panel.heading(stage.label.clone());
                    }
                    if place > 0 {
                        panel = panel.without_y_labels();
                    }
                    let dot = Dot::among(values[row].len(), stage.color);
                    let order = lightest_first(&stage.weights.weight);
                    let dots = order.iter().rev().map(|&i| (values[row][i], stage.weights.weight[i]));
                    panel.dots("weights", dots, dot, most);
                    figure.add(panel.finish());
                }
                let rect = Rect::new(left, tops[stages.len()], right, bottom);
                let marginals = Marginals {
                    name: &names[j],
                    stages: &stages,
                    values: &values,
                    parameters: &parameters,
                    stated: stated[j],
                };
                let mut panel = marginals.panel(rect, x, beside);
                if place > 0 {
                    panel = panel.without_y_labels();
                }
                if let Some(value) = truth.get(&names[j]) {
                    let at = panel.at((value, panel.y.span.low));
                    panel.add("truth", vec![star((at.0, at.1 - 5.0), 5.0, star_paint(color::BLACK))]);
                }
                foot = foot.max(panel.foot());
                figure.add(panel.finish());
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    fn stages(&self) -> Result<Vec<Stage>> {
        let mut sets: Vec<(String, Weights)> = Vec::new();
        for path in &self.weights {
            for (step, weights) in read_step_weights(path)? {
                let label = match step {
                    None => stem(path),
                    Some(step) if self.weights.len() == 1 => format!("step {step}"),
                    Some(step) => format!("{}, step {step}", stem(path)),
                };
                sets.push((label, weights));
            }
        }
        ensure!(
            self.labels.is_empty() || self.labels.len() == sets.len(),
            "--labels: {} names for {} sets of weights",
            self.labels.len(),
            sets.len()
        );
        let last = sets.len() - 1;
        let mut stages: Vec<Stage> = Vec::new();
        for (i, (label, weights)) in sets.into_iter().enumerate() {
            if let Some(first) = stages.first().map(|stage| &stage.weights) {
                ensure!(
                    first.parameters == weights.parameters,
                    "{}:1: the parameters are {}, but those of {} are {}",
                    weights.source,
                    weights.parameters.join(", "),
                    first.source,
                    first.parameters.join(", ")
                );
            }
            let early = if last == 0 { 0.0 } else { 0.65 * (1.0 - i as f64 / last as f64) };
            let label = self.labels.get(i).cloned().unwrap_or(label);
            stages.push(Stage { label, weights, color: color::BLUE.towards(color::WHITE, early) });
        }
        Ok(stages)
    }
}

impl Stage {
    fn axis(&self, height: f64) -> Axis {
        let highest = self.weights.weight.iter().copied().fold(0.0, f64::max);
        Axis::vertical(
            Span { low: -0.05 * highest, high: 1.08 * highest, log: false },
            Label::new("weight"),
            height,
        )
    }
}

/// The marginal of one parameter at every stage.
struct Marginals<'a> {
    name: &'a str,
    stages: &'a [Stage],
    /// Shape (stages, samples).
    values: &'a [Vec<f64>],
    parameters: &'a Parameters,
    /// Mean and ends of the 90 % interval from the summary.
    stated: Option<(f64, f64, f64)>,
}

impl Marginals<'_> {
    fn panel(&self, rect: Rect, x: Axis, beside: f64) -> Panel {
        // Kernels do not leak through the bounds.
        let support = self.parameters.support(self.name, x.span, &self.values.concat());
        let densities: Vec<Vec<f64>> = self
            .stages
            .iter()
            .zip(self.values)
            .map(|(stage, values)| {
                let (places, weights) = within(support, values, &stage.weights.weight);
                marginal(&places, &weights, CELLS)
            })
            .collect();
        let at: Vec<f64> = (0..CELLS).map(|i| support.value((i as f64 + 0.5) / CELLS as f64)).collect();
        let highest = densities.iter().flatten().copied().fold(0.0, f64::max);
        let y = Axis::bare(Span { low: 0.0, high: 1.1 * highest, log: false }, Label::new("density"));
        let name = format!("marginal of {}", self.name);
        let mut panel = Panel::new(name, rect, x, y).beside(beside).among_neighbours();

        if let (Some(stage), Some(values), Some(density)) =
            (self.stages.last(), self.values.last(), densities.last())
        {
            let (centre, low, high) = match self.stated {
                Some(stated) => stated,
                None => {
                    let quantiles = Quantiles::new(values, &stage.weights.weight);
                    (mean(values, &stage.weights.weight), quantiles.at(0.05), quantiles.at(0.95))
                }
            };
            let inside: Vec<usize> = (0..CELLS).filter(|&i| (low..=high).contains(&at[i])).collect();
            let x: Vec<f64> = inside.iter().map(|&i| at[i]).collect();
            let top: Vec<f64> = inside.iter().map(|&i| density[i]).collect();
            panel.band("90 % interval", &x, &vec![0.0; x.len()], &top, interval_paint());
            panel.vertical("mean", centre, mean_paint());
        }
        for (stage, density) in self.stages.iter().zip(&densities) {
            let points = at.iter().copied().zip(density.iter().copied());
            panel.line(&format!("density, {}", stage.label), points, Paint::line(stage.color, 1.2));
        }
        if let Some(parameter) = self.parameters.get(self.name) {
            // A density per unit of the axis, on which the range of the prior takes up only a part.
            let share = support.place(parameter.upper) - support.place(parameter.lower);
            let prior: Vec<(f64, f64)> = at
                .iter()
                .filter(|x| (parameter.lower..=parameter.upper).contains(x))
                .map(|&x| (x, parameter.ln_density(parameter.coordinate(x)).exp() / share))
                .collect();
            panel.line("prior", prior, prior_paint());
            panel.vertical("lower bound", parameter.lower, bound_paint());
            panel.vertical("upper bound", parameter.upper, bound_paint());
        }
        panel
    }
}

/// Mean and ends of the 90 % interval of a parameter.
fn stated(summary: &Summary, name: &str) -> Result<(f64, f64, f64)> {
    let number = |kind: &str| {
        let quantity = format!("{kind}({name})");
        summary.find_number(&quantity)?.with_context(|| format!("--summary: no quantity {quantity}"))
    };
    Ok((number("mean")?, number("q05")?, number("q95")?))
}

fn legend(stages: &[Stage], parameters: &Parameters, truth: bool) -> Vec<(Key, String)> {
    let mut legend = Vec::new();
    if let [stage] = stages {
        legend.push((Key::Dot(Dot::among(1, stage.color)), "weight of a run".to_owned()));
    }
    for stage in stages {
        let name = if stages.len() == 1 { "posterior".to_owned() } else { stage.label.clone() };
        legend.push((Key::Line(Paint::line(stage.color, 1.2)), name));
    }
    legend.push((Key::Area(interval_paint()), "90 % interval".to_owned()));
    legend.push((Key::Line(mean_paint()), "mean".to_owned()));
    if parameters.known() {
        legend.push((Key::Line(prior_paint()), "prior".to_owned()));
        legend.push((Key::Line(bound_paint()), "bounds".to_owned()));
    }
    if truth {
        legend.push((Key::Star(color::BLACK), "truth".to_owned()));
    }
    legend
}

fn interval_paint() -> Paint {
    Paint::area(color::SKY).opacity(0.4)
}

fn mean_paint() -> Paint {
    Paint::line(color::VERMILION, 1.0)
}

fn prior_paint() -> Paint {
    Paint::line(color::GREY, 1.0).dashed(4.0, 2.0)
}

fn bound_paint() -> Paint {
    Paint::line(color::GREY, 0.8).dashed(1.0, 1.5)
}
