//! One pass over a frame: has any point moved further than it may?

use super::affine::Affine;
use super::packed::{BLOCK, Packed, Quick};
use super::reference::Reference;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{Axes, CurveSet};
use rayon::prelude::*;
use std::ops::{Add, Mul, Range, Sub};

/// Slots that are marked together.
pub(super) const CHUNK: usize = 8;

/// Slots that are worth a task, in whole blocks.
const GRAIN: usize = 1 << 17;

/// The condition of a frame: `|p - (M q + t)| <= sigma a` for every point `p`, with `q` where it was in the reference
/// frame and `a` its allowance. Then `M^-1 (p - t)` is within `a` of `q`.
///
/// It is evaluated in the precision of the coordinates, whose `u` is half a unit in the last place of 1. With `A` and
/// `B` the largest coordinates of both frames, each of three products is off by `2 u |m| B` (`M` is rounded as well),
/// their sum and `t` by `4 u (|m|_1 B + |t|)`, the difference by `u` times the same and `A`: `8 u (|m|_1 B + |t| + A)`
/// an axis is more than that in all, and twice that more than the length of the three. The square of the
/// length and the bound round by some `u`, which `1 - 16 u` on `sigma` covers; where they underflow, they are off by
/// much less than the square of [`Real::TINY`].
#[derive(Clone, Copy, Debug)]
struct Condition<T> {
    m: [[T; 3]; 3],
    t: [T; 3],
    sigma: T,
    error: T,
}

/// A floating-point type of coordinates, as far as it is needed here.
pub(super) trait Real:
    Copy
    + PartialOrd
    + Default
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
{
    /// Half a unit in the last place of 1.
    const U: f64;
    /// The largest finite number.
    const MAX: Self;
    /// Coordinates up to this have squares that can be added.
    const LARGEST: f64;
    /// Far more than the root of the least number.
    const TINY: Self;
    fn from_f64(x: f64) -> Self;
    fn from_f32(x: f32) -> Self;
    fn narrowed(self) -> f32;
}

impl Real for f32 {
    const U: f64 = f32::EPSILON as f64 / 2.0;
    const MAX: f32 = f32::MAX;
    const LARGEST: f64 = 1e18;
    const TINY: f32 = f32::from_bits((127 - 70) << 23);
    #[inline(always)]
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn from_f32(x: f32) -> f32 {
        x
    }
    #[inline(always)]
    fn narrowed(self) -> f32 {
        self
    }
}

impl Real for f64 {
    const U: f64 = f64::EPSILON / 2.0;
    const MAX: f64 = f64::MAX;
    const LARGEST: f64 = 1e150;
    const TINY: f64 = f64::from_bits((1023 - 520) << 52);
    #[inline(always)]
    fn from_f64(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn from_f32(x: f32) -> f64 {
        x.into()
    }
    #[inline(always)]
    fn narrowed(self) -> f32 {
        self as f32
    }
}

impl<T: Real> Condition<T> {
    /// None where squares could overflow.
    fn new(affine: &Affine, reference: &CurveSet, now: &CurveSet) -> Option<Condition<T>> {
        let size = affine.largest_row() * reference.max_abs() + affine.t.amax() + now.max_abs();
        (size < T::LARGEST).then(|| Condition {
            m: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(affine.m[(r, c)]))),
            t: [0, 1, 2].map(|r| T::from_f64(affine.t[r])),
            sigma: T::from_f64(affine.sigma * (1.0 - 16.0 * T::U)),
            error: T::from_f64(16.0 * T::U * size * (1.0 + 4.0 * T::U)) + T::TINY,
        })
    }

    /// The least that is left of the bounds of some points, where none is broken: negative where one is. The number of
    /// points is known to the compiler, which makes vectors of them.
    #[inline(always)]
    fn left(&self, p: &[[T; CHUNK]; 3], q: &[[T; CHUNK]; 3], allowances: &[f32; CHUNK]) -> T {
        let mut left = [T::MAX; CHUNK];
        for (l, left) in left.iter_mut().enumerate() {
            let q = [q[0][l], q[1][l], q[2][l]];
            let mut square = T::default();
            for (p, (m, &t)) in p.iter().zip(self.m.iter().zip(&self.t)) {
                let d = p[l] - (m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + t);
                square = square + d * d;
            }
            let most = self.sigma * T::from_f32(allowances[l]) - self.error;
            *left = smaller(most * most - square, most);
        }
        left.into_iter().fold(T::MAX, smaller)
    }
}

/// The smaller of two numbers, neither of which is NaN.
#[inline(always)]
fn smaller<T: PartialOrd>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

fn filled_up<T: Copy>(values: &[T], with: T) -> [T; CHUNK] {
    let mut out = [with; CHUNK];
    out[..values.len()].copy_from_slice(values);
    out
}

/// The same range of three arrays.
#[inline(always)]
fn cut<T>(v: [&[T]; 3], range: Range<usize>) -> [&[T]; 3] {
    v.map(|v| &v[range.clone()])
}

