//! Search for the pairs of a curve and an image that may meet.
//!
//! # Proof: no pair is missed
//!
//! Let the box of curve `i` overlap the box of curve `j`, translated by `n`. Translate both by the
//! lattice vector that brings the centre of the box of `i` into the first cell. The box of `j` is
//! then an image of its box with the centre in the first cell, and overlaps the union of all boxes
//! with their centres in the first cell. The search enumerates all images that overlap the bounds
//! of this union, and compares all pairs. Translations are integers in fractional coordinates, so
//! only the boxes are rounded, outward.

use super::boxes::{Bend, Boxer, FractionalBoxes, single, smaller_slack};
use super::through::RingAndYarn;
use crate::cancel::PairLimit;
use crate::curve::vector::{add, per_axis};
use crate::curve::{Box3, Cell, Curve, Image, Point, Translated, union};
use crate::error::{Error, Result};
use crate::incremental::{PointMap, QuietBounds};
use crate::pairs::{LinkSearch, PairFilter};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Maximum number of images that are compared, unless this is less than [`IMAGES`] per curve. An
/// image takes about 40 bytes.
const MOST_IMAGES: u64 = 1 << 22;

/// Number of images per curve that are allowed in any case.
const IMAGES: u64 = 64;

/// Maximum number of points of translated curves, unless this is less than [`COPIES`] times the
/// points of the frame. A point takes about 120 bytes.
const MOST_POINTS: usize = 1 << 22;

/// Number of copies of the whole frame that are allowed in any case.
const COPIES: usize = 32;

/// Maximum number of pairs of overlapping images, unless this is less than [`IMAGES`] per curve. A
/// pair takes about 16 bytes during the search.
const MOST_PAIRS: usize = 1 << 24;

/// Largest number of cells that a curve may be away from the first one.
const FARTHEST: f64 = (1_u32 << 30) as f64;

/// Margin: maximum distance that curves may move before the images are searched again, as a share
/// of the cell. A larger margin requires more images.
const MARGIN: f64 = 0.05;

/// Upper bound of the margin, as a share of the mean size of the curves.
const OF_SIZE: f64 = 0.5;

/// Margin along axes that are not periodic, as a share of the extent of the scene. It requires no
/// additional images.
const ACROSS: f64 = 0.5;

/// A curve `i`, and curve `j` translated by a lattice vector: `i < j`, or `i = j` and the
/// translation is positive in lexicographic order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct ImagePair {
    pub i: u32,
    pub j: u32,
    pub image: Image,
}

impl ImagePair {
    /// Returns the pair of curve `i` and curve `j` translated by `image`. Swaps the curves and
    /// reverses the translation if the order of an [`ImagePair`] requires it.
    pub fn new(i: u32, j: u32, image: Image) -> ImagePair {
        let (i, j, image) = match i < j || i == j && image > Image::default() {
            true => (i, j, image),
            false => (j, i, image.map(|n| -n)),
        };
        ImagePair { i, j, image }
    }
}

/// Curves and limits of a search for pairs.
#[derive(Clone, Copy)]
pub(crate) struct Searched<'a> {
    pub curves: &'a [Curve],
    /// Period of each curve, if it runs through the cell.
    pub periods: &'a Arc<[Option<Image>]>,
    /// True if open curves are searched, too.
    pub open_too: bool,
    /// Maximum number of pairs.
    pub most: usize,
}

impl Searched<'_> {
    fn is_closed(&self, i: u32) -> bool {
        self.curves[i as usize].closed
    }
}

/// The curves of a frame, and the images of them that may meet a curve.
#[derive(Debug)]
pub(crate) struct ImagePairs {
    /// All curves of the frame, and translated ones, sorted.
    pub curves: Translated,
    pub state: ImageState,
    /// Largest sides of the boxes in `state.within`.
    sides: Point,
}

/// State of a search, from which another process continues.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ImageState {
    /// All curves of the frame, and translated ones, sorted.
    curves: Vec<(u32, Image)>,
    /// Pairs of a closed curve and a yarn that may be linked.
    pub yarns: Vec<RingAndYarn>,
    /// Curves that may have a segment of more than half of the cell.
    pub wide: Vec<usize>,
    /// The list of pairs is complete as long as the curves stay within these boxes.
    within: FractionalBoxes,
}

