//! What the weights say about each parameter.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_figure::axis::{Axis, Label, SMALL, Span};
use gl_figure::figure::{Figure, Key, star_paint};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Anchor, Color, Item, Paint, Rect, Scene, color, line, star, text};
use gl_figure::{font, number};
use gl_inference::observations::ByName;
use gl_inference::prior::Parameter;
use gl_inference::summary::Summary;
use gl_inference::weights::Weights;
use gl_numeric::density::marginal;

use crate::Style;
use crate::input::{
    Estimate, Parameters, check_truth, column, lightest_first, only, read_step_weights, stem, which_move,
    within,
};

/// Weights against each parameter, but for draws, which weigh the same, and the marginals with their 90 % intervals
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
    /// Axes as wide as the posterior; by default so where it takes up less than two fifths of the range
    #[arg(long)]
    close_up: bool,
    /// Axes as wide as the bounds
    #[arg(long, conflicts_with = "close_up")]
    whole: bool,
}

const EXAMPLE: &str = "\
Example:
  printf 'sample E mu weight\\na 1e9 .3 .1\\nb 2e9 .4 .9\\n' > weights.txt
  printf 'name lower upper unit\\nE 1e9 4e9 Pa\\nmu .2 .5 -\\n' > params.txt
  gl-plot posterior -w weights.txt -p params.txt --truth E=2e9 \\
    -o posterior.svg";

const CELLS: usize = 160;
/// A posterior on a smaller share of the range of the prior than this is shown closely.
const READABLE: f64 = 0.4;
/// Dots of all panels together; more would make an SVG that no browser likes.
const MOST_DOTS: usize = 40_000;

/// One table of weights and how it looks.
struct Stage {
    label: String,
    weights: Weights,
    color: Color,
}

/// One parameter: what its panels show.
struct Column {
    name: String,
    label: Label,
    /// Its values in each stage, shape (stages, samples).
    values: Vec<Vec<f64>>,
    estimate: Estimate,
    truth: Option<f64>,
    /// What its axis shows.
    span: Span,
    /// Whether that is only a part of the range of the prior.
    is_part: bool,
    /// Where samples can be.
    support: Span,
    prior: Option<Parameter>,
}

/// Where the panels of a row of parameters stand.
struct Layout {
    /// Of the range of the prior.
    range: f64,
    /// Of the weights of each stage, where there are any, and of the marginals last.
    tops: Vec<f64>,
    row_height: f64,
    beside: f64,
    columns: usize,
}

/// Height of the panel of a marginal.
const MARGINAL: f64 = 62.0;
/// Above a panel, for its heading.
const HEADING: f64 = 14.0;
/// Above the panels, for the range of the prior.
const RANGE: f64 = 10.0;

