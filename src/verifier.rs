//! The one module that knows all stages: a frame in, a report out.
//!
//! It has no file and no socket, and its clock only measures: live frames, recordings, model files and tests
//! drive it alike.

use crate::certificate::{Certificate, Link};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::kernels::Linking;
use crate::kernels::crossings::{Scene, Workspaces, linking_number};
use crate::pairs::{LinkSearch, Pair, Trees, closest_approach};
use crate::verdict::{AbortOn, Defect, DefectKind, Place, Report, Stats, Verdict};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

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
    trees: Trees,
    search: LinkSearch,
    parts: Vec<Part>,
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
        let stats = self.compute(set);
        (&self.certificate, stats)
    }

    /// Makes [`Verifier::certificate`] that of a frame.
    fn compute(&mut self, set: &CurveSet) -> Stats {
        let start = Instant::now();
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
        let pairs = self.search.find(self.trees.roots());
        if !undefined.is_empty() {
            let whole = |i: u32| undefined.binary_search_by_key(&i, |d| d.i).is_err();
            pairs.retain(|&(i, j)| whole(i) && whole(j));
        }
        let paired = Instant::now();
        let scene = Scene {
            set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        };
        compute_links(scene, pairs, &mut self.parts, &self.progress);
        let mut stats = Stats {
            curves: set.len() as u64,
            segments: set.segments() as u64,
            open_curves: set.curves().iter().filter(|c| !c.closed).count() as u64,
            repeated_vertices: (0..set.len())
                .into_par_iter()
                .map(|i| set.repeated_vertices(i) as u64)
                .sum(),
            ..Stats::default()
        };
        for part in &self.parts {
            links.extend_from_slice(&part.links);
            undefined.extend_from_slice(&part.undefined);
            stats.add(&part.stats);
        }
        // No two have the same key.
        undefined.sort_unstable_by_key(|d| (d.i, d.j));
        let end = Instant::now();
        self.timings = Timings {
            boxes: boxed - start,
            pairs: paired - boxed,
            links: end - paired,
            total: end - start,
        };
        stats
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
        if set.curves().iter().all(|c| !c.closed) {
            return Err(Error::NothingClosed { curves: set.len() });
        }
        let start = Instant::now();
        let stats = self.compute(set);
        let certificate = &self.certificate;
        let baseline = self.baseline.get_or_insert_with(|| certificate.clone());
        let mut comparison = certificate.compare(baseline)?;
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
    progress.done.store(0, Ordering::Relaxed);
    progress.total.store(pairs.len() as u64, Ordering::Relaxed);
    // Parts small enough to share out, large enough to be worth it. One pair may be a whole model; it shares
    // itself out.
    let size = (pairs.len() / (32 * rayon::current_num_threads())).clamp(1, 256);
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

/// What one task computed.
#[derive(Debug, Default)]
struct Part {
    links: Vec<Link>,
    undefined: Vec<Defect>,
    stats: Stats,
}

/// Closed curves that bound nothing, in order.
fn degenerate_curves(set: &CurveSet) -> impl Iterator<Item = Defect> {
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
