//! Writes `.npy` and `.npz` files, with one frame at a time in memory.
//!
//! The header of the positions has the number of frames, which is known at the end: it is written
//! then, over bytes that were left free. The checksum of both parts is combined from theirs, so an
//! archive needs no second pass. Members are stored and have 64-bit sizes, as `np.savez` writes
//! them.

use super::FORMAT;
use crate::curve::{Basis, Cell, CurveLabels, CurveSet, Positions, Precision};
use crate::error::{Error, Result};
use crate::formats::frames::ModelFrame;
use crate::formats::write::{FrameSink, check_polylines, same_curves};
use crate::ingest::{Closing, CurveSource};
use crate::verdict::LeftOut;
use crc32fast::Hasher;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

/// Bytes of a header: long enough for every shape.
const HEADER_BYTES: usize = 128;

/// Number of coordinates that are converted at once.
const PIECE: usize = 1 << 13;

/// Returns the header of an array.
fn array_header(descr: &str, shape: &str) -> [u8; HEADER_BYTES] {
    let mut bytes = [b' '; HEADER_BYTES];
    bytes[..10].copy_from_slice(b"\x93NUMPY\x01\x00\x76\x00");
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    bytes[10..10 + text.len()].copy_from_slice(text.as_bytes());
    bytes[HEADER_BYTES - 1] = b'\n';
    bytes
}

/// Positions of all frames: `frames x curves x points x 3` for closed curves of equal numbers of
/// points, which can be read without counts, and otherwise `frames x points x 3`.
pub(in crate::formats) struct Stream {
    out: BufWriter<File>,
    basis: Basis,
    precision: Precision,
    counts: Vec<i32>,
    /// True if the array has an axis of curves.
    by_curve: bool,
    points: usize,
    frames: u64,
    /// Bytes and checksum of the values.
    bytes: u64,
    hasher: Hasher,
}

impl Stream {
    /// Creates a file with a first frame. The array begins after `lead` bytes.
    fn create(path: &Path, set: &CurveSet, lead: usize) -> Result<Stream> {
        let file = File::create(path).map_err(Error::file(path))?;
        let mut out = BufWriter::with_capacity(1 << 16, file);
        (out.write_all(&vec![0; lead + HEADER_BYTES])).map_err(Error::file(path))?;
        let counts: Vec<i32> = set.counts().collect();
        let same = |first: &i32| *first < 0 && counts.iter().all(|c| c == first);
        let by_curve = counts.first().is_some_and(same);
        let mut stream = Stream {
            out,
            basis: set.basis(),
            precision: set.precision(),
            counts,
            by_curve,
            points: set.points(),
            frames: 0,
            bytes: 0,
            hasher: Hasher::new(),
        };
        stream.add(set)?;
        Ok(stream)
    }

    /// Creates an `.npy` file: the positions. Unless all curves are closed, and a reader knows it,
    /// and have equal numbers of points, these numbers are not in the file.
    pub fn create_npy(path: &Path, set: &CurveSet) -> Result<Stream> {
        check_polylines("NumPy file (.npy)", set)?;
        let mut stream = Stream::create(path, set, 0)?;
        // A reader would leave curves open that a long segment closes.
        let source = CurveSource {
            closed_by_default: true,
            ..CurveSource::default()
        };
        stream.by_curve &= Closing::default().of_set(set, source)?.is_none();
        Ok(stream)
    }

    fn add(&mut self, set: &CurveSet) -> Result<()> {
        same_curves(FORMAT, &self.counts, set)?;
        if (set.basis(), set.precision()) != (self.basis, self.precision) {
            let what = "a frame of another basis or precision than the first one";
            return Err(Error::unsupported(FORMAT, what));
        }
        // Piece by piece, because a frame may have gigabytes.
        match set.positions() {
            Positions::F32(v) => {
                let mut pieces = v.chunks(PIECE);
                pieces.try_for_each(|v| self.write(flat(v.iter().map(|x| x.to_le_bytes()))))?;
            }
            Positions::F64(v) => {
                let mut pieces = v.chunks(PIECE);
                pieces.try_for_each(|v| self.write(flat(v.iter().map(|x| x.to_le_bytes()))))?;
            }
        }
        self.frames += 1;
        Ok(())
    }

    fn write(&mut self, values: Vec<u8>) -> Result<()> {
        self.hasher.update(&values);
        self.bytes += values.len() as u64;
        Ok(self.out.write_all(&values)?)
    }

    fn header(&self) -> [u8; HEADER_BYTES] {
        let descr = match self.precision {
            Precision::F32 => "<f4",
            Precision::F64 => "<f8",
        };
        let frames = self.frames;
        let (curves, points) = (self.counts.len(), self.points);
        let shape = match self.by_curve {
            true => format!("{frames}, {curves}, {}, 3", points / curves),
            false => format!("{frames}, {points}, 3"),
        };
        array_header(descr, &shape)
    }
}

