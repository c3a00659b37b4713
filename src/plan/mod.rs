//! Plan of a verification: the method of every stage, the reason, and the predicted cost.
//!
//! ```
//! use linkwatch::{Plan, scenes::Scene};
//!
//! let scene: Scene = "ribbon:segments=2000".parse()?;
//! let plan = Plan::of(&scene.build()?.curves);
//! assert_eq!(plan.potential_links.links, 1);
//! println!("{plan:#?}");
//! # Ok::<(), linkwatch::Error>(())
//! ```
//!
//! The decisions are those of the stages themselves, so the plan matches the run. Predicted times
//! are counts of work multiplied by the constants of one table. They depend only on the curves and
//! on the number of threads, not on the clock. The counts of the first stages are those of the
//! scene; those of the linking numbers are extrapolated from a sample (see [`Plan::of`]).
//!
//! With a device ([`Plan::on`]), a plan also reports if crossings are counted on a GPU. The time on
//! the GPU follows from the same counts and from measurements of the adapter ([`Calibration`]). The
//! time on the CPU is scaled by one factor from the same measurements.
//!
//! The table was measured on one machine; other machines are faster or slower by a factor. A
//! prediction applies to frames after the first, whose buffers are allocated.
//!
//! # Predicted and measured
//!
//! Times of all generated scenes with their defaults, on a shared cloud machine (AMD EPYC with
//! AVX2, two cores, 32 MB of cache): milliseconds predicted / measured by `linkwatch --threads 1
//! plan SCENE --repeat 11`. The measured total is CPU time; links are the direction, the
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
//! The constants were fitted to these scenes and to two garments (1.08 and 1.25), so the table
//! shows the quality of the fit, not the accuracy on other scenes. Search times of some hundredths
//! of a millisecond are wrong by up to a factor of 2. With several threads, a prediction assumes as
//! many idle cores.
//!
//! The model ignores caches except the last, and CPUs without AVX2, where all stages take longer.
//! If more than 64 potential links differ much, the sample may miss a rare one of much work.

#[cfg(test)]
mod tests;

pub use crate::kernels::crossings::Parallelism;

use crate::curve::{Cell, CurveSet};
use crate::engine::SessionOptions;
use crate::error::Result;
use crate::kernels::choice::costs::{self, Time};
use crate::kernels::choice::{Choice, Forecast, Predictions};
use crate::kernels::crossings::{Input, Workspaces, by_formula, parallelism};
use crate::kernels::{Calibration, Device, GpuUse, KernelWork, Method, Offer, SumCost};
use crate::pairs::{
    CurveTree, LinkSearch, Pair, PairFilter, SMALL, Trees, degenerate_curves, potential_links,
    refits_in_parallel,
};
use crate::periodic::{Boxer, FractionalBoxes, ImagePairs, Searched, period};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;

/// Plan of a verification, stage by stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Number of threads of the plan.
    pub threads: usize,
    /// Conversion of splines to polylines.
    pub discretization: Discretization,
    /// Boxes of all segments, and the trees over them.
    pub boxes: Boxes,
    /// Search for pairs of curves that may be linked.
    pub potential_links: PotentialLinks,
    /// Axis along which crossings are counted.
    pub direction: Directions,
    /// Computation of the linking numbers.
    pub kernel: KernelPlan,
    /// Linking numbers with periodic images, if there is a cell.
    pub images: Option<Images>,
    /// Memory in addition to the curves, in bytes: boxes, search, and pending candidates.
    pub bytes: usize,
    /// Cost of all stages together.
    pub predicted: Prediction,
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
    fn of(time: Time, threads: usize) -> Prediction {
        let one_thread_ms = time.ms();
        Prediction {
            one_thread_ms,
            ms: one_thread_ms / threads as f64,
        }
    }
}

/// Conversion of splines to polylines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Discretization {
    /// Chosen method.
    pub choice: DiscretizationChoice,
    /// Predicted cost.
    pub predicted: Prediction,
}

/// Methods that convert splines to polylines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DiscretizationChoice {
    /// Nothing to convert: the curves are polylines.
    None,
    /// Every pair separately, where the hulls of its segments overlap.
    PairByPair,
}

/// Boxes and trees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Boxes {
    /// Number of segments of all curves.
    pub segments: usize,
    /// Number of levels of the deepest tree.
    pub levels: u8,
    /// Number of closed curves for which the boxes of single segments are stored: splines, and
    /// small curves, which many pairs visit. The boxes of other polylines are computed on demand.
    pub stored_leaves: usize,
    /// Number of closed curves for which the boxes are computed on demand.
    pub computed_leaves: usize,
    /// Number of curves so long that several threads work on each.
    pub shared_curves: usize,
    /// Bytes of the boxes.
    pub bytes: usize,
    /// Predicted cost.
    pub predicted: Prediction,
}

