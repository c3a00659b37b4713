//! Scenes with braids: the curves of a frame and, after them, the virtual loops of their braids.
//!
//! Closed curves and loops have linking numbers. Pull-throughs are searched for among the curves of
//! the frame, not the loops. A finding about a loop has the index of its first curve.

use crate::certificate::{Certificate, Comparison};
use crate::curve::{CurveSet, FramePool};
use crate::discretize::{BraidLoops, Braids};
use crate::error::Result;
use crate::pairs::{LoopPairs, PairFilter};
use crate::verdict::{Change, Defect, Link, LoopPair, Place, Report};
use std::sync::{Arc, Mutex, PoisonError};

/// A scene with braids, in its state after a frame.
#[derive(Clone, Debug)]
pub(crate) struct BraidScene {
    closed: Arc<Closed>,
    /// Curves of the last frame and of the frame before, as they are given.
    given: [Arc<CurveSet>; 2],
    /// True if the frame breaks a condition of the braids. It then has the loops of the first
    /// frame, and findings about loops are meaningless.
    pub is_broken: bool,
    /// True if exactly one of this frame and the one before is broken, so that the loops jump.
    pub jumps: bool,
}

/// Braids whose ends were found in the first frame.
#[derive(Debug)]
struct Closed {
    loops: BraidLoops,
    first: Arc<CurveSet>,
    pool: Mutex<FramePool>,
}

impl BraidScene {
    /// Closes the braids of the first frame.
    ///
    /// # Errors
    ///
    /// The errors of [`BraidLoops::new`].
    pub fn new(braids: &Braids, first: &Arc<CurveSet>) -> Result<BraidScene> {
        Ok(BraidScene {
            closed: Arc::new(Closed {
                loops: BraidLoops::new(braids, first)?,
                first: Arc::clone(first),
                pool: Mutex::default(),
            }),
            given: [(); 2].map(|()| Arc::clone(first)),
            is_broken: false,
            jumps: false,
        })
    }

    /// Returns the curves of a frame with the loops appended, and a text on the condition of the
    /// braids that the frame breaks, if it does.
    ///
    /// # Errors
    ///
    /// [`Error::LayoutChanged`](crate::Error::LayoutChanged) if the frame has other curves
    /// than the first one.
    pub fn follow(&mut self, given: &Arc<CurveSet>) -> Result<(Arc<CurveSet>, Option<String>)> {
        let Closed { loops, first, pool } = &*self.closed;
        first.check_same_layout(given)?;
        let mut pool = pool.lock().unwrap_or_else(PoisonError::into_inner);
        let mut broken = None;
        let set = pool.receive(|out| {
            broken = loops.write(given, out)?;
            Ok(())
        })?;
        self.jumps = self.is_broken != broken.is_some();
        self.is_broken = broken.is_some();
        self.given.rotate_right(1);
        self.given[0] = Arc::clone(given);
        Ok((set, broken))
    }

    /// Returns the given curves, without loops, of the previous and the current frame.
    pub fn step(&self) -> [&CurveSet; 2] {
        [&self.given[1], &self.given[0]]
    }

    /// Returns the braids, with all values that were derived from the first frame, and the first
    /// frame itself.
    pub fn braids(&self) -> (Braids, &Arc<CurveSet>) {
        (self.closed.loops.braids(), &self.closed.first)
    }

    pub fn filter(&self) -> PairFilter {
        PairFilter::Loops(Arc::clone(self.pairs()))
    }

    fn pairs(&self) -> &Arc<LoopPairs> {
        self.closed.loops.pairs()
    }

    /// Returns the expected linking numbers of the curves and the loops. In `all`, a loop has the
    /// index of its first curve.
    pub fn expected(&self, all: &Certificate) -> Certificate {
        let curves = 0..self.closed.first.len() as u32;
        let unbraided = curves.map(|i| Some(i).filter(|&i| self.closed.loops.number(i).is_none()));
        let loops = self.pairs().loops.iter().map(|pair| Some(pair[0]));
        all.with_curves(&unbraided.chain(loops).collect::<Vec<_>>())
    }

