//! Two spheres in contact against closed forms.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use gl_world::{Contact, Curves, Step, inputs, simulate};
use proptest::prelude::*;

const U: f64 = Contact::OVERLAP;
/// Reduced radius.
const R: f64 = Contact::RADIUS / 2.0;

fn curve(world: &Contact, given: &str) -> Curves {
    simulate(world, &inputs(world, &given.parse().unwrap()).unwrap()).unwrap()
}

fn cycles() -> Contact {
    Contact { path: Step::cycles(U, 120, Contact::SPEED, Contact::FAST), ..Contact::default() }
}

/// Loading to the overlap and back to `end` in `steps` steps each.
fn there_and_back(end: f64, steps: usize) -> Contact {
    let share = |i: usize| i as f64 / steps as f64;
    let there = (0..=steps).map(|i| U * share(i));
    let back = (1..=steps).map(|i| U + (end - U) * share(i));
    let path: Vec<f64> = there.chain(back).collect();
    Contact { path: Step::follow(&path, Contact::SPEED), ..Contact::default() }
}

fn reduced_modulus(e_m: f64, nu: f64) -> f64 {
    10f64.powf(e_m) / (2.0 * (1.0 - nu * nu))
}

fn hertz(e_m: f64, nu: f64, u: f64) -> f64 {
    4.0 / 3.0 * reduced_modulus(e_m, nu) * R.sqrt() * u.powf(1.5)
}

/// ∮ f du by trapezoids.
fn work(curves: &Curves) -> f64 {
    let (u, f) = (&curves.control, &curves.values[0]);
    (1..u.len()).map(|i| 0.5 * (f[i] + f[i - 1]) * (u[i] - u[i - 1])).sum()
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} to {tolerance:e}");
}

#[test]
fn normal_force_is_hertzs() {
    for (e_m, nu) in [(9.3, 0.2), (7.0, 0.0), (11.0, 0.5)] {
        let curves = curve(&Contact::default(), &format!("E_m={e_m},nu={nu}"));
        for (&u, &f) in curves.control.iter().zip(&curves.values[0]) {
            assert_close(f, hertz(e_m, nu, u), 1e-12 * hertz(e_m, nu, U));
        }
    }
    // E = 2 GPa, nu = 0.2, by hand: 4/3 · 1.0416667e9 Pa · √(0.5 mm) · (10 µm)^1.5.
    let e_m = 2e9f64.log10();
    let last = *curve(&Contact::default(), &format!("E_m={e_m}")).values[0].last().unwrap();
    assert_close(last, 0.9820928, 1e-7);
}

#[test]
fn normal_force_knows_only_e_over_one_minus_nu_squared() {
    let e_m = 9.3 + (0.84f64 / 0.96).log10();
    let one = curve(&Contact::default(), "E_m=9.3,nu=0.2");
    let other = curve(&Contact::default(), &format!("E_m={e_m},nu=0.4"));
    for (one_f, other_f) in one.values[0].iter().zip(&other.values[0]) {
        assert_close(*one_f, *other_f, 1e-12);
    }
    assert!(one.values[1][20] > 1.05 * other.values[1][20], "the tangential force tells them apart");
}

#[test]
fn sticking_stiffness_is_mindlins() {
    // dt/ds over df/du is 2(1 − ν)/(2 − ν), so that with s = shear u²/U without slip
    // t = 6/5 · 2(1 − ν)/(2 − ν) · shear u/U · f.
    for nu in [0.0, 0.2, 0.5] {
        let curves = curve(&Contact::default(), &format!("nu={nu},mu=10"));
        for i in [40, 80] {
            let (u, f, t) = (curves.control[i], curves.values[0][i], curves.values[1][i]);
            let ratio = 2.0 * (1.0 - nu) / (2.0 - nu);
            assert_close(t, 1.2 * ratio * Contact::SHEAR * u / U * f, 1e-5 * f);
        }
    }
}

#[test]
fn full_slip_is_coulombs() {
    let curves = curve(&Contact::default(), "mu=0.1");
    assert_eq!(curves.values[1][80], 0.1 * curves.values[0][80]);
}

