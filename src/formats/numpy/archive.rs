//! The zip archive of an `.npz` file: stored and deflated members, with 64-bit sizes.
//!
//! Written by hand because the crates for zip archives lend their readers: a reader of frames has
//! to own one. Format: PKWARE's APPNOTE.TXT.

use super::FORMAT;
use super::array::{Array, Unread, fill};
use crate::error::{Error, Result};
use crate::formats::{is_in, little_endian, quote};
use crc32fast::Hasher;
use flate2::bufread::DeflateDecoder;
use std::io::{self, BufRead, ErrorKind, Read, Seek, SeekFrom};

/// Bytes of the record at the end, without its comment, and maximum length of the comment.
const END_BYTES: u64 = 22;
const MAX_COMMENT: u64 = 65_535;
/// Maximum length of the directory: some thousand arrays.
const MAX_DIRECTORY: u64 = 1 << 20;
/// Ratio of compression that large members may have.
const MAX_RATIO: u64 = 100;

/// A file of the archive.
#[derive(Clone, Debug)]
pub(super) struct Member {
    /// Its name, without the extension `.npy`.
    pub name: String,
    deflated: bool,
    crc: u32,
    compressed: u64,
    /// Size after decompression, as the directory gives it.
    pub size: u64,
    /// Offset of its local header.
    at: u64,
}

impl Member {
    /// Returns the maximum number of bytes that may be decompressed to memory at once: `free`
    /// bytes, or 100 times the compressed size. It protects from archives of little more than
    /// zeros, which take a thousandth of their content.
    pub fn limit(&self, free: u64) -> u64 {
        match self.deflated {
            true => self.compressed.saturating_mul(MAX_RATIO).max(free),
            false => u64::MAX,
        }
    }
}

/// An archive whose directory was read.
pub(super) struct Archive<R> {
    input: R,
    len: u64,
    members: Vec<Member>,
}

fn bad(what: impl std::fmt::Display) -> Error {
    Error::format(FORMAT, "zip archive", what)
}

/// Returns the little-endian number in `N` bytes at an offset.
fn number<const N: usize>(bytes: &[u8], at: usize) -> u64 {
    little_endian(&bytes[at..at + N])
}

impl<R: BufRead + Seek> Archive<R> {
    /// Reads the directory of an archive of `len` bytes.
    pub fn open(mut input: R, len: u64) -> Result<Self> {
        let tail_at = len.saturating_sub(END_BYTES + MAX_COMMENT);
        let tail = read_at(&mut input, tail_at, len - tail_at)?;
        // The last record whose comment ends with the file.
        let ends = |at: &usize| {
            tail[*at..].starts_with(b"PK\x05\x06")
                && number::<2>(&tail, at + 20) == (tail.len() - at) as u64 - END_BYTES
        };
        let last = tail.len().checked_sub(END_BYTES as usize);
        let Some(end) = last.and_then(|last| (0..=last).rev().find(ends)) else {
            return Err(bad(
                "no end of a directory: the file is truncated, or no zip archive",
            ));
        };
        let mut entries = number::<2>(&tail, end + 10);
        let mut size = number::<4>(&tail, end + 12);
        let mut offset = number::<4>(&tail, end + 16);
        if entries == 0xFFFF || size == 0xFFFF_FFFF || offset == 0xFFFF_FFFF {
            let locator = end.checked_sub(20).map(|at| &tail[at..end]);
            let Some(locator) = locator.filter(|l| l.starts_with(b"PK\x06\x07")) else {
                return Err(bad("64-bit sizes without their record"));
            };
            let record = read_at(&mut input, number::<8>(locator, 8), 56)?;
            if !record.starts_with(b"PK\x06\x06") {
                return Err(bad("64-bit sizes without their record"));
            }
            entries = number::<8>(&record, 32);
            size = number::<8>(&record, 40);
            offset = number::<8>(&record, 48);
        }
        if size > MAX_DIRECTORY {
            let what = format!("a directory of {size} bytes, expected at most {MAX_DIRECTORY}");
            return Err(bad(what));
        }
        let directory = read_at(&mut input, offset, size)?;
        let mut rest = &directory[..];
        let mut members: Vec<Member> = Vec::new();
        for k in 0..entries {
            let (member, used) = entry(rest)
                .ok_or_else(|| bad(format_args!("entry {k} of {entries} is not valid")))??;
            if members.iter().any(|m| m.name == member.name) {
                let name = quote(member.name.as_bytes());
                return Err(bad(format_args!("array {name} is there twice")));
            }
            members.push(member);
            rest = &rest[used..];
        }
        Ok(Archive {
            input,
            len,
            members,
        })
    }

