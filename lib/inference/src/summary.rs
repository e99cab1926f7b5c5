//! What a filter says in a few numbers, and whether a calibration is done.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::filter::{NoiseModel, Runs, Weighting};
use crate::prior::{Scale, normal_quantile};
use gl_numeric::statistics::{Quantiles, effective_size, mean, normalised, sd};
use gl_table::{LARGEST, Table, parse_number, push_number, text, write_rows};

/// One row of a summary table.
#[derive(Serialize, Deserialize)]
struct Row {
    quantity: String,
    #[serde(serialize_with = "text")]
    value: String,
}

/// The numbers of a summary that have a name of their own, each with what it is.
macro_rules! quantities {
    ($($(#[$what:meta])* $name:ident,)*) => {
        /// What a calibration says in a few numbers. A quantity is absent where it is not known.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct Summary {
            /// Name of the run that fits best.
            pub best_sample: Option<String>,
            $($(#[$what])* pub $name: Option<f64>,)*
            /// What is known of each parameter.
            pub parameters: Vec<ParameterSummary>,
        }

        impl Summary {
            /// The names of the quantities, in the order in which they are written.
            pub const QUANTITIES: &'static [&'static str] = &[$(stringify!($name)),*];

            fn quantity_mut(&mut self, name: &str) -> Option<&mut Option<f64>> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)*
                    _ => None,
                }
            }

            /// A quantity by its name, for names that a user gives.
            pub fn quantity(&self, name: &str) -> Option<f64> {
                match name {
                    $(stringify!($name) => self.$name,)*
                    _ => {
                        let (kind, parameter) = name.strip_suffix(')')?.split_once('(')?;
                        self.parameter(parameter)?.quantity(kind)
                    }
                }
            }
        }
    };
}

quantities! {
    /// Number of runs.
    runs,
    /// Number of samples whose run failed.
    failed,
    /// What the misfits are divided by, twice: the noise is 1.
    sigma,
    /// The σ of the noise: 1 where it is known, else estimated with the fit.
    sigma_noise,
    /// The least σ that was allowed.
    sigma_min,
    /// The σ at which a calibration is to stop.
    sigma_tol,
    /// Effective sample size, as a share of the runs.
    ess,
    /// Effective sample size, as a number of runs.
    ess_runs,
    /// Mean error of the weighted runs, as a share of the observables' range.
    ensemble_error,
    /// Error of the run that fits best.
    best_error,
    /// Misfit of the run that fits best.
    best_misfit,
    /// The same over what a known noise alone would make.
    best_misfit_over_noise,
    /// Natural logarithm of the evidence.
    ln_evidence,
    /// Number of draws, where the posterior was sampled through an emulator; so are all that follow.
    draws,
    /// Standard deviation of ln likelihood by what the emulator does not know.
    ignorance,
    /// What would be left of a standard deviation if the emulator were exact, as a share of it: the smallest of all parameters.
    known_sd,
    /// Error of the emulator on runs near the posterior, each left out, in standard deviations of the noise.
    rmse,
    /// What the emulator's variance was multiplied by.
    calibration,
    /// Share of the simulation's scatter that the measurement has too.
    scatter,
    /// Relative error of the standard deviations for the runs that the scatter is known by.
    scatter_error,
    /// Factor on the noise that was stated.
    inflation,
    /// Largest correlation of an observable's noise from step to step.
    correlation,
    /// Independent readings among the residuals of the best fit.
    independent_readings,
    /// Correlation of neighbours, or of every second reading, in what the best fit leaves, where that alternates.
    alternation,
    /// χ² of the best fit under the noise as stated.
    chi_square,
    /// Its degrees of freedom.
    chi_square_degrees,
    /// Probability of a larger one.
    chi_square_p,
    /// Number of runs in the newest batch.
    proof_runs,
    /// Their errors in standard deviations of what was predicted.
    proof_z,
    /// Probability of errors at least as large.
    proof_p,
}

