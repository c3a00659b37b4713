//! Clearance of moving strands, from frame to frame: the distance of their centre lines divided by
//! the sum of their radii.
//!
//! # Proof: strands that are not measured are no closer than the level
//!
//! The strands are divided into blocks of eight segments ([`blocks`]). All pairs of blocks within a
//! range are listed ([`near`]), with a lower bound of their clearance in a reference frame. A rigid
//! motion of the whole scene changes no distance, so it is subtracted from the motion of the blocks
//! ([`motion`]). Two blocks at a distance `d` that moved by `a` and `b` since the reference frame
//! are at least `d - a - b` apart. So a block may move by half of the excess of its nearest
//! neighbour over the level before its pairs are compared. The comparison bounds the relative
//! motion of both blocks of a pair, and pairs that may now be below the level are measured. Blocks
//! that are not listed are further apart than the reach, as long as no block moved by more than
//! half of the difference between range and reach. Beyond that, the pairs are listed again.
//!
//! In a periodic cell, pairs of a block and an image of a block are listed as well ([`lattice`]).
//! If the cell changes, the motion of the lattice vector between both blocks of a pair is added.
//!
//! # Level
//!
//! All strands below the level are measured in each frame, so the closest strands are known exactly
//! if they are below it. The level is never lower than the clearance of the warning. Otherwise, it
//! is the clearance of the reference frame minus a tolerance. The current frame becomes the
//! reference frame once the comparisons since the last change have cost as much as the change does.
//! The tolerance grows if that happens often, and shrinks if it happens rarely. If the motion is
//! too violent for these lists, each frame is searched only for its closest strands.

mod blocks;
mod lattice;
mod motion;
mod near;
mod strands;
#[cfg(test)]
mod tests;
mod trend;

use self::blocks::{BlockPair, Blocks};
use self::near::{Moved, NearList, Reach};
use self::strands::{Arcs, Measured, Strands};
use self::trend::Trend;
use crate::curve::{Cell, CurveSet, Image, Shape};
use crate::error::{Error, Result};
use crate::pairs::LinkSearch;
use crate::periodic::period;
use crate::simd::LANES;
use crate::verdict::{Clearance, CloseStrands};

/// Clearance up to which strands are close. Parts of a straight strand that are `pi` radii apart
/// along it have 1.57.
pub(crate) const REACH: f64 = 1.5;

/// Clearance below which a warning is given, unless the options have another one.
const LOW: f64 = 0.5;

/// Smallest and largest tolerance, and that of the first frame, as shares of a diameter.
const TOLERANCES: [f64; 3] = [0.05, 0.4, 0.25];

/// Maximum difference between the clearance of the closest measured strands and the level. If close
/// strands moved away and the difference is larger, a new level is chosen.
const MOST_SLACK: f64 = 0.5;

/// Smallest and largest skin, and that of the first frame, in radii. The skin is the distance that
/// blocks may move before the pairs are listed again.
const SKINS: [f64; 3] = [0.5, 4.0, 1.0];

/// Numbers of frames for which a list must last and should last. If the largest skin lasts for
/// fewer than the first number, the list is made for one frame only.
const LASTS: [f64; 2] = [2.0, 8.0];

/// Number of closest pairs of blocks that are measured in every frame.
const CLOSEST: usize = 4;

/// Number of comparisons of pairs that cost as much as one measurement.
const MEASUREMENT: usize = 16;

/// Motion that is negligible, as a share of a radius.
const SMALL: f64 = 0.05;

/// Maximum of [`ClearanceMonitor::patience`].
const PATIENCE: u32 = 5;

/// Largest coordinate and radius, and inverse of the smallest radius, for which single-precision
/// bounds cannot overflow.
const LARGEST: f64 = 1e30;

/// Strands whose clearance is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ClearanceOptions {
    /// Radius of all strands. `None`: each curve has its own
    /// ([`CurveLabels::radii`](crate::CurveLabels::radii)).
    pub radius: Option<f64>,
    /// Clearance below which [`Clearance::low`] is set, from 0 to 1.
    pub low: f64,
}

