//! The caster: octree and picture buffers, passes.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::filter::kernel::Band;
use esvo_core::filter::{Frame, Radius};
use esvo_core::gpu::arithmetic::Arithmetic;
use esvo_core::gpu::kernel::{self, Bands, GpuOptions, Pass, Placement, Variant, WORKGROUP};
use esvo_core::gpu::resident::{Resident, SlotMap};
use esvo_core::{
    CastError, Caster, Checked, Device, Filtered, FrameTime, Hit, Instances, Nearest, Ray, Rays, Roots, View,
};
use esvo_format::Octree;

use crate::buffers::Buffer;
use crate::data::{Data, slot_limits};
use crate::filter::Filter;
use crate::gpu::{Gpu, TIMESTAMPS};
use crate::instances::InstanceBuffers;
use crate::pipeline::{BufferSet, Pipeline};
use crate::rays::RayBuffers;

/// Casts by the kernel as SPIR-V through Vulkan.
pub struct AshCaster {
    // Fields are dropped in this order. Each holds the device, so the device is destroyed last.
    frame: Option<FrameBuffers>,
    /// Made for the largest picture of instances so far.
    instances: Option<InstanceBuffers>,
    /// Made for the longest list of rays so far.
    rays: Option<RayBuffers>,
    /// Made for the largest picture so far.
    filter: Option<Filter>,
    loaded: Option<Loaded>,
    options: GpuOptions,
    gpu: Arc<Gpu>,
}

/// An octree on the device.
struct Loaded {
    pipelines: HashMap<(Pass, Variant), Pipeline>,
    set: BufferSet,
    _data: Data,
    roots: Roots,
    map: SlotMap,
    placement: Placement,
}

/// Buffers whose size depends on the picture.
struct FrameBuffers {
    coarse_set: BufferSet,
    main_set: BufferSet,
    view: Buffer,
    coarse: Buffer,
    out: Buffer,
    /// `None` until hits are read for the first time.
    staging: Option<Buffer>,
}

impl AshCaster {
    /// Opens a device.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no Vulkan library, no device, or none of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        Ok(Self {
            frame: None,
            instances: None,
            rays: None,
            filter: None,
            loaded: None,
            options: options.clone(),
            gpu: Arc::new(Gpu::open(options)?),
        })
    }

    /// Compiles the kernels of a frame and makes its buffers. Returns the bands.
    fn prepare(&mut self, view: &View, pass: Pass) -> Result<Bands, CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let limits = &self.gpu.adapter.limits;
        let max_bytes = u64::from(limits.max_storage_buffer_range).min(self.gpu.adapter.max_allocation);
        let max_groups = limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]);
        let bands = Bands::new(view, pass, max_bytes, max_groups, loaded.placement.workgroup)?;
        let Bands { coarse_bytes, out_bytes, .. } = bands;
        let fits = |frame: &FrameBuffers| frame.coarse.bytes >= coarse_bytes && frame.out.bytes >= out_bytes;
        if !self.frame.as_ref().is_some_and(fits) {
            let before = self.frame.take().map_or((0, 0), |frame| (frame.coarse.bytes, frame.out.bytes));
            self.frame = Some(FrameBuffers::new(&self.gpu, coarse_bytes.max(before.0), out_bytes.max(before.1))?);
        }
        let frame = self.frame.as_mut().ok_or(CastError::NotLoaded)?;
        if pass == Pass::Cast && frame.staging.as_ref().is_none_or(|staging| staging.bytes < out_bytes) {
            frame.staging = None;
            frame.staging = Some(Buffer::on_host(&self.gpu, out_bytes, Usage::TRANSFER_DST)?);
        }
        let variant = loaded.placement.variant(view);
        if view.beam() {
            let layout = frame.coarse_set.layout;
            loaded.compile(&self.gpu, &self.options, Pass::Coarse, variant.of_coarse_pass(), layout)?;
        }
        loaded.compile(&self.gpu, &self.options, pass, variant, frame.main_set.layout)?;
        Ok(bands)
    }

    /// Casts one band of rows and waits; the first band starts with the coarse pass. With `Pass::Cast`, the hits are in
    /// the staging buffer afterwards.
    fn band(&mut self, view: &View, pass: Pass, (first_row, rows): (u32, u32)) -> Result<(), CastError> {
        let (Some(loaded), Some(frame)) = (&self.loaded, &mut self.frame) else { return Err(CastError::NotLoaded) };
        let band = kernel::band_view(view, loaded.map.to_resident(view.root), first_row);
        frame.view.contents()[..size_of::<View>()].copy_from_slice(bytemuck::bytes_of(&band));
        let frame = &*frame;
        let variant = loaded.placement.variant(view);
        let main = &loaded.pipelines[&(pass, variant)];
        let coarse =
            (view.beam() && first_row == 0).then(|| &loaded.pipelines[&(Pass::Coarse, variant.of_coarse_pass())]);
        let queries = self.gpu.queries;
        let bytes = u64::from(rows) * u64::from(view.width) * pass.bytes_per_pixel();
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
            let timed = |first, pipeline: &Pipeline, set, (width, height)| {
                stamp(first, vk::PipelineStageFlags::TOP_OF_PIPE);
                pipeline.dispatch(commands, &[set, &loaded.set], kernel::workgroups(width, height, variant.workgroup));
                stamp(first + 1, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
            };
            if let Some(coarse) = coarse {
                timed(0, coarse, &frame.coarse_set, view.coarse_size());
                wait_for_writes(device, commands, vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_READ);
            }
            timed(2, main, &frame.main_set, (view.width, rows));
            if let (Pass::Cast, Some(staging)) = (pass, &frame.staging) {
                wait_for_writes(device, commands, vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_READ);
                let copy = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }];
                // SAFETY: `prepare` made both buffers at least this large.
                unsafe { device.cmd_copy_buffer(commands, frame.out.handle, staging.handle, &copy) };
                let read = [vk::MemoryBarrier::default()
                    .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                    .dst_access_mask(vk::AccessFlags::HOST_READ)];
                let (from, to) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::HOST);
                // SAFETY: the command buffer is being recorded.
                unsafe {
                    device.cmd_pipeline_barrier(commands, from, to, vk::DependencyFlags::empty(), &read, &[], &[]);
                }
            }
        })
    }
}

