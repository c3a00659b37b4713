//! Verification of braids: an inner verifier computes the linking numbers of the virtual loops, and
//! its findings join those of the frame.
//!
//! The outer verifier has the closed curves and the pull-throughs of all real curves. The inner one
//! has the pairs with at least one loop, on a set of curves in which loops stand for the curves of
//! braids, with the same indices ([`BraidLoops`]).

use super::known::Known;
use super::{Engine, Next, SessionOptions};
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::discretize::BraidLoops;
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::ingest::FramePool;
use crate::pairs::PairFilter;
use crate::verdict::{AbortOn, Change, Defect, LoopPair, Report, Stats};
use std::sync::Arc;

/// Loops of the braids, and their verifier.
#[derive(Debug)]
pub(super) struct Braided {
    pub loops: BraidLoops,
    /// First frame, which closed the braids.
    pub first: Arc<CurveSet>,
    pub inner: Box<Engine>,
    filter: PairFilter,
    pool: FramePool,
    /// Expected linking numbers of loops that are joined with the others.
    joined: Option<Arc<Certificate>>,
}

/// Findings about loops in a frame.
pub(super) struct Found {
    pub report: Report,
    /// The curves of these findings.
    pub pairs: Vec<LoopPair>,
}

impl Braided {
    /// Prepares the braids of the first frame. `options` are those of the outer verifier.
    pub fn new(set: &Arc<CurveSet>, options: &SessionOptions, outer: &Engine) -> Result<Braided> {
        let braids = options.braids.as_ref();
        let none = || Error::Usage("no braids".into());
        let loops = BraidLoops::new(braids.ok_or_else(none)?, set)?;
        let filter = loops.filter();
        let mut inner = Engine::with_gpu(
            SessionOptions {
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
        inner.share_progress(outer.progress());
        Ok(Braided {
            loops,
            first: Arc::clone(set),
            inner: Box::new(inner),
            filter,
            pool: FramePool::default(),
            joined: None,
        })
    }

    /// Verifies the loops of a frame. Fails with [`Error::Braid`] if the frame breaks a condition
    /// of the braids.
    pub fn step(&mut self, next: Next<'_>) -> Result<Found> {
        let Braided {
            loops, inner, pool, ..
        } = self;
        let set = &**next.curves;
        let curves = pool.receive(|out| loops.write(set, out))?;
        let mut report = inner.verify(Next {
            curves: &curves,
            ..next
        })?;
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

impl Engine {
    /// Returns the braids with everything that was found in the first frame, so that other runs can
    /// close them in the same way. `None` before that frame, or without braids.
    pub fn braids(&self) -> Option<crate::Braids> {
        self.braided.as_ref().map(|b| b.loops.braids())
    }

    /// Verifies the loops of the braids, if there are any. If the frame breaks one of their
    /// conditions, adds that to `missing`: a curve may have passed a virtual connection.
    pub(super) fn verify_loops(
        &mut self,
        known: &mut Known,
        next: Next<'_>,
        missing: &mut Vec<String>,
    ) -> Result<Option<Found>> {
        let Some(braided) = &mut self.braided else {
            return Ok(None);
        };
        let first = self.with_braids.is_some();
        let found = match braided.step(next) {
            Ok(found) => found,
            Err(Error::Braid(why)) if !first => {
                missing.push(format!("braids are not verified: {why}"));
                return Ok(None);
            }
            Err(e) => return Err(e),
        };
        if let Some(baseline) = &known.baseline {
            let inner = braided.inner.baseline();
            let same = known
                .joined
                .as_ref()
                .is_some_and(|(_, from)| Arc::ptr_eq(from, baseline))
                && inner.map(Arc::as_ptr) == braided.joined.as_ref().map(Arc::as_ptr);
            if !same {
                let joined = Arc::new(braided.joined(baseline));
                known.joined = Some((joined, Arc::clone(baseline)));
                braided.joined = braided.inner.baseline().cloned();
            }
        }
        Ok(Some(found))
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
