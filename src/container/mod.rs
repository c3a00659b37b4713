//! MCAP container: reads records from a file of any size, in bounded memory. Source:
//! <https://mcap.dev/spec>.
//!
//! A record is an opcode, a length and its bytes; a chunk is a record of records. The reader of the
//! `mcap` crate is not used for this. In a chunk whose inner lengths are wrong it subtracts below
//! zero (mcap 0.26, `sans_io/linear_reader.rs`), which panics if overflow is checked. It also does
//! not distinguish a truncated file from a corrupt one. Linkwatch writes no compressed chunks, but
//! other tools do: [`unpack`].
//!
//! A finished file ends with the magic bytes. In such a file, any mismatch is corruption. In any
//! other file, a record that extends past the end marks the point at which the writer was stopped
//! or the disk was full; nothing before it is lost. Records of a complete chunk are returned after
//! its checksum has been verified. The checksum of a truncated chunk cannot be verified; its
//! complete records are returned nevertheless.
//!
//! Memory: the size of the largest chunk. Buffers are allocated only for bytes that the file has,
//! or that a chunk unpacks to.

mod unpack;

mod skim;
use crate::error::{Error, Result};
use prost::bytes::{Buf, Bytes};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// First and last bytes of a file.
const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Opcodes of the records that are read.
pub(crate) mod op {
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const METADATA: u8 = 0x0c;
    pub const DATA_END: u8 = 0x0f;
}

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

/// A record that readers of messages use.
pub(crate) struct Record {
    pub opcode: u8,
    pub body: Bytes,
    pub place: Place,
}

/// Reads records. Returns no more after the first error or the end.
pub(crate) struct Container<R> {
    input: R,
    length: u64,
    /// First byte that was not read yet.
    at: u64,
    /// True if the end of the file is that of a finished one.
    closed: bool,
    /// Records of the last chunk, last first, and the place of the next one.
    chunk: Vec<Bytes>,
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
        // Checked before opening, because opening a pipe waits for its writer.
        let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
        if !metadata.is_file() {
            let why = "a recording is read from a regular file";
            return Err(Error::file(path)(std::io::Error::other(why)));
        }
        let file = File::open(path).map_err(Error::file(path))?;
        Container::new(BufReader::new(file))
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
            chunk: Vec::new(),
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
        loop {
            if let Some(record) = self.pop() {
                return Ok(Some(record));
            }
            if self.failed || self.ending.is_some() {
                return Ok(None);
            }
            match self.step() {
                Ok(Some(record)) => return Ok(Some(record)),
                Ok(None) => {}
                Err(e) => {
                    self.fail();
                    return Err(e);
                }
            }
        }
    }

    /// Returns the next record of a chunk in memory.
    fn pop(&mut self) -> Option<Record> {
        let bytes = self.chunk.pop()?;
        let place = self.next;
        self.next.within += bytes.len() as u64;
        Some(Record {
            opcode: bytes[0],
            body: bytes.slice(RECORD_HEADER as usize..),
            place,
        })
    }

    /// Returns the end of the file, or of the chunk whose records are read one by one.
    fn end(&self) -> u64 {
        self.walked.map_or(self.length, |[_, _, end]| end)
    }

    /// Leaves the chunk whose records are read one by one, if this is its end.
    fn leave_chunk(&mut self) {
        self.walked.take_if(|[_, _, end]| self.at >= *end);
    }

    /// Returns the place of a record that is read from the file.
    fn place_of(&self, at: u64) -> Place {
        match self.walked {
            Some([chunk, first, _]) => Place {
                at: chunk,
                within: at - first,
            },
            None => Place { at, within: 0 },
        }
    }

    /// Returns no more records, because after damage the length of a record may be wrong.
    pub fn fail(&mut self) {
        self.chunk.clear();
        (self.failed, self.ending) = (true, None);
    }

    fn cut(&mut self, at: u64, what: &'static str) {
        self.ending.get_or_insert(Ending::Cut { at, what });
    }

    /// Reads one record of the file. The records of a chunk are stored for [`Container::next`].
    fn step(&mut self) -> Result<Option<Record>> {
        self.leave_chunk();
        let at = self.at;
        let left = self.end() - at;
        if left == 0 && !self.closed {
            self.cut(at, "the end of the file");
            return Ok(None);
        }
        if left < RECORD_HEADER {
            return self.overrun(at, RECORD_HEADER, "a record").map(|()| None);
        }
        let before = self.checksum.clone();
        let mut header = self.take(RECORD_HEADER)?;
        let opcode = header.get_u8();
        let length = header.get_u64_le();
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
                self.ending = Some(Ending::Finished);
            }
            op::CHUNK if length > left && !self.closed => self.open_tail(at)?,
            _ if length > left => self.overrun(at, length, "a record")?,
            op::CHUNK => {
                let body = self.take(length)?;
                self.open_chunk(body, at)?;
            }
            op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA => {
                let (place, body) = (self.place_of(at), self.take(length)?);
                return Ok(Some(Record {
                    opcode,
                    body,
                    place,
                }));
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

    /// Enters the chunk in which a truncated file ends. Its records are then read like those
    /// outside of chunks, up to the first incomplete one.
    fn open_tail(&mut self, at: u64) -> Result<()> {
        if self.length - self.at < CHUNK_HEADER {
            self.cut(at, "a chunk");
            return Ok(());
        }
        let head = self.take(CHUNK_HEADER)?;
        if head[COMPRESSION] != [0; 4] {
            // Truncated compressed data may end in the middle of any record.
            self.cut(at, "a compressed chunk");
            return Ok(());
        }
        self.walked = Some([at, self.at, self.length]);
        Ok(())
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
            return Err(Error::Count {
                what: "bytes of a recording (it became shorter while it was read)",
                promised: n,
                available: got,
            });
        }
        self.at += n;
        if let Some(checksum) = &mut self.checksum {
            checksum.update(&bytes);
        }
        Ok(bytes.into())
    }

    /// Stores the records of a chunk, last first.
    fn open_chunk(&mut self, body: Bytes, at: u64) -> Result<()> {
        self.next = Place { at, within: 0 };
        let place = || format!("chunk at byte {at}");
        let mut rest = body.clone();
        // Start and end time, length and checksum of the records, compression, length as stored.
        let parsed = (|| {
            rest.try_get_u64_le().ok()?;
            rest.try_get_u64_le().ok()?;
            let unpacked = rest.try_get_u64_le().ok()?;
            let checksum = rest.try_get_u32_le().ok()?;
            let compression = string(&mut rest)?;
            Some((unpacked, checksum, compression, rest.try_get_u64_le().ok()?))
        })();
        let Some((unpacked, checksum, compression, stored)) = parsed else {
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
        let mut records = Vec::new();
        while !rest.is_empty() {
            let length = rest
                .get(1..RECORD_HEADER as usize)
                .and_then(|b| b.try_into().ok())
                .map(u64::from_le_bytes);
            let whole = length
                .and_then(|n| n.checked_add(RECORD_HEADER))
                .filter(|&n| n <= rest.len() as u64);
            let Some(n) = whole else {
                let what = format!(
                    "a record of {} bytes, {} are left in the chunk",
                    length.unwrap_or(RECORD_HEADER),
                    rest.len()
                );
                return Err(invalid(&place(), what));
            };
            records.push(rest.split_to(n as usize));
        }
        records.reverse();
        self.chunk = records;
        Ok(())
    }
}

