//! All curves of one frame, as a structure of arrays.

mod bounds;
mod boxes;
mod builder;
mod coarse_boxes;
mod coordinates;
mod diagonals;
mod extent;
mod frame;
mod lazy;
mod leaf_boxes;
mod local;
mod parts;
mod pool;
mod stored;
mod sums;
mod support;
mod tile;

pub(crate) use super::basis::{Bezier, Bounds, bspline_knot, point_at, sub_segment};
pub(crate) use super::cell::{minus, plus};
pub(crate) use super::labels::CurveChange;
pub(crate) use bounds::{AXES, bounds, union};
pub(crate) use boxes::{Box3, BoxGroup, above, below, larger, smaller};
pub use builder::CurveSetBuilder;
pub(crate) use coordinates::{Axes, Knots, ReadKnots, Scalar};
pub(crate) use diagonals::Diagonals;
pub(crate) use frame::{Frame, Images};
pub(crate) use lazy::Received;
pub(crate) use local::{feature, nearest};
pub(crate) use parts::{Parts, multiple};
pub(crate) use pool::FramePool;
pub(crate) use stored::StoredCurves;
pub(crate) use sums::{SumEdges, SumPoint, TERMS, Translated, single};
pub(crate) use tile::{Bad, largest_within};

use self::coordinates::Coordinates;
use self::lazy::{Arrays, LazyCoordinates};
use self::sums::Sums;
use super::*;
use crate::error::{Error, Result};
use crate::simd::LANES;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Size of one curve of a [`CurveSet`], and the position of its control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// First slot of the curve in the coordinate arrays (a wrapped control point if the basis needs
    /// one).
    first: u32,
    /// Number of control points of all curves before this one.
    first_point: u32,
    /// Number of control points.
    pub points: u32,
    /// Number of spline segments (for polylines: edges).
    pub segments: u32,
    /// True if the end is joined to the start.
    pub closed: bool,
}

impl Curve {
    /// Returns the number of control points, negative for a closed curve.
    pub(crate) fn count(&self) -> i32 {
        let n = self.points as i32;
        if self.closed { -n } else { n }
    }

    /// Returns true if two segments of the curve are equal or consecutive.
    #[inline]
    pub(crate) fn adjacent(&self, s: u32, t: u32) -> bool {
        let apart = s.abs_diff(t);
        apart <= 1 || (self.closed && apart == self.segments - 1)
    }

    /// Returns the segment after `s`, or `s` itself if it is the last one of an open curve.
    #[inline]
    pub(crate) fn after(&self, s: u32) -> u32 {
        match (s + 1 < self.segments, self.closed) {
            (true, _) => s + 1,
            (false, true) => 0,
            (false, false) => s,
        }
    }

    /// Returns the segment before `s`, or `s` itself if it is the first one of an open curve.
    #[inline]
    pub(crate) fn before(&self, s: u32) -> u32 {
        match (s, self.closed) {
            (1.., _) => s - 1,
            (0, true) => self.segments - 1,
            (0, false) => s,
        }
    }
}

/// Largest allowed coordinate of a spline. The discretization forms products of three differences
/// of points, which stay finite up to this limit. (Polylines have no limit.)
const SPLINE_RANGE: f64 = pow2(300);

/// All curves of one frame.
///
/// Control points are stored in three arrays, one per axis, curve after curve. If a frame was
/// received by a [`Session`](crate::Session), the arrays are built when they are needed. A closed
/// curve stores copies of its first points after its last one (and of its last point before its
/// first one if the basis needs it). So every segment is a window of adjacent slots, and eight
/// segments are read at once.
///
/// Invariant: every coordinate is finite, and every curve has as many points as its basis needs.
#[derive(Debug)]
pub struct CurveSet {
    basis: Basis,
    /// Shared by clones, so that clones of one set are recognized as having the same layout at
    /// once.
    curves: Arc<Vec<Curve>>,
    coordinates: LazyCoordinates,
    points: usize,
    /// Counted during construction, so that reading it costs no pass over the curves.
    segments: usize,
    open_curves: usize,
    /// Number of the positions; see [`CurveSet::contents`].
    contents: u64,
    /// Origin of the coordinates, if they are sums.
    sums: Option<Arc<Sums>>,
}