impl ClearanceOptions {
    /// Returns the options for strands of this radius, or of one of their own each, with a warning
    /// below half a diameter.
    pub fn new(radius: Option<f64>) -> ClearanceOptions {
        ClearanceOptions { radius, low: LOW }
    }

    /// Checks the options.
    pub(crate) fn check(&self) -> Result<()> {
        if let Some(radius) = self.radius.filter(|r| !is_radius(*r)) {
            let what = format!("a radius of {radius}, expected a length of 1e-30 to 1e30");
            return Err(Error::Usage(what));
        }
        if !(0.0..=1.0).contains(&self.low) {
            let what = format!("a clearance of {}, expected 0 to 1", self.low);
            return Err(Error::Usage(what));
        }
        Ok(())
    }
}

/// Returns true for a radius with which clearance can be measured.
fn is_radius(radius: f64) -> bool {
    (1.0 / LARGEST..=LARGEST).contains(&radius)
}

/// Clearance of a part of a curve, for display.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(feature = "rerun"), allow(dead_code, reason = "for the viewer"))]
pub(crate) struct CloseBlock {
    /// Curve, from 0.
    pub curve: u32,
    /// First of at most eight segments.
    pub first: u32,
    /// The segment that is closest to another strand, and that strand.
    pub closest: CloseStrands,
}

/// Measures all parts of curves that are closer to another strand, or to an image of one in the
/// cell, than `within` sums of their radii, at most [`REACH`]. `radii` has a radius for each curve.
/// This takes longer than to verify a frame; [`Report::clearance`](crate::Report::clearance) has
/// the closest strands of each frame.
///
/// # Errors
///
/// [`Error::Usage`] if a curve has no radius, or one that is not a positive length, the lattice
/// vectors are linearly dependent, or curves span too many cells; [`Error::Unsupported`] if
/// coordinates are too large, or too many strands are close.
#[cfg_attr(not(feature = "rerun"), allow(dead_code, reason = "for the viewer"))]
pub(crate) fn close_blocks(
    set: &CurveSet,
    cell: Option<&Cell>,
    radii: &[f64],
    within: f64,
) -> Result<Vec<CloseBlock>> {
    if let Some(cell) = cell {
        cell.check()?;
    }
    if radii.len() != set.len() {
        let what = format!("{} radii for {} curves", radii.len(), set.len());
        return Err(Error::Usage(what));
    }
    check_radii(radii)?;
    let layout = Layout::new(set, cell);
    let strands = layout.strands(set, cell, radii);
    let reach = Reach {
        ratio: within,
        skin: 0.0,
    };
    let list = NearList::build(&strands, reach, &mut LinkSearch::default())?;
    let pairs = list.blocks_of(&list.below(within));
    let mut closest: Vec<Option<CloseStrands>> = vec![None; layout.blocks.numbers.len()];
    for (pair, measured) in pairs.iter().zip(strands.measure(&pairs, within)) {
        let Some(found) = measured.closest.filter(|found| found.ratio < within) else {
            continue;
        };
        for number in pair.blocks {
            let block = &mut closest[number as usize];
            if block.is_none_or(|known| found.ratio < known.ratio) {
                *block = Some(found);
            }
        }
    }
    let close = (0..).zip(closest).filter_map(|(block, closest)| {
        let (curve, number) = layout.blocks.numbers.place(block);
        Some(CloseBlock {
            curve: curve as u32,
            first: (number * LANES) as u32,
            closest: closest?,
        })
    });
    Ok(close.collect())
}

/// Checks the radii of all curves.
fn check_radii(radii: &[f64]) -> Result<()> {
    let mut radii = radii.iter().enumerate();
    match radii.find(|(_, radius)| !is_radius(**radius)) {
        None => Ok(()),
        Some((i, radius)) => Err(Error::Usage(format!(
            "clearance needs a positive radius of each curve; that of curve {i} is {radius}"
        ))),
    }
}

