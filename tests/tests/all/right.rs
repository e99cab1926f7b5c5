//! Where a calibration misleads most easily: the tempering misses its target, the truth lies outside
//! the bounds, few samples, one lucky sample.

use std::fmt::Write;

use pipelines::calibration::{calibrate, copy_case, finish};
use pipelines::folder::Folder;
use pipelines::line;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LIKELIHOOD: &str = "gl-likelihood -b obs.txt -c x -v y --noise y=0.3 ensemble.txt -o misfit.txt";
const POSTERIOR: &str =
    "gl-filter -s samples.txt -p params.txt --sigma noise --summary posterior.txt misfit.txt -o weights.txt";

/// A line of this truth and bounds, and the posterior of `n` samples of it.
fn posterior(truth: (f64, f64), params: &str, n: usize, seed: u64) -> (Folder, String) {
    let folder = Folder::default();
    line::measure(&folder, truth, 0.3, seed);
    folder.write("params.txt", params);
    folder.run(&format!("gl-sample -p params.txt -n {n} --seed {seed} -o samples.txt"));
    line::ensemble(&folder, "samples.txt", "obs.txt", "ensemble.txt");
    folder.run(LIKELIHOOD);
    let stderr = folder.run(POSTERIOR);
    (folder, stderr)
}

/// The effective sample size, worked out again from the weights, at misfits of every size.
#[test]
fn the_ess_target_is_met_for_misfits_of_any_size() {
    let folder = Folder::default();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let shape: Vec<f64> = (0..100).map(|_| rng.random::<f64>().powi(2)).collect();
    let names: Vec<String> = (0..100).map(|i| format!("s{i:02}")).collect();
    let samples: String = names.iter().enumerate().map(|(i, name)| format!("{name} {i} {i}\n")).collect();
    folder.write("samples.txt", format!("description key a\n{samples}"));
    for size in [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9] {
        let mut misfit = "sample step misfit error\n".to_owned();
        for (name, x) in names.iter().zip(&shape) {
            writeln!(misfit, "{name} 0 {} 0.1", x * size).unwrap();
        }
        folder.write("misfit.txt", misfit);
        let mut last = 0.0;
        for target in [0.05, 0.2, 0.5, 0.9] {
            folder.run(&format!(
                "gl-filter -s samples.txt --ess {target} --summary summary.txt misfit.txt -o weights.txt"
            ));
            let weights = folder.column("weights.txt", "weight");
            let ess = 1.0 / weights.iter().map(|w| w * w).sum::<f64>() / 100.0;
            assert!((ess - target).abs() < 1e-9, "misfits of {size}: ess {ess} for {target}");
            assert!((folder.quantity("summary.txt", "ess") - target).abs() < 1e-9);
            let sigma = folder.quantity("summary.txt", "sigma");
            assert!(sigma > last, "sigma {sigma} does not grow with the target");
            last = sigma;
        }
    }
}

#[test]
fn a_truth_outside_the_bounds_is_said_with_the_parameter_and_the_side() {
    for (truth, params, says) in [
        ((0.5, 4.0), "name lower upper\na 0.1 1\nb 4.9 10\n", "b leans on its lower bound"),
        ((0.5, 4.0), "name lower upper\na 0.1 1\nb 0.1 3\n", "b leans on its upper bound"),
        ((1.5, 4.0), "name lower upper\na 0.1 1\nb 0.1 10\n", "a leans on its upper bound"),
    ] {
        let (folder, stderr) = posterior(truth, params, 2000, 1);
        assert!(stderr.contains(&format!("{says}; the truth may lie outside")), "{stderr}");
        let stop = folder.call("gl-check-stop posterior.txt", "");
        assert_eq!(stop.status.code(), Some(0));
        let stderr = String::from_utf8_lossy(&stop.stderr).into_owned();
        assert!(stderr.contains(&format!("{says}; the truth may lie outside")), "{stderr}");
        assert!(stderr.contains("the fit is bad: χ²"), "{stderr}");
    }
}

#[test]
fn a_truth_inside_the_bounds_is_not_doubted() {
    let (folder, stderr) = posterior((0.5, 4.0), line::PARAMS, 20_000, 1);
    assert_eq!(stderr, "");
    let stop = folder.call("gl-check-stop posterior.txt", "");
    assert_eq!(String::from_utf8_lossy(&stop.stderr), "gl-check-stop: stop, by sigma_noise\n");
}

