//! Which effect explains the gap in several tests of the same samples, through the tools.

use std::fmt::Write as _;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::SystemTime;

use gl_table::verdict::Verdicts;
use pipelines::calibration::write_curve;
use pipelines::folder::Folder;
use pipelines::path_with_tools;

/// A noise of no pattern, between -1 and 1.
fn noise(i: usize) -> f64 {
    (12.9898 * (i * i + 3 * i + 1) as f64).sin()
}

/// y = a + b x p + bend x² p², at a pressure p that is known of a test.
fn curve(x: f64, p: f64, [a, b, bend]: [f64; 3]) -> f64 {
    a + b * x * p + bend * x * x * p * p
}

const STEPS: usize = 16;

/// Measurements and ensembles of this model: `whole`, one test with the observables y and f at the pressures 1 and
/// 2; and the same as the tests `low` and `high` with an observable each. What is measured is a bend, or f as it was a tenth
/// of the way before.
fn bent(is_late: bool) -> Folder {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper effect off\na 0 1 - -\nb 1 3 - -\nbend 0.05 1 bending 0\n");
    folder.run("gl-sample -p params.txt -n 40 --effects switch -o samples.txt");
    let names = folder.texts("samples.txt", "description");
    let columns = ["a", "b", "bend"].map(|name| folder.column("samples.txt", name));
    let x = |step: usize| step as f64 / (STEPS - 1) as f64;
    let truth = if is_late { [0.4, 2.0, 0.0] } else { [0.4, 2.0, 0.3] };
    let measured = |step: usize, p: f64, place: usize| {
        let lag = if is_late && place == 1 { 0.1 } else { 0.0 };
        curve((x(step) - lag).max(0.0), p, truth) + 0.01 * noise(step + 100 * place)
    };
    for (name, head, pressures) in
        [("whole", "x y f", vec![1.0, 2.0]), ("low", "x y", vec![1.0]), ("high", "x f", vec![2.0])]
    {
        let (mut obs, mut runs) = (format!("{head}\n"), format!("sample step {head}\n"));
        let row = |text: &mut String, of: &dyn Fn(f64) -> f64| {
            pressures.iter().for_each(|p| write!(text, " {}", of(*p)).unwrap());
            text.push('\n');
        };
        for step in 0..STEPS {
            write!(obs, "{}", x(step)).unwrap();
            row(&mut obs, &|p| measured(step, p, usize::from(p > 1.0)));
        }
        for (run, sample) in names.iter().enumerate() {
            let at = [0, 1, 2].map(|k: usize| columns[k][run]);
            for step in 0..STEPS {
                write!(runs, "{sample} {step} {}", x(step)).unwrap();
                row(&mut runs, &|p| curve(x(step), p, at));
            }
        }
        folder.write(&format!("{name}.txt"), obs).write(&format!("{name}-runs.txt"), runs);
    }
    folder
}

const CALL: &str = "gl-gap-attribute -p params.txt -s samples.txt";
const LOW: &str = "--test low:low.txt:x:y:y=0.01";
const HIGH: &str = "--test high:high.txt:x:f:f=0.01";
const OUT: [&str; 6] = ["effects-out", "predict-shrink", "posterior-out", "rest-out", "next-out", "verdict"];

/// All that a call writes, with these taken out of it.
fn told(folder: &Folder, call: &str, names: &[&str]) -> String {
    let files: String = OUT.iter().fold(String::new(), |text, out| text + &format!(" --{out} {out}.txt"));
    folder.run(&format!("{call}{files} -o table.txt"));
    let mut text: String = OUT.iter().map(|out| folder.read(&format!("{out}.txt"))).collect();
    text += &folder.read("table.txt");
    names.iter().for_each(|name| text = text.replace(name, ""));
    text
}

