//! What a diagnosis needs to know about a simulation: its curves at any parameters.

use nalgebra::DMatrix;

/// Curves at any parameters, with what is not known about them.
///
/// A curve is all readings behind each other, observable by observable and step by step. It follows from a
/// few components; a small change of them changes curves that are near the measurement by basis · change.
pub trait Predictor: Sync {
    /// Number of readings of a curve.
    fn readings(&self) -> usize;

    /// What a change of each component does to curves that are near the measurement, shape (readings, components).
    fn basis(&self) -> &DMatrix<f64>;

    /// Variance of a run about the patterns: what the components leave out, shape (readings,).
    fn left_over(&self) -> &[f64];

    /// Variance of each component between runs at the same parameters (packing, seed), shape
    /// (components,).
    fn scatter(&self) -> Vec<f64>;

    /// Correlation of what is not known about the components, and of their scatter, shape
    /// (components, components).
    fn correlation(&self) -> DMatrix<f64> {
        DMatrix::identity(self.basis().ncols(), self.basis().ncols())
    }

    /// Components at a point in coordinates, with the variance that comes from not knowing the
    /// simulation there, without its scatter.
    fn predict(&self, point: &[f64]) -> Predicted;

    /// Components at several points.
    fn predict_all(&self, points: &[Vec<f64>]) -> Vec<Predicted> {
        points.iter().map(|point| self.predict(point)).collect()
    }

    /// What the components at one point have more than at another, with the variance that comes from not knowing the
    /// simulation at both.
    fn difference(&self, point: &[f64], other: &[f64]) -> Predicted {
        let (a, b) = (self.predict(point), self.predict(other));
        let variance = a.variance.iter().zip(&b.variance).map(|(a, b)| a + b).collect();
        Predicted { mean: a.mean.iter().zip(&b.mean).map(|(a, b)| a - b).collect(), variance }
    }

    /// Components at a point, without their variance.
    fn mean(&self, point: &[f64]) -> Vec<f64> {
        self.predict(point).mean
    }

    /// The curve of components, shape (readings,).
    fn curve(&self, components: &[f64]) -> Vec<f64>;

    /// Derivative of the curve by each coordinate, shape (readings, coordinates).
    fn gradient(&self, point: &[f64]) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let mut gradient = DMatrix::zeros(self.readings(), point.len());
        let mut moved = point.to_vec();
        for (j, mut column) in gradient.column_iter_mut().enumerate() {
            moved[j] = point[j] + STEP;
            let above = self.curve(&self.mean(&moved));
            moved[j] = point[j] - STEP;
            let below = self.curve(&self.mean(&moved));
            moved[j] = point[j];
            for (i, value) in column.iter_mut().enumerate() {
                *value = (above[i] - below[i]) / (2.0 * STEP);
            }
        }
        gradient
    }
}

/// The components of a curve, each of shape (components,).
#[derive(Clone, Debug)]
pub struct Predicted {
    /// Mean.
    pub mean: Vec<f64>,
    /// Variance.
    pub variance: Vec<f64>,
}
