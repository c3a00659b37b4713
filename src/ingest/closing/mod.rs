//! Curves that end where they start, and curves that are closed by a long segment.
//!
//! Coil files, simulators that break rings up and many exporters write a ring as an open curve that
//! repeats its first point. Other formats close every curve unless an option says otherwise, even
//! the linear chains of a melt. [`Closing`] decides in the same way for frames from all sources.
//!
//! Cost: one pass over the numbers of points a frame. The points of open curves, and the segments
//! of all curves, are read in the first frame only. A frame with curves that end where they start
//! is copied.

mod ends;
mod notes;

pub use self::notes::{ClosingKind, ClosingNote};

use self::ends::{Ends, Layout};
use super::RawFrame;
use crate::curve::{Basis, Cell, CurveSet, Metric, Positions};
use crate::error::Result;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Decides which curves of successive frames are closed.
///
/// - **A curve that ends where it starts is closed**, without the repeated point. The rule applies
///   to open curves with at least three other points that differ. The distance of the ends is at
///   most a thousandth of the median distance of consecutive points, or four units in the last
///   place of the coordinates of the ends, but not more than a tenth of that median.
///
///   Rounding stays below that: single precision and text of six digits move a point by 1e-6 of its
///   coordinates, which is a thousandth of a segment of a ring of several thousand points. Ends
///   that a simulation keeps apart are further apart.
///   A polyline that the source closes loses a last point that repeats the first one, too, if the
///   distance is at most a millionth of that median, or four units in the last place.
/// - **Splines** are closed only if the shape stays the same. A Bezier curve ends at its last
///   control point, so it may repeat the first one, as a polyline may. Catmull-Rom curves and
///   B-splines must repeat three: their last three control points are the first three. Others stay
///   open, even if they end where they start, since a closed spline has no corner
///   ([`ClosingKind::Corner`]).
/// - **A curve that only the format closes stays open** if the closing segment is more than twice
///   as long as the longest other one ([`CurveSource::closed_by_default`]). If the source itself
///   says that a curve is closed, it is closed by such a segment all the same
///   ([`ClosingKind::Long`]).
///
/// The first frame decides. Later frames are treated in the same way, until
/// [`Closing::forget`]: a closed curve whose ends have come apart is an error, and an open curve
/// stays open if its ends meet.
///
/// Curves through a periodic cell end at an image of their start: they do not end where they start.
///
/// ```
/// use linkwatch::{Basis, Closing, CurveSource, Positions, RawFrame};
///
/// let square = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., 0., 0., 5e-15];
/// let frame = RawFrame {
///     basis: Basis::Polyline,
///     counts: &[5],
///     positions: Positions::F64(&square),
/// };
/// let mut closing = Closing::default();
/// let set = closing.curves(frame, CurveSource::default())?;
/// assert_eq!(set.counts().collect::<Vec<_>>(), [-4]);
/// assert!(closing.take_notes()[0].to_string().starts_with("1 curve ends where it starts"));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct Closing {
    keep_open: bool,
    /// True for each curve that stays open, also if it ends where it starts; may be shorter.
    stay_open: Vec<bool>,
    /// Decisions of the first frame; empty before it.
    known: Vec<Known>,
    /// True if a frame with these decisions was verified.
    accepted: bool,
    notes: Vec<ClosingNote>,
    /// Counts of the last frame, the points that are kept, and their coordinates if it was changed.
    counts: Vec<i32>,
    kept: Vec<Range<usize>>,
    singles: Vec<f32>,
    doubles: Vec<f64>,
}

/// Properties of the source of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct CurveSource {
    /// Periodic cell of the frame.
    pub cell: Option<Cell>,
    /// True if coordinates are wrapped into the cell: distances are those of nearest images.
    pub wrapped: bool,
    /// True if curves are closed because the format says nothing else.
    pub closed_by_default: bool,
}

/// Decision of the first frame about a curve.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) enum Known {
    Open,
    /// Closed by the source.
    Closed,
    /// Closed, since its ends were within this distance.
    Joined(f64),
    /// Closed by the source, with a last point that was within this distance of the first one.
    Repeated(f64),
}

/// Decisions about the curves of a layout.
pub(crate) type Decisions = Vec<Known>;

