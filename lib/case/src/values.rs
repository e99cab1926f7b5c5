//! Values of settings, each refused with what would be right.

use std::num::NonZeroUsize;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use toml::Value;

/// A whole number from 1.
pub(crate) fn count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<NonZeroUsize>, D::Error> {
    match Value::deserialize(deserializer)? {
        Value::Integer(n) if n > 0 => Ok(usize::try_from(n).ok().and_then(NonZeroUsize::new)),
        other => Err(D::Error::custom(format!("{other} where a whole number from 1 is needed"))),
    }
}

/// A whole number from 0.
pub(crate) fn whole<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u64>, D::Error> {
    match Value::deserialize(deserializer)? {
        Value::Integer(n) if n >= 0 => Ok(u64::try_from(n).ok()),
        other => Err(D::Error::custom(format!("{other} where a whole number from 0 is needed"))),
    }
}

fn number<'de, D: Deserializer<'de>>(
    deserializer: D,
    is_right: impl Fn(f64) -> bool,
    what: &str,
) -> Result<Option<f64>, D::Error> {
    let value = Value::deserialize(deserializer)?;
    as_number(&value)
        .filter(|number| is_right(*number))
        .map(Some)
        .ok_or_else(|| D::Error::custom(format!("{value} where {what} is needed")))
}

fn as_number(value: &Value) -> Option<f64> {
    #[allow(clippy::cast_precision_loss)]
    match value {
        Value::Integer(n) => Some(*n as f64),
        Value::Float(x) if x.is_finite() => Some(*x),
        _ => None,
    }
}

/// A number from 0 to 1.
pub(crate) fn share<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    number(deserializer, |x| (0.0..=1.0).contains(&x), "a number from 0 to 1")
}

/// A number that is not negative.
pub(crate) fn not_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    number(deserializer, |x| x >= 0.0, "a number from 0")
}

/// Numbers above zero by name, in the order in which they are given.
pub(crate) fn positive_by_name<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Vec<(String, f64)>>, D::Error> {
    by_name(deserializer, |x| x > 0.0, "a number above 0").map(Some)
}

/// Numbers by name, in the order in which they are given.
pub(crate) fn numbers_by_name<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Vec<(String, f64)>>, D::Error> {
    by_name(deserializer, |_| true, "a number").map(Some)
}

fn by_name<'de, D: Deserializer<'de>>(
    deserializer: D,
    is_right: impl Fn(f64) -> bool,
    what: &str,
) -> Result<Vec<(String, f64)>, D::Error> {
    let rows = rows(deserializer, "numbers by name, such as { f = 0.02 }")?;
    let number = |(name, value): (String, Value)| match as_number(&value).filter(|x| is_right(*x)) {
        Some(number) => Ok((name, number)),
        None => Err(D::Error::custom(format!("{name} = {value} where {what} is needed"))),
    };
    rows.into_iter().map(number).collect()
}

/// Texts by name, in the order in which they are given.
pub(crate) fn texts_by_name<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Vec<(String, String)>>, D::Error> {
    let rows = rows(deserializer, "texts by name, such as { f = \"N\" }")?;
    let text = |(name, value): (String, Value)| match value {
        Value::String(text) => Ok((name, text)),
        other => Err(D::Error::custom(format!("{name} = {other} where a text in quotes is needed"))),
    };
    rows.into_iter().map(text).collect::<Result<_, _>>().map(Some)
}

fn rows<'de, D: Deserializer<'de>>(
    deserializer: D,
    expected: &'static str,
) -> Result<Vec<(String, Value)>, D::Error> {
    struct Rows(&'static str);

    impl<'de> Visitor<'de> for Rows {
        type Value = Vec<(String, Value)>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str(self.0)
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            let mut rows = Vec::new();
            while let Some(row) = map.next_entry()? {
                rows.push(row);
            }
            Ok(rows)
        }
    }

    deserializer.deserialize_map(Rows(expected))
}

/// One of some words.
pub(crate) fn word<'de, D: Deserializer<'de>>(
    deserializer: D,
    words: &[&'static str],
) -> Result<Option<String>, D::Error> {
    match Value::deserialize(deserializer)? {
        Value::String(text) if words.contains(&text.as_str()) => Ok(Some(text)),
        other => Err(D::Error::custom(format!("{other} where one of {} is needed", words.join(", ")))),
    }
}
