//! All pairs of edges (section 1, Algorithm 1): the fastest way for few edges, and the oracle of
//! the octree.

use super::edges::{Edges, Found};

/// Returns the shortest strut.
pub(super) fn shortest(edges: &Edges) -> Option<Found> {
    let mut best: Option<Found> = None;
    for (i, j) in pairs(edges) {
        let limit = best.map_or(f64::INFINITY, |b| b.distance_sq);
        let found = edges.strut_between(i, j, limit);
        let shorter = |found: &Found| best.is_none_or(|best| found.order(&best).is_lt());
        best = found.filter(shorter).or(best);
    }
    best
}

/// Returns all struts up to a length.
pub(super) fn up_to(edges: &Edges, longest: f64) -> Vec<Found> {
    let longest = edges.scaled(longest);
    pairs(edges)
        .filter_map(|(i, j)| edges.strut_between(i, j, longest * longest))
        .collect()
}

fn pairs(edges: &Edges) -> impl Iterator<Item = (u32, u32)> {
    let n = edges.len() as u32;
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j)))
}