#[test]
fn a_plastic_cycle_loses_its_share_of_the_work() {
    // Loading does 2/5 f u; unloading gives back the same with u less what stays.
    for plastic in [0.0, 0.05, 0.6] {
        let curves = curve(&there_and_back(0.0, 4000), &format!("plastic={plastic}"));
        assert_close(work(&curves), plastic * 0.4 * hertz(9.3, 0.2, U) * U, 1e-6 * U);
    }
}

#[test]
fn plastic_reloading_follows_unloading_up_to_the_largest_overlap() {
    let displacements = [0.0, 6e-6, 4e-6, 2e-6, 4e-6, 6e-6, 8e-6];
    let world = Contact { path: Step::follow(&displacements, 1e-6), ..Contact::default() };
    let f = curve(&world, "plastic=0.2").values[0].clone();
    assert_close(f[4], f[2], 1e-15);
    assert_close(f[5], f[1], 1e-15);
    assert!(f[2] < hertz(9.3, 0.2, 4e-6), "unloading lies below the first loading");
    assert_close(f[6], hertz(9.3, 0.2, 8e-6), 1e-12);
}

#[test]
fn adhesive_force_is_johnson_kendall_and_robertss() {
    let (w, modulus) = (2.0, reduced_modulus(9.3, 0.2));
    // Their parametric curve, from first touch upwards.
    for a in [3e-5, 5e-5, 7e-5] {
        let u: f64 = a * a / R - (2.0 * PI * w * a / modulus).sqrt();
        let f = 4.0 * modulus * a.powi(3) / (3.0 * R) - (8.0 * PI * w * modulus * a.powi(3)).sqrt();
        let world = Contact { path: Step::follow(&[u], 1e-6), ..Contact::default() };
        assert!(u > 0.0);
        assert_close(curve(&world, "w=2").values[0][0], f, 1e-12);
    }
    // At first touch, a³ = 2πwR²/E*, it is 8/9 of the pull-off force.
    assert_close(curve(&Contact::default(), "w=2").values[0][0], -8.0 / 9.0 * 1.5 * PI * w * R, 1e-12);
}

#[test]
fn pull_off_takes_three_halves_pi_w_r() {
    let (w, modulus) = (2.0, reduced_modulus(9.3, 0.2));
    let curves = curve(&there_and_back(-2e-7, 5000), "w=2");
    let lowest = curves.values[0].iter().copied().fold(0.0, f64::min);
    assert_close(lowest, -1.5 * PI * w * R, 1e-4 * w * R);
    // They part where u(a) has its minimum: at −3a²/R with a³ = πwR²/(8E*).
    let end = -3.0 * (PI * w * R * R / (8.0 * modulus)).powf(2.0 / 3.0) / R;
    for (i, (&u, &f)) in curves.control.iter().zip(&curves.values[0]).enumerate().skip(5001) {
        assert_eq!(f == 0.0, u < end, "step {i}: {f} at {u}");
    }
    assert!(*curves.control.last().unwrap() < end);
}

#[test]
fn damping_adds_three_halves_tau_v_over_u_of_hertzs_force() {
    let curves = curve(&cycles(), "tau=0.0005");
    let (u, f) = (&curves.control, &curves.values[0]);
    let mut seen = [0, 0];
    for i in 1..u.len() {
        let turn = u.iter().skip(1).position(|&u| u == 0.1 * U).unwrap() + 1;
        let speed = if i <= turn { Contact::SPEED } else { Contact::FAST };
        let rate = speed * (u[i] - u[i - 1]).signum();
        let expected = hertz(9.3, 0.2, u[i]) * (1.0 + 1.5 * 5e-4 * rate / u[i].max(1e-12));
        assert_close(f[i], expected.max(0.0), 1e-12);
        seen[usize::from(i > turn)] += 1;
    }
    assert!(seen[0] > 30 && seen[1] > 30, "both speeds are there: {seen:?}");
}

#[test]
fn standing_still_is_not_damped() {
    let still = Contact { path: Step::follow(&[0.0, U, U], 1e-4), ..Contact::default() };
    let f = curve(&still, "tau=0.001").values[0].clone();
    assert_close(f[2], hertz(9.3, 0.2, U), 1e-12);
    assert!(f[1] > 1.01 * f[2]);
}

