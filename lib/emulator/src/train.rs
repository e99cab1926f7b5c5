//! The search for hyperparameters.

use anyhow::{Context, Result};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::gp::{Gp, Hyperparameters, Likelihood, Mean, Points};
use super::minimise::{Minimum, Stop, minimise};

/// Lengths, in units of the range of an input. At the longest an input does nothing.
const LENGTHS: (f64, f64) = (0.02, 100.0);

/// Variance of the scatter over that of the process. The largest leave nothing but scatter.
const NUGGET_RATIOS: (f64, f64) = (1e-8, 1e4);

/// Lengths shorter than this are believed only with good reason: the prior is exp(−this/length),
/// flat towards long lengths, so that irrelevant inputs get long ones.
pub const SHORT_LENGTH: f64 = 0.1;

/// Points that the search from many places is done on; its cost grows with their cube.
const FIRST_POINTS: usize = 100;

/// Points that are enough to know the lengths and the nugget.
const MOST_POINTS: usize = 400;

/// ln of how many times likelier than scatter alone a curve must be that 100 points have suggested.
const CURVE: f64 = 3.0;

/// A length below this bends the curve, and has been fitted to the readings: each costs a factor e (Akaike 1974).
const BENT: f64 = 3.0;

const NO_FACTOR: &str = "no correlation lengths give a covariance with a Cholesky factor";

/// How to search.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Mean function.
    pub mean: Mean,
    /// Number of places that the search starts from.
    pub starts: usize,
    /// Lengths shorter than this are believed only with good reason.
    pub short_length: f64,
    /// Whether scatter alone is weighed against a curve that few of the points have suggested.
    pub may_be_scatter: bool,
}

/// Train a Gaussian process: the highest marginal likelihood, times a prior against short lengths.
///
/// The search starts from several places on up to 100 of the points, goes on from the best outcome on
/// up to 400, and all of them are conditioned on. What is found on few points may be their scatter: on
/// more, where that is asked for, a curve has to be 20 times as likely as nothing but scatter about the
/// mean function, and e times that for each length that bends it; where that is out of reach the search is given up.
///
/// * `rows` — inputs, shape (points, inputs).
/// * `points` — the same, with their mean function.
/// * `y` — readings, shape (points,).
/// * `known` — hyperparameters to start from, too; without any other start they are taken as they are.
///
/// # Errors
/// If no start has a likelihood.
pub fn train(
    rows: &[Vec<f64>],
    points: &Points,
    y: &[f64],
    search: Search,
    known: Option<&Hyperparameters>,
    generator: &mut ChaCha8Rng,
) -> Result<Gp> {
    let d = points.dimension();
    let known = known.filter(|known| known.lengths.len() == d);
    if let (0, Some(known)) = (search.starts, known) {
        return Gp::new(points, y, &Hyperparameters { variance: None, ..known.clone() });
    }
    let mut bounds = vec![(LENGTHS.0.ln(), LENGTHS.1.ln()); d];
    bounds.push((NUGGET_RATIOS.0.ln(), NUGGET_RATIOS.1.ln()));

    let mut starts = vec![vec![0.0; d + 1], vec![(0.5_f64).ln(); d + 1]];
    starts[0][d] = (1e-2_f64).ln();
    starts[1][d] = (1e-4_f64).ln();
    while starts.len() < search.starts.max(1) {
        let mut start: Vec<f64> =
            (0..d).map(|_| generator.random_range(0.2_f64.ln()..5.0_f64.ln())).collect();
        start.push(generator.random_range(1e-6_f64.ln()..1.0_f64.ln()));
        starts.push(start);
    }
    starts.truncate(search.starts.max(1));
    if let Some(known) = known {
        let start = known.lengths.iter().chain([&known.nugget_ratio]);
        starts.push(start.zip(&bounds).map(|(value, bounds)| value.ln().clamp(bounds.0, bounds.1)).collect());
    }

    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(generator);
    let coarse = Stop { iterations: 40, decrease: 1e-2, useful: f64::INFINITY };
    let fine = Stop { iterations: 100, decrease: 1e-3, ..coarse };
    let some = |count: usize| -> Result<(Points, Vec<f64>)> {
        let some_rows: Vec<Vec<f64>> = order[..count].iter().map(|&i| rows[i].clone()).collect();
        let some = Points::new(&some_rows, search.mean)?.with_kernel(points.kernel);
        Ok((some, order[..count].iter().map(|&i| y[i]).collect()))
    };
    if points.len() <= FIRST_POINTS {
        let found = best((points, y), &starts, &bounds, fine, search)?;
        return Gp::new(points, y, &hyperparameters(&found.x));
    }
    let (few, readings) = some(FIRST_POINTS)?;
    let start = best((&few, &readings), &starts, &bounds, coarse, search)?;
    let fewer = (points.len() > MOST_POINTS).then(|| some(MOST_POINTS)).transpose()?;
    let many = fewer.as_ref().map_or((points, y), |(points, y)| (points, y.as_slice()));
    // As many times as there are more points a likelihood bends more.
    let more = many.0.len() as f64 / FIRST_POINTS as f64;
    let inverse_hessian = start.inverse_hessian.map(|rows| scaled(rows, 1.0 / more));
    let objective_of_many = |theta: &[f64]| objective(many.0, many.1, theta, search.short_length);
    let scatter: Vec<f64> = bounds.iter().map(|(_, highest)| *highest).collect();
    let of_scatter = search.may_be_scatter.then(|| objective_of_many(&scatter)).flatten();
    let of_scatter = of_scatter.map(|(value, _)| value);
    let stop = Stop { useful: of_scatter.map_or(f64::INFINITY, |value| value - CURVE), ..fine };
    let Minimum { x: theta, value, .. } =
        minimise(objective_of_many, &start.x, inverse_hessian, &bounds, stop).context(NO_FACTOR)?;
    let bent = theta[..d].iter().filter(|length| length.exp() < BENT).count() as f64;
    let is_scatter = of_scatter.is_some_and(|of_scatter| of_scatter < value + CURVE + bent);
    if is_scatter {
        return Gp::scatter(points, y, &hyperparameters(&scatter));
    }
    Gp::new(points, y, &hyperparameters(&theta))
}

