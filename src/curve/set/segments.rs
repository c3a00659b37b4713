//! Points and segments of the curves of a set, and the segments that depend on points.

use super::basis::{Bezier, bspline_knot, point_at};
use super::coordinates::{Computed, Coordinates, Given, Knots};
use super::curve::{Curve, count_of};
use super::vector::per_axis;
use super::{Basis, CurveSet, Point, Positions};
use crate::error::Result;
use std::ops::Range;

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

/// Returns true if three or more points differ from one another.
#[inline]
pub(crate) fn are_three_distinct(mut points: impl Iterator<Item = Point>) -> bool {
    let a = points.next();
    let b = points.find(|p| Some(*p) != a);
    points.any(|p| Some(p) != a && Some(p) != b)
}

impl CurveSet {
    /// Returns control point `k` of curve `i`.
    pub fn point(&self, i: usize, k: usize) -> Point {
        let c = &self.curves[i];
        assert!(k < c.points as usize, "curve {i} has {} points", c.points);
        self.positions().point(c.first_point as usize + k)
    }

    /// Returns the control points of curve `i`.
    pub(crate) fn points_in(&self, i: usize) -> impl Iterator<Item = Point> + Clone + '_ {
        let positions = self.positions();
        self.points_of(i).map(move |k| positions.point(k))
    }

    /// Returns the slots of the control points of curve `i`, without copies.
    pub(crate) fn body(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        let first = c.first as usize + self.basis.lead(c.closed);
        first..first + c.points as usize
    }

    /// Returns the slot at which segment `s` of curve `i` starts.
    #[inline]
    pub(super) fn slot(&self, i: usize, s: usize) -> usize {
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

    /// Returns the start of segment `s` of curve `i`. If `s` is the number of segments: the end of
    /// the last one.
    ///
    /// For polylines, Catmull-Rom and Bezier this is an input point. For B-splines it is computed
    /// in double precision.
    #[inline]
    pub fn knot(&self, i: usize, s: usize) -> Point {
        debug_assert!(s <= self.curves[i].segments as usize);
        let slot = self.slot(i, s);
        match self.basis {
            Basis::Polyline | Basis::Bezier => self.at(slot),
            Basis::CatmullRom => self.at(slot + 1),
            Basis::BSpline => {
                let (a, b, c) = (self.at(slot), self.at(slot + 1), self.at(slot + 2));
                per_axis(|x| bspline_knot(a[x], b[x], c[x]))
            }
        }
    }

    /// Returns the ends of two segments, each of a curve.
    #[inline]
    pub(crate) fn edges(&self, curves: [usize; 2], segments: [u32; 2]) -> [[Point; 2]; 2] {
        [0, 1].map(|side| {
            let (i, s) = (curves[side], segments[side] as usize);
            [self.knot(i, s), self.knot(i, s + 1)]
        })
    }

    /// Returns a reader of the knots of curve `i`, in a coordinate frame whose last axis is `w`.
    pub(crate) fn knots(&self, i: usize, w: usize) -> Knots<'_> {
        // Catmull-Rom segments start at the second point of their window.
        let first = self.slot(i, 0) + usize::from(self.basis == Basis::CatmullRom);
        let (computed, stride) = (self.basis == Basis::BSpline, self.basis.stride());
        let frame = [(w + 1) % 3, (w + 2) % 3, w];
        match self.coordinates() {
            Coordinates::F32(v) => match frame.map(|x| &v[x][first..]) {
                axes if computed => Knots::ComputedF32(Computed { axes }),
                axes => Knots::F32(Given { axes, stride }),
            },
            Coordinates::F64(v) => match frame.map(|x| &v[x][first..]) {
                axes if computed => Knots::ComputedF64(Computed { axes }),
                axes => Knots::F64(Given { axes, stride }),
            },
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
        let point = |k: usize| per_axis(|x| hull[x][k]);
        [point(0), point(1), point(2), point(3)]
    }

    /// Returns the point of curve `i` at parameter `t` in `[0, 1]` of its segment `s`.
    pub fn eval(&self, i: usize, s: usize, t: f64) -> Point {
        point_at(&self.segment(i, s), t)
    }

    /// Returns curve `i` as a polyline for display, with `per_segment` points per segment. The
    /// polyline of a closed curve repeats its start at the end.
    pub fn display_polyline(&self, i: usize, per_segment: usize) -> Vec<[f32; 3]> {
        let n = self.curves[i].segments as usize;
        let steps = match self.basis.is_polyline() {
            true => 1,
            false => per_segment.max(1),
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

    /// Returns the control points of uniform splines that equal the next one of their curve: curve
    /// and number. A Catmull-Rom curve turns back at such a point.
    pub fn doubled_points(&self) -> Vec<(u32, u32)> {
        if !matches!(self.basis, Basis::CatmullRom | Basis::BSpline) {
            return Vec::new();
        }
        let doubled = |i: usize| {
            let points = self.curves[i].pairs_of_points();
            let is_doubled = move |&[k, next]: &[usize; 2]| self.point(i, k) == self.point(i, next);
            points
                .filter(is_doubled)
                .map(move |[k, _]| (i as u32, k as u32))
        };
        (0..self.len()).flat_map(doubled).collect()
    }

    /// Returns a copy in which doubled control points count once.
    ///
    /// # Errors
    ///
    /// [`Error::Count`](crate::Error::Count) if too few points of a curve are left.
    pub fn without_doubled_points(&self) -> Result<CurveSet> {
        let mut doubled = self.doubled_points().into_iter().peekable();
        let (mut counts, mut points) = (Vec::new(), Vec::new());
        for (i, curve) in self.curves.iter().enumerate() {
            let before = points.len();
            for k in 0..curve.points {
                if doubled.next_if_eq(&(i as u32, k)).is_none() {
                    points.push(self.point(i, k as usize));
                }
            }
            counts.push(count_of(points.len() - before, curve.closed)?);
        }
        CurveSet::from_counts(self.basis, &counts, Positions::F64(points.as_flattened()))
    }

    /// Returns true if curve `i` has at least three distinct control points. With fewer, a loop
    /// encloses no area.
    pub fn has_three_distinct_points(&self, i: usize) -> bool {
        // Coordinates may be equal because they were rounded. The exact sums decide then.
        let given = || Some(self.sums.as_ref()?.given(i));
        are_three_distinct(self.points_in(i))
            || given().is_some_and(|(set, i)| set.has_three_distinct_points(i))
    }

    /// Returns the slots of the control points that segment `s` of curve `i` depends on. Copies are
    /// mapped to their originals.
    pub(crate) fn support(&self, i: usize, s: u32) -> impl Iterator<Item = usize> + use<> {
        let (c, basis, start) = (self.curves[i], self.basis, self.body(i).start);
        (0..basis.window()).map(move |k| start + c.control_point(basis, s as usize, k))
    }

    /// Returns the numbers of the control points of curve `i`, counted over all curves.
    pub(crate) fn points_of(&self, i: usize) -> Range<usize> {
        let c = &self.curves[i];
        c.first_point as usize..(c.first_point + c.points) as usize
    }

    /// Calls `segment` with the segments of closed curves, and of open curves if `open` is set,
    /// that depend on one of these points, counted over all curves.
    pub(crate) fn segments_at(
        &self,
        points: Range<usize>,
        open: bool,
        mut segment: impl FnMut(u32, u32),
    ) {
        let (stride, window) = (self.basis.stride(), self.basis.window());
        let starts_before = |c: &Curve| c.first_point as usize <= points.start;
        let first = self.curves.partition_point(starts_before);
        for i in first.saturating_sub(1)..self.curves.len() {
            let own = self.points_of(i);
            if own.start >= points.end {
                break;
            }
            let (c, lead) = (self.curves[i], self.basis.lead(self.curves[i].closed));
            let here = points.start.max(own.start)..points.end.min(own.end);
            if !c.closed && !open {
                continue;
            }
            let n = c.segments as usize;
            for at in here.map(|point| point - own.start + lead) {
                // Windows that contain the point. Windows of closed curves may wrap around the end.
                for back in 0..window.div_ceil(stride) {
                    let s = match c.closed {
                        true => Some((at / stride + n - back) % n),
                        false => (at / stride).checked_sub(back).filter(|&s| s < n),
                    };
                    let Some(s) = s else { continue };
                    let offset = match c.closed {
                        true => (at + (n - s) * stride) % (n * stride),
                        false => at - s * stride,
                    };
                    if offset < window {
                        segment(i as u32, s as u32);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    #[test]
    fn finds_the_segments_that_depend_on_a_point() {
        for basis in Basis::ALL {
            let counts = [-3, -9, 10, -30, 4];
            let xyz = vec![0.5f32; 3 * 56];
            let set = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap();
            for (from, open) in (0..set.points()).flat_map(|k| [(k, false), (k, true)]) {
                for to in from + 1..set.points().min(from + 9) {
                    let mut found = Vec::new();
                    set.segments_at(from..to, open, |i, s| found.push((i, s)));
                    found.sort_unstable();
                    found.dedup();
                    let some = (0..set.len()).filter(|&i| open || set.curve(i).closed);
                    let all = some.flat_map(|i| (0..set.curve(i).segments).map(move |s| (i, s)));
                    let want: Vec<(u32, u32)> = all
                        .filter(|&(i, s)| {
                            let first = set.points_of(i).start;
                            let point = |slot: usize| first + slot - set.body(i).start;
                            let mut points = set.support(i, s).map(point);
                            points.any(|k| (from..to).contains(&k))
                        })
                        .map(|(i, s)| (i as u32, s))
                        .collect();
                    assert_eq!(found, want, "{basis:?} {from}..{to}");
                }
            }
        }
    }
}
