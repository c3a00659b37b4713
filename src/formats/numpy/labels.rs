//! The small arrays of an `.npz` file: counts, basis, times, names, radii and cells.

use super::archive::Archive;
use super::array::{Array, Kind};
use super::{Cells, FORMAT, Others};
use crate::curve::{Basis, Cell, CurveLabels, Point};
use crate::error::{Error, Result};
use crate::formats::lines::is_in;
use crate::formats::{little_endian, quote};
use crate::verdict::LeftOut;
use rawzip::ReaderAt;

/// Bytes that an array of numbers, and one of texts, may have at any compression. A text takes many
/// times its bytes.
const FREE_NUMBERS: u64 = 16 << 20;
const FREE_TEXTS: u64 = 1 << 20;

/// Names of the arrays that are read.
const READ: &str = "\
    positions counts basis times seq cuts names radii cell left_out";

/// Names of arrays of vectors that are no points.
const VECTORS: &str = "\
    acceleration accelerations angular_velocities angular_velocity color colors colours directors \
    force forces normals origin tangents torques velocities velocity vel";

/// Names of arrays that other programs give to a periodic cell, in lower case.
const CELLS: &str = "\
    box box_length box_lengths box_size box_vectors boxes boxsize cells cell_vectors dimensions \
    lattice unit_cell unitcell";

/// Returns what the writer of the archive left out, and counts the arrays of other names that may
/// hold points of curves, or a cell if `has_cell` is false.
pub(super) fn left_out(
    archive: &Archive<impl ReaderAt + Send + Sync>,
    has_cell: bool,
) -> Result<Vec<LeftOut>> {
    let mut list = Vec::new();
    if let Some(said) = Values::find(archive, "left_out")? {
        for text in said.texts()? {
            let kind = [
                "kind of elements that the archive leaves out",
                "kinds of elements that the archive leaves out",
            ];
            LeftOut::add(&mut list, kind, || text);
        }
    }
    let has_cell = has_cell || archive.find("cell").is_some();
    for member in archive.others(&[READ, VECTORS]) {
        let name = &member.name;
        let lower = name.to_ascii_lowercase();
        // An error if it is no array, or of a kind that is not read.
        let array = Array::parse(&mut archive.content(member)?, member.size(), name);
        if is_in(CELLS, &lower) {
            if !has_cell && array.is_ok_and(|array| may_be_cell(&lower, &array)) {
                let kind = [
                    "array that may be a periodic cell, which is read from an array `cell`",
                    "arrays that may be periodic cells, which are read from an array `cell`",
                ];
                LeftOut::add(&mut list, kind, || name.clone());
            }
            continue;
        }
        let what = match array {
            Ok(array) if may_hold_points(&array) => {
                format!("{name}, {} of type {}", array.shape_text(), array.descr)
            }
            // Pickled objects may be lists of curves.
            Err(e @ Error::Unsupported { .. }) => e.to_string(),
            _ => continue,
        };
        let kind = [
            "array of an unknown name that may hold points",
            "arrays of unknown names that may hold points",
        ];
        LeftOut::add(&mut list, kind, || what);
    }
    Ok(list)
}

/// Returns true if an array of the name of a cell has the shape of one, or of one in each frame.
/// Integers may also be sizes of a grid, and connect points.
fn may_be_cell(name: &str, array: &Array) -> bool {
    let is_box = name.starts_with("box");
    let is_cell = |shape: &[u64]| matches!(shape, [3 | 6 | 9] | [3 | 4, 3]);
    let fits = match &array.shape[..] {
        [] => is_box,
        shape => is_cell(shape) || is_cell(&shape[1..]),
    };
    fits && match array.kind {
        Kind::Float => true,
        Kind::Signed | Kind::Unsigned => is_box,
        _ => false,
    }
}

/// Returns true if an array has the shape of two or more points.
fn may_hold_points(array: &Array) -> bool {
    match array.shape.split_last() {
        Some((3, sizes)) => array.kind == Kind::Float && sizes.iter().product::<u64>() > 1,
        _ => false,
    }
}

