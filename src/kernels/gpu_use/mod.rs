//! Use of a GPU by the kernels: off, requested or automatic.
//!
//! After a failure of the adapter, this and all later frames are computed on the CPU. The failure
//! is logged once.

pub(super) mod fallback;

use self::fallback::WithFallback;
use super::calibration::{Calibration, segment_pairs, segments};
use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::gpu::{self, Frame, Gpu};
use super::{Counted, Estimate, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// A summation kernel on an adapter: returns the linking numbers of several pairs, in their order.
pub(super) type AdapterSum<'a> =
    Box<dyn Fn(&[Pair]) -> Result<Vec<Estimate>, gpu::Error> + Send + Sync + 'a>;

/// Linking numbers in parts, in the order of the pairs, and the number of tests that the CPU
/// decided.
pub(super) type Counts = (Vec<Counted>, u64);

/// Crossing tests that ran on a GPU in the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Offload {
    /// Segment pairs tested.
    pub tests: u64,
    /// Segment pairs that single precision did not decide. The CPU decided them, exactly.
    pub undecided: u64,
}

/// Use of a GPU by the kernels of an engine. The default uses none.
#[derive(Debug, Default)]
pub(crate) struct GpuUse {
    /// The adapter to use. `None`: all kernels run on the CPU.
    chosen: Option<Chosen>,
    /// True after a failure of the adapter.
    failed: AtomicBool,
    /// The next frame, if it is known, so that its vertices can be uploaded in advance.
    announced: Option<Arc<CurveSet>>,
    /// Vertices of the last two frames, the later one of which may be the next frame, each with the
    /// identifier of its positions ([`CurveSet::contents`]).
    frames: VecDeque<(u64, Arc<Frame>)>,
    /// Work of the last frame.
    offload: Offload,
}

/// An adapter, and the work that it gets.
#[derive(Debug)]
struct Chosen {
    /// Name of the adapter.
    name: String,
    /// True if the user requested this adapter. It then gets all work that it supports, otherwise
    /// the work on which its calibration predicts that it is faster than the CPU.
    requested: bool,
    /// Measured cost, if there is a calibration of the adapter.
    calibration: Option<Calibration>,
    /// The adapter. An adapter that was not requested is opened at its first use, because opening
    /// takes longer than many frames. Contains `None` if opening failed.
    gpu: OnceLock<Option<Arc<Gpu>>>,
}

impl Chosen {
    /// Returns the adapter if it is open.
    fn opened(&self) -> Option<&Arc<Gpu>> {
        self.gpu.get()?.as_ref()
    }
}

impl Drop for Chosen {
    fn drop(&mut self) {
        if let Some(gpu) = self.opened() {
            Gpu::release(gpu);
        }
    }
}

/// An adapter that is available for work.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offer<'a> {
    /// Name of the adapter.
    pub adapter: &'a str,
    /// True if the user requested this adapter. It then gets all work that it supports.
    pub requested: bool,
    /// Measured cost of the kernels, if there is a calibration.
    pub calibration: Option<&'a Calibration>,
}

impl GpuUse {
    /// Opens a requested adapter. [`Device::Auto`] chooses by a calibration: the given one, or else
    /// the stored one of the fastest adapter. Without one, it uses the CPU, and reports no missing
    /// adapter.
    ///
    /// # Errors
    ///
    /// [`Error::Device`] if a GPU was requested, by name or not, and no matching adapter
    /// can be used.
    pub fn open(device: &Device, calibration: Option<&Calibration>) -> Result<GpuUse> {
        match device {
            Device::Auto if gpu::SUPPORTED => {
                let calibration = calibration.cloned().or_else(Calibration::fastest);
                Ok(calibration.map_or_else(GpuUse::default, GpuUse::automatic))
            }
            Device::Auto | Device::Cpu => Ok(GpuUse::default()),
            Device::Gpu | Device::Named(_) | Device::Index(_) => {
                let gpu = Gpu::shared(device).map_err(|e| Error::Device(e.to_string()))?;
                let info = gpu.info();
                Ok(GpuUse::of(Chosen {
                    calibration: Calibration::of(&info),
                    name: info.name,
                    requested: true,
                    gpu: OnceLock::from(Some(gpu)),
                }))
            }
        }
    }

