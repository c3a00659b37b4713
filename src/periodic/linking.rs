//! Linking numbers of closed curves and yarns that run through the cell.
//!
//! # Method
//!
//! The number is the sum of the signs of all crossings at which the yarn passes over the closed
//! curve, seen along an axis that is not parallel to the period. Only finitely many images of one
//! period are then above or below the closed curve. The yarn is closed far away, where its
//! projection does not meet that of the closed curve. Vertices of images are exact sums.
//!
//! Cost: that of counting crossings ([`crate::kernels::crossings`]), for each of these images.
//!
//! # Proof: the polylines of splines
//!
//! All images that may be near the closed curve are above or below it. Segments of both are split
//! until the hulls of their pieces are apart, by more than rounding errors and the gap between the
//! end of a period and the start of the next one. A segment of the closed curve has the same splits
//! for all images: every split that some image needs, because the hull of a part is within the hull
//! of the whole. Each image of a segment of the yarn has its own splits. So the closed curve and
//! the whole yarn are replaced by one polyline each, and each piece can be pulled straight within
//! its hull ([`crate::discretize`]).

use super::pairs::PointLimit;
use super::through::RingAndYarn;
use crate::curve::vector::per_axis;
use crate::curve::{
    Basis, Cell, CurveSet, Image, Point, Positions, Translated, bounds, boxes_apart,
};
use crate::discretize::{self, Halving, Separation, sort_splits};
use crate::error::{Error, Result};
use crate::kernels::Linking;
use crate::kernels::crossings::{self, Direction, Input, Workspaces};
use crate::pairs::{Leaves, Trees, closest_of_segments, distinct};
use crate::verdict::{DefectKind, Place};
use rayon::prelude::*;
use std::sync::Arc;

/// Linking number of a pair, or the reason why there is none: they touch, or are too close.
pub(crate) type Number = (RingAndYarn, Counted);

/// A linking number, or the reason why there is none.
type Counted = Result<i64, (DefectKind, Place)>;

/// Two near segments: the index of the yarn in the set, and the segments of the yarn and of the
/// closed curve.
type Near = (usize, [u32; 2]);

/// Returns the linking numbers of these pairs. `periods` has the period of each curve, if it has
/// one.
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
    let curves = distinct(views.iter().flat_map(View::curves));
    let mut points = PointLimit::new(frame.curves());
    for (i, _) in &curves {
        points.add(&frame.curve(*i as usize))?;
    }
    let curves = Translated::new(curves, periods);
    let mut set = None;
    CurveSet::translate(frame, &curves, cell, &mut set)?;
    let set = set.ok_or_else(|| Error::Usage("no curves".into()))?;
    let (trees, workspaces) = (trees_of(&set), Workspaces::default());
    let input = Input {
        set: &set,
        trees: &trees,
        workspaces: &workspaces,
    };
    let number = |view: &View| (view.pair, view.linking_number(input, &curves, cell));
    Ok(views.par_iter().map(number).collect())
}

/// Returns the trees of all curves of a set, open ones included.
fn trees_of(set: &CurveSet) -> Trees {
    let mut trees = Trees::default();
    trees.refit(Leaves { set, open: true });
    trees
}

/// A closed curve, and the images of one period of a yarn that are above or below it along an axis.
struct View {
    pair: RingAndYarn,
    /// Axis of projection.
    axis: usize,
    /// First and last multiple of the period among these images.
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
        // The axis of projection along which a period is shortest, so that its projection is
        // longest.
        let size = |x: usize| period[x].abs();
        let shortest = (0..3).min_by(|&a, &b| size(a).total_cmp(&size(b)));
        let w = shortest.unwrap_or(2);
        let [u, v] = [(w + 1) % 3, (w + 2) % 3];
        let x = if size(u) >= size(v) { u } else { v };
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
            axis: w,
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