#[test]
fn a_posterior_of_five_samples_says_so_and_its_intervals_hold_the_truth() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut held = 0;
    for seed in 0..40 {
        let truth = (rng.random_range(0.1..1.0), rng.random_range(0.1..10.0));
        let (folder, stderr) = posterior(truth, line::PARAMS, 5, seed);
        let ess = folder.quantity("posterior.txt", "ess_runs");
        assert!((1.0..=5.0).contains(&ess));
        assert!(stderr.contains(&format!("the weight rests on {ess:.1} runs")), "{stderr}");
        for (name, truth) in [("a", truth.0), ("b", truth.1)] {
            let bound = |q: &str| folder.quantity("posterior.txt", &format!("{q}({name})"));
            held += u32::from((bound("q05")..=bound("q95")).contains(&truth));
        }
    }
    // 90 % of 80 is 72; three standard deviations below it is 64.
    assert!(held >= 64, "{held} of 80 intervals hold the truth");
}

/// Two iterations, of which the earlier holds the better run.
#[test]
fn the_best_run_of_all_iterations_is_the_one_reported() {
    let (folder, _) = posterior((0.5, 4.0), line::PARAMS, 300, 1);
    folder.run("gl-gmm-resample -p params.txt -n 5 --iteration 1 weights.txt -o next.txt --proposal-out proposal.txt");
    line::ensemble(&folder, "next.txt", "obs.txt", "ensemble.txt");
    // Least squares, which no other sample fits better than, go into the first iteration.
    let (x, y) = (folder.column("obs.txt", "x"), folder.column("obs.txt", "y"));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mx, my) = (mean(&x), mean(&y));
    let slope = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>()
        / x.iter().map(|x| (x - mx).powi(2)).sum::<f64>();
    let intercept = my - slope * mx;
    let samples = folder.read("samples.txt").lines().take(300).collect::<Vec<_>>().join("\n");
    folder.write("samples.txt", format!("{samples}\nrun_Iter0_Best 300 {slope} {intercept}\n"));
    folder.run(&LIKELIHOOD.replace("misfit.txt", "misfit1.txt"));
    line::ensemble(&folder, "samples.txt", "obs.txt", "ensemble.txt");
    folder.run(LIKELIHOOD);
    folder.run(
        "gl-filter -p params.txt -s samples.txt --proposal prior -s next.txt --proposal proposal.txt \
         --sigma noise --summary both.txt misfit.txt misfit1.txt -o weights.txt",
    );
    let summary = folder.read("both.txt");
    let misfit = folder.column("weights.txt", "misfit");
    let names = folder.texts("weights.txt", "sample");
    let best = (0..names.len()).min_by(|&i, &j| misfit[i].total_cmp(&misfit[j])).unwrap();
    assert!(summary.contains(&format!("best_sample\t{}\n", names[best])), "{summary}");
    assert!(names[best].contains("_Iter0_"), "{}", names[best]);
    assert_eq!(folder.quantity("both.txt", "best_misfit"), misfit[best]);
    assert_eq!(folder.quantity("both.txt", "best(a)"), folder.column("weights.txt", "a")[best]);
}

#[test]
fn a_stop_by_a_single_sample_is_named_as_that() {
    let (folder, _) = posterior((0.5, 4.0), line::PARAMS, 40, 1);
    folder.run(
        "gl-filter -s samples.txt -p params.txt --ess 0.3 --summary summary.txt misfit.txt -o weights.txt",
    );
    let best = folder.quantity("summary.txt", "best_error");
    let stop = folder.call(&format!("gl-check-stop --error-tol {} summary.txt", 1.01 * best), "");
    assert_eq!(stop.status.code(), Some(0));
    let stderr = String::from_utf8_lossy(&stop.stderr).into_owned();
    let name =
        folder.read("summary.txt").lines().find_map(|l| l.strip_prefix("best_sample\t").map(str::to_owned));
    assert!(stderr.contains(&format!("the stop is by a single sample, {};", name.unwrap())), "{stderr}");
    // Not where the weighted runs together meet a tolerance too.
    let stop = folder
        .call(&format!("gl-check-stop --error-tol {} --ensemble-error-tol 1 summary.txt", 1.01 * best), "");
    assert!(!String::from_utf8_lossy(&stop.stderr).contains("single sample"));
    let go_on = folder.call(&format!("gl-check-stop --error-tol {} summary.txt", 0.99 * best), "");
    assert_eq!((go_on.status.code(), go_on.stderr.len()), (Some(1), 0));
}

