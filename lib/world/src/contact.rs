//! Two equal spheres pressed together, and sheared the more the deeper they overlap.

use std::f64::consts::PI;

use anyhow::{Result, bail, ensure};

use super::{Input, World, check_positive, input};

/// Two equal spheres in contact: control `u`, the displacement of one towards the other in m, 0 at
/// first touch; observables `f` and `t`, the normal and the tangential force in N.
///
/// The base model is Hertz's normal law and Mindlin's tangential law with Coulomb's limit:
/// f = 4/3 E* √R* u^{3/2}, dt = 8 G* a ds, |t| ≤ mu f, where R* is half the radius, E* = E/(2(1−ν²)),
/// G* = E/(4(1+ν)(2−ν)), a = √(R* u) the radius of contact and s = `shear` u²/max(u) the tangential
/// displacement. Where the contact shrinks t shrinks with a, so that no energy is made.
///
/// What the base model lacks, each absent at 0:
/// * adhesion — work of adhesion `w`; with F = 4/3 E* a³/R* − √(8πwE*a³) at u = a²/R* − √(2πwa/E*)
///   from first touch to pull-off; the limit of t is then mu (f + 3πwR*);
/// * damping — dissipative time `tau`; adds 2 E* a tau du/dt, which never pulls;
/// * plasticity — the share `plastic` of the largest overlap that stays: unloading and reloading are
///   elastic at the overlap (u − plastic u_max)/(1 − plastic), stiffer than the first loading;
/// * compliance — of the rig: `u` is the spheres' displacement plus `compliance` f;
/// * offset — of the load cell: added to `f`.
///
/// # Source
/// Johnson, Contact mechanics (1985), §4.2, §7.2; Johnson, Kendall & Roberts (1971), Proc. R. Soc. A
/// 324:301; Brilliantov, Spahn, Hertzsch & Pöschel (1996), Phys. Rev. E 53:5382 (damping); Walton &
/// Braun (1986), J. Rheol. 30:949 (plasticity, with Hertz's curve in place of their straight lines);
/// Thornton (1991), J. Phys. D 24:1942 (friction of adhesive spheres).
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// Radius of both spheres, m.
    pub radius: f64,
    /// Tangential over normal displacement at the deepest step.
    pub shear: f64,
    /// The displacements to go to.
    pub path: Vec<Step>,
}

/// A displacement to go to, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Displacement at the end of the step, m.
    pub u: f64,
    /// Speed on the way there, m/s.
    pub speed: f64,
}

impl Step {
    /// Loading from first touch to `overlap` in `steps` equal steps.
    pub fn load(overlap: f64, steps: usize, speed: f64) -> Vec<Self> {
        let mut path = vec![Self { u: 0.0, speed }];
        leg(&mut path, overlap, steps, speed);
        path
    }

    /// Two cycles: loading to 3/5 of `overlap` and unloading to 1/10 of it at `speed`; reloading to
    /// `overlap` and unloading to first touch at `fast`. In all four about `steps` steps, equally long.
    pub fn cycles(overlap: f64, steps: usize, speed: f64, fast: f64) -> Vec<Self> {
        let mut path = vec![Self { u: 0.0, speed }];
        for (to, speed) in [(0.6, speed), (0.1, speed), (1.0, fast), (0.0, fast)] {
            let length = (to * overlap - path.last().map_or(0.0, |step| step.u)).abs();
            // 3 is the whole way there and back, in units of `overlap`.
            let share = (steps as f64 * length / (3.0 * overlap)).round().max(1.0);
            leg(&mut path, to * overlap, share as usize, speed);
        }
        path
    }

    /// The displacements of a measurement, at one speed.
    pub fn follow(displacements: &[f64], speed: f64) -> Vec<Self> {
        displacements.iter().map(|&u| Self { u, speed }).collect()
    }
}

fn leg(path: &mut Vec<Step>, to: f64, steps: usize, speed: f64) {
    let from = path.last().map_or(0.0, |step| step.u);
    for i in 1..=steps {
        let u = if i == steps { to } else { from + (to - from) * i as f64 / steps as f64 };
        path.push(Step { u, speed });
    }
}

/// Steps of integration of the tangential force within one step of the path.
const SUBSTEPS: usize = 16;

const INPUTS: [Input; 8] = [
    input("E_m", 9.3, (3.0, 13.0), "log10(Pa)", None, "decimal logarithm of Young's modulus"),
    input("nu", 0.2, (0.0, 0.5), "-", None, "Poisson's ratio"),
    input("mu", 0.4, (0.0, 10.0), "-", None, "friction coefficient"),
    input("w", 0.0, (0.0, 1e4), "J/m2", Some("adhesion"), "work of adhesion"),
    input("tau", 0.0, (0.0, 1e4), "s", Some("damping"), "dissipative time of the material"),
    input("plastic", 0.0, (0.0, 0.99), "-", Some("plasticity"), "share of the largest overlap that stays"),
    input("compliance", 0.0, (0.0, 1.0), "m/N", Some("compliance"), "displacement of the rig per force"),
    input("offset", 0.0, (-1e6, 1e6), "N", Some("offset"), "reading of the load cell at no force"),
];

