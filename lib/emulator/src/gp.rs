//! A Gaussian process with a mean function estimated by generalised least squares.
//!
//! y = H β + f + ε, with f a Gaussian process of covariance s² R, R the correlation of a [`Kernel`]
//! with a length an input, and ε independent of variance s² η: the scatter of the simulation itself. β is
//! integrated over a flat prior (restricted likelihood, Harville 1974), s² is estimated.

use anyhow::Result;
use pulp::{Arch, Simd, with_simd};

use super::cholesky::{Cholesky, Triangle, UpperTriangle, dot, lower_times, upper_times_transpose};
use super::kernel::ScaledPoints;
pub use super::points::{Kernel, Mean, Points};

/// What training finds.
#[derive(Clone, Debug, PartialEq)]
pub struct Hyperparameters {
    /// Correlation length along each input.
    pub lengths: Vec<f64>,
    /// η, the variance of the scatter over that of the process.
    pub nugget_ratio: f64,
    /// s², the variance of the process; estimated from the readings if absent.
    pub variance: Option<f64>,
}

/// The factors of a covariance s² A, A = R + η I, with the mean function projected out of it.
struct Factors {
    scaled: ScaledPoints,
    /// −2 dR/dr², lower half; empty if not asked for.
    slopes: Triangle,
    cholesky: Cholesky,
    /// L⁻¹ H, shape (terms, points).
    terms: Vec<Vec<f64>>,
    /// Factor of Hᵀ A⁻¹ H, if the mean has terms.
    information: Option<Cholesky>,
    degrees: f64,
}

impl Factors {
    fn new(points: &Points, lengths: &[f64], nugget_ratio: f64, with_slopes: bool) -> Result<Self> {
        let n = points.n;
        let scaled = ScaledPoints::new(points.kernel, &points.inputs, lengths);
        let mut a = Triangle::zeros(n);
        let mut slopes = Triangle::zeros(if with_slopes { n } else { 0 });
        for i in 0..n {
            let at = scaled.point(i);
            let slope = with_slopes.then(|| slopes.row_mut(i));
            let row = a.row_mut(i);
            scaled.correlate(&at, row, slope);
            row[i] += nugget_ratio;
        }
        let cholesky = Cholesky::new(&a)?;
        let mut terms = points.terms.clone();
        terms.iter_mut().for_each(|term| cholesky.solve_lower(term));
        let mut information = Triangle::zeros(terms.len());
        for i in 0..terms.len() {
            for j in 0..=i {
                information.row_mut(i)[j] = dot(&terms[i], &terms[j]);
            }
        }
        let information = (!terms.is_empty()).then(|| Cholesky::new(&information)).transpose()?;
        let degrees = (n - terms.len()) as f64;
        Ok(Self { scaled, slopes, cholesky, terms, information, degrees })
    }

    /// The estimate of β, and P y = A⁻¹ (y − H β).
    fn residual(&self, y: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut rest = y.to_vec();
        self.cholesky.solve_lower(&mut rest);
        let mut beta: Vec<f64> = self.terms.iter().map(|term| dot(term, &rest)).collect();
        if let Some(information) = &self.information {
            information.solve(&mut beta);
        }
        for (term, beta) in self.terms.iter().zip(&beta) {
            rest.iter_mut().zip(term).for_each(|(y, h)| *y -= beta * h);
        }
        self.cholesky.solve_upper(&mut rest);
        (beta, rest)
    }

    /// P = A⁻¹ − A⁻¹ H (Hᵀ A⁻¹ H)⁻¹ Hᵀ A⁻¹, lower half.
    ///
    /// * `upper_inverse` — L⁻ᵀ.
    fn projection(&self, upper_inverse: &UpperTriangle) -> Triangle {
        let mut p = upper_times_transpose(upper_inverse);
        let Some(information) = &self.information else { return p };
        // Rows of E = L_G⁻¹ Hᵀ A⁻¹, so that what is taken away is Eᵀ E.
        let mut rows = self.terms.clone();
        rows.iter_mut().for_each(|row| self.cholesky.solve_upper(row));
        let n = p.n();
        let mut column = vec![0.0; rows.len()];
        for i in 0..n {
            column.iter_mut().zip(&rows).for_each(|(c, row)| *c = row[i]);
            information.solve_lower(&mut column);
            rows.iter_mut().zip(&column).for_each(|(row, c)| row[i] = *c);
        }
        p.subtract_products(&rows);
        p
    }
}

