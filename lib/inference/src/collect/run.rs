use super::{Collection, Failure};
use crate::alignment::align;
use crate::samples::Samples;
use gl_table::{Format, Rows, parse_number};

impl Collection<'_> {
    /// A run at the steps of the measurement, shape (observables, steps), from what is in its two files.
    pub(super) fn run_of(
        &self,
        samples: &Samples,
        i: usize,
        parameters: Option<&[u8]>,
        simulation: &[u8],
    ) -> Result<Vec<Vec<f64>>, Failure> {
        let name = &samples.names[i];
        let Some(parameters) = parameters else {
            return Err(Failure::Missing(format!("no {name}_param.txt")));
        };
        self.check_parameters(&format!("{name}_param.txt"), parameters, samples, i)?;
        self.curves(&format!("{name}_sim.txt"), simulation)
    }

    /// Compare the parameters that the run wrote down with the table's.
    fn check_parameters(&self, file: &str, bytes: &[u8], samples: &Samples, i: usize) -> Result<(), Failure> {
        let mut rows = Rows::new(file, bytes).map_err(malformed)?;
        let format = rows.format().clone();
        let Some((_, fields)) = rows.next_row().map_err(malformed)? else {
            return Err(Failure::Parameters(format!("{file} has no row")));
        };
        for (name, &expected) in samples.parameters.iter().zip(&samples.values[i]) {
            let column = format.find(name).map_err(malformed)?;
            let Some(column) = column else {
                return Err(Failure::Parameters(format!("{file} has no column {name}")));
            };
            let close = |value: f64| (value - expected).abs() <= self.rtol * value.abs().max(expected.abs());
            if !fields[column].parse::<f64>().is_ok_and(close) {
                let problem = format!("{name} is {}, not {expected} as in the table", fields[column]);
                return Err(Failure::Parameters(problem));
            }
        }
        Ok(())
    }

    fn curves(&self, file: &str, bytes: &[u8]) -> Result<Vec<Vec<f64>>, Failure> {
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return Err(Failure::Empty);
        }
        let mut rows = Rows::new(file, bytes).map_err(malformed)?;
        let format = rows.format().clone();
        let find = |name: &str| format.column(name).map_err(malformed);
        let mut columns = vec![find(&self.control)?];
        for name in &self.observables {
            columns.push(find(name)?);
        }
        // A number that was cut off is still a number: only the missing line end tells.
        if !bytes.ends_with(b"\n") {
            return Err(Failure::Truncated(
                "no line end after the last row, which may be cut off".to_owned(),
            ));
        }
        let mut values = vec![Vec::new(); columns.len()];
        let mut row = Vec::new();
        loop {
            if rows.next_numbers(&mut row).is_some() {
                for (values, &column) in values.iter_mut().zip(&columns) {
                    values.push(row[column]);
                }
                row.clear();
                continue;
            }
            match rows.next_row() {
                Ok(None) => break,
                Ok(Some((line, fields))) => {
                    for (values, &column) in values.iter_mut().zip(&columns) {
                        values.push(number(&format, line, column, fields[column])?);
                    }
                }
                Err(error) => return Err(malformed(error)),
            }
        }
        let control = values.remove(0);
        if control.is_empty() {
            return Err(Failure::Empty);
        }
        align(&self.observations.control, &control, &values, self.end_tolerance)
    }
}

fn number(format: &Format, line: usize, column: usize, field: &str) -> Result<f64, Failure> {
    parse_number(field).map_err(|problem| {
        let detail = format!("{}:{line}: column {}: {problem}", format.source(), format.columns()[column]);
        if field.parse::<f64>().is_ok() { Failure::NonFinite(detail) } else { Failure::Malformed(detail) }
    })
}

fn malformed(error: anyhow::Error) -> Failure {
    Failure::Malformed(format!("{error:#}"))
}
