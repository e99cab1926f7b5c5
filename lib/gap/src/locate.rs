//! Where the calibrated model and the measurement disagree.

use std::ops::Range;

use anyhow::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::noise::{Noise, check_steps, scale, standard_normal, white_variance};
use super::precision::{Height, Interval, Precision};
use super::residual::{Spread, gap, spread};
use gl_inference::ensemble::Ensemble;
use gl_inference::fit::{self, ALTERNATES, CORRELATED, Fit, ON_ALTERNATING};
use gl_inference::observations::Observations;
use gl_inference::path::Path;
use gl_inference::stack::named;
use gl_inference::units::Units;
use gl_table::verdict::Verdicts;

/// A stretch of the control axis over which the gap of one observable is taken to be constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Position of the observable.
    pub observable: usize,
    /// Its steps.
    pub steps: Range<usize>,
    /// Measurement minus posterior mean, averaged over the stretch, in units of the observable.
    pub gap: f64,
    /// Standard deviation of `gap` from noise, posterior spread and scatter.
    pub gap_sd: f64,
    /// `gap / gap_sd`.
    pub z: f64,
    /// Part of the total squared gap, in units of the noise and in excess of `gap_sd`², in [0, 1]; 0
    /// throughout if no stretch is significant.
    pub share: f64,
    /// Whether it stands out of what the whole axis would show without a gap.
    pub significant: bool,
}

/// Probability of any significant stretch where there is no gap. It is kept at half of the 5 % that
/// are promised, since a correlation estimated from few readings tends to come out too low.
const FALSE_ALARMS: f64 = 0.025;

/// Replicates without a gap that say what stands out: so many that a dozen exceed the threshold, between these.
const REPLICATES: (usize, usize) = (500, 5000);

/// Replicates that exceed the threshold.
const EXCEEDING: f64 = 12.5;

/// Most places per observable at which the axis may be cut.
const MOST_CUTS: usize = 200;

/// Most intervals with a gap, over all observables.
const MOST_INTERVALS: usize = 12;

/// Cut the control axis into stretches, and say in which the calibrated model misses the measurement.
///
/// * `weights` — posterior weights of the runs, shape (runs,), summing to one.
/// * `parameters` — how many parameters were calibrated.
/// * `noise_sd` — standard deviation of the noise, shape (observables, steps), where it is known;
///   else it is estimated from how the gap changes from step to step.
///
/// The gap has the covariance of the noise (autoregressive from step to step) plus that of the
/// posterior spread, in which the simulation's own scatter shows. Of all intervals of all
/// observables, the one whose height, by generalised least squares, is most standard deviations
/// from zero is taken as having a gap if it stands out of what the same search finds in replicates
/// that have none: this allows for having chosen the cuts, for the number of stretches, for the
/// correlation, and for the noise having been estimated. Its height is left free, and the search
/// goes on until nothing stands out. The axis is cut at the ends of the intervals found, and the mean
/// gap of each stretch is given, which must stand out, too.
///
/// # Errors
/// If the ensemble has no runs or other steps than the measurement, or there are too few steps to
/// estimate the noise.
///
/// # Source
/// Circular binary segmentation (Olshen et al. 2004, Biostatistics 5:557), with generalised least
/// squares for the correlated readings.
pub fn locate(
    observations: &Observations,
    ensemble: &Ensemble,
    weights: &[f64],
    parameters: usize,
    noise_sd: Option<&[Vec<f64>]>,
    seed: u64,
) -> Result<Vec<Stretch>> {
    let test = Located { observations, ensemble, noise_sd, weights };
    let mut stretches = stretches(&test, parameters, (FALSE_ALARMS, seed))?;
    share_out(stretches.iter_mut());
    Ok(stretches)
}

/// One test of several that a calibration has seen.
#[derive(Clone, Debug)]
pub struct Located<'a> {
    /// The measurement.
    pub observations: &'a Observations,
    /// The runs.
    pub ensemble: &'a Ensemble,
    /// Standard deviation of the noise, shape (observables, steps), where it is known.
    pub noise_sd: Option<&'a [Vec<f64>]>,
    /// Posterior weights of the runs, shape (runs,), summing to one.
    pub weights: &'a [f64],
}

