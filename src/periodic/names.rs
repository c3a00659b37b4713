//! Names of the images. Each curve may be given by the coordinates of any of its images, and an
//! image is named by its translation from the given one.
//!
//! If each curve `i` is moved by a lattice vector `s[i]`, the entry `i, j, n` becomes
//! `i, j, n + s[i] - s[j]`. Two lists of entries describe the same periodic topology if some `s`
//! maps one to the other.
//!
//! The translation in the entry of a ring and a yarn (a curve that runs through the cell) is
//! defined only up to multiples of the period of the yarn.
//!
//! # Canonical names, which follow from the entries alone
//!
//! Curves are visited breadth first along the entries, from the smallest curve of each connected
//! part. The entry by which a curve is first reached gets the translation 0. If several entries
//! reach it, the smallest one is used, in an order that does not change if a curve is moved. The
//! translations of all other entries follow from these, with one freedom: if a curve is reached by
//! the entry of a ring and a yarn, this curve and all curves that are reached through it may be
//! moved by the period of that yarn. Such motions change an entry by the vectors of a lattice,
//! which includes its own period. Each entry in turn gets the smallest remainder modulo this
//! lattice. Only motions that do not change this entry remain for the next ones.
//!
//! # Limits
//!
//! If a period is a multiple of a lattice vector, no order of the images between its ends is the
//! same after all motions. If several entries of one ring and such a yarn differ by a fraction of
//! the period, the names may therefore depend on the coordinates.

use super::ImagePair;
use super::through::{YarnPeriod, period_of_pair, reduced};
use crate::curve::vector::per_axis;
use crate::curve::{Image, minus, plus};
use crate::pairs::sorted;
use std::collections::{BTreeMap, VecDeque};

/// An entry of a list of linking numbers. `None`: the pair has no linking number. The translation
/// may be 0.
pub(crate) type Entry = (ImagePair, Option<i64>);

/// An entry of a curve: the other curve, its translation, and the linking number.
type Neighbour = (u32, Image, Option<i64>);

/// Entries of each curve, sorted by the other curve.
type Neighbours = Vec<Vec<Neighbour>>;

