//! Estimate of the work of a pair, from a sample.

use super::{Input, SignedCount, Workspace, direction, gather};
use crate::kernels::KernelWork;
use crate::pairs::{Agenda, Node, Pair, Query, SegmentPairs, descend};
use crate::simd::Portable;
/// Buffers of a sample.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    found: SegmentPairs,
    below: Agenda,
    one: Agenda,
}

/// Maximum number of node pairs visited in a level.
const BRANCHES: usize = 256;

/// Estimates the work that the linking number of a pair takes, level by level: if more than
/// [`BRANCHES`] node pairs remain in a level, an evenly spaced sample of [`BRANCHES`] of them
/// represents all. If there are never more, the result is exact.
///
/// Cost: the choice of the direction; some thousand node pairs, however long the curves are; and
/// the tests below the last node pairs.
pub(crate) fn sample(input: Input<'_>, (i, j): Pair, workspace: &mut Workspace) -> KernelWork {
    let [i, j] = [i as usize, j as usize];
    let both = [i, j].map(|i| input.trees.of(input.set, i));
    let (fronts, agenda) = (&mut workspace.fronts, &mut workspace.agenda);
    fronts.visited = 0;
    let chosen = direction::choose(Portable, both, None, fronts, agenda);
    let choice = KernelWork {
        front: fronts.visited,
        ..KernelWork::default()
    };
    let Some(direction) = chosen else {
        return choice;
    };
    let (upper, lower) = direction.upper_first(i, j);
    let task = gather::Task::new(input, [upper, lower], direction.axis);
    let query = Query {
        w: task.axis,
        meeting: false,
        reach: 0.0,
    };
    let both = task.curves.map(|i| input.trees.of(input.set, i));
    let Buffers { found, below, one } = &mut workspace.sampling;
    let (mut factor, mut nodes) = (1.0, 0.0);
    // All first nodes are of one level, and so are all second nodes.
    loop {
        factor *= thin(agenda);
        let at_leaves = |(t, u): &(Node, Node)| t.level.max(u.level) == 0;
        if agenda.first().is_none_or(at_leaves) {
            break;
        }
        nodes += factor * agenda.len() as f64;
        for pair in agenda.drain(..) {
            one.push(pair);
            descend::<_, _, false>(Portable, both, query, one, found, (1, usize::MAX));
            below.append(one);
        }
        std::mem::swap(agenda, below);
    }
    found.all.clear();
    found.meeting.clear();
    workspace.count = SignedCount::default();
    workspace.candidates.clear();
    gather::resume(&task, workspace);
    if !input.set.basis().is_polyline() {
        // A pair that is too close takes the same time until it is rejected.
        task.finish_splines(workspace).ok();
    }
    let visited = workspace.count.nodes;
    let (stored, computed) = match both.iter().all(|tree| tree.stores_leaves()) {
        true => (visited, 0),
        false => (0, visited),
    };
    let stats = workspace.count.stats;
    let leaves = KernelWork {
        front: 0,
        nodes: stored,
        computed,
        tests: stats.tests,
        overlaps: stats.overlaps,
        refined: stats.refined,
        exact: stats.exact,
    };
    let inner = KernelWork {
        nodes: nodes.round() as u64,
        ..KernelWork::default()
    };
    choice + inner + leaves.scaled(factor)
}

/// Keeps [`BRANCHES`] evenly spaced node pairs. Returns the number of node pairs that each of them
/// represents.
fn thin(agenda: &mut Agenda) -> f64 {
    let all = agenda.len();
    if all <= BRANCHES {
        return 1.0;
    }
    for k in 0..BRANCHES {
        agenda[k] = agenda[k * all / BRANCHES];
    }
    agenda.truncate(BRANCHES);
    all as f64 / BRANCHES as f64
}
