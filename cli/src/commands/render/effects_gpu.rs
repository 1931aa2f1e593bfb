//! Effects on the device of the engine `wgpu`.

use esvo_device::Gpu;
use esvo_shadow::World;
use esvo_shadow::effects::{Frame, Lamp, Settings};
use esvo_shadow::gpu::{Effects, GpuVolume};
use glam::Vec3;

use crate::fail::Failure;

/// A device that has the volume.
pub(crate) struct OnGpu {
    gpu: Gpu,
    volume: GpuVolume,
    effects: Effects,
}

impl OnGpu {
    /// Opens the best device, as the engine does, and copies the volume to it.
    pub(crate) fn new(world: &World) -> Result<Self, Failure> {
        let gpu = Gpu::open(None).map_err(|e| format!("--effects: {e}"))?;
        let volume = GpuVolume::new(&gpu, world.volume()).map_err(|e| format!("--effects: {e}"))?;
        let effects = Effects::new(&gpu).map_err(|e| format!("--effects: {e}"))?;
        Ok(Self { gpu, volume, effects })
    }

    /// Its name.
    pub(crate) fn name(&self) -> &str {
        &self.gpu.about().name
    }

    /// The light of each pixel.
    pub(crate) fn light(
        &self,
        world: &World,
        frame: &Frame,
        lamps: &[Lamp],
        settings: &Settings,
    ) -> Result<Vec<Vec3>, Failure> {
        let made = self.effects.compose(&self.gpu, &self.volume, *world.grid(), frame, lamps, settings);
        Ok(made.map_err(|e| format!("--effects: {e}"))?.light)
    }
}
