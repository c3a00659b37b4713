//! Linking numbers of closed curves and yarns that run through the cell.
//!
//! # Method
//!
//! The number is the sum of the signs of all crossings at which the yarn passes over the closed
//! curve, seen along an axis that is not parallel to the period. Only finitely many images of one
//! period are above or below the closed curve then. The yarn is closed far away, where its
//! projection no longer meets that of the closed curve. Vertices of images are exact sums.
//!
//! Cost: the number of segments of the yarn above the closed curve, and of the pairs of segments
//! with overlapping boxes.
//!
//! # Proof: the polylines of splines
//!
//! The images that are above or below the closed curve are all that may be near it. Segments of
//! both are split until the hulls of their pieces are apart, by more than rounding errors and the
//! gap between the end of a period and the start of the next one. A segment of the closed curve is
//! split in the same way for all images: at every split that one of them needs, since the hull of a
//! part is within the hull of the whole. Each image of a segment of the yarn has splits of its own.
//! So the closed curve and the whole yarn are replaced by one polyline each, and each piece can be
//! pulled straight within its hull ([`crate::discretize`]).

use super::pairs::PointLimit;
use super::through::RingAndYarn;
use crate::curve::vector::per_axis;
use crate::curve::{Cell, CurveSet, Image, Point, SumEdges, Translated, bounds, single};
use crate::discretize::{self, Halving, Separation, sort_splits};
use crate::error::{Error, Result};
use crate::exact::{Batch, Crossing, crossing_of_sums, sums_touch};
use crate::pairs::closest_of_segments;
use crate::verdict::{DefectKind, Place};
use rayon::prelude::*;
use std::sync::Arc;

/// Linking number of a pair, or the reason why there is none: they touch, or are too close.
pub(crate) type Number = (RingAndYarn, Counted);

/// A linking number, or the reason why there is none.
type Counted = Result<i64, (DefectKind, Place)>;

/// A yarn of the set, its segment, and one of the closed curve.
type Near = (usize, [u32; 2]);

/// Returns the linking numbers of these pairs. `periods` has that of each curve.
///
/// # Errors
///
/// The errors of [`CurveSet::translate`], and [`Error::Usage`] if the images of yarns have too
/// many points.
pub(crate) fn linking_numbers(
    frame: &Arc<CurveSet>,
    cell: &Cell,
    periods: &Arc<[Option<Image>]>,
    pairs: &[RingAndYarn],
) -> Result<Vec<Number>> {
    if pairs.is_empty() {
        return Ok(Vec::new());
    }
    let views = pairs.par_iter().map(|pair| View::new(frame, cell, pair));
    let views: Vec<View> = views.collect();
    let mut curves: Vec<(u32, Image)> = views.iter().flat_map(View::curves).collect();
    curves.sort_unstable();
    curves.dedup();
    let mut points = PointLimit::new(frame.curves());
    for (i, _) in &curves {
        points.add(&frame.curve(*i as usize))?;
    }
    let curves = Translated::new(curves, periods);
    let mut set = None;
    CurveSet::translate(frame, &curves, cell, &mut set)?;
    let set = set.ok_or_else(|| Error::Usage("no curves".into()))?;
    let number = |view: &View| (view.pair, view.linking_number(&set, &curves, cell));
    Ok(views.par_iter().map(number).collect())
}

/// A closed curve, and the images of one period of a yarn that are above or below it along an axis.
struct View {
    pair: RingAndYarn,
    /// Axes of the plane of projection, and the axis that is orthogonal to it.
    plane: [usize; 3],
    /// Multiples of the period of these images.
    from: i32,
    to: i32,
}

impl View {
    fn new(frame: &CurveSet, cell: &Cell, pair: &RingAndYarn) -> View {
        let [[lo, hi], [first, last]] = [pair.ring, pair.yarn].map(|i| {
            let points = 0..frame.curve(i as usize).segments;
            let points = points.flat_map(|s| frame.segment(i as usize, s as usize));
            bounds(points)
        });
        let period = cell.translation(pair.period);
        // The projection in which a period is longest.
        let size = |x: usize| period[x].abs();
        let shortest = (0..3).min_by(|&a, &b| size(a).total_cmp(&size(b)));
        let w = shortest.unwrap_or(2);
        let [u, v] = [(w + 1) % 3, (w + 2) % 3];
        let (plane, x) = ([u, v, w], if size(u) >= size(v) { u } else { v });
        let offset = cell.translation(pair.image);
        let points = [lo, hi, first, last, offset, period];
        // Covers rounding, and the gap between the end of the yarn and the image of its start.
        let slack = 1e-5 * points.as_flattened().iter().map(|x| x.abs()).sum::<f64>();
        let ends = [
            (lo[x] - slack - last[x] - offset[x]) / period[x],
            (hi[x] + slack - first[x] - offset[x]) / period[x],
        ];
        View {
            pair: *pair,
            plane,
            from: ends[0].min(ends[1]).floor() as i32,
            to: ends[0].max(ends[1]).ceil() as i32,
        }
    }

