//! Outline of a recording: numbers, times and places of its frames, without their curves.

use super::{Channel, RecordedItem, RecordingReader};
use crate::curve::CurveLabels;
use crate::error::Result;
use crate::formats::container::{Content, Place};
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
    /// Place of its baseline, if that replaced the first one.
    accepted: Option<Place>,
}

impl FramePlace {
    /// Returns true if this place is before another one of the same recording.
    pub fn is_before(&self, other: &FramePlace) -> bool {
        self.place < other.place
    }

    /// Returns this place, to be read with the baseline of a later frame.
    #[cfg(feature = "cli")]
    pub(crate) fn with_baseline_of(&self, frame: &FramePlace) -> FramePlace {
        FramePlace {
            accepted: frame.accepted,
            ..self.clone()
        }
    }
}

/// Frames and verdicts of a recording, in the order of the file.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Outline {
    /// Frames with curves.
    pub frames: Vec<FramePlace>,
    /// Verdicts, also those on frames without curves.
    pub verdicts: Vec<FramePlace>,
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
    ///
    /// # Errors
    ///
    /// The file is damaged before its end.
    pub fn outline(&mut self) -> Result<Outline> {
        let outline = self.container.go_to_start().and_then(|()| self.skim());
        self.stop_at_damage(outline)
    }

    fn skim(&mut self) -> Result<Outline> {
        let mut outline = Outline::default();
        (self.labels, self.accepted) = (Arc::default(), None);
        let mut has_baseline = false;
        while let Some(message) = self.next_message(true)? {
            let (channel, place) = (message.0, message.3);
            if let Channel::Baseline = channel
                && std::mem::replace(&mut has_baseline, true)
            {
                // Of another window.
                self.accepted = Some(place);
            }
            let (labels, accepted) = (Arc::clone(&self.labels), self.accepted);
            let at = |(seq, time)| FramePlace {
                seq,
                time,
                place,
                labels,
                accepted,
            };
            if let Channel::Frames = channel {
                outline.frames.push(at(begin_of_frame(&message.2)));
            } else if let Channel::Verdicts = channel
                && let Some(RecordedItem::Verdict(recorded)) = self.item(message)?
            {
                let report = &recorded.report;
                outline.verdicts.push(at((report.seq, report.time)));
            }
        }
        Ok(outline)
    }

    /// Continues with a frame or a verdict of the [outline](RecordingReader::outline). Its baseline
    /// comes first, if the simulator accepted it, or described its curves again, after the start of
    /// the file.
    ///
    /// # Errors
    ///
    /// [`Error::Io`](crate::Error::Io).
    pub fn go_to(&mut self, frame: &FramePlace) -> Result<()> {
        self.labels = Arc::clone(&frame.labels);
        let gone = self.go_to_baseline(frame.accepted);
        let gone = gone.and_then(|()| self.container.go_to(frame.place));
        self.stop_at_damage(gone)
    }

    /// Reads the baseline at a place, to return it as the next item.
    fn go_to_baseline(&mut self, place: Option<Place>) -> Result<()> {
        (self.accepted, self.first) = (place, None);
        let Some(place) = place else {
            return Ok(());
        };
        self.container.go_to(place)?;
        if let Some((place, Content::Message(_, time, body))) = self.container.next()? {
            self.first = self.item((Channel::Accepted, time, body, place))?;
        }
        Ok(())
    }
}