impl AshCaster {
    fn rays_per_dispatch(&self) -> usize {
        let limits = &self.gpu.adapter.limits;
        let max_bytes = u64::from(limits.max_storage_buffer_range).min(self.gpu.adapter.max_allocation);
        let most = kernel::rays_per_dispatch(max_bytes, limits.max_compute_work_group_count[0]);
        self.options.max_rays.map_or(most, |rays| rays.clamp(1, most))
    }

    /// Casts `some` of the rays, which fit one dispatch, in one submission, and waits.
    fn batch(&mut self, all: &Rays, some: &[Ray], hits: &mut [Hit]) -> Result<(), CastError> {
        let most = self.rays_per_dispatch();
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        if self.rays.as_ref().is_none_or(|buffers| buffers.capacity() < some.len()) {
            self.rays = None;
            self.rays = Some(RayBuffers::new(&self.gpu, some.len(), most)?);
        }
        let buffers = self.rays.as_mut().ok_or(CastError::NotLoaded)?;
        let variant = loaded.placement.rays_variant(all.contours, some.iter().any(Ray::has_size));
        loaded.compile(&self.gpu, &self.options, Pass::Rays, variant, buffers.layout())?;
        let root = loaded.map.to_resident(all.root);
        buffers.cast(&self.gpu, &loaded.pipelines[&(Pass::Rays, variant)], &loaded.set, root, some, hits)
    }
}

/// Makes earlier writes of shaders visible to later commands, in `stage`.
fn wait_for_writes(
    device: &ash::Device,
    commands: vk::CommandBuffer,
    stage: vk::PipelineStageFlags,
    access: vk::AccessFlags,
) {
    let barrier = [vk::MemoryBarrier::default().src_access_mask(vk::AccessFlags::SHADER_WRITE).dst_access_mask(access)];
    let shader = vk::PipelineStageFlags::COMPUTE_SHADER;
    // SAFETY: the command buffer is being recorded; the barrier names no objects.
    unsafe { device.cmd_pipeline_barrier(commands, shader, stage, vk::DependencyFlags::empty(), &barrier, &[], &[]) };
}

