//! The caster: octree and picture buffers, passes.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::filter::{Frame, Radius};
use esvo_core::gpu::arithmetic::Arithmetic;
use esvo_core::gpu::kernel::{self, Bands, GpuOptions, Pass, Placement, Variant, WORKGROUP};
use esvo_core::gpu::resident::{Resident, SlotMap};
use esvo_core::gpu::slots::SlotKind;
use esvo_core::{
    CastError, Caster, Checked, Device, Filtered, FrameTime, Hit, Instances, Nearest, Ray, Rays, Roots, View,
};
use esvo_device::{Gpu, Timestamps, Usage, storage, uniform};
use esvo_format::Octree;

use crate::data::{Data, slot_limits};
use crate::filter::Filter;
use crate::instances::{self, InstanceBuffers};
use crate::rays::{self, Batch, PendingHits, RayBuffers};

/// Casts by the WGSL kernel through wgpu.
pub struct WgpuCaster {
    gpu: Gpu,
    options: GpuOptions,
    loaded: Option<Loaded>,
    /// Made for the largest picture so far.
    frame: Option<FrameBuffers>,
    /// Made for the largest picture of instances so far.
    instances: Option<InstanceBuffers>,
    /// Buffers for rays that nothing uses at the moment.
    spare: Vec<RayBuffers>,
    /// Compiled when a picture is filtered for the first time.
    filter: Option<Filter>,
}

/// An octree on the device.
struct Loaded {
    roots: Roots,
    map: Arc<SlotMap>,
    placement: Placement,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    pipelines: HashMap<(Pass, Variant), wgpu::ComputePipeline>,
}

/// Buffers whose size depends on the picture.
struct FrameBuffers {
    coarse_bytes: u64,
    out_bytes: u64,
    view: wgpu::Buffer,
    out: wgpu::Buffer,
    staging: wgpu::Buffer,
    coarse_group: wgpu::BindGroup,
    main_group: wgpu::BindGroup,
    /// `None` if the device has no clock.
    timing: Option<Timestamps>,
}

/// Passes that have timestamps: the coarse pass and the main pass.
const COARSE_PASS: u32 = 0;
const MAIN_PASS: u32 = 1;

