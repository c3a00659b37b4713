//! Coordinates that are sums: curves of a frame, translated by lattice vectors.
//!
//! A sum of a coordinate and of multiples of lattice vectors is in general no floating-point
//! number. A set of translated curves has the rounded sums, a bound of their errors
//! ([`CurveSet::rounding`]), and what they are made of. Boxes and bounds of floating-point tests
//! include the error. Tests that they do not decide use the exact sums.

use super::parts::multiple;
use super::vector::{add, per_axis, two_sum};
use super::{Cell, CurveSet, Image, Point, Positions, is_home, larger, minus, plus, pow2};
use crate::error::Result;
use std::collections::BTreeMap;
use std::ops::{Deref, Range};
use std::sync::Arc;

/// Number of terms of a sum: a coordinate, and for each lattice vector a rounded product and its
/// error.
pub(crate) const TERMS: usize = 7;

/// A point whose coordinates are sums of floating-point numbers, not rounded.
pub(crate) type SumPoint = [[f64; TERMS]; 3];

/// Ends of two edges.
pub(crate) type SumEdges = [[SumPoint; 2]; 2];

/// Curves of a frame that are translated, for each curve of a set: its number in the frame, and its
/// translation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Translated {
    curves: Arc<[(u32, Image)]>,
    /// Period of each curve of the frame, if it is a yarn that runs through the cell.
    periods: Arc<[Option<Image>]>,
    /// Pairs of curves of the set, one of which is not translated: the second one continues the
    /// first one, a yarn.
    pub(super) joints: Arc<[(u32, u32)]>,
}

impl Translated {
    /// Returns these curves. `periods` has one of each curve of the frame, if it is a yarn that
    /// runs through the cell.
    pub fn new(curves: Vec<(u32, Image)>, periods: &Arc<[Option<Image>]>) -> Translated {
        let yarns = (0..).zip(&curves);
        let yarns = yarns.filter_map(|(k, &(i, image))| Some((k, i, image, periods[i as usize]?)));
        let numbers: BTreeMap<_, u32> = yarns.clone().map(|(k, i, n, _)| ((i, n), k)).collect();
        let joint = |(k, i, image, period): (u32, u32, Image, Image)| {
            let next = plus(image, period);
            let joined = is_home(&image) || is_home(&next);
            Some((k, *numbers.get(&(i, next))?)).filter(|_| joined)
        };
        Translated {
            joints: yarns.filter_map(joint).collect(),
            curves: curves.into(),
            periods: Arc::clone(periods),
        }
    }

    /// Returns the translation of the next period of a curve, if it is a yarn.
    pub fn next(&self, i: usize) -> Option<Image> {
        let (curve, image) = self.curves[i];
        Some(plus(image, self.periods[curve as usize]?))
    }

    /// Returns the number of periods from one curve to another, if both are images of one yarn by
    /// multiples of its period.
    pub fn periods_between(&self, i: usize, j: usize) -> Option<i32> {
        let [(yarn, from), (other, to)] = [i, j].map(|i| self.curves[i]);
        match yarn == other {
            true => multiple(minus(to, from), self.periods[yarn as usize]?),
            false => None,
        }
    }
}

impl Deref for Translated {
    type Target = [(u32, Image)];

    fn deref(&self) -> &[(u32, Image)] {
        &self.curves
    }
}

/// Origin of the coordinates of a set.
#[derive(Clone, Debug)]
pub(crate) struct Sums {
    frame: Arc<CurveSet>,
    curves: Translated,
    cell: Cell,
    /// Bound of the difference of each coordinate from the exact sum. 0 if all are exact.
    rounding: f64,
}

/// Returns a point, translated by lattice vectors, as exact sums.
fn sum_point(point: Point, cell: &Cell, image: Image) -> SumPoint {
    let mut sums = point.map(single);
    for (k, (vector, count)) in cell.vectors.iter().zip(image).enumerate() {
        for (x, terms) in sums.iter_mut().enumerate() {
            let count = f64::from(count);
            let product = count * vector[x];
            terms[1 + 2 * k] = product;
            terms[2 + 2 * k] = count.mul_add(vector[x], -product);
        }
    }
    sums
}

/// Returns a number as a sum.
pub(crate) fn single(x: f64) -> [f64; TERMS] {
    let mut terms = [0.0; TERMS];
    terms[0] = x;
    terms
}

impl Sums {
    /// Returns the curve of the frame that curve `i` is, translated.
    pub(super) fn given(&self, i: usize) -> (&CurveSet, usize) {
        (&self.frame, self.curves[i].0 as usize)
    }
}

/// Sums of coordinates of a frame and lattice vectors, rounded.
struct SumsOfFrame<'a> {
    frame: &'a CurveSet,
    cell: &'a Cell,
    /// True if no sum was rounded.
    exact: bool,
    /// Largest magnitudes of a translation and of a coordinate.
    longest: f64,
    largest: f64,
}

