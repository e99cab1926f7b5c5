//! The density that new samples were drawn from, written down so that a later filter can divide it
//! out.
//!
//! It lives in the coordinates of [`Parameter::coordinate`](crate::prior::Parameter::coordinate), in
//! which the prior's support is the unit cube.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use nalgebra::DMatrix;

use crate::mixture::Gaussian;
use crate::prior::{Parameter, Scale};
use crate::samples::Samples;
use gl_numeric::statistics::ln_sum_exp;
use gl_table::{Table, TableWriter};

/// Where in the unit cube samples were drawn, and how densely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// By the mixture, inside the cube; `ln_mass` is ln of the mixture's probability in there.
    Mixture {
        /// ln of the probability that a draw of the mixture lies in the cube.
        ln_mass: f64,
    },
    /// Evenly where the mixture's density is at least `ln_threshold`; `ln_volume` is ln of that part of
    /// the cube.
    Slice {
        /// ln of the least density.
        ln_threshold: f64,
        /// ln of the volume where the density reaches it.
        ln_volume: f64,
    },
}

/// A mixture of normal distributions in the unit cube of some parameters.
#[derive(Clone, Debug)]
pub struct Proposal {
    parameters: Vec<Parameter>,
    weights: Vec<f64>,
    means: Vec<Vec<f64>>,
    covariances: Vec<DMatrix<f64>>,
    gaussians: Vec<Gaussian>,
    /// Where samples are drawn.
    pub support: Support,
}

impl Proposal {
    /// The mixture with these components; nothing is known of its support yet.
    ///
    /// # Errors
    /// If a covariance is not positive definite.
    pub fn new(
        parameters: Vec<Parameter>,
        weights: Vec<f64>,
        means: Vec<Vec<f64>>,
        covariances: Vec<DMatrix<f64>>,
    ) -> Result<Self> {
        let gaussians =
            means.iter().zip(&covariances).map(|(m, c)| Gaussian::new(m, c)).collect::<Result<_>>()?;
        let support = Support::Mixture { ln_mass: 0.0 };
        Ok(Self { parameters, weights, means, covariances, gaussians, support })
    }

    /// The parameters that it proposes.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The components: weight and distribution of each.
    pub fn components(&self) -> impl Iterator<Item = (f64, &Gaussian)> {
        self.weights.iter().copied().zip(&self.gaussians)
    }

    /// The components as some of the parameters see them, by position: weight and distribution of each.
    ///
    /// # Errors
    /// If such a covariance is not positive definite.
    pub fn marginal(&self, axes: &[usize]) -> Result<Vec<(f64, Gaussian)>> {
        let one = |((&weight, mean), covariance): ((&f64, &Vec<f64>), &DMatrix<f64>)| {
            let mean: Vec<f64> = axes.iter().map(|&j| mean[j]).collect();
            let covariance = DMatrix::from_fn(axes.len(), axes.len(), |i, j| covariance[(axes[i], axes[j])]);
            Ok((weight, Gaussian::new(&mean, &covariance)?))
        };
        self.weights.iter().zip(&self.means).zip(&self.covariances).map(one).collect()
    }

    /// ln of the mixture's density at a point of the unit cube, wherever its support is.
    pub fn ln_mixture(&self, z: &[f64]) -> f64 {
        let mut scratch = vec![0.0; z.len()];
        let terms: Vec<f64> =
            self.components().map(|(w, g)| w.ln() + g.ln_density(z, &mut scratch)).collect();
        ln_sum_exp(&terms)
    }

    /// ln of the density that proposes a point of the unit cube, relative to the prior's; −∞ outside of
    /// its support.
    pub fn ln_density(&self, z: &[f64]) -> f64 {
        if !z.iter().all(|z| (-1e-12..=1.0 + 1e-12).contains(z)) {
            return f64::NEG_INFINITY;
        }
        let prior: f64 = self.parameters.iter().zip(z).map(|(p, &z)| p.ln_density(z.clamp(0.0, 1.0))).sum();
        let mixture = self.ln_mixture(z);
        match self.support {
            Support::Mixture { ln_mass } => mixture - ln_mass - prior,
            // Values written and read again may have left the slice by a rounding error.
            Support::Slice { ln_threshold, ln_volume } if mixture >= ln_threshold - 1e-9 => {
                -ln_volume - prior
            }
            Support::Slice { .. } => f64::NEG_INFINITY,
        }
    }

