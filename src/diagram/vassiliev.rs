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

/// Returns `v2` of a knot.
///
/// Cost: `O(n log n)`.
pub(super) fn v2(passages: &[u32], signs: &[i8]) -> i64 {
    let mut met: Vec<Option<usize>> = vec![None; signs.len()];
    let mut sums = Sums(vec![0; passages.len() + 1]);
    let mut total = 0;
    for (position, &passage) in passages.iter().enumerate() {
        let (c, over) = (passage as usize / 2, passage % 2 == 1);
        let sign = i64::from(signs[c]);
        match (met[c], over) {
            // `c` was passed below at `first`: all `d` that were passed above since, once.
            (Some(first), true) => total += sign * (sums.before(position) - sums.before(first)),
            (Some(first), false) => sums.add(first, -sign),
            (None, over) => {
                met[c] = Some(position);
                if over {
                    sums.add(position, sign);
                }
            }
        }
    }
    total
}

/// Returns the linking number of a part of a knot and of the rest: half the sum of the signs of the
/// crossings that it passes once.
pub(super) fn linking_number(part: &[u32], signs: &[i8]) -> i64 {
    let mut inside = vec![false; signs.len()];
    let mut sum = 0;
    for crossing in part.iter().map(|&passage| passage as usize / 2) {
        let once = &mut inside[crossing];
        *once = !*once;
        let sign = i64::from(signs[crossing]);
        sum += if *once { sign } else { -sign };
    }
    sum / 2
}

/// Returns `v3` of a knot.
///
/// # Derivation: the sums of `v2` over the parts
///
/// A walk from the base point passes the crossing that is to be changed at `start` below and at
/// `end` above. Smoothing it leaves the part between them, and the rest. A pair counts for `v2` of
/// a part if the walk passes it there in the order `c` below, `d` above, `c` above, `d` below.
/// Crossings that are passed before `start` are above there, because of the changes before this
/// one, so `c` is first passed after `start`, and so is `d`, which is first passed above: neither
/// has changed. Both parts are walked in the order of the knot from its base point. So the pairs
/// are those of the knot itself with all passages between `start` and `end`, or after `end`. The
/// changes are followed from the last one, after which `v2` is 0, to the first one. Each adds the
/// pairs of which it is `c`.
///
/// Cost: `O(n^2)`.
pub(super) fn v3(passages: &[u32], signs: &[i8]) -> i64 {
    let mut places = vec![usize::MAX; 2 * signs.len()];
    for (position, &passage) in passages.iter().enumerate() {
        places[passage as usize] = position;
    }
    // The position of the other passage, the sign, and true if it is above.
    let passages = passages.iter().map(|&passage| {
        let sign = i64::from(signs[passage as usize / 2]);
        (places[passage as usize ^ 1], sign, passage % 2 == 1)
    });
    let all: Vec<(usize, i64, bool)> = passages.collect();
    // Sums over the pairs: by the last passage, and with the first passage from each position on.
    let (mut by_last, mut from_first) = (vec![0; all.len()], vec![0; all.len()]);
    let (mut pairs, mut v2, mut doubled) = (0, 0, 0);
    for (start, &(end, sign, over)) in all.iter().enumerate().rev() {
        if start < end && !over {
            let (mut of_parts, mut linking) = (from_first[end], 0);
            for k in start + 1..end {
                let (other, other_sign, over) = all[k];
                of_parts += by_last[k];
                if other < start {
                    // Changed, if it is passed first below.
                    linking += if over { -other_sign } else { other_sign };
                } else if other > end {
                    linking += other_sign;
                    if over {
                        by_last[other] += sign * other_sign;
                        pairs += sign * other_sign;
                    }
                }
            }
            linking /= 2;
            let before = v2 + sign * linking;
            doubled += sign * (v2 + before + linking * linking - 2 * of_parts);
            v2 = before;
        }
        from_first[start] = pairs;
    }
    debug_assert_eq!(v2, pairs, "`v2` of the knot, by changes and by its formula");
    doubled / 2
}
