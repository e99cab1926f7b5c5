//! What a filter says in a few numbers, and whether a calibration is done.

use std::path::Path;

use anyhow::{Context, Result, bail};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::filter::{Noise, Runs, Weighting};
use crate::prior::normal_quantile;
use gl_numeric::statistics::{Quantiles, mean, normalised, sd};
use gl_table::{Table, TableWriter, parse_number, push_number};

/// Named quantities, in the order in which they were added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    rows: Vec<(String, String)>,
}

impl Summary {
    /// Add a number.
    pub fn number(&mut self, quantity: impl Into<String>, value: f64) {
        let mut text = Vec::new();
        push_number(&mut text, value);
        self.text(quantity, String::from_utf8_lossy(&text));
    }

    /// Add a text.
    pub fn text(&mut self, quantity: impl Into<String>, value: impl Into<String>) {
        self.rows.push((quantity.into(), value.into()));
    }

    /// A quantity as text, if it is there.
    pub fn get(&self, quantity: &str) -> Option<&str> {
        self.rows.iter().find(|(name, _)| name == quantity).map(|(_, value)| value.as_str())
    }

    /// A quantity as a number, if it is there.
    ///
    /// # Errors
    /// If it is no finite number.
    pub fn find_number(&self, quantity: &str) -> Result<Option<f64>> {
        self.get(quantity)
            .map(|value| parse_number(value).with_context(|| format!("quantity {quantity}")))
            .transpose()
    }

    /// Names of the quantities `kind(NAME)`, for example of `lean(NAME)`.
    pub fn names_of(&self, kind: &str) -> Vec<String> {
        let inside = |quantity: &str| {
            Some(quantity.strip_prefix(kind)?.strip_prefix('(')?.strip_suffix(')')?.to_owned())
        };
        self.rows.iter().filter_map(|(quantity, _)| inside(quantity)).collect()
    }

    /// Read a summary table, `quantity value`.
    ///
    /// # Errors
    /// If it cannot be read, or a quantity is repeated.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        let (quantity, value) = (table.format().column("quantity")?, table.format().column("value")?);
        let mut summary = Self::default();
        for row in 0..table.len() {
            let name = table.field(row, quantity);
            if summary.get(name).is_some() {
                bail!("{}:{}: quantity {name} is there twice", table.format().source(), table.line(row));
            }
            summary.text(name, table.field(row, value));
        }
        Ok(summary)
    }

    /// Write the summary table.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        let mut table = TableWriter::create(path, &["quantity", "value"])?;
        for (quantity, value) in &self.rows {
            table.text(quantity).text(value).end_row()?;
        }
        table.finish()
    }
}

/// The marginal posterior of one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marginal {
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
/// lie: −1 the lower, 1 the upper, 0 none.
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
        let least = 2.0 * parameters as f64 + 4.0;
        let effective = |weights: &[f64]| 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let wide_weights = if effective(&weights) >= least {
            weights.clone()
        } else {
            // Where no σ does it (too few runs, or ties), all runs count alike.
            let sigma = if n > least { runs.sigma_of_ess(least / n).ok() } else { None };
            match sigma {
                Some(sigma) => runs.at_sigma(sigma)?.weights()?,
                None => normalised(&runs.ln_proposal.iter().map(|q| -q).collect::<Vec<f64>>())?,
            }
        };
        let ess = effective(&wide_weights).max(1.5);
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

    /// The marginal posterior of a parameter between its bounds.
    pub fn of(&self, values: &[f64], (lower, upper): (f64, f64)) -> Marginal {
        let (mean_value, sd_value) = if self.is_posterior {
            (mean(values, &self.wide_weights), sd(values, &self.wide_weights) * self.inflation.sqrt())
        } else {
            (mean(values, &self.weights), sd(values, &self.weights))
        };
        let quantiles = Quantiles::new(values, &self.wide_weights);
        let median = quantiles.at(0.5);
        let widened = |p: f64| (median + self.stretch * (quantiles.at(p) - median)).clamp(lower, upper);
        let lean = leaning(mean_value, sd_value, (lower, upper));
        Marginal { mean: mean_value, sd: sd_value, q05: widened(0.05), q95: widened(0.95), lean }
    }
}

