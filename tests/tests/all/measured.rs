//! What is wrong with a measurement: errors of the rig, known ones and those that a diagnosis finds and puts in, and readings
//! that are far off.

use pipelines::calibration::write_curve;
use pipelines::folder::Folder;

const PARAMS: &str = "name\tlower\tupper\teffect\toff\na\t0\t2\t-\t-\nbend\t0.2\t2\tbending\t0\n";
const MODEL: (&str, &str) = ("-v a={a} -v b={bend}", "a * x + b * x * x");

/// The size of the one error of the rig in what a diagnosis has put in, and its name.
fn put_in(folder: &Folder) -> (String, f64) {
    let winner = folder.read("out/winner.txt");
    let (name, size) = winner.lines().nth(1).unwrap().rsplit_once('=').unwrap();
    (name.to_owned(), size.parse().unwrap())
}

#[test]
fn an_error_of_the_rig_beside_an_effect_is_put_in_with_it_so_that_the_gap_closes_as_was_foretold() {
    let folder = Folder::default();
    write_curve(&folder, ("both", PARAMS), |x| 0.4 + 0.8 * x + 1.1 * x * x, MODEL);
    let said = folder.run("gl-diagnose case measurement=offset --out out");
    assert!(folder.read("out/winner.txt").starts_with("bending\n"), "{}", folder.read("out/winner.txt"));
    let (name, size) = put_in(&folder);
    assert_eq!(name, "offset(y)");
    assert!((size - 0.4).abs() < 0.02, "{size}");
    assert!(said.contains("as the rig would have recorded them, with offset(y)="), "{said}");
    let shrink = |table: &str, row: usize| folder.column(table, "shrink")[row];
    assert!(shrink("out/predicted-shrink.txt", 0) > 0.95);
    assert!(shrink("out/shrink.txt", 1) > 0.95, "{}", folder.read("out/shrink.txt"));
    // The parameters are those that were in it, and the measurement is as it was.
    for (name, truth) in [("a", 0.8), ("bend", 1.1)] {
        let [mean, sd] = ["mean", "sd"]
            .map(|of| folder.quantity("out/after-bending+rig/posterior.txt", &format!("{of}({name})")));
        assert!((mean - truth).abs() < 4.0 * sd, "{name}: {mean} ± {sd} is not {truth}");
    }
    let page = folder.read("out/report.html");
    assert!(page.contains("The simulator was calibrated again with bending and offset(y) in."));
    // Called again it finds all of it as it was.
    assert!(!folder.run("gl-diagnose case measurement=offset --out out").contains("gl-run"));
}

#[test]
fn an_error_of_the_rig_alone_is_proved_by_a_calibration_too() {
    let folder = Folder::default();
    write_curve(&folder, ("tilted", PARAMS), |x| 0.4 + 0.8 * x, MODEL);
    folder.run("gl-diagnose case measurement=offset --out out");
    assert_eq!(folder.read("out/winner.txt").lines().next(), Some(""));
    assert_eq!(put_in(&folder).0, "offset(y)");
    assert!(folder.column("out/shrink.txt", "shrink")[1] > 0.95, "{}", folder.read("out/shrink.txt"));
    // None of its runs is called as one of the calibration without it.
    assert!(folder.texts("out/after-rig/iter0/samples.txt", "description")[0].starts_with("tilted-rig_"));
}

#[test]
fn an_error_that_is_known_is_in_every_run_of_a_calibration() {
    let folder = Folder::default();
    write_curve(
        &folder,
        ("known", "name\tlower\tupper\na\t0\t2\n"),
        |x| 0.4 + 0.8 * x,
        ("-v a={a}", "a * x"),
    );
    folder.run("gl-calibrate case rig=offset(y)=0.4 --out out");
    let [mean, sd] = ["mean(a)", "sd(a)"].map(|name| folder.quantity("out/posterior.txt", name));
    assert!((mean - 0.8).abs() < 4.0 * sd && sd < 0.02, "{mean} ± {sd}");
    for (given, said) in [
        ("rig=offset(z)=1", "offset(z): no observable z: observables names y"),
        ("rig=lag(y)=1", "lag(y): a lag is of all observables; give lag=SIZE"),
        ("rig=tilt=1", "they are offset, gain, drift, compliance, lag"),
    ] {
        folder.refuses(&format!("gl-calibrate case {given} --out other"), &[given, said]);
    }
}

