//! What others have left to decide of a pair: those who count what they can tell for certain.

use super::evaluate::Tally;
use super::gather::Task;
use super::{Direction, Scene, Workspace, linking_number};
use crate::kernels::Linking;
use crate::pairs::Pair;

/// The linking number of a pair of polylines, from the sum of the signs that are certain and from what is left: segments of
/// the upper and of the lower curve. Segments that touch have to be among these.
pub(crate) fn conclude(
    scene: Scene<'_>,
    (i, j): Pair,
    direction: Direction,
    sum: i64,
    tests: &[(u32, u32)],
    workspace: &mut Workspace,
) -> Linking {
    let (upper, lower) = direction.upper_first(i as usize, j as usize);
    let task = Task::new(scene, [upper, lower], direction.axis);
    let mut tally = Tally::default();
    tally.add_shared(&task, tests);
    if tally.contact().is_some() {
        // Where it is said to be does not depend on who counted: the first one in a direction of our own choice.
        let before = workspace.stats;
        let linking = linking_number(scene, (i, j), None, workspace);
        workspace.stats = before;
        workspace.stats.add(&tally.stats);
        return linking;
    }
    workspace.stats.add(&tally.stats);
    Linking::Number(sum + tally.sum())
}
