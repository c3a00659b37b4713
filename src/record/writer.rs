//! Writes a recording.
//!
//! A chunk is built in memory and written as a whole, and nothing is written after the first error.
//! Therefore the file is a prefix of the finished one at any moment, also after a kill or on a full
//! disk, and the reader accepts it up to the last complete record. (A chunk written in pieces would
//! get its length afterwards, by seeking back. The `mcap` crate also does this when a writer is
//! dropped after an error; the length then includes an incomplete record.)
//!
//! Chunks are closed at 768 KiB, so that they stay below 1 MiB with one more small message. A
//! single larger frame makes its chunk larger. They are not compressed: LZ4 was measured to save
//! nothing on coordinates and to cost 1.4 ms for a frame of 2.5 MB. Each chunk has a checksum, so
//! damage is still detected.

use super::messages::{DESCRIPTORS, PACKAGE, Recorded};
use super::{ACCEPTED, BASELINE, CONTINUED, CUT_OFF, FRAMES, LABELS, METADATA, PROTOBUF, VERDICTS};
use super::{file, schema};
use crate::curve::{CurveLabels, CurveSet};
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;
use crate::sinks::{BaselineRecord, FrameRecord, RunProgress, Sink};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use prost::Message;
use prost::bytes::Bytes;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

const CHUNK_BYTES: u64 = 768 << 10;

/// Upper bound of the size of a file without messages: every schema is written twice. Metadata have
/// less than half of the rest.
const FIXED_BYTES: u64 = 2 * 4 * (DESCRIPTORS.len() as u64 + 256) + 8192;

/// Upper bound of the bytes that a chunk adds: its header and its index, twice.
const CHUNK_OVERHEAD: u64 = 512;

/// Upper bound of the bytes that a message adds to its own: its header, and its entry in the index.
const MESSAGE_OVERHEAD: u64 = 64;

/// Maximum size of a protobuf message, because decoders count bytes as `int32`.
const MESSAGE_BYTES: usize = i32::MAX as usize;

/// Writes an MCAP recording. [`crate::RecordingReader`] reads it.
///
/// ```
/// use linkwatch::{
///     BaselineRecord, Basis, CurveSet, FrameInfo, FrameRecord, Overflow, Positions, Received,
///     RecordingSink, RunProgress, Session, SessionOptions, SinkQueue,
/// };
/// use std::sync::Arc;
/// use std::time::{Duration, SystemTime};
///
/// # let path = std::env::temp_dir().join(format!("linkwatch-doc-{}.mcap", std::process::id()));
/// # let file = path.clone();
/// // The recording has a thread of its own. A full disk delays the verdicts by one second at most.
/// let wait = Overflow::Wait(Duration::from_secs(1));
/// let open = move || Ok(Box::new(RecordingSink::create(&path, &Default::default())?) as Box<_>);
/// let queue = SinkQueue::spawn("recording", 64, wait, open)?;
///
/// let triangle = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let curves = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&triangle))?;
/// let mut session = Session::new(SessionOptions::default())?;
/// let frame = Received::new(FrameInfo::at(0, 0.0), Ok(Arc::new(curves)));
/// let verified = session.verify(frame)?;
/// queue.begin(Arc::new(BaselineRecord {
///     certificate: Arc::new(session.baseline().expect("the first frame").clone()),
///     origin: "first frame".into(),
///     frame: Some(0),
///     unverified: 0,
/// }));
/// queue.frame(Arc::new(FrameRecord {
///     curves: verified.curves,
///     info: verified.info,
///     report: Arc::new(verified.report),
///     progress: RunProgress {
///         verified: 1,
///         work: verified.work,
///         ..RunProgress::default()
///     }
///     .received(SystemTime::now()),
/// }));
/// let summary = queue.finish(Duration::from_secs(60));
/// assert_eq!((summary.written, summary.failed), (1, None));
/// # std::fs::remove_file(file)?;
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub struct RecordingSink {
    log: Log,
    frames: u16,
    verdicts: u16,
    baseline: u16,
    /// `None` until a baseline changes.
    accepted: Option<u16>,
    labels: u16,
    /// Names and radii that were written last.
    last_labels: Arc<CurveLabels>,
    /// Reused for every frame, so that a frame allocates nothing.
    positions: Vec<u8>,
    /// See [`RecordingSink::leave_out`].
    left_out: u64,
}

