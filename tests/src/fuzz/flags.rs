//! Flags, spoilt.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use super::calls::Call;
use super::tables::FIELDS;

const NUMBERS: [&str; 24] = [
    "0",
    "1",
    "2",
    "3",
    "-1",
    "-0",
    "0.5",
    "1e-9",
    "5e-324",
    "1e18",
    "1e308",
    "1e200",
    "1e-200",
    "Inf",
    "nan",
    "-Inf",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "1000000000",
    "100000",
    "0:99",
    "5:5",
];
const WORDS: [&str; 14] = [
    "",
    " ",
    "a b",
    ",",
    "y,",
    "y,y",
    "y=1,y=2",
    "x",
    "y=",
    "=y",
    "offset,offset",
    "nowhere/x",
    "-",
    "noise",
];

/// Replace a value, repeat a name, or add a flag that the tool has.
pub fn spoil(rng: &mut ChaCha8Rng, call: &Call, words: &mut Vec<String>) {
    for _ in 0..rng.random_range(1..3) {
        let values: Vec<usize> = (2..words.len()).filter(|&i| words[i - 1].starts_with('-')).collect();
        if rng.random_bool(0.5) && !values.is_empty() {
            let place = *values.choose(rng).unwrap();
            let is_output =
                matches!(words[place - 1].as_str(), "-o" | "--output") || words[place - 1].ends_with("-out");
            words[place] = match rng.random_range(0..4) {
                0 => format!("{0},{0}", words[place]),
                // `NAME=VALUE` with another value.
                1 if words[place].contains('=') => {
                    let (name, _) = words[place].split_once('=').unwrap_or_default();
                    format!("{name}={}", NUMBERS.choose(rng).unwrap())
                }
                // A number in place of a name makes a file of that name.
                _ if is_output => (*["", "nowhere/out.txt", ".", "obs.txt"].choose(rng).unwrap()).to_owned(),
                _ => value(rng),
            };
        } else if let Some(flag) = call.flags.choose(rng).filter(|flag| *flag != "--output") {
            words.push(flag.clone());
            words.push(value(rng));
        }
    }
}

fn value(rng: &mut ChaCha8Rng) -> String {
    match rng.random_range(0..8) {
        0..=3 => (*NUMBERS.choose(rng).unwrap()).to_owned(),
        4 => format!("y={}", NUMBERS.choose(rng).unwrap()),
        5 => (*FIELDS.choose(rng).unwrap()).to_owned(),
        _ => (*WORDS.choose(rng).unwrap()).to_owned(),
    }
}
