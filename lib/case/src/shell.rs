//! Words of a command line.

/// A word as a shell reads it.
///
/// ```
/// assert_eq!(gl_case::shell::quoted("it's"), r"'it'\''s'");
/// assert_eq!(gl_case::shell::quoted("q=0.1,e_v=2"), "q=0.1,e_v=2");
/// ```
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+%@{}".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
