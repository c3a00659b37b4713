//! Model files: BCC, OBJ lines, Geomview VECT and USD.
//!
//! | extension | holds | precision kept |
//! |---|---|---|
//! | `.bcc` | uniform Catmull-Rom, cubic B-spline, cubic Bezier, polylines | single |
//! | `.obj` | polylines, as `l` statements | double |
//! | `.vect` | polylines | double |
//! | `.usda`, `.usdc`, `.usd`, `.usdz` | all of these, with time samples | single |
//!
//! A file is not trusted: every count is compared with the length of the file before anything is
//! allocated, so that memory is linear in that length for any counts. A BCC file is streamed into
//! its [`CurveSet`], with less than 200 kB of other memory. The text formats also hold their
//! vertices or counts while they are read.

mod bcc;
mod chains;
mod frames;
mod obj;
#[cfg(feature = "usd")]
mod usd;
mod vect;
mod write;

pub use bcc::write_bcc;
pub use frames::{Frames, ModelFrame, ReadOptions};
pub use write::FrameWriter;

use self::frames::{FrameSource, Single};
use self::write::{BccFile, FrameSink};

use crate::curve::CurveSet;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Take};
use std::path::Path;

/// Reads the curves of a model file. The extension (in upper or lower case) determines the format.
///
/// It must be a regular file, because the length of a pipe is unknown. Every error names `path`.
///
/// ```
/// use linkwatch::{Verifier, model, scenes::Scene};
///
/// # let file = std::env::temp_dir().join(format!("linkwatch-doc-{}.bcc", std::process::id()));
/// let ring: Scene = "ribbon:segments=2000,lambda=10".parse()?;
/// model::write_bcc(&file, &ring.build()?.curves)?;
///
/// let curves = model::read(&file)?;
/// let mut verifier = Verifier::default();
/// let (certificate, _) = verifier.certify(&curves);
/// assert_eq!(certificate.links[0].lambda, 10);
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

/// Opens a regular file for reading, and returns its length. The reader is limited to this length,
/// so that checks against it stay valid if the file grows meanwhile.
fn open(path: &Path) -> Result<(BufReader<Take<File>>, u64)> {
    // Read before opening the file, because opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
    if !metadata.is_file() {
        let why = "not a regular file, so its length is unknown";
        let source = std::io::Error::new(ErrorKind::InvalidInput, why);
        return Err(Error::file(path)(source));
    }
    let len = metadata.len();
    let file = File::open(path).map_err(Error::file(path))?.take(len);
    Ok((BufReader::with_capacity(1 << 16, file), len))
}

/// Known formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Bcc,
    Obj,
    Vect,
    Usd,
}

/// Returns advice on naming the models in a folder.
fn advice_on(folder: &Path) -> String {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let models = files
        .map(|file| file.path())
        .filter(|path| Format::named(path).is_some());
    match models.min() {
        Some(model) => {
            let extension = model.extension().unwrap_or_default();
            let pattern = folder.join("*").with_extension(extension);
            format!("for the models in it, give {}", pattern.display())
        }
        None => "it holds no models (.bcc, .obj, .vect, .usd)".into(),
    }
}

impl Format {
    /// Returns the format of a file by its extension.
    ///
    /// Errors: [`Error::Folder`], [`Error::UnknownModel`], and [`Error::Unsupported`] for a
    /// recording.
    fn of(path: &Path) -> Result<Format> {
        if path.is_dir() {
            let advice = advice_on(path);
            let path = path.into();
            return Err(Error::Folder { path, advice });
        }
        if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
        {
            let why = "a recording (.mcap), which `linkwatch replay` verifies";
            return Err(Error::unsupported("model", why).in_file(path));
        }
        Format::named(path).ok_or_else(|| Error::UnknownModel { path: path.into() })
    }

    /// Returns the format that the name of a file suggests.
    fn named(path: &Path) -> Option<Format> {
        let extension = path.extension()?;
        [
            ("bcc", Format::Bcc),
            ("obj", Format::Obj),
            ("vect", Format::Vect),
            ("usd", Format::Usd),
            ("usda", Format::Usd),
            ("usdc", Format::Usd),
            ("usdz", Format::Usd),
        ]
        .into_iter()
        .find(|(name, _)| extension.eq_ignore_ascii_case(name))
        .map(|(_, format)| format)
    }

    /// Opens a file of this format. Errors name the file.
    fn open(self, path: &Path, _options: &ReadOptions) -> Result<Box<dyn FrameSource>> {
        let (input, len) = open(path)?;
        let curves = match self {
            Format::Bcc => bcc::read(input, len),
            Format::Obj => obj::read(input),
            Format::Vect => vect::read(input, len),
            #[cfg(feature = "usd")]
            Format::Usd => {
                let file = input.into_inner().into_inner();
                return usd::open(file, len).map_err(|e| e.in_file(path));
            }
            #[cfg(not(feature = "usd"))]
            Format::Usd => Err(no_usd()),
        };
        let curves = curves.map_err(|e| e.in_file(path))?;
        Ok(Box::new(Single::new(curves)))
    }

