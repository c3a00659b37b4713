//! What kernels take on an adapter, beside the processor: whole frames, and frames whose vertices are there already.

use super::barnes_hut::{self, Forest};
use super::calibration::Calibration;
use super::frame::Frame;
use super::precision::{Precision, Real};
use super::{Choice, Gpu, Trouble, direct};
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::crossings::{Scene, Workspaces, linking_number};
use crate::kernels::direct::{Direct, Formula};
use crate::kernels::{Accelerator, Accuracy, Counted, Estimate, Method, Summation};
use crate::pairs::{LinkSearch, Pair, Trees};
use crate::scenes::Scene as Model;
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

/// Measures the kernels on a scene. Splines are made polylines first, which is not measured. Sums on the processor
/// that would take longer than `limit_s` are left out.
///
/// Errors: [`Error::Device`]; those of the discretization.
pub fn measure(
    device: &Choice,
    set: &CurveSet,
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
    let mut each = vec![subject.crossings(), subject.direct::<f32>()];
    if gpu.computes_in_double() {
        each.push(subject.direct::<f64>());
    }
    each.push(subject.barnes_hut());
    let failed = |e: Trouble| Error::Device(e.to_string());
    each.into_iter()
        .map(|times| times.map_err(failed))
        .collect()
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
        let engine = || self.gpu.lock();
        let (set, pairs) = (self.scene.set, self.pairs);
        let frame = Frame::<R>::new(set);
        let resident = || direct::linking_numbers(&mut engine(), &frame, pairs);
        resident()?;
        let (resident_ms, _) = self.timed(resident)?;
        let whole = || direct::linking_numbers(&mut engine(), &Frame::<R>::new(set), pairs);
        let whole = self.timed(whole)?;
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
        let summation = || kernel.summation(self.scene.set, Accuracy::default(), &none);
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

/// Measures what a direct sum takes on an adapter and on the processor, on the threads of the rayon pool that it is called in.
///
/// Errors: [`Error::Device`].
pub fn calibrate(device: &Choice) -> Result<Calibration> {
    let failed = |e: Trouble| Error::Device(e.to_string());
    let gpu = Gpu::shared(device).map_err(failed)?;
    let info = gpu.info();
    let time = |text: &str, on_adapter: bool| -> Result<f64> {
        let set = text.parse::<Model>()?.build()?.curves;
        let mut times = Vec::new();
        for run in 0..6 {
            let start = Instant::now();
            if on_adapter {
                let frame = Frame::<f32>::new(&set);
                direct::linking_numbers(&mut gpu.lock(), &frame, &[(0, 1)]).map_err(failed)?;
            } else {
                Direct::new(&set, Formula::Arctangent).linking_number((0, 1));
            }
            // Programs are compiled in the first run.
            if run > 0 {
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
        times.sort_by(f64::total_cmp);
        Ok(times[times.len() / 2])
    };
    const SMALL: &str = "ribbon:segments=200,lambda=1";
    // An adapter needs many threads before it shows what it can do.
    let (large, pairs) = match info.software {
        true => ("ribbon:segments=6000,lambda=10", 9e6),
        false => ("ribbon:segments=100000,lambda=10", 2.5e9),
    };
    let round_trip_ms = time(SMALL, true)?;
    let pair_ms = (time(large, true)? - round_trip_ms).max(1e-6) / pairs;
    let processor_ms = time("ribbon:segments=6000,lambda=10", false)? / 9e6;
    Ok(Calibration {
        adapter: info.name,
        driver: info.driver,
        threads: rayon::current_num_threads(),
        round_trip_ms,
        pair_ns: pair_ms * 1e6,
        processor_pair_ns: processor_ms * 1e6,
    })
}
