//! Pictures of many placed objects: their buffers and their submission.

use esvo_core::gpu::kernel::{self, Bands, NearestHit, Pass, WORKGROUP};
use esvo_core::gpu::resident::SlotMap;
use esvo_core::instances::Node;
use esvo_core::{CastError, Instances, Nearest, View};
use esvo_device::{Gpu, Usage, storage, uniform};

/// Buffers for a hierarchy and a band of a picture.
pub(crate) struct InstanceBuffers {
    view: wgpu::Buffer,
    nodes: wgpu::Buffer,
    out: wgpu::Buffer,
    staging: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// Layout of group 0.
pub(crate) fn layout(gpu: &Gpu) -> Result<wgpu::BindGroupLayout, CastError> {
    let entries =
        [uniform(kernel::BINDING_VIEW), storage(kernel::BINDING_NODES, true), storage(kernel::BINDING_OUT, false)];
    Ok(gpu.bind_group_layout("instances", &entries)?)
}

impl InstanceBuffers {
    /// Those of `before` if they are large enough, else new ones. `count` nodes, at least one.
    pub(crate) fn take(gpu: &Gpu, before: Option<Self>, count: usize, bands: Bands) -> Result<Self, CastError> {
        let node_bytes = (count.next_power_of_two() * size_of::<Node>()) as u64;
        let (mut node_bytes, mut out_bytes) = (node_bytes.min(gpu.max_storage_bytes()), bands.out_bytes);
        node_bytes = node_bytes.max((count * size_of::<Node>()) as u64);
        if let Some(before) = before {
            if before.nodes.size() >= (count * size_of::<Node>()) as u64 && before.out.size() >= out_bytes {
                return Ok(before);
            }
            (node_bytes, out_bytes) = (node_bytes.max(before.nodes.size()), out_bytes.max(before.out.size()));
        }
        let view = gpu.buffer("view of instances", size_of::<View>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let nodes = gpu.buffer("hierarchy", node_bytes, Usage::STORAGE | Usage::COPY_DST)?;
        let out = gpu.buffer("nearest hits", out_bytes, Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("nearest hits to read", out_bytes, Usage::MAP_READ | Usage::COPY_DST)?;
        let group = gpu.bind_group(&layout(gpu)?, &[&view, &nodes, &out])?;
        Ok(Self { view, nodes, out, staging, group })
    }

    /// Casts a picture, band by band.
    pub(crate) fn cast(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::ComputePipeline,
        octree: (&wgpu::BindGroup, &SlotMap),
        bands: Bands,
        instances: &Instances,
        nearest: &mut Nearest,
    ) -> Result<(), CastError> {
        let view = &instances.views()[0];
        let nodes = kernel::resident_nodes(instances, octree.1);
        gpu.write(&self.nodes, 0, bytemuck::cast_slice(&nodes))?;
        for (first_row, rows) in bands.rows() {
            let band = kernel::instances_view(view, nodes.len() as u32, first_row);
            gpu.write(&self.view, 0, bytemuck::bytes_of(&band))?;
            let bytes = u64::from(rows) * u64::from(view.width) * Pass::Instances.bytes_per_pixel();
            gpu.submit(|commands| {
                let entry = Some(Pass::Instances.entry());
                let descriptor = wgpu::ComputePassDescriptor { label: entry, timestamp_writes: None };
                let mut compute = commands.begin_compute_pass(&descriptor);
                compute.set_pipeline(pipeline);
                compute.set_bind_group(0, &self.group, &[]);
                compute.set_bind_group(1, octree.0, &[]);
                let (x, y) = kernel::workgroups(view.width, rows, WORKGROUP);
                compute.dispatch_workgroups(x, y, 1);
                drop(compute);
                commands.copy_buffer_to_buffer(&self.out, 0, &self.staging, 0, bytes);
            })?;
            gpu.read_staging(&self.staging, bytes, |from| {
                NearestHit::store(bytemuck::cast_slice(from), view, first_row, nearest);
            })?;
        }
        octree.1.restore(&mut nearest.hits);
        Ok(())
    }
}
