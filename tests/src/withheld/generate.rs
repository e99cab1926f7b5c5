//! Draw cases by seed: measurements for the diagnosis, and answers for the scorer.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use gl_gap::attribute::problem::hypothesis::hypotheses;
use gl_gap::attribute::problem::measurement::MeasurementEffect;
use gl_gap::attribute::rounds::WIDEST;
use gl_gap::design_box::{Limit, PULLED, Pull, widen};
use gl_gap::residual::as_neighbours;
use gl_inference::observations::range;
use gl_inference::prior::{Effect, Parameter, Prior};
use gl_inference::rig::Kind;
use gl_table::TableWriter;
use nalgebra::{Cholesky, DMatrix};
use rand::seq::index::sample;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::bench::Bench;
use super::condition::Condition;
use super::fit::{Fit, fit};
use super::specimen::{SCATTER, factor};

/// Noise as a share of each observable's range: one of these a case.
const NOISES: [f64; 4] = [0.005, 0.01, 0.02, 0.04];

/// Sizes of effects of the measurement, as shares of the range: of a sensor, of the control.
const OF_A_SENSOR: (f64, f64) = (0.01, 0.1);
const OF_THE_CONTROL: (f64, f64) = (0.005, 0.05);

/// How far beyond a true value that is outside its prior a fit may go, as a share of the way to the other bound.
const MARGIN: f64 = 0.1;

/// Visibility from which on an effect that is no candidate can be seen.
pub const SEEN_WITHOUT: f64 = 2.0;

/// Effects of the measurement that are candidates where any are.
pub const KINDS: [(&str, Kind); 5] = [
    ("offset", Kind::Offset),
    ("gain", Kind::Gain),
    ("drift", Kind::Drift),
    ("compliance", Kind::Compliance),
    ("lag", Kind::Lag),
];

/// Which cases are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Which {
    /// As many, before others are left out.
    pub count: usize,
    /// Only those of an effect that is no candidate.
    pub no_candidate: bool,
    /// Their seed.
    pub seed: u64,
}

/// What sets a group of cases apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// A deterministic simulation, and effects of the simulation as candidates.
    Plain,
    /// The same where every run, and the measurement, is of another specimen.
    Scatter,
    /// A deterministic simulation, and effects of the measurement as candidates, too.
    Rig,
}

/// What is behind a measurement, drawn in turn.
struct Kept {
    family: Family,
    /// Effects of the simulation.
    simulated: usize,
    /// Effects of the measurement.
    measured: usize,
    is_withheld: bool,
}

impl Kept {
    /// What is behind one case of many.
    fn of(bench: &Bench, condition: Condition, stream: u64) -> Self {
        match condition {
            Condition::AsStated if bench.has_rig => kept(stream),
            Condition::AsStated => kept(WITHOUT_RIG[stream as usize % WITHOUT_RIG.len()]),
            _ => kept_under_a_condition(stream),
        }
    }
}

/// Twenty kinds in turn: 10 plain, 5 with scatter, 5 of the rig.
fn kept(stream: u64) -> Kept {
    use Family::{Plain, Rig, Scatter};
    let (family, simulated, measured, is_withheld) = match stream % 20 {
        0 | 10 => (Plain, 0, 0, false),
        2 | 12 => (Plain, 2, 0, false),
        4 | 14 => (Plain, 1, 0, true),
        1 => (Scatter, 0, 0, false),
        5 | 9 => (Scatter, 1, 0, false),
        13 => (Scatter, 2, 0, false),
        17 => (Scatter, 1, 0, true),
        3 => (Rig, 0, 0, false),
        7 | 11 | 15 => (Rig, 0, 1, false),
        19 => (Rig, 1, 0, false),
        _ => (Plain, 1, 0, false),
    };
    Kept { family, simulated, measured, is_withheld }
}

/// Those of the twenty that are not of the rig.
const WITHOUT_RIG: [u64; 15] = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18];

