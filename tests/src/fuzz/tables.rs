//! Tables, spoilt.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rand::Rng;
use rand::seq::{IndexedRandom, SliceRandom};
use rand_chacha::ChaCha8Rng;

/// What takes the place of a field. NaN and infinities are spelt as no tool of this project writes them, so that what
/// comes out is not what went in.
pub const FIELDS: [&str; 44] = [
    "nan",
    "Inf",
    "+inf",
    "infinity",
    "-Inf",
    "1e999",
    "1e308",
    "-1e308",
    "1.7976931348623157e308",
    "1e200",
    "-1e200",
    "1e155",
    "1e154",
    "1e100",
    "1e-100",
    "1e-200",
    "1e-308",
    "5e-324",
    "-5e-324",
    "-0",
    "0",
    "1",
    "-1",
    "2",
    "1e18",
    "18446744073709551615",
    "9223372036854775807",
    "4294967296",
    "0x10",
    "1_000",
    "1,5",
    "1e",
    "--",
    "-",
    "",
    "\"",
    "\"a b\"",
    "a b",
    "ü",
    "..",
    "#",
    "!incomplete",
    "step",
    "sample",
];

/// Spoil one of the files: its bytes, its fields, its rows or its columns.
pub fn spoil(rng: &mut ChaCha8Rng, name: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    let text = String::from_utf8_lossy(&files[name]).into_owned();
    let spoilt = match rng.random_range(0..12) {
        0 => bytes(rng, text.into_bytes()),
        1..=4 => fields(rng, &text).into_bytes(),
        5 | 6 => rows(rng, &text).into_bytes(),
        7..=9 => columns(rng, &text).into_bytes(),
        10 => ends(rng, &text),
        _ => return whole(rng, name, files),
    };
    files.insert(name.to_owned(), spoilt);
}

/// Bytes flipped, put in, cut off.
fn bytes(rng: &mut ChaCha8Rng, mut bytes: Vec<u8>) -> Vec<u8> {
    for _ in 0..rng.random_range(1..4) {
        let place = rng.random_range(0..bytes.len().max(1));
        match rng.random_range(0..4) {
            0 if place < bytes.len() => bytes[place] ^= 1 << rng.random_range(0..8),
            1 => bytes.insert(
                place.min(bytes.len()),
                *[0, 0xff, b'\t', b'\n', b'\r', b',', b' '].choose(rng).unwrap(),
            ),
            2 if place < bytes.len() => drop(bytes.remove(place)),
            _ => bytes.truncate(place),
        }
    }
    bytes
}

/// A word that is put into the place of a field.
fn word(rng: &mut ChaCha8Rng) -> String {
    match rng.random_range(0..12) {
        0 => "x".repeat(10_000),
        1 => format!("{:e}", 10f64.powf(rng.random_range(-308.0..308.0))),
        _ => (*FIELDS.choose(rng).unwrap()).to_owned(),
    }
}

/// Fields replaced, one, a few, or all below a name.
fn fields(rng: &mut ChaCha8Rng, text: &str) -> String {
    let mut table = Split::new(text);
    let (rows, columns) = table.size();
    let word = word(rng);
    match rng.random_range(0..5) {
        0 => {
            let column = rng.random_range(0..columns);
            for row in 1..rows {
                table.set(row, column, &word);
            }
        }
        1 => {
            let column = rng.random_range(0..columns);
            let factor = *[1e-300, 1e-100, -1.0, 0.0, 1e6, 1e100, 1e150, 1e300].choose(rng).unwrap();
            for row in 1..rows {
                if let Some(value) = table.get(row, column).and_then(|field| field.parse::<f64>().ok())
                    && (value * factor).is_finite()
                {
                    table.set(row, column, &(value * factor).to_string());
                }
            }
        }
        2 => table.set(0, rng.random_range(0..columns), &word),
        _ => {
            for _ in 0..rng.random_range(1..3) {
                table.set(rng.random_range(0..rows), rng.random_range(0..columns), &word);
            }
        }
    }
    table.join()
}

