//! Folders of GrainLearning as tables.

use std::process::Command;

use pipelines::folder::Folder;

/// A folder as GrainLearning 2 leaves it: y = a x + b at three samples in text.
fn old() -> Folder {
    let folder = Folder::default();
    let mut samples = "!OMP_NUM_THREADS description key a b \n".to_owned();
    for (j, a) in [0.1, 0.2, 0.3].into_iter().enumerate() {
        samples +=
            &format!(" 4 line_Iter0_Sample{j}         {j}     {a}000000000e+00     5.0000000000e+00 \n");
        folder.write(&format!("old/iter0/line_Iter0_Sample{j}_param.txt"), format!("# a b\n{a} 5.0\n"));
        let run = format!("# x y\n0 5\n1 {}\n2 {}\n", a + 5.0, 2.0 * a + 5.0);
        folder.write(&format!("old/iter0/line_Iter0_Sample{j}_sim.txt"), run);
    }
    folder.write("old/iter0/line_Iter0_Samples.txt", samples);
    folder.write("obs.txt", "x y\n0 5\n1 5.2\n2 5.4\n");
    folder
}

/// The value of `a` in the run that fits best.
fn best(folder: &Folder) -> f64 {
    folder.run("gl-collect -s new/iter0/samples.txt -b obs.txt -c x -v y new/iter0/runs -o ensemble.txt");
    folder.run("gl-likelihood -b obs.txt -c x -v y --noise y=0.1 ensemble.txt -o misfit.txt");
    folder.run("gl-filter -s new/iter0/samples.txt --sigma noise --summary summary.txt misfit.txt -o w.txt");
    folder.quantity("summary.txt", "best(a)")
}

/// Run Python with numpy in the folder; the PATH that has it, or nothing where there is none.
fn numpy(folder: &Folder, script: &str) -> Option<String> {
    let path = std::env::var("PATH").unwrap();
    // Yade brings numpy to the python3 of the system, which another may hide.
    let path = [path.clone(), format!("/usr/bin:{path}")].into_iter().find(|path| {
        let probe = Command::new("python3").args(["-c", "import numpy"]).env("PATH", path).output();
        probe.is_ok_and(|output| output.status.success())
    });
    if path.is_none() {
        eprintln!("skip: python3 with numpy is not there");
    }
    let path = path?;
    let mut python = Command::new("python3");
    python.args(["-c", script]).env("PATH", &path).current_dir(folder.path("."));
    assert!(python.status().unwrap().success());
    Some(path)
}

/// What `gl-import old new` says with this PATH.
fn import(folder: &Folder, path: &str) -> String {
    let mut import = pipelines::tool("gl-import");
    let output = import.args(["old", "new"]).env("PATH", path).current_dir(folder.path(".")).unwrap();
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn text_runs_can_be_collected_and_weighed() {
    let folder = old();
    assert!(folder.run("gl-import old new").contains("iter0: 3 samples, 3 runs"));
    let samples = folder.read("new/iter0/samples.txt");
    assert!(
        samples.starts_with(
            "description\tkey\ta\tb\nline_Iter0_Sample0\t0\t0.1000000000e+00\t5.0000000000e+00\n"
        )
    );
    assert_eq!(folder.read("new/iter0/runs/line_Iter0_Sample1_sim.txt"), "x\ty\n0\t5\n1\t5.2\n2\t5.4\n");
    assert_eq!(folder.read("new/iter0/runs/line_Iter0_Sample1_param.txt"), "a\tb\n0.2\t5.0\n");
    assert_eq!(best(&folder), 0.2);
}

#[test]
fn a_table_beside_the_folder_and_commas_and_crlf_are_read_too() {
    let folder = old();
    let samples = folder.read("old/iter0/line_Iter0_Samples.txt");
    std::fs::remove_file(folder.path("old/iter0/line_Iter0_Samples.txt")).unwrap();
    let commas: String = samples
        .lines()
        .map(|line| format!("{}\r\n", line.split_whitespace().collect::<Vec<_>>().join(",")))
        .collect();
    folder.write("line_Iter0_Samples.txt", format!("\u{feff}{commas}"));
    folder.run("gl-import old new");
    assert_eq!(best(&folder), 0.2);
}

#[test]
fn npy_runs_give_the_same() {
    let folder = old();
    let script = "
import glob, numpy, os
for j, a in enumerate((0.1, 0.2, 0.3)):
    x = numpy.arange(3.0)
    numpy.save('old/iter0/line_Iter0_Sample%d.npy' % j, {'x': x, 'y': a * x + 5, 'a': a, 'b': numpy.float64(5)})
for path in glob.glob('old/iter0/*_sim.txt') + glob.glob('old/iter0/*_param.txt'):
    os.remove(path)
";
    let Some(path) = numpy(&folder, script) else { return };
    assert!(import(&folder, &path).contains("iter0: 3 samples, 3 runs"));
    assert_eq!(best(&folder), 0.2);
    // Without the table as well.
    std::fs::remove_dir_all(folder.path("new")).unwrap();
    std::fs::remove_file(folder.path("old/iter0/line_Iter0_Samples.txt")).unwrap();
    import(&folder, &path);
    assert_eq!(best(&folder), 0.2);
}

#[test]
fn a_pickle_that_would_run_something_is_left_out() {
    let folder = old();
    let script = "
import glob, numpy, os
for path in glob.glob('old/iter0/line_Iter0_Sample2_*'):
    os.remove(path)
class Trap:
    def __reduce__(self):
        return os.system, ('touch hit',)
numpy.save('old/iter0/line_Iter0_Sample2.npy', {'x': Trap()})
";
    let Some(path) = numpy(&folder, script) else { return };
    let said = import(&folder, &path);
    assert!(said.contains("which is no data") && said.contains("iter0: 3 samples, 2 runs"), "{said}");
    assert!(!folder.path("hit").exists());
}

#[test]
fn without_python_a_run_of_numpy_says_what_is_missing() {
    let folder = old();
    folder.write("old/iter0/line_Iter0_Sample2.npy", "");
    let output = pipelines::tool("gl-import")
        .args(["old", "new"])
        .current_dir(folder.path("."))
        .env("PATH", "")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("Sample2.npy: reading .npy needs python3 with numpy; python3 cannot be started"),
        "{said}"
    );
}

#[test]
fn a_run_that_is_cut_off_is_left_out() {
    let folder = old();
    folder.write("old/iter0/line_Iter0_Sample2_sim.txt", "# x y\n0 5\n1\n");
    let said = folder.run("gl-import old new");
    assert!(said.contains("left out: old/iter0/line_Iter0_Sample2_sim.txt:3: "), "{said}");
    assert!(said.contains("iter0: 3 samples, 2 runs"), "{said}");
}

#[test]
fn a_run_without_a_parameter_of_the_table_is_left_out() {
    let folder = old();
    folder.write("old/iter0/line_Iter0_Sample2_param.txt", "a\n0.3\n");
    let said = folder.run("gl-import old new");
    assert!(said.contains("left out: line_Iter0_Sample2 has no parameter b"), "{said}");
}

#[test]
fn a_folder_without_iterations_is_refused() {
    let folder = Folder::default();
    folder.write("old/readme", "");
    folder.refuses("gl-import old new", &["old: no folder iter0"]);
    folder.refuses("gl-import gone new", &["gone: cannot be read"]);
}
