//! Shares of the pairs of curves, for several verifiers that verify one scene together.
//!
//! Each curve has an owner: one of the shards. A pair of curves with the same owner belongs to that
//! shard, as does a curve with itself. A pair of curves with two owners belongs to one of the two,
//! which a parity of each curve decides, so that both get half of such pairs. So every pair belongs
//! to exactly one shard, wherever the curves are, and a curve keeps its owner in all later frames.
//!
//! A shard needs the boxes of its own curves, and of those that are near them ([`Nearby`]).

use crate::curve::{Box3, CurveSet, Image, Translated};
use crate::error::{Error, Result};
use crate::pairs::{Leaves, LinkSearch, Pair};
use std::sync::Arc;

/// Number of boxes around the curves of a shard. More boxes follow a bent shape more closely.
const REGIONS: usize = 16;

/// Share of the size of such a box by which it is grown, so that few frames need other curves than
/// the previous one.
const MARGIN: f32 = 0.02;

/// Number of curves, relative to those that are needed, above which others are discarded.
const SUPERFLUOUS: usize = 2;

/// Division of the pairs of curves of a scene among several verifiers ("shards").
///
/// ```
/// use linkwatch::{Basis, CurveSet, Partition, Positions};
///
/// let square = |x: f64| [x, 0., 0., x + 1., 0., 0., x + 1., 1., 0., x, 1., 0.];
/// let four: Vec<f64> = [0., 0.5, 8., 8.5].into_iter().flat_map(square).collect();
/// let set = CurveSet::from_counts(Basis::Polyline, &[-4; 4], Positions::F64(&four))?;
/// let partition = Partition::new(&set, 2)?;
/// // The first two squares are near each other, and so are the last two.
/// assert_eq!(partition.owner(0, 1), partition.owner(0, 0));
/// assert_ne!(partition.owner(0, 1), partition.owner(2, 3));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Partition {
    /// For each curve twice its owner, plus its parity.
    keys: Arc<[u8]>,
    shards: u8,
}

impl Partition {
    /// Maximum number of shards.
    pub const MAX_SHARDS: usize = 16;

    /// Divides the pairs of a scene, such that the predicted costs of the shards are equal and each
    /// one has curves that are near one another (recursive coordinate bisection).
    ///
    /// A pair is not divided further: a scene of two curves has work for one shard only.
    ///
    /// Errors: [`Error::Usage`] if the number of shards is 0 or more than
    /// [`Partition::MAX_SHARDS`].
    pub fn new(set: &CurveSet, shards: usize) -> Result<Partition> {
        check_shards(shards)?;
        let boxes = set.coarse_boxes();
        // The boxes and trees of a curve, and a part of the cost of each of its pairs.
        let mut costs: Vec<f64> = set.curves().iter().map(|c| c.segments.into()).collect();
        for &(i, j) in LinkSearch::default().find(&boxes).iter() {
            let [i, j] = [i, j].map(|i| i as usize);
            let pair = f64::from(set.curve(i).segments + set.curve(j).segments);
            costs[i] += pair / 2.0;
            costs[j] += pair / 2.0;
        }
        let mut curves: Vec<u32> = (0..set.len() as u32).collect();
        let mut keys = vec![0; set.len()];
        let bisection = Bisection {
            boxes: &boxes,
            costs: &costs,
        };
        bisection.divide(&mut curves, 0..shards as u8, &mut |curve, owner| {
            keys[curve as usize] = 2 * owner + (curve % 2) as u8;
        });
        Ok(Partition {
            keys: keys.into(),
            shards: shards as u8,
        })
    }

    /// Returns the partition of the curves after a change. Curves that continue keep their owner;
    /// `origins` has their index before the change.
    pub(crate) fn with_curves(&self, origins: &[Option<u32>]) -> Partition {
        let key = |(i, origin): (usize, &Option<u32>)| match origin {
            Some(before) => self.keys[*before as usize],
            None => (i % (2 * usize::from(self.shards))) as u8,
        };
        Partition {
            keys: origins.iter().enumerate().map(key).collect(),
            shards: self.shards,
        }
    }

    /// Returns the number of shards.
    pub fn shards(&self) -> usize {
        self.shards.into()
    }

    /// Returns the number of curves.
    pub fn curves(&self) -> usize {
        self.keys.len()
    }

    /// Returns the shard that a pair of curves belongs to, from 0; with `i == j`, the one that a
    /// curve belongs to.
    ///
    /// # Panics
    /// If a curve is not part of the scene.
    pub fn owner(&self, i: u32, j: u32) -> usize {
        let [a, b] = [i, j].map(|i| self.keys[i as usize]);
        let (low, high) = (a.min(b), a.max(b));
        let owner = if (a ^ b) & 1 == 0 { low } else { high };
        usize::from(owner / 2)
    }

