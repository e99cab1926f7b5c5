//! What the most probable hypotheses make of the measurement, each by its mean curve.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_figure::axis::{Axis, Label, Span};
use gl_figure::figure::{Figure, Key};
use gl_figure::panel::{Dot, Panel, room_beside};
use gl_figure::scene::{Color, Paint, Rect, Scene, color};
use gl_inference::observations::{ByName, Observations, Steps};
use gl_table::Table;

use crate::branches::{ABOVE, Branches};
use crate::input::check_panels;
use crate::{Style, Units};

/// The curves of the base model and of the most probable hypotheses over the measurement, and what each leaves
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Hypotheses {
    /// Table of what was measured
    #[arg(short = 'b', long, value_name = "FILE")]
    observations: PathBuf,
    /// Standard deviation of the measurement noise, as in f=0.02,q=1; by default the `_sd` columns
    #[arg(long, value_name = "NAME=SD,…")]
    noise: Option<ByName>,
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
    /// Mean curves, shape (observables, steps).
    curves: Vec<Vec<f64>>,
    paint: Paint,
}

/// The measurement at the steps that the hypotheses were asked about.
struct Compared {
    observations: Observations,
    noise: Option<Vec<Vec<f64>>>,
    hypotheses: Vec<Hypothesis>,
    /// Number of the first step.
    first: usize,
    branches: Branches,
}

