//! The pictures of gl-plot: what is in them, and what is refused.

use std::fs;
use std::process::{Command, Output};

use pipelines::folder::Folder;
use pipelines::path_with_tools;

/// A folder with tables, in which gl-plot runs.
struct Tables(Folder);

impl Tables {
    fn with(tables: &[(&str, &str)]) -> Self {
        let folder = Folder::default();
        for (name, table) in tables {
            folder.write(name, table);
        }
        Self(folder)
    }

    fn run(&self, arguments: &str) -> Output {
        self.0.call(&format!("gl-plot {arguments}"), "")
    }

    /// What a shell makes of a script, with the tools in its PATH.
    fn shell(&self, script: &str) -> Output {
        let mut shell = Command::new("sh");
        shell.args(["-e", "-c", script]).current_dir(self.0.path(".")).env("PATH", path_with_tools());
        shell.output().unwrap()
    }

    /// The SVG that a call prints.
    fn svg(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let svg = String::from_utf8(output.stdout).unwrap();
        check_svg(&svg);
        svg
    }

    /// What a call that must fail says.
    fn error(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(output.stdout.is_empty());
        message
    }
}

/// What every picture keeps: elements closed, numbers finite, and all text inside.
fn check_svg(svg: &str) {
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    for bad in ["NaN", "inf", " id=\"", "href", "<script"] {
        assert!(!svg.contains(bad), "{bad}");
    }
    for element in ["g", "svg", "text", "title"] {
        let opened =
            svg.matches(&format!("<{element}>")).count() + svg.matches(&format!("<{element} ")).count();
        assert_eq!(opened, svg.matches(&format!("</{element}>")).count(), "{element}");
    }
    let view: Vec<f64> = attribute(svg, "viewBox").split(' ').map(|number| number.parse().unwrap()).collect();
    for text in svg.split("<text ").skip(1) {
        let number = |name: &str| -> f64 { attribute(text, name).parse().unwrap() };
        let (x, y, long, size) = (number("x"), number("y"), number("textLength"), number("font-size"));
        assert!(size >= 7.0, "{text:.80}");
        let before = match attribute(text, "text-anchor") {
            "middle" => long / 2.0,
            "end" => long,
            _ => 0.0,
        };
        let (left, right, top, bottom) = if text.starts_with("x=") && text.contains("rotate(-90") {
            (x - size, x + 0.3 * size, y - long / 2.0, y + long / 2.0)
        } else {
            (x - before, x - before + long, y - size, y + 0.3 * size)
        };
        let inside = left >= -0.01 && top >= -0.01 && right <= view[2] + 0.01 && bottom <= view[3] + 0.01;
        assert!(inside, "outside the picture: {:.160}", text);
    }
}

/// The value of the first attribute of a name, empty if there is none before the element ends.
fn attribute<'a>(element: &'a str, name: &str) -> &'a str {
    let head = element.split_once('>').map_or(element, |(head, _)| head);
    let Some((_, rest)) = head.split_once(&format!("{name}=\"")) else { return "" };
    rest.split_once('"').unwrap().0
}

/// How many groups of a class there are.
fn count(svg: &str, class: &str) -> usize {
    svg.matches(&format!("<g class=\"{class}\">")).count()
}

/// How many series have a title.
fn series(svg: &str, title: &str) -> usize {
    svg.matches(&format!("<g class=\"series\"><title>{title}</title>")).count()
}

fn has_text(svg: &str, text: &str) -> bool {
    svg.contains(&format!(">{text}</text>"))
}

const OBSERVATIONS: &str = "u f q\n0 0 5\n1 1.1 6\n2 1.9 8\n1 0.8 7\n";
const ENSEMBLE: &str = "sample step u f q\na 0 0 0 5\na 1 1 0.9 5\na 2 2 1.8 7\na 3 1 0.9 8\nb 0 0 0 5\nb 1 1 1.1 6\nb 2 2 2.2 9\nb 3 1 1 7\n";
const WEIGHTS: &str = "sample E mu misfit error weight\na 1e11 0.3 4 0.1 0.25\nb 2e11 0.5 1 0.05 0.75\n";
const PARAMS: &str = "name lower upper scale unit\nE 1e11 2e11 linear Pa\nmu 0.01 0.5 log -\n";

fn calibration() -> Tables {
    Tables::with(&[
        ("obs.txt", OBSERVATIONS),
        ("ensemble.txt", ENSEMBLE),
        ("weights.txt", WEIGHTS),
        ("params.txt", PARAMS),
    ])
}

/// A weights table of many samples of many parameters, without a random generator.
fn many_weights(samples: usize, parameters: usize) -> String {
    let mut table = String::from("sample");
    (0..parameters).for_each(|j| table.push_str(&format!(" parameter_{j}")));
    table.push_str(" weight\n");
    for i in 0..samples {
        table.push_str(&format!("s{i}"));
        let places: Vec<f64> =
            (0..parameters).map(|j| (i as f64 * (0.618 + 0.0713 * j as f64)).fract()).collect();
        places.iter().for_each(|place| table.push_str(&format!(" {place}")));
        let distance: f64 = places.iter().map(|place| (place - 0.4).powi(2)).sum();
        table.push_str(&format!(" {}\n", (-10.0 * distance).exp()));
    }
    table
}

