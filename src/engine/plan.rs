//! Plan of a verification: the decisions of the stages, and the predicted cost.
//!
//! The decisions are those of the stages themselves, so the plan matches the run. Predicted times
//! are counts of work multiplied by the constants of one table. They depend only on the curves and
//! on the number of threads, not on the clock. The counts of the first stages are those of the
//! scene; those of the linking numbers are extrapolated from a sample (see [`Plan::of`]).
//!
//! With a device, a plan also reports if crossings are counted on a GPU. The time on the GPU
//! follows from the same counts and from measurements of the adapter ([`Calibration`]). The time on
//! the CPU is scaled by one factor from the same measurements.
//!
//! The table was measured on one machine; other machines are faster or slower by a factor. A
//! prediction applies to frames after the first, whose buffers are allocated.
//!
//! # Predicted and measured
//!
//! Times of all generated scenes with their defaults, on a shared cloud machine (AMD EPYC with
//! AVX2, two cores, 32 MB of cache): milliseconds predicted / measured by `study --threads 1 stages
//! SCENE` (benches/study). The measured total is CPU time; links are the direction, the
//! discretization and the kernel together.
//!
//! | scene | boxes | search | links | total | ratio |
//! |---|---|---|---|---|---|
//! | `chainmail` | 1.14 / 1.42 | 1.54 / 1.85 | 3.90 / 5.62 | 6.59 / 8.89 | 0.74 |
//! | `knit` | 0.77 / 1.15 | 0.02 / 0.03 | 5.15 / 5.26 | 5.94 / 6.43 | 0.92 |
//! | `ribbon` | 0.28 / 0.29 | 0.00 / 0.00 | 0.10 / 0.19 | 0.38 / 0.48 | 0.80 |
//! | `rubber_bands` | 0.13 / 0.15 | 0.81 / 0.76 | 3.94 / 3.78 | 4.89 / 4.69 | 1.04 |
//! | `square_link` | 0.77 / 0.83 | 14.8 / 11.9 | 129 / 134 | 144 / 147 | 0.98 |
//! | `torus_link` | 28.0 / 39.8 | 0.00 / 0.01 | 457 / 458 | 485 / 498 | 0.97 |
//! | `torus_zero` | 0.56 / 0.51 | 0.00 / 0.00 | 6.95 / 7.72 | 7.51 / 8.23 | 0.91 |
//! | `woundball` | 1.40 / 1.48 | 0.00 / 0.01 | 83.9 / 91.2 | 85.3 / 92.7 | 0.92 |
//!
//! The constants were fitted to these scenes and to two garments (ratios 1.08 and 1.25), so the
//! table shows the quality of the fit, not the accuracy on other scenes. Search times of some
//! hundredths of a millisecond are wrong by up to a factor of 2. With several threads, a prediction
//! assumes that many idle cores.
//!
//! The model accounts only for the last-level cache, and assumes AVX2: all stages take longer
//! without it. If the work of more than 64 potential links differs much, the sample may miss a rare
//! link with much work.

#[cfg(test)]
mod tests;

use crate::curve::{Cell, CurveSet};
use crate::engine::SessionOptions;
use crate::error::Result;
use crate::kernels::choice::costs::{self, MS, Nanoseconds};
use crate::kernels::choice::{Choice, Forecast, Predictions, with_sums};
use crate::kernels::crossings::{Input, Workspaces, busy_threads, by_formula};
use crate::kernels::{Calibration, GpuUse, Method, Offer, SumCost};
use crate::pairs::{LinkSearch, PairFilter, Trees, degenerate_curves, refits_in_parallel};
use crate::periodic::{Boxer, FractionalBoxes, ImagePairs, Searched, period};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;

