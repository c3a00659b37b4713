//! A graphics processor for kernels, where there is one and it was asked for.

use super::crossings::Scene;
use super::device::{Device, DeviceInfo};
use super::{Counted, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;

#[cfg(feature = "gpu")]
use super::gpu::{self, Calibration, Frame, Gpu, Trouble};
use std::sync::Arc;

/// Tests for crossings that a graphics processor was given in the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Offload {
    /// Pairs of segments that it tested.
    pub tests: u64,
    /// Those of them that single precision did not decide: the processor did, exactly.
    pub undecided: u64,
}

/// The adapter in use, or none: then everything runs on the processor.
#[derive(Clone, Debug, Default)]
pub(crate) struct Accelerator {
    #[cfg(feature = "gpu")]
    gpu: Option<Arc<Gpu>>,
    /// What says where the adapter wins, where it is for us to choose.
    #[cfg(feature = "gpu")]
    calibration: Option<Calibration>,
    /// The vertices of the frame in work, where they were sent ahead.
    #[cfg(feature = "gpu")]
    ahead: Option<Arc<Frame>>,
    /// The frame after the one in work, where it is known.
    #[cfg(feature = "gpu")]
    announced: Option<Arc<CurveSet>>,
    /// That frame, once its vertices were sent.
    #[cfg(feature = "gpu")]
    sent: Option<(Arc<CurveSet>, Arc<Frame>)>,
    /// Of the last frame.
    offload: Offload,
}

impl Accelerator {
    /// Opens a device.
    ///
    /// Errors: [`Error::Device`] where it was asked for by name or as such and there is none that can be used.
    #[cfg(feature = "gpu")]
    pub fn open(device: &Device) -> Result<Accelerator> {
        let open = |device: &Device| {
            let opened = Gpu::shared(device);
            opened.map_err(|trouble| Error::Device(trouble.to_string()))
        };
        let mut chosen = Accelerator::default();
        match device {
            Device::Cpu => {}
            Device::Gpu | Device::Named(_) => chosen.gpu = Some(open(device)?),
            // No adapter is opened that was never measured, and none is missed.
            Device::Auto => {
                if let Some(calibration) = Calibration::fastest() {
                    let adapter = Device::Named(calibration.adapter.clone());
                    match open(&adapter) {
                        Ok(gpu) if calibration.is_of(&gpu.info()) => {
                            (chosen.gpu, chosen.calibration) = (Some(gpu), Some(calibration));
                        }
                        Ok(_) => {}
                        Err(e) => tracing::debug!("{e}"),
                    }
                }
            }
        }
        Ok(chosen)
    }

    /// Opens a device: this build knows none but the processor.
    ///
    /// Errors: [`Error::Device`] where another one was asked for.
    #[cfg(not(feature = "gpu"))]
    pub fn open(device: &Device) -> Result<Accelerator> {
        match device {
            Device::Auto | Device::Cpu => Ok(Accelerator::default()),
            Device::Gpu | Device::Named(_) => Err(Error::Device(
                "this build has no kernels for graphics processors".into(),
            )),
        }
    }

    /// Which adapter it is.
    pub fn info(&self) -> Option<DeviceInfo> {
        #[cfg(feature = "gpu")]
        return self.gpu.as_ref().map(|gpu| gpu.info());
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// What the last frame gave it.
    pub fn offload(&self) -> Offload {
        self.offload
    }

    /// Forgets the frame before.
    pub fn start_frame(&mut self) {
        self.offload = Offload::default();
        #[cfg(feature = "gpu")]
        {
            self.ahead = None;
        }
    }

    /// Says which frame comes next: its vertices go up while the crossings of the one before it are counted.
    #[cfg(feature = "gpu")]
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        self.announced = Some(Arc::clone(next));
    }

    /// Announces nothing.
    #[cfg(not(feature = "gpu"))]
    pub fn announce(&mut self, _: &Arc<CurveSet>) {}

    /// Lets go of a frame that was verified, whether it was sent or not.
    pub fn end_frame(&mut self, _set: &CurveSet) {
        #[cfg(feature = "gpu")]
        {
            self.announced = None;
            self.sent.take_if(|(of, _)| std::ptr::eq(&**of, _set));
        }
    }

