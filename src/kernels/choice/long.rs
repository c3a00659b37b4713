//! Potential links for which the fast multipole method is faster than counting.
//!
//! A sum is faster than counting only for two long curves that cross each other very often in every
//! view. The time of counting grows with the number of crossings, which may be as large as the
//! product of the numbers of strands. The time of the fast multipole method grows with the number
//! of segments. So it is faster if thousands of strands pass thousands of others at a distance, as
//! on two wound balls.

use super::costs::{self, MS, Nanoseconds};
use crate::kernels::crossings::{Input, sample};
use crate::pairs::Pair;
use rayon::prelude::*;

/// Returns the time of counting with long links summed instead of counted.
pub(crate) fn with_sums(counting: Nanoseconds, long: &[LongLink]) -> Nanoseconds {
    let sum = |time: Nanoseconds, link: &LongLink| (time - link.counting).max(0.0) + link.summing;
    long.iter().fold(counting, sum)
}

/// A potential link that is predicted to be summed faster than counted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LongLink {
    /// Index in the list of links.
    pub at: usize,
    /// Predicted time of counting on one thread.
    pub counting: Nanoseconds,
    /// Predicted time of the sum on one thread.
    pub summing: Nanoseconds,
}

/// Minimum number of segments of two curves: below that, counting is fast however they cross.
const LONG: u32 = 50_000;

/// Time of counting, in milliseconds of one thread, below which no sum is tried.
const SHORT_MS: f64 = 500.0;

/// Number of links below which they are not split among threads.
const PARALLEL_LINKS: usize = 64;

/// Factor by which the sum must be faster, because of the errors of the predictions.
const SHORTER: f64 = 2.5;

/// Returns the potential links of polylines that the fast multipole method is predicted to decide
/// sooner than counting.
///
/// Cost: nothing for links of short curves; some tenths of a millisecond for each of the others
/// ([`sample`]).
pub(super) fn worth_summing(input: Input<'_>, links: &[Pair]) -> Vec<LongLink> {
    let segments = |i: u32| input.set.curve(i as usize).segments;
    let mut all = 0..input.set.len() as u32;
    if !input.set.basis().is_polyline() || all.all(|i| segments(i) < LONG / 2) {
        return Vec::new();
    }
    let long = |at: usize| {
        let (i, j) = links[at];
        let segments = segments(i).saturating_add(segments(j));
        if segments < LONG {
            return None;
        }
        let run = |workspace: &mut _| sample(input, (i, j), workspace);
        // Boxes take at least 2 bytes per segment, so curves of this length exceed every cache.
        let counting = costs::crossings(0, input.workspaces.run(run).0, usize::MAX);
        let summing = costs::multipole(segments as usize);
        let worth = counting * MS > SHORT_MS.max(SHORTER * (summing * MS));
        worth.then_some(LongLink {
            at,
            counting,
            summing,
        })
    };
    match links.len() {
        // A parallel iterator allocates, and a frame like the previous one should allocate nothing.
        few @ ..PARALLEL_LINKS => (0..few).filter_map(long).collect(),
        many => (0..many).into_par_iter().filter_map(long).collect(),
    }
}
