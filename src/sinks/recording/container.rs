//! MCAP container: reads records from a file of any size, in bounded memory.
//!
//! A record is an opcode, a length and its bytes; a chunk is a record of records. The reader of the
//! `mcap` crate is not used for this. In a chunk whose inner lengths are wrong it subtracts below
//! zero (mcap 0.26, `sans_io/linear_reader.rs`), which panics if overflow is checked. It also does
//! not distinguish a truncated file from a corrupt one. It is used to unpack compressed chunks,
//! which linkwatch does not write, but other tools do.
//!
//! A finished file ends with the magic bytes. In such a file, any mismatch is corruption. In any
//! other file, a record that extends past the end marks the point at which the writer was stopped
//! or the disk was full; nothing before it is lost. Records of a complete chunk are returned after
//! its checksum has been verified. The checksum of a truncated chunk cannot be verified; its
//! complete records are returned nevertheless.
//!
//! Memory: the size of the largest chunk. Buffers are allocated only for bytes that the file has.

mod skim;

use super::messages::invalid;
use crate::error::{Error, Result};
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::bytes::{Buf, Bytes};
use std::io::{Read, Seek, SeekFrom};

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
pub(super) struct Place {
    /// Position in the file of the record, or of its chunk.
    pub at: u64,
    /// Position of the record within the unpacked records of its chunk; 0 outside of chunks.
    within: u64,
}

/// A record that the recording reader uses.
pub(super) struct Record {
    pub opcode: u8,
    pub body: Bytes,
    pub place: Place,
}

/// Reads records. Returns no more after the first error or the end.
pub(super) struct Container<R> {
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

impl<R: Read + Seek> Container<R> {
    /// Opens a file with its current length.
    pub fn new(mut input: R) -> Result<Self> {
        let length = input.seek(SeekFrom::End(0))?;
        let magic = mcap::MAGIC.len() as u64;
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
            container.closed = container.take(magic)?.as_ref() == mcap::MAGIC;
        }
        container.input.seek(SeekFrom::Start(0))?;
        container.at = 0;
        container.checksum = Some(crc32fast::Hasher::new());
        let start = container.take(length.min(magic))?;
        if start.as_ref() != &mcap::MAGIC[..start.len()] {
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
        if !compression.is_empty() {
            self.chunk =
                unpack(&body, self.length.max(UNPACKED_BYTES)).map_err(|e| invalid(&place(), e))?;
            self.chunk.reverse();
            return Ok(());
        }
        if stored > rest.len() as u64 || stored != unpacked {
            let there = rest.len();
            let what =
                format!("{stored} bytes of records promised, {unpacked} unpacked, {there} there");
            return Err(invalid(&place(), what));
        }
        rest.truncate(stored as usize);
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

/// Unpacks a compressed chunk with the reader of the `mcap` crate, which verifies the checksum
/// first.
fn unpack(body: &Bytes, limit: u64) -> Result<Vec<Bytes>, mcap::McapError> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(usize::try_from(limit).unwrap_or(usize::MAX));
    let mut reader = LinearReader::new_with_options(options);
    let mut header = vec![op::CHUNK];
    header.extend((body.len() as u64).to_le_bytes());
    let mut input = Read::chain(header.as_slice(), body.as_ref());
    let mut records = Vec::new();
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(n) => {
                // The chunk is the whole input: a request for more gets the rest of it.
                let n = n.min(body.len() + header.len());
                let read = input.read(reader.insert(n))?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                let mut record = Vec::with_capacity(RECORD_HEADER as usize + data.len());
                record.push(opcode);
                record.extend((data.len() as u64).to_le_bytes());
                record.extend(data);
                records.push(record.into());
            }
        }
    }
    Ok(records)
}

/// Reads a string with a length prefix. `None` if the bytes end before the string.
pub(super) fn string(bytes: &mut Bytes) -> Option<String> {
    let n = bytes.try_get_u32_le().ok()? as usize;
    if n > bytes.len() {
        return None;
    }
    String::from_utf8(bytes.split_to(n).into()).ok()
}