/// Creates the error of a file or message with invalid content.
pub(crate) fn invalid(place: &str, what: impl std::fmt::Display) -> Error {
    Error::format("recording", place, what)
}

/// Header of a message, before its content.
pub(crate) struct MessageHeader {
    pub channel: u16,
    /// Time logged, in nanoseconds since 1970 (or since any other start).
    pub log_time: u64,
}

/// Reads the header of a message record. `None` if it is too short.
pub(crate) fn message(body: &mut Bytes) -> Option<MessageHeader> {
    let channel = body.try_get_u16_le().ok()?;
    let _sequence = body.try_get_u32_le().ok()?;
    let log_time = body.try_get_u64_le().ok()?;
    let _publish_time = body.try_get_u64_le().ok()?;
    Some(MessageHeader { channel, log_time })
}

/// A schema: the name of a message type, and its text.
pub(crate) struct Schema {
    pub name: String,
    pub text: Bytes,
}

/// Reads a schema record, and its number. `None` if it is invalid.
pub(crate) fn schema(body: &mut Bytes) -> Option<(u16, Schema)> {
    let id = body.try_get_u16_le().ok()?;
    let name = string(body)?;
    let _encoding = string(body)?;
    let bytes = body.try_get_u32_le().ok()? as usize;
    let text = (bytes <= body.len()).then(|| body.split_to(bytes))?;
    Some((id, Schema { name, text }))
}

/// A channel: messages of one type on a topic.
pub(crate) struct Channel {
    pub schema: u16,
    pub topic: String,
    pub encoding: String,
}

/// Reads a channel record, and its number. `None` if it is invalid.
pub(crate) fn channel(body: &mut Bytes) -> Option<(u16, Channel)> {
    let id = body.try_get_u16_le().ok()?;
    let schema = body.try_get_u16_le().ok()?;
    let (topic, encoding) = (string(body)?, string(body)?);
    let channel = Channel {
        schema,
        topic,
        encoding,
    };
    Some((id, channel))
}

/// Reads a string with a length prefix. `None` if the bytes end before the string.
pub(crate) fn string(bytes: &mut Bytes) -> Option<String> {
    let n = bytes.try_get_u32_le().ok()? as usize;
    if n > bytes.len() {
        return None;
    }
    String::from_utf8(bytes.split_to(n).into()).ok()
}
