//! `gl-posterior` between the tools before and after it.

use std::collections::HashSet;

use std::fmt::Write as _;

use gl_numeric::statistics::{mean, sd};
use gl_table::Table;
use gl_table::verdict::Verdicts;
use pipelines::coverage::problem::normal;
use pipelines::folder::Folder;
use pipelines::oracle;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Write the ensemble of the samples in a table: `curve(parameters, x)` at each control value.
fn simulate(
    folder: &Folder,
    samples: &str,
    ensemble: &str,
    control: &[f64],
    curve: impl Fn(&[f64], f64) -> f64,
) {
    let names = folder.texts(samples, "description");
    let columns: Vec<Vec<f64>> = folder.table(samples).format().columns()[2..]
        .to_vec()
        .iter()
        .map(|name| folder.column(samples, name))
        .collect();
    let mut text = "sample step x y\n".to_owned();
    for (i, name) in names.iter().enumerate() {
        let values: Vec<f64> = columns.iter().map(|column| column[i]).collect();
        for (step, &x) in control.iter().enumerate() {
            writeln!(text, "{name} {step} {x} {}", curve(&values, x)).unwrap();
        }
    }
    folder.write(ensemble, text);
}

fn line(p: &[f64], x: f64) -> f64 {
    p[0] * x + p[1]
}

/// One of the data sets of tests/oracle/linear_posterior.py, with `runs` runs of the line.
fn linear(data: &str, runs: usize) -> Folder {
    let folder = Folder::default();
    for file in ["obs.txt", "params.txt"] {
        let text = std::fs::read(oracle(&format!("linear_posterior_{data}_{file}"))).unwrap();
        folder.write(file, text);
    }
    folder.run(&format!("gl-sample -p params.txt -n {runs} --method sobol -o samples.txt"));
    simulate(&folder, "samples.txt", "ensemble.txt", &folder.column("obs.txt", "x"), line);
    folder
}

/// A number of tests/oracle/linear_posterior.tsv.
fn exact(data: &str, noise: &str, quantity: &str) -> f64 {
    let table = Table::read(&oracle("linear_posterior.tsv")).unwrap();
    let column = |name: &str| table.format().column(name).unwrap();
    let (of, by, what, value) = (column("data"), column("noise"), column("quantity"), column("value"));
    let is_it = |row: &usize| {
        table.field(*row, of) == data && table.field(*row, by) == noise && table.field(*row, what) == quantity
    };
    let row = (0..table.len()).find(is_it).unwrap();
    table.number(row, value).unwrap()
}

/// Of a line with a known noise the residual of a reading that was left out is normal with mean r/(1 − h) and standard
/// deviation s/√(1 − h): r the residual of the fit, h its leverage, s that of the noise.
#[test]
fn each_reading_of_a_line_is_predicted_from_the_others_as_the_closed_form_has_it() {
    let folder = linear("few", 20);
    let noise = exact("few", "known", "noise_sd");
    folder.run(&format!(
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y --noise y={noise} --noise-as-stated -n 2000 \
         --loo-out loo.txt --curves-out curves.txt --verdict verdict.txt -o draws.txt ensemble.txt"
    ));
    let (x, y) = (folder.column("obs.txt", "x"), folder.column("obs.txt", "y"));
    let n = x.len() as f64;
    let (centre, level) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let square: f64 = x.iter().map(|x| (x - centre).powi(2)).sum();
    let slope = x.iter().zip(&y).map(|(x, y)| (x - centre) * y).sum::<f64>() / square;
    let pit = folder.column("loo.txt", "pit");
    let (low, high) = (folder.column("loo.txt", "q05"), folder.column("loo.txt", "q95"));
    assert_eq!(
        (folder.column("loo.txt", "control"), folder.column("loo.txt", "measured")),
        (x.clone(), y.clone())
    );
    let of_draws = ["mean", "q05", "q95"].map(|column| folder.column("curves.txt", column));
    for i in 0..x.len() {
        // The line itself, without noise.
        let (line, leverage) = (level + slope * (x[i] - centre), 1.0 / n + (x[i] - centre).powi(2) / square);
        let band = 2.0 * gl_numeric::normal::normal_quantile(0.95) * noise * leverage.sqrt();
        assert!((of_draws[0][i] - line).abs() < 0.05 * noise, "reading {i}: {} for {line}", of_draws[0][i]);
        assert!(((of_draws[2][i] - of_draws[1][i]) / band - 1.0).abs() < 0.07, "reading {i} for {band}");
        let residual = y[i] - level - slope * (x[i] - centre);
        let left = 1.0 - 1.0 / n - (x[i] - centre).powi(2) / square;
        let (mean, sd) = (y[i] - residual / left, noise / left.sqrt());
        let right = gl_numeric::normal::normal_cdf((y[i] - mean) / sd);
        assert!((pit[i] - right).abs() < 0.03, "reading {i}: {} for {right}", pit[i]);
        let width = 2.0 * gl_numeric::normal::normal_quantile(0.95) * sd;
        assert!(
            ((high[i] - low[i]) / width - 1.0).abs() < 0.05,
            "reading {i}: {} for {width}",
            high[i] - low[i]
        );
    }
    let verdicts = Verdicts::read(&folder.path("verdict.txt")).unwrap();
    let inside = pit.iter().filter(|pit| (0.05..=0.95).contains(*pit)).count();
    let said = &verdicts.find("covers").unwrap().text;
    assert!(said.starts_with(&format!("{inside} of 10 readings lie in the 90 % band")), "{said}");
}

