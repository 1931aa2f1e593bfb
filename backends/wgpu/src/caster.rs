//! The caster: buffers, pipelines, passes.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::gpu::kernel::{self, Bands, GpuOptions, Pass, Placement, Variant, WORKGROUP};
use esvo_core::gpu::resident::{Resident, SlotMap};
use esvo_core::{CastError, Caster, Device, FrameTime, Hit, View};
use esvo_format::Octree;
use wgpu::BufferUsages as Usage;

use crate::gpu::Gpu;

/// Octree data is copied in pieces of this many slots, so that staging memory stays small.
const UPLOAD_SLOTS: usize = 8 << 20;
/// Casts by the WGSL kernel through wgpu.
pub struct WgpuCaster {
    gpu: Gpu,
    options: GpuOptions,
    loaded: Option<Loaded>,
    /// Grow as pictures do.
    frame: Option<FrameBuffers>,
}

/// An octree on the device.
struct Loaded {
    map: SlotMap,
    placement: Placement,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    pipelines: HashMap<(Pass, Variant), wgpu::ComputePipeline>,
}

/// What depends on the size of the picture.
struct FrameBuffers {
    coarse_bytes: u64,
    out_bytes: u64,
    view: wgpu::Buffer,
    out: wgpu::Buffer,
    staging: wgpu::Buffer,
    coarse_group: wgpu::BindGroup,
    main_group: wgpu::BindGroup,
    timing: Option<Timing>,
}

/// Four timestamps: start and end of both passes.
struct Timing {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
}

const TIMESTAMPS: u32 = 4;
const TIMESTAMP_BYTES: u64 = TIMESTAMPS as u64 * 8;

impl WgpuCaster {
    /// Opens a device.
    ///
    /// # Errors
    /// [`CastError::Device`] without one, or without one of the wanted name.
    pub fn new(options: &GpuOptions) -> Result<Self, CastError> {
        Ok(Self { gpu: Gpu::open(options)?, options: options.clone(), loaded: None, frame: None })
    }

    /// Compiles what a frame needs and makes its buffers. Returns the bands.
    fn prepare(&mut self, view: &View, pass: Pass) -> Result<Bands, CastError> {
        let loaded = self.loaded.as_mut().ok_or(CastError::NotLoaded)?;
        let variant = loaded.placement.variant(view);
        if view.beam() {
            loaded.compile(&self.gpu, &self.options, Pass::Coarse, variant.of_coarse_pass())?;
        }
        loaded.compile(&self.gpu, &self.options, pass, variant)?;
        let limits = &self.gpu.limits;
        let max_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let max_groups = limits.max_compute_workgroups_per_dimension;
        let bands = Bands::new(view, pass, max_bytes, max_groups)?;
        let Bands { coarse_bytes, out_bytes, .. } = bands;
        let fits = |frame: &FrameBuffers| frame.coarse_bytes >= coarse_bytes && frame.out_bytes >= out_bytes;
        if !self.frame.as_ref().is_some_and(fits) {
            let before = self.frame.take().map_or((0, 0), |frame| (frame.coarse_bytes, frame.out_bytes));
            self.frame = Some(FrameBuffers::new(&self.gpu, coarse_bytes.max(before.0), out_bytes.max(before.1))?);
        }
        Ok(bands)
    }

