//! Choice of the fastest way to compute linking numbers: counting on the CPU or the GPU, or sums
//! first.
//!
//! An adapter that was measured ([`Calibration`]) counts the crossings of a frame if it is
//! predicted to be faster than the best way on the CPU. A requested adapter does all that it
//! supports.
//!
//! Sums pay for potential links of two long curves that cross each other very often in every view.
//! The time of counting grows with the number of crossings, which may be as large as the product of
//! the numbers of strands. The time of the fast multipole method grows with the number of segments.
//! So it wins if thousands of strands pass thousands of others at a distance, as on two wound
//! balls, and nowhere else.

use super::costs::{self, Time};
use super::{Sample, parallelism};
use crate::kernels::crossings::{Input, sample};
use crate::kernels::{Calibration, CountingWork, KernelWork, Method, Offer, segment_pairs};
use crate::pairs::Pair;
use rayon::prelude::*;

/// Method that computes the linking numbers of a frame.
#[derive(Clone, Debug)]
pub(crate) enum Way {
    /// Counts the crossings.
    Count {
        /// True if the offered adapter counts them.
        on_adapter: bool,
    },
    /// Runs the fast multipole method first on these links. Crossings are counted for the others,
    /// and for links that it does not decide.
    Fmm(Vec<LongLink>),
}

impl Way {
    /// Returns the way for some potential links: counting, or with [`Method::Auto`] the one
    /// predicted to be fastest.
    pub fn of(input: Input<'_>, links: &[Pair], method: Method, offer: Option<Offer<'_>>) -> Way {
        let asked_for = offer.is_some_and(|o| o.asked_for && counts(input));
        let long = match method {
            Method::Auto if !asked_for => worth_summing(input, links),
            _ => Vec::new(),
        };
        match adapter_wins(input, links, &long, offer) {
            false if !long.is_empty() => Way::Fmm(long),
            on_adapter => Way::Count { on_adapter },
        }
    }
}

/// Returns true if an adapter counts the crossings of these potential links.
pub(crate) fn goes_to_adapter(input: Input<'_>, links: &[Pair], offer: Option<Offer<'_>>) -> bool {
    adapter_wins(input, links, &[], offer)
}

/// Returns true if adapters can count the crossings of these curves.
fn counts(input: Input<'_>) -> bool {
    input.set.basis().is_polyline()
}

/// Returns true if an adapter counts the crossings, given that the CPU would sum the `long` links.
///
/// Cost: linear in the links; if that does not rule the adapter out, a sample of them ([`Sample`]).
fn adapter_wins(
    input: Input<'_>,
    links: &[Pair],
    long: &[LongLink],
    offer: Option<Offer<'_>>,
) -> bool {
    let Some(offer) = offer.filter(|_| counts(input) && !links.is_empty()) else {
        return false;
    };
    match offer.calibration {
        _ if offer.asked_for => true,
        Some(calibration) if !cannot_win(input, links, calibration) => {
            let sample = Sample::of(input, links);
            Forecast::of(input, links, long, &sample, calibration).adapter_wins()
        }
        _ => false,
    }
}

/// Returns true if an adapter takes longer for no tests at all than the CPU for all possible tests
/// on one thread.
fn cannot_win(input: Input<'_>, links: &[Pair], calibration: &Calibration) -> bool {
    let cost = calibration.crossings;
    let tests = segment_pairs(input.set, links);
    let most = KernelWork {
        tests,
        exact: tests,
        computed: 2 * tests,
        front: 2 * tests,
        ..KernelWork::default()
    };
    let most = costs::direction(links.len(), most) + costs::crossings(0, most, usize::MAX);
    let least = cost.adapter_ms(counting_work(input, links, 0));
    cost.processor_factor * most.ms() <= least
}

fn counting_work(input: Input<'_>, links: &[Pair], tests: u64) -> CountingWork {
    CountingWork {
        segments: input.set.segments() as u64,
        links: links.len() as u64,
        tests,
    }
}

/// Predicted time of the linking numbers, directions included, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forecast {
    /// Time of counting all of them on the adapter.
    pub adapter_ms: f64,
    /// Typical error of that prediction, as a factor.
    pub misfit: f64,
    /// Time of the best way on the CPU.
    pub processor_ms: f64,
}

impl Forecast {
    /// Predicts the times from a sample of the links, given that the CPU would sum the `long` ones.
    pub fn of(
        input: Input<'_>,
        links: &[Pair],
        long: &[LongLink],
        sample: &Sample,
        calibration: &Calibration,
    ) -> Forecast {
        let cost = calibration.crossings;
        Forecast {
            adapter_ms: cost.adapter_ms(counting_work(input, links, sample.work.tests)),
            misfit: cost.misfit,
            processor_ms: cost.processor_factor * on_cpu(input, links, long, sample),
        }
    }

    /// Returns true if the adapter wins by more than the error of its prediction.
    fn adapter_wins(self) -> bool {
        self.misfit * self.adapter_ms < self.processor_ms
    }
}

/// Returns the predicted time of the linking numbers on the CPU of the cost table, with the current
/// number of threads, in milliseconds.
pub(super) fn on_cpu(input: Input<'_>, links: &[Pair], long: &[LongLink], sample: &Sample) -> f64 {
    let threads = rayon::current_num_threads();
    let (_, busy) = parallelism(links.len(), threads, sample.shared);
    let read = 3 * input.set.points() * input.set.precision().bytes() + input.trees.bytes();
    let counting = costs::crossings(0, sample.work, read).with_sums(long);
    let time = costs::direction(links.len(), sample.work) + counting;
    time.on(busy.max(1)).ms
}

impl Time {
    /// Returns this time with long links summed instead of counted.
    pub fn with_sums(self, long: &[LongLink]) -> Time {
        let sum = |time: Time, link: &LongLink| time.instead_of(link.counting, link.summing);
        long.iter().fold(self, sum)
    }
}

/// A potential link for which a sum pays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LongLink {
    /// Index in the list of links.
    pub at: usize,
    /// Predicted time of counting on one thread.
    pub counting: Time,
    /// Predicted time of the sum on one thread.
    pub summing: Time,
}

/// Minimum number of segments of two curves: below that, counting is fast however they cross.
const LONG: u32 = 50_000;

/// Time of counting, in milliseconds of one thread, below which no sum pays.
const SHORT_MS: f64 = 500.0;

/// Number of links below which they are not split among threads.
const FEW: usize = 64;

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
    let look = |at: usize| {
        let (i, j) = links[at];
        let segments = segments(i).saturating_add(segments(j));
        if segments < LONG {
            return None;
        }
        let mut workspace = input.workspaces.take();
        let work = sample(input, (i, j), &mut workspace);
        workspace.take_stats();
        input.workspaces.put(workspace);
        decide(at, segments, work)
    };
    match links.len() {
        // A parallel iterator allocates, and a frame like the previous one should allocate nothing.
        few @ ..FEW => (0..few).filter_map(look).collect(),
        many => (0..many).into_par_iter().filter_map(look).collect(),
    }
}

fn decide(at: usize, segments: u32, work: KernelWork) -> Option<LongLink> {
    let segments = segments as usize;
    // Boxes take at least 2 bytes per segment, so curves of this length exceed every cache.
    let counting = costs::crossings(0, work, usize::MAX);
    let summing = costs::multipole(segments);
    let worth = counting.ms() > SHORT_MS.max(SHORTER * summing.ms());
    worth.then_some(LongLink {
        at,
        counting,
        summing,
    })
}
