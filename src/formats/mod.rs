//! Model files: of one frame (BCC, OBJ lines, Geomview VECT, LAMMPS data), and of many (LAMMPS
//! dumps, NumPy, extended XYZ).
//!
//! | extension | holds | precision kept |
//! |---|---|---|
//! | `.bcc` | uniform Catmull-Rom, cubic B-spline, cubic Bezier, polylines | single |
//! | `.obj` | polylines, as `l` statements | double |
//! | `.vect` | polylines | double |
//! | `.data`, `.lmp`, `.lammps`, `data.*` | polylines, as the bonds of LAMMPS | double |
//! | `.dump`, `.lammpstrj`, `dump.*` | frames of the curves of a data file | double |
//! | `.npy` | frames of polylines | single or double |
//! | `.npz` | frames of all bases, with times, names and radii | single or double |
//! | `.xyz`, `.extxyz` | frames of polylines, with times and cells | double |
//! | `.mcap` | polylines: `foxglove.SceneUpdate`, ROS 2 markers | double |
//! | `.txt`, `.csv`, `.dat`, `.raw` and others | frames of polylines, as columns `x y z` | double |
//!
//! LAMMPS files, extended XYZ and plain text of any other name are recognized by their content.
//!
//! Elements of a file that may be curves and are not read are counted: [`ModelFrame::left_out`].
//!
//! A file is not trusted: every count is compared with the length of the file before anything is
//! allocated, so that memory is linear in that length for any counts. (A compressed array may take
//! 64 MiB, or 100 times its compressed size, for a frame.) A BCC file is streamed into its
//! [`CurveSet`], with less than 200 kB of other memory. The text formats also hold their vertices,
//! bonds or counts while they are read.

mod bcc;
mod chains;
#[cfg(feature = "mcap")]
pub(crate) mod container;
mod frames;
mod lammps;
mod lines;
#[cfg(feature = "mcap")]
mod mcap;
mod numpy;
mod obj;
mod points;
mod torn;
mod vect;
mod write;
mod xyz;

pub use crate::error::MODEL_FILES;
pub use bcc::write_bcc;
pub use frames::{Frames, ModelFrame, ReadOptions};
pub use write::FrameWriter;

use self::frames::Source;
use self::write::{FrameSink, OneFrame};

use crate::curve::{Basis, CurveSet, Point, Positions};
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Take};
use std::path::Path;

/// Reads the curves of a model file: those of the first frame, if it has several. The extension (in
/// upper or lower case) determines the format.
///
/// It must be a regular file, because the length of a pipe is unknown. Every error names `path`.
///
/// ```
/// use linkwatch::{Certifier, formats, scenes::Scene};
///
/// # let file = std::env::temp_dir().join(format!("linkwatch-doc-{}.bcc", std::process::id()));
/// let ring: Scene = "ribbon:segments=2000,lambda=10".parse()?;
/// formats::write_bcc(&file, &ring.build()?.curves)?;
///
/// let curves = formats::read(&file)?;
/// let mut certifier = Certifier::default();
/// let (certificate, _) = certifier.certify(&curves);
/// assert_eq!(certificate.links()[0].lambda, 10);
/// # std::fs::remove_file(file)?;
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub fn read(path: &Path) -> Result<CurveSet> {
    let mut frames = Frames::open(path, &ReadOptions::default())?;
    match frames.next() {
        Some(frame) => frame?.curves.map_err(|e| e.in_file(path)),
        None => Err(Error::unsupported("model", "a file without frames").in_file(path)),
    }
}

/// Bytes of a file that is to be read.
struct Input<R> {
    bytes: R,
    len: u64,
    /// Name of the file, for the log.
    name: String,
}

