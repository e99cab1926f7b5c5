//! How far the gap closes once an effect is in the simulation.

use anyhow::{Result, bail, ensure};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::attribute::attribution::MOST;
use super::hat::Hat;
use super::noise::{Noise, OTHER_NOISE, add_scales, check_steps, scale, standard_normal, white_variance};
use super::residual::{gap, spread};
use super::scatter::{Scatter, scatter};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::weights::Weights;
use gl_numeric::statistics::effective_size;
use gl_table::verdict::Verdicts;

/// Runs and what a filter made of them.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// The runs.
    pub ensemble: Ensemble,
    /// Their weights.
    pub weights: Weights,
}

/// The columns of its table, one row an observable and a last one for all.
pub const COLUMNS: [&str; 8] =
    ["observable", "gap_before", "gap_after", "floor", "shrink", "shrink_low", "shrink_high", "floor_before"];

/// The gap of one observable, or of all, before and after; root mean squares over the steps, as shares
/// of the range of the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shrink {
    /// Gap before.
    pub before: f64,
    /// Gap after.
    pub after: f64,
    /// What noise and the simulation's scatter alone would give before.
    pub floor_before: f64,
    /// The same after, where more parameters have followed the noise.
    pub floor: f64,
    /// 1 − (after² − floor²)₊ / (before² − floor_before²), or 0 if there was no gap before.
    pub shrink: f64,
    /// Lower end of the 90 % interval. It is not drawn further down than −1 where the estimate lies
    /// above that: −1 then stands for anything below.
    pub low: f64,
    /// Upper end of the 90 % interval.
    pub high: f64,
    /// How many times the stated noise is the one that was counted with; 1 of all, and where none is stated.
    pub noise_scale: f64,
}

const REPLICATES: usize = 499;

/// Below this the interval is cut, unless the estimate lies there too.
const LOWEST: f64 = -1.0;

/// A test that two calibrations have met.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// The measurement.
    pub observations: &'a Observations,
    /// Standard deviation of the noise, shape (observables, steps), where it is known; else it is estimated from how
    /// the gap after changes from step to step.
    pub noise_sd: Option<&'a [Vec<f64>]>,
    /// The steps that the gap is measured on, which calibration did not see: in ascending order, at least one. `None`
    /// for all, of whose noise the fit took its part.
    pub unseen: Option<&'a [usize]>,
    /// The calibration before.
    pub before: &'a Calibrated,
    /// The calibration after.
    pub after: &'a Calibrated,
}

/// How far the gap closes, of observables and of all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Shrinks {
    /// Of each observable of each test, and then of all of all tests together, each of them in shares of its range.
    pub rows: Vec<Shrink>,
    /// Of all together, each observable in units of its noise and scatter before; none without noise.
    pub by_noise: Option<Shrink>,
}

