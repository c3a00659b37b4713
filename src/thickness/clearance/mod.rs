//! Clearance of moving strands: the distance of their center lines, as a share of the sum of their
//! radii, from frame to frame.
//!
//! # Proof: strands that are left alone are no closer than the level
//!
//! The strands are blocks of eight segments. All pairs of blocks within a range are listed
//! ([`near`]). A rigid motion of the whole scene changes no distance, so only the motion relative
//! to one counts ([`motion`]). The travel of a block is the sum, over all frames, of the largest
//! distance that one of its points moved relative to that motion. Two blocks at a distance `d`
//! whose travels have grown by `a` and `b` since then are at least `d - a - b` apart. As long as
//! this is above the level, the pair is not measured. Blocks that are not listed are further apart
//! than the range, until a block has traveled half of what the range has beyond the reach.
//!
//! # Level
//!
//! All strands below the level are measured in each frame, so that a clearance below it is that of
//! the closest strands. The level is never below that of the warning. Above it, it is the last
//! clearance less a tolerance, which grows if many pairs have to be measured, and shrinks if few
//! have: the work depends on the motion, not on the number of strands in contact.

mod motion;
mod near;
mod strands;
#[cfg(test)]
mod tests;
mod trend;

use self::near::{NearList, Reach};
use self::strands::{Arcs, Measured, Strands};
use self::trend::Trend;
use crate::curve::{CurveSet, Positions, Received, Shape};
use crate::error::{Error, Result};
use crate::simd::dispatch;
use crate::verdict::Clearance;
use rayon::prelude::*;

/// Clearance up to which strands are close. Parts of a straight strand that are `pi` radii apart
/// along it have 1.57.
pub(crate) const REACH: f64 = 1.5;

/// Clearance below which a warning is due, unless another one is given.
const LOW: f64 = 0.5;

/// Smallest and largest tolerance: shares of a diameter.
const TOLERANCES: (f64, f64) = (0.01, 0.5);

/// Number of segments per pair of blocks that may be measured in a frame without a larger
/// tolerance.
const SEGMENTS_PER_PAIR: usize = 64;

/// Number of closest pairs of blocks that are measured in every frame.
const CLOSEST: usize = 16;

/// Number of pairs of blocks from which on several threads measure them.
const MANY: usize = 1024;

/// Number of segments from which on a frame is measured by several threads.
const LARGE: usize = 1 << 15;

/// Largest magnitude of coordinates, and largest and smallest radius, for which single-precision
/// bounds are safe.
const LARGEST: f64 = 1e30;

/// Strands whose clearance is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ClearanceOptions {
    /// Radius of all strands. `None`: each curve has its own ([`Verifier::set_radii`]).
    ///
    /// [`Verifier::set_radii`]: crate::Verifier::set_radii
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
        match (0.0..=1.0).contains(&self.low) {
            true => Ok(()),
            false => Err(Error::Usage(format!(
                "a clearance of {}, expected 0 to 1",
                self.low
            ))),
        }
    }
}

/// Returns true for a radius with which clearance can be measured.
fn is_radius(radius: f64) -> bool {
    (1.0 / LARGEST..=LARGEST).contains(&radius)
}

/// Clearance of a part of a curve, for display.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CloseBlock {
    /// Curve, from 0.
    pub curve: u32,
    /// First of at most eight segments.
    pub first: u32,
    /// Clearance from its closest strand when it was last measured.
    pub ratio: f64,
}

/// Measures the clearance of successive frames.
#[derive(Debug)]
pub(crate) struct ClearanceMonitor {
    options: ClearanceOptions,
    /// Radii of the curves; empty until they are known.
    radii: Vec<f64>,
    /// Positions along the curves in the first frame, and the curves.
    arcs: Option<(Shape, Arcs)>,
    list: Option<NearList>,
    /// Number of the contents of the last frame.
    seen: Option<u64>,
    /// Positions of the last frame, if nobody else keeps them.
    own: Option<Received>,
    level: f64,
    tolerance: f64,
    /// Travel after which the list is built again.
    skin: f64,
    /// Pairs that are measured in every frame.
    closest: Vec<u32>,
    trend: Trend,
}

impl ClearanceMonitor {
    pub fn new(options: ClearanceOptions) -> ClearanceMonitor {
        ClearanceMonitor {
            options,
            radii: Vec::new(),
            arcs: None,
            list: None,
            seen: None,
            own: None,
            level: REACH,
            tolerance: TOLERANCES.0,
            skin: 0.0,
            closest: Vec::new(),
            trend: Trend::default(),
        }
    }