#[test]
fn one_test_is_attributed_to_the_byte_as_the_measurement_that_it_is() {
    let folder = bent(false);
    let more = "--measurement offset,lag,compliance --self-check 1";
    let plain = format!("{CALL} -b whole.txt -c x -v y,f --noise y=0.01,f=0.01 {more} whole-runs.txt");
    let test = format!("{CALL} --test one:whole.txt:x:y,f:y=0.01,f=0.01 {more} one=whole-runs.txt");
    let plain = told(&folder, &plain, &[]);
    assert!(plain.contains("compliance+unexplained"));
    assert_eq!(told(&folder, &test, &["one.", "(one)"]), plain);
    let part = "-b whole.txt -c x -v y,f --noise y=0.01,f=0.01 --steps 2:12";
    let part = told(&folder, &format!("{CALL} {part} whole-runs.txt"), &[]);
    let test = format!("{CALL} --test one:whole.txt:x:y,f:y=0.01,f=0.01:2:12 one=whole-runs.txt");
    assert_eq!(told(&folder, &test, &["one."]), part);
}

#[test]
fn two_tests_of_an_observable_each_are_weighed_to_the_byte_as_one_of_two() {
    let folder = bent(false);
    let more = "--measurement offset,gain,drift";
    let whole = format!("{CALL} -b whole.txt -c x -v y,f --noise y=0.01,f=0.01 {more} whole-runs.txt");
    let tests = format!("{CALL} {LOW} {HIGH} {more} low=low-runs.txt high=high-runs.txt");
    let whole = told(&folder, &whole, &[]);
    // Which of several tests tells is said of several alone.
    let of_tests = told(&folder, &tests, &["low.", "high."]);
    let (by, others): (Vec<&str>, Vec<&str>) = of_tests.lines().partition(|line| line.starts_with("told-by"));
    assert_eq!((by.len(), others), (1, whole.lines().collect()));
}

#[test]
fn an_error_of_the_measurement_acts_in_one_test() {
    let folder = bent(true);
    let call = format!("{CALL} {LOW} {HIGH} --measurement gain,lag low=low-runs.txt high=high-runs.txt");
    folder.run(&format!("{call} --effects-out effects.txt --verdict verdict.txt -o table.txt"));
    assert_eq!(
        folder.texts("effects.txt", "effect"),
        ["bending", "gain(low.y)", "gain(high.f)", "lag(low)", "lag(high)"]
    );
    assert_eq!(folder.texts("table.txt", "hypothesis")[0], "lag(high)");
    assert!(folder.column("table.txt", "probability")[0] > 0.8);
    let verdicts = Verdicts::read(&folder.path("verdict.txt")).unwrap();
    assert_eq!(verdicts.find("cause").unwrap().value, "lag(high)");
}

#[test]
fn a_sample_that_failed_in_a_test_is_said_and_tables_of_no_test_are_refused() {
    let folder = bent(false);
    let name = &folder.texts("samples.txt", "description")[3];
    let kept: Vec<String> = folder
        .read("high-runs.txt")
        .lines()
        .filter(|line| !line.starts_with(name.as_str()))
        .map(|line| format!("{line}\n"))
        .collect();
    folder.write("fewer.txt", kept.concat());
    let said = folder.run(&format!("{CALL} {LOW} {HIGH} low=low-runs.txt high=fewer.txt -o table.txt"));
    assert!(said.contains(&format!("{name} failed in the test high: left out")), "{said}");
    assert!(said.contains("1 of 40 samples have no run and are left out"), "{said}");
    for (call, says) in [
        (format!("{LOW} {HIGH} low=low-runs.txt"), "the test high has no ensemble"),
        (format!("{LOW} low-runs.txt"), "is not TEST=FILE"),
        (format!("{LOW} --steps 2:9 low=low-runs.txt"), "with --test each test has its own"),
        (format!("{LOW} -b low.txt low=low-runs.txt"), "cannot be used with"),
    ] {
        folder.refuses(&format!("{CALL} {call}"), &[says]);
    }
}

