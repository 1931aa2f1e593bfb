//! Error of colours and normals: those of the voxels that rays hit, beside those of the surface that the same rays hit.

use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::shading::{Surface, octree_to_mesh, voxel_color, voxel_normal};
use esvo_core::{Hit, View};
use esvo_format::Octree;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::depth::Summary;

/// How far apart the two hits of a ray may lie, in edges of the finest voxels or in footprints of the pixel at which rays end. Hits that
/// lie farther apart are taken for those of two surfaces.
pub const NEAR: f64 = 4.0;

/// Error of the colours and normals in a picture.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct AttributeError {
    /// Rays that hit both triangles and voxels.
    pub both_hit: u64,
    /// Rays of these whose two hits lie more than [`NEAR`] apart, so that they hit different surfaces. They are not in the summaries.
    pub elsewhere: u64,
    /// Angle between the voxel's normal and the surface's, in degrees, 0 to 180. Both are turned to the viewer before.
    pub normals: Summary,
    /// Difference between the voxel's colour and the surface's: the largest of the three channels, sRGB-encoded, in steps of 1/255.
    pub colors: Summary,
}

/// Errors of colours and normals of several pictures, collected ray by ray.
#[derive(Clone, Default, Debug)]
pub struct AttributeErrors {
    both_hit: u64,
    elsewhere: u64,
    normals: Vec<f64>,
    colors: Vec<f64>,
}

/// What the rays of a view hit of the triangles: a hit for each ray, and the surface there; the surface of a miss means nothing.
#[derive(Clone, Copy, Debug)]
pub struct Exact<'a> {
    /// The hits.
    pub hits: &'a [TriangleHit],
    /// The surfaces.
    pub surfaces: &'a [Surface],
}

impl AttributeErrors {
    /// Adds a picture. `hits` are those of `view`, whose rays end at voxels of `pixels` pixels (0: at leaves only); `finest` is the edge of
    /// the finest voxels in mesh units.
    ///
    /// # Panics
    /// The number of hits is not that of the rays, or the hits are not of this octree.
    pub fn add(&mut self, octree: &Octree, view: &View, exact: Exact, hits: &[Hit], finest: f64, pixels: f64) {
        let to_mesh = octree_to_mesh(octree, view);
        let rays = CameraRays::of_view(view, to_mesh);
        assert!([exact.hits.len(), exact.surfaces.len(), hits.len()] == [rays.pixels(); 3], "one hit for every ray");
        for (index, (hit, there)) in hits.iter().zip(exact.hits).enumerate() {
            if hit.is_miss() || there.is_miss() {
                continue;
            }
            self.both_hit += 1;
            let direction = rays.ray_at(index).direction;
            let distance = ((f64::from(hit.raw_t) - there.t) * direction.length()).abs();
            let footprint = rays.pixel_size() * there.t;
            // A distance that is no number is not near, either.
            let near = distance <= NEAR * finest.max(pixels * footprint);
            if !near {
                self.elsewhere += 1;
                continue;
            }
            let ray = view.ray(index as u32 % view.width, index as u32 / view.width);
            let surface = &exact.surfaces[index];
            self.colors.push(color_difference(voxel_color(octree, &ray, hit), surface.color));
            let seen = if surface.normal.dot(direction) > 0.0 { -surface.normal } else { surface.normal };
            self.normals.extend(angle(voxel_normal(octree, &to_mesh, &ray, hit), seen));
        }
    }

    /// Summarizes all pictures.
    pub fn finish(self) -> AttributeError {
        AttributeError {
            both_hit: self.both_hit,
            elsewhere: self.elsewhere,
            normals: Summary::of(self.normals),
            colors: Summary::of(self.colors),
        }
    }
}

/// The largest difference of a channel, in steps of 1/255.
fn color_difference(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs()) * 255.0).fold(0.0, f64::max)
}

