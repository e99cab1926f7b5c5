//! Whether a measurement looks like a draw from what a posterior predicts: each reading, predicted from the others.
//!
//! Of draws from a posterior that knows all readings, those of the posterior without one of them have the weights
//! 1/p(y_i | y_{−i}, θ). Where one such weight is far above the others a Pareto distribution takes the place of the
//! largest, and its shape k says how far the result can be trusted: up to 0.7 it can.
//!
//! # Source
//! Vehtari, Gelman & Gabry (2017), Stat. Comput. 27:1413, and Vehtari et al. (2024), J. Mach. Learn. Res. 25(72), for
//! the weights; Bürkner, Gabry & Vehtari (2021), Comput. Stat. 36:1243, for readings that are correlated given θ;
//! Zhang & Stephens (2009), Technometrics 51:316, for the shape.

use anyhow::{Result, ensure};
use gl_numeric::normal::normal_cdf;
use gl_numeric::statistics::normalised;
use gl_table::verdict::Verdicts;
use gl_table::{number, optional_number, text};
use serde::{Deserialize, Serialize};
use statrs::distribution::{Binomial, DiscreteCDF};

use crate::predict::mixture_quantile;

/// What one draw says of a reading, given the other readings: a normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Given {
    /// Mean.
    pub mean: f64,
    /// Standard deviation, noise included; above zero.
    pub sd: f64,
}

/// What the posterior without a reading says of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Quantiles at [`LEVELS`].
    pub quantiles: [f64; 5],
    /// Probability of a lower reading than the one that was measured; even between 0 and 1 if all is right.
    pub pit: f64,
    /// Shape k of the largest weights; none where there are too few draws to tell.
    pub shape: Option<f64>,
}

/// The levels of the quantiles: the ends of the 90 % and the 50 % band, and the median.
pub const LEVELS: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// The shape above which weights are not to be trusted.
pub const TRUSTED_SHAPE: f64 = 0.7;

/// What draws of equal weight from the posterior of all readings say of one of them without it.
///
/// * `measured` — the reading.
/// * `given` — shape (draws,), what each draw says of it given the others.
///
/// # Errors
/// If there are no draws, or the reading is beyond what all of them can say.
pub fn leave_out(measured: f64, given: &[Given]) -> Result<LeftOut> {
    ensure!(!given.is_empty(), "no draws to predict a reading from");
    let z = |given: &Given| (measured - given.mean) / given.sd;
    let mut ln_weight: Vec<f64> = given.iter().map(|given| 0.5 * z(given).powi(2) + given.sd.ln()).collect();
    let shape = smooth(&mut ln_weight);
    let weights = normalised(&ln_weight)?;
    let pit = given.iter().zip(&weights).map(|(given, weight)| weight * normal_cdf(z(given))).sum::<f64>();
    let (means, sds): (Vec<f64>, Vec<f64>) = given.iter().map(|given| (given.mean, given.sd)).unzip();
    Ok(LeftOut {
        quantiles: LEVELS.map(|level| mixture_quantile(&means, &sds, &weights, level)),
        pit: pit.clamp(0.0, 1.0),
        shape,
    })
}

/// Put quantiles of a Pareto distribution in the place of the largest weights, of which the logarithms are given; its
/// shape, where there are draws enough.
fn smooth(ln_weight: &mut [f64]) -> Option<f64> {
    /// Fewer have no shape.
    const FEWEST: usize = 5;
    let n = ln_weight.len();
    let highest = ln_weight.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    ln_weight.iter_mut().for_each(|ln| *ln -= highest);
    let size = (0.2 * n as f64).min(3.0 * (n as f64).sqrt()).ceil() as usize;
    if size + 1 >= n {
        return None;
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| ln_weight[a].total_cmp(&ln_weight[b]));
    let threshold = ln_weight[order[n - size - 1]].exp();
    let tail: Vec<usize> =
        order[n - size..].iter().copied().filter(|&i| ln_weight[i].exp() > threshold).collect();
    if tail.len() < FEWEST {
        return None;
    }
    let beyond: Vec<f64> = tail.iter().map(|&i| ln_weight[i].exp() - threshold).collect();
    let (shape, scale) = pareto(&beyond)?;
    for (place, &i) in tail.iter().enumerate() {
        let ln_above = (-(place as f64 + 0.5) / tail.len() as f64).ln_1p();
        let quantile =
            if shape.abs() < f64::EPSILON { -ln_above } else { (-shape * ln_above).exp_m1() / shape };
        // No weight may grow beyond the largest that there was.
        ln_weight[i] = (threshold + scale * quantile).ln().min(0.0);
    }
    Some(shape)
}

