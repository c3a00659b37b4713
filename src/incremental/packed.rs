//! The reference frame once more, small: what is compared with every frame.
//!
//! A quiet frame costs what it takes to read it and the reference frame. So that the latter is less, its points are kept
//! as offsets of 16 bits from the middle of their block, and one allowance for the whole block. That is `q'` near the
//! point `q`, and what the rounding of offsets moved it is taken off its allowance `a`: where a point is within
//! `a - |q' - q|` of `q'`, it is within `a` of `q`.
//!
//! A block where this fails proves nothing: it is looked at again, with the reference frame as it was.

use super::affine::Affine;
use super::stream::Real;
use crate::curve::{CurveSet, LANES, Point};

/// Slots that are compared together.
pub(super) const BLOCK: usize = 64;

/// Half a unit in the last place of 1, in single and in double precision.
const U: f64 = f32::EPSILON as f64 / 2.0;
const U_DOUBLE: f64 = f64::EPSILON / 2.0;

/// Of its allowance, the share of a block that may be given away to compare with less effort.
const GIVEN_AWAY: f64 = 0.125;

/// The points of a block of slots in the reference frame: `origin + scale * offset`.
#[derive(Debug)]
#[repr(align(64))]
pub(super) struct Packed {
    origin: Point,
    scale: f32,
    /// Largest distance from the origin, of points with an allowance.
    radius: f32,
    /// The least that any of them may move, less what it is off. Infinite where all may move as they like.
    allowance: f32,
    offsets: [[i16; BLOCK]; 3],
}

impl Packed {
    /// All whole blocks of a set.
    pub fn blocks(set: &CurveSet, allowances: &[f32]) -> Vec<Packed> {
        let blocks = allowances.as_chunks::<BLOCK>().0.iter().enumerate();
        blocks
            .map(|(b, allowances)| Packed::new(set, b * BLOCK, allowances))
            .collect()
    }

    fn new(set: &CurveSet, first: usize, allowances: &[f32; BLOCK]) -> Packed {
        let points = || (first..first + BLOCK).map(|slot| set.at(slot));
        let (mut lo, mut hi) = (set.at(first), set.at(first));
        for p in points() {
            for x in 0..3 {
                (lo[x], hi[x]) = (lo[x].min(p[x]), hi[x].max(p[x]));
            }
        }
        let origin = [0, 1, 2].map(|x| 0.5 * lo[x] + 0.5 * hi[x]);
        let size = (0..3).map(|x| hi[x] - lo[x]).fold(0.0, f64::max);
        // Where it is 0 or too large for the type, so are the offsets, and the allowance tells what that costs.
        let scale = (size / (2.0 * f64::from(i16::MAX))) as f32;
        let mut offsets = [[0; BLOCK]; 3];
        let (mut radius, mut allowance) = (0.0f64, f64::INFINITY);
        for (k, (p, &a)) in points().zip(allowances).enumerate() {
            let (mut far, mut off) = (0.0, 0.0);
            for x in 0..3 {
                // Saturates.
                let offset = ((p[x] - origin[x]) / f64::from(scale)).round() as i16;
                let by = f64::from(scale) * f64::from(offset);
                let d = p[x] - (origin[x] + by);
                offsets[x][k] = offset;
                far += by * by;
                off += d * d;
            }
            if a < f32::INFINITY {
                let rounding = 8.0 * U_DOUBLE * set.max_abs() + 1e-150;
                radius = radius.max(far.sqrt());
                allowance = allowance.min(f64::from(a) - off.sqrt() * (1.0 + 1e-9) - rounding);
            }
        }
        // What cannot be told, with numbers that are too large, may not move at all.
        let known = scale.is_finite() && radius < 1e18 && !allowance.is_nan();
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

/// The condition of a frame for packed points: `|p - (M q' + t)| <= sigma a`.
///
/// With `o` the origin of a block and `s k` the offset of a point, `|s k| <= r`, it is evaluated as `(p - o') - M s k`,
/// where `o'` is `M o + t`, rounded to the precision of the coordinates; what is left after `p - o'` is in single
/// precision, whose `u` is `2^-24`. Nothing but `o'` errs by the size of the scene, `S = |M| B + |t| + A` with `A` and `B`
/// the largest coordinates of both frames: by `u' S` an axis, with `u'` that of the coordinates, and by less than
/// `10 * 2^-53 S` where it is computed. The lengths of three are at most twice as large: `3 u' S + 32 * 2^-53 S` is more.
///
/// The rest is of the size of the block. With `D = |p - o'|` and `|M|` the largest sum of a row, the subtraction errs by
/// less than `1.1 u D` an axis, the products by `2 u |M| r` (`M s` is rounded as well) and their sums by
/// `3 u (D + |M| r)`, whether or not the processor rounds products before it adds them: `5.2 u (D + |M| r)` in all. Where
/// the condition was found to hold, `D` is no more than `sigma a + |M| r` and this error. That makes
/// `11 u sigma a + 22 u |M| r` for the length. `32 u |M| r` is taken off the bound, and `64 u` of it, which covers the
/// squares too.
///
/// Squares that underflow are off by `2^-147` in all, which the square of `2^-70` covers.
///
/// Where `M` is so near the identity that `|M - I| r` is little, it is taken off as well, and `M` is left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quick {
    affine: Affine,
    m: [[f32; 3]; 3],
    sigma: f64,
    error: f64,
    /// Errors in proportion to the radius of a block.
    share: f64,
    /// A bound on `|M - I|`.
    stray: f64,
}

impl Quick {
    pub fn new<T: Real>(affine: &Affine, reference: &CurveSet, now: &CurveSet) -> Quick {
        let largest = affine.largest_row().max(1.0);
        let size = largest * reference.max_abs() + affine.t.amax() + now.max_abs();
        let error = (3.0 * T::U + 32.0 * U_DOUBLE) * size + f64::from(f32::TINY);
        let stray = (affine.m - nalgebra::Matrix3::identity()).norm();
        Quick {
            affine: *affine,
            m: [0, 1, 2].map(|r| [0, 1, 2].map(|c| affine.m[(r, c)] as f32)),
            sigma: affine.sigma * (1.0 - 64.0 * U),
            // Nothing holds where single precision may overflow.
            error: if size < f32::LARGEST {
                error
            } else {
                f64::INFINITY
            },
            share: 32.0 * U * largest,
            stray: stray * (1.0 + 1e-9),
        }
    }

