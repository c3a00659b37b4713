//! Reads a recording: the same bits that were verified, and the same reports.

mod outline;

pub use outline::{FramePlace, Outline, OutlinedVerdict};

use super::messages::{self, PACKAGE, cell_of, invalid};
use super::schema;
use super::{BASELINE, FRAMES, LABELS, METADATA, PROTOBUF, RecordingTool, VERDICTS};
use crate::container::{self, Container, Ending, Record, op, string};
use crate::curve::{Basis, CurveLabels, CurveSet, Positions, Precision};
use crate::error::{Error, Result};
use crate::incremental::Work;
use crate::ingest::{FrameInfo, RawFrame, ingest};
use crate::sinks::{BaselineRecord, FrameTimes};
use crate::verdict::Report;
use prost::Message as _;
use prost::bytes::{Buf, Bytes};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// An item of a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordedItem {
    /// The baseline; precedes the first frame that is compared with it.
    Baseline(BaselineRecord),
    /// The curves of a frame.
    Frame(RecordedFrame),
    /// The verdict on a frame; follows the curves of its frame, or stands alone if the frame was
    /// rejected.
    Verdict(Box<RecordedVerdict>),
}

/// The verdict on a frame when it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedVerdict {
    /// The report. A replay of the frame must give an equal one.
    pub report: Report,
    /// State of the recorded run.
    pub progress: RecordedProgress,
}

/// Data that depends on the recorded run, not on its frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct RecordedProgress {
    /// Number of frames verified, this one included.
    pub verified: u64,
    /// Number of frames that were not verified.
    pub skipped: u64,
    /// Number of frames rejected.
    pub rejected: u64,
    /// Times of the frame. Recordings of earlier versions have only the sum of ingest and
    /// verification, as `verification`.
    pub times: FrameTimes,
    /// Work of the verification.
    pub work: Work,
    /// Time at which the frame arrived, in nanoseconds since 1970.
    pub received_ns: u64,
    /// Number of frames before this one that are not in the file on purpose: `verified` and
    /// `rejected` count them.
    pub left_out: u64,
    /// See [`FrameRecord::recovered`](crate::FrameRecord::recovered).
    pub recovered: u32,
    /// See [`FrameRecord::accepted`](crate::FrameRecord::accepted).
    pub accepted: u32,
}

/// Curves of a recorded frame, not yet checked: see [`RecordedFrame::ingest`].
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// Sequence number given by the simulator.
    pub seq: u64,
    /// Simulation time in seconds.
    pub time: f64,
    /// Basis of all curves.
    pub basis: Basis,
    /// Precision of the coordinates.
    pub precision: Precision,
    /// Number of control points of each curve, negative if the curve is closed.
    pub counts: Vec<i32>,
    /// What the simulator told about the frame; the default in recordings of earlier versions.
    pub info: FrameInfo,
    /// Time at which the frame arrived, in nanoseconds since 1970.
    pub received_ns: u64,
    /// Coordinates, little-endian. Their number may contradict `counts`.
    pub(super) positions: Bytes,
}

impl RecordedFrame {
    /// Checks the frame and copies it into `set`: into a new one if there is none, else in place of
    /// the previous frame, which must have had the same curves.
    pub fn ingest(&self, set: &mut Option<CurveSet>) -> Result<()> {
        self.read(|frame| ingest(frame, set, CurveSet::update))
    }

