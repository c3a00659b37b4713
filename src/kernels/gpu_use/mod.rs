//! Use of a GPU by the kernels: off, requested or automatic.
//!
//! After a failure of the adapter, this and all later frames are computed on the CPU. The failure
//! is logged once.

pub(super) mod fallback;
mod uploads;

use self::fallback::WithFallback;
use self::uploads::Uploads;
use super::calibration::{Calibration, segment_pairs, segments};
use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::gpu::{self, Gpu};
use super::{Counted, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

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
    mode: Mode,
    /// True after a failure of the adapter.
    failed: AtomicBool,
    uploads: Uploads,
    /// Work of the last frame.
    offload: Offload,
}

/// Work that an adapter gets.
#[derive(Debug, Default)]
enum Mode {
    /// None: all kernels run on the CPU.
    #[default]
    Off,
    /// All work that it supports, because the user requested this adapter.
    Requested {
        gpu: Arc<Gpu>,
        info: DeviceInfo,
        /// Measured cost, if there is a calibration of the adapter.
        calibration: Option<Calibration>,
    },
    /// The work on which its calibration predicts that it is faster than the CPU.
    Automatic {
        calibration: Calibration,
        /// The adapter, opened when it is first chosen, because opening takes longer than many
        /// frames. Contains `None` if opening failed.
        gpu: OnceLock<Option<Arc<Gpu>>>,
    },
}

impl Mode {
    /// Returns the adapter if it is open.
    fn opened(&self) -> Option<&Arc<Gpu>> {
        match self {
            Mode::Off => None,
            Mode::Requested { gpu, .. } => Some(gpu),
            Mode::Automatic { gpu, .. } => gpu.get()?.as_ref(),
        }
    }
}

impl Drop for Mode {
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
        let mode = match device {
            Device::Cpu => Mode::Off,
            Device::Auto if gpu::SUPPORTED => {
                let calibration = calibration.cloned().or_else(Calibration::fastest);
                return Ok(calibration.map_or_else(GpuUse::default, GpuUse::automatic));
            }
            Device::Auto => Mode::Off,
            Device::Gpu | Device::Named(_) | Device::Index(_) => {
                let gpu = Gpu::shared(device).map_err(|e| Error::Device(e.to_string()))?;
                let info = gpu.info();
                let calibration = Calibration::of(&info);
                Mode::Requested {
                    gpu,
                    info,
                    calibration,
                }
            }
        };
        Ok(GpuUse {
            mode,
            ..GpuUse::default()
        })
    }

    /// Uses the adapter of a calibration if the calibration predicts that it is faster than the
    /// CPU.
    pub fn automatic(calibration: Calibration) -> GpuUse {
        GpuUse {
            mode: Mode::Automatic {
                calibration,
                gpu: OnceLock::new(),
            },
            ..GpuUse::default()
        }
    }

    /// Returns the adapter; opens it first if needed.
    fn gpu(&self) -> Option<&Arc<Gpu>> {
        if self.has_failed() {
            return None;
        }
        if let Mode::Automatic { calibration, gpu } = &self.mode {
            gpu.get_or_init(|| open_calibrated(calibration));
        }
        let gpu = self.mode.opened()?;
        // Another engine that uses the adapter may have lost it.
        if gpu.is_lost() {
            self.fail(&"the adapter was lost");
            return None;
        }
        Some(gpu)
    }

    /// Returns the properties of the adapter if it is open and not lost.
    pub fn info(&self) -> Option<DeviceInfo> {
        let gpu = self
            .mode
            .opened()
            .filter(|gpu| !self.has_failed() && !gpu.is_lost());
        gpu.map(|gpu| gpu.info())
    }

    /// Returns the adapter for the choice of a kernel, or `None` if there is none.
    pub fn offer(&self) -> Option<Offer<'_>> {
        match &self.mode {
            _ if self.has_failed() => None,
            Mode::Off => None,
            Mode::Requested {
                info, calibration, ..
            } => Some(Offer {
                adapter: &info.name,
                requested: true,
                calibration: calibration.as_ref(),
            }),
            Mode::Automatic { gpu, .. } if matches!(gpu.get(), Some(None)) => None,
            Mode::Automatic { calibration, .. } => Some(Offer {
                adapter: &calibration.adapter,
                requested: false,
                calibration: Some(calibration),
            }),
        }
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
        self.uploads.start_frame();
        if self.has_failed() {
            // Releases the adapter.
            self.mode = Mode::Off;
            self.uploads = Uploads::default();
        }
    }

    /// Announces the next frame. Its vertices are uploaded while the crossings of the current frame
    /// are counted.
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        if !matches!(self.mode, Mode::Off) {
            self.uploads.announce(next);
        }
    }

    /// Ends a frame, verified or rejected ([`Uploads::end_frame`]).
    pub fn end_frame(&mut self, set: &CurveSet) {
        self.uploads.end_frame(set);
    }

    /// Returns true if the vertices of a frame were uploaded before its turn.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        self.uploads.has_sent(set)
    }

    /// Uploads the vertices of a frame whose crossings will be counted on the adapter, while the
    /// CPU does other work.
    pub fn send_ahead(&mut self, set: &CurveSet) {
        if !matches!(self.mode, Mode::Requested { .. }) || !set.basis().is_polyline() {
            return;
        }
        if let Some(gpu) = self.gpu().cloned() {
            let frame = self.uploads.frame(set);
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
        let frame = self.uploads.frame(input.set);
        let next = self.uploads.take_announced();
        match gpu.count(&frame, input, pairs, next.as_deref()) {
            Ok(((parts, undecided), ahead)) => {
                self.uploads.keep_next(next.zip(ahead));
                self.offload.tests += parts.iter().map(|part| part.stats.tests).sum::<u64>();
                self.offload.undecided += undecided;
                Some(parts)
            }
            Err(error) => {
                self.fail(&error);
                None
            }
        }
    }

    /// Returns the adapter for a sum if it was requested, or if `wins` holds for its calibration.
    fn summing(&self, wins: impl Fn(&Calibration) -> bool) -> Option<&Arc<Gpu>> {
        match &self.mode {
            Mode::Automatic { calibration, .. } if !wins(calibration) => None,
            _ => self.gpu(),
        }
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
        // With a beta the two were not compared, so no adapter is predicted to win.
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
    let opened = Gpu::shared(&device);
    opened
        .inspect_err(|error| {
            tracing::info!(
                "cannot use the calibrated adapter {name}, kernels run on the CPU: {error}"
            );
        })
        .ok()
}
