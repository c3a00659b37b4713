//! Frames of an array of positions.

use super::array::{Array, Kind, fill};
use super::{Cells, FORMAT, Others};
use crate::curve::{Basis, CurveSet, CurveSetBuilder, Precision, count_of};
use crate::error::{Error, Result};
use crate::formats::frames::{FrameSource, ModelFrame, ReadOptions};
use crate::formats::with_positions;
use crate::ingest::FrameInfo;
use std::io::Read;
use std::sync::Arc;

/// Reader of the frames.
pub(super) struct ArrayFrames<R> {
    input: R,
    array: Array,
    layout: Layout,
    next: u64,
    others: Others,
    options: ReadOptions,
}

/// Number of points that are read at once. A frame may have gigabytes, so only the set holds all of
/// it.
const CHUNK: usize = 4096;

/// Division of the positions into frames and curves.
struct Layout {
    frames: u64,
    frame_bytes: usize,
    counts: Vec<i32>,
    /// True if nothing says which curves are closed.
    closed_by_default: bool,
}

fn bad(what: impl std::fmt::Display) -> Error {
    Error::format(FORMAT, "array positions", what)
}

impl Layout {
    /// Divides the points of a frame into curves: by `counts`, or else into equal closed curves. A
    /// frame may have at most `limit` bytes.
    fn new(positions: &Array, counts: Option<Vec<i32>>, limit: u64) -> Result<Layout> {
        let shape = positions.shape_text();
        let supported = "frames x points x 3, points x 3 or frames x curves x points x 3";
        let [frames, curves, points] = match (positions.shape.split_last(), &counts) {
            (Some((3, &[points])), Some(_)) => [1, 1, points],
            (Some((3, &[frames, points])), Some(_)) => [frames, 1, points],
            (Some((3, &[frames, curves, points])), _) => [frames, curves, points],
            (Some((3, [_] | [_, _])), None) => {
                let what = format!(
                    "positions of shape {shape} do not say which points belong to one curve: give \
                     the numbers of points of the curves, negative if closed (option `counts`, or \
                     an array `counts` in an .npz), or the shape frames x curves x points x 3 for \
                     equal closed curves"
                );
                return Err(Error::unsupported(FORMAT, what));
            }
            _ => {
                let what = format!("positions of shape {shape}; supported are {supported}");
                return Err(Error::unsupported(FORMAT, what));
            }
        };
        if frames == 0 {
            return Err(bad(format_args!("shape {shape}, which has no frames")));
        }
        // Limited, so that the size of a frame in bytes does not overflow.
        const MOST: u64 = u32::MAX as u64;
        let Some(all @ 1..=MOST) = curves.checked_mul(points) else {
            let what = format!("shape {shape}, expected 1 to {MOST} points in a frame");
            return Err(bad(what));
        };
        let frame_bytes = 3 * all * positions.size;
        if frame_bytes > limit {
            return Err(bad(format_args!(
                "frames of {frame_bytes} bytes, which is more than 64 MiB and 100 times the \
                 compressed size: store them without compression (`np.savez`)"
            )));
        }
        let closed_by_default = counts.is_none();
        let counts = match counts {
            Some(counts) => counts,
            None => vec![count_of(points as usize, true)?; curves as usize],
        };
        let sizes = counts.iter().map(|c| u64::from(c.unsigned_abs()));
        let sum: u64 = sizes.clone().sum();
        let four_dimensions = positions.shape.len() == 4;
        if sum != all || (four_dimensions && !sizes.into_iter().all(|n| n == points)) {
            let n = counts.len();
            let what = format!("shape {shape} does not fit {n} curves with {sum} points");
            return Err(bad(what));
        }
        Ok(Layout {
            frames,
            frame_bytes: usize::try_from(frame_bytes)
                .map_err(|_| Error::count("bytes of a frame", frame_bytes, usize::MAX))?,
            counts,
            closed_by_default,
        })
    }
}

