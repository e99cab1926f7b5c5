//! The tables that pictures are made of, as far as the library does not read them.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use gl_inference::observations::ByName;
use gl_inference::prior::{Parameter, Prior, Scale};
use gl_inference::summary::Summary;
use gl_inference::weights::Weights;
use gl_numeric::statistics::{Quantiles, mean, shortest_interval};

use gl_figure::axis::{Label, SMALL, Span};
use gl_figure::{font, number};

/// Read a weights table that a picture can be made of: samples with their parameters.
///
/// # Errors
/// If it cannot be read, or has no parameters.
pub fn read_weights(path: &Path) -> Result<Weights> {
    with_parameters(Weights::read(path)?)
}

/// The same at every step that the table has, with these steps.
///
/// # Errors
/// See [`read_weights`].
pub fn read_step_weights(path: &Path) -> Result<Vec<(Option<f64>, Weights)>> {
    let steps = Weights::read_steps(path)?;
    steps.into_iter().map(|(step, weights)| Ok((step, with_parameters(weights)?))).collect()
}

/// The most panels of a picture: a page of them is some ten.
const MOST_PANELS: usize = 500;

/// Refuse a picture of so many panels that nobody could look at them.
///
/// # Errors
/// If there are too many.
pub fn check_panels(source: &str, count: usize) -> Result<()> {
    ensure!(
        count <= MOST_PANELS,
        "{source}: a picture of {count} panels, but it can have {MOST_PANELS}; draw fewer columns at a time"
    );
    Ok(())
}

fn with_parameters(weights: Weights) -> Result<Weights> {
    check_panels(&weights.source, weights.parameters.len())?;
    ensure!(
        !weights.parameters.is_empty(),
        "{}:1: no parameters; a column for each is needed beside sample and weight",
        weights.source
    );
    Ok(weights)
}

/// Without the parameters that stand still, such as those of effects that are off; all where none moves.
pub fn moving(weights: Weights) -> Weights {
    let moves = which_move(&[&weights]);
    only(weights, &moves)
}

/// The parameters that differ between the samples of one of these tables; all where none does.
pub fn which_move(tables: &[&Weights]) -> Vec<usize> {
    let all = 0..tables.first().map_or(0, |table| table.parameters.len());
    let differs =
        |j: &usize| tables.iter().any(|table| table.values.iter().any(|row| row[*j] != table.values[0][*j]));
    let moves: Vec<usize> = all.clone().filter(differs).collect();
    if moves.is_empty() { all.collect() } else { moves }
}

/// The same samples with these parameters only.
pub fn only(mut weights: Weights, parameters: &[usize]) -> Weights {
    weights.parameters = parameters.iter().map(|&j| weights.parameters[j].clone()).collect();
    for row in &mut weights.values {
        *row = parameters.iter().map(|&j| row[j]).collect();
    }
    weights
}

/// What is known of one parameter.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: f64,
    /// Ends of the 90 % interval.
    pub low: f64,
    pub high: f64,
    /// Whether that is the shortest one, which leaves out more on one side than on the other.
    pub is_shortest: bool,
    /// Whether the scale of the parameter is logarithmic.
    pub is_log: bool,
}

/// The shortest interval is taken where it is shorter than the one with 5 % on either side by this.
const SKEWED: f64 = 0.1;
/// Of fewer effective samples the shortest interval is one that chance made short.
const ENOUGH_FOR_SHORTEST: f64 = 200.0;

impl Estimate {
    /// What a summary says, which allows for few runs, else what weights say. Where they are skewed and many, the
    /// interval is the shortest one, along the scale of the parameter.
    ///
    /// # Errors
    /// If the summary lacks the parameter.
    pub fn of(
        summary: Option<&Summary>,
        (name, is_log): (&str, bool),
        values: &[f64],
        weights: &[f64],
    ) -> Result<Self> {
        let quantiles = Quantiles::new(values, weights);
        let even = Self {
            mean: mean(values, weights),
            low: quantiles.at(0.05),
            high: quantiles.at(0.95),
            is_shortest: false,
            is_log,
        };
        let is_enough =
            weights.iter().map(|weight| weight * weight).sum::<f64>() * ENOUGH_FOR_SHORTEST <= 1.0;
        let shortest = if is_enough { even.shortest(values, weights) } else { None };
        let Some(summary) = summary else { return Ok(shortest.unwrap_or(even)) };
        let number = |kind: &str| {
            let quantity = format!("{kind}({name})");
            summary.quantity(&quantity).with_context(|| format!("--summary: no quantity {quantity}"))
        };
        let (mean, low, high) = (number("mean")?, number("q05")?, number("q95")?);
        Ok(shortest.map_or(Self { mean, low, high, ..even }, |shortest| Self { mean, ..shortest }))
    }

