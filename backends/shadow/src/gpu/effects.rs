//! Pictures with effects, made on a device.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use esvo_device::wgpu::{self, Buffer, ComputePipeline};
use esvo_device::{DeviceError, Gpu, Usage, storage, uniform};
use glam::Vec3;

use super::volume::{GpuVolume, volume_layout};
use crate::effects::compose::REACHES;
use crate::effects::{Composed, Frame, Lamp, Offset, Pass, Settings};
use crate::error::ShadowError;
use crate::grid::Grid;
use crate::trace::Fidelity;

/// What follows [`TRACE_WGSL`](super::TRACE_WGSL).
pub const EFFECTS_WGSL: &str = include_str!("../../kernels/effects.wgsl");
/// Pixels of a workgroup along each axis; kernels/effects.wgsl has the same number.
const GROUP: u32 = 8;
/// A lamp that reaches farther reaches everywhere: the square of it is a number that kernels may have.
const FARTHEST: f32 = 1e18;

/// `Picture` of kernels/effects.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Picture {
    eye: [f32; 3],
    width: u32,
    right: [f32; 3],
    height: u32,
    up: [f32; 3],
    half_width: f32,
    forward: [f32; 3],
    half_height: f32,
    origin: [f32; 3],
    voxel: f32,
}

/// `Job` of kernels/effects.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Job {
    rays: u32,
    seed: u32,
    lamps: u32,
    in_picture: u32,
    reach: f32,
    roughness: f32,
    tolerance: f32,
    density: f32,
    apart: i32,
    distance: f32,
    cosine: f32,
    step: f32,
    sky: [f32; 3],
    ambient: f32,
    coarsest: u32,
    fine_until: u32,
    share: f32,
    longest: f32,
}

/// `Lamp` of kernels/effects.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct GpuLamp {
    position: [f32; 3],
    radius: f32,
    color: [f32; 3],
    reach: f32,
    axis: [f32; 3],
    inner: f32,
    outer: f32,
    unused: [f32; 3],
}

impl From<&Lamp> for GpuLamp {
    fn from(lamp: &Lamp) -> Self {
        // Without a cone, no cosine is outside.
        let (axis, inner, outer) = lamp.cone.map_or((Vec3::Z, -2.0, -3.0), |cone| (cone.axis, cone.inner, cone.outer));
        Self {
            position: lamp.position.into(),
            radius: lamp.radius,
            color: lamp.color.into(),
            reach: lamp.reach.min(FARTHEST),
            axis: axis.into(),
            inner,
            outer,
            unused: [0.0; 3],
        }
    }
}

const _: () = assert!(size_of::<Picture>() == 80 && size_of::<Job>() == 80 && size_of::<GpuLamp>() == 64);

/// An entry point of kernels/effects.wgsl.
type Kernel = &'static str;

/// Makes pictures with effects on a device, as [`compose`](crate::effects::compose()) does on the processor.
#[derive(Debug)]
pub struct Effects {
    volume: wgpu::BindGroupLayout,
    layout: wgpu::BindGroupLayout,
    module: wgpu::ShaderModule,
    /// Those that were needed so far.
    pipelines: Mutex<HashMap<Kernel, ComputePipeline>>,
}

impl Effects {
    /// Reads the kernels. Each is compiled when it is first needed.
    ///
    /// # Errors
    /// What the driver refuses; a lost device.
    pub fn new(gpu: &Gpu) -> Result<Self, ShadowError> {
        Self::with_kernels(gpu, EFFECTS_WGSL)
    }

    /// The same with another text in place of [`EFFECTS_WGSL`], e.g. one with a mistake that a test has to find.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_kernels(gpu: &Gpu, kernels: &str) -> Result<Self, ShadowError> {
        let entries = [uniform(0), uniform(1)].into_iter();
        let entries: Vec<_> = entries.chain((2..8).map(|i| storage(i, true))).chain([storage(8, false)]).collect();
        Ok(Self {
            volume: volume_layout(gpu)?,
            layout: gpu.bind_group_layout("effects", &entries)?,
            module: gpu.shader("effects.wgsl", &[super::TRACE_WGSL, kernels].concat())?,
            pipelines: Mutex::default(),
        })
    }

    /// The picture with the effects that are wanted. Times are those of the passes by the device's clock; where it has none or is a driver that runs
    /// on the processor, from submission to the end. Copies to and from the device are not in them.
    ///
    /// # Errors
    /// A picture that is larger than the device's buffers; not enough memory; a lost device.
    pub fn compose(
        &self,
        gpu: &Gpu,
        volume: &GpuVolume,
        grid: Grid,
        frame: &Frame,
        lamps: &[Lamp],
        settings: &Settings,
    ) -> Result<Composed, ShadowError> {
        let mut work = Work::new(self, gpu, volume, grid, frame, lamps, settings)?;
        let light = work.picture(lamps)?;
        let light: Vec<[f32; 4]> = gpu.read(&light, frame.surfaces.len())?;
        let light = light.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect();
        Ok(Composed { light, passes: work.passes })
    }

    fn pipeline(&self, gpu: &Gpu, kernel: Kernel) -> Result<ComputePipeline, DeviceError> {
        let mut pipelines = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pipeline) = pipelines.get(kernel) {
            return Ok(pipeline.clone());
        }
        let pipeline = gpu.compute_pipeline(&self.module, kernel, &[&self.volume, &self.layout])?;
        pipelines.insert(kernel, pipeline.clone());
        Ok(pipeline)
    }
}