/// The page says what the runs took, whatever made them; where nobody measured it, it says so.
#[test]
fn the_time_of_each_run_is_kept_and_told() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &[("num", "6"), ("iterations", "2"), ("posterior", "\"weights\"")]);
    let path = std::env::var("PATH").unwrap();
    for packed in ["0", "1"] {
        let out = format!("out{packed}");
        finish(
            calibrate(&folder, "local", &out).args([&format!("packed={}", packed == "1")]).env("PATH", &path),
        );
        let times = format!("{out}/iter1/runs/times.txt");
        let mut names = folder.texts(&times, "sample");
        names.sort();
        assert_eq!(names, folder.texts(&format!("{out}/iter1/samples.txt"), "description"));
        let [seconds, processor] =
            ["seconds", "processor_seconds"].map(|column| folder.column(&times, column));
        assert!(seconds.iter().all(|seconds| (1e-4..60.0).contains(seconds)), "{seconds:?}");
        assert!(processor.iter().sum::<f64>() > 0.0, "{processor:?}");
        assert_eq!(folder.column(&times, "exit"), [0.0; 6]);
        folder.run(&format!("gl-report case -o {out}"));
        let page = folder.read(&format!("{out}/report.html"));
        assert!(
            page.contains("12 runs: calibration; ") && page.contains(" each by the clock (median of 12), "),
            "{packed}"
        );
    }
    // A run that is tried again is added.
    std::fs::remove_file(folder.path("out0/iter1/ensemble.txt")).unwrap();
    let name = &folder.texts("out0/iter1/samples.txt", "description")[3];
    std::fs::remove_file(folder.path(&format!("out0/iter1/runs/{name}_sim.txt"))).unwrap();
    finish(calibrate(&folder, "local", "out0").args(["packed=false"]).env("PATH", &path));
    let again = folder.texts("out0/iter1/runs/times.txt", "sample");
    assert_eq!((again.len(), again.last()), (7, Some(name)));
    for i in 0..2 {
        std::fs::remove_file(folder.path(&format!("out0/iter{i}/runs/times.txt"))).unwrap();
    }
    folder.run("gl-report case -o out0");
    assert!(folder.read("out0/report.html").contains("12 runs: calibration</span>"));
}

#[test]
fn a_simulator_of_the_whole_table_says_itself_what_its_runs_took() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[("num", "8"), ("iterations", "1")]);
    finish(&mut calibrate(&folder, "embedded", "out"));
    let samples = folder.texts("out/iter0/samples.txt", "description");
    assert_eq!(folder.texts("out/iter0/runs/times.txt", "sample"), samples);
}

#[test]
fn a_stop_without_any_criterion_met_is_no_stop_and_bad_calls_are_errors() {
    let (folder, _) = posterior((0.5, 4.0), line::PARAMS, 40, 1);
    folder.refuses("gl-check-stop --max-iterations 3 posterior.txt", &["--max-iterations needs --iteration"]);
    folder.refuses("gl-check-stop --error-tol 1 nowhere.txt", &["nowhere.txt: cannot be opened"]);
    folder.write("other.txt", "quantity value\nsigma 2\nsigma_noise 1\n");
    folder.refuses("gl-check-stop --error-tol 1 other.txt", &["no quantity best_error"]);
    assert_eq!(folder.call("gl-check-stop other.txt", "").status.code(), Some(1));
}

/// The first iteration finds no good run, so its estimate of the noise is one of its ignorance.
#[test]
fn an_estimated_noise_that_still_falls_is_no_reason_to_stop() {
    let folder = Folder::default();
    let summary = |file: &str, noise: &str, more: &str| {
        folder.write(file, format!("quantity value\nsigma {noise}\nsigma_noise {noise}\n{more}"));
    };
    summary("first.txt", "0.3", "");
    summary("second.txt", "0.002", "");
    summary("third.txt", "0.0019", "");
    summary("known.txt", "1", "best_misfit_over_noise 1.1\n");
    for (call, code) in [
        ("first.txt", 0),
        ("--previous none first.txt", 1),
        ("--previous first.txt second.txt", 1),
        ("--previous second.txt third.txt", 0),
        ("--previous none known.txt", 0),
    ] {
        assert_eq!(folder.call(&format!("gl-check-stop {call}"), "").status.code(), Some(code), "{call}");
    }
}
