//! The most probable parameters of a hypothesis, by Levenberg–Marquardt from several starts.

use std::ops::AddAssign;

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::attribute::evidence::jumps;
use crate::attribute::evidence::model::{Curve, Model, Singular, ln_prior};
use gl_inference::prior::normal_quantile;

/// A maximum of the posterior density.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Where it is, shape (parameters,).
    pub w: DVector<f64>,
    /// Covariance of the posterior about it, to second order, shape (parameters, parameters).
    pub covariance: DMatrix<f64>,
    /// ln of likelihood times prior there.
    pub ln_posterior: f64,
    /// What the simulation gives there.
    pub curve: Curve,
}

/// Where a climb starts, and what the simulation gives there: to ask an emulator costs more than all else of a step.
struct Start {
    w: Vec<f64>,
    curve: Curve,
}

impl Start {
    /// Several, of which an emulator is asked at once.
    fn at(model: &Model<'_>, places: Vec<Vec<f64>>) -> impl Iterator<Item = Self> {
        let variances = model.variances(&places);
        let start =
            |(w, variance): (Vec<f64>, _)| Self { curve: Curve { mean: model.mean(&w), variance }, w };
        places.into_iter().zip(variances).map(start)
    }
}

impl From<&Mode> for Start {
    fn from(mode: &Mode) -> Self {
        Self { w: mode.w.as_slice().to_vec(), curve: mode.curve.clone() }
    }
}

/// Points of the prior from which the best are climbed.
const SCREENED: usize = 64;
/// The same where smaller hypotheses have been climbed already.
const SCREENED_BESIDE: usize = 24;
/// The same where what the emulator does not know counts, which is much in most of the prior.
const TRIED: usize = 256;
/// How many of them are climbed.
const CLIMBED: usize = 2;
/// Modes that lie further below the best are left to the wide part of the proposal.
const NEGLIGIBLE: f64 = 12.0;
const ITERATIONS: usize = 30;

/// Readings that are taken to be far off, at most, as a share of all.
const MOST_OUTLIERS: f64 = 0.1;

/// Jumps of a rest at most, over all observables.
const MOST_JUMPS: usize = 12;

/// The modes found from the given starts (all parameters) and, without a rest, from the prior, best first.
/// The model is told at the best of them which readings are far off, and what its effects add to the curve.
pub fn find(model: &mut Model<'_>, starts: &[Vec<f64>], random: &mut ChaCha8Rng) -> Vec<Mode> {
    if let (true, Some(start)) = (model.has_rest(), starts.first()) {
        model.set_form(&model.added(start), Singular::default());
    }
    let screened = match (model.has_rest(), starts.len()) {
        (true, _) => Vec::new(),
        (false, 0 | 1) => screened(model, SCREENED, random),
        (false, _) => screened(model, SCREENED_BESIDE, random),
    };
    let starts = starts.iter().cloned().chain(screened).collect();
    let mut modes = climbed(model, Vec::new(), Start::at(model, starts));
    let Some(best) = modes.first().cloned() else { return modes };
    let (best, is_changed) = with_singular(model, best);
    if is_changed {
        modes = climbed(model, vec![best], modes[1..].iter().map(Start::from));
    }
    modes
}

/// The mode of a model that is reached from parameters of it.
pub fn climb_from(model: &Model<'_>, w: &[f64]) -> Option<Mode> {
    let start = Start::at(model, vec![w.to_vec()]).next()?;
    climb(model, start, &[], Covariance::Fitted)
}