#[test]
fn a_fit_shows_measurement_mean_band_best_runs_and_residuals() {
    let svg = calibration()
        .svg("fit -b obs.txt -c u -v f,q -w weights.txt --noise f=0.1,q=0.2 --units q=MPa ensemble.txt");
    assert_eq!(count(&svg, "panel"), 4);
    // Each observable has its measurement once; the rest is in its residuals too.
    assert_eq!([series(&svg, "measured"), series(&svg, "mean"), series(&svg, "90 % band")], [2, 4, 4]);
    assert_eq!([series(&svg, "best run 1"), series(&svg, "best run 2"), series(&svg, "noise")], [4, 4, 4]);
    for label in ["f", "q (MPa)", "residual", "residual (MPa)", "u", "1: b", "2: a"] {
        assert!(has_text(&svg, label), "{label}");
    }
}

#[test]
fn a_fit_shows_the_band_of_the_draws_where_it_is_given() {
    let folder = calibration();
    let table = |steps: usize| {
        let rows = (0..steps).map(|step| format!("f {step} {step} 40 1 39 40 41\n"));
        format!("observable step control mean sd q05 q50 q95\n{}", rows.collect::<String>())
    };
    folder.0.write("curves.txt", table(4));
    let svg = folder.svg("fit -b obs.txt -c u -v f -w weights.txt --posterior curves.txt ensemble.txt");
    assert!(has_text(&svg, "posterior's mean") && has_text(&svg, "40"), "{svg}");
    // A reading that is far off may have been left out of it, and not half of them.
    folder.0.write("curves.txt", table(3));
    folder.svg("fit -b obs.txt -c u -v f -w weights.txt --posterior curves.txt ensemble.txt");
    folder.0.write("curves.txt", table(2));
    let said = folder.error("fit -b obs.txt -c u -v f -w weights.txt --posterior curves.txt ensemble.txt");
    assert!(said.contains("curves.txt: 2 steps of f where the measurement has 4"), "{said}");
}

#[test]
fn a_path_that_turns_back_is_drawn_in_its_own_order() {
    let svg = calibration().svg("fit -b obs.txt -c u -v f -w weights.txt ensemble.txt");
    let mean = svg.split("<title>mean</title>").nth(1).unwrap().split('"').nth(1).unwrap();
    let x: Vec<f64> =
        mean[1..].split('L').map(|point| point.split([' ', '-']).next().unwrap().parse().unwrap()).collect();
    assert_eq!(x.len(), 4);
    assert!(x[0] < x[1] && x[1] < x[2] && x[3] == x[1], "{x:?}");
}

#[test]
fn without_weights_every_run_counts_alike_and_none_is_best() {
    let svg = calibration().svg("fit -b obs.txt ensemble.txt");
    assert!(has_text(&svg, "mean of all runs"));
    assert_eq!(series(&svg, "best run 1"), 0);
}

#[test]
fn a_posterior_shows_weights_marginals_bounds_and_truth() {
    let svg = calibration().svg("posterior --whole -w weights.txt -p params.txt --truth E=1.5e11");
    assert_eq!(count(&svg, "panel"), 4);
    assert_eq!([series(&svg, "weights"), series(&svg, "90 % interval"), series(&svg, "prior")], [2, 2, 2]);
    assert_eq!([series(&svg, "lower bound"), series(&svg, "truth")], [2, 1]);
    for label in ["E (×10⁹ Pa)", "mu", "weight", "density", "100", "200"] {
        assert!(has_text(&svg, label), "{label}");
    }
}

#[test]
fn several_tables_of_weights_become_rows_of_one_picture() {
    let svg = calibration().svg(
        "posterior -w weights.txt -w weights.txt -w weights.txt --labels early,middle,late -p params.txt",
    );
    assert_eq!(count(&svg, "panel"), 2 * 4);
    assert_eq!(series(&svg, "density, early"), 2);
    assert!(has_text(&svg, "middle"));
}

#[test]
fn weights_at_several_steps_become_rows_in_the_order_of_the_steps() {
    let folder = calibration();
    let steps =
        "sample step E mu weight\na 19 1e11 0.3 0.4\nb 19 2e11 0.5 0.6\na 9 1e11 0.3 0.5\nb 9 2e11 0.5 0.5\n";
    folder.0.write("steps.txt", steps);
    let svg = folder.svg("posterior -w steps.txt -p params.txt");
    assert_eq!(count(&svg, "panel"), 2 * 3);
    let place = |label: &str| svg.find(&format!(">{label}</text>")).unwrap();
    assert!(place("step 9") < place("step 19"));
    assert_eq!(series(&svg, "density, step 9"), 2);
    let svg = folder.svg("posterior -w steps.txt -w weights.txt --labels first,second,all -p params.txt");
    assert_eq!(count(&svg, "panel"), 2 * 4);
}

#[test]
fn the_interval_of_a_summary_is_the_one_that_is_drawn() {
    let folder = calibration();
    folder.0.write("summary.txt", "quantity value\nmean(E) 1.5e11\nq05(E) 1.1e11\nq95(E) 1.9e11\nmean(mu) 0.4\nq05(mu) 0.3\nq95(mu) 0.45\n");
    let interval = |svg: &str| -> f64 {
        let path = svg.split("<title>90 % interval</title>").nth(1).unwrap().split('"').nth(1).unwrap();
        let x = path
            .trim_matches(['M', 'Z'])
            .split('L')
            .map(|point| point.split(' ').next().unwrap().parse::<f64>().unwrap());
        let (low, high) = x.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
        high - low
    };
    let axis = |svg: &str| -> f64 {
        let panel = svg.split("<svg x=").nth(1).unwrap();
        attribute(panel, "width").parse().unwrap()
    };
    let svg = folder.svg("posterior -w weights.txt -p params.txt --summary summary.txt");
    // 0.8e11 of an axis of 1e11 and 4 % on both sides, to the cells of the density.
    assert!((interval(&svg) / axis(&svg) - 0.8 / 1.08).abs() < 0.015, "{}", interval(&svg) / axis(&svg));
}