/// Reads the arrays of these names that a file has.
pub(super) fn read(archive: &Archive<impl ReaderAt + Send + Sync>) -> Result<Others> {
    let find = |name| Values::find(archive, name);
    let (counts, basis) = (find("counts")?, find("basis")?);
    let (times, seq, cuts) = (find("times")?, find("seq")?, find("cuts")?);
    let (names, radii, cell) = (find("names")?, find("radii")?, find("cell")?);
    let rows_of_edges = cell.as_ref().and_then(Values::rows_of_edges);
    let floats = |values: Values| values.floats();
    let radii = radii.map(floats).transpose()?.unwrap_or_default();
    Ok(Others {
        counts: counts.map(|counts| counts.integers()).transpose()?,
        basis: basis.map(|basis| basis.basis()).transpose()?,
        times: times.map(floats).transpose()?,
        seq: seq.map(|seq| seq.increasing()).transpose()?,
        cuts: cuts.map(|cuts| cuts.integers()).transpose()?,
        labels: CurveLabels::named(names.map_or(Ok(Vec::new()), |names| names.texts())?)
            .with_radii(radii.into_iter().map(|r| r as f32))
            .into(),
        cells: cell.map(|cell| cell.cells()).transpose()?,
        rows_of_edges,
        left_out: Vec::new(),
    })
}

/// Values of an array of one dimension, or of none; of a cell, of up to three.
struct Values {
    name: &'static str,
    array: Array,
    /// Bytes of the values, in little-endian order.
    bytes: Vec<u8>,
}

impl Values {
    fn find(
        archive: &Archive<impl ReaderAt + Send + Sync>,
        name: &'static str,
    ) -> Result<Option<Values>> {
        let Some(member) = archive.find(name) else {
            return Ok(None);
        };
        let free = match name {
            "names" | "left_out" => FREE_TEXTS,
            _ => FREE_NUMBERS,
        };
        let mut bytes = archive.read(member, free)?;
        let mut content = &bytes[..];
        let array = Array::parse(&mut content, member.size(), name)?;
        let header = bytes.len() - content.len();
        bytes.drain(..header);
        array.to_little_endian(&mut bytes);
        let values = Values { name, array, bytes };
        let most = if name == "cell" { 3 } else { 1 };
        match values.array.shape.len() {
            // Without bytes a value would have any number of them.
            dimensions if dimensions <= most && values.array.size > 0 => Ok(Some(values)),
            _ => Err(values.bad(format_args!("{} values", values.array.shape_text()))),
        }
    }

    fn bad(&self, what: impl std::fmt::Display) -> Error {
        Error::format(FORMAT, format_args!("array {}", self.name), what)
    }

    fn wrong_type(&self, expected: &str) -> Error {
        let found = &self.array.descr;
        self.bad(format_args!("type {found}, expected {expected}"))
    }

    /// Returns the bytes of each value.
    fn each(&self) -> impl Iterator<Item = &[u8]> {
        self.bytes.chunks_exact(self.array.size as usize)
    }

    /// Returns the integers, which must fit into `T`.
    fn integers<T: TryFrom<i128>>(&self) -> Result<Vec<T>> {
        let kind = self.array.kind;
        if !matches!(kind, Kind::Signed | Kind::Unsigned) || self.array.size > 8 {
            return Err(self.wrong_type("integers"));
        }
        let integers = self.each().map(|bytes| {
            let value = i128::from(little_endian(bytes));
            let range = 1 << (8 * bytes.len());
            let is_negative = kind == Kind::Signed && value >= range / 2;
            let value = if is_negative { value - range } else { value };
            T::try_from(value).map_err(|_| self.bad(format_args!("{value} is out of range")))
        });
        integers.collect()
    }

    /// Returns the numbers of frames.
    fn increasing(&self) -> Result<Vec<u64>> {
        let numbers: Vec<u64> = self.integers()?;
        match numbers.array_windows().find(|[a, b]| a >= b) {
            Some([a, b]) => Err(self.bad(format_args!("frame {b} after frame {a}"))),
            None => Ok(numbers),
        }
    }

