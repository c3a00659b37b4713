//! The one module that knows all stages: a frame in, a report out.
//!
//! It has no file and no socket, and its clock only measures: live frames, recordings, model files and tests
//! drive it alike.

use crate::certificate::{Certificate, Comparison, Link};
use crate::curve::{Box3, CurveSet};
use crate::error::{Error, Result};
use crate::incremental::{Finding, Monitor, Route, Work};
use crate::kernels::Linking;
use crate::kernels::crossings::{Scene, Workspaces, linking_number};
use crate::pairs::{LinkSearch, Pair, Trees, closest_approach, most_suspect_first};
use crate::verdict::{AbortOn, Defect, DefectKind, Place, Report, Stats, Verdict};
use rayon::prelude::*;
use std::slice::SliceIndex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Pairs that are computed before the first look for a change; then twice as many each time.
const FIRST_BLOCK: usize = 64;

/// How far a long run is. Shared with whoever shows it.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicU64,
    total: AtomicU64,
}

impl Progress {
    /// Pairs computed, and pairs in all, of the frame in work.
    pub fn pairs(&self) -> (u64, u64) {
        (
            self.done.load(Ordering::Relaxed),
            self.total.load(Ordering::Relaxed),
        )
    }
}

/// Time that the stages of the last frame took. No part of a [`Report`]: reports do not depend on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timings {
    /// Boxes of all segments, and the trees over them.
    pub boxes: Duration,
    /// Search for potential links.
    pub pairs: Duration,
    /// Discretization and linking numbers of all potential links.
    pub links: Duration,
    /// Everything, comparison included.
    pub total: Duration,
}

/// Verifies frame after frame against a baseline. Its buffers serve every frame.
///
/// The result does not depend on the number of threads of the rayon pool that it is called in.
#[derive(Debug, Default)]
pub struct Verifier {
    abort_on: AbortOn,
    baseline: Option<Certificate>,
    early_exit: bool,
    incremental: bool,
    monitor: Monitor,
    work: Work,
    trees: Trees,
    search: LinkSearch,
    parts: Vec<Part>,
    /// Boxes of the frame before, where the motion since then is asked for.
    before: Vec<Box3>,
    workspaces: Workspaces,
    /// Of the last frame.
    certificate: Certificate,
    progress: Arc<Progress>,
    timings: Timings,
}

impl Verifier {
    /// A verifier that takes the first frame as its baseline.
    pub fn new(abort_on: AbortOn) -> Self {
        Verifier {
            abort_on,
            ..Verifier::default()
        }
    }

    /// A verifier with a baseline of its own.
    pub fn with_baseline(abort_on: AbortOn, baseline: Certificate) -> Self {
        Verifier {
            abort_on,
            baseline: Some(baseline),
            ..Verifier::default()
        }
    }

    /// Whether [`Verifier::step`] stops at the first change that it finds, and leaves the other pairs unchecked.
    ///
    /// Pairs are computed in the order in which they are likely to have changed, so a broken frame is told from an
    /// intact one long before all is known. An intact frame takes as long as ever.
    pub fn set_early_exit(&mut self, early_exit: bool) {
        self.early_exit = early_exit;
    }

    /// Whether [`Verifier::step`] computes only what has changed since an earlier frame, where it can prove that.
    ///
    /// The verdicts are the same. [`Report::stats`] then has the sizes of the scene alone, since the work depends on
    /// the frames before; see [`Verifier::work`].
    pub fn set_incremental(&mut self, incremental: bool) {
        self.incremental = incremental;
    }

    /// What the last frame took.
    pub fn work(&self) -> Work {
        self.work
    }

    /// What frames are compared with, once there is something.
    pub fn baseline(&self) -> Option<&Certificate> {
        self.baseline.as_ref()
    }