    /// Casts the rows of one band; the coarse pass goes before the first. `finish` may add commands.
    fn submit(
        &self,
        view: &View,
        pass: Pass,
        (first_row, rows): (u32, u32),
        finish: impl FnOnce(&mut wgpu::CommandEncoder, &FrameBuffers),
    ) -> Result<(), CastError> {
        let (Some(loaded), Some(frame)) = (&self.loaded, &self.frame) else { return Err(CastError::NotLoaded) };
        let band = kernel::band_view(view, loaded.map.to_resident(view.root), first_row);
        self.gpu.queue.write_buffer(&frame.view, 0, bytemuck::bytes_of(&band));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let variant = loaded.placement.variant(view);
        let mut dispatch = |pass: Pass, variant, group: &wgpu::BindGroup, (width, height): (u32, u32)| {
            let first = if pass == Pass::Coarse { 0 } else { 2 };
            let timestamp_writes = frame.timing.as_ref().map(|timing| wgpu::ComputePassTimestampWrites {
                query_set: &timing.queries,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let descriptor = wgpu::ComputePassDescriptor { label: Some(pass.entry()), timestamp_writes };
            let mut compute = encoder.begin_compute_pass(&descriptor);
            compute.set_pipeline(&loaded.pipelines[&(pass, variant)]);
            compute.set_bind_group(0, group, &[]);
            compute.set_bind_group(1, &loaded.group, &[]);
            let (x, y) = kernel::workgroups(width, height, WORKGROUP);
            compute.dispatch_workgroups(x, y, 1);
        };
        if view.beam() && first_row == 0 {
            dispatch(Pass::Coarse, variant.of_coarse_pass(), &frame.coarse_group, view.coarse_size());
        }
        dispatch(pass, variant, &frame.main_group, (view.width, rows));
        finish(&mut encoder, frame);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.check()
    }

    /// Gives the first bytes of a buffer that the device has filled to `take`.
    fn read(&self, staging: &wgpu::Buffer, bytes: u64, take: impl FnOnce(&[u8])) -> Result<(), CastError> {
        let result = Arc::new(std::sync::Mutex::new(None));
        let store = result.clone();
        staging.map_async(wgpu::MapMode::Read, ..bytes, move |mapped| {
            *store.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(mapped);
        });
        self.gpu.wait()?;
        match result.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take() {
            Some(Ok(())) => {}
            Some(Err(error)) => return Err(self.gpu.error(&error)),
            None => return Err(self.gpu.error(&"the result was not delivered")),
        }
        let view = staging.get_mapped_range(..bytes).map_err(|error| self.gpu.error(&error))?;
        take(&view);
        drop(view);
        staging.unmap();
        Ok(())
    }

    /// How long the coarse pass and the main pass of the last submission took.
    fn timestamps(&self, timing: &Timing, beam: bool) -> Result<(Duration, Duration), CastError> {
        let mut ticks = [0u64; TIMESTAMPS as usize];
        self.read(&timing.staging, TIMESTAMP_BYTES, |bytes| {
            bytemuck::cast_slice_mut(&mut ticks).copy_from_slice(bytes);
        })?;
        let period = f64::from(self.gpu.queue.get_timestamp_period());
        let span = |from: usize, to: usize| {
            Duration::from_nanos((ticks[to].saturating_sub(ticks[from]) as f64 * period) as u64)
        };
        Ok(if beam { (span(0, 1), span(0, 3)) } else { (Duration::ZERO, span(2, 3)) })
    }
}

impl Caster for WgpuCaster {
    fn name(&self) -> &'static str {
        "wgpu"
    }

    fn device(&self) -> &Device {
        &self.gpu.about
    }

    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        octree.sound()?;
        // Room for the new one.
        self.loaded = None;
        self.loaded = Some(Loaded::new(&self.gpu, &self.options, octree)?);
        Ok(())
    }

    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let bands = self.prepare(view, Pass::Cast)?;
        hits.clear();
        hits.resize(view.pixels(), Hit::miss(0));
        for (first, rows) in bands.rows() {
            let count = rows as usize * view.width as usize;
            let bytes = (count * size_of::<Hit>()) as u64;
            self.submit(view, Pass::Cast, (first, rows), |encoder, frame| {
                encoder.copy_buffer_to_buffer(&frame.out, 0, &frame.staging, 0, bytes);
            })?;
            let frame = self.frame.as_ref().ok_or(CastError::NotLoaded)?;
            let at = first as usize * view.width as usize;
            let band = &mut hits[at..at + count];
            self.read(&frame.staging, bytes, |from| bytemuck::cast_slice_mut(band).copy_from_slice(from))?;
        }
        self.loaded.as_ref().ok_or(CastError::NotLoaded)?.map.restore(hits);
        Ok(())
    }

    fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
        let bands = self.prepare(view, Pass::Time)?;
        // Nothing that was asked for earlier belongs to this frame.
        self.gpu.wait()?;
        let mut time = FrameTime { total: Duration::ZERO, coarse: Duration::ZERO };
        for (first, rows) in bands.rows() {
            let start = Instant::now();
            self.submit(view, Pass::Time, (first, rows), |encoder, frame| {
                if let Some(timing) = &frame.timing {
                    encoder.resolve_query_set(&timing.queries, 0..TIMESTAMPS, &timing.resolved, 0);
                    encoder.copy_buffer_to_buffer(&timing.resolved, 0, &timing.staging, 0, TIMESTAMP_BYTES);
                }
            })?;
            let frame = self.frame.as_ref().ok_or(CastError::NotLoaded)?;
            let (coarse, total) = match &frame.timing {
                Some(timing) => self.timestamps(timing, view.beam() && first == 0)?,
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

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |loaded| loaded.placement.bytes)
    }
}

