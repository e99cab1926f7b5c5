//! `case.toml`: what is taken, and what is refused where.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use gl_case::{Case, Engine, Posterior, Settings};
use proptest::prelude::*;

const COLLISION: &str = r#"name = "collision"
control = "u"
observables = ["f", "t=shear"]
noise = { f = 0.005, t = 1 }
truth = { E_m = 9.3, nu = 0.2 }
num = 30

[model]
embedded = "gl-contact"
yade-batch = "collision.py"
"#;

fn parse(text: &str, given: &[&str]) -> anyhow::Result<Case> {
    Case::parse(Path::new("case"), "case/case.toml", text, given)
}

fn refused(text: &str, given: &[&str]) -> String {
    format!("{:#}", parse(text, given).unwrap_err())
}

#[test]
fn a_case_is_what_its_file_says() {
    let case = parse(COLLISION, &[]).unwrap();
    assert_eq!(case.name, "collision");
    let test = &case.tests[0];
    assert_eq!(
        (test.control.renamed(), test.observables[1].renamed()),
        ("u".to_owned(), "t=shear".to_owned())
    );
    assert_eq!(test.observable_names(), ["f", "t"]);
    assert_eq!(test.noise.to_string(), "f=0.005,t=1");
    assert_eq!((case.num, case.iterations, case.seed), (Some(30), 30, 0));
    assert_eq!((case.posterior, case.emulated), (Posterior::Emulator, 1000));
    assert_eq!(case.params(), Path::new("case/params.txt"));
}

#[test]
fn what_is_given_for_a_call_wins_in_any_case_and_in_short() {
    let given = ["NUM=5", "noise=f=0.1,t=2e-3", "Steps=0:40", "effects=a,b", "SIGMA_TOL=0.5", "emulated=0"];
    let case = parse(COLLISION, &given).unwrap();
    assert_eq!(case.num, Some(5));
    assert_eq!(case.tests[0].noise.to_string(), "f=0.1,t=0.002");
    assert_eq!(case.tests[0].steps.as_deref(), Some("0:40"));
    assert_eq!(case.effects, ["a", "b"]);
    assert_eq!(case.tolerances.sigma, Some(0.5));
    assert_eq!((case.posterior, case.emulated, case.iterations), (Posterior::Runs, 0, 10));
    for (given, posterior) in [
        ("posterior=runs", Posterior::Runs),
        ("posterior=weights", Posterior::Weights),
        ("posterior=emulator", Posterior::Emulator),
        ("emulated=500", Posterior::Weights),
    ] {
        assert_eq!(parse(COLLISION, &[given]).unwrap().posterior, posterior, "{given}");
    }
    let case = parse(COLLISION, &["noise={f=1,t=2}", "effects=", "measurement=offset", "packed=1"]).unwrap();
    assert_eq!(case.tests[0].noise.get("t"), Some(2.0));
    assert!(case.effects.is_empty());
    assert_eq!((case.measurement, case.packed), (vec!["offset".to_owned()], Some(true)));
}

#[test]
fn a_setting_that_there_is_not_is_refused_by_line_with_the_one_that_was_meant() {
    let text = COLLISION.replace("noise", "niose");
    assert_eq!(refused(&text, &[]), "case/case.toml:4: niose: did you mean noise?");
    let text = COLLISION.replace("embedded", "embeded");
    assert_eq!(refused(&text, &[]), "case/case.toml:9: model.embeded: did you mean embedded?");
    assert!(refused(COLLISION, &["nums=3"]).starts_with("nums=3: nums: did you mean num?"));
    let said = refused(&COLLISION.replace("[model]\n", ""), &[]);
    assert_eq!(said, "case/case.toml:8: embedded: an engine, which stands below a line [model]");
    let said = refused(&format!("colour = 1\n{COLLISION}"), &[]);
    assert!(said.starts_with("case/case.toml:1: colour: no such setting; they are name, control"), "{said}");
}

