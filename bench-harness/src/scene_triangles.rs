//! The triangles of a scene, which its octrees are built of and compared with: those of its mesh, or those of the mesh displaced for
//! one level, as a whole or part by part.

use esvo_builder::{
    BuildError, BuildSettings, Built, DisplaceOptions, Mesh, Progress, build, build_displaced, displace,
    displaced_triangles,
};
use esvo_core::exact::CameraRays;
use esvo_cpu::triangles::TriangleScene;

use crate::BenchError;
use crate::seen::{Seen, see_displaced, sorted};

/// Displaced meshes with more triangles than this, about, are not in memory as a whole: with what casters need, 10 million triangles
/// take some 4 GB.
const WHOLE: f64 = 1e7;

/// The triangles of a scene's mesh, which is passed to every function.
pub(crate) enum SceneTriangles {
    /// As they are.
    AsTheyAre(TriangleScene),
    /// Of the mesh after displacement.
    Displaced(Box<Mesh>, TriangleScene),
    /// Displaced part by part.
    InParts(DisplaceOptions),
}

impl SceneTriangles {
    /// Displaces the mesh if told how: part by part if it would have more than [`WHOLE`] triangles, about. Messages name the scene.
    ///
    /// # Errors
    /// Height maps that cannot be used; coordinates that are too large.
    pub(crate) fn new(scene: &str, mesh: &Mesh, displacement: Option<DisplaceOptions>) -> Result<Self, BenchError> {
        let failed = |e: &dyn std::error::Error| BenchError::scene(scene, e.to_string());
        let Some(options) = displacement else {
            return Ok(Self::AsTheyAre(sorted(mesh).map_err(|e| failed(&e))?));
        };
        if displaced_triangles(mesh, &options).map_err(|e| failed(&e))? > WHOLE {
            return Ok(Self::InParts(options));
        }
        let displaced = displace(mesh, &options).map_err(|e| failed(&e))?;
        let triangles = sorted(&displaced).map_err(|e| failed(&e))?;
        Ok(Self::Displaced(Box::new(displaced), triangles))
    }

    /// The mesh after displacement and its triangles; `None` if they are not in memory as a whole.
    pub(crate) fn whole<'a>(&'a self, mesh: &'a Mesh) -> Option<(&'a Mesh, &'a TriangleScene)> {
        match self {
            Self::AsTheyAre(triangles) => Some((mesh, triangles)),
            Self::Displaced(displaced, triangles) => Some((displaced, triangles)),
            Self::InParts(_) => None,
        }
    }

    /// Builds an octree of the triangles.
    ///
    /// # Errors
    /// Those of [`build`] and [`build_displaced`].
    pub(crate) fn build(
        &self,
        mesh: &Mesh,
        settings: &BuildSettings,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Built, BuildError> {
        match self {
            Self::AsTheyAre(_) => build(mesh, settings, progress),
            Self::Displaced(displaced, _) => build(displaced, settings, progress),
            Self::InParts(options) => build_displaced(mesh, options, settings, progress),
        }
    }

    /// What rays show of the triangles.
    ///
    /// # Errors
    /// Height maps that cannot be used.
    pub(crate) fn see(&self, mesh: &Mesh, rays: &[CameraRays]) -> Result<Vec<Seen>, BuildError> {
        let see = |mesh: &Mesh, triangles| rays.iter().map(|rays| Seen::of(mesh, triangles, rays)).collect();
        Ok(match self {
            Self::AsTheyAre(triangles) => see(mesh, triangles),
            Self::Displaced(displaced, triangles) => see(displaced, triangles),
            Self::InParts(options) => see_displaced(mesh, options, rays)?.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seen::tests::{bumpy_box, options, rays};

    #[test]
    fn parts_are_built_and_seen_as_the_whole() {
        let mesh = bumpy_box();
        let options = options(&mesh);
        let all_at_once = DisplaceOptions { max_triangles: 1 << 24, ..options };
        let whole = SceneTriangles::new("s", &mesh, Some(all_at_once)).unwrap();
        let parts = SceneTriangles::InParts(options);
        assert!(whole.whole(&mesh).is_some_and(|(whole, _)| whole.triangle_count() > 10_000));
        assert!(parts.whole(&mesh).is_none());
        let built = |triangles: &SceneTriangles, levels: u32| {
            let settings = BuildSettings { levels, ..BuildSettings::default() };
            let built = triangles.build(&mesh, &settings, &|_| ()).unwrap();
            (built.stats.triangles, esvo_format::stats(&built.octree).voxels)
        };
        assert_eq!(built(&whole, 6), built(&parts, 6));
        assert_ne!(built(&whole, 6), built(&parts, 5));
        let seen = |triangles: &SceneTriangles| triangles.see(&mesh, &rays()).unwrap();
        assert!(seen(&whole).iter().zip(seen(&parts)).all(|(a, b)| a.picture == b.picture && a.surfaces == b.surfaces));
        let flat = SceneTriangles::new("s", &mesh, None).unwrap();
        assert_eq!(built(&flat, 3).0, 10);
        assert!(seen(&flat)[0].picture != seen(&parts)[0].picture);
    }
}
