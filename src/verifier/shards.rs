//! Results of several verifiers that share the pairs of curves, joined into one report.

use super::intactness::Intactness;
use crate::certificate::Certificate;
use crate::error::{self, Error};
use crate::incremental::{Events, sort_by_time};
use crate::verdict::{Change, Defect, DefectKind, Link, PullThrough, Report, Stats};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Result of a frame from one of several verifiers that share the pairs of curves
/// ([`Verifier::part`](crate::Verifier::part)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    seq: u64,
    /// Frame at the start of the step to this one.
    previous: Option<u64>,
    abort: bool,
    changes: Vec<Change>,
    events: Vec<PullThrough>,
    unresolved: Vec<PullThrough>,
    defects: Vec<Defect>,
    adopted: Vec<Link>,
    appeared: Vec<String>,
    gone: Vec<String>,
    /// True if a curve may have been pulled through another one since the last intact frame.
    broken: bool,
    /// True if the whole step to the frame is proven to be safe.
    safe: bool,
    stats: Stats,
    /// Expected linking numbers, if they differ from those of the last part.
    baseline: Option<Certificate>,
}

impl Part {
    pub(super) fn new(
        report: Report,
        (previous, broken): (Option<u64>, bool),
        baseline: Option<Certificate>,
    ) -> Part {
        Part {
            seq: report.seq,
            previous,
            abort: report.abort,
            broken,
            safe: report.safe_fraction == Some(1.0),
            changes: report.changes,
            events: report.events,
            unresolved: report.unresolved,
            defects: report.defects,
            adopted: report.adopted,
            appeared: report.appeared,
            gone: report.gone,
            stats: report.stats,
            baseline,
        }
    }

    /// Returns the sequence number of the frame.
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// Checks a part of another process for a frame with this number of curves.
    ///
    /// Errors: [`Error::Format`] if it has a curve that the frame does not have, or expected
    /// numbers of other curves.
    #[cfg_attr(
        not(feature = "bus"),
        expect(dead_code, reason = "only the bus receives them")
    )]
    pub(crate) fn check(&self, curves: usize) -> error::Result<()> {
        let changes = self.changes.iter().map(|c| (c.i, c.j));
        let steps = self.events.iter().chain(&self.unresolved);
        let steps = steps.map(|e| (e.i, e.j));
        let defects = self.defects.iter().map(|d| (d.i, d.j.unwrap_or(d.i)));
        let adopted = self.adopted.iter().map(|l| (l.i, l.j));
        let mut all = changes.chain(steps).chain(defects).chain(adopted);
        if let Some((i, j)) = all.find(|&(i, j)| i.max(j) as usize >= curves) {
            let what = format!("curves {i} and {j} of {curves}");
            return Err(Error::format("result of a shard", "findings", what));
        }
        let Some(baseline) = &self.baseline else {
            return Ok(());
        };
        if baseline.curves != curves {
            let what = format!("{} curves, expected {curves}", baseline.curves);
            return Err(Error::format("result of a shard", "expected numbers", what));
        }
        baseline.check()
    }
}

/// Joins the parts of each frame into one report.
///
/// If all parts are there, the report is that of a single verifier, except for the work counters
/// and [`Report::safe_fraction`], which is `None` if something was found. If one is missing, the
/// frame is never [intact](crate::Verdict::Intact).
///
/// ```
/// use linkwatch::{Events, Joiner, Partition, Verdict, Verifier};
/// use linkwatch::scenes::Scene;
///
/// let set = "chainmail:rows=4,columns=5".parse::<Scene>()?.build()?.curves;
/// let partition = Partition::new(&set, 2)?;
/// let mut joiner = Joiner::new(2, Events::Off);
/// let mut verifiers = [Verifier::default(), Verifier::default()];
/// let mut parts = Vec::new();
/// for (shard, verifier) in verifiers.iter_mut().enumerate() {
///     verifier.verify_share(partition.share(shard))?;
///     let report = verifier.step(0, 0.0, &set)?;
///     parts.push(Ok(verifier.part(report)));
/// }
/// assert_eq!(joiner.join(0, 0.0, parts).verdict, Verdict::Intact);
///
/// let report = verifiers[0].step(1, 0.1, &set)?;
/// let parts = vec![Ok(verifiers[0].part(report)), Err("shard 2 was killed".to_owned())];
/// assert_eq!(joiner.join(1, 0.1, parts).verdict, Verdict::Undecided);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Joiner {
    /// True if pull-throughs are searched for.
    searches: bool,
    intactness: Intactness,
    /// Previous frame, if the next one continues it.
    previous: Option<u64>,
    baselines: Vec<Option<Certificate>>,
}

