//! All curves of one frame, as a structure of arrays.

use super::basis::{Real, bspline_knot, uniform_bounds};
use super::boxes::{BoxGroup, above, below, larger, smaller};
use super::coordinates::{Axes, Coordinates, Knots};
use super::{Basis, Bezier, Point, Positions, Precision, point_at, pow2};
use crate::error::{Error, Result};
use crate::simd::LANES;
use std::ops::Range;
use std::sync::Arc;

/// Size of one curve of a [`CurveSet`], and the position of its control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// First slot of the curve in the coordinate arrays (a wrapped control point if the basis needs
    /// one).
    pub(super) first: u32,
    /// Number of control points.
    pub points: u32,
    /// Number of spline segments (for polylines: edges).
    pub segments: u32,
    /// True if the end is joined to the start.
    pub closed: bool,
}

impl Curve {
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
/// Control points are stored in three arrays, one per axis, curve after curve. A closed curve
/// stores copies of its first points after its last one (and of its last point before its first one
/// if the basis needs it). So every segment is a window of adjacent slots, and eight segments are
/// read at once.
///
/// Invariant: every coordinate is finite, and every curve has as many points as its basis needs.
#[derive(Debug)]
pub struct CurveSet {
    pub(super) basis: Basis,
    /// Shared by clones, so that clones of one set are recognized as having the same layout at
    /// once.
    pub(super) curves: Arc<Vec<Curve>>,
    pub(super) coordinates: Coordinates,
    pub(super) points: usize,
    /// Counted during construction, so that reading it costs no pass over the curves.
    pub(super) segments: usize,
    pub(super) open_curves: usize,
    /// Largest magnitude of any coordinate.
    max_abs: f64,
}

impl Clone for CurveSet {
    fn clone(&self) -> CurveSet {
        CurveSet {
            curves: self.curves.clone(),
            coordinates: self.coordinates.clone(),
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
            max_abs,
        } = self;
        curves.clone_from(&source.curves);
        coordinates.clone_from(&source.coordinates);
        (*basis, *max_abs) = (source.basis, source.max_abs);
        (*points, *segments, *open_curves) = (source.points, source.segments, source.open_curves);
    }
}

/// Returns the number of slots of a curve: every window of the last, possibly partial, group of
/// eight segments fits.
pub(super) fn slots_of(basis: Basis, segments: usize) -> usize {
    (segments.next_multiple_of(LANES) - 1) * basis.stride() + basis.window()
}

impl CurveSet {
    /// Returns a set without curves.
    pub(super) fn empty(basis: Basis, precision: Precision, slots: usize) -> CurveSet {
        CurveSet {
            basis,
            curves: Arc::default(),
            coordinates: Coordinates::with_capacity(precision, slots),
            points: 0,
            segments: 0,
            open_curves: 0,
            max_abs: 0.0,
        }
    }

    /// Replaces all positions by those of another frame of the same curves. Allocates nothing.
    ///
    /// After an error the set holds a mixture of both frames, and must be updated again before use.
    pub fn update(&mut self, positions: Positions<'_>) -> Result<()> {
        if positions.precision() != self.precision() {
            return Err(Error::LayoutChanged {
                what: "bytes of a coordinate",
                before: self.precision().bytes() as u64,
                now: positions.precision().bytes() as u64,
            });
        }
        if positions.len() != 3 * self.points {
            return Err(Error::Count {
                what: "coordinates",
                promised: 3 * self.points as u64,
                available: positions.len() as u64,
            });
        }
        self.max_abs = 0.0;
        let mut at = 0;
        for i in 0..self.curves.len() {
            let end = at + 3 * self.curves[i].points as usize;
            self.write(i, 0, positions.part(at..end))?;
            self.wrap(i);
            at = end;
        }
        Ok(())
    }