/// Measures the clearance of successive frames.
#[derive(Debug)]
pub(crate) struct ClearanceMonitor {
    options: ClearanceOptions,
    /// Radii of the curves; empty until they are known.
    radii: Vec<f64>,
    layout: Option<Layout>,
    list: Option<NearList>,
    search: LinkSearch,
    tolerance: f64,
    /// Numbers of frames since the list and since the reference frame.
    ages: [u32; 2],
    /// Work since the reference frame, in comparisons of pairs.
    work: usize,
    /// Number of doublings of the work that is allowed before the current frame becomes the
    /// reference frame.
    patience: u32,
    /// Pairs that are measured in every frame.
    closest: Vec<BlockPair>,
    trend: Trend,
}

/// Shape, arc lengths, blocks and periods of the curves, computed from the first frame.
#[derive(Debug)]
struct Layout {
    shape: Shape,
    arcs: Arcs,
    blocks: Blocks,
    /// Period of each curve; zeros if it does not run through the cell.
    periods: Vec<Image>,
}

/// Result of the measurement of a frame.
#[derive(Default)]
struct Measurement {
    pairs: Vec<(BlockPair, Measured)>,
    closest: Option<CloseStrands>,
}

impl Measurement {
    fn add(&mut self, pairs: Vec<BlockPair>, measured: Vec<Measured>) {
        let close = measured.iter().filter_map(|m| m.closest);
        let close = close.chain(self.closest);
        let closest = close.min_by(|a, b| a.ratio.total_cmp(&b.ratio));
        self.closest = closest.filter(|c| c.ratio < REACH);
        self.pairs.extend(pairs.into_iter().zip(measured));
    }

    /// Returns the clearance of the closest strands; at most the reach.
    fn ratio(&self) -> f64 {
        self.closest.map_or(REACH, |c| c.ratio)
    }

    /// Returns the closest pairs.
    fn closest_pairs(mut self) -> Vec<BlockPair> {
        let order = |(a, p): &(BlockPair, Measured), (b, q): &(BlockPair, Measured)| {
            p.ratio().total_cmp(&q.ratio()).then(a.cmp(b))
        };
        self.pairs.retain(|(_, measured)| measured.ratio() < REACH);
        if self.pairs.len() > CLOSEST {
            self.pairs.select_nth_unstable_by(CLOSEST, order);
            self.pairs.truncate(CLOSEST);
        }
        self.pairs.into_iter().map(|(pair, _)| pair).collect()
    }
}

impl ClearanceMonitor {
    pub fn new(options: ClearanceOptions) -> ClearanceMonitor {
        ClearanceMonitor {
            options,
            radii: Vec::new(),
            layout: None,
            list: None,
            search: LinkSearch::default(),
            tolerance: TOLERANCES[2],
            ages: [0; 2],
            work: 0,
            patience: 0,
            closest: Vec::new(),
            trend: Trend::default(),
        }
    }

    /// Sets the radius of each curve, if they are not given by the options.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a radius is no length.
    pub fn set_radii(&mut self, radii: &[f32]) -> Result<()> {
        if self.options.radius.is_some() {
            return Ok(());
        }
        let radii: Vec<f64> = radii.iter().map(|&r| r.into()).collect();
        check_radii(&radii)?;
        if self.radii != radii {
            self.forget();
            self.radii = radii;
        }
        Ok(())
    }

    /// Returns the clearance of the last frames, by their number.
    pub fn trend(&self) -> Vec<(u64, f64)> {
        self.trend.frames.iter().copied().collect()
    }

    /// Continues after frames with this clearance.
    pub fn set_trend(&mut self, frames: Vec<(u64, f64)>) {
        self.trend.frames = frames.into();
    }

    /// Forgets the previous frames, because the next one does not continue them.
    pub fn forget(&mut self) {
        *self = ClearanceMonitor {
            radii: std::mem::take(&mut self.radii),
            ..ClearanceMonitor::new(self.options)
        };
    }