/// The restricted marginal likelihood of readings, whose gradient costs twice as much as its value.
///
/// ln p = −½ ln|A| − ½ ln|Hᵀ A⁻¹ H| − ½ (n − p) ln(2π s²) − yᵀ P y / (2 s²), with
/// P = A⁻¹ − A⁻¹ H (Hᵀ A⁻¹ H)⁻¹ Hᵀ A⁻¹ and s² = yᵀ P y / (n − p) unless it is given.
///
/// # Source
/// Rasmussen & Williams (2006), Gaussian Processes for Machine Learning, §2.7 and §5.4.1.
pub struct Likelihood {
    /// Its natural logarithm.
    pub ln: f64,
    factors: Factors,
    /// P y.
    residual: Vec<f64>,
    variance: f64,
    nugget_ratio: f64,
}

impl Likelihood {
    /// At the given or the estimated variance.
    ///
    /// * `y` — readings, shape (points,).
    ///
    /// # Errors
    /// If the covariance has no Cholesky factor.
    pub fn new(points: &Points, y: &[f64], hyper: &Hyperparameters) -> Result<Self> {
        let factors = Factors::new(points, &hyper.lengths, hyper.nugget_ratio, true)?;
        let (_, residual) = factors.residual(y);
        let square = dot(y, &residual).max(f64::MIN_POSITIVE);
        let variance = hyper.variance.unwrap_or(square / factors.degrees);
        let ln = -0.5 * factors.cholesky.ln_determinant()
            - 0.5 * factors.information.as_ref().map_or(0.0, Cholesky::ln_determinant)
            - 0.5 * factors.degrees * (std::f64::consts::TAU * variance).ln()
            - 0.5 * square / variance;
        Ok(Self { ln, factors, residual, variance, nugget_ratio: hyper.nugget_ratio })
    }

    /// Its derivatives by the logarithms of the lengths and, last, of the nugget ratio.
    pub fn gradient(&self) -> Vec<f64> {
        let Self { factors, residual: b, variance, nugget_ratio, .. } = self;
        let p = factors.projection(&factors.cholesky.upper_inverse());
        // yᵀ P dA P y / s² − tr(P dA), half of it, element by element of dA.
        let mut gradient = vec![0.0; factors.scaled.dimension()];
        let scaled: Vec<f64> = b.iter().map(|b| b / variance).collect();
        by_lengths(factors, &p, (b, &scaled), &mut gradient);
        let of_nugget = |i: usize| 0.5 * nugget_ratio * (b[i] * scaled[i] - p.row(i)[i]);
        gradient.push((0..b.len()).map(of_nugget).sum());
        gradient
    }
}

/// Add the derivatives by the logarithms of the lengths, at the width of the machine's vectors.
///
/// * `residuals` — P y, and the same over s², shape (points,).
#[with_simd(by_lengths = Arch::new())]
#[inline(always)]
fn by_lengths_wide<'a, S: Simd>(
    _width: S,
    factors: &'a Factors,
    p: &'a Triangle,
    (b, scaled): (&'a [f64], &'a [f64]),
    gradient: &'a mut [f64],
) {
    let mut weights = vec![0.0; b.len()];
    for (i, scale) in scaled.iter().enumerate() {
        let (row, slopes) = (p.row(i), factors.slopes.row(i));
        for j in 0..i {
            weights[j] = (b[j] * scale - row[j]) * slopes[j];
        }
        for (q, sum) in gradient.iter_mut().enumerate() {
            let input = factors.scaled.input(q);
            *sum += weighted_squares(&weights[..i], input, input[i]);
        }
    }
}