/// Map to a quiet frame, and a lower bound of the slack of that frame ([`ImagePairs::slack`]).
pub(crate) type QuietSlack = (PointMap, Point);

impl ImagePairs {
    /// Finds all pairs of curves whose boxes overlap after they are grown by a margin, and adds the
    /// given pairs. The margin is a share of the cell, or a length along axes that are not
    /// periodic. The search must be repeated once a curve has moved by the margin.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a curve spans too many cells, or is too far away from the first
    /// one, or if the translated curves have too many points; [`Error::TooManyPairs`] if there are
    /// more than `most`.
    pub fn find(
        boxes: &FractionalBoxes,
        cell: &Cell,
        searched: &Searched<'_>,
        others: impl IntoIterator<Item = ImagePair>,
    ) -> Result<ImagePairs> {
        let periodic = cell.periodic();
        let within = boxes.dilated(per_axis(|x| match periodic[x] {
            true => MARGIN.min(OF_SIZE * boxes.mean_size(x)),
            false => ACROSS * boxes.extent(x),
        }));
        let mut found = PairCollector::new(searched);
        for pair in others {
            found.add(pair)?;
        }
        found.search(&within, cell)?;
        let PairCollector { curves, yarns, .. } = found;
        let own = (0..searched.curves.len() as u32).map(|i| (i, Image::default()));
        let mut curves: Vec<(u32, Image)> = own.chain(curves).collect();
        curves.sort_unstable_by_key(order);
        curves.dedup();
        let state = ImageState {
            curves,
            yarns: yarns.into_iter().collect(),
            wide: within.wide(cell),
            within,
        };
        Ok(ImagePairs::restored(state, searched.periods))
    }

    /// Returns the pairs of a state. `periods` has those of the curves that run through the cell.
    pub fn restored(state: ImageState, periods: &Arc<[Option<Image>]>) -> ImagePairs {
        ImagePairs {
            curves: Translated::new(state.curves.clone(), periods),
            sides: state.within.largest_sides(),
            state,
        }
    }

    /// Returns the slack of a frame along each direction: the minimum over all curves of the
    /// distance of the box from the faces of its grown box in the search. Negative or NaN if a box
    /// is not inside.
    pub fn slack(&self, boxer: &Boxer<'_>) -> Point {
        boxer.smallest_slack(|i, b| self.state.within.slack_for(i, b))
    }

    /// Returns true if the slack at one end of a step with this bend is sufficient. If it is at
    /// both ends, no pair that is not listed can have met in the step.
    pub fn is_enough(&self, slack: Point, bend: &Bend) -> bool {
        let most = bend.of(self.sides);
        (0..3).all(|x| slack[x] >= most[x])
    }

    /// Returns a lower bound of the slack of a quiet frame, without reading its points: the slack
    /// of an earlier frame minus the difference of the maps of both frames. If that is not
    /// sufficient for a step with this bend, computes a bound from the boxes of all curves.
    ///
    /// # Derivation: slack in another frame
    ///
    /// If the bounds of the control points differ by `d`, the boxes around the curves differ by
    /// less than `2 d`: the padding of splines grows with the size, by less than half of `d`.
    pub fn quiet_slack(
        &self,
        boxer: &Boxer<'_>,
        at: &QuietBounds<'_>,
        bend: &Bend,
        known: &mut Option<QuietSlack>,
    ) -> Point {
        let map = at.map(boxer.inverse);
        if let Some((earlier, slack)) = known
            && let Some(difference) = at.difference(&map, earlier)
        {
            let slack = per_axis(|x| slack[x] - 2.0 * difference[x]);
            if self.is_enough(slack, bend) {
                return slack;
            }
        }
        let boxes = at.bounds(&map).map(|b| boxer.padded(b));
        let within = &self.state.within;
        let slacks = boxes.enumerate().map(|(i, b)| within.slack_for(i, &b));
        let slack = slacks.fold([f64::INFINITY; 3], smaller_slack);
        *known = Some((map, slack));
        slack
    }

