//! How the weights come about along the steps of the measurement.

use std::path::Path;

use anyhow::Result;
use gl_inference::filter::{NoiseModel, Runs, Weighting};
use gl_inference::misfit::Misfits;
use gl_numeric::statistics::{ess_fraction, mean, sd};
use gl_table::TableWriter;

/// Steps at which the weights are looked at.
const LOOKS: usize = 6;

/// The weights with more and more of the steps, σ as at the end.
pub struct Course<'a> {
    pub misfits: &'a Misfits,
    pub runs: &'a Runs,
    /// The weights of all steps.
    pub last: &'a Weighting,
    pub noise: NoiseModel,
    pub parameters: &'a [String],
    /// Parameters of the runs, one row a run.
    pub values: &'a [Vec<f64>],
}

impl Course<'_> {
    /// Weights from the readings up to the step at this place, and with it.
    fn up_to(&self, place: usize) -> Result<Weighting> {
        let runs = Runs::new(self.misfits.total_up_to(place)?, self.runs.ln_proposal.clone())?;
        if self.last.is_noise {
            let share = (place + 1) as f64 / self.misfits.steps.len() as f64;
            self.noise.share(share).posterior(&runs)
        } else {
            runs.at_sigma(self.last.sigma)
        }
    }

    /// The history table: `step sigma ess mean(NAME)… cv(NAME)…`.
    pub fn write_history(&self, path: &Path) -> Result<()> {
        let mut columns = vec!["step".to_owned(), "sigma".to_owned(), "ess".to_owned()];
        columns.extend(self.parameters.iter().map(|name| format!("mean({name})")));
        columns.extend(self.parameters.iter().map(|name| format!("cv({name})")));
        let mut table = TableWriter::create(Some(path), &columns)?;
        for (place, &step) in self.misfits.steps.iter().enumerate() {
            let weighting = self.up_to(place)?;
            let weights = weighting.weights()?;
            let column = |j: usize| self.values.iter().map(|row| row[j]).collect::<Vec<f64>>();
            let count = self.parameters.len();
            let means: Vec<f64> = (0..count).map(|j| mean(&column(j), &weights)).collect();
            let cvs: Vec<f64> = (0..count).map(|j| sd(&column(j), &weights) / means[j]).collect();
            table.number(step as f64).number(self.last.sigma).number(ess_fraction(&weighting.ln_weight)?);
            table.numbers(&means);
            table.numbers(&cvs.iter().map(|cv| if cv.is_finite() { *cv } else { 0.0 }).collect::<Vec<_>>());
            table.end_row()?;
        }
        table.finish()
    }

    /// The weights at up to six steps, evenly apart and the last one the last: `sample step NAME… weight`.
    pub fn write_weights(&self, path: &Path) -> Result<()> {
        let mut columns = vec!["sample", "step"];
        columns.extend(self.parameters.iter().map(String::as_str));
        columns.push("weight");
        let mut table = TableWriter::create(Some(path), &columns)?;
        for place in looks(self.misfits.steps.len()) {
            let weights = self.up_to(place)?.weights()?;
            for ((sample, values), weight) in self.misfits.samples.iter().zip(self.values).zip(weights) {
                table.text(sample).number(self.misfits.steps[place] as f64).numbers(values);
                table.number(weight).end_row()?;
            }
        }
        table.finish()
    }
}

/// Places of the steps that are looked at, of so many.
fn looks(steps: usize) -> Vec<usize> {
    let mut places: Vec<usize> = (1..=LOOKS).map(|look| (steps * look / LOOKS).max(1) - 1).collect();
    places.dedup();
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_steps_are_evenly_apart_and_end_with_the_last() {
        assert_eq!(looks(120), [19, 39, 59, 79, 99, 119]);
        assert_eq!(looks(8), [0, 1, 3, 4, 5, 7]);
        assert_eq!(looks(3), [0, 1, 2]);
        assert_eq!(looks(1), [0]);
    }
}
