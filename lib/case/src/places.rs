use std::collections::BTreeMap;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where each setting was given: by its path, such as `noise.f` or `observables.0`, a place such as
/// `case.toml:7` or `NOISE=f=0.1`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    source: String,
    by_path: BTreeMap<String, String>,
}

impl Places {
    /// The places in a document.
    pub(crate) fn of(source: &str, text: &str, table: &DeTable<'_>) -> Self {
        let mut places = Self { source: source.to_owned(), by_path: BTreeMap::new() };
        places.walk("", text, table);
        places
    }

    fn walk(&mut self, prefix: &str, text: &str, table: &DeTable<'_>) {
        for (key, value) in table {
            let path = format!("{prefix}{}", key.get_ref());
            self.by_path.insert(path.clone(), place(&self.source, text, key.span().start));
            match value.get_ref() {
                DeValue::Table(table) => self.walk(&format!("{path}."), text, table),
                DeValue::Array(values) => self.walk_array(&path, text, values.iter()),
                _ => {}
            }
        }
    }

    fn walk_array<'a, 'b: 'a>(
        &mut self,
        path: &str,
        text: &str,
        values: impl Iterator<Item = &'a Spanned<DeValue<'b>>>,
    ) {
        for (i, value) in values.enumerate() {
            self.by_path.insert(format!("{path}.{i}"), place(&self.source, text, value.span().start));
            if let DeValue::Table(table) = value.get_ref() {
                self.walk(&format!("{path}.{i}."), text, table);
            }
        }
    }

    /// Everything below a path was given elsewhere.
    pub(crate) fn replace(&mut self, path: &str, place: &str) {
        let below = format!("{path}.");
        self.by_path.retain(|other, _| !other.starts_with(&below));
        self.by_path.insert(path.to_owned(), place.to_owned());
    }

    /// Where a setting was given, or what it is in; the case itself if it was not.
    pub fn of_setting(&self, path: &str) -> &str {
        let mut path = path;
        loop {
            if let Some(place) = self.by_path.get(path) {
                return place;
            }
            match path.rsplit_once('.') {
                Some((above, _)) => path = above,
                None => return &self.source,
            }
        }
    }
}

/// `case.toml:7`, from the place of a byte.
pub(crate) fn place(source: &str, text: &str, byte: usize) -> String {
    let before = text.get(..byte).unwrap_or(text);
    format!("{source}:{}", 1 + before.matches('\n').count())
}

/// What a name that is not known may have been meant to be: `did you mean noise?`, or all names after `else_say`.
pub fn suggestion<S: AsRef<str>>(name: &str, known: &[S], else_say: &str) -> String {
    let near = |other: &str| strsim::damerau_levenshtein(&name.to_lowercase(), &other.to_lowercase());
    let nearest = known.iter().map(AsRef::as_ref).min_by_key(|other| near(other));
    match nearest {
        // Two letters, or a third of the word, may be wrong.
        Some(other) if near(other) <= (name.chars().count() / 3).clamp(1, 2) => {
            format!("did you mean {other}?")
        }
        _ => {
            let names: Vec<&str> = known.iter().map(AsRef::as_ref).collect();
            format!("{else_say} {}", names.join(", "))
        }
    }
}
