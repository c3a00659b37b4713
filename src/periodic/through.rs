//! Curves that run through the cell: yarns that close up to a lattice vector, their period.
//!
//! Such a curve is given as an open curve from a vertex to an image of that vertex. Together with
//! its images by the multiples of its period it is an infinite curve without ends. Two of them have
//! no linking number, but the linking number of a closed curve and an infinite one exists: the
//! closed curve lies in a box, and all ways to close the infinite one outside of this box give the
//! same number.
//!
//! # Method
//!
//! The number is the sum of the signs of all crossings at which the infinite curve passes over the
//! closed one, seen along an axis that is not parallel to the period. Only finitely many images of
//! one period are above or below the closed curve then. The infinite curve is closed far away,
//! where its projection no longer meets that of the closed curve. Cost: the number of segments of
//! the infinite curve above the closed one, and of the pairs of segments whose projections have
//! overlapping boxes. The result is exact for polylines; vertices of images are exact sums.

use super::ImagePair;
use crate::curve::{Cell, CurveSet, Image, Point, pow2, sum_point};
use crate::exact::{Batch, Crossing, crossing_of_sums, sums_touch};
use crate::pairs::closest_place;
use crate::verdict::Place;
use rayon::prelude::*;

/// Largest distance of the end of a curve from the image of its start, as a share of the cell.
const TOLERANCE: f64 = 1e-9;

/// A closed curve, and an infinite curve translated by a lattice vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct RingAndYarn {
    pub ring: u32,
    pub yarn: u32,
    /// Translation of the yarn, up to multiples of its period.
    pub image: Image,
    pub period: Image,
}

impl RingAndYarn {
    pub fn new(ring: u32, yarn: u32, image: Image, period: Image) -> RingAndYarn {
        RingAndYarn {
            ring,
            yarn,
            image: reduced(image, period),
            period,
        }
    }

    /// Returns the pair under the name that certificates have for it.
    pub fn pair(&self) -> ImagePair {
        match self.ring < self.yarn {
            true => ImagePair {
                i: self.ring,
                j: self.yarn,
                image: self.image,
            },
            false => ImagePair {
                i: self.yarn,
                j: self.ring,
                image: reduced(self.image.map(|n| -n), self.period),
            },
        }
    }
}

/// Returns a translation that differs by a multiple of a period, the same one for all that do.
pub(crate) fn reduced(image: Image, period: Image) -> Image {
    let Some(x) = (0..3).find(|&x| period[x] != 0) else {
        return image;
    };
    let times = image[x].div_euclid(period[x]);
    [0, 1, 2].map(|x| image[x].wrapping_sub(times.wrapping_mul(period[x])))
}

/// Returns true if a translation is a multiple of a period.
pub(crate) fn is_multiple(image: Image, period: Image) -> bool {
    reduced(image, period) == Image::default()
}

/// Returns the period of a curve, if it is open and ends at an image of its start.
pub(crate) fn period(set: &CurveSet, i: usize, cell: &Cell) -> Option<Image> {
    let curve = set.curve(i);
    if curve.closed {
        return None;
    }
    let inverse = cell.inverse()?;
    let [start, end] = [0, curve.segments as usize].map(|s| set.knot(i, s));
    let d = [0, 1, 2].map(|x| end[x] - start[x]);
    let mut period = Image::default();
    for (x, b) in inverse.iter().enumerate() {
        let u = b[0] * d[0] + b[1] * d[1] + b[2] * d[2];
        let nearest = if cell.periodic()[x] { u.round() } else { 0.0 };
        let size = (0..3).map(|k| (b[k] * start[k]).abs()).sum::<f64>();
        let near = (u - nearest).abs() <= TOLERANCE * (1.0 + size);
        if !near || nearest.abs() > 1e6 {
            return None;
        }
        period[x] = nearest as i32;
    }
    (period != Image::default()).then_some(period)
}

/// Linking number of a pair; `Err` with a place if they touch.
pub(crate) type Number = (RingAndYarn, Result<i64, Place>);

/// Returns the linking numbers of these pairs of polylines.
pub(crate) fn linking_numbers(set: &CurveSet, cell: &Cell, pairs: &[RingAndYarn]) -> Vec<Number> {
    let number = |pair: &RingAndYarn| (*pair, linking_number(set, cell, pair));
    pairs.par_iter().map(number).collect()
}

/// Returns the smallest and the largest coordinates of points.
fn bounds(points: &[Point]) -> [Point; 2] {
    let mut bounds = [points[0]; 2];
    for p in points {
        for x in 0..3 {
            bounds[0][x] = bounds[0][x].min(p[x]);
            bounds[1][x] = bounds[1][x].max(p[x]);
        }
    }
    bounds
}

