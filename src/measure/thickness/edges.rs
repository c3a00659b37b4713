//! Edges of polylines with their neighbours, and the test for a strut between two of them.

use super::approach::{Joints, Side, approach, directions};
use super::lattice::Lattice;
use super::splines;
use super::{CurvePoint, MinRad, Strut};
use crate::curve::vector::{add, add_scaled, distance, dot, norm, per_axis, sub};
use crate::curve::{Bezier, Cell, CurveSet, Image, Point, is_home, point_at};
use crate::error::Result;
use crate::pairs::{Nearest, Scale, nearest};
use crate::periodic::period;

/// Relative tolerance of the condition at a vertex. Without it, rounding could discard a strut that
/// ends at a vertex. With it, a pair may be accepted that is not a strut, but is longer than one by
/// at most this share.
pub(super) const TOLERANCE: f64 = 1e-12;

/// An edge of a polyline, or a segment of a spline, in scaled coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub start: Point,
    /// Vector from the start to the end.
    pub along: Point,
    /// Inner control points, if this is a segment of a spline.
    inner: Option<[Point; 2]>,
    pub curve: u32,
    segment: u32,
    /// Indices of the previous and the next edge of the curve; `None` at the ends of an open curve.
    /// At the ends of a yarn, these are edges of which an image continues it.
    before: Option<u32>,
    after: Option<u32>,
}

impl Edge {
    /// Returns the control points of the segment; those of an edge are its ends.
    pub fn hull(&self) -> Bezier {
        let end = add(self.start, self.along);
        let [b, c] = self.inner.unwrap_or([self.start, end]);
        [self.start, b, c, end]
    }

    /// Moves the edge.
    pub fn translate(&mut self, by: Point) {
        self.start = add(self.start, by);
        self.inner = self.inner.map(|inner| inner.map(|p| add(p, by)));
    }

    pub fn is_straight(&self) -> bool {
        self.inner.is_none()
    }

    /// Returns true if an open curve ends with this edge.
    pub fn is_last(&self) -> bool {
        self.after.is_none()
    }
}

/// All edges of positive length, or all spline segments that are not single points.
#[derive(Debug)]
pub(super) struct Edges {
    edges: Vec<Edge>,
    scale: Scale,
    /// Lattice of a periodic scene. Each curve is translated into the first cell.
    pub lattice: Option<Lattice>,
}

/// A strut: two edges and the nearest points on them. The edge that comes first in the scene is the
/// first one; `image` is the translation of the second one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub pair: [u32; 2],
    pub image: Image,
    pub at: [f64; 2],
    pub distance_sq: f64,
    /// Lower bound of the lengths of all struts that were searched for.
    pub least: f64,
}

impl Found {
    /// Returns the shorter one of two struts, with the lower bound of both.
    pub fn shorter(self, other: Found) -> Found {
        let least = self.least.min(other.least);
        let shorter = std::cmp::min_by(self, other, Found::order);
        Found { least, ..shorter }
    }

    /// Orders struts by length, and struts of equal length by their edges.
    pub fn order(&self, other: &Found) -> std::cmp::Ordering {
        let length = self.distance_sq.total_cmp(&other.distance_sq);
        let edges = |found: &Found| (found.pair, found.image);
        length.then(edges(self).cmp(&edges(other)))
    }
}

impl Edges {
    /// Returns the edges of all curves, which are periodic if there is a cell.
    ///
    /// # Errors
    ///
    /// The errors of [`Lattice::new`].
    pub fn of(set: &CurveSet, cell: Option<&Cell>) -> Result<Edges> {
        let is_polyline = set.basis().is_polyline();
        let points = (0..set.len()).flat_map(|i| set.points_in(i));
        let vectors = cell.into_iter().flat_map(|cell| cell.vectors);
        let scale = Scale::of(points.chain(vectors));
        let mut edges = Vec::with_capacity(set.segments());
        for (i, curve) in set.curves().iter().enumerate() {
            let first = edges.len();
            let mut start = scale.apply(set.knot(i, 0));
            for segment in 0..curve.segments {
                let end = scale.apply(set.knot(i, segment as usize + 1));
                let inner = (!is_polyline).then(|| {
                    let [_, b, c, _] = set.segment(i, segment as usize);
                    [b, c].map(|p| scale.apply(p))
                });
                let k = edges.len() as u32;
                let edge = Edge {
                    start,
                    along: sub(end, start),
                    inner,
                    curve: i as u32,
                    segment,
                    before: k.checked_sub(1),
                    after: Some(k + 1),
                };
                // An edge so short that its square underflows has no direction either.
                if directions(&edge.hull()).iter().any(|v| dot(*v, *v) > 0.0) {
                    edges.push(edge);
                }
                start = end;
            }
            if edges.len() > first {
                let last = edges.len() - 1;
                let continues = curve.closed || cell.is_some_and(|c| period(set, i, c).is_some());
                edges[first].before = continues.then_some(last as u32);
                edges[last].after = continues.then_some(first as u32);
            }
        }
        let lattice = cell.map(|cell| Lattice::new(&mut edges, set, cell, scale));
        let lattice = lattice.transpose()?;
        Ok(Edges {
            edges,
            scale,
            lattice,
        })
    }

