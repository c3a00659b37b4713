//! Kernels on a graphics processor, through Vulkan, Metal or DX12: all pairs of curves in one list of commands.
//!
//! A stage has one name, on the processor's side (`.rs`: work lists, the proof of its bounds, what becomes of the result) and on
//! the adapter's (`.wgsl`). [`device`] owns the adapter, and is the only file that knows the graphics interface;
//! [`commands`] is what the others tell it, and [`layout`] what both sides read.
//!
//! Source: Qu & James 2021, section 3.4.5, who launch their kernels pair by pair in single precision and name all
//! pairs at once as future work. Here all pairs are one work list of tiles, and single precision comes with a proof: crossings
//! that it cannot decide go to the processor, sums have a bound of their error. What the bound of a direct sum leaves open is
//! summed once more in double precision, where the adapter has it.
//!
//! The way of a frame: its vertices ([`frame`]) go up once, during the frame before where that is known, else ahead of the
//! processor's own work on it. Crossings: [`boxes`], [`directions`], [`descent`], [`crossings`]; sums: [`direct`], and
//! [`barnes_hut`] with what it leaves to the former. Programs and buffers stay for the next frame. Lists are cut so that no buffer is
//! larger than the adapter allows and no submission so long that it is taken for hung; those that only the adapter knows the
//! length of have [`room`] that grows.
//!
//! An adapter is trusted with single operations only, and after a test ([`self_test`]). Whatever else fails, a lost adapter, too
//! little memory, too large a frame, is [`Trouble`]: the caller says so and computes on the processor.

mod barnes_hut;
mod boxes;
mod commands;
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
mod measure;
mod precision;
mod room;
mod self_test;
mod standby;
mod summations;
#[cfg(test)]
mod tests;
mod tiles;

#[cfg(test)]
pub(super) use tests::direct_in_double;

pub(crate) use error::Trouble;
pub use measure::{DeviceTimes, measure};
pub use precision::Precision;
pub(super) use standby::WithStandby;
pub(super) use summations::{BarnesHutSum, DirectSum};

use self::boxes::Hierarchy;
use self::commands::{ALIGNMENT, Binding, Buffer, Command, Stage};
use self::device::{Device, Pending};
pub(crate) use self::frame::Frame;
use self::layout::{Parameters, Tile};
use self::precision::Real;
use self::room::Room;
use super::crossings::Scene;
use super::device::{Device as Choice, DeviceInfo};
use super::{Counted, Estimate};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::fmt::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

const PARAMETERS: Buffer = Buffer("parameters", "all");
/// Of the frame in work, and of the one after it.
const VERTICES: [Buffer; 2] = [
    Buffer("vertices", "one"),
    Buffer("vertices", "the other one"),
];
const SUMS: Buffer = Buffer("sums", "all");

/// Parts of lists of tiles start at multiples of this.
const STEP: usize = ALIGNMENT as usize / size_of::<Tile>();

/// Pairs of segments in one submission, at most: a fraction of a second of a slow adapter, and of the processor in disguise.
const MOST_WORK: [u64; 2] = [1 << 31, 1 << 28];

/// All adapters, each opened and tested.
pub(super) fn devices() -> Vec<DeviceInfo> {
    let mut all = device::list();
    for info in &mut all {
        match Gpu::open(&Choice::Index(info.index)) {
            Ok(gpu) => info.double_precision = gpu.computes_in_double(),
            Err(trouble) => info.trouble = Some(trouble.to_string()),
        }
    }
    all
}

/// Returns the first adapter for which `is_wanted` holds, to be opened.
pub(super) fn find(is_wanted: impl Fn(&DeviceInfo) -> bool) -> Option<Choice> {
    let found = device::list().into_iter().find(|info| is_wanted(info));
    found.map(|info| Choice::Index(info.index))
}

/// Linking numbers, in parts, and how many tests were left to the processor.
type Counts = (Vec<Counted>, u64);

/// Adapters that are open: one serves all who ask for it.
static OPEN: Mutex<Vec<(Choice, Weak<Gpu>)>> = Mutex::new(Vec::new());

