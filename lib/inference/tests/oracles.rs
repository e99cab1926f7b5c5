//! Point sets, priors and weighted statistics against scipy and mpmath; the fixtures and the scripts
//! that made them are in `tests/oracle`.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::Path;

use gl_inference::prior::{Prior, normal_quantile};
use gl_numeric::sequence::{Halton, Method, points};
use gl_numeric::statistics::{Quantiles, ess_fraction, ln_sum_exp, mean, normalised, sd};
use gl_table::Table;

fn oracle(name: &str) -> Table {
    Table::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/oracle").join(name)).unwrap()
}

fn text<'a>(table: &'a Table, row: usize, name: &str) -> &'a str {
    table.field(row, table.format().column(name).unwrap())
}

fn coordinates(table: &Table, row: usize) -> Vec<f64> {
    (1..=8).map(|j| text(table, row, &format!("x{j}")).parse().unwrap()).collect()
}

fn assert_points(here: &[f64], there: &[f64], row: usize) {
    for (x, expected) in here.iter().zip(there) {
        assert!((x - expected).abs() <= 1e-15, "row {row}: {x} is not {expected}");
    }
}

#[test]
fn plain_halton_and_sobol_points_are_scipys() {
    for (method, file) in [(Method::Halton, "halton.tsv"), (Method::Sobol, "sobol.tsv")] {
        let table = oracle(file);
        let all = points(method, table.len(), 8, None).unwrap();
        (0..table.len()).for_each(|row| assert_points(&all[row], &coordinates(&table, row), row));
    }
}

#[test]
fn halton_points_far_along_are_scipys() {
    let (table, halton) = (oracle("halton_100000.tsv"), Halton::new(8, None));
    for row in 0..table.len() {
        let index = text(&table, row, "index").parse().unwrap();
        assert_points(&halton.point(index), &coordinates(&table, row), row);
    }
}

/// To 1e-12 of the range on the prior's own scale, or the resolution of `f64` where the range is narrower
/// than that; and to 1e-12 of the density.
#[test]
fn priors_have_the_quantiles_and_densities_of_sixty_digits() {
    let table = oracle("prior.tsv");
    for row in 0..table.len() {
        let field = |name: &str| text(&table, row, name);
        let columns = ["scale", "lower", "upper", "mean", "sd"];
        let params = format!("name {}\nx {}\n", columns.join(" "), columns.map(field).join(" "));
        let prior = Prior::from_table(&Table::parse("params", params.clone().into_bytes()).unwrap());
        if field("upper").parse::<f64>().unwrap() >= 1e100 {
            // No curve of such values could be calculated with.
            assert!(prior.is_err(), "{params}");
            continue;
        }
        let prior = prior.unwrap();
        let parameter = &prior.parameters()[0];
        let [u, x, ln_density] = ["u", "x", "ln_density"].map(|name| field(name).parse::<f64>().unwrap());

        let z = parameter.coordinate(x);
        let found = parameter.coordinate(parameter.quantile(u));
        let is_log = field("scale") == "log";
        let own = |x: f64| if is_log { x.ln() } else { x };
        let (low, high) = (own(parameter.lower), own(parameter.upper));
        let resolution =
            f64::EPSILON * low.abs().max(high.abs()).max(f64::from(u8::from(is_log))) / (high - low);
        assert!((found - z).abs() <= 1e-12 + 4.0 * resolution, "{params}{u}: {found} is not {z}");

        let ln_range = (high - low).ln() + if is_log { x.ln() } else { 0.0 };
        let (here, there) = (parameter.ln_density(z.clamp(0.0, 1.0)), ln_density + ln_range);
        // Far out in a tail the density follows from x, which is as exact as an f64 can hold it.
        let slope = parameter
            .normal
            .map_or(0.0, |(mean, sd)| ((own(x) - mean) / sd).abs() * own(x).abs().max(1.0) / sd);
        assert!(
            (here - there).abs() <= 1e-12 * (1.0 + there.abs()) + 4.0 * f64::EPSILON * slope,
            "{params}{u}: {here} is not {there}"
        );
    }
}

/// Φ at −1, −6 and −37.5 by the continued fraction of Abramowitz & Stegun 26.2.14, 20 000 terms in 60 digits
/// (Python's `decimal`).
#[test]
fn normal_quantiles_are_exact_in_the_middle_and_far_out() {
    for (p, x) in [
        (0.158_655_253_931_457_05, -1.0),
        (9.865_876_450_376_98e-10, -6.0),
        (4.605_353_009_581_955e-308, -37.5),
        (0.5, 0.0),
        (0.841_344_746_068_542_9, 1.0),
    ] {
        assert!((normal_quantile(p) - x).abs() <= 4e-16 * (1.0 + x.abs()), "{p}: {}", normal_quantile(p));
    }
    assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
    assert_eq!(normal_quantile(1.0), f64::INFINITY);
}

/// The samples of each case: ln weights and values.
fn cases() -> BTreeMap<String, (Vec<f64>, Vec<f64>)> {
    let table = oracle("quantiles_samples.tsv");
    let mut cases: BTreeMap<String, (Vec<f64>, Vec<f64>)> = BTreeMap::new();
    for row in 0..table.len() {
        let (ln_w, x) = cases.entry(text(&table, row, "case").to_owned()).or_default();
        ln_w.push(text(&table, row, "ln_w").parse().unwrap());
        x.push(text(&table, row, "x").parse().unwrap());
    }
    cases
}

#[test]
fn weighted_statistics_are_those_of_fifty_digits() {
    let (table, cases) = (oracle("quantiles.tsv"), cases());
    let mut compared = 0;
    for row in 0..table.len() {
        let (case, quantity) = (text(&table, row, "case"), text(&table, row, "quantity"));
        let expected: f64 = text(&table, row, "value").parse().unwrap();
        let (ln_w, x) = &cases[case];
        let w = normalised(ln_w).unwrap();
        let here = match quantity {
            "ln_sum" => ln_sum_exp(ln_w),
            "ess" => ess_fraction(ln_w).unwrap() * x.len() as f64,
            "ess_fraction" => ess_fraction(ln_w).unwrap(),
            "mean" => mean(x, &w),
            "sd" => sd(x, &w),
            "cv" => sd(x, &w) / mean(x, &w),
            _ => match quantity.strip_prefix('m').map(|p| p.parse::<f64>().unwrap() / 100.0) {
                Some(p) => Quantiles::new(x, &w).at(p),
                None => continue,
            },
        };
        // A spread of values far from zero has as many digits less.
        let size = expected.abs().max(if quantity == "sd" { x[0].abs() * 1e-3 } else { 0.0 });
        assert!(
            (here - expected).abs() <= 1e-12 * size.max(1e-3),
            "{case} {quantity}: {here} is not {expected}"
        );
        compared += 1;
    }
    assert!(compared > 100);
}

#[test]
fn quantiles_do_not_depend_on_the_order_of_the_rows() {
    for (case, (ln_w, x)) in cases() {
        let w = normalised(&ln_w).unwrap();
        let (backwards_w, backwards_x): (Vec<f64>, Vec<f64>) =
            (w.iter().rev().copied().collect(), x.iter().rev().copied().collect());
        for p in [0.05, 0.2, 0.5, 0.77, 0.95] {
            let (here, there) =
                (Quantiles::new(&x, &w).at(p), Quantiles::new(&backwards_x, &backwards_w).at(p));
            assert_eq!(here, there, "{case} {p}");
        }
    }
}