impl Closing {
    /// Continues with decisions of a verified frame.
    pub(crate) fn decided(keep_open: bool, decisions: Decisions) -> Closing {
        Closing {
            known: decisions,
            ..Closing::new(keep_open)
        }
    }

    /// Returns the decisions about the curves.
    pub(crate) fn decisions(&self) -> Decisions {
        self.known.clone()
    }

    /// Creates a rule that keeps open curves open if `keep_open` is true.
    pub fn new(keep_open: bool) -> Closing {
        Closing {
            keep_open,
            ..Closing::default()
        }
    }

    /// Keeps the curves with the value true open.
    pub(crate) fn with_open(self, stay_open: Vec<bool>) -> Closing {
        Closing { stay_open, ..self }
    }

    /// Returns for each curve if it ends where it starts, by the rule for open polylines, whether
    /// the counts are negative or not.
    ///
    /// # Panics
    /// If there are fewer points than the counts say.
    pub fn ends_meet(counts: &[i32], positions: Positions<'_>) -> Vec<bool> {
        let (space, mut first) = (Metric::new(None), 0);
        let meet = |&count: &i32| {
            let layout = Layout::new(Basis::Polyline, positions, first, count);
            first += layout.points;
            matches!(layout.ends(&space), Ends::Meet { .. })
        };
        counts.iter().map(meet).collect()
    }

    /// Returns the number of curves that are closed because they end where they start.
    pub fn joined(&self) -> usize {
        let joined = |known: &&Known| matches!(known, Known::Joined(_) | Known::Repeated(_));
        self.known.iter().filter(joined).count()
    }

    /// Returns the decisions of the first frame to tell the user, once.
    pub fn take_notes(&mut self) -> Vec<ClosingNote> {
        std::mem::take(&mut self.notes)
    }

    /// Decides again in the next frame, which has other curves.
    pub fn forget(&mut self) {
        self.known.clear();
        self.accepted = false;
    }

    /// Tells the result of a frame. A first frame that is rejected decides nothing.
    pub fn end_frame(&mut self, verified: bool) {
        self.accepted |= verified;
        if !self.accepted {
            self.forget();
        }
    }

