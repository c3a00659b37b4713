//! Writes text USD files (`.usda`).
//!
//! Below the prim `/linkwatch` there is a prim `BasisCurves` for each run of closed or of open
//! curves, because `wrap` is that of a prim. The attribute `linkwatch:names` keeps the names of the
//! curves, and `linkwatch:time` the time of each frame in seconds. Time codes are the numbers of
//! the frames. A single frame with number and time 0 is written without time samples.
//!
//! Coordinates have single precision, as USD defines: double precision is rejected if it would be
//! rounded.
//!
//! Memory: a frame is written when it comes, for the first run of curves. The frames of other runs
//! follow in the file, so they are held until the end: 12 bytes a point.

use super::FORMAT;
use super::layer::{NAMES_OF_CURVES, TIME};
use crate::curve::{Basis, CurveLabels, CurveSet};
use crate::error::{Error, Result};
use crate::model::frames::ModelFrame;
use crate::model::write::FrameSink;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A frame to write.
#[derive(Clone, Copy)]
struct Frame<'a> {
    seq: u64,
    time: f64,
    labels: &'a CurveLabels,
    curves: &'a CurveSet,
}

/// A frame that is written later.
struct Held {
    seq: u64,
    time: f64,
    labels: Arc<CurveLabels>,
    curves: CurveSet,
}

impl Held {
    fn frame(&self) -> Frame<'_> {
        Frame {
            seq: self.seq,
            time: self.time,
            labels: &self.labels,
            curves: &self.curves,
        }
    }
}

/// A text file.
pub(super) struct UsdFile {
    path: PathBuf,
    out: BufWriter<File>,
    /// The first frame, until it is known if others follow.
    first: Option<Held>,
    motion: Option<Motion>,
}

/// What is common to the frames of a motion, and what follows after the first run of curves.
struct Motion {
    basis: Basis,
    counts: Vec<i32>,
    names: Vec<String>,
    runs: Vec<Range<usize>>,
    /// Number and time of each frame.
    times: Vec<(u64, f64)>,
    /// Radii of the frames before and after each change, because readers interpolate.
    radii: Vec<(u64, Vec<f32>)>,
    /// Points of the runs after the first one, frame after frame.
    later: Vec<f32>,
    /// Position of the time code of the last frame.
    end: u64,
}

impl UsdFile {
    pub fn new(path: &Path) -> Result<UsdFile> {
        let file = File::create(path).map_err(Error::file(path))?;
        Ok(UsdFile {
            path: path.into(),
            out: BufWriter::with_capacity(1 << 16, file),
            first: None,
            motion: None,
        })
    }

    fn write(&mut self, frame: Frame<'_>) -> Result<()> {
        let path = &self.path;
        let motion = match &mut self.motion {
            Some(motion) => motion,
            empty => {
                let motion = Motion::start(&mut self.out, frame).map_err(Error::file(path))?;
                empty.insert(motion)
            }
        };
        motion.check(frame)?;
        motion
            .frame(&mut self.out, frame)
            .map_err(Error::file(path))
    }
}

impl FrameSink for UsdFile {
    fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        let curves = match &frame.curves {
            Ok(curves) => curves,
            Err(e) => return Err(Error::unsupported(FORMAT, e)),
        };
        if curves.is_empty() {
            return Err(Error::unsupported(FORMAT, "a frame without curves"));
        }
        if frame.seq > super::EXACT as u64 || !frame.time.is_finite() {
            let what = format!(
                "frame {} at {} s: time codes are exact up to 2^53",
                frame.seq, frame.time
            );
            return Err(Error::unsupported(FORMAT, what));
        }
        frame.labels.check(curves.len())?;
        crate::model::bcc::check_precision(FORMAT, curves)?;
        if self.first.is_none() && self.motion.is_none() {
            self.first = Some(Held {
                seq: frame.seq,
                time: frame.time,
                labels: frame.labels.clone(),
                curves: curves.clone(),
            });
            return Ok(());
        }
        if let Some(first) = self.first.take() {
            self.write(first.frame())?;
        }
        self.write(Frame {
            seq: frame.seq,
            time: frame.time,
            labels: &frame.labels,
            curves,
        })
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let path = self.path.clone();
        if let Some(frame) = self.first.take() {
            if frame.seq == 0 && frame.time == 0.0 {
                return single(&mut self.out, frame.frame()).map_err(Error::file(path));
            }
            self.write(frame.frame())?;
        }
        match &self.motion {
            Some(motion) => motion.finish(&mut self.out).map_err(Error::file(path)),
            None => Err(Error::unsupported(FORMAT, "a file without frames")),
        }
    }
}

/// Returns runs of curves that are all closed or all open.
fn runs(curves: &CurveSet) -> Vec<Range<usize>> {
    let mut first = 0;
    let runs = curves.curves().chunk_by(|a, b| a.closed == b.closed);
    runs.map(|run| {
        let range = first..first + run.len();
        first = range.end;
        range
    })
    .collect()
}

