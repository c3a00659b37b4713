//! Outline of a recording: numbers, times and places of its frames, without their curves.

use super::{Channel, RecordedItem, RecordingReader, item, labels};
use crate::curve::CurveLabels;
use crate::error::Result;
use crate::sinks::recording::container::Place;
use crate::sinks::recording::messages::invalid;
use crate::verdict::Verdict;
use mcap::records::op;
use prost::bytes::Buf;
use std::io::{Read, Seek};
use std::sync::Arc;

/// A frame or a verdict in a recording, for [`RecordingReader::go_to`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct FramePlace {
    /// Sequence number of the frame.
    pub seq: u64,
    /// Simulation time of the frame, in seconds.
    pub time: f64,
    place: Place,
    /// Names and radii of its curves.
    labels: Arc<CurveLabels>,
}

impl FramePlace {
    /// Returns true if this place is before another one of the same recording.
    pub fn is_before(&self, other: &FramePlace) -> bool {
        self.place < other.place
    }
}

/// A recorded verdict in a few words.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OutlinedVerdict {
    /// Place of the verdict.
    pub at: FramePlace,
    /// The verdict.
    pub verdict: Verdict,
    /// Number of linking numbers that differ from the expected ones.
    pub changes: usize,
    /// Number of pull-throughs since the previous frame.
    pub events: usize,
}

/// Frames and verdicts of a recording, in the order of the file.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Outline {
    /// Frames with curves.
    pub frames: Vec<FramePlace>,
    /// Verdicts, also those on frames without curves.
    pub verdicts: Vec<OutlinedVerdict>,
}

impl<R: Read + Seek> RecordingReader<R> {
    /// Reads where the frames of the recording are, and its verdicts. The recording may be cut off.
    ///
    /// Curves are not read, unless chunks are compressed: the cost is a read of 64 bytes for each
    /// frame. The reader is at the end of the file afterwards; [`RecordingReader::go_to`] continues
    /// at a frame.
    ///
    /// ```
    /// use linkwatch::{RecordedItem, RecordingReader};
    ///
    /// let mut reader = RecordingReader::open("recordings/squares.mcap".as_ref())?;
    /// let outline = reader.outline()?;
    /// let last = outline.frames.last().expect("it has frames");
    /// reader.go_to(last)?;
    /// match reader.next_item()? {
    ///     Some(RecordedItem::Frame(frame)) => assert_eq!(frame.seq, last.seq),
    ///     other => panic!("{other:?}"),
    /// }
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn outline(&mut self) -> Result<Outline> {
        let outline = self.container.go_to_start().and_then(|()| self.skim());
        if outline.is_err() {
            self.container.fail();
        }
        outline
    }

    fn skim(&mut self) -> Result<Outline> {
        let mut outline = Outline::default();
        let mut current = Arc::default();
        loop {
            let channels = &self.channels;
            let whole = |id| {
                let channel = channels.get(&id);
                matches!(channel, Some(Channel::Labels | Channel::Verdicts))
            };
            let Some(record) = self.container.skim(whole)? else {
                return Ok(outline);
            };
            if record.opcode != op::MESSAGE {
                self.describe(record)?;
                continue;
            }
            let place = record.place;
            let at = |(seq, time), labels: &Arc<CurveLabels>| FramePlace {
                seq,
                time,
                place,
                labels: Arc::clone(labels),
            };
            let message = self.message(record)?;
            let bad = |e| invalid(&message.place, e);
            match message.channel {
                Channel::Labels => current = Arc::new(labels(message.body).map_err(bad)?),
                Channel::Frames => {
                    let begin = begin_of_frame(&message.body);
                    outline.frames.push(at(begin, &current));
                }
                Channel::Verdicts => {
                    let about = (&current, message.time_ns);
                    let item = item(message.channel, message.body, about).map_err(bad)?;
                    if let Some(RecordedItem::Verdict(recorded)) = item {
                        let report = recorded.report;
                        outline.verdicts.push(OutlinedVerdict {
                            at: at((report.seq, report.time), &current),
                            verdict: report.verdict,
                            changes: report.changes.len(),
                            events: report.events.len(),
                        });
                    }
                }
                Channel::Baseline | Channel::Foreign => {}
            }
        }
    }

    /// Continues with a frame or a verdict of the [outline](RecordingReader::outline).
    pub fn go_to(&mut self, frame: &FramePlace) -> Result<()> {
        self.labels = Arc::clone(&frame.labels);
        let gone = self.container.go_to(frame.place);
        if gone.is_err() {
            self.container.fail();
        }
        gone
    }
}

/// Returns the number and the time at the start of an encoded `CurveFrame`. They are its first two
/// fields; encoders omit fields that are 0.
fn begin_of_frame(mut body: &[u8]) -> (u64, f64) {
    const SEQ: u8 = 1 << 3;
    const TIME: u8 = 2 << 3 | 1;
    let mut seq = 0;
    if body.first() == Some(&SEQ) {
        body.advance(1);
        seq = prost::encoding::decode_varint(&mut body).unwrap_or_default();
    }
    let mut time = 0.0;
    if body.first() == Some(&TIME) {
        body.advance(1);
        time = body.try_get_f64_le().unwrap_or_default();
    }
    (seq, time)
}