/// Returns the number and the time at the start of an encoded `CurveFrame`. They are its first two
/// fields; encoders omit fields that are 0.
fn begin_of_frame(mut body: &[u8]) -> (u64, f64) {
    const SEQ: u8 = 1 << 3;
    const TIME: u8 = 2 << 3 | 1;
    let (mut seq, mut time) = (0, 0.0);
    if let Some(rest) = body.strip_prefix(&[SEQ]) {
        body = rest;
        seq = prost::encoding::decode_varint(&mut body).unwrap_or_default();
    }
    if let Some(mut rest) = body.strip_prefix(&[TIME]) {
        time = rest.try_get_f64_le().unwrap_or_default();
    }
    (seq, time)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Ending;
    use mcap::records::op;
    use std::io::Cursor;

    fn recording(name: &str) -> Vec<u8> {
        std::fs::read(format!("recordings/{name}.mcap")).unwrap()
    }

    fn reader(bytes: &[u8]) -> RecordingReader<Cursor<&[u8]>> {
        RecordingReader::new(Cursor::new(bytes)).unwrap()
    }

    /// Returns all items up to the end or to damage, and the end.
    fn read(bytes: &[u8]) -> (Vec<RecordedItem>, Option<Ending>) {
        let mut reader = reader(bytes);
        let mut items = Vec::new();
        while let Ok(Some(item)) = reader.next_item() {
            items.push(item);
        }
        (items, reader.ending().cloned())
    }

    /// Asserts that the outline has the frames and verdicts of these items, and that reading
    /// continues with the same items from each of them. Returns the number of frames.
    #[track_caller]
    fn assert_outline(
        bytes: &[u8],
        (items, ending): &(Vec<RecordedItem>, Option<Ending>),
    ) -> usize {
        let mut reader = reader(bytes);
        let outline = reader.outline().unwrap();
        let (mut frames, mut verdicts) = (outline.frames.iter(), outline.verdicts.iter());
        for (k, item) in items.iter().enumerate() {
            let place = match item {
                RecordedItem::Baseline(_) => continue,
                RecordedItem::Frame(frame) => {
                    let place = frames.next().expect("a frame");
                    assert_eq!((place.seq, place.time), (frame.seq, frame.time));
                    place
                }
                RecordedItem::Verdict(recorded) => {
                    let place = verdicts.next().expect("a verdict");
                    assert_eq!(place.seq, recorded.report.seq);
                    place
                }
            };
            reader.go_to(place).unwrap();
            // The rest of a long recording is compared once in a while.
            let many = if k % 16 == 0 { usize::MAX } else { 2 };
            for expected in items[k..].iter().take(many) {
                assert_eq!(reader.next_item().unwrap().as_ref(), Some(expected));
            }
            if many == usize::MAX {
                assert!(reader.next_item().unwrap().is_none());
                assert_eq!(reader.ending(), ending.as_ref());
            }
        }
        assert!(frames.next().is_none() && verdicts.next().is_none());
        outline.frames.len()
    }

    #[test]
    fn an_outline_has_all_frames_and_verdicts_and_leads_to_each() {
        for (name, frames) in [("squares", 19), ("flight", 5), ("chainmail", 60)] {
            let bytes = recording(name);
            assert_eq!(assert_outline(&bytes, &read(&bytes)), frames, "{name}");
        }
    }

    #[test]
    fn an_outline_of_a_truncated_recording_has_its_complete_frames() {
        for (name, step) in [("flight", 331), ("squares", 499), ("chainmail", 40_009)] {
            let bytes = recording(name);
            let mut most = 0;
            for end in (16..bytes.len()).step_by(step) {
                let frames = assert_outline(&bytes[..end], &read(&bytes[..end]));
                assert!(frames >= most, "{name} cut at {end}");
                most = frames;
            }
            assert!(most > 3, "{name}: {most}");
        }
    }

    /// Returns a recording with compressed chunks. Its checksum is that of an empty file, and its
    /// index is wrong, but is not read.
    fn compress(bytes: &[u8]) -> Vec<u8> {
        use std::io::Write;
        let record = |out: &mut Vec<u8>, opcode: u8, body: &[u8]| {
            out.push(opcode);
            out.extend((body.len() as u64).to_le_bytes());
            out.extend(body);
        };
        let (magic, mut rest) = bytes.split_at(8);
        let mut out = magic.to_vec();
        while rest.len() > 8 {
            let length = u64::from_le_bytes(rest[1..9].try_into().unwrap()) as usize;
            let (opcode, body) = (rest[0], &rest[9..9 + length]);
            rest = &rest[9 + length..];
            match opcode {
                op::CHUNK => {
                    // Times, size and checksum; no compression; then the records.
                    assert_eq!(body[28..32], [0; 4]);
                    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                    encoder.write_all(&body[40..]).unwrap();
                    let packed = encoder.finish().unwrap();
                    let name = [3, 0, 0, 0, b'l', b'z', b'4'];
                    let length = (packed.len() as u64).to_le_bytes();
                    let parts = [&body[..28], &name, &length, &packed];
                    record(&mut out, opcode, &parts.concat());
                }
                op::DATA_END => record(&mut out, opcode, &[0; 4]),
                _ => record(&mut out, opcode, body),
            }
        }
        out.extend(rest);
        out
    }

    #[test]
    fn an_outline_reads_compressed_chunks() {
        let bytes = recording("squares");
        let compressed = compress(&bytes);
        assert_ne!(compressed.len(), bytes.len());
        let before = read(&bytes);
        assert_eq!(read(&compressed).0, before.0);
        assert_eq!(assert_outline(&compressed, &before), 19);
    }

    #[test]
    fn names_and_radii_follow_to_a_frame() {
        let labels = |k: u64| Arc::new(CurveLabels::named([format!("ring/{}", k / 2)]));
        let path =
            std::env::temp_dir().join(format!("linkwatch-names-{}.mcap", std::process::id()));
        let mut sink = crate::record::RecordingSink::create(&path, &Default::default()).unwrap();
        use crate::sinks::Sink;
        for seq in 0..6 {
            let xyz = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, seq as f64];
            let set = crate::curve::CurveSet::from_counts(
                crate::curve::Basis::Polyline,
                &[-3],
                crate::curve::Positions::F64(&xyz),
            );
            let verdict = crate::verdict::Verdict::Intact;
            let report = crate::verdict::Report::new(seq, 0.0, verdict);
            let record = crate::sinks::FrameRecord {
                curves: Some(Arc::new(set.unwrap())),
                info: crate::ingest::FrameInfo {
                    labels: labels(seq),
                    ..Default::default()
                },
                report: Arc::new(report),
                progress: Default::default(),
            };
            sink.frame(&record).unwrap();
        }
        Box::new(sink).finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        let mut reader = reader(&bytes);
        let outline = reader.outline().unwrap();
        for seq in [4, 1, 5, 2, 0, 3] {
            reader.go_to(&outline.frames[seq as usize]).unwrap();
            match reader.next_item().unwrap() {
                Some(RecordedItem::Frame(frame)) => assert_eq!(frame.info.labels, labels(seq)),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn damage_gives_an_error_or_a_gap_and_never_a_panic() {
        let bytes = recording("flight");
        for at in (8..bytes.len()).step_by(7) {
            for flip in [0x01, 0xff] {
                let mut bytes = bytes.clone();
                bytes[at] ^= flip;
                let mut reader = reader(&bytes);
                let Ok(outline) = reader.outline() else {
                    continue;
                };
                for frame in &outline.frames {
                    if reader.go_to(frame).is_err() || reader.next_item().is_err() {
                        break;
                    }
                }
            }
        }
    }
}