impl Contact {
    /// Radius of both spheres by default, m.
    pub const RADIUS: f64 = 1e-3;
    /// Deepest overlap by default, m.
    pub const OVERLAP: f64 = 1e-5;
    /// Steps of a programme by default.
    pub const STEPS: usize = 80;
    /// Speed by default, m/s.
    pub const SPEED: f64 = 1e-6;
    /// Speed of the fast cycle by default, m/s.
    pub const FAST: f64 = 1e-4;
    /// Tangential over normal displacement at the deepest step, by default.
    pub const SHEAR: f64 = 0.6;

    /// Check the sizes and speeds.
    ///
    /// # Errors
    /// If one is not positive and finite, or the path never presses, or deeper than the spheres are.
    pub fn check(&self) -> Result<()> {
        check_positive("radius", self.radius)?;
        ensure!(self.shear.is_finite(), "shear {}: must be finite", self.shear);
        for step in &self.path {
            check_positive("speed", step.speed)?;
            ensure!(step.u.is_finite(), "displacement {}: must be finite", step.u);
        }
        ensure!(self.deepest() > 0.0, "the displacement never exceeds 0: the spheres do not touch");
        ensure!(
            self.deepest() < self.radius,
            "the displacement reaches {}, but the radius is {} only",
            self.deepest(),
            self.radius
        );
        Ok(())
    }

    fn deepest(&self) -> f64 {
        self.path.iter().map(|step| step.u).fold(0.0, f64::max)
    }
}

impl Default for Contact {
    fn default() -> Self {
        let path = Step::load(Self::OVERLAP, Self::STEPS, Self::SPEED);
        Self { radius: Self::RADIUS, shear: Self::SHEAR, path }
    }
}

impl World for Contact {
    fn inputs(&self) -> &'static [Input] {
        &INPUTS
    }

    fn control(&self) -> &'static str {
        "u"
    }

    fn observables(&self) -> &'static [&'static str] {
        &["f", "t"]
    }

    fn path(&self) -> Vec<f64> {
        self.path.iter().map(|step| step.u).collect()
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        let speeds = || self.path.iter().map(|step| step.speed);
        vec![
            ("radius", self.radius),
            ("shear", self.shear),
            ("speed", speeds().fold(f64::INFINITY, f64::min)),
            ("fast", speeds().fold(0.0, f64::max)),
        ]
    }

    fn observe(&self, inputs: &[f64]) -> Result<Vec<Vec<f64>>> {
        let &[e_m, nu, mu, w, tau, plastic, compliance, offset] = inputs else {
            bail!("{} parameters where a contact has {}", inputs.len(), INPUTS.len());
        };
        let young = 10f64.powf(e_m);
        let law = Law {
            radius: self.radius / 2.0,
            modulus: young / (2.0 * (1.0 - nu * nu)),
            shear_modulus: young / (4.0 * (1.0 + nu) * (2.0 - nu)),
            mu,
            w,
            tau,
            plastic,
            compliance,
        };
        self.check()?;
        let curvature = self.shear / self.deepest();
        let slide = |u: f64| curvature * u.max(0.0).powi(2);
        let mut state = State::default();
        let (mut f, mut t) = (Vec::new(), Vec::new());
        let mut from = self.path[0].u.min(0.0);
        for step in &self.path {
            let rate = if step.u == from { 0.0 } else { step.speed * (step.u - from).signum() };
            for i in 1..=SUBSTEPS {
                let at = |i: usize| from + (step.u - from) * i as f64 / SUBSTEPS as f64;
                // The last one is the path's own value to the bit.
                let u = if i == SUBSTEPS { step.u } else { at(i) };
                state.advance(&law, u, rate, slide(u) - slide(at(i - 1)));
            }
            f.push(state.normal.force + offset);
            // Plus zero: a contact that ends while sliding back would leave -0.
            t.push(state.tangential + 0.0);
            from = step.u;
        }
        Ok(vec![f, t])
    }
}

/// The laws of a contact at given parameters.
struct Law {
    /// Reduced radius R*.
    radius: f64,
    /// Reduced Young's modulus E*.
    modulus: f64,
    /// Reduced shear modulus G*.
    shear_modulus: f64,
    mu: f64,
    w: f64,
    tau: f64,
    plastic: f64,
    compliance: f64,
}

