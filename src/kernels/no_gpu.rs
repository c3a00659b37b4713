//! Stand-in for the kernels on a GPU, in a build without the feature `gpu`: there is no adapter,
//! and none can be opened.

use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::gpu_use::{AdapterSum, Counts};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::sync::Arc;

/// True if the build has GPU kernels.
pub(super) const SUPPORTED: bool = false;

/// Returns no adapter.
pub fn devices() -> Vec<DeviceInfo> {
    Vec::new()
}

/// Returns no adapter.
pub(super) fn find(_: impl Fn(&DeviceInfo) -> bool) -> Option<Device> {
    None
}

/// The build has no GPU kernels.
#[derive(Debug, thiserror::Error)]
#[error(
    "this build has no GPU kernels; build with the feature `gpu`, or pass the option `device=cpu`"
)]
pub(crate) struct Error;

/// Vertices of a frame. Never used.
#[derive(Debug)]
pub(crate) struct Frame;

impl Frame {
    /// Copies nothing.
    pub fn new(_: &CurveSet) -> Frame {
        Frame
    }
}

/// An open adapter. No value exists.
#[derive(Debug)]
pub(crate) enum Gpu {}

impl Gpu {
    /// Fails.
    pub fn shared(_: &Device) -> Result<Arc<Gpu>, Error> {
        Err(Error)
    }

    pub fn release(_: &Arc<Gpu>) {}

    pub fn info(&self) -> DeviceInfo {
        match *self {}
    }

    pub fn is_lost(&self) -> bool {
        match *self {}
    }

    pub fn send(&self, _: &Frame) -> Result<(), Error> {
        match *self {}
    }

    pub fn count(
        &self,
        _: &Frame,
        _: Input<'_>,
        _: &[Pair],
        _: Option<&CurveSet>,
    ) -> Result<(Counts, Option<Frame>), Error> {
        match *self {}
    }

    pub fn direct_sum<'a>(&'a self, _: &'a CurveSet) -> AdapterSum<'a> {
        match *self {}
    }

    pub fn barnes_hut<'a>(&'a self, _: &CurveSet, _: Option<f64>) -> AdapterSum<'a> {
        match *self {}
    }
}