/// An `.npy` file.
impl FrameSink for Stream {
    fn frame(&mut self, _: &ModelFrame, set: &CurveSet) -> Result<()> {
        self.add(set)
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let header = self.header();
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&header)?;
        Ok(self.out.flush()?)
    }
}

/// An `.npz` file: everything that a frame has. The curves, their basis and names must be those of
/// the first frame; the radius of a curve is the largest one of all frames.
pub(in crate::formats) struct NpzFile {
    stream: Stream,
    labels: Arc<CurveLabels>,
    seq: Vec<u64>,
    cuts: Vec<u32>,
    times: Vec<f64>,
    /// Cells of all frames so far; empty if the frames have none.
    cells: Vec<Cell>,
    /// Elements of the inputs that were not read.
    left_out: Vec<LeftOut>,
}

/// Name of the member with the positions, the first one.
const POSITIONS: &str = "positions";

impl NpzFile {
    pub fn create(path: &Path, frame: &ModelFrame, set: &CurveSet) -> Result<NpzFile> {
        frame.info.labels.check(set.len())?;
        let lead = local_header(POSITIONS, 0, 0).len();
        let mut file = NpzFile {
            stream: Stream::create(path, set, lead)?,
            labels: frame.info.labels.clone(),
            seq: Vec::new(),
            cuts: Vec::new(),
            times: Vec::new(),
            cells: Vec::new(),
            left_out: Vec::new(),
        };
        file.add(frame);
        Ok(file)
    }

    /// Adds what a frame has besides its positions.
    fn add(&mut self, frame: &ModelFrame) {
        self.seq.push(frame.info.seq);
        self.cuts.push(frame.info.cuts);
        self.times.push(frame.info.time);
        self.cells.extend(frame.info.cell);
        LeftOut::merge(&mut self.left_out, &frame.info.left_out);
    }
}

impl FrameSink for NpzFile {
    fn frame(&mut self, frame: &ModelFrame, set: &CurveSet) -> Result<()> {
        let wrong = |what: String| Err(Error::unsupported(FORMAT, what));
        let labels = &frame.info.labels;
        if (&self.labels.names, self.labels.radii.len()) != (&labels.names, labels.radii.len()) {
            return wrong("a frame with other names or radii than the first one".into());
        }
        if self.labels != *labels {
            let known = Arc::make_mut(&mut self.labels).radii.iter_mut();
            known
                .zip(&labels.radii)
                .for_each(|(r, new)| *r = r.max(*new));
        }
        if let Some(last) = self.seq.last().filter(|last| frame.info.seq <= **last) {
            return wrong(format!("frame {} after frame {last}", frame.info.seq));
        }
        if frame.info.cell.is_some() == self.cells.is_empty() {
            return wrong("frames with a periodic cell and others without one".into());
        }
        self.stream.add(set)?;
        self.add(frame);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let mut stream = self.stream;
        let header = stream.header();
        let mut hasher = Hasher::new();
        hasher.update(&header);
        hasher.combine(&stream.hasher);
        let crc = hasher.finalize();
        let size = stream.bytes + HEADER_BYTES as u64;
        let first = local_header(POSITIONS, crc, size);
        let mut members = vec![directory_entry(POSITIONS, crc, size, 0)];
        let mut at = first.len() as u64 + size;

        let one = self.cells.windows(2).all(|w| w[0] == w[1]);
        let (cells, cell_shape) = match one {
            true => (&self.cells[..self.cells.len().min(1)], "4, 3".into()),
            false => (&self.cells[..], format!("{}, 4, 3", self.cells.len())),
        };
        let rows = (cells.iter()).flat_map(|cell| cell.vectors.into_iter().chain([cell.origin]));
        let timed = self.times.iter().any(|t| *t != 0.0);
        let numbered = !self.seq.iter().copied().eq(0..stream.frames);
        let labels = &self.labels;
        let (basis_type, basis) = texts(&[stream.basis.to_string()]);
        let (names_type, names) = texts(&labels.names);
        let said: Vec<String> = self.left_out.iter().map(LeftOut::to_string).collect();
        let (said_type, left_out) = texts(&said);
        let list = |len: usize| format!("{len},");
        let counts = flat(stream.counts.iter().map(|c| c.to_le_bytes()));
        let radii = flat(labels.radii.iter().map(|r| r.to_le_bytes()));
        let times = flat((self.times.iter().filter(|_| timed)).map(|t| t.to_le_bytes()));
        let seq = flat((self.seq.iter().filter(|_| numbered)).map(|n| n.to_le_bytes()));
        // Also numbers that are all the same, because the file may continue another one.
        let is_cut = self.cuts.iter().any(|cuts| *cuts != 0);
        let cuts = flat((self.cuts.iter().filter(|_| is_cut)).map(|n| n.to_le_bytes()));
        let cell = flat(rows.flatten().map(f64::to_le_bytes));
        let frames = self.seq.len();
        let arrays = [
            ("counts", "<i4", list(stream.counts.len()), counts),
            ("basis", &basis_type, String::new(), basis),
            ("names", &names_type, list(labels.names.len()), names),
            ("left_out", &said_type, list(said.len()), left_out),
            ("radii", "<f4", list(labels.radii.len()), radii),
            ("times", "<f8", list(frames), times),
            ("cell", "<f8", cell_shape, cell),
            ("seq", "<u8", list(frames), seq),
            ("cuts", "<u4", list(frames), cuts),
        ];
        // An array without values is not needed.
        for (name, descr, shape, values) in arrays.into_iter().filter(|a| !a.3.is_empty()) {
            let bytes = [&array_header(descr, &shape)[..], &values].concat();
            let (crc, size) = (crc32fast::hash(&bytes), bytes.len() as u64);
            let local = local_header(name, crc, size);
            stream.out.write_all(&local)?;
            stream.out.write_all(&bytes)?;
            members.push(directory_entry(name, crc, size, at));
            at += local.len() as u64 + size;
        }
        directory(&mut stream.out, &members, at)?;
        stream.out.seek(SeekFrom::Start(0))?;
        stream.out.write_all(&first)?;
        stream.out.write_all(&header)?;
        Ok(stream.out.flush()?)
    }
}