    /// A view on the progress of the frame in work.
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.progress)
    }

    /// Time that the last frame took.
    pub fn timings(&self) -> Timings {
        self.timings
    }

    /// All linking numbers of a frame.
    pub fn certify(&mut self, set: &CurveSet) -> (&Certificate, Stats) {
        let start = Instant::now();
        let mut stats = self.find_pairs(set);
        self.compute_pairs(set, .., &mut stats);
        self.timings.total = start.elapsed();
        (&self.certificate, stats)
    }

    /// The stages before the linking numbers: boxes and potential links. Nothing is certified yet.
    fn find_pairs(&mut self, set: &CurveSet) -> Stats {
        let start = Instant::now();
        if self.early_exit {
            self.before.clear();
            self.before.extend_from_slice(self.trees.roots());
        }
        self.trees.refit(set);
        let boxed = Instant::now();
        let Certificate {
            curves,
            links,
            undefined,
        } = &mut self.certificate;
        *curves = set.len();
        links.clear();
        undefined.clear();
        undefined.extend(degenerate_curves(set));
        let pairs = potential_links(&self.trees, &mut self.search, undefined);
        self.progress.done.store(0, Ordering::Relaxed);
        let total = pairs.len() as u64;
        self.progress.total.store(total, Ordering::Relaxed);
        self.timings = Timings {
            boxes: boxed - start,
            pairs: boxed.elapsed(),
            ..Timings::default()
        };
        // Only polylines can have any.
        let curves = if set.basis().is_polyline() {
            set.len()
        } else {
            0
        };
        let repeated = (0..curves).into_par_iter();
        Stats {
            repeated_vertices: repeated.map(|i| set.repeated_vertices(i) as u64).sum(),
            ..sizes(set)
        }
    }

    /// Adds the linking numbers of a range of the potential links to the certificate.
    fn compute_pairs(
        &mut self,
        set: &CurveSet,
        range: impl SliceIndex<[Pair], Output = [Pair]>,
        stats: &mut Stats,
    ) {
        let start = Instant::now();
        let scene = Scene {
            set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        };
        compute_links(
            scene,
            &self.search.pairs()[range],
            &mut self.parts,
            &self.progress,
        );
        gather(&self.parts, &mut self.certificate, stats);
        self.timings.links += start.elapsed();
    }

    /// Compares a frame with the baseline, the most suspect pairs first, up to the first change.
    ///
    /// Pairs are taken in blocks, so that what is found does not depend on the number of threads.
    fn compare_until_change(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<(Comparison, Stats)> {
        let mut stats = self.find_pairs(set);
        let (now, pairs) = (self.trees.roots(), self.search.pairs_mut());
        most_suspect_first(pairs, &baseline.links, now, &self.before);
        let count = pairs.len();
        let (mut done, mut block) = (0, FIRST_BLOCK);
        let mut unchecked = Vec::new();
        loop {
            unchecked.clear();
            unchecked.extend_from_slice(&self.search.pairs()[done..]);
            unchecked.sort_unstable();
            stats.unchecked = unchecked.len() as u64;
            let comparison = self.certificate.compare_except(baseline, &unchecked)?;
            if !comparison.changes.is_empty() || done == count {
                return Ok((comparison, stats));
            }
            let next = (done + block).min(count);
            self.compute_pairs(set, done..next, &mut stats);
            self.certificate.links.sort_unstable_by_key(|l| (l.i, l.j));
            (done, block) = (next, 2 * block);
        }
    }

    /// Compares a frame with the baseline, computing only what is not known from the reference frame.
    fn compare_incrementally(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<(Comparison, Stats)> {
        let finding = self.monitor.look(set, baseline, &mut self.work);
        let (Finding::AllBut(pairs), Some((known, comparison))) = (finding, self.monitor.known())
        else {
            let (certificate, stats) = self.certify(set);
            let comparison = certificate.compare(baseline)?;
            self.offer_reference(set);
            return Ok((comparison, stats));
        };
        let mut stats = Stats::default();
        if pairs.is_empty() && self.work.route == Route::Quiet {
            return Ok((comparison.clone(), stats));
        }
        let start = Instant::now();
        self.trees
            .refit_some(set, &curves_of(pairs.iter().copied()));
        // Curves whose boxes are apart are not linked, as in a full run.
        let roots = self.trees.roots();
        let meet = |&(i, j): &Pair| roots[i as usize].overlaps(&roots[j as usize]);
        let meeting: Vec<Pair> = pairs.iter().copied().filter(meet).collect();
        let scene = Scene {
            set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        };
        compute_links(scene, &meeting, &mut self.parts, &self.progress);
        let mut anew = Certificate {
            curves: set.len(),
            ..Certificate::default()
        };
        gather(&self.parts, &mut anew, &mut stats);
        let fresh = anew.compare(&baseline.of_pairs(&pairs))?;
        let comparison = comparison.patched(&pairs, fresh);
        if self.monitor.wants_reference(&self.work) {
            let certificate = known.patched(&pairs, &anew);
            let pairs = self.search.pairs().len();
            self.monitor.make_reference(set.clone(), certificate, pairs);
        }
        self.timings.links = start.elapsed();
        Ok((comparison, stats))
    }

    /// Lets the frame whose certificate has just been computed become the reference, where that may pay.
    fn offer_reference(&mut self, set: &CurveSet) {
        if self.incremental && self.monitor.wants_reference(&self.work) {
            let pairs = self.search.pairs().len();
            self.monitor
                .make_reference(set.clone(), self.certificate.clone(), pairs);
        }
    }

    /// Waits for work beside the stream to end, so that the next frame profits from it. For measurements.
    pub fn settle(&mut self) {
        self.monitor.settle();
    }

    /// Verifies one frame. The first one becomes the baseline where there is none.
    ///
    /// Errors: [`Error::CertificateMismatch`] where the baseline is of another number of curves,
    /// [`Error::NothingClosed`] where no curve is closed: nothing was verified then, so nothing is intact.
    pub fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Report> {
        if let Some(b) = self.baseline.as_ref().filter(|b| b.curves != set.len()) {
            return Err(Error::CertificateMismatch {
                certificate: b.curves,
                model: set.len(),
            });
        }
        if set.open_curves() == set.len() {
            return Err(Error::NothingClosed { curves: set.len() });
        }
        let start = Instant::now();
        self.work = Work::default();
        let (mut comparison, stats) = match self.baseline.take() {
            None => {
                let (certificate, stats) = self.certify(set);
                let baseline = certificate.clone();
                let comparison = baseline.compare(&baseline);
                self.baseline = Some(baseline);
                self.offer_reference(set);
                (comparison?, stats)
            }
            Some(baseline) => {
                let comparison = if self.incremental {
                    self.compare_incrementally(set, &baseline)
                } else if self.early_exit {
                    self.compare_until_change(set, &baseline)
                } else {
                    let (certificate, stats) = self.certify(set);
                    certificate.compare(&baseline).map(|c| (c, stats))
                };
                self.baseline = Some(baseline);
                comparison?
            }
        };
        // Trees of what the frame did not ask for may be those of an earlier frame.
        if self.work.route != Route::Full && !comparison.changes.is_empty() {
            let changes = comparison.changes.iter();
            self.trees
                .refit_some(set, &curves_of(changes.map(|c| (c.i, c.j))));
        }
        let stats = match self.incremental {
            true => sizes(set),
            false => stats,
        };
        let trees = &self.trees;
        comparison.changes.par_iter_mut().for_each(|c| {
            let (i, j) = (c.i as usize, c.j as usize);
            // An open curve has no tree; it has no number either, and so no change but a lost one.
            if set.curve(i).closed && set.curve(j).closed {
                c.place = Some(closest_approach(set, trees, i, j));
            }
        });
        let contact = comparison
            .defects
            .iter()
            .any(|d| d.kind == DefectKind::Contact);
        let verdict = if !comparison.changes.is_empty() {
            Verdict::Changed
        } else if contact {
            Verdict::Contact
        } else if !comparison.defects.is_empty() {
            Verdict::Undecided
        } else {
            Verdict::Intact
        };
        self.timings.total = start.elapsed();
        Ok(Report {
            seq,
            time,
            verdict,
            abort: self.abort_on.aborts(verdict, &comparison.changes, contact),
            changes: comparison.changes,
            defects: comparison.defects,
            rejected: None,
            stats,
        })
    }

    /// The report on a frame that broke its contract.
    pub fn reject(&self, seq: u64, time: f64, why: &Error) -> Report {
        Report {
            seq,
            time,
            verdict: Verdict::Rejected,
            abort: false,
            changes: Vec::new(),
            defects: Vec::new(),
            rejected: Some(why.to_string()),
            stats: Stats::default(),
        }
    }
}

/// The linking numbers of these pairs, in parts that follow one another in the order of the pairs.
fn compute_links(scene: Scene<'_>, pairs: &[Pair], parts: &mut Vec<Part>, progress: &Progress) {
    let size = links_per_task(pairs.len(), rayon::current_num_threads());
    let count = pairs.len().div_ceil(size);
    parts.resize_with(count.max(parts.len()), Part::default);
    parts.par_iter_mut().enumerate().for_each(|(k, part)| {
        part.links.clear();
        part.undefined.clear();
        part.stats = Stats::default();
        if k >= count {
            return;
        }
        let pairs = &pairs[k * size..pairs.len().min((k + 1) * size)];
        let mut workspace = scene.workspaces.take();
        for &(i, j) in pairs {
            match linking_number(scene, (i, j), None, &mut workspace) {
                Linking::Number(0) => {}
                Linking::Number(lambda) => part.links.push(Link { i, j, lambda }),
                Linking::Undefined(kind, place) => part.undefined.push(Defect {
                    i,
                    j: Some(j),
                    kind,
                    place,
                }),
            }
        }
        part.stats = workspace.take_stats();
        scene.workspaces.put(workspace);
        progress
            .done
            .fetch_add(pairs.len() as u64, Ordering::Relaxed);
    });
}

/// Adds what the tasks computed to a certificate, and their work.
fn gather(parts: &[Part], certificate: &mut Certificate, stats: &mut Stats) {
    for part in parts {
        certificate.links.extend_from_slice(&part.links);
        certificate.undefined.extend_from_slice(&part.undefined);
        stats.add(&part.stats);
    }
    // No two have the same key.
    certificate.undefined.sort_unstable_by_key(|d| (d.i, d.j));
}

/// The size of a frame.
fn sizes(set: &CurveSet) -> Stats {
    Stats {
        curves: set.len() as u64,
        segments: set.segments() as u64,
        open_curves: set.open_curves() as u64,
        ..Stats::default()
    }
}

/// The curves of some pairs, sorted.
fn curves_of(pairs: impl Iterator<Item = Pair>) -> Vec<u32> {
    let mut curves: Vec<u32> = pairs.flat_map(|(i, j)| [i, j]).collect();
    curves.sort_unstable();
    curves.dedup();
    curves
}

/// Potential links computed by one task: few enough to share out, enough to be worth it. One of them may be a whole
/// model; it shares itself out.
pub(crate) fn links_per_task(links: usize, threads: usize) -> usize {
    (links / (32 * threads)).clamp(1, 256)
}

/// Pairs that may be linked: those whose boxes overlap, but for degenerate curves, which are sorted.
pub(crate) fn potential_links<'a>(
    trees: &Trees,
    search: &'a mut LinkSearch,
    degenerate: &[Defect],
) -> &'a mut Vec<Pair> {
    let pairs = search.find(trees.roots());
    if !degenerate.is_empty() {
        let whole = |i: u32| degenerate.binary_search_by_key(&i, |d| d.i).is_err();
        pairs.retain(|&(i, j)| whole(i) && whole(j));
    }
    pairs
}

/// What one task computed.
#[derive(Debug, Default)]
struct Part {
    links: Vec<Link>,
    undefined: Vec<Defect>,
    stats: Stats,
}

/// Closed curves that bound nothing, in order.
pub(crate) fn degenerate_curves(set: &CurveSet) -> impl Iterator<Item = Defect> {
    (0..set.len())
        .filter(|&i| set.curve(i).closed && !set.has_three_distinct_points(i))
        .map(|i| Defect {
            i: i as u32,
            j: None,
            kind: DefectKind::Degenerate,
            place: Place {
                segments: [0, 0],
                point: set.point(i, 0),
                distance: 0.0,
            },
        })
}
