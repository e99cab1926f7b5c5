//! Where a control turns back: its branches, marked along the steps.

use gl_figure::axis::SMALL;
use gl_figure::font;
use gl_figure::panel::Panel;
use gl_figure::scene::{Anchor, Paint, color, text};
use gl_inference::alignment::{Branch, branches};

/// Room that the words take above a panel.
pub const ABOVE: f64 = SMALL + 2.0;

/// The branches of a control; none where it never turns.
#[derive(Clone, Debug, Default)]
pub struct Branches(Vec<Branch>);

impl Branches {
    /// Of control values, shape (steps,).
    pub fn of(control: &[f64]) -> Self {
        let all = branches(control);
        Self(if all.len() > 1 { all } else { Vec::new() })
    }

    /// Whether the control turns.
    pub fn turns(&self) -> bool {
        !self.0.is_empty()
    }

    /// Mark the turning points in a panel along the steps, of which the first is number `first`, and name each
    /// branch above it, where there is room.
    pub fn mark(&self, panel: &mut Panel, first: usize) {
        for branch in self.0.iter().skip(1) {
            let paint = Paint::line(color::GREY, 0.6).dashed(1.2, 1.6);
            panel.vertical("turning point", (first + branch.from) as f64, paint);
        }
        for branch in &self.0 {
            let name = if branch.rises { "rising" } else { "falling" };
            let at = |step: usize| panel.at(((first + step) as f64, panel.y.span.low)).0;
            let (from, to) = (at(branch.from), at(branch.to));
            if to - from > font::width(name, SMALL) {
                let place = ((from + to) / 2.0, panel.rect.y0 - 3.0);
                panel.note(text(place, name, SMALL, Anchor::Middle));
            }
        }
    }
}
