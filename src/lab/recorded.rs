//! Motion of a recording.

use super::motion::{FrameSource, MovedFrame};
use crate::curve::{CurveSet, Received};
use crate::error::{Error, Result};
use crate::sinks::{RecordedFrame, RecordedItem, RecordingReader};
use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Frames of a recording, for a [`MotionStudy`](super::MotionStudy). Frames that break their
/// contract (a NaN) are skipped.
pub struct RecordedMotion {
    reader: RecordingReader<BufReader<File>>,
    /// The curves of the last frame.
    curves: CurveSet,
    cuts: u32,
    /// True until the first frame was returned, which is read by [`RecordedMotion::open`].
    is_first: bool,
    /// Positions of the last frame.
    positions: Received,
}

impl fmt::Debug for RecordedMotion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecordedMotion").finish_non_exhaustive()
    }
}

impl RecordedMotion {
    /// Opens a recording, and reads its first valid frame.
    ///
    /// Errors: a file that is no recording, is damaged, has no valid frame, or is of a periodic
    /// scene.
    pub fn open(path: &Path) -> Result<RecordedMotion> {
        let mut reader = RecordingReader::open(path)?;
        while let Some(frame) = next_frame(&mut reader)? {
            let mut curves = None;
            if let (Ok(()), Some(curves)) = (frame.ingest(&mut curves), curves) {
                if let Some(cell) = frame.info.cell {
                    let why = format!("of a periodic scene (cell {cell}), without its images");
                    return Err(Error::unsupported("motion", why).in_file(path));
                }
                return Ok(RecordedMotion {
                    reader,
                    positions: curves.positions().into_copy(),
                    curves,
                    cuts: frame.info.cuts,
                    is_first: true,
                });
            }
        }
        let why = "a recording without a valid frame";
        Err(Error::unsupported("motion", why).in_file(path))
    }

    /// Returns the curves of the last frame.
    pub fn curves(&self) -> &CurveSet {
        &self.curves
    }

    /// Reads the next valid frame. Returns true if it does not continue the last one, or `None` at
    /// the end.
    fn advance(&mut self) -> Result<Option<bool>> {
        let mut curves = Some(self.curves.clone());
        while let Some(frame) = next_frame(&mut self.reader)? {
            if let (Ok(()), Some(curves)) = (frame.ingest(&mut curves), &curves) {
                self.curves.clone_from(curves);
                self.positions = curves.positions().into_copy();
                let cuts = frame.info.cuts;
                let before = std::mem::replace(&mut self.cuts, cuts);
                return Ok(Some(before != cuts));
            }
        }
        Ok(None)
    }
}

/// Returns the next frame of a recording.
fn next_frame(reader: &mut RecordingReader<BufReader<File>>) -> Result<Option<RecordedFrame>> {
    while let Some(item) = reader.next_item()? {
        if let RecordedItem::Frame(frame) = item {
            return Ok(Some(frame));
        }
    }
    Ok(None)
}

impl FrameSource for RecordedMotion {
    fn next(&mut self) -> Result<Option<MovedFrame<'_>>> {
        let cut = match std::mem::take(&mut self.is_first) {
            true => false,
            false => match self.advance()? {
                Some(cut) => cut,
                None => return Ok(None),
            },
        };
        Ok(Some(MovedFrame {
            positions: self.positions.positions(),
            cut,
        }))
    }
}