/// Shape and scale of a generalised Pareto distribution for values above zero in ascending order, the shape drawn
/// towards ½ as if by ten values; none where they are all alike.
fn pareto(values: &[f64]) -> Option<(f64, f64)> {
    const PRIOR_SCALE: f64 = 3.0;
    const PRIOR_VALUES: f64 = 10.0;
    let n = values.len() as f64;
    let (quartile, largest) = (values[(n / 4.0 + 0.5) as usize - 1], values[values.len() - 1]);
    let points = 30 + n.sqrt() as usize;
    let b: Vec<f64> = (1..=points)
        .map(|i| {
            let below = 1.0 - (points as f64 / (i as f64 - 0.5)).sqrt();
            below / (PRIOR_SCALE * quartile) + 1.0 / largest
        })
        .collect();
    let shape_at = |b: f64| values.iter().map(|y| (-b * y).ln_1p()).sum::<f64>() / n;
    let ln_profile: Vec<f64> = b
        .iter()
        .map(|&b| {
            let shape = shape_at(b);
            n * ((-b / shape).ln() - shape - 1.0)
        })
        .collect();
    let weights = normalised(&ln_profile).ok()?;
    let b = b.iter().zip(&weights).map(|(b, weight)| b * weight).sum::<f64>();
    let shape = shape_at(b);
    let drawn = (n * shape + 0.5 * PRIOR_VALUES) / (n + PRIOR_VALUES);
    let scale = -shape / b;
    (drawn.is_finite() && scale > 0.0 && scale.is_finite()).then_some((drawn, scale))
}

/// A row of the table `observable step control measured q05 q25 q50 q75 q95 pit k`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The observable.
    #[serde(serialize_with = "text")]
    pub observable: String,
    /// Number of the step among all of the measurement.
    pub step: u64,
    /// Value of the control.
    #[serde(serialize_with = "number")]
    pub control: f64,
    /// The reading.
    #[serde(serialize_with = "number")]
    pub measured: f64,
    /// Lower end of the 90 % band.
    #[serde(serialize_with = "number")]
    pub q05: f64,
    /// Lower end of the 50 % band.
    #[serde(serialize_with = "number")]
    pub q25: f64,
    /// Median.
    #[serde(serialize_with = "number")]
    pub q50: f64,
    /// Upper end of the 50 % band.
    #[serde(serialize_with = "number")]
    pub q75: f64,
    /// Upper end of the 90 % band.
    #[serde(serialize_with = "number")]
    pub q95: f64,
    /// See [`LeftOut::pit`].
    #[serde(serialize_with = "number")]
    pub pit: f64,
    /// See [`LeftOut::shape`].
    #[serde(serialize_with = "optional_number")]
    pub k: Option<f64>,
}

impl Reading {
    /// A row from what was found.
    pub fn new(observable: &str, (step, control, measured): (usize, f64, f64), found: &LeftOut) -> Self {
        let [q05, q25, q50, q75, q95] = found.quantiles;
        let (step, observable) = (step as u64, observable.to_owned());
        Self { observable, step, control, measured, q05, q25, q50, q75, q95, pit: found.pit, k: found.shape }
    }

    /// Whether it lies in the band that holds this share.
    pub fn is_inside(&self, share: f64) -> bool {
        (self.pit - 0.5).abs() <= 0.5 * share
    }
}

/// The shares that the bands hold.
const BANDS: [f64; 2] = [0.9, 0.5];