    pub fn len(&self) -> usize {
        self.edges.len()
    }

    pub fn get(&self, k: u32) -> &Edge {
        &self.edges[k as usize]
    }

    /// Returns the vector along the edge before this one, unless an open curve begins with it.
    pub fn before(&self, edge: &Edge) -> Option<Point> {
        edge.before.map(|k| self.get(k).along)
    }

    /// Converts a length from the units of the scene to scaled units.
    pub fn scaled(&self, length: f64) -> f64 {
        self.scale.apply([length; 3])[0]
    }

    /// Returns the length of all curves.
    pub fn length(&self) -> f64 {
        let length = |edge: &Edge| match edge.is_straight() {
            true => norm(edge.along),
            false => splines::length(&edge.hull()),
        };
        self.scale.undo(self.edges.iter().map(length).sum())
    }

    /// Returns the sharpest bend.
    pub fn min_rad(&self) -> Option<MinRad> {
        let bend = |e: &Edge| -> Option<(f64, u32)> {
            let after = e.after?;
            let next = self.get(after);
            let [a, b] = [e.along, next.along].map(norm);
            let [u, v] = [(e.along, a), (next.along, b)].map(|(d, l)| d.map(|x| x / l));
            // Sine and cosine of half the turning angle between two unit vectors, doubled.
            let sine = norm(sub(u, v));
            let cosine = norm([u[0] + v[0], u[1] + v[1], u[2] + v[2]]);
            (sine > 0.0).then(|| (0.5 * a.min(b) * cosine / sine, after))
        };
        let bends = self.edges.iter().filter_map(bend);
        let (radius, k) = bends.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let edge = self.get(k);
        Some(MinRad {
            radius: self.scale.undo(radius),
            error: 0.0,
            curve: edge.curve,
            vertex: edge.segment,
            t: 0.0,
            point: self.given(edge, 0.0),
        })
    }

    /// Returns true if an image of an edge begins where an edge ends.
    fn follows(&self, edge: u32, next: u32, image: Image) -> bool {
        let Edge { after, curve, .. } = *self.get(edge);
        let joint = |lattice: &Lattice| lattice.periods[curve as usize];
        let lattice = self.lattice.as_ref().filter(|_| next <= edge);
        after == Some(next) && image == lattice.map(joint).unwrap_or_default()
    }

    /// Returns the strut between an edge and an image of another one or of itself, if there is one
    /// of at most this squared length.
    pub fn strut_between(&self, i: u32, j: u32, image: Image, limit_sq: f64) -> Option<Found> {
        let backward = image.map(|n| -n);
        let (pair @ [i, j], image, backward) = match i <= j {
            true => ([i, j], image, backward),
            false => ([j, i], backward, image),
        };
        let is_same = i == j && is_home(&image);
        let follows = [self.follows(i, j, image), self.follows(j, i, backward)];
        let (a, b) = (self.get(i), &self.moved(self.get(j), image));
        let strut = |at, distance_sq, least| Found {
            pair,
            image,
            at,
            distance_sq,
            least,
        };
        if !a.is_straight() {
            let joints = Joints { is_same, follows };
            let found = approach([&self.side(a), &self.side(b)], joints, limit_sq)?;
            return Some(strut(found.at, found.distance_sq, found.least));
        }
        if is_same || follows.contains(&true) {
            return None;
        }
        let mut near = nearest([a.start, a.along], [b.start, b.along]);
        if near.distance_sq > limit_sq {
            return None;
        }
        let is_end = |t: f64| t == 0.0 || t == 1.0;
        if is_end(near.s) || is_end(near.t) {
            // Parallel edges have the same distance along their overlap. The middle of it is used,
            // because rounding could otherwise choose an end, which belongs to a neighbour, for
            // every pair of edges.
            let middle = middle_of_overlap(a, b);
            if middle.distance_sq <= near.distance_sq * (1.0 + TOLERANCE) {
                near = middle;
            }
        }
        let from = add_scaled(a.start, near.s, a.along);
        let between = sub(add_scaled(b.start, near.t, b.along), from);
        let length = near.distance_sq.sqrt();
        let critical = self.is_critical(a, near.s, between, length)
            && self.is_critical(b, near.t, between.map(|x| -x), length);
        critical.then(|| strut([near.s, near.t], near.distance_sq, length))
    }

