//! What a scene needs, and no more: which way every stage goes, why, and what it will cost.
//!
//! ```
//! use linkwatch::{Plan, scenes::Scene};
//!
//! let scene: Scene = "ribbon:segments=2000".parse()?;
//! let plan = Plan::of(&scene.build()?.curves);
//! assert_eq!(plan.potential_links.links, 1);
//! println!("{plan}");
//! # Ok::<(), linkwatch::Error>(())
//! ```
//!
//! A plan asks the stages themselves which way they will go, so what it says is what runs. Its times are counts of
//! work times the constants of one table: they depend on the curves and on the number of threads alone, not on the
//! clock. The counts of the first stages are those of the scene; those of the linking numbers are extrapolated from
//! a sample (see [`Plan::of`]).
//!
//! With a device ([`Plan::on`]), a plan also says whether crossings are counted on an adapter. What an adapter takes follows from
//! the same counts and from what was measured on it (`calibrate`); the processor beside it is taken as it was measured then, times
//! one factor.
//!
//! The table was measured on one machine; another one is faster or slower throughout. A prediction is for frames
//! after the first, whose buffers are in place.
//!
//! # Predicted and measured
//!
//! All generated scenes with their defaults, on a shared cloud machine (AMD EPYC with AVX2, two cores, 32 MB of cache):
//! milliseconds predicted / measured by `linkwatch --threads 1 plan SCENE --repeat 11`. The measured total is
//! processor time; links are the direction, the discretization and the kernel together.
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
//! The constants were fitted to these scenes and to two garments (1.08 and 1.25), so the table says how well the
//! model fits, not how well it does on what it never saw. Search times of some hundredths of a millisecond are
//! off by up to 2. On several threads, a prediction is for as many idle processors.
//!
//! Not in the model: other caches than the last, and processors without AVX2, where all takes longer. Where more than
//! 64 potential links differ much, a rare one of much work may be missed by the sample.

#[cfg(feature = "gpu")]
mod calibrate;
mod choice;
mod costs;
mod message;
#[cfg(test)]
mod tests;

#[cfg(feature = "gpu")]
pub use calibrate::calibrate;
pub(crate) use choice::{LongLink, Way, goes_to_adapter};

use self::choice::{Forecast, worth_summing};
use crate::curve::CurveSet;
use crate::error::Result;
use crate::kernels::crossings::{Scene, Workspaces, by_formula, sample, shares_out};
use crate::kernels::{Accelerator, Calibration, Device, KernelWork, Method, Offer, SumCost};
use crate::pairs::{CurveTree, LinkSearch, Pair, Trees};
use crate::verifier::{degenerate_curves, links_per_task, potential_links};
use rayon::prelude::*;
use serde::Serialize;

/// Potential links that stand for all of them where there are more.
const SAMPLE: usize = 64;

/// What a scene needs, stage by stage. Displayed as a line a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Threads that the plan is for.
    pub threads: usize,
    /// Splines to polylines.
    pub discretization: Discretization,
    /// Boxes of all segments, and the trees over them.
    pub boxes: Boxes,
    /// Which pairs of curves may be linked.
    pub potential_links: PotentialLinks,
    /// Along which axis crossings are counted.
    pub direction: Directions,
    /// The linking numbers themselves.
    pub kernel: KernelPlan,
    /// Memory beside the curves, in bytes: boxes, search, and candidates that wait.
    pub bytes: usize,
    /// All stages together.
    pub predicted: Prediction,
}

/// Predicted time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Prediction {
    /// On one thread, in milliseconds.
    pub one_thread_ms: f64,
    /// On the threads of the plan, in milliseconds: the time on one, divided by how many of them have something to
    /// do.
    pub ms: f64,
}

/// How splines become polylines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Discretization {
    /// The choice.
    pub choice: DiscretizationChoice,
    /// What it costs.
    pub predicted: Prediction,
}

/// Ways from splines to polylines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DiscretizationChoice {
    /// There is nothing to do: the curves are polylines.
    None,
    /// Every pair by itself, where the hulls of its segments meet.
    PairByPair,
}

