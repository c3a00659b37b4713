//! All curves of one frame, as a structure of arrays.

use super::basis::{Real, bspline_knot, uniform_bounds};
use super::boxes::{BoxGroup, LANES, above, below, larger, smaller};
use super::coordinates::{Axes, Coordinates, Knots};
use super::{Basis, Bezier, Point, Positions, Precision, point_at};
use crate::error::{Error, Result};
use std::ops::Range;
use std::sync::Arc;

/// One curve of a [`CurveSet`]: its size and where its control points lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// First slot of the coordinate arrays (a wrapped control point where the basis needs one).
    pub(super) first: u32,
    /// Control points.
    pub points: u32,
    /// Spline segments (for polylines: edges).
    pub segments: u32,
    /// Whether the end is joined to the start.
    pub closed: bool,
}

impl Curve {
    /// Whether two of its segments are one, or follow one another.
    #[inline]
    pub(crate) fn adjacent(&self, s: u32, t: u32) -> bool {
        let apart = s.abs_diff(t);
        apart <= 1 || (self.closed && apart == self.segments - 1)
    }

    /// The segment after this one; this one, where an open curve ends.
    #[inline]
    pub(crate) fn after(&self, s: u32) -> u32 {
        match (s + 1 < self.segments, self.closed) {
            (true, _) => s + 1,
            (false, true) => 0,
            (false, false) => s,
        }
    }

    /// The segment before this one; this one, where an open curve starts.
    #[inline]
    pub(crate) fn before(&self, s: u32) -> u32 {
        match (s, self.closed) {
            (1.., _) => s - 1,
            (0, true) => self.segments - 1,
            (0, false) => s,
        }
    }
}

/// Largest coordinate of a spline, `2^300`: the products of three differences of its points, which the
/// discretization forms, then stay finite. (Polylines have no limit.)
const SPLINE_RANGE: f64 = f64::from_bits((1023 + 300) << 52);

/// All curves of one frame.
///
/// Control points lie in three arrays, one an axis, curve after curve. A closed curve carries copies of its
/// first points after its last one (and of its last before its first where the basis needs it), so that
/// every segment is a window of neighbouring slots and eight segments are read at once.
///
/// Invariant: every coordinate is finite, and every curve has as many points as its basis needs.
#[derive(Debug)]
pub struct CurveSet {
    pub(super) basis: Basis,
    /// Shared by clones, so that those of one set are told to have the same curves at once.
    pub(super) curves: Arc<Vec<Curve>>,
    pub(super) coordinates: Coordinates,
    pub(super) points: usize,
    /// Counted when the curves came in: to ask for them costs no pass over the curves.
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

    /// Copies into the memory that is there: frame after frame.
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

/// Slots that a curve takes: every window of the last, possibly partial, group of eight segments lies inside.
pub(super) fn slots_of(basis: Basis, segments: usize) -> usize {
    (segments.next_multiple_of(LANES) - 1) * basis.stride() + basis.window()
}

impl CurveSet {
    /// No curves yet.
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
    /// On an error the set holds a mixture of both frames and must be updated again before use.
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

    /// Writes control points of curve `i` from its point `start` on, checking every value once.
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

    /// Copies the points that a closed curve repeats at its ends, up to its last slot: what pads the last group of
    /// segments moves as the curve does.
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

    /// Whether another set has the same curves, in the same precision: only positions may differ.
    pub(crate) fn same_layout(&self, other: &CurveSet) -> bool {
        self.basis == other.basis
            && self.precision() == other.precision()
            && (Arc::ptr_eq(&self.curves, &other.curves) || self.curves == other.curves)
    }

    /// How control points become curves.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Type of the coordinates.
    pub fn precision(&self) -> Precision {
        self.coordinates.precision()
    }

    /// Number of curves.
    pub fn len(&self) -> usize {
        self.curves.len()
    }

    /// Whether there are no curves.
    pub fn is_empty(&self) -> bool {
        self.curves.is_empty()
    }

