//! Verdicts of the tools, as sentences. What a verdict means is told by its code alone.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_table::verdict::Verdicts;
use serde::Serialize;

/// A row of a verdict table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Sentence {
    /// What it says, for programs.
    pub code: String,
    /// The number or name that it is about.
    pub value: String,
    /// What it says, for readers, with a capital and a full stop.
    pub text: String,
}

/// The rows of a verdict table in their order; none where there is no such file.
///
/// # Errors
/// If it cannot be read.
pub fn read(path: &Path) -> Result<Vec<Sentence>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let sentence = |row: &gl_table::verdict::Verdict| Sentence {
        code: row.code.clone(),
        value: row.value.clone(),
        text: sentence(&row.text, &row.value),
    };
    Ok(Verdicts::read(path)?.rows.iter().map(sentence).collect())
}

/// The rows of several tables, each that several have once.
///
/// # Errors
/// See [`read`].
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Sentence>> {
    let mut all: Vec<Sentence> = Vec::new();
    for path in paths {
        for row in read(path)? {
            if !all.iter().any(|known| (&known.code, &known.value) == (&row.code, &row.value)) {
                all.push(row);
            }
        }
    }
    Ok(all)
}

/// With a capital, unless it begins with the name that it is about, and a full stop, unless it asks.
fn sentence(text: &str, name: &str) -> String {
    let text = text.trim().trim_end_matches('.');
    let begins_with_name = text.split(' ').next() == Some(name);
    let end = if text.ends_with('?') { "" } else { "." };
    let mut letters = text.chars();
    match letters.next() {
        Some(first) if !begins_with_name => format!("{}{}{end}", first.to_uppercase(), letters.as_str()),
        Some(_) => format!("{text}{end}"),
        None => String::new(),
    }
}

/// Whether the gap may not close by an effect that was put in, neither in all observables together nor in a single one: the
/// noise of others may hide one in which it does.
pub fn closes_nothing(said: &[Sentence]) -> bool {
    let is_said = |code: &str| said.iter().any(|sentence| sentence.code == code);
    is_said("grows") || is_said("may-not-close") && !is_said("closes-in")
}

/// How much of the gap closed by an effect that was put in, in per cent, where that is less than half.
pub fn closes_little(said: &[Sentence]) -> Option<String> {
    let closes =
        said.iter().find(|sentence| matches!(sentence.code.as_str(), "closes" | "closes-by-noise"))?;
    let share: f64 = closes.value.parse().ok()?;
    (share < 0.5).then(|| format!("{:.0}", 100.0 * share))
}

/// Whether a code answers what a diagnosis was asked, so that it is said first.
pub fn is_answer(code: &str) -> bool {
    ANSWERS.contains(&code)
}

const ANSWERS: &[&str] = &["cause", "cause-with-rest", "part", "unsettled", "unexplained", "none"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_closes_a_gap_in_one_observable_is_not_refuted_by_the_noise_of_the_others() {
        let said = |codes: &[&str]| {
            let sentence = |code: &&str| Sentence {
                code: (*code).to_owned(),
                value: String::new(),
                text: String::new(),
            };
            closes_nothing(&codes.iter().map(sentence).collect::<Vec<_>>())
        };
        assert!(said(&["may-not-close"]) && said(&["grows", "closes-in"]));
        assert!(!said(&["may-not-close", "closes-in"]) && !said(&["closes"]) && !said(&["closes-by-noise"]));
    }

    #[test]
    fn what_closes_less_than_half_of_a_gap_is_said_to() {
        let closes = |code: &str, value: &str| {
            let (code, value, text) = (code.to_owned(), value.to_owned(), String::new());
            closes_little(&[Sentence { code, value, text }])
        };
        assert_eq!(closes("closes", "0.274"), Some("27".to_owned()));
        assert_eq!((closes("closes", "0.8"), closes("closes-in", "0.1")), (None, None));
    }

    #[test]
    fn a_sentence_has_a_capital_unless_it_begins_with_a_name() {
        assert_eq!(sentence("the fit is bad", "0.2"), "The fit is bad.");
        assert_eq!(sentence("nu leans on its upper bound", "nu"), "nu leans on its upper bound.");
        assert_eq!(sentence("The gap closes.", "all"), "The gap closes.");
    }
}