/// Opens a regular file for reading. The reader is limited to its length, so that checks against it
/// stay valid if the file grows meanwhile.
fn open(path: &Path) -> Result<Input<BufReader<Take<File>>>> {
    // Read before opening the file, because opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
    if !metadata.is_file() {
        let why = "not a regular file, so its length is unknown";
        let source = std::io::Error::new(ErrorKind::InvalidInput, why);
        return Err(Error::file(path)(source));
    }
    let len = metadata.len();
    let file = File::open(path).map_err(Error::file(path))?.take(len);
    Ok(Input {
        bytes: BufReader::with_capacity(1 << 16, file),
        len,
        name: path.display().to_string(),
    })
}

/// Mark at the start of a text file, which some programs write.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Opens a text file after its byte order mark.
fn open_text(path: &Path) -> Result<Input<BufReader<Take<File>>>> {
    let mut input = open(path)?;
    if input.bytes.fill_buf()?.starts_with(BYTE_ORDER_MARK) {
        input.bytes.consume(BYTE_ORDER_MARK.len());
        input.len -= BYTE_ORDER_MARK.len() as u64;
    }
    Ok(input)
}

/// Format of a model file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Binary curve collection: splines and polylines, in single precision.
    Bcc,
    /// Lines of Wavefront OBJ: polylines.
    Obj,
    /// Geomview VECT: polylines.
    Vect,
    /// LAMMPS data file: the bonds and the atoms of one frame.
    LammpsData,
    /// LAMMPS text dump: the atoms of several frames.
    LammpsDump,
    /// A NumPy array: points of polylines.
    Npy,
    /// NumPy arrays: points, counts, bases, times, names and radii.
    Npz,
    /// Extended XYZ: points of polylines, with the cell of each frame.
    Xyz,
    /// MCAP of other programs: lines of Foxglove and markers of ROS 2.
    Mcap,
    /// Plain text: columns `x y z`.
    Points,
}

/// Extensions of the formats; [`MODEL_FILES`] lists them for messages.
const EXTENSIONS: [(&str, Format); 13] = [
    ("bcc", Format::Bcc),
    ("obj", Format::Obj),
    ("vect", Format::Vect),
    ("data", Format::LammpsData),
    ("lmp", Format::LammpsData),
    ("lammps", Format::LammpsData),
    ("dump", Format::LammpsDump),
    ("lammpstrj", Format::LammpsDump),
    ("npy", Format::Npy),
    ("npz", Format::Npz),
    ("xyz", Format::Xyz),
    ("extxyz", Format::Xyz),
    ("mcap", Format::Mcap),
];

/// Extensions of USD files, which the Python package reads.
const USD: [&str; 4] = ["usd", "usda", "usdc", "usdz"];

/// Starts of the names of LAMMPS files, which may have any extension.
const PREFIXES: [(&str, Format); 2] =
    [("data.", Format::LammpsData), ("dump.", Format::LammpsDump)];

/// Returns advice on naming the models in a folder.
fn advice_on(folder: &Path) -> String {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let models = files
        .map(|file| file.path())
        .filter(|path| Format::of_extension(path).is_some());
    match models.min() {
        Some(model) => {
            let extension = model.extension().unwrap_or_default();
            let pattern = folder.join("*").with_extension(extension);
            format!("for the models in it, give {}", pattern.display())
        }
        None => format!("it holds no models ({MODEL_FILES})"),
    }
}

impl Format {
    /// Returns the format of a file by its name, or by its content if the name is not known.
    ///
    /// Errors: [`Error::Folder`], [`Error::UnknownModel`], and [`Error::Unsupported`] for USD,
    /// which the Python package reads.
    pub fn of(path: &Path) -> Result<Format> {
        if path.is_dir() {
            let advice = advice_on(path);
            let path = path.into();
            return Err(Error::Folder { path, advice });
        }
        if is_usd(path) {
            return Err(needs_python(path));
        }
        Format::named(path)
            .or_else(|| Format::of_content(path))
            .or_else(|| points::is_table(path).then_some(Format::Points))
            .ok_or_else(|| Error::UnknownModel { path: path.into() })
    }