/// [`locate`] in several tests, shape (tests, stretches): the probability of a false alarm is that of all together, and
/// so are the shares.
///
/// # Errors
/// As [`locate`].
pub fn locate_tests(tests: &[Located<'_>], parameters: usize, seed: u64) -> Result<Vec<Vec<Stretch>>> {
    let alarms = FALSE_ALARMS / tests.len().max(1) as f64;
    let of = |test| stretches(test, parameters, (alarms, seed));
    let mut located = tests.iter().map(of).collect::<Result<Vec<_>>>()?;
    share_out(located.iter_mut().flatten());
    Ok(located)
}

/// A stated noise, shape (observables, steps), as it was found to be, but no larger than what is left is rough: what is large
/// and smooth may be a gap.
///
/// * `weights` — posterior weights of the runs, shape (runs,), summing to one.
/// * `scales` — how many times the stated noise the readings were found to scatter, shape (observables,).
///
/// # Errors
/// As [`locate`].
pub fn noise_found(
    observations: &Observations,
    ensemble: &Ensemble,
    weights: &[f64],
    stated: &[Vec<f64>],
    scales: &[f64],
) -> Result<Vec<Vec<f64>>> {
    let gap = gap(observations, ensemble, weights)?;
    let found = |((gap, stated), scale): ((&Vec<f64>, &Vec<f64>), &f64)| {
        let left: Vec<f64> = gap.iter().zip(stated).map(|(gap, sd)| gap / sd).collect();
        let rough = white_variance(&left).map_or(1.0, f64::sqrt);
        stated.iter().map(|sd| sd * scale.min(rough.max(1.0))).collect()
    };
    Ok(gap.iter().zip(stated).zip(scales).map(found).collect())
}

/// What a calibration leaves of a test, and what may have made it beside a gap.
struct Left {
    /// Measurement minus posterior mean, shape (observables, steps).
    gap: Vec<Vec<f64>>,
    scales: Vec<f64>,
    /// Standard deviation of the noise, and of what the directions leave out of the posterior spread, where it is known.
    noise_sd: Option<Vec<Vec<f64>>>,
    /// Directions of the posterior spread, each of shape (observables · steps).
    directions: Vec<Vec<f64>>,
}

impl Left {
    fn of(test: &Located<'_>, parameters: usize) -> Result<Self> {
        let &Located { observations, ensemble, noise_sd, weights } = test;
        let gap = gap(observations, ensemble, weights)?;
        check_steps(observations, noise_sd)?;
        let scales: Vec<f64> = observations.values.iter().map(|values| scale(values)).collect();
        let first = Noise::estimate(&gap, noise_sd, &scales);
        let first_sd: Vec<Vec<f64>> = first.iter().map(|noise| noise.sd.clone()).collect();
        let Spread { directions, rest } = spread(ensemble, weights, parameters, &first_sd);
        let noise_sd = noise_sd.map(|sd| {
            let rest = rest.chunks(observations.steps());
            sd.iter()
                .zip(rest)
                .map(|(sd, rest)| sd.iter().zip(rest).map(|(sd, r)| sd.hypot(r.sqrt())).collect())
                .collect()
        });
        Ok(Self { gap, scales, noise_sd, directions })
    }

    /// What the directions of the posterior spread have not made of the gap, in standard deviations of white noise, shape
    /// (observables, steps).
    fn standardised(&self) -> Result<Vec<Vec<f64>>> {
        let noises = Noise::estimate(&self.gap, self.noise_sd.as_deref(), &self.scales);
        let white: Vec<Noise> = noises.into_iter().map(|noise| Noise { phi: 0.0, ..noise }).collect();
        // Of what has the covariance N + L Lᵀ, N (N + L Lᵀ)⁻¹ is the part of N.
        let solved = Precision::new(&white, &self.directions)?.apply(&self.gap.concat());
        let of =
            |(noise, solved): (&Noise, &[f64])| noise.sd.iter().zip(solved).map(|(sd, p)| sd * p).collect();
        Ok(white.iter().zip(solved.chunks(self.gap[0].len())).map(of).collect())
    }
}

/// The stretches of one test, with their excess in the place of a share.
fn stretches(test: &Located<'_>, parameters: usize, (alarms, seed): (f64, u64)) -> Result<Vec<Stretch>> {
    let Left { gap, scales, noise_sd, directions } = Left::of(test, parameters)?;
    let cuts = cuts(gap[0].len());
    Problem { noise_sd, scales, directions, cuts, alarms }.solve(&gap, seed)
}

/// What does not change from one replicate to the next.
struct Problem {
    noise_sd: Option<Vec<Vec<f64>>>,
    scales: Vec<f64>,
    directions: Vec<Vec<f64>>,
    cuts: Vec<usize>,
    /// Probability of any significant stretch where there is no gap.
    alarms: f64,
}

impl Problem {
    fn solve(&self, gap: &[Vec<f64>], seed: u64) -> Result<Vec<Stretch>> {
        let noises = Noise::estimate(gap, self.noise_sd.as_deref(), &self.scales);
        let precision = Precision::new(&noises, &self.directions)?;
        let threshold = self.threshold(&noises, seed)?;
        let gap = gap.concat();

        let mut found: Vec<Interval> = Vec::new();
        let mut searched = precision.clone();
        let is_all_found = loop {
            let Some((interval, z)) = searched.most_deviant(&gap, &self.cuts) else { break true };
            if z <= threshold {
                break true;
            }
            if found.len() == MOST_INTERVALS {
                break false;
            }
            searched.set_free(&interval);
            found.push(interval);
        };
        // Where more would have been found, what lies between those that were may have a gap as well.
        let stretches = self.stretches(&precision, &noises, &found, is_all_found, &gap, threshold);
        Ok(with_excesses(stretches, &noises))
    }

    /// What the deviation of the most deviant interval exceeds, without a gap, in few replicates.
    fn threshold(&self, noises: &[Noise], seed: u64) -> Result<f64> {
        let replicates = ((EXCEEDING / self.alarms) as usize).clamp(REPLICATES.0, REPLICATES.1);
        let highest = (0..replicates).into_par_iter().map(|replicate| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(replicate as u64);
            let mut gap: Vec<Vec<f64>> = noises.iter().map(|noise| noise.draw(&mut rng)).collect();
            for direction in &self.directions {
                let along = standard_normal(&mut rng);
                for (gap, direction) in gap.iter_mut().flatten().zip(direction) {
                    *gap += along * direction;
                }
            }
            let noises = Noise::estimate(&gap, self.noise_sd.as_deref(), &self.scales);
            let precision = Precision::new(&noises, &self.directions)?;
            Ok(precision.most_deviant(&gap.concat(), &self.cuts).map_or(0.0, |(_, z)| z))
        });
        let mut highest = highest.collect::<Result<Vec<f64>>>()?;
        highest.sort_by(f64::total_cmp);
        Ok(highest[(((1.0 - self.alarms) * replicates as f64).ceil() as usize).min(replicates - 1)])
    }

    /// The axis of every observable cut at the ends of the intervals found, with heights that allow
    /// for each other.
    fn stretches(
        &self,
        precision: &Precision,
        noises: &[Noise],
        found: &[Interval],
        is_all_found: bool,
        gap: &[f64],
        threshold: f64,
    ) -> Vec<Stretch> {
        let steps = gap.len() / self.scales.len();
        let mut parts: Vec<(Interval, bool)> = Vec::new();
        for observable in 0..self.scales.len() {
            let here: Vec<&Range<usize>> =
                found.iter().filter(|i| i.observable == observable).map(|i| &i.steps).collect();
            let mut ends: Vec<usize> = here.iter().flat_map(|steps| [steps.start, steps.end]).collect();
            ends.extend([0, steps]);
            ends.sort_unstable();
            ends.dedup();
            for pair in ends.windows(2) {
                let inside = here.iter().any(|steps| steps.contains(&pair[0]));
                parts.push((Interval { observable, steps: pair[0]..pair[1] }, inside));
            }
        }
        let heights = parts.iter().enumerate().map(|(place, (interval, _))| {
            let mut others = precision.clone();
            for (_, (other, _)) in parts.iter().enumerate().filter(|&(i, (_, inside))| *inside && i != place)
            {
                others.set_free(other);
            }
            others
                .height(interval, gap)
                .unwrap_or_else(|| precision.height(interval, gap).unwrap_or(NO_HEIGHT))
        });
        let heights: Vec<Height> = heights.collect();
        parts
            .into_iter()
            .zip(heights)
            .map(|((interval, inside), height)| {
                let mean = self.mean(noises, &interval, gap);
                let z = mean.gap / mean.sd;
                // What stands out only beside a spread that the posterior still has is not said to:
                // another draw of it may turn it round.
                let stands_out =
                    (height.gap / height.sd).abs() > threshold && z * height.gap > 0.0 && z.abs() > 2.0;
                Stretch {
                    observable: interval.observable,
                    steps: interval.steps,
                    gap: mean.gap,
                    gap_sd: mean.sd,
                    z,
                    share: 0.0,
                    significant: (inside || !is_all_found) && stands_out,
                }
            })
            .collect()
    }

    /// Mean gap of an interval, and its standard deviation from noise and posterior spread.
    fn mean(&self, noises: &[Noise], interval: &Interval, gap: &[f64]) -> Height {
        let steps = gap.len() / self.scales.len();
        let start = interval.observable * steps;
        let inside = start + interval.steps.start..start + interval.steps.end;
        let mean = |values: &[f64]| values[inside.clone()].iter().sum::<f64>() / inside.len() as f64;
        let noise = noises[interval.observable].mean_variance(interval.steps.clone());
        let spread: f64 = self.directions.iter().map(|direction| mean(direction).powi(2)).sum();
        Height { gap: mean(gap), sd: (noise + spread).sqrt() }
    }
}

