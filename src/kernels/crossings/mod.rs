//! Linking numbers by counting crossings, exactly, on the input floats.
//!
//! Source: Qu & James 2021, section 3.4.1 (count crossings), with these changes: projection along a coordinate
//! axis instead of a rotated frame, so that exact predicates apply to the input itself and degenerate views
//! are decided by a proven rule ([`crate::exact`]) instead of a retry; only crossings where the first loop is
//! on top are counted, so no factor 1/2 and everything wholly below is culled in space; the best of six
//! directions for every pair ([`direction`]); trees over both loops ([`gather`]).
//!
//! Cost: near-linear in segments and crossings for curves that are spatially coherent. Beaten by summation
//! where crossings in every direction are far more than segments.
//! Requires: closed curves, finite coordinates (both are invariants of [`CurveSet`] and of the pair list).
//! Undefined: curves that touch, that are too close to discretize, or that have fewer than three distinct
//! vertices.

mod direction;
mod evaluate;
mod gather;
#[cfg(feature = "gpu")]
mod remainder;
mod sample;
#[cfg(test)]
mod spline_tests;
#[cfg(test)]
mod tests;

pub(crate) use self::direction::by_formula;
use self::evaluate::Tally;
pub(crate) use self::gather::shares_out;
#[cfg(feature = "gpu")]
pub(crate) use self::remainder::conclude;
pub(crate) use self::sample::sample;
use super::Linking;
use crate::cancel::Cancel;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{CurveSet, Lanes, Portable};
use crate::discretize::Halving;
use crate::pairs::{Agenda, Pair, Trees, closest_approach, closest_of_segments};
use crate::verdict::{DefectKind, Stats};
use std::sync::{Mutex, PoisonError};

/// A direction of projection: an axis, and which of the two curves is counted when on top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Direction {
    /// Axis of projection; up is its positive end.
    pub axis: usize,
    /// Whether the second curve of the pair is the one on top.
    pub second_over: bool,
}

impl Direction {
    /// All six, in the order of their bits in masks.
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

    /// What belongs to the upper curve first.
    pub fn upper_first<T>(self, first: T, second: T) -> (T, T) {
        if self.second_over {
            (second, first)
        } else {
            (first, second)
        }
    }
}

/// What a pair is computed from: curves and their trees, of one frame.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub set: &'a CurveSet,
    pub trees: &'a Trees,
    pub workspaces: &'a Workspaces,
}

impl Scene<'_> {
    /// Returns true if the work was cancelled. Numbers that are computed from then on are wrong.
    #[inline(always)]
    pub fn cancelled(&self) -> bool {
        self.workspaces.cancel.as_ref().is_some_and(Cancel::is_set)
    }
}

/// Buffers that wait for a task. They serve every pair of every frame.
#[derive(Debug, Default)]
pub(crate) struct Workspaces {
    idle: Mutex<Idle>,
    /// Flag that ends the work of all tasks early.
    pub cancel: Option<Cancel>,
}

/// Boxed: they come and go with every task, and a pointer moves faster than all buffers.
type Idle = Vec<Box<Workspace>>;

impl Workspaces {
    /// Buffers, which the caller gives back.
    pub fn take(&self) -> Box<Workspace> {
        self.lock().pop().unwrap_or_default()
    }

    /// Gives buffers back.
    pub fn put(&self, workspace: Box<Workspace>) {
        self.lock().push(workspace);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Idle> {
        // A task that panicked holds no lock: the list is whole.
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
    tally: Tally,
    halving: Halving,
    polylines: evaluate::Polylines,
    sampling: sample::Buffers,
    /// Work done since the caller last took it.
    pub stats: Stats,
}

impl Workspace {
    /// Takes the counts of the work done so far.
    pub fn take_stats(&mut self) -> Stats {
        std::mem::take(&mut self.stats)
    }
}

/// Linking number of the curves `i` and `j`; `fixed` leaves no choice of the direction.
pub(crate) fn linking_number(
    scene: Scene<'_>,
    pair: Pair,
    fixed: Option<Direction>,
    workspace: &mut Workspace,
) -> Linking {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        #[expect(unsafe_code, reason = "vector instructions")]
        // SAFETY: the token says that the processor has them.
        return unsafe { with_avx2(avx2, scene, pair, fixed, workspace) };
    }
    compute(Portable, scene, pair, fixed, workspace)
}

/// [`compute`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn with_avx2(
    avx2: Avx2,
    scene: Scene<'_>,
    pair: Pair,
    fixed: Option<Direction>,
    workspace: &mut Workspace,
) -> Linking {
    compute(avx2, scene, pair, fixed, workspace)
}

#[inline(always)]
fn compute<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    (i, j): Pair,
    fixed: Option<Direction>,
    workspace: &mut Workspace,
) -> Linking {
    workspace.stats.potential_links += 1;
    let [i, j] = [i as usize, j as usize];
    let Scene { set, trees, .. } = scene;
    let both = [trees.of(set, i), trees.of(set, j)];
    let Workspace { fronts, agenda, .. } = workspace;
    let Some(direction) = direction::choose(simd, both, fixed, fronts, agenda) else {
        workspace.stats.separated += 1;
        return Linking::Number(0);
    };
    let (upper, lower) = direction.upper_first(i, j);
    let task = gather::Task::new(scene, [upper, lower], direction.axis);
    workspace.tally = Tally::default();
    workspace.candidates.clear();
    gather::gather(simd, &task, workspace);
    let entangled = task.entangled();
    let mut too_close = None;
    if !set.basis().is_polyline() && !entangled {
        too_close = task.finish_splines(workspace).err();
    }
    let tally = &workspace.tally;
    workspace.stats.add(&tally.stats);
    let undefined = |kind, [s, t]: [u32; 2]| {
        let (s, t) = direction.upper_first(s, t);
        Linking::Undefined(kind, closest_of_segments(set, [i, j], [s, t]))
    };
    match (too_close, tally.contact()) {
        _ if entangled => {
            Linking::Undefined(DefectKind::TooClose, closest_approach(set, trees, i, j))
        }
        (Some(segments), _) => undefined(DefectKind::TooClose, segments),
        (None, Some(segments)) => undefined(DefectKind::Contact, segments),
        (None, None) => Linking::Number(tally.sum()),
    }
}