/// An adapter that is ready to compute. One caller at a time.
#[derive(Debug)]
pub(crate) struct Gpu {
    engine: Mutex<Engine>,
}

impl Gpu {
    /// Opens an adapter and tests its arithmetic.
    pub fn open(choice: &Choice) -> Result<Gpu, Trouble> {
        let mut engine = Engine::new(Device::open(choice, true)?);
        self_test::run::<f32>(&mut engine)?;
        if engine.device.info().double_precision
            && let Err(trouble) = self_test::run::<f64>(&mut engine)
        {
            tracing::warn!("no double precision on the adapter: {trouble}");
            // A program that it could not run may have taken it away.
            engine = Engine::new(Device::open(choice, false)?);
        }
        Ok(Gpu {
            engine: Mutex::new(engine),
        })
    }

    /// [`Gpu::open`], once for all who ask for the same.
    pub fn shared(choice: &Choice) -> Result<Arc<Gpu>, Trouble> {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|(_, gpu)| gpu.strong_count() > 0);
        let known = open.iter().find(|(known, _)| known == choice);
        if let Some(gpu) = known.and_then(|(_, gpu)| gpu.upgrade()) {
            if !gpu.is_lost() {
                return Ok(gpu);
            }
            open.retain(|(known, _)| known != choice);
        }
        let gpu = Arc::new(Gpu::open(choice)?);
        open.push((choice.clone(), Arc::downgrade(&gpu)));
        Ok(gpu)
    }

    fn lock(&self) -> MutexGuard<'_, Engine> {
        self.engine.lock().unwrap_or_else(|poisoned| {
            let mut engine = poisoned.into_inner();
            // Who panicked may have noted what never went up.
            engine.forget();
            self.engine.clear_poison();
            engine
        })
    }

    /// Which adapter it is.
    pub fn info(&self) -> DeviceInfo {
        self.lock().device.info().clone()
    }

    /// Whether it has gone, or has failed once.
    pub fn is_lost(&self) -> bool {
        self.lock().device.is_lost()
    }

    /// Whether it computes in double precision.
    pub fn computes_in_double(&self) -> bool {
        self.lock().device.info().double_precision
    }

    /// Sends up the vertices of a frame, where they are not there, and has their boxes made, without waiting for that.
    pub fn send(&self, frame: &Frame) -> Result<(), Trouble> {
        let mut engine = self.lock();
        let commands = boxes::fit(&mut engine, frame).concat();
        engine.run(frame, commands)?;
        engine.boxes_of = Some(frame.id);
        Ok(())
    }

    /// Linking numbers of polylines by counting crossings; `frame` has their vertices. Those of the `next` frame, where it is known,
    /// are made ready and go up while the adapter counts.
    pub fn count(
        &self,
        frame: &Frame,
        scene: Scene<'_>,
        pairs: &[Pair],
        next: Option<&CurveSet>,
    ) -> Result<(Counts, Option<Frame>), Trouble> {
        let mut sent = None;
        let mut meanwhile = |engine: &mut Engine| {
            if let (Some(next), None) = (next, &sent) {
                let frame = Frame::alone(next);
                // One that is too large is none of this frame's trouble.
                if size_of_val(&frame.vertices[..]) as u64 <= engine.device.most_bytes() {
                    engine.start(&frame, Vec::new())?;
                    sent = Some(frame);
                }
            }
            Ok(())
        };
        let counts = crossings::linking_numbers(self, frame, scene, pairs, &mut meanwhile)?;
        Ok((counts, sent))
    }

    /// Direct sums over polylines in single precision, vertices included.
    pub fn sum_directly(&self, set: &CurveSet, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        // Made before the adapter is held: threads that make it may take up work that wants the adapter.
        let frame = Frame::<f32>::new(set);
        direct::linking_numbers(&mut self.lock(), &frame, pairs)
    }

    /// Barnes-Hut by the bound, vertices and trees included.
    pub fn sum_by_trees(&self, set: &CurveSet, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        let frame = Frame::new(set);
        let forest = barnes_hut::Forest::new(&frame);
        barnes_hut::linking_numbers(&mut self.lock(), &frame, &forest, pairs, None)
    }
}