#[test]
fn a_compliant_rig_moves_by_its_compliance_times_the_force() {
    let rig = there_and_back(0.3 * U, 100);
    for effects in ["nu=0.2", "plastic=0.1", "w=1", "w=1,tau=0.0002,plastic=0.05"] {
        let compliant = curve(&rig, &format!("compliance=1e-6,{effects}"));
        let f = &compliant.values[0];
        // Pressed by what the rig leaves them, the spheres alone give the same force.
        let left = compliant.control.iter().zip(f).map(|(u, f)| u - 1e-6 * f);
        let path = left.map(|u| Step { u, speed: Contact::SPEED }).collect();
        let spheres = curve(&Contact { path, ..rig.clone() }, effects);
        // Not the first step, at which the rig stands still and the spheres jump into contact.
        for (found, expected) in spheres.values[0].iter().zip(f).skip(1) {
            assert_close(*found, *expected, 1e-9);
        }
        assert!(f[100] < 0.9 * hertz(9.3, 0.2, U));
    }
}

#[test]
fn an_offset_shifts_the_normal_force_alone() {
    let (plain, shifted) = (curve(&cycles(), "w=0.5"), curve(&cycles(), "w=0.5,offset=0.25"));
    assert_eq!(plain.values[1], shifted.values[1]);
    for (plain, shifted) in plain.values[0].iter().zip(&shifted.values[0]) {
        assert_eq!(plain + 0.25, *shifted);
    }
}

#[test]
fn every_effect_changes_the_cycles_and_fades_to_nothing() {
    let base = curve(&cycles(), "E_m=9.3");
    let distance = |given: &str| {
        let other = curve(&cycles(), given);
        let pairs = base.values.iter().flatten().zip(other.values.iter().flatten());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    for (name, strong) in
        [("w", 1.0), ("tau", 1e-3), ("plastic", 0.1), ("compliance", 1e-6), ("offset", 0.05)]
    {
        assert!(distance(&format!("{name}={strong}")) > 0.01, "{name} shows");
        let faint = distance(&format!("{name}={}", strong * 1e-12));
        assert!(faint < 1e-5, "{name} leaves {faint} when it is all but off");
        assert_eq!(distance(&format!("{name}=0")), 0.0);
    }
}

#[test]
fn cycles_go_through_two_loops_at_two_speeds() {
    let path = Step::cycles(U, 120, 1e-6, 1e-4);
    assert_eq!(path.len(), 121);
    let turns: Vec<f64> = (1..path.len() - 1)
        .filter(|&i| (path[i].u - path[i - 1].u) * (path[i + 1].u - path[i].u) < 0.0)
        .map(|i| path[i].u)
        .collect();
    assert_eq!(turns, [0.6 * U, 0.1 * U, U]);
    assert_eq!(path.last().unwrap(), &Step { u: 0.0, speed: 1e-4 });
}

proptest! {
    #[test]
    fn loading_is_monotone(e_m in 7.0..11.0f64, nu in 0.0..0.5f64, w in 0.0..2.0f64, tau in 0.0..1e-3f64,
                           compliance in 0.0..1e-5f64) {
        let f = &curve(&Contact::default(),
            &format!("E_m={e_m},nu={nu},w={w},tau={tau},compliance={compliance}")).values[0];
        prop_assert!(f.windows(2).all(|pair| pair[0] < pair[1] || e_m < 8.5 && w > 0.0), "{f:?}");
    }

    #[test]
    fn friction_stays_below_its_limit(e_m in 7.0..11.0f64, mu in 0.0..1.0f64, w in 0.0..2.0f64,
                                      plastic in 0.0..0.5f64, shear in -1.0..1.0f64) {
        let world = Contact { shear, ..cycles() };
        let curves = curve(&world, &format!("E_m={e_m},mu={mu},w={w},plastic={plastic}"));
        for (f, t) in curves.values[0].iter().zip(&curves.values[1]) {
            let limit = mu * (f + 3.0 * PI * w * R);
            prop_assert!(t.abs() <= limit * (1.0 + 1e-12) + 1e-15, "{t} beyond {limit}");
        }
    }

    #[test]
    fn a_cycle_never_makes_energy(w in 0.0..2.0f64, tau in 0.0..1e-3f64, plastic in 0.0..0.5f64,
                                  compliance in 0.0..1e-5f64) {
        let curves = curve(&cycles(), &format!("w={w},tau={tau},plastic={plastic},compliance={compliance}"));
        prop_assert!(work(&curves) > -1e-3 * U * hertz(9.3, 0.2, U), "{}", work(&curves));
    }
}
