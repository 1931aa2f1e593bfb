//! The picture of a mesh, shaded like an octree. Pictures of octrees are compared with it.

use esvo_builder::{Material, Mesh, mapped_normal};
use esvo_core::Picture;
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::shading::{Surface, encode_srgb, shade_triangles};
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Shades the hits of rays with the mesh's colours, textures and shading normals.
pub(crate) fn shade_mesh(mesh: &Mesh, rays: &CameraRays, hits: &[TriangleHit]) -> Picture {
    let per_distance = per_distance(rays);
    shade_triangles(rays, hits, |triangle, point| {
        Looked::at(mesh, triangle as usize, point, per_distance * point.distance(rays.origin)).surface()
    })
}

/// The surface at each hit, with its textures at full resolution between their texels; that of a miss has no normal and is black.
pub(crate) fn surfaces(mesh: &Mesh, rays: &CameraRays, hits: &[TriangleHit]) -> Vec<Surface> {
    let surface = |(index, hit): (usize, &TriangleHit)| {
        if hit.is_miss() {
            return Surface { normal: DVec3::ZERO, color: [0.0; 3] };
        }
        let ray = rays.ray_at(index);
        Looked::at(mesh, hit.triangle as usize, ray.origin + ray.direction * hit.t, 0.0).surface()
    };
    hits.par_iter().enumerate().map(surface).collect()
}

/// Footprint of a pixel at a point, divided by the distance of the point from the eye. It is about the same for all rays, as
/// all of them end on the far plane.
pub(crate) fn per_distance(rays: &CameraRays) -> f64 {
    rays.pixel_size() / rays.ray(rays.width / 2, rays.height / 2).direction.length()
}

/// A point of a triangle that a ray hits.
pub(crate) struct Looked<'a> {
    mesh: &'a Mesh,
    material: &'a Material,
    triangle: usize,
    /// Vertices of the triangle.
    indices: [usize; 3],
    /// Weights of its corners at the point.
    weights: [f32; 3],
    /// Geometric normal; its length is twice the area of the triangle.
    flat: DVec3,
    /// Width of the area over which textures are averaged, in mesh units.
    footprint: f32,
}

impl<'a> Looked<'a> {
    /// Textures are averaged over `footprint` in mesh units.
    pub(crate) fn at(mesh: &'a Mesh, triangle: usize, point: DVec3, footprint: f64) -> Self {
        let indices = mesh.triangles[triangle].map(|i| i as usize);
        let [a, b, c] = indices.map(|i| DVec3::from(mesh.positions[i]));
        let flat = (b - a).cross(c - a);
        Self {
            mesh,
            material: &mesh.materials[mesh.triangle_materials[triangle] as usize],
            triangle,
            indices,
            weights: barycentric([a, b, c], flat, point),
            flat,
            footprint: footprint as f32,
        }
    }

    fn mix(&self, values: &[[f32; 3]]) -> Vec3 {
        self.indices.into_iter().zip(self.weights).map(|(i, w)| Vec3::from(values[i]) * w).sum()
    }

    /// Texture coordinates of the point, and the footprint in texels of an image of this size.
    fn texture_point(&self, size: (u32, u32)) -> (Vec2, f32) {
        let uvs = self.indices.map(|i| Vec2::from(self.mesh.uvs[i]));
        let uv = uvs.into_iter().zip(self.weights).map(|(v, w)| v * w).sum::<Vec2>();
        let size = Vec2::new(size.0 as f32, size.1 as f32);
        let texels = ((uvs[1] - uvs[0]) * size).perp_dot((uvs[2] - uvs[0]) * size).abs();
        (uv, self.footprint * (texels / self.flat.length() as f32).sqrt())
    }

    /// The texture's linear colour and alpha at the point; `None` without a texture.
    fn texel(&self) -> Option<[f32; 4]> {
        let texture = self.material.texture.as_ref().filter(|_| !self.mesh.uvs.is_empty())?;
        let size = texture.mips.first().map_or((1, 1), |mip| (mip.width, mip.height));
        let (uv, footprint) = self.texture_point(size);
        Some(texture.sample(uv.into(), footprint))
    }

    /// The interpolated normal changed by the material's normal map; `None` without a map or without tangents.
    fn mapped(&self, normal: DVec3) -> Option<DVec3> {
        let map = self.material.normal_map.as_ref().filter(|_| !self.mesh.uvs.is_empty())?;
        let tangents = self.mesh.corner_tangents(self.triangle, map)?;
        let tangent = tangents.into_iter().zip(self.weights).map(|(t, w)| Vec4::from(t) * w).sum::<Vec4>();
        let size = map.texture.mips.first().map_or((1, 1), |mip| (mip.width, mip.height));
        let (uv, footprint) = self.texture_point(size);
        let normal = normal.try_normalize()?.as_vec3();
        let mapped = mapped_normal(normal.into(), tangent.into(), map.sample(uv.into(), footprint));
        Some(Vec3::from(mapped).as_dvec3())
    }

