//! Potential links of a frame, split among threads.

use super::{Input, linking_number};
use crate::kernels::Counted;
use crate::pairs::Pair;
use crate::pool::pairs_per_task;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of pairs by which prefetching is ahead.
const AHEAD: usize = 4;

/// Computes the linking numbers of pairs, one part for each task, in the order of the pairs. Later
/// parts are empty; the buffers of all parts are reused. Adds the computed pairs of each finished
/// task to `done`: not those that a cancellation skips.
pub(crate) fn linking_numbers(
    input: Input<'_>,
    pairs: &[Pair],
    parts: &mut Vec<Counted>,
    done: &AtomicU64,
) {
    let size = pairs_per_task(pairs.len(), input.set.segments());
    let count = pairs.len().div_ceil(size);
    parts.resize_with(count.max(parts.len()), Counted::default);
    parts.par_iter_mut().enumerate().for_each(|(k, part)| {
        part.clear();
        if k >= count {
            return;
        }
        let pairs = &pairs[k * size..pairs.len().min((k + 1) * size)];
        let mut computed = 0;
        ((), part.stats) = input.workspaces.run(|workspace| {
            for (k, &pair) in pairs.iter().enumerate() {
                if let Some(&(i, j)) = pairs.get(k + AHEAD) {
                    input.trees.prefetch(i as usize);
                    input.trees.prefetch(j as usize);
                }
                if input.cancelled() {
                    break;
                }
                computed += 1;
                part.add(pair, linking_number(input, pair, None, workspace));
            }
        });
        done.fetch_add(computed, Ordering::Relaxed);
    });
}

/// Returns the number of threads that the linking numbers of a frame keep busy. `shared` is true if
/// a link has enough work for several threads ([`super::shares_out`]). `segments` is the number of
/// segments of the frame.
pub(crate) fn busy_threads(links: usize, segments: usize, shared: bool) -> usize {
    let threads = rayon::current_num_threads();
    let tasks = links.div_ceil(pairs_per_task(links, segments));
    match tasks > 0 && shared {
        true => threads,
        false => threads.min(tasks),
    }
}
