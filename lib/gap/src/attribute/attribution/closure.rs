//! How much of the gap a hypothesis closes, and how much the real simulation would.

use std::ops::AddAssign;

use anyhow::{Context, Result};
use nalgebra::{Cholesky, DMatrix, DVector, DVectorView, SymmetricEigen};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::attribute::attribution::Explanation;
use crate::attribute::attribution::yardstick::Yardstick;
use crate::attribute::evidence::descent::{Descent, Reach, Within, descend};
use crate::attribute::evidence::mode::{Mode, standard_normal};
use crate::attribute::evidence::model::Model;
use crate::attribute::problem::{HEAVY_TAILS, Problem};
use crate::residual::as_neighbours;
use gl_numeric::statistics::Quantiles;

/// Root mean square of (measured − curve) / range over all observables.
pub fn gap(problem: &Problem<'_>, curve: &[f64]) -> f64 {
    let left: Vec<f64> = problem.observed.iter().zip(curve).map(|(seen, y)| seen - y).collect();
    gap_of(problem, &left)
}

/// The same of what is left of the measurement, shape (readings,).
fn gap_of(problem: &Problem<'_>, left: &[f64]) -> f64 {
    let share = |(i, left): (usize, &f64)| {
        problem.counts(i) * (left / problem.ranges[problem.observable_of(i)]).powi(2)
    };
    (left.iter().enumerate().map(share).sum::<f64>() / left.len() as f64).sqrt()
}

/// The gap that noise and scatter alone would leave of a model, once its calibration has followed them as
/// far as it can: the same as [`shrink`](crate::shrink::shrink) takes off a measured gap.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn floor(model: &Model<'_>, w: &[f64]) -> Result<f64> {
    let ranges = &model.problem().ranges;
    let squares = left_of_noise(ranges, model, w, &model.nuisances(w).scales, (model, w))?;
    Ok(squares.iter().sum::<f64>().sqrt())
}

