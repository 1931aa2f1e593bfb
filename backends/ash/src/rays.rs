//! Lists of rays: their buffers and their submission.

use std::sync::Arc;

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::gpu::kernel::{self, WORKGROUP};
use esvo_core::{CastError, Hit, Ray, View};

use crate::buffers::Buffer;
use crate::gpu::Gpu;
use crate::pipeline::{BufferSet, Pipeline};

/// Fewest rays that buffers are made for.
const SMALLEST: usize = 1 << 10;

/// Something that uses buffers: its stage, and how it writes and reads.
pub(crate) type User = (vk::PipelineStageFlags, vk::AccessFlags, vk::AccessFlags);

pub(crate) const TRANSFER: User =
    (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE, vk::AccessFlags::TRANSFER_READ);
pub(crate) const SHADER: User =
    (vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE, vk::AccessFlags::SHADER_READ);
pub(crate) const HOST: User = (vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_WRITE, vk::AccessFlags::HOST_READ);

/// Makes what one user has written visible to the next.
pub(crate) fn wait(device: &ash::Device, commands: vk::CommandBuffer, before: User, after: User) {
    let barrier = [vk::MemoryBarrier::default().src_access_mask(before.1).dst_access_mask(after.2)];
    let none = vk::DependencyFlags::empty();
    // SAFETY: the command buffer is being recorded; the barrier names no objects.
    unsafe { device.cmd_pipeline_barrier(commands, before.0, after.0, none, &barrier, &[], &[]) };
}

/// Buffers for the rays of one dispatch.
pub(crate) struct RayBuffers {
    set: BufferSet,
    view: Buffer,
    /// On the host, and on the device.
    rays: [Buffer; 2],
    /// On the device, and on the host.
    hits: [Buffer; 2],
    capacity: usize,
}

impl RayBuffers {
    /// Buffers for `count` rays at least, at most `most`.
    pub(crate) fn new(gpu: &Arc<Gpu>, count: usize, most: usize) -> Result<Self, CastError> {
        let capacity = count.next_power_of_two().max(SMALLEST).min(most);
        let (ray_bytes, hit_bytes) = ((capacity * size_of::<Ray>()) as u64, (capacity * size_of::<Hit>()) as u64);
        let view = Buffer::on_host(gpu, size_of::<View>() as u64, Usage::UNIFORM_BUFFER)?;
        let rays = [
            Buffer::on_host(gpu, ray_bytes, Usage::TRANSFER_SRC)?,
            Buffer::on_device(gpu, ray_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_DST)?,
        ];
        let hits = [
            Buffer::on_device(gpu, hit_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC)?,
            Buffer::on_host(gpu, hit_bytes, Usage::TRANSFER_DST)?,
        ];
        let set = BufferSet::new(
            gpu,
            &[
                (DescriptorType::UNIFORM_BUFFER, &view),
                (DescriptorType::STORAGE_BUFFER, &rays[1]),
                (DescriptorType::STORAGE_BUFFER, &hits[0]),
            ],
        )?;
        Ok(Self { set, view, rays, hits, capacity })
    }

    /// Most rays.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Layout of the descriptor set 0.
    pub(crate) fn layout(&self) -> vk::DescriptorSetLayout {
        self.set.layout
    }

    /// Casts rays that fit the buffers, in one submission, and waits. There are as many hits as rays.
    pub(crate) fn cast(
        &mut self,
        gpu: &Gpu,
        pipeline: &Pipeline,
        octree: &BufferSet,
        root: u32,
        rays: &[Ray],
        hits: &mut [Hit],
    ) -> Result<(), CastError> {
        let count = rays.len() as u32;
        let (from, to): (&[u8], &mut [u8]) = (bytemuck::cast_slice(rays), bytemuck::cast_slice_mut(hits));
        self.view.contents()[..size_of::<View>()].copy_from_slice(bytemuck::bytes_of(&kernel::rays_view(root, count)));
        self.rays[0].contents()[..from.len()].copy_from_slice(from);
        let ray_copy = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.len() as u64 }];
        let hit_copy = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: to.len() as u64 }];
        let this = &*self;
        gpu.run(|device, commands| {
            // SAFETY: the rays fit both buffers, which outlive the submission.
            unsafe { device.cmd_copy_buffer(commands, this.rays[0].handle, this.rays[1].handle, &ray_copy) };
            wait(device, commands, TRANSFER, SHADER);
            pipeline.dispatch(commands, &[&this.set, octree], (kernel::ray_workgroups(count, WORKGROUP), 1));
            wait(device, commands, SHADER, TRANSFER);
            // SAFETY: the hits fit both buffers, which outlive the submission.
            unsafe { device.cmd_copy_buffer(commands, this.hits[0].handle, this.hits[1].handle, &hit_copy) };
            wait(device, commands, TRANSFER, HOST);
        })?;
        to.copy_from_slice(&self.hits[1].contents()[..to.len()]);
        Ok(())
    }
}