/// A case of this model in the tests `low` and `high`, with a bend in what is measured.
fn case_of_two_tests() -> Folder {
    let folder = bent(false);
    for table in ["params.txt", "low.txt", "high.txt"] {
        folder.write(&format!("case/{table}"), folder.read(table));
    }
    folder.write(
        "case/case.toml",
        "name = \"bent\"\ncontrol = \"x\"\nmeasurement = [\"lag\"]\nnum = 16\niterations = 2\ndesign_num = 50\n\
         max_effects = 1\n\n[model]\n\
         local = \"awk -f {case}/bent.awk -v a={a} -v b={b} -v c={bend} -v p={p} -v name={description}\"\n\n\
         [[test]]\nname = \"low\"\nobs = \"low.txt\"\nobservables = [\"y\"]\nnoise = { y = 0.01 }\ngiven = { p = 1 }\n\n\
         [[test]]\nname = \"high\"\nobs = \"high.txt\"\nobservables = [\"f=y\"]\nnoise = { f = 0.01 }\ngiven = { p = 2 }\n",
    );
    // Where b and p are large the run breaks off.
    folder.write(
        "case/bent.awk",
        "BEGIN { if (b * p > 5.2) exit 1; CONVFMT = \"%.12g\"; file = name \"_sim.txt\"; print \"x\\ty\" > file\n\
         for (i = 0; i < 16; i++) { x = i / 15; print x \"\\t\" a + b * x * p + c * x * x * p * p > file } }\n",
    );
    folder
}

/// When each file below a folder was written.
fn times(folder: &Folder, out: &str) -> BTreeMap<PathBuf, SystemTime> {
    let files = folder.files().into_keys().filter(|file| file.starts_with(out) && !file.ends_with(".lock"));
    let time = |file: &PathBuf| std::fs::metadata(folder.path("").join(file)).unwrap().modified().unwrap();
    files.map(|file| (file.clone(), time(&file))).collect()
}

/// Step, control and prediction of the first hypothesis in one test.
fn of_winner(folder: &Folder, test: &str, observable: &str) -> Vec<(f64, f64, f64)> {
    let [hypotheses, tests, observables] =
        ["hypothesis", "test", "observable"].map(|name| folder.texts("out/curves.txt", name));
    let [step, control, predicted] =
        ["step", "control", "predicted"].map(|name| folder.column("out/curves.txt", name));
    let is_own = |&row: &usize| {
        hypotheses[row] == hypotheses[0] && tests[row] == test && observables[row] == observable
    };
    (0..step.len()).filter(is_own).map(|row| (step[row], control[row], predicted[row])).collect()
}

#[test]
fn a_pair_of_causes_is_put_in_and_how_far_the_gap_closes_is_said() {
    let folder = Folder::default();
    write_curve(
        &folder,
        (
            "pair",
            "name\tlower\tupper\teffect\toff\na\t0\t2\t-\t-\nbend\t0.2\t2\tbending\t0\nwave\t0.2\t2\twaving\t0\n",
        ),
        |x| 0.8 * x + 1.1 * x * x + 0.9 * (12.0 * x).sin(),
        ("-v a={a} -v b={bend} -v w={wave}", "a * x + b * x * x + w * sin(12 * x)"),
    );
    folder.run("gl-diagnose case --out out");
    assert_eq!(folder.read("out/winner.txt"), "bending,waving\n");
    assert!(folder.column("out/shrink.txt", "shrink")[1] > 0.9);
    assert!(folder.read("out/report.html").contains("bending"));
    folder.refuses("gl-diagnose case --out a,b", &["a,b: commas part the tables"]);
}