/// A model without a rest and its parameters, by whose noise and scatter is calibrated.
type Metric<'m, 'a> = (&'m Model<'a>, &'m [f64]);

/// Mean squares, in units of each observable, of what calibration leaves of noise of these scales, shape (observables,),
/// and of the scatter: that of the noise of each observable, and behind them that of the scatter.
fn left_of_noise(
    units: &[f64],
    model: &Model<'_>,
    w: &[f64],
    scales: &[f64],
    metric: Metric<'_, '_>,
) -> Result<Vec<f64>> {
    let problem = model.problem();
    let (_, slopes) = model.gradient(w);
    let mut errors = problem.measurement_errors(scales);
    absorb(metric.0, metric.1, &slopes, &mut errors)?;
    let readings = errors.nrows();
    let scattered = errors.ncols() - readings;
    let mut squares = vec![0.0; scales.len() + 1];
    for (k, error) in errors.column_iter().enumerate() {
        let of = if k < scattered { scales.len() } else { problem.observable_of(k - scattered) };
        let share = |(i, e): (usize, &f64)| problem.counts(i) * (e / units[problem.observable_of(i)]).powi(2);
        squares[of] += error.iter().enumerate().map(share).sum::<f64>() / readings as f64;
    }
    Ok(squares)
}

/// Take out of errors, shape (readings, errors), what calibration absorbs by slopes of the curve, shape
/// (readings, curve parameters), in the metric of noise and scatter alone.
///
/// # Errors
/// If the slopes or the covariance are not finite.
pub fn absorb(model: &Model<'_>, w: &[f64], slopes: &DMatrix<f64>, errors: &mut DMatrix<f64>) -> Result<()> {
    let none = vec![0.0; model.problem().predictor.basis().ncols()];
    let solved = model.with_covariance(w, &none, |covariance| covariance.solve(slopes))?;
    let mut information = slopes.tr_mul(&solved);
    for i in 0..information.nrows() {
        information[(i, i)] += 1.0;
    }
    let factor = Cholesky::new(information).context("the slopes of the curve are not finite")?;
    *errors -= slopes * factor.solve(&solved.tr_mul(errors));
    Ok(())
}

/// Share of a gap that is left: (after² − floor²)₊ / (before² − floor²)₊, at most 1; 1 where there is
/// nothing to close.
pub fn left(before: f64, after: f64, floor: f64) -> f64 {
    let above = |gap: f64| (gap * gap - floor * floor).max(0.0);
    if above(before) > 0.0 { (above(after) / above(before)).min(1.0) } else { 1.0 }
}

/// Share of the base model's gap that the effects of an explanation close by themselves, fitted with the rest in
/// the covariance if it has one: the gap that is left when the base parameters are calibrated again beside
/// them, above what noise and scatter would give, of the gap before. It is measured in units of [noise and
/// scatter](Yardstick), by the one of the two yardsticks by which it closes more: an observable that is noisy over its whole
/// range has no gap to close. Readings that are far off do not count.
///
/// Neither goes beyond the bounds, nor further beyond what was believed than the explanation does: the base model
/// closes no gap by what is not believed, and an effect closes none by what the base parameters do.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn closes(problem: &Problem<'_>, base: &Explanation, of: &Explanation) -> Result<f64> {
    let model = of.model(problem).plain();
    let w = &of.best()[..model.len()];
    let scales = model.nuisances(w).scales;
    let within = believed(problem, &problem.prior.base(), &model.point(w));
    // In the metric of the one noise, so that the two are compared alike.
    let left_by = |explanation: &Explanation| -> Result<DMatrix<f64>> {
        let own = explanation.model(problem).plain();
        let from = &explanation.best()[..own.len()];
        Ok(recalibrated((&model, w), &own, from, &within)?.residual)
    };
    let (before, after) = (left_by(base)?, left_by(of)?);
    let mut errors = problem.measurement_errors(&scales);
    absorb(&model, w, &model.gradient(w).1, &mut errors)?;
    let closes_by = |yardstick: &Yardstick<'_>| {
        let size = |residual: &DMatrix<f64>| yardstick.mean_square(residual.as_slice()).sqrt();
        let floor = errors.column_iter().map(|error| yardstick.mean_square(error.as_slice())).sum::<f64>();
        1.0 - left(size(&before), size(&after), floor.sqrt())
    };
    let of_readings = closes_by(&Yardstick::of_readings(problem, &scales, &of.singular.outliers)?);
    Ok(of_readings.max(closes_by(&Yardstick::of_shapes(problem, &scales, &of.singular.outliers)?)))
}

/// Where parameters are believed to be, and as far beyond as a point is.
fn believed(problem: &Problem<'_>, parameters: &[usize], point: &[f64]) -> Vec<Within> {
    let within = |&j: &usize| {
        let (low, high) = problem.beliefs[j].map_or((0.0, 1.0), |belief| belief.bounds());
        (j, low.min(point[j]), high.max(point[j]))
    };
    parameters.iter().map(within).collect()
}

/// Where parameters of a model's simulation are when they are calibrated again within bounds, from where they are, in the
/// metric of another model's noise and scatter; and what is left of the measurement there.
fn recalibrated(
    (metric, at): Metric<'_, '_>,
    own: &Model<'_>,
    w: &[f64],
    within: &[Within],
) -> Result<Descent> {
    let none = vec![0.0; own.problem().predictor.basis().ncols()];
    let reach = Reach { steps: 25, inertia: 0.0 };
    metric.with_covariance(at, &none, |covariance| descend(covariance, own, w, within, reach))
}

/// Predicted share of the gap that closes once the effects are in the simulation and it is calibrated
/// again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foretold {
    /// Median.
    pub median: f64,
    /// 5 % quantile, less what no draw shows.
    pub low: f64,
    /// 95 % quantile, and what no draw shows.
    pub high: f64,
}

/// A model with its mode and its mean curve under the posterior.
pub struct Fitted<'a> {
    /// The model.
    pub model: &'a Model<'a>,
    /// Its best mode.
    pub mode: &'a Mode,
    /// Mean predicted measurement.
    pub mean: &'a [f64],
}

