//! Choice of the fastest way to compute linking numbers: counting on the CPU or the GPU, or sums
//! first.
//!
//! An adapter that was measured ([`Calibration`]) counts the crossings of a frame if it is
//! predicted to be faster than the best way on the CPU. A requested adapter does all that it
//! supports.

pub(crate) mod costs;
mod long;
mod sample;

pub(crate) use long::{LongLink, with_sums};
pub(crate) use sample::Sample;

use super::crossings::{Input, busy_threads};
use super::{Calibration, CountingCost, KernelWork, Method, Offer, segment_pairs};
use crate::pairs::Pair;
use std::cell::OnceCell;

/// Way to compute the linking numbers of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Choice {
    /// The CPU counts the crossings.
    CountOnCpu,
    /// The offered adapter counts the crossings.
    CountOnGpu,
    /// The fast multipole method runs first on [`Predictions::long`]. The CPU or the adapter counts
    /// the crossings of the other links, and of links that the method does not decide.
    SumFirst,
}

/// Predictions for some potential links, each computed when it is first needed.
#[derive(Debug)]
pub(crate) struct Predictions<'a> {
    input: Input<'a>,
    links: &'a [Pair],
    method: Method,
    long: OnceCell<Vec<LongLink>>,
    sample: OnceCell<Sample>,
}

impl<'a> Predictions<'a> {
    /// Prepares the predictions for `method`: [`Method::Auto`], or [`Method::Crossings`], which
    /// sums no link.
    pub fn new(input: Input<'a>, links: &'a [Pair], method: Method) -> Predictions<'a> {
        Predictions {
            input,
            links,
            method,
            long: OnceCell::new(),
            sample: OnceCell::new(),
        }
    }

    /// Returns the way that is predicted to be fastest.
    ///
    /// Cost: linear in the links. If that does not rule the adapter out, a sample of the links
    /// ([`Sample`]). Some tenths of a millisecond for each link of long curves ([`LongLink`]).
    pub fn choose(&self, offer: Option<Offer<'_>>) -> Choice {
        if self.adapter_wins(offer) {
            Choice::CountOnGpu
        } else if self.long().is_empty() {
            Choice::CountOnCpu
        } else {
            Choice::SumFirst
        }
    }

    /// Returns the links that the CPU sums first.
    pub fn long(&self) -> &[LongLink] {
        self.long.get_or_init(|| match self.method {
            Method::Auto => long::worth_summing(self.input, self.links),
            _ => Vec::new(),
        })
    }

    /// Returns the estimated work of counting.
    pub fn sample(&self) -> &Sample {
        self.sample
            .get_or_init(|| Sample::of(self.input, self.links))
    }

    /// Returns the predicted time of the best way on the CPU of the cost table, with the current
    /// number of threads, in milliseconds. Includes the choice of directions.
    pub fn on_cpu_ms(&self) -> f64 {
        let Predictions { input, links, .. } = self;
        let sample = self.sample();
        let busy = busy_threads(links.len(), input.set.segments(), sample.shared);
        let read = 3 * input.set.points() * input.set.precision().bytes() + input.trees.bytes();
        let counting = with_sums(costs::crossings(0, sample.work, read), self.long());
        let time = costs::direction(links.len(), sample.work) + counting;
        time * costs::MS / busy.max(1) as f64
    }

    /// Returns the predicted times on a measured adapter and on the CPU, or `None` if the adapter
    /// cannot count the crossings of these curves.
    pub fn forecast(&self, calibration: &Calibration) -> Option<Forecast> {
        let cost = calibration.crossings;
        self.can_offload().then(|| Forecast {
            adapter_ms: self.on_adapter_ms(cost, self.sample().work.tests),
            error_factor: cost.error_factor,
            cpu_ms: cost.cpu_factor * self.on_cpu_ms(),
        })
    }

    /// Returns true if adapters can count the crossings of these curves.
    fn can_offload(&self) -> bool {
        self.input.set.basis().is_polyline()
    }

    /// Returns true if the offered adapter counts the crossings.
    fn adapter_wins(&self, offer: Option<Offer<'_>>) -> bool {
        let Some(offer) = offer.filter(|_| self.can_offload() && !self.links.is_empty()) else {
            return false;
        };
        match offer.calibration {
            _ if offer.requested => true,
            Some(calibration) if !self.cannot_win(calibration) => {
                let forecast = self.forecast(calibration);
                forecast.is_some_and(Forecast::adapter_wins)
            }
            _ => false,
        }
    }

    /// Returns true if the adapter, without any test, is predicted to take longer than one CPU
    /// thread with all possible tests.
    fn cannot_win(&self, calibration: &Calibration) -> bool {
        let cost = calibration.crossings;
        let tests = segment_pairs(self.input.set, self.links);
        let most = KernelWork {
            tests,
            exact: tests,
            computed: 2 * tests,
            front: 2 * tests,
            ..KernelWork::default()
        };
        let links = self.links.len();
        let most = costs::direction(links, most) + costs::crossings(0, most, usize::MAX);
        cost.cpu_factor * (most * costs::MS) <= self.on_adapter_ms(cost, 0)
    }

    fn on_adapter_ms(&self, cost: CountingCost, tests: u64) -> f64 {
        cost.adapter_ms(self.input.set.segments(), self.links.len(), tests)
    }
}

/// Predicted time of the linking numbers, directions included, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Forecast {
    /// Time of counting all of them on the adapter.
    pub adapter_ms: f64,
    /// Typical error of that prediction, as a factor.
    pub error_factor: f64,
    /// Time of the best way on the CPU.
    pub cpu_ms: f64,
}

impl Forecast {
    /// Returns true if the adapter wins by more than the error of its prediction.
    fn adapter_wins(self) -> bool {
        self.error_factor * self.adapter_ms < self.cpu_ms
    }
}