/// Ten kinds in turn for the conditions: mostly one effect, which is where they do harm.
fn kept_under_a_condition(stream: u64) -> Kept {
    use Family::{Plain, Rig, Scatter};
    let (family, simulated, measured, is_withheld) = match stream % 10 {
        1 => (Plain, 0, 0, false),
        3 => (Plain, 1, 0, true),
        5 => (Scatter, 1, 0, false),
        7 if stream % 20 < 10 => (Rig, 1, 0, false),
        7 => (Scatter, 1, 0, true),
        9 => (Plain, 2, 0, false),
        _ => (Plain, 1, 0, false),
    };
    Kept { family, simulated, measured, is_withheld }
}

/// Put one base parameter outside its prior, by 15 to 50 % of the prior's width.
fn move_out(bench: &Bench, values: &mut [f64], random: &mut ChaCha8Rng) {
    let base = bench.prior.base();
    let j = base[random.random_range(0..base.len())];
    let parameter = &bench.prior.parameters()[j];
    let by = random.random_range(0.15..0.5) * (parameter.upper - parameter.lower);
    // Below, only what is no ratio that would come near zero.
    let is_below = random.random::<bool>() && parameter.lower - by > 0.5 * parameter.lower;
    values[j] = if is_below { parameter.lower - by } else { parameter.upper + by };
}

/// A measurement and what is behind it.
struct Case {
    family: Family,
    noisy: Vec<Vec<f64>>,
    noise: Vec<f64>,
    /// Effects that are in, in the order of the candidates.
    effects: Vec<String>,
    /// The one of them that is no candidate.
    withheld: Option<String>,
    /// What the base parameters cannot absorb, in noise and scatter.
    visibility: f64,
    /// The least that the base and all other effects but one cannot absorb, in noise and scatter.
    least: f64,
    /// What the base and any one candidate cannot absorb of an effect that is no candidate and can be seen, in noise and
    /// scatter.
    imitated: f64,
    /// What nothing that the diagnosis considers can: the base and any two candidates, as far beyond the prior as its
    /// box goes.
    considered: f64,
    /// What recalibrating the world with its true effects closes.
    shrink: f64,
    values: Vec<f64>,
}

