//! Projection of closed polylines to a diagram: all crossings, in their order along the curves.
//!
//! # Derivation: what a crossing is
//!
//! Let `u` and `w` be the vectors of edges `p` and `q`, `d` the direction towards the viewer, and
//! `r = q0 - p0`. The edges cross in the projection if the ends of each lie on different sides of
//! the other one, so that `s u - t w + h d = r` with `s` and `t` in `(0, 1)`. By Cramer's rule, `q`
//! is above `p` by `h = det[u, w, r] / det[u, w, d]`. The numerator is `orient3d(p0, p1, q0, q1)`.
//! The sign of the crossing is that of `det[over, under, d]`: 1 if the upper edge turns
//! counterclockwise to the lower one. If `h < 0`, `p` is over `q`, and the sign is that of
//! `det[u, w, d]`; if `h > 0`, it is the opposite one. Both are the opposite sign of
//! `det[u, w, r]`.
//!
//! # Ties
//!
//! If the area of an edge `e` and a vertex `v` is 0, there are three cases. Edges that share a
//! point in space are in contact. If `v` lies on the line of `e` in space, but not on `e`, the edge
//! that begins at `v` does not cross `e`: its projection meets the line of `e` at `v` only, unless
//! its other end ties as well. In any other case the direction is degenerate, and another one is
//! drawn. The degenerate directions of a polygon lie in finitely many planes, so that almost no
//! direction is degenerate.

use crate::curve::vector::{distance, dot, mix};
use crate::curve::{Box3, CurveSet, Point, bounds};
use crate::exact::{Direction, Predicates, Seen, are_collinear, segments_touch};
use crate::pairs::{LinkSearch, closest_of_segments};
use crate::random::Random;
use crate::verdict::{Defect, DefectKind};
use rayon::prelude::*;
use std::cell::Cell;
use std::cmp::Ordering;

/// Number of pairs of edges that a thread tests at least.
const PART: usize = 1024;

/// Passages of all components in order, and the signs of the crossings. A passage is twice the
/// index of its crossing, plus 1 if it is above.
pub(super) type GaussCode = (Vec<Vec<u32>>, Vec<i8>);

/// Height of one edge over another one at their crossing, and their segments.
pub(super) type Height = (f64, [u32; 2]);

/// Reason why a direction gives no diagram.
#[derive(Clone, Copy, Debug)]
enum Stop {
    /// Edges that share a point.
    Contact([u32; 2]),
    Degenerate,
}

/// Position of a crossing on an edge, with an error bound.
#[derive(Clone, Copy, Debug)]
struct Parameter {
    value: f64,
    bound: f64,
}

impl Parameter {
    /// Returns the position on an edge, given the areas of its start and of its end, which have
    /// different signs.
    fn new([start, end]: [Seen; 2]) -> Parameter {
        let whole = start.value.abs() + end.value.abs();
        let error = start.bound + end.bound;
        Parameter {
            value: start.value.abs() / whole,
            bound: error / (whole - error).max(0.0) + 4.0 * f64::EPSILON,
        }
    }
}

/// A crossing of two edges.
#[derive(Debug)]
struct EdgeCrossing {
    edges: [u32; 2],
    at: [Parameter; 2],
    /// True if the first edge is above.
    over: bool,
    sign: i8,
}

/// Crossings of a diagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Crossings {
    All,
    /// Only crossings of different curves. A curve may touch itself.
    OfDifferentCurves,
}

/// Edges of the curves, except edges of length 0.
pub(super) struct Edges {
    ends: Vec<[Point; 2]>,
    /// The next edge of the same curve.
    next: Vec<u32>,
    /// Index of the curve among those of the diagram, and segment.
    origin: Vec<(u32, u32)>,
    kind: Crossings,
    direction: Direction,
    axis: usize,
}

/// Projects closed polylines. Returns their Gauss code.
pub(super) fn project(
    set: &CurveSet,
    curves: &[u32],
    kind: Crossings,
) -> Result<GaussCode, Defect> {
    let mut edges = Edges::new(set, curves)?;
    edges.kind = kind;
    let projected = edges.in_general_direction(curves[0]);
    projected.map(|(code, _)| code).map_err(|pair| {
        let mut at = pair.map(|e| edges.origin[e as usize]);
        at.sort_by_key(|&(curve, segment)| (curves[curve as usize], segment));
        let [i, j] = at.map(|(curve, _)| curves[curve as usize]);
        let segments = at.map(|(_, segment)| segment);
        let place = closest_of_segments(set, [i as usize, j as usize], segments);
        Defect::of_pair((i, j), DefectKind::Contact, place)
    })
}

