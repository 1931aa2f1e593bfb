//! The same volume and the same rays on a GPU.

use std::time::Instant;

use esvo_core::DeviceKind;
use esvo_device::Gpu;
use esvo_shadow::gpu::{Effects, GpuVolume, Tracer};
use esvo_shadow::trace::{Fidelity, MAX_LEVEL, Ray, Steps};
use esvo_shadow::{Extent, Volume};

use glam::Vec3;

use super::picture_time::{Scene, measure};
use super::stage::failed;
use super::{PictureRow, RateRow, WALK};
use crate::BenchError;

/// An open device.
pub(super) struct Device {
    gpu: Gpu,
    tracer: Tracer,
    effects: Effects,
}

impl Device {
    /// The best device; an error says why there is none.
    pub(super) fn open() -> Result<Self, BenchError> {
        let gpu = Gpu::open(None).map_err(|e| failed("device", e))?;
        let tracer = Tracer::new(&gpu).map_err(|e| failed("device", e))?;
        let effects = Effects::new(&gpu).map_err(|e| failed("device", e))?;
        Ok(Self { gpu, tracer, effects })
    }

    /// Its name; drivers that run on the processor are labelled.
    fn name(&self) -> String {
        let about = self.gpu.about();
        let software = if about.kind == DeviceKind::SoftwareGpu { ", software, not a GPU" } else { "" };
        format!("{}{software}", about.name)
    }

    /// Of how many pictures, from the first, the changes are sent: drivers that run on the processor take long for it.
    pub(super) fn pictures(&self) -> u32 {
        if self.gpu.about().kind == DeviceKind::SoftwareGpu { 2 } else { 20 }
    }

    /// A copy of a volume.
    pub(super) fn copy(&self, volume: &Volume) -> Result<GpuVolume, BenchError> {
        GpuVolume::new(&self.gpu, volume).map_err(|e| failed("device", e))
    }

    /// Milliseconds to send regions of a volume, until the device has them.
    pub(super) fn send(&self, copy: &mut GpuVolume, volume: &Volume, regions: &[Extent]) -> Result<f64, BenchError> {
        let start = Instant::now();
        copy.update(&self.gpu, volume, regions).map_err(|e| failed("device", e))?;
        self.gpu.run(|_| ()).map_err(|e| failed("device", e))?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Times of a picture's passes, and how many pixels differ from those expected. Drivers that run on the processor make one picture.
    pub(super) fn picture(&self, scene: &Scene, rounds: u32, expected: &[Vec3]) -> Result<PictureRow, BenchError> {
        let copy = self.copy(scene.world.volume())?;
        let rounds = if self.gpu.about().kind == DeviceKind::SoftwareGpu { 1 } else { rounds };
        let make = || {
            let (grid, Scene { frame, lamps, settings, .. }) = (*scene.world.grid(), scene);
            self.effects.compose(&self.gpu, &copy, grid, frame, lamps, settings).map_err(|e| failed("device", e))
        };
        // Kernels are compiled, and clocks rise, before anything is measured.
        if rounds > 1 {
            make()?;
        }
        Ok(measure(self.name(), rounds, Some(expected), make)?.1)
    }

    /// Rates of the first hit and of steps of one voxel, with the document's two mips and with all.
    pub(super) fn rates(
        &self,
        kind: &str,
        volume: &Volume,
        rays: &[Ray],
        walked: &[bool],
        rounds: u32,
    ) -> Result<Vec<RateRow>, BenchError> {
        let error = |e: esvo_shadow::ShadowError| failed("device", e);
        let copy = self.copy(volume)?;
        let pairs: Vec<(Ray, Steps)> =
            rays.iter().filter_map(|ray| Steps::new(ray, 1.0).ok().map(|steps| (*ray, steps))).collect();
        let mut rows = Vec::new();
        for (in_steps, coarsest) in [(false, 3), (false, MAX_LEVEL), (true, 3), (true, MAX_LEVEL)] {
            let fidelity = Fidelity { coarsest, fine_until: 0 };
            let mut row = RateRow {
                kind: kind.into(),
                tracer: format!("{} on {}", if in_steps { "steps of 1" } else { WALK }, self.name()),
                coarsest: 1 << coarsest,
                first: true,
                rays: rays.len() as u64,
                seconds: Vec::new(),
                steps: 0.0,
                different: 0,
            };
            // The first time compiles, and is not measured.
            for round in 0..=rounds {
                let traces = if in_steps {
                    self.tracer.trace_steps(&self.gpu, &copy, &pairs, fidelity).map_err(error)?
                } else {
                    self.tracer.trace(&self.gpu, &copy, rays, fidelity).map_err(error)?
                };
                if round > 0 {
                    row.seconds.push(traces.time.as_secs_f64());
                    continue;
                }
                let looks: u64 = traces.rays.iter().map(|ray| u64::from(ray.steps)).sum();
                row.steps = looks as f64 / rays.len().max(1) as f64;
                let differ = |(ray, walked): (&esvo_shadow::trace::Traced, &bool)| ray.hit.is_some() != *walked;
                row.different = traces.rays.iter().zip(walked).filter(|pair| differ(*pair)).count() as u64;
            }
            rows.push(row);
        }
        Ok(rows)
    }
}