    /// Control points of all curves together.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Segments of all curves together.
    pub fn segments(&self) -> usize {
        self.segments
    }

    /// Curves that are not closed.
    pub(crate) fn open_curves(&self) -> usize {
        self.open_curves
    }

    /// Curve `i`.
    pub fn curve(&self, i: usize) -> Curve {
        self.curves[i]
    }

    /// All curves in order.
    pub fn curves(&self) -> &[Curve] {
        &self.curves
    }

    /// Control points a curve, negative for closed curves: the layout on the bus and in recordings.
    pub fn counts(&self) -> impl Iterator<Item = i32> + '_ {
        self.curves.iter().map(|c| {
            let n = c.points as i32;
            if c.closed { -n } else { n }
        })
    }

    /// Largest magnitude of any coordinate.
    pub fn max_abs(&self) -> f64 {
        self.max_abs
    }

    /// Distance by which computed points and boxes of splines may be off, an upper bound: boxes are padded
    /// by it. Zero for polylines, whose vertices are the input.
    ///
    /// With `M` the largest coordinate and `u = 2^-53`: Bezier control points have coordinates of at most
    /// `5/3 M` (B-spline and Bezier: `M`; Catmull-Rom: `4/3 M`) and are within `4 M u`
    /// ([`Basis::hull`]), sub-segments within `15 * 5/3 M u` of them ([`sub_segment`]): 29 M u together,
    /// below `32 M u = M 2^-48`. The tiny constant covers underflow.
    ///
    /// [`sub_segment`]: super::sub_segment
    pub(crate) fn pad(&self) -> f64 {
        if self.basis.is_polyline() {
            0.0
        } else {
            self.max_abs * f64::from_bits((1023 - 48) << 52) + 1e-300
        }
    }

    /// What boxes of uniform splines are padded by when they are computed in single precision; none where
    /// that could overflow.
    ///
    /// With `M` the largest coordinate and `u = 2^-24`, the operations of [`Basis::hull`] in single precision
    /// err by less than `4 M u`, as shown there. The padded bound is of magnitude `5/3 M + pad` at most and
    /// rounds by `1.7 M u`; points that the discretization computes are within `M 2^-48` of the curve (see
    /// [`CurveSet::pad`]). That is below `6 M u`; `8 M u = M 2^-21` is taken. The constant covers underflow: each
    /// of the few products is off by `2^-150` at most.
    fn single_pad(&self) -> Option<f32> {
        const LARGEST: f64 = f64::from_bits((1023 + 120) << 52);
        const SHARE: f64 = f64::from_bits((1023 - 21) << 52);
        const TINY: f64 = f64::from_bits((1023 - 140) << 52);
        (self.max_abs <= LARGEST).then_some((self.max_abs * SHARE + TINY) as f32)
    }