/// Readings that scatter three times as far as they are said to do not look like a draw.
#[test]
fn readings_that_scatter_further_than_stated_are_not_inside() {
    let folder = linear("tutorial", 20);
    let noise = exact("tutorial", "known", "noise_sd") / 3.0;
    let call = format!(
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y --noise y={noise} --loo-out loo.txt \
         --verdict verdict.txt -o draws.txt ensemble.txt"
    );
    let find = |code: &str| Verdicts::read(&folder.path("verdict.txt")).unwrap().find(code).cloned();
    folder.run(&format!("{call} --noise-as-stated"));
    assert!(find("too-few-inside").is_some());
    // Counted as large as it is, the same noise holds them, and that is said.
    folder.run(&call);
    let said = find("covers").unwrap().text;
    assert!(said.contains("by its neighbours and the noise as it is counted, said above"), "{said}");
}

/// tests/oracle/curve_posterior.py: two curved parameters on a grid, four by emcee.
#[test]
fn the_draws_of_curves_follow_a_grid_and_emcee() {
    let oracle_of = |file: &str| std::fs::read(oracle(&format!("curve_posterior_{file}"))).unwrap();
    let exact = Table::read(&oracle("curve_posterior.tsv")).unwrap();
    for (data, runs, observables) in [("two", 30, "y"), ("four", 100, "y,z")] {
        let folder = Folder::default();
        folder.write("obs.txt", oracle_of("obs.txt"));
        folder.write("params.txt", oracle_of(&format!("{data}_params.txt")));
        folder.run(&format!("gl-sample -p params.txt -n {runs} --method sobol -o samples.txt"));
        let names = folder.texts("samples.txt", "description");
        let parameters: Vec<Vec<f64>> = ["a", "b", "c", "d"][..if data == "two" { 2 } else { 4 }]
            .iter()
            .map(|name| folder.column("samples.txt", name))
            .collect();
        let mut text = format!("sample step x {}\n", observables.replace(',', " "));
        for (i, name) in names.iter().enumerate() {
            let p: Vec<f64> = parameters.iter().map(|column| column[i]).collect();
            for (step, x) in folder.column("obs.txt", "x").into_iter().enumerate() {
                write!(text, "{name} {step} {x} {}", p[0] * (1.0 - (-p[1] * x).exp())).unwrap();
                if data == "four" {
                    write!(text, " {}", p[2] * x.powf(p[3]) + p[0] * p[1] * x / 4.0).unwrap();
                }
                text.push('\n');
            }
        }
        folder.write("ensemble.txt", text);
        let noise = observables.split(',').map(|name| format!("{name}=0.05")).collect::<Vec<_>>().join(",");
        folder.run(&format!(
            "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v {observables} --noise {noise} \
             --noise-as-stated -n 2000 --summary summary.txt -o draws.txt ensemble.txt"
        ));
        let column = |name: &str| exact.format().column(name).unwrap();
        let (of, what, value) = (column("data"), column("quantity"), column("value"));
        let rows = || (0..exact.len()).filter(|row| exact.field(*row, of) == data);
        let there = |quantity: &str| {
            let row = rows().find(|row| exact.field(*row, what) == quantity).unwrap();
            exact.number(row, value).unwrap()
        };
        for row in rows() {
            let quantity = exact.field(row, what);
            let (kind, name) = quantity.split_once('(').unwrap();
            let (here, right) = (folder.quantity("summary.txt", quantity), there(quantity));
            let spread = there(&format!("sd({name}"));
            // 2000 draws of a Monte Carlo: its means are good to a tenth of a standard deviation.
            let tolerance = if kind.starts_with('q') { 0.25 } else { 0.12 };
            assert!((here - right).abs() < tolerance * spread, "{data} {quantity}: {here} {right}");
        }
    }
}

