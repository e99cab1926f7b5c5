//! Small valid calls of every tool that reads a table, and the tables.

use std::collections::BTreeMap;

use crate::example;
use crate::folder::Folder;
use crate::line;
use crate::packed::pack;

/// A call that is valid.
pub struct Call {
    /// As it is typed, without quotes.
    pub line: &'static str,
    /// How often it is taken; what is slow is taken less.
    pub weight: f64,
    /// The flags that take a value, of all that the tool has.
    pub flags: Vec<String>,
    /// Whether 1 is an answer of it.
    pub answers: bool,
}

impl Call {
    /// The words of it.
    pub fn words(&self) -> Vec<String> {
        self.line.split(' ').map(str::to_owned).collect()
    }

    /// The tool.
    pub fn tool(&self) -> &'static str {
        self.line.split(' ').next().unwrap_or_default()
    }
}

const LINES: [(f64, &str); 50] = [
    (2.0, "gl-sample -p params.txt -n 20 --seed 3 --method sobol -o out.txt"),
    (1.0, "gl-sample -p effects-params.txt -n auto --effects switch -o out.txt"),
    (3.0, "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o out.txt --status status.txt"),
    (1.0, "gl-collect -s samples.txt -b obs.txt -c x -v y packed --rtol 1e-3 --max-failed 1"),
    (3.0, "gl-likelihood -b obs.txt -c x -v y ensemble.txt -o out.txt --scale range --weights y=0.3"),
    (2.0, "gl-likelihood -b obs.txt -c x -v y --noise y=0.3 --sigma 2 --steps 1:9 predicted-runs.txt"),
    (
        3.0,
        "gl-filter -s samples.txt -p params.txt misfit.txt -o out.txt --summary s.txt --history h.txt --step-weights w.txt",
    ),
    (
        2.0,
        "gl-filter -s samples.txt -p params.txt --sigma-min noise --ess-runs 4 --proposal prior misfit.txt --verdict v.txt",
    ),
    (
        1.0,
        "gl-filter -s samples.txt -s next.txt --proposal prior --proposal proposal.txt -p params.txt both-misfit.txt -o out.txt",
    ),
    (2.0, "gl-predict -w weights.txt ensemble.txt -o out.txt"),
    (2.0, "gl-gmm-resample -p params.txt -n 8 --components 2 weights.txt -o out.txt --proposal-out p.txt"),
    (1.0, "gl-gmm-resample -p params.txt -n 8 --sampling mixture --covariance tied weights.txt"),
    (
        2.0,
        "gl-check-stop --sigma-tol 0.1 --error-tol 0.1 --iteration 1 --previous summary.txt summary.txt -o out.txt",
    ),
    (2.0, "gl-emulate -p params.txt -s samples.txt --at next.txt ensemble.txt -o out.txt"),
    (1.0, "gl-emulate -p params.txt -s samples.txt --check -c x -v y ensemble.txt"),
    (1.0, "gl-emulate -p params.txt -s samples.txt --leave-one-out ensemble.txt"),
    (
        0.5,
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y -n 20 --noise y=0.3 ensemble.txt -o out.txt --summary s.txt --next 2 --next-out n.txt --run-weights r.txt --run-summary rs.txt --loo-out l.txt --verdict v.txt",
    ),
    (
        0.3,
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y -n 20 --scale range ensemble.txt -o out.txt",
    ),
    (2.0, "gl-gap-locate -b obs.txt -c x -v y -w weights.txt ensemble.txt -o out.txt --verdict v.txt"),
    (1.0, "gl-gap-locate -b obs.txt -c x -v y -w weights.txt --noise y=0.3 ensemble.txt"),
    (
        0.5,
        "gl-gap-attribute -p effects-params.txt -s effects-samples.txt -b effects-obs.txt -c x -v y --noise y=0.1 effects-runs.txt -o out.txt --effects-out e.txt --next-out n.txt --rest-out r.txt --curves-out c.txt --verdict v.txt --posterior-out p.txt --predict-shrink s.txt",
    ),
    (
        0.3,
        "gl-gap-attribute -p effects-params.txt -s effects-samples.txt -b effects-obs.txt -c x -v y --measurement offset,gain --max-effects 1 effects-runs.txt --self-check 1",
    ),
    (
        1.0,
        "gl-gap-shrink -b obs.txt -c x -v y --before ensemble.txt,weights.txt --after predicted-runs.txt,weights.txt -o out.txt",
    ),
    (
        1.0,
        "gl-gap-shrink -b obs.txt -c x -v y --noise y=0.3 --steps 2:9 --before predicted-runs.txt,weights.txt --after ensemble.txt,weights.txt --verdict v.txt",
    ),
    (2.0, "gl-box narrow -p params.txt weights.txt -o out.txt"),
    (2.0, "gl-box widen -p effects-params.txt --box box.txt effects-posterior.txt -o out.txt"),
    (
        1.0,
        "gl-plot fit -b obs.txt -c x -v y -w weights.txt --noise y=0.3 --units x=mm ensemble.txt -o out.svg",
    ),
    (
        1.0,
        "gl-plot posterior -w weights.txt -p params.txt --summary summary.txt --truth a=0.5,b=4 -o out.svg",
    ),
    (1.0, "gl-plot posterior -w step-weights.txt -p params.txt -o out.pdf"),
    (
        1.0,
        "gl-plot pairs -w weights.txt -s samples.txt -s next.txt -p params.txt --summary summary.txt -o out.svg",
    ),
    (1.0, "gl-plot history -p params.txt history.txt -o out.svg"),
    (1.0, "gl-plot history -p params.txt --summary summary.txt --summary summary.txt -o out.svg"),
    (1.0, "gl-plot proposal -s next.txt -p params.txt proposal.txt -o out.svg"),
    (1.0, "gl-plot emulator -e ensemble.txt predicted-runs.txt -o out.svg"),
    (1.0, "gl-plot gap -b obs.txt -e ensemble.txt -w weights.txt -c x --after gap.txt gap.txt -o out.svg"),
    (1.0, "gl-plot attribution --effects effects.txt attribution.txt -o out.svg"),
    (1.0, "gl-plot predictive -c x --units x=mm,y=N loo.txt -o out.svg"),
    (1.0, "gl-plot hypotheses -b effects-obs.txt --noise y=0.1 --units x=mm curves.txt -o out.svg"),
    (1.0, "gl-plot hypotheses --test one:effects-obs.txt:x:y:y=0.1 curves-of-tests.txt -o out.svg"),
    (0.5, "gl-report line --out made"),
    (1.0, "gl-import old new"),
    (1.0, "gl-contact -s contact-samples.txt -b contact-obs.txt -c u contact-runs"),
    (1.0, "gl-contact --curve E_m=9.3,nu=0.2,w=1 --noise f=0.005,t=0.002 -b contact-obs.txt -c u -o out.txt"),
    (1.0, "gl-triaxial -s triaxial-samples.txt --steps 12 triaxial-runs"),
    (1.0, "gl-check case"),
    (1.0, "gl-blind outcome -p effects-params.txt --answer truth.txt attribution.txt -o out.txt"),
    (1.0, "gl-run status samples.txt runs"),
    (1.0, "gl-blind truth -p effects-params.txt --seed 3 --specimens 2 -o out.txt"),
    (1.0, "gl-blind measure -c x -v y --noise y=0.1 ensemble.txt -o out.txt"),
    (1.0, "gl-triaxial --curve phi_c=32 --noise q=2 --seed 1 --steps 8 -o out.txt"),
];

