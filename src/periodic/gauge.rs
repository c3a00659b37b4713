//! Names of the images that follow from the entries alone.
//!
//! If each curve `i` is moved by a lattice vector `s[i]`, the entry `i, j, n` becomes
//! `i, j, n + s[i] - s[j]`. The translation of a ring and a yarn that runs through the cell counts
//! up to multiples of the period of the yarn.
//!
//! # Method
//!
//! Curves are visited breadth first along the entries, from the smallest of each connected part. An
//! entry by which a curve is reached first gets the translation 0: of several, the smallest one in
//! an order that moving a curve does not change. The translations of all other entries follow from
//! these, except for one freedom: if a curve is reached by the entry of a ring and a yarn, this
//! curve and all that are reached through it may be moved by the period of that yarn. Such motions
//! change an entry by the vectors of some lattice, its own period included. Each entry in turn gets
//! the smallest remainder modulo this lattice. Only motions that do not change it remain.
//!
//! # Limits
//!
//! If a period is a multiple of a lattice vector, images between its ends have no order that
//! motions do not change. If several entries of one ring and such a yarn differ by a fraction of
//! the period, the names may then depend on the coordinates.

use super::names::{Entry, neighbours};
use super::{ImagePair, YarnPeriod, period_of_pair};
use crate::curve::vector::per_axis;
use crate::curve::{Image, minus, plus};
use std::collections::{BTreeMap, VecDeque};

/// Returns the entries under names that follow from the entries and the periods alone, sorted: they
/// are the same whichever images the coordinates belong to.
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
    let named = order.into_iter().map(|(pair, lambda)| {
        let ImagePair { i, j, image } = pair;
        let image = match i == j {
            // The images of a curve itself keep their names.
            true => image,
            false => gauge.fix(pair, period_of_pair(periods, i, j)),
        };
        (ImagePair { i, j, image }, lambda)
    });
    let mut named: Vec<Entry> = named.collect();
    named.sort_unstable();
    named
}

/// Returns numbers by which translations are sorted. Their order does not change if the same vector
/// is added to all. They are equal if two translations differ by a multiple of a fraction of the
/// period.
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

/// The entries by which curves are reached first.
struct Tree {
    /// Motion of each curve that makes these entries 0.
    shifts: Vec<Image>,
    /// Curves in the order of a walk through the tree: each curve is followed by all that are
    /// reached through it. First and last place of each.
    places: Vec<[usize; 2]>,
    /// Curves that are reached by an entry of a ring and a yarn, and the period of that yarn.
    free: Vec<(usize, Image)>,
}

impl Tree {
    fn new(curves: usize, entries: &[Entry], periods: &[YarnPeriod]) -> Tree {
        let mut of = neighbours(curves, entries);
        for (i, list) in (0..).zip(&mut of) {
            let period = |j: u32| period_of_pair(periods, i, j);
            list.sort_by_key(|&(j, image, _)| (j, rank(image, period(j)), image));
        }
        let mut shifts: Vec<Option<Image>> = vec![None; curves];
        let mut children = vec![Vec::new(); curves];
        let (mut free, mut roots, mut queue) = (Vec::new(), Vec::new(), VecDeque::new());
        for root in 0..curves {
            if shifts[root].is_none() {
                shifts[root] = Some(Image::default());
                roots.push(root);
                queue.push_back((root, Image::default()));
            }
            while let Some((i, shift)) = queue.pop_front() {
                for &(other, image, _) in &of[i] {
                    let j = other as usize;
                    if shifts[j].is_none() {
                        let moved = plus(image, shift);
                        shifts[j] = Some(moved);
                        children[i].push(j);
                        let period = period_of_pair(periods, i as u32, other);
                        free.extend(period.map(|period| (j, period)));
                        queue.push_back((j, moved));
                    }
                }
            }
        }
        let mut places = vec![[0; 2]; curves];
        let mut count = 0;
        // Each curve twice: on the way down, and on the way up.
        let mut stack: Vec<(usize, bool)> = roots.into_iter().rev().map(|i| (i, false)).collect();
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
            shifts: shifts.into_iter().map(Option::unwrap_or_default).collect(),
            places,
            free,
        }
    }

    /// Returns how an entry changes if the curves at a free place are moved once.
    fn effect(&self, k: usize, (i, j): (u32, u32)) -> [i64; 3] {
        let (root, period) = self.free[k];
        let [first, last] = self.places[root];
        let moves = |i: u32| i64::from((first..last).contains(&self.places[i as usize][0]));
        let times = moves(i) - moves(j);
        period.map(|n| times * i64::from(n))
    }
}

/// Multiples of the motions of the free places of a tree.
type Motion = BTreeMap<usize, i64>;

/// Motions that remain, and the one that is made.
struct Gauge<'a> {
    tree: &'a Tree,
    /// Independent motions that change none of the entries so far.
    rest: Vec<Motion>,
    made: Motion,
}

/// Adds a multiple of a motion.
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

    /// Returns the translation of an entry, which counts up to multiples of a period, and keeps
    /// only the motions that do not change it.
    fn fix(&mut self, ImagePair { i, j, image }: ImagePair, period: Option<Image>) -> Image {
        let [from, to] = [i, j].map(|i| self.tree.shifts[i as usize]);
        let made = self.effect(&self.made, (i, j));
        let named = minus(plus(image, from), to);
        let mut value = per_axis(|x| i64::from(named[x]).wrapping_add(made[x]));
        // Vectors by which the entry may change, and the motions that do so.
        let motions = std::mem::take(&mut self.rest).into_iter();
        let effects = motions.map(|motion| (self.effect(&motion, (i, j)), motion));
        let (mut vectors, mut rest): (Vec<_>, Vec<_>) =
            effects.partition(|(effect, _)| *effect != [0; 3]);
        vectors.extend(period.map(|period| (period.map(i64::from), Motion::new())));
        for x in 0..3 {
            // Euclid's algorithm: a single vector with this component remains.
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
                let times = value[x].div_euclid(pivot[x].abs());
                let times = times.wrapping_mul(pivot[x].signum());
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

/// Returns the vector with the smallest component along an axis that is not 0.
fn smallest(vectors: &[([i64; 3], Motion)], x: usize) -> Option<usize> {
    let all = vectors.iter().enumerate().filter(|(_, v)| v.0[x] != 0);
    all.min_by_key(|(_, v)| v.0[x].abs()).map(|(k, _)| k)
}