const CALL: &str = "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt \
                    --summary summary.txt --verdict verdict.txt -o draws.txt";

fn verdicts(folder: &Folder) -> Verdicts {
    Verdicts::read(&folder.path("verdict.txt")).unwrap()
}

#[test]
fn the_draws_of_a_line_follow_the_closed_form() {
    for data in ["few", "centred", "tutorial"] {
        for noise in ["known", "jeffreys_box"] {
            let folder = linear(data, 12);
            let stated = exact(data, "known", "noise_sd");
            let flags = if noise == "known" {
                format!("--noise y={stated} --noise-as-stated")
            } else {
                String::new()
            };
            folder.run(&format!("{CALL} {flags} -n 2000"));
            if folder.quantity("summary.txt", "correlation") > 0.0 {
                // The residuals of this data set are correlated by chance, which the closed form does not ask.
                assert_eq!((data, noise), ("few", "jeffreys_box"));
                continue;
            }
            for name in ["a", "b"] {
                let of = |kind: &str| folder.quantity("summary.txt", &format!("{kind}({name})"));
                let true_of = |kind: &str| exact(data, noise, &format!("{kind}({name})"));
                let spread = true_of("sd");
                assert!(
                    (of("mean") - true_of("mean")).abs() < 0.12 * spread,
                    "{data} {noise} {name}: {}",
                    of("mean")
                );
                assert!(
                    (of("sd") / spread - 1.0).abs() < 0.1,
                    "{data} {noise} {name}: {}",
                    of("sd") / spread
                );
                for kind in ["q05", "q95"] {
                    assert!(
                        (of(kind) - true_of(kind)).abs() < 0.25 * spread,
                        "{data} {noise} {kind}({name})"
                    );
                }
            }
            let [a, b] = ["a", "b"].map(|name| folder.column("draws.txt", name));
            let even = vec![1.0 / a.len() as f64; a.len()];
            let products: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a * b).collect();
            let covariance = mean(&products, &even) - mean(&a, &even) * mean(&b, &even);
            let correlation = covariance / (sd(&a, &even) * sd(&b, &even));
            let of = |quantity: &str| exact(data, "known", quantity);
            let there = of("cov(a,b)") / (of("sd(a)") * of("sd(b)"));
            // Four standard errors of the correlation of so many draws.
            let tolerance = 4.0 * (1.0 - there * there) / (a.len() as f64).sqrt();
            assert!((correlation - there).abs() < tolerance, "{data} {noise}: {correlation} {there}");
        }
    }
}

#[test]
fn threads_and_the_order_of_the_runs_make_no_difference() {
    let folder = linear("tutorial", 14);
    folder.run(&format!("{CALL} --noise y=2"));
    let draws = folder.read("draws.txt");
    for threads in ["1", "3"] {
        let words: Vec<&str> = CALL.split_whitespace().collect();
        let mut call = pipelines::tool(words[0]);
        let call = call.args(&words[1..]).args(["--noise", "y=2"]).current_dir(folder.path("."));
        call.env("RAYON_NUM_THREADS", threads).assert().success();
        assert_eq!(folder.read("draws.txt"), draws);
    }
    let table = folder.read("ensemble.txt");
    let (header, rows) = table.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    let turned: Vec<String> = rows.chunks(100).rev().map(|run| run.join("\n")).collect();
    folder.write("ensemble.txt", format!("{header}\n{}\n", turned.join("\n")));
    folder.run(&format!("{CALL} --noise y=2"));
    assert_eq!(folder.read("draws.txt"), draws);
}