/// The work on one picture. Values of pixels are four numbers each.
struct Work<'a> {
    effects: &'a Effects,
    gpu: &'a Gpu,
    volume: &'a GpuVolume,
    settings: &'a Settings,
    /// What passes have in common.
    job: Job,
    size: (u32, u32),
    picture: Buffer,
    lamps: Buffer,
    places: Buffer,
    normals: Buffer,
    colors: Buffer,
    passes: Vec<(Pass, Duration)>,
}

impl<'a> Work<'a> {
    fn new(
        effects: &'a Effects,
        gpu: &'a Gpu,
        volume: &'a GpuVolume,
        grid: Grid,
        frame: &Frame,
        lamps: &[Lamp],
        settings: &'a Settings,
    ) -> Result<Self, ShadowError> {
        let eye = &frame.eye;
        let picture = Picture {
            eye: eye.position.into(),
            width: eye.size.0,
            right: eye.right.into(),
            height: eye.size.1,
            up: eye.up.into(),
            half_width: eye.half.x,
            forward: eye.forward.into(),
            half_height: eye.half.y,
            origin: grid.origin.as_vec3().into(),
            voxel: grid.voxel as f32,
        };
        let edges = settings.edges(&grid);
        let Offset { share, longest } = Offset::SAFE;
        let Fidelity { coarsest, fine_until } = Fidelity::EXACT;
        let job = Job {
            rays: 1,
            seed: settings.seed,
            lamps: lamps.len() as u32,
            in_picture: 1,
            reach: 0.0,
            roughness: settings.roughness,
            tolerance: Settings::tolerance(&edges),
            density: settings.fog / settings.metre,
            apart: 1,
            distance: edges.distance,
            cosine: edges.cosine,
            step: 0.0,
            sky: settings.sky.into(),
            ambient: settings.ambient,
            coarsest,
            fine_until,
            share,
            longest,
        };
        let values = |label, value: &dyn Fn(&crate::effects::Surface) -> [f32; 4]| {
            let values = frame.surfaces.iter().map(|surface| surface.as_ref().map_or([0.0; 4], value));
            gpu.upload(label, &values.collect::<Vec<_>>(), Usage::STORAGE)
        };
        // A binding has at least one lamp.
        let mut list: Vec<GpuLamp> = lamps.iter().map(GpuLamp::from).collect();
        list.resize(list.len().max(1), GpuLamp::zeroed());
        Ok(Self {
            effects,
            gpu,
            volume,
            settings,
            job,
            size: eye.size,
            picture: gpu.upload("picture", &[picture], Usage::UNIFORM)?,
            lamps: gpu.upload("lamps", &list, Usage::STORAGE)?,
            places: values("places", &|surface| surface.position.extend(surface.depth).into())?,
            normals: values("normals", &|surface| surface.normal.extend(0.0).into())?,
            colors: values("colors", &|surface| surface.color.extend(0.0).into())?,
            passes: Vec::new(),
        })
    }

    /// An empty picture of values.
    fn values(&self) -> Result<Buffer, DeviceError> {
        let pixels = u64::from(self.size.0) * u64::from(self.size.1);
        self.gpu.buffer("values", 16 * pixels, Usage::STORAGE | Usage::COPY_SRC)
    }

    fn ones(&self) -> Result<Buffer, DeviceError> {
        let pixels = self.size.0 as usize * self.size.1 as usize;
        self.gpu.upload("ones", &vec![[1.0f32; 4]; pixels], Usage::STORAGE)
    }

