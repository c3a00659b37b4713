//! The vertices of a frame as they go up: in single precision, with what that may have cost.

use crate::curve::{Axes, CurveSet};
use crate::kernels::direct::Scale;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// A number that is smaller may count as 0 on an adapter.
const SMALLEST: f64 = f32::MIN_POSITIVE as f64;

/// The vertices of all closed polylines of a set, each with its first vertex again at its end, times a power of two that
/// brings them between -1 and 1.
///
/// Input in single precision stays what it is, but for numbers below `2^-126` of the largest. Input in double precision
/// that does not fit is moved to the middle first, and rounded; no coordinate is further off than `radius`.
#[derive(Debug, Default)]
pub(crate) struct Frame {
    /// No two frames have the same.
    pub id: u64,
    /// `x y z 0` a vertex.
    pub vertices: Vec<[f32; 4]>,
    /// Those of each curve; empty where it has no linking numbers: an open curve, or a spline.
    pub curves: Vec<Range<u32>>,
    /// How far a coordinate may be from the true one.
    pub radius: f32,
}

/// Who copies.
#[derive(Clone, Copy)]
enum Copiers {
    /// The pool of the caller.
    Pool,
    /// Threads that do nothing else.
    Own,
}

impl Frame {
    /// Copies them.
    pub fn new(set: &CurveSet) -> Frame {
        Frame::copied(set, Copiers::Pool)
    }

    /// The same for a caller who holds the adapter: one who waits for the pool may be given work that wants it, too.
    pub fn new_without_pool(set: &CurveSet) -> Frame {
        Frame::copied(set, Copiers::Own)
    }

    fn copied(set: &CurveSet, copiers: Copiers) -> Frame {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let mut frame = Frame {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            ..Frame::default()
        };
        let mut bodies = Vec::new();
        let mut at = 0;
        for (i, curve) in set.curves().iter().enumerate() {
            let body = match curve.closed && set.basis().is_polyline() {
                true => set.body(i),
                false => 0..0,
            };
            let n = match body.len() as u32 {
                0 => 0,
                n => n + 1,
            };
            frame.curves.push(at..at + n);
            at += n;
            bodies.push(body);
        }
        let scale = Scale::new(set.max_abs());
        let mut worst = frame.write(set, &bodies, [0.0; 3], scale, copiers);
        if worst > 0.0 {
            let (centre, half) = middle(set, &bodies);
            worst = frame.write(set, &bodies, centre, Scale::new(half), copiers);
            // Differences from the middle, at most 1 now, were rounded too.
            worst += f64::EPSILON;
        }
        frame.radius = match worst {
            0.0 => 0.0,
            w => (w as f32).next_up().max(f32::MIN_POSITIVE),
        };
        frame
    }

    /// Writes all vertices; returns by how much a coordinate is off, at most.
    fn write(
        &mut self,
        set: &CurveSet,
        bodies: &[Range<usize>],
        centre: [f64; 3],
        scale: Scale,
        copiers: Copiers,
    ) -> f64 {
        let total = self.curves.last().map_or(0, |c| c.end) as usize;
        self.vertices.resize(total, [0.0; 4]);
        let mut rest = &mut self.vertices[..];
        let mut parts = Vec::with_capacity(bodies.len());
        for (range, body) in self.curves.iter().zip(bodies) {
            let (own, others) = rest.split_at_mut(range.len());
            rest = others;
            parts.push((own, body));
        }
        let write = |(own, body): Part<'_>| {
            let mut worst = 0f64;
            for x in 0..3 {
                let mut put = |to: &mut [f32; 4], p: f64| {
                    let from_centre = p - centre[x];
                    let exact = scale.apply(from_centre);
                    let single = exact as f32;
                    let tiny = f64::from(single.abs()) < SMALLEST;
                    to[x] = if tiny { 0.0 } else { single };
                    let off = match tiny && from_centre != 0.0 {
                        true => SMALLEST,
                        false => (exact - f64::from(to[x])).abs(),
                    };
                    worst = worst.max(off);
                };
                match set.axes() {
                    Axes::F32(v) => {
                        let from = v[x][body.clone()].iter();
                        own.iter_mut()
                            .zip(from)
                            .for_each(|(to, &p)| put(to, p.into()));
                    }
                    Axes::F64(v) => {
                        let from = v[x][body.clone()].iter();
                        own.iter_mut().zip(from).for_each(|(to, &p)| put(to, p));
                    }
                }
            }
            if let [first, .., last] = own {
                *last = *first;
            }
            worst
        };
        match copiers {
            Copiers::Pool => {
                let each = parts.into_par_iter().with_min_len(64).map(write);
                each.reduce(|| 0.0, f64::max)
            }
            Copiers::Own => worst_of(parts, total, &write),
        }
    }

    /// Segments of curve `i`; none where it has no linking numbers.
    pub fn segments(&self, i: u32) -> u32 {
        let range = self.curves.get(i as usize).cloned().unwrap_or_default();
        (range.len() as u32).saturating_sub(1)
    }

    /// First vertex of curve `i`.
    pub fn first(&self, i: u32) -> u32 {
        self.curves[i as usize].start
    }
}