impl Edges {
    pub(super) fn new(set: &CurveSet, curves: &[u32]) -> Result<Edges, Defect> {
        let mut edges = Edges {
            ends: Vec::new(),
            next: Vec::new(),
            origin: Vec::new(),
            kind: Crossings::All,
            direction: Direction::new([0, 0, 1]),
            axis: 2,
        };
        for (index, &i) in (0..).zip(curves) {
            let first = edges.ends.len() as u32;
            let segments = set.curve(i as usize).segments;
            for s in 0..segments {
                let ends = [s, s + 1].map(|k| set.knot(i as usize, k as usize));
                if ends[0] != ends[1] {
                    edges.ends.push(ends);
                    edges.origin.push((index, s));
                    edges.next.push(edges.ends.len() as u32);
                }
            }
            if edges.ends.len() as u32 - first < 3 {
                let place = closest_of_segments(set, [i as usize; 2], [0, 0]);
                let defect = Defect::of_pair((i, i), DefectKind::Degenerate, place);
                return Err(Defect { j: None, ..defect });
            }
            *edges.next.last_mut().expect("three edges") = first;
        }
        Ok(edges)
    }

    /// Projects along random directions until one is not degenerate. Returns the code and the
    /// crossings, or two edges that share a point.
    fn in_general_direction(
        &mut self,
        seed: u32,
    ) -> Result<(GaussCode, Vec<EdgeCrossing>), [u32; 2]> {
        let mut random = Random::new(seed.into());
        loop {
            self.draw_direction(&mut random);
            match self.gauss_code() {
                Ok(code) => return Ok(code),
                Err(Stop::Degenerate) => {}
                Err(Stop::Contact(pair)) => return Err(pair),
            }
        }
    }

    /// Returns the code with, for each crossing, the approximate height of one edge over the other
    /// one, and their segments; `None` if curves touch.
    pub(super) fn with_heights(&mut self) -> Option<(GaussCode, Vec<Height>)> {
        let (code, found) = self.in_general_direction(0).ok()?;
        let heights = found.iter().map(|f| {
            let [p, q] = [0, 1].map(|k| {
                let [start, end] = self.ends[f.edges[k] as usize];
                mix(start, end, f.at[k].value)
            });
            (distance(p, q), f.edges.map(|e| self.origin[e as usize].1))
        });
        Some((code, heights.collect()))
    }

    /// Draws a direction near the axis along which the curves are thinnest, as that gives few
    /// crossings.
    fn draw_direction(&mut self, random: &mut Random) {
        let [low, high] = bounds(self.ends.iter().map(|[start, _]| *start));
        let extent = |x: &usize| high[*x] / 2.0 - low[*x] / 2.0;
        let thinnest = (0..3).min_by(|a, b| extent(a).total_cmp(&extent(b)));
        self.axis = thinnest.unwrap_or(2);
        let mut components = [(); 3].map(|()| (random.next() >> 36) as i32 - (1 << 27));
        components[self.axis] = (1 << 30) - 1;
        self.direction = Direction::new(components);
    }

    fn gauss_code(&self) -> Result<(GaussCode, Vec<EdgeCrossing>), Stop> {
        if self.kind == Crossings::All {
            self.check_corners()?;
        }
        let found = self.crossings()?;
        // Edge, crossing, and index of the edge within the crossing.
        let mut events: Vec<(u32, u32, usize)> = Vec::with_capacity(2 * found.len());
        for (crossing, f) in (0..).zip(&found) {
            events.extend([0, 1].map(|side| (f.edges[side], crossing, side)));
        }
        let tie = Cell::new(false);
        // A curve that runs along itself is crossed twice at one place. The order of two crossings
        // of the same curves has no influence on the invariants of different curves.
        let is_tie = |both: [&(u32, u32, usize); 2]| {
            let [a, b] = both.map(|e| self.origin[found[e.1 as usize].edges[1 - e.2] as usize].0);
            both[0].1 != both[1].1 && (self.kind == Crossings::All || a != b)
        };
        events.sort_unstable_by(|a, b| {
            a.0.cmp(&b.0).then_with(|| {
                let order = self.order(a.0, [a, b].map(|e| (&found[e.1 as usize], e.2)));
                if order.is_eq() && is_tie([a, b]) {
                    tie.set(true);
                }
                order
            })
        });
        if tie.get() {
            return Err(Stop::Degenerate);
        }
        let components = self.origin.last().map_or(0, |(index, _)| index + 1);
        let mut passages = vec![Vec::new(); components as usize];
        for &(edge, crossing, side) in &events {
            let over = found[crossing as usize].over == (side == 0);
            let component = self.origin[edge as usize].0 as usize;
            passages[component].push(2 * crossing + u32::from(over));
        }
        let signs = found.iter().map(|f| f.sign).collect();
        Ok(((passages, signs), found))
    }