#[test]
fn next_runs_are_inside_the_bounds_and_of_any_number() {
    let folder = linear("centred", 10);
    for count in [1, 2, 7, 64] {
        folder.run(&format!(
            "{CALL} --noise y=0.05 --next {count} --next-out next.txt --name mine --iteration 3"
        ));
        let names = folder.texts("next.txt", "description");
        assert_eq!(names.len(), count);
        assert!(names[0].starts_with("mine_Iter3_Sample0"), "{}", names[0]);
        // Each at a place of its own: of equal parameters some simulators give the equal run.
        let places: HashSet<(String, String)> =
            folder.texts("next.txt", "a").into_iter().zip(folder.texts("next.txt", "b")).collect();
        assert_eq!(places.len(), count);
        let params = folder.table("params.txt");
        for (row, name) in ["a", "b"].iter().enumerate() {
            let bounds = ["lower", "upper"].map(|bound| params.numbers(bound).unwrap()[row]);
            let column = folder.column("next.txt", name);
            assert!(column.iter().all(|x| (bounds[0]..=bounds[1]).contains(x)), "{column:?}");
            assert!(count < 3 || column.iter().any(|x| *x != column[0]));
        }
    }
}

/// A curve that is no straight line in its parameters: y = (½ + a) (1 − exp(−(1 + 4b) x)).
fn curve(p: &[f64], x: f64) -> f64 {
    (0.5 + p[0]) * (1.0 - (-(1.0 + 4.0 * p[1]) * x).exp())
}

fn control(steps: usize) -> Vec<f64> {
    (1..=steps).map(|t| t as f64 / steps as f64).collect()
}

/// A measurement of a curve with noise of 0.02 times `scale`, of this correlation.
fn measured(steps: usize, correlation: f64, scale: f64, curve: impl Fn(f64) -> f64) -> Folder {
    let folder = Folder::default();
    let mut generator = ChaCha8Rng::seed_from_u64(11);
    let mut state = normal(&mut generator);
    let mut text = "x y\n".to_owned();
    for x in control(steps) {
        writeln!(text, "{x} {}", curve(x) + 0.02 * scale * state).unwrap();
        state = correlation * state + (1.0 - correlation * correlation).sqrt() * normal(&mut generator);
    }
    folder.write("obs.txt", text).write("params.txt", "name lower upper\na 0 1\nb 0 1\n");
    folder.run("gl-sample -p params.txt -n 10 --method sobol -o samples.txt");
    folder
}

