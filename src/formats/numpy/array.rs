//! The `.npy` format: a magic string, a header (the text of a Python dictionary), and the values.

use super::FORMAT;
use crate::error::{Error, Result};
use crate::formats::{little_endian, quote};
use serde::Deserialize;
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

/// Reads `len` bytes. The memory is that of the bytes that are there.
///
/// # Errors
///
/// Errors name the place, and the number of bytes that are missing, with `more` that follow.
pub(super) fn fill(
    input: &mut impl Read,
    len: usize,
    place: impl Display,
    more: u64,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let what = match input.take(len as u64).read_to_end(&mut bytes) {
        Ok(n) if n == len => return Ok(bytes),
        Ok(n) => {
            let missing = (len - n) as u64 + more;
            format!("the file ends, {missing} bytes are missing")
        }
        // Damaged compressed data, and a wrong checksum.
        Err(e) if matches!(e.kind(), ErrorKind::InvalidData | ErrorKind::InvalidInput) => {
            format!("the file is damaged: {e}")
        }
        Err(e) => return Err(Error::Io(e)),
    };
    Err(Error::format(FORMAT, place, what))
}

impl Array {
    /// Parses the header of an array of `len` bytes in total.
    pub fn parse(input: &mut impl Read, len: u64, name: &str) -> Result<Array> {
        let bad = |what: &dyn Display| Error::format(FORMAT, format_args!("array {name}"), what);
        let mut read = |n| fill(input, n, format_args!("header of array {name}"), 0);
        let start = read(8)?;
        if &start[..6] != b"\x93NUMPY" {
            let found = quote(&start[..6]);
            return Err(bad(&format_args!(
                "{found}, expected the magic bytes of an array"
            )));
        }
        let length_bytes = match start[6] {
            1 => 2,
            2 | 3 => 4,
            other => return Err(bad(&format_args!("version {other}, expected 1, 2 or 3"))),
        };
        let header_len = little_endian(&read(length_bytes)?) as usize;
        if header_len > MAX_HEADER {
            let what = format!("a header of {header_len} bytes, expected at most {MAX_HEADER}");
            return Err(bad(&what));
        }
        let array = Array::of_header(&read(header_len)?, name)?;
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
        let json = json_of(&String::from_utf8_lossy(text));
        let header: Header = serde_json::from_str(&json).map_err(|e| {
            let what = format!(
                "{}, expected the keys descr, fortran_order and shape: {e}",
                quote(text)
            );
            Error::format(FORMAT, format_args!("header of array {name}"), what)
        })?;
        let unsupported = |what: &str| {
            let what = format!("array {name}: {what}");
            Err(Error::unsupported(FORMAT, what))
        };
        let Some(descr) = header.descr.as_str() else {
            return unsupported("a structured array; store plain numbers");
        };
        if header.fortran_order && header.shape.len() > 1 {
            let store = format!("np.ascontiguousarray({name})");
            return unsupported(&format!(
                "Fortran order; store `{store}`, an array in C order"
            ));
        }
        if descr.contains('O') {
            return unsupported(&format!(
                "pickled Python objects (type {descr}); store plain numbers \
                 (`.astype(np.float64)`)"
            ));
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
            let found = quote(descr.as_bytes());
            return unsupported(&format!("type {found}; store numbers of type f8"));
        };
        Ok(Array {
            kind,
            little: order != Some('>'),
            size: unit * u64::from(size),
            descr: descr.to_owned(),
            shape: header.shape,
        })
    }

    /// Brings the bytes of values to little-endian order.
    pub fn to_little_endian(&self, bytes: &mut [u8]) {
        let unit = match self.kind {
            Kind::Text => 4,
            _ => self.size as usize,
        };
        if !self.little && unit > 0 {
            bytes.chunks_exact_mut(unit).for_each(<[u8]>::reverse);
        }
    }

    /// Returns the shape as text.
    pub fn shape_text(&self) -> String {
        let sizes: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        match sizes.is_empty() {
            true => "1 (no dimensions)".into(),
            false => sizes.join(" x "),
        }
    }
}

/// Header of an array.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    /// A text, or the list of the fields of a structured array.
    descr: serde_json::Value,
    fortran_order: bool,
    shape: Vec<u64>,
}

/// Returns the JSON of a Python dictionary:
/// `{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }`.
fn json_of(python: &str) -> String {
    let (mut json, mut quote) = (String::new(), None);
    for c in python.chars() {
        match (c, quote) {
            ('\'' | '"', None) => {
                quote = Some(c);
                json.push('"');
            }
            (c, Some(q)) if c == q => {
                quote = None;
                json.push('"');
            }
            ('"' | '\\', Some(_)) => json.extend(['\\', c]),
            (c, Some(_)) => json.push(c),
            ('(', None) => json.push('['),
            (')' | ']' | '}', None) => {
                // A comma may follow the last item.
                json.truncate(json.trim_end_matches(',').len());
                json.push(if c == '}' { '}' } else { ']' });
            }
            // Python 2 wrote `3L`.
            ('L', None) => {}
            (c, None) if c.is_whitespace() => {}
            // True and False.
            (c, None) => json.push(c.to_ascii_lowercase()),
        }
    }
    json
}
