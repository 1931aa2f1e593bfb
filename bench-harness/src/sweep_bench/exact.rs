//! The exact answers of a scene's views: hits, normals and pictures.

use std::sync::Arc;

use esvo_builder::Mesh;
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::reference::ReferenceCaster;
use esvo_core::shading::{octree_to_mesh, shade, voxel_normal};
use esvo_core::{CastError, Caster, Hit, Picture, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;
use glam::DVec3;

use super::cache::{Cache, hits_key};
use super::record::CellError;
use crate::BenchError;
use crate::error::depth::{DepthErrors, Summary, VoxelEdges, normal_angle, normal_angles, voxel_edges};
use crate::error::image::{ImageError, image_error};
use crate::picture_bench::cutout::cast_solid;
use crate::picture_bench::mesh_picture::{Looked, shade_mesh};

/// The exact answer of one view.
pub(crate) struct ExactView {
    rays: CameraRays,
    hits: Vec<TriangleHit>,
    /// Shading normals at the hits; zero for misses.
    normals: Vec<DVec3>,
    picture: Picture,
}

impl ExactView {
    /// What the rays of `view` meet among the triangles of a mesh, in double precision: from the cache if it is there. The rays are
    /// those of the view as casters use them: rounding in the camera is not an error of the octree.
    pub(crate) fn of_triangles(
        mesh: &Mesh,
        triangles: &TriangleScene,
        rays: CameraRays,
        mesh_key: &str,
        cache: &Cache,
    ) -> Result<Self, BenchError> {
        let key = hits_key(mesh_key, &rays);
        let hits = match cache.hits(&key, rays.pixels()) {
            Some(hits) => hits,
            None => {
                let hits = cast_solid(mesh, triangles, &rays);
                cache.put_hits(&key, &hits)?;
                hits
            }
        };
        let normals = normals_of(mesh, &rays, &hits);
        Ok(Self { normals, picture: shade_mesh(mesh, &rays, &hits), rays, hits })
    }

    /// What the rays of `view` meet if they end at leaves only, by the reference caster: the answer for an octree whose triangles are
    /// not known.
    pub(crate) fn of_leaves(octree: &Arc<Octree>, view: &View) -> Result<Self, CastError> {
        let to_mesh = octree_to_mesh(octree, view);
        let mut reference = ReferenceCaster::default();
        reference.load(octree)?;
        let mut leaves = Vec::new();
        let fine = View { max_voxel_pixels: 0.0, ..*view };
        reference.cast(&fine, &mut leaves)?;
        let exact = |hit: &Hit| match hit.t() {
            Some(t) => TriangleHit { t: t.into(), triangle: 0 },
            None => TriangleHit::MISS,
        };
        let normal = |(index, hit): (usize, &Hit)| {
            let (x, y) = (index as u32 % view.width, index as u32 / view.width);
            if hit.is_miss() { DVec3::ZERO } else { voxel_normal(octree, &to_mesh, &view.ray(x, y), hit) }
        };
        Ok(Self {
            rays: CameraRays::of_view(view, to_mesh),
            hits: leaves.iter().map(exact).collect(),
            normals: leaves.iter().enumerate().map(normal).collect(),
            picture: shade(octree, &fine, &leaves),
        })
    }

    /// The rays.
    pub(crate) fn rays(&self) -> &CameraRays {
        &self.rays
    }
}

/// Shading normals at the hits of triangles; zero for misses.
fn normals_of(mesh: &Mesh, rays: &CameraRays, hits: &[TriangleHit]) -> Vec<DVec3> {
    let normal = |(index, hit): (usize, &TriangleHit)| {
        if hit.is_miss() {
            return DVec3::ZERO;
        }
        let ray = rays.ray_at(index);
        Looked::at(mesh, hit.triangle as usize, ray.origin + ray.direction * hit.t, 0.0).surface().normal
    };
    hits.iter().enumerate().map(normal).collect()
}

/// The errors of one setting, collected view by view.
#[derive(Default)]
pub(crate) struct Errors {
    depth: DepthErrors,
    angles: Vec<f64>,
    pictures: Vec<ImageError>,
}

impl Errors {
    /// Adds the hits of an octree.
    pub(crate) fn add(&mut self, exact: &ExactView, octree: &Octree, view: &View, hits: &[Hit]) {
        self.depth.add(&exact.rays, &exact.hits, hits, voxel_edges(octree, 0));
        self.angles.extend(normal_angles(octree, view, &exact.normals, hits));
        self.pictures.extend(image_error(&exact.picture, &shade(octree, view, hits)));
    }

    /// Adds the hits of a triangle caster.
    pub(crate) fn add_triangles(&mut self, exact: &ExactView, mesh: &Mesh, hits: &[TriangleHit]) {
        let as_hit = |hit: &TriangleHit| {
            if hit.is_miss() { Hit::miss(0) } else { Hit::new(hit.t as f32, 0, 0, 0, 0) }
        };
        let plain: Vec<Hit> = hits.iter().map(as_hit).collect();
        // Errors in voxels are not taken from these.
        self.depth.add(&exact.rays, &exact.hits, &plain, VoxelEdges { root: 1.0, finest: 1.0 });
        let normals = normals_of(mesh, &exact.rays, hits);
        self.angles.extend(exact.normals.iter().zip(&normals).filter_map(|(a, b)| normal_angle(*a, *b)));
        self.pictures.extend(image_error(&exact.picture, &shade_mesh(mesh, &exact.rays, hits)));
    }

    /// Summarizes all views.
    pub(crate) fn finish(self) -> CellError {
        let depth = self.depth.finish();
        let mean =
            |of: fn(&ImageError) -> f64| self.pictures.iter().map(of).sum::<f64>() / self.pictures.len().max(1) as f64;
        CellError {
            rays: depth.rays,
            both_hit: depth.both_hit,
            holes: depth.only_exact,
            too_many: depth.only_octree,
            strange: depth.strange,
            disagreement: depth.disagreement,
            pixels: depth.pixels,
            scene: depth.scene,
            normal_degrees: Summary::of(self.angles),
            color: mean(|p| p.mean_absolute),
            flip: mean(|p| p.flip),
        }
    }
}