/// Returns the bytes of some values.
fn flat<const N: usize>(values: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
    values.flatten().collect()
}

/// Returns the type and the bytes of texts: characters of four bytes, filled up to the longest one.
fn texts(texts: &[String]) -> (String, Vec<u8>) {
    let longest = texts.iter().map(|t| t.chars().count()).max().unwrap_or(0);
    let filled = |text: &String| {
        let filler = std::iter::repeat_n('\0', longest - text.chars().count());
        text.chars().chain(filler).collect::<Vec<char>>()
    };
    let characters = texts.iter().flat_map(filled);
    let bytes = flat(characters.map(|c| u32::from(c).to_le_bytes()));
    (format!("<U{longest}"), bytes)
}

/// Returns what both records of a member begin with, after the signature: version 4.5 (64-bit
/// sizes), no flags, stored, the first day of the format, checksum, sizes in the extra field.
fn member_start(name: &str, crc: u32, extra: u16) -> Vec<u8> {
    let mut bytes = vec![45, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
    bytes.extend(crc.to_le_bytes());
    bytes.extend([0xFF; 8]);
    bytes.extend((name.len() as u16 + 4).to_le_bytes());
    bytes.extend(extra.to_le_bytes());
    bytes
}

/// Returns the record of a stored member before its content.
pub(super) fn local_header(name: &str, crc: u32, size: u64) -> Vec<u8> {
    let mut bytes = b"PK\x03\x04".to_vec();
    bytes.extend(member_start(name, crc, 20));
    bytes.extend(format!("{name}.npy").as_bytes());
    bytes.extend([1, 0, 16, 0]);
    bytes.extend(size.to_le_bytes());
    bytes.extend(size.to_le_bytes());
    bytes
}

/// Returns the entry of a stored member in the directory.
pub(super) fn directory_entry(name: &str, crc: u32, size: u64, at: u64) -> Vec<u8> {
    let mut bytes = b"PK\x01\x02\x2d\x00".to_vec();
    bytes.extend(member_start(name, crc, 28));
    // No comment, the first disk, no attributes; the offset is in the extra field.
    bytes.extend([0; 10]);
    bytes.extend([0xFF; 4]);
    bytes.extend(format!("{name}.npy").as_bytes());
    bytes.extend([1, 0, 24, 0]);
    for number in [size, size, at] {
        bytes.extend(number.to_le_bytes());
    }
    bytes
}

/// Writes the directory and the records at the end.
pub(super) fn directory(out: &mut impl Write, members: &[Vec<u8>], at: u64) -> io::Result<()> {
    let entries = members.len() as u64;
    let bytes = members.concat();
    out.write_all(&bytes)?;
    // 64-bit record: its length, versions, disks, entries, bytes and offset of the directory.
    out.write_all(b"PK\x06\x06")?;
    out.write_all(&44_u64.to_le_bytes())?;
    out.write_all(&[45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0])?;
    for number in [entries, entries, bytes.len() as u64, at] {
        out.write_all(&number.to_le_bytes())?;
    }
    // Its locator, then the record of the original format, which refers to it.
    out.write_all(b"PK\x06\x07\x00\x00\x00\x00")?;
    out.write_all(&(at + bytes.len() as u64).to_le_bytes())?;
    out.write_all(&[1, 0, 0, 0])?;
    out.write_all(b"PK\x05\x06\x00\x00\x00\x00")?;
    out.write_all(&[0xFF; 12])?;
    out.write_all(&[0, 0])
}
