//! The error of the octree in a file against the triangles that it was built from: depth, colours, normals and pictures.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use esvo_builder::{BuildError, DisplaceOptions, Mesh, visit_displaced};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::shading::{Surface, shade};
use esvo_core::{Camera, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;

use crate::BenchError;
use crate::error::attributes::{AttributeError, AttributeErrors, Exact};
use crate::error::depth::{DepthError, DepthErrors, voxel_edges};
use crate::error::image::image_error;
use crate::picture_bench::cutout::cast_solid;
use crate::picture_bench::mesh_picture::{shade_mesh, surfaces};
use crate::scene::{Scene, displacement};

/// The triangles of a scene and the exact hits of its rays.
pub(crate) struct SceneTruth {
    scene: Scene,
    size: [u32; 2],
    /// The triangles of the last level that was measured: a displaced mesh has different triangles at every level.
    known: Option<(u32, Triangles)>,
}

/// What an octree is compared with.
enum SceneSurface {
    /// The triangles of the scene's mesh.
    AsItIs(TriangleScene),
    /// The mesh, displaced part by part when rays are cast.
    Displaced(DisplaceOptions),
}

/// Triangles and the hits of the rays that were cast against them.
struct Triangles {
    surface: SceneSurface,
    /// What each view shows. Its rays depend on the position of the root cube, which is the same for all octrees of a mesh.
    views: Vec<(CameraRays, Seen)>,
}

/// The triangles from one viewpoint, pixel by pixel.
struct Seen {
    hits: Vec<TriangleHit>,
    surfaces: Vec<Surface>,
    picture: Picture,
}

/// Errors of an octree whose rays end in one way.
pub(crate) struct Error {
    pub(crate) depth: DepthError,
    pub(crate) attributes: AttributeError,
    /// Mean FLIP over the views.
    pub(crate) flip: Option<f64>,
}

/// Errors of an octree when rays end at leaves only, and when they end at voxels of one pixel.
pub(crate) struct Errors {
    pub(crate) leaves: Error,
    pub(crate) pixel: Error,
}

impl Triangles {
    fn new(scene: &Scene, levels: u32) -> Result<Self, BenchError> {
        let surface = if scene.displaced {
            SceneSurface::Displaced(displacement(&scene.mesh, levels))
        } else {
            SceneSurface::AsItIs(sorted(&scene.mesh).map_err(|e| BenchError::scene(&scene.name, e.to_string()))?)
        };
        Ok(Self { surface, views: Vec::new() })
    }

    /// Casts the rays that were not cast before.
    fn cast(&mut self, scene: &Scene, mut rays: Vec<CameraRays>) -> Result<(), BenchError> {
        rays.retain(|rays| self.views.iter().all(|(known, _)| known != rays));
        if rays.is_empty() {
            return Ok(());
        }
        let seen = match &self.surface {
            SceneSurface::AsItIs(triangles) => {
                rays.iter().map(|rays| Seen::new(&scene.mesh, triangles, rays)).collect()
            }
            SceneSurface::Displaced(options) => {
                see_displaced(&scene.mesh, options, &rays).map_err(|e| BenchError::scene(&scene.name, e.to_string()))?
            }
        };
        self.views.extend(rays.into_iter().zip(seen));
        Ok(())
    }

    /// What rays that were cast show.
    fn seen(&self, rays: &CameraRays) -> Option<&Seen> {
        self.views.iter().find(|(known, _)| known == rays).map(|(_, seen)| seen)
    }
}

impl Seen {
    fn new(mesh: &Mesh, triangles: &TriangleScene, rays: &CameraRays) -> Self {
        let hits = cast_solid(mesh, triangles, rays);
        let (surfaces, picture) = (surfaces(mesh, rays, &hits), shade_mesh(mesh, rays, &hits));
        Self { hits, surfaces, picture }
    }

    /// Takes over the pixels in which other triangles are nearer.
    fn add(&mut self, other: Self) {
        for (pixel, hit) in other.hits.into_iter().enumerate() {
            let known = &mut self.hits[pixel];
            if !hit.is_miss() && (known.is_miss() || hit.t < known.t) {
                *known = hit;
                self.surfaces[pixel] = other.surfaces[pixel];
                let bytes = 3 * pixel..3 * pixel + 3;
                self.picture.rgb8[bytes.clone()].copy_from_slice(&other.picture.rgb8[bytes]);
            }
        }
    }
}

fn sorted(mesh: &Mesh) -> Result<TriangleScene, impl std::error::Error + use<>> {
    TriangleScene::new(mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect())
}

/// What pictures show of a displaced mesh, with holes as in [`cast_solid`]. Part by part: on deep levels the mesh does not fit into
/// memory as a whole. The triangles' numbers are those in some part.
fn see_displaced(mesh: &Mesh, options: &DisplaceOptions, rays: &[CameraRays]) -> Result<Vec<Seen>, BuildError> {
    let found: Vec<Mutex<Option<Seen>>> = rays.iter().map(|_| Mutex::new(None)).collect();
    visit_displaced(mesh, options, &|part| {
        // Fails if none of the triangles has an area: then no ray hits them.
        let Ok(triangles) = sorted(part) else { return };
        for (rays, found) in rays.iter().zip(&found) {
            let of_part = Seen::new(part, &triangles, rays);
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            match &mut *found {
                Some(found) => found.add(of_part),
                None => *found = Some(of_part),
            }
        }
    })?;
    let nothing = || BuildError::Mesh("none of its triangles has an area; a mesh needs at least one".into());
    found
        .into_iter()
        .map(|seen| seen.into_inner().unwrap_or_else(PoisonError::into_inner).ok_or_else(nothing))
        .collect()
}

impl SceneTruth {
    /// The triangles of a scene; `size` is the size of its pictures.
    pub(crate) fn new(scene: Scene, size: [u32; 2]) -> Self {
        Self { scene, size, known: None }
    }

    /// Casts every view of the scene against the octree of `levels` levels in a file, with its contours if it has any.
    pub(crate) fn errors(&mut self, file: &Path, levels: u32) -> Result<Errors, BenchError> {
        let scene = &self.scene;
        let failed = |what: String| BenchError::scene(&scene.name, what);
        let usable = |(known, _): &(u32, Triangles)| !scene.displaced || *known == levels;
        let (_, triangles) = match self.known.take().filter(usable) {
            Some(known) => self.known.insert(known),
            None => self.known.insert((levels, Triangles::new(scene, levels)?)),
        };
        let octree = Arc::new(Octree::open(file).map_err(|e| failed(e.to_string()))?);
        octree.sound().map_err(|e| failed(e.to_string()))?;
        let cast = |e: esvo_core::CastError| failed(e.to_string());
        let mut caster = CpuCaster::new(None).map_err(cast)?;
        caster.load(&octree).map_err(cast)?;
        let (to_mesh, root) = (octree.octree_to_mesh(0), octree.objects()[0].root_slot as u32);
        let edges = voxel_edges(&octree, 0);
        let view_of = |camera: &Camera, max_voxel_pixels| {
            let options = CastOptions { contours: true, beam: false, max_voxel_pixels };
            View::new(camera, to_mesh, root, self.size.into(), &options)
        };
        // The rays of the views, as the casters use them: rounding in the camera is not an error of the octree.
        let rays_of = |view: &_| Ok(CameraRays::of_view(&view_of(view, 0.0)?, to_mesh));
        let rays: Result<Vec<CameraRays>, _> = scene.views.iter().map(|view| rays_of(&view.camera)).collect();
        triangles.cast(scene, rays.map_err(cast)?)?;
        let mut hits = Vec::new();
        let [leaves, pixel] = [0.0, 1.0].map(|max_voxel_pixels| {
            let mut depth = DepthErrors::default();
            let mut attributes = AttributeErrors::default();
            let mut flips = Vec::new();
            for view in &scene.views {
                let view = view_of(&view.camera, max_voxel_pixels)?;
                caster.cast(&view, &mut hits)?;
                let rays = CameraRays::of_view(&view, to_mesh);
                let Some(seen) = triangles.seen(&rays) else { continue };
                depth.add(&rays, &seen.hits, &hits, edges);
                let exact = Exact { hits: &seen.hits, surfaces: &seen.surfaces };
                attributes.add(&octree, &view, exact, &hits, edges.finest, f64::from(max_voxel_pixels));
                // Where voxels are smaller than a pixel, pictures of leaves show noise.
                if max_voxel_pixels > 0.0 {
                    flips.extend(image_error(&seen.picture, &shade(&octree, &view, &hits)).map(|e| e.flip));
                }
            }
            let flip = (!flips.is_empty()).then(|| flips.iter().sum::<f64>() / flips.len() as f64);
            Ok(Error { depth: depth.finish(), attributes: attributes.finish(), flip })
        });
        Ok(Errors { leaves: leaves.map_err(cast)?, pixel: pixel.map_err(cast)? })
    }
}

#[cfg(test)]
mod tests {
    use esvo_builder::{HeightMap, LinearTexture, UvTransform, displace};

    use super::*;

    /// A square with bumps, seen from above.
    #[test]
    fn parts_are_hit_where_the_whole_mesh_is() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let texels = (0..64u32 * 64).map(|i| [(i.wrapping_mul(2_654_435_761) >> 16) as u16]).collect();
        let texture = Arc::new(LinearTexture::new(64, 64, texels).unwrap());
        let map = HeightMap { texture, amplitude: 0.05, bias: 0.0, uv_transform: UvTransform::IDENTITY };
        let mesh = Mesh {
            positions: corners.map(|[x, y]| [x, y, 0.2 * x]).to_vec(),
            uvs: corners.map(|[x, y]| [x as f32, y as f32]).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_materials: vec![0; 2],
            materials: vec![esvo_builder::Material { height_map: Some(map), ..Default::default() }],
            ..Mesh::default()
        };
        let options = DisplaceOptions { max_triangles: 2000, ..DisplaceOptions::for_levels(&mesh, 8, 1.0) };
        let (eye, forward, up) = ([0.4, 0.6, 3.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
        let camera = Camera { eye, forward, up, fov_degrees: 30.0, near: 0.1, far: 10.0 };
        let rays = CameraRays::new(&camera, (64, 64)).unwrap();
        let whole = displace(&mesh, &DisplaceOptions { max_triangles: 1 << 24, ..options }).unwrap();
        let expected = cast_solid(&whole, &sorted(&whole).unwrap(), &rays);
        let differing = |hits: &[TriangleHit]| {
            let differs =
                |(a, b): &(&TriangleHit, &TriangleHit)| a.is_miss() != b.is_miss() || (a.t - b.t).abs() > 1e-12;
            hits.iter().zip(&expected).filter(differs).count()
        };
        assert!(expected.iter().filter(|hit| !hit.is_miss()).count() > 1500);
        assert_eq!(differing(&see_displaced(&mesh, &options, &[rays]).unwrap()[0].hits), 0);
        let coarser = DisplaceOptions { cell: 3.0 * options.cell, ..options };
        assert!(differing(&see_displaced(&mesh, &coarser, &[rays]).unwrap()[0].hits) > 1000);
    }
}