    /// Opacity of the point, 0 to 1.
    pub(crate) fn alpha(&self) -> f32 {
        self.material.base_color[3] * self.texel().map_or(1.0, |t| t[3])
    }

    /// Colour and shading normal.
    pub(crate) fn surface(&self) -> Surface {
        let mut normal = self.flat;
        if !self.mesh.normals.is_empty() {
            let smooth = self.mix(&self.mesh.normals);
            normal = if smooth.length() > 1e-6 { smooth.as_dvec3() } else { self.flat };
        }
        let [r, g, b, _] = self.material.base_color;
        let mut color = Vec3::new(r, g, b);
        if !self.mesh.colors.is_empty() {
            color *= self.mix(&self.mesh.colors);
        }
        if let Some([r, g, b, _]) = self.texel() {
            color *= Vec3::new(r, g, b);
        }
        let normal = self.mapped(normal).unwrap_or(normal);
        Surface { normal, color: color.to_array().map(encode_srgb) }
    }
}

/// Barycentric weights of the corners at a point of the triangle's plane. `flat` is the normal; its length is twice the area.
fn barycentric([a, b, c]: [DVec3; 3], flat: DVec3, point: DVec3) -> [f32; 3] {
    let area = flat.length_squared();
    if area == 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let v = (point - a).cross(c - a).dot(flat) / area;
    let w = (b - a).cross(point - a).dot(flat) / area;
    [1.0 - v - w, v, w].map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_builder::{LinearMip, LinearTexture, MipLevel, NormalMap, Texture, UvTransform, Wrap};

    use super::*;

    fn surface(mesh: &Mesh, triangle: usize, point: DVec3, footprint: f64) -> Surface {
        Looked::at(mesh, triangle, point, footprint).surface()
    }

    fn mesh() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            triangle_materials: vec![0],
            materials: vec![Material { base_color: [0.5, 0.25, 1.0, 1.0], ..Material::default() }],
            ..Mesh::default()
        }
    }

    #[test]
    fn colours_are_products_in_linear_light() {
        let mut mesh = mesh();
        let plain = surface(&mesh, 0, DVec3::new(0.5, 0.5, 0.0), 0.01);
        assert_eq!(plain.color, [0.5, 0.25, 1.0].map(encode_srgb));
        assert!(plain.normal.normalize().abs_diff_eq(DVec3::Z, 1e-12));

        mesh.colors = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mixed = surface(&mesh, 0, DVec3::new(1.0, 0.5, 0.0), 0.01);
        let expected = [0.5 * 0.25, 0.25 * 0.5, 0.25].map(encode_srgb);
        assert!((0..3).all(|i| (mixed.color[i] - expected[i]).abs() < 1e-6), "{mixed:?}");
    }

    #[test]
    fn textures_and_shading_normals_are_interpolated() {
        let mut mesh = mesh();
        mesh.normals = vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        mesh.uvs = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let texels = vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]];
        let texture = Texture { mips: vec![MipLevel { width: 2, height: 2, texels }], wrap: [Wrap::Repeat; 2] };
        mesh.materials[0] = Material { base_color: [1.0; 4], texture: Some(Arc::new(texture)), ..Material::default() };
        // The centres of the texels lie at 0.25 and 0.75 of the coordinates.
        let at = |x: f64, y: f64| surface(&mesh, 0, DVec3::new(x, y, 0.0), 1e-6);
        for (found, expected) in
            [(at(0.5, 0.5), [1.0, 0.0, 0.0]), (at(1.5, 0.5), [0.0, 1.0, 0.0]), (at(0.5, 1.5), [0.0, 0.0, 1.0])]
        {
            assert!((0..3).all(|i| (found.color[i] - expected[i]).abs() < 1e-3), "{found:?}");
        }
        let normal = at(1.0, 0.5).normal.normalize();
        assert!(normal.abs_diff_eq(DVec3::new(1.0, 0.0, 1.0).normalize(), 1e-6), "{normal}");
    }
    #[test]
    fn normal_maps_turn_the_normal_towards_the_tangent() {
        let mut mesh = mesh();
        mesh.uvs = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        // (1, 0, 1) all over: half-way between the tangent, which is x here, and the normal.
        let level = LinearMip { width: 1, height: 1, texels: vec![[65535, 32768, 65535]] };
        let texture = Arc::new(LinearTexture { mips: vec![level], wrap: [Wrap::Repeat; 2] });
        mesh.materials[0].normal_map = Some(NormalMap { texture, scale: 1.0, uv_transform: UvTransform::IDENTITY });
        let normal = surface(&mesh, 0, DVec3::new(0.5, 0.5, 0.0), 0.01).normal.normalize();
        assert!(normal.abs_diff_eq(DVec3::new(1.0, 0.0, 1.0).normalize(), 1e-4), "{normal}");
    }
}
