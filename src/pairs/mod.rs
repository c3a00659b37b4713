//! Potential links: the pairs of curves that are near enough to be linked.
//!
//! Two curves in disjoint convex volumes are not linked, so only pairs with overlapping boxes are
//! processed further (Qu & James 2021, section 3.2, Algorithm 2).

mod blocks;
mod buckets;
mod closest;
mod descent;
mod filter;
mod layout;
mod refit;
mod suspects;
mod sweep;
mod trees;

pub(crate) use blocks::{BlockLists, Blocks};
pub(crate) use closest::{
    Eight, Nearest, Scale, closest_approach, closest_of_segments, closest_points, nearest,
    squared_distances,
};
pub(crate) use descent::{
    Agenda, Query, SegmentPairs, descend, every_second, overlapping, overlapping_segments,
};
pub(crate) use filter::{LoopPairs, PairFilter};
pub(crate) use layout::{Leaves, Node, SMALL};
pub(crate) use refit::refits_in_parallel;
pub(crate) use suspects::most_suspect_first;
pub(crate) use sweep::LinkSearch;
pub(crate) use trees::{BoxTree, CurveTree, Trees};

use crate::curve::CurveSet;
use crate::verdict::{Defect, DefectKind, Place};

/// A pair of curves, `i < j`.
pub(crate) type Pair = (u32, u32);

/// Returns the degenerate curves, which have no linking numbers: the closed curves of fewer than
/// three distinct points, in order.
pub(crate) fn degenerate_curves(set: &CurveSet) -> impl Iterator<Item = Defect> {
    let degenerate = |&i: &usize| set.curve(i).closed && !set.has_three_distinct_points(i);
    (0..set.len()).filter(degenerate).map(|i| Defect {
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

/// Returns the curves of some pairs, sorted and without duplicates.
pub(crate) fn curves_of(pairs: impl Iterator<Item = Pair>) -> Vec<u32> {
    distinct(pairs.flat_map(|(i, j)| [i, j]))
}

/// Returns some items, sorted and without duplicates.
pub(crate) fn distinct<T: Ord>(items: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut items = sorted(items);
    items.dedup();
    items
}

/// Returns some items, sorted.
pub(crate) fn sorted<T: Ord>(items: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut items: Vec<T> = items.into_iter().collect();
    items.sort_unstable();
    items
}