/// The likeliest place of a model by all that the emulator knows and does not know, its nuisances as they are given.
pub fn likeliest(model: &Model<'_>, nuisances: &[f64], random: &mut ChaCha8Rng) -> Option<Mode> {
    let drawn = |_| {
        let of_curve = (0..model.curve_parameters()).map(|_| standard_normal(random));
        of_curve.chain(nuisances.iter().copied()).collect()
    };
    let drawn: Vec<Vec<f64>> = (0..TRIED).map(drawn).collect();
    let ln_likelihood = |start: Start| (model.ln_likelihood(&start.w, &start.curve), start);
    let mut tried: Vec<(f64, Start)> = Start::at(model, drawn).map(ln_likelihood).collect();
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let starts = tried.into_iter().take(CLIMBED);
    let modes = starts.filter_map(|(_, start)| climb(model, start, &[], Covariance::Given));
    modes.max_by(|a, b| a.ln_posterior.total_cmp(&b.ln_posterior))
}

/// The modes that lie apart, best first, of those that are known and those that are reached from starts.
fn climbed(model: &Model<'_>, mut modes: Vec<Mode>, starts: impl Iterator<Item = Start>) -> Vec<Mode> {
    for start in starts {
        modes.extend(climb(model, start, &modes, Covariance::Fitted));
    }
    distinct(modes)
}

/// Points of the prior that come nearest to the measurement.
fn screened(model: &Model<'_>, count: usize, random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let nuisances = vec![0.0; model.len() - model.curve_parameters()];
    let unknown = vec![0.0; model.problem().predictor.scatter().len()];
    let mut screened: Vec<(f64, Vec<f64>)> = (0..count)
        .map(|_| {
            let mut w: Vec<f64> = (0..model.curve_parameters()).map(|_| standard_normal(random)).collect();
            w.extend(&nuisances);
            let mean = model.mean(&w);
            (model.ln_likelihood(&w, &Curve { mean, variance: unknown.clone() }), w)
        })
        .collect();
    screened.sort_by(|a, b| b.0.total_cmp(&a.0));
    screened.into_iter().take(CLIMBED).map(|(_, w)| w).collect()
}

/// The modes that lie apart, best first, without those that are negligible.
fn distinct(mut modes: Vec<Mode>) -> Vec<Mode> {
    modes.sort_by(|a, b| b.ln_posterior.total_cmp(&a.ln_posterior));
    let mut distinct: Vec<Mode> = Vec::new();
    for mode in modes {
        if distinct
            .iter()
            .all(|other| other.ln_posterior - mode.ln_posterior < NEGLIGIBLE && !other.is_near(&mode.w))
        {
            distinct.push(mode);
        }
    }
    distinct
}

/// Take readings to be far off, and, where there is a rest, let it jump, as long as that pays; whether anything has changed.
///
/// Jumps are sought by the noise as it is stated and by that which is found, and beside the readings that stand out of a rest
/// which does not jump and without them: a noise that is larger and correlated goes up and down as such a rest does and hides
/// every single jump of it, and so do two readings that are far off.
fn with_singular(model: &mut Model<'_>, best: Mode) -> (Mode, bool) {
    let (mut best, mut is_changed) = with_outliers(model, best);
    if !model.has_rest() {
        return (best, is_changed);
    }
    for (noise, keeps_outliers) in
        [(Covariance::Given, true), (Covariance::Given, false), (Covariance::Fitted, true)]
    {
        if !keeps_outliers && model.singular().outliers.is_empty() {
            continue;
        }
        let mut tried = model.clone();
        let w = best.w.as_slice();
        if !keeps_outliers {
            tried.set_form(&tried.added(w), Singular { outliers: Vec::new(), ..model.singular().clone() });
        }
        let w = if noise == Covariance::Given { model.as_stated(w) } else { w.to_vec() };
        let start = Start { w, curve: best.curve.clone() };
        let Some(start) = jumping(&mut tried, start, noise) else { continue };
        if tried.singular().jumps == model.singular().jumps {
            continue;
        }
        let Some(mode) = without_idle_jumps(&mut tried, start) else { continue };
        let (mode, _) = with_outliers(&mut tried, mode);
        if mode.ln_posterior > best.ln_posterior {
            (*model, best, is_changed) = (tried, mode, true);
        }
    }
    (best, is_changed)
}