/// Write cases of a world into `DIR/cases`, and the answers to `DIR/sealed/answers.tsv`.
///
/// # Errors
/// If a file cannot be written.
pub fn generate(bench: &Bench, condition: Condition, which: Which, dir: &Path) -> Result<()> {
    let (cases, sealed) = (dir.join("cases"), dir.join("sealed"));
    for folder in [&cases, &sealed] {
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    let drawn: Vec<(u64, Case)> = (0..which.count as u64)
        .into_par_iter()
        .filter(|&stream| !which.no_candidate || Kept::of(bench, condition, stream).is_withheld)
        .map(|stream| Ok((stream, draw_seen(bench, condition, which.seed, stream)?)))
        .collect::<Result<_>>()?;
    let columns = [
        "case",
        "family",
        "effects",
        "withheld",
        "visibility",
        "least",
        "imitated",
        "considered",
        "shrink",
        "noise",
        "values",
        "rest",
    ];
    let mut answers = TableWriter::create(Some(&sealed.join("answers.tsv")), &columns)?;
    // What is no candidate is missing from the user's table of parameters, and that is all one sees.
    let columns = ["case", "without", "scatter", "measurement"];
    let mut list = TableWriter::create(Some(&cases.join("cases.tsv")), &columns)?;
    for (stream, case) in &drawn {
        let name = format!("case{stream:04}");
        let parameters = bench.prior.parameters().iter();
        let values: Vec<String> =
            parameters.zip(&case.values).map(|(of, value)| format!("{}={value}", of.name)).collect();
        let effects = if case.effects.is_empty() { "none".to_owned() } else { case.effects.join("+") };
        let withheld = case.withheld.as_deref().unwrap_or("-");
        answers.text(&name).text(&format!("{:?}", case.family)).text(&effects).text(withheld);
        answers.numbers(&[case.visibility, case.least, case.imitated, case.considered]);
        answers.numbers(&[case.shrink, case.noise[0]]);
        let rest = match condition {
            Condition::Remainder(_) => "yes",
            Condition::Outside => "outside",
            Condition::Beyond => "beyond",
            _ => "no",
        };
        answers.text(&values.join(",")).text(rest).end_row()?;
        let is_of_rig = case.family == Family::Rig;
        let without = if is_of_rig { bench.of_the_rig.join(",") } else { withheld.to_owned() };
        let kinds = if is_of_rig { KINDS.map(|(name, _)| name).join(",") } else { "-".to_owned() };
        list.text(&name).text(&without).yes_no(case.family == Family::Scatter);
        list.text(&kinds).end_row()?;
        let mut columns = vec![bench.world.control().to_owned()];
        columns.extend(bench.observables());
        let times = match condition {
            Condition::Noise(times) => times,
            _ => 1.0,
        };
        let is_stated = condition != Condition::Unstated;
        if is_stated {
            columns.extend(bench.observables().iter().map(|name| format!("{name}_sd")));
        }
        let mut obs = TableWriter::create(Some(&cases.join(format!("{name}_obs.txt"))), &columns)?;
        for (t, control) in bench.path().iter().enumerate() {
            obs.number(*control);
            for curve in &case.noisy {
                obs.number(curve[t]);
            }
            if is_stated {
                let stated: Vec<f64> = case.noise.iter().map(|sd| times * sd).collect();
                obs.numbers(&stated);
            }
            obs.end_row()?;
        }
        obs.finish()?;
    }
    list.finish()?;
    answers.finish()
}

/// Drawn anew for a condition until what is behind a case can be seen, since what a condition does to effects that
/// cannot is no matter.
fn draw_seen(bench: &Bench, condition: Condition, seed: u64, stream: u64) -> Result<Case> {
    const TIMES: u64 = 40;
    let is_seen = |case: &Case| match (case.effects.len(), &case.withheld) {
        (0, _) => true,
        (_, Some(_)) => case.visibility >= SEEN_WITHOUT,
        (1, None) => case.visibility >= 1.0,
        _ => case.least >= 0.5,
    };
    let mut time = 0;
    loop {
        match draw(bench, condition, seed, stream, time) {
            Ok(case) if condition == Condition::AsStated || is_seen(&case) || time == TIMES => {
                return Ok(case);
            }
            // The world may refuse what lies outside the prior.
            Err(error) if time == TIMES || condition == Condition::AsStated => return Err(error),
            _ => time += 1,
        }
    }
}

fn draw(bench: &Bench, condition: Condition, seed: u64, stream: u64, time: u64) -> Result<Case> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream + 1 + 1_000_000 * time);
    let kept = Kept::of(bench, condition, stream);
    let family = kept.family;
    let world = Truth::draw(bench, condition, &kept, &mut random);
    let simulated = world.simulate(condition, &mut random)?;
    let faults = Faults::draw(bench, &simulated, kept.measured, &mut random);
    let truth = faults.applied(bench, &simulated);
    let share = NOISES[random.random_range(0..NOISES.len())];
    let noise: Vec<f64> = truth.iter().map(|curve| share * range(curve)).collect();
    let is_scattered = family == Family::Scatter;
    let factor = if is_scattered { factor(&bench.path()) } else { DMatrix::zeros(truth[0].len(), 0) };
    let mut noisy = if is_scattered { bench.scattered(&truth, &factor, &mut random) } else { truth.clone() };
    let (mut outliers, mut levels) = (Vec::new(), Vec::new());
    for (curve, sd) in noisy.iter_mut().zip(&noise) {
        let remainder = condition.remainder(&bench.path(), *sd, &mut random);
        let noise = condition.noise(*sd, curve.len(), &mut random);
        let far_off = condition.outliers(*sd, &noise);
        levels.push(level(&noise, &far_off) / sd);
        outliers.push(far_off);
        for ((y, noise), remainder) in curve.iter_mut().zip(noise).zip(remainder) {
            *y += noise + remainder;
        }
    }
    // Noise and scatter together, as the unit of what is visible.
    let scatter = if is_scattered { SCATTER } else { 0.0 };
    // And what else is in the measurement: an effect that is less than it cannot be told from it.
    let rest = match condition {
        Condition::Remainder(times) => times * share,
        _ => 0.0,
    };
    let all = scatter.hypot(share).hypot(rest);
    let spread: Vec<f64> = noise.iter().map(|sd| sd * all / share).collect();
    let chosen: Vec<usize> = (0..world.effects.len()).collect();
    let before = world.fit(&chosen, &noisy, &noise)?;
    // What the measurement does is put right before the world is calibrated again.
    let right = faults.taken_out(bench, &noisy, &simulated);
    let after = world.fit(&[], &right, &noise)?;
    let above = |fit: &Fit, seen: &[Vec<f64>]| -> Result<f64> {
        let floor = floor(fit, &noise, &levels, &noisy, &factor)?;
        Ok((gap(&fit.curves, seen, &noisy, &outliers) - floor).max(0.0))
    };
    let (gap_before, gap_after) = (above(&before, &noisy)?, above(&after, &right)?);
    let visibility = |left_out: &[usize]| Ok(world.fit(left_out, &truth, &spread)?.rms);
    let seen = visibility(&chosen)?;
    let least = chosen.iter().map(|&e| visibility(&[e])).collect::<Result<Vec<_>>>()?;
    let (imitated, considered) = if kept.is_withheld && seen >= SEEN_WITHOUT {
        let parameters = beyond(&world.parameters)?;
        let (one, two) = (world.others(1, 1), world.others(0, 2));
        let within = world.imitated(&one, &world.parameters, &truth, &spread)?;
        (within, within.min(world.imitated(&two, &parameters, &truth, &spread)?))
    } else {
        (f64::INFINITY, f64::INFINITY)
    };
    let names = world.effects.iter().map(|effect| effect.name.clone());
    Ok(Case {
        family,
        noise,
        effects: names.chain(faults.list.iter().map(|(fault, _)| fault.name.clone())).collect(),
        withheld: kept.is_withheld.then(|| world.effects[0].name.clone()),
        visibility: seen,
        least: least.into_iter().fold(f64::INFINITY, f64::min).min(1e9),
        imitated: imitated.min(1e9),
        considered: considered.min(1e9),
        shrink: if gap_before > 0.0 { 1.0 - gap_after / gap_before } else { 0.0 },
        values: world.values,
        noisy,
    })
}