#[test]
fn a_diagnosis_of_two_tests_finds_the_effect_and_says_how_far_the_gap_closes_in_each() {
    let folder = case_of_two_tests();
    let said = folder.run("gl-check case");
    assert!(
        said.contains(
            "a diagnosis takes two calibrations and 50 runs more: up to 114, each in 2 tests, and 20 more where the prior proves too \
             narrow, with another calibration, and up to 64 more where something unknown is beside the cause: 230 at the most"
        ),
        "{said}"
    );
    folder.run("gl-diagnose case --out out");
    assert_eq!(folder.texts("out/attribution.txt", "hypothesis")[0], "bending");
    assert_eq!(folder.texts("out/effects.txt", "effect"), ["bending", "lag(low)", "lag(high)"]);
    assert_eq!(folder.read("out/winner.txt"), "bending\n");
    // An error of one test leaves what bends in the other.
    let verdicts = Verdicts::read(&folder.path("out/attribution-verdict.txt")).unwrap();
    let by = verdicts.rows.iter().find(|row| row.code == "told-by").unwrap();
    let (rival, teller) =
        if by.text.contains("from lag(low)") { ("lag(low)", "high") } else { ("lag(high)", "low") };
    assert!(by.text.starts_with(&format!("it is told from {rival} by")), "{}", by.text);
    assert!(by.value.split(',').any(|test| test == teller), "{}", by.value);
    let observables = folder.texts("out/locate.txt", "observable");
    assert!(observables.contains(&"low.y".to_owned()) && observables.contains(&"high.f".to_owned()));
    assert_eq!(folder.texts("out/shrink.txt", "observable"), ["low.y", "high.f", "all"]);
    assert!(folder.column("out/shrink.txt", "shrink")[2] > 0.9);
    // A row for each sample and test, which fails alone, and is left out of what is made of all.
    for (test, p) in [("low", 1.0), ("high", 2.0)] {
        let given = folder.column(&format!("out/design/round0/{test}/samples.txt"), "p");
        assert!(given.iter().all(|value| *value == p));
        assert!(folder.path(&format!("out/after-bending/ensemble-{test}.txt")).is_file());
    }
    let failed = |test: &str| {
        let status = folder.texts(&format!("out/base/iter0/{test}/status.txt"), "status");
        status.iter().filter(|status| *status != "ok").count()
    };
    assert_eq!(failed("low"), 0);
    assert!(failed("high") > 0);
    assert!(folder.read("out/locate.log").contains("failed in the test high: left out"));
    let page = folder.read("out/report.html");
    for words in [
        "In low. The gap over",
        "In high. The gap over",
        "In high. The emulator behind it",
        "The base model and the most probable hypotheses, each by its mean curve",
    ] {
        assert!(page.contains(words), "{words}");
    }
    // The curve of the winner is what was measured, in each test, at the steps and the control of that.
    for (test, observable) in [("low", "y"), ("high", "f")] {
        let curve = of_winner(&folder, test, observable);
        let control = folder.column(&format!("case/{test}.txt"), "x");
        let measured = folder.column(&format!("case/{test}.txt"), observable);
        assert_eq!(curve.len(), control.len());
        for (step, (of_step, at, predicted)) in curve.into_iter().enumerate() {
            assert_eq!((of_step, at), (step as f64, control[step]));
            assert!((predicted - measured[step]).abs() < 0.03, "{test} {step}");
        }
    }
    // The page names nothing that was gone when it was done: each picture is drawn again as it says.
    let commands = page.lines().filter_map(|line| line.split_once("how it is drawn</summary><pre>"));
    let commands: Vec<&str> = commands
        .filter_map(|(_, rest)| rest.split_once(" -o picture.pdf"))
        .map(|(command, _)| command)
        .collect();
    assert_eq!(commands.len(), page.matches("<figcaption>").count());
    for command in commands {
        let drawn = std::process::Command::new("sh")
            .args(["-c", &format!("{command} -o picture.svg")])
            .current_dir(folder.path(""))
            .env("PATH", path_with_tools())
            .output()
            .unwrap();
        assert!(drawn.status.success(), "{command}: {}", String::from_utf8_lossy(&drawn.stderr));
    }
}

