//! Kernels on a GPU, through Vulkan, Metal or DX12. All pairs of curves are processed by one list
//! of commands.
//!
//! # Structure
//!
//! Each stage has a Rust file (work lists, the proof of its error bounds, evaluation of the
//! results) and a shader of the same name (`.wgsl`). [`device`] owns the adapter and is the only
//! file that uses wgpu. The stages describe their work by [`commands`]; [`layout`] has the structs
//! that Rust and the shaders share.
//!
//! # Method
//!
//! Source: Qu & James 2021, section 3.4.5. They launch their kernels pair by pair in single
//! precision, and name all pairs at once as future work. Here all pairs are one work list of tiles,
//! and single precision comes with a proof: crossings that it does not decide go to the CPU, sums
//! have an error bound. Pairs that the bound of a direct sum leaves undecided are summed again in
//! double precision, if the adapter supports it.
//!
//! # Stages of a frame
//!
//! The vertices ([`frame`]) are uploaded once: during the previous frame if the next one is known,
//! else before the CPU starts its own work on the frame. Crossings: [`boxes`], [`directions`],
//! [`descent`], [`crossings`]. Sums: [`direct`], and [`barnes_hut`], whose near pairs are summed by
//! [`direct`]. Pipelines and buffers are kept for the next frame. Work lists are cut so that no
//! buffer exceeds the limit of the adapter and no submission takes so long that the system
//! considers the adapter hung. Lists whose length only the adapter knows have a [`capacity`] that
//! grows.
//!
//! # Failures
//!
//! An adapter is trusted with single operations only, and after a test ([`self_test`]). Every other
//! failure (adapter lost, out of memory, frame too large) is an [`Error`]; the caller logs it and
//! computes on the CPU.

pub(crate) mod barnes_hut;
mod boxes;
mod capacity;
mod commands;
mod counters;
mod crossings;
mod descent;
mod device;
mod direct;
mod directions;
mod error;
mod fixed;
mod frame;
#[cfg(test)]
mod hostile_tests;
mod layout;
pub(crate) mod precision;
mod select;
mod self_test;
mod summations;
#[cfg(test)]
mod tests;
mod tiles;

#[cfg(test)]
pub(super) use tests::direct_in_double;

pub(crate) use error::Error;

use self::boxes::Hierarchy;
use self::capacity::Capacity;
#[cfg(test)]
use self::commands::Stage;
use self::commands::{Binding, Buffer, Command};
use self::device::{Adapter, Pending};
pub(crate) use self::frame::Frame;
pub(super) use self::layout::Node;
use self::layout::Tile;
use self::precision::Real;
use super::crossings::Input;
use super::device::{Device, DeviceInfo};
use super::gpu_use::Counts;
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const PARAMETERS: Buffer = Buffer("parameters", "all");
/// Vertices of the current frame and of the next one.
const VERTICES: [Buffer; 2] = [Buffer("vertices", "one"), Buffer("vertices", "other")];
/// Maximum number of segment pairs in one submission, on a GPU and on a software adapter: a
/// fraction of a second even on a slow one.
const MAX_WORK: [u64; 2] = [1 << 31, 1 << 28];

/// True if the build has GPU kernels.
pub(super) const SUPPORTED: bool = true;

/// Returns all adapters. Opens each of them and tests its arithmetic.
pub fn devices() -> Vec<DeviceInfo> {
    let mut all = device::list();
    for info in &mut all {
        match Gpu::open(&Device::Index(info.index)) {
            Ok(gpu) => info.double_precision = gpu.computes_in_double(),
            Err(error) => info.unusable = Some(error.to_string()),
        }
    }
    all
}

/// Returns the index of the first adapter for which `is_wanted` holds.
pub(super) fn find(is_wanted: impl Fn(&DeviceInfo) -> bool) -> Option<Device> {
    let found = device::list().into_iter().find(|info| is_wanted(info));
    found.map(|info| Device::Index(info.index))
}

/// Open adapters, shared by all callers. They stay open, because opening one takes longer than
/// many frames.
static OPEN: Mutex<Vec<(Device, Arc<Gpu>)>> = Mutex::new(Vec::new());

/// An adapter that is ready to compute, for one caller at a time.
#[derive(Debug)]
pub(crate) struct Gpu {
    state: Mutex<State>,
    /// True after a failure in double precision alone.
    only_single: AtomicBool,
}