    /// Returns a frame with the curves to verify: the given frame if no curve changes. A frame
    /// whose curves differ from those of the first frame is returned unchanged.
    ///
    /// # Errors
    ///
    /// [`EndsApart`](crate::Error::EndsApart) if a curve that is closed ends elsewhere than
    /// it starts.
    pub fn close<'a>(
        &'a mut self,
        frame: RawFrame<'a>,
        source: CurveSource,
    ) -> Result<RawFrame<'a>> {
        // Copied once: counts in shared memory could change between two reads.
        self.counts.clear();
        self.counts.extend_from_slice(frame.counts);
        let points: u64 = (self.counts.iter().map(|c| u64::from(c.unsigned_abs()))).sum();
        if frame.positions.len() as u64 != 3 * points {
            return Ok(frame);
        }
        if self.known.is_empty() {
            self.decide(&frame, &source);
        }
        if self.known.len() != self.counts.len() {
            return Ok(frame);
        }
        let metric = Metric::new(source.cell.filter(|_| source.wrapped).as_ref());
        let (mut first, mut changed) = (0, false);
        self.kept.clear();
        for (i, (known, count)) in self.known.iter().zip(&mut self.counts).enumerate() {
            let layout = Layout::new(frame.basis, frame.positions, first, *count);
            first += layout.points;
            let mut points = layout.first..first;
            let joins_within = match (known, *count < 0) {
                (Known::Open, true) if source.closed_by_default => {
                    *count = count.abs();
                    changed = true;
                    None
                }
                (Known::Closed, false) if !self.keep_open => Some(0.0),
                (Known::Joined(within), false) if !self.keep_open => Some(*within),
                (Known::Repeated(within), _) => Some(*within),
                _ => None,
            };
            // A curve of fewer points is rejected later.
            if let Some(within) = joins_within.filter(|_| layout.points > layout.repeated()) {
                layout.check_ends(i, &metric, within)?;
                points = layout.without_repeated();
                *count = -(points.len() as i32);
                changed = true;
            }
            match self.kept.last_mut() {
                Some(last) if last.end == points.start => last.end = points.end,
                _ => self.kept.push(points),
            }
        }
        if !changed {
            return Ok(frame);
        }
        let positions = match frame.positions {
            Positions::F32(v) => Positions::F32(copied(v, &self.kept, &mut self.singles)),
            Positions::F64(v) => Positions::F64(copied(v, &self.kept, &mut self.doubles)),
        };
        Ok(RawFrame {
            basis: frame.basis,
            counts: &self.counts,
            positions,
        })
    }

    /// Returns the curves of a frame, closed as [`Closing::close`] does.
    ///
    /// # Errors
    ///
    /// The errors of [`Closing::close`] and of [`CurveSet::from_counts`].
    pub fn curves(&mut self, frame: RawFrame<'_>, source: CurveSource) -> Result<CurveSet> {
        let closed = self.close(frame, source)?;
        CurveSet::from_counts(closed.basis, closed.counts, closed.positions)
    }

    /// Same as [`Closing::curves`], for curves that were already read. `None` if they stay
    /// unchanged.
    ///
    /// # Errors
    ///
    /// The errors of [`Closing::curves`].
    pub fn of_set(&mut self, set: &CurveSet, source: CurveSource) -> Result<Option<CurveSet>> {
        // Without an allocation, as most frames are like the one before.
        let same = |(known, c): (&Known, i32)| match known {
            Known::Open => c > 0 || !source.closed_by_default,
            Known::Closed | Known::Joined(_) => c < 0 || self.keep_open,
            Known::Repeated(_) => false,
        };
        if self.known.len() == set.len() && self.known.iter().zip(set.counts()).all(same) {
            return Ok(None);
        }
        let counts: Vec<i32> = set.counts().collect();
        let frame = RawFrame {
            basis: set.basis(),
            counts: &counts,
            positions: set.positions(),
        };
        let closed = self.close(frame, source)?;
        if closed.counts == counts {
            return Ok(None);
        }
        CurveSet::from_counts(closed.basis, closed.counts, closed.positions).map(Some)
    }

    /// Decides about all curves of the first frame.
    fn decide(&mut self, frame: &RawFrame<'_>, source: &CurveSource) {
        let plain = Metric::new(None);
        let nearest = Metric::new(source.cell.as_ref());
        let mut notes = Vec::new();
        let mut note = |kind, i, factor| ClosingNote::add(&mut notes, kind, i, factor);
        let mut first = 0;
        for (i, &count) in self.counts.iter().enumerate() {
            let layout = Layout::new(frame.basis, frame.positions, first, count);
            first += layout.points;
            let metric = if source.wrapped { &nearest } else { &plain };
            let stays_open = self.stay_open.get(i).is_some_and(|&open| open);
            if stays_open && (count > 0 || source.closed_by_default) {
                self.known.push(Known::Open);
                continue;
            }
            self.known.push(if count < 0 {
                let factor = layout.closing_factor(&nearest);
                let is_long = |factor: f64| factor > ClosingNote::FACTOR;
                // Curves through the cell close up to a lattice vector.
                let own = match source.wrapped || source.cell.is_none() {
                    true => factor,
                    false => layout.closing_factor(&plain),
                };
                let apart = factor.max(own);
                if is_long(factor) && source.closed_by_default {
                    note(ClosingKind::Opened, i, factor);
                    Known::Open
                } else {
                    if is_long(apart) {
                        note(ClosingKind::Long, i, apart);
                    }
                    match layout.repeats(metric, own).filter(|_| !self.keep_open) {
                        Some(within) => {
                            note(ClosingKind::Joined, i, 0.0);
                            Known::Repeated(within)
                        }
                        None => Known::Closed,
                    }
                }
            } else if self.keep_open {
                Known::Open
            } else {
                match layout.ends(metric) {
                    Ends::Meet { within } => {
                        note(ClosingKind::Joined, i, 0.0);
                        Known::Joined(within)
                    }
                    Ends::Corner => {
                        note(ClosingKind::Corner, i, 0.0);
                        Known::Open
                    }
                    Ends::Apart => Known::Open,
                }
            });
        }
        notes.sort_by_key(|note| note.kind);
        self.notes = notes;
    }
}

/// Copies the coordinates of some points.
fn copied<'a, T: Copy>(from: &[T], kept: &[Range<usize>], to: &'a mut Vec<T>) -> &'a [T] {
    to.clear();
    for points in kept {
        to.extend_from_slice(&from[3 * points.start..3 * points.end]);
    }
    to
}

#[cfg(test)]
mod tests;
