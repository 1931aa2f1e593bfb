//! Triangles through wgpu.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::gpu::slots::SlotKind;
use esvo_core::gpu::triangles::{
    self as kernel, Dispatch, LoadedTriangles, TriangleDevice, TriangleLimits, TrianglePass, TrianglePlacement,
    TriangleRecord, TriangleView, WideTriangles,
};
use esvo_core::{CastError, Device};
use esvo_device::{Gpu, Timestamps, Usage, storage, uniform};

use crate::data::{Data, slot_limits};

/// Casts rays at triangles by the WGSL kernel through wgpu. See [`TriangleCaster`](kernel::TriangleCaster).
pub struct WgpuTriangles {
    gpu: Gpu,
    options: GpuOptions,
    loaded: Option<Loaded>,
    /// `None` if the device has no clock.
    timing: Option<Timestamps>,
}

/// Triangles on the device.
struct Loaded {
    about: LoadedTriangles,
    module: wgpu::ShaderModule,
    frame: wgpu::BindGroupLayout,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    pipelines: HashMap<TrianglePass, wgpu::ComputePipeline>,
    /// Made for the most rays and records so far.
    buffers: Option<Buffers>,
}

struct Buffers {
    view: wgpu::Buffer,
    rays: wgpu::Buffer,
    out: wgpu::Buffer,
    staging: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl WgpuTriangles {
    /// Opens a device. Of the options, `triangles_kernel`, `adapter`, `max_part_bytes`, `max_rays`, `memory_bytes`, `slots_in` and
    /// `workgroup` count.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no device, or none of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        let gpu = Gpu::open(options.adapter.as_deref())?;
        let timing = gpu.timestamps(1)?;
        Ok(Self { gpu, options: options.clone(), loaded: None, timing })
    }
}

impl TriangleDevice for WgpuTriangles {
    fn name(&self) -> &'static str {
        "wgpu"
    }

    fn device(&self) -> &Device {
        self.gpu.about()
    }

    fn limits(&self) -> TriangleLimits {
        TriangleLimits {
            slots: slot_limits(&self.gpu, &self.options),
            groups: self.gpu.limits().max_compute_workgroups_per_dimension,
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
        let Dispatch { pass, view, rays, groups, .. } = *work;
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        if !loaded.pipelines.contains_key(&pass) {
            let pipeline = self.gpu.compute_pipeline(&loaded.module, pass.entry(), &[&loaded.frame, &loaded.layout])?;
            loaded.pipelines.insert(pass, pipeline);
        }
        let (ray_bytes, out_bytes) = (work.ray_bytes(), work.record_bytes());
        let fits = |b: &Buffers| b.rays.size() >= ray_bytes && b.out.size() >= out_bytes;
        let buffers = match loaded.buffers.take().filter(fits) {
            Some(buffers) => buffers,
            None => Buffers::new(&self.gpu, &loaded.frame, ray_bytes, out_bytes)?,
        };
        let buffers = &*loaded.buffers.insert(buffers);
        self.gpu.write(&buffers.view, 0, bytemuck::bytes_of(view))?;
        if !rays.is_empty() {
            self.gpu.write(&buffers.rays, 0, bytemuck::cast_slice(rays))?;
        }
        if pass == TrianglePass::Time {
            // Earlier work must not count.
            self.gpu.wait()?;
        }
        let start = Instant::now();
        self.gpu.submit(|commands| {
            let timing = self.timing.as_ref().filter(|_| pass == TrianglePass::Time);
            let timestamp_writes = timing.map(|timing| timing.compute_pass(0));
            let descriptor = wgpu::ComputePassDescriptor { label: Some(pass.entry()), timestamp_writes };
            let mut compute = commands.begin_compute_pass(&descriptor);
            compute.set_pipeline(&loaded.pipelines[&pass]);
            compute.set_bind_group(0, &buffers.group, &[]);
            compute.set_bind_group(1, &loaded.group, &[]);
            compute.dispatch_workgroups(groups.0, groups.1, 1);
            drop(compute);
            if pass != TrianglePass::Time {
                commands.copy_buffer_to_buffer(&buffers.out, 0, &buffers.staging, 0, out_bytes);
            } else if let Some(timing) = timing {
                timing.resolve(commands);
            }
        })?;
        if pass != TrianglePass::Time {
            let copy = |from: &[u8]| bytemuck::cast_slice_mut(records).copy_from_slice(from);
            self.gpu.read_staging(&buffers.staging, out_bytes, copy)?;
            return Ok(start.elapsed());
        }
        match &self.timing {
            Some(timing) => Ok(timing.read(&self.gpu)?.span(0..=0)),
            None => {
                self.gpu.wait()?;
                Ok(start.elapsed())
            }
        }
    }
}

impl Loaded {
    fn new(
        gpu: &Gpu,
        options: &GpuOptions,
        triangles: &WideTriangles,
        placement: &TrianglePlacement,
    ) -> Result<Self, CastError> {
        let body = options.triangles_kernel.as_deref().unwrap_or(kernel::TRIANGLES_WGSL);
        let module = gpu.shader("triangles.wgsl", &placement.source_with(body))?;
        let entries =
            [uniform(kernel::BINDING_VIEW), storage(kernel::BINDING_RAYS, true), storage(kernel::BINDING_OUT, false)];
        let frame = gpu.bind_group_layout("rays at triangles", &entries)?;
        let nodes = Data::upload(gpu, "nodes", SlotKind::Quad, placement.nodes, triangles.node_slots())?;
        let corners = (placement.triangles, triangles.triangle_slots());
        let corners = Data::upload(gpu, "triangles", SlotKind::Quad, corners.0, corners.1)?;
        let (layout, group) = Data::bind(gpu, "triangles", &[&nodes, &corners])?;
        let (about, pipelines) = (LoadedTriangles::of(triangles, placement), HashMap::new());
        Ok(Self { about, module, frame, layout, group, pipelines, buffers: None })
    }
}

impl Buffers {
    fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, ray_bytes: u64, out_bytes: u64) -> Result<Self, CastError> {
        let view =
            gpu.buffer("view of triangles", size_of::<TriangleView>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let rays = gpu.buffer("rays at triangles", ray_bytes, Usage::STORAGE | Usage::COPY_DST)?;
        let out = gpu.buffer("records", out_bytes, Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("records to read", out_bytes, Usage::MAP_READ | Usage::COPY_DST)?;
        let group = gpu.bind_group(layout, &[&view, &rays, &out])?;
        Ok(Self { view, rays, out, staging, group })
    }
}