    fn floats(&self) -> Result<Vec<f64>> {
        if matches!(self.array.kind, Kind::Signed | Kind::Unsigned) {
            let exact = |k: i64| match k.unsigned_abs() <= 1 << f64::MANTISSA_DIGITS {
                true => Ok(k as f64),
                false => Err(self.bad(format_args!("{k} is out of range"))),
            };
            return self.integers()?.into_iter().map(exact).collect();
        }
        let value = |bytes: &[u8]| match *bytes {
            [a, b, c, d] => Some(f32::from_le_bytes([a, b, c, d]).into()),
            _ => Some(f64::from_le_bytes(bytes.try_into().ok()?)),
        };
        let values: Option<Vec<f64>> = self.each().map(value).collect();
        let values = values.filter(|_| self.array.kind == Kind::Float);
        let values = values.ok_or_else(|| self.wrong_type("f4, f8 or integers"))?;
        match values.iter().position(|x| !x.is_finite()) {
            Some(k) => Err(self.bad(format_args!("value {k} is {}", values[k]))),
            None => Ok(values),
        }
    }

    /// Returns the number of rows of a cell that may also be edges of as many frames.
    fn rows_of_edges(&self) -> Option<u64> {
        let [rows @ (3 | 4), 3] = self.array.shape[..] else {
            return None;
        };
        let is_positive = self.floats().ok()?.iter().all(|&x| x > 0.0);
        is_positive.then_some(rows)
    }

    /// Returns a cell for all frames, or for each one.
    fn cells(&self) -> Result<Cells> {
        let numbers = self.floats()?;
        let (rows, one) = match self.array.shape[..] {
            [3] => (1, true),
            [rows @ (3 | 4), 3] => (rows, true),
            [_, 3] => (1, false),
            [_, rows @ (3 | 4), 3] => (rows, false),
            _ => {
                let what = format!(
                    "shape {}, expected 3 (edges along the axes), 3 x 3 (vectors), 4 x 3 (vectors \
                     and the corner), or frames x one of these",
                    self.array.shape_text()
                );
                return Err(self.bad(what));
            }
        };
        let points: &[Point] = numbers.as_chunks().0;
        let cell = |(k, rows): (usize, &[Point])| {
            let cell = match *rows {
                [edges] => Cell::orthogonal([0.0; 3], edges),
                [a, b, c, ref corner @ ..] => Cell {
                    origin: corner.first().copied().unwrap_or_default(),
                    vectors: [a, b, c],
                },
                _ => unreachable!("one, three or four rows"),
            };
            let checked = cell.check().map(|()| cell);
            checked.map_err(|e| self.bad(format_args!("cell {k}: {e}")))
        };
        let cells = points.chunks_exact(rows as usize).enumerate().map(cell);
        match (cells.collect::<Result<Vec<_>>>()?, one) {
            (cells, false) => Ok(Cells::Each(cells)),
            (cells, true) => Ok(Cells::One(cells[0])),
        }
    }

    fn texts(&self) -> Result<Vec<String>> {
        let text = |bytes: &[u8]| -> Option<String> {
            match self.array.kind {
                Kind::Bytes => String::from_utf8(bytes.to_vec()).ok(),
                Kind::Text => (bytes.as_chunks().0.iter())
                    .map(|&b| char::from_u32(u32::from_le_bytes(b)))
                    .collect(),
                _ => None,
            }
        };
        let texts = self.each().map(|bytes| {
            // Shorter texts are filled up.
            let text = text(bytes)?;
            Some(text.trim_end_matches('\0').to_owned())
        });
        let texts: Option<Vec<String>> = texts.collect();
        texts.ok_or_else(|| self.wrong_type("texts"))
    }

    fn basis(&self) -> Result<Basis> {
        let expected = "expected polyline, catmull-rom, b-spline or bezier, or 0 to 3";
        if matches!(self.array.kind, Kind::Signed | Kind::Unsigned) {
            return match self.integers::<usize>()?[..] {
                [code] if code < Basis::ALL.len() => Ok(Basis::ALL[code]),
                ref other => Err(self.bad(format_args!("{other:?}, {expected}"))),
            };
        }
        let texts = self.texts()?;
        let found = match &texts[..] {
            [name] => name.parse().ok(),
            _ => None,
        };
        let given = quote(texts.join(", ").as_bytes());
        found.ok_or_else(|| self.bad(format_args!("{given}, {expected}")))
    }
}
