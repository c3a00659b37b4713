//! Reference frame: a frame with proven linking numbers, and the distance that each of its control
//! points may move before two curves may touch.

mod allowances;
mod clearance;
mod gap;
mod neighbours;
#[cfg(test)]
mod tests;

use self::allowances::{Allowances, MOST_NEAR};
pub(super) use self::neighbours::{Block, Neighbours};
use super::affine::{Affine, Sample};
use super::blocks::CHUNK;
use super::coverage::Coverage;
use super::covered::Covered;
use super::packed::Packed;
use super::quiet_bounds::QuietBounds;
use crate::certificate::Certificate;
use crate::curve::{AXES, CurveSet, Point, Received, union};
use crate::pairs::{PairFilter, Trees};
use std::sync::Arc;

/// A frame with proven linking numbers, and the allowances of its points.
#[derive(Debug)]
pub(super) struct Reference {
    pub set: CurveSet,
    /// Positions of the control points, in order.
    pub points: Received,
    /// Pairs for which the allowances are valid.
    pub coverage: Coverage,
    pub certificate: Arc<Certificate>,
    /// Number of the frame, counted by the monitor.
    pub frame: u64,
    /// Bounds of the control points of each curve, and of all.
    pub bounds: Vec<[Point; 2]>,
    pub around: [Point; 2],
    /// Points to which affine frames are fitted.
    pub sample: Sample,
    /// Distance that each control point may move. Infinite for curves that are not covered.
    pub allowances: Vec<f32>,
    /// The largest finite allowance.
    pub largest_allowance: f64,
    /// Compressed points and allowances.
    pub packed: Vec<Packed>,
    /// Near blocks of segments. The hulls of segments move by less than half their range while all
    /// control points stay within their allowances.
    pub neighbours: Neighbours,
}

impl Reference {
    /// Builds a reference frame from a frame and its linking numbers: for the pairs of a filter, or
    /// for all. Returns `None` if too many of its segments are near one another: the memory for
    /// them is limited.
    pub fn build(
        set: CurveSet,
        certificate: Arc<Certificate>,
        frame: u64,
        coverage: Coverage,
        filter: Option<&PairFilter>,
    ) -> Option<Reference> {
        Reference::build_within(MOST_NEAR, set, certificate, frame, (coverage, filter))
    }

    /// [`Reference::build`] with at most this number of near pairs of blocks.
    fn build_within(
        most: usize,
        set: CurveSet,
        certificate: Arc<Certificate>,
        frame: u64,
        (coverage, filter): (Coverage, Option<&PairFilter>),
    ) -> Option<Reference> {
        let mut trees = Trees::default();
        let covered = Covered {
            set: &set,
            coverage,
        };
        trees.refit(covered);
        let sample = Sample::new(&set, coverage.open_curves);
        let allowances = Allowances::new(covered, &trees, filter, most);
        let (allowances, neighbours) = allowances.fill(&certificate)?;
        let points = set.positions().into_copy();
        let packed = Packed::blocks(points.positions(), set.max_abs(), &allowances);
        let finite = allowances.iter().filter(|a| a.is_finite());
        let bounds: Vec<[Point; 2]> = (0..set.len()).map(|i| set.bounds_along(i, &AXES)).collect();
        Some(Reference {
            around: bounds.iter().copied().reduce(union).unwrap_or_default(),
            largest_allowance: finite.fold(0.0, |most, &a| most.max(a.into())),
            bounds,
            set,
            points,
            coverage,
            certificate,
            frame,
            sample,
            allowances,
            packed,
            neighbours,
        })
    }

    /// Returns bounds of the curves of a frame in which all points are within their allowances,
    /// after this map. `None` if some curves are not covered.
    pub fn quiet_bounds(&self, affine: Affine) -> Option<QuietBounds<'_>> {
        let all = self.coverage.open_curves || self.set.open_curves() == 0;
        all.then_some(QuietBounds {
            reference: self.frame,
            bounds: &self.bounds,
            all: self.around,
            affine,
            // The condition is `|p - (M q + t)| <= sigma a`.
            distance: affine.sigma * self.largest_allowance * (1.0 + 1e-6),
        })
    }

    /// Returns the number of chunks of points.
    pub fn chunks(&self) -> usize {
        self.allowances.len().div_ceil(CHUNK)
    }
}
