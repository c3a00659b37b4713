//! Counters of the lists that shaders write, and of the items that they process. All kernels share
//! one layout: the node pairs of each level come first, the named counters last.

use super::commands::{Binding, Buffer};
use super::layout::named;

/// Number of counters.
pub(super) const COUNTS: u32 = 64;

/// Counter of tests that single precision does not decide.
pub(super) const OPEN_TESTS: u32 = 56;
/// Counter of the pairs of curves that do not overlap in some direction, and so are not linked.
pub(super) const SEPARATED: u32 = 57;
/// Counter of tests: low half; the high half follows.
pub(super) const TESTS: u32 = 58;
/// Counter of crossings: low half; the high half follows.
pub(super) const CROSSINGS: u32 = 60;
/// Counter of processed items of all lists: pairs of curves, node pairs and tiles.
pub(super) const DONE: u32 = 62;
/// Counter of tiles.
pub(super) const TILES: u32 = 63;

/// Maximum number of levels of a kernel that uses no counter below [`DONE`]. The level after the
/// last one has a counter, too.
pub(super) const MOST_LEVELS: u32 = DONE - 1;

/// A list counter that has reached this value is not incremented any more. The value is above every
/// capacity, and threads that have read a smaller value just before add less than would make the
/// counter wrap to 0.
pub(super) const TOO_MANY: u32 = 1 << 31;

/// Names of the counters in shaders.
pub(super) const NAMES: [(&str, u32); 8] = named![
    COUNTS, OPEN_TESTS, SEPARATED, TESTS, CROSSINGS, DONE, TILES, TOO_MANY
];

/// Returns the binding of the counters of a kernel.
pub(super) const fn binding(kernel: &'static str) -> Binding {
    Binding::whole(Buffer("counts", kernel), 4 * COUNTS as u64)
}

/// Returns the value of a counter of 32 bits.
pub(super) fn get(counts: &[u32], counter: u32) -> u32 {
    counts[counter as usize]
}

/// Returns the value of a counter of 64 bits.
pub(super) fn get_wide(counts: &[u32], counter: u32) -> u64 {
    u64::from(get(counts, counter + 1)) << 32 | u64::from(get(counts, counter))
}
