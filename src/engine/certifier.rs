//! Certificates of single frames.

use super::full::FullRun;
use super::{Ladder, Progress, SessionOptions, Timings};
use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::kernels::{DeviceInfo, GpuUse, Method, Offload, segment_pairs};
use crate::pool;
use crate::verdict::Stats;
use std::sync::Arc;
use std::time::Instant;

/// Computes all linking numbers of frames, each by itself. Its buffers are reused for every frame.
/// Certificates in a periodic cell are those of a [`Session`](crate::Session).
///
/// ```
/// use linkwatch::scenes::Scene;
/// use linkwatch::Certifier;
///
/// let set = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?.curves;
/// let mut certifier = Certifier::default();
/// let (certificate, stats) = certifier.certify(&set);
/// assert_eq!(certificate.links().len() as u64, stats.potential_links - stats.separated);
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct Certifier {
    full: FullRun,
}

impl Certifier {
    /// Opens the device of the options, and takes their kernel and its accuracy. All other options
    /// are ignored.
    ///
    /// # Errors
    ///
    /// The errors of [`Session::new`](crate::Session::new).
    pub fn new(options: &SessionOptions) -> Result<Certifier> {
        pool::check_process()?;
        options.check()?;
        let gpu = GpuUse::open(&options.device, options.calibration.as_ref())?;
        Ok(Certifier::with_gpu(options, gpu))
    }

    /// Creates a certifier that computes on a GPU adapter that is already open.
    pub(crate) fn with_gpu(options: &SessionOptions, gpu: GpuUse) -> Certifier {
        Certifier {
            full: FullRun::new(options.kernel, options.accuracy, gpu),
        }
    }

    /// Computes all linking numbers of a frame.
    ///
    /// # Panics
    /// In a process that was forked from one that used the library ([`Error::Forked`]), because the
    /// call would never return.
    pub fn certify(&mut self, set: &CurveSet) -> (&Certificate, Stats) {
        pool::check_process().unwrap_or_else(|forked| panic!("{forked}"));
        self.complete(|full| pool::run(set.segments(), || full.certify(set)))
    }

    /// Runs `run` to completion: it cannot be cancelled.
    fn complete(&mut self, run: impl FnOnce(&mut FullRun) -> Stats) -> (&Certificate, Stats) {
        let start = Instant::now();
        self.full.heed_cancel(false);
        self.full.progress.limit.begin(usize::MAX);
        let stats = run(&mut self.full);
        self.full.timings.total = start.elapsed();
        (&self.full.certificate, stats)
    }

    /// Computes the linking numbers of a frame of polylines that do not change if every vertex
    /// moves within a cube of half-width `noise` around its position (Arai 2013, remark 4). Pairs
    /// that may touch within the noise have no linking number; their defect names two segments.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] for splines, if `noise` is not a length, or if the options have a
    /// kernel other than [`Method::Auto`].
    pub fn certify_noisy(&mut self, set: &CurveSet, noise: f64) -> Result<(&Certificate, Stats)> {
        let method = self.full.method;
        if method != Method::Auto {
            let what = format!("noise excludes the kernel {method}: it has a kernel of its own");
            return Err(Error::Usage(what));
        }
        if !set.basis().is_polyline() {
            let what = "noise applies to the vertices of polylines; these curves are splines";
            return Err(Error::Usage(what.into()));
        }
        if !(noise >= 0.0 && noise.is_finite()) {
            let what = format!("noise of {noise}, expected a length of at least 0");
            return Err(Error::Usage(what));
        }
        Ok(self.complete(|full| full.certify_noisy(set, noise)))
    }

    /// Returns which linking numbers of the last full run were decided by sums, and which by
    /// counting.
    pub fn ladder(&self) -> Ladder {
        self.full.ladder
    }

    /// Returns the number of segment pairs in the last potential links: the work of sums without
    /// trees. `set` must be the set of those links, or its polylines.
    pub fn segment_pairs(&self, set: &CurveSet) -> u64 {
        segment_pairs(set, self.full.search.pairs())
    }

    /// Returns the GPU in use. With [`Device::Auto`](crate::kernels::Device::Auto), `None` until it
    /// was chosen.
    pub fn device(&self) -> Option<DeviceInfo> {
        self.full.gpu.info()
    }

    /// Returns the work that the GPU did in the last frame.
    pub fn offload(&self) -> Offload {
        self.full.gpu.offload()
    }

    /// Returns a view of the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.full.progress)
    }

    /// Returns the times of the last frame.
    pub fn timings(&self) -> Timings {
        self.full.timings
    }
}
