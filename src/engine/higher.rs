//! Invariants other than the linking numbers of pairs: their comparison with the baseline, and the
//! check that the change of `v2` matches the passages of a curve through itself.

use super::Engine;
use super::known::Known;
use crate::certificate::Comparison;
use crate::curve::{CurveSet, Frame, is_home};
use crate::diagram::{HigherInvariants, InvariantKind, change_of_v2};
use crate::error::Result;
use crate::incremental::{Events, Outcome};
use crate::pairs::Pair;
use crate::pool;
use crate::verdict::{Defect, DefectKind, Place, PullThrough, Report};
use crate::words::plural_of;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

impl Engine {
    /// Compares the invariants of a frame with the expected ones. If none are expected yet, those
    /// of the first frame become the expected ones. Adds to the report the changes, curves without
    /// invariants as defects, and texts about what was not compared. `is_given` is true in the
    /// first frame if a certificate was given.
    pub(super) fn compare_invariants(
        &self,
        known: &mut Known,
        set: &CurveSet,
        is_given: bool,
        comparison: &Comparison,
        report: &mut Report,
    ) {
        let (defects, missing) = (&mut report.defects, &mut report.missing);
        let changed: Vec<Pair> = comparison.changes.iter().map(|c| (c.i, c.j)).collect();
        for kind in InvariantKind::ALL {
            let expected = known.higher.iter().position(|of| of.kind == kind);
            if expected.is_none() && !self.options.invariants.contains(&kind) {
                continue;
            }
            let yarns = known.joined().map_or(0, |joined| joined.periods.len());
            if kind == InvariantKind::Curve && yarns > 0 {
                missing.push(format!(
                    "no invariants (`{kind}`) of {} through the periodic cell",
                    plural_of(yarns as u64, "curve that runs", "curves that run")
                ));
            }
            if kind == InvariantKind::Triple && known.cell.is_some() {
                // The invariants depend on which images of the curves the coordinates describe.
                missing.push(format!("no invariants (`{kind}`) in a periodic cell"));
                continue;
            }
            if expected.is_none() && is_given {
                missing.push(format!(
                    "the certificate has no invariants (`{kind}`): those of this frame are \
                     expected from here on"
                ));
            }
            let (found, touching) = pool::run(set.segments(), || HigherInvariants::of(set, kind));
            for defect in touching {
                let same = |other: &Defect| (other.i, other.j) == (defect.i, defect.j);
                if !defects.iter().any(same) {
                    defects.push(defect);
                }
            }
            let all = Arc::make_mut(&mut known.higher);
            let skipped = match expected {
                Some(at) => {
                    let (new, skipped) = found.compare(&mut all[at], &changed);
                    report.invariants.extend(new);
                    skipped
                }
                None => {
                    let skipped = found.uncomputed();
                    all.push(found);
                    skipped
                }
            };
            if skipped > 0 {
                missing.push(format!(
                    "invariants (`{kind}`) of {} were not compared: too many crossings, or unknown \
                     in the frames before",
                    plural_of(skipped as u64, "curve or triple", "curves or triples")
                ));
            }
        }
        Defect::sort(defects);
    }

    /// Returns a defect for each closed polyline whose change of `v2` since the previous frame
    /// differs from the sum over its passages through itself.
    pub(super) fn unaccounted_passages(
        &self,
        known: &Known,
        frame: &Frame,
        outcome: &Outcome,
    ) -> Result<Vec<Defect>> {
        let last = known.last.as_ref();
        let last = last.filter(|_| known.cell.is_none() && known.braids.is_none());
        let Some(last) = last.filter(|_| self.steps.events == Events::All) else {
            return Ok(Vec::new());
        };
        let mut passages: BTreeMap<u32, Vec<&PullThrough>> = BTreeMap::new();
        for event in outcome.events.iter().chain(&outcome.unresolved) {
            if event.i == event.j && is_home(&event.image) {
                passages.entry(event.i).or_default().push(event);
            }
        }
        let frames = [&**last.frame.set()?, &**frame.set()?];
        passages.retain(|&i, _| {
            let undecided = outcome.undecided.iter().any(|d| (d.i, d.j) == (i, Some(i)));
            frames[1].basis().is_polyline() && frames[1].curve(i as usize).closed && !undecided
        });
        let passages: Vec<(u32, Vec<&PullThrough>)> = passages.into_iter().collect();
        let unaccounted = passages.par_iter().filter_map(|(i, passages)| {
            let [found, expected] = change_of_v2(frames, *i, passages)?;
            let place = Place {
                segments: passages[0].segments,
                point: passages[0].point,
                distance: 0.0,
            };
            let defect = Defect::of_pair((*i, *i), DefectKind::Unaccounted, place);
            (found != expected).then_some(defect)
        });
        Ok(unaccounted.collect())
    }
}
