//! All curves of one frame, as a structure of arrays.

mod bounds;
mod boxes;
mod builder;
mod coordinates;
mod curve;
mod diagonals;
mod frame;
mod layout;
mod leaf_boxes;
mod local;
mod parts;
mod received;
mod segments;
mod sums;
mod update;

pub(crate) use super::basis::{Bezier, Real, bspline_knot, point_at, sub_segment};
pub(crate) use super::cell::{minus, plus};
pub(crate) use super::labels::CurveChange;
pub(crate) use bounds::{AXES, bounds, boxes_apart, union};
pub(crate) use boxes::{Box3, BoxGroup, above, below, larger, smaller};
pub use builder::CurveSetBuilder;
pub(crate) use coordinates::{Coordinates, Knots, ReadKnots};
pub use curve::Curve;
pub(crate) use curve::count_of;
pub(crate) use diagonals::Diagonals;
pub(crate) use frame::{Frame, FramePool, Images};
pub(crate) use layout::Shape;
pub(crate) use local::{feature, nearest};
pub(crate) use parts::{Parts, multiple};
pub(crate) use received::{Bad, Received, StoredCurves, largest_within};
pub(crate) use segments::{Hulls, are_three_distinct};
pub(crate) use sums::{SumEdges, SumPoint, TERMS, Translated, single};

use self::coordinates::{Arrays, LazyArrays};
use self::curve::slots_of_all;
use self::sums::Sums;
use self::update::next_contents;
use super::*;
use crate::error::Result;
use std::sync::Arc;

/// All curves of one frame.
///
/// The positions of the control points are stored as they were received. Three arrays, one per
/// axis, curve after curve, are built when they are needed. In them, a closed curve has copies of
/// its first points after its last one (and of its last point before its first one if the basis
/// needs it). So every segment is a window of adjacent slots, and eight segments are read at once.
///
/// Invariant: every coordinate is finite, and every curve has as many points as its basis needs.
#[derive(Clone, Debug)]
pub struct CurveSet {
    basis: Basis,
    /// Shared by clones, so that clones of one set are recognized as having the same layout at
    /// once.
    curves: Arc<Vec<Curve>>,
    received: Received,
    arrays: LazyArrays,
    points: usize,
    /// Counted during construction, so that reading it costs no pass over the curves.
    segments: usize,
    open_curves: usize,
    /// Number of the positions; see [`CurveSet::contents`].
    contents: u64,
    /// Origin of the coordinates, if they are sums.
    sums: Option<Arc<Sums>>,
}

impl CurveSet {
    /// Returns a set without curves, with memory for the positions of so many points.
    fn empty(basis: Basis, precision: Precision, points: usize) -> CurveSet {
        CurveSet {
            basis,
            curves: Arc::default(),
            received: Received::with_capacity(precision, 3 * points),
            arrays: LazyArrays::default(),
            points: 0,
            segments: 0,
            open_curves: 0,
            contents: next_contents(),
            sums: None,
        }
    }

    /// Returns the basis of all curves.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Returns the type of the coordinates.
    pub fn precision(&self) -> Precision {
        self.positions().precision()
    }

    /// Returns the number of curves.
    pub fn len(&self) -> usize {
        self.curves.len()
    }

    /// Returns true if there are no curves.
    pub fn is_empty(&self) -> bool {
        self.curves.is_empty()
    }

    /// Returns the number of control points of all curves.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Returns the number of segments of all curves.
    pub fn segments(&self) -> usize {
        self.segments
    }

    /// Returns the number of open curves.
    pub(crate) fn open_curves(&self) -> usize {
        self.open_curves
    }

    /// Returns curve `i`.
    pub fn curve(&self, i: usize) -> Curve {
        self.curves[i]
    }

    /// Returns all curves in order.
    pub fn curves(&self) -> &[Curve] {
        &self.curves
    }

    /// Returns the number of control points of each curve, negative for closed curves: the layout
    /// on the bus and in recordings.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = i32> + '_ {
        self.curves.iter().map(Curve::count)
    }

    /// Returns the largest magnitude of any coordinate.
    pub fn max_abs(&self) -> f64 {
        self.arrays().max_abs
    }

    /// Returns a number that sets with other positions do not have: copies of a set have the number
    /// of the set, and an update changes the number.
    pub(crate) fn contents(&self) -> u64 {
        self.contents
    }

    /// Returns the positions of all control points, in the order of the input.
    #[inline]
    pub fn positions(&self) -> Positions<'_> {
        self.received.positions()
    }

    /// Returns the positions of the control points of curve `i`.
    pub(crate) fn positions_in(&self, i: usize) -> Positions<'_> {
        let points = self.points_of(i);
        self.positions().part(3 * points.start..3 * points.end)
    }

    #[inline(always)]
    fn arrays(&self) -> &Arrays {
        self.arrays.get(&self.curves, self.basis, &self.received)
    }

    /// Returns the coordinates of all slots: control points, the copies that wrap closed curves,
    /// and padding.
    #[inline(always)]
    pub(crate) fn coordinates(&self) -> &Coordinates {
        &self.arrays().coordinates
    }

    /// Returns true if the arrays are built.
    #[cfg(test)]
    pub(crate) fn has_arrays(&self) -> bool {
        self.arrays.are_built()
    }

    /// Returns the number of slots of all curves.
    pub(crate) fn slots(&self) -> usize {
        slots_of_all(&self.curves, self.basis)
    }

    /// Returns for each curve if one of its points differs from that of an earlier frame of the
    /// same layout.
    #[cfg(feature = "rerun")]
    pub(crate) fn moved_since(&self, before: &CurveSet) -> Vec<bool> {
        if self.contents == before.contents {
            return vec![false; self.len()];
        }
        let moved = (0..self.len()).map(|i| self.positions_in(i) != before.positions_in(i));
        moved.collect()
    }

    /// Returns a copy in double precision.
    pub(crate) fn widened(&self) -> Result<CurveSet> {
        let Positions::F32(v) = self.positions() else {
            return Ok(self.clone());
        };
        let counts: Vec<i32> = self.counts().collect();
        let xyz: Vec<f64> = v.iter().map(|&x| x.into()).collect();
        CurveSet::from_counts(self.basis, &counts, Positions::F64(&xyz))
    }

    /// Returns a set of some of the curves, in this order.
    pub(crate) fn subset(&self, curves: &[u32]) -> CurveSet {
        let mut builder = CurveSet::builder(self.basis, self.precision(), 0);
        for i in curves.iter().map(|&i| i as usize) {
            let curve = self.curves[i];
            let added = builder
                .start_curve(curve.points as usize, curve.closed)
                .and_then(|()| builder.push(self.positions_in(i)));
            added.expect("curves of a valid set are valid");
        }
        builder.finish().expect("all curves are complete")
    }

    /// Appends the control points of all curves to `out`, `x y z` curve after curve, in their
    /// precision, as little-endian bytes. Recordings store this form.
    pub fn write_positions(&self, out: &mut Vec<u8>) {
        match self.positions() {
            Positions::F32(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
            Positions::F64(v) => out.extend(v.iter().flat_map(|x| x.to_le_bytes())),
        }
    }
}

#[cfg(test)]
mod tests;
