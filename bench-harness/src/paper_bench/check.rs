//! Answers before times: every caster against the reference caster.

use std::sync::Arc;

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::{Allowed, Comparison};
use esvo_core::{CastError, Caster, View};
use esvo_format::Octree;
use serde::{Deserialize, Serialize};

/// How the answers of a caster compare with the reference caster's.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Agreement {
    /// Pixels that were compared.
    pub pixels: u64,
    /// Pixels that name another voxel, or none where the reference names one, or the other way round.
    pub different_voxel: u64,
    /// Largest difference of the distance `t` among the others, as a fraction of the far plane's.
    pub largest_t_difference: f64,
    /// Pictures that do not have the reference's number of pixels.
    pub other_size: u64,
    /// What may differ.
    pub allowed: Allowed,
}

impl Agreement {
    /// What a comparison found.
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

    /// Whether something was compared and no more differs than may.
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
