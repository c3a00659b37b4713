//! Compressed reference frame, with which every frame is compared first.
//!
//! The cost of a quiet frame is that of reading it and the reference frame. To reduce the latter,
//! points of the reference frame are stored as 16-bit offsets from the centre of their block, with
//! a single allowance per block. A stored point `q'` is near the point `q`, and the distance is
//! subtracted from the allowance `a`: if a point is within `a - |q' - q|` of `q'`, it is within `a`
//! of `q`.
//!
//! A block that fails this test proves nothing. It is tested again with the uncompressed reference
//! frame.

use super::affine::Affine;
use super::blocks::{BLOCK, Real, VALUES};
use super::stream::IMAGES;
use crate::curve::vector::per_axis;
use crate::curve::{Point, Positions, bounds};
use crate::simd::{LANES, Simd};

/// Maximum share of the bound of a block by which the map may deviate from a translation, so that
/// the block is compared by the translation. The deviation is subtracted from the bound. This
/// comparison is cheaper.
const MAX_LOSS: f64 = 0.125;

/// The points of a block in the reference frame: `origin + scale * offset`.
#[derive(Debug)]
#[repr(align(64))]
pub(super) struct Packed {
    origin: Point,
    scale: f32,
    /// Largest distance from the origin of the points with an allowance.
    radius: f32,
    /// Smallest allowance of the points minus their compression errors. Infinite if no point has an
    /// allowance.
    allowance: f32,
    /// Offsets of the points, in the order of the input.
    offsets: [i16; VALUES],
}

impl Packed {
    /// Returns all complete blocks of points. Their largest coordinate is `max_abs`.
    pub fn blocks(points: Positions<'_>, max_abs: f64, allowances: &[f32]) -> Vec<Packed> {
        let blocks = allowances.as_chunks::<BLOCK>().0.iter().enumerate();
        let blocks = blocks.map(|(b, allowances)| {
            let points = std::array::from_fn(|k| points.point(b * BLOCK + k));
            Packed::new(&points, max_abs, allowances)
        });
        blocks.collect()
    }

    /// Returns true if no point has an allowance, because its curve is not covered.
    #[inline(always)]
    pub fn is_free(&self) -> bool {
        self.allowance == f32::INFINITY
    }

