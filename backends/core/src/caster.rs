//! The trait that every engine implements.

use std::sync::Arc;
use std::time::Duration;

use esvo_format::Octree;
use serde::{Deserialize, Serialize};

use crate::{CastError, Fans, Hit, View};

/// Casts the rays of a frame against one octree.
pub trait Caster: Send {
    /// Short name of the engine: `reference`, `cpu`, `wgpu`, `ash`.
    fn name(&self) -> &'static str;

    /// What it runs on.
    fn device(&self) -> &Device;

    /// Takes an octree: checks it, picks kernels by what it [needs](Octree::needs), uploads what casting reads.
    ///
    /// # Errors
    /// An octree that is not sound, or larger than the device takes.
    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError>;

    /// Casts one frame: `hits[y * width + x]`, the first row on top. Resizes `hits`.
    ///
    /// # Errors
    /// No octree loaded; what the device said.
    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError>;

    /// Casts one frame as [`cast`](Self::cast) does, reads nothing back, and tells how long the passes took: on a GPU by
    /// its own timestamps, on a CPU by a monotonic clock.
    ///
    /// # Errors
    /// As `cast`.
    fn time(&mut self, view: &View) -> Result<FrameTime, CastError>;

    /// Casts the rays of `fans` down to the leaves: `hits[fan * directions + direction]`. Resizes `hits`.
    ///
    /// Engines that have nothing better cast each ray as a picture of one pixel.
    ///
    /// # Errors
    /// As `cast`.
    fn cast_fans(&mut self, fans: &Fans, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        hits.clear();
        let mut one = Vec::new();
        for ray in fans.rays() {
            self.cast(&fans.view(&ray), &mut one)?;
            hits.extend_from_slice(&one);
        }
        Ok(())
    }

    /// Bytes of octree data that the device holds for casting.
    fn resident_bytes(&self) -> u64;
}

/// How long a frame took.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct FrameTime {
    /// Both passes.
    pub total: Duration,
    /// The coarse pass alone; zero without one.
    pub coarse: Duration,
}

/// What a caster runs on.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Device {
    /// Name as the driver or the processor gives it.
    pub name: String,
    /// Processor, GPU, or a Vulkan driver that runs on the processor.
    pub kind: DeviceKind,
    /// Driver and version, or instruction set and threads.
    pub detail: String,
}

/// Kind of a [`Device`].
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    /// Native code on the processor.
    Cpu,
    /// A GPU.
    Gpu,
    /// A software Vulkan driver: never to be set beside a GPU's times as if it were one.
    SoftwareGpu,
}