/// The messages of a file.
struct Log {
    path: PathBuf,
    writer: Writer<NoSeek<BufWriter<Prefix>>>,
    /// Reused for every message.
    encoded: Vec<u8>,
    /// Upper bound of the size of the file if it were closed now.
    bytes: u64,
}

impl RecordingSink {
    /// Creates the file, or replaces it, unless another process reads or writes it. It must be a
    /// regular file. `metadata` describes the run for a later reader: the service, the abort
    /// policy. The version of linkwatch is added.
    ///
    /// # Errors
    ///
    /// [`Error::File`].
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<RecordingSink> {
        RecordingSink::on(path, Box::new(file::create_or_replace(path)?), metadata)
    }

    /// Same as [`RecordingSink::create`], for a file that must not exist.
    ///
    /// # Errors
    ///
    /// [`Error::File`], also if the file exists.
    pub fn create_new(path: &Path, metadata: &BTreeMap<String, String>) -> Result<RecordingSink> {
        RecordingSink::on(path, Box::new(file::create_new(path)?), metadata)
    }

    /// Fails if another process reads or writes this recording. Only processes of linkwatch on Unix
    /// are recognised.
    ///
    /// # Errors
    ///
    /// [`Error::File`] if another process reads or writes the file.
    pub fn check_unused(path: &Path) -> Result<()> {
        file::check_unused(path)
    }

    /// Begins a recording on any output. `path` is for messages.
    pub(super) fn on(
        path: &Path,
        output: Box<dyn Output>,
        metadata: &BTreeMap<String, String>,
    ) -> Result<RecordingSink> {
        let version = env!("CARGO_PKG_VERSION");
        let writer = WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .library(format!("linkwatch {version}"))
            .create(NoSeek::new(BufWriter::new(Prefix {
                output,
                failed: false,
            })))
            .map_err(|e| sink_error(path, e))?;
        let mut metadata = metadata.clone();
        metadata.insert("version".into(), version.into());
        let mut log = Log {
            path: path.into(),
            writer,
            encoded: Vec::new(),
            bytes: FIXED_BYTES,
        };
        log.describe(metadata)?;
        let mut channel = |of| log.channel(of);
        Ok(RecordingSink {
            baseline: channel(BASELINE)?,
            accepted: None,
            labels: channel(LABELS)?,
            last_labels: Arc::default(),
            frames: channel(FRAMES)?,
            verdicts: channel(VERDICTS)?,
            log,
            positions: Vec::new(),
            left_out: 0,
        })
    }

    /// Records that frames before the next one are not in this file, on purpose, so that a reader
    /// does not count them as lost.
    pub fn leave_out(&mut self, frames: u64) {
        self.left_out += frames;
    }

    /// Returns an upper bound of the size of the file if it were closed now.
    pub(super) fn bytes(&self) -> u64 {
        self.log.bytes
    }

    /// Writes the name of the file in which the recording continues.
    pub(super) fn continue_in(&mut self, name: String) -> Result<()> {
        self.log.describe([(CONTINUED.into(), name)].into())
    }

    /// Writes the index and the end of the file, without waiting for the disk.
    pub(super) fn close(self) -> Result<Box<dyn Output>> {
        let mut log = self.log;
        log.writer.finish().map_err(|e| sink_error(&log.path, e))?;
        let prefix = log.writer.into_inner().into_inner().into_inner();
        let prefix = prefix.map_err(|e| Error::file(&log.path)(e.into_error()))?;
        Ok(prefix.output)
    }

    /// Records the curves of a frame without a verdict. The time of the simulation takes the place
    /// of the time of receipt.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn curves(&mut self, curves: &CurveSet, info: &FrameInfo) -> Result<()> {
        let since_start = Duration::try_from_secs_f64(info.time).unwrap_or_default();
        self.write_curves(info.seq, info.time, curves, info, since_start.record())
    }

    fn write_curves(
        &mut self,
        seq: u64,
        time: f64,
        set: &CurveSet,
        info: &FrameInfo,
        time_ns: u64,
    ) -> Result<()> {
        let labels = &info.labels;
        if !Arc::ptr_eq(labels, &self.last_labels) && **labels != *self.last_labels {
            let (names, radii) = (labels.names.clone(), labels.radii.clone());
            let message = schema::Labels { names, radii };
            self.log.write(self.labels, &message, seq, time_ns)?;
            self.last_labels = Arc::clone(labels);
        }
        self.positions.clear();
        set.write_positions(&mut self.positions);
        let message = schema::CurveFrame {
            seq,
            time,
            basis: set.basis().record(),
            precision: set.precision().record(),
            counts: set.counts().collect(),
            positions: Bytes::from(std::mem::take(&mut self.positions)),
            cuts: info.cuts,
            baseline: info.baseline,
            layout: info.layout,
            time_step: info.time_step,
            cell: info.cell.record(),
            left_out: info.left_out.record(),
            translated: info.translated.record(),
        };
        let outcome = self.log.write(self.frames, &message, seq, time_ns);
        // The message was the only owner of the bytes, so this returns the buffer without a copy.
        self.positions = message.positions.into();
        outcome
    }
}

