//! MCAP files of other programs: lines that tools draw, as the frames of a motion.
//!
//! | type | encoding | curves |
//! |---|---|---|
//! | `foxglove.SceneUpdate` | `protobuf`, `json` | lines of the entities, by `id` |
//! | `visualization_msgs/msg/MarkerArray` | `cdr` (ROS 2) | strips and lists, by `ns` and `id` |
//! | `visualization_msgs/msg/Marker` | `cdr` (ROS 2) | the same |
//!
//! Messages change a scene: they add, replace and delete curves by name ([`state`]). A frame is the
//! whole scene after all messages of one time: that of the message, or that of the log if the
//! message has none. A message that changes a curve of the current frame again begins the next
//! frame, whatever its time.
//!
//! All curves of a file must have the same `frame_id`, because transforms between coordinate
//! systems are not read. Widths and colours are ignored, as are cubes, spheres, points, texts and
//! meshes, which are no curves. Cylinders, strips of arrows, and topics with lines of other types
//! are counted as left out ([`LeftOut`]). A file without any line is an error.
//!
//! Cost: the file is read twice, first for its topics. Memory: that of the scene, of the largest
//! chunk, and of the values of a message, which has at most 200 times its size (if it is a list of
//! empty entities). Every count is compared with the bytes that are there.

mod curves;
mod markers;
mod scene;
mod state;

use self::markers::Layout;
use self::state::{State, Update};
use super::frames::{FrameSource, ModelFrame, ReadOptions, Source};
use crate::error::{Error, Result};
use crate::formats::container::{self, Container, Ending, invalid};
use crate::ingest::FrameInfo;
use crate::verdict::LeftOut;
use crate::words::{if_any, plural};
use prost::bytes::Bytes;
use std::collections::{BTreeMap, HashMap};
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

const FORMAT: &str = "MCAP file";
const NO_CURVES: &str = "no curves are left in this frame";

/// Types of messages with curves.
const SCENE_UPDATE: &str = "foxglove.SceneUpdate";
const MARKER_ARRAY: &str = "visualization_msgs/msg/MarkerArray";
const MARKER: &str = "visualization_msgs/msg/Marker";

/// Types of messages with lines that are not read.
const UNREAD: [&str; 10] = [
    "foxglove.PosesInFrame",
    "geometry_msgs/Polygon",
    "geometry_msgs/PolygonStamped",
    "geometry_msgs/PoseArray",
    "nav_msgs/Path",
    "visualization_msgs/InteractiveMarker",
    "visualization_msgs/InteractiveMarkerInit",
    "visualization_msgs/InteractiveMarkerUpdate",
    "visualization_msgs/Marker",
    "visualization_msgs/MarkerArray",
];

/// Decodes a message of a channel. The error is in words.
type Decode = Arc<dyn Fn(&[u8]) -> Result<Update, String> + Send + Sync>;

/// Returns the function that decodes the messages of a channel. `None` if they have no curves, an
/// error in words if curves are encoded in a way that is not read.
fn decoder((name, text): &Schema, encoding: &str) -> Option<Result<Decode, String>> {
    Some(Ok(match (name.as_str(), encoding) {
        (SCENE_UPDATE, "protobuf") => Arc::new(scene::protobuf),
        (SCENE_UPDATE, "json") => Arc::new(scene::json),
        (MARKER_ARRAY | MARKER, "cdr") => {
            let (layout, is_array) = (Layout::of(text), name == MARKER_ARRAY);
            Arc::new(move |message| markers::read(message, layout, is_array))
        }
        (SCENE_UPDATE | MARKER_ARRAY | MARKER, other) => {
            let what = "is not read: protobuf and json of Foxglove are, and cdr of ROS 2";
            return Some(Err(format!("{name} encoded as {other:?} {what}")));
        }
        _ => return None,
    }))
}

/// Name of a message type, and its text.
type Schema = (String, Bytes);

/// Channels of a file.
#[derive(Default)]
struct Channels {
    /// Topic of each channel, and how to decode the messages of those that are read.
    channels: HashMap<u16, (String, Option<Decode>)>,
    /// All topics, with their types, and the reason why curves on them are not read.
    topics: BTreeMap<String, (String, Option<String>)>,
    /// True if linkwatch wrote the file.
    is_recording: bool,
}

