//! Bytes of a USD file, read where they are needed.

use super::FORMAT;
use crate::error::{Error, Result};
use std::io::{ErrorKind, Read, Seek, SeekFrom};

/// A file, or the part of a file that is a USD layer.
#[derive(Debug)]
pub(super) struct Input<R> {
    source: R,
    /// Position of the layer in the file.
    start: u64,
    /// Number of bytes of the layer.
    len: u64,
}

impl<R: Read + Seek> Input<R> {
    pub fn new(source: R, len: u64) -> Self {
        Self {
            source,
            start: 0,
            len,
        }
    }

    pub fn len(&self) -> u64 {
        self.len
    }

    /// Returns the part from byte `start` on, or an error if it does not lie in this one.
    pub fn part(self, start: u64, len: u64) -> Result<Self> {
        self.check(start, len)?;
        Ok(Self {
            start: self.start + start,
            len,
            ..self
        })
    }

    /// Fails if `count` bytes from `at` on are not all in the file.
    pub fn check(&self, at: u64, count: u64) -> Result<()> {
        match at.checked_add(count) {
            Some(end) if end <= self.len => Ok(()),
            _ => {
                let what = format!("{count} bytes promised, the file has {}", self.len);
                Err(Error::format(FORMAT, format_args!("byte {at}"), what))
            }
        }
    }

    /// Fills `to` with the bytes from `at` on.
    pub fn read(&mut self, at: u64, to: &mut [u8]) -> Result<()> {
        self.check(at, to.len() as u64)?;
        self.source.seek(SeekFrom::Start(self.start + at))?;
        self.source.read_exact(to).map_err(|e| match e.kind() {
            // The length was checked, so the file shrank meanwhile.
            ErrorKind::UnexpectedEof => {
                Error::format(FORMAT, format_args!("byte {at}"), "the file ends here")
            }
            _ => Error::Io(e),
        })
    }

    /// Returns `count` bytes from `at` on. Allocates only if the file has them.
    pub fn bytes(&mut self, at: u64, count: u64) -> Result<Vec<u8>> {
        self.check(at, count)?;
        let mut bytes = vec![0; count as usize];
        self.read(at, &mut bytes)?;
        Ok(bytes)
    }

    /// Returns a number of eight bytes.
    pub fn u64_at(&mut self, at: u64) -> Result<u64> {
        let mut bytes = [0; 8];
        self.read(at, &mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    }
}