    /// Returns the filter of the pairs that are verified, among all pairs of these curves.
    pub fn filter(&self) -> PairFilter {
        PairFilter::Images(self.curves.clone())
    }

    /// Returns true if there are translated curves.
    pub fn has_images(&self) -> bool {
        self.curves.len() > self.state.within.0.len()
    }

    /// Returns the names of two curves, of which the first one is not translated.
    pub fn pair(&self, a: u32, b: u32) -> ImagePair {
        let [(i, _), (j, image)] = [a, b].map(|k| self.curves[k as usize]);
        ImagePair { i, j, image }
    }

    /// Returns the indices of the two curves of a pair. The first one is not translated.
    pub fn find_pair(&self, pair: ImagePair) -> Option<(u32, u32)> {
        let own = self.find_curve((pair.i, Image::default()))?;
        Some((own, self.find_curve((pair.j, pair.image))?))
    }

    /// Returns the index of a translated curve.
    pub fn find_curve(&self, key: (u32, Image)) -> Option<u32> {
        let found = self.curves.binary_search_by_key(&order(&key), order);
        found.ok().map(|k| k as u32)
    }
}

/// Returns the sort key of translated curves. Curves that are not translated come first.
fn order(&(curve, image): &(u32, Image)) -> (bool, Image, u32) {
    (image != Image::default(), image, curve)
}

/// Pairs found by a search.
struct PairCollector<'a> {
    searched: &'a Searched<'a>,
    pairs: BTreeSet<ImagePair>,
    yarns: BTreeSet<RingAndYarn>,
    /// Translated curves of the pairs.
    curves: BTreeSet<(u32, Image)>,
    points: PointLimit,
}

impl<'a> PairCollector<'a> {
    fn new(searched: &'a Searched<'a>) -> PairCollector<'a> {
        PairCollector {
            searched,
            pairs: BTreeSet::new(),
            yarns: BTreeSet::new(),
            curves: BTreeSet::new(),
            points: PointLimit::new(searched.curves),
        }
    }

    /// Adds a pair.
    ///
    /// # Errors
    ///
    /// The errors of [`PointLimit::add`].
    fn add(&mut self, pair: ImagePair) -> Result<()> {
        if self.pairs.insert(pair) {
            for curve in [(pair.i, Image::default()), (pair.j, pair.image)] {
                if self.curves.insert(curve) {
                    self.points.add(&self.searched.curves[curve.0 as usize])?;
                }
            }
        }
        Ok(())
    }

    /// Adds all pairs of a curve and an image with overlapping boxes.
    fn search(&mut self, boxes: &FractionalBoxes, cell: &Cell) -> Result<()> {
        let searched = self.searched;
        let (mut links, limit) = (LinkSearch::default(), PairLimit::default());
        limit.begin(MOST_PAIRS.max(IMAGES as usize * boxes.0.len()));
        links.limit = limit.clone();
        let is_yarn = |i: usize| searched.periods[i].is_some();
        let is_used = |i: usize| searched.open_too || searched.curves[i].closed || is_yarn(i);
        let found = overlapping(&boxes.0, cell, is_used, &mut links).map_err(too_far)?;
        if limit.is_exceeded() {
            return Err(too_far(boxes.widest(cell)));
        }
        for (i, j, image) in found {
            let both = [i, j].map(|i| searched.periods[i as usize]);
            let pair = RingAndYarn::between(i, j, image, both);
            let pair = pair.filter(|pair| searched.is_closed(pair.ring));
            self.yarns.extend(pair);
            let numbers = [i, j].iter().all(|&i| searched.is_closed(i));
            if image != Image::default() && (numbers || searched.open_too) {
                self.add(ImagePair::new(i, j, image))?;
            }
            if self.pairs.len() + self.yarns.len() > searched.most {
                let limit = searched.most as u64;
                return Err(Error::TooManyPairs { limit });
            }
        }
        Ok(())
    }
}

/// Limit of the points of translated curves.
pub(super) struct PointLimit {
    left: usize,
    most: usize,
}

impl PointLimit {
    /// Returns the limit of a frame with these curves.
    pub fn new(curves: &[Curve]) -> PointLimit {
        let points: usize = curves.iter().map(|c| c.points as usize).sum();
        let most = MOST_POINTS.max(COPIES * points);
        PointLimit { left: most, most }
    }