/// A world at the values that are true.
struct Truth<'a> {
    bench: &'a Bench,
    /// Effects of the simulation that are in, in the order of the candidates.
    effects: Vec<Effect>,
    /// Shape (parameters,).
    values: Vec<f64>,
    /// The parameters, within bounds that hold these values too.
    parameters: Vec<Parameter>,
}

impl<'a> Truth<'a> {
    fn draw(bench: &'a Bench, condition: Condition, kept: &Kept, random: &mut ChaCha8Rng) -> Self {
        let parameters = bench.prior.parameters();
        let mut effects = bench.effects();
        if kept.family == Family::Rig {
            effects.retain(|effect| !bench.of_the_rig.contains(&effect.name.as_str()));
        }
        let mut chosen = sample(random, effects.len(), kept.simulated).into_vec();
        chosen.sort_unstable();
        let effects: Vec<Effect> = chosen.into_iter().map(|e| effects[e].clone()).collect();
        let on = || effects.iter().flat_map(|effect| effect.parameters.clone());
        let mut values = bench.prior.with_effects_off();
        for j in bench.prior.base().into_iter().chain(on()) {
            values[j] = parameters[j].quantile(random.random());
        }
        if condition == Condition::Outside {
            move_out(bench, &mut values, random);
        }
        if condition == Condition::Beyond {
            on().for_each(|j| values[j] = 1.6 * parameters[j].upper * values[j].signum());
        }
        let wide_enough = |(parameter, &value): (&Parameter, &f64)| {
            let mut parameter = parameter.clone();
            if value > parameter.upper {
                parameter.upper = value + MARGIN * (value - parameter.lower);
            } else if value < parameter.lower && parameter.off != Some(value) {
                parameter.lower = value - MARGIN * (value - parameter.lower).abs();
            }
            parameter
        };
        let parameters = parameters.iter().zip(&values).map(wide_enough).collect();
        Self { bench, effects, values, parameters }
    }

