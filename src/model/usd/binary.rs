//! Binary USD files (crate files, `.usdc`): the structure is read when the file is opened, and
//! values are read when they are needed.
//!
//! | bytes | content |
//! |---|---|
//! | 0 | `PXR-USDC` |
//! | 8 | version: 0.4 to 0.13 are read |
//! | 16 | u64: position of the table of sections: a name of 16 bytes, u64 start, u64 size of each |
//!
//! | section | content |
//! |---|---|
//! | `TOKENS` | words, each ended by 0, compressed; see [`Tokens`] |
//! | `STRINGS` | tokens of strings |
//! | `FIELDS` | name (a token) and value of each field; the value is a [`Rep`] |
//! | `FIELDSETS` | lists of fields, each ended by -1 |
//! | `PATHS` | a tree of names; see [`Paths`] |
//! | `SPECS` | path, list of fields and type of each prim and attribute |
//!
//! Source: `pxr/usd/sdf/crateFile.cpp` of OpenUSD. No count is trusted, and no structure in the
//! file makes this reader recurse.

use super::FORMAT;
use super::input::Input;
use super::layer::{Layer, Place, Samples, Value};
use super::packed::{half, integers};
use super::specs::Structure;
use super::tokens::Tokens;
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::io::{Read, Seek};

pub(super) const MAGIC: &[u8; 8] = b"PXR-USDC";
/// Shorter arrays are never compressed.
const COMPRESSED_FROM: u64 = 16;

/// A value: its type, and its position in the file or, if it is short, itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rep(pub u64);

impl Rep {
    fn is_array(self) -> bool {
        self.0 >> 63 & 1 == 1
    }

    fn is_inlined(self) -> bool {
        self.0 >> 62 & 1 == 1
    }

    fn is_compressed(self) -> bool {
        self.0 >> 61 & 1 == 1
    }

    pub fn kind(self) -> u8 {
        (self.0 >> 48) as u8
    }

    pub fn payload(self) -> u64 {
        self.0 & ((1 << 48) - 1)
    }

    /// Returns the four bytes of an inlined value.
    pub fn inlined(self) -> [u8; 4] {
        (self.0 as u32).to_le_bytes()
    }

    pub fn place(self) -> String {
        format!("byte {}", self.payload())
    }
}

/// Numbers of types of values.
pub(super) mod kind {
    pub const BOOL: u8 = 1;
    pub const INT: u8 = 3;
    pub const HALF: u8 = 7;
    pub const FLOAT: u8 = 8;
    pub const DOUBLE: u8 = 9;
    pub const STRING: u8 = 10;
    pub const TOKEN: u8 = 11;
    pub const MATRIX4D: u8 = 15;
    pub const QUATD: u8 = 16;
    pub const QUATF: u8 = 17;
    pub const QUATH: u8 = 18;
    pub const VEC3D: u8 = 23;
    pub const VEC3F: u8 = 24;
    pub const VEC3H: u8 = 25;
    pub const TOKEN_VECTOR: u8 = 41;
    pub const SPECIFIER: u8 = 42;
    pub const TIME_SAMPLES: u8 = 46;
    pub const DOUBLE_VECTOR: u8 = 48;
    pub const BLOCK: u8 = 51;
}

/// An open file.
#[derive(Debug)]
pub(super) struct Binary<R> {
    pub input: Input<R>,
    /// Minor version; the major one is 0.
    version: u8,
    pub tokens: Tokens,
    /// Time samples that were read, by their values in the file.
    samples: HashMap<u64, Samples>,
    /// Number of all time samples.
    sampled: u64,
}

impl<R: Read + Seek> Binary<R> {
    /// Reads the structure of a file.
    pub fn open(mut input: Input<R>) -> Result<(Binary<R>, Layer)> {
        let mut head = [0; 24];
        input.read(0, &mut head)?;
        let [major, minor] = [head[8], head[9]];
        if (major, minor) < (0, 4) || (major, minor) > (0, 13) {
            let what = format!(
                "binary version {major}.{minor}, 0.4 to 0.13 are read: convert it with usdcat"
            );
            return Err(Error::unsupported(FORMAT, what));
        }
        let mut file = Binary {
            input,
            version: minor,
            tokens: Tokens::default(),
            samples: HashMap::new(),
            sampled: 0,
        };
        let structure = Structure::read(&mut file)?;
        let layer = structure.layer(&mut file)?;
        file.samples.clear();
        Ok((file, layer))
    }

