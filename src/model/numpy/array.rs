//! The `.npy` format: a magic string, a header (the text of a Python dictionary), and the values.

use super::FORMAT;
use crate::error::{Error, Result};
use crate::model::quote;
use std::fmt::Display;
use std::io::{ErrorKind, Read};

/// Maximum length of a header. NumPy refuses to read longer ones as well.
const MAX_HEADER: usize = 10_000;

/// Kinds of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Float,
    Signed,
    Unsigned,
    /// Characters of four bytes.
    Text,
    /// Bytes of UTF-8.
    Bytes,
    /// Truth values, dates and durations: never points.
    Other,
}

/// Content of a header, consistent with the length of the array.
#[derive(Debug)]
pub(super) struct Array {
    /// The type as NumPy writes it, `<f8` for example.
    pub descr: String,
    pub kind: Kind,
    little: bool,
    /// Bytes of a value.
    pub size: u64,
    pub shape: Vec<u64>,
}

/// Reasons why bytes cannot be read.
pub(super) enum Unread {
    End(u64),
    Io(std::io::Error),
}

impl Unread {
    /// Adds the place.
    pub fn at(self, place: impl Display) -> Error {
        match self {
            Unread::End(missing) => {
                let what = format!("the file ends, {missing} bytes are missing");
                Error::format(FORMAT, place, what)
            }
            // Damaged compressed data, and a wrong checksum.
            Unread::Io(e)
                if matches!(e.kind(), ErrorKind::InvalidData | ErrorKind::InvalidInput) =>
            {
                Error::format(FORMAT, place, e)
            }
            Unread::Io(e) => Error::Io(e),
        }
    }
}

/// Reads `len` bytes into `bytes`. The memory is that of the bytes that are there.
pub(super) fn fill(input: &mut impl Read, len: usize, bytes: &mut Vec<u8>) -> Result<(), Unread> {
    bytes.clear();
    let read = input.take(len as u64).read_to_end(bytes);
    match read.map_err(Unread::Io)? {
        n if n == len => Ok(()),
        n => Err(Unread::End((len - n) as u64)),
    }
}

impl Array {
    /// Parses the header of an array of `len` bytes in total.
    pub fn parse(input: &mut impl Read, len: u64, name: &str) -> Result<Array> {
        let bad = |what: &dyn Display| Error::format(FORMAT, format_args!("array {name}"), what);
        let mut bytes = Vec::new();
        let mut read = |n: usize, bytes: &mut Vec<u8>| {
            fill(input, n, bytes).map_err(|e| e.at(format_args!("header of array {name}")))
        };
        read(8, &mut bytes)?;
        if &bytes[..6] != b"\x93NUMPY" {
            let what = format!(
                "{}, expected the magic bytes of an array",
                quote(&bytes[..6])
            );
            return Err(bad(&what));
        }
        let version = bytes[6];
        let length_bytes = match version {
            1 => 2,
            2 | 3 => 4,
            other => return Err(bad(&format_args!("version {other}, expected 1, 2 or 3"))),
        };
        read(length_bytes, &mut bytes)?;
        let header_len = bytes.iter().rfold(0, |n, &b| (n << 8) | usize::from(b));
        if header_len > MAX_HEADER {
            let what = format!("a header of {header_len} bytes, expected at most {MAX_HEADER}");
            return Err(bad(&what));
        }
        read(header_len, &mut bytes)?;
        let array = Array::of_header(&bytes, name)?;
        let values = len.saturating_sub((8 + length_bytes + header_len) as u64);
        let promised = (array.shape.iter())
            .try_fold(u128::from(array.size), |n, &d| n.checked_mul(u128::from(d)));
        if promised != Some(u128::from(values)) {
            let what = format!(
                "{} values of type {} do not take the {values} bytes that follow",
                array.shape_text(),
                array.descr
            );
            return Err(bad(&what));
        }
        Ok(array)
    }

    /// Parses the text of a header.
    fn of_header(text: &[u8], name: &str) -> Result<Array> {
        let bad = |what| Error::format(FORMAT, format_args!("header of array {name}"), what);
        let header = Dictionary::parse(text).map_err(bad)?;
        let unsupported = |what: String| Err(Error::unsupported(FORMAT, what));
        let Some(descr) = header.descr else {
            let what = format!("array {name}: a structured array; store plain numbers");
            return unsupported(what);
        };
        if header.fortran && header.shape.len() > 1 {
            let what = format!(
                "array {name}: Fortran order; store `np.ascontiguousarray({name})`, an array in C \
                 order"
            );
            return unsupported(what);
        }
        if descr.contains('O') {
            let what = format!(
                "array {name}: pickled Python objects (type {descr}); store plain numbers \
                 (`.astype(np.float64)`)"
            );
            return unsupported(what);
        }
        let mut letters = descr.chars();
        let order = letters.next();
        let kind = match letters.next() {
            Some('f') => Some((Kind::Float, 1)),
            Some('i') => Some((Kind::Signed, 1)),
            Some('u') => Some((Kind::Unsigned, 1)),
            Some('U') => Some((Kind::Text, 4)),
            Some('S') => Some((Kind::Bytes, 1)),
            Some('b' | 'M' | 'm') => Some((Kind::Other, 1)),
            _ => None,
        };
        // A date has its unit after the size: `<M8[ns]`.
        let digits = letters.as_str().split('[').next().unwrap_or_default();
        let size: Option<u32> = digits.parse().ok();
        let (Some('<' | '>' | '|' | '='), Some((kind, unit)), Some(size)) = (order, kind, size)
        else {
            let what = format!("array {name}: type {}", quote(descr.as_bytes()));
            return unsupported(format!("{what}; store numbers of type f8"));
        };
        Ok(Array {
            kind,
            little: order != Some('>'),
            size: unit * u64::from(size),
            shape: header.shape,
            descr,
        })
    }

