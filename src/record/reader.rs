//! Reads a recording: the same bits that were verified, and the same reports.

mod outline;

use super::messages::{PACKAGE, Recorded, invalid};
use super::schema;
use super::{ACCEPTED, BASELINE, FRAMES, LABELS, METADATA, PROTOBUF, VERDICTS};
use crate::curve::{Basis, CurveLabels, CurveSet, Precision};
use crate::error::{Error, Result};
use crate::formats::container::{self, Container, Content, Ending, Place};
use crate::formats::with_positions;
use crate::ingest::{FrameInfo, RawFrame, ingest};
use crate::sinks::{BaselineRecord, RunProgress};
use crate::verdict::Report;
use prost::bytes::Bytes;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use std::sync::Arc;

/// An item of a recording.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a box would be an allocation per frame"
)]
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
    pub progress: RunProgress,
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
    /// Information of the simulator about the frame; the default in recordings of earlier versions.
    pub info: FrameInfo,
    /// Time at which the frame arrived, in nanoseconds since 1970.
    pub received_ns: u64,
    /// Coordinates, little-endian. Their number may contradict `counts`.
    positions: Bytes,
}

impl RecordedFrame {
    /// Checks the frame and copies it into `set`: into a new one if there is none, else in place of
    /// the previous frame, which must have had the same curves.
    ///
    /// # Errors
    ///
    /// The errors of [`RecordedFrame::check`]; the frame breaks its contract.
    pub fn ingest(&self, set: &mut Option<CurveSet>) -> Result<()> {
        self.read(|frame| ingest(frame, set, CurveSet::update))
    }

    /// Fails if the number of coordinates, names or radii contradicts the counts.
    ///
    /// # Errors
    ///
    /// [`Error::Count`] if the number of coordinates, names or radii contradicts the counts.
    pub fn check(&self) -> Result<()> {
        self.info.labels.check(self.counts.len())?;
        let counts = self.counts.iter().map(|c| u64::from(c.unsigned_abs()));
        let bytes = 3 * self.precision.bytes() as u64;
        let promised = counts.sum::<u64>().saturating_mul(bytes);
        let available = self.positions.len();
        if available as u64 == promised {
            return Ok(());
        }
        let what = "bytes of positions in a recorded frame";
        Err(Error::count(what, promised, available))
    }

    /// Calls `receive` with the frame, for example within
    /// [`Session::receive`](crate::Session::receive).
    ///
    /// # Errors
    ///
    /// The errors of [`RecordedFrame::check`] and of `receive`.
    pub fn read(&self, receive: impl FnOnce(RawFrame<'_>) -> Result<()>) -> Result<()> {
        self.check()?;
        with_positions(self.precision, &self.positions, |positions| {
            receive(RawFrame {
                basis: self.basis,
                counts: &self.counts,
                positions,
            })
        })
    }

    /// Returns true if both frames have the same curves with the same bits, in the same cell.
    pub fn same_curves(&self, other: &RecordedFrame) -> bool {
        (self.basis, self.precision) == (other.basis, other.precision)
            && self.counts == other.counts
            && self.info.cell == other.info.cell
            && self.positions == other.positions
    }
}

/// Content of a channel.
#[derive(Clone, Copy)]
enum Channel {
    Baseline,
    /// A baseline that replaces the one before without a gap.
    Accepted,
    Labels,
    Frames,
    Verdicts,
    /// Other content: skipped and counted.
    Foreign,
}

/// A message with its channel, the time at which it was logged, and its place.
type Message = (Channel, u64, Bytes, Place);

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
    metadata: BTreeMap<String, String>,
    /// Names and radii of the curves of the next frame.
    labels: Arc<CurveLabels>,
    /// Place of the last baseline that replaced another one without a gap.
    accepted: Option<Place>,
    /// Baseline of the frame to which the reader went.
    first: Option<RecordedItem>,
    skipped: u64,
}

impl RecordingReader<BufReader<File>> {
    /// Opens a file. A file that is still being written is read up to its current end.
    ///
    /// # Errors
    ///
    /// [`Error::File`]; [`Error::Format`] if the file is no MCAP file.
    pub fn open(path: &Path) -> Result<Self> {
        let container = Container::open(path)?;
        super::file::share(container.file());
        Ok(RecordingReader::on(container))
    }
}

impl<R: Read + Seek> RecordingReader<R> {
    /// Reads a recording from any input with a length.
    ///
    /// # Errors
    ///
    /// [`Error::Io`]; [`Error::Format`] if the input is no MCAP file.
    pub fn new(input: R) -> Result<Self> {
        Ok(RecordingReader::on(Container::new(input)?))
    }

    fn on(container: Container<R>) -> Self {
        RecordingReader {
            container,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            metadata: BTreeMap::new(),
            labels: Arc::default(),
            accepted: None,
            first: None,
            skipped: 0,
        }
    }

    /// Returns the metadata of the recorded run. Complete once the first item was read.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Returns the number of messages of other topics or schemas, skipped so far.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns the end of the recording, finished or truncated, once it is reached. `None` if the
    /// file is damaged.
    pub fn ending(&self) -> Option<&Ending> {
        self.container.ending()
    }

    /// Returns the next item, or `None` at the end, finished or truncated.
    ///
    /// # Errors
    ///
    /// The file is damaged; see [`RecordingReader::ending`].
    pub fn next_item(&mut self) -> Result<Option<RecordedItem>> {
        let item = self.read_item();
        self.stop_at_damage(item)
    }

