/// A place in a table whose rows are written as [`TableWriter`](super::TableWriter) writes them, so
/// that they need not be split into fields first.
///
/// Every step goes on only if what follows is just what was asked for. Else the row is one for
/// [`Format::split`](super::Format::split), which knows all other ways to write a row, and what is
/// wrong with it.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    /// Begin at the start of a text.
    pub fn new(text: &'a str) -> Self {
        Self { rest: text.as_bytes() }
    }

    /// What is still to come.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Go past `text`.
    #[inline]
    pub fn skip(&mut self, text: &[u8]) -> Option<()> {
        self.rest = self.rest.strip_prefix(text)?;
        Some(())
    }

    /// Go past a finite number and the byte `end` after it.
    #[inline]
    pub fn number(&mut self, end: u8) -> Option<f64> {
        let (value, length) = fast_float2::parse_partial::<f64, _>(self.rest).ok()?;
        if !value.is_finite() || *self.rest.get(length)? != end {
            return None;
        }
        self.rest = &self.rest[length + 1..];
        Some(value)
    }

    /// Go past a count and the byte `end` after it.
    #[inline]
    pub fn count(&mut self, end: u8) -> Option<usize> {
        let length = self.rest.iter().take(10).position(|byte| !byte.is_ascii_digit())?;
        if length == 0 || self.rest[length] != end {
            return None;
        }
        let value = self.rest[..length].iter().fold(0, |value, digit| 10 * value + usize::from(digit - b'0'));
        self.rest = &self.rest[length + 1..];
        Some(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_goes_on_only_where_it_finds_what_was_asked_for() {
        let mut cursor = Cursor::new("run\t12\t-1.5e-3\t0.1\n");
        assert_eq!((cursor.skip(b"ruin\t"), cursor.skip(b"run\t")), (None, Some(())));
        assert_eq!((cursor.count(b'\n'), cursor.count(b'\t')), (None, Some(12)));
        assert_eq!((cursor.number(b'\n'), cursor.number(b'\t')), (None, Some(-1.5e-3)));
        assert_eq!((cursor.number(b'\n'), cursor.rest()), (Some(0.1), &b""[..]));
        assert_eq!((cursor.number(b'\n'), cursor.count(b'\n')), (None, None));
    }

    #[test]
    fn infinities_and_words_are_no_numbers() {
        for text in ["inf\n", "NaN\n", "1e999\n", "-\n", "\n", "1 \n", "1"] {
            assert_eq!(Cursor::new(text).number(b'\n'), None, "{text:?}");
        }
        for text in ["-1\n", "\n", "1.0\n", "12345678901\n", "1"] {
            assert_eq!(Cursor::new(text).count(b'\n'), None, "{text:?}");
        }
    }
}
