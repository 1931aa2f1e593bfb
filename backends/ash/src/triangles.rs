//! Triangles through Vulkan.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::exact::{CameraRays, ExactRay};
use esvo_core::gpu::kernel::{GpuOptions, WORKGROUP, ray_workgroups, workgroups};
use esvo_core::gpu::triangles::{
    self as kernel, HierarchySpace, Question, TriangleCaster, TrianglePass, TriangleRay, TriangleRecord, TriangleView,
    WideTriangles,
};
use esvo_core::{CastError, Device};

use crate::buffers::Buffer;
use crate::gpu::{Gpu, TIMESTAMPS};
use crate::pipeline::{BufferSet, Pipeline};
use crate::rays::{HOST, SHADER, TRANSFER, wait};

/// Triangles are copied in pieces of this many bytes.
const STAGING_BYTES: usize = 64 << 20;

/// Casts rays at triangles by the kernel as SPIR-V through Vulkan. See [`TriangleCaster`].
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
    _parts: [Buffer; 2],
    source: String,
    space: HierarchySpace,
    bytes: u64,
    /// Without triangles every ray misses.
    empty: bool,
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
    /// Opens a device. Of the options, `triangles_kernel`, `adapter`, `max_part_bytes` and `max_rays` count.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no Vulkan library, no device, or none of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        Ok(Self { loaded: None, options: options.clone(), gpu: Arc::new(Gpu::open(options)?) })
    }

    /// Most bytes of a binding.
    fn max_bytes(&self) -> u64 {
        u64::from(self.gpu.adapter.limits.max_storage_buffer_range).min(self.gpu.adapter.max_allocation)
    }

    /// Most workgroups per dimension.
    fn max_groups(&self) -> u32 {
        let count = self.gpu.adapter.limits.max_compute_work_group_count;
        count[0].min(count[1])
    }

    /// Runs a pass over `groups` workgroups and waits; afterwards the first `count` records are on the host, unless it is the timing
    /// pass. Returns the time of the pass.
    fn dispatch(
        &mut self,
        pass: TrianglePass,
        view: &TriangleView,
        rays: &[TriangleRay],
        count: usize,
        groups: (u32, u32),
    ) -> Result<Duration, CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let bytes: &[u8] = bytemuck::cast_slice(rays);
        let (ray_bytes, out_bytes) = (bytes.len().max(size_of::<TriangleRay>()), count * size_of::<TriangleRecord>());
        let (ray_bytes, out_bytes) = (ray_bytes as u64, out_bytes as u64);
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
        match queries {
            Some(queries) => self.gpu.between(queries, 0, 1),
            None => Ok(start.elapsed()),
        }
    }

    /// Copies records from the host's buffer.
    fn read(&mut self, to: &mut [TriangleRecord]) -> Result<(), CastError> {
        let buffers = self.loaded.as_mut().and_then(|loaded| loaded.buffers.as_mut()).ok_or(CastError::NotLoaded)?;
        let to: &mut [u8] = bytemuck::cast_slice_mut(to);
        to.copy_from_slice(&buffers.out[1].contents()[..to.len()]);
        Ok(())
    }
}

impl TriangleCaster for AshTriangles {
    fn name(&self) -> &'static str {
        "ash"
    }

    fn device(&self) -> &Device {
        self.gpu.about()
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |loaded| loaded.bytes)
    }

    fn load(&mut self, triangles: &WideTriangles) -> Result<(), CastError> {
        let max_bytes = self.options.max_part_bytes.unwrap_or(u64::MAX).min(self.max_bytes());
        triangles.check(max_bytes).map_err(|error| self.gpu.error(&error))?;
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
        let rows = kernel::band_rows(rays.width, self.max_bytes(), self.max_groups())? as usize;
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
        let most = kernel::rays_per_dispatch(self.max_bytes(), self.max_groups());
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
        let most = kernel::band_rows(rays.width, self.max_bytes(), self.max_groups())?;
        let mut time = Duration::ZERO;
        for first_row in (0..rays.height).step_by(most as usize) {
            view.first_row = first_row;
            let rows = most.min(rays.height - first_row);
            let groups = workgroups(rays.width, rows, WORKGROUP);
            time += self.dispatch(TrianglePass::Time, &view, &[], rows as usize * rays.width as usize, groups)?;
        }
        Ok(time)
    }
}

impl Loaded {
    fn new(gpu: &Arc<Gpu>, options: &GpuOptions, triangles: &WideTriangles) -> Result<Self, CastError> {
        let body = options.triangles_kernel.as_deref().unwrap_or(kernel::TRIANGLES_WGSL);
        let parts = [
            upload(gpu, bytemuck::cast_slice(&triangles.nodes))?,
            upload(gpu, bytemuck::cast_slice(&triangles.triangles))?,
        ];
        let bindings = [(DescriptorType::STORAGE_BUFFER, &parts[0]), (DescriptorType::STORAGE_BUFFER, &parts[1])];
        let set = BufferSet::new(gpu, &bindings)?;
        gpu.check()?;
        Ok(Self {
            pipelines: HashMap::new(),
            buffers: None,
            set,
            _parts: parts,
            source: triangles.source_with(body),
            space: triangles.space,
            bytes: triangles.bytes(),
            empty: triangles.nodes.is_empty(),
        })
    }

    /// The answer without a dispatch: a miss without triangles, otherwise none.
    fn untouched(&self) -> TriangleRecord {
        if self.empty { TriangleRecord::MISS } else { TriangleRecord::UNDECIDED }
    }
}

/// Copies bytes to a new storage buffer on the device.
fn upload(gpu: &Arc<Gpu>, bytes: &[u8]) -> Result<Buffer, CastError> {
    let buffer = Buffer::on_device(gpu, bytes.len() as u64, Usage::STORAGE_BUFFER | Usage::TRANSFER_DST)?;
    let mut staging = Buffer::on_host(gpu, STAGING_BYTES.min(bytes.len()) as u64, Usage::TRANSFER_SRC)?;
    for (piece, offset) in bytes.chunks(STAGING_BYTES).zip((0u64..).step_by(STAGING_BYTES)) {
        staging.contents()[..piece.len()].copy_from_slice(piece);
        let copy = [vk::BufferCopy { src_offset: 0, dst_offset: offset, size: piece.len() as u64 }];
        gpu.run(|device, commands| {
            // SAFETY: the piece lies within both buffers, which outlive the submission.
            unsafe { device.cmd_copy_buffer(commands, staging.handle, buffer.handle, &copy) };
        })?;
    }
    Ok(buffer)
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
