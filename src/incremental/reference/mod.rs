//! Reference frame: a frame with proven linking numbers, and the distance that each of its control
//! points may move before two curves may touch.

mod allowances;
mod gap;
mod neighbours;
#[cfg(test)]
mod tests;

use self::allowances::Allowances;
pub(super) use self::allowances::MOST_NEAR;
pub(super) use self::neighbours::{Block, Neighbours};
use super::affine::Sample;
use super::blocks::CHUNK;
use super::covered::{Coverage, Covered};
use super::packed::Packed;
use crate::cancel::Cancel;
use crate::certificate::{Certificate, Comparison};
use crate::curve::{AXES, Cell, CurveSet, Frame, Point, Translated, union};
use crate::pairs::{PairFilter, Trees, distinct};
use std::borrow::Cow;
use std::sync::Arc;

/// A frame with proven linking numbers, and the allowances of its points.
#[derive(Debug)]
pub(super) struct Reference {
    /// All curves, images included.
    pub set: Arc<CurveSet>,
    /// Curves as they are given. They come first in the set.
    pub given: Arc<CurveSet>,
    /// Images of these curves.
    images: Option<Translated>,
    pub cell: Option<Cell>,
    /// Pairs for which the allowances are valid.
    pub coverage: Coverage,
    pub certificate: Arc<Certificate>,
    /// Its comparison with the baseline, once the monitor has made it.
    pub comparison: Option<Comparison>,
    /// Number of the frame, counted by the monitor.
    pub frame: u64,
    /// Bounds of the control points of each given curve, and of all.
    pub bounds: Vec<[Point; 2]>,
    pub around: [Point; 2],
    /// Points to which affine maps are fitted.
    pub sample: Sample,
    /// Distance that each control point of the given curves may move: all its images move alike.
    /// Infinite for curves that are not covered.
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
    /// for all. Returns `None` if it is cancelled, or if too many of its segments are near one
    /// another: more than `most_near` pairs of blocks ([`MOST_NEAR`]), whose memory is limited.
    pub fn build(
        subject: &Frame,
        certificate: Arc<Certificate>,
        frame: u64,
        coverage: Coverage,
        filter: Option<&PairFilter>,
        most_near: usize,
        cancel: &Cancel,
    ) -> Option<Reference> {
        let (set, given) = (Arc::clone(subject.set().ok()?), Arc::clone(subject.given()));
        let images = subject.translated().cloned();
        let mut trees = Trees::default();
        let covered = Covered::new(&set, coverage, filter);
        trees.refit(covered.leaves());
        let sample = Sample::new(&given, coverage.open_curves);
        let allowances = Allowances::new(covered, &trees, most_near, cancel);
        let (mut allowances, neighbours) = allowances.fill(&certificate)?;
        if let Some(images) = &images {
            allowances = least_of_images(&allowances, &set, images, &given);
        }
        let packed = Packed::blocks(given.positions(), set.max_abs(), &allowances);
        let finite = allowances.iter().filter(|a| a.is_finite());
        let bounds = (0..given.len()).map(|i| given.bounds_along(i, &AXES));
        let bounds: Vec<[Point; 2]> = bounds.collect();
        Some(Reference {
            around: bounds.iter().copied().reduce(union).unwrap_or_default(),
            largest_allowance: finite.fold(0.0, |most, &a| most.max(a.into())),
            bounds,
            set,
            given,
            images,
            cell: subject.cell().copied(),
            coverage,
            certificate,
            comparison: None,
            frame,
            sample,
            allowances,
            packed,
            neighbours,
        })
    }

    /// Returns the number of chunks of points.
    pub fn chunks(&self) -> usize {
        self.allowances.len().div_ceil(CHUNK)
    }

    /// Returns these chunks, which are of the given curves, and the chunks with the images of their
    /// points, sorted.
    pub fn with_images<'a>(&self, chunks: &'a [u32]) -> Cow<'a, [u32]> {
        let Some(images) = &self.images else {
            return Cow::Borrowed(chunks);
        };
        let mut moved = vec![false; self.chunks()];
        for &chunk in chunks {
            moved[chunk as usize] = true;
        }
        let mut all = chunks.to_vec();
        for (k, &(i, _)) in images.iter().enumerate() {
            let (from, to) = (self.given.points_of(i as usize), self.set.points_of(k));
            if images.next(k).is_some() && moved[from.start / CHUNK] {
                // The end of a yarn is an image of its start.
                all.push(((to.end - 1) / CHUNK) as u32);
            }
            if k < self.given.len() {
                continue;
            }
            let chunks = from.start / CHUNK..=(from.end - 1) / CHUNK;
            for chunk in chunks.filter(|&chunk| moved[chunk]) {
                let first = (chunk * CHUNK).max(from.start) - from.start;
                let last = ((chunk + 1) * CHUNK).min(from.end) - 1 - from.start;
                let here = (to.start + first) / CHUNK..=(to.start + last) / CHUNK;
                all.extend(here.map(|chunk| chunk as u32));
            }
        }
        Cow::Owned(distinct(all))
    }
}

/// Returns the least allowance of each point of the given curves and of its images. The end of a
/// polyline that is a yarn is an image of its start.
fn least_of_images(
    allowances: &[f32],
    set: &CurveSet,
    images: &Translated,
    given: &CurveSet,
) -> Vec<f32> {
    let mut least = allowances[..given.points()].to_vec();
    for (k, &(i, _)) in images.iter().enumerate() {
        let (from, to) = (given.points_of(i as usize), set.points_of(k));
        let mut lower = |point: usize, to: f32| least[point] = least[point].min(to);
        if images.next(k).is_some() {
            lower(from.start, allowances[to.end - 1]);
        }
        from.zip(to)
            .for_each(|(point, image)| lower(point, allowances[image]));
    }
    least
}
