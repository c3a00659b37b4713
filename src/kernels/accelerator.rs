//! A graphics processor for kernels, where there is one and it was asked for.

use super::crossings::Scene;
use super::device::{Device, DeviceInfo};
use super::{Linking, Summation};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::pairs::Pair;
use crate::verdict::Stats;

#[cfg(feature = "gpu")]
use super::gpu::{self, Calibration, Gpu};
#[cfg(feature = "gpu")]
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

    /// Forgets the work of the frame before.
    pub fn start_frame(&mut self) {
        self.offload = Offload::default();
    }

    /// Counts the crossings of all pairs; none where that is left to the processor: without an adapter, for splines, and
    /// once it failed, which is said.
    #[cfg(feature = "gpu")]
    pub fn count(&mut self, scene: Scene<'_>, pairs: &[Pair]) -> Option<(Vec<Linking>, Stats)> {
        let gpu = self.gpu.as_ref()?;
        // Of counting, trees and directions take most of the time, and they are the processor's either way.
        if self.calibration.is_some() || pairs.is_empty() || !scene.set.basis().is_polyline() {
            return None;
        }
        match gpu.count(scene, pairs) {
            Ok((found, stats, undecided)) => {
                self.offload.tests += stats.tests;
                self.offload.undecided += undecided;
                Some((found, stats))
            }
            Err(trouble) => {
                tracing::warn!("from here on all is computed on the processor: {trouble}");
                self.gpu = None;
                None
            }
        }
    }

    /// Counts nothing.
    #[cfg(not(feature = "gpu"))]
    pub fn count(&mut self, _: Scene<'_>, _: &[Pair]) -> Option<(Vec<Linking>, Stats)> {
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
