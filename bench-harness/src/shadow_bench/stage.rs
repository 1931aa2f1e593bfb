//! A scene as the octree caster sees it, and the exact answers to its rays.

use std::sync::Arc;

use esvo_builder::BuildSettings;
use esvo_core::exact::ExactRay;
use esvo_core::reference::cast_ray;
use esvo_core::{Camera, CastOptions, Caster, Nearest, Object, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;
use esvo_shadow::effects::{Eye, Frame, Lamp, Obstacles, Offset, Query};
use esvo_shadow::{Grid, Mesh, Pose, Shape, World};
use glam::{DVec3, Vec3};

use crate::BenchError;
use crate::scene::{NamedView, Scene};

/// An error of a part of this benchmark, or of a scene.
pub(super) fn failed(what: &str, error: impl ToString) -> BenchError {
    BenchError::option(what, error)
}

/// Every scene is taken to be so many metres long.
const METRES: f64 = 40.0;

/// A scene with its exact answers.
pub(super) struct Stage {
    pub(super) scene: Scene,
    pub(super) octree: Arc<Octree>,
    pub(super) triangles: TriangleScene,
    /// Units of the mesh in a metre.
    pub(super) unit: f64,
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Stage {
    pub(super) fn new(scene: Scene, levels: u32) -> Result<Self, BenchError> {
        let error = |e: &dyn ToString| failed(&scene.name, e.to_string());
        let settings = BuildSettings { levels, ..scene.settings };
        let built = esvo_builder::build(&scene.mesh, &settings, &|_| ()).map_err(|e| error(&e))?;
        let mesh = &scene.mesh;
        let corner = |&vertex: &u32| mesh.positions[vertex as usize];
        let triangles = mesh.triangles.iter().map(|triangle| [0, 1, 2].map(|i| corner(&triangle[i]))).collect();
        let triangles = TriangleScene::new(triangles).map_err(|e| error(&e))?;
        let (low, high) = mesh.bounds().ok_or_else(|| error(&"the mesh is empty"))?;
        let (low, high) = (DVec3::from(low), DVec3::from(high));
        let unit = (high - low).max_element() / METRES;
        Ok(Self { octree: Arc::new(built.octree), triangles, unit, low, high, scene })
    }

    pub(super) fn view(&self) -> &NamedView {
        &self.scene.views[0]
    }

    pub(super) fn object(&self) -> Object<'_> {
        Object::of(&self.octree, 0)
    }

    /// Edge of the finest voxels, in units of the mesh.
    pub(super) fn leaf(&self, levels: u32) -> f64 {
        let object = self.object();
        (object.from_cast(DVec3::new(2.0, 1.0, 1.0)) - object.from_cast(DVec3::ONE)).length()
            / f64::from(1u32 << levels)
    }

    pub(super) fn in_octree(&self, levels: u32) -> InOctree<'_> {
        InOctree { object: self.object(), leaf: self.leaf(levels) as f32 }
    }

    pub(super) fn in_triangles(&self, levels: u32) -> InTriangles<'_> {
        InTriangles { triangles: &self.triangles, leaf: self.leaf(levels) as f32 }
    }

    /// A grid of voxels with this edge around the scene, and how many it has.
    pub(super) fn grid(&self, centimetres: f64) -> (Grid, [u32; 3]) {
        let voxel = centimetres * 0.01 * self.unit;
        // A border of two voxels, and corners that do not fall onto planes between voxels.
        let grid = Grid { origin: self.low - voxel * 2.3, voxel };
        (grid, ((self.high - grid.origin) / voxel + 2.0).ceil().to_array().map(|n| n as u32))
    }

    /// The world of the scene in voxels with this edge.
    pub(super) fn world(&self, centimetres: f64, mips: u32) -> Result<World, BenchError> {
        let error = |e: esvo_shadow::ShadowError| failed(&self.scene.name, e);
        let (grid, voxels) = self.grid(centimetres);
        let mut world = World::new(grid, voxels, mips).map_err(error)?;
        let mesh = &self.scene.mesh;
        let corners = mesh.positions.iter().map(|corner| DVec3::from(*corner)).collect();
        let shape = Mesh::surface(corners, mesh.triangles.clone()).map_err(error)?;
        world.add_fixed(&Shape::Mesh(shape), &Pose::IDENTITY).map_err(error)?;
        world.update(0);
        Ok(world)
    }

    /// The first surfaces of the scene's first viewpoint.
    pub(super) fn frame(&self, size: (u32, u32)) -> Result<Frame, BenchError> {
        frame(&self.octree, &[self.object()], &self.view().camera, size).map_err(|e| failed(&self.scene.name, e))
    }

    /// The same, seen among the triangles: their normals, and the colours of their materials without textures.
    pub(super) fn frame_of_triangles(&self, size: (u32, u32)) -> Result<Frame, BenchError> {
        let eye = Eye::of(&self.view().camera, size).map_err(|e| failed(&self.scene.name, e))?;
        let mesh = &self.scene.mesh;
        let meet = |from: Vec3, direction: Vec3| {
            let (origin, direction) = (from.as_dvec3(), direction.as_dvec3());
            let hit = self.triangles.cast_exact_ray(&ExactRay { origin, direction, t_min: 0.0, t_max: f64::INFINITY });
            if hit.is_miss() {
                return None;
            }
            let triangle = hit.triangle as usize;
            let [a, b, c] = mesh.triangles[triangle].map(|vertex| DVec3::from(mesh.positions[vertex as usize]));
            let normal = (b - a).cross(c - a).normalize_or(-direction).as_vec3();
            let material =
                mesh.triangle_materials.get(triangle).and_then(|&number| mesh.materials.get(number as usize));
            let color = material.map_or(Vec3::splat(0.8), |material| Vec3::from_slice(&material.base_color));
            Some((hit.t as f32, normal, color))
        };
        Ok(Frame::of_rays(eye, &meet))
    }

    /// A lamp that the eye sees: a few metres ahead of it, as high as nothing is in the way.
    pub(super) fn lamp(&self, frame: &Frame, obstacles: &impl Obstacles, radius: f64) -> Lamp {
        let (eye, unit) = (&frame.eye, self.unit as f32);
        let tries = [(3.0, 2.0, 9.0), (-3.0, 2.0, 9.0), (1.0, 2.0, 6.0), (1.0, 1.0, 4.0), (0.5, 0.5, 2.0)];
        let place = |(right, up, ahead): (f32, f32, f32)| {
            eye.position + (eye.right * right + eye.up * up + eye.forward * ahead) * unit
        };
        let seen = |place: &Vec3| {
            let way = *place - eye.position;
            let query = Query {
                from: eye.position,
                normal: Vec3::ZERO,
                direction: way.normalize(),
                length: way.length() * 1.1,
            };
            !obstacles.blocked(&[query])[0]
        };
        let position = tries.map(place).into_iter().find(seen).unwrap_or(eye.position);
        Lamp {
            position,
            radius: (radius * self.unit) as f32,
            color: Vec3::splat(30.0 * unit * unit),
            reach: f32::INFINITY,
            cone: None,
        }
    }
}