impl Clone for CurveSet {
    fn clone(&self) -> CurveSet {
        CurveSet {
            curves: self.curves.clone(),
            coordinates: self.coordinates.clone(),
            sums: self.sums.clone(),
            ..*self
        }
    }

    /// Copies into the existing buffers, so that copying frame after frame allocates nothing.
    fn clone_from(&mut self, source: &CurveSet) {
        let CurveSet {
            basis,
            curves,
            coordinates,
            points,
            segments,
            open_curves,
            contents,
            sums,
        } = self;
        sums.clone_from(&source.sums);
        curves.clone_from(&source.curves);
        coordinates.clone_from(&source.coordinates);
        (*basis, *contents) = (source.basis, source.contents);
        (*points, *segments, *open_curves) = (source.points, source.segments, source.open_curves);
    }
}

/// Basis, precision and sizes of the curves of a set.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    basis: Basis,
    precision: Precision,
    curves: Arc<Vec<Curve>>,
}

impl PartialEq for Shape {
    fn eq(&self, other: &Shape) -> bool {
        self.basis == other.basis
            && self.precision == other.precision
            && (Arc::ptr_eq(&self.curves, &other.curves) || self.curves == other.curves)
    }
}

/// Writer of the positions of a set, part after part: of the first curves before the others.
struct Writer<'a> {
    arrays: &'a mut Arrays,
    curves: &'a [Curve],
    basis: Basis,
    limit: f64,
}

impl Writer<'_> {
    /// Copies the curves of a set in the same precision, which are the first ones of this set.
    pub fn copy(&mut self, source: &CurveSet) -> Result<(), Bad> {
        match source.coordinates.built() {
            Some(source) => {
                self.arrays.copy_first(source);
                Ok(())
            }
            None => self.write_curves(0..source.len(), source.positions().as_positions()),
        }
    }

    /// Writes all points of some curves.
    pub fn write_curves(
        &mut self,
        curves: Range<usize>,
        positions: Positions<'_>,
    ) -> Result<(), Bad> {
        let curves = &self.curves[curves];
        let before = curves.first().map_or(0, |c| c.first_point as usize);
        let written = self
            .arrays
            .write_curves(curves, self.basis, positions, self.limit);
        written.map_err(|(point, axis, value)| (before + point, axis, value))
    }

    /// Writes the last point of an open curve.
    pub fn write_last_point(&mut self, i: usize, position: Positions<'_>) -> Result<(), Bad> {
        let c = &self.curves[i];
        let last = c.points as usize - 1;
        let at = c.first as usize + self.basis.lead(c.closed) + last;
        let written = self.arrays.write(at, position, self.limit);
        written.map_err(|(_, axis, value)| (c.first_point as usize + last, axis, value))
    }
}

/// Reader of the Bezier control points of segments. It asks once if the arrays of the set are
/// built, before many segments are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hulls<'a> {
    set: &'a CurveSet,
    coordinates: &'a Coordinates,
}

impl Hulls<'_> {
    /// Same as [`CurveSet::hull`].
    #[inline(always)]
    pub fn at(&self, i: usize, s: usize) -> [[f64; 4]; 3] {
        let (slot, basis) = (self.set.slot(i, s), self.set.basis);
        let mut hull = [[0.0; 4]; 3];
        for (x, hull) in hull.iter_mut().enumerate() {
            *hull = basis.hull(if basis.is_polyline() {
                let [p, q] = self.coordinates.window(x, slot);
                [p, q, p, q]
            } else {
                self.coordinates.window(x, slot)
            });
        }
        hull
    }
}

/// Positions of all control points of a set in the order of the input.
pub(crate) enum InOrder<'a> {
    /// As they were received.
    Received(Positions<'a>),
    /// Copied from the arrays.
    Copied(Received),
}

impl InOrder<'_> {
    pub fn as_positions(&self) -> Positions<'_> {
        match self {
            InOrder::Received(positions) => *positions,
            InOrder::Copied(copy) => copy.positions(),
        }
    }

    pub fn into_copy(self) -> Received {
        match self {
            InOrder::Received(positions) => positions.into(),
            InOrder::Copied(copy) => copy,
        }
    }
}

/// Returns the number of slots of a curve: every window of the last, possibly partial, group of
/// eight segments fits.
fn slots_of(basis: Basis, segments: usize) -> usize {
    (segments.next_multiple_of(LANES) - 1) * basis.stride() + basis.window()
}

