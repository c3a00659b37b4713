//! Exact decision of the tests that the GPU leaves undecided.

use super::evaluate::SignedCount;
use super::gather::Task;
use super::{Direction, Input, Workspace, linking_number};
use crate::kernels::Linking;
use crate::pairs::Pair;

/// Returns the linking number of a pair of polylines, from the sum of the decided signs and from
/// the undecided tests: segments of the upper and of the lower curve. Pairs of segments that touch
/// must be among these tests.
pub(crate) fn conclude(
    input: Input<'_>,
    (i, j): Pair,
    direction: Direction,
    sum: i64,
    tests: &[(u32, u32)],
    workspace: &mut Workspace,
) -> Linking {
    let (upper, lower) = direction.upper_first(i as usize, j as usize);
    let task = Task::new(input, [upper, lower], direction.axis);
    let mut count = SignedCount::default();
    count.add_shared(&task, tests);
    if count.contact.is_some() {
        // The reported place must not depend on the kernel, so the contact is searched again in the
        // direction that the CPU chooses.
        let before = workspace.stats;
        let linking = linking_number(input, (i, j), None, workspace);
        workspace.stats = before;
        workspace.stats.add(&count.stats);
        return linking;
    }
    workspace.stats.add(&count.stats);
    Linking::Number(sum + count.sum)
}
