//! A drained triaxial compression test on sand, as one element.

use anyhow::{Context, Result, bail, ensure};
use nalgebra::{Matrix3, Vector3};

use super::{Input, World, check_positive, input};

/// Drained triaxial compression at a constant cell pressure: control `e_a`, the axial strain;
/// observables `q`, the deviatoric stress in kPa, and `e_v`, the volumetric strain. Strains are
/// fractions, positive in compression.
///
/// The base model hardens towards a peak that its state ψ = e − e_c(p) sets, dilates, and ends in the
/// critical state: with η = q/p, M = 6 sin φ_c/(3 − sin φ_c), e_c = 0.934 − 0.019 (p/p_a)^0.7 and
/// p_a = 101.325 kPa,
/// * elastic: G = G0 p_a (2.97 − e)²/(1 + e) √(p/p_a), K = 2G(1 + ν)/(3(1 − 2ν)), ν = 0.05;
/// * plastic: dε_q = p dη/K_p, K_p = h G (M/η − e^{1.1ψ});
/// * dilatancy: dε_v = D dε_q, D = d0 (e^{3.5ψ} − η/M).
///
/// What the base model lacks, each absent at 0:
/// * membrane — stiffness `membrane` (modulus times thickness); it carries 4 membrane e_a/diameter of
///   the axial stress, and confines the specimen by 2 membrane/diameter times the radial strain;
/// * bedding — uneven ends: `e_a` is the specimen's strain plus `bedding` q/(q + cell pressure);
/// * cohesion — `c`: η = q/(p + c cot φ_c);
/// * density — void ratio `de` above the nominal one;
/// * piston — friction of the loading piston: adds `piston` (1 − exp(−e_a/0.0005)) to `q`.
///
/// # Source
/// Li & Dafalias (2000), Géotechnique 50:449 (the model, with its constants for Toyoura sand where
/// they are no parameter here); Henkel & Gilbert (1952), Géotechnique 3:20 (membrane in compression).
#[derive(Clone, Debug, PartialEq)]
pub struct Triaxial {
    /// Cell pressure, kPa.
    pub cell: f64,
    /// Nominal void ratio at the start.
    pub void_ratio: f64,
    /// Diameter of the specimen, m.
    pub diameter: f64,
    /// Axial strains to go to, in increasing order.
    pub path: Vec<f64>,
}

const INPUTS: [Input; 9] = [
    input("G0", 125.0, (5.0, 2000.0), "-", None, "shear modulus coefficient"),
    input("phi_c", 31.0, (10.0, 50.0), "deg", None, "critical-state friction angle"),
    input("d0", 0.9, (0.0, 5.0), "-", None, "dilatancy coefficient"),
    input("h", 0.7, (0.02, 20.0), "-", None, "hardening coefficient"),
    input("membrane", 0.0, (0.0, 100.0), "kN/m", Some("membrane"), "stiffness of the membrane"),
    input("bedding", 0.0, (0.0, 0.05), "-", Some("bedding"), "strain that bedding can add"),
    input("c", 0.0, (0.0, 1000.0), "kPa", Some("cohesion"), "cohesion"),
    input("de", 0.0, (-0.5, 0.5), "-", Some("density"), "initial void ratio above the nominal one"),
    input("piston", 0.0, (0.0, 1000.0), "kPa", Some("piston"), "friction of the loading piston"),
];

/// Atmospheric pressure, kPa.
const ATMOSPHERE: f64 = 101.325;

/// Poisson's ratio.
const POISSON: f64 = 0.05;

/// Strain over which the friction of the piston is mobilised.
const PISTON_STRAIN: f64 = 5e-4;

/// Error allowed in a step of integration: of strains, and of stresses over the cell pressure.
const TOLERANCE: f64 = 1e-9;

/// First step of integration, and the one at which it gives up.
const STEPS: (f64, f64) = (1e-6, 1e-13);