impl Log {
    /// Adds a channel: its topic, and its protobuf messages.
    fn channel(&mut self, (topic, message): (&str, &str)) -> Result<u16> {
        let (writer, none) = (&mut self.writer, BTreeMap::new());
        let schema = writer.add_schema(&format!("{PACKAGE}.{message}"), PROTOBUF, DESCRIPTORS);
        let added = schema.and_then(|schema| writer.add_channel(schema, topic, PROTOBUF, &none));
        added.map_err(|e| sink_error(&self.path, e))
    }

    fn write(&mut self, channel: u16, message: &impl Message, seq: u64, ns: u64) -> Result<()> {
        let bytes = message.encoded_len();
        if bytes > MESSAGE_BYTES {
            let what = "bytes of a message in a recording";
            return Err(Error::count(what, bytes, MESSAGE_BYTES));
        }
        self.encoded.clear();
        // Cannot fail, because a vector grows.
        message.encode(&mut self.encoded).ok();
        let added = bytes as u64 + MESSAGE_OVERHEAD;
        let chunks = (self.bytes + added) / CHUNK_BYTES - self.bytes / CHUNK_BYTES;
        self.bytes += added + chunks * CHUNK_OVERHEAD;
        let header = MessageHeader {
            channel_id: channel,
            // MCAP has 32 bits for the sequence number; the message has all 64.
            sequence: seq as u32,
            log_time: ns,
            publish_time: ns,
        };
        let written = self.writer.write_to_known_channel(&header, &self.encoded);
        written.map_err(|e| sink_error(&self.path, e))
    }

    /// Writes a metadata record.
    fn describe(&mut self, metadata: BTreeMap<String, String>) -> Result<()> {
        let name = METADATA.into();
        let written = self.writer.write_metadata(&Metadata { name, metadata });
        written.map_err(|e| sink_error(&self.path, e))
    }
}

impl Sink for RecordingSink {
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.log.write(self.baseline, &baseline.record(), 0, now())
    }

    fn expect(&mut self, baseline: &BaselineRecord) -> Result<()> {
        let channel = match self.accepted {
            Some(channel) => channel,
            None => self.log.channel(ACCEPTED)?,
        };
        self.accepted = Some(channel);
        self.log.write(channel, &baseline.record(), 0, now())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let time = record.progress.received_ns;
        let seq = record.report.seq;
        if let Some(curves) = &record.curves {
            self.write_curves(seq, record.report.time, curves, &record.info, time)?;
        }
        let mut progress = record.progress;
        progress.left_out = self.left_out;
        let message = schema::Verdict {
            report: Some(record.report.record()),
            progress: Some(progress.record()),
        };
        self.log.write(self.verdicts, &message, seq, time)
    }

    fn cut_off(&mut self, why: &str) -> Result<()> {
        let metadata = [(CUT_OFF.into(), why.into())].into();
        self.log.describe(metadata)
    }

    fn flush(&mut self) -> Result<()> {
        self.log.bytes += CHUNK_OVERHEAD;
        let flushed = self.log.writer.flush();
        flushed.map_err(|e| sink_error(&self.log.path, e))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let path = self.log.path.clone();
        self.close()?.sync().map_err(Error::file(&path))
    }
}

/// Returns the time in nanoseconds since 1970.
fn now() -> u64 {
    let progress = RunProgress::default().received(SystemTime::now());
    progress.received_ns
}

/// Destination of a recording.
pub(super) trait Output: Write + Send {
    /// Makes all data safe from a crash of the machine.
    fn sync(&self) -> io::Result<()>;
}

impl Output for File {
    fn sync(&self) -> io::Result<()> {
        self.sync_all()
    }
}

