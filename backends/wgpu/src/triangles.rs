//! Triangles through wgpu.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use esvo_core::exact::{CameraRays, ExactRay};
use esvo_core::gpu::kernel::{GpuOptions, WORKGROUP, ray_workgroups, workgroups};
use esvo_core::gpu::triangles::{
    self as kernel, HierarchySpace, Question, TriangleCaster, TrianglePass, TriangleRay, TriangleRecord, TriangleView,
    WideTriangles,
};
use esvo_core::{CastError, Device};
use esvo_device::{Gpu, Timestamps, Usage, storage, uniform};

/// Casts rays at triangles by the WGSL kernel through wgpu. See [`TriangleCaster`].
pub struct WgpuTriangles {
    gpu: Gpu,
    options: GpuOptions,
    loaded: Option<Loaded>,
    /// `None` if the device has no clock.
    timing: Option<Timestamps>,
}

/// Triangles on the device.
struct Loaded {
    space: HierarchySpace,
    bytes: u64,
    /// Without triangles every ray misses.
    empty: bool,
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
    /// Opens a device. Of the options, `triangles_kernel`, `adapter`, `max_part_bytes` and `max_rays` count.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no device, or none of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        let gpu = Gpu::open(options.adapter.as_deref())?;
        let timing = gpu.timestamps(1)?;
        Ok(Self { gpu, options: options.clone(), loaded: None, timing })
    }

    fn max_bytes(&self) -> u64 {
        self.options.max_part_bytes.unwrap_or(u64::MAX).min(self.gpu.max_storage_bytes())
    }

    /// Runs a pass over `groups` workgroups; afterwards the first `count` records are in the staging buffer, unless it is the
    /// timing pass.
    fn dispatch(
        &mut self,
        pass: TrianglePass,
        view: &TriangleView,
        rays: &[TriangleRay],
        count: usize,
        groups: (u32, u32),
    ) -> Result<(), CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        if !loaded.pipelines.contains_key(&pass) {
            let pipeline = self.gpu.compute_pipeline(&loaded.module, pass.entry(), &[&loaded.frame, &loaded.layout])?;
            loaded.pipelines.insert(pass, pipeline);
        }
        let (ray_bytes, out_bytes) =
            (size_of_val(rays).max(size_of::<TriangleRay>()), count * size_of::<TriangleRecord>());
        let (ray_bytes, out_bytes) = (ray_bytes as u64, out_bytes as u64);
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
        Ok(())
    }

    /// Reads records from the staging buffer.
    fn read(&self, to: &mut [TriangleRecord]) -> Result<(), CastError> {
        let buffers = self.loaded.as_ref().and_then(|loaded| loaded.buffers.as_ref()).ok_or(CastError::NotLoaded)?;
        let bytes = size_of_val(to) as u64;
        let copy = |from: &[u8]| bytemuck::cast_slice_mut(to).copy_from_slice(from);
        Ok(self.gpu.read_staging(&buffers.staging, bytes, copy)?)
    }

    fn rows(&self, rays: &CameraRays) -> Result<usize, CastError> {
        let groups = self.gpu.limits().max_compute_workgroups_per_dimension;
        Ok(kernel::band_rows(rays.width, self.gpu.max_storage_bytes(), groups)? as usize)
    }
}

