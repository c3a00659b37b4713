//! Measurement of the kernels on an adapter and on the CPU: whole frames, and frames whose vertices
//! are uploaded already.

use super::barnes_hut::{self, Forest};
use super::frame::Frame;
use super::precision::{GpuPrecision, Real};
use super::{Device, Gpu, direct};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::crossings::{Input, Workspaces, linking_numbers};
use crate::kernels::{Accuracy, Counted, Estimate, GpuUse, Method};
use crate::pairs::{LinkSearch, Pair, Trees};
use std::sync::atomic::AtomicU64;
use std::time::Instant;

/// Measured times of a kernel: medians, in milliseconds.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DeviceTimes {
    /// The kernel.
    pub kernel: Method,
    /// Precision of the adapter.
    pub precision: GpuPrecision,
    /// Number of pairs of curves.
    pub links: usize,
    /// Number of segment pairs, over all pairs of curves.
    pub segment_pairs: u64,
    /// Time of a whole frame: preparation and upload of vertices and work lists, the kernel,
    /// download and evaluation of the results.
    pub whole_ms: f64,
    /// Time with the vertices (and trees) prepared and uploaded before.
    pub resident_ms: f64,
    /// Time of the same kernel on all CPU threads. `None` if it would take too long.
    pub cpu_ms: Option<f64>,
    /// Largest difference between a sum and the linking number.
    pub largest_error: f64,
    /// Number of undecided results: sums that prove no integer; for crossings, tests of segments.
    pub undecided: u64,
    /// True if all decided numbers agree with the exact count on the CPU.
    pub equal: bool,
}

impl DeviceTimes {
    /// Returns true if a whole frame is faster than on the CPU, or if the CPU would take too long
    /// to measure.
    pub fn is_faster(&self) -> bool {
        self.cpu_ms.is_none_or(|ms| self.whole_ms < ms)
    }
}

/// Measures kernels on a set of curves: those of [`Method::Crossings`], [`Method::Direct`] and
/// [`Method::BarnesHut`] that `kernels` contains. Splines are converted to polylines first; that
/// time is not measured. Sums on the CPU that would take longer than `limit_s` are skipped.
///
/// Errors: [`Error::Device`]; errors of the discretization.
pub fn measure(
    device: &Device,
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
    let input = Input {
        set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let measurement = Measurement {
        gpu: &gpu,
        input,
        pairs,
        repeat: repeat.max(1),
        limit_s,
    };
    let one = |kernel: &Method| match kernel {
        Method::Crossings => vec![measurement.crossings()],
        Method::Direct if gpu.computes_in_double() => {
            vec![measurement.direct::<f32>(), measurement.direct::<f64>()]
        }
        Method::Direct => vec![measurement.direct::<f32>()],
        Method::BarnesHut => vec![measurement.barnes_hut()],
        _ => Vec::new(),
    };
    let each = kernels.iter().flat_map(one);
    let failed = |e: super::Error| Error::Device(e.to_string());
    each.map(|times| times.map_err(failed)).collect()
}

struct Measurement<'a> {
    gpu: &'a Gpu,
    input: Input<'a>,
    pairs: &'a [Pair],
    repeat: u32,
    limit_s: f64,
}

impl Measurement<'_> {
    /// Returns the median time of a run and the result of the last run.
    fn timed<T>(
        &self,
        mut run: impl FnMut() -> Result<T, super::Error>,
    ) -> Result<(f64, T), super::Error> {
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
        let segments = |i: u32| u64::from(self.input.set.curve(i as usize).segments);
        let each = self.pairs.iter().map(|&(i, j)| segments(i) * segments(j));
        each.sum()
    }

    /// Returns the exact linking numbers, counted on the CPU.
    fn count(&self) -> Counted {
        let mut parts = Vec::new();
        linking_numbers(self.input, self.pairs, &mut parts, &AtomicU64::new(0));
        Counted::joined(parts)
    }

    fn crossings(&self) -> Result<DeviceTimes, super::Error> {
        let frame = Frame::new(self.input.set);
        let resident = || self.gpu.count(&frame, self.input, self.pairs, None);
        // The first run compiles the shaders and allocates the buffers.
        resident()?;
        let (resident_ms, _) = self.timed(resident)?;
        let (whole_ms, ((found, undecided), _)) = self.timed(|| {
            let frame = Frame::new(self.input.set);
            self.gpu.send(&frame)?;
            self.gpu.count(&frame, self.input, self.pairs, None)
        })?;
        let (cpu_ms, exact) = self.timed(|| Ok(self.count()))?;
        let found = Counted::joined(found);
        Ok(DeviceTimes {
            kernel: Method::Crossings,
            precision: GpuPrecision::Single,
            links: self.pairs.len(),
            segment_pairs: self.segment_pairs(),
            whole_ms,
            resident_ms,
            cpu_ms: Some(cpu_ms),
            largest_error: 0.0,
            undecided,
            equal: (found.links, found.undefined) == (exact.links, exact.undefined),
        })
    }

    fn direct<R: Real>(&self) -> Result<DeviceTimes, super::Error> {
        let (set, pairs) = (self.input.set, self.pairs);
        // The frame is built before the lock is taken.
        let run = |frame: &Frame<R>| direct::linking_numbers(&mut self.gpu.lock(), frame, pairs);
        let frame = Frame::<R>::new(set);
        run(&frame)?;
        let (resident_ms, _) = self.timed(|| run(&frame))?;
        let whole = self.timed(|| run(&Frame::<R>::new(set)))?;
        self.sums((Method::Direct, R::PRECISION), resident_ms, whole)
    }

    fn barnes_hut(&self) -> Result<DeviceTimes, super::Error> {
        let (set, pairs) = (self.input.set, self.pairs);
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
        self.sums(
            (Method::BarnesHut, GpuPrecision::Single),
            resident_ms,
            whole,
        )
    }

    fn sums(
        &self,
        (kernel, precision): (Method, GpuPrecision),
        resident_ms: f64,
        (whole_ms, found): (f64, Vec<Estimate>),
    ) -> Result<DeviceTimes, super::Error> {
        /// Approximate time of a segment pair on one CPU thread, in nanoseconds.
        const PAIR_NS: f64 = 5.0;
        let threads = rayon::current_num_threads() as f64;
        let seconds = self.segment_pairs() as f64 * PAIR_NS * 1e-9 / threads;
        let none = GpuUse::default();
        let summation = || kernel.summation(self.input.set, Accuracy::default(), &none, self.pairs);
        let in_time = kernel == Method::BarnesHut || seconds < self.limit_s;
        let cpu_ms = match in_time {
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
            cpu_ms,
            largest_error,
            undecided: undecided as u64,
            equal,
        })
    }
}