/// A count further out than with this probability, on either side, is not chance.
const CHANCE: f64 = 0.005;

/// How many readings lie in a band, and how many should in ninety-nine of a hundred measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// Readings inside.
    pub inside: u64,
    /// The fewest and the most that chance leaves.
    pub expected: (u64, u64),
}

impl Count {
    /// Of so many readings in the band that holds a share.
    pub fn new(readings: &[Reading], share: f64) -> Self {
        let inside = readings.iter().filter(|reading| reading.is_inside(share)).count() as u64;
        Self { inside, expected: chance(readings.len(), share, CHANCE) }
    }
}

/// How many of so many independent readings fall where each falls with this probability: the number that fewer do not
/// reach, and that which no more pass, but for a probability of `beyond` on either side.
fn chance(readings: usize, share: f64, beyond: f64) -> (u64, u64) {
    let n = readings as u64;
    let Ok(binomial) = Binomial::new(share, n) else { return (0, n) };
    // The inverse that statrs has ends in a panic at the end of the range.
    let quantile = |level: f64| {
        let (mut low, mut high) = (0, n);
        while low < high {
            let middle = low + (high - low) / 2;
            if binomial.cdf(middle) >= level { high = middle } else { low = middle + 1 }
        }
        low
    };
    (quantile(beyond), quantile(1.0 - beyond))
}

/// How many of the readings have their PIT in each of several even parts between 0 and 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    /// Readings in each part.
    pub counts: Vec<u64>,
    /// The fewest and the most that chance leaves in a part, in nine of ten.
    pub expected: (u64, u64),
}

impl Histogram {
    /// Ten parts of fifty readings or more, else five.
    pub fn new(readings: &[Reading]) -> Self {
        let parts = if readings.len() >= 50 { 10 } else { 5 };
        let mut counts = vec![0; parts];
        for reading in readings {
            counts[((reading.pit * parts as f64) as usize).min(parts - 1)] += 1;
        }
        Self { counts, expected: chance(readings.len(), 1.0 / parts as f64, 0.05) }
    }
}

/// In words, whether the measurement looks like a draw from the posterior predictive distribution: `covers`,
/// `too-few-inside` or `too-many-inside`, and `loo-unreliable`.
///
/// Readings are counted as independent of each other given what is predicted of each from all others, which is nearly
/// so where the parameters are far fewer than the readings.
///
/// * `is_restated` — whether the posterior counts with another noise than was stated, so that this is said.
pub fn verdicts(readings: &[Reading], is_restated: bool) -> Verdicts {
    let mut verdicts = Verdicts::default();
    if readings.is_empty() {
        return verdicts;
    }
    let n = readings.len();
    let counts = BANDS.map(|share| Count::new(readings, share));
    let too_few = |count: &Count| count.inside < count.expected.0;
    let too_many = |count: &Count| count.inside > count.expected.1;
    // The wide band first: where it is wrong, it says more.
    let at = counts.iter().position(too_few).or_else(|| counts.iter().position(too_many)).unwrap_or(0);
    let Count { inside, expected: (least, most) } = counts[at];
    let lie = format!(
        "{inside} of {n} readings lie in the {:.0} % band that the others predict for them",
        100.0 * BANDS[at]
    );
    let (code, text) = if too_few(&counts[at]) {
        (
            "too-few-inside",
            format!(
                "{lie}, where {least} to {most} should: they scatter more than the posterior says; the noise is larger \
                 than it is taken for, or the model lacks something"
            ),
        )
    } else if too_many(&counts[at]) {
        (
            "too-many-inside",
            format!(
                "{lie}, where {least} to {most} should: they scatter less than the posterior says; the noise is smaller \
                 than it is taken for"
            ),
        )
    } else {
        (
            "covers",
            format!(
                "{lie}, as they should ({least} to {most}): {}",
                if is_restated {
                    "by its neighbours and the noise as it is counted, said above, each reading is what was to be expected; \
                     whether the model misses the measurement this does not say"
                } else {
                    "the measurement looks like a draw from the posterior"
                }
            ),
        )
    };
    verdicts.add(code, format!("{:.3}", inside as f64 / n as f64), text);
    let is_doubtful = |reading: &&Reading| reading.k.is_some_and(|k| k > TRUSTED_SHAPE);
    let doubtful: Vec<&Reading> = readings.iter().filter(is_doubtful).collect();
    if let Some(first) = doubtful.first() {
        let (observable, step) = (&first.observable, first.step);
        let text = match doubtful.len() {
            1 => format!(
                "the reading of {observable} at step {step} decides much by itself: what the others predict of it rests on few \
                 draws and is rough (Pareto k above {TRUSTED_SHAPE})"
            ),
            count => format!(
                "{count} readings, that of {observable} at step {step} first, decide much by themselves: what the others predict \
                 of them rests on few draws and is rough (Pareto k above {TRUSTED_SHAPE})"
            ),
        };
        verdicts.add("loo-unreliable", doubtful.len(), text);
    }
    verdicts
}