/// Σ wⱼ (xⱼ − at)².
#[inline(always)]
fn weighted_squares(weights: &[f64], x: &[f64], at: f64) -> f64 {
    let (w, w_rest) = weights.as_chunks::<4>();
    let (x, x_rest) = x[..weights.len()].as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (w, x) in w.iter().zip(x) {
        for l in 0..4 {
            sums[l] += w[l] * (x[l] - at) * (x[l] - at);
        }
    }
    sums.iter().sum::<f64>() + w_rest.iter().zip(x_rest).map(|(w, x)| w * (x - at) * (x - at)).sum::<f64>()
}

/// A Gaussian process conditioned on its readings.
#[derive(Clone, Debug)]
pub struct Gp {
    points: Points,
    hyper: Hyperparameters,
    variance: f64,
    beta: Vec<f64>,
    /// Factor of Hᵀ A⁻¹ H, if the mean has terms.
    information: Option<Cholesky>,
    /// What it has beside the mean function, if that is not scatter alone.
    curved: Option<Curved>,
    left_out: LeftOut,
}

/// What a process has beside its mean function.
#[derive(Clone, Debug)]
struct Curved {
    scaled: ScaledPoints,
    /// A⁻¹ (y − H β).
    alpha: Vec<f64>,
    /// L⁻¹.
    lower_inverse: Triangle,
    /// L⁻¹ H, shape (terms, points).
    terms: Vec<Vec<f64>>,
}

/// A point as the covariance of a process sees it; see [`Gp::place`].
#[derive(Clone, Debug)]
pub struct Place {
    at: Vec<f64>,
    whitened: Vec<f64>,
    terms: Vec<f64>,
}

/// Leave-one-out predictions of each reading from all the others.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Mean, shape (points,).
    pub mean: Vec<f64>,
    /// Variance of a reading, the nugget included, shape (points,).
    pub variance: Vec<f64>,
}

impl Gp {
    /// Condition on readings.
    ///
    /// * `y` — readings, shape (points,).
    ///
    /// # Errors
    /// If the covariance has no Cholesky factor.
    pub fn new(points: &Points, y: &[f64], hyper: &Hyperparameters) -> Result<Self> {
        let factors = Factors::new(points, &hyper.lengths, hyper.nugget_ratio, false)?;
        let (beta, alpha) = factors.residual(y);
        let variance = hyper.variance.unwrap_or(dot(y, &alpha) / factors.degrees).max(f64::MIN_POSITIVE);
        let upper_inverse = factors.cholesky.upper_inverse();
        let p = factors.projection(&upper_inverse);
        let n = points.n;
        let left_out = LeftOut {
            mean: (0..n).map(|i| y[i] - alpha[i] / p.row(i)[i]).collect(),
            variance: (0..n).map(|i| variance / p.row(i)[i]).collect(),
        };
        let lower_inverse = upper_inverse.transposed();
        let Factors { scaled, terms, information, .. } = factors;
        let curved = Some(Curved { scaled, alpha, lower_inverse, terms });
        Ok(Self {
            points: points.clone(),
            hyper: hyper.clone(),
            variance,
            beta,
            information,
            curved,
            left_out,
        })
    }

