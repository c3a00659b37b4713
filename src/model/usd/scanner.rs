//! Characters and words of a text file, read in chunks.

use super::FORMAT;
use super::input::Input;
use super::layer::WORD_BYTES;
use crate::error::{Error, Result};
use crate::model::quote;
use std::io::{Read, Seek};

/// Number of bytes read at once.
const CHUNK: u64 = 1 << 16;

/// Part of characters in values.
#[derive(Clone, Copy)]
enum Class {
    Plain,
    Open,
    Close,
    /// Begins something that may contain brackets.
    Other,
}

const CLASSES: [Class; 256] = {
    let mut classes = [Class::Plain; 256];
    let pairs = b"([{";
    let mut k = 0;
    while k < pairs.len() {
        classes[pairs[k] as usize] = Class::Open;
        classes[b")]}"[k] as usize] = Class::Close;
        k += 1;
    }
    let others = b"\"'@<#/";
    k = 0;
    while k < others.len() {
        classes[others[k] as usize] = Class::Other;
        k += 1;
    }
    classes
};

/// A position in a text file.
#[derive(Debug)]
pub(super) struct Scanner<R> {
    input: Input<R>,
    chunk: Vec<u8>,
    /// Position of the chunk in the file.
    start: u64,
    /// Position in the chunk.
    at: usize,
}

impl<R: Read + Seek> Scanner<R> {
    pub fn new(input: Input<R>) -> Self {
        Self {
            input,
            chunk: Vec::new(),
            start: 0,
            at: 0,
        }
    }

    pub fn position(&self) -> u64 {
        self.start + self.at as u64
    }

    pub fn seek(&mut self, position: u64) {
        self.chunk.clear();
        (self.start, self.at) = (position, 0);
    }

    /// Returns the bytes from the current position to the end of the chunk; none at the end of the
    /// file.
    #[inline]
    fn ahead(&mut self) -> Result<&[u8]> {
        if self.at == self.chunk.len() {
            self.start += self.at as u64;
            self.at = 0;
            let bytes = self.input.len().saturating_sub(self.start).min(CHUNK);
            self.chunk.resize(bytes as usize, 0);
            self.input.read(self.start, &mut self.chunk)?;
        }
        Ok(&self.chunk[self.at..])
    }

    #[inline]
    pub fn peek(&mut self) -> Result<Option<u8>> {
        Ok(self.ahead()?.first().copied())
    }

    #[inline]
    pub fn next(&mut self) -> Result<Option<u8>> {
        let next = self.peek()?;
        self.at += usize::from(next.is_some());
        Ok(next)
    }

    /// Skips bytes before the first one that satisfies `stop`.
    #[inline]
    fn skip_to(&mut self, stop: impl Fn(u8) -> bool) -> Result<()> {
        loop {
            let ahead = self.ahead()?;
            let found = ahead.iter().position(|&b| stop(b));
            let (skipped, end) = (found.unwrap_or(ahead.len()), ahead.is_empty());
            self.at += skipped;
            if found.is_some() || end {
                return Ok(());
            }
        }
    }

    /// Skips blanks, ends of lines and comments.
    pub fn space(&mut self) -> Result<()> {
        loop {
            match self.peek()? {
                Some(b) if b.is_ascii_whitespace() => self.at += 1,
                Some(b'#') => self.skip_to(|b| b == b'\n')?,
                Some(b'/') => {
                    self.at += 1;
                    match self.next()? {
                        Some(b'/') => self.skip_to(|b| b == b'\n')?,
                        Some(b'*') => loop {
                            self.skip_to(|b| b == b'*')?;
                            self.at += usize::from(self.peek()?.is_some());
                            match self.peek()? {
                                Some(b'/') => {
                                    self.at += 1;
                                    break;
                                }
                                None => return Err(self.bad("a comment does not end")),
                                _ => {}
                            }
                        },
                        _ => return Err(self.bad("a slash that begins no comment")),
                    }
                }
                _ => return Ok(()),
            }
        }
    }

