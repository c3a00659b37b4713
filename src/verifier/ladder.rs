//! The ladder: a kernel that sums first, and counting crossings for what its bound does not decide.

use super::Verifier;
use crate::certificate::{Certificate, Link};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::Result;
use crate::kernels::{Estimate, Method};
use crate::pairs::Pair;
use crate::verdict::Stats;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Who decided the potential links of a frame, and how well.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Ladder {
    /// Pairs that the bound of the sum decided.
    pub summed: u64,
    /// Pairs that were left to counting crossings, exactly.
    pub counted: u64,
    /// Largest distance of a sum from its integer, of those that it decided.
    pub largest_error: f64,
    /// Largest bound of these.
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
    ) -> Result<(&Certificate, Stats, Ladder)> {
        let start = Instant::now();
        let stats = self.full.find_pairs(set);
        if method == Method::Crossings {
            let stats = self.full.certify(set);
            let ladder = Ladder {
                counted: stats.potential_links,
                ..Ladder::default()
            };
            self.full.timings.total = start.elapsed();
            return Ok((&self.full.certificate, stats, ladder));
        }
        let pairs = self.full.pairs().to_vec();
        let summing = Instant::now();
        let estimates = estimates(set, method, &pairs)?;
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
            let error = (estimate.value - lambda as f64).abs();
            ladder.largest_error = ladder.largest_error.max(error);
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
        self.full.timings.total = start.elapsed();
        Ok((&self.full.certificate, stats, ladder))
    }
}

/// The sums of some pairs; unknown for those that stayed too close to be discretized.
fn estimates(set: &CurveSet, method: Method, pairs: &[Pair]) -> Result<Vec<Estimate>> {
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
    let summation = method.summation(polylines);
    let estimate = |&(i, j): &Pair| match &summation {
        Some(sum) if too_close.binary_search(&(i, Some(j))).is_err() => sum.linking_number((i, j)),
        _ => Estimate::UNKNOWN,
    };
    Ok(pairs.par_iter().map(estimate).collect())
}