const DRAWS: usize = 400;

/// How far a shrink may lie from all draws of it: the calibration that is to come ends somewhere in its posterior, and the
/// emulator's components leave something out.
const RESOLUTION: f64 = 0.005;

/// Predict how far the gap shrinks from one model to another, should the second be right.
///
/// The real simulation differs from its emulator by what the emulator says it may. Under the second
/// model the measurement itself tells part of that difference: what is left of it is emulator's error, the rest
/// and noise, in proportion to their variances. The first model's gap tells nothing of it, and neither does what it
/// makes of its misfit, a large or a correlated noise: both are calibrated in the metric of the noise as stated, or of the
/// second one's where it is not, within the bounds that were believed. Each model loses the floor that its own parameters
/// leave of the noise.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn predicted_shrink(before: &Fitted<'_>, after: &Fitted<'_>, seed: u64) -> Result<Foretold> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // One noise, that of the model which is right; calibrated is by what is stated of it.
    let plain = after.model.plain();
    let own = &after.mode.w.as_slice()[..plain.len()];
    let scales = plain.nuisances(own).scales;
    let stated = plain.as_stated(own);
    let metric = (&plain, stated.as_slice());
    let own_floor = |fitted: &Fitted<'_>| {
        let own = fitted.model.plain();
        left_of_noise(&own.problem().ranges, &own, &fitted.mode.w.as_slice()[..own.len()], &scales, metric)
    };
    let floors = [own_floor(before)?, own_floor(after)?];
    let levels = noise_levels(after, &scales, &mut random);
    let outliers = &after.model.singular().outliers;
    let before = gaps(plain.problem(), &left_before(before, metric, &mut random)?, outliers);
    let after = gaps(plain.problem(), &left_after(after, metric, &mut random)?, outliers);
    let shrinks: Vec<f64> = before
        .iter()
        .zip(&after)
        .zip(&levels)
        .map(|((&before, &after), levels)| {
            let floor = |squares: &[f64]| squares.iter().zip(levels).map(|(s, level)| s * level).sum::<f64>();
            let above = |gap: f64, squares: &[f64]| (gap * gap - floor(squares)).max(0.0);
            let (before, after) = (above(before, &floors[0]), above(after, &floors[1]));
            if before > 0.0 { 1.0 - (after / before).min(1.0) } else { 0.0 }
        })
        .collect();
    let quantiles = Quantiles::new(&shrinks, &vec![1.0 / DRAWS as f64; DRAWS]);
    let (low, high) = (quantiles.at(0.05) - RESOLUTION, quantiles.at(0.95) + RESOLUTION);
    Ok(Foretold { median: quantiles.at(0.5), low: low.max(0.0), high: high.min(1.0) })
}

/// Draws of the squares of the noise over those of these scales, shape (draws, observables + 1), the scatter's behind them,
/// which is as it is: what is noise, and what a rest that looks like it, is known no better than the posterior says.
fn noise_levels(fitted: &Fitted<'_>, scales: &[f64], random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let (model, mode) = (fitted.model, fitted.mode);
    let first = model.curve_parameters();
    let count = model.len() - first;
    let spread = mode.covariance.view((first, first), (count, count)).into_owned();
    let root = Cholesky::new(spread.clone())
        .map_or_else(|| DMatrix::from_diagonal(&spread.diagonal().map(f64::sqrt)), |factor| factor.l());
    let draw = |_| {
        let away = &root * DVector::from_fn(count, |_, _| standard_normal(random));
        let mut w = mode.w.clone();
        w.rows_mut(first, count).add_assign(&away);
        let drawn = model.nuisances(w.as_slice()).scales;
        drawn.iter().zip(scales).map(|(drawn, scale)| (drawn / scale).powi(2)).chain([1.0]).collect()
    };
    (0..DRAWS).map(draw).collect()
}

