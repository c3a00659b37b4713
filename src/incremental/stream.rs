//! One pass over the positions of a frame, which finds the points that moved further than their
//! allowances, and copies the positions on the way.
//!
//! Positions may come from shared memory, so every value is read once: only the copy is checked and
//! compared.

use super::affine::Affine;
use super::blocks::{BLOCK, CHUNK, Real, VALUES};
use super::packed::{Packed, PackedCondition};
use super::reference::Reference;
use crate::curve::vector::per_axis;
use crate::curve::{Bad, Positions, Received, largest_within, smaller};
use crate::simd::{Simd, dispatch_wide, prefetch};
use rayon::prelude::*;

/// Number of points per task, a multiple of the size of a block. Memory bandwidth limits the pass,
/// so only very large frames gain from several threads. On a busy machine, a second thread starts
/// late.
const GRAIN: usize = 1 << 19;

/// A frame is compared only if its largest coordinate is at most this many times that of the
/// reference frame, mapped to the frame.
const LARGER: f64 = 1.5;

/// Error of the coordinates of periodic images, relative to the size of the scene.
pub(super) const IMAGES: f64 = 48.0 * f64::EPSILON / 2.0;

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
/// than twice that error. The coordinates of periodic images are sums, rounded in double precision,
/// and the map takes the lattice vectors to those of the frame up to rounding: that adds less than
/// `48 * 2^-53` times the same. The square of the length and the bound are rounded by a few `u`,
/// which the factor `1 - 16 u` on `sigma` covers. If they underflow, their errors are far below the
/// square of [`Real::TINY`].
#[derive(Clone, Copy, Debug)]
struct Condition<T> {
    m: [[T; 3]; 3],
    t: [T; 3],
    sigma: T,
    error: T,
}

impl<T: Real> Condition<T> {
    /// `reference` and `current` are upper bounds of the coordinates of both frames. Returns `None`
    /// if squares could overflow.
    fn new(affine: &Affine, reference: f64, current: f64) -> Option<Condition<T>> {
        let size = affine.largest_row() * reference + affine.t.amax() + current;
        (size < T::LARGEST).then(|| Condition {
            m: per_axis(|r| per_axis(|c| T::from_f64(affine.m[(r, c)]))),
            t: per_axis(|r| T::from_f64(affine.t[r])),
            sigma: T::from_f64(affine.sigma * (1.0 - 16.0 * T::U)),
            error: T::from_f64((16.0 * T::U + IMAGES) * size * (1.0 + 4.0 * T::U)) + T::TINY,
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
            let most = self.sigma * T::from(allowances[l]) - self.error;
            *slack = smaller(most * most - square, most);
        }
        slack.into_iter().fold(T::MAX, smaller)
    }
}

/// Returns the points of a chunk, one array per axis, padded with the origin.
fn axes<T: Real>(values: &[T]) -> [[T; CHUNK]; 3] {
    let mut axes = [[T::default(); CHUNK]; 3];
    for (l, point) in values.as_chunks::<3>().0.iter().enumerate() {
        for (axis, &x) in axes.iter_mut().zip(point) {
            axis[l] = x;
        }
    }
    axes
}

/// Compares the points of a frame with a reference frame. Returns the chunks of points that contain
/// a point that moved further than its allowance, in order. Stops comparing if it has found more
/// than `limit` chunks. Returns `None` if the points were not compared, because there is no affine
/// map, or because coordinates are too large.
///
/// Copies the positions to `copy`, if given. Fails with the first value whose magnitude is not
/// within `range`.
pub(super) fn compare(
    reference: &Reference,
    affine: Option<&Affine>,
    positions: Positions<'_>,
    copy: Option<&mut Received>,
    range: f64,
    limit: usize,
) -> Result<Option<Vec<u32>>, Bad> {
    match (positions, reference.given.positions(), copy) {
        (Positions::F32(p), Positions::F32(q), Some(Received::F32(copy))) => {
            compare_all(reference, affine, p, q, Some(copy), range, limit)
        }
        (Positions::F32(p), Positions::F32(q), None) => {
            compare_all(reference, affine, p, q, None, range, limit)
        }
        (Positions::F64(p), Positions::F64(q), Some(Received::F64(copy))) => {
            compare_all(reference, affine, p, q, Some(copy), range, limit)
        }
        (Positions::F64(p), Positions::F64(q), None) => {
            compare_all(reference, affine, p, q, None, range, limit)
        }
        _ => unreachable!("callers compare the precision first"),
    }
}

fn compare_all<T: Real>(
    reference: &Reference,
    affine: Option<&Affine>,
    p: &[T],
    q: &[T],
    copy: Option<&mut Vec<T>>,
    range: f64,
    limit: usize,
) -> Result<Option<Vec<u32>>, Bad> {
    let comparison = affine.and_then(|affine| Comparison::new(reference, affine, q));
    let pass = Pass {
        // Blocks that satisfy the quick condition skip the check of the range, so it is used only
        // if it implies that values are within the range.
        comparison: comparison.filter(|_| range >= PackedCondition::LARGEST),
        range: T::bits_within(range),
        limit,
    };
    let grain = match rayon::current_num_threads() {
        1 => usize::MAX / 3,
        _ => GRAIN,
    };
    let mut copies = copy.map(|copy| copy.chunks_mut(3 * grain));
    let parts = p.chunks(3 * grain).enumerate().map(|(k, source)| Part {
        first: k * grain,
        source,
        copy: copies.as_mut().and_then(Iterator::next),
        found: Vec::new(),
        largest: 0,
    });
    let mut parts: Vec<Part<'_, T>> = parts.collect();
    let run = |part: &mut Part<'_, T>| dispatch_wide!(simd => Pass::part(&pass, simd, part));
    match &mut parts[..] {
        [part] => run(part)?,
        parts => {
            // All parts are collected in order, so that the first bad value of the frame is
            // reported.
            let done: Vec<_> = parts.par_iter_mut().map(run).collect();
            done.into_iter().collect::<Result<(), Bad>>()?;
        }
    }
    let largest = parts.iter().map(|part| part.largest).max().unwrap_or(0);
    let largest = T::from_magnitude(largest);
    let compared = pass.comparison.is_some_and(|c| largest <= c.largest);
    Ok(compared.then(|| parts.into_iter().flat_map(|part| part.found).collect()))
}

/// Number of coordinates that are copied at once, and then compared while they are in the
/// second-level cache. Shorter copies are slower.
const SLAB: usize = 64 * VALUES;

/// Number of blocks of the reference frame by which prefetching is ahead.
const AHEAD: usize = 16;

/// A comparison with a reference frame.
struct Comparison<'a, T> {
    condition: Condition<T>,
    quick: PackedCondition,
    packed: &'a [Packed],
    /// Points of the reference frame.
    reference: &'a [T],
    allowances: &'a [f32],
    /// Upper bound of the coordinates for which the comparison is valid.
    largest: f64,
}