    /// Returns the closed curve, and the images of the yarn, one period after the other.
    fn curves(&self) -> impl Iterator<Item = (u32, Image)> + use<> {
        let pair = self.pair;
        let image = move |times| per_axis(|x| pair.image[x] + times * pair.period[x]);
        let images = (self.from..=self.to).map(move |times| (pair.yarn, image(times)));
        std::iter::once((pair.ring, Image::default())).chain(images)
    }

    /// Returns the linking number. `set` has the translated curves of all pairs.
    fn linking_number(&self, set: &CurveSet, curves: &Translated, cell: &Cell) -> Counted {
        let number = |key: (u32, Image)| curves.partition_point(|other| *other < key);
        let mut numbers = self.curves().map(number);
        let ring = numbers.next().unwrap_or_default();
        let yarns: Vec<usize> = numbers.collect();
        let lacks = |kind, (yarn, [s, t]): Near| {
            let place = match self.pair.ring < self.pair.yarn {
                true => closest_of_segments(set, [ring, yarn], [t, s]),
                false => {
                    // The yarn comes first, and the closed curve is translated.
                    let mut place = closest_of_segments(set, [yarn, ring], [s, t]);
                    let by = cell.translation(self.pair.pair().image);
                    place.point = per_axis(|x| place.point[x] + by[x]);
                    place
                }
            };
            (kind, place)
        };
        let (around, along) = match set.basis().is_polyline() {
            true => {
                let whole = |&i: &usize| Strand::new(set, i, &[]);
                (whole(&ring), yarns.iter().map(whole).collect())
            }
            false => split(set, ring, &yarns).map_err(|at| lacks(DefectKind::TooClose, at))?,
        };
        let mut count = Count {
            set,
            curves: [&along[..], std::slice::from_ref(&around)],
            plane: self.plane,
            // The polylines of splines are as they are.
            rounding: match set.basis().is_polyline() {
                true => set.rounding(),
                false => 0.0,
            },
            waiting: Vec::new(),
            batch: Batch::apart(),
            sum: 0,
            contact: None,
        };
        count.add_all();
        let contact = count.contact.map(|at| lacks(DefectKind::Contact, at));
        contact.map_or(Ok(count.sum), Err)
    }
}

/// Returns true if boxes are further apart than `slack` along some axis.
fn apart([a, b]: [&[Point; 2]; 2], slack: f64) -> bool {
    (0..3).any(|x| a[1][x] + slack < b[0][x] || b[1][x] + slack < a[0][x])
}

/// Polyline of a curve of the set.
struct Strand {
    curve: usize,
    vertices: Vec<Point>,
    /// Segment of each edge.
    segments: Vec<u32>,
}

impl Strand {
    /// `splits` are sorted: segments, and parameters in them.
    fn new(set: &CurveSet, curve: usize, splits: &[(u32, f64)]) -> Strand {
        let (mut vertices, mut segments) = (Vec::new(), Vec::new());
        discretize::vertices(set, curve, splits, |s, p| {
            vertices.push(p);
            segments.push(s);
        });
        vertices.push(set.knot(curve, set.curve(curve).segments as usize));
        Strand {
            curve,
            vertices,
            segments,
        }
    }
}

