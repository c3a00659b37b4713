//! Vertices of a frame in the format of the upload: in the precision of the shaders, with a bound
//! of the rounding error.

use super::precision::Real;
use crate::curve::vector::per_axis;
use crate::curve::{CurveSet, bounds};
use crate::kernels::sums::direct::Scale;
use crate::pairs::Pair;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Vertices of all closed polylines of a set. The first vertex of each curve is repeated at its
/// end. All coordinates are scaled by one power of two, so that they lie between -1 and 1.
///
/// Input of the same precision or of a lower one is exact, except for numbers below
/// [`Real::SMALLEST`] times the largest one. Doubles that do not fit into single precision are
/// translated to the centre first and then rounded; no coordinate is off by more than `radius`.
#[derive(Debug, Default)]
pub(crate) struct Frame<R = f32> {
    /// Unique identifier of the frame.
    pub id: u64,
    /// Vertices, as `x y z 0`.
    pub vertices: Vec<[R; 4]>,
    /// Range of vertices of each curve. Empty if the curve has no linking numbers: an open curve,
    /// or a spline.
    pub curves: Vec<Range<u32>>,
    /// Maximum error of a coordinate.
    pub radius: f32,
}

impl<R: Real> Frame<R> {
    /// Copies the vertices of a set, on all threads.
    pub fn new(set: &CurveSet) -> Frame<R> {
        Frame::copied(set, 64)
    }

    /// Copies the vertices of a set on the current thread alone, for callers that hold a lock.
    pub fn alone(set: &CurveSet) -> Frame<R> {
        Frame::copied(set, usize::MAX)
    }