fn neighbours(curves: usize, entries: &[Entry]) -> Neighbours {
    let mut of = vec![Vec::new(); curves];
    for &(ImagePair { i, j, image }, lambda) in entries {
        // An entry of a curve and its own image does not change if the curve is moved.
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

/// Returns entries with other translations, sorted. `image` is called in the order of the entries.
fn with_images(entries: &[Entry], mut image: impl FnMut(ImagePair) -> Image) -> Vec<Entry> {
    sorted(entries.iter().map(|&(pair, lambda)| {
        let image = image(pair);
        (ImagePair { image, ..pair }, lambda)
    }))
}

/// Returns the entries after each curve `i` was moved by `shifts[i]`, sorted.
fn renamed(entries: &[Entry], shifts: &[Image]) -> Vec<Entry> {
    with_images(entries, |ImagePair { i, j, image }| {
        minus(plus(image, shifts[i as usize]), shifts[j as usize])
    })
}

/// Returns entries with the translations of rings and yarns reduced by the periods of the yarns,
/// sorted.
pub(crate) fn reduced_all(entries: &[Entry], periods: &[YarnPeriod]) -> Vec<Entry> {
    with_images(entries, |ImagePair { i, j, image }| {
        let period = period_of_pair(periods, i, j);
        period.map_or(image, |period| reduced(image, period))
    })
}

/// Returns the entries of a baseline with the names that the images have in a frame, reduced and
/// sorted, so that as many entries as possible equal those of the frame. If the topology is the
/// same, all do.
///
/// If it is not, curves are visited breadth first along the pairs that are linked in both. Each
/// curve is moved so that it agrees with most of the curves that were visited before.
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
    let shifts = breadth_first(&before, |_, &(j, ..), shifts| {
        most_agreed(j, [&before, &now], shifts)
    });
    reduced_all(&renamed(baseline, &shifts), periods)
}

/// Moves the curves, breadth first along their entries, from the smallest curve of each connected
/// part, which stays where it is. Returns the motion of each curve.
///
/// `motion` returns the motion of a curve that is not reached yet, if it is known. Its arguments
/// are a curve that is reached, the first entry of that curve with the other one, and the motions
/// so far.
fn breadth_first(
    of: &Neighbours,
    mut motion: impl FnMut(usize, &Neighbour, &[Option<Image>]) -> Option<Image>,
) -> Vec<Image> {
    let mut shifts: Vec<Option<Image>> = vec![None; of.len()];
    let mut queue = VecDeque::new();
    for root in 0..of.len() {
        if shifts[root].is_none() {
            shifts[root] = Some(Image::default());
            queue.push_back(root);
        }
        while let Some(i) = queue.pop_front() {
            for entries in of[i].chunk_by(|a, b| a.0 == b.0) {
                let j = entries[0].0 as usize;
                if shifts[j].is_none()
                    && let Some(shift) = motion(i, &entries[0], &shifts)
                {
                    shifts[j] = Some(shift);
                    queue.push_back(j);
                }
            }
        }
    }
    shifts.into_iter().map(Option::unwrap_or_default).collect()
}

/// Returns the motion of curve `j` of the baseline after which most of its entries equal those of
/// the frame, among the entries with curves whose motion is known. `None` if no entry is equal.
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

/// Returns the entries with canonical names, sorted. The names follow from the entries and the
/// periods alone, and do not depend on the images by which the curves are given.
pub(crate) fn canonical(curves: usize, entries: &[Entry], periods: &[YarnPeriod]) -> Vec<Entry> {
    let tree = Tree::new(curves, entries, periods);
    let motions = (0..tree.free.len()).map(|k| Motion::from([(k, 1)]));
    let mut gauge = Gauge {
        tree: &tree,
        rest: motions.collect(),
        made: Motion::new(),
    };
    let mut order: Vec<Entry> = entries.to_vec();
    order.sort_by_key(|(pair, lambda)| {
        let rank = rank(pair.image, period_of_pair(periods, pair.i, pair.j));
        (pair.i, pair.j, rank, pair.image, *lambda)
    });
    with_images(&order, |pair| match pair.i == pair.j {
        // The images of a curve itself keep their names.
        true => pair.image,
        false => gauge.fix(pair, period_of_pair(periods, pair.i, pair.j)),
    })
}

/// Returns a key by which translations are sorted. The order of two translations does not change if
/// the same vector is added to both. The keys are equal if the translations differ by a multiple of
/// a fraction of the period.
fn rank(image: Image, period: Option<Image>) -> [i64; 3] {
    let n = image.map(i64::from);
    let Some(p) = period.map(|p| p.map(i64::from)) else {
        return n;
    };
    let x = (0..3).find(|&x| p[x] != 0).unwrap_or(0);
    let across = |y: usize| (n[y] * p[x] - p[y] * n[x]) * p[x].signum();
    let [y, z] = [(x + 1) % 3, (x + 2) % 3];
    [across(y.min(z)), across(y.max(z)), 0]
}

/// Spanning forest of the curves: the entries by which they are first reached.
struct Tree {
    /// Motion of each curve that makes these entries 0.
    shifts: Vec<Image>,
    /// Range of each subtree in a depth-first order of the curves: the place of the curve, and the
    /// place after its last descendant.
    places: Vec<[usize; 2]>,
    /// Curves that are reached by the entry of a ring and a yarn, and the period of that yarn.
    /// Their subtrees may be moved by it.
    free: Vec<(usize, Image)>,
}

impl Tree {
    fn new(curves: usize, entries: &[Entry], periods: &[YarnPeriod]) -> Tree {
        let mut of = neighbours(curves, entries);
        for (i, list) in (0..).zip(&mut of) {
            let period = |j: u32| period_of_pair(periods, i, j);
            list.sort_by_key(|&(j, image, _)| (j, rank(image, period(j)), image));
        }
        let (mut children, mut free) = (vec![Vec::new(); curves], Vec::new());
        let mut is_root = vec![true; curves];
        let shifts = breadth_first(&of, |i, &(other, image, _), shifts| {
            let j = other as usize;
            children[i].push(j);
            is_root[j] = false;
            let period = period_of_pair(periods, i as u32, other);
            free.extend(period.map(|period| (j, period)));
            Some(plus(image, shifts[i]?))
        });
        let mut places = vec![[0; 2]; curves];
        let mut count = 0;
        // Each curve is on the stack twice: before and after its subtree.
        let roots = (0..curves).rev().filter(|&i| is_root[i]);
        let mut stack: Vec<(usize, bool)> = roots.map(|i| (i, false)).collect();
        while let Some((i, done)) = stack.pop() {
            if done {
                places[i][1] = count;
                continue;
            }
            places[i][0] = count;
            count += 1;
            stack.push((i, true));
            stack.extend(children[i].iter().map(|&j| (j, false)));
        }
        Tree {
            shifts,
            places,
            free,
        }
    }

    /// Returns the change of an entry if free subtree `k` is moved by its period once.
    fn effect(&self, k: usize, (i, j): (u32, u32)) -> [i64; 3] {
        let (root, period) = self.free[k];
        let [first, last] = self.places[root];
        let moves = |i: u32| i64::from((first..last).contains(&self.places[i as usize][0]));
        let times = moves(i) - moves(j);
        period.map(|n| times * i64::from(n))
    }
}

/// How often each free subtree is moved by its period.
type Motion = BTreeMap<usize, i64>;

/// Motions that may still be made, and the motion that was made so far.
struct Gauge<'a> {
    tree: &'a Tree,
    /// Independent motions that change none of the entries so far.
    rest: Vec<Motion>,
    made: Motion,
}