#[test]
fn pairs_are_a_triangle_with_every_iteration() {
    let folder = calibration();
    for i in 0..2 {
        let table = format!("description E mu\ni{i}a 1.2e11 0.{}\ni{i}b 1.6e11 0.2\n", i + 1);
        folder.0.write(&format!("samples{i}.txt"), table);
    }
    let svg = folder
        .svg("pairs -w weights.txt -s samples0.txt -s samples1.txt -p params.txt --truth E=1.3e11,mu=0.2");
    assert_eq!(count(&svg, "panel"), 3);
    assert_eq!([series(&svg, "samples0"), series(&svg, "samples1"), series(&svg, "truth")], [1, 1, 3]);
    assert_eq!([series(&svg, "posterior"), series(&svg, "90 % of the posterior")], [4, 1]);
    assert_eq!([series(&svg, "density of samples0"), series(&svg, "density of samples1")], [2, 2]);
    for i in [0, 3] {
        folder.0.write(&format!("iter{i}/samples.txt"), format!("description E mu\na{i} 1.2e11 0.3\n"));
    }
    let svg = folder.svg("pairs -w weights.txt -s iter0/samples.txt -s iter3/samples.txt");
    assert!(has_text(&svg, "iter0") && has_text(&svg, "iter3"));
}

#[test]
fn a_legend_names_a_few_of_many_iterations() {
    let folder = calibration();
    let mut call = String::from("pairs -w weights.txt -p params.txt");
    for i in 0..20 {
        folder.0.write(&format!("iter{i}/samples.txt"), format!("description E mu\na{i} 1.2e11 0.3\n"));
        call.push_str(&format!(" -s iter{i}/samples.txt"));
    }
    let svg = folder.svg(&call);
    let named = |svg: &str| (0..20).filter(|i| has_text(svg, &format!("iter{i}"))).collect::<Vec<_>>();
    assert_eq!(named(&svg), [0, 3, 7, 11, 15, 19]);
    assert_eq!(series(&svg, "iter5"), 1);
}

#[test]
fn a_close_up_is_as_wide_as_the_posterior() {
    let mut weights = String::from("sample E mu weight\n");
    for i in 0..200 {
        let weight = (-0.5 * ((i as f64 - 100.0) / 2.0).powi(2)).exp();
        weights.push_str(&format!("s{i} {} 0.{:03} {weight}\n", 1e11 + 5e8 * i as f64, 100 + i));
    }
    let folder = Tables::with(&[("weights.txt", &weights), ("params.txt", PARAMS)]);
    for kind in ["posterior", "pairs"] {
        let whole = if kind == "posterior" { "--whole" } else { "" };
        let wide = folder.svg(&format!("{kind} {whole} -w weights.txt -p params.txt"));
        assert!(has_text(&wide, "200") && !has_text(&wide, "150.0"), "{kind}");
        // The mean is 150e9, the standard deviation 1e9.
        let close = folder.svg(&format!("{kind} -w weights.txt -p params.txt --close-up"));
        assert!(!has_text(&close, "200") && (has_text(&close, "150") || has_text(&close, "150.0")), "{kind}");
    }
}

#[test]
fn a_history_shows_every_parameter_and_the_filter() {
    let folder = Tables::with(&[
        (
            "history.txt",
            "step sigma ess mean(E) mean(mu) cv(E) cv(mu)\n0 2 0.9 1e11 0.3 0.2 0.1\n1 2 0.5 1.2e11 0.35 0.1 0.05\n",
        ),
        (
            "s0.txt",
            "quantity value\nsigma 10\ness 0.3\nensemble_error 0.2\nbest_error 0.1\nbest_sample a\nmean(E) 1e11\nq05(E) 0.8e11\nq95(E) 1.2e11\n",
        ),
        (
            "s1.txt",
            "quantity value\nsigma 0.1\ness 0.3\nensemble_error 0.1\nbest_error 0.05\nbest_sample b\nmean(E) 1.1e11\nq05(E) 1e11\nq95(E) 1.2e11\n",
        ),
    ]);
    let svg = folder.svg("history history.txt --summary s0.txt --summary s1.txt");
    assert_eq!(count(&svg, "panel"), 2 * 2 + 2 + 4 + 1);
    for label in ["mu", "cv", "sigma", "ess", "ensemble error", "best error", "step", "iteration", "10⁰"] {
        assert!(has_text(&svg, label), "{label}");
    }
    let of_weights = folder.svg("history --summary s0.txt");
    assert_eq!(count(&of_weights, "panel"), 5);
    // Draws through an emulator weigh all the same.
    let emulated = format!("{}ignorance 0.3\n", folder.0.read("s0.txt"));
    folder.0.write("emulated.txt", &emulated);
    let of_draws = folder.svg("history --summary emulated.txt");
    assert_eq!(count(&of_draws, "panel"), 5);
    assert!(has_text(&of_draws, "ignorance") && !has_text(&of_draws, "ess") && has_text(&of_weights, "ess"));
}

