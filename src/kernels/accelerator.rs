//! GPU adapter in use by the kernels: chosen, opened, replaced by the CPU after a failure.

use super::calibration::Calibration;
use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::{Counted, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use std::sync::Arc;

#[cfg(feature = "gpu")]
use super::calibration::{segment_pairs, segments};
#[cfg(feature = "gpu")]
use super::gpu::{self, Frame, Gpu};
#[cfg(feature = "gpu")]
use std::sync::OnceLock;

/// Crossing tests that ran on a GPU in the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Offload {
    /// Segment pairs tested.
    pub tests: u64,
    /// Segment pairs that single precision did not decide. The CPU decided them, exactly.
    pub undecided: u64,
}

/// The adapter in use. Without one, all kernels run on the CPU.
#[derive(Clone, Debug, Default)]
pub(crate) struct Accelerator {
    /// A requested adapter is opened at once. Under [`Device::Auto`] the adapter is opened when it
    /// is first chosen, because opening takes longer than many frames. Contains `None` if opening
    /// failed.
    #[cfg(feature = "gpu")]
    gpu: OnceLock<Option<Arc<Gpu>>>,
    /// The adapter that the user requested. It gets all work that it supports.
    requested: Option<DeviceInfo>,
    /// Measured cost, which decides what runs on the adapter under [`Device::Auto`].
    calibration: Option<Calibration>,
    /// Vertices of the current frame, once they are uploaded.
    #[cfg(feature = "gpu")]
    uploaded: Option<Arc<Frame>>,
    /// The next frame, if it is known.
    #[cfg(feature = "gpu")]
    next: Option<Arc<CurveSet>>,
    /// The next frame and its vertices, once they are uploaded.
    #[cfg(feature = "gpu")]
    uploaded_next: Option<(Arc<CurveSet>, Arc<Frame>)>,
    /// Work of the last frame.
    offload: Offload,
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

impl Accelerator {
    /// Opens a device.
    ///
    /// Errors: [`Error::Device`] if a GPU was requested, by name or not, and no matching adapter
    /// can be used.
    #[cfg(feature = "gpu")]
    pub fn open(device: &Device) -> Result<Accelerator> {
        match device {
            Device::Cpu => Ok(Accelerator::default()),
            Device::Gpu | Device::Named(_) | Device::Index(_) => {
                let opened = Gpu::shared(device);
                let gpu = opened.map_err(|error| Error::Device(error.to_string()))?;
                let info = gpu.info();
                Ok(Accelerator {
                    gpu: OnceLock::from(Some(gpu)),
                    calibration: Calibration::of(&info),
                    requested: Some(info),
                    ..Accelerator::default()
                })
            }
            // Opens no adapter without a calibration, and reports no missing one.
            Device::Auto => Ok(Accelerator::choosing_by(Calibration::fastest())),
        }
    }

    /// Returns an accelerator that uses the adapter of a calibration if the calibration predicts
    /// that it is faster than the CPU.
    #[cfg(feature = "gpu")]
    pub fn choosing_by(calibration: Option<Calibration>) -> Accelerator {
        Accelerator {
            calibration,
            ..Accelerator::default()
        }
    }

    /// Opens a device. This build supports the CPU only.
    ///
    /// Errors: [`Error::Device`] if another device was requested.
    #[cfg(not(feature = "gpu"))]
    pub fn open(device: &Device) -> Result<Accelerator> {
        match device {
            Device::Auto | Device::Cpu => Ok(Accelerator::default()),
            Device::Gpu | Device::Named(_) | Device::Index(_) => Err(Error::Device(
                "this build has no GPU kernels; build with the feature `gpu`, or use --device cpu"
                    .into(),
            )),
        }
    }

