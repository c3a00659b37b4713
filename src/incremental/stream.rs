//! One pass over a frame: has any point moved further than it may?

use super::affine::Affine;
use super::reference::Reference;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{Axes, CurveSet, LANES};
use rayon::prelude::*;
use std::ops::{Add, Mul, Range, Sub};

/// Slots that are marked together.
pub(super) const CHUNK: usize = 8;

/// Slots that are looked at together, as long as nothing has moved too far.
const COARSE: usize = 64;

/// Slots that are worth a task.
const GRAIN: usize = 1 << 17;

/// The condition of a frame: `|p - (M q + t)| <= sigma a` for every point `p`, with `q` where it was in the reference
/// frame and `a` its allowance. Then `M^-1 (p - t)` is within `a` of `q`.
///
/// It is evaluated in the precision of the coordinates, whose `u` is half a unit in the last place of 1. With `A` and
/// `B` the largest coordinates of both frames, each of three products is off by `2 u |m| B` (`M` is rounded as well),
/// their sum and `t` by `4 u (|m|_1 B + |t|)`, the difference by `u` times the same and `A`: `8 u (|m|_1 B + |t| + A)`
/// an axis is more than that in all, and twice that more than the length of the three. The square of the
/// length and the bound round by some `u`, which `1 - 16 u` on `sigma` covers.
#[derive(Clone, Copy, Debug)]
struct Condition<T> {
    m: [[T; 3]; 3],
    t: [T; 3],
    sigma: T,
    error: T,
}

/// A floating-point type of coordinates, as far as it is needed here.
trait Real:
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
    fn from_f64(x: f64) -> Self;
    fn from_f32(x: f32) -> Self;
}

impl Real for f32 {
    const U: f64 = f32::EPSILON as f64 / 2.0;
    const MAX: f32 = f32::MAX;
    const LARGEST: f64 = 1e18;
    #[inline(always)]
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn from_f32(x: f32) -> f32 {
        x
    }
}

