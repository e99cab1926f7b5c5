//! What the most probable hypotheses make of the measurement, each by its mean curve.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Color, Paint, Rect, Scene, color};
use gl_gap::attribute::winner::cause;
use gl_inference::observations::{ByName, Observations, Steps};
use gl_inference::stack::{Stack, Test, TestTables, named};
use gl_table::Table;

use crate::Style;
use crate::branches::{ABOVE, Branches};
use crate::input::check_panels;
use gl_inference::units::Units;

/// The curves of the base model and of the most probable hypotheses over the measurement, and what each leaves
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Hypotheses {
    /// Table of what was measured
    #[arg(short = 'b', long, value_name = "FILE", required_unless_present = "test")]
    observations: Option<PathBuf>,
    /// Standard deviation of the measurement noise, as in f=0.02,q=1; by default the `_sd` columns
    #[arg(long, value_name = "NAME=SD,…")]
    noise: Option<ByName>,
    /// A test, instead of -b --noise; repeat for several
    #[arg(
        long,
        value_name = "NAME:OBS:CONTROL:OBSERVABLES[:NOISE[:STEPS]]",
        conflicts_with_all = ["observations", "noise"]
    )]
    test: Vec<TestTables>,
    /// Unit of columns, as in q=MPa,u=mm
    #[arg(long, value_name = "NAME=UNIT,…", default_value = "")]
    units: Units,
    /// How many hypotheses to show beside the base model; the same effects with a rest and without are shown once
    #[arg(long, value_name = "N", default_value_t = 3)]
    most: usize,
    /// Table of gl-gap-attribute --curves-out
    #[arg(value_name = "CURVES", default_value = "-")]
    curves: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'u f\\n0 0\\n1 1.2\\n2 2.1\\n' > obs.txt
  printf 'hypothesis probability step u f\\n' > curves.txt
  printf 'bend .9 0 0 0\\nbend .9 1 1 1.2\\nbend .9 2 2 2\\n' >> curves.txt
  printf 'none .1 0 0 0\\nnone .1 1 1 1\\nnone .1 2 2 2\\n' >> curves.txt
  gl-plot hypotheses -b obs.txt --noise f=0.1 curves.txt -o hypotheses.svg";

/// Colours of the hypotheses, the most probable first, and that of the base model.
const COLORS: [Color; 5] = [color::VERMILION, color::BLUE, color::GREEN, color::ORANGE, color::PURPLE];
const BASE: Color = color::GREY;

/// One hypothesis.
struct Hypothesis {
    name: String,
    probability: f64,
    /// Mean curves, shape (observables of all tests, compared steps).
    curves: Vec<Vec<f64>>,
    paint: Paint,
}

/// The readings of one observable of one test, at the steps that the hypotheses were asked about.
struct Own {
    /// With that of the test, where there is one.
    name: String,
    unit: Option<String>,
    control: Vec<f64>,
    along: Label,
    branches: Branches,
    measured: Vec<f64>,
    noise: Option<Vec<f64>>,
    /// Number of the first step.
    first: usize,
}

/// One measurement, whole.
struct Part {
    /// Name of its test; empty where there is no other.
    test: String,
    observations: Observations,
    noise: Option<Vec<Vec<f64>>>,
}