    /// Sets the radius of each curve, if they are not given by the options.
    ///
    /// Errors: [`Error::Usage`] if a radius is no length.
    pub fn set_radii(&mut self, radii: &[f32]) -> Result<()> {
        if self.options.radius.is_some() {
            return Ok(());
        }
        if let Some(i) = radii.iter().position(|&r| !is_radius(r.into())) {
            let what = format!(
                "clearance needs a positive radius of each curve; that of curve {i} is {}",
                radii[i]
            );
            return Err(Error::Usage(what));
        }
        let same = |(a, b): (&f64, &f32)| *a == f64::from(*b);
        if self.radii.len() != radii.len() || !self.radii.iter().zip(radii).all(same) {
            self.forget();
            self.radii = radii.iter().map(|&r| r.into()).collect();
        }
        Ok(())
    }

    /// Forgets the previous frames, because the next one does not continue them.
    pub fn forget(&mut self) {
        let options = self.options;
        let radii = match options.radius {
            Some(_) => Vec::new(),
            None => std::mem::take(&mut self.radii),
        };
        *self = ClearanceMonitor {
            radii,
            ..ClearanceMonitor::new(options)
        };
    }

    /// Measures a frame. `before` is the previous one, if it is kept, and `keeps` is true if this
    /// frame will be.
    ///
    /// Errors: [`Error::Usage`] if the radii of the curves are unknown; [`Error::Unsupported`] if
    /// coordinates are too large, or too many strands are close.
    pub fn measure(
        &mut self,
        before: Option<&CurveSet>,
        set: &CurveSet,
        seq: u64,
        keeps: bool,
    ) -> Result<Clearance> {
        match set.segments() {
            ..LARGE => self.measure_here(before, set, seq, keeps),
            // Once, so that the parallel parts need not each wake a thread.
            _ => rayon::scope(|_| self.measure_here(before, set, seq, keeps)),
        }
    }

    fn measure_here(
        &mut self,
        before: Option<&CurveSet>,
        set: &CurveSet,
        seq: u64,
        keeps: bool,
    ) -> Result<Clearance> {
        let other = |(shape, _): &(Shape, Arcs)| *shape != set.shape();
        if self.arcs.as_ref().is_some_and(other) {
            self.forget();
        }
        if let Some(radius) = self.options.radius {
            self.radii.resize(set.len(), radius);
        }
        if self.radii.len() != set.len() {
            let what = "clearance needs the radii of the curves: the frames have none";
            return Err(Error::Usage(what.into()));
        }
        let positions = set.positions();
        let positions = positions.as_positions();
        let last = before.filter(|before| Some(before.contents()) == self.seen);
        let list = self.list.take();
        let moved = match (last, &self.own) {
            (Some(last), _) => {
                let last = last.positions();
                list.map(|list| list.moved([last.as_positions(), positions]))
            }
            (None, Some(own)) => list.map(|list| list.moved([own.positions(), positions])),
            (None, None) => None,
        };
        self.seen = Some(set.contents());
        match keeps {
            true => self.own = None,
            false => self.keep(positions),
        }
        let (_, arcs) = match self.arcs.take() {
            Some(known) => self.arcs.insert(known),
            None => self.arcs.insert((set.shape(), Arcs::new(set))),
        };
        let mut list = match moved {
            Some(list) if list.covers(self.level) => list,
            old => {
                self.skin = next_skin(self.skin, &self.radii, old.as_ref());
                self.closest.clear();
                let reach = Reach {
                    ratio: (self.level + 2.0 * self.tolerance).min(REACH),
                    skin: self.skin,
                };
                build(set, (&self.radii, arcs), (reach, self.level), old.as_ref())?
            }
        };
        let strands = Strands::new(set, positions, &self.radii, arcs);
        let (measured, count) = measure_due(&mut list, &strands, (self.level, &mut self.closest));
        let budget = strands.segments() / SEGMENTS_PER_PAIR + CLOSEST;
        let (least, most) = TOLERANCES;
        if count > budget {
            self.tolerance = (1.5 * self.tolerance).min(most);
        } else if count < budget / 4 {
            self.tolerance = (0.9 * self.tolerance).max(least);
        }
        let bounds = measured.iter().map(|m| m.bound);
        let closest = measured.iter().filter_map(|m| m.closest);
        let closest = closest.min_by(|a, b| a.ratio.total_cmp(&b.ratio));
        let closest = closest.filter(|c| c.ratio < REACH);
        let ratio = closest.map(|c| c.ratio);
        let clearance = Clearance {
            at_least: bounds.fold(self.level, f64::min).max(0.0),
            closest,
            low: ratio.is_some_and(|ratio| ratio < self.options.low),
            frames_left: self.trend.frames_left(seq, ratio),
        };
        self.adapt(&mut list, ratio.unwrap_or(REACH));
        self.list = Some(list);
        Ok(clearance)
    }