    fn new(points: &[Point; BLOCK], max_abs: f64, allowances: &[f32; BLOCK]) -> Packed {
        let [lo, hi] = bounds(points.iter().copied());
        let origin = per_axis(|x| 0.5 * lo[x] + 0.5 * hi[x]);
        let size = (0..3).map(|x| hi[x] - lo[x]).fold(0.0, f64::max);
        // If the scale is 0 or too large for the type, the offsets are too, and the allowance
        // accounts for the error.
        let scale = (size / (2.0 * f64::from(i16::MAX))) as f32;
        let mut offsets = [0; VALUES];
        let (mut radius, mut allowance) = (0.0f64, f64::INFINITY);
        for (k, (p, &a)) in points.iter().zip(allowances).enumerate() {
            let (mut far, mut off) = (0.0, 0.0);
            for x in 0..3 {
                // The cast saturates.
                let offset = ((p[x] - origin[x]) / f64::from(scale)).round() as i16;
                let by = f64::from(scale) * f64::from(offset);
                let d = p[x] - (origin[x] + by);
                offsets[3 * k + x] = offset;
                far += by * by;
                off += d * d;
            }
            if a < f32::INFINITY {
                let rounding = 8.0 * f64::U * max_abs + 1e-150;
                radius = radius.max(far.sqrt());
                let a = f64::from(a).min(f32::LARGEST);
                allowance = allowance.min(a - off.sqrt() * (1.0 + 1e-9) - rounding);
            }
        }
        // If numbers are too large for a bound, no motion is allowed.
        let known = scale.is_finite() && radius < f32::LARGEST && !allowance.is_nan();
        Packed {
            origin,
            scale,
            radius: (radius * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
            allowance: match known {
                true if allowance < 0.0 => -1.0,
                true => (allowance * (1.0 - 1e-6)) as f32,
                false => -1.0,
            },
            offsets,
        }
    }
}

/// Condition of a frame for compressed points: `|p - (M q' + t)| <= sigma a`.
///
/// # Derivation of the error bounds
///
/// Let `o` be the origin of a block and `s k` the offset of a point, with `|s k| <= r`. The
/// condition is evaluated as `(p - o') - M s k`, where `o'` is `M o + t`, rounded to the precision
/// of the coordinates. The result of `p - o'` is in single precision, whose `u` is `2^-24`.
///
/// Only `o'` has an error of the size of the scene, `S = |M| B + |t|`, with `B` the largest
/// coordinate of the reference frame: `u' S` per axis, with `u'` that of the coordinates, and less
/// than `10 * 2^-53 S` from its computation. The vector of three axes has at most twice that
/// length, so `3 u' S + 32 * 2^-53 S` is an upper bound, plus the error of periodic images.
///
/// The other errors are of the size of the block. Let `D = |p - o'|`, and `|M|` the largest
/// absolute row sum. Per axis, the subtraction has an error below `1.1 u D`, the products
/// `2 u |M| r` (`M s` is rounded as well), and their sums `3 u (D + |M| r)`, even if the CPU does
/// not round products before adding them (FMA): `5.2 u (D + |M| r)` in all. If the condition holds,
/// `D` is at most `sigma a + |M| r` plus this error. So the length has an error of at most
/// `11 u sigma a + 22 u |M| r`. `32 u |M| r` is subtracted from the bound, and `64 u` of the bound,
/// which covers the squares too.
///
/// Squares that underflow have an error of `2^-147` in all, which the square of `2^-70` covers.
///
/// If `M` is so near the identity that `|M - I| r` is small, that is subtracted as well, the
/// product with `M` is skipped, and the distances along the axes are compared. If that proves
/// nothing, the condition is evaluated as above.
///
/// Nothing is assumed of `p`. Distances are compared as bit patterns of magnitudes, those of
/// infinities and NaN being larger than all others. So a block that satisfies the condition has
/// finite points, whose coordinates are at most [`PackedCondition::LARGEST`].
#[derive(Clone, Copy, Debug)]
pub(super) struct PackedCondition {
    affine: Affine,
    m: [[f32; 3]; 3],
    sigma: f64,
    error: f64,
    /// Errors that are proportional to the radius of a block.
    share: f64,
    /// Upper bound of `|M - I|`.
    stray: f64,
}

impl PackedCondition {
    /// Upper bound of the coordinates of points that satisfy a condition: `|o'|` is at most `S`,
    /// `|M| r` a few times `S`, and `sigma a` ten times [`Real::LARGEST`], as `S` is.
    pub const LARGEST: f64 = 100.0 * f32::LARGEST;

    /// `reference` is the largest coordinate of the reference frame.
    pub fn new<T: Real>(affine: &Affine, reference: f64) -> PackedCondition {
        let largest = affine.largest_row().max(1.0);
        let size = largest * reference + affine.t.amax();
        let error = match size < f32::LARGEST {
            true => (3.0 * T::U + 32.0 * f64::U + IMAGES) * size + f64::from(f32::TINY),
            // Nothing is proven if single precision may overflow.
            false => f64::INFINITY,
        };
        let stray = (affine.m - nalgebra::Matrix3::identity()).norm();
        PackedCondition {
            affine: *affine,
            m: per_axis(|r| per_axis(|c| affine.m[(r, c)] as f32)),
            sigma: affine.sigma * (1.0 - 64.0 * f32::U),
            error,
            share: 32.0 * f32::U * largest,
            stray: stray * (1.0 + 1e-9),
        }
    }