    /// Returns the expected linking numbers as in reports: a loop has the index of its first curve.
    pub fn joined(&self, all: &Certificate) -> Certificate {
        let unbraided = 0..self.closed.first.len() as u32;
        let number = unbraided.map(|i| Some(self.closed.loops.number(i).unwrap_or(i)));
        all.with_curves(&number.collect::<Vec<_>>())
    }

    /// Returns the number of curves without a linking number.
    pub fn open_curves(&self) -> u64 {
        (self.closed.first.open_curves() - self.pairs().loops.len()) as u64
    }

    /// Removes the findings about loops in a frame that breaks a condition of the braids. Linking
    /// numbers that the baseline lacks are not adopted from such a frame, because a later frame
    /// will have valid ones.
    pub fn forget_broken(&self, comparison: &mut Comparison) {
        if self.is_broken {
            let is_own = |i: u32| self.pairs().is_own(i);
            let own = |i: u32, j: Option<u32>| is_own(i) && j.is_none_or(is_own);
            comparison.changes.retain(|c| own(c.i, Some(c.j)));
            comparison.defects.retain(|d| own(d.i, d.j));
            comparison.adopted.clear();
        }
    }

    /// Replaces loops in the findings of a frame by their first curves, and adds to the report
    /// which other curve belongs to each loop.
    pub fn name(&self, report: &mut Report) {
        let mut loops = Vec::new();
        for Change { i, j, place, .. } in &mut report.changes {
            loops.extend(self.rename([i, j], place.as_mut()));
        }
        for Defect { i, j, place, .. } in &mut report.defects {
            match j {
                Some(j) => loops.extend(self.rename([i, j], Some(place))),
                None => *i = self.pairs().loop_of(*i).map_or(*i, |pair| pair[0]),
            }
        }
        for Link { i, j, .. } in &mut report.adopted {
            self.rename([i, j], None);
        }
        report.changes.sort_by_key(|c| (c.i, c.j));
        Defect::sort(&mut report.defects);
        report.adopted.sort_by_key(|l| (l.i, l.j));
        loops.sort_by_key(|pair| pair.curves);
        report.loops = loops;
    }

    /// Replaces the loops of a pair by their first curves. Returns the pair with all its curves if
    /// it contains a loop.
    fn rename(&self, pair: [&mut u32; 2], place: Option<&mut Place>) -> Option<LoopPair> {
        let [i, j] = pair;
        let found = [*i, *j].map(|i| self.pairs().loop_of(i));
        if found == [None; 2] {
            return None;
        }
        let mut named = [*i, *j];
        let mut loops = LoopPair {
            curves: named,
            partners: found.map(|pair| Some(pair?[1])),
            nearest: [None; 2],
        };
        let mut segments = place.as_ref().map_or([0; 2], |place| place.segments);
        for side in 0..2 {
            let Some(pair) = found[side] else {
                loops.nearest[side] = Some([named[side], segments[side]]);
                continue;
            };
            named[side] = pair[0];
            let given = &self.given[0];
            let nearest = self.closed.loops.origin(given, pair, segments[side]);
            loops.nearest[side] = nearest;
            // The place must be on a segment of the curve, because viewers show that curve.
            let last = given.curve(pair[0] as usize).segments - 1;
            segments[side] = match nearest {
                Some([curve, s]) if curve == pair[0] => s,
                _ => segments[side].min(last),
            };
        }
        if named[0] > named[1] {
            named.reverse();
            segments.reverse();
            loops.partners.reverse();
            loops.nearest.reverse();
        }
        loops.curves = named;
        match place {
            Some(place) => place.segments = segments,
            None => loops.nearest = [None; 2],
        }
        (*i, *j) = (named[0], named[1]);
        Some(loops)
    }
}
