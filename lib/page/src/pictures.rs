//! The pictures of a page, as gl-plot draws them.

use std::path::Path;

use anyhow::Result;
use gl_case::folders::CURVES;
use serde::Serialize;

use crate::calibration::Calibration;
use crate::case::{Case, Measured};
use crate::tools::Call;

/// A picture with what stands below it.
#[derive(Clone, Debug, Serialize)]
pub struct Picture {
    /// What it shows.
    pub caption: String,
    /// SVG for a page and for a phone.
    pub drawings: Vec<Drawing>,
    /// What draws it, as it would be typed.
    pub command: String,
}

/// A picture at a width.
#[derive(Clone, Debug, Serialize)]
pub struct Drawing {
    /// In millimetres.
    pub width: u32,
    /// SVG.
    pub svg: String,
}

/// Widths for a page and for a phone, in millimetres.
const WIDTHS: [u32; 2] = [170, 80];

/// Draw a picture at every width.
fn draw(caption: impl Into<String>, call: Call) -> Result<Picture> {
    let drawing = |width: u32| {
        let svg = call.clone().with(["--width".to_owned(), width.to_string()]).output()?;
        Ok(Drawing { width, svg: in_page(&svg, width) })
    };
    let drawings = WIDTHS.into_iter().map(drawing).collect::<Result<_>>()?;
    Ok(Picture { caption: caption.into(), drawings, command: call.to_string() })
}

/// Without the name space, which a page does not need, and the size, which the style sheet gives.
fn in_page(svg: &str, width: u32) -> String {
    let Some((head, rest)) = svg.split_once('>') else { return svg.to_owned() };
    let kept = |attribute: &&str| {
        !["xmlns=", "width=", "height="].iter().any(|name| attribute.trim_start().starts_with(name))
    };
    // Every attribute ends with a quotation mark; the first part has the name of the element before it.
    let attributes = head.trim_start_matches("<svg").split_inclusive("\" ").filter(kept);
    format!("<svg class=\"mm{width}\" {}>{rest}", attributes.collect::<String>().trim())
}

impl Calibration {
    /// The measurement and what the calibrated runs make of it.
    ///
    /// # Errors
    /// If gl-plot fails.
    pub fn fit(&self, case: &Case, caption: &str) -> Result<Picture> {
        let call = Call::new("gl-plot").with(["fit"]);
        let call = case.columns(call).option("--units", &case.units).file("-w", &self.weights_of_runs());
        // Of the steps that were compared alone there is no band over all of them.
        let curves = self.file(CURVES);
        let call =
            if curves.exists() && case.steps.is_empty() { call.file("--posterior", &curves) } else { call };
        draw(caption, case.ensembles(call, &self.folder))
    }

    /// Each reading against what the others predict of it, where that was found.
    ///
    /// # Errors
    /// If gl-plot fails.
    pub fn predictive(&self, case: &Case) -> Result<Option<Picture>> {
        let table = self.last().join("loo.txt");
        if !table.exists() {
            return Ok(None);
        }
        // Several tests may have a control each.
        let is_shared = case.measured().iter().all(|of| of.control == case.control);
        let control = if is_shared { case.control.as_str() } else { "" };
        let call = Call::new("gl-plot").with(["predictive"]).option("-c", control);
        let call = call.option("--units", &case.units).with([table.display().to_string()]);
        draw(
            "Each reading less the median of what the posterior without it predicts, noise included; and how many of \
             them lie how high in what is predicted. If all is right the bars are even, but for chance.",
            call,
        )
        .map(Some)
    }

