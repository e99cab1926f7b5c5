//! A fast part of the withheld check, from the generator to the scorer.

use pipelines::withheld::bench::Bench;
use pipelines::withheld::condition::Condition;
use pipelines::withheld::diagnose::How;
use pipelines::withheld::score::{
    Scored, Share, calibration_error, calibration_error_by_chance, of_effects, read,
};
use pipelines::withheld::{diagnose, generate};

#[test]
fn withheld_effects_of_the_contact_are_found_and_no_others_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let bench = Bench::named("contact").unwrap();
    // Each family of cases, with fewer runs than `make withheld` makes. Two minutes of a processor: the one check that a
    // change of the inference does not make the diagnosis worse. Of this seed four effects are visible, and one that is withheld.
    generate::generate(&bench, Condition::AsStated, 10, 8, dir.path()).unwrap();
    let how = How { runs: 15, in_rounds: true, exact: false, seed: 1 };
    diagnose::diagnose(&bench, how, dir.path()).unwrap();
    let cases = read(dir.path()).unwrap();
    let share = |choose: &dyn Fn(&Scored) -> bool, so: &dyn Fn(&Scored) -> bool| {
        Share::count(cases.iter().filter(|case| choose(case)), so)
    };
    let one = |case: &Scored| !case.withheld && case.truth != "none" && !case.truth.contains('+');
    let visible = share(&|case| one(case) && case.visibility >= 1.0, &Scored::is_right);
    assert!(visible.all >= 4 && visible.of + 1 >= visible.all, "one effect: {visible:?} {cases:#?}");
    let none = share(&|case| case.truth == "none", &|case| case.names_wrong() && case.probability > 0.5);
    assert!(none.all == 3 && none.of == 0, "no effect: {none:?} {cases:#?}");
    let unknown = share(&|case| case.withheld && case.visibility >= 2.0, &|case| {
        case.names_wrong() && case.probability > 0.9
    });
    assert_eq!(unknown.of, 0, "no candidate: {cases:#?}");
    let error = calibration_error(&of_effects(&cases));
    assert!(error < 0.08, "{error}");
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