#[test]
fn an_emulator_is_held_against_the_runs() {
    let folder = calibration();
    let predicted = "sample step u f f_sd\na 0 0 0.1 0.1\na 1 1 0.8 0.1\na 2 2 2 0.1\na 3 1 1 0.1\n";
    folder.0.write("predicted.txt", predicted);
    let svg = folder.svg("emulator -e ensemble.txt -v f predicted.txt");
    assert_eq!(count(&svg, "panel"), 2);
    // Errors 0.1, −0.1, 0.2, 0.1: √(0.07 / 4)
    assert!(has_text(&svg, "root mean square error 0.132"));
    assert!(has_text(&svg, "error / sd") && has_text(&svg, "simulated f"));
}

const LOO: &str = "observable step control measured q05 q25 q50 q75 q95 pit k\n\
    q 0 0 1.1 0.8 0.9 1 1.1 1.2 0.75 0.1\nq 1 1 2.4 1.8 1.9 2 2.1 2.2 0.99 -\nf 0 0 5 4 4.5 5 5.5 6 0.5 0.2\n";

#[test]
fn readings_beyond_what_the_others_predict_stand_out_and_their_places_are_counted() {
    let folder = Tables::with(&[("loo.txt", LOO)]);
    let svg = folder.svg("predictive -c u --units u=mm,q=kPa loo.txt");
    assert_eq!(count(&svg, "panel"), 4);
    assert!(has_text(&svg, "u (mm)") && has_text(&svg, "q less the median (kPa)"));
    assert!(has_text(&svg, "1 of 2 in the 90 % band, 1 in the 50 % band"));
    assert!(has_text(&svg, "1 of 1 in the 90 % band, 1 in the 50 % band"));
    let back = LOO.replace("f 0 0", "q 2 0.5");
    let svg = Tables::with(&[("loo.txt", &back)]).svg("predictive -c u loo.txt");
    assert!(has_text(&svg, "step") && !has_text(&svg, "u"));
    let message = Tables::with(&[("loo.txt", &LOO.replace("0.99", "x"))]).error("predictive loo.txt");
    assert!(message.contains("loo.txt:3: column pit"), "{message}");
}

const GAP: &str = "observable from to gap gap_sd z share significant steps\nq 0 2 0.1 1 0.1 0.01 no 0:3\nq 2 9 3 0.5 6 0.71 yes 3:10\nf 0 9 1 1 1 0.1 no 0:10\n";

#[test]
fn significant_stretches_of_a_gap_are_shaded() {
    let folder = Tables::with(&[("gap.txt", GAP), ("after.txt", &GAP.replace("yes", "no"))]);
    let svg = folder.svg("gap -c strain --units strain=% gap.txt --after after.txt");
    assert_eq!(count(&svg, "panel"), 2);
    assert_eq!([series(&svg, "significant"), series(&svg, "stretch")], [1, 6]);
    for label in ["71 %", "strain (%)", "gap of q / sd", "before", "after"] {
        assert!(has_text(&svg, label), "{label}");
    }
}

#[test]
fn the_gap_of_each_reading_is_shown_where_the_runs_are_given() {
    let folder = calibration();
    folder.0.write("gap.txt", GAP);
    let svg = folder.svg(
        "gap gap.txt -b obs.txt -e ensemble.txt -w weights.txt --noise f=0.1,q=0.2 \
         --after-ensemble ensemble.txt --after-weights weights.txt",
    );
    assert_eq!([count(&svg, "panel"), series(&svg, "readings")], [4, 4]);
    assert!(has_text(&svg, "u") && has_text(&svg, "each reading / sd"));
    let message = folder.error("gap gap.txt -b obs.txt -e ensemble.txt -w weights.txt");
    assert!(message.contains("4 steps are too few to estimate the noise from"), "{message}");
}

#[test]
fn where_the_control_turns_back_a_gap_is_drawn_along_the_steps() {
    let back = "observable from to gap gap_sd z share significant steps\nq 0 5 0 1 0.1 0 no 0:6\nq 4 0 3 1 6 1 yes 6:11\n";
    let svg = Tables::with(&[("gap.txt", back)]).svg("gap -c strain gap.txt");
    assert!(has_text(&svg, "step") && !has_text(&svg, "strain"));
    assert_eq!(series(&svg, "turning point"), 0);
}

/// The control of a measurement that is loaded, unloaded and loaded again, and its gap.
fn cycles() -> Tables {
    let path: Vec<u32> = (0..=20).chain((5..20).rev()).chain(6..=30).collect();
    let table = |head: &str, name: &str, force: &dyn Fn(u32) -> f64| {
        let rows = path.iter().enumerate().map(|(t, &u)| {
            if name.is_empty() {
                format!("{u} {}\n", force(u))
            } else {
                format!("{name} {t} {u} {}\n", force(u))
            }
        });
        format!("{head}\n{}", rows.collect::<String>())
    };
    let back = "observable from to gap gap_sd z share significant steps\n\
        f 0 20 1 1 1 0.1 no 0:20\nf 20 5 3 1 6 0.9 yes 20:36\nf 6 30 0 1 0.1 0 no 36:61\n";
    Tables::with(&[
        ("gap.txt", back),
        ("obs.txt", &table("u f", "", &f64::from)),
        ("runs.txt", &table("sample step u f", "a", &|u| 0.9 * f64::from(u))),
        ("weights.txt", "sample k weight\na 1 1\n"),
        ("curves.txt", &table("hypothesis probability step u f", "bend 0.9", &|u| 0.98 * f64::from(u))),
    ])
}