const EFFECTS: &str = "name lower upper effect off\na 0 2 - -\nbend 0.1 2 bending 0\n";
const CASE: &str = "name = \"case\"\ncontrol = \"x\"\nobservables = [\"y\"]\nnoise = { y = 0.3 }\nnum = 20\niterations = 3\n\n[model]\nlocal = \"cat {a} {b}\"\n";

/// All tables that the calls read.
///
/// # Panics
/// If a tool does not make its table.
pub fn tables() -> Folder {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.run("gl-sample -p params.txt -n 14 -o samples.txt");
    line::simulate(&folder, "samples.txt", "runs");
    folder.run("gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt");
    folder.run("gl-run status samples.txt runs");
    let packed = pack(&folder, "runs", &folder.texts("samples.txt", "description"));
    folder.write("packed/all_packed.txt", packed);
    folder.run("gl-likelihood -b obs.txt -c x -v y ensemble.txt -o misfit.txt");
    folder.run("gl-filter -s samples.txt -p params.txt misfit.txt -o weights.txt --summary summary.txt --history history.txt --step-weights step-weights.txt");
    folder.run("gl-gmm-resample -p params.txt -n 10 --components 2 --iteration 1 weights.txt -o next.txt --proposal-out proposal.txt");
    line::ensemble(&folder, "next.txt", "obs.txt", "next-ensemble.txt");
    folder.run("gl-likelihood -b obs.txt -c x -v y next-ensemble.txt -o next-misfit.txt");
    let more = folder.read("next-misfit.txt");
    folder.write("both-misfit.txt", folder.read("misfit.txt") + more.split_once('\n').unwrap().1);
    folder.run("gl-emulate -p params.txt -s samples.txt --leave-one-out ensemble.txt -o predicted-runs.txt");
    folder.run("gl-gap-locate -b obs.txt -c x -v y -w weights.txt ensemble.txt -o gap.txt");
    effects(&folder);
    folder.write("old/iter0/line_Iter0_Sample0_sim.txt", "# x y\n0 5\n1 5.2\n2 5.4\n");
    folder.write("old/iter0/line_Iter0_Sample0_param.txt", "# a b\n.2 5\n");
    folder.write("old/iter0/line_Iter0_Sample1_sim.txt", "# x y\n0 5\n1 5.3\n2 5.6\n");
    folder.write("old/iter0/line_Iter0_Sample1_param.txt", "# a b\n.3 5\n");
    folder.write(
        "old/iter0/line_Iter0_Samples.txt",
        "description key a b \n line_Iter0_Sample0 0 .2 5 \n line_Iter0_Sample1 1 .3 5 \n",
    );
    folder.write("contact-samples.txt", "description key E_m nu\nc1 0 9.3 0.2\nc2 1 9.1 0.3\n");
    folder.write("contact-obs.txt", "u f t\n0 0 0\n1e-5 1 .1\n2e-5 2 .2\n1e-5 1 .1\n");
    folder.write("triaxial-samples.txt", "description key G0 phi_c\nt1 0 100 32\nt2 1 120 30\n");
    calibrated(&folder);
    folder.write("case/case.toml", CASE);
    folder.write("case/params.txt", line::PARAMS);
    folder.write("case/obs.txt", folder.read("obs.txt"));
    folder
}