    /// Returns the adapter; opens it first if needed.
    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&Arc<Gpu>> {
        let opened = self.gpu.get_or_init(|| {
            let calibration = self.calibration.as_ref()?;
            let name = &calibration.adapter;
            let Some(device) = gpu::find(|info| calibration.is_of(info)) else {
                tracing::info!(
                    "no adapter matches the calibration of {name}; kernels run on the CPU \
                     (calibrate again: linkwatch devices --calibrate)"
                );
                return None;
            };
            let opened = Gpu::shared(&device);
            opened
                .inspect_err(|error| {
                    tracing::info!(
                        "cannot use the calibrated adapter {name}, \
                         kernels run on the CPU: {error}"
                    );
                })
                .ok()
        });
        opened.as_ref().filter(|gpu| !gpu.is_lost())
    }

    /// Returns the properties of the adapter if it is open and not lost.
    pub fn info(&self) -> Option<DeviceInfo> {
        #[cfg(feature = "gpu")]
        {
            let gpu = self.gpu.get()?.as_ref();
            gpu.filter(|gpu| !gpu.is_lost()).map(|gpu| gpu.info())
        }
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Returns true if an adapter can be used. Opens it first if needed.
    pub fn answers(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.gpu().is_some();
        #[cfg(not(feature = "gpu"))]
        false
    }

    /// Returns the adapter for the choice of a kernel, or `None` if there is none.
    pub fn offer(&self) -> Option<Offer<'_>> {
        #[cfg(feature = "gpu")]
        if matches!(self.gpu.get(), Some(None)) {
            return None;
        }
        let calibration = self.calibration.as_ref();
        let adapter = match &self.requested {
            Some(info) => &info.name,
            None => &calibration?.adapter,
        };
        Some(Offer {
            adapter,
            requested: self.requested.is_some(),
            calibration,
        })
    }

    /// Returns the GPU work of the last frame.
    pub fn offload(&self) -> Offload {
        self.offload
    }

    /// Resets the state of the previous frame.
    pub fn start_frame(&mut self) {
        self.offload = Offload::default();
        #[cfg(feature = "gpu")]
        {
            self.uploaded = None;
        }
    }

    /// Announces the next frame. Its vertices are uploaded while the crossings of the current frame
    /// are counted.
    #[cfg(feature = "gpu")]
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        self.next = Some(Arc::clone(next));
    }

    /// Does nothing: this build supports the CPU only.
    #[cfg(not(feature = "gpu"))]
    pub fn announce(&mut self, _: &Arc<CurveSet>) {}

    /// Releases a verified frame, uploaded in advance or not.
    pub fn end_frame(&mut self, _set: &CurveSet) {
        #[cfg(feature = "gpu")]
        {
            self.next = None;
            self.uploaded_next
                .take_if(|(of, _)| std::ptr::eq(&**of, _set));
        }
    }

