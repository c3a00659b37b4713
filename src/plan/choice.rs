//! Which potential links are worth a sum: those of two long curves that cross each other very often in every view.
//!
//! Counting takes as long as there are crossings, which may be as many as the product of the strands; the fast
//! multipole method takes as long as there are segments. So it wins where thousands of strands pass thousands of others at a
//! distance, as on two wound balls, and nowhere else.

use super::costs::{self, Time};
use crate::kernels::KernelWork;
use crate::kernels::crossings::{Scene, sample};
use crate::pairs::Pair;
use rayon::prelude::*;

/// A potential link that is worth a sum.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LongLink {
    /// Its place in the list.
    pub at: usize,
    /// What counting is predicted to take on one thread.
    pub counting: Time,
    /// What the sum is.
    pub summing: Time,
}

/// Segments of two curves below which nobody asks: however they cross, counting does not take long.
const LONG: u32 = 50_000;

/// Counting that is not worth a tree, in milliseconds of one thread.
const SHORT_MS: f64 = 500.0;

/// Links that are not shared out.
const FEW: usize = 64;

/// How much shorter the sum must be, since predictions are off by some.
const SHORTER: f64 = 2.5;

/// The potential links of polylines that the fast multipole method is predicted to decide sooner than counting.
///
/// Cost: nothing for links of short curves; some tenths of a millisecond for each of the others ([`sample`]).
pub(crate) fn worth_summing(scene: Scene<'_>, links: &[Pair]) -> Vec<LongLink> {
    let segments = |i: u32| scene.set.curve(i as usize).segments;
    let mut all = 0..scene.set.len() as u32;
    if !scene.set.basis().is_polyline() || all.all(|i| segments(i) < LONG / 2) {
        return Vec::new();
    }
    let look = |at: usize| {
        let (i, j) = links[at];
        let segments = segments(i).saturating_add(segments(j));
        if segments < LONG {
            return None;
        }
        let mut workspace = scene.workspaces.take();
        let work = sample(scene, (i, j), &mut workspace);
        workspace.take_stats();
        scene.workspaces.put(workspace);
        decide(at, segments, work)
    };
    match links.len() {
        // Sharing out takes memory, and a frame like the one before should take none.
        few @ ..FEW => (0..few).filter_map(look).collect(),
        many => (0..many).into_par_iter().filter_map(look).collect(),
    }
}

fn decide(at: usize, segments: u32, work: KernelWork) -> Option<LongLink> {
    let segments = segments as usize;
    // Boxes are of 2 bytes a segment and more; what is long enough to ask fits into no cache.
    let counting = costs::crossings(0, work, usize::MAX);
    let summing = costs::multipole(segments);
    let worth = counting.ms() > SHORT_MS.max(SHORTER * summing.ms());
    worth.then_some(LongLink {
        at,
        counting,
        summing,
    })
}