/// A pass over positions.
struct Pass<'a, T> {
    comparison: Option<Comparison<'a, T>>,
    /// Bit pattern of the largest allowed magnitude.
    range: u64,
    /// Number of chunks up to which the comparison continues.
    limit: usize,
}

/// A part of the points, which starts at a block.
struct Part<'a, T> {
    /// First point.
    first: usize,
    source: &'a [T],
    copy: Option<&'a mut [T]>,
    found: Vec<u32>,
    /// Bit pattern of the largest magnitude in blocks that are not quiet.
    largest: u64,
}

impl<T: Real> Pass<'_, T> {
    /// Copies and compares a part.
    #[inline(always)]
    fn part<S: Simd>(&self, simd: S, part: &mut Part<'_, T>) -> Result<(), Bad> {
        for at in (0..part.source.len()).step_by(SLAB) {
            let here = at..part.source.len().min(at + SLAB);
            let slab = match &mut part.copy {
                Some(copy) => {
                    copy[here.clone()].copy_from_slice(&part.source[here.clone()]);
                    &copy[here]
                }
                None => &part.source[here],
            };
            for (k, values) in slab.chunks(VALUES).enumerate() {
                let first = part.first + at / 3 + k * BLOCK;
                let within_limit = part.found.len() <= self.limit;
                let comparison = self.comparison.as_ref().filter(|_| within_limit);
                if comparison.is_some_and(|c| c.is_quiet(simd, first, values)) {
                    continue;
                }
                let largest = largest_within(values, self.range, first)?;
                part.largest = part.largest.max(largest);
                if let Some(comparison) = comparison {
                    comparison.chunks(first, values, &mut part.found);
                }
            }
        }
        Ok(())
    }
}

impl<'a, T: Real> Comparison<'a, T> {
    /// `points` are those of the reference frame.
    fn new(reference: &'a Reference, affine: &Affine, points: &'a [T]) -> Option<Self> {
        let size = reference.set.max_abs();
        let largest = LARGER * (affine.largest_row() * size + affine.t.amax());
        Some(Comparison {
            condition: Condition::new(affine, size, largest)?,
            quick: PackedCondition::new::<T>(affine, size),
            packed: &reference.packed,
            reference: points,
            allowances: &reference.allowances,
            largest,
        })
    }

    /// Returns true if the points of a block are proven to be finite and within their allowances.
    #[inline(always)]
    fn is_quiet<S: Simd>(&self, simd: S, first: usize, values: &[T]) -> bool {
        let block = first / BLOCK;
        // Data that was used a frame ago may have left the caches.
        if let Some(block) = self.packed.get(block + AHEAD) {
            prefetch(block);
        }
        match (self.packed.get(block), values.as_array()) {
            (Some(packed), Some(values)) => self.quick.holds(simd, packed, values),
            _ => false,
        }
    }