    /// Writes control points of curve `i` from its point `start` on. Checks every value once.
    pub(super) fn write(&mut self, i: usize, start: usize, positions: Positions<'_>) -> Result<()> {
        let c = self.curves[i];
        let at = c.first as usize + self.basis.lead(c.closed) + start;
        let written = self.coordinates.write(at, positions);
        let max_abs = written.map_err(|(point, axis, value)| Error::NotFinite {
            curve: i,
            point: start + point,
            axis: ['x', 'y', 'z'][axis],
            value,
        })?;
        if !self.basis.is_polyline() && max_abs > SPLINE_RANGE {
            return Err(Error::TooLarge {
                curve: i,
                found: max_abs,
                limit: SPLINE_RANGE,
            });
        }
        self.max_abs = self.max_abs.max(max_abs);
        Ok(())
    }

    /// Updates the copies of points that a closed curve stores at its ends, up to its last slot.
    /// The padding of the last group of segments is updated as well.
    pub(super) fn wrap(&mut self, i: usize) {
        let c = self.curves[i];
        if !c.closed {
            return;
        }
        let (first, n) = (c.first as usize, c.points as usize);
        let lead = self.basis.lead(true);
        let slots = slots_of(self.basis, c.segments as usize);
        let body = first + lead;
        let each = |k: usize| (first + k, body + (k + n - lead) % n);
        for k in (0..lead).chain(lead + n..slots) {
            let (to, from) = each(k);
            self.coordinates.copy(from, to);
        }
    }

    /// Returns true if another set has the same curves in the same precision, so that only
    /// positions may differ.
    pub(crate) fn same_layout(&self, other: &CurveSet) -> bool {
        self.basis == other.basis
            && self.precision() == other.precision()
            && (Arc::ptr_eq(&self.curves, &other.curves) || self.curves == other.curves)
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
    pub fn counts(&self) -> impl Iterator<Item = i32> + '_ {
        self.curves.iter().map(|c| {
            let n = c.points as i32;
            if c.closed { -n } else { n }
        })
    }

    /// Returns the largest magnitude of any coordinate.
    pub fn max_abs(&self) -> f64 {
        self.max_abs
    }

    /// Returns an upper bound of the error of computed points and boxes of splines. Boxes are
    /// padded by it. It is 0 for polylines, whose vertices are the input.
    ///
    /// # Derivation: the error is below `32 M u = M 2^-48`
    ///
    /// `M` is the largest coordinate and `u = 2^-53`. Bezier control points have coordinates of at
    /// most `5/3 M` (B-spline and Bezier: `M`; Catmull-Rom: `4/3 M`), with an error of at most
    /// `4 M u` ([`Basis::hull`]). Sub-segments add at most `15 * 5/3 M u` ([`sub_segment`]).
    /// Together that is `29 M u`. The tiny constant covers underflow.
    ///
    /// [`sub_segment`]: super::sub_segment
    pub(crate) fn pad(&self) -> f64 {
        if self.basis.is_polyline() {
            0.0
        } else {
            self.max_abs * pow2(-48) + 1e-300
        }
    }

    /// Returns the padding of boxes of uniform splines that are computed in single precision, or
    /// `None` if this computation could overflow.
    ///
    /// # Derivation: the error is below `8 M u = M 2^-21`
    ///
    /// `M` is the largest coordinate and `u = 2^-24`. In single precision, the operations of
    /// [`Basis::hull`] have an error below `4 M u`, as shown there. The padded bound has a
    /// magnitude of at most `5/3 M + pad`, and rounding it adds `1.7 M u`. Points that the
    /// discretization computes are within `M 2^-48` of the curve (see [`CurveSet::pad`]). The sum
    /// is below `6 M u`; the padding is `8 M u`. The constant covers underflow: each of the few
    /// products has an error of at most `2^-150`.
    fn single_pad(&self) -> Option<f32> {
        const LARGEST: f64 = pow2(120);
        const SHARE: f64 = pow2(-21);
        const TINY: f64 = pow2(-140);
        (self.max_abs <= LARGEST).then_some((self.max_abs * SHARE + TINY) as f32)
    }

    /// Returns the coordinates of all slots: control points, the copies that wrap closed curves,
    /// and padding.
    pub(crate) fn axes(&self) -> Axes<'_> {
        self.coordinates.axes()
    }