/// The first surfaces that a camera sees of placed objects.
pub(super) fn frame(
    octree: &Arc<Octree>,
    objects: &[Object],
    camera: &Camera,
    size: (u32, u32),
) -> Result<Frame, esvo_core::CastError> {
    let options = CastOptions { contours: true, beam: false, max_voxel_pixels: 0.0 };
    let views: Vec<View> =
        objects.iter().map(|object| object.view(camera, size, &options)).collect::<Result<_, _>>()?;
    let mut caster = CpuCaster::new(None)?;
    caster.load(octree)?;
    let nearest = Nearest::cast(&mut caster, &views)?;
    Ok(Frame::of_hits(Eye::of(camera, size)?, objects, &views, &nearest))
}

/// Where a query begins so that it does not meet what it begins on: as in a volume, but with the octree's finest voxels.
fn begin(query: &Query, leaf: f32) -> (Vec3, f32) {
    let (along, above) = Offset::SAFE.of(query.normal, query.direction);
    (query.from + query.normal * (above * leaf), along * leaf)
}

/// The octree, exactly.
pub(super) struct InOctree<'a> {
    pub(super) object: Object<'a>,
    leaf: f32,
}

impl InOctree<'_> {
    /// The ray of a query.
    pub(super) fn ray(&self, query: &Query) -> esvo_core::Ray {
        let (from, along) = begin(query, self.leaf);
        self.object.ray(
            from.as_dvec3(),
            query.direction.as_dvec3(),
            f64::from(along)..f64::from(query.length.max(along)),
        )
    }
}

impl Obstacles for InOctree<'_> {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        self.first(queries).iter().map(Option::is_some).collect()
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        let edge = (self.object.from_cast(DVec3::new(2.0, 1.0, 1.0)) - self.object.from_cast(DVec3::ONE)).length();
        let first = |query: &Query| {
            let hit = cast_ray(self.object.octree(), self.object.root(), &self.ray(query), true);
            hit.t().map(|t| (f64::from(t) * edge) as f32)
        };
        queries.iter().map(first).collect()
    }
}

/// The triangles, exactly.
pub(super) struct InTriangles<'a> {
    triangles: &'a TriangleScene,
    leaf: f32,
}

impl Obstacles for InTriangles<'_> {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        self.first(queries).iter().map(Option::is_some).collect()
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        let first = |query: &Query| {
            let (from, along) = begin(query, self.leaf);
            let ray = ExactRay {
                origin: from.as_dvec3(),
                direction: query.direction.as_dvec3(),
                t_min: f64::from(along),
                t_max: f64::from(query.length.max(along)),
            };
            let hit = self.triangles.cast_exact_ray(&ray);
            (!hit.is_miss()).then_some(hit.t as f32)
        };
        queries.iter().map(first).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    /// Surfaces from triangles lie where the octree has them, with normals towards the eye.
    #[test]
    fn surfaces_from_triangles_are_those_of_the_octree() {
        let manifest = scene::manifest(None).unwrap();
        let entry = scene::entry(&manifest, "fairy").unwrap();
        let levels = 9;
        let stage = Stage::new(Scene::load(entry, None, 1).unwrap(), levels).unwrap();
        let (octree, triangles) = (stage.frame((60, 40)).unwrap(), stage.frame_of_triangles((60, 40)).unwrap());
        let leaf = stage.leaf(levels) as f32;
        let (mut both, mut near, mut same) = (0, 0, 0);
        for (a, b) in octree.surfaces.iter().zip(&triangles.surfaces) {
            let (Some(a), Some(b)) = (a, b) else { continue };
            both += 1;
            // Along a surface that is seen at a flat angle they may be far apart.
            let off = (a.position - b.position).dot(b.normal).abs();
            near += usize::from(off < 10.0 * leaf);
            same += usize::from(off < leaf && a.normal.dot(b.normal) > 0.5);
            assert!((b.normal.length() - 1.0).abs() < 1e-4 && b.normal.dot(b.position - octree.eye.position) <= 0.0);
        }
        // The rest are blades of grass, of which a ray meets one or the next.
        assert!(both > 1500 && near * 50 > both * 49 && same * 3 > both * 2, "{near} near and {same} equal of {both}");
    }
}