impl SumsOfFrame<'_> {
    /// Adds points of a curve, translated.
    fn add(&mut self, curve: usize, points: Range<usize>, image: Image, xyz: &mut Vec<f64>) {
        let first = self.frame.points_of(curve).start;
        let (from, to) = (first + points.start, first + points.end);
        let positions = self.frame.positions();
        if is_home(&image) {
            return match positions.part(3 * from..3 * to) {
                Positions::F32(v) => xyz.extend(v.iter().map(|&x| f64::from(x))),
                Positions::F64(v) => xyz.extend_from_slice(v),
            };
        }
        let cell = self.cell;
        let by = cell.translation(image);
        // Products and sums of the translation are exact, or all of its sums count as rounded.
        let terms = per_axis(|x| {
            let products = per_axis(|k| (f64::from(image[k]), cell.vectors[k][x]));
            let whole = products.map(|(n, a)| n * a);
            let errors = products.map(|(n, a)| n.mul_add(a, -(n * a)));
            let sums_up = two_sum(whole[0], whole[1]).1 == 0.0
                && two_sum(whole[0] + whole[1], whole[2]).1 == 0.0;
            self.longest = self.longest.max(whole.iter().map(|x| x.abs()).sum());
            errors == [0.0; 3] && sums_up
        });
        self.exact &= terms == [true; 3];
        for p in (from..to).map(|k| positions.point(k)) {
            self.largest = p.iter().fold(self.largest, |a, x| larger(a, x.abs()));
            if self.exact {
                self.exact = per_axis(|x| two_sum(p[x], by[x]).1) == [0.0; 3];
            }
            xyz.extend(add(p, by));
        }
    }

    /// Returns a bound of the errors of all sums.
    ///
    /// With `u = 2^-53`, three rounded products and their sum are off by at most `3 u` times the
    /// sum of their sizes, and the sum with the coordinate by `u` times the size of both: less than
    /// `5 u` times the sum of all sizes. The bound is `8 u`, so that its difference from a
    /// coordinate may be rounded. The constant covers underflow.
    fn rounding(&self) -> f64 {
        match self.exact {
            true => 0.0,
            false => (self.largest + self.longest) * pow2(-50) + 1e-300,
        }
    }
}

impl CurveSet {
    /// Returns the curves of a frame that these are, translated.
    pub(super) fn translated(&self) -> Option<&Translated> {
        self.sums.as_deref().map(|sums| &sums.curves)
    }

    /// Returns a bound of the difference of the coordinates from those that they stand for. 0
    /// except for sets of translated curves ([`CurveSet::translate`]).
    #[inline]
    pub(crate) fn rounding(&self) -> f64 {
        self.sums.as_ref().map_or(0.0, |sums| sums.rounding)
    }

    /// Returns the start of segment `s` of curve `i`, a polyline, as exact sums. The end of a yarn
    /// is the image of its start.
    pub(crate) fn exact_knot(&self, i: usize, s: usize) -> SumPoint {
        let Some(sums) = self.sums.as_deref() else {
            return self.knot(i, s).map(single);
        };
        let (curve, image) = sums.curves[i];
        let last = sums.frame.curve(curve as usize).segments as usize;
        let (s, image) = match sums.curves.next(i).filter(|_| s == last) {
            Some(next) => (0, next),
            None => (s, image),
        };
        sum_point(sums.frame.knot(curve as usize, s), &sums.cell, image)
    }

    /// Returns two edges of polylines, each of a curve, as exact sums.
    pub(crate) fn exact_edges(&self, curves: [usize; 2], segments: [u32; 2]) -> SumEdges {
        [0, 1].map(|side| {
            let (i, s) = (curves[side], segments[side] as usize);
            [self.exact_knot(i, s), self.exact_knot(i, s + 1)]
        })
    }

    /// Writes some curves of a frame into `out`, each translated by lattice vectors, in double
    /// precision. A polyline that is a yarn ends at the exact image of its start, so that its
    /// periods are one curve without gaps. `out` has these curves of an earlier frame, or nothing.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::from_counts`]; a sum may overflow.
    pub(crate) fn translate(
        frame: &Arc<CurveSet>,
        curves: &Translated,
        cell: &Cell,
        out: &mut Option<CurveSet>,
    ) -> Result<()> {
        let set = match out {
            Some(set) => set,
            None => {
                let count = |&(i, _): &(u32, Image)| frame.curve(i as usize).count();
                let counts: Vec<i32> = curves.iter().map(count).collect();
                let points: usize = counts.iter().map(|n| n.unsigned_abs() as usize).sum();
                let origin = vec![0.0; 3 * points];
                let positions = Positions::F64(&origin);
                out.insert(CurveSet::from_counts(frame.basis(), &counts, positions)?)
            }
        };
        let mut sums = SumsOfFrame {
            frame,
            cell,
            exact: true,
            longest: 0.0,
            largest: 0.0,
        };
        set.update_with(|xyz| {
            for (k, &(i, image)) in curves.iter().enumerate() {
                let next = curves.next(k).filter(|_| frame.basis().is_polyline());
                let i = i as usize;
                let points = frame.curve(i).points as usize - usize::from(next.is_some());
                sums.add(i, 0..points, image, xyz);
                if let Some(next) = next {
                    sums.add(i, 0..1, next, xyz);
                }
            }
        })?;
        set.sums = Some(Arc::new(Sums {
            frame: Arc::clone(frame),
            curves: curves.clone(),
            cell: *cell,
            rounding: sums.rounding(),
        }));
        Ok(())
    }

