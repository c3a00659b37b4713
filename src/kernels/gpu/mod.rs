//! Kernels on a graphics processor, through Vulkan, Metal or DX12: all pairs of curves in one list of commands.
//!
//! A stage has one name, on the processor's side (`.rs`: work lists, the proof of its bounds, what becomes of the result) and on
//! the adapter's (`.wgsl`). [`device`] owns the adapter, and is the only file that knows the graphics interface;
//! [`commands`] is what the others tell it, and [`layout`] what both sides read.
//!
//! Source: Qu & James 2021, section 3.4.5, who launch their kernels pair by pair in single precision and name all
//! pairs at once as future work. Here all pairs are one work list of tiles, and single precision comes with a proof: crossings
//! that it cannot decide go to the processor, sums have a bound of their error.
//!
//! The vertices go up once a frame, ahead of the processor's own work on it; programs and buffers stay for the next. Lists
//! are cut so that no buffer is larger than the adapter allows and no submission so long that it is taken for hung.
//!
//! An adapter is trusted with single operations only, and after a test ([`self_test`]). Whatever else fails, a lost adapter, too
//! little memory, too large a frame, is [`Trouble`]: the caller says so and computes on the processor.

mod barnes_hut;
mod commands;
mod crossings;
mod device;
mod direct;
mod error;
mod fixed;
mod frame;
mod layout;
mod measure;
mod self_test;
#[cfg(test)]
mod tests;
mod tiles;

pub(crate) use error::Trouble;
pub use measure::{DeviceTimes, measure};

use self::commands::{ALIGNMENT, Binding, Buffer, Command, Stage};
use self::device::Device;
pub(crate) use self::frame::Frame;
use self::layout::{Parameters, Tile};
use super::crossings::Scene;
use super::device::{Device as Choice, DeviceInfo};
use super::{Estimate, Linking, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use crate::verdict::Stats;
use std::fmt::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

const PARAMETERS: Buffer = Buffer("parameters", "all");
const VERTICES: Buffer = Buffer("vertices", "all");
const SUMS: Buffer = Buffer("sums", "all");

/// Parts of lists of tiles start at multiples of this.
const STEP: usize = ALIGNMENT as usize / size_of::<Tile>();

/// Pairs of segments in one submission, at most: a fraction of a second of a slow adapter, and of the processor in disguise.
const MOST_WORK: [u64; 2] = [1 << 31, 1 << 28];

/// All adapters, each opened and tested.
pub(super) fn devices() -> Vec<DeviceInfo> {
    let mut all = device::list();
    for info in &mut all {
        let opened = Gpu::open(&Choice::Named(info.name.clone()));
        info.trouble = opened.err().map(|e| e.to_string());
    }
    all
}

/// Linking numbers, the counts of the work, and how many tests were left to the processor.
type Counts = (Vec<Linking>, Stats, u64);

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
        let name = match choice {
            Choice::Named(name) => Some(&name[..]),
            _ => None,
        };
        let mut engine = Engine {
            device: Device::open(name)?,
            vertices_of: None,
            nodes_of: None,
            room: crossings::ROOM,
            agenda_room: barnes_hut::ROOM,
        };
        self_test::run(&mut engine)?;
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
            if !gpu.lock().device.is_lost() {
                return Ok(gpu);
            }
            open.retain(|(known, _)| known != choice);
        }
        let gpu = Arc::new(Gpu::open(choice)?);
        open.push((choice.clone(), Arc::downgrade(&gpu)));
        Ok(gpu)
    }

    fn lock(&self) -> MutexGuard<'_, Engine> {
        // Buffers are written before they are read, so an engine that panicked is as good as any.
        self.engine.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Which adapter it is.
    pub fn info(&self) -> DeviceInfo {
        self.lock().device.info().clone()
    }

    /// Makes the vertices of a set ready and sends them up, without waiting for that.
    pub fn send(&self, set: &CurveSet) -> Result<Frame, Trouble> {
        let frame = Frame::new(set);
        self.lock().run(&frame, &[])?;
        Ok(frame)
    }

    /// Linking numbers of polylines by counting crossings; `frame` has their vertices.
    pub fn count(
        &self,
        frame: &Frame,
        scene: Scene<'_>,
        pairs: &[Pair],
    ) -> Result<Counts, Trouble> {
        crossings::linking_numbers(self, frame, scene, pairs)
    }

    /// Direct sums over polylines, vertices included.
    pub fn sum_directly(&self, set: &CurveSet, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        direct::linking_numbers(&mut self.lock(), &Frame::new(set), pairs)
    }

    /// Barnes-Hut by the bound, vertices and trees included.
    pub fn sum_by_trees(&self, set: &CurveSet, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        let frame = Frame::new(set);
        let forest = barnes_hut::Forest::new(&frame);
        barnes_hut::linking_numbers(&mut self.lock(), &frame, &forest, pairs, None)
    }
}

