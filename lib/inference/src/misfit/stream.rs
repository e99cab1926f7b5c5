use std::io::{Read, Write};

use anyhow::{Context, Result, ensure};

use super::{Comparison, RunMisfit};
use crate::ensemble::{CONTROL_TOLERANCE, Columns, PlainRows};
use crate::observations::range;
use gl_table::{Flaw, Format, PieceRows, RunTable, parse_number, push_number};

/// How the rows of both tables look.
struct Form {
    columns: Columns,
    /// Difference up to which a control value is the measurement's.
    tolerance: f64,
    plain: Option<PlainRows>,
    /// The step between two tabs, for each step that is compared.
    steps: Vec<Vec<u8>>,
    rows: MisfitRows,
}

/// What a piece of an ensemble gives.
struct Piece {
    /// Rows of the misfit table.
    rows: Vec<u8>,
    /// Runs whose misfit is beyond what a number can say.
    left_out: Vec<String>,
}

/// What the rows of a misfit table stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MisfitRows {
    /// A step of a run each.
    Steps,
    /// A whole run each: misfits summed and errors averaged over the steps, of which the last is named.
    Runs,
}

impl Comparison<'_> {
    /// Read an ensemble table and write the misfit table, `sample step misfit error readings expected`,
    /// a few megabytes at a time: memory does not grow with the number of runs.
    ///
    /// `readings` is the number of independent readings that a row stands for, so that their sum over
    /// a run says how many there are to estimate the noise from; 0 where the noise is known. There
    /// `expected` is a row's share of the misfit that this noise alone would make, else 0. Where the
    /// ensemble is an emulator's, `ignorance` follows: a row's share of [`RunMisfit::ignorance`].
    ///
    /// A run whose misfit is beyond what a number can say is left out. Returns the names of these.
    ///
    /// # Errors
    /// If the table cannot be read or written, a run does not have the steps of the measurement, or all runs
    /// are left out.
    pub fn stream(
        &self,
        source: &str,
        input: &mut (dyn Read + Send),
        output: &mut dyn Write,
        rows: MisfitRows,
    ) -> Result<Vec<String>> {
        let table = RunTable::new(source, input, "sample")?;
        let columns =
            Columns::find(table.format(), &self.observations.control_name, &self.observations.names)?;
        let form = Form {
            tolerance: CONTROL_TOLERANCE * range(&self.observations.control),
            plain: PlainRows::new(&self.observations.control, &columns, table.format()),
            columns,
            steps: self.steps.clone().map(|step| format!("\t{step}\t").into_bytes()).collect(),
            rows,
        };
        let more = if form.columns.sd.is_some() { "\tignorance" } else { "" };
        writeln!(output, "sample\tstep\tmisfit\terror\treadings\texpected{more}")
            .context("the misfits cannot be written")?;
        let (mut left_out, mut written) = (Vec::new(), 0);
        table.for_each(
            |piece, format| self.piece(piece, format, &form),
            |Piece { rows, left_out: more }| {
                left_out.extend(more);
                written += rows.len();
                output.write_all(&rows).context("the misfits cannot be written")
            },
        )?;
        ensure!(
            left_out.is_empty() || written > 0,
            "{source}: the misfit of every run is beyond what a number can say; are the noise, the scale and \
             the runs of a sensible size?"
        );
        Ok(left_out)
    }

    /// The misfit rows of a piece of an ensemble table that holds whole runs.
    fn piece(&self, piece: &str, format: &Format, form: &Form) -> Result<Piece, Flaw> {
        let columns = &form.columns;
        let m = columns.observables.len();
        let total = self.observations.steps();
        let (mut output, mut left_out) = (Vec::with_capacity(piece.len()), Vec::new());
        let mut fields = Vec::new();
        let (mut sample, mut last) = ("", 0);
        let (mut values, mut sds) = (Vec::with_capacity(m * total), Vec::new());
        let mut close = |sample: &str, values: &mut Vec<f64>, sds: &mut Vec<f64>, line: usize| {
            if values.len() != m * total {
                let steps = values.len() / m;
                let problem =
                    format!("sample {sample} ends after {steps} steps of {total}; is the table cut off?");
                return Err(Flaw { line, problem });
            }
            let misfit = self.run(values, columns.sd.as_ref().map(|_| sds.as_slice()));
            if misfit.is_finite() {
                self.write_rows(sample, &misfit, form, &mut output);
            } else {
                left_out.push(sample.to_owned());
            }
            values.clear();
            sds.clear();
            Ok(())
        };
        let mut rows = PieceRows::new(piece);
        loop {
            if last > 0
                && rows.plain(|row| form.plain.as_ref()?.read(row, sample, &mut values, &mut sds)).is_some()
            {
                last = rows.line();
                continue;
            }
            let Some((line, row)) = rows.next() else { break };
            let flaw = |problem: String| Flaw { line, problem };
            format.split_fields(row, &mut fields).map_err(flaw)?;
            let name = fields[columns.sample];
            if name != sample {
                if last > 0 {
                    close(sample, &mut values, &mut sds, last)?;
                }
                sample = name;
            }
            let step = values.len() / m;
            self.row(format, form, (step, line), &fields, (&mut values, &mut sds))?;
            last = line;
        }
        if last > 0 {
            close(sample, &mut values, &mut sds, last)?;
        }
        Ok(Piece { rows: output, left_out })
    }

    /// Take in the row of step `step`, with all that can be wrong with it.
    ///
    /// * `values`, `sds` — of its run so far, to which its own are added.
    fn row(
        &self,
        format: &Format,
        form: &Form,
        (step, line): (usize, usize),
        fields: &[&str],
        (values, sds): (&mut Vec<f64>, &mut Vec<f64>),
    ) -> Result<(), Flaw> {
        let (columns, total) = (&form.columns, self.observations.steps());
        let flaw = |problem: String| Flaw { line, problem };
        let name = fields[columns.sample];
        let value = |column: usize| {
            parse_number(fields[column])
                .map_err(|problem| flaw(format!("column {}: {problem}", format.columns()[column])))
        };
        if parse_number(fields[columns.step]).ok() != Some(step as f64) {
            let found = fields[columns.step];
            return Err(flaw(format!("column step: {found} where step {step} of {name} should follow")));
        }
        if step >= total {
            return Err(flaw(format!("step {step}, but {} has {total} rows", self.observations.source)));
        }
        let (at, expected) = (value(columns.control)?, self.observations.control[step]);
        if (at - expected).abs() > form.tolerance {
            return Err(flaw(format!(
                "column {}: {at}, but step {step} of {} is at {expected}; collect the runs with this measurement",
                self.observations.control_name, self.observations.source
            )));
        }
        for &column in &columns.observables {
            values.push(value(column)?);
        }
        for &column in columns.sd.iter().flatten() {
            let sd = value(column)?;
            if sd < 0.0 {
                let name = &format.columns()[column];
                return Err(flaw(format!("column {name}: {sd}, but a standard deviation is not negative")));
            }
            sds.push(sd);
        }
        Ok(())
    }

    fn write_rows(&self, sample: &str, run: &RunMisfit, form: &Form, output: &mut Vec<u8>) {
        let (readings, expected) =
            if self.covariance.is_noise { (0.0, run.expected) } else { (run.readings, 0.0) };
        let steps = run.misfit.len() as f64;
        let rows = if form.rows == MisfitRows::Runs { 1.0 } else { steps };
        let mut tail = Vec::new();
        push_number(&mut tail, readings / rows);
        tail.push(b'\t');
        push_number(&mut tail, expected / rows);
        if form.columns.sd.is_some() {
            tail.push(b'\t');
            push_number(&mut tail, run.ignorance / rows);
        }
        tail.push(b'\n');
        let mut write_row = |step: &[u8], misfit: f64, error: f64| {
            output.extend_from_slice(sample.as_bytes());
            output.extend_from_slice(step);
            push_number(output, misfit);
            output.push(b'\t');
            push_number(output, error);
            output.push(b'\t');
            output.extend_from_slice(&tail);
        };
        match (form.rows, form.steps.last()) {
            (MisfitRows::Runs, Some(last)) => {
                write_row(last, run.misfit.iter().sum(), run.error.iter().sum::<f64>() / steps);
            }
            _ => {
                for ((step, misfit), error) in form.steps.iter().zip(&run.misfit).zip(&run.error) {
                    write_row(step, *misfit, *error);
                }
            }
        }
    }
}