/// What a summary is made from.
#[derive(Debug)]
pub struct Evidence<'a> {
    /// The runs.
    pub runs: &'a Runs,
    /// Their weights.
    pub weighting: &'a Weighting,
    /// What is known of the noise.
    pub noise: Noise,
    /// Name of each run's sample.
    pub samples: &'a [String],
    /// Mean error of each run.
    pub errors: &'a [f64],
    /// Names of the parameters.
    pub parameters: &'a [String],
    /// Their values, shape (runs, parameters).
    pub values: &'a [Vec<f64>],
    /// Their bounds.
    pub bounds: &'a [(f64, f64)],
    /// Standard deviation of each parameter's prior, where the prior is known.
    pub prior_sd: Option<&'a [f64]>,
    /// Number of samples whose run failed.
    pub failed: usize,
    /// Misfit of each run that the noise alone would make; 0 where the noise is not known.
    pub expected: &'a [f64],
}

impl Evidence<'_> {
    /// The summary of a filter. `shrinkage(NAME)` is 1 − (posterior sd / prior sd)²: near 0 where the
    /// measurement says nothing of a parameter (Betancourt 2018, arXiv:1803.08393).
    ///
    /// # Errors
    /// If the weights are none.
    pub fn summary(&self) -> Result<Summary> {
        let weights = self.weighting.weights()?;
        let n = weights.len() as f64;
        let ess_runs = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        let best = (0..weights.len())
            .min_by(|&a, &b| self.runs.misfit[a].total_cmp(&self.runs.misfit[b]))
            .context("no runs to summarise")?;
        let columns: Vec<Vec<f64>> =
            (0..self.parameters.len()).map(|j| self.values.iter().map(|row| row[j]).collect()).collect();
        let varied = columns.iter().filter(|column| column.iter().any(|x| *x != column[0])).count();
        let marginals = Marginals::new(self.runs, self.weighting, varied)?;

        let mut summary = Summary::default();
        summary.number("runs", n);
        summary.number("failed", self.failed as f64);
        summary.number("sigma", self.weighting.sigma);
        summary.number("sigma_noise", self.noise.posterior(self.runs)?.sigma);
        summary.number("ess", ess_runs / n);
        summary.number("ess_runs", ess_runs);
        summary.number("ensemble_error", mean(self.errors, &weights));
        summary.number("best_error", self.errors[best]);
        summary.number("best_misfit", self.runs.misfit[best]);
        if self.expected[best] > 0.0 {
            summary.number("best_misfit_over_noise", self.runs.misfit[best] / self.expected[best]);
        }
        summary.text("best_sample", &self.samples[best]);
        summary.number("ln_evidence", self.weighting.ln_evidence);
        for (j, ((name, column), &bounds)) in
            self.parameters.iter().zip(&columns).zip(self.bounds).enumerate()
        {
            let marginal = marginals.of(column, bounds);
            summary.number(format!("mean({name})"), marginal.mean);
            summary.number(format!("sd({name})"), marginal.sd);
            let cv = if marginal.sd == 0.0 { 0.0 } else { marginal.sd / marginal.mean };
            summary.number(format!("cv({name})"), if cv.is_finite() { cv } else { 0.0 });
            summary.number(format!("q05({name})"), marginal.q05);
            summary.number(format!("q95({name})"), marginal.q95);
            summary.number(format!("best({name})"), column[best]);
            let is_varied = column.iter().any(|x| *x != column[0]);
            summary.number(format!("lean({name})"), if is_varied { f64::from(marginal.lean) } else { 0.0 });
            if let Some(prior_sd) = self.prior_sd.filter(|_| is_varied) {
                summary.number(format!("shrinkage({name})"), 1.0 - (marginal.sd / prior_sd[j]).powi(2));
            }
        }
        Ok(summary)
    }
}