    /// Curves, shape (observables, steps).
    fn simulate(&self, condition: Condition, random: &mut ChaCha8Rng) -> Result<Vec<Vec<f64>>> {
        let mut simulated = self.bench.simulate(&self.values)?;
        if condition == Condition::OtherForm {
            let all: Vec<usize> = (0..self.effects.len()).collect();
            let off = self.without(&all).0;
            let control = self.bench.path();
            for (curve, base) in simulated.iter_mut().zip(self.bench.simulate(&off)?) {
                let added: Vec<f64> = curve.iter().zip(&base).map(|(y, base)| y - base).collect();
                let added = condition.another_form(&added, &control, random);
                *curve = base.iter().zip(added).map(|(base, added)| base + added).collect();
            }
        }
        Ok(simulated)
    }

    /// The values with some of the effects off, and the parameters that are then free: those of the base and of the others.
    fn without(&self, left_out: &[usize]) -> (Vec<f64>, Vec<usize>) {
        let mut values = self.values.clone();
        let mut free = self.bench.prior.base();
        for (e, effect) in self.effects.iter().enumerate() {
            for &j in &effect.parameters {
                if left_out.contains(&e) {
                    values[j] = self.bench.prior.parameters()[j].off.unwrap_or(0.0);
                } else {
                    free.push(j);
                }
            }
        }
        (values, free)
    }

    /// The fit to a target, with a noise of each observable, once some of the effects are off.
    fn fit(&self, left_out: &[usize], target: &[Vec<f64>], noise: &[f64]) -> Result<Fit> {
        let (start, free) = self.without(left_out);
        fit(self.bench, &self.parameters, (&start, &free), target, noise)
    }

    /// Sets of effects that are not in it, of so many at the least and at the most.
    fn others(&self, least: usize, most: usize) -> Vec<Vec<Effect>> {
        let mut others = self.bench.effects();
        others.retain(|other| !self.effects.contains(other));
        let sets = hypotheses(others.len(), most).into_iter().filter(|set| set.len() >= least);
        sets.map(|set| set.into_iter().map(|other| others[other].clone()).collect()).collect()
    }

    /// The least root mean square that the base parameters and one of some sets of effects leave of a target, within these
    /// bounds, in a noise of each observable.
    fn imitated(
        &self,
        sets: &[Vec<Effect>],
        parameters: &[Parameter],
        target: &[Vec<f64>],
        noise: &[f64],
    ) -> Result<f64> {
        let all: Vec<usize> = (0..self.effects.len()).collect();
        let (off, base) = self.without(&all);
        let left = sets.iter().map(|set| {
            let (mut start, mut free) = (off.clone(), base.clone());
            for &j in set.iter().flat_map(|effect| &effect.parameters) {
                start[j] = self.parameters[j].quantile(0.5);
                free.push(j);
            }
            Ok(fit(self.bench, parameters, (&start, &free), target, noise)?.rms)
        });
        left.collect::<Result<Vec<_>>>().map(|left| left.into_iter().fold(f64::INFINITY, f64::min))
    }
}

/// Parameters with bounds as far out as the box of a diagnosis goes, on every side.
fn beyond(parameters: &[Parameter]) -> Result<Vec<Parameter>> {
    let pulls: Vec<Pull> = parameters
        .iter()
        .flat_map(|own| {
            [-PULLED, PULLED].map(|side| Pull { parameter: own.name.clone(), side, is_of_first: true })
        })
        .collect();
    let prior = Prior::new(parameters.to_vec());
    let mut wider = prior.clone();
    for _ in 0..WIDEST {
        wider = widen(&prior, &wider, &pulls, Limit::Beyond)?.unwrap_or(wider);
    }
    Ok(wider.parameters().to_vec())
}

/// Mean square of (measured − curve) / range of the noisy measurement, without outliers, shape (observables, any).
fn gap(curves: &[Vec<f64>], seen: &[Vec<f64>], noisy: &[Vec<f64>], outliers: &[Vec<usize>]) -> f64 {
    let square = |j: usize| {
        let range = range(&noisy[j]);
        let mut left: Vec<f64> = seen[j].iter().zip(&curves[j]).map(|(o, y)| (o - y) / range).collect();
        as_neighbours(&mut left, &outliers[j]);
        left.iter().map(|left| left * left).sum::<f64>() / left.len() as f64
    };
    (0..seen.len()).map(square).sum::<f64>() / seen.len() as f64
}

