//! Coordinates of all curves, in three arrays.

use super::basis::bspline_knot;
use super::lazy::Received;
use super::set::Curve;
use super::tile::{self, Bad};
use super::{Basis, Point, Positions, Precision};
use crate::simd::dispatch;

/// Computes the same of coordinates in either precision.
macro_rules! either {
    ($coordinates:expr, $v:ident => $body:expr) => {
        match $coordinates {
            Coordinates::F32($v) => $body,
            Coordinates::F64($v) => $body,
        }
    };
}

/// Coordinates in three arrays, one per axis, in the precision of the input.
#[derive(Debug)]
pub(super) enum Coordinates {
    F32([Vec<f32>; 3]),
    F64([Vec<f64>; 3]),
}

impl Clone for Coordinates {
    fn clone(&self) -> Coordinates {
        match self {
            Self::F32(v) => Self::F32(v.clone()),
            Self::F64(v) => Self::F64(v.clone()),
        }
    }

    fn clone_from(&mut self, source: &Coordinates) {
        match (self, source) {
            (Self::F32(to), Self::F32(from)) => to.clone_from(from),
            (Self::F64(to), Self::F64(from)) => to.clone_from(from),
            (to, from) => *to = from.clone(),
        }
    }
}

impl Coordinates {
    /// Returns empty arrays with capacity for `slots` points.
    pub fn with_capacity(precision: Precision, slots: usize) -> Self {
        match precision {
            Precision::F32 => Self::F32([0; 3].map(|_| Vec::with_capacity(slots))),
            Precision::F64 => Self::F64([0; 3].map(|_| Vec::with_capacity(slots))),
        }
    }

    pub fn precision(&self) -> Precision {
        match self {
            Self::F32(_) => Precision::F32,
            Self::F64(_) => Precision::F64,
        }
    }

    /// Returns the number of slots.
    pub fn len(&self) -> usize {
        either!(self, v => v[0].len())
    }

    /// Appends slots with points at the origin.
    pub fn grow(&mut self, slots: usize) {
        let len = self.len() + slots;
        either!(self, v => v.iter_mut().for_each(|v| v.resize(len, 0.0)));
    }