    /// After an error, nothing more is read.
    fn stop_at_damage<T>(&mut self, outcome: Result<T>) -> Result<T> {
        if outcome.is_err() {
            self.container.fail();
        }
        outcome
    }

    fn read_item(&mut self) -> Result<Option<RecordedItem>> {
        if let Some(baseline) = self.first.take() {
            return Ok(Some(baseline));
        }
        while let Some(message) = self.next_message(false)? {
            match self.item(message)? {
                Some(item) => return Ok(Some(item)),
                None => self.skipped += 1,
            }
        }
        Ok(None)
    }

    /// Returns the next message, or only its first bytes if it has curves and `skims` is true. Also
    /// updates the state from messages that describe the run.
    fn next_message(&mut self, skims: bool) -> Result<Option<Message>> {
        loop {
            let channels = &self.channels;
            let whole = |id| matches!(channels.get(&id), Some(Channel::Labels | Channel::Verdicts));
            let record = match skims {
                true => self.container.skim(whole)?,
                false => self.container.next()?,
            };
            let Some((place, content)) = record else {
                return Ok(None);
            };
            match content {
                Content::Schema(id, name, _) => {
                    self.schemas.insert(id, name);
                }
                Content::Channel(c) => {
                    let content = self.channel(&c)?;
                    self.channels.insert(c.id, content);
                }
                Content::Metadata(name, entries) if name == METADATA => {
                    self.metadata.extend(entries);
                }
                Content::Metadata(..) | Content::Other => {}
                Content::Message(channel, log_time, body) => match self.channels.get(&channel) {
                    None => return Err(invalid(&words(place), "a message of an unknown channel")),
                    Some(Channel::Labels) => {
                        let m: schema::Labels = decode(body, place)?;
                        let labels = CurveLabels::named(m.names).with_radii(m.radii);
                        self.labels = Arc::new(labels);
                    }
                    Some(Channel::Accepted) => self.accepted = Some(place),
                    Some(&channel) => return Ok(Some((channel, log_time, body, place))),
                },
            }
        }
    }

    /// Returns the content of a channel, or an error for a linkwatch topic of another version.
    fn channel(&self, channel: &container::Channel) -> Result<Channel> {
        let schema = self.schemas.get(&channel.schema).map_or("", String::as_str);
        let (package, message) = schema.rsplit_once('.').unwrap_or_default();
        let content = match (channel.topic.as_str(), message) {
            _ if channel.encoding != PROTOBUF => return Ok(Channel::Foreign),
            BASELINE => Channel::Baseline,
            ACCEPTED => Channel::Accepted,
            LABELS => Channel::Labels,
            FRAMES => Channel::Frames,
            VERDICTS => Channel::Verdicts,
            _ => return Ok(Channel::Foreign),
        };
        match version(package) {
            _ if package == PACKAGE => Ok(content),
            None => Ok(Channel::Foreign),
            Some(found) => Err(Error::Version {
                what: "the recording",
                found,
                known: version(PACKAGE).unwrap_or_default(),
            }),
        }
    }

    /// Decodes a message. `None` if it is not an item.
    fn item(&self, (channel, time, body, place): Message) -> Result<Option<RecordedItem>> {
        let item = match channel {
            Channel::Foreign | Channel::Labels => return Ok(None),
            Channel::Baseline | Channel::Accepted => {
                let read = Recorded::<schema::Baseline>::read(decode(body, place)?);
                read.map(RecordedItem::Baseline)
            }
            Channel::Frames => self.frame(decode(body, place)?, time),
            Channel::Verdicts => verdict(decode(body, place)?, time),
        };
        item.map(Some).map_err(|e| invalid(&words(place), e))
    }

    fn frame(&self, m: schema::CurveFrame, received_ns: u64) -> Result<RecordedItem> {
        Ok(RecordedItem::Frame(RecordedFrame {
            seq: m.seq,
            time: m.time,
            basis: Recorded::read(m.basis)?,
            precision: Recorded::read(m.precision)?,
            counts: m.counts,
            info: FrameInfo {
                cuts: m.cuts,
                baseline: m.baseline,
                layout: m.layout,
                time_step: m.time_step,
                cell: Recorded::read(m.cell)?,
                left_out: Recorded::read(m.left_out)?,
                translated: Recorded::read(m.translated)?,
                labels: Arc::clone(&self.labels),
                ..FrameInfo::at(m.seq, m.time)
            },
            received_ns,
            positions: m.positions,
        }))
    }
}

fn verdict(m: schema::Verdict, received_ns: u64) -> Result<RecordedItem> {
    let report = m.report;
    let report = report.ok_or_else(|| invalid("verdict", "the report is missing"))?;
    let mut progress = RunProgress::read(m.progress.unwrap_or_default())?;
    progress.received_ns = received_ns;
    let report = Report::read(report)?;
    let recorded = RecordedVerdict { report, progress };
    Ok(RecordedItem::Verdict(Box::new(recorded)))
}

/// Returns the version in the name of a linkwatch package.
fn version(package: &str) -> Option<u64> {
    package.strip_prefix("linkwatch.v")?.parse().ok()
}

fn decode<M: prost::Message + Default>(body: Bytes, place: Place) -> Result<M> {
    M::decode(body).map_err(|e| invalid(&words(place), invalid("message", e)))
}

fn words(place: Place) -> String {
    format!("byte {}", place.at)
}