/// Normal contact at a moment: radius of contact and normal force, both 0 without contact.
#[derive(Clone, Copy, Debug, Default)]
struct Normal {
    a: f64,
    force: f64,
}

/// What a contact remembers.
#[derive(Debug, Default)]
struct State {
    touching: bool,
    /// Largest overlap so far.
    largest: f64,
    normal: Normal,
    tangential: f64,
}

impl Law {
    /// Overlap at which adhesive spheres part: where u(a) has its minimum, at a³ = πwR*²/(8E*).
    fn pull_off_overlap(&self) -> f64 {
        let a = (PI * self.w * self.radius.powi(2) / (8.0 * self.modulus)).cbrt();
        -3.0 * a * a / self.radius
    }

    /// Radius of contact at an elastic overlap between pull-off and infinity.
    fn contact_radius(&self, overlap: f64) -> f64 {
        let hertz = (self.radius * overlap.max(0.0)).sqrt();
        if self.w == 0.0 {
            return hertz;
        }
        // Newton's method from the right, where the overlap is an increasing convex function of a.
        let pull = (2.0 * PI * self.w / self.modulus).sqrt();
        let mut a = hertz + (pull * self.radius).powf(2.0 / 3.0);
        for _ in 0..100 {
            let excess = a * a / self.radius - pull * a.sqrt() - overlap;
            let slope = 2.0 * a / self.radius - 0.5 * pull / a.sqrt();
            let next = a - excess / slope;
            if !(next < a && slope > 0.0) {
                break;
            }
            a = next;
        }
        a
    }

    /// The elastic overlap at a displacement: less what stays after a deeper one.
    fn elastic_overlap(&self, u: f64, largest: f64) -> f64 {
        if u >= largest { u } else { (u - self.plastic * largest) / (1.0 - self.plastic) }
    }

    fn normal(&self, u: f64, largest: f64, rate: f64) -> Normal {
        let a = self.contact_radius(self.elastic_overlap(u, largest));
        let elastic = 4.0 / 3.0 * self.modulus * a.powi(3) / self.radius
            - (8.0 * PI * self.w * self.modulus * a.powi(3)).sqrt();
        let viscous = 2.0 * self.modulus * a * self.tau * rate;
        Normal { a, force: elastic + viscous.max(-elastic.max(0.0)) }
    }
}

impl State {
    /// Go on to where the rig stands at `u`, moving at `rate`, after sliding by `ds`.
    fn advance(&mut self, law: &Law, u: f64, rate: f64, ds: f64) {
        let before = self.normal;
        let end = if self.touching { law.pull_off_overlap() } else { 0.0 };
        // The displacement of the spheres at which they would part, or meet.
        let parting = law.plastic * self.largest + (1.0 - law.plastic) * end;
        let excess = |x: f64| x + law.compliance * law.normal(x, self.largest, rate).force - u;
        self.touching = if law.compliance > 0.0 { excess(parting) <= 0.0 } else { u >= parting };
        if !self.touching {
            self.normal = Normal::default();
            self.tangential = 0.0;
            return;
        }
        let spheres = if law.compliance > 0.0 {
            let pull = 1.5 * PI * law.w * law.radius;
            root(excess, parting, u + law.compliance * pull)
        } else {
            u
        };
        self.normal = law.normal(spheres, self.largest, rate);
        self.largest = self.largest.max(spheres);

        if self.normal.a < before.a {
            self.tangential *= self.normal.a / before.a;
        }
        self.tangential += 8.0 * law.shear_modulus * 0.5 * (before.a + self.normal.a) * ds;
        let limit = law.mu * (self.normal.force + 3.0 * PI * law.w * law.radius).max(0.0);
        self.tangential = self.tangential.clamp(-limit, limit);
    }
}

/// Where `f` crosses zero between `low`, where it is not positive, and `high`, where it is not
/// negative: regula falsi in the Illinois form.
fn root(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let (mut f_low, mut f_high) = (f(low), f(high));
    let mut kept_low = false;
    let mut kept_high = false;
    for _ in 0..200 {
        let width = high - low;
        if f_low >= 0.0 || width <= 4.0 * f64::EPSILON * high.abs().max(low.abs()) {
            return low;
        }
        if f_high <= 0.0 {
            return high;
        }
        let x = (low - f_low * width / (f_high - f_low)).clamp(low, high);
        let value = f(x);
        if value <= 0.0 {
            (low, f_low) = (x, value);
            f_high *= if kept_high { 0.5 } else { 1.0 };
            (kept_low, kept_high) = (false, true);
        } else {
            (high, f_high) = (x, value);
            f_low *= if kept_low { 0.5 } else { 1.0 };
            (kept_low, kept_high) = (true, false);
        }
    }
    0.5 * (low + high)
}