/// The Gauss sum on an adapter, or on the processor once the adapter failed.
pub(super) struct DirectSum<'a> {
    gpu: &'a Gpu,
    frame: Frame,
    otherwise: Box<dyn Summation + 'a>,
}

impl<'a> DirectSum<'a> {
    /// Prepares the vertices of a set of polylines.
    pub fn new(gpu: &'a Gpu, set: &CurveSet, otherwise: Box<dyn Summation + 'a>) -> DirectSum<'a> {
        DirectSum {
            gpu,
            frame: Frame::new(set),
            otherwise,
        }
    }
}

impl Summation for DirectSum<'_> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        self.linking_numbers(&[pair])[0]
    }

    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        let found = direct::linking_numbers(&mut self.gpu.lock(), &self.frame, pairs);
        found.unwrap_or_else(|trouble| {
            tracing::warn!("the sums are made on the processor: {trouble}");
            self.otherwise.linking_numbers(pairs)
        })
    }
}

/// Barnes-Hut on an adapter, or on the processor once the adapter failed.
pub(super) struct BarnesHutSum<'a> {
    gpu: &'a Gpu,
    frame: Frame,
    forest: barnes_hut::Forest,
    beta: Option<f64>,
    otherwise: MakeSummation<'a>,
}

/// Makes the kernel of the processor, whose trees take time.
pub(super) type MakeSummation<'a> = Box<dyn Fn() -> Box<dyn Summation + 'a> + Sync + 'a>;

impl<'a> BarnesHutSum<'a> {
    /// Builds the trees of a set of polylines; `beta` leaves it at one pass by distance.
    pub fn new(
        gpu: &'a Gpu,
        set: &CurveSet,
        beta: Option<f64>,
        otherwise: MakeSummation<'a>,
    ) -> BarnesHutSum<'a> {
        let frame = Frame::new(set);
        BarnesHutSum {
            gpu,
            forest: barnes_hut::Forest::new(&frame),
            frame,
            beta,
            otherwise,
        }
    }
}

impl Summation for BarnesHutSum<'_> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        self.linking_numbers(&[pair])[0]
    }

    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        // Not locked while the processor sums: its threads may take up work that wants the adapter.
        let found = barnes_hut::linking_numbers(
            &mut self.gpu.lock(),
            &self.frame,
            &self.forest,
            pairs,
            self.beta,
        );
        found.unwrap_or_else(|trouble| {
            tracing::warn!("the sums are made on the processor: {trouble}");
            (self.otherwise)().linking_numbers(pairs)
        })
    }
}

/// An adapter with what is on it.
#[derive(Debug)]
pub(super) struct Engine {
    device: Device,
    /// The frame whose vertices are on it.
    vertices_of: Option<u64>,
    /// The frame whose trees are on it.
    nodes_of: Option<u64>,
    /// Undecided tests that there is room for.
    room: u32,
    /// Node pairs and tiles of Barnes-Hut that there is room for.
    agenda_room: [u32; 2],
}

