//! Packed runs: one file with many runs in it stands for two files a run.

use pipelines::folder::Folder;
use pipelines::line;
use pipelines::packed::pack;

const COLLECT: &str = "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt --status status.txt --max-failed 0.95";

/// A line with `n` samples that have run, and their names.
fn line_case(n: usize) -> (Folder, Vec<String>) {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.run(&format!("gl-sample -p params.txt -n {n} -o samples.txt"));
    line::simulate(&folder, "samples.txt", "runs");
    let names = folder.texts("samples.txt", "description");
    (folder, names)
}

/// Ensemble and status of the runs in a folder.
fn collected(folder: &Folder, runs: &str) -> (String, String) {
    folder.run(&COLLECT.replace(" runs ", &format!(" {runs} ")));
    (folder.read("ensemble.txt"), folder.read("status.txt"))
}

fn reasons(folder: &Folder) -> Vec<String> {
    folder.run(COLLECT);
    folder.texts("status.txt", "status")
}

#[test]
fn packed_runs_give_the_bytes_and_the_reasons_of_loose_ones() {
    let (folder, names) = line_case(2000);
    let sim = |i: usize| format!("runs/{}_sim.txt", names[i]);
    let good = folder.read(&sim(0));
    std::fs::remove_file(folder.path(&sim(1))).unwrap();
    folder.write(&sim(2), "");
    folder.write(&sim(3), &folder.read(&sim(3))[..folder.read(&sim(3)).len() - 3]);
    folder.write(&sim(4), folder.read(&sim(4)).replacen("\n3 ", "\n3 nan\n#", 1));
    folder.write(&format!("runs/{}_param.txt", names[5]), "a b\n0.3 0.3\n");
    folder.write(&sim(7), line::run((0..15).map(f64::from), 0.5, 4.0));
    folder.write(&sim(8), "x y\n");
    folder.write(&sim(9), good.replacen("x y", "x z", 1));
    std::fs::remove_file(folder.path(&format!("runs/{}_param.txt", names[10]))).unwrap();
    folder.write(&sim(11), good.replacen("\n3 ", "\n3 a", 1));
    folder.write(&sim(12), good.replace('\n', "\r\n"));
    let loose = collected(&folder, "runs");
    assert_eq!(folder.texts("status.txt", "status")[12], "ok");
    assert_eq!(folder.texts("status.txt", "status").iter().filter(|status| *status == "ok").count(), 1990);

    // In tasks of 150 rows, in an order that is not that of the samples.
    for (i, task) in names.chunks(150).enumerate() {
        let task: Vec<String> = task.iter().rev().cloned().collect();
        folder.write(&format!("packed/task{i}_packed.txt"), pack(&folder, "runs", &task));
    }
    assert_eq!(loose, collected(&folder, "packed"));
    // As one file too, and by way of stdout.
    folder.write("one/all_packed.txt", pack(&folder, "runs", &names));
    assert_eq!(loose, collected(&folder, "one"));
    assert_eq!(loose.0, folder.stdout("gl-collect -s samples.txt -b obs.txt -c x -v y one"));
}

/// Wherever a task is killed: the runs that it has packed count, the one it was at does not.
#[test]
fn a_packed_file_that_is_cut_off_anywhere_keeps_the_runs_before() {
    let (folder, names) = line_case(3);
    let whole = collected(&folder, "runs").0;
    let packed = pack(&folder, "runs", &names);
    let ends: Vec<usize> = (1..=3).map(|n| pack(&folder, "runs", &names[..n]).len()).collect();
    std::fs::remove_dir_all(folder.path("runs")).unwrap();
    for cut in ends[0]..=packed.len() {
        folder.write("runs/task_packed.txt", &packed[..cut]);
        let found = reasons(&folder);
        let complete = ends.iter().filter(|end| **end <= cut).count();
        assert!(found[..complete].iter().all(|reason| reason == "ok"), "{cut} bytes: {found:?}");
        let is_out = |reason: &String| matches!(reason.as_str(), "missing" | "truncated");
        assert!(found[complete..].iter().all(is_out), "{cut} bytes: {found:?}");
        let ensemble = folder.read("ensemble.txt");
        assert!(whole.starts_with(&ensemble), "{cut} bytes");
    }
    assert_eq!(folder.read("ensemble.txt"), whole);
}

