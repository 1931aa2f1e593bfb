//! The devices of the computer.

use esvo_core::{Device, DeviceKind};

/// The devices of the computer, best first: discrete GPUs, others, software drivers.
pub fn adapters() -> Vec<Device> {
    found().iter().map(describe).collect()
}

/// The adapters in the order of [`adapters`].
pub(crate) fn found() -> Vec<wgpu::Adapter> {
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

/// Whether passes can be timed by the device itself.
pub(crate) fn has_clock(adapter: &wgpu::Adapter) -> bool {
    adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY)
}

/// Name, kind, driver and clock of an adapter.
pub(crate) fn describe(adapter: &wgpu::Adapter) -> Device {
    let info = adapter.get_info();
    let software = info.device_type == wgpu::DeviceType::Cpu;
    let timing =
        if has_clock(adapter) { "timed by timestamp queries" } else { "timed by wall clock around submission" };
    Device {
        name: info.name,
        kind: if software { DeviceKind::SoftwareGpu } else { DeviceKind::Gpu },
        detail: format!("wgpu, Vulkan, {} {}, {timing}", info.driver, info.driver_info),
    }
}