/// Fails if there is not one value for each frame.
fn check_length<T>(name: &str, values: Option<&Vec<T>>, frames: u64) -> Result<()> {
    match values {
        Some(values) if values.len() as u64 != frames => {
            let what = format!("{} values for {frames} frames", values.len());
            Err(Error::format(FORMAT, format_args!("array {name}"), what))
        }
        _ => Ok(()),
    }
}

impl<R: Read> ArrayFrames<R> {
    /// Starts before the first frame. A frame may have at most `limit` bytes.
    pub fn new(
        input: R,
        positions: Array,
        mut others: Others,
        options: &ReadOptions,
        limit: u64,
    ) -> Result<Self> {
        if positions.kind != Kind::Float || !matches!(positions.size, 4 | 8) {
            let found = &positions.descr;
            let what =
                format!("positions of type {found}; convert them with `.astype(np.float64)`");
            return Err(Error::unsupported(FORMAT, what));
        }
        let counts = options.counts.clone().or(others.counts.take());
        let layout = Layout::new(&positions, counts, limit)?;
        others.labels.check(layout.counts.len())?;
        check_length("times", others.times.as_ref(), layout.frames)?;
        check_length("seq", others.seq.as_ref(), layout.frames)?;
        check_length("cuts", others.cuts.as_ref(), layout.frames)?;
        if let Some(Cells::Each(cells)) = &others.cells {
            check_length("cell", Some(cells), layout.frames)?;
        }
        if let Some(n) = others.rows_of_edges.filter(|&n| n == layout.frames) {
            let what = format!(
                "shape {n} x 3 with {n} frames: edges of each frame, or one cell; write \
                 {n} x {n} x 3 (a cell for each frame)"
            );
            return Err(Error::format(FORMAT, "array cell", what));
        }
        Ok(ArrayFrames {
            input,
            array: positions,
            layout,
            next: 0,
            others,
            options: options.clone(),
        })
    }

    /// Reads a frame to its end, also if its curves are invalid.
    fn curves(&mut self) -> Result<Result<CurveSet>> {
        let precision = match self.array.size {
            8 => Precision::F64,
            _ => Precision::F32,
        };
        let basis = self.others.basis.unwrap_or(Basis::Polyline);
        let mut built = CurveSet::builder_of(basis, precision, &self.layout.counts);
        let mut left = self.layout.frame_bytes;
        while left > 0 {
            let bytes = left.min(3 * CHUNK * precision.bytes());
            left -= bytes;
            let place = format_args!("frame {}", self.next);
            let mut chunk = fill(&mut self.input, bytes, place, left as u64)?;
            self.array.to_little_endian(&mut chunk);
            built = built.and_then(|mut builder| {
                with_positions(precision, &chunk, |positions| builder.push(positions))?;
                Ok(builder)
            });
        }
        Ok(built.and_then(CurveSetBuilder::finish))
    }
}

impl<R: Read + Send> FrameSource for ArrayFrames<R> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        let frame = self.next;
        if frame == self.layout.frames {
            return Ok(None);
        }
        let curves = self.curves()?;
        self.next += 1;
        let k = frame as usize;
        let others = &self.others;
        let seq = others.seq.as_ref().map_or(frame, |seq| seq[k]);
        let time = others.times.as_ref().map_or(0.0, |times| times[k]);
        let cell = others.cells.as_ref().map(|cells| match cells {
            Cells::One(cell) => *cell,
            Cells::Each(cells) => cells[k],
        });
        let info = FrameInfo {
            cell,
            cuts: others.cuts.as_ref().map_or(0, |cuts| cuts[k]),
            labels: Arc::clone(&others.labels),
            left_out: others.left_out.clone(),
            closed_by_default: self.layout.closed_by_default,
            ..FrameInfo::at(seq, time)
        };
        let frame = ModelFrame::of(info, curves);
        Ok(Some(frame.check_torn(&self.options, FORMAT)))
    }
}
