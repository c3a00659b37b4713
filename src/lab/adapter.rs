//! Measurement of the kernels on an adapter and on the CPU: whole frames, and frames whose vertices
//! are uploaded already.

use super::certify::{Run, StageTimes};
use super::statistics::Effort;
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::engine::{Certifier, SessionOptions};
use crate::error::{Error, Result};
use crate::kernels::calibration::segments;
use crate::kernels::crossings::{Input, Workspaces};
use crate::kernels::gpu::barnes_hut::Forest;
use crate::kernels::gpu::precision::{GpuPrecision, Real};
use crate::kernels::gpu::{self, Frame, Gpu};
use crate::kernels::{Counted, Device, Estimate, GpuUse, Method, segment_pairs};
use crate::pairs::{LinkSearch, Pair, Trees, degenerate_curves, potential_links};
use std::borrow::Cow;

/// Measured times of a kernel: medians, in milliseconds.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct AdapterTimes {
    /// The kernel.
    pub kernel: Method,
    /// Precision of the adapter: `single` or `double`.
    pub precision: &'static str,
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

impl AdapterTimes {
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
pub fn measure_adapter(
    device: &Device,
    set: &CurveSet,
    kernels: &[Method],
    effort: Effort,
    limit_s: f64,
) -> Result<Vec<AdapterTimes>> {
    let gpu = Gpu::shared(device).map_err(failed)?;
    let prepared = Prepared::new(Cow::Borrowed(set))?;
    let exact = prepared
        .certifier(Method::Crossings)
        .certify(&prepared.set)
        .0
        .clone();
    let measurement = Measurement {
        gpu: &gpu,
        prepared: &prepared,
        exact: &exact,
        effort,
        limit_s,
    };
    let mut all = Vec::new();
    for kernel in kernels {
        match kernel {
            Method::Crossings => all.push(measurement.crossings()),
            Method::Direct => {
                all.push(measurement.direct::<f32>());
                if gpu.computes_in_double() {
                    all.push(measurement.direct::<f64>());
                }
            }
            Method::BarnesHut => all.push(measurement.barnes_hut()),
            _ => {}
        }
    }
    all.into_iter().map(|times| times.map_err(failed)).collect()
}

/// Returns the error for a failure of the adapter.
pub(super) fn failed(error: gpu::Error) -> Error {
    Error::Device(error.to_string())
}

/// Polylines with their trees and potential links, as the kernels on an adapter take them.
pub(super) struct Prepared<'a> {
    pub set: Cow<'a, CurveSet>,
    trees: Trees,
    pub links: Vec<Pair>,
    workspaces: Workspaces,
}

impl<'a> Prepared<'a> {
    /// Prepares curves. Splines are converted to polylines.
    pub fn new(set: Cow<'a, CurveSet>) -> Result<Prepared<'a>> {
        let set = match set.basis().is_polyline() {
            true => set,
            false => Cow::Owned(homotopic_polylines(&set)?.curves),
        };
        let mut trees = Trees::default();
        trees.refit(&*set);
        let degenerate: Vec<_> = degenerate_curves(&set).collect();
        let links = potential_links(&set, &trees, &mut LinkSearch::default(), &degenerate).clone();
        Ok(Prepared {
            set,
            trees,
            links,
            workspaces: Workspaces::default(),
        })
    }

    pub fn input(&self) -> Input<'_> {
        Input {
            set: &self.set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        }
    }

    /// Returns the number of segment pairs: the work of direct sums.
    pub fn segment_pairs(&self) -> u64 {
        segment_pairs(&self.set, &self.links)
    }

    /// Returns the number of segments, counted once for each potential link: the work of
    /// Barnes-Hut.
    pub fn segments(&self) -> u64 {
        segments(&self.set, &self.links)
    }

    /// Returns a certifier that runs a kernel on the CPU.
    fn certifier(&self, kernel: Method) -> Certifier {
        let options = SessionOptions {
            kernel,
            ..SessionOptions::default()
        };
        Certifier::with_gpu(&options, GpuUse::default())
    }

    /// Returns the median time of a kernel on the CPU, in milliseconds.
    pub fn cpu_ms(&self, kernel: Method, effort: Effort) -> f64 {
        let mut certifier = self.certifier(kernel);
        if kernel == Method::Crossings {
            // The first run allocates the buffers. Sums have none to keep.
            certifier.certify(&self.set);
        }
        let run = || Run::of(&mut certifier, &self.set, None).times;
        let times = StageTimes::median(&effort.repeat(run).collect::<Vec<_>>());
        match kernel {
            Method::Crossings => times.links_ms,
            _ => times.summing_ms,
        }
    }

    /// Counts crossings on an adapter: a whole frame.
    pub fn count(&self, gpu: &Gpu) -> Result<(Vec<Counted>, u64), gpu::Error> {
        let frame = Frame::new(&self.set);
        gpu.send(&frame)?;
        Ok(gpu.count(&frame, self.input(), &self.links, None)?.0)
    }

