//! USD: `BasisCurves` of one layer, with time samples. Text (`.usda`), binary (`.usdc`), either
//! (`.usd`) and packages (`.usdz`) are read; text is written.
//!
//! - Curves are those of all prims `BasisCurves` that are defined and active, in the order of the
//!   file. Prims with the purpose `proxy` or `guide` are counted as left out; `visibility` is
//!   ignored. Meshes, points and shapes (`Capsule`, `Cylinder`) are no curves.
//! - Each time code at which points, counts, widths or a transform have a sample is a frame.
//! - Layers are not composed: a file with references, payloads, sublayers, variants, inherits,
//!   specializes or value clips is refused, with the command that flattens it.
//! - A stage has no standard for a periodic cell, so none is read: the caller gives it.
//! - Points are in single precision. They are transformed in double precision, unless all
//!   transforms are the identity.
//!
//! The structure of the file is read when it is opened, and the values of a frame when it is read,
//! so that the memory is that of the structure and of a frame. No count is trusted, and nothing
//! recurses: a crate that reads all of USD (`openusd` 0.6) aborts on one wrong byte of a binary
//! file in seven, as it allocates what the file promises.
//!
//! `docs/reference/formats.md` has the rules in full.

mod affine;
mod binary;
mod frame;
mod input;
mod layer;
mod packed;
mod scanner;
mod specs;
mod stage;
#[cfg(test)]
mod tests;
mod text;
mod tokens;
mod track;
mod write;

use self::affine::{Affine, Ops};
use self::binary::Binary;
use self::frame::Labels;
use self::input::Input;
use self::layer::{Layer, TIME};
use self::stage::{Batch, Wrap};
use self::text::Text;
use self::track::{Track, Values};
use self::write::UsdFile;
use super::frames::{FrameSource, LeftOut, ModelFrame};
use super::write::FrameSink;
use crate::curve::Precision;
use crate::error::{Error, Result};
use std::collections::HashSet;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

const FORMAT: &str = "USD";
/// Time codes per second of a file that does not say.
const CODES_PER_SECOND: f64 = 24.0;
/// Number from which floating-point numbers skip integers.
const EXACT: f64 = (1_u64 << 53) as f64;

/// The frames of a file.
struct Motion<R> {
    values: Values<R>,
    /// Size of the file.
    bytes: u64,
    batches: Vec<Batch>,
    /// Prims with curves that are not read.
    left_out: Vec<LeftOut>,
    /// Transforms of all prims, with the index of the prim above.
    transforms: Vec<(Ops, Option<usize>)>,
    precision: Precision,
    /// Time codes, increasing. Empty if nothing changes.
    times: Vec<f64>,
    codes_per_second: f64,
    /// Time of each frame in seconds, in linkwatch's own files.
    seconds: Option<Track>,
    /// True if all time codes are numbers of frames.
    numbered: bool,
    /// Number of frames that were read.
    read: usize,
    labels: Labels,
    /// Memory of the last frame, in points.
    slots: usize,
}

/// Opens a file of `len` bytes.
pub(super) fn open(source: impl Read + Seek + 'static, len: u64) -> Result<Box<dyn FrameSource>> {
    Ok(Box::new(Motion::open(source, len)?))
}

/// Creates a text file.
///
/// Errors: `path` has the extension of a binary file or of a package.
pub(super) fn create(path: &Path) -> Result<Box<dyn FrameSink>> {
    let extension = path.extension().unwrap_or_default();
    if ["usdc", "usdz"]
        .iter()
        .any(|e| extension.eq_ignore_ascii_case(e))
    {
        let what = "a binary file or a package: write a text file (.usda), which usdcat converts";
        return Err(Error::unsupported(FORMAT, what).in_file(path));
    }
    Ok(Box::new(UsdFile::new(path)?))
}

impl<R: Read + Seek> Motion<R> {
    fn open(source: R, len: u64) -> Result<Motion<R>> {
        let (mut values, layer) = open_layer(Input::new(source, len))?;
        let (batches, left_out) = stage::batches(&layer, &mut values)?;
        let ops = stage::transforms(&layer, &batches, &mut values)?;
        let parents = layer.prims.iter().map(|prim| prim.parent);
        let transforms: Vec<_> = ops.into_iter().zip(parents).collect();
        let moved = transforms.iter().any(|(ops, _)| !ops.is_identity());
        // A point beyond the end of a pinned spline may need more than single precision.
        let pinned = batches.iter().any(|batch| batch.wrap == Wrap::Pinned);
        let precision = match moved || pinned {
            true => Precision::F64,
            false => Precision::F32,
        };
        let times = times(&batches, &transforms);
        let numbered = (times.iter()).all(|&t| (0.0..=EXACT).contains(&t) && t.fract() == 0.0);
        let seconds = layer.prims.first().and_then(|prim| prim.attribute(TIME));
        Ok(Motion {
            seconds: seconds.map(Track::new),
            codes_per_second: codes_per_second(&layer)?,
            labels: Labels::new(&batches),
            values,
            bytes: len,
            batches,
            left_out,
            transforms,
            precision,
            times,
            numbered,
            read: 0,
            slots: 0,
        })
    }

