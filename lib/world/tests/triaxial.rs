//! The triaxial test against theory and an independent integration.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use gl_table::Table;
use gl_world::{Curves, Triaxial, inputs, simulate};
use proptest::prelude::*;

fn curve(world: &Triaxial, given: &str) -> Curves {
    simulate(world, &inputs(world, &given.parse().unwrap()).unwrap()).unwrap()
}

fn even(strain: f64, steps: usize) -> Triaxial {
    let path = (0..=steps).map(|i| strain * i as f64 / steps as f64).collect();
    Triaxial { path, ..Triaxial::default() }
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} to {tolerance:e}");
}

/// tests/oracle/triaxial.py: scipy's LSODA at a relative tolerance of 1e-11.
#[test]
fn curves_are_those_of_an_independent_integration() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/oracle/triaxial.tsv");
    let table = Table::read(&file).unwrap();
    let (case, strain) = (table.numbers("case").unwrap(), table.numbers("e_a").unwrap());
    let (q, e_v) = (table.numbers("q").unwrap(), table.numbers("e_v").unwrap());
    let given = ["G0=125", "G0=300,phi_c=35,d0=1.4,h=0.3,membrane=2,c=12,de=-0.08"];
    let runs = given.map(|given| curve(&Triaxial::default(), given));
    for row in 0..table.len() {
        let run = &runs[case[row] as usize];
        let step = row % run.control.len();
        assert_close(run.control[step], strain[row], 1e-15);
        assert_close(run.values[0][step], q[row], 1e-5);
        assert_close(run.values[1][step], e_v[row], 1e-9);
    }
    assert_eq!(table.len(), 2 * runs[0].control.len());
}

#[test]
fn the_start_is_elastic() {
    let world = Triaxial { path: vec![0.0, 1e-9], ..Triaxial::default() };
    let run = curve(&world, "G0=200");
    let shear = 200.0 * 101.325 * (2.97 - 0.75f64).powi(2) / 1.75 * (100.0f64 / 101.325).sqrt();
    // E = 2G(1 + ν), and a volume of 1 − 2ν times the axial strain.
    assert_close(run.values[0][1] / 1e-9, 2.0 * shear * 1.05, 1e-3 * shear);
    assert_close(run.values[1][1] / 1e-9, 0.9, 1e-3);
}

#[test]
fn large_strains_end_at_the_critical_friction_angle_and_volume() {
    for (phi_c, void_ratio) in [(25.0f64, 0.8), (31.0, 0.75), (36.0, 0.9)] {
        let world = Triaxial { void_ratio, ..even(0.95, 100) };
        let run = curve(&world, &format!("phi_c={phi_c},d0=2"));
        let q = run.values[0][100];
        // sin φ = (σ₁ − σ₃)/(σ₁ + σ₃)
        assert_close((q / (q + 2.0 * world.cell)).asin().to_degrees(), phi_c, 0.05);
        let rate = (run.values[1][100] - run.values[1][99]) / 0.0095;
        assert_close(rate, 0.0, 5e-3);
        let p = world.cell + q / 3.0;
        let e = void_ratio - (1.0 + void_ratio) * run.values[1][100];
        assert_close(e, 0.934 - 0.019 * (p / 101.325).powf(0.7), 3e-3);
    }
}

#[test]
fn cohesion_adds_its_strength_at_the_critical_state() {
    let q = |given: &str| *curve(&even(0.95, 100), given).values[0].last().unwrap();
    // q = M (p + c cot φ) with p = σ₃ + q/3; the same as 2c cos φ/(1 − sin φ) more.
    let phi = 31f64.to_radians();
    let more = 2.0 * 20.0 * phi.cos() / (1.0 - phi.sin());
    assert_close(q("d0=2,c=20") - q("d0=2"), more, 0.01 * more);
}