impl Channels {
    fn find<R: Read + Seek>(container: &mut Container<R>) -> Result<Channels> {
        let mut found = Channels::default();
        let mut schemas: HashMap<u16, Schema> = HashMap::new();
        while let Some((_, content)) = container.next()? {
            match content {
                container::Content::Schema(id, name, text) => {
                    schemas.insert(id, (name, text));
                }
                container::Content::Channel(c) => {
                    found.add(c.id, c.topic, schemas.get(&c.schema), &c.encoding);
                }
                _ => {}
            }
        }
        Ok(found)
    }

    fn add(&mut self, id: u16, topic: String, schema: Option<&Schema>, encoding: &str) {
        let decode = schema.and_then(|schema| decoder(schema, encoding));
        let name = schema.map_or_else(String::new, |(name, _)| name.clone());
        self.is_recording |= name.starts_with("linkwatch.v");
        let (decode, why) = match decode.transpose() {
            Ok(decode) => (decode, None),
            Err(why) => (None, Some(why)),
        };
        self.channels.insert(id, (topic.clone(), decode));
        self.topics.insert(topic, (name, why));
    }

    /// Returns the topics with lines that are not read.
    fn left_out(&self) -> Vec<LeftOut> {
        let mut list = Vec::new();
        for (topic, (name, why)) in &self.topics {
            let is_unread = UNREAD.contains(&&*name.replace("/msg/", "/"));
            if why.is_some() || is_unread && !self.reads(topic) {
                let kind = ["topic that may have lines", "topics that may have lines"];
                LeftOut::add(&mut list, kind, || format!("{topic} ({name})"));
            }
        }
        list
    }

    fn reads(&self, topic: &str) -> bool {
        let mut channels = self.channels.values();
        channels.any(|(name, decode)| name == topic && decode.is_some())
    }

    /// Returns the topic that is read.
    fn choose(&self, wanted: Option<&str>) -> Result<String> {
        if self.is_recording {
            let what = "a recording of linkwatch, which `linkwatch replay` verifies";
            return Err(Error::unsupported(FORMAT, what));
        }
        let read = self.topics.keys().filter(|topic| self.reads(topic));
        let read: Vec<&str> = read.map(String::as_str).collect();
        let why_not = |topic: &str| self.topics.get(topic)?.1.as_ref();
        let unread = self.topics.keys().find(|topic| why_not(topic).is_some());
        let what = match (wanted, &read[..]) {
            (Some(wanted), topics) if topics.contains(&wanted) => return Ok(wanted.into()),
            (None, [topic]) => return Ok((*topic).into()),
            (Some(wanted), _) => match self.topics.get(wanted) {
                Some((_, Some(why))) => format!("topic {wanted}: {why}"),
                Some((kind, None)) => {
                    format!("topic {wanted} has messages of type {kind:?}, without curves")
                }
                None => format!("no topic {wanted}; {}", self.list()),
            },
            (None, []) => match unread.and_then(|topic| Some((topic, why_not(topic)?))) {
                Some((topic, why)) => format!("topic {topic}: {why}"),
                None => format!(
                    "no curves: no topic has the type {SCENE_UPDATE}, {MARKER_ARRAY} or {MARKER}; \
                     {}",
                    self.list()
                ),
            },
            (None, topics) => format!(
                "several topics have curves: {}; choose one of them (option `topic`)",
                topics.join(", ")
            ),
        };
        Err(Error::unsupported(FORMAT, what))
    }

    /// Returns the topics as text.
    fn list(&self) -> String {
        /// Maximum number of topics that are named.
        const NAMED: usize = 12;
        if self.topics.is_empty() {
            return "it has no topics".into();
        }
        let words = |(topic, (kind, _)): (&String, &(String, _))| format!("{topic} ({kind})");
        let named: Vec<String> = self.topics.iter().take(NAMED).map(words).collect();
        let more = self.topics.len().saturating_sub(NAMED) as u64;
        let more = if_any(more, || format!(" and {more} more"));
        format!("its topics: {}{more}", named.join(", "))
    }
}

/// Opens a file.
pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Source<'static>> {
    let container = Container::open(path)?;
    let frames = McapFrames::new(container, options.topic.as_deref())?;
    Ok(Box::new(frames))
}

/// A message of the chosen topic.
struct Message {
    update: Update,
    log_time: u64,
    /// Place in the file, as text.
    place: String,
}

impl Message {
    /// Returns the time of its frame.
    fn time(&self) -> u64 {
        self.update.stamp.unwrap_or(self.log_time)
    }
}