/// Writes nothing after an error, so that the output stays a prefix of the complete one.
struct Prefix {
    output: Box<dyn Output>,
    failed: bool,
}

impl Write for Prefix {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.failed {
            return Err(io::Error::other("nothing is written after an error"));
        }
        let written = self.output.write(bytes);
        let interrupted = |e: &io::Error| e.kind() == io::ErrorKind::Interrupted;
        self.failed = written.as_ref().is_err_and(|e| !interrupted(e));
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}

fn sink_error(path: &Path, error: McapError) -> Error {
    match error {
        McapError::Io(source) => Error::file(path)(source),
        other => Error::Sink {
            sink: "recording",
            what: format!("{}: {other}", path.display()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::record::{Ending, RecordedItem, RecordingReader};
    use crate::verdict::{Report, Verdict};
    use std::sync::Mutex;

    /// A disk with limited space. It truncates the write that exceeds it.
    #[derive(Clone)]
    struct Disk {
        bytes: Arc<Mutex<Vec<u8>>>,
        room: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let mut disk = self.bytes.lock().unwrap();
            let n = bytes.len().min(self.room - disk.len());
            if n == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            disk.extend(&bytes[..n]);
            Ok(n)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Output for Disk {
        fn sync(&self) -> io::Result<()> {
            Ok(())
        }
    }

    fn frame(seq: u64, curves: usize) -> FrameRecord {
        let xyz: Vec<f32> = (0..9 * curves).map(|k| k as f32 + seq as f32).collect();
        let counts = vec![-3; curves];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
        FrameRecord {
            info: FrameInfo::default(),
            curves: Some(Arc::new(set)),
            report: Arc::new(Report::new(seq, 0.0, Verdict::Intact)),
            progress: Default::default(),
        }
    }

    /// Records frames until the disk is full, or to the end. Returns the result and the content of
    /// the disk.
    fn record(frames: &[FrameRecord], flush: bool, room: usize) -> (Result<()>, Vec<u8>) {
        let disk = Disk {
            bytes: Arc::default(),
            room,
        };
        let outcome = (|| {
            let output = Box::new(disk.clone());
            let mut sink = RecordingSink::on(Path::new("run.mcap"), output, &BTreeMap::new())?;
            for frame in frames {
                sink.frame(frame)?;
                if flush {
                    sink.flush()?;
                }
            }
            Box::new(sink).finish()
        })();
        let bytes = std::mem::take(&mut *disk.bytes.lock().unwrap());
        (outcome, bytes)
    }

    fn read(bytes: &[u8]) -> (Vec<RecordedItem>, Option<Ending>) {
        let mut reader = RecordingReader::new(io::Cursor::new(bytes)).unwrap();
        let mut items = Vec::new();
        while let Some(item) = reader.next_item().unwrap() {
            items.push(item);
        }
        (items, reader.ending().cloned())
    }

    /// The disk is full at every byte for small frames, and at every few thousand bytes for frames
    /// that share chunks or exceed them.
    #[test]
    fn what_was_written_before_the_disk_was_full_stays_readable() {
        for (curves, frames, step) in [(1, 3, 1), (2000, 14, 3001), (30_000, 2, 20_011)] {
            let frames: Vec<_> = (1..=frames).map(|seq| frame(seq, curves)).collect();
            for flush in [false, true] {
                let (outcome, whole) = record(&frames, flush, usize::MAX);
                outcome.unwrap();
                let (all, ending) = read(&whole);
                assert_eq!(
                    (all.len(), ending),
                    (2 * frames.len(), Some(Ending::Finished))
                );
                let mut most = 0;
                let rooms = (0..whole.len()).step_by(step);
                for room in rooms.chain([whole.len() - 1]) {
                    let (outcome, bytes) = record(&frames, flush, room);
                    let e = outcome.unwrap_err().to_string();
                    assert!(e.starts_with("run.mcap: "), "{room}: {e}");
                    assert!(whole.starts_with(&bytes), "full at {room}");
                    let (items, ending) = read(&bytes);
                    assert!(items.len() >= most, "full at {room}");
                    assert_eq!(items[..], all[..items.len()], "full at {room}");
                    let at_end = ending == Some(Ending::Finished);
                    assert!(!at_end || items.len() == all.len(), "full at {room}");
                    most = items.len();
                }
                assert_eq!(most, all.len());
            }
        }
    }
}
