//! Coordinates of all curves, in three arrays, which are built when they are needed.
//!
//! A frame in which nothing moved far needs no arrays. Its positions are only compared.

use super::basis::{Real, bspline_knot};
use super::curve::{Curve, slots_of, slots_of_all};
use super::received::Received;
use super::vector::per_axis;
use super::{Basis, Point, Positions, Precision};
use crate::simd::dispatch;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Coordinates in three arrays, one per axis, in the precision of the input.
#[derive(Debug)]
pub(crate) enum Coordinates {
    F32([Vec<f32>; 3]),
    F64([Vec<f64>; 3]),
}

impl Coordinates {
    /// Returns arrays of points at the origin.
    pub fn new(precision: Precision, slots: usize) -> Self {
        match precision {
            Precision::F32 => Self::F32([0; 3].map(|_| vec![0.0; slots])),
            Precision::F64 => Self::F64([0; 3].map(|_| vec![0.0; slots])),
        }
    }

    /// Returns the point in a slot.
    #[inline]
    pub fn at(&self, slot: usize) -> Point {
        match self {
            Self::F32(v) => per_axis(|x| f64::from(v[x][slot])),
            Self::F64(v) => per_axis(|x| v[x][slot]),
        }
    }

    /// Returns coordinate `x` of the points in `N` slots from `slot` on.
    #[inline(always)]
    pub fn window<const N: usize>(&self, x: usize, slot: usize) -> [f64; N] {
        let mut out = [0.0; N];
        match self {
            Self::F32(v) => {
                for (out, &p) in out.iter_mut().zip(&v[x][slot..slot + N]) {
                    *out = p.into();
                }
            }
            Self::F64(v) => out.copy_from_slice(&v[x][slot..slot + N]),
        }
        out
    }

    /// Writes all points of some curves, in the same precision. Returns the largest magnitude.
    pub fn write_curves(
        &mut self,
        curves: &[Curve],
        basis: Basis,
        positions: Positions<'_>,
    ) -> f64 {
        match (self, positions) {
            (Self::F32(dst), Positions::F32(src)) => {
                dispatch!(write_curves(dst, curves, basis, src))
            }
            (Self::F64(dst), Positions::F64(src)) => {
                dispatch!(write_curves(dst, curves, basis, src))
            }
            _ => unreachable!("callers compare the precision first"),
        }
    }

    /// Returns the number of slots in `first..first + count` that hold the same point as the next
    /// slot. Compares the arrays, so that the loop is vectorized: reading point by point took
    /// several times as long as all other work on a ribbon.
    pub fn repeats(&self, first: usize, count: usize) -> usize {
        fn count_in<T: PartialEq>(v: &[Vec<T>; 3], first: usize, count: usize) -> usize {
            let [x, y, z] = per_axis(|x| &v[x][first..first + count + 1]);
            let same = |v: &[T], k: usize| v[k] == v[k + 1];
            (0..count)
                .filter(|&k| same(x, k) & same(y, k) & same(z, k))
                .count()
        }
        match self {
            Self::F32(v) => count_in(v, first, count),
            Self::F64(v) => count_in(v, first, count),
        }
    }
}