    /// Compares the positions of two crossings on an edge.
    fn order(&self, edge: u32, both: [(&EdgeCrossing, usize); 2]) -> Ordering {
        let [a, b] = both.map(|(found, side)| found.at[side]);
        let apart = a.value - b.value;
        if apart.abs() > a.bound + b.bound {
            return apart.total_cmp(&0.0);
        }
        let [q, r] = both.map(|(found, side)| self.ends[found.edges[1 - side] as usize]);
        self.direction.compare_along(self.ends[edge as usize], q, r)
    }

    /// Checks that no edge folds back onto the next one, in space or in the projection.
    fn check_corners(&self) -> Result<(), Stop> {
        for (edge, [a, v]) in self.ends.iter().enumerate() {
            let next = self.next[edge];
            let b = self.ends[next as usize][1];
            if self.direction.area([*a, *v, b]).sign != 0 {
                continue;
            }
            if !are_collinear([*a, *v, b], &mut Predicates::default()) {
                return Err(Stop::Degenerate);
            }
            let folds = (0..3).any(|x| v[x] != a[x] && (v[x] > a[x]) != (b[x] > v[x]));
            if folds {
                return Err(Stop::Contact([edge as u32, next]));
            }
        }
        Ok(())
    }

    /// Returns the crossing of two edges that are not neighbours.
    fn crossing(&self, edges: [u32; 2]) -> Result<Option<EdgeCrossing>, Stop> {
        let [p, q] = edges.map(|e| self.ends[e as usize]);
        let areas = |e: [Point; 2], ends: [Point; 2]| {
            let area = |v: Point| self.direction.area([e[0], e[1], v]);
            let seen = [area(ends[0]), area(ends[1])];
            (seen[0].sign * seen[1].sign <= 0).then_some(seen)
        };
        let both = areas(p, q).and_then(|of_q| Some((of_q, areas(q, p)?)));
        let Some((of_q, of_p)) = both else {
            return Ok(None);
        };
        let mut predicates = Predicates::default();
        let ties = |(seen, edge, ends): ([Seen; 2], [Point; 2], [Point; 2])| {
            let tied = (0..2).filter(move |&k| seen[k].sign == 0);
            tied.map(move |k| [edge[0], edge[1], ends[k]])
        };
        let ties = [(of_q, p, q), (of_p, q, p)].into_iter().flat_map(ties);
        let mut ties = ties.peekable();
        if ties.peek().is_some() {
            if segments_touch(&[p, q]) {
                return Err(Stop::Contact(edges));
            }
            return match ties.all(|points| are_collinear(points, &mut predicates)) {
                true => Ok(None),
                false => Err(Stop::Degenerate),
            };
        }
        let height = predicates.orient3d(p[0], p[1], q[0], q[1]);
        if height == 0 {
            return Err(Stop::Contact(edges));
        }
        Ok(Some(EdgeCrossing {
            edges,
            at: [of_p, of_q].map(Parameter::new),
            over: height * of_q[1].sign < 0,
            sign: -height as i8,
        }))
    }

    /// Finds all crossings: pairs of edges whose boxes in the projection overlap.
    fn crossings(&self) -> Result<Vec<EdgeCrossing>, Stop> {
        let functions = self.direction.functions(self.axis);
        let boxes = self.ends.iter().map(|e| self.boxed(e, &functions));
        let boxes: Vec<Box3> = boxes.collect();
        let mut search = LinkSearch::default();
        let pairs = search.find(&boxes);
        let curve = |e: u32| self.origin[e as usize].0;
        pairs.retain(|&(g, h)| match self.kind {
            Crossings::All => self.next[g as usize] != h && self.next[h as usize] != g,
            Crossings::OfDifferentCurves => curve(g) != curve(h),
        });
        let pairs = pairs.par_iter().with_min_len(PART);
        let found = pairs.filter_map(|&(g, h)| self.crossing([g, h]).transpose());
        let found: Vec<Result<EdgeCrossing, Stop>> = found.collect();
        found.into_iter().collect()
    }

    /// Returns the bounds of an edge along functions that are constant along the direction.
    fn boxed(&self, ends: &[Point; 2], functions: &[Point; 3]) -> Box3 {
        let range = functions.map(|f| {
            let [a, b] = ends.map(|p| dot(f, p));
            // Each product and each of the two sums is rounded once.
            let size = ends.map(|p| dot(f.map(f64::abs), p.map(f64::abs)));
            let pad = 2.0 * f64::EPSILON * size[0].max(size[1]) + f64::MIN_POSITIVE;
            match pad.is_finite() {
                true => [a.min(b) - pad, a.max(b) + pad],
                false => [f64::MIN, f64::MAX],
            }
        });
        Box3::around([range.map(|r| r[0]), range.map(|r| r[1])])
    }
}
