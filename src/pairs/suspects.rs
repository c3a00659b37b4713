//! Order of the potential links for an early exit at the first change.

use super::Pair;
use crate::curve::Box3;
use crate::verdict::Link;

/// Sorts pairs so that those most likely to have changed come first: pairs that are linked in the
/// baseline, then pairs whose curves have moved furthest since the boxes `before` (if these are
/// boxes of as many curves), then pairs with the deepest overlap of their boxes, which have the
/// least clearance.
///
/// `pairs` and `linked` are sorted by pair.
pub(crate) fn most_suspect_first(
    pairs: &mut [Pair],
    linked: &[Link],
    now: &[Box3],
    before: &[Box3],
) {
    let motion = |i: u32| match before.get(i as usize) {
        Some(b) if before.len() == now.len() => now[i as usize].largest_shift(b),
        _ => 0.0,
    };
    pairs.sort_by_cached_key(|&(i, j)| {
        let is_linked = linked.binary_search_by_key(&(i, j), |l| (l.i, l.j)).is_ok();
        let depth = now[i as usize].overlap_depth(&now[j as usize]);
        // Neither is negative, so their bit patterns have the same order.
        let rank = [motion(i).max(motion(j)), depth].map(|x| std::cmp::Reverse(x.to_bits()));
        (!is_linked, rank, i, j)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linked_then_moved_then_deep_pairs_come_first() {
        let at = |x: f32| Box3 {
            lo: [x, 0.0, 0.0],
            hi: [x + 2.0, 9.0, 9.0],
        };
        let now: Vec<Box3> = [0.0, 1.0, 1.5, 3.0, 4.5].map(at).to_vec();
        let mut before = now.clone();
        before[4] = at(4.25);
        let linked = [Link {
            i: 2,
            j: 3,
            lambda: 1,
        }];
        let pairs = [(0, 1), (0, 2), (1, 2), (2, 3), (3, 4)];
        let mut sorted = pairs;
        most_suspect_first(&mut sorted, &linked, &now, &before);
        assert_eq!(sorted, [(2, 3), (3, 4), (1, 2), (0, 1), (0, 2)]);
        // Boxes of other curves contain no information about motion.
        most_suspect_first(&mut sorted, &linked, &now, &before[1..]);
        assert_eq!(sorted, [(2, 3), (1, 2), (0, 1), (0, 2), (3, 4)]);
    }
}