    /// Brings the bytes of values to little-endian order.
    pub fn to_little_endian(&self, bytes: &mut [u8]) {
        let unit = if self.kind == Kind::Text {
            4
        } else {
            self.size as usize
        };
        if !self.little && unit > 0 {
            bytes.chunks_exact_mut(unit).for_each(<[u8]>::reverse);
        }
    }

    /// Returns the shape in words.
    pub fn shape_text(&self) -> String {
        let sizes: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        match sizes.is_empty() {
            true => "1 (no dimensions)".into(),
            false => sizes.join(" x "),
        }
    }
}

/// A header as a Python dictionary.
#[derive(Default)]
struct Dictionary {
    /// `None` if the type is a list of fields.
    descr: Option<String>,
    fortran: bool,
    shape: Vec<u64>,
}

impl Dictionary {
    /// Parses `{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }`.
    fn parse(text: &[u8]) -> Result<Dictionary, String> {
        let mut text = Text(text);
        let mut found = Dictionary::default();
        let mut seen = [false; 3];
        text.expect(b'{')?;
        while !text.skip(b'}') {
            let key = text.string()?;
            text.expect(b':')?;
            let k = match &key[..] {
                "descr" => {
                    if text.peek() == Some(b'[') {
                        // The fields are not needed: no such array is read.
                        return Ok(Dictionary::default());
                    }
                    found.descr = Some(text.string()?);
                    0
                }
                "fortran_order" => {
                    found.fortran = text.boolean()?;
                    1
                }
                "shape" => {
                    found.shape = text.tuple()?;
                    2
                }
                other => {
                    return Err(format!(
                        "key {}, which is not known",
                        quote(other.as_bytes())
                    ));
                }
            };
            if std::mem::replace(&mut seen[k], true) {
                return Err(format!("key '{key}' is there twice"));
            }
            if !text.skip(b',') {
                text.expect(b'}')?;
                break;
            }
        }
        match seen {
            [true, true, true] => Ok(found),
            _ => Err("expected the keys descr, fortran_order and shape".into()),
        }
    }
}

/// Text of a header that is not parsed yet.
struct Text<'a>(&'a [u8]);

impl Text<'_> {
    fn peek(&mut self) -> Option<u8> {
        self.0 = self.0.trim_ascii_start();
        self.0.first().copied()
    }

    /// Skips a character if it is the next one.
    fn skip(&mut self, wanted: u8) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.0 = &self.0[1..];
        }
        found
    }

    fn expect(&mut self, wanted: u8) -> Result<(), String> {
        match self.skip(wanted) {
            true => Ok(()),
            false => Err(format!(
                "{}, expected '{}'",
                quote(self.0),
                char::from(wanted)
            )),
        }
    }

    fn string(&mut self) -> Result<String, String> {
        let quoted = |q: &u8| matches!(q, b'\'' | b'"');
        let delimiter = self.peek().filter(quoted);
        let end = delimiter.and_then(|q| self.0[1..].iter().position(|&b| b == q));
        let Some(end) = end else {
            return Err(format!("{}, expected a text in quotes", quote(self.0)));
        };
        let text = String::from_utf8_lossy(&self.0[1..=end]).into_owned();
        self.0 = &self.0[end + 2..];
        Ok(text)
    }

    fn boolean(&mut self) -> Result<bool, String> {
        self.peek();
        for (word, value) in [(&b"True"[..], true), (b"False", false)] {
            if let Some(rest) = self.0.strip_prefix(word) {
                self.0 = rest;
                return Ok(value);
            }
        }
        Err(format!("{}, expected True or False", quote(self.0)))
    }

    fn tuple(&mut self) -> Result<Vec<u64>, String> {
        let mut numbers = Vec::new();
        self.expect(b'(')?;
        while !self.skip(b')') {
            self.peek();
            let digits = self.0.iter().take_while(|b| b.is_ascii_digit()).count();
            let number = std::str::from_utf8(&self.0[..digits]).ok();
            let Some(number) = number.and_then(|n| n.parse().ok()) else {
                return Err(format!(
                    "{}, expected the size of a dimension",
                    quote(self.0)
                ));
            };
            numbers.push(number);
            self.0 = &self.0[digits..];
            // Python 2 wrote `3L`.
            self.skip(b'L');
            if !self.skip(b',') {
                self.expect(b')')?;
                break;
            }
        }
        Ok(numbers)
    }
}