/// Returns the number of slots of all curves.
fn slots_of_all(curves: &[Curve], basis: Basis) -> usize {
    let end = |c: &Curve| c.first as usize + slots_of(basis, c.segments as usize);
    curves.last().map_or(0, end)
}

/// Returns true if three or more points differ from one another.
pub(crate) fn are_three_distinct(mut points: impl Iterator<Item = Point>) -> bool {
    let a = points.next();
    let b = points.find(|p| Some(*p) != a);
    points.any(|p| Some(p) != a && Some(p) != b)
}

/// Returns a new number of contents.
fn next_contents() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl CurveSet {
    /// Returns a set without curves.
    fn empty(basis: Basis, precision: Precision, slots: usize) -> CurveSet {
        CurveSet {
            basis,
            curves: Arc::default(),
            coordinates: LazyCoordinates::with_capacity(precision, slots),
            points: 0,
            segments: 0,
            open_curves: 0,
            contents: next_contents(),
            sums: None,
        }
    }

    /// Replaces all positions by those of another frame of the same curves. Allocates nothing if
    /// the frame before was updated in the same way.
    ///
    /// If a value is not finite, or too large, all points are at the origin after the error, so
    /// that no verdict on the set is intact.
    pub fn update(&mut self, positions: Positions<'_>) -> Result<()> {
        self.check(positions)?;
        let all = 0..self.len();
        self.write_parts(|mut writer| writer.write_curves(all, positions))
    }

    /// [`CurveSet::update`] by a function that copies all positions. It checks the copy, and fails
    /// with the first value that is not within the limit. The arrays are built from the copy when
    /// they are needed.
    pub(crate) fn update_by(
        &mut self,
        positions: Positions<'_>,
        copy: impl FnOnce(&mut Received, f64) -> Result<(), Bad>,
    ) -> Result<()> {
        self.check(positions)?;
        self.contents = next_contents();
        let limit = self.limit();
        let copied = copy(self.coordinates.received_mut(positions.len()), limit);
        self.finish_update(copied)
    }

    /// [`CurveSet::update`] by a function that appends all positions, in double precision, to an
    /// empty list. The arrays are built from it when they are needed.
    pub(crate) fn update_with(&mut self, write: impl FnOnce(&mut Vec<f64>)) -> Result<()> {
        self.contents = next_contents();
        let (points, limit) = (self.points, f64::bits_within(self.limit()));
        let Received::F64(xyz) = self.coordinates.received_mut(0) else {
            return Err(Error::Usage("the set is in single precision".into()));
        };
        write(xyz);
        assert_eq!(xyz.len(), 3 * points, "points of the same curves");
        let checked = largest_within(xyz, limit, 0);
        self.finish_update(checked.map(drop))
    }

    /// Replaces all positions by those that `write` writes, part after part.
    fn write_parts(&mut self, write: impl FnOnce(Writer<'_>) -> Result<(), Bad>) -> Result<()> {
        self.contents = next_contents();
        let (slots, limit) = (self.slots(), self.limit());
        let arrays = self.coordinates.arrays_mut(slots);
        arrays.max_abs = 0.0;
        let parts = Writer {
            arrays,
            curves: &self.curves,
            basis: self.basis,
            limit,
        };
        let written = write(parts);
        self.finish_update(written)
    }

    /// Returns the frame at a fraction of the step to another frame of the same curves,
    /// `x0 + f (x1 - x0)` with every operation rounded to the precision of the coordinates. Fails
    /// if a coordinate overflows.
    pub(crate) fn toward(&self, other: &CurveSet, fraction: f64) -> Result<CurveSet> {
        if let (Some(from), Some(to)) = (&self.sums, &other.sums) {
            return CurveSet::translated_toward([from, to], fraction);
        }
        let ends = [self, other].map(CurveSet::positions);
        let mut set = self.clone();
        match ends.each_ref().map(InOrder::as_positions) {
            [Positions::F32(a), Positions::F32(b)] => {
                let fraction = fraction as f32;
                let at = a.iter().zip(b).map(|(a, b)| a + fraction * (b - a));
                set.update(Positions::F32(&at.collect::<Vec<f32>>()))?;
            }
            [Positions::F64(a), Positions::F64(b)] => {
                let at = a.iter().zip(b).map(|(a, b)| a + fraction * (b - a));
                set.update(Positions::F64(&at.collect::<Vec<f64>>()))?;
            }
            [_, other] => set.check(other)?,
        }
        Ok(set)
    }

    /// Fails if the positions are not those of a frame of the same curves.
    fn check(&self, positions: Positions<'_>) -> Result<()> {
        if positions.precision() != self.precision() {
            return Err(Error::LayoutChanged {
                what: "bytes of a coordinate",
                before: self.precision().bytes() as u64,
                now: positions.precision().bytes() as u64,
            });
        }
        if positions.len() != 3 * self.points {
            return Err(Error::count(
                "coordinates",
                3 * self.points,
                positions.len(),
            ));
        }
        Ok(())
    }

    fn finish_update(&mut self, updated: Result<(), Bad>) -> Result<()> {
        updated.map_err(|(point, axis, value)| {
            self.coordinates.clear(3 * self.points);
            let (curve, point) = self.curve_of_point(point);
            self.bad_value(curve, point, axis, value)
        })
    }

    /// Returns the curve of a point, counted over all curves, and the point in that curve.
    fn curve_of_point(&self, point: usize) -> (usize, usize) {
        let before = |c: &Curve| c.first_point as usize <= point;
        let curve = self.curves.partition_point(before) - 1;
        (curve, point - self.curves[curve].first_point as usize)
    }

    /// Returns the largest allowed magnitude of a coordinate.
    fn limit(&self) -> f64 {
        match self.basis.is_polyline() {
            true => f64::INFINITY,
            false => SPLINE_RANGE,
        }
    }

    /// Returns the error of a coordinate that is not finite, or too large.
    fn bad_value(&self, curve: usize, point: usize, axis: usize, value: f64) -> Error {
        match value.is_finite() {
            true => Error::TooLarge {
                curve,
                found: value.abs(),
                limit: SPLINE_RANGE,
            },
            false => Error::NotFinite {
                curve,
                point,
                axis: ['x', 'y', 'z'][axis],
                value,
            },
        }
    }

    /// Writes control points of curve `i` from its point `start` on. Checks every value once.
    fn write(&mut self, i: usize, start: usize, positions: Positions<'_>) -> Result<()> {
        let c = self.curves[i];
        let at = c.first as usize + self.basis.lead(c.closed) + start;
        let (slots, limit) = (self.slots(), self.limit());
        let arrays = self.coordinates.arrays_mut(slots);
        let written = arrays.write(at, positions, limit);
        written.map_err(|(point, axis, value)| self.bad_value(i, start + point, axis, value))
    }

    /// Updates the copies of points that a closed curve stores at its ends, and the padding.
    fn wrap(&mut self, i: usize) {
        let slots = self.slots();
        let arrays = self.coordinates.arrays_mut(slots);
        arrays.coordinates.finish_curve(&self.curves[i], self.basis);
    }

    /// Returns true if another set has the same curves in the same precision, so that only
    /// positions may differ.
    pub(crate) fn same_layout(&self, other: &CurveSet) -> bool {
        self.shape() == other.shape()
    }

    /// Fails if another set has other curves, or another precision.
    pub(crate) fn check_same_layout(&self, other: &CurveSet) -> Result<()> {
        match self.same_layout(other) {
            true => Ok(()),
            false => self.check_layout(other.basis(), other.precision(), other.counts()),
        }
    }

    /// Fails if curves of this basis, precision and counts are others than those of this set.
    pub(crate) fn check_layout(
        &self,
        basis: Basis,
        precision: Precision,
        counts: impl ExactSizeIterator<Item = i32>,
    ) -> Result<()> {
        let before = self;
        let changed = |what, before, now| Err(Error::LayoutChanged { what, before, now });
        if basis != before.basis() {
            let code = |basis: Basis| u64::from(basis.code());
            return changed("basis code", code(before.basis()), code(basis));
        }
        if counts.len() != before.len() {
            return changed("number of curves", before.len() as u64, counts.len() as u64);
        }
        if let Some((before, now)) = before.counts().zip(counts).find(|(a, b)| a != b) {
            let points = [before, now].map(|count| u64::from(count.unsigned_abs()));
            let closed = [before, now].map(|count| u64::from(count < 0));
            let (what, [before, now]) = match points[0] == points[1] {
                true => ("closed (1) or open (0)", closed),
                false => ("control points of a curve", points),
            };
            return changed(what, before, now);
        }
        let [before, now] = [before.precision(), precision].map(|p| p.bytes() as u64);
        match before == now {
            true => Ok(()),
            false => changed("bytes of a coordinate", before, now),
        }
    }

    /// Returns everything but the positions.
    pub(crate) fn shape(&self) -> Shape {
        Shape {
            basis: self.basis,
            precision: self.precision(),
            curves: Arc::clone(&self.curves),
        }
    }

    /// Returns the basis of all curves.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Returns the type of the coordinates.
    pub fn precision(&self) -> Precision {
        self.coordinates.precision()
    }

    /// Returns the number of curves.
    pub fn len(&self) -> usize {
        self.curves.len()
    }

    /// Returns true if there are no curves.
    pub fn is_empty(&self) -> bool {
        self.curves.is_empty()
    }

    /// Returns the number of control points of all curves.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Returns the number of segments of all curves.
    pub fn segments(&self) -> usize {
        self.segments
    }

    /// Returns the number of open curves.
    pub(crate) fn open_curves(&self) -> usize {
        self.open_curves
    }

    /// Returns curve `i`.
    pub fn curve(&self, i: usize) -> Curve {
        self.curves[i]
    }

    /// Returns all curves in order.
    pub fn curves(&self) -> &[Curve] {
        &self.curves
    }

    /// Returns the number of control points of each curve, negative for closed curves: the layout
    /// on the bus and in recordings.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = i32> + '_ {
        self.curves.iter().map(Curve::count)
    }

    /// Returns the largest magnitude of any coordinate.
    pub fn max_abs(&self) -> f64 {
        self.arrays().max_abs
    }

    /// Returns a number that sets with other positions do not have: copies of a set have the number
    /// of the set, and an update changes the number.
    pub(crate) fn contents(&self) -> u64 {
        self.contents
    }

    #[inline(always)]
    fn arrays(&self) -> &Arrays {
        self.coordinates.get(&self.curves, self.basis)
    }

    /// Returns the coordinates in three arrays.
    #[inline(always)]
    fn coordinates(&self) -> &Coordinates {
        &self.arrays().coordinates
    }

    /// Returns true if the arrays are built.
    #[cfg(test)]
    pub(crate) fn has_arrays(&self) -> bool {
        self.coordinates.built().is_some()
    }

    /// Returns for each curve if one of its points differs from that of an earlier frame of the
    /// same layout.
    #[cfg(feature = "rerun")]
    pub(crate) fn moved_since(&self, before: &CurveSet) -> Vec<bool> {
        fn moved<T: PartialEq>(curves: &[Curve], now: &[T], before: &[T]) -> Vec<bool> {
            let coordinates = |c: &Curve| {
                let first = c.first_point as usize;
                3 * first..3 * (first + c.points as usize)
            };
            let curves = curves.iter().map(coordinates);
            curves.map(|r| now[r.clone()] != before[r]).collect()
        }
        if self.contents == before.contents {
            return vec![false; self.len()];
        }
        let both = [self, before].map(CurveSet::positions);
        match both.each_ref().map(InOrder::as_positions) {
            [Positions::F32(v), Positions::F32(w)] => moved(&self.curves, v, w),
            [Positions::F64(v), Positions::F64(w)] => moved(&self.curves, v, w),
            // Another precision is another layout.
            _ => vec![true; self.len()],
        }
    }

    /// Returns the positions of all control points in the order of the input, as received if
    /// possible.
    pub(crate) fn positions(&self) -> InOrder<'_> {
        match self.coordinates.received() {
            Some(positions) => InOrder::Received(positions),
            None => InOrder::Copied(self.coordinates().in_order(&self.curves, self.basis)),
        }
    }

    /// Returns the first control point of each curve. Builds no arrays.
    pub(crate) fn first_points(&self) -> impl Iterator<Item = Point> + '_ {
        let received = self.coordinates.received();
        self.curves
            .iter()
            .enumerate()
            .map(move |(i, c)| match received {
                Some(positions) => positions.point(c.first_point as usize),
                None => self.point(i, 0),
            })
    }

    /// Returns a copy in double precision.
    pub(crate) fn widened(&self) -> Result<CurveSet> {
        let counts: Vec<i32> = self.counts().collect();
        match self.positions().as_positions() {
            Positions::F64(_) => Ok(self.clone()),
            Positions::F32(v) => {
                let xyz: Vec<f64> = v.iter().map(|&x| x.into()).collect();
                CurveSet::from_counts(self.basis, &counts, Positions::F64(&xyz))
            }
        }
    }

    /// Returns the coordinates of all slots: control points, the copies that wrap closed curves,
    /// and padding.
    pub(crate) fn axes(&self) -> Axes<'_> {
        self.coordinates().axes()
    }

    /// Returns the number of slots of all curves.
    pub(crate) fn slots(&self) -> usize {
        slots_of_all(&self.curves, self.basis)
    }

    /// Returns the slots of the control points of curve `i`, without copies.
    pub(crate) fn body(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        let first = c.first as usize + self.basis.lead(c.closed);
        first..first + c.points as usize
    }

    /// Returns the slot at which segment `s` of curve `i` starts.
    fn slot(&self, i: usize, s: usize) -> usize {
        self.curves[i].first as usize + s * self.basis.stride()
    }

    /// Returns the slots of the control points of a range of segments, copies included.
    pub(crate) fn slots_of(&self, i: usize, segments: Range<usize>) -> Range<usize> {
        let window = self.basis.window();
        self.slot(i, segments.start)..self.slot(i, segments.end - 1) + window
    }

    /// Returns the point in a slot.
    #[inline]
    pub(crate) fn at(&self, slot: usize) -> Point {
        self.coordinates().at(slot)
    }

    /// Returns control point `k` of curve `i`.
    pub fn point(&self, i: usize, k: usize) -> Point {
        let c = self.curves[i];
        assert!(k < c.points as usize, "curve {i} has {} points", c.points);
        self.at(c.first as usize + self.basis.lead(c.closed) + k)
    }

    /// Returns the start of segment `s` of curve `i`. If `s` is the number of segments: the end of
    /// the last one.
    ///
    /// For polylines, Catmull-Rom and Bezier this is an input point. For B-splines it is computed
    /// in double precision.
    pub fn knot(&self, i: usize, s: usize) -> Point {
        debug_assert!(s <= self.curves[i].segments as usize);
        let slot = self.slot(i, s);
        match self.basis {
            Basis::Polyline | Basis::Bezier => self.at(slot),
            Basis::CatmullRom => self.at(slot + 1),
            Basis::BSpline => {
                let (a, b, c) = (self.at(slot), self.at(slot + 1), self.at(slot + 2));
                [0, 1, 2].map(|x| bspline_knot(a[x], b[x], c[x]))
            }
        }
    }

    /// Returns a reader of the Bezier control points of segments.
    #[inline(always)]
    pub(crate) fn hulls(&self) -> Hulls<'_> {
        Hulls {
            set: self,
            coordinates: self.coordinates(),
        }
    }

    /// Returns the Bezier control points of segment `s` of curve `i`: `[axis][k]`.
    #[inline(always)]
    pub(crate) fn hull(&self, i: usize, s: usize) -> [[f64; 4]; 3] {
        self.hulls().at(i, s)
    }

    /// Returns the Bezier form of segment `s` of curve `i`.
    pub(crate) fn segment(&self, i: usize, s: usize) -> Bezier {
        let hull = self.hull(i, s);
        [0, 1, 2, 3].map(|k| [0, 1, 2].map(|x| hull[x][k]))
    }

    /// Returns the point of curve `i` at parameter `t` in `[0, 1]` of its segment `s`.
    pub fn eval(&self, i: usize, s: usize, t: f64) -> Point {
        point_at(&self.segment(i, s), t)
    }

    /// Returns curve `i` as a polyline for display, with `per_segment` points per segment. The
    /// polyline of a closed curve repeats its start at the end.
    pub fn display_polyline(&self, i: usize, per_segment: usize) -> Vec<[f32; 3]> {
        let n = self.curves[i].segments as usize;
        let steps = if self.basis.is_polyline() {
            1
        } else {
            per_segment.max(1)
        };
        let narrow = |p: Point| p.map(|x| x as f32);
        let mut out = Vec::with_capacity(n * steps + 1);
        for s in 0..n {
            out.push(narrow(self.knot(i, s)));
            for k in 1..steps {
                out.push(narrow(self.eval(i, s, k as f64 / steps as f64)));
            }
        }
        out.push(narrow(self.knot(i, n)));
        out
    }

    /// Appends the control points of all curves to `out`, `x y z` curve after curve, in their
    /// precision, as little-endian bytes. Recordings store this form.
    pub fn write_positions(&self, out: &mut Vec<u8>) {
        match self.positions().as_positions() {
            Positions::F32(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
            Positions::F64(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        }
    }

    /// Returns a reader of the knots of curve `i`, in a coordinate frame whose last axis is `w`.
    pub(crate) fn knots(&self, i: usize, w: usize) -> Knots<'_> {
        // Catmull-Rom segments start at the second point of their window.
        let first = self.slot(i, 0) + usize::from(self.basis == Basis::CatmullRom);
        let computed = self.basis == Basis::BSpline;
        let frame = [(w + 1) % 3, (w + 2) % 3, w];
        Knots::new(
            self.coordinates(),
            first,
            self.basis.stride(),
            computed,
            frame,
        )
    }

    /// Returns a set of some of the curves, in this order.
    pub(crate) fn subset(&self, curves: &[u32]) -> CurveSet {
        let indices = curves.iter().map(|&i| i as usize);
        let counts: Vec<i32> = self.counts().collect();
        let counts: Vec<i32> = indices.clone().map(|i| counts[i]).collect();
        let points = indices.flat_map(|i| {
            let points = self.curve(i).points as usize;
            (0..points).flat_map(move |k| self.point(i, k))
        });
        let set = match self.precision() {
            Precision::F32 => {
                let points: Vec<f32> = points.map(|x| x as f32).collect();
                CurveSet::from_counts(self.basis, &counts, Positions::F32(&points))
            }
            Precision::F64 => {
                let points: Vec<f64> = points.collect();
                CurveSet::from_counts(self.basis, &counts, Positions::F64(&points))
            }
        };
        set.expect("curves of a valid set are valid")
    }

    /// Returns the number of vertices of polyline `i` that equal their successor (after the last
    /// vertex of a closed polyline comes its first one).
    pub fn repeated_vertices(&self, i: usize) -> usize {
        if !self.basis.is_polyline() {
            return 0;
        }
        let c = self.curves[i];
        self.coordinates()
            .repeats(c.first as usize, c.segments as usize)
    }

    /// Returns true if curve `i` has at least three distinct control points. A loop with fewer
    /// bounds no area.
    pub fn has_three_distinct_points(&self, i: usize) -> bool {
        let coordinates = self.coordinates();
        // Rounding may have made points equal.
        let sums = || self.sums.as_ref();
        are_three_distinct(self.body(i).map(|slot| coordinates.at(slot)))
            || sums().is_some_and(|sums| sums.has_three_distinct_points(i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Vec<f32> {
        vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]
    }

    #[test]
    fn update_equals_a_fresh_set() {
        let a: Vec<f64> = (0..60).map(|k| f64::from(k).sin()).collect();
        let b: Vec<f64> = (0..60).map(|k| f64::from(k).cos()).collect();
        let counts = [-7, 6, -7];
        let mut set = CurveSet::from_counts(Basis::BSpline, &counts, Positions::F64(&a)).unwrap();
        set.update(Positions::F64(&b)).unwrap();
        let fresh = CurveSet::from_counts(Basis::BSpline, &counts, Positions::F64(&b)).unwrap();
        for (i, c) in fresh.curves().iter().enumerate() {
            for s in 0..=c.segments as usize {
                assert_eq!(set.knot(i, s), fresh.knot(i, s));
            }
        }
        assert_eq!(set.max_abs(), fresh.max_abs());
        assert_eq!(set.counts().collect::<Vec<_>>(), counts);
        let mut bytes = Vec::new();
        set.write_positions(&mut bytes);
        let back: Vec<f64> = bytes
            .chunks_exact(8)
            .map(|c| f64::from_le_bytes(c.try_into().unwrap()))
            .collect();
        assert_eq!(back, b);
    }

    /// Copies all positions, for [`CurveSet::update_by`].
    fn copy(positions: Positions<'_>) -> impl FnOnce(&mut Received, f64) -> Result<(), Bad> {
        move |to, _| {
            to.copy_from(positions);
            Ok(())
        }
    }

    #[test]
    fn a_received_frame_equals_a_fresh_set() {
        let frame = |k: i32| -> Vec<f64> { (0..57).map(|x| f64::from(x * k).sin()).collect() };
        for basis in Basis::ALL {
            let counts = [-9, 4, -6];
            let first = frame(1);
            let mut set = CurveSet::from_counts(basis, &counts, Positions::F64(&first)).unwrap();
            for k in 2..12 {
                let xyz = frame(k);
                let positions = Positions::F64(&xyz);
                let before = set.contents();
                match k % 3 {
                    0 => set.update(positions).unwrap(),
                    _ => set.update_by(positions, copy(positions)).unwrap(),
                }
                assert_ne!(set.contents(), before);
                // The copy has no arrays if the set has none yet.
                let copy = set.clone();
                let fresh = CurveSet::from_counts(basis, &counts, positions).unwrap();
                for set in [&set, &copy] {
                    assert_eq!(set.max_abs(), fresh.max_abs());
                    for (i, c) in fresh.curves().iter().enumerate() {
                        for s in 0..c.segments as usize {
                            assert_eq!(set.segment(i, s), fresh.segment(i, s), "{basis:?} {k}");
                        }
                    }
                    let mut bytes = [Vec::new(), Vec::new()];
                    set.write_positions(&mut bytes[0]);
                    fresh.write_positions(&mut bytes[1]);
                    assert_eq!(bytes[0], bytes[1]);
                }
                assert_eq!(copy.contents(), set.contents());
            }
        }
    }

    #[test]
    fn a_set_takes_over_a_frame_of_other_curves_and_another_precision() {
        let (single, double) = (vec![0.25f32; 36], vec![0.5f64; 60]);
        let mut small =
            CurveSet::from_counts(Basis::Polyline, &[-12], Positions::F32(&single)).unwrap();
        let positions = Positions::F64(&double);
        let mut large = CurveSet::from_counts(Basis::BSpline, &[-20], positions).unwrap();
        large.update_by(positions, copy(positions)).unwrap();
        small.clone_from(&large);
        assert_eq!(small.point(0, 19), [0.5; 3]);
        small.update(Positions::F64(&[0.75; 60])).unwrap();
        assert_eq!(small.point(0, 19), [0.75; 3]);
        small.update_by(positions, copy(positions)).unwrap();
        assert_eq!(small.point(0, 19), [0.5; 3]);
    }

    #[test]
    fn errors_name_the_value_that_is_not_finite() {
        let mut xyz = square();
        xyz[7] = f32::NAN;
        let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
        assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is NaN");
        xyz[7] = f32::INFINITY;
        let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
        assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is inf");
    }

    #[test]
    fn rejects_counts_that_do_not_match_the_positions() {
        for counts in [&[-5][..], &[-3], &[], &[i32::MIN, i32::MIN]] {
            let e = CurveSet::from_counts(Basis::Polyline, counts, Positions::F32(&square()));
            assert!(matches!(e, Err(Error::Count { .. })), "{counts:?}");
        }
        for (basis, counts) in [
            (Basis::BSpline, &[-2, -2][..]),
            (Basis::Bezier, &[-4]),
            (Basis::Polyline, &[-4, 0]),
        ] {
            let e = CurveSet::from_counts(basis, counts, Positions::F32(&square()));
            assert!(
                matches!(e, Err(Error::CurveTooShort { .. })),
                "{basis:?} {counts:?}"
            );
        }
    }

    #[test]
    fn repeated_points_do_not_count_as_distinct() {
        let p = |v: &[[f32; 3]]| {
            let flat: Vec<f32> = v.iter().flatten().copied().collect();
            CurveSet::from_counts(Basis::Polyline, &[-(v.len() as i32)], Positions::F32(&flat))
                .unwrap()
        };
        let (a, b, c) = ([0.; 3], [1., 0., 0.], [0., 1., 0.]);
        assert!(!p(&[a]).has_three_distinct_points(0));
        assert!(!p(&[a, b, a, b]).has_three_distinct_points(0));
        assert!(p(&[a, a, b, b, c]).has_three_distinct_points(0));
        assert_eq!(p(&[a, a, b, b, c, a]).repeated_vertices(0), 3);
    }
}