/// The best outcome of a search from each start.
fn best(
    (points, y): (&Points, &[f64]),
    starts: &[Vec<f64>],
    bounds: &[(f64, f64)],
    stop: Stop,
    search: Search,
) -> Result<Minimum> {
    let objective = |theta: &[f64]| objective(points, y, theta, search.short_length);
    let outcomes = starts.iter().filter_map(|start| minimise(objective, start, None, bounds, stop));
    outcomes.min_by(|a, b| a.value.total_cmp(&b.value)).context(NO_FACTOR)
}

fn scaled(rows: Vec<Vec<f64>>, by: f64) -> Vec<Vec<f64>> {
    rows.into_iter().map(|row| row.into_iter().map(|value| by * value).collect()).collect()
}

fn hyperparameters(theta: &[f64]) -> Hyperparameters {
    let (nugget_ratio, lengths) =
        theta.split_last().map_or((0.0, &[][..]), |(last, rest)| (last.exp(), rest));
    Hyperparameters { lengths: lengths.iter().map(|l| l.exp()).collect(), nugget_ratio, variance: None }
}

/// Minus the logarithm of likelihood times prior, and its gradient.
fn objective(
    points: &Points,
    y: &[f64],
    theta: &[f64],
    short: f64,
) -> Option<(f64, impl FnOnce() -> Vec<f64> + use<>)> {
    let hyper = hyperparameters(theta);
    let likelihood = Likelihood::new(points, y, &hyper).ok()?;
    let lengths = hyper.lengths;
    let value = lengths.iter().fold(-likelihood.ln, |value, length| value + short / length);
    let gradient = move || {
        let mut gradient: Vec<f64> = likelihood.gradient().iter().map(|g| -g).collect();
        gradient.iter_mut().zip(&lengths).for_each(|(g, length)| *g -= short / length);
        gradient
    };
    value.is_finite().then_some((value, gradient))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    /// Trained on readings at 150 points of 12 inputs, from a curve and a scatter of variance 1.
    fn trained(seed: u64, curve: impl Fn(&[f64]) -> f64) -> Gp {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut row = || -> Vec<f64> { (0..24).map(|_| random.random_range(0.0..1.0)).collect() };
        let rows: Vec<Vec<f64>> = (0..150).map(|_| row()).collect();
        // The sum of twelve numbers between 0 and 1 has variance 1.
        let y: Vec<f64> = rows.iter().map(|x| curve(x) + x[12..].iter().sum::<f64>()).collect();
        let rows: Vec<Vec<f64>> = rows.iter().map(|x| x[..12].to_vec()).collect();
        let points = Points::new(&rows, Mean::Linear).unwrap();
        let search =
            Search { mean: Mean::Linear, starts: 4, short_length: SHORT_LENGTH, may_be_scatter: true };
        train(&rows, &points, &y, search, None, &mut random).unwrap()
    }

    #[test]
    fn scatter_is_not_taken_for_a_curve() {
        for seed in 0..6 {
            let nugget = trained(seed, |_| 0.0).nugget();
            assert!((0.75..1.35).contains(&nugget), "{seed}: {nugget}");
        }
    }

    #[test]
    fn a_curve_under_scatter_is_found() {
        let gp = trained(1, |x| 8.0 * (5.0 * x[0]).sin());
        let at = |x: f64| gp.mean(&[&[x][..], &[0.5; 11]].concat());
        for x in [0.1_f64, 0.3, 0.6, 0.9] {
            let expected = 8.0 * ((5.0 * x).sin() - 2.5_f64.sin());
            assert!((at(x) - at(0.5) - expected).abs() < 1.5, "{x}: {} {expected}", at(x) - at(0.5));
        }
    }
}
