//! Whether a hypothesis that wins also fits: the best of several that are all wrong is no answer.

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::attribute::evidence::mode::Mode;
use crate::attribute::evidence::model::Model;
use gl_inference::fit::smallest_of;
use gl_numeric::quadratic::exceedance;

/// Below this predictive probability a hypothesis does not fit.
pub const INADEQUATE: f64 = 0.01;

/// The base model fits if its predictive probability is above this: then there is no gap that a cause would have to explain.
pub const FITS: f64 = 0.05;

/// Probability, under a hypothesis, of a measurement at least as odd as the one made.
///
/// About its mode the model is straight, so that the measurement is normal with covariance
/// C = Σ + J Jᵀ (J the slopes by the parameters, whose prior is standard normal). Oddness is the worst
/// of: rᵀC⁻¹r, which sees a misfit of any shape, against χ²; and for each observable the score
/// rᵀC⁻¹KC⁻¹r against its own distribution, which sees a smooth discrepancy with correlation K, much
/// earlier. The smallest probability is raised for having been the smallest of several (Šidák).
///
/// # Errors
/// If the covariance is not finite.
pub fn predictive_probability(model: &Model<'_>, mode: &Mode) -> Result<f64> {
    let problem = model.problem();
    let w = mode.w.as_slice();
    let curve = model.curve(w);
    let (_, slopes) = model.gradient(w);
    let own = DVector::from_column_slice(&w[..model.curve_parameters()]);
    let residual = DVector::from_vec(model.residual(&curve.mean)) + &slopes * own;
    // Σ as it stands at the mode, with the parameters' share added to it.
    let observables = problem.ranges.len();
    let odd = DMatrix::from_column_slice(residual.len(), 1, residual.as_slice());
    let patterns: Vec<usize> = (0..observables).map(|j| problem.test_of(j).smooth.len()).collect();
    let mut smooth = DMatrix::zeros(residual.len(), patterns.iter().sum());
    let mut first = 0;
    for (j, count) in patterns.iter().enumerate() {
        let of = &problem.test_of(j).smooth;
        let block = problem.own(j);
        for pattern in 0..*count {
            let scaled = of.patterns.column(pattern) * of.variances[pattern].sqrt();
            smooth.view_mut((block.start, first + pattern), (block.len(), 1)).copy_from(&scaled);
        }
        first += count;
    }
    let all = DMatrix::from_fn(residual.len(), 1 + smooth.ncols() + slopes.ncols(), |i, k| {
        match k.checked_sub(1) {
            None => odd[i],
            Some(k) if k < smooth.ncols() => smooth[(i, k)],
            Some(k) => slopes[(i, k - smooth.ncols())],
        }
    });
    let solved = model.with_covariance(w, &curve.variance, |covariance| covariance.solve(&all))?;
    let product = all.tr_mul(&solved);
    let outer = 1 + smooth.ncols();
    let inner = slopes.ncols();
    // Woodbury for the parameters' share: (Σ + JJᵀ)⁻¹ = Σ⁻¹ − Σ⁻¹J(I + JᵀΣ⁻¹J)⁻¹JᵀΣ⁻¹.
    let core = DMatrix::identity(inner, inner) + product.view((outer, outer), (inner, inner));
    let factor = nalgebra::Cholesky::new(core).context("the slopes of the curve are not finite")?;
    let cross = product.view((outer, 0), (inner, outer)).into_owned();
    let product = product.view((0, 0), (outer, outer)) - cross.tr_mul(&factor.solve(&cross));

    let whole = ChiSquared::new(residual.len() as f64)?;
    let mut probabilities = vec![whole.sf(product[(0, 0)].max(0.0))];
    let mut first = 1;
    for patterns in patterns {
        let score = product.view((first, 0), (patterns, 1)).norm_squared();
        let shares = SymmetricEigen::new(product.view((first, first), (patterns, patterns)).into_owned());
        probabilities.push(exceedance(score, shares.eigenvalues.as_slice()));
        first += patterns;
    }
    let smallest = probabilities.iter().copied().fold(1.0, f64::min);
    Ok(smallest_of(probabilities.len(), smallest))
}
