//! From pictures, fans and lists of rays to packets of rays: the same for every instruction set.

use esvo_core::{Fan, Fans, Hit, Ray, View};

use super::scene::Scene;

/// Rays of a packet.
pub(super) const LANES: usize = 16;

/// Edge of the block of pixels that a packet takes. It is the block of the coarse pass too, so that one start value serves
/// a whole packet.
pub(super) const BLOCK: usize = esvo_core::BEAM_BLOCK as usize;

/// Rows of pixels of a [`Task::Band`], a multiple of [`BLOCK`].
pub(super) const BAND_ROWS: usize = 4 * BLOCK;

/// A number of a [`Packet`]: an `f32` that all lanes share, or an array with one for each lane.
pub(super) trait Number: Copy {
    fn lanes(&self) -> Lanes<'_>;
}

/// The lanes of a [`Number`]. Which of the two it is, is known when a caster is compiled.
pub(super) enum Lanes<'a> {
    All(f32),
    Each(&'a [f32; LANES]),
}

impl Lanes<'_> {
    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> f32 {
        match self {
            Self::All(number) => *number,
            Self::Each(numbers) => numbers[lane],
        }
    }
}

impl Number for f32 {
    #[inline(always)]
    fn lanes(&self) -> Lanes<'_> {
        Lanes::All(*self)
    }
}

impl Number for [f32; LANES] {
    #[inline(always)]
    fn lanes(&self) -> Lanes<'_> {
        Lanes::Each(self)
    }
}

/// Rays, lane by lane. Those of a picture or a fan share their origin, span and size: `N` is `f32`.
pub(super) struct Packet<N> {
    pub(super) origin: [N; 3],
    pub(super) direction: [[f32; LANES]; 3],
    pub(super) t_min: N,
    pub(super) t_max: N,
    /// At `t`, voxels whose edge is at most `size_at_origin + t * size_per_t` end a ray.
    pub(super) size_at_origin: N,
    pub(super) size_per_t: N,
    /// Bit `i`: lane `i` has a ray, which is [cast](Ray::is_cast) if origin and direction are.
    pub(super) active: u16,
}

/// What the rays of a packet hit, lane by lane; see [`Hit`].
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub(super) t: [f32; LANES],
    pub(super) slot: [u32; LANES],
    pub(super) voxel: [u32; LANES],
    pub(super) iterations: [u32; LANES],
}

impl Found {
    /// Without contents.
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { t: [0.0; LANES], slot: [0; LANES], voxel: [0; LANES], iterations: [0; LANES] }
    }

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

/// Casts the rays of packets: the loop of the paper's Figure 8 with some instruction set.
pub(super) trait CastPacket {
    /// Casts the active lanes; what the others find is not read. With `LOD`, rays end at small voxels.
    fn cast<N: Number, const CONTOURS: bool, const LOD: bool>(&self, packet: &Packet<N>) -> Found;
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
    pub(super) fn run(self, scene: &Scene, caster: &impl CastPacket) {
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

#[inline(always)]
fn band<C: CastPacket, const CONTOURS: bool, const LOD: bool>(
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
            let mut packet = Packet {
                origin: view.origin,
                direction: [[0.0; LANES]; 3],
                t_min: view.t_near,
                t_max: 1.0,
                size_at_origin: 0.0,
                size_per_t: view.pixel_size * view.max_voxel_pixels,
                active: 0,
            };
            if view.beam() {
                packet.t_min = view.beam_start(coarse, left as u32, first_row + top as u32);
            }
            for lane in 0..LANES {
                let (x, y) = (left + lane % BLOCK, top + lane / BLOCK);
                if x < width && y < height {
                    packet.active |= 1 << lane;
                }
                let direction = view.direction(x as f32 + 0.5, (first_row as usize + y) as f32 + 0.5);
                for axis in 0..3 {
                    packet.direction[axis][lane] = direction[axis];
                }
            }
            let found = caster.cast::<_, CONTOURS, LOD>(&packet);
            for lane in (0..LANES).filter(|lane| packet.active >> lane & 1 != 0) {
                hits[(top + lane / BLOCK) * width + left + lane % BLOCK] = found.get(lane);
            }
        }
    }
}

