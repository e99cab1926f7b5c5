//! `gl-run` beside the tools before and after it: they agree on names, and on which runs are complete.

use pipelines::folder::Folder;
use pipelines::packed::pack;
use pipelines::tool;

/// A run that is there in some state, and what both tools call that.
const STATES: [(&str, &str, &str); 9] = [
    ("a\n1\n", "x y\n0 0\n1 1\n", "ok"),
    ("# key,a\r\n0,1.000001\r\n", "# x,y\r\n0,0\r\n1,1\r\n", "ok"),
    ("a\n1\n", "x y\n0 0\n1 1", "truncated"),
    ("a\n1\n", "x y\n", "empty"),
    ("a\n1\n", "", "empty"),
    ("a\n1.1\n", "x y\n0 0\n1 1\n", "parameters"),
    ("b\n1\n", "x y\n0 0\n1 1\n", "parameters"),
    ("a\n", "x y\n0 0\n1 1\n", "parameters"),
    ("", "x y\n0 0\n1 1\n", "malformed"),
];

const COLLECT: &str =
    "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt --status status.txt --max-failed 1";

fn with_states() -> (Folder, Vec<String>) {
    let folder = Folder::default();
    folder.write("obs.txt", "x y\n0 0\n1 1\n");
    let names: Vec<String> = (0..STATES.len()).map(|i| format!("r{i}")).collect();
    let rows: String = names.iter().map(|name| format!("{name} 1\n")).collect();
    folder.write("samples.txt", format!("description a\n{rows}none 1\n"));
    for (name, (parameters, simulation, _)) in names.iter().zip(STATES) {
        folder.write(&format!("runs/{name}_param.txt"), parameters);
        folder.write(&format!("runs/{name}_sim.txt"), simulation);
    }
    (folder, names)
}

#[test]
fn gl_run_and_gl_collect_agree_on_which_runs_are_complete() {
    let (folder, names) = with_states();
    let expected: Vec<&str> = STATES.iter().map(|state| state.2).chain(["missing"]).collect();
    let agree = |form: &str| {
        folder.run(COLLECT);
        folder.run("gl-run status samples.txt runs -o run-status.txt");
        assert_eq!(folder.texts("run-status.txt", "status"), expected, "{form}");
        assert_eq!(folder.read("run-status.txt"), folder.read("status.txt"), "{form}");
    };
    agree("loose");
    let packed = pack(&folder, "runs", &names);
    std::fs::remove_dir_all(folder.path("runs")).unwrap();
    folder.write("runs/all_packed.txt", packed);
    agree("packed");
    // What is complete is not run again, and nothing else is kept.
    let said = folder.run("gl-run local samples.txt false runs");
    assert!(said.contains("10 rows: 2 complete before, 0 run, 8 failed"), "{said}");
}

/// Names of parameters that are taken, and some that are not, by every tool alike.
#[test]
fn a_parameter_that_gl_sample_takes_gl_run_takes_and_no_other() {
    for (name, is_fine) in [
        ("E_m", true),
        ("_", true),
        ("k-n", true),
        ("mu.0", true),
        ("ν", true),
        ("-x", false),
        (".x", false),
        ("1x", false),
        ("a;b", false),
        ("dir", false),
        ("case", false),
        ("key", false),
        ("weight", false),
        ("!EXEC", false),
    ] {
        let folder = Folder::default();
        folder.write("params.txt", format!("name lower upper\n{name} 0 1\n"));
        folder.write("samples.txt", format!("description {name}\nr 0.5\n"));
        let calls = [
            vec!["gl-sample", "-p", "params.txt", "-n", "3"],
            vec!["gl-run", "local", "samples.txt", "true", "runs"],
            vec!["gl-run", "status", "samples.txt", "."],
        ];
        for call in calls {
            if name == "key" && call[0] == "gl-run" {
                // A column that every table has.
                continue;
            }
            let output = tool(call[0]).args(&call[1..]).current_dir(folder.path(".")).output().unwrap();
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(if is_fine { 0 } else { 2 }), "{name}: {call:?}: {stderr}");
            assert!(is_fine || stderr.contains(".txt:"), "{name}: {stderr}");
        }
        assert_eq!(folder.path("runs").exists(), is_fine, "{name}");
    }
}

#[test]
fn the_samples_of_gl_sample_run_by_any_engine() {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper\nE_m 7 11\nnu 0 0.5\n");
    folder.run("gl-sample -p params.txt -n 4 --threads 2 --name a=b,c+1@d:e -o samples.txt");
    folder.run("gl-run embedded samples.txt gl-contact runs");
    let said = folder.run("gl-run local samples.txt false runs");
    assert!(said.contains("4 rows: 4 complete before, 0 run, 0 failed"), "{said}");
}
