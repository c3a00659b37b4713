//! Measurement of a certificate: from control points in memory to the sorted linking numbers, stage
//! by stage.

use super::clock::timed;
use super::statistics::median;
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::engine::{Certifier, Ladder, SessionOptions};
use crate::error::Result;
use crate::kernels::Device;
use crate::verdict::Stats;
use serde::Serialize;
use std::time::Duration;

/// Times of the stages of a certificate, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StageTimes {
    /// Time of the boxes of all segments, and of the trees over them.
    pub boxes_ms: f64,
    /// Time of the search for potential links.
    pub pairs_ms: f64,
    /// Time of the discretization and the linking numbers.
    pub links_ms: f64,
    /// Wall-clock time of all stages.
    pub total_ms: f64,
    /// CPU time of all threads, for all stages.
    pub cpu_ms: f64,
    /// Time of the sums, discretization included: a part of `links_ms`.
    #[serde(skip)]
    pub summing_ms: f64,
    /// Part of `summing_ms` that converts splines to polylines.
    #[serde(skip)]
    pub discretizing_ms: f64,
}

impl StageTimes {
    /// Returns the median of each number separately.
    pub fn median(all: &[StageTimes]) -> StageTimes {
        let median = |time: fn(&StageTimes) -> f64| median(all.iter().map(time));
        StageTimes {
            boxes_ms: median(|t| t.boxes_ms),
            pairs_ms: median(|t| t.pairs_ms),
            links_ms: median(|t| t.links_ms),
            total_ms: median(|t| t.total_ms),
            cpu_ms: median(|t| t.cpu_ms),
            summing_ms: median(|t| t.summing_ms),
            discretizing_ms: median(|t| t.discretizing_ms),
        }
    }
}

impl std::fmt::Display for StageTimes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "boxes {:.3}  pairs {:.3}  links {:.3}  total {:.3} ms  (cpu {:.3} ms)",
            self.boxes_ms, self.pairs_ms, self.links_ms, self.total_ms, self.cpu_ms,
        )
    }
}

/// A measured certificate.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// Times of the stages.
    pub times: StageTimes,
    /// Work counters.
    pub stats: Stats,
    /// Decisions of sums and of counting.
    pub ladder: Ladder,
    /// Number of linked pairs.
    pub links: usize,
    /// Number of pairs without a linking number.
    pub undefined: usize,
    /// True if the certificate is the exact one, or there is none to compare with.
    pub equal: bool,
}

impl Run {
    /// Certifies curves once, and compares the result with the exact one if it is known.
    pub fn of(certifier: &mut Certifier, curves: &CurveSet, exact: Option<&Certificate>) -> Run {
        let ((found, stats), elapsed) = timed(|| certifier.certify(curves));
        let (links, undefined) = (found.links.len(), found.undefined.len());
        let equal = exact.is_none_or(|exact| found == exact);
        let (timings, ladder) = (certifier.timings(), certifier.ladder());
        let ms = |d: Duration| d.as_secs_f64() * 1e3;
        Run {
            times: StageTimes {
                boxes_ms: ms(timings.boxes),
                pairs_ms: ms(timings.pairs),
                links_ms: ms(timings.links),
                total_ms: ms(timings.total),
                cpu_ms: elapsed.cpu_ms,
                summing_ms: ms(ladder.summing),
                discretizing_ms: ms(ladder.discretizing),
            },
            stats,
            ladder,
            links,
            undefined,
            equal,
        }
    }

    /// Certifies curves with a new certifier, which allocates its buffers, and again with the same
    /// one.
    ///
    /// Errors: the device cannot be used.
    pub fn first_and_later(
        device: &Device,
        curves: &CurveSet,
        exact: Option<&Certificate>,
    ) -> Result<[Run; 2]> {
        let mut certifier = Certifier::new(&SessionOptions {
            device: device.clone(),
            ..SessionOptions::default()
        })?;
        let mut run = || Run::of(&mut certifier, curves, exact);
        Ok([run(), run()])
    }

    /// Returns the medians of all times. All other results are those of the last run; they do not
    /// depend on the run. `None` if there are no runs.
    pub fn median(runs: impl IntoIterator<Item = Run>) -> Option<Run> {
        let runs: Vec<Run> = runs.into_iter().collect();
        let times: Vec<StageTimes> = runs.iter().map(|run| run.times).collect();
        runs.last().map(|&last| Run {
            times: StageTimes::median(&times),
            equal: runs.iter().all(|run| run.equal),
            ..last
        })
    }
}
