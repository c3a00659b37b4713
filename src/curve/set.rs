//! All curves of one frame, as a structure of arrays.

use super::boxes::{BoxGroup, LANES, larger, round_down, round_up, smaller};
use super::{Basis, Bezier, Point, hull_bounds, point_at};
use crate::error::{Error, Result};

/// Type of the coordinates as they came in. They are kept in that type: nothing is rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

impl Precision {
    /// Bytes of one coordinate.
    pub fn bytes(self) -> usize {
        match self {
            Precision::F32 => 4,
            Precision::F64 => 8,
        }
    }
}

/// Control points from outside: `x y z x y z ..`, curve after curve.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl Positions<'_> {
    /// Type of the coordinates.
    pub fn precision(&self) -> Precision {
        match self {
            Positions::F32(_) => Precision::F32,
            Positions::F64(_) => Precision::F64,
        }
    }

    /// Number of coordinates (three a point).
    pub fn len(&self) -> usize {
        match self {
            Positions::F32(v) => v.len(),
            Positions::F64(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One curve of a [`CurveSet`]: its size and where its control points lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// First slot of the coordinate arrays (a wrapped control point where the basis needs one).
    first: u32,
    /// Control points.
    pub points: u32,
    /// Spline segments (for polylines: edges).
    pub segments: u32,
    /// Whether the end is joined to the start.
    pub closed: bool,
}

#[derive(Clone, Debug)]
enum Coordinates {
    F32([Vec<f32>; 3]),
    F64([Vec<f64>; 3]),
}

/// A coordinate type.
trait Scalar: Copy + Into<f64> + Default {
    /// Bits of the largest finite magnitude.
    const MAX_BITS: u64;
    /// Bits of the largest magnitude, and of the smallest other than zero where [`CurveSet::is_extreme`] asks
    /// for it (all bits set where there is none).
    fn magnitudes(values: &[Self]) -> (u64, u64);
    /// The number with these bits; infinite for all bits set.
    fn from_magnitude(bits: u64) -> f64;
}
impl Scalar for f32 {
    const MAX_BITS: u64 = f32::MAX.to_bits() as u64;
    fn magnitudes(values: &[Self]) -> (u64, u64) {
        let max = values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m));
        (u64::from(max), u64::MAX)
    }
    fn from_magnitude(bits: u64) -> f64 {
        u32::try_from(bits).map_or(f64::INFINITY, |bits| f64::from(f32::from_bits(bits)))
    }
}
impl Scalar for f64 {
    const MAX_BITS: u64 = f64::MAX.to_bits();
    fn magnitudes(values: &[Self]) -> (u64, u64) {
        let (max, min) = values.iter().fold((0, u64::MAX), |(max, min), v| {
            let m = v.to_bits() << 1 >> 1;
            // Zero wraps around to the end of the range, where it is no minimum.
            (m.max(max), m.wrapping_sub(1).min(min))
        });
        (max, min.saturating_add(1))
    }
    fn from_magnitude(bits: u64) -> f64 {
        if bits == u64::MAX {
            f64::INFINITY
        } else {
            f64::from_bits(bits)
        }
    }
}

/// All curves of one frame.
///
/// Control points lie in three arrays, one an axis, curve after curve. A closed curve carries copies of its
/// first points after its last one (and of its last before its first where the basis needs it), so that
/// every segment is a window of neighbouring slots and eight segments are read at once.
///
/// Invariant: every coordinate is finite, and every curve has as many points as its basis needs.
#[derive(Clone, Debug)]
pub struct CurveSet {
    basis: Basis,
    curves: Vec<Curve>,
    coordinates: Coordinates,
    points: usize,
    max_abs: f64,
    min_abs: f64,
}

impl CurveSet {
    /// Starts a set. `points` is a hint that saves reallocation; check it against the data that backs it first.
    pub fn builder(basis: Basis, precision: Precision, points: usize) -> CurveSetBuilder {
        let mut coordinates = match precision {
            Precision::F32 => Coordinates::F32(Default::default()),
            Precision::F64 => Coordinates::F64(Default::default()),
        };
        match &mut coordinates {
            Coordinates::F32(v) => v.iter_mut().for_each(|v| v.reserve_exact(points)),
            Coordinates::F64(v) => v.iter_mut().for_each(|v| v.reserve_exact(points)),
        }
        CurveSetBuilder {
            set: CurveSet {
                basis,
                curves: Vec::new(),
                coordinates,
                points: 0,
                max_abs: 0.0,
                min_abs: f64::INFINITY,
            },
            written: 0,
        }
    }

