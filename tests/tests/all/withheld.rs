//! A fast part of the withheld check, from the generator to the scorer.

use gl_table::Table;
use pipelines::withheld::bench::Bench;
use pipelines::withheld::condition::Condition;
use pipelines::withheld::diagnose::How;
use pipelines::withheld::generate::Which;
use pipelines::withheld::page::page;
use pipelines::withheld::score::{
    Scored, Share, calibration_error, calibration_error_by_chance, of_effects, read,
};
use pipelines::withheld::{diagnose, generate, weigh};

#[test]
fn withheld_effects_of_the_contact_are_found_and_no_others_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("contact-as-stated-15-8");
    let bench = Bench::named("contact").unwrap();
    // Each family of cases, with fewer runs than `make withheld` makes. Two minutes of a processor: the one check that a
    // change of the inference does not make the diagnosis worse. Of this seed four effects are visible, and one that is withheld.
    let which = Which { count: 10, no_candidate: false, seed: 8 };
    generate::generate(&bench, Condition::AsStated, which, &dir).unwrap();
    let how = How { runs: 15, in_rounds: true, exact: false, seed: 1 };
    diagnose::diagnose(&bench, how, &dir).unwrap();
    let cases = read(&dir).unwrap();
    let share = |choose: &dyn Fn(&Scored) -> bool, so: &dyn Fn(&Scored) -> bool| {
        Share::count(cases.iter().filter(|case| choose(case)), so)
    };
    let visible = share(&|case| case.is_of_one() && case.visibility >= 1.0, &Scored::is_right);
    assert!(visible.all >= 4 && visible.of + 1 >= visible.all, "one effect: {visible:?} {cases:#?}");
    let none = share(&Scored::is_of_none, &|case| case.names_wrong() && case.probability > 0.5);
    assert!(none.all == 3 && none.of == 0, "no effect: {none:?} {cases:#?}");
    let unknown = share(&Scored::is_seen_without, &Scored::is_confidently_wrong);
    assert_eq!(unknown.of, 0, "no candidate: {cases:#?}");
    let error = calibration_error(&of_effects(cases.iter()));
    assert!(error < 0.08, "{error}");
    // By the same rules the same comes first, without runs; what is kept of a hypothesis is all that they ask for.
    let said = |cases: &[Scored]| -> Vec<String> {
        cases
            .iter()
            .map(|case| format!("{} {:.9} {:?}", case.first, case.probability, case.effects))
            .collect()
    };
    let kept = dir.join("hypotheses.tsv");
    weigh::weigh(&dir).unwrap();
    assert_eq!(said(&read(&dir).unwrap()), said(&cases));
    let page = page(std::slice::from_ref(&dir)).unwrap();
    let told = |share: Share| format!("{} of {}", share.of, share.all);
    let row = format!("| one effect, visibility ≥ 1: right | {0} | {0} |", told(visible));
    assert!(
        page.contains(&row) && page.contains(&format!("| as stated | {} | - |", told(visible))),
        "{page}"
    );
    // Had every effect closed nothing, fewer would be named: those beside whose scatter no rest is needed, and those whose form no
    // rest has, with 0.9 at the most.
    let table = Table::read(&kept).unwrap();
    let closes = table.format().column("closes").unwrap();
    let vague = table.format().column("vague").unwrap();
    let mut rows = vec![table.format().columns().join("\t")];
    rows.extend((0..table.len()).map(|row| {
        let field = |column: usize| match column {
            _ if column == closes => "0",
            _ if column == vague => "no",
            _ => table.field(row, column),
        };
        (0..table.format().columns().len()).map(field).collect::<Vec<_>>().join("\t")
    }));
    std::fs::write(&kept, rows.join("\n") + "\n").unwrap();
    weigh::weigh(&dir).unwrap();
    let named = |cases: &[Scored]| -> Vec<Scored> {
        let named = cases.iter().filter(|case| !matches!(case.first.as_str(), "none" | "unexplained"));
        named.cloned().collect()
    };
    let all = read(&dir).unwrap();
    let (before, after) = (named(&cases), named(&all));
    assert!(before.len() >= 6 && after.len() <= before.len() - 2, "{all:#?}");
    assert!(after.iter().all(|case| case.family == "Scatter" || case.probability <= 0.9), "{all:#?}");
    assert!(all.iter().all(|case| !case.names_wrong()), "{all:#?}");
}

#[test]
fn of_one_observable_an_adhesion_imitates_an_offset_and_nothing_a_plasticity() {
    let answers = |no_candidate: bool| {
        let dir = tempfile::tempdir().unwrap();
        let bench = Bench::under("contact", Condition::OneObservable).unwrap();
        let which = Which { count: 20, no_candidate, seed: 5801 };
        generate::generate(&bench, Condition::OneObservable, which, dir.path()).unwrap();
        Table::read(&dir.path().join("sealed/answers.tsv")).unwrap()
    };
    let (all, only) = (answers(false), answers(true));
    let rows = |table: &Table| -> Vec<Vec<String>> {
        let columns = table.format().columns().len();
        (0..table.len()).map(|i| (0..columns).map(|c| table.field(i, c).to_owned()).collect()).collect()
    };
    let column = |name: &str| all.format().column(name).unwrap();
    let is_withheld = |row: &Vec<String>| row[column("withheld")] != "-";
    assert_eq!(rows(&only), rows(&all).into_iter().filter(is_withheld).collect::<Vec<_>>());
    // What another candidate leaves, of what the base leaves.
    let left = |name: &str| -> Vec<f64> {
        let own = (0..only.len()).filter(|&i| only.field(i, column("withheld")) == name);
        let number = |i: usize, name: &str| only.number(i, column(name)).unwrap();
        own.map(|i| number(i, "imitated") / number(i, "visibility")).collect()
    };
    // Two of them, as far beyond the prior as a diagnosis goes, leave no more, and mostly less.
    let least = |name: &str| only.numbers(name).unwrap();
    let shares: Vec<f64> =
        least("considered").iter().zip(least("imitated")).map(|(two, one)| two / one).collect();
    assert!(shares.iter().all(|share| *share <= 1.0), "{shares:?}");
    assert!(shares.iter().any(|share| *share < 0.9), "{shares:?}");
    let (offset, plasticity) = (left("offset"), left("plasticity"));
    assert!(!offset.is_empty() && offset.iter().all(|left| *left < 0.5), "{offset:?}");
    assert!(
        !plasticity.is_empty() && plasticity.iter().all(|left| (0.7..1.0).contains(left)),
        "{plasticity:?}"
    );
}

#[test]
fn by_chance_one_statement_is_off_by_twice_its_variance_and_many_by_less() {
    for stated in [0.1, 0.5, 0.85] {
        let one = calibration_error_by_chance(&[(stated, true)]);
        assert!((one - 2.0 * stated * (1.0 - stated)).abs() < 0.03, "{stated}: {one}");
    }
    // The mean of |k/n - p| for n = 100, p = 1/2 is √(2 p (1 - p) / (π n)) = 0.0399.
    let many = calibration_error_by_chance(&[(0.5, true); 100]);
    assert!((many - 0.0399).abs() < 0.003, "{many}");
}