    /// Counts the points of a translated curve.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if there are too many.
    pub fn add(&mut self, curve: &Curve) -> Result<()> {
        let left = self.left.checked_sub(curve.points as usize);
        self.left = left.ok_or_else(|| {
            Error::Usage(format!(
                "the curves span too many periodic cells: the images that may meet have more than \
                 {} points together, for which the memory may not be there; is the cell in the \
                 units of the coordinates?",
                self.most
            ))
        })?;
        Ok(())
    }
}

/// Returns all pairs of a box and an image of another box, or of itself, that overlap: the indices
/// of both boxes, and the translation of the second one. Boxes are in fractional coordinates. A
/// pair may occur twice, once in each order. If `links` has a limit and it is exceeded, pairs are
/// missing.
///
/// # Errors
///
/// The number of a box that spans too many cells, or is too far away from the first one.
pub(crate) fn overlapping<'a, F: Fn(usize) -> bool>(
    bounds: &[[Point; 2]],
    cell: &Cell,
    is_used: F,
    links: &'a mut LinkSearch,
) -> Result<impl Iterator<Item = (u32, u32, Image)> + use<'a, F>, usize> {
    let periodic = cell.periodic();
    // Translation that brings the centre of each box into the first cell.
    let mut home: Vec<Image> = Vec::with_capacity(bounds.len());
    let mut around = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for (i, bounds) in bounds.iter().enumerate() {
        let by = home_of(bounds, periodic).ok_or(i)?;
        home.push(by);
        if is_used(i) {
            let by = by.map(f64::from);
            around = union(around, bounds.map(|p| add(p, by)));
        }
    }
    let outer = single(&around, [0.0; 3]);
    let mut images: Vec<(u32, Image)> = Vec::new();
    let mut singles: Vec<Box3> = Vec::new();
    let (mut total, most) = (0_u64, MOST_IMAGES.max(IMAGES * bounds.len() as u64));
    for (i, bounds) in bounds.iter().enumerate().filter(|&(i, _)| is_used(i)) {
        let by = home[i].map(f64::from);
        // `lo + by + n <= around.hi` and `hi + by + n >= around.lo`.
        let range = |x: usize| -> RangeInclusive<i32> {
            match periodic[x] {
                true => {
                    let first = (around[0][x] - bounds[1][x] - by[x]).floor();
                    let last = (around[1][x] - bounds[0][x] - by[x]).ceil();
                    first as i32..=last as i32
                }
                false => 0..=0,
            }
        };
        let ranges = per_axis(range);
        let size = |r: &RangeInclusive<i32>| u64::from(r.end().abs_diff(*r.start())) + 1;
        let sizes = ranges.iter().map(size);
        total = sizes.fold(1_u64, u64::saturating_mul).saturating_add(total);
        if total > most {
            return Err(i);
        }
        for n in images_in(ranges) {
            let translated = single(bounds, per_axis(|x| by[x] + f64::from(n[x])));
            if translated.overlaps(&outer) {
                images.push((i as u32, n));
                singles.push(translated);
            }
        }
    }
    let pairs = links.find(&singles).iter();
    Ok(pairs.filter_map(move |&(a, b)| {
        let [(i, m), (j, n)] = [a, b].map(|k| images[k as usize]);
        // At least one of the two boxes has its centre in the first cell.
        if m != Image::default() && n != Image::default() {
            return None;
        }
        let image = per_axis(|x| {
            let [from, to] = [(i, m), (j, n)].map(|(i, n)| home[i as usize][x] + n[x]);
            to - from
        });
        Some((i, j, image))
    }))
}

/// Returns the translation that brings the centre of a box into the first cell. `None` if the box
/// spans too many cells, or is too far away.
pub(crate) fn home_of([lo, hi]: &[Point; 2], periodic: [bool; 3]) -> Option<Image> {
    let mut home = Image::default();
    for x in (0..3).filter(|&x| periodic[x]) {
        let cells = (0.5 * (lo[x] + hi[x])).floor();
        if cells.is_nan() || cells.abs() > FARTHEST || hi[x] - lo[x] > FARTHEST {
            return None;
        }
        home[x] = -cells as i32;
    }
    Some(home)
}

