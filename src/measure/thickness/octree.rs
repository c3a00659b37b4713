//! Octree over the edges, built from octal tags (section 3, Algorithm 3), and its search with ramps
//! (section 4, Algorithm 4).

use super::approach::{ACCURACY, Side};
use super::edges::{Edge, Edges, Found, TOLERANCE};
use crate::curve::vector::{add, dot, per_axis, sub};
use crate::curve::{Image, Point, bounds, union};
use crate::error::Result;
use rayon::prelude::*;
use std::ops::Range;

/// Maximum number of bits of a box number along an axis, three of which fit into a tag.
const MOST_BITS: u32 = 21;

/// Number of edges that a task searches.
const CHUNK: usize = 128;

/// Number of tasks of the first batch. The next one has twice as many, and so on.
const FIRST_BATCH: usize = 4;

/// A box, axis-aligned: smallest and largest coordinates.
type Bounds = [Point; 2];

/// Returns a lower bound of the squared distance between two boxes, rounding included.
fn distance_sq(a: &Bounds, b: &Bounds) -> f64 {
    let gap = per_axis(|x| (a[0][x] - b[1][x]).max(b[0][x] - a[1][x]).max(0.0));
    dot(gap, gap) * (1.0 - TOLERANCE)
}

/// A node in the order of a traversal, children after their parent.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// Its edges in [`Octree::order`].
    first: u32,
    end: u32,
    /// Next node that is not a descendant of this one.
    skip: u32,
    is_leaf: bool,
}

/// The octree. Its nodes are in one array, in which a search only moves forward.
#[derive(Debug)]
pub(super) struct Octree {
    nodes: Vec<Node>,
    /// Edges, sorted by octal tag.
    order: Vec<u32>,
    /// Bounds of the edges in this order.
    bounds: Vec<Bounds>,
}

/// Tree under construction.
struct Builder<'a> {
    tags: &'a [u64],
    bounds: &'a [Bounds],
    /// Maximum number of edges of a leaf.
    most: usize,
    nodes: Vec<Node>,
}

impl Builder<'_> {
    /// Adds the node of a range of edges whose tags agree in all digits before `digit`, counted
    /// from the least significant one. Skips nodes with a single child.
    fn add(&mut self, range: Range<usize>, digit: u32) {
        let at = self.nodes.len();
        let octant = |k: usize| self.tags[k] >> (3 * (digit - 1)) & 7;
        let is_leaf = digit == 0 || range.len() <= self.most;
        if !is_leaf && octant(range.start) == octant(range.end - 1) {
            return self.add(range, digit - 1);
        }
        self.nodes.push(Node {
            bounds: bounds([]),
            first: range.start as u32,
            end: range.end as u32,
            skip: 0,
            is_leaf,
        });
        let mut around = bounds([]);
        if is_leaf {
            around = self.bounds[range].iter().copied().fold(around, union);
        } else {
            let mut start = range.start;
            while start < range.end {
                let octant = self.tags[start] >> (3 * (digit - 1));
                let same = |tag: &u64| *tag >> (3 * (digit - 1)) == octant;
                let end = start + self.tags[start..range.end].partition_point(same);
                let child = self.nodes.len();
                self.add(start..end, digit - 1);
                around = union(around, self.nodes[child].bounds);
                start = end;
            }
        }
        self.nodes[at].bounds = around;
        self.nodes[at].skip = self.nodes.len() as u32;
    }
}

/// Region that contains the other end of every strut which starts on an edge: the slab between the
/// planes orthogonal to it at its ends, and a wedge at its start (Definition 4). Beyond an open end
/// it is a half-space.
struct Ramp<'a> {
    edge: &'a Edge,
    length_sq: f64,
    /// Vector along the edge before it.
    before: Option<Point>,
    bounds: Bounds,
    /// The spline segment that replaces the ramp, for splines.
    side: Option<Side>,
}