/// Plan of a verification.
///
/// ```
/// use linkwatch::{Plan, scenes::Scene};
///
/// let scene: Scene = "ribbon:segments=2000".parse()?;
/// let plan = Plan::of(&scene.build()?.curves);
/// assert_eq!(plan.potential_links, 1);
/// println!("{plan:#?}");
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Plan {
    /// Number of threads of the plan.
    pub threads: usize,
    /// Number of curves of the scene.
    pub curves: usize,
    /// Number of segments of all curves.
    pub segments: usize,
    /// Number of open curves. They are skipped, because they have no linking numbers.
    pub open_curves: usize,
    /// Number of closed curves of fewer than three distinct points. They are skipped.
    pub degenerate_curves: usize,
    /// Number of pairs of the other curves.
    pub pairs: u64,
    /// Number of these pairs whose boxes overlap. All others are unlinked.
    pub potential_links: usize,
    /// Number of potential links that the extents of the curves along diagonals prove to be 0. They
    /// are discarded.
    pub discarded: usize,
    /// True if curves are splines, which each pair converts to polylines where hulls overlap.
    pub splines: bool,
    /// Number of potential links of two small loops, whose direction of projection follows from a
    /// formula on their boxes. The others use the best of six directions.
    pub by_formula: usize,
    /// Kernel that runs first: [`Method::Crossings`], or [`Method::Fmm`] if some links of long
    /// curves cross very often. Crossings are counted for the other links, and for links that its
    /// bound does not decide.
    pub kernel: Method,
    /// Number of links on which [`Method::Fmm`] runs first.
    pub summed: usize,
    /// Number of threads that the linking numbers keep busy.
    pub busy_threads: usize,
    /// Number of sampled potential links.
    pub sampled: usize,
    /// Number of segment pairs that are tested for a crossing, extrapolated from the sample.
    pub tests: u64,
    /// Number of segment pairs of splines whose hulls are compared, extrapolated likewise.
    pub overlaps: u64,
    /// Adapter, if there is one to choose.
    pub device: Option<DevicePlan>,
    /// Linking numbers with periodic images, if there is a cell. They are part of the total.
    pub images: Option<ImagePlan>,
    /// Predicted cost of the boxes of all segments, and of the trees over them.
    pub boxes: Prediction,
    /// Predicted cost of the search for potential links.
    pub search: Prediction,
    /// Predicted cost of the linking numbers, with directions and discretization. If crossings are
    /// counted on an adapter that was measured, its predicted cost.
    pub links: Prediction,
    /// Predicted cost of all stages together.
    pub total: Prediction,
}

/// Predicted time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Prediction {
    /// Time on one thread, in milliseconds.
    pub one_thread_ms: f64,
    /// Time on the threads of the plan, in milliseconds: the time on one thread, divided by the
    /// number of busy threads.
    pub ms: f64,
}

impl Prediction {
    /// Returns the prediction for several threads that are all busy.
    fn of(time: Nanoseconds, threads: usize) -> Prediction {
        let one_thread_ms = time * MS;
        Prediction {
            one_thread_ms,
            ms: one_thread_ms / threads as f64,
        }
    }
}

impl std::ops::Add for Prediction {
    type Output = Prediction;

    fn add(self, other: Prediction) -> Prediction {
        Prediction {
            one_thread_ms: self.one_thread_ms + other.one_thread_ms,
            ms: self.ms + other.ms,
        }
    }
}

/// Verification of the pairs of a curve and a periodic image, of another curve or of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ImagePlan {
    /// Number of curves and images that take part.
    pub curves: usize,
    /// Number of pairs whose boxes overlap. All others are unlinked.
    pub potential_links: usize,
    /// Number of pairs of a closed curve and one that runs through the cell. Their linking numbers
    /// are not among the predicted cost.
    pub yarns: usize,
    /// Predicted cost of all stages of these pairs.
    pub predicted: Prediction,
}