/// A case that was calibrated, without its runs, which no page reads.
fn calibrated(folder: &Folder) {
    for file in ["case.toml", "params.txt", "obs.txt", "linear.awk"] {
        folder.write(&format!("line/{file}"), std::fs::read(example("linear").join(file)).unwrap());
    }
    folder.run("gl-calibrate line --out made num=12 iterations=1");
    std::fs::remove_dir_all(folder.path("made/iter0/runs")).unwrap();
    folder.write("loo.txt", folder.read("made/iter0/loo.txt"));
}

/// A line with a bend that the base model lacks, and what a diagnosis says of it.
fn effects(folder: &Folder) {
    folder.write("effects-params.txt", EFFECTS);
    folder.run("gl-sample -p effects-params.txt -n 24 --effects switch -o effects-samples.txt");
    let table = folder.table("effects-samples.txt");
    let numbers = |name: &str| table.numbers(name).unwrap();
    let (a, bend) = (numbers("a"), numbers("bend"));
    let mut runs = "sample step x y\n".to_owned();
    for (name, (a, bend)) in
        folder.texts("effects-samples.txt", "description").iter().zip(a.iter().zip(&bend))
    {
        for i in 0..10 {
            let x = f64::from(i);
            runs += &format!("{name} {i} {x} {}\n", a * x + bend * x * x / 10.0);
        }
    }
    folder.write("effects-runs.txt", runs);
    let reading = |x: f64| x + 0.1 * x * x + 0.1 * (9.0 * x).sin();
    let rows: String = (0..10).map(|x| format!("{x} {}\n", reading(f64::from(x)))).collect();
    folder.write("effects-obs.txt", format!("x y\n{rows}"));
    folder.write("box.txt", EFFECTS.replace("a 0 2", "a 0.5 1.5"));
    folder.write("truth.txt", "description key a bend\ntruth 0 1 1\n");
    folder.run("gl-gap-attribute -p effects-params.txt -s effects-samples.txt -b effects-obs.txt -c x -v y --noise y=0.1 effects-runs.txt -o attribution.txt --effects-out effects.txt --posterior-out effects-posterior.txt --curves-out curves.txt");
    folder.run("gl-gap-attribute -p effects-params.txt -s effects-samples.txt --test one:effects-obs.txt:x:y:y=0.1 one=effects-runs.txt -o ignored.txt --curves-out curves-of-tests.txt");
}

/// The calls, with the flags that each tool's `--help` has.
pub fn calls(folder: &Folder) -> Vec<Call> {
    let mut known: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let calls = LINES.iter().map(|&(weight, line)| {
        let mut words = line.split(' ');
        let tool = words.next().unwrap_or_default();
        let kind = words.next().filter(|_| matches!(tool, "gl-plot" | "gl-box" | "gl-blind" | "gl-run"));
        let call = kind.map_or(tool.to_owned(), |kind| format!("{tool} {kind}"));
        let flags =
            known.entry(call.clone()).or_insert_with(|| flags(&folder.stdout(&format!("{call} --help"))));
        let answers = matches!(tool, "gl-check-stop" | "gl-check")
            || line.starts_with("gl-box widen")
            || tool == "gl-blind";
        Call { line, weight, flags: flags.clone(), answers }
    });
    calls.collect()
}

/// The long flags of a help text that take a value.
fn flags(help: &str) -> Vec<String> {
    let flags = help.lines().filter_map(|line| {
        let line = line.trim_start();
        let long = line.strip_prefix("-").filter(|_| line.contains("--"))?;
        let long = long.split_once("--").or_else(|| long.strip_prefix('-').map(|rest| ("", rest)))?.1;
        let (name, rest) = long.split_once([' ', '='])?;
        rest.starts_with('<').then(|| format!("--{name}"))
    });
    flags.collect()
}
