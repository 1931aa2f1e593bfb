//! How far the octree in a file is from the triangles that it was built from.

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

/// The triangles of a scene, and what its rays hit among them.
pub(crate) struct Truth {
    scene: Scene,
    size: [u32; 2],
    /// Those that were asked for last: a displaced mesh has others at every level.
    known: Option<(u32, Triangles)>,
}

/// Triangles and what was cast against them.
struct Triangles {
    /// The mesh after displacement; `None`: that of the scene.
    displaced: Option<Mesh>,
    sorted: TriangleScene,
    /// By their rays, which depend on where the root cube lies: the same for all octrees of a mesh.
    views: Vec<(CameraRays, Vec<TriangleHit>)>,
}

/// Error of an octree where rays end at leaves only, and where they end at voxels of one pixel.
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

impl Truth {
    /// Of a scene, its pictures being of this size.
    pub(crate) fn new(scene: Scene, size: [u32; 2]) -> Self {
        Self { scene, size, known: None }
    }

    /// Casts every view of the scene against the octree of `levels` in a file, with its contours if it has any.
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
                // The rays as the kernels take them: the rounding of the camera is not the octree's error.
                let rays = CameraRays::of_view(&view, to_mesh);
                errors.add(&rays, triangles.hits(scene, rays), &hits, edges);
            }
            Ok(errors.finish())
        });
        Ok(Errors { leaves: leaves.map_err(cast)?, pixel: pixel.map_err(cast)? })
    }
}
