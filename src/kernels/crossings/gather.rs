//! Descent from the initial node pairs to the candidates of a pair. Polylines are evaluated on the
//! way.
//!
//! A task with much work left splits its node pairs in two halves and runs them in parallel. The
//! split depends on the curves alone, so the result is deterministic.

use super::{Input, Workspace};
use crate::discretize::Separation;
use crate::pairs::{Query, SegmentPairs, descend, every_second};
use crate::simd::{Lanes, dispatch_wide};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of candidates that are gathered before they are evaluated.
const BATCH: usize = 4096;

/// Number of node pairs that are visited before the candidates are evaluated, even if there are
/// few.
const STEPS: usize = 4096;

/// Number of rounds after which a task splits its remaining work: some tenths of a millisecond.
const ROUNDS: usize = 3;

/// Returns true if a pair with this many node pairs and candidates is split into parallel tasks.
pub(crate) fn shares_out(nodes: u64, candidates: u64) -> bool {
    nodes / STEPS as u64 + candidates / BATCH as u64 >= ROUNDS as u64
}

/// Number of candidates above which a pair of splines counts as too close, because a tangle in
/// which everything overlaps would exhaust the memory.
const MAX_CANDIDATES: usize = 1 << 25;

/// Candidates of a pair, upper curve first.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// Segment pairs that overlap in projection with the upper one not wholly below. They are
    /// tested for a crossing. Those whose boxes overlap in space may be too close to discretize.
    found: SegmentPairs,
    /// Candidates whose hulls are too close.
    close: Vec<(u32, u32)>,
}

impl Candidates {
    pub fn clear(&mut self) {
        self.found.all.clear();
        self.found.meeting.clear();
        self.close.clear();
    }
}

/// A pair of curves in one direction.
pub(super) struct Task<'a> {
    pub input: Input<'a>,
    /// Upper and lower curve.
    pub curves: [usize; 2],
    pub axis: usize,
    /// Bound of the rounding of the coordinates of polylines ([`CurveSet::rounding`]).
    ///
    /// [`CurveSet::rounding`]: crate::curve::CurveSet::rounding
    pub rounding: f64,
    separation: Separation<'a>,
    /// Number of candidates that wait for the discretization, in all tasks of the pair.
    waiting: AtomicUsize,
}

impl<'a> Task<'a> {
    pub fn new(input: Input<'a>, curves: [usize; 2], axis: usize) -> Self {
        Task {
            input,
            curves,
            axis,
            // The discretization of splines covers it.
            rounding: match input.set.basis().is_polyline() {
                true => input.set.rounding(),
                false => 0.0,
            },
            separation: Separation::new([input.set], curves),
            waiting: AtomicUsize::new(0),
        }
    }

    /// Returns true if the candidates exceed the limit. Some of them are then discarded.
    pub fn entangled(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) > MAX_CANDIDATES
    }

    /// Discretizes the pair and counts the crossings of the waiting candidates.
    ///
    /// # Errors
    ///
    /// A segment of the upper and a segment of the lower curve that are too close.
    pub fn finish_splines(&self, workspace: &mut Workspace) -> Result<(), [u32; 2]> {
        let (count, halving) = (&mut workspace.count, &mut workspace.halving);
        let Candidates { found, close } = &mut workspace.candidates;
        if !close.is_empty() {
            self.separation.refine(close, halving)?;
            let polylines = &mut workspace.polylines;
            count.add_split(self, &mut found.all, &halving.splits, polylines);
        }
        count.add_shared(self, &found.all);
        Ok(())
    }
}

/// Visits everything below the node pairs of the workspace's agenda. Afterwards the sum of
/// polylines is complete; the candidates of splines wait for their discretization.
#[inline(always)]
pub(super) fn gather<L: Lanes>(simd: L, task: &Task<'_>, workspace: &mut Workspace) {
    let Input { set, trees, .. } = task.input;
    let both = task.curves.map(|i| trees.of(set, i));
    let splines = !set.basis().is_polyline();
    let query = Query {
        w: task.axis,
        meeting: splines,
        reach: 0.0,
    };
    let (agenda, count) = (&mut workspace.agenda, &mut workspace.count);
    let Candidates { found, close } = &mut workspace.candidates;
    for round in 0.. {
        if round >= ROUNDS && agenda.len() > 1 {
            return split(task, workspace);
        }
        let known = found.all.len();
        let limits = (STEPS, known + BATCH);
        count.nodes += descend::<L, _, false>(simd, both, query, agenda, found, limits) as u64;
        if splines {
            // Candidates of splines wait for the final polylines.
            count.stats.overlaps += found.meeting.len() as u64;
            task.separation.add_close(&found.meeting, close);
            found.meeting.clear();
            let new = found.all.len() - known;
            task.waiting.fetch_add(new, Ordering::Relaxed);
            if task.entangled() {
                agenda.clear();
            }
        } else {
            // Polylines are evaluated at once, so that the list stays short.
            count.add(task, &found.all);
            found.all.clear();
        }
        if task.input.cancelled() {
            agenda.clear();
        }
        if agenda.is_empty() {
            return;
        }
    }
}

/// Splits the remaining work into two parallel tasks.
#[cold]
#[inline(never)]
fn split(task: &Task<'_>, workspace: &mut Workspace) {
    let workspaces = task.input.workspaces;
    let mut other = workspaces.take();
    other.count = Default::default();
    other.candidates.clear();
    other.agenda.clear();
    other.agenda.extend(every_second(&mut workspace.agenda));
    rayon::join(|| resume(task, workspace), || resume(task, &mut other));
    workspace.count.merge(&other.count);
    let (own, others) = (&mut workspace.candidates, &mut other.candidates);
    own.found.all.append(&mut others.found.all);
    own.close.append(&mut others.close);
    workspaces.put(other);
}

/// Runs [`gather`] with the best instruction set of the CPU.
pub(super) fn resume(task: &Task<'_>, workspace: &mut Workspace) {
    dispatch_wide!(simd => gather(simd, task, workspace))
}