    /// Returns the map of each prim to the world at a time; `None` for the identity.
    fn maps(&mut self, time: f64) -> Result<Vec<Option<Affine>>> {
        let mut maps: Vec<Option<Affine>> = Vec::with_capacity(self.transforms.len());
        for (ops, parent) in &mut self.transforms {
            let above = parent
                .filter(|_| !ops.resets)
                .and_then(|parent| maps[parent]);
            maps.push(match (ops.is_identity(), above) {
                (true, above) => above,
                (false, None) => Some(ops.at(time, &mut self.values)?),
                (false, Some(above)) => Some(ops.at(time, &mut self.values)?.then(&above)),
            });
        }
        Ok(maps)
    }

    /// Returns the time of a frame in seconds.
    fn seconds(&mut self, code: f64) -> f64 {
        let own = match &mut self.seconds {
            Some(track) => track.at(code, &mut self.values).ok().flatten(),
            None => None,
        };
        match own {
            Some(layer::Value::Doubles(1, v)) if v.len() == 1 => v[0],
            _ => code / self.codes_per_second,
        }
    }
}

impl<R: Read + Seek> FrameSource for Motion<R> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        let k = self.read;
        let code = match (self.times.get(k), k) {
            (Some(&code), _) => code,
            // A file without samples has one frame.
            (None, 0) => 0.0,
            (None, _) => return Ok(None),
        };
        self.read += 1;
        let seq = match self.numbered && !self.times.is_empty() {
            true => code as u64,
            false => k as u64,
        };
        let curves = self.curves(code);
        let mut frame = ModelFrame::new(seq, curves);
        if !self.times.is_empty() {
            frame.time = self.seconds(code);
        }
        frame.labels = self.labels.current();
        frame.left_out.clone_from(&self.left_out);
        Ok(Some(frame))
    }
}

/// Returns the times of all samples, increasing.
fn times(batches: &[Batch], transforms: &[(Ops, Option<usize>)]) -> Vec<f64> {
    let tracks = batches.iter().flat_map(|batch| {
        let tracks = [
            Some(&batch.points),
            Some(&batch.counts),
            batch.widths.as_ref(),
        ];
        tracks.into_iter().flatten()
    });
    let tracks = tracks.chain(transforms.iter().flat_map(|(ops, _)| ops.tracks()));
    // Thousands of prims may share the same samples.
    let mut seen = HashSet::new();
    let mut times = Vec::new();
    for samples in tracks.map(|track| &track.attribute.samples) {
        if seen.insert(Arc::as_ptr(samples).cast::<()>()) {
            times.extend(samples.iter().map(|sample| sample.0));
        }
    }
    times.sort_unstable_by(f64::total_cmp);
    times.dedup();
    times
}

fn codes_per_second(layer: &Layer) -> Result<f64> {
    let given = layer.time_codes_per_second.or(layer.frames_per_second);
    match given.unwrap_or(CODES_PER_SECOND) {
        codes if codes > 0.0 && codes.is_finite() => Ok(codes),
        codes => {
            let what = format!("{codes} time codes per second, expected a number above 0");
            Err(Error::format(FORMAT, "timeCodesPerSecond", what))
        }
    }
}

/// Recognizes the form of a file by its first bytes, and reads its structure.
fn open_layer<R: Read + Seek>(mut input: Input<R>) -> Result<(Values<R>, Layer)> {
    let mut head = [0; 8];
    let n = input.len().min(8) as usize;
    input.read(0, &mut head[..n])?;
    if head.starts_with(b"PK\x03\x04") {
        input = first_of_package(input)?;
        head = [0; 8];
        let n = input.len().min(8) as usize;
        input.read(0, &mut head[..n])?;
    }
    if head == *binary::MAGIC {
        let (file, layer) = Binary::open(input)?;
        return Ok((Values::Binary(file), layer));
    }
    if head.starts_with(text::MAGIC) {
        let (file, layer) = Text::open(input)?;
        return Ok((Values::Text(file), layer));
    }
    let found = super::quote(&head[..n]);
    let what = format!("{found}, expected '#usda', 'PXR-USDC' or a package");
    Err(Error::format(FORMAT, "byte 0", what))
}

/// Returns the first file of a package (`.usdz`), which is its root layer. Packages are ZIP files
/// without compression.
fn first_of_package<R: Read + Seek>(mut input: Input<R>) -> Result<Input<R>> {
    let mut head = [0; 30];
    input.read(0, &mut head)?;
    let u16_at = |k: usize| u64::from(u16::from_le_bytes([head[k], head[k + 1]]));
    let [flags, method, name, extra] = [6, 8, 26, 28].map(u16_at);
    let [packed, size] = [18, 22].map(|k| u16_at(k) | u16_at(k + 2) << 16);
    // Encrypted, or with its size after the content.
    if method != 0 || flags & 9 != 0 || packed != size {
        let what = "a package whose first file is compressed or encrypted";
        return Err(Error::unsupported(FORMAT, what));
    }
    input.part(30 + name + extra, size)
}