    /// Calls `receive` with the frame, for example within
    /// [`Session::receive`](crate::Session::receive).
    ///
    /// Errors: [`Error::Count`] if the number of coordinates contradicts the counts; those of
    /// `receive`.
    pub fn read(&self, receive: impl FnOnce(RawFrame<'_>) -> Result<()>) -> Result<()> {
        self.info.labels.check(self.counts.len())?;
        let bytes = self.precision.bytes();
        let promised: u64 = self
            .counts
            .iter()
            .map(|c| u64::from(c.unsigned_abs()))
            .sum();
        let promised = promised.saturating_mul(3 * bytes as u64);
        if promised != self.positions.len() as u64 {
            return Err(Error::Count {
                what: "bytes of positions in a recorded frame",
                promised,
                available: self.positions.len() as u64,
            });
        }
        let frame = |positions| RawFrame {
            basis: self.basis,
            counts: &self.counts,
            positions,
        };
        match self.precision {
            Precision::F32 => receive(frame(Positions::F32(&self.values(f32::from_le_bytes)))),
            Precision::F64 => receive(frame(Positions::F64(&self.values(f64::from_le_bytes)))),
        }
    }

    /// Returns the buffer of the coordinates, without a copy if nothing else uses it.
    pub(super) fn into_positions(self) -> Vec<u8> {
        self.positions.into()
    }

    /// Returns true if both frames have the same curves with the same bits, in the same cell.
    pub fn same_curves(&self, other: &RecordedFrame) -> bool {
        (self.basis, self.precision) == (other.basis, other.precision)
            && self.counts == other.counts
            && self.info.cell == other.info.cell
            && self.positions == other.positions
    }

    fn values<T, const N: usize>(&self, parse: fn([u8; N]) -> T) -> Vec<T> {
        self.positions
            .as_chunks()
            .0
            .iter()
            .map(|b| parse(*b))
            .collect()
    }
}

/// Content of a channel.
#[derive(Clone, Copy)]
enum Channel {
    Baseline,
    Labels,
    Frames,
    Verdicts,
    /// Messages for another tool, which follow from the frames.
    Tool,
    /// Other content: skipped and counted.
    Foreign,
}

/// A message with its channel.
struct Message {
    channel: Channel,
    /// Time at which it was logged.
    time_ns: u64,
    body: Bytes,
    /// Its place in the file, in words.
    place: String,
}

/// Reads a recording, item by item, in the order of writing.
///
/// After the last item, [`RecordingReader::ending`] reports if the recording was finished or
/// truncated. An error means that the file is damaged; nothing more is read from it.
///
/// ```
/// use linkwatch::{Ending, RecordedItem, RecordingReader, Session, SessionOptions};
///
/// let mut session = Session::new(SessionOptions::default())?;
/// let mut report = None;
/// let mut reader = RecordingReader::open("recordings/squares.mcap".as_ref())?;
/// while let Some(item) = reader.next_item()? {
///     match item {
///         RecordedItem::Baseline(baseline) => println!("baseline: {}", baseline.origin),
///         RecordedItem::Frame(frame) => {
///             let received = session.receive(frame.info.clone(), |copy| frame.read(copy));
///             report = Some(session.verify(received)?.report);
///         }
///         RecordedItem::Verdict(recorded) => match report.take() {
///             Some(report) => assert_eq!(report.verdict, recorded.report.verdict),
///             None => println!("rejected: {:?}", recorded.report.rejected),
///         },
///     }
/// }
/// assert_eq!(reader.ending(), Some(&Ending::Finished));
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub struct RecordingReader<R> {
    container: Container<R>,
    /// Full names of the messages, by the number of their schema.
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Channel>,
    tools: BTreeSet<RecordingTool>,
    metadata: BTreeMap<String, String>,
    /// Names and radii of the curves of the next frame.
    labels: Arc<CurveLabels>,
    skipped: u64,
}

impl RecordingReader<BufReader<File>> {
    /// Opens a file. A file that is still being written is read up to its current end.
    pub fn open(path: &Path) -> Result<Self> {
        let container = Container::open(path)?;
        super::file::share(container.file());
        Ok(RecordingReader::on(container))
    }
}

impl<R: Read + Seek> RecordingReader<R> {
    /// Reads a recording from any input with a length.
    pub fn new(input: R) -> Result<Self> {
        Ok(RecordingReader::on(Container::new(input)?))
    }

