//! What pictures show of triangles: exact hits, surfaces and shading, with which octrees are compared.
//!
//! A displaced mesh is seen without ever being in memory as a whole. Its parts are visited view by view, the nearest first. A part is
//! diced only if a ray of some view comes into its cube before the nearest hit that it has found so far: what lies outside of the
//! pictures or behind other parts is never diced. Each ray takes from a part what it hits inside the cube, so that the result is that of
//! the whole mesh in every bit, whatever the order.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use esvo_builder::{BuildError, DisplaceOptions, DisplacedPart, Mesh, visit_displaced_parts};
use esvo_core::Picture;
use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use esvo_core::shading::{Surface, shade_triangles};
use esvo_cpu::triangles::TriangleScene;
use glam::{DMat3, DVec3};

use crate::picture_bench::cutout::{cast_solid, cast_solid_ray};
use crate::picture_bench::mesh_picture::{Looked, per_distance, shade_mesh, surfaces};

/// How far a cube reaches beyond its faces, in edges: more than rounding moves the point of a hit, less than its part is complete.
const MARGIN: f64 = 1e-6;

/// The triangles from one viewpoint, pixel by pixel.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Seen {
    /// Hits, with holes as in [`cast_solid`]. In a displaced mesh the triangles' numbers mean nothing.
    pub(crate) hits: Vec<TriangleHit>,
    /// The surfaces there, with textures at full resolution.
    pub(crate) surfaces: Vec<Surface>,
    /// The picture, with textures averaged over pixels.
    pub(crate) picture: Picture,
}

impl Seen {
    /// What rays show of a mesh, whose triangles are these.
    pub(crate) fn of(mesh: &Mesh, triangles: &TriangleScene, rays: &CameraRays) -> Self {
        let hits = cast_solid(mesh, triangles, rays);
        let (surfaces, picture) = (surfaces(mesh, rays, &hits), shade_mesh(mesh, rays, &hits));
        Self { hits, surfaces, picture }
    }
}

/// The triangles of a mesh, to be cast.
///
/// # Errors
/// Those of [`TriangleScene::new`].
pub(crate) fn sorted(mesh: &Mesh) -> Result<TriangleScene, impl std::error::Error + use<>> {
    TriangleScene::new(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect())
}

/// How much of a displaced mesh was diced.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Diced {
    /// Parts of the mesh.
    pub(crate) parts: usize,
    /// Those that were diced.
    pub(crate) diced: usize,
    /// Triangles of these; those that meet several are counted in each.
    pub(crate) triangles: usize,
}

/// What pictures show of a displaced mesh.
///
/// # Errors
/// Those of [`visit_displaced_parts`].
pub(crate) fn see_displaced(
    mesh: &Mesh,
    options: &DisplaceOptions,
    rays: &[CameraRays],
) -> Result<(Vec<Seen>, Diced), BuildError> {
    see_parts(mesh, options, rays, |_, wanted| wanted)
}

/// As [`see_displaced`]; `dice` is told of each part whether a ray needs it, and says whether it is diced.
fn see_parts(
    mesh: &Mesh,
    options: &DisplaceOptions,
    rays: &[CameraRays],
    dice: impl Fn(usize, bool) -> bool + Sync,
) -> Result<(Vec<Seen>, Diced), BuildError> {
    let views: Vec<_> = rays.iter().map(ViewOfParts::new).collect();
    let (count, diced, triangles) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    let order = |parts: &[DisplacedPart]| {
        count.store(parts.len(), Ordering::Relaxed);
        let visited: Arc<[AtomicBool]> = parts.iter().map(|_| AtomicBool::new(false)).collect();
        let mut turns: Vec<(f64, usize, usize)> = (views.iter().enumerate())
            .flat_map(|(v, view)| {
                parts.iter().enumerate().map(move |(p, part)| (Cube::of(part).distance(view.rays.origin), p, v))
            })
            .collect();
        turns.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.2, a.1).cmp(&(b.2, b.1))));
        turns.into_iter().map(|(_, p, v)| (p, Turn { part: p, view: v, visited: visited.clone() })).collect()
    };
    visit_displaced_parts(mesh, options, order, |part, turn| {
        let cube = Cube::of(part);
        let visited = &turn.visited[turn.part];
        if visited.load(Ordering::Relaxed) {
            return;
        }
        let wanted = dice(turn.part, !views[turn.view].entering(&cube).is_empty());
        // The other thread may have begun with it meanwhile.
        if !wanted || visited.swap(true, Ordering::Relaxed) {
            return;
        }
        let part = part.triangles();
        diced.fetch_add(1, Ordering::Relaxed);
        triangles.fetch_add(part.triangles.len(), Ordering::Relaxed);
        // Fails if there are no triangles: then no ray hits them.
        let Ok(scene) = sorted(&part) else { return };
        views.iter().for_each(|view| view.cast(&part, &scene, &cube));
    })?;
    let diced = Diced { parts: count.into_inner(), diced: diced.into_inner(), triangles: triangles.into_inner() };
    Ok((views.into_iter().map(ViewOfParts::finish).collect(), diced))
}

/// A part and a view, from which it is looked at.
struct Turn {
    part: usize,
    view: usize,
    visited: Arc<[AtomicBool]>,
}