/// Readings that are called far off, whatever they are, leave what a table without them leaves, of one test and of two.
#[test]
fn what_is_far_off_counts_for_nothing() {
    let folder = measured(20, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    let (far, all) = ([3, 4, 11], control(20));
    let near: Vec<f64> = (0..20).filter(|step| !far.contains(step)).map(|step| all[step]).collect();
    let rows: Vec<String> = folder.read("obs.txt").lines().map(str::to_owned).collect();
    let is_far = |row: &usize| row.checked_sub(1).is_some_and(|step| far.contains(&step));
    let kept: Vec<&str> = (0..rows.len()).filter(|row| !is_far(row)).map(|row| rows[row].as_str()).collect();
    let spoilt: Vec<String> = (0..rows.len())
        .map(|row| if is_far(&row) { format!("{} {row}", all[row - 1]) } else { rows[row].clone() })
        .collect();
    folder.write("obs.txt", spoilt.join("\n") + "\n").write("less.txt", kept.join("\n") + "\n");
    simulate(&folder, "samples.txt", "ensemble.txt", &all, curve);
    simulate(&folder, "samples.txt", "fewer.txt", &near, curve);
    let table = |name: &str| {
        let row = |step: &usize| format!("{name} {step}\n");
        format!("observable step\n{}", far.iter().map(row).collect::<String>())
    };
    folder.write("far.txt", table("y")).write("far-of-test.txt", table("two.y"));
    folder
        .run(&format!("{CALL} --noise y=0.02 --outliers far.txt --loo-out loo.txt --curves-out curves.txt"));
    let without = folder.read("summary.txt");
    assert_eq!(folder.column("loo.txt", "control"), near);
    assert_eq!(folder.column("curves.txt", "control"), near);
    let fewer = CALL.replace("obs.txt", "less.txt").replace("ensemble.txt", "fewer.txt");
    folder.run(&format!("{fewer} --noise y=0.02"));
    assert_eq!(without, folder.read("summary.txt"));

    let tests = |obs: &str, ensemble: &str| {
        format!(
            "gl-posterior -p params.txt -s samples.txt --test one:less.txt:x:y:y=0.02 --test two:{obs}:x:y:y=0.02 \
             one=fewer.txt two={ensemble} --summary summary.txt -o draws.txt"
        )
    };
    folder.run(&format!("{} --outliers far-of-test.txt --loo-out loo.txt", tests("obs.txt", "ensemble.txt")));
    let without = folder.read("summary.txt");
    assert_eq!(folder.column("loo.txt", "control"), [near.clone(), near].concat());
    folder.run(&tests("less.txt", "fewer.txt"));
    assert_eq!(without, folder.read("summary.txt"));

    folder.write("far.txt", "observable step\ny 20\n");
    folder.refuses(&format!("{CALL} --outliers far.txt"), &["far.txt", "step 20 of y is none of 0:20"]);
}

#[test]
fn a_batch_that_comes_out_as_predicted_proves_the_posterior() {
    let folder = measured(40, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(40), curve);
    folder.run(&format!("{CALL} --noise y=0.02 --next 4 --next-out next.txt"));
    assert!(!folder.read("summary.txt").contains("proof"));
    simulate(&folder, "next.txt", "more.txt", &control(40), curve);
    folder.write("before.txt", folder.read("summary.txt"));
    folder.run(&format!("{CALL} -s next.txt more.txt --noise y=0.02"));
    assert_eq!(folder.quantity("summary.txt", "runs"), 14.0);
    // One of them is far off, as it was predicted to be, and proves nothing.
    assert_eq!(folder.quantity("summary.txt", "proof_runs"), 3.0);
    let output = folder.call("gl-check-stop --previous before.txt summary.txt -o stop.txt", "");
    assert_eq!(output.status.code(), Some(0), "{}", folder.read("stop.txt"));
    assert_eq!(
        folder.texts("stop.txt", "criterion"),
        ["ignorance", "shift", "spread", "proof", "scatter", "settled"]
    );
    // A batch that is another model's is no proof.
    simulate(&folder, "next.txt", "more.txt", &control(40), |p, x| curve(p, x) + 0.3 * p[0] * x);
    folder.run(&format!("{CALL} -s next.txt more.txt --noise y=0.02"));
    let output = folder.call("gl-check-stop --previous before.txt summary.txt -o stop.txt", "");
    assert_eq!(output.status.code(), Some(1), "{}", folder.read("stop.txt"));
    assert!(folder.quantity("summary.txt", "proof_z") > 3.0);
}

#[test]
fn the_first_batch_is_never_enough() {
    let folder = measured(40, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(40), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    let output = folder.call("gl-check-stop --previous none summary.txt -o stop.txt", "");
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn correlated_noise_that_was_told_white_is_said_and_counted_with() {
    let folder = measured(80, 0.8, 1.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(80), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    assert_eq!(verdicts(&folder).find("noise-correlated").unwrap().value, "y");
    let (wide, correlation) =
        (folder.quantity("summary.txt", "sd(a)"), folder.quantity("summary.txt", "correlation"));
    assert!(correlation > 0.5, "{correlation}");
    assert!(folder.quantity("summary.txt", "independent_readings") < 40.0);
    folder.run(&format!("{CALL} --noise y=0.02 --noise-as-stated"));
    assert_eq!(verdicts(&folder).find("noise-correlated").unwrap().value, "y");
    assert!(wide > 1.5 * folder.quantity("summary.txt", "sd(a)"));
}

#[test]
fn a_noise_that_is_taken_for_white_may_be_larger_and_is_not_correlated() {
    let folder = measured(80, 0.8, 2.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(80), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    assert!(folder.quantity("summary.txt", "correlation") > 0.5);
    folder.run(&format!("{CALL} --noise y=0.02 --white"));
    let said = verdicts(&folder).find("noise-correlated").unwrap().text.clone();
    assert!(said.contains("it is taken for white"), "{said}");
    assert_eq!(folder.quantity("summary.txt", "correlation"), 0.0);
    let inflation = folder.quantity("summary.txt", "inflation");
    assert!((inflation - 2.0).abs() < 0.7, "{inflation}");
    let both = format!("{CALL} --noise y=0.02 --white --noise-as-stated");
    folder.refuses(&both, &["cannot be used with"]);
}

/// What no run has shown might fit a wave that the model does not have. The closest fit is asked for among what they have.
#[test]
fn a_closest_fit_is_not_sought_where_nothing_is_known() {
    let load = |p: &[f64], x: f64| {
        let [k, m, a, h] = [p[0], p[1], p[2], p[3]];
        100.0 * m * (1.0 - (-k * x).exp()) * (1.0 + a * (-x / h).exp() * x * k / (1.0 + x * k))
    };
    let folder = Folder::default();
    let control: Vec<f64> = (0..240).map(|t| 0.1 + 7.9 * f64::from(t) / 239.0).collect();
    let mut generator = ChaCha8Rng::seed_from_u64(3);
    let mut text = "x y\n".to_owned();
    for x in &control {
        let y = load(&[2.3, 0.53, 0.42, 5.8], *x) + 0.1 * (normal(&mut generator) + 3.0 * (2.0 * x).sin());
        writeln!(text, "{x} {y}").unwrap();
    }
    let wide = "name lower upper\nk 0.8 6\nm 0.45 0.75\na 0.25 1.2\nh 2.5 15\n";
    let near = "name lower upper\nk 2.2 2.5\nm 0.5 0.55\na 0.39 0.45\nh 5.7 6.5\n";
    folder.write("obs.txt", text).write("params.txt", wide).write("near-params.txt", near);
    folder.run("gl-sample -p params.txt -n 20 -o samples.txt");
    folder.run("gl-sample -p near-params.txt -n 10 --name near -o near.txt");
    simulate(&folder, "samples.txt", "ensemble.txt", &control, load);
    simulate(&folder, "near.txt", "near-ensemble.txt", &control, load);
    folder.run(&format!("{CALL} -s near.txt near-ensemble.txt --noise y=0.1 --scatter 0 --white"));
    let ignorance = folder.quantity("summary.txt", "ignorance");
    assert!(ignorance < 5.0, "{ignorance}");
    // By least squares: 2.347, 0.527, 0.418, 6.11.
    let k = folder.quantity("summary.txt", "mean(k)");
    assert!((k - 2.347).abs() < 0.05, "{k}");
}

#[test]
fn white_noise_that_is_as_stated_is_not_doubted() {
    let folder = measured(80, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(80), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    assert!(
        verdicts(&folder).rows.iter().all(|row| !row.code.starts_with("noise")),
        "{:?}",
        verdicts(&folder)
    );
}

#[test]
fn a_fit_that_is_worse_or_better_than_the_noise_allows_is_said() {
    let folder = measured(80, 0.0, 1.5, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(80), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    assert!(verdicts(&folder).find("noise-too-small").is_some());
    let inflation = folder.quantity("summary.txt", "inflation");
    assert!((inflation - 1.5).abs() < 0.3, "{inflation}");
    let wide = folder.quantity("summary.txt", "sd(a)");
    folder.run(&format!("{CALL} --noise y=0.02 --noise-as-stated"));
    assert!(verdicts(&folder).find("noise-too-small").is_some());
    assert!(wide > 1.2 * folder.quantity("summary.txt", "sd(a)"));
    folder.run(&format!("{CALL} --noise y=0.06"));
    let said = verdicts(&folder);
    assert!(said.find("noise-too-large").is_some(), "{said:?}\n{}", folder.read("summary.txt"));
}

#[test]
fn a_measurement_that_alternates_is_a_bad_fit_for_all_who_look() {
    let folder = measured(80, 0.0, 0.6, |x| {
        let side = if ((80.0 * x).round() as usize).is_multiple_of(2) { 1.0 } else { -1.0 };
        curve(&[0.4, 0.6], x) + 0.015 * side
    });
    simulate(&folder, "samples.txt", "ensemble.txt", &control(80), curve);
    folder.run(&format!("{CALL} --noise y=0.02"));
    let said = verdicts(&folder).find("noise-alternates").unwrap().text.clone();
    assert!(said.contains("changes its sign with every reading or two more than noise does"), "{said}");
    assert!(folder.quantity("summary.txt", "chi_square_p") > 0.01, "its size is that of noise");
    let output = folder.call("gl-check-stop --error-tol 1 summary.txt", "");
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("the fit is bad: what it leaves changes its sign"), "{text}");
}

#[test]
fn two_modes_are_kept() {
    let two = |p: &[f64], x: f64| 4.0 * (p[0] - 0.5).powi(2) * x + (0.3 + p[1]) * x * x;
    let folder = measured(40, 0.0, 0.5, |x| two(&[0.2, 0.5], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(40), two);
    folder.run(&format!("{CALL} --noise y=0.01 --next 8 --next-out next.txt"));
    simulate(&folder, "next.txt", "more.txt", &control(40), two);
    folder.run(&format!("{CALL} -s next.txt more.txt --noise y=0.01"));
    let a = folder.column("draws.txt", "a");
    let share = a.iter().filter(|a| **a > 0.5).count() as f64 / a.len() as f64;
    assert!((share - 0.5).abs() < 0.15, "{share}");
}

#[test]
fn the_weights_of_the_real_runs_go_on_to_other_tools() {
    let folder = measured(40, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    simulate(&folder, "samples.txt", "ensemble.txt", &control(40), curve);
    folder.run(&format!("{CALL} --noise y=0.02 --run-weights runs.txt"));
    assert_eq!(folder.texts("runs.txt", "sample").len(), 10);
    let weights = folder.column("runs.txt", "weight");
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    folder.run("gl-predict -w runs.txt ensemble.txt -o predicted.txt");
}

#[test]
fn a_parameter_that_stays_where_it_is_stays_there() {
    let folder = measured(40, 0.0, 1.0, |x| curve(&[0.4, 0.6], x));
    folder.write("params.txt", "name lower upper effect off\na 0 1 - -\nb 0 1 - -\nk 1 2 extra 0\n");
    folder.run("gl-sample -p params.txt -n 10 --method sobol -o samples.txt");
    simulate(&folder, "samples.txt", "ensemble.txt", &control(40), curve);
    folder.run(&format!("{CALL} --noise y=0.02 --next 3 --next-out next.txt"));
    assert!(folder.column("draws.txt", "k").iter().all(|k| *k == 0.0));
    assert!(folder.column("next.txt", "k").iter().all(|k| *k == 0.0));
    assert_eq!(folder.quantity("summary.txt", "sd(k)"), 0.0);
    assert!(!folder.read("summary.txt").contains("shrinkage(k)"));
}

#[test]
fn input_that_is_wrong_is_refused() {
    let folder = linear("few", 10);
    let call = |rest: &str| {
        format!("gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y {rest} -o out.txt")
    };
    folder.refuses(&call("ensemble.txt -n 1"), &["-n 1", "at least 2"]);
    folder.refuses(&call("ensemble.txt --next 0 --next-out next.txt"), &["--next 0"]);
    folder.refuses(&call("ensemble.txt --noise q=1"), &["--noise q", "no such observable"]);
    folder.refuses(&call("ensemble.txt --steps 40:50"), &["--steps"]);
    folder.refuses(&call("ensemble.txt ensemble.txt"), &["is in ensemble.txt already"]);
    folder
        .write("few.txt", folder.read("ensemble.txt").lines().take(31).collect::<Vec<_>>().join("\n") + "\n");
    folder.refuses(&call("few.txt"), &["3 runs for 2 inputs"]);
    folder.write(
        "sd.txt",
        folder
            .read("ensemble.txt")
            .replace("x y", "x y y_sd")
            .replace('\n', " 1\n")
            .replacen(" 1\n", "\n", 1),
    );
    folder.refuses(&call("sd.txt"), &["_sd columns"]);
    folder.write("effects.txt", "name lower upper effect off\na 0.25 1.14 - -\nb -4.5 0.3 shift 3\n");
    folder.run("gl-sample -p effects.txt -n 12 --effects switch -o switched.txt");
    simulate(&folder, "switched.txt", "switched-runs.txt", &folder.column("obs.txt", "x"), line);
    folder.refuses(
        "gl-posterior -p effects.txt -s switched.txt -b obs.txt -c x -v y switched-runs.txt -o out.txt",
        &["outside its bounds", "gl-gap-attribute"],
    );
}