impl Hypotheses {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let compared = self.compared()?;
        let names = &compared.observations.names;
        let mut figure = Figure::new("What each hypothesis makes of the measurement", style.width);
        let steps = compared.observations.steps();
        let mut legend = vec![(Key::Dot(Dot::among(steps, color::BLACK)), "measured".to_owned())];
        if compared.noise.is_some() {
            legend.push((Key::Area(noise_paint()), "noise, ± 1 sd".to_owned()));
        }
        for of in &compared.hypotheses {
            legend.push((Key::Line(of.paint), format!("{} ({:.2})", of.name, of.probability)));
        }
        figure.legend(&legend);
        let columns = figure.columns(names.len(), 150.0);
        let all: Vec<usize> = (0..names.len()).collect();
        for row in all.chunks(columns) {
            let mut foot = figure.y;
            for (place, &j) in row.iter().enumerate() {
                foot = foot.max(self.panels(&compared, j, &mut figure, (place, columns)));
            }
            figure.y = foot + 4.0;
        }
        Ok(figure.finish())
    }

    fn compared(&self) -> Result<Compared> {
        let table = Table::read(&self.curves)?;
        let source = table.format().source();
        ensure!(!table.is_empty(), "{source}: no rows; there is nothing to draw");
        let columns = table.format().columns();
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
        let observations = Observations::read(&self.observations, &names[0], &names[1..])?;
        let noise = observations.noise(&self.noise.clone().unwrap_or_default())?;
        let (hypotheses, steps) = self.read(&table, &names[1..], observations.steps())?;
        let cut = |noise: &Vec<f64>| noise[steps.from..steps.to].to_vec();
        let observations = observations.part(steps.from..steps.to);
        Ok(Compared {
            first: steps.from,
            branches: Branches::of(&observations.control),
            noise: noise.map(|noise| noise.iter().map(cut).collect()),
            observations,
            hypotheses,
        })
    }

    /// The base model and the most probable hypotheses, and the steps that all of them have.
    fn read(&self, table: &Table, names: &[String], steps: usize) -> Result<(Vec<Hypothesis>, Steps)> {
        let source = table.format().source();
        let name = table.format().column("hypothesis")?;
        let (probability, step) = (table.numbers("probability")?, table.numbers("step")?);
        let columns = names.iter().map(|name| table.numbers(name)).collect::<Result<Vec<_>>>()?;
        let mut hypotheses: Vec<Hypothesis> = Vec::new();
        let mut compared: Option<Steps> = None;
        let mut row = 0;
        while row < table.len() {
            let end = (row..table.len()).find(|&r| table.field(r, name) != table.field(row, name));
            let rows = row..end.unwrap_or(table.len());
            let from = step[row] as usize;
            let own = Steps { from, to: from + rows.len() };
            let follows = rows.clone().all(|r| step[r] == (from + r - rows.start) as f64);
            ensure!(
                follows && own.to <= steps && compared.is_none_or(|steps| steps == own),
                "{source}:{}: the steps of {} are not those of the measurement ({steps} steps) and of the other \
                 hypotheses, one after another",
                table.line(row),
                table.field(row, name)
            );
            compared = Some(own);
            let curves = columns.iter().map(|column| column[rows.clone()].to_vec()).collect();
            let (name, probability) = (table.field(row, name).to_owned(), probability[row]);
            hypotheses.push(Hypothesis { name, probability, curves, paint: Paint::line(BASE, 1.3) });
            row = rows.end;
        }
        // The base model is drawn in any case, below the others.
        let (base, mut others): (Vec<_>, Vec<_>) = hypotheses.into_iter().partition(|of| of.name == "none");
        others.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        // The same effects with a rest have nearly the same curve.
        let effects = |name: &str| name.strip_suffix("+unexplained").unwrap_or(name).to_owned();
        let mut shown: Vec<String> = Vec::new();
        others.retain(|of| {
            let is_new = !shown.contains(&effects(&of.name));
            shown.push(effects(&of.name));
            is_new
        });
        others.truncate(self.most);
        for (rank, of) in others.iter_mut().enumerate() {
            let paint = Paint::line(COLORS[rank % COLORS.len()], 1.3);
            of.paint = if rank == 0 { paint } else { paint.dashed(5.0 / rank as f64, 2.0) };
        }
        others.extend(base);
        Ok((others, compared.unwrap_or(Steps::ALL)))
    }

    /// Curves and, below them, what each leaves of the measurement; where they end.
    fn panels(
        &self,
        compared: &Compared,
        j: usize,
        figure: &mut Figure,
        (place, columns): (usize, usize),
    ) -> f64 {
        let Compared { observations: Observations { names, control, control_name, values, .. }, .. } =
            compared;
        let (left, right) = figure.cell(place, columns);
        let height = (0.62 * (right - left)).clamp(90.0, 170.0);
        let low = 0.75 * height;
        let measured = &values[j];
        let curves = || compared.hypotheses.iter().map(|of| &of.curves[j]);
        let less =
            |curve: &Vec<f64>| measured.iter().zip(curve).map(|(y, curve)| y - curve).collect::<Vec<_>>();
        let noise = compared.noise.as_ref().map(|noise| noise[j].clone());
        let all = Span::of(curves().chain([measured]).flatten().copied()).padded(0.05);
        let around = noise.iter().flatten().flat_map(|sd| [-sd, *sd]);
        let rest = Span::of(curves().flat_map(less).chain(around)).with(0.0).padded(0.05);
        let unit = self.units.get(&names[j]);
        let y = Axis::vertical(all, Label { name: names[j].clone(), unit: unit.clone() }, height);
        let rest = Axis::vertical(rest, Label { name: format!("left of {}", names[j]), unit }, low);
        let beside = room_beside(&y, height).max(room_beside(&rest, low));
        let (left, right) = (left + beside, right - 7.0);
        let along = Label { name: control_name.clone(), unit: self.units.get(control_name) };
        let x = Axis::horizontal(Span::of(control.iter().copied()).padded(0.03), along, right - left);

        let top = figure.y + 4.0;
        let rect = Rect::new(left, top, right, top + height);
        let name = format!("{} against {control_name} by each hypothesis", names[j]);
        let mut panel = Panel::new(name, rect, x.clone(), y).beside(beside);
        if !compared.branches.turns() {
            panel = panel.without_x_labels();
        }
        for of in compared.hypotheses.iter().rev() {
            let points = control.iter().copied().zip(of.curves[j].iter().copied());
            panel.line(&of.name, points, of.paint);
        }
        let points = control.iter().copied().zip(measured.iter().copied());
        panel.dots("measured", points, Dot::among(measured.len(), color::BLACK), 4000);
        let foot = if !compared.branches.turns() { rect.y1 } else { panel.foot() };
        figure.add(panel.finish());

        // Where the control turns back, what is left is told apart along the steps.
        let steps: Vec<f64> = (0..control.len()).map(|step| (compared.first + step) as f64).collect();
        let (places, x) = if !compared.branches.turns() {
            (control.clone(), x)
        } else {
            let span = Span::of(steps.iter().copied()).padded(0.03);
            (steps, Axis::horizontal(span, Label::new("step"), right - left))
        };
        let top = foot + if compared.branches.turns() { 6.0 + ABOVE } else { 9.0 };
        let rect = Rect::new(left, top, right, top + low);
        let mut panel = Panel::new(format!("left of {}", names[j]), rect, x, rest).beside(beside);
        compared.branches.mark(&mut panel, compared.first);
        if let Some(noise) = &noise {
            let below: Vec<f64> = noise.iter().map(|sd| -sd).collect();
            panel.band("noise", &places, &below, noise, noise_paint());
        }
        panel.horizontal("zero", 0.0, Paint::line(color::INK, 0.5));
        for of in compared.hypotheses.iter().rev() {
            let left = less(&of.curves[j]);
            panel.line(&of.name, places.iter().copied().zip(left), of.paint);
        }
        let foot = panel.foot();
        figure.add(panel.finish());
        foot
    }
}

fn noise_paint() -> Paint {
    Paint::area(color::GREY).opacity(0.3)
}
