//! Which effects the table of an attribution puts into the simulation.

use crate::attribute::attribution::UNEXPLAINED;
use anyhow::{Result, ensure};
use gl_inference::prior::Prior;
use gl_table::Table;
use gl_table::verdict::Verdicts;

/// The effects of the simulator in the most probable hypothesis, in the order of its name; none for `none`, for
/// `unexplained`, for what the measurement does, and where no run shows that they close anything (`untried`).
///
/// * `attribution`, `verdict` — what `gl-gap-attribute` wrote.
///
/// # Errors
/// If the table has no columns `hypothesis probability`, or no rows.
pub fn winning_effects(prior: &Prior, attribution: &Table, verdict: &Verdicts) -> Result<Vec<String>> {
    if verdict.find("untried").is_some() {
        return Ok(Vec::new());
    }
    let cause = MostProbable::of(attribution)?.cause;
    let known: Vec<String> = prior.effects().into_iter().map(|effect| effect.name).collect();
    Ok(cause.split('+').filter(|part| known.iter().any(|effect| effect == part)).map(str::to_owned).collect())
}

/// The most probable cause that a table of hypotheses has: effects with a rest and without are one.
#[derive(Debug, Clone, PartialEq)]
pub struct MostProbable {
    /// The effects, joined by `+`, or `none` or `unexplained`.
    pub cause: String,
    /// Its probability, with a rest and without.
    pub probability: f64,
    /// Whether it is likelier beside a rest than alone.
    pub is_beside_a_rest: bool,
}

impl MostProbable {
    /// * `attribution` — what `gl-gap-attribute` wrote.
    ///
    /// # Errors
    /// See [`winning_effects`].
    pub fn of(attribution: &Table) -> Result<Self> {
        let source = attribution.format().source();
        ensure!(!attribution.is_empty(), "{source}: no hypotheses; gl-gap-attribute writes them");
        let hypothesis = attribution.format().column("hypothesis")?;
        let probability = attribution.numbers("probability")?;
        let name = |row: usize| attribution.field(row, hypothesis);
        let of_rows = |is_meant: &dyn Fn(&str) -> bool| -> f64 {
            (0..probability.len()).filter(|&row| is_meant(name(row))).map(|row| probability[row]).sum()
        };
        let of_cause = |row: usize| of_rows(&|other| cause(other) == cause(name(row)));
        // Of several that are as probable, the first.
        let first =
            (0..probability.len()).rev().max_by(|&a, &b| of_cause(a).total_cmp(&of_cause(b))).unwrap_or(0);
        let cause = cause(name(first));
        let beside = format!("{cause}+{UNEXPLAINED}");
        Ok(Self {
            cause: cause.to_owned(),
            probability: of_cause(first),
            is_beside_a_rest: of_rows(&|other| other == beside) > of_rows(&|other| other == cause),
        })
    }
}

/// The cause that a hypothesis names, with a rest or without.
pub fn cause(hypothesis: &str) -> &str {
    hypothesis.strip_suffix("+unexplained").unwrap_or(hypothesis)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn table(text: &str) -> Table {
        Table::parse("table", text.as_bytes().to_vec()).unwrap()
    }

    #[test]
    fn only_effects_of_the_simulator_win_whatever_the_form_of_the_tables() {
        let prior = "# name,lower,upper,effect,off\r\na,0,1,-,-\r\nb,0,1,x,0\r\nc,0,1,y,0\r\n";
        let prior = Prior::from_table(&table(prior)).unwrap();
        let of = |code: &str, rows: &str| {
            let attribution = table(&format!("#hypothesis probability\n{rows}"));
            let mut verdict = Verdicts::default();
            verdict.add(code, 1, "said");
            winning_effects(&prior, &attribution, &verdict)
        };
        let winner = |rows: &str| of("cause", rows);
        assert_eq!(winner("x+offset(q)+y 0.9\nnone 0.1\n").unwrap(), ["x", "y"]);
        assert_eq!(winner("none 0.1\ny 0.9\n").unwrap(), ["y"]);
        for rows in ["none 1\n", "unexplained 0.9\nx 0.1\n", "offset(q) 1\n"] {
            assert!(winner(rows).unwrap().is_empty(), "{rows}");
        }
        // With a rest or without, it is the same cause.
        assert_eq!(winner("none 0.4\nx 0.3\nx+unexplained 0.3\n").unwrap(), ["x"]);
        assert!(winner("").is_err());
        assert!(of("untried", "x 0.9\nnone 0.1\n").unwrap().is_empty());
    }

    #[test]
    fn a_cause_is_beside_a_rest_where_it_is_likelier_so() {
        let is_beside = |rows: &str| {
            let attribution = table(&format!("hypothesis probability\n{rows}"));
            MostProbable::of(&attribution).unwrap().is_beside_a_rest
        };
        assert!(is_beside("x+y+unexplained 0.5\nx+y 0.3\nx 0.2\n"));
        assert!(!is_beside("x 0.5\nx+unexplained 0.3\ny+unexplained 0.2\n"));
    }
}
