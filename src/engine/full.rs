//! Full runs, which compute all linking numbers of a frame, and runs over a given list of pairs.

use super::ladder::{Ladder, Sums};
use super::{Progress, Timings};
use crate::certificate::{Certificate, Comparison};
use crate::curve::{Box3, CurveSet, pow2};
use crate::error::Result;
use crate::kernels::choice::{Choice, Predictions};
use crate::kernels::crossings::{Input, Workspaces, linking_numbers};
use crate::kernels::sums::interval::noise::linking_number as noisy_linking_number;
use crate::kernels::{Accuracy, Counted, GpuUse, Linking, Method};
use crate::pairs::{LinkSearch, Pair, Trees, curves_of, degenerate_curves, most_suspect_first};
use crate::verdict::{Link, Stats};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Number of pairs that are computed before the first comparison with the baseline. The number
/// doubles after each comparison.
const FIRST_BLOCK: usize = 64;

/// Minimum number of curves per task that counts repeated vertices.
const FEW_CURVES: usize = 256;

/// Computes linking numbers. Its buffers are reused for every frame.
#[derive(Debug, Default)]
pub(super) struct FullRun {
    counting: Counting,
    /// Search for potential links, with those of the last frame.
    pub search: LinkSearch,
    parts: Vec<Counted>,
    /// Boxes of the previous frame, to find the curves that moved furthest.
    before: Vec<Box3>,
    /// Kernel that is tried first. Crossings are counted for pairs that it does not decide.
    pub method: Method,
    accuracy: Accuracy,
    /// GPU that runs kernels, if one is used.
    pub gpu: GpuUse,
    /// Certificate of the last frame.
    pub certificate: Certificate,
    /// Decisions of the last full run.
    pub ladder: Ladder,
    pub progress: Arc<Progress>,
    pub timings: Timings,
}

/// Trees of the curves, and the buffers of the tasks that count their crossings.
#[derive(Debug, Default)]
struct Counting {
    trees: Trees,
    workspaces: Workspaces,
}

impl Counting {
    fn input<'a>(&'a self, set: &'a CurveSet) -> Input<'a> {
        Input {
            set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        }
    }
}

impl FullRun {
    /// Creates the state.
    pub fn new(method: Method, accuracy: Accuracy, gpu: GpuUse) -> Self {
        let mut full = FullRun {
            method,
            accuracy,
            gpu,
            ..FullRun::default()
        };
        full.search.limit = full.progress.limit.clone();
        full
    }

    /// Shares the progress of another run, and its cancellation.
    pub fn share_progress(&mut self, progress: Arc<Progress>) {
        self.search.limit = progress.limit.clone();
        self.progress = progress;
    }

    /// Computes the certificate of a frame.
    pub fn certify(&mut self, set: &CurveSet) -> Stats {
        self.gpu.start_frame();
        if let Method::Auto | Method::Crossings = self.method {
            self.gpu.send_ahead(set);
        }
        let mut stats = self.find_pairs(set);
        match self.method {
            method @ (Method::Auto | Method::Crossings) => {
                let input = self.counting.input(set);
                let predictions = Predictions::new(input, self.search.pairs(), method);
                match predictions.choose(self.gpu.offer()) {
                    Choice::SumFirst => {
                        let long = predictions.long().to_vec();
                        let pairs = self.search.pairs().to_vec();
                        let cancel = self.counting.workspaces.cancel.clone();
                        let sums = Sums::of_long(set, &long, &pairs, cancel);
                        self.add_sums(set, &sums, &mut stats);
                    }
                    counting => {
                        let count = self.search.pairs().len();
                        self.compute_pairs(set, 0..count, counting, &mut stats);
                        self.ladder = Ladder {
                            counted: count as u64,
                            ..Ladder::default()
                        };
                    }
                }
            }
            method => {
                let pairs = self.search.pairs().to_vec();
                let sums = Sums::of(set, method, self.accuracy, &self.gpu, &pairs);
                self.add_sums(set, &sums, &mut stats);
            }
        }
        stats
    }

    /// Sets whether later computations end early after [`Progress::cancel`]. The results are then
    /// incomplete.
    pub fn heed_cancel(&mut self, heed: bool) {
        self.counting.workspaces.cancel = heed.then(|| self.progress.cancel.clone());
    }

