//! Vassiliev invariants of degree 2 and 3 of a knot, from the Gauss code.
//!
//! # The second one
//!
//! `v2` is the coefficient of `z^2` in the Conway polynomial: 0 for the unknot, 1 for both
//! trefoils, -1 for the figure-eight knot. By Polyak & Viro 1994 (*Gauss diagram formulas for
//! Vassiliev invariants*, IMRN 11, Theorem 1), it is the sum of the products of the signs of two
//! crossings `c` and `d` that a walk from any base point passes in the order `c` below, `d` above,
//! `c` above, `d` below.
//!
//! # The third one
//!
//! `v3 = -2 w3`, with the invariant `w3 = V'''(1) / 72 + V''(1) / 24` of the Jones polynomial
//! `V`: 0 for the unknot and the figure-eight knot, 1 for the right-handed trefoil, -1 for the
//! left-handed one. (Polyak & Viro 1994, Theorem 2, use the same one.) Lescop 2009 (*Surgery
//! formulae for finite type invariants of rational homology 3-spheres*, Algebr. Geom. Topol. 9,
//! section 7) has its crossing change formula: if a positive crossing of `K+` becomes
//! negative in `K-`, and smoothing it gives a link of `K'` and `K''` with linking number `l`, then
//!
//! `w3(K+) - w3(K-) = (v2(K') + v2(K'')) / 2 - (v2(K+) + v2(K-) + l^2) / 4`,
//! `v2(K+) - v2(K-) = l`.
//!
//! All crossings that a walk passes first below are changed in their order. The result is a
//! descending diagram: of an unknot.

use rayon::prelude::*;

/// Sums over ranges of positions, with updates (Fenwick tree).
struct Sums(Vec<i64>);

impl Sums {
    fn add(&mut self, position: usize, value: i64) {
        let mut k = position + 1;
        while k < self.0.len() {
            self.0[k] += value;
            k += k & k.wrapping_neg();
        }
    }

    /// Returns the sum over the positions before this one.
    fn before(&self, position: usize) -> i64 {
        let (mut k, mut sum) = (position, 0);
        while k > 0 {
            sum += self.0[k];
            k &= k - 1;
        }
        sum
    }
}

/// Returns `v2` of a knot. Passages whose crossings are not passed twice are ignored.
///
/// Cost: `O(n log n)`.
pub(super) fn v2(passages: &[u32], sign: impl Fn(u32) -> i64) -> i64 {
    let crossings = passages.iter().max().map_or(0, |p| *p as usize / 2 + 1);
    let mut met: Vec<Option<usize>> = vec![None; crossings];
    let mut twice = vec![false; crossings];
    for &passage in passages {
        let c = passage as usize / 2;
        twice[c] = met[c].replace(0).is_some();
    }
    met.fill(None);
    let mut sums = Sums(vec![0; passages.len() + 1]);
    let mut total = 0;
    for (position, &passage) in passages.iter().enumerate() {
        let (c, over) = (passage as usize / 2, passage % 2 == 1);
        if !twice[c] {
            continue;
        }
        match (met[c], over) {
            // `c` was passed below at `first`: all `d` that were passed above since, once.
            (Some(first), true) => {
                let open = sums.before(position) - sums.before(first);
                total += sign(passage / 2) * open;
            }
            (Some(first), false) => sums.add(first, -sign(passage / 2)),
            (None, over) => {
                met[c] = Some(position);
                if over {
                    sums.add(position, sign(passage / 2));
                }
            }
        }
    }
    total
}

/// Returns the linking number of a part of a knot and of the rest: half the sum of the signs of the
/// crossings that it passes once.
pub(super) fn linking_number(part: &[u32], crossings: usize, sign: impl Fn(u32) -> i64) -> i64 {
    let mut inside = vec![false; crossings];
    let mut sum = 0;
    for crossing in part.iter().map(|passage| passage / 2) {
        let once = &mut inside[crossing as usize];
        *once = !*once;
        let sign = sign(crossing);
        sum += if *once { sign } else { -sign };
    }
    sum / 2
}

/// Returns `v3` of a knot, given its `v2`.
///
/// Cost: `O(n)` times that of `v2`.
pub(super) fn v3(passages: &[u32], signs: &[i8], v2_of_knot: i64) -> i64 {
    let mut places = vec![Vec::new(); signs.len()];
    for (position, &passage) in passages.iter().enumerate() {
        places[passage as usize / 2].push(position);
    }
    // Crossings that are passed first below, with both positions, in the order of changes.
    let first_below = |places: &&Vec<usize>| {
        places
            .first()
            .is_some_and(|&k| passages[k].is_multiple_of(2))
    };
    let changes = places.iter().filter(first_below);
    let mut changes: Vec<[usize; 2]> = changes.map(|places| [places[0], places[1]]).collect();
    changes.sort_unstable();
    let mut order = vec![usize::MAX; signs.len()];
    for (change, [start, _]) in changes.iter().enumerate() {
        order[passages[*start] as usize / 2] = change;
    }
    // For each change: the sign before it, the linking number, and the sum of `v2` of both parts.
    let smoothed: Vec<(i64, i64, i64)> = changes
        .par_iter()
        .enumerate()
        .map(|(change, &[start, end])| {
            let changed = |c: usize| order[c] < change;
            let state = |passage: u32| passage ^ u32::from(changed(passage as usize / 2));
            let sign = |c: u32| {
                let sign = i64::from(signs[c as usize]);
                if changed(c as usize) { -sign } else { sign }
            };
            let inner: Vec<u32> = passages[start + 1..end].iter().map(|&p| state(p)).collect();
            let outer = passages[end + 1..].iter().chain(&passages[..start]);
            let outer: Vec<u32> = outer.map(|&p| state(p)).collect();
            let linking = linking_number(&inner, signs.len(), sign);
            let of_parts = v2(&inner, sign) + v2(&outer, sign);
            (sign(passages[start] / 2), linking, of_parts)
        })
        .collect();
    let (mut v2, mut doubled) = (v2_of_knot, 0);
    for (sign, linking, of_parts) in smoothed {
        let after = v2 - sign * linking;
        doubled += sign * (v2 + after + linking * linking - 2 * of_parts);
        v2 = after;
    }
    debug_assert_eq!(v2, 0, "a descending diagram is an unknot");
    doubled / 2
}