    /// Returns true, and skips it, if the next character after blanks is `expected`.
    #[inline]
    pub fn take(&mut self, expected: u8) -> Result<bool> {
        // Without blanks, as in most numbers.
        if self.chunk.get(self.at) == Some(&expected) {
            self.at += 1;
            return Ok(true);
        }
        self.space()?;
        let found = self.peek()? == Some(expected);
        self.at += usize::from(found);
        Ok(found)
    }

    /// Skips a character after blanks, and fails if there is another one.
    pub fn expect(&mut self, expected: u8) -> Result<()> {
        match self.take(expected)? {
            true => Ok(()),
            false => Err(self.unexpected(&format!("'{}'", char::from(expected)))),
        }
    }

    /// Reads a word after blanks: letters, digits and `_:.+-`.
    pub fn word(&mut self) -> Result<String> {
        self.space()?;
        let in_word = |b: u8| b.is_ascii_alphanumeric() || b"_:.+-!".contains(&b) || b >= 0x80;
        let mut word = Vec::new();
        loop {
            let ahead = self.ahead()?;
            let n = ahead.iter().take_while(|&&b| in_word(b)).count();
            let end = n < ahead.len() || ahead.is_empty();
            word.extend_from_slice(&ahead[..n.min(WORD_BYTES + 1)]);
            self.at += n;
            if word.len() > WORD_BYTES {
                return Err(self.bad(format_args!("a word of more than {WORD_BYTES} bytes")));
            }
            if end {
                break;
            }
        }
        if word.is_empty() {
            return Err(self.unexpected("a word"));
        }
        String::from_utf8(word).map_err(|_| self.bad("a word is not UTF-8"))
    }

    /// Reads a string after blanks. Returns at most its first [`WORD_BYTES`] + 1 bytes.
    pub fn string(&mut self) -> Result<String> {
        self.space()?;
        let Some(quote @ (b'"' | b'\'')) = self.peek()? else {
            return Err(self.unexpected("a string"));
        };
        self.at += 1;
        // Three quotes begin a string that ends with three; two are an empty string.
        let mut quotes = 1;
        while quotes < 3 && self.peek()? == Some(quote) {
            self.at += 1;
            quotes += 1;
        }
        let mut text = Vec::new();
        if quotes == 2 {
            return Ok(String::new());
        }
        let mut ending = 0;
        while ending < quotes {
            let Some(b) = self.next()? else {
                return Err(self.bad("a string does not end"));
            };
            if b == quote {
                ending += 1;
                continue;
            }
            let mut push = |b: u8| {
                if text.len() <= WORD_BYTES {
                    text.push(b);
                }
            };
            (0..std::mem::take(&mut ending)).for_each(|_| push(quote));
            match b {
                b'\\' => match self.next()? {
                    Some(b'n') => push(b'\n'),
                    Some(b't') => push(b'\t'),
                    Some(b'r') => push(b'\r'),
                    Some(b'x') => push(self.hexadecimal()?),
                    Some(other) => push(other),
                    None => return Err(self.bad("a string does not end")),
                },
                b'\n' if quotes == 1 => return Err(self.bad("a string does not end")),
                b => push(b),
            }
        }
        text.truncate(WORD_BYTES + 1);
        Ok(String::from_utf8_lossy(&text).into_owned())
    }

    /// Reads the two digits of a byte.
    fn hexadecimal(&mut self) -> Result<u8> {
        let mut value = 0;
        for _ in 0..2 {
            let digit = self.next()?.and_then(|b| char::from(b).to_digit(16));
            let digit = digit.ok_or_else(|| self.bad("'\\x' without two digits"))?;
            value = 16 * value + digit as u8;
        }
        Ok(value)
    }

    /// Skips an asset, `@file@` or `@@@file@@@`.
    fn skip_asset(&mut self) -> Result<()> {
        let mut ats = 0;
        while ats < 3 && self.peek()? == Some(b'@') {
            self.at += 1;
            ats += 1;
        }
        // Two are an empty name.
        let mut ending = if ats == 2 { 2 } else { 0 };
        while ending < ats {
            match self.next()? {
                Some(b'@') => ending += 1,
                Some(_) => ending = 0,
                None => return Err(self.bad("an asset does not end")),
            }
        }
        Ok(())
    }