/// What is known of one parameter. A quantity is absent where it is not known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParameterSummary {
    /// Its name.
    pub name: String,
    /// Mean.
    pub mean: Option<f64>,
    /// Standard deviation.
    pub sd: Option<f64>,
    /// Standard deviation over mean.
    pub cv: Option<f64>,
    /// Lower end of the 90 % interval.
    pub q05: Option<f64>,
    /// Upper end of the 90 % interval.
    pub q95: Option<f64>,
    /// Its value in the run that fits best.
    pub best: Option<f64>,
    /// The bound that the posterior leans on: −1 the lower, 1 the upper, 0 none.
    pub lean: Option<f64>,
    /// 1 − (posterior sd / prior sd)², for a parameter that was varied.
    pub shrinkage: Option<f64>,
    /// Standard deviation as a share of the way from bound to bound, on the parameter's scale.
    pub width: Option<f64>,
}

impl ParameterSummary {
    const KINDS: [&str; 9] = ["mean", "sd", "cv", "q05", "q95", "best", "lean", "shrinkage", "width"];

    fn quantity_mut(&mut self, kind: &str) -> Option<&mut Option<f64>> {
        match kind {
            "mean" => Some(&mut self.mean),
            "sd" => Some(&mut self.sd),
            "cv" => Some(&mut self.cv),
            "q05" => Some(&mut self.q05),
            "q95" => Some(&mut self.q95),
            "best" => Some(&mut self.best),
            "lean" => Some(&mut self.lean),
            "shrinkage" => Some(&mut self.shrinkage),
            "width" => Some(&mut self.width),
            _ => None,
        }
    }

    fn quantity(&self, kind: &str) -> Option<f64> {
        self.clone().quantity_mut(kind).and_then(|value| *value)
    }

    /// The bound that the posterior leans on, `lower` or `upper`, if it does.
    pub fn leaning_side(&self) -> Option<&'static str> {
        match self.lean? {
            lean if lean < 0.0 => Some("lower"),
            lean if lean > 0.0 => Some("upper"),
            _ => None,
        }
    }
}

impl Summary {
    /// What is known of a parameter.
    pub fn parameter(&self, name: &str) -> Option<&ParameterSummary> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// Effective runs, where weights rest on so few of them that the means are rough: fewer than [`enough_runs`].
    /// Draws rest on all runs, by an emulator.
    pub fn few_runs(&self) -> Option<f64> {
        let needed = enough_runs(self.varied().count()) as f64;
        self.ess_runs.filter(|runs| *runs < needed && self.draws.is_none())
    }

    /// The parameters that were varied; those of an effect that is off stand still.
    pub fn varied(&self) -> impl Iterator<Item = &ParameterSummary> {
        self.parameters.iter().filter(|parameter| parameter.shrinkage.is_some())
    }

    /// Where a quantity goes that a table names; nowhere if this version does not know it.
    ///
    /// * `places` — where each parameter stands.
    fn place(&mut self, quantity: &str, places: &mut HashMap<String, usize>) -> Option<&mut Option<f64>> {
        let Some((kind, name)) = quantity.strip_suffix(')').and_then(|rest| rest.split_once('(')) else {
            return self.quantity_mut(quantity);
        };
        let place = *places.entry(name.to_owned()).or_insert_with(|| {
            self.parameters.push(ParameterSummary { name: name.to_owned(), ..Default::default() });
            self.parameters.len() - 1
        });
        self.parameters[place].quantity_mut(kind)
    }