/// An adapter with what is on it.
#[derive(Debug)]
pub(super) struct Engine {
    device: Device,
    /// The frames whose vertices are on it.
    vertices_of: [Option<u64>; 2],
    /// Which of them came last.
    latest: usize,
    /// The frame whose trees are on it.
    nodes_of: Option<u64>,
    /// The frame whose boxes are on it.
    boxes_of: Option<u64>,
    /// How many workgroups were to make boxes, since the hierarchy went up.
    boxes_made: u32,
    /// What boxes there are.
    hierarchy: Hierarchy,
    /// Pairs of segments in one submission, at most.
    most_work: u64,
    /// Undecided tests that there is room for.
    open_room: u32,
    /// Room for the node pairs of crossings.
    count_room: Room,
    /// Room for those of Barnes-Hut.
    sum_room: Room,
}

impl Engine {
    /// Nothing is on it yet.
    fn new(device: Device) -> Engine {
        let software = device.info().software;
        Engine {
            device,
            vertices_of: [None; 2],
            latest: 0,
            nodes_of: None,
            boxes_of: None,
            boxes_made: 0,
            hierarchy: Hierarchy::default(),
            most_work: MOST_WORK[usize::from(software)],
            open_room: crossings::OPEN_ROOM,
            count_room: Room::START,
            sum_room: Room::START,
        }
    }

    /// Runs commands that read the vertices of a frame, which go up with the first of them.
    fn run<R: Real>(
        &mut self,
        frame: &Frame<R>,
        commands: Vec<Command>,
    ) -> Result<Vec<Vec<u8>>, Trouble> {
        let pending = self.start(frame, commands)?;
        self.finish(pending)
    }

    /// The same without waiting for the work to be done.
    fn start<R: Real>(
        &mut self,
        frame: &Frame<R>,
        mut commands: Vec<Command>,
    ) -> Result<Pending, Trouble> {
        let slot = self.slot(frame);
        if self.vertices_of[slot] != Some(frame.id) {
            commands.insert(0, Command::upload(VERTICES[slot], &frame.vertices));
        }
        let started = self.device.start(&commands);
        let pending = started.inspect_err(|_| self.forget())?;
        self.vertices_of[slot] = Some(frame.id);
        self.latest = slot;
        Ok(pending)
    }

    /// Waits for what was started.
    fn finish(&mut self, pending: Pending) -> Result<Vec<Vec<u8>>, Trouble> {
        let done = self.device.finish(pending);
        done.inspect_err(|_| self.forget())
    }

    /// Where the vertices of a frame are, or will be: not where those of the latest are.
    fn slot<R: Real>(&self, frame: &Frame<R>) -> usize {
        let known = |id: &Option<u64>| *id == Some(frame.id);
        let found = self.vertices_of.iter().position(known);
        found.unwrap_or(1 - self.latest)
    }

    /// What a program reads of the vertices of a frame.
    fn vertices<R: Real>(&self, frame: &Frame<R>) -> Binding {
        let bytes = size_of_val(&frame.vertices[..]);
        Binding::whole(VERTICES[self.slot(frame)], bytes as u64)
    }

    /// Nobody knows what is on the adapter after a failure.
    fn forget(&mut self) {
        (self.vertices_of, self.nodes_of, self.boxes_of) = ([None; 2], None, None);
        self.hierarchy = Hierarchy::default();
    }

    /// What to say where not all was gone through that was listed. A system may break off what an adapter does, or a driver leave
    /// a loop, and not all say so: it looks as if all had been done, and as if nothing were linked. So all programs count.
    fn broken_off(&mut self) -> Trouble {
        self.forget();
        Trouble::Failed("its work was broken off".into())
    }

    /// Workgroups of a program that strides through a list whose length only the adapter knows. Not few in software: Mesa's
    /// leaves a loop after 65535 rounds, those of inner loops included, and says nothing.
    fn strides(&self) -> u32 {
        match self.device.info().software {
            true => 1024,
            false => 4096,
        }
    }

