//! Writes a recording.
//!
//! Chunks are closed at 768 KiB, so that with one small message on top they stay below 1 MiB; one frame that is
//! larger makes its chunk larger. They are not compressed: LZ4 was measured to save nothing on coordinates and to
//! cost 1.4 ms for a frame of 2.5 MB. Each chunk has a checksum, so damage is found all the same.

use super::messages::{self, BaselineMessage, DESCRIPTORS, FrameMessage, PACKAGE, VerdictMessage};
use super::{BASELINE, FRAMES, METADATA, PROTOBUF, VERDICTS};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use prost::Message;
use prost::bytes::Bytes;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

const CHUNK_BYTES: u64 = 768 << 10;

/// A protobuf message must stay below 2 GiB: its decoders count bytes as `int32`.
const MESSAGE_BYTES: usize = i32::MAX as usize;

/// Writes an MCAP recording; see [`crate::RecordingReader`] for the way back.
pub struct RecordingSink {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    frames: u16,
    verdicts: u16,
    baseline: u16,
    /// Kept from frame to frame, so that a frame allocates nothing.
    positions: Vec<u8>,
    encoded: Vec<u8>,
}

impl RecordingSink {
    /// Creates (or overwrites) the file. `metadata` says what a later reader should know of this run: the
    /// service, the abort policy; the version of linkwatch is added.
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<RecordingSink> {
        let file = File::create(path).map_err(Error::file(path))?;
        let version = env!("CARGO_PKG_VERSION");
        let failed = |e| sink_error(path, e);
        let mut writer = WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .library(format!("linkwatch {version}"))
            .create(BufWriter::new(file))
            .map_err(failed)?;
        let mut metadata = metadata.clone();
        metadata.insert("version".into(), version.into());
        writer
            .write_metadata(&Metadata {
                name: METADATA.into(),
                metadata,
            })
            .map_err(failed)?;
        let mut channel = |(topic, message): (&str, &str)| {
            let schema =
                writer.add_schema(&format!("{PACKAGE}.{message}"), PROTOBUF, DESCRIPTORS)?;
            writer.add_channel(schema, topic, PROTOBUF, &BTreeMap::new())
        };
        Ok(RecordingSink {
            baseline: channel(BASELINE).map_err(failed)?,
            frames: channel(FRAMES).map_err(failed)?,
            verdicts: channel(VERDICTS).map_err(failed)?,
            path: path.into(),
            writer,
            positions: Vec::new(),
            encoded: Vec::new(),
        })
    }

    fn write_curves(&mut self, set: &CurveSet, record: &FrameRecord, time_ns: u64) -> Result<()> {
        let report = &record.report;
        self.positions.clear();
        set.write_positions(&mut self.positions);
        let message = FrameMessage {
            seq: report.seq,
            time: report.time,
            basis: messages::basis_code(set.basis()),
            precision: messages::precision_code(set.precision()),
            counts: set.counts().collect(),
            positions: Bytes::from(std::mem::take(&mut self.positions)),
            cuts: record.cuts,
        };
        let outcome = self.write(self.frames, &message, report.seq, time_ns);
        // The message was the only owner of the bytes: this gives the buffer back, not a copy.
        self.positions = message.positions.into();
        outcome
    }

    fn write(&mut self, channel: u16, message: &impl Message, seq: u64, ns: u64) -> Result<()> {
        let bytes = message.encoded_len();
        if bytes > MESSAGE_BYTES {
            return Err(Error::Count {
                what: "bytes of a message in a recording",
                promised: bytes as u64,
                available: MESSAGE_BYTES as u64,
            });
        }
        self.encoded.clear();
        // Cannot fail: a vector grows.
        message.encode(&mut self.encoded).ok();
        let header = MessageHeader {
            channel_id: channel,
            // MCAP has 32 bits for it; the message has all 64.
            sequence: seq as u32,
            log_time: ns,
            publish_time: ns,
        };
        self.writer
            .write_to_known_channel(&header, &self.encoded)
            .map_err(|e| sink_error(&self.path, e))
    }
}

impl Sink for RecordingSink {
    fn name(&self) -> &'static str {
        "recording"
    }

    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        let message = BaselineMessage::from(baseline);
        self.write(self.baseline, &message, 0, nanoseconds(SystemTime::now()))
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let time = nanoseconds(record.received);
        if let Some(curves) = &record.curves {
            self.write_curves(curves, record, time)?;
        }
        let message = VerdictMessage {
            report: Some(record.report.as_ref().into()),
            progress: Some(messages::ProgressMessage {
                verified: record.verified,
                skipped: record.skipped,
                rejected: record.rejected,
                check_ns: record.check.as_nanos().try_into().unwrap_or(u64::MAX),
                work: Some((&record.work).into()),
            }),
        };
        self.write(self.verdicts, &message, record.report.seq, time)
    }

    fn flush(&mut self) -> Result<()> {
        self.writer.flush().map_err(|e| sink_error(&self.path, e))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.writer
            .finish()
            .map_err(|e| sink_error(&self.path, e))?;
        let file = self
            .writer
            .into_inner()
            .into_inner()
            .map_err(|e| Error::file(&self.path)(e.into_error()))?;
        file.sync_all().map_err(Error::file(&self.path))
    }
}

/// Since 1970; a clock set before that reads 0.
fn nanoseconds(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    since.as_nanos().try_into().unwrap_or(u64::MAX)
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