    /// Returns the format of a text file by its first lines.
    fn of_content(path: &Path) -> Option<Format> {
        let mut input = open(path).ok()?;
        let start = input.bytes.fill_buf().ok()?;
        // A line that is cut off is not considered.
        let whole = start.len() as u64 == input.len;
        let lines = start.rsplitn(2, |&b| b == b'\n').last().filter(|_| !whole);
        let start = lines.unwrap_or(start);
        let start = start.strip_prefix(BYTE_ORDER_MARK).unwrap_or(start);
        lammps::format_of(start)
            .or_else(|| xyz::begins(start).then_some(Format::Xyz))
            .or_else(|| points::begins(start).then_some(Format::Points))
    }

    /// Returns the format of the extension of a file.
    fn of_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?;
        let mut known = EXTENSIONS.into_iter();
        known
            .find(|(name, _)| extension.eq_ignore_ascii_case(name))
            .map(|(_, format)| format)
    }

    /// Returns the format that the name of a file suggests.
    fn named(path: &Path) -> Option<Format> {
        Format::of_extension(path).or_else(|| {
            let name = path.file_name()?.to_str()?;
            let mut known = PREFIXES.into_iter();
            known
                .find(|(start, _)| name.starts_with(start) && name.len() > start.len())
                .map(|(_, format)| format)
        })
    }

    /// Fails if an option is given that this format does not have.
    fn check(self, options: &ReadOptions) -> Result<()> {
        use Format::{LammpsDump, Mcap, Npy, Npz, Points, Xyz};
        let given = [
            (options.bonds.is_some(), "bonds", &[LammpsDump][..]),
            (options.counts.is_some(), "counts", &[Npy, Npz, Points, Xyz]),
            (
                options.closed.is_some(),
                "closed",
                &[LammpsDump, Points, Xyz],
            ),
            (options.topic.is_some(), "topic", &[Mcap]),
        ];
        for (_, name, of) in given.into_iter().filter(|given| given.0) {
            if !of.contains(&self) {
                let what = format!("`{name}`, which this format does not have");
                return Err(Error::unsupported("option", what));
            }
        }
        Ok(())
    }

    /// Opens a file of this format.
    fn open(self, path: &Path, options: &ReadOptions) -> Result<Source<'static>> {
        self.check(options)?;
        let single = |curves| ModelFrame::new(0, Ok(curves)).into();
        match self {
            Format::Bcc => open(path).and_then(|file| bcc::read(file.bytes, file.len).map(single)),
            Format::Obj => obj::read(open_text(path)?),
            Format::Vect => vect::read(open_text(path)?).map(single),
            Format::LammpsData => lammps::read_data(open_text(path)?, options),
            Format::LammpsDump => lammps::open_dump(path, options),
            Format::Npy => numpy::read_npy(open(path)?, options),
            Format::Npz => numpy::read_npz(open(path)?, options),
            // Some programs call columns of coordinates so.
            Format::Xyz if Format::of_content(path) != Some(Format::Points) => {
                xyz::read(open_text(path)?, options)
            }
            Format::Xyz | Format::Points => points::read(open_text(path)?, options),
            #[cfg(feature = "mcap")]
            Format::Mcap => mcap::open(path, options),
            #[cfg(not(feature = "mcap"))]
            Format::Mcap => {
                let why = "an MCAP file, which this build does not read (feature mcap)";
                Err(Error::unsupported("model", why))
            }
        }
    }

    /// Returns the format of a file that is to be written, by its name.
    ///
    /// Errors: those of [`Format::of`]; [`Error::Unsupported`] for formats that are only read.
    pub fn to_write(path: &Path) -> Result<Format> {
        use Format::{Bcc, Npy, Npz, Obj, Vect};
        match Format::named(path) {
            _ if path.is_dir() => Format::of(path),
            Some(format @ (Bcc | Npy | Npz | Obj | Vect)) => Ok(format),
            _ => Err(only_read(path)),
        }
    }

    /// Creates a file of this format.
    fn create(self, path: &Path) -> Result<Box<dyn FrameSink>> {
        Ok(match self {
            Format::Bcc => Box::new(OneFrame::new(path, "BCC", write_bcc)),
            Format::Obj => Box::new(OneFrame::new(path, "OBJ", obj::write)),
            Format::Vect => Box::new(OneFrame::new(path, "VECT", vect::write)),
            Format::Npy => Box::new(numpy::NpyFile::new(path)),
            Format::Npz => Box::new(numpy::NpzFile::new(path)),
            _ => return Err(only_read(path)),
        })
    }

    /// Returns true if a file of this format can hold more than one frame.
    pub fn holds_frames(self) -> bool {
        use Format::{Bcc, LammpsData, Obj, Vect};
        !matches!(self, Bcc | Obj | Vect | LammpsData)
    }

    /// Returns true if a file of this format can hold the periodic cell of a frame.
    pub fn holds_cells(self) -> bool {
        use Format::{LammpsData, LammpsDump, Npz, Xyz};
        matches!(self, LammpsData | LammpsDump | Npz | Xyz)
    }

    /// Returns true if a file of this format can hold splines. The positions of an array alone
    /// would be read as those of polylines.
    pub fn holds_splines(self) -> bool {
        matches!(self, Format::Bcc | Format::Npz)
    }
}