#[test]
fn where_the_control_turns_back_its_branches_are_marked_and_named() {
    let folder = cycles();
    let svg = folder.svg("gap gap.txt -b obs.txt -e runs.txt -w weights.txt --noise f=0.5");
    assert_eq!(series(&svg, "turning point"), 2);
    assert!(has_text(&svg, "rising") && has_text(&svg, "falling"));
    let svg = folder.svg("hypotheses -b obs.txt --units u=mm curves.txt");
    assert_eq!(series(&svg, "turning point"), 2);
    assert!(has_text(&svg, "u (mm)") && has_text(&svg, "step") && has_text(&svg, "falling"));
}

#[test]
fn an_attribution_has_a_bar_each_and_brackets_what_is_confounded() {
    let folder = Tables::with(&[
        (
            "attribution.txt",
            "hypothesis probability confounded_with\nnone 0.0004 -\nrolling 0.7 cohesion\noffset(q) 0.0996 -\ncohesion 0.2 rolling\n",
        ),
        ("effects.txt", "effect probability\nrolling 0.75\ncohesion 0.2\n"),
    ]);
    let svg = folder.svg("attribution attribution.txt --effects effects.txt");
    assert_eq!([count(&svg, "panel"), count(&svg, "series"), count(&svg, "bracket")], [2, 6, 1]);
    assert!(svg.contains("<title>confounded: rolling, cohesion</title>"));
    for label in ["70 %", "75 %", "&lt; 0.1 %", "offset(q)"] {
        assert!(has_text(&svg, label), "{label}");
    }
    folder.0.write("sure.txt", "hypothesis probability\nrolling+cohesion 1\nnone 0\n");
    let narrow = folder.svg("attribution sure.txt --width 80");
    let panel = narrow.split("<svg x=").nth(1).unwrap();
    let label = narrow.split("<text ").find(|text| text.contains(">100 %<")).unwrap();
    let number = |element: &str, name: &str| attribute(element, name).parse::<f64>().unwrap();
    let left: f64 = panel.split('"').nth(1).unwrap().parse().unwrap();
    assert!(number(label, "x") + number(label, "textLength") < left + number(panel, "width"));
    let few = folder.svg("attribution attribution.txt --most 2");
    assert!(has_text(&few, "2 further hypotheses together have 10 %"));
}

const CURVES: &str = "hypothesis probability step u f q\na+b 0.6 1 1 0.9 2\na+b 0.6 2 2 2 3\n\
    a 0.3 1 1 0.8 2\na 0.3 2 2 1.8 3\nnone 0.1 1 1 0.5 1\nnone 0.1 2 2 1 1\n";

#[test]
fn the_curves_of_hypotheses_lie_over_the_measurement_and_what_they_leave_below() {
    let obs = "u f q f_sd q_sd\n0 0 1 0.1 0.1\n1 1 2 0.1 0.1\n2 2 3 0.1 0.1\n3 9 9 0.1 0.1\n";
    let folder = Tables::with(&[("obs.txt", obs), ("curves.txt", CURVES)]);
    let svg = folder.svg("hypotheses -b obs.txt curves.txt");
    assert_eq!(count(&svg, "panel"), 4);
    // In each panel.
    assert_eq!([series(&svg, "a+b"), series(&svg, "none"), series(&svg, "noise")], [4, 4, 2]);
    for label in ["a+b (0.60)", "a (0.30)", "none (0.10)", "left of q", "noise, ± 1 sd"] {
        assert!(has_text(&svg, label), "{label}");
    }
    // The same effects with something else are the same curve.
    folder.0.write("rest.txt", CURVES.replace("a 0.3", "a+b+unexplained 0.3"));
    let svg = folder.svg("hypotheses -b obs.txt rest.txt");
    assert_eq!([series(&svg, "a+b"), series(&svg, "a+b+unexplained"), series(&svg, "none")], [4, 0, 4]);
    // The base model is never left out.
    let svg = folder.svg("hypotheses -b obs.txt --most 1 curves.txt");
    assert_eq!([series(&svg, "a+b"), series(&svg, "a"), series(&svg, "none")], [4, 0, 4]);
    for (from, to, says) in [
        ("a 0.3 2 2", "a 0.3 3 2", "bad.txt:4: the steps of a are not those of the measurement"),
        ("none 0.1 2 2 1 1\n", "", "bad.txt:6: the steps of none are not"),
        (" u f q\n", " u2 f q\n", "obs.txt:1: no column u2"),
    ] {
        folder.0.write("bad.txt", CURVES.replace(from, to));
        let message = folder.error("hypotheses -b obs.txt bad.txt");
        assert!(message.contains(says), "{message}");
    }
}

const CURVES_OF_TESTS: &str = "hypothesis probability test observable step control predicted\n\
    a 0.9 low f 0 0 1\na 0.9 low f 1 1 2\na 0.9 high q 1 5 3\na 0.9 high q 2 6 3.5\n\
    none 0.1 low f 0 0 1\nnone 0.1 low f 1 1 1\nnone 0.1 high q 1 5 2\nnone 0.1 high q 2 6 2\n";