impl WgpuCaster {
    /// Opens a device.
    ///
    /// # Errors
    /// [`CastError::Device`]: there is no device, or none of the wanted name; a size of subgroups is demanded, which WebGPU does not
    /// know.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        if let Some(size) = options.subgroup_size {
            return Err(CastError::Device(format!(
                "subgroups of {size}: wgpu cannot ask for a size, ash can on drivers that allow it"
            )));
        }
        Ok(Self::on(Gpu::open(options.adapter.as_deref())?, options.clone()))
    }

    /// Casts on a device that the program has opened, through its queue. `options.adapter` and `options.subgroup_size` are not read. An octree is split
    /// over as many bindings as the device's limits demand; request `adapter.limits()` for large octrees.
    ///
    /// The device's callbacks for errors and for its loss stay those of the program.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue, options: &GpuOptions) -> Self {
        Self::on(Gpu::from_device(device, queue), options.clone())
    }

    fn on(gpu: Gpu, options: GpuOptions) -> Self {
        Self { gpu, options, loaded: None, frame: None, instances: None, spare: Vec::new(), filter: None }
    }

    /// Casts rays as [`cast_rays`](Caster::cast_rays) does, but does not wait for the hits. [`poll`](Self::poll) returns them.
    /// Any number of lists can be on their way, also while another octree is loaded or pictures are cast.
    ///
    /// ```no_run
    /// # fn cast(caster: &mut esvo_wgpu::WgpuCaster, rays: &esvo_core::Rays) -> Result<(), esvo_core::CastError> {
    /// let mut pending = caster.submit_rays(rays)?;
    /// let hits = loop {
    ///     // Other work.
    ///     if let Some(hits) = caster.poll(&mut pending)? {
    ///         break hits;
    ///     }
    /// };
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// As [`cast_rays`](Caster::cast_rays).
    pub fn submit_rays(&mut self, rays: &Rays) -> Result<PendingHits, CastError> {
        let checked = self.roots().ok_or(CastError::NotLoaded)?.check_rays(rays)?;
        let rays = *self.roots().ok_or(CastError::NotLoaded)?.open(&checked)?;
        let batches = rays.rays.chunks(self.rays_per_dispatch());
        let batches = batches.map(|some| self.submit_batch(&rays, some)).collect::<Result<VecDeque<_>, _>>()?;
        let loaded = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        Ok(PendingHits::new(batches, loaded.map.clone()))
    }

    /// The hits of rays that were submitted to this caster, in their order; `None` if they have not arrived yet. Does not wait.
    /// After the hits were returned once, there are none.
    ///
    /// # Errors
    /// What the device said. If the hits of these rays cannot be read, every further call returns this error.
    pub fn poll(&mut self, pending: &mut PendingHits) -> Result<Option<Vec<Hit>>, CastError> {
        self.gpu.poll()?;
        pending.advance(&self.gpu, &mut self.spare)
    }

    fn rays_per_dispatch(&self) -> usize {
        let max_groups = self.gpu.limits().max_compute_workgroups_per_dimension;
        let most = kernel::rays_per_dispatch(self.gpu.max_storage_bytes(), max_groups);
        self.options.max_rays.map_or(most, |rays| rays.clamp(1, most))
    }

    /// Submits `some` of the rays, which fit one dispatch.
    fn submit_batch(&mut self, all: &Rays, some: &[Ray]) -> Result<Batch, CastError> {
        let most = self.rays_per_dispatch();
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let variant = loaded.placement.rays_variant(all.contours, some.iter().any(Ray::has_size));
        loaded.compile(&self.gpu, &self.options, Pass::Rays, variant)?;
        let buffers = RayBuffers::take(&self.gpu, &mut self.spare, some.len(), most)?;
        let root = loaded.map.to_resident(all.root);
        buffers.submit(&self.gpu, &loaded.pipelines[&(Pass::Rays, variant)], &loaded.group, root, some)
    }

    /// Compiles the kernels of a frame and makes its buffers. Returns the bands.
    fn prepare(&mut self, view: &View, pass: Pass) -> Result<Bands, CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let variant = loaded.placement.variant(view);
        if view.beam() {
            loaded.compile(&self.gpu, &self.options, Pass::Coarse, variant.of_coarse_pass())?;
        }
        loaded.compile(&self.gpu, &self.options, pass, variant)?;
        let max_groups = self.gpu.limits().max_compute_workgroups_per_dimension;
        let bands = Bands::new(view, pass, self.gpu.max_storage_bytes(), max_groups, loaded.placement.workgroup)?;
        let Bands { coarse_bytes, out_bytes, .. } = bands;
        let fits = |frame: &FrameBuffers| frame.coarse_bytes >= coarse_bytes && frame.out_bytes >= out_bytes;
        if !self.frame.as_ref().is_some_and(fits) {
            let before = self.frame.take().map_or((0, 0), |frame| (frame.coarse_bytes, frame.out_bytes));
            self.frame = Some(FrameBuffers::new(&self.gpu, coarse_bytes.max(before.0), out_bytes.max(before.1))?);
        }
        Ok(bands)
    }

    /// Submits one band of rows; the first band starts with the coarse pass. `finish` may add commands after the passes.
    fn submit(
        &self,
        view: &View,
        pass: Pass,
        (first_row, rows): (u32, u32),
        finish: impl FnOnce(&mut wgpu::CommandEncoder, &FrameBuffers),
    ) -> Result<(), CastError> {
        let (Some(loaded), Some(frame)) = (&self.loaded, &self.frame) else { return Err(CastError::NotLoaded) };
        let band = kernel::band_view(view, loaded.map.to_resident(view.root), first_row);
        self.gpu.write(&frame.view, 0, bytemuck::bytes_of(&band))?;
        let variant = loaded.placement.variant(view);
        self.gpu.submit(|commands| {
            let mut dispatch = |pass: Pass, variant, group: &wgpu::BindGroup, (width, height): (u32, u32)| {
                let number = if pass == Pass::Coarse { COARSE_PASS } else { MAIN_PASS };
                let timestamp_writes = frame.timing.as_ref().map(|timing| timing.compute_pass(number));
                let descriptor = wgpu::ComputePassDescriptor { label: Some(pass.entry()), timestamp_writes };
                let mut compute = commands.begin_compute_pass(&descriptor);
                compute.set_pipeline(&loaded.pipelines[&(pass, variant)]);
                compute.set_bind_group(0, group, &[]);
                compute.set_bind_group(1, &loaded.group, &[]);
                let (x, y) = kernel::workgroups(width, height, variant.workgroup);
                compute.dispatch_workgroups(x, y, 1);
            };
            if view.beam() && first_row == 0 {
                dispatch(Pass::Coarse, variant.of_coarse_pass(), &frame.coarse_group, view.coarse_size());
            }
            dispatch(pass, variant, &frame.main_group, (view.width, rows));
            finish(commands, frame);
        })?;
        Ok(())
    }
}

