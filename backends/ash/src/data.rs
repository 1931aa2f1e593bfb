//! What kernels only read, on the device: an octree, or nodes and triangles.

use std::sync::Arc;

use ash::vk::BufferUsageFlags as Usage;
use bytemuck::Pod;
use esvo_core::CastError;
use esvo_core::gpu::kernel::{GpuOptions, SlotLimits};
use esvo_core::gpu::slots::Slots;

use crate::buffers::{Buffer, fill};
use crate::gpu::Gpu;
use crate::texture::Texture;

/// Data is copied in pieces of about this many bytes.
const STAGING_BYTES: u64 = 64 << 20;

/// Slots on the device.
pub(crate) enum Data {
    Buffers(Vec<Buffer>),
    Texture(Texture),
}

impl Data {
    /// Copies slots to the device.
    pub(crate) fn upload<T: Pod>(gpu: &Arc<Gpu>, place: Slots, slots: &[T]) -> Result<Self, CastError> {
        let bytes = size_of_val(slots) as u64;
        let staging = |unit: u64| {
            let bytes = STAGING_BYTES.min(bytes.next_multiple_of(unit)).max(unit);
            Buffer::on_host(gpu, bytes, Usage::TRANSFER_SRC)
        };
        if let Slots::Texture { row_shift } = place {
            let mut staging = staging((size_of::<T>() as u64) << row_shift)?;
            return Ok(Self::Texture(Texture::upload(gpu, slots, row_shift, &mut staging)?));
        }
        let mut staging = staging(8)?;
        // All memory is there before anything is copied. A binding holds one slot at least.
        let usage = Usage::STORAGE_BUFFER | Usage::TRANSFER_DST;
        let buffer = |part: &[T]| Buffer::on_device(gpu, size_of_val(part).max(size_of::<T>()) as u64, usage);
        let mut buffers = place.parts(slots).map(buffer).collect::<Result<Vec<_>, _>>()?;
        for (buffer, part) in buffers.iter().zip(place.parts(slots)) {
            fill(gpu, buffer, part, &mut staging)?;
        }
        if buffers.is_empty() {
            buffers.push(buffer(&[])?);
        }
        Ok(Self::Buffers(buffers))
    }
}

/// What device and options allow for slots.
pub(crate) fn slot_limits(gpu: &Gpu, options: &GpuOptions) -> SlotLimits {
    let limits = &gpu.adapter.limits;
    let max_bytes = u64::from(limits.max_storage_buffer_range).min(gpu.adapter.max_allocation);
    SlotLimits {
        binding_bytes: options.max_part_bytes.unwrap_or(u64::MAX).min(max_bytes),
        storage_buffers: limits.max_per_stage_descriptor_storage_buffers.min(limits.max_descriptor_set_storage_buffers),
        texture_edge: options.texture_edge(gpu.about().kind, gpu.adapter.texture_edge),
        memory_bytes: options.memory_bytes.or_else(|| gpu.memory_bytes()),
    }
}
