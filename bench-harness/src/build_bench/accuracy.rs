//! The depth error of the octree in a file against the triangles that it was built from.

use std::path::Path;
use std::sync::Arc;

use esvo_builder::{Mesh, displace};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::{CastOptions, Caster, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;

use crate::BenchError;
use crate::error::depth::{DepthError, DepthErrors, voxel_edges};
use crate::picture_bench::cutout::cast_solid;
use crate::scene::{Scene, displacement};

/// The triangles of a scene and the exact hits of its rays.
pub(crate) struct SceneTruth {
    scene: Scene,
    size: [u32; 2],
    /// The triangles of the last level that was measured: a displaced mesh has different triangles at every level.
    known: Option<(u32, Triangles)>,
}

/// Triangles and the hits of the rays that were cast against them.
struct Triangles {
    /// The mesh after displacement; `None` if the scene's own mesh is used.
    displaced: Option<Mesh>,
    sorted: TriangleScene,
    /// Rays of each view and their hits. The rays depend on the position of the root cube, which is the same for all octrees of
    /// a mesh.
    views: Vec<(CameraRays, Vec<TriangleHit>)>,
}

/// Errors of an octree when rays end at leaves only, and when they end at voxels of one pixel.
pub(crate) struct Errors {
    pub(crate) leaves: DepthError,
    pub(crate) pixel: DepthError,
}

impl Triangles {
    fn new(scene: &Scene, levels: u32) -> Result<Self, BenchError> {
        let failed = |e: String| BenchError::scene(&scene.name, e);
        let displaced = if scene.displaced {
            let options = displacement(&scene.mesh, levels);
            Some(displace(&scene.mesh, &options).map_err(|e| failed(e.to_string()))?)
        } else {
            None
        };
        let mesh = displaced.as_ref().unwrap_or(&scene.mesh);
        let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        let sorted = TriangleScene::new(corners).map_err(|e| failed(e.to_string()))?;
        Ok(Self { displaced, sorted, views: Vec::new() })
    }

    fn hits(&mut self, scene: &Scene, rays: CameraRays) -> &[TriangleHit] {
        let known = self.views.iter().position(|(known, _)| *known == rays);
        let index = known.unwrap_or_else(|| {
            let hits = cast_solid(self.displaced.as_ref().unwrap_or(&scene.mesh), &self.sorted, &rays);
            self.views.push((rays, hits));
            self.views.len() - 1
        });
        &self.views[index].1
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
        let mut hits = Vec::new();
        let [leaves, pixel] = [0.0, 1.0].map(|max_voxel_pixels| {
            let mut errors = DepthErrors::default();
            for view in &scene.views {
                let options = CastOptions { contours: true, beam: false, max_voxel_pixels };
                let view = View::new(&view.camera, to_mesh, root, self.size.into(), &options)?;
                caster.cast(&view, &mut hits)?;
                // The rays of the view, as the casters use them: rounding in the camera is not an error of the octree.
                let rays = CameraRays::of_view(&view, to_mesh);
                errors.add(&rays, triangles.hits(scene, rays), &hits, edges);
            }
            Ok(errors.finish())
        });
        Ok(Errors { leaves: leaves.map_err(cast)?, pixel: pixel.map_err(cast)? })
    }
}