impl Loaded {
    fn new(gpu: &Gpu, options: &GpuOptions, octree: &Octree) -> Result<Self, CastError> {
        let resident = Resident::new(octree);
        let slots = resident.slots();
        let limits = &gpu.limits;
        let max_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let max_bytes = options.max_part_bytes.unwrap_or(u64::MAX).min(max_bytes);
        let placement = Placement::new(octree, slots, max_bytes, limits.max_storage_buffers_per_shader_stage)
            .map_err(|error| gpu.error(&error))?;
        let entry = |binding| binding_entry(binding, wgpu::BufferBindingType::Storage { read_only: true });
        let layout = bind_group_layout(gpu, "octree", &(0..placement.parts).map(entry).collect::<Vec<_>>());
        let mut buffers = Vec::new();
        for part in placement.parts(slots) {
            let buffer = gpu.buffer("octree", size_of_val(part) as u64, Usage::STORAGE | Usage::COPY_DST)?;
            for (piece, at) in part.chunks(UPLOAD_SLOTS).zip((0..).step_by(UPLOAD_SLOTS * 8)) {
                gpu.queue.write_buffer(&buffer, at, bytemuck::cast_slice(piece));
                gpu.queue.submit([]);
                gpu.wait()?;
            }
            buffers.push(buffer);
        }
        let group = bind_group(gpu, &layout, &buffers.iter().collect::<Vec<_>>());
        gpu.check()?;
        let pipelines = HashMap::new();
        Ok(Self { map: resident.into_map(), placement, layout, group, pipelines })
    }

    /// Makes the pipeline of a pass unless it is there.
    fn compile(&mut self, gpu: &Gpu, options: &GpuOptions, pass: Pass, variant: Variant) -> Result<(), CastError> {
        if self.pipelines.contains_key(&(pass, variant)) {
            return Ok(());
        }
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("cast.wgsl"),
            source: wgpu::ShaderSource::Wgsl(options.source(&variant).into()),
        });
        gpu.check()?;
        let frame = frame_layout(gpu, pass == Pass::Coarse);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(pass.entry()),
            bind_group_layouts: &[Some(&frame), Some(&self.layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(pass.entry()),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(pass.entry()),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        gpu.check()?;
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
        let coarse_group = bind_group(gpu, &frame_layout(gpu, true), &[&view, &coarse]);
        let main_group = bind_group(gpu, &frame_layout(gpu, false), &[&view, &coarse, &out]);
        let timing = gpu.timestamps.then(|| Timing::new(gpu)).transpose()?;
        gpu.check()?;
        Ok(Self { coarse_bytes, out_bytes, view, out, staging, coarse_group, main_group, timing })
    }
}

impl Timing {
    fn new(gpu: &Gpu) -> Result<Self, CastError> {
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("passes"),
            ty: wgpu::QueryType::Timestamp,
            count: TIMESTAMPS,
        });
        let resolved = gpu.buffer("timestamps", TIMESTAMP_BYTES, Usage::QUERY_RESOLVE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("timestamps to read", TIMESTAMP_BYTES, Usage::MAP_READ | Usage::COPY_DST)?;
        Ok(Self { queries, resolved, staging })
    }
}

/// Layout of group 0: the coarse pass writes the coarse values and nothing else; the main pass reads them.
fn frame_layout(gpu: &Gpu, coarse: bool) -> wgpu::BindGroupLayout {
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let entries = [
        binding_entry(kernel::BINDING_VIEW, wgpu::BufferBindingType::Uniform),
        binding_entry(kernel::BINDING_COARSE, storage(!coarse)),
        binding_entry(kernel::BINDING_OUT, storage(false)),
    ];
    bind_group_layout(gpu, "frame", if coarse { &entries[..2] } else { &entries })
}

fn bind_group_layout(gpu: &Gpu, label: &str, entries: &[wgpu::BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
}

fn binding_entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

/// Binds whole buffers, from binding 0.
fn bind_group(gpu: &Gpu, layout: &wgpu::BindGroupLayout, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
