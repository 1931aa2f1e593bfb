//! Triangle meshes as the builder takes them: indexed triangles, one material each, attributes per vertex.

pub mod maps;
pub(crate) mod texture;

use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3};

use maps::{HeightMap, NormalMap, derived_tangent};

/// An indexed triangle mesh in its own units.
///
/// Vertex attributes other than the position are optional: each array is either empty or as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions in mesh units. Every component must be finite.
    pub positions: Vec<[f64; 3]>,
    /// Unit shading normals per vertex, or empty (the geometric normal is used then).
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates per vertex, or empty. `v` grows downwards from the first row of the image; coordinates wrap.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex colours in linear RGB, 0..=1, or empty. They multiply the material's colour.
    pub colors: Vec<[f32; 3]>,
    /// Unit tangents per vertex with their handedness (1 or -1) as fourth component, as in glTF (see
    /// [`maps`]), or empty. Zero where a vertex has none; use them through [`Mesh::corner_tangents`].
    pub tangents: Vec<[f32; 4]>,
    /// Vertex indices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `materials` for each triangle; as long as `triangles`.
    pub triangle_materials: Vec<u32>,
    /// At least one material if there is a triangle.
    pub materials: Vec<Material>,
    /// What the loader had to say: missing textures, skipped primitives. One line each.
    pub warnings: Vec<String>,
}