    /// Adds all linking numbers to the certificate. Pairs that the bounds of the sums do not decide
    /// are counted.
    fn add_sums(&mut self, set: &CurveSet, sums: &Sums<'_>, stats: &mut Stats) {
        let start = Instant::now();
        let undecided: Vec<Pair> = sums.undecided().collect();
        let links: Vec<Link> = sums.links().collect();
        let summed = sums.pairs.len() - undecided.len();
        let done = &self.progress.done;
        done.fetch_add(summed as u64, Ordering::Relaxed);
        let input = self.counting.input(set);
        let counting = Predictions::new(input, &undecided, Method::Crossings);
        let counting = counting.choose(self.gpu.offer());
        let gpu = (counting == Choice::CountOnGpu).then_some(&mut self.gpu);
        compute_links(input, &undecided, gpu, &mut self.parts, &self.progress);
        gather(&self.parts, &mut self.certificate, stats);
        stats.potential_links += summed as u64;
        self.certificate.links.extend(links);
        self.certificate.links.sort_unstable_by_key(|l| (l.i, l.j));
        self.ladder = sums.ladder(&self.certificate);
        self.timings.links += start.elapsed() + self.ladder.summing;
    }

    /// Computes the linking numbers that no noise of the vertices of polylines can change.
    pub fn certify_noisy(&mut self, set: &CurveSet, noise: f64) -> Stats {
        // `find_pairs` counts without noise, where it can discard more pairs, so its counts do not
        // apply.
        let stats = Stats {
            potential_links: 0,
            separated: 0,
            ..self.find_pairs(set)
        };
        // Curves may become linked only if their boxes, grown by the noise, overlap.
        let rounding = set.max_abs() * pow2(-22);
        let reach = (noise + rounding) as f32;
        let roots = self.counting.trees.roots().iter();
        let dilated: Vec<Box3> = roots.map(|b| b.dilated(reach.next_up())).collect();
        let whole = |i: u32| {
            let mut undefined = self.certificate.undefined.iter();
            !undefined.any(|d| d.i == i && d.j.is_none())
        };
        let pairs = self.search.find(&dilated);
        pairs.retain(|&(i, j)| whole(i) && whole(j));
        let input = self.counting.input(set);
        let compute = |&pair: &Pair| {
            let run = |workspace: &mut _| noisy_linking_number(input, pair, noise, workspace);
            (pair, input.workspaces.run(run).0)
        };
        let found: Vec<(Pair, Linking)> = pairs.par_iter().map(compute).collect();
        let mut all = Counted::default();
        for (pair, linking) in found {
            all.add(pair, linking);
        }
        gather(&[all], &mut self.certificate, &mut Stats::default());
        stats
    }

    /// Computes the linking numbers of some pairs, which are sorted. The certificate has only these
    /// pairs.
    pub fn certify_pairs(&mut self, set: &CurveSet, pairs: &[Pair]) -> Certificate {
        let start = Instant::now();
        self.refit(set, pairs);
        // Curves whose boxes do not overlap are not linked, as in a full run.
        let roots = self.counting.trees.roots();
        let meet = |&(i, j): &Pair| roots[i as usize].overlaps(&roots[j as usize]);
        let meeting: Vec<Pair> = pairs.iter().copied().filter(meet).collect();
        let input = self.counting.input(set);
        // There are too few pairs to be worth a transfer to the GPU.
        linking_numbers(input, &meeting, &mut self.parts, &self.progress.done);
        let mut certificate = Certificate {
            curves: set.len(),
            ..Certificate::default()
        };
        gather(&self.parts, &mut certificate, &mut Stats::default());
        self.timings.links = start.elapsed();
        certificate
    }

    /// Updates the trees of the curves of some pairs to this frame.
    pub fn refit(&mut self, set: &CurveSet, pairs: &[Pair]) {
        let curves = curves_of(pairs.iter().copied());
        self.counting.trees.refit_some(set, &curves);
    }

    /// Returns the trees. Those of curves that the last run did not need may be of an earlier
    /// frame.
    pub fn trees(&self) -> &Trees {
        &self.counting.trees
    }