    /// Returns the linking number. The input has the translated curves of all pairs.
    fn linking_number(&self, input: Input<'_>, curves: &Translated, cell: &Cell) -> Counted {
        let set = input.set;
        let number = |key: (u32, Image)| curves.partition_point(|other| *other < key);
        let mut numbers = self.curves().map(number);
        let ring = numbers.next().unwrap_or_default();
        let yarns: Vec<usize> = numbers.collect();
        let lacks = |kind, (yarn, [s, t]): Near| {
            let place = match self.pair.ring < self.pair.yarn {
                true => closest_of_segments(set, [ring, yarn], [t, s]),
                false => {
                    // A pair has the curve with the lower index first, here the yarn, and
                    // translates the second one, so the place is translated, too.
                    let mut place = closest_of_segments(set, [yarn, ring], [s, t]);
                    let by = cell.translation(self.pair.pair().image);
                    place.point = per_axis(|x| place.point[x] + by[x]);
                    place
                }
            };
            (kind, place)
        };
        if set.basis().is_polyline() {
            let over = |&yarn: &usize| {
                let sum = self.crossings_over(input, [yarn, ring]);
                sum.map_err(|at| lacks(DefectKind::Contact, (yarn, at)))
            };
            return yarns.iter().map(over).sum();
        }
        let polylines = split(set, ring, &yarns);
        let (both, along, around) = polylines.map_err(|at| lacks(DefectKind::TooClose, at))?;
        let trees = trees_of(&both);
        let polylines = Input {
            set: &both,
            trees: &trees,
            ..input
        };
        self.crossings_over(polylines, [0, 1]).map_err(|[s, t]| {
            let (yarn, segment) = along[s as usize];
            lacks(DefectKind::Contact, (yarn, [segment, around[t as usize]]))
        })
    }

    /// Returns the sum of the signs of the crossings at which the first polyline passes over the
    /// second one, or segments that touch.
    fn crossings_over(&self, input: Input<'_>, [i, j]: [usize; 2]) -> Result<i64, [u32; 2]> {
        let above = Direction {
            axis: self.axis,
            second_over: false,
        };
        let pair = (i as u32, j as u32);
        let count = |buffers: &mut _| crossings::linking_number(input, pair, Some(above), buffers);
        match input.workspaces.run(count).0 {
            Linking::Number(sum) => Ok(sum),
            Linking::Undefined(_, place) => Err(place.segments),
        }
    }
}

/// Polylines of a whole yarn and of a closed curve. For each edge of the first one: the image of
/// the yarn, and the segment. For each edge of the second one: the segment.
type Polylines = (CurveSet, Vec<(usize, u32)>, Vec<u32>);

/// Returns a polyline of consecutive images of a yarn and a polyline of a closed spline. Together
/// they are link homotopic to the splines. Fails with two segments that are too close.
fn split(set: &CurveSet, ring: usize, yarns: &[usize]) -> Result<Polylines, Near> {
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
    let (mut of_ring, mut xyz) = (Vec::new(), Vec::new());
    let (mut along, mut edges) = (Vec::new(), Vec::new());
    for &yarn in yarns {
        near.clear();
        close.clear();
        for (s, hull) in hulls(yarn).iter().enumerate() {
            if !boxes_apart([hull, &whole], slack) {
                let others = around.iter().enumerate();
                let others = others.filter(|(_, other)| !boxes_apart([hull, other], slack));
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
        // Skips the last vertex of a period, which is the first one of the next period.
        discretize::vertices(set, yarn, &second.at, |s, p| {
            xyz.extend(p);
            along.push((yarn, s));
        });
    }
    xyz.extend(yarns.last().map(|&last| ends(last)[1]).unwrap_or_default());
    sort_splits(&mut of_ring);
    discretize::vertices(set, ring, &of_ring, |s, p| {
        xyz.extend(p);
        edges.push(s);
    });
    xyz.extend(ends(ring)[1]);
    // Both are given as open polylines, because a closed one would need three vertices.
    let counts = [along.len(), edges.len()].map(|edges| edges as i32 + 1);
    let both = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz));
    Ok((both.expect("vertices of valid curves"), along, edges))
}
