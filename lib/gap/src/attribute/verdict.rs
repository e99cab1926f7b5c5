//! A diagnosis in a few sentences that a user can act on, each with a code that a program can.

mod bounds;
mod cause;
pub mod noise;
mod rest;
mod rivals;
mod unseen;

use anyhow::Result;
use gl_inference::prior::Prior;
use gl_table::verdict::Verdicts;

use crate::attribute::diagnosis::{Diagnosis, closest_gap};
use crate::attribute::problem::Problem;

/// An effect that closes less of the gap than this is not worth naming where something unknown comes first.
const LITTLE: f64 = 0.05;

/// Above this share of noise and scatter what the emulator does not know widens a verdict.
const IGNORANT: f64 = 0.5;

fn percent(share: f64) -> f64 {
    (100.0 * share).round()
}

/// The verdict: what it rests on if that is doubtful, then the cause, then what else there is to know.
///
/// * `bounds` — where the bounds of the parameters were read, for whoever is to widen them.
/// * `believed` — the prior beforehand and where it was read, if the bounds were made wider since.
///
/// # Errors
/// If the predicted shrink cannot be computed.
pub fn verdict(
    problem: &Problem<'_>,
    diagnosis: &Diagnosis,
    bounds: &str,
    believed: Option<(&Prior, &str)>,
    seed: u64,
) -> Result<Verdicts> {
    let mut verdicts = Verdicts::default();
    if let Some(believed) = believed {
        bounds::add_beyond(&mut verdicts, problem, diagnosis, believed);
    }
    for lean in &diagnosis.leans {
        bounds::add_lean(&mut verdicts, lean, diagnosis, bounds);
    }
    let base = diagnosis.attribution.base();
    let gap = closest_gap(problem, base)?;
    verdicts.add(
        "gap",
        gap,
        format!(
            "the base model misses the measurement by {:.2} % of its range where it comes closest in units of the noise; noise and scatter alone would give {:.2} %",
            100.0 * gap,
            100.0 * diagnosis.floor
        ),
    );
    cause::add(&mut verdicts, problem, diagnosis, seed)?;
    rest::add(&mut verdicts, problem, diagnosis.first())?;
    noise::add(&mut verdicts, problem, diagnosis.first());
    let ignorance = diagnosis.ignorance;
    if ignorance > IGNORANT && !diagnosis.is_unproven() {
        verdicts.add("emulator", ignorance, format!(
            "at the best fit the emulator is uncertain by {ignorance:.1} times noise and scatter: further runs there (gl-gap-attribute --next-out) would make the verdict sharper"
        ));
    }
    unseen::add_untried(&mut verdicts, problem, diagnosis);
    if diagnosis.first().is_cause() {
        rivals::add_ahead(&mut verdicts, problem, diagnosis);
    }
    rivals::add_told(&mut verdicts, problem, diagnosis);
    rivals::add(&mut verdicts, problem, diagnosis)?;
    unseen::add_hidden(&mut verdicts, problem, diagnosis);
    unseen::add_invisible(&mut verdicts, diagnosis);
    Ok(verdicts)
}