    /// Runs the stages before the linking numbers: boxes and potential links.
    pub fn find_pairs(&mut self, set: &CurveSet) -> Stats {
        let start = Instant::now();
        // Reset here, because until the pairs of this frame are found, the counts of the previous
        // frame would show a finished run.
        self.progress.total.store(0, Ordering::Relaxed);
        self.progress.done.store(0, Ordering::Relaxed);
        self.counting.trees.refit(set);
        let boxed = Instant::now();
        let certificate = &mut self.certificate;
        certificate.curves = set.len();
        certificate.links.clear();
        certificate.undefined.clear();
        certificate.undefined.extend(degenerate_curves(set));
        let roots = self.counting.trees.roots();
        let links = self.search.find_links(set, roots, &certificate.undefined);
        let total = links.len() as u64;
        self.progress.total.store(total, Ordering::Relaxed);
        self.timings = Timings {
            boxes: boxed - start,
            pairs: boxed.elapsed(),
            // In a partial run, the search for pull-throughs came first, so its time is kept.
            events: self.timings.events,
            ..Timings::default()
        };
        // Only polylines can have repeated vertices.
        let curves = match set.basis().is_polyline() {
            true => 0..set.len(),
            false => 0..0,
        };
        let filter = self.search.filter.as_ref();
        let own = |&i: &usize| filter.is_none_or(|filter| filter.contains(i as u32, i as u32));
        let repeated = curves.into_par_iter().with_min_len(FEW_CURVES).filter(own);
        let discarded = self.search.discarded as u64;
        let counts = Stats {
            potential_links: discarded,
            separated: discarded,
            repeated_vertices: repeated.map(|i| set.repeated_vertices(i) as u64).sum(),
            ..Stats::default()
        };
        with_sizes(counts, set)
    }

    /// Adds the linking numbers of a range of the potential links to the certificate.
    fn compute_pairs(
        &mut self,
        set: &CurveSet,
        range: Range<usize>,
        counting: Choice,
        stats: &mut Stats,
    ) {
        let start = Instant::now();
        let input = self.counting.input(set);
        let pairs = &self.search.pairs()[range];
        let gpu = (counting == Choice::CountOnGpu).then_some(&mut self.gpu);
        compute_links(input, pairs, gpu, &mut self.parts, &self.progress);
        gather(&self.parts, &mut self.certificate, stats);
        self.timings.links += start.elapsed();
    }

    /// Compares a frame with the baseline up to the first change, and starts with the pairs that
    /// are most likely to have changed.
    ///
    /// Pairs are processed in blocks of fixed sizes, so that the result does not depend on the
    /// number of threads.
    pub fn compare_until_change(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<(Comparison, Stats)> {
        self.gpu.send_ahead(set);
        self.before.clear();
        self.before.extend_from_slice(self.counting.trees.roots());
        let mut stats = self.find_pairs(set);
        let (now, pairs) = (self.counting.trees.roots(), self.search.pairs_mut());
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
            let (input, pairs) = (self.counting.input(set), &self.search.pairs()[done..next]);
            let counting = Predictions::new(input, pairs, Method::Crossings);
            let counting = counting.choose(self.gpu.offer());
            self.compute_pairs(set, done..next, counting, &mut stats);
            self.certificate.links.sort_unstable_by_key(|l| (l.i, l.j));
            (done, block) = (next, 2 * block);
        }
    }
}

/// Computes the linking numbers of these pairs, in parts that follow the order of the pairs.
fn compute_links(
    input: Input<'_>,
    pairs: &[Pair],
    gpu: Option<&mut GpuUse>,
    parts: &mut Vec<Counted>,
    progress: &Progress,
) {
    match gpu.and_then(|gpu| gpu.count(input, pairs)) {
        Some(found) => {
            *parts = found;
            let done = pairs.len() as u64;
            progress.done.fetch_add(done, Ordering::Relaxed);
        }
        None => linking_numbers(input, pairs, parts, &progress.done),
    }
}

/// Adds the results and the work of the tasks to a certificate.
fn gather(parts: &[Counted], certificate: &mut Certificate, stats: &mut Stats) {
    for part in parts {
        certificate.links.extend_from_slice(&part.links);
        certificate.undefined.extend_from_slice(&part.undefined);
        stats.add(&part.stats);
    }
    // The keys are distinct, so the order does not depend on the sort.
    certificate.undefined.sort_unstable_by_key(|d| (d.i, d.j));
}

/// Returns some counts with the sizes of a frame.
pub(super) fn with_sizes(counts: Stats, set: &CurveSet) -> Stats {
    Stats {
        curves: set.len() as u64,
        segments: set.segments() as u64,
        open_curves: set.open_curves() as u64,
        ..counts
    }
}