/// Try the jumps that were found beside other effects, each set of readings by itself, and take those with which the
/// measurement is likeliest: a search that takes one jump after the other may end elsewhere beside every hypothesis, and what
/// is told of two of them is not to hang on that.
pub fn try_jumps(model: &mut Model<'_>, modes: &mut Vec<Mode>, sets: &[Vec<usize>]) {
    let Some(mut best) = modes.first().cloned() else { return };
    let mut is_changed = false;
    for jumps in sets {
        if *jumps == model.singular().jumps {
            continue;
        }
        let mut tried = model.clone();
        let added = tried.added(best.w.as_slice());
        tried.set_form(&added, Singular { outliers: Vec::new(), jumps: jumps.clone() });
        let start = jumping(&mut tried, Start::from(&best), Covariance::Fitted);
        let Some(mode) = start.and_then(|start| without_idle_jumps(&mut tried, start)) else { continue };
        let (mode, _) = with_outliers(&mut tried, mode);
        if mode.ln_posterior > best.ln_posterior {
            (*model, best, is_changed) = (tried, mode, true);
        }
    }
    if is_changed {
        *modes = climbed(model, vec![best], modes[1..].iter().map(Start::from));
    }
}

/// Let the rest jump where that gains most, one jump after the other beside those that it has; where a climb ends with them.
fn jumping(model: &mut Model<'_>, mut start: Start, covariance: Covariance) -> Option<Start> {
    while model.singular().jumps.len() < MOST_JUMPS {
        let Some(jump) = jumps::likeliest(model, &start.w, &start.curve) else { break };
        let Singular { outliers, mut jumps } = model.singular().clone();
        jumps.push(jump);
        jumps.sort_unstable();
        model.set_form(&model.added(&start.w), Singular { outliers, jumps });
        start = Start::from(&climb(model, start, &[], covariance)?);
    }
    Some(start)
}

/// The mode of a model from a start, without the jumps that do not pay.
fn without_idle_jumps(model: &mut Model<'_>, start: Start) -> Option<Mode> {
    let mut mode = climb(model, start, &[], Covariance::Fitted)?;
    loop {
        let (w, curve) = (mode.w.as_slice(), &mode.curve);
        let added = model.added(w);
        let without = |k: usize| {
            let mut less = model.clone();
            let Singular { outliers, mut jumps } = model.singular().clone();
            jumps.remove(k);
            less.set_form(&added, Singular { outliers, jumps });
            (less.ln_likelihood(w, curve), less)
        };
        let all = (0..model.singular().jumps.len()).map(without);
        let Some((ln, less)) = all.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        if ln < model.ln_likelihood(w, curve) {
            break;
        }
        *model = less;
        mode = climb(model, Start::from(&mode), &[], Covariance::Fitted)?;
    }
    Some(mode)
}

/// Take readings to be far off, the furthest first, as long as that pays; whether anything has changed. Those that
/// stand in a row are a signal, and are let be.
fn with_outliers(model: &mut Model<'_>, best: Mode) -> (Mode, bool) {
    let mut signal: Vec<usize> = Vec::new();
    loop {
        let mut tried = model.clone();
        let found = without_signal(&mut tried, best.clone(), &signal);
        let in_a_row = tried.outliers_in_a_row();
        if in_a_row.is_empty() {
            *model = tried;
            return found;
        }
        signal.extend(in_a_row);
    }
}

/// The same, but for readings that are not to be far off.
fn without_signal(model: &mut Model<'_>, mut best: Mode, signal: &[usize]) -> (Mode, bool) {
    let most = (MOST_OUTLIERS * model.problem().observed.len() as f64) as usize;
    let mut is_changed = false;
    loop {
        let mut more = model.far_off(best.w.as_slice(), &best.curve);
        more.retain(|reading| !signal.contains(reading));
        more.truncate(most.saturating_sub(model.singular().outliers.len()));
        if more.is_empty() {
            return (best, is_changed);
        }
        let before = model.clone();
        let Singular { mut outliers, jumps } = model.singular().clone();
        outliers.extend(more);
        outliers.sort_unstable();
        let added = if model.has_rest() { model.added(best.w.as_slice()) } else { Vec::new() };
        model.set_form(&added, Singular { outliers, jumps });
        let next = climb(model, Start::from(&best), &[], Covariance::Fitted);
        let Some(next) = next.filter(|next| next.ln_posterior > best.ln_posterior) else {
            *model = before;
            return (best, is_changed);
        };
        best = next;
        is_changed = true;
    }
}

