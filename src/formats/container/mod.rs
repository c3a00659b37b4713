//! MCAP container: reads records from a file of any size, in bounded memory. Source:
//! <https://mcap.dev/spec>.
//!
//! A record is an opcode, a length and its bytes; a chunk is a record of records. The readers of
//! the `mcap` crate (0.26) are not used for this: `LinearReader` allocates the promised length of a
//! record, and `parse_record` that of a string, before the bytes are there: a damaged length takes
//! up to 4 GiB. In a chunk whose inner lengths are wrong, the first subtracts below zero, which
//! panics if overflow is checked. It also does not distinguish a truncated file from a corrupt one,
//! and cannot skip the content of messages ([`Container::skim`]). Linkwatch writes no compressed
//! chunks, but other tools do: [`unpack`].
//!
//! A finished file ends with the magic bytes. In such a file, any mismatch is corruption. In any
//! other file, a record that extends past the end marks the point at which the writer was stopped
//! or the disk was full; nothing before it is lost. Records of a complete chunk are returned after
//! its checksum has been verified. The checksum of a truncated chunk cannot be verified; its
//! complete records are returned nevertheless.
//!
//! Memory: the size of the largest chunk. Buffers are allocated only for bytes that the file has,
//! or that a chunk unpacks to.

pub(crate) mod foxglove;
mod unpack;

use crate::error::{Error, Result};
use crate::formats::open_file;
use mcap::MAGIC;
use mcap::records::op;
use prost::bytes::{Buf, Bytes};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes of the opcode and the length.
const RECORD_HEADER: u64 = 9;

/// Bytes of the header of a chunk without compression: start and end time, length and checksum of
/// the records, length of the name of the compression, length as stored.
const CHUNK_HEADER: u64 = 8 + 8 + 8 + 4 + 4 + 8;

/// Length of the name of the compression, in the header of a chunk.
const COMPRESSION: std::ops::Range<usize> = 28..32;

/// Maximum size of a record: a protobuf message has at most 2 GiB, and a chunk written by linkwatch
/// holds one of them.
const RECORD_BYTES: u64 = 3 << 30;

/// Bytes of a skimmed message that are read: more than its header, and the number and time at the
/// start of a frame.
const SKIMMED_BYTES: u64 = 55;

/// Size of the blocks in which skipped records are read.
const SKIP_BYTES: u64 = 1 << 20;

/// Maximum size of an unpacked chunk, unless its file is larger.
const UNPACKED_BYTES: u64 = 64 << 20;

/// End of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The recording was finished: everything that was recorded is present.
    Finished,
    /// The file was not finished: the writer was stopped, or could not write (a full disk). The
    /// returned records are valid; later ones are lost.
    Cut {
        /// First byte of the incomplete part.
        at: u64,
        /// Name of the incomplete part.
        what: &'static str,
    },
}

/// Place of a record, for [`Container::go_to`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    /// Position in the file of the record, or of its chunk.
    pub at: u64,
    /// Position of the record within the unpacked records of its chunk; 0 outside of chunks.
    within: u64,
}

/// Content of a record.
pub(crate) enum Content {
    /// Message type: its number, its name and its text.
    Schema(u16, String, Bytes),
    Channel(Channel),
    /// Message: its channel, its time in the log in nanoseconds since 1970 (or since any other
    /// start), and its bytes.
    Message(u16, u64, Bytes),
    /// Metadata: a name and entries.
    Metadata(String, BTreeMap<String, String>),
    Other,
}

/// Messages of one type on a topic.
pub(crate) struct Channel {
    pub id: u16,
    pub schema: u16,
    pub topic: String,
    pub encoding: String,
}

/// A record that readers of messages use: its place and its content.
type Record = (Place, Content);

/// Parses a record.
fn parse(opcode: u8, mut body: Bytes, place: Place) -> Result<Record> {
    let mut parse = || {
        Some(match opcode {
            op::SCHEMA => {
                let (id, name) = (body.try_get_u16_le().ok()?, string(&mut body)?);
                let (_encoding, text) = (string(&mut body)?, sized(&mut body)?);
                Content::Schema(id, name, text)
            }
            op::CHANNEL => Content::Channel(Channel {
                id: body.try_get_u16_le().ok()?,
                schema: body.try_get_u16_le().ok()?,
                topic: string(&mut body)?,
                encoding: string(&mut body)?,
            }),
            op::MESSAGE => {
                let channel = body.try_get_u16_le().ok()?;
                let _sequence = body.try_get_u32_le().ok()?;
                let log_time = body.try_get_u64_le().ok()?;
                let _publish_time = body.try_get_u64_le().ok()?;
                Content::Message(channel, log_time, std::mem::take(&mut body))
            }
            op::METADATA => {
                let (name, mut rest) = (string(&mut body)?, sized(&mut body)?);
                let mut entries = BTreeMap::new();
                while !rest.is_empty() {
                    entries.insert(string(&mut rest)?, string(&mut rest)?);
                }
                Content::Metadata(name, entries)
            }
            _ => Content::Other,
        })
    };
    let content = parse().ok_or_else(|| {
        let what = match opcode {
            op::SCHEMA => "an invalid schema",
            op::CHANNEL => "an invalid channel",
            op::MESSAGE => "a message without a header",
            _ => "an invalid metadata record",
        };
        invalid(&format!("byte {}", place.at), what)
    })?;
    Ok((place, content))
}