    /// Copies the vertices of a set. A task has at least `at_least` curves.
    fn copied(set: &CurveSet, at_least: usize) -> Frame<R> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let mut frame = Frame {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            ..Frame::default()
        };
        let mut at = 0;
        for curve in set.curves() {
            let start = at;
            if curve.closed && set.basis().is_polyline() {
                at += curve.points + 1;
            }
            frame.curves.push(start..at);
        }
        let scale = Scale::new(set.max_abs());
        let mut worst = frame.write(set, [0.0; 3], scale, at_least);
        // Error of the translation: differences from the centre are at most 1, and rounded.
        const MOVED: f64 = f64::EPSILON;
        if worst > MOVED {
            let (centre, half) = frame.middle(set);
            worst = MOVED + frame.write(set, centre, Scale::new(half), at_least);
        }
        frame.radius = match worst {
            0.0 => 0.0,
            w => (w as f32).next_up().max(f32::MIN_POSITIVE),
        };
        frame
    }

    /// Writes all vertices. Returns the maximum error of a coordinate.
    fn write(&mut self, set: &CurveSet, centre: [f64; 3], scale: Scale, at_least: usize) -> f64 {
        let total = self.curves.last().map_or(0, |c| c.end) as usize;
        self.vertices.resize(total, [R::default(); 4]);
        let mut rest = &mut self.vertices[..];
        let mut parts = Vec::with_capacity(self.curves.len());
        for range in &self.curves {
            let (own, others) = rest.split_at_mut(range.len());
            rest = others;
            parts.push(own);
        }
        let write = |(i, own): (usize, &mut [[R; 4]])| {
            let mut worst = 0f64;
            for (to, p) in own.iter_mut().zip(set.points_in(i)) {
                for x in 0..3 {
                    let from_centre = p[x] - centre[x];
                    let exact = scale.apply(from_centre);
                    let nearest: f64 = R::nearest(exact).into();
                    let tiny = nearest.abs() < R::SMALLEST;
                    to[x] = R::nearest(if tiny { 0.0 } else { nearest });
                    let off = match tiny && from_centre != 0.0 {
                        true => R::SMALLEST,
                        false => (exact - nearest).abs(),
                    };
                    worst = worst.max(off);
                }
            }
            if let [first, .., last] = own {
                *last = *first;
            }
            worst
        };
        let parts = parts.into_par_iter().enumerate();
        let each = parts.with_min_len(at_least).map(write);
        each.reduce(|| 0.0, f64::max)
    }

    /// Returns the centre of the bounding box of the curves, and an upper bound of half its longest
    /// side.
    fn middle(&self, set: &CurveSet) -> ([f64; 3], f64) {
        let some = (0..set.len()).filter(|&i| !self.curves[i].is_empty());
        let [lo, hi] = bounds(some.flat_map(|i| set.points_in(i)));
        // Each half is finite, and so is their sum.
        let centre = per_axis(|x| 0.5 * lo[x] + 0.5 * hi[x]);
        let half = (0..3).fold(0.0, |m: f64, x| {
            m.max(hi[x] - centre[x]).max(centre[x] - lo[x])
        });
        (centre, half)
    }

    /// Returns the number of segments of curve `i`; 0 if it has no linking numbers.
    pub fn segments(&self, i: u32) -> u32 {
        let range = self.curves.get(i as usize).cloned().unwrap_or_default();
        (range.len() as u32).saturating_sub(1)
    }

    /// Returns true if both curves are different and have segments, which a linking number
    /// requires.
    pub fn has_numbers(&self, (i, j): Pair) -> bool {
        i != j && self.segments(i) > 0 && self.segments(j) > 0
    }

    /// Returns the first vertex of curve `i`.
    pub fn first(&self, i: u32) -> u32 {
        self.curves[i as usize].start
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    fn frame<R: Real>(xyz: &[f64]) -> Frame<R> {
        let counts = [-(xyz.len() as i32 / 3)];
        Frame::new(&CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(xyz)).unwrap())
    }

    #[test]
    fn representable_coordinates_are_exact_and_curves_are_closed() {
        let f: Frame = frame(&[0.0, 1.0, -3.0, 2.0, 0.5, 7.0, 1.0, 1.0, 1.0]);
        assert_eq!(f.radius, 0.0);
        assert_eq!((f.curves.len(), f.curves[0].clone()), (1, 0..4));
        assert_eq!(f.vertices[0], f.vertices[3]);
        assert_eq!(f.vertices[1][2], 7.0 / 8.0);
        assert_eq!((f.segments(0), f.segments(9)), (3, 0));
    }

    #[test]
    fn other_coordinates_are_rounded_within_the_radius() {
        let thirds = [
            1e6 + 1.0 / 3.0,
            0.1,
            0.2,
            1e6 + 2.0,
            0.7,
            -1.1,
            1e6,
            1e-9,
            0.3,
        ];
        let f: Frame = frame(&thirds);
        assert!(f.radius > 0.0 && f.radius < 1e-7, "{}", f.radius);
        let width = f.vertices[1][0] - f.vertices[0][0];
        let height = f.vertices[1][1] - f.vertices[0][1];
        assert!((f64::from(width / height) - (5.0 / 3.0) / 0.6).abs() < 1e-6);
        // A number that is flushed to 0, beside a large one.
        let f: Frame = frame(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1e-300, 1.0]);
        assert!(f.radius > 0.0 && f.radius < 1e-30);
    }

    #[test]
    fn doubles_are_exact_unless_they_are_flushed_to_zero() {
        let thirds = [
            1e6 + 1.0 / 3.0,
            0.1,
            0.2,
            1e6 + 2.0,
            0.7,
            -1.1,
            1e6,
            1e-300,
            0.3,
        ];
        let f: Frame<f64> = frame(&thirds);
        assert_eq!((f.radius, f.vertices.len()), (0.0, 4));
        for (v, p) in f.vertices.iter().zip(thirds.chunks(3)) {
            assert_eq!([v[0], v[1], v[2]].map(|x| x * 2f64.powi(20)), p);
        }
        let f: Frame<f64> = frame(&[1e6, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1e-305, 1.0]);
        assert!(f.radius > 0.0 && f.radius < 1e-30);
    }

    #[test]
    fn copies_of_one_thread_and_of_all_threads_are_equal() {
        let xyz: Vec<f64> = (0..900_000).map(|k| f64::from(k % 7919) / 3.0).collect();
        let counts = [-3, -100_000, -2, -99_995, 50_000, -7, -49_993];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let [one, other]: [Frame; 2] = [Frame::new(&set), Frame::alone(&set)];
        assert!(one.vertices == other.vertices && one.curves == other.curves);
        assert!(one.radius == other.radius && one.id != other.id);
    }

    #[test]
    fn extreme_exponents_are_exact_or_within_the_radius() {
        let f: Frame = frame(&[1e300, 0.0, 0.0, 0.0, 1e300, 0.0, 0.0, -1e300, 1.7e308]);
        assert!(f.radius.is_finite() && f.vertices.iter().flatten().all(|x| x.abs() <= 1.0));
        let f: Frame = frame(&[1e-310, 0.0, 0.0, 0.0, 1e-310, 0.0, 0.0, 0.0, 1e-310]);
        assert!(f.vertices.iter().flatten().all(|x| x.abs() <= 1.0));
    }
}