    /// Returns the number of slots of all curves.
    pub(crate) fn slots(&self) -> usize {
        self.coordinates.len()
    }

    /// Returns the slots of the control points of curve `i`, without copies.
    pub(crate) fn body(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        let first = c.first as usize + self.basis.lead(c.closed);
        first..first + c.points as usize
    }

    /// Returns the slots of the control points that segment `s` of curve `i` depends on. Copies are
    /// mapped to their originals.
    pub(crate) fn support(&self, i: usize, s: u32) -> impl Iterator<Item = usize> + use<> {
        let c = self.curves[i];
        let body = self.body(i);
        let (n, lead) = (c.points as usize, self.basis.lead(c.closed));
        let at = s as usize * self.basis.stride();
        (at..at + self.basis.window()).map(move |k| {
            let k = k + n - lead;
            // Rarely a division.
            body.start
                + if k < n {
                    k
                } else if k < 2 * n {
                    k - n
                } else {
                    k % n
                }
        })
    }

    /// Calls `segment` with the segments of closed curves, and of open curves if `open` is set,
    /// that depend on a point in one of these slots or on a copy of it.
    pub(crate) fn segments_at(
        &self,
        slots: Range<usize>,
        open: bool,
        mut segment: impl FnMut(u32, u32),
    ) {
        let (stride, window) = (self.basis.stride(), self.basis.window());
        let first = self
            .curves
            .partition_point(|c| (c.first as usize) <= slots.start);
        for i in first.saturating_sub(1)..self.curves.len() {
            let body = self.body(i);
            if body.start >= slots.end {
                break;
            }
            let (c, lead) = (self.curves[i], self.basis.lead(self.curves[i].closed));
            let here = slots.start.max(body.start)..slots.end.min(body.end);
            if !c.closed && !open {
                continue;
            }
            for slot in here {
                // Windows that contain the slot. Windows of closed curves may wrap around the end.
                let (n, at) = (c.segments as usize, slot - body.start + lead);
                let last = at / stride;
                for back in 0..window.div_ceil(stride) {
                    if !c.closed {
                        let before = last.checked_sub(back).filter(|&s| s < n);
                        if let Some(s) = before.filter(|s| at - s * stride < window) {
                            segment(i as u32, s as u32);
                        }
                        continue;
                    }
                    let s = (last + n - back) % n;
                    let start = s * stride;
                    let total = n * stride;
                    let offset = (at + total - start) % total;
                    if offset < window {
                        segment(i as u32, s as u32);
                    }
                }
            }
        }
    }

    /// Returns the slot at which segment `s` of curve `i` starts.
    fn slot(&self, i: usize, s: usize) -> usize {
        self.curves[i].first as usize + s * self.basis.stride()
    }

