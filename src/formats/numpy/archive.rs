//! The zip archive of an `.npz` file: stored and deflated members, with 64-bit sizes.

use super::FORMAT;
use super::array::fill;
use crate::error::{Error, Result};
use crate::formats::{is_in, quote};
use flate2::bufread::DeflateDecoder;
use rawzip::{
    CompressionMethod, ErrorKind, RECOMMENDED_BUFFER_SIZE, RangeReader, ReaderAt, ZipArchive,
    ZipArchiveEntryWayfinder, ZipFileHeaderRecord, ZipLocator,
};
use std::fmt::Display;
use std::io::{BufReader, Read};
use std::sync::Arc;

/// Maximum number of arrays. Their names are compared with one another.
const MOST_ARRAYS: usize = 10_000;
/// Ratio of compression that large members may have.
const MAX_RATIO: u64 = 100;

/// A file of the archive.
#[derive(Clone, Debug)]
pub(super) struct Member {
    /// Its name, without the extension `.npy`.
    pub name: String,
    deflated: bool,
    at: ZipArchiveEntryWayfinder,
}

impl Member {
    fn of(entry: &ZipFileHeaderRecord<'_>) -> Result<Member> {
        let name = String::from_utf8_lossy(entry.file_path().as_ref()).into_owned();
        let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
        let at = entry.wayfinder();
        let sizes = [at.uncompressed_size_hint(), at.compressed_size_hint()];
        let unsupported = |what: &str| {
            let what = format!("array {}: {what}", quote(name.as_bytes()));
            Err(Error::unsupported(FORMAT, what))
        };
        if entry.flags().is_encrypted() {
            return unsupported("encrypted; store it without a password");
        }
        let deflated = match entry.compression_method() {
            CompressionMethod::STORE if sizes[0] != sizes[1] => {
                return unsupported("two sizes, although it is not compressed");
            }
            CompressionMethod::STORE => false,
            CompressionMethod::DEFLATE => true,
            _ => return unsupported("compressed by another method than deflate"),
        };
        Ok(Member { name, deflated, at })
    }

    /// Returns the size after decompression, as the directory gives it.
    pub fn size(&self) -> u64 {
        self.at.uncompressed_size_hint()
    }

    /// Returns the maximum number of bytes that may be decompressed to memory at once: `free`
    /// bytes, or 100 times the compressed size. It protects from archives of little more than
    /// zeros, which take a thousandth of their content.
    pub fn limit(&self, free: u64) -> u64 {
        let compressed = self.at.compressed_size_hint();
        let most = compressed.saturating_mul(MAX_RATIO).max(free);
        if self.deflated { most } else { u64::MAX }
    }
}

/// An archive whose directory was read.
pub(super) struct Archive<R> {
    zip: ZipArchive<Arc<R>>,
    len: u64,
    members: Vec<Member>,
}

fn bad(what: impl Display) -> Error {
    Error::format(FORMAT, "zip archive", what)
}

/// Returns a function that says what is wrong with an archive, unless it cannot be read.
fn wrong<W: Display>(what: W) -> impl FnOnce(rawzip::Error) -> Error {
    move |e| match e.into_kind() {
        ErrorKind::IO(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::Io(e),
        _ => bad(what),
    }
}

impl<R: ReaderAt + Send + Sync> Archive<R> {
    /// Reads the directory of an archive of `len` bytes.
    pub fn open(input: R, len: u64) -> Result<Self> {
        let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
        let zip = ZipLocator::new().locate_in_reader(Arc::new(input), &mut buffer, len);
        let zip = zip.map_err(|(_, e)| {
            wrong("no end of a directory: the file is truncated, or no zip archive")(e)
        })?;
        let mut members: Vec<Member> = Vec::new();
        let mut entries = zip.entries(&mut buffer);
        loop {
            let k = members.len();
            let invalid = format!("entry {k} of its directory is not valid");
            let Some(entry) = entries.next_entry().map_err(wrong(invalid))? else {
                break;
            };
            let member = Member::of(&entry)?;
            if members.iter().any(|m| m.name == member.name) {
                let name = quote(member.name.as_bytes());
                return Err(bad(format_args!("array {name} is there twice")));
            }
            if k == MOST_ARRAYS {
                return Err(bad(format_args!("more than {MOST_ARRAYS} arrays")));
            }
            members.push(member);
        }
        Ok(Archive { zip, len, members })
    }

    /// Returns the names of the arrays.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.iter().map(|m| &m.name[..])
    }

    /// Returns the array of this name.
    pub fn find(&self, name: &str) -> Option<&Member> {
        self.members.iter().find(|m| m.name == name)
    }

    /// Returns the arrays of other names than these lists have.
    pub fn others(&self, names: &[&str]) -> impl Iterator<Item = &Member> {
        let is_other = |m: &&Member| !names.iter().any(|list| is_in(list, &m.name));
        self.members.iter().filter(is_other)
    }

    /// Returns a reader of a member, which compares the checksum at the end.
    pub fn content<'a>(&self, member: &Member) -> Result<impl Read + Send + use<'a, R>>
    where
        R: 'a,
    {
        let name = &member.name;
        let misplaced = format!("array {name} is not where its entry says");
        let entry = self.zip.get_entry(member.at).map_err(wrong(misplaced))?;
        let (start, end) = entry.compressed_data_range();
        if end > self.len {
            let what = format!("array {name} of {} bytes reaches beyond", end - start);
            return Err(bad(format_args!("{what} the file of {} bytes", self.len)));
        }
        let stored = RangeReader::new(Arc::clone(self.zip.get_ref()), start..end);
        let stored = BufReader::with_capacity(1 << 16, stored);
        let content: Box<dyn Read + Send + 'a> = match member.deflated {
            true => Box::new(DeflateDecoder::new(stored)),
            false => Box::new(stored),
        };
        Ok(entry.verifying_reader(content))
    }

    /// Reads a member; see [`Member::limit`].
    pub fn read(&self, member: &Member, free: u64) -> Result<Vec<u8>> {
        let (name, size) = (&member.name, member.size());
        if size > member.limit(free) {
            return Err(bad(format_args!(
                "array {name} of {size} bytes, which is more than {free} and {MAX_RATIO} times the \
                 compressed size: store it without compression (`np.savez`)"
            )));
        }
        let mut content = self.content(member)?;
        fill(&mut content, size as usize, format_args!("array {name}"), 0)
    }
}