    /// Runs a kernel, whose time is that of a pass. What it does not read may be anything.
    fn run_into(
        &mut self,
        pass: Pass,
        kernel: Kernel,
        job: Job,
        [first, second]: [&Buffer; 2],
        made: &Buffer,
    ) -> Result<(), DeviceError> {
        let gpu = self.gpu;
        let pipeline = self.effects.pipeline(gpu, kernel)?;
        let job = gpu.upload("job", &[job], Usage::UNIFORM)?;
        let Self { picture, lamps, places, normals, colors, .. } = self;
        let buffers: [&Buffer; 9] = [picture, &job, lamps, places, normals, colors, first, second, made];
        let group = gpu.bind_group(&self.effects.layout, &buffers)?;
        let [width, height] = [self.size.0, self.size.1].map(|n| n.div_ceil(GROUP));
        let time = gpu.timed(|commands, timestamps| {
            let mut pass = commands.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(kernel),
                timestamp_writes: timestamps.map(|timestamps| timestamps.compute_pass(0)),
            });
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, self.volume.bind_group(), &[]);
            pass.set_bind_group(1, &group, &[]);
            pass.dispatch_workgroups(width, height, 1);
        })?;
        match self.passes.last_mut() {
            Some((last, sum)) if *last == pass => *sum += time,
            _ => self.passes.push((pass, time)),
        }
        Ok(())
    }

    fn run(
        &mut self,
        pass: Pass,
        kernel: Kernel,
        job: Job,
        [first, second]: [Option<&Buffer>; 2],
    ) -> Result<Buffer, DeviceError> {
        let (made, unread) = (self.values()?, self.places.clone());
        self.run_into(pass, kernel, job, [first.unwrap_or(&unread), second.unwrap_or(&unread)], &made)?;
        Ok(made)
    }

    /// A filter's passes, each over pixels twice as far apart.
    fn filter(
        &mut self,
        pass: Pass,
        kernel: Kernel,
        mut values: Buffer,
        second: Option<&Buffer>,
    ) -> Result<Buffer, DeviceError> {
        for number in 0..self.settings.smoothing {
            let job = Job { apart: 1 << number, ..self.job };
            values = self.run(pass, kernel, job, [Some(&values), second])?;
        }
        Ok(values)
    }

    fn smooth_shares(&mut self, pass: Pass, values: Buffer, rays: u32) -> Result<Buffer, DeviceError> {
        if self.settings.smoothing == 0 {
            return Ok(values);
        }
        let around = self.run(pass, "shares_around", Job { rays, ..self.job }, [Some(&values), None])?;
        self.filter(pass, "smooth_shares", values, Some(&around))
    }

    /// The light of each pixel.
    fn picture(&mut self, lamps: &[Lamp]) -> Result<Buffer, DeviceError> {
        let Settings { wanted, counts, metre, .. } = *self.settings;
        let [near, far, fog] = REACHES.map(|reach| reach * metre);
        let open = if wanted.occlusion {
            let job = Job { rays: counts.occlusion, reach: near, ..self.job };
            let open = self.run(Pass::Occlusion, "ambient_occlusion", job, [None; 2])?;
            self.smooth_shares(Pass::SmoothOcclusion, open, counts.occlusion)?
        } else {
            self.ones()?
        };
        let shares = if wanted.shadows && !lamps.is_empty() {
            let job = Job { rays: counts.shadows, ..self.job };
            let shares = self.run(Pass::Shadows, "shadows", job, [None; 2])?;
            // Shadows of points have no noise.
            match lamps.iter().any(|lamp| lamp.radius > 0.0) {
                true => self.smooth_shares(Pass::SmoothShadows, shares, counts.shadows)?,
                false => shares,
            }
        } else {
            self.ones()?
        };
        let mut light = self.values()?;
        if wanted.bounce {
            let job = Job { rays: counts.bounce, reach: near, ..self.job };
            light = self.run(Pass::Bounce, "bounce", job, [None; 2])?;
            light = self.filter(Pass::SmoothBounce, "smooth_surfaces", light, None)?;
        }
        self.run_into(Pass::Shade, "shade", self.job, [&open, &shares], &light)?;
        drop((open, shares));
        if wanted.reflections {
            let job = Job { rays: counts.reflections, reach: far, ..self.job };
            let mut mirrored = self.run(Pass::Reflections, "reflections", job, [Some(&light), None])?;
            if self.settings.roughness > 0.0 {
                mirrored = self.filter(Pass::SmoothReflections, "smooth_surfaces", mirrored, None)?;
            }
            light = self.run(Pass::Mirror, "mix_mirrored", self.job, [Some(&light), Some(&mirrored)])?;
        }
        if wanted.fog {
            let step = self.settings.fog_step as f32;
            let job = Job { rays: counts.fog, reach: fog, in_picture: 0, step, ..self.job };
            let veils = self.run(Pass::Fog, "fog", job, [None; 2])?;
            let veils = self.filter(Pass::BlurFog, "blur", veils, None)?;
            light = self.run(Pass::Veil, "veil", self.job, [Some(&light), Some(&veils)])?;
        }
        Ok(light)
    }
}
