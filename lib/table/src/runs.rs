use std::io::Read;
use std::str;

use anyhow::{Context, Result, anyhow, ensure};
use rayon::prelude::*;

use super::cursor::Cursor;
use super::read::{Format, next_line};

/// Something wrong in a piece of a table: at which of its lines, and what.
#[derive(Clone, Debug)]
pub struct Flaw {
    /// Line within the piece, from 1.
    pub line: usize,
    /// What was found, and what would be right.
    pub problem: String,
}

/// A table whose rows come run by run, read in blocks that hold whole runs and are worked on by all
/// cores: memory does not grow with the number of runs.
pub struct RunTable<'a> {
    input: &'a mut (dyn Read + Send),
    format: Format,
    key: usize,
    buffer: Vec<u8>,
    /// How much of the buffer is done with; the rest begins the next block.
    used: usize,
    /// Lines that are done with.
    lines: usize,
    ended: bool,
}

const BLOCK: usize = 2 << 20;

impl<'a> RunTable<'a> {
    /// Begin with the header; rows with the same field in the column `key` are one run.
    ///
    /// # Errors
    /// If there is no header, or no such column.
    pub fn new(source: &str, input: &'a mut (dyn Read + Send), key: &str) -> Result<Self> {
        let mut buffer = Vec::new();
        let mut ended = false;
        loop {
            let text = buffer.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&buffer);
            let start = text.iter().position(|byte| !byte.is_ascii_whitespace());
            let end =
                start.and_then(|start| memchr::memchr(b'\n', &text[start..]).map(|end| start + end + 1));
            if let (Some(start), Some(end)) = (start, end.or(ended.then_some(text.len()))) {
                let lines = memchr::memchr_iter(b'\n', &text[..start]).count() + 1;
                let header = str::from_utf8(&text[start..end])
                    .with_context(|| format!("{source}:{lines}: not UTF-8 text"))?;
                let format = Format::from_header(source, lines, header)?;
                let key = format.column(key)?;
                let used = buffer.len() - text.len() + end;
                return Ok(Self { input, format, key, buffer, used, lines, ended });
            }
            ensure!(!ended, "{source}: empty; a table begins with a line that names the columns");
            ended = !fill(source, input, &mut buffer, 1 << 16)?;
        }
    }

    /// Layout of the fields: source and column names.
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// Work on the table piece by piece. Each piece holds whole runs; `work` is called for several at
    /// a time, and `take` with the results in the order of the table.
    ///
    /// # Errors
    /// If the table cannot be read, or either of the two fails.
    pub fn for_each<T: Send>(
        mut self,
        work: impl Fn(&str, &Format) -> Result<T, Flaw> + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let mut block = Vec::new();
        while self.next_block()? {
            std::mem::swap(&mut block, &mut self.buffer);
            self.buffer.clear();
            self.buffer.extend_from_slice(&block[self.used..]);
            block.truncate(std::mem::take(&mut self.used));
            let pieces = self.pieces(&block, 4 * rayon::current_num_threads());
            let Self { input, format, buffer, lines, ended, .. } = &mut self;
            let source = format.source();
            // One core may wait for the disk while the others work.
            let read_ahead = || if *ended { Ok(false) } else { fill(source, *input, buffer, BLOCK) };
            let text = |piece: &&[u8]| match str::from_utf8(piece) {
                Ok(text) => work(text, format),
                Err(error) => {
                    let before = memchr::memchr_iter(b'\n', &piece[..error.valid_up_to()]).count();
                    Err(Flaw { line: before + 1, problem: "not UTF-8 text".to_owned() })
                }
            };
            let (results, is_more) =
                rayon::join(|| pieces.par_iter().map(text).collect::<Vec<_>>(), read_ahead);
            for (piece, result) in pieces.iter().zip(results) {
                take(result.map_err(|flaw| anyhow!("{source}:{}: {}", *lines + flaw.line, flaw.problem))?)?;
                *lines += memchr::memchr_iter(b'\n', piece).count();
            }
            *ended = !is_more?;
            ensure!(
                !*ended || !buffer.is_empty() || block.ends_with(b"\n"),
                "{source}:{}: the last line has no end: the table is cut off",
                *lines + 1
            );
        }
        Ok(())
    }

    /// Go on to the next block; false at the end of the table.
    fn next_block(&mut self) -> Result<bool> {
        self.buffer.drain(..std::mem::take(&mut self.used));
        loop {
            if self.ended {
                self.used = self.buffer.len();
                return Ok(self.used > 0);
            }
            if self.buffer.len() >= BLOCK {
                self.used = self.last_run_start();
                if self.used > 0 {
                    return Ok(true);
                }
            }
            // A run longer than a block makes the block longer.
            let more = BLOCK.max(self.buffer.len());
            self.ended = !fill(self.format.source(), self.input, &mut self.buffer, more)?;
        }
    }

    /// Where the last run in the buffer begins, of which more may follow; 0 if there is only one.
    fn last_run_start(&self) -> usize {
        let mut fields = Vec::new();
        let mut last: Option<String> = None;
        let mut start = memchr::memrchr(b'\n', &self.buffer).map_or(0, |end| end + 1);
        while start > 0 {
            let previous = memchr::memrchr(b'\n', &self.buffer[..start - 1]).map_or(0, |end| end + 1);
            match (self.run(&self.buffer[previous..start - 1], &mut fields), &last) {
                (Some(run), None) => last = Some(run.to_owned()),
                (Some(run), Some(last)) if run != last => return start,
                _ => {}
            }
            start = previous;
        }
        0
    }

    /// Cut a block into about `count` pieces between runs.
    fn pieces<'b>(&self, block: &'b [u8], count: usize) -> Vec<&'b [u8]> {
        let size = block.len() / count + 1;
        let mut pieces = Vec::with_capacity(count);
        let mut fields = Vec::new();
        let mut rest = block;
        while rest.len() > size {
            let Some(end) = memchr::memchr(b'\n', &rest[size..]) else { break };
            let mut end = size + end + 1;
            let mut cut: Option<&str> = None;
            while let Some(length) = memchr::memchr(b'\n', &rest[end..]) {
                match (self.run(&rest[end..end + length], &mut fields), cut) {
                    (Some(run), None) => cut = Some(run),
                    (Some(run), Some(cut)) if run != cut => break,
                    _ => {}
                }
                end += length + 1;
            }
            let (piece, after) = rest.split_at(end);
            pieces.push(piece);
            rest = after;
        }
        pieces.push(rest);
        pieces
    }

    /// The run that a line belongs to, if it is a row.
    fn run<'b>(&self, line: &'b [u8], fields: &mut Vec<&'b str>) -> Option<&'b str> {
        let line = str::from_utf8(line).ok()?;
        self.format.split_fields(line, fields).is_ok().then(|| fields[self.key])
    }
}

