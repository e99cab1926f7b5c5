//! Riddles: a truth that is drawn and hidden, the measurement that it gives, and whether it was found.

use std::f64::consts::TAU;

use anyhow::{Context, Result, ensure};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::ByName;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;
use gl_table::TableWriter;

/// Park and Miller's minimal standard generator: exact in floating point, so that any language can draw the
/// same riddle.
///
/// # Source
/// Park & Miller (1988), Communications of the ACM 31:1192.
#[derive(Clone, Debug)]
pub struct MinimalStandard(f64);

const MODULUS: f64 = 2_147_483_647.0;

/// Seeds are below this one, from which on some would draw nothing but zeros.
pub const SEEDS: u32 = 2_147_483_646;

impl MinimalStandard {
    /// Begin with a seed.
    pub fn new(seed: u32) -> Self {
        Self(48271.0 * f64::from(seed) % MODULUS)
    }

    /// A number in (0, 1), if the seed was above 0.
    pub fn uniform(&mut self) -> f64 {
        self.0 = 16807.0 * self.0 % MODULUS;
        self.0 / MODULUS
    }

    /// A standard normal number, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// A truth with one of the effects in it, each as likely as the others, shape (parameters,): the base parameters and the
/// effect's strength come evenly from the middle half of their ranges, the other effects are off.
///
/// * `seed` — below [`SEEDS`].
///
/// # Errors
/// If there is no effect to draw.
pub fn truth(prior: &Prior, seed: u32) -> Result<Vec<f64>> {
    let parameters = prior.parameters();
    let effects = prior.effects();
    ensure!(!effects.is_empty(), "no parameter belongs to an effect; there is nothing to hide");
    let mut random = MinimalStandard::new(seed + 1);
    // Neighbouring seeds begin alike, so that each skips another number of draws.
    random.uniform();
    for _ in 0..=(1000.0 * random.uniform()) as usize {
        random.uniform();
    }
    let chosen = &effects[(effects.len() as f64 * random.uniform()) as usize].name;
    let value = |p: &gl_inference::prior::Parameter| {
        let drawn = p.lower + (0.25 + 0.5 * random.uniform()) * (p.upper - p.lower);
        if p.effect.as_ref().is_none_or(|effect| effect == chosen) { drawn } else { p.off.unwrap_or(drawn) }
    };
    Ok(parameters.iter().map(value).collect())
}

/// The effects that are on in a truth, in the order of the prior, joined by `+`; `none` where all are off.
pub fn effects_of(prior: &Prior, truth: &[f64]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for (p, value) in prior.parameters().iter().zip(truth) {
        if let Some(effect) = p.effect.as_deref().filter(|_| p.off != Some(*value))
            && !names.contains(&effect)
        {
            names.push(effect);
        }
    }
    if names.is_empty() { "none".to_owned() } else { names.join("+") }
}

/// The strengths of the effects that are on, shape (parameters that are not off,).
pub fn strengths(prior: &Prior, truth: &[f64]) -> Vec<f64> {
    let is_on =
        |(p, value): &(&gl_inference::prior::Parameter, &f64)| p.effect.is_some() && p.off != Some(**value);
    prior.parameters().iter().zip(truth).filter(is_on).map(|(_, value)| *value).collect()
}

/// The one truth of a table of samples; copies of it may follow.
///
/// # Errors
/// If the table is empty, or lacks a parameter.
pub fn hidden(prior: &Prior, samples: &Samples) -> Result<Vec<f64>> {
    samples
        .columns(&prior.names())?
        .into_iter()
        .next()
        .with_context(|| format!("{}: no rows", samples.source))
}

/// A measurement: what specimens give in the mean, with the noise of the sensors.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Control values, shape (steps,).
    pub control: Vec<f64>,
    /// Measured values, shape (observables, steps).
    pub values: Vec<Vec<f64>>,
    /// Standard deviation of each, shape (observables, steps), where it is known.
    pub sd: Option<Vec<Vec<f64>>>,
}

