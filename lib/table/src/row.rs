//! From the fields of a row to a serde type, with errors that name the column.

use std::fmt;
use std::str::FromStr;

use csv::StringRecord;
use serde::de::value::{BorrowedStrDeserializer, MapAccessDeserializer, MapDeserializer};
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, IntoDeserializer, MapAccess, Visitor,
};
use serde::forward_to_deserialize_any;

use super::read::parse_number;

/// What is wrong with a row.
#[derive(Debug)]
pub struct Problem {
    column: Option<String>,
    text: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.column {
            Some(column) => write!(f, "column {column}: {}", self.text),
            None => f.write_str(&self.text),
        }
    }
}

impl std::error::Error for Problem {}

impl de::Error for Problem {
    fn custom<T: fmt::Display>(text: T) -> Self {
        Self { column: None, text: text.to_string() }
    }

    fn missing_field(field: &'static str) -> Self {
        Self { column: Some(field.to_owned()), text: "missing".to_owned() }
    }

    fn unknown_field(field: &str, known: &'static [&'static str]) -> Self {
        Self { column: None, text: format!("unknown column {field}; the table has {}", known.join(", ")) }
    }
}

/// The fields of one row, by the names of their columns.
pub struct Fields<'a> {
    columns: &'a [String],
    record: &'a StringRecord,
    next: usize,
}

impl<'a> Fields<'a> {
    pub fn new(columns: &'a [String], record: &'a StringRecord) -> Self {
        Self { columns, record, next: 0 }
    }
}

impl<'de> Deserializer<'de> for Fields<'de> {
    type Error = Problem;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        MapAccessDeserializer::new(self).deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map struct enum identifier ignored_any
    }
}

impl<'de> MapAccess<'de> for Fields<'de> {
    type Error = Problem;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Problem> {
        let Some(name) = self.columns.get(self.next) else { return Ok(None) };
        seed.deserialize(BorrowedStrDeserializer::new(name)).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Problem> {
        let place = self.next;
        self.next += 1;
        seed.deserialize(Field(Some(&self.record[place])))
            .map_err(|problem| Problem { column: Some(self.columns[place].clone()), ..problem })
    }
}

/// One field: a finite number, a text, or `-` for nothing; without a text, a value as the type likes it.
#[derive(Clone, Copy)]
struct Field<'a>(Option<&'a str>);

impl<'a> Field<'a> {
    /// What `read` makes of the text, `any` where there is none.
    fn value<T>(self, any: T, read: impl FnOnce(&'a str) -> Result<T, String>) -> Result<T, Problem> {
        self.0.map_or(Ok(any), |text| read(text).map_err(de::Error::custom))
    }

    /// A whole number.
    fn whole<T: FromStr>(self, any: T) -> Result<T, Problem> {
        self.value(any, |text| text.parse().map_err(|_| format!("{text:?} is not a whole number")))
    }
}

impl<'de> IntoDeserializer<'de, Problem> for Field<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Field<'de> {
    type Error = Problem;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_borrowed_str(self.0.unwrap_or("-"))
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_f64(self.value(1.0, |text| parse_number(text).map_err(|problem| problem.to_string()))?)
    }

    fn deserialize_u64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_u64(self.whole(1)?)
    }

    fn deserialize_i64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_i64(self.whole(1)?)
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_bool(self.value(true, |text| match text {
            "yes" => Ok(true),
            "no" => Ok(false),
            other => Err(format!("{other:?} is neither yes nor no")),
        })?)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        if matches!(self.0, None | Some("-" | "")) { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        let variant = self.value(variants[0], |text| match variants.contains(&text) {
            true => Ok(text),
            false => Err(format!("{text:?} is none of {}", variants.join(", "))),
        })?;
        visitor.visit_enum(variant.into_deserializer())
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Problem> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        i8 i16 i32 i128 u8 u16 u32 u128 f32 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

/// The first column that a type needs and that is not there: known even where a table has no rows.
pub fn missing_column<T: DeserializeOwned>(has: impl Fn(&str) -> bool) -> Option<String> {
    T::deserialize(Probe { has, names: &mut [].as_slice() }).err().and_then(|problem| problem.column)
}

/// The names of the columns of a type, in order.
pub fn columns_of<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut names = [].as_slice();
    // What it would say of a value does not matter.
    let _ = T::deserialize(Probe { has: |_: &str| true, names: &mut names });
    names
}

/// Deserialises a type from nothing but the names of its columns: every value is as the type likes it.
struct Probe<'n, H> {
    has: H,
    names: &'n mut &'static [&'static str],
}

impl<'de, H: Fn(&str) -> bool> Deserializer<'de> for Probe<'_, H> {
    type Error = Problem;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Problem> {
        Err(de::Error::custom("a row is a struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        *self.names = names;
        let there = names.iter().filter(|name| (self.has)(name)).map(|name| (*name, Field(None)));
        visitor.visit_map(MapDeserializer::new(there))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}