    /// Read a summary table, `quantity value`.
    ///
    /// # Errors
    /// If it cannot be read, a quantity is repeated, or one that is a number is none.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        table.check_end()?;
        ensure!(
            !table.is_empty(),
            "{}: no quantities; gl-filter --summary writes them",
            table.format().source()
        );
        let mut summary = Self::default();
        let (mut seen, mut places) = (HashSet::new(), HashMap::new());
        for (row, Row { quantity, value }) in table.rows()?.into_iter().enumerate() {
            if !seen.insert(quantity.clone()) {
                return table.fail(row, "quantity", format_args!("duplicate {quantity}"));
            }
            if quantity == "best_sample" {
                summary.best_sample = Some(value);
            } else if let Some(place) = summary.place(&quantity, &mut places) {
                *place = match parse_number(&value) {
                    Ok(number) if number.abs() > LARGEST => {
                        let problem = format_args!("{quantity}: {number:e} is too large to calculate with");
                        return table.fail(row, "value", problem);
                    }
                    Ok(number) => Some(number),
                    Err(problem) => return table.fail(row, "value", format_args!("{quantity}: {problem}")),
                };
            }
        }
        Ok(summary)
    }

    /// Write the summary table.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        let mut rows: Vec<Row> = Vec::new();
        let mut add = |quantity: String, value: Option<f64>| -> Result<()> {
            if let Some(value) = value {
                let name = path.map_or("stdout".into(), gl_table::source_name);
                ensure!(
                    value.is_finite(),
                    "{name}: {quantity}: the result is {value}, beyond what a number can say"
                );
                let mut text = Vec::new();
                push_number(&mut text, value);
                rows.push(Row { quantity, value: String::from_utf8_lossy(&text).into_owned() });
            }
            Ok(())
        };
        for name in Self::QUANTITIES {
            add((*name).to_owned(), self.quantity(name))?;
        }
        for parameter in &self.parameters {
            for kind in ParameterSummary::KINDS {
                add(format!("{kind}({})", parameter.name), parameter.quantity(kind))?;
            }
        }
        if let Some(sample) = &self.best_sample {
            // Beside what else is said of the run that fits best.
            let place =
                rows.iter().rposition(|row| row.quantity.starts_with("best_")).map_or(0, |place| place + 1);
            rows.insert(place, Row { quantity: "best_sample".to_owned(), value: sample.clone() });
        }
        write_rows(path, &rows)
    }
}

/// The marginal posterior of one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterPosterior {
    /// Weighted mean.
    pub mean: f64,
    /// Weighted standard deviation.
    pub sd: f64,
    /// Lower end of the 90 % interval.
    pub q05: f64,
    /// Upper end of the 90 % interval.
    pub q95: f64,
    /// The bound that the posterior leans on, beyond which the truth may lie: −1 the lower, 1 the
    /// upper, 0 none.
    pub lean: i8,
}

/// Where a parameter may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// The scale on which it is far from a bound or near.
    pub scale: Scale,
}

/// Runs that must hold weight for the shape of a posterior of so many parameters d to be seen in them, 2 d + 4.
pub fn enough_runs(parameters: usize) -> usize {
    2 * parameters + 4
}

/// Marginal posteriors whose intervals stay wide enough when few runs hold the weight.
#[derive(Debug)]
pub struct Marginals {
    weights: Vec<f64>,
    /// Weights that rest on enough runs to tell a spread from.
    wide_weights: Vec<f64>,
    /// How far the quantiles stand out from the median.
    stretch: f64,
    /// Whether the moments, too, are those of the wide weights.
    is_posterior: bool,
    /// Variance of predicting the next draw over that of the sample.
    inflation: f64,
}

/// Standard deviations between the mean and a bound below which the posterior leans on it: a uniform
/// one has 1.73, a straight ramp 1.41, a half-normal 1.32, an exponential 1.
const LEAN: f64 = 1.3;

/// The bound that a posterior of this mean and standard deviation leans on, beyond which the truth may
/// lie: −1 the lower, 1 the upper, 0 none. All three on the scale of the parameter: on a linear one the prior of a
/// parameter that is spread over decades leans on its lower bound.
///
/// # Examples
/// ```
/// use gl_inference::summary::leaning;
///
/// // Uniform between the bounds; and an exponential that rises from the lower one.
/// assert_eq!(leaning(0.5, (1.0_f64 / 12.0).sqrt(), (0.0, 1.0)), 0);
/// assert_eq!(leaning(0.1, 0.1, (0.0, 1.0)), -1);
/// ```
pub fn leaning(mean: f64, sd: f64, (lower, upper): (f64, f64)) -> i8 {
    let room = (LEAN * sd).max(0.02 * (upper - lower));
    match (mean - lower < room, upper - mean < room) {
        (true, false) => -1,
        (false, true) => 1,
        _ => 0,
    }
}