/// What [`Mesh::validate`] found wrong. Indices count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// Nothing to voxelize.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// An attribute array has neither one entry per vertex nor none at all, or `triangle_materials` not one per triangle.
    #[error("{what} has {found} entries where {expected} are needed")]
    WrongLength {
        /// Name of the array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A position is infinite or NaN.
    #[error("vertex {vertex} is not finite; repair or remove it")]
    NonFiniteVertex {
        /// Index into `positions`.
        vertex: usize,
    },
    /// A normal, texture coordinate, colour or tangent is infinite or NaN.
    #[error("the {what} of vertex {vertex} is not finite; repair or remove it")]
    NonFiniteAttribute {
        /// Name of the attribute.
        what: &'static str,
        /// Index of the vertex.
        vertex: usize,
    },
    /// A number of a material is infinite or NaN.
    #[error("the {what} of material {material} is not finite; correct it")]
    NonFiniteMaterial {
        /// Name of the number.
        what: &'static str,
        /// Index into `materials`.
        material: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex}, but there are only {vertices}")]
    VertexOutOfRange {
        /// Index into `triangles`.
        triangle: usize,
        /// The vertex index it holds.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A triangle names a material that does not exist.
    #[error("triangle {triangle} refers to material {material}, but there are only {materials}")]
    MaterialOutOfRange {
        /// Index into `triangles`.
        triangle: usize,
        /// The material index it holds.
        material: u32,
        /// Number of materials.
        materials: usize,
    },
}

impl Mesh {
    /// Number of triangles, degenerate ones included.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Smallest and largest coordinates over all vertices, in mesh units, or `None` without vertices.
    #[must_use]
    pub fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = DVec3::from(*self.positions.first()?);
        let (low, high) = self
            .positions
            .iter()
            .fold((first, first), |(low, high), &p| (low.min(DVec3::from(p)), high.max(DVec3::from(p))));
        Some((low.to_array(), high.to_array()))
    }

    /// Moves all vertices by `matrix`. Normals follow by its inverse transpose, and a mirroring matrix swaps the
    /// winding of the triangles, so that both still point outwards.
    pub fn transform(&mut self, matrix: &DMat4) {
        for p in &mut self.positions {
            *p = matrix.transform_point3(DVec3::from(*p)).to_array();
        }
        let normal_matrix = normal_matrix(matrix);
        for n in &mut self.normals {
            *n = transform_normal(&normal_matrix, *n);
        }
        for t in &mut self.tangents {
            *t = transform_tangent(matrix, *t);
        }
        if mirrors(matrix) {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
    }

    /// The tangent (of unit length, not always perpendicular to the normal) and handedness at the corners of `triangle` for
    /// reading `map`: those of the vertices, or, where one of the three has none, the same for all corners from the texture
    /// coordinates: the direction on the triangle in which `u` of the map grows while `v` stays. `None` if the texture
    /// coordinates, or the triangle, have no area: then the map says nothing about the triangle.
    ///
    /// Between the corners a caller interpolates; [`mapped_normal`](crate::mapped_normal) makes the tangent perpendicular.
    ///
    /// # Panics
    /// If `triangle` or one of its vertices does not exist; [`Mesh::validate`] finds the latter.
    #[must_use]
    pub fn corner_tangents(&self, triangle: usize, map: &NormalMap) -> Option<[[f32; 4]; 3]> {
        let corners = self.triangles[triangle].map(|v| v as usize);
        if !self.tangents.is_empty() {
            let given = corners.map(|v| self.tangents[v]);
            if given.iter().all(|t| t[..3] != [0.0; 3]) {
                return Some(given);
            }
        }
        if self.uvs.is_empty() {
            return None;
        }
        let positions = corners.map(|v| DVec3::from(self.positions[v]));
        derived_tangent(positions, corners.map(|v| map.uv_transform.apply(self.uvs[v]))).map(|t| [t; 3])
    }

    /// Checks everything the builder takes for granted.
    ///
    /// # Errors
    /// The first rule of the fields' documentation that does not hold.
    pub fn validate(&self) -> Result<(), MeshError> {
        if self.triangles.is_empty() {
            return Err(MeshError::NoTriangles);
        }
        let vertices = self.positions.len();
        for (what, found) in [
            ("normals", self.normals.len()),
            ("uvs", self.uvs.len()),
            ("colors", self.colors.len()),
            ("tangents", self.tangents.len()),
        ] {
            if found != 0 && found != vertices {
                return Err(MeshError::WrongLength { what, found, expected: vertices });
            }
        }
        if self.triangle_materials.len() != self.triangles.len() {
            return Err(MeshError::WrongLength {
                what: "triangle_materials",
                found: self.triangle_materials.len(),
                expected: self.triangles.len(),
            });
        }
        if let Some(vertex) = first_non_finite(&self.positions, |x| x.is_finite()) {
            return Err(MeshError::NonFiniteVertex { vertex });
        }
        for (what, vertex) in [
            ("normal", first_non_finite(&self.normals, |x| x.is_finite())),
            ("texture coordinate", first_non_finite(&self.uvs, |x| x.is_finite())),
            ("colour", first_non_finite(&self.colors, |x| x.is_finite())),
            ("tangent", first_non_finite(&self.tangents, |x| x.is_finite())),
        ] {
            if let Some(vertex) = vertex {
                return Err(MeshError::NonFiniteAttribute { what, vertex });
            }
        }
        for (material, m) in self.materials.iter().enumerate() {
            if let Some(what) = m.non_finite() {
                return Err(MeshError::NonFiniteMaterial { what, material });
            }
        }
        for (triangle, (corners, &material)) in self.triangles.iter().zip(&self.triangle_materials).enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
                return Err(MeshError::VertexOutOfRange { triangle, vertex, vertices });
            }
            if material as usize >= self.materials.len() {
                return Err(MeshError::MaterialOutOfRange { triangle, material, materials: self.materials.len() });
            }
        }
        Ok(())
    }
}

fn first_non_finite<T: Copy, const N: usize>(values: &[[T; N]], finite: impl Fn(T) -> bool) -> Option<usize> {
    values.iter().position(|value| !value.iter().all(|&x| finite(x)))
}

/// Whether `matrix` turns outside into inside (negative determinant).
pub(crate) fn mirrors(matrix: &DMat4) -> bool {
    DMat3::from_mat4(*matrix).determinant() < 0.0
}

/// The inverse transpose of the linear part of `matrix` up to a positive factor. Made from cofactors, so that a matrix
/// that flattens the mesh into a plane still gives the normal of that plane.
pub(crate) fn normal_matrix(matrix: &DMat4) -> DMat3 {
    let linear = DMat3::from_mat4(*matrix);
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if linear.determinant() < 0.0 { -cofactors } else { cofactors }
}

/// `normal` turned by a [`normal_matrix`] and brought to unit length; zero if nothing is left of it.
pub(crate) fn transform_normal(normal_matrix: &DMat3, normal: [f32; 3]) -> [f32; 3] {
    let n = DVec3::from(normal.map(f64::from));
    // The factor of the matrix may be tiny or huge: bring it near one before squaring.
    let turned = *normal_matrix * n;
    let largest = turned.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        (turned / largest).normalize_or_zero().as_vec3().to_array()
    } else {
        [0.0; 3]
    }
}