    /// Computes direct sums on an adapter: a whole frame.
    pub fn sum_directly<R: Real>(&self, gpu: &Gpu) -> Result<Vec<Estimate>, gpu::Error> {
        gpu.sum_directly(&Frame::<R>::new(&self.set), &self.links)
    }

    /// Computes Barnes-Hut sums on an adapter: a whole frame.
    pub fn sum_by_trees(&self, gpu: &Gpu) -> Result<Vec<Estimate>, gpu::Error> {
        let frame = Frame::new(&self.set);
        gpu.sum_by_trees(&frame, &Forest::new(&frame), &self.links, None)
    }
}

struct Measurement<'a> {
    gpu: &'a Gpu,
    prepared: &'a Prepared<'a>,
    exact: &'a Certificate,
    effort: Effort,
    limit_s: f64,
}

impl Measurement<'_> {
    fn crossings(&self) -> Result<AdapterTimes, gpu::Error> {
        let (gpu, prepared) = (self.gpu, self.prepared);
        let frame = Frame::new(&prepared.set);
        let resident = || gpu.count(&frame, prepared.input(), &prepared.links, None);
        // The first run compiles the shaders and allocates the buffers.
        resident()?;
        let (resident_ms, _) = self.effort.median_ms(resident)?;
        let (whole_ms, (found, undecided)) = self.effort.median_ms(|| prepared.count(gpu))?;
        let links = found.iter().flat_map(|part| &part.links);
        let undefined = found.iter().flat_map(|part| &part.undefined);
        let pairs = self.exact.undefined.iter().filter(|d| d.j.is_some());
        Ok(AdapterTimes {
            kernel: Method::Crossings,
            precision: "single",
            links: prepared.links.len(),
            segment_pairs: prepared.segment_pairs(),
            whole_ms,
            resident_ms,
            cpu_ms: Some(prepared.cpu_ms(Method::Crossings, self.effort)),
            largest_error: 0.0,
            undecided,
            equal: links.eq(&self.exact.links) && undefined.eq(pairs),
        })
    }

    fn direct<R: Real>(&self) -> Result<AdapterTimes, gpu::Error> {
        let (gpu, prepared) = (self.gpu, self.prepared);
        let frame = Frame::<R>::new(&prepared.set);
        let resident = || gpu.sum_directly(&frame, &prepared.links);
        let whole = || prepared.sum_directly::<R>(gpu);
        self.sums(Method::Direct, R::PRECISION, resident, whole)
    }

    fn barnes_hut(&self) -> Result<AdapterTimes, gpu::Error> {
        let (gpu, prepared) = (self.gpu, self.prepared);
        let frame = Frame::new(&prepared.set);
        let forest = Forest::new(&frame);
        let resident = || gpu.sum_by_trees(&frame, &forest, &prepared.links, None);
        let whole = || prepared.sum_by_trees(gpu);
        self.sums(Method::BarnesHut, GpuPrecision::Single, resident, whole)
    }

    /// Measures sums: with the vertices on the adapter, and of whole frames.
    fn sums(
        &self,
        kernel: Method,
        precision: GpuPrecision,
        mut resident: impl FnMut() -> Result<Vec<Estimate>, gpu::Error>,
        whole: impl FnMut() -> Result<Vec<Estimate>, gpu::Error>,
    ) -> Result<AdapterTimes, gpu::Error> {
        /// Approximate time of a segment pair on one CPU thread, in nanoseconds.
        const PAIR_NS: f64 = 5.0;
        // The first run compiles the shaders and allocates the buffers.
        resident()?;
        let (resident_ms, _) = self.effort.median_ms(resident)?;
        let (whole_ms, found) = self.effort.median_ms(whole)?;
        let (prepared, exact) = (self.prepared, self.exact);
        let segment_pairs = prepared.segment_pairs();
        let threads = rayon::current_num_threads() as f64;
        let seconds = segment_pairs as f64 * PAIR_NS * 1e-9 / threads;
        let in_time = kernel == Method::BarnesHut || seconds < self.limit_s;
        let undefined = |i, j| {
            let pairs = &exact.undefined;
            pairs
                .binary_search_by_key(&(i, Some(j)), |d| (d.i, d.j))
                .is_ok()
        };
        let (mut largest_error, mut equal) = (0f64, true);
        for (&(i, j), estimate) in prepared.links.iter().zip(&found) {
            if undefined(i, j) {
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
        Ok(AdapterTimes {
            kernel,
            precision: match precision {
                GpuPrecision::Single => "single",
                GpuPrecision::Double => "double",
            },
            links: prepared.links.len(),
            segment_pairs,
            whole_ms,
            resident_ms,
            cpu_ms: in_time.then(|| prepared.cpu_ms(kernel, self.effort)),
            largest_error,
            undecided: undecided as u64,
            equal,
        })
    }
}
