//! Numbers at the ends of what a number can say, outputs that meet, streams that break off.

use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use pipelines::folder::Folder;
use pipelines::{line, path_with_tools, programs};

const COLLECT: &str =
    "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt --status status.txt";
const LIKELIHOOD: &str = "gl-likelihood -b obs.txt -c x -v y ensemble.txt -o misfit.txt";
const FILTER: &str = "gl-filter -s samples.txt -p params.txt misfit.txt -o weights.txt --summary summary.txt";

/// A line whose ensemble of `n` runs is collected already.
fn collected(n: usize) -> Folder {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.run(&format!("gl-sample -p params.txt -n {n} -o samples.txt"));
    line::simulate(&folder, "samples.txt", "runs");
    folder.run(COLLECT);
    folder
}

/// The lines of a table, with the last field of the last row replaced.
fn with_last_field(table: &str, field: &str) -> String {
    let end = table.trim_end().rfind(['\t', ' ']).unwrap() + 1;
    format!("{}{field}\n", &table[..end])
}

fn shell(folder: &Folder, script: &str) -> std::process::Output {
    Command::new("bash")
        .args(["-c", &format!("set -o pipefail; {script}")])
        .current_dir(folder.path("."))
        .env("PATH", path_with_tools())
        .output()
        .unwrap()
}