/// An adapter, and the work that is sent to it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct DevicePlan {
    /// Name of the adapter.
    pub adapter: String,
    /// True if it counts the crossings, false if the CPU does. The crossings of splines are always
    /// counted on the CPU.
    pub chosen: bool,
    /// Predicted time of counting on the adapter, in milliseconds, with the choice of directions.
    /// `None` if it was never measured, and for splines.
    pub adapter_ms: Option<f64>,
    /// Typical error of that prediction, as a factor. With
    /// [`Device::Auto`](crate::kernels::Device::Auto), the adapter is used only if it wins by more
    /// than that.
    pub adapter_error_factor: Option<f64>,
    /// Predicted time of the linking numbers on the CPU, with the choice of directions.
    pub cpu_ms: Option<f64>,
    /// Number of segment pairs from which on direct sums run on the adapter; `None` if they never
    /// do.
    pub direct_from: Option<u64>,
    /// Number of segments of all potential links from which on Barnes-Hut by the bound runs on the
    /// adapter; `None` if it never does.
    pub barnes_hut_from: Option<u64>,
}

impl DevicePlan {
    fn of(offer: Offer<'_>, chosen: bool, forecast: Option<Forecast>) -> DevicePlan {
        let from = |sum: fn(&Calibration) -> SumCost| match offer.requested {
            true => Some(0),
            false => sum(offer.calibration?).break_even(),
        };
        DevicePlan {
            adapter: offer.adapter.into(),
            chosen,
            adapter_ms: forecast.map(|f| f.adapter_ms),
            adapter_error_factor: forecast.map(|f| f.error_factor),
            cpu_ms: forecast.map(|f| f.cpu_ms),
            direct_from: from(|c| c.direct),
            barnes_hut_from: from(|c| c.barnes_hut),
        }
    }
}

impl Plan {
    /// Plans a frame, for the threads of the rayon pool in which it is called, on the CPU alone.
    ///
    /// Cost: the boxes and the search of a verification, then a sample of the links: 64 of them, or
    /// all if there are fewer, drawn with probability proportional to their number of segments.
    /// Each sampled link visits some hundred node pairs per level of its trees. The sample takes a
    /// few milliseconds for curves of any length.
    pub fn of(set: &CurveSet) -> Plan {
        Plan::of_filter(set, None, None)
    }

    /// Plans a frame of a session with these options, of which the device and the periodic cell
    /// count.
    ///
    /// Cost: as for [`Plan::of`], for the curves and for the images that may meet.
    ///
    /// # Errors
    ///
    /// The errors of [`Session::new`](crate::Session::new); curves that span too many cells;
    /// [`Error::TooManyPairs`](crate::Error::TooManyPairs).
    ///
    /// ```
    /// use linkwatch::{Plan, SessionOptions, scenes::Scene};
    ///
    /// let sheet: Scene = "chainmail:rows=4,columns=4".parse()?;
    /// let options = SessionOptions {
    ///     cell: Some("4,0,0".parse()?),
    ///     ..SessionOptions::default()
    /// };
    /// let plan = Plan::with(&sheet.build()?.curves, &options)?;
    /// assert!(plan.images.unwrap().potential_links > 0);
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn with(set: &CurveSet, options: &SessionOptions) -> Result<Plan> {
        options.check()?;
        if let Some(cell) = &options.cell {
            let mut plan = Plan::of(set);
            let images = ImagePlan::of(set, cell, options.max_pairs)?;
            plan.total = plan.total + images.predicted;
            plan.images = Some(images);
            return Ok(plan);
        }
        let gpu = GpuUse::open(&options.device, options.calibration.as_ref())?;
        Ok(Plan::of_filter(set, gpu.tested_offer(), None))
    }

