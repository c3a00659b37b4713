//! Arrays of NumPy: `.npy`, one array of positions, and `.npz`, a zip archive of named arrays.
//!
//! | shape of the positions | content |
//! |---|---|
//! | frames x points x 3 | the points of all curves, one after the other; needs counts |
//! | points x 3 | the same, of one frame |
//! | frames x curves x points x 3 | curves of equal numbers of points |
//!
//! Counts are the numbers of points of the curves, negative for closed ones: an option
//! ([`ReadOptions::counts`], which has precedence) or the array `counts`. Without them the first
//! two shapes are refused: taken as a single curve, many curves would look unlinked. The curves of
//! the third shape are closed, unless that takes a long segment.
//!
//! Arrays of an `.npz` file; all but `positions` are optional:
//!
//! | name | shape | content |
//! |---|---|---|
//! | `positions` | see above | f4 or f8 |
//! | `counts` | curves | integers |
//! | `basis` | none | `polyline`, `catmull-rom`, `b-spline` or `bezier`, or its index 0 to 3 |
//! | `times` | frames | times in seconds |
//! | `seq` | frames | numbers of the frames, increasing; otherwise they are counted from 0 |
//! | `cuts` | frames | integers: times so far that the simulator rolled back or jumped |
//! | `names` | curves | texts |
//! | `radii` | curves | radii of the strands |
//! | `cell` | 3, 3 x 3 or 4 x 3, or frames x these | lengths |
//! | `left_out` | any number | texts: elements that the writer of the archive did not convert |
//!
//! The cell is periodic: its edges along the axes, its vectors, or its vectors and its corner;
//! zeros stand for a direction without repetition. The shapes 3 x 3 and 4 x 3 are those of one cell
//! for all frames, also if there are 3 or 4 frames; then a cell whose numbers are all positive is
//! refused, because it looks like edges of each frame.
//!
//! Arrays of other names are ignored, unless they may hold points (two or more rows of three
//! floats, or pickled objects), and no vectors by their names, or a cell of another name
//! (`box`, `lattice`, ..): then they are counted as left out.
//!
//! Times, radii and cells are f4, f8 or integers of at most 2^53. Arrays in Fortran order, of other
//! types, and of pickled objects are refused.
//!
//! Cost: one pass, with the memory of a frame. The checksum of a compressed or stored array is
//! compared when its end is reached: a damaged file ends with an error in place of its last frame.

mod archive;
mod array;
mod frames;
mod labels;
mod write;

pub(super) use self::write::{NpzFile, Stream};

use self::array::Array;
use self::frames::ArrayFrames;
use super::frames::{ReadOptions, Source};
use super::{Input, open_file};
use crate::curve::{Basis, Cell, CurveLabels};
use crate::error::{Error, Result};
use crate::verdict::LeftOut;
use rawzip::{FileReader, ReaderAt};
use std::path::Path;
use std::sync::Arc;

const FORMAT: &str = "NumPy file";
/// Bytes that a frame may have at any compression.
const FREE_FRAME: u64 = 64 << 20;

/// Reads the header of an `.npy` file.
pub(super) fn read_npy<'a>(mut input: Input<'a>, options: &ReadOptions) -> Result<Source<'a>> {
    let positions = Array::parse(&mut input.bytes, input.len, "positions")?;
    let others = Others::default();
    let frames = ArrayFrames::new(input.bytes, positions, others, options, u64::MAX)?;
    Ok(Box::new(frames))
}

/// Opens an `.npz` file.
pub(super) fn open_npz(path: &Path, options: &ReadOptions) -> Result<Source<'static>> {
    let (file, len) = open_file(path)?;
    read_npz(FileReader::from(file), len, options)
}

/// Reads the arrays of an `.npz` file of this length, up to the positions of the first frame.
pub(super) fn read_npz<'a>(
    file: impl ReaderAt + Send + Sync + 'a,
    len: u64,
    options: &ReadOptions,
) -> Result<Source<'a>> {
    let archive = archive::Archive::open(file, len)?;
    let mut others = labels::read(&archive)?;
    others.left_out = labels::left_out(&archive, options.cell.is_some())?;
    let Some(member) = archive.find("positions") else {
        let found = archive.names().take(8).collect::<Vec<_>>().join(", ");
        let what = format!("no array `positions`; the file has: {found}");
        return Err(Error::format(FORMAT, "whole file", what));
    };
    let mut input = archive.content(member)?;
    let positions = Array::parse(&mut input, member.size(), "positions")?;
    let frames = ArrayFrames::new(input, positions, others, options, member.limit(FREE_FRAME))?;
    Ok(Box::new(frames))
}

/// Optional content of a file besides the positions.
#[derive(Default)]
struct Others {
    counts: Option<Vec<i32>>,
    basis: Option<Basis>,
    times: Option<Vec<f64>>,
    seq: Option<Vec<u64>>,
    cuts: Option<Vec<u32>>,
    labels: Arc<CurveLabels>,
    cells: Option<Cells>,
    /// Number of frames for which the cell may be meant as one row of edges each.
    rows_of_edges: Option<u64>,
    left_out: Vec<LeftOut>,
}

/// Periodic cells of the frames.
enum Cells {
    /// One cell for all frames.
    One(Cell),
    /// A cell for each frame.
    Each(Vec<Cell>),
}

#[cfg(test)]
mod tests;