#[test]
fn a_value_of_the_wrong_kind_is_refused_by_line() {
    for (from, to, says) in [
        ("num = 30", "num = \"ten\"", "case/case.toml:6: num: \"ten\" where a whole number from 1 is needed"),
        ("num = 30", "num = 0", "case/case.toml:6: num: 0 where a whole number from 1"),
        ("num = 30", "ess = 2", "case/case.toml:6: ess: 2 where a number from 0 to 1"),
        ("num = 30", "steps = \"4:2\"", "case/case.toml:6: steps: \"4:2\" where \"A:B\" is needed"),
        ("num = 30", "scale = \"most\"", "scale: \"most\" where one of max, value, range, none"),
        ("num = 30", "num = 30\nnum = 31", "case/case.toml:7: duplicate key"),
        ("num = 30", "num = ", "case/case.toml:6: "),
        ("f = 0.005", "f = -1", "case/case.toml:4: noise: f = -1 where a number above 0"),
        ("f = 0.005", "g = 0.005", "case/case.toml:4: noise: no observable g: observables names f"),
        (", t = 1", "", "case/case.toml:4: noise: give it for each of f, t"),
        ("\"u\"", "\"f\"", "case/case.toml:3: f is the control"),
        ("\"u\"", "\"\"", "case/case.toml:2: control: \"\" is no column"),
        ("t=shear", "f", "case/case.toml:3: duplicate observable f"),
        ("[\"f\", \"t=shear\"]", "\"f\"", "case/case.toml:3: observables: invalid type"),
        ("name = \"collision\"", "", "case/case.toml: no name"),
    ] {
        let said = refused(&COLLISION.replace(from, to), &[]);
        assert!(said.contains(says), "{from} → {to}: {said}");
    }
    for (given, says) in [
        ("num=ten", "num=ten: \"ten\" where a whole number from 1"),
        ("num", "num: is not KEY=VALUE"),
        ("name=b", "name belongs to the case"),
        ("model=", "the command is empty"),
        ("measurement=ofset", "\"ofset\" where one of offset"),
        ("noise=g=1", "noise=g=1: noise: no observable g"),
    ] {
        let said = refused(COLLISION, &[given]);
        assert!(said.contains(says), "{given}: {said}");
    }
}

/// What make had expanded, cut off or run.
#[test]
fn nothing_is_expanded() {
    let text = COLLISION.replace("gl-contact", "run $HOME # $(shell touch here) {case}");
    let case = parse(&text, &[]).unwrap();
    assert_eq!(case.model.of(Engine::Embedded), Some("run $HOME # $(shell touch here) {case}"));
}

#[test]
fn the_model_is_that_of_the_engine_or_of_one_that_can_stand_in() {
    let model = |entries: &str| {
        parse(
            &COLLISION
                .replace("embedded = \"gl-contact\"", "")
                .replace("yade-batch = \"collision.py\"", entries),
            &[],
        )
        .unwrap()
        .model
    };
    let yade = model("yade-batch = \"a.py\"");
    assert_eq!([Engine::Local, Engine::Slurm, Engine::Pbs].map(|engine| yade.of(engine)), [Some("a.py"); 3]);
    assert_eq!((yade.of(Engine::Embedded), yade.default_engine()), (None, Some(Engine::YadeBatch)));
    assert_eq!(model("local = \"a.py\"").of(Engine::YadeBatch), Some("a.py"));
    assert_eq!(model("local = \"python3 a.py\"").of(Engine::YadeBatch), None);
    let both = model("local = \"b\"\nyade-batch = \"a.py\"\nslurm = \"c\"");
    assert_eq!([Engine::Slurm, Engine::Pbs].map(|engine| both.of(engine)), [Some("c"), Some("b")]);
    let given = parse(COLLISION, &["model=mine {a}=1"]).unwrap();
    assert_eq!(given.engine(Some(Engine::Pbs)).unwrap(), (Engine::Pbs, "mine {a}=1"));
    let said = format!(
        "{:#}",
        parse(COLLISION.split("[model]").next().unwrap(), &[]).unwrap().engine(None).unwrap_err()
    );
    assert!(said.contains("case/case.toml: no model"), "{said}");
}

#[test]
fn settings_of_a_call_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(Settings::read(folder.path()).unwrap(), None);
    let settings = Settings {
        case: "a case".to_owned(),
        engine: Engine::YadeBatch,
        given: vec!["noise=f=1".to_owned(), "model=a 'b' \"c\"".to_owned()],
    };
    std::fs::write(folder.path().join(Settings::FILE), settings.text().unwrap()).unwrap();
    assert_eq!(Settings::read(folder.path()).unwrap(), Some(settings));
}

proptest! {
    #[test]
    fn whatever_is_written_is_taken_or_refused_and_never_panics(text in "[a-z\\[\\]{}=.,\"#0-9 \\n-]{0,80}", given in "[a-zA-Z_.]{0,9}=[ -~]{0,20}") {
        let _ = parse(&text, &[]);
        let _ = parse(&format!("{text}\n{COLLISION}"), &[]);
        let _ = parse(COLLISION, &[&given]);
    }
}
