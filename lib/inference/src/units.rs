//! Units of columns, for words and labels.

use std::str::FromStr;

use anyhow::{Context, Error, Result};

/// Units by column name, as in `q=MPa,u=mm`.
///
/// ```
/// let units: gl_inference::units::Units = "q=MPa,u=mm".parse().unwrap();
/// assert_eq!((units.get("u"), units.get("e")), (Some("mm"), None));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Units(Vec<(String, String)>);

impl Units {
    /// The unit of a column, if it is known.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(other, _)| other == name).map(|(_, unit)| unit.as_str())
    }
}

impl FromStr for Units {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let pairs = text.split(',').filter(|pair| !pair.is_empty()).map(|pair| {
            let (name, unit) = pair.split_once('=').with_context(|| format!("{pair:?} is not NAME=UNIT"))?;
            Ok((name.trim().to_owned(), unit.trim().to_owned()))
        });
        Ok(Self(pairs.collect::<Result<_>>()?))
    }
}
