//! One pass over a frame that finds the points that moved further than their allowances.

use super::affine::Affine;
use super::packed::{Packed, PackedCondition};
use super::reference::Reference;
use super::slots::{BLOCK, CHUNK, Real};
use crate::curve::{Axes, CurveSet, smaller};
use crate::simd::{Simd, dispatch, prefetch};
use rayon::prelude::*;
use std::ops::Range;

/// Number of slots per task, a multiple of the block size.
const GRAIN: usize = 1 << 17;

/// Condition of a frame: `|p - (M q + t)| <= sigma a` for every point `p`, with `q` its position in
/// the reference frame and `a` its allowance. Then `M^-1 (p - t)` is within `a` of `q`.
///
/// # Derivation of the error bounds
///
/// The condition is evaluated in the precision of the coordinates, whose `u` is half a unit in the
/// last place of 1. Let `A` and `B` be the largest coordinates of both frames. Each of three
/// products has an error of `2 u |m| B` (`M` is rounded as well), their sum with `t` of
/// `4 u (|m|_1 B + |t|)`, and the difference of `u` times the same plus `A`. In all that is less
/// than `8 u (|m|_1 B + |t| + A)` per axis, and the length of the vector of three axes has less
/// than twice that error. The square of the length and the bound are rounded by a few `u`, which
/// the factor `1 - 16 u` on `sigma` covers. If they underflow, their errors are far below the
/// square of [`Real::TINY`].
#[derive(Clone, Copy, Debug)]
struct Condition<T> {
    m: [[T; 3]; 3],
    t: [T; 3],
    sigma: T,
    error: T,
}

impl<T: Real> Condition<T> {
    /// Returns `None` if squares could overflow.
    fn new(affine: &Affine, reference: &CurveSet, current: &CurveSet) -> Option<Condition<T>> {
        let size = affine.largest_row() * reference.max_abs() + affine.t.amax() + current.max_abs();
        (size < T::LARGEST).then(|| Condition {
            m: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(affine.m[(r, c)]))),
            t: [0, 1, 2].map(|r| T::from_f64(affine.t[r])),
            sigma: T::from_f64(affine.sigma * (1.0 - 16.0 * T::U)),
            error: T::from_f64(16.0 * T::U * size * (1.0 + 4.0 * T::U)) + T::TINY,
        })
    }

    /// Returns the minimum remaining slack of the chunk. Negative if a point moved further than its
    /// allowance. The number of points is a constant, so that the compiler can vectorize the loop.
    #[inline(always)]
    fn slack(&self, p: &[[T; CHUNK]; 3], q: &[[T; CHUNK]; 3], allowances: &[f32; CHUNK]) -> T {
        let mut slack = [T::MAX; CHUNK];
        for (l, slack) in slack.iter_mut().enumerate() {
            let q = [q[0][l], q[1][l], q[2][l]];
            let mut square = T::default();
            for (p, (m, &t)) in p.iter().zip(self.m.iter().zip(&self.t)) {
                let d = p[l] - (m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + t);
                square = square + d * d;
            }
            let most = self.sigma * T::from_f32(allowances[l]) - self.error;
            *slack = smaller(most * most - square, most);
        }
        slack.into_iter().fold(T::MAX, smaller)
    }
}

/// Returns an array of the values, padded with `padding`.
fn padded<T: Copy>(values: &[T], padding: T) -> [T; CHUNK] {
    let mut out = [padding; CHUNK];
    out[..values.len()].copy_from_slice(values);
    out
}

/// Returns the same range of three arrays.
#[inline(always)]
fn cut<T>(v: [&[T]; 3], range: Range<usize>) -> [&[T]; 3] {
    v.map(|v| &v[range.clone()])
}

/// Adds the chunks of slots that contain a point that moved further than its allowance, in order.
/// Stops early if it has found more than `limit` chunks.
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
        // The condition cannot be evaluated, so every point may have moved.
        return found.extend(0..set.slots().div_ceil(CHUNK) as u32);
    };
    let scan = Scan {
        condition,
        quick: PackedCondition::new::<T>(affine, &reference.set, set),
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
            dispatch!(simd => Scan::part(&scan, simd, range, &mut *found));
            // More chunks would not change the decision of the caller.
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
            dispatch!(simd => Scan::part(&scan, simd, range, &mut found));
            found
        })
        .collect();
    found.extend(parts.into_iter().flatten());
    found.sort_unstable();
}

/// Number of blocks of the reference frame by which prefetching is ahead.
const AHEAD: usize = 16;