/// Root mean square of the noise that was drawn, without what is far off. Of a noise of heavy tails it is often far from what it
/// was drawn by, and what luck adds to it is no gap.
fn level(noise: &[f64], far_off: &[usize]) -> f64 {
    let near = (0..noise.len()).filter(|step| !far_off.contains(step));
    let square: f64 = near.map(|step| noise[step].powi(2)).sum();
    (square / (noise.len() - far_off.len()) as f64).sqrt()
}

/// The mean square that noise, so many times as large as its standard deviation, and scatter alone leave of a gap, once a fit
/// has followed them as far as it can.
fn floor(fit: &Fit, noise: &[f64], levels: &[f64], noisy: &[Vec<f64>], factor: &DMatrix<f64>) -> Result<f64> {
    let steps = noisy[0].len();
    let slopes = &fit.slopes;
    let information = slopes.tr_mul(slopes) + DMatrix::identity(slopes.ncols(), slopes.ncols()) * 1e-9;
    let hat = slopes
        * Cholesky::new(information).context("a curve that nothing changes")?.solve(&slopes.transpose());
    let readings = hat.nrows();
    let left = DMatrix::identity(readings, readings) - hat;
    // Scatter in units of the noise; that two observables share some of it changes little.
    let mut errors = DMatrix::zeros(readings, readings + factor.ncols() * noisy.len());
    (0..readings).for_each(|i| errors[(i, i)] = levels[i / steps]);
    for (j, curve) in noisy.iter().enumerate() {
        let unit = range(curve) / noise[j];
        errors
            .view_mut((j * steps, readings + j * factor.ncols()), (steps, factor.ncols()))
            .copy_from(&(factor * unit));
    }
    let left = left * errors;
    let row = |i: usize| left.row(i).norm_squared() * (noise[i / steps] / range(&noisy[i / steps])).powi(2);
    Ok((0..left.nrows()).map(row).sum::<f64>() / left.nrows() as f64)
}

/// What is wrong with a measurement.
struct Faults {
    list: Vec<(MeasurementEffect, f64)>,
    ranges: Vec<f64>,
}

impl Faults {
    fn draw(bench: &Bench, curves: &[Vec<f64>], count: usize, random: &mut ChaCha8Rng) -> Self {
        let names: Vec<String> = bench.observables();
        let mut list = Vec::new();
        for _ in 0..count {
            // A kind first, so that those of the control are as frequent as those of a sensor.
            let kind = KINDS[random.random_range(0..KINDS.len())].1;
            let all = MeasurementEffect::of_tests(&[kind], &names, &bench.tests());
            let effect = all[random.random_range(0..all.len())].clone();
            let of_control = matches!(kind, Kind::Compliance | Kind::Lag);
            let (least, most) = if of_control { OF_THE_CONTROL } else { OF_A_SENSOR };
            let size = random.random_range(least..most);
            let sign = if of_control || random.random() { 1.0 } else { -1.0 };
            list.push((effect, sign * size));
        }
        Self { list, ranges: curves.iter().map(|curve| range(curve)).collect() }
    }

    fn applied(&self, bench: &Bench, curves: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut flat = curves.concat();
        let tests = bench.tests();
        for (effect, size) in &self.list {
            let test = &tests[effect.test];
            let ranges = &self.ranges[test.observables.clone()];
            effect.apply(*size, &test.path, ranges, &mut flat[test.readings.clone()]);
        }
        flat.chunks_exact(curves[0].len()).map(<[f64]>::to_vec).collect()
    }

    /// A measurement without what is wrong with it, by the curves that it was made of.
    fn taken_out(&self, bench: &Bench, noisy: &[Vec<f64>], simulated: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let wrong = self.applied(bench, simulated);
        let mut right = noisy.to_vec();
        for ((right, wrong), simulated) in right.iter_mut().zip(&wrong).zip(simulated) {
            for ((y, wrong), simulated) in right.iter_mut().zip(wrong).zip(simulated) {
                *y -= wrong - simulated;
            }
        }
        right
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_level_of_a_noise_is_of_what_is_not_far_off() {
        assert_eq!(level(&[3.0, -4.0, 100.0, 0.0], &[2]), (25.0_f64 / 3.0).sqrt());
    }
}