/// Vertices of a curve, and where they come from.
type Part<'a> = (&'a mut [[f32; 4]], &'a Range<usize>);

/// Vertices that are worth a thread of their own.
const GRAIN: usize = 1 << 16;

/// What is largest of some parts of so many vertices, with as many threads as the pool has.
fn worst_of(mut parts: Vec<Part<'_>>, total: usize, of: &(dyn Fn(Part<'_>) -> f64 + Sync)) -> f64 {
    let threads = rayon::current_num_threads().min(total / GRAIN).max(1);
    let size = parts.len().div_ceil(threads).max(1);
    let worst = |own: Vec<Part<'_>>| own.into_iter().map(of).fold(0.0, f64::max);
    std::thread::scope(|scope| {
        let mut others = Vec::new();
        while parts.len() > size {
            let own = parts.split_off(parts.len() - size);
            others.push(scope.spawn(move || worst(own)));
        }
        let here = worst(parts);
        let joined = others.into_iter().map(|other| match other.join() {
            Ok(worst) => worst,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        joined.fold(here, f64::max)
    })
}

/// The middle of the box around the curves, and half its longest side, or a little more.
fn middle(set: &CurveSet, bodies: &[Range<usize>]) -> ([f64; 3], f64) {
    let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for slot in bodies.iter().cloned().flatten() {
        let p = set.at(slot);
        for x in 0..3 {
            (lo[x], hi[x]) = (lo[x].min(p[x]), hi[x].max(p[x]));
        }
    }
    // Halves first: their sum is finite.
    let centre = [0, 1, 2].map(|x| 0.5 * lo[x] + 0.5 * hi[x]);
    let half = (0..3).fold(0.0, |m: f64, x| {
        m.max(hi[x] - centre[x]).max(centre[x] - lo[x])
    });
    (centre, half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    fn frame(xyz: &[f64]) -> Frame {
        let counts = [-(xyz.len() as i32 / 3)];
        Frame::new(&CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(xyz)).unwrap())
    }

    #[test]
    fn what_fits_is_exact_and_closed() {
        let f = frame(&[0.0, 1.0, -3.0, 2.0, 0.5, 7.0, 1.0, 1.0, 1.0]);
        assert_eq!(f.radius, 0.0);
        assert_eq!((f.curves.len(), f.curves[0].clone()), (1, 0..4));
        assert_eq!(f.vertices[0], f.vertices[3]);
        assert_eq!(f.vertices[1][2], 7.0 / 8.0);
        assert_eq!((f.segments(0), f.segments(9)), (3, 0));
    }

    #[test]
    fn what_does_not_fit_is_rounded_within_the_radius() {
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
        let f = frame(&thirds);
        assert!(f.radius > 0.0 && f.radius < 1e-7, "{}", f.radius);
        let width = f.vertices[1][0] - f.vertices[0][0];
        let height = f.vertices[1][1] - f.vertices[0][1];
        assert!((f64::from(width / height) - (5.0 / 3.0) / 0.6).abs() < 1e-6);
        // Too small to count, beside something large.
        let f = frame(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1e-300, 1.0]);
        assert!(f.radius > 0.0);
    }

    #[test]
    fn whoever_copies_the_copy_is_the_same() {
        let xyz: Vec<f64> = (0..900_000).map(|k| f64::from(k % 7919) / 3.0).collect();
        let counts = [-3, -100_000, -2, -99_995, 50_000, -7, -49_993];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let [one, other] = [Frame::new(&set), Frame::new_without_pool(&set)];
        assert!(one.vertices == other.vertices && one.curves == other.curves);
        assert!(one.radius == other.radius && one.id != other.id);
    }

    #[test]
    fn extreme_exponents_fit_or_say_so() {
        let f = frame(&[1e300, 0.0, 0.0, 0.0, 1e300, 0.0, 0.0, -1e300, 1.7e308]);
        assert!(f.radius.is_finite() && f.vertices.iter().flatten().all(|x| x.abs() <= 1.0));
        let f = frame(&[1e-310, 0.0, 0.0, 0.0, 1e-310, 0.0, 0.0, 0.0, 1e-310]);
        assert!(f.vertices.iter().flatten().all(|x| x.abs() <= 1.0));
    }
}