/// All of a model calibrated again in a metric: the simulation within its bounds, errors of the measurement beside it.
fn calibrated(fitted: &Fitted<'_>, metric: Metric<'_, '_>) -> Result<Descent> {
    let own = fitted.model.plain();
    let w = &fitted.mode.w.as_slice()[..own.len()];
    let simulated = own.simulated_parameters();
    let within = believed(own.problem(), simulated, &metric.0.point(metric.1));
    let mut calibrated = recalibrated(metric, &own, w, &within)?;
    let (_, slopes) = own.gradient(w);
    let of_measurement = slopes.columns_range(simulated.len()..).into_owned();
    absorb(metric.0, metric.1, &of_measurement, &mut calibrated.residual)?;
    Ok(calibrated)
}

/// The gap where a model comes closest to the measurement, by the noise as it is stated: its most probable parameters leave
/// what a larger or a correlated noise may be.
///
/// # Errors
/// If a curve or its covariance is not finite.
pub fn closest_gap(fitted: &Fitted<'_>) -> Result<f64> {
    let (problem, plain) = (fitted.model.problem(), fitted.model.plain());
    let stated = plain.as_stated(&fitted.mode.w.as_slice()[..plain.len()]);
    let Descent { residual, .. } = calibrated(fitted, (&plain, &stated))?;
    Ok(gap_of(problem, residual.as_slice()).min(gap(problem, fitted.mean)))
}

/// What the real simulation, calibrated, may leave of the measurement where its emulator leaves this much, of whose errors the
/// measurement tells nothing, shape (readings, draws).
fn left_before(fitted: &Fitted<'_>, metric: Metric<'_, '_>, random: &mut ChaCha8Rng) -> Result<DMatrix<f64>> {
    let own = fitted.model.plain();
    let Descent { point, residual, .. } = calibrated(fitted, metric)?;
    let errors = emulator_errors(own.problem(), &variance_at(own.problem(), &point));
    let mut real = -(&errors * DMatrix::from_fn(errors.ncols(), DRAWS, |_, _| standard_normal(random)));
    let (_, slopes) = own.gradient(&fitted.mode.w.as_slice()[..own.len()]);
    absorb(metric.0, metric.1, &slopes, &mut real)?;
    real.column_iter_mut().for_each(|mut column| column += &residual);
    Ok(real)
}

/// The same of the model that is right: its errors are drawn given the measurement.
fn left_after(fitted: &Fitted<'_>, metric: Metric<'_, '_>, random: &mut ChaCha8Rng) -> Result<DMatrix<f64>> {
    let (model, problem) = (fitted.model, fitted.model.problem());
    let w = fitted.mode.w.as_slice();
    let variance = variance_at(problem, &model.point(w));
    let (_, slopes) = model.gradient(w);
    let residual = DVector::from_vec(model.residual(fitted.mean));
    let errors = emulator_errors(problem, &variance);
    // Of z in E z, given E z + rest + noise: mean Eᵀ Σ⁻¹ r, covariance I − Eᵀ Σ⁻¹ E.
    let mut columns = errors.clone().insert_column(errors.ncols(), 0.0);
    columns.set_column(errors.ncols(), &residual);
    let solved = model.with_covariance(w, &variance, |covariance| covariance.solve(&columns))?;
    let product = errors.tr_mul(&solved);
    let left = DMatrix::identity(errors.ncols(), errors.ncols()) - product.columns(0, errors.ncols());
    let eigen = SymmetricEigen::new((&left + left.transpose()) * 0.5);
    let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
    let unit = DMatrix::from_fn(errors.ncols(), DRAWS, |_, _| standard_normal(random));
    let mut unit = &eigen.eigenvectors * DMatrix::from_diagonal(&roots) * unit;
    unit.column_iter_mut().for_each(|mut column| column += product.column(errors.ncols()));
    let mut real = -(&errors * unit);
    // What the components leave out of a reading, given all of them, beside the noise.
    let scales = model.nuisances(w).scales;
    for (i, left_out) in problem.predictor.left_over().iter().enumerate() {
        let noise = (scales[problem.observable_of(i)] * problem.units[i]).powi(2);
        let sd = (left_out * noise / (left_out + noise).max(f64::MIN_POSITIVE)).sqrt();
        let mean = left_out * solved[(i, errors.ncols())];
        real.row_mut(i).apply(|r| *r -= mean + sd * standard_normal(random));
    }
    let Descent { point, residual, .. } = calibrated(fitted, metric)?;
    // Calibrated again beside a rest it is elsewhere, where the measurement tells nothing of what more is not known there.
    let there = variance_at(problem, &point);
    let more: Vec<f64> = there.iter().zip(&variance).map(|(there, here)| (there - here).max(0.0)).collect();
    let errors = emulator_errors(problem, &more);
    real -= &errors * DMatrix::from_fn(errors.ncols(), DRAWS, |_, _| standard_normal(random));
    absorb(metric.0, metric.1, &slopes, &mut real)?;
    real.column_iter_mut().for_each(|mut column| column += &residual);
    Ok(real)
}

