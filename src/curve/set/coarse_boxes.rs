//! Coarse boxes of curves: one pass over the control points, without trees.

use super::boxes::{Box3, above, below, larger, smaller};
use super::coordinates::Axes;
use super::{Basis, CurveSet, pow2};
use crate::simd::{LANES, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// Number of curves that a task bounds.
const CHUNK: usize = 256;

impl CurveSet {
    /// Returns a box of each curve, open or closed. It contains the boxes of all segments of the
    /// curve ([`CurveSet::leaf_boxes`]).
    pub(crate) fn coarse_boxes(&self) -> Vec<Box3> {
        let mut boxes = vec![Box3::EMPTY; self.len()];
        let chunks = boxes.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(chunk, boxes)| dispatch!(coarse_boxes(self, CHUNK * chunk, boxes)));
        boxes
    }

    /// Segments are in the hulls of their Bezier control points. Those of polylines, B-splines and
    /// Bezier curves are in the hull of the control points; those of Catmull-Rom splines are a
    /// sixth of the difference of two control points away from one ([`Basis::hull`]).
    #[inline(always)]
    fn coarse_box(&self, i: usize) -> Box3 {
        let body = self.body(i);
        // In double precision, as single precision ends before the limit of the coordinates.
        let (lo, hi) = match self.axes() {
            Axes::F32(v) => {
                let [lo, hi] = bounds(v, body, [f32::INFINITY, f32::NEG_INFINITY]);
                if self.basis().is_polyline() {
                    return Box3 { lo, hi };
                }
                (lo.map(f64::from), hi.map(f64::from))
            }
            Axes::F64(v) => {
                let [lo, hi] = bounds(v, body, [f64::INFINITY, f64::NEG_INFINITY]);
                let pad = self.rounding();
                (lo.map(|x| x - pad), hi.map(|x| x + pad))
            }
        };
        // Eight times the padding of leaf boxes, which have at most that of single precision.
        let pad = self.max_abs() * pow2(-18) + 1e-300;
        let by = match self.basis() {
            Basis::Polyline => 0.0,
            Basis::CatmullRom => (0..3).map(|x| hi[x] - lo[x]).fold(0.0, f64::max) / 5.0 + pad,
            _ => pad,
        };
        Box3 {
            lo: lo.map(|x| below(x - by)),
            hi: hi.map(|x| above(x + by)),
        }
    }
}

/// Computes the boxes of the curves from `first` on.
#[inline(always)]
fn coarse_boxes(set: &CurveSet, first: usize, boxes: &mut [Box3]) {
    for (k, b) in boxes.iter_mut().enumerate() {
        *b = set.coarse_box(first + k);
    }
}

/// Returns the smallest and the largest coordinates in some slots.
#[inline(always)]
fn bounds<T: PartialOrd + Copy>(
    axes: [&[T]; 3],
    slots: Range<usize>,
    [most, least]: [T; 2],
) -> [[T; 3]; 2] {
    let (mut low, mut high) = ([most; 3], [least; 3]);
    for x in 0..3 {
        let (mut lo, mut hi) = ([most; LANES], [least; LANES]);
        let (eights, rest) = axes[x][slots.clone()].as_chunks::<LANES>();
        for eight in eights {
            for k in 0..LANES {
                lo[k] = smaller(lo[k], eight[k]);
                hi[k] = larger(hi[k], eight[k]);
            }
        }
        for (k, &last) in rest.iter().enumerate() {
            lo[k] = smaller(lo[k], last);
            hi[k] = larger(hi[k], last);
        }
        for width in [LANES / 2, LANES / 4, 1] {
            for k in 0..width {
                lo[k] = smaller(lo[k], lo[k + width]);
                hi[k] = larger(hi[k], hi[k + width]);
            }
        }
        [low[x], high[x]] = [lo[0], hi[0]];
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;
    use proptest::prelude::*;

    /// Regression test: the box was too small beyond the range of single precision.
    #[test]
    fn coarse_boxes_of_huge_splines_contain_those_of_their_segments() {
        for scale in [1e37, 1e38, 3e38, 1e39, 1e40, 1e60] {
            let z = [0.01, 0.84, 0.75, 0.84, 0.56, 0.33, 0.56, 0.86, 0.71];
            let points: Vec<f64> = z.iter().flat_map(|z| [0.0, 0.0, z * scale]).collect();
            let positions = Positions::F64(&points);
            let set = CurveSet::from_counts(Basis::CatmullRom, &[-9], positions).unwrap();
            let coarse = set.coarse_boxes()[0];
            for g in 0..2 {
                let leaf = set.leaf_boxes(0, g).bounds();
                assert_eq!(coarse.union(&leaf), coarse, "{scale}");
            }
        }
    }

    proptest! {
        #[test]
        fn coarse_boxes_contain_the_boxes_of_all_segments(
            points in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 9..40),
            scale in -300i32..90,
            single in any::<bool>(),
        ) {
            let scale = if single { scale / 10 } else { scale };
            let scaled = points.as_flattened().iter().map(|x| x * 10f64.powi(scale));
            let wide: Vec<f64> = scaled.collect();
            let narrow: Vec<f32> = wide.iter().map(|&x| x as f32).collect();
            for basis in Basis::ALL {
                let n = points.len() as i32 / 3 * 3;
                let positions = match single {
                    true => Positions::F32(&narrow[..3 * n as usize]),
                    false => Positions::F64(&wide[..3 * n as usize]),
                };
                let set = CurveSet::from_counts(basis, &[-n], positions).unwrap();
                let coarse = set.coarse_boxes()[0];
                let leaves = (set.curve(0).segments as usize).div_ceil(LANES);
                for g in 0..leaves {
                    let leaf = set.leaf_boxes(0, g).bounds();
                    prop_assert_eq!(coarse.union(&leaf), coarse, "{:?}", basis);
                }
            }
        }
    }
}