    /// A set from counts and positions in one go. Each count is the number of control points of a curve,
    /// negative where the curve is closed, as in a BCC file.
    pub fn from_counts(basis: Basis, counts: &[i32], positions: Positions<'_>) -> Result<CurveSet> {
        let points: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
        if points.checked_mul(3) != Some(positions.len() as u64) {
            return Err(Error::Count {
                what: "coordinates",
                promised: points.saturating_mul(3),
                available: positions.len() as u64,
            });
        }
        let slots: usize = counts
            .iter()
            .map(|&c| slots(basis, c.unsigned_abs() as usize, c < 0).unwrap_or(0))
            .sum();
        let mut builder = CurveSet::builder(basis, positions.precision(), slots);
        let mut at = 0;
        for &c in counts {
            let n = c.unsigned_abs() as usize;
            builder.start_curve(n, c < 0)?;
            let end = at + 3 * n;
            builder.push(match positions {
                Positions::F32(v) => Positions::F32(&v[at..end]),
                Positions::F64(v) => Positions::F64(&v[at..end]),
            })?;
            at = end;
        }
        builder.finish()
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
        self.min_abs = f64::INFINITY;
        let mut at = 0;
        for i in 0..self.curves.len() {
            let end = at + 3 * self.curves[i].points as usize;
            let part = match positions {
                Positions::F32(v) => Positions::F32(&v[at..end]),
                Positions::F64(v) => Positions::F64(&v[at..end]),
            };
            self.write(i, 0, part)?;
            self.wrap(i);
            at = end;
        }
        Ok(())
    }

    /// Writes control points of curve `i` from its point `start` on, checking every value once.
    fn write(&mut self, i: usize, start: usize, positions: Positions<'_>) -> Result<()> {
        let c = self.curves[i];
        let at = c.first as usize + self.basis.lead(c.closed) + start;
        let (max_abs, min_abs) = match (&mut self.coordinates, positions) {
            (Coordinates::F32(dst), Positions::F32(src)) => scatter(dst, at, src),
            (Coordinates::F64(dst), Positions::F64(src)) => scatter(dst, at, src),
            _ => unreachable!("callers compare the precision first"),
        }
        .map_err(|(point, axis, value)| Error::NotFinite {
            curve: i,
            point: start + point,
            axis: ['x', 'y', 'z'][axis],
            value,
        })?;
        self.max_abs = self.max_abs.max(max_abs);
        self.min_abs = self.min_abs.min(min_abs);
        Ok(())
    }

    /// Copies the points that a closed curve repeats at its ends.
    fn wrap(&mut self, i: usize) {
        let c = self.curves[i];
        if !c.closed {
            return;
        }
        let (first, n) = (c.first as usize, c.points as usize);
        let lead = self.basis.lead(true);
        let used = (c.segments as usize - 1) * self.basis.stride() + self.basis.window();
        let body = first + lead;
        let each = |k: usize| (first + k, body + (k + n - lead) % n);
        for k in (0..lead).chain(lead + n..used) {
            let (to, from) = each(k);
            match &mut self.coordinates {
                Coordinates::F32(v) => v.iter_mut().for_each(|v| v[to] = v[from]),
                Coordinates::F64(v) => v.iter_mut().for_each(|v| v[to] = v[from]),
            }
        }
    }

