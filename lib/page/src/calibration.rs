//! What a calibration left in its folder.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gl_figure::number::{interval, short, significant, with_sd};
use gl_inference::prior::{Prior, Scale};
use gl_inference::summary::Summary;
use gl_table::Table;
use serde::Serialize;

use crate::grid::Grid;
use crate::verdict::{self, Sentence};

/// A finished calibration.
#[derive(Debug)]
pub struct Calibration {
    /// Its folder.
    pub folder: PathBuf,
    /// The folders of the iterations that are finished, in order.
    pub iterations: Vec<PathBuf>,
    /// What the last filter said, and each one while it tempered.
    posterior: Known,
    tempered: Vec<Known>,
    /// What speaks for and against stopping here.
    pub verdict: Vec<Sentence>,
    /// Whether a criterion ended it, and not the number of iterations.
    pub is_done: bool,
    /// Whether the posterior is one of draws through an emulator, and not of weights of the runs.
    pub is_drawn: bool,
}

/// A summary, of which the quantities that every filter gives are asked for by name.
#[derive(Debug)]
struct Known {
    path: PathBuf,
    summary: Summary,
}

impl Known {
    fn read(path: PathBuf) -> Result<Self> {
        Ok(Self { summary: Summary::read(&path)?, path })
    }

    fn number(&self, quantity: &str) -> Result<f64> {
        self.summary.quantity(quantity).with_context(|| {
            format!("{}: no quantity {quantity}; is it a summary of gl-filter?", self.path.display())
        })
    }
}

/// One parameter after a calibration.
#[derive(Clone, Debug)]
pub struct Estimate {
    pub name: String,
    pub unit: String,
    pub mean: f64,
    pub sd: f64,
    pub low: f64,
    pub high: f64,
    pub best: f64,
    /// Standard deviation over that of the prior.
    pub left: f64,
    /// −1 or 1 where it leans on its lower or upper bound, else 0.
    pub lean: f64,
    /// Whether its scale is logarithmic.
    pub is_log: bool,
}

impl Estimate {
    /// The name with its unit, as over a column.
    pub fn label(&self) -> String {
        if self.unit.is_empty() { self.name.clone() } else { format!("{} ({})", self.name, self.unit) }
    }

    /// In words, how much the measurement says of it.
    fn told(&self) -> String {
        let told = match self.left {
            left if left > 0.7 => "hardly tell it",
            left if left > 0.3 => "tell it in part",
            _ => "tell it",
        };
        match self.lean {
            0.0 => told.to_owned(),
            lean => format!("{told}; it leans on its {} bound", if lean > 0.0 { "upper" } else { "lower" }),
        }
    }
}

/// Numbers that a page shows first.
#[derive(Clone, Debug, Serialize)]
pub struct Standing {
    pub iterations: usize,
    pub runs: usize,
    pub failed: usize,
    /// σ over that of the noise; 1 where it has come down to it.
    pub tempering: Option<String>,
    pub best_sample: String,
    pub best_error: String,
    pub ess_runs: String,
    /// Whether the posterior is one of draws through an emulator.
    pub is_drawn: bool,
    /// Whether so few runs hold the weight that intervals are widened.
    pub rests_on_few: bool,
    pub is_done: bool,
}

impl Calibration {
    /// Read what is in its folder.
    ///
    /// # Errors
    /// If no iteration is finished, or a table cannot be read.
    pub fn read(folder: &Path) -> Result<Self> {
        let iterations: Vec<PathBuf> = (0..)
            .map(|i| folder.join(format!("iter{i}")))
            .take_while(|iteration| iteration.join("stop.txt").exists())
            .collect();
        let last =
            iterations.last().with_context(|| format!("{}: no iteration is finished", folder.display()))?;
        let stop = Table::read(&last.join("stop.txt"))?;
        let met = stop.format().column("met")?;
        // Some are only together a reason to stop.
        let part = stop.format().find("part")?;
        let is_part = |row| part.is_some_and(|part| stop.field(row, part) == "yes");
        let is_done = (0..stop.len()).any(|row| stop.field(row, met) == "yes" && !is_part(row));
        let tempered = iterations.iter().map(|iteration| Known::read(iteration.join("summary.txt")));
        Ok(Self {
            folder: folder.to_owned(),
            posterior: Known::read(folder.join("posterior.txt"))?,
            tempered: tempered.collect::<Result<_>>()?,
            verdict: verdict::read_all(&[last.join("stop-verdict.txt"), last.join("posterior-verdict.txt")])?,
            is_drawn: last.join("posterior-runs-weights.txt").exists(),
            is_done,
            iterations,
        })
    }

    /// A file in its folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The weights of its runs, which stand beside the posterior where that is one of draws.
    pub fn weights_of_runs(&self) -> PathBuf {
        self.file(if self.is_drawn { "posterior-runs-weights.txt" } else { "posterior-weights.txt" })
    }

    /// The folder of the last iteration.
    pub fn last(&self) -> &Path {
        &self.iterations[self.iterations.len() - 1]
    }

    /// Names of the parameters that were varied.
    pub fn varied(&self) -> Vec<String> {
        self.posterior.summary.varied().map(|parameter| parameter.name.clone()).collect()
    }

    /// Names of the others: parameters of effects that are off.
    pub fn still(&self) -> Vec<String> {
        let all = self.posterior.summary.parameters.iter();
        all.filter(|parameter| parameter.shrinkage.is_none())
            .map(|parameter| parameter.name.clone())
            .collect()
    }

