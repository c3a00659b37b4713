//! Extended XYZ, as ASE, OVITO and others write it: frames one after the other.
//!
//! A frame has a line with the number of atoms, a comment, and a line for each atom. The comment
//! has keys with values, of which these are read, in upper or lower case:
//!
//! | key | value |
//! |---|---|
//! | `Lattice` | nine numbers: the lattice vectors, one after the other |
//! | `pbc` | three of `T` and `F`: if the frame repeats along each vector; else along all |
//! | `Origin` | the corner of the cell, as OVITO writes it; else 0 |
//! | `Properties` | `name:type:columns:..`; else `species:S:1:pos:R:3`, and others after them |
//! | `Time` | time in seconds |
//! | `Timestep` | number of the frame, increasing; else they are counted from 0 |
//!
//! The columns `pos:R:3` are the coordinates. Atoms with the same number in a column of integers
//! ([`GROUPS`]: the first that exists) are a curve, in the order of the file, or of their numbers
//! in the column `id:I:1` if there is one. The number is the name of the curve. Curves have the
//! order of their first atoms in the first frame that has them. They are closed if a column
//! `closed:L:1` says `T`, or if there is no such column
//! ([`FrameInfo::closed_by_default`](crate::FrameInfo::closed_by_default)).
//! [`ReadOptions::counts`] has precedence over these columns: then the first atoms are the first
//! curve, and so on. A file without both is refused: as a single curve, many would look
//! unlinked.
//!
//! Curves that the boundary of the cell tears are refused, unless [`ReadOptions::wrapped`].
//!
//! Cost: one pass, with the memory of a frame; sorting the atoms if they have ids.

mod atoms;
mod comment;

use self::comment::Comment;
use super::Input;
use super::frames::{FrameSource, ModelFrame, ReadOptions, Source};
use super::lines::{Lines, integer};
use crate::curve::CurveLabels;
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;
use crate::verdict::LeftOut;
use std::collections::HashMap;

const FORMAT: &str = "extended XYZ";

/// Names of the columns of integers that say to which curve an atom belongs.
const GROUPS: [&str; 6] = ["molecule", "mol", "mol-id", "molid", "resid", "chain"];

/// Returns true if a text begins as extended XYZ does: with a count, and a comment of keys.
pub(super) fn begins(text: &[u8]) -> bool {
    let mut lines = text.split(|&b| b == b'\n');
    let [count, comment] = [(); 2].map(|()| lines.next().unwrap_or_default().trim_ascii());
    let keys = comment.to_ascii_lowercase();
    let names = |key: &[u8]| keys.windows(key.len()).any(|w| w == key);
    integer::<u64>(count, "a count").is_ok() && (names(b"properties=") || names(b"lattice="))
}

/// Starts before the first frame of a file.
pub(super) fn read<'a>(input: Input<'a>, options: &ReadOptions) -> Result<Source<'a>> {
    if options.closed.is_some() {
        let what = "`closed`, which extended XYZ does not have: a column closed:L:1 has it";
        return Err(Error::unsupported("option", what));
    }
    Ok(Box::new(XyzFrames {
        lines: Lines::new(FORMAT, input)?,
        options: options.clone(),
        frames: 0,
        last: None,
        known: HashMap::new(),
    }))
}

/// Reader of the frames.
struct XyzFrames<'a> {
    lines: Lines<'a>,
    options: ReadOptions,
    /// Number of frames before the next one.
    frames: u64,
    /// Time step of the previous frame, if the file has them.
    last: Option<u64>,
    /// Numbers of the curves so far, in their order.
    known: HashMap<i64, usize>,
}

impl XyzFrames<'_> {
    /// Returns the number of the next frame.
    fn number(&mut self, step: Option<u64>) -> Result<u64, String> {
        let first = self.frames == 0;
        let last = std::mem::replace(&mut self.last, step);
        self.frames += 1;
        match (step, last) {
            (Some(step), Some(last)) if step <= last => Err(format!(
                "Timestep {step} after Timestep {last}: remove frames that are there twice"
            )),
            (Some(_), None) if !first => Err("a Timestep, which the frames before lack".into()),
            (None, Some(_)) => Err("no Timestep, which the frame before has".into()),
            (Some(step), _) => Ok(step),
            (None, None) => Ok(self.frames - 1),
        }
    }
}

impl FrameSource for XyzFrames<'_> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        if !self.lines.advance_to_text()? {
            return Ok(None);
        }
        let count = |line: &[u8]| integer(line.trim_ascii(), "the number of atoms of a frame");
        let count = self.lines.parse(count)?;
        self.lines.expect("the comment of a frame")?;
        let mut begin = || {
            let comment = Comment::parse(&self.lines.line)?;
            let is_other = self.options.cell.is_none() && comment.has_other_cell(&self.lines.line);
            let (seq, cell) = (self.number(comment.step)?, comment.cell()?);
            Ok((comment, seq, cell, is_other))
        };
        let begun = begin();
        let (comment, seq, cell, is_other) = begun.map_err(|what: String| self.lines.bad(what))?;
        let curves = self.atoms(count, &comment.columns)?;
        let mut info = FrameInfo::at(seq, comment.time);
        let curves = curves.map(|(curves, numbers)| {
            info.labels = CurveLabels::named(numbers.iter().map(i64::to_string)).into();
            curves
        });
        info.cell = cell;
        if is_other {
            let kind = [
                "cell in another form (write `Lattice`, or give the cell)",
                "cells in another form (write `Lattice`, or give the cell)",
            ];
            LeftOut::add(&mut info.left_out, kind, || format!("frame {seq}"));
        }
        info.closed_by_default = comment.columns.closed.is_none() && self.options.counts.is_none();
        let frame = ModelFrame::of(info, curves);
        Ok(Some(frame.check_torn(&self.options, FORMAT)))
    }
}

#[cfg(test)]
mod tests;
