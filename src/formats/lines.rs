//! Lines of a text file, one at a time.

use crate::error::{Error, Result};
use crate::formats::Input;
use std::fmt::Display;
use std::io::{BufRead, Read};
use std::str::FromStr;

/// Maximum length of a line: a bound on memory for files without line breaks.
const MAX_LINE: u64 = 1 << 16;

/// Reader of lines. It never reads more than the length of the file at its opening.
pub(super) struct Lines<'a> {
    format: &'static str,
    /// Name of the file, for the log.
    pub name: String,
    input: Box<dyn BufRead + Send + 'a>,
    /// The line, without the line break.
    pub line: Vec<u8>,
    /// Number of the line, from 1.
    pub number: u64,
    /// Bytes after the line.
    pub left: u64,
    /// Maximum length of a line.
    longest: u64,
}

impl<'a> Lines<'a> {
    /// Starts before the first line of a file.
    ///
    /// # Errors
    ///
    /// The file is compressed.
    pub fn new(format: &'static str, mut input: Input<'a>) -> Result<Self> {
        let magic: [(&[u8], &str); 3] = [
            (b"\x1f\x8b", "gunzip"),
            (b"\x28\xb5\x2f\xfd", "unzstd"),
            (b"BZh", "bunzip2"),
        ];
        let start = input.bytes.fill_buf()?;
        if let Some((_, tool)) = magic.iter().find(|(magic, _)| start.starts_with(magic)) {
            let what = format!("compressed files; decompress it first (`{tool}`)");
            return Err(Error::unsupported(format, what));
        }
        Ok(Self {
            format,
            name: input.name,
            input: input.bytes,
            line: Vec::new(),
            number: 0,
            left: input.len,
            longest: MAX_LINE,
        })
    }

    /// Allows lines of any length.
    pub fn with_long_lines(mut self) -> Self {
        self.longest = u64::MAX;
        self
    }

    /// Steps to the next line; false at the end of the file.
    pub fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        self.append()
    }

    /// Appends the next line; false at the end of the file.
    pub fn append(&mut self) -> Result<bool> {
        let start = self.line.len();
        let mut input = (&mut self.input).take(self.longest.min(self.left));
        let read = input.read_until(b'\n', &mut self.line)?;
        self.left -= read as u64;
        self.number += 1;
        if self.line[start..].contains(&0) {
            return Err(self.bad("a byte is 0, so the file is damaged or is not a text file"));
        }
        if self.line.last() == Some(&b'\n') {
            self.line.pop();
        } else if read as u64 == self.longest {
            let start = quote(&self.line);
            return Err(self.bad(format_args!("{start}.. is longer than {read} bytes")));
        }
        Ok(read > 0)
    }

    /// Steps to the next line that is not empty; false at the end of the file.
    pub fn advance_to_text(&mut self) -> Result<bool> {
        while self.advance()? {
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Steps to the next line, which the file must have.
    pub fn expect(&mut self, expected: impl Display) -> Result<()> {
        match self.advance()? {
            true => Ok(()),
            false => Err(self.bad(format_args!("the file ends, expected {expected}"))),
        }
    }

    /// Parses the line. Errors name it.
    pub fn parse<T>(&self, parse: impl FnOnce(&[u8]) -> Result<T, String>) -> Result<T> {
        parse(&self.line).map_err(|what| self.bad(what))
    }

    /// Checks that the rest of the file has room for so many lines of at least `bytes` bytes. (The
    /// last one may lack its line break.)
    pub fn check_room(&self, lines: u64, bytes: u64, what: &str) -> Result<()> {
        let least = u128::from(lines) * u128::from(bytes);
        if least > u128::from(self.left) + 1 {
            let left = self.left;
            return Err(self.bad(format_args!("{lines} {what}, too many for {left} bytes")));
        }
        Ok(())
    }

    /// Creates an error that names the line.
    pub fn bad(&self, what: impl Display) -> Error {
        Error::format(self.format, format_args!("line {}", self.number), what)
    }
}

/// Returns the words of a text.
pub(super) fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    words_between(text, u8::is_ascii_whitespace)
}

/// Returns the words of a text between these characters.
pub(super) fn words_between(
    text: &[u8],
    is_between: impl Fn(&u8) -> bool,
) -> impl Iterator<Item = &[u8]> {
    text.split(is_between).filter(|word| !word.is_empty())
}

/// Parses a word as an integer, or returns an error text.
pub(super) fn integer<T: FromStr>(word: &[u8], expected: impl Display) -> Result<T, String> {
    let parsed = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
    parsed.ok_or_else(|| format!("{}, expected {expected}", quote(word)))
}

/// Parses a decimal number. Its exponent may begin with D, as Fortran writes it.
pub(super) fn parsed(token: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(token).ok()?;
    let number = text.parse().ok();
    number.or_else(|| text.replace(['D', 'd'], "e").parse().ok())
}

/// Parses a finite decimal number, or returns an error text.
pub(super) fn number(token: &[u8]) -> Result<f64, String> {
    match parsed(token) {
        Some(x) if x.is_finite() => Ok(x),
        Some(_) => Err(format!("{} is not a finite number", quote(token))),
        None => Err(format!("{}, expected a number", quote(token))),
    }
}

/// Returns true if a list of words has this one.
pub(super) fn is_in(list: &str, word: &str) -> bool {
    list.split(' ').any(|known| known == word)
}

/// Quotes a part of a file for a message: short, and with control characters escaped.
pub(super) fn quote(token: &[u8]) -> String {
    const SHOWN: usize = 40;
    let head = &token[..token.len().min(4 * SHOWN)];
    let text = String::from_utf8_lossy(head);
    let shown = text.chars().take(SHOWN).flat_map(char::escape_debug);
    let text: String = shown.collect();
    format!("'{text}'")
}