    fn on(container: Container<R>) -> Self {
        RecordingReader {
            container,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            tools: BTreeSet::new(),
            metadata: BTreeMap::new(),
            labels: Arc::default(),
            skipped: 0,
        }
    }

    /// Returns the metadata of the recorded run. Complete once the first item was read.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Returns the tools for which the recording has messages. Complete once the first item was
    /// read.
    pub fn tools(&self) -> impl Iterator<Item = RecordingTool> + '_ {
        self.tools.iter().copied()
    }

    /// Returns the number of messages of other topics or schemas, skipped so far. Messages for
    /// [tools](RecordingReader::tools) do not count.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns the end of the recording, finished or truncated, once it is reached. `None` if the
    /// file is damaged.
    pub fn ending(&self) -> Option<&Ending> {
        self.container.ending()
    }

    /// Returns the next item, or `None` at the end, finished or truncated.
    pub fn next_item(&mut self) -> Result<Option<RecordedItem>> {
        let item = self.read_item();
        if item.is_err() {
            self.container.fail();
        }
        item
    }

    fn read_item(&mut self) -> Result<Option<RecordedItem>> {
        while let Some(record) = self.container.next()? {
            if record.opcode != op::MESSAGE {
                self.describe(record)?;
                continue;
            }
            let message = self.message(record)?;
            let place = message.place;
            if let Channel::Tool = message.channel {
                continue;
            }
            if let Channel::Labels = message.channel {
                let labels = labels(message.body).map_err(|e| invalid(&place, e))?;
                self.labels = Arc::new(labels);
                continue;
            }
            let about = (&self.labels, message.time_ns);
            let item = item(message.channel, message.body, about);
            if let Some(item) = item.map_err(|e| invalid(&place, e))? {
                return Ok(Some(item));
            }
            self.skipped += 1;
        }
        Ok(None)
    }

    /// Takes note of a record that describes messages, or the run.
    fn describe(&mut self, record: Record) -> Result<()> {
        let place = format!("byte {}", record.place.at);
        let mut body = record.body;
        let bad = |what| invalid(&place, what);
        match record.opcode {
            op::SCHEMA => {
                let schema = container::schema(&mut body);
                let (id, schema) = schema.ok_or_else(|| bad("an invalid schema"))?;
                self.schemas.insert(id, schema.name);
            }
            op::CHANNEL => {
                let channel = container::channel(&mut body);
                let (id, channel) = channel.ok_or_else(|| bad("an invalid channel"))?;
                let content = self.content(&channel)?;
                self.channels.insert(id, content);
            }
            op::METADATA => {
                let parsed = metadata(&mut body);
                let (name, map) = parsed.ok_or_else(|| bad("an invalid metadata record"))?;
                if name == METADATA {
                    self.metadata.extend(map);
                }
            }
            // Other opcodes that the container returns from chunks.
            _ => {}
        }
        Ok(())
    }

    /// Parses the header of a message.
    fn message(&self, record: Record) -> Result<Message> {
        let place = format!("byte {}", record.place.at);
        let mut body = record.body;
        let header = container::message(&mut body);
        let header = header.ok_or_else(|| invalid(&place, "a message without a header"))?;
        let channel = self.channels.get(&header.channel).copied();
        let unknown = || invalid(&place, "a message of an unknown channel");
        Ok(Message {
            channel: channel.ok_or_else(unknown)?,
            time_ns: header.log_time,
            body,
            place,
        })
    }