#[test]
fn a_run_that_blew_up_but_stayed_finite_fails_alone() {
    let folder = collected(12);
    let run = fs::read_dir(folder.path("runs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.to_string_lossy().ends_with("_sim.txt"))
        .unwrap();
    let text = fs::read_to_string(&run).unwrap();
    fs::write(&run, with_last_field(&text, "1e200")).unwrap();
    folder.run(COLLECT);
    let status = folder.read("status.txt");
    assert!(status.contains("non-finite") && status.contains("the run blew up"), "{status}");
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    assert_eq!(
        (folder.quantity("summary.txt", "runs"), folder.quantity("summary.txt", "failed")),
        (11.0, 1.0)
    );
}

#[test]
fn a_misfit_beyond_numbers_leaves_its_run_out_and_is_said() {
    let folder = collected(6);
    folder.write("ensemble.txt", with_last_field(&folder.read("ensemble.txt"), "1e200"));
    let said = folder.run(LIKELIHOOD);
    assert!(said.contains("1 runs left out"), "{said}");
    let misfits = folder.read("misfit.txt");
    assert!(!misfits.contains("inf") && !misfits.contains("NaN"), "{misfits}");
}

#[test]
fn variances_beyond_numbers_are_refused() {
    let folder = collected(6);
    folder.refuses(
        "gl-likelihood -b obs.txt -c x -v y --noise y=0.1 --sigma 5e-324 ensemble.txt -o misfit.txt",
        &["beyond what a number can say"],
    );
    folder.write("obs.txt", with_last_field(&folder.read("obs.txt"), "1e155"));
    folder.refuses(LIKELIHOOD, &["obs.txt", "beyond what a number can say"]);
}

#[test]
fn writers_to_one_file_leave_the_table_of_one_of_them() {
    let folder = collected(6);
    folder.run("gl-sample -p params.txt -n 3000 --name a -o a.txt");
    folder.run("gl-sample -p params.txt -n 3000 --name b -o b.txt");
    let one_of = [folder.read("a.txt"), folder.read("b.txt")];
    for _ in 0..10 {
        thread::scope(|scope| {
            for name in ["a", "b"] {
                let folder = &folder;
                scope.spawn(move || {
                    folder.run(&format!("gl-sample -p params.txt -n 3000 --name {name} -o same.txt"));
                });
            }
        });
        assert!(one_of.contains(&folder.read("same.txt")));
    }
}

#[test]
fn a_link_in_the_way_of_a_part_is_not_followed() {
    let folder = collected(6);
    folder.write("precious.txt", "keep\n");
    symlink(folder.path("precious.txt"), folder.path(".misfit.txt.part")).unwrap();
    folder.run(LIKELIHOOD);
    assert_eq!(folder.read("precious.txt"), "keep\n");
}

#[test]
fn two_outputs_to_one_file_are_refused() {
    let folder = collected(6);
    folder.run(LIKELIHOOD);
    folder.refuses(
        "gl-filter -s samples.txt -p params.txt misfit.txt -o w.txt --summary w.txt",
        &["w.txt: two outputs are to go there"],
    );
}

#[test]
fn a_stream_that_breaks_off_does_not_pass_for_complete() {
    let folder = collected(14);
    let ensemble = folder.read("ensemble.txt");
    let cut = ensemble.lines().count() / 2;
    let spoilt: Vec<String> = ensemble
        .lines()
        .enumerate()
        .map(|(i, line)| if i == cut { line.replace('\t', "\tabc") } else { line.to_owned() })
        .collect();
    folder.write("ensemble.txt", spoilt.join("\n") + "\n");
    let output = shell(
        &folder,
        "set +o pipefail; gl-likelihood -b obs.txt -c x -v y ensemble.txt | gl-filter -s samples.txt -o w.txt",
    );
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!folder.path("w.txt").exists());
}

/// What is written into a pipe between two samples is whole rows, and a program that is killed cannot say that more
/// should follow.
#[test]
fn a_stream_whose_writer_is_killed_between_samples_does_not_pass_for_complete() {
    let folder = Folder::default();
    folder.write("obs.txt", "x\ty\n0\t1\n");
    let names: Vec<String> = (0..150_000).map(|i| format!("s{i:06}")).collect();
    let table = |head: &str, row: &dyn Fn(&String) -> String| -> String {
        std::iter::once(head.to_owned()).chain(names.iter().map(row)).collect()
    };
    folder
        .write("samples.txt", table("description\tkey\ta\n", &|name| format!("{name}\t0\t{}\n", &name[1..])));
    // More than what is read before the first misfits are written.
    let runs = table("sample\tstep\tx\ty\n", &|name| format!("{name}\t0\t0\t0.{}\n", &name[1..]));
    let call = |tool: &str, arguments: &str| {
        let mut command = Command::new(programs().join(tool));
        command.args(arguments.split(' ')).current_dir(folder.path("")).stderr(Stdio::piped());
        command
    };
    let mut writer = call("gl-likelihood", "-b obs.txt -c x -v y --noise y=1 -")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut reader =
        call("gl-filter", "-s samples.txt -o w.txt -").stdin(writer.stdout.take().unwrap()).spawn().unwrap();
    writer.stdin.as_mut().unwrap().write_all(runs.as_bytes()).unwrap();
    // Until it has written what it can and waits for more.
    thread::sleep(Duration::from_millis(500));
    assert!(reader.try_wait().unwrap().is_none());
    writer.kill().unwrap();
    writer.wait().unwrap();
    let output = reader.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("stdin") && said.contains("ended before its table did"), "{said}");
    assert!(!folder.path("w.txt").exists());
    // Other programs mark nothing and are believed, and so is a writer that comes to its end.
    folder.write("runs.txt", runs);
    for writer in [
        "gl-likelihood -b obs.txt -c x -v y --noise y=1 runs.txt",
        "gl-likelihood -b obs.txt -c x -v y --noise y=1 runs.txt | cat",
    ] {
        let output = shell(&folder, &format!("{writer} | gl-filter -s samples.txt -o w.txt"));
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_sample_that_did_not_fail_has_a_misfit_where_it_is_known_which_failed() {
    let folder = collected(6);
    let name = folder.texts("samples.txt", "description")[2].clone();
    fs::remove_file(folder.path(&format!("runs/{name}_sim.txt"))).unwrap();
    folder.run(&format!("{COLLECT} --max-failed 0.5"));
    folder.run(LIKELIHOOD);
    let with_status = format!("{FILTER} --status status.txt");
    folder.run(&with_status);
    assert_eq!(folder.quantity("summary.txt", "failed"), 1.0);
    let last = folder.texts("samples.txt", "description")[5].clone();
    let rows: Vec<String> = folder.read("misfit.txt").lines().map(str::to_owned).collect();
    let cut: String =
        rows.iter().filter(|row| !row.starts_with(&last)).map(|row| format!("{row}\n")).collect();
    folder.write("misfit.txt", cut);
    fs::remove_file(folder.path("weights.txt")).unwrap();
    folder.refuses(
        &with_status,
        &[&format!(
            "misfit.txt: no misfit of {last}, which did not fail by status.txt; was the table cut off?"
        )],
    );
}

#[test]
fn samples_without_a_misfit_are_said() {
    let folder = collected(6);
    folder.run("gl-likelihood -b obs.txt -c x -v y ensemble.txt -o misfit.txt");
    let name = &folder.texts("samples.txt", "description")[4];
    let rows = folder.read("misfit.txt");
    // As where the writer was killed between two samples.
    let cut: String = rows
        .lines()
        .take_while(|row| !row.starts_with(name.as_str()))
        .map(|row| format!("{row}\n"))
        .collect();
    let said = |misfit: &str| {
        let output = folder.call("gl-filter -s samples.txt -o w.txt -", misfit);
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(said(&cut).contains(&format!("2 of 6 samples have no misfit, {name} first: left out")));
    assert!(!said(&rows).contains("no misfit"));
}

#[test]
fn a_stream_that_breaks_off_late_says_so_in_its_last_line() {
    let folder = collected(6);
    let output =
        folder.call("gl-filter -s samples.txt -o w.txt -", "sample\tstep\tmisfit\terror\n!incomplete\n");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("stdin:2: the table ends here"));
}

#[test]
fn a_number_that_may_be_cut_off_is_refused() {
    let folder = collected(6);
    let obs = folder.read("obs.txt");
    folder.write("obs.txt", obs.trim_end());
    folder.refuses(LIKELIHOOD, &["obs.txt:", "the last line has no end"]);
    folder.write("obs.txt", obs);
    folder.run(LIKELIHOOD);
    let misfits = folder.read("misfit.txt");
    folder.write("misfit.txt", misfits.trim_end());
    folder.refuses(FILTER, &["misfit.txt:", "cut off"]);
    folder.write("misfit.txt", misfits);
    folder.run(FILTER);
    for (file, call) in [
        ("summary.txt", "gl-check-stop summary.txt"),
        ("ensemble.txt", "gl-emulate -p params.txt -s samples.txt -c x -v y --check ensemble.txt"),
    ] {
        let whole = folder.read(file);
        folder.write(file, whole.trim_end());
        folder.refuses(call, &[file, "the last line has no end"]);
        folder.write(file, whole);
    }
    folder.write("summary.txt", "quantity value\n");
    folder.refuses("gl-check-stop summary.txt", &["summary.txt: no quantities"]);
    folder.write("weights.txt", folder.read("weights.txt").trim_end());
    folder.refuses("gl-predict -w weights.txt ensemble.txt -o predicted.txt", &["weights.txt:", "no end"]);
}

#[test]
fn lines_that_end_with_cr_alone_are_refused() {
    let folder = collected(6);
    folder.write("samples.txt", folder.read("samples.txt").replace('\n', "\r"));
    folder.refuses(COLLECT, &["samples.txt: its lines end with CR alone"]);
}

#[test]
fn steps_beyond_the_measurement_are_refused() {
    let folder = collected(6);
    let steps = folder.read("obs.txt").lines().count() - 1;
    folder.refuses(
        "gl-likelihood -b obs.txt -c x -v y --steps 0:999 ensemble.txt -o misfit.txt",
        &["--steps 0:999", &format!("the measurement has {steps} steps")],
    );
}

#[test]
fn a_closed_stdout_is_an_error() {
    let folder = collected(6);
    let output = shell(&folder, "gl-sample -p params.txt -n 4 >&-");
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    let output = shell(&folder, "gl-sample -p params.txt -n 4 >/dev/null");
    assert_eq!(output.status.code(), Some(0));
    // As it is where a caller opens a null device for reading, too: words may go there, a table may not.
    let output = shell(&folder, "gl-sample -p params.txt -n 4 1<>/dev/null");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("-o /dev/null for no table"));
    let output = shell(&folder, "gl-sample --help 1<>/dev/null");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn absurd_numbers_of_samples_are_refused() {
    let folder = collected(6);
    for n in ["1000000000", "18446744073709551615"] {
        let limit = format!("\"{n}\" is not a number from 1 to 10000000, nor is it auto");
        folder.refuses(&format!("gl-sample -p params.txt -n {n} -o many.txt"), &["-n", &limit]);
    }
    folder.refuses(
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y --next 100000 --next-out n.txt ensemble.txt",
        &["--next 100000: give at most 1000"],
    );
}

#[test]
fn twenty_parameters_and_components_are_drawn_one_way_or_the_other() {
    let folder = Folder::default();
    let rows: String = (0..20).map(|j| format!("p{j} 0 1\n")).collect();
    folder.write("params.txt", format!("name lower upper\n{rows}"));
    folder.run("gl-sample -p params.txt -n 400 -o samples.txt");
    let samples = folder.table("samples.txt");
    let names: Vec<String> = (0..20).map(|j| format!("p{j}")).collect();
    let mut weights = format!("sample\t{}\tweight\n", names.join("\t"));
    for row in 0..samples.len() {
        let fields: Vec<&str> = (2..22).map(|j| samples.field(row, j)).collect();
        weights += &format!("s{row}\t{}\t1\n", fields.join("\t"));
    }
    folder.write("weights.txt", weights);
    let said = folder.run("gl-gmm-resample -p params.txt -n 200 --components 20 weights.txt -o next.txt");
    assert_eq!(folder.table("next.txt").len(), 200, "{said}");
}

/// A line that is weighed, with this for the first value of its ensemble.
fn with_first_value(value: &str) -> Folder {
    let folder = collected(12);
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    let ensemble = folder.read("ensemble.txt");
    let (before, after) = ensemble.split_at(ensemble.match_indices('\n').nth(1).unwrap().0);
    folder
        .write("ensemble.txt", with_last_field(&format!("{before}\n"), value).trim_end().to_owned() + after);
    folder
}

#[test]
fn a_run_beyond_what_can_be_calculated_with_is_refused_by_all_who_calculate_with_it() {
    let folder = with_first_value("1e200");
    for line in [
        "gl-predict ensemble.txt -o out.txt",
        "gl-emulate -p params.txt -s samples.txt --check ensemble.txt -o out.txt",
        "gl-gap-locate -b obs.txt -c x -v y -w weights.txt ensemble.txt -o out.txt",
        "gl-gap-shrink -b obs.txt -c x -v y --before ensemble.txt,weights.txt --after ensemble.txt,weights.txt -o out.txt",
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt -o out.txt",
        "gl-plot fit -b obs.txt ensemble.txt -o out.svg",
    ] {
        folder.refuses(line, &["ensemble.txt:2: column y: 1e200", "1e100"]);
    }
}

#[test]
fn samples_and_bounds_beyond_what_can_be_calculated_with_are_refused() {
    let folder = collected(12);
    folder.write("far.txt", "description key a b\nfar 0 1e308 4\n");
    folder.refuses(
        "gl-emulate -p params.txt -s samples.txt --at far.txt ensemble.txt -o out.txt",
        &["far.txt:2: column a: 1e308", "1e100"],
    );
    folder.write("params.txt", "name lower upper\na 0.1 1e150\nb 0.1 10\n");
    folder.refuses("gl-sample -p params.txt -n 4 -o out.txt", &["params.txt:2: column upper: 1e150"]);
}

#[test]
fn shares_of_scatter_without_sense_are_refused() {
    let folder = collected(12);
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    for line in [
        "gl-emulate -p params.txt -s samples.txt --check ensemble.txt",
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt",
        "gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt",
        "gl-gap-shrink -b obs.txt -c x -v y --before ensemble.txt,weights.txt --after ensemble.txt,weights.txt",
    ] {
        for scatter in ["1e18", "inf", "nan"] {
            folder.refuses(&format!("{line} --scatter {scatter} -o out.txt"), &["--scatter"]);
        }
    }
}

#[test]
fn an_effect_of_the_measurement_is_given_once() {
    collected(12).refuses(
        "gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt --measurement offset,gain,offset",
        &["--measurement: offset is given twice"],
    );
}

#[test]
fn what_was_believed_is_of_the_same_parameters() {
    let folder = collected(12);
    folder.write("believed.txt", "name lower upper\na 0.1 10\n");
    folder.refuses(
        "gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y ensemble.txt --prior believed.txt --measurement offset",
        &["believed.txt: no row b, which params.txt has"],
    );
}

#[test]
fn names_of_observables_are_neither_empty_nor_repeated() {
    let folder = collected(6);
    let line = |names: &str| LIKELIHOOD.replace("-v y", &format!("-v {names}"));
    folder.refuses(&line("y,y"), &["obs.txt", "-v", "y is named twice"]);
    folder.refuses(&line("y,"), &["obs.txt", "-v", "a name is empty"]);
    folder.refuses(&line(","), &["obs.txt", "-v", "a name is empty"]);
    folder.refuses(&line("x"), &["obs.txt", "x is named as control (-c) and as observable (-v)"]);
    folder.refuses("gl-plot fit -b obs.txt -v y,y ensemble.txt -o out.svg", &["-v", "y is named twice"]);
}

/// The columns of a table in another order, and one of words put in before them.
fn with_columns(folder: &Folder, file: &str, order: &[&str]) {
    let table = folder.table(file);
    let mut text = format!("note\t{}\n", order.join("\t"));
    for row in 0..table.len() {
        let fields = order.iter().map(|name| table.field(row, table.format().column(name).unwrap()));
        text += &format!("w{row}\t{}\n", fields.collect::<Vec<_>>().join("\t"));
    }
    folder.write(file, text);
}

#[test]
fn columns_go_by_name_and_words_are_left_aside() {
    let folder = collected(14);
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    folder.write("at.txt", "description key a b\nnew 0 0.5 4\n");
    let lines = [
        "gl-predict -w weights.txt ensemble.txt",
        "gl-emulate -p params.txt -s samples.txt --at at.txt ensemble.txt",
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y -n 20 --noise y=0.3 ensemble.txt",
        "gl-plot fit -b obs.txt -w weights.txt ensemble.txt",
        "gl-plot posterior -w weights.txt",
        "gl-plot emulator -e ensemble.txt ensemble.txt",
        "gl-likelihood -b obs.txt -c x -v y ensemble.txt",
        "gl-filter -s samples.txt misfit.txt",
        "gl-collect -s samples.txt -b obs.txt -c x -v y runs",
        "gl-gap-locate -b obs.txt -c x -v y -w weights.txt --noise y=0.3 ensemble.txt",
        "gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v y --noise y=0.3 --measurement offset ensemble.txt",
        "gl-gmm-resample -p params.txt -n 5 weights.txt",
        "gl-box narrow -p params.txt weights.txt",
    ];
    let plain: Vec<String> = lines.iter().map(|line| folder.stdout(line)).collect();
    with_columns(&folder, "ensemble.txt", &["x", "step", "sample", "y"]);
    with_columns(&folder, "samples.txt", &["key", "a", "description", "b"]);
    with_columns(&folder, "weights.txt", &["weight", "a", "b", "error", "misfit", "sample"]);
    with_columns(&folder, "misfit.txt", &["error", "misfit", "step", "readings", "expected", "sample"]);
    with_columns(&folder, "at.txt", &["b", "a", "key", "description"]);
    for (line, plain) in lines.iter().zip(plain) {
        assert_eq!(folder.stdout(line), plain, "{line}");
    }
}

#[test]
fn a_word_among_numbers_is_a_slip_and_no_column_of_words() {
    let folder = collected(6);
    let samples = folder.read("samples.txt");
    let mut rows: Vec<Vec<&str>> = samples.lines().map(|line| line.split('\t').collect()).collect();
    rows[1][2] = "abc";
    folder.write("samples.txt", rows.iter().map(|row| row.join("\t") + "\n").collect::<String>());
    folder.refuses(COLLECT, &["samples.txt:2: column a: \"abc\" is not a number"]);
    let folder = with_first_value("abc");
    folder.refuses(
        "gl-predict ensemble.txt -o out.txt",
        &["ensemble.txt:2: column y: \"abc\" is not a number"],
    );
}

#[test]
fn messages_about_numbers_name_their_file() {
    let folder = collected(6);
    folder.run(LIKELIHOOD);
    folder.write("few.txt", "quantity value\nruns 3\n");
    folder.refuses("gl-check-stop --sigma-tol 1 few.txt", &["few.txt: the summary has no quantity sigma"]);
    let alike: String =
        folder.texts("samples.txt", "description").iter().map(|name| format!("{name} 0 1 0.1\n")).collect();
    folder.write("misfit.txt", format!("sample step misfit error\n{alike}"));
    folder.refuses(FILTER, &["misfit.txt: all 6 runs have the same misfit"]);
    folder.write("misfit.txt", format!("sample step misfit error\n{}\n", alike.lines().next().unwrap()));
    folder.refuses(FILTER, &["misfit.txt: one run alone", "--sigma"]);
    folder.refuses(
        "gl-sample -p params.txt -n 3 --effects none,z",
        &["params.txt: no parameter belongs to an effect none"],
    );
    folder.write("down.txt", "e_a q\n0.2 1\n0.1 2\n");
    folder
        .refuses("gl-triaxial -b down.txt --curve phi_c=32", &["down.txt: the axial strains must increase"]);
    folder.refuses("gl-triaxial --strain 7 --curve phi_c=32", &["--strain"]);
}

#[test]
fn a_summary_beyond_what_can_be_calculated_with_is_refused() {
    let folder = Folder::default();
    folder.write("summary.txt", "quantity value\nsigma 1\nbest_error 1e308\n");
    folder.refuses(
        "gl-check-stop --sigma-tol 1 summary.txt",
        &["summary.txt:3: column value: best_error: 1e308"],
    );
    folder.write("summary.txt", "quantity value\nsigma 1\nsigma_noise -5e-324\n");
    let output = folder.call("gl-check-stop --sigma-tol 1 summary.txt", "");
    assert_eq!(output.status.code(), Some(0));
    assert!(!String::from_utf8_lossy(&output.stderr).contains("inf"));
}

#[test]
fn noise_beyond_numbers_makes_no_measurement() {
    let folder = Folder::default();
    folder.refuses("gl-contact --curve E_m=9.3 --noise f=1e308 -o obs.txt", &["f"]);
    folder.refuses("gl-triaxial --curve phi_c=32 --noise q=1e308 -o obs.txt", &["q"]);
}

#[test]
fn a_history_over_all_that_numbers_can_say_is_drawn() {
    let folder = Folder::default();
    for (low, high) in [("1e-308", "0.05"), ("0.05", "1e295"), ("5e-324", "1.7e308")] {
        folder.write(
            "history.txt",
            format!("step sigma ess mean(a) cv(a)\n0 {low} .5 1 .1\n1 {high} .4 1.1 .2\n2 1 .3 1 .1\n"),
        );
        let picture = folder.stdout("gl-plot history history.txt");
        assert!(
            picture.ends_with("</svg>\n") && !picture.contains("NaN") && !picture.contains("inf"),
            "{low} {high}"
        );
    }
}

#[test]
fn pictures_and_priors_of_thousands_of_columns_are_refused_and_not_waited_for() {
    let folder = Folder::default();
    let names: Vec<String> = (0..2000).map(|j| format!("p{j}")).collect();
    let values = vec!["0.5"; names.len()].join(" ");
    folder.write("weights.txt", format!("sample {} weight\na {values} 1\n", names.join(" ")));
    folder.refuses("gl-plot posterior -w weights.txt -o out.svg", &["weights.txt: a picture of 2000 panels"]);
    let rows: String = names.iter().map(|name| format!("{name} 0 1\n")).collect();
    folder.write("params.txt", format!("name lower upper\n{rows}"));
    folder.refuses("gl-sample -p params.txt -n 4 -o out.txt", &["params.txt: 2000 parameters", "1000"]);
}

#[test]
fn a_slice_of_any_depth_is_drawn_or_refused() {
    let folder = collected(14);
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    for deviation in ["0", "1e9", "1e300"] {
        folder.run(&format!(
            "gl-gmm-resample -p params.txt -n 8 --deviation {deviation} weights.txt -o next.txt"
        ));
        assert_eq!(folder.table("next.txt").len(), 8, "{deviation}");
    }
    folder.refuses(
        "gl-gmm-resample -p params.txt -n 8 --concentration inf weights.txt -o next.txt",
        &["--concentration"],
    );
}

#[test]
fn steps_that_calibration_saw_are_steps_of_the_measurement() {
    let folder = collected(12);
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    folder.refuses(
        "gl-gap-shrink -b obs.txt -c x -v y --before ensemble.txt,weights.txt --after ensemble.txt,weights.txt --calibrated 0:99",
        &["--calibrated 0:99: the measurement has 20 steps"],
    );
}

/// A hyperbola with a stiffness and a strength, in kPa; stiffer than 4e4 the simulation breaks off early.
fn case_with_a_failing_corner() -> Folder {
    let folder = Folder::default();
    fs::create_dir(folder.path("case")).unwrap();
    folder.write("case/params.txt", "name lower upper scale\nE 5e3 1e5 log\nqm 200 800 linear\n");
    let mut obs = "eps q\n".to_owned();
    for i in 0..51 {
        let eps = 0.1 * f64::from(i) / 50.0;
        let noise = 2.0 * f64::from((7 * i) % 13 - 6) / 3.74;
        obs += &format!("{eps} {}\n", eps / (1.0 / 3e4 + eps / 355.0) + noise);
    }
    folder.write("case/obs.txt", &obs);
    folder.write(
        "case/case.toml",
        "name = \"hard\"\ncontrol = \"eps\"\nobservables = [\"q\"]\nnoise = { q = 2 }\n\n[model]\n\
         local = \"awk -f {case}/hard.awk -v E={E} -v qm={qm} -v name={description}\"\n",
    );
    folder.write(
        "case/hard.awk",
        "BEGIN { CONVFMT = \"%.12g\"; file = name \"_sim.txt\"; print \"eps\\tq\" > file; last = E < 4e4 ? 61 : 20\n\
         for (i = 0; i < last; i++) { e = i / 60 * 0.12; print e \"\\t\" e / (1 / E + e / qm) > file } }\n",
    );
    folder
}

#[test]
fn a_corner_of_the_prior_where_runs_fail_does_not_end_a_calibration() {
    let folder = case_with_a_failing_corner();
    for seed in [0, 3, 6] {
        folder.run(&format!("gl-calibrate case --out out{seed} seed={seed}"));
        let of = |quantity: &str| folder.quantity(&format!("out{seed}/posterior.txt"), quantity);
        assert!(of("failed") > 0.0, "{seed}");
        assert!(
            (of("mean(E)") / 3e4 - 1.0).abs() < 0.15 && (of("mean(qm)") / 355.0 - 1.0).abs() < 0.1,
            "{seed}"
        );
    }
}

#[test]
fn a_model_that_was_mended_after_no_run_could_be_read_is_said() {
    let folder = case_with_a_failing_corner();
    let model = folder.read("case/hard.awk");
    folder.write("case/hard.awk", model.replace("eps\\tq", "eps\\tp"));
    let call = || {
        let output = folder.call("gl-calibrate case --out out seed=1 iterations=2", "");
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let said = call();
    assert!(said.contains("no column q") && !said.contains("was changed after"), "{said}");
    folder.write("case/hard.awk", model);
    let said = call();
    assert!(said.contains("hard.awk was changed after the runs in out"), "{said}");
}

#[test]
fn a_disk_that_takes_no_draws_ends_a_calibration_and_changes_nothing_of_it() {
    let folder = case_with_a_failing_corner();
    folder.run("gl-calibrate case --out whole seed=1");
    // Room for the runs and their table, and not for the draws.
    let output = shell(&folder, "trap '' XFSZ; ulimit -f 32; gl-calibrate case --out out seed=1");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("File too large") && said.contains("gl-posterior failed"), "{said}");
    assert!(!said.contains("no emulator can be trained") && !folder.path("out/iter0/fallback.txt").exists());
    folder.run("gl-calibrate case --out out seed=1");
    assert_eq!(folder.read("out/posterior.txt"), folder.read("whole/posterior.txt"));
}

#[test]
fn an_observable_that_does_not_vary_ends_a_diagnosis_before_the_first_run() {
    let folder = case_with_a_failing_corner();
    folder.write("case/obs.txt", "eps q\n0.05 300\n");
    let output = folder.call("gl-diagnose case --out out measurement=offset", "");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("obs.txt: q does not vary over its 1 reading"), "{said}");
    assert!(!folder.path("out").exists());
    let output = folder.call("gl-check case/case.toml", "");
    assert!(String::from_utf8_lossy(&output.stderr).contains("give the folder that it is in"));
}

#[test]
fn a_calibration_and_a_diagnosis_do_not_go_into_one_folder() {
    let folder = case_with_a_failing_corner();
    fs::create_dir_all(folder.path("diagnosis/base/iter0")).unwrap();
    fs::create_dir_all(folder.path("calibration/iter0")).unwrap();
    for (call, other) in [
        ("gl-calibrate case --out diagnosis", "a diagnosis in it (base/iter0)"),
        ("gl-diagnose case --out calibration", "a calibration in it (iter0)"),
        ("gl-submit case --diagnose --out calibration", "a calibration in it (iter0)"),
        ("gl-iterate case case/params.txt case --out diagnosis", "a diagnosis in it (base/iter0)"),
    ] {
        let output = folder.call(call, "");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(other) && said.contains("give another --out"), "{said}");
    }
}

