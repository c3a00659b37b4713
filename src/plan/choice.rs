//! Which way linking numbers are computed soonest: by counting, here or on an adapter, or by sums first.
//!
//! An adapter that was measured ([`Calibration`]) gets the crossings of a frame where it is predicted to take less than the
//! processor does in its best way; one that was asked for gets all it can do.
//!
//! Worth a sum are the potential links of two long curves that cross each other very often in every view. Counting takes as
//! long as there are crossings, which may be as many as the product of the strands; the fast multipole method takes as long as
//! there are segments. So it wins where thousands of strands pass thousands of others at a distance, as on two wound balls,
//! and nowhere else.

use super::costs::{self, Time};
use super::{Sample, parallelism};
use crate::kernels::crossings::{Scene, sample};
use crate::kernels::{Calibration, CountingWork, KernelWork, Method, Offer, segment_pairs};
use crate::pairs::Pair;
use rayon::prelude::*;

/// The way of a frame's linking numbers.
#[derive(Clone, Debug)]
pub(crate) enum Way {
    /// Crossings are counted.
    Count {
        /// On the adapter that was offered.
        on_adapter: bool,
    },
    /// The fast multipole method goes first on these; crossings are counted on the others, and where it decides nothing.
    Fmm(Vec<LongLink>),
}

impl Way {
    /// The way of some potential links, by counting or ([`Method::Auto`]) by what takes least.
    pub fn of(scene: Scene<'_>, links: &[Pair], method: Method, offer: Option<Offer<'_>>) -> Way {
        let asked_for = offer.is_some_and(|o| o.asked_for && counts(scene));
        let long = match method {
            Method::Auto if !asked_for => worth_summing(scene, links),
            _ => Vec::new(),
        };
        match adapter_wins(scene, links, &long, offer) {
            false if !long.is_empty() => Way::Fmm(long),
            on_adapter => Way::Count { on_adapter },
        }
    }
}

/// Whether an adapter counts the crossings of some potential links.
pub(crate) fn goes_to_adapter(scene: Scene<'_>, links: &[Pair], offer: Option<Offer<'_>>) -> bool {
    adapter_wins(scene, links, &[], offer)
}

/// Whether adapters count the crossings of such curves.
fn counts(scene: Scene<'_>) -> bool {
    scene.set.basis().is_polyline()
}

/// The same, where the processor would sum the long ones.
///
/// Cost: a look at the links; where that does not rule the adapter out, a sample of them ([`Sample`]).
fn adapter_wins(
    scene: Scene<'_>,
    links: &[Pair],
    long: &[LongLink],
    offer: Option<Offer<'_>>,
) -> bool {
    let Some(offer) = offer.filter(|_| counts(scene) && !links.is_empty()) else {
        return false;
    };
    match offer.calibration {
        _ if offer.asked_for => true,
        Some(calibration) if !hopeless(scene, links, calibration) => {
            let sample = Sample::of(scene, links);
            Forecast::of(scene, links, long, &sample, calibration).adapter_wins()
        }
        _ => false,
    }
}

/// Whether an adapter takes longer for no tests at all than the processor for all there can be, shared out badly.
fn hopeless(scene: Scene<'_>, links: &[Pair], calibration: &Calibration) -> bool {
    let cost = calibration.crossings;
    let tests = segment_pairs(scene.set, links);
    let most = KernelWork {
        tests,
        exact: tests,
        computed: 2 * tests,
        front: 2 * tests,
        ..KernelWork::default()
    };
    let most = costs::direction(links.len(), most) + costs::crossings(0, most, usize::MAX);
    let least = cost.adapter_ms(counting_work(scene, links, 0));
    cost.processor_factor * most.ms() <= least
}

fn counting_work(scene: Scene<'_>, links: &[Pair], tests: u64) -> CountingWork {
    CountingWork {
        segments: scene.set.segments() as u64,
        links: links.len() as u64,
        tests,
    }
}

/// What linking numbers are predicted to take, directions included, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forecast {
    /// Counting all of them on the adapter.
    pub adapter_ms: f64,
    /// By what factor that is off, typically.
    pub misfit: f64,
    /// The best way of the processor.
    pub processor_ms: f64,
}

impl Forecast {
    /// By what a sample of the links says, and where the processor would sum the long ones.
    pub fn of(
        scene: Scene<'_>,
        links: &[Pair],
        long: &[LongLink],
        sample: &Sample,
        calibration: &Calibration,
    ) -> Forecast {
        let cost = calibration.crossings;
        Forecast {
            adapter_ms: cost.adapter_ms(counting_work(scene, links, sample.work.tests)),
            misfit: cost.misfit,
            processor_ms: cost.processor_factor * on_processor(scene, links, long, sample),
        }
    }

    /// By more than the prediction is off.
    fn adapter_wins(self) -> bool {
        self.misfit * self.adapter_ms < self.processor_ms
    }
}

/// What linking numbers are predicted to take the processor that the table of costs was measured on, on as many threads as there
/// are here.
pub(super) fn on_processor(
    scene: Scene<'_>,
    links: &[Pair],
    long: &[LongLink],
    sample: &Sample,
) -> f64 {
    let threads = rayon::current_num_threads();
    let (_, busy) = parallelism(links.len(), threads, sample.shared);
    let read = 3 * scene.set.points() * scene.set.precision().bytes() + scene.trees.bytes();
    let counting = costs::crossings(0, sample.work, read).with_sums(long);
    let time = costs::direction(links.len(), sample.work) + counting;
    time.on(busy.max(1)).ms
}

impl Time {
    /// This, with long links summed instead.
    pub fn with_sums(self, long: &[LongLink]) -> Time {
        let sum = |time: Time, link: &LongLink| time.instead_of(link.counting, link.summing);
        long.iter().fold(self, sum)
    }
}

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
pub(super) fn worth_summing(scene: Scene<'_>, links: &[Pair]) -> Vec<LongLink> {
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