    /// The coordinates of all slots: control points, the copies that wrap closed curves, and padding.
    pub(crate) fn axes(&self) -> Axes<'_> {
        self.coordinates.axes()
    }

    /// Slots in all.
    pub(crate) fn slots(&self) -> usize {
        self.coordinates.len()
    }

    /// The slots of the control points of curve `i`, each of them once.
    pub(crate) fn body(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        let first = c.first as usize + self.basis.lead(c.closed);
        first..first + c.points as usize
    }

    /// The slots of the control points that segment `s` of curve `i` depends on, copies mapped to what they are
    /// copies of.
    pub(crate) fn support(&self, i: usize, s: u32) -> impl Iterator<Item = usize> + use<> {
        let c = self.curves[i];
        let body = self.body(i);
        let (n, lead) = (c.points as usize, self.basis.lead(c.closed));
        let at = s as usize * self.basis.stride();
        (at..at + self.basis.window()).map(move |k| {
            let k = k + n - lead;
            // Seldom a division.
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

    /// The segments of closed curves, and of open ones where asked for, that depend on a point in one of these slots, or
    /// on the point that it is a copy of.
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
                // Windows that have the slot in them, around the end where they wrap.
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

    /// The slot where segment `s` of curve `i` starts.
    fn slot(&self, i: usize, s: usize) -> usize {
        self.curves[i].first as usize + s * self.basis.stride()
    }

    /// The point in a slot.
    #[inline]
    pub(crate) fn at(&self, slot: usize) -> Point {
        self.coordinates.at(slot)
    }

    /// Control point `k` of curve `i`.
    pub fn point(&self, i: usize, k: usize) -> Point {
        let c = self.curves[i];
        assert!(k < c.points as usize, "curve {i} has {} points", c.points);
        self.at(c.first as usize + self.basis.lead(c.closed) + k)
    }

    /// Start of segment `s` of curve `i`; for `s` = number of segments, the end of the last.
    ///
    /// The input itself for polylines, Catmull-Rom and Bezier; computed in double precision for B-splines.
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

    /// Bezier control points of segment `s` of curve `i`: `[axis][k]`.
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

    /// Bezier form of segment `s` of curve `i`.
    pub(crate) fn segment(&self, i: usize, s: usize) -> Bezier {
        let hull = self.hull(i, s);
        [0, 1, 2, 3].map(|k| [0, 1, 2].map(|x| hull[x][k]))
    }

    /// Point of curve `i` at parameter `t` in `[0, 1]` of its segment `s`.
    pub fn eval(&self, i: usize, s: usize, t: f64) -> Point {
        point_at(&self.segment(i, s), t)
    }

    /// Curve `i` as a polyline for display, `per_segment` points a segment; a closed one repeats its start.
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

    /// Appends the control points of all curves, `x y z` curve after curve, in their own precision, as
    /// little-endian bytes: what a recording stores.
    pub fn write_positions(&self, out: &mut Vec<u8>) {
        out.reserve(3 * self.points * self.precision().bytes());
        for c in self.curves.iter() {
            let body = c.first as usize + self.basis.lead(c.closed);
            for k in body..body + c.points as usize {
                self.coordinates.append_bytes(k, out);
            }
        }
    }

    /// Boxes of the segments `8 g .. 8 g + 8` of curve `i`; lanes past its end are empty.
    ///
    /// Each box contains the segment, its chord, and every point that the discretization may compute on it.
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

    /// Boxes of eight segments of a uniform cubic basis, computed in double precision.
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

    /// The knots of curve `i`, for reading many, with the axis `w` as the last of the frame.
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

    /// Vertices of polyline `i` that repeat the one before them (its first one, around the end).
    pub fn repeated_vertices(&self, i: usize) -> usize {
        if !self.basis.is_polyline() {
            return 0;
        }
        let c = self.curves[i];
        self.coordinates
            .repeats(c.first as usize, c.segments as usize)
    }

    /// Whether curve `i` has at least three distinct control points: a loop with fewer bounds nothing.
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

/// Boxes of eight edges of a polyline.
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

/// Boxes of eight segments of a uniform cubic basis, computed in the type `R`.
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
    fn a_closed_polyline_wraps() {
        let set = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&square())).unwrap();
        assert_eq!(set.knot(0, 4), set.knot(0, 0));
        assert_eq!(set.curve(0).segments, 4);
        let b = set.leaf_boxes(0, 0);
        assert_eq!(b.lane(3).lo, [0.0, 0.0, 0.0]);
        assert_eq!(b.lane(3).hi, [0.0, 1.0, 0.0]);
        assert_eq!(b.lane(4), crate::curve::Box3::EMPTY);
    }

    #[test]
    fn every_basis_closes_smoothly_and_boxes_contain_the_curve() {
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
    fn segments_at_a_slot_are_those_that_it_supports() {
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
    fn a_value_that_is_not_finite_is_named() {
        let mut xyz = square();
        xyz[7] = f32::NAN;
        let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
        assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is NaN");
        xyz[7] = f32::INFINITY;
        let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
        assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is inf");
    }

    #[test]
    fn counts_that_lie_are_refused() {
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
    fn distinct_points_are_counted_past_repeats() {
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
