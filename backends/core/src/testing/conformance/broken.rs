//! Casters that are broken on purpose: what the checks must catch.

use std::sync::Arc;

use esvo_format::Octree;

use crate::{CastError, Caster, Checked, Device, FLAG_CONTOURS, FrameTime, Hit, Roots, View};

/// One way to break a caster: changes a view before it is cast, and the hits afterwards.
pub(super) struct Way {
    pub(super) what: &'static str,
    pub(super) view: fn(&mut View),
    pub(super) hits: fn(&mut [Hit]),
    /// Whether only an engine that must agree in every bit shows it.
    pub(super) only_exact: bool,
}

/// Mistakes that an engine could make.
pub(super) const WAYS: [Way; 6] = [
    Way { what: "no contours", view: |view| view.flags &= !FLAG_CONTOURS, ..NONE },
    Way { what: "rays end at larger voxels", view: |view| view.max_voxel_pixels *= 1.5, ..NONE },
    Way { what: "a shifted eye", view: |view| view.origin[0] += 1e-3, ..NONE },
    Way { what: "rays start at half the way", view: |view| view.t_near = view.t_near.max(0.5), ..NONE },
    Way { what: "one hit in another voxel", hits: |hits| first(hits, |hit| hit.voxel ^= 1), ..NONE },
    Way {
        what: "one hit off by a last bit",
        hits: |hits| first(hits, |hit| hit.t = hit.t.next_up()),
        only_exact: true,
        ..NONE
    },
];

const NONE: Way = Way { what: "", view: |_| (), hits: |_| (), only_exact: false };

fn first(hits: &mut [Hit], change: fn(&mut Hit)) {
    hits.iter_mut().find(|hit| !hit.is_miss()).into_iter().for_each(change);
}

/// A caster that works, broken in one way.
pub(super) struct Broken<'a> {
    pub(super) caster: Box<dyn Caster>,
    pub(super) way: &'a Way,
}

impl Caster for Broken<'_> {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn device(&self) -> &Device {
        self.caster.device()
    }

    fn resident_bytes(&self) -> u64 {
        self.caster.resident_bytes()
    }

    fn roots(&self) -> Option<&Roots> {
        self.caster.roots()
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.caster.load_checked(octree, roots)
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let mut view = *self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        (self.way.view)(&mut view);
        self.caster.cast(&view, hits)?;
        (self.way.hits)(hits);
        Ok(())
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        self.caster.time_checked(view)
    }
}