/// `tangent` moved by the linear part of `matrix`, its handedness turned over if that mirrors; zero if nothing is left.
pub(crate) fn transform_tangent(matrix: &DMat4, [x, y, z, w]: [f32; 4]) -> [f32; 4] {
    let moved = matrix.transform_vector3(DVec3::new(x.into(), y.into(), z.into()));
    let largest = moved.abs().max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return [0.0; 4];
    }
    let t = (moved / largest).normalize_or_zero().as_vec3();
    [t.x, t.y, t.z, if mirrors(matrix) { -w } else { w }]
}

/// What the surface of a set of triangles looks like.
#[derive(Clone, Debug)]
pub struct Material {
    /// The name in the source file, or a made-up one.
    pub name: String,
    /// Linear RGB and alpha, 0..=1. Multiplies the texture.
    pub base_color: [f32; 4],
    /// Colour texture, if any.
    pub texture: Option<Arc<Texture>>,
    /// Texels (or plain colours) whose alpha is below this are holes; `None`: opaque.
    pub alpha_cutoff: Option<f32>,
    /// Fine detail of the shading normal, if any.
    pub normal_map: Option<NormalMap>,
    /// Heights for [`displace`](crate::displace), if any. [`build`](crate::build) itself does not read them.
    pub height_map: Option<HeightMap>,
}

impl Material {
    /// The name of a number that is not finite.
    fn non_finite(&self) -> Option<&'static str> {
        let normal = self.normal_map.as_ref();
        let height = self.height_map.as_ref();
        let finite =
            |transform: &crate::mesh::maps::UvTransform| transform.rows.as_flattened().iter().all(|x| x.is_finite());
        [
            ("base colour", self.base_color.iter().all(|x| x.is_finite())),
            ("alpha cutoff", self.alpha_cutoff.is_none_or(f32::is_finite)),
            ("scale of the normal map", normal.is_none_or(|m| m.scale.is_finite())),
            ("texture transform of the normal map", normal.is_none_or(|m| finite(&m.uv_transform))),
            ("amplitude of the height map", height.is_none_or(|m| m.amplitude.is_finite())),
            ("bias of the height map", height.is_none_or(|m| m.bias.is_finite())),
            ("texture transform of the height map", height.is_none_or(|m| finite(&m.uv_transform))),
        ]
        .into_iter()
        .find_map(|(what, finite)| (!finite).then_some(what))
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: [0.8, 0.8, 0.8, 1.0],
            texture: None,
            alpha_cutoff: None,
            normal_map: None,
            height_map: None,
        }
    }
}

/// An image with all its mip levels, 8 bits per channel: RGB encoded as sRGB, alpha linear.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Mip levels, the full image first, each half the size of the one before (rounded down, at least 1).
    pub mips: Vec<MipLevel>,
}