/// Boxes and trees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Boxes {
    /// Segments of all curves.
    pub segments: usize,
    /// Levels of the deepest tree.
    pub levels: u8,
    /// Closed curves for which the boxes of single segments are stored: splines, and small curves, which many pairs
    /// visit for their size. Those of other polylines are computed where they are needed.
    pub stored_leaves: usize,
    /// Closed curves for which they are computed.
    pub computed_leaves: usize,
    /// Curves of so many segments that each is shared out among threads.
    pub shared_curves: usize,
    /// Bytes of the boxes.
    pub bytes: usize,
    /// What they cost.
    pub predicted: Prediction,
}

/// Potential links.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PotentialLinks {
    /// Curves of the scene.
    pub curves: usize,
    /// Open curves: left out, as they have no linking numbers.
    pub open_curves: usize,
    /// Closed curves of fewer than three distinct points: left out, as they bound nothing.
    pub degenerate_curves: usize,
    /// Pairs of the others.
    pub pairs: u64,
    /// Those of them whose boxes overlap; all others are unlinked.
    pub links: usize,
    /// The choice.
    pub search: Search,
    /// Groups of eight boxes that are compared with a box.
    pub steps: u64,
    /// Bytes of the search and of what it finds.
    pub bytes: usize,
    /// What it costs.
    pub predicted: Prediction,
}

/// How potential links are found. It is one way in the program; what differs is whether it has anything to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Search {
    /// There is at most one pair.
    Trivial,
    /// Boxes are sorted along an axis and swept.
    Sweep,
}

/// How directions of projection are chosen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Directions {
    /// Potential links of two small loops: a formula on their boxes.
    pub by_formula: usize,
    /// Potential links that get the best of six directions, in a breadth-first pass over both trees.
    pub best_of_six: usize,
    /// What it costs.
    pub predicted: Prediction,
}

/// How linking numbers are computed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KernelPlan {
    /// The choice, where none is asked for ([`Method::Auto`]).
    pub choice: Kernel,
    /// Links on which another kernel than counting goes first.
    pub summed: usize,
    /// What threads share.
    pub parallelism: Parallelism,
    /// Threads that will have something to do.
    pub busy_threads: usize,
    /// Potential links that were looked into.
    pub sampled: usize,
    /// KernelWork of all potential links, extrapolated from these.
    pub work: KernelWork,
    /// What it costs beside the choice of directions and the discretization. Where crossings are counted on an adapter that
    /// was measured, what that takes, with the choice of directions.
    pub predicted: Prediction,
    /// The adapter, where there is one to choose.
    pub device: Option<DevicePlan>,
}

/// An adapter, and what goes there.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DevicePlan {
    /// Its name.
    pub adapter: String,
    /// Whether crossings are counted on it; else on the processor. Those of splines always are.
    pub chosen: bool,
    /// What counting is predicted to take there, in milliseconds, with the choice of directions; none where it was never
    /// measured, and for splines.
    pub adapter_ms: Option<f64>,
    /// By what factor that is off, typically: crossings are counted on an adapter that is ours to choose where it wins by more.
    pub adapter_misfit: Option<f64>,
    /// What linking numbers are predicted to take on this processor, likewise.
    pub processor_ms: Option<f64>,
    /// Pairs of segments from which on direct sums go there; none where they never do.
    pub direct_from: Option<u64>,
    /// Segments of all potential links from which on Barnes-Hut by the bound goes there.
    pub barnes_hut_from: Option<u64>,
}

impl DevicePlan {
    fn of(offer: Offer<'_>, chosen: bool, forecast: Option<Forecast>) -> DevicePlan {
        let from = |sum: fn(&Calibration) -> SumCost| match offer.asked_for {
            true => Some(0),
            false => sum(offer.calibration?).break_even(),
        };
        DevicePlan {
            adapter: offer.adapter.into(),
            chosen,
            adapter_ms: forecast.map(|f| f.adapter_ms),
            adapter_misfit: forecast.map(|f| f.misfit),
            processor_ms: forecast.map(|f| f.processor_ms),
            direct_from: from(|c| c.direct),
            barnes_hut_from: from(|c| c.barnes_hut),
        }
    }
}

/// Kernels that go first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Kernel {
    /// Counting crossings, exactly, on every link.
    Crossings,
    /// The fast multipole method on links of long curves that cross very often; crossings are counted on the others, and
    /// where its bound decides nothing.
    Fmm,
}

