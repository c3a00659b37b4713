//! Images of the edges of a periodic scene.
//!
//! # Which images may be near
//!
//! Fractional coordinates are scalar products with the vectors `b` of the inverse of the cell;
//! those of a lattice vector are integers. The fractional coordinates of two points at a distance
//! `d` differ by at most `|b| d`. So an edge is within `d` of an image `n` of some edge only if, in
//! each direction, the range of its coordinates, grown by `|b| d`, overlaps the range of all edges,
//! translated by `n`. The ranges are padded by `1e-7` of all numbers involved, which covers the
//! rounding of the inverse ([`crate::periodic`] derives it).
//!
//! Each curve is translated by the lattice vector that brings it closest to the first cell, so that
//! few images are near.

use super::edges::{Edge, Edges};
use crate::curve::vector::{add, dot, norm, per_axis};
use crate::curve::{Cell, CurveSet, Image, Point, bounds, is_home, union};
use crate::error::{Error, Result};
use crate::pairs::Scale;
use crate::periodic::{home_of, images_in, is_multiple, period, too_far};

/// Padding of fractional coordinates, relative to the largest number involved or to 1, whichever is
/// larger.
const PAD: f64 = 1e-7;

/// Maximum number of images that are compared with an edge.
const MOST_IMAGES: f64 = (1_u32 << 24) as f64;

/// The lattice of a periodic scene, in the scaled coordinates of its edges.
#[derive(Debug)]
pub(super) struct Lattice {
    pub cell: Cell,
    inverse: [Point; 3],
    /// Translation that brings each curve from its given coordinates to the first cell.
    pub homes: Vec<Image>,
    /// Period of each curve; zeros if it does not run through the cell.
    pub periods: Vec<Image>,
    /// Smallest and largest fractional coordinates of all edges.
    around: [Point; 2],
    /// Length of some strut, if there is any strut: the shortest one is at most as long.
    bound: f64,
    /// Largest magnitude of the coordinates of all edges.
    pub size: f64,
}

