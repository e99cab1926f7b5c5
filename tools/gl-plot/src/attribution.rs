//! Which candidate effect explains the gap.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_table::Table;

use crate::Style;
use gl_figure::axis::{Axis, Label, SMALL, Span};
use gl_figure::figure::{Figure, Key, MARGIN};
use gl_figure::font;
use gl_figure::panel::Panel;
use gl_figure::scene::{Anchor, Color, Item, Paint, Rect, Scene, area, color, fitted, text};

/// Probabilities of hypotheses and effects, confounded ones bracketed
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub struct Attribution {
    /// Table of effects: `effect probability`
    #[arg(long, value_name = "FILE")]
    effects: Option<PathBuf>,
    /// How many hypotheses to show at most
    #[arg(long, value_name = "N", default_value_t = 12)]
    most: usize,
    /// Table of hypotheses: `hypothesis probability … confounded_with`
    #[arg(value_name = "ATTRIBUTION", default_value = "-")]
    attribution: PathBuf,
}

const EXAMPLE: &str = "\
Example:
  printf 'hypothesis probability confounded_with\\n' > which.txt
  printf 'rolling .8 cohesion\\ncohesion .2 rolling\\n' >> which.txt
  gl-plot attribution which.txt -o attribution.svg";

const ROW: f64 = 13.0;
const BAR: f64 = 8.0;

/// A named probability, and the names of those that it cannot be told apart from.
struct Row {
    name: String,
    probability: f64,
    confounded: Vec<String>,
}

fn read(path: &std::path::Path, column: &str) -> Result<Vec<Row>> {
    let table = Table::read(path)?;
    ensure!(!table.is_empty(), "{}: no rows; there is nothing to draw", table.format().source());
    let name = table.format().column(column)?;
    let probability = table.numbers("probability")?;
    let confounded = table.format().find("confounded_with")?;
    let rows = (0..table.len()).map(|row| {
        if !(0.0..=1.0 + 1e-9).contains(&probability[row]) {
            return table.fail(
                row,
                "probability",
                format_args!("{} is not between 0 and 1", probability[row]),
            );
        }
        let others = confounded.map_or("-", |confounded| table.field(row, confounded));
        Ok(Row {
            name: table.field(row, name).to_owned(),
            probability: probability[row],
            confounded: others
                .split(',')
                .map(str::trim)
                .filter(|name| !matches!(*name, "-" | ""))
                .map(str::to_owned)
                .collect(),
        })
    });
    rows.collect()
}

impl Attribution {
    pub fn draw(&self, style: &Style) -> Result<Scene> {
        let mut hypotheses = read(&self.attribution, "hypothesis")?;
        let effects = self.effects.as_deref().map(|path| read(path, "effect")).transpose()?;
        hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let left_out = hypotheses.len().saturating_sub(self.most.max(1));
        let rest: f64 = hypotheses.iter().rev().take(left_out).map(|row| row.probability).sum();
        hypotheses.truncate(self.most.max(1));

        let mut figure = Figure::new("Probability of each explanation of the gap", style.width);
        let groups = groups(&hypotheses);
        if !groups.is_empty() {
            let meaning = "confounded: the measurement can hardly tell them apart".to_owned();
            figure.legend(&[(Key::Line(bracket_paint()), meaning)]);
        }
        let names = hypotheses.iter().chain(effects.iter().flatten());
        let widest = names.map(|row| font::width(&row.name, SMALL)).fold(0.0, f64::max);
        let bars = Bars { names: widest.min(0.35 * figure.width), lanes: lanes(&groups) };
        bars.draw(&mut figure, "hypothesis", &hypotheses, color::BLUE);
        if left_out > 0 {
            figure.y -= 4.0;
            let others = if left_out == 1 { "hypothesis has" } else { "hypotheses together have" };
            let note = format!("{left_out} further {others} {}", percent(rest));
            figure.add(text((2.0 * MARGIN, figure.y), note, SMALL, Anchor::Start));
            figure.y += 6.0;
        }
        if let Some(effects) = &effects {
            figure.y += 4.0;
            Bars { lanes: Vec::new(), ..bars }.draw(&mut figure, "effect", effects, color::GREEN);
        }
        Ok(figure.finish())
    }
}

/// Room for the names, and the groups of rows that are bracketed, lane by lane.
struct Bars {
    names: f64,
    lanes: Vec<Vec<Vec<usize>>>,
}

/// Room for the lanes of brackets, kept beside all bars so that they are of one scale.
const BRACKETS: f64 = 26.0;