    /// Uses the adapter of a calibration if the calibration predicts that it is faster than the
    /// CPU.
    pub fn automatic(calibration: Calibration) -> GpuUse {
        GpuUse::of(Chosen {
            name: calibration.adapter.clone(),
            requested: false,
            calibration: Some(calibration),
            gpu: OnceLock::new(),
        })
    }

    fn of(chosen: Chosen) -> GpuUse {
        GpuUse {
            chosen: Some(chosen),
            ..GpuUse::default()
        }
    }

    /// Returns the adapter; opens it first if needed.
    fn gpu(&self) -> Option<&Arc<Gpu>> {
        let chosen = self.chosen.as_ref().filter(|_| !self.has_failed())?;
        let open = || open_calibrated(chosen.calibration.as_ref()?);
        let gpu = chosen.gpu.get_or_init(open).as_ref()?;
        // Another engine that uses the adapter may have lost it.
        if gpu.is_lost() {
            self.fail(&"the adapter was lost");
            return None;
        }
        Some(gpu)
    }

    /// Returns the properties of the adapter if it is open and not lost.
    pub fn info(&self) -> Option<DeviceInfo> {
        let gpu = self.chosen.as_ref()?.opened()?;
        (!self.has_failed() && !gpu.is_lost()).then(|| gpu.info())
    }

