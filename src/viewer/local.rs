//! Places of findings: points to mark, and the size of their surroundings, which the size of marks
//! and the distance of the eye follow.

use crate::curve::vector::{add, sub};
use crate::curve::{CurveSet, Point};
pub(super) use crate::curve::{feature, nearest};
use crate::verdict::{self, Finding, Report};

/// Place of a finding, for the picture.
pub(super) struct Spot {
    pub place: verdict::Spot,
    /// Translation of the second curve, of which an image takes part.
    pub by: Point,
    /// Points to mark, one on each curve; the place itself if there is no curve to mark.
    pub marks: Vec<Point>,
    /// Size of the smaller feature of the two curves; 0 if there is none.
    pub size: f64,
}

/// Returns the marks and the size of a place between two curves, the second one translated by `by`.
pub(super) fn spot(set: &CurveSet, place: verdict::Spot, by: Point) -> Spot {
    let point = place.point;
    let strands = || place.curves.into_iter().zip(place.segments);
    let mark = |((i, s), by): ((u32, u32), Point)| {
        let t = nearest(set, i, s, sub(point, by))?;
        Some(add(set.eval(i as usize, s as usize, t), by))
    };
    let moved = strands().zip([[0.0; 3], by]);
    let mut marks: Vec<Point> = moved.filter_map(mark).collect();
    if marks.is_empty() {
        marks.push(point);
    }
    let sizes = strands().filter_map(|(i, s)| feature(set, i, s));
    let size = sizes.min_by(f64::total_cmp).unwrap_or(0.0);
    Spot {
        place,
        by,
        marks,
        size,
    }
}

/// Returns the place of the first finding of a report, and the size of its surroundings.
pub(super) fn first(set: &CurveSet, report: &Report) -> Option<(Point, f64)> {
    let first = report.passages_first().find_map(Finding::spot)?;
    Some((first.point, spot(set, first, [0.0; 3]).size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    #[test]
    fn marks_lie_on_both_curves_however_far_apart_they_are() {
        let xyz = [
            [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0],
            [0.0, 0.0, 50.0, 2.0, 0.0, 50.0, 0.0, 2.0, 50.0],
        ];
        let xyz = xyz.as_flattened();
        let set = CurveSet::from_counts(Basis::Polyline, &[-3, -3], Positions::F64(xyz)).unwrap();
        let place = |point| verdict::Spot {
            curves: [0, 1],
            image: Default::default(),
            segments: [0, 0],
            point,
        };
        let found = spot(&set, place([0.5, 0.0, 25.0]), [0.0; 3]);
        assert_eq!(found.marks, [[0.5, 0.0, 0.0], [0.5, 0.0, 50.0]]);
        assert!(found.size < 3.0, "{}", found.size);
        // An image of the second one.
        let found = spot(&set, place([9.5, 0.0, 0.0]), [9.0, 0.0, -50.0]);
        assert_eq!(found.marks[1], [9.5, 0.0, 0.0]);
    }
}