/// What the threads of the kernel share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Parallelism {
    /// Nothing: too little to share, or one thread.
    None,
    /// Potential links.
    OverLinks,
    /// Few potential links, each of which is much work that is itself shared out.
    InsideLinks,
}

impl Plan {
    /// The plan for a frame, on the threads of the rayon pool that it is called in, with no other device than the processor.
    ///
    /// Cost: the boxes and the search of a verification, then a sample of the links. It is drawn evenly along the list,
    /// on which each takes as much room as it has segments: 64 of them, or all where there are no more; and of each
    /// some hundred node pairs a level of its trees. That is a few milliseconds, whatever the length of the curves.
    pub fn of(set: &CurveSet) -> Plan {
        Plan::with(set, None)
    }

    /// The plan for a frame of a verifier with this device ([`Verifier::set_device`](crate::Verifier::set_device)).
    ///
    /// Errors: [`Error::Device`](crate::Error::Device) where it was asked for and there is none of that name, or none that can
    /// be used.
    pub fn on(set: &CurveSet, device: &Device) -> Result<Plan> {
        let accelerator = Accelerator::open(device)?;
        let offer = accelerator.offer().filter(|_| accelerator.answers());
        Ok(Plan::with(set, offer))
    }

    fn with(set: &CurveSet, offer: Option<Offer<'_>>) -> Plan {
        let threads = rayon::current_num_threads();
        let mut trees = Trees::default();
        trees.refit(set);
        let mut search = LinkSearch::default();
        let degenerate: Vec<_> = degenerate_curves(set).collect();
        let links = &*potential_links(&trees, &mut search, &degenerate);
        let workspaces = Workspaces::default();
        let scene = Scene {
            set,
            trees: &trees,
            workspaces: &workspaces,
        };
        let sample = Sample::of(scene, links);
        let mut long = worth_summing(scene, links);
        let way = Way::of(scene, links, Method::Auto, offer);
        let on_adapter = matches!(way, Way::Count { on_adapter: true });
        let device = offer.map(|offer| {
            let forecast = (offer.calibration).filter(|_| set.basis().is_polyline());
            let forecast = forecast.map(|c| Forecast::of(scene, links, &long, &sample, c));
            DevicePlan::of(offer, on_adapter, forecast)
        });
        if on_adapter {
            long.clear();
        }
        let formula = |&&(i, j): &&Pair| {
            by_formula([i, j].map(|i| -> CurveTree<'_> { trees.of(set, i as usize) }))
        };
        let by_formula = links.par_iter().filter(formula).count();
        let links = links.len();
        let closed = || (0..set.len()).filter(|&i| set.curve(i).closed);
        let whole = closed().count() - degenerate.len();
        let segments: usize = closed().map(|i| set.curve(i).segments as usize).sum();
        let stored_leaves = closed()
            .filter(|&i| trees.of(set, i).stores_leaves())
            .count();
        let busy_boxes = if Trees::shares_out(segments) {
            threads
        } else {
            1
        };
        let boxes = Boxes {
            segments: set.segments(),
            levels: closed()
                .map(|i| trees.of(set, i).root().level + 1)
                .max()
                .unwrap_or(0),
            stored_leaves,
            computed_leaves: closed().count() - stored_leaves,
            shared_curves: closed()
                .filter(|&i| Trees::shares_out(set.curve(i).segments as usize))
                .count(),
            bytes: trees.bytes(),
            predicted: costs::boxes(set.basis(), closed().count(), segments).on(busy_boxes),
        };
        let pairs = whole as u64 * (whole as u64).saturating_sub(1) / 2;
        let potential_links = PotentialLinks {
            curves: set.len(),
            open_curves: set.len() - closed().count(),
            degenerate_curves: degenerate.len(),
            pairs,
            links,
            search: if pairs <= 1 {
                Search::Trivial
            } else {
                Search::Sweep
            },
            steps: search.steps(),
            bytes: search.bytes(),
            predicted: costs::potential_links(closed().count(), search.steps(), links)
                .on(LinkSearch::tasks(whole).clamp(1, threads)),
        };
        let (parallelism, busy_threads) = parallelism(links, threads, sample.shared);
        let work = sample.work;
        let coordinates = 3 * set.points() * set.precision().bytes();
        let busy = busy_threads.max(1);
        let discretization = Discretization {
            choice: if set.basis().is_polyline() {
                DiscretizationChoice::None
            } else {
                DiscretizationChoice::PairByPair
            },
            predicted: costs::discretization(work).on(busy),
        };
        let mut direction = Directions {
            by_formula,
            best_of_six: links - by_formula,
            predicted: costs::direction(links, work).on(busy),
        };
        let time = costs::crossings(segments, work, coordinates + boxes.bytes).with_sums(&long);
        let mut kernel = KernelPlan {
            choice: match long[..] {
                [] => Kernel::Crossings,
                _ => Kernel::Fmm,
            },
            summed: long.len(),
            parallelism,
            busy_threads,
            sampled: sample.links,
            work,
            predicted: time.on(busy),
            device,
        };
        let forecast = kernel.device.as_ref().filter(|d| d.chosen);
        if let Some(ms) = forecast.and_then(|d| d.adapter_ms) {
            // Directions are a part of it.
            direction.predicted = Prediction::default();
            kernel.predicted = Prediction {
                one_thread_ms: ms,
                ms,
            };
        }
        // Candidates of splines wait for their pair's discretization; those of polylines do not.
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
            predicted: Prediction {
                one_thread_ms: stages.iter().map(|p| p.one_thread_ms).sum(),
                ms: stages.iter().map(|p| p.ms).sum(),
            },
        }
    }
}

/// What threads share in the kernel, and how many of them have something to do.
fn parallelism(links: usize, threads: usize, shared: bool) -> (Parallelism, usize) {
    let tasks = links.div_ceil(links_per_task(links, threads));
    match (threads, tasks) {
        (1, _) | (_, 0) => (Parallelism::None, threads.min(tasks)),
        _ if tasks < threads && shared => (Parallelism::InsideLinks, threads),
        (_, 1) => (Parallelism::None, 1),
        _ => (Parallelism::OverLinks, threads.min(tasks)),
    }
}

/// What a part of the potential links says of all of them.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Potential links looked into.
    links: usize,
    /// KernelWork of all.
    work: KernelWork,
    /// Whether one of them shares itself out.
    shared: bool,
    /// Tests of the one that takes most.
    most_tests: u64,
}