/// Writes a file without time samples.
fn single(out: &mut BufWriter<File>, frame: Frame<'_>) -> std::io::Result<()> {
    let curves = frame.curves;
    let counts: Vec<i32> = curves.counts().collect();
    out.write_all(b"#usda 1.0\n(\n    defaultPrim = \"linkwatch\"\n)\n\n")?;
    out.write_all(b"def Xform \"linkwatch\"\n{\n")?;
    for (k, run) in runs(curves).into_iter().enumerate() {
        begin(
            out,
            k,
            curves.basis(),
            &counts[run.clone()],
            names(frame, &run),
        )?;
        if !frame.labels.radii.is_empty() {
            out.write_all(b"        float[] widths = ")?;
            widths(out, &frame.labels.radii[run.clone()])?;
            out.write_all(UNIFORM)?;
        }
        out.write_all(b"        point3f[] points = ")?;
        array(out, points(curves, run))?;
        out.write_all(b"\n    }\n")?;
    }
    out.write_all(b"}\n")?;
    out.flush()
}

const UNIFORM: &[u8] = b" (\n            interpolation = \"uniform\"\n        )\n";
/// Place for a time code of at most 2^53.
const CODE: usize = 16;

fn names<'a>(frame: Frame<'a>, run: &Range<usize>) -> &'a [String] {
    frame.labels.names.get(run.clone()).unwrap_or_default()
}

/// Writes a prim up to its widths and points.
fn begin(
    out: &mut impl Write,
    k: usize,
    basis: Basis,
    counts: &[i32],
    names: &[String],
) -> std::io::Result<()> {
    let (kind, basis) = match basis {
        Basis::Polyline => ("linear", None),
        Basis::CatmullRom => ("cubic", Some("catmullRom")),
        Basis::BSpline => ("cubic", Some("bspline")),
        Basis::Bezier => ("cubic", Some("bezier")),
    };
    let wrap = match counts[0] < 0 {
        true => "periodic",
        false => "nonperiodic",
    };
    write!(out, "    def BasisCurves \"curves_{k}\"\n    {{\n")?;
    writeln!(out, "        uniform token type = \"{kind}\"")?;
    if let Some(basis) = basis {
        writeln!(out, "        uniform token basis = \"{basis}\"")?;
    }
    writeln!(out, "        uniform token wrap = \"{wrap}\"")?;
    out.write_all(b"        int[] curveVertexCounts = ")?;
    list(out, counts, |out, n| write!(out, "{}", n.unsigned_abs()))?;
    write!(
        out,
        "\n        custom uniform string[] {NAMES_OF_CURVES} = "
    )?;
    list(out, names, |out, name| {
        write!(
            out,
            "\"{}\"",
            name.replace('\\', "\\\\").replace('"', "\\\"")
        )
    })?;
    out.write_all(b"\n")
}

/// Writes `[a, b, ..]`.
fn list<T, W: Write>(
    out: &mut W,
    items: impl IntoIterator<Item = T>,
    each: impl Fn(&mut W, T) -> std::io::Result<()>,
) -> std::io::Result<()> {
    out.write_all(b"[")?;
    for (k, item) in items.into_iter().enumerate() {
        if k > 0 {
            out.write_all(b", ")?;
        }
        each(out, item)?;
    }
    out.write_all(b"]")
}

/// Writes twice the radii. A width beyond single precision is infinite, and readers reject it.
fn widths(out: &mut impl Write, radii: &[f32]) -> std::io::Result<()> {
    list(out, radii, |out, r| write!(out, "{:?}", 2.0 * r))
}

/// Returns the coordinates of a run of curves. Single precision represents them exactly.
fn points(curves: &CurveSet, run: Range<usize>) -> impl Iterator<Item = f32> + '_ {
    run.flat_map(move |i| {
        let n = curve_points(curves, i);
        (0..n).flat_map(move |k| curves.point(i, k).map(|x| x as f32))
    })
}

fn curve_points(curves: &CurveSet, i: usize) -> usize {
    curves.curve(i).points as usize
}

/// Writes points. Each coordinate is written so that it is read as the same number.
fn array(out: &mut impl Write, mut xyz: impl Iterator<Item = f32>) -> std::io::Result<()> {
    out.write_all(b"[")?;
    let mut first = true;
    while let (Some(x), Some(y), Some(z)) = (xyz.next(), xyz.next(), xyz.next()) {
        let comma = if std::mem::take(&mut first) { "" } else { ", " };
        write!(out, "{comma}({x:?}, {y:?}, {z:?})")?;
    }
    out.write_all(b"]")
}

