//! Verification of braids: an inner verifier computes the linking numbers of the virtual loops, and
//! its findings join those of the frame.
//!
//! The outer verifier has the closed curves and the pull-throughs of all real curves. The inner one
//! has the pairs with at least one loop, on a set of curves in which loops stand for the curves of
//! braids, with the same indices ([`BraidLoops`]).

use super::{Verifier, VerifierOptions};
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::discretize::BraidLoops;
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::ingest::FramePool;
use crate::pairs::PairFilter;
use crate::verdict::{AbortOn, Change, Defect, LoopPair, Report, Stats};

/// Loops of the braids, and their verifier.
#[derive(Debug)]
pub(super) struct Braided {
    pub loops: BraidLoops,
    pub inner: Box<Verifier>,
    filter: PairFilter,
    pool: FramePool,
}

/// Findings about loops in a frame.
pub(super) struct Found {
    pub report: Report,
    /// The curves of these findings.
    pub pairs: Vec<LoopPair>,
}

impl Braided {
    /// Prepares the braids of the first frame. `options` are those of the outer verifier.
    pub fn new(set: &CurveSet, options: &VerifierOptions, outer: &Verifier) -> Result<Braided> {
        let braids = options.braids.as_ref();
        let none = || Error::Usage("no braids".into());
        let loops = BraidLoops::new(braids.ok_or_else(none)?, set)?;
        let filter = loops.filter();
        let mut inner = Verifier::with_gpu(
            VerifierOptions {
                baseline: options.baseline.as_ref().map(|b| b.of_filter(&filter)),
                braids: None,
                wrapped: None,
                events: Events::Off,
                motion_limit: None,
                clearance: None,
                abort_on: AbortOn::Never,
                ..options.clone()
            },
            crate::kernels::GpuUse::open(&options.device)?,
        );
        inner.set_filter(Some(filter.clone()));
        // One signal ends both.
        inner.full.share_progress(outer.progress());
        Ok(Braided {
            loops,
            inner: Box::new(inner),
            filter,
            pool: FramePool::default(),
        })
    }

    /// Verifies the loops of a frame. Fails with [`Error::Braid`] if the frame breaks a condition
    /// of the braids.
    pub fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Found> {
        let Braided {
            loops, inner, pool, ..
        } = self;
        let curves = pool.receive(|out| loops.write(set, out))?;
        let mut report = inner.step_shared(seq, time, &curves)?;
        let mut pairs = Vec::new();
        let changes = report.changes.iter_mut();
        let changes = changes.map(|c: &mut Change| (c.i, c.j, c.place.as_mut()));
        let defects = report.defects.iter_mut();
        let defects = defects.filter_map(|d: &mut Defect| Some((d.i, d.j?, Some(&mut d.place))));
        for (i, j, place) in changes.chain(defects) {
            let mut pair = LoopPair {
                curves: [i, j],
                partners: [i, j].map(|i| loops.partner(i)),
                nearest: [None; 2],
            };
            if let Some(place) = place {
                for (side, i) in [i, j].into_iter().enumerate() {
                    pair.nearest[side] = loops.origin(set, i, place.segments[side]);
                    // A segment of the curve, because viewers show that curve.
                    let last = set.curve(i as usize).segments - 1;
                    place.segments[side] = match pair.nearest[side] {
                        Some([curve, s]) if curve == i => s,
                        _ => place.segments[side].min(last),
                    };
                }
            }
            pairs.push(pair);
        }
        Ok(Found { report, pairs })
    }

    /// Returns the expected linking numbers of pairs without a loop.
    pub fn without_loops(&self, baseline: &Certificate) -> Certificate {
        baseline.without_loops(&self.filter)
    }

    /// Begins again with another baseline ([`Verifier::restart`]).
    pub fn restart(&mut self, baseline: &Certificate) {
        self.inner.restart(baseline.of_filter(&self.filter));
    }

    /// Returns the number of curves without a linking number.
    pub fn open_curves(&self, set: &CurveSet) -> u64 {
        let open = (0..set.len()).filter(|&i| !set.curve(i).closed);
        open.filter(|&i| self.loops.partner(i as u32).is_none())
            .count() as u64
    }

    /// Returns all expected linking numbers.
    pub fn joined(&self, outer: &Certificate) -> Certificate {
        match self.inner.baseline() {
            Some(inner) => Certificate::union(vec![outer, inner]),
            None => outer.clone(),
        }
    }
}

impl Verifier {
    /// Returns the braids with everything that was found in the first frame, so that other runs can
    /// close them in the same way. `None` before that frame, or without braids.
    pub fn braids(&self) -> Option<crate::Braids> {
        self.braided.as_ref().map(|b| b.loops.braids())
    }

    /// Verifies the loops of the braids, if there are any. If the frame breaks one of their
    /// conditions, adds that to `missing`.
    pub(super) fn verify_loops(
        &mut self,
        (seq, time): (u64, f64),
        set: &CurveSet,
        missing: &mut Vec<String>,
    ) -> Result<Option<Found>> {
        let Some(braided) = &mut self.braided else {
            return Ok(None);
        };
        let first = self.joined.is_none();
        let found = match braided.step(seq, time, set) {
            Ok(found) => Some(found),
            Err(Error::Braid(why)) if !first => {
                missing.push(format!("braids are not verified: {why}"));
                None
            }
            Err(e) => return Err(e),
        };
        let outer = self.baseline.as_ref();
        let changed = self.baseline_changed | braided.inner.baseline_changed;
        if found.is_some() && (changed || first) {
            braided.inner.baseline_changed = false;
            self.baseline_changed = true;
            self.joined = outer.map(|outer| braided.joined(outer));
        }
        Ok(found)
    }

    /// Adds the findings about loops to a report.
    pub(super) fn add_loops(&mut self, report: &mut Report, found: Found) {
        let Found {
            report: of_loops,
            pairs,
        } = found;
        report.changes.extend(of_loops.changes);
        report.changes.sort_by_key(|c| (c.i, c.j));
        report.defects.extend(of_loops.defects);
        report.defects.sort_by_key(|d| (d.i, d.j));
        report.adopted.extend(of_loops.adopted);
        report.adopted.sort_by_key(|l| (l.i, l.j));
        report.loops = pairs;
        report.loops.sort_by_key(|p| p.curves);
        add_work(&mut report.stats, &of_loops.stats);
        if let Some(Braided { inner, .. }) = &self.braided {
            let (timings, work) = (inner.timings(), inner.work());
            self.full.timings.add(&timings);
            self.work.add(&work);
        }
    }
}

/// Adds the work counters of an inner verifier, but not its sizes.
pub(super) fn add_work(stats: &mut Stats, inner: &Stats) {
    let sizes = *stats;
    stats.add(inner);
    *stats = Stats {
        curves: sizes.curves,
        segments: sizes.segments,
        open_curves: sizes.open_curves,
        extent: sizes.extent,
        ..*stats
    };
}
