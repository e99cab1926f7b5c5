//! What was believed of a parameter before its bounds were made wider.

use gl_inference::prior::{Parameter, Prior};

/// Bounds that were believed inside wider ones, in coordinates of the wider ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    low: f64,
    high: f64,
    /// Probability beforehand to lie beyond them.
    beyond: f64,
}

/// Probability beforehand that a parameter of the base model lies beyond the bounds that were believed, any of them. They are
/// what somebody who knows the material holds possible, and no law.
const BEYOND: f64 = 0.05;

/// How far beyond them it lies on average then, in widths between them: who errs about a material errs by a part of what was
/// held possible.
const MEAN_DISTANCE: f64 = 0.25;

impl Belief {
    /// What was believed of a parameter of wider bounds, which it is beyond with so much probability; nothing where they are not
    /// wider, or where it has a normal prior.
    fn new(parameter: &Parameter, believed: &Prior, beyond: f64) -> Option<Self> {
        let own = believed.parameter(&parameter.name)?;
        if parameter.normal.is_some() || own.normal.is_some() {
            return None;
        }
        let place = |value: f64| parameter.coordinate(value).clamp(0.0, 1.0);
        let (low, high) = (place(own.lower), place(own.upper));
        let is_wider = high - low < 1.0 - 1e-9;
        (is_wider && low < high).then_some(Self { low, high, beyond })
    }

    /// What was believed of each parameter of a prior, shape (parameters,).
    pub fn all(prior: &Prior, believed: &Prior) -> Vec<Option<Self>> {
        let beyond = BEYOND / believed.base().len().max(1) as f64;
        prior.parameters().iter().map(|parameter| Self::new(parameter, believed, beyond)).collect()
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
    /// believed, and beyond them the less the further.
    pub fn coordinate(self, u: f64) -> f64 {
        let Self { low, high, beyond } = self;
        let scale = MEAN_DISTANCE * (high - low);
        // What an exponential density has on each side, as far as the wider bound.
        let [below, above] = [low, 1.0 - high].map(|room| -(-room / scale).exp_m1());
        let [of_below, of_above] = [below, above].map(|share| beyond * share / (below + above));
        let away = |share: f64, side: f64| -scale * ((1.0 - side) + share * side).ln();
        if u < of_below {
            (low - away(u / of_below, below)).max(0.0)
        } else if u > 1.0 - of_above {
            (high + away((1.0 - u) / of_above, above)).min(1.0)
        } else {
            low + (u - of_below) * (high - low) / (1.0 - beyond)
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
    fn what_was_believed_of_all_has_nineteen_in_twenty() {
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
        // A sixtieth lies beyond what was believed of this one of three, a twentieth of any.
        assert_eq!(inside.count(), 9833);
        // Beyond them the density falls by exp(-1) on a quarter of what was believed, to the wider bounds.
        let share = |near: f64, far: f64| (-near / 0.05f64).exp() - (-far / 0.05f64).exp();
        let whole = share(0.0, 0.2) + share(0.0, 0.6);
        let beyond = 0.05 / 3.0;
        let below = beyond * share(0.0, 0.2) / whole;
        assert!((of_a.coordinate(below) - 0.2).abs() < 1e-9);
        assert!((of_a.coordinate(1.0 - beyond + below) - 0.4).abs() < 1e-9);
        assert!((of_a.coordinate(beyond * share(0.07, 0.2) / whole) - 0.13).abs() < 1e-9);
        assert!((of_a.coordinate(1.0 - beyond * share(0.11, 0.6) / whole) - 0.51).abs() < 1e-9);
        assert!(of_a.coordinate(0.0).abs() < 1e-9 && (of_a.coordinate(1.0) - 1.0).abs() < 1e-9);
    }
}