/// Returns polylines of a closed spline and of images of a yarn, one period after the other, that
/// are link homotopic to them, or segments that are too close.
fn split(set: &CurveSet, ring: usize, yarns: &[usize]) -> Result<(Strand, Vec<Strand>), Near> {
    let ends = |i: usize| [0, set.curve(i).segments].map(|s| set.knot(i, s as usize));
    let gaps = yarns.windows(2).flat_map(|next| {
        let ([_, p], [q, _]) = (ends(next[0]), ends(next[1]));
        per_axis(|x| (p[x] - q[x]).abs())
    });
    let gap = gaps.fold(0.0, f64::max);
    let hulls = |i: usize| -> Vec<[Point; 2]> {
        let segments = 0..set.curve(i).segments as usize;
        segments.map(|s| bounds(set.segment(i, s))).collect()
    };
    let around = hulls(ring);
    let whole = bounds(around.iter().flatten().copied());
    let slack = 2.0 * (set.pad() + gap);
    let (mut halving, mut near, mut close) = (Halving::default(), Vec::new(), Vec::new());
    let (mut of_ring, mut strands) = (Vec::new(), Vec::new());
    for &yarn in yarns {
        near.clear();
        close.clear();
        for (s, hull) in hulls(yarn).iter().enumerate() {
            if !apart([hull, &whole], slack) {
                let others = around.iter().enumerate();
                let others = others.filter(|(_, other)| !apart([hull, other], slack));
                near.extend(others.map(|(t, _)| (t as u32, s as u32)));
            }
        }
        let mut separation = Separation::new([set], [ring, yarn]);
        separation.margin += gap;
        separation.add_close(&near, &mut close);
        let refined = separation.refine(&close, &mut halving);
        refined.map_err(|[t, s]| (yarn, [s, t]))?;
        let [first, second] = &halving.splits;
        of_ring.extend_from_slice(&first.at);
        strands.push(Strand::new(set, yarn, &second.at));
    }
    sort_splits(&mut of_ring);
    // A period ends where the next one starts.
    for k in 1..strands.len() {
        let start = strands[k].vertices[0];
        if let Some(end) = strands[k - 1].vertices.last_mut() {
            *end = start;
        }
    }
    Ok((Strand::new(set, ring, &of_ring), strands))
}

/// An edge of a yarn and one of a closed curve: the strand of the yarn, and the numbers of both
/// edges in their strands.
type Edges = (usize, [usize; 2]);

/// Sum of the crossings of a pair.
struct Count<'a> {
    set: &'a CurveSet,
    /// The images of the yarn, and the closed curve.
    curves: [&'a [Strand]; 2],
    /// Axes of the plane of projection, and the axis that is orthogonal to it.
    plane: [usize; 3],
    rounding: f64,
    /// Edges in each lane in use.
    waiting: Vec<Edges>,
    batch: Batch<f64>,
    sum: i64,
    contact: Option<Near>,
}

impl Count<'_> {
    /// Adds all edges of the yarn and of the closed curve.
    fn add_all(&mut self) {
        let [along, around] = self.curves;
        let around = &around[0].vertices;
        let whole = bounds(around.iter().copied());
        let ([u, v, w], slack) = (self.plane, 2.0 * self.rounding);
        // The yarn is not above, or beside.
        let misses = |[lo, hi]: &[Point; 2], other: &[Point; 2]| {
            let beside = |x: usize| hi[x] + slack < other[0][x] || other[1][x] + slack < lo[x];
            beside(u) || beside(v) || hi[w] + slack < other[0][w]
        };
        for (k, strand) in along.iter().enumerate() {
            for (s, edge) in strand.vertices.windows(2).enumerate() {
                let box_of_edge = bounds([edge[0], edge[1]]);
                if misses(&box_of_edge, &whole) {
                    continue;
                }
                for (t, other) in around.windows(2).enumerate() {
                    if !misses(&box_of_edge, &bounds([other[0], other[1]])) {
                        self.add((k, [s, t]), [[edge[0], edge[1]], [other[0], other[1]]]);
                    }
                }
            }
        }
        self.evaluate();
    }

    fn add(&mut self, key: Edges, edges: [[Point; 2]; 2]) {
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
                self.add_exactly(self.waiting[lane]);
            }
        }
        self.waiting.clear();
        self.batch = Batch::apart();
    }

    /// Adds two edges in exact arithmetic.
    #[cold]
    fn add_exactly(&mut self, (k, [s, t]): Edges) {
        let strands = [&self.curves[0][k], &self.curves[1][0]];
        let edges: SumEdges = [0, 1].map(|side| {
            let (strand, edge) = (strands[side], [s, t][side]);
            [edge, edge + 1].map(|v| match self.rounding == 0.0 {
                true => strand.vertices[v].map(single),
                // Only polylines are rounded; they have a vertex for each segment.
                false => self.set.exact_knot(strand.curve, v),
            })
        });
        let crossing = crossing_of_sums(edges, self.plane[2]);
        if let Crossing::Over(sign) = crossing {
            self.sum += i64::from(sign);
        }
        if matches!(crossing, Crossing::Contact) || sums_touch(edges) {
            let segments = [strands[0].segments[s], strands[1].segments[t]];
            self.contact.get_or_insert((strands[0].curve, segments));
        }
    }
}
