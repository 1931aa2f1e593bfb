//! Triangles through Vulkan.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::gpu::triangles::{
    self as kernel, Dispatch, LoadedTriangles, TriangleDevice, TriangleLimits, TrianglePass, TrianglePlacement,
    TriangleRecord, TriangleView, WideTriangles,
};
use esvo_core::{CastError, Device};

use crate::buffers::Buffer;
use crate::data::{Data, slot_limits};
use crate::gpu::{Gpu, TIMESTAMPS};
use crate::pipeline::{BufferSet, Pipeline};
use crate::rays::{HOST, SHADER, TRANSFER, wait};

/// Casts rays at triangles by the kernel as SPIR-V through Vulkan. See [`TriangleCaster`](kernel::TriangleCaster).
pub struct AshTriangles {
    // Fields are dropped in this order. Each holds the device, so the device is destroyed last.
    loaded: Option<Loaded>,
    options: GpuOptions,
    gpu: Arc<Gpu>,
}

/// Triangles on the device.
struct Loaded {
    pipelines: HashMap<TrianglePass, Pipeline>,
    /// Made for the most rays and records so far.
    buffers: Option<Buffers>,
    set: BufferSet,
    _data: [Data; 2],
    source: String,
    about: LoadedTriangles,
}

struct Buffers {
    set: BufferSet,
    view: Buffer,
    /// On the host, and on the device.
    rays: [Buffer; 2],
    /// On the device, and on the host.
    out: [Buffer; 2],
}

impl AshTriangles {
    /// Opens a device. Of the options, `triangles_kernel`, `adapter`, `max_part_bytes`, `max_rays`, `memory_bytes`, `slots_in` and
    /// `workgroup` count.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no Vulkan library, no device, or none of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        Ok(Self { loaded: None, options: options.clone(), gpu: Arc::new(Gpu::open(options)?) })
    }
}