/// One mip level: row-major RGBA, first row on top.
#[derive(Clone, Debug)]
pub struct MipLevel {
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Vec<[u8; 4]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            triangle_materials: vec![0],
            materials: vec![Material::default()],
            ..Mesh::default()
        }
    }

    #[test]
    fn validation_names_what_is_wrong() {
        triangle().validate().unwrap();
        let message = |change: fn(&mut Mesh)| {
            let mut mesh = triangle();
            change(&mut mesh);
            mesh.validate().unwrap_err().to_string()
        };
        assert_eq!(message(|m| m.triangles.clear()), "the mesh has no triangles");
        assert_eq!(message(|m| m.normals.push([0.0; 3])), "normals has 1 entries where 3 are needed");
        assert_eq!(message(|m| m.uvs = vec![[0.0; 2]; 4]), "uvs has 4 entries where 3 are needed");
        assert_eq!(message(|m| m.colors.push([0.0; 3])), "colors has 1 entries where 3 are needed");
        assert_eq!(message(|m| m.tangents.push([0.0; 4])), "tangents has 1 entries where 3 are needed");
        assert_eq!(message(|m| m.triangle_materials.clear()), "triangle_materials has 0 entries where 1 are needed");
        assert_eq!(message(|m| m.positions[2][1] = f64::NEG_INFINITY), "vertex 2 is not finite; repair or remove it");
        assert_eq!(
            message(|m| m.uvs = vec![[0.0; 2], [0.0, f32::NAN], [0.0; 2]]),
            "the texture coordinate of vertex 1 is not finite; repair or remove it"
        );
        assert_eq!(
            message(|m| m.tangents = vec![[0.0; 4], [0.0, 0.0, 0.0, f32::NAN], [0.0; 4]]),
            "the tangent of vertex 1 is not finite; repair or remove it"
        );
        assert_eq!(
            message(|m| m.materials[0].base_color[3] = f32::INFINITY),
            "the base colour of material 0 is not finite; correct it"
        );
        assert_eq!(message(|m| m.triangles[0][2] = 3), "triangle 0 refers to vertex 3, but there are only 3");
        assert_eq!(message(|m| m.materials.clear()), "triangle 0 refers to material 0, but there are only 0");
    }

    #[test]
    fn transforms_keep_the_outside_outside() {
        let mut mesh = triangle();
        mesh.normals = vec![[0.0, 0.6, 0.8]; 3];
        mesh.transform(&DMat4::from_scale_rotation_translation(
            DVec3::new(1.0, 2.0, -1.0),
            glam::DQuat::IDENTITY,
            DVec3::new(0.0, 0.0, 7.0),
        ));
        assert_eq!(mesh.bounds(), Some(([0.0, 0.0, 7.0], [1.0, 2.0, 7.0])));
        assert_eq!(mesh.triangles, [[0, 2, 1]]);
        // By the inverse transpose: (0, 0.3, -0.8), brought to unit length.
        let n = mesh.normals[0];
        assert!((n[1] / n[2] + 0.375).abs() < 1e-6 && n[2] < 0.0 && (n[1].hypot(n[2]) - 1.0).abs() < 1e-6, "{n:?}");
    }

    #[test]
    fn tangents_follow_transforms_and_texture_coordinates() {
        let texels = vec![[32768, 32768, 65535]];
        let map = NormalMap {
            texture: Arc::new(crate::mesh::maps::LinearTexture::new(1, 1, texels).unwrap()),
            scale: 1.0,
            uv_transform: crate::mesh::maps::UvTransform::IDENTITY,
        };
        let mut mesh = triangle();
        assert_eq!(mesh.corner_tangents(0, &map), None);
        mesh.uvs = vec![[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]];
        assert_eq!(mesh.corner_tangents(0, &map), Some([[1.0, 0.0, 0.0, 1.0]; 3]));
        // A map that is turned by a quarter: its u grows where v of the mesh does, downwards.
        let turned = crate::mesh::maps::UvTransform { rows: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]] };
        let turned = NormalMap { uv_transform: turned, ..map.clone() };
        assert_eq!(mesh.corner_tangents(0, &turned), Some([[0.0, -1.0, 0.0, 1.0]; 3]));
        // One tangent missing: all are derived. Given ones are taken as they are, and move with the mesh.
        mesh.tangents = vec![[0.0, 1.0, 0.0, 1.0], [0.0; 4], [0.0, 1.0, 0.0, 1.0]];
        assert_eq!(mesh.corner_tangents(0, &map), Some([[1.0, 0.0, 0.0, 1.0]; 3]));
        mesh.tangents[1] = [0.0, 1.0, 0.0, 1.0];
        mesh.transform(&DMat4::from_scale(DVec3::new(1.0, -3.0, 1.0)));
        assert_eq!(mesh.corner_tangents(0, &map), Some([[0.0, -1.0, 0.0, -1.0]; 3]));
    }

    #[test]
    fn tiny_and_flattening_transforms_keep_normals() {
        let normal = |scale: DVec3| transform_normal(&normal_matrix(&DMat4::from_scale(scale)), [0.0, 0.0, 1.0]);
        assert_eq!(normal(DVec3::splat(1e-120)), [0.0, 0.0, 1.0]);
        assert_eq!(normal(DVec3::new(1.0, 1.0, 0.0)), [0.0, 0.0, 1.0]);
        assert_eq!(normal(DVec3::ZERO), [0.0; 3]);
    }
}
