//! Pictures of many placed objects: their buffers and their submission.

use std::sync::Arc;

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::gpu::kernel::{self, Bands, NearestHit, Pass, WORKGROUP};
use esvo_core::gpu::resident::SlotMap;
use esvo_core::instances::Node;
use esvo_core::{CastError, Instances, Nearest, View};

use crate::buffers::Buffer;
use crate::gpu::Gpu;
use crate::pipeline::{BufferSet, Pipeline};
use crate::rays::{HOST, SHADER, TRANSFER, wait};

/// Buffers for a hierarchy and a band of a picture.
pub(crate) struct InstanceBuffers {
    set: BufferSet,
    view: Buffer,
    /// On the host, and on the device.
    nodes: [Buffer; 2],
    /// On the device, and on the host.
    out: [Buffer; 2],
}

impl InstanceBuffers {
    /// Those of `before` if they are large enough, else new ones. `count` nodes, at least one.
    pub(crate) fn take(gpu: &Arc<Gpu>, before: Option<Self>, count: usize, bands: Bands) -> Result<Self, CastError> {
        let node_bytes = (count * size_of::<Node>()) as u64;
        let most = u64::from(gpu.adapter.limits.max_storage_buffer_range).min(gpu.adapter.max_allocation);
        if node_bytes > most {
            return Err(
                gpu.error(&format!("the hierarchy takes {node_bytes} bytes, more than a binding: place fewer objects"))
            );
        }
        let (mut node_bytes, mut out_bytes) = (node_bytes.next_power_of_two().min(most), bands.out_bytes);
        if let Some(before) = before {
            if before.nodes[1].bytes >= (count * size_of::<Node>()) as u64 && before.out[0].bytes >= out_bytes {
                return Ok(before);
            }
            (node_bytes, out_bytes) = (node_bytes.max(before.nodes[1].bytes), out_bytes.max(before.out[0].bytes));
        }
        let view = Buffer::on_host(gpu, size_of::<View>() as u64, Usage::UNIFORM_BUFFER)?;
        let nodes = [
            Buffer::on_host(gpu, node_bytes, Usage::TRANSFER_SRC)?,
            Buffer::on_device(gpu, node_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_DST)?,
        ];
        let out = [
            Buffer::on_device(gpu, out_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC)?,
            Buffer::on_host(gpu, out_bytes, Usage::TRANSFER_DST)?,
        ];
        let set = BufferSet::new(
            gpu,
            &[
                (DescriptorType::UNIFORM_BUFFER, &view),
                (DescriptorType::STORAGE_BUFFER, &nodes[1]),
                (DescriptorType::STORAGE_BUFFER, &out[0]),
            ],
        )?;
        Ok(Self { set, view, nodes, out })
    }

    /// Layout of the descriptor set 0.
    pub(crate) fn layout(&self) -> vk::DescriptorSetLayout {
        self.set.layout
    }

    /// Casts a picture, band by band.
    pub(crate) fn cast(
        &mut self,
        gpu: &Gpu,
        pipeline: &Pipeline,
        octree: (&BufferSet, &SlotMap),
        bands: Bands,
        instances: &Instances,
        nearest: &mut Nearest,
    ) -> Result<(), CastError> {
        let view = &instances.views()[0];
        let nodes = kernel::resident_nodes(instances, octree.1);
        let from: &[u8] = bytemuck::cast_slice(&nodes);
        self.nodes[0].contents()[..from.len()].copy_from_slice(from);
        let upload = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.len() as u64 }];
        for (first_row, rows) in bands.rows() {
            let band = kernel::instances_view(view, nodes.len() as u32, first_row);
            self.view.contents()[..size_of::<View>()].copy_from_slice(bytemuck::bytes_of(&band));
            let bytes = u64::from(rows) * u64::from(view.width) * Pass::Instances.bytes_per_pixel();
            let download = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }];
            let this = &*self;
            gpu.run(|device, commands| {
                if first_row == 0 && !nodes.is_empty() {
                    // SAFETY: the nodes fit both buffers, which outlive the submission.
                    unsafe { device.cmd_copy_buffer(commands, this.nodes[0].handle, this.nodes[1].handle, &upload) };
                    wait(device, commands, TRANSFER, SHADER);
                }
                pipeline.dispatch(commands, &[&this.set, octree.0], kernel::workgroups(view.width, rows, WORKGROUP));
                wait(device, commands, SHADER, TRANSFER);
                // SAFETY: the band fits both buffers, which outlive the submission.
                unsafe { device.cmd_copy_buffer(commands, this.out[0].handle, this.out[1].handle, &download) };
                wait(device, commands, TRANSFER, HOST);
            })?;
            let band = &self.out[1].contents()[..bytes as usize];
            NearestHit::store(bytemuck::cast_slice(band), view, first_row, nearest);
        }
        octree.1.restore(&mut nearest.hits);
        Ok(())
    }
}
