//! Frames of a source, ready to be published.

use super::Args;
use super::answers::Answers;
use crate::cli::range::Range;
use crate::cli::source::{Frame, Item, Source};
use linkwatch::{Basis, CurveLabels, FrameInfo, Positions, Precision, RawFrame, Result};
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames of the source within the range. Recorded verdicts go to the comparison.
pub struct Frames {
    pub source: Source,
    range: Range,
    before: VecDeque<Item>,
    /// True if the source has verdicts.
    pub has_verdicts: bool,
}

impl Frames {
    pub fn new(args: &Args, mut source: Source) -> Result<Frames> {
        let mut before = VecDeque::new();
        let mut frames = 0;
        // A verdict follows its frame, if there are verdicts.
        while frames < 2 && !matches!(before.back(), Some(Item::Verdict(_))) {
            let Some(item) = source.next()? else { break };
            frames += u32::from(matches!(item, Item::Frame(_)));
            before.push_back(item);
        }
        let has_verdicts = matches!(before.back(), Some(Item::Verdict(_)));
        if args.range.from.is_some() && source.go_to_start(&args.range)?.is_some() {
            before.clear();
        }
        Ok(Frames {
            source,
            range: args.range,
            before,
            has_verdicts,
        })
    }

    /// Returns the next frame of the range.
    pub fn next(&mut self, answers: &mut Answers) -> Result<Option<Frame>> {
        loop {
            let item = match self.before.pop_front() {
                Some(item) => Some(item),
                None => self.source.next()?,
            };
            match item {
                None => return Ok(None),
                Some(Item::Baseline(_)) => {}
                Some(Item::Verdict(recorded)) => {
                    let report = &recorded.report;
                    if self.range.contains(report.seq, report.time) {
                        answers.recorded(report);
                    }
                }
                Some(Item::Frame(frame)) if self.range.is_before(frame.seq, frame.time) => {
                    return Ok(None);
                }
                Some(Item::Frame(frame)) if self.range.is_after(frame.seq, frame.time) => {}
                Some(Item::Frame(frame)) => return Ok(Some(*frame)),
            }
        }
    }
}

/// Curves that were described last.
#[derive(PartialEq)]
pub struct Described {
    pub basis: Basis,
    pub precision: Precision,
    pub counts: Vec<i32>,
    pub labels: Arc<CurveLabels>,
}

/// A frame in memory, ready to be published.
pub struct Ready {
    pub seq: u64,
    pub time: f64,
    received_ns: Option<u64>,
    pub info: FrameInfo,
    pub described: Described,
    pub positions: Values,
}

pub enum Values {
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Ready {
    pub fn new(frame: Frame) -> Result<Ready> {
        let Frame {
            seq,
            time,
            received_ns,
            ..
        } = frame;
        let info = frame.info.clone();
        let mut copied = None;
        frame.read(|raw: RawFrame<'_>| {
            let positions = match raw.positions {
                Positions::F32(values) => Values::F32(values.to_vec()),
                Positions::F64(values) => Values::F64(values.to_vec()),
            };
            let described = Described {
                basis: raw.basis,
                precision: raw.positions.precision(),
                counts: raw.counts.to_vec(),
                labels: Arc::clone(&info.labels),
            };
            copied = Some((described, positions));
            Ok(())
        })?;
        let (described, positions) = copied.expect("the frame was read");
        Ok(Ready {
            seq,
            time,
            received_ns,
            info,
            described,
            positions,
        })
    }

    /// Returns the time for its pace, in seconds: that of its receipt, or of the simulation.
    pub fn recorded(&self) -> f64 {
        match self.received_ns {
            Some(ns) => ns as f64 * 1e-9,
            None => self.time,
        }
    }
}