    /// Returns a segment of a spline, with the directions of its neighbours.
    pub fn side(&self, edge: &Edge) -> Side {
        let neighbour = |k: Option<u32>| k.map(|k| self.get(k).hull());
        Side::new(edge.hull(), [edge.before, edge.after].map(neighbour))
    }

    /// Returns true if the distance from a point of an edge to the other point does not decrease
    /// along the previous edge either (Lemma 2.1). On `edge` itself, the point is the nearest one.
    /// `toward` is the vector to the other point. A vertex belongs to the edge that starts there.
    fn is_critical(&self, edge: &Edge, at: f64, toward: Point, length: f64) -> bool {
        if at == 1.0 && !edge.is_last() {
            return false;
        }
        let before = self.before(edge).filter(|_| at == 0.0);
        before.is_none_or(|before| {
            // If the points touch, the vector between them is only a rounding error.
            let rounding = 8.0 * f64::EPSILON * (norm(edge.start) + norm(edge.along));
            dot(before, toward) >= -norm(before) * (TOLERANCE * length + rounding)
        })
    }

    /// Returns true if neither end of a strut is at the end of its edge, where the next edge starts
    /// and owns the strut.
    pub fn owns(&self, found: &Found) -> bool {
        let mut ends = found.pair.into_iter().zip(found.at);
        ends.all(|(edge, at)| at < 1.0 || self.get(edge).is_last())
    }

    /// Returns an image of an edge.
    fn moved(&self, edge: &Edge, image: Image) -> Edge {
        let mut moved = *edge;
        if let Some(lattice) = self.lattice.as_ref().filter(|_| !is_home(&image)) {
            moved.translate(lattice.cell.translation(image));
        }
        moved
    }

    /// Returns the translation of an image, and a bound on the rounding errors of translated edges.
    pub fn shift(&self, image: Image) -> (Point, f64) {
        match &self.lattice {
            Some(lattice) if !is_home(&image) => {
                let by = lattice.cell.translation(image);
                (by, TOLERANCE * (norm(by) + lattice.size))
            }
            _ => ([0.0; 3], 0.0),
        }
    }

    /// Converts a strut to the units and the coordinates of the scene.
    pub fn strut(&self, found: &Found) -> Strut {
        let backward = found.image.map(|n| -n);
        let edges = found.pair.map(|k| self.get(k));
        // If both edges are of one curve, the translation of the second one is positive in
        // lexicographic order.
        let (edges, at, image) = match edges[0].curve == edges[1].curve && backward > found.image {
            true => ([edges[1], edges[0]], [found.at[1], found.at[0]], backward),
            false => (edges, found.at, found.image),
        };
        let [first, second] = edges.map(|edge| self.home(edge.curve));
        let image = per_axis(|x| image[x] + second[x] - first[x]);
        let end = |k: usize, image: Image| {
            let edge = edges[k];
            CurvePoint {
                curve: edge.curve,
                segment: edge.segment,
                t: at[k],
                point: self.given(&self.moved(edge, image), at[k]),
            }
        };
        let ends = [end(0, Image::default()), end(1, image)];
        let length = match found.distance_sq.sqrt() {
            // An infinite length means that the approach could not be resolved. Then the distance
            // of the two points is used.
            f64::INFINITY => distance(ends[0].point, ends[1].point),
            length => self.scale.undo(length),
        };
        Strut {
            ends,
            image,
            length,
            error: length - self.scale.undo(found.least),
        }
    }

    /// Returns the translation that brings a curve into the first cell.
    fn home(&self, curve: u32) -> Image {
        let home = |lattice: &Lattice| lattice.homes[curve as usize];
        self.lattice.as_ref().map_or_else(Image::default, home)
    }

    /// Returns a point of an edge in the coordinates in which the curve was given.
    fn given(&self, edge: &Edge, at: f64) -> Point {
        let back = self.home(edge.curve).map(|n| -n);
        let edge = self.moved(edge, back);
        let point = match edge.is_straight() {
            true => add_scaled(edge.start, at, edge.along),
            false => point_at(&edge.hull(), at),
        };
        point.map(|x| self.scale.undo(x))
    }
}

/// Returns the nearest points of two parallel edges in the middle of their overlap.
fn middle_of_overlap(a: &Edge, b: &Edge) -> Nearest {
    let on = |edge: &Edge, point: Point| {
        let along = edge.along;
        (dot(along, sub(point, edge.start)) / dot(along, along)).clamp(0.0, 1.0)
    };
    let ends = [0.0, 1.0].map(|t| on(a, add_scaled(b.start, t, b.along)));
    let s = 0.5 * (ends[0] + ends[1]);
    let first = add_scaled(a.start, s, a.along);
    let t = on(b, first);
    let between = sub(add_scaled(b.start, t, b.along), first);
    Nearest {
        s,
        t,
        distance_sq: dot(between, between),
    }
}
