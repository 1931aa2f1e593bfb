//! Lists of rays.

use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use esvo_device::wgpu::{self, Buffer};
use esvo_device::{DeviceError, Gpu, Usage, storage, uniform};
use rayon::prelude::*;

use super::volume::{GpuVolume, volume_layout};
use crate::error::ShadowError;
use crate::trace::{Fidelity, Hit, Ray, Steps, Traced};

/// What follows [`TRACE_WGSL`](super::TRACE_WGSL).
const LIST_WGSL: &str = include_str!("../../kernels/list.wgsl");
/// Rays of a workgroup; kernels/list.wgsl has the same number.
const GROUP: u32 = 64;
/// Rays are traced in parts of at most this many: 128 MiB of rays and as much of answers.
const MOST_RAYS: u64 = 1 << 22;

/// `Fidelity` of kernels/trace.wgsl, in the 16 bytes that a uniform has.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Uniform {
    coarsest: u32,
    fine_until: u32,
    unused: [u32; 2],
}

/// `Answer` of kernels/list.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Answer {
    cell: [i32; 3],
    level: u32,
    numerator: i32,
    denominator: i32,
    looks: u32,
    is_hit: u32,
}

/// What became of a list of rays.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Traces {
    /// One for each ray, in order.
    pub rays: Vec<Traced>,
    /// What the device took to trace them, without copies to and from it: by its own clock, or, where it has none or is a driver that runs on the processor,
    /// from submission to the end.
    pub time: Duration,
}

/// Traces lists of rays on a device.
#[derive(Debug)]
pub struct Tracer {
    rays_layout: wgpu::BindGroupLayout,
    steps_layout: wgpu::BindGroupLayout,
    rays: wgpu::ComputePipeline,
    steps: wgpu::ComputePipeline,
    most: u64,
}

impl Tracer {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// What the driver refuses; a lost device.
    pub fn new(gpu: &Gpu) -> Result<Self, ShadowError> {
        Self::with_kernel(gpu, super::TRACE_WGSL)
    }

    /// The same with another text in place of [`TRACE_WGSL`](super::TRACE_WGSL), e.g. one with a mistake that a test has to find.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_kernel(gpu: &Gpu, kernel: &str) -> Result<Self, ShadowError> {
        let entries = [uniform(0), storage(1, true), storage(2, false), storage(3, true)];
        let rays_layout = gpu.bind_group_layout("rays", &entries[..3])?;
        let steps_layout = gpu.bind_group_layout("rays and steps", &entries)?;
        let volume = volume_layout(gpu)?;
        let module = gpu.shader("trace.wgsl", &[kernel, LIST_WGSL].concat())?;
        let rays = gpu.compute_pipeline(&module, "trace_rays", &[&volume, &rays_layout])?;
        let steps = gpu.compute_pipeline(&module, "trace_steps", &[&volume, &steps_layout])?;
        let limits = gpu.limits();
        let dispatch = u64::from(limits.max_compute_workgroups_per_dimension) * u64::from(GROUP);
        let most = MOST_RAYS.min(dispatch).min(gpu.max_storage_bytes() / size_of::<Answer>() as u64);
        Ok(Self { rays_layout, steps_layout, rays, steps, most })
    }

    /// The same with parts of at most so many rays, at least 1.
    #[must_use]
    pub fn with_parts(self, rays: u64) -> Self {
        Self { most: self.most.min(rays.max(1)), ..self }
    }

    /// As [`first_hit`](crate::trace::first_hit) of each ray.
    ///
    /// # Errors
    /// Not enough memory; a lost device.
    pub fn trace(
        &self,
        gpu: &Gpu,
        volume: &GpuVolume,
        rays: &[Ray],
        fidelity: Fidelity,
    ) -> Result<Traces, ShadowError> {
        let mut traces = Traces::default();
        for rays in rays.chunks(self.most as usize) {
            let answers = self.part(gpu, volume, rays, None, fidelity, &mut traces.time)?;
            let hit = |(ray, answer): (&Ray, &Answer)| {
                answer.traced(ray.distance_of_crossing(answer.numerator, answer.denominator))
            };
            traces.rays.par_extend(rays.par_iter().zip(&answers).map(hit));
        }
        Ok(traces)
    }

    /// As [`Steps::first_hit`] of each ray with its steps.
    ///
    /// # Errors
    /// As [`trace`](Self::trace).
    pub fn trace_steps(
        &self,
        gpu: &Gpu,
        volume: &GpuVolume,
        rays: &[(Ray, Steps)],
        fidelity: Fidelity,
    ) -> Result<Traces, ShadowError> {
        let mut traces = Traces::default();
        for part in rays.chunks(self.most as usize) {
            let (rays, steps): (Vec<Ray>, Vec<Steps>) = part.iter().copied().unzip();
            let answers = self.part(gpu, volume, &rays, Some(&steps), fidelity, &mut traces.time)?;
            let hit = |(ray, answer): (&Ray, &Answer)| answer.traced(ray.distance_of_sample(answer.numerator.into()));
            traces.rays.par_extend(rays.par_iter().zip(&answers).map(hit));
        }
        Ok(traces)
    }

    fn part(
        &self,
        gpu: &Gpu,
        volume: &GpuVolume,
        rays: &[Ray],
        steps: Option<&[Steps]>,
        fidelity: Fidelity,
        time: &mut Duration,
    ) -> Result<Vec<Answer>, DeviceError> {
        let Fidelity { coarsest, fine_until } = fidelity;
        let uniform = gpu.upload("fidelity", &[Uniform { coarsest, fine_until, unused: [0; 2] }], Usage::UNIFORM)?;
        let list = gpu.upload("rays", rays, Usage::STORAGE)?;
        let bytes = size_of::<Answer>() as u64 * rays.len() as u64;
        let answers = gpu.buffer("answers", bytes, Usage::STORAGE | Usage::COPY_SRC)?;
        let steps = steps.map(|steps| gpu.upload("steps", steps, Usage::STORAGE)).transpose()?;
        let buffers: Vec<&Buffer> = [&uniform, &list, &answers].into_iter().chain(&steps).collect();
        let (pipeline, layout) =
            if steps.is_some() { (&self.steps, &self.steps_layout) } else { (&self.rays, &self.rays_layout) };
        let group = gpu.bind_group(layout, &buffers)?;
        *time += gpu.timed(|commands, timestamps| {
            let mut pass = commands.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("trace rays"),
                timestamp_writes: timestamps.map(|timestamps| timestamps.compute_pass(0)),
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, volume.bind_group(), &[]);
            pass.set_bind_group(1, &group, &[]);
            pass.dispatch_workgroups((rays.len() as u32).div_ceil(GROUP), 1, 1);
        })?;
        gpu.read(&answers, rays.len())
    }
}

impl Answer {
    fn traced(&self, distance: f32) -> Traced {
        let hit = Hit { cell: self.cell, level: self.level, distance };
        Traced { hit: (self.is_hit != 0).then_some(hit), steps: self.looks }
    }
}