impl TriangleDevice for AshTriangles {
    fn name(&self) -> &'static str {
        "ash"
    }

    fn device(&self) -> &Device {
        self.gpu.about()
    }

    fn limits(&self) -> TriangleLimits {
        let limits = &self.gpu.adapter.limits;
        TriangleLimits {
            slots: slot_limits(&self.gpu, &self.options),
            groups: limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]),
            rays: self.options.max_rays,
            workgroup: self.options.workgroup,
        }
    }

    fn loaded(&self) -> Option<LoadedTriangles> {
        self.loaded.as_ref().map(|loaded| loaded.about)
    }

    fn upload(&mut self, triangles: &WideTriangles, placement: &TrianglePlacement) -> Result<(), CastError> {
        // Frees memory for the new triangles.
        self.loaded = None;
        self.loaded = Some(Loaded::new(&self.gpu, &self.options, triangles, placement)?);
        Ok(())
    }

    fn dispatch(&mut self, work: &Dispatch<'_>, records: &mut [TriangleRecord]) -> Result<Duration, CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let Dispatch { pass, view, groups, .. } = *work;
        let bytes: &[u8] = bytemuck::cast_slice(work.rays);
        let (ray_bytes, out_bytes) = (work.ray_bytes(), work.record_bytes());
        let fits = |b: &Buffers| b.rays[0].bytes >= ray_bytes && b.out[0].bytes >= out_bytes;
        let buffers = match loaded.buffers.take().filter(fits) {
            Some(buffers) => buffers,
            None => Buffers::new(&self.gpu, ray_bytes, out_bytes)?,
        };
        let buffers = loaded.buffers.insert(buffers);
        if !loaded.pipelines.contains_key(&pass) {
            let layouts = [buffers.set.layout, loaded.set.layout];
            let pipeline = Pipeline::new(&self.gpu, &loaded.source, pass.entry(), &layouts)?;
            loaded.pipelines.insert(pass, pipeline);
        }
        buffers.view.contents()[..size_of::<TriangleView>()].copy_from_slice(bytemuck::bytes_of(view));
        buffers.rays[0].contents()[..bytes.len()].copy_from_slice(bytes);
        let (buffers, pipeline, triangles) = (&*buffers, &loaded.pipelines[&pass], &loaded.set);
        let queries = self.gpu.queries;
        let start = Instant::now();
        self.gpu.run(|device, commands| {
            let stamp = |query, stage| {
                if let Some(queries) = queries {
                    // SAFETY: the pool has the query, which was reset in the same submission and is written once.
                    unsafe { device.cmd_write_timestamp(commands, stage, queries, query) };
                }
            };
            if let Some(queries) = queries {
                // SAFETY: the queries are of this pool; nothing else uses them.
                unsafe { device.cmd_reset_query_pool(commands, queries, 0, TIMESTAMPS) };
            }
            if !bytes.is_empty() {
                let copy = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes.len() as u64 }];
                // SAFETY: the rays fit both buffers, which outlive the submission.
                unsafe { device.cmd_copy_buffer(commands, buffers.rays[0].handle, buffers.rays[1].handle, &copy) };
                wait(device, commands, TRANSFER, SHADER);
            }
            stamp(0, vk::PipelineStageFlags::TOP_OF_PIPE);
            pipeline.dispatch(commands, &[&buffers.set, triangles], groups);
            stamp(1, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
            if pass != TrianglePass::Time {
                let copy = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: out_bytes }];
                wait(device, commands, SHADER, TRANSFER);
                // SAFETY: the records fit both buffers, which outlive the submission.
                unsafe { device.cmd_copy_buffer(commands, buffers.out[0].handle, buffers.out[1].handle, &copy) };
                wait(device, commands, TRANSFER, HOST);
            }
        })?;
        let time = match queries {
            Some(queries) => self.gpu.between(queries, 0, 1)?,
            None => start.elapsed(),
        };
        if let Some(buffers) = loaded.buffers.as_mut() {
            let to: &mut [u8] = bytemuck::cast_slice_mut(records);
            to.copy_from_slice(&buffers.out[1].contents()[..to.len()]);
        }
        Ok(time)
    }
}

impl Loaded {
    fn new(
        gpu: &Arc<Gpu>,
        options: &GpuOptions,
        triangles: &WideTriangles,
        placement: &TrianglePlacement,
    ) -> Result<Self, CastError> {
        let body = options.triangles_kernel.as_deref().unwrap_or(kernel::TRIANGLES_WGSL);
        let nodes = Data::upload(gpu, placement.nodes, triangles.node_slots())?;
        let data = [nodes, Data::upload(gpu, placement.triangles, triangles.triangle_slots())?];
        let set = BufferSet::of_data(gpu, &data.each_ref())?;
        gpu.check()?;
        Ok(Self {
            pipelines: HashMap::new(),
            buffers: None,
            set,
            _data: data,
            source: placement.source_with(body),
            about: LoadedTriangles::of(triangles, placement),
        })
    }
}

impl Buffers {
    fn new(gpu: &Arc<Gpu>, ray_bytes: u64, out_bytes: u64) -> Result<Self, CastError> {
        let view = Buffer::on_host(gpu, size_of::<TriangleView>() as u64, Usage::UNIFORM_BUFFER)?;
        let rays = [
            Buffer::on_host(gpu, ray_bytes, Usage::TRANSFER_SRC)?,
            Buffer::on_device(gpu, ray_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_DST)?,
        ];
        let out = [
            Buffer::on_device(gpu, out_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC)?,
            Buffer::on_host(gpu, out_bytes, Usage::TRANSFER_DST)?,
        ];
        let bindings = [
            (DescriptorType::UNIFORM_BUFFER, &view),
            (DescriptorType::STORAGE_BUFFER, &rays[1]),
            (DescriptorType::STORAGE_BUFFER, &out[0]),
        ];
        let set = BufferSet::new(gpu, &bindings)?;
        Ok(Self { set, view, rays, out })
    }
}