    /// How control points become curves.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Type of the coordinates.
    pub fn precision(&self) -> Precision {
        match self.coordinates {
            Coordinates::F32(_) => Precision::F32,
            Coordinates::F64(_) => Precision::F64,
        }
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
        self.curves.iter().map(|c| c.segments as usize).sum()
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

    /// Whether exponents are so extreme that floating-point predicates could overflow or underflow; exact
    /// stages then work with big integers.
    ///
    /// Outside of `[2^-190, 2^300]`: a coordinate of at least `2^-190` is a multiple of `2^-242`, a point of
    /// a split spline one of `2^-340` (three rounds of a product with a parameter of at most 31 bits), and
    /// the product of three differences of at least `2^-1020`; at the other end it stays below `2^906`.
    /// Single-precision input never reaches either end.
    pub(crate) fn is_extreme(&self) -> bool {
        const SMALLEST: f64 = f64::from_bits((1023 - 190) << 52);
        const LARGEST: f64 = f64::from_bits((1023 + 300) << 52);
        self.precision() == Precision::F64 && (self.min_abs < SMALLEST || self.max_abs > LARGEST)
    }

    /// Distance by which computed points and boxes of splines may be off, an upper bound: boxes are padded
    /// by it. Zero for polylines, whose vertices are the input.
    ///
    /// With `M` the largest coordinate and `u = 2^-53`: Bezier control points have coordinates of at most
    /// `5/3 M` (B-spline and Bezier: `M`; Catmull-Rom: `4/3 M`) and are within `4 M u`
    /// ([`Basis::bezier`]), sub-segments within `15 * 5/3 M u` of them ([`sub_segment`]): 29 M u together,
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

    /// The slot where segment `s` of curve `i` starts.
    fn slot(&self, i: usize, s: usize) -> usize {
        self.curves[i].first as usize + s * self.basis.stride()
    }

    fn at(&self, slot: usize) -> Point {
        match &self.coordinates {
            Coordinates::F32(v) => [0, 1, 2].map(|x| f64::from(v[x][slot])),
            Coordinates::F64(v) => [0, 1, 2].map(|x| v[x][slot]),
        }
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
                [0, 1, 2].map(|x| (a[x] + 4.0 * b[x] + c[x]) / 6.0)
            }
        }
    }

    /// Bezier form of segment `s` of curve `i`.
    pub(crate) fn segment(&self, i: usize, s: usize) -> Bezier {
        let slot = self.slot(i, s);
        let q = if self.basis.is_polyline() {
            let (p, q) = (self.at(slot), self.at(slot + 1));
            [p, q, p, q]
        } else {
            [0, 1, 2, 3].map(|k| self.at(slot + k))
        };
        self.basis.bezier(&q)
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
        for c in &self.curves {
            let body = c.first as usize + self.basis.lead(c.closed);
            for k in body..body + c.points as usize {
                match &self.coordinates {
                    Coordinates::F32(v) => v.iter().for_each(|v| out.extend(v[k].to_le_bytes())),
                    Coordinates::F64(v) => v.iter().for_each(|v| out.extend(v[k].to_le_bytes())),
                }
            }
        }
    }

    /// Boxes of the segments `8 g .. 8 g + 8` of curve `i`; lanes past its end are empty.
    ///
    /// Each box contains the segment, its chord, and every point that the discretization may compute on it.
    pub(crate) fn leaf_boxes(&self, i: usize, g: usize) -> BoxGroup {
        let mut group = BoxGroup::EMPTY;
        let first = self.slot(i, g * LANES);
        match (&self.coordinates, self.basis) {
            (Coordinates::F32(v), Basis::Polyline) => {
                for (x, v) in v.iter().enumerate() {
                    let p = &v[first..first + LANES + 1];
                    for k in 0..LANES {
                        group.lo[x][k] = smaller(p[k], p[k + 1]);
                        group.hi[x][k] = larger(p[k], p[k + 1]);
                    }
                }
            }
            (Coordinates::F64(v), Basis::Polyline) => {
                for (x, v) in v.iter().enumerate() {
                    let p = &v[first..first + LANES + 1];
                    for k in 0..LANES {
                        group.lo[x][k] = round_down(p[k].min(p[k + 1]));
                        group.hi[x][k] = round_up(p[k].max(p[k + 1]));
                    }
                }
            }
            _ => {
                let pad = self.pad();
                let count = (self.curves[i].segments as usize - g * LANES).min(LANES);
                for k in 0..count {
                    let b = self.segment(i, g * LANES + k);
                    let (lo, hi) = hull_bounds(&b);
                    for x in 0..3 {
                        group.lo[x][k] = round_down(lo[x] - pad);
                        group.hi[x][k] = round_up(hi[x] + pad);
                    }
                }
            }
        }
        let count = self.curves[i].segments as usize - g * LANES;
        if count < LANES {
            group.clear_from(count);
        }
        group
    }

    /// Vertices of polyline `i` that repeat the one before them (its first one, around the end).
    pub fn repeated_vertices(&self, i: usize) -> usize {
        if !self.basis.is_polyline() {
            return 0;
        }
        let c = self.curves[i];
        (0..c.segments as usize)
            .filter(|&s| self.knot(i, s) == self.knot(i, s + 1))
            .count()
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

/// Slots that a curve takes, or `None` where the count does not fit the basis: every window of the last,
/// possibly partial, group of eight segments lies inside.
fn slots(basis: Basis, points: usize, closed: bool) -> Option<usize> {
    let segments = basis.segments(points, closed)?;
    Some((segments.next_multiple_of(LANES) - 1) * basis.stride() + basis.window())
}

/// Points that [`scatter`] takes in one go: they stay in the first-level cache.
const BLOCK: usize = 64;

/// Spreads `x y z x y z ..` over three arrays. Returns the largest magnitude and the smallest one other than
/// zero, or the first value that is not finite (point, axis, value).
///
/// Magnitudes are compared as integers: the bits of a float without its sign grow with its magnitude, and
/// those of infinities and NaN lie above all others. One maximum is both the range and the check.
fn scatter<T: Scalar>(
    dst: &mut [Vec<T>; 3],
    at: usize,
    src: &[T],
) -> Result<(f64, f64), (usize, usize, f64)> {
    let n = src.len() / 3;
    let [x, y, z] = dst;
    let (x, y, z) = (&mut x[at..at + n], &mut y[at..at + n], &mut z[at..at + n]);
    let (mut max, mut min) = (0, u64::MAX);
    let mut block = [T::default(); 3 * BLOCK];
    for (b, src) in src.chunks(3 * BLOCK).enumerate() {
        // Copied first: in shared memory a second read may give another value.
        let block = &mut block[..src.len()];
        block.copy_from_slice(src);
        let (block_max, block_min) = T::magnitudes(block);
        max = max.max(block_max);
        min = min.min(block_min);
        let first = b * BLOCK;
        let len = block.len() / 3;
        let (x, y, z) = (
            &mut x[first..first + len],
            &mut y[first..first + len],
            &mut z[first..first + len],
        );
        for (((p, x), y), z) in block.chunks_exact(3).zip(x).zip(y).zip(z) {
            (*x, *y, *z) = (p[0], p[1], p[2]);
        }
        if block_max > T::MAX_BITS {
            let bad = block
                .iter()
                .position(|&v| !v.into().is_finite())
                .unwrap_or(0);
            return Err((first + bad / 3, bad % 3, block[bad].into()));
        }
    }
    Ok((T::from_magnitude(max), T::from_magnitude(min)))
}

/// Fills a [`CurveSet`] curve by curve, from a stream of any chunk size.
#[derive(Debug)]
pub struct CurveSetBuilder {
    set: CurveSet,
    /// Control points written of the last curve.
    written: usize,
}

impl CurveSetBuilder {
    /// Starts a curve of `points` control points. The curve before it must be complete.
    ///
    /// Allocates for all of its points: compare `points` with the length of the data first.
    pub fn start_curve(&mut self, points: usize, closed: bool) -> Result<()> {
        self.check_complete()?;
        let set = &mut self.set;
        let i = set.curves.len();
        let basis = set.basis;
        let (Some(segments), Some(slots)) =
            (basis.segments(points, closed), slots(basis, points, closed))
        else {
            return Err(Error::CurveTooShort {
                curve: i,
                points,
                kind: basis.describe(closed),
                needed: basis.needs(closed),
            });
        };
        let first = match &mut set.coordinates {
            Coordinates::F32(v) => extend(v, slots),
            Coordinates::F64(v) => extend(v, slots),
        };
        let too_many = |_| Error::Count {
            what: "points of all curves",
            promised: (first + slots) as u64,
            available: u64::from(u32::MAX),
        };
        u32::try_from(first + slots).map_err(too_many)?;
        set.curves.push(Curve {
            first: first as u32,
            points: points as u32,
            segments: segments as u32,
            closed,
        });
        set.points += points;
        self.written = 0;
        Ok(())
    }

    /// Appends control points to the curve started last.
    pub fn push(&mut self, positions: Positions<'_>) -> Result<()> {
        let i = self.set.curves.len().wrapping_sub(1);
        let room = self.set.curves.last().map_or(0, |c| c.points as usize) - self.written;
        let n = positions.len() / 3;
        if n > room || !positions.len().is_multiple_of(3) {
            return Err(Error::Count {
                what: "coordinates of a curve",
                promised: 3 * room as u64,
                available: positions.len() as u64,
            });
        }
        if positions.precision() != self.set.precision() {
            return Err(Error::LayoutChanged {
                what: "bytes of a coordinate",
                before: self.set.precision().bytes() as u64,
                now: positions.precision().bytes() as u64,
            });
        }
        if n == 0 {
            return Ok(());
        }
        self.set.write(i, self.written, positions)?;
        self.written += n;
        if n == room {
            self.set.wrap(i);
        }
        Ok(())
    }

    fn check_complete(&self) -> Result<()> {
        match self.set.curves.last() {
            Some(c) if (c.points as usize) != self.written => Err(Error::Count {
                what: "points of a curve",
                promised: u64::from(c.points),
                available: self.written as u64,
            }),
            _ => Ok(()),
        }
    }

    /// The finished set.
    pub fn finish(self) -> Result<CurveSet> {
        self.check_complete()?;
        Ok(self.set)
    }
}

/// Grows three arrays by `n` slots; returns the first new one.
fn extend<T: Scalar>(v: &mut [Vec<T>; 3], n: usize) -> usize {
    let first = v[0].len();
    for v in v {
        v.resize(first + n, T::default());
    }
    first
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
        assert_eq!(b.lane(4), crate::Box3::EMPTY);
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