#[cfg(test)]
mod tests {
    use super::*;
    use gl_numeric::normal::normal_quantile;
    use gl_numeric::sequence::{self, Method};
    use proptest::prelude::*;

    /// ln of the weights u^−k at n even places, as tests/oracle/loo.py has them.
    fn ln_weights(k: f64, n: usize) -> Vec<f64> {
        (0..n).map(|i| -k * ((i as f64 + 0.5) / n as f64).ln()).collect()
    }

    /// tests/oracle/loo.py: ArviZ.
    #[test]
    fn smoothed_weights_and_their_shape_are_those_of_arviz() {
        let oracle = gl_table::Table::read(std::path::Path::new("../../tests/oracle/loo.tsv")).unwrap();
        let numbers = |name: &str| oracle.numbers(name).unwrap();
        let (k, n, shape) = (numbers("k"), numbers("n"), numbers("shape"));
        assert!(oracle.len() >= 6);
        for row in 0..oracle.len() {
            let mut ln_weight = ln_weights(k[row], n[row] as usize);
            let found = smooth(&mut ln_weight).unwrap();
            assert!((found - shape[row]).abs() < 1e-10, "k of row {row}: {found} for {}", shape[row]);
            let weights = normalised(&ln_weight).unwrap();
            for rank in [1, 2, 10] {
                let right = numbers(&format!("largest{rank}"))[row];
                let found = weights[rank - 1];
                assert!((found / right - 1.0).abs() < 1e-9, "row {row}, rank {rank}: {found} for {right}");
            }
        }
    }

    /// Standard normal numbers, evenly spread in `dimensions` dimensions.
    fn normals(count: usize, dimensions: usize) -> Vec<Vec<f64>> {
        let points = sequence::points(Method::Sobol, count, dimensions, Some(7)).unwrap();
        points.iter().map(|point| point.iter().map(|u| normal_quantile(*u)).collect()).collect()
    }

    /// y = a + b x with noise of standard deviation 1 and a flat prior: of the posterior without reading i its residual
    /// is normal with mean r/(1 − h) and variance 1/(1 − h), r the residual of the fit and h its leverage.
    #[test]
    fn of_a_linear_gaussian_model_the_bands_and_pits_are_those_of_the_closed_form() {
        let x: Vec<f64> = (0..12).map(f64::from).collect();
        let noise = [0.3, -1.2, 0.8, 1.9, -0.4, 0.1, -2.1, 0.6, 1.1, -0.7, 0.2, -0.5];
        let y: Vec<f64> = x.iter().zip(noise).map(|(x, e)| 2.0 + 0.5 * x + e).collect();
        let n = x.len() as f64;
        let (centre, level) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
        let square: f64 = x.iter().map(|x| (x - centre).powi(2)).sum();
        let slope = x.iter().zip(&y).map(|(x, y)| (x - centre) * y).sum::<f64>() / square;
        // Of level and slope about the centre the posterior is independent.
        let draws = normals(4096, 2);
        for (i, (x, y)) in x.iter().zip(&y).enumerate() {
            let fitted = level + slope * (x - centre);
            let leverage = 1.0 / n + (x - centre).powi(2) / square;
            let given: Vec<Given> = draws
                .iter()
                .map(|z| {
                    let spread = z[0] / n.sqrt() + z[1] / square.sqrt() * (x - centre);
                    Given { mean: fitted + spread, sd: 1.0 }
                })
                .collect();
            let found = leave_out(*y, &given).unwrap();
            let (mean, sd) = (y - (y - fitted) / (1.0 - leverage), 1.0 / (1.0 - leverage).sqrt());
            let right = normal_cdf((y - mean) / sd);
            assert!((found.pit - right).abs() < 0.01, "reading {i}: {} for {right}", found.pit);
            for (quantile, level) in found.quantiles.iter().zip(LEVELS) {
                let right = mean + sd * normal_quantile(level);
                assert!((quantile - right).abs() < 0.05 * sd, "reading {i}: {quantile} for {right}");
            }
            assert!(found.shape.unwrap() < TRUSTED_SHAPE, "{:?}", found.shape);
            // The posterior that knows the reading is drawn towards it.
            let seen = normal_cdf((y - fitted) / (1.0 + leverage).sqrt());
            assert!((seen - 0.5).abs() < (found.pit - 0.5).abs(), "{seen} {}", found.pit);
        }
    }

