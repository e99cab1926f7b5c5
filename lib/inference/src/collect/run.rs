use super::complete::{check_complete, malformed};
use super::{Collection, Failure};
use crate::alignment::align;
use crate::samples::Samples;
use gl_table::{Format, LARGEST, Rows, parse_number};

impl Collection<'_> {
    /// A run at the steps of the measurement, shape (observables, steps), from what is in its two files.
    pub(super) fn run_of(
        &self,
        samples: &Samples,
        i: usize,
        parameters: Option<&[u8]>,
        simulation: &[u8],
    ) -> Result<Vec<Vec<f64>>, Failure> {
        check_complete(samples, i, parameters, simulation, self.rtol)?;
        self.curves(&format!("{}_sim.txt", samples.names[i]), simulation)
    }

    fn curves(&self, file: &str, bytes: &[u8]) -> Result<Vec<Vec<f64>>, Failure> {
        let mut rows = Rows::new(file, bytes).map_err(malformed)?;
        let format = rows.format().clone();
        let find = |name: &str| format.column(name).map_err(malformed);
        let mut columns = vec![find(&self.control)?];
        for name in &self.observables {
            columns.push(find(name)?);
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
        for (name, values) in self.observables.iter().zip(&values) {
            if let Some(value) = values.iter().find(|value| value.abs() > LARGEST) {
                return Err(Failure::NonFinite(format!("{file}: column {name}: {value:e}: the run blew up")));
            }
        }
        let curves = align(&self.observations.control, &control, &values, self.end_tolerance)?;
        Ok(self.rig.recorded(curves))
    }
}

fn number(format: &Format, line: usize, column: usize, field: &str) -> Result<f64, Failure> {
    parse_number(field).map_err(|problem| {
        let detail = format!("{}:{line}: column {}: {problem}", format.source(), format.columns()[column]);
        if field.parse::<f64>().is_ok() { Failure::NonFinite(detail) } else { Failure::Malformed(detail) }
    })
}