    /// The posterior and how it came about.
    ///
    /// # Errors
    /// If gl-plot fails.
    pub fn pictures(&self, case: &Case) -> Result<Vec<Picture>> {
        let call = |kind: &str| Call::new("gl-plot").with([kind]).file("-p", &case.params);
        let weighed = |kind: &str| {
            call(kind).option("--truth", &case.truth).file("-w", &self.file("posterior-weights.txt"))
        };
        let with_samples = |call: Call| {
            self.iterations.iter().fold(call, |call, folder| call.file("-s", &folder.join("samples.txt")))
        };
        let mut pictures = vec![draw(
            if self.is_drawn {
                "The posterior of each parameter, closely."
            } else {
                "The weight of each run against each parameter, and the posterior below it, closely."
            },
            weighed("posterior").file("--summary", &self.file("posterior.txt")),
        )?];
        if self.varied().len() > 1 {
            pictures.push(draw(
                "The posterior of each pair. A slope is a combination that the data fix while its parts stay open.",
                with_samples(weighed("pairs")).with(["--close-up"]).file("--summary", &self.file("posterior.txt")),
            )?);
            pictures.push(draw("Where each iteration searched.", with_samples(weighed("pairs")))?);
        }
        let summaries = |call: Call| {
            self.iterations
                .iter()
                .fold(call, |call, folder| call.file("--summary", &folder.join("summary.txt")))
        };
        pictures.push(draw("From iteration to iteration.", summaries(call("history")))?);
        let steps = self.last().join("history.txt");
        if steps.exists() {
            pictures.push(draw(
                "From step to step of the measurement, in the last iteration.",
                call("history").with([steps.display().to_string()]),
            )?);
        }
        Ok(pictures)
    }
}

/// The gap along the measurement of each test, before and after.
///
/// # Errors
/// If gl-plot fails.
pub fn gaps(
    case: &Case,
    located: &Path,
    base: &Calibration,
    after: Option<(&Path, &Calibration)>,
) -> Result<Vec<Picture>> {
    let gap = |of: &Measured| {
        let mut call = Call::new("gl-plot").with(["gap"]).option("--of", &of.name).file("-b", &of.obs);
        call = call
            .option("-c", &of.control)
            .option("--noise", &of.noise)
            .option("--units", &case.units)
            .file("-e", &of.ensemble(&base.folder))
            .file("-w", &base.weights_of_runs());
        if let Some((located, after)) = after {
            call = call
                .file("--after", located)
                .file("--after-ensemble", &of.ensemble(&after.folder))
                .file("--after-weights", &after.weights_of_runs());
        }
        let caption = "The gap over its standard deviation along the measurement; stretches that stand out are shaded, with their share of it.";
        draw(of.captioned(caption), call.with([located.display().to_string()]))
    };
    case.measured().iter().map(gap).collect()
}

/// How probable each hypothesis and each effect is.
///
/// # Errors
/// If gl-plot fails.
pub fn attribution(effects: &Path, hypotheses: &Path) -> Result<Picture> {
    let call = Call::new("gl-plot").with(["attribution"]).file("--effects", effects);
    draw("How probable each hypothesis and each effect is.", call.with([hypotheses.display().to_string()]))
}

/// What each of the most probable hypotheses makes of the measurement, where their curves are known.
///
/// # Errors
/// If gl-plot fails.
pub fn hypotheses(case: &Case, curves: &Path) -> Result<Option<Picture>> {
    if !curves.exists() {
        return Ok(None);
    }
    let call = Call::new("gl-plot").with(["hypotheses"]);
    let call = if case.tests.is_empty() {
        call.file("-b", &case.obs).option("--noise", &case.noise)
    } else {
        case.columns(call)
    };
    let call = call.option("--units", &case.units);
    draw(
        "The base model and the most probable hypotheses, each by its mean curve over what remains possible, with its \
         probability; and what each leaves of the measurement.",
        call.with([curves.display().to_string()]),
    )
    .map(Some)
}

/// The emulator of a test against the runs of a design.
///
/// # Errors
/// If gl-emulate or gl-plot fails.
pub fn emulator(case: &Case, of: &Measured, design: &Path) -> Result<Picture> {
    let runs = of.ensemble(design);
    let columns = |call: Call| call.option("-c", &of.control).option("-v", &of.observables);
    let call = Call::new("gl-emulate")
        .file("-p", &design.join("params.txt"))
        .file("-s", &design.join("samples.txt"));
    let left_out = columns(call).with(["--leave-one-out"]).with([runs.display().to_string()]);
    let call = columns(Call::new("gl-plot").with(["emulator"])).option("--units", &case.units);
    draw(
        of.captioned("The emulator behind it: each run of the design, predicted from all the others."),
        call.file("-e", &runs).fed(&left_out)?,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_in_a_page_has_a_class_and_no_size() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" width=\"9mm\" height=\"5mm\" viewBox=\"0 0 9 5\" font-family=\"A, B\">\n<rect width=\"9\"/></svg>";
        assert_eq!(
            in_page(svg, 80),
            "<svg class=\"mm80\" role=\"img\" viewBox=\"0 0 9 5\" font-family=\"A, B\">\n<rect width=\"9\"/></svg>"
        );
    }
}
