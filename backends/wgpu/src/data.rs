//! What kernels only read, on the device: an octree, or nodes and triangles.

use bytemuck::Pod;
use esvo_core::gpu::kernel::{GpuOptions, SlotLimits};
use esvo_core::gpu::slots::{SlotKind, Slots};
use esvo_device::{DeviceError, Gpu, Usage, read_texture, storage};

/// Slots on the device.
pub(crate) struct Data {
    kind: SlotKind,
    parts: Parts,
}

enum Parts {
    Buffers(Vec<wgpu::Buffer>),
    Texture(wgpu::TextureView),
}

fn format(kind: SlotKind) -> wgpu::TextureFormat {
    match kind {
        SlotKind::Pair => wgpu::TextureFormat::Rg32Uint,
        SlotKind::Quad => wgpu::TextureFormat::Rgba32Uint,
    }
}

impl Data {
    /// Copies slots, which are of this kind, to the device.
    pub(crate) fn upload<T: Pod>(
        gpu: &Gpu,
        label: &str,
        kind: SlotKind,
        place: Slots,
        slots: &[T],
    ) -> Result<Self, DeviceError> {
        if let Slots::Texture { row_shift } = place {
            let texture = gpu.upload_texture(label, format(kind), 1 << row_shift, slots)?;
            return Ok(Self { kind, parts: Parts::Texture(texture) });
        }
        // All memory is there before anything is copied. A binding holds one slot at least.
        let usage = Usage::STORAGE | Usage::COPY_DST;
        let buffer = |part: &[T]| gpu.buffer(label, size_of_val(part).max(size_of::<T>()) as u64, usage);
        let mut buffers = place.parts(slots).map(buffer).collect::<Result<Vec<_>, _>>()?;
        for (buffer, part) in buffers.iter().zip(place.parts(slots)) {
            gpu.fill(buffer, part)?;
        }
        if buffers.is_empty() {
            buffers.push(buffer(&[])?);
        }
        Ok(Self { kind, parts: Parts::Buffers(buffers) })
    }

    /// Binds slots one behind the other.
    pub(crate) fn bind(
        gpu: &Gpu,
        label: &str,
        data: &[&Self],
    ) -> Result<(wgpu::BindGroupLayout, wgpu::BindGroup), DeviceError> {
        let (mut entries, mut resources) = (Vec::new(), Vec::new());
        for data in data {
            match &data.parts {
                Parts::Buffers(buffers) => {
                    for buffer in buffers {
                        entries.push(storage(entries.len() as u32, true));
                        resources.push(buffer.as_entire_binding());
                    }
                }
                Parts::Texture(texture) => {
                    entries.push(read_texture(entries.len() as u32, format(data.kind)));
                    resources.push(wgpu::BindingResource::TextureView(texture));
                }
            }
        }
        let layout = gpu.bind_group_layout(label, &entries)?;
        let group = gpu.bind_resources(&layout, resources)?;
        Ok((layout, group))
    }
}

/// What device and options allow for slots.
pub(crate) fn slot_limits(gpu: &Gpu, options: &GpuOptions) -> SlotLimits {
    SlotLimits {
        binding_bytes: options.max_part_bytes.unwrap_or(u64::MAX).min(gpu.max_storage_bytes()),
        storage_buffers: gpu.limits().max_storage_buffers_per_shader_stage,
        texture_edge: options.texture_edge(gpu.about().kind, gpu.limits().max_texture_dimension_2d),
        memory_bytes: options.memory_bytes,
    }
}