impl TriangleCaster for WgpuTriangles {
    fn name(&self) -> &'static str {
        "wgpu"
    }

    fn device(&self) -> &Device {
        self.gpu.about()
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |loaded| loaded.bytes)
    }

    fn load(&mut self, triangles: &WideTriangles) -> Result<(), CastError> {
        triangles.check(self.max_bytes()).map_err(|error| self.gpu.error(error))?;
        // Frees memory for the new triangles.
        self.loaded = None;
        self.loaded = Some(Loaded::new(&self.gpu, &self.options, triangles)?);
        Ok(())
    }

    fn cast(&mut self, rays: &CameraRays, records: &mut Vec<TriangleRecord>) -> Result<(), CastError> {
        let loaded = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        let view = loaded.space.view(rays).filter(|_| !loaded.empty);
        records.clear();
        records.resize(rays.pixels(), loaded.untouched());
        let Some(mut view) = view else { return Ok(()) };
        let rows = self.rows(rays)?;
        let width = rays.width as usize;
        for (band, first_row) in records.chunks_mut(rows * width).zip((0..).step_by(rows)) {
            view.first_row = first_row;
            let groups = workgroups(rays.width, (band.len() / width) as u32, WORKGROUP);
            self.dispatch(TrianglePass::Picture, &view, &[], band.len(), groups)?;
            self.read(band)?;
        }
        Ok(())
    }

    fn cast_rays(
        &mut self,
        rays: &[ExactRay],
        question: Question,
        records: &mut Vec<TriangleRecord>,
    ) -> Result<(), CastError> {
        let loaded = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        let space = loaded.space;
        records.clear();
        records.resize(rays.len(), loaded.untouched());
        if loaded.empty {
            return Ok(());
        }
        let groups = self.gpu.limits().max_compute_workgroups_per_dimension;
        let most = kernel::rays_per_dispatch(self.gpu.max_storage_bytes(), groups);
        let most = self.options.max_rays.map_or(most, |rays| rays.clamp(1, most));
        for (some, records) in rays.chunks(most).zip(records.chunks_mut(most)) {
            let placed: Vec<TriangleRay> = some.iter().map(|ray| space.ray(ray)).collect();
            let count = some.len() as u32;
            let groups = (ray_workgroups(count, WORKGROUP), 1);
            self.dispatch(question.pass(), &TriangleView::of_rays(count), &placed, some.len(), groups)?;
            self.read(records)?;
        }
        Ok(())
    }

    fn time(&mut self, rays: &CameraRays) -> Result<Duration, CastError> {
        let loaded = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        if loaded.empty {
            return Ok(Duration::ZERO);
        }
        let mut view = loaded.space.view(rays).ok_or_else(kernel::too_far)?;
        let rows = self.rows(rays)?;
        // Earlier work must not count.
        self.gpu.wait()?;
        let mut time = Duration::ZERO;
        for first_row in (0..rays.height).step_by(rows) {
            view.first_row = first_row;
            let rows = (rows as u32).min(rays.height - first_row);
            let start = Instant::now();
            let groups = workgroups(rays.width, rows, WORKGROUP);
            self.dispatch(TrianglePass::Time, &view, &[], rows as usize * rays.width as usize, groups)?;
            time += match &self.timing {
                Some(timing) => timing.read(&self.gpu)?.span(0..=0),
                None => {
                    self.gpu.wait()?;
                    start.elapsed()
                }
            };
        }
        Ok(time)
    }
}

impl Loaded {
    fn new(gpu: &Gpu, options: &GpuOptions, triangles: &WideTriangles) -> Result<Self, CastError> {
        let body = options.triangles_kernel.as_deref().unwrap_or(kernel::TRIANGLES_WGSL);
        let module = gpu.shader("triangles.wgsl", &triangles.source_with(body))?;
        let entries =
            [uniform(kernel::BINDING_VIEW), storage(kernel::BINDING_RAYS, true), storage(kernel::BINDING_OUT, false)];
        let frame = gpu.bind_group_layout("rays at triangles", &entries)?;
        let entries = [storage(kernel::BINDING_NODES, true), storage(kernel::BINDING_TRIANGLES, true)];
        let layout = gpu.bind_group_layout("triangles", &entries)?;
        // A binding holds one value at least.
        let empty = triangles.nodes.is_empty();
        let nodes = if empty { &[bytemuck::Zeroable::zeroed()] } else { &triangles.nodes[..] };
        let corners = if empty { &[bytemuck::Zeroable::zeroed()] } else { &triangles.triangles[..] };
        let nodes = gpu.upload("nodes", nodes, Usage::STORAGE)?;
        let corners = gpu.upload("triangles", corners, Usage::STORAGE)?;
        let group = gpu.bind_group(&layout, &[&nodes, &corners])?;
        let (space, bytes, pipelines) = (triangles.space, triangles.bytes(), HashMap::new());
        Ok(Self { space, bytes, empty, module, frame, layout, group, pipelines, buffers: None })
    }

    /// The answer without a dispatch: a miss without triangles, otherwise none.
    fn untouched(&self) -> TriangleRecord {
        if self.empty { TriangleRecord::MISS } else { TriangleRecord::UNDECIDED }
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