impl Posterior {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let stages = self.stages()?;
        let columns = self.columns(&stages)?;
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        let mut figure = Figure::new(format!("Posterior of {}", names.join(", ")), style.width);
        figure.legend(&legend(&stages, &columns));
        let most = MOST_DOTS / (stages.len() * columns.len());
        let side_by_side = figure.columns(columns.len(), 100.0);
        for row in columns.chunks(side_by_side) {
            let layout = layout(&figure, &stages, row, side_by_side);
            let mut foot = figure.y;
            for (place, column) in row.iter().enumerate() {
                let (left, right) = figure.shared_cell(place, layout.columns, layout.beside);
                foot = foot.max(column.draw(&mut figure, &stages, &layout, (left, right), place > 0, most));
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    fn columns(&self, stages: &[Stage]) -> Result<Vec<Column>> {
        let parameters = Parameters::read(self.params.as_deref())?;
        let summary = self.summary.as_deref().map(Summary::read).transpose()?;
        let last = &stages[stages.len() - 1].weights;
        let truth = self.truth.clone().unwrap_or_default();
        let column = |(j, name): (usize, &String)| -> Result<Column> {
            let values: Vec<Vec<f64>> = stages.iter().map(|stage| column(&stage.weights, j)).collect();
            let parameter = (name.as_str(), parameters.is_log(name));
            let estimate = Estimate::of(summary.as_ref(), parameter, &column(last, j), &last.weight)?;
            let truth = truth.get(name);
            let all: Vec<f64> = values.iter().flatten().copied().chain(truth).collect();
            let whole = parameters.span(name, &all);
            let close = parameters.close_span(name, &column(last, j), &last.weight);
            let close = close.with(estimate.low).with(estimate.high);
            let close = truth.map_or(close, |truth| close.with(truth));
            let share = (whole.place(close.high) - whole.place(close.low)).abs();
            let is_part = !self.whole && (self.close_up || (stages.len() == 1 && share < READABLE));
            let span = if is_part { close } else { whole };
            Ok(Column {
                support: parameters.support(name, span, &values.concat()),
                label: parameters.label(name),
                prior: parameters.get(name).cloned(),
                name: name.clone(),
                values,
                estimate,
                truth,
                span,
                is_part,
            })
        };
        last.parameters.iter().enumerate().map(column).collect()
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
        let truth = self.truth.clone().unwrap_or_default();
        check_truth(&truth, &sets[0].1.parameters)?;
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
        let moves = which_move(&stages.iter().map(|stage| &stage.weights).collect::<Vec<_>>());
        let only = |stage: Stage| Stage { weights: only(stage.weights, &moves), ..stage };
        Ok(stages.into_iter().map(only).collect())
    }
}

/// The stages, unless all are draws, whose weights are the same and say nothing.
fn weighed(stages: &[Stage]) -> &[Stage] {
    let is_draws = |stage: &Stage| {
        let weights = &stage.weights.weight;
        weights.len() > 1 && weights.iter().all(|weight| (weight - weights[0]).abs() <= 1e-9 * weights[0])
    };
    if stages.iter().all(is_draws) { &[] } else { stages }
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

/// Where panels go that begin at the foot of the figure.
fn layout(figure: &Figure, stages: &[Stage], row: &[Column], columns: usize) -> Layout {
    let row_height = if stages.len() == 1 { 80.0 } else { 46.0 };
    let heading = if stages.len() == 1 { 0.0 } else { HEADING };
    let range = if row.iter().any(|column| column.shows_range()) { RANGE } else { 0.0 };
    let above = if stages.len() == 1 { 2.0 } else { 11.0 };
    let first = figure.y + range + above;
    let weighed = weighed(stages);
    let mut tops: Vec<f64> = (0..weighed.len()).map(|i| first + (row_height + heading) * i as f64).collect();
    tops.push(first + (row_height + heading) * weighed.len() as f64 + HEADING - heading);
    let beside =
        weighed.iter().map(|stage| room_beside(&stage.axis(row_height), row_height)).fold(0.0, f64::max);
    Layout { range: first - above - 4.5, tops, row_height, beside, columns }
}

impl Column {
    /// Whether the range of the prior is drawn above the panels.
    fn shows_range(&self) -> bool {
        self.is_part && self.prior.is_some()
    }

    /// Draw its panels below each other; where they end.
    fn draw(
        &self,
        figure: &mut Figure,
        stages: &[Stage],
        layout: &Layout,
        (left, right): (f64, f64),
        is_inner: bool,
        most: usize,
    ) -> f64 {
        let x = Axis::horizontal(self.span, self.label.clone(), right - left);
        if let Some(prior) = self.prior.as_ref().filter(|_| self.shows_range()) {
            figure.add(range(prior, self.span, (left, right), layout.range));
        }
        for (i, stage) in weighed(stages).iter().enumerate() {
            let rect = Rect::new(left, layout.tops[i], right, layout.tops[i] + layout.row_height);
            let name = format!("weight against {}, {}", self.name, stage.label);
            let mut panel = Panel::new(name, rect, x.clone(), stage.axis(layout.row_height))
                .beside(layout.beside)
                .without_x_labels();
            if stages.len() > 1 {
                panel = panel.heading(stage.label.clone());
            }
            if is_inner {
                panel = panel.without_y_labels();
            }
            let dot = Dot::among(self.values[i].len(), stage.color);
            let order = lightest_first(&stage.weights.weight);
            let dots = order.iter().rev().map(|&run| (self.values[i][run], stage.weights.weight[run]));
            panel.dots("weights", dots, dot, most);
            figure.add(panel.finish());
        }
        let top = layout.tops[weighed(stages).len()];
        let rect = Rect::new(left, top, right, top + MARGINAL);
        let panel = self.marginal(stages, rect, x, layout.beside);
        let panel = if is_inner { panel.without_y_labels() } else { panel };
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }

    /// The marginal at every stage.
    fn marginal(&self, stages: &[Stage], rect: Rect, x: Axis, beside: f64) -> Panel {
        // Kernels do not leak through the bounds.
        let support = self.support;
        let density = |(stage, values): (&Stage, &Vec<f64>)| {
            let (places, weights) = within(support, values, &stage.weights.weight);
            marginal(&places, &weights, CELLS)
        };
        let densities: Vec<Vec<f64>> = stages.iter().zip(&self.values).map(density).collect();
        let at: Vec<f64> = (0..CELLS).map(|i| support.value((i as f64 + 0.5) / CELLS as f64)).collect();
        let highest = densities.iter().flatten().copied().fold(0.0, f64::max);
        let y = Axis::bare(Span { low: 0.0, high: 1.1 * highest, log: false }, Label::new("density"));
        let name = format!("marginal of {}", self.name);
        let heading = self.estimate.heading(rect.width() + 7.0);
        let mut panel = Panel::new(name, rect, x, y).beside(beside).among_neighbours().heading(heading);

        if let Some(prior) = &self.prior {
            // A density per unit of the axis, on which the range of the prior takes up only a part.
            let share = support.place(prior.upper) - support.place(prior.lower);
            let x: Vec<f64> =
                at.iter().copied().filter(|x| (prior.lower..=prior.upper).contains(x)).collect();
            let heights: Vec<f64> =
                x.iter().map(|&x| prior.ln_density(prior.coordinate(x)).exp() / share).collect();
            panel.band("area of the prior", &x, &vec![0.0; x.len()], &heights, prior_area());
            panel.line("prior", x.iter().copied().zip(heights), prior_paint());
            for (title, bound) in [("lower bound", prior.lower), ("upper bound", prior.upper)] {
                if (self.span.low..=self.span.high).contains(&bound) {
                    panel.vertical(title, bound, bound_paint());
                }
            }
        }
        if let Some(density) = densities.last() {
            let inside = |&i: &usize| (self.estimate.low..=self.estimate.high).contains(&at[i]);
            let inside: Vec<usize> = (0..CELLS).filter(inside).collect();
            let x: Vec<f64> = inside.iter().map(|&i| at[i]).collect();
            let top: Vec<f64> = inside.iter().map(|&i| density[i]).collect();
            let name = if self.estimate.is_shortest { "shortest 90 % interval" } else { "90 % interval" };
            panel.band(name, &x, &vec![0.0; x.len()], &top, interval_paint());
            panel.vertical("mean", self.estimate.mean, mean_paint());
        }
        for (stage, density) in stages.iter().zip(&densities) {
            let points = at.iter().copied().zip(density.iter().copied());
            panel.line(&format!("density, {}", stage.label), points, Paint::line(stage.color, 1.2));
        }
        if let Some(value) = self.truth {
            let at = panel.at((value, panel.y.span.low));
            panel.add("truth", vec![star((at.0, at.1 - 5.0), 5.0, star_paint(color::BLACK))]);
        }
        panel
    }
}

/// The range of the prior from end to end, and the part of it that the panels below show.
fn range(prior: &Parameter, shown: Span, (left, right): (f64, f64), y: f64) -> Item {
    let whole = Span::of_bounds(prior);
    let [low, high] = [prior.lower, prior.upper].map(number::short);
    let baseline = y + 0.36 * SMALL;
    let (x0, x1) = (left + font::width(&low, SMALL) + 3.0, right - font::width(&high, SMALL) - 3.0);
    let at = |value: f64| x0 + (x1 - x0) * whole.place(value).clamp(0.0, 1.0);
    let (from, to) = (at(shown.low), at(shown.high).max(at(shown.low) + 1.5));
    let items = vec![
        text((left, baseline), low, SMALL, Anchor::Start),
        text((right, baseline), high, SMALL, Anchor::End),
        line(vec![(x0, y), (x1, y)], range_paint()),
        line(vec![(from, y), (to, y)], Paint::line(color::BLUE, 3.5)),
    ];
    Item::Group { class: "range", title: format!("range of the prior of {}", prior.name), clip: None, items }
}

fn legend(stages: &[Stage], columns: &[Column]) -> Vec<(Key, String)> {
    let mut legend = Vec::new();
    if let [stage] = weighed(stages) {
        legend.push((Key::Dot(Dot::among(1, stage.color)), "weight of a run".to_owned()));
    }
    for stage in stages {
        let name = if stages.len() == 1 { "posterior".to_owned() } else { stage.label.clone() };
        legend.push((Key::Line(Paint::line(stage.color, 1.2)), name));
    }
    let is_shortest = columns.iter().any(|column| column.estimate.is_shortest);
    let interval = if is_shortest { "90 % interval, where skewed the shortest" } else { "90 % interval" };
    legend.push((Key::Area(interval_paint()), interval.to_owned()));
    legend.push((Key::Line(mean_paint()), "mean".to_owned()));
    if columns.iter().any(|column| column.prior.is_some()) {
        legend.push((Key::Line(prior_paint()), "prior".to_owned()));
    }
    if columns.iter().any(Column::shows_range) {
        legend.push((
            Key::Line(Paint::line(color::BLUE, 3.5)),
            "the part of its range that is shown".to_owned(),
        ));
    }
    if columns.iter().any(|column| column.prior.is_some() && !column.is_part) {
        legend.push((Key::Line(bound_paint()), "bounds".to_owned()));
    }
    if columns.iter().any(|column| column.truth.is_some()) {
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
    Paint::line(color::GREY, 0.8).opacity(0.8)
}

fn prior_area() -> Paint {
    Paint::area(color::GREY).opacity(0.15)
}

fn range_paint() -> Paint {
    Paint::line(color::GREY, 0.8)
}

fn bound_paint() -> Paint {
    Paint::line(color::GREY, 0.8).dashed(1.0, 1.5)
}