impl Hypotheses {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let (all, hypotheses) = self.compared()?;
        let mut figure = Figure::new("What each hypothesis makes of the measurement", style.width);
        let most = all.iter().map(|own| own.measured.len()).max().unwrap_or(0);
        let mut legend = vec![(Key::Dot(Dot::among(most, color::BLACK)), "measured".to_owned())];
        if all.iter().any(|own| own.noise.is_some()) {
            legend.push((Key::Area(noise_paint()), "noise, ± 1 sd".to_owned()));
        }
        for of in &hypotheses {
            legend.push((Key::Line(of.paint), format!("{} ({:.2})", of.name, of.probability)));
        }
        figure.legend(&legend);
        let columns = figure.columns(all.len(), 150.0);
        let places: Vec<usize> = (0..all.len()).collect();
        for row in places.chunks(columns) {
            let mut foot = figure.y;
            for (place, &j) in row.iter().enumerate() {
                let curves: Vec<_> = hypotheses.iter().map(|of| (of, of.curves[j].as_slice())).collect();
                foot = foot.max(all[j].draw(&curves, &mut figure, (place, columns)));
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    /// The readings of each observable, and the hypotheses that are shown.
    fn compared(&self) -> Result<(Vec<Own>, Vec<Hypothesis>)> {
        let table = Table::read(&self.curves)?;
        let source = table.format().source();
        ensure!(!table.is_empty(), "{source}: no rows; there is nothing to draw");
        let parts = self.parts(&table)?;
        check_panels(source, parts.iter().map(|part| part.observations.names.len()).sum())?;
        let (hypotheses, steps) = read(&table, &parts)?;
        let observables =
            parts.iter().flat_map(|part| (0..part.observations.names.len()).map(move |j| (part, j)));
        let own = |((part, j), steps): ((&Part, usize), Steps)| {
            let Observations { control, control_name, names, values, .. } = &part.observations;
            let steps = steps.from..steps.to;
            let control = control[steps.clone()].to_vec();
            Own {
                name: named(&part.test, &names[j]),
                unit: self.units.get(&names[j]).map(str::to_owned),
                branches: Branches::of(&control),
                control,
                along: Label {
                    name: control_name.clone(),
                    unit: self.units.get(control_name).map(str::to_owned),
                },
                measured: values[j][steps.clone()].to_vec(),
                first: steps.start,
                noise: part.noise.as_ref().map(|noise| noise[j][steps].to_vec()),
            }
        };
        Ok((observables.zip(steps).map(own).collect(), chosen(hypotheses, self.most)))
    }

    /// The measurement, or that of each test.
    fn parts(&self, table: &Table) -> Result<Vec<Part>> {
        let source = table.format().source();
        let columns = table.format().columns();
        if !self.test.is_empty() {
            let part =
                |Test { name, observations, noise, .. }: Test| Part { test: name, observations, noise };
            return Ok(Stack::read(&self.test)?.tests.into_iter().map(part).collect());
        }
        ensure!(
            !LONG.iter().all(|name| columns.iter().any(|column| column == name)),
            "{source}: the curves of tests; give each as --test NAME:OBS:CONTROL:OBSERVABLES:NOISE, in the place of -b"
        );
        let names: Vec<String> = columns
            .iter()
            .filter(|name| !matches!(name.as_str(), "hypothesis" | "probability" | "step"))
            .cloned()
            .collect();
        ensure!(
            names.len() >= 2,
            "{source}:1: no control and observables beside hypothesis, probability and step; is it of \
             gl-gap-attribute --curves-out?"
        );
        check_panels(source, names.len() - 1)?;
        let file =
            self.observations.as_deref().context("name a measurement with -b, or tests with --test")?;
        let observations = Observations::read(file, &names[0], &names[1..])?;
        let noise = observations.noise(&self.noise.clone().unwrap_or_default())?;
        Ok(vec![Part { test: String::new(), observations, noise }])
    }
}

/// Columns that a table of several tests has in the place of the control and the observables.
const LONG: [&str; 3] = ["test", "observable", "predicted"];

/// All hypotheses in their order, and the steps of each observable, shape (observables of all tests,), that all of them
/// have.
fn read(table: &Table, parts: &[Part]) -> Result<(Vec<Hypothesis>, Vec<Steps>)> {
    let source = table.format().source();
    let name = table.format().column("hypothesis")?;
    let (probability, step) = (table.numbers("probability")?, table.numbers("step")?);
    let is_long = !parts[0].test.is_empty();
    // What a curve is of stands in these columns, and its values in those.
    let mut keys = vec![name];
    let names = if is_long { &["predicted".to_owned()] } else { parts[0].observations.names.as_slice() };
    let columns = names.iter().map(|name| table.numbers(name)).collect::<Result<Vec<_>>>()?;
    if is_long {
        keys.extend([table.format().column(LONG[0])?, table.format().column(LONG[1])?]);
    }
    let observables: Vec<(&str, &str, usize)> = parts
        .iter()
        .flat_map(|part| {
            let of = &part.observations;
            of.names.iter().map(|name| (part.test.as_str(), name.as_str(), of.steps()))
        })
        .collect();
    let mut hypotheses: Vec<Hypothesis> = Vec::new();
    let mut compared: Vec<Option<Steps>> = vec![None; observables.len()];
    let mut row = 0;
    while row < table.len() {
        let is_same = |r: usize| keys.iter().all(|&key| table.field(r, key) == table.field(row, key));
        let rows = row..(row..table.len()).find(|&r| !is_same(r)).unwrap_or(table.len());
        let own = table.field(row, name);
        if hypotheses.last().is_none_or(|last| last.name != own) {
            hypotheses.push(Hypothesis {
                name: own.to_owned(),
                probability: probability[row],
                curves: vec![Vec::new(); observables.len()],
                paint: Paint::line(BASE, 1.3),
            });
        }
        let places = if is_long {
            let of = (table.field(row, keys[1]), table.field(row, keys[2]));
            let place = observables.iter().position(|known| (known.0, known.1) == of).with_context(|| {
                format!("{source}:{}: no --test has the observable {} of {}", table.line(row), of.1, of.0)
            })?;
            place..place + 1
        } else {
            0..observables.len()
        };
        let from = step[row] as usize;
        let own = Steps { from, to: from.saturating_add(rows.len()) };
        let follows = rows.clone().all(|r| step[r] == from as f64 + (r - rows.start) as f64);
        for (place, column) in places.zip(&columns) {
            let steps = observables[place].2;
            let last = hypotheses.last_mut().context("no hypothesis")?;
            ensure!(
                follows
                    && own.to <= steps
                    && last.curves[place].is_empty()
                    && compared[place].is_none_or(|steps| steps == own),
                "{source}:{}: the steps of {} are not those of the measurement ({steps} steps) and of the other \
                 hypotheses, one after another",
                table.line(row),
                last.name
            );
            compared[place] = Some(own);
            last.curves[place] = column[rows.clone()].to_vec();
        }
        row = rows.end;
    }
    for of in &hypotheses {
        if let Some(place) = of.curves.iter().position(Vec::is_empty) {
            let (test, observable, _) = observables[place];
            anyhow::bail!(
                "{source}: no curve of {} for {}; every hypothesis has one",
                of.name,
                named(test, observable)
            );
        }
    }
    Ok((hypotheses, compared.into_iter().flatten().collect()))
}

/// The most probable hypotheses, each set of effects once, and below them the base model, which is drawn in any case.
fn chosen(all: Vec<Hypothesis>, most: usize) -> Vec<Hypothesis> {
    let (base, mut others): (Vec<_>, Vec<_>) = all.into_iter().partition(|of| of.name == "none");
    others.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    // The same effects with a rest have nearly the same curve.
    let mut shown: Vec<String> = Vec::new();
    others.retain(|of| {
        let cause = cause(&of.name).to_owned();
        let is_new = !shown.contains(&cause);
        shown.push(cause);
        is_new
    });
    others.truncate(most);
    for (rank, of) in others.iter_mut().enumerate() {
        let paint = Paint::line(COLORS[rank % COLORS.len()], 1.3);
        of.paint = if rank == 0 { paint } else { paint.dashed(5.0 / rank as f64, 2.0) };
    }
    others.extend(base);
    others
}

impl Own {
    /// Curves and, below them, what each leaves of the measurement; where they end.
    fn draw(
        &self,
        curves: &[(&Hypothesis, &[f64])],
        figure: &mut Figure,
        (place, columns): (usize, usize),
    ) -> f64 {
        let Self { name, control, measured, .. } = self;
        let (left, right) = figure.cell(place, columns);
        let height = (0.62 * (right - left)).clamp(90.0, 170.0);
        let low = 0.75 * height;
        let less = |curve: &[f64]| measured.iter().zip(curve).map(|(y, curve)| y - curve).collect::<Vec<_>>();
        let shown = curves.iter().flat_map(|(_, curve)| curve.iter()).chain(measured);
        let all = Span::of(shown.copied()).padded(0.05);
        let around = self.noise.iter().flatten().flat_map(|sd| [-sd, *sd]);
        let rest = curves.iter().flat_map(|(_, curve)| less(curve));
        let rest = Span::of(rest.chain(around)).with(0.0).padded(0.05);
        let y = Axis::vertical(all, Label { name: name.clone(), unit: self.unit.clone() }, height);
        let label = Label { name: format!("left of {name}"), unit: self.unit.clone() };
        let rest = Axis::vertical(rest, label, low);
        let beside = room_beside(&y, height).max(room_beside(&rest, low));
        let (left, right) = (left + beside, right - 7.0);
        let x = Span::of(control.iter().copied()).padded(0.03);
        let x = Axis::horizontal(x, self.along.clone(), right - left);

        let top = figure.y + 4.0;
        let rect = Rect::new(left, top, right, top + height);
        let title = format!("{name} against {} by each hypothesis", self.along.name);
        let mut panel = Panel::new(title, rect, x.clone(), y).beside(beside);
        if !self.branches.turns() {
            panel = panel.without_x_labels();
        }
        for (of, curve) in curves.iter().rev() {
            panel.line(&of.name, control.iter().copied().zip(curve.iter().copied()), of.paint);
        }
        let points = control.iter().copied().zip(measured.iter().copied());
        panel.dots("measured", points, Dot::among(measured.len(), color::BLACK), 4000);
        let foot = if self.branches.turns() { panel.foot() } else { rect.y1 };
        figure.add(panel.finish());

        // Where the control turns back, what is left is told apart along the steps.
        let steps: Vec<f64> = (0..control.len()).map(|step| (self.first + step) as f64).collect();
        let (places, x) = if self.branches.turns() {
            let span = Span::of(steps.iter().copied()).padded(0.03);
            (&steps, Axis::horizontal(span, Label::new("step"), right - left))
        } else {
            (control, x)
        };
        let top = foot + if self.branches.turns() { 6.0 + ABOVE } else { 9.0 };
        let rect = Rect::new(left, top, right, top + low);
        let mut panel = Panel::new(format!("left of {name}"), rect, x, rest).beside(beside);
        self.branches.mark(&mut panel, self.first);
        if let Some(noise) = &self.noise {
            let below: Vec<f64> = noise.iter().map(|sd| -sd).collect();
            panel.band("noise", places, &below, noise, noise_paint());
        }
        panel.horizontal("zero", 0.0, Paint::line(color::INK, 0.5));
        for (of, curve) in curves.iter().rev() {
            panel.line(&of.name, places.iter().copied().zip(less(curve)), of.paint);
        }
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }
}

fn noise_paint() -> Paint {
    Paint::area(color::GREY).opacity(0.3)
}
