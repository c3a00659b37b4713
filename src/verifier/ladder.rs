//! The ladder: a kernel that sums first, and counting crossings for what its bound does not decide.

use crate::certificate::{Certificate, Link};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::kernels::fmm::{self, Fmm};
use crate::kernels::{Accelerator, Accuracy, Estimate, Method, Summation};
use crate::pairs::{Pair, curves_of};
use crate::plan::LongLink;
use crate::verdict::Defect;
use std::time::{Duration, Instant};

/// Who decided the potential links of a frame, and how well.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Ladder {
    /// Pairs that the bound of the sum decided.
    pub summed: u64,
    /// Pairs that were left to counting crossings, exactly.
    pub counted: u64,
    /// Sums that are not unknown, of pairs that have a linking number.
    pub known: u64,
    /// Largest distance of one of those from the linking number.
    pub largest_error: f64,
    /// Mean of those distances; 0 where there is none.
    pub mean_error: f64,
    /// Largest bound of the sums that decided.
    pub largest_bound: f64,
    /// Time of the sums, discretization and the building of trees included.
    pub summing: Duration,
    /// Part of it: splines to polylines.
    pub discretizing: Duration,
}

/// The sums of some pairs.
pub(super) struct Sums<'a> {
    pairs: &'a [Pair],
    estimates: Vec<Estimate>,
    took: Duration,
    discretizing: Duration,
}

impl<'a> Sums<'a> {
    /// Sums by some kernel. Splines become polylines first, for all pairs at once ([`homotopic_polylines`]); unknown is what
    /// stayed too close for that.
    pub fn of(
        set: &CurveSet,
        kernel: (Method, Accuracy),
        accelerator: &Accelerator,
        pairs: &'a [Pair],
    ) -> Sums<'a> {
        let start = Instant::now();
        let discretized = match set.basis().is_polyline() {
            true => None,
            false => Some(homotopic_polylines(set)),
        };
        let discretizing = match discretized {
            Some(_) => start.elapsed(),
            None => Duration::ZERO,
        };
        let estimates = match discretized {
            None => estimates(set, &[], kernel, accelerator, pairs),
            Some(Ok(made)) => estimates(&made.curves, &made.too_close, kernel, accelerator, pairs),
            Some(Err(_)) => None,
        };
        Sums {
            pairs,
            estimates: estimates.unwrap_or_else(|| vec![Estimate::UNKNOWN; pairs.len()]),
            took: start.elapsed(),
            discretizing,
        }
    }

    /// Sums of those pairs of polylines that are predicted to be decided sooner than by counting; the others are unknown.
    pub fn of_long(set: &CurveSet, long: &[LongLink], pairs: &'a [Pair]) -> Sums<'a> {
        let start = Instant::now();
        let worth: Vec<Pair> = long.iter().map(|link| pairs[link.at]).collect();
        let needed = curves_of(worth.iter().copied());
        let needed = |i: u32| needed.binary_search(&i).is_ok();
        // Where the kernel itself expects to take nearly as long, since strands are close, it gives up before it
        // begins.
        let counting = long.iter().map(|link| link.counting.ms());
        let options = fmm::Options {
            limit: 0.4e3 * counting.fold(0.0, f64::max),
            ..fmm::Options::default()
        };
        let fmm = Fmm::of_some(set, needed, options);
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

    /// All pairs, whether they were summed or not.
    pub fn pairs(&self) -> &[Pair] {
        self.pairs
    }

    fn each(&self) -> impl Iterator<Item = (Pair, &Estimate)> {
        self.pairs.iter().copied().zip(&self.estimates)
    }

    /// Pairs that no bound decides.
    pub fn undecided(&self) -> impl Iterator<Item = Pair> {
        let open = self.each().filter(|(_, e)| e.integer().is_none());
        open.map(|(pair, _)| pair)
    }

    /// What the bounds decide, but for 0.
    pub fn links(&self) -> impl Iterator<Item = Link> {
        self.each().filter_map(|((i, j), estimate)| {
            let lambda = estimate.integer().filter(|&n| n != 0)?;
            Some(Link { i, j, lambda })
        })
    }

    /// Who decided, and how far off the sums were: by the certificate, once it is whole.
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

/// The sums; none where the kernel counts.
fn estimates(
    polylines: &CurveSet,
    too_close: &[Defect],
    (method, accuracy): (Method, Accuracy),
    accelerator: &Accelerator,
    pairs: &[Pair],
) -> Option<Vec<Estimate>> {
    let sum = |pairs: &[Pair]| {
        let summation = method.summation(polylines, accuracy, accelerator, pairs)?;
        Some(summation.linking_numbers(pairs))
    };
    if too_close.is_empty() {
        return sum(pairs);
    }
    let mut too_close: Vec<_> = too_close.iter().map(|d| (d.i, d.j)).collect();
    too_close.sort_unstable();
    let far_enough = |&(i, j): &Pair| too_close.binary_search(&(i, Some(j))).is_err();
    let summed: Vec<Pair> = pairs.iter().copied().filter(far_enough).collect();
    let mut sums = sum(&summed)?.into_iter();
    let estimate = |pair| match far_enough(pair) {
        true => sums.next().unwrap_or(Estimate::UNKNOWN),
        false => Estimate::UNKNOWN,
    };
    Some(pairs.iter().map(estimate).collect())
}