    /// Measures a frame in its periodic cell, if there is one.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the radii of the curves are unknown, or curves span too many
    /// cells; [`Error::Unsupported`] if coordinates are too large, or too many strands are close.
    pub fn measure(&mut self, set: &CurveSet, cell: Option<&Cell>, seq: u64) -> Result<Clearance> {
        let layout = self.prepare(set, cell)?;
        let radii = std::mem::take(&mut self.radii);
        let strands = layout.strands(set, cell, &radii);
        // One call into the thread pool, so that the parallel stages do not each wake a thread.
        let measured = rayon::scope(|_| self.measure_strands(&strands));
        self.layout = Some(layout);
        self.radii = radii;
        let (at_least, closest) = measured?;
        let ratio = closest.map(|c| c.ratio);
        Ok(Clearance {
            at_least,
            closest,
            low: ratio.is_some_and(|ratio| ratio < self.options.low),
            frames_left: self.trend.frames_left(seq, ratio),
        })
    }

    /// Checks the radii, and returns what depends only on the curves, not on their positions.
    fn prepare(&mut self, set: &CurveSet, cell: Option<&Cell>) -> Result<Layout> {
        // Displacements of larger coordinates may overflow.
        if set.max_abs() > LARGEST {
            let what = format!("of coordinates above {LARGEST:e}");
            return Err(Error::unsupported("clearance", what));
        }
        let shape = set.shape();
        if self.layout.as_ref().is_some_and(|l| l.shape != shape) {
            self.forget();
        }
        if let Some(radius) = self.options.radius {
            self.radii.resize(set.len(), radius);
        }
        if self.radii.len() != set.len() {
            let what = "clearance needs the radii of the curves: the frames have none";
            return Err(Error::Usage(what.into()));
        }
        Ok(self.layout.take().unwrap_or_else(|| Layout::new(set, cell)))
    }

    /// Measures a frame. Returns a lower bound of the clearance of all strands, and the closest
    /// ones.
    fn measure_strands(&mut self, strands: &Strands<'_>) -> Result<(f64, Option<CloseStrands>)> {
        let mut found = Measurement::default();
        let closest = std::mem::take(&mut self.closest);
        let measured = strands.measure(&closest, REACH);
        found.add(closest, measured);
        let smallest = strands.radii.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let small = SMALL * smallest;
        let old = self.list.take().map(|list| {
            let moved = list.moved(strands, small);
            (list, moved)
        });
        self.ages = self.ages.map(|age| age + 1);
        let (list, at_least) = match old {
            Some((mut list, mut moved)) if list.is_complete(&moved) => {
                let limit = list.level.min(found.ratio());
                let (due, compared) = list.due(&mut moved, strands, limit);
                self.work += compared + MEASUREMENT * due.len();
                let measured = strands.measure(&due, limit);
                found.add(due, measured);
                // Each of the two blocks of a pair moved by at most `farthest`.
                let least = list.least - moved.farthest / smallest;
                let mut at_least = least.max(list.level.min(found.ratio()));
                let costly = self.work > (list.len() + CLOSEST * MEASUREMENT) << self.patience;
                if costly {
                    self.adapt();
                }
                if costly || found.ratio() - list.level > MOST_SLACK {
                    list.rebase(moved, strands, small);
                    self.settle(&mut list, strands, &mut found);
                    (self.ages[1], self.work) = (0, 0);
                    at_least = list.least;
                }
                (list, at_least)
            }
            old => {
                let mut list = self.build(strands, old, found.ratio())?;
                self.settle(&mut list, strands, &mut found);
                let at_least = list.least;
                (list, at_least)
            }
        };
        self.list = Some(list);
        let bounds = found.pairs.iter().map(|(_, measured)| measured.bound);
        let at_least = bounds.fold(at_least, f64::min).max(0.0);
        let closest = found.closest;
        self.closest = found.closest_pairs();
        Ok((at_least, closest))
    }

