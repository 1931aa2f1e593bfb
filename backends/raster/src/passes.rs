//! Pipelines and bind groups.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use esvo_device::wgpu::{self, ShaderStages};
use esvo_device::{Gpu, storage, uniform};

use crate::{Method, RasterError, bounds};

/// Numbers that kernels read; `kernels/params.wgsl` has the same struct.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Params {
    pub(crate) tile: u32,
    pub(crate) count: u32,
    pub(crate) first: u32,
    pub(crate) capacity: u32,
    pub(crate) words: u32,
    pub(crate) groups_x: u32,
    pub(crate) wanted: u32,
    pub(crate) sum_first: u32,
    pub(crate) end: [i32; 3],
    pub(crate) sum_count: u32,
}

/// What is done with a voxel that is found.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Emit {
    /// Its bit is set.
    Write,
    /// If it is missing in a method's result, its bit is set.
    Crack,
    /// Nothing; pixels are counted.
    Pixels,
    /// The triangle's look there is added to the voxel's sums.
    Sum,
}

impl Emit {
    fn source(self) -> &'static str {
        match self {
            Self::Write => include_str!("../kernels/emit_write.wgsl"),
            Self::Crack => include_str!("../kernels/emit_crack.wgsl"),
            Self::Pixels => include_str!("../kernels/pixels.wgsl"),
            Self::Sum => include_str!("../kernels/emit_sum.wgsl"),
        }
    }

    /// The bindings of group 1: whether each is read only.
    fn bindings(self) -> &'static [bool] {
        match self {
            Self::Write => &[],
            Self::Crack => &[true],
            Self::Pixels => &[false],
            Self::Sum => &[true, true, true, true, false],
        }
    }
}

/// The struct of parameters, which every kernel begins with.
const PARAMS: &str = include_str!("../kernels/params.wgsl");

/// The kernels of a file that tests triangles, with one kind of `emit`.
fn source(kernels: &str, emit: Emit) -> String {
    [&bounds::source(), PARAMS, include_str!("../kernels/common.wgsl"), kernels, emit.source()].concat()
}

fn all_stages(entry: wgpu::BindGroupLayoutEntry) -> wgpu::BindGroupLayoutEntry {
    let visibility = ShaderStages::VERTEX_FRAGMENT | ShaderStages::COMPUTE;
    wgpu::BindGroupLayoutEntry { visibility, ..entry }
}

fn writable(binding: u32) -> wgpu::BindGroupLayoutEntry {
    let visibility = ShaderStages::FRAGMENT | ShaderStages::COMPUTE;
    wgpu::BindGroupLayoutEntry { visibility, ..storage(binding, false) }
}

/// The format of render targets, which nothing is written to: wgpu refuses a pass without one.
pub(crate) const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// A pipeline that rasterizes.
#[derive(Clone)]
pub(crate) struct Raster {
    pub(crate) pipeline: wgpu::RenderPipeline,
    pub(crate) emit_layout: wgpu::BindGroupLayout,
}

/// Pipelines that compute.
#[derive(Clone)]
pub(crate) struct Compute {
    pub(crate) voxelize: wgpu::ComputePipeline,
    pub(crate) apply: wgpu::ComputePipeline,
    pub(crate) emit_layout: wgpu::BindGroupLayout,
    pub(crate) work_layout: wgpu::BindGroupLayout,
}

/// Pipelines that make a list of a grid.
pub(crate) struct Compact {
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) sum_blocks: wgpu::ComputePipeline,
    pub(crate) scan_blocks: wgpu::ComputePipeline,
    pub(crate) list_voxels: wgpu::ComputePipeline,
}

/// Makes pipelines when they are first used, and keeps them.
pub(crate) struct Passes {
    /// Group 0 of the kernels that voxelize.
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) compact: Compact,
    rasters: Mutex<HashMap<(Method, Emit), Arc<Raster>>>,
    computes: Mutex<HashMap<Emit, Arc<Compute>>>,
}