    /// Plans a frame in which only the pairs of a filter, or all pairs, are verified.
    fn of_filter(set: &CurveSet, offer: Option<Offer<'_>>, filter: Option<PairFilter>) -> Plan {
        let threads = rayon::current_num_threads();
        let mut trees = Trees::default();
        trees.refit(set);
        let mut search = LinkSearch::new(filter);
        let degenerate: Vec<_> = degenerate_curves(set).collect();
        search.find_links(set, trees.roots(), &degenerate);
        let links = search.pairs();
        let workspaces = Workspaces::default();
        let input = Input {
            set,
            trees: &trees,
            workspaces: &workspaces,
        };
        let predictions = Predictions::new(input, links, Method::Auto);
        let choice = predictions.choose(offer);
        let sample = *predictions.sample();
        let busy_threads = busy_threads(links.len(), set.segments(), sample.shared);
        let long = match choice {
            Choice::SumFirst => predictions.long(),
            Choice::CountOnCpu | Choice::CountOnGpu => &[],
        };
        let device = offer.map(|offer| {
            let forecast = offer.calibration.and_then(|c| predictions.forecast(c));
            DevicePlan::of(offer, choice == Choice::CountOnGpu, forecast)
        });
        let curves = || set.curves().iter().filter(|curve| curve.closed);
        let closed = curves().count();
        let segments: usize = curves().map(|curve| curve.segments as usize).sum();
        let whole = closed - degenerate.len();
        let potential_links = links.len() + search.discarded;
        let boxes = costs::boxes(set.basis(), closed, segments);
        let searching = costs::potential_links(closed, search.steps(), potential_links);
        let read = 3 * set.points() * set.precision().bytes() + trees.bytes();
        let time = costs::direction(links.len(), sample.work)
            + costs::discretization(sample.work)
            + with_sums(costs::crossings(segments, sample.work, read), long);
        let chosen = device.as_ref().filter(|d| d.chosen);
        let linking = match chosen.and_then(|d| d.adapter_ms) {
            Some(ms) => Prediction {
                one_thread_ms: ms,
                ms,
            },
            None => Prediction::of(time, busy_threads.max(1)),
        };
        let boxing_threads = match refits_in_parallel(segments) {
            true => threads,
            false => 1,
        };
        let boxes = Prediction::of(boxes, boxing_threads);
        let searching = Prediction::of(searching, LinkSearch::tasks(whole).clamp(1, threads));
        let formula =
            |&&(i, j): &&(u32, u32)| by_formula([i, j].map(|i| trees.of(set, i as usize)));
        Plan {
            threads,
            curves: set.len(),
            segments: set.segments(),
            open_curves: set.len() - closed,
            degenerate_curves: degenerate.len(),
            pairs: whole as u64 * (whole as u64).saturating_sub(1) / 2,
            potential_links,
            discarded: search.discarded,
            splines: !set.basis().is_polyline(),
            by_formula: links.par_iter().filter(formula).count(),
            kernel: match choice {
                Choice::SumFirst => Method::Fmm,
                Choice::CountOnCpu | Choice::CountOnGpu => Method::Crossings,
            },
            summed: long.len(),
            busy_threads,
            sampled: sample.links,
            tests: sample.work.tests,
            overlaps: sample.work.overlaps,
            device,
            images: None,
            boxes,
            search: searching,
            links: linking,
            total: boxes + searching + linking,
        }
    }
}

impl ImagePlan {
    fn of(set: &CurveSet, cell: &Cell, most: usize) -> Result<ImagePlan> {
        let boxes = FractionalBoxes::new(&Boxer::new(set, cell)?);
        let periods = (0..set.len()).map(|i| period(set, i, cell));
        let periods: Arc<[_]> = periods.collect();
        let searched = Searched {
            curves: set.curves(),
            periods: &periods,
            open_too: false,
            most,
        };
        let pairs = ImagePairs::find(&boxes, cell, &searched, [])?;
        let mut translated = None;
        if !pairs.curves.is_empty() {
            let set = Arc::new(set.clone());
            CurveSet::translate(&set, &pairs.curves, cell, &mut translated)?;
        }
        let translated = translated.as_ref();
        let points = translated.map_or(0, CurveSet::points);
        let plan = translated.map(|curves| Plan::of_filter(curves, None, Some(pairs.filter())));
        let prepared = costs::images(set.points(), points);
        let prepared = Prediction::of(prepared, rayon::current_num_threads());
        let (links, total) = plan.map_or_else(Default::default, |p| (p.potential_links, p.total));
        Ok(ImagePlan {
            curves: pairs.curves.len(),
            potential_links: links,
            yarns: pairs.state.yarns.len(),
            predicted: prepared + total,
        })
    }
}