    /// Returns true if the vertices of a frame were uploaded before its turn.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        let sent = self.uploaded_next.as_ref();
        sent.is_some_and(|(of, _)| std::ptr::eq(&**of, set))
    }

    /// Uploads the vertices of a frame whose crossings will be counted on the adapter, while the
    /// CPU does other work.
    #[cfg(feature = "gpu")]
    pub fn send_ahead(&mut self, set: &CurveSet) {
        if self.requested.is_none() || !set.basis().is_polyline() {
            return;
        }
        if let Some(gpu) = self.gpu().cloned() {
            let frame = self.frame(set);
            if let Err(error) = gpu.send(&frame) {
                self.fall_back_to_cpu(&error);
            }
        }
    }

    /// Returns the vertices of a set, which may be uploaded already.
    #[cfg(feature = "gpu")]
    fn frame(&mut self, set: &CurveSet) -> Arc<Frame> {
        let frame = match (self.uploaded.take(), self.uploaded_next.take()) {
            (Some(frame), ahead) => {
                self.uploaded_next = ahead;
                frame
            }
            (None, Some((of, frame))) if std::ptr::eq(&*of, set) => frame,
            _ => Arc::new(Frame::new(set)),
        };
        self.uploaded = Some(Arc::clone(&frame));
        frame
    }

    /// Does nothing: this build supports the CPU only.
    #[cfg(not(feature = "gpu"))]
    pub fn send_ahead(&mut self, _: &CurveSet) {}

    #[cfg(feature = "gpu")]
    fn fall_back_to_cpu(&mut self, error: &gpu::Error) {
        tracing::warn!(
            "the GPU failed; this and all further frames are computed on the CPU: {error}"
        );
        let offload = self.offload;
        *self = Accelerator {
            offload,
            ..Accelerator::default()
        };
    }

    /// Counts the crossings of all pairs on the adapter. Returns the parts in the order of the
    /// pairs, or `None` if the CPU has to count: without an adapter, for splines, and after a
    /// failure, which is logged.
    #[cfg(feature = "gpu")]
    pub fn count(&mut self, input: Input<'_>, pairs: &[Pair]) -> Option<Vec<Counted>> {
        if pairs.is_empty() || !input.set.basis().is_polyline() {
            return None;
        }
        let gpu = self.gpu()?.clone();
        let frame = self.frame(input.set);
        let next = self.next.take();
        match gpu.count(&frame, input, pairs, next.as_deref()) {
            Ok(((parts, undecided), ahead)) => {
                // Keeps the upload that an earlier part of the frame made.
                if let Some(ahead) = next.zip(ahead.map(Arc::new)) {
                    self.uploaded_next = Some(ahead);
                }
                self.offload.tests += parts.iter().map(|part| part.stats.tests).sum::<u64>();
                self.offload.undecided += undecided;
                Some(parts)
            }
            Err(error) => {
                self.fall_back_to_cpu(&error);
                None
            }
        }
    }

    /// Returns `None`: this build supports the CPU only.
    #[cfg(not(feature = "gpu"))]
    pub fn count(&mut self, _: Input<'_>, _: &[Pair]) -> Option<Vec<Counted>> {
        None
    }

    /// Returns the adapter for a sum if it was requested, or if `wins` holds for its calibration.
    #[cfg(feature = "gpu")]
    fn summing(&self, wins: impl Fn(&Calibration) -> bool) -> Option<&Arc<Gpu>> {
        let chosen = || self.calibration.as_ref().is_some_and(wins);
        match self.requested.is_some() || chosen() {
            true => self.gpu(),
            false => None,
        }
    }

    /// Returns a kernel that sums these pairs. It runs on the adapter if the adapter is faster or
    /// was requested, else on the CPU. The CPU kernel is also the fallback after a failure; it is
    /// built only if needed.
    #[cfg(feature = "gpu")]
    pub fn direct_sum<'a>(
        &'a self,
        set: &'a CurveSet,
        pairs: &[Pair],
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        match self.summing(|c| c.direct.wins(segment_pairs(set, pairs))) {
            Some(gpu) => {
                let sum = gpu::DirectSum::new(gpu, set);
                Box::new(gpu::WithFallback::new(sum, cpu))
            }
            None => cpu(),
        }
    }

    /// Returns a Barnes-Hut kernel, chosen as in [`Accelerator::direct_sum`]. With `beta` it makes
    /// one pass and accepts node pairs by distance.
    #[cfg(feature = "gpu")]
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
            Some(gpu) => {
                let sum = gpu::BarnesHutSum::new(gpu, set, beta);
                Box::new(gpu::WithFallback::new(sum, cpu))
            }
            None => cpu(),
        }
    }

    /// Returns the CPU kernel.
    #[cfg(not(feature = "gpu"))]
    pub fn barnes_hut<'a>(
        &'a self,
        _: &CurveSet,
        _: &[Pair],
        _: Option<f64>,
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        cpu()
    }

    /// Returns the CPU kernel.
    #[cfg(not(feature = "gpu"))]
    pub fn direct_sum<'a>(
        &'a self,
        _: &CurveSet,
        _: &[Pair],
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        cpu()
    }
}
