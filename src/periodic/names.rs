//! Names of the images: each curve may be given by the coordinates of any of its images.
//!
//! If each curve `i` is moved by a lattice vector `s[i]`, the entry `i, j, n` becomes
//! `i, j, n + s[i] - s[j]`. Two lists of entries describe the same periodic topology if some `s`
//! maps one to the other.

use super::ImagePair;
use super::gauge::canonical;
use super::through::{YarnPeriod, period_of_pair, reduced};
use crate::curve::{Image, minus, plus};
use std::collections::{BTreeMap, VecDeque};

/// An entry of a list of linking numbers; `None`: the pair has no linking number. The translation
/// may be 0.
pub(crate) type Entry = (ImagePair, Option<i64>);

/// Entries of each curve: the other curve, its translation, and the linking number.
pub(super) type Neighbours = Vec<Vec<(u32, Image, Option<i64>)>>;

pub(super) fn neighbours(curves: usize, entries: &[Entry]) -> Neighbours {
    let mut of = vec![Vec::new(); curves];
    for &(ImagePair { i, j, image }, lambda) in entries {
        // The images of a curve itself keep their names.
        if i != j {
            of[i as usize].push((j, image, lambda));
            of[j as usize].push((i, minus(Image::default(), image), lambda));
        }
    }
    for list in &mut of {
        list.sort_unstable();
    }
    of
}

/// Returns entries under the names after curves were moved by `shifts`.
fn renamed(entries: &[Entry], shifts: &[Image]) -> Vec<Entry> {
    let rename = |&(pair, lambda): &Entry| {
        let ImagePair { i, j, image } = pair;
        let image = minus(plus(image, shifts[i as usize]), shifts[j as usize]);
        (ImagePair { i, j, image }, lambda)
    };
    entries.iter().map(rename).collect()
}

/// Returns entries with the translations of rings and yarns reduced by the periods of the yarns,
/// sorted.
pub(crate) fn reduced_all(entries: &[Entry], periods: &[YarnPeriod]) -> Vec<Entry> {
    let reduce = |&(ImagePair { i, j, image }, lambda): &Entry| {
        let period = period_of_pair(periods, i, j);
        let image = period.map_or(image, |period| reduced(image, period));
        (ImagePair { i, j, image }, lambda)
    };
    let mut out: Vec<Entry> = entries.iter().map(reduce).collect();
    out.sort_unstable();
    out
}

/// Returns the entries of a baseline under the names that a frame has for the images, reduced and
/// sorted, such that many entries are equal. If the topology is the same, all are.
///
/// If it is not, curves are visited breadth first along the pairs that are linked in both. The
/// first names that most of the pairs with known names agree on are taken.
pub(crate) fn aligned(
    curves: usize,
    baseline: &[Entry],
    frame: &[Entry],
    periods: &[YarnPeriod],
) -> Vec<Entry> {
    let [known, found] = [baseline, frame].map(|entries| canonical(curves, entries, periods));
    if known == found {
        return reduced_all(frame, periods);
    }
    let [before, now] = [baseline, frame].map(|entries| neighbours(curves, entries));
    let mut shifts: Vec<Option<Image>> = vec![None; curves];
    let mut queue = VecDeque::new();
    for root in 0..curves {
        if shifts[root].is_none() {
            shifts[root] = Some(Image::default());
            queue.push_back(root);
        }
        while let Some(i) = queue.pop_front() {
            let mut others: Vec<u32> = before[i].iter().map(|n| n.0).collect();
            others.dedup();
            for j in others {
                if shifts[j as usize].is_none()
                    && let Some(shift) = most_agreed(j, [&before, &now], &shifts)
                {
                    shifts[j as usize] = Some(shift);
                    queue.push_back(j as usize);
                }
            }
        }
    }
    let shifts: Vec<Image> = shifts.into_iter().map(Option::unwrap_or_default).collect();
    reduced_all(&renamed(baseline, &shifts), periods)
}