/// What a climb does with the nuisances, which change the covariance alone.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Covariance {
    /// They are put where they are most probable.
    Fitted,
    /// They stay as they are at the start.
    Given,
}

/// The mode that is reached from a start; none on the way to one that is known.
fn climb(model: &Model<'_>, start: Start, known: &[Mode], covariance: Covariance) -> Option<Mode> {
    let dimensions = model.curve_parameters();
    let objective = |w: &[f64], curve: &Curve| model.ln_likelihood(w, curve) + ln_prior(w);
    let Start { mut w, mut curve } = start;
    let settle = |w: &mut [f64], curve: &Curve| {
        if covariance == Covariance::Fitted {
            settle_nuisances(model, w, curve);
        }
    };
    settle(&mut w, &curve);
    let mut value = objective(&w, &curve);
    let mut is_current = true;
    let mut damping = 1e-2;
    for iteration in 1..=ITERATIONS {
        let Some((slope, information)) = normal_equations(model, &w, &curve) else { break };
        let mut gained = 0.0;
        while damping < 1e6 {
            let mut damped = information.clone();
            for i in 0..dimensions {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(factor) = Cholesky::new(damped) else { break };
            let mut step = factor.solve(&slope);
            // Normal scores: a step of many is out of the prior, and of the linear range.
            let length = step.amax();
            if length > 2.0 {
                step *= 2.0 / length;
            }
            let mut next = w.clone();
            for (w, step) in next.iter_mut().zip(step.iter()) {
                *w += step;
            }
            // The variance costs more than the curve and changes slowly: it is brought up to date
            // now and then.
            let there = Curve { mean: model.mean(&next), variance: curve.variance.clone() };
            let better = objective(&next, &there);
            if better > value {
                gained = better - value;
                (w, curve, value, is_current) = (next, there, better, false);
                damping = (damping * 0.2).max(1e-9);
                break;
            }
            damping *= 8.0;
        }
        let is_done = gained < 0.01;
        if is_done || iteration % 8 == 0 {
            if !is_current {
                (curve, is_current) = (model.curve(&w), true);
            }
            settle(&mut w, &curve);
            let settled = objective(&w, &curve);
            if is_done && settled - value < 0.1 {
                value = settled;
                break;
            }
            value = settled;
            let w = DVector::from_column_slice(&w);
            if known.iter().any(|mode| mode.ln_posterior >= value && mode.is_near(&w)) {
                return None;
            }
        }
    }
    if !is_current {
        curve = model.curve(&w);
        settle(&mut w, &curve);
        value = objective(&w, &curve);
    }
    let mut covariance = DMatrix::identity(w.len(), w.len());
    if let Some(factor) =
        normal_equations(model, &w, &curve).and_then(|(_, curvature)| Cholesky::new(curvature))
    {
        covariance.view_mut((0, 0), (dimensions, dimensions)).copy_from(&factor.inverse());
    }
    let others = w.len() - dimensions;
    covariance.view_mut((dimensions, dimensions), (others, others)).copy_from(&spread_of_nuisances(
        &w,
        dimensions,
        |w| objective(w, &curve),
    ));
    Some(Mode { w: DVector::from_vec(w), covariance, ln_posterior: value, curve })
}

/// Covariance of the nuisances, to second order by differences; of each for itself where all together have
/// none.
fn spread_of_nuisances(w: &[f64], first: usize, objective: impl Fn(&[f64]) -> f64) -> DMatrix<f64> {
    const STEP: f64 = 0.1;
    let count = w.len() - first;
    let at = |i: usize, by: f64, k: usize, more: f64| {
        let mut moved = w.to_vec();
        moved[first + i] += by;
        moved[first + k] += more;
        objective(&moved)
    };
    let here = objective(w);
    let mut bend = DMatrix::zeros(count, count);
    let above: Vec<f64> = (0..count).map(|i| at(i, STEP, i, 0.0)).collect();
    for i in 0..count {
        let below = at(i, -STEP, i, 0.0);
        // The prior alone bends by 1.
        bend[(i, i)] = ((2.0 * here - above[i] - below) / (STEP * STEP)).max(0.5);
        for k in 0..i {
            let both = at(i, STEP, k, STEP);
            bend[(i, k)] = (above[i] + above[k] - here - both) / (STEP * STEP);
            bend[(k, i)] = bend[(i, k)];
        }
    }
    Cholesky::new(bend.clone())
        .map(|factor| factor.inverse())
        .filter(|spread| spread.diagonal().iter().all(|variance| *variance < 4.0))
        .unwrap_or_else(|| DMatrix::from_diagonal(&bend.diagonal().map(f64::recip)))
}

impl Mode {
    /// Whether parameters lie within two standard deviations of it.
    fn is_near(&self, w: &DVector<f64>) -> bool {
        let away = w - &self.w;
        Cholesky::new(self.covariance.clone()).is_some_and(|factor| away.dot(&factor.solve(&away)) <= 4.0)
    }

    /// As many places about it, from a normal distribution this many times as wide as the posterior in the parameters of the
    /// curve, which come first; all else is the mode's. None where the posterior has no spread.
    pub fn drawn_about(
        &self,
        model: &Model<'_>,
        count: usize,
        wider: f64,
        random: &mut ChaCha8Rng,
    ) -> Vec<Self> {
        let curve_parameters = model.curve_parameters();
        let spread = self.covariance.view((0, 0), (curve_parameters, curve_parameters)).into_owned();
        let Some(factor) = Cholesky::new(spread).map(Cholesky::unpack) else { return Vec::new() };
        let drawn = |_| {
            let step = &factor * DVector::from_fn(curve_parameters, |_, _| wider * standard_normal(random));
            let mut w = self.w.clone();
            w.rows_mut(0, curve_parameters).add_assign(&step);
            w.as_slice().to_vec()
        };
        let places = Start::at(model, (0..count).map(drawn).collect());
        places.map(|Start { w, curve }| Self { w: DVector::from_vec(w), curve, ..self.clone() }).collect()
    }

    /// ln evidence as if the posterior were normal about this mode (Laplace).
    pub fn ln_evidence(&self) -> f64 {
        let factor = Cholesky::new(self.covariance.clone());
        let ln_det = factor.map_or(f64::NEG_INFINITY, |factor| factor.ln_determinant());
        self.ln_posterior + 0.5 * (ln_det + self.w.len() as f64 * std::f64::consts::TAU.ln())
    }
}

/// Slope of ln likelihood + ln prior by the curve parameters, and its curvature to second order, at a
/// fixed covariance.
fn normal_equations(model: &Model<'_>, w: &[f64], curve: &Curve) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let dimensions = model.curve_parameters();
    let (_, gradient) = model.gradient(w);
    let solved = model.with_covariance(w, &curve.variance, |covariance| covariance.solve(&gradient)).ok()?;
    let residual = DVector::from_vec(model.residual(&curve.mean));
    let slope = solved.tr_mul(&residual) - DVector::from_column_slice(&w[..dimensions]);
    let mut curvature = gradient.tr_mul(&solved);
    for i in 0..dimensions {
        curvature[(i, i)] += 1.0;
    }
    curvature.iter().all(|value| value.is_finite()).then_some((slope, curvature))
}

/// Put the nuisances where they are most probable, one after the other, the curve as it is.
fn settle_nuisances(model: &Model<'_>, w: &mut [f64], curve: &Curve) {
    const STEPS: [f64; 3] = [0.6, 0.15, 0.04];
    let objective = |w: &[f64], i: usize| model.ln_likelihood(w, curve) - 0.5 * w[i] * w[i];
    for step in STEPS {
        for i in model.curve_parameters()..w.len() {
            let mut highest = objective(w, i);
            for direction in [step, -step] {
                let before = w[i];
                let mut best = before;
                // Far from what is believed the prior ends it.
                loop {
                    w[i] = best + direction;
                    let height = objective(w, i);
                    if height <= highest {
                        break;
                    }
                    (best, highest) = (w[i], height);
                }
                w[i] = best;
                if best != before {
                    break;
                }
            }
            if step == STEPS[STEPS.len() - 1] {
                refine(w, i, step, highest, &objective);
            }
        }
    }
}

/// Move one parameter to the top of the parabola through its value and those a step to either side.
fn refine(w: &mut [f64], i: usize, step: f64, here: f64, objective: &impl Fn(&[f64], usize) -> f64) {
    let at = w[i];
    w[i] = at + step;
    let above = objective(w, i);
    w[i] = at - step;
    let below = objective(w, i);
    let bend = 2.0 * here - above - below;
    w[i] = if bend > 0.0 { at + (0.5 * step * (above - below) / bend).clamp(-step, step) } else { at };
}

/// A standard normal number.
pub fn standard_normal(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = random.random();
    normal_quantile(u.clamp(1e-16, 1.0 - 1e-16))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::attribute::problem::Problem;
    use crate::attribute::synthetic_world::{STEPS, Straight};

    /// A noise that is stated a thousandth of what the readings scatter by is as improbable as can be, and is found.
    #[test]
    fn a_mode_is_a_maximum_however_far_the_noise_is_from_what_was_stated() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        for stated in [0.05, 1e-3, 5e-5] {
            let noise = Some(vec![vec![stated; STEPS]]);
            let observations = Straight::measured(1.3, 0.6, 0.0, 0.05);
            let problem =
                Problem::new(&predictor, &prior, Straight::candidates(), &observations, noise, 1.0).unwrap();
            for has_rest in [false, true] {
                let mut model = Model::new(&problem, &[], has_rest);
                let starts = if has_rest { vec![vec![0.0; model.len()]] } else { Vec::new() };
                let modes = find(&mut model, &starts, &mut ChaCha8Rng::seed_from_u64(1));
                let density = |w: &[f64]| model.ln_likelihood(w, &model.curve(w)) + ln_prior(w);
                let best = modes[0].w.as_slice();
                assert!((density(best) - modes[0].ln_posterior).abs() < 1e-6);
                for i in 0..best.len() {
                    for by in [-0.3, 0.3] {
                        let mut moved = best.to_vec();
                        moved[i] += by;
                        let higher = density(&moved) - density(best);
                        assert!(higher < 0.02, "{stated} {has_rest}: {i} by {by} gains {higher}, {best:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_climb_ends_where_a_mode_is_known() {
        let (predictor, prior) = (Straight::new(), Straight::prior());
        let noise = Some(vec![vec![0.05; STEPS]]);
        let observations = Straight::measured(1.3, 0.6, 0.0, 0.05);
        let problem = Problem::new(&predictor, &prior, Vec::new(), &observations, noise, 1.0).unwrap();
        let model = Model::new(&problem, &[], false);
        let climb = |known: &[Mode]| {
            let start = Start::at(&model, vec![vec![0.5; model.len()]]).next().unwrap();
            climb(&model, start, known, Covariance::Fitted)
        };
        let mode = climb(&[]).unwrap();
        assert!(climb(std::slice::from_ref(&mode)).is_none());
        // One that is elsewhere, or lower, does not end it.
        let elsewhere = Mode { w: mode.w.add_scalar(30.0), ..mode.clone() };
        let lower = Mode { ln_posterior: mode.ln_posterior - 1.0, ..mode };
        assert!(climb(&[elsewhere, lower]).is_some());
    }
}
