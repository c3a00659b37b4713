//! Coordinates of all curves, in three arrays.

use super::basis::bspline_knot;
use super::curve::Curve;
use super::spread;
use super::vector::per_axis;
use super::{Basis, Point, Positions, Precision};
use crate::simd::dispatch;

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
                dispatch!(spread::write_curves(dst, curves, basis, src))
            }
            (Self::F64(dst), Positions::F64(src)) => {
                dispatch!(spread::write_curves(dst, curves, basis, src))
            }
            _ => unreachable!("callers compare the precision first"),
        }
    }

    /// Returns the number of slots in `first..first + count` that hold the same point as the next
    /// slot. Compiled to vector instructions: read point by point, it took a multiple of the time
    /// of all other work on a ribbon.
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

/// A type of coordinates.
pub(crate) trait Scalar: Copy + Into<f64> + Default {
    /// Returns the bit pattern of the largest magnitude.
    fn largest(values: &[Self]) -> u64;
    /// Returns the number with this bit pattern.
    fn from_magnitude(bits: u64) -> f64;
    /// Returns the bit pattern of the largest finite magnitude that is not above `limit`.
    fn bits_within(limit: f64) -> u64;
}

impl Scalar for f32 {
    #[inline(always)]
    fn largest(values: &[Self]) -> u64 {
        let largest = values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m));
        u64::from(largest)
    }

    fn from_magnitude(bits: u64) -> f64 {
        f32::from_bits(bits as u32).into()
    }
    fn bits_within(limit: f64) -> u64 {
        // The limits are powers of two, or beyond single precision.
        u64::from((limit.min(f32::MAX.into()) as f32).to_bits())
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn largest(values: &[Self]) -> u64 {
        values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m))
    }
    fn from_magnitude(bits: u64) -> f64 {
        f64::from_bits(bits)
    }
    fn bits_within(limit: f64) -> u64 {
        limit.min(f64::MAX).to_bits()
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