/// The squared gap of each stretch, in units of the noise, in excess of what its own uncertainty explains.
fn with_excesses(mut stretches: Vec<Stretch>, noises: &[Noise]) -> Vec<Stretch> {
    for stretch in &mut stretches {
        let sd = &noises[stretch.observable].sd[stretch.steps.clone()];
        let square = (stretch.gap.powi(2) - stretch.gap_sd.powi(2)).max(0.0);
        stretch.share = sd.iter().map(|sd| square / (sd * sd)).sum();
    }
    stretches
}

/// Make shares of the excesses, if a stretch is significant.
fn share_out<'a>(stretches: impl Iterator<Item = &'a mut Stretch>) {
    let mut stretches: Vec<&mut Stretch> = stretches.collect();
    let is_any = stretches.iter().any(|stretch| stretch.significant);
    let total: f64 = stretches.iter().map(|stretch| stretch.share).sum();
    stretches.iter_mut().for_each(|stretch| stretch.share = if is_any { stretch.share / total } else { 0.0 });
}

/// Where other stretches leave nothing to say.
const NO_HEIGHT: Height = Height { gap: 0.0, sd: f64::MAX };

/// Steps before which the axis may be cut, its ends among them.
fn cuts(steps: usize) -> Vec<usize> {
    let stride = steps.div_ceil(MOST_CUTS);
    (0..steps).step_by(stride).chain([steps]).collect()
}