    /// Creates a file of this format.
    fn create(self, path: &Path) -> Result<Box<dyn FrameSink>> {
        match self {
            Format::Bcc => Ok(Box::new(BccFile::new(path))),
            #[cfg(feature = "usd")]
            Format::Usd => usd::create(path),
            #[cfg(not(feature = "usd"))]
            Format::Usd => Err(no_usd().in_file(path)),
            Format::Obj | Format::Vect => Err(Error::unsupported("model", "not written yet")),
        }
    }

    /// Returns true if a file can hold more than one frame.
    fn holds_frames(self) -> bool {
        match self {
            Format::Usd => true,
            Format::Bcc | Format::Obj | Format::Vect => false,
        }
    }

    /// Returns true if a file can hold splines.
    fn holds_splines(self) -> bool {
        match self {
            Format::Bcc | Format::Usd => true,
            Format::Obj | Format::Vect => false,
        }
    }
}

/// Returns the error of a build that does not read USD.
#[cfg(not(feature = "usd"))]
fn no_usd() -> Error {
    let what = "this build does not read or write it: build linkwatch with the feature usd";
    Error::unsupported("USD", what)
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
mod tests {
    use super::*;
    use crate::curve::{Basis, Point, Precision};
    use proptest::prelude::*;
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

    fn parse(format: Format, bytes: &[u8]) -> Result<CurveSet> {
        let len = bytes.len() as u64;
        match format {
            Format::Bcc => bcc::read(bytes, len),
            Format::Obj => obj::read(bytes),
            Format::Vect => vect::read(bytes, len),
            #[cfg(feature = "usd")]
            Format::Usd => {
                let mut file = usd::open(std::io::Cursor::new(bytes.to_vec()), len)?;
                file.next_frame()?
                    .map_or_else(|| unreachable!(), |frame| frame.curves)
            }
            #[cfg(not(feature = "usd"))]
            Format::Usd => Err(no_usd()),
        }
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
        let mut samples = vec![
            (Format::Bcc, bcc),
            (Format::Obj, obj.into()),
            (Format::Vect, vect.into()),
        ];
        let usd = "#usda 1.0\ndef BasisCurves \"a\" { token type = \"linear\"\n\
                   int[] curveVertexCounts = [2, 3]\npoint3f[] points =\
                   [(0,0,0), (1,0.5,0), (1e1,1,0), (0,1,-2), (3,4,5)] }\n";
        if cfg!(feature = "usd") {
            samples.push((Format::Usd, usd.into()));
        }
        samples
    }

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
            parse(format, &bytes).unwrap();
            for n in 0..bytes.len() {
                let result = parse(format, &bytes[..n]);
                // Text may still be valid: a last digit or newline may be missing.
                assert!(format != Format::Bcc || result.is_err(), "{n} bytes");
                if let Ok(set) = result {
                    assert!(set.points() <= 8);
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
                    if let Ok(set) = parse(format, &bytes) {
                        assert!(set.points() <= 8, "byte {at} = {value}");
                        assert!(set.max_abs().is_finite());
                    }
                }
            }
        }
    }

    proptest! {
        #[test]
        fn no_panic_on_garbage(
            k in 0..3usize,
            keep in 0..200usize,
            tail in prop::collection::vec(any::<u8>(), 0..200),
        ) {
            let (format, mut bytes) = samples().swap_remove(k);
            bytes.truncate(keep);
            bytes.extend(tail);
            if let Ok(set) = parse(format, &bytes) {
                prop_assert!(set.points() <= bytes.len());
            }
        }

        #[test]
        fn no_panic_on_garbage_of_likely_characters(
            k in 1..3usize,
            keep in 0..200usize,
            tail in "[-0-9lv./# \n\\\\eE+]{0,200}",
        ) {
            let (format, mut bytes) = samples().swap_remove(k);
            bytes.truncate(keep);
            bytes.extend(tail.into_bytes());
            if let Ok(set) = parse(format, &bytes) {
                prop_assert!(set.points() <= bytes.len());
            }
        }
    }

    #[test]
    fn the_extension_selects_the_format_and_errors_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        for ((_, bytes), name) in samples()
            .into_iter()
            .zip(["a.BCC", "b.Obj", "c.vect", "d.usdA"])
        {
            let path = dir.path().join(name);
            std::fs::write(&path, &bytes).unwrap();
            assert_eq!(read(&path).unwrap().len(), 2);
            std::fs::write(&path, &bytes[..7]).unwrap();
            let e = read(&path).unwrap_err();
            assert!(matches!(e, Error::InFile { .. }));
            let start = format!("{}: not a valid ", path.display());
            assert!(e.to_string().starts_with(&start), "{e}");
        }
        for name in ["a", "a.txt", ".bcc", "bcc", "a.bcc.gz"] {
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

    #[cfg(not(feature = "usd"))]
    #[test]
    fn usd_files_are_refused_by_name_without_the_feature() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.usda", "a.usdc", "a.USD", "a.usdz"] {
            let path = folder.path().join(name);
            assert!(FrameWriter::create(&path).is_err());
            assert!(!path.exists());
            std::fs::write(&path, "#usda 1.0").unwrap();
            assert_error_contains(read(&path), "build linkwatch with the feature usd");
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