impl Measurement {
    /// The mean of some runs, with noise of standard deviation `noise` from `seed`.
    ///
    /// With `is_scatter_noise` what one specimen differs from another is the noise of a reading, and goes into
    /// the table. It belongs to whole curves, so that readings say less than their number: the deviations are
    /// widened by the root of the mean over the readings of the sum of their correlations.
    ///
    /// # Errors
    /// If there are no runs, or too few to know their scatter.
    pub fn new(runs: &Ensemble, noise: &ByName, seed: u32, is_scatter_noise: bool) -> Result<Self> {
        let count = runs.len();
        ensure!(count > 0, "no run to measure");
        ensure!(!is_scatter_noise || count > 2, "{count} runs cannot tell their scatter; make three or more");
        let (steps, names) = (runs.control.len(), &runs.observables);
        let mut values = vec![vec![0.0; steps]; names.len()];
        let mut deviations = vec![vec![vec![0.0; steps]; count]; names.len()];
        for (j, mean) in values.iter_mut().enumerate() {
            for t in 0..steps {
                mean[t] = (0..count).map(|i| runs.curve(i, j)[t]).sum::<f64>() / count as f64;
                (0..count).for_each(|i| deviations[j][i][t] = runs.curve(i, j)[t] - mean[t]);
            }
        }
        let sd = is_scatter_noise.then(|| deviations.iter().map(|of| widened_sd(of)).collect());
        let mut random = MinimalStandard::new(seed);
        for t in 0..steps {
            for (name, values) in names.iter().zip(&mut values) {
                if let Some(sd) = noise.get(name) {
                    values[t] += sd * random.normal();
                }
            }
        }
        Ok(Self { control: runs.control.clone(), values, sd })
    }

    /// Write it as a table of observations, values to six digits.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&std::path::Path>, control: &str, names: &[String]) -> Result<()> {
        let mut columns = vec![control.to_owned()];
        for name in names {
            columns.push(name.clone());
            columns.extend(self.sd.is_some().then(|| format!("{name}_sd")));
        }
        let mut table = TableWriter::create(path, &columns)?;
        for (t, control) in self.control.iter().enumerate() {
            table.number(*control);
            for (j, values) in self.values.iter().enumerate() {
                table.number(digits(values[t], 6));
                if let Some(sd) = &self.sd {
                    table.number(digits(sd[j][t], 2));
                }
            }
            table.end_row()?;
        }
        table.finish()
    }
}

/// A number to so many significant digits.
fn digits(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

/// Standard deviation of each reading, widened for what readings have in common; from the deviations of the
/// runs from their mean, shape (runs, steps).
fn widened_sd(deviations: &[Vec<f64>]) -> Vec<f64> {
    let (freedom, steps) = (deviations.len() as f64 - 1.0, deviations[0].len());
    let product = |t: usize, u: usize| deviations.iter().map(|d| d[t] * d[u]).sum::<f64>() / freedom;
    let sd: Vec<f64> = (0..steps).map(|t| product(t, t).sqrt()).collect();
    let varies: Vec<usize> = (0..steps).filter(|&t| sd[t] > 0.0).collect();
    let correlations: f64 = varies
        .iter()
        .flat_map(|&t| varies.iter().map(move |&u| (t, u)))
        .map(|(t, u)| product(t, u) / sd[t] / sd[u])
        .sum();
    let widening = (correlations / varies.len().max(1) as f64).max(1.0).sqrt();
    sd.iter().map(|sd| sd * widening).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use gl_table::Table;

    /// The generator's own check: from 1 it comes to this after 10 000 numbers.
    #[test]
    fn the_generator_is_park_and_millers() {
        let mut random = MinimalStandard(1.0);
        for _ in 0..10_000 {
            random.uniform();
        }
        assert_eq!(random.0, 1_043_618_065.0);
    }

    #[test]
    fn a_truth_has_one_effect() {
        let table = "name lower upper effect off\nE 1 2 - -\nw 1 2 adhesion 0\nk 1 2 slip 5\n";
        let prior = Prior::from_table(&Table::parse("p", table.into()).unwrap()).unwrap();
        for seed in 0..50 {
            let truth = truth(&prior, seed).unwrap();
            assert!((1.25..=1.75).contains(&truth[0]));
            let effects = effects_of(&prior, &truth);
            assert!(["adhesion", "slip"].contains(&effects.as_str()), "{effects}");
            assert_eq!(strengths(&prior, &truth).len(), 1);
        }
    }

    #[test]
    fn a_scatter_that_belongs_to_whole_curves_widens_the_deviations() {
        let same = widened_sd(&[vec![1.0; 4], vec![-1.0; 4], vec![0.0; 4]]);
        assert!(same.iter().all(|sd| (sd - 2.0).abs() < 1e-12), "{same:?}");
    }
}