    /// With the shortest interval, if the weights are skewed.
    fn shortest(&self, values: &[f64], weights: &[f64]) -> Option<Self> {
        let scale = |value: f64| if self.is_log { value.ln() } else { value };
        let back = |place: f64| if self.is_log { place.exp() } else { place };
        let places: Vec<f64> = values.iter().copied().map(scale).collect();
        let (low, high) = shortest_interval(&places, weights, 0.9);
        let is_skewed = high - low < (1.0 - SKEWED) * (scale(self.high) - scale(self.low));
        is_skewed.then(|| Self { low: back(low), high: back(high), is_shortest: true, ..*self })
    }

    /// As a heading of at most so many points.
    pub fn heading(&self, width: f64) -> String {
        number::estimate(self.mean, (self.low, self.high), self.is_log, |text| {
            font::width(text, SMALL) <= width
        })
    }
}

/// The values of a parameter, shape (samples,).
pub fn column(weights: &Weights, parameter: usize) -> Vec<f64> {
    weights.values.iter().map(|row| row[parameter]).collect()
}

/// The samples from the lightest to the heaviest, so that those that count are drawn last.
pub fn lightest_first(weight: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..weight.len()).collect();
    order.sort_by(|&a, &b| weight[a].total_cmp(&weight[b]));
    order
}

/// The name of a table without its folder and ending.
pub fn stem(path: &Path) -> String {
    if path == Path::new("-") {
        return "stdin".to_owned();
    }
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// What is known about the parameters from `params.txt`: scales, bounds and units.
#[derive(Clone, Debug, Default)]
pub struct Parameters(Vec<Parameter>);

impl Parameters {
    /// Read the table, or know nothing where there is none.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: Option<&Path>) -> Result<Self> {
        Ok(Self(path.map(Prior::read).transpose()?.map_or(Vec::new(), |prior| prior.parameters().to_vec())))
    }

    pub fn get(&self, name: &str) -> Option<&Parameter> {
        self.0.iter().find(|parameter| parameter.name == name)
    }

    pub fn label(&self, name: &str) -> Label {
        Label { name: name.to_owned(), unit: self.get(name).and_then(|parameter| parameter.unit.clone()) }
    }

    /// Where samples of this parameter can be, as far as the axis shows it: between its bounds, or
    /// anywhere where there are none or some values lie beyond them.
    pub fn support(&self, name: &str, span: Span, values: &[f64]) -> Span {
        match self.get(name) {
            Some(known) if values.iter().all(|value| (known.lower..=known.upper).contains(value)) => {
                Span { low: known.lower.max(span.low), high: known.upper.min(span.high), ..span }
            }
            _ => span,
        }
    }

    /// What an axis of this parameter has to show: its values, and its bounds where they are known.
    pub fn span(&self, name: &str, values: &[f64]) -> Span {
        let span = Span::of(values.iter().copied());
        match self.get(name) {
            Some(parameter) => {
                let span = span.with(parameter.lower).with(parameter.upper);
                if parameter.scale == Scale::Log { span.logarithmic() } else { span }
            }
            None => span,
        }
        .padded(0.04)
    }
}

impl Parameters {
    /// What an axis of this parameter has to show of a posterior seen closely: nearly all of its weight.
    pub fn close_span(&self, name: &str, values: &[f64], weights: &[f64]) -> Span {
        let quantiles = Quantiles::new(values, weights);
        let span = Span::of([quantiles.at(0.002), quantiles.at(0.998)]);
        if self.is_log(name) { span.logarithmic() } else { span }.padded(0.25)
    }

    /// Whether the scale of this parameter is logarithmic.
    pub fn is_log(&self, name: &str) -> bool {
        self.get(name).is_some_and(|parameter| parameter.scale == Scale::Log)
    }
}

/// Place of a value within a support, if it is there.
pub fn place_within(support: Span, value: f64) -> Option<f64> {
    let place = support.place(value);
    // Bounds are met up to rounding only.
    (-1e-9..=1.0 + 1e-9).contains(&place).then(|| place.clamp(0.0, 1.0))
}

/// Places and weights of the samples within a support.
pub fn within(support: Span, values: &[f64], weights: &[f64]) -> (Vec<f64>, Vec<f64>) {
    values.iter().zip(weights).filter_map(|(&x, &weight)| Some((place_within(support, x)?, weight))).unzip()
}

/// The truth where a picture can show it; every name must be a parameter.
///
/// # Errors
/// If one is not.
pub fn check_truth(truth: &ByName, parameters: &[String]) -> Result<()> {
    if let Some(name) = truth.not_among(parameters) {
        bail!("--truth {name}: no such parameter; they are {}", parameters.join(", "));
    }
    Ok(())
}
