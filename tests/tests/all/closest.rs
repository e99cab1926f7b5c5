//! Beside a rest, how far the gap closes is measured between the fits of least squares.

use pipelines::calibration::write_curve;
use pipelines::folder::Folder;

/// y = a x + wave sin(12 x) is simulated; what is measured is more, and smooth.
fn case_with_a_rest() -> Folder {
    let folder = Folder::default();
    write_curve(
        &folder,
        ("one", "name\tlower\tupper\teffect\toff\na\t0\t2\t-\t-\nwave\t0.2\t2\twaving\t0\n"),
        |x| 0.8 * x + 0.9 * (12.0 * x).sin() + 0.06 * (5.0 * x).cos(),
        ("-v a={a} -v w={wave}", "a * x + w * sin(12 * x)"),
    );
    folder
}

/// Root mean square of what least squares leave, as a share of the range: by a alone, and by a and the wave.
fn left_by_least_squares(folder: &Folder) -> [f64; 2] {
    let (x, y) = (folder.column("case/obs.txt", "x"), folder.column("case/obs.txt", "y"));
    let s: Vec<f64> = x.iter().map(|x| (12.0 * x).sin()).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let left = |a: f64, wave: f64| {
        let square = |i: usize| (y[i] - a * x[i] - wave * s[i]).powi(2);
        let range = y.iter().copied().fold(f64::MIN, f64::max) - y.iter().copied().fold(f64::MAX, f64::min);
        ((0..y.len()).map(square).sum::<f64>() / y.len() as f64).sqrt() / range
    };
    let determinant = dot(&x, &x) * dot(&s, &s) - dot(&x, &s).powi(2);
    let a = (dot(&x, &y) * dot(&s, &s) - dot(&s, &y) * dot(&x, &s)) / determinant;
    let wave = (dot(&x, &x) * dot(&s, &y) - dot(&x, &s) * dot(&x, &y)) / determinant;
    [left(dot(&x, &y) / dot(&x, &x), 0.0), left(a, wave)]
}

#[test]
fn a_shrink_beside_a_rest_is_that_of_least_squares_as_it_was_foretold() {
    let folder = case_with_a_rest();
    let said = folder.call("gl-diagnose case --out out", "");
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("measured between closest fits"), "{said}");
    assert_eq!(folder.texts("out/attribution.txt", "hypothesis")[0], "waving+unexplained");
    assert_eq!(folder.texts("out/shrink-between.txt", "folder"), ["closest-base", "closest-after-waving"]);
    let [before, after] = left_by_least_squares(&folder);
    let all = |column: &str| *folder.column("out/shrink.txt", column).last().unwrap();
    assert!((all("gap_before") / before - 1.0).abs() < 0.002, "{} {before}", all("gap_before"));
    assert!((all("gap_after") / after - 1.0).abs() < 0.01, "{} {after}", all("gap_after"));
    let foretold = |column: &str| folder.column("out/predicted-shrink.txt", column)[0];
    let shrink = all("shrink");
    assert!(foretold("shrink_low") < shrink && shrink < foretold("shrink_high"), "{shrink}");
    // The calibration itself, whose noise is correlated, stays as it is, and does not come as close.
    let error = |fit: &str| folder.quantity(&format!("out/{fit}/posterior.txt"), "ensemble_error");
    assert!(error("after-waving") > 1.02 * error("closest-after-waving"));
    let report = folder.read("out/report.md");
    assert!(report.contains("`out/closest-base` and `out/closest-after-waving`"), "{report}");
    assert_eq!(report.matches("runs: closest fit").count(), 2);
    // It is held against what was foretold.
    let shrunk = |call: &&str| call.contains("gl-gap-shrink");
    let calls = folder.read("out/commands.log");
    assert!(calls.lines().find(shrunk).unwrap().contains("--foretold out/predicted-shrink.txt"), "{calls}");
    // Called again it has nothing to do.
    folder.run("gl-diagnose case --out out");
    assert_eq!(folder.read("out/commands.log"), calls);
    // Runs that were made are told where the gap is not measured between their fits.
    folder.write("out/shrink-between.txt", "part\tfolder\nbefore\tbase\nafter\tafter-waving\n");
    folder.run("gl-report case --out out");
    let report = folder.read("out/report.md");
    assert!(!report.contains("`out/closest-base` and"), "{report}");
    assert_eq!(report.matches("runs: closest fit").count(), 2);
    // What is named explains a gap only where the calibration with it fits, or for a noise that was told of.
    let stop = |i: usize| format!("out/after-waving/iter{i}/stop-verdict.txt");
    let last = (0..).map(stop).take_while(|stop| folder.path(stop).exists()).last().unwrap();
    let headline = |noise: &str, fit: &str| {
        let cause = "cause\twaving\twaving explains it";
        folder.write("out/attribution-verdict.txt", format!("code\tvalue\ttext\n{cause}\n{noise}"));
        folder.write(&last, format!("code\tvalue\ttext\nstop\tsettled\tstop, by settled\n{fit}"));
        folder.run("gl-report case --out out");
        folder.read("out/report.md").lines().nth(4).unwrap().to_owned()
    };
    let bad = "bad-fit\t3\tthe fit is bad\n";
    let but = "waving explains most of the gap, but with it in the simulation the fit is still bad.";
    assert_eq!(headline("", bad), but);
    assert_eq!(headline("", ""), "waving explains the gap.");
    assert_eq!(headline("noise-scale\t2\tthe readings scatter\n", bad), "waving explains the gap.");
    // With a probability that leaves room for doubt, something unknown beside it or not.
    let rows = "waving\t0.5\nwaving+unexplained\t0.35\nunexplained\t0.15\n";
    folder.write("out/attribution.txt", format!("hypothesis\tprobability\n{rows}"));
    assert_eq!(headline("", ""), "waving most likely explains the gap (0.85).");
    // Beside something unknown intervals are too narrow.
    let is_said =
        || folder.read("out/report.md").contains("intervals do not know of it, and may well be too narrow.");
    assert!(!is_said());
    folder.write("out/attribution.txt", "hypothesis\tprobability\nwaving\t0.3\nwaving+unexplained\t0.69\n");
    headline("", "");
    assert!(is_said());
}