    /// Reads a value.
    pub fn value(&mut self, rep: Rep) -> Result<Value> {
        use kind::*;
        if rep.kind() == BLOCK {
            return Ok(Value::Blocked);
        }
        let bad = |what: String| Error::format(FORMAT, rep.place(), what);
        let value = match (rep.kind(), rep.is_array()) {
            (TOKEN_VECTOR, _) => {
                let count = self.input.u64_at(rep.payload())?;
                self.words(rep.payload() + 8, count, false)
            }
            (TOKEN | STRING, true) => {
                let (count, at) = self.array(rep)?;
                self.words(at, count, rep.kind() == STRING)
            }
            (TOKEN | STRING, false) => {
                let index = match rep.is_inlined() {
                    true => rep.inlined(),
                    false => self.scalar(rep)?,
                };
                self.word(u32::from_le_bytes(index), rep.kind() == STRING)
                    .map(|word| Value::Words(vec![word]))
            }
            (INT, true) => return self.ints(rep).map(Value::Ints),
            (INT, false) => {
                let bytes = match rep.is_inlined() {
                    true => rep.inlined(),
                    false => self.scalar(rep)?,
                };
                Ok(Value::Ints(vec![i32::from_le_bytes(bytes)]))
            }
            (DOUBLE_VECTOR, _) | (DOUBLE, true) => {
                let doubles = self.floats(rep, f64::from_le_bytes, f64::from)?;
                Ok(Value::Doubles(1, doubles))
            }
            (FLOAT, true) => {
                let singles = self.floats(rep, f32::from_le_bytes, |i| i as f32)?;
                Ok(Value::Singles(1, singles))
            }
            (HALF, true) => {
                let singles = self.floats(rep, half, |i| i as f32)?;
                Ok(Value::Singles(1, singles))
            }
            _ => return self.vectors(rep),
        };
        value.map_err(bad)
    }

    /// Reads numbers that are not compressed: scalars, vectors, quaternions and matrices.
    fn vectors(&mut self, rep: Rep) -> Result<Value> {
        use kind::*;
        let (n, bytes) = match rep.kind() {
            HALF => (1, 2),
            FLOAT => (1, 4),
            DOUBLE => (1, 8),
            VEC3H => (3, 2),
            VEC3F => (3, 4),
            VEC3D => (3, 8),
            QUATH => (4, 2),
            QUATF => (4, 4),
            QUATD => (4, 8),
            MATRIX4D => (16, 8),
            other => {
                let what = format!("values of type number {other}");
                return Err(Error::unsupported(FORMAT, what));
            }
        };
        if rep.is_inlined() && !rep.is_array() {
            return Ok(inlined(rep, n, bytes));
        }
        let (count, at) = match rep.is_array() {
            true => self.array(rep)?,
            false => (1, rep.payload()),
        };
        let numbers = count.saturating_mul(n as u64);
        let data = self.input.bytes(at, numbers.saturating_mul(bytes))?;
        let mut value = match bytes {
            2 => Value::Singles(n, data.as_chunks().0.iter().map(|&b| half(b)).collect()),
            4 => {
                let numbers = data.as_chunks().0.iter();
                Value::Singles(n, numbers.map(|&b| f32::from_le_bytes(b)).collect())
            }
            _ => {
                let numbers = data.as_chunks().0.iter();
                Value::Doubles(n, numbers.map(|&b| f64::from_le_bytes(b)).collect())
            }
        };
        // Quaternions are stored with their real part last.
        if n == 4 {
            match &mut value {
                Value::Singles(_, v) => v.as_chunks_mut::<4>().0.iter_mut().for_each(real_first),
                Value::Doubles(_, v) => v.as_chunks_mut::<4>().0.iter_mut().for_each(real_first),
                _ => {}
            }
        }
        Ok(value)
    }

