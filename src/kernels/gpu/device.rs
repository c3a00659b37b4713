//! The adapter and the execution of command lists on it. No other file uses wgpu.

use super::commands::{Binding, Buffer, Command, Stage, grid};
use super::error::Error;
use super::select::select;
use crate::kernels::device::{Device, DeviceInfo};
use std::collections::HashMap;
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, mpsc};
use std::task::{Context, Poll, Waker};
use std::time::Duration;
use wgpu::PollType;

/// Time-out of a submission. Work is cut into batches that take far less; an adapter that does not
/// respond within this time has hung.
const PATIENCE: Duration = Duration::from_secs(120);

/// An open adapter with its pipelines and buffers.
#[derive(Debug)]
pub(super) struct Adapter {
    pub info: DeviceInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    limits: wgpu::Limits,
    pipelines: HashMap<&'static str, wgpu::ComputePipeline>,
    pub buffers: HashMap<Buffer, wgpu::Buffer>,
    /// True if the adapter is lost or has failed once.
    pub lost: Arc<AtomicBool>,
    /// First error that wgpu reported outside of an error scope, until it is taken.
    uncaptured: Arc<Mutex<Option<String>>>,
    /// Maximum size of a buffer in bytes.
    pub max_buffer_bytes: u64,
}

/// Submitted work and the buffers for its downloads.
#[derive(Debug)]
pub(crate) struct Pending {
    submitted: Vec<wgpu::SubmissionIndex>,
    staged: Vec<wgpu::Buffer>,
}
/// Features that double precision needs; pinning uses 64-bit integers.
const DOUBLE: wgpu::Features = wgpu::Features::SHADER_F64.union(wgpu::Features::SHADER_INT64);

/// Returns all adapters in the order of their indices.
fn adapters() -> Vec<wgpu::Adapter> {
    // One for the process: NVIDIA's driver finds no adapter any more after some thirty instances,
    // although each of them was dropped (580.159, H200).
    static INSTANCE: LazyLock<wgpu::Instance> = LazyLock::new(|| {
        wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        })
    });
    let enumerated = INSTANCE.enumerate_adapters(wgpu::Backends::all());
    let mut found = block_on(enumerated);
    // The sort is stable.
    found.sort_by_key(|a| rank(a.get_info().device_type));
    found
}

fn info((index, adapter): (usize, &wgpu::Adapter)) -> DeviceInfo {
    let about = adapter.get_info();
    let limits = adapter.limits();
    DeviceInfo {
        index,
        name: about.name,
        backend: format!("{:?}", about.backend),
        kind: format!("{:?}", about.device_type),
        driver: format!("{} {}", about.driver, about.driver_info),
        software: about.device_type == wgpu::DeviceType::Cpu,
        double_precision: adapter.features().contains(DOUBLE),
        max_buffer_bytes: limits.max_buffer_size,
        max_binding_bytes: limits.max_storage_buffer_binding_size,
        unusable: None,
    }
}

/// Returns the properties of all adapters.
pub(super) fn list() -> Vec<DeviceInfo> {
    adapters().iter().enumerate().map(info).collect()
}