    /// Nothing but scatter about the mean function, R = 0: least squares.
    ///
    /// * `y` — readings, shape (points,).
    ///
    /// # Errors
    /// If the terms of the mean function follow from each other.
    pub fn scatter(points: &Points, y: &[f64], hyper: &Hyperparameters) -> Result<Self> {
        let terms = &points.terms;
        let mut products = Triangle::zeros(terms.len());
        for (i, term) in terms.iter().enumerate() {
            for (j, other) in terms[..=i].iter().enumerate() {
                products.row_mut(i)[j] = dot(term, other) / hyper.nugget_ratio;
            }
        }
        let information = (!terms.is_empty()).then(|| Cholesky::new(&products)).transpose()?;
        let mut beta: Vec<f64> = terms.iter().map(|term| dot(term, y) / hyper.nugget_ratio).collect();
        if let Some(information) = &information {
            information.solve(&mut beta);
        }
        let mut rest = y.to_vec();
        for (term, beta) in terms.iter().zip(&beta) {
            rest.iter_mut().zip(term).for_each(|(y, h)| *y -= beta * h);
        }
        let degrees = (points.n - terms.len()) as f64;
        let estimated = || dot(&rest, &rest) / degrees / hyper.nugget_ratio;
        let variance = hyper.variance.unwrap_or_else(estimated).max(f64::MIN_POSITIVE);
        // What is left of each reading when the mean function follows it.
        let left = |i: usize| {
            let mut own: Vec<f64> = terms.iter().map(|term| term[i]).collect();
            if let Some(information) = &information {
                information.solve_lower(&mut own);
            }
            1.0 - dot(&own, &own) / hyper.nugget_ratio
        };
        let left: Vec<f64> = (0..points.n).map(left).collect();
        let left_out = LeftOut {
            mean: y.iter().zip(&rest).zip(&left).map(|((y, rest), left)| y - rest / left).collect(),
            variance: left.iter().map(|left| variance * hyper.nugget_ratio / left).collect(),
        };
        let (points, hyper) = (points.clone(), hyper.clone());
        Ok(Self { points, hyper, variance, beta, information, curved: None, left_out })
    }

    /// The hyperparameters, with the variance.
    pub fn hyperparameters(&self) -> Hyperparameters {
        Hyperparameters { variance: Some(self.variance), ..self.hyper.clone() }
    }

    /// Variance of the scatter, s² η.
    pub fn nugget(&self) -> f64 {
        self.variance * self.hyper.nugget_ratio
    }

    /// Predictions of each reading from all the others, at the same hyperparameters and with the
    /// mean function estimated anew: yᵢ − (P y)ᵢ / Pᵢᵢ, with variance s² / Pᵢᵢ.
    ///
    /// # Source
    /// Rasmussen & Williams (2006), §5.4.2; with a mean function Dubrule (1983), Math. Geol. 15:687.
    pub fn leave_one_out(&self) -> &LeftOut {
        &self.left_out
    }

    /// Mean of the process at a point, shape (inputs,).
    pub fn mean(&self, x: &[f64]) -> f64 {
        self.mean_from(x, &self.correlations(x))
    }

    /// Mean and variance of the process at a point: the emulator's ignorance, without the nugget.
    pub fn predict(&self, x: &[f64]) -> (f64, f64) {
        self.predict_all(&[x])[0]
    }

    /// The same at several points, shape (points, inputs), which costs less than one after the other.
    pub fn predict_all(&self, points: &[impl AsRef<[f64]>]) -> Vec<(f64, f64)> {
        let points = points.iter().map(AsRef::as_ref);
        let k: Vec<Vec<f64>> = points.clone().map(|x| self.correlations(x)).collect();
        let whitened = self.whitened(&k);
        let both = points.zip(&k).zip(&whitened);
        both.map(|((x, k), v)| (self.mean_from(x, k), self.variance_from(x, v))).collect()
    }

    /// Mean of the process at a point and its derivative by each input.
    pub fn mean_gradient(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let mut k = vec![0.0; self.points.n];
        let mut gradient = vec![0.0; x.len()];
        if let Some(Curved { scaled, alpha, .. }) = &self.curved {
            let at = self.scale(x);
            let mut slope = vec![0.0; self.points.n];
            scaled.correlate(&at, &mut k, Some(&mut slope));
            slope.iter_mut().zip(alpha).for_each(|(slope, alpha)| *slope *= alpha);
            let total: f64 = slope.iter().sum();
            for (q, gradient) in gradient.iter_mut().enumerate() {
                *gradient = (dot(&slope, scaled.input(q)) - total * at[q]) / self.hyper.lengths[q];
            }
        }
        let first = usize::from(self.points.has_constant);
        for (&q, beta) in self.points.sloped.iter().zip(&self.beta[first..]) {
            gradient[q] += beta;
        }
        (self.mean_from(x, &k), gradient)
    }

    /// What the covariance of the process at a point with that at others needs.
    pub fn place(&self, x: &[f64]) -> Place {
        let whitened = self.whitened(&[self.correlations(x)]).remove(0);
        Place { at: self.scale(x), terms: self.unexplained_terms(x, &whitened), whitened }
    }