/// Angle in degrees, 0 to 180, between two directions of any length; `None` if one of them is zero.
fn angle(a: DVec3, b: DVec3) -> Option<f64> {
    // atan2 of sine and cosine: the arc cosine alone loses half the digits of a small angle.
    let angle = a.cross(b).length().atan2(a.dot(b));
    (a != DVec3::ZERO && b != DVec3::ZERO && angle.is_finite()).then(|| angle.to_degrees())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_builder::{BuildSettings, Material, Mesh, build};
    use esvo_core::shading::encode_srgb;
    use esvo_core::{Camera, CastOptions, Caster};
    use esvo_cpu::CpuCaster;
    use esvo_cpu::triangles::TriangleScene;

    use super::*;
    use crate::picture_bench::mesh_picture::surfaces;

    /// A square of 2 units in the plane z = 0, of one colour, with a shading normal.
    fn square(color: [f32; 3], normal: DVec3) -> Mesh {
        let [r, g, b] = color;
        Mesh {
            positions: vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            normals: vec![normal.normalize().as_vec3().to_array(); 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_materials: vec![0, 0],
            materials: vec![Material { base_color: [r, g, b, 1.0], ..Material::default() }],
            ..Mesh::default()
        }
    }

    /// The error of the octree of a mesh against another mesh of the same triangles that is moved towards the viewer.
    fn error(built: &Mesh, shown: &Mesh, moved: f64) -> AttributeError {
        let settings = BuildSettings { levels: 5, ..BuildSettings::default() };
        let octree = Arc::new(build(built, &settings, &|_| ()).unwrap().octree);
        let camera = Camera {
            eye: [0.1, 0.2, 4.0],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 40.0,
            near: 0.1,
            far: 8.0,
        };
        let (to_mesh, root) = (octree.octree_to_mesh(0), octree.objects()[0].root_slot as u32);
        let options = CastOptions { max_voxel_pixels: 0.0, ..CastOptions::default() };
        let view = View::new(&camera, to_mesh, root, (48, 32), &options).unwrap();
        let mut caster = CpuCaster::new(None).unwrap();
        caster.load(&octree).unwrap();
        let mut hits = Vec::new();
        caster.cast(&view, &mut hits).unwrap();
        let corner = |v: u32| {
            let [x, y, z] = shown.positions[v as usize];
            [x, y, z + moved]
        };
        let triangles = TriangleScene::new(shown.triangles.iter().map(|t| t.map(corner)).collect()).unwrap();
        let rays = CameraRays::of_view(&view, to_mesh);
        let there = triangles.cast_exact(&rays);
        let looks = surfaces(shown, &rays, &there);
        let mut errors = AttributeErrors::default();
        let finest = crate::error::depth::voxel_edges(&octree, 0).finest;
        errors.add(&octree, &view, Exact { hits: &there, surfaces: &looks }, &hits, finest, 0.0);
        errors.finish()
    }

    #[test]
    fn the_octree_of_a_plain_square_has_its_colour_and_normal() {
        let mesh = square([0.5, 0.25, 1.0], DVec3::Z);
        let found = error(&mesh, &mesh, 0.0);
        assert!(found.both_hit > 400 && found.elsewhere == 0, "{found:?}");
        // Colours are stored in 5 and 6 bits, normals in about 14.
        assert!(found.colors.max < 5.0 && found.normals.max < 0.5, "{found:?}");
        // Seen from behind, the normal is turned around.
        let behind = square([0.5, 0.25, 1.0], DVec3::NEG_Z);
        assert!(error(&behind, &mesh, 0.0).normals.max < 0.5);
    }

    /// The negative control.
    #[test]
    fn other_colours_normals_and_places_are_found() {
        let mesh = square([0.5, 0.25, 1.0], DVec3::Z);
        let found = error(&mesh, &square([0.5, 0.05, 1.0], DVec3::new(0.0, 1.0, 1.0)), 0.0);
        let step = f64::from(encode_srgb(0.25) - encode_srgb(0.05)) * 255.0;
        assert!((found.colors.median - step).abs() < 5.0, "{found:?}, not {step}");
        assert!((found.normals.median - 45.0).abs() < 0.5, "{found:?}");
        // The finest voxels have an edge of 1/16.
        let near = error(&mesh, &mesh, 0.2);
        assert!(near.elsewhere < near.both_hit / 2 && near.both_hit > 400, "{near:?}");
        let far = error(&mesh, &mesh, 0.4);
        assert!(far.elsewhere == far.both_hit && far.both_hit > 400, "{far:?}");
        assert_eq!((far.normals, far.colors), (Summary::default(), Summary::default()));
    }

    #[test]
    fn angles_and_differences() {
        assert_eq!(angle(DVec3::X * 3.0, DVec3::NEG_X), Some(180.0));
        assert_eq!(angle(DVec3::X, DVec3::ZERO), None);
        let small = angle(DVec3::X, DVec3::new(1.0, 1e-9, 0.0)).unwrap().to_radians();
        assert!((small / 1e-9 - 1.0).abs() < 1e-6, "{small}");
        assert_eq!(color_difference([0.0, 0.5, 1.0], [0.0, 1.0, 0.8]), 127.5);
    }
}