    /// Returns the point in a slot.
    #[inline]
    pub fn at(&self, slot: usize) -> Point {
        match self {
            Self::F32(v) => [0, 1, 2].map(|x| f64::from(v[x][slot])),
            Self::F64(v) => [0, 1, 2].map(|x| v[x][slot]),
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

    /// Writes points from slot `at` on. Reads every value once, and checks it: the largest allowed
    /// magnitude is `limit`, or any finite one. `positions` must have the precision of these
    /// coordinates. Returns the largest magnitude.
    pub fn write(&mut self, at: usize, positions: Positions<'_>, limit: f64) -> Result<f64, Bad> {
        match (self, positions) {
            (Self::F32(dst), Positions::F32(src)) => {
                dispatch!(tile::write(dst, at, src, f32::bits_within(limit)))
            }
            (Self::F64(dst), Positions::F64(src)) => {
                dispatch!(tile::write(dst, at, src, f64::bits_within(limit)))
            }
            _ => unreachable!("callers compare the precision first"),
        }
    }

    /// Copies others of the same precision to the first slots.
    pub fn copy_first(&mut self, source: &Coordinates) {
        fn copy<T: Copy>(to: &mut [Vec<T>; 3], from: &[Vec<T>; 3]) {
            for (to, from) in to.iter_mut().zip(from) {
                to[..from.len()].copy_from_slice(from);
            }
        }
        match (self, source) {
            (Self::F32(to), Self::F32(from)) => copy(to, from),
            (Self::F64(to), Self::F64(from)) => copy(to, from),
            _ => unreachable!("callers compare the precision first"),
        }
    }

    /// [`Coordinates::write`] for all points of some curves.
    pub fn write_curves(
        &mut self,
        curves: &[Curve],
        basis: Basis,
        positions: Positions<'_>,
        limit: f64,
    ) -> Result<f64, Bad> {
        match (self, positions) {
            (Self::F32(dst), Positions::F32(src)) => {
                let limit = f32::bits_within(limit);
                dispatch!(tile::write_curves(dst, curves, basis, src, limit))
            }
            (Self::F64(dst), Positions::F64(src)) => {
                let limit = f64::bits_within(limit);
                dispatch!(tile::write_curves(dst, curves, basis, src, limit))
            }
            _ => unreachable!("callers compare the precision first"),
        }
    }

    /// Writes the slots around the points of a curve; see [`tile::finish_curve`].
    pub fn finish_curve(&mut self, curve: &Curve, basis: Basis) {
        either!(self, v => v.iter_mut().for_each(|v| tile::finish_curve(v, curve, basis, false)));
    }

    /// Returns the number of slots in `first..first + count` that hold the same point as the next
    /// slot.
    pub fn repeats(&self, first: usize, count: usize) -> usize {
        fn count_in<T: Scalar + PartialEq>(v: &[Vec<T>; 3], first: usize, count: usize) -> usize {
            let [x, y, z] = v.each_ref().map(|v| &v[first..first + count + 1]);
            let same = |v: &[T], k: usize| v[k] == v[k + 1];
            (0..count)
                .filter(|&k| same(x, k) & same(y, k) & same(z, k))
                .count()
        }
        either!(self, v => count_in(v, first, count))
    }

    /// Returns the points of all curves, `x y z x y z ..` in the order of the input.
    pub fn in_order(&self, curves: &[Curve], basis: Basis) -> Received {
        fn interleaved<T: Copy>(v: &[Vec<T>; 3], curves: &[Curve], basis: Basis) -> Vec<T> {
            let points: usize = curves.iter().map(|c| c.points as usize).sum();
            let mut out = Vec::with_capacity(3 * points);
            for c in curves {
                let first = c.first as usize + basis.lead(c.closed);
                let body = first..first + c.points as usize;
                let [x, y, z] = v.each_ref().map(|v| &v[body.clone()]);
                for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
                    out.extend([x, y, z]);
                }
            }
            out
        }
        match self {
            Self::F32(v) => Received::F32(interleaved(v, curves, basis)),
            Self::F64(v) => Received::F64(interleaved(v, curves, basis)),
        }
    }
}

/// A type of coordinates.
pub(crate) trait Scalar: Copy + Into<f64> + Default {
    /// Bit pattern of the largest finite magnitude.
    const MAX_BITS: u64;
    /// Returns the bit pattern of the largest magnitude.
    fn largest(values: &[Self]) -> u64;
    /// Returns the number with this bit pattern.
    fn from_magnitude(bits: u64) -> f64;
    /// Returns the bit pattern of the largest finite magnitude that is not above `limit`.
    fn bits_within(limit: f64) -> u64;
}
impl Scalar for f32 {
    const MAX_BITS: u64 = f32::MAX.to_bits() as u64;
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
        match limit < f64::from(f32::MAX) {
            true => u64::from((limit as f32).to_bits()),
            false => Self::MAX_BITS,
        }
    }
}
impl Scalar for f64 {
    const MAX_BITS: u64 = f64::MAX.to_bits();
    #[inline(always)]
    fn largest(values: &[Self]) -> u64 {
        values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m))
    }
    fn from_magnitude(bits: u64) -> f64 {
        f64::from_bits(bits)
    }
    fn bits_within(limit: f64) -> u64 {
        limit.to_bits().min(Self::MAX_BITS)
    }
}

/// Coordinates of all slots, one array per axis.
#[derive(Clone, Copy)]
pub(crate) enum Axes<'a> {
    /// Single precision.
    F32([&'a [f32]; 3]),
    /// Double precision.
    F64([&'a [f64]; 3]),
}

impl Coordinates {
    /// Returns the coordinates of all slots.
    pub fn axes(&self) -> Axes<'_> {
        match self {
            Self::F32(v) => Axes::F32(v.each_ref().map(Vec::as_slice)),
            Self::F64(v) => Axes::F64(v.each_ref().map(Vec::as_slice)),
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
    axes: [&'a [T]; 3],
    /// Number of slots from one knot to the next one.
    stride: usize,
}

/// Knots of a uniform B-spline, computed from its control points.
#[derive(Clone, Copy)]
pub(crate) struct Computed<'a, T> {
    axes: [&'a [T]; 3],
}

impl<'a> Knots<'a> {
    pub(super) fn new(
        c: &'a Coordinates,
        first: usize,
        stride: usize,
        computed: bool,
        frame: [usize; 3],
    ) -> Self {
        match c {
            Coordinates::F32(v) => {
                let axes = frame.map(|x| &v[x][first..]);
                if computed {
                    Knots::ComputedF32(Computed { axes })
                } else {
                    Knots::F32(Given { axes, stride })
                }
            }
            Coordinates::F64(v) => {
                let axes = frame.map(|x| &v[x][first..]);
                if computed {
                    Knots::ComputedF64(Computed { axes })
                } else {
                    Knots::F64(Given { axes, stride })
                }
            }
        }
    }
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
