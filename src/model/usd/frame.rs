//! Curves, names and radii of one frame.

use super::affine::Affine;
use super::layer::{Value, WORD_BYTES};
use super::stage::{Batch, Wrap};
use super::{FORMAT, Motion};
use crate::curve::{Basis, CurveLabels, CurveSet, CurveSetBuilder, Point, Positions, Precision};
use crate::error::{Error, Result};
use std::io::{Read, Seek};
use std::sync::Arc;

/// Maximum number of points of a frame: so many, and so many per byte of the file. Prims of a
/// binary file may share their points, and be moved by transforms; without this limit a small file
/// could describe a huge frame.
const POINTS: (u64, u64) = (1 << 20, 16);

/// Number of points that are transformed at once.
const CHUNK: usize = 1024;

/// Names and radii of the last frame.
#[derive(Debug)]
pub(super) struct Labels {
    labels: Arc<CurveLabels>,
    /// Number of curves of each prim.
    curves: Vec<usize>,
}

impl Labels {
    pub fn new(batches: &[Batch]) -> Labels {
        Labels {
            labels: Arc::default(),
            curves: vec![usize::MAX; batches.len()],
        }
    }

    pub fn current(&self) -> Arc<CurveLabels> {
        self.labels.clone()
    }

    /// Sets the labels of a frame. They are shared with the last frame if they are equal.
    fn set(&mut self, batches: &[Batch], curves: Vec<usize>, radii: Vec<f32>) -> Result<()> {
        if curves == self.curves && radii == self.labels.radii {
            return Ok(());
        }
        let names = match curves == self.curves {
            true => self.labels.names.clone(),
            false => names(batches, &curves)?,
        };
        let labels = CurveLabels { names, radii };
        labels.check(curves.iter().sum())?;
        (self.labels, self.curves) = (Arc::new(labels), curves);
        Ok(())
    }
}

/// Returns the names of all curves: those of linkwatch's own files, else the path of the prim, with
/// an index if it has several curves or their number may change. Empty if the file says that the
/// curves have no names.
fn names(batches: &[Batch], curves: &[usize]) -> Result<Vec<String>> {
    let unnamed = |batch: &Batch| batch.names.as_ref().is_some_and(Vec::is_empty);
    if batches.iter().all(unnamed) {
        return Ok(Vec::new());
    }
    let mut all = Vec::with_capacity(curves.iter().sum());
    for (batch, &n) in batches.iter().zip(curves) {
        match &batch.names {
            Some(names) if names.len() == n => all.extend_from_slice(names),
            _ if n == 1 && !batch.counts.is_animated() => all.push(batch.path.clone()),
            _ => all.extend((0..n).map(|k| format!("{}[{k}]", batch.path))),
        }
    }
    match all.iter().find(|name| name.len() > WORD_BYTES) {
        None => Ok(all),
        Some(name) => {
            let what = format!("{name}: a name of more than {WORD_BYTES} bytes");
            Err(Error::unsupported(FORMAT, what))
        }
    }
}

impl<R: Read + Seek> Motion<R> {
    /// Reads the curves at a time code, and sets the labels.
    pub(super) fn curves(&mut self, code: f64) -> Result<CurveSet> {
        let maps = self.maps(code)?;
        let basis = self.batches[0].basis;
        let mut builder = CurveSet::builder(basis, self.precision, self.slots);
        let mut curves = Vec::with_capacity(self.batches.len());
        let mut radii = Vec::new();
        let mut with_widths = true;
        let limit = POINTS.0 + POINTS.1 * self.bytes;
        let mut left = limit;
        for batch in &mut self.batches {
            let bad = {
                let path = batch.path.clone();
                move |what: String| {
                    Error::format(FORMAT, format_args!("{path}, time code {code}"), what)
                }
            };
            let counts = match batch.counts.at(code, &mut self.values)? {
                Some(Value::Ints(counts)) => counts,
                other => return Err(bad(wrong("curveVertexCounts", other, "int[]"))),
            };
            let points = match batch.points.at(code, &mut self.values)? {
                Some(Value::Singles(3, points)) => points,
                other => return Err(bad(wrong("points", other, "point3f[]"))),
            };
            let n = total(counts, points.len() / 3).map_err(&bad)?;
            left = left.checked_sub(n as u64).ok_or_else(|| {
                bad(format!(
                    "more than {limit} points in a frame, the limit of a file of this size, as \
                     prims share their points: write it as text with usdcat"
                ))
            })?;
            let map = maps[batch.prim];
            match self.precision {
                Precision::F32 => add(&mut builder, counts, points, batch.wrap)?,
                Precision::F64 => add_mapped(&mut builder, counts, points, batch.wrap, map)?,
            }
            curves.push(counts.len());
            batch.points.forget();
            with_widths &= batch.widths.is_some();
            if let Some(track) = batch.widths.as_mut().filter(|_| with_widths) {
                let interpolation = track.attribute.interpolation.clone();
                let widths = match track.at(code, &mut self.values)? {
                    Some(Value::Singles(1, widths)) => widths,
                    other => return Err(bad(wrong("widths", other, "float[]"))),
                };
                let closed = batch.wrap == Wrap::Closed;
                let spans = Spans {
                    counts,
                    points: n,
                    segments: |n| segments(basis, batch.wrap, n) + usize::from(!closed),
                };
                let factor = 0.5 * map.map_or(1.0, |map| map.stretch());
                let widest = spans
                    .widest(interpolation.as_deref(), widths)
                    .map_err(&bad)?;
                radii.extend(widest.into_iter().map(|w| (f64::from(w) * factor) as f32));
            }
        }
        // Radii are those of all curves or none.
        if !with_widths {
            radii.clear();
        }
        let set = builder.finish()?;
        self.slots = set.slots();
        self.labels.set(&self.batches, curves, radii)?;
        Ok(set)
    }
}