impl Caster for AshCaster {
    fn name(&self) -> &'static str {
        "ash"
    }

    fn device(&self) -> &Device {
        self.gpu.about()
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |loaded| loaded.placement.bytes)
    }

    fn roots(&self) -> Option<&Roots> {
        self.loaded.as_ref().map(|loaded| &loaded.roots)
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        roots.belong_to(octree)?;
        // Frees memory for the new octree.
        self.loaded = None;
        self.loaded = Some(Loaded::new(&self.gpu, &self.options, octree, roots)?);
        Ok(())
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        let bands = self.prepare(view, Pass::Cast)?;
        hits.clear();
        hits.resize(view.pixels(), Hit::miss(0));
        for (first, rows) in bands.rows() {
            self.band(view, Pass::Cast, (first, rows))?;
            let at = first as usize * view.width as usize;
            let band: &mut [u8] = bytemuck::cast_slice_mut(&mut hits[at..at + rows as usize * view.width as usize]);
            let staging = self.frame.as_mut().and_then(|frame| frame.staging.as_mut()).ok_or(CastError::NotLoaded)?;
            band.copy_from_slice(&staging.contents()[..band.len()]);
        }
        self.loaded.as_ref().ok_or(CastError::NotLoaded)?.map.restore(hits);
        Ok(())
    }

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let rays = *self.roots().ok_or(CastError::NotLoaded)?.open(&rays)?;
        hits.clear();
        hits.resize(rays.rays.len(), Hit::miss(0));
        let most = self.rays_per_dispatch();
        for (some, hits) in rays.rays.chunks(most).zip(hits.chunks_mut(most)) {
            self.batch(&rays, some, hits)?;
        }
        self.loaded.as_ref().ok_or(CastError::NotLoaded)?.map.restore(hits);
        Ok(())
    }

    fn cast_instances_checked(
        &mut self,
        instances: Checked<&Instances>,
        nearest: &mut Nearest,
    ) -> Result<(), CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let instances = *loaded.roots.open(&instances)?;
        let view = &instances.views()[0];
        let limits = &self.gpu.adapter.limits;
        let max_bytes = u64::from(limits.max_storage_buffer_range).min(self.gpu.adapter.max_allocation);
        let max_groups = limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]);
        let bands = Bands::new(view, Pass::Instances, max_bytes, max_groups, WORKGROUP)?;
        nearest.resize(view);
        let count = instances.nodes().len().max(1);
        let buffers = InstanceBuffers::take(&self.gpu, self.instances.take(), count, bands)?;
        let buffers = self.instances.insert(buffers);
        let variant = loaded.placement.instances_variant(view);
        loaded.compile(&self.gpu, &self.options, Pass::Instances, variant, buffers.layout())?;
        let pipeline = &loaded.pipelines[&(Pass::Instances, variant)];
        buffers.cast(&self.gpu, pipeline, (&loaded.set, &loaded.map), bands, instances, nearest)
    }

    fn filter(&mut self, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let limits = &self.gpu.adapter.limits;
        let max_bytes = u64::from(limits.max_storage_buffer_range).min(self.gpu.adapter.max_allocation);
        let max_bytes = self.options.max_part_bytes.unwrap_or(u64::MAX).min(max_bytes);
        let max_groups = limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]);
        let bands = Band::all(frame, max_bytes, max_groups)?;
        let most = |rows: fn(&Band) -> u32| {
            4 * u64::from(frame.width()) * u64::from(bands.iter().map(rows).max().unwrap_or(0))
        };
        let (input, output) = (most(|band| band.input_rows), most(|band| band.rows));
        let filter = match self.filter.take().filter(|filter| filter.fits(input, output)) {
            Some(filter) => filter,
            None => Filter::new(&self.gpu, input, output)?,
        };
        self.filter.insert(filter).run(&self.gpu, &bands, frame, radius)
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        let bands = self.prepare(view, Pass::Time)?;
        let mut time = FrameTime { total: Duration::ZERO, coarse: Duration::ZERO };
        for (first, rows) in bands.rows() {
            let start = Instant::now();
            self.band(view, Pass::Time, (first, rows))?;
            let wall = start.elapsed();
            let beam = view.beam() && first == 0;
            time.total += match self.gpu.queries {
                Some(queries) => self.gpu.between(queries, if beam { 0 } else { 2 }, 3)?,
                None => wall,
            };
            if let (true, Some(queries)) = (beam, self.gpu.queries) {
                time.coarse += self.gpu.between(queries, 0, 1)?;
            }
        }
        Ok(time)
    }
}

impl Loaded {
    fn new(gpu: &Arc<Gpu>, options: &GpuOptions, octree: &Octree, roots: Roots) -> Result<Self, CastError> {
        let resident = Resident::new(octree);
        let slots = resident.slots();
        let placement = Placement::new(octree, slots, &slot_limits(gpu, options))
            .and_then(|placement| {
                placement.with(options, Arithmetic { rounds_products: false, ..Arithmetic::on(gpu.about().kind) })
            })
            .map_err(|error| gpu.error(&error))?;
        let data = Data::upload(gpu, placement.slots, slots)?;
        let set = BufferSet::of_data(gpu, &[&data])?;
        gpu.check()?;
        Ok(Self { pipelines: HashMap::new(), set, _data: data, roots, map: resident.into_map(), placement })
    }

    /// Makes the pipeline of a pass unless it exists.
    fn compile(
        &mut self,
        gpu: &Arc<Gpu>,
        options: &GpuOptions,
        pass: Pass,
        variant: Variant,
        frame: vk::DescriptorSetLayout,
    ) -> Result<(), CastError> {
        if !self.pipelines.contains_key(&(pass, variant)) {
            let pipeline = Pipeline::new(gpu, &options.source(&variant), pass.entry(), &[frame, self.set.layout])?;
            self.pipelines.insert((pass, variant), pipeline);
        }
        Ok(())
    }
}

impl FrameBuffers {
    fn new(gpu: &Arc<Gpu>, coarse_bytes: u64, out_bytes: u64) -> Result<Self, CastError> {
        let view = Buffer::on_host(gpu, size_of::<View>() as u64, Usage::UNIFORM_BUFFER)?;
        let coarse = Buffer::on_device(gpu, coarse_bytes, Usage::STORAGE_BUFFER)?;
        let out = Buffer::on_device(gpu, out_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC)?;
        let bindings = [
            (DescriptorType::UNIFORM_BUFFER, &view),
            (DescriptorType::STORAGE_BUFFER, &coarse),
            (DescriptorType::STORAGE_BUFFER, &out),
        ];
        let coarse_set = BufferSet::new(gpu, &bindings[..2])?;
        let main_set = BufferSet::new(gpu, &bindings)?;
        Ok(Self { coarse_set, main_set, view, coarse, out, staging: None })
    }
}
