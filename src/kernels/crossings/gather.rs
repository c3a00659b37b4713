//! From the node pairs to start with to the candidates of a pair, and for polylines straight on to their sum.
//!
//! A task that has much left to do halves what is left and shares it out. Where it does so depends on the scene
//! alone, and so does the result.

use super::evaluate::Tally;
use super::{Scene, Workspace};
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{Lanes, Portable};
use crate::discretize::Separation;
use crate::pairs::{Query, SegmentPairs, descend};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Candidates at which they are looked at.
const BATCH: usize = 4096;

/// Node pairs after which candidates are looked at, however few.
const STEPS: usize = 4096;

/// Rounds of these after which a task shares out what is left: some tenths of a millisecond.
const ROUNDS: usize = 3;

/// Whether a pair that takes these node pairs and candidates is shared out among threads.
pub(crate) fn shares_out(nodes: u64, candidates: u64) -> bool {
    nodes / STEPS as u64 + candidates / BATCH as u64 >= ROUNDS as u64
}

/// Candidates of one pair of splines at which it counts as too close: a tangle in which everything overlaps
/// everything would fill the memory.
const MAX_CANDIDATES: usize = 1 << 25;

/// Candidates of a pair, upper curve first.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// Overlap in projection, and the upper one is not wholly below: to be tested for a crossing. Those of them
    /// whose boxes overlap in space may be too close to discretize.
    found: SegmentPairs,
    /// Those of them that are, as far as their hulls tell.
    close: Vec<(u32, u32)>,
}

impl Candidates {
    pub fn clear(&mut self) {
        self.found.all.clear();
        self.found.meeting.clear();
        self.close.clear();
    }
}

/// One pair of curves in one direction.
pub(super) struct Task<'a> {
    pub scene: Scene<'a>,
    /// Upper and lower curve.
    pub curves: [usize; 2],
    pub axis: usize,
    separation: Separation<'a>,
    /// Candidates that wait for the discretization, of all tasks of the pair.
    waiting: AtomicUsize,
}

impl<'a> Task<'a> {
    pub fn new(scene: Scene<'a>, curves: [usize; 2], axis: usize) -> Self {
        Task {
            scene,
            curves,
            axis,
            separation: Separation::new(scene.set, curves),
            waiting: AtomicUsize::new(0),
        }
    }

    /// Whether there are more candidates than can wait. Some are lost then.
    pub fn entangled(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) > MAX_CANDIDATES
    }

    /// Discretizes the pair and counts the candidates that waited for it. On `Err`, two segments of the upper and
    /// the lower curve that are too close.
    pub fn finish_splines(&self, workspace: &mut Workspace) -> Result<(), [u32; 2]> {
        let Workspace {
            candidates,
            tally,
            halving,
            polylines,
            ..
        } = workspace;
        let tests = &mut candidates.found.all;
        if !candidates.close.is_empty() {
            self.separation.refine(&candidates.close, halving)?;
            tally.add_split(self, tests, &halving.splits, polylines);
        }
        tally.add_shared(self, tests);
        Ok(())
    }
}

/// Visits everything below the node pairs of the workspace's agenda. The sum of polylines is complete then; the
/// candidates of splines are waiting.
#[inline(always)]
pub(super) fn gather<L: Lanes>(simd: L, task: &Task<'_>, workspace: &mut Workspace) {
    let Scene { set, trees, .. } = task.scene;
    let both = task.curves.map(|i| trees.of(set, i));
    let splines = !set.basis().is_polyline();
    let query = Query {
        w: task.axis,
        meeting: splines,
        reach: 0.0,
    };
    let Workspace {
        agenda,
        candidates,
        tally,
        ..
    } = &mut *workspace;
    let Candidates { found, close } = candidates;
    for round in 0.. {
        if round >= ROUNDS && agenda.len() > 1 {
            return share(task, workspace);
        }
        let known = found.all.len();
        let limits = (STEPS, known + BATCH);
        tally.nodes += descend::<L, false>(simd, both, query, agenda, found, limits) as u64;
        if splines {
            // Splines wait for their final polylines.
            tally.stats.overlaps += found.meeting.len() as u64;
            task.separation.add_close(&found.meeting, close);
            found.meeting.clear();
            let new = found.all.len() - known;
            task.waiting.fetch_add(new, Ordering::Relaxed);
            if task.entangled() {
                agenda.clear();
            }
        } else {
            // Polylines are evaluated as they come, so the list stays short however many there are.
            tally.add(task, &found.all);
            found.all.clear();
        }
        if task.scene.cancelled() {
            agenda.clear();
        }
        if agenda.is_empty() {
            return;
        }
    }
}

/// Gathers in two halves.
#[cold]
#[inline(never)]
fn share(task: &Task<'_>, workspace: &mut Workspace) {
    let workspaces = task.scene.workspaces;
    let mut other = workspaces.take();
    other.tally = Tally::default();
    other.candidates.clear();
    other.agenda.clear();
    // Every second one: node pairs at the bottom have more below them.
    let mut mine = false;
    workspace.agenda.retain(|&pair| {
        mine = !mine;
        if !mine {
            other.agenda.push(pair);
        }
        mine
    });
    rayon::join(|| resume(task, workspace), || resume(task, &mut other));
    workspace.tally.merge(&other.tally);
    let (own, others) = (&mut workspace.candidates, &mut other.candidates);
    own.found.all.append(&mut others.found.all);
    own.close.append(&mut others.close);
    workspaces.put(other);
}

/// [`gather`] with the instructions that there are.
pub(super) fn resume(task: &Task<'_>, workspace: &mut Workspace) {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        #[expect(unsafe_code, reason = "vector instructions")]
        // SAFETY: the token says that the processor has them.
        return unsafe { resume_avx2(avx2, task, workspace) };
    }
    gather(Portable, task, workspace);
}

/// [`gather`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn resume_avx2(avx2: Avx2, task: &Task<'_>, workspace: &mut Workspace) {
    gather(avx2, task, workspace);
}