    /// Same as [`CurveSet::toward`], for translated curves: interpolates the curves of the frame
    /// and the cell.
    pub(super) fn translated_toward(
        [from, to]: [&Sums; 2],
        fraction: f64,
        out: &mut Option<CurveSet>,
    ) -> Result<()> {
        let mut frame = None;
        from.frame.toward(&to.frame, fraction, &mut frame)?;
        let frame = Arc::new(frame.expect("written"));
        let mix = |a: Point, b: Point| per_axis(|x| a[x] + fraction * (b[x] - a[x]));
        let cell = Cell {
            origin: mix(from.cell.origin, to.cell.origin),
            vectors: per_axis(|k| mix(from.cell.vectors[k], to.cell.vectors[k])),
        };
        CurveSet::translate(&frame, &from.curves, &cell, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Basis;

    fn line(x: f64) -> Arc<CurveSet> {
        let xyz = [x, 0.25, 0.0, 1.0, x, 2.0, 3.0, 1.0, -x];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz));
        Arc::new(set.unwrap())
    }

    fn translated(frame: &Arc<CurveSet>, image: Image, cell: &str) -> CurveSet {
        let mut out = None;
        let cell = cell.parse().unwrap();
        let curves = Translated::new(vec![(0, image)], &Arc::from([None]));
        CurveSet::translate(frame, &curves, &cell, &mut out).unwrap();
        out.unwrap()
    }

    #[test]
    fn sums_that_are_exact_need_no_rounding() {
        let frame = line(0.125);
        let set = translated(&frame, [3, -2, 1], "10,10,10.5");
        assert_eq!(set.rounding(), 0.0);
        assert_eq!(set.point(0, 0), [30.125, -19.75, 10.5]);
        for (x, image, cell) in [
            (0.1, [1, 0, 0], "10,10,10"),
            (0.125, [3, 0, 0], "10.1,10,10"),
            (0.125, [1, 1, 0], "10.1,1e-9,0,0.3,10,0,0,0,1"),
        ] {
            assert!(translated(&line(x), image, cell).rounding() > 0.0);
        }
    }

    /// The terms of an exact point add up to the point whose rounded value is stored, within the
    /// bound.
    #[test]
    fn rounded_sums_are_within_their_bound() {
        let mut random = crate::random::Random::new(5);
        for _ in 0..2000 {
            let mut next = || 20.0 * random.unit() - 10.0;
            let xyz: Vec<f64> = (0..9).map(|_| next()).collect();
            let frame = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz));
            let frame = Arc::new(frame.unwrap());
            let cell = Cell {
                origin: [0.0; 3],
                vectors: [
                    [next(), next(), 20.0],
                    [next(), 30.0, next()],
                    [40.0, next(), next()],
                ],
            };
            let image = [0; 3].map(|_| (next() / 2.0) as i32);
            let mut out = None;
            let curves = Translated::new(vec![(0, image)], &Arc::from([None]));
            CurveSet::translate(&frame, &curves, &cell, &mut out).unwrap();
            let set = out.unwrap();
            for s in 0..3 {
                let (exact, rounded) = (set.exact_knot(0, s), set.knot(0, s));
                for x in 0..3 {
                    // Subtracts the rounded coordinate first, which cancels the large terms.
                    let mut terms: Vec<f64> = exact[x].to_vec();
                    terms.push(-rounded[x]);
                    let error = exact_sum(&terms);
                    assert!(error.abs() <= set.rounding(), "{error} {}", set.rounding());
                }
            }
        }
    }

    /// Returns the sum of some numbers, rounded once (as a growing expansion, Shewchuk 1997).
    fn exact_sum(terms: &[f64]) -> f64 {
        let mut parts: Vec<f64> = Vec::new();
        for &term in terms {
            let mut x = term;
            for part in &mut parts {
                (x, *part) = two_sum(x, *part);
            }
            parts.push(x);
        }
        parts.iter().sum()
    }
}
