//! What may vary: the parameters, their prior distributions and the effects they belong to.

use std::fmt;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use gl_numeric::normal::Truncated;
pub use gl_numeric::normal::{normal_cdf, normal_quantile};
use gl_table::{LARGEST, Table, TableWriter, push_number};
use serde::Deserialize;

use crate::samples::check_parameter_name;

/// How a parameter is spread between its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Evenly in the value.
    Linear,
    /// Evenly in the natural logarithm of the value.
    Log,
}

impl Scale {
    /// A value on this scale: its natural logarithm for [`Scale::Log`].
    pub fn forward(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log => value.ln(),
        }
    }

    /// The value at a place on this scale.
    pub fn back(self, place: f64) -> f64 {
        match self {
            Self::Linear => place,
            Self::Log => place.exp(),
        }
    }
}

/// One parameter: its bounds, its prior, and the effect it belongs to.
///
/// The prior is uniform between the bounds (in the logarithm, for [`Scale::Log`]), or a normal
/// distribution truncated to them, whose mean and standard deviation are those of the value
/// (of its natural logarithm, for [`Scale::Log`]) before truncation.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name of the column that holds it.
    pub name: String,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound, above the lower one.
    pub upper: f64,
    /// Whether it is spread evenly in the value or in its logarithm.
    pub scale: Scale,
    /// Mean and standard deviation of a truncated normal prior; uniform if absent.
    pub normal: Option<(f64, f64)>,
    /// Name of the effect that it belongs to; absent for the base model.
    pub effect: Option<String>,
    /// The value at which the effect is absent; it may lie outside the bounds.
    pub off: Option<f64>,
    /// Unit, for axis labels.
    pub unit: Option<String>,
}

/// The parameters of a calibration, with their priors, independent of each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    parameters: Vec<Parameter>,
}

/// An effect that the base model lacks: a name and the parameters that come with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Effect {
    /// Its name.
    pub name: String,
    /// Its parameters, as positions in [`Prior::parameters`].
    pub parameters: Vec<usize>,
}

/// One row of a `params.txt`, as it is written.
#[derive(Deserialize)]
struct Row {
    name: String,
    lower: f64,
    upper: f64,
    scale: Option<String>,
    mean: Option<f64>,
    sd: Option<f64>,
    effect: Option<String>,
    off: Option<f64>,
    unit: Option<String>,
}

impl Row {
    /// The parameter, or the column that is wrong and what is.
    fn parameter(self) -> Result<Parameter, (&'static str, String)> {
        check_parameter_name(&self.name).map_err(|problem| ("name", problem))?;
        let (scale, normal) = (self.scale()?, self.normal()?);
        self.check_size()?;
        let Self { name, lower, upper, effect, off, unit, .. } = self;
        if let Some(effect) = &effect {
            check_effect_name(effect).map_err(|problem| ("effect", problem))?;
            if off.is_none() {
                return Err((
                    "off",
                    format!("give the value of {name} at which the effect {effect} is absent"),
                ));
            }
        }
        let off = effect.as_ref().and(off);
        let parameter = Parameter { name, lower, upper, scale, normal, effect, off, unit };
        if parameter.truncated().is_some_and(|truncated| !truncated.ln_mass().is_finite()) {
            let name = parameter.name;
            return Err((
                "mean",
                format!(
                    "the bounds of {name} lie so far out in its normal distribution that nothing is left between them"
                ),
            ));
        }
        Ok(parameter)
    }

    fn scale(&self) -> Result<Scale, (&'static str, String)> {
        let Self { name, lower, upper, .. } = self;
        let scale = match self.scale.as_deref() {
            None | Some("linear") => Scale::Linear,
            Some("log") => Scale::Log,
            Some(other) => return Err(("scale", format!("{other:?} is neither linear nor log"))),
        };
        if lower >= upper {
            return Err(("upper", format!("{upper} is not above the lower bound {lower} of {name}")));
        }
        if !(upper - lower).is_finite() {
            return Err((
                "upper",
                format!(
                    "{upper:e} lies further from {lower:e} than a number can say; bring the bounds of {name} closer"
                ),
            ));
        }
        if scale == Scale::Log && *lower <= 0.0 {
            return Err((
                "lower",
                format!("{lower}, but on a log scale the bounds of {name} must be positive"),
            ));
        }
        Ok(scale)
    }

    fn check_size(&self) -> Result<(), (&'static str, String)> {
        let columns = [
            ("lower", Some(self.lower)),
            ("upper", Some(self.upper)),
            ("mean", self.mean),
            ("sd", self.sd),
            ("off", self.off),
        ];
        let large = columns.into_iter().find(|(_, value)| value.is_some_and(|value| value.abs() > LARGEST));
        large.map_or(Ok(()), |(column, value)| {
            let value = value.unwrap_or_default();
            Err((column, format!("{value:e} is too large to calculate with; stay below {LARGEST:e}")))
        })
    }