    fn readings(pits: &[f64]) -> Vec<Reading> {
        let found = |pit| LeftOut { quantiles: [0.0; 5], pit, shape: Some(0.2) };
        pits.iter().enumerate().map(|(t, &pit)| Reading::new("q", (t, 0.0, 0.0), &found(pit))).collect()
    }

    #[test]
    fn readings_as_many_as_should_be_inside_are_covered_and_others_not() {
        let even: Vec<f64> = (0..100).map(|i| (f64::from(i) + 0.5) / 100.0).collect();
        let code = |pits: &[f64]| verdicts(&readings(pits), false).rows[0].code.clone();
        assert_eq!(code(&even), "covers");
        // scipy.stats.binom(100, 0.9).ppf([0.005, 0.995]) = [82, 97], of 0.5 [37, 63]
        assert_eq!(Count::new(&readings(&even), 0.9), Count { inside: 90, expected: (82, 97) });
        assert_eq!(Count::new(&readings(&even), 0.5), Count { inside: 50, expected: (37, 63) });
        assert_eq!(Count::new(&readings(&[0.5]), 0.9), Count { inside: 1, expected: (0, 1) });
        assert_eq!(Histogram::new(&readings(&even)).counts, vec![10; 10]);
        // scipy.stats.binom(100, 0.1).ppf([0.05, 0.95]) = [5, 15]
        assert_eq!(Histogram::new(&readings(&even)).expected, (5, 15));
        let spread = |power: f64| -> Vec<f64> {
            even.iter()
                .map(|u| 0.5 + 0.5 * (2.0 * u - 1.0).signum() * (2.0 * u - 1.0).abs().powf(power))
                .collect()
        };
        assert_eq!(code(&spread(0.4)), "too-few-inside");
        assert_eq!(code(&spread(3.0)), "too-many-inside");
        assert!(verdicts(&[], false).rows.is_empty());
        let mut doubtful = readings(&even);
        doubtful[3].k = Some(0.9);
        assert_eq!(verdicts(&doubtful, false).find("loo-unreliable").unwrap().value, "1");
    }

    proptest! {
        #[test]
        fn whatever_is_drawn_gives_numbers(
            measured in -1e6_f64..1e6,
            draws in proptest::collection::vec((-1e6_f64..1e6, 1e-6_f64..1e6), 1..200),
        ) {
            let given: Vec<Given> = draws.iter().map(|&(mean, sd)| Given { mean, sd }).collect();
            let found = leave_out(measured, &given).unwrap();
            prop_assert!((0.0..=1.0).contains(&found.pit));
            prop_assert!(found.quantiles.iter().all(|q| q.is_finite()));
            prop_assert!(found.quantiles.windows(2).all(|pair| pair[0] <= pair[1]));
            prop_assert!(found.shape.is_none_or(f64::is_finite));
        }
    }
}