#[test]
fn the_curves_of_several_tests_lie_over_the_measurement_of_each() {
    let folder = Tables::with(&[
        ("low.txt", "u f\n0 1\n1 2.1\n"),
        ("high.txt", "e q\n4 2\n5 3\n6 3.4\n7 4\n"),
        ("curves.txt", CURVES_OF_TESTS),
    ]);
    let tests = "--test low:low.txt:u:f:f=0.1 --test high:high.txt:e:q:q=0.2";
    let svg = folder.svg(&format!("hypotheses {tests} --units u=mm,q=kPa,e=s curves.txt"));
    assert_eq!([count(&svg, "panel"), series(&svg, "a"), series(&svg, "noise")], [4, 4, 2]);
    for label in ["low.f", "u (mm)", "high.q (kPa)", "left of high.q (kPa)", "e (s)", "a (0.90)"] {
        assert!(has_text(&svg, label), "{label}");
    }
    for (from, to, says) in [
        ("a 0.9 high q 2 6 3.5\n", "", "bad.txt:7: the steps of none are not those of the measurement"),
        ("a 0.9 high q 2", "a 0.9 high q 4", "bad.txt:4: the steps of a are not those"),
        ("none 0.1 high", "none 0.1 other", "bad.txt:8: no --test has the observable q of other"),
        (
            "none 0.1 high q 1 5 2\nnone 0.1 high q 2 6 2\n",
            "",
            "bad.txt: no curve of none for high.q; every hypothesis has one",
        ),
    ] {
        folder.0.write("bad.txt", CURVES_OF_TESTS.replace(from, to));
        let message = folder.error(&format!("hypotheses {tests} bad.txt"));
        assert!(message.contains(says), "{message}");
    }
    let message = folder.error("hypotheses -b low.txt curves.txt");
    assert!(message.contains("the curves of tests; give each as --test NAME:OBS:"), "{message}");
}

#[test]
fn the_gap_of_one_of_several_tests_is_that_of_its_observables_and_its_weighed_runs() {
    let runs = "sample step u f\na 0 0 1\na 1 1 2\na 2 2 3\nlost 0 0 9\nlost 1 1 9\nlost 2 2 9\n";
    let folder = Tables::with(&[
        (
            "gap.txt",
            "observable from to gap gap_sd z share significant\nlow.f 0 2 0 1 0.1 0 no\nhigh.q 0 9 3 0.5 6 0.9 yes\n",
        ),
        ("obs.txt", "u f\n0 1\n1 2\n2 3\n"),
        ("runs.txt", runs),
        ("weights.txt", "sample k weight\na 1 1\n"),
    ]);
    let svg = folder.svg("gap --of low -b obs.txt -e runs.txt -w weights.txt --noise f=0.1 gap.txt");
    assert_eq!([count(&svg, "panel"), series(&svg, "readings")], [2, 1]);
    assert!(has_text(&svg, "gap of f / sd"));
    let message = folder.error("gap --of none gap.txt");
    assert!(message.contains("--of none: gap.txt has no observable none.NAME"), "{message}");
    let message = folder.error("gap -b obs.txt -e runs.txt -w weights.txt --noise f=0.1 gap.txt");
    assert!(message.contains("no sample lost"), "{message}");
}

#[test]
fn pictures_hold_at_one_and_eight_parameters_and_at_ten_and_ten_thousand_samples() {
    for parameters in [1, 2, 8] {
        for samples in [1, 10, 10_000] {
            let folder = Tables::with(&[("weights.txt", &many_weights(samples, parameters))]);
            for (kind, panels) in
                [("posterior", 2 * parameters), ("pairs", parameters * (parameters + 1) / 2)]
            {
                let svg = folder.svg(&format!("{kind} -w weights.txt"));
                assert_eq!(count(&svg, "panel"), panels);
                assert!(svg.len() < 1_000_000, "{kind} {parameters} {samples}: {} bytes", svg.len());
            }
        }
    }
}

#[test]
fn a_fit_of_ten_thousand_steps_stays_small() {
    let mut observations = String::from("u f f_sd\n");
    let mut ensemble = String::from("sample step u f\n");
    for i in 0..10_000 {
        let noise = (f64::from(i) * 0.618).fract();
        observations.push_str(&format!("{i} {} 0.1\n", f64::from(i).sqrt() + noise));
    }
    for sample in ["a", "b", "c"] {
        for i in 0..10_000 {
            let noise = (f64::from(i) * 0.577).fract();
            ensemble.push_str(&format!("{sample} {i} {i} {}\n", f64::from(i).sqrt() + 10.0 * noise));
        }
    }
    let weights = "sample misfit weight\na 1 0.5\nb 2 0.3\nc 3 0.2\n";
    let folder =
        Tables::with(&[("obs.txt", &observations), ("ensemble.txt", &ensemble), ("weights.txt", weights)]);
    let svg = folder.svg("fit -b obs.txt -w weights.txt ensemble.txt");
    assert!(svg.len() < 1_000_000, "{} bytes", svg.len());
}

#[test]
fn the_same_tables_give_the_same_bytes() {
    let folder = calibration();
    for end in ["svg", "pdf", "png"] {
        let picture = |name: &str| {
            let name = format!("{name}.{end}");
            let output = folder.run(&format!("pairs -w weights.txt -p params.txt -o {name}"));
            assert!(output.status.success());
            fs::read(folder.0.path(&name)).unwrap()
        };
        assert_eq!(picture("one"), picture("two"));
    }
}

