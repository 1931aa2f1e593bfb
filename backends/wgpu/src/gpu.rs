//! Finding a device, and turning what wgpu reports into errors.

use std::sync::{Arc, Mutex, PoisonError};

use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::{CastError, Device, DeviceKind};

/// An open device and its queue.
pub(crate) struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) about: Device,
    pub(crate) limits: wgpu::Limits,
    /// Whether passes can be timed by the device itself.
    pub(crate) timestamps: bool,
    errors: Arc<Mutex<Option<String>>>,
}

/// The devices there are, best first: discrete GPUs, others, software.
pub fn adapters() -> Vec<Device> {
    found().iter().map(|adapter| describe(adapter, adapter_times(adapter))).collect()
}

fn found() -> Vec<wgpu::Adapter> {
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let instance = wgpu::Instance::new(descriptor);
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::Cpu => 2,
        _ => 1,
    });
    adapters
}

fn adapter_times(adapter: &wgpu::Adapter) -> bool {
    adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY)
}

fn describe(adapter: &wgpu::Adapter, timestamps: bool) -> Device {
    let info = adapter.get_info();
    let software = info.device_type == wgpu::DeviceType::Cpu;
    let timing = if timestamps { "timed by timestamp queries" } else { "timed by wall clock around submission" };
    Device {
        name: info.name,
        kind: if software { DeviceKind::SoftwareGpu } else { DeviceKind::Gpu },
        detail: format!("wgpu, Vulkan, {} {}, {timing}", info.driver, info.driver_info),
    }
}

impl Gpu {
    pub(crate) fn open(options: &GpuOptions) -> Result<Self, CastError> {
        let adapters = found();
        if adapters.is_empty() {
            return Err(CastError::Device(
                "no Vulkan device: install the driver of the GPU, or the software driver (Debian: mesa-vulkan-drivers)"
                    .into(),
            ));
        }
        let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
        let Some(adapter) = adapters.into_iter().find(|adapter| options.admits(&adapter.get_info().name)) else {
            return Err(CastError::Device(format!(
                "no Vulkan device is called {:?}: there are {}",
                options.adapter.as_deref().unwrap_or_default(),
                names.join(", ")
            )));
        };
        let timestamps = adapter_times(&adapter);
        let limits = adapter.limits();
        let descriptor = wgpu::DeviceDescriptor {
            required_features: if timestamps { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() },
            required_limits: limits.clone(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..wgpu::DeviceDescriptor::default()
        };
        let about = describe(&adapter, timestamps);
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| CastError::Device(format!("{}: {error}", about.name)))?;
        let errors = Arc::new(Mutex::new(None));
        let first = errors.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            first.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error.to_string());
        }));
        Ok(Self { device, queue, about, limits, timestamps, errors })
    }

    /// The first error since the last call, if any.
    pub(crate) fn check(&self) -> Result<(), CastError> {
        match self.errors.lock().unwrap_or_else(PoisonError::into_inner).take() {
            None => Ok(()),
            Some(what) => Err(self.error(&what)),
        }
    }

    /// An error of this device.
    pub(crate) fn error(&self, what: &dyn std::fmt::Display) -> CastError {
        CastError::Device(format!("{}: {what}", self.about.name))
    }

    /// Waits until everything submitted is done.
    pub(crate) fn wait(&self) -> Result<(), CastError> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| self.error(&error))?;
        self.check()
    }

    pub(crate) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, CastError> {
        if size > self.limits.max_buffer_size {
            return Err(self.error(&format!("a buffer of {size} bytes is more than it allows")));
        }
        let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        self.check()?;
        Ok(buffer)
    }
}