#[test]
fn dense_sand_has_a_peak_where_it_dilates_most() {
    let run = curve(&even(0.2, 2000), "G0=125");
    let (q, e_v) = (&run.values[0], &run.values[1]);
    let peak = (0..q.len()).max_by(|&i, &j| q[i].total_cmp(&q[j])).unwrap();
    assert!(q[peak] > 1.15 * q[2000] && peak > 50 && peak < 1000);
    let rate = |i: usize| (e_v[i + 1] - e_v[i - 1]) / 2e-4;
    let steepest = (1..2000).min_by(|&i, &j| rate(i).total_cmp(&rate(j))).unwrap();
    assert!(rate(peak) < -0.3, "{}", rate(peak));
    assert!(
        run.control[steepest].max(run.control[peak]) - run.control[steepest].min(run.control[peak]) < 0.02
    );
    // At the peak nothing is elastic: dε_v/dε_a = D/(1 + D/3) with η = M e^{−1.1ψ}.
    let p = 100.0 + q[peak] / 3.0;
    let psi: f64 = 0.75 - 1.75 * e_v[peak] - (0.934 - 0.019 * (p / 101.325).powf(0.7));
    let dilatancy = 0.9 * ((3.5 * psi).exp() - (-1.1 * psi).exp());
    assert_close(rate(peak), dilatancy / (1.0 + dilatancy / 3.0), 2e-3);
}

#[test]
fn loose_sand_contracts_without_a_peak() {
    let run = curve(&even(0.3, 300), "de=0.25");
    for pair in run.values[0].windows(2).chain(run.values[1].windows(2)) {
        assert!(pair[0] < pair[1]);
    }
}

#[test]
fn bedding_takes_its_part_of_the_strain() {
    let base = curve(&even(0.1, 400), "G0=125");
    let bedded = |q: f64| 0.004 * q / (q + 100.0);
    let path = base.control.iter().zip(&base.values[0]).map(|(e, &q)| e + bedded(q)).collect();
    let run = curve(&Triaxial { path, ..Triaxial::default() }, "bedding=0.004");
    for (run, base) in run.values.iter().zip(&base.values) {
        for (found, expected) in run.iter().zip(base) {
            assert_close(*found, *expected, 1e-4);
        }
    }
}

#[test]
fn piston_friction_is_added_once_mobilised() {
    let base = curve(&Triaxial::default(), "G0=125");
    let run = curve(&Triaxial::default(), "piston=5");
    assert_eq!(run.values[1], base.values[1]);
    assert_eq!(run.values[0][0], 0.0);
    for i in 10..base.control.len() {
        assert_close(run.values[0][i] - base.values[0][i], 5.0, 1e-3);
    }
}

#[test]
fn every_effect_shows_and_fades_to_nothing() {
    let base = curve(&Triaxial::default(), "G0=125");
    let distance = |given: &str| {
        let other = curve(&Triaxial::default(), given);
        let pairs = base.values[0].iter().zip(&other.values[0]);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    for (name, strong) in [("membrane", 1.0), ("bedding", 0.002), ("c", 10.0), ("de", 0.05), ("piston", 10.0)]
    {
        assert!(distance(&format!("{name}={strong}")) > 5.0, "{name} shows");
        assert!(distance(&format!("{name}={}", strong * 1e-9)) < 1e-4, "{name} fades");
        assert_eq!(distance(&format!("{name}=0")), 0.0);
    }
}

proptest! {
    #[test]
    fn curves_are_finite_and_start_at_nothing(
        g0 in 30.0..500.0f64, phi_c in 20.0..42.0f64, d0 in 0.0..3.0f64, h in 0.1..5.0f64,
        membrane in 0.0..2.0f64, bedding in 0.0..0.01f64, c in 0.0..50.0f64, de in -0.15..0.15f64,
        piston in 0.0..20.0f64,
    ) {
        let run = curve(&Triaxial::default(), &format!(
            "G0={g0},phi_c={phi_c},d0={d0},h={h},membrane={membrane},bedding={bedding},c={c},de={de},piston={piston}"
        ));
        prop_assert_eq!(run.values[0][0], 0.0);
        prop_assert_eq!(run.values[1][0], 0.0);
        prop_assert!(run.values[0][1..].iter().all(|&q| q > 0.0));
    }
}
