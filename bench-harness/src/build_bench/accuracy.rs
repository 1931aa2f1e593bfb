//! How far the octree in a file is from the triangles that it was built from.

use std::path::Path;
use std::sync::Arc;

use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::{CastOptions, Caster, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;

use crate::BenchError;
use crate::cutout::cast_solid;
use crate::error::{DepthError, DepthErrors, voxel_edges};
use crate::scene::Scene;

/// The triangles of a scene, and what its rays hit among them.
pub(crate) struct Truth {
    scene: Scene,
    triangles: TriangleScene,
    size: [u32; 2],
    /// By their rays, which depend on where the root cube lies: the same for all octrees of a mesh.
    views: Vec<(CameraRays, Vec<TriangleHit>)>,
}

/// Error of an octree where rays end at leaves only, and where they end at voxels of one pixel.
pub(crate) struct Errors {
    pub(crate) leaves: DepthError,
    pub(crate) pixel: DepthError,
}

impl Truth {
    /// Of a scene, its pictures being of this size.
    pub(crate) fn new(scene: Scene, size: [u32; 2]) -> Result<Self, BenchError> {
        let mesh = &scene.mesh;
        let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        let triangles = TriangleScene::new(corners).map_err(|e| BenchError::scene(&scene.name, e))?;
        Ok(Self { scene, triangles, size, views: Vec::new() })
    }

    fn hits(&mut self, rays: CameraRays) -> &[TriangleHit] {
        let known = self.views.iter().position(|(known, _)| *known == rays);
        let index = known.unwrap_or_else(|| {
            let hits = cast_solid(&self.scene.mesh, &self.triangles, &rays);
            self.views.push((rays, hits));
            self.views.len() - 1
        });
        &self.views[index].1
    }

    /// Casts every view of the scene against the octree in a file, with its contours if it has any.
    pub(crate) fn errors(&mut self, file: &Path) -> Result<Errors, BenchError> {
        let name = self.scene.name.clone();
        let failed = |what: String| BenchError::scene(&name, what);
        let octree = Arc::new(Octree::open(file).map_err(|e| failed(e.to_string()))?);
        octree.sound().map_err(|e| failed(e.to_string()))?;
        let cast = |e: esvo_core::CastError| failed(e.to_string());
        let mut caster = CpuCaster::new(None).map_err(cast)?;
        caster.load(&octree).map_err(cast)?;
        let (to_mesh, root) = (octree.octree_to_mesh(0), octree.objects()[0].root_slot as u32);
        let edges = voxel_edges(&octree, 0);
        let cameras: Vec<_> = self.scene.views.iter().map(|v| v.camera).collect();
        let mut hits = Vec::new();
        let [leaves, pixel] = [0.0, 1.0].map(|max_voxel_pixels| {
            let mut errors = DepthErrors::default();
            for camera in &cameras {
                let options = CastOptions { contours: true, beam: false, max_voxel_pixels };
                let view = View::new(camera, to_mesh, root, self.size.into(), &options)?;
                caster.cast(&view, &mut hits)?;
                // The rays as the kernels take them: the rounding of the camera is not the octree's error.
                let rays = CameraRays::of_view(&view, to_mesh);
                errors.add(&rays, self.hits(rays), &hits, edges);
            }
            Ok(errors.finish())
        });
        Ok(Errors { leaves: leaves.map_err(cast)?, pixel: pixel.map_err(cast)? })
    }
}