    /// Covariance of the process at two points, given the readings.
    pub fn covariance(&self, a: &Place, b: &Place) -> f64 {
        let before = self.curved.as_ref().map_or(0.0, |curved| curved.scaled.correlation(&a.at, &b.at));
        self.variance * (before - dot(&a.whitened, &b.whitened) + dot(&a.terms, &b.terms))
    }

    fn scale(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.hyper.lengths).map(|(x, length)| x / length).collect()
    }

    /// Correlations of the readings with a point, k, shape (points,); none where there is scatter alone.
    fn correlations(&self, x: &[f64]) -> Vec<f64> {
        let Some(curved) = &self.curved else { return Vec::new() };
        let mut k = vec![0.0; self.points.n];
        curved.scaled.correlate(&self.scale(x), &mut k, None);
        k
    }

    /// L⁻¹ k of each.
    fn whitened(&self, k: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let scatter = || vec![Vec::new(); k.len()];
        self.curved.as_ref().map_or_else(scatter, |curved| lower_times(&curved.lower_inverse, k))
    }

    fn mean_from(&self, x: &[f64], k: &[f64]) -> f64 {
        let curve = self.curved.as_ref().map_or(0.0, |curved| dot(k, &curved.alpha));
        dot(&self.points.terms_at(x), &self.beta) + curve
    }

    /// Variance at a point; `v` is L⁻¹ k.
    fn variance_from(&self, x: &[f64], v: &[f64]) -> f64 {
        let rest = self.unexplained_terms(x, v);
        let before = if self.curved.is_some() { 1.0 } else { 0.0 };
        self.variance * (before - dot(v, v) + dot(&rest, &rest)).max(0.0)
    }

    /// What the readings leave open of the mean function at a point, whitened; `v` is L⁻¹ k.
    fn unexplained_terms(&self, x: &[f64], v: &[f64]) -> Vec<f64> {
        let mut rest = self.points.terms_at(x);
        if let Some(curved) = &self.curved {
            rest.iter_mut().zip(&curved.terms).for_each(|(h, term)| *h -= dot(term, v));
        }
        if let Some(information) = &self.information {
            information.solve_lower(&mut rest);
        }
        rest
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    }

    fn rows(value: &Value) -> Vec<Vec<f64>> {
        value.as_array().unwrap().iter().map(numbers).collect()
    }

    fn near(here: f64, there: f64, tolerance: f64) {
        assert!((here - there).abs() <= tolerance * there.abs().max(1.0), "{here} is not {there}");
    }

    /// Readings of a smooth function of three inputs, the third of which does nothing.
    fn example(n: usize) -> (Vec<Vec<f64>>, Vec<f64>) {
        let row = |i: usize| -> Vec<f64> {
            [0.754_877_666, 0.569_840_291, 0.430_159_709].iter().map(|a| (a * i as f64).fract()).collect()
        };
        let rows: Vec<_> = (1..=n).map(row).collect();
        let y = rows.iter().map(|x: &Vec<f64>| (5.0 * x[0]).sin() + 3.0 * x[1] - x[0] * x[1]).collect();
        (rows, y)
    }

    fn hyper(variance: Option<f64>) -> Hyperparameters {
        Hyperparameters { lengths: vec![0.5, 0.8, 3.0], nugget_ratio: 1e-2, variance }
    }

    /// tests/oracle/gp.py: scikit-learn at fixed hyperparameters.
    #[test]
    fn likelihood_gradient_and_predictions_are_those_of_scikit_learn() {
        let oracle: Value = serde_json::from_str(include_str!("../../../tests/oracle/gp.json")).unwrap();
        let points = Points::new(&rows(&oracle["x"]), Mean::Zero).unwrap();
        let y = numbers(&oracle["y"][0]);
        for fit in oracle["fits"].as_array().unwrap() {
            let (amplitude2, noise) = (fit["amplitude2"].as_f64().unwrap(), fit["noise"].as_f64().unwrap());
            let hyper = Hyperparameters {
                lengths: numbers(&fit["lengths"]),
                nugget_ratio: noise / amplitude2,
                variance: Some(amplitude2),
            };
            let likelihood = Likelihood::new(&points, &y, &hyper).unwrap();
            let gradient = likelihood.gradient();
            near(likelihood.ln, fit["ln_marginal_likelihood"].as_f64().unwrap(), 1e-8);
            for (here, there) in gradient.iter().zip(&numbers(&fit["gradient"])[1..]) {
                near(*here, *there, 1e-6);
            }
            let gp = Gp::new(&points, &y, &hyper).unwrap();
            let (means, sds) = (numbers(&fit["mean"]), numbers(&fit["sd_latent"]));
            for ((at, there), sd) in rows(&oracle["at"]).iter().zip(means).zip(sds) {
                let (mean, variance) = gp.predict(at);
                near(mean, there, 1e-8);
                near(variance.sqrt(), sd, 1e-6);
            }
            let left_out = gp.leave_one_out();
            for (here, there) in left_out.mean.iter().zip(numbers(&fit["loo_mean"])) {
                near(*here, there, 1e-6);
            }
            for (here, there) in left_out.variance.iter().zip(numbers(&fit["loo_variance"])) {
                near(*here, there, 1e-6);
            }
        }
    }

    #[test]
    fn the_gradient_is_the_difference_quotient_of_the_likelihood() {
        let (rows, y) = example(25);
        for (mean, kernel) in
            [(Mean::Zero, Kernel::Matern), (Mean::Constant, Kernel::Gaussian), (Mean::Linear, Kernel::Matern)]
        {
            let points = Points::new(&rows, mean).unwrap().with_kernel(kernel);
            for variance in [None, Some(0.7)] {
                let gradient = Likelihood::new(&points, &y, &hyper(variance)).unwrap().gradient();
                for (q, derivative) in gradient.iter().enumerate() {
                    let at = |step: f64| {
                        let mut hyper = hyper(variance);
                        match hyper.lengths.get_mut(q) {
                            Some(length) => *length *= step.exp(),
                            None => hyper.nugget_ratio *= step.exp(),
                        }
                        Likelihood::new(&points, &y, &hyper).unwrap().ln
                    };
                    near(*derivative, (at(1e-5) - at(-1e-5)) / 2e-5, 1e-6);
                }
            }
        }
    }

    #[test]
    fn another_reading_lowers_the_variance_by_the_covariance_with_it() {
        let (rows, y) = example(20);
        for kernel in [Kernel::Matern, Kernel::Gaussian] {
            let points = |n: usize| Points::new(&rows[..n], Mean::Linear).unwrap().with_kernel(kernel);
            let before = Gp::new(&points(19), &y[..19], &hyper(Some(1.3))).unwrap();
            let after = Gp::new(&points(20), &y, &hyper(Some(1.3))).unwrap();
            let (at, new) = (vec![0.2, 0.4, 0.9], &rows[19]);
            let (a, b) = (before.place(&at), before.place(new));
            near(before.covariance(&a, &a), before.predict(&at).1, 1e-12);
            let covariance = before.covariance(&a, &b);
            let reading = before.covariance(&b, &b) + before.nugget();
            near(after.predict(&at).1, before.predict(&at).1 - covariance * covariance / reading, 1e-10);
        }
    }

    #[test]
    fn scatter_alone_is_what_a_process_comes_near_to() {
        let (rows, y) = example(20);
        let at = vec![0.2, 0.4, 0.9];
        for mean in [Mean::Zero, Mean::Constant, Mean::Linear] {
            let points = Points::new(&rows, mean).unwrap();
            // A process of a thousandth of the scatter, and one that is left away.
            let hyper = Hyperparameters { nugget_ratio: 1e3, ..hyper(Some(1e-3)) };
            let curved = Gp::new(&points, &y, &hyper).unwrap();
            let scatter = Gp::scatter(&points, &y, &hyper).unwrap();
            let (mean, slopes) = scatter.mean_gradient(&at);
            near(mean, curved.mean(&at), 0.05);
            for (here, there) in slopes.iter().zip(curved.mean_gradient(&at).1) {
                near(*here, there, 0.05);
            }
            near(scatter.predict(&at).1, curved.predict(&at).1, 2e-3);
            near(scatter.covariance(&scatter.place(&at), &scatter.place(&at)), scatter.predict(&at).1, 1e-12);
            let (here, there) = (scatter.leave_one_out(), curved.leave_one_out());
            for i in 0..rows.len() {
                near(here.mean[i], there.mean[i], 0.05);
                near(here.variance[i], there.variance[i], 5e-3);
            }
        }
    }

    #[test]
    fn leaving_one_out_in_closed_form_is_leaving_it_out() {
        let (rows, y) = example(20);
        let all = [Mean::Constant, Mean::Linear].map(|mean| [(mean, false), (mean, true)]);
        for (mean, is_scatter) in all.into_iter().flatten() {
            let of = if is_scatter { Gp::scatter } else { Gp::new };
            let hyper = hyper(Some(1.3));
            let gp = of(&Points::new(&rows, mean).unwrap(), &y, &hyper).unwrap();
            for i in 0..rows.len() {
                let (mut other_rows, mut other_y) = (rows.clone(), y.clone());
                other_rows.remove(i);
                other_y.remove(i);
                let others = of(&Points::new(&other_rows, mean).unwrap(), &other_y, &hyper).unwrap();
                let (mean, variance) = others.predict(&rows[i]);
                near(gp.leave_one_out().mean[i], mean, 1e-9);
                near(gp.leave_one_out().variance[i], variance + others.nugget(), 1e-9);
            }
        }
    }

    #[test]
    fn predictions_at_several_points_are_those_at_each() {
        let (rows, y) = example(30);
        let points = Points::new(&rows, Mean::Linear).unwrap();
        let at: Vec<Vec<f64>> = (0..7).map(|i| vec![0.1 * f64::from(i), 0.4, 0.9]).collect();
        for gp in
            [Gp::new(&points, &y, &hyper(None)).unwrap(), Gp::scatter(&points, &y, &hyper(None)).unwrap()]
        {
            let each: Vec<(f64, f64)> = at.iter().map(|x| gp.predict(x)).collect();
            assert_eq!(gp.predict_all(&at), each);
            assert!(gp.predict_all(&at[..0]).is_empty());
        }
    }

    #[test]
    fn derivatives_of_the_mean_are_its_difference_quotients() {
        let (rows, y) = example(30);
        let gp = Gp::new(&Points::new(&rows, Mean::Linear).unwrap(), &y, &hyper(None)).unwrap();
        let at = vec![0.31, -0.2, 0.77];
        let (mean, gradient) = gp.mean_gradient(&at);
        near(mean, gp.mean(&at), 1e-14);
        for (q, derivative) in gradient.iter().enumerate() {
            let shifted = |step: f64| {
                let mut x = at.clone();
                x[q] += step;
                gp.mean(&x)
            };
            near(*derivative, (shifted(1e-5) - shifted(-1e-5)) / 2e-5, 1e-7);
        }
    }

    #[test]
    fn a_linear_function_is_met_far_outside_the_points_with_a_linear_mean() {
        let (rows, _) = example(12);
        let y: Vec<f64> = rows.iter().map(|x| 2.0 - 3.0 * x[0] + 0.5 * x[2]).collect();
        let gp = Gp::new(&Points::new(&rows, Mean::Linear).unwrap(), &y, &hyper(None)).unwrap();
        near(gp.mean(&[10.0, 5.0, -4.0]), 2.0 - 30.0 - 2.0, 1e-8);
    }

    #[test]
    fn inputs_that_follow_from_others_are_no_term_of_the_mean() {
        let (mut rows, y) = example(15);
        rows.iter_mut().for_each(|row| row[2] = 1.0 - row[0]);
        let points = Points::new(&rows, Mean::Linear).unwrap();
        assert_eq!(points.sloped, [0, 1]);
        assert!(Likelihood::new(&points, &y, &hyper(None)).unwrap().ln.is_finite());
    }
}