/// Adds `times` a motion to another one.
fn add(to: &mut Motion, motion: &Motion, times: i64) {
    for (&k, &n) in motion {
        let sum = to.entry(k).or_default();
        *sum = sum.wrapping_add(times.wrapping_mul(n));
    }
    to.retain(|_, n| *n != 0);
}

impl Gauge<'_> {
    fn effect(&self, motion: &Motion, pair: (u32, u32)) -> [i64; 3] {
        let mut sum = [0; 3];
        for (&k, &n) in motion {
            let one = self.tree.effect(k, pair);
            sum = per_axis(|x| sum[x] + one[x].wrapping_mul(n));
        }
        sum
    }

    /// Returns the canonical translation of an entry, modulo its period, and keeps only the motions
    /// that do not change it.
    fn fix(&mut self, ImagePair { i, j, image }: ImagePair, period: Option<Image>) -> Image {
        let [from, to] = [i, j].map(|i| self.tree.shifts[i as usize]);
        let made = self.effect(&self.made, (i, j));
        let named = minus(plus(image, from), to);
        let mut value = per_axis(|x| i64::from(named[x]).wrapping_add(made[x]));
        // Vectors by which the entry may be changed, and the motions that change it.
        let motions = std::mem::take(&mut self.rest).into_iter();
        let effects = motions.map(|motion| (self.effect(&motion, (i, j)), motion));
        let (mut vectors, mut rest): (Vec<_>, Vec<_>) =
            effects.partition(|(effect, _)| *effect != [0; 3]);
        vectors.extend(period.map(|period| (period.map(i64::from), Motion::new())));
        for x in 0..3 {
            // Euclid's algorithm, until a single vector with this component remains.
            while let Some(k) = smallest(&vectors, x) {
                let (pivot, motion) = vectors.swap_remove(k);
                let mut divided = true;
                for (other, by) in vectors.iter_mut().filter(|v| v.0[x] != 0) {
                    let times = other[x].div_euclid(pivot[x]);
                    *other = per_axis(|y| other[y].wrapping_sub(times.wrapping_mul(pivot[y])));
                    add(by, &motion, -times);
                    divided &= other[x] == 0;
                }
                if !divided {
                    vectors.push((pivot, motion));
                    continue;
                }
                let times = value[x].div_euclid(pivot[x]);
                value = per_axis(|y| value[y].wrapping_sub(times.wrapping_mul(pivot[y])));
                add(&mut self.made, &motion, -times);
                break;
            }
        }
        rest.extend(vectors);
        let motions = rest.into_iter().map(|(_, motion)| motion);
        self.rest = motions.filter(|motion| !motion.is_empty()).collect();
        value.map(|x| x as i32)
    }
}

/// Returns the index of the vector with the smallest absolute component along an axis, of those
/// that are not 0 there.
fn smallest(vectors: &[([i64; 3], Motion)], x: usize) -> Option<usize> {
    let all = vectors.iter().enumerate().filter(|(_, v)| v.0[x] != 0);
    all.min_by_key(|(_, v)| v.0[x].abs()).map(|(k, _)| k)
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

    /// Returns true if the same ring and yarn have another entry with another linking number. The
    /// difference of the two translations is then meaningful, because no period is parallel to the
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
