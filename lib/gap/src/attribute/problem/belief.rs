//! What was believed of a parameter before its bounds were made wider.

use gl_inference::prior::{Parameter, Prior};

/// Bounds that were believed inside wider ones, in coordinates of the wider ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    low: f64,
    high: f64,
}

/// Probability beforehand that a parameter lies beyond the bounds that were believed. They are what somebody
/// who knows the material holds possible, and no law.
const BEYOND: f64 = 0.05;

impl Belief {
    /// What was believed of a parameter of wider bounds; nothing where it is not beyond, or where it has a normal prior.
    fn new(parameter: &Parameter, believed: &Prior) -> Option<Self> {
        let own = believed.parameters().iter().find(|own| own.name == parameter.name)?;
        if parameter.normal.is_some() || own.normal.is_some() {
            return None;
        }
        let place = |value: f64| parameter.coordinate(value).clamp(0.0, 1.0);
        let (low, high) = (place(own.lower), place(own.upper));
        let is_wider = high - low < 1.0 - 1e-9;
        (is_wider && low < high).then_some(Self { low, high })
    }

    /// What was believed of each parameter of a prior, shape (parameters,).
    pub fn all(prior: &Prior, believed: &Prior) -> Vec<Option<Self>> {
        prior.parameters().iter().map(|parameter| Self::new(parameter, believed)).collect()
    }

    /// The coordinates of the bounds that were believed.
    pub fn bounds(self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Whether a coordinate lies within the bounds that were believed.
    pub fn holds(self, coordinate: f64) -> bool {
        (self.low..=self.high).contains(&coordinate)
    }

    /// The coordinate below which a share `u` in [0, 1] of the probability lies: even between the bounds that were
    /// believed, and even beyond them, where [`BEYOND`] of it is.
    pub fn coordinate(self, u: f64) -> f64 {
        let Self { low, high } = self;
        let outside = BEYOND / (low + 1.0 - high);
        let inside = (1.0 - BEYOND) / (high - low);
        if u < low * outside {
            u / outside
        } else if u > 1.0 - (1.0 - high) * outside {
            1.0 - (1.0 - u) / outside
        } else {
            low + (u - low * outside) / inside
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gl_inference::prior::Scale;

    fn prior(rows: &[(&str, f64, f64)]) -> Prior {
        let parameter = |&(name, lower, upper): &(&str, f64, f64)| Parameter {
            name: name.to_owned(),
            lower,
            upper,
            scale: Scale::Linear,
            normal: None,
            effect: None,
            off: None,
            unit: None,
        };
        Prior::new(rows.iter().map(parameter).collect())
    }

    #[test]
    fn what_was_believed_has_nineteen_in_twenty() {
        let wide = prior(&[("a", 0.0, 10.0), ("b", 0.0, 1.0), ("c", 2.0, 3.0)]);
        let believed = prior(&[("a", 2.0, 4.0), ("b", 0.0, 1.0), ("c", 1.0, 4.0)]);
        let all = Belief::all(&wide, &believed);
        assert_eq!(all[1..], [None, None]);
        let of_a = all[0].unwrap();
        let count = 10_000;
        let inside = (0..count).filter(|&i| {
            let z = of_a.coordinate((f64::from(i) + 0.5) / f64::from(count));
            (0.2..0.4).contains(&z)
        });
        assert_eq!(inside.count(), 9500);
        // Of what is beyond, a quarter of the way lies below.
        assert!((of_a.coordinate(0.05 / 4.0) - 0.2).abs() < 1e-12);
        assert!((of_a.coordinate(1.0 - 0.05 * 3.0 / 4.0) - 0.4).abs() < 1e-12);
        assert_eq!((of_a.coordinate(0.0), of_a.coordinate(1.0)), (0.0, 1.0));
        assert!((of_a.coordinate(0.006) - 0.096).abs() < 1e-12);
    }
}