impl Passes {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, RasterError> {
        let entries = [all_stages(uniform(0)), all_stages(storage(1, true)), writable(2)];
        let layout = gpu.bind_group_layout("voxelize", &entries)?;
        let entries = [uniform(0), storage(1, true), storage(2, false), storage(3, false), storage(4, false)];
        let lists = gpu.bind_group_layout("compact", &entries)?;
        let module = gpu.shader("compact.wgsl", &[PARAMS, include_str!("../kernels/compact.wgsl")].concat())?;
        let pipeline = |entry| gpu.compute_pipeline(&module, entry, &[&lists]);
        let compact = Compact {
            sum_blocks: pipeline("sum_blocks")?,
            scan_blocks: pipeline("scan_blocks")?,
            list_voxels: pipeline("list_voxels")?,
            layout: lists,
        };
        Ok(Self { layout, compact, rasters: Mutex::default(), computes: Mutex::default() })
    }

    fn emit_layout(gpu: &Gpu, emit: Emit) -> Result<wgpu::BindGroupLayout, RasterError> {
        let entry = |(binding, read_only): (u32, &bool)| {
            if *read_only { all_stages(storage(binding, true)) } else { writable(binding) }
        };
        let entries: Vec<_> = (0..).zip(emit.bindings()).map(entry).collect();
        Ok(gpu.bind_group_layout("found voxels", &entries)?)
    }

    /// The pipelines of [`Method::Compute`].
    pub(crate) fn compute(&self, gpu: &Gpu, emit: Emit) -> Result<Arc<Compute>, RasterError> {
        let mut made = self.computes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = made.get(&emit) {
            return Ok(found.clone());
        }
        let emit_layout = Self::emit_layout(gpu, emit)?;
        let work_layout = gpu.bind_group_layout("work", &[storage(0, true), storage(1, false)])?;
        let module = gpu.shader("compute.wgsl", &source(include_str!("../kernels/compute.wgsl"), emit))?;
        let layouts = [&self.layout, &emit_layout, &work_layout];
        let voxelize = gpu.compute_pipeline(&module, "voxelize", &layouts)?;
        let apply = gpu.compute_pipeline(&module, "apply", &layouts)?;
        let compute = Arc::new(Compute { voxelize, apply, emit_layout, work_layout });
        made.insert(emit, compute.clone());
        Ok(compute)
    }

    /// The pipeline of a method that rasterizes.
    pub(crate) fn raster(&self, gpu: &Gpu, method: Method, emit: Emit) -> Result<Arc<Raster>, RasterError> {
        let mut made = self.rasters.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = made.get(&(method, emit)) {
            return Ok(found.clone());
        }
        let emit_layout = Self::emit_layout(gpu, emit)?;
        let module = gpu.shader("raster.wgsl", &source(include_str!("../kernels/raster.wgsl"), emit))?;
        let expanded = matches!(method, Method::Expanded | Method::ExpandedClipped | Method::ExpandedTested);
        let hardware = matches!(method, Method::Hardware | Method::HardwareTested);
        let flag = f64::from;
        let constants = [
            ("EXPAND", flag(expanded)),
            // Without a limit corners of needles move out of the numbers' range; the method is known for its long ones.
            ("REACH", if method == Method::Expanded { 64.0 } else { 16.0 }),
            ("CLIP", flag(method == Method::ExpandedClipped)),
            // Voxels that are missing are found by testing the columns that the method shades.
            ("TESTS", flag(method.is_tested() || emit == Emit::Crack)),
            ("CLAMP", flag(matches!(method, Method::FixedAxis | Method::DominantAxis))),
        ];
        let vertex_constants = &constants[..2];
        let fragment_constants = if emit == Emit::Pixels { &[][..] } else { &constants[2..] };
        let options = |constants| wgpu::PipelineCompilationOptions { constants, ..Default::default() };
        let pipeline = gpu.checked(|device| {
            let layouts = [Some(&self.layout), Some(&emit_layout)];
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(method.name()),
                bind_group_layouts: &layouts,
                immediate_size: 0,
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(method.name()),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("project"),
                    compilation_options: options(vertex_constants),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState { conservative: hardware, ..Default::default() },
                depth_stencil: None,
                multisample: wgpu::MultisampleState { count: method.samples(), ..Default::default() },
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(if emit == Emit::Pixels { "count" } else { "shade" }),
                    compilation_options: options(fragment_constants),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: TARGET,
                        blend: None,
                        write_mask: wgpu::ColorWrites::empty(),
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        })?;
        let raster = Arc::new(Raster { pipeline, emit_layout });
        made.insert((method, emit), raster.clone());
        Ok(raster)
    }
}

const _: () = assert!(size_of::<Params>() == 48);
