//! The question that every hypothesis answers: a measurement, and a simulation to explain it by.
//!
//! * What may explain it: [`hypothesis`], the candidates and their sets; [`measurement`], errors of the rig as candidates,
//!   which transform a curve along the control's [`path`](gl_inference::path) and are each of one [`test`](mod@test); [`belief`], what was believed of
//!   parameters whose bounds were made wider.
//! * What predicts: [`predictor`], curves at any parameters; [`simulation`], those of a design's runs.
//! * What is left: the covariance of the readings, which [`gaussian`] factors, with its smooth part by [`discrepancy`].

pub mod belief;
pub mod discrepancy;
pub mod gaussian;
pub mod hypothesis;
pub mod measurement;
pub mod predictor;
pub mod simulation;
pub mod test;

use std::ops::Range;

use anyhow::{Context, Result, ensure};
use nalgebra::{Cholesky, DMatrix, DVector};

use crate::attribute::evidence::model::Singular;
use crate::attribute::problem::belief::Belief;
use crate::attribute::problem::discrepancy::Smooth;
use crate::attribute::problem::gaussian::{Filled, Level, Patterns};
use crate::attribute::problem::hypothesis::Candidate;
use crate::attribute::problem::measurement::MeasurementEffect;
use crate::attribute::problem::predictor::Predictor;
use crate::attribute::problem::test::Test;
use crate::noise::scale;
use gl_inference::observations::Observations;
use gl_inference::path::short;
use gl_inference::prior::Prior;
use gl_inference::rig::Kind;
use gl_inference::units::Units;

/// What all hypotheses share.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The simulation at any parameters; its points are coordinates of all parameters of the prior.
    pub predictor: &'a dyn Predictor,
    /// The parameters and their prior.
    pub prior: &'a Prior,
    /// What was believed of each parameter before its bounds were made wider, shape (parameters,).
    pub beliefs: Vec<Option<Belief>>,
    /// What may explain the gap.
    pub candidates: Vec<Candidate>,
    /// What was measured, shape (readings,).
    pub observed: Vec<f64>,
    /// Range of each observable, shape (observables,).
    pub ranges: Vec<f64>,
    /// Names of the observables.
    pub observables: Vec<String>,
    /// Their units, where they are known.
    observable_units: Vec<Option<String>>,
    /// The tests, each with its control.
    pub tests: Vec<Test>,
    /// Whether a noise is stated, or else is estimated with the fit.
    pub is_noise_stated: bool,
    /// The unit of the noise of every reading, shape (readings,): the stated standard deviation,
    /// or the range of the observable.
    pub units: Vec<f64>,
    /// Share of the simulation's own scatter that the measurement has too.
    pub scatter: f64,
    /// Variance of each component by the simulation's scatter.
    component_scatter: Vec<f64>,
    /// Lower factor of the correlation of the components' errors.
    correlation: DMatrix<f64>,
    /// Test of each observable, shape (observables,), and observable of each reading, shape (readings,).
    test_of: Vec<usize>,
    observable_of: Vec<usize>,
    /// All patterns of the covariance: the predictor's, and the smooth ones of each observable.
    patterns: DMatrix<f64>,
    /// The same with what they have in common with the noise.
    covariance: Patterns,
    /// Mean variance of what the components leave out of each observable, in units of the noise's.
    left_over: Vec<f64>,
    /// Mean variance of an observable from the simulation's scatter, times its share.
    scatter_variance: Vec<f64>,
    /// A factor of the covariance of the measured specimen's scatter, shape (readings, components).
    scatter_patterns: DMatrix<f64>,
}

/// The smooth discrepancy that every hypothesis is granted, as a share of noise and scatter: no
/// model is exact.
const SMALL: f64 = 0.15;

/// What the emulator's variance is multiplied by: its errors, left one out, have heavier tails than
/// the normal distribution.
pub(crate) const HEAVY_TAILS: f64 = 2.0;

impl<'a> Problem<'a> {
    /// The question of one test.
    ///
    /// * `noise` — standard deviations as stated, shape (observables, steps), or nothing to estimate them.
    /// * `scatter` — share of the simulation's scatter that the measurement has, not negative.
    ///
    /// # Errors
    /// If the predictor has curves of another length, an observable is constant, or a noise is not
    /// positive.
    pub fn new(
        predictor: &'a dyn Predictor,
        prior: &'a Prior,
        candidates: Vec<Candidate>,
        observations: &Observations,
        noise: Option<Vec<Vec<f64>>>,
        scatter: f64,
    ) -> Result<Self> {
        Self::of_tests(predictor, prior, candidates, (observations, Test::of(observations)), noise, scatter)
    }

