//! Work for one thread, and how rays that are cast one at a time do it.

use esvo_core::{Fan, Fans, Hit, Ray, View};

use super::scene::Scene;

/// Rays of a packet.
pub(super) const LANES: usize = 16;

/// Edge of the block of pixels that a packet takes. It divides that of the blocks of the coarse pass, so that one start value
/// serves a whole packet.
pub(super) const BLOCK: usize = 4;

/// Rows of pixels of a [`Task::Band`], a multiple of [`BLOCK`].
pub(super) const BAND_ROWS: usize = 4 * BLOCK;

/// What the rays of a packet hit, lane by lane; see [`Hit`].
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub(super) t: [f32; LANES],
    pub(super) slot: [u32; LANES],
    pub(super) voxel: [u32; LANES],
    pub(super) iterations: [u32; LANES],
}

impl Found {
    /// Rays that miss.
    #[inline(always)]
    pub(super) fn missed() -> Self {
        Self { t: [Hit::MISS_T; LANES], slot: [0; LANES], voxel: [Hit::MISS_VOXEL; LANES], iterations: [0; LANES] }
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, hit: Hit) {
        (self.t[lane], self.slot[lane]) = (hit.raw_t, hit.slot);
        (self.voxel[lane], self.iterations[lane]) = (hit.voxel, hit.iterations);
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> Hit {
        Hit { raw_t: self.t[lane], slot: self.slot[lane], voxel: self.voxel[lane], iterations: self.iterations[lane] }
    }
}

/// Casts a ray: the loop of the paper's Figure 8 with some instruction set.
pub(super) trait CastRay {
    /// With `LOD`, the ray ends at small voxels.
    fn cast<const CONTOURS: bool, const LOD: bool>(&self, ray: &Ray) -> Hit;
}

/// Work for one thread.
pub(super) enum Task<'a> {
    /// The pixels of the rows from `first_row` on, a multiple of [`BLOCK`], that `hits` has room for.
    Band { view: &'a View, coarse: &'a [f32], first_row: u32, hits: &'a mut [Hit] },
    /// Row `row` of the coarse pass.
    CoarseRow { view: &'a View, row: u32, starts: &'a mut [f32] },
    /// The rays of some of the fans.
    Fans { all: &'a Fans<'a>, some: &'a [Fan], hits: &'a mut [Hit] },
    /// Rays, and a hit for each.
    Rays { rays: &'a [Ray], contours: bool, hits: &'a mut [Hit] },
}

impl Task<'_> {
    /// Does the work. Inlined, so that it is compiled for the instructions of the function that calls it.
    #[inline(always)]
    pub(super) fn run(self, scene: &Scene, caster: &impl CastRay) {
        match self {
            Self::Band { view, coarse, first_row, hits } => {
                match (scene.clips(view.contours()), scene.view_has_sizes(view)) {
                    (true, true) => band::<_, true, true>(caster, view, coarse, first_row, hits),
                    (true, false) => band::<_, true, false>(caster, view, coarse, first_row, hits),
                    (false, true) => band::<_, false, true>(caster, view, coarse, first_row, hits),
                    (false, false) => band::<_, false, false>(caster, view, coarse, first_row, hits),
                }
            }
            Self::CoarseRow { view, row, starts } => coarse_row(caster, view, row, starts),
            Self::Fans { all, some, hits } if scene.clips(all.contours) => fans::<_, true>(caster, all, some, hits),
            Self::Fans { all, some, hits } => fans::<_, false>(caster, all, some, hits),
            Self::Rays { rays, contours, hits } => match (scene.clips(contours), scene.rays_have_sizes(rays)) {
                (true, true) => list::<_, true, true>(caster, rays, hits),
                (true, false) => list::<_, true, false>(caster, rays, hits),
                (false, true) => list::<_, false, true>(caster, rays, hits),
                (false, false) => list::<_, false, false>(caster, rays, hits),
            },
        }
    }
}

/// Block by block: rays that follow each other stay together, so that what one reads is cached for the next.
#[inline(always)]
fn band<C: CastRay, const CONTOURS: bool, const LOD: bool>(
    caster: &C,
    view: &View,
    coarse: &[f32],
    first_row: u32,
    hits: &mut [Hit],
) {
    let width = view.width as usize;
    let height = hits.len() / width;
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let start = view.beam().then(|| view.beam_start(coarse, left as u32, first_row + top as u32));
            for y in top..height.min(top + BLOCK) {
                for x in left..width.min(left + BLOCK) {
                    let mut ray = view.ray(x as u32, first_row + y as u32);
                    ray.t_min = start.unwrap_or(ray.t_min);
                    hits[y * width + x] = caster.cast::<CONTOURS, LOD>(&ray);
                }
            }
        }
    }
}

#[inline(always)]
fn coarse_row(caster: &impl CastRay, view: &View, row: u32, starts: &mut [f32]) {
    for (column, start) in starts.iter_mut().enumerate() {
        let hit = caster.cast::<false, true>(&view.coarse_ray(column as u32, row));
        *start = if hit.is_miss() { 1.0 } else { view.coarse_start(hit.raw_t, hit.size()) };
    }
}

#[inline(always)]
fn fans<C: CastRay, const CONTOURS: bool>(caster: &C, all: &Fans, some: &[Fan], hits: &mut [Hit]) {
    for (fan, hits) in some.iter().zip(hits.chunks_exact_mut(all.directions.len())) {
        for (direction, hit) in all.directions.iter().zip(hits) {
            *hit = caster.cast::<CONTOURS, false>(&Fans::ray(fan, *direction));
        }
    }
}

#[inline(always)]
fn list<C: CastRay, const CONTOURS: bool, const LOD: bool>(caster: &C, rays: &[Ray], hits: &mut [Hit]) {
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = caster.cast::<CONTOURS, LOD>(ray);
    }
}

/// The mask of the first `count` lanes.
#[inline(always)]
pub(super) fn first_lanes(count: usize) -> u16 {
    ((1u32 << count) - 1) as u16
}
