//! What the Gaussian processes see of a sample's parameters.

use gl_inference::prior::Prior;

/// How far apart two coordinates may lie and be the same.
const SAME: f64 = 1e-9;

/// The way from the coordinates of a sample to the inputs of a Gaussian process.
///
/// An input is a parameter's coordinate, or a switch of 0 or 1: whether an effect is on. Effects get
/// a switch where a parameter of theirs is off outside its bounds, for there may be a jump between
/// off and the least that on can be. What is the same in every run is no input. Inputs are scaled so
/// that the runs lie between 0 and 1.
#[derive(Clone, Debug)]
pub struct Inputs {
    parameters: Vec<Place>,
    /// Parameters of the effects that have a switch, by effect.
    switches: Vec<Vec<usize>>,
    kept: Vec<Input>,
    fixed: Vec<(Source, f64)>,
    /// How far beyond the runs is still among them, as a share of their range.
    margin: f64,
}

/// A parameter's coordinate at off, if that is outside its bounds, and where it stands instead.
#[derive(Clone, Debug)]
struct Place {
    off: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    Coordinate(usize),
    Switch(usize),
}

#[derive(Clone, Debug)]
struct Input {
    source: Source,
    /// Range over all runs.
    low: f64,
    high: f64,
    /// Range over the runs in which the parameter is not off outside its bounds.
    on: (f64, f64),
}

/// How a sample lies to the runs that an emulator was trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Within their range.
    Inside,
    /// Outside the range of this parameter; what is predicted there is extrapolated.
    Outside(usize),
    /// This parameter was the same in every run, but is another in the sample (or its effect was
    /// never off, or never on): nothing is known.
    Unknown(usize),
}

impl Inputs {
    /// The inputs for runs at these coordinates, shape (runs, parameters).
    pub fn new(prior: &Prior, runs: &[Vec<f64>]) -> Self {
        let place = |parameter: &gl_inference::prior::Parameter| {
            let value = parameter.off?;
            let off = parameter.coordinate(value);
            let is_beyond_log = parameter.scale == gl_inference::prior::Scale::Log && value <= 0.0;
            let stand_in = if is_beyond_log { 0.0 } else { off.clamp(-1.0, 2.0) };
            (!(-SAME..=1.0 + SAME).contains(&off)).then_some((off, stand_in))
        };
        let parameters: Vec<Place> =
            prior.parameters().iter().map(|parameter| Place { off: place(parameter) }).collect();
        let switches: Vec<Vec<usize>> = prior
            .effects()
            .into_iter()
            .map(|effect| effect.parameters.into_iter().filter(|&j| parameters[j].off.is_some()).collect())
            .filter(|switch: &Vec<usize>| !switch.is_empty())
            .collect();
        let mut inputs = Self {
            parameters,
            switches,
            kept: Vec::new(),
            fixed: Vec::new(),
            margin: 2.0 / runs.len() as f64,
        };
        let sources = (0..inputs.parameters.len())
            .map(Source::Coordinate)
            .chain((0..inputs.switches.len()).map(Source::Switch));
        for source in sources.collect::<Vec<_>>() {
            let mut input = Input {
                source,
                low: f64::INFINITY,
                high: -f64::INFINITY,
                on: (f64::INFINITY, -f64::INFINITY),
            };
            for run in runs {
                let value = inputs.value(source, run);
                (input.low, input.high) = (input.low.min(value), input.high.max(value));
                if !inputs.is_off(source, run) {
                    input.on = (input.on.0.min(value), input.on.1.max(value));
                }
            }
            if input.high - input.low > SAME {
                inputs.kept.push(input);
            } else {
                inputs.fixed.push((source, input.low));
            }
        }
        inputs
    }

    /// Number of inputs.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// The inputs at coordinates, shape (parameters,).
    pub fn at(&self, coordinates: &[f64]) -> Vec<f64> {
        let scaled =
            |input: &Input| (self.value(input.source, coordinates) - input.low) / (input.high - input.low);
        self.kept.iter().map(scaled).collect()
    }

    /// Derivatives by coordinates, shape (parameters,), from those by inputs; zero by parameters that
    /// were the same in every run.
    pub fn by_coordinates(&self, by_inputs: &[f64]) -> Vec<f64> {
        let mut by_coordinates = vec![0.0; self.parameters.len()];
        for (input, derivative) in self.kept.iter().zip(by_inputs) {
            if let Source::Coordinate(j) = input.source {
                by_coordinates[j] = derivative / (input.high - input.low);
            }
        }
        by_coordinates
    }

    /// How coordinates, shape (parameters,), lie to the runs.
    pub fn reach(&self, coordinates: &[f64]) -> Reach {
        let parameter = |source| match source {
            Source::Coordinate(j) => j,
            Source::Switch(e) => self.switches[e][0],
        };
        for &(source, value) in &self.fixed {
            if (self.value(source, coordinates) - value).abs() > 1e-6 {
                return Reach::Unknown(parameter(source));
            }
        }
        for input in self.kept.iter().filter(|input| !self.is_off(input.source, coordinates)) {
            let value = self.value(input.source, coordinates);
            let margin = self.margin * (input.on.1 - input.on.0) + SAME;
            if value < input.on.0 - margin || value > input.on.1 + margin {
                return Reach::Outside(parameter(input.source));
            }
        }
        Reach::Inside
    }

    fn value(&self, source: Source, coordinates: &[f64]) -> f64 {
        match (source, self.is_off(source, coordinates)) {
            (Source::Coordinate(j), false) => coordinates[j],
            (Source::Coordinate(j), true) => self.parameters[j].off.map_or(0.0, |(_, stand_in)| stand_in),
            (Source::Switch(_), is_off) => f64::from(u8::from(!is_off)),
        }
    }

    /// Whether a parameter, or all parameters behind a switch, are off outside their bounds.
    fn is_off(&self, source: Source, coordinates: &[f64]) -> bool {
        let is_off =
            |j: usize| self.parameters[j].off.is_some_and(|(off, _)| (coordinates[j] - off).abs() <= SAME);
        match source {
            Source::Coordinate(j) => is_off(j),
            Source::Switch(e) => self.switches[e].iter().all(|&j| is_off(j)),
        }
    }
}