impl Marginals {
    /// Prepare for the weights of some runs with so many `parameters` d that vary.
    ///
    /// The sample of a posterior that rests on n runs is too narrow, most of all when n is near the
    /// number of parameters. So its quantiles are taken at a σ at which at least 2 d + 4 runs hold
    /// weight, and stand out from the median as those of Student's t with n − 1 degrees of freedom,
    /// predicting the next draw, do from the normal's. With 100 runs this widens an interval by 2 %.
    /// Where the weights are the posterior itself, its mean and standard deviation are taken so too.
    ///
    /// # Errors
    /// If the weights are none.
    pub fn new(runs: &Runs, weighting: &Weighting, parameters: usize) -> Result<Self> {
        let weights = weighting.weights()?;
        let n = weights.len() as f64;
        let least = enough_runs(parameters) as f64;
        let wide_weights = if effective_size(&weights) >= least {
            weights.clone()
        } else {
            // Where no σ does it (too few runs, or ties), all runs count alike.
            let sigma = if n > least { runs.sigma_of_ess(least / n).ok() } else { None };
            match sigma {
                Some(sigma) => runs.at_sigma(sigma)?.weights()?,
                None => normalised(&runs.ln_proposal.iter().map(|q| -q).collect::<Vec<f64>>())?,
            }
        };
        let ess = effective_size(&wide_weights).max(1.5);
        let inflation = (ess + 1.0) / (ess - 1.0);
        let t = StudentsT::new(0.0, 1.0, ess - 1.0)?.inverse_cdf(0.95) / normal_quantile(0.95);
        Ok(Self {
            weights,
            wide_weights,
            stretch: t * inflation.sqrt(),
            is_posterior: weighting.is_noise,
            inflation,
        })
    }

    /// The marginal posterior of a parameter within its range.
    pub fn of(&self, values: &[f64], range: Range) -> ParameterPosterior {
        let moments = |values: &[f64]| {
            if self.is_posterior {
                (mean(values, &self.wide_weights), sd(values, &self.wide_weights) * self.inflation.sqrt())
            } else {
                (mean(values, &self.weights), sd(values, &self.weights))
            }
        };
        let (mean_value, sd_value) = moments(values);
        let Range { lower, upper, scale } = range;
        let quantiles = Quantiles::new(values, &self.wide_weights);
        let median = quantiles.at(0.5);
        let widened = |p: f64| (median + self.stretch * (quantiles.at(p) - median)).clamp(lower, upper);
        let (centre, spread) = match scale {
            Scale::Linear => (mean_value, sd_value),
            Scale::Log => moments(&values.iter().map(|x| scale.forward(*x)).collect::<Vec<_>>()),
        };
        let lean = leaning(centre, spread, (scale.forward(lower), scale.forward(upper)));
        ParameterPosterior { mean: mean_value, sd: sd_value, q05: widened(0.05), q95: widened(0.95), lean }
    }
}

/// What a summary is made from.
#[derive(Debug)]
pub struct Weighed<'a> {
    /// The runs.
    pub runs: &'a Runs,
    /// Their weights.
    pub weighting: &'a Weighting,
    /// What is known of the noise.
    pub noise: NoiseModel,
    /// Name of each run's sample.
    pub samples: &'a [String],
    /// Mean error of each run.
    pub errors: &'a [f64],
    /// Names of the parameters.
    pub parameters: &'a [String],
    /// Their values, shape (runs, parameters).
    pub values: &'a [Vec<f64>],
    /// Where they may be.
    pub ranges: &'a [Range],
    /// Standard deviation of each parameter's prior, where the prior is known.
    pub prior_sd: Option<&'a [f64]>,
    /// Number of samples whose run failed.
    pub failed: usize,
    /// Misfit of each run that the noise alone would make; 0 where the noise is not known.
    pub expected: &'a [f64],
}