/// Returns the motion of curve `j` of the baseline with which most of its entries with curves of
/// known motion are those of the frame; `None` if there is no such entry.
fn most_agreed(j: u32, [before, now]: [&Neighbours; 2], shifts: &[Option<Image>]) -> Option<Image> {
    let mut votes = BTreeMap::<Image, u32>::new();
    for &(i, was, lambda) in &before[j as usize] {
        let Some(shift) = shifts[i as usize] else {
            continue;
        };
        // The entry `j, i, was` becomes `j, i, was + s[j] - s[i]`.
        let same = now[j as usize].iter().filter(|n| (n.0, n.2) == (i, lambda));
        for &(_, is, _) in same {
            *votes.entry(plus(minus(is, was), shift)).or_default() += 1;
        }
    }
    let most = votes.values().max().copied()?;
    votes.into_iter().find(|v| v.1 == most).map(|v| v.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn entry(i: u32, j: u32, image: Image, lambda: i64) -> Entry {
        (ImagePair { i, j, image }, Some(lambda))
    }

    fn random_entries(random: &mut Random, curves: u32) -> Vec<Entry> {
        let mut entries = BTreeMap::new();
        for _ in 0..2 * curves {
            let pair = [0; 2].map(|_| random.below(curves as i32) as u32);
            let image = [0; 3].map(|_| random.below(3) - 1);
            let lambda = i64::from(random.pick(&[-2, -1, 1, 1, 1]));
            let [i, j] = pair;
            if i != j || image != Image::default() {
                entries.insert(ImagePair::new(i, j, image), Some(lambda));
            }
        }
        entries.into_iter().collect()
    }

    /// Moving curves by lattice vectors changes neither the canonical entries nor the equality with
    /// a baseline.
    #[test]
    fn moved_curves_have_the_same_topology() {
        let mut random = Random::new(4);
        for _ in 0..2000 {
            let curves = 2 + random.below(8) as usize;
            let entries = random_entries(&mut random, curves as u32);
            let shifts: Vec<Image> = (0..curves)
                .map(|_| [0; 3].map(|_| random.below(9) - 4))
                .collect();
            let moved = renamed(&entries, &shifts);
            let all = [&entries, &moved].map(|entries| canonical(curves, entries, &[]));
            assert_eq!(all[0], all[1]);
            assert_eq!(canonical(curves, &all[0], &[]), all[0]);
        }
    }

    /// A baseline under other names equals a frame of the same topology, if no two images of one
    /// curve look alike.
    #[test]
    fn a_baseline_is_found_under_other_names() {
        let mut random = Random::new(5);
        for _ in 0..2000 {
            let curves = 2 + random.below(8) as usize;
            let mut entries = random_entries(&mut random, curves as u32);
            entries.dedup_by_key(|e| (e.0.i, e.0.j));
            let shifts: Vec<Image> = (0..curves)
                .map(|_| [0; 3].map(|_| random.below(9) - 4))
                .collect();
            let baseline = renamed(&entries, &shifts);
            let aligned = aligned(curves, &baseline, &entries, &[]);
            entries.sort_unstable();
            assert_eq!(aligned, entries);
        }
    }

    /// The rings of a ladder: each is linked with the next one; the last one with an image of the
    /// first one. No choice of names removes that translation.
    #[test]
    fn a_link_across_the_boundary_is_kept() {
        let ladder = [
            entry(0, 1, [0, 0, 0], 1),
            entry(1, 2, [0, 0, 0], 1),
            entry(0, 2, [-1, 0, 0], 1),
        ];
        assert_eq!(canonical(3, &ladder, &[])[1], entry(0, 2, [0, 0, 0], 1));
        let total = |entries: &[Entry]| {
            let x = |k: usize| entries[k].0.image[0];
            x(0) + x(2) - x(1)
        };
        assert_eq!(total(&canonical(3, &ladder, &[])).abs(), 1);
        let mut broken = ladder;
        broken[2].0.image = [0, 0, 0];
        assert_ne!(canonical(3, &ladder, &[]), canonical(3, &broken, &[]));
        assert_ne!(aligned(3, &ladder, &broken, &[]), broken.to_vec());
    }

    /// Rings and yarns: the translations of their entries count up to multiples of the periods.
    #[test]
    fn names_of_rings_and_yarns_do_not_depend_on_the_images() {
        let mut random = Random::new(6);
        let (mut several, mut total) = (0, 0);
        for case in 0..4000 {
            let curves = 2 + random.below(9) as usize;
            let any = [
                [1, 0, 0],
                [0, -1, 0],
                [0, 0, 1],
                [1, 1, 0],
                [-1, 2, 0],
                [2, -1, 3],
            ];
            let yarns = (0..curves as u32).filter(|_| random.one_in(2));
            let yarns: Vec<u32> = yarns.collect();
            let periods: Vec<YarnPeriod> = yarns.iter().map(|&i| (i, random.pick(&any))).collect();
            let entries = random_entries(&mut random, curves as u32);
            let is_yarn = |i: u32| yarns.contains(&i);
            // Two yarns have no number.
            let entries: Vec<Entry> = entries
                .into_iter()
                .filter(|(pair, _)| !(is_yarn(pair.i) && is_yarn(pair.j)))
                .collect();
            let mut entries = reduced_all(&entries, &periods);
            entries.dedup_by_key(|e| e.0);
            let shifts: Vec<Image> = (0..curves)
                .map(|_| [0; 3].map(|_| random.below(9) - 4))
                .collect();
            let moved = renamed(&entries, &shifts);
            // Any multiple of the period.
            let moved = moved.into_iter().map(|(pair, lambda)| {
                let ImagePair { i, j, image } = pair;
                let times = random.below(7) - 3;
                let period = period_of_pair(&periods, i, j).unwrap_or_default();
                let image = plus(image, period.map(|n| times * n));
                (ImagePair { i, j, image }, lambda)
            });
            let moved: Vec<Entry> = moved.collect();
            let all = [&entries, &moved].map(|entries| canonical(curves, entries, &periods));
            assert_eq!(all[0], all[1], "case {case}: {periods:?} {entries:?}");
            assert_eq!(canonical(curves, &all[0], &periods), all[0], "case {case}");
            assert_eq!(
                aligned(curves, &moved, &entries, &periods),
                entries,
                "case {case}"
            );
            several += usize::from(all[0].iter().any(|e| e.0.image != Image::default()));
            total += entries.len();
            // The names tell different structures apart: one entry has another translation.
            if let Some(k) = (0..entries.len()).find(|&k| is_in_a_loop(&entries, k, &periods)) {
                let mut other = entries.clone();
                other[k].0.image = plus(other[k].0.image, [0, 0, 7]);
                let other = canonical(curves, &other, &periods);
                assert_ne!(other, all[0], "case {case}: {periods:?} {entries:?}");
            }
        }
        assert!(several > 1000 && total > 10_000, "{several} {total}");
    }

    /// Returns true if the same ring and yarn have another entry, with another linking number, so
    /// that the difference of both translations means something: no period has the direction of the
    /// third vector.
    fn is_in_a_loop(entries: &[Entry], k: usize, periods: &[YarnPeriod]) -> bool {
        let (ImagePair { i, j, .. }, lambda) = entries[k];
        let Some(period) = period_of_pair(periods, i, j) else {
            return false;
        };
        let same = entries.iter().filter(|e| (e.0.i, e.0.j) == (i, j));
        period[2] == 0 && same.clone().count() == 2 && same.clone().any(|e| e.1 != lambda)
    }
}