/// A frame, and the reference data with which it is compared.
struct Scan<'a, T> {
    condition: Condition<T>,
    quick: PackedCondition,
    packed: &'a [Packed],
    p: [&'a [T]; 3],
    q: [&'a [T]; 3],
    allowances: &'a [f32],
}

impl<T: Real> Scan<'_, T> {
    /// Adds the moved chunks of a range of slots, which starts at a block.
    #[inline(always)]
    fn part<S: Simd>(&self, simd: S, range: Range<usize>, found: &mut Vec<u32>) {
        let [px, py, pz] = cut(self.p, range.clone()).map(|v| v.as_chunks::<BLOCK>().0);
        let packed = &self.packed[range.start / BLOCK..range.end / BLOCK];
        let points = px.iter().zip(py).zip(pz);
        let mut at = range.start;
        for (b, (packed, ((px, py), pz))) in packed.iter().zip(points).enumerate() {
            // Data that was used a frame ago may have left the caches.
            if let Some(block) = self.packed.get(range.start / BLOCK + b + AHEAD) {
                prefetch(block);
            }
            if !self.quick.holds(simd, packed, [px, py, pz]) {
                self.chunks(at..at + BLOCK, found);
            }
            at += BLOCK;
        }
        self.chunks(at..range.end, found);
    }

    /// Adds the moved chunks of a range, tested with uncompressed points and allowances.
    fn chunks(&self, range: Range<usize>, found: &mut Vec<u32>) {
        for at in range.clone().step_by(CHUNK) {
            let range = at..range.end.min(at + CHUNK);
            // The last chunk is padded with points that have not moved.
            let part = |v: [&[T]; 3]| v.map(|v| padded(&v[range.clone()], T::default()));
            let (p, q) = (part(self.p), part(self.q));
            let allowances = padded(&self.allowances[range.clone()], f32::INFINITY);
            if self.condition.slack(&p, &q, &allowances) < T::default() {
                found.push((at / CHUNK) as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::incremental::Coverage;
    use crate::random::Random;
    use crate::simd::Portable;
    use nalgebra::{Matrix3, Rotation3, Vector3};
    use proptest::prelude::*;
    use std::sync::Arc;

    /// Sizes of the curves, with about 500 slots in all.
    const COUNTS: [i32; 9] = [-64, -15, -15, -15, -40, 30, -130, -9, -100];

    fn set(xyz: &[f64], single: bool) -> CurveSet {
        if single {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            CurveSet::from_counts(Basis::CatmullRom, &COUNTS, Positions::F32(&xyz)).unwrap()
        } else {
            CurveSet::from_counts(Basis::CatmullRom, &COUNTS, Positions::F64(xyz)).unwrap()
        }
    }

    /// Returns a reference frame whose control points have allowances of 0.01 to 1 times a scale,
    /// or 0.1 times the scale if `even` is set.
    fn reference(
        mut random: impl FnMut() -> f64,
        scale: f64,
        single: bool,
        even: bool,
    ) -> Reference {
        let points: usize = COUNTS.iter().map(|c| c.unsigned_abs() as usize).sum();
        let mut at = [0.0; 3];
        let mut xyz = Vec::new();
        for _ in 0..points {
            at = at.map(|x| 0.99 * x + random());
            xyz.extend(at.map(|x| scale * x));
        }
        let set = set(&xyz, single);
        let mut reference = Reference::build(set, Arc::default(), 0, Coverage::default());
        let mut allowances = vec![f32::INFINITY; reference.set.slots()];
        for i in (0..COUNTS.len()).filter(|&i| reference.set.curve(i).closed) {
            for slot in reference.set.body(i) {
                let a = scale
                    * if even {
                        0.1
                    } else {
                        10f64.powf(random() - 1.0)
                    };
                allowances[slot] = a.min(f32::MAX.into()) as f32;
            }
        }
        reference.packed = Packed::blocks(&reference.set, &allowances);
        reference.allowances = allowances;
        reference
    }

    /// Returns a frame whose points moved by some share of their allowances. Points of open curves
    /// move as well.
    fn moved(
        r: &Reference,
        affine: &Affine,
        mut share: impl FnMut(usize) -> Vector3<f64>,
    ) -> Vec<f64> {
        let slots = (0..COUNTS.len()).flat_map(|i| r.set.body(i));
        let points = slots.map(|slot| {
            let a = f64::from(r.allowances[slot].min(r.set.max_abs() as f32));
            affine.m * (Vector3::from(r.set.at(slot)) + share(slot) * a) + affine.t
        });
        points.flat_map(|p| [p.x, p.y, p.z]).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

        #[test]
        fn marks_points_beyond_their_allowances_and_no_points_far_within(
            seed in 1u64..u64::MAX,
            single: bool,
            even: bool,
            exponent in -1.0f64..1.0,
            turn in prop_oneof![Just(0.0), 0.0..1e-3, 0.0..3.0],
            hair in prop_oneof![-1e-6..1e-6, -1e-3..1e-3, 0.0..3.0],
            few in 1usize..20,
            threads in 1usize..3,
        ) {
            let mut random = Random::new(seed);
            let mut random = move || random.between(-1.0, 1.0);
            // From scales at which squares underflow to scales at which they overflow.
            let largest = match single {
                true => 30.0,
                false if exponent < 0.0 => 85.0,
                false => 36.0,
            };
            let scale = 10f64.powf(exponent.powi(3) * largest);
            let r = reference(&mut random, scale, single, even);
            let axis = Vector3::from([random(), random(), random()]);
            let direction = |v: Vector3<f64>| v.try_normalize(1e-9).unwrap_or(Vector3::x());
            let rotation = Rotation3::new(direction(axis) * turn);
            let t = Vector3::from([random(), random(), random()]) * scale;
            let stretch = Matrix3::identity() * (1.0 + turn * 0.3 * random());
            let affine = Affine::new(rotation.matrix() * stretch, t).unwrap();
            let mut any = || direction(Vector3::from([random(), random(), random()]));

            // A few points move to the limit of their allowances or beyond, half of them at the
            // border of a chunk or a block.
            let step = r.set.slots() / few;
            let next = |slot: usize| slot.is_multiple_of(step) || slot % (BLOCK * few) == BLOCK - 1;
            let share = |slot: usize| if next(slot) { 1.0 + hair } else { 0.3 };
            let frame = moved(&r, &affine, |slot| any() * share(slot));
            let frame = set(&frame, single);
            let mut found = Vec::new();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let limit = usize::MAX;
            pool.install(|| moved_chunks(&r, &affine, &frame, limit, &mut found));
            for slot in (0..frame.slots()).filter(|&k| r.allowances[k] < f32::INFINITY) {
                let [p, q] = [&frame, &r.set].map(|s| Vector3::from(s.at(slot)) / scale);
                let off = (affine.inverse * (p - affine.t / scale) - q).norm();
                if off > f64::from(r.allowances[slot]) / scale * (1.0 + 1e-9) {
                    prop_assert!(found.contains(&((slot / CHUNK) as u32)), "{slot}: {off}");
                }
            }

            let still = moved(&r, &affine, |_| any() * 0.5);
            found.clear();
            moved_chunks(&r, &affine, &set(&still, single), limit, &mut found);
            if (1e-10..1e10).contains(&scale) {
                prop_assert!(found.is_empty(), "{found:?}");
            }
        }

        #[test]
        fn the_compressed_frame_proves_most_blocks_quiet(
            seed in 1u64..u64::MAX,
            single: bool,
            turn in 0.0..3.0,
        ) {
            let mut random = Random::new(seed);
            let mut random = move || random.between(-1.0, 1.0);
            let r = reference(&mut random, 1.0, single, false);
            let rotation = Rotation3::new(Vector3::y() * turn).into_inner();
            let affine = Affine::new(rotation, Vector3::x()).unwrap();
            let frame = set(&moved(&r, &affine, |_| Vector3::x() * 1e-3), single);
            let quick = match single {
                true => PackedCondition::new::<f32>(&affine, &r.set, &frame),
                false => PackedCondition::new::<f64>(&affine, &r.set, &frame),
            };
            for (b, packed) in r.packed.iter().enumerate() {
                let part = b * BLOCK..(b + 1) * BLOCK;
                let holds = match frame.axes() {
                    Axes::F32(p) => {
                        let p = cut(p, part).map(|v| v.as_array().unwrap());
                        quick.holds(Portable, packed, p)
                    }
                    Axes::F64(p) => {
                        let p = cut(p, part).map(|v| v.as_array().unwrap());
                        dispatch!(simd => PackedCondition::holds(&quick, simd, packed, p))
                    }
                };
                // Except for blocks with a part of the open curve, which has no copies at its ends.
                let open = r.set.body(5);
                let in_open = b * BLOCK < open.end + 8 && (b + 1) * BLOCK + 8 > open.start;
                prop_assert!(holds || in_open);
            }
        }
    }
}