impl Gpu {
    /// Opens an adapter and tests its arithmetic.
    pub fn open(device: &Device) -> Result<Gpu, Error> {
        let mut state = State::new(Adapter::open(device, true)?);
        self_test::run::<f32>(&mut state)?;
        if state.adapter.info.double_precision
            && let Err(error) = self_test::run::<f64>(&mut state)
        {
            tracing::warn!("the adapter is used in single precision only: {error}");
            // A shader that the adapter could not run may have lost the device.
            state = State::new(Adapter::open(device, false)?);
        }
        Ok(Gpu {
            state: Mutex::new(state),
            only_single: AtomicBool::new(false),
        })
    }

    /// Returns an open adapter: the shared one if the same choice is open already, else a new one.
    pub fn shared(device: &Device) -> Result<Arc<Gpu>, Error> {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|(_, gpu)| !gpu.is_lost());
        if let Some((_, gpu)) = open.iter().find(|(known, _)| known == device) {
            return Ok(Arc::clone(gpu));
        }
        let gpu = Arc::new(Gpu::open(device)?);
        open.push((device.clone(), Arc::clone(&gpu)));
        Ok(gpu)
    }

    /// Frees the memory of a shared adapter if this is its last user.
    pub fn release(gpu: &Arc<Gpu>) {
        let open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        let shared = open.iter().filter(|(_, other)| Arc::ptr_eq(gpu, other));
        if Arc::strong_count(gpu) == shared.count() + 1 {
            let mut state = gpu.lock();
            state.adapter.buffers.clear();
            state.forget();
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| {
            let mut state = poisoned.into_inner();
            // The panicking thread may have recorded an upload that never happened.
            state.forget();
            self.state.clear_poison();
            state
        })
    }

    /// Returns the properties of the adapter.
    pub fn info(&self) -> DeviceInfo {
        self.lock().adapter.info.clone()
    }

    /// Returns true if the adapter is lost or has failed once.
    pub fn is_lost(&self) -> bool {
        self.lock().adapter.lost.load(Ordering::Relaxed)
    }

    /// Returns true if the adapter computes in double precision.
    pub fn computes_in_double(&self) -> bool {
        !self.only_single.load(Ordering::Relaxed) && self.lock().adapter.info.double_precision
    }

    /// Uploads the vertices of a frame unless they are cached, and starts the bounding-box pass.
    /// Does not wait.
    pub fn send(&self, frame: &Frame) -> Result<(), Error> {
        let mut state = self.lock();
        let commands = boxes::fit(&mut state, frame).concat();
        state.run(frame, commands)?;
        state.boxes_of = Some(frame.id);
        Ok(())
    }

    /// Counts the crossings of polylines and returns their linking numbers. `frame` has their
    /// vertices. If the `next` frame is known, its vertices are prepared and uploaded while the
    /// adapter counts.
    pub fn count(
        &self,
        frame: &Frame,
        input: Input<'_>,
        pairs: &[Pair],
        next: Option<&CurveSet>,
    ) -> Result<(Counts, Option<Frame>), Error> {
        let mut sent = None;
        let mut meanwhile = |state: &mut State| {
            if let (Some(next), None) = (next, &sent) {
                let frame = Frame::alone(next);
                // If the next frame is too large, it fails on its own turn, not now.
                if size_of_val(&frame.vertices[..]) as u64 <= state.adapter.max_buffer_bytes {
                    state.start(&frame, Vec::new())?;
                    sent = Some(frame);
                }
            }
            Ok(())
        };
        let counts = crossings::linking_numbers(self, frame, input, pairs, &mut meanwhile)?;
        Ok((counts, sent))
    }
}

/// An adapter and the contents of its buffers.
#[derive(Debug)]
pub(super) struct State {
    adapter: Adapter,
    /// Frames whose vertices are uploaded.
    vertices_of: [Option<u64>; 2],
    /// Slot of the latest upload.
    latest: usize,
    /// Frame whose trees are uploaded.
    nodes_of: Option<u64>,
    /// Frame whose bounding boxes are computed.
    boxes_of: Option<u64>,
    /// Number of workgroups dispatched by the bounding-box pass since the hierarchy was uploaded.
    boxes_made: u32,
    /// Hierarchy of the bounding boxes.
    hierarchy: Hierarchy,
    /// Maximum number of segment pairs in one submission.
    max_work: u64,
    /// Capacity of the list of undecided tests.
    undecided_capacity: u32,
    /// Capacity of the lists of the crossing kernel.
    crossing_capacity: Capacity,
    /// Capacity of the lists of Barnes-Hut.
    sum_capacity: Capacity,
}