    /// Lists what it takes to run a program on tiles, `per_group` of them in a workgroup; `results` are bound after the
    /// parameters, the vertices and the tiles.
    fn dispatch_tiles<R: Real>(
        &self,
        commands: &mut Vec<Command>,
        stage: Stage,
        frame: &Frame<R>,
        tiles: &[Tile],
        per_group: u32,
        results: &[(Buffer, u64)],
    ) -> Result<(), Trouble> {
        let list = Buffer("tiles", stage.name);
        let most = self.device.most_bytes();
        // Parts of the list with their parameters have to fit, and are counted in 32 bits.
        let longest = (most / ALIGNMENT).min(1 << 24) as usize * STEP;
        for tiles in tiles.chunks(longest.max(STEP)) {
            let most = self.most_work / R::SLOWER;
            let parts = tiles::parts(tiles, STEP, longest, most);
            let counts: Vec<u32> = parts.iter().map(|part| part.len() as u32).collect();
            commands.push(Command::upload(list, tiles));
            self.dispatch_parts(commands, stage, frame, (list, &counts), per_group, results);
        }
        Ok(())
    }

    /// [`Engine::dispatch_tiles`] of so many tiles that are in a buffer already, each of at most so many pairs of segments.
    fn dispatch_buffer(
        &self,
        commands: &mut Vec<Command>,
        stage: Stage,
        frame: &Frame,
        (list, count, work): (Buffer, u32, u64),
        per_group: u32,
        results: &[(Buffer, u64)],
    ) {
        let most = self.most_work / work.max(1);
        let part = (most as u32).next_multiple_of(STEP as u32).max(STEP as u32);
        let counts: Vec<u32> = (0..count.div_ceil(part))
            .map(|k| part.min(count - k * part))
            .collect();
        self.dispatch_parts(commands, stage, frame, (list, &counts), per_group, results);
    }

    /// Lists a dispatch for each part of a list of tiles; all but the last have a multiple of [`STEP`].
    fn dispatch_parts<R: Real>(
        &self,
        commands: &mut Vec<Command>,
        stage: Stage,
        frame: &Frame<R>,
        (list, counts): (Buffer, &[u32]),
        per_group: u32,
        results: &[(Buffer, u64)],
    ) {
        let parameters = Buffer("parameters", stage.name);
        let own = |&items: &u32| Parameters {
            radius: frame.radius,
            zero: 0,
            first: 0,
            items,
        };
        let all: Vec<Parameters> = counts.iter().map(own).collect();
        commands.push(Command::parameters(parameters, &all));
        let mut at = 0;
        for (k, &count) in (0..).zip(counts) {
            let bytes = u64::from(count) * size_of::<Tile>() as u64;
            let mut bindings = vec![
                Binding::parameters(parameters, k),
                self.vertices(frame),
                Binding {
                    buffer: list,
                    offset: at,
                    size: bytes,
                },
            ];
            let results = results
                .iter()
                .map(|&(buffer, size)| Binding::whole(buffer, size));
            bindings.extend(results);
            commands.push(Command::Dispatch {
                stage,
                bindings,
                groups: count.div_ceil(per_group),
            });
            commands.push(Command::Submit);
            at += bytes;
        }
    }
}

/// Every program.
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

/// The programs that there are in either precision.
#[cfg(test)]
fn stages_in<R: Real>() -> Vec<Stage> {
    let mut all = vec![self_test::stage::<R>()];
    all.extend(direct::stages::<R>());
    all
}

/// A program in single precision; see [`program_in`].
fn program(whole: &[(&str, u32)], real: &[(&str, f64)], parts: &[&str]) -> String {
    program_in::<f32>(whole, real, parts)
}

/// A program, with its constants and what all share in front: a constant has one place, and that is in Rust.
fn program_in<R: Real>(whole: &[(&str, u32)], real: &[(&str, f64)], parts: &[&str]) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    for (name, value) in whole {
        let _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    for (name, value) in real {
        let _ = writeln!(out, "const {name}: real = {value:e};");
    }
    for part in [R::PROGRAM, include_str!("shared.wgsl")]
        .iter()
        .chain(parts)
    {
        out.push('\n');
        out.push_str(part);
    }
    out
}