#[inline(always)]
fn coarse_row(caster: &impl CastPacket, view: &View, row: u32, starts: &mut [f32]) {
    for (k, starts) in starts.chunks_mut(LANES).enumerate() {
        let first = view.coarse_ray((k * LANES) as u32, row);
        let mut packet = Packet {
            origin: view.origin,
            direction: [[0.0; LANES]; 3],
            t_min: first.t_min,
            t_max: first.t_max,
            size_at_origin: 0.0,
            size_per_t: first.size_per_t,
            active: first_lanes(starts.len()),
        };
        for lane in 0..LANES {
            let direction = view.coarse_ray((k * LANES + lane) as u32, row).direction;
            for axis in 0..3 {
                packet.direction[axis][lane] = direction[axis];
            }
        }
        let found = caster.cast::<_, false, true>(&packet);
        for (lane, start) in starts.iter_mut().enumerate() {
            let hit = found.get(lane);
            *start = if hit.is_miss() { 1.0 } else { view.coarse_start(hit.raw_t, hit.size()) };
        }
    }
}

#[inline(always)]
fn fans<C: CastPacket, const CONTOURS: bool>(caster: &C, all: &Fans, some: &[Fan], hits: &mut [Hit]) {
    for (fan, hits) in some.iter().zip(hits.chunks_exact_mut(all.directions.len())) {
        for (directions, hits) in all.directions.chunks(LANES).zip(hits.chunks_mut(LANES)) {
            let mut packet = Packet {
                origin: fan.origin.into(),
                direction: [[0.0; LANES]; 3],
                t_min: 0.0,
                t_max: 1.0,
                size_at_origin: 0.0,
                size_per_t: 0.0,
                active: first_lanes(hits.len()),
            };
            for (lane, direction) in directions.iter().enumerate() {
                let ray = Fans::ray(fan, *direction);
                for axis in 0..3 {
                    packet.direction[axis][lane] = ray.direction[axis];
                }
            }
            let found = caster.cast::<_, CONTOURS, false>(&packet);
            for (lane, hit) in hits.iter_mut().enumerate() {
                *hit = found.get(lane);
            }
        }
    }
}

#[inline(always)]
fn list<C: CastPacket, const CONTOURS: bool, const LOD: bool>(caster: &C, rays: &[Ray], hits: &mut [Hit]) {
    const NONE: [f32; LANES] = [0.0; LANES];
    for (rays, hits) in rays.chunks(LANES).zip(hits.chunks_mut(LANES)) {
        let mut packet = Packet {
            origin: [NONE; 3],
            direction: [NONE; 3],
            t_min: NONE,
            t_max: NONE,
            size_at_origin: NONE,
            size_per_t: NONE,
            active: 0,
        };
        for (lane, ray) in rays.iter().enumerate() {
            packet.active |= u16::from(ray.is_cast()) << lane;
            for axis in 0..3 {
                packet.origin[axis][lane] = ray.origin[axis];
                packet.direction[axis][lane] = ray.direction[axis];
            }
            (packet.t_min[lane], packet.t_max[lane]) = (ray.t_min, ray.t_max);
            (packet.size_at_origin[lane], packet.size_per_t[lane]) = (ray.size_at_origin, ray.size_per_t);
        }
        let found = caster.cast::<_, CONTOURS, LOD>(&packet);
        for (lane, hit) in hits.iter_mut().enumerate() {
            *hit = if packet.active >> lane & 1 != 0 { found.get(lane) } else { Hit::miss(0) };
        }
    }
}

/// The mask of the first `count` lanes.
#[inline(always)]
pub(super) fn first_lanes(count: usize) -> u16 {
    ((1u32 << count) - 1) as u16
}
