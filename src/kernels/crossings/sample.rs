//! What a pair costs, found out on a part of it.

use super::{Scene, Workspace, direction, gather};
use crate::curve::Portable;
use crate::kernels::Work;
use crate::pairs::Pair;
use crate::verdict::Stats;

/// Node pairs that are looked below, of those at which the choice of the direction ended.
const BRANCHES: usize = 64;

/// The work that the linking number of a pair takes, extrapolated from [`BRANCHES`] node pairs that lie evenly among
/// those below which the crossings are. Where there are no more of them, it is the work itself.
///
/// Cost: the choice of the direction, and the part of the pair that is below the sample.
pub(crate) fn sample(scene: Scene<'_>, (i, j): Pair, workspace: &mut Workspace) -> Work {
    let [i, j] = [i as usize, j as usize];
    let both = [i, j].map(|i| scene.trees.of(scene.set, i));
    let Workspace { fronts, agenda, .. } = &mut *workspace;
    fronts.visited = 0;
    let chosen = direction::choose(Portable, both, None, fronts, agenda);
    let choice = Work {
        front: fronts.visited,
        ..Work::default()
    };
    let Some(direction) = chosen else {
        return choice;
    };
    let branches = agenda.len();
    if branches > BRANCHES {
        for k in 0..BRANCHES {
            agenda[k] = agenda[k * branches / BRANCHES];
        }
        agenda.truncate(BRANCHES);
    }
    let factor = branches as f64 / agenda.len().max(1) as f64;
    let (upper, lower) = direction.upper_first(i, j);
    let task = gather::Task::new(scene, [upper, lower], direction.axis);
    workspace.tally = super::Tally::default();
    workspace.candidates.clear();
    gather::resume(&task, workspace);
    if !scene.set.basis().is_polyline() && !task.entangled() {
        // Where it is too close, the pair takes the same time to say so.
        task.finish_splines(workspace).ok();
    }
    let nodes = workspace.tally.nodes;
    let Stats {
        tests,
        overlaps,
        refined,
        exact,
        ..
    } = workspace.tally.stats();
    let below = Work {
        front: 0,
        nodes,
        tests,
        overlaps,
        refined,
        exact,
    };
    choice + below.scaled(factor)
}