impl Sample {
    fn of(scene: Scene<'_>, links: &[Pair]) -> Sample {
        let drawn = draw(links.len(), |k| {
            let (i, j) = links[k];
            [i, j]
                .map(|i| u64::from(scene.set.curve(i as usize).segments))
                .iter()
                .sum()
        });
        let works: Vec<(KernelWork, f64)> = drawn
            .par_iter()
            .map(|&(k, factor)| {
                let mut workspace = scene.workspaces.take();
                let work = sample(scene, links[k], &mut workspace);
                // What is looked at is not done.
                workspace.take_stats();
                scene.workspaces.put(workspace);
                (work, factor)
            })
            .collect();
        let each = || works.iter().map(|(work, _)| work);
        Sample {
            links: works.len(),
            work: works
                .iter()
                .map(|(work, factor)| work.scaled(*factor))
                .sum(),
            shared: each().any(|work| shares_out(work.nodes + work.computed, work.tests)),
            most_tests: each().map(|work| work.tests).max().unwrap_or(0),
        }
    }
}

/// Numbers below `count`, sorted, and what each has to be multiplied by so that their sum stands for all: all of
/// them where they are few, else [`SAMPLE`] drawn at even distances along a line on which each takes the room that
/// `weight` says (systematic sampling with probability proportional to size).
fn draw(count: usize, weight: impl Fn(usize) -> u64) -> Vec<(usize, f64)> {
    if count <= SAMPLE {
        return (0..count).map(|k| (k, 1.0)).collect();
    }
    let total: u64 = (0..count).map(&weight).sum();
    let step = total as f64 / SAMPLE as f64;
    let mut drawn: Vec<(usize, f64)> = Vec::with_capacity(SAMPLE);
    let (mut end, mut next) = (0, 0.5 * step);
    for k in 0..count {
        let own = weight(k);
        end += own;
        let mut times = 0;
        while next < end as f64 {
            times += 1;
            next += step;
        }
        if times > 0 {
            drawn.push((k, f64::from(times) * step / own as f64));
        }
    }
    drawn
}