    /// Returns the point in a slot.
    #[inline]
    pub(crate) fn at(&self, slot: usize) -> Point {
        self.coordinates.at(slot)
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

    /// Returns the Bezier control points of segment `s` of curve `i`: `[axis][k]`.
    #[inline(always)]
    pub(crate) fn hull(&self, i: usize, s: usize) -> [[f64; 4]; 3] {
        let slot = self.slot(i, s);
        let mut hull = [[0.0; 4]; 3];
        for (x, hull) in hull.iter_mut().enumerate() {
            *hull = self.basis.hull(if self.basis.is_polyline() {
                let [p, q] = self.coordinates.window(x, slot);
                [p, q, p, q]
            } else {
                self.coordinates.window(x, slot)
            });
        }
        hull
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
        out.reserve(3 * self.points * self.precision().bytes());
        for c in self.curves.iter() {
            let body = c.first as usize + self.basis.lead(c.closed);
            for k in body..body + c.points as usize {
                self.coordinates.append_bytes(k, out);
            }
        }
    }

    /// Returns the boxes of the segments `8 g .. 8 g + 8` of curve `i`. Lanes past the last segment
    /// are empty.
    ///
    /// Each box contains the segment, its chord, and every point that the discretization may
    /// compute on it.
    #[inline(always)]
    pub(crate) fn leaf_boxes(&self, i: usize, g: usize) -> BoxGroup {
        let count = self.curves[i].segments as usize - g * LANES;
        let first = self.slot(i, g * LANES);
        let mut group = match self.basis {
            Basis::Polyline => match &self.coordinates {
                Coordinates::F32(v) => edge_boxes(v, first, smaller, larger),
                Coordinates::F64(v) => edge_boxes(
                    v,
                    first,
                    |p, q| below(if p < q { p } else { q }),
                    |p, q| above(if p > q { p } else { q }),
                ),
            },
            Basis::CatmullRom | Basis::BSpline => match &self.coordinates {
                Coordinates::F32(v) => match self.single_pad() {
                    Some(pad) => {
                        uniform_boxes(self.basis, v, first, |lo: f32| lo - pad, |hi: f32| hi + pad)
                    }
                    None => self.wide_boxes(v, first),
                },
                Coordinates::F64(v) => self.wide_boxes(v, first),
            },
            Basis::Bezier => self.bezier_boxes(i, g, count.min(LANES)),
        };
        if count < LANES {
            group.clear_from(count);
        }
        group
    }

    /// Returns the boxes of eight segments of a uniform cubic basis, computed in double precision.
    #[inline(always)]
    fn wide_boxes<T: Copy + Into<f64>>(&self, v: &[Vec<T>; 3], first: usize) -> BoxGroup {
        let pad = self.pad();
        uniform_boxes::<T, f64>(
            self.basis,
            v,
            first,
            |lo| below(lo - pad),
            |hi| above(hi + pad),
        )
    }

    fn bezier_boxes(&self, i: usize, g: usize, count: usize) -> BoxGroup {
        let mut group = BoxGroup::EMPTY;
        let pad = self.pad();
        for k in 0..count {
            for (x, points) in self.hull(i, g * LANES + k).iter().enumerate() {
                let lo = points.iter().fold(f64::INFINITY, |m, &p| m.min(p));
                let hi = points.iter().fold(f64::NEG_INFINITY, |m, &p| m.max(p));
                group.lo[x][k] = below(lo - pad);
                group.hi[x][k] = above(hi + pad);
            }
        }
        group
    }

    /// Returns a reader of the knots of curve `i`, in a coordinate frame whose last axis is `w`.
    pub(crate) fn knots(&self, i: usize, w: usize) -> Knots<'_> {
        // Catmull-Rom segments start at the second point of their window.
        let first = self.slot(i, 0) + usize::from(self.basis == Basis::CatmullRom);
        let computed = self.basis == Basis::BSpline;
        let frame = [(w + 1) % 3, (w + 2) % 3, w];
        Knots::new(
            &self.coordinates,
            first,
            self.basis.stride(),
            computed,
            frame,
        )
    }

    /// Returns the number of vertices of polyline `i` that equal their successor (after the last
    /// vertex of a closed polyline comes its first one).
    pub fn repeated_vertices(&self, i: usize) -> usize {
        if !self.basis.is_polyline() {
            return 0;
        }
        let c = self.curves[i];
        self.coordinates
            .repeats(c.first as usize, c.segments as usize)
    }

    /// Returns true if curve `i` has at least three distinct control points. A loop with fewer
    /// bounds no area.
    pub fn has_three_distinct_points(&self, i: usize) -> bool {
        let n = self.curves[i].points as usize;
        let a = self.point(i, 0);
        let mut b = None;
        for k in 1..n {
            let p = self.point(i, k);
            if p == a {
                continue;
            }
            match b {
                None => b = Some(p),
                Some(q) if p != q => return true,
                Some(_) => {}
            }
        }
        false
    }
}

/// Returns the boxes of eight edges of a polyline.
#[inline(always)]
fn edge_boxes<T: Copy>(
    v: &[Vec<T>; 3],
    first: usize,
    lo: impl Fn(T, T) -> f32,
    hi: impl Fn(T, T) -> f32,
) -> BoxGroup {
    let mut group = BoxGroup::EMPTY;
    for (x, v) in v.iter().enumerate() {
        let p = &v[first..first + LANES + 1];
        for k in 0..LANES {
            group.lo[x][k] = lo(p[k], p[k + 1]);
            group.hi[x][k] = hi(p[k], p[k + 1]);
        }
    }
    group
}

