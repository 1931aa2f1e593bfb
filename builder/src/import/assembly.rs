//! Puts the parts that a file is made of together into one mesh.

use std::path::Path;

use glam::{DMat4, DVec3};

use super::{ImportError, MAX_ELEMENTS};
use crate::mesh::{Mesh, mirrors, normal_matrix, transform_normal, transform_tangent};

/// Triangles of one material with vertices of their own. Empty attribute arrays: the part has none.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) colors: Vec<[f32; 3]>,
    /// Only where there are normals.
    pub(super) tangents: Vec<[f32; 4]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index into the materials of the mesh.
    pub(super) material: u32,
}

/// A mesh in the making. Attributes that only some parts have are filled in for the others.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    pub(super) mesh: Mesh,
}

impl Assembly {
    /// Whether `copies` of `part` fit. Asked for all instances at once before the first is added, so that a file that asks
    /// for too many is refused before the memory is spent.
    pub(super) fn check_room(&self, path: &Path, part: &Part, copies: usize) -> Result<(), ImportError> {
        for (what, have, more) in [
            ("triangles", self.mesh.triangles.len(), part.triangles.len()),
            ("vertices", self.mesh.positions.len(), part.positions.len()),
        ] {
            let total = more.saturating_mul(copies).saturating_add(have);
            if total > MAX_ELEMENTS {
                return Err(ImportError::TooLarge {
                    path: path.into(),
                    what: format!("the mesh has at least {total} {what} with all instances"),
                    limit: MAX_ELEMENTS as u64,
                });
            }
        }
        Ok(())
    }

    /// Adds `part`, moved by `transform` (normals by the inverse transpose, winding swapped if it mirrors).
    pub(super) fn append(&mut self, path: &Path, part: &Part, transform: Option<&DMat4>) -> Result<(), ImportError> {
        self.check_room(path, part, 1)?;
        let mesh = &mut self.mesh;
        let first = mesh.positions.len();
        // A missing normal is marked by zero and made up at the end.
        let moved = |normals: &[[f32; 3]]| match transform {
            Some(matrix) => {
                let matrix = normal_matrix(matrix);
                normals.iter().map(|&n| transform_normal(&matrix, n)).collect()
            }
            None => normals.to_vec(),
        };
        append_attribute(&mut mesh.normals, &moved(&part.normals), first, part.positions.len(), [0.0; 3]);
        let turned: Vec<[f32; 4]> = match transform {
            Some(matrix) => part.tangents.iter().map(|&t| transform_tangent(matrix, t)).collect(),
            None => part.tangents.clone(),
        };
        append_attribute(&mut mesh.tangents, &turned, first, part.positions.len(), [0.0; 4]);
        append_attribute(&mut mesh.uvs, &part.uvs, first, part.positions.len(), [0.0; 2]);
        append_attribute(&mut mesh.colors, &part.colors, first, part.positions.len(), [1.0; 3]);
        match transform {
            Some(matrix) => mesh
                .positions
                .extend(part.positions.iter().map(|&p| matrix.transform_point3(DVec3::from(p)).to_array())),
            None => mesh.positions.extend_from_slice(&part.positions),
        }
        // Fits: MAX_ELEMENTS is below u32::MAX. Indices past the part are left for the final check to find.
        let base = first as u32;
        let flip = transform.is_some_and(mirrors);
        mesh.triangles.extend(part.triangles.iter().map(|&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|i| i.saturating_add(base));
            if flip { [a, c, b] } else { [a, b, c] }
        }));
        mesh.triangle_materials.resize(mesh.triangles.len(), part.material);
        Ok(())
    }

    /// The finished mesh, not yet validated.
    pub(super) fn finish(mut self) -> Mesh {
        fill_missing_normals(&mut self.mesh);
        self.mesh
    }

    pub(super) fn warn(&mut self, line: impl Into<String>) {
        let line = line.into();
        tracing::warn!("{line}");
        // The same line again says nothing new, and a file can provoke it without end.
        if self.mesh.warnings.len() < MAX_WARNINGS && !self.mesh.warnings.contains(&line) {
            self.mesh.warnings.push(line);
        }
    }
}