    /// Returns the share of one shard, from 0.
    ///
    /// # Panics
    /// If there is no such shard.
    pub fn share(&self, shard: usize) -> Share {
        assert!(shard < self.shards(), "shard {shard} of {}", self.shards);
        Share {
            partition: self.clone(),
            shard,
            special: None,
        }
    }

    /// Returns the partition as bytes, to send it to other processes.
    pub fn to_bytes(&self) -> Vec<u8> {
        [&[self.shards], &self.keys[..]].concat()
    }

    /// Returns the partition with these bytes.
    ///
    /// Errors: [`Error::Format`] if they are not those of a partition.
    pub fn from_bytes(bytes: &[u8]) -> Result<Partition> {
        let bad = |what: String| Error::format("partition of the pairs", "shards", what);
        let (&shards, keys) = bytes
            .split_first()
            .ok_or_else(|| bad("no bytes".to_owned()))?;
        check_shards(shards.into())?;
        match keys.iter().find(|&&key| key / 2 >= shards) {
            Some(key) => Err(bad(format!("owner {} of {shards}", key / 2))),
            None => Ok(Partition {
                keys: keys.into(),
                shards,
            }),
        }
    }
}

fn check_shards(shards: usize) -> Result<()> {
    let most = Partition::MAX_SHARDS;
    match (1..=most).contains(&shards) {
        true => Ok(()),
        false => Err(Error::Usage(format!(
            "{shards} shards, expected 1 to {most}"
        ))),
    }
}

/// Recursive bisection of curves at the centers of their boxes.
struct Bisection<'a> {
    boxes: &'a [Box3],
    costs: &'a [f64],
}

impl Bisection<'_> {
    /// Divides curves among a range of shards, in proportion to their costs. Calls `assign` for
    /// each curve with its owner.
    fn divide(
        &self,
        curves: &mut [u32],
        shards: std::ops::Range<u8>,
        assign: &mut impl FnMut(u32, u8),
    ) {
        let count = shards.len();
        if count == 1 {
            return curves.iter().for_each(|&i| assign(i, shards.start));
        }
        let center = |i: u32, x: usize| {
            let b = &self.boxes[i as usize];
            f64::from(b.lo[x]) + f64::from(b.hi[x])
        };
        let extent = |x: usize| {
            let centers = curves.iter().map(|&i| center(i, x));
            let (lo, hi) = centers.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), c| {
                (lo.min(c), hi.max(c))
            });
            hi - lo
        };
        let extents = [0, 1, 2].map(extent);
        let axis = (0..3).max_by(|&a, &b| extents[a].total_cmp(&extents[b]));
        let axis = axis.unwrap_or(0);
        curves.sort_by(|&i, &j| center(i, axis).total_cmp(&center(j, axis)));
        let half = count / 2;
        let total: f64 = curves.iter().map(|&i| self.costs[i as usize]).sum();
        let wanted = total * half as f64 / count as f64;
        // The first curve whose middle is beyond the wanted cost begins the second part.
        let mut sum = 0.0;
        let beyond = |&i: &u32| {
            sum += self.costs[i as usize];
            sum - 0.5 * self.costs[i as usize] >= wanted
        };
        let split = curves.iter().position(beyond).unwrap_or(curves.len());
        let middle = shards.start + half as u8;
        let (first, second) = curves.split_at_mut(split);
        self.divide(first, shards.start..middle, assign);
        self.divide(second, middle..shards.end, assign);
    }
}

/// The pairs of curves that one of several verifiers verifies
/// ([`Verifier::verify_share`](crate::Verifier::verify_share)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Share {
    partition: Partition,
    shard: usize,
    special: Option<Special>,
}

/// Pairs of a set in which some curves stand for something else.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Special {
    /// The curve that follows in the virtual loop of each curve, `u32::MAX` without a loop: only
    /// pairs with a loop are verified, except loops that share a curve.
    Loops(Arc<[u32]>),
    /// For each curve the curve of a frame, and its translation. Each pair of a curve and an image
    /// of another one, or of itself, is verified once ([`owns_image`]).
    Images(Translated),
}

/// Returns true if a set of translated curves has this pair: one of them is not translated, and
/// comes before the other one, or is the same curve translated forwards.
fn owns_image((i, m): (u32, Image), (j, n): (u32, Image)) -> bool {
    let home = Image::default();
    match (m == home, n == home) {
        (true, false) => i < j || i == j && n > home,
        (false, true) => j < i || j == i && m > home,
        _ => false,
    }
}

impl Share {
    /// Returns the share of the pairs with at least one virtual loop of a braid, without pairs of
    /// loops that share a curve. `next` has the other curve of the loop of each curve, `u32::MAX`
    /// if it has none.
    pub(crate) fn of_loops(next: Arc<[u32]>) -> Share {
        Share::special(next.len(), Special::Loops(next))
    }

    /// Returns the share of the pairs of a curve and an image, in a set of translated curves, each
    /// once.
    pub(crate) fn of_images(curves: Translated) -> Share {
        Share::special(curves.len(), Special::Images(curves))
    }

