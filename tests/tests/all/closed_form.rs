//! The posterior from 20 000 runs by the tools, against the closed form in `tests/oracle`.

use gl_table::Table;
use pipelines::folder::Folder;
use pipelines::{line, oracle};

fn closed_form(data: &str, noise: &str, quantity: &str) -> f64 {
    let table = Table::read(&oracle("linear_posterior.tsv")).unwrap();
    let field = |row: usize, name: &str| table.field(row, table.format().column(name).unwrap()).to_owned();
    let is_it = |row: &usize| {
        field(*row, "data") == data && field(*row, "noise") == noise && field(*row, "quantity") == quantity
    };
    field((0..table.len()).find(is_it).unwrap(), "value").parse().unwrap()
}

/// The misfits of 20 000 samples of the prior; `noise` as for gl-likelihood.
fn calibrated(data: &str, noise: &str) -> Folder {
    let folder = Folder::default();
    for what in ["obs", "params"] {
        folder.link(&oracle(&format!("linear_posterior_{data}_{what}.txt")), &format!("{what}.txt"));
    }
    folder.run("gl-sample -p params.txt -n 20000 -o samples.txt");
    line::ensemble(&folder, "samples.txt", "obs.txt", "ensemble.txt");
    folder.run(&format!("gl-likelihood -b obs.txt -c x -v y {noise} ensemble.txt -o misfit.txt"));
    folder.run(
        "gl-filter -s samples.txt -p params.txt --sigma noise --summary summary.txt misfit.txt -o weights.txt",
    );
    folder
}

/// Within five Monte-Carlo standard errors: of a mean 1/√n of the sd, of an sd 1/√2n, of the 5 % quantile
/// √(0.05 · 0.95)/0.103 = 2.1 of the former (the density of a normal there is 0.103 a sd), of ln evidence
/// √(1/n − 1/N). The low-discrepancy samples are better than that.
fn assert_posterior(folder: &Folder, data: &str, noise: &str) {
    let n = folder.quantity("summary.txt", "ess_runs");
    assert!(n > 200.0, "{n}");
    let error = 5.0 / n.sqrt();
    for name in ["a", "b"] {
        let expected = |quantity: &str| closed_form(data, noise, &format!("{quantity}({name})"));
        let here = |quantity: &str| folder.quantity("summary.txt", &format!("{quantity}({name})"));
        let sd = expected("sd");
        for (quantity, tolerance) in [("mean", 1.0), ("sd", 0.71), ("q05", 2.1), ("q95", 2.1)] {
            let (found, expected) = (here(quantity), expected(quantity));
            assert!(
                (found - expected).abs() < tolerance * error * sd,
                "{data} {noise} {quantity}({name}): {found} is not {expected}, to {}",
                tolerance * error * sd
            );
        }
    }
}

#[test]
fn known_noise_gives_the_closed_form_and_its_evidence() {
    for data in ["few", "centred", "tutorial"] {
        let sd = closed_form(data, "known", "noise_sd");
        let folder = calibrated(data, &format!("--noise y={sd}"));
        assert_posterior(&folder, data, "known");
        // The likelihood is exp(−misfit/2), without the normalisation of the noise.
        let (found, expected) =
            (folder.quantity("summary.txt", "ln_evidence"), closed_form(data, "known", "ln_evidence_bare"));
        let error = 5.0 / folder.quantity("summary.txt", "ess_runs").sqrt();
        assert!(
            (found - expected).abs() < error,
            "{data} ln_evidence: {found} is not {expected}, to {error}"
        );
        assert_eq!(folder.quantity("summary.txt", "sigma"), 1.0);
    }
}

#[test]
fn unknown_noise_gives_the_closed_form_inside_the_bounds() {
    for data in ["few", "centred", "tutorial"] {
        let folder = calibrated(data, "--scale none");
        assert_posterior(&folder, data, "jeffreys_box");
        let n = closed_form(data, "known", "n");
        // ln ∫ p(M | s²) ds²/s² = ln Γ(n/2) − n/2 ln π − n/2 ln M, of which the tool gives the last term.
        let constant = statrs::function::gamma::ln_gamma(0.5 * n) - 0.5 * n * std::f64::consts::PI.ln();
        let (found, expected) = (
            folder.quantity("summary.txt", "ln_evidence") + constant,
            closed_form(data, "jeffreys_box", "ln_evidence"),
        );
        let error = 5.0 / folder.quantity("summary.txt", "ess_runs").sqrt();
        assert!(
            (found - expected).abs() < error,
            "{data} ln_evidence: {found} is not {expected}, to {error}"
        );
        // Mean of M/n over the posterior: M is inverse gamma … the noise's variance by least squares.
        let noise = folder.quantity("summary.txt", "sigma").sqrt();
        let (low, high) =
            (closed_form(data, "jeffreys", "q05(noise_sd)"), closed_form(data, "jeffreys", "q95(noise_sd)"));
        assert!((low..=high).contains(&noise), "{data}: the noise {noise} is not between {low} and {high}");
    }
}
