//! Degenerate curves, which have no linking numbers.

use crate::curve::CurveSet;
use crate::verdict::{Defect, DefectKind, Place};

/// Returns the closed curves of fewer than three distinct points, in order.
pub(crate) fn degenerate_curves(set: &CurveSet) -> impl Iterator<Item = Defect> {
    (0..set.len())
        .filter(|&i| set.curve(i).closed && !set.has_three_distinct_points(i))
        .map(|i| Defect {
            i: i as u32,
            j: None,
            image: Default::default(),
            kind: DefectKind::Degenerate,
            place: Place {
                segments: [0, 0],
                point: set.point(i, 0),
                distance: 0.0,
            },
        })
}