impl Ramp<'_> {
    /// Returns true if a box may intersect the ramp.
    fn meets(&self, [lo, hi]: &Bounds) -> bool {
        let middle = per_axis(|x| 0.5 * (lo[x] + hi[x]));
        let half = per_axis(|x| 0.5 * (hi[x] - lo[x]));
        if let Some(side) = &self.side {
            return side.may_face(middle, half);
        }
        let center = sub(middle, self.edge.start);
        // Range of the scalar products of the box with a vector, widened by the rounding errors.
        let range = |v: Point| {
            let middle = dot(v, center);
            let size = v.map(f64::abs);
            let reach = dot(size, half);
            let reach = reach + TOLERANCE * (dot(size, center.map(f64::abs)) + reach);
            (middle - reach, middle + reach)
        };
        let (least, greatest) = range(self.edge.along);
        let beyond_start = greatest >= 0.0;
        let before_end = least <= self.length_sq;
        if beyond_start && (before_end || self.edge.is_last()) {
            return true;
        }
        least <= 0.0 && self.before.is_none_or(|before| range(before).1 >= 0.0)
    }
}

impl Octree {
    /// Builds the tree, with `ceil(3/4 log2 n)` levels as in section 5.
    pub fn new(edges: &Edges) -> Octree {
        let n = edges.len();
        let levels = (0.75 * (n.max(2) as f64).log2()).ceil() as u32;
        let bits = (levels - 1).min(MOST_BITS);
        let most = n.div_ceil(1 << bits).max(1);
        let middle = |k: u32, x: usize| {
            let edge = edges.get(k);
            edge.start[x] + 0.5 * edge.along[x]
        };
        let mut tags = vec![0; n];
        for x in 0..3 {
            let mut sorted: Vec<(f64, u32)> = (0..n as u32).map(|k| (middle(k, x), k)).collect();
            sorted.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for (rank, &(_, k)) in sorted.iter().enumerate() {
                tags[k as usize] |= spread((rank / most) as u64) << x;
            }
        }
        let mut order: Vec<(u64, u32)> = tags.into_iter().zip(0..).collect();
        order.par_sort_unstable();
        let (tags, order): (Vec<u64>, Vec<u32>) = order.into_iter().unzip();
        let bounds: Vec<Bounds> = order.iter().map(|&k| bounds(edges.get(k).hull())).collect();
        let mut builder = Builder {
            tags: &tags,
            bounds: &bounds,
            most,
            nodes: Vec::new(),
        };
        if n > 0 {
            builder.add(0..n, bits);
        }
        Octree {
            nodes: builder.nodes,
            order,
            bounds,
        }
    }

    /// Returns the shortest strut.
    ///
    /// # Errors
    ///
    /// The errors of [`Edges::check_images`].
    pub fn shortest(&self, edges: &Edges) -> Result<Option<Found>> {
        let Some(found) = self.shortest_below(edges, f64::INFINITY)? else {
            return Ok(None);
        };
        let resolved = found.distance_sq.sqrt() * (1.0 - ACCURACY);
        if found.least >= resolved || found.distance_sq.is_infinite() {
            return Ok(Some(found));
        }
        // Parts of splines that the first search could not resolve are searched again up to this
        // strut.
        let limit_sq = found.distance_sq * (1.0 + 1e-12);
        let found = Found {
            least: resolved,
            ..found
        };
        let again = self.shortest_below(edges, limit_sq)?;
        Ok(again.map(|again| again.shorter(found)).or(Some(found)))
    }

    /// Returns the shortest strut whose squared length is less than a limit.
    fn shortest_below(&self, edges: &Edges, limit_sq: f64) -> Result<Option<Found>> {
        let home = self.shortest_of(edges, false, limit_sq);
        if edges.lattice.is_none() {
            return Ok(home);
        }
        let length_sq = home.map_or(limit_sq, |found| found.distance_sq);
        let limit_sq = length_sq.min(edges.bound_sq());
        edges.check_images(limit_sq)?;
        let images = self.shortest_of(edges, true, limit_sq);
        Ok(home.into_iter().chain(images).reduce(Found::shorter))
    }

    /// Returns the shortest strut of at most a squared length, between edges and images of edges or
    /// between edges only.
    ///
    /// A task knows the shortest strut of all earlier batches, but not those of its own batch, so
    /// that the result does not depend on the number of threads.
    fn shortest_of(&self, edges: &Edges, images: bool, limit_sq: f64) -> Option<Found> {
        let search = |chunk: usize, mut best: Option<Found>| {
            for k in self.chunk(chunk) {
                let limit = best.map_or(limit_sq, |best| best.distance_sq);
                self.search(edges, k, images, limit, |found| {
                    best = Some(best.map_or(found, |best| best.shorter(found)));
                    found.distance_sq
                });
            }
            best
        };
        let (mut best, mut start, mut count) = (None, 0, FIRST_BATCH);
        while start < self.chunks() {
            let end = self.chunks().min(start + count);
            let batch = (start..end).into_par_iter();
            let found = batch.filter_map(|chunk| search(chunk, best));
            best = found.reduce_with(Found::shorter).or(best);
            (start, count) = (end, 2 * count);
        }
        best
    }