#[test]
fn a_diagnosis_of_tests_that_is_called_again_does_nothing_and_takes_kept_runs() {
    let folder = case_of_two_tests();
    folder.run("gl-diagnose case --out out");
    let before = times(&folder, "out");
    folder.run("gl-diagnose case --out out");
    assert!(before == times(&folder, "out"), "what is done is not done again");
    let attribution = folder.read("out/attribution.txt");
    let made = before.keys().filter(|file| {
        file.ends_with("attribution.txt") || file.to_str().unwrap().ends_with("design/ensemble-high.txt")
    });
    made.for_each(|file| std::fs::remove_file(folder.path("").join(file)).unwrap());
    folder.run("gl-diagnose case --out out");
    assert_eq!(folder.read("out/attribution.txt"), attribution);
    let is_run = |file: &PathBuf| file.to_str().unwrap().ends_with("_sim.txt");
    let after = times(&folder, "out");
    assert!(before.iter().all(|(file, time)| !is_run(file) || after[file] == *time));
    // All runs in one file, by which no model is needed.
    let mut packed = String::new();
    for dir in
        before.keys().filter(|file| file.ends_with(".run") || is_run(file)).filter_map(|file| file.parent())
    {
        let dir = if dir.ends_with("runs") { dir } else { continue };
        if !folder.path("").join(dir).join("packed").exists() {
            std::fs::write(folder.path("").join(dir).join("packed"), "").unwrap();
            folder.run(&format!("gl-run pack {}", dir.display()));
        }
    }
    for (file, bytes) in folder.files() {
        if file.to_str().unwrap().ends_with("_packed.txt") {
            packed += &String::from_utf8(bytes).unwrap();
        }
    }
    folder.write("case/kept.txt", packed);
    let case = folder.read("case/case.toml");
    folder.write("case/case.toml", format!("kept = \"kept.txt\"\n{case}"));
    std::fs::remove_file(folder.path("case/bent.awk")).unwrap();
    let said = folder.run("gl-diagnose case --out kept");
    assert!(said.contains("runs are not made but taken from"), "{said}");
    assert_eq!(folder.read("kept/attribution.txt"), attribution);
    folder.write("case/case.toml", format!("kept = \"kept.txt\"\n{}", case.replace("p = 2", "p = 1")));
    folder.refuses("gl-check case", &["kept: kept runs of low and of high cannot be told apart"]);
}

#[test]
fn a_test_of_a_single_reading_narrows_what_the_others_leave_open() {
    let folder = bent(false);
    let mut runs = "sample step t height\n".to_owned();
    let bends = folder.column("samples.txt", "bend");
    for (name, bend) in folder.texts("samples.txt", "description").iter().zip(bends) {
        writeln!(runs, "{name} 0 0 {}", 5.0 - 2.0 * bend).unwrap();
    }
    folder.write("heap-runs.txt", runs).write("heap.txt", "t height\n0 4.4\n");
    let sd_of_the_bend = |tests: &str| {
        folder
            .run(&format!("{CALL} {LOW} {tests} --max-effects 1 --posterior-out posterior.txt -o table.txt"));
        assert_eq!(folder.texts("table.txt", "hypothesis")[0], "bending");
        let [hypothesis, parameter] =
            ["hypothesis", "parameter"].map(|name| folder.texts("posterior.txt", name));
        let row = hypothesis.iter().zip(&parameter).position(|(of, name)| of == "bending" && name == "bend");
        folder.column("posterior.txt", "sd")[row.unwrap()]
    };
    let alone = sd_of_the_bend("low=low-runs.txt");
    let heap = "--test heap:heap.txt:t:height:height=0.002 low=low-runs.txt heap=heap-runs.txt";
    let both = sd_of_the_bend(&format!("{heap} --measurement drift,lag"));
    assert!(both < 0.5 * alone, "{both} {alone}");
}
