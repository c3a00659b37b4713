//! A graphics processor for kernels, where there is one and it was asked for.

use super::calibration::Calibration;
use super::crossings::Scene;
use super::device::{Device, DeviceInfo};
use super::{Counted, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use std::sync::Arc;

#[cfg(feature = "gpu")]
use super::calibration::{segment_pairs, segments};
#[cfg(feature = "gpu")]
use super::gpu::{self, Frame, Gpu, Trouble};
#[cfg(feature = "gpu")]
use std::sync::OnceLock;

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
    /// Opened at once where it was asked for. One that is ours to choose is opened when it is first chosen, since that takes
    /// longer than many a frame; none where that failed.
    #[cfg(feature = "gpu")]
    gpu: OnceLock<Option<Arc<Gpu>>>,
    /// The one that was asked for: it gets all that it can do.
    asked_for: Option<DeviceInfo>,
    /// What says where the adapter wins, where it is for us to choose.
    calibration: Option<Calibration>,
    /// The vertices of the frame in work, where they were sent.
    #[cfg(feature = "gpu")]
    sent: Option<Arc<Frame>>,
    /// The frame after the one in work, where it is known.
    #[cfg(feature = "gpu")]
    announced: Option<Arc<CurveSet>>,
    /// That frame, once its vertices were sent.
    #[cfg(feature = "gpu")]
    sent_ahead: Option<(Arc<CurveSet>, Arc<Frame>)>,
    /// Of the last frame.
    offload: Offload,
}

/// An adapter that work may go to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offer<'a> {
    /// Its name.
    pub adapter: &'a str,
    /// Whether it was asked for, and gets the work wherever it can do it.
    pub asked_for: bool,
    /// What it was measured to take.
    pub calibration: Option<&'a Calibration>,
}

impl Accelerator {
    /// Opens a device.
    ///
    /// Errors: [`Error::Device`] where it was asked for by name or as such and there is none that can be used.
    #[cfg(feature = "gpu")]
    pub fn open(device: &Device) -> Result<Accelerator> {
        match device {
            Device::Cpu => Ok(Accelerator::default()),
            Device::Gpu | Device::Named(_) | Device::Index(_) => {
                let opened = Gpu::shared(device);
                let gpu = opened.map_err(|trouble| Error::Device(trouble.to_string()))?;
                let info = gpu.info();
                Ok(Accelerator {
                    gpu: OnceLock::from(Some(gpu)),
                    calibration: Calibration::of(&info),
                    asked_for: Some(info),
                    ..Accelerator::default()
                })
            }
            // No adapter is opened that was never measured, and none is missed.
            Device::Auto => Ok(Accelerator::choosing_by(Calibration::fastest())),
        }
    }

    /// The adapter of a calibration, where that says that it wins.
    #[cfg(feature = "gpu")]
    pub fn choosing_by(calibration: Option<Calibration>) -> Accelerator {
        Accelerator {
            calibration,
            ..Accelerator::default()
        }
    }

    /// Opens a device: this build knows none but the processor.
    ///
    /// Errors: [`Error::Device`] where another one was asked for.
    #[cfg(not(feature = "gpu"))]
    pub fn open(device: &Device) -> Result<Accelerator> {
        match device {
            Device::Auto | Device::Cpu => Ok(Accelerator::default()),
            Device::Gpu | Device::Named(_) | Device::Index(_) => Err(Error::Device(
                "this build has no kernels for graphics processors".into(),
            )),
        }
    }

    /// The adapter, opened.
    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&Arc<Gpu>> {
        let opened = self.gpu.get_or_init(|| {
            let calibration = self.calibration.as_ref()?;
            let name = &calibration.adapter;
            let Some(device) = gpu::find(|info| calibration.is_of(info)) else {
                tracing::info!(
                    "{name} is not there as it was measured (linkwatch devices --calibrate)"
                );
                return None;
            };
            let opened = Gpu::shared(&device);
            opened
                .inspect_err(|trouble| {
                    tracing::info!("{name}, which was measured, cannot be used: {trouble}");
                })
                .ok()
        });
        opened.as_ref().filter(|gpu| !gpu.is_lost())
    }