/// Returns the bytes after a length. `None` if there are fewer.
fn sized(bytes: &mut Bytes) -> Option<Bytes> {
    let n = bytes.try_get_u32_le().ok()? as usize;
    (n <= bytes.len()).then(|| bytes.split_to(n))
}

fn string(bytes: &mut Bytes) -> Option<String> {
    String::from_utf8(sized(bytes)?.into()).ok()
}

/// Creates the error of a file or message with invalid content.
pub(crate) fn invalid(place: &str, what: impl std::fmt::Display) -> Error {
    Error::format("recording", place, what)
}

/// Reads records. Returns no more after the first error or the end.
pub(crate) struct Container<R> {
    input: R,
    length: u64,
    /// First byte that was not read yet.
    at: u64,
    /// True if the end of the file is that of a finished one.
    closed: bool,
    /// Records of the last chunk that are left in memory, and the place of the first of them.
    chunk: Bytes,
    next: Place,
    /// Chunk whose records are read from the file one by one: its position, that of its first
    /// record, and its end.
    walked: Option<[u64; 3]>,
    ending: Option<Ending>,
    failed: bool,
    /// Checksum of all bytes read so far. The data section ends with the expected one, which
    /// detects damage between chunks. `None` after bytes were not read.
    checksum: Option<crc32fast::Hasher>,
}

impl Container<BufReader<File>> {
    /// Opens a file. A file that is still being written is read up to its current end.
    pub fn open(path: &Path) -> Result<Self> {
        Container::new(BufReader::new(open_file(path)?.0))
    }

    /// Returns the file.
    pub fn file(&self) -> &File {
        self.input.get_ref()
    }
}

impl<R: Read + Seek> Container<R> {
    /// Reads any input with a length.
    pub fn new(mut input: R) -> Result<Self> {
        let length = input.seek(SeekFrom::End(0))?;
        let magic = MAGIC.len() as u64;
        let mut container = Container {
            input,
            length,
            at: 0,
            closed: false,
            chunk: Bytes::new(),
            next: Place { at: 0, within: 0 },
            walked: None,
            ending: None,
            failed: false,
            checksum: None,
        };
        if length >= 2 * magic {
            container.input.seek(SeekFrom::Start(length - magic))?;
            container.closed = container.take(magic)?.as_ref() == MAGIC;
        }
        container.input.seek(SeekFrom::Start(0))?;
        container.at = 0;
        container.checksum = Some(crc32fast::Hasher::new());
        let start = container.take(length.min(magic))?;
        if start[..] != MAGIC[..start.len()] {
            return Err(invalid("start of the file", "not an MCAP file"));
        }
        if length < magic {
            container.cut(0, "the start of the file");
        }
        Ok(container)
    }

    /// Returns the end of the file once there are no more records; `None` after damage.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// Returns the next record. The records of chunks are returned one by one.
    pub fn next(&mut self) -> Result<Option<Record>> {
        self.advance(None)
    }

    /// Returns the next record like [`Container::next`], but reads only the first bytes of a
    /// message, unless `whole` returns true for its channel. Verifies no checksum. It needs no
    /// index, so it works for files that were cut off.
    ///
    /// Cost: a read of a few bytes for each record. Compressed chunks are read and unpacked.
    pub fn skim(&mut self, whole: impl Fn(u16) -> bool) -> Result<Option<Record>> {
        self.checksum = None;
        self.advance(Some(&whole))
    }

    /// Goes to a record that was read or skimmed before. [`Container::next`] returns it next.
    pub fn go_to(&mut self, place: Place) -> Result<()> {
        self.restart_at(place.at)?;
        if place.within > 0 {
            self.step(None)?;
            if let Some([_, first, _]) = self.walked {
                self.skip_to(first + place.within)?;
            }
            while !self.chunk.is_empty() && self.next.within < place.within {
                self.pop()?;
            }
        }
        Ok(())
    }

    /// Goes to the first record of the file.
    pub fn go_to_start(&mut self) -> Result<()> {
        self.restart_at(self.length.min(MAGIC.len() as u64))
    }