/// Potential links.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PotentialLinks {
    /// Number of curves of the scene.
    pub curves: usize,
    /// Number of open curves. They are skipped, because they have no linking numbers.
    pub open_curves: usize,
    /// Number of closed curves of fewer than three distinct points. They are skipped.
    pub degenerate_curves: usize,
    /// Number of pairs of the other curves.
    pub pairs: u64,
    /// Number of these pairs whose boxes overlap. All others are unlinked.
    pub links: usize,
    /// Number of these links that the extents of the curves along diagonals prove to be 0. They are
    /// discarded.
    pub discarded: usize,
    /// Chosen method.
    pub search: Search,
    /// Number of comparisons of a box with a group of eight boxes.
    pub steps: u64,
    /// Bytes of the search and its result.
    pub bytes: usize,
    /// Predicted cost.
    pub predicted: Prediction,
}

/// Methods that find potential links.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Search {
    /// There is at most one pair.
    Trivial,
    /// Boxes are sorted along an axis and swept.
    Sweep,
}

/// Choice of the directions of projection.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Directions {
    /// Number of potential links of two small loops, which use a formula on their boxes.
    pub by_formula: usize,
    /// Maximum number of segments of a small loop.
    pub formula_segments: u32,
    /// Number of potential links that use the best of six directions, found by a breadth-first pass
    /// over both trees.
    pub best_of_six: usize,
    /// Predicted cost.
    pub predicted: Prediction,
}

/// Verification of the pairs of a curve and a periodic image, of another curve or of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Images {
    /// Number of curves and images that take part.
    pub curves: usize,
    /// Number of pairs whose boxes overlap. All others are unlinked.
    pub links: usize,
    /// Number of pairs of a closed curve and one that runs through the cell. Their linking numbers
    /// are not among the predicted cost.
    pub yarns: usize,
    /// Bytes of the translated curves, and of the boxes and the search.
    pub bytes: usize,
    /// Predicted cost of all stages of these pairs.
    pub predicted: Prediction,
}

/// Computation of the linking numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KernelPlan {
    /// Kernel that [`Method::Auto`] chooses.
    pub choice: Kernel,
    /// Number of links on which a kernel that sums runs first.
    pub summed: usize,
    /// Work that the threads share.
    pub parallelism: Parallelism,
    /// Number of busy threads.
    pub busy_threads: usize,
    /// Number of sampled potential links.
    pub sampled: usize,
    /// Work of all potential links, extrapolated from the sample.
    pub work: KernelWork,
    /// Predicted cost, without the choice of directions and the discretization. If crossings are
    /// counted on an adapter that was measured, its predicted cost, with the choice of directions.
    pub predicted: Prediction,
    /// Adapter, if there is one to choose.
    pub device: Option<DevicePlan>,
}

/// An adapter, and the work that is sent to it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DevicePlan {
    /// Name of the adapter.
    pub adapter: String,
    /// True if it counts the crossings, false if the CPU does. The crossings of splines are always
    /// counted on the CPU.
    pub chosen: bool,
    /// Predicted time of counting on the adapter, in milliseconds, with the choice of directions.
    /// `None` if it was never measured, and for splines.
    pub adapter_ms: Option<f64>,
    /// Typical error of that prediction, as a factor. With [`Device::Auto`], the adapter is used
    /// only if it wins by more than that.
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

/// Kernels that may run first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Kernel {
    /// Counts crossings of every link, exactly.
    Crossings,
    /// Runs the fast multipole method on links of long curves that cross very often. Crossings are
    /// counted for the others, and for links that its bound does not decide.
    Fmm,
}

impl Plan {
    /// Plans a frame, for the threads of the rayon pool in which it is called, on the CPU alone.
    ///
    /// Cost: the boxes and the search of a verification, then a sample of the links: 64 of them, or
    /// all if there are fewer, drawn with probability proportional to their number of segments.
    /// Each sampled link visits some hundred node pairs per level of its trees. The sample takes a
    /// few milliseconds for curves of any length.
    pub fn of(set: &CurveSet) -> Plan {
        Plan::with(set, None)
    }

    /// Plans a frame of a session with this device
    /// ([`SessionOptions::device`](crate::SessionOptions::device)).
    ///
    /// Errors: [`Error::Device`](crate::Error::Device) if a requested adapter does not exist or
    /// cannot be used.
    pub fn on(set: &CurveSet, device: &Device) -> Result<Plan> {
        let gpu = GpuUse::open(device)?;
        Ok(Plan::with(set, gpu.tested_offer()))
    }