impl Triaxial {
    /// Cell pressure by default, kPa.
    pub const CELL: f64 = 100.0;
    /// Void ratio by default.
    pub const VOID_RATIO: f64 = 0.75;
    /// Diameter by default, m.
    pub const DIAMETER: f64 = 0.05;
    /// Largest axial strain by default.
    pub const STRAIN: f64 = 0.2;
    /// Number of steps by default.
    pub const STEPS: usize = 40;

    /// Axial strains from 0 to `strain`, closer together at the start, where the curve is steep: in
    /// proportion to the square of the step.
    pub fn load(strain: f64, steps: usize) -> Vec<f64> {
        let share = |i: usize| if i == steps { 1.0 } else { i as f64 / steps as f64 };
        (0..=steps).map(|i| strain * share(i).powi(2)).collect()
    }

    /// Check sizes and path.
    ///
    /// # Errors
    /// If a size is not positive and finite, or the strains do not increase from 0 or above to less than 1.
    pub fn check(&self) -> Result<()> {
        check_positive("cell pressure", self.cell)?;
        check_positive("diameter", self.diameter)?;
        let in_order = self.path.windows(2).all(|pair| pair[0] < pair[1]);
        let inside = |strain: Option<&f64>| strain.is_some_and(|strain| (0.0..1.0).contains(strain));
        ensure!(
            in_order && inside(self.path.first()) && inside(self.path.last()),
            "the axial strains must increase, from 0 or above to less than 1"
        );
        Ok(())
    }
}

impl Default for Triaxial {
    fn default() -> Self {
        Self {
            cell: Self::CELL,
            void_ratio: Self::VOID_RATIO,
            diameter: Self::DIAMETER,
            path: Self::load(Self::STRAIN, Self::STEPS),
        }
    }
}

impl World for Triaxial {
    fn inputs(&self) -> &'static [Input] {
        &INPUTS
    }

    fn control(&self) -> &'static str {
        "e_a"
    }

    fn observables(&self) -> &'static [&'static str] {
        &["q", "e_v"]
    }

    fn path(&self) -> Vec<f64> {
        self.path.clone()
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        vec![("cell", self.cell), ("void_ratio", self.void_ratio), ("diameter", self.diameter)]
    }

    fn observe(&self, inputs: &[f64]) -> Result<Vec<Vec<f64>>> {
        let &[g0, phi_c, d0, h, membrane, bedding, c, de, piston] = inputs else {
            bail!("{} parameters where a triaxial test has {}", inputs.len(), INPUTS.len());
        };
        self.check()?;
        let void_ratio = self.void_ratio + de;
        ensure!(
            (0.2..=1.5).contains(&void_ratio),
            "an initial void ratio of {void_ratio}, but it makes sense from 0.2 to 1.5 only"
        );
        let phi = phi_c.to_radians();
        let specimen = Specimen {
            cell: self.cell,
            void_ratio,
            g0,
            critical_ratio: 6.0 * phi.sin() / (3.0 - phi.sin()),
            d0,
            h,
            membrane: membrane / self.diameter,
            bedding,
            tension: c / phi.tan(),
        };
        let mut state = State::zeros();
        let (mut q, mut e_v) = (Vec::new(), Vec::new());
        let (mut from, mut step) = (0.0, STEPS.0);
        for &to in &self.path {
            state = specimen.advance(state, to - from, &mut step)?;
            let [strain, deviator, volume] = [state[0], state[1], state[2]];
            let confined = specimen.confinement(&state) - self.cell;
            let carried = 4.0 * specimen.membrane * strain;
            let friction = piston * (1.0 - (-to / PISTON_STRAIN).exp());
            q.push(deviator + confined + carried + friction);
            e_v.push(volume);
            from = to;
        }
        Ok(vec![q, e_v])
    }
}

/// Axial strain, deviatoric stress and volumetric strain of the specimen itself.
type State = Vector3<f64>;

/// A specimen at given parameters.
struct Specimen {
    cell: f64,
    void_ratio: f64,
    g0: f64,
    /// M.
    critical_ratio: f64,
    d0: f64,
    h: f64,
    /// Stiffness of the membrane over the diameter, kPa.
    membrane: f64,
    bedding: f64,
    /// Isotropic tension that the specimen bears, c cot φ_c.
    tension: f64,
}