impl State {
    /// Creates the state of an adapter with no uploads.
    fn new(adapter: Adapter) -> State {
        let max_work = MAX_WORK[usize::from(adapter.info.software)];
        State {
            adapter,
            vertices_of: [None; 2],
            latest: 0,
            nodes_of: None,
            boxes_of: None,
            boxes_made: 0,
            hierarchy: Hierarchy::default(),
            max_work,
            undecided_capacity: crossings::UNDECIDED_CAPACITY,
            crossing_capacity: Capacity::START,
            sum_capacity: Capacity::START,
        }
    }

    /// Runs commands that read the vertices of a frame. Uploads the vertices first unless they are
    /// cached.
    fn run<R: Real>(
        &mut self,
        frame: &Frame<R>,
        commands: Vec<Command>,
    ) -> Result<Vec<Vec<u8>>, Error> {
        let pending = self.start(frame, commands)?;
        self.finish(pending)
    }

    /// Starts the commands as [`State::run`] does, but does not wait for their results.
    fn start<R: Real>(
        &mut self,
        frame: &Frame<R>,
        mut commands: Vec<Command>,
    ) -> Result<Pending, Error> {
        let slot = self.slot(frame);
        if self.vertices_of[slot] != Some(frame.id) {
            commands.insert(0, Command::upload(VERTICES[slot], &frame.vertices));
        }
        let started = self.adapter.start(&commands);
        let pending = started.inspect_err(|_| self.forget())?;
        self.vertices_of[slot] = Some(frame.id);
        self.latest = slot;
        Ok(pending)
    }

    /// Waits for the results of started commands.
    fn finish(&mut self, pending: Pending) -> Result<Vec<Vec<u8>>, Error> {
        let done = self.adapter.finish(pending);
        done.inspect_err(|_| self.forget())
    }

    /// Returns the slot of the vertices of a frame: the slot that has them, or else the one that
    /// does not have the latest upload.
    fn slot<R: Real>(&self, frame: &Frame<R>) -> usize {
        let known = |id: &Option<u64>| *id == Some(frame.id);
        let found = self.vertices_of.iter().position(known);
        found.unwrap_or(1 - self.latest)
    }

    /// Returns the binding of the vertices of a frame.
    fn vertices<R: Real>(&self, frame: &Frame<R>) -> Binding {
        let bytes = size_of_val(&frame.vertices[..]);
        Binding::whole(VERTICES[self.slot(frame)], bytes as u64)
    }

    /// Marks all buffers as invalid, because their contents are unknown after a failure.
    fn forget(&mut self) {
        (self.vertices_of, self.nodes_of, self.boxes_of) = ([None; 2], None, None);
        self.hierarchy = Hierarchy::default();
    }

    /// Returns the error for a list that was not processed to its end. A system may abort the work
    /// of an adapter, or a driver may leave a loop early, and not all report it: without a check it
    /// looks as if all work were done and nothing linked. So all shaders count the items that they
    /// processed.
    fn incomplete(&mut self) -> Error {
        self.forget();
        Error::Failed(
            "the adapter did not process all of its work; \
             the system or the driver may have aborted it"
                .into(),
        )
    }

    /// Returns the number of workgroups of a shader that strides through a list whose length only
    /// the adapter knows. Software adapters need many: Mesa's leaves a loop after 65535 rounds,
    /// including those of inner loops, and reports no error.
    fn strides(&self) -> u32 {
        match self.adapter.info.software {
            true => 1024,
            false => 4096,
        }
    }
}

/// Returns all shaders.
#[cfg(test)]
fn stages() -> Vec<Stage> {
    let mut all = vec![
        boxes::STAGE,
        directions::STAGE,
        descent::STAGE,
        crossings::STAGE,
        barnes_hut::STAGE,
    ];
    all.extend(stages_in::<f32>());
    all
}

/// Returns the shaders that exist in both precisions.
#[cfg(test)]
fn stages_in<R: Real>() -> Vec<Stage> {
    let mut all = vec![self_test::stage::<R>()];
    all.extend(direct::stages::<R>());
    all
}

/// Returns the source of a shader: its constants, the shared parts and `parts`. Constants are
/// defined in Rust only.
fn shader<R: Real>(whole: &[(&str, u32)], real: &[(&str, f64)], parts: &[&str]) -> String {
    let mut out = String::new();
    // Writing to a string never fails.
    for (name, value) in whole {
        let _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    for (name, value) in real {
        let _ = writeln!(out, "const {name}: real = {value:e};");
    }
    for part in [R::SHADER, include_str!("shared.wgsl")].iter().chain(parts) {
        out.push('\n');
        out.push_str(part);
    }
    out
}