    /// Which adapter it is, once it is open and until it is lost.
    pub fn info(&self) -> Option<DeviceInfo> {
        #[cfg(feature = "gpu")]
        {
            let gpu = self.gpu.get()?.as_ref();
            gpu.filter(|gpu| !gpu.is_lost()).map(|gpu| gpu.info())
        }
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Whether there is an adapter that can be used; opens it.
    pub fn answers(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.gpu().is_some();
        #[cfg(not(feature = "gpu"))]
        false
    }

    /// The adapter, for those who choose; none where there is none.
    pub fn offer(&self) -> Option<Offer<'_>> {
        #[cfg(feature = "gpu")]
        if matches!(self.gpu.get(), Some(None)) {
            return None;
        }
        let calibration = self.calibration.as_ref();
        let adapter = match &self.asked_for {
            Some(info) => &info.name,
            None => &calibration?.adapter,
        };
        Some(Offer {
            adapter,
            asked_for: self.asked_for.is_some(),
            calibration,
        })
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
            self.sent = None;
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

    /// Lets go of a frame that was verified, whether it was sent ahead or not.
    pub fn end_frame(&mut self, _set: &CurveSet) {
        #[cfg(feature = "gpu")]
        {
            self.announced = None;
            self.sent_ahead.take_if(|(of, _)| std::ptr::eq(&**of, _set));
        }
    }

    /// Whether the vertices of a frame went up ahead of its turn.
    #[cfg(all(test, feature = "gpu"))]
    pub fn has_sent(&self, set: &CurveSet) -> bool {
        let sent = self.sent_ahead.as_ref();
        sent.is_some_and(|(of, _)| std::ptr::eq(&**of, set))
    }

    /// Sends up the vertices of a frame whose crossings are sure to be counted there, while the processor has other things
    /// to do.
    #[cfg(feature = "gpu")]
    pub fn send_ahead(&mut self, set: &CurveSet) {
        if self.asked_for.is_none() || !set.basis().is_polyline() {
            return;
        }
        if let Some(gpu) = self.gpu().cloned() {
            let frame = self.frame(set);
            if let Err(trouble) = gpu.send(&frame) {
                self.give_up(&trouble);
            }
        }
    }

    /// The vertices of a set, which may be on the adapter already.
    #[cfg(feature = "gpu")]
    fn frame(&mut self, set: &CurveSet) -> Arc<Frame> {
        let frame = match (self.sent.take(), self.sent_ahead.take()) {
            (Some(frame), ahead) => {
                self.sent_ahead = ahead;
                frame
            }
            (None, Some((of, frame))) if std::ptr::eq(&*of, set) => frame,
            _ => Arc::new(Frame::new(set)),
        };
        self.sent = Some(Arc::clone(&frame));
        frame
    }

    /// Sends nothing.
    #[cfg(not(feature = "gpu"))]
    pub fn send_ahead(&mut self, _: &CurveSet) {}

    #[cfg(feature = "gpu")]
    fn give_up(&mut self, trouble: &Trouble) {
        tracing::warn!("from here on all is computed on the processor: {trouble}");
        let offload = self.offload;
        *self = Accelerator {
            offload,
            ..Accelerator::default()
        };
    }

    /// Counts the crossings of all pairs, in parts that follow one another in the order of the pairs. None where that is left to
    /// the processor: without an adapter, for splines, and once it failed, which is said.
    #[cfg(feature = "gpu")]
    pub fn count(&mut self, scene: Scene<'_>, pairs: &[Pair]) -> Option<Vec<Counted>> {
        if pairs.is_empty() || !scene.set.basis().is_polyline() {
            return None;
        }
        let gpu = self.gpu()?.clone();
        let frame = self.frame(scene.set);
        let next = self.announced.take();
        match gpu.count(&frame, scene, pairs, next.as_deref()) {
            Ok(((parts, undecided), ahead)) => {
                // What an earlier part of the frame has sent stays.
                if let Some(ahead) = next.zip(ahead.map(Arc::new)) {
                    self.sent_ahead = Some(ahead);
                }
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

    /// The adapter for a sum, where it was asked for or `wins` by its calibration.
    #[cfg(feature = "gpu")]
    fn summing(&self, wins: impl Fn(&Calibration) -> bool) -> Option<&Arc<Gpu>> {
        let chosen = || self.calibration.as_ref().is_some_and(wins);
        match self.asked_for.is_some() || chosen() {
            true => self.gpu(),
            false => None,
        }
    }

    /// A kernel that sums these pairs on the adapter; that of the processor, which is made when it is needed, where the adapter
    /// does not win, and where it fails.
    #[cfg(feature = "gpu")]
    pub fn direct_sum<'a>(
        &'a self,
        set: &'a CurveSet,
        pairs: &[Pair],
        processor: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        match self.summing(|c| c.direct.wins(segment_pairs(set, pairs))) {
            Some(gpu) => {
                let sum = gpu::DirectSum::new(gpu, set);
                Box::new(gpu::WithStandby::new(sum, processor))
            }
            None => processor(),
        }
    }

    /// Barnes-Hut on the adapter, likewise; `beta` leaves it at one pass by distance.
    #[cfg(feature = "gpu")]
    pub fn barnes_hut<'a>(
        &'a self,
        set: &CurveSet,
        pairs: &[Pair],
        beta: Option<f64>,
        processor: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        // Which of the two is faster with a beta is not measured.
        let wins = |c: &Calibration| beta.is_none() && c.barnes_hut.wins(segments(set, pairs));
        match self.summing(wins) {
            Some(gpu) => {
                let sum = gpu::BarnesHutSum::new(gpu, set, beta);
                Box::new(gpu::WithStandby::new(sum, processor))
            }
            None => processor(),
        }
    }

    /// The kernel of the processor.
    #[cfg(not(feature = "gpu"))]
    pub fn barnes_hut<'a>(
        &'a self,
        _: &CurveSet,
        _: &[Pair],
        _: Option<f64>,
        processor: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        processor()
    }

    /// The kernel of the processor.
    #[cfg(not(feature = "gpu"))]
    pub fn direct_sum<'a>(
        &'a self,
        _: &CurveSet,
        _: &[Pair],
        processor: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> Box<dyn Summation + 'a> {
        processor()
    }
}