    /// Returns no more records, because after damage the length of a record may be wrong.
    pub fn fail(&mut self) {
        self.chunk.clear();
        (self.failed, self.ending) = (true, None);
    }

    fn restart_at(&mut self, at: u64) -> Result<()> {
        self.input.seek(SeekFrom::Start(at))?;
        self.at = at;
        self.chunk.clear();
        (self.walked, self.ending, self.checksum) = (None, None, None);
        Ok(())
    }

    /// Goes to a byte near the current one.
    fn skip_to(&mut self, at: u64) -> Result<()> {
        self.input.seek_relative(at as i64 - self.at as i64)?;
        self.at = at;
        Ok(())
    }

    /// Returns the next record, or its first bytes ([`Container::skim`]).
    fn advance(&mut self, whole: Option<&dyn Fn(u16) -> bool>) -> Result<Option<Record>> {
        while !self.failed && self.ending.is_none() {
            let found = match self.chunk.is_empty() {
                true => self.step(whole),
                false => self.pop().map(Some),
            };
            match found {
                Ok(None) => {}
                Ok(record) => return Ok(record),
                Err(e) => {
                    self.fail();
                    return Err(e);
                }
            }
        }
        Ok(None)
    }

    /// Returns the next record of the chunk in memory.
    fn pop(&mut self) -> Result<Record> {
        let (left, place) = (self.chunk.len(), self.next);
        let opcode = self.chunk.get_u8();
        let length = self.chunk.try_get_u64_le().unwrap_or(RECORD_HEADER);
        if length > self.chunk.len() as u64 {
            let what = format!("a record of {length} bytes, {left} are left in the chunk");
            return Err(invalid(&format!("chunk at byte {}", place.at), what));
        }
        self.next.within += RECORD_HEADER + length;
        parse(opcode, self.chunk.split_to(length as usize), place)
    }

    fn cut(&mut self, at: u64, what: &'static str) {
        self.ending.get_or_insert(Ending::Cut { at, what });
    }

    /// Reads one record of the file, or enters a chunk.
    fn step(&mut self, whole: Option<&dyn Fn(u16) -> bool>) -> Result<Option<Record>> {
        self.walked.take_if(|[.., end]| self.at >= *end);
        let at = self.at;
        let left = self.walked.map_or(self.length, |[.., end]| end) - at;
        if left == 0 && !self.closed {
            self.cut(at, "the end of the file");
            return Ok(None);
        }
        if left < RECORD_HEADER {
            return self.overrun(at, RECORD_HEADER, "a record").map(|()| None);
        }
        let before = self.checksum.clone();
        let mut header = self.take(RECORD_HEADER)?;
        let (opcode, length) = (header.get_u8(), header.get_u64_le());
        let left = left - RECORD_HEADER;
        if length <= left && length > RECORD_BYTES {
            let what = format!("a record of {length} bytes, at most {RECORD_BYTES} are read");
            return Err(invalid(&format!("byte {at}"), what));
        }
        match opcode {
            op::DATA_END if length == 4 && left >= 4 => {
                let expected = self.take(4)?.get_u32_le();
                let found = before.map_or(expected, crc32fast::Hasher::finalize);
                if expected != 0 && expected != found {
                    let what = format!("checksum {found:08x}, expected {expected:08x}");
                    return Err(invalid("data of the whole file", what));
                }
                self.check_tail()?;
                self.ending = Some(Ending::Finished);
            }
            op::CHUNK if length <= left || !self.closed => {
                self.enter(at, length, left, whole.is_some())?;
            }
            _ if length > left => self.overrun(at, length, "a record")?,
            op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA => {
                let (at, within) = match self.walked {
                    Some([chunk, first, _]) => (chunk, at - first),
                    None => (at, 0),
                };
                let place = Place { at, within };
                let body = match whole.filter(|_| opcode == op::MESSAGE && length >= 2) {
                    Some(whole) => self.take_begin(length, whole)?,
                    None => self.take(length)?,
                };
                return parse(opcode, body, place).map(Some);
            }
            0 | op::DATA_END | op::FOOTER => {
                let what = format!("a record with opcode {opcode} and {length} bytes");
                return Err(invalid(&format!("byte {at}"), what));
            }
            // Indexes, attachments and private records are not used, but read for the checksum.
            _ => {
                let mut left = length;
                while left > 0 {
                    let block = left.min(SKIP_BYTES);
                    self.take(block)?;
                    left -= block;
                }
            }
        }
        Ok(None)
    }

