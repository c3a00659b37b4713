//! Stand-in for the kernels on a GPU, in a build without the feature `gpu`: there is no adapter,
//! and none can be opened.

use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::{Counted, Estimate};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::convert::Infallible;
use std::fmt;
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
#[derive(Debug)]
pub(crate) struct Error;

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "this build has no GPU kernels; build with the feature `gpu`, or pass the option \
             `device=cpu`",
        )
    }
}

/// Vertices of a frame. Never used.
#[derive(Debug)]
pub(crate) struct Frame;

impl Frame {
    /// Copies nothing.
    pub fn new(_: &CurveSet) -> Frame {
        Frame
    }
}

/// A summation kernel on an adapter.
pub(super) type AdapterSum<'a> =
    Box<dyn Fn(&[Pair]) -> Result<Vec<Estimate>, Error> + Send + Sync + 'a>;

/// Linking numbers, in parts, and the number of tests that the CPU decided.
type Counts = (Vec<Counted>, u64);

/// An open adapter. No value exists.
#[derive(Debug)]
pub(crate) struct Gpu(Infallible);

impl Gpu {
    /// Fails.
    pub fn shared(_: &Device) -> Result<Arc<Gpu>, Error> {
        Err(Error)
    }

    pub fn release(_: &Arc<Gpu>) {}

    pub fn info(&self) -> DeviceInfo {
        match self.0 {}
    }

    pub fn is_lost(&self) -> bool {
        match self.0 {}
    }

    pub fn send(&self, _: &Frame) -> Result<(), Error> {
        match self.0 {}
    }

    pub fn count(
        &self,
        _: &Frame,
        _: Input<'_>,
        _: &[Pair],
        _: Option<&CurveSet>,
    ) -> Result<(Counts, Option<Frame>), Error> {
        match self.0 {}
    }

    pub fn direct_sum<'a>(&'a self, _: &'a CurveSet) -> AdapterSum<'a> {
        match self.0 {}
    }

    pub fn barnes_hut<'a>(&'a self, _: &CurveSet, _: Option<f64>) -> AdapterSum<'a> {
        match self.0 {}
    }
}