    /// The same of several tests; the observations are those of all, as in a [`Stack`](gl_inference::stack::Stack).
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_tests(
        predictor: &'a dyn Predictor,
        prior: &'a Prior,
        candidates: Vec<Candidate>,
        (observations, tests): (&Observations, Vec<Test>),
        noise: Option<Vec<Vec<f64>>>,
        scatter: f64,
    ) -> Result<Self> {
        let readings = tests.last().map_or(0, |test| test.readings.end);
        ensure!(
            predictor.readings() == readings,
            "{}: {readings} readings, but the simulation gives {}",
            observations.source,
            predictor.readings()
        );
        ensure!(scatter >= 0.0, "--scatter {scatter}: give a share of at least 0");
        let ranges = ranges(observations, &tests)?;
        let noise: Option<Vec<f64>> = noise.map(|noise| noise.concat());
        ensure!(
            noise.iter().flatten().all(|&sd| sd > 0.0),
            "{}: a noise of zero; give its standard deviation with --noise",
            observations.source
        );
        let test_of: Vec<usize> =
            tests.iter().enumerate().flat_map(|(k, test)| vec![k; test.observables.len()]).collect();
        let own: Vec<Range<usize>> =
            test_of.iter().enumerate().map(|(j, &test)| tests[test].own(j)).collect();
        let observable_of = own.iter().enumerate().flat_map(|(j, own)| vec![j; own.len()]).collect();
        let component_scatter = predictor.scatter();
        let correlation = Cholesky::new(predictor.correlation())
            .context("the correlation of the components' errors is not positive definite")?
            .unpack();
        let smooth: Vec<&Smooth> = test_of.iter().map(|&test| &tests[test].smooth).collect();
        let patterns = beside(predictor.basis(), &own, &smooth);
        let scattered = correlated(predictor, &component_scatter, &correlation);
        let scatter_variance = own
            .iter()
            .map(|own| scatter * scattered.rows(own.start, own.len()).norm_squared() / own.len() as f64)
            .collect();
        let measured: Vec<f64> = component_scatter.iter().map(|tau| scatter * tau).collect();
        let scatter_patterns = correlated(predictor, &measured, &correlation);
        let is_noise_stated = noise.is_some();
        let units = noise.unwrap_or_else(|| {
            own.iter().zip(&ranges).flat_map(|(own, &range)| vec![range; own.len()]).collect()
        });
        let covariance = Patterns::new(&units, &own, &patterns, &correlation);
        let left_over = own
            .iter()
            .map(|own| {
                let rest: f64 = predictor.left_over()[own.clone()].iter().sum();
                HEAVY_TAILS * rest / units[own.clone()].iter().map(|unit| unit * unit).sum::<f64>()
            })
            .collect();
        Ok(Self {
            predictor,
            prior,
            beliefs: vec![None; prior.parameters().len()],
            candidates,
            observed: observations.values.concat(),
            ranges,
            observables: observations.names.clone(),
            observable_units: vec![None; observations.names.len()],
            tests,
            is_noise_stated,
            units,
            scatter,
            test_of,
            observable_of,
            component_scatter,
            correlation,
            patterns,
            covariance,
            left_over,
            scatter_variance,
            scatter_patterns,
        })
    }

    /// The test of an observable.
    pub fn test_of(&self, observable: usize) -> &Test {
        &self.tests[self.test_of[observable]]
    }

    /// The observable of a reading.
    pub fn observable_of(&self, reading: usize) -> usize {
        self.observable_of[reading]
    }

    /// The readings of an observable.
    pub fn own(&self, observable: usize) -> Range<usize> {
        self.test_of(observable).own(observable)
    }

    /// Steps of an observable in words: its name, and where they are on its control.
    pub fn told(&self, observable: usize, steps: &Range<usize>) -> String {
        format!("{} {}", self.observables[observable], self.told_steps(observable, steps))
    }

    /// Steps of an observable in words: where they are on its control.
    pub fn told_steps(&self, observable: usize, steps: &Range<usize>) -> String {
        let test = self.test_of(observable);
        test.path.told(&test.control_name, test.control_unit.as_deref(), steps)
    }

    /// The unit of an observable behind a number, where it is known.
    pub fn told_unit(&self, observable: usize) -> String {
        behind(self.observable_units[observable].as_deref())
    }

