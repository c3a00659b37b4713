//! Potential links by sorting and sweeping along the axis on which the boxes are spread the most.
//!
//! Cost: `O(n log n)` for the sort and, on sheets and garments, a few neighbours a box for the sweep;
//! quadratic where all boxes overlap along the axis.

use super::Pair;
use crate::curve::Box3;
use rayon::prelude::*;

/// Boxes swept by one task.
const CHUNK: usize = 512;

/// All pairs of overlapping boxes, sorted. Empty boxes overlap nothing.
pub(crate) fn potential_links(boxes: &[Box3]) -> Vec<Pair> {
    let axis = widest_axis(boxes);
    let mut order: Vec<u32> = (0..boxes.len() as u32)
        .filter(|&i| boxes[i as usize] != Box3::EMPTY)
        .collect();
    order.sort_unstable_by(|&a, &b| {
        let key = |i: u32| boxes[i as usize].lo[axis];
        key(a).total_cmp(&key(b)).then(a.cmp(&b))
    });
    let sorted: Vec<Box3> = order.iter().map(|&i| boxes[i as usize]).collect();
    let parts: Vec<Vec<Pair>> = (0..sorted.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| {
            let mut found = Vec::new();
            for k in c * CHUNK..((c + 1) * CHUNK).min(sorted.len()) {
                let a = &sorted[k];
                let near = sorted[k + 1..].iter().zip(&order[k + 1..]);
                for (b, &j) in near.take_while(|(b, _)| b.lo[axis] <= a.hi[axis]) {
                    if a.overlaps(b) {
                        let i = order[k];
                        found.push((i.min(j), i.max(j)));
                    }
                }
            }
            found
        })
        .collect();
    let mut pairs = parts.concat();
    pairs.par_sort_unstable();
    pairs
}

/// The axis along which the boxes are spread the most, measured in mean box widths.
fn widest_axis(boxes: &[Box3]) -> usize {
    let spread = |x: usize| {
        let (mut lo, mut hi, mut width) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for b in boxes.iter().filter(|&b| *b != Box3::EMPTY) {
            lo = lo.min(f64::from(b.lo[x]));
            hi = hi.max(f64::from(b.hi[x]));
            width += f64::from(b.hi[x]) - f64::from(b.lo[x]);
        }
        let width = width / boxes.len().max(1) as f64;
        if width > 0.0 {
            (hi - lo) / width
        } else {
            f64::INFINITY
        }
    };
    let spreads = [0, 1, 2].map(spread);
    (0..3)
        .max_by(|&a, &b| spreads[a].total_cmp(&spreads[b]))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::potential_links_brute;
    use proptest::prelude::*;

    proptest! {
        /// No pair is missed and none is invented, ties and empty boxes included.
        #[test]
        fn sweep_equals_brute_force(
            raw in prop::collection::vec((prop::array::uniform3(0u8..20), prop::array::uniform3(0u8..6), 0u8..10), 0..120)
        ) {
            let boxes: Vec<Box3> = raw.iter().map(|(lo, size, kind)| {
                if *kind == 0 {
                    return Box3::EMPTY;
                }
                let lo = lo.map(f32::from);
                Box3 { lo, hi: [0, 1, 2].map(|x| lo[x] + f32::from(size[x])) }
            }).collect();
            prop_assert_eq!(potential_links(&boxes), potential_links_brute(&boxes));
        }
    }
}