/// More lines than anyone reads.
const MAX_WARNINGS: usize = 100;

/// Keeps an attribute array either empty or as long as the positions.
fn append_attribute<T: Copy>(all: &mut Vec<T>, more: &[T], before: usize, added: usize, missing: T) {
    if all.is_empty() && more.is_empty() {
        return;
    }
    all.resize(before, missing);
    all.extend_from_slice(&more[..more.len().min(added)]);
    all.resize(before + added, missing);
}

/// Gives triangles without normals their geometric one. Where triangles that share a vertex disagree, the vertex is
/// doubled: a file that has no normals for a face means it to look flat.
pub(crate) fn fill_missing_normals(mesh: &mut Mesh) {
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
                    // Of no use with a normal that is made up.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Material;

    fn triangle(z: f64) -> Part {
        Part {
            positions: vec![[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]],
            triangles: vec![[0, 1, 2]],
            ..Part::default()
        }
    }

    fn geometric_normal(mesh: &Mesh, t: usize) -> DVec3 {
        let [a, b, c] = mesh.triangles[t].map(|v| DVec3::from(mesh.positions[v as usize]));
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn parts_with_and_without_attributes_mix() {
        let mut assembly = Assembly::default();
        let path = Path::new("x");
        assembly.append(path, &triangle(0.0), None).unwrap();
        let with = Part { normals: vec![[1.0, 0.0, 0.0]; 3], uvs: vec![[0.5, 0.25]; 3], ..triangle(1.0) };
        assembly.append(path, &with, None).unwrap();
        assembly.append(path, &Part { colors: vec![[0.0, 0.5, 1.0]; 3], ..triangle(2.0) }, None).unwrap();
        assembly.mesh.materials.push(Material::default());
        let mesh = assembly.finish();
        mesh.validate().unwrap();
        assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
        assert_eq!(mesh.normals[3], [1.0, 0.0, 0.0]);
        assert_eq!(mesh.normals[8], [0.0, 0.0, 1.0]);
        assert_eq!((mesh.uvs[0], mesh.uvs[4], mesh.uvs[8]), ([0.0, 0.0], [0.5, 0.25], [0.0, 0.0]));
        assert_eq!((mesh.colors[0], mesh.colors[8]), ([1.0; 3], [0.0, 0.5, 1.0]));
        assert_eq!(mesh.triangles[2], [6, 7, 8]);
    }

    #[test]
    fn mirrored_parts_still_point_outwards() {
        let mut assembly = Assembly::default();
        let part = Part { normals: vec![[0.0, 0.0, 1.0]; 3], ..triangle(0.0) };
        // Mirrors in x, squeezes in z, moves: the face still looks along +z.
        let matrix =
            DMat4::from_translation(DVec3::new(5.0, 6.0, 7.0)) * DMat4::from_scale(DVec3::new(-1.0, 1.0, 0.25));
        assembly.append(Path::new("x"), &part, Some(&matrix)).unwrap();
        let mesh = assembly.finish();
        assert_eq!(mesh.positions[1], [4.0, 6.0, 7.0]);
        assert_eq!(geometric_normal(&mesh, 0), DVec3::Z);
        assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_shared_vertex_without_normal_is_doubled_at_an_edge() {
        let mut assembly = Assembly::default();
        let with = Part { normals: vec![[1.0, 0.0, 0.0]; 3], ..triangle(9.0) };
        let folded = Part {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [0, 3, 1]],
            ..Part::default()
        };
        assembly.append(Path::new("x"), &with, None).unwrap();
        assembly.append(Path::new("x"), &folded, None).unwrap();
        assembly.mesh.materials.push(Material::default());
        let mesh = assembly.finish();
        mesh.validate().unwrap();
        for t in 1..3 {
            let flat = geometric_normal(&mesh, t).as_vec3().to_array();
            assert!(mesh.triangles[t].iter().all(|&v| mesh.normals[v as usize] == flat));
        }
        assert_eq!(mesh.positions.len(), 9, "two of the four vertices lie on both faces");
    }
}
