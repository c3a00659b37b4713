//! What kernels take on an adapter, beside the processor: whole frames, and frames whose vertices are there already.

use super::barnes_hut::{self, Forest};
use super::frame::Frame;
use super::{Choice, Gpu, Trouble, crossings, direct};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::crossings::{Scene, Workspaces, linking_number};
use crate::kernels::{Accelerator, Accuracy, Estimate, Linking, Method};
use crate::pairs::{LinkSearch, Pair, Trees};
use rayon::prelude::*;
use std::time::Instant;

/// What a kernel takes, in milliseconds: medians.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DeviceTimes {
    /// The kernel.
    pub kernel: Method,
    /// Pairs of curves.
    pub links: usize,
    /// Pairs of segments of all of them.
    pub segment_pairs: u64,
    /// Everything: vertices and lists made and sent up, the kernel, results back and read.
    pub whole_ms: f64,
    /// The same with the vertices, and trees where there are any, on the adapter.
    pub resident_ms: f64,
    /// The same kernel on the processor, all threads; none where it would take too long.
    pub processor_ms: Option<f64>,
    /// Largest difference of a sum from the linking number.
    pub largest_error: f64,
    /// Pairs that the adapter did not decide: sums that prove no integer; for crossings, tests of segments.
    pub undecided: u64,
    /// Whether no decided number differs from that of the processor's exact count.
    pub equal: bool,
}

impl DeviceTimes {
    /// Whether a whole frame takes less than on the processor, where that was measured; else it took too long.
    pub fn is_faster(&self) -> bool {
        self.processor_ms.is_none_or(|ms| self.whole_ms < ms)
    }
}

/// Measures kernels on a scene: those of [`Method::Crossings`], [`Method::Direct`] and [`Method::BarnesHut`] that are asked for. Splines are made polylines first, which is not measured. Sums on the processor
/// that would take longer than `limit_s` are left out.
///
/// Errors: [`Error::Device`]; those of the discretization.
pub fn measure(
    device: &Choice,
    set: &CurveSet,
    kernels: &[Method],
    repeat: u32,
    limit_s: f64,
) -> Result<Vec<DeviceTimes>> {
    let gpu = Gpu::shared(device).map_err(|e| Error::Device(e.to_string()))?;
    let discretized = match set.basis().is_polyline() {
        true => None,
        false => Some(homotopic_polylines(set)?.curves),
    };
    let set = discretized.as_ref().unwrap_or(set);
    let mut trees = Trees::default();
    trees.refit(set);
    let mut search = LinkSearch::default();
    let pairs = search.find(trees.roots());
    let whole = |i: u32| set.has_three_distinct_points(i as usize);
    pairs.retain(|&(i, j)| whole(i) && whole(j));
    let scene = Scene {
        set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let subject = Subject {
        gpu: &gpu,
        scene,
        pairs,
        repeat: repeat.max(1),
        limit_s,
    };
    let each = kernels.iter().filter_map(|kernel| match kernel {
        Method::Crossings => Some(subject.crossings()),
        Method::Direct => Some(subject.direct()),
        Method::BarnesHut => Some(subject.barnes_hut()),
        _ => None,
    });
    let failed = |e: Trouble| Error::Device(e.to_string());
    each.map(|times| times.map_err(failed)).collect()
}

struct Subject<'a> {
    gpu: &'a Gpu,
    scene: Scene<'a>,
    pairs: &'a [Pair],
    repeat: u32,
    limit_s: f64,
}

