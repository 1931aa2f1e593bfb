//! The triangles of a scene: those of its mesh, or those of the mesh displaced for one level.

use esvo_builder::{Mesh, displace};
use esvo_cpu::triangles::TriangleScene;

use crate::BenchError;
use crate::scene::{Scene, displacement};

/// A mesh with the hierarchy over its triangles.
pub(crate) struct LevelMesh<'a> {
    scene: &'a Scene,
    /// The mesh after displacement; `None`: the scene's own.
    displaced: Option<Mesh>,
    pub(crate) triangles: TriangleScene,
}

impl<'a> LevelMesh<'a> {
    /// The triangles that an octree of these levels is built of, and compared with.
    ///
    /// # Errors
    /// Height maps that cannot be used; triangles without any area.
    pub(crate) fn new(scene: &'a Scene, levels: u32) -> Result<Self, BenchError> {
        let failed = |e: String| BenchError::scene(&scene.name, e);
        let moved = scene.displaced.then(|| displace(&scene.mesh, &displacement(&scene.mesh, levels)));
        let displaced = moved.transpose().map_err(|e| failed(e.to_string()))?;
        let mesh = displaced.as_ref().unwrap_or(&scene.mesh);
        let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        let triangles = TriangleScene::new(corners).map_err(|e| failed(e.to_string()))?;
        Ok(Self { scene, displaced, triangles })
    }

    pub(crate) fn mesh(&self) -> &Mesh {
        self.displaced.as_ref().unwrap_or(&self.scene.mesh)
    }
}