/// The rows of a piece, without blank lines and comments, with their lines within the piece.
#[derive(Clone, Debug)]
pub struct PieceRows<'a> {
    rest: &'a str,
    line: usize,
}

impl<'a> PieceRows<'a> {
    /// Begin with the first row.
    pub fn new(piece: &'a str) -> Self {
        Self::after(0, piece)
    }

    /// Begin with the row after line `line`.
    pub(crate) fn after(line: usize, rest: &'a str) -> Self {
        Self { rest, line }
    }

    /// Line of the last row that was taken.
    pub fn line(&self) -> usize {
        self.line
    }

    /// Take a row in by `read`, which ends after its line end, or leaves it alone.
    #[inline]
    pub fn plain<T>(&mut self, read: impl FnOnce(&mut Cursor<'a>) -> Option<T>) -> Option<T> {
        let mut cursor = Cursor::new(self.rest);
        let value = read(&mut cursor)?;
        self.rest = &self.rest[self.rest.len() - cursor.rest().len()..];
        self.line += 1;
        Some(value)
    }
}

impl<'a> Iterator for PieceRows<'a> {
    type Item = (usize, &'a str);

    fn next(&mut self) -> Option<Self::Item> {
        while let Some(line) = next_line(&mut self.rest) {
            self.line += 1;
            let start = line.trim_ascii_start();
            if !start.is_empty() && !start.starts_with('#') {
                return Some((self.line, line));
            }
        }
        None
    }
}

/// Read up to `more` bytes more; false at the end of the input.
fn fill(source: &str, input: &mut dyn Read, buffer: &mut Vec<u8>, more: usize) -> Result<bool> {
    let read =
        input.take(more as u64).read_to_end(buffer).with_context(|| format!("{source}: cannot be read"))?;
    Ok(read > 0)
}
