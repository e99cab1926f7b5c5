//! What the draws predict of each reading.

use gl_inference::predict::Predicted;
use gl_numeric::statistics::{Quantiles, mean, sd};
use nalgebra::DVector;
use rayon::prelude::*;

use super::Inference;

impl Inference {
    /// What the emulator makes of each draw, at these places (observable, step, control), shape (observables · steps).
    pub fn curves(&self, places: &[(String, usize, f64)]) -> Vec<Predicted> {
        let curve = |x: &Vec<f64>| self.surrogate.curve(&self.space, x);
        let curves: Vec<DVector<f64>> = self.points.par_iter().map(curve).collect();
        let even = vec![1.0 / curves.len() as f64; curves.len()];
        let of = |(o, (observable, step, control)): (usize, &(String, usize, f64))| {
            let warp = self.measured.warps[self.measured.observable_of(o)];
            let values: Vec<f64> = curves.iter().map(|curve| warp.back(curve[o])).collect();
            let quantiles = Quantiles::new(&values, &even);
            let [q05, q50, q95] = [0.05, 0.5, 0.95].map(|p| quantiles.at(p));
            let (mean, sd) = (mean(&values, &even), sd(&values, &even));
            Predicted {
                observable: observable.clone(),
                step: *step,
                control: *control,
                mean,
                sd,
                q05,
                q50,
                q95,
            }
        };
        places.iter().enumerate().map(of).collect()
    }
}