fn wrong(name: &str, found: Option<&Value>, expected: &str) -> String {
    let found = found.map_or("no value".into(), Value::describe);
    format!("{name} has {found}, expected {expected}")
}

/// Returns the number of points, if the counts add up to it.
fn total(counts: &[i32], points: usize) -> Result<usize, String> {
    if let Some(k) = counts.iter().position(|&n| n < 1) {
        return Err(format!(
            "curve {k} of curveVertexCounts has {} points",
            counts[k]
        ));
    }
    let sum: u64 = counts.iter().map(|&n| u64::from(n.unsigned_abs())).sum();
    match sum == points as u64 {
        true => Ok(points),
        false => Err(format!(
            "curveVertexCounts add up to {sum}, points has {points}"
        )),
    }
}

/// Returns the number of segments of a curve of `n` points.
fn segments(basis: Basis, wrap: Wrap, n: usize) -> usize {
    let phantoms = if wrap == Wrap::Pinned { 2 } else { 0 };
    basis
        .segments(n + phantoms, wrap == Wrap::Closed)
        .unwrap_or(0)
}

/// Adds the curves of a prim as they are.
fn add(builder: &mut CurveSetBuilder, counts: &[i32], mut xyz: &[f32], wrap: Wrap) -> Result<()> {
    for &count in counts {
        let n = count.unsigned_abs() as usize;
        let (curve, rest) = xyz.split_at(3 * n);
        builder.start_curve(n, wrap == Wrap::Closed)?;
        builder.push(Positions::F32(curve))?;
        xyz = rest;
    }
    Ok(())
}

/// Adds the curves of a prim in double precision: transformed, with the points beyond the ends of
/// pinned splines.
fn add_mapped(
    builder: &mut CurveSetBuilder,
    counts: &[i32],
    xyz: &[f32],
    wrap: Wrap,
    map: Option<Affine>,
) -> Result<()> {
    let at = |k: usize| -> Point {
        let p = [0, 1, 2].map(|x| f64::from(xyz[3 * k + x]));
        map.map_or(p, |map| map.apply(p))
    };
    // P[-1] = 2 P[0] - P[1], so that the spline begins at P[0]; likewise at the end.
    let beyond = |end: usize, next: usize| -> Point {
        let (p, q) = (at(end), at(next));
        [0, 1, 2].map(|x| 2.0 * p[x] - q[x])
    };
    let mut first = 0;
    let mut chunk: Vec<f64> = Vec::new();
    for &count in counts {
        let n = count.unsigned_abs() as usize;
        let end = first + n;
        // A single point has no direction; the basis rejects it.
        let pinned = wrap == Wrap::Pinned && n > 1;
        builder.start_curve(if pinned { n + 2 } else { n }, wrap == Wrap::Closed)?;
        if pinned {
            builder.push(Positions::F64(&beyond(first, first + 1)))?;
        }
        for start in (first..end).step_by(CHUNK) {
            chunk.clear();
            chunk.extend((start..end.min(start + CHUNK)).flat_map(at));
            builder.push(Positions::F64(&chunk))?;
        }
        if pinned {
            builder.push(Positions::F64(&beyond(end - 1, end - 2)))?;
        }
        first = end;
    }
    Ok(())
}

/// Sizes of the curves of a prim, to which widths belong.
struct Spans<'a, F> {
    counts: &'a [i32],
    points: usize,
    /// Number of ends of segments of a curve of so many points.
    segments: F,
}

impl<F: Fn(usize) -> usize> Spans<'_, F> {
    /// Returns the largest width of each curve.
    fn widest(&self, interpolation: Option<&str>, widths: &[f32]) -> Result<Vec<f32>, String> {
        let curves = self.counts.len();
        let sizes = self.counts.iter().map(|n| n.unsigned_abs() as usize);
        let name = match interpolation {
            Some(name) => name,
            // The rule of USD is `vertex`; many files have one width without a rule.
            None if widths.len() == 1 => "constant",
            None => "vertex",
        };
        let expected = match name {
            "constant" => 1,
            "uniform" => curves,
            "vertex" => self.points,
            "varying" | "faceVarying" => sizes.clone().map(&self.segments).sum(),
            other => return Err(format!("widths with the interpolation {other:?}")),
        };
        if widths.len() != expected {
            let found = widths.len();
            return Err(format!(
                "{found} widths with the interpolation {name}, expected {expected}"
            ));
        }
        if let Some(width) = widths.iter().find(|w| !(**w >= 0.0 && w.is_finite())) {
            return Err(format!("a width of {width}, expected at least 0"));
        }
        let mut rest = widths;
        Ok(match name {
            "constant" => vec![widths[0]; curves],
            "uniform" => widths.to_vec(),
            _ => sizes
                .map(|n| {
                    let n = if name == "vertex" {
                        n
                    } else {
                        (self.segments)(n)
                    };
                    let (widths, after) = rest.split_at(n);
                    rest = after;
                    widths.iter().copied().fold(0.0, f32::max)
                })
                .collect(),
        })
    }
}