    /// Plans a frame of a periodic scene, with the images of the curves. It runs on the CPU.
    ///
    /// Cost: as for [`Plan::of`], for the curves and for the images that may meet.
    ///
    /// Errors: [`Error::Usage`](crate::Error::Usage) if the cell is no lattice, or curves span too
    /// many cells; [`Error::TooManyPairs`](crate::Error::TooManyPairs) if more than
    /// [`SessionOptions::MAX_PAIRS`](crate::SessionOptions::MAX_PAIRS) may meet.
    ///
    /// ```
    /// use linkwatch::{Cell, Plan, scenes::Scene};
    ///
    /// let sheet: Scene = "chainmail:rows=4,columns=4".parse()?;
    /// let cell: Cell = "4,0,0".parse()?;
    /// let plan = Plan::in_cell(&sheet.build()?.curves, &cell)?;
    /// assert!(plan.images.unwrap().links > 0);
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn in_cell(set: &CurveSet, cell: &Cell) -> Result<Plan> {
        let mut plan = Plan::of(set);
        let images = Images::of(set, cell)?;
        plan.bytes += images.bytes;
        plan.predicted.one_thread_ms += images.predicted.one_thread_ms;
        plan.predicted.ms += images.predicted.ms;
        plan.images = Some(images);
        Ok(plan)
    }

    fn with(set: &CurveSet, offer: Option<Offer<'_>>) -> Plan {
        Plan::of_filter(set, offer, None)
    }

    /// Plans a frame of which only the pairs of a filter is verified, or all.
    fn of_filter(set: &CurveSet, offer: Option<Offer<'_>>, filter: Option<PairFilter>) -> Plan {
        let threads = rayon::current_num_threads();
        let mut trees = Trees::default();
        trees.refit(set);
        let mut search = LinkSearch::new(filter);
        let degenerate: Vec<_> = degenerate_curves(set).collect();
        potential_links(set, &trees, &mut search, &degenerate);
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
        let (parallelism, busy_threads) = parallelism(links.len(), set.segments(), sample.shared);
        let busy = busy_threads.max(1);
        let boxes = Boxes::of(set, &trees, threads);
        let potential_links = PotentialLinks::of(set, &search, degenerate.len(), threads);
        let discretization = Discretization {
            choice: match set.basis().is_polyline() {
                true => DiscretizationChoice::None,
                false => DiscretizationChoice::PairByPair,
            },
            predicted: Prediction::of(costs::discretization(sample.work), busy),
        };
        let mut direction = Directions::of(set, &trees, links);
        direction.predicted = Prediction::of(costs::direction(links.len(), sample.work), busy);
        let long = match choice {
            Choice::SumFirst => predictions.long(),
            Choice::CountOnCpu | Choice::CountOnGpu => &[],
        };
        let bytes = 3 * set.points() * set.precision().bytes() + boxes.bytes;
        let time = costs::crossings(closed_segments(set), sample.work, bytes).with_sums(long);
        let mut kernel = KernelPlan {
            choice: match choice {
                Choice::SumFirst => Kernel::Fmm,
                Choice::CountOnCpu | Choice::CountOnGpu => Kernel::Crossings,
            },
            summed: long.len(),
            parallelism,
            busy_threads,
            sampled: sample.links,
            work: sample.work,
            predicted: Prediction::of(time, busy),
            device: offer.map(|offer| {
                let forecast = offer.calibration.and_then(|c| predictions.forecast(c));
                DevicePlan::of(offer, choice == Choice::CountOnGpu, forecast)
            }),
        };
        let chosen = kernel.device.as_ref().filter(|d| d.chosen);
        if let Some(ms) = chosen.and_then(|d| d.adapter_ms) {
            // The cost of the adapter includes the choice of directions.
            direction.predicted = Prediction::default();
            kernel.predicted = Prediction {
                one_thread_ms: ms,
                ms,
            };
        }
        // Candidates of splines are kept until the discretization of their pair; those of polylines
        // are not.
        let waiting = match discretization.choice {
            DiscretizationChoice::None => 0,
            DiscretizationChoice::PairByPair => sample.most_tests as usize * busy_threads,
        };
        let stages = [
            discretization.predicted,
            boxes.predicted,
            potential_links.predicted,
            direction.predicted,
            kernel.predicted,
        ];
        Plan {
            threads,
            bytes: boxes.bytes + potential_links.bytes + waiting * size_of::<(u32, u32)>(),
            discretization,
            boxes,
            potential_links,
            direction,
            kernel,
            images: None,
            predicted: Prediction {
                one_thread_ms: stages.iter().map(|p| p.one_thread_ms).sum(),
                ms: stages.iter().map(|p| p.ms).sum(),
            },
        }
    }
}