/// Returns all integer triples in these ranges.
pub(crate) fn images_in([a, b, c]: [RangeInclusive<i32>; 3]) -> impl Iterator<Item = Image> {
    a.flat_map(move |i| {
        let c = c.clone();
        b.clone()
            .flat_map(move |j| c.clone().map(move |k| [i, j, k]))
    })
}

pub(crate) fn too_far(curve: usize) -> Error {
    Error::Usage(format!(
        "curve {curve} spans too many periodic cells, or is too far away from the first one: is \
         the cell in the units of the coordinates?"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Returns the pairs with overlapping boxes, by a comparison of all images up to some distance.
    fn by_brute_force(boxes: &FractionalBoxes, cell: &Cell, reach: i32) -> BTreeSet<ImagePair> {
        let mut pairs = BTreeSet::new();
        let range = |x: usize| match cell.periodic()[x] {
            true => -reach..=reach,
            false => 0..=0,
        };
        let ranges = per_axis(range);
        let all = boxes.0.iter().enumerate();
        for (i, a) in all.clone() {
            for (j, b) in all.clone().skip(i) {
                for n in images_in(ranges.clone()) {
                    let apart = |x: usize| {
                        let by = f64::from(n[x]);
                        a[1][x] < b[0][x] + by || b[1][x] + by < a[0][x]
                    };
                    if n != Image::default() && !(0..3).any(apart) {
                        pairs.insert(ImagePair::new(i as u32, j as u32, n));
                    }
                }
            }
        }
        pairs
    }

    fn find_in(
        boxes: &FractionalBoxes,
        cell: &Cell,
        pairs: &mut BTreeSet<ImagePair>,
    ) -> Result<()> {
        let count = boxes.0.len();
        let xyz = vec![0.0; 9 * count];
        let positions = crate::curve::Positions::F64(&xyz);
        let counts = vec![-3; count];
        let basis = crate::curve::Basis::Polyline;
        let set = crate::curve::CurveSet::from_counts(basis, &counts, positions)?;
        let searched = Searched {
            curves: set.curves(),
            periods: &vec![None; count].into(),
            open_too: true,
            most: usize::MAX,
        };
        let mut found = PairCollector::new(&searched);
        found.search(boxes, cell)?;
        *pairs = found.pairs;
        Ok(())
    }

    /// All pairs are found: in cells with one to three periods, for curves smaller and larger than
    /// the cell, near and far from the origin.
    #[test]
    fn finds_all_images_with_overlapping_boxes() {
        let mut random = Random::new(11);
        let mut total = 0;
        for case in 0..300 {
            let cell: Cell = ["1,1,1", "1,0,1", "0,0,1", "2,1,0.5"][case % 4]
                .parse()
                .unwrap();
            let size = [0.1, 0.6, 2.5][case % 3];
            let bounds = (0..1 + random.below(6)).map(|_| {
                let lo = [0; 3].map(|_| 6.0 * random.unit() - 3.0);
                let hi = lo.map(|x| x + size * random.unit());
                [lo, hi]
            });
            let boxes = FractionalBoxes(bounds.collect());
            let mut found = BTreeSet::new();
            find_in(&boxes, &cell, &mut found).unwrap();
            // Single precision makes boxes larger, so a few more pairs may be found.
            let expected = by_brute_force(&boxes, &cell, 10);
            let generous = by_brute_force(&boxes.dilated([1e-6; 3]), &cell, 10);
            assert!(expected.is_subset(&found), "case {case}");
            assert!(found.is_subset(&generous), "case {case}");
            total += found.len();
        }
        assert!(total > 2000, "{total}");
    }

    #[test]
    fn rejects_curves_that_span_too_many_cells() {
        let cell: Cell = "1,1,1".parse().unwrap();
        for far in [30.0, 1e3, 1e30] {
            let boxes = FractionalBoxes(vec![[[0.0; 3], [far; 3]]]);
            let e = find_in(&boxes, &cell, &mut BTreeSet::new());
            let e = e.unwrap_err();
            assert!(
                e.to_string()
                    .contains("curve 0 spans too many periodic cells"),
                "{e}"
            );
        }
    }
}
