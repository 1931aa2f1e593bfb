//! Casters that are broken on purpose: what the checks must catch.

use std::sync::Arc;

use esvo_format::Octree;

use crate::{CastError, Caster, Checked, Device, FLAG_CONTOURS, FrameTime, Hit, Ray, Rays, Roots, View};

/// One way to break a caster: changes a view or a list of rays before it is cast, and the hits afterwards.
pub(super) struct Way {
    pub(super) what: &'static str,
    view: fn(&mut View),
    rays: fn(&mut [Ray]),
    hits: fn(&mut [Hit]),
    /// Whether only an engine that must agree in every bit shows it.
    pub(super) only_exact: bool,
}

/// Mistakes that an engine could make in pictures.
pub(super) const WAYS: [Way; 6] = [
    Way { what: "no contours", view: |view| view.flags &= !FLAG_CONTOURS, ..NONE },
    Way { what: "rays end at larger voxels", view: |view| view.max_voxel_pixels *= 1.5, ..NONE },
    Way { what: "a shifted eye", view: |view| view.origin[0] += 1e-3, ..NONE },
    Way { what: "rays start at half the way", view: |view| view.t_near = view.t_near.max(0.5), ..NONE },
    Way { what: "one hit in another voxel", hits: |hits| first(hits, |hit| hit.voxel ^= 1), ..NONE },
    Way {
        what: "one hit off by a last bit",
        hits: |hits| first(hits, |hit| hit.raw_t = hit.raw_t.next_up()),
        only_exact: true,
        ..NONE
    },
];

/// Mistakes that an engine could make in lists of rays.
pub(super) const RAY_WAYS: [Way; 9] = [
    Way { what: "one origin for all", rays: |rays| each(rays, |ray, first| ray.origin = first.origin), ..NONE },
    Way { what: "rays start at 0", rays: |rays| each(rays, |ray, _| ray.t_min = 0.0), ..NONE },
    Way { what: "rays end at 1", rays: |rays| each(rays, |ray, _| ray.t_max = 1.0), ..NONE },
    Way { what: "no size at the origin", rays: |rays| each(rays, |ray, _| ray.size_at_origin = 0.0), ..NONE },
    Way { what: "no size per t", rays: |rays| each(rays, |ray, _| ray.size_per_t = 0.0), ..NONE },
    Way { what: "hits in another order", hits: |hits| hits.rotate_left(1), ..NONE },
    Way { what: "one hit in another voxel", hits: |hits| last(hits, |hit| hit.voxel ^= 1), ..NONE },
    Way { what: "the last ray is left out", hits: |hits| last(hits, |hit| *hit = Hit::miss(0)), ..NONE },
    Way {
        what: "one hit off by a last bit",
        hits: |hits| last(hits, |hit| hit.raw_t = hit.raw_t.next_up()),
        only_exact: true,
        ..NONE
    },
];

const NONE: Way = Way { what: "", view: |_| (), rays: |_| (), hits: |_| (), only_exact: false };

fn first(hits: &mut [Hit], change: fn(&mut Hit)) {
    hits.iter_mut().find(|hit| !hit.is_miss()).into_iter().for_each(change);
}

fn each(rays: &mut [Ray], change: fn(&mut Ray, &Ray)) {
    if let Some(first) = rays.first().copied() {
        rays.iter_mut().for_each(|ray| change(ray, &first));
    }
}

fn last(hits: &mut [Hit], change: fn(&mut Hit)) {
    hits.iter_mut().rev().find(|hit| !hit.is_miss()).into_iter().for_each(change);
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

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let rays = *self.roots().ok_or(CastError::NotLoaded)?.open(&rays)?;
        let mut changed = rays.rays.to_vec();
        (self.way.rays)(&mut changed);
        self.caster.cast_rays(&Rays { rays: &changed, ..rays }, hits)?;
        (self.way.hits)(hits);
        Ok(())
    }
}
