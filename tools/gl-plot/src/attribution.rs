//! Which candidate effect explains the gap.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl::table::Table;

use crate::Style;
use crate::axis::{Axis, Label, SMALL, Span};
use crate::figure::{Figure, MARGIN};
use crate::font;
use crate::panel::{BELOW, Panel};
use crate::scene::{Anchor, Color, Paint, Rect, Scene, area, color, fitted, line, text};

/// Probabilities of hypotheses and effects, confounded ones bracketed
#[derive(Args)]
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
        draw_bars(&mut figure, "hypothesis", &hypotheses, color::BLUE);
        if left_out > 0 {
            figure.y -= 4.0;
            let others = if left_out == 1 { "hypothesis has" } else { "hypotheses together have" };
            let note = format!("{left_out} further {others} {}", percent(rest));
            figure.add(text((2.0 * MARGIN, figure.y), note, SMALL, Anchor::Start));
            figure.y += 6.0;
        }
        if let Some(effects) = &effects {
            figure.y += 4.0;
            draw_bars(&mut figure, "effect", effects, color::GREEN);
        }
        Ok(figure.finish())
    }
}

fn draw_bars(figure: &mut Figure, what: &str, rows: &[Row], color: Color) {
    let groups = groups(rows);
    let lanes = groups.len();
    let names =
        rows.iter().map(|row| font::width(&row.name, SMALL)).fold(0.0, f64::max).min(0.35 * figure.width);
    let brackets = if lanes == 0 { 0.0 } else { 8.0 * lanes as f64 + 12.0 };
    let left = 2.0 * MARGIN + names + 4.0;
    let right = figure.width - MARGIN - 4.0 - brackets;
    let top = figure.y + 4.0;
    let rect = Rect::new(left, top, right, top + ROW * rows.len() as f64 + 4.0);
    // Room for the number at the end of a bar that goes all the way.
    let span = Span { low: 0.0, high: 1.12, log: false };
    let mut x = Axis::horizontal(span, Label::new(format!("probability of the {what}")), right - left);
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
        let name = fitted(&row.name, SMALL, names);
        panel.note(text((left - 4.0, baseline), name, SMALL, Anchor::End));
    }
    for (lane, group) in groups.iter().enumerate() {
        let x = right + 8.0 * lane as f64;
        let (first, last) = (group[0], group[group.len() - 1]);
        let paint = Paint::line(color::VERMILION, 1.0);
        let mut items = vec![line(
            vec![
                (x + 3.0, middle(first)),
                (x + 6.0, middle(first)),
                (x + 6.0, middle(last)),
                (x + 3.0, middle(last)),
            ],
            paint,
        )];
        // A member between the ends.
        items.extend(
            group[1..group.len() - 1]
                .iter()
                .map(|&row| line(vec![(x + 3.0, middle(row)), (x + 6.0, middle(row))], paint)),
        );
        for item in items {
            panel.note(item);
        }
    }
    if lanes > 0 {
        let x = right + 8.0 * lanes as f64 + SMALL + 1.0;
        let centre = (rect.y0 + rect.y1) / 2.0;
        panel.note(crate::scene::turned_text((x, centre), fitted("confounded", SMALL, rect.height()), SMALL));
    }
    figure.add(panel.finish());
    figure.y = rect.y1 + BELOW + 4.0;
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
    fn a_probability_is_never_rounded_to_certainty() {
        assert_eq!(
            [percent(0.99996), percent(0.994), percent(0.42), percent(1e-5)],
            ["> 99.9 %", "99.4 %", "42 %", "< 0.1 %"]
        );
    }
}
