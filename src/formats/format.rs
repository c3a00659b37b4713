//! Formats of model files, and how they are recognized.

use super::frames::{ModelFrame, ReadOptions, Source};
use super::input::{BYTE_ORDER_MARK, is_utf16};
#[cfg(feature = "mcap")]
use super::mcap;
use super::{MODEL_FILES, bcc, external, lammps, numpy, obj, open, open_text, points, vect, xyz};
use crate::error::{Error, Result};
use std::io::BufRead;
use std::path::Path;

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
    /// A format of the [`ExternalReader`](super::ExternalReader) of this process.
    External,
}

/// Extensions of the formats; [`MODEL_FILES`] lists them for messages.
pub(super) const EXTENSIONS: [(&str, Format); 13] = [
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
    let files = files.map(|file| file.path());
    let models = files.filter(|path| Format::of_extension(path).is_some());
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
    /// Returns the format of a file by its name, or by its content if the name is not known, or is
    /// one of LAMMPS.
    ///
    /// # Errors
    ///
    /// [`Error::Folder`], [`Error::UnknownModel`], and [`Error::Unsupported`] for USD,
    /// which the Python package reads.
    pub fn of(path: &Path) -> Result<Format> {
        external::unpacked(path, Format::of_plain)
    }

    /// Returns the format of a file that is not compressed.
    fn of_plain(path: &Path) -> Result<Format> {
        if path.is_dir() {
            let (path, advice) = (path.into(), advice_on(path));
            return Err(Error::Folder { path, advice });
        }
        if let Some(other) = external::reader()
            && !Format::is_certain(path)
            && path.is_file()
            && other.reads(path)?
        {
            return Ok(Format::External);
        }
        if is_usd(path) {
            return Err(needs_python(path));
        }
        let named = Format::named(path);
        // Such names may be those of other files: `data.csv`.
        let lammps = [Some(Format::LammpsData), Some(Format::LammpsDump)].contains(&named);
        named
            .filter(|_| !lammps)
            .or_else(|| Format::of_content(path))
            .or_else(|| points::is_table(path).then_some(Format::Points))
            .or(named)
            .ok_or_else(|| Error::UnknownModel { path: path.into() })
    }

    /// Returns the format of a text file by its first lines.
    pub(super) fn of_content(path: &Path) -> Option<Format> {
        let mut input = open(path).ok()?;
        let start = input.bytes.fill_buf().ok()?;
        // A line that is cut off is not considered.
        let whole = start.len() as u64 == input.len;
        let lines = start.rsplitn(2, |&b| b == b'\n').last().filter(|_| !whole);
        let start = lines.unwrap_or(start);
        let start = start.strip_prefix(BYTE_ORDER_MARK).unwrap_or(start);
        lammps::format_of(start)
            // Its reader says what to do.
            .or_else(|| is_utf16(start).then_some(Format::Points))
            .or_else(|| xyz::begins(start).then_some(Format::Xyz))
            .or_else(|| points::begins(start).then_some(Format::Points))
    }

    /// Returns the format of the extension of a file.
    pub(super) fn of_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?;
        let is_known = |(name, _): &&(&str, Format)| extension.eq_ignore_ascii_case(name);
        Some(EXTENSIONS.iter().find(is_known)?.1)
    }

    /// Returns true if the extension of a file tells its format: no other reader has it.
    pub(crate) fn is_certain(path: &Path) -> bool {
        let format = Format::of_extension(path);
        format.is_some_and(|format| format != Format::LammpsData)
    }

    /// Returns the format that the name of a file suggests.
    pub(super) fn named(path: &Path) -> Option<Format> {
        Format::of_extension(path).or_else(|| {
            let name = path.file_name()?.to_str()?;
            let mut known = PREFIXES.into_iter();
            let found = known.find(|(start, _)| name.starts_with(start) && name != *start)?;
            Some(found.1)
        })
    }

    /// Fails if an option is given that the format of a file does not have.
    pub(super) fn check(self, options: &ReadOptions, path: &Path) -> Result<()> {
        use Format::{External, LammpsDump, Mcap, Npy, Npz, Points, Xyz};
        let (bonds, counts) = (options.bonds.is_some(), options.counts.is_some());
        let (closed, topic) = (options.closed.is_some(), options.topic.is_some());
        let name = match self {
            _ if bonds && self != LammpsDump => "bonds",
            _ if counts && !matches!(self, Npy | Npz | Points | Xyz) => "counts",
            _ if closed && !matches!(self, LammpsDump | Points | Xyz | External) => "closed",
            _ if options.select.is_some() && self != External => "select",
            _ if topic && self != Mcap => "topic",
            _ => return Ok(()),
        };
        Err(Error::Usage(format!(
            "{}: the option `{name}`, which this format does not have",
            path.display()
        )))
    }

    /// Opens a file of this format.
    pub(super) fn open(self, path: &Path, options: &ReadOptions) -> Result<Source<'static>> {
        let single = |curves| Box::new(Some(ModelFrame::new(0, Ok(curves)))) as Source<'_>;
        match self {
            Format::Bcc => open(path).and_then(|file| bcc::read(file.bytes, file.len).map(single)),
            Format::Obj => obj::read(open_text(path)?),
            Format::Vect => vect::read(open_text(path)?).map(single),
            Format::LammpsData => lammps::read_data(open_text(path)?, options),
            Format::LammpsDump => lammps::open_dump(path, options),
            Format::Npy => numpy::read_npy(open(path)?, options),
            Format::Npz => numpy::open_npz(path, options),
            // Some programs call columns of coordinates so.
            Format::Xyz if Format::of_content(path) != Some(Format::Points) => {
                xyz::read(open_text(path)?, options)
            }
            Format::Xyz | Format::Points => points::read(open_text(path)?, options),
            Format::External => external::open(&[path.into()], options),
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
    /// # Errors
    ///
    /// The errors of [`Format::of`]; [`Error::Unsupported`] for formats that are only read.
    pub fn to_write(path: &Path) -> Result<Format> {
        match Format::named(path) {
            _ if path.is_dir() => Format::of(path),
            Some(format) if format.is_written() => Ok(format),
            _ => Err(only_read(path)),
        }
    }

    /// Returns true if files of this format are written.
    pub(super) fn is_written(self) -> bool {
        use Format::{Bcc, Npy, Npz, Obj, Vect};
        matches!(self, Bcc | Npy | Npz | Obj | Vect)
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

    /// Returns true if a file of this format can hold where the motion of a simulator is cut.
    pub fn holds_cuts(self) -> bool {
        self == Format::Npz
    }

    /// Returns true if a file of this format can hold splines. The positions of an array alone
    /// would be read as those of polylines.
    pub fn holds_splines(self) -> bool {
        matches!(self, Format::Bcc | Format::Npz)
    }
}

/// Returns the error of a format that is not written.
pub(super) fn only_read(path: &Path) -> Error {
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