/// How far the gap closes from one calibration to another.
///
/// * `scatter_share` — share of the simulation's own scatter that the measurement has, not negative.
///
/// Each floor is what that calibration's own parameters leave of the noise and of the scatter of the runs after, which
/// is what their parameters do not explain: with one floor for both, an effect that changes nothing would shrink the
/// gap by the noise that its parameters follow. The interval comes from replicates of the measurement: noise with the
/// correlation that the gap after shows and the scatter of a run drawn at random, of which each calibration follows
/// its part, and posterior means as uncertain as the number of effective runs leaves them, are added to a gap of the
/// estimated size. Both calibrations meet the same measurement, so they share the noise, which is drawn for each test by itself.
///
/// # Errors
/// If an ensemble has no runs or other steps than the measurement, a run has no weight, an
/// observable is constant, or there are too few steps to estimate the noise.
pub fn shrink(tests: &[Compared<'_>], scatter_share: f64, seed: u64) -> Result<Shrinks> {
    ensure!(scatter_share >= 0.0, "--scatter {scatter_share}: give a share of at least 0");
    let of = |(place, test): (u64, &Compared<'_>)| {
        // Streams of one seed are the replicates.
        let seed = seed.wrapping_add(place.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        Ok(Problem::new(test, scatter_share)?.solve(seed))
    };
    let measured = (0..).zip(tests).map(of).collect::<Result<Vec<_>>>()?;
    Ok(Measured::together(&measured).summarised())
}

/// Squared gaps, and those of replicates.
struct Measured {
    squares: Squares,
    replicates: Vec<Squares>,
    /// Shape (observables,).
    noise_scales: Vec<f64>,
}

impl Measured {
    /// The observables of several tests, and then all of them.
    fn together(tests: &[Self]) -> Self {
        let joined = |of: &dyn Fn(&Self) -> &Squares| {
            // The last of each is the mean of its test.
            let own = |test| {
                let squares = of(test);
                squares[..squares.len() - 1].to_vec()
            };
            with_mean(tests.iter().flat_map(own).collect())
        };
        Self {
            squares: joined(&|test| &test.squares),
            replicates: (0..REPLICATES).map(|number| joined(&|test| &test.replicates[number])).collect(),
            noise_scales: tests.iter().flat_map(|test| test.noise_scales.clone()).collect(),
        }
    }

    fn summarised(&self) -> Shrinks {
        let row = |j: usize| {
            let noise_scale = self.noise_scales.get(j).copied().unwrap_or(1.0);
            Shrink { noise_scale, ..self.summary_of(|squares| squares[j]) }
        };
        // The last of them is the mean.
        let observables = self.squares.len() - 1;
        let floors: Vec<f64> = self.squares[..observables].iter().map(|[_, _, before, _]| *before).collect();
        let in_noise = |squares: &Squares| {
            let of = |i: usize| squares.iter().zip(&floors).map(|(square, floor)| square[i] / floor).sum();
            [0, 1, 2, 3].map(of)
        };
        let by_noise = floors.iter().all(|floor| *floor > 0.0).then(|| self.summary_of(in_noise));
        Shrinks { rows: (0..=observables).map(row).collect(), by_noise }
    }

    /// What becomes of some squared gaps.
    fn summary_of(&self, of: impl Fn(&Squares) -> [f64; 4]) -> Shrink {
        let squares = of(&self.squares);
        let replicates: Vec<[f64; 4]> = self.replicates.iter().map(of).collect();
        let means = [0, 1, 2, 3].map(|i| replicates.iter().map(|r| r[i]).sum::<f64>() / REPLICATES as f64);
        let errors = replicates.iter().map(|replicate| {
            // A bias of the gaps is what the floors are for; one of the floors is taken off.
            let away = |i: usize| replicate[i] - means[i];
            [0, 1].map(|i| away(i) - away(2 + i) + (means[2 + i] - squares[2 + i]))
        });
        summarise(squares, errors)
    }
}

/// Squared gaps of every observable, and then their means.
fn with_mean(mut squares: Squares) -> Squares {
    let mean = |i: usize| squares.iter().map(|s| s[i]).sum::<f64>() / squares.len() as f64;
    squares.push([0, 1, 2, 3].map(mean));
    squares
}

/// The squared gaps of one test, as they are measured and drawn again.
struct Problem {
    ranges: Vec<f64>,
    scales: Vec<f64>,
    steps: Vec<usize>,
    noise_sd: Option<Vec<Vec<f64>>>,
    /// How many times the stated noise that is, shape (observables,).
    noise_scales: Vec<f64>,
    noises: Vec<Noise>,
    /// Before and after, shape (observables, steps).
    gaps: [Vec<Vec<f64>>; 2],
    /// What the calibrations before and after take out of the noise.
    hats: [Hat; 2],
    /// What they leave of the scatter of each run, shape (runs, observables, steps).
    runs: [Vec<Vec<Vec<f64>>>; 2],
    /// Directions of the doubt about the posterior mean, before and after.
    doubts: [Vec<Vec<f64>>; 2],
}

/// Squared gaps of every observable, and then of all: before and after, then the floors of the two.
type Squares = Vec<[f64; 4]>;

impl Problem {
    fn new(test: &Compared<'_>, scatter_share: f64) -> Result<Self> {
        let &Compared { observations, noise_sd, unseen, before, after } = test;
        let ranges = observations.ranges();
        if let Some(j) = ranges.iter().position(|&range| range == 0.0) {
            bail!(
                "{}: {} is constant, and a gap is measured in ranges of its observable; leave it out",
                observations.source,
                observations.names[j]
            );
        }
        check_steps(observations, noise_sd)?;
        let weights = [before.weights.of_runs(&before.ensemble)?, after.weights.of_runs(&after.ensemble)?];
        let gaps = [
            gap(observations, &before.ensemble, &weights[0])?,
            gap(observations, &after.ensemble, &weights[1])?,
        ];
        let scales: Vec<f64> = observations.values.iter().map(|values| scale(values)).collect();
        let of = |calibrated: &Calibrated, weights: &[f64], sd: &[Vec<f64>]| {
            let mut of = scatter(&calibrated.ensemble, &calibrated.weights, weights, sd);
            of.runs.iter_mut().flatten().flatten().for_each(|s| *s *= scatter_share.sqrt());
            of
        };
        let (mut noise_sd, mut noise_scales) = (noise_sd.map(<[_]>::to_vec), vec![1.0; ranges.len()]);
        if let Some(stated) = &mut noise_sd {
            let Scatter { runs, hat } = of(after, &weights[1], stated);
            // A fit takes its part of the noise where it saw it, and nowhere else.
            let hat = if unseen.is_some() { Hat::default() } else { hat };
            noise_scales = found_noise(stated, &gaps[1], &hat, &runs);
            stated
                .iter_mut()
                .zip(&noise_scales)
                .for_each(|(sd, scale)| sd.iter_mut().for_each(|sd| *sd *= scale));
        }
        let noises = Noise::estimate(&gaps[1], noise_sd.as_deref(), &scales);
        let sd: Vec<Vec<f64>> = noises.iter().map(|noise| noise.sd.clone()).collect();
        let Scatter { runs, hat } = of(after, &weights[1], &sd);
        // A fit has not followed a noise that it did not see.
        let hats =
            if unseen.is_some() { Default::default() } else { [of(before, &weights[0], &sd).hat, hat] };
        let runs = hats.each_ref().map(|hat| {
            let mut runs = runs.clone();
            runs.iter_mut().for_each(|run| hat.take_out(run, &noises));
            runs
        });
        let doubts =
            [(&before.ensemble, &weights[0]), (&after.ensemble, &weights[1])].map(|(ensemble, weights)| {
                let effective = effective_size(weights);
                let mut doubt = spread(ensemble, weights, 0, &sd).directions;
                doubt.iter_mut().flatten().for_each(|d| *d /= effective.sqrt());
                doubt
            });
        let steps = unseen.map_or_else(|| (0..observations.steps()).collect(), <[usize]>::to_vec);
        Ok(Self { ranges, scales, steps, noise_sd, noise_scales, noises, gaps, hats, runs, doubts })
    }

    fn solve(&self, seed: u64) -> Measured {
        let squares = self.squares(&self.gaps, &self.noises);
        let true_gaps = self.without_noise(&squares);
        let replicate = |number: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(number as u64);
            self.replicate(&true_gaps, &mut rng)
        };
        let replicates: Vec<Squares> = (0..REPLICATES).into_par_iter().map(replicate).collect();
        Measured { squares, replicates, noise_scales: self.noise_scales.clone() }
    }

    /// Squares of gaps of shape (observables, steps), and the floors that noises give.
    fn squares(&self, gaps: &[Vec<Vec<f64>>; 2], noises: &[Noise]) -> Squares {
        let count = self.steps.len() as f64;
        let left = self.hats.each_ref().map(|hat| hat.left(noises));
        let squares: Squares = (0..self.ranges.len())
            .map(|j| {
                let unit = self.ranges[j].powi(2) * count;
                let sum =
                    |values: &[f64]| self.steps.iter().map(|&t| values[t] * values[t]).sum::<f64>() / unit;
                let floor = |i: usize| {
                    let runs = &self.runs[i];
                    let scattered =
                        runs.iter().map(|run| sum(&run[j])).sum::<f64>() / runs.len().max(1) as f64;
                    self.steps.iter().map(|&t| left[i][j][t]).sum::<f64>() / unit + scattered
                };
                [sum(&gaps[0][j]), sum(&gaps[1][j]), floor(0), floor(1)]
            })
            .collect();
        with_mean(squares)
    }

    /// The gaps made smaller, so that their squares are what is left above the floor.
    fn without_noise(&self, squares: &Squares) -> [Vec<Vec<f64>>; 2] {
        [0, 1].map(|i| {
            let smaller = |j: usize| {
                let left =
                    ((squares[j][i] - squares[j][2 + i]) / squares[j][i].max(f64::MIN_POSITIVE)).max(0.0);
                self.gaps[i][j].iter().map(|gap| gap * left.sqrt()).collect()
            };
            (0..self.ranges.len()).map(smaller).collect()
        })
    }

    /// What another measurement would have given.
    fn replicate(&self, true_gaps: &[Vec<Vec<f64>>; 2], rng: &mut ChaCha8Rng) -> Squares {
        // The correlation is drawn too: what would be estimated, were the estimate the truth.
        let drawn: Vec<Vec<f64>> = self.noises.iter().map(|noise| noise.draw(rng)).collect();
        let sd: Vec<Vec<f64>> = self.noises.iter().map(|noise| noise.sd.clone()).collect();
        let noises = Noise::estimate(&drawn, Some(&sd), &self.scales);
        let error: Vec<Vec<f64>> = noises.iter().map(|noise| noise.draw(rng)).collect();
        let count = self.runs[1].len();
        let run = (count > 0).then(|| rng.random_range(0..count));
        let mut gaps = true_gaps.clone();
        for (i, gaps) in gaps.iter_mut().enumerate() {
            let mut error = error.clone();
            self.hats[i].take_out(&mut error, &self.noises);
            if let Some(run) = run {
                let scattered = self.runs[i][run].iter().flatten();
                error.iter_mut().flatten().zip(scattered).for_each(|(e, s)| *e += s);
            }
            gaps.iter_mut().flatten().zip(error.iter().flatten()).for_each(|(gap, e)| *gap += e);
            for doubt in &self.doubts[i] {
                let along = standard_normal(rng);
                gaps.iter_mut().flatten().zip(doubt).for_each(|(gap, d)| *gap += along * d);
            }
        }
        let noises = Noise::estimate(&gaps[1], self.noise_sd.as_deref(), &self.scales);
        self.squares(&gaps, &noises)
    }
}

/// How many times the stated noise the readings scatter by, shape (observables,), by what a calibration leaves of them: 1
/// but where they clearly do otherwise. `runs` is the scatter that the measurement has, too.
///
/// Less, where all that is left is less than noise and scatter would leave by chance; more, where it changes more from step
/// to step than by chance, by second differences, as neither a smooth gap nor a correlated noise does.
fn found_noise(stated: &[Vec<f64>], gap: &[Vec<f64>], hat: &Hat, runs: &[Vec<Vec<f64>>]) -> Vec<f64> {
    /// By chance there is as little left, or it is as rough in one observable, in one case of a hundred.
    const CHANCE: f64 = 0.01;
    /// Second differences without their largest tenth tell the variance of white noise no worse, in the tail, than so many
    /// independent squares a reading do, from 20 readings to 200 (by simulation).
    const TOLD_BY_DIFFERENCES: f64 = 1.0 / 3.0;
    let white: Vec<Noise> = stated.iter().map(|sd| Noise { sd: sd.clone(), phi: 0.0 }).collect();
    let left = hat.left(&white);
    let of = |j: usize| {
        let in_units =
            |curve: &[f64]| -> Vec<f64> { curve.iter().zip(&stated[j]).map(|(y, sd)| y / sd).collect() };
        let square = |curve: &[f64]| in_units(curve).iter().map(|y| y * y).sum::<f64>();
        let mean = |of: &dyn Fn(&[f64]) -> f64| {
            runs.iter().map(|run| of(&run[j])).sum::<f64>() / runs.len().max(1) as f64
        };
        let expected: f64 = left[j].iter().zip(&stated[j]).map(|(left, sd)| left / (sd * sd)).sum();
        let is_little = ChiSquared::new(expected.max(1.0)).is_ok_and(|chi| chi.cdf(square(&gap[j])) < CHANCE);
        let less = (square(&gap[j]) / expected.max(1.0)).sqrt();
        let rough = |curve: &[f64]| white_variance(&in_units(curve)).unwrap_or(0.0);
        // It is no rougher than it is large.
        let more = (rough(&gap[j]) - mean(&rough)).max(0.0).sqrt().min(less);
        let told = TOLD_BY_DIFFERENCES * gap[j].len() as f64;
        let is_much = ChiSquared::new(told.max(1.0))
            .is_ok_and(|chi| chi.sf(told * more * more) < CHANCE / stated.len() as f64);
        if is_little && less < 1.0 / OTHER_NOISE {
            less
        } else if more > OTHER_NOISE && is_much {
            more
        } else {
            1.0
        }
    };
    (0..stated.len()).map(of).collect()
}

/// The estimate, and its interval from the errors of the excess squares before and after.
fn summarise(squares: [f64; 4], errors: impl Iterator<Item = [f64; 2]>) -> Shrink {
    let [before, after, floor_before, floor] = squares;
    let (excess_before, excess_after) = (before - floor_before, after - floor);
    let shrink = if excess_before > 0.0 { 1.0 - excess_after.max(0.0) / excess_before } else { 0.0 };
    let (mut low, mut high): (Vec<f64>, Vec<f64>) = errors
        .map(|[error_before, error_after]| {
            let (before, after) = (excess_before + error_before, (excess_after + error_after).max(0.0));
            // Without a gap before, how much of it closed is anybody's guess.
            if before > 0.0 { (1.0 - after / before, 1.0 - after / before) } else { (f64::NEG_INFINITY, 1.0) }
        })
        .unzip();
    low.sort_by(f64::total_cmp);
    high.sort_by(f64::total_cmp);
    let low = low[REPLICATES / 20].min(shrink);
    let cut = if shrink > LOWEST { low.max(LOWEST) } else { low.max(10.0 * shrink) };
    Shrink {
        before: before.sqrt(),
        after: after.sqrt(),
        floor_before: floor_before.sqrt(),
        floor: floor.sqrt(),
        shrink,
        low: cut,
        high: high[REPLICATES - 1 - REPLICATES / 20].max(shrink),
        noise_scale: 1.0,
    }
}

/// What is concluded, for people and for programs; `is_unseen` where it is of steps that the calibrations did not see.
pub fn verdict(shrinks: &Shrinks, observables: &[String], is_unseen: bool) -> Verdicts {
    let mut verdicts = Verdicts::default();
    let Some((all, own)) = shrinks.rows.split_last() else { return verdicts };
    let hidden = shrinks.by_noise.as_ref().filter(|by_noise| all.low <= 0.0 && is_hidden(by_noise, own));
    match hidden {
        Some(by_noise) => add_hidden(&mut verdicts, by_noise, is_unseen),
        None => add_all(&mut verdicts, all, is_unseen),
    }
    for (name, of) in observables.iter().zip(own).filter(|(_, of)| all.low <= 0.0 && of.low > 0.0) {
        let (shrink, interval) = (percent(of.shrink), ends(of));
        verdicts.add("closes-in", name, format!("In {name} it closes by {shrink} % ({interval})."));
    }
    let scales = observables.iter().map(String::as_str).zip(own.iter().map(|of| of.noise_scale));
    let others: Vec<(&str, f64)> = scales.filter(|(_, scale)| *scale != 1.0).collect();
    add_scales(&mut verdicts, &others, "that is no gap");
    verdicts
}

/// Whether the gap closes by half or more where each observable counts in units of its noise, and in one of them by itself.
fn is_hidden(by_noise: &Shrink, observables: &[Shrink]) -> bool {
    by_noise.shrink >= MOST && by_noise.low > 0.0 && observables.iter().any(|of| of.low > 0.0)
}

/// That the gap closes, and observables that are noisy over their range hide it where each counts as a share of its range.
fn add_hidden(verdicts: &mut Verdicts, by_noise: &Shrink, is_unseen: bool) {
    let [the, _] = openings(is_unseen);
    let (shrink, interval) = (percent(by_noise.shrink), ends(by_noise));
    let text = format!(
        "{the} gap closes by {shrink} % (90 % interval {interval}), each observable in units of its noise and scatter; as shares of their ranges those that are noisy over it hide it."
    );
    verdicts.add("closes-by-noise", by_noise.shrink, text);
}

/// A shrink whose interval reaches from less than this, below zero, to more is not measured.
const UNMEASURED: f64 = 0.5;

/// How far the gap closes, each observable as a share of its range.
fn add_all(verdicts: &mut Verdicts, all: &Shrink, is_unseen: bool) {
    let [the, there] = openings(is_unseen);
    if all.before <= all.floor_before {
        let [gap, noise] = two_apart(all.before, all.floor_before);
        let text = format!(
            "{there} was no gap to close: {gap} % of the range, where noise and scatter alone give {noise} %."
        );
        verdicts.add("no-gap", all.before, text);
        return;
    }
    let interval = format!("90 % interval {}", ends(all));
    let closes = percent(all.shrink.abs());
    let (code, text) = if all.shrink < 0.0 {
        ("grows", format!("{the} gap has grown by {closes} % ({interval} of shrinking)."))
    } else if all.low <= -UNMEASURED && all.high >= UNMEASURED {
        let text = format!(
            "{the} gap is hardly larger than what noise and scatter alone give: how far it closes cannot be measured ({interval})."
        );
        ("too-small", text)
    } else if all.low <= 0.0 {
        let text = format!("{the} gap closes by {closes} % ({interval}). It may not have closed at all.");
        ("may-not-close", text)
    } else {
        ("closes", format!("{the} gap closes by {closes} % ({interval})."))
    };
    verdicts.add(code, all.shrink, text);
}

/// How a sentence about the gap begins, and one on whether there was one.
fn openings(is_unseen: bool) -> [&'static str; 2] {
    if is_unseen {
        [
            "On the steps that the calibrations did not see the",
            "On the steps that the calibrations did not see there",
        ]
    } else {
        ["The", "There"]
    }
}

fn percent(share: f64) -> String {
    format!("{:.0}", 100.0 * share)
}

/// From where to where the gap may have closed.
fn ends(of: &Shrink) -> String {
    let [low, high] =
        if of.low == of.high { [of.low, of.high].map(percent) } else { two_apart(of.low, of.high) };
    format!("{low} to {high} %")
}

/// Two shares in per cent, with as many digits as tell them apart, up to three.
fn two_apart(a: f64, b: f64) -> [String; 2] {
    let with = |digits: usize| [a, b].map(|share| format!("{:.digits$}", 100.0 * share));
    (0..3).map(with).find(|[a, b]| a != b).unwrap_or_else(|| with(3))
}

/// Add whether the gap closed otherwise than was foretold, by the ends of both intervals: then either the emulator or the box
/// of the design did not hold where the model fits best.
pub fn add_foretold(verdicts: &mut Verdicts, all: &Shrink, (low, high): (f64, f64)) {
    /// What emulators, and a noise that is counted otherwise, may make it differ by.
    const ALLOWED: f64 = 0.1;
    let is_apart = all.high < low - ALLOWED || all.low > high + ALLOWED;
    if all.before > all.floor_before && is_apart {
        verdicts.add(
            "not-as-foretold",
            all.shrink,
            format!(
                "It was foretold to close by {} to {} %. What is measured counts: the runs of the design, or their emulator, do not \
                 hold where the model with the effect fits best, and what was said of the cause by them is in doubt.",
                percent(low),
                percent(high)
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{case, linear, noiseless_case};
    use super::*;

    const STEPS: usize = 40;

    #[test]
    fn a_gap_that_closes_otherwise_than_foretold_is_said() {
        let all = Shrink {
            before: 0.1,
            after: 0.02,
            floor_before: 0.01,
            floor: 0.01,
            shrink: 0.97,
            low: 0.95,
            high: 0.99,
            noise_scale: 1.0,
        };
        let said = |foretold: (f64, f64)| {
            let mut verdicts = Verdicts::default();
            add_foretold(&mut verdicts, &all, foretold);
            verdicts.find("not-as-foretold").map(|said| said.text.clone())
        };
        // Of a measured interval that is wide nothing is otherwise.
        let wide = Shrink { low: 0.5, ..all };
        let mut verdicts = Verdicts::default();
        add_foretold(&mut verdicts, &wide, (0.41, 0.47));
        assert!(verdicts.rows.is_empty());
        assert!(said((0.41, 0.47)).unwrap().starts_with("It was foretold to close by 41 to 47 %."));
        assert_eq!((said((0.41, 0.9)), said((0.96, 1.0))), (None, None));
    }

    #[test]
    fn an_observable_that_is_noisy_over_its_range_does_not_hide_that_the_gap_closes_in_units_of_noise() {
        let said = |first_after: f64| {
            let squared = |gaps: [f64; 4]| gaps.map(|gap| gap * gap);
            let first = squared([0.0043, first_after, 0.0016, 0.0016]);
            let noisy = squared([0.0153, 0.0169, 0.0123, 0.0123]);
            let replicate = |number: usize| {
                let away = if number.is_multiple_of(2) { noisy[2] } else { -noisy[2] };
                with_mean(vec![first, [noisy[0] + away, noisy[1] - away, noisy[2], noisy[3]]])
            };
            let shrinks = Measured {
                squares: with_mean(vec![first, noisy]),
                replicates: (0..REPLICATES).map(replicate).collect(),
                noise_scales: vec![1.0; 2],
            };
            verdict(&shrinks.summarised(), &["F", "h"].map(str::to_owned), false).rows
        };
        let [by_noise, closes_in] = &said(0.0016)[..] else { panic!("{:?}", said(0.0016)) };
        assert_eq!([&by_noise.code, &closes_in.code], ["closes-by-noise", "closes-in"]);
        // (0.0043² − 0.0016²) / 0.0016² and (0.0153² − 0.0123²) / 0.0123² of the gap before, and so on after.
        let closes: f64 = by_noise.value.parse().unwrap();
        assert!((closes - (1.0 - 0.8878 / 6.7700)).abs() < 1e-3, "{closes}");
        assert!(by_noise.text.starts_with("The gap closes by 87 % (90 % interval "), "{}", by_noise.text);
        assert_eq!(said(0.004)[0].code, "grows");
    }

    #[test]
    fn of_a_gap_that_is_lost_in_noise_nothing_is_measured() {
        let said = |low: f64, high: f64| {
            let all = Shrink {
                before: 0.02,
                after: 0.01,
                floor_before: 0.01,
                floor: 0.01,
                shrink: 0.9,
                low,
                high,
                noise_scale: 1.0,
            };
            let shrinks = Shrinks { rows: vec![all, all], by_noise: None };
            verdict(&shrinks, &["y".to_owned()], false).rows.remove(0).code
        };
        assert_eq!(
            [said(-1.0, 1.0), said(-0.2, 1.0), said(0.2, 1.0)],
            ["too-small", "may-not-close", "closes"]
        );
    }

    #[test]
    fn two_shares_have_as_many_digits_as_tell_them_apart() {
        assert_eq!(two_apart(0.021, 0.034), ["2", "3"]);
        assert_eq!(two_apart(0.0212, 0.0234), ["2.1", "2.3"]);
        assert_eq!(two_apart(0.02, 0.02), ["2.000", "2.000"]);
    }

    /// Observations and two calibrations that miss them by `before` and `after`.
    struct Pair {
        observations: Observations,
        before: Calibrated,
        after: Calibrated,
        noise_sd: Vec<Vec<f64>>,
    }

    fn pair(seed: u64, before: &[Vec<f64>], after: &[Vec<f64>], phi: f64) -> Pair {
        let first = case(seed, before, phi, 2000, 4.0);
        let second = case(seed, after, phi, 2000, 4.0);
        // The same measurement: what it has more before, the simulation after has too.
        let effect: Vec<Vec<f64>> =
            before.iter().zip(after).map(|(b, a)| b.iter().zip(a).map(|(b, a)| b - a).collect()).collect();
        let mut ensemble = Ensemble::new(&first.observations, false);
        for (run, name) in second.ensemble.samples.iter().enumerate() {
            let curves: Vec<Vec<f64>> = effect
                .iter()
                .enumerate()
                .map(|(j, effect)| {
                    second.ensemble.curve(run, j).iter().zip(effect).map(|(y, e)| y + e).collect()
                })
                .collect();
            ensemble.push(name, &curves, None);
        }
        Pair {
            before: Calibrated {
                weights: weights(&first.ensemble, first.weights, first.values),
                ensemble: first.ensemble,
            },
            after: Calibrated { weights: weights(&ensemble, second.weights, second.values), ensemble },
            observations: first.observations,
            noise_sd: first.noise_sd,
        }
    }

    fn weights(ensemble: &Ensemble, weight: Vec<f64>, values: Vec<Vec<f64>>) -> Weights {
        Weights {
            source: "weights".to_owned(),
            samples: ensemble.samples.clone(),
            parameters: ["a", "b", "c"].map(str::to_owned).to_vec(),
            values,
            misfit: None,
            error: None,
            weight,
        }
    }

    #[test]
    fn a_noise_that_is_clearly_not_as_stated_is_counted_as_it_is() {
        let found = |stated: f64, phi: f64, gap: f64, seed: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut curve = Noise { sd: vec![1.0; STEPS], phi }.draw(&mut rng);
            curve.iter_mut().enumerate().for_each(|(t, y)| *y += gap * (6.0 * t as f64 / STEPS as f64).sin());
            found_noise(&[vec![stated; STEPS]], &[curve], &Hat::default(), &[])[0]
        };
        for seed in 0..100 {
            assert!((0.3..0.7).contains(&found(2.0, 0.0, 0.0, seed)), "{seed}");
        }
        let mean = |of: &dyn Fn(u64) -> f64| (0..100).map(of).sum::<f64>() / 100.0;
        assert!((mean(&|seed| found(0.5, 0.0, 5.0, seed)) - 2.0).abs() < 0.1);
        // As stated, beside a smooth gap, and correlated.
        for (phi, gap) in [(0.0, 0.0), (0.0, 5.0), (0.9, 5.0)] {
            let other = (0..100).filter(|&seed| found(1.0, phi, gap, seed) != 1.0).count();
            assert!(other <= 5, "{phi} {gap}: {other}");
        }
    }

    #[test]
    fn few_readings_of_many_observables_are_not_taken_for_a_larger_noise() {
        let has_more = |seed: &u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            let curves: Vec<Vec<f64>> =
                (0..6).map(|_| Noise { sd: vec![1.0; 31], phi: 0.0 }.draw(&mut rng)).collect();
            let scales = found_noise(&vec![vec![1.0; 31]; 6], &curves, &Hat::default(), &[]);
            scales.iter().any(|scale| *scale > 1.0)
        };
        // One in a hundred; larger than 1.4 times is one of six observables in seven.
        let found = (0..400).filter(has_more).count();
        assert!(found <= 10, "{found}");
    }

    fn wave(height: f64) -> Vec<Vec<f64>> {
        let at = |t: usize| height * (9.0 * t as f64 / STEPS as f64).sin();
        vec![(0..STEPS).map(at).collect(), (0..STEPS).map(|t| 0.5 * at(t)).collect()]
    }

    /// A straight line in each observable, and with an effect a bend more, beside a measurement that has `bent` of the
    /// bend and `missed` of a wave that neither has: how far the gap shrinks, as measured and in truth.
    fn with_effect(seed: u64, bent: f64, missed: f64, runs: usize) -> (Shrink, f64) {
        let x = |t: usize| t as f64 / (STEPS - 1) as f64;
        let pattern = |first: &dyn Fn(f64) -> f64, second: f64| -> Vec<Vec<f64>> {
            let curve: Vec<f64> = (0..STEPS).map(|t| first(x(t))).collect();
            vec![curve.clone(), curve.iter().map(|y| second * y).collect()]
        };
        let mut patterns =
            vec![pattern(&|_| 1.0, 1.0), pattern(&|x| 10.0 * x, -0.5), pattern(&|x| 5.0 * x, 2.0)];
        let bend = pattern(&|x| (4.0 * x).cos(), 1.0);
        // Of opposite signs, so that the effect can follow nothing of it.
        let wave = pattern(&|x| (9.0 * x).sin(), -1.0);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let clean: Vec<Vec<f64>> = (0..2)
            .map(|j| {
                let at = |t: usize| {
                    patterns[1][j][t] + 5.0 * patterns[2][j][t] + bent * bend[j][t] + missed * wave[j][t]
                };
                (0..STEPS).map(at).collect()
            })
            .collect();
        let noisy: Vec<Vec<f64>> =
            clean.iter().map(|curve| curve.iter().map(|y| y + standard_normal(&mut rng)).collect()).collect();
        let mut observations = case(1, &clean, 0.0, 1, 1.0).observations;
        observations.values = noisy.clone();
        let ranges = observations.ranges();
        let calibrated = |patterns: &[Vec<Vec<f64>>], seed: u64| {
            let drawn = linear(&noisy, patterns, runs, seed);
            let mut ensemble = Ensemble::new(&observations, false);
            for (run, curves) in drawn.curves.iter().enumerate() {
                ensemble.push(&run.to_string(), curves, None);
            }
            let parameters: Vec<String> = (0..patterns.len()).map(|k| format!("p{k}")).collect();
            let weights =
                Weights { parameters, ..weights(&ensemble, vec![1.0 / runs as f64; runs], drawn.values) };
            // The same without noise.
            let best = linear(&clean, patterns, 0, seed).best;
            let away = |i: usize| ((clean[i / STEPS][i % STEPS] - best[i]) / ranges[i / STEPS]).powi(2);
            let left: f64 = (0..best.len()).map(away).sum();
            (Calibrated { ensemble, weights }, left)
        };
        let (before, left_before) = calibrated(&patterns, 2 * seed + 1);
        patterns.push(bend);
        let (after, left_after) = calibrated(&patterns, 2 * seed + 2);
        let noise = vec![vec![1.0; STEPS]; 2];
        let compared = Compared {
            observations: &observations,
            noise_sd: Some(&noise),
            unseen: None,
            before: &before,
            after: &after,
        };
        let all = shrink(&[compared], 1.0, 1).unwrap().rows.pop().unwrap();
        (all, 1.0 - left_after / left_before)
    }

    /// How many of 300 intervals hold the truth with an effect, and how far the gap shrinks in the mean, as measured and in
    /// truth.
    fn covered_with_effect(bent: f64, missed: f64, runs: usize) -> (usize, f64, f64) {
        let (mut holds, mut measured, mut truly) = (0, 0.0, 0.0);
        for seed in 0..300 {
            let (all, truth) = with_effect(seed, bent, missed, runs);
            holds += usize::from((all.low - 1e-9..=all.high + 1e-9).contains(&truth));
            measured += all.shrink / 300.0;
            truly += truth / 300.0;
        }
        (holds, measured, truly)
    }

    #[test]
    fn an_effect_that_changes_nothing_does_not_shrink_the_gap() {
        let (holds, measured, truly) = covered_with_effect(0.0, 4.0, 60);
        assert!(truly.abs() < 1e-9 && measured.abs() < 1e-3, "{measured}");
        assert!((249..=288).contains(&holds), "{holds} of 300");
    }

    #[test]
    fn intervals_hold_where_an_effect_is_part_of_the_gap() {
        let (holds, measured, truly) = covered_with_effect(1.0, 2.0, 60);
        assert!((measured - truly).abs() < 0.01, "{measured} {truly}");
        assert!((249..=288).contains(&holds), "{holds} of 300");
    }

    fn shrinks(pair: &Pair, known: bool) -> Vec<Shrink> {
        let Pair { observations, before, after, noise_sd } = pair;
        let noise_sd = known.then_some(noise_sd.as_slice());
        shrink(&[Compared { observations, noise_sd, unseen: None, before, after }], 1.0, 1).unwrap().rows
    }

    /// How far the gap truly shrinks: what calibrations against measurements without noise leave.
    fn truth(before: f64, after: f64, ranges: &[f64]) -> f64 {
        let square = |height: f64| -> f64 {
            let case = noiseless_case(1, &wave(height), 20_000, 4.0);
            let left = gap(&case.observations, &case.ensemble, &case.weights).unwrap();
            left.iter()
                .zip(ranges)
                .flat_map(|(gap, range)| gap.iter().map(move |g| (g / range).powi(2)))
                .sum()
        };
        1.0 - square(after) / square(before)
    }

    /// How many of 300 intervals of the row `all` hold the truth.
    fn covered(before: f64, after: f64, phi: f64, known: bool) -> usize {
        // The same for all, but for what noise does to the ranges that weigh the observables.
        let truth = truth(before, after, &pair(1, &wave(before), &wave(after), phi).observations.ranges());
        let holds = |seed: &u64| {
            let pair = pair(*seed, &wave(before), &wave(after), phi);
            let all = shrinks(&pair, known).pop().unwrap();
            (all.low..=all.high).contains(&truth)
        };
        (0..300).filter(holds).count()
    }

    #[test]
    fn nine_in_ten_intervals_hold() {
        let covered = covered(6.0, 3.0, 0.0, true);
        assert!((255..=285).contains(&covered), "{covered} of 300");
    }

    #[test]
    fn intervals_hold_under_correlated_noise() {
        // Ten independent readings or so are left of forty: 85 % less two standard errors.
        let covered = covered(6.0, 3.0, 0.6, true);
        assert!((243..=285).contains(&covered), "{covered} of 300");
    }

    #[test]
    fn intervals_hold_where_the_noise_is_estimated() {
        let covered = covered(6.0, 2.0, 0.0, false);
        assert!((255..=285).contains(&covered), "{covered} of 300");
    }

    #[test]
    fn a_gap_that_closes_altogether_is_seen_to() {
        let all = shrinks(&pair(1, &wave(6.0), &wave(0.0), 0.0), true).pop().unwrap();
        assert!(all.shrink > 0.9 && all.low > 0.8 && all.high == 1.0, "{all:?}");
    }

    #[test]
    fn no_gap_before_leaves_everything_open() {
        let all = shrinks(&pair(2, &wave(0.0), &wave(0.0), 0.0), true).pop().unwrap();
        assert!(all.low <= -0.9 && all.high == 1.0, "{all:?}");
        let none = summarise([1.0, 0.5, 1.5, 1.5], std::iter::repeat_n([0.1, 0.1], REPLICATES));
        assert_eq!((none.shrink, none.low, none.high), (0.0, -1.0, 1.0));
        let shrinks = Shrinks { rows: vec![none, none], by_noise: None };
        assert_eq!(verdict(&shrinks, &["y".to_owned()], false).rows[0].code, "no-gap");
    }

    #[test]
    fn gaps_are_root_mean_squares_over_the_range() {
        let pair = pair(3, &wave(6.0), &wave(3.0), 0.0);
        let shrinks = shrinks(&pair, true);
        let gap = gap(&pair.observations, &pair.before.ensemble, &pair.before.weights.weight).unwrap();
        let square = |j: usize| {
            gap[j].iter().map(|g| g * g).sum::<f64>() / STEPS as f64 / pair.observations.ranges()[j].powi(2)
        };
        assert!((shrinks[0].before.powi(2) / square(0) - 1.0).abs() < 1e-12);
        assert!((shrinks[2].before.powi(2) / ((square(0) + square(1)) / 2.0) - 1.0).abs() < 1e-12);
        let left = |gap: f64, floor: f64| gap * gap - floor * floor;
        for row in &shrinks {
            let expected = 1.0 - left(row.after, row.floor).max(0.0) / left(row.before, row.floor_before);
            assert!((row.shrink - expected).abs() < 1e-12, "{row:?}");
        }
        // Three parameters were fitted to 80 readings of unit noise.
        let floor = |j: usize| (shrinks[j].floor * pair.observations.ranges()[j]).powi(2);
        assert!((floor(0) + floor(1) - 2.0 * (1.0 - 3.0 / 80.0)).abs() < 0.05, "{} {}", floor(0), floor(1));
    }
}