    /// Apply an error of the measurement at a size to a curve, shape (readings,).
    pub fn apply(&self, effect: &MeasurementEffect, size: f64, curve: &mut [f64]) {
        let test = &self.tests[effect.test];
        let ranges = &self.ranges[test.observables.clone()];
        effect.apply(size, &test.path, ranges, &mut curve[test.readings.clone()]);
    }

    /// How large an error of the measurement is, in words: what it makes of an observable or of the control, in its unit.
    ///
    /// * `size` — its mean and its standard deviation, in the units of its kind.
    pub fn told_size(&self, effect: &MeasurementEffect, size: (f64, f64)) -> String {
        let (times, unit) = self.told_in(effect);
        format!("{} = {} ± {}{unit}", effect.name, short(times * size.0), short(times * size.1))
    }

    /// What a size of an error of the measurement is told in: how many of it a unit of its kind has, and how it is called behind
    /// a number.
    pub fn told_in(&self, effect: &MeasurementEffect) -> (f64, String) {
        let test = &self.tests[effect.test];
        let observable = test.observables.start + effect.observable;
        let of = self.observable_units[observable].as_deref();
        let of_control = test.control_unit.as_deref();
        let unit = match effect.kind {
            Kind::Offset => self.told_unit(observable),
            Kind::Drift => format!("{} at the end", self.told_unit(observable)),
            Kind::Gain => " %".to_owned(),
            Kind::Lag => format!("{} of {}", behind(of_control), test.control_name),
            Kind::Compliance => {
                of_control.zip(of).map_or_else(String::new, |(way, load)| format!(" {way}/{load}"))
            }
        };
        (if effect.kind == Kind::Gain { 100.0 } else { 1.0 }, unit)
    }

    /// What a size of 1 of an error of the measurement is in the units of its kind.
    pub fn unit_of(&self, effect: &MeasurementEffect) -> f64 {
        let test = &self.tests[effect.test];
        effect.unit(&test.path, &self.ranges[test.observables.clone()])
    }

    /// How much a reading counts in a gap over all of them, in which each observable counts alike: 1 where all have as
    /// many readings.
    pub fn counts(&self, reading: usize) -> f64 {
        let own = self.own(self.observable_of[reading]).len();
        self.observed.len() as f64 / (self.ranges.len() * own) as f64
    }

    /// The readings of each observable.
    pub fn blocks(&self) -> Vec<Range<usize>> {
        (0..self.ranges.len()).map(|j| self.own(j)).collect()
    }

    /// The steps of each observable that are among these readings.
    pub fn by_observable(&self, readings: &[usize]) -> Vec<Vec<usize>> {
        let steps = |own: Range<usize>| {
            readings.iter().filter(|i| own.contains(i)).map(|i| i - own.start).collect::<Vec<_>>()
        };
        self.blocks().into_iter().map(steps).collect()
    }

    /// The same as if this curve had been measured, shape (readings,).
    pub fn aimed_at(&self, curve: Vec<f64>) -> Self {
        Self { observed: curve, ..self.clone() }
    }

    /// The same with the units of columns, for words.
    pub fn in_units(mut self, units: &Units) -> Self {
        for test in &mut self.tests {
            test.control_unit = units.get(&test.control_name).map(str::to_owned);
        }
        // Of several tests they are called by the test and a dot before their names.
        let of = |name: &String| {
            let own = name.rsplit_once('.').and_then(|(_, name)| units.get(name));
            units.get(name).or(own).map(str::to_owned)
        };
        self.observable_units = self.observables.iter().map(of).collect();
        self
    }

    /// The same where the bounds of parameters are wider than was believed: what lies beyond is less likely.
    pub fn believing(mut self, believed: &Prior) -> Self {
        self.beliefs = Belief::all(self.prior, believed);
        self
    }

    /// A factor of the covariance of the emulator's error at the variances of its components, with
    /// what the components leave out, shape (readings, components + readings).
    pub fn emulator_errors(&self, component_variance: &[f64]) -> DMatrix<f64> {
        let variance: Vec<f64> =
            component_variance.iter().map(|variance| HEAVY_TAILS * variance.max(0.0)).collect();
        let rest: Vec<f64> =
            self.predictor.left_over().iter().map(|rest| (HEAVY_TAILS * rest).sqrt()).collect();
        beside_readings(&correlated(self.predictor, &variance, &self.correlation), &rest)
    }