    /// Write the proposal table: one row a component, its weight, mean and covariance in coordinates,
    /// and on every row the support and the prior that the coordinates are made from.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let names: Vec<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
        let mut columns = vec!["weight".to_owned()];
        columns.extend(names.iter().map(|a| format!("mean({a})")));
        for (i, a) in names.iter().enumerate() {
            columns.extend(names[i..].iter().map(|b| format!("cov({a};{b})")));
        }
        columns.extend(["ln_mass", "ln_threshold", "ln_volume"].map(str::to_owned));
        for field in PRIOR_FIELDS {
            columns.extend(names.iter().map(|a| format!("{field}({a})")));
        }
        let mut table = TableWriter::create(Some(path), &columns)?;
        for k in 0..self.weights.len() {
            table.number(self.weights[k]).numbers(&self.means[k]);
            for i in 0..names.len() {
                for j in i..names.len() {
                    table.number(self.covariances[k][(i, j)]);
                }
            }
            match self.support {
                Support::Mixture { ln_mass } => table.number(ln_mass).text("-").text("-"),
                Support::Slice { ln_threshold, ln_volume } => {
                    table.text("-").number(ln_threshold).number(ln_volume)
                }
            };
            for p in &self.parameters {
                table.number(p.lower);
            }
            for p in &self.parameters {
                table.number(p.upper);
            }
            for p in &self.parameters {
                table.text(&p.scale.to_string());
            }
            for part in [|normal: (f64, f64)| normal.0, |normal: (f64, f64)| normal.1] {
                for p in &self.parameters {
                    match p.normal {
                        Some(normal) => table.number(part(normal)),
                        None => table.text("-"),
                    };
                }
            }
            table.end_row()?;
        }
        table.finish()
    }

    /// Read a proposal table; see [`Proposal::write`].
    ///
    /// # Errors
    /// If it cannot be read, or is no proposal table.
    pub fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        let source = table.format().source().to_owned();
        ensure!(!table.is_empty(), "{source}: no rows; a proposal has at least one component");
        let names: Vec<String> = table
            .format()
            .columns()
            .iter()
            .filter_map(|column| column.strip_prefix("mean(")?.strip_suffix(')').map(str::to_owned))
            .collect();
        let number = |row: usize, column: &str| table.number(row, table.format().column(column)?);
        let optional = |column: &str| -> Result<Option<f64>> {
            let place = table.format().column(column)?;
            if table.field(0, place) == "-" { Ok(None) } else { table.number(0, place).map(Some) }
        };
        let parameters = names
            .iter()
            .map(|name| {
                let scale = table.field(0, table.format().column(&format!("scale({name})"))?);
                Ok(Parameter {
                    name: name.clone(),
                    lower: number(0, &format!("lower({name})"))?,
                    upper: number(0, &format!("upper({name})"))?,
                    scale: if scale == "log" { Scale::Log } else { Scale::Linear },
                    normal: optional(&format!("prior_mean({name})"))?
                        .zip(optional(&format!("prior_sd({name})"))?),
                    effect: None,
                    off: None,
                    unit: None,
                })
            })
            .collect::<Result<Vec<_>>>()?;
        let (mut weights, mut means, mut covariances) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..table.len() {
            weights.push(number(row, "weight")?);
            means.push(names.iter().map(|a| number(row, &format!("mean({a})"))).collect::<Result<Vec<_>>>()?);
            let mut covariance = DMatrix::zeros(names.len(), names.len());
            for (i, a) in names.iter().enumerate() {
                for (j, b) in names.iter().enumerate().skip(i) {
                    covariance[(i, j)] = number(row, &format!("cov({a};{b})"))?;
                    covariance[(j, i)] = covariance[(i, j)];
                }
            }
            covariances.push(covariance);
        }
        let mut proposal = Self::new(parameters, weights, means, covariances).context(source.clone())?;
        proposal.support = match (optional("ln_mass")?, optional("ln_threshold")?, optional("ln_volume")?) {
            (Some(ln_mass), _, _) => Support::Mixture { ln_mass },
            (None, Some(ln_threshold), Some(ln_volume)) => Support::Slice { ln_threshold, ln_volume },
            _ => bail!("{source}: neither ln_mass nor ln_threshold and ln_volume are there"),
        };
        Ok(proposal)
    }
}

const PRIOR_FIELDS: [&str; 5] = ["lower", "upper", "scale", "prior_mean", "prior_sd"];

/// ln of the density that proposed each sample, relative to the prior, when the samples of several
/// iterations are weighed together: the mixture of all their proposals by the number of their runs.
///
/// * `samples` — all samples, of which the first `counts[0]` belong to the first iteration and so on.
/// * `proposals` — what each iteration was drawn from; nothing for the prior.
/// * `used` — which samples have a run, shape (samples,).
///
/// # Errors
/// If a proposal's parameters are not among those of the samples.
///
/// # Source
/// The balance heuristic of Veach & Guibas (1995), SIGGRAPH, 419; for iterations, Cornuet et al.
/// (2012), Scand. J. Stat. 39:798.
pub fn ln_balance_heuristic(
    samples: &Samples,
    counts: &[usize],
    proposals: &[Option<Proposal>],
    used: &[bool],
) -> Result<Vec<f64>> {
    let mut starts = counts.iter().scan(0, |start, count| {
        *start += count;
        Some(*start - count..*start)
    });
    let runs: Vec<f64> =
        starts.by_ref().map(|range| used[range].iter().filter(|used| **used).count() as f64).collect();
    let total: f64 = runs.iter().sum();
    let mut terms = vec![Vec::with_capacity(counts.len()); samples.len()];
    for (proposal, count) in proposals.iter().zip(&runs).filter(|(_, count)| **count > 0.0) {
        let ln_share = (count / total).ln();
        let Some(proposal) = proposal else {
            terms.iter_mut().for_each(|terms| terms.push(ln_share));
            continue;
        };
        let names: Vec<String> = proposal.parameters.iter().map(|p| p.name.clone()).collect();
        for (terms, values) in terms.iter_mut().zip(samples.columns(&names)?) {
            let z: Vec<f64> =
                proposal.parameters.iter().zip(&values).map(|(p, &x)| p.coordinate(x)).collect();
            terms.push(ln_share + proposal.ln_density(&z));
        }
    }
    Ok(terms.iter().map(|terms| ln_sum_exp(terms)).collect())
}