/// Returns the closed curves.
fn closed(set: &CurveSet) -> impl Iterator<Item = usize> {
    (0..set.len()).filter(|&i| set.curve(i).closed)
}

/// Returns the number of segments of all closed curves.
fn closed_segments(set: &CurveSet) -> usize {
    closed(set).map(|i| set.curve(i).segments as usize).sum()
}

impl Images {
    fn of(set: &CurveSet, cell: &Cell) -> Result<Images> {
        cell.check()?;
        let boxes = FractionalBoxes::new(&Boxer::new(set, cell)?);
        let periods = (0..set.len()).map(|i| period(set, i, cell));
        let periods: Arc<[_]> = periods.collect();
        let searched = Searched {
            curves: set.curves(),
            periods: &periods,
            open_too: false,
            most: SessionOptions::MAX_PAIRS,
        };
        let margin = ImagePairs::margin(&boxes, cell);
        let pairs = ImagePairs::find(&boxes, cell, margin, &searched, [])?;
        let mut images = Images {
            curves: pairs.curves.len(),
            links: 0,
            yarns: pairs.yarns.len(),
            bytes: 0,
            predicted: Prediction::default(),
        };
        let mut translated = None;
        if !pairs.curves.is_empty() {
            let set = Arc::new(set.clone());
            CurveSet::translate(&set, &pairs.curves, cell, &mut translated)?;
        }
        if let Some(curves) = &translated {
            let plan = Plan::of_filter(curves, None, Some(pairs.filter));
            images.links = plan.potential_links.links;
            images.bytes = plan.bytes + 3 * curves.points() * curves.precision().bytes();
            images.predicted = plan.predicted;
        }
        let points = translated.map_or(0, |curves| curves.points());
        let threads = rayon::current_num_threads();
        let prepared = Prediction::of(costs::images(set.points(), points), threads);
        images.predicted.one_thread_ms += prepared.one_thread_ms;
        images.predicted.ms += prepared.ms;
        Ok(images)
    }
}

impl Boxes {
    fn of(set: &CurveSet, trees: &Trees, threads: usize) -> Boxes {
        let (curves, segments) = (closed(set).count(), closed_segments(set));
        let stored_leaves = closed(set)
            .filter(|&i| trees.of(set, i).stores_leaves())
            .count();
        let busy = match refits_in_parallel(segments) {
            true => threads,
            false => 1,
        };
        Boxes {
            segments: set.segments(),
            levels: closed(set)
                .map(|i| trees.of(set, i).root().level + 1)
                .max()
                .unwrap_or(0),
            stored_leaves,
            computed_leaves: curves - stored_leaves,
            shared_curves: closed(set)
                .filter(|&i| refits_in_parallel(set.curve(i).segments as usize))
                .count(),
            bytes: trees.bytes(),
            predicted: Prediction::of(costs::boxes(set.basis(), curves, segments), busy),
        }
    }
}

impl PotentialLinks {
    /// Describes the last search.
    fn of(set: &CurveSet, search: &LinkSearch, degenerate: usize, threads: usize) -> Self {
        let closed = closed(set).count();
        let whole = closed - degenerate;
        let pairs = whole as u64 * (whole as u64).saturating_sub(1) / 2;
        let discarded = search.discarded();
        let links = search.pairs().len() + discarded;
        let busy = LinkSearch::tasks(whole).clamp(1, threads);
        let time = costs::potential_links(closed, search.steps(), links);
        PotentialLinks {
            curves: set.len(),
            open_curves: set.len() - closed,
            degenerate_curves: degenerate,
            pairs,
            links,
            discarded,
            search: match pairs {
                0..=1 => Search::Trivial,
                _ => Search::Sweep,
            },
            steps: search.steps(),
            bytes: search.bytes(),
            predicted: Prediction::of(time, busy),
        }
    }
}

impl Directions {
    /// Counts the links by their choice of direction. Predicts no cost.
    fn of(set: &CurveSet, trees: &Trees, links: &[Pair]) -> Directions {
        let formula = |&&(i, j): &&Pair| {
            by_formula([i, j].map(|i| -> CurveTree<'_> { trees.of(set, i as usize) }))
        };
        let by_formula = links.par_iter().filter(formula).count();
        Directions {
            by_formula,
            formula_segments: SMALL,
            best_of_six: links.len() - by_formula,
            predicted: Prediction::default(),
        }
    }
}
