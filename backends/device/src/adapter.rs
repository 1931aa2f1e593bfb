//! The devices of the computer.

use esvo_core::{Device, DeviceKind};

/// The devices of the computer, best first: discrete GPUs, others, software drivers; of each kind, those through Vulkan, then
/// those through Metal or Direct3D 12.
pub fn adapters() -> Vec<Device> {
    found().iter().map(describe).collect()
}

/// The adapters in the order of [`adapters`].
pub(crate) fn found() -> Vec<wgpu::Adapter> {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    let descriptor = wgpu::InstanceDescriptor { backends, ..wgpu::InstanceDescriptor::new_without_display_handle() };
    let instance = wgpu::Instance::new(descriptor);
    let mut adapters = pollster::block_on(instance.enumerate_adapters(backends));
    adapters.sort_by_key(|adapter| {
        let info = adapter.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::Cpu => 2,
            _ => 1,
        };
        (kind, info.backend != wgpu::Backend::Vulkan)
    });
    adapters
}

/// Name, kind, driver and clock of an adapter.
pub(crate) fn describe(adapter: &wgpu::Adapter) -> Device {
    describe_as(adapter.get_info(), adapter.features())
}

/// The same for a device that has these features.
pub(crate) fn describe_as(info: wgpu::AdapterInfo, features: wgpu::Features) -> Device {
    let has_clock = features.contains(wgpu::Features::TIMESTAMP_QUERY);
    let software = info.device_type == wgpu::DeviceType::Cpu;
    let timing = if has_clock { "timed by timestamp queries" } else { "timed by wall clock around submission" };
    Device {
        name: info.name,
        kind: if software { DeviceKind::SoftwareGpu } else { DeviceKind::Gpu },
        detail: format!("wgpu, {}, {} {}, {timing}", backend(info.backend), info.driver, info.driver_info),
    }
}

fn backend(backend: wgpu::Backend) -> &'static str {
    match backend {
        wgpu::Backend::Vulkan => "Vulkan",
        wgpu::Backend::Metal => "Metal",
        wgpu::Backend::Dx12 => "Direct3D 12",
        wgpu::Backend::Gl => "OpenGL",
        wgpu::Backend::BrowserWebGpu => "WebGPU",
        _ => "no backend",
    }
}