/// What a calibration leaves of tests beside the spread of its posterior, by the test of a fit that all tools share. The size
/// of a noise that is estimated is no evidence; how neighbours differ is.
///
/// * `parameters` — how many parameters were calibrated.
///
/// # Errors
/// As [`locate`].
pub fn fits(tests: &[Located<'_>], parameters: usize) -> Result<Fit> {
    let left = tests.iter().map(|test| Left::of(test, parameters)?.standardised());
    Ok(fit::test(&left.collect::<Result<Vec<_>>>()?.concat(), parameters))
}

/// What is concluded, for people and for programs.
pub fn verdict(stretches: &[Stretch], fit: &Fit, observations: &Observations) -> Verdicts {
    verdict_of_tests(&[("", observations, stretches)], fit, &Units::default())
}

/// What is concluded of several tests: the name of each, its measurement and its stretches. Where it has a name, its
/// observables are called `test.observable`. `units` are those of the controls, as far as they are known.
pub fn verdict_of_tests(tests: &[(&str, &Observations, &[Stretch])], fit: &Fit, units: &Units) -> Verdicts {
    struct Found {
        test: usize,
        observable: usize,
        steps: Range<usize>,
        share: f64,
    }
    let mut places: Vec<Found> = Vec::new();
    let all =
        tests.iter().enumerate().flat_map(|(test, (.., stretches))| stretches.iter().map(move |s| (test, s)));
    for (test, stretch) in all.filter(|(_, stretch)| stretch.significant) {
        match places.last_mut() {
            Some(last)
                if (last.test, last.observable, last.steps.end)
                    == (test, stretch.observable, stretch.steps.start) =>
            {
                last.steps.end = stretch.steps.end;
                last.share += stretch.share;
            }
            _ => places.push(Found {
                test,
                observable: stretch.observable,
                steps: stretch.steps.clone(),
                share: stretch.share,
            }),
        }
    }
    let mut verdicts = Verdicts::default();
    if places.is_empty() {
        without_stretch(&mut verdicts, fit);
        return verdicts;
    }
    places.sort_by(|a, b| b.share.total_cmp(&a.share));
    let name = |found: &Found| {
        let (test, observations, _) = tests[found.test];
        named(test, &observations.names[found.observable])
    };
    let place = |found: &Found| {
        let (_, observations, _) = tests[found.test];
        let control = observations.control_name.as_str();
        let told = Path::new(&observations.control).told(control, units.get(control), &found.steps);
        format!("in {} {told} ({:.0} % of it)", name(found), 100.0 * found.share)
    };
    // A sentence is read for where to look first; the table has the rest.
    const TOLD: usize = 3;
    /// Less of the gap is not where it lies.
    const MOST: f64 = 0.5;
    let told: Vec<String> = places.iter().take(TOLD).map(place).collect();
    let more = match places.len().saturating_sub(TOLD) {
        0 => String::new(),
        1 => ", and one further stretch".to_owned(),
        more => format!(", and {more} further stretches"),
    };
    let where_to = format!("{}{more}", told.join(", "));
    let in_all: f64 = places.iter().map(|found| found.share).sum();
    let text = if in_all < MOST {
        format!("What stands out of the gap lies {where_to}; most of it is spread.")
    } else {
        format!("The gap lies {where_to}.")
    };
    verdicts.add("gap", name(&places[0]), text);
    verdicts
}

/// What is concluded where no stretch stands out.
fn without_stretch(verdicts: &mut Verdicts, fit: &Fit) {
    if !fit.is_bad() {
        verdicts.add("no-gap", fit.probability, "No gap beyond what noise and posterior spread explain.");
    } else if let Some(alternation) = fit.alternation {
        verdicts.add(
            "alternates",
            alternation,
            format!("No stretch stands out, but the gap {ALTERNATES}: {ON_ALTERNATING}."),
        );
    } else if fit.scatter <= 1.0 {
        verdicts.add(
            "smooth",
            fit.correlation,
            format!(
                "No stretch stands out, and what is left is no larger than noise and posterior spread, but neighbouring \
                 readings are off to the same side (correlation {:.1}): a gap that a wide posterior hides, or a noise that is \
                 correlated. A posterior of more runs would tell.",
                fit.correlation
            ),
        );
    } else if fit.correlation > CORRELATED {
        verdicts.add(
            "smooth",
            fit.correlation,
            format!(
                "No stretch stands out, but what is left is {:.1} times noise and posterior spread, and neighbouring readings are \
                 off to the same side (correlation {:.1}): a gap that is spread over all of them, as a drift is, or a noise \
                 that is correlated.",
                fit.scatter, fit.correlation
            ),
        );
    } else {
        verdicts.add(
            "noise-scale",
            fit.scatter,
            format!(
                "No stretch stands out, but the readings scatter {:.1} times what was stated: the noise is larger, or \
                 the gap is spread over all of them, as an offset is.",
                fit.scatter
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{PARAMETERS, case};
    use super::*;

    fn located(seed: u64, gap: &[Vec<f64>], phi: f64, runs: usize, known: bool) -> Vec<Stretch> {
        let case = case(seed, gap, phi, runs, 8.0);
        let noise = known.then_some(case.noise_sd.as_slice());
        locate(&case.observations, &case.ensemble, &case.weights, PARAMETERS, noise, seed).unwrap()
    }

    const STEPS: usize = 40;

    fn none() -> Vec<Vec<f64>> {
        vec![vec![0.0; STEPS]; 2]
    }

    fn bump() -> Vec<Vec<f64>> {
        let mut gap = none();
        gap[0][10..20].fill(3.0);
        gap
    }

    fn alarms(replicates: u64, phi: f64, runs: usize, known: bool) -> usize {
        let alarm = |seed| located(seed, &none(), phi, runs, known).iter().any(|stretch| stretch.significant);
        (0..replicates).filter(|&seed| alarm(seed)).count()
    }

    /// What is left of a posterior that is many times wider than the noise.
    fn fit_of_a_wide_posterior(seed: u64, gap: &[Vec<f64>]) -> Fit {
        let case = case(seed, gap, 0.0, 60, 6.0);
        let weights = vec![1.0 / 60.0; 60];
        let test = Located {
            observations: &case.observations,
            ensemble: &case.ensemble,
            noise_sd: Some(&case.noise_sd),
            weights: &weights,
        };
        fits(&[test], PARAMETERS).unwrap()
    }

    #[test]
    fn what_the_parameters_cannot_make_is_no_fit_however_wide_their_posterior_is() {
        let bad = (0..200).filter(|&seed| fit_of_a_wide_posterior(seed, &none()).is_bad()).count();
        assert!(bad <= 5, "{bad} of 200 where there is no gap");
        let jump = |t: usize| if (t / 4).is_multiple_of(2) { 1.5 } else { -1.5 };
        let gap = vec![(0..STEPS).map(jump).collect(); 2];
        let bad = |seed: &u64| {
            let fit = fit_of_a_wide_posterior(*seed, &gap);
            fit.is_bad() && (1.5..2.2).contains(&fit.scatter)
        };
        assert!((0..20).filter(bad).count() >= 19, "{:?}", fit_of_a_wide_posterior(0, &gap));
    }

    #[test]
    fn a_noise_that_was_found_is_no_larger_than_what_is_left_is_rough() {
        let case = case(3, &bump(), 0.0, 3000, 8.0);
        let found = |stated: f64, scale: f64| {
            let stated = vec![vec![stated; STEPS]; 2];
            let of = (&case.observations, &case.ensemble, &case.weights);
            noise_found(of.0, of.1, of.2, &stated, &[scale; 2]).unwrap()[0][0]
        };
        assert_eq!(found(2.0, 0.5), 1.0);
        assert!((0.7..1.3).contains(&found(0.5, 2.0)), "{}", found(0.5, 2.0));
        assert!((1.0..1.3).contains(&found(1.0, 3.0)), "{}", found(1.0, 3.0));
    }

    #[test]
    fn where_no_stretch_stands_out_what_is_left_is_told_by_how_neighbours_are() {
        let code = |probability: f64, scatter: f64, correlation: f64| {
            let mut verdicts = Verdicts::default();
            without_stretch(
                &mut verdicts,
                &Fit {
                    probability,
                    scatter,
                    correlation,
                    alternation: (correlation < -0.5).then_some(correlation),
                },
            );
            verdicts.rows.remove(0).code
        };
        assert_eq!(code(0.5, 1.3, 0.8), "no-gap");
        assert_eq!(code(1e-5, 1.3, 0.1), "noise-scale");
        assert_eq!(code(1e-5, 1.3, 0.8), "smooth");
        assert_eq!(code(1e-5, 0.9, 0.2), "smooth");
        assert_eq!(code(1e-5, 1.3, -0.8), "alternates");
    }

    #[test]
    fn without_a_gap_at_most_one_case_in_twenty_shows_one() {
        for phi in [0.0, 0.6, 0.9] {
            let alarms = alarms(200, phi, 3000, true);
            assert!(alarms <= 10, "correlation {phi}: {alarms} of 200");
        }
    }

    #[test]
    fn without_a_gap_a_noise_that_must_be_estimated_is_not_taken_for_one() {
        for phi in [0.0, 0.6] {
            let alarms = alarms(200, phi, 3000, false);
            assert!(alarms <= 10, "correlation {phi}: {alarms} of 200");
        }
    }

    #[test]
    fn a_posterior_that_rests_on_a_handful_of_runs_is_no_gap() {
        for runs in [30, 100] {
            let alarms = alarms(200, 0.0, runs, true);
            assert!(alarms <= 10, "{runs} runs: {alarms} of 200");
        }
    }

    #[test]
    fn a_bump_of_three_noise_sd_over_a_quarter_of_the_axis_is_found_where_it_is() {
        let found = |seed: &u64| {
            located(*seed, &bump(), 0.0, 3000, true).iter().any(|stretch| {
                let near = stretch.steps.start.abs_diff(10) <= 2 && stretch.steps.end.abs_diff(20) <= 2;
                stretch.significant && stretch.observable == 0 && stretch.gap > 0.0 && near
            })
        };
        let hits = (0..200).filter(found).count();
        assert!(hits >= 190, "{hits} of 200");
    }

    #[test]
    fn a_bump_far_above_the_noise_is_found_without_knowing_the_noise() {
        let mut gap = none();
        gap[0][10..20].fill(8.0);
        let hits = (0..100)
            .filter(|&seed| located(seed, &gap, 0.0, 3000, false).iter().any(|stretch| stretch.significant))
            .count();
        assert!(hits >= 95, "{hits} of 100");
    }

    #[test]
    fn stretches_cover_the_axis_of_every_observable_and_share_out_the_gap() {
        let stretches = located(3, &bump(), 0.0, 3000, true);
        for observable in 0..2 {
            let mut next = 0;
            for stretch in stretches.iter().filter(|stretch| stretch.observable == observable) {
                assert_eq!(stretch.steps.start, next);
                assert!((stretch.z - stretch.gap / stretch.gap_sd).abs() < 1e-12);
                next = stretch.steps.end;
            }
            assert_eq!(next, STEPS);
        }
        let total: f64 = stretches.iter().map(|stretch| stretch.share).sum();
        assert!((total - 1.0).abs() < 1e-12, "{total}");
        let largest = stretches.iter().max_by(|a, b| a.share.total_cmp(&b.share)).unwrap();
        assert!(largest.significant && largest.observable == 0 && largest.share > 0.7, "{largest:?}");
    }

    #[test]
    fn where_most_of_a_gap_is_spread_it_is_not_said_to_lie_in_what_stands_out() {
        let case = case(1, &none(), 0.0, 1, 0.0);
        let stretch = |observable: usize, share: f64, significant: bool| Stretch {
            observable,
            steps: 10..20,
            gap: 1.0,
            gap_sd: 0.2,
            z: 5.0,
            share,
            significant,
        };
        let fit = fit::test(&case.noise_sd, PARAMETERS);
        let said = |share: f64| {
            let stretches = [stretch(0, share, true), stretch(1, 1.0 - share, false)];
            verdict(&stretches, &fit, &case.observations).find("gap").unwrap().text.clone()
        };
        assert!(said(0.84).starts_with("The gap lies in ") && said(0.84).ends_with("(84 % of it)."));
        assert!(said(0.16).starts_with("What stands out of the gap lies in "), "{}", said(0.16));
        assert!(said(0.16).ends_with("(16 % of it); most of it is spread."));
    }

    #[test]
    fn a_gap_in_more_intervals_than_are_looked_for_is_significant_in_the_others_too() {
        let mut gap = none();
        for (t, gap) in gap.iter_mut().flatten().enumerate().filter(|(t, _)| t % 4 == 2) {
            // Up and down in turn, so that no wider interval has a gap.
            *gap = if t % 8 == 2 { 30.0 } else { -30.0 };
        }
        let stretches = located(5, &gap, 0.0, 3000, true);
        let significant = stretches.iter().filter(|stretch| stretch.significant).count();
        assert!(significant > MOST_INTERVALS, "{stretches:?}");
    }

    #[test]
    fn nothing_to_share_out_where_noise_explains_all() {
        let stretches = located(3, &none(), 0.0, 3000, true);
        assert!(stretches.iter().all(|stretch| stretch.share == 0.0 && !stretch.significant));
        assert_eq!(stretches.len(), 2);
    }

    #[test]
    fn one_step_is_enough_where_the_noise_is_known() {
        let case = case(1, &[vec![9.0], vec![0.0]], 0.0, 1, 0.0);
        let locate = |noise| locate(&case.observations, &case.ensemble, &case.weights, 0, noise, 1);
        let stretches = locate(Some(&case.noise_sd)).unwrap();
        assert!(stretches[0].significant && stretches[0].steps == (0..1), "{stretches:?}");
        assert!(locate(None).unwrap_err().to_string().contains("too few to estimate the noise"));
    }

    #[test]
    fn a_measurement_that_is_met_exactly_has_no_gap() {
        let mut case = case(1, &none(), 0.0, 1, 0.0);
        case.observations.values = (0..2).map(|j| case.ensemble.curve(0, j).to_vec()).collect();
        let stretches = locate(&case.observations, &case.ensemble, &[1.0], 0, None, 1).unwrap();
        assert!(stretches.iter().all(|stretch| stretch.gap == 0.0 && !stretch.significant));
    }
}