/// Knots of one curve in a coordinate frame `(u, v, w)`. The type and the stride are matched once,
/// before many knots are read.
#[derive(Clone, Copy)]
pub(crate) enum Knots<'a> {
    /// Single precision input.
    F32(Given<'a, f32>),
    /// Double precision input.
    F64(Given<'a, f64>),
    /// B-spline knots from single precision input.
    ComputedF32(Computed<'a, f32>),
    /// B-spline knots from double precision input.
    ComputedF64(Computed<'a, f64>),
}

/// Knots that are control points of the input.
#[derive(Clone, Copy)]
pub(crate) struct Given<'a, T> {
    pub(super) axes: [&'a [T]; 3],
    /// Number of slots from one knot to the next one.
    pub(super) stride: usize,
}

/// Knots of a uniform B-spline, computed from its control points.
#[derive(Clone, Copy)]
pub(crate) struct Computed<'a, T> {
    pub(super) axes: [&'a [T]; 3],
}

/// A source of knots.
pub(crate) trait ReadKnots {
    /// Precision of the knots.
    type Number: Copy + Into<f64> + From<u8>;

    /// Returns coordinate `x` (in the coordinate frame) of knot `s` and of the next knot.
    fn edge(&self, s: u32, x: usize) -> [Self::Number; 2];
}

impl<T: Copy + Into<f64> + From<u8>> ReadKnots for Given<'_, T> {
    type Number = T;

    #[inline(always)]
    fn edge(&self, s: u32, x: usize) -> [T; 2] {
        let at = s as usize * self.stride;
        let ends = &self.axes[x][at..=at + self.stride];
        [ends[0], ends[self.stride]]
    }
}

impl<T: Copy + Into<f64>> ReadKnots for Computed<'_, T> {
    type Number = f64;

    #[inline(always)]
    fn edge(&self, s: u32, x: usize) -> [f64; 2] {
        let q = &self.axes[x][s as usize..s as usize + 4];
        let q: [f64; 4] = [q[0].into(), q[1].into(), q[2].into(), q[3].into()];
        [
            bspline_knot(q[0], q[1], q[2]),
            bspline_knot(q[1], q[2], q[3]),
        ]
    }
}

/// Spreads positions, `x y z x y z ..`, over three arrays, with the slots around the points of each
/// curve ([`finish_curve`]). Returns the largest magnitude.
#[inline(always)]
fn write_curves<T: Real>(dst: &mut [Vec<T>; 3], curves: &[Curve], basis: Basis, src: &[T]) -> f64 {
    let (mut rest, mut largest) = (src, 0);
    for c in curves {
        let (own, after) = rest.split_at(3 * c.points as usize);
        rest = after;
        largest = largest.max(T::largest(own));
        let body = c.first as usize + basis.lead(c.closed);
        for (x, dst) in dst.iter_mut().enumerate() {
            let points = own.as_chunks::<3>().0.iter();
            for (to, p) in dst[body..].iter_mut().zip(points) {
                *to = p[x];
            }
            finish_curve(dst, c, basis);
        }
    }
    T::from_magnitude(largest)
}

/// Writes the slots around the points of a curve, one axis: the copies of points that a closed
/// curve stores at its ends, including the padding of its last row. The padding of an open curve is
/// 0.
#[inline(always)]
fn finish_curve<T: Real>(dst: &mut [T], c: &Curve, basis: Basis) {
    let (first, n) = (c.first as usize, c.points as usize);
    let body = first + basis.lead(c.closed);
    let (end, slots) = (body + n, slots_of(basis, c.segments as usize));
    if !c.closed {
        return dst[end..first + slots].fill(T::default());
    }
    for k in first..body {
        dst[k] = dst[k + n];
    }
    for k in end..first + slots {
        dst[k] = dst[k - n];
    }
}

/// Three arrays, and the largest magnitude of their coordinates.
#[derive(Debug)]
pub(super) struct Arrays {
    pub coordinates: Coordinates,
    pub max_abs: f64,
}

/// The arrays of a set, if they are built.
#[derive(Debug, Default)]
pub(super) struct LazyArrays {
    arrays: OnceLock<Arrays>,
    /// Memory for the arrays. The layout of a set does not change once it has arrays.
    spare: Mutex<Option<Coordinates>>,
}

impl Clone for LazyArrays {
    /// Returns no arrays: a copy of a set builds its own.
    fn clone(&self) -> LazyArrays {
        LazyArrays::default()
    }
}

impl LazyArrays {
    /// Returns the arrays of these curves.
    #[inline(always)]
    pub fn get(&self, curves: &[Curve], basis: Basis, received: &Received) -> &Arrays {
        match self.arrays.get() {
            Some(arrays) => arrays,
            None => self.build(curves, basis, received),
        }
    }

    #[cold]
    #[inline(never)]
    fn build(&self, curves: &[Curve], basis: Basis, received: &Received) -> &Arrays {
        self.arrays.get_or_init(|| {
            let (slots, positions) = (slots_of_all(curves, basis), received.positions());
            let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
            let new = || Coordinates::new(positions.precision(), slots);
            let mut coordinates = spare.take().unwrap_or_else(new);
            let max_abs = coordinates.write_curves(curves, basis, positions);
            Arrays {
                coordinates,
                max_abs,
            }
        })
    }

    /// Forgets the arrays, because the positions change. Keeps their memory.
    pub fn outdate(&mut self) {
        if let Some(arrays) = self.arrays.take() {
            self.spare = Some(arrays.coordinates).into();
        }
    }

    /// Returns true if the arrays are built.
    #[cfg(test)]
    pub fn are_built(&self) -> bool {
        self.arrays.get().is_some()
    }
}

#[cfg(test)]
mod tests {
    use crate::curve::{Basis, CurveSet, Positions, Precision};
    use crate::error::Error;
    use crate::random::Random;

    /// Curves of few and of many points.
    fn counts(random: &mut Random, basis: Basis) -> Vec<i32> {
        let most = random.pick(&[4, 20, 700]);
        let counts = (0..60).map(|_| {
            let closed = random.one_in(2);
            let points = 1 + random.below(most);
            let allowed = (points..).find(|&n| basis.segments(n, closed).is_some());
            let points = allowed.expect("a larger number is allowed") as i32;
            if closed { -points } else { points }
        });
        counts.collect()
    }

    /// Returns the expected coordinates of all slots of an axis, by the description of
    /// [`CurveSet`].
    fn slots(set: &CurveSet, basis: Basis, xyz: &[f64], axis: usize) -> Vec<f64> {
        let (mut out, mut at) = (vec![0.0; set.slots()], 0);
        for c in set.curves() {
            let n = c.points as usize;
            let lead = basis.lead(c.closed);
            let groups = (c.segments as usize).div_ceil(8);
            let slots = (8 * groups - 1) * basis.stride() + basis.window();
            for k in 0..slots {
                let point = match c.closed {
                    true => (k + n - lead) % n,
                    false if k < n => k,
                    false => continue,
                };
                out[c.first as usize + k] = xyz[3 * (at + point) + axis];
            }
            at += n;
        }
        out
    }

    fn set_of(basis: Basis, counts: &[i32], xyz: &[f64], precision: Precision) -> CurveSet {
        let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
        let positions = match precision {
            Precision::F32 => Positions::F32(&narrow),
            Precision::F64 => Positions::F64(xyz),
        };
        CurveSet::from_counts(basis, counts, positions).unwrap()
    }

    fn axis(set: &CurveSet, x: usize) -> Vec<f64> {
        (0..set.slots()).map(|slot| set.at(slot)[x]).collect()
    }

    #[test]
    fn every_slot_has_its_point_after_construction_and_after_an_update() {
        for seed in 0..40 {
            let mut random = Random::new(seed);
            for basis in Basis::ALL {
                let counts = counts(&mut random, basis);
                let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
                // Multiples of 2^-10, which are exact in single precision.
                let mut frame = || -> Vec<f64> {
                    let mut value = || f64::from(random.below(1 << 20)) / 1024.0 - 512.0;
                    (0..3 * points).map(|_| value()).collect()
                };
                let [first, second] = [frame(), frame()];
                for precision in [Precision::F32, Precision::F64] {
                    let mut set = set_of(basis, &counts, &first, precision);
                    for x in 0..3 {
                        let expected = slots(&set, basis, &first, x);
                        assert_eq!(axis(&set, x), expected, "{seed}, {basis:?}, new");
                    }
                    let narrow: Vec<f32> = second.iter().map(|&x| x as f32).collect();
                    set.update(match precision {
                        Precision::F32 => Positions::F32(&narrow),
                        Precision::F64 => Positions::F64(&second),
                    })
                    .unwrap();
                    for x in 0..3 {
                        let expected = slots(&set, basis, &second, x);
                        assert_eq!(axis(&set, x), expected, "{seed}, {basis:?}, updated");
                    }
                    let largest = second.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                    assert_eq!(set.max_abs(), largest);
                }
            }
        }
    }

    #[test]
    fn an_update_names_the_curve_and_the_point_of_a_bad_value() {
        let mut random = Random::new(1);
        for basis in Basis::ALL {
            let counts = counts(&mut random, basis);
            let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
            let good = vec![0.5; 3 * points];
            let mut set = set_of(basis, &counts, &good, Precision::F64);
            for _ in 0..200 {
                let at = random.below(3 * points);
                let mut before = 0;
                let curve = counts.iter().position(|c| {
                    before += c.unsigned_abs() as usize;
                    at / 3 < before
                });
                let curve = curve.unwrap();
                let point = at / 3 + counts[curve].unsigned_abs() as usize - before;
                let mut bad = good.clone();
                for value in [f64::NAN, f64::NEG_INFINITY] {
                    bad[at] = value;
                    let found = set.update(Positions::F64(&bad)).unwrap_err().to_string();
                    let axis = ["x", "y", "z"][at % 3];
                    let named = format!("curve {curve}, point {point}: coordinate {axis} is");
                    assert!(found.starts_with(&named), "{found}, expected {named}");
                }
                bad[at] = -1e300;
                match set.update(Positions::F64(&bad)) {
                    Ok(()) => assert!(basis.is_polyline()),
                    Err(Error::TooLarge { curve: c, .. }) => assert_eq!(c, curve),
                    Err(e) => panic!("{e}"),
                }
            }
            set.update(Positions::F64(&good)).unwrap();
            assert_eq!(set.max_abs(), 0.5);
        }
    }
}
