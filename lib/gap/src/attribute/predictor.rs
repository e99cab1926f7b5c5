//! What a diagnosis needs to know about a simulation: its curves at any parameters.

use nalgebra::DMatrix;

/// Curves at any parameters, with what is not known about them.
///
/// A curve is all readings behind each other, observable by observable and step by step:
/// centre + basis · components. An emulator is one; so is a model in closed form.
pub trait Predictor: Sync {
    /// The curve that the components are counted from, shape (readings,).
    fn centre(&self) -> &[f64];

    /// Patterns that the components stand for, shape (readings, components).
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
    fn predict(&self, point: &[f64]) -> Prediction;

    /// Components at several points.
    fn predict_all(&self, points: &[Vec<f64>]) -> Vec<Prediction> {
        points.iter().map(|point| self.predict(point)).collect()
    }

    /// Components at a point, without their variance.
    fn mean(&self, point: &[f64]) -> Vec<f64> {
        self.predict(point).mean
    }

    /// Derivative of the mean components by each coordinate, shape (components, coordinates).
    fn gradient(&self, point: &[f64]) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let mut gradient = DMatrix::zeros(self.scatter().len(), point.len());
        let mut moved = point.to_vec();
        for (j, mut column) in gradient.column_iter_mut().enumerate() {
            moved[j] = point[j] + STEP;
            let above = self.mean(&moved);
            moved[j] = point[j] - STEP;
            let below = self.mean(&moved);
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
pub struct Prediction {
    /// Mean.
    pub mean: Vec<f64>,
    /// Variance.
    pub variance: Vec<f64>,
}

impl Predictor for gl_emulator::Emulator {
    fn centre(&self) -> &[f64] {
        self.centre().as_slice()
    }

    fn basis(&self) -> &DMatrix<f64> {
        self.basis()
    }

    fn left_over(&self) -> &[f64] {
        self.leftover().as_slice()
    }

    fn scatter(&self) -> Vec<f64> {
        self.nugget()
    }

    fn correlation(&self) -> DMatrix<f64> {
        self.score_covariance(&vec![1.0; self.basis().ncols()])
    }

    fn predict(&self, point: &[f64]) -> Prediction {
        let (mean, variance) = self.predict_scores(point);
        Prediction { mean, variance }
    }

    fn predict_all(&self, points: &[Vec<f64>]) -> Vec<Prediction> {
        let all = self.predict_all_scores(points);
        all.into_iter().map(|(mean, variance)| Prediction { mean, variance }).collect()
    }

    fn mean(&self, point: &[f64]) -> Vec<f64> {
        self.mean_scores(point)
    }

    fn gradient(&self, point: &[f64]) -> DMatrix<f64> {
        let (_, gradients) = self.score_gradients(point);
        DMatrix::from_fn(gradients.len(), point.len(), |i, j| gradients[i][j])
    }
}
