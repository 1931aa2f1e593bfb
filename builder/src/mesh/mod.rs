//! Triangle meshes as the builder takes them: indexed triangles, one material per triangle, attributes per vertex.

pub mod maps;
mod material;
pub(crate) mod properties;
pub(crate) mod texture;
pub(crate) mod transform;
mod wrap;

use glam::{DMat4, DVec3};

use maps::{NormalMap, derived_tangent};
use transform::{mirrors, normal_matrix, transform_normal, transform_tangent};

pub use material::Material;
pub use texture::{MAX_TEXTURE_SIDE, MipLevel, Texture, TextureError};
pub use wrap::Wrap;

/// Most triangles, and most vertices, that one mesh may have. Instances in a glTF scene can multiply a small file into
/// more triangles than fit into memory; this limit stops that.
pub const MAX_ELEMENTS: usize = 1 << 27;

/// An indexed triangle mesh in its own units.
///
/// Vertex attributes other than the position are optional: each array is either empty or as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions in mesh units. Every component must be finite.
    pub positions: Vec<[f64; 3]>,
    /// Unit shading normals per vertex, or empty. If empty, the geometric normals are used.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates per vertex, or empty. `v` grows downwards from the first row of the image; outside
    /// 0..=1 the [`Wrap`] of the texture counts.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex colours in linear RGB, 0..=1, or empty. They multiply the material's colour.
    pub colors: Vec<[f32; 3]>,
    /// Unit tangents per vertex with their handedness (1 or -1) as fourth component, as in glTF (see [`maps`]), or empty.
    /// Zero for a vertex without a tangent. Read them through [`Mesh::corner_tangents`].
    pub tangents: Vec<[f32; 4]>,
    /// Vertex indices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `materials` for each triangle; as long as `triangles`.
    pub triangle_materials: Vec<u32>,
    /// At least one material if there is a triangle.
    pub materials: Vec<Material>,
    /// Problems that the importer found and could work around: missing textures, skipped primitives. One line each.
    pub warnings: Vec<String>,
}