impl Subject<'_> {
    /// The median time of a run, and what the last one gave.
    fn timed<T>(&self, mut run: impl FnMut() -> Result<T, Trouble>) -> Result<(f64, T), Trouble> {
        let mut times = Vec::new();
        loop {
            let start = Instant::now();
            let found = run()?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
            if times.len() >= self.repeat as usize {
                times.sort_by(f64::total_cmp);
                return Ok((times[times.len() / 2], found));
            }
        }
    }

    fn segment_pairs(&self) -> u64 {
        let segments = |i: u32| u64::from(self.scene.set.curve(i as usize).segments);
        let each = self.pairs.iter().map(|&(i, j)| segments(i) * segments(j));
        each.sum()
    }

    /// The exact numbers, by the processor.
    fn count(&self) -> Vec<Linking> {
        let each = self.pairs.par_iter().map(|&pair| {
            let mut workspace = self.scene.workspaces.take();
            let linking = linking_number(self.scene, pair, None, &mut workspace);
            self.scene.workspaces.put(workspace);
            linking
        });
        each.collect()
    }

    fn crossings(&self) -> Result<DeviceTimes, Trouble> {
        let frame = Frame::new(self.scene.set);
        let resident = || crossings::linking_numbers(self.gpu, &frame, self.scene, self.pairs);
        // Programs are compiled, and buffers made.
        resident()?;
        let (resident_ms, _) = self.timed(resident)?;
        let (whole_ms, (found, _, undecided)) = self.timed(|| {
            let frame = self.gpu.send(self.scene.set)?;
            self.gpu.count(&frame, self.scene, self.pairs)
        })?;
        let (processor_ms, exact) = self.timed(|| Ok(self.count()))?;
        Ok(DeviceTimes {
            kernel: Method::Crossings,
            links: self.pairs.len(),
            segment_pairs: self.segment_pairs(),
            whole_ms,
            resident_ms,
            processor_ms: Some(processor_ms),
            largest_error: 0.0,
            undecided,
            equal: found == exact,
        })
    }

    fn direct(&self) -> Result<DeviceTimes, Trouble> {
        let engine = || self.gpu.lock();
        let (set, pairs) = (self.scene.set, self.pairs);
        let frame = Frame::new(set);
        let resident = || direct::linking_numbers(&mut engine(), &frame, pairs);
        resident()?;
        let (resident_ms, _) = self.timed(resident)?;
        let whole = || direct::linking_numbers(&mut engine(), &Frame::new(set), pairs);
        let whole = self.timed(whole)?;
        self.sums(Method::Direct, resident_ms, whole)
    }

    fn barnes_hut(&self) -> Result<DeviceTimes, Trouble> {
        let (set, pairs) = (self.scene.set, self.pairs);
        let run = |frame: &Frame, forest: &Forest| {
            barnes_hut::linking_numbers(&mut self.gpu.lock(), frame, forest, pairs, None)
        };
        let frame = Frame::new(set);
        let forest = Forest::new(&frame);
        run(&frame, &forest)?;
        let (resident_ms, _) = self.timed(|| run(&frame, &forest))?;
        let whole = self.timed(|| {
            let frame = Frame::new(set);
            run(&frame, &Forest::new(&frame))
        })?;
        self.sums(Method::BarnesHut, resident_ms, whole)
    }

    fn sums(
        &self,
        kernel: Method,
        resident_ms: f64,
        (whole_ms, found): (f64, Vec<Estimate>),
    ) -> Result<DeviceTimes, Trouble> {
        /// What a pair of segments takes one thread, about, in nanoseconds.
        const PAIR_NS: f64 = 5.0;
        let threads = rayon::current_num_threads() as f64;
        let seconds = self.segment_pairs() as f64 * PAIR_NS * 1e-9 / threads;
        let none = Accelerator::default();
        let summation = || kernel.summation(self.scene.set, Accuracy::default(), &none, self.pairs);
        let in_time = kernel == Method::BarnesHut || seconds < self.limit_s;
        let processor_ms = match in_time {
            true => {
                let run = || Ok(summation().map(|s| s.linking_numbers(self.pairs)));
                Some(self.timed(run)?.0)
            }
            false => None,
        };
        let (mut largest_error, mut equal) = (0f64, true);
        for (estimate, exact) in found.iter().zip(self.count()) {
            let Linking::Number(lambda) = exact else {
                equal &= estimate.integer().is_none();
                continue;
            };
            equal &= estimate.integer().is_none_or(|n| n == lambda);
            if estimate.bound < f64::INFINITY {
                largest_error = largest_error.max((estimate.value - lambda as f64).abs());
            }
        }
        let undecided = found.iter().filter(|e| e.integer().is_none()).count();
        Ok(DeviceTimes {
            kernel,
            links: self.pairs.len(),
            segment_pairs: self.segment_pairs(),
            whole_ms,
            resident_ms,
            processor_ms,
            largest_error,
            undecided: undecided as u64,
            equal,
        })
    }
}
