//! The comment of a frame: keys with values.

use super::GROUPS;
use crate::curve::{Cell, Point};
use crate::formats::lines::{integer, words_between};
use crate::formats::torn::cell_along;
use crate::formats::{number, quote};

/// Content of the comment of a frame.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Comment {
    lattice: Option<[Point; 3]>,
    origin: Option<Point>,
    pbc: Option<[bool; 3]>,
    pub time: f64,
    pub step: Option<u64>,
    pub columns: Columns,
}

/// Columns of the atoms.
#[derive(Debug, PartialEq)]
pub(super) struct Columns {
    /// Number of columns, and if there may be more.
    pub all: usize,
    pub more: bool,
    /// First of the three columns of the coordinates.
    pub at: usize,
    pub id: Option<usize>,
    pub group: Option<usize>,
    pub closed: Option<usize>,
}

impl Default for Columns {
    /// Returns the columns of plain XYZ: `species x y z`.
    fn default() -> Columns {
        Columns {
            all: 4,
            more: true,
            at: 1,
            id: None,
            group: None,
            closed: None,
        }
    }
}

impl Comment {
    /// Parses a comment. A plain one may have any text.
    pub fn parse(text: &[u8]) -> Result<Comment, String> {
        let lower = text.to_ascii_lowercase();
        let names = |key: &[u8]| lower.windows(key.len()).any(|w| w == key);
        let extended = names(b"lattice") || names(b"properties");
        match Comment::parse_keys(text) {
            Err(_) if !extended => Ok(Comment::default()),
            parsed => parsed,
        }
    }

    fn parse_keys(text: &[u8]) -> Result<Comment, String> {
        const KEYS: [&str; 6] = ["lattice", "origin", "pbc", "properties", "time", "timestep"];
        let mut comment = Comment::default();
        let mut seen = [false; KEYS.len()];
        let mut text = Text(text);
        while let Some((key, value)) = text.pair()? {
            let is_key = |name: &str| key.eq_ignore_ascii_case(name.as_bytes());
            let Some(k) = KEYS.into_iter().position(is_key) else {
                continue;
            };
            let name = quote(key);
            let value = value.ok_or_else(|| format!("the key {name} has no value"))?;
            if std::mem::replace(&mut seen[k], true) {
                return Err(format!("the key {name} is there twice"));
            }
            let in_key = |what| format!("{name}: {what}");
            match k {
                0 => {
                    let numbers: [f64; 9] = numbers(value).map_err(in_key)?;
                    comment.lattice = numbers.as_chunks::<3>().0.try_into().ok();
                }
                1 => comment.origin = Some(numbers(value).map_err(in_key)?),
                2 => comment.pbc = Some(three_flags(value).map_err(in_key)?),
                3 => comment.columns = Columns::parse(value).map_err(in_key)?,
                4 => comment.time = number(value).map_err(in_key)?,
                _ => comment.step = Some(integer(value, "the number of a frame").map_err(in_key)?),
            }
        }
        Ok(comment)
    }

    /// Returns true if a comment without a lattice has a cell in another form: three numbers after
    /// `cell` or `box`, perhaps with a word between them, as i-PI writes it.
    pub fn has_other_cell(&self, text: &[u8]) -> bool {
        let is_between = |b: &u8| b.is_ascii_whitespace() || b"=:,;\"'()[]{}".contains(b);
        let words: Vec<&[u8]> = words_between(text, is_between).collect();
        let is_cell = |word: &[u8]| [&b"cell"[..], b"box"].contains(&&*word.to_ascii_lowercase());
        let three = |w: &[&[u8]]| w.len() > 2 && w[..3].iter().all(|w| number(w).is_ok());
        let begins = |k: usize| {
            let [after, later] = [k + 1, k + 2].map(|k| words.get(k..).unwrap_or_default());
            is_cell(words[k]) && (three(after) || three(later))
        };
        self.lattice.is_none() && (0..words.len()).any(begins)
    }

    /// Returns the cell of the frame, if it repeats.
    pub fn cell(&self) -> Result<Option<Cell>, String> {
        let Some(vectors) = self.lattice else {
            return match self.pbc {
                Some(pbc) if pbc.contains(&true) => {
                    Err("the frame is periodic by `pbc`, but has no Lattice".into())
                }
                _ => Ok(None),
            };
        };
        let origin = self.origin.unwrap_or_default();
        let cell = Cell { origin, vectors };
        let cell = cell_along(cell, self.pbc.unwrap_or(cell.periodic()), |k| {
            format!(
                "the frame repeats along vector {} of its Lattice by `pbc`, but the vector is zero",
                k + 1
            )
        });
        cell.map_err(|e| e.to_string())
    }
}

/// Returns the words of a value, such as the numbers of an array `[[9, 0, 0], [0, 8, 0], ..]`.
fn parts(value: &[u8]) -> impl Iterator<Item = &[u8]> {
    words_between(value, |b| b.is_ascii_whitespace() || b",[]".contains(b))
}