    /// Returns true if all points of a block, `x y z x y z ..`, are proven to be finite and within
    /// their allowances.
    #[inline(always)]
    pub fn holds<T: Real, S: Simd>(&self, _simd: S, block: &Packed, p: &[T; VALUES]) -> bool {
        if block.is_free() {
            return false;
        }
        let radius = f64::from(block.radius);
        let bound = self.sigma * f64::from(block.allowance) - self.error - self.share * radius;
        if bound <= 0.0 {
            return false;
        }
        let mut origin = [T::default(); 3];
        for (x, origin) in origin.iter_mut().enumerate() {
            let Affine { m, t, .. } = &self.affine;
            let [u, v, w] = block.origin;
            *origin = T::from_f64(m[(x, 0)] * u + m[(x, 1)] * v + m[(x, 2)] * w + t[x]);
        }
        let stray = self.stray * radius;
        if stray < MAX_LOSS * bound {
            // Along each axis, so that no point is further away than the bound.
            let along = (bound - stray) * ((1.0 - 1e-6) / 3f64.sqrt());
            if block.within::<T, S>(along as f32, origin, p) {
                return true;
            }
        }
        let square = block.largest_square::<T, S>(&self.m, origin, p);
        f64::from(square) <= bound * bound
    }
}

/// Number of coordinates that are compared at once: a multiple of the number of axes and of the
/// widest vectors.
const ROW: usize = 6 * LANES;

/// For each axis: 1 in the lanes of a row that hold its coordinates, and 0 in the others.
const LANES_OF_AXIS: [[f32; ROW]; 3] = {
    let mut lanes = [[0.0; ROW]; 3];
    let mut l = 0;
    while l < ROW {
        lanes[l % 3][l] = 1.0;
        l += 1;
    }
    lanes
};

impl Packed {
    /// Returns true if no point is further than a distance from its expected position along any
    /// axis, with the affine map replaced by a translation.
    #[inline(always)]
    fn within<T: Real, S: Simd>(&self, distance: f32, origin: [T; 3], p: &[T; VALUES]) -> bool {
        // Exact sums, which are compiled to vector instructions, unlike a gather.
        let mut row = [T::default(); ROW];
        for (lanes, &origin) in LANES_OF_AXIS.iter().zip(&origin) {
            for (row, &lane) in row.iter_mut().zip(lanes) {
                *row = *row + T::from(lane) * origin;
            }
        }
        // Integers need no masked stores.
        let mut largest = [0; ROW];
        let offsets = self.offsets.as_chunks::<ROW>().0;
        for (p, q) in p.as_chunks::<ROW>().0.iter().zip(offsets) {
            for l in 0..ROW {
                let d = (p[l] - row[l]).narrowed();
                let d = add_product::<S>(d, -self.scale, f32::from(q[l])).abs();
                largest[l] = d.to_bits().max(largest[l]);
            }
        }
        largest.iter().fold(0, |m, &d| d.max(m)) <= distance.to_bits()
    }

    /// Returns the largest squared distance of points from their expected positions.
    #[inline(always)]
    fn largest_square<T: Real, S: Simd>(
        &self,
        m: &[[f32; 3]; 3],
        origin: [T; 3],
        p: &[T; VALUES],
    ) -> f32 {
        let mut m = *m;
        for m in m.as_flattened_mut() {
            *m *= self.scale;
        }
        let (p, offsets) = (axes(p, |x| x), axes(&self.offsets, f32::from));
        let mut largest = [0; LANES];
        for k in (0..BLOCK).step_by(LANES) {
            for l in 0..LANES {
                let mut square = 0.0;
                for x in 0..3 {
                    let mut d = (p[x][k + l] - origin[x]).narrowed();
                    for y in 0..3 {
                        d = add_product::<S>(d, -m[x][y], offsets[y][k + l]);
                    }
                    square = add_product::<S>(square, d, d);
                }
                largest[l] = square.abs().to_bits().max(largest[l]);
            }
        }
        f32::from_bits(largest.into_iter().fold(0, u32::max))
    }
}

/// Returns the values of a block, one array per axis.
#[inline(always)]
fn axes<A: Copy, B: Copy + Default>(values: &[A; VALUES], of: impl Fn(A) -> B) -> [[B; BLOCK]; 3] {
    let mut axes = [[B::default(); BLOCK]; 3];
    for k in 0..BLOCK {
        for x in 0..3 {
            axes[x][k] = of(values[3 * k + x]);
        }
    }
    axes
}

/// Returns `a + b c`, in a single instruction if the CPU has FMA.
#[inline(always)]
fn add_product<S: Simd>(a: f32, b: f32, c: f32) -> f32 {
    if S::FMA { b.mul_add(c, a) } else { a + b * c }
}
