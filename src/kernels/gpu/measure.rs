//! What kernels take on an adapter, beside the processor: whole frames, and frames whose vertices are there already.

use super::barnes_hut::{self, Forest};
use super::frame::Frame;
use super::precision::{Precision, Real};
use super::{Choice, Gpu, Trouble, direct};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::crossings::{Scene, Workspaces, linking_number};
use crate::kernels::{Accelerator, Accuracy, Counted, Estimate, Method};
use crate::pairs::{LinkSearch, Pair, Trees};
use crate::verifier::links_per_task;
use rayon::prelude::*;
use std::time::Instant;

/// What a kernel takes, in milliseconds: medians.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DeviceTimes {
    /// The kernel.
    pub kernel: Method,
    /// What the adapter computes it in.
    pub precision: Precision,
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

/// Measures kernels on a scene: those of [`Method::Crossings`], [`Method::Direct`] and [`Method::BarnesHut`] that are asked for.
/// Splines are made polylines first, which is not measured. Sums on the processor that would take longer than `limit_s` are
/// left out.
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
    let one = |kernel: &Method| match kernel {
        Method::Crossings => vec![subject.crossings()],
        Method::Direct if gpu.computes_in_double() => {
            vec![subject.direct::<f32>(), subject.direct::<f64>()]
        }
        Method::Direct => vec![subject.direct::<f32>()],
        Method::BarnesHut => vec![subject.barnes_hut()],
        _ => Vec::new(),
    };
    let each = kernels.iter().flat_map(one);
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
    fn count(&self) -> Counted {
        let part = |pairs: &[Pair]| {
            let mut workspace = self.scene.workspaces.take();
            let mut part = Counted::default();
            for &pair in pairs {
                part.add(pair, linking_number(self.scene, pair, None, &mut workspace));
            }
            self.scene.workspaces.put(workspace);
            part
        };
        let size = links_per_task(self.pairs.len(), rayon::current_num_threads());
        Counted::joined(self.pairs.par_chunks(size).map(part).collect())
    }

    fn crossings(&self) -> Result<DeviceTimes, Trouble> {
        let frame = Frame::new(self.scene.set);
        let resident = || self.gpu.count(&frame, self.scene, self.pairs, None);
        // Programs are compiled, and buffers made.
        resident()?;
        let (resident_ms, _) = self.timed(resident)?;
        let (whole_ms, ((found, undecided), _)) = self.timed(|| {
            let frame = Frame::new(self.scene.set);
            self.gpu.send(&frame)?;
            self.gpu.count(&frame, self.scene, self.pairs, None)
        })?;
        let (processor_ms, exact) = self.timed(|| Ok(self.count()))?;
        let found = Counted::joined(found);
        Ok(DeviceTimes {
            kernel: Method::Crossings,
            precision: Precision::Single,
            links: self.pairs.len(),
            segment_pairs: self.segment_pairs(),
            whole_ms,
            resident_ms,
            processor_ms: Some(processor_ms),
            largest_error: 0.0,
            undecided,
            equal: (found.links, found.undefined) == (exact.links, exact.undefined),
        })
    }

    fn direct<R: Real>(&self) -> Result<DeviceTimes, Trouble> {
        let (set, pairs) = (self.scene.set, self.pairs);
        // A frame is made before the adapter is held.
        let run = |frame: &Frame<R>| direct::linking_numbers(&mut self.gpu.lock(), frame, pairs);
        let frame = Frame::<R>::new(set);
        run(&frame)?;
        let (resident_ms, _) = self.timed(|| run(&frame))?;
        let whole = self.timed(|| run(&Frame::<R>::new(set)))?;
        self.sums((Method::Direct, R::PRECISION), resident_ms, whole)
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
        self.sums((Method::BarnesHut, Precision::Single), resident_ms, whole)
    }

    fn sums(
        &self,
        (kernel, precision): (Method, Precision),
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
        let exact = self.count();
        for (&(i, j), estimate) in self.pairs.iter().zip(&found) {
            let undefined = &exact.undefined;
            if undefined
                .binary_search_by_key(&(i, Some(j)), |d| (d.i, d.j))
                .is_ok()
            {
                equal &= estimate.integer().is_none();
                continue;
            }
            let place = exact.links.binary_search_by_key(&(i, j), |l| (l.i, l.j));
            let lambda = place.map_or(0, |k| exact.links[k].lambda);
            equal &= estimate.integer().is_none_or(|n| n == lambda);
            if estimate.bound < f64::INFINITY {
                largest_error = largest_error.max((estimate.value - lambda as f64).abs());
            }
        }
        let undecided = found.iter().filter(|e| e.integer().is_none()).count();
        Ok(DeviceTimes {
            kernel,
            precision,
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