impl Bars {
    fn draw(&self, figure: &mut Figure, what: &str, rows: &[Row], color: Color) {
        let left = 2.0 * MARGIN + self.names + 4.0;
        let right = figure.width - MARGIN - BRACKETS;
        let top = figure.y + 4.0;
        let rect = Rect::new(left, top, right, top + ROW * rows.len() as f64 + 4.0);
        // Room for the number at the end of a bar that goes all the way.
        let long = right - left;
        let high = long / (long - font::width("> 99.9 %", SMALL) - 6.0).max(0.5 * long);
        let span = Span { low: 0.0, high, log: false };
        let mut x = Axis::horizontal(span, Label::new(format!("probability of the {what}")), long);
        x.ticks.retain(|(value, _)| *value <= 1.0);
        let y = Axis::bare(Span { low: 0.0, high: 1.0, log: false }, Label::default());
        let mut panel = Panel::new(format!("probability of each {what}"), rect, x, y).without_y_labels();
        let middle = |row: usize| top + 2.0 + ROW * (row as f64 + 0.5);
        for (i, row) in rows.iter().enumerate() {
            let (x0, _) = panel.at((0.0, 0.0));
            let (x1, _) = panel.at((row.probability, 0.0));
            let bar = Rect::new(x0, middle(i) - BAR / 2.0, x1.max(x0 + 0.4), middle(i) + BAR / 2.0);
            let shade = match row.name.as_str() {
                "none" | "unexplained" => color::GREY,
                _ => color,
            };
            panel.add(row.name.clone(), vec![area(bar, Paint::area(shade))]);
            let baseline = middle(i) + 0.36 * SMALL;
            panel.note(text((x1 + 3.0, baseline), percent(row.probability), SMALL, Anchor::Start));
            let name = fitted(&row.name, SMALL, self.names + 0.01);
            panel.note(text((left - 4.0, baseline), name, SMALL, Anchor::End));
        }
        for (lane, groups) in self.lanes.iter().enumerate() {
            let x = right + 4.0 + 6.0 * lane as f64;
            for group in groups {
                let (first, last) = (middle(group[0]), middle(group[group.len() - 1]));
                let mut lines = vec![vec![(x, first), (x + 3.0, first), (x + 3.0, last), (x, last)]];
                let between = group[1..group.len() - 1].iter().map(|&row| middle(row));
                lines.extend(between.map(|y| vec![(x, y), (x + 3.0, y)]));
                let bracket = Item::Path { lines, closed: false, paint: bracket_paint() };
                let names: Vec<&str> = group.iter().map(|&row| rows[row].name.as_str()).collect();
                panel.note(Item::Group {
                    class: "bracket",
                    title: format!("confounded: {}", names.join(", ")),
                    clip: None,
                    items: vec![bracket],
                });
            }
        }
        figure.y = panel.foot() + 4.0;
        figure.add(panel.finish());
    }
}

fn bracket_paint() -> Paint {
    Paint::line(color::VERMILION, 1.0)
}

/// Groups set side by side as far as they overlap.
fn lanes(groups: &[Vec<usize>]) -> Vec<Vec<Vec<usize>>> {
    let mut lanes: Vec<Vec<Vec<usize>>> = Vec::new();
    for group in groups {
        let free = |lane: &&mut Vec<Vec<usize>>| {
            lane.last().and_then(|last| last.last()).is_none_or(|end| *end < group[0])
        };
        match lanes.iter_mut().find(free) {
            Some(lane) => lane.push(group.clone()),
            None => lanes.push(vec![group.clone()]),
        }
    }
    lanes
}

/// Rows that are confounded with each other, directly or through others; each group in order.
fn groups(rows: &[Row]) -> Vec<Vec<usize>> {
    let mut group: Vec<usize> = (0..rows.len()).collect();
    for (i, row) in rows.iter().enumerate() {
        for other in &row.confounded {
            if let Some(j) = rows.iter().position(|row| row.name == *other) {
                let (keep, merge) = (group[i].min(group[j]), group[i].max(group[j]));
                group.iter_mut().filter(|group| **group == merge).for_each(|group| *group = keep);
            }
        }
    }
    (0..rows.len())
        .map(|first| (0..rows.len()).filter(|&i| group[i] == first).collect::<Vec<_>>())
        .filter(|members| members.len() > 1)
        .collect()
}

/// A probability in per cent, with the digits that matter near 0 and 1.
fn percent(probability: f64) -> String {
    match 100.0 * probability {
        share if share <= 0.0 => "0 %".to_owned(),
        share if share < 0.1 => "< 0.1 %".to_owned(),
        share if share < 10.0 => format!("{share:.1} %"),
        share if share > 99.9 && share < 100.0 => "> 99.9 %".to_owned(),
        share if share > 99.0 && share < 100.0 => format!("{share:.1} %"),
        share => format!("{share:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, confounded: &[&str]) -> Row {
        Row {
            name: name.to_owned(),
            probability: 0.5,
            confounded: confounded.iter().map(|name| (*name).to_owned()).collect(),
        }
    }

    #[test]
    fn confounded_rows_form_groups_even_through_others() {
        let rows = [row("a", &["b"]), row("x", &[]), row("b", &[]), row("c", &["b"]), row("d", &["gone"])];
        assert_eq!(groups(&rows), [vec![0, 2, 3]]);
    }

    #[test]
    fn brackets_that_overlap_stand_side_by_side() {
        let groups = [vec![0, 3], vec![1, 2], vec![4, 5]];
        assert_eq!(lanes(&groups), [vec![vec![0, 3], vec![4, 5]], vec![vec![1, 2]]]);
    }

    #[test]
    fn a_probability_is_never_rounded_to_certainty() {
        assert_eq!(
            [percent(0.99996), percent(0.994), percent(0.42), percent(1e-5)],
            ["> 99.9 %", "99.4 %", "42 %", "< 0.1 %"]
        );
    }
}
