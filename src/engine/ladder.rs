//! Ladder of kernels: a kernel that sums runs first; crossings are counted for the pairs that its
//! error bound does not decide.

use crate::cancel::Cancel;
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::kernels::choice::LongLink;
use crate::kernels::choice::costs::MS;
use crate::kernels::sums::fmm::{self, Fmm};
use crate::kernels::{Accuracy, Estimate, GpuUse, Method, Summation};
use crate::pairs::{Pair, curves_of, sorted};
use crate::verdict::{Defect, Link};
use std::time::{Duration, Instant};

/// Numbers of linking numbers decided by sums and by counting, and the accuracy of the sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Ladder {
    /// Number of pairs that the error bound of the sum decided.
    pub summed: u64,
    /// Number of pairs that were decided by counting crossings, exactly.
    pub counted: u64,
    /// Number of sums with a known value, of pairs that have a linking number.
    pub known: u64,
    /// Largest error of those sums.
    pub largest_error: f64,
    /// Mean error of those sums; 0 if there are none.
    pub mean_error: f64,
    /// Largest error bound of the sums that decided.
    pub largest_bound: f64,
    /// Time of the sums, discretization and construction of the trees included.
    pub summing: Duration,
    /// Part of that time which converts splines to polylines.
    pub discretizing: Duration,
}

/// The sums of some pairs.
pub(super) struct Sums<'a> {
    /// All pairs, summed or not.
    pub pairs: &'a [Pair],
    estimates: Vec<Estimate>,
    took: Duration,
    discretizing: Duration,
}

impl<'a> Sums<'a> {
    /// Sums pairs by a kernel. Splines are first converted to polylines, for all pairs at once
    /// ([`homotopic_polylines`]). Pairs that are too close for the conversion remain unknown.
    pub fn of(
        set: &CurveSet,
        method: Method,
        accuracy: Accuracy,
        gpu: &GpuUse,
        pairs: &'a [Pair],
    ) -> Sums<'a> {
        let start = Instant::now();
        let mut discretizing = Duration::ZERO;
        let estimates = if set.basis().is_polyline() {
            estimates(set, &[], method, accuracy, gpu, pairs)
        } else {
            let made = homotopic_polylines(set);
            discretizing = start.elapsed();
            let made = made.as_ref().ok();
            made.and_then(|made| {
                estimates(&made.curves, &made.too_close, method, accuracy, gpu, pairs)
            })
        };
        Sums {
            pairs,
            estimates: estimates.unwrap_or_else(|| vec![Estimate::UNKNOWN; pairs.len()]),
            took: start.elapsed(),
            discretizing,
        }
    }

    /// Sums only the pairs of polylines for which the sum is predicted to take less time than
    /// counting. The estimates of the other pairs are unknown.
    pub fn of_long(
        set: &CurveSet,
        long: &[LongLink],
        pairs: &'a [Pair],
        cancel: Option<Cancel>,
    ) -> Sums<'a> {
        let start = Instant::now();
        let worth: Vec<Pair> = long.iter().map(|link| pairs[link.at]).collect();
        let needed = curves_of(worth.iter().copied());
        let needed = |i: u32| needed.binary_search(&i).is_ok();
        // The kernel gives up before it starts if strands are so close that it expects to take
        // nearly as long as counting.
        let counting = long.iter().map(|link| link.counting * MS);
        let options = fmm::Options {
            limit: 0.4e3 * counting.fold(0.0, f64::max),
            ..fmm::Options::default()
        };
        let mut fmm = Fmm::of_some(set, needed, options);
        fmm.cancel = cancel;
        let mut estimates = vec![Estimate::UNKNOWN; pairs.len()];
        for (link, found) in long.iter().zip(fmm.linking_numbers(&worth)) {
            estimates[link.at] = found;
        }
        Sums {
            pairs,
            estimates,
            took: start.elapsed(),
            discretizing: Duration::ZERO,
        }
    }

    fn each(&self) -> impl Iterator<Item = (Pair, &Estimate)> {
        self.pairs.iter().copied().zip(&self.estimates)
    }

    /// Returns the pairs that no bound decides.
    pub fn undecided(&self) -> impl Iterator<Item = Pair> {
        let open = self.each().filter(|(_, e)| e.integer().is_none());
        open.map(|(pair, _)| pair)
    }

    /// Returns the linking numbers that the bounds decide, except 0.
    pub fn links(&self) -> impl Iterator<Item = Link> {
        self.each().filter_map(|((i, j), estimate)| {
            let lambda = estimate.integer().filter(|&n| n != 0)?;
            Some(Link { i, j, lambda })
        })
    }

    /// Returns the number of pairs decided by each method, and the errors of the sums with respect
    /// to the complete certificate.
    pub fn ladder(&self, certificate: &Certificate) -> Ladder {
        let mut ladder = Ladder {
            summing: self.took,
            discretizing: self.discretizing,
            ..Ladder::default()
        };
        for ((i, j), estimate) in self.each() {
            match estimate.integer() {
                Some(_) => {
                    ladder.summed += 1;
                    ladder.largest_bound = ladder.largest_bound.max(estimate.bound);
                }
                None => ladder.counted += 1,
            }
            let key = &(i, Some(j));
            let undefined = &certificate.undefined;
            let defined = undefined.binary_search_by_key(key, |d| (d.i, d.j)).is_err();
            if estimate.bound < f64::INFINITY && defined {
                let links = &certificate.links;
                let found = links.binary_search_by_key(&(i, j), |l| (l.i, l.j));
                let lambda = found.map_or(0, |k| links[k].lambda);
                let error = (estimate.value - lambda as f64).abs();
                ladder.largest_error = ladder.largest_error.max(error);
                ladder.mean_error += error;
                ladder.known += 1;
            }
        }
        ladder.mean_error /= ladder.known.max(1) as f64;
        ladder
    }
}

/// Returns the sums, or `None` if the kernel counts crossings.
fn estimates(
    polylines: &CurveSet,
    too_close: &[Defect],
    method: Method,
    accuracy: Accuracy,
    gpu: &GpuUse,
    pairs: &[Pair],
) -> Option<Vec<Estimate>> {
    let sum = |pairs: &[Pair]| {
        let summation = method.summation(polylines, accuracy, gpu, pairs)?;
        Some(summation.linking_numbers(pairs))
    };
    if too_close.is_empty() {
        return sum(pairs);
    }
    let too_close = sorted(too_close.iter().map(|d| (d.i, d.j)));
    let far_enough = |&(i, j): &Pair| too_close.binary_search(&(i, Some(j))).is_err();
    let summed: Vec<Pair> = pairs.iter().copied().filter(far_enough).collect();
    let mut sums = sum(&summed)?.into_iter();
    let estimate = |pair| match far_enough(pair) {
        true => sums.next().unwrap_or(Estimate::UNKNOWN),
        false => Estimate::UNKNOWN,
    };
    Some(pairs.iter().map(estimate).collect())
}