    /// A factor of the covariance of noise and scatter, in the same shape; `scales` are those of the noise, in
    /// its units, shape (observables,).
    pub fn measurement_errors(&self, scales: &[f64]) -> DMatrix<f64> {
        let sd: Vec<f64> =
            self.units.iter().zip(&self.observable_of).map(|(unit, &j)| scales[j] * unit).collect();
        beside_readings(&self.scatter_patterns, &sd)
    }

    /// A factor of the covariance of the scatter, shape (readings, components).
    pub fn scatter_patterns(&self) -> &DMatrix<f64> {
        &self.scatter_patterns
    }

    /// The patterns of the covariance of a model that has more of them than all have: errors of the form of an
    /// effect that adds this to the curve, shape (readings,), readings that are far off, and jumps.
    pub fn patterns_with(&self, added: Option<&[f64]>, singular: &Singular) -> Patterns {
        let Singular { outliers, jumps } = singular;
        let blocks = self.blocks();
        let forms: usize = match added {
            Some(_) => (0..blocks.len()).map(|j| self.test_of(j).form.len()).sum(),
            None => 0,
        };
        let own = self.patterns.ncols();
        let all = own + forms + outliers.len() + jumps.len();
        let mut patterns = DMatrix::zeros(self.observed.len(), all);
        patterns.columns_mut(0, own).copy_from(&self.patterns);
        if let Some(added) = added {
            let mut first = own;
            for (j, block) in blocks.iter().enumerate() {
                let form = &self.test_of(j).form;
                for (t, i) in block.clone().enumerate() {
                    for k in 0..form.len() {
                        patterns[(i, first + k)] = added[i] * form.patterns[(t, k)];
                    }
                }
                first += form.len();
            }
        }
        for (k, &reading) in outliers.iter().enumerate() {
            patterns[(reading, own + forms + k)] = self.units[reading];
        }
        for (k, &first) in jumps.iter().enumerate() {
            for i in first..self.own(self.observable_of[first]).end {
                patterns[(i, own + forms + outliers.len() + k)] = self.units[i];
            }
        }
        Patterns::new(&self.units, &blocks, &patterns, &self.correlation)
    }

