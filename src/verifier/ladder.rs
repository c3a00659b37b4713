//! The ladder: a kernel that sums first, and counting crossings for what its bound does not decide.

use super::Verifier;
use crate::certificate::{Certificate, Link};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::{Accelerator, Accuracy, Estimate, Method};
use crate::pairs::Pair;
use crate::verdict::Stats;
use std::time::{Duration, Instant};

/// Who decided the potential links of a frame, and how well.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Ladder {
    /// Pairs that the bound of the sum decided.
    pub summed: u64,
    /// Pairs that were left to counting crossings, exactly.
    pub counted: u64,
    /// Largest distance of a sum from the linking number, of all that have one and are not unknown.
    pub largest_error: f64,
    /// Largest bound of the sums that decided.
    pub largest_bound: f64,
    /// Time of the sums, discretization and the building of trees included.
    pub summing: Duration,
}

impl Verifier {
    /// All linking numbers of a frame by some kernel, each of them proven: what its bound does not decide is counted.
    ///
    /// Splines become polylines first, for all pairs at once ([`homotopic_polylines`]).
    ///
    /// Errors: those of the discretization.
    pub fn certify_by(
        &mut self,
        set: &CurveSet,
        method: Method,
        accuracy: Accuracy,
    ) -> Result<(&Certificate, Stats, Ladder)> {
        let start = Instant::now();
        if method == Method::Crossings {
            let stats = self.full.certify(set);
            let ladder = Ladder {
                counted: stats.potential_links,
                ..Ladder::default()
            };
            self.full.timings.total = start.elapsed();
            return Ok((&self.full.certificate, stats, ladder));
        }
        self.full.accelerator.start_frame();
        let mut stats = self.full.find_pairs(set);
        let pairs = self.full.pairs().to_vec();
        stats.potential_links = pairs.len() as u64;
        let summing = Instant::now();
        let estimates = estimates(set, method, accuracy, &pairs, &self.full.accelerator)?;
        let mut ladder = Ladder {
            summing: summing.elapsed(),
            ..Ladder::default()
        };
        let mut links = Vec::new();
        let mut undecided = Vec::new();
        for (&(i, j), estimate) in pairs.iter().zip(&estimates) {
            let Some(lambda) = estimate.integer() else {
                undecided.push((i, j));
                continue;
            };
            ladder.summed += 1;
            ladder.largest_bound = ladder.largest_bound.max(estimate.bound);
            if lambda != 0 {
                links.push(Link { i, j, lambda });
            }
        }
        ladder.counted = undecided.len() as u64;
        let counted = self.full.certify_pairs(set, &undecided);
        let certificate = &mut self.full.certificate;
        certificate.links = links;
        certificate.links.extend(counted.links);
        certificate.links.sort_unstable_by_key(|l| (l.i, l.j));
        certificate.undefined.extend(counted.undefined);
        certificate.undefined.sort_unstable_by_key(|d| (d.i, d.j));
        let undefined = |p: &Pair| {
            let found = certificate
                .undefined
                .binary_search_by_key(&(p.0, Some(p.1)), |d| (d.i, d.j));
            found.is_ok()
        };
        for (p, estimate) in pairs.iter().zip(&estimates) {
            if estimate.bound < f64::INFINITY && !undefined(p) {
                let links = &certificate.links;
                let found = links.binary_search_by_key(p, |l| (l.i, l.j));
                let lambda = found.map_or(0, |k| links[k].lambda);
                let error = (estimate.value - lambda as f64).abs();
                ladder.largest_error = ladder.largest_error.max(error);
            }
        }
        self.full.timings.total = start.elapsed();
        Ok((&self.full.certificate, stats, ladder))
    }

    /// Pairs of segments in the potential links that were found last: what sums without trees go through. The set is the
    /// one they were found in, or its polylines.
    pub fn segment_pairs(&self, set: &CurveSet) -> u64 {
        let segments = |i: u32| u64::from(set.curve(i as usize).segments);
        let pairs = self.full.pairs().iter();
        pairs.map(|&(i, j)| segments(i) * segments(j)).sum()
    }

    /// All linking numbers of a frame of polylines that stay the same wherever the vertices are in cubes of half-width
    /// `noise` around where they are (Arai 2013, remark 4). Pairs that some noise may bring in touch have none, and two of
    /// their segments are named.
    ///
    /// Errors: [`Error::Usage`] for splines, and for noise that is no length.
    pub fn certify_noisy(&mut self, set: &CurveSet, noise: f64) -> Result<(&Certificate, Stats)> {
        if !set.basis().is_polyline() {
            let what = "noise is of the vertices of polylines; these curves are splines";
            return Err(Error::Usage(what.into()));
        }
        if !(noise >= 0.0 && noise.is_finite()) {
            let what = format!("noise of {noise}, expected a length");
            return Err(Error::Usage(what));
        }
        let start = Instant::now();
        let stats = self.full.certify_noisy(set, noise);
        self.full.timings.total = start.elapsed();
        Ok((&self.full.certificate, stats))
    }
}

/// The sums of some pairs; unknown for those that stayed too close to be discretized.
fn estimates(
    set: &CurveSet,
    method: Method,
    accuracy: Accuracy,
    pairs: &[Pair],
    accelerator: &Accelerator,
) -> Result<Vec<Estimate>> {
    let discretized = match set.basis().is_polyline() {
        true => None,
        false => Some(homotopic_polylines(set)?),
    };
    let polylines = discretized.as_ref().map_or(set, |d| &d.curves);
    let mut too_close: Vec<(u32, Option<u32>)> = discretized
        .iter()
        .flat_map(|d| d.too_close.iter().map(|d| (d.i, d.j)))
        .collect();
    too_close.sort_unstable();
    let Some(summation) = method.summation(polylines, accuracy, accelerator) else {
        return Ok(vec![Estimate::UNKNOWN; pairs.len()]);
    };
    if too_close.is_empty() {
        return Ok(summation.linking_numbers(pairs));
    }
    let far_enough = |&(i, j): &Pair| too_close.binary_search(&(i, Some(j))).is_err();
    let summed: Vec<Pair> = pairs.iter().copied().filter(far_enough).collect();
    let mut sums = summation.linking_numbers(&summed).into_iter();
    let estimate = |pair| match far_enough(pair) {
        true => sums.next().unwrap_or(Estimate::UNKNOWN),
        false => Estimate::UNKNOWN,
    };
    Ok(pairs.iter().map(estimate).collect())
}
