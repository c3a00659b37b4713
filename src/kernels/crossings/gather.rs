//! From the node pairs to start with to the candidates of a pair, and for polylines straight on to their sum.
//!
//! A task that has much left to do halves what is left and shares it out. Where it does so depends on the scene
//! alone, and so does the result.

use super::evaluate::Tally;
use super::{Scene, Workspace};
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{BoxGroup, Lanes, Portable};
use crate::discretize::Separation;
use crate::pairs::{Node, Visitor, descend};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Candidates at which they are looked at.
const BATCH: usize = 4096;

/// Node pairs after which candidates are looked at, however few.
const STEPS: u32 = 4096;

/// Rounds of these after which a task shares out what is left: some tenths of a millisecond.
const ROUNDS: u32 = 3;

/// Candidates of one pair of splines at which it counts as too close: a tangle in which everything overlaps
/// everything would fill the memory.
const MAX_CANDIDATES: usize = 1 << 25;

/// Pairs of segments, upper curve first.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Whether those that meet are wanted.
    splines: bool,
    /// Overlap in projection, and the upper one is not wholly below: to be tested for a crossing.
    pub tests: Vec<(u32, u32)>,
    /// Those of them whose boxes overlap in space as well: they may be too close to discretize.
    meeting: Vec<(u32, u32)>,
    /// Those of them whose hulls are not known to be apart.
    pub close: Vec<(u32, u32)>,
    /// How many of the tests have been counted.
    counted: usize,
}

impl Found {
    pub fn clear(&mut self) {
        self.tests.clear();
        self.meeting.clear();
        self.close.clear();
        self.counted = 0;
    }
}

impl Visitor for Found {
    const IN_SPACE: bool = false;

    #[inline(always)]
    fn full(&self) -> bool {
        self.tests.len() - self.counted >= BATCH
    }

    #[inline(always)]
    fn visit<L: Lanes>(
        &mut self,
        simd: L,
        [t, u]: [Node; 2],
        [group_t, group_u]: [&BoxGroup; 2],
        w: usize,
        mut pairs: u64,
    ) {
        if self.splines {
            let top = simd.load(&group_u.hi[w]);
            let mut meeting = 0u64;
            for k in 0..8 {
                let above = simd.bits(simd.less(top, simd.splat(group_t.lo[w][k])));
                meeting |= u64::from(!above & 0xff) << (8 * k);
            }
            meeting &= pairs;
            while meeting != 0 {
                let bit = meeting.trailing_zeros();
                meeting &= meeting - 1;
                self.meeting.push((t.lane(bit / 8), u.lane(bit % 8)));
            }
        }
        while pairs != 0 {
            let bit = pairs.trailing_zeros();
            pairs &= pairs - 1;
            self.tests.push((t.lane(bit / 8), u.lane(bit % 8)));
        }
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
            found,
            tally,
            halving,
            polylines,
            ..
        } = workspace;
        if found.close.is_empty() {
            tally.add_shared(self, &found.tests);
            return Ok(());
        }
        self.separation.refine(&found.close, halving)?;
        tally.add_split(self, &mut found.tests, &halving.splits, polylines);
        Ok(())
    }
}

/// Visits everything below the node pairs on the workspace's stack. The sum of polylines is complete then; the
/// candidates of splines are in `found`.
#[inline(always)]
pub(super) fn gather<L: Lanes>(simd: L, task: &Task<'_>, workspace: &mut Workspace) {
    let Scene { set, trees, .. } = task.scene;
    let both = task.curves.map(|i| trees.of(set, i));
    let splines = !set.basis().is_polyline();
    let Workspace {
        stack,
        found,
        tally,
        ..
    } = &mut *workspace;
    found.splines = splines;
    for round in 0.. {
        if round >= ROUNDS && stack.len() > 1 {
            return share(task, workspace);
        }
        descend(simd, both, task.axis, stack, found, STEPS);
        if splines {
            // Splines wait for their final polylines.
            tally.stats.overlaps += found.meeting.len() as u64;
            task.separation.add_close(&found.meeting, &mut found.close);
            found.meeting.clear();
            let new = found.tests.len() - found.counted;
            found.counted = found.tests.len();
            task.waiting.fetch_add(new, Ordering::Relaxed);
            if task.entangled() {
                stack.clear();
            }
        } else {
            // Polylines are evaluated as they come, so the list stays short however many there are.
            tally.add(task, &found.tests);
            found.tests.clear();
        }
        if stack.is_empty() {
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
    other.found.clear();
    other.stack.clear();
    // Every second one: node pairs at the bottom have more below them.
    let mut k = 0;
    workspace.stack.retain(|&pair| {
        k += 1;
        if k % 2 == 0 {
            other.stack.push(pair);
        }
        k % 2 == 1
    });
    rayon::join(|| resume(task, workspace), || resume(task, &mut other));
    workspace.tally.merge(&other.tally);
    workspace.found.tests.append(&mut other.found.tests);
    workspace.found.close.append(&mut other.found.close);
    workspaces.put(other);
}

/// [`gather`] with the instructions that there are.
fn resume(task: &Task<'_>, workspace: &mut Workspace) {
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
#[target_feature(enable = "avx2")]
fn resume_avx2(avx2: Avx2, task: &Task<'_>, workspace: &mut Workspace) {
    gather(avx2, task, workspace);
}