    /// Whether all points of a block are proven to be within their allowances.
    #[inline(always)]
    pub fn holds<T: Real, const FMA: bool>(&self, block: &Packed, p: [&[T; BLOCK]; 3]) -> bool {
        if block.allowance == f32::INFINITY {
            return true;
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
        if stray < GIVEN_AWAY * bound {
            let square = block.largest_square::<T, FMA, true>(&self.m, origin, p);
            f64::from(square) <= (bound - stray) * (bound - stray)
        } else {
            let square = block.largest_square::<T, FMA, false>(&self.m, origin, p);
            f64::from(square) <= bound * bound
        }
    }
}

impl Packed {
    /// The largest square of a distance between points and where they should be, `m` being the identity where `SAME`.
    #[inline(always)]
    fn largest_square<T: Real, const FMA: bool, const SAME: bool>(
        &self,
        m: &[[f32; 3]; 3],
        origin: [T; 3],
        p: [&[T; BLOCK]; 3],
    ) -> f32 {
        let mut m = *m;
        for m in m.as_flattened_mut() {
            *m *= self.scale;
        }
        let mut largest = [0.0f32; LANES];
        for k in (0..BLOCK).step_by(LANES) {
            for l in 0..LANES {
                let offsets = &self.offsets;
                let q = [
                    f32::from(offsets[0][k + l]),
                    f32::from(offsets[1][k + l]),
                    f32::from(offsets[2][k + l]),
                ];
                let mut square = 0.0;
                for x in 0..3 {
                    let mut d = (p[x][k + l] - origin[x]).narrowed();
                    if SAME {
                        d = add_product::<FMA>(d, -self.scale, q[x]);
                    } else {
                        for y in 0..3 {
                            d = add_product::<FMA>(d, -m[x][y], q[y]);
                        }
                    }
                    square = add_product::<FMA>(square, d, d);
                }
                largest[l] = if square > largest[l] {
                    square
                } else {
                    largest[l]
                };
            }
        }
        let mut most = 0.0;
        for x in largest {
            most = if x > most { x } else { most };
        }
        most
    }
}

/// `a + b c`, in one instruction where there is one.
#[inline(always)]
fn add_product<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { b.mul_add(c, a) } else { a + b * c }
}