fn numbers<const N: usize>(value: &[u8]) -> Result<[f64; N], String> {
    let found = parts(value).take(N + 1).map(number);
    let found = found.collect::<Result<Vec<_>, _>>()?;
    <[f64; N]>::try_from(found).map_err(|found| match found.len() > N {
        true => format!("more than {N} numbers"),
        false => format!("{} numbers, expected {N}", found.len()),
    })
}

/// Parses `T` or `F`.
pub(super) fn flag(word: &[u8]) -> Result<bool, String> {
    match word {
        b"T" | b"True" | b"true" | b"TRUE" | b"1" => Ok(true),
        b"F" | b"False" | b"false" | b"FALSE" | b"0" => Ok(false),
        other => Err(format!("{}, expected T or F", quote(other))),
    }
}

fn three_flags(value: &[u8]) -> Result<[bool; 3], String> {
    let flags = parts(value).take(4).map(flag);
    let flags = flags.collect::<Result<Vec<_>, _>>()?;
    <[bool; 3]>::try_from(flags).map_err(|flags| format!("{} of T and F, expected 3", flags.len()))
}

impl Columns {
    /// Parses `species:S:1:pos:R:3`.
    fn parse(value: &[u8]) -> Result<Columns, String> {
        let fields: Vec<&[u8]> = value.split(|b| *b == b':').collect();
        let (triples, rest) = fields.as_chunks::<3>();
        if !rest.is_empty() {
            let expected = "expected `name:type:columns:name:type:columns:..`";
            return Err(format!("{}, {expected}", quote(value)));
        }
        let mut columns = Columns::default();
        (columns.all, columns.more) = (0, false);
        let (mut at, mut groups) = (None, [None; GROUPS.len()]);
        for &[name, kind, width] in triples {
            let first = columns.all;
            // A line has no room for more columns.
            let width: u16 = integer(width, "a number of columns")?;
            columns.all += usize::from(width);
            let is = |wanted: &str| name.eq_ignore_ascii_case(wanted.as_bytes());
            match (kind, width) {
                (b"R", 3) if is("pos") => at = Some(first),
                (b"I", 1) if is("id") => columns.id = Some(first),
                (b"L", 1) if is("closed") => columns.closed = Some(first),
                (b"I", 1) => {
                    if let Some(rank) = GROUPS.iter().position(|name| is(name)) {
                        groups[rank].get_or_insert(first);
                    }
                }
                _ => {}
            }
        }
        columns.at = at.ok_or("no columns `pos:R:3`")?;
        columns.group = groups.into_iter().flatten().next();
        Ok(columns)
    }
}

/// A key, and its value if it has one.
type Pair<'a> = (&'a [u8], Option<&'a [u8]>);

/// Text of a comment that is not parsed yet.
struct Text<'a>(&'a [u8]);

impl<'a> Text<'a> {
    /// Returns the next key and its value.
    fn pair(&mut self) -> Result<Option<Pair<'a>>, String> {
        self.0 = self.0.trim_ascii_start();
        if self.0.is_empty() {
            return Ok(None);
        }
        let key = self.token()?;
        let after = self.0.trim_ascii_start();
        let Some(value) = after.strip_prefix(b"=") else {
            return Ok(Some((key, None)));
        };
        self.0 = value.trim_ascii_start();
        Ok(Some((key, Some(self.token()?))))
    }

    /// Returns the next word, a text in quotes or braces without them, or an array in brackets.
    fn token(&mut self) -> Result<&'a [u8], String> {
        let text = self.0;
        let close = match text.first() {
            Some(b'"') => b'"',
            Some(b'\'') => b'\'',
            Some(b'{') => b'}',
            Some(b'[') => return self.array(),
            _ => {
                let ends = |b: &u8| b.is_ascii_whitespace() || *b == b'=';
                let n = text.iter().position(ends).unwrap_or(text.len());
                if n == 0 {
                    return Err(format!("{}, expected a key and a value", quote(text)));
                }
                self.0 = &text[n..];
                return Ok(&text[..n]);
            }
        };
        let mut k = 1;
        while k < text.len() && text[k] != close {
            // A backslash precedes a quote that does not end the text.
            k += if text[k] == b'\\' { 2 } else { 1 };
        }
        if k >= text.len() {
            return Err(format!("{}: the text does not end", quote(text)));
        }
        self.0 = &text[k + 1..];
        Ok(&text[1..k])
    }

    /// Returns the text up to the bracket that closes the first one.
    fn array(&mut self) -> Result<&'a [u8], String> {
        let mut depth = 0;
        let end = self.0.iter().position(|b| {
            depth += i32::from(*b == b'[') - i32::from(*b == b']');
            depth == 0
        });
        let end = end.ok_or_else(|| format!("{}: the array does not end", quote(self.0)))?;
        let array = &self.0[..=end];
        self.0 = &self.0[end + 1..];
        Ok(array)
    }
}