/// Which rule of a mesh [`Mesh::validate`] found broken. Indices count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// Nothing to voxelize.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// An attribute array is neither empty nor as long as `positions`, or `triangle_materials` is not as long as `triangles`.
    #[error("the array {what} of the mesh has {found} entries; it must have {expected}")]
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
    #[error("triangle {triangle} refers to vertex {vertex}, but the mesh has only {vertices} vertices")]
    VertexOutOfRange {
        /// Index into `triangles`.
        triangle: usize,
        /// The vertex index it holds.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A triangle names a material that does not exist.
    #[error("triangle {triangle} refers to material {material}, but the mesh has only {materials} materials")]
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
    /// A mesh of one plain material from positions in mesh units and vertex indices, counter-clockwise from outside.
    ///
    /// # Errors
    /// No triangle, a vertex that does not exist, or a position that is not finite.
    pub fn from_triangles(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let triangle_materials = vec![0; triangles.len()];
        let mesh =
            Self { positions, triangles, triangle_materials, materials: vec![Material::default()], ..Self::default() };
        mesh.validate()?;
        Ok(mesh)
    }

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

    /// Moves all vertices by `matrix`. Normals are transformed by its inverse transpose. If the matrix mirrors, the winding
    /// of the triangles is swapped. So both still point outwards.
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

    /// The tangents at the corners of `triangle` for reading `map`: unit vectors, not always perpendicular to the normal,
    /// each with its handedness.
    ///
    /// These are the tangents of the vertices. If one of the three vertices has none, all corners get one tangent computed
    /// from the texture coordinates: the direction on the triangle in which `u` of the map grows while `v` is constant.
    /// `None` if the triangle or its texture coordinates have no area; the map does not apply to the triangle then.
    ///
    /// The caller interpolates between the corners; [`mapped_normal`](crate::mapped_normal) makes the result perpendicular
    /// to the normal.
    ///
    /// # Panics
    /// If `triangle` or one of its vertices does not exist; [`Mesh::validate`] finds such a vertex.
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

    /// Gives vertices without a normal (zero) the geometric normal of their triangle. If the triangles that share a vertex
    /// have different normals, the vertex is duplicated: a file without normals for a face means flat shading.
    pub(crate) fn fill_missing_normals(&mut self) {
        let mesh = self;
        if mesh.normals.is_empty() || mesh.positions.len() >= MAX_ELEMENTS {
            return;
        }
        let given = mesh.positions.len();
        let missing: Vec<bool> = mesh.normals.iter().map(|n| *n == [0.0; 3]).collect();
        if !missing.contains(&true) {
            return;
        }
        for triangle in &mut mesh.triangles {
            if !triangle.iter().any(|&v| missing.get(v as usize) == Some(&true)) {
                continue;
            }
            let corner = |v: u32| mesh.positions.get(v as usize).map(|&p| DVec3::from(p));
            let [Some(a), Some(b), Some(c)] = triangle.map(corner) else { continue };
            let flat = match (b - a).cross(c - a).normalize_or_zero() {
                DVec3::ZERO => [0.0, 0.0, 1.0],
                n => n.as_vec3().to_array(),
            };
            for index in triangle {
                let v = *index as usize;
                if v >= given || !missing[v] || mesh.normals[v] == flat {
                    continue;
                }
                if mesh.normals[v] == [0.0; 3] {
                    mesh.normals[v] = flat;
                } else if mesh.positions.len() < MAX_ELEMENTS {
                    *index = mesh.positions.len() as u32;
                    mesh.positions.push(mesh.positions[v]);
                    mesh.normals.push(flat);
                    if let Some(&uv) = mesh.uvs.get(v) {
                        mesh.uvs.push(uv);
                    }
                    if let Some(&color) = mesh.colors.get(v) {
                        mesh.colors.push(color);
                    }
                    if !mesh.tangents.is_empty() {
                        // A tangent does not fit a normal that was computed here.
                        mesh.tangents.push([0.0; 4]);
                    }
                }
            }
        }
        // Vertices that no triangle uses.
        for n in &mut mesh.normals {
            if *n == [0.0; 3] {
                *n = [0.0, 0.0, 1.0];
            }
        }
    }

    /// Checks everything that the builder relies on.
    ///
    /// # Errors
    /// The first rule in the documentation of the fields that does not hold.
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

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
        assert_eq!(
            message(|m| m.normals.push([0.0; 3])),
            "the array normals of the mesh has 1 entries; it must have 3"
        );
        assert_eq!(message(|m| m.uvs = vec![[0.0; 2]; 4]), "the array uvs of the mesh has 4 entries; it must have 3");
        assert_eq!(message(|m| m.colors.push([0.0; 3])), "the array colors of the mesh has 1 entries; it must have 3");
        assert_eq!(
            message(|m| m.tangents.push([0.0; 4])),
            "the array tangents of the mesh has 1 entries; it must have 3"
        );
        assert_eq!(
            message(|m| m.triangle_materials.clear()),
            "the array triangle_materials of the mesh has 0 entries; it must have 1"
        );
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
        assert_eq!(
            message(|m| m.triangles[0][2] = 3),
            "triangle 0 refers to vertex 3, but the mesh has only 3 vertices"
        );
        assert_eq!(
            message(|m| m.materials.clear()),
            "triangle 0 refers to material 0, but the mesh has only 0 materials"
        );
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
        // A map rotated by a quarter turn: its u grows in the direction of v of the mesh, downwards.
        let turned = crate::mesh::maps::UvTransform { rows: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]] };
        let turned = NormalMap { uv_transform: turned, ..map.clone() };
        assert_eq!(mesh.corner_tangents(0, &turned), Some([[0.0, -1.0, 0.0, 1.0]; 3]));
        // If one tangent is missing, all are derived. Given tangents are returned unchanged, and are moved with the mesh.
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