    /// Returns the tolerance and the level for strands of clearance `ratio`. The tolerance is 0 if
    /// the list is made for one frame only.
    fn level(&self, skin: f64, ratio: f64) -> [f64; 2] {
        let tolerance = if skin > 0.0 { self.tolerance } else { 0.0 };
        [tolerance, (ratio - tolerance).max(self.options.low)]
    }

    /// Lists the near pairs of a frame. Keeps the bounds of pairs from the old list.
    fn build(
        &mut self,
        strands: &Strands<'_>,
        old: Option<(NearList, Moved)>,
        ratio: f64,
    ) -> Result<NearList> {
        let largest = strands.radii.iter().fold(0.0, |a: f64, &b| a.max(b));
        let [least, most, first] = SKINS.map(|skin| skin * largest);
        let skin = match &old {
            None => first,
            Some((list, moved)) => {
                let speed = list.traveled(moved) / f64::from(self.ages[0]);
                let [short, long] = LASTS.map(|frames| frames * speed);
                match short > most {
                    true => 0.0,
                    false => long.clamp(least, most),
                }
            }
        };
        let reach = Reach {
            ratio: match self.level(skin, ratio) {
                [_, level] if skin == 0.0 => level,
                [tolerance, level] => (level + tolerance).clamp(REACH - MOST_SLACK, REACH),
            },
            skin,
        };
        let mut list = NearList::build(strands, reach, &mut self.search)?;
        if let Some((mut old, moved)) = old.filter(|_| skin > 0.0) {
            old.rebase(moved, strands, 0.0);
            list.inherit(&old);
        }
        self.ages = [0; 2];
        self.work = 0;
        Ok(list)
    }

    /// Measures the pairs that may be close to the level in the reference frame, which must be the
    /// current frame, and chooses the level.
    fn settle(&mut self, list: &mut NearList, strands: &Strands<'_>, found: &mut Measurement) {
        let [tolerance, level] = self.level(list.reach.skin, found.ratio());
        let due = list.below((level + tolerance).min(list.reach.ratio));
        let pairs = list.blocks_of(&due);
        let limit = (level + 2.0 * tolerance).min(REACH);
        // If the list is made for one frame only, precise bounds are needed only for the closest
        // pairs.
        let measured = match list.reach.skin == 0.0 {
            true => strands.measure_closest(&pairs, limit),
            false => strands.measure(&pairs, limit),
        };
        list.improve(due.into_iter().zip(&measured));
        found.add(pairs, measured);
        let [_, level] = self.level(list.reach.skin, found.ratio());
        list.set_level(level.min(list.reach.ratio), &strands.layout.blocks);
    }

    /// Adapts the tolerance and the patience to the number of frames that the reference frame
    /// lasted.
    fn adapt(&mut self) {
        let [least, most, _] = TOLERANCES;
        match self.ages[1] {
            ..16 => {
                self.tolerance = (2.0 * self.tolerance).min(most);
                self.patience = (self.patience + 1).min(PATIENCE);
            }
            256.. => {
                self.tolerance = (0.5 * self.tolerance).max(least);
                self.patience = 0;
            }
            _ => self.patience = self.patience.saturating_sub(1),
        }
    }
}

impl Layout {
    fn new(set: &CurveSet, cell: Option<&Cell>) -> Layout {
        let period = |i: usize| {
            cell.and_then(|cell| period(set, i, cell))
                .unwrap_or_default()
        };
        Layout {
            shape: set.shape(),
            arcs: Arcs::new(set),
            blocks: Blocks::new(set),
            periods: (0..set.len()).map(period).collect(),
        }
    }

    fn strands<'a>(
        &'a self,
        set: &'a CurveSet,
        cell: Option<&'a Cell>,
        radii: &'a [f64],
    ) -> Strands<'a> {
        Strands {
            set,
            positions: set.positions(),
            radii,
            layout: self,
            cell,
        }
    }
}