/// A cube of a part, a little larger on all sides.
#[derive(Clone, Copy, Debug)]
struct Cube {
    low: DVec3,
    high: DVec3,
}

impl Cube {
    fn of(part: &DisplacedPart) -> Self {
        let [low, high] = part.cube().map(DVec3::from);
        let margin = MARGIN * (high - low).max_element();
        Self { low: low - margin, high: high + margin }
    }

    fn distance(&self, p: DVec3) -> f64 {
        p.distance(p.clamp(self.low, self.high))
    }

    fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|k| {
            let pick = |axis: usize| if k >> axis & 1 == 0 { self.low[axis] } else { self.high[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// The part of a ray in the cube; `None` if it passes.
    fn clip(&self, ray: &ExactRay) -> Option<[f64; 2]> {
        let (mut enter, mut leave) = (ray.t_min, ray.t_max);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            let (low, high) = (self.low[axis] - o, self.high[axis] - o);
            if d == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (low / d, high / d);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        (enter <= leave).then_some([enter, leave])
    }
}

/// What a view has found so far.
struct ViewOfParts<'a> {
    rays: &'a CameraRays,
    /// From directions to pixels times depth, and depth.
    to_pixels: DMat3,
    found: Mutex<Found>,
}

struct Found {
    hits: Vec<TriangleHit>,
    /// With textures at full resolution, and averaged over pixels.
    surfaces: Vec<[Surface; 2]>,
}

/// A ray that comes into a cube.
struct Entering {
    pixel: usize,
    ray: ExactRay,
}

impl<'a> ViewOfParts<'a> {
    fn new(rays: &'a CameraRays) -> Self {
        let nothing = Surface { normal: DVec3::ZERO, color: [0.0; 3] };
        let found = Found { hits: vec![TriangleHit::MISS; rays.pixels()], surfaces: vec![[nothing; 2]; rays.pixels()] };
        let to_pixels = DMat3::from_cols(rays.dx, rays.dy, rays.base).inverse();
        Self { rays, to_pixels, found: Mutex::new(found) }
    }

    fn found(&self) -> MutexGuard<'_, Found> {
        self.found.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Columns and rows of the pixels that a cube may be seen in.
    fn pixels(&self, cube: &Cube) -> [std::ops::Range<u32>; 2] {
        let (width, height) = (self.rays.width, self.rays.height);
        let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
        for corner in cube.corners() {
            let p = self.to_pixels * (corner - self.rays.origin);
            // Not in front of the eye, or nearly so: anywhere.
            if p.z.is_nan() || p.z <= 1e-9 {
                return [0..width, 0..height];
            }
            (low, high) = (low.min(p / p.z), high.max(p / p.z));
        }
        // One more on each side allows for rounding.
        let range = |low: f64, high: f64, most: u32| {
            let end = |x: f64| x.clamp(0.0, f64::from(most)) as u32;
            end(low.floor() - 1.0)..end(high.ceil() + 1.0)
        };
        [range(low.x, high.x, width), range(low.y, high.y, height)]
    }

    /// The rays that come into a cube not behind their nearest hits, each clipped to the cube.
    fn entering(&self, cube: &Cube) -> Vec<Entering> {
        let [columns, rows] = self.pixels(cube);
        let found = self.found();
        let mut entering = Vec::new();
        for y in rows {
            for x in columns.clone() {
                let (ray, pixel) = (self.rays.ray(x, y), y as usize * self.rays.width as usize + x as usize);
                let Some([t_min, t_max]) = cube.clip(&ray) else { continue };
                let hit = &found.hits[pixel];
                if hit.is_miss() || t_min <= hit.t {
                    entering.push(Entering { pixel, ray: ExactRay { t_min, t_max, ..ray } });
                }
            }
        }
        entering
    }

    /// Casts the rays that come into the cube of a part, and takes over what is nearer.
    fn cast(&self, part: &Mesh, triangles: &TriangleScene, cube: &Cube) {
        let per_distance = per_distance(self.rays);
        let mut nearer = Vec::new();
        for Entering { pixel, ray } in self.entering(cube) {
            let hit = cast_solid_ray(part, triangles, ray);
            if !hit.is_miss() {
                let point = ray.origin + ray.direction * hit.t;
                let footprints = [0.0, per_distance * point.distance(ray.origin)];
                let look = |footprint| Looked::at(part, hit.triangle as usize, point, footprint).surface();
                nearer.push((pixel, hit, footprints.map(look)));
            }
        }
        let mut found = self.found();
        for (pixel, hit, surfaces) in nearer {
            let known = &mut found.hits[pixel];
            if known.is_miss() || hit.t < known.t {
                *known = hit;
                found.surfaces[pixel] = surfaces;
            }
        }
    }

    fn finish(self) -> Seen {
        let Found { mut hits, surfaces } = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        for (pixel, hit) in hits.iter_mut().enumerate().filter(|(_, hit)| !hit.is_miss()) {
            hit.triangle = pixel as u32;
        }
        let picture = shade_triangles(self.rays, &hits, |pixel, _| surfaces[pixel as usize][1]);
        Seen { hits, surfaces: surfaces.into_iter().map(|[sharp, _]| sharp).collect(), picture }
    }
}

#[cfg(test)]
pub(crate) mod tests;