    /// Skips a value of any kind after blanks, with all that is in its brackets.
    pub fn skip_value(&mut self) -> Result<()> {
        self.space()?;
        let mut open = 0_u64;
        loop {
            if self.skip_brackets(&mut open)? {
                return Ok(());
            }
            match self.peek()? {
                Some(b'"' | b'\'') => drop(self.string()?),
                Some(b'@') => {
                    self.skip_asset()?;
                    // A prim of the asset.
                    if open == 0 && self.peek()? == Some(b'<') {
                        continue;
                    }
                }
                Some(b'<') => {
                    self.skip_to(|b| b == b'>')?;
                    self.at += usize::from(self.peek()?.is_some());
                }
                Some(b'#' | b'/') if open > 0 => self.space()?,
                None if open > 0 => return Err(self.bad("a bracket does not end")),
                _ => drop(self.word()?),
            }
            if open == 0 {
                return Ok(());
            }
        }
    }

    /// Skips numbers, words and brackets, of which `open` are open, before other characters or, if
    /// no bracket is open, before a word. Returns true after the last bracket. Most bytes of a file
    /// are skipped here.
    fn skip_brackets(&mut self, open: &mut u64) -> Result<bool> {
        loop {
            let ahead = self.ahead()?;
            let mut skipped = ahead.len();
            for (k, &b) in ahead.iter().enumerate() {
                match CLASSES[usize::from(b)] {
                    Class::Open => *open += 1,
                    Class::Close if *open > 0 => *open -= 1,
                    Class::Plain if *open > 0 => continue,
                    _ => {
                        skipped = k;
                        break;
                    }
                }
                if *open == 0 {
                    self.at += k + 1;
                    return Ok(true);
                }
            }
            let end = skipped < ahead.len() || ahead.is_empty();
            self.at += skipped;
            if end {
                return Ok(false);
            }
        }
    }

    /// Reads a number after blanks and passes its characters to `parse`.
    #[inline]
    pub fn number<T>(&mut self, parse: impl Fn(&str) -> Option<T>) -> Result<T> {
        let ends = |b: u8| matches!(b, b',' | b')' | b']' | b'}' | b':' | b';' | b'#' | 0..=b' ');
        self.at += usize::from(self.chunk.get(self.at) == Some(&b' '));
        if !matches!(self.peek()?, Some(b'0'..=b'9' | b'-')) {
            self.space()?;
        }
        let ahead = self.ahead()?;
        if let Some(n) = ahead.iter().position(|&b| ends(b)) {
            let parsed = std::str::from_utf8(&ahead[..n]).ok().and_then(&parse);
            if let Some(value) = parsed {
                self.at += n;
                return Ok(value);
            }
        } else {
            // The number continues in the next chunk, or the file ends.
            let word = self.word()?;
            if let Some(value) = parse(&word) {
                return Ok(value);
            }
        }
        Err(self.unexpected("a number"))
    }

    /// Returns the error of other characters than expected.
    pub fn unexpected(&mut self, expected: &str) -> Error {
        let found = match self.ahead() {
            Err(e) => return e,
            Ok([]) => "the end of the file".into(),
            Ok(ahead) => {
                let line = ahead.split(|b| *b == b'\n').next().unwrap_or_default();
                quote(line)
            }
        };
        self.bad(format_args!("{found}, expected {expected}"))
    }

    /// Returns an error with the number of the current line.
    pub fn bad(&mut self, what: impl std::fmt::Display) -> Error {
        let position = self.position();
        let mut line = 1;
        let mut at = 0;
        let mut chunk = [0; 4096];
        while at < position {
            let n = (position - at).min(chunk.len() as u64) as usize;
            if let Err(e) = self.input.read(at, &mut chunk[..n]) {
                return e;
            }
            line += chunk[..n].iter().filter(|&&b| b == b'\n').count();
            at += n as u64;
        }
        Error::format(FORMAT, format_args!("line {line}"), what)
    }
}