    /// Returns the content of a channel, or an error for a linkwatch topic of another version.
    fn content(&mut self, channel: &container::Channel) -> Result<Channel> {
        let schema = self.schemas.get(&channel.schema).map_or("", String::as_str);
        if channel.encoding != PROTOBUF {
            return Ok(Channel::Foreign);
        }
        let is = |tool: &RecordingTool| tool.channel() == (channel.topic.as_str(), schema);
        if let Some(tool) = RecordingTool::ALL.into_iter().find(is) {
            self.tools.insert(tool);
            return Ok(Channel::Tool);
        }
        let ours = [
            (BASELINE, Channel::Baseline),
            (LABELS, Channel::Labels),
            (FRAMES, Channel::Frames),
            (VERDICTS, Channel::Verdicts),
        ];
        let known = ours.into_iter().find(|((t, _), _)| *t == channel.topic);
        let (Some(((_, message), content)), Some((package, m))) = (known, schema.rsplit_once('.'))
        else {
            return Ok(Channel::Foreign);
        };
        match (package == PACKAGE, version(package)) {
            _ if m != message => Ok(Channel::Foreign),
            (true, _) => Ok(content),
            (false, None) => Ok(Channel::Foreign),
            (false, Some(found)) => Err(Error::Version {
                what: "the recording",
                found,
                known: version(PACKAGE).unwrap_or_default(),
            }),
        }
    }
}

/// Returns the version in the name of a linkwatch package.
fn version(package: &str) -> Option<u64> {
    package.strip_prefix("linkwatch.v")?.parse().ok()
}

fn broken(e: prost::DecodeError) -> Error {
    invalid("message", e)
}

fn labels(body: Bytes) -> Result<CurveLabels> {
    let m = schema::Labels::decode(body).map_err(broken)?;
    Ok(CurveLabels::named(m.names).with_radii(m.radii))
}

/// Decodes a message. `None` if it is not an item.
fn item(
    channel: Channel,
    body: Bytes,
    (labels, received_ns): (&Arc<CurveLabels>, u64),
) -> Result<Option<RecordedItem>> {
    Ok(Some(match channel {
        Channel::Foreign | Channel::Tool | Channel::Labels => return Ok(None),
        Channel::Baseline => {
            let message = schema::Baseline::decode(body).map_err(broken)?;
            RecordedItem::Baseline(message.try_into()?)
        }
        Channel::Frames => {
            let m = schema::CurveFrame::decode(body).map_err(broken)?;
            RecordedItem::Frame(RecordedFrame {
                seq: m.seq,
                time: m.time,
                basis: messages::basis(m.basis)?,
                precision: messages::precision(m.precision)?,
                counts: m.counts,
                info: FrameInfo {
                    seq: m.seq,
                    time: m.time,
                    cuts: m.cuts,
                    baseline: m.baseline,
                    layout: m.layout,
                    time_step: m.time_step,
                    closed_by_default: false,
                    cell: cell_of(&m.cell)?,
                    labels: Arc::clone(labels),
                },
                received_ns,
                positions: m.positions,
            })
        }
        Channel::Verdicts => {
            let m = schema::Verdict::decode(body).map_err(broken)?;
            let report = m
                .report
                .ok_or_else(|| invalid("verdict", "the report is missing"))?;
            let p = m.progress.unwrap_or_default();
            RecordedItem::Verdict(Box::new(RecordedVerdict {
                report: report.try_into()?,
                progress: RecordedProgress {
                    verified: p.verified,
                    skipped: p.skipped,
                    rejected: p.rejected,
                    times: p.times.map_or_else(
                        || FrameTimes {
                            verification: Duration::from_nanos(p.check_ns),
                            ..FrameTimes::default()
                        },
                        FrameTimes::from,
                    ),
                    // Recordings of earlier versions lack it.
                    work: p.work.map_or(Ok(Work::default()), Work::try_from)?,
                    received_ns,
                    left_out: p.left_out,
                    recovered: p.recovered,
                    accepted: p.accepted,
                },
            }))
        }
    }))
}

/// Returns the name and the entries of a metadata record.
fn metadata(body: &mut Bytes) -> Option<(String, BTreeMap<String, String>)> {
    let name = string(body)?;
    let bytes = body.try_get_u32_le().ok()? as usize;
    if bytes > body.len() {
        return None;
    }
    let mut entries = body.split_to(bytes);
    let mut map = BTreeMap::new();
    while !entries.is_empty() {
        map.insert(string(&mut entries)?, string(&mut entries)?);
    }
    Some((name, map))
}
