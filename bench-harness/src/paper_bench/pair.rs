//! The two octrees of a scene at one level, and the casters of an engine that hold them and its triangles.

use std::sync::Arc;

use esvo_core::Caster;
use esvo_core::gpu::triangles::TriangleCaster;
use esvo_engines::EngineId;
use esvo_format::Octree;

use crate::paper_bench::matrix::Variant;

/// Picture size for checks and errors.
pub const CHECK_SIZE: [u32; 2] = [512, 384];
/// Size of the pictures that are written.
pub const PICTURE_SIZE: [u32; 2] = [1024, 768];

/// The casters of one engine, so that two octrees and the triangles can be timed in turn.
pub(crate) struct EnginePair {
    pub(crate) backend: EngineId,
    pub(crate) cubical: Box<dyn Caster>,
    pub(crate) contours: Box<dyn Caster>,
    /// The engine's triangle caster, with the scene's triangles; `None` if it has none, or if it could not load them.
    pub(crate) triangles: Option<Box<dyn TriangleCaster>>,
}

impl EnginePair {
    /// The caster that holds the octree of a variant.
    pub(crate) fn caster(&mut self, variant: Variant) -> &mut dyn Caster {
        if variant == Variant::Cubical { &mut *self.cubical } else { &mut *self.contours }
    }
}

/// The octrees of a scene at one level.
pub(crate) struct OctreePair {
    pub(crate) levels: u32,
    pub(crate) cubical: Option<Arc<Octree>>,
    pub(crate) contours: Option<Arc<Octree>>,
}

impl OctreePair {
    /// The octree of a variant.
    pub(crate) fn of(&self, variant: Variant) -> Option<&Arc<Octree>> {
        match variant {
            Variant::Triangles => None,
            Variant::Cubical => self.cubical.as_ref(),
            Variant::Contours | Variant::Beam => self.contours.as_ref(),
        }
    }

    /// Bytes of both images.
    pub(crate) fn bytes(&self) -> u64 {
        let octrees = [&self.cubical, &self.contours].into_iter().flatten();
        octrees.map(|octree| size_of_val(octree.slots()) as u64).sum()
    }
}
