//! Frames of files as one motion, closed and unwrapped.

use super::cell_args::{CellArgs, Cells};
use super::recorded;
use super::sequence::{Frame, Sequence};
use linkwatch::formats::ReadOptions;
use linkwatch::{LeftOut, Result};
use std::path::PathBuf;

/// Frames of one motion, with the cell that the user chose, and curves that are closed and
/// unwrapped.
pub struct Motion {
    pub sequence: Sequence,
    /// Number of the only file among those of a recorded run.
    pub part: Option<u32>,
    cells: Cells,
}

impl Motion {
    /// Prepares to read files, which [`input::expand`](super::input::expand) returned.
    pub fn new(files: &[PathBuf], options: ReadOptions) -> Result<Motion> {
        let part = match files {
            [one] => recorded::part(one).map(|part| part.number),
            _ => None,
        };
        Ok(Motion {
            part,
            cells: Cells::new(CellArgs::of(&options)),
            sequence: Sequence::new(files, options)?,
        })
    }

    fn settled(&mut self, mut frame: Frame) -> Result<Frame> {
        if frame.begins_run {
            return Err(usage!(
                "{}: this file and one before it have several frames each, so they may be runs of \
                 their own: convert each alone, or give --one-motion",
                frame.path.display()
            ));
        }
        let settle = |set| self.cells.settle(set, &frame.info);
        frame.curves = frame.curves.and_then(settle);
        self.cells.say(&frame.name);
        frame.info.cell = self.cells.args.cell(frame.info.cell);
        Ok(frame)
    }
}

impl Iterator for Motion {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Result<Frame>> {
        let frame = self.sequence.next()?;
        Some(frame.and_then(|frame| self.settled(frame)))
    }
}

/// Counts the gap before a frame, if there is one. Gaps in a recording are cuts of the motion.
pub fn cut_at_gaps(frame: &mut Frame, gaps: &mut Vec<LeftOut>) {
    if frame.after_gap {
        let kind = ["gap in a recording", "gaps in a recording"];
        LeftOut::add(gaps, kind, || frame.name.clone());
    }
    let count: u64 = gaps.iter().map(|gap| gap.count).sum();
    frame.info.cuts = frame.info.cuts.wrapping_add(count as u32);
    frame.info.left_out.extend_from_slice(gaps);
}