/// Returns the error of a format that is not written.
fn only_read(path: &Path) -> Error {
    let what = match Format::named(path) {
        Some(Format::Mcap) => "MCAP is written by `linkwatch convert` alone: write .npz first",
        _ => {
            "written are .bcc, .npz and .mcap, and polylines as .obj, .vect and .npy; for other \
             formats write .npz, whose arrays Python reads (`numpy.load`)"
        }
    };
    Error::unsupported("output", what).in_file(path)
}

/// Returns true if a file is USD by its name, or by its first bytes if the name is not known.
fn is_usd(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    let named = USD.iter().any(|usd| extension.eq_ignore_ascii_case(usd));
    let begins = || {
        let mut input = open(path).ok()?.bytes;
        let start = input.fill_buf().ok()?;
        Some(start.starts_with(b"PXR-USDC") || start.starts_with(b"#usda"))
    };
    named || Format::named(path).is_none() && begins() == Some(true)
}

/// Returns the error of a USD file, with what to do instead.
fn needs_python(path: &Path) -> Error {
    let what = format!(
        "the Python package reads it with usd-core (`pip install usd-core`): `python -m linkwatch \
         convert {} OUT.npz`",
        path.display()
    );
    Error::unsupported("USD", what).in_file(path)
}

/// Returns true if a list of words has this one.
fn is_in(list: &str, word: &str) -> bool {
    list.split(' ').any(|known| known == word)
}

/// Returns the little-endian number in some bytes, at most eight.
fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rfold(0, |n, &b| (n << 8) | u64::from(b))
}

/// Parses a finite decimal number, or returns an error text.
fn number(token: &[u8]) -> Result<f64, String> {
    let parsed = std::str::from_utf8(token).ok().and_then(|t| t.parse().ok());
    match parsed {
        Some(x) if f64::is_finite(x) => Ok(x),
        Some(_) => Err(format!("{} is not a finite number", quote(token))),
        None => Err(format!("{}, expected a number", quote(token))),
    }
}

/// Returns the number of points of a curve, negative if it is closed.
fn count_of(points: usize, closed: bool) -> Result<i32> {
    let count =
        i32::try_from(points).map_err(|_| Error::count("points of a curve", points, i32::MAX))?;
    Ok(if closed { -count } else { count })
}

/// Returns the curves of these points.
///
/// Errors: there are not as many as the counts promise.
fn divided(
    format: &'static str,
    kind: &'static str,
    points: &[Point],
    counts: &[i32],
) -> Result<CurveSet> {
    let sum: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
    if sum != points.len() as u64 {
        let (all, n) = (points.len(), counts.len());
        let what = format!("{all} {kind} do not fit {n} curves with {sum} points");
        return Err(Error::format(format, kind, what));
    }
    CurveSet::from_counts(
        Basis::Polyline,
        counts,
        Positions::F64(points.as_flattened()),
    )
}