    /// Returns the names of the arrays.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.iter().map(|m| &m.name[..])
    }

    /// Returns the array of this name.
    pub fn find(&self, name: &str) -> Option<Member> {
        self.members.iter().find(|m| m.name == name).cloned()
    }

    /// Returns the arrays of other names than these lists have.
    pub fn others(&self, names: &[&str]) -> Vec<Member> {
        let is_other = |m: &&Member| !names.iter().any(|list| is_in(list, &m.name));
        self.members.iter().filter(is_other).cloned().collect()
    }

    /// Reads the header of a member. The inner error is that of a member that is no array, or of a
    /// kind that is not read.
    pub fn header(&mut self, member: &Member) -> Result<Result<Array>> {
        self.seek(member)?;
        let mut content = Content::new(&mut self.input, member);
        Ok(Array::parse(&mut content, member.size, &member.name))
    }

    /// Moves to the content of a member.
    fn seek(&mut self, member: &Member) -> Result<()> {
        let header = read_at(&mut self.input, member.at, 30)?;
        let name = &member.name;
        if !header.starts_with(b"PK\x03\x04") {
            return Err(bad(format_args!(
                "array {name} is not where its entry says"
            )));
        }
        let skipped = 30 + number::<2>(&header, 26) + number::<2>(&header, 28);
        let start = member.at + skipped;
        if (start.checked_add(member.compressed)).is_none_or(|end| end > self.len) {
            let what = format!("array {name} of {} bytes reaches beyond", member.compressed);
            return Err(bad(format_args!("{what} the file of {} bytes", self.len)));
        }
        self.input.seek(SeekFrom::Start(start))?;
        Ok(())
    }

    /// Reads a member; see [`Member::limit`].
    pub fn read(&mut self, member: &Member, free: u64) -> Result<Vec<u8>> {
        let name = &member.name;
        if member.size > member.limit(free) {
            return Err(bad(format_args!(
                "array {name} of {} bytes, which is more than {free} and {MAX_RATIO} times the \
                 compressed size: store it without compression (`np.savez`)",
                member.size
            )));
        }
        self.seek(member)?;
        let mut bytes = Vec::new();
        let mut content = Content::new(&mut self.input, member);
        fill(&mut content, member.size as usize, &mut bytes)
            .map_err(|e| e.at(format_args!("array {name}")))?;
        Ok(bytes)
    }

    /// Returns a reader of a member.
    pub fn into_member(mut self, member: Member) -> Result<impl Read + use<R>> {
        self.seek(&member)?;
        Ok(Content::new(self.input, &member))
    }
}

/// Reads bytes at an offset, which must be in the file.
fn read_at(input: &mut (impl Read + Seek), at: u64, len: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // A reader may refuse to seek beyond its end.
    let sought = input.seek(SeekFrom::Start(at)).map_err(Unread::Io);
    sought
        .and_then(|_| fill(input, len as usize, &mut bytes))
        .map_err(|e| match e {
            Unread::Io(e) if e.kind() != ErrorKind::InvalidInput => Error::Io(e),
            _ => bad(format_args!("{len} bytes at {at} reach beyond its end")),
        })?;
    Ok(bytes)
}

/// Parses an entry of the directory. Returns its length as well. `None` if it is truncated.
fn entry(bytes: &[u8]) -> Option<Result<(Member, usize)>> {
    let fixed = bytes.get(..46).filter(|b| b.starts_with(b"PK\x01\x02"))?;
    let lengths = [28, 30, 32].map(|at| number::<2>(fixed, at) as usize);
    let name = bytes.get(46..46 + lengths[0])?;
    let used = 46 + lengths.iter().sum::<usize>();
    let extra = &bytes.get(46 + lengths[0]..used)?[..lengths[1]];
    let mut sizes = [24, 20, 42].map(|at| number::<4>(fixed, at));
    wide(extra, &mut sizes)?;
    let [size, compressed, at] = sizes;
    let name = String::from_utf8_lossy(name);
    let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
    let unsupported = |what: &str| {
        let what = format!("array {}: {what}", quote(name.as_bytes()));
        Some(Err(Error::unsupported(FORMAT, what)))
    };
    if number::<2>(fixed, 8) & 1 != 0 {
        return unsupported("encrypted; store it without a password");
    }
    let deflated = match number::<2>(fixed, 10) {
        0 if size != compressed => return unsupported("two sizes, although it is not compressed"),
        0 => false,
        8 => true,
        _ => return unsupported("compressed by another method than deflate"),
    };
    let member = Member {
        name,
        deflated,
        crc: number::<4>(fixed, 16) as u32,
        compressed,
        size,
        at,
    };
    Some(Ok((member, used)))
}

/// Replaces the sizes that are given as 64-bit numbers in the extra field of an entry.
fn wide(mut extra: &[u8], sizes: &mut [u64; 3]) -> Option<()> {
    while extra.len() >= 4 {
        let (id, len) = (number::<2>(extra, 0), number::<2>(extra, 2) as usize);
        let mut field = extra.get(4..4 + len)?;
        extra = &extra[4 + len..];
        if id != 1 {
            continue;
        }
        for size in sizes.iter_mut().filter(|s| **s == 0xFFFF_FFFF) {
            let (value, rest) = field.split_at_checked(8)?;
            (*size, field) = (number::<8>(value, 0), rest);
        }
    }
    Some(())
}

/// Decompressed content of a member, whose checksum is compared at its end.
struct Content<R: BufRead> {
    input: Input<R>,
    hasher: Hasher,
    crc: u32,
    left: u64,
}

enum Input<R: BufRead> {
    Stored(io::Take<R>),
    Deflated(DeflateDecoder<io::Take<R>>),
}

impl<R: BufRead> Content<R> {
    fn new(input: R, member: &Member) -> Self {
        let input = input.take(member.compressed);
        Content {
            input: match member.deflated {
                true => Input::Deflated(DeflateDecoder::new(input)),
                false => Input::Stored(input),
            },
            hasher: Hasher::new(),
            crc: member.crc,
            left: member.size,
        }
    }
}

impl<R: BufRead> Read for Content<R> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let most = to
            .len()
            .min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let to = &mut to[..most];
        if most == 0 {
            return Ok(0);
        }
        let n = match &mut self.input {
            Input::Stored(input) => input.read(to),
            Input::Deflated(input) => input.read(to),
        }?;
        self.hasher.update(&to[..n]);
        self.left -= n as u64;
        if n > 0 && self.left == 0 && self.hasher.clone().finalize() != self.crc {
            let what = "the checksum is wrong: the file is damaged";
            return Err(io::Error::new(ErrorKind::InvalidData, what));
        }
        Ok(n)
    }
}