    /// Use the covariance at nuisances and the variances of the components; `more` are the patterns of
    /// [`Self::patterns_with`], if there are any, with what is singular.
    ///
    /// # Errors
    /// If the covariance is not finite.
    pub fn with_covariance<T>(
        &self,
        nuisances: &Nuisances,
        component_variance: &[f64],
        more: Option<(&Patterns, &Singular)>,
        visit: impl FnOnce(&Filled<'_>) -> T,
    ) -> Result<T> {
        let mut variances: Vec<f64> = component_variance
            .iter()
            .zip(&self.component_scatter)
            .map(|(variance, scatter)| HEAVY_TAILS * variance.max(0.0) + self.scatter * scatter)
            .collect();
        for j in 0..self.ranges.len() {
            let unit = self.spread(j, &nuisances.scales).powi(2);
            let smooth = &self.test_of(j).smooth;
            let first = variances.len();
            variances.extend(smooth.variances.iter().map(|variance| SMALL * SMALL * unit * variance));
            if let Some(Unknown { amplitudes, length }) = &nuisances.rest {
                let of_rest = smooth.variances_of(*length).map(|own| amplitudes[j].powi(2) * unit * own);
                variances[first..].iter_mut().zip(of_rest).for_each(|(variance, own)| *variance += own);
            }
        }
        if let Some(form) = nuisances.form {
            for j in 0..self.ranges.len() {
                variances
                    .extend(self.test_of(j).form.variances.iter().map(|variance| form * form * variance));
            }
        }
        let of_noise = |j: usize| nuisances.scales[j].powi(2) + self.left_over[j];
        let singular = more.into_iter().flat_map(|(_, of)| of.outliers.iter().chain(&of.jumps));
        variances
            .extend(singular.map(|i| self.variance_of_singular(self.observable_of[*i], &nuisances.scales)));
        let levels: Vec<Level> = nuisances
            .phi
            .iter()
            .enumerate()
            .map(|(j, &phi)| Level {
                variance: of_noise(j),
                phi: if self.own(j).len() > 1 { phi } else { 0.0 },
            })
            .collect();
        let patterns = more.map_or(&self.covariance, |(patterns, _)| patterns);
        Ok(visit(&patterns.fill(&levels, &variances)?))
    }

    /// Variance of a reading that is far off, and of a jump, in units of the observable's noise; `scales` are those of the
    /// noise.
    pub fn variance_of_singular(&self, observable: usize, scales: &[f64]) -> f64 {
        FAR_OFF * FAR_OFF * (scales[observable].powi(2) + self.left_over[observable])
    }

    /// Root-mean-square of noise and scatter of an observable; `scales` are those of the noise, in its units.
    pub fn spread(&self, observable: usize, scales: &[f64]) -> f64 {
        (self.noise_variance(observable, scales[observable]) + self.scatter_variance[observable]).sqrt()
    }

    /// Mean variance of the noise of an observable, of which this is the scale in its units.
    pub fn noise_variance(&self, observable: usize, scale: f64) -> f64 {
        let own = &self.units[self.own(observable)];
        scale.powi(2) * own.iter().map(|sd| sd * sd).sum::<f64>() / own.len() as f64
    }
}

/// A unit behind a number, where it is known.
fn behind(unit: Option<&str>) -> String {
    unit.map_or_else(String::new, |unit| format!(" {unit}"))
}

/// A factor of the covariance of components of these variances, shape (readings, components).
fn correlated(predictor: &dyn Predictor, variance: &[f64], correlation: &DMatrix<f64>) -> DMatrix<f64> {
    let roots = DVector::from_iterator(variance.len(), variance.iter().map(|v| v.sqrt()));
    predictor.basis() * DMatrix::from_diagonal(&roots) * correlation
}

/// Patterns that readings have in common, and independent readings of these deviations beside them.
fn beside_readings(common: &DMatrix<f64>, sd: &[f64]) -> DMatrix<f64> {
    let mut factor = DMatrix::zeros(sd.len(), common.ncols() + sd.len());
    factor.columns_mut(0, common.ncols()).copy_from(common);
    for (i, sd) in sd.iter().enumerate() {
        factor[(i, common.ncols() + i)] = *sd;
    }
    factor
}

/// The patterns of the components, shape (readings, components), and beside them the smooth ones of each observable at its
/// own readings.
fn beside(basis: &DMatrix<f64>, own: &[Range<usize>], smooth: &[&Smooth]) -> DMatrix<f64> {
    let (readings, components) = basis.shape();
    let all = components + smooth.iter().map(|smooth| smooth.len()).sum::<usize>();
    let mut patterns = DMatrix::zeros(readings, all);
    patterns.columns_mut(0, components).copy_from(basis);
    let mut first = components;
    for (own, smooth) in own.iter().zip(smooth) {
        patterns.view_mut((own.start, first), (own.len(), smooth.len())).copy_from(&smooth.patterns);
        first += smooth.len();
    }
    patterns
}

/// What the errors of each observable are measured against, shape (observables,): its range, or its size where one of
/// several tests has a single reading of it.
fn ranges(observations: &Observations, tests: &[Test]) -> Result<Vec<f64>> {
    let mut ranges = observations.ranges();
    for test in tests.iter().filter(|test| !test.name.is_empty() && test.steps() == 1) {
        for j in test.observables.clone() {
            ranges[j] = scale(&observations.values[j]);
        }
    }
    let is_alone = tests.iter().all(|test| test.name.is_empty() && test.steps() == 1);
    ensure!(!is_alone, "{}: one step is to be compared; give at least two (--steps)", observations.source);
    for (name, &range) in observations.names.iter().zip(&ranges) {
        ensure!(range > 0.0, "{}: {name} is the same at every step; leave it out", observations.source);
    }
    Ok(ranges)
}

/// What changes the covariance and not the curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Nuisances {
    /// How many times its unit the noise of each observable is.
    pub scales: Vec<f64>,
    /// Correlation of each observable's noise from one step to the next.
    pub phi: Vec<f64>,
    /// What else is at work, if something is.
    pub rest: Option<Unknown>,
    /// Size of the errors of the form of the effects, as a share of what they add to the curve.
    pub form: Option<f64>,
}

/// The law of a rest: a smooth curve along the control.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Standard deviation in each observable, in noise and scatter, shape (observables,).
    pub amplitudes: Vec<f64>,
    /// Correlation length as a share of the control, between [`SHORTEST`](discrepancy::SHORTEST) and
    /// [`LONGEST`](discrepancy::LONGEST).
    pub length: f64,
}

/// Standard deviation of a reading that is far off, and of a jump, in those of the other readings.
pub const FAR_OFF: f64 = 10.0;