/// Rows dropped, repeated, cut, in another order, far too many.
fn rows(rng: &mut ChaCha8Rng, text: &str) -> String {
    let mut rows: Vec<String> = text.lines().map(str::to_owned).collect();
    let place = rng.random_range(0..rows.len().max(1)).min(rows.len().saturating_sub(1));
    if rows.is_empty() {
        return String::new();
    }
    match rng.random_range(0..9) {
        0 => drop(rows.remove(place)),
        1 => rows.insert(place, rows[place].clone()),
        2 => rows.truncate(place.max(1)),
        3 => rows.truncate(2),
        4 => rows[1..].shuffle(rng),
        5 => rows[1..].reverse(),
        6 => {
            for _ in 0..300 {
                rows.insert(place, rows[place].clone());
            }
        }
        7 => {
            let cut = rng.random_range(0..=rows[place].len());
            let row = String::from_utf8_lossy(&rows[place].as_bytes()[..cut]).into_owned();
            rows[place] = row;
        }
        _ => rows.insert(place, ["", "# x", "!incomplete", "\t\t", ",,"].choose(rng).unwrap().to_string()),
    }
    rows.join("\n") + "\n"
}

/// Columns in another order, taken away, twice, with another name; one of words put in.
fn columns(rng: &mut ChaCha8Rng, text: &str) -> String {
    let mut table = Split::new(text);
    let (_, columns) = table.size();
    let (one, other) = (rng.random_range(0..columns), rng.random_range(0..columns));
    let kind = rng.random_range(0..7);
    let name =
        *["other", "sample", "step", "weight", "control", "x_sd", "y_sd", "a", "key"].choose(rng).unwrap();
    for (row, fields) in table.rows.iter_mut().enumerate() {
        if one.max(other) >= fields.len() {
            continue;
        }
        match kind {
            0 | 1 => fields.swap(one, other),
            2 => drop(fields.remove(one)),
            3 => fields.insert(other, fields[one].clone()),
            4 if row == 0 => fields.swap(one, other),
            5 => fields.insert(one, if row == 0 { name.to_owned() } else { format!("w{row}") }),
            6 => fields.insert(one, if row == 0 { name.to_owned() } else { row.to_string() }),
            _ => {}
        }
    }
    table.join()
}

/// Other ends of lines and separators, a mark at the front, no end.
fn ends(rng: &mut ChaCha8Rng, text: &str) -> Vec<u8> {
    let spoilt = match rng.random_range(0..8) {
        0 => format!("\u{feff}{text}"),
        1 => text.replace('\n', "\r\n"),
        2 => text.replace('\n', "\r"),
        3 => text.trim_end().to_owned(),
        4 => text.replace(['\t', ' '], ","),
        5 => text.replace(['\t', ' '], "   "),
        6 => format!("# {text}"),
        _ => text.replacen('\n', "\n\n\u{0}\n", 1),
    };
    spoilt.into_bytes()
}

/// No file, an empty one, a folder, another table.
fn whole(rng: &mut ChaCha8Rng, name: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    match rng.random_range(0..4) {
        0 => drop(files.remove(name)),
        1 => drop(files.insert(name.to_owned(), Vec::new())),
        2 => {
            files.remove(name);
            files.insert(name.join("file"), Vec::new());
        }
        _ => {
            let others: Vec<Vec<u8>> = files.values().cloned().collect();
            files.insert(name.to_owned(), others.choose(rng).unwrap().clone());
        }
    }
}

/// A table as its fields.
struct Split {
    rows: Vec<Vec<String>>,
    separator: &'static str,
}

impl Split {
    fn new(text: &str) -> Self {
        let separator = if text.contains('\t') { "\t" } else { " " };
        let rows = text.lines().map(|line| line.split(separator).map(str::to_owned).collect()).collect();
        Self { rows, separator }
    }

    /// Rows with the header, columns of the widest; at least one of each.
    fn size(&self) -> (usize, usize) {
        (self.rows.len().max(1), self.rows.iter().map(Vec::len).max().unwrap_or(1).max(1))
    }

    fn get(&self, row: usize, column: usize) -> Option<&str> {
        self.rows.get(row)?.get(column).map(String::as_str)
    }

    fn set(&mut self, row: usize, column: usize, word: &str) {
        if let Some(field) = self.rows.get_mut(row).and_then(|row| row.get_mut(column)) {
            word.clone_into(field);
        }
    }

    fn join(&self) -> String {
        self.rows.iter().map(|row| row.join(self.separator) + "\n").collect()
    }
}