impl Weighed<'_> {
    /// The summary of a filter. `shrinkage(NAME)` is 1 − (posterior sd / prior sd)²: near 0 where the
    /// measurement says nothing of a parameter (Betancourt 2018, arXiv:1803.08393).
    ///
    /// # Errors
    /// If the weights are none.
    pub fn summary(&self) -> Result<Summary> {
        let weights = self.weighting.weights()?;
        let n = weights.len() as f64;
        let ess_runs = effective_size(&weights);
        let best = (0..weights.len())
            .min_by(|&a, &b| self.runs.misfit[a].total_cmp(&self.runs.misfit[b]))
            .context("no runs to summarise")?;
        let columns: Vec<Vec<f64>> =
            (0..self.parameters.len()).map(|j| self.values.iter().map(|row| row[j]).collect()).collect();
        let varied = columns.iter().filter(|column| column.iter().any(|x| *x != column[0])).count();
        let marginals = Marginals::new(self.runs, self.weighting, varied)?;

        let summarise = |(j, name): (usize, &String)| {
            let column = &columns[j];
            let marginal = marginals.of(column, self.ranges[j]);
            let cv = if marginal.sd == 0.0 { 0.0 } else { marginal.sd / marginal.mean };
            let is_varied = column.iter().any(|x| *x != column[0]);
            let prior_sd = self.prior_sd.filter(|_| is_varied);
            ParameterSummary {
                name: name.clone(),
                mean: Some(marginal.mean),
                sd: Some(marginal.sd),
                cv: Some(if cv.is_finite() { cv } else { 0.0 }),
                q05: Some(marginal.q05),
                q95: Some(marginal.q95),
                best: Some(column[best]),
                lean: Some(if is_varied { f64::from(marginal.lean) } else { 0.0 }),
                shrinkage: prior_sd.map(|prior_sd| 1.0 - (marginal.sd / prior_sd[j]).powi(2)),
                width: None,
            }
        };
        let misfit = self.runs.misfit[best];
        Ok(Summary {
            best_sample: Some(self.samples[best].clone()),
            runs: Some(n),
            failed: Some(self.failed as f64),
            sigma: Some(self.weighting.sigma),
            sigma_noise: Some(self.noise.posterior(self.runs)?.sigma),
            ess: Some(ess_runs / n),
            ess_runs: Some(ess_runs),
            ensemble_error: Some(mean(self.errors, &weights)),
            best_error: Some(self.errors[best]),
            best_misfit: Some(misfit),
            best_misfit_over_noise: Some(misfit / self.expected[best]).filter(|_| self.expected[best] > 0.0),
            ln_evidence: Some(self.weighting.ln_evidence),
            parameters: self.parameters.iter().enumerate().map(summarise).collect(),
            ..Summary::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prior_over_decades_leans_on_no_bound_by_its_logarithm() {
        let even = vec![0.01; 100];
        let marginals = Marginals {
            weights: even.clone(),
            wide_weights: even,
            stretch: 1.0,
            is_posterior: false,
            inflation: 1.0,
        };
        let values: Vec<f64> = (0..100).map(|i| 10_f64.powf(-3.0 * (i as f64 + 0.5) / 100.0)).collect();
        let lean =
            |values: &[f64], scale| marginals.of(values, Range { lower: 1e-3, upper: 1.0, scale }).lean;
        assert_eq!(lean(&values, Scale::Linear), -1);
        assert_eq!(lean(&values, Scale::Log), 0);
        // Denser towards the bound, as what is cut off there is.
        let low: Vec<f64> =
            (0..100).map(|i| 10_f64.powf(-3.0 + 0.6 * ((i as f64 + 0.5) / 100.0).powi(2))).collect();
        assert_eq!(lean(&low, Scale::Log), -1);
    }
}