#[test]
fn a_png_has_the_size_in_print_that_was_asked_for() {
    let folder = calibration();
    assert!(folder.run("fit -b obs.txt ensemble.txt --width 85 --dpi 254 -o fit.png").status.success());
    let png = fs::read(folder.0.path("fit.png")).unwrap();
    let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
    // 85 mm at 254 dots an inch, which are 10 dots a millimetre.
    assert_eq!(number(16), 850);
    let physical = png.windows(4).position(|window| window == b"pHYs").unwrap();
    assert_eq!(number(physical + 4), 10_000);
}

#[test]
fn a_pdf_has_the_size_in_print_and_its_font_in_it() {
    let folder = calibration();
    assert!(folder.run("fit -b obs.txt ensemble.txt --width 85 -o fit.pdf").status.success());
    let pdf = fs::read(folder.0.path("fit.pdf")).unwrap();
    let text = String::from_utf8_lossy(&pdf);
    assert!(text.starts_with("%PDF-") && text.contains("/FontFile2"));
    let page = text.split("/MediaBox [0 0 ").nth(1).unwrap();
    // 85 mm in points of 1/72 inch.
    assert!(page.starts_with("240.94"), "{page:.40}");
}

#[test]
fn a_narrow_posterior_is_shown_closely_with_its_range_above() {
    let mut weights = String::from("sample E mu weight\n");
    for i in 0..200 {
        let weight = (-0.5 * ((i as f64 - 100.0) / 2.0).powi(2)).exp();
        weights.push_str(&format!("s{i} {} 0.{} {weight}\n", 1e11 + 5e8 * i as f64, 1 + i % 4));
    }
    let folder = Tables::with(&[("weights.txt", &weights), ("params.txt", PARAMS)]);
    let svg = folder.svg("posterior -w weights.txt -p params.txt");
    // The range of E is drawn above its panels; mu is known so little that its panels show all of it.
    assert_eq!(count(&svg, "range"), 1);
    assert!(svg.contains("<title>range of the prior of E</title>"));
    assert!(has_text(&svg, "1·10¹¹") && has_text(&svg, "2·10¹¹"));
    assert_eq!([series(&svg, "prior"), series(&svg, "lower bound")], [2, 1]);
}

#[test]
fn panels_are_headed_by_mean_and_interval() {
    let folder = calibration();
    let summary = "quantity value\nmean(E) 1.5e11\nq05(E) 1.1e11\nq95(E) 1.9e11\nmean(mu) 0.4\nq05(mu) 0.3\nq95(mu) 0.45\n";
    folder.0.write("summary.txt", summary);
    for kind in ["posterior", "pairs"] {
        let svg = folder.svg(&format!("{kind} -w weights.txt -p params.txt --summary summary.txt"));
        assert!(has_text(&svg, "150 (110 – 190)·10⁹") && has_text(&svg, "0.400 (0.300 – 0.450)"), "{kind}");
    }
}

/// A thousand draws of an exponential, whose shortest 90 % goes from 0 to ln 10 (by 901 of them a little further) and not
/// from −ln 0.95 to −ln 0.05, and of a uniform law; the same as a logarithm, on a logarithmic scale.
#[test]
fn where_a_posterior_is_skewed_the_interval_is_the_shortest_one() {
    let mut weights = String::from("sample tail even log weight\n");
    for i in 0..1000 {
        let (u, v) = ((f64::from(i) + 0.5) / 1000.0, (f64::from(i) * 0.618).fract());
        weights += &format!("s{i} {} {v} {} 0.001\n", -(1.0 - u).ln(), (-(1.0 - u).ln()).exp());
    }
    let params = "name lower upper scale\ntail 0 20 linear\neven 0 1 linear\nlog 1 1e9 log\n";
    let summary: String = ["tail", "even", "log"]
        .map(|name| format!("mean({name}) 1\nq05({name}) 0.0513\nq95({name}) 2.9957\n"))
        .concat();
    let folder = Tables::with(&[
        ("weights.txt", &weights),
        ("params.txt", params),
        ("summary.txt", &format!("quantity value\n{summary}")),
    ]);
    for kind in ["posterior", "pairs --width 250"] {
        for summary in ["", "--summary summary.txt"] {
            let svg = folder.svg(&format!("{kind} -w weights.txt -p params.txt {summary}"));
            assert!(has_text(&svg, "1.00 (0.00 – 2.31)"), "{kind} {summary}");
        }
        let svg = folder.svg(&format!("{kind} -w weights.txt -p params.txt"));
        // Even in the middle of its range, and e to the exponential.
        assert!(has_text(&svg, "0.50 (0.05 – 0.95)") && svg.contains("(1.0 – 10.1)</text>"), "{kind}");
    }
    let svg = folder.svg("posterior -w weights.txt -p params.txt");
    assert_eq!([series(&svg, "shortest 90 % interval"), series(&svg, "90 % interval")], [2, 1]);
    assert!(has_text(&svg, "90 % interval, where skewed the shortest"));
    // Few runs: what chance made short is no shorter.
    let few: String = weights.lines().take(51).map(|row| format!("{row}\n")).collect();
    folder.0.write("weights.txt", few.replace("0.001", "0.02"));
    assert!(!folder.svg("posterior -w weights.txt -p params.txt").contains("shortest"));
}