fn linking_number(set: &CurveSet, cell: &Cell, pair: &RingAndYarn) -> Result<i64, Place> {
    let [ring, yarn] = [pair.ring as usize, pair.yarn as usize];
    let knots = |i: usize| -> Vec<Point> {
        let segments = set.curve(i).segments as usize;
        (0..=segments).map(|s| set.knot(i, s)).collect()
    };
    let (around, along) = (knots(ring), knots(yarn));
    let period = cell.translation(pair.period);
    // The projection in which a period is longest.
    let size = |x: usize| period[x].abs();
    let w = (0..3)
        .min_by(|&a, &b| size(a).total_cmp(&size(b)))
        .unwrap_or(2);
    let plane = [(w + 1) % 3, (w + 2) % 3];
    let x = if size(plane[0]) >= size(plane[1]) {
        plane[0]
    } else {
        plane[1]
    };
    let ([lo, hi], [first, last]) = (bounds(&around), bounds(&along));
    let offset = cell.translation(pair.image);
    let largest = |p: &[Point; 2]| {
        p.as_flattened()
            .iter()
            .fold(0.0, |m: f64, x| m.max(x.abs()))
    };
    let reach = largest(&[lo, hi]) + largest(&[first, last]) + largest(&[offset, period]);
    let slack = 1e-9 * reach;
    // Multiples of the period at which it may be above or below the ring.
    let ends = [
        (lo[x] - slack - last[x] - offset[x]) / period[x],
        (hi[x] + slack - first[x] - offset[x]) / period[x],
    ];
    let from = ends[0].min(ends[1]).floor() as i32;
    let to = ends[0].max(ends[1]).ceil() as i32;
    let mut count = Count {
        set,
        cell,
        pair: *pair,
        plane: [plane[0], plane[1], w],
        rounding: 0.0,
        waiting: Vec::new(),
        batch: Batch::apart(),
        sum: 0,
        contact: None,
    };
    for times in from..=to {
        let image = [0, 1, 2].map(|k| pair.image[k] + times * pair.period[k]);
        let by = cell.translation(image);
        let sizes = by.iter().fold(reach, |m, x| m.max(x.abs()));
        let slack = 1e-12 * sizes;
        count.rounding = 4.0 * sizes * pow2(-50) + 1e-300;
        for (s, edge) in along.windows(2).enumerate() {
            let edge = [edge[0], edge[1]].map(|p| [0, 1, 2].map(|x| p[x] + by[x]));
            let [low, high] = bounds(&edge);
            let misses = |[a, b]: [Point; 2]| {
                let apart = |x: usize| high[x] + slack < a[x] || b[x] + slack < low[x];
                apart(plane[0]) || apart(plane[1]) || high[w] + slack < a[w]
            };
            if misses([lo, hi]) {
                continue;
            }
            for (t, other) in around.windows(2).enumerate() {
                let other = [other[0], other[1]];
                if !misses(bounds(&other)) {
                    count.add([edge, other], (image, [s as u32, t as u32]));
                }
            }
        }
        count.evaluate();
    }
    match count.contact {
        None => Ok(count.sum),
        Some(place) => Err(place),
    }
}

/// Sum of the crossings of a pair.
struct Count<'a> {
    set: &'a CurveSet,
    cell: &'a Cell,
    pair: RingAndYarn,
    /// Axes of the plane of projection, and the axis that is orthogonal to it.
    plane: [usize; 3],
    rounding: f64,
    /// Image of the yarn, segment of the yarn and of the ring, of each lane in use.
    waiting: Vec<(Image, [u32; 2])>,
    batch: Batch<f64>,
    sum: i64,
    contact: Option<Place>,
}

impl Count<'_> {
    /// Adds a segment of the yarn and one of the ring.
    fn add(&mut self, edges: [[Point; 2]; 2], key: (Image, [u32; 2])) {
        let lane = self.waiting.len();
        for (end, p) in self.batch.ends.iter_mut().zip(edges.as_flattened()) {
            for (row, x) in end.iter_mut().zip(self.plane) {
                row[lane] = p[x];
            }
        }
        self.waiting.push(key);
        if self.waiting.len() == 8 {
            self.evaluate();
        }
    }

    fn evaluate(&mut self) {
        let out = self.batch.evaluate_rounded::<true>(self.rounding);
        self.sum += i64::from(out.sum);
        for lane in 0..self.waiting.len() {
            if out.undecided >> lane & 1 != 0 {
                let (image, segments) = self.waiting[lane];
                self.add_exactly(image, segments);
            }
        }
        self.waiting.clear();
        self.batch = Batch::apart();
    }

    /// Adds a segment of the yarn and one of the ring, in exact arithmetic.
    fn add_exactly(&mut self, image: Image, [s, t]: [u32; 2]) {
        let (ring, yarn) = (self.pair.ring as usize, self.pair.yarn as usize);
        let last = self.set.curve(yarn).segments as usize;
        let of_yarn = |s: usize| match s == last {
            // The end of the curve is the image of its start.
            true => {
                let next = [0, 1, 2].map(|k| image[k] + self.pair.period[k]);
                sum_point(self.set.knot(yarn, 0), self.cell, next)
            }
            false => sum_point(self.set.knot(yarn, s), self.cell, image),
        };
        let of_ring = |t: usize| sum_point(self.set.knot(ring, t), self.cell, Image::default());
        let (s, t) = (s as usize, t as usize);
        let edges = [[of_yarn(s), of_yarn(s + 1)], [of_ring(t), of_ring(t + 1)]];
        match crossing_of_sums(edges, self.plane[2]) {
            Crossing::None => {}
            Crossing::Over(sign) => self.sum += i64::from(sign),
            Crossing::Contact => self.touch(image, [s, t]),
        }
        if sums_touch(edges) {
            self.touch(image, [s, t]);
        }
    }

    fn touch(&mut self, image: Image, [s, t]: [usize; 2]) {
        let by = self.cell.translation(image);
        let (ring, yarn) = (self.pair.ring as usize, self.pair.yarn as usize);
        let moved = |p: Point| [0, 1, 2].map(|x| p[x] + by[x]);
        let of_yarn = [s, s + 1].map(|s| moved(self.set.knot(yarn, s)));
        let of_ring = [t, t + 1].map(|t| self.set.knot(ring, t));
        let (point, distance) = closest_place(of_yarn[0], of_yarn[1], of_ring[0], of_ring[1]);
        let segments = match self.pair.ring < self.pair.yarn {
            true => [t as u32, s as u32],
            false => [s as u32, t as u32],
        };
        self.contact.get_or_insert(Place {
            segments,
            point,
            distance,
        });
    }
}