    fn normal(&self) -> Result<Option<(f64, f64)>, (&'static str, String)> {
        match (self.mean, self.sd) {
            (None, None) => Ok(None),
            (Some(mean), Some(sd)) if sd > 0.0 => Ok(Some((mean, sd))),
            (Some(_), Some(sd)) => Err(("sd", format!("{sd} is not positive"))),
            (Some(_), None) => Err(("sd", format!("{} has a mean but no sd", self.name))),
            (None, Some(_)) => Err(("mean", format!("{} has an sd but no mean", self.name))),
        }
    }
}

const COLUMNS: [&str; 9] = ["name", "lower", "upper", "scale", "mean", "sd", "effect", "off", "unit"];

/// The most parameters that a table may have.
const MOST: usize = 1000;

impl Prior {
    /// A value of each parameter with every effect off; those of the base stand at their lower bound.
    pub fn with_effects_off(&self) -> Vec<f64> {
        self.parameters().iter().map(|p| p.off.unwrap_or(p.lower)).collect()
    }

    /// Read a `params.txt`: `name lower upper`, and optionally `scale mean sd effect off unit`, where
    /// `-` stands for nothing.
    ///
    /// # Errors
    /// If the table cannot be read, holds a column that means nothing here, or a parameter is no
    /// parameter (bounds not in order, an effect without its `off` value, …).
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_table(&Table::read(path)?)
    }

    /// The parameters from a table that was read already; see [`Prior::read`].
    ///
    /// # Errors
    /// See [`Prior::read`].
    pub fn from_table(table: &Table) -> Result<Self> {
        let source = table.format().source();
        for column in table.format().columns() {
            ensure!(
                COLUMNS.contains(&column.as_str()),
                "{source}:1: unknown column {column}; a table of parameters has {}",
                COLUMNS.join(", ")
            );
        }
        let rows: Vec<Row> = table.rows()?;
        ensure!(!rows.is_empty(), "{source}: no parameters; add a row for each that may vary");
        ensure!(
            rows.len() <= MOST,
            "{source}: {} parameters, but {MOST} are the most that runs can tell apart; leave out those that stand still",
            rows.len()
        );
        let mut parameters: Vec<Parameter> = Vec::new();
        for (place, row) in rows.into_iter().enumerate() {
            if parameters.iter().any(|parameter| parameter.name == row.name) {
                return table.fail(place, "name", format_args!("duplicate {}", row.name));
            }
            match row.parameter() {
                Ok(parameter) => parameters.push(parameter),
                Err((column, problem)) => return table.fail(place, column, problem),
            }
        }
        Ok(Self { parameters })
    }

    /// The prior of these parameters, which must have been checked.
    pub fn new(parameters: Vec<Parameter>) -> Self {
        Self { parameters }
    }

    /// Write the table of parameters, with the optional columns that any of them needs.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        type Text = fn(&Parameter) -> Option<String>;
        fn text(value: f64) -> String {
            let mut text = Vec::new();
            push_number(&mut text, value);
            String::from_utf8_lossy(&text).into_owned()
        }
        let optional: [(&str, Text); 6] = [
            ("scale", |p| (p.scale == Scale::Log).then(|| p.scale.to_string())),
            ("mean", |p| p.normal.map(|(mean, _)| text(mean))),
            ("sd", |p| p.normal.map(|(_, sd)| text(sd))),
            ("effect", |p| p.effect.clone()),
            ("off", |p| p.off.map(text)),
            ("unit", |p| p.unit.clone()),
        ];
        let is_needed = |(_, of): &&(&str, Text)| self.parameters.iter().any(|p| of(p).is_some());
        let optional: Vec<&(&str, Text)> = optional.iter().filter(is_needed).collect();
        let columns = ["name", "lower", "upper"].into_iter().chain(optional.iter().map(|(name, _)| *name));
        let mut table = TableWriter::create(path, &columns.collect::<Vec<_>>())?;
        for parameter in &self.parameters {
            table.text(&parameter.name).numbers(&[parameter.lower, parameter.upper]);
            for (_, of) in &optional {
                table.text(&of(parameter).unwrap_or_default());
            }
            table.end_row()?;
        }
        table.finish()
    }

    /// All parameters, in the order of the table.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The parameter of a name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// Names of all parameters.
    pub fn names(&self) -> Vec<String> {
        self.parameters.iter().map(|parameter| parameter.name.clone()).collect()
    }

    /// Positions of the parameters of the base model.
    pub fn base(&self) -> Vec<usize> {
        (0..self.parameters.len()).filter(|&j| self.parameters[j].effect.is_none()).collect()
    }

    /// The effects, in order of first appearance.
    pub fn effects(&self) -> Vec<Effect> {
        let mut effects: Vec<Effect> = Vec::new();
        for (j, parameter) in self.parameters.iter().enumerate() {
            let Some(name) = &parameter.effect else { continue };
            match effects.iter_mut().find(|effect| effect.name == *name) {
                Some(effect) => effect.parameters.push(j),
                None => effects.push(Effect { name: name.clone(), parameters: vec![j] }),
            }
        }
        effects
    }

    /// Whether an effect is at work in a sample, shape (parameters,): one of its parameters is not at `off`.
    pub fn is_on(&self, effect: &Effect, values: &[f64]) -> bool {
        effect.parameters.iter().any(|&j| !self.parameters[j].is_off(values[j]))
    }

    /// Effects by name, in the order of the table.
    ///
    /// # Errors
    /// If a name is not an effect's.
    pub fn select_effects(&self, names: &[String]) -> Result<Vec<Effect>> {
        let effects = self.effects();
        for name in names {
            if !effects.iter().any(|effect| effect.name == *name) {
                let known: Vec<_> = effects.iter().map(|effect| effect.name.as_str()).collect();
                bail!(
                    "no parameter belongs to an effect {name}; {}",
                    if known.is_empty() {
                        "the table has no effects".to_owned()
                    } else {
                        format!("the effects are {}", known.join(", "))
                    }
                );
            }
        }
        Ok(effects.into_iter().filter(|effect| names.contains(&effect.name)).collect())
    }
}