#[test]
fn runs_are_collected_as_the_rig_would_have_recorded_them() {
    let folder = Folder::default();
    folder.write("samples.txt", "description\ta\nr\t1\n").write("obs.txt", "x f g\n0 0 0\n1 0 0\n2 0 0\n");
    folder.write("runs/r_param.txt", "a\n1\n").write("runs/r_sim.txt", "x f g\n0 0 5\n1 2 5\n2 4 7\n");
    let collected = |rig: &str| {
        folder.run(&format!("gl-collect -s samples.txt -b obs.txt -c x -v f,g runs --rig {rig} -o out.txt"));
        ["f", "g"].map(|name| folder.column("out.txt", name))
    };
    assert_eq!(collected("offset(g)=1,gain(f)=0.5"), [[0.0, 3.0, 6.0], [6.0, 6.0, 8.0]]);
    assert_eq!(collected("lag=1"), [[0.0, 0.0, 2.0], [5.0, 5.0, 5.0]]);
    let call = "gl-collect -s samples.txt -b obs.txt -c x -v f,g runs --rig";
    folder.refuses(&format!("{call} offset(q)=1"), &["--rig", "no observable q; they are f, g"]);
    folder.refuses(&format!("{call} offset"), &["is not ERROR=SIZE, such as offset(q)=0.3"]);
}

#[test]
fn an_error_of_one_of_several_tests_is_in_the_runs_of_that_test() {
    let folder = Folder::default();
    write_curve(&folder, ("two", "name\tlower\tupper\na\t0\t2\n"), |x| 0.8 * x, ("-v a={a}", "a * x"));
    folder
        .write("case/high.txt", folder.read("case/obs.txt"))
        .write("case/low.txt", folder.read("case/obs.txt"));
    let tests =
        "\n[[test]]\nname = \"low\"\nobs = \"low.txt\"\n\n[[test]]\nname = \"high\"\nobs = \"high.txt\"\n";
    folder.write("case/case.toml", folder.read("case/case.toml") + tests);
    folder.run("gl-calibrate case rig=offset(high.y)=0.4 iterations=1 --out out");
    let first = |test: &str| folder.column(&format!("out/iter0/{test}/ensemble.txt"), "y")[0];
    assert_eq!((first("low"), first("high")), (0.0, 0.4));
    let said = "of which test? They are low, high: give offset(low.OBSERVABLE), or lag(low)";
    folder.refuses("gl-calibrate case rig=offset(y)=0.4 --out other", &[said]);
}

#[test]
fn a_calibration_leaves_out_what_its_case_calls_far_off() {
    let folder = Folder::default();
    let far = |x: f64| if x > 0.9 { 0.5 } else { 0.0 };
    write_curve(
        &folder,
        ("far", "name\tlower\tupper\na\t0\t2\n"),
        |x| 0.8 * x + far(x),
        ("-v a={a}", "a * x"),
    );
    let last = folder.column("case/obs.txt", "x").len() - 1;
    let first = folder.column("case/obs.txt", "x").iter().position(|x| *x > 0.9).unwrap();
    let rows: String = (first..=last).map(|step| format!("y {step}\n")).collect();
    folder.write("case/far.txt", format!("observable step\n{rows}"));
    folder.run("gl-calibrate case outliers=far.txt --out out");
    let [mean, sd] = ["mean(a)", "sd(a)"].map(|name| folder.quantity("out/posterior.txt", name));
    assert!((mean - 0.8).abs() < 4.0 * sd && sd < 0.02, "{mean} ± {sd}");
    folder.write("case/far.txt", format!("observable step\ny {}\n", last + 1));
    let said = ["outliers", "far.txt", "step"];
    folder.refuses("gl-calibrate case outliers=far.txt --out other", &said);
    folder.refuses(
        "gl-calibrate case outliers=far.txt posterior=weights --out other",
        &["weights of runs take every reading"],
    );
}

#[test]
fn of_a_reading_that_is_far_off_no_gap_is_made() {
    let folder = Folder::default();
    let far = |x: f64| if (x - 0.5).abs() < 0.01 { 0.5 } else { 0.0 };
    write_curve(&folder, ("far", PARAMS), |x| 0.8 * x + 1.1 * x * x + far(x), MODEL);
    folder.run("gl-diagnose case --out out");
    assert_eq!(folder.read("out/winner.txt"), "bending\n");
    assert_eq!(folder.read("out/outliers.txt"), "observable\tstep\ny\t15\n");
    assert!(folder.quantity("out/after-bending/posterior.txt", "chi_square_p") > 0.01);
    assert!(folder.quantity("out/base/posterior.txt", "chi_square_p") < 0.01);
    for (table, row) in [("out/predicted-shrink.txt", 0), ("out/shrink.txt", 1)] {
        assert!(folder.column(table, "shrink")[row] > 0.95, "{table}: {}", folder.read(table));
    }
    let is_alone = folder.texts("out/locate.txt", "steps").contains(&"15:16".to_owned());
    assert!(!is_alone, "{}", folder.read("out/locate.txt"));
    assert!(folder.read("out/report.html").contains("looks like an outlier"));
}