#[test]
fn parameters_that_stand_still_are_left_out() {
    let still = "sample E off weight\na 1e11 0 0.25\nb 2e11 0 0.75\n";
    let folder = Tables::with(&[
        ("weights.txt", still),
        ("history.txt", "step sigma ess mean(E) mean(off) cv(E) cv(off)\n0 2 1 1 0 1 0\n1 2 1 2 0 1 0\n"),
    ]);
    assert_eq!(count(&folder.svg("pairs -w weights.txt --truth off=0"), "panel"), 1);
    assert_eq!(count(&folder.svg("posterior -w weights.txt"), "panel"), 2);
    assert_eq!(count(&folder.svg("history history.txt"), "panel"), 2 + 2);
    // Where nothing moves, all is shown.
    folder.0.write("one.txt", "sample E off weight\na 1e11 0 1\n");
    assert_eq!(count(&folder.svg("posterior -w one.txt"), "panel"), 4);
}

#[test]
fn draws_have_no_panel_of_weights() {
    let folder = Tables::with(&[
        ("draws.txt", "sample E mu weight\na 1 2 0.25\nb 2 5 0.25\nc 3 4 0.25\nd 4 4 0.25\n"),
        ("runs.txt", "sample E mu weight\na 1 2 0.3\nb 2 5 0.2\nc 3 4 0.25\nd 4 4 0.25\n"),
    ]);
    assert_eq!(count(&folder.svg("posterior -w draws.txt"), "panel"), 2);
    assert_eq!(count(&folder.svg("posterior -w runs.txt"), "panel"), 4);
}

#[test]
fn the_mean_of_a_fit_lies_over_the_best_run() {
    let svg = calibration().svg("fit -b obs.txt -c u -v f -w weights.txt ensemble.txt");
    let place = |title: &str| svg.find(&format!("<title>{title}</title>")).unwrap();
    assert!(place("best run 1") < place("90 % band") && place("90 % band") < place("mean"));
}

#[test]
fn names_cannot_break_out_of_the_svg() {
    let weights = "sample a<b>&\"c weight\nx 1 0.5\ny 2 0.5\n";
    let svg = Tables::with(&[("weights.txt", weights)]).svg("posterior -w weights.txt");
    assert!(has_text(&svg, "a&lt;b&gt;&amp;&quot;c"));
}

#[test]
fn bad_input_says_what_would_be_right_and_writes_nothing() {
    let folder = calibration();
    let cases = [
        (
            "fit -b obs.txt ensemble.txt -o fit.eps",
            "-o fit.eps: a picture is called NAME.svg, NAME.pdf or NAME.png",
        ),
        ("fit -b obs.txt ensemble.txt -o picture", "-o picture: a picture is called"),
        ("fit -b weights.txt -c u -v f ensemble.txt", "weights.txt:1: no column"),
        ("fit -b obs.txt -v z ensemble.txt", "ensemble.txt:1: no column z"),
        ("fit -b obs.txt -w obs.txt ensemble.txt", "obs.txt:1: no column sample"),
        ("posterior -w obs.txt", "obs.txt:1: no column sample"),
        ("posterior -w weights.txt --truth x=1", "--truth x: no such parameter; they are E, mu"),
        ("posterior -w weights.txt --labels a,b", "--labels: 2 names for 1 sets of weights"),
        ("pairs -w weights.txt -s obs.txt", "obs.txt:1: no column description"),
        ("history weights.txt", "weights.txt:1: no column step"),
        ("history --summary weights.txt", "weights.txt:1: no column quantity"),
        ("proposal weights.txt", "weights.txt"),
        ("gap weights.txt", "weights.txt:1: no column observable"),
        ("attribution weights.txt", "weights.txt:1: no column hypothesis"),
        ("emulator -e ensemble.txt obs.txt", "obs.txt:1: no column sample"),
        ("fit -b obs.txt ensemble.txt --width 5", "not between"),
        ("history", "required"),
        ("drawing", "unrecognized"),
    ];
    for (arguments, expected) in cases {
        folder.0.refuses(&format!("gl-plot {arguments}"), &[expected]);
    }
}

#[test]
fn a_table_without_rows_is_an_error() {
    let folder = Tables::with(&[
        ("obs.txt", OBSERVATIONS),
        ("ensemble.txt", "sample step u f\n"),
        ("weights.txt", "sample a weight\n"),
        ("history.txt", "step sigma ess mean(a) cv(a)\n"),
        ("gap.txt", "observable from to gap gap_sd z share significant\n"),
        ("attribution.txt", "hypothesis probability\n"),
        ("proposal.txt", "weight mean(a)\n"),
        ("curves.txt", "hypothesis probability step u f\n"),
        ("loo.txt", "observable step control measured q05 q25 q50 q75 q95 pit k\n"),
    ]);
    for arguments in [
        "fit -b obs.txt ensemble.txt",
        "posterior -w weights.txt",
        "pairs -w weights.txt",
        "history history.txt",
        "gap gap.txt",
        "attribution attribution.txt",
        "proposal proposal.txt",
        "predictive loo.txt",
        "hypotheses -b obs.txt curves.txt",
        "emulator -e ensemble.txt ensemble.txt",
    ] {
        let message = folder.error(arguments);
        assert!(
            message.contains("no rows") || message.contains("no runs") || message.contains("no sample"),
            "{message}"
        );
    }
}

#[test]
fn a_full_disk_is_an_error_and_a_closed_pipe_is_not() {
    let folder = calibration();
    let output = folder.shell("gl-plot fit -b obs.txt ensemble.txt > /dev/full");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("cannot be written"));
    let output = folder.shell("(gl-plot fit -b obs.txt ensemble.txt; echo $? > code) | true; cat code");
    assert_eq!((output.stdout.as_slice(), output.stderr.as_slice()), (&b"0\n"[..], &b""[..]));
}