impl Specimen {
    /// Radial stress: cell pressure and what the stretched membrane adds.
    fn confinement(&self, state: &State) -> f64 {
        let outward = 0.5 * (state[0] - state[2]);
        self.cell + 2.0 * self.membrane * outward
    }

    /// Rates of the state as the measured axial strain grows.
    fn rate(&self, state: &State) -> Result<State> {
        let (q, e_v) = (state[1], state[2]);
        let p = self.confinement(state) + q / 3.0;
        let e = self.void_ratio - (1.0 + self.void_ratio) * e_v;
        let eta = q / (p + self.tension);
        let m = self.critical_ratio;
        let psi = e - (0.934 - 0.019 * (p / ATMOSPHERE).powf(0.7));
        let shear = self.g0 * ATMOSPHERE * (2.97 - e).powi(2) / (1.0 + e) * (p / ATMOSPHERE).sqrt();
        let bulk = shear * 2.0 * (1.0 + POISSON) / (3.0 * (1.0 - 2.0 * POISSON));
        let dilatancy = self.d0 * ((3.5 * psi).exp() - eta / m);
        // K_p η, which is finite at the start and passes through 0 at the peak.
        let hardening = self.h * shear * (m - eta * (1.1 * psi).exp());

        // Unknown, per strain of the specimen: dq, the plastic dε_q, and dε_v.
        let rows = Matrix3::new(
            // Plastic flow: K_p dε_q = dq (1 − η/3) − η dσ₃, dσ₃ = membrane (1 − dε_v).
            eta * (1.0 - eta / 3.0),
            -hardening,
            eta * eta * self.membrane,
            // Volume: dε_v = (dq/3 + dσ₃)/K + D dε_q.
            1.0 / (3.0 * bulk),
            dilatancy,
            -1.0 - self.membrane / bulk,
            // Axial strain: 1 = dq/3G + dε_q + dε_v/3.
            1.0 / (3.0 * shear),
            1.0,
            1.0 / 3.0,
        );
        let right = Vector3::new(eta * eta * self.membrane, -self.membrane / bulk, 1.0);
        let solved = rows.lu().solve(&right).context("the specimen is no longer stable")?;
        // The bedding takes its part of the measured strain.
        let taken = self.bedding * self.cell / (q + self.cell).powi(2) * solved[0];
        Ok(Vector3::new(1.0, solved[0], solved[2]) / (1.0 + taken))
    }

    /// The state after `length` more of the measured axial strain, in steps that begin with `step` and
    /// are chosen so that one step and two halves of it agree.
    fn advance(&self, mut state: State, length: f64, step: &mut f64) -> Result<State> {
        let mut left = length;
        while left > 0.0 {
            let h = step.min(left);
            let whole = self.runge_kutta(&state, h)?;
            let halves = self.runge_kutta(&self.runge_kutta(&state, 0.5 * h)?, 0.5 * h)?;
            let difference = (halves - whole).component_div(&Vector3::new(1.0, self.cell, 1.0));
            let error = difference.abs().sum() / TOLERANCE;
            if error <= 1.0 {
                state = halves + (halves - whole) / 15.0;
                left = if h < left { left - h } else { 0.0 };
            }
            // A step far too long leaves where there is an answer: its error is no number.
            let factor = if error.is_nan() { 0.2 } else { 0.9 * error.powf(-0.2) };
            *step = h * factor.clamp(0.2, 4.0);
            ensure!(*step > STEPS.1, "the specimen is no longer stable");
        }
        Ok(state)
    }

    /// One step of the classical Runge–Kutta method.
    fn runge_kutta(&self, state: &State, step: f64) -> Result<State> {
        let k1 = self.rate(state)?;
        let k2 = self.rate(&(state + k1 * (0.5 * step)))?;
        let k3 = self.rate(&(state + k2 * (0.5 * step)))?;
        let k4 = self.rate(&(state + k3 * step))?;
        Ok(state + (k1 + 2.0 * k2 + 2.0 * k3 + k4) * (step / 6.0))
    }
}