/// Adds the chunks of slots with a point that has moved further than it may, in order. Stops at some number above
/// `limit`.
pub(super) fn moved_chunks(
    reference: &Reference,
    affine: &Affine,
    set: &CurveSet,
    limit: usize,
    found: &mut Vec<u32>,
) {
    match (set.axes(), reference.set.axes()) {
        (Axes::F32(p), Axes::F32(q)) => scan_all::<f32>(reference, affine, set, p, q, limit, found),
        (Axes::F64(p), Axes::F64(q)) => scan_all::<f64>(reference, affine, set, p, q, limit, found),
        _ => unreachable!("callers compare the precision first"),
    }
}

fn scan_all<T: Real>(
    reference: &Reference,
    affine: &Affine,
    set: &CurveSet,
    p: [&[T]; 3],
    q: [&[T]; 3],
    limit: usize,
    found: &mut Vec<u32>,
) {
    let Some(condition) = Condition::new(affine, &reference.set, set) else {
        // Every one may have moved.
        return found.extend(0..set.slots().div_ceil(CHUNK) as u32);
    };
    let scan = Scan {
        condition,
        quick: Quick::new::<T>(affine, &reference.set, set),
        packed: &reference.packed,
        p,
        q,
        allowances: &reference.allowances,
    };
    let ranges = |size: usize| {
        let n = scan.allowances.len();
        (0..n.div_ceil(size)).map(move |k| k * size..n.min((k + 1) * size))
    };
    if scan.allowances.len() <= GRAIN || rayon::current_num_threads() == 1 {
        for range in ranges(GRAIN / 8) {
            scan.part(range, found);
            // Enough is known.
            if found.len() > limit {
                return;
            }
        }
        return;
    }
    let parts: Vec<Vec<u32>> = ranges(GRAIN)
        .par_bridge()
        .map(|range| {
            let mut found = Vec::new();
            scan.part(range, &mut found);
            found
        })
        .collect();
    found.extend(parts.into_iter().flatten());
    found.sort_unstable();
}

/// Blocks of the reference frame that are asked for before they are needed.
const AHEAD: usize = 8;

/// Asks for a block: the processor does so by itself only up to the end of each page, and what was used a frame ago
/// may be far away by now.
#[inline(always)]
fn fetch(packed: &[Packed], block: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(block) = packed.get(block) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let start: *const Packed = block;
        for line in (0..size_of::<Packed>()).step_by(64) {
            #[expect(unsafe_code, reason = "a hint for the cache")]
            // SAFETY: nothing is read.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(start.cast::<i8>().wrapping_add(line));
            }
        }
    }
}

/// A frame, and what it is compared with.
struct Scan<'a, T> {
    condition: Condition<T>,
    quick: Quick,
    packed: &'a [Packed],
    p: [&'a [T]; 3],
    q: [&'a [T]; 3],
    allowances: &'a [f32],
}

impl<T: Real> Scan<'_, T> {
    /// Adds the chunks of a range of slots, whole blocks but for its end, with the instructions that there are.
    fn part(&self, range: Range<usize>, found: &mut Vec<u32>) {
        #[cfg(target_arch = "x86_64")]
        if Avx2::detect().is_some() && std::arch::is_x86_feature_detected!("fma") {
            #[expect(unsafe_code, reason = "vector instructions")]
            // SAFETY: the processor has just been asked.
            return unsafe { self.blocks_avx2(range, found) };
        }
        self.blocks::<false>(range, found);
    }

    /// [`Scan::blocks`], compiled with AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,fma,popcnt")]
    fn blocks_avx2(&self, range: Range<usize>, found: &mut Vec<u32>) {
        self.blocks::<true>(range, found);
    }

    #[inline(always)]
    fn blocks<const FMA: bool>(&self, range: Range<usize>, found: &mut Vec<u32>) {
        let [px, py, pz] = cut(self.p, range.clone()).map(|v| v.as_chunks::<BLOCK>().0);
        let packed = &self.packed[range.start / BLOCK..range.end / BLOCK];
        let points = px.iter().zip(py).zip(pz);
        let mut at = range.start;
        for (b, (packed, ((px, py), pz))) in packed.iter().zip(points).enumerate() {
            fetch(self.packed, range.start / BLOCK + b + AHEAD);
            if !self.quick.holds::<T, FMA>(packed, [px, py, pz]) {
                self.chunks(at..at + BLOCK, found);
            }
            at += BLOCK;
        }
        self.chunks(at..range.end, found);
    }

    /// Adds chunks by the points and the allowances themselves.
    fn chunks(&self, range: Range<usize>, found: &mut Vec<u32>) {
        for at in range.clone().step_by(CHUNK) {
            let range = at..range.end.min(at + CHUNK);
            // Points that have not moved fill the last one up.
            let part = |v: [&[T]; 3]| v.map(|v| filled_up(&v[range.clone()], T::default()));
            let (p, q) = (part(self.p), part(self.q));
            let allowances = filled_up(&self.allowances[range.clone()], f32::INFINITY);
            if self.condition.left(&p, &q, &allowances) < T::default() {
                found.push((at / CHUNK) as u32);
            }
        }
    }
}
