//! Reads the records of a file without the content of long messages, and goes to one of them.
//!
//! Skimming costs a read of 64 bytes for each record, whatever its length. It needs no index, so it
//! works for files that were cut off. It verifies no checksum; [`Container::next`] does, for the
//! chunks that are read after [`Container::go_to`].

use super::{CHUNK_HEADER, COMPRESSION, Container, Place, RECORD_HEADER, Record, op};
use crate::error::Result;
use prost::bytes::Buf;
use std::io::{Read, Seek, SeekFrom};

/// Bytes of a skimmed record that are read: more than the headers of a chunk and of a message, and
/// the number and time at the start of a frame.
const SKIMMED_BYTES: u64 = 64;

impl<R: Read + Seek> Container<R> {
    /// Goes to a record that was read or skimmed before. [`Container::next`] returns it next.
    pub fn go_to(&mut self, place: Place) -> Result<()> {
        self.restart_at(place.at)?;
        if place.within == 0 {
            return Ok(());
        }
        self.step()?;
        if let Some([_, first, _]) = self.walked {
            self.skip_to(first + place.within)?;
        }
        while !self.chunk.is_empty() && self.next.within < place.within {
            self.pop();
        }
        Ok(())
    }

    /// Goes to the first record of the file.
    pub fn go_to_start(&mut self) -> Result<()> {
        self.restart_at(self.length.min(mcap::MAGIC.len() as u64))
    }

    fn restart_at(&mut self, at: u64) -> Result<()> {
        self.input.seek(SeekFrom::Start(at))?;
        self.at = at;
        self.chunk.clear();
        (self.walked, self.ending, self.checksum) = (None, None, None);
        Ok(())
    }

    /// Returns the next record like [`Container::next`], but reads only the first bytes of a
    /// message, unless `whole` returns true for its channel. Verifies no checksum.
    ///
    /// Cost: a read of a few bytes for each record. Compressed chunks are read and unpacked.
    pub fn skim(&mut self, whole: impl Fn(u16) -> bool) -> Result<Option<Record>> {
        loop {
            if let Some(record) = self.pop() {
                return Ok(Some(record));
            }
            if self.failed || self.ending.is_some() {
                return Ok(None);
            }
            match self.skim_step(&whole) {
                Ok(Some(record)) => return Ok(Some(record)),
                Ok(None) => {}
                Err(e) => {
                    self.fail();
                    return Err(e);
                }
            }
        }
    }

    /// Skims one record, or enters a chunk.
    fn skim_step(&mut self, whole: impl Fn(u16) -> bool) -> Result<Option<Record>> {
        self.checksum = None;
        self.leave_chunk();
        let start = self.at;
        let left = self.end() - start;
        let begin = self.take(left.min(SKIMMED_BYTES))?;
        self.skip_to(start)?;
        let mut rest = begin.clone();
        let parsed = (|| Some((rest.try_get_u8().ok()?, rest.try_get_u64_le().ok()?)))();
        let Some((opcode, length)) = parsed else {
            return self.step();
        };
        let fits = length <= left - RECORD_HEADER;
        match opcode {
            op::MESSAGE if fits && rest.len() >= 2 && !whole((&rest[..2]).get_u16_le()) => {
                let place = self.place_of(start);
                self.skip_to(start + RECORD_HEADER + length)?;
                rest.truncate(usize::try_from(length).unwrap_or(usize::MAX));
                Ok(Some(Record {
                    opcode,
                    body: rest,
                    place,
                }))
            }
            op::CHUNK if self.walked.is_none() && (fits || !self.closed) => {
                let head = CHUNK_HEADER as usize;
                if rest.len() < head || rest[COMPRESSION] != [0; 4] {
                    return self.step();
                }
                let stored = (&rest[32..40]).get_u64_le();
                let first = start + RECORD_HEADER + CHUNK_HEADER;
                let room = length.saturating_sub(CHUNK_HEADER).min(self.length - first);
                self.walked = Some([start, first, first + stored.min(room)]);
                self.skip_to(first)?;
                Ok(None)
            }
            _ => self.step(),
        }
    }

    /// Goes to a byte near the current one.
    fn skip_to(&mut self, at: u64) -> Result<()> {
        let by = at as i64 - self.at as i64;
        self.input.seek_relative(by)?;
        self.at = at;
        Ok(())
    }
}
