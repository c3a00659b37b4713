//! Spreads positions, `x y z x y z ..`, over three arrays.
//!
//! The input is read in tiles, across the boundaries of curves, and each tile is copied to the
//! curves in runs. So many small curves cost little more than few large ones.

use super::basis::Basis;
use super::coordinates::Scalar;
use super::curve::{Curve, slots_of};
use crate::simd::LANES;

/// Number of points of a tile. Its coordinates fit into the first-level cache.
const POINTS: usize = 256;

/// Number of points of two rows.
const TWO_ROWS: usize = 2 * LANES;

/// Number of coordinates of a tile.
const VALUES: usize = 3 * POINTS;

/// A part of the input.
struct Tile<T> {
    raw: [T; VALUES],
    /// The coordinates of each axis, and as many slots more as a row has lanes, so that a copy may
    /// end with a whole row.
    axes: [[T; POINTS + LANES]; 3],
}

impl<T: Scalar> Tile<T> {
    fn new() -> Tile<T> {
        Tile {
            raw: [T::default(); VALUES],
            axes: [[T::default(); POINTS + LANES]; 3],
        }
    }

    /// Reads at most [`VALUES`] coordinates. Returns the bit pattern of the largest magnitude.
    #[inline(always)]
    fn read(&mut self, src: &[T]) -> u64 {
        self.raw[..src.len()].copy_from_slice(src);
        let [x, y, z] = &mut self.axes;
        // All of the tile: a loop of a fixed length is compiled to shuffles.
        for k in 0..POINTS {
            x[k] = self.raw[3 * k];
            y[k] = self.raw[3 * k + 1];
            z[k] = self.raw[3 * k + 2];
        }
        T::largest(src)
    }

    /// Copies `count` points, from point `from` of the tile on, to the slots from `to` on. Copies
    /// whole rows, which overwrites up to seven slots that are written later: those of the next
    /// points, the end of this curve, or the next curves.
    #[inline(always)]
    fn copy(&self, from: usize, count: usize, dst: &mut [Vec<T>; 3], to: usize) {
        for (src, dst) in self.axes.iter().zip(dst) {
            let (src, dst) = (&src[from..], &mut dst[to..]);
            match count {
                ..=LANES if copy_row(src, dst, 0) => {}
                ..=TWO_ROWS if copy_row(src, dst, LANES) => {
                    copy_row(src, dst, 0);
                }
                _ => dst[..count].copy_from_slice(&src[..count]),
            }
        }
    }
}

/// Copies a row. Returns false if either slice is too short.
#[inline(always)]
fn copy_row<T: Copy>(src: &[T], dst: &mut [T], at: usize) -> bool {
    let src = src.get(at..).and_then(|s| s.first_chunk::<LANES>());
    let dst = dst.get_mut(at..).and_then(|d| d.first_chunk_mut::<LANES>());
    match (src, dst) {
        (Some(src), Some(dst)) => {
            *dst = *src;
            true
        }
        _ => false,
    }
}

/// Writes all points of all curves, with the slots around them ([`finish_curve`]). Returns the
/// largest magnitude.
#[inline(always)]
pub(super) fn write_curves<T: Scalar>(
    dst: &mut [Vec<T>; 3],
    curves: &[Curve],
    basis: Basis,
    src: &[T],
) -> f64 {
    let mut tile = Tile::new();
    let mut largest = 0;
    let mut curves = curves.iter();
    // The curve that is being written, the slot of its next point, and its missing points.
    let (mut curve, mut to, mut missing) = (None, 0, 0);
    for src in src.chunks(VALUES) {
        largest = largest.max(tile.read(src));
        let count = src.len() / 3;
        let mut from = 0;
        while from < count {
            if missing == 0 {
                let Some(next) = curves.next() else {
                    break;
                };
                to = next.first as usize + basis.lead(next.closed);
                missing = next.points as usize;
                curve = Some(next);
            }
            let run = missing.min(count - from);
            tile.copy(from, run, dst, to);
            (from, to, missing) = (from + run, to + run, missing - run);
            if let (0, Some(curve)) = (missing, curve) {
                for dst in dst.iter_mut() {
                    finish_curve(dst, curve, basis);
                }
            }
        }
    }
    T::from_magnitude(largest)
}

/// Writes the slots around the points of a curve, one axis: the copies of points that a closed
/// curve stores at its ends, including the padding of its last row. The padding of an open curve is
/// 0. Up to seven slots behind the curve are overwritten as well.
#[inline(always)]
fn finish_curve<T: Scalar>(dst: &mut [T], c: &Curve, basis: Basis) {
    let (first, n, lead) = (c.first as usize, c.points as usize, basis.lead(c.closed));
    let body = first + lead;
    let end = body + n;
    let tail = first + slots_of(basis, c.segments as usize) - end;
    if !c.closed {
        dst[end..end + tail].fill(T::default());
        return;
    }
    for k in 0..lead {
        dst[first + k] = dst[body + (k + n - lead) % n];
    }
    if tail <= LANES && tail <= n {
        let row = dst[body..].first_chunk::<LANES>().copied();
        let to = dst[end..].first_chunk_mut::<LANES>();
        if let (Some(row), Some(to)) = (row, to) {
            *to = row;
            return;
        }
    }
    if tail <= n {
        dst.copy_within(body..body + tail, end);
        return;
    }
    for k in 0..tail {
        dst[end + k] = dst[body + k % n];
    }
}

#[cfg(test)]
mod tests {
    use crate::curve::{Axes, Basis, CurveSet, Positions, Precision};
    use crate::error::Error;
    use crate::random::Random;

    /// Curves of one to three tiles, and many of few points.
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
        match set.axes() {
            Axes::F32(v) => v[x].iter().map(|&p| p.into()).collect(),
            Axes::F64(v) => v[x].to_vec(),
        }
    }

    #[test]
    fn every_slot_has_its_point_after_construction_and_after_an_update() {
        for seed in 0..40 {
            let mut random = Random::new(seed);
            for basis in Basis::ALL {
                let counts = counts(&mut random, basis);
                let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
                // Multiples of 2^-10, which single precision represents.
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