impl Real for f64 {
    const U: f64 = f64::EPSILON / 2.0;
    const MAX: f64 = f64::MAX;
    const LARGEST: f64 = 1e150;
    #[inline(always)]
    fn from_f64(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn from_f32(x: f32) -> f64 {
        x.into()
    }
}

impl<T: Real> Condition<T> {
    /// None where squares could overflow.
    fn new(affine: &Affine, reference: &CurveSet, now: &CurveSet) -> Option<Condition<T>> {
        let rows: Vec<f64> = (0..3)
            .map(|r| affine.m.row(r).iter().map(|m| m.abs()).sum())
            .collect();
        let largest = rows.into_iter().fold(0.0, f64::max);
        let size = largest * reference.max_abs() + affine.t.amax() + now.max_abs();
        (size < T::LARGEST).then(|| Condition {
            m: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(affine.m[(r, c)]))),
            t: [0, 1, 2].map(|r| T::from_f64(affine.t[r])),
            sigma: T::from_f64(affine.sigma * (1.0 - 16.0 * T::U)),
            error: T::from_f64(16.0 * T::U * size * (1.0 + 4.0 * T::U)),
        })
    }

    /// The least that is left of the bounds of `N` points, where none is broken: negative where one is. The number of
    /// points is known to the compiler, which makes vectors of them.
    #[inline(always)]
    fn left<const N: usize>(&self, p: [&[T; N]; 3], q: [&[T; N]; 3], allowances: &[f32; N]) -> T {
        let mut least = [T::MAX; LANES];
        for k in (0..N).step_by(LANES) {
            for l in 0..LANES {
                let q = [q[0][k + l], q[1][k + l], q[2][k + l]];
                let mut square = T::default();
                for (p, (m, &t)) in p.iter().zip(self.m.iter().zip(&self.t)) {
                    let d = p[k + l] - (m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + t);
                    square = square + d * d;
                }
                let most = self.sigma * T::from_f32(allowances[k + l]) - self.error;
                let left = smaller(most * most - square, most);
                least[l] = smaller(least[l], left);
            }
        }
        least.into_iter().fold(T::MAX, smaller)
    }

    #[inline(always)]
    fn scan(
        &self,
        p: [&[T]; 3],
        q: [&[T]; 3],
        allowances: &[f32],
        first: usize,
        found: &mut Vec<u32>,
    ) {
        let (parts, rest) = allowances.as_chunks::<COARSE>();
        let [px, py, pz] = p.map(|v| v.as_chunks::<COARSE>().0);
        let [qx, qy, qz] = q.map(|v| v.as_chunks::<COARSE>().0);
        let points = px.iter().zip(py).zip(pz).zip(qx.iter().zip(qy).zip(qz));
        for (c, (allowances, (((px, py), pz), ((qx, qy), qz)))) in
            parts.iter().zip(points).enumerate()
        {
            if self.left([px, py, pz], [qx, qy, qz], allowances) < T::default() {
                let (p, q) = ([&px[..], py, pz], [&qx[..], qy, qz]);
                self.scan_chunks(p, q, allowances, first + c * (COARSE / CHUNK), found);
            }
        }
        let at = parts.len() * COARSE;
        let [p, q] = [cut(p, at..at + rest.len()), cut(q, at..at + rest.len())];
        self.scan_chunks(p, q, rest, first + at / CHUNK, found);
    }

    /// [`Condition::scan`], chunk by chunk.
    fn scan_chunks(
        &self,
        p: [&[T]; 3],
        q: [&[T]; 3],
        allowances: &[f32],
        first: usize,
        found: &mut Vec<u32>,
    ) {
        for c in 0..allowances.len().div_ceil(CHUNK) {
            let range = c * CHUNK..allowances.len().min((c + 1) * CHUNK);
            // Points that have not moved fill the last one up.
            let part = |v: [&[T]; 3]| v.map(|v| filled_up(&v[range.clone()], T::default()));
            let (p, q) = (part(p), part(q));
            let allowances = filled_up(&allowances[range.clone()], f32::INFINITY);
            if self.left(p.each_ref(), q.each_ref(), &allowances) < T::default() {
                found.push((first + c) as u32);
            }
        }
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
    let Some(condition) = Condition::<T>::new(affine, &reference.set, set) else {
        // Every one may have moved.
        return found.extend(0..set.slots().div_ceil(CHUNK) as u32);
    };
    let allowances = &reference.allowances[..];
    let part = |range: Range<usize>, found: &mut Vec<u32>| {
        let [p, q] = [cut(p, range.clone()), cut(q, range.clone())];
        let first = range.start / CHUNK;
        scan(&condition, p, q, &allowances[range], first, found);
    };
    let ranges = |size: usize| {
        let n = allowances.len();
        (0..n.div_ceil(size)).map(move |k| k * size..n.min((k + 1) * size))
    };
    if allowances.len() <= GRAIN || rayon::current_num_threads() == 1 {
        for range in ranges(GRAIN / 8) {
            part(range, found);
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
            part(range, &mut found);
            found
        })
        .collect();
    found.extend(parts.into_iter().flatten());
    found.sort_unstable();
}

/// [`Condition::scan`] with the instructions that there are.
fn scan<T: Real>(
    condition: &Condition<T>,
    p: [&[T]; 3],
    q: [&[T]; 3],
    allowances: &[f32],
    first: usize,
    found: &mut Vec<u32>,
) {
    #[cfg(target_arch = "x86_64")]
    if Avx2::detect().is_some() {
        #[expect(unsafe_code, reason = "vector instructions")]
        // SAFETY: the processor has just been asked.
        return unsafe { scan_avx2(condition, p, q, allowances, first, found) };
    }
    condition.scan(p, q, allowances, first, found);
}

/// [`Condition::scan`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn scan_avx2<T: Real>(
    condition: &Condition<T>,
    p: [&[T]; 3],
    q: [&[T]; 3],
    allowances: &[f32],
    first: usize,
    found: &mut Vec<u32>,
) {
    condition.scan(p, q, allowances, first, found);
}