/// Returns the boxes of eight segments of a uniform cubic basis, computed in the type `R`.
#[inline(always)]
fn uniform_boxes<T: Copy + Into<R>, R: Real>(
    basis: Basis,
    v: &[Vec<T>; 3],
    first: usize,
    below: impl Fn(R) -> f32,
    above: impl Fn(R) -> f32,
) -> BoxGroup {
    let mut group = BoxGroup::EMPTY;
    for (x, v) in v.iter().enumerate() {
        let window = &v[first..first + LANES + 3];
        let mut q = [R::default(); LANES + 3];
        for (q, &p) in q.iter_mut().zip(window) {
            *q = p.into();
        }
        let [lo, hi] = uniform_bounds(basis, &q);
        for k in 0..LANES {
            group.lo[x][k] = below(lo[k]);
            group.hi[x][k] = above(hi[k]);
        }
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Vec<f32> {
        vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]
    }

    #[test]
    fn the_last_segment_of_a_closed_polyline_ends_at_its_start() {
        let set = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&square())).unwrap();
        assert_eq!(set.knot(0, 4), set.knot(0, 0));
        assert_eq!(set.curve(0).segments, 4);
        let b = set.leaf_boxes(0, 0);
        assert_eq!(b.lane(3).lo, [0.0, 0.0, 0.0]);
        assert_eq!(b.lane(3).hi, [0.0, 1.0, 0.0]);
        assert_eq!(b.lane(4), crate::curve::Box3::EMPTY);
    }

    #[test]
    fn segments_are_connected_and_boxes_contain_the_curve() {
        for basis in Basis::ALL {
            for closed in [true, false] {
                let n = if closed { 21 } else { 22 };
                let xyz: Vec<f32> = (0..3 * n)
                    .map(|k| ((k * k * 37) % 101) as f32 / 7.0)
                    .collect();
                let count = if closed { -n } else { n };
                let set = CurveSet::from_counts(basis, &[count], Positions::F32(&xyz)).unwrap();
                let m = set.curve(0).segments as usize;
                for s in 0..m {
                    let end = set.eval(0, s, 1.0);
                    let next = set.knot(0, s + 1);
                    assert!(
                        (0..3).all(|x| (end[x] - next[x]).abs() < 1e-12),
                        "{basis:?} {s}"
                    );
                    let b = set.leaf_boxes(0, s / 8).lane(s % 8);
                    for k in 0..=10 {
                        let p = set.eval(0, s, f64::from(k) / 10.0);
                        let inside =
                            |x: usize| f64::from(b.lo[x]) <= p[x] && p[x] <= f64::from(b.hi[x]);
                        assert!((0..3).all(inside));
                    }
                }
                if closed {
                    let (a, b) = (set.knot(0, 0), set.knot(0, m));
                    assert_eq!(a, b, "{basis:?}");
                }
            }
        }
    }

    #[test]
    fn finds_the_segments_that_depend_on_a_slot() {
        for basis in Basis::ALL {
            let counts = [-3, -9, 10, -30, 4];
            let xyz = vec![0.5f32; 3 * 56];
            let set = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap();
            for (from, open) in (0..set.slots()).flat_map(|k| [(k, false), (k, true)]) {
                for to in from + 1..set.slots().min(from + 9) {
                    let mut found = Vec::new();
                    set.segments_at(from..to, open, |i, s| found.push((i, s)));
                    found.sort_unstable();
                    found.dedup();
                    let some = (0..set.len()).filter(|&i| open || set.curve(i).closed);
                    let all = some.flat_map(|i| (0..set.curve(i).segments).map(move |s| (i, s)));
                    let want: Vec<(u32, u32)> = all
                        .filter(|&(i, s)| set.support(i, s).any(|k| (from..to).contains(&k)))
                        .map(|(i, s)| (i as u32, s))
                        .collect();
                    assert_eq!(found, want, "{basis:?} {from}..{to}");
                }
            }
        }
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