#[test]
fn of_several_copies_of_a_run_a_good_one_counts() {
    let (folder, names) = line_case(4);
    let whole = collected(&folder, "runs").0;
    let good = pack(&folder, "runs", &names);
    // Each run in a state of its own in an earlier file: other parameters, cut off, failed, absent.
    line::simulate(&folder, "samples.txt", "old");
    folder.write(&format!("old/{}_param.txt", names[0]), "a b\n0.3 0.3\n");
    folder.write(&format!("old/{}_sim.txt", names[2]), "x y\n0 nan\n");
    let mut old = pack(&folder, "old", &[names[0].clone(), names[2].clone(), names[1].clone()]);
    old.truncate(old.len() - 40);
    for (earlier, later) in [("a", "b"), ("b", "a")] {
        folder.write(&format!("both/{earlier}_packed.txt"), &old);
        folder.write(&format!("both/{later}_packed.txt"), &good);
        assert_eq!(collected(&folder, "both").0, whole);
    }
    // Loose beside a packed one that is of no use, and a packed one beside a loose one of no use.
    folder.write("runs/old_packed.txt", &old);
    assert_eq!(collected(&folder, "runs").0, whole);
    folder.write("runs/old_packed.txt", &good);
    for name in &names[..3] {
        folder.write(&format!("runs/{name}_sim.txt"), "x y\n0 nan\n");
    }
    assert_eq!(collected(&folder, "runs").0, whole);
    // None of use: the loose one's reason counts.
    folder.write("runs/old_packed.txt", &old);
    assert_eq!(reasons(&folder), ["non-finite", "non-finite", "non-finite", "ok"]);
}

#[test]
fn a_run_in_two_folders_is_refused_packed_or_not() {
    let (folder, names) = line_case(2);
    folder.write("packed/task_packed.txt", pack(&folder, "runs", &names[1..]));
    for folders in ["runs packed", "packed runs"] {
        folder.refuses(&COLLECT.replace(" runs ", &format!(" {folders} ")), &["and in another folder"]);
    }
    std::fs::remove_file(folder.path(&format!("runs/{}_sim.txt", names[1]))).unwrap();
    folder.run(&COLLECT.replace(" runs ", " runs packed "));
    assert_eq!(folder.texts("status.txt", "status"), ["ok", "ok"]);
}

#[test]
fn damage_in_a_packed_file_is_told_with_its_place() {
    let (folder, names) = line_case(3);
    let first = pack(&folder, "runs", &names[..1]);
    let rest = pack(&folder, "runs", &names[1..]);
    std::fs::remove_dir_all(folder.path("runs")).unwrap();
    for damage in ["\0\0\0\0\n", "x y\n0 1\n", "# file\n", "# file a_sim.txt many\n"] {
        folder.write("runs/task_packed.txt", format!("{first}{damage}{rest}"));
        assert_eq!(reasons(&folder), ["ok", "missing", "missing"], "{damage:?}");
        let place = format!("runs/task_packed.txt: no file of a run at byte {}", first.len());
        assert!(folder.texts("status.txt", "detail")[1].ends_with(&place), "{}", folder.read("status.txt"));
    }
    // A size that no file has, and one that is not there.
    for size in ["18446744073709551615", "99999999999", "99999999999999999999"] {
        let name = &names[1];
        folder.write("runs/task_packed.txt", format!("{first}# file {name}_sim.txt {size}\nx y\n"));
        let found = reasons(&folder);
        assert!(found[0] == "ok" && found[1] != "ok" && found[2] == "missing", "{size}: {found:?}");
    }
}