impl Engine {
    /// Runs commands that read the vertices of a frame, which go up with the first of them.
    fn run(&mut self, frame: &Frame, commands: &[Command]) -> Result<Vec<Vec<u8>>, Trouble> {
        if self.vertices_of == Some(frame.id) {
            return self.device.run(commands);
        }
        self.vertices_of = None;
        let vertices = bytemuck::cast_slice(&frame.vertices).to_vec();
        let mut all = vec![Command::Upload(VERTICES, vertices)];
        all.extend_from_slice(commands);
        let done = self.device.run(&all)?;
        self.vertices_of = Some(frame.id);
        Ok(done)
    }

    /// Lists what it takes to run a program on tiles, `per_group` of them in a workgroup; `results` are bound after the
    /// parameters, the vertices and the tiles.
    fn dispatch_tiles(
        &self,
        commands: &mut Vec<Command>,
        stage: Stage,
        frame: &Frame,
        tiles: &[Tile],
        per_group: u32,
        results: &[(Buffer, u64)],
    ) -> Result<(), Trouble> {
        let list = Buffer("tiles", stage.name);
        let most = self.device.most_bytes();
        // Parts of the list with their parameters have to fit, and are counted in 32 bits.
        let longest = (most / ALIGNMENT).min(1 << 24) as usize * STEP;
        let most_work = MOST_WORK[usize::from(self.device.info().software)];
        for tiles in tiles.chunks(longest.max(STEP)) {
            let parts = tiles::parts(tiles, STEP, longest, most_work);
            let counts: Vec<u32> = parts.iter().map(|part| part.len() as u32).collect();
            commands.push(Command::Upload(list, bytemuck::cast_slice(tiles).to_vec()));
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
        let most = MOST_WORK[usize::from(self.device.info().software)] / work.max(1);
        let part = (most as u32).next_multiple_of(STEP as u32).max(STEP as u32);
        let counts: Vec<u32> = (0..count.div_ceil(part))
            .map(|k| part.min(count - k * part))
            .collect();
        self.dispatch_parts(commands, stage, frame, (list, &counts), per_group, results);
    }

    /// Lists a dispatch for each part of a list of tiles; all but the last have a multiple of [`STEP`].
    fn dispatch_parts(
        &self,
        commands: &mut Vec<Command>,
        stage: Stage,
        frame: &Frame,
        (list, counts): (Buffer, &[u32]),
        per_group: u32,
        results: &[(Buffer, u64)],
    ) {
        let parameters = Buffer("parameters", stage.name);
        let mut all = vec![0; counts.len() * ALIGNMENT as usize];
        for (&count, to) in counts.iter().zip(all.chunks_mut(ALIGNMENT as usize)) {
            let own = Parameters {
                radius: frame.radius,
                zero: 0,
                capacity: self.room,
                items: count,
            };
            to[..size_of::<Parameters>()].copy_from_slice(bytemuck::bytes_of(&own));
        }
        commands.push(Command::Upload(parameters, all));
        let mut at = 0;
        for (k, &count) in (0..).zip(counts) {
            let bytes = u64::from(count) * size_of::<Tile>() as u64;
            let binding = |buffer, offset, size| Binding {
                buffer,
                offset,
                size,
            };
            let vertices = size_of_val(&frame.vertices[..]) as u64;
            let mut bindings = vec![
                binding(parameters, k * ALIGNMENT, size_of::<Parameters>() as u64),
                binding(VERTICES, 0, vertices),
                binding(list, at, bytes),
            ];
            bindings.extend(
                results
                    .iter()
                    .map(|&(buffer, size)| binding(buffer, 0, size)),
            );
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
    let mut all = vec![self_test::STAGE, crossings::STAGE, barnes_hut::STAGE];
    all.extend(direct::SHAPES.map(|(_, stage)| stage));
    all
}

/// A program, with its constants and what all share in front: a constant has one place, and that is in Rust.
fn program(whole: &[(&str, u32)], real: &[(&str, f64)], parts: &[&str]) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    for (name, value) in whole {
        let _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    for (name, value) in real {
        let _ = writeln!(out, "const {name}: f32 = {:e}f;", *value as f32);
    }
    out.push_str(include_str!("shared.wgsl"));
    for part in parts {
        out.push('\n');
        out.push_str(part);
    }
    out
}