    fn special(curves: usize, special: Special) -> Share {
        Share {
            partition: Partition {
                keys: vec![0; curves].into(),
                shards: 1,
            },
            shard: 0,
            special: Some(special),
        }
    }

    /// Returns true if the share needs all curves, wherever they are.
    fn needs_all(&self) -> bool {
        matches!(self.special, Some(Special::Images(_)))
    }

    /// Returns true if a curve stands for a virtual loop.
    pub(crate) fn has_loop(&self, i: u32) -> bool {
        let Some(Special::Loops(next)) = &self.special else {
            return false;
        };
        next.get(i as usize).is_some_and(|&j| j != u32::MAX)
    }

    /// Returns the partition of all pairs.
    pub fn partition(&self) -> &Partition {
        &self.partition
    }

    /// Returns the number of this shard, from 0.
    pub fn shard(&self) -> usize {
        self.shard
    }

    /// Returns true if the share has this pair; with `i == j`, this curve.
    pub fn owns(&self, i: u32, j: u32) -> bool {
        match &self.special {
            Some(Special::Loops(next)) => {
                let [after_i, after_j] = [i, j].map(|i| next[i as usize]);
                let with_loop = after_i != u32::MAX || after_j != u32::MAX;
                with_loop && after_i != j && after_j != i
            }
            Some(Special::Images(curves)) => owns_image(curves[i as usize], curves[j as usize]),
            None => self.partition.owner(i, j) == self.shard,
        }
    }

    /// Returns the share of the curves after a change.
    pub(crate) fn with_curves(&self, origins: &[Option<u32>]) -> Share {
        Share {
            partition: self.partition.with_curves(origins),
            shard: self.shard,
            special: self.special.clone(),
        }
    }

    /// Keeps the pairs of the share.
    pub(crate) fn retain(&self, pairs: &mut Vec<Pair>) {
        pairs.retain(|&(i, j)| self.owns(i, j));
    }
}

/// Curves that a shard needs in a frame: its own, and those whose boxes come near to them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Nearby {
    needed: Vec<bool>,
}

impl Nearby {
    /// Finds the curves that a share needs in frames of the same curves: in each of them, and in
    /// the steps between them. Returns true if the curves differ from those of the last call.
    pub fn update(&mut self, share: &Share, frames: &[&CurveSet]) -> bool {
        if share.needs_all() {
            let all = vec![true; frames[0].len()];
            return std::mem::replace(&mut self.needed, all).len() != self.needed.len();
        }
        let mut boxes = frames[0].coarse_boxes();
        for frame in &frames[1..] {
            for (b, other) in boxes.iter_mut().zip(frame.coarse_boxes()) {
                *b = b.union(&other);
            }
        }
        let own: Vec<usize> = (0..boxes.len())
            .filter(|&i| share.owns(i as u32, i as u32))
            .collect();
        let regions: Vec<Box3> = own
            .chunks(own.len().div_ceil(REGIONS).max(1))
            .map(|curves| {
                let bounds = curves.iter().map(|&i| boxes[i]);
                bounds.fold(Box3::EMPTY, |a, b| a.union(&b))
            })
            .collect();
        let near = |regions: &[Box3]| -> Vec<bool> {
            let near = |b: &Box3| regions.iter().any(|region| region.overlaps(b));
            boxes.iter().map(near).collect()
        };
        let count = |needed: &[bool]| needed.iter().filter(|needed| **needed).count();
        let needed = near(&regions);
        let known = self.needed.len() == needed.len()
            && needed
                .iter()
                .zip(&self.needed)
                .all(|(now, known)| known >= now);
        if known && count(&self.needed) <= SUPERFLUOUS * count(&needed) {
            return false;
        }
        let grown = |b: &Box3| b.dilated(MARGIN * b.largest_side());
        let now = near(&regions.iter().map(grown).collect::<Vec<Box3>>());
        std::mem::replace(&mut self.needed, now) != self.needed
    }

    /// Returns the leaves of the needed curves.
    pub fn leaves<S: Leaves>(&self, leaves: S) -> NearbyLeaves<'_, S> {
        NearbyLeaves {
            leaves,
            needed: &self.needed,
        }
    }
}

/// Boxes of the curves that a shard needs. The others have no tree.
#[derive(Clone, Copy)]
pub(crate) struct NearbyLeaves<'a, S> {
    leaves: S,
    needed: &'a [bool],
}

impl<S: Leaves> Leaves for NearbyLeaves<'_, S> {
    fn curves(&self) -> &[crate::curve::Curve] {
        self.leaves.curves()
    }

    fn has_tree(&self, i: usize) -> bool {
        self.needed[i] && self.leaves.has_tree(i)
    }

    fn stored(&self, segments: u32) -> bool {
        self.leaves.stored(segments)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> crate::curve::BoxGroup {
        self.leaves.boxes(i, g)
    }
}