    /// What is known of each parameter that was varied.
    ///
    /// # Errors
    /// If the summary lacks a quantity.
    pub fn estimates(&self, prior: &Prior) -> Result<Vec<Estimate>> {
        let estimate = |name: String| {
            let known = prior.parameter(&name);
            let of = |quantity: &str| self.posterior.number(&format!("{quantity}({name})"));
            Ok(Estimate {
                unit: known.and_then(|parameter| parameter.unit.clone()).unwrap_or_default(),
                is_log: known.is_some_and(|parameter| parameter.scale == Scale::Log),
                mean: of("mean")?,
                sd: of("sd")?,
                low: of("q05")?,
                high: of("q95")?,
                best: of("best")?,
                left: (1.0 - of("shrinkage")?).max(0.0).sqrt(),
                lean: of("lean")?,
                name,
            })
        };
        self.varied().into_iter().map(estimate).collect()
    }

    /// The posterior as a table.
    ///
    /// # Errors
    /// See [`Calibration::estimates`].
    pub fn posterior(&self, prior: &Prior) -> Result<Grid> {
        let row = |estimate: &Estimate| {
            vec![
                estimate.label(),
                with_sd(estimate.mean, estimate.sd),
                interval(estimate.low, estimate.high, estimate.is_log),
                significant(estimate.best, 4),
                format!("{} %", short(100.0 * estimate.left)),
                estimate.told(),
            ]
        };
        let heads = ["parameter", "mean ± sd", "90 % interval", "best run", "sd, of the prior’s", "the data"];
        Ok(Grid::new(heads, self.estimates(prior)?.iter().map(row).collect()))
    }

    /// How far it has come.
    ///
    /// # Errors
    /// If a summary lacks a quantity.
    pub fn standing(&self) -> Result<Standing> {
        let of = |quantity: &str| self.posterior.number(quantity);
        let last = &self.tempered[self.tempered.len() - 1];
        let ratio = last.number("sigma")? / last.number("sigma_noise")?;
        let ess_runs = of("ess_runs")?;
        Ok(Standing {
            iterations: self.iterations.len(),
            runs: of("runs")? as usize + of("failed")? as usize,
            failed: of("failed")? as usize,
            // Draws are those of the noise; what the emulator does not know is a verdict of its own.
            tempering: (!self.is_drawn && ratio > 1.0 + 1e-7).then(|| short(ratio)),
            best_sample: self.posterior.summary.best_sample.clone().unwrap_or_else(|| "-".to_owned()),
            best_error: short(100.0 * of("best_error")?),
            ess_runs: short(ess_runs),
            is_drawn: self.is_drawn,
            rests_on_few: self.posterior.summary.few_runs().is_some(),
            is_done: self.is_done,
        })
    }

    /// A row an iteration.
    ///
    /// # Errors
    /// If a summary lacks a quantity.
    pub fn course(&self) -> Result<Grid> {
        const QUANTITIES: [(&str, &str); 7] = [
            ("runs", "runs so far"),
            ("failed", "failed"),
            ("sigma", "sigma"),
            ("sigma_noise", "noise"),
            ("ess_runs", "effective runs"),
            ("ensemble_error", "mean error"),
            ("best_error", "best error"),
        ];
        let row = |(i, summary): (usize, &Known)| {
            let mut row = vec![i.to_string()];
            for (quantity, _) in QUANTITIES {
                row.push(significant(summary.number(quantity)?, 4));
            }
            Ok(row)
        };
        let rows = self.tempered.iter().enumerate().map(row).collect::<Result<Vec<_>>>()?;
        Ok(Grid::new(["iteration"].into_iter().chain(QUANTITIES.map(|(_, head)| head)), rows))
    }

    /// What ended it.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn criteria(&self) -> Result<Grid> {
        Grid::read(&self.last().join("stop.txt"), usize::MAX)
    }
}

/// Parameters before and after the effect was put in, side by side.
///
/// # Errors
/// If a summary lacks a quantity.
pub fn side_by_side(before: &Calibration, after: &Calibration, prior: &Prior, with: &str) -> Result<Grid> {
    let (before, after) = (before.estimates(prior)?, after.estimates(prior)?);
    let row = |estimate: &Estimate| {
        let old = before.iter().find(|old| old.name == estimate.name);
        let shift = old.map(|old| (estimate.mean - old.mean) / old.sd.hypot(estimate.sd));
        vec![
            estimate.label(),
            old.map_or("off".to_owned(), |old| with_sd(old.mean, old.sd)),
            with_sd(estimate.mean, estimate.sd),
            old.map_or("-".to_owned(), |old| interval(old.low, old.high, old.is_log)),
            interval(estimate.low, estimate.high, estimate.is_log),
            shift
                .filter(|shift| shift.is_finite())
                .map_or("-".to_owned(), |shift| format!("{} sd", short(shift))),
        ]
    };
    ensure!(!after.is_empty(), "no parameter was varied");
    let heads = [
        "parameter".to_owned(),
        "before".to_owned(),
        format!("with {with}"),
        "90 % interval before".to_owned(),
        format!("90 % interval with {with}"),
        "moved by".to_owned(),
    ];
    Ok(Grid::new(heads, after.iter().map(row).collect()))
}