impl Motion {
    /// Writes the head of a file, and of the first run of curves.
    fn start(out: &mut BufWriter<File>, frame: Frame<'_>) -> std::io::Result<Motion> {
        let counts: Vec<i32> = frame.curves.counts().collect();
        let runs = runs(frame.curves);
        let mut head = String::from("#usda 1.0\n(\n    defaultPrim = \"linkwatch\"\n");
        head += &format!("    startTimeCode = {}\n    endTimeCode = ", frame.seq);
        let end = head.len() as u64;
        head += &format!("{:CODE$}\n    timeCodesPerSecond = 24\n)\n\n", "");
        head += "def Xform \"linkwatch\"\n{\n";
        out.write_all(head.as_bytes())?;
        let basis = frame.curves.basis();
        begin(
            out,
            0,
            basis,
            &counts[runs[0].clone()],
            names(frame, &runs[0]),
        )?;
        out.write_all(b"        point3f[] points.timeSamples = {\n")?;
        Ok(Motion {
            basis,
            counts,
            names: frame.labels.names.clone(),
            runs,
            times: Vec::new(),
            radii: Vec::new(),
            later: Vec::new(),
            end,
        })
    }

    /// Fails if the curves of a frame are not those of the first one, or its number is not larger
    /// than the last one.
    fn check(&self, frame: Frame<'_>) -> Result<()> {
        let seq = frame.seq;
        let refuse = |what: String| Err(Error::unsupported(FORMAT, what));
        if let Some(&(last, _)) = self.times.last().filter(|(last, _)| *last >= seq) {
            return refuse(format!("frame {seq} after frame {last}"));
        }
        let same = frame.curves.basis() == self.basis
            && frame.curves.counts().eq(self.counts.iter().copied())
            && frame.labels.names == self.names;
        let radii = self.radii.first().map(|(_, radii)| radii.len());
        let same_radii = radii.is_none_or(|n| n == frame.labels.radii.len());
        match same && same_radii {
            true => Ok(()),
            false => refuse(format!(
                "frame {seq} has other curves, names or radii than the first frame of the file: \
                 write it to a file of its own"
            )),
        }
    }

    fn frame(&mut self, out: &mut BufWriter<File>, frame: Frame<'_>) -> std::io::Result<()> {
        let curves = frame.curves;
        write!(out, "            {}: ", frame.seq)?;
        array(out, points(curves, self.runs[0].clone()))?;
        out.write_all(b",\n")?;
        let later = self.runs[0].end..curves.len();
        self.later.extend(points(curves, later));
        let radii = &frame.labels.radii;
        let last = self.radii.last().filter(|(_, last)| last != radii).cloned();
        if let (Some((since, last)), Some(&(before, _))) = (last, self.times.last())
            && since < before
        {
            self.radii.push((before, last));
        }
        if self.radii.last().is_none_or(|(_, last)| last != radii) {
            self.radii.push((frame.seq, radii.clone()));
        }
        self.times.push((frame.seq, frame.time));
        Ok(())
    }

    /// Writes what follows the first run of curves, and the time code of the last frame.
    fn finish(&self, out: &mut BufWriter<File>) -> std::io::Result<()> {
        self.close_points(out, &self.runs[0])?;
        let points_of = |run: &Range<usize>| -> usize {
            let counts = &self.counts[run.clone()];
            counts.iter().map(|n| n.unsigned_abs() as usize).sum()
        };
        let stride = self.later.len() / self.times.len();
        let mut at = 0;
        for (k, run) in self.runs.iter().enumerate().skip(1) {
            let names = self.names.get(run.clone()).unwrap_or_default();
            begin(out, k, self.basis, &self.counts[run.clone()], names)?;
            out.write_all(b"        point3f[] points.timeSamples = {\n")?;
            let len = 3 * points_of(run);
            for (frame, (seq, _)) in self.later.chunks(stride).zip(&self.times) {
                write!(out, "            {seq}: ")?;
                array(out, frame[at..at + len].iter().copied())?;
                out.write_all(b",\n")?;
            }
            at += len;
            self.close_points(out, run)?;
        }
        writeln!(out, "    custom double {TIME}.timeSamples = {{")?;
        for (seq, time) in &self.times {
            writeln!(out, "        {seq}: {time:?},")?;
        }
        out.write_all(b"    }\n}\n")?;
        if let Some((last, _)) = self.times.last() {
            out.seek(SeekFrom::Start(self.end))?;
            write!(out, "{last}")?;
        }
        out.flush()
    }

    /// Ends the points of a prim, and writes its widths.
    fn close_points(&self, out: &mut BufWriter<File>, run: &Range<usize>) -> std::io::Result<()> {
        out.write_all(b"        }\n")?;
        match &self.radii[..] {
            [] => {}
            [(_, radii)] if radii.is_empty() => {}
            [(_, radii)] => {
                out.write_all(b"        float[] widths = ")?;
                widths(out, &radii[run.clone()])?;
                out.write_all(UNIFORM)?;
            }
            changes => {
                out.write_all(b"        float[] widths")?;
                out.write_all(UNIFORM)?;
                out.write_all(b"        float[] widths.timeSamples = {\n")?;
                for (seq, radii) in changes {
                    write!(out, "            {seq}: ")?;
                    widths(out, &radii[run.clone()])?;
                    out.write_all(b",\n")?;
                }
                out.write_all(b"        }\n")?;
            }
        }
        out.write_all(b"    }\n")
    }
}