impl Adapter {
    /// Opens an adapter. It computes in double precision if `double` is set and the adapter
    /// supports it.
    pub fn open(wanted: &Device, double: bool) -> Result<Adapter, Error> {
        let found = adapters();
        let mut all: Vec<DeviceInfo> = found.iter().enumerate().map(info).collect();
        let at = select(wanted, &all).map_err(Error::NoAdapter)?;
        let (adapter, mut info) = (&found[at], all.swap_remove(at));
        // Requests only what is used: the largest buffers, and otherwise the limits that every
        // adapter has.
        let has = adapter.limits();
        let limits = wgpu::Limits {
            max_buffer_size: has.max_buffer_size,
            max_storage_buffer_binding_size: has.max_storage_buffer_binding_size,
            // Barnes-Hut needs 8, which every adapter supports.
            max_storage_buffers_per_shader_stage: 8,
            max_compute_workgroups_per_dimension: has.max_compute_workgroups_per_dimension,
            ..wgpu::Limits::downlevel_defaults()
        };
        info.double_precision &= double;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("linkwatch"),
            required_limits: limits.clone(),
            required_features: match info.double_precision {
                true => DOUBLE,
                false => wgpu::Features::empty(),
            },
            ..Default::default()
        });
        let (device, queue) = block_on(request).map_err(failed)?;
        let lost = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&lost);
        device.set_device_lost_callback(move |_, _| flag.store(true, Ordering::Relaxed));
        let uncaptured = Arc::new(Mutex::new(None));
        let to = Arc::clone(&uncaptured);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            let mut first = to.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| e.to_string());
        }));
        Ok(Adapter {
            device,
            queue,
            max_buffer_bytes: info.max_buffer_bytes.min(info.max_binding_bytes),
            info,
            limits,
            pipelines: HashMap::new(),
            buffers: HashMap::new(),
            lost,
            uncaptured,
        })
    }

    /// Returns the number of bytes in buffers.
    #[cfg(test)]
    pub fn bytes(&self) -> u64 {
        self.buffers.values().map(wgpu::Buffer::size).sum()
    }

    /// Restricts buffers to a maximum size in bytes.
    #[cfg(test)]
    pub fn restrict(&mut self, most: u64) {
        self.max_buffer_bytes = most;
        self.buffers.clear();
    }

    /// Destroys the device, as a driver reset would.
    #[cfg(test)]
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Runs the commands and returns the downloads, in their order. Without a download it does not
    /// wait for the work, and an error of the work is reported by the next run.
    pub fn run(&mut self, commands: &[Command]) -> Result<Vec<Vec<u8>>, Error> {
        let pending = self.start(commands)?;
        self.finish(pending)
    }

    /// Submits the commands without waiting for them.
    pub fn start(&mut self, commands: &[Command]) -> Result<Pending, Error> {
        self.checked(|device| device.submit_all(commands))
    }

    /// Waits for the work and returns the downloads, in their order.
    pub fn finish(&mut self, pending: Pending) -> Result<Vec<Vec<u8>>, Error> {
        match pending.staged.is_empty() {
            true => Ok(Vec::new()),
            false => self.checked(|device| device.read(pending)),
        }
    }

    /// Runs `what` and returns the errors that wgpu reports meanwhile.
    fn checked<T>(
        &mut self,
        what: impl FnOnce(&mut Adapter) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let filters = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let done = what(self);
        let mut errors = Vec::new();
        // Error scopes are popped in reverse order.
        for scope in scopes.into_iter().rev() {
            errors.extend(block_on(scope.pop()).map(failed));
        }
        let uncaptured = self.uncaptured.lock();
        let uncaptured = uncaptured.unwrap_or_else(PoisonError::into_inner).take();
        errors.extend(uncaptured.map(Error::Failed));
        if self.lost.load(Ordering::Relaxed) {
            return Err(Error::Failed("the adapter was lost".into()));
        }
        let done = errors.into_iter().next().map_or(done, Err);
        if let Err(Error::Failed(_)) = done {
            // The loss of a device may be reported later. The mark makes the next caller open the
            // adapter again.
            self.lost.store(true, Ordering::Relaxed);
        }
        done
    }

    fn submit_all(&mut self, commands: &[Command]) -> Result<Pending, Error> {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut recorded = false;
        let mut submitted = Vec::new();
        let mut staged = Vec::new();
        for command in commands {
            match command {
                Command::Reserve(buffer, bytes) => self.reserve(*buffer, *bytes)?,
                Command::Upload(buffer, bytes) => {
                    let padded = (bytes.len() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
                    self.reserve(*buffer, padded)?;
                    // Commands recorded before the upload must not see the new data.
                    if std::mem::take(&mut recorded) {
                        submitted.push(self.submit(&mut encoder));
                    }
                    self.queue.write_buffer(&self.buffers[buffer], 0, bytes);
                }
                Command::Clear(buffer, bytes) => {
                    self.reserve(*buffer, *bytes)?;
                    recorded = true;
                    encoder.clear_buffer(&self.buffers[buffer], 0, Some(*bytes));
                }
                Command::Dispatch {
                    stage,
                    bindings,
                    groups,
                } => {
                    recorded = true;
                    self.dispatch(&mut encoder, *stage, bindings, *groups)?;
                }
                Command::Submit => {
                    recorded = false;
                    submitted.push(self.submit(&mut encoder));
                }
                Command::Download(buffer, bytes) => {
                    let target = self.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("download"),
                        size: *bytes,
                        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    });
                    let Some(source) = self.buffers.get(buffer) else {
                        return Err(failed("download from a missing buffer (internal error)"));
                    };
                    recorded = true;
                    encoder.copy_buffer_to_buffer(source, 0, &target, 0, *bytes);
                    staged.push(target);
                }
            }
        }
        submitted.push(self.submit(&mut encoder));
        Ok(Pending { submitted, staged })
    }

    fn read(&self, Pending { submitted, staged }: Pending) -> Result<Vec<Vec<u8>>, Error> {
        let (send, receive) = mpsc::channel();
        for buffer in &staged {
            let send = send.clone();
            buffer.map_async(wgpu::MapMode::Read, .., move |done| {
                // Sending fails only if the receiver has timed out.
                let _ = send.send(done);
            });
        }
        for index in submitted {
            let wait = PollType::Wait {
                submission_index: Some(index),
                timeout: Some(PATIENCE),
            };
            self.device.poll(wait).map_err(failed)?;
        }
        for _ in &staged {
            let mapped = receive.recv_timeout(PATIENCE).map_err(failed)?;
            mapped.map_err(failed)?;
        }
        let contents = |buffer: &wgpu::Buffer| {
            let bytes = buffer.get_mapped_range(..).map_err(failed)?.to_vec();
            buffer.unmap();
            Ok(bytes)
        };
        staged.iter().map(contents).collect()
    }

    /// Submits the recorded commands and starts a new encoder.
    fn submit(&self, encoder: &mut wgpu::CommandEncoder) -> wgpu::SubmissionIndex {
        let fresh = self.device.create_command_encoder(&Default::default());
        let full = std::mem::replace(encoder, fresh);
        self.queue.submit([full.finish()])
    }

    /// Grows a buffer to at least `bytes`.
    fn reserve(&mut self, buffer: Buffer, bytes: u64) -> Result<(), Error> {
        let most = self.max_buffer_bytes;
        if bytes > most {
            return Err(Error::limit("bytes in a buffer", bytes, most));
        }
        if self.buffers.get(&buffer).is_some_and(|b| b.size() >= bytes) {
            return Ok(());
        }
        // Rounded up, so that a frame with a few more segments needs no new buffer.
        let size = bytes.next_power_of_two().max(256).min(most).max(bytes);
        let made = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(buffer.0),
            size: size.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::UNIFORM
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.buffers.insert(buffer, made);
        Ok(())
    }

    fn dispatch(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        stage: Stage,
        bindings: &[Binding],
        groups: u32,
    ) -> Result<(), Error> {
        let [x, y] = grid(groups, self.limits.max_compute_workgroups_per_dimension)?;
        let device = &self.device;
        let pipeline = self.pipelines.entry(stage.name).or_insert_with(|| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(stage.name),
                source: wgpu::ShaderSource::Wgsl((stage.source)().into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(stage.name),
                layout: None,
                module: &module,
                entry_point: Some("main"),
                // Shaders initialize the workgroup memory that they read.
                compilation_options: wgpu::PipelineCompilationOptions {
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        });
        let mut entries = Vec::new();
        for (k, b) in (0..).zip(bindings) {
            let Some(buffer) = self.buffers.get(&b.buffer) else {
                return Err(failed("binding to a missing buffer (internal error)"));
            };
            entries.push(wgpu::BindGroupEntry {
                binding: k,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer,
                    offset: b.offset,
                    size: std::num::NonZero::new(b.size),
                }),
            });
        }
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(stage.name),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}

/// Returns the rank of a kind of adapter: the fastest kinds first.
fn rank(kind: wgpu::DeviceType) -> Option<usize> {
    use wgpu::DeviceType::*;
    let ranked = [DiscreteGpu, IntegratedGpu, VirtualGpu, Other, Cpu];
    ranked.iter().position(|&k| k == kind)
}

fn failed(e: impl std::fmt::Display) -> Error {
    Error::Failed(e.to_string())
}

/// Waits for a future that needs no executor: the futures of wgpu are ready at once, except in
/// browsers.
fn block_on<F: Future>(future: F) -> F::Output {
    let mut context = Context::from_waker(Waker::noop());
    let mut future = pin!(future);
    loop {
        match future.as_mut().poll(&mut context) {
            Poll::Ready(out) => return out,
            Poll::Pending => std::thread::yield_now(),
        }
    }
}