#[test]
fn a_model_that_was_changed_is_said_and_one_that_takes_no_parameter_ends_at_once() {
    let folder = case_with_a_failing_corner();
    let model = folder.read("case/hard.awk");
    folder.run("gl-calibrate case --out out seed=1 iterations=2");
    assert!(!folder.run("gl-calibrate case --out out seed=1 iterations=2").contains("was changed after"));
    folder.write("case/hard.awk", format!("{model}# another\n"));
    assert!(
        folder
            .run("gl-calibrate case --out out seed=1 iterations=2")
            .contains("hard.awk was changed after the runs in out")
    );
    folder.write("case/hard.awk", model.replace("BEGIN {", "BEGIN { E = 3e4; qm = 355;"));
    let output = folder.call("gl-calibrate case --out same", "");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("same/iter0: all runs have the same curves"));
    folder.write("case/case.toml", folder.read("case/case.toml").replace(" -v name={description}", ""));
    assert!(folder.run("gl-check case").contains("no run has {description} in its command"));
}

#[test]
fn the_check_sees_what_a_calibration_would_only_see_later() {
    let folder = case_with_a_failing_corner();
    let case = folder.read("case/case.toml");
    for (setting, said) in [
        ("kept = \"nowhere.txt.gz\"", "case.toml:2: kept: case/nowhere.txt.gz: No such file"),
        ("num = 99999999999999999999", "case.toml:2: num"),
    ] {
        folder.write("case/case.toml", case.replacen('\n', &format!("\n{setting}\n"), 1));
        folder.refuses("gl-check case", &[said]);
    }
    folder.write("case/case.toml", &case);
    folder.write("case/obs.txt", "eps q\n0.05 300\n");
    assert!(
        folder.run("gl-check case noise.q=1").contains("1 reading against 2 parameters of the base model")
    );
}

#[test]
fn a_folder_of_results_may_be_called_like_an_option_and_be_asked_for_too_early() {
    let folder = case_with_a_failing_corner();
    folder.run("gl-calibrate case --out=-o seed=0 iterations=1");
    assert!(folder.path("-o/posterior.txt").exists());
    fs::create_dir_all(folder.path("begun/iter0")).unwrap();
    folder.refuses(
        "gl-report case --out begun",
        &["begun: its calibration has no posterior yet; gl-status begun"],
    );
}

#[test]
fn columns_of_a_table_of_runs_are_no_names_of_a_measurement() {
    let folder = case_with_a_failing_corner();
    let (case, obs) = (folder.read("case/case.toml"), folder.read("case/obs.txt"));
    for (old, new) in [("eps", "step"), ("q", "sample")] {
        let renamed = case.replace(&format!("\"{old}\""), &format!("\"{new}\""));
        folder.write("case/case.toml", renamed.replace(&format!("{{ {old} "), &format!("{{ {new} ")));
        folder.write("case/obs.txt", obs.replace(old, new));
        folder.refuses("gl-check case", &[new, "cannot be an observable (-v) or the control (-c)"]);
    }
}