impl Lattice {
    /// Moves the edges of all curves to the first cell.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the cell is no lattice, or a curve spans too many cells.
    pub fn new(edges: &mut [Edge], set: &CurveSet, cell: &Cell, scale: Scale) -> Result<Lattice> {
        cell.check()?;
        let periods = (0..set.len()).map(|i| period(set, i, cell).unwrap_or_default());
        let cell = Cell {
            origin: [0.0; 3],
            vectors: cell.vectors.map(|v| scale.apply(v)),
        };
        let inverse = cell.inverse().ok_or_else(|| {
            let what = format!("cell {cell}: beyond the range of the coordinates");
            Error::Usage(what)
        })?;
        let mut lattice = Lattice {
            cell,
            inverse,
            homes: vec![Image::default(); set.len()],
            periods: periods.collect(),
            around: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]],
            bound: f64::INFINITY,
            size: 0.0,
        };
        for edges in edges.chunk_by_mut(|a, b| a.curve == b.curve) {
            lattice.bring_home(edges)?;
        }
        let bounds = edges.iter().flat_map(Edge::hull).map(|p| [p, p]);
        let bounds = bounds.reduce(union).unwrap_or_default();
        let extent = norm(per_axis(|x| bounds[1][x] - bounds[0][x]));
        lattice.bound = lattice.bound_of(edges, extent);
        let numbers = bounds.as_flattened().iter();
        lattice.size = numbers.fold(0.0, |most, x| most.max(x.abs()));
        Ok(lattice)
    }

    /// Returns the smallest and largest fractional coordinates of an edge.
    fn range(&self, edge: &Edge) -> [Point; 2] {
        let fractional = |p: Point| self.inverse.map(|b| dot(b, p));
        bounds(edge.hull().map(fractional))
    }

    /// Translates the edges of a curve into the first cell.
    fn bring_home(&mut self, edges: &mut [Edge]) -> Result<()> {
        let curve = edges[0].curve as usize;
        let ranges = edges.iter().map(|edge| self.range(edge));
        let range = ranges.reduce(union).expect("a curve has edges");
        let home = home_of(&range, self.cell.periodic()).ok_or_else(|| too_far(curve))?;
        if !is_home(&home) {
            let by = self.cell.translation(home);
            edges.iter_mut().for_each(|edge| edge.translate(by));
        }
        self.homes[curve] = home;
        let by = home.map(f64::from);
        self.around = union(self.around, range.map(|p| add(p, by)));
        Ok(())
    }

    /// Returns an upper bound of the length of the shortest strut, if there is a strut.
    ///
    /// # Derivation
    ///
    /// A curve and its image by a lattice vector that does not continue it are two strands at a
    /// distance of at most the length of the vector, and their nearest points are a strut. If every
    /// lattice vector continues its strand, the scene is periodic in one direction only, and all
    /// curves run along it with this period. If there are several such curves, two of their points
    /// give the same bound. If there is only one, struts are searched up to two periods plus the
    /// extent of one; there may be none.
    fn bound_of(&self, edges: &[Edge], extent: f64) -> f64 {
        let curves = edges.chunk_by(|a, b| a.curve == b.curve);
        let curves = curves.map(|edges| self.periods[edges[0].curve as usize]);
        let periodic = self.cell.periodic();
        let vectors = curves.clone().flat_map(|period| {
            let leads_away = move |&k: &usize| {
                let mut image = Image::default();
                image[k] = 1;
                periodic[k] && !is_multiple(image, period)
            };
            (0..3).filter(leads_away).map(|k| self.cell.vectors[k])
        });
        let shortest = vectors.map(norm).fold(f64::INFINITY, f64::min);
        let bound = if shortest.is_finite() {
            shortest
        } else {
            let longest = curves.map(|period| norm(self.cell.translation(period)));
            2.0 * (longest.fold(0.0, f64::max) + extent)
        };
        bound * (1.0 + 1e-9)
    }

    /// Returns the maximum difference of the fractional coordinates of two points at a distance.
    fn reach(&self, distance: f64) -> Point {
        self.inverse.map(|b| norm(b) * distance)
    }

    /// Returns an upper bound of the number of images within a distance of an edge.
    fn count(&self, distance: f64) -> f64 {
        let (reach, periodic) = (self.reach(distance), self.cell.periodic());
        let images = (0..3).filter(|&x| periodic[x]).map(|x| {
            let extent = (self.around[1][x] - self.around[0][x]).max(0.0);
            2.0 * (extent + reach[x]) + 3.0
        });
        images.product()
    }

    /// Returns all images, one of each two opposite images, of which some edge may be within a
    /// distance of this edge.
    pub fn images(&self, edge: &Edge, distance: f64) -> impl Iterator<Item = Image> {
        let ([lo, hi], reach) = (self.range(edge), self.reach(distance));
        let periodic = self.cell.periodic();
        let ranges = per_axis(|x| {
            if !periodic[x] {
                return 0..=0;
            }
            let (first, last) = (self.around[0][x], self.around[1][x]);
            let numbers = [1.0, lo[x], hi[x], first, last, reach[x]];
            let pad = PAD * numbers.iter().map(|x| x.abs()).sum::<f64>();
            let from = (lo[x] - reach[x] - pad - last).ceil();
            let to = (hi[x] + reach[x] + pad - first).floor();
            from as i32..=to as i32
        });
        images_in(ranges).filter(|&image| image > Image::default())
    }
}

impl Edges {
    /// Returns the images of which some edge may be within a distance of edge `k`
    /// ([`Lattice::images`]).
    pub fn images(&self, k: u32, distance_sq: f64) -> impl Iterator<Item = Image> {
        let lattice = self.lattice.iter();
        lattice.flat_map(move |lattice| lattice.images(self.get(k), distance_sq.sqrt()))
    }

    /// Returns the square of an upper bound of the length of the shortest strut, if there is a
    /// strut.
    pub fn bound_sq(&self) -> f64 {
        let bound = self.lattice.as_ref().map_or(f64::INFINITY, |l| l.bound);
        bound * bound
    }

    /// Returns an error if an edge has too many images within a distance.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if there are too many.
    pub fn check_images(&self, distance_sq: f64) -> Result<()> {
        let few = |lattice: &Lattice| lattice.count(distance_sq.sqrt()) <= MOST_IMAGES;
        match self.lattice.as_ref().is_none_or(few) {
            true => Ok(()),
            false => Err(Error::Usage(
                "the curves span too many periodic cells, or struts of too many cells are searched \
                 for: is the cell in the units of the coordinates?"
                    .into(),
            )),
        }
    }
}