/// Variances of the components at a point as the emulator says itself: that its errors have heavy tails is for the
/// odds of a hypothesis, not for their size.
fn variance_at(problem: &Problem<'_>, point: &[f64]) -> Vec<f64> {
    problem.predictor.predict(point).variance.iter().map(|v| v / HEAVY_TAILS).collect()
}

/// A factor of the covariance of errors of the components, shape (readings, components).
fn emulator_errors(problem: &Problem<'_>, variance: &[f64]) -> DMatrix<f64> {
    problem.emulator_errors(variance).columns(0, variance.len()).into_owned()
}

/// The gaps of residuals, shape (readings, draws). Of readings that are far off none is made.
fn gaps(problem: &Problem<'_>, real: &DMatrix<f64>, outliers: &[usize]) -> Vec<f64> {
    let far_off = problem.by_observable(outliers);
    let gap = |left: DVectorView<'_, f64>| {
        let mut left = left.as_slice().to_vec();
        for (block, far_off) in problem.blocks().into_iter().zip(&far_off) {
            as_neighbours(&mut left[block], far_off);
        }
        gap_of(problem, &left)
    };
    real.column_iter().map(gap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::attribution::attribute;
    use crate::attribute::problem::hypothesis::Candidate;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    #[test]
    fn a_fit_of_three_parameters_takes_three_readings_out_of_the_floor() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let observations = Straight::observations(Straight::curve(1.3, 0.6, 0.2));
        let wave = Candidate::Simulated(prior.effects().remove(0));
        let noise = Some(vec![vec![0.01; STEPS]]);
        let problem = Problem::new(&predictor, &prior, vec![wave], &observations, noise, 1.0).unwrap();
        for (hypothesis, parameters) in [(vec![], 2.0), (vec![0], 3.0)] {
            let model = Model::new(&problem, &hypothesis, false);
            let share = (floor(&model, &vec![0.0; model.len()]).unwrap() * problem.ranges[0] / 0.01).powi(2);
            // The priors are wide beside the noise, but not infinitely.
            assert!((share - (1.0 - parameters / STEPS as f64)).abs() < 2e-3, "{parameters}: {share}");
        }
    }

    #[test]
    fn the_base_model_closes_no_gap_beyond_its_bounds() {
        // a is 5 at most.
        let (predictor, (prior, _)) = (Straight::new(), Straight::beyond(0.0, 2.0));
        let problem = predictor.problem(&prior, &Straight::measured(5.1, 0.6, 0.0, 0.01));
        let explanations = attribute(&problem, 1, 1).unwrap().explanations;
        let offset = explanations.iter().find(|of| of.name == "offset(y)").unwrap();
        assert!(offset.closes > 0.95, "{}", offset.closes);
    }

    #[test]
    fn what_is_left_is_counted_above_the_floor() {
        assert!((left(5.0, 4.0, 3.0) - 7.0 / 16.0).abs() < 1e-12);
        assert_eq!(left(5.0, 2.0, 3.0), 0.0);
        assert_eq!(left(2.0, 2.0, 3.0), 1.0);
        assert_eq!(left(4.0, 9.0, 3.0), 1.0);
    }
}
