//! Checking answers before timing: every caster against the reference caster.

use std::sync::Arc;

use esvo_core::exact::CameraRays;
use esvo_core::gpu::triangles::TriangleCaster;
use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::{Allowed, Comparison};
use esvo_core::{CastError, Caster, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;
use serde::{Deserialize, Serialize};

/// How the answers of a caster compare with the reference caster's.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Agreement {
    /// Number of pixels compared.
    pub pixels: u64,
    /// Pixels with another voxel than the reference, including pixels that hit in only one of the two.
    pub different_voxel: u64,
    /// Largest difference of `t` among the other pixels; `t` = 1 is the far plane.
    pub largest_t_difference: f64,
    /// Number of pictures whose number of pixels differs from the reference's.
    pub other_size: u64,
    /// The allowed difference.
    pub allowed: Allowed,
}

impl Agreement {
    /// The result of a comparison.
    pub fn new(found: Comparison, allowed: Allowed) -> Self {
        Self {
            pixels: found.rays,
            different_voxel: found.mismatches(),
            largest_t_difference: found.max_t_difference.into(),
            other_size: found.other_size,
            allowed,
        }
    }

    /// Different pixels over all pixels.
    pub fn share(&self) -> f64 {
        self.different_voxel as f64 / self.pixels.max(1) as f64
    }

    /// Whether pixels were compared and the differences are allowed.
    pub fn passed(&self) -> bool {
        self.pixels > 0
            && self.other_size == 0
            && self.share() <= self.allowed.share
            && self.largest_t_difference <= self.allowed.t
    }
}

/// Casts every view with `caster`, which has loaded `octree`, and with the reference caster.
///
/// # Errors
/// Either caster's.
pub fn check(
    caster: &mut dyn Caster,
    octree: &Arc<Octree>,
    views: &[View],
    allowed: Allowed,
) -> Result<Agreement, CastError> {
    let mut reference = ReferenceCaster::default();
    reference.load(octree)?;
    let (mut expected, mut found) = (Vec::new(), Vec::new());
    let mut all = Comparison::default();
    for view in views {
        reference.cast(view, &mut expected)?;
        found.clear();
        caster.cast(view, &mut found)?;
        all = all.and(Comparison::of(&expected, &found));
    }
    Ok(Agreement::new(all, allowed))
}

/// Casts every picture with a GPU's triangle caster, which has loaded the triangles of `scene`, and with the exact caster. Returns also
/// for how many pixels the processor decided.
///
/// # Errors
/// The caster's.
pub fn check_triangles(
    caster: &mut dyn TriangleCaster,
    scene: &TriangleScene,
    pictures: &[CameraRays],
) -> Result<(Agreement, u64), CastError> {
    let mut all = Agreement { allowed: Allowed::EXACT, ..Agreement::default() };
    let mut undecided = 0;
    let mut records = Vec::new();
    for rays in pictures {
        caster.cast(rays, &mut records)?;
        let found = scene.decide(rays, &records);
        undecided += found.undecided as u64;
        all.pixels += rays.pixels() as u64;
        for (found, exact) in found.hits.iter().zip(&scene.cast_exact(rays)) {
            if found.triangle != exact.triangle {
                all.different_voxel += 1;
            } else {
                all.largest_t_difference = all.largest_t_difference.max((found.t - exact.t).abs());
            }
        }
    }
    Ok((all, undecided))
}