fn check_effect_name(name: &str) -> Result<(), String> {
    if matches!(name, "none" | "unexplained" | "switch" | "pairs" | "rig")
        || !name.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c))
    {
        return Err(format!(
            "{name:?} is no effect name; use letters, digits, `_`, `-` and `.`, and not none, pairs, rig, switch or unexplained"
        ));
    }
    Ok(())
}

impl Parameter {
    /// Whether its effect is absent at a value.
    pub fn is_off(&self, value: f64) -> bool {
        self.off.is_some_and(|off| (value - off).abs() <= 1e-9 * off.abs())
    }

    /// The value below which the prior holds the share `u` in [0, 1] of its probability.
    pub fn quantile(&self, u: f64) -> f64 {
        let (low, high) = self.scaled_bounds();
        let value = match (self.normal, self.truncated()) {
            (Some((mean, sd)), Some(truncated)) => mean + sd * truncated.quantile(u),
            _ => low + u * (high - low),
        };
        let value = match self.scale {
            Scale::Linear => value,
            Scale::Log => value.exp(),
        };
        value.clamp(self.lower, self.upper)
    }

    /// The place of a value between the bounds on the parameter's own scale: 0 at the lower bound,
    /// 1 at the upper one, outside [0, 1] beyond them. A value ≤ 0 on a log scale, which only an
    /// `off` value can be, stands one range below the lower bound, at −1.
    ///
    /// # Examples
    /// ```
    /// use gl_inference::prior::Prior;
    /// use gl_table::Table;
    ///
    /// let table = Table::parse("params.txt", b"name lower upper scale\nE 1e6 1e10 log\n".to_vec())?;
    /// let prior = Prior::from_table(&table)?;
    /// let place = prior.parameters()[0].coordinate(1e9);
    /// assert!((place - 0.75).abs() < 1e-12);
    /// # Ok::<(), anyhow::Error>(())
    /// ```
    pub fn coordinate(&self, value: f64) -> f64 {
        let (low, high) = self.scaled_bounds();
        match self.scale {
            Scale::Linear => (value - low) / (high - low),
            Scale::Log if value > 0.0 => (value.ln() - low) / (high - low),
            Scale::Log => -1.0,
        }
    }

    /// The value at a coordinate in [0, 1]; see [`Parameter::coordinate`].
    pub fn at_coordinate(&self, z: f64) -> f64 {
        let (low, high) = self.scaled_bounds();
        let value = low + z * (high - low);
        match self.scale {
            Scale::Linear => value,
            Scale::Log => value.exp(),
        }
        .clamp(self.lower, self.upper)
    }

    /// Natural logarithm of the prior density at a coordinate, per unit of coordinate; −∞ outside
    /// [0, 1].
    pub fn ln_density(&self, z: f64) -> f64 {
        if !(0.0..=1.0).contains(&z) {
            return f64::NEG_INFINITY;
        }
        let (Some((mean, sd)), Some(truncated)) = (self.normal, self.truncated()) else { return 0.0 };
        let (low, high) = self.scaled_bounds();
        let standard = (low + z * (high - low) - mean) / sd;
        -0.5 * standard * standard - 0.5 * std::f64::consts::TAU.ln() + ((high - low) / sd).ln()
            - truncated.ln_mass()
    }

    /// Standard deviation of the prior, in the parameter's own unit.
    pub fn sd(&self) -> f64 {
        // By midpoints: exact enough for what it decides, and the same for every prior.
        const POINTS: u32 = 2000;
        let n = f64::from(POINTS);
        let values: Vec<f64> = (0..POINTS).map(|i| self.quantile((f64::from(i) + 0.5) / n)).collect();
        gl_numeric::statistics::sd(&values, &vec![1.0 / n; values.len()])
    }

    /// The bounds on the parameter's own scale.
    pub fn scaled_bounds(&self) -> (f64, f64) {
        match self.scale {
            Scale::Linear => (self.lower, self.upper),
            Scale::Log => (self.lower.ln(), self.upper.ln()),
        }
    }

    /// The normal prior in standard deviations from its mean.
    fn truncated(&self) -> Option<Truncated> {
        let (mean, sd) = self.normal?;
        let (low, high) = self.scaled_bounds();
        Some(Truncated::new((low - mean) / sd, (high - mean) / sd))
    }
}

impl fmt::Display for Scale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear",
            Self::Log => "log",
        })
    }
}