impl Caster for WgpuCaster {
    fn name(&self) -> &'static str {
        "wgpu"
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
            let count = rows as usize * view.width as usize;
            let bytes = (count * size_of::<Hit>()) as u64;
            self.submit(view, Pass::Cast, (first, rows), |commands, frame| {
                commands.copy_buffer_to_buffer(&frame.out, 0, &frame.staging, 0, bytes);
            })?;
            let frame = self.frame.as_ref().ok_or(CastError::NotLoaded)?;
            let at = first as usize * view.width as usize;
            let band = &mut hits[at..at + count];
            self.gpu
                .read_staging(&frame.staging, bytes, |from| bytemuck::cast_slice_mut(band).copy_from_slice(from))?;
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
            let batch = self.submit_batch(&rays, some)?;
            self.gpu.wait()?;
            if batch.finish(&self.gpu, hits, &mut self.spare)?.is_some() {
                return Err(self.gpu.error("the device did not deliver the hits").into());
            }
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
        let variant = loaded.placement.instances_variant(view);
        loaded.compile(&self.gpu, &self.options, Pass::Instances, variant)?;
        let max_groups = self.gpu.limits().max_compute_workgroups_per_dimension;
        let bands = Bands::new(view, Pass::Instances, self.gpu.max_storage_bytes(), max_groups, WORKGROUP)?;
        nearest.resize(view);
        let count = instances.nodes().len().max(1);
        let buffers = InstanceBuffers::take(&self.gpu, self.instances.take(), count, bands)?;
        let buffers = self.instances.insert(buffers);
        let pipeline = &loaded.pipelines[&(Pass::Instances, variant)];
        buffers.cast(&self.gpu, pipeline, (&loaded.group, &loaded.map), bands, instances, nearest)
    }

    fn filter(&mut self, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let filter = match self.filter.take() {
            Some(filter) => filter,
            None => Filter::new(&self.gpu)?,
        };
        let max_bytes = self.options.max_part_bytes.unwrap_or(u64::MAX).min(self.gpu.max_storage_bytes());
        self.filter.insert(filter).run(&self.gpu, max_bytes, frame, radius)
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        let bands = self.prepare(view, Pass::Time)?;
        // Earlier work must not count as part of this frame.
        self.gpu.wait()?;
        let mut time = FrameTime { total: Duration::ZERO, coarse: Duration::ZERO };
        for (first, rows) in bands.rows() {
            let start = Instant::now();
            self.submit(view, Pass::Time, (first, rows), |commands, frame| {
                if let Some(timing) = &frame.timing {
                    timing.resolve(commands);
                }
            })?;
            let frame = self.frame.as_ref().ok_or(CastError::NotLoaded)?;
            let (coarse, total) = match &frame.timing {
                Some(timing) => {
                    let times = timing.read(&self.gpu)?;
                    if view.beam() && first == 0 {
                        (times.span(COARSE_PASS..=COARSE_PASS), times.span(COARSE_PASS..=MAIN_PASS))
                    } else {
                        (Duration::ZERO, times.span(MAIN_PASS..=MAIN_PASS))
                    }
                }
                None => {
                    self.gpu.wait()?;
                    (Duration::ZERO, start.elapsed())
                }
            };
            time.coarse += coarse;
            time.total += total;
        }
        Ok(time)
    }
}

impl Loaded {
    fn new(gpu: &Gpu, options: &GpuOptions, octree: &Octree, roots: Roots) -> Result<Self, CastError> {
        let resident = Resident::new(octree);
        let slots = resident.slots();
        let placement = Placement::new(octree, slots, &slot_limits(gpu, options))
            .and_then(|placement| placement.with(options, Arithmetic::on(gpu.about().kind)))
            .map_err(|error| gpu.error(error))?;
        let data = Data::upload(gpu, "octree", SlotKind::Pair, placement.slots, slots)?;
        let (layout, group) = Data::bind(gpu, "octree", &[&data])?;
        let pipelines = HashMap::new();
        Ok(Self { roots, map: Arc::new(resident.into_map()), placement, layout, group, pipelines })
    }

    /// Makes the pipeline of a pass unless it exists.
    fn compile(&mut self, gpu: &Gpu, options: &GpuOptions, pass: Pass, variant: Variant) -> Result<(), CastError> {
        if self.pipelines.contains_key(&(pass, variant)) {
            return Ok(());
        }
        let module = gpu.shader("cast.wgsl", &options.source(&variant))?;
        let frame = match pass {
            Pass::Rays => rays::layout(gpu)?,
            Pass::Instances => instances::layout(gpu)?,
            Pass::Coarse | Pass::Cast | Pass::Time => frame_layout(gpu, pass == Pass::Coarse)?,
        };
        let pipeline = gpu.compute_pipeline(&module, pass.entry(), &[&frame, &self.layout])?;
        self.pipelines.insert((pass, variant), pipeline);
        Ok(())
    }
}

impl FrameBuffers {
    fn new(gpu: &Gpu, coarse_bytes: u64, out_bytes: u64) -> Result<Self, CastError> {
        let view = gpu.buffer("view", size_of::<View>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let coarse = gpu.buffer("coarse values", coarse_bytes, Usage::STORAGE)?;
        let out = gpu.buffer("hits", out_bytes, Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("hits to read", out_bytes, Usage::MAP_READ | Usage::COPY_DST)?;
        let coarse_group = gpu.bind_group(&frame_layout(gpu, true)?, &[&view, &coarse])?;
        let main_group = gpu.bind_group(&frame_layout(gpu, false)?, &[&view, &coarse, &out])?;
        let timing = gpu.timestamps(2)?;
        Ok(Self { coarse_bytes, out_bytes, view, out, staging, coarse_group, main_group, timing })
    }
}

/// Layout of group 0: the coarse pass writes the coarse values and nothing else; the main pass reads them.
fn frame_layout(gpu: &Gpu, coarse: bool) -> Result<wgpu::BindGroupLayout, CastError> {
    let entries =
        [uniform(kernel::BINDING_VIEW), storage(kernel::BINDING_COARSE, !coarse), storage(kernel::BINDING_OUT, false)];
    Ok(gpu.bind_group_layout("frame", if coarse { &entries[..2] } else { &entries })?)
}