/// Quotes a part of a file for a message: short, and with control characters escaped.
fn quote(token: &[u8]) -> String {
    const SHOWN: usize = 40;
    let head = &token[..token.len().min(4 * SHOWN)];
    let text: String = String::from_utf8_lossy(head)
        .chars()
        .take(SHOWN)
        .flat_map(char::escape_debug)
        .collect();
    format!("'{text}'")
}

#[cfg(test)]
mod round_trip_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Precision;
    use proptest::prelude::*;
    use std::io::Cursor;
    use std::path::PathBuf;

    /// Returns all curves of a set: true if closed, and the points.
    pub(super) fn curves(set: &CurveSet) -> Vec<(bool, Vec<Point>)> {
        let points = |i| (0..set.curve(i).points as usize).map(move |k| set.point(i, k));
        (0..set.len())
            .map(|i| (set.curve(i).closed, points(i).collect()))
            .collect()
    }

    /// Asserts that the message of an error contains `expected`.
    pub(super) fn assert_error_contains(result: Result<CurveSet>, expected: &str) {
        let message = result.unwrap_err().to_string();
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }

    impl<'a> From<&'a [u8]> for Input<&'a [u8]> {
        fn from(bytes: &'a [u8]) -> Self {
            let (len, name) = (bytes.len() as u64, "memory".into());
            Input { bytes, len, name }
        }
    }

    /// Reads the frames of a file in memory.
    pub(super) fn frames_of(mut source: Source<'_>) -> Result<Vec<ModelFrame>> {
        std::iter::from_fn(|| source.next_frame().transpose()).collect()
    }

    /// Returns bytes in which a reader may go to any place.
    pub(super) fn seekable(bytes: &[u8]) -> Input<Cursor<&[u8]>> {
        Input {
            bytes: Cursor::new(bytes),
            len: bytes.len() as u64,
            name: "memory".into(),
        }
    }

    /// Reads the frames of a file in memory, up to the first one that is invalid.
    fn parse(format: Format, bytes: &[u8]) -> Result<Vec<CurveSet>> {
        let input = Input::from(bytes);
        let counts = Some(vec![-3, 2]);
        let npy = ReadOptions {
            counts,
            ..ReadOptions::default()
        };
        let npz = ReadOptions::default();
        let text = ReadOptions {
            closed: Some(true),
            ..ReadOptions::default()
        };
        let mut frames = match format {
            Format::Bcc => return Ok(vec![bcc::read(bytes, input.len)?]),
            Format::Obj => obj::read(input)?,
            Format::Vect => return Ok(vec![vect::read(input)?]),
            Format::LammpsData => lammps::read_data(input, &npz)?,
            Format::LammpsDump => lammps::read_dump(bytes, &[[4, 2], [2, 9], [9, 4]], false)?,
            Format::Npy => numpy::read_npy(input, &npy)?,
            Format::Npz => numpy::read_npz(seekable(bytes), &npz)?,
            Format::Xyz => xyz::read(input, &npz)?,
            Format::Points => points::read(input, &text)?,
            Format::Mcap => unreachable!("its tests are in mcap"),
        };
        let mut curves = Vec::new();
        while let Some(frame) = frames.next_frame()? {
            curves.push(frame.curves?);
        }
        Ok(curves)
    }

    /// Returns a small valid file of each format.
    fn samples() -> Vec<(Format, Vec<u8>)> {
        let mut bcc = b"BCC\x44C0\x03\x01".to_vec();
        bcc.extend(2u64.to_le_bytes());
        bcc.extend(7u64.to_le_bytes());
        bcc.extend([0; 40]);
        for (count, n) in [(-3i32, 3), (4, 4)] {
            bcc.extend(count.to_le_bytes());
            (0..3 * n).for_each(|k| bcc.extend((k as f32 * 0.37).to_le_bytes()));
        }
        let obj = "# comment\nv 0 0 0\nv 1 0.5 0\nv 1e1 1 0\nv 0 1 -2 1\n\
                   l 1 2 \\\n 3 1\nl 3 4\nl -1/2 1\n";
        let vect = "VECT # comment\n2 5 1\n-3 2\n1 0\n0 0 0\n1 0.5 0\n1e1 1 0\n0 1 -2\n3 3 3\n\
                    1 0 0 1\n";
        let data = "Title\n\n5 atoms # all\n4 bonds\n2 atom types\n\n0 9 xlo xhi\n0 9 ylo yhi\n\
                    0 9 zlo zhi\n1 0 0 xy xz yz\n\nMasses\n\n1 1\n2 1\n\nAtoms # bond\n\n\
                    3 1 1 0 0 8 0 0 -1\n1 1 1 1 0.5 0 0 0 0\n2 1 2 1e0 1 0 0 0 0\n\
                    7 2 1 0 1 -2 0 0 0\n5 2 1 3 3 0 0 0 0\n\nBonds\n\n1 1 1 2\n2 1 2 3\n\
                    3 1 3 1\n4 1 5 7\n";
        let dump = "ITEM: UNITS\nlj\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\n\
                    ITEM: BOX BOUNDS pp pp ff\n0 9\n0 9\n0 9\nITEM: ATOMS id x y z ix iy iz\n\
                    2 0 0 8 0 0 0\n9 1 0.5 0 0 0 0\n4 8 0 0 -1 0 0\nITEM: TIMESTEP\n7\n\
                    ITEM: NUMBER OF ATOMS\n4\nITEM: BOX BOUNDS xy xz yz pp pp pp\n0 9 1\n\
                    0 9 0\n0 9 0\nITEM: ATOMS type xs ys zs id\n1 0 0 0 4\n1 .1 0 .1 9\n\
                    1 0 .1 .1 2\n1 0 0 0 6\n";
        let xyz = "3\nLattice=\"9 0 0 1 9 0 0 0 9\" Origin='0 0 1' pbc=\"T T F\" Time=0.5 \
                   Properties=species:S:1:pos:R:3:id:I:1:molecule:I:1:closed:L:1 Timestep=4\n\
                   C 0 0 0 3 2 F\nC 1 0.5 0 1 7 T\nH 1e0 1 0 2 2 F\n\n4\n\
                   properties=mol:I:1:pos:R:3 key timestep=7\n-1 0 0 1\n2 0 0 1\n-1 1 0 1\n\
                   -1 1 1 1\n";
        let mut samples: Vec<(Format, Vec<u8>)> = vec![
            (Format::Bcc, bcc),
            (Format::Obj, obj.into()),
            (Format::Vect, vect.into()),
            (Format::LammpsData, data.into()),
            (Format::LammpsDump, dump.into()),
            (
                Format::Npy,
                include_bytes!("../../tests/models/numpy/small.npy").into(),
            ),
            (
                Format::Npz,
                include_bytes!("../../tests/models/numpy/small.npz").into(),
            ),
            (
                Format::Npz,
                include_bytes!("../../tests/models/numpy/small-compressed.npz").into(),
            ),
        ];
        samples.insert(4, (Format::Xyz, xyz.into()));
        let points = "x, y, z\n0, 0, 0\n1, .5, 0\n1e1, 1, 0\n\nComponent 2:\n0 1 -2\n3 4 5\n";
        samples.insert(4, (Format::Points, points.into()));
        let counted = "# frames\n3\n0 0 0\n1 .5 0\n1e1 1 0\n3\n0 1 -2\n3 4 5\n7 7 7\n";
        samples.insert(4, (Format::Points, counted.into()));
        samples
    }

    /// Formats whose files cannot end early.
    const BINARY: [Format; 3] = [Format::Bcc, Format::Npy, Format::Npz];

    #[test]
    fn the_error_of_a_folder_shows_how_to_name_its_models() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| read(path).unwrap_err().to_string();
        let path = folder.path();
        let empty = format!(
            "{}: not a regular file but a folder; it holds no models",
            path.display()
        );
        assert!(error(path).starts_with(&empty), "{}", error(path));
        for name in ["b.bcc", "notes.txt"] {
            std::fs::write(path.join(name), "").unwrap();
        }
        let advice = format!("for the models in it, give {}/*.bcc", path.display());
        assert!(error(path).ends_with(&advice), "{}", error(path));
        // A folder may have the name of a model.
        let inner = path.join("frames.bcc");
        std::fs::create_dir(&inner).unwrap();
        assert!(error(&inner).contains("a folder"), "{}", error(&inner));
    }

    #[test]
    fn no_panic_on_files_truncated_anywhere() {
        for (format, bytes) in samples() {
            let frames = parse(format, &bytes).unwrap();
            assert!(!frames.is_empty());
            for n in 0..bytes.len() {
                let result = parse(format, &bytes[..n]);
                // Text may still be valid: a last digit or newline may be missing.
                assert!(
                    !BINARY.contains(&format) || result.is_err(),
                    "{format:?}: {n} bytes"
                );
                if let Ok(sets) = result {
                    assert!(sets.len() <= frames.len());
                    assert!(sets.iter().all(|set| set.points() <= 8));
                }
            }
        }
    }

    #[test]
    fn no_panic_on_one_wrong_byte_anywhere() {
        for (format, bytes) in samples() {
            for at in 0..bytes.len() {
                for value in 0..=255 {
                    let mut bytes = bytes.clone();
                    bytes[at] = value;
                    for set in parse(format, &bytes).into_iter().flatten() {
                        assert!(set.points() <= 8, "{format:?}: byte {at} = {value}");
                        assert!(set.max_abs().is_finite());
                    }
                }
            }
        }
    }

    proptest! {
        #[test]
        fn no_panic_on_garbage(
            k in 0..11usize,
            keep in 0..800usize,
            tail in prop::collection::vec(any::<u8>(), 0..200),
        ) {
            let (format, mut bytes) = samples().swap_remove(k);
            bytes.truncate(keep);
            bytes.extend(tail);
            for set in parse(format, &bytes).into_iter().flatten() {
                prop_assert!(set.points() <= bytes.len());
            }
        }

        #[test]
        fn no_panic_on_garbage_of_likely_characters(
            k in 1..8usize,
            keep in 0..500usize,
            tail in "[-0-9lv./# \n\\\\eEItemsT:+]{0,200}",
        ) {
            let (format, mut bytes) = samples().swap_remove(k);
            bytes.truncate(keep);
            bytes.extend(tail.into_bytes());
            for set in parse(format, &bytes).into_iter().flatten() {
                prop_assert!(set.points() <= bytes.len());
            }
        }
    }

    #[test]
    fn the_extension_selects_the_format_and_errors_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let names = ["a.BCC", "b.Obj", "c.vect", "d.lmp"];
        let npz = samples().pop().map(|sample| (sample, "e.npz"));
        for ((_, bytes), name) in samples().into_iter().zip(names).chain(npz) {
            let path = dir.path().join(name);
            std::fs::write(&path, &bytes).unwrap();
            assert_eq!(read(&path).unwrap().len(), 2);
            std::fs::write(&path, &bytes[..7]).unwrap();
            let e = read(&path).unwrap_err();
            assert!(matches!(e, Error::InFile { .. }));
            let start = format!("{}: not a valid ", path.display());
            assert!(e.to_string().starts_with(&start), "{e}");
        }
        for name in [
            "a", "a.txt", ".bcc", "bcc", "a.bcc.gz", "data.", "xdata.a", "dump",
        ] {
            let e = read(&dir.path().join(name)).unwrap_err();
            assert!(matches!(e, Error::UnknownModel { .. }), "{e}");
        }
        let missing = dir.path().join("missing.obj");
        let e = read(&missing).unwrap_err();
        assert!(matches!(&e, Error::File { path, .. } if *path == missing));
        let folder = dir.path().join("folder.vect");
        std::fs::create_dir(&folder).unwrap();
        assert_error_contains(read(&folder), "folder.vect: not a regular file");
    }

    #[test]
    fn errors_name_the_formats_that_are_written() {
        for (name, expected) in [
            (
                "a.xyz",
                "a.xyz: unsupported output: written are .bcc, .npz and .mcap, ",
            ),
            (
                "a.mcap",
                "a.mcap: unsupported output: MCAP is written by `linkwatch convert`",
            ),
            ("a", "a: unsupported output: written are"),
        ] {
            let error = Format::to_write(Path::new(name)).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        assert_eq!(Format::to_write(Path::new("A.NPZ")).unwrap(), Format::Npz);
    }

    #[test]
    fn messages_list_the_extensions_of_all_formats() {
        let listed: Vec<&str> = MODEL_FILES.split(", ").collect();
        let known = EXTENSIONS.map(|(extension, _)| format!(".{extension}"));
        assert_eq!(listed, known);
        for (extension, format) in EXTENSIONS {
            let path = PathBuf::from(format!("frames/a.{}", extension.to_uppercase()));
            assert_eq!(Format::named(&path), Some(format));
        }
    }

    #[test]
    fn quoted_parts_of_a_file_are_short_and_escaped() {
        assert_eq!(quote(b"a\x1b[2Jb\n"), "'a\\u{1b}[2Jb\\n'");
        assert_eq!(quote(&[b'1'; 1000]).len(), 42);
        assert_eq!(quote(b"\xff"), "'\u{fffd}'");
    }

    /// Reads a model that is not part of the project, if it is present on this machine.
    fn published(name: &str) -> Option<CurveSet> {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../shared/models")
            .join(name);
        if !path.exists() {
            eprintln!("skipped: no {name} here");
            return None;
        }
        Some(read(&path).unwrap())
    }

    #[test]
    fn published_models_have_their_sizes() {
        use Basis::{BSpline, CatmullRom, Polyline};
        for (name, basis, loops, points) in [
            ("glove.bcc", CatmullRom, 70, 58_537),
            ("knittubeinit.bcc", BSpline, 39, 18_228),
            ("knittubebroken.bcc", BSpline, 39, 18_228),
            ("houdiniobj.obj", Polyline, 2, 9_600),
            ("2.2.1.vect", Polyline, 2, 72),
            ("3.1.vect", Polyline, 1, 47),
            ("4.1.vect", Polyline, 1, 69),
            ("4.2.1.vect", Polyline, 2, 81),
            ("5.2.1.vect", Polyline, 2, 77),
            ("6.3.2.vect", Polyline, 3, 105),
            ("9.2.40.vect", Polyline, 2, 114),
        ] {
            let Some(set) = published(name) else { continue };
            assert_eq!(
                (set.basis(), set.len(), set.points()),
                (basis, loops, points)
            );
            assert_eq!(set.segments(), points, "{name}");
            assert!(set.curves().iter().all(|c| c.closed), "{name}");
            assert_eq!(
                (0..loops).map(|i| set.repeated_vertices(i)).sum::<usize>(),
                0
            );
        }
    }

    #[test]
    fn published_models_keep_their_points() {
        if let Some(set) = published("houdiniobj.obj") {
            let counts: Vec<i32> = set.counts().collect();
            assert_eq!(counts, [-4800, -4800]);
            assert_eq!(set.precision(), Precision::F64);
            // The first line starts with 1, 4800, 4799.
            assert_eq!(set.point(0, 0), [0.5, 0.0, 0.0]);
            assert_eq!(
                set.point(0, 4799),
                [0.499890327, 0.0104712006, -1.37067773e-05]
            );
        }
        if let Some(set) = published("2.2.1.vect") {
            assert_eq!(set.counts().collect::<Vec<_>>(), [-36, -36]);
            assert_eq!(set.point(0, 0), [-6.29882, 6.86615, -1.59307]);
            assert_eq!(set.point(1, 35), [0.979481, 3.05294, -2.69246]);
        }
        if let Some(set) = published("glove.bcc") {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("again.bcc");
            write_bcc(&path, &set).unwrap();
            assert_eq!(curves(&read(&path).unwrap()), curves(&set));
        }
    }
}