/// Frames of an MCAP file.
struct McapFrames<R> {
    container: Container<R>,
    channels: Channels,
    state: State,
    /// The chosen topic.
    topic: String,
    /// Topics with lines that are not read, unless the caller chose the topic.
    left_out: Vec<LeftOut>,
    /// First message of the next frame.
    next: Option<Message>,
    /// Number of the next frame.
    seq: u64,
}

impl<R: Read + Seek> McapFrames<R> {
    fn new(mut container: Container<R>, topic: Option<&str>) -> Result<Self> {
        let found = Channels::find(&mut container)?;
        let chosen = found.choose(topic)?;
        container.go_to_start()?;
        Ok(McapFrames {
            container,
            left_out: topic.map_or_else(|| found.left_out(), |_| Vec::new()),
            channels: found,
            state: State::default(),
            topic: chosen,
            next: None,
            seq: 0,
        })
    }

    /// Returns the next message of the topic.
    fn next_message(&mut self) -> Result<Option<Message>> {
        if let Some(next) = self.next.take() {
            return Ok(Some(next));
        }
        while let Some((place, content)) = self.container.next()? {
            let container::Content::Message(channel, log_time, body) = content else {
                continue;
            };
            let place = format!("message at byte {}", place.at);
            let channel = self.channels.channels.get(&channel);
            let unknown = || invalid(&place, "a message of an unknown channel");
            let (topic, decode) = channel.ok_or_else(unknown)?;
            if let Some(decode) = decode.as_ref().filter(|_| *topic == self.topic) {
                return Ok(Some(Message {
                    update: decode(&body).map_err(|what| Error::format(FORMAT, &place, what))?,
                    log_time,
                    place,
                }));
            }
        }
        Ok(None)
    }

    /// Returns an error if the file was cut off. `lost` is true if a frame at its end was not
    /// returned, because messages of it may be missing.
    fn check_end(&self, lost: bool) -> Result<()> {
        let Some(Ending::Cut { at, what }) = self.container.ending() else {
            return Ok(());
        };
        let frames = plural(self.seq, "frame");
        let last = match lost {
            true => ", but not the one at the end: messages of it may be missing",
            false => "",
        };
        let what = format!("the file was cut off in {what}; {frames} before that were read{last}");
        Err(Error::format(FORMAT, format_args!("byte {at}"), what))
    }

    /// Returns the error of a file without lines, which names what it has.
    fn no_lines(&self) -> Error {
        let seen: Vec<&str> = self.state.seen.iter().copied().collect();
        let has = match seen.is_empty() {
            true => "its messages are empty, or it has none".into(),
            false => format!("only {}, which are not read", seen.join(", ")),
        };
        let what = format!(
            "no lines on topic {}: {has}; publish each curve as a marker of type LINE_STRIP \
             ({MARKER_ARRAY}), or as a line of {SCENE_UPDATE}",
            self.topic
        );
        Error::unsupported(FORMAT, what)
    }

    /// Applies the messages of a frame, of which this is the first one. Returns the place of the
    /// last one.
    fn apply(&mut self, mut message: Message) -> Result<String> {
        let time = message.time();
        self.state.begin(message.log_time);
        loop {
            let applied = self.state.apply(message.update);
            applied.map_err(|what| Error::format(FORMAT, &message.place, what))?;
            // If the next message cannot be read, the frame is lost: it may belong to it.
            match self.next_message()? {
                Some(next) if next.time() == time && !self.state.is_changed_by(&next.update) => {
                    message = next;
                }
                next => {
                    self.next = next;
                    return Ok(message.place);
                }
            }
        }
    }
}

impl<R: Read + Seek + Send> FrameSource for McapFrames<R> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        while let Some(message) = self.next_message()? {
            let time = message.time();
            let place = self.apply(message)?;
            if self.next.is_none() && !self.state.is_renewed() {
                self.check_end(true)?;
            }
            let curves = match self.state.is_empty() {
                // Before the first curve there is nothing to verify.
                true if self.seq == 0 => continue,
                true => Err(Error::format(FORMAT, place, NO_CURVES)),
                false => self.state.curves(),
            };
            let mut info = FrameInfo::at(self.seq, time as f64 * 1e-9);
            info.left_out = [&self.left_out[..], &self.state.left_out()].concat();
            let curves = curves.map(|(curves, labels)| {
                info.labels = labels;
                curves
            });
            self.seq += 1;
            return Ok(Some(ModelFrame::of(info, curves)));
        }
        self.check_end(false)?;
        match self.seq {
            0 => Err(self.no_lines()),
            _ => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests;