    /// Returns all struts up to a length.
    ///
    /// # Errors
    ///
    /// The errors of [`Edges::check_images`].
    pub fn up_to(&self, edges: &Edges, longest: f64) -> Result<Vec<Found>> {
        let limit_sq = edges.scaled(longest).powi(2);
        edges.check_images(limit_sq)?;
        let search = |chunk: usize| {
            let mut all = Vec::new();
            for k in self.chunk(chunk) {
                for images in [false, true] {
                    self.search(edges, k, images, limit_sq, |found| {
                        let is_near = found.distance_sq <= limit_sq;
                        all.extend((is_near && edges.owns(&found)).then_some(found));
                        limit_sq
                    });
                }
            }
            all
        };
        let all = (0..self.chunks()).into_par_iter();
        Ok(all.flat_map_iter(search).collect())
    }

    fn chunks(&self) -> usize {
        self.order.len().div_ceil(CHUNK)
    }

    fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * CHUNK..((chunk + 1) * CHUNK).min(self.order.len())
    }

    /// Passes the struts between the edge at place `k` and earlier edges to `found`, if their
    /// squared length is at most the limit. So each pair of edges is compared once. With `images`,
    /// passes the struts between this edge and all images of edges instead, for one of each two
    /// opposite images. `found` returns the limit for the struts that follow.
    fn search(
        &self,
        edges: &Edges,
        k: usize,
        images: bool,
        mut limit: f64,
        mut found: impl FnMut(Found) -> f64,
    ) {
        let edge = edges.get(self.order[k]);
        let ramp = Ramp {
            edge,
            length_sq: dot(edge.along, edge.along),
            before: edges.before(edge),
            bounds: self.bounds[k],
            side: (!edge.is_straight()).then(|| edges.side(edge)),
        };
        let home = (!images).then(Image::default);
        let others = images.then(|| edges.images(self.order[k], limit));
        for image in home.into_iter().chain(others.into_iter().flatten()) {
            // Nodes after this place have only later edges, which are not compared with this one. A
            // spline segment is also compared with itself.
            let end = match images {
                true => self.order.len(),
                false => k + usize::from(!edge.is_straight()),
            };
            let (by, pad) = edges.shift(image);
            let may_be_near = |bounds: &Bounds, limit: f64| {
                let [lo, hi] = bounds.map(|p| add(p, by));
                let moved = [lo.map(|x| x - pad), hi.map(|x| x + pad)];
                distance_sq(&ramp.bounds, &moved) <= limit && ramp.meets(&moved)
            };
            let mut at = 0;
            while let Some(node) = self.nodes.get(at)
                && (node.first as usize) < end
            {
                if !may_be_near(&node.bounds, limit) {
                    at = node.skip as usize;
                    continue;
                }
                at += 1;
                if !node.is_leaf {
                    continue;
                }
                for other in node.first as usize..(node.end as usize).min(end) {
                    if may_be_near(&self.bounds[other], limit) {
                        let pair = (self.order[k], self.order[other]);
                        if let Some(strut) = edges.strut_between(pair.0, pair.1, image, limit) {
                            limit = limit.min(found(strut));
                        }
                    }
                }
            }
        }
    }
}

/// Moves bit `k` of a number to bit `3 k`.
fn spread(number: u64) -> u64 {
    (0..MOST_BITS).fold(0, |x, k| x | (number >> k & 1) << (3 * k))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_the_bits() {
        for number in [0, 1, 0b1101, 0x1f_ffff, 0x15_5555] {
            let slow = (0..MOST_BITS).fold(0, |x, k| x | (number >> k & 1) << (3 * k));
            assert_eq!(spread(number), slow, "{number:b}");
        }
        assert_eq!(spread(0b1101), 0b1_001_000_001);
    }
}
