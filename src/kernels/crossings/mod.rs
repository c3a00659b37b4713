//! Linking numbers by counting crossings, exactly, on the input floats.
//!
//! # Method
//!
//! Source: Qu & James 2021, section 3.4.1 (count crossings), with these changes:
//!
//! * The projection is along a coordinate axis instead of a rotated frame. So exact predicates
//!   apply to the input itself, and degenerate projections are decided by a proven rule
//!   ([`crate::exact`]) instead of a retry.
//! * Only crossings where the first curve is above are counted. So there is no factor 1/2, and
//!   everything wholly below is culled in space.
//! * The best of six directions is chosen for every pair ([`direction`]).
//! * Both curves have trees ([`gather`]).
//!
//! # Cost and limits
//!
//! Cost: near-linear in segments and crossings for curves that are spatially coherent. Summation is
//! faster if the crossings in every direction are far more than the segments.
//!
//! Requires: closed curves, finite coordinates (both are invariants of [`CurveSet`] and of the pair
//! list).
//!
//! Undefined: curves that touch, that are too close to discretize, or that have fewer than three
//! distinct vertices.

mod direction;
mod evaluate;
mod gather;
#[cfg(feature = "gpu")]
mod remainder;
mod sample;
#[cfg(test)]
mod spline_tests;
mod tasks;
#[cfg(test)]
mod tests;

pub(crate) use self::direction::by_formula;
use self::evaluate::SignedCount;
pub(crate) use self::gather::shares_out;
#[cfg(feature = "gpu")]
pub(crate) use self::remainder::conclude;
pub(crate) use self::sample::sample;
pub(crate) use self::tasks::{busy_threads, linking_numbers};
use super::Linking;
use crate::cancel::Cancel;
use crate::curve::{CurveSet, Point};
use crate::discretize::Halving;
use crate::pairs::{Agenda, Pair, Trees, closest_approach, closest_of_segments};
use crate::simd::{Lanes, dispatch_wide};
use crate::verdict::{DefectKind, Stats};
use std::sync::{Mutex, PoisonError};

/// A direction of projection: an axis, and the curve whose crossings above the other one are
/// counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Direction {
    /// Axis of projection; up is its positive end.
    pub axis: usize,
    /// True if the second curve of the pair is the upper one.
    pub second_over: bool,
}

impl Direction {
    /// All six directions, in the order of their bits in masks.
    pub const ALL: [Direction; 6] = [
        Direction::new(0, false),
        Direction::new(0, true),
        Direction::new(1, false),
        Direction::new(1, true),
        Direction::new(2, false),
        Direction::new(2, true),
    ];

    const fn new(axis: usize, second_over: bool) -> Self {
        Direction { axis, second_over }
    }

    /// Returns both arguments in the order upper curve, lower curve.
    pub fn upper_first<T>(self, first: T, second: T) -> (T, T) {
        if self.second_over {
            (second, first)
        } else {
            (first, second)
        }
    }
}

/// Input of the crossing kernel: the curves of a frame, their trees, and the buffers of tasks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Input<'a> {
    pub set: &'a CurveSet,
    pub trees: &'a Trees,
    pub workspaces: &'a Workspaces,
}

impl Input<'_> {
    /// Returns true if the work was cancelled. Numbers that are computed from then on are wrong.
    #[inline(always)]
    pub fn cancelled(&self) -> bool {
        self.workspaces.cancel.as_ref().is_some_and(Cancel::is_set)
    }
}

/// Pool of task buffers, reused for every pair of every frame.
#[derive(Debug, Default)]
pub(crate) struct Workspaces {
    idle: Mutex<Idle>,
    /// Flag that cancels all tasks.
    pub cancel: Option<Cancel>,
}

/// Boxed, because the buffers are moved with every task, and moving a pointer is cheaper.
type Idle = Vec<Box<Workspace>>;

impl Workspaces {
    /// Runs a task with buffers of the pool. Returns its result and its work.
    pub fn run<T>(&self, task: impl FnOnce(&mut Workspace) -> T) -> (T, Stats) {
        let mut workspace = self.take();
        let result = task(&mut workspace);
        let stats = workspace.take_stats();
        self.put(workspace);
        (result, stats)
    }

    /// Takes buffers from the pool. The caller returns them by [`Workspaces::put`].
    pub fn take(&self) -> Box<Workspace> {
        self.lock().pop().unwrap_or_default()
    }

    /// Returns buffers to the pool.
    fn put(&self, workspace: Box<Workspace>) {
        self.lock().push(workspace);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Idle> {
        // No task panics while it holds the lock, so the list is consistent.
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Buffers of one task.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    fronts: direction::Fronts,
    /// Node pairs to visit, upper curve first.
    agenda: Agenda,
    candidates: gather::Candidates,
    count: SignedCount,
    halving: Halving,
    /// Polylines that replace two split segments.
    polylines: [Vec<Point>; 2],
    sampling: sample::Buffers,
    /// Work since the last call of [`Workspace::take_stats`].
    pub stats: Stats,
}

impl Workspace {
    /// Returns the work counters and resets them.
    pub fn take_stats(&mut self) -> Stats {
        std::mem::take(&mut self.stats)
    }
}

/// Returns the linking number of a pair of curves, counted in the direction `fixed`, or else in the
/// best direction.
pub(crate) fn linking_number(
    input: Input<'_>,
    pair: Pair,
    fixed: Option<Direction>,
    workspace: &mut Workspace,
) -> Linking {
    dispatch_wide!(simd => compute(simd, input, pair, fixed, workspace))
}

#[inline(always)]
fn compute<L: Lanes>(
    simd: L,
    input: Input<'_>,
    (i, j): Pair,
    fixed: Option<Direction>,
    workspace: &mut Workspace,
) -> Linking {
    workspace.stats.potential_links += 1;
    let [i, j] = [i as usize, j as usize];
    let Input { set, trees, .. } = input;
    let both = [trees.of(set, i), trees.of(set, j)];
    let Workspace { fronts, agenda, .. } = workspace;
    let Some(direction) = direction::choose(simd, both, fixed, fronts, agenda) else {
        workspace.stats.separated += 1;
        return Linking::Number(0);
    };
    let (upper, lower) = direction.upper_first(i, j);
    let task = gather::Task::new(input, [upper, lower], direction.axis);
    workspace.count = SignedCount::default();
    workspace.candidates.clear();
    gather::gather(simd, &task, workspace);
    let entangled = task.entangled();
    let mut too_close = None;
    if !set.basis().is_polyline() && !entangled {
        too_close = task.finish_splines(workspace).err();
    }
    let count = &workspace.count;
    workspace.stats.add(&count.stats);
    let undefined = |kind, [s, t]: [u32; 2]| {
        let (s, t) = direction.upper_first(s, t);
        Linking::Undefined(kind, closest_of_segments(set, [i, j], [s, t]))
    };
    match (too_close, count.contact) {
        _ if entangled => {
            Linking::Undefined(DefectKind::TooClose, closest_approach(set, trees, i, j))
        }
        (Some(segments), _) => undefined(DefectKind::TooClose, segments),
        (None, Some(segments)) => undefined(DefectKind::Contact, segments),
        (None, None) => Linking::Number(count.sum),
    }
}