impl Joiner {
    /// Creates the state for this number of shards, before the first frame.
    pub fn new(shards: usize, events: Events) -> Joiner {
        Joiner {
            searches: events != Events::Off,
            intactness: Intactness::default(),
            previous: None,
            baselines: vec![None; shards],
        }
    }

    /// Returns the expected linking numbers of one shard, from 0: a verifier that takes its place
    /// needs them as [`VerifierOptions::baseline`](crate::VerifierOptions::baseline). `None` if
    /// they are unknown, because the shard has sent no part with these curves.
    ///
    /// # Panics
    /// If there is no such shard.
    pub fn baseline(&self, shard: usize) -> Option<&Certificate> {
        self.baselines[shard].as_ref()
    }

    /// Returns the expected linking numbers of all shards together. `None` if those of a shard are
    /// unknown.
    pub fn whole_baseline(&self) -> Option<Certificate> {
        let parts = self.baselines.iter().map(Option::as_ref);
        parts.collect::<Option<Vec<_>>>().map(Certificate::union)
    }

    /// Marks the next frame as not continuing the previous one
    /// ([`Verifier::cut`](crate::Verifier::cut)).
    pub fn cut(&mut self) {
        self.intactness.cut();
        self.previous = None;
    }

    /// Announces that the next frame has other curves
    /// ([`Verifier::change_curves`](crate::Verifier::change_curves)).
    pub fn change_curves(&mut self) {
        self.baselines.fill(None);
    }

    /// Returns the last frame that is known to be intact.
    pub fn last_intact(&self) -> Option<u64> {
        self.intactness.last_intact()
    }

    /// Joins the parts of a frame: one of each shard, in order, or the reason why it is missing.
    ///
    /// # Panics
    /// If the number of parts is not that of the shards, or a part is of another frame.
    pub fn join(&mut self, seq: u64, time: f64, parts: Vec<Result<Part, String>>) -> Report {
        assert_eq!(parts.len(), self.baselines.len(), "one part of each shard");
        let mut report = Report::new(seq, time, crate::Verdict::Intact);
        let mut stats = Vec::new();
        let (mut safe, mut broken) = (true, false);
        for (k, part) in parts.into_iter().enumerate() {
            let part = match part {
                Ok(part) => part,
                Err(why) => {
                    report.missing.push(why);
                    continue;
                }
            };
            assert_eq!(part.seq, seq, "a part of another frame");
            report.abort |= part.abort;
            report.changes.extend(part.changes);
            report.events.extend(part.events);
            report.unresolved.extend(part.unresolved);
            report.defects.extend(part.defects);
            report.adopted.extend(part.adopted);
            // Each shard reports all curves that appeared or are gone.
            (report.appeared, report.gone) = (part.appeared, part.gone);
            if self.searches && part.previous != self.previous {
                let why = "does not know the previous frame, so pull-throughs are unknown";
                report.missing.push(format!("shard {} {why}", k + 1));
            }
            safe &= part.safe;
            broken |= part.broken;
            stats.push(part.stats);
            if part.baseline.is_some() {
                self.baselines[k] = part.baseline;
            }
        }
        report.changes.sort_by_key(|c| (c.i, c.j));
        sort_by_time(&mut report.events);
        sort_by_time(&mut report.unresolved);
        report.adopted.sort_by_key(|l| (l.i, l.j));
        report.defects.sort_by_key(|d| (d.i, d.j));
        // Each shard reports the defects of single curves.
        report
            .defects
            .dedup_by(|a, b| a.j.is_none() && (a.i, a.j, a.kind) == (b.i, b.j, b.kind));
        // Several shards may lack the numbers of a curve that was degenerate.
        let mut lacking = BTreeSet::new();
        let defects = &mut report.defects;
        defects.retain(|d| d.kind != DefectKind::NoBaseline || lacking.insert((d.i, d.j)));
        report.stats = joined(&stats);
        report.verdict = report.verdict_of_findings();
        let missing = !report.missing.is_empty();
        report.safe_fraction = (safe && !missing && self.intactness.is_intact()).then_some(1.0);
        // Without a part, it is unknown what was pulled through what in the step.
        let unknown = missing && self.searches;
        self.intactness.conclude(&mut report, unknown || broken);
        self.previous = Some(seq);
        report
    }
}

/// Returns the sum of the work of all shards, with the sizes of the frame.
fn joined(stats: &[Stats]) -> Stats {
    let mut sum = Stats::default();
    stats.iter().for_each(|s| sum.add(s));
    let sizes = stats.first().copied().unwrap_or_default();
    Stats {
        curves: sizes.curves,
        segments: sizes.segments,
        open_curves: sizes.open_curves,
        ..sum
    }
}
