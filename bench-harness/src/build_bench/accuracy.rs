//! The error of the octree in a file against the triangles that it was built from: depth, colours, normals and pictures.

use std::path::Path;
use std::sync::Arc;

use esvo_core::exact::CameraRays;
use esvo_core::shading::shade;
use esvo_core::{Camera, CastOptions, Caster, View};
use esvo_cpu::CpuCaster;
use esvo_format::Octree;

use crate::BenchError;
use crate::error::attributes::{AttributeError, AttributeErrors, Exact};
use crate::error::depth::{DepthError, DepthErrors, voxel_edges};
use crate::error::image::image_error;
use crate::scene::{Scene, displacement};
use crate::scene_triangles::SceneTriangles;
use crate::seen::Seen;

/// The triangles of a scene and the exact hits of its rays.
pub(crate) struct SceneTruth {
    scene: Scene,
    size: [u32; 2],
    /// The triangles of the last level that was measured: a displaced mesh has different triangles at every level.
    known: Option<(u32, Triangles)>,
}

/// Triangles and the hits of the rays that were cast against them.
struct Triangles {
    surface: SceneTriangles,
    /// What each view shows. Its rays depend on the position of the root cube, which is the same for all octrees of a mesh.
    views: Vec<(CameraRays, Seen)>,
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
            // Always part by part: pictures need few of the triangles.
            SceneTriangles::InParts(displacement(&scene.mesh, levels))
        } else {
            SceneTriangles::new(&scene.name, &scene.mesh, None)?
        };
        Ok(Self { surface, views: Vec::new() })
    }

    /// Casts the rays that were not cast before.
    fn cast(&mut self, scene: &Scene, mut rays: Vec<CameraRays>) -> Result<(), BenchError> {
        rays.retain(|rays| self.views.iter().all(|(known, _)| known != rays));
        if rays.is_empty() {
            return Ok(());
        }
        let seen = self.surface.see(&scene.mesh, &rays).map_err(|e| BenchError::scene(&scene.name, e))?;
        self.views.extend(rays.into_iter().zip(seen));
        Ok(())
    }

    /// What rays that were cast show.
    fn seen(&self, rays: &CameraRays) -> Option<&Seen> {
        self.views.iter().find(|(known, _)| known == rays).map(|(_, seen)| seen)
    }
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