    /// Returns the clearance of all blocks that are close, when they were last measured.
    pub fn close_blocks(&self) -> Vec<CloseBlock> {
        let list = self.list.as_ref();
        list.map_or_else(Vec::new, |list| list.close_blocks(REACH))
    }

    fn keep(&mut self, positions: Positions<'_>) {
        match &mut self.own {
            Some(own) if own.positions().precision() == positions.precision() => {
                own.copy_from(positions);
            }
            own => {
                *own = Some(match positions {
                    Positions::F32(v) => Received::F32(v.to_vec()),
                    Positions::F64(v) => Received::F64(v.to_vec()),
                });
            }
        }
    }

    /// Chooses the level of the next frame.
    fn adapt(&mut self, list: &mut NearList, ratio: f64) {
        let level = (ratio - self.tolerance).max(self.options.low);
        // To raise it, all pairs are visited, and sometimes a list with more pairs is built.
        let raise = level - self.level > 0.5 * self.tolerance && list.age() % 8 == 7;
        if level < self.level || raise {
            self.level = level;
        }
        if raise {
            list.set_level(level);
        }
    }
}

/// Returns the travel after which the next list is built again. A list that lasts long costs more
/// to build and to keep.
fn next_skin(skin: f64, radii: &[f64], old: Option<&NearList>) -> f64 {
    let largest = radii.iter().fold(0.0, |a: f64, &b| a.max(b));
    match old.map(NearList::age) {
        None => 2.0 * largest,
        Some(..8) => (2.0 * skin).min(8.0 * largest),
        Some(256..) => (0.5 * skin).max(largest),
        Some(_) => skin,
    }
}

/// Lists the near pairs of a frame. Keeps what an old list knows about its pairs.
fn build(
    set: &CurveSet,
    strands: (&[f64], &Arcs),
    (reach, level): (Reach, f64),
    old: Option<&NearList>,
) -> Result<NearList> {
    let refuse = |what: String| Error::Unsupported {
        format: "clearance",
        what,
    };
    if set.max_abs() > LARGEST {
        return Err(refuse(format!("of coordinates above {LARGEST:e}")));
    }
    NearList::build(set, strands, reach, level, old).ok_or_else(|| {
        refuse(format!(
            "of more than {} pairs of close strands; is the radius too large?",
            near::MOST_NEAR
        ))
    })
}

/// Measures the pairs that may be below the level, and those that were closest, which are replaced
/// by those that are closest now. Returns what was measured, and the number of pairs that may have
/// been below the level.
fn measure_due(
    list: &mut NearList,
    strands: &Strands<'_>,
    (level, closest): (f64, &mut Vec<u32>),
) -> (Vec<Measured>, usize) {
    let mut due = list.due(strands.positions(), level);
    let count = due.len();
    due.append(closest);
    due.sort_unstable();
    due.dedup();
    let measure = |&k: &u32| dispatch!(Strands::measure(strands, list.pair(k), level));
    let measured: Vec<Measured> = match due.len() {
        ..MANY => due.iter().map(measure).collect(),
        _ => due.par_iter().with_min_len(MANY / 4).map(measure).collect(),
    };
    for (&k, measured) in due.iter().zip(&measured) {
        list.update(k, measured, strands.positions(), level);
    }
    let close = (0..due.len()).filter(|&k| measured[k].ratio() < REACH);
    let mut close: Vec<usize> = close.collect();
    let order = |&a: &usize, &b: &usize| {
        let [p, q] = [a, b].map(|k| measured[k].ratio());
        p.total_cmp(&q).then(a.cmp(&b))
    };
    if close.len() > CLOSEST {
        close.select_nth_unstable_by(CLOSEST, order);
        close.truncate(CLOSEST);
    }
    closest.extend(close.into_iter().map(|k| due[k]));
    (measured, count)
}
