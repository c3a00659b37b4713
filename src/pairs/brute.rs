//! Potential links by comparing every box with every other one: the oracle of the sweep.

use super::Pair;
use crate::curve::Box3;

/// Returns all pairs of overlapping boxes, sorted. Takes quadratic time.
pub(crate) fn potential_links_brute(boxes: &[Box3]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (i, a) in boxes.iter().enumerate() {
        for (j, b) in boxes.iter().enumerate().skip(i + 1) {
            if a.overlaps(b) {
                pairs.push((i as u32, j as u32));
            }
        }
    }
    pairs
}