    /// Adds the moved chunks of a block to `found`. Tests the uncompressed points and allowances.
    fn chunks(&self, first: usize, values: &[T], found: &mut Vec<u32>) {
        if self.packed.get(first / BLOCK).is_some_and(Packed::is_free) {
            return;
        }
        let reference = self.reference[3 * first..].chunks(3 * CHUNK);
        let allowances = self.allowances[first..].chunks(CHUNK);
        let points = values.chunks(3 * CHUNK).zip(reference).zip(allowances);
        for (k, ((p, q), allowances)) in points.enumerate() {
            // Pads the last chunk with points whose allowance is infinite.
            let mut padded = [f32::INFINITY; CHUNK];
            padded[..allowances.len()].copy_from_slice(allowances);
            if self.condition.slack(&axes(p), &axes(q), &padded) < T::default() {
                found.push((first / CHUNK + k) as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Cancel;
    use crate::curve::{Basis, CurveSet};
    use crate::incremental::Coverage;
    use crate::incremental::reference::MOST_NEAR;
    use crate::random::Random;
    use crate::simd::{Portable, dispatch};
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
        let mut reference = Reference::build(
            &set.into(),
            Arc::default(),
            0,
            Coverage::default(),
            None,
            MOST_NEAR,
            &Cancel::default(),
        )
        .unwrap();
        let mut allowances = vec![f32::INFINITY; reference.set.points()];
        for i in (0..COUNTS.len()).filter(|&i| reference.set.curve(i).closed) {
            for k in reference.set.points_of(i) {
                let a = scale
                    * if even {
                        0.1
                    } else {
                        10f64.powf(random() - 1.0)
                    };
                allowances[k] = a.min(f32::MAX.into()) as f32;
            }
        }
        let (points, largest) = (reference.given.positions(), reference.set.max_abs());
        reference.packed = Packed::blocks(points, largest, &allowances);
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
        let places = r.given.positions();
        let points = (0..r.set.points()).map(|k| {
            let a = f64::from(r.allowances[k].min(r.set.max_abs() as f32));
            affine.m * (Vector3::from(places.point(k)) + share(k) * a) + affine.t
        });
        points.flat_map(|p| [p.x, p.y, p.z]).collect()
    }

    /// Returns the chunks of a frame that moved, in a pass with a copy of its positions.
    fn moved_chunks(r: &Reference, affine: &Affine, frame: &CurveSet) -> Vec<u32> {
        let positions = frame.positions();
        let all = usize::MAX;
        let found = compare(r, Some(affine), positions, None, f64::INFINITY, all).unwrap();
        let (mut copied, mut again) = (frame.clone(), None);
        let copy = |copy: &mut Received, range| {
            again = compare(r, Some(affine), positions, Some(copy), range, all)?;
            Ok(())
        };
        copied.update_by(positions, copy).unwrap();
        if found.is_some() {
            assert_eq!(again, found);
        }
        let found = found.unwrap_or_else(|| (0..frame.points().div_ceil(CHUNK) as u32).collect());
        assert_eq!(copied.max_abs(), frame.max_abs());
        for k in 0..frame.points() {
            assert_eq!(copied.positions().point(k), positions.point(k));
        }
        found
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
            let step = r.set.points() / few;
            let next = |k: usize| k.is_multiple_of(step) || k % (BLOCK * few) == BLOCK - 1;
            let share = |k: usize| if next(k) { 1.0 + hair } else { 0.3 };
            let frame = moved(&r, &affine, |k| any() * share(k));
            let frame = set(&frame, single);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| moved_chunks(&r, &affine, &frame));
            let points = frame.positions();
            let [places, points] = [r.given.positions(), points];
            for k in (0..frame.points()).filter(|&k| r.allowances[k] < f32::INFINITY) {
                let [p, q] = [points, places].map(|at| Vector3::from(at.point(k)) / scale);
                let off = (affine.inverse * (p - affine.t / scale) - q).norm();
                if off > f64::from(r.allowances[k]) / scale * (1.0 + 1e-9) {
                    prop_assert!(found.contains(&((k / CHUNK) as u32)), "{k}: {off}");
                }
            }

            let still = moved(&r, &affine, |_| any() * 0.5);
            let found = moved_chunks(&r, &affine, &set(&still, single));
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
            let size = r.set.max_abs();
            let points = frame.positions();
            for (b, packed) in r.packed.iter().enumerate() {
                let coordinate = |k: usize| points.point(b * BLOCK + k / 3)[k % 3];
                let p: [f64; VALUES] = std::array::from_fn(coordinate);
                let holds = if single {
                    let quick = PackedCondition::new::<f32>(&affine, size);
                    quick.holds(Portable, packed, &p.map(|x| x as f32))
                } else {
                    let quick = PackedCondition::new::<f64>(&affine, size);
                    let p = &p;
                    dispatch!(simd => PackedCondition::holds(&quick, simd, packed, p))
                };
                // Points of the open curve have no allowance, and moved further.
                let open = r.set.points_of(5);
                let in_open = b * BLOCK < open.end && (b + 1) * BLOCK > open.start;
                prop_assert!(holds || in_open, "block {b}");
            }
        }
    }
}