    /// Whether the vertices of a frame went up ahead of its turn.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        let sent = self.sent.as_ref();
        sent.is_some_and(|(of, _)| std::ptr::eq(&**of, set))
    }

    /// Sends up the vertices of a frame whose crossings will be asked for, while the processor has other things to do.
    #[cfg(feature = "gpu")]
    pub fn send_ahead(&mut self, set: &CurveSet) {
        let Some(gpu) = self.counter(set) else {
            return;
        };
        let frame = match self.sent.take() {
            Some((of, frame)) if std::ptr::eq(&*of, set) => frame,
            _ => Arc::new(Frame::new(set)),
        };
        match gpu.send(&frame) {
            Ok(()) => self.ahead = Some(frame),
            Err(trouble) => self.give_up(&trouble),
        }
    }

    /// Sends nothing.
    #[cfg(not(feature = "gpu"))]
    pub fn send_ahead(&mut self, _: &CurveSet) {}

    /// The adapter, where the crossings of a set are counted on it.
    #[cfg(feature = "gpu")]
    fn counter(&self, set: &CurveSet) -> Option<Arc<Gpu>> {
        // Of counting, trees and directions take most of the time, and they are the processor's either way.
        let asked_for = self.calibration.is_none() && set.basis().is_polyline();
        self.gpu.clone().filter(|_| asked_for)
    }

    /// Whether the crossings of a set are counted on it.
    pub fn counts(&self, set: &CurveSet) -> bool {
        #[cfg(feature = "gpu")]
        return self.counter(set).is_some();
        #[cfg(not(feature = "gpu"))]
        {
            let _ = set;
            false
        }
    }

    #[cfg(feature = "gpu")]
    fn give_up(&mut self, trouble: &Trouble) {
        tracing::warn!("from here on all is computed on the processor: {trouble}");
        self.gpu = None;
        (self.ahead, self.sent) = (None, None);
    }

    /// Counts the crossings of all pairs, in parts that follow one another in the order of the pairs. None where that is left to
    /// the processor: without an adapter, for splines, and once it failed, which is said.
    #[cfg(feature = "gpu")]
    pub fn count(&mut self, scene: Scene<'_>, pairs: &[Pair]) -> Option<Vec<Counted>> {
        let gpu = self.counter(scene.set).filter(|_| !pairs.is_empty())?;
        let ahead = self.ahead.clone();
        let frame = ahead.unwrap_or_else(|| Arc::new(Frame::new(scene.set)));
        let next = self.announced.take();
        match gpu.count(&frame, scene, pairs, next.as_deref()) {
            Ok(((parts, undecided), sent)) => {
                // What an earlier part of the frame has sent stays.
                let sent = next.zip(sent.map(Arc::new));
                self.sent = sent.or_else(|| self.sent.take());
                self.offload.tests += parts.iter().map(|part| part.stats.tests).sum::<u64>();
                self.offload.undecided += undecided;
                Some(parts)
            }
            Err(trouble) => {
                self.give_up(&trouble);
                None
            }
        }
    }

    /// Counts nothing.
    #[cfg(not(feature = "gpu"))]
    pub fn count(&mut self, _: Scene<'_>, _: &[Pair]) -> Option<Vec<Counted>> {
        None
    }

    /// A kernel that sums on the adapter, and goes on by `otherwise` where that fails.
    #[cfg(feature = "gpu")]
    pub fn direct_sum<'a>(
        &'a self,
        set: &CurveSet,
        otherwise: Box<dyn Summation + 'a>,
    ) -> Box<dyn Summation + 'a> {
        match &self.gpu {
            Some(gpu) => Box::new(gpu::DirectSum::new(
                gpu,
                set,
                self.calibration.clone(),
                otherwise,
            )),
            None => otherwise,
        }
    }

    /// Barnes-Hut on the adapter, likewise; `beta` leaves it at one pass by distance.
    #[cfg(feature = "gpu")]
    pub fn barnes_hut<'a>(
        &'a self,
        set: &CurveSet,
        beta: Option<f64>,
        otherwise: Box<dyn Summation + 'a>,
    ) -> Box<dyn Summation + 'a> {
        match &self.gpu {
            // Which of the two is faster depends on the scene; it is not measured.
            Some(gpu) if self.calibration.is_none() => {
                Box::new(gpu::BarnesHutSum::new(gpu, set, beta, otherwise))
            }
            _ => otherwise,
        }
    }

    /// The kernel of the processor.
    #[cfg(not(feature = "gpu"))]
    pub fn barnes_hut<'a>(
        &'a self,
        _: &CurveSet,
        _: Option<f64>,
        otherwise: Box<dyn Summation + 'a>,
    ) -> Box<dyn Summation + 'a> {
        otherwise
    }

    /// The kernel of the processor.
    #[cfg(not(feature = "gpu"))]
    pub fn direct_sum<'a>(
        &'a self,
        _: &CurveSet,
        otherwise: Box<dyn Summation + 'a>,
    ) -> Box<dyn Summation + 'a> {
        otherwise
    }
}