    /// Fails if anything follows the records after the data, as in files that were joined.
    fn check_tail(&mut self) -> Result<()> {
        while self.length - self.at >= RECORD_HEADER {
            let mut header = self.take(RECORD_HEADER)?;
            let (opcode, length) = (header.get_u8(), header.get_u64_le());
            if length > self.length - self.at {
                break;
            }
            let end = self.at + length;
            self.skip_to(end)?;
            let more = (self.length - end).saturating_sub(MAGIC.len() as u64);
            if opcode == op::FOOTER && more > 0 {
                let what = format!(
                    "{more} bytes after the end of the recording: if files were joined, give each \
                     of them alone"
                );
                let end = end + MAGIC.len() as u64;
                return Err(invalid(&format!("byte {end}"), what));
            }
        }
        Ok(())
    }

    /// Reads the first bytes of a message, or all if `whole` returns true for its channel.
    fn take_begin(&mut self, length: u64, whole: &dyn Fn(u16) -> bool) -> Result<Bytes> {
        let begin = self.take(length.min(SKIMMED_BYTES))?;
        let rest = length - begin.len() as u64;
        if whole((&begin[..2]).get_u16_le()) {
            return Ok([begin, self.take(rest)?].concat().into());
        }
        self.skip_to(self.at + rest)?;
        Ok(begin)
    }

    /// Handles a record that extends past the end of the file.
    fn overrun(&mut self, at: u64, length: u64, what: &'static str) -> Result<()> {
        if self.closed {
            let left = self.length - at;
            let found = format!("{what} of {length} bytes, {left} bytes are left in the file");
            return Err(invalid(&format!("byte {at}"), found));
        }
        self.cut(at, what);
        Ok(())
    }

    /// Reads `n` bytes, which the file has by its length.
    fn take(&mut self, n: u64) -> Result<Bytes> {
        let mut bytes = Vec::with_capacity(usize::try_from(n).unwrap_or(usize::MAX));
        let got = (&mut self.input).take(n).read_to_end(&mut bytes)? as u64;
        if got < n {
            let what = "bytes of a recording (it became shorter while it was read)";
            return Err(Error::count(what, n, got));
        }
        self.at += n;
        if let Some(checksum) = &mut self.checksum {
            checksum.update(&bytes);
        }
        Ok(bytes.into())
    }

    /// Enters a chunk. Its records come from memory, after its checksum was verified. If it is
    /// skimmed, or a truncated file ends in it, they are read like those outside of chunks, up to
    /// the first incomplete one.
    fn enter(&mut self, at: u64, length: u64, left: u64, skims: bool) -> Result<()> {
        let is_complete = length <= left;
        if !is_complete && left < CHUNK_HEADER {
            self.cut(at, "a chunk");
            return Ok(());
        }
        if !is_complete || skims && length >= CHUNK_HEADER {
            let first = self.at + CHUNK_HEADER;
            let head = self.take(CHUNK_HEADER)?;
            if head[COMPRESSION] == [0; 4] {
                let stored = (&head[32..]).get_u64_le();
                let end = match is_complete {
                    true => first + stored.min(length - CHUNK_HEADER),
                    false => self.length,
                };
                self.walked = Some([at, first, end]);
                return Ok(());
            }
            if !is_complete {
                // Truncated compressed data may end in the middle of any record.
                self.cut(at, "a compressed chunk");
                return Ok(());
            }
            self.skip_to(first - CHUNK_HEADER)?;
        }
        let mut rest = self.take(length)?;
        let place = || format!("chunk at byte {at}");
        // Start and end time, length and checksum of the records, compression, length as stored.
        let mut parse = || {
            rest.try_get_u64_le().ok()?;
            rest.try_get_u64_le().ok()?;
            let unpacked = rest.try_get_u64_le().ok()?;
            let checksum = rest.try_get_u32_le().ok()?;
            let compression = string(&mut rest)?;
            Some((unpacked, checksum, compression, rest.try_get_u64_le().ok()?))
        };
        let Some((unpacked, checksum, compression, stored)) = parse() else {
            return Err(invalid(&place(), "its header is too short"));
        };
        let there = rest.len();
        if stored > there as u64 || (compression.is_empty() && stored != unpacked) {
            let what =
                format!("{stored} bytes of records promised, {unpacked} unpacked, {there} there");
            return Err(invalid(&place(), what));
        }
        rest.truncate(stored as usize);
        if !compression.is_empty() {
            let limit = self.length.max(UNPACKED_BYTES);
            rest = unpack::unpack(&compression, &rest, unpacked, limit)
                .map_err(|what| invalid(&place(), what))?
                .into();
        }
        let found = crc32fast::hash(&rest);
        // The value 0 means that the writer computed no checksum.
        if checksum != 0 && checksum != found {
            let what = format!("checksum {found:08x}, expected {checksum:08x}");
            return Err(invalid(&place(), what));
        }
        self.chunk = rest;
        self.next = Place { at, within: 0 };
        Ok(())
    }
}