    fn scalar<const N: usize>(&mut self, rep: Rep) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.read(rep.payload(), &mut bytes)?;
        Ok(bytes)
    }

    /// Returns the number of elements of an array, and the position of the first one.
    fn array(&mut self, rep: Rep) -> Result<(u64, u64)> {
        let mut at = rep.payload();
        // An empty array has no place in the file.
        if at == 0 {
            return Ok((0, 0));
        }
        // Old versions also store the number of dimensions.
        if self.version < 5 {
            at += 4;
        }
        if self.version < 7 {
            let mut count = [0; 4];
            self.input.read(at, &mut count)?;
            return Ok((u32::from_le_bytes(count).into(), at + 4));
        }
        Ok((self.input.u64_at(at)?, at + 8))
    }

    /// Returns the maximum number of paths, fields and integers of an array. Each path needs bytes
    /// for its name or its values, each integer those of the points that it counts.
    pub fn limit(&self) -> u64 {
        self.input.len() / 2
    }

    fn is_compressed(&self, rep: Rep, count: u64, since: u8) -> bool {
        self.version >= since && rep.is_compressed() && count >= COMPRESSED_FROM
    }

    /// Reads the compressed integers from `at` on: their number of bytes, and these.
    fn packed(&mut self, at: u64, count: u64) -> Result<Vec<i32>> {
        let size = self.input.u64_at(at)?;
        let block = self.input.bytes(at + 8, size)?;
        integers(&block, count, self.limit())
            .map_err(|what| Error::format(FORMAT, format_args!("byte {at}"), what))
    }

    fn ints(&mut self, rep: Rep) -> Result<Vec<i32>> {
        let (count, at) = self.array(rep)?;
        if self.is_compressed(rep, count, 5) {
            return self.packed(at, count);
        }
        let data = self.input.bytes(at, count.saturating_mul(4))?;
        let ints = data.as_chunks().0.iter();
        Ok(ints.map(|&b| i32::from_le_bytes(b)).collect())
    }

    /// Reads an array of numbers, which may be stored as integers or by a table of values.
    fn floats<T: Copy, const N: usize>(
        &mut self,
        rep: Rep,
        number: impl Fn([u8; N]) -> T,
        whole: impl Fn(i32) -> T,
    ) -> Result<Vec<T>> {
        let (count, at) = self.array(rep)?;
        if !self.is_compressed(rep, count, 6) {
            let data = self.input.bytes(at, count.saturating_mul(N as u64))?;
            return Ok(data.as_chunks().0.iter().map(|&b| number(b)).collect());
        }
        let bad = |what: String| Error::format(FORMAT, format_args!("byte {at}"), what);
        let mut head = [0; 5];
        self.input.read(at, &mut head)?;
        let [code, size @ ..] = head;
        if code == b'i' {
            let ints = self.packed(at + 1, count)?;
            return Ok(ints.into_iter().map(whole).collect());
        }
        if code != b't' {
            return Err(bad(format!("compressed numbers of unknown form {code}")));
        }
        let bytes = u64::from(u32::from_le_bytes(size)) * N as u64;
        let table = self.input.bytes(at + 5, bytes)?;
        let table = table.as_chunks().0;
        let indices = self.packed(at + 5 + bytes, count)?;
        let entry = |i: i32| {
            let entry = usize::try_from(i).ok().and_then(|i| table.get(i));
            let missing = || bad(format!("entry {i} of a table of {}", table.len()));
            entry.map(|&b| number(b)).ok_or_else(missing)
        };
        indices.into_iter().map(entry).collect()
    }

    /// Reads `count` tokens or strings from `at` on.
    fn words(&mut self, at: u64, count: u64, strings: bool) -> Result<Value, String> {
        let bytes = self.input.bytes(at, count.saturating_mul(4));
        let bytes = bytes.map_err(|e| e.to_string())?;
        let indices = bytes.as_chunks().0.iter();
        let word = |&b: &[u8; 4]| self.word(u32::from_le_bytes(b), strings);
        indices
            .map(word)
            .collect::<Result<_, _>>()
            .map(Value::Words)
    }

    fn word(&self, index: u32, string: bool) -> Result<String, String> {
        let token = match string {
            false => index,
            true => {
                let token = self.tokens.strings.get(index as usize);
                *token.ok_or_else(|| format!("string {index} of {}", self.tokens.strings.len()))?
            }
        };
        self.tokens.word(token).map(str::to_owned)
    }

    /// Reads times and values of an attribute. Attributes with the same ones share them.
    pub fn samples(&mut self, rep: Rep) -> Result<Samples> {
        if let Some(known) = self.samples.get(&rep.0) {
            return Ok(known.clone());
        }
        let samples = self.new_samples(rep)?;
        // Each value takes eight bytes, and those that are shared are read once.
        self.sampled += samples.len() as u64;
        if self.sampled > self.input.len() / 8 {
            let what = format!("more than {} time samples", self.input.len() / 8);
            return Err(Error::format(FORMAT, rep.place(), what));
        }
        self.samples.insert(rep.0, samples.clone());
        Ok(samples)
    }

    fn new_samples(&mut self, rep: Rep) -> Result<Samples> {
        let bad = |what: String| Error::format(FORMAT, rep.place(), what);
        if rep.kind() != kind::TIME_SAMPLES || rep.is_inlined() {
            return Err(bad("expected time samples".into()));
        }
        // A distance to the times, and after these one to the values.
        let at = self.jump(rep.payload())?;
        let times = match self.input.u64_at(at).and_then(|rep| self.value(Rep(rep)))? {
            Value::Doubles(1, times) => times,
            other => return Err(bad(format!("{}, expected times", other.describe()))),
        };
        let at = self.jump(at + 8)?;
        let count = self.input.u64_at(at)?;
        if count != times.len() as u64 {
            let times = times.len();
            return Err(bad(format!("{count} values for {times} times")));
        }
        let reps = self.input.bytes(at + 8, count * 8)?;
        let reps = reps
            .as_chunks()
            .0
            .iter()
            .map(|&b| Place(u64::from_le_bytes(b)));
        let samples = times.into_iter().zip(reps).collect::<Vec<_>>();
        super::layer::check_times(&samples).map_err(bad)?;
        Ok(samples.into())
    }

    /// Follows the distance that is stored at `at`.
    fn jump(&mut self, at: u64) -> Result<u64> {
        let distance = self.input.u64_at(at)? as i64;
        let to = at.checked_add_signed(distance);
        to.ok_or_else(|| {
            let what = format!("a jump by {distance} bytes");
            Error::format(FORMAT, format_args!("byte {at}"), what)
        })
    }
}

fn real_first<T>(xyzw: &mut [T; 4]) {
    xyzw.rotate_right(1);
}

/// Returns a value that is stored in place of its position: whole numbers of a byte, on the
/// diagonal if it is a matrix, or a single number.
fn inlined(rep: Rep, n: usize, bytes: u64) -> Value {
    let raw = rep.inlined();
    let whole = |k: usize| i8::from_le_bytes([raw[k]]);
    match (n, bytes) {
        (1, 2) => Value::Singles(1, vec![half([raw[0], raw[1]])]),
        // Single precision represents these doubles exactly.
        (1, 8) => Value::Doubles(1, vec![f32::from_le_bytes(raw).into()]),
        (1, _) => Value::Singles(1, vec![f32::from_le_bytes(raw)]),
        (16, _) => {
            let mut matrix = vec![0.0; 16];
            (0..4).for_each(|k| matrix[5 * k] = whole(k).into());
            Value::Doubles(16, matrix)
        }
        (_, 8) => Value::Doubles(n, (0..n).map(|k| whole(k).into()).collect()),
        _ => Value::Singles(n, (0..n).map(|k| whole(k).into()).collect()),
    }
}
