//! Real laboratory data and real Yade runs, against what GrainLearning 2.0.5 makes of them.

use std::fmt::Write;

use pipelines::folder::Folder;
use pipelines::require_data;

/// The oedometer test with its four iterations of 100 runs, as `data`.
fn oedometer() -> Option<Folder> {
    let folder = Folder::default();
    folder.link(&require_data("oedometer")?, "data");
    folder.write("params.txt", "name lower upper\nE 100e9 200e9\nmu 0.3 0.5\nk_r 0 1e4\nmu_r 0.1 0.5\n");
    Some(folder)
}

/// From the runs of an iteration to its misfits.
fn misfits(folder: &Folder, iteration: usize, scale: &str) {
    folder.run(&format!(
        "gl-collect -s data/iter{iteration}/samples.txt -b data/obs.txt -c e_a=e_z -v p,q,n \
         data/iter{iteration}/sims --max-failed 0 --status status{iteration}.txt -o ensemble{iteration}.txt"
    ));
    folder.run(&format!(
        "gl-likelihood -b data/obs.txt -c e_a -v p,q,n --weights n=0.01 --scale {scale} \
         ensemble{iteration}.txt -o misfit{iteration}.txt"
    ));
}

/// A row a run says what its steps do, when no history is asked for.
#[test]
fn misfits_of_whole_runs_weigh_as_those_of_their_steps() {
    let Some(folder) = oedometer() else { return };
    misfits(&folder, 0, "max");
    folder.run(
        "gl-likelihood -b data/obs.txt -c e_a -v p,q,n --weights n=0.01 --total ensemble0.txt -o total.txt",
    );
    assert_eq!(folder.table("total.txt").len(), 100);
    for sigma in ["--ess 0.2", "--sigma noise"] {
        for (misfits, name) in [("misfit0.txt", "steps"), ("total.txt", "runs")] {
            folder.run(&format!(
                "gl-filter -s data/iter0/samples.txt {sigma} --summary {name}-summary.txt {misfits} -o {name}.txt"
            ));
        }
        for quantity in ["sigma", "sigma_noise", "ensemble_error", "mean(E)", "q05(mu)"] {
            let of = |name: &str| folder.quantity(&format!("{name}-summary.txt"), quantity);
            let (steps, runs) = (of("steps"), of("runs"));
            assert!((steps - runs).abs() <= 1e-9 * steps.abs(), "{quantity}: {steps} and {runs}");
        }
    }
}

fn assert_close(here: f64, there: f64, what: &str) {
    // The reference has ten digits.
    assert!((here - there).abs() <= 1e-8 * there.abs(), "{what}: {here} is not {there}");
}

#[test]
fn means_spreads_weights_and_sigma_agree() {
    let Some(folder) = oedometer() else { return };
    let reference = folder.table("data/reference.tsv");
    let weights = folder.table("data/reference_weights.tsv");
    let field = |table: &gl_table::Table, row: usize, name: &str| {
        table.field(row, table.format().column(name).unwrap()).to_owned()
    };
    let number =
        |table: &gl_table::Table, row: usize, name: &str| -> f64 { field(table, row, name).parse().unwrap() };
    let mut compared = 0;
    for scale in ["max", "value"] {
        misfits(&folder, 0, scale);
        for target in ["--ess 0.2", "--sigma 0.01"] {
            folder.run(&format!(
                "gl-filter -s data/iter0/samples.txt {target} --summary summary.txt misfit0.txt -o weights.txt"
            ));
            let sigma = folder.quantity("summary.txt", "sigma");
            let belongs = |table: &gl_table::Table, row: usize| {
                let there = number(table, row, "sigma");
                field(table, row, "scale") == scale && (sigma - there).abs() <= 1e-6 * there
            };
            for row in (0..reference.len()).filter(|&row| belongs(&reference, row)) {
                let name = field(&reference, row, "parameter");
                for (quantity, column) in [
                    ("sigma".to_owned(), "sigma"),
                    ("ess".to_owned(), "ess"),
                    (format!("mean({name})"), "mean"),
                    (format!("cv({name})"), "cv"),
                    (format!("best({name})"), "most_probable"),
                ] {
                    let here = folder.quantity("summary.txt", &quantity);
                    assert_close(here, number(&reference, row, column), &format!("{scale} {quantity}"));
                    compared += 1;
                }
            }
            let (names, here) =
                (folder.texts("weights.txt", "sample"), folder.column("weights.txt", "weight"));
            for row in (0..weights.len()).filter(|&row| belongs(&weights, row)) {
                let place = names.iter().position(|name| *name == field(&weights, row, "sample")).unwrap();
                assert_close(here[place], number(&weights, row, "weight"), &names[place]);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 2 * 2 * (4 * 5 + 100));
}

#[test]
fn four_iterations_are_weighed_together() {
    let Some(folder) = oedometer() else { return };
    let (mut filter, mut before) = (String::new(), String::new());
    for iteration in 0..4 {
        misfits(&folder, iteration, "max");
        write!(before, " -s data/iter{iteration}/samples.txt --proposal prior").unwrap();
        write!(filter, " misfit{iteration}.txt").unwrap();
        let failed = folder.texts(&format!("status{iteration}.txt"), "status");
        assert_eq!(failed, ["ok"; 100]);
    }
    folder.run(&format!(
        "gl-filter -p params.txt{before} --ess 0.2 --history history.txt --summary summary.txt{filter} -o weights.txt"
    ));
    assert_eq!(folder.quantity("summary.txt", "runs"), 400.0);
    assert!((folder.quantity("summary.txt", "ess") - 0.2).abs() < 1e-9);
    assert!(folder.quantity("summary.txt", "best_error") < 0.05);
    assert_eq!(folder.table("weights.txt").len(), 400);
    // A line a step, the last one the whole.
    assert_eq!(folder.table("history.txt").len(), folder.table("data/obs.txt").len());
    for parameter in ["E", "mu", "k_r", "mu_r"] {
        let course = folder.column("history.txt", &format!("mean({parameter})"));
        let end = folder.quantity("summary.txt", &format!("mean({parameter})"));
        assert!((course.last().unwrap() - end).abs() < 1e-12 * end, "{parameter}");
    }

    let ensembles: Vec<String> = (0..4).map(|i| folder.read(&format!("ensemble{i}.txt"))).collect();
    let header = ensembles[0].lines().next().unwrap();
    let rows: String = ensembles.iter().map(|text| text.split_once('\n').unwrap().1).collect();
    folder.write("ensemble.txt", format!("{header}\n{rows}"));
    folder.run("gl-predict -w weights.txt -c e_a -v p,q,n ensemble.txt -o prediction.txt");
    let measured = folder.column("data/obs.txt", "p");
    let low = folder.column("prediction.txt", "p_q05");
    let high = folder.column("prediction.txt", "p_q95");
    let held = (0..measured.len()).filter(|&t| low[t] <= measured[t] && measured[t] <= high[t]).count();
    assert!(2 * held > measured.len(), "the 90 % band of p holds {held} of {} steps", measured.len());

    folder.run("gl-gmm-resample -p params.txt -n 50 --iteration 4 weights.txt -o next.txt");
    assert_eq!(folder.table("next.txt").len(), 50);
    let next = folder.column("next.txt", "E");
    assert!(next.iter().all(|e| (100e9..=200e9).contains(e)), "{next:?}");
    let stop = folder.call("gl-check-stop --error-tol 1e-6 summary.txt", "");
    assert_eq!(stop.status.code(), Some(1));
}