    /// Returns the adapter for the choice of a kernel, or `None` if there is none.
    pub fn offer(&self) -> Option<Offer<'_>> {
        let chosen = self.chosen.as_ref()?;
        let unusable = self.has_failed() || matches!(chosen.gpu.get(), Some(None));
        (!unusable).then_some(Offer {
            adapter: &chosen.name,
            requested: chosen.requested,
            calibration: chosen.calibration.as_ref(),
        })
    }

    /// Same as [`GpuUse::offer`], of an adapter that can be used. Opens it first if needed.
    pub fn tested_offer(&self) -> Option<Offer<'_>> {
        self.offer().filter(|_| self.gpu().is_some())
    }

    /// Returns true after a failure of the adapter.
    fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    /// Switches to the CPU, for this frame and all later ones. Logs the first failure.
    fn fail(&self, error: &dyn fmt::Display) {
        if !self.failed.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "the GPU failed; this and all further frames are computed on the CPU: {error}"
            );
        }
    }

    /// Returns the GPU work of the last frame.
    pub fn offload(&self) -> Offload {
        self.offload
    }

    /// Resets the state of the previous frame.
    pub fn start_frame(&mut self) {
        self.offload = Offload::default();
        if self.has_failed() {
            // Releases the adapter.
            self.chosen = None;
            self.frames.clear();
        }
    }

    /// Announces the next frame. Its vertices are uploaded while the crossings of the current frame
    /// are counted.
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        if self.chosen.is_some() {
            self.announced = Some(Arc::clone(next));
        }
    }

    /// Ends a frame, verified or rejected: clears the announcement.
    pub fn end_frame(&mut self) {
        self.announced = None;
    }

    /// Returns true if the vertices of a frame were uploaded.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        self.frames.iter().any(|(of, _)| *of == set.contents())
    }

    /// Keeps the vertices of a frame, and forgets those of older ones.
    fn keep(&mut self, set: &CurveSet, frame: Frame) -> Arc<Frame> {
        self.frames.truncate(1);
        let frame = Arc::new(frame);
        self.frames.push_front((set.contents(), Arc::clone(&frame)));
        frame
    }

    /// Returns the vertices of a frame, which may be uploaded already.
    fn frame(&mut self, set: &CurveSet) -> Arc<Frame> {
        let known = self.frames.iter().find(|(of, _)| *of == set.contents());
        match known {
            Some((_, frame)) => Arc::clone(frame),
            None => self.keep(set, Frame::new(set)),
        }
    }

    /// Uploads the vertices of a frame whose crossings will be counted on the adapter, while the
    /// CPU does other work.
    pub fn send_ahead(&mut self, set: &CurveSet) {
        let requested = self.chosen.as_ref().is_some_and(|chosen| chosen.requested);
        if !requested || !set.basis().is_polyline() {
            return;
        }
        if let Some(gpu) = self.gpu().cloned() {
            let frame = self.frame(set);
            if let Err(error) = gpu.send(&frame) {
                self.fail(&error);
            }
        }
    }

    /// Counts the crossings of all pairs on the adapter. Returns the parts in the order of the
    /// pairs, or `None` if the CPU has to count: without an adapter, for splines, and after a
    /// failure.
    pub fn count(&mut self, input: Input<'_>, pairs: &[Pair]) -> Option<Vec<Counted>> {
        if pairs.is_empty() || !input.set.basis().is_polyline() {
            return None;
        }
        let gpu = self.gpu()?.clone();
        let frame = self.frame(input.set);
        // `take`, because the announced frame must be uploaded only once.
        let next = self.announced.take();
        let counted = gpu.count(&frame, input, pairs, next.as_deref());
        let ((parts, undecided), ahead) = counted.inspect_err(|error| self.fail(error)).ok()?;
        if let Some((next, ahead)) = next.zip(ahead) {
            self.keep(&next, ahead);
        }
        self.offload.tests += parts.iter().map(|part| part.stats.tests).sum::<u64>();
        self.offload.undecided += undecided;
        Some(parts)
    }

    /// Returns the adapter for a sum if it was requested, or if `wins` holds for its calibration.
    fn summing(&self, wins: impl Fn(&Calibration) -> bool) -> Option<&Arc<Gpu>> {
        let chosen = self.chosen.as_ref()?;
        let uses = chosen.requested || chosen.calibration.as_ref().is_some_and(wins);
        uses.then(|| self.gpu()).flatten()
    }

    /// Returns a kernel that sums these pairs. It runs on the adapter if the adapter is faster or
    /// was requested, else on the CPU. The CPU kernel is also the fallback after a failure; it is
    /// built only if needed.
    pub fn direct_sum<'a>(
        &'a self,
        set: &'a CurveSet,
        pairs: &[Pair],
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        match self.summing(|c| c.direct.wins(segment_pairs(set, pairs))) {
            Some(gpu) => Box::new(WithFallback::new(self, gpu.direct_sum(set), cpu)),
            None => cpu(),
        }
    }

    /// Returns a Barnes-Hut kernel, chosen as in [`GpuUse::direct_sum`]. With `beta` it makes one
    /// pass and accepts node pairs by distance.
    pub fn barnes_hut<'a>(
        &'a self,
        set: &CurveSet,
        pairs: &[Pair],
        beta: Option<f64>,
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        // Calibrations do not measure kernels with a beta, so no adapter is predicted to be faster.
        let wins = |c: &Calibration| beta.is_none() && c.barnes_hut.wins(segments(set, pairs));
        match self.summing(wins) {
            Some(gpu) => Box::new(WithFallback::new(self, gpu.barnes_hut(set, beta), cpu)),
            None => cpu(),
        }
    }
}

/// Opens the adapter of a calibration. Logs the reason if that is not possible.
fn open_calibrated(calibration: &Calibration) -> Option<Arc<Gpu>> {
    let name = &calibration.adapter;
    let Some(device) = gpu::find(|info| calibration.is_of(info)) else {
        tracing::info!(
            "no adapter matches the calibration of {name}; kernels run on the CPU (linkwatch \
             devices lists the adapters, and which of them are calibrated)"
        );
        return None;
    };
    let opened = Gpu::shared(&device).inspect_err(|error| {
        tracing::info!("cannot use the calibrated adapter {name}, kernels run on the CPU: {error}");
    });
    opened.ok()
}
