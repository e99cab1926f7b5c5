//! What users read, word for word. `INSTA_UPDATE=always` shows what has become of it.

use insta::assert_snapshot;
use pipelines::folder::Folder;
use pipelines::fuzz::calls::tables;

#[test]
fn what_a_filter_says_of_few_runs_and_a_bound() {
    let folder = tables();
    folder.write("params.txt", "name lower upper\na 0.1 1\nb 4.8 10\n");
    assert_snapshot!(folder.run("gl-filter -s samples.txt -p params.txt --sigma 1e-4 misfit.txt -o w.txt"), @"
    gl-filter: the weight rests on 1.0 runs; take the means as rough, the intervals are widened
    gl-filter: b leans on its lower bound; the truth may lie outside
    ");
}

#[test]
fn what_an_attribution_says_of_a_cause() {
    let call = "gl-gap-attribute -p effects-params.txt -s effects-samples.txt -b effects-obs.txt -c x -v y \
                --noise y=0.1 effects-runs.txt -o out.txt";
    assert_snapshot!(tables().run(call), @"
    gl-gap-attribute: the base model misses the measurement by 5.67 % of its range where it comes closest in units of the noise; noise and scatter alone would give 0.37 %
    gl-gap-attribute: bending explains it: probability 1.00
    gl-gap-attribute: adding it should close 100 % (99 to 100 %) of the gap
    gl-gap-attribute: the readings of y scatter 0.7 times what was stated; the verdict is by what they do
    gl-gap-attribute: with bending the measurement is e^15 times as likely as with something unknown alone
    ");
}

#[test]
fn what_a_check_says_of_a_case() {
    let said = tables().run("gl-check case");
    // The disk is another one everywhere.
    let said: Vec<&str> = said.lines().filter(|line| !line.contains(" MB ")).collect();
    assert_snapshot!(said.join("\n"), @"
    gl-check: case: 2 parameters against 20 readings of y on x; the noise is known
    gl-check: parameters of the base model: a, b
    gl-check: the engine local runs: cat {a} {b}
    gl-check: no run has {description} in its command, which says what its results are to be called, {description}_sim.txt
    gl-check: a calibration takes 20 runs an iteration, 3 iterations at the most: 60 runs at the most
    ");
}

#[test]
fn as_many_parameters_as_readings_want_a_noise() {
    let folder = tables();
    folder.write("case/obs.txt", "x y\n0 1\n1 2\n");
    let untold = || {
        let said = folder.run("gl-check case");
        said.lines().filter(|line| line.contains("no noise")).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(untold(), "");
    let with_noise = folder.read("case/case.toml");
    let without: Vec<&str> = with_noise.lines().filter(|line| !line.starts_with("noise")).collect();
    folder.write("case/case.toml", without.join("\n"));
    assert_snapshot!(untold(), @"gl-check: 2 readings against 2 parameters and no noise: a fit that leaves nothing says nothing of the noise, and the posterior follows from a guess; give it, as noise = { y = … } in case/case.toml");
    folder.write("case/obs.txt", "x y\n0 1\n1 2\n2 3\n");
    assert_eq!(untold(), "");
}

#[test]
fn what_a_check_says_of_all_that_is_wrong() {
    let folder: Folder = tables();
    folder.write("case/obs.txt", "x z\n0 1\n");
    folder.write("case/params.txt", "name lower upper\na 2 1\n");
    let output = folder.call("gl-check case", "");
    assert_snapshot!(String::from_utf8_lossy(&output.stderr), @"
    gl-check: case/params.txt:2: column upper: 1 is not above the lower bound 2 of a
        case/obs.txt:1: no column y; the columns are x, z
    ");
}
